"""The labs of docs/teaching.md: the model answers pass the checker, and the starter files fail it with a line."""

import runpy
import sys
from pathlib import Path

import pytest

LABS = Path(__file__).parents[2] / "examples/teaching"


def check(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["check.py", *map(str, words)])
    return runpy.run_path(str(LABS / "check.py"))["main"]()


@pytest.mark.parametrize("lab", ["1 lab1.py", pytest.param("2 lab2.json", marks=pytest.mark.slow), "3 lab3.json"])
def test_the_model_answer_passes_and_the_starter_fails(
    lab: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    number, file = lab.split()
    assert check(monkeypatch, number, LABS / "answers" / file, "--seed", "3") == 0, capsys.readouterr().out
    capsys.readouterr()
    assert check(monkeypatch, number, LABS / file) == 1
    failed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("FAIL: ")]
    assert failed
    assert all(20 < len(line) < 300 for line in failed)


@pytest.mark.parametrize(
    ("lab", "file", "old", "new", "told"),
    [
        (1, "lab1.py", "ahead).T)", "(x, y)).T)", "e_d is"),  # nearest to the robot
        (1, "lab1.py", "math.atan2(math.sin(turn), math.cos(turn))", "turn", "e_o is"),  # not wrapped
        (1, "lab1.py", "import math", "import math, wayfield", "line 3 imports wayfield"),
        (1, "lab1.py", "return e_d, e_h,", "return e_d,", "5 numbers: e_d, e_h, e_o, v, w"),
        (2, "lab2.json", '"k_ang"', '"k_angle"', "k_angle"),
        (
            3,
            "lab3.json",
            "lab3_agent",
            str(LABS / "../../policies/agents/path_following_p3dx/seed_0"),
            "trained on p3dx",
        ),
    ],
)
def test_a_mistake_is_named(
    lab: int,
    file: str,
    old: str,
    new: str,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer = (LABS / "answers" / file).read_text(encoding="utf-8")
    assert old in answer
    (tmp_path / file).write_text(answer.replace(old, new), encoding="utf-8")
    assert check(monkeypatch, lab, tmp_path / file) == 1
    assert told in next(line for line in capsys.readouterr().out.splitlines() if line.startswith("FAIL: "))
