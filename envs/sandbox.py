"""A robot whose wheels are told how fast to turn, among obstacles, with nothing asked of it: no observation, no end."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import kinematic_plant, records
from wayfield.envs.compiled import compiled
from wayfield.envs.grids import NO_GRIDS
from wayfield.envs.hulls import hull_clearance
from wayfield.envs.observation import Field, Layout
from wayfield.envs.patrols import PATROL, patrol
from wayfield.envs.robots import Robot, robots_with
from wayfield.envs.stepping import COMMAND, DRIVE, JUDGE, Robots
from wayfield.envs.task import Options, Task

STATE = np.dtype(
    [
        *records.ROBOT_STATE,
        ("rolled_vx", np.float64),  # twist that the wheels turned for on average over the last step
        ("rolled_vy", np.float64),
        ("rolled_yaw_rate", np.float64),
    ],
    align=True,
)

PARAMS = [
    *records.ROBOT_PARAMS,
    # a record that begins another is the same type to Numba, which would run code compiled for this one on a task's
    ("sandbox", np.int64),
]


class Observation(NamedTuple):
    """The true pose; b is any batch shape."""

    pose: NDArray[Any]  # (b, 3) x, y (m), heading (rad), world frame


@compiled
def step_rows(phases, thread, shares, params, states, obstacles, actions, noise, skip, patrols, out, numbers, flags):
    """Runs the asked phases of a step for all robots but those in `skip`; returns -1: targets are always finite."""
    robots = Robots(params, states, obstacles, noise, patrols, NO_GRIDS)
    p = params[0]
    for i in range(states.shape[0]):
        if skip[i]:
            continue
        s = states[i]
        if phases & COMMAND:
            s.contact = 0
            kinematic_plant.command(p, s, actions, i)
            s.rolled_vx, s.rolled_vy, s.rolled_yaw_rate = kinematic_plant.lagging_twist(s, p.lag_mean)
            if patrols.shape[1] > 0:
                patrol(patrols, 0, obstacles, i, s.num_obstacles, (s.steps + 1) * p.dt)
                s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
                if phases & DRIVE and s.clearance < 0.0:
                    # run into where it stands; in a plant with forces it is pushed
                    s.contact = 1
                    s.vx = 0.0
                    s.vy = 0.0
                    s.yaw_rate = 0.0
        if phases & DRIVE and not s.contact:
            kinematic_plant.drive(p, s, robots, i, 0)
        if phases & JUDGE:
            s.steps += 1
            out[i, 0] = s.x
            out[i, 1] = s.y
            out[i, 2] = s.heading
            numbers[0, i] = 0.0
            flags[0, i] = False
    return -1


@compiled
def reset_rows(params, states, obstacles, rows, draws, noise, patrols, out, numbers, flags):
    """Puts the robots in `rows` at rest where they are, and what moves by a script where that begins."""
    robots = Robots(params, states, obstacles, noise, patrols, NO_GRIDS)
    p = params[0]
    for j in range(rows.shape[0]):
        i = rows[j]
        s = states[i]
        records.halt(s)
        s.field = i
        s.rolled_vx = 0.0
        s.rolled_vy = 0.0
        s.rolled_yaw_rate = 0.0
        if patrols.shape[1] > 0:
            patrol(patrols, 0, obstacles, i, s.num_obstacles, 0.0)
        s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)


class Sandbox(Task):
    """The task that asks nothing: a batch of it is one of the plants, and `Batch.actions` are its wheel speeds.

    Obstacles are put into the batch's own array, up to `max_obstacles`; what of them moves by a script, into `patrols`.
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
        )
        self.scenarios = (None,)
        self.options = dataclasses.replace(options, dt=dt)
        self.robot = robot
        self.layout = Layout(Observation, (Field("pose", (3,), -np.inf, np.inf),))
        self.beam_angles = np.empty(0)
        self.max_obstacles = max_obstacles
        self.patrols = np.zeros((1, max_obstacles if moving else 0), PATROL)
        self.world = (self.patrols,)
        self.params = records.record(PARAMS, self.options.robot_params() | {"max_range": 0.0, "sandbox": 1})
        if not robot.holonomic:
            # the pseudo-inverse without its rounding: wheels that turn alike drive exactly straight
            (_, right), (_, left) = robot.wheel_positions
            self.params["forward_matrix"][0, 0, :2] = 0.5 * robot.wheel_radii
            self.params["forward_matrix"][0, 2, :2] = np.array([1.0, -1.0]) * robot.wheel_radii / (left - right)

    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns how many obstacles each robot has around it."""
        return states["num_obstacles"].copy()

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns the square of 5 m around the robot, as fields of `rendering.Scene`."""
        x, y = float(state["x"]), float(state["y"])
        return {"bounds": (x - 2.5, y - 2.5, x + 2.5, y + 2.5)}

    def told(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns nothing: there is nothing to tell."""
        del states, knows
        return {}
