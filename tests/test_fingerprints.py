"""Fingerprints: the same behaviour has the same, in every process and alone as in a batch, and any other another."""

import json
from pathlib import Path
from typing import Any

import click.testing
import fingerprints
import gymnasium
import pytest
from fingerprints import CONDITIONS, QUANTITIES, World, alone, differences, fingerprint

from wayfield import policies
from wayfield.policies import Pilot

NAMES = ("zero", "pure_pursuit", "apf_escape", "ppo")
WORLDS = [
    World("path-following", "p3dx", "kinematic", CONDITIONS["path-following"][2]),
    World("goal-obstacles", "omni4", "pymunk", CONDITIONS["goal-obstacles"][1]),
]
STEPS = 130  # beyond the clock, so that there is a reset


@pytest.fixture(scope="module")
def here() -> dict[str, Any]:
    return fingerprints.fingerprints(NAMES, WORLDS, STEPS)


def test_a_difference_is_told_with_its_step_and_quantity(here: dict[str, Any]) -> None:
    assert differences(here, here) == []
    key = next(iter(here))
    vector = dict(here[key]["vector"])
    steps = vector["steps"]
    vector |= {"actions": "", "steps": steps[:40] + "".join("1" if c == "0" else "0" for c in steps[40:])}
    changed = here | {key: here[key] | {"vector": vector}}
    assert differences(changed, here) == [f"{key}, vector: actions from step 10 on"]
    del changed[key]
    assert differences(changed, here) == [f"{key}: is new"]
    assert differences(here, changed) == [f"{key}: is gone"]


def test_a_gain_that_is_a_little_off_is_seen() -> None:
    world = WORLDS[0]
    found = []
    for speed in (0.6, 0.6 + 1e-12):
        env = gymnasium.make(**world.options(), disable_env_checker=True)
        found.append(fingerprint(alone(env, Pilot(policies.make("pure_pursuit", speed=speed), env), 5)))
    assert [found[0][name] == found[1][name] for name in QUANTITIES][1] is False


def test_the_command_writes_and_compares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fingerprints, "worlds", lambda: WORLDS[:1])
    file = tmp_path / "base.json"
    run = click.testing.CliRunner().invoke
    assert run(fingerprints.main, ["--out", str(file), "--policies", "zero"]).exit_code == 0
    assert run(fingerprints.main, ["--against", str(file), "--policies", "zero"]).exit_code == 0
    content = json.loads(file.read_text())
    content["entries"][next(iter(content["entries"]))]["single"]["rewards"] = "0"
    file.write_text(json.dumps(content))
    changed = run(fingerprints.main, ["--against", str(file), "--policies", "zero"])
    assert changed.exit_code == 1
    assert "single: rewards" in changed.output
    file.write_text("[]")
    assert run(fingerprints.main, ["--against", str(file)]).exit_code == 2
    assert run(fingerprints.main, []).exit_code == 2
