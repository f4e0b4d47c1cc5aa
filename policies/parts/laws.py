"""Kinds of laws: what they are told, what they observe and what they need of a base, unless they say otherwise."""

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following, team_worlds
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains
from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.stopping import Scan

Array = NDArray[np.float64]


class PathLaw(Gains):
    """Follows a path that it is told."""

    knows: ClassVar[str] = "path"
    observes: ClassVar[tuple[type, ...]] = (path_following.Observation,)
    needs: ClassVar[tuple[str, ...]] = ()


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
