"""Trains the networks of claims: stable-baselines3's PPO, in vector environments of ours."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.numpy import save
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnvWrapper

from wayfield.benchmarks.papers.networks import Networked
from wayfield.envs.sb3 import NativeVecEnv
from wayfield.system.storage import write_whole

ROBOTS = 128
DIGITS = 5  # of the weights that are kept

Worth = Callable[[Any, NDArray[Any]], NDArray[Any]]  # of what a step leads to and its reward: its worth (b,)


class LessonEnv(VecEnvWrapper):
    """Robots whose actions are the numbers that the network of a policy sets, and which see what it sees.

    An action holds as long as in the policy. A row that ends before goes on in its next episode under the action of
    its last; what that earns counts for nothing.

    Args:
        law: whose network learns.
        seed: of the first episode's row, in thousands.
        worth: instead of the environment's reward.
        kwargs: of the environment.
    """

    def __init__(self, law: Networked, seed: int, env_id: str, worth: Worth | None = None, **kwargs: Any) -> None:
        self.worlds = NativeVecEnv(env_id, ROBOTS, actuators="lagged", **kwargs)
        self.law, self.layout, self.first, self.worth = law, self.worlds.task.layout, 1000 * seed, worth
        box = gymnasium.spaces.Box
        super().__init__(self.worlds, box(-10.0, 10.0, (law.inputs,), np.float32), box(-1.0, 1.0, (law.actions,)))

    def _see(self, fields: Any) -> Any:
        return self.law.see(fields, self.briefing).astype(np.float32)

    def reset(self) -> Any:
        """Starts an episode in every row."""
        self.worlds.seed(self.first)
        observations = self.worlds.reset()
        self.briefing = self.worlds.parts[0].briefing(self.law.knows)
        self.memory = self.law.reset(self.briefing)
        self.fields = self.layout.unpack(observations.astype(np.float64))
        return self._see(self.fields)

    def step_async(self, actions: Any) -> None:
        """Takes the actions (ROBOTS, n)."""
        self.memory["action"] = np.clip(actions.astype(np.float64), -1.0, 1.0)

    def step_wait(self) -> Any:
        """Moves every robot for as long as an action holds."""
        earned, done, infos = np.zeros(ROBOTS), np.zeros(ROBOTS, bool), [dict[str, Any]() for _ in range(ROBOTS)]
        for _ in range(self.law.held):
            twists = self.law.driven(self.fields, self.briefing, self.memory)
            observations, rewards, terminated, truncated, _ = self.worlds.advance(twists)
            ended = terminated | truncated
            for i in np.flatnonzero(ended & ~done).tolist():
                last = self._see(self.layout.unpack(self.worlds.final_observation(i)[None].astype(np.float64)))[0]
                infos[i] = {"terminal_observation": last, "TimeLimit.truncated": not terminated[i]}
            if ended.any():
                self.briefing = self.worlds.parts[0].briefing(self.law.knows)
                action = self.memory["action"][ended]
                self.memory[ended] = self.law.reset(self.briefing)[ended]
                self.memory["action"][ended] = action
            self.fields = self.layout.unpack(observations.astype(np.float64))
            earned += np.where(done, 0.0, self.worth(self.fields, rewards) if self.worth else rewards)
            done |= ended
        return self._see(self.fields), earned.astype(np.float32), done, infos


def trained(env: LessonEnv, seed: int, steps: int, **how: Any) -> dict[str, NDArray[Any]]:
    """Returns the layers of the network that a seed learns, by PPO with these arguments."""
    torch.set_num_threads(1)
    how = {"n_steps": 128, "batch_size": 4096, "n_epochs": 6, "learning_rate": 1e-3, "gamma": 0.98, **how}
    network = {"net_arch": [32, 32], "activation_fn": torch.nn.Tanh, "log_std_init": -0.7}
    model = PPO("MlpPolicy", env, seed=seed, policy_kwargs=network, device="cpu", **how)
    model.learn(steps)
    hidden: Any = model.policy.mlp_extractor.policy_net
    arrays: dict[str, NDArray[Any]] = {}
    for k, layer in enumerate((hidden[0], hidden[2], model.policy.action_net)):
        for name in ("weight", "bias"):
            arrays[f"{k}.{name}"] = getattr(layer, name).detach().numpy().round(DIGITS)
    return arrays


def train(home: Path, lessons: Iterable[tuple[Networked, Mapping[str, Any]]], steps: int, **how: Any) -> None:
    """Trains the networks of policies, each where its LessonEnv says, and writes their weights into a folder."""
    arrays: dict[str, NDArray[Any]] = {}
    weights = ""
    for law, where in lessons:
        network = trained(LessonEnv(law, law.seed, **where), law.seed, steps, **how)
        arrays |= {f"{law.network}.{name}": each for name, each in network.items()}
        weights = law.weights
    home.mkdir(parents=True, exist_ok=True)
    write_whole(home / weights, save(arrays))
