"""Curvature of a polyline, and how fast a robot may go along it: what a tracking law reads from the path ahead.

A polyline has no curvature: its heading jumps at every vertex. Here all of them are smoothed alike, over a length h of
the path, `rounding`, whether they belong to a fine curve or to a corner: psi(s) is the direction of the chord from
s - h to s + h, and kappa(s) = (psi(s + h) - psi(s - h)) / 2h. A curve keeps its curvature; a corner turned by the
angle J becomes a bend of length 4h and curvature J / 2h.
"""

import math

from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.paths import segment_at, vertex
from wayfield.system.compiled import compiled, inlined
from wayfield.system.elementary import bearing, wrap_angle


def limits(briefing: Briefing, acceleration: float, lateral_acceleration: float, share: float) -> dict[str, float]:
    """Returns how fast a robot may go, turn, and change either: what `speed_at` reads besides the `speed` wanted.

    What is wanted is cut to a share of what the actuators can do; the rest is left to the feedback.
    """
    most = share * briefing.robot.max_twist
    return {
        "acceleration": min(acceleration, share * briefing.actuators.acceleration),  # m/s^2, along the path
        "lateral_acceleration": lateral_acceleration,  # m/s^2
        "yaw_acceleration": share * briefing.actuators.yaw_acceleration,  # rad/s^2
        "max_speed": float(most[0]),  # m/s, of the base without turning
        "max_yaw_rate": float(most[-1]),  # rad/s, of the base without driving
    }


SPACING = 0.25  # of the rounding, between the places where the profile looks at the curvature
HALF_TURN = 1e-9  # rad, nearer than which to half a turn to the right a turn counts as one to the left
TIP = 0.1  # of the rounding, a chord so short that the path turns back on itself: by more than 174 degrees


@inlined
def point_at(vertices, run, s):
    """Returns (x, y) of the path at arc length s (m); laps count on, an open path goes straight on at both ends."""
    if run.closed:
        s -= math.floor(s / run.length) * run.length
    a = vertex(vertices, run, segment_at(vertices, run, s))
    return a.x + (s - a.s) * a.ux, a.y + (s - a.s) * a.uy


@compiled
def heading_at(vertices, run, s, rounding):
    """Returns psi(s), rad: the direction of the chord of the path from s - rounding to s + rounding.

    At the tip of a path that turns back on itself there is no chord: the way ahead counts.
    """
    x0, y0 = point_at(vertices, run, s - rounding)
    x1, y1 = point_at(vertices, run, s + rounding)
    if math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2) < TIP * rounding:
        x0, y0 = point_at(vertices, run, s)
    return bearing(y1 - y0, x1 - x0)


@compiled
def curvature_at(vertices, run, s, rounding):
    """Returns kappa(s), 1/m, + to the left."""
    before = heading_at(vertices, run, s - rounding, rounding)
    after = heading_at(vertices, run, s + rounding, rounding)
    turn = wrap_angle(after - before)
    # half a turn goes to the left, also where rounding puts it to the right: a place has one curvature
    if turn < HALF_TURN - math.pi:
        turn += 2.0 * math.pi
    return turn / (2.0 * rounding)


@compiled
def reference_at(vertices, run, s, rounding):
    """Returns the point (x, y) at arc length s of the path with its corners rounded.

    The mean of the path over s +- 2h under a triangle has the curvature kappa(s), but it lies inside of a curve, by
    half the triangle's variance times the curvature. The second difference of the path over 2h takes that off again: a
    curve stays where it is, to fourth order in h, and a corner is cut by about h/3 sin(J/2).
    """
    x, y = point_at(vertices, run, s)
    sum_x = 0.0
    sum_y = 0.0
    for k in range(1, 5):
        x0, y0 = point_at(vertices, run, s - 0.5 * k * rounding)
        x1, y1 = point_at(vertices, run, s + 0.5 * k * rounding)
        # at steps of h/2 the triangle weighs 4, 3, 2, 1, 0 sixteenths, of variance 5/8 h^2: (5/8) / 2 / 2^2 = 5/64
        weight = (4 - k) / 16.0 if k < 4 else -5.0 / 64.0
        sum_x += weight * (x0 - x + x1 - x)
        sum_y += weight * (y0 - y + y1 - y)
    return x + sum_x, y + sum_y


@inlined
def highest_speed(limits, curvature, curvature_rate):
    """Returns the highest speed (m/s) that keeps all limits but the acceleration along the path.

    With the yaw rate w = v kappa: v^2 |kappa| <= a_lateral, v^2 |kappa'| <= yaw acceleration, and a base that uses
    the share v / v_max of its wheels for driving has the rest left to turn with, v / v_max + |w| / w_max <= 1.
    """
    kappa = abs(curvature)
    speed = min(limits.speed, 1.0 / (1.0 / limits.max_speed + kappa / limits.max_yaw_rate))
    speed = min(speed, math.sqrt(limits.lateral_acceleration / max(kappa, 1e-9)))
    return min(speed, math.sqrt(limits.yaw_acceleration / max(abs(curvature_rate), 1e-9)))


@compiled
def speed_at(vertices, run, s, rounding, limits):
    """Returns the profile's speed (m/s) at arc length s: v(s)^2 = min over s' of cap(s')^2 + 2 a |s' - s|.

    That is what a forward and a backward pass over the path arrive at: no faster than the cap here, and able to slow
    down by a for every cap ahead, and to speed up by a from every cap behind. An open path ends at rest.
    """
    step = SPACING * rounding
    lowest = limits.speed * limits.speed
    if not run.closed:
        lowest = min(lowest, 2.0 * limits.acceleration * max(run.length - s, 0.0))
    for direction in (1.0, -1.0):
        away = 0.0
        while 2.0 * limits.acceleration * away < lowest:
            at = s + direction * away
            if not run.closed and (at > run.length or at < 0.0):
                break
            before = curvature_at(vertices, run, at - rounding, rounding)
            here = curvature_at(vertices, run, at, rounding)
            after = curvature_at(vertices, run, at + rounding, rounding)
            cap = highest_speed(limits, here, (after - before) / (2.0 * rounding))
            lowest = min(lowest, cap * cap + 2.0 * limits.acceleration * away)
            away += step
    return math.sqrt(lowest)
