"""The metrics: pure functions of a recorded trajectory. NaN where a metric does not apply.

Cross-track and heading errors are weighted by the arc length that was driven along the path, so that a policy gains
nothing by dawdling where it tracks well (Snider, CMU-RI-TR-09-08); `cross_track_rms_time` is the plain mean over the
control periods, as the source documents print it. `acquisition_and_tracking` separates the way to the path from what
follows, and counts time in both. What one task alone is measured by stands with its contest.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.records.episode import METRICS
from wayfield.benchmarks.records.trajectory import Trajectory

Array = NDArray[np.float64]

JUMP = 0.5  # m, by which a reference point must leap within one control period to count as jumping
HELD = 0.02  # m from the path, within which a robot must stay to hold it
HELD_FOR = 1.0  # s
HELD_ALONG = 0.1  # m, by which it must advance along the path in that time: standing on it does not count
NEAR = 0.1  # m, clearance under which a robot counts as close to an obstacle


def measure(trajectory: Trajectory, arrival_radius: float | None = None) -> dict[str, float]:
    """Returns every metric of an episode by name: SI, flags as 0 or 1, NaN where one does not apply.

    Args:
        arrival_radius: m, within which a waypoint or goal counts as arrived at; None leaves the arrivals out.
    """
    length = path_length(trajectory.poses)
    return (
        dict.fromkeys((column.name for column in METRICS), math.nan)
        | outcome(trajectory)
        | {"time": taken(trajectory), "path_length": length, "mean_speed": length / duration(trajectory)}
        | tracking(trajectory)
        | clearance(trajectory)
        | final_pose(trajectory)
        | {"effort": effort(trajectory), "saturated_share": _mean(trajectory.saturated[1:])}
        | smoothness(trajectory)
        | against_the_best(trajectory)
        | {"faults": float(trajectory.faults)}
        | ({} if arrival_radius is None else arrivals(trajectory, arrival_radius))
    )


def outcome(trajectory: Trajectory) -> dict[str, float]:
    """Returns the flags of the episode's end, of which exactly one is 1."""
    collision = trajectory.collision
    left = trajectory.left_corridor and not collision
    success = trajectory.success and not collision and not left and taken(trajectory) <= trajectory.limit
    timeout = not (collision or left or success)
    return {
        "success": float(success),
        "collision": float(collision),
        "left_corridor": float(left),
        "timeout": float(timeout),
    }


def duration(trajectory: Trajectory) -> float:
    """Returns the time from the start to the end, s."""
    return float(trajectory.times[-1] - trajectory.times[0])


def taken(trajectory: Trajectory) -> float:
    """Returns the time on the clock at the end, s: since the robot was `clock_from` m from its start."""
    away = np.hypot(*(trajectory.poses[:, :2] - trajectory.poses[0, :2]).T)
    begun = np.flatnonzero(away >= trajectory.clock_from)
    return float(trajectory.times[-1] - trajectory.times[begun[0]]) if len(begun) else 0.0


def path_length(poses: Array) -> float:
    """Returns the length of the driven polyline through poses (n, 3), m."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def tracking(trajectory: Trajectory) -> dict[str, float]:
    """Returns the metrics of path following; m and rad."""
    if not len(trajectory.arc_lengths):
        return {}
    errors, along = trajectory.cross_track_errors, trajectory.arc_lengths
    return {
        "completion": trajectory.completion,
        "cross_track_rms": math.sqrt(mean_over_arc_length(errors**2, along)),
        "cross_track_rms_time": math.sqrt(_mean(errors[1:] ** 2)),
        "cross_track_mean": mean_over_arc_length(np.abs(errors), along),
        "cross_track_max": float(np.abs(errors).max()),
        "cross_track_p95": quantile_over_arc_length(np.abs(errors), along, 0.95),
        "steady_offset": steady_offset(errors, along),
        "heading_error_rms": math.sqrt(mean_over_arc_length(trajectory.heading_errors**2, along)),
        "reference_jumps": float(reference_jumps(trajectory.references[:, 4], trajectory.lap_length)),
    } | acquisition_and_tracking(trajectory)


def acquisition_and_tracking(trajectory: Trajectory) -> dict[str, float]:
    """Returns the time (s) and the area (m s) until the path is held, and the RMS error (m) over time after that.

    The path is held from the first control period on from which the robot stays within HELD of it for HELD_FOR and
    advances along it by HELD_ALONG: the settling time of control engineering, with a band in metres. The area is the
    integral of the absolute error (IAE; Graham and Lathrop, Trans. AIEE 72, 1953), by the trapezoidal rule. Both count
    time, so that turning on the spot before setting off is paid for. Of a run that never holds the path all is
    acquisition, and the RMS is over all of it.
    """
    held = _held_from(trajectory)
    last = len(trajectory.times) - 1 if held is None else held
    errors = np.abs(trajectory.cross_track_errors)
    before = errors[: last + 1]
    return {
        "acquisition_time": float(trajectory.times[last] - trajectory.times[0]),
        "acquisition_area": float((0.5 * (before[1:] + before[:-1])).sum() * trajectory.dt),
        "tracking_rms": math.sqrt(_mean(errors[(held or 0) + 1 :] ** 2)),
    }


def _held_from(trajectory: Trajectory) -> int | None:
    """Returns the control period from which the path is held; None where it never is."""
    periods = round(HELD_FOR / trajectory.dt)
    near = np.abs(trajectory.cross_track_errors) <= HELD
    outside = np.concatenate([[0], np.cumsum(~near)])
    along = trajectory.arc_lengths
    starts = np.arange(max(len(near) - periods, 0))
    stays = outside[starts + periods + 1] == outside[starts]
    begun = along[starts + periods] - along[starts] >= HELD_ALONG
    steps = np.flatnonzero(stays & begun)
    return int(steps[0]) if len(steps) else None


def mean_over_arc_length(values: Array, arc_lengths: Array) -> float:
    """Returns the mean of values (n,) over the arc length (n,) that never falls; NaN when nothing was driven."""
    advance = np.diff(arc_lengths)
    total = advance.sum()
    if not total > 0.0:
        return math.nan
    return float((advance * 0.5 * (values[1:] + values[:-1])).sum() / total)


def quantile_over_arc_length(values: Array, arc_lengths: Array, share: float) -> float:
    """Returns the least value that holds on at least `share` of the arc length; NaN when nothing was driven."""
    advance = np.diff(arc_lengths)
    if not advance.sum() > 0.0:
        return math.nan
    middle = 0.5 * (values[1:] + values[:-1])
    order = np.argsort(middle, kind="stable")
    covered = np.cumsum(advance[order])
    return float(middle[order][np.searchsorted(covered, share * covered[-1])])


def steady_offset(errors: Array, arc_lengths: Array) -> float:
    """Returns the mean signed cross-track error over the last quarter of the driven arc length, m."""
    last = arc_lengths >= arc_lengths[0] + 0.75 * (arc_lengths[-1] - arc_lengths[0])
    return mean_over_arc_length(errors[last], arc_lengths[last])


def reference_jumps(reference_arc_lengths: Array, lap_length: float = 0.0) -> int:
    """Returns how often the reference point leapt by more than JUMP; a new lap of a closed path is no leap."""
    leaps = np.diff(reference_arc_lengths)
    if lap_length > 0.0:
        leaps = (leaps + 0.5 * lap_length) % lap_length - 0.5 * lap_length
    return int((np.abs(leaps) > JUMP).sum())


def clearance(trajectory: Trajectory) -> dict[str, float]:
    """Returns the clearances, m, and the distance at which the centre passed the centres of obstacles."""
    if not len(trajectory.obstacles) and not len(trajectory.walls):
        return {}
    away = trajectory.poses[:, None, :2] - np.column_stack([trajectory.obstacles["x"], trajectory.obstacles["y"]])
    return {
        "min_clearance": float(trajectory.clearances.min()),
        "mean_clearance": _mean(trajectory.clearances),
        "near_share": _mean((trajectory.clearances < NEAR).astype(np.float64)),
        **({"centre_distance": float(np.hypot(away[..., 0], away[..., 1]).min())} if away.size else {}),
    }


def final_pose(trajectory: Trajectory) -> dict[str, float]:
    """Returns where the episode ended, and how far from the goal pose; errors are absolute."""
    x, y, heading = trajectory.poses[-1].tolist()
    place = {"final_x": x, "final_y": y}
    if not len(trajectory.goals):
        return place
    goal_x, goal_y, goal_heading = trajectory.goals[-1].tolist()
    return place | {
        "final_x_error": abs(goal_x - x),
        "final_y_error": abs(goal_y - y),
        "final_position_error": math.hypot(goal_x - x, goal_y - y),
        "final_heading_error": _turn(goal_heading - heading),
    }


def arrivals(trajectory: Trajectory, radius: float) -> dict[str, float]:
    """Returns when each waypoint, in order, and then the goal was first nearer than `radius` (m); NaN when never.

    With the last arrival come the path length and the absolute heading error there.
    """
    columns = {f"arrival_time_{j + 1}": math.nan for j in range(len(trajectory.goals))}
    k = 0
    for j, (x, y, heading) in enumerate(trajectory.goals.tolist()):
        distance = np.hypot(trajectory.poses[k:, 0] - x, trajectory.poses[k:, 1] - y)
        inside = np.flatnonzero(distance < radius)
        if not len(inside):
            break
        k += int(inside[0])
        columns[f"arrival_time_{j + 1}"] = float(trajectory.times[k] - trajectory.times[0])
        if j == len(trajectory.goals) - 1:
            columns["arrival_path_length"] = path_length(trajectory.poses[: k + 1])
            columns["arrival_heading_error"] = _turn(heading - float(trajectory.poses[k, 2]))
    return columns


def effort(trajectory: Trajectory) -> float:
    """Returns the integral of the squared wheel speeds, rad^2/s."""
    if not trajectory.wheel_speeds.size:
        return math.nan
    return float((trajectory.wheel_speeds[1:] ** 2).sum() * trajectory.dt)


def smoothness(trajectory: Trajectory) -> dict[str, float]:
    """Returns the log dimensionless jerk of the velocity, higher is smoother, and the integrated squared jerk, m^2/s^5.

    LDLJ = -ln(T^3 / v_peak^2 * integral of |d^2 v / dt^2|^2 dt), with v the planar velocity in the world frame
    (Balasubramanian et al., J. NeuroEng. Rehabil. 12:112, 2015). It does not depend on the duration, the jerk does.
    With them comes the mean |dv|/dt of the speed, m/s^2, lower is smoother: MRPB's velocity smoothness (metrics.cpp).
    """
    if len(trajectory.twists) < 4:
        return {}
    heading, (vx, vy, _) = trajectory.poses[:, 2], trajectory.twists.T
    velocity = np.column_stack(
        [np.cos(heading) * vx - np.sin(heading) * vy, np.sin(heading) * vx + np.cos(heading) * vy]
    )
    jerk = np.diff(velocity, 2, axis=0) / trajectory.dt**2
    squared_jerk = float((jerk**2).sum() * trajectory.dt)
    rate = {"velocity_smoothness": float(np.abs(np.diff(np.hypot(vx, vy))).mean() / trajectory.dt)}
    peak = float((velocity**2).sum(axis=1).max())
    if not squared_jerk > 0.0 or not peak > 0.0:
        return {"squared_jerk": squared_jerk} | rate
    return rate | {"ldlj": -math.log(duration(trajectory) ** 3 / peak * squared_jerk), "squared_jerk": squared_jerk}


def against_the_best(trajectory: Trajectory) -> dict[str, float]:
    """Returns SPL, SCT and the BARN scores: the success, weighted with how near to the best way and time it came.

    SPL = S l / max(p, l) (Anderson et al., arXiv 1807.06757); SCT = S t_ref / max(t, t_ref) with t_ref from
    `fastest_time` (Yokoyama et al., arXiv 2103.08022); BARN = S OT / clip(T, 2 OT, 8 OT), as the BARN challenge scores
    from 2024 on, or clip(T, 4 OT, 8 OT), as in 2022, with T the time on the clock. In the worlds of the challenge OT
    and the clock are its own (`optimal_time` and `clock_from` of the trajectory); everywhere else the formula alone is
    the challenge's, with OT = l / v, so that scores compare with each other and with no others. All times are against
    v = `max_speed` of the trajectory, the speed that a contest requests, or the base's without a request.
    """
    if math.isnan(trajectory.shortest):
        return {}
    success = outcome(trajectory)["success"]
    time, length = duration(trajectory), trajectory.shortest
    best = fastest_time(length, trajectory.max_speed, trajectory.acceleration)
    optimal = trajectory.optimal_time
    if math.isnan(optimal):
        optimal = length / trajectory.max_speed
    on_clock = min(taken(trajectory), 8.0 * optimal)
    return {
        "spl": success * length / max(path_length(trajectory.poses), length),
        "sct": success * best / max(time, best),
        "barn_score": success * optimal / max(on_clock, 2.0 * optimal),
        "barn_score_2022": success * optimal / max(on_clock, 4.0 * optimal),
    }


def fastest_time(length: float, max_speed: float, acceleration: float) -> float:
    """Returns the least time (s) for a way of `length` (m), from rest, under bounds of speed and acceleration."""
    ramp = 0.5 * max_speed**2 / acceleration  # m, until the bound of speed is reached
    if length < ramp:
        return math.sqrt(2.0 * length / acceleration)
    return max_speed / acceleration + (length - ramp) / max_speed


def _turn(angle: float) -> float:
    """Returns the absolute value of an angle taken the short way round, rad."""
    return abs(math.remainder(angle, 2.0 * math.pi))


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else math.nan
