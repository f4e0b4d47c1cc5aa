"""The contest of path following: laws of all schools on 13 families of paths, by error, and by error at equal speed."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np

from wayfield.benchmarks.contests import columns
from wayfield.benchmarks.contests.contest import (
    COST,
    DEGREES,
    PACE_TOLERANCE,
    Bar,
    Column,
    Contest,
    Film,
    Heat,
    Score,
    driven,
)
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.statistics.aggregates import iqm
from wayfield.envs.scenarios import TASKS
from wayfield.envs.tasks.specs import Cost
from wayfield.policies.parts.tuned import PACE
from wayfield.policies.registry import entering

_SPEC = TASKS["path_following"]

TRACKING = Cost("tracking_rms", "tracking error", "m", 5, _SPEC.cost.failure)  # after the path is held
BAR = 0.0148  # m, of the presets: tuned pure pursuit's when they were made


def score(rows: Episodes, scenarios: Sequence[Any], speed: float, least: float) -> Score:
    """Returns the failures, whether the requested speed (m/s) is held, and the quality.

    That is the mean over the families of the mean tracking error (mm) of their runs, as the tables have it, where the
    speed is held. Where it is not, it is multiplied by the mean ratio of the time to that at the requested speed: a
    policy that halves its error by taking twice the time gains nothing; and one that is slower than `least` (m/s) comes
    after all that are not. A run that fails counts with the task's cost of a failure.
    """
    won = rows["success"] == 1.0
    errors = 1e3 * np.where(won, rows[TRACKING.metric], TRACKING.failure)
    lengths = np.array([max(each.laps, 1) * each.path.length for each in scenarios])
    late = np.where(won, np.maximum(rows["time"] * speed / lengths, 1e-3), 1.0)
    speeds = rows["mean_speed"][won]
    mean_speed = float(speeds.mean()) if won.any() else math.nan
    held = abs(mean_speed - speed) <= PACE_TOLERANCE * speed
    off_pace = 0 if held else 2 if mean_speed < least - 1e-9 else 1
    families = rows["family"]
    quality = statistics.fmean(float(errors[families == family].mean()) for family in rows.unique("family"))
    if off_pace:
        quality *= math.exp(float(np.log(late).mean()))
    return Score(int((~won).sum()), off_pace, quality, mean_speed, *driven(rows))


def reached(rows: Episodes) -> bool:
    """Returns whether a seed's RMS error on the validation split, failures counted, is under the bar."""
    errors = np.where(rows["success"] == 1.0, rows[_SPEC.cost.metric], rows["failure_cost"])
    return bool(iqm(errors) < BAR)


_WITH_CORNERS = tuple(family for family in _SPEC.families if family.startswith("polylines"))

PATH_FOLLOWING = Contest(
    spec=_SPEC,
    policies=entering(_SPEC.suite),
    claims=("pure_pursuit", "regulated_pure_pursuit", "smooth_pose", "stanley", "lqr", "ilqr", "mpc", "ppo"),
    overview=("pure_pursuit", "regulated_pure_pursuit", "stanley", "mpc", "ppo"),
    env_kwargs={},
    columns=(
        Column("left corridor (%)", "left_corridor", 1, 100.0),
        columns.TIMEOUT,
        Column("RMS error (m)", COST, 4),
        Column("RMS error, IQM (m)", COST, 4, with_interval=True, reduction="iqm"),
        Column("acquisition (s)", "acquisition_time", 2, successes_only=True),
        Column("area (mm s)", "acquisition_area", 1, 1e3, successes_only=True),
        Column("tracking (m)", "tracking_rms", 4, with_interval=True, imputed=True),
        Column("worst (m)", "cross_track_max", 3, reduction="max", imputed=True),
        Column("p95 (m)", "cross_track_p95", 4, imputed=True),
        Column("RMS over time (m)", "cross_track_rms_time", 4, imputed=True),
        Column("mean speed (m/s)", "mean_speed", 3, successes_only=True),
        Column("time (s)", "time", 1, successes_only=True),
        columns.LDLJ,
        columns.EFFORT,
        Column("saturated (%)", "saturated_share", 1, 100.0),
        columns.FAULTS,
    ),
    gap=Column("gap (RMS, m)", COST, 4),
    bar=Bar(f"an RMS error (IQM, validation split) under {BAR} m", reached),
    heat=Heat(COST, "RMS cross-track error of the successes (cm)", 100.0, 1, "viridis_r", (1e-3, 1.0)),
    log_cost=True,
    speeds=(0.3, 0.45, 0.6, 0.75, 0.9, 1.05),
    pace=PACE,
    compared_by=TRACKING,
    counted="an error of 1 m",
    scenes={
        "smooth paths": tuple(family for family in _SPEC.families if family not in _WITH_CORNERS),
        "paths with corners": _WITH_CORNERS,
    },
    notes=(
        "RMS error is over the driven arc length, and every failure counts; IQM is its interquartile mean, which "
        "leaves out the best and the worst quarter of the runs. Acquisition and area last until the path is held, "
        "tracking is the RMS error over time after that. 'worst' is the greatest error of any run. Simulation only."
    ),
    timed_on="splines",
    score=score,
    own_columns=(
        Column("completion", "completion", 2),
        Column("RMS error (m)", "cross_track_rms"),
        Column("over time (m)", "cross_track_rms_time"),
        Column("max (m)", "cross_track_max"),
        Column("mean speed (m/s)", "mean_speed", 2),
        Column("time (s)", "time", 2),
        Column("jumps", "reference_jumps", 0),
        Column("p95 (m)", "cross_track_p95"),
        Column("heading error (deg)", "heading_error_rms", 1, DEGREES),
    ),
    own_note="RMS error over the driven arc length, then over time; jumps are leaps of the reference point.",
    films={
        False: Film("regulated_pure_pursuit", "figure_eights_tangent/train", 1, "p3dx"),
        True: Film("lqr", "s_curves_medium/train", 2, "mecanum4"),
    },
)
