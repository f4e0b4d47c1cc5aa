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
from wayfield.system.checks import choose

KNOWS = ("sensors", "path", "bodies", "goal", "map", "team_map")
MAPPED = ("map", "team_map")  # to whom what stands is told


_OF_THE_MAP = ("obstacles", "num_obstacles", "patrols", "grids")
_OF_THE_WAY = ("paths", "path_index", "goals", "num_goals")
_HIDDEN_FROM = dict.fromkeys(("sensors", "bodies"), _OF_THE_WAY + _OF_THE_MAP) | {
    "path": _OF_THE_MAP,
    "goal": _OF_THE_MAP,
    **dict.fromkeys(MAPPED, ()),
}


@dataclasses.dataclass(frozen=True)
class Briefing:
    """What a robot may know before it starts, for a batch of b robots.

    A policy that declares `sensors` or `bodies` finds None in the fields of path, goal and map; one that declares
    `path` or `goal` finds those; only `map` is shown the obstacles; `team_map` is the same of one who reads the rows of
    all robots of a world, where others read their own. How near to its goal a robot has to come is told to all.
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

    def told(self, knows: str) -> "Briefing":
        """Returns the part of it that one who declares `knows` has access to.

        Raises:
            ValueError: if `knows` is none of KNOWS.
            TypeError: if there is not what it declares; the message names the field.
        """
        choose("knows", knows, KNOWS)
        hidden: dict[str, Any] = dict.fromkeys(_HIDDEN_FROM[knows])
        needed = {"path": ("paths", "goals"), "goal": ("goals",)} | dict.fromkeys(MAPPED, ("obstacles",))
        fields = needed.get(knows, ())
        if fields and all(getattr(self, name) is None for name in fields):
            raise TypeError(f"briefing has {' and '.join(fields)} None; one who has access to the {knows} needs it")
        return dataclasses.replace(self, **hidden)

    @property
    def task(self) -> TaskSpec:
        """Returns the task that the robots are in."""
        assert self.layout.task is not None
        return self.layout.task
