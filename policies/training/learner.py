"""stable-baselines3's algorithms on a preset's worlds, with their state as plain arrays and numbers; PPO here."""

import abc
import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from wayfield.envs.robots import robot_of
from wayfield.envs.sb3 import NativeVecEnv
from wayfield.envs.scenarios import field_scenarios
from wayfield.envs.tasks.specs import EVERY
from wayfield.policies.learned.agent import Agent
from wayfield.policies.learned.features_sheet import SheetFeatures
from wayfield.policies.learned.perception import Features, Perception, features_for
from wayfield.policies.trained.ppo import shipped_agent
from wayfield.policies.training.drawn import further
from wayfield.policies.training.imitation import Teaching
from wayfield.policies.training.presets import Ppo, Preset, Worlds
from wayfield.policies.training.proximal import Proximal
from wayfield.policies.training.shaping import Shaped

MOST_INPUTS = 2**29  # numbers of what is kept to learn from: 2 GiB
Layers = list[tuple[NDArray[np.float32], NDArray[np.float32]]]


class _Nothing(BaseCallback):
    """A callback that does nothing: `Learner.update` runs an algorithm's two halves itself."""

    def _on_step(self) -> bool:
        return True


class Learner(abc.ABC):
    """One update at a time, so that a run can stop between any two; `state` and `restore` go round exactly."""

    LOGGED: ClassVar[tuple[str, ...]]  # of the algorithm's numbers of an update, those that the learning curve has

    def __init__(self, preset: Preset, env_id: str, seed: int) -> None:
        self.preset = preset
        self.seed = seed
        self.teaching: Teaching | None = None  # while it is not over
        self.seconds = dict.fromkeys(("imitation", "environment", "rollout policy", "update", "validation"), 0.0)
        self.env = make_worlds(preset, env_id)
        frames, named = self._retained()
        inputs = frames * self.env.perception.num_inputs
        if inputs > MOST_INPUTS:
            raise ValueError(f"{named} x inputs is {inputs}; that is kept in memory, at most {MOST_INPUTS} numbers")
        self.env.seed(seed)
        self._timed = Timed(self.env, self.seconds)
        self._make()
        self.model.set_logger(Logger(None, []))
        _, self._callback = self.model._setup_learn(preset.learning.steps, _Nothing())

    @property
    @abc.abstractmethod
    def model(self) -> PPO | SAC:
        """Returns the algorithm."""

    @abc.abstractmethod
    def _make(self) -> None:
        """Makes the algorithm."""

    @abc.abstractmethod
    def _retained(self) -> tuple[int, str]:
        """Returns how many inputs of a network are kept to learn from, and what that is the product of."""

    @abc.abstractmethod
    def _collect(self) -> float:
        """Drives for the control periods between two updates; returns the mean reward."""

    @abc.abstractmethod
    def _learn(self) -> None:
        """Learns from what was collected."""

    @abc.abstractmethod
    def layers(self) -> Layers:
        """Returns weights (outputs, inputs) and biases of the policy's mean, layer after layer."""

    @abc.abstractmethod
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """Returns the optimizers by the name that they have in a state."""

    def teach(self) -> Iterator[int]:
        """Runs the imitation of the preset from where it is, and yields the frames seen so far; nothing without one."""
        yield from ()

    @property
    def frames(self) -> int:
        """Returns how many frames were seen."""
        return self.model.num_timesteps if self.teaching is None else self.teaching.frames

    def update(self) -> dict[str, float]:
        """Collects once and learns from it; returns what the algorithm logs, and the reward.

        Raises:
            FloatingPointError: if the policy's numbers are no longer finite.
        """
        self.env.share = self.frames / self.preset.learning.steps
        began = time.perf_counter()
        inside = self.seconds["environment"]
        reward = self._collect()
        middle = time.perf_counter()
        self.seconds["rollout policy"] += middle - began - (self.seconds["environment"] - inside)
        self.model._update_current_progress_remaining(self.frames, self.preset.learning.steps)
        try:
            self._learn()
        except ValueError:  # torch refuses to make a distribution of what is not finite
            self.check_finite()
            raise self._diverged("the spread of its actions") from None
        self.check_finite()
        self.seconds["update"] += time.perf_counter() - middle
        logged = {key.removeprefix("train/"): float(value) for key, value in self.model.logger.name_to_value.items()}
        self.model.logger.name_to_value.clear()
        return {"reward": reward / (1.0 - self.preset.learning.discount), **logged}

    def check_finite(self) -> None:
        """Raises FloatingPointError unless all numbers of the policy, its critics included, are finite."""
        for name, tensor in self.model.policy.state_dict().items():
            if not torch.isfinite(tensor).all():
                raise self._diverged(name)

    def _diverged(self, name: str) -> FloatingPointError:
        """Returns the error of a policy with a number, or numbers, of that name that are not finite."""
        return FloatingPointError(
            f"the training diverged: {name} is not finite after {self.frames} frames; a lower learning_rate "
            f"{self.MILDER}may help; what was saved before stands"
        )

    MILDER: ClassVar[str] = ""  # what else may keep numbers finite

    def state(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns all that decides how the run goes on: arrays, and numbers and text that JSON keeps exactly."""
        arrays = {f"policy.{name}": tensor.numpy().copy() for name, tensor in self.model.policy.state_dict().items()}
        for optimizer, each in self.optimizers().items():
            for k, moments in each.state_dict()["state"].items():
                arrays |= {f"{optimizer}.{k}.{name}": np.asarray(tensor).copy() for name, tensor in moments.items()}
        kind, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002  the one that stable-baselines3 draws from
        assert kind == "MT19937"
        arrays["random.torch"] = torch.get_rng_state().numpy().copy()
        arrays["random.numpy"] = np.asarray(keys)
        arrays["last_episode_starts"] = np.asarray(self.model._last_episode_starts).astype(np.uint8)
        numbers = {
            "frames": self.frames,
            "updates": self.model._n_updates,
            "random.numpy": [int(rest[0]), int(rest[1]), float(rest[2])],
            "generators": self.env.generators(),
        }
        if self.teaching is not None:
            arrays, numbers = arrays | self.teaching.arrays(), numbers | {"teaching": self.teaching.numbers()}
        return arrays | self.env.arrays(), numbers

    def restore(self, arrays: Mapping[str, NDArray[Any]], numbers: Mapping[str, Any]) -> None:
        """Puts the run back to where `state` was taken."""
        if "teaching" not in numbers:
            self.teaching = None
        self.model.policy.load_state_dict(
            {
                name.removeprefix("policy."): torch.from_numpy(array.copy())
                for name, array in arrays.items()
                if name.startswith("policy.")
            }
        )
        for name, optimizer in self.optimizers().items():
            moments: dict[int, dict[str, torch.Tensor]] = {}
            for key, array in arrays.items():
                if key.startswith(f"{name}."):
                    _, k, part = key.split(".")
                    moments.setdefault(int(k), {})[part] = torch.from_numpy(array.copy())
            optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
        self.env.restore(arrays, list(numbers["generators"]))
        self.model._last_obs = self.env.seen
        self.model._last_episode_starts = arrays["last_episode_starts"].astype(bool)
        self.model.num_timesteps = int(numbers["frames"])
        self.model._n_updates = int(numbers["updates"])
        torch.set_rng_state(torch.from_numpy(arrays["random.torch"].copy()))
        position, has_gauss, gauss = numbers["random.numpy"]
        np.random.set_state(("MT19937", arrays["random.numpy"], position, has_gauss, gauss))  # noqa: NPY002
        if self.teaching is not None:
            self.teaching.restore(arrays, numbers["teaching"])


class PpoLearner(Learner):
    """PPO: an update is a rollout and some passes over it."""

    LOGGED = ("approx_kl", "std", "explained_variance")
    MILDER = "or max_grad_norm "

    def __init__(self, preset: Preset, env_id: str, seed: int) -> None:
        # before worlds, which take long
        self.begins_as = agent_to_begin_as(preset, seed) if preset.prior.begins else None
        super().__init__(preset, env_id, seed)

    @property
    def model(self) -> PPO:
        """Returns the algorithm."""
        return self.ppo

    def _make(self) -> None:
        preset, learning, prior = self.preset, self.preset.learning, self.preset.prior
        own = learning.algorithm
        assert isinstance(own, Ppo)
        self.ppo = Proximal(
            "MlpPolicy",
            self._timed,
            learning_rate=anneal(learning.learning_rate, learning.final_learning_rate),
            n_steps=learning.horizon,
            batch_size=min(learning.batch_size, preset.frames_per_update),
            n_epochs=own.epochs,
            gamma=learning.discount,
            gae_lambda=own.gae_lambda,
            clip_range=anneal(own.clip, own.final_clip),
            ent_coef=own.entropy,
            max_grad_norm=own.max_grad_norm,
            target_kl=own.target_kl,
            policy_kwargs={
                "net_arch": {"pi": list(learning.hidden), "vf": list(learning.hidden)},
                "activation_fn": {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[learning.activation],
                "log_std_init": own.log_std,
            },
            seed=self.seed,
            device="cpu",
            verbose=0,
        )
        if self.begins_as is not None:
            with torch.no_grad():
                mean = linear(mean_of(self.ppo.policy))
                for module, (weight, bias) in zip(mean, self.begins_as.network.layers, strict=True):
                    module.weight.copy_(torch.from_numpy(weight.copy()))
                    module.bias.copy_(torch.from_numpy(bias.copy()))
        if prior.imitation:
            numbers = prior.imitation, prior.imitation_rate, self.seed, prior.lessons
            self.teaching = Teaching(self.ppo, self.env, None if prior.begins else preset.controller_at, *numbers)

    def _retained(self) -> tuple[int, str]:
        return self.preset.frames_per_update, "num_envs x horizon"

    def teach(self) -> Iterator[int]:
        """Runs the imitation of the preset from where it is, and yields the frames seen so far."""
        if self.teaching is None:
            return
        seconds = self._timed.seconds
        self._timed.seconds = dict(seconds)  # the environment's part of the imitation counts as imitation
        before, began = self.seconds["imitation"], time.perf_counter()
        for frames in self.teaching.run():
            self.seconds["imitation"] = before + time.perf_counter() - began
            yield frames
        self._timed.seconds = seconds
        frames, self.teaching = self.teaching.frames, None
        _, self._callback = self.ppo._setup_learn(self.preset.learning.steps, _Nothing())
        self.ppo.num_timesteps = frames

    def _collect(self) -> float:
        self.ppo.collect_rollouts(self._timed, self._callback, self.ppo.rollout_buffer, self.ppo.n_steps)
        return float(self.ppo.rollout_buffer.rewards.mean())

    def _learn(self) -> None:
        self.ppo.train()

    def layers(self) -> Layers:
        """Returns weights (outputs, inputs) and biases of the policy's mean, layer after layer."""
        return layers_of(mean_of(self.ppo.policy))

    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """Returns the only one, and those of a teaching that is not over."""
        return {"optimizer": self.ppo.policy.optimizer} | ({} if self.teaching is None else self.teaching.optimizers)


class Timed(VecEnvWrapper):
    """Passes everything on and counts the seconds that steps take."""

    def __init__(self, env: VecEnv, seconds: dict[str, float]) -> None:
        self.seconds = seconds
        super().__init__(env)

    def reset(self) -> Any:
        """Passes on."""
        return self.venv.reset()

    def step_wait(self) -> Any:
        """Passes on, and counts."""
        began = time.perf_counter()
        result = self.venv.step_wait()
        self.seconds["environment"] += time.perf_counter() - began
        return result


def agent_to_begin_as(preset: Preset, seed: int) -> Agent:
    """Returns the agent whose weights a policy's mean gets.

    Raises:
        ValueError: if none of this seed ships, or it sees, does or is something else than the preset's.
    """
    agent = shipped_agent(preset.prior.begins, str(preset.worlds.robot), seed)
    network = agent.network
    if type(preset.features) is not type(agent.features):
        raise ValueError(
            f"begins is {preset.prior.begins!r}, whose agents see something else than those of {preset.name}"
        )
    pairs: dict[str, tuple[object, object]] = {
        "hidden": (list(preset.learning.hidden), network.sizes[1:-1].tolist()),
        "activation": (preset.learning.activation, network.activation),
    }
    for part in ("features", "actions"):
        mine, its = (dataclasses.asdict(getattr(each, part)) for each in (preset, agent))
        pairs |= {f"{part}.{name}": (value, its[name]) for name, value in mine.items()}
    for name, (value, wanted) in pairs.items():
        if value != wanted:
            raise ValueError(f"{name} must be {wanted}, as of the agent that the network begins as, got {value}")
    return agent


def make_worlds(preset: Preset, env_id: str) -> Shaped:
    """Returns the worlds of a preset, shaped for its learner."""
    here, limit = preset.worlds, {"max_episode_steps": round(preset.worlds.size * preset.worlds.time_limit)}
    any_robot = isinstance(preset.features, SheetFeatures)
    parts = [(count, {**limit, **_with_further(here, kwargs)}) for count, kwargs, _ in preset.parts]
    worlds = NativeVecEnv(env_id, parts, any_robot)
    robot_kind, dt = worlds.task.robot, worlds.task.options.dt
    if preset.actions.kind == "planar" and not robot_kind.holonomic and not preset.prior.guards:
        raise ValueError(f"actions.kind must be unicycle with {robot_kind.name!r}, which cannot go sideways")
    ways = None
    if here.shortest_ways:
        from wayfield.policies.training.ways import WAYS

        ways = WAYS[here.task](worlds)
    paces = [pace for _, _, pace in preset.parts]
    features: list[Features] = [preset.features]
    if any_robot:
        briefings = [part.briefing("sensors") for part in worlds.parts]
        features = [features_for(preset.features, each, pace) for each, pace in zip(briefings, paces, strict=True)]
    perceptions = [
        Perception(each, preset.actions.of(each), len(robot_kind.twist_axes), dt, preset.base is not None)
        for each in features
    ]
    discount = preset.learning.discount
    return Shaped(worlds, perceptions, preset.reward, paces, discount, ways, preset.base, here.arriving)


def _with_further(here: Worlds, kwargs: Mapping[str, Any]) -> Mapping[str, Any]:
    """Returns the keyword arguments of worlds, with the scenarios that are drawn beside a training split."""
    if not here.further or not (family := here.family_of(kwargs)):
        return kwargs
    hull = robot_of(here.robot or "p3dx").hull_radius
    frozen = field_scenarios(EVERY[here.task], kwargs["scenario"], hull)
    return {**kwargs, "scenario": [*frozen, *further(here.task, family, hull, here.further)]}


def mean_of(policy: Any) -> list[torch.nn.Module]:
    """Returns the modules of a policy's mean, layer after layer."""
    return [*policy.mlp_extractor.policy_net, policy.action_net]


def linear(modules: Iterable[torch.nn.Module]) -> list[torch.nn.Linear]:
    """Returns the linear ones of modules."""
    return [each for each in modules if isinstance(each, torch.nn.Linear)]


def layers_of(modules: Iterable[torch.nn.Module]) -> Layers:
    """Returns weights (outputs, inputs) and biases of the linear ones of modules."""
    return [(each.weight.detach().numpy().copy(), each.bias.detach().numpy().copy()) for each in linear(modules)]


def anneal(first: float, last: float) -> Callable[[float], float]:
    """Returns the line from `first` at the start of a run to `last` at its end."""
    return lambda remaining: last + (first - last) * max(remaining, 0.0)
