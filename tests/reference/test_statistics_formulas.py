"""The statistics of the tables in plain loops: spreads, shares, paired tests, Holm's correction."""

import itertools
import math
import statistics
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import pytest
import scipy.special

from wayfield.benchmarks.statistics import aggregates, crossed
from wayfield.benchmarks.statistics.aggregates import iqm
from wayfield.benchmarks.statistics.crossed import exact_interval, share_interval, spread, winsorised
from wayfield.benchmarks.statistics.paired import Difference, advantage, difference, holm

SEEDS = range(6)


def sample(seed: int, agents: int, kind: str = "errors") -> tuple[Any, list[str]]:
    """Returns values (s, r) of scenarios of unequal families, in no order, and their families."""
    rng = np.random.default_rng([seed, agents])
    strata = [str(name) for name in rng.permutation(["a"] * 5 + ["b"] * 8 + ["c"] * (5 + seed))]
    level = np.array([{"a": 1.0, "b": 1.6, "c": 0.3}[name] for name in strata])[:, None]
    values = level * np.exp(0.4 * rng.normal(size=(len(strata), 1)) + 0.3 * rng.normal(size=(1, agents)))
    values = values * np.exp(0.2 * rng.normal(size=values.shape))
    return ((values < 1.4).astype(float) if kind == "shares" else values), strata


def variance(numbers: Sequence[float]) -> float:
    """Returns that of a sample."""
    middle = sum(numbers) / len(numbers)
    return sum((each - middle) ** 2 for each in numbers) / (len(numbers) - 1)


def trimmed(numbers: Sequence[float]) -> float:
    """Returns the mean of what is left without the lowest and the highest quarter, rounded down."""
    cut = len(numbers) // 4
    kept = sorted(numbers)[cut : len(numbers) - cut]
    return sum(kept) / len(kept)


def quantile(freedom: float) -> float:
    """Returns Student's t, two-sided, of 95 %."""
    return float(scipy.special.stdtrit(freedom, 0.975))


def spread_of(table: Any, strata: Sequence[str]) -> tuple[float, float]:
    """Returns the variance of the mean of a table (s, r) or (s, r, q), and its degrees of freedom."""
    table = np.asarray(table, float)
    table = table.reshape(len(table), -1) if table.ndim < 3 else table
    parts = []
    for name in sorted(set(strata)):
        means = [float(line.mean()) for line, each in zip(table, strata, strict=True) if each == name]
        parts.append((variance(means) * len(means) / len(table) ** 2, len(means) - 1))
    of_scenarios = sum(part for part, _ in parts)
    sets = [axis for axis in (1, 2) if axis < table.ndim and table.shape[axis] > 1]
    for axis in sets:
        columns = [float(np.take(table, k, axis).mean()) for k in range(table.shape[axis])]
        parts.append((variance(columns) / len(columns), len(columns) - 1))
    total = sum(part for part, _ in parts)
    if len(sets) == 1:
        flat = table.reshape(len(table), -1)
        agents, rest = flat.shape[1], 0.0
        for name in set(strata):
            block = flat[[each == name for each in strata]]
            for i, j in itertools.product(range(len(block)), range(agents)):
                rest += (block[i, j] - block[i].mean() - block[:, j].mean() + block.mean()) ** 2
        square = rest / ((agents - 1) * (len(flat) - len(set(strata))))
        total = max(total - square / flat.size, of_scenarios, parts[-1][0])
    doubt = sum(part**2 / freedom for part, freedom in parts)
    everything = sum(part for part, _ in parts)
    return total, (everything**2 / doubt if doubt > 0.0 else sum(freedom for _, freedom in parts))


def held_values(table: Any) -> Any:
    """Returns a table whose outer quarters take the values of their inner neighbours, stretched about its IQM."""
    order = sorted(float(each) for each in table.ravel())
    cut = len(order) // 4
    low, high = order[cut], order[len(order) - cut - 1]
    held = np.array([min(max(each, low), high) for each in table.ravel().tolist()])
    stretched = [(each - held.mean()) * len(order) / (len(order) - 2 * cut) for each in held.tolist()]
    return (trimmed(order) + np.array(stretched)).reshape(table.shape)


def paired(pairs: Any, strata: Sequence[str], robust: bool, added: float) -> Difference:
    """Returns the value of pairs (s, r, q), with Student's interval and p, two scenarios added where asked for."""
    numbers = [float(each) for each in pairs.ravel()]
    value = trimmed(numbers) if robust else sum(numbers) / len(numbers)
    found, freedom = spread_of(held_values(pairs) if robust else pairs, strata)
    count = len(pairs)
    middle = value * count / (count + 2) if added else value
    error = math.sqrt((found * count**2 + added) / (count + 2) ** 2) if added else math.sqrt(found)
    p = 2.0 * float(scipy.special.stdtr(freedom, -abs(middle) / error))
    reach = quantile(freedom) * error
    return Difference(value, middle - reach, middle + reach, p)


def same(found: Difference, wanted: Difference) -> None:
    """Asserts that two differences are one, to rounding."""
    for name in ("value", "low", "high", "p"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-9, abs=1e-12), name


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("agents", [1, 2, 7])
def test_the_spread_of_a_mean(seed: int, agents: int) -> None:
    values, strata = sample(seed, agents)
    tables = [values, values[:, 0], values[:, :, None] - sample(seed, 3)[0][:, None, :], values * 0.0]
    tables.append(values[:, 0:1] + 0.001 * np.arange(agents))  # agents that differ, and alike in every scenario
    tables.append(np.random.default_rng(seed).normal(size=values.shape))  # nothing but chance
    for table in tables:
        found = spread(table, strata)
        wanted = spread_of(table, strata)
        assert (found.variance, found.freedom) == pytest.approx(wanted, rel=1e-9, abs=1e-15)
        assert found.quantile == pytest.approx(quantile(wanted[1]), rel=1e-9)


@pytest.mark.parametrize("shape", [(4,), (7,), (8, 3), (9, 1), (6, 2, 3)])
def test_what_stands_for_an_interquartile_mean_in_a_t_test(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(len(shape)).normal(size=shape) ** 3
    assert winsorised(values) == pytest.approx(held_values(values), rel=1e-12)
    assert float(iqm(values.ravel())) == pytest.approx(trimmed(values.ravel().tolist()), rel=1e-12)
    assert iqm(values) == pytest.approx(np.array([trimmed(row) for row in values.reshape(-1, shape[-1])]).reshape(
        shape[:-1]), rel=1e-12)  # fmt: skip


def test_a_stratum_says_nothing_under_five_scenarios_and_has_no_spread_under_two() -> None:
    assert crossed.LEAST == 5
    assert not crossed.enough([])
    assert crossed.enough(["a"] * 5 + ["b"] * 5)
    assert not crossed.enough(["a"] * 5 + ["b"] * 4)
    assert spread(np.array([1.0, 3.0]), ["a", "a"]).variance == pytest.approx(1.0)
    with pytest.raises(ValueError, match="one scenario"):
        spread(np.array([1.0, 3.0, 2.0]), ["a", "a", "b"])


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.96, 1.0])
@pytest.mark.parametrize("trials", [3.0, 7.5, 50.0, 400.0])
def test_the_ends_of_a_share_leave_a_fortieth_outside_on_either_side(share: float, trials: float) -> None:
    low, high = exact_interval(share, trials)
    won = share * trials
    # the chance of at least, and of at most, so many successes
    at_least = scipy.special.betainc(won, trials - won + 1.0, low) if won > 0.0 else 0.025
    at_most = scipy.special.betaincc(won + 1.0, trials - won, high) if won < trials else 0.025
    assert (at_least, at_most) == pytest.approx((0.025, 0.025), rel=1e-3)
    assert (low == 0.0) == (share == 0.0)
    assert (high == 1.0) == (share == 1.0)


@pytest.mark.parametrize(("share", "trials"), [(-0.1, 5.0), (0.5, 0.0), (math.nan, 5.0)])
def test_no_share_and_no_trials_are_refused(share: float, trials: float) -> None:
    with pytest.raises(ValueError, match=r"0\.\.1"):
        exact_interval(share, trials)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("agents", [1, 2, 7])
def test_a_share_of_agents_is_one_of_as_many_trials_as_leave_it_as_uncertain(seed: int, agents: int) -> None:
    won, strata = sample(seed, agents, "shares")
    share, trials = float(won.mean()), float(len(won))
    assert 0.0 < share < 1.0
    if agents > 1:
        found, freedom = spread_of(won, strata)
        normal = statistics.NormalDist().inv_cdf(0.975)
        trials = min(trials, share * (1.0 - share) / found * (normal / quantile(freedom)) ** 2)
    assert share_interval(won, strata) == pytest.approx(exact_interval(share, trials), rel=1e-9)
    for all_alike in (0.0, 1.0):
        assert share_interval(np.full_like(won, all_alike), strata) == exact_interval(all_alike, len(won))
    assert share_interval(won[:9], ["a"] * 5 + ["b"] * 4) is None


def test_who_does_better_case_by_case() -> None:
    for wa, ca, wb, cb in itertools.product((0.0, 1.0), (1.0, 2.0), (0.0, 1.0), (1.0, 2.0)):
        wanted = 1.0 if wa > wb else 0.0 if wb > wa else 0.5
        if wa == wb == 1.0 and ca != cb:
            wanted = 1.0 if ca < cb else 0.0
        found = aggregates.better(*(np.array([each]) for each in (wa, ca, wb, cb)))
        assert found.tolist() == [wanted]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("ours", "theirs"), [(1, 1), (4, 1), (3, 4)])
def test_a_paired_difference_is_that_of_every_agent_with_every_other(seed: int, ours: int, theirs: int) -> None:
    a, strata = sample(seed, ours)
    b = (
        sample(seed + 100, theirs)[0][: len(a)]
        if seed > 99
        else np.random.default_rng(seed).gamma(2.0, 0.5, (len(a), theirs))
    )
    pairs = np.array(
        [[[x - y for y in other] for x in mine] for mine, other in zip(a.tolist(), b.tolist(), strict=True)]
    )
    kinds: tuple[Literal["mean", "iqm"], ...] = ("mean", "iqm")
    for kind in kinds:
        same(difference(a, b, strata, kind), paired(pairs, strata, kind == "iqm", 0.0))
    same(difference(a, b, strata), paired(pairs, strata, False, 0.0))
    same(difference(a, b, strata, "mean", 3.0), paired(pairs, strata, False, 9.0))
    won, other = (a < 1.4).astype(float), (b < 1.0).astype(float)
    shares = won[:, :, None] - other[:, None, :]
    same(difference(won, other, strata, "share"), paired(shares, strata, False, 1.0))
    wins = np.array([[[
        aggregates.better(won[i, j], a[i, j], other[i, k], b[i, k]) - 0.5 for k in range(theirs)] for j in range(ours)]
        for i in range(len(a))], float)  # fmt: skip
    same(advantage(won, a, other, b, strata), paired(wins, strata, False, 0.5))


def test_a_difference_without_an_interval_still_has_its_value() -> None:
    few = difference(np.array([[1.0], [2.0]]), np.array([[0.5], [0.5]]), ["a", "a"])
    assert few.value == 1.0
    assert all(map(math.isnan, (few.low, few.high, few.p)))
    alike = difference(np.full((6, 1), 2.0), np.full((6, 1), 0.5), ["a"] * 6)
    assert alike.value == 1.5
    assert all(map(math.isnan, (alike.low, alike.high, alike.p)))


@pytest.mark.parametrize("seed", range(20))
def test_holm_step_by_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ps = np.where(rng.random(9) < 0.2, np.nan, rng.random(9) ** 3)
    ps[rng.integers(9)] = ps[0]
    found = holm(ps.tolist())
    tested = sorted(p for p in ps.tolist() if not math.isnan(p))
    for p, corrected in zip(ps.tolist(), found, strict=True):
        if math.isnan(p):
            assert math.isnan(corrected)
            continue
        # a p is refused at a level where every smaller one is: the greatest of the Bonferroni bounds so far
        before = [min(1.0, (len(tested) - rank) * each) for rank, each in enumerate(tested) if each <= p]
        assert corrected == pytest.approx(max(before), rel=1e-12)
