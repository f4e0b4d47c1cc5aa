"""The contest of trajectory tracking: laws that follow a reference in time, by how far from it they are."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.contests import columns
from wayfield.benchmarks.contests.contest import COST, DEGREES, Bar, Column, Contest, Film, Heat, Score, driven
from wayfield.benchmarks.records import episode
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.statistics.aggregates import iqm
from wayfield.envs.scenarios import TASKS
from wayfield.envs.trajectory_tracking import HELD, SETTLED
from wayfield.policies.registry import entering

_SPEC = TASKS["trajectory_tracking"]
_FOLLOWED = tuple(each for each in _SPEC.families if each != "too_fast")
BAR = 0.003  # m, of the preset
SLOWEST = 0.02  # m/s, under which a robot is behind by no time


def _errors(trajectory: Trajectory, after: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the times (s) later than one, and the distances (m) from the reference then; all where none is later."""
    later = trajectory.times > min(after, float(trajectory.times[-2]))
    return trajectory.times[later], np.hypot(trajectory.tracked[later, 0], trajectory.tracked[later, 1])


def _rms(values: NDArray[np.float64]) -> float:
    return math.sqrt(float((values * values).mean()))


def settling(trajectory: Trajectory) -> float:
    """Returns the last time (s) at which the robot was more than HELD from its reference."""
    times, errors = _errors(trajectory)
    far = np.flatnonzero(errors > HELD)
    return float(times[far[-1]]) if len(far) else 0.0


def lag(trajectory: Trajectory) -> float:
    """Returns the time (s) by which a robot comes after its reference: the error by the velocity, least squares."""
    later = trajectory.times > min(SETTLED, float(trajectory.times[-2]))
    velocities, errors = trajectory.twists[later, :2], trajectory.tracked[later, :2]
    moving = np.hypot(*velocities.T) > SLOWEST
    return float((velocities * errors)[moving].sum() / (velocities**2)[moving].sum()) if moving.any() else math.nan


def apart(trajectory: Trajectory) -> tuple[float, float]:
    """Returns the RMS errors (m) after 10 s along and across the way that the reference goes, or looks where it rests.

    Their squares add up to that of the RMS distance from it.
    """
    heading = trajectory.poses[:, 2]
    ex, ey, turn = trajectory.tracked[:, :3].T
    error = np.column_stack([np.cos(heading) * ex - np.sin(heading) * ey, np.sin(heading) * ex + np.cos(heading) * ey])
    ways = np.gradient(trajectory.poses[:, :2] + error, trajectory.dt, axis=0)
    speeds = np.hypot(*ways.T)
    looks = np.column_stack([np.cos(heading + turn), np.sin(heading + turn)])
    ways = np.where(speeds[:, None] > SLOWEST, ways / np.maximum(speeds, SLOWEST)[:, None], looks)
    later = trajectory.times > min(SETTLED, float(trajectory.times[-2]))
    along, across = (error * ways).sum(axis=1), error[:, 1] * ways[:, 0] - error[:, 0] * ways[:, 1]
    return _rms(along[later]), _rms(across[later])


def turn_effort(trajectory: Trajectory) -> float:
    """Returns the mean size of the commanded yaw acceleration, rad/s^2."""
    return float(np.abs(np.diff(trajectory.tracked[:, 3])).mean() / trajectory.dt)


METRICS = {
    episode.Column("position_rms", float, "m", "RMS distance from the reference"): (
        lambda each: _rms(_errors(each)[1])
    ),
    episode.Column("position_rms_after", float, "m", "RMS distance from the reference after 10 s"): (
        lambda each: _rms(_errors(each, SETTLED)[1])
    ),
    episode.Column("position_max", float, "m", "largest distance from the reference"): (
        lambda each: float(_errors(each)[1].max())
    ),
    episode.Column("position_max_after", float, "m", "largest distance from the reference after 10 s"): (
        lambda each: float(_errors(each, SETTLED)[1].max())
    ),
    episode.Column("along_rms_after", float, "m", "RMS error along the motion of the reference after 10 s"): (
        lambda each: apart(each)[0]
    ),
    episode.Column("across_rms_after", float, "m", "RMS error across the motion of the reference after 10 s"): (
        lambda each: apart(each)[1]
    ),
    episode.Column("heading_rms_after", float, "rad", "RMS heading error after 10 s"): (
        lambda each: _rms(each.tracked[each.times > min(SETTLED, float(each.times[-2])), 2])
    ),
    episode.Column("settled_after", float, "s", "last time with a distance over 20 mm"): settling,
    episode.Column("ise", float, "m^2 s", "integral of the squared distance from the reference"): (
        lambda each: float((_errors(each)[1] ** 2).sum() * each.dt)
    ),
    episode.Column("itae", float, "m s^2", "integral of the distance from the reference, weighted by time"): (
        lambda each: float((_errors(each)[0] * _errors(each)[1]).sum() * each.dt)
    ),
    episode.Column("time_lag", float, "s", "time by which the robot comes after its reference, after 10 s"): lag,
    episode.Column("turn_effort", float, "rad/s^2", "mean absolute change of the commanded yaw rate"): turn_effort,
    episode.Column("limited_share", float, "", "share of the time at a limit of speed or acceleration"): (
        lambda each: float(each.tracked[1:, 4].mean())
    ),
    episode.Column("over_floor", float, "", "RMS distance after 10 s over that of a regulator with the model"): (
        lambda each: _rms(_errors(each, SETTLED)[1]) / each.floor
    ),
}


def score(rows: Episodes, scenarios: Sequence[Any], speed: float, least: float) -> Score:
    """Returns the failures, and the mean RMS error (mm) after 10 s as the quality; the reference sets the speed.

    A run that stayed in the tube, but not near enough, counts with its error.
    """
    del scenarios, speed, least
    left = rows[_SPEC.failure] == 1.0
    errors = 1e3 * np.where(left, _SPEC.cost.failure, rows[_SPEC.cost.metric])
    return Score(int(left.sum()), 0, float(errors.mean()), statistics.fmean(rows["mean_speed"]), *driven(rows))


def reached(rows: Episodes) -> bool:
    """Returns whether a seed's error on the validation split, failures counted, is under the bar."""
    errors = np.where(rows["success"] == 1.0, rows[_SPEC.cost.metric], rows["failure_cost"])
    return bool(iqm(errors) < BAR)


TRAJECTORY_TRACKING = Contest(
    spec=_SPEC,
    policies=entering(_SPEC.suite),
    overview=("kanayama", "samson", "tv_lqr"),
    on_request=("timed_mpc",),  # the plans of timed_ilqr, at several times the cost
    env_kwargs={},
    columns=(
        Column("left tube (%)", "left_corridor", 1, 100.0),
        columns.TIMEOUT,
        Column("error after 10 s (mm)", COST, 2, 1e3, with_interval=True),
        Column("IQM (mm)", COST, 2, 1e3, with_interval=True, reduction="iqm"),
        Column("CVaR 0.5 (mm)", COST, 2, 1e3, reduction="cvar"),
        Column("along (mm)", "along_rms_after", 2, 1e3),
        Column("across (mm)", "across_rms_after", 2, 1e3),
        Column("worst (mm)", "position_max_after", 1, 1e3, reduction="max"),
        Column("whole (mm)", "position_rms", 1, 1e3),
        Column("largest (mm)", "position_max", 1, 1e3),
        Column("off the path (mm)", "cross_track_rms_time", 1, 1e3),
        Column("over floor", "over_floor", 1),
        Column("heading (deg)", "heading_rms_after", 2, DEGREES),
        Column("settled (s)", "settled_after", 2),
        Column("behind (ms)", "time_lag", 1, 1e3),
        Column("turning (rad/s²)", "turn_effort", 2),
        Column("effort (rad²/s)", "effort", 0),
        Column("saturated (%)", "saturated_share", 1, 100.0),
        Column("limited (%)", "limited_share", 1, 100.0),
        columns.FAULTS,
    ),
    gap=Column("gap (error, mm)", COST, 2, 1e3),
    bar=Bar(f"an error (IQM, validation split) under {1e3 * BAR:g} mm", reached),
    heat=Heat(COST, "RMS error after 10 s of the successes (mm)", 1e3, 2, "viridis_r", (1e-4, 0.1)),
    log_cost=True,
    counted="an error of 1 m",
    notes=(
        "A success never leaves the tube of 1 m and stays within 20 mm (RMS) after 10 s, or in too_fast within three "
        "times what a regulator with the model leaves. CVaR 0.5 is the mean error of the worse half. Along "
        "and across are by the motion of the reference, after 10 s; off the path is the distance to the nearest point "
        "of it, whenever the robot is there. timed_mpc, which has the plans of timed_ilqr, drives where it is named. "
        "Simulation only."
    ),
    scenes={"references that a base can follow": _FOLLOWED, "too fast": ("too_fast",)},
    tuned_on=_FOLLOWED,
    timed_on="eights",
    score=score,
    own_columns=(
        Column("RMS error (mm)", "position_rms", 1, 1e3),
        Column("after 10 s (mm)", "position_rms_after", 2, 1e3),
        Column("worst after 10 s (mm)", "position_max_after", 1, 1e3),
        Column("heading (deg)", "heading_rms_after", 2, DEGREES),
        Column("settled (s)", "settled_after", 2),
        Column("behind (ms)", "time_lag", 1, 1e3),
        Column("turning (rad/s²)", "turn_effort", 2),
    ),
    own_note="Errors are distances from where the reference is at the time.",
    films={False: Film("samson", "eights/train", 0, "p3dx"), True: Film("pid_omni", "facing_eights/train", 2, "omni3")},
    metrics=METRICS,
)
