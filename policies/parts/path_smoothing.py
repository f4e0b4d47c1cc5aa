"""A path without its wiggles: what laws drive that take the path's heading at its word.

A plan on a grid climbs in stairs, a recorded track trembles, two plans put together share a point but for a rounding:
the path turns one way and, a step later, as much the other. Its tangent there is that of a step and not the way it
leads. Here two such turns take each other off, corners that follow each other closely are rounded, and all else stays
as it is, bit for bit: curves, corners between long legs, hairpins.
"""

import math
import weakref
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.tasks.briefing import Course
from wayfield.envs.world.paths import Path, PathPool
from wayfield.policies.parts.steering import Motion
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos

Array = NDArray[np.float64]

NEAR = 0.01  # m, within which points are one
STEP = 0.3  # m, between two opposite corners that take each other off, at most
ASIDE = 0.07  # m, by which they may lie beside what is driven then: half of the diagonal of a cell of 0.1 m
BEND = 4.0  # 1/m, of a curve: a point where the path turns no more than such a curve in a segment is no corner
LEAST = 0.3  # rad, that a corner turns by where the segments are long
BACK = 3.0  # rad, a turn by more than which is one to either side: the path goes back
EASE = 3.0  # of the distance of two such corners, on either side of them, over which the path is led to their middle
ROUNDS = 30  # in which wiggles of wiggles go, at most

CLOSE = 1.4  # m, between corners, or a corner and an end, from which on a corner is left as sharp as it is
CUT = 0.02  # m, by which a corner is cut where the next one is nearer than half of that
NEAR_END = 0.3  # m, from an end of the path, within which it is cut by up to twice as much: the cell of a goal
SHARP = 2.2  # rad, a turn by more than which is made on the spot
PIECES = 8  # of a corner that is cut

TAIL = 0.05  # m, of either end of a path, that is led straight on where it steps back or aside
ASTRAY = 1.4  # rad, from the path's heading beside it, beyond which it does


class Smoothed(NamedTuple):
    """Paths without wiggles, and where on them a place of the paths as they are lies."""

    course: Course
    given: Array  # (vertices,) m, arc length along the path as it is
    laps: Array  # (runs,) m, of a lap of the path as it is


_courses: dict[tuple[int, bool], Smoothed | None] = {}


def smoothed(course: Course | None, motion: Motion, ends_only: bool = False) -> tuple[Course, Motion]:
    """Returns the paths without wiggles and the robots' places on them; paths without any come back as they are.

    Two corners that follow each other within STEP and turn to opposite sides, by a and b, become one at the place
    between them that they draw with the weights a and b, so that what the one turns less than the other stays where
    that is. The path is led there from EASE times their distance before, and back. A row of such corners does so
    together, and again until no two are left: stairs become the line through the middles of their steps.

    What corners remain nearer than CLOSE to another, to an end or to where laps begin are cut, by no more than CUT, or
    twice that at an end, as `rounded` says.

    At an open path's ends a step back, as planners make it that add the exact start and goal, would turn the robot
    around: the first and last TAIL go straight on instead.

    Args:
        ends_only: leave the wiggles, and the start; for a law that rounds its path itself.
    """
    assert course is not None
    key = id(course.vertices), ends_only
    if key not in _courses:
        _courses[key] = _smoothed(course, ends_only)
        weakref.finalize(course.vertices, _courses.pop, key, None)
    result = _courses[key]
    if result is None:
        return course, motion
    course = result.course._replace(path_index=course.path_index)
    return course, motion._replace(arc_lengths=places(*course, result.given, result.laps, motion.arc_lengths))


def _smoothed(course: Course, ends_only: bool) -> Smoothed | None:
    paths, given = [], []
    changed = False
    for run in course.runs:
        vertices = course.vertices[run["first"] : run["first"] + run["segments"] + 1]
        points = np.column_stack([vertices["x"], vertices["y"], vertices["s"]])
        smooth = smooth_points(points, bool(run["closed"]), ends_only)
        changed = changed or len(smooth) != len(points) or bool((smooth != points).any())
        paths.append(Path(smooth[:-1, :2] if run["closed"] else smooth[:, :2], bool(run["closed"])))
        given.append(smooth[:, 2])
    if not changed:
        return None
    return Smoothed(Course.of(PathPool.of(paths), course.path_index), np.concatenate(given), course.runs["length"])


@any_layout
@allocating
def smooth_points(points, closed, ends_only):
    """Returns the points (n, 3) of `smoothed`, x, y and arc length along the path as it is (m), of such points."""
    smooth = points if closed else straight_end(points)
    if not ends_only:
        smooth = rounded(without_wiggles(smooth))
        if not closed:
            smooth = straight_start(smooth)
    return points if closed and smooth.shape[0] < 4 else smooth


@allocating
def places(vertices, runs, path_index, given, laps, arc_lengths):
    """Returns the arc lengths (b,) along smoothed paths at those along the paths as they are, m, over laps."""
    arcs = np.empty(path_index.shape[0])
    for i in range(arcs.shape[0]):
        run = runs[path_index[i]]
        length = laps[path_index[i]]
        lap = math.floor(arc_lengths[i] / length) if run.closed else 0.0
        s = arc_lengths[i] - lap * length
        low = run.first
        high = run.first + run.segments - 1
        while low < high:
            middle = (low + high + 1) // 2
            if given[middle] <= s:
                low = middle
            else:
                high = middle - 1
        stretch = (vertices[low + 1].s - vertices[low].s) / (given[low + 1] - given[low])
        # nothing is added where nothing has changed, not even a rounding
        shift = vertices[low].s - given[low] + (s - given[low]) * (stretch - 1.0)
        arcs[i] = arc_lengths[i] + lap * (run.length - length) + shift
    return arcs


@allocating
def straight_end(points):
    """Returns the points with the last TAIL of the path led straight on, where it does not go on itself."""
    last = points.shape[0] - 1
    k = last - 1
    while k > 0 and points[last, 2] - points[k, 2] <= TAIL:
        k -= 1
    ux = points[k + 1, 0] - points[k, 0]
    uy = points[k + 1, 1] - points[k, 1]
    for j in range(k + 1, last):
        vx = points[j + 1, 0] - points[j, 0]
        vy = points[j + 1, 1] - points[j, 1]
        if abs(bearing(ux * vy - uy * vx, ux * vx + uy * vy)) > ASTRAY:
            straight = points[: k + 2].copy()
            stretch = (points[last, 2] - points[k, 2]) / (points[k + 1, 2] - points[k, 2])
            straight[k + 1, 0] = points[k, 0] + stretch * ux
            straight[k + 1, 1] = points[k, 1] + stretch * uy
            straight[k + 1, 2] = points[last, 2]
            return straight
    return points


@allocating
def straight_start(points):
    """Returns the points with the first TAIL of the path as `straight_end` has the last one of the path backwards."""
    backwards = points[::-1].copy()
    backwards[:, 2] = points[-1, 2] - backwards[:, 2]
    straight = straight_end(backwards)
    if straight.shape[0] == points.shape[0]:
        return points
    result = straight[::-1].copy()
    result[:, 2] = points[-1, 2] - result[:, 2]
    return result


@allocating
def without_wiggles(points):
    """Returns the points (n, 3) of `smoothed`, x, y and arc length along the path as it is (m), of such points."""
    for _ in range(ROUNDS):
        points = thinned(points, corners(points))
        turns = corners(points)
        out = np.empty((3 * points.shape[0], 3))
        count = cancel(points, turns, opposites(points, turns), out)
        if count == 0:
            break
        points = out[:count].copy()
    return points


@allocating
def corners(points):
    """Returns by how much the path turns at each point, rad, + to the left; 0 at the ends and where it is no corner."""
    turns = np.zeros(points.shape[0])
    for i in range(1, points.shape[0] - 1):
        ax = points[i, 0] - points[i - 1, 0]
        ay = points[i, 1] - points[i - 1, 1]
        bx = points[i + 1, 0] - points[i, 0]
        by = points[i + 1, 1] - points[i, 1]
        turn = bearing(ax * by - ay * bx, ax * bx + ay * by)
        shorter = math.sqrt(min(ax * ax + ay * ay, bx * bx + by * by))
        if abs(turn) > min(BEND * shorter, LEAST):
            turns[i] = turn
    return turns


@allocating
def thinned(points, turns):
    """Returns the points without those nearer than NEAR to another, of two the sharper corner; the ends stay."""
    last = points.shape[0] - 1
    out = np.empty_like(points)
    sharpness = 0.0
    count = 0
    for i in range(last + 1):
        if count > 0 and apart(points[i], out[count - 1]) < NEAR:
            # in place of the one before, if that leaves no gap of more than two
            leaves_gap = count == 1 or apart(points[i], out[count - 2]) >= 2.0 * NEAR
            if i < last and (leaves_gap or abs(turns[i]) <= sharpness):
                continue
            count = max(count - 1, 1)
        out[count] = points[i]
        sharpness = abs(turns[i])
        count += 1
    return out[:count].copy()


@compiled
def cancel(points, turns, nexts, out):
    """Fills `out` with the points after every row of wiggles has gone; returns how many, 0 if none was there."""
    n = points.shape[0]
    count = 0
    fixed = 0  # of those in `out`, corners and what is before them
    any_pair = False
    i = 0
    while i < n:
        j = nexts[i]
        if j == 0:
            count = put(out, count, points[i, 0], points[i, 1], points[i, 2])
            if turns[i] != 0.0:
                fixed = count
            i += 1
            continue
        any_pair = True
        count = lead_in(points, i, EASE * apart(points[i], points[j]), out, fixed, count)
        ease = 0.0
        while j > 0:
            ease = EASE * apart(points[i], points[j])
            share = abs(turns[j]) / (abs(turns[i]) + abs(turns[j]))
            count = put_between(points[i], points[j], share, out, count)
            i = j
            j = nexts[i]
        fixed = count
        count, i = lead_out(points, turns, i, ease, out, count)
    return count if any_pair else 0


@allocating
def rounded(points):
    """Returns the points with parabolas in place of corners that follow each other closely.

    Such corners are a planner's, and no truer than its cells or steps; driven to the millimetre, each takes a stop.
    """
    turns = corners(points)
    out = np.empty(((PIECES + 2) * points.shape[0], 3))
    last = points.shape[0] - 1
    count = 0
    fixed = 0
    before = 0
    i = 0
    while i <= last:
        turn = abs(turns[i])
        if turn == 0.0:
            count = put(out, count, points[i, 0], points[i, 1], points[i, 2])
            i += 1
            continue
        to_end = min(points[i, 2] - points[0, 2], points[last, 2] - points[i, 2])
        leg = min(points[i, 2] - points[before, 2], points[next_corner(turns, i), 2] - points[i, 2])
        room = leg * (0.9 if leg == to_end else 0.45)
        cut = CUT * (min(2.0 - 2.0 * leg / CLOSE, 1.0) + max(1.0 - to_end / NEAR_END, 0.0))
        before = i
        if turn < LEAST or turn > SHARP or cut < 1e-3:
            count = put(out, count, points[i, 0], points[i, 1], points[i, 2])
            fixed = count
            i += 1
            continue
        ease = min(2.0 * cut / sin_cos(0.5 * turn)[0], room)
        count = lead_in(points, i, ease, out, fixed, count)
        start = count - 1
        count, j = lead_out(points, turns, i, ease, out, count)
        put_parabola(out, start, points[i])
        count += PIECES - 1
        fixed = count
        i = j
    return out[:count].copy()


@inlined
def put_parabola(out, i, corner):
    """Puts PIECES - 1 points between point i and the next: the parabola whose tangents there meet at the corner."""
    ax, ay, a_s = out[i]
    bx, by, b_s = out[i + 1]
    for k in range(1, PIECES + 1):
        t = k / PIECES
        a = (1.0 - t) * (1.0 - t)
        b = t * t
        c = 2.0 * t * (1.0 - t)
        out[i + k, 0] = a * ax + c * corner[0] + b * bx
        out[i + k, 1] = a * ay + c * corner[1] + b * by
        out[i + k, 2] = a_s + t * (b_s - a_s)


@allocating
def opposites(points, turns):
    """Returns for each point, (n,), which next corner takes it off, 0 if none does."""
    partners = np.zeros(points.shape[0], np.int64)
    before = 0
    i = next_corner(turns, 0)
    while i < points.shape[0] - 1:
        j = next_corner(turns, i)
        if j < points.shape[0] - 1 and points[j, 2] - points[i, 2] < STEP and opposed(turns, i, j):
            span = apart(points[i], points[j])
            after = next_corner(turns, j)
            share = abs(turns[j]) / (abs(turns[i]) + abs(turns[j]))
            room = min(EASE * span, (points[i, 2] - points[before, 2]) * (0.5 if opposed(turns, before, i) else 1.0))
            aside = height(room, share * span, turns[i])
            room = min(EASE * span, (points[after, 2] - points[j, 2]) * (0.5 if opposed(turns, j, after) else 1.0))
            if max(aside, height(room, (1.0 - share) * span, turns[j])) <= ASIDE:
                partners[i] = j
        before = i
        i = j
    return partners


@inlined
def next_corner(turns, i):
    """Returns the index of the next corner after point i, or of the last point."""
    i += 1
    while i < turns.shape[0] - 1 and turns[i] == 0.0:
        i += 1
    return i


@inlined
def opposed(turns, i, j):
    """Returns whether the path turns to one side at point i and to the other at j."""
    return turns[i] * turns[j] < 0.0 or (turns[i] * turns[j] > 0.0 and max(abs(turns[i]), abs(turns[j])) > BACK)


@inlined
def height(a, b, turn):
    """Returns how far (m) a corner lies from the line between the points a before it and b behind it (m)."""
    sine, cosine = sin_cos(turn)
    return a * b * abs(sine) / max(math.sqrt(a * a + b * b + 2.0 * a * b * cosine), 1e-12)


@inlined
def lead_in(points, i, ease, out, fixed, count):
    """Ends the `count` points put so far `ease` (m) before point i, or at the last corner; returns their number."""
    start = points[i, 2] - ease
    x = points[i, 0]
    y = points[i, 1]
    s = points[i, 2]
    while count > max(fixed, 1) and out[count - 1, 2] > start:
        count -= 1
        x, y, s = out[count]
    last = out[count - 1]
    if last[2] < start:
        share = (start - last[2]) / (s - last[2])
        count = put(out, count, last[0] + share * (x - last[0]), last[1] + share * (y - last[1]), start)
    return count


@inlined
def lead_out(points, turns, i, ease, out, count):
    """Puts the point `ease` (m) behind point i, if no corner lies before; returns how many there are, and the next."""
    end = points[i, 2] + ease
    j = i + 1
    while j < points.shape[0] - 1 and turns[j] == 0.0 and points[j, 2] <= end:
        j += 1
    if points[j, 2] > end:
        share = (end - points[j - 1, 2]) / (points[j, 2] - points[j - 1, 2])
        count = put_between(points[j - 1], points[j], share, out, count)
    return count, j


@compiled
def put_between(a, b, share, out, count):
    """Puts the point that divides the way from a to b; returns how many there are."""
    return put(out, count, *(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])))


@compiled
def put(out, count, x, y, s):
    """Puts a point behind the others, but where the last one is; returns how many there are."""
    if count > 0 and out[count - 1, 0] == x and out[count - 1, 1] == y:
        return count
    out[count, 0] = x
    out[count, 1] = y
    out[count, 2] = s
    return count + 1


@inlined
def apart(a, b):
    """Returns how far apart two points are, m."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2)
