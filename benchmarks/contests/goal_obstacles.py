"""The contest of goal reaching: reactive laws, planners and agents on 21 families of scenes, by success and time."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

from wayfield.benchmarks.contests import columns
from wayfield.benchmarks.contests.contest import (
    DEGREES,
    FAULTS_NOTE,
    Bar,
    Column,
    Contest,
    Film,
    Heat,
    Score,
    driven,
)
from wayfield.benchmarks.records.episode import Episodes
from wayfield.envs.scenarios import TASKS
from wayfield.policies.registry import entering

# Of the public benchmarks, where a way is long or a scan dense: 8 ms a decision and more.
ANY = "any_robot"  # which is measured by a study of its own
ON_REQUEST = ("mppi", "nav2_mppi", ANY)
ON_REQUEST_NOTE = "mppi and nav2_mppi take minutes a run: they drive where --policies names them, or says all."
_SPEC = TASKS["goal_reaching"]
BAR_FAMILY, BAR_SUCCESS, BAR_COLLISION = "clutter_10", 0.9, 0.03  # of the presets


def score(rows: Episodes, scenarios: Sequence[Any], speed: float, least: float) -> Score:
    """Returns the failures, and 1 minus the mean SCT as the quality; the requested speed is the most that is driven."""
    del scenarios, speed, least
    won = rows.where(success=1.0)
    mean_speed = statistics.fmean(won["mean_speed"]) if won else math.nan
    quality = 1.0 - statistics.fmean(rows["sct"])
    return Score(len(rows) - len(won), 0, quality, mean_speed, *driven(rows))


def reached(rows: Episodes) -> bool | None:
    """Returns whether a seed reaches the bar of its preset; None without scenes of that family."""
    there = rows.where(family=BAR_FAMILY)
    if not there:
        return None
    won, hit = (statistics.fmean(there[name]) for name in ("success", "collision"))
    return won >= BAR_SUCCESS and hit <= BAR_COLLISION


GOAL_OBSTACLES = Contest(
    spec=_SPEC,
    policies=entering(_SPEC.suite),
    in_rooms=True,
    overview=("apf_corrected", "vfh_plus", "dwa", "scan_planner", "astar_tracker", "ppo", "hybrid"),
    claims=("vfh_plus", "dwa", "orca", "scan_planner", "astar_tracker", "ppo", "hybrid", ANY),
    on_request=(ANY,),
    env_kwargs={"num_beams": 72, "max_range": 5.0},
    columns=(
        columns.COLLISION,
        columns.TIMEOUT,
        columns.SPL,
        columns.SCT,
        Column("BARN", "barn_score", 3),
        columns.IMPUTED,
        columns.TIME,
        Column("least clearance (m)", "min_clearance", 3),
        Column("mean (m)", "mean_clearance", 2),
        Column("under 0.1 m (%)", "near_share", 1, 100.0),
        columns.LDLJ,
        columns.EFFORT,
        columns.FAULTS,
    ),
    gap=Column("gap (success, %)", "success", 1, 100.0),
    bar=Bar(
        f"{100.0 * BAR_SUCCESS:.0f} % successes and at most {100.0 * BAR_COLLISION:.0f} % collisions on the validation "
        f"scenes of {BAR_FAMILY}",
        reached,
    ),
    heat=Heat("success", "success (%)", 100.0, 0, "viridis", (0.0, 1.0)),
    counted="the whole clock in 'imputed'",
    notes=("Policies with the map have more inputs than the others: they are an upper reference. Simulation only."),
    scenes={
        "static obstacles": tuple(name for name, family in _SPEC.families.items() if not family.moving),
        "moving obstacles": tuple(name for name, family in _SPEC.families.items() if family.moving),
    },
    timed_on="clutter_10",
    score=score,
    own_columns=(
        Column("time (s)", "time", 2),
        Column("driven (m)", "path_length", 2),
        Column("mean speed (m/s)", "mean_speed", 2),
        Column("least clearance (m)", "min_clearance", 2),
        Column("final error (m)", "final_position_error"),
        Column("(deg)", "final_heading_error", 1, DEGREES),
        Column("faults", "faults", 0),
    ),
    own_note=FAULTS_NOTE,
    films={
        False: Film("scan_planner", "rooms/train", 1, "turtlebot3", 60.0),
        True: Film("vfh_plus", "moving_crowd/train", 0, "omni4"),
    },
)
