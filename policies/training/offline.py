"""Agents from recorded data, without an environment: python -m wayfield.policies.training.offline bc|td3bc DATASET

Behaviour cloning asks for the recorded action; TD3+BC also learns what actions are worth, and leaves the recorded ones
where others promise more: Fujimoto and Gu, "A minimalist approach to offline reinforcement learning", NeurIPS 2021. The
agent is validated, saved and compared like any other. Plain torch, on one thread, so that a seed gives one agent.
"""

import dataclasses
import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from wayfield.envs.tasks.specs import EVERY
from wayfield.policies.learned.agent import Agent, Network, rounded, save_agent
from wayfield.policies.learned.perception import Perception, limits_of
from wayfield.policies.training.checkpoints import BEST
from wayfield.policies.training.presets import Preset, preset_for
from wayfield.policies.training.recorded import KEY, opened
from wayfield.policies.training.run import described_agent, versions
from wayfield.policies.training.validation import validate, validated
from wayfield.system.checks import shown
from wayfield.system.command_line import SEED, Choice, OneLineErrors, command_given, say

ALGORITHMS = ("bc", "td3bc")
BATCH = 256
RATE = 3e-4
BC_WEIGHT = 2.5  # the paper's alpha: of the value beside the recorded action
TARGET_RATE, DELAY = 0.005, 2  # tau of the targets; critic steps for each of the actor
TARGET_NOISE, MOST_NOISE = 0.2, 0.5  # of the target's actions
GRADIENT_STEPS = 20_000
_REPORTED = 500  # gradient steps between reports

Layers = list[tuple[NDArray[np.float32], NDArray[np.float32]]]
Tensors = tuple[torch.Tensor, ...]


class Transitions(NamedTuple):
    """n recorded steps as a network sees them; what follows the last step of an episode has no row of its own."""

    inputs: NDArray[np.float32]  # (n, i)
    actions: NDArray[np.float32]  # (n, 2) in [-1, 1], the network's
    rewards: NDArray[np.float32]  # (n,), of the environment
    following: NDArray[np.float32]  # (n, i) inputs a step later
    going_on: NDArray[np.float32]  # (n,) 0 where the task has ended the episode, 1 elsewhere, by the clock too


def transitions(data: Any, task: Any, preset: Preset) -> Transitions:
    """Returns the steps of a data set as the network of a preset sees them, episode after episode side by side.

    Raises:
        ValueError: if the observations are not those that the preset reads.
    """
    if task.layout.kind is not preset.features.observation:
        raise ValueError(f"preset {preset.name} reads {preset.worlds.task}, the data are of {task.spec.name}")
    numbers = [int(k) for k in data.episode_indices]
    episodes = sorted(data.storage.get_episodes(numbers), key=lambda each: -len(each["actions"]))
    perception = Perception(preset.features, preset.actions, len(task.robot.twist_axes), task.options.dt)
    limits = limits_of(preset.features, task.options.actuators) if preset.features.limits else None
    memory = perception.fresh(len(episodes))
    lengths = np.array([len(each["actions"]) for each in episodes])
    result: list[list[NDArray[np.float32]]] = [[] for _ in Transitions._fields]
    last: tuple[NDArray[np.float32], ...] | None = None
    for k in range(lengths[0] + 1):
        alive = int((lengths >= k).sum())  # the longest first: those that go on are in front
        observations = np.stack([each["observations"][k] for each in episodes[:alive]]).astype(np.float64)
        speeds = np.full(alive, preset.worlds.speed)
        inputs, angles = perception.inputs(task.layout.unpack(observations), speeds, memory[:alive], limits=limits)
        if last is not None:
            for column, values in zip(result, (*last, inputs[: len(last[0])]), strict=False):
                column.append(values)
            ended = np.array([each["terminations"][k - 1] for each in episodes[: len(last[0])]])
            result[4].append(1.0 - ended.astype(np.float32))
        go = int((lengths > k).sum())
        if not go:
            break
        twists = np.stack([each["actions"][k] for each in episodes[:go]]).astype(np.float64)
        actions = preset.actions.of_twists(twists, speeds[:go], angles[:go])
        rewards = np.array([each["rewards"][k] for each in episodes[:go]], np.float32)
        perception.remember(inputs[:go], actions, memory[:go])
        last = inputs[:go], actions, rewards
    return Transitions(*(np.concatenate(column) for column in result))


def network(sizes: Sequence[int], activation: str) -> torch.nn.Sequential:
    """Returns a multilayer perceptron."""
    between = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[activation]
    layers: list[torch.nn.Module] = []
    for come, go in itertools.pairwise(sizes):
        layers += [torch.nn.Linear(come, go), between()]
    return torch.nn.Sequential(*layers[:-1])


def layers_of(actor: torch.nn.Sequential) -> Layers:
    """Returns weights (outputs, inputs) and biases, layer after layer."""
    linear = [each for each in actor if isinstance(each, torch.nn.Linear)]
    return [(each.weight.detach().numpy().copy(), each.bias.detach().numpy().copy()) for each in linear]


def cloned(steps: Transitions, preset: Preset, count: int, seed: int) -> Iterator[tuple[int, float, Layers]]:
    """Yields, now and then, the gradient steps done, the loss and the actor: the mean squared error of its actions."""
    torch.manual_seed(seed)
    learning = preset.learning
    actor = network((steps.inputs.shape[1], *learning.hidden, steps.actions.shape[1]), learning.activation)
    optimizer = torch.optim.Adam(actor.parameters(), RATE)
    for k, (inputs, actions, *_) in _batches(steps, count, seed):
        loss = torch.nn.functional.mse_loss(actor(inputs), actions)
        _descend(optimizer, loss)
        if k % _REPORTED == 0 or k == count:
            yield k, loss.item(), layers_of(actor)


def improved(steps: Transitions, preset: Preset, count: int, seed: int) -> Iterator[tuple[int, float, Layers]]:
    """Yields what `cloned` does, of TD3+BC.

    The actor maximises Q(s, pi(s)) / mean|Q| times BC_WEIGHT, less (pi(s) - a)^2 (equations 3 and 5 of the paper); of
    two critics the lower counts, and their targets smooth the action (TD3). Actions are cut to [-1, 1] as they are when
    the agent drives; rewards are scaled to a standard deviation of 1 - discount, so that values are of order one.
    """
    torch.manual_seed(seed)
    size, width = steps.actions.shape[1], steps.inputs.shape[1]
    learning = preset.learning
    actor = network((width, *learning.hidden, size), learning.activation)
    critics = [network((width + size, *learning.hidden, 1), "relu") for _ in range(2)]
    aims = [network((width, *learning.hidden, size), learning.activation)]
    aims += [network((width + size, *learning.hidden, 1), "relu") for _ in range(2)]
    followed = [actor, *critics]
    for aim, source in zip(aims, followed, strict=True):
        aim.load_state_dict(source.state_dict())
    of_actor = torch.optim.Adam(actor.parameters(), RATE)
    of_critics = torch.optim.Adam([each for critic in critics for each in critic.parameters()], RATE)
    scale = (1.0 - learning.discount) / max(float(steps.rewards.std()), 1e-6)
    loss = torch.zeros(())
    for k, (inputs, actions, rewards, following, going_on) in _batches(steps, count, seed):
        noise = (TARGET_NOISE * torch.randn_like(actions)).clamp(-MOST_NOISE, MOST_NOISE)
        wanted = worth(scale * rewards, following, learning.discount * going_on, aims, noise)
        both = torch.cat([inputs, actions], 1)
        errors = [torch.nn.functional.mse_loss(critic(both).squeeze(1), wanted) for critic in critics]
        _descend(of_critics, errors[0] + errors[1])
        if k % DELAY == 0:
            requested = actor(inputs)
            value = critics[0](torch.cat([inputs, requested.clamp(-1.0, 1.0)], 1))
            weight = BC_WEIGHT / value.abs().mean().detach().clamp_min(1e-6)
            loss = torch.nn.functional.mse_loss(requested, actions) - weight * value.mean()
            _descend(of_actor, loss)
            with torch.no_grad():
                for aim, source in zip(aims, followed, strict=True):
                    for slow, fast in zip(aim.parameters(), source.parameters(), strict=True):
                        slow.lerp_(fast, TARGET_RATE)
        if k % _REPORTED == 0 or k == count:
            yield k, loss.item(), layers_of(actor)


def worth(
    rewards: torch.Tensor,
    following: torch.Tensor,
    discounts: torch.Tensor,
    aims: Sequence[torch.nn.Module],
    noise: torch.Tensor,
) -> torch.Tensor:
    """Returns what steps (n,) are worth by TD3: r + discount min(Q_1, Q_2) of what follows, of an action with noise.

    Args:
        discounts: (n,), 0 where the task has ended the episode.
        aims: the actor's target, and those of two critics.
        noise: (n, 2), added to the target's action before both are cut to [-1, 1].
    """
    actor, *critics = aims
    with torch.no_grad():
        later = torch.cat([following, (actor(following).clamp(-1.0, 1.0) + noise).clamp(-1.0, 1.0)], 1)
        one, other = (critic(later).squeeze(1) for critic in critics)
        return rewards + discounts * torch.minimum(one, other)


LEARNERS: Mapping[str, Callable[[Transitions, Preset, int, int], Iterator[tuple[int, float, Layers]]]] = {
    "bc": cloned,
    "td3bc": improved,
}


def _batches(steps: Transitions, count: int, seed: int) -> Iterator[tuple[int, Tensors]]:
    """Yields the numbers 1 to count, each with rows that are drawn for it."""
    generator = np.random.default_rng(seed)
    tensors = [torch.from_numpy(np.ascontiguousarray(each)) for each in steps]
    for k in range(1, count + 1):
        rows = torch.from_numpy(generator.integers(len(steps.inputs), size=BATCH))
        yield k, tuple(each[rows] for each in tensors)


def _descend(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


@dataclasses.dataclass(frozen=True)
class Offline:
    """What is learned from which data."""

    algorithm: str  # of ALGORITHMS
    source: str
    preset: Preset
    env_id: str
    command: str = ""

    def train(self, data: Any, steps: Transitions, task: Any, count: int, seed: int, home: Path) -> dict[str, float]:
        """Learns, validates and saves the agent of a seed; returns its validation.

        Raises:
            FloatingPointError: if the training diverged; nothing is saved then.
            OSError: if it cannot be saved.
        """
        torch.set_num_threads(1)
        layers: Layers = []
        for k, loss, reached in LEARNERS[self.algorithm](steps, self.preset, count, seed):
            layers = reached
            if not np.isfinite(loss):
                raise FloatingPointError(f"the training diverged after {k} gradient steps; nothing was saved")
        layers = rounded(layers)
        worlds = self.preset.worlds
        kwargs = dict(worlds.validation) | {"robot": task.robot.name if worlds.robot is None else worlds.robot}
        name = f"{self.algorithm}, seed {seed}"
        card = described_agent(self.preset, task, self.env_id, kwargs, name, layers)
        about = data.storage.metadata[KEY]
        training = {
            "algorithm": self.algorithm,
            "preset": self.preset.name,
            "seed": seed,
            "steps": len(steps.inputs),  # frames that it has seen
            "gradient_steps": count,
            "taught_by": "; ".join(about["policies"]),
            "data": {"name": str(data.spec.dataset_id), "digest": about["digest"]},
            "command": self.command,
            "versions": versions(),
        }
        preset = self.preset
        network = Network.of(layers, preset.learning.activation)
        agent: Any = Agent(network, preset.features, preset.actions, card, worlds.speed)
        score = validate(agent, self.env_id, kwargs, EVERY[worlds.task].clock)
        result = validated(score)
        save_agent(home / f"seed_{seed}" / BEST, layers, card | {"training": training, "validation": result})
        return dataclasses.asdict(score)


@click.command(cls=OneLineErrors, name="offline", context_settings={"max_content_width": 100})
@click.argument("algorithm", type=Choice("ALGORITHM", ALGORITHMS))
@click.argument("source", metavar="DATASET")
@click.option("--preset", "name", help="What the network sees and is; default: that of the data's environment.")
@click.option("--gradient-steps", "count", type=click.IntRange(1, 10**8), default=GRADIENT_STEPS, show_default=True)
@click.option("--seed", type=SEED, default=0, show_default=True, help="The first seed.")
@click.option("--seeds", type=click.IntRange(1, 1000), default=1, show_default=True, help="Agents.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder; default: results/offline/ALGORITHM.")
def main(algorithm: str, source: str, name: str | None, count: int, seed: int, seeds: int, out: Path | None) -> None:
    """Trains agents from DATASET, a Minari data set that was recorded, by its name or its folder.

    ALGORITHM is bc (behaviour cloning) or td3bc (TD3+BC). The folder gets seed_N/best for every seed, which
    evaluate --agents takes.
    """
    home = out or Path("results/offline") / algorithm
    try:
        data = opened(source)
        env_id = str(data.spec.env_spec.id)
        preset = preset_for(env_id, name)
        if preset.base is not None:
            raise ValueError(f"preset {preset.name} adds to a controller, which data do not hold")
        task = task_of(data)
        steps = transitions(data, task, preset)
        for each in range(seed, seed + seeds):
            if os.path.lexists(home / f"seed_{each}"):
                raise ValueError(f"{home / f'seed_{each}'} is there already; choose another --out")
        request = Offline(
            algorithm, source, preset, env_id, command_given("python -m wayfield.policies.training.offline")
        )
        for each in range(seed, seed + seeds):
            score = request.train(data, steps, task, count, each, home)
            result = f"success {score['success']:.0%}, error {score['error']:.4g}, return {score['reward']:.1f}"
            say(f"seed {each}: {len(steps.inputs):,} frames, validation: {result}; {home / f'seed_{each}' / BEST}")
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except FloatingPointError as error:
        raise click.ClickException(str(error)) from None


def task_of(data: Any) -> Any:
    """Returns the task that a data set was recorded in.

    Raises:
        ValueError: if its environment is none of ours, or asks for other actions than twists.
    """
    spec = data.spec.env_spec
    if spec is None or spec.id not in gymnasium.registry or not str(spec.id).startswith("wayfield/"):
        raise ValueError(f"the data are of {shown(getattr(spec, 'id', None))}, which this wayfield does not have")
    # by its id: what the set's file names as an entry point, or as a wrapper, is code
    env: Any = gymnasium.make(spec.id, max_episode_steps=spec.max_episode_steps, **spec.kwargs).unwrapped
    task = env.task
    env.close()
    if task.options.action_mode != "twist":
        raise ValueError(f"the data hold actions in the mode {task.options.action_mode}; agents command twists")
    return task


if __name__ == "__main__":
    main()
