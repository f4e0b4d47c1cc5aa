"""Reference implementations of path-following laws, from their papers and docstrings, give the same twists."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.path_following import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.tasks.briefing import Briefing, Course
from wayfield.envs.world.paths import Path, PathPool
from wayfield.policies.paths.lookahead import Lookahead
from wayfield.policies.paths.lqr import Lqr, gain_table
from wayfield.policies.paths.pure_pursuit import PurePursuit
from wayfield.policies.paths.regulated_pure_pursuit import RegulatedPurePursuit
from wayfield.policies.paths.stanley import Stanley
from wayfield.policies.poses.smooth_pose import SmoothPose

OPEN = [(0.0, 0.0), (1.1, 0.1), (1.7, 0.5), (1.9, 1.1), (1.9, 2.2), (0.8, 2.2), (0.4, 1.2), (-0.7, 1.5), (-1.9, 0.4)]
CLOSED = [(0.3, 0.0), (1.4, 0.2), (1.9, 1.2), (1.1, 1.9), (0.1, 1.3)]
SCALE = 2.4  # of both, so that no corners follow each other closely: such are rounded
ROBOT = ROBOTS["p3dx"]
DT = 0.05
STEPS = 3  # of each robot, so that what a law remembers counts


def wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


class Line:
    """A polyline by arc length: open and straight on beyond its ends, or closed."""

    def __init__(self, points: Sequence[tuple[float, float]], closed: bool) -> None:
        ends = [*points, points[0]] if closed else list(points)
        self.closed = closed
        self.legs = [(a, b, math.dist(a, b)) for a, b in itertools.pairwise(ends)]
        self.starts = [sum(leg[2] for leg in self.legs[:k]) for k in range(len(self.legs))]
        self.length = sum(leg[2] for leg in self.legs)

    def left(self, s: float) -> float:
        return math.inf if self.closed else max(self.length - s, 0.0)

    def leg(self, s: float) -> int:
        s = s % self.length if self.closed else s
        return max([k for k, start in enumerate(self.starts) if start <= s], default=0)

    def at(self, s: float) -> tuple[float, float, float]:
        """Returns x, y and the heading of the leg there."""
        k = self.leg(s)
        (ax, ay), (bx, by), length = self.legs[k]
        t = ((s % self.length if self.closed else s) - self.starts[k]) / length
        return ax + t * (bx - ax), ay + t * (by - ay), math.atan2(by - ay, bx - ax)

    def nearest(self, x: float, y: float, low: float, high: float) -> float:
        """Returns the arc length, from `low` to `high`, of the point nearest to (x, y)."""
        if not self.closed:
            low, high = max(low, 0.0), min(high, self.length)
        found = []
        lap = math.floor(low / self.length) if self.closed else 0
        while lap * self.length <= high:
            for start, ((ax, ay), (bx, by), length) in zip(self.starts, self.legs, strict=True):
                first = max(lap * self.length + start, low)
                last = min(lap * self.length + start + length, high)
                if first > last:
                    continue
                t = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length
                s = clip(lap * self.length + start + t, first, last)
                px, py, _ = self.at(s)
                on = s - lap * self.length - start
                px, py = ax + on / length * (bx - ax), ay + on / length * (by - ay)
                found.append((math.dist((x, y), (px, py)), s))
            lap += 1
            if not self.closed:
                break
        return min(found)[1]


def body(pose: Sequence[float], x: float, y: float) -> tuple[float, float]:
    dx, dy = x - pose[0], y - pose[1]
    return (
        math.cos(pose[2]) * dx + math.sin(pose[2]) * dy,
        math.cos(pose[2]) * dy - math.sin(pose[2]) * dx,
    )


class Robot(NamedTuple):
    """One robot as a law sees it, and the base that it drives."""

    line: Line
    pose: tuple[float, float, float]
    v: float  # measured
    w: float
    s: float  # of its projection
    acceleration: float
    yaw_acceleration: float
    lag: float


def wheel_factor(v: float, w: float) -> float:
    """Returns by how much a twist of the P3DX is scaled so that no rim is faster than 1.2 m/s, and no turn too fast."""
    rim = max(abs(v + 0.1905 * w), abs(v - 0.1905 * w))
    factor = min(1.0, 1.2 / rim) if rim > 0.0 else 1.0
    return min(factor, ROBOT.turn_speed / abs(w)) if w else factor


def lookahead(p: Lookahead, r: Robot, memory: list[float]) -> tuple[float, float]:
    x, y, heading = r.pose
    ahead = x + p.lookahead_distance * math.cos(heading), y + p.lookahead_distance * math.sin(heading)
    low, high = (r.s, r.s + p.window) if p.search == "window" else (0.0, r.line.length)
    # at a corner that of the leg that leaves it
    tx, ty, tangent = r.line.at(r.line.nearest(*ahead, low, high) + 1e-9)
    px, py = body(r.pose, tx, ty)
    mode = math.exp(-math.hypot(px, py) / p.mode_distance)
    turn = wrap((tangent if p.reference_heading is None else p.reference_heading) - heading)
    return p.k_lin * px, p.k_ang * (1.0 - mode) * math.atan2(py, px) + p.k_ori * mode * turn


def pure_pursuit(p: PurePursuit, r: Robot, memory: list[float]) -> tuple[float, float]:
    far = p.lookahead_distance
    grid = np.arange(r.s, r.s + p.window, 1e-3)
    away = np.array([math.dist(r.line.at(s)[:2], r.pose[:2]) for s in grid])
    out = np.flatnonzero(away >= far)
    s = r.s + p.window
    if len(out):
        low, s = (grid[out[0] - 1], grid[out[0]]) if out[0] else (r.s, r.s)
        for _ in range(50):
            middle = 0.5 * (low + s)
            low, s = (low, middle) if math.dist(r.line.at(middle)[:2], r.pose[:2]) >= far else (middle, s)
    px, py = body(r.pose, *r.line.at(s)[:2])
    v = min(p.speed, math.sqrt(2.0 * min(p.deceleration, r.acceleration) * r.line.left(r.s)))
    return v, v * 2.0 * py / (px * px + py * py)


def regulated_pure_pursuit(p: RegulatedPurePursuit, r: Robot, memory: list[float]) -> tuple[float, float]:
    v0, w0 = memory[:2]
    deceleration = min(p.deceleration, r.acceleration)
    px, py = body(r.pose, *r.line.at(r.s + clip(p.lookahead_time * v0, p.min_lookahead, p.max_lookahead))[:2])
    curvature, angle = 2.0 * py / (px * px + py * py), math.atan2(py, px)
    v_low = max(v0 - r.acceleration * DT, 0.0)
    w_low, w_high = w0 - r.yaw_acceleration * DT, w0 + r.yaw_acceleration * DT
    if abs(angle) > p.rotate_angle:
        v = v_low
        rate = min(p.max_yaw_rate, math.sqrt(2.0 * min(p.yaw_acceleration, r.yaw_acceleration) * abs(angle)))
        w = clip(math.copysign(rate, angle), w_low, w_high)
    else:
        v_max = min(p.speed, math.sqrt(2.0 * deceleration * r.line.left(r.s)))
        for k in range(int((r.lag * v0 + 0.5 * p.speed**2 / deceleration) / 0.05) + 1):
            ahead = 0.05 * k
            bend = abs(wrap(r.line.at(r.s + ahead + p.bend_span)[2] - r.line.at(r.s + ahead)[2])) / p.bend_span
            v_c = max(p.speed * min(1.0, 1.0 / max(p.min_radius * bend, 1e-9)), p.min_speed)
            v_max = min(v_max, math.sqrt(v_c**2 + 2.0 * deceleration * max(ahead - r.lag * v0, 0.0)))
        v_max *= wheel_factor(v_max, curvature * v_max)
        v_high = max(min(v0 + r.acceleration * DT, v_max), v_low)
        # the fastest of those of the window that are nearest to the line
        tried = np.linspace(v_low, v_high, 20001)
        off = np.maximum(np.maximum(curvature * tried - w_high, w_low - curvature * tried), 0.0)
        v = float(tried[np.flatnonzero(off <= off.min() + 1e-12)[-1]])
        w = clip(curvature * v, w_low, w_high)
    most = max(min(ROBOT.turn_speed, (1.2 - v) / 0.1905), 0.0)
    if w_low > most or w_high < -most:
        v = v_low
        most = max(min(ROBOT.turn_speed, (1.2 - v) / 0.1905), 0.0)
    w = clip(w, -most, most)
    memory[:2] = v, w
    return v, w


def stanley(p: Stanley, r: Robot, memory: list[float]) -> tuple[float, float]:
    x, y, heading = r.pose
    wheel = x + p.axle_distance * math.cos(heading), y + p.axle_distance * math.sin(heading)
    s = r.line.nearest(*wheel, r.s, r.s + p.window)
    px, py, tangent = r.line.at(s + 1e-9)
    left = math.cos(tangent) * (wheel[1] - py) - math.sin(tangent) * (wheel[0] - px)
    e = math.copysign(math.dist(wheel, (px, py)), left)
    rolling = math.hypot(r.v, p.axle_distance * r.w)
    turn = wrap(tangent - heading)
    steering = clip(turn - math.atan2(p.k * e, p.k_s + rolling), -p.max_steering, p.max_steering)
    steering = clip(steering, memory[0] - p.max_steering_rate * DT, memory[0] + p.max_steering_rate * DT)
    memory[0] = steering
    alpha = p.share * r.yaw_acceleration
    bound = p.axle_distance * math.sqrt(2.0 * alpha * abs(steering)) / abs(math.sin(steering)) if steering else math.inf
    u = min(p.speed, bound)
    v = u * max(math.cos(steering), 0.0) if abs(turn) <= 0.5 * math.pi else 0.0
    return v, u * math.sin(steering) / p.axle_distance


def graceful(p: SmoothPose, px: float, py: float, turn: float) -> tuple[float, float]:
    r, delta = math.hypot(px, py), -math.atan2(py, px)
    phi = wrap(turn + delta)
    curvature = (
        -(p.k2 * (delta - math.atan(-p.k1 * phi)) + (1.0 + p.k1 / (1.0 + (p.k1 * phi) ** 2)) * math.sin(delta)) / r
    )
    peak = (p.beta * (p.lam - 1.0)) ** (-1.0 / p.lam)
    v = p.speed / (1.0 + p.beta * min(abs(curvature), peak) ** p.lam)
    if abs(curvature) > peak:
        v *= peak / abs(curvature)
    return v, v * curvature


def smooth_pose(p: SmoothPose, r: Robot, memory: list[float]) -> tuple[float, float]:
    x, y, tangent = r.line.at(r.s + p.lookahead_distance)
    v, w = graceful(p, *body(r.pose, x, y), wrap(tangent - r.pose[2]))
    brake = min(1.0, math.sqrt(2.0 * min(p.deceleration, r.acceleration) * r.line.left(r.s)) / v)
    return brake * v, brake * w


class Rounded:
    """A line rounded over a length h, as the speed profile reads it."""

    def __init__(self, line: Line, h: float) -> None:
        self.line, self.h = line, h

    def heading(self, s: float) -> float:
        (x0, y0, _), (x1, y1, _) = self.line.at(s - self.h), self.line.at(s + self.h)
        return math.atan2(y1 - y0, x1 - x0)

    def curvature(self, s: float) -> float:
        return wrap(self.heading(s + self.h) - self.heading(s - self.h)) / (2.0 * self.h)

    def point(self, s: float) -> Any:
        at = lambda t: np.array(self.line.at(t)[:2])  # noqa: E731
        here = at(s)
        steps = [at(s - 0.5 * k * self.h) - 2.0 * here + at(s + 0.5 * k * self.h) for k in range(5)]
        triangle = sum((4 - k) / 16.0 * steps[k] for k in range(1, 4))
        return here + triangle - 5.0 / 64.0 * steps[4]

    def speed(self, s: float, p: Lqr, r: Robot) -> float:
        a = min(p.acceleration, p.share * r.acceleration)
        lowest = min(p.speed**2, 2.0 * a * self.line.left(s))
        for sense in (1.0, -1.0):
            for k in range(10_000):
                away = 0.25 * self.h * k
                t = s + sense * away
                if 2.0 * a * away >= lowest or (not self.line.closed and not 0.0 <= t <= self.line.length):
                    break
                kappa = abs(self.curvature(t))
                rate = abs(self.curvature(t + self.h) - self.curvature(t - self.h)) / (2.0 * self.h)
                most = p.share * ROBOT.max_twist
                cap = min(
                    p.speed,
                    1.0 / (1.0 / most[0] + kappa / most[-1]),
                    math.sqrt(p.lateral_acceleration / max(kappa, 1e-9)),
                    math.sqrt(p.share * r.yaw_acceleration / max(rate, 1e-9)),
                )
                lowest = min(lowest, cap**2 + 2.0 * a * away)
        return math.sqrt(lowest)


def lqr(p: Lqr, r: Robot, memory: list[float]) -> tuple[float, float]:
    path = Rounded(r.line, p.rounding)
    s = r.s
    tangent = path.heading(s)
    for k in range(4):
        x, y = path.point(s)
        dx, dy = r.pose[0] - x, r.pose[1] - y
        along = math.cos(tangent) * dx + math.sin(tangent) * dy
        e = math.cos(tangent) * dy - math.sin(tangent) * dx
        beyond = s + clip(along, -p.rounding, p.rounding)
        if k == 3 or abs(wrap(path.heading(beyond) - tangent)) > 0.5 * math.pi:
            break
        s, tangent = beyond, path.heading(beyond)
    v_now = max(r.v, 0.0)
    th_e = wrap(r.pose[2] - tangent)
    facing = max(math.cos(th_e), 0.0)
    kappa = path.curvature(s)
    stretch = facing / max(1.0 - kappa * e, 0.5)
    ahead = s + (r.lag + 0.5 * DT) * v_now
    change = r.acceleration * DT
    v = clip(facing * path.speed(ahead, p, r), memory[0] - change, memory[0] + change)
    memory[0] = v
    speeds, gains = gain_table(p.speed, DT, r.lag, p.q_e, p.q_th)
    k1, k2, k3 = (float(np.interp(v_now, speeds, column)) for column in gains.T)
    approach = clip(k1 / k2 * e, -p.max_approach, p.max_approach)
    w = v * path.curvature(ahead) * stretch - k2 * (approach + th_e) - k3 * (r.w - v_now * kappa * stretch)
    return v, w


LAWS: list[tuple[Any, Callable[..., tuple[float, float]]]] = [
    (Lookahead(), lookahead),
    (Lookahead(k_lin=0.9, k_ang=1.7, k_ori=5.0, lookahead_distance=0.4, mode_distance=0.3, search="window"), lookahead),
    (Lookahead(mode_distance=0.2, reference_heading=0.7, search="window", window=1.1), lookahead),
    (PurePursuit(), pure_pursuit),
    (PurePursuit(lookahead_distance=0.35, speed=0.8, deceleration=0.3, window=1.2), pure_pursuit),
    (RegulatedPurePursuit(), regulated_pure_pursuit),
    (
        RegulatedPurePursuit(
            speed=1.1, min_speed=0.2, min_radius=0.7, bend_span=0.3, min_lookahead=0.25, max_lookahead=0.9,
            lookahead_time=1.1, rotate_angle=1.2, max_yaw_rate=1.3, deceleration=0.6, yaw_acceleration=1.9,
        ),
        regulated_pure_pursuit,
    ),
    (Stanley(), stanley),
    (
        Stanley(
            k=2.5, k_s=0.3, speed=0.9, axle_distance=0.3, max_steering=0.8, max_steering_rate=4.0, share=0.3, window=0.7
        ),
        stanley,
    ),
    (SmoothPose(), smooth_pose),
    (SmoothPose(k1=1.7, k2=2.2, speed=0.8, beta=0.4, lam=1.5, lookahead_distance=0.4, deceleration=0.9), smooth_pose),
    (Lqr(), lqr),
    (
        Lqr(
            speed=0.9, q_e=20.0, q_th=9.0, rounding=0.15, acceleration=0.5, lateral_acceleration=0.6, share=0.6,
            max_approach=0.6,
        ),
        lqr,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("policy", "law"), LAWS, ids=[f"{law.__name__}_{k}" for k, (_, law) in enumerate(LAWS)])
@pytest.mark.parametrize(
    ("actuators", "closed"),
    [("lagged", False), ("slow", False), ("ideal", True), ("slow", True)],
    ids=["lagged-open", "slow-open", "ideal-closed", "slow-closed"],
)
def test_a_law_drives_what_its_docstring_says(policy: Any, law: Any, actuators: str, closed: bool) -> None:
    points = [(SCALE * x, SCALE * y) for x, y in (CLOSED if closed else OPEN)]
    line, path = Line(points, closed), Path(points, closed=closed)
    base = ACTUATORS[actuators]
    rng = np.random.default_rng(7)
    n = 40
    s = rng.uniform(0.0, line.length * (2.5 if closed else 1.0), n)
    s[:3] = line.length - np.array([0.02, 0.2, 0.45])  # near the end
    s[3::2] = rng.choice(line.starts[1:], len(s[3::2])) + rng.uniform(-0.6, 0.3, len(s[3::2]))  # and near corners
    aside, turn = rng.uniform(-0.35, 0.35, n), rng.normal(0.0, 0.8, n)
    poses = np.empty((n, 3))
    for k in range(n):
        x, y, tangent = line.at(s[k])
        poses[k] = x - aside[k] * math.sin(tangent), y + aside[k] * math.cos(tangent), wrap(tangent + turn[k])
    briefing = Briefing(
        n, ROBOT, base, DT, "twist", Observation.layout(2, 0), np.empty(0), 0.0,
        path=Course.of(PathPool.of([Path([(5.0, 5.0), (9.0, 5.0)]), path]), np.ones(n, np.int64)),
    )  # fmt: skip
    memory = policy.reset(briefing)
    # half of them from rest, half with a speed or an angle behind them, and a yaw rate
    if memory.ndim == 2:
        memory[n // 2 :] = rng.uniform(0.1, 0.8, (n // 2, memory.shape[1]))
    mine = [memory[k].tolist() for k in range(n)]
    for _ in range(STEPS):
        twists = np.column_stack([rng.uniform(-0.1, 0.8, n), rng.normal(0.0, 0.5, n)])
        zero = np.zeros(n)
        got = policy.act(Observation(poses, twists, zero, zero, s, np.zeros((n, 0, 2))), briefing, memory)
        for k in range(n):
            robot = Robot(line, tuple(poses[k]), *twists[k], s[k], base.acceleration, base.yaw_acceleration, base.lag)
            # what the sampled ways in a restatement leave is under a ten thousandth
            np.testing.assert_allclose(got[k], law(policy, robot, mine[k]), rtol=2e-4, atol=2e-4, err_msg=f"robot {k}")
        poses = poses + rng.normal(0.0, 0.01, poses.shape)
