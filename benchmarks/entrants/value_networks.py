"""Published value networks of the CrowdNav family, from a file of the user's own: SARL, LSTM-RL and CADRL.

Source: Chen, Liu, Kreiss and Alahi, ICRA 2019, arXiv 1809.08835; github.com/vita-epfl/CrowdNav. Layouts are told by the
names of the arrays that its `state_dict` has.
"""

import dataclasses
import functools
import itertools
import math
import os
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import team_worlds
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.policy import check_robot
from wayfield.system.checks import unread
from wayfield.system.extras import installs
from wayfield.system.readers import reader
from wayfield.system.reading import read_arrays

SUFFIXES = (".safetensors", ".onnx", ".pth", ".pt")
PERSON, ITSELF = 13, 6  # numbers of a person as the robot sees it, and those of them that are the robot's own
SPEEDS, DIRECTIONS = 5, 16
COLLIDES, ARRIVES, NEAR = -0.25, 1.0, 0.2  # rewards, and m of gap below which each costs half of what it lacks
MOST_AT_ONCE = 32  # robots
MEMORY = np.dtype([("left", np.int64), ("vx", np.float64), ("vy", np.float64)], align=True)  # periods; m/s, world

Array = NDArray[Any]
Layers = list[tuple[Array, Array]]
Value = Callable[[Array], Array]  # of (n, people, PERSON), the farthest person first: (n,)


@dataclasses.dataclass(frozen=True)
class ValueNetwork:
    """Drives the velocity of 81 whose next state has the greatest reward and value, people keeping their velocities.

    As CrowdNav's `predict` without its simulator: speeds (e^(k/5) - 1) / (e - 1) `speed`, sixteen directions, or rest;
    a reward of 1 at the goal, -0.25 for contact, (gap - 0.2) / 2 `period` near people; plus gamma^(period speed) times
    the network's value. A velocity is held for `period`. Where nobody is in sight it drives straight to the goal.

    Args:
        file: of the weights: safetensors or ONNX, (b, people, 13) to (b, 1); or a pickle of PyTorch.
        speed: m/s, preferred.
        gamma: discount a second at 1 m/s.
        period: s, between two decisions.

    Raises:
        ValueError: if the file cannot be read or holds no such network.
    """

    file: str
    speed: float = 1.0
    gamma: float = 0.9
    period: float = 0.25

    knows: ClassVar[str] = "bodies"
    observes: ClassVar[tuple[type, ...]] = (team_worlds.Observation,)
    needs: ClassVar[tuple[str, ...]] = ("holonomic",)

    def __post_init__(self) -> None:
        network(self.file)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns MEMORY records (b,).

        Raises:
            ValueError: if the robot does not drive sideways.
        """
        check_robot(self, briefing.robot)
        return np.zeros(briefing.num_envs, MEMORY)

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, 3), m/s and rad/s."""
        due = np.flatnonzero(memory["left"] == 0)
        counts = (observation.bodies[due, :, 6] > 0.5).sum(axis=1)
        for count in np.unique(counts):
            rows = due[counts == count]
            for first in range(0, len(rows), MOST_AT_ONCE):
                some = rows[first : first + MOST_AT_ONCE]
                velocities = self.decided(observation, some, int(count), briefing.robot.hull_radius)
                memory["vx"][some], memory["vy"][some] = velocities.T
        memory["left"][due] = max(round(self.period / briefing.dt), 1)
        memory["left"] -= 1
        x, y = rotated(np.column_stack([memory["vx"], memory["vy"]]), -observation.pose[:, 2]).T
        return np.column_stack([x, y, np.zeros(len(memory))])

    def decided(self, observation: Any, rows: Array, count: int, radius: float) -> Array:
        """Returns the velocities (n, 2) of some robots that see as many people, m/s, world frame."""
        headings = observation.pose[rows, 2]
        goals = rotated(observation.goal[rows], headings)
        if not count:
            far = np.linalg.norm(goals, axis=1, keepdims=True)
            return np.asarray(goals / np.maximum(far, 1e-9) * np.minimum(self.speed, far / self.period))
        seen = observation.bodies[rows, :count][:, ::-1].astype(np.float64)
        places, walks = (
            rotated(seen[:, :, k : k + 2].reshape(-1, 2), np.repeat(headings, count)).reshape(-1, count, 2)
            for k in (0, 2)
        )
        actions = velocities(self.speed)
        ahead = goals[:, None] - actions * self.period  # (n, actions, 2)
        apart = (places + walks * self.period)[:, None] - (actions * self.period)[:, None]
        far = np.linalg.norm(apart, axis=3)
        gaps = (far - radius - seen[:, None, :, 4]).min(axis=2)
        rewards = np.where(gaps < NEAR, 0.5 * (gaps - NEAR) * self.period, 0.0)
        rewards = np.where(np.linalg.norm(ahead, axis=2) < radius, ARRIVES, rewards)
        rewards = np.where(gaps < 0.0, COLLIDES, rewards)
        states = joint_states(ahead, actions, apart, walks, radius, seen[:, :, 4], self.speed)
        values = network(self.file)(states.reshape(-1, count, PERSON)).reshape(rewards.shape)
        return np.asarray(actions[(rewards + self.gamma ** (self.period * self.speed) * values).argmax(axis=1)])


def velocities(speed: float) -> Array:
    """Returns the velocities (81, 2) that are compared, rest first, m/s."""
    steps = [(math.exp((k + 1) / SPEEDS) - 1.0) / (math.e - 1.0) * speed for k in range(SPEEDS)]
    angles = [2.0 * math.pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    driven = [(v * math.cos(angle), v * math.sin(angle)) for angle, v in itertools.product(angles, steps)]
    return np.array([(0.0, 0.0), *driven])


def rotated(vectors: Array, angles: Array) -> Array:
    """Returns vectors (n, 2) turned by angles (n,)."""
    cosines, sines = np.cos(angles), np.sin(angles)
    x, y = vectors.T
    return np.column_stack([cosines * x - sines * y, sines * x + cosines * y])


def joint_states(
    goals: Array, actions: Array, apart: Array, walks: Array, radius: float, radii: Array, speed: float
) -> Array:
    """Returns what a network reads (n, actions, people, PERSON), in the frame whose x axis leads to the goal.

    Args:
        goals: (n, actions, 2) from the robot, m.
        actions: (actions, 2) m/s.
        apart: (n, actions, people, 2) from the robot, m.
        walks: (n, people, 2) m/s.
        radius, radii: of the robot, and (n, people) of the people, m.
        speed: that the robot prefers, m/s.
    """
    states: Array = np.zeros((*apart.shape[:3], PERSON), np.float32)
    far = np.linalg.norm(goals, axis=2)
    axes: Array = goals / np.maximum(far, 1e-12)[:, :, None]
    x, y = axes[:, :, 0], axes[:, :, 1]
    states[..., 0] = far[:, :, None]
    states[..., 1] = speed
    states[..., 3] = radius
    states[..., 4] = (actions[:, 0] * x + actions[:, 1] * y)[:, :, None]
    states[..., 5] = (actions[:, 1] * x - actions[:, 0] * y)[:, :, None]
    for k, vectors in ((6, apart), (8, np.broadcast_to(walks[:, None], apart.shape))):
        states[..., k] = vectors[..., 0] * x[:, :, None] + vectors[..., 1] * y[:, :, None]
        states[..., k + 1] = vectors[..., 1] * x[:, :, None] - vectors[..., 0] * y[:, :, None]
    states[..., 10] = radii[:, None]
    states[..., 11] = np.linalg.norm(apart, axis=3)
    states[..., 12] = radius + radii[:, None]
    return states


# Files.


def _arrays() -> dict[str, Array]:
    sizes = (PERSON, 4, 1)
    arrays: dict[str, Array] = {}
    for k, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        arrays[f"value_network.{2 * k}.weight"] = np.full((outputs, inputs), 0.1, np.float32)
        arrays[f"value_network.{2 * k}.bias"] = np.zeros(outputs, np.float32)
    return arrays


def _sample(folder: Path) -> None:
    from safetensors.numpy import save_file

    save_file(_arrays(), folder / "cadrl.safetensors")


def _pickled(folder: Path) -> None:
    import torch

    torch.save({name: torch.from_numpy(array) for name, array in _arrays().items()}, folder / "cadrl.pth")


@reader("value network", "cadrl.safetensors", _sample)
@functools.lru_cache(maxsize=8)
def network(file: str) -> Value:
    """Returns the value of joint states by the network of a file.

    Raises:
        ValueError: naming the file, if it cannot be read or holds no such network.
    """
    suffix = Path(file).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{file!r} must be a file of weights: {', '.join(SUFFIXES)}")
    if suffix == ".onnx":
        return graph(file)
    arrays = read_arrays(Path(file))[0] if suffix == ".safetensors" else unpickled(file)
    try:
        with np.errstate(all="ignore"):
            value = by_names({name: np.asarray(array, np.float32) for name, array in arrays.items()})
            answer = value(np.ones((2, 3, PERSON), np.float32))
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise ValueError(
            f"{file!r} holds no value network of CrowdNav's SARL, LSTM-RL or CADRL without occupancy maps: "
            f"{' '.join(str(error).split())[:200]}"
        ) from None
    if answer.shape != (2,) or not np.isfinite(answer).all():
        raise ValueError(f"{file!r} must give one finite value a state, got {answer.ravel()[:3]}")
    return value


@reader("pickled value network", "cadrl.pth", _pickled)
def unpickled(file: str) -> Mapping[str, Any]:
    """Returns the arrays of a pickle of PyTorch, of which nothing but tensors is read; warns of it."""
    try:
        import torch
    except ImportError:
        raise ValueError(f"{file!r} needs PyTorch: {installs('train')}") from None
    warnings.warn(
        f"{os.path.basename(file)} is a pickle, of which tensors alone are read: give files only that you trust, or "
        "safetensors",
        UserWarning,
        stacklevel=2,
    )
    try:
        with warnings.catch_warnings(action="ignore"):
            tensors = torch.load(file, map_location="cpu", weights_only=True)
        return {name: tensor.numpy() for name, tensor in tensors.items()}
    except OSError as error:
        raise ValueError(f"{file!r} cannot be read: {unread(file, error)}") from None
    except Exception as error:  # as many kinds as there are damages; PyTorch's advice is to read what runs code
        said = " ".join(str(error).split()).rpartition("WeightsUnpickler error: ")[2].partition(" Please use")[0]
        why = f" ({said[:120].rstrip('.')})" if said else ""
        raise ValueError(
            f"{file!r} holds no plain dictionary of tensors{why}: save its state_dict() as safetensors"
        ) from None


def graph(file: str) -> Value:
    """Returns the value by an ONNX graph."""
    try:
        import onnxruntime
    except ImportError:
        raise ValueError(f"{file!r} needs onnxruntime: {installs('onnx')}") from None
    try:
        session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
        name, *others = [each.name for each in session.get_inputs()]
        if others:
            raise ValueError(f"it reads {', '.join(others)} too")

        def value(states: Array) -> Array:
            return np.asarray(session.run(None, {name: states})[0]).reshape(len(states))

        value(np.ones((2, 3, PERSON), np.float32))
    except Exception as error:
        said = " ".join(str(error).split())[:200]
        raise ValueError(
            f"{file!r} must be an ONNX graph of (b, people, {PERSON}) to (b, 1), b and people free: {said}"
        ) from None
    return value


def by_names(arrays: Mapping[str, Array]) -> Value:
    """Returns the value by arrays as CrowdNav's networks name them; KeyError, ValueError if they do not fit."""

    def layers(prefix: str) -> Layers:
        names = sorted((int(name.split(".")[1]), name) for name in arrays if name.startswith(f"{prefix}."))
        return [(arrays[name], arrays[f"{prefix}.{k}.bias"]) for k, name in names if name.endswith(".weight")]

    if "value_network.0.weight" in arrays:
        one = layers("value_network")
        return lambda states: mlp(one, states)[:, :, 0].min(axis=1)
    if "lstm.weight_ih_l0" in arrays:
        paired, last = layers("mlp1"), layers("mlp")
        cell = [arrays[f"lstm.{name}_l0"] for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")]
        return lambda states: mlp(last, joined(states, recurrent(cell, mlp(paired, states))))[:, 0]
    embed, features, attention, last = map(layers, ("mlp1", "mlp2", "attention", "mlp3"))
    if not (embed and features and attention and last):
        raise ValueError(f"its arrays are {', '.join(list(arrays)[:6])}")
    paired = attention[0][0].shape[1] > len(embed[-1][1])

    def attended(states: Array) -> Array:
        seen = np.maximum(mlp(embed, states), 0.0)
        whole = np.broadcast_to(seen.mean(axis=1, keepdims=True), seen.shape)
        scores = mlp(attention, np.concatenate([seen, whole], axis=2) if paired else seen)
        weights = np.exp(scores - scores.max(axis=1, keepdims=True))
        weights /= weights.sum(axis=1, keepdims=True)
        return mlp(last, joined(states, (weights * mlp(features, seen)).sum(axis=1)))[:, 0]

    return attended


def joined(states: Array, crowd: Array) -> Array:
    """Returns the robot's own numbers beside those of the crowd."""
    return np.concatenate([states[:, 0, :ITSELF], crowd], axis=1)


def mlp(layers: Layers, values: Array) -> Array:
    """Returns what layers with rectifiers between them make of (..., inputs); the values themselves of no layers."""
    for k, (weight, bias) in enumerate(layers):
        values = (np.maximum(values, 0.0) if k else values) @ weight.T + bias
    return values


def recurrent(cell: list[Array], values: Array) -> Array:
    """Returns the last hidden state (n, h) of an LSTM over (n, people, inputs), which begins at zero."""
    of_input, of_hidden, *biases = cell
    hidden = state = np.zeros((len(values), of_hidden.shape[1]), np.float32)
    for k in range(values.shape[1]):
        gates = values[:, k] @ of_input.T + hidden @ of_hidden.T + biases[0] + biases[1]
        opens, forgets, candidate, shows = np.split(gates, 4, axis=1)
        state = sigmoid(forgets) * state + sigmoid(opens) * np.tanh(candidate)
        hidden = sigmoid(shows) * np.tanh(state)
    return hidden


def sigmoid(values: Array) -> Array:
    """Returns the logistic function."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * values)))
