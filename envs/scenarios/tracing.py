"""Curves turned into evenly spaced points, to the same bits on every machine.

The mathematics library and the order of sums differ between machines; these use +, -, *, / and square roots, one after
the other, and the sine of `geometry`.
"""

import math

import numpy as np

from wayfield.system.compiled import allocating
from wayfield.system.elementary import sin_cos


@allocating
def arc(pieces, step):
    """Returns x and y (m), shape (2, k), of a curve from the origin along x, given by its curvature.

    Args:
        pieces: (n, 3): length (m) and the curvature (1/m) at either end, in between in proportion to the arc length.
        step: m, of the integration, by the midpoint rule; each piece has a whole number of steps.
    """
    count = 0
    for i in range(pieces.shape[0]):
        count += max(round(pieces[i, 0] / step), 1)
    points = np.zeros((2, count + 1))
    heading = 0.0
    k = 0
    for i in range(pieces.shape[0]):
        length, first, last = pieces[i, 0], pieces[i, 1], pieces[i, 2]
        n = max(round(length / step), 1)
        h = length / n
        slope = (last - first) / length
        for j in range(n):
            s = (j + 0.5) * h
            sine, cosine = sin_cos(heading + s * (first + 0.5 * slope * s))
            points[0, k + 1] = points[0, k] + h * cosine
            points[1, k + 1] = points[1, k] + h * sine
            k += 1
        heading += 0.5 * (first + last) * length
    return points


@allocating
def lengths(points):
    """Returns the arc lengths (k,) of a polyline (2, k)."""
    along = np.zeros(points.shape[1])
    for i in range(1, points.shape[1]):
        dx = points[0, i] - points[0, i - 1]
        dy = points[1, i] - points[1, i - 1]
        along[i] = along[i - 1] + math.sqrt(dx * dx + dy * dy)
    return along


@allocating
def evenly(points, spacing, x, y, heading, side):
    """Returns points (n, 2) along a fine polyline (2, k), evenly spaced, placed in the world and rounded to 1e-6 m.

    Args:
        points: first one at the place that goes to (x, y).
        spacing: m, rounded so that a whole number of steps fits.
        heading: rad, that the polyline is turned by.
        side: -1 to mirror it first, else 1.
    """
    along = lengths(points)
    count = max(round(along[-1] / spacing), 3)
    step = along[-1] / count
    sine, cosine = sin_cos(heading)
    even = np.empty((count + 1, 2))
    i = 0
    last = along.shape[0] - 2
    for j in range(count + 1):
        s = j * step if j < count else along[-1]
        while i < last and along[i + 1] < s:
            i += 1
        t = (s - along[i]) / (along[i + 1] - along[i])
        u = points[0, i] + t * (points[0, i + 1] - points[0, i]) - points[0, 0]
        v = side * (points[1, i] + t * (points[1, i + 1] - points[1, i]) - points[1, 0])
        even[j, 0] = math.floor((x + cosine * u - sine * v) * 1e6 + 0.5) / 1e6
        even[j, 1] = math.floor((y + sine * u + cosine * v) * 1e6 + 0.5) / 1e6
    return even


@allocating
def sharpness(points, closed, window):
    """Returns the largest change of direction of a path within `window` (m), over the window: rad/m.

    The curvature (1/m) of the tightest bend of that length; a corner has its angle over the window.
    """
    n = points.shape[0]
    segments = n if closed else n - 1
    turned = np.zeros(2 * segments)  # direction less that of the first segment, two laps
    at = np.zeros(2 * segments)  # of the middles of the segments
    for i in range(1, 2 * segments):
        a, b, c = (i - 1) % n, i % n, (i + 1) % n
        ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        vx, vy = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1]
        turned[i] = turned[i - 1] + math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
        at[i] = at[i - 1] + 0.5 * (math.sqrt(ux * ux + uy * uy) + math.sqrt(vx * vx + vy * vy))
    most = 0.0
    first = 0
    for i in range(2 * segments if closed else segments):
        while at[i] - at[first] > window * (1.0 + 1e-6):
            first += 1
        for j in range(first, i):
            most = max(most, abs(turned[i] - turned[j]))
    return most / window
