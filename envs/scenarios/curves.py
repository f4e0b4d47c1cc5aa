"""Curves turned into paths of evenly spaced points: analytic curves, polylines, cubic splines."""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wayfield.envs.world.geometry import lengths
from wayfield.envs.world.paths import Path
from wayfield.system.elementary import sines
from wayfield.system.linear import solve

SPACING = 0.02  # m, the spacing of the path tables of the source documents


def sampled_evenly(
    curve: Callable[[NDArray[np.float64]], ArrayLike],
    end: float,
    *,
    closed: bool = False,
    spacing: float = SPACING,
) -> Path:
    """Returns points of a curve, evenly spaced in arc length; all of them lie on the curve itself.

    Args:
        curve: maps parameters (k,) to x and y (m), shape (2, k).
        end: the parameter runs from 0 to this; on a closed curve both give the same point.
        closed: whether the path is closed.
        spacing: m, rounded so that a whole number of steps fits.
    """
    fine = np.linspace(0.0, end, 5_001)
    steps = np.diff(np.asarray(curve(fine)), axis=1)
    arc_lengths = np.concatenate([[0.0], np.cumsum(lengths(steps.T))])
    count = max(round(arc_lengths[-1] / spacing), 3)
    parameters = np.interp(np.linspace(0.0, arc_lengths[-1], count + 1), arc_lengths, fine)
    return Path(np.asarray(curve(parameters[:-1] if closed else parameters)).T, closed)


def circle_path(radius: float) -> Path:
    """Returns a circle around the origin, counter-clockwise from (radius, 0); radius in m."""

    def curve(t: NDArray[np.float64]) -> ArrayLike:
        sine, cosine = sines(t)
        return radius * cosine, radius * sine

    return sampled_evenly(curve, 2.0 * np.pi, closed=True)


def sine_path(length: float, wavelength: float) -> Path:
    """Returns y = sin(2 pi x / wavelength) for x from 0 to `length`, all in m."""
    return sampled_evenly(lambda x: (x, sines(2.0 * np.pi * x / wavelength)[0]), length)


def figure_eight_path() -> Path:
    """Returns x = 2 sin t, y = 2 sin t cos t, from the crossing at the origin into the right-hand loop."""

    def curve(t: NDArray[np.float64]) -> ArrayLike:
        sine, cosine = sines(t)
        return 2.0 * sine, 2.0 * sine * cosine

    return sampled_evenly(curve, 2.0 * np.pi, closed=True)


def polyline_path(corners: ArrayLike) -> Path:
    """Returns the open polyline through the corners, shape (n, 2), m; every corner is a point of the path."""
    vertices = np.asarray(corners, np.float64)
    legs = []
    for a, b in itertools.pairwise(vertices):
        count = max(round(float(lengths(b - a)) / SPACING), 1)
        legs.append(np.linspace(a, b, count, endpoint=False))
    return Path(np.vstack([*legs, vertices[-1:]]))


@dataclasses.dataclass(frozen=True)
class CubicSpline:
    """A twice continuously differentiable curve through points, natural at open ends or periodic.

    The second derivatives at the knots solve the usual tridiagonal system; de Boor, A Practical Guide to
    Splines, chapter IV. The parameter is the chord length between the points.
    """

    knots: NDArray[np.float64]  # (n,) parameters, m
    points: NDArray[np.float64]  # (n, 2) m; on a closed spline the last is the first again
    second: NDArray[np.float64]  # (n, 2) second derivatives at the knots, 1/m

    @classmethod
    def through(cls, points: ArrayLike, closed: bool = False) -> "CubicSpline":
        """Returns the spline through points (n, 2), m, n >= 3; a closed one returns to the first, given
        once."""
        p = np.asarray(points, np.float64)
        if closed:
            p = np.vstack([p, p[:1]])
        h = lengths(np.diff(p, axis=0))
        slope = np.diff(p, axis=0) / h[:, None]
        n = len(h)
        matrix = np.eye(n + 1)
        right = np.zeros((n + 1, 2))
        for i in range(
            0 if closed else 1, n
        ):  # at i = 0 the index -1 is the last segment, which ends at the first knot
            before = n - 1 if i == 0 else i - 1
            matrix[i, [before, i, i + 1]] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
            right[i] = 6.0 * (slope[i] - slope[i - 1])
        if closed:
            matrix[n, 0] = -1.0  # the last knot is the first again
        second = solve(matrix, right)
        return cls(np.concatenate([[0.0], np.cumsum(h)]), p, second)

    def __call__(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns x and y (m), shape (2, k), at the parameters t (k,)."""
        i, h, a, b = self._segments(t)
        # products: a power has other bits on another processor
        bend = (a * a * a - a) * self.second[i] + (b * b * b - b) * self.second[i + 1]
        return (a * self.points[i] + b * self.points[i + 1] + bend * (h * h) / 6.0).T

    def curvature(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the signed curvature (1/m), shape (k,), at the parameters t (k,)."""
        i, h, a, b = self._segments(t)
        turn = (3.0 * b**2 - 1.0) * self.second[i + 1] - (3.0 * a**2 - 1.0) * self.second[i]
        dx, dy = ((self.points[i + 1] - self.points[i]) / h + turn * h / 6.0).T
        ddx, ddy = (a * self.second[i] + b * self.second[i + 1]).T
        curvature: NDArray[np.float64] = (dx * ddy - dy * ddx) / lengths(np.stack([dx, dy], axis=-1)) ** 3
        return curvature

    def _segments(
        self, t: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Returns segment indices (k,), their lengths (k, 1), and the weights (k, 1) of their first and last
        knot."""
        i = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)
        h = self.knots[i + 1] - self.knots[i]
        b = (t - self.knots[i]) / h
        return i, h[:, None], 1.0 - b[:, None], b[:, None]
