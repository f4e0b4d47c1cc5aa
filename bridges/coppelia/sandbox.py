"""The task of a served world: wheel speeds as actions, obstacles, no reward and no end."""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Robot, kinematic_plant, records, robots_with
from wayfield.envs.robots.hulls import hull_clearance
from wayfield.envs.tasks.observation import Field, Layout
from wayfield.envs.tasks.stepping import COMMAND, DRIVE, JUDGE, Outputs, Reset, Robots, Step, Turn, let_obstacles_move
from wayfield.envs.tasks.task import Options, Task
from wayfield.envs.world.geometry import clearance_to, nearest_surface
from wayfield.envs.world.grids import NO_GRIDS
from wayfield.envs.world.movers import go_on
from wayfield.system.compiled import compiled, flattened
from wayfield.system.elementary import sin_cos, wrap_angle

SLIDE_STEP = 0.005  # s, less than in which the fastest base goes its hull's radius
_ROUNDS = 8  # of pushing the hull out of everything; corners need more than one
_ROUNDING = 1e-12  # m

STATE = np.dtype(
    [
        *records.ROBOT_STATE,
        ("rolled_vx", np.float64),  # mean twist of the wheels over the last step
        ("rolled_vy", np.float64),
        ("rolled_yaw_rate", np.float64),
    ],
    align=True,
)

PARAMS = [
    *records.ROBOT_PARAMS,
    # Numba takes a record that is a prefix of another for the same type; the field keeps the two apart
    ("sandbox", np.int64),
]


class Observation(NamedTuple):
    """The true pose; b is any batch shape."""

    pose: NDArray[Any]  # (b, 3) x, y (m), heading (rad), world frame


@compiled
def slide(p, s, robots, i):
    """Moves robot i, whose hull is a disc, for a period along what it touches, without friction: its wheels slip.

    In small steps the pose follows the wheels, and is then pushed out along the normals of all that the hull has
    entered. A disc can always turn.
    """
    obstacles = robots.obstacles
    count = math.ceil(p.dt / SLIDE_STEP)
    h = p.dt / count
    for _ in range(count):
        turn = h * s.rolled_yaw_rate
        sine, cosine = sin_cos(s.heading + 0.5 * turn)
        x = s.x + h * (cosine * s.rolled_vx - sine * s.rolled_vy)
        y = s.y + h * (sine * s.rolled_vx + cosine * s.rolled_vy)
        free = False
        for _ in range(_ROUNDS):
            free = True
            for j in range(s.num_obstacles):
                gap, nx, ny = nearest_surface(obstacles[i, j], x, y)
                # a robot that a client has put into an obstacle may leave it
                excess = min(p.hull_radius + kinematic_plant.SKIN, clearance_to(obstacles[i, j], s.x, s.y)) - gap
                if excess > _ROUNDING:
                    x += excess * nx
                    y += excess * ny
                    free = False
            if free:
                break
        if not free:  # wedged
            x = s.x
            y = s.y
        s.heading = wrap_angle(s.heading + turn)
        sine, cosine = sin_cos(s.heading)
        s.vx = (cosine * (x - s.x) + sine * (y - s.y)) / h
        s.vy = (cosine * (y - s.y) - sine * (x - s.x)) / h
        s.x = x
        s.y = y
    s.yaw_rate = s.rolled_yaw_rate
    s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)


@flattened(compiled)
def step_rows(phases: int, turn: Turn, step: Step, outputs: Outputs) -> int:
    """Runs phases of a step for all robots but those in `skip`; returns -1, for targets are always finite."""
    robots = Robots(step.params, step.states, step.obstacles, step.noise, NO_GRIDS)
    p = step.params[0]
    for i in range(step.states.shape[0]):
        if step.skip[i]:
            continue
        s = step.states[i]
        if phases & COMMAND:
            s.contact = 0
            kinematic_plant.command(p, s, step.actions, i)
            s.rolled_vx, s.rolled_vy, s.rolled_yaw_rate = kinematic_plant.lagging_twist(s, p.lag_mean)
            if p.moving:
                let_obstacles_move(phases, p, s, robots, i)
        if phases & DRIVE and not s.contact:
            x = s.x
            y = s.y
            heading = s.heading
            kinematic_plant.drive(p, s, robots, step.actions, i, 0)
            if s.contact:
                s.x = x
                s.y = y
                s.heading = heading
                slide(p, s, robots, i)
        if phases & JUDGE:
            s.steps += 1
            outputs.out[i, 0] = s.x
            outputs.out[i, 1] = s.y
            outputs.out[i, 2] = s.heading
            outputs.numbers[0, i] = 0.0
            outputs.flags[0, i] = False
    return -1


@flattened(compiled)
def reset_rows(reset: Reset, outputs: Outputs) -> None:
    """Stops the robots in `rows` at their poses, and puts moving obstacles at the start of their patrols."""
    robots = Robots(reset.params, reset.states, reset.obstacles, reset.noise, NO_GRIDS)
    p = reset.params[0]
    for j in range(reset.rows.shape[0]):
        i = reset.rows[j]
        s = reset.states[i]
        records.halt(s)
        s.field = i
        s.rolled_vx = 0.0
        s.rolled_vy = 0.0
        s.rolled_yaw_rate = 0.0
        if p.moving:
            go_on(reset.obstacles, i, s.num_obstacles, 0.0)
        s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)


class Sandbox(Task):
    """A task without judgement: `Batch.actions` are wheel speeds (rad/s).

    Obstacles belong in the batch's own array, up to `max_obstacles`.
    """

    state_dtype = STATE
    info_names = ()
    flag_names = ()
    draws = 0
    step_rows = staticmethod(step_rows)
    reset_rows = staticmethod(reset_rows)

    def __init__(
        self, robot: Robot, dynamics: str, actuators: str, dt: float, max_obstacles: int, moving: bool
    ) -> None:
        options = Options.of(
            robots_with(robot.holonomic),
            robot=robot,
            dynamics=dynamics,
            actuators=actuators,
            action_mode="wheel_speeds",
            noise=0.0,
            pose_source="ground_truth",
            shove=None,
            disturbance="none",
            address=None,
            wheels=None,
        )
        if options.actuators.response is not None:
            raise ValueError(f"robot {robot.name!r} has a delay or a response of its own, which no served world has")
        self.scenarios = (None,)
        self.options = dataclasses.replace(options, dt=dt)
        self.robot = robot
        self.layout = Layout(Observation, (Field("pose", (3,), -np.inf, np.inf),))
        self.beam_angles = np.empty(0)
        self.max_obstacles = max_obstacles
        self.world = ()
        values = self.options.robot_params() | {"max_range": 0.0, "moving": moving, "sandbox": 1}
        self.params = records.record(PARAMS, values)
        if not robot.holonomic:
            # the pseudo-inverse without its rounding: equal wheel speeds drive exactly straight
            (_, right), (_, left) = robot.wheel_positions
            self.params["forward_matrix"][0, 0, :2] = 0.5 * robot.wheel_radii
            self.params["forward_matrix"][0, 2, :2] = np.array([1.0, -1.0]) * robot.wheel_radii / (left - right)

    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns the number of obstacles of each robot."""
        return states["num_obstacles"].copy()

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns the square of 5 m around the robot, as fields of `rendering.Scene`."""
        x, y = float(state["x"]), float(state["y"])
        return {"bounds": (x - 2.5, y - 2.5, x + 2.5, y + 2.5)}

    def briefing_fields(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns no fields: a pilot has no privileged information."""
        del states, knows
        return {}
