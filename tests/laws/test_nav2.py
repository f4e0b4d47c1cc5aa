"""Nav2's controllers: their critics against numbers made by hand, and that they reach goals."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.local_planning import briefing_of, drive, observed, scan

from wayfield.policies import nav2_mppi
from wayfield.policies.nav2_dwb import Nav2Dwb
from wayfield.policies.nav2_mppi import FILTER, HISTORY, Nav2Mppi
from wayfield.policies.parts.costmap import inflated
from wayfield.policies.parts.polyline_tracker import FARTHEST, UNIT

CONTROLLERS = [Nav2Dwb, Nav2Mppi]
every_controller = pytest.mark.parametrize("controller", CONTROLLERS)
RADIUS = 0.25  # m, of the P3DX


# The costmap.


def test_costs_fall_off_from_the_hull_as_documented() -> None:
    costs = inflated(RADIUS, 0.7, 3.0)
    at = {distance: costs[round((FARTHEST - distance) / UNIT)] for distance in (0.0, 0.1, 0.25, 0.35, 0.5, 0.7, 0.705)}
    assert at == {
        0.0: 254.0,
        0.1: 253.0,
        0.25: 253.0,
        0.35: math.floor(252.0 * math.exp(-0.3)),
        0.5: math.floor(252.0 * math.exp(-0.75)),
        0.7: math.floor(252.0 * math.exp(-1.35)),
        0.705: 0.0,
    }
    assert (np.diff(costs) >= 0.0).all()  # the nearer the dearer


# MPPI.


def test_the_filter_leaves_what_is_quadratic_and_reads_the_history() -> None:
    assert FILTER.sum() == pytest.approx(1.0)
    t = np.arange(-HISTORY, 56.0)
    curve = np.column_stack([0.1 + 0.01 * t - 0.001 * t * t, t, np.ones_like(t)])
    sequence = curve[HISTORY:].copy()
    nav2_mppi.smooth(curve[:HISTORY], sequence)
    assert sequence[:-4] == pytest.approx(curve[HISTORY:-4], abs=1e-9)
    assert not np.allclose(sequence[-4:], curve[-4:])  # beyond the end the last twist stands


# At the wheel.


@every_controller
def test_who_has_no_way_stands_still(controller: Any) -> None:
    briefing = briefing_of("p3dx")
    policy = controller()
    shut = scan(briefing.beam_angles, [(0.27, -1.0, 0.27, 1.0), (-0.27, -1.0, -0.27, 1.0), (-1.0, 0.27, 1.0, 0.27),
                                       (-1.0, -0.27, 1.0, -0.27)])  # fmt: skip
    kept = policy.reset(briefing)
    recoveries = []
    for _ in range(7):
        assert not policy.act(observed(briefing, shut), briefing, kept).any()
        recoveries.append(int(kept["state"]["recoveries"][0]))
    assert recoveries == [0, 0, 0, 0, 0, 0, 1]  # Nav2's failure tolerance: 0.3 s, of 0.05 s each
    kept = policy.reset(briefing)
    kept["state"]["stuck"] = 5
    policy.act(observed(briefing, scan(briefing.beam_angles, [])), briefing, kept)
    assert kept["state"]["stuck"][0] == 0  # only such a time without a break counts


@every_controller
@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_it_drives_around_a_block_to_its_goal(controller: Any, robot: str, tmp_path: Path) -> None:
    block = {"kind": "circle", "x": 2.0, "y": 0.1, "radius": 0.5}
    poses, info = drive(controller(), {"goal": [4, 0, 0], "obstacles": [block]}, robot, tmp_path, 600)
    assert info["success"]
    assert len(poses) > 20
