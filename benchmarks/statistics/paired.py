"""Paired comparisons: the difference that two policies show in the same scenarios, its interval and its p."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from wayfield.benchmarks.statistics.aggregates import better, iqm
from wayfield.benchmarks.statistics.crossed import enough, exact_interval, spread, winsorised

Array = NDArray[np.float64]

SIGNIFICANT = 0.05  # of a p after Holm's correction


@dataclasses.dataclass(frozen=True)
class Difference:
    """A less B over the scenarios that both met; NaN where nothing is said beyond what was driven."""

    value: float
    low: float  # of the 95 % interval
    high: float
    p: float  # two-sided, of no difference; before any correction
    limit: float = 0.0  # of a share: how large it may be to either side, by `exact_limit`


def difference(
    a: Array, b: Array, strata: Sequence[str], reduction: Literal["mean", "iqm", "share"] = "mean", dearer: float = 0.0
) -> Difference:
    """Returns the paired difference of a number that both have in each scenario, with the interval of its t-test.

    Of sets of trained agents every one meets every one, and the agents are a sample too (`crossed.spread`).

    Args:
        a, b: (s, r) and (s, q), a line a scenario, a column an agent.
        strata: of the scenarios.
        reduction: "mean"; "iqm" takes the interquartile mean of the differences (the trimmed t-test of Yuen,
            Biometrika 61, 1974); "share" is a mean of successes, 0 or 1, to which two scenarios are added, one in each
            of which either wins by half, so that two policies that never fail differ by nothing
            (Agresti and Min, Statistics in Medicine 24, 2005).
        dearer: of a mean of costs, how much more a failure counts than a success: the same two scenarios are added,
            since where failures are few, no more are seen in many a sample than their mean allows for.
    """
    pairs = a[:, :, np.newaxis] - b[:, np.newaxis, :]
    tested = _tested(pairs, strata, reduction, 1.0 if reduction == "share" else dearer**2)
    if reduction != "share" or math.isnan(tested.low):
        return tested
    means = pairs.mean(axis=(1, 2))
    limit = exact_limit(float(means.clip(0.0).sum()), float(-means.clip(None, 0.0).sum()), len(means))
    return dataclasses.replace(tested, limit=limit)


def exact_limit(won: float, lost: float, scenarios: int) -> float:
    """Returns how large a difference of two shares may be to either side, by how often either alone succeeds.

    Two-sided, 95 %: the exact limits of both shares, put together as their errors add, so that with no scenario lost,
    or none won, it is the exact limit of the other share alone. It needs no scenario that nobody drove; that agents are
    a sample too, it does not know. Sources: Clopper and Pearson, Biometrika 26, 1934; Zou and Donner, Statistics in
    Medicine 27, 2008.

    Args:
        won, lost: scenarios in which one alone succeeds; of several agents the sums of their means, which need not be
            whole.
    """
    ends = [(share, *exact_interval(share, scenarios)) for share in (won / scenarios, lost / scenarios)]
    return max(
        one - other + math.hypot(high - one, other - low) for (one, _, high), (other, low, _) in (ends, ends[::-1])
    )


def of_pairs(pairs: Array, strata: Sequence[str], reduction: Literal["mean", "iqm"]) -> Difference:
    """Returns the difference of pairs (s, r, q) that are there already, a line a scenario, as `difference`."""
    return _tested(pairs, strata, reduction, 0.0)


def advantage(won_a: Array, cost_a: Array, won_b: Array, cost_b: Array, strata: Sequence[str]) -> Difference:
    """Returns how much more often than in half of the scenarios A does better than B, as `aggregates.better` has it.

    A share of 1 lies 0.5 above. One win and one loss are added, as in `difference`.
    """
    won = won_a[:, :, np.newaxis], won_b[:, np.newaxis, :]
    wins = better(won[0], cost_a[:, :, np.newaxis], won[1], cost_b[:, np.newaxis, :])
    return _tested(wins - 0.5, strata, "mean", 0.5)


def _tested(pairs: Array, strata: Sequence[str], reduction: str, added: float) -> Difference:
    """Returns the reduction of pairs (s, r, q), with an interval and a p.

    Args:
        added: sum of the squares of two scenarios that are added, whose own sum is nothing.
    """
    value = float(iqm(pairs.ravel()) if reduction == "iqm" else pairs.mean())
    if not enough(strata):
        return Difference(value, math.nan, math.nan, math.nan)
    variation = spread(winsorised(pairs) if reduction == "iqm" else pairs, strata)
    count = len(pairs)
    shrunk = count / (count + 2) if added else 1.0
    middle = value * shrunk
    error = math.sqrt(variation.variance * shrunk**2 + added / (count + 2) ** 2)
    if not error > 0.0:
        return Difference(value, math.nan, math.nan, math.nan)
    p = 2.0 * float(scipy.special.stdtr(variation.freedom, -abs(middle) / error))
    return Difference(value, middle - variation.quantile * error, middle + variation.quantile * error, p)


def holm(ps: Sequence[float]) -> list[float]:
    """Returns each p, corrected for the number of them, by Holm's method; those that are NaN stay so and do not count.

    Source: Holm, Scandinavian Journal of Statistics 6, 1979.
    """
    array = np.asarray(ps, np.float64)
    corrected = np.full(len(array), np.nan)
    order = [int(k) for k in np.argsort(array) if not math.isnan(array[k])]
    least = 0.0
    for rank, k in enumerate(order):
        least = max(least, min(1.0, (len(order) - rank) * float(array[k])))
        corrected[k] = least
    return corrected.tolist()
