"""Names and files of the user's reach figures, tables and the terminal as plain text, and a pickle with a warning."""

from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks import compare
from wayfield.benchmarks.commands import play
from wayfield.benchmarks.contests import ALL_CONTESTS
from wayfield.benchmarks.figures import video
from wayfield.benchmarks.figures.contest_figures import FIGURES
from wayfield.benchmarks.figures.document_figures import driven_paths
from wayfield.benchmarks.figures.drawing import saved
from wayfield.benchmarks.leaderboards.terminal import print_short
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.table import Table, code_span
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.system.command_line import OneLineErrors
from wayfield.system.readers import READERS

NAME = r"$^$ \$ $x_"
ESCAPE = "\x1b[2J<img src=x>"


def test_a_dollar_in_a_name_is_a_dollar_in_a_figure(tmp_path: Path) -> None:
    times = np.arange(3.0)
    way = Trajectory(times=times, poses=np.zeros((3, 3)), path=np.array([[0.0, 0.0], [1.0, 0.0]]))
    row = {"policy": f"mine:Mine {NAME}", "gains": "own"}
    saved(lambda: driven_paths({NAME: [(row, way)]}), tmp_path / "driven")
    contest = ALL_CONTESTS["path-following"]
    cells = {
        "policy": NAME,
        "gains_name": NAME,
        "robot": "p3dx",
        "family": NAME,
        "split": "test",
        "disturbance": "none",
    }
    rows = Episodes([dict.fromkeys(("success", contest.spec.cost.metric), 1.0) | cells])
    for name in ("families", "ladder"):
        saved(lambda name=name: FIGURES[name](contest, rows, tmp_path), tmp_path / name)
    for name in ("driven", "families", "ladder"):
        assert NAME in (tmp_path / f"{name}.svg").read_text(encoding="utf-8")


def test_a_ladder_on_which_nobody_succeeds_is_drawn(tmp_path: Path) -> None:
    contest = ALL_CONTESTS["path-following"]
    row = {"policy": "zero", "gains_name": "", "success": 0.0, contest.spec.cost.metric: np.nan, "disturbance": "none"}
    saved(lambda: FIGURES["ladder"](contest, Episodes([row]), tmp_path), tmp_path / "ladder")


def test_every_command_warns_before_it_loads_a_pickle(tmp_path: Path) -> None:
    model = READERS["model of stable-baselines3"].fill(tmp_path)
    with pytest.warns(UserWarning, match=r"model\.zip is loaded with pickle"), pytest.raises(ValueError, match="model"):
        compare([model], contest="path-following", families=["circles"], episodes=1)
    for command, words in (
        (video.main, ["--policy", str(model), "--out", "x.png"]),
        (play.main, ["--ghost", str(model)]),
    ):
        ended = CliRunner().invoke(command, words, env={"DISPLAY": ":0"})
        assert ended.exit_code == 2
        assert "model.zip is loaded with pickle" in ended.stderr
        assert len(ended.stderr.splitlines()) == 2


def test_a_terminal_and_a_page_get_no_code_of_a_name(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(ESCAPE, ["policy", ESCAPE], [[ESCAPE, "[/x] | &lt; < 0.1"]], ESCAPE)
    print_short([(f"{ESCAPE} wins", table)])
    assert "\x1b" not in capsys.readouterr().out
    text = table.markdown()
    assert "\x1b" not in text
    assert "## \\x1b[2J&lt;img src=x>" in text
    assert "[/x] \\| &amp;lt; < 0.1" in text
    assert code_span("a <b>") == "`a <b>`"
    assert code_span("a `<b>` ``") == "``` a `<b>` `` ```"  # no run of its backticks ends it

    @click.command("refuse", cls=OneLineErrors)
    def refuse() -> None:
        raise click.ClickException(f"{ESCAPE} is no file")

    assert "\x1b" not in CliRunner().invoke(refuse, []).stderr
