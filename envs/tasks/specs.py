"""A task as one value: its names, its scenarios and tiers, its clock, and what two successes are compared by.

Whoever needs to know which task something belongs to reads it here, or asks the environment's, the briefing's or the
contest's `spec`: ids, splits, agents, training, validation, contests, tables. The ids are registered from it, so that
this module is as light as they are: what scenarios need is loaded on first access.
"""

import dataclasses
import functools
import importlib
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wayfield.envs.robots import Robot

TIERS = ("easy", "medium", "hard")
CLASS_STEP = 0.05  # m, between hull classes
LARGEST_CLASS = 1.0  # m


@dataclasses.dataclass(frozen=True)
class Cost:
    """What successes are compared by: lower is better."""

    metric: str  # the column of the episodes
    name: str  # what tables and figures call it
    unit: str
    decimals: int  # that mean something
    failure: float  # what a failed run counts as, in the unit


@dataclasses.dataclass(frozen=True)
class Family:
    """Scenarios of one kind, each made from a seed, and what is known of all of them."""

    name: str
    about: str  # what it is, in a line
    make: Callable[[int], Any]
    team: int = 1  # robots
    gap: float = math.nan  # m, the width of what all have to pass; NaN: of nothing
    goal_room: float = 0.1  # m, at least, between the largest hull at its goal and what stands
    walled: bool = False  # whether walls part a team from its goals
    moving: bool = False  # whether obstacles move
    needs_forces: bool = False  # the kinematic plant cannot show it; left out of "all"


@dataclasses.dataclass(frozen=True)
class Repertoire:
    """The scenarios of a task: what one is, where they come from, and how hard each is."""

    scenario: type[Any]  # PathScenario, GoalScenario, or one of their kind
    presets: Mapping[str, Callable[..., Any]]  # scenarios by name, besides the families
    families: Mapping[str, Family]
    quantity: Callable[[Any], float]  # what a scenario's tier is read from
    feasible: Callable[..., bool]  # whether a robot can do a scenario: the largest, or one of a hull (m) that is given
    largest_hull: float = math.inf  # m, radius, that the families were searched for ways of
    # how many times as large the scenes of a hull class (m) are; None: the families have no classes
    size: Callable[[float], float] | None = None

    def hull_class(self, hull_radius: float) -> float:
        """Returns the class (m) whose scenes a hull drives, rounded up to 0.05 m; 0: the frozen scenes, or none."""
        if self.size is None or not self.largest_hull < hull_radius <= LARGEST_CLASS:
            return 0.0
        return round(math.ceil(round(hull_radius / CLASS_STEP, 9)) * CLASS_STEP, 2)

    @property
    def most(self) -> float:
        """Returns the largest hull (m) that the families have scenes for."""
        return self.largest_hull if self.size is None else LARGEST_CLASS

    def split_for(self, split: str, hull_radius: float) -> str:
        """Returns the name of a split with the class of a hull behind it, as in "test@0.45"."""
        hull = self.hull_class(hull_radius)
        return f"{split}@{hull:.2f}" if hull else split

    def size_for(self, hull_radius: float) -> float:
        """Returns how many times as large the scenes that a hull (m) drives are."""
        return self.size_of(self.split_for("", hull_radius))

    def size_of(self, split: str) -> float:
        """Returns how many times as large the scenes of a split's name are; 1 of what names no class."""
        try:
            hull = float(split.rpartition("@")[2])
        except ValueError:
            return 1.0
        return self.size(hull) if self.size and hull == self.hull_class(hull) else 1.0


@dataclasses.dataclass(frozen=True)
class TaskSpec:
    """All that distinguishes a task, but for its motion and reward, which are its environment's."""

    name: str  # of splits, agents and presets
    suite: str  # of contests and tuned gains
    title: str
    asks: str  # what a robot shall do
    kind: str  # "path", "goal", "dock": of scenarios in messages; the field of a file that holds the path or pose
    observes: str  # "path", "reference" or "goal": what its policies see of what is asked of them
    module: str  # of wayfield.envs, that has its environments
    # the registered id for robots that are holonomic, and that are not: its stem is the class in the module, and
    # "Vector" behind it makes that of many robots
    ids: Mapping[bool, str]
    scenarios: str  # the module of wayfield.envs.scenarios that has its REPERTOIRE
    tier_bounds: tuple[float, float]  # of the quantity: where easy and medium end
    clock: int  # control periods of a contest
    cost: Cost
    failure: str  # the flag of a run that ended badly
    failed: str  # what became of such a run, in a word

    def __reduce__(self) -> tuple[Callable[[str], "TaskSpec"], tuple[str]]:
        """Returns what pickle and copy find it by: its name, for families are functions made in functions."""
        return task_spec, (self.name,)

    @functools.cached_property
    def repertoire(self) -> Repertoire:
        """Returns its scenarios, loaded on first access."""
        repertoire: Repertoire = importlib.import_module(f"wayfield.envs.scenarios.{self.scenarios}").REPERTOIRE
        return repertoire

    @property
    def on_path(self) -> bool:
        """Returns whether its scenarios have a path, to be followed at any time or by a clock, and nothing beside."""
        return self.observes != "goal"

    @property
    def scenario(self) -> type[Any]:
        """Returns the class of its scenarios."""
        return self.repertoire.scenario

    @property
    def presets(self) -> Mapping[str, Callable[..., Any]]:
        """Returns scenarios by name, besides the families."""
        return self.repertoire.presets

    @property
    def families(self) -> Mapping[str, Family]:
        """Returns its families by name."""
        return self.repertoire.families

    def quantity(self, scenario: Any) -> float:
        """Returns what a scenario's tier is read from."""
        return self.repertoire.quantity(scenario)

    def feasible(self, scenario: Any, *hull: float) -> bool:
        """Returns whether the largest robot can do a scenario, or one of the hull (m) that is given."""
        return self.repertoire.feasible(scenario, *hull)

    def env_id(self, robot: "Robot") -> str:
        """Returns the registered id of the task for a robot."""
        return self.ids[robot.holonomic]

    def entry_point(self, env_id: str) -> str:
        """Returns where Gymnasium finds the class of one of the ids."""
        return f"wayfield.envs.{self.module}:{env_id.partition('/')[2].partition('-v')[0]}"

    def tier(self, quantity: float) -> str:
        """Returns the tier of a scenario of that quantity: easy ones are below the bounds, or above falling ones."""
        first, second = self.tier_bounds
        sign = 1.0 if first < second else -1.0
        return TIERS[int(sign * quantity >= sign * first) + int(sign * quantity >= sign * second)]


TASKS: Mapping[str, TaskSpec] = {
    spec.name: spec
    for spec in (
        # Document A, with any robot.
        TaskSpec(
            name="path_following",
            suite="path-following",
            title="Path following",
            asks="follow a path",
            kind="path",
            observes="path",
            module="path_following",
            ids={False: "wayfield/DiffDrivePathFollowing-v0", True: "wayfield/OmniPathFollowing-v0"},
            scenarios="path_families",
            tier_bounds=(1.0, 2.5),  # 1/m, the sharpness
            clock=2400,
            # a run that fails has left the corridor of 1 m
            cost=Cost("cross_track_rms", "RMS error", "m", 4, 1.0),
            failure="left_corridor",
            failed="left",
        ),
        # Documents B and C, with any robot.
        TaskSpec(
            name="goal_reaching",
            suite="goal-obstacles",
            title="Goal reaching among obstacles",
            asks="reach a goal among obstacles",
            kind="goal",
            observes="goal",
            module="goal_reaching",
            ids={False: "wayfield/DiffDriveGoalObstacles-v0", True: "wayfield/OmniGoalObstacles-v0"},
            scenarios="goal_families",
            tier_bounds=(0.6, 0.35),  # m, the room
            clock=1200,
            cost=Cost("time", "time", "s", 1, 60.0),  # the whole clock
            failure="collision",
            failed="collided",
        ),
        TaskSpec(
            name="docking",
            suite="docking",
            title="Docking",
            asks="stop at a pose",
            kind="dock",
            observes="goal",
            module="docking",
            ids={False: "wayfield/DiffDriveDocking-v0", True: "wayfield/OmniDocking-v0"},
            scenarios="docking_families",
            tier_bounds=(1.8, 2.5),  # m, of the proven way
            clock=1200,
            cost=Cost("time", "time", "s", 1, 60.0),  # the whole clock
            failure="collision",
            failed="collided",
        ),
        TaskSpec(
            name="trajectory_tracking",
            suite="trajectory-tracking",
            title="Trajectory tracking",
            asks="follow a moving reference pose",
            kind="reference",
            observes="reference",
            module="trajectory_tracking",
            ids={False: "wayfield/DiffDriveTrajectoryTracking-v0", True: "wayfield/OmniTrajectoryTracking-v0"},
            scenarios="reference_families",
            tier_bounds=(0.5, 0.75),  # share of what a base can
            clock=1200,
            # a run that fails has left the tube of 1 m
            cost=Cost("position_rms_after", "RMS error after 10 s", "m", 5, 1.0),
            failure="left_corridor",
            failed="left",
        ),
    )
}


# Several bodies in one world. Their contests are not those of one robot: the world is what statistics count.
CROWDS: Mapping[str, TaskSpec] = {
    spec.name: spec
    for spec in (
        TaskSpec(
            name="teams",
            suite="teams",
            title="Teams",
            asks="reach goals of their own among each other",
            kind="team",
            observes="goal",
            module="teams",
            ids={False: "wayfield/DiffDriveTeam-v0", True: "wayfield/OmniTeam-v0"},
            scenarios="team_families",
            tier_bounds=(2.0, 6.0),  # the proven makespan over the longest straight way
            clock=2400,
            cost=Cost("extra_time", "extra time", "s", 1, 120.0),  # the whole clock
            failure="collision",
            failed="collided",
        ),
        TaskSpec(
            name="people",
            suite="people",
            title="Goal reaching among people",
            asks="reach a goal among people",
            kind="people",
            observes="goal",
            module="among_people",
            ids={False: "wayfield/DiffDrivePeople-v0", True: "wayfield/OmniPeople-v0"},
            scenarios="people_families",
            tier_bounds=(0.1, 0.3),  # people a square metre
            clock=1200,
            cost=Cost("extra_time", "extra time", "s", 1, 60.0),  # the whole clock
            failure="collision",
            failed="collided",
        ),
    )
}
EVERY: Mapping[str, TaskSpec] = {**TASKS, **CROWDS}


def task_spec(name: str) -> TaskSpec:
    """Returns the task of that name; ValueError, naming the nearest, if there is none."""
    from wayfield.system.checks import choose

    choose("task", name, EVERY)
    return EVERY[name]


def spec_of(env_id: str) -> TaskSpec:
    """Returns the task of a registered id; StopIteration if it is none of ours."""
    return next(spec for spec in EVERY.values() if env_id in spec.ids.values())
