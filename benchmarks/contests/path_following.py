"""The contest of path following: laws of all schools on 13 families of paths, by error, and by error at equal speed."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np

from wayfield.benchmarks.aggregates import iqm
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
from wayfield.benchmarks.results import Row, number
from wayfield.envs.scenarios import TASKS
from wayfield.policies.tuned import PACE

_SPEC = TASKS["path_following"]

LEAST_ERROR = 1e-3  # m, below which errors are alike
BAR = 0.0148  # m, of the presets: tuned pure pursuit's when they were made


def score(rows: Sequence[Row], scenarios: Sequence[Any], speed: float, least: float) -> Score:
    """Returns the failures, whether the asked speed (m/s) is held, and the quality of the successes.

    That is the mean of ln(RMS error / 1 mm) where the speed is held. Where it is not, ln(time / time at the asked
    speed) is added: a policy that halves its error by taking twice the time gains nothing; and one that is slower than
    `least` (m/s) comes after all that are not. A run that fails counts with the task's cost of a failure.
    """
    speeds, terms = [], []
    for row, scenario in zip(rows, scenarios, strict=True):
        if number(row, "success") != 1.0:
            terms.append((math.log(_SPEC.cost.failure / LEAST_ERROR), 0.0))
            continue
        length = max(scenario.laps, 1) * scenario.path.length
        late = math.log(max(number(row, "time") * speed / length, 1e-3))
        terms.append((math.log(max(number(row, _SPEC.cost.metric), LEAST_ERROR) / LEAST_ERROR), late))
        speeds.append(number(row, "mean_speed"))
    mean_speed = statistics.fmean(speeds) if speeds else math.nan
    held = abs(mean_speed - speed) <= PACE_TOLERANCE * speed
    off_pace = 0 if held else 2 if mean_speed < least - 1e-9 else 1
    error, late = (statistics.fmean(each) for each in zip(*terms, strict=True))
    return Score(
        len(rows) - len(speeds), off_pace, max(error + (late if off_pace else 0.0), 0.0), mean_speed, *driven(rows)
    )


def reached(rows: Sequence[Row]) -> bool:
    """Returns whether a seed's RMS error on the validation split, failures counted, is under the bar."""
    errors = [
        number(row, _SPEC.cost.metric) if number(row, "success") == 1.0 else number(row, "failure_cost") for row in rows
    ]
    return bool(iqm(np.array(errors)) < BAR)


PATH_FOLLOWING = Contest(
    spec=_SPEC,
    policies=(
        *("lookahead_documented", "lookahead_retuned", "pure_pursuit", "regulated_pure_pursuit", "smooth_pose"),
        *("stanley", "lqr", "mpc", "ppo"),
    ),
    overview=("pure_pursuit", "regulated_pure_pursuit", "stanley", "mpc", "ppo"),
    env_kwargs={},
    columns=(
        Column("RMS error (m)", COST, 4, reduction="mean"),
        Column("typical (m)", COST, 4, with_interval=True),
        Column("after 1 m (m)", "settled_rms", 4, with_interval=True, imputed=True),
        Column("worst (m)", "cross_track_max", 3, reduction="max", imputed=True),
        Column("p95 (m)", "cross_track_p95", 4, imputed=True),
        Column("RMS over time (m)", "cross_track_rms_time", 4, imputed=True),
        Column("mean speed (m/s)", "mean_speed", 3, successes_only=True, reduction="mean"),
        Column("time (s)", "time", 1, successes_only=True),
        Column("LDLJ", "ldlj", 2),
        Column("effort (rad²/s)", "effort", 0, successes_only=True),
        Column("saturated (%)", "saturated_share", 1, 100.0, reduction="mean"),
        Column("faults", "faults", 2, reduction="mean"),
    ),
    gap=Column("gap (RMS, m)", COST, 4),
    bar=Bar(f"an RMS error (IQM, validation split) under {BAR} m", reached),
    heat=Heat(COST, "RMS cross-track error of the successes (cm)", 100.0, 1, "viridis_r", (1e-3, 1.0)),
    log_cost=True,
    speeds=(0.3, 0.45, 0.6, 0.75, 0.9, 1.05),
    pace=PACE,
    ranked=((COST, 1.0),),
    counted="an RMS error of 1 m",
    notes=(
        "RMS error is the mean over all runs, in which every failure counts; 'typical' is the interquartile mean, "
        "which a few failures leave as it is, and so is 'after 1 m', where the start beside the path is left out. "
        "'worst' is the greatest error of any run. Simulation only."
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
