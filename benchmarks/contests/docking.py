"""The contest of docking: laws that come to rest at a pose, and a planner, by success, time and how near they end."""

import statistics
from collections.abc import Sequence
from typing import Any

from wayfield.benchmarks.contests.contest import COST, Column, Contest, Heat
from wayfield.benchmarks.results import Row, number
from wayfield.envs.scenarios import TASKS

_SPEC = TASKS["docking"]


def score(rows: Sequence[Row], scenarios: Sequence[Any]) -> float:
    """Returns the mean over the scenarios of the time over the clock, 2 where a run failed."""
    terms = [number(row, "time") / _SPEC.cost.failure if number(row, "success") == 1.0 else 2.0 for row in rows]
    assert len(rows) == len(scenarios)
    return statistics.fmean(terms)


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
        Column("time (s)", "time", 1, successes_only=True),
        Column("imputed (s)", COST, 1),
        Column("path (m)", "path_length", 2, successes_only=True),
        Column("direction changes", "direction_changes", 2, successes_only=True, reduction="mean"),
        Column("SPL", "spl", 3, reduction="mean"),
        Column("least clearance (m)", "min_clearance", 3),
        Column("LDLJ", "ldlj", 2),
        Column("effort (rad²/s)", "effort", 0, successes_only=True),
        Column("faults", "faults", 2, reduction="mean"),
    ),
    gap=Column("gap (success, %)", "success", 1, 100.0, reduction="mean"),
    heat=Heat("success", "success (%)", 100.0, 0, "viridis", (0.0, 1.0)),
    log_cost=False,
    speeds=(),
    counted="the whole clock in 'imputed'",
    notes=(
        "Errors are those of the last moment, of all runs. reeds_shepp and apf_corrected are told the map; the others "
        "do not see what stands around, so that wall, berth and moving show what that costs. waypoint drives omni "
        "bases only. Simulation only."
    ),
    timed_on="open",
    score=score,
)
