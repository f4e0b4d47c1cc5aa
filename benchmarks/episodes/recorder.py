"""Whole episodes of a policy as arrays: many robots drive at once, and each episode has a seed of its own."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from numpy.typing import NDArray

from wayfield.envs.batch import Results
from wayfield.envs.vector import NativeVectorEnv
from wayfield.policies.parts.policy import Policy
from wayfield.policies.pilot import Pilot
from wayfield.policies.training.recorded import episode_digest

MOST_ROBOTS = 512
_BUFFER = 256 * 2**20  # bytes that the episodes under way may take


@dataclasses.dataclass(frozen=True)
class Start:
    """How an episode begins: as `env.reset(seed=seed, options={"scenario": scenario})` begins it."""

    seed: int
    scenario: int  # index in the environment's bank


@dataclasses.dataclass(frozen=True)
class Episode:
    """An episode of n steps: observation and info at its start and after each step, and the actions between."""

    start: Start
    observations: NDArray[np.float32]  # (n + 1, size)
    actions: NDArray[np.float32]  # (n, axes), members of the action space
    rewards: NDArray[np.float64]  # (n,)
    terminations: NDArray[np.bool_]  # (n,)
    truncations: NDArray[np.bool_]  # (n,)
    infos: dict[str, NDArray[np.float64] | NDArray[np.bool_]]  # (n + 1,) each

    def digest(self) -> bytes:
        """Returns the SHA-256 of the start and of every number, little-endian."""
        numbers = self.observations, self.actions, self.rewards, self.terminations, self.truncations
        return episode_digest(self.start.seed, self.start.scenario, numbers, self.infos)


def robots_for(env: NativeVectorEnv, starts: int) -> int:
    """Returns how many robots record that many episodes: as many as the memory for episodes under way allows."""
    assert env.max_episode_steps is not None
    numbers = 4 * env.task.layout.size + 4 * len(env.batch.action_shape) + 9 * (2 + len(env.task.info_names))
    return max(1, min(starts, MOST_ROBOTS, _BUFFER // (numbers * (env.max_episode_steps + 1))))


class _Buffers:
    """The episodes under way, a row for each robot; np.empty takes no memory until it is written to."""

    def __init__(self, env: NativeVectorEnv) -> None:
        assert env.max_episode_steps is not None
        shape = (env.num_envs, env.max_episode_steps + 1)
        task = env.task
        self.observations = np.empty((*shape, task.layout.size), np.float32)
        self.actions = np.empty((*shape, *env.batch.action_shape), np.float32)
        self.numbers = np.empty((*shape, len(task.info_names) + 1))
        self.flags = np.empty((*shape, len(task.flag_names) + 1), np.bool_)
        self.info_names, self.flag_names = task.info_names, task.flag_names

    def note(self, rows: NDArray[np.int64], at: NDArray[np.int64], results: Results) -> None:
        """Writes observation and info of the rows after `at` (rows,) steps."""
        chosen: slice | NDArray[np.int64] = slice(None) if len(rows) == len(self.flags) else rows
        self.observations[rows, at] = results.observations[chosen]
        self.numbers[rows, at] = results.numbers[:, chosen].T
        self.flags[rows, at] = results.flags[:, chosen].T

    def episode(self, start: Start, row: int, steps: int) -> Episode:
        """Returns a copy of a row's episode, which has just ended."""
        numbers, flags = self.numbers[row, : steps + 1], self.flags[row, : steps + 1]
        infos = {name: numbers[:, k].copy() for k, name in enumerate(self.info_names)}
        terminations = flags[1:, -1].copy()
        truncations = np.zeros(steps, np.bool_)
        truncations[-1] = not terminations[-1]
        return Episode(
            start,
            self.observations[row, : steps + 1].copy(),
            self.actions[row, :steps].copy(),
            numbers[1:, -1].copy(),
            terminations,
            truncations,
            infos | {name: flags[:, k].copy() for k, name in enumerate(self.flag_names)},
        )


def record(
    env: NativeVectorEnv, policy: Policy, starts: Sequence[Start], exploration: float = 0.0
) -> Iterator[tuple[int, Episode]]:
    """Yields the episode of each start with its index, in the order in which they end.

    An episode is that of the single environment, bit for bit: its seed and its actions make it again.

    Args:
        env: with a clock, fresh, of at most as many robots as there are starts; not to be used by others meanwhile.
        exploration: standard deviation of the normal noise that is added to every action, as a share of the largest;
            drawn from the episode's seed.

    Raises:
        TypeError, ValueError: if the policy cannot drive the environment.
    """
    batch, clock = env.batch, env.max_episode_steps
    assert clock is not None
    assert isinstance(env.single_action_space, Box)
    most = env.single_action_space.high
    pilot = Pilot(policy, env)
    buffers, results = _Buffers(env), Results(env.task, env.num_envs)
    generators = [np.random.default_rng(0) for _ in range(env.num_envs)]
    chosen = np.zeros(env.num_envs, np.int64)
    episodes = np.full(env.num_envs, -1)  # of each row; -1: it is done
    steps = np.zeros(env.num_envs, np.int64)
    noise = np.zeros((env.num_envs, clock if exploration > 0.0 else 1, *batch.action_shape))
    waiting = iter(range(len(starts)))

    def begin(rows: NDArray[np.int64]) -> None:
        """Starts the next episodes in these rows; rows for which there is none stand still from now on."""
        for i in rows.tolist():
            episodes[i] = next(waiting, -1)
            if episodes[i] < 0:
                batch.skip[i] = True
                continue
            start = starts[episodes[i]]
            generators[i], chosen[i] = seeding.np_random(start.seed)[0], start.scenario
            if exploration > 0.0:
                own = np.random.default_rng([start.seed, 1])
                noise[i] = exploration * own.standard_normal(noise.shape[1:])
        begun = rows[episodes[rows] >= 0]
        if len(begun):
            batch.reset(begun, generators, results, chosen)
            steps[begun] = 0
            buffers.note(begun, steps[begun], results)

    every = np.arange(env.num_envs)
    batch.skip[:] = False
    begin(every)
    pilot.reset()
    while len(rows := np.flatnonzero(episodes >= 0)):
        wanted = pilot.act(results.observations)
        if exploration > 0.0:
            wanted = wanted + noise[every, np.minimum(steps, clock - 1)] * most
        actions = np.clip(wanted, -most, most).astype(np.float32)
        buffers.actions[rows, steps[rows]] = actions[rows]
        batch.actions[:] = actions
        batch.step(generators, results)
        steps[rows] += 1
        buffers.note(rows, steps[rows], results)
        ended = rows[results.flags[-1, rows] | (steps[rows] >= clock)]
        if len(ended):
            for i in ended.tolist():
                yield int(episodes[i]), buffers.episode(starts[episodes[i]], i, int(steps[i]))
            begin(ended)
            if len(begun := ended[episodes[ended] >= 0]):
                pilot.reset(begun)
