"""A search that several processes do together: each set is driven once, and what is there is gone on with."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from wayfield.benchmarks.contests.contest import Score

optuna = pytest.importorskip("optuna")

from wayfield.benchmarks.tuning import tune  # noqa: E402  needs optuna
from wayfield.benchmarks.tuning.shared_study import NoStudy, SharedStudy  # noqa: E402

COMMAND = ("polar", "--suite", "docking", "--trials", "6", "--scenarios", "1", "--workers", "1", "--force")


def search(*words: str, folder: Path) -> "subprocess.Popen[str]":
    """Starts a search."""
    command = [sys.executable, "-m", "wayfield.benchmarks.tuning.tune", *COMMAND, *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder)


def trials(file: Path) -> list[Any]:
    """Returns the sets of the one study in a journal."""
    backend = optuna.storages.journal.JournalFileBackend(str(file))
    storage = optuna.storages.JournalStorage(backend)
    (name,) = optuna.get_all_study_names(storage)
    return list(optuna.load_study(study_name=name, storage=storage).trials)


@pytest.mark.slow
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
