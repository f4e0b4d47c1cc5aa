"""A search that several processes do together: each set is driven once, and what is there is gone on with."""

import dataclasses
import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from wayfield.benchmarks.contests.contest import Score

optuna = pytest.importorskip("optuna")

from wayfield.benchmarks import tune  # noqa: E402  needs optuna
from wayfield.benchmarks.shared_study import NoStudy, SharedStudy  # noqa: E402
from wayfield.envs.robots import ROBOTS  # noqa: E402

COMMAND = ("polar", "--suite", "docking", "--trials", "6", "--scenarios", "1", "--workers", "1", "--force")


def search(*words: str, folder: Path) -> "subprocess.Popen[str]":
    """Starts a search."""
    command = [sys.executable, "-m", "wayfield.benchmarks.tune", *COMMAND, *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder)


def trials(file: Path) -> list[Any]:
    """Returns the sets of the one study in a journal."""
    backend = optuna.storages.journal.JournalFileBackend(str(file))
    storage = optuna.storages.JournalStorage(backend)
    (name,) = optuna.get_all_study_names(storage)
    return list(optuna.load_study(study_name=name, storage=storage).trials)


def test_two_processes_search_one_study_and_a_third_goes_on_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ("--study", "found.journal", "--out", "gains.json")
    both = [search(*asked, folder=tmp_path) for _ in range(2)]
    told = [process.communicate(timeout=600) for process in both]
    assert [process.returncode for process in both] == [0, 0], told
    complete = [each for each in trials(tmp_path / "found.journal") if each.state == optuna.trial.TrialState.COMPLETE]
    assert len(complete) == 6
    sets = [json.dumps(each.params, sort_keys=True) for each in complete]
    assert len(set(sets)) == 6
    written = json.loads((tmp_path / "gains.json").read_text())
    assert written["frames"] > sum(each.user_attrs["frames"] for each in complete)
    assert "--study found.journal" in written["command"]
    monkeypatch.chdir(tmp_path)
    again = CliRunner().invoke(tune.main, [*COMMAND, *asked])
    assert again.exit_code == 0, again.stderr
    assert json.loads((tmp_path / "gains.json").read_text()) == written
    after = trials(tmp_path / "found.journal")
    assert [each.params for each in after if each.state == optuna.trial.TrialState.COMPLETE] == [
        each.params for each in complete
    ]


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_search_drives_as_many_sets_as_it_was_asked_for_and_those_that_were_given_first(
    count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two, where one is given: the policy's own gains and that one. Waiting for its turn is not having been driven."""
    driven: list[tuple[str, dict[str, Any], float]] = []
    scores: list[Score] = []

    def drive(_: tune.Search, gains: dict[str, Any], split: str, engine: Any, least: float = 0.0) -> tune.Drive:
        driven.append((split, dict(gains), least))
        scores.append(Score(0, 0, 1.0, 0.4 + 0.01 * len(driven), 1, 100 + len(driven)))
        return tune.Drive(scores[-1])

    monkeypatch.setattr(tune.Search, "drive", drive)
    monkeypatch.setattr(tune, "tuned_set", lambda *_: None)
    # what is given beyond the range of a gain is brought into it
    given = {"q_e": 50.0, "q_th": 300.0, "rounding": 0.001, "lateral_acceleration": 0.5, "share": 0.8, "pace": 1.2}
    within = given | {"q_th": 40.0, "rounding": 0.03}
    contest = tune.CONTESTS["path-following"]
    asked = tune.Search("lqr", contest, ROBOTS["p3dx"], 0.6, "moderate", "slow", 10**9, count, 1, 3, (given,))
    found = asked.run(lambda *_: [])
    # given again, the command that the file names asks for the same
    python, *words = shlex.split(found["command"])
    assert (python, words[:2]) == ("python", ["-m", "wayfield.benchmarks.tune"])
    told = tune.main.make_context("tune", words[2:]).params
    assert [json.loads(each) for each in told["started_from"]] == [given]
    for name in ("policy", "robot", "speed", "level", "actuators", "frames", "trials", "scenarios", "seed"):
        assert told[name] == getattr(asked, name), name
    assert told["suite"] == contest.name
    searched = [each for each in driven if each[0] == tune.SEARCH_SPLIT]
    validated = driven[count:]
    assert len(searched) == count
    # the policy's own gains are the first of the search, and are not validated twice
    assert len(validated) == 1 + min(count - 1, tune.FINALISTS)
    assert {split for split, *_ in validated} == {tune.TRANSFER_SPLIT}
    assert found["frames"] == sum(each.frames for each in scores)
    if count > 1:
        assert searched[1][1] == {name: value for name, value in within.items() if name != "pace"} | {"speed": 0.72}
    # no set shall be slower than the policy's own gains, where it is searched as where it is chosen
    for drives, first in ((searched, scores[0]), (validated, scores[count])):
        assert [least for *_, least in drives] == [0.0] + [first.mean_speed] * (len(drives) - 1)
    before = list(driven)
    for seed, alike in ((3, True), (4, count < 3)):  # the third is the first that chance draws
        driven.clear()
        dataclasses.replace(asked, seed=seed).run(lambda *_: [])
        assert ([gains for _, gains, _ in driven] == [gains for _, gains, _ in before]) is alike


@pytest.mark.parametrize(("policy", "suite", "speed"), [("lqr", "path-following", 1.1), ("dwa", "goal-obstacles", 0.6)])
def test_gains_are_drawn_from_their_ranges_and_no_cruising_speed_is_beyond_the_robot(
    policy: str, suite: str, speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, tuple[float, float, bool]] = {}

    def suggest(_: Any, name: str, low: float, high: float, *, log: bool = False) -> float:
        drawn[name] = low, high, log
        return high

    driven: list[dict[str, Any]] = []

    def drive(_: tune.Search, gains: dict[str, Any], split: str, *rest: Any) -> tune.Drive:
        driven.append(gains)
        return tune.Drive(Score(0, 0, 1.0, 0.5, 1, 1))

    monkeypatch.setattr(optuna.trial.Trial, "suggest_float", suggest)
    monkeypatch.setattr(tune.Search, "drive", drive)
    robot = ROBOTS["p3dx"]
    asked = tune.Search(policy, tune.CONTESTS[suite], robot, speed, "none", "lagged", 10**9, 1, 1, 0)
    asked._searched(lambda *_: [])
    fastest = float(robot.max_twist[0])
    paced = suite == "path-following"
    if paced:
        low, high, log = drawn.pop("pace")
        assert (low, log) == (tune.PACE_FACTORS[0], False)
        assert high == pytest.approx(min(tune.PACE_FACTORS[1], fastest / speed))
        assert driven[0]["speed"] == pytest.approx(fastest, rel=5e-3)
    assert drawn == {name: (each.low, each.high, each.log) for name, each in tune.SEARCHED[policy].items()}
    assert {name: driven[0][name] for name in drawn} == {
        name: tune.rounded(each.high) for name, each in tune.SEARCHED[policy].items()
    }


@pytest.mark.parametrize("where", ["journal", "sqlite"])
def test_a_study_keeps_sets_for_all_who_open_it(tmp_path: Path, where: str) -> None:
    place = str(tmp_path / "s.journal") if where == "journal" else f"sqlite:///{tmp_path}/s.db"
    one = SharedStudy(place, "a", [{"k": 1.0}, {"k": 2.0}])
    other = SharedStudy(place, "a", [{"k": 1.0}, {"k": 2.0}])
    drawn = []
    for shared in (one, other, one):
        trial = shared.study.ask()
        drawn.append((trial.number, trial.suggest_float("k", 0.1, 5.0)))
        if trial.number != 1:
            shared.tell(trial, Score(trial.number, 0, 0.5, frames=10), {"k": drawn[-1][1]})
    assert drawn[:2] == [(0, 1.0), (1, 2.0)]
    assert drawn[2][0] == 2
    assert one.frames == other.frames == 20
    assert one.begun == 3
    assert one.others() == 1
    assert [gains["k"] for _, gains in other.scored()] == [1.0, drawn[2][1]]
    assert other.scored()[0][0] == Score(0, 0, 0.5, frames=10)
    assert SharedStudy(place, "another search", [{"k": 3.0}]).begun == 0


def test_a_file_that_is_no_study_is_named_and_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("precious\n")
    with pytest.raises(NoStudy, match=r"--study '.*notes\.txt' cannot be used"):
        SharedStudy(str(file), "a", [])
    assert file.read_text() == "precious\n"
    with pytest.raises(NoStudy, match="cannot be used"):
        SharedStudy(str(tmp_path / "no" / "folder" / "x"), "a", [])
