"""Metrics on trajectories made by hand, whose answers are known."""

import math

import numpy as np
import pytest

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.contests.contest import Course, Entrants
from wayfield.benchmarks.contests.trajectory_tracking import METRICS
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.episodes.rollout import roll_out
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


def tracked(way, error, heading, speed):
    """Returns the metrics of a base that looks anywhere, off a reference along `way` by `error` (m) along and left."""
    t = np.arange(400) * DT
    along = np.array([math.cos(way), math.sin(way)])
    off = error[0] * along + error[1] * np.array([-along[1], along[0]])
    place = np.outer(speed * t, along) - off
    c, s = math.cos(heading), math.sin(heading)
    seen = np.tile([c * off[0] + s * off[1], c * off[1] - s * off[0], way - heading, 0.0, 0.0], (len(t), 1))
    twists = np.tile([speed * math.cos(way - heading), speed * math.sin(way - heading), 0.0], (len(t), 1))
    each = driven(*place.T, heading, tracked=seen, twists=twists, floor=1e-3)
    return {column.name: metric(each) for column, metric in METRICS.items()}


@pytest.mark.parametrize("speed", [0.5, 0.0])
def test_errors_are_apart_along_and_across_whatever_way_a_base_looks(speed):
    for way, heading in ((0.0, 0.0), (0.4, 2.0), (-2.5, 1.2)):
        found = tracked(way, (0.03, -0.04), heading, speed)
        assert found["along_rms_after"] == pytest.approx(0.03, abs=1e-9)
        assert found["across_rms_after"] == pytest.approx(0.04, abs=1e-9)
        assert found["position_max"] == found["position_max_after"] == pytest.approx(0.05, abs=1e-9)
        if speed:
            assert found["time_lag"] == pytest.approx(0.03 / 0.5, abs=1e-9)


def test_a_base_is_at_its_limits_where_its_reference_takes_more_than_it_has():
    contest, shares = CONTESTS["trajectory-tracking"], {}
    for family in ("eights", "too_fast"):
        course, entrants = Course(family, "test"), Entrants(("feed_forward", "kanayama"), ("default",))
        for case in contest.cases("p3dx", course, entrants):
            driven = roll_out(case, actuators="lagged", episodes=4)
            shares[family, case.policy] = [float(each.tracked[1:, 4].mean()) for each in driven]
    assert not any(shares["eights", "feed_forward"])  # it asks for the reference alone
    assert 0.0 < max(shares["eights", "kanayama"]) < 0.1  # beside it at the start
    assert min(shares["too_fast", "feed_forward"]) > 0.1
