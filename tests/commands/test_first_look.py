"""A first look at the contests: `wayfield evaluate --quick`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.records.results import read_rows


def test_a_first_look_is_thirty_lines_of_three_policies_a_task(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "wayfield.command", "evaluate", "--workers", "1", "--quick"]
    narrow = os.environ | {"COLUMNS": "80"}  # a terminal of 80 columns
    run = subprocess.run(words, cwd=tmp_path, env=narrow, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    out = run.stdout
    lines = out.splitlines()
    assert len(lines) <= 30
    assert max(map(len, lines)) <= 80
    assert "not a verdict" in out
    assert "Next: wayfield evaluate" in out
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    printed = readme.partition("$ wayfield evaluate --quick\n")[2].partition("```")[0]
    assert printed
    assert printed in out  # what the quick start shows is what it prints
    folder = tmp_path / "results" / "quick"
    rows = read_rows(folder)
    met = {name: {row["policy"] for row in rows if row["contest"] == name} for name in {row["contest"] for row in rows}}
    assert {name: len(policies) for name, policies in met.items()} == {
        "path-following": 3,
        "goal-obstacles": 3,
        "docking": 3,
    }
    assert len(list(folder.glob("*.png"))) == 1
    assert "Traceback" not in run.stderr


def test_a_first_look_takes_no_options_that_change_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke(main, ["--quick", "--suite", "docking"])
    assert (run.exit_code, run.stdout, len(run.stderr.splitlines())) == (2, "", 1)
    assert not list(tmp_path.iterdir())
