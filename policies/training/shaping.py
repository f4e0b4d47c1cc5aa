"""What a learner sees of the worlds: features, a shaped reward, and a requested speed."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from wayfield.envs.sb3 import NativeVecEnv
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.agent import SHIELD, asks, commanded
from wayfield.policies.learned.perception import Perception, limits_of
from wayfield.policies.learned.residual import Base
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.policy import Policy
from wayfield.policies.pilot import Pilot

Array = NDArray[np.float64]
Infos = Mapping[str, NDArray[Any]]  # of b robots, by name


@dataclasses.dataclass(frozen=True)
class PathReward(Gains):
    """Reward of a step along a path, with progress ds, cross-track error e, asked speed u and actions a:

        ds / (u dt) (1 - strictness error_cost |e|) - strictness error_rate |e| - jerk_cost |a - a'|^2
        - chatter_cost |a - 2 a' + a''|^2 - stall_cost clip(1 - ds / (stall_share u dt), 0, 1) - failure [left corridor]

    a' and a'' are the actions before: a twist that changes steadily, as into a bend, costs nothing by `chatter_cost`.

    So an error costs by the metre that is driven with it, as in the tables: a robot beside its path does best to get
    back before it goes on. The true error is meant, whatever the robot measures. The strictness grows from `leniency`
    to 1 over the first half of a run. Standing still costs more than any corner at first, for a robot that has once
    learned to stand before corners rarely unlearns it; the cost falls to `final_stall_cost` over the run, for a robot
    that turns towards its path before it goes on hardly moves along it. Where errors cost so much that the best corner
    is worth less than standing still, runs collapse late.
    """

    error_cost: float = gain(80.0, "1/m", "of progress that is driven beside the path")
    error_rate: float = gain(15.0, "1/m", "of being beside it")
    leniency: float = gain(0.2, "1", "share of the strictness that a run begins with")
    jerk_cost: float = gain(0.02, "1", "of changes of the action, squared")
    chatter_cost: float = gain(0.0, "1", "of changes of those changes, squared")
    stall_cost: float = gain(2.0, "1", "of standing still, at the start")
    final_stall_cost: float = gain(0.2, "1", "at the end")
    stall_share: float = gain(0.2, "1", "of the asked speed, under which a robot stalls", above=0.0)
    failure: float = gain(50.0, "1", "of leaving the corridor")

    def __call__(self, info: Infos, speeds: Array, changes: NDArray[Any], dt: float, share: float) -> Array:
        """Returns the rewards (b,); changes (2, b): see `changes_of`; share: of the run that is over."""
        e = (self.leniency + (1.0 - self.leniency) * min(2.0 * share, 1.0)) * np.abs(info["cross_track_error"])
        pace = info["progress"] / (speeds * dt)
        stalled = np.clip(1.0 - pace / self.stall_share, 0.0, 1.0)
        stall_cost = self.stall_cost + share * (self.final_stall_cost - self.stall_cost)
        reward = pace * (1.0 - self.error_cost * e) - self.error_rate * e - stall_cost * stalled
        reward -= self.jerk_cost * changes[0] + self.chatter_cost * changes[1]
        return np.asarray(reward - self.failure * info["left_corridor"])


@dataclasses.dataclass(frozen=True)
class ReferenceReward(Gains):
    """Reward of a step behind a reference, with the distance d from it and actions a:

        1 / (1 + (d / error_scale)^2) + fine_share / (1 + (d / fine_scale)^2) - jerk_cost |a - a'|^2
        - failure [left tube]

    The first term leads there from afar, the second on to a millimetre. It is the bounded reward of the environment
    with a second scale.
    """

    error_scale: float = gain(0.05, "m", "of the distance that halves the first term", above=0.0)
    fine_share: float = gain(0.5, "1", "of the second term")
    fine_scale: float = gain(0.005, "m", "of the distance that halves it", above=0.0)
    jerk_cost: float = gain(0.02, "1", "of changes of the action, squared")
    failure: float = gain(10.0, "1", "of leaving the tube")

    def __call__(self, info: Infos, speeds: Array, changes: NDArray[Any], dt: float, share: float) -> Array:
        """Returns the rewards (b,); changes (2, b): see `changes_of`; share: of the run that is over."""
        del speeds, dt, share
        coarse, fine = (
            1.0 / (1.0 + (info["position_error"] / each) ** 2) for each in (self.error_scale, self.fine_scale)
        )
        reward = coarse + self.fine_share * fine - self.jerk_cost * changes[0]
        return np.asarray(reward - self.failure * info["left_corridor"])


@dataclasses.dataclass(frozen=True)
class GoalReward(Gains):
    """Reward of a step towards a goal, with progress ds (on the shortest way, where the map is known to the teacher):

    ds / (u dt) - time_cost - near_cost max(0, 1 - clearance/near)^2 - jerk_cost |a - a_before|^2
    + success [arrived] - collision [touched]
    """

    time_cost: float = gain(0.2, "1", "of a step")
    near_cost: float = gain(0.5, "1", "of being near an obstacle")
    near: float = gain(0.05, "m", "what is near", above=0.0)
    jerk_cost: float = gain(0.02, "1", "of changes of the action, squared")
    success: float = gain(20.0, "1", "of arriving")
    collision: float = gain(60.0, "1", "of touching")

    def __call__(self, info: Infos, speeds: Array, changes: NDArray[Any], dt: float, share: float) -> Array:
        """Returns the rewards (b,); changes (2, b): see `changes_of`; share: of the run that is over."""
        del share
        closeness = np.clip(1.0 - info["clearance"] / self.near, 0.0, 1.0)
        reward = info["progress"] / (speeds * dt) - self.time_cost - self.near_cost * closeness * closeness
        reward -= self.jerk_cost * changes[0]
        return np.asarray(reward + self.success * info["success"] - self.collision * info["collision"])


@dataclasses.dataclass(frozen=True)
class TeamReward(GoalReward):
    """Reward of a step towards a goal among bodies: a goal seeker's, near what stands or a body, whichever is nearer.

    Each robot is rewarded for its own way alone.
    """

    time_cost: float = gain(0.7, "1", "of a step")
    near_cost: float = gain(1.0, "1", "of being near an obstacle or a body")
    near: float = gain(0.1, "m", "what is near", above=0.0)
    success: float = gain(60.0, "1", "of arriving")
    collision: float = gain(150.0, "1", "of touching")

    def __call__(self, info: Infos, speeds: Array, changes: NDArray[Any], dt: float, share: float) -> Array:
        """Returns the rewards (b,); changes (2, b): see `changes_of`; share: of the run that is over."""
        nearer = np.minimum(info["clearance"], info["gap"])
        return super().__call__({**info, "clearance": nearer}, speeds, changes, dt, share)


Reward = PathReward | ReferenceReward | GoalReward


def changes_of(actions: NDArray[Any], before: NDArray[Any]) -> NDArray[Any]:
    """Returns |a - a'|^2 and |a - 2 a' + a''|^2 (2, b) of actions (b, 2) and those before (b, n, 2), newest first.

    What goes farther back than what is remembered counts as nothing.
    """
    first = actions - before[:, 0] if before.shape[1] > 0 else np.zeros_like(actions)
    second = first - (before[:, 0] - before[:, 1]) if before.shape[1] > 1 else np.zeros_like(actions)
    return np.stack([np.square(first).sum(axis=1), np.square(second).sum(axis=1)])


class Shaped(VecEnv):
    """The worlds as the learner meets them: inputs of the network in, actions in [-1, 1] out.

    Args:
        perceptions: of the worlds' parts; one for all, or one for each, which have the same inputs.
        paces: m/s, the speed that is asked for in each of the worlds' parts.
        discount: the learner's gamma; rewards are multiplied by 1 - gamma, so that values are of order one.
        ways: returns the way left (b,), m, whose shortening is the progress; None takes what the worlds tell.
        base: a controller that the network adds to.
        arriving: whether the law that ends the way, `GoalFeatures.arrived`, does so here too.
    """

    def __init__(
        self,
        worlds: NativeVecEnv,
        perceptions: Sequence[Perception],
        reward: Reward,
        paces: Sequence[float],
        discount: float,
        ways: Callable[[NativeVecEnv], Array] | None = None,
        base: Base | None = None,
        arriving: bool = False,
    ) -> None:
        self.worlds = worlds
        self.perceptions = perceptions
        self.perception = perception = perceptions[0]
        self.reward = reward
        self.paces = paces
        self.base = base
        self.arriving = arriving
        self.pilots: list[Pilot] = []
        self.scale = 1.0 - discount
        self.ways = ways
        self.share = 0.0  # of the run that is over
        self.dt = worlds.task.options.dt
        self.robot = worlds.task.robot
        self.memory = perception.fresh(worlds.num_envs)
        self.speeds = np.repeat(paces, [part.num_envs for part in worlds.parts])
        one = len(perceptions) == 1
        self.seen_to = [slice(0, worlds.num_envs)] if one else worlds.rows  # the rows that each perception sees to
        self.of_parts = list(perceptions) * (len(worlds.parts) if one else 1)
        self.shields: list[NDArray[Any]] = []  # what they remember, of each part; none: there are none
        self.briefings: list[Briefing] = [part.briefing("sensors") for part in worlds.parts]
        limits = [
            limits_of(each.features, part.task.options.actuators)
            for each, part in zip(self.of_parts, worlds.parts, strict=True)
        ]
        self.limits = np.repeat(limits, [part.num_envs for part in worlds.parts], axis=0)
        self.left = np.zeros(worlds.num_envs)  # m, of the way to the goal
        self.observations = np.empty(0, np.float32)  # of the environment, as they are
        self._inputs = np.empty(0, np.float32)
        self._angles = np.empty(0)
        self._twists: Array | None = None  # twists (b, t) of the base
        self._actions = np.empty(0)
        width = perception.num_inputs
        super().__init__(
            worlds.num_envs,
            gymnasium.spaces.Box(-np.inf, np.inf, (width,), np.float32),
            gymnasium.spaces.Box(-1.0, 1.0, (perception.actions.size,), np.float32),
        )

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Seeds the worlds' rows seed, seed + 1, ..."""
        return list(self.worlds.seed(seed))

    def reset(self) -> NDArray[np.float32]:
        """Starts an episode in every row."""
        observations = self.worlds.reset()
        self.memory = self.perception.fresh(self.num_envs)
        if self.base is not None:
            self.pilots = self.make_pilots(self.base.policy)
        self._shield()
        if self.ways is not None:
            self.left = self.ways(self.worlds)
        self._see(observations)
        return self._inputs

    def _shield(self) -> None:
        """Makes the shields behind features that are never without one."""
        if getattr(self.perception.features, "shielded", False) == "always":
            self.briefings = [part.briefing("sensors") for part in self.worlds.parts]
            self.shields = [SHIELD.reset(each) for each in self.briefings]

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the actions of the next step."""
        self._actions = np.clip(actions, -1.0, 1.0)

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Moves every robot by one control period; see `NativeVecEnv.step_wait`."""
        actions = self._actions
        perception = self.perception
        changes = changes_of(actions, self.memory["actions"])
        twists = np.concatenate(
            [
                commanded(
                    each.actions, self.base, actions[rows], None if self._twists is None else self._twists[rows],
                    self.speeds[rows], self._angles[rows], self.robot,
                )
                for each, rows in zip(self.perceptions, self.seen_to, strict=True)
            ]
        )  # fmt: skip
        guards = self.base is not None and self.base.guards
        wanted = twists
        if guards:
            twists = np.empty((self.num_envs, len(self.robot.twist_axes)))
        for k, (part, mine, pace) in enumerate(zip(self.worlds.parts, self.worlds.rows, self.paces, strict=True)):
            seen = self._fields(self.observations[mine], k)
            actuators, features = part.task.options.actuators, self.of_parts[k].features
            if guards:
                pilot: Any = self.pilots[k]
                twists[mine] = pilot.policy.keep_clear(seen, pilot.briefing, wanted[mine])
            if self.arriving:
                twists[mine] = features.arrived(seen, twists[mine], pace, actuators)
            twists[mine] = features.guarded(seen, twists[mine], pace, actuators)
            if self.shields:
                twists[mine] = SHIELD.passed(seen, self.briefings[k], self.shields[k], twists[mine])
                law: Any = None if self.base is None else self.pilots[k].policy
                if hasattr(law, "driven"):
                    law.driven(self.pilots[k].memory, self.shields[k]["command"])
        observations, _, terminated, truncated, info = self.worlds.advance(twists)
        ended = terminated | truncated
        rows = np.flatnonzero(ended)
        if self.ways is not None:
            left = self.ways(self.worlds)
            info = info | {"progress": np.where(ended, np.minimum(info["progress"], 0.1), self.left - left)}
            self.left = left
        rewards = self.scale * self.reward(info, self.speeds, changes, self.dt, self.share)
        perception.remember(self._inputs, actions, self.memory)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if len(rows):
            # the base's command there is not known: it has the briefing of the next episode
            last = self._last(rows)
            for j, i in enumerate(rows.tolist()):
                late = bool(truncated[i] and not terminated[i])
                infos[i] = {"terminal_observation": last[j], "TimeLimit.truncated": late}
            self.memory[rows] = perception.fresh(len(rows))
            self.tell(self.pilots, ended)
            for shield, mine in zip(self.shields, self.worlds.rows, strict=False):
                shield[ended[mine]] = np.zeros(1, shield.dtype)
        self._see(observations)
        return self._inputs, rewards.astype(np.float32), ended, infos

    def make_pilots(self, policy: Callable[[float], Policy]) -> list[Pilot]:
        """Returns the pilots of the worlds' parts, ready to act: of policies that have a part's pace."""
        pilots = []
        for part, pace in zip(self.worlds.parts, self.paces, strict=True):
            pilots.append(Pilot(policy(pace), part))
            pilots[-1].reset()
        return pilots

    def ask(self, pilots: Sequence[Pilot]) -> Array:
        """Returns the twists (b, t) that pilots of the parts ask for, or the velocities of a base that guards."""
        if self.base is not None and self.base.guards:
            seen = [self._fields(self.observations[rows], k) for k, rows in enumerate(self.worlds.rows)]
            return np.concatenate(
                [
                    asks(self.base, pilot.policy)(fields, pilot.briefing, pilot.memory)
                    for pilot, fields in zip(pilots, seen, strict=True)
                ]
            )
        return np.concatenate(
            [
                pilot.command(self.observations[rows][:, : pilot.briefing.layout.size])
                for pilot, rows in zip(pilots, self.worlds.rows, strict=True)
            ]
        )

    def tell(self, pilots: Sequence[Pilot], ended: NDArray[np.bool_]) -> None:
        """Resets the pilots of the parts for the robots (b,) whose episode has ended."""
        for pilot, rows in zip(pilots, self.worlds.rows, strict=False):
            if ended[rows].any():
                pilot.reset(np.flatnonzero(ended[rows]))

    def _fields(self, observations: NDArray[np.float32], part: int) -> Any:
        """Returns the named fields of observations (b, size) as robots of a part make them."""
        layout = self.worlds.parts[part].task.layout
        return layout.unpack(observations[:, : layout.size].astype(np.float64))

    def actions_of(self, twists: Array) -> NDArray[np.float32]:
        """Returns the actions that come nearest to twists, for the robots as they now are."""
        return np.concatenate(
            [
                each.actions.of_twists(twists[rows], self.speeds[rows], self._angles[rows])
                for each, rows in zip(self.perceptions, self.seen_to, strict=True)
            ]
        )

    def _last(self, rows: NDArray[np.int64]) -> NDArray[np.float32]:
        """Returns what the network sees at the end of the episodes that the last step ended in rows."""
        finals, last = (
            self.worlds.final_observations(rows),
            np.empty((len(rows), self.perception.num_inputs), np.float32),
        )
        for k, (each, mine) in enumerate(zip(self.perceptions, self.seen_to, strict=True)):
            here = (mine.start <= rows) & (rows < mine.stop)
            if not here.any():
                continue
            own = rows[here]
            requested = None if self._twists is None else self._twists[own]
            fields = self._fields(finals[here], k)
            last[here], _ = each.inputs(fields, self.speeds[own], self.memory[own], requested, self.limits[own])
        return last

    def _see(self, observations: NDArray[np.float32]) -> None:
        self.observations = observations
        if self.base is not None:
            self._twists = self.ask(self.pilots)
        seen = []
        for k, (each, rows) in enumerate(zip(self.perceptions, self.seen_to, strict=True)):
            fields = self._fields(observations[rows], k)
            requested = None if self._twists is None else self._twists[rows]
            memory = self.memory[rows]
            seen.append(each.inputs(fields, self.speeds[rows], memory, requested, self.limits[rows]))
        self._inputs, self._angles = (np.concatenate([pair[k] for pair in seen]) for k in range(2))

    def close(self) -> None:
        """Closes the worlds."""
        self.worlds.close()

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Returns False for each row: the infos of shaped worlds tell no episodes."""
        return [False for _ in self._get_indices(indices)]

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns an attribute of each row's world."""
        return self.worlds.get_attr(attr_name, indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuses."""
        self.worlds.set_attr(attr_name, value, indices)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refuses."""
        return self.worlds.env_method(method_name, *args, indices=indices, **kwargs)

    ARRAYS = ("left", "observations", "_inputs", "_angles")

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Returns all that decides what comes next, but for the random generators."""
        arrays = {f"shaped.{name}": getattr(self, name).copy() for name in self.ARRAYS} | self.worlds.arrays()
        arrays["shaped.memory"] = np.frombuffer(self.memory.tobytes(), np.float32).reshape(self.num_envs, -1)
        if self._twists is not None:
            arrays["shaped._asked"] = self._twists.copy()
        for k, pilot in enumerate(self.pilots):
            arrays |= {f"pilot_{k}.{name}": each for name, each in pilot.arrays().items()}
        for k, shield in enumerate(self.shields):
            arrays[f"shield_{k}"] = np.frombuffer(shield.tobytes(), np.uint8)
        return arrays

    def generators(self) -> list[Any]:
        """Returns the states of the robots' random generators."""
        return self.worlds.generators()

    def restore(self, arrays: Mapping[str, NDArray[Any]], generators: list[Any]) -> None:
        """Puts everything back to where `arrays` and `generators` were taken; `_inputs` is what is seen next."""
        for name in self.ARRAYS:
            setattr(self, name, arrays[f"shaped.{name}"].copy())
        self.memory = self.perception.fresh(self.num_envs)
        if self.memory.nbytes:
            self.memory[:] = np.frombuffer(arrays["shaped.memory"].tobytes(), self.memory.dtype)
        self.worlds.restore(arrays, generators)
        self._shield()
        for k, shield in enumerate(self.shields):
            shield[:] = np.frombuffer(arrays[f"shield_{k}"].tobytes(), shield.dtype)
        if self.base is not None:
            self._twists = arrays["shaped._asked"].copy()
            self.pilots = self.make_pilots(self.base.policy)
            for k, pilot in enumerate(self.pilots):
                pilot.put_back({name: arrays[f"pilot_{k}.{name}"] for name in pilot.arrays()})

    @property
    def seen(self) -> NDArray[np.float32]:
        """Returns the inputs of the network for the next action."""
        return self._inputs
