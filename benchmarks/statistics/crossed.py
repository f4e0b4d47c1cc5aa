"""How far the mean over a sample of scenarios, and of trained agents, may be off: variances of a crossed design.

Scenarios are drawn within families, which are fixed; agents are drawn by their training seeds; every agent meets every
scenario. Both samples add to the variance of a mean, so ten agents in one scenario do not count as ten scenarios.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy  # special is loaded by what asks for it: 14 MB. scipy.stats has the same numbers and takes a second
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST = 5  # scenarios of a stratum, under which nothing is said about what was not driven
TRIMMED = 0.25  # at either end, of the interquartile mean


@dataclasses.dataclass(frozen=True)
class Spread:
    """The variance of a mean, and how well that is known."""

    variance: float
    freedom: float  # degrees, by Satterthwaite

    @property
    def quantile(self) -> float:
        """Returns Student's t of the two-sided 95 % interval."""
        return float(scipy.special.stdtrit(self.freedom, 0.975))


def enough(strata: Sequence[str]) -> bool:
    """Returns whether every stratum has scenarios enough for an interval."""
    return bool(len(strata)) and bool((np.unique(np.asarray(strata), return_counts=True)[1] >= LEAST).all())


def trimmed_mean(values: Array) -> Array:
    """Returns the mean over the last axis, without the lowest and the highest quarter."""
    few, count = int(TRIMMED * values.shape[-1]), values.shape[-1]
    middle = np.partition(values, (few, count - few - 1), axis=-1)[..., few : count - few]
    return np.asarray(middle.mean(axis=-1))


def spread(values: Array, strata: Sequence[str]) -> Spread:
    """Returns the variance of the mean of values (s, r), or (s, r, q) where two sets of agents meet.

    The parts of scenarios, within strata, and of each set of agents add up. What agents and scenarios do together is in
    both parts: with one set it is taken off once, and never so far that less than the greater part is left; with two
    it stays, so that the variance is too large rather than too small (Cochran, Sampling Techniques, 1977).

    Raises:
        ValueError: if a stratum has a single scenario.
    """
    table = values.reshape(len(values), -1) if values.ndim < 3 else values
    names = np.asarray(strata)
    mine = [table[names == name] for name in np.unique(names)]
    if min(map(len, mine)) < 2:
        raise ValueError("a stratum of one scenario has no spread")
    parts, freedoms = [], []
    for block in mine:
        lines = block.reshape(len(block), -1).mean(axis=1)
        parts.append((len(block) / len(table)) ** 2 * lines.var(ddof=1) / len(block))
        freedoms.append(len(block) - 1)
    of_scenarios = float(sum(parts))
    sets = [axis for axis in range(1, table.ndim) if table.shape[axis] > 1]
    for axis in sets:
        others = tuple(each for each in range(table.ndim) if each != axis)
        parts.append(table.mean(axis=others).var(ddof=1) / table.shape[axis])
        freedoms.append(table.shape[axis] - 1)
    total = float(sum(parts))
    if len(sets) == 1:
        agents = table.shape[sets[0]]
        rest = sum(_interaction(block.reshape(len(block), agents)) for block in mine)
        twice = rest / ((agents - 1) * (len(table) - len(mine))) / (len(table) * agents)
        total = max(total - twice, of_scenarios, parts[-1])
    doubt = sum(part**2 / freedom for part, freedom in zip(parts, freedoms, strict=True))
    return Spread(total, sum(parts) ** 2 / doubt if doubt > 0.0 else float(sum(freedoms)))


def _interaction(block: Array) -> float:
    """Returns the sum of squares that neither scenarios nor agents of a stratum (n, r) explain."""
    rest = block - block.mean(axis=1, keepdims=True) - block.mean(axis=0, keepdims=True) + block.mean()
    return float((rest**2).sum())


def winsorised(values: Array) -> Array:
    """Returns values whose mean varies as the interquartile mean of the given ones does, of the same shape.

    The lowest and the highest quarter take the value of their inner neighbours, and distances from the mean grow by
    N / (N - 2 g), with g values trimmed at either end of N (Tukey and McLaughlin, Sankhya A 25, 1963; Yuen, Biometrika
    61, 1974).
    """
    count = values.size
    trimmed = int(TRIMMED * count)
    order = np.sort(values, axis=None)
    held = np.clip(values, order[trimmed], order[count - trimmed - 1])
    middle = float(trimmed_mean(values.ravel()))
    return np.asarray(middle + (held - held.mean()) * count / (count - 2 * trimmed))


def exact_interval(share: float, trials: float) -> tuple[float, float]:
    """Returns the 95 % interval of a share that was seen in so many independent trials, which need not be whole.

    Source: Clopper and Pearson, Biometrika 26, 1934.

    Raises:
        ValueError: if the share is none, or there is no trial.
    """
    if not trials > 0.0 or not 0.0 <= share <= 1.0:
        raise ValueError(f"share must lie in 0..1 and trials be more than 0, got {share} of {trials}")
    won = share * trials
    low = float(scipy.special.betaincinv(won, trials - won + 1.0, 0.025)) if won > 0.0 else 0.0
    high = float(scipy.special.betaincinv(won + 1.0, trials - won, 0.975)) if won < trials else 1.0
    return low, high


def share_interval(values: Array, strata: Sequence[str]) -> tuple[float, float] | None:
    """Returns the 95 % interval of a share of successes (s,) or (s, r), 0 or 1; None where `enough` says no.

    One kind for a policy and for a set of trained agents, and no point where all succeed: that of Clopper and Pearson
    in the number of independent trials that would leave the mean as uncertain, n = p (1 - p) / variance, less for
    degrees of freedom that are few. It is never more than the scenarios that there are, and those where all or none
    succeed. Source: Korn and Graubard, Survey Methodology 24, 1998.
    """
    if not enough(strata):
        return None
    table = values.reshape(len(values), -1)
    share, trials = float(table.mean()), float(len(table))
    if table.shape[1] > 1 and 0.0 < share < 1.0:
        variation = spread(table, strata)
        if variation.variance > 0.0:
            normal = float(scipy.special.ndtri(0.975))
            trials = min(trials, share * (1.0 - share) / variation.variance * (normal / variation.quantile) ** 2)
    return exact_interval(share, trials)
