"""Where on its path a robot looks: the point at a distance from it, the pose at a distance along the path.

Scalar functions of one robot, shared by the policies that pursue a point. They start at the robot's own projection and
only ever look ahead of it along the path, so that a path may cross itself. Beyond its end an open path goes straight
on: a carrot that stopped there would end up under the robot, where the direction to it means nothing.
"""

import math

import numpy as np

from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.world.paths import along_lap, segment_at, vertex, walk_to
from wayfield.system.compiled import inlined


@inlined
def place_on_lap(vertices, run, s):
    """Returns (along, segment): arc length s, which counts over laps, inside its lap (m), and the segment there."""
    if run.closed:
        s = max(s - math.floor(s / run.length) * run.length, 0.0)
    return s, segment_at(vertices, run, s)


@inlined
def leg_that_leaves(vertices, run, s, segment):
    """Returns (segment, along): where the path goes on from arc length s of a segment, and how far on there (m) s lies.

    At a corner that is the segment that leaves it, also where a lap ends and the next one begins.
    """
    beyond = vertex(vertices, run, segment + 1).s - along_lap(vertices, run, s, segment)
    if beyond < 1e-9:
        if segment + 1 < run.segments:
            segment += 1
        elif run.closed:
            return 0, 0.0
    return segment, along_lap(vertices, run, s, segment) - vertex(vertices, run, segment).s


@inlined
def distance_left(run, along):
    """Returns the arc length (m) to the end of an open path; infinity on a closed one."""
    return np.inf if run.closed else max(run.length - along, 0.0)


@inlined
def stopping_speed(distance, deceleration):
    """Returns the speed (m/s) from which a constant deceleration (m/s^2) comes to rest within the distance (m)."""
    return math.sqrt(2.0 * deceleration * distance)


@inlined
def point_at_distance(vertices, run, x, y, along, segment, distance, window):
    """Returns the first path point (m) ahead that lies `distance` from (x, y), exactly on the polyline.

    It is where the path, followed from the robot's projection, first leaves the circle around the robot. A robot that
    is farther than that from its path gets its projection; a path that curls up inside the circle gives the point
    `window` ahead.

    Args:
        along, segment: the robot's projection, as `place_on_lap` returns it.
        distance: m.
        window: m of arc length, searched ahead of the projection.
    """
    a = vertex(vertices, run, segment)
    t = along - a.s
    dx = a.x + t * a.ux - x
    dy = a.y + t * a.uy - y
    if dx * dx + dy * dy >= distance * distance:
        return x + dx, y + dy
    # a way that stays inside the circle for a whole lap stays inside: what is left of the window is then under a lap
    for passed in range(2 * run.segments + 2):
        if passed == run.segments and window >= run.length:
            window -= math.floor(window / run.length) * run.length
        # from the point at t, which is inside the circle: the exit is the larger root, and there is one
        ahead = dx * a.ux + dy * a.uy
        leave = math.sqrt(max(ahead * ahead + distance * distance - dx * dx - dy * dy, 0.0)) - ahead
        last = segment == run.segments - 1
        room = np.inf if last and not run.closed else vertex(vertices, run, segment + 1).s - a.s - t
        if min(leave, window) <= room:
            go = min(leave, window)
            return x + dx + go * a.ux, y + dy + go * a.uy
        window -= room
        segment = 0 if last else segment + 1
        a = vertex(vertices, run, segment)
        t = 0.0
        dx = a.x - x
        dy = a.y - y
    return x + dx, y + dy


@inlined
def pose_ahead(vertices, run, along, segment, distance):
    """Returns (x, y, heading) of the path (m, rad) at an arc length of `distance` ahead of the projection."""
    ahead = along + distance
    if run.closed and ahead >= run.length:
        ahead = max(ahead - math.floor(ahead / run.length) * run.length, 0.0)
        segment = 0
    x, y, _, segment = walk_to(vertices, run, ahead, segment)
    tangent = vertex(vertices, run, segment)
    beyond = 0.0 if run.closed else max(ahead - run.length, 0.0)
    return x + beyond * tangent.ux, y + beyond * tangent.uy, tangent.heading


@inlined
def pursuit_curvature(x, y, sine, cosine, px, py):
    """Returns (curvature, px, py): of the arc that leaves the pose along its heading and meets (px, py), 2 y / d^2 in
    1/m with + to the left and 0 where the point lies under the robot; and the point in the body frame, m.

    Args:
        x, y, sine, cosine: position (m) and heading of the robot.
        px, py: the point, m.
    """
    px, py = to_body_frame(x, y, sine, cosine, px, py)
    squared = px * px + py * py
    return 2.0 * py / squared if squared > 1e-12 else 0.0, px, py
