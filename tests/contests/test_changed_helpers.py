"""A contest that goes on after a kill has the rows of one version of a policy, whatever the policy imports."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

LAW = """
import os, signal
import numpy as np
from wayfield.envs import path_following
{at_import}
resets = [0]

class Mine:
    knows = "sensors"
    observes = (path_following.Observation,)

    def reset(self, briefing):
        resets[0] += 1
        if resets[0] > int(os.environ.get("RESETS", 10**9)):
            os.kill(os.getpid(), signal.SIGKILL)
        return np.empty((briefing.num_envs, 0))

    def act(self, observation, briefing, memory):
        {in_act}
        x, y = observation.preview[:, 4, 0], observation.preview[:, 4, 1]
        return np.column_stack([np.full(len(x), SPEED), 2.0 * SPEED * y / (x**2 + y**2)])
"""
# the policy's module, its helper's file, and what they hold
KINDS = {
    "a helper": ("mine", {"mine.py": LAW.format(at_import="from pace import SPEED", in_act="")}, "pace.py"),
    "a helper that is imported while it acts": (
        "mine",
        {"mine.py": LAW.format(at_import="", in_act="from pace import SPEED")},
        "pace.py",
    ),
    "a package": (
        "kit.laws",
        {
            "kit/__init__.py": "",
            "kit/laws.py": LAW.format(at_import="from .deep import SPEED", in_act=""),
            "kit/deep/__init__.py": "from ..pace import SPEED",
        },
        "kit/pace.py",
    ),
}


def contest(home: Path, module: str, out: str, **more: str) -> subprocess.CompletedProcess[str]:
    """Runs a contest of the policy on two families, one after the other."""
    words = ["--suite", "path-following", "--policies", "pure_pursuit", "--policy", f"{module}:Mine"]
    words += ["--families", "circles,straights", "--episodes", "1", "--gains", "default", "--workers", "1"]
    return subprocess.run(
        [sys.executable, "-c", "from wayfield.command import main; main()", "evaluate", *words, "--out", out],
        cwd=home, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **more}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_part_is_played_again_when_what_its_policy_imports_has_changed(kind: str, tmp_path: Path) -> None:
    module, files, helper = KINDS[kind]
    for name, text in (files | {helper: "SPEED = 0.3\n"}).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    killed = contest(tmp_path, module, "resumed", RESETS="2")
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    (tmp_path / helper).write_text("SPEED = 0.6\n")
    resumed = contest(tmp_path, module, "resumed")
    assert resumed.returncode == 0, resumed.stderr
    assert f"{tmp_path / helper} and is played again" in resumed.stderr
    assert contest(tmp_path, module, "whole").returncode == 0
    rows = [(tmp_path / out / "episodes.csv").read_bytes() for out in ("resumed", "whole")]
    assert rows[0] == rows[1]
