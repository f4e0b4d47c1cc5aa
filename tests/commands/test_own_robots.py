"""Robots of one's own in every command: it drives them, or refuses them in one line before any frame is driven."""

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner, Result

from wayfield.benchmarks.commands import evaluate
from wayfield.benchmarks.commands.comparison import compare
from wayfield.envs.robots import ROBOTS

SHEET = {
    "drive": "differential",
    "wheels": {"radius": 0.05, "track": 0.30},
    "hull": {"radius": 0.22},
    "mass": 6.0,
    "inertia": 0.1,
    "friction": 0.7,
    "rated_wheel_speed": 15.0,
}
LARGE = {"hull": {"radius": 1.02}}
BOX = {"hull": {"kind": "box", "length": 1.6, "width": 1.3}}
PARTIAL = {"sensors": {"beams": 72, "range": 5.0, "angle": 1.5 * math.pi}}
PATH = "wayfield/DiffDrivePathFollowing-v0"
THERE = ", ".join(each for each in ROBOTS if each in ("p3dx", "omni3", "omni4"))  # of goal seekers
GOAL, DOCK = "wayfield/DiffDriveGoalObstacles-v0", "wayfield/DiffDriveDocking-v0"


def cart(folder: Path, **fields: Any) -> str:
    file = folder / "cart.json"
    file.write_text(json.dumps({**SHEET, **fields}))
    return str(file)


def refused(command: click.Command, words: list[str]) -> str:
    """Returns the one line with which a command refuses its words, before it writes anything."""
    found: Result = CliRunner().invoke(command, words)
    assert found.exit_code == 2, found.output
    assert found.stdout == ""
    (line,) = found.stderr.splitlines()
    return line


@pytest.mark.parametrize("fields", [LARGE, BOX])
@pytest.mark.parametrize(("suite", "policy"), [("goal-obstacles", "vfh_plus"), ("docking", "polar")])
def test_gains_are_not_searched_for_a_hull_that_the_scenarios_have_no_way_for(
    tmp_path: Path, fields: dict[str, Any], suite: str, policy: str
) -> None:
    tune = pytest.importorskip("wayfield.benchmarks.tuning.tune")
    out = tmp_path / "gains.json"
    line = refused(tune.main, [policy, "--suite", suite, "--robot", cart(tmp_path, **fields), "--out", str(out)])
    assert "'cart' has a hull of 1.0" in line
    assert "at most 1 m" in line
    assert not out.exists()


@pytest.mark.parametrize(
    ("env_id", "fields", "said"),
    [
        (GOAL, LARGE, "'cart' has a hull of 1.02 m; .* at most 1 m"),
        (DOCK, BOX, "'cart' has a hull of 1.03 m; .* at most 1 m"),
        (GOAL, PARTIAL, "'cart' has sensors.angle 4.71.* rad; .* the full circle, 6.28"),
        (DOCK, PARTIAL, "'cart' has sensors.angle 4.71.* rad; .* the full circle, 6.28"),
        ("wayfield/DiffDrivePathFollowing-v0", {}, "controller_gains=default takes the controller's own"),
    ],
)
def test_training_refuses_a_robot_before_it_drives(
    tmp_path: Path, env_id: str, fields: dict[str, Any], said: str
) -> None:
    pytest.importorskip("stable_baselines3")
    from wayfield.policies.training.command import main

    out = tmp_path / "out"
    line = refused(main, [env_id, "--robot", cart(tmp_path, **fields), "--out", str(out)])
    assert re.search(said, line), line
    assert not out.exists()


SCENE = {"goal": [3, 0, 0.5], "obstacles": [{"kind": "circle", "x": 1.5, "y": 0.6, "radius": 0.3}]}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("option", ["--path", "--scenarios"])
def test_a_trained_policy_without_an_agent_is_left_out_and_the_others_drive(tmp_path: Path, option: str) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "scene.json").write_text(json.dumps(SCENE))
    given = str(folder / "scene.json" if option == "--path" else folder)
    words = [option, given, "--robot", cart(tmp_path), "--dynamics", "kinematic", "--workers", "1"]
    out = tmp_path / "out"
    found = CliRunner().invoke(evaluate.main, [*words, "--policies", "vfh_plus,ppo", "--out", str(out)])
    assert found.exit_code == 0, found.output
    lines = [line for line in found.stderr.splitlines() if "'ppo'" in line]
    assert lines == [
        f"evaluate: policies 'ppo': no agent ships for goal_reaching with cart, but with {THERE}; wayfield train "
        f"{GOAL} --robot cart.json trains one; it is left out"
    ]
    rows = (out / "episodes.csv").read_text().splitlines()
    assert any("vfh_plus" in row for row in rows)
    assert not any("ppo" in row for row in rows)
    alone = [*words, "--policies", "ppo", "--out", str(tmp_path / "alone")]
    assert "--policies 'ppo': no agent ships for goal_reaching with cart" in refused(evaluate.main, alone)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("option", ["--path", "--scenarios"])
def test_laws_that_need_what_a_robot_cannot_do_are_named_in_a_line(tmp_path: Path, option: str) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "way.csv").write_text("x,y\n0,0\n2,0\n")
    given = str(folder / "way.csv" if option == "--path" else folder)
    car = cart(tmp_path, turning_radius=0.4)
    words = [option, given, "--robot", car, "--dynamics", "kinematic", "--workers", "1", "--out", str(tmp_path / "out")]
    found = CliRunner().invoke(evaluate.main, words)
    assert found.exit_code == 0, found.output
    line, agents = (line for line in found.stderr.splitlines() if "left out" in line)
    assert agents == "evaluate: left out with 'cart', of which no agent ships: ppo"
    assert line.startswith("evaluate: left out with 'cart', since they need a robot that turns on the spot")
    rows = (tmp_path / "out/episodes.csv").read_text()
    named = line.rpartition(": ")[2].split(", ")
    assert {"ilqr", "mpc", "regulated_pure_pursuit", "stanley"} <= {*named}
    assert [name for name in (*named, "lqr") if f",{name}," in rows] == ["lqr"]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("sensors", "file", "said"),
    [
        ({"beams": 36, "range": 3.0}, "scene.json", True),
        ({"beams": 72, "range": 5.0}, "scene.json", False),
        ({}, "scene.json", False),
        ({"beams": 36, "range": 3.0}, "way.csv", False),
    ],
)
def test_a_lidar_of_a_sheet_that_a_contest_does_not_use_is_named_in_a_line(
    tmp_path: Path, sensors: dict[str, Any], file: str, said: bool
) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    (tmp_path / "way.csv").write_text("x,y\n0,0\n2,0\n")
    words = ["--path", str(tmp_path / file), "--robot", cart(tmp_path, sensors=sensors), "--workers", "1"]
    policy = "pure_pursuit" if file == "way.csv" else "vfh_plus"
    found = CliRunner().invoke(evaluate.main, [*words, "--policies", policy, "--out", str(tmp_path / "out")])
    assert found.exit_code == 0, found.output
    line = "evaluate: sensors of robot 'cart' are not used but for the angle; every robot here has 72 beams to 5 m"
    assert [each for each in found.stderr.splitlines() if "sensors" in each] == [line] * said


def test_compare_leaves_out_a_trained_policy_without_an_agent_as_evaluate_does(tmp_path: Path) -> None:
    robot = cart(tmp_path)
    where: Any = {"contest": "goal-obstacles", "families": ["clutter_10"], "episodes": 1, "robot": robot}
    with pytest.warns(UserWarning, match="'ppo': no agent ships for goal_reaching with cart, .*; it is left out"):
        found = compare(["vfh_plus", "ppo"], **where)
    assert {row["policy"] for row in found.rows} == {"vfh_plus"}
    with pytest.raises(ValueError, match="'ppo': no agent ships for goal_reaching with cart"):
        compare(["ppo"], **where)


def test_recording_an_agent_that_is_not_there_says_so(tmp_path: Path) -> None:
    record = pytest.importorskip("wayfield.benchmarks.recordings.record")
    words = ["ppo", "--suite", "goal-obstacles", "--robot", cart(tmp_path), "--episodes", "1"]
    assert "'ppo': no agent ships for goal_reaching with cart" in refused(record.main, words)


@pytest.mark.slow
def test_a_data_sheet_of_ones_own_goes_through_every_command(tmp_path: Path) -> None:
    robot = cart(tmp_path)
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    told = os.environ | {"SDL_VIDEODRIVER": "dummy", "MINARI_DATASETS_PATH": str(tmp_path / "sets")}

    def done(*words: str) -> str:
        """Returns what a command prints, once it has ended well."""
        command = [sys.executable, "-m", "wayfield.command", *words]
        found = subprocess.run(command, cwd=tmp_path, env=told, capture_output=True, text=True)
        assert found.returncode == 0, found.stderr
        assert "Traceback" not in found.stderr
        return found.stdout

    where = ["--robot", robot]
    scene = ["--path", "scene.json", *where, "--dynamics", "kinematic", "--workers", "1"]
    assert "vfh_plus" in done("evaluate", *scene, "--policies", "vfh_plus,dwa", "--out", "driven")
    assert (tmp_path / "driven" / "report.html").is_file()
    assert "1 episodes" in done("record", "vfh_plus", "--suite", "goal-obstacles", "--episodes", "1", *where)
    done("render", "--policy", "vfh_plus", "--scenario", "clutter_10/train", *where, "--out", "film.png")
    assert (tmp_path / "film.png").is_file()
    few = ["--frames", "4000", "--trials", "2", "--scenarios", "1", "--workers", "1"]
    assert "gains.json" in done("tune", "vfh_plus", "--suite", "goal-obstacles", *where, *few, "--out", "gains.json")
    assert json.loads((tmp_path / "gains.json").read_text())
    tiny = ["num_envs=24", "horizon=8", "steps=384", "validations=1"]
    sets = [word for setting in tiny for word in ("--set", setting)]
    assert "done" in done("train", PATH, "--preset", "path_following_plain", *where, *sets, "--out", "agents")
    (driven,) = (tmp_path / "agents").glob("**/best/card.json")
    assert json.loads(driven.read_text())["robots"] == ["cart"]
