"""The training of the claim lookahead_ppo: stable-baselines3's PPO, in vector environments of ours."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from safetensors.numpy import save
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from wayfield.benchmarks.papers.lookahead_ppo import FAMILIES, INPUTS, WEIGHTS, driven, inputs
from wayfield.envs.scenarios.splits import split
from wayfield.system.storage import write_whole

ROBOTS = 128
DIGITS = 5  # of the weights that are kept
GIVEN, SCALE = 0.1, 0.02  # m, at which progress is worth half: to the environment, and here, where millimetres count


class LookaheadEnv(VecEnv):
    """Robots on the training paths whose actions are look-aheads, and which see `inputs`."""

    def __init__(self, seed: int) -> None:
        paths = [each for name in FAMILIES for each in split("path_following", name, "train")]
        kwargs: dict[str, Any] = {"scenario": paths, "actuators": "lagged", "max_episode_steps": 1200}
        kwargs |= {"vectorization_mode": "vector_entry_point", "autoreset_mode": "SameStep"}
        env: Any = gymnasium.make_vec("wayfield/DiffDrivePathFollowing-v0", ROBOTS, **kwargs)
        self.env, self.layout, self.first = env, env.task.layout, 1000 * seed
        spaces = gymnasium.spaces.Box(-10.0, 10.0, (INPUTS,), np.float32), gymnasium.spaces.Box(-1.0, 1.0, (1,))
        super().__init__(ROBOTS, *spaces)

    def _see(self, observations: Any) -> Any:
        self.fields = self.layout.unpack(observations.astype(np.float64))
        return inputs(self.fields).astype(np.float32)

    def reset(self) -> Any:
        """Starts an episode in every row."""
        observations, _ = self.env.reset(seed=self.first)
        self.briefing = self.env.briefing("path")
        return self._see(observations)

    def step_async(self, actions: Any) -> None:
        """Takes the actions (ROBOTS, 1)."""
        self.actions = actions[:, 0].astype(np.float64)

    def step_wait(self) -> Any:
        """Moves every robot by one control period."""
        twists = driven(self.fields, self.briefing, self.actions)
        observations, rewards, terminated, truncated, info = self.env.step(twists)
        ended, infos = terminated | truncated, [dict[str, Any]() for _ in range(ROBOTS)]
        for i in np.flatnonzero(ended).tolist():
            last = inputs(self.layout.unpack(info["final_obs"][i][None].astype(np.float64)))[0]
            cut = bool(truncated[i] and not terminated[i])
            infos[i] = {"terminal_observation": last.astype(np.float32), "TimeLimit.truncated": cut}
        if ended.any():
            self.briefing = self.env.briefing("path")
        seen = self._see(observations)
        off = self.fields.cross_track_error
        finer = (1.0 + (off / GIVEN) ** 2) / (1.0 + (off / SCALE) ** 2)
        return seen, np.where(rewards > 0.0, rewards * finer, rewards).astype(np.float32), ended, infos

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns None for each row: they have no attributes of their own."""
        return [None] * ROBOTS

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Does nothing."""

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Returns None for each row."""
        return [None] * ROBOTS

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Returns False for each row."""
        return [False] * ROBOTS


def trained(seed: int, steps: int) -> list[Any]:
    """Returns the layers of the network that a seed learns."""
    torch.set_num_threads(1)
    network = {"net_arch": [32, 32], "activation_fn": torch.nn.Tanh, "log_std_init": -0.7}
    model = PPO(
        "MlpPolicy",
        LookaheadEnv(seed),
        seed=seed,
        n_steps=128,
        batch_size=4096,
        n_epochs=6,
        learning_rate=1e-3,
        gamma=0.98,
        policy_kwargs=network,
        device="cpu",
    )
    model.learn(steps)
    hidden: Any = model.policy.mlp_extractor.policy_net
    return [hidden[0], hidden[2], model.policy.action_net]


def train(home: Path, seeds: Iterable[int], steps: int) -> None:
    """Trains a network a seed, and writes their weights into a folder."""
    arrays = {}
    for seed in seeds:
        for k, layer in enumerate(trained(seed, steps)):
            for name in ("weight", "bias"):
                arrays[f"{seed}.{k}.{name}"] = getattr(layer, name).detach().numpy().round(DIGITS)
    home.mkdir(parents=True, exist_ok=True)
    write_whole(home / WEIGHTS, save(arrays))
