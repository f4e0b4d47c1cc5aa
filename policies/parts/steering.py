"""What a law drives by as bundles of arrays, and the twist that a base can drive."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.robots import Robot
from wayfield.envs.tasks.briefing import Briefing
from wayfield.system.compiled import inlined
from wayfield.system.elementary import bearings

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """What b path followers observe of themselves."""

    poses: Array  # (b, 3) m, rad
    twists: Array  # (b, t) m/s and rad/s
    arc_lengths: Array  # (b,) m, of the projection on the path

    @classmethod
    def of(cls, observation: path_following.Observation) -> "Motion":
        """Returns the fields of an observation."""
        return cls(observation.pose, observation.twist, observation.arc_length)


class Map(NamedTuple):
    """The map and the goals of a briefing together, as compiled laws take them."""

    obstacles: NDArray[np.void]
    counts: NDArray[np.int64]  # of the obstacles
    goals: Array
    num_goals: NDArray[np.int64]
    frames: NDArray[np.void]  # of the grids
    cells: NDArray[np.uint8]

    @classmethod
    def of(cls, briefing: Briefing) -> "Map":
        """Returns the map of a briefing that has it."""
        assert briefing.goal is not None
        assert briefing.map is not None
        obstacles, counts, frames, cells = briefing.map
        return cls(obstacles, counts, *briefing.goal, frames, cells)


@inlined
def widest_turn(plant, v):
    """Returns the yaw rate (rad/s) that is left, to either side, when wheels that turn at their limit drive v (m/s)."""
    most = plant.turn_speed
    for k in range(plant.num_wheels):
        left = plant.wheel_speed_limit - abs(plant.wheel_matrix[k, 0] * v)
        most = min(most, left / abs(plant.wheel_matrix[k, 2]))
    return max(most, 0.0)


@inlined
def driven_by_point(p, vx, vy):
    """Returns what a velocity (m/s, body frame) of the point `ahead` of the axle is driven by: speed and yaw rate.

    Feedback linearisation; the speed falls with a yaw rate above `max_yaw_rate`. With `ahead` 0, of an omni base, it is
    the velocity itself.
    """
    if p.ahead == 0.0:
        return vx, vy
    yaw_rate = vy / p.ahead
    factor = min(1.0, p.max_yaw_rate / max(abs(yaw_rate), 1e-12))
    return factor * vx, factor * yaw_rate


def point_ahead(law: Any, briefing: Briefing) -> dict[str, float]:
    """Returns what `driven_by_point` reads beside a law's gains, and the reach of the scan."""
    robot = briefing.robot
    return {
        "ahead": 0.0 if robot.holonomic else law.ahead,
        "max_yaw_rate": float(robot.max_twist[-1]),
        "max_range": briefing.max_range,
    }


def unicycle_twists(robot: Robot, speed: Array, yaw_rate: Array) -> Array:
    """Returns the twists (b, t) of a law that drives forward and turns; an omni base is driven the same way.

    Args:
        speed: (b,) m/s.
        yaw_rate: (b,) rad/s.
    """
    twists = np.zeros((len(speed), 3 if robot.holonomic else 2))
    twists[:, 0] = speed
    twists[:, -1] = yaw_rate
    return twists


def velocity_twists(robot: Robot, velocity: Array, turn: Array, turn_gain: float) -> Array:
    """Returns the twists (b, t) of a law that asks for a planar velocity.

    An omni base drives it as it is and turns by `turn`. A differential drive cannot go sideways: it turns towards the
    velocity with yaw rate turn_gain * error and drives forward with the part of it that lies ahead, v = |u| max(cos
    error, 0), so that it turns on the spot while the velocity points behind it.

    Args:
        velocity: (b, 2) wanted velocity u in the body frame, m/s.
        turn: (b,) rad by which an omni base shall turn; a differential drive has no say in it.
        turn_gain: 1/s.
    """
    if robot.holonomic:
        return np.column_stack([velocity, turn_gain * turn])
    speed = np.sqrt(velocity[:, 0] * velocity[:, 0] + velocity[:, 1] * velocity[:, 1])
    error = bearings(velocity[:, 1], velocity[:, 0])
    error[speed < 1e-9] = 0.0
    return np.column_stack([np.maximum(velocity[:, 0], 0.0), turn_gain * error])
