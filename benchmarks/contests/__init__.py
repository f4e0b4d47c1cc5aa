"""The contests: policies against each other on frozen test scenarios, on the user's own files, or in public benchmarks.

One file a contest, with all that is its own: `path_following`, `goal_obstacles`, `docking`, `trajectory_tracking`, and
those of public benchmarks, whose files the user has: `barn`, `mrpb`, `movingai`, `racetracks`; `crowds` are those of
several bodies. `contest` says what one is.
"""

from collections.abc import Mapping

from wayfield.benchmarks.contests.barn import CHALLENGE, OWN_SPEED
from wayfield.benchmarks.contests.contest import (
    COMPLETE,
    COST,
    GAINS_NAMES,
    HAND_TUNED,
    OWN_SPLIT,
    PACE_TOLERANCE,
    PAPER,
    PUBLIC_SPLIT,
    ROBUST_LEVEL,
    TRAINED,
    TRANSFER_SPLIT,
    Bar,
    Column,
    Contest,
    Course,
    Entrants,
    Film,
    Published,
    Score,
)
from wayfield.benchmarks.contests.crowds import ATTNGRAPH, CROSS, CROWDNAV, PEOPLE, TEAMS, TUNED_CROWDS
from wayfield.benchmarks.contests.docking import DOCKING
from wayfield.benchmarks.contests.goal_obstacles import ANY, GOAL_OBSTACLES
from wayfield.benchmarks.contests.movingai import MOVINGAI
from wayfield.benchmarks.contests.mrpb import MRPB
from wayfield.benchmarks.contests.path_following import PATH_FOLLOWING
from wayfield.benchmarks.contests.racetracks import RACETRACKS
from wayfield.benchmarks.contests.trajectory_tracking import TRAJECTORY_TRACKING

__all__ = [
    "ALL_CONTESTS",
    "ANY",
    "COMPLETE",
    "CONTESTS",
    "COST",
    "CROSS",
    "CROWD_SUITES",
    "DISTURBANCES",
    "FRONT_SCENARIOS",
    "GAINS",
    "GAINS_NAMES",
    "HAND_TUNED",
    "LADDER_SCENARIOS",
    "LADDER_SETS",
    "OF_KIND",
    "OVERVIEW",
    "OVERVIEW_SCENARIOS",
    "OVERVIEW_SEEDS",
    "OWN_SPLIT",
    "PACE_TOLERANCE",
    "PAPER",
    "PUBLIC_SPLIT",
    "ROBUST_LEVEL",
    "TEAMS",
    "TRAINED",
    "TRANSFER_SCENARIOS",
    "TRANSFER_SPLIT",
    "TUNED_CROWDS",
    "Bar",
    "Column",
    "Contest",
    "Course",
    "Entrants",
    "Film",
    "Published",
    "Score",
]

CONTESTS: Mapping[str, Contest] = {
    contest.name: contest for contest in (PATH_FOLLOWING, GOAL_OBSTACLES, DOCKING, TRAJECTORY_TRACKING)
}
OF_KIND: Mapping[str, Contest] = {contest.spec.kind: contest for contest in CONTESTS.values()}
ALL_CONTESTS: Mapping[str, Contest] = {  # and those of public benchmarks
    **CONTESTS,
    **{contest.name: contest for contest in (CHALLENGE, OWN_SPEED, MRPB, MOVINGAI, RACETRACKS)},
    **{contest.name: contest for contest in (TEAMS, CROSS, *PEOPLE.values(), *CROWDNAV.values(), ATTNGRAPH)},
}
# Of several bodies: what may be run, and the contests that it stands for.
CROWD_SUITES: Mapping[str, tuple[str, ...]] = {
    "teams": (TEAMS.name,),
    "people": ("people-unseen", "people-seen"),
    "crowdnav": tuple(CROWDNAV),
}

# Values of the option --gains, and the sets of gains that each stands for.
GAINS: Mapping[str, tuple[str, ...]] = {
    **{name: (name,) for name in ("default", "tuned", "robust", "best", "paper")},
    "all": ("default", "tuned", "paper"),
}

FRONT_SCENARIOS = 5  # of each family, at each speed of the front: the fewest that an interval is shown for
LADDER_SCENARIOS = 5  # of each family, at each level
LADDER_SETS = ("default", "tuned", "robust")  # of gains, on the ladder
TRANSFER_SCENARIOS = 5  # of each family of the split that gains were chosen on
OVERVIEW_SCENARIOS = 1  # of each family, in the overview, which shows no intervals
OVERVIEW_SEEDS = 3  # of each agent's training runs there, the first

OVERVIEW, DISTURBANCES = "overview", "disturbances"  # suites of all contests, in part
