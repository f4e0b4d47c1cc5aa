"""Stands still: the lower end of the floor that every table stands on."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following, trajectory_tracking
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains


@dataclasses.dataclass(frozen=True)
class Zero(Gains):
    """Commands no motion, whatever it observes."""

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (
        path_following.Observation, trajectory_tracking.Observation, goal_reaching.Observation,
    )  # fmt: skip

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty memory."""
        return np.empty((briefing.num_envs, 0))

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns zero twists (b, t)."""
        del observation, memory
        return np.zeros((briefing.num_envs, len(briefing.robot.twist_axes)))
