"""Numbers that papers, documents, data sheets and task sheets print stand in the code as they were printed."""

import dataclasses
import math
from typing import Any

import pytest

from wayfield import policies
from wayfield.envs import docking, goal_reaching, path_following
from wayfield.envs.robots import ACTUATORS, ROBOTS, records
from wayfield.envs.robots.disturbances import DISTURBANCES, LEVELS
from wayfield.envs.tasks.specs import TASKS

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


def test_rewards_weigh_what_their_sheets_say() -> None:
    path, goal, dock = path_following.Params(), goal_reaching.Params(), docking.Params()
    assert (path.error_scale, path.corridor_penalty, path.window, path.end_tolerance) == (0.1, 10.0, 1.0, 0.05)
    for params, weight in ((goal, 0.1), (dock, 0.3)):
        assert (params.heading_weight, params.time_cost) == (weight, 0.01)
        assert (params.success_reward, params.collision_penalty) == (5.0, 5.0)
    assert (goal.rest_speed, goal.rest_yaw_rate) == (math.inf, math.inf)
    assert (dock.rest_speed, dock.rest_yaw_rate) == (0.02, 0.05)


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


def test_tiers_of_actuators_and_noise_are_those_of_the_sheets() -> None:
    told = {name: (each.acceleration, each.yaw_acceleration, each.lag) for name, each in ACTUATORS.items()}
    assert told == {"ideal": (math.inf, math.inf, 0.0), "lagged": (1.0, 3.0, 0.1), "slow": (0.5, 1.5, 0.25)}
    noise = records.POSITION_NOISE, records.HEADING_NOISE, records.ENCODER_NOISE, records.RANGE_NOISE
    assert noise == (0.01, 0.01, 0.02, 0.01)


# Of each level: radius, track, slip, side slip, noise of pose, encoders and ranges, dropout, delay, shove.
WRONG = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0),
    "light": (0.005, 0.01, 0.02, 0.01, 0.5, 0.5, 0.5, 0.01, 0, 0.05),
    "moderate": (0.01, 0.02, 0.05, 0.02, 1.0, 1.0, 1.0, 0.02, 1, 0.1),
    "strong": (0.02, 0.03, 0.10, 0.04, 2.0, 2.0, 2.0, 0.05, 2, 0.2),
    "severe": (0.03, 0.05, 0.15, 0.06, 3.0, 3.0, 3.0, 0.10, 3, 0.3),
}
ALONE = {
    "wheel_error": ("wheel_radius_error", "track_error"),
    "slip": ("slip", "side_slip"),
    "noise": ("pose_noise", "encoder_noise", "range_noise"),
    "dropout": ("range_dropout",),
    "shove": ("shove",),
}


def test_levels_that_results_were_published_with_stay_what_they_were() -> None:
    assert tuple(WRONG) == LEVELS
    for name, numbers in WRONG.items():
        assert dataclasses.astuple(DISTURBANCES[name]) == numbers
    strong = dataclasses.asdict(DISTURBANCES["strong"])
    for name, fields in ALONE.items():
        kept = {field: value if field in fields else 0.0 for field, value in strong.items()}
        assert dataclasses.asdict(DISTURBANCES[name]) == kept
    for steps in (1, 2, 3):
        delay = dataclasses.asdict(DISTURBANCES[f"delay_{steps}"])
        assert delay == dict.fromkeys(delay, 0.0) | {"action_delay": steps}


def test_contests_last_a_minute_and_paths_two() -> None:
    assert {spec.clock * 0.05 for spec in TASKS.values() if spec.observes == "goal"} == {60.0}
    assert {spec.clock * 0.05 for spec in TASKS.values() if spec.observes == "path"} == {120.0}
    # a run that fails counts as the whole clock, or as the corridor's metre
    assert {spec.cost.failure for spec in TASKS.values() if spec.observes == "goal"} == {60.0}
    assert {spec.cost.failure for spec in TASKS.values() if spec.observes == "path"} == {1.0}
    assert TASKS["path_following"].tier_bounds == (1.0, 2.5)
    assert TASKS["goal_reaching"].tier_bounds == (0.6, 0.35)
