"""Estimates of what a base does with its commands, each with a 95 % interval of profile likelihood.

Least squares over everything at once stops in the valley where delay and lag trade against each other: the delay is
tried on a grid first, each time with the best of the other parameters, and set free from the two best. The saturation
that both axes share is then fitted from there.

A value x of a parameter is inside of its interval if, with the others fitted anew,

    N log(SSE(x) / SSE_min) (1 - rho) / (1 + rho) <= 3.84 (1 + 5 / N)

with rho the lag-1 correlation of the residuals, of which neighbours say the same twice.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq

from wayfield.benchmarks.identify.response import (
    AXES,
    PAIR,
    TWIST,
    WHEELS,
    Drive,
    Floats,
    axis_response,
    held,
    pair_response,
)

DELAYS = np.arange(0.0, 0.5, 0.03)  # s, of the grid
LONGEST_DELAY = 0.8  # s
LAGS = (0.002, 3.0)  # s
LIKELIHOOD = 3.84  # 95 % of chi-squared with one degree of freedom
BLOCK = 10.0  # s, of the blocks that are left out in turn to choose the saturation
GAIN = 0.005  # share of the held-out error by which a saturation must be better than the one before
FREE_DECELERATION = 15.0  # log likelihood ratio from which a deceleration is another than the acceleration
MUCH_BETTER = 0.1  # share of the squares that it leaves, with which it is too

# What says that a parameter was seen.
AT_LIMIT, BEYOND = 1.0, 1.05  # s at the limit, while so many times it is commanded
SLEWS, SLEW_SAMPLES, SLEW_LAGS = 4, 3, 2.0  # slews, and their least length
STEP_NOISES, STEPS, FULL_STEP, STEP_TIME = 10.0, 6, 20.0, 0.2  # least step; steps' worth; in noises; s
WIDEST_DELAY, WIDEST = 0.1, 2.5  # s between the ends of a delay; ratio of the ends of any other
NARROW = 1.25, 1.5  # ratio of the ends to which a slew was seen: however short, and if enough of them were long
LEAST_NOISE = 1e-4  # of odometry, in its largest speed: a simulator's may have none, and no number is known so well
LEAST = 0.01, 0.02  # m/s and rad/s, of the largest command of an axis that is driven at all

UNKNOWN = np.array([0.0, 1.0, 1e3, 1e3, 0.1, 0.0, 1.0, 1e3, 1e3, 0.1, 1e3, 1e3])  # as PAIR, of axes without commands


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A parameter's value and its interval; what was not excited has a bound in place of a value."""

    name: str
    unit: str
    value: float  # where the fit has it, seen or not
    low: float  # -inf where the log does not bound it
    high: float  # inf where the log does not bound it
    seen: bool
    missing: str = ""  # what to drive so that it is seen

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if self.seen:
            return f"{self.value:.4g}{unit} ({self.low:.4g} to {self.high:.4g})"
        if math.isfinite(self.low) and math.isfinite(self.high):
            return f"between {self.low:.3g} and {self.high:.3g}{unit}"
        if math.isfinite(self.low):
            return f"at least {self.low:.3g}{unit}"
        return f"at most {self.high:.3g}{unit}" if math.isfinite(self.high) else "not observable"


@dataclasses.dataclass(frozen=True)
class Fit:
    """The fitted response of both axes."""

    saturation: int  # AXES, TWIST or WHEELS
    numbers: Floats  # (12,), as PAIR names them
    response: Floats  # (2, n)
    noise: Floats  # (2,) standard deviation of the residuals
    correlation: Floats  # (2,) of each residual with the one before, at least 0
    decelerating: tuple[bool, bool]  # whether the deceleration of an axis is another than its acceleration
    limited: tuple[bool, bool]  # whether the drive reaches the limit of an axis
    held_out: tuple[float, float, float]  # RMS of both axes over their noise, per saturation, on blocks left out
    estimates: tuple[Estimate, ...] = ()

    def __getitem__(self, name: str) -> Estimate:
        return next(each for each in self.estimates if each.name == name)

    def residuals(self, drive: Drive) -> Floats:
        """Returns measured minus fitted speeds, (2, k), of what counts."""
        found: Floats = (drive.speeds.T - self.response)[:, drive.counted]
        return found


@dataclasses.dataclass
class Problem:
    """Least squares of a response over groups of its numbers: the delays as they are, all others by their log."""

    respond: Callable[[Floats], tuple[Floats, Floats]]  # numbers to (k,) speeds and (k, p) derivatives
    measured: Floats  # (k,)
    weights: Floats  # (k,)
    groups: Sequence[tuple[int, ...]]  # of numbers that are one parameter
    low: Floats  # of each parameter
    high: Floats
    linear: NDArray[np.bool_]  # whether a parameter is a delay
    others: Floats  # all numbers, for those of no group
    _last: Any = None

    def numbers(self, x: Floats) -> Floats:
        """Returns the numbers of parameters."""
        inside = np.clip(x, self.low, self.high)
        values = np.where(self.linear, inside, np.exp(np.where(self.linear, 0.0, inside)))
        found = self.others.copy()
        for group, value in zip(self.groups, values, strict=True):
            found[list(group)] = value
        return found

    def parameters(self, numbers: Floats) -> Floats:
        """Returns the parameters of numbers, within the bounds."""
        first = numbers[[group[0] for group in self.groups]]
        found: Floats = np.clip(
            np.where(self.linear, first, np.log(np.where(self.linear, 1.0, first))), self.low, self.high
        )
        return found

    def at(self, x: Floats) -> tuple[Floats, Floats]:
        """Returns weighted residuals (k,) and their derivatives (k, parameters)."""
        if self._last is None or not np.array_equal(self._last[0], x):
            numbers = self.numbers(x)
            v, slopes = self.respond(numbers)
            scale = np.where((x >= self.low) & (x <= self.high), 1.0, 0.0)
            columns = np.empty((len(v), len(x)))
            for j, group in enumerate(self.groups):
                factor = scale[j] if self.linear[j] else scale[j] * numbers[group[0]]
                columns[:, j] = slopes[:, group[0]] if len(group) == 1 else slopes[:, group].sum(axis=1)
                columns[:, j] *= factor * self.weights
            self._last = x.copy(), self.weights * (v - self.measured), columns
        return self._last[1], self._last[2]

    def solve(self, x: Floats, free: Sequence[int], tolerance: float = 1e-9, most: int = 60) -> tuple[Floats, float]:
        """Returns the best parameters from a start, and their sum of squares; those that are not free stay."""
        chosen = list(free)

        def whole(part: Floats) -> Floats:
            found = x.copy()
            found[chosen] = part
            return found

        part, _, _, _, _ = leastsq(
            lambda part: self.at(whole(part))[0], x[chosen], Dfun=lambda part: self.at(whole(part))[1][:, chosen],
            full_output=True, ftol=tolerance, xtol=tolerance, maxfev=most,
        )  # fmt: skip
        best = np.clip(whole(part), self.low, self.high)
        errors = self.at(best)[0]
        return best, float(errors @ errors)

    def best(self, starts: Sequence[Floats], tolerance: float = 1e-9) -> tuple[Floats, float]:
        """Returns the best of the solutions from several starts."""
        free = range(len(self.groups))
        return min((self.solve(x, free, tolerance) for x in starts), key=lambda each: each[1])

    def interval(self, best: Floats, cost: float, index: int, count: float) -> tuple[float, float]:
        """Returns the ends of a parameter's interval, in its own unit; -inf and inf where the bounds are inside.

        Args:
            best: the parameters of least cost.
            cost: their sum of squares.
            index: of the parameter.
            count: of independent measurements; more than the cost where the noise is taken as more than what is left.
        """
        slopes = self.at(best)[1]
        covariance = np.linalg.pinv(slopes.T @ slopes)
        spare = max(count - cost, 0.0)
        deviation = math.sqrt(max(covariance[index, index], 1e-18) * (cost + spare) / count)
        ahead = covariance[:, index] / max(covariance[index, index], 1e-18)
        limit = LIKELIHOOD * (1.0 + 5.0 / len(self.measured)) / count
        ends = [self._end(best, cost, spare, index, side, limit, 1.96 * deviation, ahead) for side in (-1.0, 1.0)]
        low, high = ends if self.linear[index] else [math.exp(each) for each in ends]
        return (low if low > 0.0 else -math.inf), high

    def _end(
        self, best: Floats, cost: float, spare: float, index: int, side: float, limit: float, step: float, ahead: Floats
    ) -> float:
        """Returns where log(cost / least cost) passes a limit: the step is doubled, then false position.

        The root of that ratio is almost a straight line. `spare` is added to both costs.
        """
        free = [j for j in range(len(best)) if j != index]
        room = abs((self.high if side > 0.0 else self.low)[index] - best[index])
        wanted = math.sqrt(limit)

        def root(distance: float, start: Floats, at: float) -> tuple[float, Floats]:
            x = np.clip(start + ahead * (side * (distance - at)), self.low, self.high)
            x[index] = best[index] + side * distance
            found, squares = self.solve(x, free, 1e-5, 25)
            return math.sqrt(max(math.log((max(squares, 1e-300) + spare) / (cost + spare)), 0.0)), found

        inner, inner_root, start = 0.0, 0.0, best
        outer = min(max(step, 1e-6), 0.5)
        while True:
            outer = min(outer, room)
            outer_root, x = root(outer, start, inner)
            if outer_root > wanted:
                break
            if outer >= room:
                return side * math.inf
            inner, inner_root, start, outer = outer, outer_root, x, 2.0 * outer
        for _ in range(12):
            share = (wanted - inner_root) / (outer_root - inner_root)
            middle = inner + min(max(share, 0.1), 0.9) * (outer - inner)
            found, x = root(middle, start, inner)
            if abs(found - wanted) < 0.01 * wanted:
                inner = middle
                break
            if found < wanted:
                inner, inner_root, start = middle, found, x
            else:
                outer, outer_root = middle, found
        return float(best[index] + side * inner)


def axis_problem(drive: Drive, axis: int, free_deceleration: bool = False) -> Problem:
    """Returns the least squares of one axis that saturates by itself."""
    counted = drive.counted
    asked = max(float(np.abs(drive.commands[:, axis]).max()), 1e-6)

    def respond(numbers: Floats) -> tuple[Floats, Floats]:
        v, slopes = axis_response(drive, axis, numbers)
        return v[counted], slopes[counted]

    slews: list[tuple[int, ...]] = [(3,), (4,)] if free_deceleration else [(3, 4)]
    scales = [(0.2, 5.0), (0.02 * asked, 4.0 * asked), *[(0.05 * asked, 200.0 * asked)] * len(slews), LAGS]
    ends = np.log(np.array(scales)).T
    measured = drive.speeds[counted, axis]
    low, high = np.concatenate([[0.0], ends[0]]), np.concatenate([[LONGEST_DELAY], ends[1]])
    linear = np.arange(len(low)) == 0
    groups = [(0,), (1,), (2,), *slews, (5,)]
    return Problem(respond, measured, np.ones(len(measured)), groups, low, high, linear, np.empty(6))


def fit_axis(drive: Drive, axis: int, delays: Floats = DELAYS) -> Floats:
    """Returns delay, gain, limit, acceleration, deceleration and lag of an axis that saturates by itself.

    Args:
        drive: what was commanded and measured.
        axis: 0, forward, or 1, yaw.
        delays: s, that are tried first.
    """
    problem = axis_problem(drive, axis)
    asked = float(np.abs(drive.commands[:, axis]).max())
    fastest = float(np.quantile(np.abs(problem.measured), 0.995))
    starts = [
        problem.parameters(np.array([delays[0], 1.0, limit, slew * asked, slew * asked, lag]))
        for limit in (1.02 * fastest, 2.0 * asked)
        for slew, lag in ((1.0, 0.2), (6.0, 0.05))
    ]
    free = range(1, 5)
    found: list[tuple[Floats, float]] = []
    for delay in delays:
        starts = [np.concatenate([[delay], x[1:]]) for x in (starts if not found else [found[-1][0]])]
        found.append(min((problem.solve(x, free, 1e-6, 40) for x in starts), key=lambda each: each[1]))
    found.sort(key=lambda each: each[1])
    x, _ = problem.best([each for each, _ in found[:2]])
    return problem.numbers(x)


def pair_problem(
    drive: Drive,
    saturation: int,
    scales: Floats,
    decelerating: Sequence[bool] = (False, False),
    limited: Sequence[bool] = (True, True),
) -> Problem:
    """Returns the least squares of both axes, each divided by its scale.

    Args:
        drive: what was commanded and measured.
        saturation: AXES, TWIST or WHEELS.
        scales: (2,) of each axis.
        decelerating: whether an axis has a deceleration of its own.
        limited: whether the drive reaches the limit of an axis; without, there is none.
    """
    counted = drive.counted
    asked = np.maximum(np.abs(drive.commands).max(axis=0), 1e-6)

    def respond(numbers: Floats) -> tuple[Floats, Floats]:
        v, slopes = pair_response(drive, saturation, numbers)
        return v[:, counted].ravel(), slopes[:, counted].reshape(-1, len(PAIR))

    groups: list[tuple[int, ...]] = []
    ends: list[tuple[float, float]] = []
    for axis in commanded(drive):
        first = 5 * axis
        slews: list[tuple[int, ...]] = [(first + 2,), (first + 3,)] if decelerating[axis] else [(first + 2, first + 3)]
        groups += [(first,), (first + 1,), *slews, (first + 4,)]
        reach = 0.05 * asked[axis], 200.0 * asked[axis]
        ends += [(1.0, math.exp(LONGEST_DELAY)), (0.2, 5.0), *[reach] * len(slews), LAGS]
    if saturation == AXES:
        reached = [axis for axis in commanded(drive) if limited[axis]]
        groups += [(10 + axis,) for axis in reached]
        ends += [(0.02 * asked[axis], 4.0 * asked[axis]) for axis in reached]
    else:
        groups += [(10,), (11,)]
        ends += [(0.02 * asked[0], 4.0 * asked[0] + 4.0 * asked[1]), (0.02, 5.0)]
    low, high = np.log(np.array(ends)).T
    linear = np.array([group[0] in (0, 5) for group in groups])
    measured = drive.speeds[counted].T.ravel()
    weights = np.repeat(1.0 / scales, counted.sum())
    return Problem(respond, measured, weights, groups, low, high, linear, UNKNOWN.copy())


def correlations(residuals: Floats) -> Floats:
    """Returns the correlation (k,) of each row of residuals with the ones before, at least 0."""
    ahead, behind = residuals[:, 1:], residuals[:, :-1]
    found: Floats = np.clip((ahead * behind).sum(axis=1) / np.maximum((residuals**2).sum(axis=1), 1e-300), 0.0, 0.99)
    return found


def commanded(drive: Drive) -> tuple[int, ...]:
    """Returns the axes that are commanded at all: 0, forward, and 1, yaw."""
    return tuple(axis for axis in range(2) if np.abs(drive.commands[:, axis]).max(initial=0.0) >= LEAST[axis])


def fit_axes(drive: Drive, delays: Floats = DELAYS) -> Floats:
    """Returns the numbers of PAIR of two axes that saturate by themselves; UNKNOWN of one without commands."""
    found = UNKNOWN.copy()
    for axis in commanded(drive):
        own = fit_axis(drive, axis, delays)
        found[5 * axis : 5 * axis + 5] = own[[0, 1, 3, 4, 5]]
        found[10 + axis] = own[2]
    return found


def _scales(drive: Drive, saturation: int, numbers: Floats) -> tuple[Floats, Floats, Floats]:
    """Returns what divides the residuals of each axis, so that all count alike; their deviation and correlation."""
    residuals = (drive.speeds.T - pair_response(drive, saturation, numbers)[0])[:, drive.counted]
    noise = np.maximum(residuals.std(axis=1), LEAST_NOISE * np.maximum(np.abs(drive.speeds).max(axis=0), 1e-3))
    rho = correlations(residuals)
    return noise * np.sqrt((1.0 + rho) / (1.0 - rho)), noise, rho


def _count(drive: Drive, rho: Floats) -> float:
    """Returns how many independent measurements residuals of such correlations are worth."""
    return float(drive.counted.sum() * ((1.0 - rho) / (1.0 + rho)).sum())


def _starts(drive: Drive, numbers: Floats, half_track: float) -> list[Floats]:
    """Returns starts of a saturation that both axes share.

    An axis by itself may be fitted without any limit where the other one mostly slows it: the measured speeds say where
    wheels saturate, and gains of 1 are tried as well.
    """
    fastest = np.quantile(np.abs(drive.speeds[drive.counted]), 0.995, axis=0)
    measured = float(fastest[0] / max(fastest[1], 1e-6))
    found = []
    for half, gained in ((measured, True), (measured, False), (half_track, True), (1.6 * half_track, True)):
        start = numbers.copy()
        start[10:] = max(fastest[0], half * fastest[1]), half
        if not gained:
            start[[1, 6]] = 1.0
        found.append(start)
    return found


def _errors(drive: Drive, saturation: int, numbers: Floats, noise: Floats) -> float:
    """Returns the mean square of the residuals of both axes, over their noise."""
    residuals = (drive.speeds.T - pair_response(drive, saturation, numbers)[0])[:, drive.counted]
    return float(((residuals / noise[:, None]) ** 2).mean())


def choose_saturation(drive: Drive, axes: Floats, half_track: float) -> tuple[int, Floats, tuple[float, float, float]]:
    """Returns the saturation that best predicts blocks of the drive which its fit has not seen.

    Args:
        drive: what was commanded and measured.
        axes: the numbers of PAIR of axes that saturate by themselves, which stay unless another is better.
        half_track: m, from which the search for half of the track starts.

    Returns:
        The saturation, its numbers fitted to the whole drive, and the errors of all three: mean square over noise, on
        the blocks left out.
    """
    scales, noise, _ = _scales(drive, AXES, axes)
    block = ((drive.times - drive.times[0]) // BLOCK).astype(int) % 2
    numbers, held_out = {AXES: axes}, []
    for saturation in (AXES, TWIST, WHEELS):
        if saturation != AXES:
            problem = pair_problem(drive, saturation, scales)
            starts = [problem.parameters(start) for start in _starts(drive, axes, half_track)]
            numbers[saturation] = problem.numbers(problem.best(starts, 1e-6)[0])
        errors = []
        for out in range(2):
            part = pair_problem(drive.only(block != out), saturation, scales)
            x = part.best([part.parameters(numbers[saturation])], 1e-5)[0]
            errors.append(_errors(drive.only(block == out), saturation, part.numbers(x), noise))
        held_out.append(float(np.mean(errors)))
    best = min((TWIST, WHEELS), key=lambda each: held_out[each])
    if held_out[best] > (1.0 - GAIN) * held_out[AXES]:
        best = AXES
    return best, numbers[best], (held_out[0], held_out[1], held_out[2])


def fit(drive: Drive, half_track: float = 0.2, delays: Floats = DELAYS) -> Fit:
    """Returns the fitted response of both axes, without intervals.

    Args:
        drive: what was commanded and measured.
        half_track: m, of the base, from which the search for its own starts.
        delays: s, that are tried first.
    """
    axes = fit_axes(drive, delays)
    if len(commanded(drive)) == 2:
        saturation, numbers, held_out = choose_saturation(drive, axes, half_track)
    else:
        saturation, numbers, held_out = AXES, axes, (1.0, 1.0, 1.0)
    limited = _limited(drive, saturation, numbers)
    if saturation != AXES and not limited[0]:
        saturation, numbers, limited = AXES, axes, _limited(drive, AXES, axes)
    decelerating = [False, False]
    for again in range(2):
        scales, _, rho = _scales(drive, saturation, numbers)
        problem = pair_problem(drive, saturation, scales, decelerating, limited)
        x, cost = problem.best([problem.parameters(numbers)])
        numbers, spare = problem.numbers(x), max(_count(drive, rho) - cost, 0.0)
        for axis in commanded(drive) if not again else ():
            wanted = [decelerating[0] or axis == 0, decelerating[1] or axis == 1]
            freed = pair_problem(drive, saturation, scales, wanted, limited)
            x, less = freed.best([freed.parameters(numbers)])
            left = (less + spare) / (cost + spare)
            if (less + spare) * -math.log(left) > FREE_DECELERATION or left < MUCH_BETTER:
                decelerating, numbers, cost = wanted, freed.numbers(x), less
    _, noise, rho = _scales(drive, saturation, numbers)
    response = pair_response(drive, saturation, numbers)[0]
    return Fit(saturation, numbers, response, noise, rho, (decelerating[0], decelerating[1]), limited, held_out)


def _limited(drive: Drive, saturation: int, numbers: Floats) -> tuple[bool, bool]:
    """Returns whether the drive stands long enough at the limits of each axis, or of a wheel."""
    period = float(np.median(np.diff(drive.times)))
    response = pair_response(drive, saturation, numbers)[0]
    seconds = (beyond_limits(drive, saturation, numbers, response) & drive.counted).sum(axis=1) * period
    return bool(seconds[0] >= AT_LIMIT), bool(seconds[1] >= AT_LIMIT)


def beyond_limits(drive: Drive, saturation: int, numbers: Floats, response: Floats) -> NDArray[np.bool_]:
    """Returns when (2, n) the base is at a limit while more is commanded.

    Rows are the axes, or where both share the limit, that of a wheel, and the same while it turns.
    """
    n = numbers
    raw = np.stack(
        [n[5 * k + 1] * held(drive.command_times + n[5 * k], drive.commands[:, k], drive.times) for k in range(2)]
    )
    if saturation == AXES:
        found: NDArray[np.bool_] = (np.abs(raw) > BEYOND * n[10:, None]) & (np.abs(response) > 0.95 * n[10:, None])
        return found
    wheels = np.stack([np.abs(each[0]) + n[11] * np.abs(each[1]) for each in (raw, response)])
    both = (wheels[0] > BEYOND * n[10]) & (wheels[1] > 0.95 * n[10])
    return np.stack([both, both & (n[11] * np.abs(raw[1]) > 0.2 * n[10])])


@dataclasses.dataclass(frozen=True)
class Excitation:
    """The excitation of one axis in a drive, which makes its parameters identifiable."""

    at_limit: float  # s, in which the base is at its limit while more is commanded
    slews: int  # slews that are long enough
    steps: float  # worth of its steps, in full ones
    unit: str  # of the axis
    noise: float
    fastest: float  # that the response reaches


def excitations(drive: Drive, found: Fit) -> tuple[Excitation, Excitation]:
    """Returns the excitation of each axis in a drive, by the fitted response."""
    n = found.numbers
    period = float(np.median(np.diff(drive.times)))
    sharp = n.copy()
    sharp[[4, 9]] = 1e-3  # without its lag, the response is r
    r = pair_response(drive, found.saturation, sharp)[0]
    beyond = beyond_limits(drive, found.saturation, n, found.response)
    results = []
    for k in range(2):
        top = max(float(np.abs(r[k]).max()), 1e-9)
        slope = np.diff(r[k])
        going = np.where(np.abs(slope) > 0.5 * n[5 * k + 2] * np.diff(drive.times), np.sign(slope), 0.0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0.0], going, [0.0]])))
        long = [
            j - i for i, j in itertools.pairwise(edges)
            if going[i] and j - i >= max(SLEW_SAMPLES, SLEW_LAGS * n[5 * k + 4] / period)
        ]  # fmt: skip
        noise = float(_spread((drive.speeds[:, k] - found.response[k])[drive.counted]))
        before = held(drive.command_times, drive.commands[:, k], drive.command_times - STEP_TIME)
        steps = n[5 * k + 1] * np.abs(drive.commands[:, k] - before)
        worth = _separate(drive.command_times, np.minimum(steps, 2.0 * top), STEP_NOISES * noise)
        results.append(
            Excitation(
                float((beyond[k] & drive.counted).sum()) * period,
                len(long),
                float((worth**2).sum()) / (FULL_STEP * noise) ** 2,
                ("m/s", "rad/s")[k],
                noise,
                float(np.abs(found.response[k]).max()),
            )
        )
    return results[0], results[1]


def _spread(values: Floats) -> float:
    """Returns the standard deviation of what is normal but for outliers."""
    return max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-9)


def _separate(times: Floats, steps: Floats, least: float) -> Floats:
    """Returns the steps of at least that size, the largest within STEP_TIME once."""
    found: list[float] = []
    last = -math.inf
    for t, step in zip(times.tolist(), steps.tolist(), strict=True):
        if step < least:
            continue
        if t - last > STEP_TIME:
            found.append(step)
            last = t
        else:
            found[-1] = max(found[-1], step)
    return np.array(found)


def _seen(name: str, e: Excitation, low: float, high: float) -> str:
    """Returns what to drive so that a parameter is seen; "" where it was."""
    ratio = high / low if low > 0.0 else math.inf
    reversals = "steps from standstill to top speed and back, and reversals"
    if name == "limit":
        enough = e.at_limit >= AT_LIMIT and ratio <= WIDEST
        return (
            ""
            if enough
            else f"ask for 1.3 times the top speed for 3 s both ways: it stood {e.at_limit:.1f} s at a limit"
        )
    if name == "slew":
        enough = ratio <= NARROW[0] or (e.slews >= SLEWS and ratio <= NARROW[1])
        return "" if enough else f"{reversals}: {e.slews} slews were long enough, of {SLEWS}"
    if name == "gain":
        return "" if ratio <= NARROW[0] and e.steps >= STEPS else reversals
    enough = e.steps >= STEPS and (high - low <= WIDEST_DELAY if name == "delay" else ratio <= WIDEST)
    least = FULL_STEP * e.noise
    return "" if enough else f"{STEPS} steps of at least {least:.2g} {e.unit}: there were {e.steps:.1f} worth of them"


def _estimate(kind: str, label: str, unit: str, value: float, ends: tuple[float, float], e: Excitation) -> Estimate:
    """Returns a parameter with its interval, or with the bound that is known of it."""
    missing = _seen(kind, e, *ends)
    low, high = ends
    if missing:  # a local best may lie anywhere: times are known from above, limits and slews from below
        if kind == "limit":  # it has driven so fast; the fit's limit beyond that is made up
            low = -math.inf if unit == "m" else e.fastest
        if kind != "gain":
            low, high = (-math.inf, high) if kind in ("delay", "lag") else (low, math.inf)
    return Estimate(label, unit, value, low, high, not missing, missing)


def _names(decelerating: bool) -> tuple[tuple[str, str, int], ...]:
    """Returns kind, name and number in PAIR of the parameters of an axis."""
    slews = (
        (("slew", "acceleration", 2), ("slew", "deceleration", 3)) if decelerating else (("slew", "acceleration", 2),)
    )
    return ("delay", "delay", 0), ("gain", "gain", 1), *slews, ("lag", "lag", 4)


def intervals(drive: Drive, found: Fit) -> Fit:
    """Returns the fit with an estimate of every parameter: value and interval, or a bound."""
    excited = excitations(drive, found)
    scales, _, rho = _scales(drive, found.saturation, found.numbers)
    problem = pair_problem(drive, found.saturation, scales, found.decelerating, found.limited)
    x, cost = problem.best([problem.parameters(found.numbers)])
    numbers, count = problem.numbers(x), max(cost, _count(drive, rho))
    estimates = []
    parameter = 0
    for axis, (suffix, unit) in enumerate((("v", "m/s"), ("w", "rad/s"))):
        units = {"delay": "s", "gain": "", "slew": f"{unit}^2", "lag": "s"}
        for kind, name, at in _names(found.decelerating[axis]):
            label = f"{name}_{suffix}"
            if axis not in commanded(drive):
                estimates.append(_not_driven(label, units[kind], axis))
                continue
            ends = problem.interval(x, cost, parameter, count)
            value = float(numbers[5 * axis + at])
            estimates.append(_estimate(kind, label, units[kind], value, ends, excited[axis]))
            parameter += 1
    labels = (("speed_v", "m/s"), ("speed_w", "rad/s"))
    for k, (label, unit) in enumerate(labels if found.saturation == AXES else (("wheel_speed", "m/s"), ("track", "m"))):
        if found.saturation == AXES and k not in commanded(drive):
            estimates.append(_not_driven(label, unit, k))
            continue
        if found.saturation == AXES and not found.limited[k]:
            estimates.append(_estimate("limit", label, unit, math.nan, (-math.inf, math.inf), excited[k]))
            continue
        low, high = problem.interval(x, cost, parameter, count)
        factor = 2.0 if label == "track" else 1.0
        value = factor * float(numbers[10 + k])
        estimates.append(_estimate("limit", label, unit, value, (factor * low, factor * high), excited[k]))
        parameter += 1
    response = pair_response(drive, found.saturation, numbers)[0]
    return dataclasses.replace(found, numbers=numbers, response=response, estimates=tuple(estimates))


def _not_driven(label: str, unit: str, axis: int) -> Estimate:
    """Returns the estimate of what an axis without commands says."""
    what = ("forward", "turning")[axis]
    return Estimate(label, unit, math.nan, -math.inf, math.inf, False, f"commands of the axis {what}: there were none")


def refitted(drive: Drive, found: Fit, speeds: Floats) -> dict[str, float]:
    """Returns the parameters of a fit to other speeds (n, 2), from a fit's own, by name."""
    other = dataclasses.replace(drive, speeds=np.ascontiguousarray(speeds))
    scales, _, _ = _scales(drive, found.saturation, found.numbers)
    problem = pair_problem(other, found.saturation, scales, found.decelerating, found.limited)
    numbers = problem.numbers(problem.best([problem.parameters(found.numbers)], 1e-6)[0])
    return {name: float(numbers[PAIR.index(name)]) for name in PAIR if name in {each.name for each in found.estimates}}
