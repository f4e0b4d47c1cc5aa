"""The contests of several bodies: teams of one law or of two, and one robot among people. A world is an episode.

People are met twice, with eyes for the robot and without, since that decides more than anything else, and on request by
other laws of walking.
"""

import dataclasses
import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from wayfield.benchmarks.contests import columns
from wayfield.benchmarks.contests.contest import COST, FAULTS_NOTE, Column, Contest, Film, Heat, Score, driven
from wayfield.benchmarks.records.cases import Rules
from wayfield.benchmarks.records.episode import Episodes
from wayfield.envs.crowds.people import LAWS
from wayfield.envs.tasks.specs import CROWDS
from wayfield.policies.registry import entering

_TEAMS, _PEOPLE = CROWDS["teams"], CROWDS["people"]
ON_REQUEST = ("mppi", "nav2_mppi", "nav2_dwb", "central")  # the last plans minutes for 32 at one door
OWN_LAW = "own"  # people walk by the laws of their scenario
PEOPLE_LAWS = (OWN_LAW, *(name for name in LAWS if name not in ("replay", "standing")))
CASES, CLOCK = 500, 500  # CrowdNav's tests, and their 25 s in control periods
_TARGET = 1.0  # m/s, CrowdNav's robot


def score(rows: Episodes, scenarios: Sequence[Any], speed: float, least: float) -> Score:
    """Returns the worlds that failed, and the mean extra time of the others over the clock as the quality."""
    del scenarios, speed, least
    won = rows.where(success=1.0)
    quality = statistics.fmean(won["extra_time"]) / 120.0 if won else 1.0
    return Score(
        len(rows) - len(won),
        0,
        max(quality, 0.0),
        statistics.fmean(won["mean_speed"]) if won else math.nan,
        *driven(rows),
    )


_TIMES = (
    Column("extra time (s)", "extra_time", 1, successes_only=True),
    Column("75th percentile (s)", "extra_time_p75", 1, successes_only=True),
    Column("90th percentile (s)", "extra_time_p90", 1, successes_only=True),
    columns.IMPUTED,
)
_TO_PEOPLE = (
    Column("least gap to people (m)", "least_gap_people", 3),
    Column("within 0.45 m (%)", "intimate_share", 1, 100.0),
    Column("within 0.5 m (%)", "close_share", 1, 100.0),
    Column("within 1.2 m (%)", "personal_share", 1, 100.0),
    Column("gap under 0.2 m (%)", "danger_share", 1, 100.0),
    Column("intrusion (%)", "intrusion", 1, 100.0),
    Column("gap then (m)", "intrusion_gap", 3),
    Column("people slowed (m/s)", "people_slowed", 3),
    Column("people later (s)", "people_extra_time", 2),
)
_NOTES = (
    "A world is one episode and the unit of all intervals, since its bodies are not independent: a success is a world "
    "in which every robot arrives untouched. Extra time is beside the straight way at the speed asked for. "
)

TEAMS = Contest(
    spec=_TEAMS,
    policies=entering(_TEAMS.suite),
    overview=(),
    env_kwargs={"sees": "bodies", "num_beams": 72, "max_range": 5.0},
    columns=(
        Column("arrived (%)", "arrived", 1, 100.0, with_interval=True),
        columns.COLLISION,
        Column("robots that touched a robot (%)", "touched_robot", 1, 100.0),
        Column("a wall (%)", "touched_wall", 1, 100.0),
        Column("stuck (%)", "stuck", 1, 100.0),
        Column("deadlock (%)", "deadlock", 1, 100.0),
        *_TIMES,
        Column("makespan ratio", "makespan_ratio", 2, successes_only=True),
        Column("flow (1/(m s))", "flow_rate", 3, successes_only=True),
        Column("SPL", "spl", 3),
        Column("fairness", "fairness", 3),
        Column("least gap (m)", "least_gap", 3),
        columns.LDLJ,
        columns.FAULTS,
    ),
    gap=None,
    bar=None,
    heat=Heat("success", "worlds in which all arrive (%)", 100.0, 0, "viridis", (0.0, 1.0)),
    ranked=(("success", -1.0), ("arrived", -1.0), (COST, 1.0)),
    counted="the whole clock in 'imputed'",
    notes=_NOTES + "Who arrives leaves the world, who touches something stays where it was. Simulation only.",
    timed_on="crowdnav_5",
    score=score,
    own_columns=(),
    own_note=FAULTS_NOTE,
    films={
        False: Film("orca_team", "circle_8/test", 0, "p3dx", 40.0),
        True: Film("orca_team", "crossing_4/test", 0, "omni3"),
    },
    scenes={
        "open": tuple(name for name, family in _TEAMS.families.items() if not family.walled),
        "walls": tuple(name for name, family in _TEAMS.families.items() if family.walled),
    },
    on_request=ON_REQUEST,
)

CROSS = dataclasses.replace(
    TEAMS,
    cross=True,
    label="teams-cross",
    heading="Teams, half and half",
    columns=(
        Column("its own arrived (%)", "arrived", 1, 100.0, with_interval=True),
        Column("the others arrived (%)", "arrived_beside", 1, 100.0, with_interval=True),
        *TEAMS.columns[1:],
    ),
    ranked=(("arrived", -1.0), ("success", -1.0)),
    notes=_NOTES + "Every other robot, from the second on, is driven by the policy beside, with its default gains.",
)


def _people(law: str, seen: bool) -> Contest:
    """Returns the contest among people who walk by a law and see the robot or not."""
    words = "who see the robot" if seen else "who do not see the robot"
    walking = "" if law == OWN_LAW else f", all by {law}"
    chosen: Mapping[str, Any] = {} if law == OWN_LAW else {"people": law}
    names = ["people", *(() if law == OWN_LAW else (law,)), "seen" if seen else "unseen"]
    return dataclasses.replace(
        TEAMS,
        spec=_PEOPLE,
        policies=entering(_PEOPLE.suite),
        env_kwargs={**TEAMS.env_kwargs, "visible": seen, **chosen},
        columns=(
            columns.COLLISION,
            Column("with people (%)", "touched_person", 1, 100.0),
            Column("of it caused (%)", "caused", 1, 100.0),
            Column("stuck (%)", "stuck", 1, 100.0),
            *_TIMES,
            Column("SPL", "spl", 3),
            *_TO_PEOPLE,
            columns.LDLJ,
            columns.FAULTS,
        ),
        ranked=(("success", -1.0), (COST, 1.0)),
        notes=_NOTES + f"Among people {words}{walking}. Gaps are between hulls. Simulation only.",
        films={
            False: Film("orca_team", "crossing_flow_8/test", 0, "p3dx"),
            True: Film("orca_team", "crossing_flow_16/test", 0, "omni3"),
        },
        scenes={},
        label="-".join(names),
        tuned_in=f"people-{names[-1]}",
        heading=f"Among people {words}{walking}",
    )


PEOPLE = {contest.name: contest for law in PEOPLE_LAWS for seen in (False, True) for contest in (_people(law, seen),)}


def people_contests(laws: Sequence[str]) -> tuple[str, ...]:
    """Returns the names of the contests among people of some laws, or of "all", each with eyes and without."""
    wanted = PEOPLE_LAWS if "all" in laws else tuple(law for law in PEOPLE_LAWS if law in laws)
    return tuple(_people(law, seen).name for law in wanted for seen in (False, True))


CROWDNAV = {
    contest.name: contest
    for seen in (False, True)
    for contest in (
        dataclasses.replace(
            PEOPLE["people-seen" if seen else "people-unseen"],
            label="crowdnav-seen" if seen else "crowdnav",
            tuned_in="crowdnav-seen" if seen else "crowdnav",
            tuned_on=("crowdnav_5",),
            heading=f"CrowdNav's tests, the robot {'seen' if seen else 'unseen'}",
            rules=Rules(_TARGET, limit=25.0),
            notes=_NOTES
            + "Cases, clock (25 s) and tolerance are CrowdNav's; the robot, its period and its actuators are ours. "
            f"RVO2 drives {'100.0 % of the cases in 10.02 s' if seen else '42.6 % of the cases in 10.86 s'} by "
            "CrowdNav's own rules: a disc of 0.3 m that takes up any velocity up to 1 m/s every 0.25 s.",
        ),
    )
}

# for as long as AttnGraph gives its robot
ATTNGRAPH = dataclasses.replace(
    PEOPLE["people-unseen"],
    label="attngraph",
    heading="AttnGraph's crowd of 20, the robot unseen",
    tuned_in="attngraph",
    tuned_on=("attngraph_20",),
    rules=Rules(_TARGET, limit=50.0),
)
# those that gains are searched for apart
TUNED_CROWDS = (TEAMS, PEOPLE["people-unseen"], PEOPLE["people-seen"], *CROWDNAV.values(), ATTNGRAPH)
