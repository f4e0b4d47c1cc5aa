"""What a scenario of several bodies is: a start and a goal a robot, people, and the proof that it can be done."""

import copy
import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.crowds.people import (
    GOES_ON,
    LAWS,
    OF_2009,
    ORCA,
    REACTIONS,
    REPLAY,
    STANDING,
    WALK,
)
from wayfield.envs.scenarios.scenario import GoalScenario, check_clear, check_labels
from wayfield.system.checks import FARTHEST, LONGEST, SHORTEST, WHOLE_TURN, number, shown

MOST_ROBOTS = 4096
MOST_PEOPLE = 4096
SIGHT = 5.0  # m, within which bodies are neighbours

_BY_2009 = ("group", "reaction")  # of a person, which the forces of 2009 alone heed
# of a person the least and the most of each number
_BOUNDS: dict[str, tuple[float, float]] = {
    "law": (0, len(LAWS) - 1),
    **dict.fromkeys(("x", "y", "goal_x", "goal_y"), (-FARTHEST, FARTHEST)),
    **dict.fromkeys(("gate_x", "gate_y", "gate_to_x", "gate_to_y"), (-FARTHEST, FARTHEST)),
    "speed": (0.0, 3.0),
    "radius": (0.0, 0.5),
    "then": (0, GOES_ON),
    "blind": (0, 1),
    **dict.fromkeys(("horizon", "wall_horizon", "frame_time"), (SHORTEST, LONGEST)),
    "margin": (0.0, 1.0),
    "share": (0.0, 1.0),
    "turn": (-WHOLE_TURN, WHOLE_TURN),
    "begins": (-LONGEST, LONGEST),
    **dict.fromkeys(("first", "rows"), (0, 2**40)),  # their sum is an index
    "group": (0, MOST_PEOPLE),
    "reaction": (0, len(REACTIONS) - 1),
}
_NEEDED_BY = {"horizon": ORCA, "wall_horizon": ORCA, "frame_time": REPLAY}  # what others leave at 0

Pose = tuple[float, float, float]


def _nobody() -> NDArray[np.void]:
    return np.zeros(0, WALK)


@dataclasses.dataclass(frozen=True, eq=False)
class TeamScenario:
    """Robots that each have a goal, in one world, among people.

    Raises:
        ValueError: if there is no robot, or a value is out of its range; the message names the field and the value.
    """

    name: str
    robots: tuple[GoalScenario, ...]  # start and goal of each; all stand in the same field
    walks: NDArray[np.void] = dataclasses.field(default_factory=_nobody)  # (q,) WALK records
    tracks: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros((0, 4)))  # of replayed people
    reach: float = SIGHT  # m, within which bodies are neighbours
    proof: str = ""  # "rigid turn", "one after another", "waiting"; "": none was looked for
    bound: float = math.nan  # s, the proven makespan over the longest straight way at the same speed
    family: str = ""
    tier: str = ""
    quantity: float = math.nan  # what the tier is read from: the bound

    # no file holds one yet
    file_fields: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        check_labels(self)
        if not isinstance(self.robots, Sequence) or not 1 <= len(self.robots) <= MOST_ROBOTS:
            count = len(self.robots) if isinstance(self.robots, Sequence) else shown(self.robots)
            raise ValueError(f"robots are {count}; there must be from 1 to {MOST_ROBOTS}")
        for i, each in enumerate(self.robots):
            if not isinstance(each, GoalScenario):
                raise ValueError(f"robots[{i}] is {shown(each)}; it must be a GoalScenario")
        walks = self.walks
        if not isinstance(walks, np.ndarray) or walks.dtype != WALK or walks.ndim != 1 or len(walks) > MOST_PEOPLE:
            raise ValueError(f"walks is {shown(walks)}; it must be an array of at most {MOST_PEOPLE} WALK records")
        for name, (least, most) in _BOUNDS.items():
            unset = (walks["law"] != _NEEDED_BY.get(name, walks["law"])) & (walks[name] == 0.0)
            bad = np.flatnonzero(~((walks[name] >= least) & (walks[name] <= most) | unset))
            if len(bad):
                value = walks[name][bad[0]]
                raise ValueError(f"walks[{bad[0]}].{name} is {value}; it must be from {least:g} to {most:g}")
        for name in _BY_2009:
            bad = np.flatnonzero((self.walks[name] > 0) & ~np.isin(self.walks["law"], OF_2009))
            if len(bad):
                laws = ", ".join(law for law, number in LAWS.items() if number in OF_2009)
                law = next(law for law, number in LAWS.items() if number == self.walks["law"][bad[0]])
                raise ValueError(
                    f"walks[{bad[0]}].{name} is {self.walks[name][bad[0]]} with the law {law}; only {laws} have one"
                )
        tracks = self.tracks
        if not isinstance(tracks, np.ndarray) or tracks.dtype != np.float64 or tracks.ndim != 2 or tracks.shape[1] != 4:
            raise ValueError(f"tracks is {shown(tracks)}; it must be an array (rows, 4) of float64")
        for row, column in np.argwhere(~(np.abs(tracks) <= FARTHEST)).tolist():  # true for NaN as well
            value = tracks[row, column]
            raise ValueError(f"tracks[{row}, {column}] is {value}; it must be from -{FARTHEST:g} to {FARTHEST:g}")
        last = self.walks["first"] + self.walks["rows"]
        needed = np.where(self.walks["law"] == REPLAY, 2, np.where(self.walks["then"] == GOES_ON, 1, 0))
        bad = np.flatnonzero(
            (self.walks["rows"] < needed) | (needed > 0) & ((self.walks["first"] < 0) | (last > len(self.tracks)))
        )
        if len(bad):
            k = bad[0]
            raise ValueError(
                f"walks[{k}] has rows {self.walks['first'][k]} to {last[k]} of tracks, which has {len(self.tracks)}; "
                f"there must be at least {needed[k]}"
            )
        number("reach", self.reach, above=0.0)

    @classmethod
    def made(
        cls, name: str, starts: Sequence[Pose], goals: Sequence[Pose], obstacles: Any = (), **fields: Any
    ) -> "TeamScenario":
        """Returns a scenario from starts and goals, x, y (m), heading (rad), a robot each, all in one field.

        Goals are reached within 0.2 m at any heading, as in the goal families.
        """
        if len(starts) != len(goals):
            raise ValueError(f"starts are {len(starts)} and goals are {len(goals)}; there must be as many of either")
        own: dict[str, Any] = {
            key: fields.pop(key) for key in ("position_tolerance", "heading_tolerance") if key in fields
        }
        own = {"position_tolerance": 0.2, "heading_tolerance": math.pi} | own
        robots: list[GoalScenario] = []
        for start, goal in zip(starts, goals, strict=True):
            if not robots:
                first = (
                    GoalScenario(name, goal=goal, start=start, obstacles=obstacles, **own)
                    if len(obstacles)
                    else (GoalScenario(name, goal=goal, start=start, **own))
                )
                robots.append(first)
                continue
            # the field is checked once, and shared
            bare = GoalScenario(name, goal=goal, start=start, **own)
            robot = copy.copy(robots[0])
            object.__setattr__(robot, "start", bare.start)
            object.__setattr__(robot, "goal", bare.goal)
            robots.append(robot)
        return cls(name, tuple(robots), **fields)

    @property
    def team(self) -> int:
        """Returns how many robots there are."""
        return len(self.robots)

    @property
    def starts(self) -> NDArray[np.float64]:
        """Returns where the robots start, (n, 3)."""
        return np.array([each.start for each in self.robots])

    @property
    def goals(self) -> NDArray[np.float64]:
        """Returns where they shall go, (n, 3)."""
        return np.array([each.goal for each in self.robots])

    @property
    def obstacles(self) -> NDArray[np.void]:
        """Returns the obstacles (m,) of the field."""
        return self.robots[0].obstacles

    @functools.cached_property
    def walked_rows(self) -> NDArray[np.int64]:
        """Returns the rows of the tracks that people walk, one person's behind another's."""
        first, rows = self.walks["first"], self.walks["rows"]
        return np.repeat(first - np.cumsum(rows) + rows, rows) + np.arange(rows.sum())

    @property
    def straight(self) -> NDArray[np.float64]:
        """Returns the length (m) of each robot's straight way, (n,)."""
        apart: NDArray[np.float64] = np.sqrt(((self.goals - self.starts)[:, :2] ** 2).sum(axis=1))
        return apart

    def of(self, team: int) -> "TeamScenario":
        """Returns the scenario of the first robots alone; ValueError if there are not so many."""
        if team > len(self.robots):
            raise ValueError(
                f"team={team} is larger than scenario {self.name!r} allows; it must be at most {len(self.robots)}"
            )
        return self if team == len(self.robots) else dataclasses.replace(self, robots=self.robots[:team])

    def walked(self, visible: bool | None, law: str | None) -> "TeamScenario":
        """Returns the scenario with people who see robots or not and walk by a law of LAWS; None: as they are."""
        if (visible is None and law is None) or not len(self.walks):
            return self
        walks = self.walks.copy()
        if visible is not None:
            walks["blind"] = not visible
        if law is not None:
            walks["law"][(walks["law"] != REPLAY) & (walks["law"] != STANDING)] = LAWS[law]
            if LAWS[law] not in OF_2009:
                walks["group"], walks["reaction"] = 0, 0
        return dataclasses.replace(self, walks=walks)

    def fitted(self, shrinkage: float) -> "TeamScenario":
        """Returns the scenario for a smaller hull: itself, with more room."""
        del shrinkage
        return self

    def decisive(self) -> list[Any]:
        """Returns all numbers that decide an episode, in an order of their own."""
        # what nobody has decides nothing
        walks = [self.walks[name] for name in WALK.names or () if name not in _BY_2009 or self.walks[name].any()]
        each = [part for robot in self.robots[:1] for part in robot.decisive()]
        return [len(self.robots), *each, self.starts, self.goals, len(self.walks), *walks, self.tracks, self.reach]


def check_team(scenario: TeamScenario, hull_radius: float) -> None:
    """Checks that discs of `hull_radius` (m) fit at all starts and goals, and that nobody overlaps at the start.

    Raises:
        ValueError: naming the scenario, the robots and the places.
    """
    for robot in scenario.robots:
        check_clear(robot, hull_radius)
    for what, places in (("starts", scenario.starts), ("goals", scenario.goals)):
        for i in range(1, len(places)):
            gaps = np.sqrt(((places[:i, :2] - places[i, :2]) ** 2).sum(axis=1)) - 2.0 * hull_radius
            if gaps.min() < 0.0:
                k = int(gaps.argmin())
                raise ValueError(
                    f"scenario {scenario.name!r}: {what}[{k}] and {what}[{i}] overlap by {-gaps[k]:.3g} m for hulls of "
                    f"radius {hull_radius:g} m; they must be {2.0 * hull_radius:g} m apart"
                )
    walks = scenario.walks[(scenario.walks["law"] != REPLAY) & (scenario.walks["radius"] > 0.0)]
    places, reach = np.column_stack([walks["x"], walks["y"]]), walks["radius"]
    for i, place in enumerate(places):
        for what, others, radii in (
            ("starts", scenario.starts[:, :2], hull_radius),
            ("walks", places[:i], reach[:i]),
        ):
            gaps = np.sqrt(((others - place) ** 2).sum(axis=1)) - radii - reach[i]
            if len(gaps) and gaps.min() < 0.0:
                k = int(gaps.argmin())
                raise ValueError(
                    f"scenario {scenario.name!r}: {what}[{k}] and walks[{i}] overlap by {-gaps[k]:.3g} m; people must "
                    "start beside robots and each other"
                )
