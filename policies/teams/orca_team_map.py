"""Reciprocal collision avoidance among tracked bodies along a way on the map, with access to both."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import team_worlds
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.params import params
from wayfield.policies.parts.steering import Map
from wayfield.policies.poses.astar_tracker import memory_of
from wayfield.policies.teams.orca import along_the_way
from wayfield.policies.teams.orca_team import MEMORY, OrcaTeam
from wayfield.system.compiled import allocating, any_layout
from wayfield.system.elementary import sin_cos


@dataclasses.dataclass(frozen=True)
class OrcaTeamMap(OrcaTeam):
    """Drives as `OrcaTeam` does, along a shortest way around what stands instead of straight at the goal.

    The way is one by Theta* on the map, bent towards `wanted_clearance`, as in `Orca`: u points at the farthest place
    on it, up to 3 m on, that the robot sees in a straight line with room for its hull. The other bodies are no part of
    the way: where two meet in a door one gives way, by `back_off`, once they are stuck.

    Source: as of `OrcaTeam`; the roadmap example of RVO2.
    """

    wall_horizon: float = gain(1.0, "s", "in which nothing that stands is met", above=0.0, search=(0.2, 2.0))
    wall_margin: float = gain(0.05, "m", "kept between hull and walls", least=0.0)
    patience: float = gain(1.5, "s", "after which who does not get on is stuck", above=0.0, search=(0.5, 6.0))
    back_off: float = gain(
        0.5, "m", "back, of who gives way to a robot that it is stuck behind; 0: nobody", least=0.0, search=(0.0, 1.0)
    )
    cell: float = gain(0.05, "m", "of the grid of that way", above=0.0)
    wanted_clearance: float = gain(0.2, "m", "beside the hull, towards which the way is bent", least=0.0)
    surroundings: float = gain(8.0, "m", "around start, goals and robot, of obstacles that the grid holds", above=0.0)

    knows: ClassVar[str] = "map"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns `memory_of` records (b,): the way and its grid, and what `OrcaTeam` remembers."""
        own = [(name, MEMORY[name]) for name in MEMORY.names or ()]
        return np.zeros(briefing.num_envs, memory_of(briefing, own))

    def wanted(
        self, observation: team_worlds.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the velocities (b, 2) along its way that it would drive were it alone, m/s, body frame."""
        p = params(self, briefing, theta=True, snap=0.3, spacing=2.0, rounds=60)  # the planner's, see `plan_way`
        seen = (observation.pose, observation.goal, observation.waypoints_left)
        targets = np.empty((len(memory), 2))
        find_targets(p, Map.of(briefing), *map(np.ascontiguousarray, seen), memory, targets)
        return super().wanted(observation._replace(goal=targets), briefing, memory)


@any_layout
@allocating
def find_targets(params, map_, poses, goals, waypoints_left, memory, targets):
    """Fills the (b, 2) targets of `OrcaTeamMap`, body frame, m: on its way, as far off as that is long."""
    p = params[0]
    for i in range(poses.shape[0]):
        sine, cosine = sin_cos(poses[i, 2])
        x = cosine * goals[i, 0] - sine * goals[i, 1]
        y = sine * goals[i, 0] + cosine * goals[i, 1]
        x, y, way = along_the_way(p, memory[i], map_, i, poses, waypoints_left[i], x, y)
        scale = way / max(math.sqrt(x * x + y * y), 1e-12)
        targets[i, 0] = scale * (cosine * x + sine * y)
        targets[i, 1] = scale * (cosine * y - sine * x)
