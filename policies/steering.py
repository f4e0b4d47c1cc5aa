"""From what a law asks for to the twist a base can drive: one place for both kinds of robot."""

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Robot

Array = NDArray[np.float64]


def unicycle_twists(robot: Robot, speed: Array, yaw_rate: Array) -> Array:
    """Returns the twists (b, t) of a law that drives forward and turns; an omni base is driven the same way.

    Args:
        speed: (b,) m/s.
        yaw_rate: (b,) rad/s.
    """
    if robot.holonomic:
        return np.column_stack([speed, np.zeros_like(speed), yaw_rate])
    return np.column_stack([speed, yaw_rate])


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
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    error = np.arctan2(velocity[:, 1], velocity[:, 0])
    error[speed < 1e-9] = 0.0
    return np.column_stack([np.maximum(velocity[:, 0], 0.0), turn_gain * error])
