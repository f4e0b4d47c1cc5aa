"""Metrics on trajectories made by hand, whose answers are known."""

import math

import numpy as np
import pytest

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
