"""Intervals and tests against other formulas, hand-made cases, and their own promise: how often they hold."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from interval_coverage import HOLDS, covered, designs
from oracles.table_formulas import binomial_ends, counted_ends

from wayfield.benchmarks.statistics.aggregates import counted_interval
from wayfield.benchmarks.statistics.crossed import exact_interval, share_interval, spread
from wayfield.benchmarks.statistics.paired import advantage, difference

STRATA = [f"{k}" for k in range(6) for _ in range(10)]


def column(values: object) -> np.ndarray:
    return np.asarray(values, np.float64).reshape(-1, 1)


def test_agents_and_scenarios_both_add_to_the_variance() -> None:
    """In a population whose parts are known: the estimate is right on average, and never below either part."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(300):
        agents, scenes = rng.normal(size=(1, 8)), 2.0 * rng.normal(size=(60, 1))
        table = agents + scenes + 3.0 * rng.normal(size=(60, 8))
        each = spread(table, STRATA).variance
        assert each >= table.mean(axis=0).var(ddof=1) / 8.0 - 1e-12
        found.append(each)
    assert np.mean(found) == pytest.approx(1.0 / 8 + 4.0 / 60 + 9.0 / 480, rel=0.07)


def test_a_paired_difference_of_times_is_the_paired_t_test() -> None:
    rng = np.random.default_rng(2)
    a, b = rng.normal(10.0, 2.0, 30), rng.normal(9.0, 2.0, 30)
    found = difference(column(a), column(b), ["a"] * 30)
    wanted = scipy.stats.ttest_rel(a, b)
    ends = wanted.confidence_interval()
    assert (found.value, found.p) == pytest.approx(((a - b).mean(), wanted.pvalue))
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high))


def test_a_difference_of_shares_is_that_with_a_win_and_a_loss_more() -> None:
    """Agresti and Min: of n pairs with b wins and c losses the interval lies about (b - c) / (n + 2)."""
    a, b = np.ones((60, 1)), np.ones((60, 1))
    a[:3], b[3:15] = 0.0, 0.0
    found = difference(a, b, STRATA, "share")
    assert found.value == pytest.approx((12 - 3) / 60)
    assert 0.5 * (found.low + found.high) == pytest.approx((12 - 3) / 62)
    reverse = difference(b, a, STRATA, "share")
    assert (reverse.low, reverse.high, reverse.p) == pytest.approx((-found.high, -found.low, found.p))


def test_the_interval_of_a_share_is_of_one_kind_and_never_a_point() -> None:
    one = np.ones(60)
    assert share_interval(one, STRATA) == share_interval(np.ones((60, 10)), STRATA)
    low, high = exact_interval(1.0, 60)
    assert (low, high) == (pytest.approx(0.025 ** (1.0 / 60.0)), 1.0)
    assert share_interval(one, STRATA) == (low, high)
    # of one policy it is as wide wherever it fails, in one family or in all
    for failed in (slice(0, 6), slice(0, 60, 10)):
        one = np.ones(60)
        one[failed] = 0.0
        wanted = scipy.stats.binomtest(54, 60).proportion_ci(method="exact")
        assert share_interval(one, STRATA) == pytest.approx((wanted.low, wanted.high))


def timed(failed: int, agents: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times of 60 runs, so many of which failed and count as 60 s, and who succeeded."""
    values = np.random.default_rng(6).uniform(5.0, 9.0, (60, agents))
    won = np.ones(values.shape)
    won[:failed] = 0.0
    return np.where(won == 1.0, values, 60.0), won


@given(st.integers(0, 55), st.floats(0.01, 100.0), st.floats(-50.0, 50.0))
def test_the_interval_of_such_a_mean_has_no_unit_and_holds_the_mean(failed: int, scale: float, shift: float) -> None:
    values, won = timed(failed, 3)
    low, high = counted_interval(values, won, 60.0, STRATA, resamples=50)  # type: ignore[misc]
    assert low < values.mean() < high
    found = counted_interval(scale * values + shift, won, scale * 60.0 + shift, STRATA, resamples=50)
    assert found == pytest.approx((scale * low + shift, scale * high + shift), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("failed", [0, 1, 6, 30])
def test_other_formulas_find_the_ends_of_such_a_mean(failed: int) -> None:
    values, won = timed(failed)
    runs = [(float(value), bool(each)) for value, each in zip(values.ravel(), won.ravel(), strict=True)]
    families = [runs[first : first + 10] for first in range(0, 60, 10)]
    assert counted_interval(values, won, 60.0, STRATA) == pytest.approx(counted_ends(families, 60.0), rel=0.03)


def test_an_advantage_is_its_own_complement_and_sure_of_what_always_happens() -> None:
    won, cheap, dear = np.ones((60, 1)), np.full((60, 1), 1.0), np.full((60, 1), 2.0)
    found, other = advantage(won, cheap, won, dear, STRATA), advantage(won, dear, won, cheap, STRATA)
    assert found.value == 0.5 == -other.value
    assert found.p == other.p < 1e-6
    assert found.low > 0.0


def test_differences_of_nothing_are_rarely_called_differences() -> None:
    rng = np.random.default_rng(5)
    called = 0
    for _ in range(400):
        agents = rng.normal(size=(60, 1)) + 0.5 * rng.normal(size=(1, 10)) + rng.normal(size=(60, 10))
        called += difference(agents, rng.normal(size=(60, 1)), STRATA).p < 0.05
    assert called / 400 < 0.08


# the narrowest of two kinds; the command measures all of them
@pytest.mark.parametrize("what", ["error, IQM, 7 % lost", "paired difference of success, 85 %"])
def test_intervals_hold_as_often_as_they_say(what: str) -> None:
    (index, *_) = [k for k, each in enumerate(designs()) if each.what == what and each.agents == 1]
    assert covered((index, 300, 1)) / 300 >= HOLDS - 0.02  # of 300 samples


@pytest.mark.slow
def test_all_intervals_hold() -> None:
    for index, design in enumerate(designs()):
        assert covered((index, 600, 2)) / 600 >= HOLDS - 0.015, design


@pytest.mark.parametrize(("successes", "trials"), [(0, 10), (3, 10), (10, 10), (195, 200), (9_700, 10_000)])
def test_other_formulas_find_the_ends_of_a_share_of_ten_thousand_trials_too(successes: int, trials: int) -> None:
    exact = scipy.stats.binomtest(successes, trials).proportion_ci(method="exact")
    assert binomial_ends(successes, trials) == pytest.approx((exact.low, exact.high), abs=2e-6)
