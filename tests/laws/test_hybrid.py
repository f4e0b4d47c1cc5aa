"""The hybrid: the planner's way leads the agent, and where none is left to lead it the agent drives as by itself."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the ids
from wayfield import policies
from wayfield.policies import Pilot, make
from wayfield.policies.scans.scan_planner import ScanPlanner
from wayfield.policies.trained.hybrid import lead, planner_of
from wayfield.policies.trained.ppo import shipped

ID = {"p3dx": "wayfield/DiffDriveGoalObstacles-v0", "omni3": "wayfield/OmniGoalObstacles-v0"}
WALL = {"kind": "wall", "x1": 1.5, "y1": -0.6, "x2": 1.5, "y2": 2.0}  # ahead, and farther to the left


def started(policy: Any, folder: Path, robot: str = "p3dx", **scene: Any) -> tuple[Pilot, Any, NDArray[Any]]:
    """Returns a pilot at the origin that faces along x, its environment and what it sees first."""
    file = folder / "scene.json"
    file.write_text(json.dumps({"start": [0, 0, 0], "heading_tolerance": math.pi, **scene}))
    env: Any = gymnasium.make(
        ID[robot], robot=robot, scenario=str(file), num_beams=72, max_range=5.0, actuators="lagged"
    )
    seen, _ = env.reset(seed=0)
    pilot = Pilot(policy, env)
    pilot.reset()
    return pilot, env, seen


def told_goal(folder: Path, ahead: float, **scene: Any) -> tuple[NDArray[Any], bool]:
    """Returns the point (x, y), m, that the agent is told after the planner's first decision, and whether it is led."""
    planner = planner_of("p3dx", 0.6)
    pilot, env, seen = started(planner, folder, **scene)
    pilot.act(seen)
    observation = env.unwrapped.task.layout.unpack(seen[None].astype(np.float64))
    goals, led = observation.goal.copy(), np.zeros(1, np.bool_)
    lead(pilot.memory["state"].copy(), observation.pose, ahead, goals, led)
    return goals[0], bool(led[0])


@pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4", "jackal"])
def test_the_planner_has_the_gains_that_were_found_for_the_robot_or_its_own(robot: str) -> None:
    file = Path(policies.__file__).parent / "gains" / "goal-obstacles" / f"scan_planner_{robot}_0.6_none.json"
    gains = json.loads(file.read_text())["gains"] if file.is_file() else {}
    assert planner_of(robot, 0.45) == ScanPlanner(**{**gains, "max_speed": 0.45})
    assert file.is_file() == (robot != "jackal")


def test_the_point_lies_ahead_on_the_way_until_less_of_it_is_left(tmp_path: Path) -> None:
    for ahead in (0.5, 1.2, 2.5):
        goal, led = told_goal(tmp_path, ahead, goal=[3.0, 0.0, 0.0])
        assert led
        assert goal == pytest.approx([ahead, 0.0], abs=0.05)
    assert told_goal(tmp_path, 3.5, goal=[3.0, 0.0, 0.0])[1] is False


def test_the_point_is_told_as_the_robot_sees_it(tmp_path: Path) -> None:
    for start, aside in (((2.0, -1.0, 0.9), 0.4), ((-1.5, 0.7, -2.3), -1.1)):
        way = start[2] + aside
        goal = [start[0] + 3.0 * math.cos(way), start[1] + 3.0 * math.sin(way), 0.0]
        told, led = told_goal(tmp_path, 1.2, start=list(start), goal=goal)
        assert led
        assert told == pytest.approx([1.2 * math.cos(aside), 1.2 * math.sin(aside)], abs=0.08)


def test_the_point_lies_where_the_way_leads_around_what_stands(tmp_path: Path) -> None:
    goal, led = told_goal(tmp_path, 1.2, goal=[3.0, 0.0, 0.0], obstacles=[WALL])
    assert led
    assert goal[1] < -0.2  # the shorter way is to the right
    assert np.hypot(*goal) <= 1.2 + 1e-9  # along the way, not beyond it


def test_near_the_goal_it_decides_as_the_agent_does(tmp_path: Path) -> None:
    for seed in shipped("goal_reaching", "p3dx"):
        twists = []
        for policy in (make("ppo", seed=seed), make("hybrid", seed=seed)):
            pilot, env, seen = started(policy, tmp_path, goal=[0.9, 0.4, 0.0])
            for _ in range(10):
                twists.append(pilot.act(seen))
                seen, *_ = env.step(twists[-1])
        assert np.array_equal(twists[:10], twists[10:])


def test_it_leaves_a_dead_end(tmp_path: Path) -> None:
    """A pocket that is open behind the robot, and the goal beyond it."""
    corners = [(-0.4, 1.5), (1.6, 1.5), (1.6, -1.5), (-0.4, -1.5)]
    walls = [{"kind": "wall", "x1": a, "y1": b, "x2": c, "y2": d} for (a, b), (c, d) in itertools.pairwise(corners)]
    pilot, env, seen = started(make("hybrid"), tmp_path, goal=[3.5, 0.0, 0.0], obstacles=walls)
    info: dict[str, Any] = {}
    for _ in range(900):
        seen, _, terminated, _, info = env.step(pilot.act(seen))
        if terminated:
            break
    assert info["success"]
    assert not info["collision"]


@pytest.mark.filterwarnings("ignore::wayfield.policies.learned.conditions.NewToAgent")
def test_it_cruises_at_the_speed_that_it_is_asked_for(tmp_path: Path) -> None:
    fastest = []
    for speed in (0.3, 0.6):
        pilot, env, seen = started(make("hybrid", speed=speed), tmp_path, goal=[6.0, 0.0, 0.0])
        speeds = []
        for _ in range(60):
            seen, *_ = env.step(pilot.act(seen))
            speeds.append(float(env.unwrapped.batch.states["vx"][0]))
        fastest.append(max(speeds))
    assert fastest == pytest.approx([0.3, 0.6], rel=0.1)


def test_robots_and_seeds_without_an_agent_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no agent of seed 99 ships for goal_reaching with p3dx; there are seeds"):
        started(make("hybrid", seed=99), tmp_path, goal=[3.0, 0.0, 0.0])
