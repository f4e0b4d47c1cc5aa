"""Reference implementation of a network's inputs, of what its outputs mean and of what guards them."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield.envs import goal_reaching, path_following
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.policies.learned import perception
from wayfield.policies.learned.perception import (
    Actions,
    DockFeatures,
    GoalFeatures,
    PathFeatures,
    Perception,
    limits_of,
)

DT = 0.05
BEAMS = 72
BEAM = 2.0 * math.pi / BEAMS


def wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def clip(value: float, most: float = 5.0) -> float:
    return min(max(value, -most), most)


def turned(angle: float, x: float, y: float) -> tuple[float, float]:
    """Returns a vector as it is seen from a frame that is turned by an angle."""
    return math.cos(angle) * x + math.sin(angle) * y, math.cos(angle) * y - math.sin(angle) * x


# What is seen, number by number. `seen` is one robot's row of an observation, `m` what it remembers.


def of_path(f: PathFeatures, seen: Any, speed: float) -> Iterator[float]:
    e, turn = seen.cross_track_error, seen.heading_error
    yield from (math.asinh(e / f.error_scale), clip(e / (10.0 * f.error_scale)), math.sin(turn), math.cos(turn))
    yield speed / f.speed_scale
    yield from (clip(v / f.speed_scale) for v in seen.twist[:-1])
    yield clip(seen.twist[-1] / f.yaw_scale)
    yield from (clip(v / f.preview_scale) for v in seen.preview.ravel())
    # seen from the body the path leads to -turn, and its nearest point lies at its right where the robot is left of it
    heading = -turn
    at = e * complex(math.sin(heading), -math.cos(heading))
    for x, y in seen.preview:
        bend, way = 0.0, complex(x, y) - at
        if abs(way) > 0.01:
            ahead = math.atan2(way.imag, way.real)
            bend, heading = wrap(ahead - heading), ahead
        yield math.asinh(bend / f.turn_scale)
        at = complex(x, y)


def frame_of(f: GoalFeatures, seen: Any) -> float:
    return round(math.atan2(seen.goal[1], seen.goal[0]) / BEAM) * BEAM if f.frame == "goal" else 0.0


def near(f: GoalFeatures, d: float) -> float:
    return f.range_scale / (f.range_scale + max(d, 0.0))


def of_goal(f: GoalFeatures, seen: Any, speed: float) -> Iterator[float]:
    frame = frame_of(f, seen)
    aside, r = math.atan2(seen.goal[1], seen.goal[0]), math.hypot(*seen.goal)
    yield from (math.asinh(r / f.distance_scale), r / (r + 0.2), math.sin(aside - frame), math.cos(aside - frame))
    yield speed / f.speed_scale
    if len(seen.twist) == 3:
        yield from (clip(v / f.speed_scale) for v in turned(frame, *seen.twist[:2]))
    else:
        yield clip(seen.twist[0] / f.speed_scale)
    yield clip(seen.twist[-1] / f.yaw_scale)
    angles = np.arange(BEAMS) * BEAM - math.pi  # of the beams, in the body frame
    ways = np.arange(0, BEAMS, f.pool) * BEAM - math.pi + frame  # of the directions, likewise
    for way in ways:
        first = round((way + math.pi) / BEAM)
        yield near(f, min(seen.ranges[(first + k) % BEAMS] for k in range(f.pool)) - f.hull_radius)
    for way in ways:
        free = f.max_range
        for angle, r in zip(angles, seen.ranges, strict=True):
            along, across = r * math.cos(angle - way), abs(r * math.sin(angle - way))
            radius = min(f.hull_radius + f.margin, r)  # what is nearer is touched already
            if r < f.max_range and across < radius and math.cos(angle - way) > 0.01:
                free = min(free, max(along - math.sqrt(radius**2 - across**2), 0.0))
        yield near(f, free)


def of_pose(f: DockFeatures, seen: Any) -> Iterator[float]:
    yield from (math.asinh(v / f.fine) for v in turned(frame_of(f, seen), *seen.goal))
    turn = seen.goal_heading_error
    yield from (math.sin(turn), math.cos(turn), math.asinh(turn / f.fine_turn))


def of_trails(f: Any, seen: Any, m: dict[str, Any], frame: float) -> Iterator[float]:
    place = seen.pose[:2]
    for k, time in enumerate(f.trails):
        point = m.setdefault(("trail", k), place.copy())
        point += (1.0 - math.exp(-DT / time)) * (place - point)
        away = (point - place) / (f.speed_scale * time)
        yield from (clip(v) for v in turned(seen.pose[2] + frame, *away))


def of_crumbs(f: GoalFeatures, seen: Any, m: dict[str, Any], frame: float) -> Iterator[float]:
    place, r = seen.pose[:2], np.float32(math.hypot(*seen.goal))
    crumbs = m.setdefault("crumbs", [])
    if not crumbs or math.dist(place, crumbs[-1]) >= f.crumb_gap:
        crumbs.append(np.float32(place))
    if "least" not in m or r < m["least"] or r > m["last"] + 0.5:
        m["least"], m["waited"] = r, 0.0
    else:
        m["waited"] += DT
    m["last"] = r
    yield from (math.asinh(r - m["least"]), m["waited"] / (m["waited"] + 5.0))
    directions = [0.0] * (BEAMS // f.pool)
    for crumb in crumbs[-f.crumbs :]:
        dx, dy = crumb - place
        turn = wrap(math.atan2(dy, dx) - seen.pose[2] - frame)
        j = round(turn / (f.pool * BEAM)) % len(directions)
        directions[j] = max(directions[j], near(f, math.hypot(dx, dy)))
    yield from directions


def nearest_step(points: Any, px: float, py: float, most: float) -> tuple[float, float, float]:
    """Returns the shortest step, under `most`, to a point from the lines through neighbours of an older scan."""
    found = 0.0, 0.0
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        along = b - a
        length = math.hypot(*along)
        if not 0.0 < length < 0.4:
            continue
        foot = float(np.dot((px, py) - a, along)) / length
        if not 0.0 <= foot <= length:
            continue
        step = (px, py) - a - foot * along / length
        if math.hypot(*step) < most:
            most, found = math.hypot(*step), (step[0], step[1])
    return most, *found


def of_moving(f: GoalFeatures, seen: Any, m: dict[str, Any], frame: float) -> Iterator[float]:
    x, y, heading = seen.pose
    none = np.full((BEAMS, 2), np.nan)
    older, newer = m.setdefault("older", [0.0, none]), m.setdefault("newer", [0.0, none])
    older[0], newer[0] = older[0] + DT, newer[0] + DT
    if newer[0] > 0.2 - 0.5 * DT:
        older = m["older"] = newer
        newer = m["newer"] = [0.0, none.copy()]
    closing, foreseen = [0.0] * (BEAMS // f.pool), [0.0] * (BEAMS // f.pool)
    width = f.pool * BEAM
    for b, r in enumerate(seen.ranges):
        if not 0.0 < r < (1.0 - 1e-6) * f.max_range:
            continue
        way = heading + b * BEAM - math.pi
        u = np.array([math.cos(way), math.sin(way)])
        p = np.array([x, y]) + r * u
        if newer[0] == 0.0:
            newer[1][b] = np.float32(p)
        if r > 3.5 or r <= f.hull_radius:
            continue
        moved, *step = nearest_step(older[1], *p, 1.0 * older[0])
        nearer = -float(np.dot(step, u))
        j = math.floor((b * BEAM - frame + 1e-9) / width) % len(closing)
        if abs(nearer) > 0.03 and abs(nearer) / older[0] > abs(closing[j]):
            closing[j] = nearer / older[0]
        if nearer > 0.06:
            on = min(1.2 / older[0], (r - f.hull_radius) / moved)
            fx, fy = r * u + on * np.array(step)
            away = max(math.hypot(fx, fy), 1e-6)
            half = math.asin(min((f.hull_radius + f.margin) / away, 1.0))
            middle = wrap(math.atan2(fy, fx) - heading - frame + math.pi)
            for k in range(-len(closing), 2 * len(closing)):
                if abs(k * width - middle) <= half + 0.5 * width:
                    at = k % len(closing)
                    foreseen[at] = max(foreseen[at], near(f, away - f.hull_radius))
    yield from closing
    yield from foreseen


def inputs_of(f: Any, seen: Any, speed: float, m: dict[str, Any], base: Any) -> tuple[list[float], float]:
    """Returns what the network of one robot is given, and the angle of the frame that it acts in."""
    goal = isinstance(f, GoalFeatures)
    frame = frame_of(f, seen) if goal else 0.0
    now = [*(of_goal(f, seen, speed) if goal else of_path(f, seen, speed))]
    if isinstance(f, DockFeatures):
        now += of_pose(f, seen)
    acted, before = m.setdefault("acted", []), m.setdefault("before", [])
    found = list(now)
    for k in range(f.previous):
        found += [*acted[-1 - k]] if k < len(acted) else [0.0, 0.0]
    found += of_trails(f, seen, m, frame)
    if f.crumbs:
        found += of_crumbs(f, seen, m, frame)
    if getattr(f, "moving", False):
        found += of_moving(f, seen, m, frame)
    for k in range(1, f.frames):
        found += before[-k * f.stride] if k * f.stride <= len(before) else [0.0] * len(now)
    if f.limits:
        usual = f.speed_scale / base.acceleration, f.yaw_scale / base.yaw_acceleration, base.lag / 0.1
        found += [min(each, 5.0) for each in usual]
    before.append(now)
    return found, frame


SEEN = {
    "path": PathFeatures(trails=(0.5, 3.0), previous=3, frames=3, stride=2, limits=True),
    "path, other scales": PathFeatures(
        num_preview=4, error_scale=0.05, preview_scale=0.3, turn_scale=0.3, speed_scale=0.9, yaw_scale=1.1, previous=0
    ),
    "goal": GoalFeatures(crumbs=4, moving=True, limits=True),
    "goal, other scales": GoalFeatures(
        hull_radius=0.25, max_range=4.0, range_scale=0.8, margin=0.06, distance_scale=2.0, speed_scale=0.9,
        yaw_scale=1.1, pool=3, frame="body", previous=2, trails=(2.0,), crumbs=3, crumb_gap=0.11, frames=2, stride=3,
        moving=True,
    ),
    "dock": DockFeatures(fine=0.03, fine_turn=0.08),
    "dock, from the goal": DockFeatures(frame="goal", pool=1),
}  # fmt: skip


def sights(f: Any, t: int, n: int, steps: int, rng: np.random.Generator) -> Iterator[Any]:
    """Yields what robots that drive about observe: paths that end, or a scan of discs that come and go, and corners."""
    pose = np.column_stack([rng.normal(size=(n, 2)), rng.uniform(-3.1, 3.1, n)])
    rate = rng.normal(0.0, [0.5, 0.5, 0.8], (n, 3))
    goals = pose[:, :2] + rng.normal(0.0, 2.0, (n, 2))
    discs = rng.uniform(-3.0, 3.0, (4, 2)), rng.uniform(-0.6, 0.6, (4, 2)), rng.uniform(0.2, 0.7, 4)
    angles = np.arange(BEAMS) * BEAM - math.pi
    for k in range(steps):
        pose = pose + DT * rate
        pose[:, 2] = np.remainder(pose[:, 2] + math.pi, 2.0 * math.pi) - math.pi
        twist = rng.normal(0.0, 1.5, (n, t))
        if isinstance(f, PathFeatures):
            preview = np.cumsum(rng.normal(0.0, 0.2, (n, f.num_preview, 2)), axis=1)
            preview[0, 2:] = preview[0, 2:3]  # where a path ends, all points are one
            errors = rng.normal(size=n) * rng.choice([0.01, 0.3], n), rng.uniform(-3.1, 3.1, n)
            yield path_following.Observation(pose, twist, *errors, np.zeros(n), preview)
            continue
        if k == steps // 2:
            goals = pose[:, :2] + rng.normal(0.0, 3.0, (n, 2))  # another one
        away = goals - pose[:, :2]
        goal = np.array([turned(pose[i, 2], *away[i]) for i in range(n)])
        ranges = rng.uniform(0.1, 6.0, (n, BEAMS)).clip(max=5.0) if k % 7 == 3 else np.full((n, BEAMS), 5.0)
        for place, velocity, radius in zip(*discs, strict=True):
            off = place + k * DT * velocity - pose[:, :2]
            way = angles + pose[:, 2:]
            along = off[:, :1] * np.cos(way) + off[:, 1:] * np.sin(way)
            across = off[:, 1:] * np.cos(way) - off[:, :1] * np.sin(way)
            met = (np.abs(across) < radius) & (along > radius)
            hit = along - np.sqrt(np.maximum(radius**2 - across**2, 0.0))
            ranges = np.where(met, np.minimum(ranges, hit), ranges)
        left = rng.choice([0.0, 1.0], n)
        yield goal_reaching.Observation(pose, twist, goal, rng.uniform(-3.1, 3.1, n), left, ranges)


def row(seen: Any, i: int) -> Any:
    """Returns what one robot observes."""
    return type(seen)(*(field[i] for field in seen))


@pytest.mark.parametrize("name", SEEN)
@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_a_network_sees_what_the_docstrings_say(name: str, robot: str) -> None:
    f, t, n, rng = SEEN[name], len(ROBOTS[robot].twist_axes), 5, np.random.default_rng(7)
    perceived = Perception(f, Actions(), t, DT)
    memory, mine = perceived.fresh(n), [dict[Any, Any]() for _ in range(n)]
    base = ACTUATORS["slow"]
    for seen in sights(f, t, n, 22, rng):
        speeds = rng.uniform(0.1, 1.0, n)
        inputs, angles = perceived.inputs(seen, speeds, memory, limits=limits_of(f, base))
        for i in range(n):
            wanted, frame = inputs_of(f, row(seen, i), speeds[i], mine[i], base)
            np.testing.assert_allclose(inputs[i], wanted, atol=2e-5, rtol=1e-5)
            assert angles[i] == pytest.approx(frame, abs=1e-9)
        actions = rng.uniform(-1.0, 1.0, (n, 2)).astype(np.float32)
        perceived.remember(inputs, actions, memory)
        for each, action in zip(mine, actions, strict=True):
            each["acted"].append(action)
    assert perceived.num_inputs == len(wanted)


# What the outputs mean, and what is done to them.


@pytest.mark.parametrize("kind", ["unicycle", "planar"])
def test_outputs_mean_what_the_docstring_says(kind: Any) -> None:
    actions, rng, n, robot = Actions(kind, yaw_rate=1.3, reverse=0.4), np.random.default_rng(3), 40, ROBOTS["omni4"]
    a, speeds, angles = rng.uniform(-1.0, 1.0, (n, 2)), rng.uniform(0.2, 1.0, n), rng.uniform(-3.0, 3.0, n)
    asked, reach = rng.normal(0.0, 0.6, (n, 3)), 0.3
    got, more = actions.twists(a, speeds, angles, robot), actions.added(asked, a, reach, speeds, angles, robot)
    back = actions.of_twists(asked, speeds, angles)
    for i in range(n):
        along, aside = turned(-angles[i], *a[i])
        if kind == "unicycle":
            wanted = np.array([speeds[i] * (1.4 * (a[i, 0] + 1.0) / 2.0 - 0.4), 0.0, 1.3 * a[i, 1]])
            added = np.array([0.7 * speeds[i] * reach * a[i, 0], 0.0, 1.3 * reach * a[i, 1]])
            nearest = (2.0 * (asked[i, 0] / speeds[i] + 0.4) / 1.4 - 1.0, asked[i, 2] / 1.3)
        else:
            wanted = speeds[i] * np.array([along, aside, 0.0]) / max(math.hypot(*a[i]), 1.0)
            added = speeds[i] * reach * np.array([along, aside, 0.0])
            nearest = turned(angles[i], *(asked[i, :2] / speeds[i]))
        np.testing.assert_allclose(got[i], wanted, atol=1e-9)
        total = asked[i] + added
        most = max(speeds[i], math.hypot(*asked[i, :2]))
        total[:2] *= min(1.0, most / math.hypot(*total[:2]))
        np.testing.assert_allclose(more[i], total, atol=1e-9)
        np.testing.assert_allclose(back[i], np.clip(nearest, -1.0, 1.0), atol=1e-6)


def free_speed(room: float, braking: float, reaction: float) -> float:
    return braking * (math.sqrt(reaction**2 + 2.0 * room / braking) - reaction)


def guarded(f: GoalFeatures, ranges: Any, rate: float, twist: Any, speed: float, base: Any) -> list[float]:
    braking, reaction = min(f.braking, 0.7 * base.acceleration), max(f.reaction, base.lag + 0.1)
    vx, vy, w = twist[0], twist[1] if len(twist) == 3 else 0.0, twist[-1]
    planar = len(twist) == 3
    turning = max(w, rate, key=abs)
    late = reaction - f.reaction + speed / braking - speed / f.braking
    turn = 0.0 if planar else clip(late * turning, 0.5 * math.pi)
    way = np.arange(BEAMS) * BEAM - math.pi
    for attempt in range(3):
        share = 1.0
        for angle, r in zip(way, ranges, strict=True):
            towards = vx * math.cos(angle) + vy * math.sin(angle)
            if turn and vx > 0.0:
                swept = angle * turn > 0.0 and abs(angle) < abs(turn)
                towards = vx if swept else max(towards, vx * math.cos(angle - turn))
            most = free_speed(max(r - f.hull_radius - f.gap, 0.0), braking, reaction)
            if towards <= max(most, 0.0):
                continue
            if planar and attempt < 2:  # what is too fast is taken away, beam by beam, twice around; then all is slower
                vx, vy = vx - (towards - most) * math.cos(angle), vy - (towards - most) * math.sin(angle)
            else:
                share = min(share, most / towards)
        vx, vy = share * vx, share * vy
    return [vx, vy, w] if planar else [vx, w]


def arrives(f: GoalFeatures, seen: Any, twist: Any, speed: float, base: Any) -> Any:
    r = math.hypot(*seen.goal)
    if not f.arrival or seen.waypoints_left > 0.5 or r > f.arrival:
        return twist

    def rate(turn: float) -> float:
        alpha = 0.5 * min(base.yaw_acceleration, 3.0)
        return math.copysign(min(2.0 * abs(turn), math.sqrt(2.0 * alpha * abs(turn)), 1.5), turn)

    v = min(min(speed, 0.3), 1.5 * r)
    if len(twist) == 3:
        return [*(v / r * seen.goal), rate(seen.goal_heading_error)]
    if r <= 0.015 or (r <= 0.03 and seen.goal[0] <= 0.0):
        return [0.0, rate(seen.goal_heading_error)]
    aside = math.atan2(seen.goal[1], seen.goal[0])
    return [v if abs(aside) < 0.3 else 0.0, rate(aside)]


@pytest.mark.parametrize("tier", ["lagged", "slow"])
@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
@pytest.mark.parametrize("f", [GoalFeatures(arrival=0.55), DockFeatures()], ids=["goal", "dock"])
def test_the_end_of_a_way_and_the_guard_are_what_the_docstrings_say(f: Any, robot: str, tier: str) -> None:
    rng, n, t, base = np.random.default_rng(11), 60, len(ROBOTS[robot].twist_axes), ACTUATORS[tier]
    goals = rng.uniform(-1.0, 1.0, (n, 2)) * rng.choice([0.013, 0.02, 0.3, 2.0], (n, 1))
    ranges = rng.uniform(0.2, 4.0, (n, BEAMS)) + rng.uniform(0.0, 2.0, (n, 1))
    left, measured = rng.choice([0.0, 0.0, 1.0], n), rng.normal(0.0, 0.6, (n, t))
    turns = rng.uniform(-3.1, 3.1, n) * rng.choice([0.004, 1.0], n)
    seen = goal_reaching.Observation(np.zeros((n, 3)), measured, goals, turns, left, ranges)
    twists = rng.normal(0.0, 0.6, (n, t))
    # and some of them at a crawl, beside a thing or two
    ranges[::3], twists[::3, : t - 1] = 4.0, 0.1 * twists[::3, : t - 1]
    for i in range(0, n, 3):
        ranges[i, rng.integers(0, BEAMS, 6)] = f.hull_radius + f.gap + rng.uniform(-0.01, 0.03)
    got = f.guarded(seen, f.arrived(seen, twists.copy(), 0.5, base), 0.5, base)
    slowed = 0
    for i in range(n):
        mine = arrives(f, row(seen, i), twists[i], 0.5, base)
        wanted = guarded(f, ranges[i], measured[i, -1], mine, 0.5, base)
        slowed += wanted[0] != mine[0]
        still = left[i] == 0.0 and math.hypot(*goals[i]) < 0.02 and abs(turns[i]) < 0.02
        if isinstance(f, DockFeatures) and still:
            wanted = [0.0] * t
        np.testing.assert_allclose(got[i], wanted, atol=1e-9)
    assert 0 < slowed < n


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_a_slower_base_is_driven_by_its_limits_and_its_lag(robot: str) -> None:
    rng, n, wheels = np.random.default_rng(5), 12, np.ascontiguousarray(ROBOTS[robot].wheel_matrix)
    t, most, fastest = len(ROBOTS[robot].twist_axes), 6.0, 1.1
    axes = np.array(ROBOTS[robot].twist_axes)
    law = (0.7, 1.9, DT, 0.6, 0.75, most, fastest)
    held, command, twist = np.zeros((n, 2, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    for _ in range(6):
        asked = rng.normal(0.0, 0.8, (n, t))
        got = asked.copy()
        perception.hold(law, wheels, held, got)
        for i in range(n):
            whole = np.zeros(3)
            whole[axes] = asked[i]
            whole *= min(1.0, most / np.abs(wheels @ whole).max(), fastest / abs(whole[2]))
            change = whole - command[i]
            far = math.hypot(*change[:2])
            change[:2] *= min(1.0, 0.7 * DT / far)
            change[2] = clip(change[2], 1.9 * DT)
            command[i] += change
            mean = command[i] + 0.75 * (twist[i] - command[i])
            twist[i] = command[i] + 0.6 * (twist[i] - command[i])
            np.testing.assert_allclose(got[i], mean[axes], atol=1e-9)
            np.testing.assert_allclose(held[i], [command[i], twist[i]], atol=1e-9)
