"""Nav2's controllers: that they reach goals, and stand still where there is no way."""

from pathlib import Path
from typing import Any

import pytest
from oracles.local_planning import briefing_of, drive, observed, scan

from wayfield.policies.scans.nav2_dwb import Nav2Dwb
from wayfield.policies.scans.nav2_mppi import Nav2Mppi

CONTROLLERS = [Nav2Dwb, Nav2Mppi]
every_controller = pytest.mark.parametrize("controller", CONTROLLERS)


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
