"""Reference implementation of ORCA: its half-planes, the nearest velocity that keeps them, its twist."""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from oracles.grid_measures import clearances, rays

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.scenarios.obstacles import box, circle, obstacle_field
from wayfield.envs.tasks.briefing import Briefing, Goals, Surroundings
from wayfield.envs.world.grids import NO_GRIDS, OccupancyGrid, lay_grids
from wayfield.envs.world.movers import motion_at
from wayfield.policies.teams.orca import Orca, disc_half_plane, tracking_drift

DT = 0.05


def to_surface(obstacle: Any, x: float, y: float) -> tuple[float, float, float]:
    """Returns the distance of a point from a disc or a box, and the direction away from it."""
    c, s = obstacle["cos"], obstacle["sin"]
    dx, dy = x - obstacle["x"], y - obstacle["y"]
    u, v = c * dx + s * dy, c * dy - s * dx
    u -= min(max(u, -obstacle["half_length"]), obstacle["half_length"])
    v -= min(max(v, -obstacle["half_width"]), obstacle["half_width"])
    d = math.hypot(u, v)
    return d - obstacle["radius"], (c * u - s * v) / d, (s * u + c * v) / d


def apart(obstacle: Any, x: float, y: float) -> float:
    """Returns how far a point lies from the middle line of a wall or a disc, and outside a box."""
    c, s = obstacle["cos"], obstacle["sin"]
    dx, dy = x - obstacle["x"], y - obstacle["y"]
    u, v = abs(c * dx + s * dy) - obstacle["half_length"], abs(c * dy - s * dx) - obstacle["half_width"]
    return math.hypot(max(u, 0.0), max(v, 0.0))


def half_planes(p: Orca, margin: float, world: Any, pose: Any, v: Any, time: float) -> Iterator[tuple[Any, float, Any]]:
    """Yields (n, b) of what a robot keeps, what stands first, and (direction, speed) that it leaves ahead; or None."""
    obstacles, grid = world
    radius = margin + p.tracking_error
    x, y, _ = pose
    for moving in (False, True):
        for obstacle in obstacles:
            if (obstacle["patrol"]["leg_time"] > 0.0) != moving:
                continue
            here, velocity = obstacle.copy(), np.zeros(2)
            if moving:
                here["x"], here["y"], *velocity = motion_at(obstacle, time)
            d, nx, ny = to_surface(here, x, y)
            if d > p.sensing_radius:
                continue
            n, b = np.array([nx, ny]), (radius - d) / (p.wall_horizon if d > radius else p.recovery)
            if here["half_length"] == here["half_width"] == 0.0:
                *n, b = disc_half_plane(
                    here["x"] - x, here["y"] - y, here["radius"] + radius, *(v - velocity), p.horizon, p.recovery
                )
            n = np.array(n)
            if moving:
                yield n, b + n @ velocity, None
            else:
                yield n, min(b, 0.0), (-np.array([nx, ny]), max(d - margin, 0.0) / p.wall_horizon)
        if not moving and grid is not None:
            yield from of_grid(p, radius, margin, grid, x, y, v)


def of_grid(p: Orca, radius: float, margin: float, grid: Any, x: float, y: float, v: Any) -> Iterator[Any]:
    """Yields those of the nearest occupied place, as a wall, and of what is seen in 24 directions, as points."""
    at = np.array([[x, y]])
    (d,) = clearances(grid, at)
    if d > p.sensing_radius:
        return
    steps = 1e-5 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    e, w, n, s = clearances(grid, at + steps)
    away = np.array([e - w, n - s]) / math.hypot(e - w, n - s)
    b = (radius - d) / (p.wall_horizon if d > radius else p.recovery)
    yield away, min(b, 0.0), (-away, max(d - margin, 0.0) / p.wall_horizon)
    for k in range(24):
        angle = 2.0 * math.pi * k / 24
        (r,) = rays(grid, at, np.array([angle]), p.sensing_radius)
        if r >= p.sensing_radius - 1e-9:
            continue
        u = np.array([math.cos(angle), math.sin(angle)])
        *n, b = disc_half_plane(*(r * u), radius, *v, p.horizon, p.recovery)
        yield np.array(n), min(b, 0.0), (u, max(r - margin, 0.0) / p.wall_horizon)


def nearest(planes: Any, wanted: Any, most: float) -> Any:
    """Returns the velocity nearest to the wanted one that keeps all planes, of all corners; None if there is none."""
    size = math.hypot(*wanted)
    corners = [wanted * min(1.0, most / max(size, 1e-300))]
    for (n, b), k in zip(planes, range(len(planes)), strict=True):
        along = np.array([-n[1], n[0]])
        half = math.sqrt(max(most**2 - b**2, 0.0))
        corners += [b * n + t * along for t in (along @ wanted, half, -half)]
        for m, c in planes[:k]:
            cross = n[0] * m[1] - n[1] * m[0]
            if abs(cross) > 1e-9:
                corners.append(np.array([b * m[1] - c * n[1], n[0] * c - m[0] * b]) / cross)
    held = [v for v in corners if math.hypot(*v) <= most + 1e-9 and all(n @ v >= b - 1e-9 for n, b in planes)]
    return min(held, key=lambda v: math.dist(v, wanted)) if held else None


OBSTACLES = obstacle_field(
    circle(1.2, 0.3, 0.25), box(0.2, 1.6, 1.1, 0.4, 0.5), circle(-0.7, -1.1, 0.2), circle(0.4, -1.3, 0.3),
    box(-1.6, 0.7, 0.5, 0.9, -0.3), circle(12.0, 0.0, 0.5),
)  # fmt: skip
POLICIES = [
    Orca(roadmap=False),
    Orca(
        roadmap=False, horizon=1.3, wall_horizon=0.8, recovery=0.9, sensing_radius=1.4, margin=0.08, max_speed=0.8,
        k=0.5, perturbation=0.25, tracking_error=0.09, turn_gain=2.0, max_yaw_rate=0.3, arrival_radius=0.2, seed=3,
    ),
]  # fmt: skip


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
@pytest.mark.parametrize("policy", POLICIES, ids=["default", "other"])
@pytest.mark.parametrize("mapped", [False, True], ids=["discs and boxes", "and a map"])
def test_avoidance_is_its_docstring(policy: Orca, robot: str, mapped: bool) -> None:
    n, rng, base = 60, np.random.default_rng(29), ROBOTS[robot]
    obstacles = OBSTACLES.copy()
    for j, (vx, vy) in ((2, (0.3, 0.2)), (3, (-0.2, 0.4))):
        centre = OBSTACLES[j]["x"].item(), OBSTACLES[j]["y"].item()
        obstacles[j]["patrol"] = (*centre, vx, vy, 3.0, 0.7 * j)
    grid = None
    grids = NO_GRIDS
    if mapped:
        grid = OccupancyGrid(rng.random((14, 14)) < 0.12, 0.37, (-2.7, -2.3, 0.2), "free")
        grids = lay_grids([grid], np.zeros(1, NO_GRIDS.frames.dtype))
    briefing = Briefing(
        n, base, ACTUATORS["lagged"], DT, "twist", Observation.layout(len(base.twist_axes), 0, 5.0), np.empty(0), 5.0,
        map=Surroundings.of(np.tile(obstacles, (n, 1)), np.full(n, len(OBSTACLES)), grids),
        goal=Goals(np.zeros((n, 1, 3)), np.ones(n, np.int64)),
    )  # fmt: skip
    poses = np.column_stack([rng.uniform(-2.0, 2.0, (20 * n, 2)), rng.uniform(-3.1, 3.1, 20 * n)])
    clear = [min(apart(each, *pose[:2]) for each in OBSTACLES) > 0.02 for pose in poses]
    poses = poses[np.array(clear) & (grid is None or clearances(grid, poses[:, :2]) > 0.02)][:n]
    twists = rng.normal(0.0, 0.2, (n, len(base.twist_axes)))
    goals = rng.uniform(-1.0, 1.0, (n, 2)) * rng.choice([0.03, 0.15, 0.7, 4.0], (n, 1))
    turns, left = rng.uniform(-3.1, 3.1, n), rng.choice([0.0, 0.0, 1.0], n)
    memory = policy.reset(briefing)
    memory["steps"] = steps = rng.integers(0, 200, n)
    observation = Observation(poses, twists, goals, turns, left, np.empty((n, 0)))
    got = policy.act(observation, briefing, memory)
    np.testing.assert_array_equal(memory["steps"], steps + 1)
    side = 1.0 if np.random.default_rng(policy.seed).random() < 0.5 else -1.0
    error = 0.0 if base.holonomic else policy.tracking_error
    told = Orca(**{**vars(policy), "tracking_error": error})
    margin = base.hull_radius + policy.margin
    compared = held = arrivals = 0
    for i in range(n):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        inwards = np.array([[c, -s], [s, c]])
        v = inwards @ [twists[i, 0], twists[i, 1] if base.holonomic else 0.0]
        found = list(half_planes(told, margin, (obstacles, grid), poses[i], v, steps[i] * DT))
        r = math.hypot(*goals[i])
        aside = side * policy.perturbation * min(r, 1.0)
        way = math.atan2(goals[i, 1], goals[i, 0]) + poses[i, 2] + aside
        wanted = min(policy.k * r, policy.max_speed) * np.array([math.cos(way), math.sin(way)])
        planes = [(normal, bound) for normal, bound, _ in found]
        velocity = nearest(planes, wanted, policy.max_speed)
        if velocity is None:
            continue  # what gives least is held against a linear program elsewhere
        compared += 1
        held += math.dist(velocity, wanted) > 1e-6
        u = inwards.T @ velocity
        arrived = r <= policy.arrival_radius and left[i] == 0.0
        arrived = arrived and math.hypot(*u) <= policy.k * policy.arrival_radius
        most = policy.max_yaw_rate / policy.turn_gain
        if base.holonomic:
            twist = [*u, policy.turn_gain * min(max(turns[i], -most), most)]
        else:
            angle = math.atan2(u[1], u[0]) if math.hypot(*u) > 1e-9 else 0.0
            drift = math.hypot(*u) * tracking_drift(abs(angle)) / policy.turn_gain
            u = u * min(1.0, policy.tracking_error / max(drift, 1e-12))
            ahead = np.array([c, s])
            stands = [there for _, _, there in found if there is not None]
            free = [speed / (ahead @ way) for way, speed in stands if ahead @ way > 0.0]
            twist = [min(max(u[0], 0.0), policy.max_speed, *free), policy.turn_gain * angle]
            if arrived:
                twist = [0.0, policy.turn_gain * turns[i]]
                arrivals += 1
        np.testing.assert_allclose(got[i], twist, atol=1e-5 if mapped else 1e-7)
    assert compared > 0.6 * n
    assert held > 0.2 * n
    assert arrivals or base.holonomic
    assert list(itertools.islice(half_planes(told, margin, (obstacles, grid), poses[0], v, 0.0), 1))


@pytest.mark.parametrize("gap", [0.002, 0.01, 0.03])
def test_a_thin_post_of_a_map_is_not_run_into_while_the_robot_turns_away_from_it(gap: float) -> None:
    """Between two of the directions that are looked in: that it is the nearest place has to do."""
    base, policy = ROBOTS["p3dx"], Orca(roadmap=False, perturbation=0.0)
    margin, bearing, side = base.hull_radius + policy.margin, math.radians(52.5), 0.02
    centre = (margin + gap + 0.5 * side) * np.array([math.cos(bearing), math.sin(bearing)])
    grid = OccupancyGrid(np.eye(1, dtype=bool), side, (*(centre - 0.5 * side).tolist(), 0.02), "free")
    briefing = Briefing(
        1, base, ACTUATORS["lagged"], DT, "twist", Observation.layout(2, 0, 5.0), np.empty(0), 5.0,
        map=Surroundings.of(
            OBSTACLES[None].copy(), np.zeros(1, np.int64), lay_grids([grid], np.zeros(1, NO_GRIDS.frames.dtype))
        ),
        goal=Goals(np.zeros((1, 1, 3)), np.ones(1, np.int64)),
    )  # fmt: skip
    goal = 3.0 * np.array([[math.cos(-0.8), math.sin(-0.8)]])
    seen = Observation(np.zeros((1, 3)), np.zeros((1, 2)), goal, np.zeros(1), np.zeros(1), np.empty((1, 0)))
    twist = policy.act(seen, briefing, policy.reset(briefing))[0]
    ((_, _, (way, speed)),) = of_grid(policy, margin + policy.tracking_error, margin, grid, 0.0, 0.0, np.zeros(2))
    assert twist[0] == pytest.approx(speed / way[0], rel=1e-4)
    assert speed < 0.1
    assert twist[1] == pytest.approx(policy.turn_gain * -0.8)
