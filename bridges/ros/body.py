"""An environment as a robot: it drives what it is sent, times out, is never over, and says where it believes to be."""

import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.ros.messages import STILL, Odometry, Twist, wrapped
from wayfield.envs.robots import Robot
from wayfield.envs.robots.hulls import clearance_of
from wayfield.envs.scenarios import GoalScenario
from wayfield.envs.scenarios.maps import grid_from_file
from wayfield.envs.tasks.specs import CROWDS, EVERY
from wayfield.envs.world.grids import OccupancyGrid
from wayfield.policies import Pilot, make
from wayfield.system.checks import FARTHEST

WORLDS = tuple(spec.kind for spec in EVERY.values())

Pose = tuple[float, float, float]
_OFF = 0.02  # m, from which on a body no longer touches another


class Body:
    """A robot in one of our worlds, stepped by control periods.

    Goals are nothing to it and contact ends nothing: the kinematic hull stands where it touches until it is driven
    away, and with forces things are pushed. In a team it is the first robot; a policy drives the others, which stay
    where they have arrived. People walk by the laws of their scenario.

    Args:
        world: the kind of world, one of WORLDS.
        scenario: a name, a family with its split, or a file, as environments take it; or a map of ROS (.yaml) alone.
        timeout: s of its own time, without a command after which the base gets a zero command and brakes by its limits.
        start: pose (m, m, rad) in the world; None: as the scenario starts.
        beams: of the scan; None: the data sheet's.
        pose_source: of what it publishes as odometry: "odometry", or "ground_truth", as a good localiser would say it.
        others: the policy of the other robots of a team.

    Attributes:
        map_to_odom: pose (m, m, rad) of odometry's frame in the world, as at the start, or as `put` has left it.

    Raises:
        ValueError: if an option is wrong, or the hull does not fit at the start; the message names it.
        OSError: if a file cannot be opened.
    """

    def __init__(
        self,
        robot: Robot,
        world: str = "goal",
        scenario: Any = "rooms",
        dynamics: str = "kinematic",
        actuators: str = "lagged",
        disturbance: str = "none",
        seed: int = 0,
        timeout: float = 0.5,
        start: Pose | None = None,
        beams: int | None = None,
        pose_source: str = "odometry",
        others: str = "orca_team",
    ) -> None:
        spec = next(each for each in EVERY.values() if each.kind == world)
        options: dict[str, Any] = {"actuators": actuators, "disturbance": disturbance}
        law = make(others)
        if spec.name in CROWDS:
            if dynamics != "kinematic":
                raise ValueError(f"a world of kind {world!r} is kinematic; dynamics is {dynamics!r}")
            # robots that have arrived stay visible, this robot among them
            options |= {"parks": True, "sees": "bodies" if law.knows == "bodies" else "scan"}
        else:
            options["dynamics"] = dynamics
        if dynamics != "kinematic" and spec.observes == "goal":
            options["end_on_contact"] = False
        if beams is not None and spec.observes == "goal":
            options["num_beams"] = beams
        if world == "goal" and scenario.endswith(".yaml"):
            scenario = _on_map(scenario, start)
        made: Any = gymnasium.make(
            spec.env_id(robot),
            robot=robot,
            scenario=scenario,
            pose_source=pose_source,
            disable_env_checker=True,
            **options,
        )
        self._env: Any = made.unwrapped
        self.robot = robot
        self.dt: float = self._env.task.options.dt
        self.timeout = timeout
        self._seed = seed
        self.not_finite = 0  # commands that were
        self._rows: Any = getattr(self._env, "rows", None)  # of a team
        self._law: Pilot | None = None
        if self._rows is not None:
            self._law = Pilot(law, self._env)
        self._begin()
        self._move(STILL)  # compiles
        self._begin()
        self.steps = 0
        self._command, self._commanded = STILL, -math.inf
        self.contacts = 0
        self.contact = False
        self._origin: Pose = (0.0, 0.0, 0.0)
        self._localised = pose_source == "ground_truth"
        if start is not None and (wrong := self.put(start)):
            raise ValueError(f"--start {wrong}")
        # odometry begins where the robot does
        self._origin = self.map_to_odom = self._placed("x", "y", "heading")
        state = self._env.batch.states[0]
        for name, value in zip(("odometry_x", "odometry_y", "odometry_heading"), self._origin, strict=True):
            state[name] = value
        self._move(STILL)  # measures: a step at rest, which no clock counts

    def _begin(self) -> None:
        self._seen, _ = self._env.reset(seed=self._seed)
        if self._law is not None:
            self._law.reset()

    def _move(self, twist: Twist) -> None:
        """Moves the world by one control period."""
        requested = (twist.vx, twist.vy, twist.yaw_rate)
        action = np.array([requested[axis] for axis in self.robot.twist_axes])
        if self._law is not None:
            mine, action = action, np.array(self._law.act(self._seen))
            action[0] = mine
        self._seen, *_ = self._env.step(action)
        if self._rows is not None:  # contact ends nothing, nor does a goal that was not set
            self._rows.alive |= self._env.batch.states["contact"] != 0
            self._rows.alive[0] = True

    @property
    def time(self) -> float:
        """Returns the time (s) on its clock, which starts at one control period."""
        return (self.steps + 1) * self.dt

    @property
    def beam_angles(self) -> NDArray[np.float64]:
        """Returns the directions (n,) rad of the beams; none on a path."""
        result: NDArray[np.float64] = self._env.task.beam_angles
        return result

    @property
    def max_range(self) -> float:
        """Returns the range (m) of the scanner."""
        return float(self._env.task.params["max_range"][0])

    @property
    def grid(self) -> OccupancyGrid | None:
        """Returns the map that the world stands on, if it does."""
        task = self._env.task
        courses = task.courses_of() if hasattr(task, "courses_of") else task.scenarios
        result: OccupancyGrid | None = getattr(courses[int(self._env.batch.states[0]["scenario"])], "grid", None)
        return result

    @property
    def others(self) -> NDArray[np.float64]:
        """Returns where others are, robots before people: (q, 3), x, y and radius (m)."""
        batch = self._env.batch
        robots, people = self._env.task.others(batch.states, batch.own, 0)
        radius = self.robot.hull_radius
        there = [(x, y, radius) for _, (x, y, _), _, left in robots if not left]
        return np.array([*there, *people[:, [0, 1, -1]].tolist()]).reshape(-1, 3)

    @property
    def ranges(self) -> NDArray[np.float32]:
        """Returns the scan (n,), m: what is out of range, and a beam that dropped out, reads max_range."""
        result: NDArray[np.float32] = self._env.task.layout.unpack(self._seen).ranges
        return result if result.ndim == 1 else result[0]

    @property
    def odometry(self) -> Odometry:
        """Returns where the robot believes to be, from where it started, and how fast."""
        x, y, heading = self._placed("measured_x", "measured_y", "measured_heading")
        x0, y0, turn = self._origin
        c, s = math.cos(turn), math.sin(turn)
        ahead, left = c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0)
        twist = Twist(*self._placed("measured_vx", "measured_vy", "measured_yaw_rate"))
        return Odometry(self.time, "odom", ahead, left, wrapped(heading - turn), twist)

    @property
    def truth(self) -> Odometry:
        """Returns where the robot is in the world, and how fast it moves."""
        x, y, heading = self._placed("x", "y", "heading")
        return Odometry(self.time, "map", x, y, heading, Twist(*self._placed("vx", "vy", "yaw_rate")))

    def command(self, twist: Twist) -> None:
        """Takes a command, which acts from the next step on; what is not finite is zero, and counted."""
        if not twist.is_finite:
            self.not_finite += 1
            twist = STILL
        self._command, self._commanded = twist, self.time

    def step(self) -> None:
        """Moves by one control period."""
        if self.time - self._commanded >= self.timeout - 1e-9:
            self._command = STILL
        self._move(self._command)
        self.steps += 1
        batch = self._env.batch
        touched = bool(batch.states[0]["contact"])
        if batch.own and self.contact:  # a robot that presses against another stands off it by less than a period's way
            touched |= bool(batch.states[0]["gap"] < _OFF)
        self.contacts += touched and not self.contact
        self.contact = touched

    def put(self, pose: Pose) -> str:
        """Puts the robot at rest at a pose (m, m, rad) of the world; odometry goes on, and `map_to_odom` changes.

        Returns why it does not go there, in a line; "" where it stands.
        """
        if not all(map(math.isfinite, pose)):
            return f"pose {pose} is not finite"
        if max(abs(pose[0]), abs(pose[1])) > FARTHEST:
            return f"pose ({pose[0]:.6g}, {pose[1]:.6g}) m must be within {FARTHEST:g} m of the map's origin"
        believed = self.odometry
        batch = self._env.batch
        state, radius = batch.states[0], self.robot.hull_radius
        count = int(self._env.task.obstacle_counts(batch.states)[0])
        clear = math.inf
        if count:
            clear = clearance_of(self.robot, batch.known_obstacles[state["field"]], count, pose)
        if self.grid is not None:
            clear = min(clear, float(self.grid.clearances(np.array([pose[:2]]))[0]) - radius)
        places = self.others
        if len(places):
            apart = np.hypot(places[:, 0] - pose[0], places[:, 1] - pose[1]) - places[:, 2]
            clear = min(clear, float(apart.min()) - radius)
        if not clear > 0.0:
            return f"pose {tuple(round(each, 3) for each in pose)}: the hull does not fit there, by {-clear:.2f} m"
        state["x"], state["y"], state["heading"] = pose[0], pose[1], wrapped(pose[2])
        for kind in ("", "command_", "wheel_"):
            for axis in ("vx", "vy", "yaw_rate"):
                state[kind + axis] = 0.0
        state["clearance"] = clear
        if batch.own:  # where others see it
            snapshots, _, _, _, clocks, _ = batch.own
            place = snapshots[clocks[0, 0], 0, 0]
            place["x"], place["y"], place["cos"], place["sin"] = *pose[:2], math.cos(pose[2]), math.sin(pose[2])
            place["vx"] = place["vy"] = 0.0
        if batch.plant is not None:
            batch.plant.reset(np.arange(1), batch.states, batch.obstacles)
        self._command = STILL
        # where odometry's frame lies now, as a localiser would say it
        turn = wrapped(pose[2] - believed.heading)
        c, s = math.cos(turn), math.sin(turn)
        x, y = pose[0] - c * believed.x + s * believed.y, pose[1] - s * believed.x - c * believed.y
        self.map_to_odom = (x, y, turn)
        if self._localised:
            self._origin = self.map_to_odom
            state["measured_x"], state["measured_y"], state["measured_heading"] = pose[0], pose[1], wrapped(pose[2])
        return ""

    def _placed(self, *names: str) -> Any:
        state = self._env.batch.states[0]
        return tuple(float(state[name]) for name in names)


def _on_map(file: str, start: Pose | None) -> GoalScenario:
    """Returns the world that a map is; ValueError without a start."""
    if start is None:
        raise ValueError(f"--scenario {file} is a map alone; --start X,Y,HEADING must say where the robot begins")
    return GoalScenario(Path(file).stem, start=start, goal=start, grid=grid_from_file(file))
