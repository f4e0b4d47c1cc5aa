"""Drives at random: the other half of the floor that every table stands on."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following, trajectory_tracking
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains, gain
from wayfield.system.checks import LAST_SEED


@dataclasses.dataclass(frozen=True)
class Random(Gains):
    """Draws each twist component uniformly from what the robot can do, anew at every step.

    `seed` and the robot's row fix the draws: every episode has the same ones unless the seed is another.
    """

    seed: int = gain(0, "1", "of the law's own random numbers", most=LAST_SEED)

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (
        path_following.Observation, trajectory_tracking.Observation, goal_reaching.Observation,
    )  # fmt: skip

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns a generator for each robot, so that robot i acts alike in every batch that holds it."""
        generators = np.empty(briefing.num_envs, dtype=object)
        for i in range(briefing.num_envs):
            generators[i] = np.random.default_rng([self.seed, i])
        return generators

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns uniform twists (b, t)."""
        del observation
        most = briefing.robot.max_twist
        return np.array([generator.uniform(-most, most) for generator in memory])
