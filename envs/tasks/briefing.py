"""The information that a policy has access to before an episode starts."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.robots.references import References
from wayfield.envs.tasks.observation import Layout
from wayfield.envs.tasks.specs import TaskSpec
from wayfield.envs.world.grids import NO_GRIDS, Grids, frames_of
from wayfield.envs.world.paths import PathPool
from wayfield.system.checks import choose

KNOWS = ("sensors", "path", "bodies", "goal", "map", "team_map")
MAPPED = ("map", "team_map")  # to whom what stands is told

# names of until 0.1: where each is now


class Course(NamedTuple):
    """The paths of b robots."""

    vertices: NDArray[np.void]  # of all paths; the records of `PathPool`
    runs: NDArray[np.void]
    path_index: NDArray[np.int64]  # (b,) the run of each robot

    @classmethod
    def of(cls, pool: PathPool, path_index: NDArray[np.int64]) -> "Course":
        """Returns the paths of robots on these of a pool."""
        return cls(pool.vertices, pool.runs, path_index)


class Goals(NamedTuple):
    """The waypoints and goals of b robots."""

    goals: NDArray[np.float64]  # (b, w, 3) waypoints and, last of num_goals, the goal pose
    num_goals: NDArray[np.int64]  # (b,)


class Surroundings(NamedTuple):
    """What stands around b robots, and what moves by itself."""

    obstacles: NDArray[np.void]  # (b, m) OBSTACLE records
    counts: NDArray[np.int64]  # (b,) of them
    frames: NDArray[np.void]  # (b,) of each robot's grid
    cells: NDArray[np.uint8]  # of all grids; none where there is no grid

    @classmethod
    def of(
        cls,
        obstacles: NDArray[np.void],
        counts: NDArray[np.int64],
        grids: Grids = NO_GRIDS,
        scenarios: NDArray[np.int64] | None = None,
    ) -> "Surroundings":
        """Returns it of obstacles and of the grids of scenarios (b,), if any."""
        which = np.zeros(len(obstacles), np.int64) if scenarios is None or not len(grids.cells) else scenarios
        return cls(obstacles, counts, *frames_of(grids, which))


# of each, the arrays with a row for each robot
_ROWS = {
    "path": ("path_index",),
    "reference": ("which",),
    "goal": Goals._fields,
    "map": ("obstacles", "counts", "frames"),
}


@dataclasses.dataclass(frozen=True)
class Briefing:
    """What a robot may know before it starts, for a batch of b robots.

    A policy that declares `sensors` or `bodies` finds None in `path`, `reference`, `goal` and `map`; one that declares
    `path` or `goal` finds those where the task has them; only `map` is shown the map; `team_map` is the same of one who
    reads the rows of all robots of a world, where others read their own. How near to its goal a robot has to come is
    told to all; bodies that are in sight come with the observation.
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
    heading_tolerance: NDArray[np.float64] | None = None  # (b,) rad, off the goal's heading; None on a path
    path: Course | None = None
    reference: References | None = None  # of a path with a clock
    preview_spacing: float = 0.0  # s, between the samples of a reference's preview
    goal: Goals | None = None
    map: Surroundings | None = None
    team: int = 1  # robots of a world, whose rows lie together
    sight: float = 0.0  # m, within which bodies are tracked; 0: none are

    def restricted(self, knows: str) -> "Briefing":
        """Returns the part of it that one who declares `knows` has access to.

        Raises:
            ValueError: if `knows` is none of KNOWS.
            TypeError: if there is not what it declares; the message names the field.
        """
        choose("knows", knows, KNOWS)
        needed = {"path": ("path", "goal"), "goal": ("goal",)} | dict.fromkeys(MAPPED, ("map",))
        fields = needed.get(knows, ())
        if fields and all(getattr(self, name) is None for name in fields):
            raise TypeError(f"briefing has {' and '.join(fields)} None; one who has access to the {knows} needs it")
        if knows in MAPPED:
            return self
        if fields:
            return dataclasses.replace(self, map=None)
        return dataclasses.replace(self, path=None, reference=None, goal=None, map=None)

    def part(self, rows: slice | NDArray[Any]) -> "Briefing":
        """Returns the briefing of some of the robots: a slice, indices or a mask."""
        few = self._by_rows(self, lambda array, _: array[rows])
        return dataclasses.replace(self, num_envs=len(np.empty(self.num_envs)[rows]), **few)

    def with_rows(self, anew: "Briefing", rows: NDArray[Any]) -> "Briefing":
        """Returns it with some rows of another, of all arrays that hold one for each robot."""

        def mixed(array: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
            array = array.copy()
            array[rows] = other[rows]
            return array

        return dataclasses.replace(self, **self._by_rows(anew, mixed))

    def _by_rows(self, other: "Briefing", change: Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]]) -> Any:
        """Returns the fields that hold a row for each robot, their arrays changed with those of another."""
        fields: dict[str, Any] = {}
        for name in ("position_tolerance", "heading_tolerance"):
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine is not None and theirs is not None:
                fields[name] = change(mine, theirs)
        for name, rows in _ROWS.items():
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine is not None:
                fields[name] = mine._replace(**{k: change(getattr(mine, k), getattr(theirs, k)) for k in rows})
        return fields

    @property
    def task(self) -> TaskSpec:
        """Returns the task that the robots are in."""
        assert self.layout.task is not None
        return self.layout.task
