"""A way out of dead ends for seekers that see only their scan: along the obstacle until the goal is nearer."""

import math

import numpy as np

from wayfield.policies.parts.stopping import free_time
from wayfield.system.compiled import allocating, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

# What a seeker remembers of its detours.
DETOUR = np.dtype(
    [
        ("side", np.float64),  # +1: it turns left and keeps the obstacle on its right; -1: the other way round; 0: none
        ("course", np.float64),  # rad, world frame, of the detour
        ("nearest", np.float64),  # m, to the goal, so far
        ("waited", np.float64),  # s, since that last fell
        ("waypoints", np.float64),  # left when the robot was last asked; NaN before
        ("start", np.float64, (2,)),  # m, world frame, where the detour began
        ("leg", np.float64),  # m, how far from there it leads before the other side is tried
    ],
    align=True,
)

STEP = math.radians(10.0)  # between the directions that are tried
LOOK = 3.0  # m, how far ahead the two sides are compared
BACK = math.radians(150.0)  # the obstacle that is followed lies from this far behind the course, on its side,
AHEAD = math.radians(20.0)  # to this far on the other
WORTH = 0.05  # m, of approach that counts as such


@inlined
def seek(p, hits, seen, m, i):
    """Returns the direction (rad, body frame) to steer for and whether it is a detour; updates the memory's `detour`.

    The direction is that of the goal until the robot has not come nearer to it for `patience` (s). It is then the first
    direction, from the obstacle on, that is free for `reach` (m): the robot follows the obstacle until it is nearer to
    the goal than before and sees the way free, the leaving condition of the Bug algorithms. The side is the one that
    promises the shorter way; where `first_leg` (m) from the start of the detour has not ended it, the other side is
    tried twice as far, and so on. An infinite patience makes no detours.
    """
    goal_x = seen.goals[i, 0]
    goal_y = seen.goals[i, 1]
    goal_bearing = bearing(goal_y, goal_x)
    d = math.sqrt(goal_x * goal_x + goal_y * goal_y)
    heading = seen.poses[i, 2]
    way = m.detour
    if way.waypoints != seen.waypoints_left[i]:
        way.waypoints = seen.waypoints_left[i]
        way.side = 0.0
        way.nearest = math.inf
        way.waited = 0.0
    if way.side == 0.0:
        way.waited += p.plant.dt
        if d < way.nearest - WORTH:
            way.nearest = d
            way.waited = 0.0
        if way.waited <= p.patience:
            return goal_bearing, False
        side, course = better_side(hits, goal_bearing, d, min(p.reach, d))
        if side == 0.0:
            return goal_bearing, False
        way.side = side
        way.course = heading + course
        way.start[0] = seen.poses[i, 0]
        way.start[1] = seen.poses[i, 1]
        way.leg = p.first_leg
    elif d < way.nearest - 2.0 * WORTH:
        sine, cosine = sin_cos(goal_bearing)
        if free_time(hits, cosine, sine, 0.0, min(p.reach, d)) >= min(p.reach, d):
            way.side = 0.0
            way.nearest = d
            way.waited = 0.0
            return goal_bearing, False
    dx = seen.poses[i, 0] - way.start[0]
    dy = seen.poses[i, 1] - way.start[1]
    if dx * dx + dy * dy > way.leg**2:
        way.side *= -1.0
        way.course += math.pi
        way.leg *= 2.0
    course = along_obstacle(hits, way.side, wrap_angle(way.course - heading), p.reach)
    way.course = wrap_angle(heading + course)
    return course, True


@inlined
def along_obstacle(hits, side, course, reach):
    """Returns the first direction (rad, body frame) that is free for `reach` (m), from the obstacle followed on.

    That is the nearest on its side; where nothing is near or nothing is free, the course (rad, body frame) is kept.
    """
    nearest = math.inf
    start = 0.0
    for j in range(hits.shape[0]):
        away = hits[j, 0] * hits[j, 0] + hits[j, 1] * hits[j, 1]
        if away < nearest:
            back = wrap_angle(side * (course - bearing(hits[j, 1], hits[j, 0])))
            if -AHEAD <= back <= BACK:
                nearest = away
                start = course - side * back
    for n in range(36 if nearest < math.inf else 0):
        sine, cosine = sin_cos(start + side * n * STEP)
        if free_time(hits, cosine, sine, 0.0, reach) >= reach:
            return wrap_angle(start + side * n * STEP)
    return course


@allocating
def better_side(hits, goal_bearing, d, reach):
    """Returns the side on which to pass what is in the way, 0 if neither is free, and the first free direction there.

    The robot turns to the side where it sees the direction that promises the shortest way: as far as the scan sees
    along it, and then straight to the goal. A gap that is seen at a slant counts, narrow as it looks.
    """
    open_for = np.full(36, LOOK)
    for j in range(hits.shape[0]):
        n = round(wrap_angle(bearing(hits[j, 1], hits[j, 0]) - goal_bearing) / STEP) % 36
        open_for[n] = min(open_for[n], math.sqrt(hits[j, 0] ** 2 + hits[j, 1] ** 2))
    side = 0.0
    ahead = goal_bearing
    least = math.inf
    for sense in (1, -1):
        first = math.nan
        shortest = math.inf
        for n in range(18):
            sine, cosine = sin_cos(goal_bearing + sense * n * STEP)
            if math.isnan(first) and free_time(hits, cosine, sine, 0.0, reach) >= reach:
                first = goal_bearing + sense * n * STEP
            sine, cosine = sin_cos(n * STEP)
            seen = open_for[(sense * n) % 36]
            shortest = min(shortest, seen + math.sqrt((seen * sine) ** 2 + (d - seen * cosine) ** 2))
        # left, where they are as good
        if not math.isnan(first) and shortest < least - 1e-6:
            side = float(sense)
            ahead = first
            least = shortest
    return side, ahead
