"""Paths of CoppeliaSim: control points, rounded by quadratic Bezier arcs, then spaced evenly.

A path is a table of rows whose columns have types: 0 a number, 1 an angle, 2 one of the four of a quaternion.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float64]

POSE_TYPES = (0, 0, 0, 2, 2, 2, 2)
MIN_STRENGTH = 0.05  # of rounding
_END = 1e-8  # m, before the end of the path: the last point belongs to the last segment


def lengths_of(rows: Rows, dimensions: int = 3) -> Rows:
    """Returns the length (n,) of a path to each of its rows (n, d), measured in the first columns."""
    steps = np.diff(rows[:, :dimensions], axis=0)
    return np.concatenate([[0.0], np.cumsum(np.sqrt((steps**2).sum(axis=1)))])


def mixed(a: Rows, b: Rows, share: Rows, types: Sequence[int]) -> Rows:
    """Returns the interpolation (n, d) from a to b by shares (n,): angles and quaternions on the shorter arc."""
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


def _slerped(a: Rows, b: Rows, share: Rows) -> Rows:
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
    rows: Rows, lengths: Rows, at: Rows, types: Sequence[int], strength: float = 0.0, closed: bool = False
) -> Rows:
    """Returns the rows (m, d) at lengths `at` (m,) along a path of rows (n, d), n >= 2.

    Args:
        lengths: of the path to each row, ascending.
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


def path_rows(points: Rows, closed: bool, subdivision: int, smoothness: float) -> Rows:
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


def nearest_length(points: Rows, lengths: Rows, point: Sequence[float]) -> float:
    """Returns the length of a polyline (n, 3) up to its nearest point to `point`."""
    starts, steps = points[:-1], np.diff(points, axis=0)
    squares = (steps**2).sum(axis=1)
    offsets = np.asarray(point, np.float64) - starts
    along = np.divide((offsets * steps).sum(axis=1), squares, out=np.zeros(len(squares)), where=squares > 0.0)
    along = np.clip(along, 0.0, 1.0)
    distances = ((offsets - along[:, None] * steps) ** 2).sum(axis=1)
    nearest = int(distances.argmin())
    return float(lengths[nearest] + along[nearest] * (lengths[nearest + 1] - lengths[nearest]))


def packed(rows: Rows) -> bytes:
    """Returns rows as the data of a path: little-endian float64."""
    return np.ascontiguousarray(rows, "<f8").tobytes()
