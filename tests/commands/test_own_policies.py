"""Policies, models and scenarios of one's own in the contests, and what adding a law to the package takes."""

import csv
import dataclasses
import json
import math
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner, Result

import wayfield.benchmarks
import wayfield.envs
from wayfield import policies
from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.entrants import own_policies
from wayfield.benchmarks.records.results import read_rows
from wayfield.envs import path_following
from wayfield.envs.robots import ROBOTS

CHASE = """
import numpy as np
from wayfield.envs import path_following

class Chase:
    knows = "sensors"
    observes = (path_following.Observation,)

    def reset(self, briefing):
        return np.empty((briefing.num_envs, 0))

    def act(self, observation, briefing, memory):
        x, y = observation.preview[:, 4, 0], observation.preview[:, 4, 1]
        return np.column_stack([np.full(len(x), 0.6), 1.2 * y / (x**2 + y**2)])

class Paced(Chase):
    def __init__(self, speed=0.6, turn=1.0):
        self.speed, self.turn = speed, turn

    def act(self, observation, briefing, memory):
        twists = super().act(observation, briefing, memory)
        return twists * [self.speed / 0.6, self.turn * self.speed / 0.6]

class Blind:
    knows = "sensors"
    reset = act = observes = property(lambda self: None)
    del reset

class Narrow(Chase):
    def act(self, observation, briefing, memory):
        return np.zeros(briefing.num_envs)

class Lost(Chase):
    def act(self, observation, briefing, memory):
        return np.full((briefing.num_envs, 2), np.nan)

class Broken(Chase):
    def act(self, observation, briefing, memory):
        return memory.nothing

class Psychic(Chase):
    knows = "everything"
"""
ONE = ("--families", "circles", "--episodes", "1", "--gains", "default")


def evaluate(*arguments: object) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(main, ["--workers", "1", *map(str, arguments)])


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Returns the current folder, with a module in it."""
    (tmp_path / "laws_of_mine.py").write_text(CHASE)
    (tmp_path / "broken_module.py").write_text("import numpy\nx = 1 / 0\n")
    (tmp_path / "half.py").write_text("def half(:\n")
    monkeypatch.chdir(tmp_path)
    path = list(sys.path)
    yield tmp_path
    sys.path[:] = path
    for name in ("laws_of_mine", "broken_module", "half"):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("undrawn")
def test_a_class_of_four_members_takes_part_with_workers_of_their_own(home: Path) -> None:
    own = ("--policy", "laws_of_mine:Chase", "--policy", "laws_of_mine:Paced speed=0.5 turn=2")
    result = evaluate(
        "--suite", "path-following", "--policies", "pure_pursuit", *own, *ONE, "--workers", 2, "--out", "out"
    )
    assert result.exit_code == 0, result.output
    rows = read_rows(home / "out")
    entries = {(row["policy"], row["gains_name"]) for row in rows if row["split"] == "test"}
    paced = ("laws_of_mine:Paced", "own speed=0.5 turn=2")
    assert entries == {("pure_pursuit", "default"), ("laws_of_mine:Chase", "own"), paced}
    # who has no cruising speed is not on the front; who has is asked for each
    swept = [row for row in rows if row["split"] == "front"]
    assert {row["policy"] for row in swept} == {"pure_pursuit", "laws_of_mine:Paced"}
    paces = {row["speed"]: row["mean_speed"] for row in swept if row["policy"] == "laws_of_mine:Paced"}
    assert paces[0.3] < paces[0.45] < paces[0.6]
    with open(home / "out" / "path_following_p3dx.csv", newline="") as file:
        inputs = {line["policy"]: line["inputs"] for line in csv.DictReader(file)}
    assert inputs["laws_of_mine:Chase"] == "own, path errors"
    text = (home / "out" / "table.md").read_text()
    assert "--policy laws_of_mine:Chase" in text
    assert "--workers 2 --out out" in text


def test_a_part_is_played_anew_when_the_module_has_changed(home: Path) -> None:
    before = own_policies.own_policy("laws_of_mine:Chase")
    assert own_policies.own_policy("laws_of_mine:Chase") == before
    (home / "laws_of_mine.py").write_text(CHASE + "\n# changed\n")
    assert own_policies.own_policy("laws_of_mine:Chase") != before


@pytest.mark.parametrize("wrong", [math.nan, -math.inf])
@pytest.mark.parametrize("place", [0, 3])
def test_a_twist_that_is_not_finite_is_refused_wherever_it_stands(wrong: float, place: int) -> None:
    twists = np.zeros((2, 2))

    class Once:
        knows, observes = "sensors", (path_following.Observation,)
        reset = act = staticmethod(lambda *_: twists)

    there: Any = SimpleNamespace(num_envs=2, robot=ROBOTS["p3dx"])
    policy = own_policies.Checked("mine", Once())
    assert policy.act(None, there, twists) is twists
    twists.flat[place] = wrong
    with pytest.raises(ValueError, match=f"'mine': act must return finite twists, got {wrong:g}"):
        policy.act(None, there, twists)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "--policy '' must be module:Class"),
        ("laws_of_mine:Chas", "Did you mean 'Chase'?"),
        ("broken_module:Chase", "ZeroDivisionError: division by zero"),
        ("laws_of_mine:Chase speed=0.5", "speed"),
        ("laws_of_mine:Blind", "lacks 'reset'"),
        ("laws_of_mine:Psychic", "'everything'; it must be one of sensors"),
        ("laws_of_mine:Narrow", "must return twists (2, 2) for p3dx, got shape (2,)"),
        ("laws_of_mine:Broken", "act raises AttributeError"),
        ("model.zip", "'model.zip' cannot be read"),
        ("lqr", "'lqr' is a policy of the package: --policies lqr; "),
        ("lqr q_e=3", '--policy "wayfield.policies.paths.lqr:Lqr q_e=3"'),
        ("ppoo:laws.zip", "choose from PPO, A2C, SAC"),
    ],
)
def test_what_is_no_policy_is_one_line_and_nothing_is_written(home: Path, text: str, said: str) -> None:
    (home / "laws.zip").write_text(CHASE)
    result = evaluate("--suite", "path-following", "--policies", "pure_pursuit", "--policy", text, *ONE, "--out", "out")
    assert result.exit_code in (1, 2), result.output
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (home / "out").exists()


def test_a_damaged_or_bloated_model_is_one_line_that_names_it(home: Path) -> None:
    def written(data: str) -> bytes:
        with zipfile.ZipFile("model.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("data", data)
            archive.writestr("policy.pth", "")
        return (home / "model.zip").read_bytes()

    bad = {
        "more than 16777216 bytes": [written(" " * 2**25)],
        "": [written("[" * 10**5)],
    }
    whole = written(json.dumps({"policy_class": {"__module__": "stable_baselines3.sac.policies"}, "n": [*range(99)]}))
    assert own_policies.own_policy("model.zip").algorithm == "SAC"  # type: ignore[union-attr]
    for at in range(40, whole.index(b"policy.pth") - 40, 7):  # the packed bytes
        bad[""].append(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
    for said, contents in bad.items():
        for content in contents:
            (home / "model.zip").write_bytes(content)
            with pytest.raises(ValueError, match=f"'model.zip'.*{said}") as caught:
                own_policies.own_policy("model.zip")
            assert "\n" not in str(caught.value)


def test_a_policy_of_another_task_is_told_what_both_speak(home: Path) -> None:
    own = ("--policy", "laws_of_mine:Chase")
    result = evaluate("--suite", "goal-obstacles", "--policies", "dwa", *own, "--out", "out")
    assert result.exit_code == 2
    assert "reads wayfield.envs.path_following.Observation, but goal-obstacles gives" in result.stderr
    result = evaluate(*own, "--suite", "documents", "--out", "out")
    assert "--policy belongs to the contests" in result.stderr
    assert "given twice" in evaluate("--suite", "path-following", *own, *own, "--out", "out").stderr
    assert not (home / "out").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_model_drives_as_it_answers_and_another_space_is_refused(home: Path) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO, SAC

    env = gymnasium.make("wayfield/DiffDrivePathFollowing-v0")
    PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu", seed=0).save("mine.zip")
    SAC("MlpPolicy", env, device="cpu", buffer_size=1, policy_kwargs={"net_arch": [4]}).save("soft.zip")
    few = ("--suite", "path-following", "--policies", "lookahead_documented", *ONE)
    result = evaluate(*few, "--policy", "mine.zip", "--policy", "sac:soft.zip", "--out", "out")
    assert result.exit_code == 0, result.output
    warned = [line for line in result.stderr.splitlines() if "can run any code" in line]
    assert [line.split()[1] for line in warned] == ["mine.zip", "soft.zip"]
    tested = {row["policy"]: row for row in read_rows(home / "out") if row["split"] == "test"}
    assert tested["mine.zip"]["knows"] == "own, sensors"
    assert int(tested["mine.zip"]["parameters"].replace(",", "")) > 1000
    # the entrant's twists are the model's own answers to the environment's own observations
    entrant: Any = own_policies.own_policy("mine.zip")
    assert entrant.algorithm == "PPO"
    assert own_policies.own_policy("soft.zip").algorithm == "SAC"  # type: ignore[union-attr]
    (home / "my runs").mkdir()
    Path("soft.zip").rename("my runs/the soft one.zip")
    assert own_policies.own_policy("sac:my runs/the soft one.zip").algorithm == "SAC"  # type: ignore[union-attr]
    # what is given counts: a model of one's own class does not tell it
    assert own_policies.own_policy("td3:my runs/the soft one.zip").algorithm == "TD3"  # type: ignore[union-attr]
    seen, _ = env.reset(seed=3)
    pilot = policies.Pilot(entrant.make({}), env)
    pilot.reset()
    answer, _ = PPO.load("mine.zip", device="cpu").predict(seen, deterministic=True)
    np.testing.assert_array_equal(pilot.act(seen), answer)
    refused = evaluate("--suite", "goal-obstacles", "--policies", "dwa", "--policy", "mine.zip", "--out", "other")
    assert refused.exit_code == 2
    assert "'mine.zip' reads Box(" in refused.stderr
    assert "but the contest has Box(" in refused.stderr
    assert "(goal-obstacles, p3dx: num_beams=72, max_range=5)" in refused.stderr
    assert not (home / "other").exists()


# Scenario files.


@pytest.mark.usefixtures("undrawn")
def test_a_folder_of_paths_is_a_contest(home: Path) -> None:
    folder = home / "courses"
    folder.mkdir()
    (folder / "bend.csv").write_text("x,y\n0,0\n2,0\n3,1\n")
    (folder / "line.json").write_text('{"path": [[0, 0], [3, 0]]}')
    (folder / "NOTES.md").write_text("mine")
    result = evaluate(
        "--scenarios",
        "courses",
        "--policies",
        "pure_pursuit,lookahead_documented",
        "--gains",
        "default",
        "--out",
        "out",
    )
    assert result.exit_code == 0, result.output
    rows = read_rows(home / "out")
    assert {row["family"] for row in rows} == {"bend", "line"}
    assert {row["split"] for row in rows} == {"own", "front"}
    assert all(row["tier"] in ("easy", "medium", "hard") for row in rows)
    assert (home / "out" / "path_following_p3dx.csv").is_file()
    with open(home / "out" / "path_following_p3dx.csv", newline="") as file:
        (first, _) = csv.DictReader(file)
    # two scenarios are too few for an interval
    assert not any("[" in cell for cell in first.values())
    assert "--suite" not in result.output, "no suite holds these scenarios"


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "holds no scenarios"),
        ({"a.csv": "x,y\n0,0\n2,0\n", "b.json": '{"goal": [2, 0, 0]}'}, "a path (a.csv) and a goal (b.json)"),
        ({"a.csv": "x,y\n0,0\n2,0\n", "a.json": '{"path": [[0, 0], [3, 0]]}'}, "names must differ"),
        ({"b.json": '{"goal": [1, 0, 0], "obstacles": [{"kind": "circle", "x": 1, "y": 0, "radius": 0.5}]}'}, "b.json"),
    ],
)
def test_a_folder_that_is_no_contest_is_one_line(home: Path, files: dict[str, str], said: str) -> None:
    (home / "courses").mkdir()
    for name, text in files.items():
        (home / "courses" / name).write_text(text)
    result = evaluate("--scenarios", "courses", "--out", "out")
    assert result.exit_code == 2, result.output
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (home / "out").exists()


# From Python.


@dataclasses.dataclass(frozen=True)
class Still:
    """Stands still."""

    knows = "sensors"
    observes = (path_following.Observation,)

    def reset(self, briefing: Any) -> Any:
        return np.empty((briefing.num_envs, 0))

    def act(self, observation: Any, briefing: Any, memory: Any) -> Any:
        return np.zeros((briefing.num_envs, 2))


def test_compare_returns_what_the_command_writes_and_writes_nothing(home: Path) -> None:
    before = sorted(home.rglob("*"))
    found = wayfield.benchmarks.compare(
        ["pure_pursuit", Still(), "laws_of_mine:Chase"], "path-following", ["circles"], episodes=2, gains="default"
    )
    assert [each for each in sorted(home.rglob("*")) if "__pycache__" not in str(each)] == before
    rows = {(row["policy"], row["episode"]): row for row in found.rows}
    assert {policy for policy, _ in rows} == {"pure_pursuit", "Still", "laws_of_mine:Chase"}
    assert rows["Still", 0.0]["timeout"] == 1.0
    assert rows["pure_pursuit", 1]["success"] == 1.0
    table = found.tables["path_following_p3dx"]
    # those who hold no asked speed, or never arrive, come last
    assert sorted(line[:2] for line in table.rows) == [
        ["Still", "own"],
        ["laws_of_mine:Chase", "own"],
        ["pure_pursuit", "default"],
    ]
    frame = found.frame()
    assert len(frame) == 6


@pytest.mark.parametrize(
    ("given", "options", "said"),
    [
        (["pure_pursit"], {}, "Did you mean 'pure_pursuit'?"),
        ("pure_pursuit", {}, "must be a list"),
        ([3], {}, "is no policy: it lacks 'knows'"),
        (["pure_pursuit"], {"contest": "path-folowing"}, "Did you mean 'path-following'?"),
    ],
)
def test_compare_names_the_argument_that_is_wrong(given: Any, options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said.replace("?", r"\?")):
        wayfield.benchmarks.compare(given, **{"contest": "path-following", **options})
