"""The law that ends a goal seeker's way: on to the goal, and to its heading."""

import math
from typing import NamedTuple

from wayfield.policies.parts.arriving import is_there, turn_rate
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import bearing

ASIDE = 0.3  # rad, of a goal, beyond which a differential drive turns before it drives on to it


class TurnLaw(NamedTuple):
    """What `arriving.turn_rate` reads."""

    turn_gain: float  # 1/s
    yaw_acceleration: float  # rad/s^2
    max_yaw_rate: float  # rad/s


@any_layout
@compiled
def arrive(goals, turns, waypoints_left, scales, twists):
    """Replaces the twists (b, t) of robots within scales[0] of their goal; see `GoalFeatures.arrived`.

    v = min(scales[1], scales[2] d) towards the goal, which a differential drive first turns to; where `is_there` says
    so within scales[3], the base turns to the goal's heading, a holonomic one on the way.
    """
    reach, most, gain, near, turn_gain, yaw_acceleration, max_yaw_rate = scales
    law = TurnLaw(turn_gain, yaw_acceleration, max_yaw_rate)
    last = twists.shape[1] - 1
    for i in range(twists.shape[0]):
        x = goals[i, 0]
        y = goals[i, 1]
        distance = math.sqrt(x * x + y * y)
        if waypoints_left[i] > 0.5 or distance > reach:
            continue
        v = min(most, gain * distance)
        if last == 2:
            share = v / max(distance, 1e-9)
            twists[i, 0] = share * x
            twists[i, 1] = share * y
            twists[i, 2] = turn_rate(law, turns[i])
        elif is_there(False, x, y, near, 2.0 * near):
            twists[i, 0] = 0.0
            twists[i, 1] = turn_rate(law, turns[i])
        else:
            aside = bearing(y, x)
            twists[i, 0] = v if abs(aside) < ASIDE else 0.0
            twists[i, 1] = turn_rate(law, aside)
