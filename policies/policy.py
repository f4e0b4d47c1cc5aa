"""The one door that every policy stands behind, and the pilot that drives an environment with a policy."""

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.briefing import Briefing
from wayfield.envs.single import SingleEnv
from wayfield.envs.vector import NativeVectorEnv

Array = NDArray[np.float64]


class Policy(Protocol):
    """Maps what robots observe to the twists they shall drive, for a batch of b robots at once.

    A policy is a frozen dataclass: every gain is a field. What it remembers during an episode is made by `reset`,
    handed to every `act`, and changed in place there; memory[i] is robot i's.
    """

    @property
    def knows(self) -> str:
        """Returns what it must be told before an episode: "sensors" (nothing), "path", "goal" or "map"."""

    @property
    def observes(self) -> tuple[type, ...]:
        """Returns the observation types it can read, of one task or of several."""

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns fresh memory, shape (b, ...), for episodes that start under the briefing."""

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns body twists (b, t) in m/s and rad/s, t the robot's twist axes, for observations of shape (b, ...)."""


def check_gain(
    policy: object, name: str, *, above: float = -math.inf, least: float = -math.inf, finite: bool = True
) -> None:
    """Raises ValueError, naming the gain, its value and its range, unless it is a number in that range."""
    value = getattr(policy, name)
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool) and not math.isnan(value)
    if number and value > above and value >= least and (math.isfinite(value) or not finite):
        return
    wanted = "a finite number" if finite else "a number"
    if above > -math.inf:
        wanted += f" > {above:g}"
    elif least > -math.inf:
        wanted += f" >= {least:g}"
    raise ValueError(f"{type(policy).__name__}: {name} must be {wanted}, got {value!r}")


def check_whole(policy: object, name: str, *, least: int = 0) -> None:
    """Raises ValueError, naming the gain, its value and its range, unless it is a whole number in that range."""
    value = getattr(policy, name)
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
        raise ValueError(f"{type(policy).__name__}: {name} must be a whole number >= {least}, got {value!r}")


def check_switch(policy: object, name: str) -> None:
    """Raises ValueError, naming the gain and its value, unless it is True or False."""
    if not isinstance(getattr(policy, name), bool):
        raise ValueError(f"{type(policy).__name__}: {name} must be True or False, got {getattr(policy, name)!r}")


def check_holonomic(policy: Policy, briefing: Briefing) -> None:
    """Raises ValueError, naming policy and robot, unless the robot can drive sideways."""
    if not briefing.robot.holonomic:
        raise ValueError(
            f"{type(policy).__name__} drives omni robots only; robot {briefing.robot.name!r} cannot go sideways"
        )


def check_scan(policy: Policy, ranges: Array, briefing: Briefing) -> None:
    """Raises ValueError, naming the policy and both numbers, unless a scan (b, n) has a range for each beam."""
    beams = len(briefing.beam_angles)
    if not beams:
        raise ValueError(f"{type(policy).__name__} needs a range scan; num_beams is 0 and must be at least 1")
    if ranges.shape[-1] != beams:
        raise ValueError(f"{type(policy).__name__}: ranges has {ranges.shape[-1]} values, the scan has {beams} beams")


class Pilot:
    """Drives an environment, single or native vector, with a policy.

    Call `reset` after the environment's reset, then `act` with each observation: it unpacks the named fields and turns
    the policy's twists into actions of the environment's action mode.

    Raises:
        TypeError: if the policy cannot read the environment's observations.
    """

    def __init__(self, policy: Policy, env: Any) -> None:
        base = env.unwrapped
        if not isinstance(base, SingleEnv | NativeVectorEnv):
            raise TypeError(
                f"Pilot drives environments of wayfield, single or native vector, not {type(base).__name__}"
            )
        kind = base.task.layout.kind
        if kind not in policy.observes:
            reads = " or ".join(f"{each.__module__}.{each.__name__}" for each in policy.observes)
            gives = f"{kind.__module__}.{kind.__name__}"
            raise TypeError(f"{type(policy).__name__} reads {reads}, but {type(base).__name__} gives {gives}")
        self.policy = policy
        self._env = base
        self._shape = base.action_space.shape
        self._started = False
        self.briefing: Briefing
        self.memory: NDArray[Any]

    def reset(self, rows: NDArray[Any] | None = None) -> None:
        """Tells the policy of the episodes that have just begun, in all rows or in the given ones."""
        self.briefing = self._env.briefing(self.policy.knows)
        self._started = True
        memory = self.policy.reset(self.briefing)
        if rows is None:
            self.memory = memory
        else:
            self.memory[rows] = memory[rows]

    def act(self, observation: NDArray[Any]) -> Array:
        """Returns the action for the observation, with the environment's own shapes.

        Raises:
            RuntimeError: before the first `reset`.
        """
        if not self._started:
            raise RuntimeError("call the pilot's reset after the environment's, before act")
        fields = self.briefing.layout.unpack(np.atleast_2d(observation).astype(np.float64))
        twists = self.policy.act(fields, self.briefing, self.memory)
        if self.briefing.action_mode == "wheel_speeds":
            twists = self.briefing.robot.wheel_speeds_from_twist(twists)
        return twists.reshape(self._shape)
