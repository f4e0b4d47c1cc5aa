"""Reference implementations of goal-seeking laws, from their papers and docstrings, give the same twists."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from oracles.local_planning import free  # has an oracle of its own

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.sensing import beam_angles
from wayfield.envs.scenarios.obstacles import box, circle, moving_circle, obstacle_field
from wayfield.envs.tasks.briefing import Briefing, Goals, Surroundings
from wayfield.envs.world.grids import NO_GRIDS, OccupancyGrid, lay_grids
from wayfield.envs.world.movers import motion_at
from wayfield.policies.poses.polar import Polar
from wayfield.policies.poses.potential_field import CorrectedField, PotentialField
from wayfield.policies.poses.smooth_pose import SmoothPose
from wayfield.policies.poses.waypoint import Waypoint
from wayfield.policies.scans import mppi
from wayfield.policies.scans.dwa import Dwa
from wayfield.policies.scans.mppi import Mppi
from wayfield.policies.scans.vfh_plus import VfhPlus

DT = 0.05
REACH = 5.0  # m, of the beams
BEAMS = 70  # of which none looks along the edge of a sector


def wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def body(pose: Sequence[float], x: float, y: float) -> tuple[float, float]:
    dx, dy = x - pose[0], y - pose[1]
    return math.cos(pose[2]) * dx + math.sin(pose[2]) * dy, math.cos(pose[2]) * dy - math.sin(pose[2]) * dx


def told(robot: str, actuators: str, n: int, beams: int = 0, **more: Any) -> Briefing:
    layout = Observation.layout(len(ROBOTS[robot].twist_axes), beams, REACH)
    angles = beam_angles(beams, 2.0 * math.pi) if beams else np.empty(0)
    return Briefing(n, ROBOTS[robot], ACTUATORS[actuators], DT, "twist", layout, angles, REACH, **more)


# To a pose in the open.


def arrives(was: float, px: float, py: float, radius: float) -> bool:
    r = math.hypot(px, py)
    return r <= radius or (r <= 2.0 * radius and (was == 1.0 or px <= 0.0))


def turn_on_the_spot(p: Any, turn: float, alpha: float) -> float:
    return math.copysign(min(p.turn_gain * abs(turn), math.sqrt(2.0 * alpha * abs(turn)), p.max_yaw_rate), turn)


def graceful(p: SmoothPose, px: float, py: float, turn: float) -> tuple[float, float]:
    r, delta = math.hypot(px, py), -math.atan2(py, px)
    phi = wrap(turn + delta)
    bend = p.k2 * (delta - math.atan(-p.k1 * phi)) + (1.0 + p.k1 / (1.0 + (p.k1 * phi) ** 2)) * math.sin(delta)
    curvature = -bend / r
    peak = (p.beta * (p.lam - 1.0)) ** (-1.0 / p.lam)
    if abs(curvature) <= peak:
        v = p.speed / (1.0 + p.beta * abs(curvature) ** p.lam)
        return v, v * curvature
    w = peak * p.speed / (1.0 + p.beta * peak**p.lam)  # the yaw rate is held
    return w / abs(curvature), math.copysign(w, curvature)


def smooth_pose(p: SmoothPose, base: Any, goal: Any, turn: float, left: float, m: dict[str, float]) -> Any:
    px, py = goal
    if left > 0.0:
        m["arrived"] = m["way"] = 0.0
        return graceful(p, px, py, math.atan2(py, px))
    if p.backward:

        def off(x: float, y: float) -> float:
            return abs(math.atan2(y, x)) + abs(wrap(turn - math.atan2(y, x)))

        better = off(px, py) - off(-px, -py)  # to drive backward
        m["way"] = -1.0 if better > 0.5 * math.pi * m["way"] else 1.0
    else:
        m["way"] = 1.0
    px, py = m["way"] * px, m["way"] * py
    m["arrived"] = float(arrives(m["arrived"], px, py, p.arrival_radius))
    if m["arrived"]:
        return 0.0, turn_on_the_spot(p, turn, min(p.yaw_acceleration, base.yaw_acceleration))
    v, w = graceful(p, px, py, turn)
    brake = min(1.0, math.sqrt(2.0 * min(p.deceleration, base.acceleration) * math.hypot(px, py)) / v)
    return m["way"] * brake * v, brake * w


def polar(p: Polar, base: Any, goal: Any, turn: float, left: float, m: dict[str, float]) -> Any:
    px, py = goal
    if m["way"] == 0.0 or abs(math.atan2(m["way"] * py, m["way"] * px)) > 0.75 * math.pi:
        m["way"] = 1.0 if px >= 0.0 else -1.0
    way = m["way"]
    px, py = way * px, way * py
    m["arrived"] = float(left == 0.0 and arrives(m["arrived"], px, py, p.arrival_radius))
    if m["arrived"]:
        m["way"] = 0.0
        return 0.0, turn_on_the_spot(p, turn, min(p.yaw_acceleration, base.yaw_acceleration))
    rho, alpha = math.hypot(px, py), math.atan2(py, px)
    beta = wrap(turn - alpha) if left == 0.0 else 0.0
    v, w = p.k_rho * rho, p.k_alpha * alpha + p.k_beta * beta
    deceleration = min(p.deceleration, 0.5 * base.acceleration)
    share = min(1.0, p.max_speed / v, math.sqrt(2.0 * deceleration * rho) / v, p.max_yaw_rate / max(abs(w), 1e-12))
    return way * share * v, share * w


POSES: list[tuple[Any, Callable[..., Any]]] = [
    (SmoothPose(), smooth_pose),
    (
        SmoothPose(
            k1=1.6, k2=2.3, speed=0.8, beta=0.4, lam=1.5, deceleration=0.7, arrival_radius=0.15, turn_gain=3.0,
            yaw_acceleration=2.2, max_yaw_rate=2.6, backward=True,
        ),
        smooth_pose,
    ),
    (Polar(), polar),
    (
        Polar(
            k_rho=2.0, k_alpha=5.0, k_beta=-1.1, max_speed=0.8, deceleration=0.7, arrival_radius=0.15, turn_gain=3.0,
            yaw_acceleration=2.2, max_yaw_rate=2.6,
        ),
        polar,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("policy", "law"), POSES, ids=[f"{law.__name__}_{k}" for k, (_, law) in enumerate(POSES)])
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
def test_a_law_to_a_pose_is_its_docstring(policy: Any, law: Any, actuators: str) -> None:
    n, rng = 80, np.random.default_rng(3)
    briefing = told("p3dx", actuators, n)
    goals = rng.uniform(-1.0, 1.0, (n, 2)) * rng.choice([0.03, 0.2, 0.5, 3.0], (n, 1))
    turns = rng.uniform(-3.1, 3.1, n) * rng.choice([0.1, 1.0], n)
    memory = policy.reset(briefing)
    mine = [{name: float(memory[name][k]) for name in memory.dtype.names} for k in range(n)]
    for _ in range(4):
        left = rng.choice([0.0, 0.0, 0.0, 1.0], n)
        got = policy.act(
            Observation(np.zeros((n, 3)), np.zeros((n, 2)), goals, turns, left, np.zeros((n, 0))), briefing, memory
        )
        for k in range(n):
            twist = law(policy, briefing.actuators, goals[k], turns[k], left[k], mine[k])
            np.testing.assert_allclose(got[k], twist, rtol=1e-9, atol=1e-9, err_msg=f"robot {k}")
        goals = goals + rng.normal(0.0, 0.05, (n, 2))


# By the waypoints of document B, and in the fields of document C and after.


def waypoint(p: Waypoint, pose: Any, way: Any, turn: float, m: dict[str, Any]) -> Any:
    if m["index"] < len(way) - 1 and math.dist(way[m["index"]][:2], pose[:2]) < p.switching_radius:
        m["index"] += 1
    ex, ey = body(pose, *way[m["index"]][:2])
    if m["index"] < len(way) - 1:
        return p.lam * ex, p.lam * ey, 0.0
    if math.hypot(ex, ey) <= p.final_tolerance and abs(turn) <= p.final_tolerance:
        return 0.0, 0.0, 0.0
    return p.lam * ex, p.lam * ey, p.lam * turn


@pytest.mark.parametrize("policy", [Waypoint(), Waypoint(lam=1.7, switching_radius=0.25, final_tolerance=0.2)])
def test_the_law_of_document_b_is_its_docstring(policy: Waypoint) -> None:
    n, rng = 60, np.random.default_rng(4)
    goals, counts = rng.uniform(-0.6, 0.6, (n, 3, 3)), rng.integers(1, 4, n)
    briefing = told("omni3", "lagged", n, goal=Goals(goals, counts))
    memory = policy.reset(briefing)
    mine: list[dict[str, Any]] = [{"index": 0} for _ in range(n)]
    for _ in range(6):
        poses = rng.uniform(-0.6, 0.6, (n, 3)) * [1.0, 1.0, 5.0]
        turns = rng.choice([0.0, 0.1, 1.0], n) * rng.uniform(-3.0, 3.0, n)
        near = rng.random(n) < 0.3
        poses[near, :2] = goals[np.arange(n), memory["index"]][near, :2] + rng.normal(0.0, 0.1, (near.sum(), 2))
        seen = Observation(poses, np.zeros((n, 3)), np.zeros((n, 2)), turns, np.zeros(n), np.zeros((n, 0)))
        got = policy.act(seen, briefing, memory)
        for k in range(n):
            twist = waypoint(policy, poses[k], goals[k, : counts[k]], turns[k], mine[k])
            np.testing.assert_allclose(got[k], twist, rtol=1e-9, atol=1e-9, err_msg=f"robot {k}")


def side_of(to_goal: Any, to_obstacle: Any) -> float:
    """Returns on which side of an obstacle the goal lies: 1 left or in line, -1 right."""
    return 1.0 if to_obstacle[0] * to_goal[1] - to_obstacle[1] * to_goal[0] >= -1e-6 else -1.0


def as_driven(robot: Any, force: Any, pose: Any, turn: float, gain: float, turn_gain: float) -> list[float]:
    vx, vy = body((0.0, 0.0, pose[2]), *force)
    if robot.holonomic:
        return [vx, vy, gain * turn]
    return [max(vx, 0.0), turn_gain * math.atan2(vy, vx) if math.hypot(vx, vy) > 1e-9 else 0.0]


def printed_field(p: PotentialField, robot: Any, pose: Any, to_goal: Any, turn: float, discs: Any, m: Any) -> Any:
    attraction, repulsion = p.k_att * to_goal, np.zeros(2)
    for disc in discs:
        away = pose[:2] - [disc["x"], disc["y"]]
        if np.hypot(*away) <= p.tau:
            repulsion = repulsion + p.k_rep * away / np.hypot(*away) ** 4
    force = attraction + repulsion
    if p.escape and len(discs):
        nearest = min(discs, key=lambda disc: math.dist((disc["x"], disc["y"]), pose[:2]))
        to_obstacle = np.array([nearest["x"], nearest["y"]]) - pose[:2]
        caught = np.hypot(*attraction) / (np.hypot(*repulsion) + 0.0001) <= p.tau_l
        caught = caught and np.hypot(*to_obstacle) <= p.tau
        if to_obstacle @ to_goal <= 0.0:
            m["side"] = 0.0
        if caught and m["side"] == 0.0:
            m["side"] = side_of(to_goal, to_obstacle)
        if caught:
            # away from the obstacle, turned so as to leave it on the right when the goal is to its left
            force = force + m["side"] * np.array([repulsion[1], -repulsion[0]])
    force = force * min(1.0, p.max_speed / max(np.hypot(*force), 1e-12))
    if np.hypot(*to_goal) <= p.stop_radius:
        return [0.0] * len(robot.twist_axes)
    return as_driven(robot, force, pose, turn, p.k_att, p.turn_gain)


def surface(record: Any, x: float, y: float) -> tuple[float, Any]:
    """Returns the distance from a disc or box to a point outside of it, and the direction away from it."""
    dx, dy = x - record["x"], y - record["y"]
    c, s = record["cos"], record["sin"]
    u, v = c * dx + s * dy, c * dy - s * dx
    u -= clip(u, -record["half_length"], record["half_length"])
    v -= clip(v, -record["half_width"], record["half_width"])
    away = np.array([c * u - s * v, s * u + c * v])
    return float(np.hypot(*away)) - record["radius"], away / max(np.hypot(*away), 1e-12)


def corrected_field(p: CorrectedField, robot: Any, pose: Any, to_goal: Any, turn: float, field: Any, m: Any) -> Any:
    d = float(np.hypot(*to_goal))
    force = min(p.k, p.max_speed / d) * to_goal
    opposed = False
    for record in field:
        gap, n = surface(record, *pose[:2])
        rho = max(gap - robot.hull_radius, 0.001)
        if rho > p.rho_0:
            continue
        short = 1.0 / rho - 1.0 / p.rho_0
        push = p.eta * short * d**2 / rho**2
        force = force + p.eta * short**2 * to_goal
        if n @ to_goal < 0.0:
            opposed = True
            if m["side"] == 0.0:
                m["side"] = side_of(to_goal, -n)
            force = force + push * m["side"] * np.array([n[1], -n[0]])
        else:
            force = force + push * n
    if not opposed:
        m["side"] = 0.0
    force = force * min(1.0, p.max_speed / np.hypot(*force))
    within = min(p.stop_radius, 0.8 * m["tolerance"])
    m["rests"] = m["left"] == 0.0 and d <= (2.0 * within if m["rests"] else within)
    if m["rests"] and not robot.holonomic:
        return [0.0, p.turn_gain * turn]
    return as_driven(robot, force, pose, turn, p.k, p.turn_gain)


FIELDS: list[tuple[Any, Callable[..., Any]]] = [
    (PotentialField(), printed_field),
    (PotentialField(k_att=0.4, k_rep=0.3, tau=0.8, max_speed=0.5, stop_radius=0.4, turn_gain=1.3), printed_field),
    (PotentialField(escape=True, tau=0.9, tau_l=1.4, max_speed=0.4), printed_field),
    (CorrectedField(), corrected_field),
    (CorrectedField(k=0.9, eta=0.05, rho_0=0.9, max_speed=0.5, turn_gain=1.3), corrected_field),
    (CorrectedField(stop_radius=0.9), corrected_field),
]


@pytest.mark.parametrize(("policy", "law"), FIELDS, ids=[f"{law.__name__}_{k}" for k, (_, law) in enumerate(FIELDS)])
@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_a_field_is_its_docstring(policy: Any, law: Any, robot: str) -> None:
    n, rng = 60, np.random.default_rng(5)
    field = obstacle_field(
        circle(0.9, 0.3, 0.2), circle(-0.7, 0.8, 0.15), box(0.2, -1.1, 0.8, 0.3, 0.4), circle(1.5, -0.9, 0.3)
    )
    counts = rng.integers(0, len(field) + 1, n)
    briefing = told(
        robot, "lagged", n, map=Surroundings.of(np.tile(field, (n, 1)), counts),
        goal=Goals(np.zeros((n, 1, 3)), np.ones(n, np.int64)), position_tolerance=rng.uniform(0.5, 1.5, n),
    )  # fmt: skip
    memory = policy.reset(briefing)
    left = rng.choice([0.0, 0.0, 1.0], n)
    tolerances = briefing.position_tolerance
    mine = [{"side": 0.0, "rests": False, "left": left[k], "tolerance": tolerances[k]} for k in range(n)]
    poses = np.empty((n, 3))
    for k in range(n):
        while True:
            poses[k] = rng.uniform(-2.0, 2.0, 3) * [1.0, 1.0, 1.5]
            if min(surface(record, *poses[k, :2])[0] for record in field) > 0.03:
                break
    to_goals = rng.uniform(-1.5, 1.5, (n, 2))
    for _ in range(3):
        turns = rng.uniform(-3.0, 3.0, n)
        goals = np.array([body((0.0, 0.0, pose[2]), *to) for pose, to in zip(poses, to_goals, strict=True)])
        axes = len(briefing.robot.twist_axes)
        seen = Observation(poses, np.zeros((n, axes)), goals, turns, left, np.zeros((n, 0)))
        got = policy.act(seen, briefing, memory)
        for k in range(n):
            twist = law(policy, briefing.robot, poses[k], to_goals[k], turns[k], field[: counts[k]], mine[k])
            np.testing.assert_allclose(got[k], twist, rtol=1e-7, atol=1e-9, err_msg=f"robot {k}")
        to_goals = to_goals + rng.normal(0.0, 0.3, (n, 2))


def test_a_field_is_that_of_where_patrols_are_by_now_and_of_the_nearest_point_of_a_map() -> None:
    disc = moving_circle(1.0, 0.9, 0.2, 0.1, -0.3, 5.0, 1.0)
    seen = Observation(
        np.zeros((1, 3)), np.zeros((1, 3)), np.array([[3.0, 0.0]]), np.zeros(1), np.zeros(1), np.zeros((1, 0))
    )
    policy = CorrectedField(rho_0=1.5)
    goals = {"goal": Goals(np.zeros((1, 1, 3)), np.ones(1, np.int64)), "position_tolerance": np.array([0.2])}

    def driven(obstacle: Any, count: int = 1, times: int = 1, **more: Any) -> Any:
        around = Surroundings.of(np.tile(obstacle_field(obstacle), (1, 1)), np.array([count]), **more)
        briefing = told("omni4", "lagged", 1, map=around, **goals)
        memory = policy.reset(briefing)
        return [policy.act(seen, briefing, memory) for _ in range(times)]

    moving = driven(disc, times=12)
    for k, twist in enumerate(moving):
        there = disc.copy()
        there["x"], there["y"] = motion_at(disc, k * DT)[:2]
        there["patrol"] = 0
        np.testing.assert_allclose(twist, driven(there)[0], atol=1e-12)
    assert np.abs(moving[0] - moving[-1]).max() > 0.01
    cell = OccupancyGrid(np.eye(1, dtype=bool), 0.2, (0.5, 0.3, 0.0), "free")
    grids = lay_grids([cell], np.zeros(1, NO_GRIDS.frames.dtype))
    corner = circle(0.5, 0.3, 1e-9)
    np.testing.assert_allclose(driven(disc, 0, grids=grids)[0], driven(corner)[0], atol=1e-6)
    assert np.abs(driven(corner)[0] - driven(disc, 0)[0]).max() > 0.01


# By the scan: the dynamic window and the histogram, with what they remember; what comes and dead ends have laws of
# their own in tests/laws.


class Sights:
    """What a seeker makes of its scans, by `parts.stopping`."""

    def __init__(self, p: Any, briefing: Briefing) -> None:
        self.p, self.base, self.robot = p, briefing.actuators, briefing.robot
        self.angles = briefing.beam_angles
        self.delay = self.base.lag + DT
        self.command = np.zeros(3)
        self.kept: list[tuple[float, float, float]] = []  # x, y in the world, for how long still
        self.resting = False

    def hits(self, ranges: Any, pose: Any, farthest: float, radius: float) -> list[list[float]]:
        near: dict[int, tuple[float, float, float, float]] = {}

        def remember(x: float, y: float, left: float) -> None:
            sector = int((math.atan2(y, x) / (2.0 * math.pi) + 0.5) * 36) % 36
            away = math.hypot(x, y)
            if sector not in near or away < near[sector][2]:
                near[sector] = x, y, away, left

        for x, y, left in self.kept:
            if left - DT > 0.0:
                remember(*body(pose, x, y), left - DT)
        found = []
        for angle, distance in zip(self.angles, ranges, strict=True):
            if distance < min(farthest, (1.0 - 1e-6) * REACH):
                x, y = distance * math.cos(angle), distance * math.sin(angle)
                found.append([x, y, min(radius, (1.0 - 1e-6) * distance)])
                if distance < 1.2:
                    remember(x, y, self.p.recall)
        self.kept = []
        c, s = math.cos(pose[2]), math.sin(pose[2])
        for x, y, away, left in near.values():
            if away < 1.2:
                self.kept.append((pose[0] + c * x - s * y, pose[1] + s * x + c * y, left))
                if left < self.p.recall:
                    found.append([x, y, min(radius, (1.0 - 1e-6) * away)])
        return found

    def arrived(self, d: float, left: float) -> bool:
        if left > 0.0 or d > 2.0 * self.p.stop_radius:
            self.resting = False
        elif d <= self.p.stop_radius:
            self.resting = True
        return self.resting

    def turn(self, error: float) -> float:
        rate = clip(self.p.turn_gain * error, -self.p.max_yaw_rate, self.p.max_yaw_rate)
        return 0.0 if abs(error) < 0.0175 else rate

    def braking(self, d: float) -> float:
        """Returns the root of v delay + v^2 / (2 a) = d, with seven tenths of the acceleration."""
        a = 0.7 * self.base.acceleration
        return a * (math.sqrt(self.delay**2 + 2.0 * d / a) - self.delay)

    def admissible(self, clear: float, v: float, w: float) -> bool:
        t = clear - self.delay
        return v == 0.0 or (t > 0.0 and v <= 2.0 * self.base.acceleration * t
                            and abs(w) <= 2.0 * self.base.yaw_acceleration * t)  # fmt: skip

    def saturated(self, twist: Any) -> Any:
        wheels = np.abs(self.robot.wheel_matrix @ twist).max()
        limit = self.robot.rated_wheel_speed if self.base.at_rated_speed else self.robot.peak_wheel_speed
        factor = min(1.0, limit / wheels) if wheels > 0.0 else 1.0
        return twist * (min(factor, self.robot.turn_speed / abs(twist[2])) if twist[2] else factor)

    def limited(self, last: Any, twist: Any) -> Any:
        change, most = twist[:2] - last[:2], self.base.acceleration * DT
        if np.hypot(*change) > most:
            change = change * most / np.hypot(*change)
        spin = clip(twist[2] - last[2], -self.base.yaw_acceleration * DT, self.base.yaw_acceleration * DT)
        return np.array([*(last[:2] + change), last[2] + spin])

    def can_stop(self, hits: Any, wheels: Any, twist: Any) -> bool:
        """Returns whether a period of the twist, and then the brakes, keep the distance to all hits."""
        decay = math.exp(-DT / self.base.lag)
        command, wheels, pose = self.command, np.array(wheels), np.zeros(3)
        for k in range(1000):
            command = self.limited(command, twist if k == 0 else np.zeros(3))
            mean = command + (wheels - command) * self.base.lag / DT * (1.0 - decay)
            wheels = command + (wheels - command) * decay
            pose = arc(pose, mean, DT)
            if (np.hypot(hits[:, 0] - pose[0], hits[:, 1] - pose[1]) < hits[:, 2]).any():
                return False
            if max(np.abs(wheels[:2]).max(), np.abs(command[:2]).max()) < 1e-3:
                break
        return True


def arc(pose: Any, twist: Any, t: float) -> Any:
    """Returns the pose after a twist has acted for a time, by complex numbers."""
    turn = twist[2] * t
    way = complex(twist[0], twist[1])
    chord = way * t if abs(turn) < 1e-9 else way * (np.exp(1j * turn) - 1.0) / (1j * twist[2])
    chord *= np.exp(1j * pose[2])
    return np.array([pose[0] + chord.real, pose[1] + chord.imag, pose[2] + turn])


def window(me: Sights, hits: Any, goal: Any, turn: float, left: float) -> Any:
    """Returns the twists of the dynamic window with their values, best first, those that cannot stop left out."""
    p, base = me.p, me.base
    d, sideways = math.hypot(*goal), me.robot.holonomic
    aim = math.atan2(goal[1], goal[0])
    fastest = min(p.max_speed, me.braking(d)) if left == 0.0 else p.max_speed
    tried = []
    if sideways:
        for a in range(7):
            for b in range(15):
                angle = aim + 2.0 * math.pi * b / 15
                u = me.command[:2] + min(base.acceleration * p.window, p.max_speed) * a / 6 * np.array(
                    [math.cos(angle), math.sin(angle)]
                )
                u = u * min(1.0, fastest / max(np.hypot(*u), 1e-12))
                tried.append(me.saturated(np.array([*u, turn])))
    else:
        slow = max(me.command[0] - base.acceleration * p.window, 0.0)
        fast = max(min(me.command[0] + base.acceleration * p.window, fastest), slow)
        right = max(me.command[2] - base.yaw_acceleration * p.window, -p.max_yaw_rate)
        to_left = min(me.command[2] + base.yaw_acceleration * p.window, p.max_yaw_rate)
        tried = [
            me.saturated(np.array([v, 0.0, w]))
            for v in np.linspace(slow, fast, 7)
            for w in np.linspace(right, to_left, 15)
        ]
    scored = []
    for twist in tried:
        v, w = math.hypot(twist[0], twist[1]), twist[2]
        clear = free(hits, *twist, p.horizon)
        if not me.admissible(clear, v, w):
            continue
        until = min(clear, d / max(v, 1e-9))
        end, soon = arc(np.zeros(3), twist, until), arc(np.zeros(3), twist, min(until, 1.0))
        if sideways:
            off = abs(wrap(aim - math.atan2(twist[1], twist[0]))) if v > 1e-6 else math.pi
        else:
            off = abs(wrap(aim - w * (DT + 0.5 * abs(w) / base.yaw_acceleration)))
        gap = min(
            np.hypot(hits[:, 0] - soon[0], hits[:, 1] - soon[1]).min(initial=math.inf) - me.robot.hull_radius,
            p.room_range,
        )
        value = (
            p.heading * (1.0 - off / math.pi)
            + p.clearance * clear / p.horizon
            + p.velocity * (v if sideways else twist[0]) / p.max_speed
            + p.progress * (d - math.dist(goal, end[:2])) / (p.max_speed * p.horizon)
            + p.room * max(gap, 0.0) / p.room_range
        )
        scored.append((value, twist))
    scored.sort(key=lambda each: -each[0])
    return scored


def scene_of(rng: Any, n: int) -> Any:
    """Returns discs (n, 6, 5) around robots: x, y, radius, and velocities of half of them, of one that comes close."""
    discs = np.empty((n, 6, 5))
    angles, away = rng.uniform(-math.pi, math.pi, (n, 6)), rng.uniform(0.7, 3.0, (n, 6))
    discs[..., 0], discs[..., 1] = away * np.cos(angles), away * np.sin(angles)
    discs[..., 2] = rng.uniform(0.1, 0.35, (n, 6))
    speeds = rng.uniform(0.0, 0.7, (n, 6)) * (rng.random((n, 6)) < 0.5)
    discs[:, 0, :2] *= 0.65 / away[:, :1]
    discs[:, 0, 2] = 0.2
    speeds[:, 0] = 0.45
    discs[..., 3], discs[..., 4] = -speeds * np.cos(angles), -speeds * np.sin(angles)
    return discs


def look(pose: Any, discs: Any, angles: Any) -> Any:
    """Returns what beams read."""
    ranges = np.full(len(angles), REACH)
    for j, angle in enumerate(angles + pose[2]):
        for x, y, radius, *_ in discs:
            along = (x - pose[0]) * math.cos(angle) + (y - pose[1]) * math.sin(angle)
            across = (y - pose[1]) * math.cos(angle) - (x - pose[0]) * math.sin(angle)
            if along > 0.0 and abs(across) < radius:
                ranges[j] = min(ranges[j], max(along - math.sqrt(radius**2 - across**2), 1e-6))
    return ranges


WINDOWS = [
    Dwa(foresight=0.0, patience=math.inf),
    Dwa(
        max_speed=0.5, max_yaw_rate=1.1, window=0.4, horizon=1.6, margin=0.06, heading=0.8, clearance=0.6, velocity=0.4,
        progress=0.7, room=0.5, room_range=0.4, turn_gain=1.4, stop_radius=0.3, patience=math.inf, recall=0.3,
        foresight=0.0,
    ),
    Dwa(foresight=0.0, patience=math.inf, room=0.0),
]  # fmt: skip


class Look(NamedTuple):
    """What one robot of a batch is told in a step, and the twist that its policy asks for."""

    robot: int
    me: Any  # its memory, a kind of `Sights`
    ranges: Any
    pose: Any
    wheels: Any
    to_goal: Any
    turn: float
    left: float
    got: Any


def looks(policy: Any, sights: Any, robot: str, n: int, seed: int, shares: Sequence[float]) -> Iterator[Look]:
    """Yields what each robot of a batch sees among discs that move, step by step, as the policy drives it.

    Args:
        sights: the kind of memory.
        shares: of goals up to 2.5 m away along each axis, drawn.
    """
    rng = np.random.default_rng(seed)
    briefing = told(robot, "slow" if policy.margin == 0.06 else "lagged", n, BEAMS)
    axes = list(briefing.robot.twist_axes)
    memory = policy.reset(briefing)
    mine = [sights(policy, briefing) for _ in range(n)]
    discs, goals = scene_of(rng, n), rng.uniform(-2.5, 2.5, (n, 2)) * rng.choice(shares, (n, 1))
    poses, wheels = rng.uniform(-0.1, 0.1, (n, 3)), np.zeros((n, 3))
    left = np.zeros(n)
    left[::3] = 1.0
    goals[3] = 0.2, 0.1  # a waypoint close by
    for _ in range(16):
        ranges = np.array([look(poses[k], discs[k], briefing.beam_angles) for k in range(n)])
        to_goals = np.array([body(pose, *goal) for pose, goal in zip(poses, goals, strict=True)])
        turns = rng.uniform(-1.0, 1.0, n)
        seen = Observation(poses, wheels[:, axes], to_goals, turns, left, ranges)
        got = np.zeros((n, 3))
        got[:, axes] = policy.act(seen, briefing, memory)
        for k, me in enumerate(mine):
            yield Look(k, me, ranges[k], poses[k], wheels[k], to_goals[k], turns[k], left[k], got[k])
            me.command = me.limited(me.command, me.saturated(got[k]))
            wheels[k] = me.command + (wheels[k] - me.command) * math.exp(-DT / me.base.lag)
            poses[k] = arc(poses[k], wheels[k], DT)
        discs[..., :2] += DT * discs[..., 3:]


@pytest.mark.parametrize(
    ("policy", "robot"), [*zip([*WINDOWS, WINDOWS[0]], ["p3dx", "omni4", "p3dx", "omni4"], strict=True)]
)
def test_the_dynamic_window_is_its_docstring(policy: Dwa, robot: str) -> None:
    for k, me, ranges, pose, wheels, to_goal, turned, left, got in looks(policy, Sights, robot, 8, 6, [0.1, 1.0, 1.0]):
        radius = me.robot.hull_radius + policy.margin
        a = me.base.acceleration
        far = policy.max_speed * (me.delay + DT + policy.max_speed / a)
        far = radius + policy.room_range + max(policy.max_speed * policy.horizon, far, 3.0)
        found = me.hits(ranges, pose, far, radius)
        hits = np.array(found).reshape(-1, 3)
        turn = me.turn(turned)
        if me.arrived(math.hypot(*to_goal), left):
            np.testing.assert_allclose(got, [0.0, 0.0, turn], atol=1e-9)
            continue
        best = None
        for value, twist in window(me, hits, to_goal, turn, left):
            if best is not None and value < best - 1e-7:
                best = None  # what is driven is none of the best
                break
            if me.can_stop(hits, wheels, twist):
                best = value if best is None else best
                if np.allclose(twist, got, atol=1e-6):
                    break
        else:
            twist = np.zeros(3)
        np.testing.assert_allclose(got, twist, atol=1e-6, err_msg=f"robot {k}")


class Histogram(Sights):
    """The memory of VFH+: its binary histogram and the direction chosen last."""

    def __init__(self, p: Any, briefing: Briefing) -> None:
        super().__init__(p, briefing)
        self.binary = [False] * 144
        self.previous: float | None = None
        self.barred = False

    def choose(self, hits: Any, pose: Any, aim: float, d: float) -> tuple[float | None, list[float]]:
        """Returns the direction (world frame) and the primary histogram."""
        p, heading = self.p, pose[2]
        sideways = self.robot.holonomic
        speed = math.hypot(*self.command[:2])
        course: float | None = heading
        if sideways:
            course = heading + math.atan2(self.command[1], self.command[0]) if speed > 0.05 else None
        goal = None if d >= p.window else (d * math.cos(aim), d * math.sin(aim))
        grown = self.robot.hull_radius + p.safety
        if goal is not None:
            nearest = min([math.dist(point, goal) for point in self.weighed(hits, pose)], default=math.inf)
            grown = min(grown, max(self.robot.hull_radius + p.margin, nearest))
        centres = [(k + 0.5) * math.radians(2.5) - math.pi for k in range(144)]
        primary = [0.0] * 144
        left, right = math.pi, -math.pi
        for x, y in self.weighed(hits, pose):
            away = max(math.hypot(x, y), 1e-6)
            if away >= min(p.window, d + grown):
                continue
            if goal is not None and x * goal[0] + y * goal[1] >= d * d and abs(goal[0] * y - goal[1] * x) < d * grown:
                continue
            beam, half = math.atan2(y, x), math.asin(min(1.0, grown / away))
            for k, centre in enumerate(centres):
                if abs(wrap(centre - heading - beam)) <= half:
                    magnitude = 1.0 - (away / p.window) ** 2
                    primary[k] = primary[k] + magnitude if p.magnitudes == "sum" else max(primary[k], magnitude)
            if not sideways and speed > 0.05:
                circle_radius = speed / p.max_yaw_rate
                if beam >= 0.0 and math.dist((x, y), (0.0, circle_radius)) < circle_radius + grown:
                    left = min(left, beam)
                if beam <= 0.0 and math.dist((x, y), (0.0, -circle_radius)) < circle_radius + grown:
                    right = max(right, beam)
        self.binary = [value >= p.high or (was and value >= p.low)
                       for was, value in zip(self.binary, primary, strict=True)]  # fmt: skip
        masked = [was or not right <= wrap(centre - heading) <= left
                  for was, centre in zip(self.binary, centres, strict=True)]  # fmt: skip
        choice = self.cheapest(masked, heading + aim, goal is not None, course)
        self.barred = choice is None
        if choice is None:
            choice = self.cheapest(self.binary, heading + aim, goal is not None, course)
        self.previous = choice
        return choice, primary

    def weighed(self, hits: Any, pose: Any) -> list[tuple[float, float]]:
        """Returns the points that magnitudes are of: the hits, or the centres of the cells of 0.1 m that hold one."""
        if self.p.magnitudes == "largest":
            return [(x, y) for x, y, _ in hits]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        cells = {(math.floor((pose[0] + c * x - s * y) / 0.1), math.floor((pose[1] + s * x + c * y) / 0.1))
                 for x, y, _ in hits}  # fmt: skip
        return [body(pose, 0.1 * (u + 0.5), 0.1 * (v + 0.5)) for u, v in sorted(cells)]

    def cheapest(self, blocked: list[bool], goal: float, close: bool, course: float | None) -> float | None:
        if not any(blocked):
            return wrap(goal)
        width, offered = math.radians(2.5), []
        for first in range(144):
            if blocked[first] or not blocked[first - 1]:
                continue
            size = next(n for n in range(1, 145) if blocked[(first + n) % 144])
            low, gap = first * width - math.pi, size * width
            inset = 0.5 * min(self.p.wide, gap)
            offered += [low + inset, low + gap - inset]
            off = abs(wrap(goal - low - 0.5 * gap))
            if off <= 0.5 * gap - (0.0 if close else inset):
                offered.append(goal)

        def cost(c: float) -> float:
            total = self.p.mu_goal * abs(wrap(c - goal))
            total += 0.0 if course is None else self.p.mu_heading * abs(wrap(c - course))
            return total + (0.0 if self.previous is None else self.p.mu_previous * abs(wrap(c - self.previous)))

        return wrap(min(offered, key=cost)) if offered else None


def histogram(me: Histogram, hits: Any, goal: Any, turn: float, left: float, pose: Any, wheels: Any) -> Any:
    """Returns the twist of VFH+."""
    p, d, sideways = me.p, math.hypot(*goal), me.robot.holonomic
    choice, primary = me.choose(hits, pose, math.atan2(goal[1], goal[0]), d)
    if choice is None:
        return np.zeros(3)
    fastest = 0.0 if me.barred else p.max_speed
    if left == 0.0:
        fastest = min(fastest, me.braking(d))
    off = wrap(choice - pose[2])
    sector = int((wrap(pose[2] + (off if sideways else 0.0)) + math.pi) / math.radians(2.5)) % 144
    way = (math.cos(off), math.sin(off)) if sideways else (1.0, 0.0)
    w = turn if sideways else me.turn(off)
    fastest *= (1.0 if sideways else max(math.cos(off), 0.0) ** 2) * (1.0 - p.slowing * min(primary[sector], 1.0))
    for n in range(8, -1, -1):
        v = fastest * n / 8
        twist = me.saturated(np.array([v * way[0], v * way[1], w]))
        clear = free(hits, *twist, 2.0)
        if me.admissible(clear, math.hypot(*twist[:2]), 0.0) and me.can_stop(hits, wheels, twist):
            return twist
    return np.array([0.0, 0.0, w])


HISTOGRAMS = [
    VfhPlus(foresight=0.0, patience=math.inf),
    VfhPlus(
        max_speed=0.5, max_yaw_rate=1.1, turn_gain=1.6, safety=0.09, margin=0.06, window=1.9, low=0.2, high=0.6,
        wide=0.7, mu_goal=4.3, mu_heading=1.0, mu_previous=3.0, slowing=0.8, stop_radius=0.3, patience=math.inf,
        recall=0.3, foresight=0.0,
    ),
    VfhPlus(foresight=0.0, patience=math.inf, magnitudes="sum", high=0.8),
]  # fmt: skip


@pytest.mark.parametrize(
    ("policy", "robot"), [*zip([*HISTOGRAMS, HISTOGRAMS[0]], ["p3dx", "omni4", "p3dx", "omni4"], strict=True)]
)
def test_the_vector_field_histogram_is_its_docstring(policy: VfhPlus, robot: str) -> None:
    for k, me, ranges, pose, wheels, to_goal, turned, left, got in looks(
        policy, Histogram, robot, 10, 8, [0.1, 0.5, 1]
    ):
        radius = me.robot.hull_radius + policy.margin
        far = max(policy.window, radius + max(policy.max_speed * 2.0, 3.0))
        hits = me.hits(ranges, pose, far, radius)
        twist = np.array([0.0, 0.0, me.turn(turned)])
        if not me.arrived(math.hypot(*to_goal), left):
            known = np.array(hits).reshape(-1, 3)
            twist = histogram(me, known, to_goal, twist[2], left, pose, wheels)
        np.testing.assert_allclose(got, twist, atol=1e-6, err_msg=f"robot {k}")


# By sampled plans: what one of them costs.


def between(grid: Any, cell: float, half: int, x: float, y: float) -> float:
    """Returns the grid's value at a point, bilinear, and that of its border beyond."""
    nodes = np.arange(-half, half + 1) * cell
    by_row = [float(np.interp(y, nodes, row)) for row in grid]
    return float(np.interp(x, nodes, by_row))


def plan_cost(p: Mppi, base: Any, robot: Any, plan: Any, command: Any, wheels: Any, goal: Any, grids: Any) -> Any:
    """Returns the cost of a plan, and whether it ends at an obstacle."""
    goal_x, goal_y, turn, last_leg = goal
    clearances, ways = grids
    half, h = math.ceil(p.reach / p.cell), p.step_time
    least = min(p.margin, 0.5 * between(clearances, p.cell, half, 0.0, 0.0))
    decay = math.exp(-h / base.lag)
    pose, total, way = np.zeros(3), 0.0, 0.0
    limit = robot.rated_wheel_speed if base.at_rated_speed else robot.peak_wheel_speed
    for t, wanted in enumerate(plan):
        fastest = np.abs(robot.wheel_matrix @ wanted).max()
        wanted_here = wanted * min(1.0, limit / fastest, robot.turn_speed / max(abs(wanted[2]), 1e-9))
        change = wanted_here[:2] - command[:2]
        change = change * min(1.0, base.acceleration * h / max(np.hypot(*change), 1e-12))
        spin = clip(wanted_here[2] - command[2], -base.yaw_acceleration * h, base.yaw_acceleration * h)
        command = command + np.append(change, spin)
        pose = arc(pose, command + (wheels - command) * base.lag / h * (1.0 - decay), h)
        wheels = command + (wheels - command) * decay
        gap = between(clearances, p.cell, half, pose[0], pose[1])
        way = math.dist(pose[:2], (goal_x, goal_y))
        if p.detour and way > 3.0 * p.cell:
            way = between(ways, p.cell, half, pose[0], pose[1])
        if gap < least:
            left = len(plan) - t
            total += left * (p.collision_cost + p.goal_weight * way)
            return total / len(plan) + p.terminal_weight * way, True
        total += p.goal_weight * way + p.obstacle_weight * max(1.0 - gap / p.influence, 0.0) ** 2
        total += p.turn_weight * wanted[2] ** 2 + p.sway_weight * abs(wanted[1])
        if not robot.holonomic:
            total += p.reverse_weight * max(-wanted[0], 0.0)
        elif last_leg:
            total += p.heading_weight * abs(wrap(turn - pose[2]))
    return total / len(plan) + p.terminal_weight * way, False


COSTS = [
    Mppi(steps=12),
    Mppi(
        steps=9, step_time=0.17, goal_weight=0.7, terminal_weight=0.4, obstacle_weight=1.3, turn_weight=0.2,
        reverse_weight=0.9, heading_weight=0.6, sway_weight=0.8, collision_cost=40.0, influence=0.7, margin=0.06,
        reach=2.0, cell=0.2,
    ),
    Mppi(steps=12, detour=False),
]  # fmt: skip


@pytest.mark.parametrize("policy", COSTS, ids=["default", "other", "straight"])
@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_what_a_plan_costs_is_the_printed_sum(policy: Mppi, robot: str) -> None:
    briefing, rng = told(robot, "slow" if policy.margin == 0.06 else "lagged", 1, BEAMS), np.random.default_rng(9)
    base, axes = briefing.actuators, list(briefing.robot.twist_axes)
    p = policy.params(briefing)[0]
    side = 2 * math.ceil(policy.reach / policy.cell) + 1
    cut = 0
    for _ in range(40):
        plan, command, wheels = np.zeros((policy.steps, 3)), np.zeros(3), np.zeros(3)
        plan[:, axes] = rng.uniform(-1.0, 1.0, (policy.steps, len(axes))) + rng.uniform(-0.5, 1.0, len(axes))
        command[axes] = rng.uniform(-0.4, 0.4, len(axes))
        wheels[axes] = rng.uniform(-0.4, 0.4, len(axes))
        near = np.linspace(-policy.reach, policy.reach, side)
        slope = rng.uniform(-1.0, 1.0, 2)
        clearances = 0.3 + slope[0] * near[:, None] + slope[1] * near[None, :] + rng.uniform(0.0, 0.1, (side, side))
        ways = rng.uniform(0.0, 5.0, (side, side))
        goal = (*rng.uniform(-1.5, 1.5, 2), rng.uniform(-3.0, 3.0), bool(rng.random() < 0.5))
        found = mppi.roll_out(p, plan, command, wheels, goal, clearances, ways)
        wanted, blocked = plan_cost(policy, base, briefing.robot, plan, command, wheels, goal, (clearances, ways))
        cut += blocked
        assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6)
    assert 0 < cut < 40
