"""The families of random paths: from a seed, a path and where the robot starts beside it.

Every scenario is decided by its seed alone, the start's offset and heading error with it: two policies that meet it
meet the same. All have one lap, and the corridor is 1 m.
"""

import itertools
import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wayfield.envs.scenarios.curves import SPACING
from wayfield.envs.scenarios.draws import Draw, rounded
from wayfield.envs.scenarios.path_presets import PATH_SCENARIOS
from wayfield.envs.scenarios.scenario import PathScenario
from wayfield.envs.scenarios.tracing import arc, evenly, lengths, sharpness
from wayfield.envs.tasks.specs import Family, Repertoire
from wayfield.envs.world.paths import Path
from wayfield.system.elementary import bearing, sin_cos, sines

Points = NDArray[np.float64]  # x and y, shape (2, k), m
Curve = Callable[[Draw], "Points | None"]  # None: drawn in vain, draw again

_FINE = 0.002  # m, between the points that a curve is evaluated at
_LENGTHS = (8.0, 20.0)  # m
_LEAST = 5.0  # m, of a circle
_SMOOTH = 2.0  # 1/m, the largest curvature of splines and circuits
_START_OFFSET = 0.1  # m
_START_TURN = 0.3  # rad
SHARPNESS_WINDOW = 0.3  # m
_LEG_GAP = 0.6  # m, that a polyline keeps from its own earlier legs


def _family(
    name: str,
    about: str,
    curve: Curve,
    *,
    closed: bool = False,
    offset: float = _START_OFFSET,
    turn: float = _START_TURN,
) -> Family:
    """Returns the family of a curve, placed anywhere near the origin and mirrored or not."""

    def scenario(seed: int) -> PathScenario:
        draw = Draw(name, seed)
        points = draw.until_one(lambda: curve(draw))
        x, y, heading, side = draw.number(-2.0, 2.0), draw.number(-2.0, 2.0), draw.heading(), draw.sign()
        even = evenly(points, SPACING, x, y, heading, side)
        path = Path(even[:-1] if closed else even, closed)
        return PathScenario(f"{name}_{seed}", path, start=_beside(path, draw, offset, turn), family=name)

    return Family(name, about, scenario)


def _beside(path: Path, draw: Draw, offset: float, turn: float) -> tuple[float, float, float]:
    """Returns a start pose beside the path's first point, off its heading."""
    (x, y), (x1, y1) = path.points[:2].tolist()
    heading = bearing(y1 - y, x1 - x)
    sine, cosine = sin_cos(heading)
    aside = draw.number(-offset, offset)
    return rounded(x - sine * aside), rounded(y + cosine * aside), rounded(heading + draw.number(-turn, turn))


def _straight(draw: Draw) -> Points:
    return _polyline([(0.0, 0.0), (draw.number(8.0, 16.0), 0.0)])


def _circle(draw: Draw) -> Points:
    radius = draw.number(0.8, 3.0)
    points: Points = arc(np.array([(2.0 * math.pi * radius, 1.0 / radius, 1.0 / radius)]), _FINE)
    return points


def _clothoids(draw: Draw) -> Points | None:
    """Bends of clothoid, arc, clothoid, with straight lines between: the curvature never jumps."""
    pieces = [(draw.number(0.5, 1.5), 0.0, 0.0)]
    while sum(length for length, _, _ in pieces) < _LENGTHS[0]:
        curvature = draw.number(0.6, 2.2)
        angle = math.radians(draw.number(40.0, 160.0))
        ramp = draw.number(0.3, 0.8) * angle / curvature  # m; the two clothoids turn by this times the curvature
        bend = curvature * draw.sign()
        pieces += [(ramp, 0.0, bend), (angle / curvature - ramp, bend, bend), (ramp, bend, 0.0)]
        pieces.append((draw.number(0.3, 1.5), 0.0, 0.0))
    points = arc(np.array(pieces), _FINE)
    return points if _fits(points) and not _returns(points) else None


def _s_curve(low: float, high: float, shortest: float, longest: float) -> Curve:
    """Returns the sines whose largest curvature (1/m) and wavelength (m) lie in these ranges."""

    def curve(draw: Draw) -> Points | None:
        wavelength = draw.number(shortest, longest)
        wave_number = 2.0 * math.pi / wavelength
        amplitude = draw.number(low, high) / (wave_number * wave_number)
        x = np.arange(round(0.5 * draw.whole(3, 8) * wavelength / _FINE) + 1) * _FINE
        points = np.stack([x, amplitude * sines(wave_number * x)[0]])
        return points if _fits(points) else None

    return curve


def _gerono(draw: Draw) -> Points | None:
    """x = a sin t, y = b sin t cos t, from anywhere on it."""
    a = draw.number(1.4, 2.8)
    b = a * draw.number(0.8, 1.3)
    t = draw.heading() + np.arange(8001) * (2.0 * math.pi / 8000)
    sine, cosine = sines(t)
    points = np.stack([a * sine, b * sine * cosine])
    return points if _fits(points) else None


def _tangent_circles(draw: Draw) -> Points | None:
    """One circle to the left, one to the right, from anywhere on the first."""
    left, right = draw.number(0.6, 1.5), draw.number(0.6, 1.5)
    first = draw.number(0.02, 0.98) * 2.0 * math.pi * left
    bends = [(first, 1.0 / left), (2.0 * math.pi * right, -1.0 / right), (2.0 * math.pi * left - first, 1.0 / left)]
    points = arc(np.array([(length, bend, bend) for length, bend in bends]), _FINE)
    return points if _fits(points) else None


def _turns(degrees: float) -> Curve:
    """Returns the polylines whose corners all turn by this angle, to either side."""
    angle = math.radians(degrees)

    def curve(draw: Draw) -> Points | None:
        heading, corners = 0.0, [(0.0, 0.0)]
        for _ in range(draw.whole(4, 6)):
            sine, cosine = sin_cos(heading)
            leg = SPACING * draw.whole(75, 150)  # so that the corners are points of the path
            corners.append((corners[-1][0] + leg * cosine, corners[-1][1] + leg * sine))
            heading += draw.sign() * angle
        points = _polyline(corners)
        return points if _fits(points) and not _legs_meet(corners) else None

    return curve


def _spline(draw: Draw) -> Points | None:
    """Uniform cubic B-splines over legs within 70 degrees of one direction: wandering, never back."""
    control = [(0.0, 0.0)]
    for _ in range(draw.whole(7, 14)):
        leg = draw.number(1.2, 2.5)
        sine, cosine = sin_cos(math.radians(draw.number(-70.0, 70.0)))
        control.append((control[-1][0] + leg * cosine, control[-1][1] + leg * sine))
    points, curvature = _b_spline(np.array(control))
    return points if _fits(points) and curvature <= 0.98 * _SMOOTH else None


def _circuit(draw: Draw) -> Points | None:
    """Closed uniform cubic B-splines whose bearing from the origin only grows: they do not cross themselves."""
    count = draw.whole(6, 10)
    control = []
    for i in range(count):
        sine, cosine = sin_cos(2.0 * math.pi * (i + draw.number(-0.3, 0.3)) / count)
        radius = draw.number(1.0, 3.4)
        control.append((radius * cosine, radius * sine))
    points, curvature = _b_spline(np.array(control + control[:3]))
    rising = (points[0, :-1] * np.diff(points[1]) > points[1, :-1] * np.diff(points[0])).all()
    return points if rising and _fits(points) and curvature <= 0.98 * _SMOOTH else None


def _b_spline(control: ArrayLike) -> tuple[Points, float]:
    """Returns points of the uniform cubic B-spline of control points (n, 2), and its largest |curvature|, 1/m."""
    p = np.asarray(control)
    t = (np.arange(800) / 800)[:, None, None]
    a, b, c, d = (p[None, i : len(p) - 3 + i] for i in range(4))
    # over the cubic in powers of t
    points = (a + 4.0 * b + c + t * (3.0 * (c - a) + t * (3.0 * (a - 2.0 * b + c) + t * (d - a + 3.0 * (b - c))))) / 6.0
    first = (3.0 * (c - a) + t * (6.0 * (a - 2.0 * b + c) + t * (3.0 * (d - a + 3.0 * (b - c))))) / 6.0
    second = (6.0 * (a - 2.0 * b + c) + t * (6.0 * (d - a + 3.0 * (b - c)))) / 6.0
    speed = np.sqrt(first[..., 0] * first[..., 0] + first[..., 1] * first[..., 1])
    bend = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    end = (p[-3] + 4.0 * p[-2] + p[-1]) / 6.0
    fine = np.vstack([points.transpose(1, 0, 2).reshape(-1, 2), end])
    return np.ascontiguousarray(fine.T), float(np.abs(bend / (speed * speed * speed)).max())


def _polyline(corners: ArrayLike) -> Points:
    return np.ascontiguousarray(np.asarray(corners, np.float64).T)


def _fits(points: Points) -> bool:
    return bool(_LENGTHS[0] <= lengths(points)[-1] <= _LENGTHS[1])


def _returns(points: Points) -> bool:
    """Returns whether a curve comes within `_LEG_GAP` of where it was more than 2 m before."""
    some = points[:, :: round(0.1 / _FINE)]
    dx, dy = some[0][:, None] - some[0], some[1][:, None] - some[1]
    before = np.tri(some.shape[1], k=-20, dtype=np.bool_)
    return bool((dx * dx + dy * dy < _LEG_GAP * _LEG_GAP)[before].any())


def _legs_meet(corners: list[tuple[float, float]]) -> bool:
    """Returns whether a leg comes within `_LEG_GAP` of one that is not its neighbour."""
    t = np.arange(31) / 30.0
    legs = []
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        legs.append((x0 + (x1 - x0) * t, y0 + (y1 - y0) * t))
    for i, (x, y) in enumerate(legs):
        for u, v in legs[i + 2 :]:
            dx, dy = x[:, None] - u, y[:, None] - v
            if (dx * dx + dy * dy).min() < _LEG_GAP * _LEG_GAP:
                return True
    return False


def path_sharpness(scenario: PathScenario) -> float:
    """Returns the quantity of a path's tier, 1/m, rounded to 1e-6: the largest change of direction within 0.3 m."""
    return round(float(sharpness(scenario.path.points, scenario.path.closed, SHARPNESS_WINDOW)), 6)


def feasible(scenario: PathScenario) -> bool:
    """Returns whether a path is as long as those of all families: it can be driven within the clock."""
    return _LEAST <= scenario.path.length <= _LENGTHS[1]


PATH_FAMILIES: Mapping[str, Family] = {
    family.name: family
    for family in (
        _family("straights", "8 to 16 m, started up to 0.5 m beside and 0.8 rad off", _straight, offset=0.5, turn=0.8),
        _family("circles", "radius 0.8 to 3 m, to either side", _circle, closed=True),
        _family("clothoids", "bends of 40 to 160 degrees, continuous curvature up to 2.2 1/m", _clothoids),
        _family("s_curves_wide", "sines with a largest curvature of 0.3 to 1 1/m", _s_curve(0.3, 1.0, 5.0, 8.0)),
        _family("s_curves_medium", "sines with a largest curvature of 1 to 2.5 1/m", _s_curve(1.0, 2.5, 3.5, 5.5)),
        _family("s_curves_tight", "sines with a largest curvature of 2.5 to 4.5 1/m", _s_curve(2.5, 4.5, 2.0, 3.2)),
        _family("figure_eights_gerono", "lemniscates of Gerono, 2.8 to 5.6 m long", _gerono, closed=True),
        _family("figure_eights_tangent", "two circles that touch: the curvature jumps", _tangent_circles, closed=True),
        _family("polylines_90", "four to six legs, all corners of 90 degrees", _turns(90.0)),
        _family("polylines_120", "four to six legs, all corners of 120 degrees", _turns(120.0)),
        _family("polylines_150", "four to six legs, all corners of 150 degrees: almost back", _turns(150.0)),
        _family("splines", "smooth random paths, curvature up to 2 1/m", _spline),
        _family("circuits", "smooth random loops that do not cross themselves", _circuit, closed=True),
    )
}


REPERTOIRE = Repertoire(PathScenario, PATH_SCENARIOS, PATH_FAMILIES, path_sharpness, feasible)
