"""Copies of a controller: how long a network is taught, and the end of a run whose copy is useless."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("stable_baselines3")

from wayfield.policies.training.command import main

PATH, DOCK = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveDocking-v0"
# too few lessons for anything
TAUGHT = ["--set", "num_envs=32", "--set", "horizon=16", "--set", "validations=1"]


@pytest.mark.slow
def test_a_clone_that_stands_still_ends_the_run_with_what_to_raise_and_resume_insists(tmp_path: Path) -> None:
    words = [DOCK, *TAUGHT, "--set", "imitation=512", "--set", "steps=1600", "--out", str(tmp_path)]
    found = CliRunner().invoke(main, words)
    assert found.exit_code == 1, found.output
    line = found.stderr.splitlines()[-1]
    said = re.search(
        r"^seed 0: stopped before PPO: the clone of reeds_shepp has (\d)% success on validation, "
        r"reeds_shepp (\d+)%; begin anew with --set imitation=1200000 \(now 512\) or --set lessons=524288 "
        r"\(now 0\), or insist with --resume$",
        line,
    )
    assert said, line
    assert int(said[1]) < 5 < 50 <= int(said[2])
    again = CliRunner().invoke(main, [*words, "--resume"])
    assert again.exit_code == 0, again.output
    assert "done" in again.stdout


@pytest.mark.slow
def test_steps_scale_the_imitation_and_say_so(tmp_path: Path) -> None:
    words = [PATH, *TAUGHT, "--steps", "2000", "--set", "epochs=1"]
    found = CliRunner().invoke(main, [*words, "--out", str(tmp_path / "scaled")])
    assert found.exit_code == 0, found.output
    assert " of imitation (scaled with --steps from 500,000; --set imitation=500000 keeps it)" in found.stderr
    card = json.loads((tmp_path / "scaled" / "seed_0" / "run.json").read_text())
    assert {"steps=2000", "imitation=500"} <= set(card["settings"])
    kept = CliRunner().invoke(main, [*words, "--set", "imitation=2000", "--out", str(tmp_path / "kept")])
    assert "imitation must be from 0 to under steps, 2000, got 2000" in kept.stderr
    assert "scaled" not in kept.stderr
