"""Missions: a policy that drives to a pose or along a path, briefed by a robot's data sheet alone."""

import dataclasses
import math
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.ros.conventions import View
from wayfield.bridges.ros.guard import Decision
from wayfield.bridges.ros.messages import Goal, Odometry, Twist, wrapped
from wayfield.envs import goal_reaching, path_following
from wayfield.envs.batch import ALONE, Results
from wayfield.envs.robots import Robot
from wayfield.envs.scenarios import PathScenario
from wayfield.envs.scenarios.tables import closing
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.tasks.specs import TASKS, TaskSpec
from wayfield.envs.tasks.stepping import JUDGE
from wayfield.envs.world.paths import Path
from wayfield.policies import ABOUT, POLICIES, Policy
from wayfield.policies.parts.forward_prediction import ForwardPrediction, undelayed
from wayfield.policies.parts.policy import check_robot
from wayfield.system.checks import FARTHEST, shown

LEAST_BEAMS = 72  # that a policy is shown, as many as the agents that ship were trained with
FARTHEST_GOAL = 50.0  # m, from the robot


def beams_of(robot: Robot, beams: int | None = None) -> NDArray[np.float64]:
    """Returns the directions (n,) rad, of a full circle, that a policy is shown a scan in.

    As many as the data sheet says, and at least LEAST_BEAMS, unless a number is given.
    """
    return np.linspace(-math.pi, math.pi, beams or max(robot.sensors.beams, LEAST_BEAMS), endpoint=False)


def check_drives(policy: Policy, name: str, robot: Robot, along: bool) -> None:
    """Raises ValueError, with the policies that do, unless a policy drives by sensors, or along a path given."""
    check_robot(policy, robot)
    if _drives(policy, along):
        return
    able = []
    for each in ABOUT:
        try:
            made = POLICIES[each]()
        except (ImportError, ValueError):
            continue
        if _drives(made, along):
            able.append(each)
    if along:
        wanted = "does not follow a path that it is given"
    elif path_following.Observation in policy.observes and policy.knows == "path":
        wanted = "follows paths: give one by --path"
    else:
        wanted = f"has to know the {policy.knows} before it starts, which no sensor tells"
    raise ValueError(f"policy {name!r} {wanted}; these drive: {', '.join(able)}")


def _drives(policy: Policy, along: bool) -> bool:
    if along:
        return policy.knows in ("path", "sensors") and path_following.Observation in policy.observes
    return policy.knows == "sensors" and goal_reaching.Observation in policy.observes


def _twist(robot: Robot, twist: NDArray[np.float64]) -> Twist:
    """Returns a policy's answer (1, t) as a body twist."""
    whole = np.zeros(3)
    whole[list(robot.twist_axes)] = twist[0]
    return Twist(*whole.tolist())


def _of_axes(robot: Robot, twist: Twist) -> NDArray[np.float64]:
    return np.array([[twist.vx, twist.vy, twist.yaw_rate]])[:, list(robot.twist_axes)]


class _Driver:
    """Has a policy decide under a briefing: of a base with a delay, from its predicted state."""

    def __init__(
        self, policy: Policy, briefing: Briefing, along: Briefing | None = None, preview_spacing: float = 0.0
    ) -> None:
        self._policy = policy
        late = briefing.actuators.response is not None
        late = late and not getattr(policy, "trained_with", lambda robot: False)(briefing.robot)
        self._ahead = ForwardPrediction(along or briefing, preview_spacing) if late else None
        self._briefing = dataclasses.replace(briefing, actuators=undelayed(briefing.actuators)) if late else briefing
        self._memory = policy.reset(self._briefing)

    def twist(self, observations: NDArray[np.float64]) -> Twist:
        """Returns the policy's command at a flat observation (1, n)."""
        if self._ahead is not None:
            observations = self._ahead.observed(observations)
        requested = self._policy.act(self._briefing.layout.unpack(observations), self._briefing, self._memory)
        return _twist(self._briefing.robot, requested if self._ahead is None else self._ahead.requested(requested))

    def sent(self, twist: Twist) -> None:
        """Takes note of what the base is sent."""
        if self._ahead is not None:
            self._ahead.sent(_of_axes(self._briefing.robot, twist))


class ToGoal:
    """Drives to a pose by a policy that knows its sensors alone.

    Args:
        spec: the task that it is in; agents are trained for one.
        beam_angles: (n,) rad, as the policy shall see them.
        period: s, between decisions.
        tolerance: m, from the goal where it is reached.
        turned: rad, from the goal's heading, where it has one.

    Raises:
        ValueError: if the policy cannot drive the robot so.
    """

    def __init__(
        self,
        policy: Policy,
        robot: Robot,
        spec: TaskSpec = TASKS["goal_reaching"],
        beam_angles: NDArray[np.float64] | None = None,
        period: float = 0.05,
        tolerance: float = 0.1,
        turned: float = 0.1,
    ) -> None:
        angles = beams_of(robot) if beam_angles is None else beam_angles
        most = robot.sensors.range
        self._layout = goal_reaching.Observation.layout(len(robot.twist_axes), len(angles), most, spec)
        self._briefing = Briefing(
            num_envs=1,
            robot=robot,
            actuators=robot.actuators("lagged"),
            dt=period,
            action_mode="twist",
            layout=self._layout,
            beam_angles=angles,
            max_range=most,
            position_tolerance=np.array([tolerance]),
            heading_tolerance=np.array([turned]),
        )
        self._policy, self._robot = policy, robot
        self._tolerance, self._turned = tolerance, turned
        self.goal: Goal | None = None
        self.distance = math.nan  # m, to the goal
        self.reset()

    @property
    def lacks(self) -> str:
        """Returns "no goal" until there is one."""
        return "" if self.goal is not None else "no goal"

    def rehearse(self) -> None:
        """Decides once for nothing: what is to be compiled is, before anything moves."""
        self.goal = Goal("", 1.0, 0.0)
        ranges = np.full(len(self._briefing.beam_angles), self._briefing.max_range)
        self.decide(Odometry(0.0, "", 0.0, 0.0, 0.0), View(ranges, np.empty((0, 2)), False))
        self.goal = None
        self.reset()

    def refusal(self, goal: Goal, odometry: Odometry | None) -> str:
        """Returns why a goal is not driven to, in a line; "" where it is."""
        if not math.isfinite(goal.x + goal.y) or math.isinf(goal.heading):
            return f"goal ({goal.x}, {goal.y}, {goal.heading}) is not finite"
        if odometry is None:
            return "there is no odometry yet; send the goal again once state is waiting: no goal"
        if goal.frame not in ("", odometry.frame):
            return f"its frame is {shown(goal.frame)}; it must be {shown(odometry.frame)}, odometry's: no TF is used"
        away = math.hypot(goal.x - odometry.x, goal.y - odometry.y)
        if away > FARTHEST_GOAL:
            return f"goal is {away:.6g} m away; it must be within {FARTHEST_GOAL:g} m"
        return ""

    def reset(self) -> None:
        """Forgets what the policy remembers; the goal stays."""
        self._driver = _Driver(self._policy, self._briefing)

    def sent(self, twist: Twist) -> None:
        """Takes note of what the base is sent."""
        self._driver.sent(twist)

    def decide(self, odometry: Odometry, view: View) -> Decision:
        """Returns the policy's twist, or that the goal is reached."""
        assert self.goal is not None
        dx, dy = self.goal.x - odometry.x, self.goal.y - odometry.y
        self.distance = math.hypot(dx, dy)
        turn = 0.0 if math.isnan(self.goal.heading) else wrapped(self.goal.heading - odometry.heading)
        if self.distance <= self._tolerance and abs(turn) <= self._turned:
            return Decision(Twist(), arrived=True)
        c, s = math.cos(odometry.heading), math.sin(odometry.heading)
        seen = goal_reaching.Observation(
            pose=np.array([odometry.x, odometry.y, wrapped(odometry.heading)]),
            twist=_of_axes(self._robot, odometry.twist)[0],
            goal=np.array([c * dx + s * dy, c * dy - s * dx]),
            goal_heading_error=np.array(turn),
            waypoints_left=np.array(0.0),
            ranges=view.ranges,
        )
        # to float32 and back, as policies are shown it everywhere else
        return Decision(self._driver.twist(self._layout.pack(seen)[None].astype(np.float64)))


class AlongPath:
    """Drives along a path by a policy that follows one; what it observes is measured as in our worlds.

    Args:
        file: a table or JSON file of points in odometry's frame, as `--path` of other commands takes it.

    Raises:
        ValueError: if the policy cannot drive the robot so, or the file has no path.
        OSError: if the file cannot be opened.
    """

    def __init__(self, policy: Policy, robot: Robot, file: str | None = None) -> None:
        self._policy, self._robot = policy, robot
        self._env: Any = None
        self.distance = math.nan  # m, that is left of the path
        if file is not None:
            self.take(self.course(file))

    @property
    def lacks(self) -> str:
        """Returns "no path" until there is one."""
        return "" if self._env is not None else "no path"

    def rehearse(self) -> None:
        """Decides once for nothing, at the path's start: what is to be compiled is, before anything moves."""
        result = self._env
        if result is None:
            self.take(self.course_of(np.array([[0.0, 0.0], [1.0, 0.0]])))
        state = self._env.batch.states[0]
        here = Odometry(0.0, "", float(state["x"]), float(state["y"]), float(state["heading"]))
        self.decide(here, View(np.empty(0), np.empty((0, 2)), False))
        self._env = result
        self.reset()

    def course(self, scenario: str | PathScenario) -> Any:
        """Returns the world of a path, or of a file's, for `take`; another thread may make it."""
        env_id = TASKS["path_following"].env_id(self._robot)
        options: dict[str, Any] = {"robot": self._robot, "actuators": "lagged", "disable_env_checker": True}
        made = gymnasium.make(env_id, scenario=scenario, **options)
        made.reset(seed=0)
        self._policy.reset(self._brief(made.unwrapped))  # what a law thinks over once a path, it does before `take`
        return made.unwrapped

    def course_of(self, points: NDArray[np.float64]) -> Any:
        """Returns the world of a path of points (n, 2), m, for `take`; ValueError, in a line, where there is none."""
        far = np.flatnonzero(~(np.abs(points) <= FARTHEST).all(axis=1))
        if len(far):
            raise ValueError(f"point {far[0]}, {points[far[0]].tolist()}, is not finite or beyond {FARTHEST:g} m")
        retained, closed, _ = closing(points, None)
        return self.course(PathScenario("path", Path(retained, closed)))

    def take(self, course: Any) -> None:
        """Drives along a course from now on."""
        self._env = course
        self._results = Results(course.task, 1)
        self.reset()

    def reset(self) -> None:
        """Forgets how far it is along the path, and what the policy remembers."""
        if self._env is None:
            return
        self._env.reset(seed=0)
        along = self._env.briefing("path")
        self._driver = _Driver(self._policy, self._brief(self._env), along, self._env.task.task_params.preview_spacing)

    def _brief(self, env: Any) -> Briefing:
        briefing: Briefing = env.briefing(self._policy.knows)
        return dataclasses.replace(briefing, action_mode="twist")

    def sent(self, twist: Twist) -> None:
        """Takes note of what the base is sent."""
        if self._env is not None:
            self._driver.sent(twist)

    def decide(self, odometry: Odometry, view: View) -> Decision:
        """Returns the policy's twist; that it has arrived at the path's end, or left its corridor."""
        del view
        batch, task, results = self._env.batch, self._env.task, self._results
        state = batch.states[0]
        state["x"], state["y"], state["heading"] = odometry.x, odometry.y, wrapped(odometry.heading)
        state["vx"], state["vy"], state["yaw_rate"] = odometry.twist.vx, odometry.twist.vy, odometry.twist.yaw_rate
        task.step_rows(
            JUDGE,
            0,
            ALONE,
            task.params,
            batch.states,
            batch.obstacles,
            batch.columns,
            batch.noise,
            batch.skip,
            *task.world,
            results.observations,
            results.numbers,
            results.flags,
        )
        flags = dict(zip(task.flag_names, results.flags[:, 0].tolist(), strict=False))
        numbers = dict(zip(task.info_names, results.numbers[:, 0].tolist(), strict=False))
        finish = float(task.world.courses["finish"][0])
        self.distance = finish - numbers["arc_length"]
        if flags["success"]:
            return Decision(Twist(), arrived=True)
        if flags["left_corridor"]:
            return Decision(
                Twist(), stop=f"{abs(numbers['cross_track_error']):.2f} m off the path: outside its corridor"
            )
        return Decision(self._driver.twist(results.observations.astype(np.float64)))
