"""The end of a way to a pose: whether a robot counts as there, and how it turns on the spot to the heading."""

import math
from typing import Any

from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.stopping import rest_radius
from wayfield.system.compiled import inlined


def stay_radius(arrival_radius: float, briefing: Briefing) -> Any:
    """Returns how far from its goal (m) each robot may stay: twice `arrival_radius`, or less where the goal asks."""
    return rest_radius(2.0 * arrival_radius, briefing.position_tolerance)


def gentle(law: Any, briefing: Briefing) -> dict[str, float]:
    """Returns the deceleration of a law, at most half of what the base can, and its yaw acceleration, at most all."""
    return {
        "deceleration": min(law.deceleration, 0.5 * briefing.actuators.acceleration),
        "yaw_acceleration": min(law.yaw_acceleration, briefing.actuators.yaw_acceleration),
    }


@inlined
def is_there(was_there, px, py, radius, stay):
    """Returns whether a robot counts as at a place (px, py) in its frame, m: within both radii, once there in `stay`.

    A place within `stay` that is no longer ahead is reached as well: on the way on it would only recede.
    """
    r = math.sqrt(px * px + py * py)
    return r <= stay and (was_there or r <= radius or px <= 0.0)


@inlined
def turn_rate(p, turn):
    """Returns the yaw rate (rad/s) that takes a turn (rad) off: min(turn_gain e, sqrt(2 yaw_acceleration e), max).

    p: a record with turn_gain (1/s), yaw_acceleration (rad/s^2) and max_yaw_rate (rad/s).
    """
    error = abs(turn)
    rate = min(p.turn_gain * error, math.sqrt(2.0 * p.yaw_acceleration * error), p.max_yaw_rate)
    return math.copysign(rate, turn)
