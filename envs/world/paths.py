"""Paths as polylines with arc length: nearest point in a window, point at an arc length.

A path is stored as a run of vertices in a pool that many robots share, so that each robot of a batch can be on a path
of its own, from two points to a million. A closed path carries its first point once more at the end; arc lengths on a
closed path keep counting over the laps.
"""

import dataclasses
import math
from collections.abc import Sized

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wayfield.envs.world.geometry import lengths as lengths_of
from wayfield.system.checks import FINEST, MOST_POINTS, shown
from wayfield.system.compiled import compiled, inlined
from wayfield.system.elementary import bearing, bearings

VERTEX = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),  # m
        ("s", np.float64),  # arc length from the start of the path, m
        ("ux", np.float64),  # unit tangent of the segment that leaves the vertex (of the one that enters the last)
        ("uy", np.float64),
        ("heading", np.float64),  # of the tangent, rad
    ]
)

RUN = np.dtype(
    [
        ("first", np.int64),  # index of the path's first vertex in the pool
        ("segments", np.int64),  # number of segments
        ("closed", np.int64),  # 1 when the last vertex is the first again
        ("length", np.float64),  # m, of one lap
        ("per_metre", np.float64),  # segments a metre of an evenly spaced path, which need no walking; else 0
    ]
)


@dataclasses.dataclass(frozen=True)
class Path:
    """A polyline in the plane.

    Args:
        points: shape (n, 2), metres, n >= 2 (3 when closed), finite, no point equal to the one before it.
        closed: whether the last point is joined to the first; the first point is not repeated.

    Raises:
        ValueError: if the points break one of the conditions above; the message names the row.
    """

    points: NDArray[np.float64]
    closed: bool = False

    def __init__(self, points: ArrayLike, closed: bool = False) -> None:
        if (count := len(points) if isinstance(points, Sized) else 0) > MOST_POINTS:
            raise ValueError(f"path has {count} points; there must be at most {MOST_POINTS}")
        try:
            array = np.array(points, dtype=np.float64)
        except (TypeError, ValueError, OverflowError, RecursionError) as error:
            got = f"{shown(points)}: {error!s:.100}"  # a text in its place may be long
            raise ValueError(f"path points must be numbers of shape (n, 2), got {got}") from None
        if array.ndim != 2 or array.shape[1] != 2:
            raise ValueError(f"path points must have shape (n, 2), got {array.shape}")
        least = 3 if closed else 2
        if len(array) < least:
            kind = "a closed path" if closed else "a path"
            raise ValueError(f"{kind} needs at least {least} points, got {len(array)}")
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if len(bad):
            raise ValueError(f"path point {bad[0]} is {tuple(array[bad[0]].tolist())}; every coordinate must be finite")
        ring = np.vstack([array, array[:1]]) if closed else array
        steps = np.diff(ring, axis=0)
        same = np.flatnonzero(lengths_of(steps) == 0.0)
        if len(same):
            raise ValueError(
                f"path points {same[0]} and {(same[0] + 1) % len(array)} are both {tuple(array[same[0]].tolist())}; "
                "remove the repeated point"
            )
        array.setflags(write=False)
        object.__setattr__(self, "points", array)
        object.__setattr__(self, "closed", bool(closed))

    @property
    def vertices(self) -> NDArray[np.void]:
        """Returns the VERTEX records, shape (n,) or (n + 1,) when closed."""
        ring = np.vstack([self.points, self.points[:1]]) if self.closed else self.points
        steps = np.diff(ring, axis=0)
        lengths = lengths_of(steps)
        tangents = steps / lengths[:, None]
        vertices = np.empty(len(ring), VERTEX)
        vertices["x"], vertices["y"] = ring.T
        vertices["s"] = np.concatenate([[0.0], np.cumsum(lengths)])
        vertices["ux"], vertices["uy"] = np.vstack([tangents, tangents[-1:]]).T
        vertices["heading"] = bearings(vertices["uy"], vertices["ux"])
        return vertices

    @property
    def length(self) -> float:
        """Returns the arc length of one lap, m."""
        return float(self.vertices["s"][-1])

    @property
    def start_pose(self) -> tuple[float, float, float]:
        """Returns (x, y, heading) of the first point, looking along the path."""
        (x0, y0), (x1, y1) = self.points[:2].tolist()
        return x0, y0, bearing(y1 - y0, x1 - x0)


SPAN = 0.5  # m, before and behind a place, between which the path leads somewhere
MOST_BACK = 0.02  # of a path's length, that leads the other way before it counts as a track with noise
FORGIVEN = 0.05  # m, of a path's end, that need not be driven
SHORTEST = 0.2  # m, of a path: a robot is wider
HOLE = 20.0  # times the ten steps around it, a step is as long that a recording missed
STRAIGHT_BACK = math.cos(2.88)  # between the ways that lead to a place and on, beyond which it is the same way


def doubt(path: Path) -> str:
    """Returns what makes a path one that robots may not follow to its end, and what to do; "" where nothing does."""
    points = np.vstack([path.points, path.points[:1]]) if path.closed else path.points
    steps = np.diff(points, axis=0)
    lengths = lengths_of(steps)
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    if s[-1] < SHORTEST:
        return f"is only {s[-1]:.2g} m long, which robots may not drive to its end; coordinates are in metres"

    def at(where: NDArray[np.float64]) -> NDArray[np.float64]:
        where = np.clip(where, 0.0, s[-1])
        return np.column_stack([np.interp(where, s, points[:, 0]), np.interp(where, s, points[:, 1])])

    middle = 0.5 * (s[1:] + s[:-1])
    leads = at(middle + SPAN) - at(middle - SPAN)
    away = ((steps * leads).sum(axis=1) < 0.0) & (path.closed or middle < s[-1] - 0.5 * SPAN)
    back = float(lengths[away].sum() / s[-1])
    if back > MOST_BACK:
        return (
            f"goes back and forth over {back:.0%} of its length, as a track recorded with noise does; "
            "smooth it, or keep one point every 0.1 m"
        )
    if not path.closed:
        before, start = at(s[-1] - SPAN * np.array([1.0, 0.5]))
        last = s >= s[-1] - 0.5 * SPAN
        along = (points[last] - start) @ (start - before) / max(float(lengths_of(start - before)), FINEST)
        after = float(s[-1] - s[last][along.argmax()])
        if after > FORGIVEN and along.max() - along[-1] > 0.3 * after:
            return (
                f"turns back {after:.2g} m before its end; robots that do not reverse may not get there: "
                "leave the last points out"
            )
    for k in np.flatnonzero(lengths > max(1.0, HOLE * float(np.median(lengths)))).tolist():
        around = np.delete(lengths[max(k - 5, 0) : k + 6], min(k, 5))
        beside = [k - 1, (k + 1) % len(steps)]
        straight = steps[beside] @ steps[k] > math.cos(0.1) * lengths[beside] * lengths[k]
        if len(around) == 10 and HOLE * around.max() < lengths[k] and not straight.any():
            return f"has a hole of {lengths[k]:.3g} m, {s[k]:.3g} m from its start, which is driven straight across"
    # at a wiggle the path goes on as before, and the tip of a hairpin may have some width
    came, goes = points - at(s - SPAN), at(s + SPAN) - points
    facing = (came * goes).sum(axis=1) < STRAIGHT_BACK * lengths_of(came) * lengths_of(goes)
    turns = s[facing & (lengths_of(goes) > FORGIVEN)]
    if len(turns):
        return (
            f"turns straight back {turns[0]:.2g} m from its start; robots that do not turn on the spot may leave it: "
            "make it two paths, or leave the points before out"
        )
    return ""


@dataclasses.dataclass(frozen=True)
class PathPool:
    """Many paths behind one another: `vertices` (VERTEX records of all paths) and `runs` (one RUN record a path)."""

    vertices: NDArray[np.void]
    runs: NDArray[np.void]

    @classmethod
    def of(cls, paths: list[Path]) -> "PathPool":
        """Returns the pool that holds the paths in the given order."""
        pieces = [path.vertices for path in paths]
        runs = np.empty(len(paths), RUN)
        runs["first"] = np.cumsum([0, *map(len, pieces[:-1])])
        runs["segments"] = [len(piece) - 1 for piece in pieces]
        runs["closed"] = [path.closed for path in paths]
        runs["length"] = [piece["s"][-1] for piece in pieces]
        runs["per_metre"] = [_segments_per_metre(piece["s"]) for piece in pieces]
        return cls(np.concatenate(pieces), runs)


@inlined
def vertex(vertices, run, i):
    """Returns vertex i of a path, from 0 to run.segments: every caller counts or clips there.

    An unsigned index needs no test for negative ones, which costs as much.
    """
    return vertices[np.uint64(run.first + i)]  # unsigned: not asked whether it counts from the end


@compiled
def segment_at(vertices, run, s):
    """Returns the index of the segment that holds arc length s (m, inside one lap), by bisection."""
    low = 0
    high = run.segments - 1
    while low < high:
        middle = (low + high + 1) // 2
        if vertex(vertices, run, middle).s <= s:
            low = middle
        else:
            high = middle - 1
    return low


def _segments_per_metre(s: NDArray[np.float64]) -> float:
    """Returns the density of vertices at arc lengths `s`, or 0 when it would miss a vertex by more than its spacing."""
    even = np.linspace(0.0, s[-1], len(s))
    return float((len(s) - 1) / s[-1]) if np.abs(s - even).max() < even[1] else 0.0


# From this window on the search looks how far it can leap, and leaps when it is worth a bisection.
WIDE = 8.0  # m
LEAP = 1.0  # m

# Segments that the nearest-point search takes or leaves together.
_BLOCK = 4


@inlined
def nearest_ahead(vertices, run, x, y, s, segment, window, bound=np.inf):
    """Returns (s, segment) of the path point nearest to (x, y) with arc length in [s, s + window].

    Exact on the polyline, and the first of equally near points. The distance to the path changes by at most one metre
    per metre of arc length: a block of segments whose middle is too far away to come nearer than the best point so far
    is left out whole.

    Args:
        vertices, run: the pool's vertices and the path's RUN record.
        x, y: the query point, m.
        s: start of the window, m; counts over the laps of a closed path.
        segment: index of the segment that holds `s`.
        window: m; on a closed path at most one lap is searched.
        bound: m, a distance that the nearest point is known to be under; it shortens a long search.
    """
    lap = s - along_lap(vertices, run, s, segment)
    if run.closed:
        window = min(window, run.length)
    end = s + window
    wide = window > WIDE
    turns = 0
    best_squared = bound * bound
    best = bound
    best_s = s
    best_segment = segment
    i = segment
    while True:
        last = min(i + _BLOCK, run.segments)
        middle = vertex(vertices, run, (i + last) // 2)
        dx = x - middle.x
        dy = y - middle.y
        near = best + max(middle.s - vertex(vertices, run, i).s, vertex(vertices, run, last).s - middle.s)
        if dx * dx + dy * dy < near * near:
            for k in range(i, last):
                a = vertex(vertices, run, k)
                start = lap + a.s
                if start > end:
                    break
                dx = x - a.x
                dy = y - a.y
                t = min(max(dx * a.ux + dy * a.uy, s - start, 0.0), vertex(vertices, run, k + 1).s - a.s, end - start)
                ex = dx - t * a.ux
                ey = dy - t * a.uy
                squared = ex * ex + ey * ey
                if squared < best_squared:
                    best_squared = squared
                    best_s = max(start + t, s)  # at the window's start t is s - start, and the sum may fall short
                    best_segment = k
            best = math.sqrt(best_squared)
        elif wide:
            # a long search goes on where the path can be near again at the earliest
            clear = middle.s + math.sqrt(dx * dx + dy * dy) - best
            if clear >= run.length:
                last = run.segments
            elif clear > vertex(vertices, run, last).s + LEAP:
                last = segment_at(vertices, run, clear)
        i = last
        if i == run.segments:
            # a window of one lap gets to the path's start once, or twice by rounding
            turns += 1
            if not run.closed or turns > 2:
                return best_s, best_segment
            i = 0
            lap += run.length
        if lap + vertex(vertices, run, i).s > end:
            return best_s, best_segment


@inlined
def along_lap(vertices, run, s, segment):
    """Returns the arc length (m) inside the lap whose segment holds s; s counts over the laps of a closed path."""
    if not run.closed or s < run.length:
        return s
    lap = math.floor(s / run.length) * run.length
    # s may sit a rounding error outside the lap that its segment belongs to
    if segment == 0 and s - lap > 0.5 * run.length:
        lap += run.length
    elif s - lap <= vertex(vertices, run, segment).s - 0.5 * run.length:
        lap -= run.length
    return s - lap


@inlined
def walk_to(vertices, run, s, segment):
    """Returns (x, y, s, segment) of the path at arc length s >= that of the segment, walking forward from there.

    s counts from the start of the lap that holds the segment, and comes back counted from the start of its own lap,
    however many laps on that is. Beyond the end of an open path the answer is the end point.
    """
    if s >= run.length:
        if not run.closed:
            end = vertex(vertices, run, run.segments)
            return end.x, end.y, s, run.segments - 1
        # without a branch, here and below: with one the loop over a preview takes half as long again
        s -= run.length
        s = max(s - math.floor(s / run.length) * run.length, 0.0)
        segment = 0
    if run.per_metre > 0.0:
        # clipped as a whole number: s is inside the lap here, and what is no number gives 0 on every processor
        segment = max(min(int(s * run.per_metre), run.segments - 1), 0)
    while segment > 0 and vertex(vertices, run, segment).s > s:
        segment -= 1
    while segment < run.segments - 1 and vertex(vertices, run, segment + 1).s < s:
        segment += 1
    a = vertex(vertices, run, segment)
    return a.x + (s - a.s) * a.ux, a.y + (s - a.s) * a.uy, s, segment
