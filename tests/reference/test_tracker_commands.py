"""Reference implementation of the tracker that planners share, from its docstring, gives the same commands."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.records import aligned
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.polyline_tracker import PolylineTracker, plan_fields, track

DT = 0.05
CELL, SIDE = 0.1, 60  # m, cells
FARTHEST, UNIT = 1.275, 0.005  # m
POINTS = 24


def wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def body(pose: Any, x: float, y: float) -> tuple[float, float]:
    dx, dy = x - pose[0], y - pose[1]
    return math.cos(pose[2]) * dx + math.sin(pose[2]) * dy, math.cos(pose[2]) * dy - math.sin(pose[2]) * dx


class Tracker:
    """What the tracker knows and remembers of one robot."""

    def __init__(self, p: PolylineTracker, robot: Any, base: Any, grid: Any, points: Any) -> None:
        self.p, self.robot, self.grid, self.points = p, robot, grid, points
        self.a = min(p.acceleration, 0.8 * base.acceleration)
        self.alpha = min(p.yaw_acceleration, 0.8 * base.yaw_acceleration)
        self.delay = base.lag + 2.0 * DT
        self.arc = [0.0]
        for first, second in itertools.pairwise(points):
            self.arc.append(self.arc[-1] + math.dist(first, second))
        self.segment, self.arrived, self.stuck = 0, False, 0
        self.last = np.zeros(3)

    def clearance(self, x: float, y: float) -> float:
        u, v = x / CELL - 0.5, y / CELL - 0.5
        if not (0.0 <= u < SIDE - 1 and 0.0 <= v < SIDE - 1):
            return FARTHEST
        rows = [float(np.interp(u, np.arange(SIDE), self.grid[math.floor(v) + k])) for k in (0, 1)]
        return FARTHEST - UNIT * float(np.interp(v - math.floor(v), [0.0, 1.0], rows))

    def stops(self, distance: float, a: float) -> float:
        """Returns the v of v T + v^2 / (2 a) = distance."""
        return a * (math.sqrt(self.delay**2 + 2.0 * distance / a) - self.delay) if distance > 0.0 else 0.0

    def at(self, s: float) -> Any:
        s = clip(s, self.arc[self.segment], self.arc[-1])
        return np.array([np.interp(s, self.arc, self.points[:, axis]) for axis in range(2)])

    def project(self, pose: Any) -> tuple[float, float]:
        first, n = max(self.segment - 1, 0), len(self.points)
        limit = self.arc[min(self.segment + 1, n - 1)] + 1.0
        found = []
        for k in range(first, n - 1):
            if self.arc[k] > limit:
                break
            a, b = self.points[k], self.points[k + 1]
            share = clip(float((pose[:2] - a) @ (b - a) / ((b - a) @ (b - a))), 0.0, 1.0)
            found.append((math.dist(a + share * (b - a), pose[:2]), k, self.arc[k] + share * math.dist(a, b)))
        _, self.segment, s = min(found)
        d = self.points[self.segment + 1] - self.points[self.segment]
        return s, math.atan2(d[1], d[0])

    def free(self, pose: Any, ux: float, uy: float, bend: float, reach: float, needed: float) -> float:
        needed = min(needed, self.clearance(pose[0], pose[1]) - 1e-4)
        place, gone = pose, 0.0
        while gone < reach:
            stride = min(0.04, reach - gone + 1e-9)
            turn = bend * stride
            chord = complex(ux, uy) * stride
            chord *= 1.0 if abs(turn) < 1e-9 else (np.exp(1j * turn) - 1.0) / (1j * turn)
            chord *= np.exp(1j * place[2])
            place = np.array([place[0] + chord.real, place[1] + chord.imag, place[2] + turn])
            if self.clearance(place[0], place[1]) < needed:
                return gone
            gone += stride
        return reach

    def spin(self, angle: float) -> float:
        return math.copysign(min(self.p.max_yaw_rate, self.stops(abs(angle), self.alpha)), angle)

    def limited(self, vx: float, vy: float) -> Any:
        change = np.array([vx, vy]) - self.last[:2]
        return self.last[:2] + change * min(1.0, self.a * DT / max(np.hypot(*change), 1e-12))

    def command(self, vx: float, vy: float, w: float) -> None:
        most = self.alpha * DT
        self.last = np.array([*self.limited(vx, vy), clip(w, self.last[2] - most, self.last[2] + most)])

    def track(self, pose: Any, error: float, is_goal: bool, facing: bool, limit: float, least_room: float) -> None:
        p, hull, omni = self.p, self.robot.hull_radius, self.robot.holonomic
        self.tied = False  # two ways are as fast, to the last digits
        s, tangent = self.project(pose)
        distance = math.dist(self.points[-1], pose[:2])
        rest = self.arc[-1] - s
        if s > self.arc[-1] - 0.3:
            rest = max(rest, distance)
        if is_goal:
            self.arrived = distance < p.arrive or (self.arrived and distance <= 0.05 + p.arrive)
            if self.arrived:
                self.stuck = 0
                vx, vy = body(pose, *self.points[-1]) if omni else (0.0, 0.0)
                self.command(vx, vy, self.spin(error))
                return
        else:
            self.arrived = False
            rest += 0.3
        late = 0.7 * self.delay * self.last[2] if omni else 0.0
        if limit < 0.0:
            way = wrap(tangent - pose[2] - late) if omni else 0.0
            tx, ty = math.cos(way), math.sin(way)
            v = min(-limit, self.stops(self.free(pose, -tx, -ty, 0.0, 0.5, hull + p.skin), self.a))
            self.command(-v * tx, -v * ty, 0.0)
            return
        narrow = min(self.clearance(*self.at(s + 0.125 * k * p.lookahead)) for k in range(9))
        share = clip((narrow - hull) / p.slow_clearance, 0.0, 1.0)
        slow = min(p.slow_speed, p.max_speed)
        allowed = min(slow + (p.max_speed - slow) * share, limit, self.stops(rest, self.a))
        needed = hull + min(p.skin, max(narrow - hull - UNIT, least_room))
        ahead, best, twist = p.lookahead * max(share, 0.3), -1.0, (0.0, 0.0, 0.0)
        for _ in range(3):
            px, py = self.at(s + ahead)
            bx, by = body((pose[0], pose[1], pose[2] + late), px, py)
            if omni:
                bend = wrap(math.atan2(py - pose[1], px - pose[0]) - tangent)
                speed, vx, vy, wanted = self.straight(pose, bx, by, bend, allowed, needed)
                w = 0.0
            elif abs(math.atan2(by, bx)) > p.rotate_beyond:
                if best < 0.02:
                    best, twist = 0.02, (0.0, 0.0, self.spin(math.atan2(by, bx)))
                break
            else:
                speed, w, wanted = self.along(pose, bx, by, allowed, needed)
                vx, vy = speed, 0.0
            self.tied = self.tied or (abs(speed - best) < 1e-9 and (omni or speed != best))
            if speed > best:
                best, twist = speed, (vx, vy, w)
            if speed >= 0.6 * wanted:
                break
            ahead /= 2.0
        self.stuck = self.stuck + 1 if best < 0.02 and allowed > 0.05 else 0
        vx, vy, w = twist
        if omni:
            speed = math.hypot(vx, vy)
            if facing and rest > 0.3 and speed > 0.05:
                px, py = self.at(s + 0.5)
                error = wrap(math.atan2(py - pose[1], px - pose[0]) - pose[2])
            most = 0.4 * self.a / max(speed, 0.1)
            w = clip(self.spin(error), -most, most)
        self.command(vx, vy, w)

    def along(self, pose: Any, bx: float, by: float, allowed: float, needed: float) -> tuple[float, float, float]:
        p, d2 = self.p, bx * bx + by * by
        kappa = 2.0 * by / d2
        v = min(
            allowed, p.max_yaw_rate / max(abs(kappa), 1e-9), p.max_speed / max(p.min_turn_radius * abs(kappa), 1e-9)
        )
        v = clip(max(v, min(0.05, allowed)), self.last[0] - self.a * DT, self.last[0] + self.a * DT)
        w = clip(kappa * v, self.last[2] - self.alpha * DT, self.last[2] + self.alpha * DT)
        reach = min(v * self.delay + v * v / (2.0 * self.a) + 0.04, math.sqrt(d2))
        clear = self.free(pose, 1.0, 0.0, clip(w / max(v, 0.05), -10.0, 10.0), reach, needed)
        most = min(v, self.stops(clear, self.a))
        return most, kappa * most if most > 0.05 else self.spin(math.atan2(by, bx)), v

    def straight(self, pose: Any, bx: float, by: float, turn: float, allowed: float, needed: float) -> Any:
        d, v = math.hypot(bx, by), allowed
        if d > 0.1:
            bend = 2.0 * (abs(math.sin(turn)) if abs(turn) < 1.57 else 1.0) / d
            v = min(v, math.sqrt(0.5 * self.a / max(bend, 1e-9)))
        vx, vy = self.limited(v * bx / d, v * by / d)
        speed = math.hypot(vx, vy)
        if speed > 1e-6:
            bend = self.last[2] / max(speed, 0.1)
            reach = min(speed * self.delay + speed**2 / (2.0 * self.a) + 0.04, d)
            most = self.stops(self.free(pose, vx / speed, vy / speed, bend, reach, needed), self.a)
            if most < speed:
                vx, vy = vx * most / speed, vy * most / speed
                if most < 0.3 * speed:
                    most = min(v, self.stops(self.free(pose, bx / d, by / d, bend, reach, needed), self.a))
                    vx, vy = most * bx / d, most * by / d
                speed = most
        return speed, vx, vy, v


OTHER = PolylineTracker(
    max_speed=0.8, acceleration=0.6, yaw_acceleration=1.7, max_yaw_rate=1.1, lookahead=0.6, min_turn_radius=0.7,
    rotate_beyond=1.0, slow_speed=0.3, slow_clearance=0.3, skin=0.04, arrive=0.03,
)  # fmt: skip


@pytest.mark.parametrize("policy", [PolylineTracker(), OTHER], ids=["default", "other"])
@pytest.mark.parametrize("name", ["p3dx", "omni4"])
def test_the_tracker_is_its_docstring(policy: PolylineTracker, name: str) -> None:
    robot, base, rng = ROBOTS[name], ACTUATORS["lagged"], np.random.default_rng(12)
    layout = Observation.layout(len(robot.twist_axes), 0, 5.0)
    briefing = Briefing(1, robot, base, DT, "twist", layout, np.empty(0), 5.0)
    p = policy.params(briefing)[0]
    kept = aligned([*plan_fields(POINTS), ("stay", np.float64), ("grid", np.uint8, (SIDE, SIDE))])
    seen, ties = set(), 0
    for _ in range(40):
        memory = np.zeros(1, kept)
        m = memory[0]
        turns = np.cumsum(rng.normal(0.0, 0.35, POINTS)) + rng.uniform(-3.0, 3.0)
        steps = 0.09 * np.column_stack([np.cos(turns), np.sin(turns)])
        points = np.cumsum(steps, axis=0)
        points += 3.0 - points.mean(axis=0)
        # clear towards one side, and a bank across the way
        ys, xs = np.mgrid[:SIDE, :SIDE] * CELL + 0.5 * CELL
        bank = points[rng.integers(POINTS)] + rng.normal(0.0, 0.4, 2)
        clear = np.minimum(np.hypot(xs - bank[0], ys - bank[1]) + rng.uniform(-0.2, 0.4), FARTHEST)
        memory["grid"] = np.ceil((FARTHEST - np.maximum(clear, 0.0)) / UNIT)
        memory["cell"], memory["num_points"], memory["stay"] = CELL, POINTS, 0.05 + policy.arrive
        memory["points"] = points
        me = Tracker(policy, robot, base, memory["grid"][0].astype(float), points)
        memory["arc"] = me.arc
        k = int(rng.choice([0, 5, 10, 15, 22, 23]))
        heading = math.atan2(*steps[min(k + 1, POINTS - 1)][::-1]) + rng.normal(0.0, 0.6)
        pose = np.array([*(points[k] + rng.normal(0.0, 0.05 if k < 22 else 0.01, 2)), wrap(heading)])
        me.segment = max(k - 2, 0)
        memory["segment"] = me.segment
        me.last = np.array([rng.uniform(0.0, 0.4), rng.normal(0.0, 0.1) * robot.holonomic, rng.normal(0.0, 0.3)])
        memory["command"] = me.last
        is_goal, facing = bool(rng.random() < 0.7), bool(rng.random() < 0.5)
        limit = float(rng.choice([np.inf, 0.25, -0.2], p=[0.6, 0.2, 0.2]))
        for _ in range(8):
            error = float(rng.uniform(-1.0, 1.0))
            track(p, m, tuple(pose), error, is_goal, facing, limit, -0.05)
            me.track(pose, error, is_goal, facing, limit, -0.05)
            if me.tied:
                ties += 1
                me.last = memory["command"][0].copy()
            np.testing.assert_allclose(memory["command"][0], me.last, atol=2e-6)
            told = memory["segment"][0], memory["arrived"][0], memory["stuck"][0]
            assert told == (me.segment, me.arrived, me.stuck)
            seen.add((limit < 0.0, me.arrived, me.stuck > 0))
            c, s = math.cos(pose[2]), math.sin(pose[2])
            vx, vy, w = me.last
            pose = pose + DT * np.array([c * vx - s * vy, s * vx + c * vy, w])
    assert ties < 80
    assert {(True, False, False), (False, False, False), (False, True, False)} <= seen
