"""A way out of dead ends for seekers that see only their scan: along the obstacle until the goal is nearer than ever."""

import math

from wayfield.envs.compiled import inlined
from wayfield.envs.geometry import bearing, sin_cos, wrap_angle
from wayfield.policies.stopping import free_time

STEP = math.radians(10.0)  # between the directions that are tried
LOOK_BACK = math.radians(150.0)  # where the obstacle that is followed may lie, from the direction of the detour
LOOK_AHEAD = math.radians(20.0)
LOOK = 3.0  # m, how far ahead the sides are compared
COLUMNS = 8  # of a memory: side, direction, nearest, waited, waypoints


@inlined
def first_free(hits, count, start, side, reach):
    """Returns the first direction (rad, body frame) free for `reach` (m), from `start` on to the given side, or NaN."""
    for k in range(36):
        direction = start + side * k * STEP
        sine, cosine = sin_cos(direction)
        if free_time(hits, count, cosine, sine, 0.0, reach) >= reach:
            return direction
    return math.nan


@inlined
def better_side(hits, count, goal_bearing, d, reach):
    """Returns the side on which to pass what is in the way, 0 if neither is free, and the first free direction there.

    Of all directions that are free for `reach` the one counts whose free part promises the shortest way, driven
    straight on and then straight to the goal.
    """
    side = 0.0
    least = math.inf
    ahead = goal_bearing
    for left in range(2):
        sense = 1.0 - 2.0 * left
        first = math.nan
        for k in range(18):
            direction = goal_bearing + sense * k * STEP
            sine, cosine = sin_cos(direction)
            free = free_time(hits, count, cosine, sine, 0.0, LOOK)
            if free < reach:
                continue
            if math.isnan(first):
                first = direction
            along = math.cos(k * STEP) * free
            way = free + math.sqrt(max(d * d + free * free - 2.0 * d * along, 0.0))
            if way < least - 1e-6:
                least = way
                side = sense
                ahead = first
    return side, ahead


@inlined
def seek(hits, count, poses, goal_bearing, d, waypoints_left, patience, reach, first_leg, dt, memory, i, k):
    """Returns the direction (rad, body frame) to steer for and whether it leads around something.

    memory[i, k:] holds the side (+1 the robot turns left, -1 right, 0 no detour), the direction in the world frame, the
    least distance to the goal so far, how long ago it last fell, and the waypoints left.
    """
    heading = poses[i, 2]
    if memory[i, k + 4] != waypoints_left:
        memory[i, k] = 0.0
        memory[i, k + 2] = math.inf
        memory[i, k + 4] = waypoints_left
    if memory[i, k] == 0.0:
        memory[i, k + 3] += dt
        if d < memory[i, k + 2] - 0.05:
            memory[i, k + 2] = d
            memory[i, k + 3] = 0.0
        if memory[i, k + 3] <= patience:
            return goal_bearing, False
        side, ahead = better_side(hits, count, goal_bearing, d, min(reach, d))
        if side == 0.0:
            return goal_bearing, False
        memory[i, k] = side
        memory[i, k + 1] = heading + ahead
        memory[i, k + 5] = poses[i, 0]
        memory[i, k + 6] = poses[i, 1]
        memory[i, k + 7] = first_leg
        memory[i, k + 3] = 0.0
    elif d < memory[i, k + 2] - 0.1:
        sine, cosine = sin_cos(goal_bearing)
        ahead = min(reach, d)
        if free_time(hits, count, cosine, sine, 0.0, ahead) >= ahead:
            memory[i, k] = 0.0
            memory[i, k + 2] = d
            memory[i, k + 3] = 0.0
            return goal_bearing, False
    if (poses[i, 0] - memory[i, k + 5]) ** 2 + (poses[i, 1] - memory[i, k + 6]) ** 2 > memory[i, k + 7] ** 2:
        # nothing there: twice as far to the other side
        memory[i, k] *= -1.0
        memory[i, k + 1] += math.pi
        memory[i, k + 7] *= 2.0
    side = memory[i, k]
    along = memory[i, k + 1] - heading
    # the obstacle that is followed is the nearest on its side
    nearest = math.inf
    start = 0.0
    for j in range(count):
        away = hits[j, 0] * hits[j, 0] + hits[j, 1] * hits[j, 1]
        if away < nearest:
            back = wrap_angle(side * (along - bearing(hits[j, 1], hits[j, 0])))
            if -LOOK_AHEAD <= back <= LOOK_BACK:
                nearest = away
                start = -side * back
    ahead = first_free(hits, count, along + start, side, reach) if nearest < math.inf else math.nan
    if math.isnan(ahead):
        return wrap_angle(along), True
    memory[i, k + 1] = wrap_angle(heading + ahead)
    return wrap_angle(ahead), True
