"""Estimates of what a base does with its commands, each with a 95 % interval.

Least squares over everything at once stops in the valley where delay and lag trade against each other: the delay is
tried on a grid first, each time with the best of the other parameters, and set free from the two best. The saturation
that both axes share is then fitted from there. Residuals count by Huber's loss: squares up to BEND deviations of the
noise, in proportion beyond, so that wrong messages cannot move the answers.

A value x of a parameter is inside of its interval if, with the others fitted anew,

    N log(L(x) / L_min) <= t^2 F

with L the loss, N the number of residuals, and F the ratio of the variance over blocks of the drive (delete-one
jackknife) to that of independent residuals, at least 1: it covers correlated noise, and what the model does not say.
t is Student's quantile for as many blocks as inform the parameter. Half of the interval between commands is added to
the upper end of a delay, and to all of them by how much throttled commands and rounded odometry shift the parameter
(`sampling`).

Sources: Huber, Robust Statistics, 1981; Cameron and Miller, A Practitioner's Guide to Cluster-Robust Inference, 2015.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq
from scipy.special import stdtrit

from wayfield.bridges.identify.response import (
    AXES,
    AXIS,
    PAIR,
    TWIST,
    WHEELS,
    Drive,
    Floats,
    pair_response,
)
from wayfield.bridges.identify.sampling import earlier, lateness, rounded, throttled, traced

DELAYS = np.arange(0.0, 0.5, 0.03)  # s, of the grid
LONGEST_DELAY = 0.8  # s
LAGS = (0.002, 3.0)  # s
GAIN = 0.005  # share of the loss by which a saturation must be better than the one before
TELLING = 10.0  # of the loss, by which commands between the records must be better than those that are held
BEND = 3.0  # deviations of the noise, beyond which a residual counts in proportion
FAR = 8.0  # deviations, beyond which a message is called wrong
MOST_WRONG = 0.03  # share of the messages
REPEATED = 8  # messages with one largest speed, from which on odometry may be clipped
PIECE = 2.0  # s, of the blocks of the jackknife
REGULAR = 1.5  # times the limit, up to which a likelihood that leaves it at the expected end has one ridge
NEAR = 0.2  # of the limit, within which the end is that of a straight line
FLAT = 1e-9  # of the largest eigenvalue: a direction of which a drive says nothing
ROUGH = 0.02  # of the largest command of an axis: the noise before anything is known of it
LEAST_NOISE = 1e-4  # of odometry, in its largest speed: a simulator's may have none, and no number is known so well
LEAST = 0.01, 0.02  # m/s and rad/s, of the largest command of an axis that is driven at all
WIDEST_TIME = 0.1  # s, between the ends of a delay or lag, beyond which more driving helps
WIDEST_GAIN, WIDEST = 1.25, 2.0  # ratio of the ends of a gain, and of accelerations and limits
UNKNOWN = np.array([0.0, 1.0, 1e3, 1e3, 0.1, 0.0, 1.0, 1e3, 1e3, 0.1, 1e3, 1e3])  # as PAIR, of axes without commands


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A parameter's fitted value and its interval."""

    name: str
    unit: str
    value: float  # NaN where its axis has no commands
    low: float  # -inf where the log does not bound it
    high: float  # inf where the log does not bound it
    missing: str = ""  # what to drive so that it is known better

    @property
    def bounded(self) -> bool:
        """Returns whether the interval has two ends."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if self.bounded:
            return f"{self.value:.4g}{unit} ({self.low:.4g} to {self.high:.4g})"
        if math.isfinite(self.low):
            return f"at least {self.low:.3g}{unit}"
        return f"at most {self.high:.3g}{unit}" if math.isfinite(self.high) else "not observable"


@dataclasses.dataclass(frozen=True)
class Fit:
    """The fitted response of both axes."""

    saturation: int  # AXES, TWIST or WHEELS
    numbers: Floats  # (12,), as PAIR names them
    drive: Drive  # what it is fitted to
    noise: Floats  # (2,) standard deviation of the residuals
    losses: tuple[float, float, float]  # mean loss over the noise, per saturation
    throttled: bool = False  # whether the drive's commands are those between the records, as they are not all recorded
    estimates: tuple[Estimate, ...] = ()

    def __getitem__(self, name: str) -> Estimate:
        return next(each for each in self.estimates if each.name == name)

    @functools.cached_property
    def response(self) -> Floats:
        """Returns the fitted speeds (2, n)."""
        return pair_response(self.drive, self.saturation, self.numbers)[0]

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """Returns which messages (n,) of odometry are too far off to be noise; none where many are: the model is."""
        left = np.abs(self.drive.speeds.T - self.response)
        outliers: NDArray[np.bool_] = np.any(left > FAR * self.noise[:, None], axis=0)
        return outliers if outliers.mean() <= MOST_WRONG else np.zeros_like(outliers)

    def residuals(self) -> Floats:
        """Returns measured minus fitted speeds, (2, k), of what counts and is not wrong."""
        errors: Floats = (self.drive.speeds.T - self.response)[:, self.drive.counted & ~self.wrong]
        return errors


@dataclasses.dataclass
class Problem:
    """Robust least squares of a response over groups of its numbers: delays as they are, all others by their log."""

    respond: Callable[[Floats], tuple[Floats, Floats]]  # numbers to (k,) speeds and (k, p) derivatives
    measured: Floats  # (k,)
    weights: Floats  # (k,) one over the noise
    groups: Sequence[tuple[int, ...]]  # of numbers that are one parameter
    low: Floats  # of each parameter
    high: Floats
    others: Floats  # all numbers, for those of no group
    linear: NDArray[np.bool_]  # whether a parameter is a delay
    _last: Any = None

    def numbers(self, x: Floats) -> Floats:
        """Returns the numbers of parameters."""
        inside = np.clip(x, self.low, self.high)
        values = np.where(self.linear, inside, np.exp(np.where(self.linear, 0.0, inside)))
        whole = self.others.copy()
        for group, value in zip(self.groups, values, strict=True):
            whole[list(group)] = value
        return whole

    def parameters(self, numbers: Floats) -> Floats:
        """Returns the parameters of numbers, within the bounds."""
        first = numbers[[group[0] for group in self.groups]]
        clipped: Floats = np.clip(
            np.where(self.linear, first, np.log(np.where(self.linear, 1.0, first))), self.low, self.high
        )
        return clipped

    def at(self, x: Floats) -> tuple[Floats, Floats]:
        """Returns roots (k,) of the loss of each residual, with its sign, and their derivatives (k, parameters)."""
        if self._last is None or not np.array_equal(self._last[0], x):
            numbers = self.numbers(x)
            v, slopes = self.respond(numbers)
            left = self.weights * (v - self.measured)
            size = np.abs(left)
            bent = np.sqrt(BEND * np.maximum(2.0 * size - BEND, BEND))
            roots = np.where(size <= BEND, left, np.sign(left) * bent)
            falling = self.weights * np.where(size <= BEND, 1.0, BEND / bent)
            chain = np.zeros((len(numbers), len(x)))
            for j, group in enumerate(self.groups):
                inside = self.low[j] <= x[j] <= self.high[j]
                chain[list(group), j] = inside * (1.0 if self.linear[j] else numbers[group[0]])
            self._last = x.copy(), roots, falling[:, None] * (slopes @ chain)
        return self._last[1], self._last[2]

    def solve(self, x: Floats, free: Sequence[int], tolerance: float = 1e-9, most: int = 60) -> tuple[Floats, float]:
        """Returns the best parameters from a start, and their loss; those that are not free stay."""
        chosen = list(free)

        def whole(part: Floats) -> Floats:
            vector = x.copy()
            vector[chosen] = part
            return vector

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

    def interval(
        self, best: Floats, cost: float, index: int, count: float, pieces: "Pieces", unsure: float, far: Floats | None
    ) -> tuple[float, float]:
        """Returns the ends of a parameter's interval, in its own unit; -inf and inf where the bounds are inside.

        Args:
            best: the parameters of least loss.
            cost: their loss.
            index: of the parameter.
            count: of independent measurements; more than the cost where the noise is taken as more than what is left.
            pieces: the variance over blocks.
            unsure: by how much the parameter may be off by what commands did between their records.
            far: parameters with this one at its upper bound, if no path of small steps may lead there.
        """
        spare = max(count - cost, 0.0)
        deviation, reach = pieces.spread(np.eye(len(best))[index])
        deviation *= math.sqrt((cost + spare) / count)
        ahead = pieces.covariance[:, index] / max(pieces.covariance[index, index], 1e-18)
        limit = reach**2 / count
        ends = [self._end(best, cost, spare, index, side, limit, reach * deviation, ahead) for side in (-1.0, 1.0)]
        if far is not None:
            squares = self.solve(far, [j for j in range(len(best)) if j != index], 1e-5, 25)[1]
            if math.log((squares + spare) / (cost + spare)) <= limit:
                ends[1] = math.inf
        low, high = (
            best[index] + math.copysign(math.hypot(end - best[index], unsure), side)
            for end, side in zip(ends, (-1.0, 1.0), strict=True)
        )
        if not self.linear[index]:
            low, high = math.exp(low), math.exp(high)
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

        def root(distance: float, start: Floats, at: float, ways: int = 2) -> tuple[float, Floats]:
            solutions: list[tuple[float, Floats]] = []
            for along in (1.0, 0.0)[:ways]:  # to first order the others move along, of which what is flat may go astray
                x = np.clip(start + along * ahead * (side * (distance - at)), self.low, self.high)
                x[index] = best[index] + side * distance
                x, squares = self.solve(x, free, 1e-5, 25)
                ratio = math.log((max(squares, 1e-300) + spare) / (cost + spare))
                solutions.append((math.sqrt(max(ratio, 0.0)), x))
                if solutions[-1][0] <= wanted:
                    break
            return min(solutions, key=lambda each: each[0])

        inner, inner_root, start = 0.0, 0.0, best
        outer = min(max(step, 1e-6), 0.5)
        while True:
            outer = min(outer, room)
            outer_root, x = root(outer, start, inner)
            if inner == 0.0 and abs(outer_root - wanted) < NEAR * wanted:
                return float(best[index] + side * outer * wanted / outer_root)
            if inner == 0.0 and wanted < outer_root < REGULAR * wanted:
                break
            if outer_root <= wanted:
                if outer >= room:
                    return side * math.inf
                inner, inner_root, start, outer = outer, outer_root, x, 2.0 * outer
                continue
            far = min(2.0 * outer, room)  # beyond a ridge the loss may fall again
            far_root, x = root(far, x, outer)
            if far_root > wanted:
                break
            inner, inner_root, start, outer = far, far_root, x, 2.0 * far
            if far >= room:
                return side * math.inf
        for _ in range(12):
            share = (wanted - inner_root) / (outer_root - inner_root)
            middle = inner + min(max(share, 0.1), 0.9) * (outer - inner)
            middle_root, x = root(middle, start, inner, 1)
            if abs(middle_root - wanted) < 0.03 * wanted:
                inner = middle
                break
            if middle_root < wanted:
                inner, inner_root, start = middle, middle_root, x
            else:
                outer, outer_root = middle, middle_root
        return float(best[index] + side * inner)


@dataclasses.dataclass(frozen=True)
class Pieces:
    """The information of a fit by blocks of its drive, and what leaving each of them out does to the parameters."""

    covariance: Floats  # (p, p) of independent residuals of deviation 1
    information: Floats  # (b, p, p)
    shifts: Floats  # (b, p) of the parameters without a block, to first order

    @classmethod
    def of(cls, problem: Problem, x: Floats, blocks: NDArray[np.int64]) -> "Pieces":
        """Returns those of the best parameters; `blocks` (k,) says to which one a residual belongs."""
        errors, slopes = problem.at(x)
        size = np.sqrt(np.maximum((slopes**2).sum(axis=0), 1e-300))
        scaled = slopes / size
        order = np.argsort(blocks, kind="stable")
        parts = np.split(order, np.flatnonzero(np.diff(blocks[order])) + 1)
        information = np.stack([scaled[part].T @ scaled[part] for part in parts])
        whole = information.sum(axis=0)
        shifts = [
            np.linalg.pinv(whole - own, FLAT, hermitian=True) @ (scaled[part].T @ errors[part])
            for own, part in zip(information, parts, strict=True)
        ]
        both = np.outer(size, size)
        return cls(np.linalg.pinv(whole, FLAT, hermitian=True) / both, information * both, np.stack(shifts) / size)

    def spread(self, direction: Floats) -> tuple[float, float]:
        """Returns the deviation of a sum of parameters for independent residuals, and the reach of its interval in it.

        The reach is Student's quantile, times the root of the ratio of the jackknife's variance to the other if that is
        more than 1.
        """
        through = self.covariance @ direction
        variance = max(float(direction @ through), 1e-18)
        shares = np.einsum("i,bij,j->b", through, self.information, through) / variance
        informing = 1.0 / max(float((shares**2).sum()), 1e-3) - 1.0
        n = len(self.shifts)
        over = (n - 1) / n * float(((self.shifts @ direction) ** 2).sum())
        quantile = float(stdtrit(min(max(informing, 2.0), 1e4), 0.975))
        return math.sqrt(variance), quantile * math.sqrt(max(1.0, over / variance))


def fit_axis(drive: Drive, axis: int, delays: Floats = DELAYS) -> Floats:
    """Returns the numbers of PAIR of an axis that saturates by itself and slows down as it speeds up.

    Args:
        drive: what was commanded and measured.
        axis: 0, forward, or 1, yaw.
        delays: s, that are tried first.
    """
    largest = float(np.abs(drive.commands[:, axis]).max())
    problem = pair_problem(drive, AXES, np.full(2, ROUGH * largest), alone=axis)
    fastest = float(np.quantile(np.abs(problem.measured), 0.98))
    starts = []
    for limit in (1.02 * fastest, 2.0 * largest):
        for slew, lag in ((1.0, 0.2), (6.0, 0.05)):
            numbers = UNKNOWN.copy()
            numbers[5 * axis : 5 * axis + 5] = delays[0], 1.0, slew * largest, slew * largest, lag
            numbers[10 + axis] = limit
            starts.append(problem.parameters(numbers))
    free = range(1, 5)
    solutions: list[tuple[Floats, float]] = []
    for delay in delays:
        starts = [np.concatenate([[delay], x[1:]]) for x in (starts if not solutions else [solutions[-1][0]])]
        solutions.append(min((problem.solve(x, free, 1e-6, 40) for x in starts), key=lambda each: each[1]))
    solutions.sort(key=lambda each: each[1])
    x, _ = problem.best([each for each, _ in solutions[:2]])
    return problem.numbers(x)


def pair_problem(
    drive: Drive, saturation: int, noise: Floats, fixed: Mapping[int, float] | None = None, alone: int | None = None
) -> Problem:
    """Returns the least squares of both axes, each divided by its noise.

    Args:
        drive: what was commanded and measured.
        saturation: AXES, TWIST or WHEELS.
        noise: (2,) standard deviation of each axis.
        fixed: values of numbers, by their place in PAIR, that stay as they are.
        alone: an axis, 0 or 1, that is fitted without the other, with its deceleration as its acceleration.
    """
    counted, fixed, axes = drive.counted, fixed or {}, (0, 1) if alone is None else (alone,)
    largest = np.maximum(np.abs(drive.commands).max(axis=0), 1e-6)

    def respond(numbers: Floats) -> tuple[Floats, Floats]:
        v, slopes = pair_response(drive, saturation, numbers, axes)
        return v[:, counted].ravel(), slopes[:, counted].reshape(-1, len(PAIR))

    ranges: dict[int, tuple[float, float]] = {}
    for axis in commanded(drive) if alone is None else axes:
        reach = 0.05 * largest[axis], 200.0 * largest[axis]
        ends = (1.0, math.exp(LONGEST_DELAY)), (0.2, 5.0), reach, reach, LAGS
        ranges |= {5 * axis + k: each for k, each in enumerate(ends)}
        if saturation == AXES:
            ranges[10 + axis] = 0.02 * largest[axis], 4.0 * largest[axis]
    if saturation != AXES:
        ranges |= {10: (0.02 * largest[0], 4.0 * largest[0] + 4.0 * largest[1]), 11: (0.02, 5.0)}
    free = sorted(ranges.keys() - fixed.keys() - (set() if alone is None else {3, 8}))
    low, high = np.log(np.array([ranges[k] for k in free])).T
    others = UNKNOWN.copy()
    others[list(fixed)] = list(fixed.values())
    measured = drive.speeds[counted][:, axes].T.ravel()
    weights = np.repeat(1.0 / noise[list(axes)], counted.sum())
    groups = [(each,) if alone is None or each not in (2, 7) else (each, each + 1) for each in free]
    return Problem(respond, measured, weights, groups, low, high, others, np.isin(free, (0, 5)))


def commanded(drive: Drive) -> tuple[int, ...]:
    """Returns the axes that are commanded at all: 0, forward, and 1, yaw."""
    return tuple(axis for axis in range(2) if np.abs(drive.commands[:, axis]).max(initial=0.0) >= LEAST[axis])


def fit_axes(drive: Drive, delays: Floats = DELAYS) -> Floats:
    """Returns the numbers of PAIR of two axes that saturate by themselves; UNKNOWN of one without commands."""
    numbers = UNKNOWN.copy()
    for axis in commanded(drive):
        own = [*range(5 * axis, 5 * axis + 5), 10 + axis]
        numbers[own] = fit_axis(drive, axis, delays)[own]
    return numbers


def noise_of(drive: Drive, response: Floats) -> Floats:
    """Returns the deviation (2,) of the residuals of each axis.

    It is that of a normal distribution whose nine tenths of least size are as large: wrong messages are in the tenth.
    """
    sizes = np.abs(drive.speeds.T - response)
    fastest = np.quantile(np.abs(drive.speeds), 0.98, axis=0)
    free = drive.counted[:, None] & (drive.reported[0] < drive.speeds) & (drive.speeds < drive.reported[1])
    nine = [float(np.quantile(sizes[axis, free[:, axis]], 0.9)) for axis in range(2)]
    noise: Floats = np.maximum(np.array(nine) / 1.6449, LEAST_NOISE * np.maximum(fastest, 1e-3))
    return noise


def _starts(drive: Drive, numbers: Floats, half_track: float) -> list[Floats]:
    """Returns starts of a saturation that both axes share.

    An axis by itself may be fitted without any limit where the other one mostly slows it: the measured speeds say where
    wheels saturate, and gains of 1 are tried as well.
    """
    fastest = np.quantile(np.abs(drive.speeds[drive.counted]), 0.98, axis=0)
    measured = float(fastest[0] / max(fastest[1], 1e-6))
    starts = []
    for half, gained in ((measured, True), (measured, False), (half_track, True), (1.6 * half_track, True)):
        start = numbers.copy()
        start[10:] = max(fastest[0], half * fastest[1]), half
        if not gained:
            start[[1, 6]] = 1.0
        starts.append(start)
    return starts


def choose_saturation(drive: Drive, axes: Floats, half_track: float) -> tuple[int, Floats, tuple[float, float, float]]:
    """Returns the saturation that fits a drive best; all have as many parameters.

    Args:
        drive: what was commanded and measured.
        axes: the numbers of PAIR of axes that saturate by themselves, which stay unless another is better.
        half_track: m, from which the search for half of the track starts.

    Returns:
        The saturation, its numbers, and the errors of all three: mean loss over noise.
    """
    noise = noise_of(drive, pair_response(drive, AXES, axes)[0])
    numbers: list[Floats] = []
    losses: list[float] = []
    for saturation in (AXES, TWIST, WHEELS):
        problem = pair_problem(drive, saturation, noise)
        starts = [axes] if saturation == AXES else [*_starts(drive, axes, half_track), *numbers[1:]]
        x, loss = problem.best([problem.parameters(each) for each in starts], 1e-6)
        numbers.append(problem.numbers(x))
        losses.append(loss / len(problem.measured))
    best = min((TWIST, WHEELS), key=lambda each: losses[each])
    if losses[AXES] - losses[best] < GAIN * max(losses[AXES], 1.0):  # below 1 there is no noise to speak of
        best = AXES
    return best, numbers[best], (losses[0], losses[1], losses[2])


def fit(drive: Drive, half_track: float = 0.2, delays: Floats = DELAYS) -> Fit:
    """Returns the fitted response of both axes, without intervals.

    Where odometry seems to be clipped, it is taken as such if it is explained better than by limits of the base.

    Args:
        drive: what was commanded and measured.
        half_track: m, of the base, from which the search for its own starts.
        delays: s, that are tried first.
    """
    reported = clipped(drive)
    if not np.array_equal(reported, drive.reported):
        whole = dataclasses.replace(drive, reported=reported)
        limited, cut = _fit(drive, half_track, delays), _fit(whole, half_track, delays)
        return cut if _loss(cut, cut.noise) < _loss(limited, cut.noise) - TELLING else limited
    return _fit(drive, half_track, delays)


def clipped(drive: Drive) -> Floats:
    """Returns the range (2, 2) that odometry reports if it is clipped where it repeats its largest values."""
    reported = drive.reported.copy()
    for axis, speeds in enumerate(drive.speeds.T):
        for side, sign in enumerate((-1.0, 1.0)):
            values, counts = np.unique(sign * speeds, return_counts=True)
            beyond = len(speeds) - np.cumsum(counts)
            likely = (
                (values >= 0.0) & (beyond <= MOST_WRONG * len(speeds)) & (counts >= np.maximum(REPEATED, 5 * beyond))
            )
            if likely.any() and (sign * drive.commands[:, axis]).max() > (most := float(values[likely][0])):
                reported[side, axis] = sign * most
    return reported


def _fit(drive: Drive, half_track: float, delays: Floats) -> Fit:
    """Returns the fitted response of a drive whose odometry is clipped where the drive says so."""
    axes = fit_axes(drive, delays)
    if len(commanded(drive)) == 2:
        saturation, start, losses = choose_saturation(drive, axes, half_track)
    else:
        saturation, start, losses = AXES, axes, (1.0, 1.0, 1.0)
    fitted = _again(Fit(saturation, start, drive, np.ones(2), losses), drive)
    fitted = _again(fitted, drive.only(~fitted.wrong))
    other = _again(dataclasses.replace(fitted, throttled=True), earlier(fitted.drive, 0.5, lateness(drive)))
    return other if _loss(other, fitted.noise) < _loss(fitted, fitted.noise) - TELLING else fitted


def _again(fitted: Fit, drive: Drive) -> Fit:
    """Returns a fit that starts from another, of the same saturation, to the same drive with changes."""
    noise = noise_of(drive, pair_response(drive, fitted.saturation, fitted.numbers)[0])
    problem = pair_problem(drive, fitted.saturation, noise)
    numbers = problem.numbers(problem.best([problem.parameters(fitted.numbers)])[0])
    noise = noise_of(drive, pair_response(drive, fitted.saturation, numbers)[0])
    return dataclasses.replace(fitted, numbers=numbers, drive=drive, noise=noise)


def _loss(fitted: Fit, noise: Floats) -> float:
    """Returns the loss of a fit, of residuals over a noise."""
    problem = pair_problem(fitted.drive, fitted.saturation, noise)
    return float((problem.at(problem.parameters(fitted.numbers))[0] ** 2).sum())


def refitted(fitted: Fit, drive: Drive, fixed: Mapping[int, float]) -> Floats:
    """Returns the numbers of a fit to another part of its drive, of which some stay as they are."""
    numbers = fitted.numbers.copy()
    numbers[list(fixed)] = list(fixed.values())
    problem = pair_problem(drive, fitted.saturation, fitted.noise, fixed)
    return problem.numbers(problem.best([problem.parameters(numbers)])[0])


def intervals(fitted: Fit) -> Fit:
    """Returns the fit with an estimate of every parameter, and of delay and lag together, which trade."""
    drive = fitted.drive
    problem = pair_problem(drive, fitted.saturation, fitted.noise)
    x, cost = problem.best([problem.parameters(fitted.numbers)])
    numbers = problem.numbers(x)
    count = max(cost, float(drive.counted.sum() * len(commanded(drive))))
    blocks = (drive.times[drive.counted] // PIECE).astype(np.int64)
    pieces = Pieces.of(problem, x, np.concatenate([blocks, blocks]))
    late = lateness(drive)
    coarse = rounded(drive, fitted.response.T, fitted.noise)
    changed = [coarse] if coarse else []
    if late > 0.0:
        v, slopes = problem.respond(numbers)
        left = (problem.weights * (v - problem.measured)).reshape(2, -1)  # both axes, one after the other
        slopes = (problem.weights * slopes[:, [0, 5]].sum(axis=1)).reshape(2, -1)
        span = 2.0 * late if fitted.throttled else traced(late, left, slopes, blocks)
        changed.append(throttled(drive, span))
    again = [[pair_problem(one, fitted.saturation, fitted.noise) for one in each] for each in changed]
    shifts = [np.stack([one.solve(x, range(len(x)), 1e-4, 20)[0] for one in each]) - x for each in again]
    places = [group[0] for group in problem.groups]
    estimates = []
    for place, (name, unit) in enumerate(_labels(fitted.saturation)):
        if place not in places:
            what = ("forward", "turning")[place - 10 if place > 9 else place // 5]
            advice = f"commands of the axis {what}: there were none"
            estimates.append(Estimate(name, unit, math.nan, -math.inf, math.inf, advice))
            continue
        factor = 2.0 if name == "track" else 1.0
        index = places.index(place)
        far = _unlimited(problem, x, place, fitted) if name.startswith(("speed", "wheel")) else None
        unsure = _size([each[:, index] for each in shifts])
        low, high = (factor * end for end in problem.interval(x, cost, index, count, pieces, unsure, far))
        if place % 5 in (0, 4) and place < 10:
            low = max(low, 0.0)
        if place in (0, 5):
            high = min(high + late, 1.0)
        each = Estimate(name, unit, factor * float(numbers[place]), low, high)
        estimates.append(dataclasses.replace(each, missing=_missing(each, late)))
        if place in (4, 9):
            direction = np.zeros(len(x))
            direction[places.index(place - 4)], direction[index] = 1.0, numbers[place]
            deviation, reach = pieces.spread(direction)
            half = math.hypot(reach * deviation, _size([each @ direction for each in shifts]))
            total = float(numbers[place - 4] + numbers[place])
            label = f"delay_{name[-1]} + lag_{name[-1]}"
            estimates.append(Estimate(label, "s", total, max(total - half, 0.0), total + half + late))
    return dataclasses.replace(fitted, numbers=numbers, estimates=tuple(estimates))


def _unlimited(problem: Problem, x: Floats, place: int, fitted: Fit) -> Floats:
    """Returns parameters without a limit, whose gains are so much less that commands just reach it instead."""
    numbers, places = problem.numbers(x), [group[0] for group in problem.groups]
    v, w = np.abs(fitted.drive.commands * numbers[[1, 6]]).T
    demand = (v, w)[place - 10] if fitted.saturation == AXES else v + numbers[11] * w
    far = x.copy()
    far[places.index(place)] = problem.high[places.index(place)]
    for gain in (5 * (place - 10) + 1,) if fitted.saturation == AXES else (1, 6):
        far[places.index(gain)] += min(math.log(numbers[place] / demand.max()), 0.0)
    return np.clip(far, problem.low, problem.high)


def _size(shifts: Sequence[Floats]) -> float:
    """Returns how far independent causes shift a parameter, of the shifts at each one's phases."""
    return math.hypot(*(math.sqrt(float((each**2).mean())) for each in shifts))


def _labels(saturation: int) -> list[tuple[str, str]]:
    """Returns name and unit of the numbers of PAIR."""
    units = [(f"{name}_{axis}", unit) for axis, speed in (("v", "m/s"), ("w", "rad/s"))
             for name, unit in zip(AXIS, ("s", "", f"{speed}^2", f"{speed}^2", "s"), strict=True)]  # fmt: skip
    own, shared = [("speed_v", "m/s"), ("speed_w", "rad/s")], [("wheel_speed", "m/s"), ("track", "m")]
    return units + (own if saturation == AXES else shared)


def _missing(each: Estimate, late: float) -> str:
    """Returns what to drive where an interval is wide; "" where it is not."""
    kind, _, axis = each.name.partition("_")
    turning = axis == "w" or each.name == "track"
    ratio = each.high / each.low if each.low > 0.0 else math.inf
    if kind in ("delay", "lag"):
        wide = each.high - each.low > WIDEST_TIME + (late if kind == "delay" else 0.0)
        drive = "turn on the spot five times" if turning else "drive off and stop five times"
    elif kind in ("speed", "wheel", "track"):
        wide = ratio > WIDEST
        drive = "turn on the spot at 1.3 times the top yaw rate" if turning else "ask for 1.3 times the top speed"
        drive += " for 3 s, both ways"
    else:
        wide = ratio > (WIDEST_GAIN if kind == "gain" else WIDEST)
        drive = f"{'turn' if turning else 'drive'} from standstill to top speed and back, five times"
    interval = f"interval {each.low:.3g} to {each.high:.3g}" if each.bounded else str(each)
    unit = f" {each.unit}" if each.unit and each.bounded else ""
    return f"{interval}{unit}: {drive}" if wide else ""
