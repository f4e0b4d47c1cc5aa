"""Every metric in plain loops, and the unit that it is printed with, on random trajectories."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from wayfield.benchmarks.episodes.metrics import METRICS, measure
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.scenarios import box, circle, obstacle_field

DT = 0.05
RADIUS = 0.6  # m, of an arrival
SEEDS = range(24)


def driven(seed: int) -> Trajectory:
    """Returns an episode in which everything that is measured happens."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(30, 90))
    turns = np.cumsum(rng.normal(0.0, 0.15, n + 1)) + 3.0
    speeds = np.abs(rng.normal(0.5, 0.3, n + 1))
    steps = DT * speeds[1:, None] * np.column_stack([np.cos(turns[1:]), np.sin(turns[1:])])
    places = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]) + rng.uniform(-3.0, 3.0, 2)
    poses = np.column_stack([places, np.remainder(turns + math.pi, 2.0 * math.pi) - math.pi])
    along = 0.4 + np.cumsum(np.maximum(rng.normal(0.05, 0.06, n + 1), 0.0))
    lap = float(rng.choice([0.0, 2.0]))
    references = rng.normal(size=(n + 1, 5))
    references[:, 4] = np.cumsum(rng.choice([0.02, 0.3, 0.9, -0.7], n + 1, p=[0.7, 0.2, 0.05, 0.05]))
    if lap:
        references[:, 4] %= lap
    goals = np.column_stack([places[[n // 3, n]] + rng.normal(0.0, 0.3, (2, 2)), rng.uniform(-3.0, 3.0, 2)])
    return Trajectory(
        times=rng.uniform(0.0, 9.0) + np.arange(n + 1) * DT,
        poses=poses,
        twists=np.column_stack([speeds, rng.normal(0.0, 0.1, n + 1), rng.normal(0.0, 0.5, n + 1)]),
        wheel_speeds=rng.normal(0.0, 5.0, (n + 1, 2)),
        saturated=(rng.random(n + 1) < 0.3).astype(float),
        clearances=np.abs(rng.normal(0.15, 0.1, n + 1)),
        arc_lengths=along,
        cross_track_errors=rng.normal(0.05, 0.1, n + 1),
        heading_errors=rng.normal(0.0, 0.3, n + 1),
        references=references,
        lap_length=lap,
        completion=float(rng.random()),
        goals=goals,
        obstacles=obstacle_field(circle(*rng.uniform(-2.0, 2.0, 2), 0.2), box(*rng.uniform(-2.0, 2.0, 2), 0.4, 0.2)),
        success=bool(rng.random() < 0.7),
        collision=bool(rng.random() < 0.2),
        left_corridor=bool(rng.random() < 0.2),
        faults=int(rng.integers(3)),
        clock_from=float(rng.choice([0.0, 0.1])),
        limit=float(rng.choice([math.inf, 3.0])),
        shortest=float(rng.uniform(0.2, 2.5)),
        max_speed=float(rng.uniform(0.4, 1.2)),
        optimal_time=float(rng.choice([math.nan, 0.7])),
        acceleration=float(rng.choice([math.inf, 0.5])),
    )


def short_way(angle: float) -> float:
    return abs(math.atan2(math.sin(angle), math.cos(angle)))


def over_arc(values: Any, along: Any) -> float:
    total = sum(0.5 * (values[k] + values[k + 1]) * (along[k + 1] - along[k]) for k in range(len(along) - 1))
    return float(total / (along[-1] - along[0]))


def restated(t: Trajectory) -> dict[str, float]:
    n = len(t.times) - 1
    x, y, heading = t.poses.T
    e, s = t.cross_track_errors, t.arc_lengths
    far = [k for k in range(n + 1) if math.dist(t.poses[k, :2], t.poses[0, :2]) >= t.clock_from]
    taken = t.times[n] - t.times[far[0]] if far else 0.0
    success = t.success and not t.collision and not t.left_corridor and taken <= t.limit
    left = t.left_corridor and not t.collision
    length = sum(math.dist(t.poses[k, :2], t.poses[k + 1, :2]) for k in range(n))
    found = {
        "success": success, "collision": t.collision, "left_corridor": left,
        "timeout": not success and not left and not t.collision,
        "time": taken, "path_length": length, "mean_speed": length / (n * DT), "completion": t.completion,
        "cross_track_rms": math.sqrt(over_arc(e**2, s)), "cross_track_mean": over_arc(abs(e), s),
        "cross_track_rms_time": math.sqrt(sum(v * v for v in e[1:]) / n), "cross_track_max": max(abs(e)),
        "heading_error_rms": math.sqrt(over_arc(t.heading_errors**2, s)),
    }  # fmt: skip
    # the least of the errors that hold on 95 % of the way
    pieces = sorted((0.5 * (abs(e[k]) + abs(e[k + 1])), s[k + 1] - s[k]) for k in range(n))
    gone = 0.0
    for value, way in pieces:
        gone += way
        if gone >= 0.95 * (s[n] - s[0]) - 1e-12:
            found["cross_track_p95"] = value
            break
    last = [k for k in range(n + 1) if s[k] >= s[0] + 0.75 * (s[n] - s[0])]
    found["steady_offset"] = over_arc(e[last], s[last])
    second = round(1.0 / DT)
    held = None
    for k in range(n + 1 - second):
        if held is None and max(abs(e[k : k + second + 1])) <= 0.02 and s[k + second] - s[k] >= 0.1:
            held = k
    last = n if held is None else held
    found["acquisition_time"] = last * DT
    found["acquisition_area"] = DT * sum(0.5 * (abs(e[k]) + abs(e[k + 1])) for k in range(last))
    tail = e[1:] if held is None else e[held + 1 :]
    found["tracking_rms"] = math.sqrt(sum(v * v for v in tail) / len(tail))
    leaps = [t.references[k + 1, 4] - t.references[k, 4] for k in range(n)]
    if t.lap_length:
        leaps = [math.remainder(leap, t.lap_length) for leap in leaps]
    found["reference_jumps"] = sum(abs(leap) > 0.5 for leap in leaps)
    found["min_clearance"], found["mean_clearance"] = min(t.clearances), sum(t.clearances) / (n + 1)
    found["near_share"] = sum(c < 0.1 for c in t.clearances) / (n + 1)
    found["centre_distance"] = min(math.dist(pose[:2], (o["x"], o["y"])) for pose in t.poses for o in t.obstacles)
    found |= {"final_x": x[n], "final_y": y[n]}
    gx, gy, gh = t.goals[-1]
    found |= {"final_x_error": abs(gx - x[n]), "final_y_error": abs(gy - y[n])}
    found |= {
        "final_position_error": math.dist((gx, gy), (x[n], y[n])),
        "final_heading_error": short_way(gh - heading[n]),
    }
    found["effort"] = DT * sum(w * w for wheels in t.wheel_speeds[1:] for w in wheels)
    found["saturated_share"] = sum(t.saturated[1:]) / n
    v = [complex(a, b) * complex(math.cos(h), math.sin(h)) for (a, b, _), h in zip(t.twists, heading, strict=True)]
    jerk = DT * sum(abs(v[k] - 2.0 * v[k + 1] + v[k + 2]) ** 2 for k in range(n - 1)) / DT**4
    found["squared_jerk"] = jerk
    found["ldlj"] = -math.log(jerk * (n * DT) ** 3 / max(abs(u) for u in v) ** 2)
    found["velocity_smoothness"] = sum(abs(abs(v[k + 1]) - abs(v[k])) for k in range(n)) / (n * DT)
    found["faults"] = t.faults
    v_max, a = t.max_speed, t.acceleration
    to_speed = v_max**2 / (2.0 * a)
    fastest = math.sqrt(2.0 * t.shortest / a) if t.shortest < to_speed else v_max / a + (t.shortest - to_speed) / v_max
    best = t.shortest / v_max if math.isnan(t.optimal_time) else t.optimal_time
    found["spl"] = success * t.shortest / max(length, t.shortest)
    found["sct"] = success * fastest / max(n * DT, fastest)
    found["barn_score"] = success * best / min(max(taken, 2.0 * best), 8.0 * best)
    found["barn_score_2022"] = success * best / min(max(taken, 4.0 * best), 8.0 * best)
    found |= {"arrival_time_1": math.nan, "arrival_time_2": math.nan}
    k = 0
    for j, goal in enumerate(t.goals):
        while k <= n and math.dist(goal[:2], t.poses[k, :2]) >= RADIUS:
            k += 1
        if k > n:
            break
        found[f"arrival_time_{j + 1}"] = k * DT
        if j == 1:
            found["arrival_path_length"] = sum(math.dist(t.poses[i, :2], t.poses[i + 1, :2]) for i in range(k))
            found["arrival_heading_error"] = short_way(goal[2] - heading[k])
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_every_metric_is_what_plain_loops_come_to(seed: int) -> None:
    trajectory = driven(seed)
    found, wanted = measure(trajectory, RADIUS), restated(trajectory)
    for name in {*(column.name for column in METRICS), *wanted}:
        assert found[name] == pytest.approx(float(wanted.get(name, math.nan)), rel=1e-9, abs=1e-12, nan_ok=True), name


# How metrics change with the units of length and time: powers of each.
LENGTHS = dict.fromkeys(
    (
        *("path_length", "cross_track_rms", "cross_track_rms_time", "cross_track_mean", "cross_track_max"),
        *("cross_track_p95", "steady_offset", "min_clearance", "mean_clearance", "centre_distance"),
        *("final_x", "final_y", "final_x_error", "final_y_error", "final_position_error", "arrival_path_length"),
    ),
    (1, 0),
)
UNITS = LENGTHS | {
    "time": (0, 1),
    "arrival_time_1": (0, 1),
    "arrival_time_2": (0, 1),
    "mean_speed": (1, -1),
    "effort": (0, -1),  # rad^2/s
    "squared_jerk": (2, -5),
    "velocity_smoothness": (1, -2),
}


@pytest.mark.parametrize("seed", SEEDS)
def test_every_metric_has_the_unit_that_it_is_printed_with(seed: int) -> None:
    """But for those that count lengths beyond a bound, which stays as it is."""
    before = driven(seed)
    here = measure(before, RADIUS)
    m, s = 2.0, 4.0  # so that nothing is rounded
    obstacles = before.obstacles.copy()
    for name in ("x", "y", "radius", "half_length", "half_width"):
        obstacles[name] *= m
    place = np.array([m, m, 1.0])
    there = measure(
        dataclasses.replace(
            before, times=s * before.times, poses=place * before.poses, goals=place * before.goals,
            twists=before.twists * [m / s, m / s, 1.0 / s], wheel_speeds=before.wheel_speeds / s, obstacles=obstacles,
            references=m * before.references,
            **{name: m * getattr(before, name) for name in (
                "clearances", "arc_lengths", "cross_track_errors", "lap_length", "clock_from", "shortest",
            )},
            **{name: s * getattr(before, name) for name in ("limit", "optimal_time")},
            max_speed=m / s * before.max_speed, acceleration=m / s**2 * before.acceleration,
        ),
        m * RADIUS,
    )  # fmt: skip
    for name, value in here.items():
        if name in ("reference_jumps", "acquisition_time", "acquisition_area", "tracking_rms", "near_share"):
            continue
        lengths, times = UNITS.get(name, (0, 0))
        assert there[name] == pytest.approx(m**lengths * s**times * value, rel=1e-12, nan_ok=True), name
