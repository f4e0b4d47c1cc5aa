"""A first look at the contests: `wayfield evaluate --quick`."""

import os
import subprocess
import sys
from pathlib import Path

from wayfield.benchmarks.records.results import read_rows

EVALUATE = [sys.executable, "-m", "wayfield.command", "evaluate"]


def started(folder: Path, *words: object) -> subprocess.Popen[str]:
    """Returns a run of the command in a folder, in a terminal of 80 columns."""
    return subprocess.Popen(
        [*EVALUATE, "--workers", "1", *map(str, words)],
        cwd=folder,
        env=os.environ | {"COLUMNS": "80"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_a_first_look_is_thirty_lines_of_three_policies_a_task(tmp_path: Path) -> None:
    out, err = (run := started(tmp_path, "--quick")).communicate(timeout=300)
    assert run.returncode == 0, err
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
    assert "Traceback" not in err


def test_a_first_look_takes_no_options_that_change_it(tmp_path: Path) -> None:
    out, err = (run := started(tmp_path, "--quick", "--suite", "docking")).communicate(timeout=60)
    assert (run.returncode, out, len(err.splitlines())) == (2, "", 1)
    assert not list(tmp_path.iterdir())
