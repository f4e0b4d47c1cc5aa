"""The pilot that drives an environment with a policy."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from wayfield.envs.single import SingleEnv
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.tasks.specs import CROWDS
from wayfield.envs.vector import NativeVectorEnv
from wayfield.policies.parts.forward_prediction import ForwardPrediction, undelayed
from wayfield.policies.parts.policy import Policy, check_robot, lacks
from wayfield.system.checks import MOST_THREADS, shown, whole
from wayfield.system.threads import bounds, thread_pool

Array = NDArray[np.float64]


class Pilot:
    """Drives an environment, single or native vector, with a policy; or robots of whom there is only a briefing.

    Call `reset` after the environment's reset, then `act` with each observation: it unpacks the named fields and turns
    the policy's twists into actions of the environment's action mode. A `Briefing` in place of the environment is for
    robots that are in none of ours, real ones or another simulator's: it says how their observations are laid out.

    Args:
        env: the environment, or a briefing; the policy is told what it declares of either.
        num_threads: threads that share the robots out, whose decisions are the same for every number, bit for bit; the
            policy must keep what it remembers in its memory alone, as all of the package do.

    Raises:
        TypeError: if the policy cannot read the observations, or a briefing lacks what it needs.
        ValueError: if the policy needs what the robot cannot do.
    """

    def __init__(self, policy: Policy, env: Any, num_threads: int = 1) -> None:
        given = env if isinstance(env, Briefing) else getattr(env, "unwrapped", env)
        if not isinstance(given, SingleEnv | NativeVectorEnv | Briefing):
            raise TypeError(
                "Pilot drives environments of wayfield, single or native vector, or by a Briefing, not "
                f"{type(given).__name__}: Pilot(policy, env)"
            )
        if not hasattr(policy, "observes"):
            raise TypeError(f"policy is {shown(policy)}; it must be a policy, such as wayfield.policies.make('lqr')")
        if env is not given:
            _check_unchanged(env, given)
        base: Any = given
        plain = isinstance(given, Briefing)
        layout, robot = (base.layout, base.robot) if plain else (base.task.layout, base.task.robot)
        actuators = base.actuators if plain else base.task.options.actuators
        kind = layout.kind
        # a policy without access to bodies gets the observation without them
        self._less = kind not in policy.observes and getattr(kind, "less", lambda: None)() in policy.observes
        if kind not in policy.observes and not self._less:
            reads = " or ".join(f"{each.__module__}.{each.__name__}" for each in policy.observes)
            gives = f"{kind.__module__}.{kind.__name__}"
            name = getattr(policy, "name", type(policy).__name__)
            if policy.knows == "bodies" and layout.task in CROWDS.values():
                raise TypeError(f'{name} needs bodies; make the environment with sees="bodies", it has sees="scan"')
            from wayfield.policies.registry import POLICIES, drives  # which imports the policies, and they this

            assert layout.task is not None
            fits = (each for each in POLICIES if drives(each, layout.task) and not lacks(POLICIES[each](), robot))
            fit = ", ".join(fits)
            raise TypeError(f"{name} reads {reads}, but {type(base).__name__} gives {gives}; policies that fit: {fit}")
        check_robot(policy, robot)
        self.policy = policy
        self._env: SingleEnv | NativeVectorEnv | Briefing = given
        # a base that answers late is driven from its predicted state, unless the policy was trained on it as it is
        late = actuators.response is not None
        self._predicts = late and not getattr(policy, "trained_with", lambda robot: False)(robot)
        self._ahead: ForwardPrediction | None = None
        if plain:
            most = robot.max_twist
            if base.action_mode == "wheel_speeds":
                most = np.full(len(robot.wheel_matrix), robot.rated_wheel_speed)
            self._shape = most.shape if base.num_envs == 1 else (base.num_envs, *most.shape)
        else:
            most = base.task.options.max_action
            self._shape = base.action_space.shape
        self._most = most.astype(np.float32)  # as the space has it
        self._started = False
        whole("num_threads", num_threads, 1, MOST_THREADS)
        self._threads = num_threads
        self._parts: list[tuple[int, int, Briefing]] = []  # of the robots, where several threads share them out
        self.briefing: Briefing
        self.memory: NDArray[Any]

    def reset(self, rows: NDArray[Any] | None = None, briefing: Briefing | None = None) -> None:
        """Briefs the policy on the episodes that have just begun, in all rows or in the given ones (indices or a mask).

        The other rows keep their briefing and memory.

        Args:
            briefing: of the new episodes, where there is no environment; None: the one before.

        Raises:
            RuntimeError: if only some rows are named before all have been.
            TypeError: if a briefing is given beside an environment, or lacks what the policy needs.
        """
        if isinstance(self._env, Briefing):
            self._env = briefing or self._env
        elif briefing is not None:
            raise TypeError("briefing is given, but the environment makes its own; leave it out")
        briefing = self._briefed(self.policy.knows)
        if self._predicts:
            briefing = self._compensated(briefing, rows)
        if rows is None:
            self.briefing = briefing
            self.memory = self.policy.reset(briefing)
            self._started = True
            self._parts = self._shared_out()
            return
        if not self._started:
            raise RuntimeError("call the pilot's reset for all rows before its reset for some")
        self.briefing = self.briefing.with_rows(briefing, rows)
        self.memory[rows] = self.policy.reset(self.briefing)[rows]
        self._parts = self._shared_out()

    def act(self, observation: NDArray[Any]) -> NDArray[np.float32]:
        """Returns the action for the observation: float32, a member of the environment's action space.

        A command beyond the bounds is scaled by one factor, so that the direction of motion stays, as the
        wheels do with what they cannot turn. The robot so moves as under `command` up to float32 rounding, but in two
        cases, where the space is smaller than what the wheels can do: an omni base in the tier "ideal", and omni3's
        fastest sideways turns. See `command`.

        Raises:
            RuntimeError: before the first `reset`.
        """
        actions = _contained(self._requested(observation), self._most)
        self._note(actions)
        return actions

    def command(self, observation: NDArray[Any]) -> Array:
        """Returns the law's command, unrounded: the action in float64, beyond the bounds of the action space too.

        Environments take it as it is, and their wheels saturate. Benchmarks drive by it, so that published runs of
        unsaturated wheels stay those; wrappers, replay buffers and other libraries want `act`. Each observation is for
        one of the two, once: policies remember.

        Raises:
            RuntimeError: before the first `reset`.
        """
        actions = self._requested(observation)
        self._note(actions)
        return actions

    def keep(self, rows: NDArray[Any]) -> None:
        """Goes on with some of the robots alone, by indices or a mask: whole worlds. It cannot be reset after that."""
        self.briefing, self.memory = self.briefing.part(rows), self.memory[rows]
        self._shape = (len(self.memory), *self._shape[1:])
        if self._ahead is not None:
            self._ahead.keep(rows)
        self._parts = self._shared_out()

    def arrays(self) -> dict[str, NDArray[np.uint8]]:
        """Returns the bytes of all that it remembers: the policy's memory, and what was sent to a base that is late."""
        retained = {"memory": self.memory} | ({} if self._ahead is None else self._ahead.remembered)
        return {name: np.frombuffer(each.tobytes(), np.uint8) for name, each in retained.items()}

    def put_back(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Puts what `arrays` returned into a pilot of the same policy that was reset for the same episodes."""
        retained = {"memory": self.memory} | ({} if self._ahead is None else self._ahead.remembered)
        for name, each in retained.items():
            each[...] = np.frombuffer(arrays[name].tobytes(), each.dtype).reshape(each.shape)

    def _requested(self, observation: NDArray[Any]) -> Array:
        if not self._started:
            raise RuntimeError("call the pilot's reset after the environment's, before it acts")
        if isinstance(observation, tuple | dict):
            raise TypeError(
                f"observation is a {type(observation).__name__}; it must be an array: "
                "observation, info = env.reset(); after that the first that env.step(action) returns"
            )
        observation = np.atleast_2d(observation)
        if observation.shape != (seen := (len(self.memory), self.briefing.layout.size)):
            raise ValueError(f"observation has the shape {observation.shape}; that of {seen[0]} robot(s) is {seen}")
        if self._ahead is not None:
            observation = self._ahead.observed(observation)
        twists = self._decided(observation)
        if self._ahead is not None:
            twists = self._ahead.requested(twists)
        if self.briefing.action_mode == "wheel_speeds":
            twists = self.briefing.robot.wheel_speeds_from_twist(twists)
        return twists.reshape(self._shape)

    def _briefed(self, knows: str) -> Briefing:
        """Returns what one who declares `knows` is told of the episodes now starting."""
        if isinstance(self._env, Briefing):
            return self._env.restricted(knows)
        return self._env.briefing(knows)

    def _note(self, actions: NDArray[Any]) -> None:
        """Takes note of what is sent to a base that answers late."""
        if self._ahead is None:
            return
        twists = np.atleast_2d(actions).astype(np.float64)
        if self.briefing.action_mode == "wheel_speeds":
            robot = self.briefing.robot
            twists = (twists @ robot.forward_matrix.T)[:, list(robot.twist_axes)]
        self._ahead.sent(twists)

    def _compensated(self, briefing: Briefing, rows: NDArray[Any] | None) -> Briefing:
        """Returns the briefing of a base without its delay; what was sent in the rows is forgotten."""
        privileged = briefing if briefing.position_tolerance is not None else self._briefed("path")
        if self._ahead is None:
            task = getattr(self._env, "task", None)
            spacing = getattr(getattr(task, "task_params", None), "preview_spacing", 0.0)
            self._ahead = ForwardPrediction(privileged, spacing)
        else:
            self._ahead.episodes = privileged if rows is None else self._ahead.episodes.with_rows(privileged, rows)
        self._ahead.reset(slice(None) if rows is None else rows)
        return dataclasses.replace(briefing, actuators=undelayed(briefing.actuators))

    def _decided(self, observation: NDArray[Any]) -> Array:
        """Returns the policy's twists (b, t), decided by several threads where there are parts."""
        if len(self._parts) < 2:
            fields = self._shown(observation, self.briefing)
            return self.policy.act(fields, self.briefing, self.memory)
        twists: list[Array] = [np.empty(0)] * len(self._parts)

        def work(k: int) -> None:
            first, last, briefing = self._parts[k]
            fields = self._shown(observation[first:last], briefing)
            twists[k] = self.policy.act(fields, briefing, self.memory[first:last])

        thread_pool(self._threads).run(work, len(self._parts))
        return np.concatenate(twists)

    def _shown(self, observation: NDArray[Any], briefing: Briefing) -> Any:
        """Returns the named fields that the policy has access to."""
        fields = briefing.layout.unpack(observation.astype(np.float64))
        return fields.without_bodies() if self._less else fields

    def _shared_out(self) -> list[tuple[int, int, Briefing]]:
        """Returns the rows of each part, and the briefing of its robots; nothing for one thread."""
        if self._threads == 1:
            return []
        team = self.briefing.team  # the robots of a world stay together
        parts = [(a - a % team, b - b % team) for a, b in bounds(self.briefing.num_envs, self._threads)]
        return [(first, last, self.briefing.part(slice(first, last))) for first, last in parts if first < last]


def _check_unchanged(env: Any, given: Any) -> None:
    """Raises ValueError if wrappers change what is seen, or scale what is commanded, which a policy would not know."""
    for name in ("observation_space", "action_space"):
        own: Any = getattr(given, name)
        other: Any = getattr(env, name, None)
        within = isinstance(other, Box) and other.shape == own.shape
        # a wrapper that clips has no bounds
        unbounded = within and name == "action_space" and not (other.bounded_below | other.bounded_above).any()
        if not (unbounded or (within and np.array_equal(other.low, own.low) and np.array_equal(other.high, own.high))):
            raise ValueError(
                f"a wrapper changes the {name} to {shown(other)}, which policies do not know: drive env.unwrapped, by "
                "what it gives and takes"
            )


def _contained(actions: Array, most: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns actions (..., k) within the bounds, each scaled by one factor where it exceeds them.

    What is not finite stays so, for the environment to refuse.
    """
    excess = np.maximum(np.abs(actions) / most, 1.0).max(axis=-1, keepdims=True)
    scaled = actions / np.where(np.isfinite(excess), excess, 1.0)
    return np.clip(scaled, -most, most, where=np.isfinite(scaled), out=scaled).astype(np.float32)


class Drive:
    """Drives the robots of a native vector environment that was just reset, each to the end of its first episode.

    A robot that has ended drives on until an eighth of those that take part have; then they rest. Those that go on
    move as they would among all, bit for bit.

    Args:
        pilots: just reset; the first drives all robots but those that another one is said to drive.
        whose: (b,) which of the pilots drives each robot; None: the first drives all.
    """

    def __init__(
        self,
        env: NativeVectorEnv,
        pilots: Sequence[Pilot],
        observations: NDArray[Any],
        whose: NDArray[Any] | None = None,
    ) -> None:
        self._env, self.pilots = env, pilots
        self._whose = np.zeros(env.num_envs, np.int64) if whose is None else whose
        self._seen = observations
        self._actions = np.zeros((env.num_envs, *env.batch.action_shape))
        self.rows = np.arange(env.num_envs)  # of the robots that take part: as the pilots have them
        self.alive = np.ones(env.num_envs, np.bool_)  # (b,) whose first episode has not ended

    def step(self) -> tuple[Array, NDArray[np.bool_], dict[str, NDArray[Any]]]:
        """Moves all by one control period; returns rewards (b,), who has ended in it (b,) and what the step told."""
        rows, seen = self.rows, self._seen[self.rows]
        actions = self.pilots[0].command(seen)
        for k, pilot in enumerate(self.pilots[1:], 1):
            theirs = (self._whose[rows] == k).reshape(-1, *[1] * (actions.ndim - 1))
            actions = np.where(theirs, pilot.command(seen), actions)
        self._actions[rows] = actions
        self._seen, rewards, terminated, truncated, info = self._env.step(self._actions)
        ended = self.alive & (terminated | truncated)
        self.alive &= ~ended
        return rewards, ended, info

    def rest(self) -> None:
        """Lets robots rest whose world has ended, once they are an eighth of those that take part."""
        team = self._env.task.team
        on = np.repeat(self.alive.reshape(-1, team).any(axis=1), team)
        left = on[self.rows]
        if 8 * left.sum() > 7 * len(left) or not left.any():
            return
        for pilot in self.pilots:
            pilot.keep(left)
        self._env.resting[:] = ~on
        self.rows = self.rows[left]

    def memory_of(self, i: int) -> NDArray[Any]:
        """Returns the memory (1,) that robot i's pilot keeps of it."""
        k = int(np.searchsorted(self.rows, i))
        return self.pilots[int(self._whose[i])].memory[k : k + 1]
