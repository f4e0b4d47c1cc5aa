"""Trained agents: a folder of weights and a card, and the policy that drives with it."""

import dataclasses
import functools
import hashlib
import itertools
import json
import math
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import wayfield.envs  # noqa: F401  registers the ids that cards name
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled
from wayfield.envs.robots import Robot
from wayfield.policies.base import Base
from wayfield.policies.features import Actions, Features, GoalFeatures, Numbers, PathFeatures, Perception
from wayfield.policies.policy import Policy, check_gain

FORMAT = 1  # of the card
FEATURES: Mapping[str, type[Any]] = {"path_following": PathFeatures, "goal_reaching": GoalFeatures}
ACTIVATIONS = ("tanh", "relu")
CARD, WEIGHTS = "card.json", "weights.safetensors"


@dataclasses.dataclass(frozen=True)
class Network:
    """A multilayer perceptron, tanh or ReLU between its layers: the mean of the policy that was trained."""

    sizes: NDArray[np.int64]  # (n,) inputs, hidden layers, outputs
    numbers: Numbers  # layer after layer: weights (inputs, outputs) row by row, then biases
    activation: str = "tanh"  # one of ACTIVATIONS

    @classmethod
    def of(cls, layers: Sequence[tuple[NDArray[Any], NDArray[Any]]], activation: str = "tanh") -> "Network":
        """Returns the network of weights (outputs, inputs) and biases (outputs,), as torch keeps them."""
        sizes = [layers[0][0].shape[1], *(weight.shape[0] for weight, _ in layers)]
        pieces = [np.concatenate([weight.T.ravel(), bias]) for weight, bias in layers]
        return cls(np.array(sizes, np.int64), np.concatenate(pieces).astype(np.float32), activation)

    def __call__(self, inputs: Numbers) -> Numbers:
        """Returns the outputs (b, outputs) for inputs (b, inputs), each row as if it were alone."""
        outputs = np.empty((len(inputs), int(self.sizes[-1])), np.float32)
        scratch = np.empty((2, int(self.sizes.max())), np.float32)
        forward(inputs, self.sizes, self.numbers, self.activation == "relu", scratch, outputs)
        return outputs


@compiled
def forward(inputs, sizes, numbers, rectified, scratch, outputs):
    """Fills the outputs, row by row: a matrix product would round a row differently in another batch."""
    for i in range(inputs.shape[0]):
        for k in range(sizes[0]):
            scratch[0, k] = inputs[i, k]
        first = 0
        for layer in range(sizes.shape[0] - 1):
            come, go = sizes[layer], sizes[layer + 1]
            source, target = scratch[layer % 2], scratch[(layer + 1) % 2]
            for j in range(go):
                target[j] = numbers[first + come * go + j]
            for k in range(come):
                value = source[k]
                start = first + k * go
                for j in range(go):
                    target[j] += value * numbers[start + j]
            first += (come + 1) * go
            if layer < sizes.shape[0] - 2:
                for j in range(go):
                    target[j] = max(target[j], np.float32(0.0)) if rectified else math.tanh(target[j])
        for j in range(outputs.shape[1]):
            outputs[i, j] = scratch[(sizes.shape[0] - 1) % 2, j]


@dataclasses.dataclass(frozen=True)
class Agent:
    """Drives with a network trained by reinforcement: a = clip(network(features), -1, 1), then `Actions.twists`.

    Deterministic: the mean of the trained policy. It reads the observation alone; its memory is what it did last, and
    what it saw before where the card asks for several frames. With a base it adds to that controller's twist, knows
    what the controller knows, and keeps the controller's memory too. Drives the robot and the scan or preview that its
    card names, and refuses others.
    """

    network: Network
    features: Features
    actions: Actions
    card: Mapping[str, Any]
    speed: float = 0.6  # m/s, the most that it drives
    base: Base | None = None

    def __post_init__(self) -> None:
        check_gain(self, "speed", above=0.0)

    @property
    def knows(self) -> str:
        """Returns "sensors", or what the base knows."""
        return "sensors" if self.controller is None else self.controller.knows

    @functools.cached_property
    def controller(self) -> Policy | None:
        """Returns the base's controller at the agent's speed."""
        return None if self.base is None else self.base.policy(self.speed)

    @property
    def observes(self) -> tuple[type, ...]:
        """Returns the observation type of the agent's task."""
        return (self.features.observation,)

    @property
    def num_parameters(self) -> int:
        """Returns how many numbers the network has."""
        return len(self.network.numbers)

    def perception(self, briefing: Briefing) -> Perception:
        """Returns how the agent sees under a briefing."""
        based = self.base is not None
        return Perception(self.features, self.actions, len(briefing.robot.twist_axes), briefing.dt, based)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty memory.

        Raises:
            ValueError: if robot, control period or scan are not those of the card.
        """
        name = self.card.get("name", "an agent")
        if briefing.robot.name not in self.card["robots"]:
            raise ValueError(f"{name} drives {', '.join(self.card['robots'])}, not {briefing.robot.name}")
        if briefing.dt != self.card["dt"]:
            raise ValueError(f"{name} decides every {self.card['dt']:g} s, not every {briefing.dt:g} s")
        if isinstance(self.features, GoalFeatures):
            asked = self.features.num_beams, self.features.max_range
            given = len(briefing.beam_angles), briefing.max_range
            if asked != given or abs(briefing.beam_angles[0] + math.pi) > 1e-9:
                raise ValueError(
                    f"{name} needs num_beams={asked[0]} over the full circle and max_range={asked[1]:g} m, "
                    f"got {given[0]} and {given[1]:g} m"
                )
        fresh = self.perception(briefing).fresh(briefing.num_envs)
        if self.controller is None:
            return fresh
        under = self.controller.reset(briefing)
        kind = [("network", fresh.dtype, fresh.shape[1:]), ("base", under.dtype, under.shape[1:])]
        memory = np.empty(briefing.num_envs, kind)
        memory["network"], memory["base"] = fresh, under
        return memory

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        perception, robot = self.perception(briefing), briefing.robot
        speeds = np.full(len(memory), self.speed)
        asked = None
        own = memory
        if self.controller is not None:
            own, under = memory["network"], memory["base"].copy()
            asked = self.controller.act(observation, briefing, under)
            memory["base"] = under
        inputs, angles = perception.inputs(observation, speeds, own, asked)
        actions = np.clip(self.network(inputs), -1.0, 1.0)
        perception.remember(inputs, actions, own)
        return self.features.guarded(
            observation, commanded(self.actions, self.base, actions, asked, speeds, angles, robot)
        )


def commanded(
    meaning: Actions,
    base: Base | None,
    actions: NDArray[Any],
    asked: NDArray[np.float64] | None,
    speeds: NDArray[np.float64],
    angles: NDArray[np.float64],
    robot: Robot,
) -> NDArray[np.float64]:
    """Returns the twists (b, t) that actions (b, 2) command, with what a base asks for under them where there is one.

    Args:
        asked: (b, t) m/s and rad/s, of the base.
        speeds: (b,) m/s, asked of the agent.
        angles: (b,) rad, of the frames of the actions.
    """
    if base is None or asked is None:
        return meaning.twists(actions, speeds, angles, robot)
    return meaning.added(asked, actions, base.reach, speeds, angles, robot)


def save_agent(folder: str | os.PathLike[str], layers: Sequence[tuple[NDArray[Any], NDArray[Any]]], card: Any) -> None:
    """Writes an agent's folder: weights (outputs, inputs) and biases of its layers, and its card; each file whole."""
    from safetensors.numpy import save

    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    tensors = {}
    for k, (weight, bias) in enumerate(layers):
        tensors[f"layer_{k}.weight"] = np.ascontiguousarray(weight, np.float32)
        tensors[f"layer_{k}.bias"] = np.ascontiguousarray(bias, np.float32)
    write_whole(folder / WEIGHTS, save(tensors))
    write_whole(folder / CARD, (json.dumps(card, indent=2) + "\n").encode())


def weights_digest(layers: Sequence[tuple[NDArray[Any], NDArray[Any]]]) -> str:
    """Returns the SHA-256 of weights and biases, by which a card knows them."""
    sha = hashlib.sha256()
    for weight, bias in layers:
        sha.update(np.ascontiguousarray(weight, "<f4").tobytes() + np.ascontiguousarray(bias, "<f4").tobytes())
    return sha.hexdigest()


def write_whole(file: pathlib.Path, content: bytes) -> None:
    """Writes a file so that at any moment the old or the new content is there, whole."""
    part = file.with_name(file.name + ".part")
    try:
        with open(part, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def load_agent(folder: str | os.PathLike[str], **gains: Any) -> Agent:
    """Returns the agent of a folder; `speed` (m/s) may take the place of the one it was trained for.

    Only numbers and text are read: no code of the folder runs.

    Raises:
        ValueError: if a file is missing, damaged or of another kind, or the card is for an environment that this
            wayfield does not have; the message names the file.
    """
    folder = pathlib.Path(folder)
    card = read_card(folder / CARD)
    file = folder / WEIGHTS
    tensors = read_tensors(file)
    hidden = card["network"]["hidden"]
    features, actions = card_features(card, folder / CARD)
    base = card_base(card, folder / CARD)
    perception = Perception(features, actions, card["network"]["num_twist"], card["dt"], base is not None)
    sizes = [perception.num_inputs, *hidden, actions.size]
    layers = []
    for k, (come, go) in enumerate(itertools.pairwise(sizes)):
        for part, shape in (("weight", (go, come)), ("bias", (go,))):
            tensor = tensors.pop(f"layer_{k}.{part}", None)
            if tensor is None:
                raise ValueError(f"{file} has no layer_{k}.{part}; it does not belong to {CARD}")
            if tensor.shape != shape or tensor.dtype != np.float32 or not np.isfinite(tensor).all():
                raise ValueError(
                    f"{file}: layer_{k}.{part} must be finite float32 of shape {shape} by {CARD}, got "
                    f"{tensor.dtype} of shape {tensor.shape}"
                )
            layers.append(tensor)
    if tensors:
        raise ValueError(f"{file} also holds {', '.join(sorted(tensors))}; it does not belong to {CARD}")
    pairs = list(zip(layers[::2], layers[1::2], strict=True))
    if weights_digest(pairs) != card["sha256"]:
        raise ValueError(f"{file} holds other weights than {CARD} was written for: their SHA-256 differs")
    network = Network.of(pairs, card["network"]["activation"])
    try:
        return Agent(network, features, actions, card, **({"speed": card["speed"], "base": base} | gains))
    except ValueError as error:
        raise ValueError(f"{folder / CARD}: {error}") from None


def card_base(card: Mapping[str, Any], file: pathlib.Path) -> Base | None:
    """Returns the controller that a card's agent adds to; None for one that drives by itself.

    Raises:
        ValueError: naming the file, if it is no controller of this wayfield with gains of its own.
    """
    if card.get("base") is None:
        return None
    try:
        base = Base(**card["base"])
        if FEATURES[card["task"]].observation not in base.policy(1.0).observes:
            raise ValueError(f"controller {base.controller!r} does not read observations of {card['task']}")
        return base
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file}: base is {card['base']!r}: {error}") from None


def card_features(card: Mapping[str, Any], file: pathlib.Path) -> tuple[Features, Actions]:
    """Returns the features and actions that a card describes.

    Raises:
        ValueError: naming the file, if a value of theirs is of the wrong kind or out of range.
    """
    trails = card["features"]["trails"]
    try:
        trails = tuple(trails) if isinstance(trails, list) else trails
        return FEATURES[card["task"]](**card["features"] | {"trails": trails}), Actions(**card["actions"])
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


_CARD_KINDS = {
    "env_id": str, "robots": list, "task": str, "dt": float, "speed": float, "features": dict, "actions": dict,
    "network": dict, "sha256": str, "training": dict,
}  # fmt: skip


def read_card(file: pathlib.Path) -> dict[str, Any]:
    """Returns an agent's card, checked.

    Raises:
        ValueError: naming the file and what is wrong with it.
    """
    try:
        card = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {error.strerror}; an agent is a folder with {CARD}") from None
    except ValueError as error:
        raise ValueError(f"{file} is no JSON: {error}") from None
    if not isinstance(card, dict) or "format" not in card:
        raise ValueError(f"{file} is not the card of an agent: it has no format")
    if card["format"] != FORMAT:
        raise ValueError(f"{file} has format {card['format']!r}; this wayfield reads format {FORMAT}")
    for key, kind in _CARD_KINDS.items():
        if not isinstance(card.get(key), kind):
            raise ValueError(f"{file}: {key} must be a {kind.__name__}, got {card.get(key)!r}")
    if not all(isinstance(each, str) for each in card["robots"]):
        raise ValueError(f"{file}: robots must be names, got {card['robots']!r}")
    if card["env_id"] not in gymnasium.registry:
        ours = sorted(each for each in gymnasium.registry if each.startswith("wayfield/"))
        raise ValueError(f"{file} is for {card['env_id']}, which this wayfield does not have; it has {', '.join(ours)}")
    if card["task"] not in FEATURES:
        raise ValueError(f"{file}: task {card['task']!r} is none of {', '.join(FEATURES)}")
    for key, kind in (("features", FEATURES[card["task"]]), ("actions", Actions)):
        names = {field.name for field in dataclasses.fields(kind)}
        if set(card[key]) != names:
            odd = ", ".join(sorted(set(card[key]) ^ names))
            raise ValueError(f"{file}: {key} must have exactly {', '.join(sorted(names))}; not so: {odd}")
    if type(card["training"].get("steps")) is not int:
        raise ValueError(f"{file}: training.steps must be a whole number, got {card['training'].get('steps')!r}")
    network = card["network"]
    hidden = network.get("hidden")
    if not isinstance(hidden, list) or not all(type(n) is int and n > 0 for n in hidden):
        raise ValueError(f"{file}: network.hidden must be a list of whole numbers > 0, got {hidden!r}")
    if type(network.get("num_twist")) is not int or network.get("activation") not in ACTIVATIONS:
        raise ValueError(f"{file}: network needs num_twist and the activation {' or '.join(ACTIVATIONS)}: {network!r}")
    return card


def read_tensors(file: pathlib.Path) -> dict[str, NDArray[Any]]:
    """Returns the arrays of a safetensors file.

    Raises:
        ValueError: naming the file, if it is missing or damaged.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return dict(load(file.read_bytes()))
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {error.strerror}") from None
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{file} is damaged or no safetensors file: {error}") from None
