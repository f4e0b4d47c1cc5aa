"""How long the shortest way is, and how long a scenario of one's own may take."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.entrants.own_scenario import POLICIES, own_cases, own_scenario, without_way
from wayfield.benchmarks.episodes.shortest import shortest_way
from wayfield.envs.scenarios import box, circle, moving_circle, obstacle_field, splits, wall

GOAL = "wayfield/DiffDriveGoalObstacles-v0"


def test_the_shortest_way_round_a_box_and_through_waypoints() -> None:
    base = splits.split("goal_reaching", "clutter_5", "test")[0]
    empty = obstacle_field()
    told = dataclasses.replace(
        base, obstacles=empty, start=(0.0, 0.0, 0.0), goal=(6.0, 0.0, 0.0), waypoints=(),
        position_tolerance=0.1, grid=None,
    )  # fmt: skip
    assert shortest_way(told, 0.2) == pytest.approx(5.9, abs=0.01)
    through = dataclasses.replace(told, waypoints=((3.0, 4.0),))
    assert shortest_way(through, 0.2) == pytest.approx(9.9, abs=0.02)
    stands = dataclasses.replace(told, obstacles=obstacle_field(box(3.0, 0.0, 0.4, 4.0)))
    # a tangent to a disc of the hull's radius about each corner, an arc of it, and along the side
    reach, turn = math.hypot(2.8, 2.0), math.atan2(2.0, 2.8)
    tangent, more = math.sqrt(reach**2 - 0.2**2), math.asin(0.2 / reach)
    assert shortest_way(stands, 0.2) == pytest.approx(2.0 * (tangent + 0.2 * (turn + more)) + 0.4 - 0.1, abs=0.04)
    round_ = dataclasses.replace(stands, obstacles=obstacle_field(circle(3.0, 0.0, 1.0)))
    reach = math.sqrt(3.0**2 - 1.2**2)
    arc = 1.2 * (math.pi - 2.0 * math.acos(1.2 / 3.0))
    assert shortest_way(round_, 0.2) == pytest.approx(2.0 * reach + arc - 0.1, abs=0.04)
    leaves = moving_circle(3.0, 0.0, 1.0, 0.0, 0.1, 2.0)
    assert shortest_way(dataclasses.replace(round_, obstacles=obstacle_field(leaves)), 0.2) == pytest.approx(
        5.9, abs=0.01
    )
    near = dataclasses.replace(told, goal=(0.05, 0.0, 0.0))
    assert shortest_way(near, 0.2) == pytest.approx(0.04)
    # round the nearer end of a wall, whichever way that points: beyond it there is room as well
    reach = math.hypot(3.0, 2.0)
    round_end = math.sqrt(reach**2 - 0.2**2) + 0.2 * (math.atan2(2.0, 3.0) + math.asin(0.2 / reach))
    for turned in (1, 1j, -1, -1j):
        goal, far, end = (turned * each for each in (6 + 0j, 3 - 7j, 3 + 2j))
        barred = obstacle_field(wall(far.real, far.imag, end.real, end.imag))
        walled = dataclasses.replace(stands, goal=(goal.real, goal.imag, 0.0), obstacles=barred)
        assert shortest_way(walled, 0.2) == pytest.approx(2.0 * round_end - 0.1, abs=0.06)


def test_the_clock_of_a_scenario_of_ones_own(tmp_path: Path) -> None:
    """0.25 m/s and 20 s, of thrice the straight way, or of the laps of a path, whose corners take a second a radian."""
    goal, loop, line = tmp_path / "goal.json", tmp_path / "loop.json", tmp_path / "line.csv"
    told = {"start": [0, 0, 0], "goal": [3, 4, 0.5], "waypoints": [[3, 0]], "obstacles": []}
    goal.write_text(json.dumps(told))
    loop.write_text(json.dumps({"path": [[0, 0], [2, 0], [2, 2], [0, 2]], "closed": True, "laps": 3}))
    line.write_text("0,0\n2,0\n2,1\n")
    found = {file.name: own_scenario(str(file)) for file in (goal, loop, line)}
    lengths = {"goal.json": 3.0 * 7.0, "loop.json": 3.0 * 8.0, "line.csv": 3.0}
    turns = {"goal.json": 0.0, "loop.json": 3.0 * 2.0 * math.pi, "line.csv": 0.5 * math.pi}
    for name, own in found.items():
        assert own.steps == math.ceil(round((lengths[name] / 0.25 + turns[name] + 20.0) / 0.05, 6))
        assert own.file == str(tmp_path / name)
        quantity = own.contest.spec.quantity(own.scenario)
        assert (own.tiered.quantity, own.tiered.tier) == (quantity, own.contest.spec.tier(quantity))
    assert own_scenario(str(line), 2.0).steps == math.ceil(round((6.0 / 0.25 + 0.5 * math.pi + 20.0) / 0.05, 6))
    assert (own_scenario(str(line), 2.0).env_kwargs, found["goal.json"].env_kwargs) == ({"scale": 2.0}, {})
    with pytest.raises(ValueError, match=r"is 30,000 m long.* at most 10,000 m with --scale, 3\.3e\+03 for example"):
        own_scenario(str(line), 10_000.0)
    with pytest.raises(ValueError, match="--scale belongs to paths"):
        own_scenario(str(goal), 2.0)
    cases = own_cases(str(goal), None, ("polar" if "polar" in POLICIES["goal"] else "dwa", "zero"), "turtlebot3")
    assert [case.policy for case in cases][1] == "zero"
    for case in cases:
        assert (case.contest, case.scenario, case.max_episode_steps) == ("goal", str(goal), found["goal.json"].steps)
        assert case.env_kwargs == {**CONTESTS["goal-obstacles"].env_kwargs, "robot": "turtlebot3"}
        assert case.env_id == GOAL
    every = {case.policy: case.filmed for case in own_cases(str(goal))}
    assert {"zero", "random", "ppo", "hybrid"} <= set(every)
    assert [name for name, is_filmed in every.items() if is_filmed] == ["scan_planner"]
    strange = [case.policy for case in own_cases(str(goal), None, None, "turtlebot3")]  # no agents ship for it
    assert not {"ppo", "hybrid"} & set(strange)
    blocked = tmp_path / "blocked.json"
    walls = [{"kind": "box", "x": 3, "y": 4 + side, "length": 3.0, "width": 0.2} for side in (-1.4, 1.4)]
    walls += [{"kind": "box", "x": 3 + side, "y": 4, "length": 0.2, "width": 3.0} for side in (-1.4, 1.4)]
    blocked.write_text(json.dumps({**told, "obstacles": walls}))
    assert without_way(str(goal)) == ""
    assert without_way(str(line)) == ""
    assert "whoever drives there, nobody arrives" in without_way(str(blocked))


def test_the_clock_in_a_maze_is_that_of_its_way_and_of_endless_laps_that_of_one(tmp_path: Path) -> None:
    free = np.full((60, 100), 254, np.uint8)  # cells of 0.1 m; row 0 is the highest
    free[12:, 50] = 0  # a wall from the bottom, that leaves a gap above
    header = f"P5 {free.shape[1]} {free.shape[0]} 255\n".encode()
    (tmp_path / "maze.pgm").write_bytes(header + free.tobytes())
    told = "image: maze.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
    (tmp_path / "maze.yaml").write_text(told + "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"start": [4, 1, 0], "goal": [6, 1, 0], "map": "maze.yaml"}))
    own = own_scenario(str(scene))
    way = shortest_way(own.scenario, 0.1)
    assert way > 7.0 > 2.0  # over the wall's end, not through it
    assert own.steps == math.ceil((3.0 * way / 0.25 + 20.0) / 0.05)
    # a map that was edited since is read anew: neither its picture nor what stands beside it is remembered
    straight = math.ceil((3.0 * 2.0 / 0.25 + 20.0) / 0.05)
    for file, content in (
        ("maze.yaml", (tmp_path / "maze.yaml").read_bytes().replace(b"0.1\n", b"0.2\n")),  # the wall is 10 m away
        ("maze.pgm", header + np.full_like(free, 254).tobytes()),
    ):
        before = (tmp_path / file).read_bytes()
        (tmp_path / file).write_bytes(content)
        assert own_scenario(str(scene)).steps == straight < own.steps, file
        (tmp_path / file).write_bytes(before)
        assert own_scenario(str(scene)).steps == own.steps
    (tmp_path / "endless.json").write_text(json.dumps({"path": [[0, 0], [2, 0], [2, 2]], "closed": True, "laps": 0}))
    endless = own_scenario(str(tmp_path / "endless.json"))
    assert endless.scenario.laps == 0
    assert endless.steps == math.ceil(((4.0 + math.sqrt(8.0)) / 0.25 + 2.0 * math.pi + 20.0) / 0.05)
