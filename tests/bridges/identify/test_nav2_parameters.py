"""`wayfield nav2`: YAML that loads, names that each branch's sources have, values within the sheet."""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from wayfield.bridges.identify.nav2 import COMMITS, DISTROS, MAPPED, Tuned, limits, main, parameters, tuned, yaml_text
from wayfield.envs.robots import ROBOTS, read_robot

# read from the sources of ros-navigation/navigation2 at these commits: what they declare or get
KNOWN = json.loads((Path(__file__).parents[2] / "fixtures" / "nav2_parameters.json").read_text())
PART = {"regulated_pure_pursuit": "regulated_pure_pursuit", "nav2_dwb": "dwb", "nav2_mppi": "mppi"}
CRITICS = {"BaseObstacle", "PathAlign", "GoalAlign", "PathDist", "GoalDist", "RotateToGoal"}


def own(name: str) -> Tuned:
    return tuned(name, ROBOTS["p3dx"])


@pytest.fixture
def lagging(tmp_path: Path) -> Any:
    """Returns a robot with delays, lags and decelerations of its own, slower than the policies' own gains."""
    sheet = ROBOTS["turtlebot3"].sheet | {
        "name": "lagging", "delay": [0.12, 0.16], "gain": [1.0, 0.85], "lag": [0.18, 0.2], "acceleration": 0.7,
        "decelerations": [0.6, 2.5], "saturation": "wheels", "response": "continuous",
    }  # fmt: skip
    file = tmp_path / "lagging.json"
    file.write_text(json.dumps(sheet))
    return read_robot(str(file))


def leaves(block: dict[str, Any]) -> Iterator[str]:
    for name, value in block.items():
        if isinstance(value, dict):
            assert name.endswith("Critic") or name in CRITICS, name
            yield from leaves(value)
        else:
            yield name


@pytest.mark.parametrize("distro", DISTROS)
@pytest.mark.parametrize("name", MAPPED)
def test_every_name_is_in_the_sources_of_the_branch(name: str, distro: str, lagging: Any) -> None:
    assert KNOWN[distro]["commit"].startswith(COMMITS[distro])
    text = yaml_text(parameters([own(name)], lagging, distro, tolerances=True), ["a header"])
    found = yaml.safe_load(text)
    controllers = found["controller_server"]["ros__parameters"]
    assert controllers.pop("controller_plugins") == ["FollowPath"]
    assert set(controllers) == {"FollowPath"}
    assert set(leaves(controllers["FollowPath"])) - {"plugin"} <= set(KNOWN[distro][PART[name]])
    assert set(found["velocity_smoother"]["ros__parameters"]) <= set(KNOWN[distro]["velocity_smoother"])
    for costmap in ("local_costmap", "global_costmap"):
        content = found[costmap][costmap]["ros__parameters"]
        inflation = content.pop("inflation_layer", {})
        assert set(content) | set(inflation) <= set(KNOWN[distro]["costmap"])
    # every value has its origin behind it, but for lists of names and plugins
    for line in text.splitlines():
        key, _, rest = line.strip().partition(": ")
        if rest and not key.startswith("#") and key not in ("plugin", "critics", "controller_plugins"):
            assert "  # " in rest, line


@pytest.mark.parametrize("name", MAPPED)
def test_limits_are_those_of_the_sheet_where_they_are_lower(name: str, lagging: Any) -> None:
    found = yaml.safe_load(yaml_text(parameters([own(name)], lagging, "lyrical"), []))
    block = found["controller_server"]["ros__parameters"]["FollowPath"]
    speed = {"regulated_pure_pursuit": "max_linear_vel", "nav2_dwb": "max_vel_x", "nav2_mppi": "vx_max"}[name]
    assert block[speed] == pytest.approx(limits(lagging)["v"], rel=1e-5)
    smoother = found["velocity_smoother"]["ros__parameters"]
    assert smoother["max_accel"] == pytest.approx([0.7, 0.0, 3.0])
    assert smoother["max_decel"] == pytest.approx([-0.6, 0.0, -2.5])
    if name == "nav2_mppi":
        assert (block["ax_max"], block["ax_min"]) == (0.7, -0.6)
        assert (block["model_delay_vx"], block["model_delay_wz"]) == (0.12, 0.16)
    if name == "regulated_pure_pursuit":  # speed^2 / deceleration
        assert block["approach_velocity_scaling_dist"] == pytest.approx(limits(lagging)["v"] ** 2 / 0.6, rel=1e-4)


def test_the_footprint_of_a_box_is_its_corners() -> None:
    robot = dataclasses.replace(ROBOTS["husky"], name="off", hull_x=-0.2)
    found = yaml.safe_load(yaml_text(parameters([own("nav2_dwb")], robot, "jazzy"), []))
    text = found["local_costmap"]["local_costmap"]["ros__parameters"]["footprint"]
    assert json.loads(text) == [[0.3, 0.33], [0.3, -0.33], [-0.7, -0.33], [-0.7, 0.33]]


def test_what_a_branch_lacks_is_said(lagging: Any) -> None:
    texts = {distro: yaml_text(parameters([own("nav2_mppi")], lagging, distro), []) for distro in DISTROS}
    assert "model_delay_vx" in texts["lyrical"]
    assert "jazzy has no model_delay_vx" in texts["jazzy"]
    assert "try true" in texts["jazzy"]
    assert "open_loop: kilted has no such parameter" in texts["kilted"]
    for text in texts.values():
        assert "lag 0.18 s and 0.2 s: Nav2 has no model of it" in text
        assert "gain 1 and 0.85: Nav2 takes what it asks for as reached" in text
        assert "each wheel saturates by itself" in text


def test_the_command_writes_tuned_gains_and_refuses_others_in_a_line(tmp_path: Path) -> None:
    gains, out = tmp_path / "gains.json", tmp_path / "params.yaml"
    content = {
        "policy": "regulated_pure_pursuit", "robot": "p3dx", "sheet": "another", "speed": 0.6, "level": "none",
        "chosen": "search", "frames": 1000, "gains": {"min_radius": 0.726, "speed": 0.5},
        "validation": {"chosen": {"failures": 3, "episodes": 130}},
    }  # fmt: skip
    gains.write_text(json.dumps(content))
    words = ["nav2_dwb", "--robot", "p3dx", "--distro", "kilted", "--out", str(out)]
    ended = CliRunner().invoke(main, [str(gains), *words])
    assert ended.exit_code == 0, ended.stderr
    text = out.read_text()
    found = yaml.safe_load(text)["controller_server"]["ros__parameters"]
    assert found["controller_plugins"] == ["FollowPath", "nav2_dwb"]
    assert found["FollowPath"]["desired_linear_vel"] == 0.5
    assert found["FollowPath"]["regulated_linear_scaling_min_radius"] == 0.726
    for said in ("3 failures in 130 episodes", "ANOTHER SHEET", "A start, not a promise", "bend_span"):
        assert said in text
    for bad in (
        content | {"policy": "vfh_plus"},
        content | {"gains": {"min_radius": "wide"}},
        content | {"gains": {"unheard_of": 1.0}},
        content | {"policy": 3},
    ):
        gains.write_text(json.dumps(bad))
        ended = CliRunner().invoke(main, [str(gains), "--robot", "p3dx", "--out", str(tmp_path / "other.yaml")])
        assert ended.exit_code == 2
        assert len(ended.stderr.splitlines()) == 1, ended.stderr
        assert not (tmp_path / "other.yaml").exists()
