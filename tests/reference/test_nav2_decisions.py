"""Reference implementations of Nav2's controllers on a costmap and a plan, from their docstrings."""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from oracles.local_planning import briefing_of

from wayfield.policies.scans import nav2_dwb, nav2_mppi
from wayfield.policies.scans.nav2_dwb import Nav2Dwb
from wayfield.policies.scans.nav2_mppi import Nav2Mppi, Samples
from wayfield.system.compiled import allocating, compiled

FARTHEST, UNIT, SPACING = 1.275, 0.005, 0.025  # m
LETHAL, INSCRIBED = 254.0, 253.0
FILTER = np.array([-21, 14, 39, 54, 59, 54, 39, 14, -21]) / 231.0

flips = compiled(lambda p, m, pose: nav2_dwb.note_flips(p[0], m[0], pose))
optimise = compiled(
    lambda p, m, costs, points, state, samples, now: nav2_mppi.optimise(p[0], m[0], costs, points, state, samples, now)
)


@allocating
def best(p, m, costs, points, pose, goal, far, now):  # type: ignore[no-untyped-def]
    cells = nav2_dwb.cells_of(p[0], points)
    told = cells, nav2_dwb.nose_cell(p[0], m[0], points, pose, goal), goal, far
    return nav2_dwb.best_twist(p[0], m[0], costs, told, pose, now)


def wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def near(value: float, wanted: float, change: float) -> float:
    return min(max(wanted, value - change), value + change)


class World:
    """A costmap of random levels around the origin, with some of it taken, and a plan across it."""

    def __init__(self, controller: Any, robot: str, rng: np.random.Generator, taken: float) -> None:
        self.briefing = briefing_of(robot)
        self.controller, self.holonomic = controller, self.briefing.robot.holonomic
        self.p = controller.given(self.briefing)
        self.m = controller.reset(self.briefing)["state"]
        self.cell = 0.08
        self.m["cell"] = self.cell
        self.m["origin"] = -80.0 * self.cell
        grid = self.m["grid"][0]
        grid[:] = rng.integers(120, 190, grid.shape)
        for _ in range(round(taken * 60)):
            row, column = rng.integers(55, 105, 2)
            grid[row : row + 3, column : column + 3] = 250
        radius = self.briefing.robot.hull_radius
        self.costs = controller.maps(self.briefing).costs
        d = FARTHEST - UNIT * np.arange(256)
        wanted = np.floor(252.0 * np.exp(-controller.cost_scaling * (d - radius)))
        wanted[d > controller.inflation_radius + 1e-9] = 0.0
        wanted[d <= radius + 1e-9] = INSCRIBED
        wanted[-1] = LETHAL
        np.testing.assert_array_equal(self.costs, wanted)
        self.acceleration = min(controller.acceleration, self.briefing.actuators.acceleration)
        self.yaw_acceleration = min(controller.yaw_acceleration, self.briefing.actuators.yaw_acceleration)
        self.pose = (*rng.uniform(-0.2, 0.2, 2), rng.uniform(-3.1, 3.1))

    def cost(self, x: float, y: float) -> float:
        """Returns the cost at a point, by the levels of the four cells around it."""
        u, v = x / self.cell + 79.5, y / self.cell + 79.5
        column, row = math.floor(u), math.floor(v)
        du, dv = u - column, v - row
        levels = self.m["grid"][0][row : row + 2, column : column + 2]
        return float(self.costs[int(np.array([1.0 - dv, dv]) @ levels @ [1.0 - du, du] + 0.5)])

    def plan(self, count: int, bend: float) -> Any:
        """Returns points from beside the robot on."""
        way = self.pose[2] + bend * np.linspace(0.3, 1.0, count)
        steps = SPACING * np.column_stack([np.cos(way), np.sin(way)])
        first = np.array([self.pose[0] + 0.02, self.pose[1] - 0.01])
        return first + np.cumsum(steps, axis=0)


# MPPI.


def driven(w: World, noise: Any, sequence: Any, now: Any) -> tuple[Any, Any]:
    """Returns the controls and the places of one sample."""
    c = w.controller
    most = np.array([w.acceleration, w.acceleration, w.yaw_acceleration]) * c.step_time
    twist, (x, y, th), controls, places = np.array(now), w.pose, [], []
    for asked in sequence + noise:
        x += (math.cos(th) * twist[0] - math.sin(th) * twist[1]) * c.step_time
        y += (math.sin(th) * twist[0] + math.cos(th) * twist[1]) * c.step_time
        th += twist[2] * c.step_time
        places.append((x, y, th))
        twist = np.array([near(v, to, change) for v, to, change in zip(twist, asked, most, strict=True)])
        if not w.holonomic:
            twist[1] = now[1]
        controls.append(twist)
    return np.array(controls), np.array(places)


def by_costmap(w: World, places: Any, close: bool) -> tuple[float, bool]:
    at = [w.cost(x, y) for x, y, _ in places[:: w.controller.cost_stride]]
    collides = max(at) >= INSCRIBED
    total = w.controller.collision_cost if collides else 0.0 if close else sum(at)
    return w.controller.cost / LETHAL * total / len(at), collides


def critics(w: World, points: Any, goal: Any, left: float, controls: Any, places: Any) -> Any:
    """Returns what each sample costs, by all critics; None where all collide."""
    c = w.controller
    d = math.dist(goal[:2], w.pose[:2])
    found = [by_costmap(w, each, d < c.near_goal) for each in places]
    if all(collides for _, collides in found):
        return None
    taken = [w.cost(*point) >= INSCRIBED for point in points]
    length = SPACING * (len(points) - 1)
    away = np.linalg.norm(points[None] - places[:, -1:, :2], axis=2)
    f = int(away.argmin(axis=1).max())
    is_open = sum(taken[:f]) <= max(2.0, c.most_occupied * f)
    looks = min(f + c.path_angle_offset, len(points) - 1)
    turn = math.atan2(points[looks, 1] - w.pose[1], points[looks, 0] - w.pose[0]) - w.pose[2]
    follows = min(f + c.path_follow_offset, len(points) - 1)
    while follows < len(points) - 2 and taken[follows]:
        follows += 1
    costs = []
    for (cost, _), u, at in zip(found, controls, places, strict=True):
        v, most, least = u[:-1, 0], c.max_speed, -c.max_reverse
        if w.holonomic:
            v = np.copysign(np.hypot(v, u[:-1, 1]), v)
            most, least = math.sqrt(2.0) * c.max_speed, -math.hypot(c.max_reverse, c.max_speed)
        cost += c.constraint * c.step_time * float(np.maximum(v - most, 0.0).sum() + np.maximum(least - v, 0.0).sum())
        if left <= c.goal_within:
            cost += c.goal * float(np.hypot(at[:, 0] - goal[0], at[:, 1] - goal[1]).mean())
        if d < c.goal_angle_within:
            cost += c.goal_angle * sum(abs(wrap(goal[2] - th)) for th in at[:, 2]) / len(at)
        if length >= c.path_align_from and f >= c.path_align_offset and is_open:
            some = at[:: c.align_stride, :2]
            gone = np.cumsum(np.linalg.norm(np.diff(some, axis=0), axis=1))
            along = [min(int(s / SPACING + 0.5), len(points) - 2) for s in gone]
            off = [math.dist(q, points[j]) for q, j in zip(some[1:], along, strict=True) if not taken[j]]
            cost += c.path_align * sum(off) / max(len(off), 1)
        if length >= c.path_follow_from:
            cost += c.path_follow * math.dist(at[-1, :2], points[follows])
        if abs(wrap(turn)) >= c.path_angle_beyond and d >= c.path_angle_from:
            ahead = points[looks] - at[-1, :2]
            cost += c.path_angle * abs(wrap(math.atan2(ahead[1], ahead[0]) - at[-1, 2]))
        if d >= c.prefer_forward_from:
            cost += c.prefer_forward * c.step_time * float(np.maximum(-u[:-1, 0], 0.0).sum())
        costs.append(cost)
    return np.array(costs)


def optimised(w: World, points: Any, goal: Any, left: float, noise: Any, now: Any) -> tuple[Any, Any, Any]:
    """Returns the costs of the samples, the plan and the history; None for what has no way."""
    c, sequence, history = w.controller, w.m["sequence"][0].copy(), w.m["history"][0].copy()
    costs = None
    for _ in range(2 if len(points) else 0):
        sequence[0] = now
        controls, places = (np.array(each) for each in zip(*(driven(w, e, sequence, now) for e in noise), strict=True))
        costs = critics(w, points, goal, left, controls, places)
        if costs is not None:
            break
        sequence[:], history[:] = 0.0, 0.0
    if costs is None:
        return None, sequence, history
    price = c.gamma / np.array([c.speed_noise, c.speed_noise if w.holonomic else math.inf, c.yaw_noise]) ** 2
    costs += (price * sequence * (controls - sequence)).sum((1, 2))
    weights = np.exp((costs.min() - costs) / c.temperature)
    weights /= weights.sum()
    raw = np.tensordot(weights, controls, 1)
    around = np.vstack([history, raw, *[raw[-1:]] * 4])
    plan = np.array([FILTER @ around[t : t + 9] for t in range(len(raw))])
    most = np.array([w.acceleration, w.acceleration, w.yaw_acceleration]) * c.step_time
    low = np.array([-c.max_reverse, -c.max_speed, -c.max_yaw_rate])
    high = np.array([c.max_speed, c.max_speed, c.max_yaw_rate])
    plan[0] = now
    for t in range(1, len(plan)):
        plan[t] = np.clip(np.clip(plan[t], low, high), plan[t - 1] - most, plan[t - 1] + most)
    return costs, np.vstack([plan[1:], plan[-1:]]), np.vstack([history[1:], plan[1:2]])


MPPIS = [
    Nav2Mppi(samples=24, steps=20, speed_noise=0.4, yaw_noise=0.8),
    Nav2Mppi(
        samples=24, steps=16, step_time=0.08, temperature=2.0, gamma=0.1, speed_noise=0.3, yaw_noise=0.5,
        max_reverse=0.2, max_speed=0.5, max_yaw_rate=1.2, acceleration=0.8, yaw_acceleration=1.7, constraint=3.0,
        cost=2.0, collision_cost=50.0, cost_stride=3, goal=2.0, goal_angle=1.5, path_align=6.0, path_align_offset=7,
        align_stride=3, most_occupied=0.2, path_follow=2.5, path_follow_offset=3, path_angle=1.5, path_angle_offset=9,
        path_angle_beyond=0.6, prefer_forward=2.5, inflation_radius=0.6, cost_scaling=4.0,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("controller", "robot"), zip(MPPIS, ("p3dx", "omni4"), strict=True), ids=["default", "other"])
def test_a_plan_of_mppi_is_what_the_critics_leave(controller: Nav2Mppi, robot: str) -> None:
    rng, c = np.random.default_rng(17), controller
    noise = nav2_mppi.drawn(3, c.samples, c.steps, c.speed_noise, c.yaw_noise)
    outcomes = []
    for k, (d, left, count) in enumerate(itertools.product((0.3, 0.9, 2.5), (0.8, 1.5), (0, 12, 40, 69))):
        w = World(c, robot, rng, taken=(0.0, 0.5, 1.0)[k % 3])
        if k == 5:
            w.m["grid"] = 250  # nothing is free
        points = w.plan(count, rng.uniform(-2.5, 2.5))
        around = rng.uniform(-3.1, 3.1)
        goal = w.pose[0] + d * math.cos(around), w.pose[1] + d * math.sin(around), rng.uniform(-3.1, 3.1)
        now = 0.3, 0.1 if w.holonomic else 0.0, 0.2
        axes = [1.0, float(w.holonomic), 1.0]
        w.m["sequence"][0, : c.steps] = axes * np.cumsum(rng.normal(0.0, 0.06, (c.steps, 3)), axis=0) + now
        w.m["history"] = axes * rng.normal(0.2, 0.1, (4, 3))
        costs, sequence, history = optimised(w, points, goal, left, noise, now)
        samples = Samples.of(noise)
        found = optimise(w.p, w.m, w.costs, points.reshape(-1, 2), (w.pose, goal, left), samples, now)
        assert found == (costs is not None)
        outcomes.append(found)
        np.testing.assert_allclose(w.m["sequence"][0], sequence, atol=1e-7)
        np.testing.assert_allclose(w.m["history"][0], history, atol=1e-7)
        if found:
            np.testing.assert_allclose(samples.costs, costs, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(w.m["command"][0], sequence[0], atol=1e-7)
    assert 0 < sum(outcomes) < len(outcomes)


# DWB.


def speeds(speed: float, change: float, least: float, most: float, count: int) -> Iterator[float]:
    """Yields what is sampled of a component of the twist: even, and zero where both signs are."""
    speed = min(max(speed, least), most)
    low, high = max(speed - change, least), min(speed + change, most)
    if high - low < 1e-5:
        yield low
        return
    found = [low + (high - low) * k / (count - 1) for k in range(count)]
    for a, b in itertools.pairwise([*found, math.inf]):
        yield 0.0 if abs(a) < 1e-9 else a
        if a < -1e-9 and b > 1e-9 and b < math.inf:
            yield 0.0


def leads(w: World, now: Any, twist: Any) -> tuple[Any, float]:
    """Returns where a twist leads, and the cost there, or of a collision on the way."""
    c = w.controller
    steps = max(math.hypot(*twist[:2]) * c.horizon / c.linear_step, abs(twist[2]) * c.horizon / c.angular_step)
    dt = c.horizon / max(math.ceil(steps), 1)
    (x, y, th), at = w.pose, list(now)
    cost = w.cost(x, y)
    for _ in range(max(math.ceil(steps), 1)):
        if cost >= INSCRIBED:
            break
        for k, a in enumerate((w.acceleration, w.acceleration, w.yaw_acceleration)):
            at[k] = near(at[k], twist[k], a * dt)
        x += (math.cos(th) * at[0] - math.sin(th) * at[1]) * dt
        y += (math.sin(th) * at[0] + math.cos(th) * at[1]) * dt
        th += at[2] * dt
        cost = w.cost(x, y)
        if max(abs(x - w.pose[0]), abs(y - w.pose[1])) > 0.5 * c.window:
            cost = INSCRIBED
    return (x, y, th), cost


def score(w: World, cells: Any, nose: Any, goal: Any, far: bool, now: Any, twist: Any) -> float:
    c, m = w.controller, w.m[0]
    speed = math.hypot(*twist[:2])
    if m["near"] and speed >= (1e-300 if m["rotating"] else math.hypot(*now[:2])):
        return math.inf
    end, cost = leads(w, now, twist)
    if cost >= INSCRIBED:
        return math.inf
    sums = 0.0
    tip = end[0] + c.forward_point * math.cos(end[2]), end[1] + c.forward_point * math.sin(end[2])
    for at, last, by_path, by_goal in (
        (end, cells[-1], c.path_distance, c.goal_distance),
        (tip, nose, c.path_align if far else 0.0, c.goal_align),
    ):
        off = np.array(cells) - [math.floor(at[1] / c.local_cell), math.floor(at[0] / c.local_cell)]
        nearest = off[(off**2).sum(1).argmin()]
        sums += by_path * np.abs(nearest).sum()
        sums += by_goal * (
            abs(math.floor(at[1] / c.local_cell) - last[0]) + abs(math.floor(at[0] / c.local_cell) - last[1])
        )
    total = c.obstacle * cost + 0.5 * c.local_cell * float(sums)
    if m["near"]:
        turn = abs(wrap(goal[2] - end[2]))
        total += c.rotate_to_goal * (turn + (0.0 if m["rotating"] else c.slowing * speed**2))
    return total


DWBS = [
    Nav2Dwb(speeds=5, sideways=3, turns=6),
    Nav2Dwb(
        speeds=4, sideways=4, turns=5, max_speed=0.5, max_yaw_rate=1.3, acceleration=0.3, yaw_acceleration=0.5,
        horizon=1.2, linear_step=0.07, angular_step=0.04, window=0.9, local_cell=0.06, obstacle=0.05,
        path_distance=20.0, goal_distance=11.0, path_align=13.0, goal_align=17.0, forward_point=0.15,
        rotate_to_goal=9.0, slowing=3.0,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("controller", "robot"), zip(DWBS, ("omni4", "p3dx"), strict=True), ids=["default", "other"])
def test_dwb_drives_the_twist_of_the_least_score(controller: Nav2Dwb, robot: str) -> None:
    rng, c, legal = np.random.default_rng(19), controller, []
    for k in range(16):
        w = World(c, robot, rng, taken=(0.0, 0.3, 1.0)[k % 3])
        if k == 7:
            w.m["grid"] = 250
        points = w.plan((4, 30, 60)[k % 3], rng.uniform(-2.0, 2.0))
        goal = *(points[-1] + (0.03, 0.05)), rng.uniform(-3.1, 3.1)
        whole = k % 2 == 0  # whether the plan ends where its part in the local costmap does
        w.m["num_points"] = 2
        w.m["points"][0, 1] = points[-1] if whole else points[-1] + 1.0
        w.m["near"], w.m["rotating"] = [(0, 0), (0, 0), (1, 0), (1, 1)][k % 4]
        w.m["forbidden"] = rng.choice([-1.0, 0.0, 0.0, 1.0], 3)
        now = rng.uniform(0.0, 0.5), rng.uniform(-0.3, 0.3) if w.holonomic else 0.0, rng.uniform(-0.8, 0.8)
        far = bool(rng.random() < 0.6)
        cells = [(math.floor(y / c.local_cell), math.floor(x / c.local_cell)) for x, y in points]
        cells = [cell for cell, before in zip(cells, [None, *cells], strict=False) if cell != before]
        x, y = points[-1]
        if whole:
            way = math.atan2(goal[1] - w.pose[1], goal[0] - w.pose[0])
            x, y = x + c.forward_point * math.cos(way), y + c.forward_point * math.sin(way)
        nose = math.floor(y / c.local_cell), math.floor(x / c.local_cell)
        lateral = c.max_speed if w.holonomic else 0.0
        found = 0.0, 0.0, 0.0, math.inf
        for twist in itertools.product(
            speeds(now[0], w.acceleration * c.horizon, 0.0, c.max_speed, c.speeds),
            speeds(now[1], w.acceleration * c.horizon, -lateral, lateral, c.sideways),
            speeds(now[2], w.yaw_acceleration * c.horizon, -c.max_yaw_rate, c.max_yaw_rate, c.turns),
        ):
            too_fast = twist[0] ** 2 + twist[1] ** 2 > c.max_speed**2 + 1e-5
            if too_fast or not any(twist) or any(v * s > 0.0 for v, s in zip(twist, w.m["forbidden"][0], strict=True)):
                continue
            value = score(w, cells, nose, goal, far, now, twist)
            if value < found[3] - 1e-12:
                found = *twist, value
        got = best(w.p, w.m, w.costs, points, w.pose, goal, far, now)
        np.testing.assert_allclose(got, found, atol=1e-9)
        legal.append(found[3] < math.inf)
    assert 0 < sum(legal) < len(legal)


def test_signs_that_flip_are_forbidden_until_the_robot_has_moved() -> None:
    w, rng = World(DWBS[0], "omni4", np.random.default_rng(0), 0.0), np.random.default_rng(23)
    c, signs, forbidden, flipped_at = w.controller, [0.0] * 3, [0.0] * 3, (0.0, 0.0, 0.0)
    pose, held = np.zeros(3), 0
    for _ in range(400):
        w.m["command"] = rng.choice([-1.0, 0.0, 1.0], 3) * rng.choice([0.02, 0.3], 3)
        pose = pose + rng.normal(0.0, [0.025, 0.025, 0.06])
        flips(w.p, w.m, tuple(pose))
        flipped = False
        for k, v in enumerate(w.m["command"][0]):
            if k and abs(w.m["command"][0, 0]) > c.still_speed:
                continue
            if v * signs[k] < 0.0:
                forbidden[k], flipped = signs[k], True
            signs[k] = math.copysign(1.0, v) if v else signs[k]
        flipped_at = tuple(pose) if flipped else flipped_at
        far = math.dist(pose[:2], flipped_at[:2]) > c.reset_distance
        if any(forbidden) and (far or abs(wrap(pose[2] - flipped_at[2])) > c.reset_angle):
            signs, forbidden = [0.0] * 3, [0.0] * 3
        held += any(forbidden)
        assert w.m["forbidden"][0].tolist() == forbidden
        assert w.m["signs"][0].tolist() == signs
        assert w.m["flipped_at"][0].tolist() == pytest.approx(flipped_at)
    assert 50 < held < 350
