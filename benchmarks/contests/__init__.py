"""The contests: policies against each other on frozen test scenarios, or on those of the user's own files.

One file a contest, with all that is its own: `path_following`, `goal_obstacles`, `docking`. `contest` says what one is.
"""

from collections.abc import Mapping

from wayfield.benchmarks.contests.contest import (
    COST,
    GAINS_NAMES,
    OWN_SPLIT,
    PAPER,
    TRAINED,
    TRANSFER_SPLIT,
    Column,
    Contest,
    Course,
    Entrants,
)
from wayfield.benchmarks.contests.docking import DOCKING
from wayfield.benchmarks.contests.goal_obstacles import GOAL_OBSTACLES
from wayfield.benchmarks.contests.path_following import PATH_FOLLOWING

__all__ = [
    "CONTESTS",
    "COST",
    "DISTURBANCES",
    "FRONT_SCENARIOS",
    "GAINS",
    "GAINS_NAMES",
    "LADDER_SCENARIOS",
    "OVERVIEW",
    "OVERVIEW_SCENARIOS",
    "OWN_SPLIT",
    "PAPER",
    "TRAINED",
    "TRANSFER_SPLIT",
    "Column",
    "Contest",
    "Course",
    "Entrants",
]

CONTESTS: Mapping[str, Contest] = {contest.name: contest for contest in (PATH_FOLLOWING, GOAL_OBSTACLES, DOCKING)}

# What may be asked for, and the sets of gains that it stands for.
GAINS: Mapping[str, tuple[str, ...]] = {
    **{name: (name,) for name in ("default", "tuned", "best", "paper")},
    "all": ("default", "tuned", "paper"),
}

FRONT_SCENARIOS = 2  # of each family, at each speed of the front
LADDER_SCENARIOS = 2  # of each family, at each level
OVERVIEW_SCENARIOS = 1  # of each family, in the overview

OVERVIEW, DISTURBANCES = "overview", "disturbances"  # suites of all contests, in part
