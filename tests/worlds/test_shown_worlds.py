"""The frame of every task holds what stands, moves and is driven; a briefing what a policy has access to."""

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


def drawn_of(env_id: str, index: int, actions: list[list[float]], **kwargs: Any) -> Any:
    """Returns a task, the state of its robot after some actions, and what a frame is told of it."""
    env: Any = gymnasium.make(f"wayfield/{env_id}-v0", **kwargs).unwrapped
    env.reset(seed=3, options={"scenario": index})
    for action in actions:
        env.step(np.array(action, np.float32))
    state = env.batch.states[0].copy()
    drawing = env.task.drawing(state)
    env.close()
    return env.task, state, drawing


def corners_of(points: Any, margin: float) -> list[float]:
    return [float(each) for each in (*(np.min(points, axis=0) - margin), *(np.max(points, axis=0) + margin))]


def test_a_frame_of_a_large_map_shows_where_the_robot_drives(tmp_path: Path) -> None:
    cells = np.zeros((600, 400), bool)
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = True, True, True, True
    np.save(tmp_path / "hall.npy", cells)
    scene = {"start": [1, 30, 0], "goal": [4, 30.5, 0], "heading_tolerance": 3.14}
    for size, least in ((0.1, 2.0), (0.02, 0.0)):
        told = scene | {"map": {"file": "hall.npy", "resolution": size}}
        if size < 0.1:  # a room of 8 x 12 m is shown whole
            told |= {"start": [1, 6, 0], "goal": [4, 6.5, 0]}
        (tmp_path / "scene.json").write_text(json.dumps(told), encoding="utf-8")
        task, state, drawn = drawn_of("DiffDriveGoalObstacles", 0, [], scenario=str(tmp_path / "scene.json"))
        if not least:
            room = corners_of([[0.0, 0.0], [8.0, 12.0]], 2.0 * task.robot.hull_radius)
            assert list(drawn["bounds"]) == pytest.approx(room)
            continue
        left, low, right, high = drawn["bounds"]
        assert (right, low, high) == pytest.approx((4.0 + least, 30.25 - 1.5 - least, 30.25 + 1.5 + least))
        assert -0.3 < left < 0.0  # the wall, and what is beyond it just so
        # wherever it goes, the robot is seen with what is around it; a frame moves once a metre
        seen = set()
        for x in np.arange(1.0, 18.0, 0.05):
            state["x"], state["y"] = x, 40.0
            bounds = task.drawing(state)["bounds"]
            seen.add(bounds)
            assert bounds[0] <= 1.0
            assert bounds[2] >= min(max(x, 4.0) + 1.5, 40.0)
            assert bounds[3] >= 41.5
        assert 13 <= len(seen) <= 15
