"""The end of a way to a pose: whether a robot counts as there, and how it turns on the spot to the heading."""

import math

from wayfield.system.compiled import inlined


@inlined
def is_there(was_there, px, py, radius):
    """Returns whether a robot counts as at a place (px, py) in its frame, m: within a radius, once there within two.

    A place at most two radii away that is no longer ahead is reached as well: on the way on it would only recede.
    """
    r = math.sqrt(px * px + py * py)
    return r <= 2.0 * radius and (was_there or r <= radius or px <= 0.0)


@inlined
def turn_rate(p, turn):
    """Returns the yaw rate (rad/s) that takes a turn (rad) off: min(turn_gain e, sqrt(2 yaw_acceleration e), max).

    p: a record with turn_gain (1/s), yaw_acceleration (rad/s^2) and max_yaw_rate (rad/s).
    """
    error = abs(turn)
    rate = min(p.turn_gain * error, math.sqrt(2.0 * p.yaw_acceleration * error), p.max_yaw_rate)
    return math.copysign(rate, turn)
