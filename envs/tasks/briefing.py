"""The information that a policy has access to before an episode starts."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.tasks.observation import Layout
from wayfield.envs.tasks.specs import TaskSpec
from wayfield.envs.world.grids import Grids
from wayfield.envs.world.paths import PathPool

KNOWS = ("sensors", "path", "bodies", "goal", "map")


@dataclasses.dataclass(frozen=True)
class Briefing:
    """What a robot may know before it starts, for a batch of b robots.

    A policy that declares `sensors` or `bodies` finds None in the fields of path, goal and map; one that declares
    `path` or `goal` finds those; only `map` is shown the obstacles. How near to its goal a robot has to come is told to
    all.
    """

    num_envs: int
    robot: Robot
    actuators: Actuators  # nominal, as on the data sheet
    dt: float  # s
    action_mode: str
    layout: Layout[Any]  # of the flat observation
    beam_angles: NDArray[np.float64]  # (beams,) rad, body frame
    max_range: float  # m
    position_tolerance: NDArray[np.float64] | None = None  # (b,) m, from the goal where it is reached; None on a path
    paths: PathPool | None = None
    path_index: NDArray[np.int64] | None = None  # (b,) run of each robot in the pool
    goals: NDArray[np.float64] | None = None  # (b, w, 3) waypoints and, last of num_goals, the goal pose
    num_goals: NDArray[np.int64] | None = None  # (b,)
    obstacles: NDArray[np.void] | None = None  # (b, m) OBSTACLE records
    num_obstacles: NDArray[np.int64] | None = None  # (b,)
    patrols: NDArray[np.void] | None = None  # (b, m) PATROL records of the obstacles; leg_time 0 where one stands
    grids: Grids | None = None  # what stands besides; a frame a robot
    team: int = 1  # robots of a world, whose rows lie together
    sight: float = 0.0  # m, within which bodies are tracked; 0: none are

    @property
    def task(self) -> TaskSpec:
        """Returns the task that the robots are in."""
        assert self.layout.task is not None
        return self.layout.task
