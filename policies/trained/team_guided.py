"""Trained agents that choose the velocity they want among bodies, while reciprocal avoidance keeps them clear."""

import dataclasses
from typing import ClassVar

from wayfield.envs import team_worlds
from wayfield.policies.trained.ppo import Ppo


@dataclasses.dataclass(frozen=True)
class TeamGuided(Ppo):
    """Drives with the agent of its seed that ships for the task and the robot it is put in, or with one of your own.

    The network sees the goal, the scan and the nearest bodies, and adds to the velocity u that `OrcaTeam` wants:

        min |v - (u + reach speed a)|  subject to  n_j . v >= b_j,  |v| <= speed

    with the half-planes of `OrcaTeam`, which have the last word: so a network that has learned nothing drives as ORCA
    does, and every law that holds of ORCA's half-planes holds of the agent. One network drives all robots of a team,
    each by what it sees (parameter sharing), and learned by driving among copies of itself.

    Source: van den Berg, Guy, Lin and Manocha, ISRR 2009; Schulman et al., "Proximal policy optimization algorithms",
    2017; a shield over a learned policy: Alshiekh et al., "Safe reinforcement learning via shielding", AAAI 2018.
    """

    observes: ClassVar[tuple[type, ...]] = (team_worlds.Observation,)
    among: ClassVar[str] = "guided"
    privileged: ClassVar[str] = "bodies"
