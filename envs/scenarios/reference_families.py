"""The families of random timed references: from a seed, where a base shall be when, and where it starts beside it.

What is drawn is a curve and a time law along it, and the share of its wheels and accelerations that following takes of
a base: the clock is scaled to meet that for each base, so that a slow one has as hard a problem. Every scenario is
decided by its seed alone. Headings come from the curve's tangent, not from the velocity, which has none at rest; where
`facing` says so, a base that goes sideways looks elsewhere. All have a tube of 1 m.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots.references import KNOT, chords, evaluate, splined, tangents, unwind
from wayfield.envs.scenarios.curves import SPACING
from wayfield.envs.scenarios.draws import Draw, rounded
from wayfield.envs.scenarios.reference_proofs import proven
from wayfield.envs.scenarios.scenario import PathScenario
from wayfield.envs.scenarios.tracing import arc, evenly
from wayfield.envs.tasks.specs import Family, Repertoire
from wayfield.envs.world.paths import Path
from wayfield.system.checks import MOST_TURN, numbers_of, shown
from wayfield.system.elementary import bearings, sin_cos, sines

Array = NDArray[np.float64]
Drawn = tuple[Array, bool, "Array | None"]  # knots, whether they are a lap, the headings of bases that go sideways

SHARES = (0.3, 0.95)
TOO_FAST = (1.05, 1.4)
MOST_STAMP = 1e19  # of a time, counted from anywhere: of now in nanoseconds, too
LONGEST = 1e5  # s, of a reference: two million control periods
SLOW = 2e-3  # m/s in the mean: times of a slower one are in milliseconds, most likely
_FINE = 240  # knots of a smooth curve
_START_OFFSET, _START_TURN = 0.3, 0.3  # m, rad


def _no_knots() -> Array:
    return np.empty((0, KNOT))


@dataclasses.dataclass(frozen=True, eq=False)
class ReferenceScenario(PathScenario):
    """A path to be followed in time: by a clock of its own, or at the `times` of its points.

    With `times`, a spline of degree 5 leads through the points, and a base rests at the first and the last of them; the
    clock begins at the first.

    Raises:
        ValueError: as a `PathScenario`; if times do not increase, their or the headings' number is not the points', the
            headings are no rad, or the start can lie outside the corridor about the reference's first pose.
    """

    times: tuple[float, ...] = ()  # s, one for each point of the path
    headings: tuple[float, ...] = ()  # rad, one for each point, of a base that goes sideways; (): along the path
    knots: Array = dataclasses.field(default_factory=_no_knots)  # (n, 10) of `references`, or none: made of the times
    facing: Array | None = None  # (n, 3) heading of a base that goes sideways and its derivatives; None: the knots'
    share: float = math.nan  # of what a base can that following takes; NaN: time is in seconds
    quantity: float = math.nan  # what the tier is read from: the share

    file_fields: ClassVar[tuple[str, ...]] = ("times", "headings", "start", "start_offset", "start_turn", "corridor")

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.path.points)
        for name, most in (("times", MOST_STAMP), ("headings", MOST_TURN)):
            given = getattr(self, name)
            if isinstance(given, list | tuple) and not len(given) and (name == "headings" or len(self.knots)):
                continue
            if isinstance(given, list | tuple) and not len(given):
                raise ValueError(
                    f"times are missing; a reference has one, in s, for each of its {count} points: the list times of "
                    "a .json, or the column time of a table"
                )
            if not isinstance(given, list | tuple) or len(given) != count:
                many = f"{len(given)} numbers" if isinstance(given, list | tuple) else shown(given)
                raise ValueError(f"{name} is {many}; the path has {count} points, and each needs one")
            object.__setattr__(self, name, numbers_of(name, given, count, "one a point", most))
        for i, (before, behind) in enumerate(itertools.pairwise(self.times)):
            if not behind > before:
                raise ValueError(f"times[{i + 1}] is {behind:.12g} after {before:.12g}; times must increase")
        object.__setattr__(self, "times", tuple(each - self.times[0] for each in self.times))
        if self.times and self.times[-1] > LONGEST:
            raise ValueError(
                f"times go on for {self.times[-1]:g} s; a reference lasts at most {LONGEST:g} s, times are in seconds"
            )
        self._check_headings()
        if not len(self.knots):
            object.__setattr__(self, "knots", _through(self.path.points, self.times))
            if self.headings:
                turned = np.array(self.headings)
                unwind(turned)
                (samples,) = evaluate(splined(turned[:, None], np.array(self.times)), self.knots[:, 0])
                object.__setattr__(self, "facing", np.column_stack(list(samples[:3])))
        first = float(self.knots[0, 1]), float(self.knots[0, 4])
        away = math.dist(first, (self.start or first)[:2]) + math.sqrt(2.0) * self.start_offset
        if away > self.corridor:
            raise ValueError(
                f"start is {self.start} with start_offset {self.start_offset:g}, up to {away:.3g} m from where the "
                f"reference begins; the corridor is {self.corridor:g} m"
            )

    def _check_headings(self) -> None:
        """Raises ValueError where headings are no angles in rad, wrapped or counted on beyond a turn."""
        farthest = max(map(abs, self.headings), default=0.0)
        before = 0.0
        for i, heading in enumerate(self.headings):
            if farthest > 2.0 * math.pi and abs(heading - before) > (math.pi if i else 2.0 * math.pi):
                raise ValueError(
                    f"headings[{i}] is {heading:g}; headings are in rad, and beyond a turn none may be more than half "
                    "a turn from the one before"
                )
            before = heading

    def scaled(self, scale: float) -> "ReferenceScenario":
        """Returns the scenario with the positions multiplied; the times stay."""
        factors = np.array([1.0, *[scale] * 6, 1.0, 1.0, 1.0])
        path = Path(self.path.points * scale, self.path.closed)
        start = self.start and (self.start[0] * scale, self.start[1] * scale, self.start[2])
        return dataclasses.replace(
            self, path=path, start=start, knots=self.knots * factors, tier="", quantity=self.share
        )

    def doubt(self) -> str:
        """Returns what makes it one that robots may not follow as it is meant; "" where nothing does."""
        if self.times and (speed := self.path.length / self.times[-1]) < SLOW:
            return f"the path is driven at {1e3 * speed:.2g} mm/s, in {self.times[-1]:.0f} s; times are in seconds"
        return super().doubt()

    def knots_of(self, holonomic: bool) -> Array:
        """Returns the knots (n, 10) for a base that goes sideways or does not."""
        if self.facing is None or not (holonomic or self.headings):
            return self.knots
        return np.column_stack([self.knots[:, :7], self.facing])

    def decisive(self) -> list[Any]:
        """Returns all numbers that decide an episode, in an order of their own."""
        facing = [] if self.facing is None else [self.facing]
        share = [] if math.isnan(self.share) else [self.share]
        return [*super().decisive(), self.knots, *facing, *share]


# ---- curves and time laws


class Curve(NamedTuple):
    """Places on a curve (n,), by a parameter u that grows along it."""

    x: Array  # m
    y: Array
    heading: Array  # rad, without jumps
    bend: Array  # 1/m, curvature
    bend_rate: Array  # 1/m^2, its derivative by arc length
    stretch: Array  # m, ds/du
    stretch_rate: Array  # m, its derivative by u


class Law(NamedTuple):
    """The parameter of a curve at some times tau (n,), and its two derivatives."""

    tau: Array
    u: Array
    rate: Array
    rise: Array


def _of_derivatives(p: Array, d: Array, dd: Array, ddd: Array) -> Curve:
    """Returns the places (n, 2) with three derivatives by the parameter."""
    square = d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1]
    speed = np.sqrt(square)
    cross = d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]
    along = d[:, 0] * dd[:, 0] + d[:, 1] * dd[:, 1]
    turned = d[:, 0] * ddd[:, 1] - d[:, 1] * ddd[:, 0]
    bend = cross / (square * speed)
    bend_rate = (turned - 3.0 * cross * along / square) / (square * square)
    return Curve(p[:, 0], p[:, 1], tangents(d), bend, bend_rate, speed, along / speed)


def _knots(curve: Curve, law: Law) -> Array:
    """Returns the knots (n, KNOT) of a curve that is driven by a time law."""
    sine, cosine = sines(curve.heading)
    v = curve.stretch * law.rate
    a = curve.stretch * law.rise + curve.stretch_rate * law.rate * law.rate
    w = curve.bend * v
    alpha = curve.bend * a + curve.bend_rate * v * v
    x = (curve.x, v * cosine, a * cosine - v * w * sine)
    y = (curve.y, v * sine, a * sine + v * w * cosine)
    return np.column_stack([law.tau, *x, *y, curve.heading, w, alpha])


def _steady(turns: float, n: int = _FINE) -> Law:
    """Returns the law of a parameter that grows evenly to `turns`."""
    tau = np.arange(n + 1) / n
    return Law(tau, turns * tau, np.full(n + 1, turns), np.zeros(n + 1))


def _min_jerk(end: float, n: int = _FINE) -> Law:
    """Returns the quintic law from rest to rest (Flash and Hogan 1985)."""
    z = np.arange(n + 1) / n
    rate, rise = 30.0 * z * z * (1.0 - z) * (1.0 - z), 60.0 * z * (1.0 - z) * (1.0 - 2.0 * z)
    return Law(z, end * z * z * z * (10.0 + z * (-15.0 + 6.0 * z)), end * rate, end * rise)


def _ramped(end: float, ramp: float, tau: Array | None = None) -> Law:
    """Returns the law that sets in over a share `ramp` of the time, goes on evenly and sets off over another."""
    tau = np.arange(_FINE + 1) / _FINE if tau is None else tau
    z = np.minimum(np.minimum(tau, 1.0 - tau) / ramp, 1.0)
    sign = np.where(tau < 0.5, 1.0, -1.0)
    rate = z * z * z * (10.0 + z * (-15.0 + 6.0 * z))
    rise = sign * z * z * (30.0 + z * (-60.0 + 30.0 * z)) / ramp
    gone = ramp * z * z * z * z * (2.5 + z * (-3.0 + z)) + np.maximum(np.minimum(tau, 1.0 - tau) - ramp, 0.0)
    whole = 1.0 - ramp
    u = np.where(tau < 0.5, gone, whole - gone)
    return Law(tau, end * (u / whole), end * (rate / whole), end * (rise / whole))


def _ellipse(a: float, b: float) -> Callable[[Law], Curve]:
    def curve(law: Law) -> Curve:
        s, c = sines(law.u)
        p, d = np.column_stack([a * c, b * s]), np.column_stack([-a * s, b * c])
        return _of_derivatives(p, d, -p, -d)

    return curve


def _gerono(a: float, b: float) -> Callable[[Law], Curve]:
    """Returns x = a sin u, y = b sin u cos u."""

    def curve(law: Law) -> Curve:
        (s, c), (s2, c2) = sines(law.u), sines(2.0 * law.u)
        p, d = np.column_stack([a * s, 0.5 * b * s2]), np.column_stack([a * c, b * c2])
        return _of_derivatives(p, d, np.column_stack([-a * s, -2.0 * b * s2]), np.column_stack([-a * c, -4.0 * b * c2]))

    return curve


def _bernoulli(a: float) -> Callable[[Law], Curve]:
    """Returns the lemniscate of Bernoulli, x = a cos u / (1 + sin^2 u), y = x sin u, of curvature 3 cos u / (a q)."""

    def curve(law: Law) -> Curve:
        s, c = sines(law.u)
        q = np.sqrt(1.0 + s * s)
        x = a * c / (q * q)
        d = np.column_stack([-s * (1.0 + s * s + 2.0 * c * c), (c * c - s * s) * (1.0 + s * s) - 2.0 * s * s * c * c])
        stretch = a / q
        bend = 3.0 * c / (a * q)
        by_u = -3.0 / a * s * (q * q + c * c) / (q * q * q)  # of the bend
        return Curve(x, x * s, tangents(d), bend, by_u / stretch, stretch, -a * s * c / (q * q * q))

    return curve


def _splined(points: Array) -> tuple[Callable[[Law], Curve], float]:
    """Returns the spline of degree 5 through points (n, 2), by the length of its chords, and where it ends, m."""
    knots = splined(points, chords(points))

    def curve(law: Law) -> Curve:
        return _of_derivatives(*np.moveaxis(evaluate(knots, law.u), 0, 2))

    return curve, float(knots[-1, 0])


def _through(points: Array, times: tuple[float, ...]) -> Array:
    """Returns the knots of a spline through points (n, 2) that passes each at its time, from rest to rest.

    Its speed at a point is the harmonic mean of those on either side (Fritsch and Butland 1984), so that it never
    backs.
    """
    curve, _ = _splined(points)
    u, t = chords(points), np.array(times)
    speeds = np.diff(u) / np.diff(t)
    at = np.concatenate([[0.0], 2.0 * speeds[1:] * speeds[:-1] / (speeds[1:] + speeds[:-1]), [0.0]])
    each = np.arange(_PIECES) / _PIECES
    fine = np.append((t[:-1, None] + np.diff(t)[:, None] * each).ravel(), t[-1])
    (values,) = evaluate(np.column_stack([t, u, at, np.zeros(len(t))]), fine)
    values[1] = np.maximum(values[1], 0.0)
    return _knots(curve(Law(fine, values[0], values[1], values[2])), Law(fine, values[0], values[1], values[2]))


_PIECES = 12  # knots between two points that have times


# ---- the families


def _family(
    name: str, about: str, draw_one: Callable[[Draw], Drawn | None], shares: tuple[float, float] = SHARES
) -> Family:
    """Returns the family of a drawn reference, placed anywhere near the origin and mirrored or not."""

    def scenario(seed: int) -> ReferenceScenario:
        draw = Draw(name, seed)
        knots, closed, facing = draw.until_one(lambda: draw_one(draw))
        place = draw.number(-2.0, 2.0), draw.number(-2.0, 2.0), draw.heading(), draw.sign()
        share = draw.number(*shares)
        return placed(f"{name}_{seed}", knots, closed, share, facing, place, draw, name)

    return Family(name, about, scenario)


def placed(
    name: str,
    knots: Array,
    closed: bool,
    share: float,
    facing: Array | None = None,
    place: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
    draw: Draw | None = None,
    family: str = "",
) -> ReferenceScenario:
    """Returns the scenario of knots (n, KNOT) that are put at a place: x, y, heading, and -1 to mirror them first.

    Args:
        draw: where it starts beside the reference; None: on it.
    """
    x, y, heading, side = place
    sine, cosine = sin_cos(heading)
    u, v = knots[:, 1:4], side * knots[:, 4:7]
    moved = np.column_stack([knots[:, :1], cosine * u - sine * v, sine * u + cosine * v, side * knots[:, 7:]])
    moved[:, 1] += x - moved[0, 1]
    moved[:, 4] += y - moved[0, 4]
    moved[:, 7] += heading
    if facing is not None:
        facing = side * facing
        facing[:, 0] += heading
    start = (float(moved[0, 1]), float(moved[0, 4]), float(moved[0, 7]))
    if draw is not None:
        aside = [draw.number(-_START_OFFSET, _START_OFFSET) for _ in range(2)]
        start = (rounded(start[0] + aside[0]), rounded(start[1] + aside[1]),
                 rounded(start[2] + draw.number(-_START_TURN, _START_TURN)))  # fmt: skip
    return ReferenceScenario(
        name,
        _path_of(moved, closed),
        start=start,
        knots=moved,
        facing=facing,
        share=share,
        quantity=share,
        family=family,
    )


def _path_of(knots: Array, closed: bool) -> Path:
    """Returns the path that knots lead along, evenly spaced."""
    fine = np.linspace(knots[0, 0], knots[-1, 0], 4 * len(knots) + 1)
    values = evaluate(knots[:, :7], fine)[:, 0]
    moves = np.concatenate([[True], (np.diff(values[0]) != 0.0) | (np.diff(values[1]) != 0.0)])
    even = evenly(np.ascontiguousarray(values[:, moves]), SPACING, values[0, 0], values[1, 0], 0.0, 1.0)
    return Path(even[:-1] if closed else even, closed)


def _begun(curve: Callable[[Law], Curve], draw: Draw) -> Drawn:
    """Returns a lap of a closed curve, from anywhere on it."""
    law = _steady(2.0 * math.pi)
    begin = draw.heading()
    moved = law._replace(u=law.u + begin)
    return _knots(curve(moved), moved), True, None


def _round(draw: Draw) -> Drawn:
    radius = draw.number(0.8, 2.5)
    return _begun(_ellipse(radius, radius), draw)


def _long_round(draw: Draw) -> Drawn:
    radius = draw.number(1.0, 2.5)
    return _begun(_ellipse(radius, radius * draw.number(0.5, 0.8)), draw)


def _eight(draw: Draw) -> Drawn:
    a = draw.number(1.4, 2.8)
    return _begun(_gerono(a, a * draw.number(0.5, 1.2)), draw)


def _lemniscate(draw: Draw) -> Drawn:
    return _begun(_bernoulli(draw.number(1.4, 2.8)), draw)


def _clothoids(draw: Draw) -> Drawn:
    """Bends of clothoid, arc, clothoid between straight lines: the curvature never jumps."""
    pieces = [(draw.number(0.5, 1.5), 0.0, 0.0)]
    while sum(length for length, _, _ in pieces) < 8.0:
        curvature, angle = draw.number(0.5, 1.6), math.radians(draw.number(40.0, 140.0))
        ramp, bend = draw.number(0.4, 0.8) * angle / curvature, curvature * draw.sign()
        pieces += [(ramp, 0.0, bend), (angle / curvature - ramp, bend, bend), (ramp, bend, 0.0)]
        pieces.append((draw.number(0.3, 1.5), 0.0, 0.0))
    length, first, last = np.array(pieces).T
    ends = np.concatenate([[0.0], np.cumsum(length)])
    headings = np.concatenate([[0.0], np.cumsum(0.5 * (first + last) * length)])
    share = np.arange(_PIECES + 1) / _PIECES
    fine = [(size / _PIECES, a + (b - a) * x, a + (b - a) * z)
            for size, a, b in pieces for x, z in itertools.pairwise(share)]  # fmt: skip
    steps = np.cumsum([0, *(max(round(size / _STEP), 1) for size, _, _ in fine)])
    points = arc(np.array(fine), _STEP)
    rows = []
    for i, (size, begin, end) in enumerate(pieces):  # the curvature's slope jumps where they meet: two knots there
        gone = share * size
        law = _at(lambda tau: _ramped(float(ends[-1]), 0.1, tau), ends[i] + gone)
        slope = (end - begin) / size
        at = steps[_PIECES * i : _PIECES * (i + 1) + 1]
        heading = headings[i] + gone * (begin + 0.5 * slope * gone)
        even = np.ones(len(gone))
        rows.append(
            _knots(
                Curve(points[0, at], points[1, at], heading, begin + slope * gone, slope * even, even, 0.0 * even), law
            )
        )
    return np.concatenate(rows), False, None


_STEP = 0.002  # m


def _at(law: Callable[[Array], Law], u: Array) -> Law:
    """Returns a law at the times at which its parameter has these values, by bisection."""
    low, high = np.zeros(len(u)), np.ones(len(u))
    for _ in range(60):
        middle = 0.5 * (low + high)
        behind = law(middle).u < u
        low, high = np.where(behind, middle, low), np.where(behind, high, middle)
    return law(0.5 * (low + high))


def _wandering(count: tuple[int, int], bend: float) -> Callable[[Draw], Array]:
    """Returns points with legs of 1.2 to 2.5 m within `bend` degrees of one direction."""

    def points(draw: Draw) -> Array:
        corners = [(0.0, 0.0)]
        for _ in range(draw.whole(*count)):
            leg = draw.number(1.2, 2.5)
            sine, cosine = sin_cos(math.radians(draw.number(-bend, bend)))
            corners.append((corners[-1][0] + leg * cosine, corners[-1][1] + leg * sine))
        return np.array(corners)

    return points


def _open(points: Array, law: Callable[[float], Law]) -> Drawn | None:
    """Returns the spline through points, driven by a law; None where it bends more than 2.5 1/m."""
    curve, end = _splined(points)
    timing = law(end)
    places = curve(timing)
    return None if np.abs(places.bend).max() > 2.5 else (_knots(places, timing), False, None)


def _spline(draw: Draw) -> Drawn | None:
    return _open(_wandering((6, 10), 60.0)(draw), lambda end: _ramped(end, 0.1))


def _jerk(draw: Draw) -> Drawn | None:
    return _open(_wandering((3, 7), 60.0)(draw), _min_jerk)


def _hasty(draw: Draw) -> Drawn:
    """Returns an ellipse whose speed swings about its mean, once to three times a lap."""
    share, times = draw.number(0.3, 0.6), draw.whole(1, 3)
    begin, phase = draw.heading(), draw.heading()
    tau = np.arange(_FINE + 1) / _FINE
    whole = 2.0 * math.pi
    s, c = sines(whole * times * tau + phase)
    first = sin_cos(phase)[0]
    law = Law(
        tau,
        begin + whole * (tau + share / (whole * times) * (s - first)),
        whole * (1.0 + share * c),
        -whole * share * whole * times * s,
    )
    radius = draw.number(1.0, 2.5)
    return _knots(_ellipse(radius, radius * draw.number(0.6, 1.0))(law), law), True, None


def _halting(draw: Draw) -> Drawn | None:
    """Returns a spline with rests on the way."""
    curve, end = _splined(_wandering((5, 8), 60.0)(draw))
    stops = draw.whole(2, 4)
    at = [0.0, *sorted(draw.number(0.15, 0.85) for _ in range(stops)), 1.0]
    if min(b - a for a, b in itertools.pairwise(at)) < 0.1:
        return None
    knots, clock = [], 0.0
    for a, b in itertools.pairwise(at):
        law = _min_jerk((b - a) * end, 80)
        law = law._replace(u=law.u + a * end, rate=law.rate / (b - a), rise=law.rise / ((b - a) * (b - a)))
        places = curve(law._replace(tau=clock + (b - a) * law.tau))
        if np.abs(places.bend).max() > 2.5:
            return None
        knots.append(_knots(places, law._replace(tau=clock + (b - a) * law.tau)))
        clock += (b - a) + draw.number(0.02, 0.08)  # and a rest
    joined = np.concatenate(knots)
    joined[:, 0] /= knots[-1][-1, 0]
    scale = knots[-1][-1, 0]
    joined[:, [2, 5, 8]] *= scale
    joined[:, [3, 6, 9]] *= scale * scale
    return joined, False, None


def _legs(moves: list[tuple[float, float]]) -> Drawn:
    """Returns legs (m) and turns on the spot (rad) from rest to rest, each in a time as fits its length."""
    x, y, heading, clock = 0.0, 0.0, 0.0, 0.0
    rows = [(clock, x, y, heading)]
    for leg, turn in moves:
        sine, cosine = sin_cos(heading)
        x, y = x + leg * cosine, y + leg * sine
        clock += math.sqrt(leg)
        rows.append((clock, x, y, heading))
        if turn:
            heading += turn
            clock += 0.6 * math.sqrt(abs(turn))
            rows.append((clock, x, y, heading))
    t, x_, y_, headings = np.array(rows).T
    none = np.zeros(len(rows))
    return np.column_stack([t / t[-1], x_, none, none, y_, none, none, headings, none, none]), False, None


def _square(draw: Draw) -> Drawn:
    side = draw.number(1.0, 2.0)
    return _legs([(side, 0.5 * math.pi)] * 4)


def _turning(draw: Draw) -> Drawn:
    moves = [(draw.number(0.5, 1.5), draw.sign() * draw.number(0.8, 2.6)) for _ in range(draw.whole(4, 6))]
    return _legs([*moves, (draw.number(0.5, 1.5), 0.0)])


def _looking(draw: Draw) -> Drawn:
    """Returns an eight that a base which goes sideways drives with a fixed heading, at a point, or spinning."""
    a = draw.number(1.2, 2.2)
    knots, closed, _ = _begun(_gerono(a, a * draw.number(0.6, 1.0)), draw)
    kind, turns = draw.whole(0, 2), draw.sign() * draw.whole(1, 2)
    tau, none = knots[:, 0], np.zeros(len(knots))
    if kind == 0:
        return knots, closed, np.column_stack([none + draw.heading(), none, none])
    if kind == 1:
        rate = 2.0 * math.pi * turns
        return knots, closed, np.column_stack([rate * tau, none + rate, none])
    # at a point beyond all of it
    u, v = knots[:, 1:4].copy(), knots[:, 4:7].copy()
    u[:, 0] -= 2.0 * a
    square = u[:, 0] * u[:, 0] + v[:, 0] * v[:, 0]
    cross = u[:, 0] * v[:, 1] - v[:, 0] * u[:, 1]
    along = u[:, 0] * u[:, 1] + v[:, 0] * v[:, 1]
    headings = bearings(-v[:, 0], -u[:, 0])
    unwind(headings)
    turned = (u[:, 0] * v[:, 2] - v[:, 0] * u[:, 2]) / square - 2.0 * cross * along / (square * square)
    return knots, closed, np.column_stack([headings, cross / square, turned])


def share_of(scenario: ReferenceScenario) -> float:
    """Returns the quantity of a reference's tier: the share of what a base can that following it takes."""
    return scenario.share


def _closed_form(name: str, curve: Callable[[Law], Curve], share: float) -> Callable[[], tuple[ReferenceScenario, ...]]:
    def scenarios() -> tuple[ReferenceScenario, ...]:
        law = _steady(2.0 * math.pi)
        knots = _knots(curve(law), law)
        return (
            placed(name, knots, True, share, place=(0.0, 0.0, -float(knots[0, 7]), 1.0)),
        )  # along x from the origin

    return scenarios


REFERENCE_SCENARIOS: Mapping[str, Callable[[], tuple[ReferenceScenario, ...]]] = {
    "round_1m": _closed_form("round_1m", _ellipse(1.0, 1.0), 0.5),
    "eight_2m": _closed_form("eight_2m", _gerono(2.0, 1.0), 0.56),
    "eight_2m_fast": _closed_form("eight_2m_fast", _gerono(2.0, 1.2), 0.82),
}

REFERENCE_FAMILIES: Mapping[str, Family] = {
    family.name: family
    for family in (
        _family("rounds", "circles of 0.8 to 2.5 m radius at an even speed", _round),
        _family("long_rounds", "ellipses, 1 to 2.5 m long half axes", _long_round),
        _family("eights", "lemniscates of Gerono", _eight),
        _family("lemniscates", "lemniscates of Bernoulli", _lemniscate),
        _family("bends", "bends of clothoid, arc, clothoid, from rest to rest", _clothoids),
        _family("wandering", "splines of degree 5 at an even speed, from rest to rest", _spline),
        _family("min_jerk", "splines of degree 5 with a quintic time law", _jerk),
        _family("squares", "four sides with turns on the spot, each from rest to rest", _square),
        _family("speed_changes", "ellipses whose speed swings by 30 to 60 %", _hasty),
        _family("stop_and_go", "splines with two to four rests", _halting),
        _family("turns_on_the_spot", "short legs with turns on the spot between", _turning),
        _family("facing_eights", "eights; bases that go sideways look elsewhere", _looking),
        _family("too_fast", "eights that take more than a base has, 1.05 to 1.4 times", _eight, TOO_FAST),
    )
}

REPERTOIRE = Repertoire(ReferenceScenario, REFERENCE_SCENARIOS, REFERENCE_FAMILIES, share_of, proven)
