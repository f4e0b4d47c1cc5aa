"""What a search says at its end."""

import ast
import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from wayfield import policies
from wayfield.envs.robots import ROBOTS

tune = pytest.importorskip("wayfield.benchmarks.tuning.tune")


@pytest.mark.slow
def test_a_search_for_an_identified_robot_says_what_it_gains_within_the_intervals(tmp_path: Path) -> None:
    sheet = ROBOTS["p3dx"].sheet | {"name": "mine", "delay": [0.12, 0.16], "response": "continuous"}
    interval = {"value": [0.12, 0.16], "low": [0.08, 0.1], "high": [0.2, None], "method": "by hand"}
    robot, file = tmp_path / "mine.json", tmp_path / "gains.json"
    robot.write_text(json.dumps(sheet | {"sources": {"delay": interval}}), encoding="utf-8")
    words = ["pure_pursuit", "--suite", "path-following", "--robot", str(robot), "--out", str(file), "--speed", "0.4"]
    start = json.dumps({"lookahead_distance": 0.2})
    words += ["--trials", "2", "--frames", "1", "--scenarios", "1", "--workers", "1", "--from", start]
    found = CliRunner().invoke(tune.main, words)
    assert found.exit_code == 0, found.output
    content = json.loads(file.read_text(encoding="utf-8"))
    same, others = content["validation"]["compared"]
    assert others["episodes"] == 4 * same["episodes"]
    default = content["validation"]["finalists"]["default"]
    drawn = [default[name]["quality"] for name in default if ", drawn" in name]
    assert len(set(drawn)) == 4  # robots of different delays err differently
    table = [line.split() for line in found.stdout.splitlines() if "as identified" in line or "drawn from" in line]
    assert [line[:1] for line in table] == [["1"], ["4"]]


def test_a_search_ends_with_a_table_of_gains_and_the_line_that_makes_the_policy(tmp_path: Path) -> None:
    file = tmp_path / "gains.json"
    budget = ["--trials", "1", "--frames", "1", "--scenarios", "1", "--workers", "1"]
    start = json.dumps({"lookahead_distance": 0.4, "pace": 1.1})
    words = ["pure_pursuit", "--suite", "path-following", *budget, "--from", start, "--out", str(file)]
    found = CliRunner().invoke(tune.main, words)
    assert found.exit_code == 0, found.output
    assert "{" not in found.stdout
    content = json.loads(file.read_text())
    rows = {line.split()[0]: line.split()[1:] for line in found.stdout.splitlines() if re.match(r"  \w", line)}
    assert rows.pop("gain") == ["default", "chosen"]
    default = policies.make("pure_pursuit", **content["validation"]["finalists"]["default"]["gains"])
    chosen = policies.make("pure_pursuit", **content["gains"])
    assert set(rows) == {"lookahead_distance", "deceleration", "speed"}  # what is searched, and the pace
    for name, (before, after) in rows.items():
        assert float(before) == pytest.approx(getattr(default, name), rel=1e-5)
        assert float(after) == pytest.approx(getattr(chosen, name), rel=1e-5)
    (line,) = (line for line in found.stdout.splitlines() if line.startswith("Use them: "))
    call = ast.parse(line.removeprefix("Use them: "), mode="eval").body
    assert isinstance(call, ast.Call)
    gains = {each.arg: ast.literal_eval(each.value) for each in call.keywords}
    assert policies.make(*map(ast.literal_eval, call.args), **gains) == chosen
