"""Aggregates against hand-made cases and their definitions."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wayfield.benchmarks.episodes.metrics import against_the_best, fastest_time, smoothness
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.statistics.aggregates import better, interval, iqm, mean

FINITE = st.floats(-1e6, 1e6)
SCORES = ("spl", "sct", "barn_score", "barn_score_2022")


def test_iqm_leaves_out_the_outer_quarters() -> None:
    assert float(iqm(np.array([100.0, 2.0, 3.0, -50.0]))) == 2.5
    assert float(iqm(np.arange(8.0))) == np.mean([2.0, 3.0, 4.0, 5.0])
    np.testing.assert_array_equal(iqm(np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 5.0, 5.0, 90.0]])), [2.5, 5.0])


@given(st.lists(FINITE, min_size=1, max_size=30), FINITE)
def test_iqm_moves_with_its_values_and_stays_between_them(values: list[float], shift: float) -> None:
    array = np.array(values)
    assert array.min() - 1e-6 <= float(iqm(array)) <= array.max() + 1e-6
    assert float(iqm(array + shift)) == pytest.approx(float(iqm(array)) + shift, abs=1e-6 * (1.0 + abs(shift)))


def ends(values: Any, strata: list[str], statistic: Any) -> tuple[float, float]:
    """Returns an interval that there is."""
    found = interval(values, strata, statistic)
    assert found is not None
    return found


def test_equal_values_have_no_interval_and_strata_do_not_mix() -> None:
    assert interval([2.0] * 6, ["a"] * 6, iqm) is None
    # all spread lies between the strata: resampling within each of them leaves the mean where it is
    assert interval([0.0] * 5 + [1.0] * 5, ["a"] * 5 + ["b"] * 5, mean) is None
    low, high = ends([0.0] * 5 + [1.0] * 5, ["a"] * 10, mean)
    assert low < 0.35 < 0.65 < high
    # nearly all of it, and of agents too
    values = np.repeat([0.0, 1.0], 10)[:, np.newaxis] + 0.01 * np.random.default_rng(0).normal(size=(20, 3))
    for some in (values[:, 0], values):
        low, high = ends(some, ["a"] * 10 + ["b"] * 10, mean)
        assert 0.48 < low < 0.5 < high < 0.52


@pytest.mark.parametrize("statistic", [mean, iqm])
@pytest.mark.parametrize("shape", [(600, 1), (60, 40)])
def test_the_interval_of_many_values_is_the_one_that_resampling_comes_to(
    monkeypatch: pytest.MonkeyPatch, statistic: Any, shape: tuple[int, int]
) -> None:
    values = np.random.default_rng(0).normal(2.0, 1.0, shape)
    values[:, :] += 0.3 * np.random.default_rng(1).normal(size=shape[1])
    strata = [f"family {k % 3}" for k in range(shape[0])]
    resampled = ends(values, strata, statistic)
    monkeypatch.setattr("wayfield.benchmarks.statistics.aggregates.MANY", 1)
    np.testing.assert_allclose(ends(values, strata, statistic), resampled, atol=0.12 * (resampled[1] - resampled[0]))


def test_an_interval_covers_the_mean_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(200):
        low, high = ends(rng.normal(3.0, 1.0, 40).tolist(), ["a"] * 40, mean)
        covered += low <= 3.0 <= high
    assert 0.92 <= covered / 200 <= 0.99


def test_agents_that_do_alike_add_nothing_and_agents_that_differ_widen_the_interval() -> None:
    rng = np.random.default_rng(0)
    scenarios, strata = rng.normal(size=40), ["a"] * 20 + ["b"] * 20
    alone = ends(scenarios.tolist(), strata, mean)
    low, high = ends(np.tile(scenarios[:, np.newaxis], 10), strata, mean)
    # but for the smaller of two samples, by which the percentiles are corrected
    assert high - low == pytest.approx(alone[1] - alone[0], rel=0.05)
    # all spread lies between the agents: their mean is known as well as ten numbers tell it
    agents = rng.normal(size=10)
    low, high = ends(np.tile(agents, (40, 1)), strata, mean)
    assert high - low == pytest.approx(2.0 * 2.262 * agents.std(ddof=1) / math.sqrt(10.0), rel=0.1)


def test_an_interval_is_the_same_every_time_and_refuses_what_has_no_strata() -> None:
    numbers = [1.0, 2.0, 5.0, 7.0, 8.0]
    assert ends(numbers, ["a"] * 5, iqm) == ends(numbers, ["a"] * 5, iqm)
    with pytest.raises(ValueError, match="as many values as strata"):
        interval([1.0, 2.0], ["a"], mean)
    with pytest.raises(ValueError, match="at least one"):
        interval([], [], mean)


def test_better_puts_success_first_and_is_its_own_complement() -> None:
    success_a, cost_a = np.array([1.0, 1.0, 0.0, 0.0, 1.0]), np.array([5.0, 1.0, 1.0, 1.0, 2.0])
    success_b, cost_b = np.array([0.0, 1.0, 1.0, 0.0, 1.0]), np.array([1.0, 2.0, 9.0, 0.5, 2.0])
    shares = better(success_a, cost_a, success_b, cost_b)
    np.testing.assert_array_equal(shares, [1.0, 1.0, 0.0, 0.5, 0.5])
    np.testing.assert_array_equal(better(success_b, cost_b, success_a, cost_a), 1.0 - shares)


def test_fastest_time_is_the_ramp_and_then_the_cruise() -> None:
    assert fastest_time(10.0, 2.0, math.inf) == 5.0
    # half a second squared times a: 2 s to reach 2 m/s over 2 m, then 8 m at 2 m/s
    assert fastest_time(10.0, 2.0, 1.0) == 2.0 + 4.0
    assert fastest_time(0.5, 2.0, 1.0) == 1.0


def straight_run(success: bool, seconds: float, speed: float) -> Trajectory:
    times = np.linspace(0.0, seconds, round(seconds / 0.05) + 1)
    poses = np.column_stack([speed * times, np.zeros((len(times), 2))])
    return Trajectory(times=times, poses=poses, success=success, shortest=4.0, max_speed=1.0)


def test_spl_sct_and_barn_are_their_definitions() -> None:
    # 5 m driven in 10 s where 4 m are the shortest, and 4 s the fastest
    found = against_the_best(straight_run(True, 10.0, 0.5))
    assert found["spl"] == pytest.approx(4.0 / 5.0)
    assert found["sct"] == pytest.approx(4.0 / 10.0)
    assert found["barn_score"] == pytest.approx(4.0 / 10.0)
    # the BARN score saturates at half and at an eighth
    assert against_the_best(straight_run(True, 5.0, 1.0))["barn_score"] == pytest.approx(0.5)
    assert against_the_best(straight_run(True, 50.0, 0.1))["barn_score"] == pytest.approx(0.125)
    assert against_the_best(straight_run(False, 10.0, 0.5)) == dict.fromkeys(SCORES, 0.0)
    assert against_the_best(Trajectory(times=np.zeros(2), poses=np.zeros((2, 3)))) == {}


def test_who_cuts_a_corner_or_starts_fast_is_not_better_than_the_best() -> None:
    # 3 m driven in 2 s where 4 m are the shortest and 4 s the fastest
    found = against_the_best(straight_run(True, 2.0, 1.5))
    assert found == dict(zip(SCORES, (1.0, 1.0, 0.5, 0.25), strict=True))


def swing(seconds: float, amplitude: float, waves: float = 3.0) -> Trajectory:
    """A speed that swings as 1 - cos, `waves` times over the run."""
    times = np.linspace(0.0, seconds, 2001)
    speed = amplitude * (1.0 - np.cos(2.0 * np.pi * waves * times / seconds))
    twists = np.column_stack([speed, np.zeros((len(times), 2))])
    return Trajectory(times=times, poses=np.zeros((len(times), 3)), twists=twists)


def test_ldlj_is_its_integral_and_depends_on_neither_duration_nor_size() -> None:
    # v'' = A w^2 cos: its square integrates to A^2 w^4 T / 2, the peak speed is 2 A, w = 2 pi 3 / T
    expected = -math.log((2.0 * math.pi * 3.0) ** 4 / 2.0 / 4.0)
    for seconds, amplitude in ((10.0, 0.3), (40.0, 0.3), (10.0, 1.2)):
        assert smoothness(swing(seconds, amplitude))["ldlj"] == pytest.approx(expected, abs=0.01)
    assert smoothness(swing(10.0, 0.3, waves=6.0))["ldlj"] < expected


def test_a_turning_body_frame_is_no_jerk_of_its_own() -> None:
    """A constant velocity in the world, seen from a body that spins: the jerk is nothing but rounding."""
    times = np.linspace(0.0, 5.0, 101)
    heading = 2.0 * times
    twists = np.column_stack([np.cos(heading), -np.sin(heading), np.full(len(times), 2.0)])
    poses = np.column_stack([times, np.zeros(len(times)), heading])
    assert smoothness(Trajectory(times=times, poses=poses, twists=twists))["squared_jerk"] < 1e-15


def test_a_velocity_that_keeps_its_size_is_smooth_whatever_its_direction() -> None:
    """MRPB's measure is of the speed: an omni base that drives a circle without turning changes none of it."""
    times = 0.05 * np.arange(101)
    angle = 1.3 * times
    twists = 0.4 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(101)])
    poses = np.zeros((101, 3))
    assert smoothness(Trajectory(times=times, poses=poses, twists=twists))["velocity_smoothness"] < 1e-12
    faster = twists * (1.0 + times)[:, np.newaxis]  # 0.4 m/s^2 more, in whatever direction
    found = smoothness(Trajectory(times=times, poses=poses, twists=faster))
    assert found["velocity_smoothness"] == pytest.approx(0.4)


def test_an_interval_draws_scenarios_too_where_there_are_agents() -> None:
    # all spread lies between the scenarios: agents that do alike do not make them more
    values = np.tile(np.random.default_rng(1).normal(size=(40, 1)), 10)
    low, high = ends(values, ["a"] * 40, mean)
    assert high - low == pytest.approx(2.0 * 1.96 * values[:, 0].std() / math.sqrt(40.0), rel=0.1)
