"""The frame of a large map shows where the robot drives."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments


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
