"""Submissions: an entry as a folder, driven again bit by bit; what was changed in it is found and named."""

import csv
import io
import json
import lzma
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from wayfield.benchmarks.commands.evaluate import main as evaluate
from wayfield.benchmarks.commands.submission import CARD, ROWS, Submission, content, drawn, least_seen, signed
from wayfield.benchmarks.commands.submit import submit, verify

ENTRY = ("--suite", "docking", "--gains", "default", "--workers", "1")
OWN = """
import functools, gc, random, sys, time
import numpy as np
from gymnasium.vector import VectorEnv
from wayfield.envs import goal_reaching


@functools.cache
def sees_an_environment():
    return any(isinstance(each, VectorEnv) for each in gc.get_objects())


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
Rows = list[dict[str, str]]


def called(command: Any, *words: object) -> Result:
    return CliRunner().invoke(command, [*map(str, words)])


@pytest.fixture(scope="module")
def submitted(undrawn_module: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the submission of a law of the package."""
    folder = tmp_path_factory.mktemp("run")
    assert called(evaluate, *ENTRY, "--policies", "polar", "--out", folder / "run").exit_code == 0
    made = called(submit, folder / "run", "polar", "--out", folder / "polar")
    assert made.exit_code == 0, made.output
    return folder / "polar"


def refused_in_a_line(done: Result) -> str:
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1), done.output
    return done.stderr


def test_an_entry_is_driven_again_to_the_same_bits(submitted: Path) -> None:
    done = called(verify, submitted, "--all")
    assert done.exit_code == 0, done.output
    assert "50 of 50 episodes were driven again, each the same to the last bit" in done.output
    assert sorted(file.name for file in submitted.iterdir()) == [CARD, ROWS]
    few = called(verify, submitted, "--sample", 5).output
    assert few != called(verify, submitted, "--sample", 5).output  # nobody foresees the draw
    seed = few.partition("--seed ")[2].partition(",")[0]
    assert few == called(verify, submitted, "--sample", 5, "--seed", seed).output


def test_what_is_no_whole_entry_is_not_submitted(submitted: Path, tmp_path: Path) -> None:
    for run, told in (("run", "has no entry 'lqr'; it has polar"), ("no", "no is no finished run: episodes.")):
        assert told in refused_in_a_line(called(submit, submitted.parent / run, "lqr", "--out", tmp_path / "other"))
    few = ("--families", "open,wall", "--episodes", "2", "--policies", "polar", "--out", tmp_path / "few")
    assert called(evaluate, *ENTRY, *few).exit_code == 0
    told = refused_in_a_line(called(submit, tmp_path / "few", "polar", "--out", tmp_path / "other"))
    assert "8 of the 10 frozen scenarios of open/test are missing, 46 of all" in told
    assert not (tmp_path / "other").exists()


def test_a_draw_meets_forged_episodes_as_often_as_it_says() -> None:
    for count, driven in ((50, 5), (130, 60), (7, 7), (2, 1)):
        forged = least_seen(count, driven)
        met = [bool(set(range(forged)) & set(drawn(count, driven, seed))) for seed in range(2000)]
        assert sum(met) / len(met) > 0.93
        assert forged <= count - driven + 1


def rows_of(submission: Path) -> Rows:
    return list(csv.DictReader(io.StringIO(lzma.decompress((submission / ROWS).read_bytes()).decode())))


def signed_anew(submission: Path, rows: Rows) -> None:
    """Puts rows into a submission, with digests that fit."""
    (submission / ROWS).write_bytes(content(Submission({}, rows))[ROWS])
    with_card(submission, episodes=[signed(row) for row in rows_of(submission)])


def with_card(submission: Path, **fields: Any) -> None:
    file = submission / CARD
    file.write_text(json.dumps(json.loads(file.read_text()) | fields))


Tamper = Callable[[random.Random, Rows], Rows]


def cell(name: str, forged: Callable[[random.Random, str], str]) -> Tamper:
    """Returns a tamper with one cell of a column."""

    def edit(draw: random.Random, rows: Rows) -> Rows:
        row = draw.choice(rows)
        row[name] = forged(draw, row[name])
        return rows

    return edit


def measured(draw: random.Random, rows: Rows) -> Rows:
    number = draw.randrange(len(rows))
    names = [name for name, text in rows[number].items() if text.replace(".", "").isdigit() and "." in text]
    name = draw.choice([each for each in names if each not in ("failure_cost", "quantity")])
    rows[number][name] = f"{float(rows[number][name]) * draw.uniform(0.5, 0.99)!r}"
    return rows


def without(draw: random.Random, rows: Rows) -> Rows:
    gone = draw.sample(range(len(rows)), draw.randint(1, 20))
    return [row for k, row in enumerate(rows) if k not in gone]


def doubled(draw: random.Random, rows: Rows) -> Rows:
    one, other = draw.sample(range(len(rows)), 2)  # the better one in place of a worse one
    rows[one] = dict(rows[other])
    return rows


def moved(draw: random.Random, rows: Rows) -> Rows:
    family = draw.choice(rows)["family"]
    one, other = draw.sample([row for row in rows if row["family"] == family], 2)
    one["episode"], other["episode"] = other["episode"], one["episode"]
    return rows


def no_column(draw: random.Random, rows: Rows) -> Rows:
    name = draw.choice(("path_length", "effort", "knows", "learned_from", "tier"))
    return [{each: text for each, text in row.items() if each != name} for row in rows]


TAMPERS: dict[str, tuple[Tamper, str]] = {
    "a number": (measured, "submitted as"),
    "times": (cell("time", lambda draw, _: f"{draw.randint(20, 80) * 0.05!r}"), "time is "),
    "successes": (cell("success", lambda _, text: f"{1 - int(text)}"), "success"),
    "more than a success": (cell("success", lambda draw, _: draw.choice(("1e9", "inf", "1.0", "-1"))), "must be 0 or"),
    "two outcomes": (lambda draw, rows: [row | {"success": "1", "collision": "1"} for row in rows], "are both 1"),
    "less than no time": (cell("time", lambda draw, _: draw.choice(("-1e6", "-0.05", "nan"))), "must be a number"),
    "training": (cell("learned_from", lambda draw, _: f"{draw.randint(1, 9)} M frames"), "learned_from is 0 frames"),
    "access": (cell("knows", lambda draw, _: draw.choice(("path", "map", "bodies"))), "knows is "),
    "parameters": (cell("parameters", lambda draw, _: f"{draw.randint(100, 999)}"), "parameters is "),
    "tiers": (cell("quantity", lambda draw, _: f"{draw.random():.3f}"), "quantity is "),
    "gains": (cell("gains", lambda draw, _: f"k_rho={draw.random():.2f}"), "has the gains"),
    "conditions": (cell("actuators", lambda draw, _: draw.choice(("ideal", "delayed"))), "has other actuators than"),
    "seeds": (cell("seed", lambda draw, text: f"{int(text) + draw.randint(1, 9)}"), "its seed is"),
    "families": (cell("family", lambda draw, _: draw.choice(("nowhere", ""))), "its family is"),
    "scenarios": (cell("scenario", lambda draw, _: draw.choice(("nowhere/test", "open/train"))), "are not those"),
    "no column": (no_column, ""),
    "a column of the run": (lambda _, rows: [row | {"trajectory": "0"} for row in rows], "is no column of"),
    "missing rows": (without, "are missing"),
    "doubled rows": (doubled, "comes twice"),
    "rows of other episodes": (moved, "its seed is"),
}


@pytest.mark.parametrize("kind", TAMPERS)
def test_rows_that_were_forged_and_signed_anew_are_found(kind: str, submitted: Path, tmp_path: Path) -> None:
    tamper, told = TAMPERS[kind]
    original = rows_of(submitted)
    for number in range(3):
        draw = random.Random(f"{kind} {number}")
        copy = shutil.copytree(submitted, tmp_path / f"{number}")
        forged = tamper(draw, [{"gains": ""} | row for row in original])
        signed_anew(copy, forged)
        assert told in refused_in_a_line(called(verify, copy, "--all"))
        if kind == "times":  # driving alone shows it: a draw finds it where it meets the episode
            (place,) = (k for k, row in enumerate(forged) if row["time"] != original[k]["time"])
            met = place in drawn(len(forged), 15, number)
            assert called(verify, copy, "--sample", 15, "--seed", number).exit_code == met


def of_card(name: str, value: Any) -> Callable[[bytes], bytes]:
    return lambda text: json.dumps(json.loads(text) | {name: value}).encode()


def of_text(edit: Callable[[bytes], bytes]) -> Callable[[bytes], bytes]:
    return lambda packed: lzma.compress(edit(lzma.decompress(packed)))


def says_less(packed: bytes) -> bytes:
    """Returns rows whose index tells of fewer bytes than they unpack to."""
    place = len(packed) - 12 - (int.from_bytes(packed[-8:-4], "little") + 1) * 4 + 4
    return packed[:place] + bytes([packed[place] ^ 1]) + packed[place + 1 :]


@pytest.mark.parametrize(
    ("name", "edit", "told"),
    [
        (ROWS, of_text(lambda text: text.replace(b",0.", b",1.", 1)), "is not as the card has it"),
        (ROWS, of_text(lambda text: text.rsplit(b"\n", 2)[0] + b"\n"), "has 49 episodes, its card 50"),
        (ROWS, of_text(lambda text: text + text.rsplit(b"\n", 2)[1]), "has more episodes than the 50 of its card"),
        (ROWS, of_text(lambda text: text + b"a,b\n"), "row 50 has 2 cells, its header"),
        (ROWS, lambda packed: packed + packed, "something stands behind its end"),
        (ROWS, says_less, "holds no packed rows"),
        (CARD, lambda text: text.replace(b'"policy": "polar"', b'"policy": "mpc", "policy": "polar"'), "given twice"),
        (CARD, of_card("episodes", 3), "episodes is missing, or no list"),
        (CARD, of_card("policy", "0" * 64), "but the entry is none of a policy of somebody's own"),
        (CARD, of_card("code", "0" * 64), "code is 000000000000, but versions has"),
        (CARD, of_card("code", ""), "code is ; it must be a digest of 64"),
        (CARD, of_card("score", "100 %"), "'score' is no field of a card"),
        (CARD, of_card("versions", {}), "but versions has none"),
        (CARD, lambda text: text.replace(b'"python": "3', b'"python": "3\\n50 of 50'), "which is no version"),
        (CARD, of_card("scenarios", {}), "its scenarios 'open/test' are not those of this version"),
        (
            CARD,
            lambda text: text.replace(b'ios": {', b'ios": {"open/claims": "0",'),
            "scenarios 'open/claims', of",
        ),
    ],
)
def test_files_that_contradict_themselves_are_refused_in_a_line(
    submitted: Path, tmp_path: Path, name: str, edit: Callable[[bytes], bytes], told: str
) -> None:
    copy = shutil.copytree(submitted, tmp_path / "copy")
    (copy / name).write_bytes(edit((copy / name).read_bytes()))
    assert told in refused_in_a_line(called(verify, copy))


def test_other_code_that_drives_the_same_is_told_of(submitted: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(submitted, tmp_path / "copy")
    versions = json.loads((copy / CARD).read_text())["versions"]
    older = {"python": "3.9", "code and agents": "0" * 12, "commit": "abc1234"}
    with_card(copy, code="0" * 64, versions=versions | older)
    done = called(verify, copy, "--sample", 1)
    assert done.exit_code == 0
    assert "it was driven by other code (code and agents 000000000000 there" in done.output
    assert "python 3.9 there" in done.output
    assert "commit abc1234 there" in done.output
    own = json.loads((submitted / CARD).read_text())
    with_card(copy, code=own["code"], versions=own["versions"] | {"numpy": "0.1", "author": "me"})
    told = called(verify, copy, "--sample", 1).output
    assert "its card names other versions" in told
    assert "numpy 0.1 there" in told
    assert "author me there" in told
    with_card(copy, code="0" * 64, versions=versions | older)
    signed_anew(copy, [row | {"time": "1.0"} for row in rows_of(copy)])
    assert "driven by other code" in refused_in_a_line(called(verify, copy, "--sample", 1))


@pytest.fixture(scope="module")
def of_ones_own(submitted: Path) -> Path:
    """Returns the submission of a policy of one's own, `still:Still turn=0.1`, at 0.1 m/s."""
    folder = submitted.parent / "mine"
    folder.mkdir()
    (folder / "still.py").write_text(OWN.replace("SPEED", "0.1"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run = called(evaluate, *ENTRY, "--policies", "polar", "--policy", "still:Still turn=0.1", "--out", "run")
        assert run.exit_code == 0, run.output
        named = ("still:Still (own turn=0.1)", "--policy", "still:Still turn=0.1")
        made = called(submit, "run", *named, "--out", folder / "entry")
        assert made.exit_code == 0, made.output
    return folder / "entry"


@pytest.mark.parametrize(
    ("speed", "told"),
    [
        ("0.1", ""),
        ("0.1 + sees_an_environment()", ""),
        ("random.random()", "the policy is not deterministic"),
        ("0.2", "submitted as"),
        ("0.1 + bool(time.sleep(1))", "verify: 'still:Still': act took over 0.5 s"),
        ("sys.exit(3)", "verify: 'still:Still': its process ended with status 3"),
    ],
    ids=["same", "curious", "random", "another", "slow", "gone"],
)
def test_a_policy_of_ones_own_runs_where_it_is_named_in_a_process_that_has_no_environment(
    speed: str, told: str, of_ones_own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "name it with --policy" in refused_in_a_line(called(verify, of_ones_own))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "still.py").write_text(OWN.replace("SPEED", speed))
    done = called(verify, of_ones_own, "--policy", "still:Still turn=0.1", "--sample", 2, "--seconds", 0.5)
    assert done.exit_code == bool(told), done.output
    assert ("another file than the one that drove" in done.output) == (speed != "0.1")
    assert told in (refused_in_a_line(done) if told else done.output)
