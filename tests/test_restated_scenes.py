"""What a frame is given to show, and what a policy is told, of every task: stated once more."""

import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS

GOAL = {
    "goal": [4.0, 1.0, 0.4], "start": [0.5, 0.2, 0.1], "waypoints": [[1.0, 1.0], [2.0, -0.5]], "waypoint_radius": 0.6,
    "position_tolerance": 0.17, "start_offset": 0.05, "obstacles": [
        {"kind": "box", "x": 6.0, "y": 2.0, "length": 2.0, "width": 0.6, "heading": 0.7},
        {"kind": "circle", "x": 1.0, "y": -3.0, "radius": 0.4},
        {"kind": "circle", "x": -1.0, "y": 3.0, "radius": 0.3,
         "patrol": {"vx": -0.5, "vy": 0.25, "leg_time": 4.0}},
    ],
}  # fmt: skip
IDS = {"p3dx": "wayfield/DiffDrive{}-v0", "omni4": "wayfield/Omni{}-v0"}


def made(tmp_path: Path, kind: str, robot: str, content: Any, **options: Any) -> Any:
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(content))
    env = gymnasium.make(IDS[robot].format(kind), robot=robot, scenario=str(file), **options).unwrapped
    env.reset(seed=3)
    return env


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_a_goals_scene_holds_all_that_stands_and_moves(tmp_path: Path, robot: str) -> None:
    env = made(tmp_path, "GoalObstacles", robot, GOAL, num_beams=8)
    for _ in range(30):
        env.step(0.5 * env.action_space.high)
    state, scene = env.batch.states[0], env.scene()
    assert scene.robot is ROBOTS[robot]
    assert scene.pose == (state["x"], state["y"], state["heading"])
    # the disc goes 2 m to the left and 1 m up; the box reaches 1 m along its heading and 0.3 m across
    reach = np.abs([[math.cos(0.7), math.sin(0.7)], [math.sin(0.7), math.cos(0.7)]]) @ [1.0, 0.3]
    left, right = -1.0 - 2.0 - 0.3, 6.0 + reach[0]
    low, high = -3.0 - 0.4, 3.0 + 1.0 + 0.3
    hull = 2.0 * ROBOTS[robot].hull_radius
    assert scene.bounds == pytest.approx((left - hull, low - hull, right + hull, high + hull))
    places = [[1.0, 1.0], [2.0, -0.5], [4.0, 1.0]][int(state["waypoint"]) :]
    assert scene.goals[:, :2].tolist() == places
    assert np.isnan(scene.goals[:-1, 2]).all()
    assert scene.goals[-1, 2] == 0.4
    assert scene.goal_tolerance == 0.17
    assert scene.start == (0.5, 0.2)
    assert scene.max_range == 5.0
    assert scene.beam_angles.tolist() == (-math.pi + 0.25 * math.pi * np.arange(8)).tolist()
    assert scene.caption == (
        f"t {30 * 0.05:5.2f} s   goal {state['goal_distance']:5.2f} m   clearance {state['clearance']:5.2f} m"
    )
    # seen without noise, where the moving one is now
    disc = scene.obstacles[2]
    assert (disc["x"], disc["y"]) == pytest.approx((-1.0 - 0.5 * 1.5, 3.0 + 0.25 * 1.5))
    seen, _, _, _, _ = env.step(np.zeros_like(env.action_space.high))
    assert env.scene().ranges == pytest.approx(seen[-8:], abs=1e-5)


def test_a_scene_without_obstacles_holds_start_goal_and_map(tmp_path: Path) -> None:
    np.save(tmp_path / "room.npy", np.pad(np.zeros((20, 30), np.bool_), 1, constant_values=True))
    told = {"goal": [3.0, 1.0, 0.0], "start": [1.0, 1.5, 0.0],
            "map": {"file": "room.npy", "resolution": 0.2, "origin": [-0.5, -0.25, 0.1]}}  # fmt: skip
    env = made(tmp_path, "GoalObstacles", "omni4", told, num_beams=0)
    scene, hull = env.scene(), 2.0 * ROBOTS["omni4"].hull_radius
    c, s = math.cos(0.1), math.sin(0.1)
    corners = [(-0.5 + c * u - s * v, -0.25 + s * u + c * v) for u in (0.0, 6.4) for v in (0.0, 4.4)]
    x, y = zip(*corners, strict=True)
    assert scene.bounds == pytest.approx((min(x) - hull, min(y) - hull, max(x) + hull, max(y) + hull))
    assert scene.grid is env.task.scenarios[0].grid
    told_of = env.briefing("map").grids
    frame = told_of.frames[0]
    assert (frame["grid_x"], frame["grid_y"], frame["grid_cell"]) == (-0.5, -0.25, 0.2)
    assert (frame["grid_rows"], frame["grid_columns"], frame["grid_closed"]) == (22, 32, 1)
    assert told_of.cells is env.task.grids.cells
    assert env.briefing("goal").grids is None
    assert scene.ranges is None
    bare = made(tmp_path, "GoalObstacles", "p3dx", {"goal": [3.0, 1.0, 0.0], "start": [1.0, 1.5, 0.0]}).scene()
    assert bare.bounds == pytest.approx((1.0 - 0.5, 1.0 - 0.5, 3.0 + 0.5, 1.5 + 0.5))
    # a dock is shown within 3 m at least
    dock = made(tmp_path, "Docking", "p3dx", {"dock": [1.2, 0.4, 0.0]}).scene()
    assert dock.bounds == pytest.approx((0.6 - 1.5, 0.2 - 1.5, 0.6 + 1.5, 0.2 + 1.5))
    wide = made(tmp_path, "Docking", "p3dx", {"dock": [2.9, 0.4, 0.0]}).scene()
    assert wide.bounds == pytest.approx((-0.5, 0.2 - 1.5, 3.4, 0.2 + 1.5))


@pytest.mark.parametrize("closed", [False, True])
def test_a_paths_scene_shows_the_point_ahead_and_the_one_beside_it(tmp_path: Path, closed: bool) -> None:
    told = {"path": [[0, 0], [2, 0], [2, 1.5]], "closed": closed, "corridor": 0.4, "start": [0.2, 0.1, 0.5]}
    env = made(tmp_path, "PathFollowing", "p3dx", told)
    state, scene = env.batch.states[0], env.scene()
    margin = 0.4 + ROBOTS["p3dx"].hull_radius
    assert scene.bounds == pytest.approx((-margin, -margin, 2.0 + margin, 1.5 + margin))
    assert scene.path.tolist() == [[0, 0], [2, 0], [2, 1.5], *([[0, 0]] if closed else [])]
    assert (scene.corridor, scene.start) == (0.4, (0.2, 0.1))
    ahead = 0.2 + 0.5 * math.cos(0.5), 0.1 + 0.5 * math.sin(0.5)
    assert scene.lookahead == pytest.approx(ahead)
    assert scene.reference == pytest.approx((ahead[0], 0.0))
    assert scene.caption == f"t {0.0:5.2f} s   cross-track error {100 * state['cross_track_error']:+6.1f} cm"
    assert len(scene.obstacles) == 0
    # round the corner
    state["x"], state["y"], state["heading"], state["arc_length"], state["segment"] = 2.1, 0.3, 1.2, 2.2, 1
    scene = env.scene()
    assert scene.lookahead == pytest.approx((2.1 + 0.5 * math.cos(1.2), 0.3 + 0.5 * math.sin(1.2)))
    assert scene.reference == pytest.approx((2.0, 0.3 + 0.5 * math.sin(1.2)))


def test_policies_are_told_what_they_ask_for_and_no_more(tmp_path: Path) -> None:
    env = made(tmp_path, "GoalObstacles", "omni4", GOAL, num_beams=4, actuators="lagged", max_range=3.0)
    sensors, goal, world = (env.briefing(knows) for knows in ("sensors", "goal", "map"))
    for told in (sensors, goal, world):
        assert (told.num_envs, told.robot, told.dt, told.action_mode) == (1, ROBOTS["omni4"], 0.05, "twist")
        assert (told.actuators.acceleration, told.max_range, len(told.beam_angles)) == (1.0, 3.0, 4)
    assert sensors.goals is None
    assert sensors.obstacles is goal.obstacles is None
    for told in (goal, world):
        assert told.num_goals.tolist() == [3]
        assert told.goals[0].tolist() == [[1.0, 1.0, 0.0], [2.0, -0.5, 0.0], [4.0, 1.0, 0.4]]
    assert world.num_obstacles.tolist() == [3]
    assert world.obstacles[0]["x"].tolist() == [6.0, 1.0, -1.0]
    assert world.patrols["leg_time"].tolist() == [[0.0, 0.0, 4.0]]
    path = made(tmp_path, "PathFollowing", "p3dx", {"path": [[0, 0], [2, 0]]})
    assert path.briefing("sensors").paths is None
    told = path.briefing("path")
    assert (told.paths, told.path_index.tolist()) == (path.task.pool, [0])
    assert path.briefing("map").num_obstacles.tolist() == [0]


def test_a_rewards_scale_is_its_tasks(tmp_path: Path) -> None:
    """The numbers of the task reach its records, and so do those of the options."""
    env = made(
        tmp_path, "Docking", "omni4", {"dock": [1.2, 0.4, 0.0]}, end_on_success=False, max_range=2.5, num_beams=16,
        field_of_view=3.0,
    )  # fmt: skip
    p = env.task.params[0]
    assert (p["heading_weight"], p["rest_speed"], p["rest_yaw_rate"], p["end_on_success"]) == (0.3, 0.02, 0.05, 0)
    assert (p["max_range"], p["first_beam"], p["beam_step"]) == pytest.approx((2.5, -1.5, 3.0 / 15))
    for beams, angle, first, step in ((1, 2.0, 0.0, 2.0 * math.pi), (2, 2.0, -1.0, 2.0), (0, 2.0, 0.0, 2.0 * math.pi),
                                      (1, 2.0 * math.pi, -math.pi, 2.0 * math.pi)):  # fmt: skip
        p = made(tmp_path, "GoalObstacles", "omni4", GOAL, num_beams=beams, field_of_view=angle).task.params[0]
        assert (p["first_beam"], p["beam_step"]) == pytest.approx((first, step))
