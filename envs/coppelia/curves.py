"""Paths as CoppeliaSim makes them from control points: rounded by quadratic Bezier arcs, then spaced evenly.

A path is a table of rows whose columns have types: 0 a number, 1 an angle, 2 one of the four of a quaternion.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float64]

POSE_TYPES = (0, 0, 0, 2, 2, 2, 2)
MIN_STRENGTH = 0.05  # of rounding
_END = 1e-8  # m, what is left of the way at its end: the last point belongs to the last segment

# The axes that point along the path and up, by orientation mode.
_ORIENTATIONS = {0: "xy", 1: "xz", 2: "yx", 3: "yz", 4: "zx", 5: "zy"}


def lengths_of(rows: Table, dimensions: int = 3) -> Table:
    """Returns the length (n,) of the way to each row (n, d), measured in its first columns."""
    steps = np.diff(rows[:, :dimensions], axis=0)
    return np.concatenate([[0.0], np.cumsum(np.sqrt((steps**2).sum(axis=1)))])


def mixed(a: Table, b: Table, share: Table, types: Sequence[int]) -> Table:
    """Returns the rows (n, d) that lie a share (n,) of the way from a to b: angles and turns the shorter way."""
    result = a + share[:, None] * (b - a)
    column = 0
    while column < len(types):
        if types[column] == 1:
            turn = np.remainder(b[:, column] - a[:, column] + math.pi, 2.0 * math.pi) - math.pi
            result[:, column] = a[:, column] + share * turn
        if types[column] == 2:
            four = slice(column, column + 4)
            result[:, four] = _slerped(a[:, four], b[:, four], share)
            column += 3
        column += 1
    return result


def _slerped(a: Table, b: Table, share: Table) -> Table:
    dot = (a * b).sum(axis=1)
    b = np.where(dot[:, None] < 0.0, -b, b)
    dot = np.minimum(np.abs(dot), 1.0)
    angle = np.arccos(dot)
    sine = np.sin(angle)
    far = sine > 1e-6
    safe = np.where(far, sine, 1.0)
    u = np.where(far, np.sin((1.0 - share) * angle) / safe, 1.0 - share)
    v = np.where(far, np.sin(share * angle) / safe, share)
    result = u[:, None] * a + v[:, None] * b
    size = np.sqrt((result**2).sum(axis=1, keepdims=True))
    return np.asarray(result / np.where(size > 0.0, size, 1.0))


def interpolated(
    rows: Table, lengths: Table, at: Table, types: Sequence[int], strength: float = 0.0, closed: bool = False
) -> Table:
    """Returns the rows (m, d) at lengths `at` (m,) along a path of rows (n, d), n >= 2.

    Args:
        lengths: of the way to each row, ascending.
        strength: of the rounding, at most 1: the share of a segment that arcs take, half at each end; 0 is none.
        closed: whether the last row repeats the first, so that the corner there is rounded too.
    """
    end = lengths[-1]
    at = np.clip(at, 0.0, end)
    if strength > 0.0:
        at = np.where(at >= end, max(end - _END, 0.0), at)
    low = np.clip(np.searchsorted(lengths, at, side="right") - 1, 0, len(rows) - 2)
    span = lengths[low + 1] - lengths[low]
    u = np.divide(at - lengths[low], span, out=np.zeros_like(at), where=span > 0.0)
    u = np.minimum(u, 1.0)
    here, there = rows[low], rows[low + 1]
    result = mixed(here, there, u, types)
    if strength <= 0.0:
        return result
    w = min(max(strength, MIN_STRENGTH), 1.0)
    last = len(rows) - 1
    into = (u < 0.5 * w) & (closed | (low > 0))
    before = rows[np.where(low > 0, low - 1, last - 1)]
    a = mixed(before, here, 1.0 - 0.25 * w + 0.5 * u, types)
    b = mixed(here, there, 0.25 * w + 0.5 * u, types)
    result = np.where(into[:, None], mixed(a, b, 0.5 + u / w, types), result)
    out = (u > 1.0 - 0.5 * w) & ~into & (closed | (low + 1 < last))
    s = u - (1.0 - 0.5 * w)
    after = rows[np.where(low + 1 < last, np.minimum(low + 2, last), 1)]
    a = mixed(here, there, 1.0 - 0.5 * w + 0.5 * s, types)
    b = mixed(there, after, 0.5 * s, types)
    return np.where(out[:, None], mixed(a, b, s / w, types), result)


def path_rows(points: Table, closed: bool, subdivision: int, smoothness: float) -> Table:
    """Returns the rows (subdivision, 7) of a path through control points (n, 7), evenly spaced.

    Args:
        closed: joins the last point to the first; the last row then repeats the first.
        smoothness: the strength of the rounding, 0 to 1.
    """
    if closed:
        points = np.vstack([points, points[:1]])
    if smoothness > 0.0:
        lengths = lengths_of(points)
        fine = np.linspace(0.0, lengths[-1], 2 * subdivision)
        points = interpolated(points, lengths, fine, POSE_TYPES, smoothness, closed)
    lengths = lengths_of(points)
    rows = interpolated(points, lengths, np.linspace(0.0, lengths[-1], subdivision), POSE_TYPES)
    if closed:
        rows[-1] = rows[0]
    return rows


def oriented(rows: Table, closed: bool, mode: int, up: Sequence[float]) -> Table:
    """Returns rows (n, 7) whose quaternions have one axis along the path and another as near to `up` as it can be."""
    from wayfield.envs.coppelia.frames import pose_from_matrix

    result = rows.copy()
    first, second = ("xyz".index(axis) for axis in _ORIENTATIONS[mode])
    third = 3 - first - second
    count = len(rows)
    upward = np.asarray(up, np.float64)
    for i in range(count):
        ahead = rows[(i + 1) % count if i + 1 < count else (1 if closed else i)][:3]
        behind = rows[i if i + 1 < count or closed else i - 1][:3]
        along = ahead - behind
        size = np.linalg.norm(along)
        if size < 1e-12:
            continue
        along = along / size
        aside = np.cross(upward, along)
        if np.linalg.norm(aside) < 1e-9:
            aside = np.cross((1.0, 0.0, 0.0) if abs(along[0]) < 0.9 else (0.0, 1.0, 0.0), along)
        aside /= np.linalg.norm(aside)
        columns = np.zeros((3, 3))
        columns[:, first] = along
        columns[:, second] = np.cross(along, aside)
        # right-handed whichever two axes were named
        columns[:, third] = np.cross(columns[:, (third + 1) % 3], columns[:, (third + 2) % 3])
        matrix = np.column_stack([columns, rows[i, :3]])
        result[i, 3:] = pose_from_matrix(matrix.ravel().tolist())[3:]
    return result


def nearest_length(points: Table, lengths: Table, point: Sequence[float]) -> float:
    """Returns the length of the way to the point of a polyline (n, 3) that is nearest to a point."""
    starts, steps = points[:-1], np.diff(points, axis=0)
    squares = (steps**2).sum(axis=1)
    offsets = np.asarray(point, np.float64) - starts
    along = np.divide((offsets * steps).sum(axis=1), squares, out=np.zeros(len(squares)), where=squares > 0.0)
    along = np.clip(along, 0.0, 1.0)
    distances = ((offsets - along[:, None] * steps) ** 2).sum(axis=1)
    nearest = int(distances.argmin())
    return float(lengths[nearest] + along[nearest] * (lengths[nearest + 1] - lengths[nearest]))


def config_distance(a: Table, b: Table, metric: Sequence[float], types: Sequence[int]) -> float:
    """Returns the distance of two rows (d,): the root of the sum of squares, each column's weighed by its metric."""
    total = 0.0
    column = 0
    while column < len(types):
        step = float(b[column] - a[column])
        if types[column] == 1:
            step = math.remainder(step, 2.0 * math.pi)
        if types[column] == 2:
            dot = abs(float((a[column : column + 4] * b[column : column + 4]).sum()))
            step = 2.0 * math.acos(min(dot, 1.0))
        total += (step * metric[column]) ** 2
        column += 4 if types[column] == 2 else 1
    return math.sqrt(total)
