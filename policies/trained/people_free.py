"""Trained agents among people, who add to what reciprocal avoidance drives, and are held by nothing."""

import dataclasses
from typing import ClassVar

from wayfield.envs import team_worlds
from wayfield.policies.trained.ppo import Ppo


@dataclasses.dataclass(frozen=True)
class PeopleFree(Ppo):
    """Drives with the agent of its seed that ships for the task and the robot it is put in, or with one of your own.

    The network sees the goal, the scan and the nearest bodies, and adds to the velocity v' that `OrcaTeam` drives:

        v = v' + reach speed a,  no faster than speed

    A network that has learned nothing drives as ORCA does. Its half-planes count on velocities to last, and those of
    people who do not see the robot do not: so here they are advice, not a guard, and nothing of theirs is promised.

    Source: van den Berg, Guy, Lin and Manocha, ISRR 2009; Johannink et al., "Residual reinforcement learning for robot
    control", ICRA 2019; Schulman et al., "Proximal policy optimization algorithms", 2017.
    """

    observes: ClassVar[tuple[type, ...]] = (team_worlds.Observation,)
    among: ClassVar[str] = "free"
    privileged: ClassVar[str] = "bodies"
