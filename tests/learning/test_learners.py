"""Learners beside each other: what the cards tell of them, the rows that are driven, and the table."""

import json
from pathlib import Path

import pytest
from learners import CONTEST, CONTROLLER, PRESETS, Learned, driven, learned, train_missing

from wayfield.envs.scenarios import SPLITS
from wayfield.policies.learned.agent import CARD, WEIGHTS, signed
from wayfield.policies.trained.ppo import shipped


def shipped_as(home: Path, seed: int, **training: object) -> None:
    """Puts an agent that ships where train.py would, with other things told of its training."""
    source = shipped(CONTEST.spec.name, "p3dx")[seed]
    folder = home / f"seed_{seed}" / "best"
    folder.mkdir(parents=True)
    card = json.loads((source / CARD).read_text())
    card["training"] |= training
    (folder / CARD).write_text(json.dumps(signed(card)))
    (folder / WEIGHTS).write_bytes((source / WEIGHTS).read_bytes())


def test_an_agent_and_the_controller_drive_the_same_scenarios(tmp_path: Path) -> None:
    shipped_as(tmp_path, 3, run_frames=8_000_000)
    family = CONTEST.families("kinematic")[0]
    agent = driven((learned(tmp_path, 3), family, "test"))
    law = driven((Learned("", "", "", "", "", ""), family, "test"))
    assert [(row["scenario"], row["episode"]) for row in agent] == [(row["scenario"], row["episode"]) for row in law]
    assert len(agent) == SPLITS["test"]
    assert {row["agent_seed"] for row in agent} == {"3"}
    assert {(row["policy"], row["learner"]) for row in law} == {(CONTROLLER, CONTROLLER)}
    assert all(float(row["yaw_change"]) > 0.0 for row in (*agent, *law))
    assert {row["learned_from"] for row in agent} == {"8.0 M frames"}


def test_another_run_in_the_folder_is_refused_before_anything_is_trained(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    from wayfield.policies.training.checkpoints import write_run

    described = {"env_id": "wayfield/DiffDrivePathFollowing-v0", "settings": [], "steps": 5, "seed": 0}
    write_run(tmp_path / PRESETS[1] / "seed_0", described | {"preset": PRESETS[1]})
    with pytest.raises(ValueError, match="holds a run with steps 5"):
        train_missing(tmp_path, [0], None, 1)
    assert not (tmp_path / PRESETS[0]).exists()
