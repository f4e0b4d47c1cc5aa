"""Metrics on trajectories made by hand, whose answers are known."""

import dataclasses
import math

import numpy as np
import pytest

from wayfield.benchmarks.episodes import metrics
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.records.trajectory import Trajectory

DT = 0.05


def driven(x, y, heading, **fields):
    """Returns a trajectory along the given positions, one control period apart."""
    x = np.asarray(x, float)
    poses = np.column_stack([x, np.broadcast_to(y, x.shape), np.broadcast_to(heading, x.shape)])
    return Trajectory(times=np.arange(len(x)) * DT, poses=poses, **fields)


def on_straight(offset, x, **fields):
    """Returns a trajectory beside a straight path along x, `offset` (m) to its left."""
    x = np.asarray(x, float)
    offset = np.broadcast_to(np.asarray(offset, float), x.shape)
    return driven(
        x,
        offset,
        0.0,
        arc_lengths=np.maximum.accumulate(x),
        cross_track_errors=offset,
        heading_errors=np.zeros(len(x)),
        references=np.column_stack([np.zeros((len(x), 4)), x]),
        goals=np.array([[10.0, 0.0, 0.0]]),
        **fields,
    )


def test_a_constant_offset_is_the_error_by_every_measure():
    found = measure(on_straight(0.2, np.linspace(0.0, 10.0, 401), completion=1.0, success=True))
    for name in ("cross_track_rms", "cross_track_rms_time", "cross_track_mean", "cross_track_max", "cross_track_p95"):
        assert found[name] == pytest.approx(0.2)
    assert found["steady_offset"] == pytest.approx(0.2)
    assert found["heading_error_rms"] == 0.0
    assert found["time"] == pytest.approx(20.0)
    assert found["path_length"] == pytest.approx(10.0)
    assert found["mean_speed"] == pytest.approx(0.5)
    assert found["final_position_error"] == pytest.approx(0.2)
    assert (found["final_x_error"], found["final_y_error"]) == pytest.approx((0.0, 0.2))
    assert found["reference_jumps"] == 0


def test_right_of_the_path_is_negative():
    assert measure(on_straight(-0.1, np.linspace(0.0, 1.0, 21)))["steady_offset"] == pytest.approx(-0.1)


def test_errors_to_either_side_do_not_cancel():
    x = np.linspace(0.0, 8.0, 1601)
    found = measure(on_straight(0.1 * np.sin(2.0 * math.pi * x), x))
    assert found["steady_offset"] == pytest.approx(0.0, abs=1e-9)
    assert found["cross_track_mean"] == pytest.approx(0.2 / math.pi, rel=1e-4)
    assert found["cross_track_rms"] == pytest.approx(0.1 / math.sqrt(2.0), rel=1e-4)


def test_waiting_where_the_error_is_small_gains_nothing():
    moving = np.linspace(0.0, 1.0, 21)
    x = np.concatenate([np.zeros(200), moving])
    offset = np.concatenate([np.zeros(200), np.full(21, 0.3)])
    found = measure(on_straight(offset, x))
    assert found["cross_track_rms"] == pytest.approx(0.3)
    assert found["cross_track_rms_time"] == pytest.approx(0.3 * math.sqrt(21 / 220))


def test_a_ramp_has_the_textbook_mean_rms_and_quantile():
    x = np.linspace(0.0, 1.0, 2001)
    found = measure(on_straight(x, x))
    assert found["cross_track_mean"] == pytest.approx(0.5, abs=1e-6)
    assert found["cross_track_rms"] == pytest.approx(1.0 / math.sqrt(3.0), abs=1e-6)
    assert found["cross_track_p95"] == pytest.approx(0.95, abs=1e-3)
    assert found["cross_track_max"] == 1.0


def test_one_lap_on_a_circle():
    angle = np.linspace(0.0, 2.0 * np.pi, 1257)
    outside = Trajectory(
        times=np.arange(len(angle)) * DT,
        poses=np.column_stack([1.1 * np.cos(angle), 1.1 * np.sin(angle), angle + np.pi / 2]),
        arc_lengths=angle,
        cross_track_errors=np.full(len(angle), -0.1),
        heading_errors=np.zeros(len(angle)),
        references=np.column_stack([np.zeros((len(angle), 4)), (angle + 0.4) % (2.0 * np.pi)]),
        lap_length=2.0 * np.pi,
    )
    found = measure(outside)
    assert found["path_length"] == pytest.approx(2.2 * np.pi, rel=1e-5)
    assert found["cross_track_rms"] == pytest.approx(0.1)
    assert found["reference_jumps"] == 0  # the new lap is no jump
    assert math.isnan(found["final_position_error"])  # a circle has no end


def test_the_outcomes_exclude_one_another():
    plain = on_straight(0.0, [0.0, 1.0])
    for success in (False, True):
        for collision in (False, True):
            for left in (False, True):
                ended = dataclasses.replace(plain, success=success, collision=collision, left_corridor=left)
                assert sum(metrics.outcome(ended).values()) == 1.0
                assert metrics.outcome(ended)["collision"] == collision


@pytest.mark.parametrize(("share", "quantile"), [(0.95, 19.0), (0.9501, 20.0), (1.0, 20.0), (0.05, 1.0), (0.5, 10.0)])
def test_a_quantile_is_the_least_value_that_holds_on_its_share(share, quantile):
    # 20 pieces of equal length with the values 1 to 20, in another order
    order = np.random.default_rng(0).permutation(20) + 1.0
    values = np.repeat(order, 2)
    along = np.repeat(np.arange(21.0), 2)[1:-1]
    assert metrics.quantile_over_arc_length(values, along, share) == quantile


def test_effort_is_the_integral_of_the_squared_wheel_speeds():
    speeds = np.tile([3.0, 4.0], (21, 1))
    found = measure(driven(np.zeros(21), 0.0, 0.0, wheel_speeds=speeds, saturated=np.arange(21) % 2))
    assert found["effort"] == pytest.approx(25.0)
    assert found["saturated_share"] == pytest.approx(0.5)
