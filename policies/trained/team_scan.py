"""Trained agents that drive in teams by their scans alone: a goal seeker's network, which went on among its copies."""

import dataclasses
from typing import ClassVar

from wayfield.envs import team_worlds
from wayfield.policies.trained.ppo import Ppo


@dataclasses.dataclass(frozen=True)
class TeamScan(Ppo):
    """Drives with the agent of its seed that ships for the task and the robot it is put in, or with one of your own.

    The network is that of `Ppo` for one robot among obstacles, of the same seed, which PPO took further in teams: one
    network drives all robots, each by its own scan, in which the others are what moves (parameter sharing). It nears
    nothing that its scan shows faster than it could stop, as for one robot: `GoalFeatures.guarded`.

    Source: Schulman et al., "Proximal policy optimization algorithms", 2017; collision avoidance of teams by scans,
    learned among copies: Long et al., "Towards optimally decentralized multi-robot collision avoidance via deep
    reinforcement learning", ICRA 2018.
    """

    observes: ClassVar[tuple[type, ...]] = (team_worlds.Observation,)
    among: ClassVar[str] = "scan"
