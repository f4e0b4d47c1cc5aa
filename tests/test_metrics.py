"""Metrics on trajectories made by hand, whose answers are known."""

import dataclasses
import math

import numpy as np
import pytest

from wayfield.benchmarks import metrics
from wayfield.benchmarks.crossed import exact_interval
from wayfield.benchmarks.metrics import METRICS, measure
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.scenarios import circle, obstacle_field

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


def test_a_robot_that_never_moves_has_no_error_over_arc_length():
    found = measure(on_straight(0.0, np.zeros(21)))
    assert math.isnan(found["cross_track_rms"])
    assert found["cross_track_rms_time"] == 0.0
    assert found["mean_speed"] == 0.0
    assert found["timeout"] == 1.0


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


def test_reference_jumps_are_counted_both_ways():
    assert metrics.reference_jumps(np.array([0.0, 0.1, 4.0, 4.1, 0.2, 0.65])) == 2
    assert metrics.reference_jumps(np.array([9.9, 0.1, 5.0, 0.2]), lap_length=10.0) == 2


def test_the_outcomes_exclude_one_another():
    plain = on_straight(0.0, [0.0, 1.0])
    for success in (False, True):
        for collision in (False, True):
            for left in (False, True):
                ended = dataclasses.replace(plain, success=success, collision=collision, left_corridor=left)
                assert sum(metrics.outcome(ended).values()) == 1.0
                assert metrics.outcome(ended)["collision"] == collision


def test_the_steady_offset_is_that_of_the_last_quarter():
    x = np.linspace(0.0, 10.0, 1001)
    # a step at 60 % of the way lies before the last quarter, one at 80 % within it
    assert measure(on_straight(np.where(x < 6.0, 0.5, 0.1), x))["steady_offset"] == pytest.approx(0.1)
    late = measure(on_straight(np.where(x < 8.0, 0.5, 0.1), x))["steady_offset"]
    assert late == pytest.approx((0.5 * 0.5 + 2.0 * 0.1) / 2.5, abs=1e-3)


def test_the_last_quarter_is_that_of_what_was_driven():
    x = np.linspace(4.0, 8.0, 401)  # begun in the middle of the path
    assert measure(on_straight(np.where(x >= 7.0, 0.1, -0.3), x))["steady_offset"] == pytest.approx(0.1)


def test_the_heading_error_is_a_root_of_mean_squares():
    x = np.linspace(0.0, 1.0, 2001)
    found = measure(dataclasses.replace(on_straight(0.0, x), heading_errors=x - 0.5))
    assert found["heading_error_rms"] == pytest.approx(math.sqrt(1.0 / 12.0), abs=1e-6)


@pytest.mark.parametrize(("share", "quantile"), [(0.95, 19.0), (0.9501, 20.0), (1.0, 20.0), (0.05, 1.0), (0.5, 10.0)])
def test_a_quantile_is_the_least_value_that_holds_on_its_share(share, quantile):
    # 20 pieces of equal length with the values 1 to 20, in another order
    order = np.random.default_rng(0).permutation(20) + 1.0
    values = np.repeat(order, 2)
    along = np.repeat(np.arange(21.0), 2)[1:-1]
    assert metrics.quantile_over_arc_length(values, along, share) == quantile


def test_a_mean_over_arc_length_counts_no_way_twice():
    assert metrics.mean_over_arc_length(np.array([0.0, 0.0, 4.0]), np.array([0.0, 3.0, 4.0])) == pytest.approx(0.5)


def test_a_reference_that_slips_back_over_the_start_of_a_lap_has_not_jumped():
    assert metrics.reference_jumps(np.array([0.1, 9.9, 0.1, 9.7, 9.6]), lap_length=10.0) == 0
    assert metrics.reference_jumps(np.array([1.0, 0.8, 0.3, 0.9, 1.39])) == 1


def test_completion_counts_the_laps():
    assert measure(on_straight(0.0, [0.0, 1.0], completion=2.5))["completion"] == 2.5


def test_an_episode_is_timed_from_its_own_start():
    x = np.linspace(0.0, 3.0, 301)
    plain = driven(x, 0.0, 0.0, goals=np.array([[3.0, 0.0, 0.0]]))
    late = dataclasses.replace(plain, times=plain.times + 7.0)
    for name, value in measure(plain, arrival_radius=0.255).items():
        assert measure(late, arrival_radius=0.255)[name] == pytest.approx(value, nan_ok=True), name


def test_clearance_and_the_way_past_an_obstacle():
    x = np.linspace(-1.0, 1.0, 41)
    gaps = np.hypot(x, 0.5) - 0.2 - 0.25
    found = measure(driven(x, 0.5, 0.0, obstacles=obstacle_field(circle(0.0, 0.0, 0.2)), clearances=gaps))
    assert found["min_clearance"] == pytest.approx(0.05)
    assert found["centre_distance"] == pytest.approx(0.5)
    assert found["near_share"] == pytest.approx(np.mean(gaps < 0.1))
    assert found["mean_clearance"] == pytest.approx(gaps.mean())
    # the nearest of several
    both = obstacle_field(circle(0.0, 9.0, 0.2), circle(0.0, 0.0, 0.2))
    assert measure(driven(x, 0.5, 0.0, obstacles=both, clearances=gaps))["centre_distance"] == pytest.approx(0.5)
    assert math.isnan(measure(driven(x, 0.5, 0.0))["min_clearance"])


def test_arrivals_come_in_order_and_with_length_and_heading():
    goals = np.array([[1.0, 0.0, 0.0], [3.0, 0.0, np.pi / 2]])
    found = measure(driven(np.linspace(0.0, 3.0, 301), 0.0, np.pi, goals=goals), arrival_radius=0.255)
    assert found["arrival_time_1"] == pytest.approx(75 * DT)
    assert found["arrival_time_2"] == pytest.approx(275 * DT)
    assert found["arrival_path_length"] == pytest.approx(2.75)
    assert found["arrival_heading_error"] == pytest.approx(np.pi / 2)


def test_a_goal_passed_before_its_waypoint_does_not_count():
    goals = np.array([[2.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    found = measure(driven(np.linspace(0.0, 2.0, 201), 0.0, 0.0, goals=goals), arrival_radius=0.105)
    assert found["arrival_time_1"] == pytest.approx(190 * DT)
    assert math.isnan(found["arrival_time_2"])
    assert math.isnan(found["arrival_path_length"])
    # nor does one that is reached though its waypoint never was
    goals = np.array([[1.0, 0.5, 0.0], [2.0, 0.0, 0.0]])
    found = measure(driven(np.linspace(0.0, 2.0, 201), 0.0, 0.0, goals=goals), arrival_radius=0.105)
    assert all(math.isnan(found[f"arrival_{name}"]) for name in ("time_1", "time_2", "path_length", "heading_error"))


def test_final_heading_error_goes_the_short_way_round():
    goals = np.array([[0.0, 0.0, np.pi]])
    found = measure(driven([0.0, 0.0], 0.0, -np.pi + 0.1, goals=goals))
    assert found["final_heading_error"] == pytest.approx(0.1)


def test_effort_is_the_integral_of_the_squared_wheel_speeds():
    speeds = np.tile([3.0, 4.0], (21, 1))
    found = measure(driven(np.zeros(21), 0.0, 0.0, wheel_speeds=speeds, saturated=np.arange(21) % 2))
    assert found["effort"] == pytest.approx(25.0)
    assert found["saturated_share"] == pytest.approx(0.5)


def test_every_metric_has_its_column():
    assert tuple(measure(on_straight(0.0, [0.0, 1.0]))) == METRICS
    assert tuple(measure(driven([0.0, 1.0], 0.0, 0.0))) == METRICS


def test_exact_interval():
    assert exact_interval(0.0, 5) == pytest.approx((0.0, 0.5218), abs=1e-4)
    assert exact_interval(0.5, 10) == pytest.approx((0.1871, 0.8129), abs=1e-4)
    for share, trials in ((0.5, 0), (-0.1, 5), (1.1, 5), (math.nan, 5)):
        with pytest.raises(ValueError, match=r"must lie in 0\.\.1"):
            exact_interval(share, trials)
