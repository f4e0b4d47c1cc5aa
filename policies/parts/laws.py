"""Kinds of laws: what they are told, what they observe and what they need of a base, unless they say otherwise."""

import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following, team_worlds, trajectory_tracking
from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.gain_estimate import estimate_gains
from wayfield.policies.parts.lead import aims_of
from wayfield.policies.parts.params import params
from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.sampled import check_stable
from wayfield.policies.parts.stopping import Scan

Array = NDArray[np.float64]


class PathLaw(Gains):
    """Follows a path that it is told."""

    knows: ClassVar[str] = "path"
    observes: ClassVar[tuple[type, ...]] = (path_following.Observation,)
    needs: ClassVar[tuple[str, ...]] = ()


@dataclasses.dataclass(frozen=True)
class ReferenceLaw(Gains):
    """Follows a reference in time by what it observes of it, from where its command has an effect.

    Its equations are `decide`, compiled: of `params`, AIM records (b,) and the memory it fills the twists (b, t), which
    begin at zero, and may write what the law keeps into the last two columns of the memory.
    """

    lead: bool = gain(True, "", "whether it predicts where it and its reference are once a command has its effect")
    estimate: float = gain(
        0.0, "1", "rate at which gains of the reference are estimated; 0: none", least=0.0, search=(0.0, 10.0)
    )

    decide: ClassVar[Callable[..., None]]
    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (trajectory_tracking.Observation,)
    needs: ClassVar[tuple[str, ...]] = ()

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns a memory (b, 4): two estimated gains, and what the law keeps of its own.

        Raises:
            ValueError: as `check`.
        """
        self.check(briefing.robot, briefing.actuators, briefing.dt)
        return np.zeros((briefing.num_envs, 4))

    def check(self, robot: Robot, actuators: Actuators, dt: float) -> None:
        """Raises ValueError if errors would grow with these gains on a base: see `sampled.check_stable`."""
        check_stable(self, robot, actuators, dt)

    def act(self, observation: trajectory_tracking.Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t), m/s and rad/s."""
        aims = aims_of(type(self).__name__, observation, briefing, self.lead)
        if self.estimate > 0.0:
            estimate_gains(aims, self.estimate, briefing.dt, memory)
        twists = np.zeros((len(aims), len(briefing.robot.twist_axes)))
        self.decide(params(self, briefing), aims, memory, twists)
        return twists


class GoalLaw(Gains):
    """Drives to a goal by what the robot senses, and turns on the spot where it must."""

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)
    needs: ClassVar[tuple[str, ...]] = ("turns_on_the_spot",)


class CrowdLaw(GoalLaw):
    """Drives to a goal among tracked bodies."""

    knows: ClassVar[str] = "bodies"
    observes: ClassVar[tuple[type, ...]] = (team_worlds.Observation,)


class ScanLaw(GoalLaw, Policy):
    """Drives to a goal by its scan, with a memory made by `remembering`."""

    def act(self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t) in m/s and rad/s.

        Raises:
            ValueError: if the scan has another number of beams than the briefing.
        """
        return self.act_on(Scan.of(self, observation, briefing, memory), observation, briefing, memory["state"])

    def act_on(
        self, scan: Scan, observation: goal_reaching.Observation, briefing: Briefing, state: NDArray[Any]
    ) -> Array:
        """Returns the twists (b, t) for a scan; state (b,): what the law remembers beside the scans."""
        raise NotImplementedError
