"""Small networks that claims train: how they are kept, and the policies that they drive.

A policy says what its network sees and what its actions do; `training` needs no more.
"""

import dataclasses
import functools
import itertools
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.system.reading import read_arrays

SECTORS = 24  # of a scan, as networks see it

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Networked:
    """A policy whose network sets numbers, each from -1 to 1, that hold for some control periods.

    Args:
        seed: of the training.
        folder: of the networks; "": those that ship.
    """

    seed: int = 0
    folder: str = ""

    weights: ClassVar[str]  # the name of their file
    actions: ClassVar[int] = 1
    inputs: ClassVar[int]
    held: ClassVar[int] = 1  # control periods
    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    @property
    def network(self) -> str:
        """Returns the name of the network in its file."""
        return str(self.seed)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns a memory (b,): the numbers, for how long they have held, and what `more_memory` says."""
        robots = briefing.num_envs
        mine = {"held": np.zeros(robots, np.int64), "action": np.zeros((robots, self.actions))}
        return together({**mine, **self.more_memory(briefing)})

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, 2), m/s and rad/s."""
        due = memory["held"] % self.held == 0
        if due.any():
            seen = self.see(observation, briefing)[due]
            memory["action"][due] = answer(self.folder, self.weights, self.network, seen)
        memory["held"] += 1
        return self.driven(observation, briefing, memory)

    def more_memory(self, briefing: Briefing) -> dict[str, NDArray[Any]]:
        """Returns what it remembers beside, (b, ...)."""
        del briefing
        return {}

    def see(self, observation: Any, briefing: Briefing) -> Array:
        """Returns what the network sees, (b, inputs)."""
        raise NotImplementedError

    def driven(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, 2) by memory["action"]."""
        raise NotImplementedError


def together(memories: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """Returns memories (b, ...) as the fields of one (b,)."""
    fields: list[Any] = [(name, each.dtype, each.shape[1:]) for name, each in memories.items()]
    memory = np.zeros(len(next(iter(memories.values()))), fields)
    for name, each in memories.items():
        memory[name] = each
    return memory


def answer(folder: str, weights: str, network: str, seen: Array) -> Array:
    """Returns the actions (b, n), -1 to 1, of a network of a folder, or of one that ships."""
    *hidden, (last, offset) = layers(folder, weights, network)
    for matrix, bias in hidden:
        seen = np.tanh(seen @ matrix.T + bias)
    return np.clip(seen @ last.T + offset, -1.0, 1.0)


@functools.lru_cache(maxsize=32)
def layers(folder: str, weights: str, network: str) -> list[tuple[Array, Array]]:
    """Returns the layers (matrix, bias) of a network.

    Raises:
        ValueError: if the file cannot be read, or has no such network.
    """
    ships = Path(str(resources.files("wayfield.benchmarks.papers")))
    file = (Path(folder) if folder else ships) / weights
    arrays, _ = read_arrays(file)
    names = (f"{network}.{k}" for k in itertools.count())
    there = itertools.takewhile(lambda name: f"{name}.weight" in arrays, names)
    parts = [(arrays[f"{name}.weight"].astype(np.float64), arrays[f"{name}.bias"].astype(np.float64)) for name in there]
    if not parts:
        raise ValueError(f"{file} has no network of seed {network}")
    return parts


def scanned(observation: Any, briefing: Briefing) -> Array:
    """Returns what a network sees of a scan and a goal (b, SECTORS + 5), each about 1 at most.

    The nearest hit of each sector, close ones finer; how far the goal is and where; the twist.
    """
    ranges = observation.ranges.reshape(len(observation.ranges), SECTORS, -1).min(axis=2)
    distance = np.linalg.norm(observation.goal, axis=1, keepdims=True)
    goal = observation.goal / np.maximum(distance, 1e-9)
    return np.hstack([1.0 / (1.0 + 2.0 * ranges), np.minimum(distance / 5.0, 2.0), goal, observation.twist / 2.0])
