"""The frame of every task holds what stands, moves and is driven; a briefing what a policy has access to."""

import cmath
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


@pytest.mark.parametrize("scenario", ["splines/test", "figure_eight_lap"])
def test_a_frame_of_a_path_holds_its_corridor_and_both_points_of_document_a(scenario: str) -> None:
    task, state, told = drawn_of("DiffDrivePathFollowing", 0, [[0.4, 0.6]] * 7, scenario=scenario)
    course = task.scenarios[0]
    lap = [course.path.points[:1]] if course.path.closed else []
    np.testing.assert_allclose(told["path"], np.vstack([course.path.points, *lap]), atol=1e-9)
    assert told["corridor"] == course.corridor
    assert list(told["bounds"]) == pytest.approx(corners_of(told["path"], course.corridor + task.robot.hull_radius))
    assert told["start"] == pytest.approx(tuple((course.start or course.path.points[0])[:2]), abs=1e-6)
    at, ahead = complex(state["x"], state["y"]), 0.5 * cmath.exp(1j * state["heading"])
    assert complex(*told["lookahead"]) == pytest.approx(at + ahead)
    # the nearest point of the path to the one that is half a metre ahead
    ends = told["path"] @ np.array([1.0, 1j])
    shares = np.linspace(0.0, 1.0, 50)[:, None]
    least = np.abs((1.0 - shares) * ends[:-1] + shares * ends[1:] - complex(*told["lookahead"])).min()
    assert abs(complex(*told["reference"]) - complex(*told["lookahead"])) == pytest.approx(least, abs=1e-4)
    error = 100.0 * float(state["cross_track_error"])
    assert told["caption"] == f"t {0.35:5.2f} s   cross-track error {error:+6.1f} cm"


@pytest.mark.parametrize("scenario", ["moving_crowd/test", "doors_medium/test", "clutter_10/test"])
def test_a_frame_of_a_field_holds_all_that_stands_and_moves(scenario: str) -> None:
    task, state, told = drawn_of("OmniGoalObstacles", 2, [[0.2, 0.1, 0.3]] * 4, scenario=scenario)
    world = task.scenarios[2]
    points = [complex(*world.start[:2]), complex(*world.goal[:2]), *(complex(*each) for each in world.waypoints)]
    for k, each in enumerate(world.obstacles):
        long, wide = each["half_length"], each["half_width"]
        turn = complex(each["cos"], each["sin"])
        round_ = [each["radius"] * side for side in (1, 1j, -1, -1j)]
        shape = [turn * complex(a * long, b * wide) + r for a in (-1, 1) for b in (-1, 1) for r in round_]
        places = [complex(each["x"], each["y"])]
        way = world.patrols[k]
        if way["leg_time"] > 0.0:
            first = complex(way["x"], way["y"])
            places += [first, first + way["leg_time"] * complex(way["vx"], way["vy"])]
        points += [place + corner for place in places for corner in shape]
    assert (scenario == "moving_crowd/test") == bool((world.patrols["leg_time"] > 0.0).any())
    flat = np.array([[each.real, each.imag] for each in points])
    assert list(told["bounds"]) == pytest.approx(corners_of(flat, 2.0 * task.robot.hull_radius))
    assert told["start"] == world.start[:2]
    assert told["goals"][-1].tolist() == list(world.goal)
    assert np.isnan(told["goals"][:-1, 2]).all()
    assert (told["goal_tolerance"], told["max_range"]) == (world.position_tolerance, task.max_range)
    assert told["grid"] is None
    away, room = float(state["goal_distance"]), float(state["clearance"])
    assert told["caption"] == f"t {0.2:5.2f} s   goal {away:5.2f} m   clearance {room:5.2f} m"


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
