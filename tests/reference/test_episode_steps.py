"""A row of a vector environment does at every step, over ends and resets, what the data sheets say."""

import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from oracles.episodes import DOCK, GOAL, PATH, Bank, Goals, Paths, Robot, compared

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS

# id, robot, scenario, options; the clock; how the actions are chosen
CASES: dict[str, tuple[str, str, str, dict[str, Any], int, str]] = {
    "clutter": (GOAL, "p3dx", "clutter_10/train", {"disturbance": "severe", "actuators": "slow",
                "pose_source": "odometry", "shove": (0.6, 0.1, -0.05, 0.4)}, 90, "goal"),
    "waypoints": (GOAL, "omni3", "STOPS", {"noise": 0.5, "action_mode": "wheel_speeds", "actuators": "lagged",
                  "disturbance": "shove"}, 160, "goal"),
    "uncorrected": (GOAL, "omni3", "mixed", {"noise": 1.0, "pose_source": "odometry_uncorrected"}, 60, "random"),
    "crowd": (GOAL, "mecanum4", "moving_crowd/train", {"disturbance": "moderate", "action_mode": "wheel_speeds"},
              70, "random"),
    "run into": (GOAL, "kobuki", "PATROLLED", {"actuators": "lagged"}, 170, "still"),
    "turns": (GOAL, "turtlebot3", "open_fields/train", {"noise": 0.2}, 40, "random"),
    "dock": (DOCK, "omni4", "moving/train", {"disturbance": "wheel_error", "actuators": "lagged"}, 150, "goal"),
    "berth": (DOCK, "p3dx", "berth/train", {"disturbance": "moderate"}, 60, "random"),
    "splines": (PATH, "p3dx", "splines/train", {"disturbance": "severe", "shove": (0.4, 0.2, 0.1, -0.3)}, 80, "path"),
    "laps": (PATH, "omni3", "CLOSED", {"num_preview": 3, "preview_spacing": 0.7, "actuators": "lagged"}, 250, "path"),
    "left": (PATH, "omni4", "OPEN", {"pose_source": "odometry"}, 60, "random"),
    "ended": (PATH, "turtlebot3", "OPEN", {"noise": 1.0, "pose_source": "odometry", "disturbance": "moderate"},
              130, "path"),
}  # fmt: skip
CLOSED = {"path": [[0, 0], [0.9, 0], [0.9, 0.4], [0, 0.5]], "closed": True, "laps": 2, "corridor": 0.6,
          "start_offset": 0.1, "start_turn": 0.2}  # fmt: skip
STOPS = {
    "goal": [1.6, 0.9, 0.5],
    "waypoints": [[0.5, 0.4], [1.2, -0.2]],
    "obstacles": [
        {"kind": "circle", "x": -0.7, "y": 0.1, "radius": 0.2},
        {"kind": "wall", "x1": 2.6, "y1": -2.0, "x2": 2.3, "y2": 3.0},
        {"kind": "box", "x": 0.2, "y": 1.6, "length": 0.9, "width": 0.3, "heading": 0.4},
    ],
    "position_tolerance": 0.15,
    "heading_tolerance": 0.4,
    "waypoint_radius": 0.2,
    "start_offset": 0.15,
}
PATROLLED = {
    "goal": [3.0, 0.0, 0.0],
    "start_offset": 0.3,
    "obstacles": [
        {
            "kind": "circle",
            "x": 0.5,
            "y": 1.2,
            "radius": 0.2,
            "patrol": {"vx": -0.1, "vy": -0.35, "leg_time": 3.0, "phase": 5.5},
        }
    ],
}
OPEN = {"path": [[0, 0], [0.4, 0.1], [0.6, 0.3]], "corridor": 0.12, "start_offset": 0.05, "start_turn": 0.4,
        "start": [0.05, 0.02, 0.2]}  # fmt: skip


# what ends the episodes of a case, where it is not the clock alone
ENDS = {
    "clutter": {"clock", "collision"}, "waypoints": {"success"}, "uncorrected": {"clock", "collision"},
    "run into": {"clock", "collision"}, "dock": {"collision", "success"}, "laps": {"success"},
    "left": {"left_corridor"}, "ended": {"clock", "success"},
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_row_answers_what_the_sheets_say(tmp_path: Path, case: str) -> None:
    env_id, name, scenario, options, clock, kind = CASES[case]
    base = ROBOTS[name]
    if scenario.isupper():
        file = tmp_path / "own.json"
        file.write_text(json.dumps(globals()[scenario]))
        scenario = str(file)
    env_id = env_id.format("Omni" if base.holonomic else "DiffDrive")
    rows = 2
    env = gymnasium.make_vec(env_id, rows, robot=name, scenario=scenario, max_episode_steps=clock, **options)
    get = options.get
    robot = Robot(
        name, get("actuators", "ideal"), get("action_mode", "twist"), get("pose_source", "ground_truth"),
        get("noise", 0.0), get("disturbance", "none"),
    )  # fmt: skip
    if env_id.endswith("Following-v0"):
        bank: Bank = Paths(env, robot, get("shove"), get("num_preview", 10), get("preview_spacing", 0.1))
    else:
        docks = "Docking" in env_id
        bank = Goals(env, robot, get("shove"), 0.3 if docks else 0.1, (0.02, 0.05) if docks else (math.inf, math.inf))
    ends = compared(env, bank, clock, kind)
    assert ends == ENDS.get(case, {"clock"})
