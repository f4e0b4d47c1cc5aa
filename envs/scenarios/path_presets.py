"""The named path-following scenarios: the courses of document A, and a random family."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from wayfield.envs.scenarios.curves import (
    CubicSpline,
    circle_path,
    figure_eight_path,
    polyline_path,
    sampled_evenly,
    sine_path,
)
from wayfield.envs.scenarios.scenario import PathScenario
from wayfield.envs.world.paths import Path
from wayfield.system.elementary import sines

BANK_SIZE = 64  # scenarios of a random family
_SEED = 20_240_601  # fixed, so that a name means the same paths in every process
_MAX_CURVATURE = 2.0  # 1/m, what a differential drive rounds without slowing to a crawl
_LENGTHS = (8.0, 20.0)  # m
_SPACING = 0.04  # m, twice that of the documents: a bank of many paths should stay in the processor's cache

_ZIGZAG_LEG = 2.0  # m
_ZIGZAG_CORNERS = [
    (_ZIGZAG_LEG * 0.5 * i, _ZIGZAG_LEG * math.sqrt(0.75) * (i % 2)) for i in range(7)
]  # every interior angle is that of an equilateral triangle


def random_splines() -> tuple[PathScenario, ...]:
    """Returns 64 smooth random paths, open and closed in turn, 8 to 20 m long, curvature at most 2 1/m."""
    rng = np.random.default_rng(_SEED)
    scenarios: list[PathScenario] = []
    while len(scenarios) < BANK_SIZE:
        closed = len(scenarios) % 2 == 1
        path = _random_spline(rng, closed)
        if path is not None:
            name = f"random_splines_{len(scenarios)}"
            scenarios.append(PathScenario(name, path, start_offset=0.1, start_turn=0.3, corridor=0.5))
    return tuple(scenarios)


def _random_spline(rng: np.random.Generator, closed: bool) -> Path | None:
    """Returns a random smooth path, or None when the draw is too long, too short or too sharp."""
    if closed:
        # control points at growing bearings around the origin: a ring that does not cross itself
        count = int(rng.integers(5, 9))
        bearings = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.25, 0.25, count)) / count
        radii = rng.uniform(1.2, 2.8, count)
        points = (radii * sines(bearings)[::-1]).T
    else:
        # legs within 70 degrees of one direction: the path wanders but does not come back on itself
        count = int(rng.integers(4, 10))
        headings = rng.uniform(-np.pi, np.pi) + np.radians(rng.uniform(-70.0, 70.0, count))
        legs = rng.uniform(1.2, 2.5, count)
        steps = (legs * sines(headings)[::-1]).T
        points = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    spline = CubicSpline.through(points, closed)
    end = float(spline.knots[-1])
    if np.abs(spline.curvature(np.linspace(0.0, end, 1000))).max() > 0.98 * _MAX_CURVATURE:
        return None
    path = sampled_evenly(spline, end, closed=closed, spacing=_SPACING)
    return path if _LENGTHS[0] <= path.length <= _LENGTHS[1] else None


def _one(name: str, path: Callable[[], Path], **settings: object) -> Callable[[], tuple[PathScenario, ...]]:
    """Returns the factory of a bank with a single scenario."""
    return lambda: (PathScenario(name, path(), **settings),)  # type: ignore[arg-type]


def _straight() -> Path:
    return polyline_path([(0.0, 0.0), (12.0, 0.0)])


PATH_SCENARIOS: Mapping[str, Callable[[], tuple[PathScenario, ...]]] = {
    # 12 m along x.
    "straight": _one("straight", _straight),
    # The same line, started 0.3 m to its left: the step response of a tracking law.
    "straight_offset": _one("straight_offset", _straight, start=(0.0, 0.3, 0.0)),
    # A circle of radius 0.5 m, counter-clockwise, for as long as the clock runs.
    "circle_r0.5": _one("circle_r0.5", lambda: circle_path(0.5), laps=0),
    # A circle of radius 1 m.
    "circle": _one("circle", lambda: circle_path(1.0), laps=0),
    # A circle of radius 2 m.
    "circle_r2": _one("circle_r2", lambda: circle_path(2.0), laps=0),
    # Two periods of a sine, amplitude 1 m, wavelength 6 m.
    "s_curve": _one("s_curve", lambda: sine_path(12.0, 6.0)),
    # Four periods of a sine, amplitude 1 m, wavelength 3 m: curvature up to 4.4 1/m.
    "s_curve_tight": _one("s_curve_tight", lambda: sine_path(12.0, 3.0)),
    # Four corners of 90 degrees, legs of 3 m.
    "right_angle": _one("right_angle", lambda: polyline_path([(0, 0), (3, 0), (3, 3), (6, 3), (6, 0), (9, 0)])),
    # Five corners of 120 degrees, legs of 2 m.
    "zigzag": _one("zigzag", lambda: polyline_path(_ZIGZAG_CORNERS)),
    # A lemniscate that crosses itself at the origin, for as long as the clock runs.
    "figure_eight": _one("figure_eight", figure_eight_path, laps=0),
    # The same, done after one lap.
    "figure_eight_lap": _one("figure_eight_lap", figure_eight_path),
    # 64 smooth random paths, half of them closed; start scattered by 0.1 m and 0.3 rad, corridor 0.5 m.
    "random_splines": random_splines,
}
