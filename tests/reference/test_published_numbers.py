"""Numbers that papers, documents, data sheets and task sheets print stand in the code as they were printed."""

import math
from typing import Any

import pytest

from wayfield import policies
from wayfield.envs.robots import ROBOTS

# The gains that the documents and the papers print, and those that Nav2 ships with (nav2_bringup, Humble for DWB and
# Jazzy for MPPI; costmaps of its local one).
PRINTED: dict[str, dict[str, Any]] = {
    "lookahead_documented": {
        "k_lin": 1.2, "k_ang": 0.8, "k_ori": 8.0, "lookahead_distance": 0.5, "mode_distance": 0.05, "search": "whole",
    },
    # document A's corrected gain: pure pursuit's equivalent, 2 k_lin
    "lookahead_retuned": {"k_lin": 1.2, "k_ang": 2.4, "k_ori": 8.0, "lookahead_distance": 0.5, "search": "window"},
    "waypoint": {"lam": 1.0, "switching_radius": 0.35},
    # document C; tau_l a little above 1, where every equilibrium lies
    "apf_documented": {"k_att": 0.2, "k_rep": 0.52, "tau_l": 1.05, "escape": False},
    "apf_escape": {"k_att": 0.2, "k_rep": 0.52, "tau_l": 1.05, "escape": True},
    "apf_corrected": {"k": 0.6, "eta": 0.02, "rho_0": 0.6, "max_speed": 0.3},
    # Macenski et al. 2023
    "regulated_pure_pursuit": {"rotate_angle": 0.785},
    # Ulrich and Borenstein 1998: mu_1 = 5, mu_2 = mu_3 = 2
    "vfh_plus": {"mu_goal": 5.0, "mu_heading": 2.0, "mu_previous": 2.0},
    # Park and Kuipers 2011
    "smooth_pose": {"k1": 1.0, "k2": 3.0, "lam": 2.0},
    # Astolfi 1999
    "polar": {"k_rho": 3.0, "k_alpha": 8.0, "k_beta": -1.5},
    "nav2_dwb": {
        "max_yaw_rate": 1.0, "acceleration": 2.5, "yaw_acceleration": 3.2, "speeds": 20, "sideways": 5, "turns": 20,
        "horizon": 1.7, "linear_step": 0.05, "angular_step": 0.025, "obstacle": 0.02, "path_distance": 32.0,
        "goal_distance": 24.0, "path_align": 32.0, "goal_align": 24.0, "forward_point": 0.1, "rotate_to_goal": 32.0,
        "slowing": 5.0, "stopped_speed": 0.25,
    },
    "nav2_mppi": {
        "samples": 2000, "steps": 56, "step_time": 0.05, "temperature": 0.3, "gamma": 0.015, "speed_noise": 0.2,
        "yaw_noise": 0.4, "max_reverse": 0.35, "max_yaw_rate": 1.9, "acceleration": 3.0, "yaw_acceleration": 3.5,
        "prune_distance": 1.7, "constraint": 4.0, "cost": 3.81, "collision_cost": 1e6, "near_goal": 1.0,
        "cost_stride": 2, "goal": 5.0, "goal_within": 1.4, "goal_angle": 3.0, "goal_angle_within": 0.5,
        "path_align": 14.0, "path_align_from": 0.5, "path_align_offset": 20, "align_stride": 4, "most_occupied": 0.05,
        "path_follow": 5.0, "path_follow_from": 1.4, "path_follow_offset": 5, "path_angle": 2.0,
        "path_angle_from": 0.5, "path_angle_offset": 4, "path_angle_beyond": 1.0, "prefer_forward": 5.0,
        "prefer_forward_from": 0.5,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", PRINTED)
def test_gains_that_a_source_prints_are_the_defaults(name: str) -> None:
    policy = policies.make(name)
    assert {gain: getattr(policy, gain) for gain in PRINTED[name]} == PRINTED[name]


def test_robots_of_the_documents_have_the_documents_numbers() -> None:
    p3dx, omni3, omni4 = (ROBOTS[name] for name in ("p3dx", "omni3", "omni4"))
    assert {wheel.radius for wheel in p3dx.wheels} == {0.0975}
    assert sorted(y for _, y in p3dx.wheel_positions) == [-0.1905, 0.1905]
    for robot, angles, radius, reach in (
        (omni3, (30.0, 150.0, -90.0), 0.075, 0.3),
        (omni4, (45.0, 135.0, -45.0, -135.0), 0.03, 0.13),
    ):
        assert {wheel.radius for wheel in robot.wheels} == {radius}
        turns = [math.degrees(angle) for angle in robot.wheel_directions]
        assert turns == pytest.approx(angles)
        assert [math.hypot(x, y) for x, y in robot.wheel_positions] == pytest.approx([reach] * len(angles))
