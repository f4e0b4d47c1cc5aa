"""A way out of dead ends for seekers that see only their scan: along the obstacle until the goal is nearer."""

import math

import numpy as np

from wayfield.envs.compiled import inlined
from wayfield.envs.geometry import bearing, sin_cos, wrap_angle
from wayfield.policies.stopping import free_time

# Columns of a seeker's memory.
SIDE = 0  # +1: it turns left and keeps the obstacle on its right; -1: the other way round; 0: no detour
COURSE = 1  # rad, world frame, of the detour
NEAREST = 2  # m, to the goal, so far
WAITED = 3  # s, since that last fell
WAYPOINTS = 4  # left when the robot was last asked; NaN before
START = 5  # x, y (m, world frame) where the detour began
LEG = 7  # m, how far from there it leads before the other side is tried
COLUMNS = 8

STEP = math.radians(10.0)  # between the directions that are tried
LOOK = 3.0  # m, how far ahead the two sides are compared
BACK = math.radians(150.0)  # the obstacle that is followed lies from this far behind the course, on its side,
AHEAD = math.radians(20.0)  # to this far on the other
WORTH = 0.05  # m, of approach that counts as such


@inlined
def seek(hits, count, poses, goal_bearing, d, waypoints_left, patience, reach, first_leg, dt, memory, i, k):
    """Returns the direction (rad, body frame) to steer for and whether it is a detour; updates memory[i, k:].

    The direction is that of the goal, `d` (m) away, until the robot has not come nearer to it for `patience` (s). It is
    then the first direction, from the obstacle on, that is free for `reach` (m): the robot follows the obstacle until
    it is nearer to the goal than before and sees the way free, the leaving condition of the Bug algorithms. The side is
    the one that promises the shorter way; where `first_leg` (m) from the start of the detour has not ended it, the
    other side is tried twice as far, and so on. An infinite patience makes no detours.
    """
    heading = poses[i, 2]
    if memory[i, k + WAYPOINTS] != waypoints_left:
        memory[i, k + WAYPOINTS] = waypoints_left
        memory[i, k + SIDE] = 0.0
        memory[i, k + NEAREST] = math.inf
        memory[i, k + WAITED] = 0.0
    if memory[i, k + SIDE] == 0.0:
        memory[i, k + WAITED] += dt
        if d < memory[i, k + NEAREST] - WORTH:
            memory[i, k + NEAREST] = d
            memory[i, k + WAITED] = 0.0
        if memory[i, k + WAITED] <= patience:
            return goal_bearing, False
        side, course = better_side(hits, count, goal_bearing, d, min(reach, d))
        if side == 0.0:
            return goal_bearing, False
        memory[i, k + SIDE] = side
        memory[i, k + COURSE] = heading + course
        memory[i, k + START] = poses[i, 0]
        memory[i, k + START + 1] = poses[i, 1]
        memory[i, k + LEG] = first_leg
    elif d < memory[i, k + NEAREST] - 2.0 * WORTH:
        sine, cosine = sin_cos(goal_bearing)
        if free_time(hits, count, cosine, sine, 0.0, min(reach, d)) >= min(reach, d):
            memory[i, k + SIDE] = 0.0
            memory[i, k + NEAREST] = d
            memory[i, k + WAITED] = 0.0
            return goal_bearing, False
    dx = poses[i, 0] - memory[i, k + START]
    dy = poses[i, 1] - memory[i, k + START + 1]
    if dx * dx + dy * dy > memory[i, k + LEG] ** 2:
        memory[i, k + SIDE] *= -1.0
        memory[i, k + COURSE] += math.pi
        memory[i, k + LEG] *= 2.0
    side = memory[i, k + SIDE]
    course = wrap_angle(memory[i, k + COURSE] - heading)
    # the obstacle that is followed is the nearest on its side
    nearest = math.inf
    start = 0.0
    for j in range(count):
        away = hits[j, 0] * hits[j, 0] + hits[j, 1] * hits[j, 1]
        if away < nearest:
            back = wrap_angle(side * (course - bearing(hits[j, 1], hits[j, 0])))
            if -AHEAD <= back <= BACK:
                nearest = away
                start = course - side * back
    for n in range(36 if nearest < math.inf else 0):
        sine, cosine = sin_cos(start + side * n * STEP)
        if free_time(hits, count, cosine, sine, 0.0, reach) >= reach:
            course = wrap_angle(start + side * n * STEP)
            break
    memory[i, k + COURSE] = wrap_angle(heading + course)
    return course, True


@inlined
def better_side(hits, count, goal_bearing, d, reach):
    """Returns the side on which to pass what is in the way, 0 if neither is free, and the first free direction there.

    The robot turns to the side where it sees the direction that promises the shortest way: as far as the scan sees
    along it, and then straight to the goal. A gap that is seen at a slant counts, narrow as it looks.
    """
    open_for = np.full(36, LOOK)
    for j in range(count):
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
            if math.isnan(first) and free_time(hits, count, cosine, sine, 0.0, reach) >= reach:
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
