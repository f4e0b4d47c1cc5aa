"""Submissions: an entry as a folder, driven again bit by bit; what was changed in it is found and named."""

import csv
import io
import json
import lzma
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from wayfield.benchmarks.commands.evaluate import main as evaluate
from wayfield.benchmarks.commands.submission import (
    CARD,
    ROWS,
    Submission,
    content,
    left_out,
    read_submission,
    signed,
)
from wayfield.benchmarks.commands.submit import submit, verify

SMALL = ("--suite", "docking", "--gains", "default", "--families", "open,wall", "--episodes", "2", "--workers", "1")
OWN = """
import random
import numpy as np
from wayfield.envs import goal_reaching


class Still:
    knows = "sensors"
    observes = (goal_reaching.Observation,)

    def __init__(self, turn=0.0):
        self.turn = turn

    def reset(self, briefing):
        return np.empty((briefing.num_envs, 0))

    def act(self, observation, briefing, memory):
        return np.column_stack([np.full(briefing.num_envs, SPEED), np.full(briefing.num_envs, self.turn)])
"""


def called(command: Any, *words: object) -> Result:
    return CliRunner().invoke(command, [*map(str, words)])


@pytest.fixture(scope="module")
def submitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the submission of a law of the package."""
    folder = tmp_path_factory.mktemp("run")
    assert called(evaluate, *SMALL, "--policies", "polar", "--out", folder / "run").exit_code == 0
    made = called(submit, folder / "run", "polar", "--out", folder / "polar")
    assert made.exit_code == 0, made.output
    return folder / "polar"


def test_an_entry_is_driven_again_to_the_same_bits(submitted: Path) -> None:
    done = called(verify, submitted, "--all")
    assert done.exit_code == 0, done.output
    assert "4 of 4 episodes were driven again, each the same to the last bit" in done.output
    assert sorted(file.name for file in submitted.iterdir()) == [CARD, ROWS]
    for run, told in (
        ("run", "has no entry 'lqr'; it has polar"),
        ("nowhere", "nowhere is no finished run: episodes."),
    ):
        refused = called(submit, submitted.parent / run, "lqr", "--out", submitted.parent / "other")
        assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1)
        assert told in refused.stderr
        assert not (submitted.parent / "other").exists()


def changed(submission: Path, name: str, edit: Callable[[Any], Any]) -> None:
    """Edits the card, or the rows as a list of dictionaries, of a submission; digests stay as they were."""
    file = submission / name
    if name == CARD:
        file.write_text(json.dumps(edit(json.loads(file.read_text()))))
        return
    rows = edit(list(csv.DictReader(io.StringIO(lzma.decompress(file.read_bytes()).decode()))))
    file.write_bytes(content(Submission({}, rows))[ROWS])


def quicker(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    rows[1]["time"] = f"{float(rows[1]['time']) - 0.05!r}"
    return rows


@pytest.mark.parametrize(
    ("name", "edit", "told"),
    [
        (ROWS, quicker, "episode 1 of open/test is not as the card has it"),
        (ROWS, lambda rows: rows[:-1], "has 3 episodes, its card 4"),
        (
            CARD,
            lambda card: card | {"scenarios": card["scenarios"] | {"wall/test": "0" * 64}},
            "episode 0 of wall/test",
        ),
        (CARD, lambda card: card | {"episodes": 3}, "episodes is missing, or no list"),
    ],
    ids=["a number", "a row", "scenarios", "a type"],
)
def test_what_was_changed_is_named_in_a_line(
    submitted: Path, tmp_path: Path, name: str, edit: Callable[[Any], Any], told: str
) -> None:
    copy = shutil.copytree(submitted, tmp_path / "copy")
    changed(copy, name, edit)
    refused = called(verify, copy)
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1), refused.output
    assert told in refused.stderr


@pytest.mark.parametrize(
    ("name", "edit", "told"),
    [
        (CARD, lambda text: text.replace(b'"policy": "polar"', b'"policy": "mpc", "policy": "polar"'), "given twice"),
        (ROWS, lambda packed: packed + packed, "something stands behind its end"),
        (ROWS, lambda packed: lzma.compress(lzma.decompress(packed) + b"a,b\n"), "row 4 has 2 cells, its header"),
    ],
)
def test_what_other_readers_read_otherwise_is_refused_in_a_line(
    submitted: Path, tmp_path: Path, name: str, edit: Callable[[bytes], bytes], told: str
) -> None:
    copy = shutil.copytree(submitted, tmp_path / "copy")
    (copy / name).write_bytes(edit((copy / name).read_bytes()))
    refused = called(verify, copy)
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1), refused.output
    assert told in refused.stderr


def signed_anew(submission: Path, edit: Callable[[list[dict[str, str]]], list[dict[str, str]]]) -> None:
    """Edits the rows of a submission and makes its digests fit."""
    changed(submission, ROWS, edit)
    text = lzma.decompress((submission / ROWS).read_bytes()).decode()
    digests = [signed(row) for row in csv.DictReader(io.StringIO(text))]
    changed(submission, CARD, lambda card: card | {"episodes": digests})


def test_a_number_that_was_signed_anew_is_found_by_driving(submitted: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(submitted, tmp_path / "copy")
    signed_anew(copy, quicker)
    assert len(read_submission(copy).rows) == 4
    refused = called(verify, copy, "--all")
    assert refused.exit_code == 1
    assert "episode 1 of open/test: time is " in refused.stderr


def with_all(name: str, cell: str) -> Callable[[list[dict[str, str]]], list[dict[str, str]]]:
    return lambda rows: [row | {name: cell} for row in rows]


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda rows: [*rows[:2], *with_all("actuators", "ideal")(rows[2:])], "has other actuators than the first"),
        (with_all("seed", "5"), "episode 0 of open/test: its seed is 5, that of the contest"),
        (with_all("scenario", "nowhere/test"), "its scenarios 'nowhere/test' are not those of this version"),
        (
            lambda rows: [{name: cell for name, cell in row.items() if name != "path_length"} for row in rows],
            "episode 0 of open/test: column path_length is left out",
        ),
        (with_all("knows", "sensors, map"), "episode 0 of open/test: knows is sensors, submitted as sensors, map"),
    ],
    ids=["conditions", "seeds", "no scenarios", "a column", "access"],
)
def test_what_was_signed_anew_is_refused_in_a_line(
    submitted: Path, tmp_path: Path, edit: Callable[[Any], Any], told: str
) -> None:
    copy = shutil.copytree(submitted, tmp_path / "copy")
    signed_anew(copy, edit)
    refused = called(verify, copy)
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1), refused.output
    assert told in refused.stderr


def test_a_submission_says_what_it_leaves_out(submitted: Path) -> None:
    whole = read_submission(submitted)
    assert "though it leaves out behind" in called(verify, submitted).output
    (first, *_) = whole.rows
    families = ("open", "behind", "wall", "berth", "moving")
    rows = [first | {"family": family} for family in families]
    assert left_out(Submission({}, rows)) == ""
    assert "more scenarios of one family" in left_out(Submission({}, [*rows, rows[0]]))
    agents = [row | {"policy": "ppo", "gains_name": "trained", "agent_seed": f"{k}"} for row in rows for k in range(5)]
    assert left_out(Submission({}, agents)) == ""
    best = [row for row in agents if row["agent_seed"] == "3"]
    assert left_out(Submission({}, best)) == "it leaves out open, agent 0"


def test_other_code_that_drives_the_same_is_told_of(submitted: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(submitted, tmp_path / "copy")
    changed(copy, CARD, lambda card: card | {"code": "0" * 64, "versions": card["versions"] | {"python": "3.9"}})
    done = called(verify, copy)
    assert done.exit_code == 0
    assert "it was driven by other code (python 3.9 there" in done.output
    signed_anew(copy, quicker)
    refused = called(verify, copy)
    assert "episode 1 of open/test: time is " in refused.stderr
    assert "driven by other code" in refused.stderr


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("speed", "after", "told"),
    [
        ("0.1", "0.1", ""),
        ("random.random()", "random.random()", "episode 0 of open/test: the policy is not deterministic"),
        ("0.1", "0.2", "episode 0 of open/test: "),  # another weight
    ],
    ids=["own", "random", "another"],
)
def test_a_policy_of_ones_own_runs_only_where_it_is_named(
    speed: str, after: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    module = f"submitted_{abs(hash((speed, after)))}"
    source = tmp_path / f"{module}.py"
    source.write_text(OWN.replace("SPEED", speed))
    own = f"{module}:Still turn=0.1"
    run = called(evaluate, *SMALL, "--policies", "polar", "--policy", own, "--out", "run")
    assert run.exit_code == 0, run.output
    made = called(submit, "run", f"{module}:Still (own turn=0.1)", "--policy", own, "--out", "sub")
    assert made.exit_code == 0, made.output
    refused = called(verify, "sub")
    assert "name it with --policy" in refused.stderr
    other = module
    if after != speed:
        other = f"{module}_other"
        (tmp_path / f"{other}.py").write_text(OWN.replace("SPEED", after))
    done = called(verify, "sub", "--policy", f"{other}:Still turn=0.1")
    if told:
        assert done.exit_code == 1
        assert told in done.stderr
        assert done.stderr.count("\n") == 1
        assert ("another file than the one that drove" in done.stderr) == (after != speed)
    else:
        assert done.exit_code == 0, done.output
