"""Behaviour cloning: before PPO, a network learns what a controller would do in the places that it comes to itself."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from wayfield.policies.policy import Policy
from wayfield.policies.training.shaping import Shaped

CHUNK = 8  # control periods between gradient steps
EPOCHS = 2  # over a chunk
BATCH = 2048
EVERY = 2  # control periods between the lessons that are kept: neighbours are nearly one
REPEATS = 3  # rows of kept lessons that gradient steps take, for each that comes
BEND = 0.2  # of an action's error, beyond which it counts in proportion: where a teacher does one thing or another
LAST_RATE = 0.05  # share of the learning rate that the teaching with kept lessons ends with
JITTER = 0.1  # standard deviation of what is added to the actions that are driven, so that mistakes are seen
CRITIC_SHARE = 0.2  # of the frames, in which the value function learns what the cloned policy is worth


def teach(
    ppo: PPO,
    env: Shaped,
    teacher: Callable[[float], Policy],
    frames: int,
    learning_rate: float,
    seed: int,
    kept: int = 0,
) -> Iterator[int]:
    """Teaches a policy's mean the actions of a controller, then its value function, in a number of frames or just over.

    Yields the frames seen so far.

    The controller drives at first and the network more and more, each robot one or the other for a chunk, while the
    controller goes on saying what it would do: Ross, Gordon and Bagnell, "A reduction of imitation learning and
    structured prediction to no-regret online learning", AISTATS 2011.

    Args:
        teacher: the controller at a speed (m/s); `env` asks for one speed in each of its parts.
        kept: lessons that are kept and learned from again, by a falling learning rate; 0: only the latest are.
    """
    cloned = round((1.0 - CRITIC_SHARE) * frames)
    seen = 0
    for seen in _clone(ppo, env, teacher, cloned, learning_rate, kept, np.random.default_rng(seed)):
        yield seen
    for more in appraise(ppo, frames - seen, learning_rate):
        yield seen + more


def appraise(ppo: PPO, frames: int, learning_rate: float) -> Iterator[int]:
    """Teaches the value function what the policy is worth, in a number of frames or just over; yields those seen."""
    policy: Any = ppo.policy
    optimizer = torch.optim.Adam(
        [*policy.mlp_extractor.value_net.parameters(), *policy.value_net.parameters()], learning_rate
    )
    _, callback = ppo._setup_learn(frames)
    timed = ppo.env
    assert timed is not None
    while ppo.num_timesteps < frames:
        ppo.collect_rollouts(timed, callback, ppo.rollout_buffer, ppo.n_steps)
        for _ in range(EPOCHS):
            for data in ppo.rollout_buffer.get(BATCH):
                values = policy.predict_values(data.observations).flatten()
                _descend(optimizer, torch.nn.functional.mse_loss(values, data.returns))
        yield ppo.num_timesteps


def _clone(
    ppo: PPO,
    env: Shaped,
    teacher: Callable[[float], Policy],
    frames: int,
    learning_rate: float,
    kept: int,
    generator: np.random.Generator,
) -> Iterator[int]:
    policy: Any = ppo.policy
    optimizer = torch.optim.Adam(
        [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()], learning_rate
    )
    inputs = env.reset()
    pilots = env.make_pilots(teacher)
    shape = CHUNK, env.num_envs
    seen = np.empty((*shape, inputs.shape[1]), np.float32)
    wanted = np.empty((*shape, 2), np.float32)
    lessons = Lessons(min(kept, frames), inputs.shape[1], generator) if kept else None
    for begun in range(0, frames, CHUNK * env.num_envs):
        alone = generator.random(env.num_envs) < 1.5 * begun / frames
        for k in range(CHUNK):
            seen[k], wanted[k] = inputs, env.actions_of(env.ask(pilots))
            with torch.no_grad():
                own = policy.get_distribution(torch.from_numpy(inputs)).mode().numpy()
            driven = np.where(alone[:, None], own, wanted[k])
            env.step_async(driven + JITTER * generator.standard_normal(driven.shape, np.float32))
            inputs, _, ended, _ = env.step_wait()
            env.tell(pilots, ended)
        if lessons is None:
            x, y = torch.from_numpy(seen).flatten(0, 1), torch.from_numpy(wanted).flatten(0, 1)
            for _ in range(EPOCHS):
                for rows in torch.from_numpy(generator.permutation(len(x))).split(BATCH):
                    _descend(optimizer, torch.nn.functional.mse_loss(policy.get_distribution(x[rows]).mode(), y[rows]))
        else:
            for group in optimizer.param_groups:
                group["lr"] = learning_rate * (1.0 - (1.0 - LAST_RATE) * begun / frames)
            for k in range(0, CHUNK, EVERY):
                lessons.add(seen[k], wanted[k])
            for x, y in lessons.batches(REPEATS * CHUNK * env.num_envs // EVERY):
                own_means = policy.get_distribution(x).mode()
                _descend(optimizer, torch.nn.functional.smooth_l1_loss(own_means, y, beta=BEND))
        yield begun + CHUNK * env.num_envs


class Lessons:
    """What was seen and what the controller did there: of all that came, as much by chance as there is room for."""

    def __init__(self, room: int, width: int, generator: np.random.Generator) -> None:
        self._seen, self._wanted = np.empty((room, width), np.float32), np.empty((room, 2), np.float32)
        self._generator, self._came = generator, 0

    def add(self, seen: NDArray[np.float32], wanted: NDArray[np.float32]) -> None:
        """Adds rows; once there is no room, each takes the place of one by chance or is left out.

        Source: Vitter, "Random sampling with a reservoir", ACM Transactions on Mathematical Software 11(1), 1985.
        """
        room = len(self._seen)
        places = self._came + np.arange(len(seen))
        places = np.where(places < room, places, self._generator.integers(0, places + 1))
        kept = places < room
        self._seen[places[kept]], self._wanted[places[kept]] = seen[kept], wanted[kept]
        self._came += len(seen)

    def batches(self, count: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yields about `count` rows by chance, in batches; at least one batch."""
        for _ in range(max(1, round(count / BATCH))):
            rows = self._generator.integers(0, min(self._came, len(self._seen)), BATCH)
            yield torch.from_numpy(self._seen[rows]), torch.from_numpy(self._wanted[rows])


def _descend(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
