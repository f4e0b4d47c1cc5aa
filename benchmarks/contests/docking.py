"""The contest of docking: laws that come to rest at a pose, and a planner, by success, time and how near they end."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

from wayfield.benchmarks.contests.contest import COST, Column, Contest, Heat, Score, driven
from wayfield.benchmarks.results import Row, number
from wayfield.envs.scenarios import TASKS

_SPEC = TASKS["docking"]


def score(rows: Sequence[Row], scenarios: Sequence[Any], speed: float, least: float) -> Score:
    """Returns the failures, and the mean time of the successes over the clock as the quality; no speed is asked for."""
    del scenarios, speed, least
    won = [row for row in rows if number(row, "success") == 1.0]
    quality = statistics.fmean(number(row, "time") / _SPEC.cost.failure for row in won) if won else 1.0
    mean_speed = statistics.fmean(number(row, "mean_speed") for row in won) if won else math.nan
    return Score(len(rows) - len(won), 0, quality, mean_speed, *driven(rows))


DOCKING = Contest(
    spec=_SPEC,
    policies=(
        *("polar", "smooth_pose", "smooth_pose_backward", "mpc_pose", "reeds_shepp", "waypoint", "apf_corrected"),
        *("zero", "random"),
    ),
    env_kwargs={"num_beams": 72, "max_range": 5.0},
    columns=(
        Column("collision (%)", "collision", 1, 100.0, reduction="mean"),
        Column("position error (mm)", "final_position_error", 1, 1000.0, with_interval=True),
        Column("heading error (mrad)", "final_heading_error", 1, 1000.0, with_interval=True),
        Column("time of successes (s)", "time", 1, successes_only=True),
        Column("imputed (s)", COST, 1, with_interval=True, reduction="mean"),
        Column("path of successes (m)", "path_length", 2, successes_only=True),
        Column("changes of direction", "direction_changes", 2, successes_only=True, reduction="mean"),
        Column("SPL", "spl", 3, reduction="mean"),
        Column("least clearance (m)", "min_clearance", 3),
        Column("LDLJ", "ldlj", 2),
        Column("effort (rad²/s)", "effort", 0, successes_only=True),
        Column("faults", "faults", 2, reduction="mean"),
    ),
    gap=Column("gap (success, %)", "success", 1, 100.0, reduction="mean"),
    bar=None,
    heat=Heat("success", "success (%)", 100.0, 0, "viridis", (0.0, 1.0)),
    log_cost=False,
    speeds=(),
    pace=None,
    ranked=(("success", -1.0), (COST, 1.0)),
    counted="the whole clock in 'imputed'",
    notes=(
        "Errors are those of the last moment, of all runs. reeds_shepp and apf_corrected are told the map; the others "
        "do not see what stands around, so that wall, berth and moving show what that costs. waypoint drives omni "
        "bases only. Simulation only."
    ),
    timed_on="open",
    score=score,
)
