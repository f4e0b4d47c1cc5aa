"""Errors of odometry against ground truth: slip, track and radii of the wheels, from displacements over windows.

Over windows of a second, with ds and dth the true displacement and turn and ds_o, dth_o those of odometry,

    ds = a ds_o,   dth = b dth_o + k ds_o

and with B half of the track: slip = 1 - a, track error = a / b - 1, radius error = -k B (1 + track error) / a, those of
`Disturbance`. UMBmark is the fallback with a tape measure.

Source: Borenstein and Feng, Measurement and Correction of Systematic Odometry Errors in Mobile Robots, 1996.
"""

import math

import numpy as np

from wayfield.bridges.identify.estimate import Estimate
from wayfield.bridges.identify.recording import Log
from wayfield.bridges.identify.response import Floats

WINDOW = 1.0  # s
LEAST_WINDOWS = 30
LEAST_TRAVEL, LEAST_TURN = 3.0, 2.0 * math.pi  # m and rad, of all windows together


def odometry_errors(log: Log, half_track: float) -> tuple[Estimate, ...]:
    """Returns slip, track error and radius error with their 95 % intervals; without ground truth, none of them.

    Args:
        log: what was recorded, with a true pose.
        half_track: m, of the base as its odometry has it.
    """
    missing = "ground truth: record a true pose and name it by --truth"
    if len(log.truth_times) < 10:
        return _unseen(missing)
    poses = log.poses if len(log.poses) else _integrated(log.times, log.speeds)
    start, end = max(log.times[0], log.truth_times[0]), min(log.times[-1], log.truth_times[-1])
    edges = start + WINDOW * np.unique((log.truth_times - start) // WINDOW)  # a gap costs nothing
    edges = edges[(edges >= start) & (edges < end)]
    if len(edges) <= LEAST_WINDOWS:
        return _unseen(f"{LEAST_WINDOWS} s of ground truth beside odometry; there are {len(edges)} s")
    ds, dth = _displacements(log.truth_times, log.truth, edges)
    ds_o, dth_o = _displacements(log.times, poses, edges)
    near = np.diff(edges) < 1.5 * WINDOW
    ds, dth, ds_o, dth_o = ds[near], dth[near], ds_o[near], dth_o[near]
    if np.abs(ds_o).sum() < LEAST_TRAVEL or np.abs(dth_o).sum() < LEAST_TURN:
        return _unseen(f"{LEAST_TRAVEL:g} m and {LEAST_TURN:.2g} rad of travel beside ground truth")
    a, a_covariance = _fitted(ds_o[:, None], ds)
    (b, k), turned = _fitted(np.stack([dth_o, ds_o], axis=1), dth)
    slip, track = 1.0 - a[0], a[0] / b - 1.0
    a_error, b_error, k_error = math.sqrt(a_covariance[0, 0]), math.sqrt(turned[0, 0]), math.sqrt(turned[1, 1])
    radius = -k * half_track * (1.0 + track) / a[0]
    track_error = (1.0 + track) * math.hypot(a_error / a[0], b_error / b)
    radius_error = half_track * (1.0 + track) / a[0] * k_error
    return tuple(
        Estimate(name, "", float(value), float(value - 1.96 * error), float(value + 1.96 * error))
        for name, value, error in (("slip", slip, a_error), ("track_error", track, track_error),
                                   ("radius_error", radius, radius_error))
    )  # fmt: skip


def _unseen(missing: str) -> tuple[Estimate, ...]:
    names = ("slip", "track_error", "radius_error")
    return tuple(Estimate(name, "", math.nan, -math.inf, math.inf, missing) for name in names)


def _integrated(times: Floats, speeds: Floats) -> Floats:
    """Returns the poses (n, 3) that twists come to, from the origin on."""
    dt = np.diff(times)
    mean = 0.5 * (speeds[1:] + speeds[:-1])
    heading = np.concatenate([[0.0], np.cumsum(mean[:, 1] * dt)])
    middle = heading[:-1] + 0.5 * mean[:, 1] * dt
    x = np.concatenate([[0.0], np.cumsum(mean[:, 0] * dt * np.cos(middle))])
    y = np.concatenate([[0.0], np.cumsum(mean[:, 0] * dt * np.sin(middle))])
    return np.stack([x, y, heading], axis=1)


def _displacements(times: Floats, poses: Floats, edges: Floats) -> tuple[Floats, Floats]:
    """Returns the way along arcs (m) and the turn (rad) of each window."""
    heading = np.interp(edges, times, np.unwrap(poses[:, 2]))
    x, y = (np.interp(edges, times, poses[:, k]) for k in (0, 1))
    turn = np.diff(heading)
    middle = heading[:-1] + 0.5 * turn
    chord = np.cos(middle) * np.diff(x) + np.sin(middle) * np.diff(y)
    return chord / np.sinc(turn / (2.0 * np.pi)), turn


def _fitted(columns: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Returns the coefficients of least squares, and their covariance."""
    solution: Floats = np.asarray(np.linalg.lstsq(columns, values, rcond=None)[0], np.float64)
    left = values - columns @ solution
    variance = float(left @ left) / max(len(values) - columns.shape[1], 1)
    covariance: Floats = variance * np.linalg.inv(columns.T @ columns)
    return solution, covariance
