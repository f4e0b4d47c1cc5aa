"""The contest of docking: laws that come to rest at a pose, and a planner, by success, time and how near they end."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np

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
from wayfield.benchmarks.records import episode
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.scenarios import TASKS
from wayfield.policies.registry import entering

_SPEC = TASKS["docking"]
BAR_SUCCESS = 0.8  # of the preset
LEAST_SPEED = 0.02  # m/s, under which a robot drives neither forward nor backward


def direction_changes(trajectory: Trajectory) -> float:
    """Returns how often the motion along the robot's axis changes between forward and backward.

    A creep under LEAST_SPEED is neither.
    """
    forward = trajectory.twists[:, 0] if len(trajectory.twists) else np.empty(0)
    signs = np.sign(forward[np.abs(forward) >= LEAST_SPEED])
    return float((np.diff(signs) != 0.0).sum())


def score(rows: Episodes, scenarios: Sequence[Any], speed: float, least: float) -> Score:
    """Returns the failures, and the mean time of the successes over the clock as the quality; any speed will do."""
    del scenarios, speed, least
    won = rows.where(success=1.0)
    quality = statistics.fmean(won["time"] / _SPEC.cost.failure) if won else 1.0
    mean_speed = statistics.fmean(won["mean_speed"]) if won else math.nan
    return Score(len(rows) - len(won), 0, quality, mean_speed, *driven(rows))


def reached(rows: Episodes) -> bool | None:
    """Returns whether a seed reaches the bar of its preset."""
    return statistics.fmean(rows["success"]) >= BAR_SUCCESS if rows else None


DOCKING = Contest(
    spec=_SPEC,
    policies=entering(_SPEC.suite),
    overview=("polar", "smooth_pose", "smooth_pose_backward", "mpc_pose", "reeds_shepp", "ppo"),
    claims=("polar", "smooth_pose", "smooth_pose_backward", "mpc_pose", "reeds_shepp", "reeds_shepp_scan", "ppo"),
    env_kwargs={"num_beams": 72, "max_range": 5.0},
    columns=(
        columns.COLLISION,
        columns.TIMEOUT,
        Column("position error (mm)", "final_position_error", 1, 1000.0, with_interval=True),
        Column("heading error (mrad)", "final_heading_error", 1, 1000.0, with_interval=True),
        columns.TIME,
        columns.IMPUTED,
        Column("path of successes (m)", "path_length", 2, successes_only=True),
        Column("changes of direction", "direction_changes", 2, successes_only=True),
        Column("SPL", "spl", 3),
        Column("least clearance (m)", "min_clearance", 3),
        columns.LDLJ,
        columns.EFFORT,
        columns.FAULTS,
    ),
    gap=Column("gap (success, %)", "success", 1, 100.0),
    bar=Bar(f"{100.0 * BAR_SUCCESS:.0f} % successes on the validation scenarios", reached),
    heat=Heat("success", "success (%)", 100.0, 0, "viridis", (0.0, 1.0)),
    counted="the whole clock in 'imputed'",
    notes=(
        "Errors are those of the last moment, of all runs. reeds_shepp and apf_corrected have the map; the others "
        "do not see obstacles, so that wall, berth and moving show what that costs. waypoint drives omni "
        "bases only. Simulation only."
    ),
    scenes={
        "free space": ("open", "behind"),
        "wall or parking bay": ("wall", "berth"),
        "moving obstacles": ("moving",),
    },
    timed_on="open",
    score=score,
    own_columns=(
        Column("time (s)", "time", 2),
        Column("final error (m)", "final_position_error"),
        Column("(deg)", "final_heading_error", 1, DEGREES),
        Column("driven (m)", "path_length", 2),
        Column("changes of direction", "direction_changes", 0),
        Column("least clearance (m)", "min_clearance", 2),
        Column("faults", "faults", 0),
    ),
    own_note=f"A success is at rest within 0.05 m and 0.05 rad, unless the file says otherwise. {FAULTS_NOTE}",
    films={
        False: Film("reeds_shepp", "berth/train", 3, "p3dx"),
        True: Film("apf_corrected", "wall/train", 2, "omni3"),
    },
    metrics={
        episode.Column("direction_changes", float, "", "changes between forward and backward"): direction_changes,
    },
    searched_as={"smooth_pose": "smooth_pose_backward"},
)
