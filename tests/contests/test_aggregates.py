"""Aggregates against hand-made cases and their definitions."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wayfield.benchmarks.episodes.metrics import smoothness
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.statistics.aggregates import cvar, interval, iqm, mean

FINITE = st.floats(-1e6, 1e6)


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


@given(values=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=20))
def test_cvar_is_the_mean_of_the_larger_half(values: list[float]) -> None:
    twice = sorted([*values, *values])  # an even number, of which halves are whole
    assert float(cvar(np.array(values))) == pytest.approx(np.mean(twice[len(values) :]), abs=1e-9)


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
