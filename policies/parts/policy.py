"""The one door that every policy stands behind, and the checks of robots and scans that policies share."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following, trajectory_tracking
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.scenarios import TaskSpec
from wayfield.envs.tasks.briefing import Briefing

Array = NDArray[np.float64]


class Policy(Protocol):
    """Maps what robots observe to the twists they shall drive, for a batch of b robots at once.

    A policy is a frozen dataclass: every gain is a field. What it remembers during an episode is made by `reset`,
    handed to every `act`, and changed in place there; memory[i] is robot i's.
    """

    @property
    def knows(self) -> str:
        """Returns the privileged information that it needs, one of `KNOWS` of the briefing: "sensors" is none."""

    @property
    def observes(self) -> tuple[type, ...]:
        """Returns the observation types it can read, of one task or of several."""

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns fresh memory, shape (b, ...), for episodes that start under the briefing."""

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns body twists (b, t) in m/s and rad/s, t the robot's twist axes, for observations of shape (b, ...)."""


_OBSERVED: Mapping[str, type] = {
    "path": path_following.Observation,
    "reference": trajectory_tracking.Observation,
    "goal": goal_reaching.Observation,
}


def observation_of(task: TaskSpec) -> type:
    """Returns what a task gives its policies to observe."""
    return _OBSERVED[task.observes]


# What a policy may need of a robot, as a `Robot` says it, in words.
NEEDS = {"holonomic": "goes sideways", "turns_on_the_spot": "turns on the spot, of turning_radius 0"}


def lacks(policy: object, robot: Robot) -> list[str]:
    """Returns what a policy, or its class, needs of a robot that this one cannot do."""
    return [need for need in getattr(policy, "needs", ()) if not getattr(robot, need)]


def check_robot(policy: Policy, robot: Robot) -> None:
    """Raises ValueError, naming policy and robot, unless the robot can all that the policy needs.

    A policy that needs more than wheels that turn it says so in `needs`, names of NEEDS.
    """
    for need in lacks(policy, robot):
        able = ", ".join(name for name, each in ROBOTS.items() if getattr(each, need))
        raise ValueError(f"{type(policy).__name__} needs a robot that {NEEDS[need]} ({able}); {robot.name!r} does not")


def check_scan(policy: Policy, ranges: Array, briefing: Briefing) -> None:
    """Raises ValueError, naming the policy and both numbers, unless a scan (b, n) has a range for each beam."""
    beams = len(briefing.beam_angles)
    if not beams:
        raise ValueError(
            f"{type(policy).__name__} needs a range scan; num_beams is 0 and must be at least 1: make the environment "
            "with num_beams=72"
        )
    if ranges.shape[-1] != beams:
        raise ValueError(f"{type(policy).__name__}: ranges has {ranges.shape[-1]} values, the scan has {beams} beams")
