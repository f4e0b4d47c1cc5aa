"""The oracle of our PPO is stable-baselines3's: parameters, moments and rollouts are equal in every bit."""

from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import KVWriter, Logger

from wayfield.envs.sb3 import NativeVecEnv
from wayfield.policies.training.proximal import Proximal


class Kept(KVWriter):
    """What was logged, an update a row."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, Any], step: int = 0) -> None:
        self.rows.append({name: value for name, value in key_values.items() if name.startswith("train/")})

    def close(self) -> None:
        pass


def learned(kind: type[PPO], activation: type[torch.nn.Module], **settings: Any) -> tuple[PPO, list[dict[str, Any]]]:
    """Returns an algorithm after three updates, and what it logged."""
    worlds, kept = NativeVecEnv("wayfield/DiffDriveGoalObstacles-v0", 24, max_episode_steps=20), Kept()
    kwargs = {"net_arch": [48, 17], "activation_fn": activation, "log_std_init": -0.7}
    model = kind("MlpPolicy", worlds, n_steps=24, seed=3, device="cpu", policy_kwargs=kwargs, **settings)
    model.set_logger(Logger(None, [kept]))
    return model.learn(3 * 24 * 24), kept.rows


@pytest.mark.parametrize(
    ("activation", "settings"),
    [
        (torch.nn.Tanh, {"batch_size": 100, "ent_coef": 0.01, "n_epochs": 3}),
        (torch.nn.ReLU, {"batch_size": 576, "learning_rate": 3e-3, "clip_range": 0.05}),
        (torch.nn.Tanh, {"batch_size": 64, "learning_rate": 1e-2, "target_kl": 0.002, "max_grad_norm": 0.1}),
    ],
)
def test_every_bit_is_that_of_stable_baselines3(activation: type[torch.nn.Module], settings: dict[str, Any]) -> None:
    wanted, logged = learned(PPO, activation, **settings)
    model, mine = learned(Proximal, activation, **settings)
    for name, tensor in wanted.policy.state_dict().items():
        assert torch.equal(tensor, model.policy.state_dict()[name]), name
    states = [each.policy.optimizer.state_dict()["state"] for each in (wanted, model)]
    for k, moments in states[0].items():
        for name, tensor in moments.items():
            assert torch.equal(tensor, states[1][k][name]), (k, name)
    for name in ("observations", "actions", "rewards", "values", "log_probs", "advantages", "returns"):
        rows = [np.sort(getattr(each.rollout_buffer, name).reshape(-1)) for each in (wanted, model)]
        np.testing.assert_array_equal(*rows, err_msg=name)
    assert any(mine)
    assert [{name: row[name] for name in own} for row, own in zip(logged, mine, strict=True)] == mine
