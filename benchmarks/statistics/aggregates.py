"""Aggregates over episodes: the interquartile mean, its bootstrap interval, and how often one policy beats another.

The definitions are those of Agarwal et al., "Deep reinforcement learning at the edge of the statistical precipice"
(NeurIPS 2021), where a stratum is here a family of scenarios.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from wayfield.benchmarks.statistics.crossed import enough, share_interval, spread, trimmed_mean, winsorised

Array = NDArray[np.float64]

RESAMPLES = 2_000
MANY = 25_000  # values, over which nothing is resampled
_AT_ONCE = 100  # resamples that are held together


def iqm(values: Array) -> Array:
    """Returns the interquartile mean over the last axis: the mean without the lowest and the highest quarter."""
    return trimmed_mean(values)


def mean(values: Array) -> Array:
    """Returns the mean over the last axis."""
    return np.asarray(np.mean(values, axis=-1))


def cvar(values: Array) -> Array:
    """Returns the conditional value at risk at 0.5 over the last axis: the mean of the larger half.

    Of an odd number the middle value counts half. Source: Rockafellar and Uryasev, Journal of Risk 2(3), 2000.
    """
    n = np.shape(values)[-1]
    return np.asarray(np.sort(values, axis=-1) @ np.clip(np.arange(1, n + 1) - 0.5 * n, 0.0, 1.0) / (0.5 * n))


def interval(
    values: Sequence[float] | Array,
    strata: Sequence[str],
    statistic: Callable[[Array], Array],
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> tuple[float, float] | None:
    """Returns the 95 % stratified-bootstrap interval of a statistic of the values; None where nothing is known of it.

    That is where `enough` says no, and where all scenarios of a stratum gave one number.

    Trained agents are a sample as scenarios are: where there are several, a resample draws agents and scenarios, so
    that ten agents in one scenario do not count as ten scenarios.

    A resample of n from n spreads by (n - 1) / n too little, and a spread of few values is itself uncertain: the
    percentiles are not 2.5 and 97.5 but those of -+t sqrt(n / (n - 1)) in a normal distribution, with n the scenarios
    of the smallest stratum, or the agents where they are fewer, and t Student's quantile (the expanded percentile
    interval of Hesterberg, The American Statistician 69, 2015).

    Of more than `MANY` values the bootstrap's interval is that of t to a few per cent of its width, and takes minutes:
    there the statistic -+t standard errors are returned, those of Yuen for the interquartile mean (`crossed`).

    Args:
        values: one finite number a scenario (s,), or a column for each of several trained agents (s, r).
        strata: the stratum of each scenario; every resample draws as many from each stratum as there are.
        statistic: `iqm` or `mean`; reduces the last axis.
        seed: of the resampling.

    Raises:
        ValueError: if there are no values, or not as many strata.
    """
    array, names = np.asarray(values, np.float64), np.asarray(strata)
    if not array.size or len(array) != len(names):
        raise ValueError(f"an interval needs as many values as strata and at least one, got {len(array)}, {len(names)}")
    if not enough(strata):
        return None
    table = array.reshape(len(array), -1)
    variation = spread(winsorised(table) if statistic is iqm else table, strata)
    if not variation.variance > 0.0:
        return None
    if table.size > MANY:
        middle, half = float(statistic(table.ravel())), variation.quantile * math.sqrt(variation.variance)
        return middle - half, middle + half
    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(names == name) for name in np.unique(names)]
    scenarios = np.concatenate([rng.choice(each, (resamples, len(each))) for each in members], axis=-1)
    several = table.shape[1] > 1
    agents = (
        rng.integers(table.shape[1], size=(resamples, table.shape[1])) if several else np.zeros((resamples, 1), int)
    )
    statistics = []
    for first in range(0, resamples, _AT_ONCE):
        those = slice(first, first + _AT_ONCE)
        drawn = table[scenarios[those, :, np.newaxis], agents[those, np.newaxis, :]]
        statistics.append(statistic(drawn.reshape(len(drawn), -1)))
    smallest = min(*map(len, members), table.shape[1] if table.shape[1] > 1 else len(table))
    reach = variation.quantile * math.sqrt(smallest / (smallest - 1))
    tail = float(scipy.special.ndtr(-reach))
    low, high = np.percentile(np.concatenate(statistics), [100.0 * tail, 100.0 * (1.0 - tail)])
    return float(low), float(high)


def counted_interval(
    values: Array, won: Array, failure: float, strata: Sequence[str], seed: int = 0, resamples: int = RESAMPLES
) -> tuple[float, float] | None:
    """Returns the 95 % interval of a mean in which every failure counts as something; None where nothing is known.

    That is where `enough` says no, and where no run succeeds. No resample of runs that all succeed holds a failure, so
    a bootstrap of them takes it for certain that there are none, and of few failures it often draws none either.
    Therefore the mean is taken apart, m + p (f - m), with m the mean of the successes, f that of the failures and p
    their share: the ends of p are those of `share_interval`, which leave room for failures that were not seen, those
    of m are the bootstrap's (`interval`), and both go together by the squares of their distances (Zou and Donner,
    Statistics in Medicine 27, 2008).

    Args:
        values: (s,) or (s, r), as `interval` takes them; of a failure what it counts as.
        won: 0 or 1, of the same shape.
        failure: what a failure counts as, where there is none among the values.
        strata, seed, resamples: as `interval` takes them.

    Raises:
        ValueError: as `interval`.
    """
    share = share_interval(won, strata)
    if share is None or not won.any():
        return None
    succeeded = won == 1.0
    typical = float(values[succeeded].mean())
    failed = failure if succeeded.all() else float(values[~succeeded].mean())
    low, high = interval(values - np.where(succeeded, typical, failed), strata, mean, seed, resamples) or (0.0, 0.0)
    reach = sorted((failed - typical) * (float(won.mean()) - end) for end in share)
    middle = float(values.mean())
    return middle - math.hypot(min(low, 0.0), min(reach[0], 0.0)), middle + math.hypot(
        max(high, 0.0), max(reach[1], 0.0)
    )


def better(success_a: Array, cost_a: Array, success_b: Array, cost_b: Array) -> Array:
    """Returns for each pair of episodes 1 where A did better, 0 where B did, 0.5 where neither.

    Success comes first; between two successes the lower cost is better; two failures are a draw.

    Args:
        success_a, success_b: (s,) or (s, r), 0 or 1, in the same scenarios; shapes broadcast.
        cost_a, cost_b: such as the time or the error; lower is better.
    """
    by_cost = np.where(cost_a < cost_b, 1.0, np.where(cost_a > cost_b, 0.0, 0.5))
    both = np.where((success_a == 1.0) & (success_b == 1.0), by_cost, 0.5)
    return np.where(success_a > success_b, 1.0, np.where(success_a < success_b, 0.0, both))
