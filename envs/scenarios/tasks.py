"""A task as one value: its names, its scenarios and tiers, its clock, and what two successes are compared by.

Whoever needs to know which task something belongs to reads it here, or asks the environment's, the briefing's or the
contest's `spec`: splits, agents, training, validation, contests, tables.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from wayfield.envs.checks import choose
from wayfield.envs.robots import Robot
from wayfield.envs.scenarios import docking_families, goal_families, path_families
from wayfield.envs.scenarios.goal_presets import GOAL_SCENARIOS
from wayfield.envs.scenarios.path_presets import PATH_SCENARIOS
from wayfield.envs.scenarios.scenario import DockingScenario, GoalScenario, PathScenario

TIERS = ("easy", "medium", "hard")


@dataclasses.dataclass(frozen=True)
class Cost:
    """What successes are compared by: lower is better."""

    metric: str  # the column of the episodes
    name: str  # what tables and figures call it
    unit: str
    decimals: int  # that mean something
    failure: float  # what a failed run counts as, in the unit


@dataclasses.dataclass(frozen=True)
class TaskSpec:
    """All that tells one task from another, but for its motion and reward, which are its environment's."""

    name: str  # of splits, agents and presets
    suite: str  # of contests and tuned gains
    title: str
    kind: str  # "path", "goal" or "dock": what messages call its scenarios, and the field that a file of one must have
    ids: Mapping[bool, str]  # the registered id for robots that are holonomic, and that are not
    scenario: type[PathScenario] | type[GoalScenario]
    presets: Mapping[str, Callable[..., Any]]  # scenarios by name, besides the families
    families: Mapping[str, Callable[[int], Any]]
    needs_pymunk: tuple[str, ...]  # families that the kinematic plant cannot show; left out of "all"
    quantity: Callable[[Any], float]  # what a scenario's tier is read from
    feasible: Callable[[Any], bool]  # whether the largest robot can do a scenario
    tier_bounds: tuple[float, float]  # of the quantity: where easy and medium end
    clock: int  # control periods of a contest
    cost: Cost
    failure: str  # the flag of a run that ended badly
    failed: str  # what became of such a run, in a word

    def __reduce__(self) -> tuple[Callable[[str], "TaskSpec"], tuple[str]]:
        """Returns what pickle and copy find it by: its name, for families are functions made in functions."""
        return task_spec, (self.name,)

    def env_id(self, robot: Robot) -> str:
        """Returns the registered id of the task for a robot."""
        return self.ids[robot.holonomic]

    def tier(self, quantity: float) -> str:
        """Returns the tier of a scenario of that quantity: easy ones are below the bounds, or above falling ones."""
        first, second = self.tier_bounds
        sign = 1.0 if first < second else -1.0
        return TIERS[int(sign * quantity >= sign * first) + int(sign * quantity >= sign * second)]


TASKS: Mapping[str, TaskSpec] = {
    spec.name: spec
    for spec in (
        # Follow a path (document A), with any robot.
        TaskSpec(
            name="path_following",
            suite="path-following",
            title="Path following",
            kind="path",
            ids={False: "wayfield/DiffDrivePathFollowing-v0", True: "wayfield/OmniPathFollowing-v0"},
            scenario=PathScenario,
            presets=PATH_SCENARIOS,
            families=path_families.PATH_FAMILIES,
            needs_pymunk=(),
            quantity=path_families.path_sharpness,
            feasible=path_families.feasible,
            tier_bounds=(1.0, 2.5),  # 1/m, the sharpness
            clock=2400,
            # a run that fails has left the corridor of 1 m
            cost=Cost("cross_track_rms", "RMS error", "m", 4, 1.0),
            failure="left_corridor",
            failed="left",
        ),
        # Reach a goal pose, or pass waypoints, among obstacles (documents B and C), with any robot.
        TaskSpec(
            name="goal_reaching",
            suite="goal-obstacles",
            title="Goal reaching among obstacles",
            kind="goal",
            ids={False: "wayfield/DiffDriveGoalObstacles-v0", True: "wayfield/OmniGoalObstacles-v0"},
            scenario=GoalScenario,
            presets=GOAL_SCENARIOS,
            families=goal_families.GOAL_FAMILIES,
            needs_pymunk=("push_boxes",),
            quantity=goal_families.room_on_the_way,
            feasible=goal_families.feasible,
            tier_bounds=(0.6, 0.35),  # m, the room
            clock=1200,
            cost=Cost("time", "time", "s", 1, 60.0),  # the whole clock
            failure="collision",
            failed="collided",
        ),
        # Come to rest at a pose from close by, with any robot.
        TaskSpec(
            name="docking",
            suite="docking",
            title="Docking",
            kind="dock",
            ids={False: "wayfield/DiffDriveDocking-v0", True: "wayfield/OmniDocking-v0"},
            scenario=DockingScenario,
            presets=docking_families.DOCKING_SCENARIOS,
            families=docking_families.DOCKING_FAMILIES,
            needs_pymunk=(),
            quantity=docking_families.manoeuvre,
            feasible=docking_families.feasible,
            tier_bounds=(1.8, 2.5),  # m, of the proven way
            clock=1200,
            cost=Cost("time", "time", "s", 1, 60.0),  # the whole clock
            failure="collision",
            failed="collided",
        ),
    )
}


FAMILIES = {name: spec.families for name, spec in TASKS.items()}  # scenarios from a seed, by task and family


def task_spec(name: str) -> TaskSpec:
    """Returns the task of that name; ValueError, naming the nearest, if there is none."""
    choose("task", name, TASKS)
    return TASKS[name]
