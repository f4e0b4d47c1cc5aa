"""stable-baselines3's SAC on a preset's worlds: as many robots as there are, a replay buffer of what they all did.

Source: Haarnoja et al., "Soft actor-critic algorithms and applications", arXiv:1812.05905, 2018, as stable-baselines3
has it: two critics, and an entropy coefficient that is learned.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.type_aliases import TrainFreq, TrainFrequencyUnit

from wayfield.policies.training.learner import Layers, Learner, anneal, layers_of
from wayfield.policies.training.presets import Sac

_REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def squashed(modules: Iterable[torch.nn.Module]) -> Layers:
    """Returns weights (outputs, inputs) and biases of linear modules whose last outputs a tanh squashes.

    That is a tanh as those before: so they are a hidden layer more, and the last one passes them on.
    """
    layers = layers_of(modules)
    size = len(layers[-1][1])
    return [*layers, (np.eye(size, dtype=np.float32), np.zeros(size, np.float32))]


class SacLearner(Learner):
    """SAC: an update is a few control periods of all robots and some gradient steps on what is kept of all before."""

    LOGGED = ("ent_coef", "actor_loss", "critic_loss")

    @property
    def model(self) -> SAC:
        """Returns the algorithm."""
        return self.sac

    def _make(self) -> None:
        learning, own = self.preset.learning, self.preset.learning.algorithm
        assert isinstance(own, Sac)
        self.sac = SAC(
            "MlpPolicy",
            self._timed,
            learning_rate=anneal(learning.learning_rate, learning.final_learning_rate),
            buffer_size=own.buffer_size,
            learning_starts=own.learning_starts,
            batch_size=learning.batch_size,
            tau=own.target_rate,
            gamma=learning.discount,
            train_freq=learning.horizon,
            gradient_steps=own.gradient_steps,
            # its default is 1 for rewards as they are; these are multiplied by 1 - discount
            ent_coef=f"auto_{1.0 - learning.discount}",
            policy_kwargs={"net_arch": list(learning.hidden), "activation_fn": torch.nn.Tanh},
            seed=self.seed,
            device="cpu",
            verbose=0,
        )

    def _retained(self) -> tuple[int, str]:
        assert isinstance(self.preset.learning.algorithm, Sac)
        return 2 * self.preset.learning.algorithm.buffer_size, "2 x sac.buffer_size"  # before a step and after it

    def _collect(self) -> float:
        replay, starts = self.sac.replay_buffer, self.sac.learning_starts
        assert replay is not None
        first = replay.pos
        periods = TrainFreq(self.preset.learning.horizon, TrainFrequencyUnit.STEP)
        self.sac.collect_rollouts(self._timed, self._callback, periods, replay, learning_starts=starts)
        rows = (first + np.arange(self.preset.learning.horizon)) % replay.buffer_size
        return float(replay.rewards[rows].mean())

    def _learn(self) -> None:
        if self.frames > self.sac.learning_starts:
            self.sac.train(gradient_steps=self.sac.gradient_steps, batch_size=self.sac.batch_size)

    def layers(self) -> Layers:
        """Returns weights (outputs, inputs) and biases of the policy's mean, layer after layer."""
        return squashed([*self.sac.actor.latent_pi, self.sac.actor.mu])

    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """Returns those of the actor, the critics and the entropy coefficient."""
        assert self.sac.ent_coef_optimizer is not None
        return {
            "actor_optimizer": self.sac.actor.optimizer,
            "critic_optimizer": self.sac.critic.optimizer,
            "entropy_optimizer": self.sac.ent_coef_optimizer,
        }

    def state(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns all that decides how the run goes on, the replay buffer as far as it is filled too."""
        arrays, numbers = super().state()
        replay, coefficient = self.sac.replay_buffer, self.sac.log_ent_coef
        assert replay is not None
        assert coefficient is not None
        filled = replay.buffer_size if replay.full else replay.pos
        arrays |= {f"replay.{name}": getattr(replay, name)[:filled] for name in _REPLAYED}
        arrays["log_ent_coef"] = coefficient.detach().numpy().copy()
        drawn = self.sac.action_space.np_random.bit_generator.state  # of the first actions
        return arrays, numbers | {"replay": [replay.pos, replay.full], "random.actions": drawn}

    def restore(self, arrays: Mapping[str, NDArray[Any]], numbers: Mapping[str, Any]) -> None:
        """Puts the run back to where `state` was taken."""
        super().restore(arrays, numbers)
        replay, coefficient = self.sac.replay_buffer, self.sac.log_ent_coef
        assert replay is not None
        assert coefficient is not None
        for name in _REPLAYED:
            retained = arrays[f"replay.{name}"]
            getattr(replay, name)[: len(retained)] = retained
        replay.pos, replay.full = numbers["replay"]
        with torch.no_grad():
            coefficient.copy_(torch.from_numpy(arrays["log_ent_coef"].copy()))
        self.sac.action_space.np_random.bit_generator.state = numbers["random.actions"]
