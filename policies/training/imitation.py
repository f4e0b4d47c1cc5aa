"""Behaviour cloning: before PPO, a network learns what a controller would do in the places that it comes to itself."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from wayfield.policies.parts.policy import Policy
from wayfield.policies.pilot import Pilot
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


class Teaching:
    """Teaches a policy's mean the actions of a controller, then its value function, in a number of frames or just over.

    The controller drives at first and the network more and more, each robot one or the other for a chunk, while the
    controller goes on saying what it would do: Ross, Gordon and Bagnell, "A reduction of imitation learning and
    structured prediction to no-regret online learning", AISTATS 2011.

    Between two chunks it can stop: `arrays`, `numbers` and `optimizers` are what `restore` goes on from, beside the
    states of the policy and of its robots.

    Args:
        teacher: the controller at a speed (m/s); `env` asks for one speed in each of its parts. None: the value
            function alone is taught.
        capacity: lessons that are kept and learned from again, by a falling learning rate; 0: only the latest are.
    """

    def __init__(
        self,
        ppo: PPO,
        env: Shaped,
        teacher: Callable[[float], Policy] | None,
        frames: int,
        learning_rate: float,
        seed: int,
        capacity: int = 0,
    ) -> None:
        policy: Any = ppo.policy
        self._ppo, self._env, self._teacher = ppo, env, teacher
        self._frames, self._rate = frames, learning_rate
        self._cloned = round((1.0 - CRITIC_SHARE) * frames) if teacher else 0  # frames that the mean is taught in
        self._seen = 0  # of those
        self._appraised = -1  # frames that the value function was taught in; -1: it has not begun
        self._generator = np.random.default_rng(seed)
        self._pilots: list[Pilot] = []
        size = min(capacity, self._cloned)
        self._lessons = Lessons(size, env.perception.num_inputs, self._generator) if capacity else None
        means = [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]
        values = [*policy.mlp_extractor.value_net.parameters(), *policy.value_net.parameters()]
        self.optimizers = {
            "mean_optimizer": torch.optim.Adam(means, learning_rate),
            "value_optimizer": torch.optim.Adam(values, learning_rate),
        }

    @property
    def frames(self) -> int:
        """Returns how many frames were seen."""
        return self._seen + max(self._appraised, 0)

    def run(self) -> Iterator[int]:
        """Teaches, from where it is, and yields the frames seen so far."""
        while self._seen < self._cloned:
            self._clone()
            yield self.frames
        yield from self._appraise()

    def _clone(self) -> None:
        """Teaches the mean for a chunk of control periods."""
        env, policy, generator = self._env, self._ppo.policy, self._generator
        optimizer = self.optimizers["mean_optimizer"]
        if not self._pilots:
            assert self._teacher is not None
            env.reset()
            self._pilots = env.make_pilots(self._teacher)
        shape = CHUNK, env.num_envs
        seen = np.empty((*shape, env.seen.shape[1]), np.float32)
        wanted = np.empty((*shape, 2), np.float32)
        alone = generator.random(env.num_envs) < 1.5 * self._seen / self._cloned
        for k in range(CHUNK):
            seen[k], wanted[k] = env.seen, env.actions_of(env.ask(self._pilots))
            with torch.no_grad():
                own = policy.get_distribution(torch.from_numpy(env.seen)).mode().numpy()
            driven = np.where(alone[:, None], own, wanted[k])
            env.step_async(driven + JITTER * generator.standard_normal(driven.shape, np.float32))
            _, _, ended, _ = env.step_wait()
            env.tell(self._pilots, ended)
        if self._lessons is None:
            x, y = torch.from_numpy(seen).flatten(0, 1), torch.from_numpy(wanted).flatten(0, 1)
            for _ in range(EPOCHS):
                for rows in torch.from_numpy(generator.permutation(len(x))).split(BATCH):
                    _descend(optimizer, torch.nn.functional.mse_loss(policy.get_distribution(x[rows]).mode(), y[rows]))
        else:
            for group in optimizer.param_groups:
                group["lr"] = self._rate * (1.0 - (1.0 - LAST_RATE) * self._seen / self._cloned)
            for k in range(0, CHUNK, EVERY):
                self._lessons.add(seen[k], wanted[k])
            for x, y in self._lessons.batches(REPEATS * CHUNK * env.num_envs // EVERY):
                own_means = policy.get_distribution(x).mode()
                _descend(optimizer, torch.nn.functional.smooth_l1_loss(own_means, y, beta=BEND))
        self._seen += CHUNK * env.num_envs

    def _appraise(self) -> Iterator[int]:
        """Teaches the value function what the policy is worth; yields the frames seen."""
        ppo: Any = self._ppo
        wanted = self._frames - self._seen
        _, callback = ppo._setup_learn(wanted, reset_num_timesteps=self._appraised < 0)
        self._appraised = ppo.num_timesteps
        while self._appraised < wanted:
            ppo.collect_rollouts(ppo.env, callback, ppo.rollout_buffer, ppo.n_steps)
            for _ in range(EPOCHS):
                for data in ppo.rollout_buffer.get(BATCH):
                    values = ppo.policy.predict_values(data.observations).flatten()
                    _descend(self.optimizers["value_optimizer"], torch.nn.functional.mse_loss(values, data.returns))
            self._appraised = ppo.num_timesteps
            yield self.frames

    def numbers(self) -> dict[str, Any]:
        """Returns how far it is, as JSON keeps it exactly."""
        came = 0 if self._lessons is None else self._lessons.came
        generator = self._generator.bit_generator.state
        return {"seen": self._seen, "appraised": self._appraised, "came": came, "generator": generator}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Returns the lessons that are kept, and what the controller remembers of the robots."""
        retained: dict[str, NDArray[Any]] = {} if self._lessons is None else dict(self._lessons.arrays())
        for k, pilot in enumerate(self._pilots):
            retained |= {f"teacher_{k}.{name}": each for name, each in pilot.arrays().items()}
        return retained

    def restore(self, arrays: Mapping[str, NDArray[Any]], numbers: Mapping[str, Any]) -> None:
        """Goes back to where `arrays` and `numbers` were taken; `env` must be there already."""
        self._seen, self._appraised = int(numbers["seen"]), int(numbers["appraised"])
        self._ppo.num_timesteps = max(self._appraised, 0)
        self._generator.bit_generator.state = numbers["generator"]
        if self._lessons is not None:
            self._lessons.restore(arrays, int(numbers["came"]))
        if self._teacher is not None and self._seen < self._cloned:
            self._pilots = self._env.make_pilots(self._teacher)
            for k, pilot in enumerate(self._pilots):
                pilot.put_back({name: arrays[f"teacher_{k}.{name}"] for name in pilot.arrays()})


def frames_taught(frames: int, robots: int, horizon: int, clones: bool) -> int:
    """Returns how many frames a teaching takes that is asked for a number: it ends with a chunk, or a rollout.

    Args:
        clones: whether a mean is taught, or the value function alone.
    """
    seen = up_to(round((1.0 - CRITIC_SHARE) * frames), CHUNK * robots) if clones else 0
    return seen + up_to(max(frames - seen, 0), horizon * robots)


def up_to(count: int, unit: int) -> int:
    """Returns the least multiple of a unit that is not under a number."""
    return -(-count // unit) * unit


class Lessons:
    """What was seen and what the controller did there: of all that came, as much by chance as there is room for."""

    def __init__(self, room: int, width: int, generator: np.random.Generator) -> None:
        self._seen, self._wanted = np.empty((room, width), np.float32), np.empty((room, 2), np.float32)
        self._generator, self.came = generator, 0

    def add(self, seen: NDArray[np.float32], wanted: NDArray[np.float32]) -> None:
        """Adds rows; once there is no room, each takes the place of one by chance or is left out.

        Source: Vitter, "Random sampling with a reservoir", ACM Transactions on Mathematical Software 11(1), 1985.
        """
        room = len(self._seen)
        places = self.came + np.arange(len(seen))
        places = np.where(places < room, places, self._generator.integers(0, places + 1))
        retained = places < room
        self._seen[places[retained]], self._wanted[places[retained]] = seen[retained], wanted[retained]
        self.came += len(seen)

    def batches(self, count: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """Yields about `count` rows by chance, in batches; at least one batch."""
        for _ in range(max(1, round(count / BATCH))):
            rows = self._generator.integers(0, min(self.came, len(self._seen)), BATCH)
            yield torch.from_numpy(self._seen[rows]), torch.from_numpy(self._wanted[rows])

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """Returns what is kept."""
        filled = min(self.came, len(self._seen))
        return {"lessons.seen": self._seen[:filled], "lessons.wanted": self._wanted[:filled]}

    def restore(self, arrays: Mapping[str, NDArray[Any]], came: int) -> None:
        """Keeps what `arrays` returned, after that many had come."""
        filled = len(arrays["lessons.seen"])
        self._seen[:filled], self._wanted[:filled], self.came = arrays["lessons.seen"], arrays["lessons.wanted"], came


def _descend(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
