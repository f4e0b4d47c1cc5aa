"""Trained agents: a folder of weights and a card, and the policy that drives with it."""

import contextlib
import dataclasses
import functools
import hashlib
import itertools
import json
import os
import pathlib
import shutil
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import wayfield.envs  # noqa: F401  registers the ids that cards name
from wayfield.envs import path_following
from wayfield.envs.robots import ROBOTS, Actuators, Robot
from wayfield.envs.robots.records import lag_factors
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.tasks.specs import EVERY
from wayfield.policies.learned.conditions import (
    NewToAgent,
    check_conditions,
    check_described,
    effective_actuators,
    held_pace,
    network_speed,
    out_of_distribution,
)
from wayfield.policies.learned.features import Numbers
from wayfield.policies.learned.features_sheet import RobotFeatures, SheetFeatures
from wayfield.policies.learned.perception import (
    FEATURES,
    Actions,
    Features,
    Perception,
    features_for,
    features_kind,
    hold,
    limits_of,
)
from wayfield.policies.learned.rescue import drive_on, take_over, waiting
from wayfield.policies.learned.residual import Base
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.shield import Shield
from wayfield.system.checks import LONGEST, MOST_GAIN, shown, unread
from wayfield.system.compiled import allocating, inlined
from wayfield.system.elementary import hyperbolic_tangent
from wayfield.system.readers import of_folder, reader
from wayfield.system.reading import is_whole, read_arrays, read_object
from wayfield.system.storage import digest, sync_folder, temporary_folder, write_whole

# of the card: from 2 on it holds a digest of itself, from 3 and 4 on what _SINCE names, from 5 on what a path follower
# drives where it is told a speed; older ones are read
FORMAT = 5
_MOST_WEIGHT = 1e6  # in size: a network of larger ones may answer with what is not finite
_SINCE: Mapping[str, Mapping[str, Any]] = {
    "path_following": {"limits": False},
    "goal_reaching": {"limits": False, "arrival": 0.0, "moving": False},
}
_ACTIONS_SINCE = {"reverse": 0.0}
MOST_LAYERS, MOST_WIDTH = 32, 2**14  # of a network, so that its size is known to be sane before memory is taken
ACTIVATIONS = ("tanh", "relu")
# of an agent that is loaded; what training validates has neither
PACE_TIME = 2.0  # s, in which it makes up what it is late by, on a path
PATIENCE = 3.0  # s, without way made to a dock or along a path, after which a law drives on
CARD, WEIGHTS = "card.json", "weights.safetensors"
_NEXT = "weights.next.safetensors"  # the weights of the card, until they take the place of those before


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

    @property
    def layers(self) -> list[tuple[Numbers, Numbers]]:
        """Returns weights (outputs, inputs) and biases (outputs,), layer after layer."""
        pairs, first = [], 0
        for come, go in itertools.pairwise(self.sizes.tolist()):
            weight, bias = np.split(self.numbers[first : first + (come + 1) * go], [come * go])
            pairs.append((weight.reshape(come, go).T, bias))
            first += (come + 1) * go
        return pairs

    def __call__(self, inputs: Numbers) -> Numbers:
        """Returns the outputs (b, outputs) for inputs (b, inputs), each row as if it were alone."""
        outputs = np.empty((len(inputs), int(self.sizes[-1])), np.float32)
        scratch = np.empty((2, int(self.sizes.max())), np.float32)
        forward(inputs, self.sizes, self.numbers, self.activation == "relu", scratch, outputs)
        return outputs


@allocating
def forward(inputs, sizes, numbers, rectified, scratch, outputs):
    """Fills the outputs, row by row: a matrix product would round a row differently in another batch."""
    active = np.empty(scratch.shape[1] + 1, np.uint64)
    for i in range(inputs.shape[0]):
        for k in range(sizes[0]):
            scratch[0, k] = inputs[i, k]
        first = np.uint64(0)
        for layer in range(sizes.shape[0] - 1):
            come, go = np.uint64(sizes[layer]), np.uint64(sizes[layer + 1])
            target = scratch[(layer + 1) % 2]
            add_up(scratch[layer % 2], numbers, first, come, go, active, target)
            first += (come + np.uint64(1)) * go
            if layer == sizes.shape[0] - 2:
                for j in range(outputs.shape[1]):
                    outputs[i, j] = target[j]
            elif rectified:
                for j in range(go):
                    target[j] = max(target[j], np.float32(0.0))
            else:
                for j in range(go):
                    target[j] = np.float32(hyperbolic_tangent(target[j]))


@inlined
def add_up(source, numbers, first, come, go, active, target):
    """Fills the sums of a layer, whose numbers begin at `first`, in target (go,) for inputs in source (come,).

    Eight inputs at a time, added one after the other as if each were alone, and those that are 0 not at all. Indices
    are unsigned: asked whether they count from the end, several could not be done by one instruction.
    """
    one, eight = np.uint64(1), np.uint64(8)
    for j in range(go):
        target[j] = numbers[first + come * go + j]
    count = np.uint64(0)
    for j in range(come):
        active[count] = j
        count += np.uint64(source[j] != np.float32(0.0))
    k = np.uint64(0)
    while k + eight <= count:
        a, b, c, d = active[k], active[k + one], active[k + np.uint64(2)], active[k + np.uint64(3)]
        e, f, g, h = (
            active[k + np.uint64(4)],
            active[k + np.uint64(5)],
            active[k + np.uint64(6)],
            active[k + np.uint64(7)],
        )
        p, q, r, s = source[a], source[b], source[c], source[d]
        t, u, v, w = source[e], source[f], source[g], source[h]
        a, b, c, d = first + a * go, first + b * go, first + c * go, first + d * go
        e, f, g, h = first + e * go, first + f * go, first + g * go, first + h * go
        for j in range(go):
            value = target[j] + p * numbers[a + j]
            value += q * numbers[b + j]
            value += r * numbers[c + j]
            value += s * numbers[d + j]
            value += t * numbers[e + j]
            value += u * numbers[f + j]
            value += v * numbers[g + j]
            target[j] = value + w * numbers[h + j]
        k += eight
    while k < count:
        value = source[active[k]]
        start = first + active[k] * go
        for j in range(go):
            target[j] += value * numbers[start + j]
        k += one


@dataclasses.dataclass(frozen=True)
class Agent(Gains):
    """Drives with a network trained by reinforcement: a = clip(network(features), -1, 1), then `Actions.twists`.

    Deterministic: the mean of the trained policy. It reads the observation alone; its memory is what it did last, and
    what it saw before where the card asks for several frames. With a base it adds to that controller's twist, knows
    what the controller knows, and keeps the controller's memory too. Drives the robot and the preview that its card
    names, by any scan that can be read as the card's, and refuses others.

    With `pace_time` a path follower holds the asked speed as the mean on the path at hand, where its base can
    (`held_pace`). Without, and where its card says how fast it drove when it was told a speed (`cruises`), the network
    is told the one of which the asked one comes as the mean over training paths (`network_speed`), as a controller's
    cruising speed is tuned: sharp corners are among those, so that on a circuit it is a tenth too fast.

    A base that is quicker than those that it was trained on is driven as the quickest of those (`effective_actuators`,
    `hold`); one that is slower, so slowly that it stops on the same way (`network_speed`). Of what else is new, it
    warns. A base with the body of a robot that it knows (`body_of`) and a delay of its own it drives from the predicted
    state: see `parts.forward_prediction`.

    One that docks and has made no way for `patience`, or sees that something moves, leaves the rest to a law,
    `reeds_shepp_scan`: beside the pose and before narrow gaps a network may stand where that law sees a way (`rescue`).
    Along a path, before some corners, a law drives it on by 0.3 m.
    """

    network: Network
    features: Features
    actions: Actions
    card: Mapping[str, Any]
    speed: float = gain(0.6, "m/s", "the mean on a path, with `cruises` or `pace_time`; else the most", above=0.0)
    base: Base | None = None
    pace_time: float = gain(0.0, "s", "in which it makes up what it is late by, on a path; 0: never", least=0.0)
    patience: float = gain(0.0, "s", "without way made, after which a law drives on; 0: for ever", least=0.0)

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
        features = features_for(self.features, briefing, self.speed)
        return _perception(features, self.actions.of(features), len(briefing.robot.twist_axes), briefing.dt, based)

    def trained_with(self, robot: Robot) -> bool:
        """Returns whether the agent was trained with a robot as it is: it then needs no prediction of delays."""
        return not any_robot(self.card) and drives(self.card, robot)

    @property
    def keeps_pace(self) -> bool:
        """Returns whether it makes up what it is late by: only where a path is followed there is a pace."""
        return self.pace_time > 0.0 and EVERY[self.card["task"]].observes == "path"

    def _of_body(self, briefing: Briefing) -> Briefing:
        """Returns the briefing with the robot that the agent knows, where the base has its body."""
        robot = briefing.robot
        if not robot.responds or any_robot(self.card) or drives(self.card, robot):
            return briefing
        return dataclasses.replace(briefing, robot=body_of(robot))

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty memory; warns once, in a line, of what the agent was not trained for.

        Raises:
            ValueError: if robot or control period are not those of the card, or the scan cannot be read.
        """
        name, briefing = self.card.get("name", "an agent"), self._of_body(briefing)
        if any_robot(self.card):
            if len(briefing.robot.twist_axes) != self.card["network"]["num_twist"]:
                raise ValueError(f"{name} drives {', '.join(self.card['robots'])}, not {briefing.robot.name}")
        elif briefing.robot.name not in self.card["robots"]:
            raise ValueError(f"{name} drives {', '.join(self.card['robots'])}, not {briefing.robot.name}")
        elif not drives(self.card, briefing.robot):
            raise ValueError(f"{name} drives another {briefing.robot.name}: its data sheet has other numbers than this")
        if briefing.dt != self.card["dt"]:
            raise ValueError(f"{name} decides every {self.card['dt']:g} s, not every {briefing.dt:g} s")
        try:
            self.features.check(briefing)
        except ValueError as error:
            raise ValueError(f"{name} {error}") from None
        perception = self.perception(briefing)
        if perception.num_inputs != self.network.sizes[0]:
            raise ValueError(f"{name} has a network of {self.network.sizes[0]} inputs, not of {perception.num_inputs}")
        warning = out_of_distribution(self.card, briefing, self.speed)
        news = warning.partition(";")[0]  # the same of all seeds, whatever each of them was measured at
        if news and news not in _WARNED:
            _WARNED.add(news)
            warnings.warn(warning, NewToAgent, stacklevel=2)
        parts: dict[str, NDArray[Any]] = {"network": perception.fresh(briefing.num_envs)}
        if self.controller is not None:
            parts["base"] = self.controller.reset(briefing)
        if effective_actuators(self.card, briefing) is not briefing.actuators:
            parts["held"] = np.zeros((briefing.num_envs, 3, 3))  # see `hold`, and the twist that it gave last
        if self.features.shielded == "always" or (news and self.features.shielded):
            parts["shield"] = SHIELD.reset(briefing)
        if self.patience and self.features.posed:
            parts["rescue"] = waiting(briefing, self.speed)
        elif self.patience and self.features.observation is path_following.Observation:
            parts["rescue"] = np.zeros((briefing.num_envs, 2))  # see `drive_on`
        if self.keeps_pace:
            parts["pace"] = np.zeros((briefing.num_envs, 2))  # see `held_pace`
            parts["pace"][:, 0] = -briefing.dt * self.speed  # no time has passed when it is first asked
        if len(parts) == 1:
            return parts["network"]
        memory = np.empty(briefing.num_envs, [(name, each.dtype, each.shape[1:]) for name, each in parts.items()])
        for name, each in parts.items():
            memory[name] = each
        return memory

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        briefing = self._of_body(briefing)
        perception, robot = self.perception(briefing), briefing.robot
        speed = network_speed(self.card, briefing, self.speed)
        if isinstance(perception.features, RobotFeatures):
            speed = perception.features.speed_scale
        speeds = np.full(len(memory), speed)
        if self.keeps_pace:
            # what the mean on other paths was is nothing to go by
            uncruised = {**self.card, "cruises": {}}
            most = max([self.speed, *self.card.get("trained_on", {}).get("speeds", [])])
            low, high = (network_speed(uncruised, briefing, each) for each in (self.speed, most))
            late = held_pace(self.speed, memory["pace"], observation.twist, briefing.dt)
            speeds = np.clip(low + late / self.pace_time, 0.5 * low, high)
        requested = None
        own, measured = memory, observation
        actuators, held = effective_actuators(self.card, briefing), None
        if memory.dtype.names and "network" in memory.dtype.names:
            own = memory["network"]
        if actuators is not briefing.actuators:
            held = memory["held"]
            # as the slower base would measure it: at the end of the control period, not in its mean
            lead = (held[:, 1] - held[:, 2])[:, robot.twist_axes]
            observation = observation._replace(twist=observation.twist + lead)
        if self.controller is not None:
            under = memory["base"].copy()
            requested = asks(self.base, self.controller)(observation, briefing, under)
            memory["base"] = under
        features = perception.features
        limits = limits_of(features, actuators) if features.limits else None
        inputs, angles = perception.inputs(observation, speeds, own, requested, limits)
        actions = np.clip(self.network(inputs), -1.0, 1.0)
        perception.remember(inputs, actions, own)
        twists = commanded(perception.actions, self.base, actions, requested, speeds, angles, robot)
        if self.base is not None and self.base.guards:
            twists = self.controller.keep_clear(observation, briefing, twists)  # type: ignore[union-attr]
        tolerances = briefing.position_tolerance, briefing.heading_tolerance
        twists = features.arrived(observation, twists, speed, actuators, tolerances)
        twists = features.guarded(observation, twists, speed, actuators, eased=True)
        if held is not None:
            hold(*held_law(briefing, actuators), held, twists)
            held[:, 2, robot.twist_axes] = twists
        if "rescue" in (memory.dtype.names or ()):
            drives_by_law: Any = take_over if self.features.posed else drive_on
            rows = drives_by_law(measured, briefing, memory["rescue"], (self.speed, self.patience), twists)
            if held is not None:
                held[rows[:, None], :, np.array(robot.twist_axes)] = twists[rows, :, None]
        if "shield" in (memory.dtype.names or ()):
            twists = SHIELD.passed(measured, briefing, memory["shield"], twists)
            law: Any = self.controller
            if hasattr(law, "driven"):
                under = memory["base"].copy()
                law.driven(under, memory["shield"]["command"])
                memory["base"] = under
        return twists


_perception = functools.lru_cache(maxsize=64)(Perception)  # asked for with every decision
SHIELD = Shield()  # behind an agent that drives what it was not trained on
_WARNED: set[str] = set()  # of what this process has warned


def held_law(briefing: Briefing, slower: Actuators) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns what `hold` holds a base to that it drives as a slower one, and the base's wheel matrix (n, 3).

    What the base itself lags is taken off the slower one's lag.
    """
    robot, dt = briefing.robot, briefing.dt
    lag = lag_factors(slower.lag - briefing.actuators.lag, dt)
    limit = robot.rated_wheel_speed if slower.at_rated_speed else robot.peak_wheel_speed
    law = np.array([slower.acceleration, slower.yaw_acceleration, dt, *lag, limit, robot.turn_speed])
    return law, np.ascontiguousarray(robot.wheel_matrix)


def kind_of(card: Mapping[str, Any]) -> type[Features]:
    """Returns the class of the features of a card."""
    return SheetFeatures if any_robot(card) else features_kind(card["task"], card["features"])


def any_robot(card: Mapping[str, Any]) -> bool:
    """Returns whether an agent drives every base of a kinematic class, by its data sheet."""
    return "ranges" in (card.get("trained_on") or {})


def drives(card: Mapping[str, Any], robot: Robot) -> bool:
    """Returns whether an agent was trained with a robot: one that its card names, by the same data sheet.

    Cards without a digest of the sheet are for robots that ship.
    """
    if any_robot(card):
        return bool(len(robot.twist_axes) == card["network"]["num_twist"])
    if robot.name not in card["robots"]:
        return False
    shipped = ROBOTS.get(robot.name)
    known = card.get("sheets", {}).get(robot.name, shipped.digest if shipped else "")
    return bool(robot.digest == known)


@functools.lru_cache(maxsize=64)
def body_of(robot: Robot) -> Robot:
    """Returns the robot that ships of which a base with a response of its own has the body; else the base itself.

    Such a base differs from it in what is identified alone (`intervals.IDENTIFIED`), in saturation and response.
    """
    if not robot.responds:
        return robot
    identified = ("delay", "gain", "lag", "acceleration", "yaw_acceleration", "decelerations", "rated_wheel_speed")
    for each in ROBOTS.values():
        if each.drive != robot.drive or robot.hull_radius != each.hull_radius:
            continue
        own = {name: getattr(each, name) for name in (*identified, "peak_wheel_speed", "turn_speed", "saturation")}
        own |= {"response": each.response, "wheels": each.wheels, "track": each.track, "sources": {}}
        if dataclasses.replace(robot, **own).digest == each.digest:
            return each
    return robot


def asks(base: Base | None, controller: Any) -> Callable[..., NDArray[np.float64]]:
    """Returns what a base asks for: its controller's twists (b, t), or of one that guards the velocities it wants."""
    law: Callable[..., NDArray[np.float64]] = controller.wanted if base is not None and base.guards else controller.act
    return law


def commanded(
    meaning: Actions,
    base: Base | None,
    actions: NDArray[Any],
    requested: NDArray[np.float64] | None,
    speeds: NDArray[np.float64],
    angles: NDArray[np.float64],
    robot: Robot,
) -> NDArray[np.float64]:
    """Returns the twists (b, t) that actions (b, 2) command, with what a base asks for under them where there is one.

    With a base that guards, the velocities (b, 2) that are wanted.

    Args:
        asked: what the base `asks`.
        speeds: (b,) m/s, asked of the agent.
        angles: (b,) rad, of the frames of the actions.
    """
    if base is None or requested is None:
        return meaning.twists(actions, speeds, angles, robot)
    if base.guards:
        return meaning.wished(requested, actions, base.reach, speeds, angles)
    return meaning.added(requested, actions, base.reach, speeds, angles, robot)


def save_agent(
    folder: str | os.PathLike[str], layers: Sequence[tuple[NDArray[Any], NDArray[Any]]], card: Mapping[str, Any]
) -> None:
    """Writes an agent's folder: weights (outputs, inputs) and biases of its layers, and its card, signed.

    At any moment, a crash included, `load_agent` finds the agent that was there before, or this one.

    Raises:
        ValueError: if a weight or bias is not finite; what was there before still is.
        OSError: if a file cannot be written; what was there before still is.
    """
    from safetensors.numpy import save

    folder = pathlib.Path(folder)
    tensors = {}
    for k, pair in enumerate(layers):
        for part, array in zip(("weight", "bias"), pair, strict=True):
            tensors[f"layer_{k}.{part}"] = np.ascontiguousarray(array, np.float32)
            if not np.isfinite(tensors[f"layer_{k}.{part}"]).all():
                raise ValueError(f"{folder}: layer_{k}.{part} has numbers that are not finite; they are not saved")
    weights, text = save(tensors), (json.dumps(signed(card), indent=2) + "\n").encode()
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        new = temporary_folder(folder.parent)
        try:
            write_whole(new / WEIGHTS, weights)
            write_whole(new / CARD, text)
            new.chmod(folder.parent.stat().st_mode & 0o777)  # temporary folders are for their owner alone
            os.replace(new, folder)
            sync_folder(folder.parent)
        finally:
            shutil.rmtree(new, ignore_errors=True)
        return
    _settle(folder)
    write_whole(folder / _NEXT, weights)
    write_whole(folder / CARD, text)
    os.replace(folder / _NEXT, folder / WEIGHTS)
    sync_folder(folder)


def _settle(folder: pathlib.Path) -> None:
    """Puts the card's weights in their place if a crash has left them beside it."""
    if not (folder / _NEXT).exists():
        return
    with contextlib.suppress(ValueError):
        card = read_card(folder / CARD)
        _layers(folder / _NEXT, card, _sizes(card, folder / CARD))
        os.replace(folder / _NEXT, folder / WEIGHTS)


def signed(card: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a card of the present format with the SHA-256 of all that it says."""
    content = {"format": FORMAT, **{key: card[key] for key in card if key not in ("format", "digest")}}
    return content | {"digest": digest(content)}


def rounded(
    layers: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]],
) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Returns layers whose numbers have eight bits, as an agent is saved: the nearest bfloat16, of two the even one.

    A network drives no worse so, and takes half the room where it is packed; it computes in float32 as before.
    """
    return [(_nearest(weight), _nearest(bias)) for weight, bias in layers]


def _nearest(numbers: NDArray[np.float32]) -> NDArray[np.float32]:
    bits = np.ascontiguousarray(numbers, np.float32).view(np.uint32)
    up = 0x7FFF + (bits >> np.uint32(16) & np.uint32(1))
    nearest = (bits + up & np.uint32(0xFFFF0000)).view(np.float32)
    return np.where(np.isfinite(numbers), nearest, numbers).astype(np.float32)


def weights_digest(layers: Sequence[tuple[NDArray[Any], NDArray[Any]]]) -> str:
    """Returns the SHA-256 of weights and biases, by which a card knows them."""
    sha = hashlib.sha256()
    for weight, bias in layers:
        sha.update(np.ascontiguousarray(weight, "<f4").tobytes() + np.ascontiguousarray(bias, "<f4").tobytes())
    return sha.hexdigest()


def _shipped(folder: pathlib.Path, name: str = "goal_reaching_p3dx") -> None:
    home = pathlib.Path(__file__).parents[1] / "agents" / name / "seed_0"
    for file in (CARD, WEIGHTS):
        (folder / file).write_bytes((home / file).read_bytes())


@reader("agent's card", CARD, _shipped, of_folder)
@reader("agent's weights", WEIGHTS, _shipped, of_folder)
@reader("path agent's card", CARD, functools.partial(_shipped, name="path_following_p3dx"), of_folder)
def load_agent(folder: str | os.PathLike[str], **gains: Any) -> Agent:
    """Returns the agent of a folder; `speed` (m/s) may take the place of the one it was trained for.

    A path follower makes up what it is late by in PACE_TIME, and where one that docks makes no way for PATIENCE, or
    something moves, a law docks; `pace_time` and `patience` (s) may take their places.

    Only numbers and text are read: no code of the folder runs.

    Raises:
        ValueError: if a file is missing, damaged or of another kind, or the card is for an environment that this
            wayfield does not have; the message names the file.
    """
    folder = pathlib.Path(folder)
    card = read_card(folder / CARD)
    sizes = _sizes(card, folder / CARD)
    try:
        layers = _layers(folder / WEIGHTS, card, sizes)
    except ValueError as error:
        try:
            layers = _layers(folder / _NEXT, card, sizes)  # the card's own, of a save that was cut off
        except ValueError:
            raise error from None
    network = Network.of(layers, card["network"]["activation"])
    features, actions = card_features(card, folder / CARD)
    base = card_base(card, folder / CARD)
    try:
        gains = {"speed": card["speed"], "base": base, "pace_time": PACE_TIME, "patience": PATIENCE} | gains
        return Agent(network, features, actions, card, **gains)
    except ValueError as error:
        raise ValueError(f"{folder / CARD}: {error}") from None


def _sizes(card: Mapping[str, Any], file: pathlib.Path) -> list[int]:
    """Returns the numbers of inputs, hidden units and outputs of a card's network."""
    features, actions = card_features(card, file)
    based = card_base(card, file) is not None
    try:
        perception = Perception(features, actions, card["network"]["num_twist"], card["dt"], based)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    return [perception.num_inputs, *card["network"]["hidden"], actions.size]


def _layers(
    file: pathlib.Path, card: Mapping[str, Any], sizes: list[int]
) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Returns weights (outputs, inputs) and biases of a file, if they are those of a card."""
    tensors, _ = read_arrays(file)
    layers = []
    for k, (come, go) in enumerate(itertools.pairwise(sizes)):
        for part, shape in (("weight", (go, come)), ("bias", (go,))):
            tensor = tensors.pop(f"layer_{k}.{part}", None)
            if tensor is None:
                raise ValueError(f"{file} has no layer_{k}.{part}; it does not belong to {CARD}")
            if tensor.shape != shape or tensor.dtype != np.float32 or not (np.abs(tensor) <= _MOST_WEIGHT).all():
                raise ValueError(
                    f"{file}: layer_{k}.{part} must be finite float32 of shape {shape} by {CARD}, at most "
                    f"{_MOST_WEIGHT:g} in size, got "
                    f"{tensor.dtype} of shape {tensor.shape}"
                )
            layers.append(tensor)
    if tensors:
        raise ValueError(f"{file} also holds {', '.join(sorted(tensors))}; it does not belong to {CARD}")
    pairs = list(zip(layers[::2], layers[1::2], strict=True))
    if weights_digest(pairs) != card["sha256"]:
        raise ValueError(f"{file} holds other weights than {CARD} was written for: their SHA-256 differs")
    return pairs


def card_base(card: Mapping[str, Any], file: pathlib.Path) -> Base | None:
    """Returns the controller that a card's agent adds to; None for one that drives by itself.

    Raises:
        ValueError: naming the file, if it is no controller of this wayfield with gains of its own.
    """
    if card.get("base") is None:
        return None
    try:
        base = Base(**card["base"])
        if kind_of(card).observation not in base.policy(1.0).observes:
            raise ValueError(f"controller {base.controller!r} does not read observations of {card['task']}")
        return base
    except (TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise ValueError(f"{file}: base is {shown(card['base'])}: {str(error)[:500]}") from None


def card_features(card: Mapping[str, Any], file: pathlib.Path) -> tuple[Features, Actions]:
    """Returns the features and actions that a card describes.

    Raises:
        ValueError: naming the file, if a value of theirs is of the wrong kind or out of range.
    """
    trails = card["features"]["trails"]
    try:
        trails = tuple(trails) if isinstance(trails, list) else trails
        kind = kind_of(card)
        return kind(**card["features"] | {"trails": trails}), Actions(**card["actions"])
    except ValueError as error:
        raise ValueError(f"{file}: {str(error)[:500]}") from None


_CARD_KINDS = {
    "env_id": str, "robots": list, "task": str, "dt": float, "speed": float, "features": dict, "actions": dict,
    "network": dict, "sha256": str, "training": dict, "env_kwargs": dict,
}  # fmt: skip


def read_card(file: pathlib.Path) -> dict[str, Any]:
    """Returns an agent's card, checked.

    Raises:
        ValueError: naming the file and what is wrong with it.
    """
    if not file.exists():
        raise ValueError(
            f"{file} cannot be read: {unread(file, FileNotFoundError())}; an agent is a folder with {CARD}"
        )
    card = read_object(file)
    if "format" not in card:
        raise ValueError(f"{file} is not the card of an agent: it has no format")
    if not is_whole(card["format"], 1, FORMAT):
        raise ValueError(f"{file} has format {shown(card['format'])}; this wayfield reads formats up to {FORMAT}")
    if "digest" in card or card["format"] > 1:
        try:
            own = digest({key: value for key, value in card.items() if key != "digest"})
        except (RecursionError, ValueError) as error:
            raise ValueError(f"{file} cannot be checked: {error}") from None
        if card.get("digest") != own:
            raise ValueError(f"{file} is damaged or was changed by hand: its digest differs from what it says")
    card.setdefault("env_kwargs", {})  # early cards have none
    for key, kind in _CARD_KINDS.items():
        if not isinstance(card.get(key), kind):
            raise ValueError(f"{file}: {key} must be a {kind.__name__}, got {shown(card.get(key))}")
    for key, most in (("dt", LONGEST), ("speed", MOST_GAIN)):
        if not 0.0 < card[key] <= most:
            raise ValueError(f"{file}: {key} must be a number > 0 and <= {most:g}, got {card[key]!r}")
    if not card["robots"] or not all(isinstance(each, str) for each in card["robots"]):
        raise ValueError(f"{file}: robots must be names, got {shown(card['robots'])}")
    sheets = card.get("sheets", {})
    if not isinstance(sheets, dict) or not all(isinstance(each, str) for each in sheets.values()):
        raise ValueError(f"{file}: sheets must map robots to digests, got {shown(sheets)}")
    if card["env_id"] not in gymnasium.registry:
        ours = sorted(each for each in gymnasium.registry if each.startswith("wayfield/"))
        raise ValueError(
            f"{file}: env_id is {shown(card['env_id'])}, which this wayfield does not have; it has {', '.join(ours)}"
        )
    try:
        check_conditions(card)
        check_described(card)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    if card["task"] not in FEATURES:
        raise ValueError(f"{file}: task {shown(card['task'])} is none of {', '.join(FEATURES)}")
    if card["format"] < FORMAT:
        card["features"] = {**_SINCE.get(card["task"], {}), **card["features"]}
        card["actions"] = {**_ACTIONS_SINCE, **card["actions"]}
    for key, kind in (("features", kind_of(card)), ("actions", Actions)):
        names = {field.name for field in dataclasses.fields(kind)}
        if set(card[key]) != names:
            odd = ", ".join(sorted(set(card[key]) ^ names))
            raise ValueError(f"{file}: {key} must have exactly {', '.join(sorted(names))}; not so: {odd}")
    if not is_whole(card["training"].get("steps"), 0, 2**63 - 1):
        raise ValueError(f"{file}: training.steps must be a whole number, got {shown(card['training'].get('steps'))}")
    network = card["network"]
    hidden = network.get("hidden")
    if not isinstance(hidden, list):
        raise ValueError(f"{file}: network.hidden must be a list of whole numbers, got {shown(hidden)}")
    try:
        check_hidden(hidden)
    except ValueError as error:
        raise ValueError(f"{file}: network.{error}") from None
    if not is_whole(network.get("num_twist"), 2, 3):
        raise ValueError(f"{file}: network.num_twist must be 2 or 3, got {shown(network.get('num_twist'))}")
    if network.get("activation") not in ACTIVATIONS:
        got = shown(network.get("activation"))
        raise ValueError(f"{file}: network.activation must be {' or '.join(ACTIVATIONS)}, got {got}")
    return card


def check_hidden(hidden: Sequence[int]) -> None:
    """Raises ValueError, naming the sizes, unless they are hidden layers that a network may have."""
    if len(hidden) > MOST_LAYERS or not all(is_whole(n, 1, MOST_WIDTH) for n in hidden):
        raise ValueError(
            f"hidden must be at most {MOST_LAYERS} whole numbers from 1 to {MOST_WIDTH}, got {shown(hidden)}"
        )
