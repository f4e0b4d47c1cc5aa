"""Reference implementations of what planners make of their world and of what moves in it."""

import cmath
import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from oracles.grid_measures import clearances

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.scenarios.obstacles import box, circle, obstacle_field
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.grids import NO_GRIDS, OccupancyGrid, frames_of, lay_grids
from wayfield.envs.world.patrols import PATROL, patrol_at
from wayfield.policies import astar_tracker, scan_planner
from wayfield.policies.astar_tracker import AstarTracker
from wayfield.policies.nav2_dwb import Nav2Dwb
from wayfield.policies.nav2_mppi import Nav2Mppi
from wayfield.policies.parts.steering import Map
from wayfield.policies.parts.stopping import Scan, Seen
from wayfield.policies.scan_planner import ScanPlanner
from wayfield.system.compiled import compiled

FARTHEST, UNIT = 1.275, 0.005  # m
OBSTACLES = obstacle_field(
    circle(1.9, 0.6, 0.25), box(0.2, 2.1, 1.1, 0.4, 0.5), circle(-1.7, -1.1, 0.2), circle(0.9, -1.6, 0.3),
    box(15.0, 0.7, 0.5, 9.0, 0.2),
)  # fmt: skip
MOVING = 3
GOALS = np.array([[2.2, -0.9, 0.0], [3.4, 1.7, 0.5]])

speed_among = compiled(lambda p, m, told, s, time: astar_tracker.speed_among(p[0], m[0], told, 0, s, time))


def to_surface(obstacle: Any, x: Any, y: Any) -> Any:
    """Returns the distance of points from a disc or a box, less than 0 in a disc, 0 in a box."""
    c, s = obstacle["cos"], obstacle["sin"]
    dx, dy = x - obstacle["x"], y - obstacle["y"]
    u, v = np.abs(c * dx + s * dy) - obstacle["half_length"], np.abs(c * dy - s * dx) - obstacle["half_width"]
    return np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0)) - obstacle["radius"]


def told(robot: str, grid: OccupancyGrid | None = None) -> Briefing:
    """Returns the briefing of one robot among the obstacles, one of which is on patrol."""
    patrols = np.zeros((1, len(OBSTACLES)), PATROL)
    patrols[0, MOVING] = (*(OBSTACLES[MOVING][name].item() for name in ("x", "y")), 0.4, 0.7, 4.0, 0.9)
    more: dict[str, Any] = {}
    if grid is not None:
        more["grids"] = frames_of(lay_grids([grid], np.zeros(1, NO_GRIDS.frames.dtype)), np.zeros(1, np.int64))
    base = ROBOTS[robot]
    return Briefing(
        1, base, ACTUATORS["lagged"], 0.05, "twist", Observation.layout(len(base.twist_axes), 0, 5.0), np.empty(0), 5.0,
        obstacles=OBSTACLES[None].copy(), num_obstacles=np.array([len(OBSTACLES)]), goals=GOALS[None],
        num_goals=np.array([2]), patrols=patrols, **more,
    )  # fmt: skip


def planned(policy: AstarTracker, briefing: Briefing, x: float, y: float) -> Any:
    """Returns what a robot remembers after its first decision."""
    memory = policy.reset(briefing)
    t = len(briefing.robot.twist_axes)
    goal = GOALS[:1, :2] - (x, y)
    policy.act(
        Observation(np.array([[x, y, 0.0]]), np.zeros((1, t)), goal, np.zeros(1), np.ones(1), np.empty((1, 0))),
        briefing, memory,
    )  # fmt: skip
    return memory


@pytest.mark.parametrize("mapped", [False, True], ids=["in the open", "in a map"])
@pytest.mark.parametrize("cell", [0.05, 0.12])
def test_the_grid_holds_the_clearance_from_all_that_stands(cell: float, mapped: bool) -> None:
    grid = None
    if mapped:
        blocked = np.random.default_rng(31).random((18, 20)) < 0.1
        blocked[5:12, 3:12] = False
        grid = OccupancyGrid(blocked, 0.43, (-3.6, -4.1, 0.15), "free")
    policy = AstarTracker(cell=cell, surroundings=3.0)
    memory = planned(policy, told("p3dx", grid), 0.1, 3.4)[0]
    side, width = len(memory["grid"]), float(memory["cell"])
    if grid is None:
        # around start, goals and what stands, cut off 3 m beyond the former; a metre more; in the middle of the grid
        places = np.vstack([GOALS[:, :2], (0.1, 3.4)])
        low, high = places.min(axis=0), places.max(axis=0)
        bounds = low - 3.0, high + 3.0
        for k, each in enumerate(OBSTACLES):
            if k != MOVING:
                turn = np.abs([[each["cos"], each["sin"]], [each["sin"], each["cos"]]])
                half = turn @ [each["half_length"], each["half_width"]] + each["radius"]
                centre = np.array([each["x"], each["y"]])
                low = np.minimum(low, np.maximum(centre - half, bounds[0]))
                high = np.maximum(high, np.minimum(centre + half, bounds[1]))
        extent = max(high - low) + 2.0
        assert width == pytest.approx(max(cell, extent / (side - 1)))
        middle = memory["origin"] + 0.5 * width * side
        assert middle == pytest.approx(0.5 * (low + high), abs=1e-9)
    # at some of the cells of the grid, and at most of those around the robot
    rng = np.random.default_rng(41)
    at = np.vstack([rng.integers(0, side, (3000, 2)), side // 2 + rng.integers(-60, 60, (3000, 2))])
    x, y = (memory["origin"][:, None] + (at.T + 0.5) * width).tolist()
    d = np.minimum.reduce(
        [to_surface(each, np.array(x), np.array(y)) for k, each in enumerate(OBSTACLES) if k != MOVING]
    )
    if grid is not None:
        d = np.minimum(d, clearances(grid, np.column_stack([x, y])))
    level = np.clip(np.ceil((FARTHEST - d) / UNIT - 1e-6), 0, 255)
    if width > 0.1:
        level[d < 0.7072 * width] = 255  # a wall could stand between neighbours
    off = np.abs(memory["grid"][at[:, 1], at[:, 0]].astype(float) - level)
    assert (off > 0).mean() < 2e-3  # a last digit may round a level up
    assert off.max() <= 1 or width > 0.1
    assert 4 < (level == 255).sum() < 3000


@pytest.mark.parametrize("heading", [0.4, 1.9])
def test_a_wall_that_leaves_the_grid_is_in_it_up_to_its_edges_and_not_beyond(heading: float) -> None:
    wall = obstacle_field(box(0.5, 0.3, 30.0, 0.1, heading))
    briefing = dataclasses.replace(
        told("p3dx"), obstacles=wall[None].copy(), num_obstacles=np.ones(1, np.int64), patrols=None
    )
    memory = planned(AstarTracker(surroundings=3.0), briefing, 0.1, 3.4)[0]
    side = len(memory["grid"])
    row, column = (each.ravel() for each in np.indices((side, side)))
    edge = np.minimum.reduce([row, column, side - 1 - row, side - 1 - column]) == 0
    x, y = (
        origin + (k[edge] + 0.5) * float(memory["cell"])
        for origin, k in zip(memory["origin"], (column, row), strict=True)
    )
    level = np.clip(np.ceil((FARTHEST - to_surface(wall[0], x, y)) / UNIT - 1e-6), 0, 255)
    off = np.abs(memory["grid"][row[edge], column[edge]].astype(float) - level)
    assert off.max() <= 1  # a last digit may round a level up
    assert (off > 0).mean() < 0.01
    assert level.max() == 255


@pytest.mark.parametrize("far", [0, 1])
def test_a_batch_has_grids_for_the_largest_of_its_worlds(far: int) -> None:
    """Up to 80 m, with a metre around, 256 cells a side hold it; then as few as are no wider than 0.1 m; 2,048 more."""
    sides = []
    for away in (10.0, 77.0, 80.0, 99.0, 102.0, 190.0, 400.0):
        goals = np.zeros((2, 2, 3))
        goals[:, 1, 0], goals[far, 1, 1] = 5.0, -away
        briefing = dataclasses.replace(
            told("p3dx"), num_envs=2, obstacles=np.tile(OBSTACLES, (2, 1)), num_obstacles=np.zeros(2, np.int64),
            patrols=np.zeros((2, len(OBSTACLES)), PATROL), goals=goals, num_goals=np.full(2, 2),
        )  # fmt: skip
        sides.append(astar_tracker.memory_of(briefing, [])["grid"].shape[0])
    assert sides == [256, 256, 1024, 1024, 2048, 2048, 2048]


def along(points: Any, s: float) -> Any:
    """Returns the place at arc length s of a polyline, within its ends."""
    arc = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    return [np.interp(s, arc, points[:, axis]) for axis in range(2)]


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_the_speed_among_patrols_is_the_greatest_that_keeps_clear_of_them_or_the_clearest(robot: str) -> None:
    policy, briefing = AstarTracker(patrol_clearance=0.2, patrol_horizon=2.3), told(robot)
    memory, radius = planned(policy, briefing, 0.1, -0.2), ROBOTS[robot].hull_radius
    rng, seen = np.random.default_rng(37), set()
    p = policy.params(briefing, theta=True, snap=0.0, spacing=1.0, rounds=1, patience_steps=1)
    patrol = briefing.patrols[0, MOVING]  # type: ignore[index]
    for _ in range(150):
        points = np.array([1.2, -0.8]) + np.cumsum(rng.normal(0.0, 0.5, (5, 2)), axis=0)
        memory["points"][0, :5], memory["num_points"] = points, 5
        memory["arc"][0, :5] = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
        memory["segment"] = 0
        s, time = rng.uniform(0.0, memory["arc"][0, 4]), rng.uniform(0.0, 20.0)
        wanted, clearest, best = None, -math.inf, 0.0
        for share in (1.0, 0.5, 0.0, -0.5):
            speed, gaps = share * policy.max_speed, []
            for k in range(23):
                x, y = along(points, max(s + speed * 0.1 * k, 0.0))
                mx, my, _, _ = patrol_at(patrol, time + 0.1 * k)
                gaps.append(math.hypot(x - mx, y - my) - float(OBSTACLES[MOVING]["radius"]) - radius)
            if min(gaps) >= policy.patrol_clearance:
                wanted = math.inf if share == 1.0 else speed
                break
            if min(gaps) > clearest:
                clearest, best = min(gaps), speed
        wanted = best if wanted is None else wanted
        assert speed_among(p, memory, Map.of(briefing), s, time) == pytest.approx(wanted)
        seen.add((wanted, clearest > -math.inf))
    assert len(seen) == 5


def test_at_its_goal_the_tracker_turns_to_the_goal_s_heading_whichever_way_it_looks() -> None:
    for robot in ("p3dx", "omni3"):
        briefing, policy, t = told(robot), AstarTracker(), len(ROBOTS[robot].twist_axes)
        for turn in (-2.5, -0.4, 0.7, 2.9):
            memory, (x, y, _) = policy.reset(briefing), GOALS[1]
            seen = Observation(
                np.array([[x, y, 0.5 - turn]]), np.zeros((1, t)), np.zeros((1, 2)), np.array([turn]), np.zeros(1),
                np.empty((1, 0)),
            )  # fmt: skip
            for _ in range(3):
                twist = policy.act(seen, briefing, memory)[0]
            assert twist[-1] * turn > 0.0
            assert np.hypot(*np.append(twist[:-1], 0.0)[:2]) == pytest.approx(0.0, abs=1e-9)
            assert memory["arrived"][0] == 1


# Planners on what the beams see.

BEAMS = np.linspace(-math.pi, math.pi, 72, endpoint=False)
evade = compiled(lambda p, m, scan, seen, approached: scan_planner.evade(p[0], m[0], scan, seen, 0, approached))


def sighted(robot: str) -> Briefing:
    base = ROBOTS[robot]
    layout = Observation.layout(len(base.twist_axes), len(BEAMS), 5.0)
    return Briefing(1, base, ACTUATORS["lagged"], 0.05, "twist", layout, BEAMS, 5.0)


def observed(robot: str, pose: Any, goal: Any, ranges: Any) -> Observation:
    t = len(ROBOTS[robot].twist_axes)
    return Observation(
        np.array([pose]), np.zeros((1, t)), np.array([goal]), np.zeros(1), np.zeros(1), np.array([ranges])
    )


@pytest.mark.parametrize("policy", [ScanPlanner(), Nav2Dwb(), Nav2Mppi()], ids=lambda policy: type(policy).__name__)
@pytest.mark.parametrize("goal", [(30.0, 4.0), (-5.0, 40.0), (-30.0, -20.0), (1.0, 0.5)])
def test_what_is_out_of_the_map_is_headed_for_through_its_nearest_cell_within(policy: Any, goal: Any) -> None:
    briefing, pose = sighted("p3dx"), (0.3, -0.2, 0.7)
    memory = policy.reset(briefing)
    seen = complex(*goal) * cmath.rect(1.0, -pose[2])  # by the robot
    policy.act(observed("p3dx", pose, (seen.real, seen.imag), np.full(72, 5.0)), briefing, memory)
    state = memory["state"][0]
    low = state["origin"] + 3.0 * policy.cell
    high = state["origin"] + (160 - 3.0) * policy.cell
    assert state["target"] == pytest.approx(np.clip(np.array(pose[:2]) + goal, low, high))
    assert state["plans"] == 1


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
@pytest.mark.parametrize("beam", [36, 40, 3, 71, 20])
def test_the_scan_planner_backs_straight_away_from_what_comes(robot: str, beam: int) -> None:
    """Where the way back is free: as fast as it could stop within 0.6 m; a differential drive along its own axis."""
    policy, briefing = ScanPlanner(), sighted(robot)
    made = policy.params(
        briefing, theta=False, snap=0.0, spacing=1.0, rounds=1, recall=1.0, period_steps=1, pause_steps=1,
        all_round=True,
    )  # fmt: skip
    p = made.copy()
    p["acceleration"], p["yaw_acceleration"], p["delay"] = 1e3, 1e3, 0.2  # what is asked for is there at once
    memory = policy.reset(briefing)
    state = memory["state"]
    state["cell"], state["origin"] = policy.cell, -80.0 * policy.cell
    state["steps"], state["closing"] = 5, 0.3
    radius = briefing.robot.hull_radius
    ranges = np.full(72, 5.0)
    ranges[beam] = radius + 0.25
    state["nearest"] = radius + 0.25 + 0.3 * 0.05  # it goes on coming as fast
    seen = observed(robot, (0.0, 0.0, 0.4), (3.0, 0.0), ranges)
    scan = Scan.of(policy, seen, briefing, memory)
    assert evade(p, state, scan, Seen.of(seen, briefing), True)
    assert not evade(p, state, scan, Seen.of(seen, briefing), False)
    u = np.array([math.cos(BEAMS[beam]), math.sin(BEAMS[beam])])
    dead = 1e3 * 0.2
    speed = min(math.sqrt(dead**2 + 2.0 * 1e3 * 0.6) - dead, policy.max_speed)
    wanted = -speed * u if briefing.robot.holonomic else [-math.copysign(speed, u[0]), 0.0]
    assert state["command"][0].tolist() == pytest.approx([*wanted, 0.0], abs=1e-9)
    # a jump is another surface, of which nothing is known yet
    state["closing"], state["nearest"] = 0.0, radius + 1.0
    assert not evade(p, state, scan, Seen.of(seen, briefing), True)
    assert state["closing"][0] == 0.0


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_who_evades_goes_where_most_way_back_is_free(robot: str) -> None:
    """Straight back, or aside of it: at the speed that stops within what is free there, by the part that leads away."""
    policy, briefing, rng = ScanPlanner(), sighted(robot), np.random.default_rng(38)
    p, memory = planner_params(policy, briefing).copy(), policy.reset(briefing)
    p["acceleration"], p["yaw_acceleration"], p["delay"] = 1e4, 1e4, 3.0  # at once, and no matter how it brakes
    radius, found = briefing.robot.hull_radius, set()
    for _ in range(60):
        state, points = on_its_way(rng, 0.0)
        state["steps"], state["closing"], state["nearest"] = 5, 0.3, radius + 0.25 + 0.3 * 0.05
        heading, beam = float(rng.uniform(-math.pi, math.pi)), int(rng.integers(72))
        back = heading + BEAMS[beam] + math.pi
        at = points[rng.integers(50)]
        spot = at + float(rng.uniform(0.2, 0.9)) * np.array([math.cos(back), math.sin(back)]) + rng.normal(0.0, 0.1, 2)
        ys, xs = np.mgrid[:160, :160] * policy.cell + 0.5 * policy.cell - np.array([7.0, 6.0])[:, None, None]
        state["grid"] = np.ceil((FARTHEST - np.clip(np.hypot(xs - spot[0], ys - spot[1]), 0.0, FARTHEST)) / UNIT)
        ranges = np.full(72, 5.0)
        ranges[beam] = radius + 0.25
        seen = observed(robot, (*at, heading), (3.0, 0.0), ranges)
        assert evade(p, state, Scan.of(policy, seen, briefing, memory), Seen.of(seen, briefing), True)
        needed = min(radius + policy.skin, clear_at(state, at) - 1e-4)
        best, wanted, chosen = 0.0, 0.0j, math.nan
        for turn in (0.0, 0.5, -0.5, 1.0, -1.0) if robot == "omni3" else (0.0,):
            way = cmath.rect(1.0, BEAMS[beam] + math.pi + turn)
            if robot == "p3dx":
                way = complex(math.copysign(1.0, way.real))
            course = way * cmath.rect(1.0, heading)
            places = [at + 0.04 * k * np.array([course.real, course.imag]) for k in range(1, 16)]  # 0.6 m
            free = next((0.04 * k for k, each in enumerate(places) if clear_at(state, each) < needed), 0.6)
            dead = 1e4 * 3.0
            speed = min(math.sqrt(dead**2 + 2.0 * 1e4 * free) - dead, policy.max_speed)
            if speed * math.cos(turn) > best + 1e-9:
                best, wanted, chosen = speed * math.cos(turn), speed * way, turn
        assert state["command"][0].tolist() == pytest.approx([wanted.real, wanted.imag, 0.0], abs=1e-9)
        found.add((chosen, 0.0 < best < 0.1))
    assert {slow for _, slow in found} == {True, False}
    assert {0.5, -0.5, 1.0, -1.0} < {turn for turn, _ in found} or robot == "p3dx"


def test_what_comes_is_noticed_by_how_the_nearest_distance_falls() -> None:
    """Smoothed, without the robot's own part of it; a jump is another surface."""
    policy, briefing, rng = ScanPlanner(), sighted("omni3"), np.random.default_rng(3)
    p = planner_params(policy, briefing)
    memory = policy.reset(briefing)
    state = memory["state"]
    state["cell"], state["origin"] = policy.cell, -80.0 * policy.cell
    radius, closing, before, told = briefing.robot.hull_radius, 0.0, 0.0, set()
    surface = 1.6
    for step in range(160):
        approach = float(rng.choice([0.9, 1.4, 1.58])) if step % 40 > 16 else -0.9
        surface += -0.05 * approach + (1.7 if step % 55 == 54 else 0.0)
        surface = min(max(surface, radius + 0.02), 3.0)
        ranges = np.full(72, 5.0)
        ranges[(7 * step) % 72] = surface
        twist = rng.normal(0.0, 0.2, 3)
        seen = observed("omni3", (0.0, 0.0, 0.0), (3.0, 0.0), ranges)._replace(twist=twist[None])
        state["steps"] = step
        approached = bool(step % 3)
        moved = evade(p, state, Scan.of(policy, seen, briefing, memory), Seen.of(seen, briefing), approached)
        angle = BEAMS[(7 * step) % 72]
        rate = (before - surface) / 0.05 - (math.cos(angle) * twist[0] + math.sin(angle) * twist[1])
        closing += 0.2 * ((0.0 if step == 0 or abs(rate) > 1.5 else rate) - closing)
        before = surface
        within = policy.evade_within + closing * policy.evade_time
        wanted = approached and closing >= 0.12 and surface - radius <= within
        assert moved == wanted
        assert state["closing"][0] == pytest.approx(closing, abs=1e-9)
        assert state["nearest"][0] == surface
        told.add((approached, bool(closing >= 0.12), bool(surface - radius <= within)))
    assert {(True, True, True), (True, True, False), (True, False, False), (False, True, True)} <= told


is_due = compiled(lambda p, m, x, y, tx, ty: scan_planner.plan_is_due(p[0], m[0], x, y, tx, ty))
place_grid = compiled(lambda p, m, x, y, gx, gy: scan_planner.place_grid(p[0], m[0], x, y, gx, gy))
room_kept = compiled(lambda p, m, wheels, last, hits: scan_planner.keep_room(p[0], m[0], wheels, last, hits))


def planner_params(policy: ScanPlanner, briefing: Briefing) -> Any:
    return policy.params(
        briefing, theta=False, snap=0.0, spacing=1.0, rounds=1, recall=1.0, period_steps=60, pause_steps=20,
        all_round=True,
    )  # fmt: skip


def on_its_way(rng: np.random.Generator, narrow: float) -> tuple[Any, Any]:
    """Returns the memory of a scan planner that has a plan in a map with a narrow place, and the plan's points."""
    policy, briefing = ScanPlanner(), sighted("p3dx")
    state = policy.reset(briefing)["state"]
    state["cell"], state["origin"] = policy.cell, (-6.0, -7.0)
    turns = np.cumsum(rng.normal(0.0, 0.3, 50))
    points = np.cumsum(0.07 * np.column_stack([np.cos(turns), np.sin(turns)]), axis=0)
    state["points"][0, :50], state["num_points"] = points, 50
    state["arc"][0, :50] = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    ys, xs = np.mgrid[:160, :160] * policy.cell + 0.5 * policy.cell - np.array([7.0, 6.0])[:, None, None]
    x, y = points[rng.integers(4, 40)] + rng.normal(0.0, 0.1, 2)
    clear = np.clip(np.hypot(xs - x, ys - y) + narrow, 0.0, FARTHEST)
    state["grid"] = np.ceil((FARTHEST - clear) / UNIT)
    return state, points


def clear_at(state: Any, point: Any) -> float:
    u, v = (point[0] + 6.0) / state["cell"][0] - 0.5, (point[1] + 7.0) / state["cell"][0] - 0.5
    k, j = math.floor(u), math.floor(v)
    square = state["grid"][0][j : j + 2, k : k + 2].astype(float)
    level = np.array([1.0 - (v - j), v - j]) @ square @ np.array([1.0 - (u - k), u - k])
    return float(FARTHEST - UNIT * level)


@pytest.mark.parametrize(("reach", "creep", "limited"), [(5.0, 0.15, False), (0.3, 0.15, True), (0.3, 0.59, True)])
def test_into_what_was_not_seen_it_drives_with_room_to_stop_before_it_or_creeps(
    reach: float, creep: float, limited: bool
) -> None:
    policy, pose, v = ScanPlanner(creep=creep), (0.02, 0.03, 0.0), 0.6
    briefing = dataclasses.replace(sighted("p3dx"), max_range=reach)  # nothing is hit, and so far it is seen
    memory = policy.reset(briefing)
    state = memory["state"][0]
    state["command"][0] = v
    for _ in range(20):
        seen = observed("p3dx", pose, (3.0, 0.0), np.full(72, reach))
        policy.act(seen._replace(twist=np.array([[v, 0.0]])), briefing, memory)
        v = float(state["command"][0])
    points, ahead = state["points"][: int(state["num_points"])], 0.0
    while ahead < 1.0:
        cell = (np.array(along(points, ahead)) - state["origin"]) / policy.cell
        if state["evidence"][math.floor(cell[1]), math.floor(cell[0])] == 0:
            break
        ahead += 0.5 * policy.cell
    a = min(policy.acceleration, 0.8 * ACTUATORS["lagged"].acceleration)
    dead = ACTUATORS["lagged"].lag + 2.0 * 0.05
    stops = math.sqrt((a * dead) ** 2 + 2.0 * a * ahead) - a * dead
    assert v == pytest.approx(min(policy.max_speed, max(creep, stops)))
    assert (v < policy.max_speed) == limited
    assert (v == pytest.approx(creep)) == (creep > 0.5)


@pytest.mark.parametrize("stuck", [9, 10])
def test_who_is_stuck_bars_the_narrowest_place_and_who_is_shut_in_has_no_plan(stuck: int) -> None:
    from wayfield.policies.parts.scan_map import BARRED

    policy, briefing = ScanPlanner(), sighted("p3dx")
    memory = policy.reset(briefing)
    ranges = np.full(72, 5.0)
    seen = observed("p3dx", (0.0, 0.0, 0.0), (3.0, 0.0), ranges)
    policy.act(seen, briefing, memory)
    assert (memory["state"]["plans"][0], memory["state"]["no_path"][0]) == (1, 0)
    assert memory["state"]["num_points"][0] > 2
    at = (
        memory["state"]["points"][0, np.searchsorted(memory["state"]["arc"][0, :9], 0.3)] - memory["state"]["origin"][0]
    )
    column, row = (at / policy.cell).astype(int)
    memory["state"]["grid"][0, row - 1 : row + 2, column - 1 : column + 2] = 215  # 0.2 m of room
    memory["state"]["stuck"], memory["state"]["steps"] = stuck, 1000
    policy.act(seen, briefing, memory)
    state = memory["state"]
    assert state["plans"][0] == 2
    assert (state["evidence"] == BARRED).sum() == (stuck == 10)
    walled = observed("p3dx", (0.0, 0.0, 0.0), (3.0, 0.0), np.full(72, 0.4))
    other = policy.reset(briefing)
    twist = policy.act(walled, briefing, other)
    state = other["state"]
    assert (state["num_points"][0], state["no_path"][0], state["forgotten"][0]) == (0, 1, 1)
    assert not twist.any()


def test_when_a_scan_planner_plans_anew() -> None:
    policy, briefing, rng = ScanPlanner(), sighted("p3dx"), np.random.default_rng(16)
    p, radius = planner_params(policy, briefing), briefing.robot.hull_radius
    found = set()
    for turn in range(240):
        state, points = on_its_way(rng, float(rng.choice([0.05, 0.235, 0.5])))
        state["steps"] = steps = 100
        state["planned_at"] = steps - (waited := int(rng.choice([0, 5, 6, 19, 20, 59, 60])))
        gone = turn % 30 == 29
        state["plans"] = plans = int(not gone or turn % 60 == 29)
        state["stuck"] = stuck = int(rng.choice([0, 9, 10]))
        state["no_path"] = no_path = int(rng.integers(2))
        state["target"] = (4.0, 5.0)
        off = float(rng.choice([0.0, 0.039, 0.041]))
        aside = float(rng.choice([0.0, policy.astray - 0.02, policy.astray + 0.02]))
        k = int(rng.integers(1, 20))
        state["segment"] = k
        arc = state["arc"][0][:50]
        along = (points[k + 1] - points[k]) / math.dist(points[k + 1], points[k])
        x, y = 0.5 * (points[k] + points[k + 1]) + aside * np.array([-along[1], along[0]])
        share = [np.clip((np.array([x, y]) - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
                 for a, b in itertools.pairwise(points)]  # fmt: skip
        foot = [math.dist(a + c * (b - a), (x, y)) for a, b, c in zip(points, points[1:], share, strict=False)]
        near = [j if max(k - 1, 0) <= j and arc[j] <= arc[k + 1] + 1.0 else -1 for j in range(49)]
        at = min((j for j in near if j >= 0), key=lambda j: foot[j])
        if gone:
            state["num_points"] = 0
        due, s = is_due(p, state, x, y, 4.0 + off, 5.0)
        rested = waited >= 20
        if gone:
            assert (bool(due), s) == (plans == 0 or rested, 0.0)
            continue
        needed = radius - 0.01 - (policy.give if no_path else 0.0)

        shut = [arc[j] - arc[at] for j in range(at + 1, 50) if clear_at(state, points[j]) < needed]
        barred = min(shut, default=math.inf)  # m ahead
        asked = foot[at] > policy.astray or stuck >= 10 or waited >= 60 or off > 0.04 or barred <= 6.0
        wanted = (asked and rested) or (barred <= 1.0 and waited >= 6)
        assert bool(due) == wanted
        assert s == pytest.approx(arc[at] + share[at] * (arc[at + 1] - arc[at]))
        found.add((asked, rested, barred <= 1.0, bool(due)))
    assert len(found) >= 6


def test_the_grid_lies_half_way_to_the_goal_and_is_laid_again_near_its_edge() -> None:
    policy, briefing = ScanPlanner(), sighted("p3dx")
    p, quarter = planner_params(policy, briefing), 0.25 * 160 * policy.cell
    for goal in ((2.0, -1.0), (30.0, 3.0), (-40.0, -50.0)):
        state = policy.reset(briefing)["state"]
        place_grid(p, state, 0.5, -0.3, *goal)
        middle = [a + min(max(0.5 * (b - a), -quarter), quarter) for a, b in zip((0.5, -0.3), goal, strict=True)]
        assert state["cell"][0] == policy.cell
        assert state["origin"][0] == pytest.approx([each - 2.0 * quarter for each in middle])
        state["steps"], state["num_points"] = 4, 7
        origin = state["origin"][0].copy()
        for axis, sign, beyond in ((0, 1, 1.59), (1, -1, 1.59), (0, -1, 1.61), (1, 1, 1.61)):
            state["origin"], state["num_points"] = origin, 7
            at = origin + 2.0 * quarter
            at[axis] += sign * beyond * quarter
            place_grid(p, state, *at, *goal)
            moved = bool(np.any(state["origin"][0] != origin))
            assert moved == (beyond > 1.6)
            assert state["num_points"][0] == (0 if moved else 7)
            if moved:
                wanted = [a + min(max(0.5 * (b - a), -quarter), quarter) for a, b in zip(at, goal, strict=True)]
                now = state["origin"][0] + 2.0 * quarter
                assert np.abs(now - wanted).max() <= policy.cell + 1e-9
                assert np.rint((now - at) / 1e-9).any() or wanted == at.tolist()


def test_a_command_is_slowed_to_the_first_share_from_which_the_robot_can_stop() -> None:
    from wayfield.policies.parts.stopping import step_and_stop

    stops = compiled(lambda p, hits, last, wheels, vx, vy, w: step_and_stop(p[0].plant, hits, last, wheels, vx, vy, w))
    policy, briefing, rng = ScanPlanner(), sighted("omni3"), np.random.default_rng(18)
    p, radius = planner_params(policy, briefing), briefing.robot.hull_radius
    found = set()
    for _ in range(120):
        state = policy.reset(briefing)["state"]
        last = tuple(rng.uniform(-0.3, 0.3, 3).tolist())
        wheels = np.array(last) + rng.normal(0.0, 0.02, 3)
        around, away = rng.uniform(-math.pi, math.pi, 2), radius + rng.uniform(0.0, 0.25, 2)
        hits = np.column_stack([away * np.cos(around), away * np.sin(around), np.full(2, radius)])
        wanted = np.array(last) + rng.uniform(-0.04, 0.04, 3)
        state["command"] = wanted
        stood = room_kept(p, state, wheels, last, hits)
        share = next((c for c in (1.0, 0.6, 0.3, 0.1) if stops(p, hits, np.array(last), wheels, *(c * wanted))), 0.0)
        assert stood == (share == 0.0)
        # the command nearest to that share of the wanted one that the accelerations allow
        change = share * wanted - last
        size = float(np.hypot(*change[:2]))
        change[:2] *= min(1.0, float(p["acceleration"][0]) * 0.05 / max(size, 1e-12))
        most = float(p["yaw_acceleration"][0]) * 0.05
        change[2] = min(max(change[2], -most), most)
        np.testing.assert_allclose(state["command"][0], np.array(last) + change, atol=1e-9)
        found.add(share)
    assert {1.0, 0.0} < found


@pytest.mark.parametrize("policy", [AstarTracker(), ScanPlanner()], ids=["told", "seeing"])
def test_where_nothing_stands_the_way_is_the_straight_line(policy: Any) -> None:
    """From the robot to the goal, wherever in their cells both lie."""
    for x, y, goal in ((0.013, 0.029, (2.2, -0.9)), (-0.07, 0.041, (0.35, 1.93)), (0.0, 0.0, (-2.05, 0.0))):
        if isinstance(policy, AstarTracker):
            briefing = dataclasses.replace(told("p3dx"), num_obstacles=np.zeros(1, np.int64),
                                           goals=np.array([[[*goal, 0.0]]]), num_goals=np.array([1]))  # fmt: skip
            state = policy.reset(briefing)
            seen = Observation(np.array([[x, y, 0.0]]), np.zeros((1, 2)), np.array([np.subtract(goal, (x, y))]),
                               np.zeros(1), np.zeros(1), np.empty((1, 0)))  # fmt: skip
            policy.act(seen, briefing, state)
        else:
            briefing = sighted("p3dx")
            memory = policy.reset(briefing)
            policy.act(observed("p3dx", (x, y, 0.0), np.subtract(goal, (x, y)), np.full(72, 5.0)), briefing, memory)
            state = memory["state"]
        n = int(state["num_points"][0])
        points = state["points"][0, :n]
        share = state["arc"][0, :n] / state["arc"][0, n - 1]
        assert state["arc"][0, n - 1] == pytest.approx(math.dist(goal, (x, y)))
        np.testing.assert_allclose(points, np.add((x, y), share[:, None] * np.subtract(goal, (x, y))), atol=1e-9)
        assert np.diff(share) == pytest.approx(1.0 / (n - 1))
        assert n > 5


@pytest.mark.parametrize(
    ("left", "aside", "stuck", "whole", "anew"),
    [
        (3.0, 0.48, 0, True, False), (3.0, 0.52, 0, True, True), (3.0, -0.48, 0, True, False),
        (3.0, -0.52, 0, True, True), (3.0, 0.0, 60, True, False), (3.0, 0.0, 61, True, True),
        (2.1, 0.0, 0, False, False), (1.9, 0.0, 0, False, True), (1.9, 0.0, 0, True, False),
    ],
)  # fmt: skip
def test_the_privileged_tracker_plans_anew_off_its_way_stuck_or_near_the_end_of_a_piece(
    left: float, aside: float, stuck: int, whole: bool, anew: bool
) -> None:
    policy, briefing = AstarTracker(), told("p3dx")
    memory = planned(policy, briefing, 0.4, 1.7)
    state = memory[0]
    (end_x, end_y), length = GOALS[1, :2] - (0.0 if whole else 0.4, 0.0), 4.0
    memory["points"][0, :2] = (end_x - length, end_y), (end_x, end_y)
    memory["arc"][0, :2] = 0.0, length
    memory["num_points"], memory["segment"], memory["stuck"] = 2, 0, stuck
    before = int(state["plans"])
    pose = np.array([[end_x - left, end_y + aside, 0.0]])
    goal = GOALS[1:, :2] - pose[:, :2]
    seen = Observation(pose, np.zeros((1, 2)), goal, np.zeros(1), np.zeros(1), np.empty((1, 0)))
    policy.act(seen, briefing, memory)
    assert state["plans"] - before == anew


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_is_held_up_plans_around_what_moves_wherever_it_will_be_for_a_while(side: float) -> None:
    policy, briefing = AstarTracker(), told("p3dx")
    hull, radius = ROBOTS["p3dx"].hull_radius, float(OBSTACLES["radius"][MOVING])
    assert briefing.patrols is not None
    briefing.patrols[0, MOVING] = (1.5, 1.7 - 1.5 * side, 0.0, 0.3 * side, 30.0, 5.0)  # on the way, and going aside
    memory = planned(policy, briefing, 0.0, 1.7)
    state = memory[0]
    memory["points"][0, :2] = (0.0, 1.7), GOALS[1, :2]
    memory["arc"][0, 1], memory["num_points"], memory["segment"] = 3.4, 2, 0
    memory["held_up"], memory["planned_at"] = 1000, -1000
    before, t, grid = int(state["plans"]), 0.05 * float(state["steps"]), state["grid"].copy()
    pose = np.array([[0.0, 1.7, 0.0]])
    seen = Observation(pose, np.zeros((1, 2)), GOALS[1:, :2] - pose[:, :2], np.zeros(1), np.zeros(1), np.empty((1, 0)))
    policy.act(seen, briefing, memory)
    assert state["plans"] == before + 1
    points = state["points"][: int(state["num_points"])]
    way = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(points)])
    assert way[-1] == pytest.approx(GOALS[1, :2])
    sweep = [1.7 + side * 0.3 * (t + after) for after in np.arange(0.0, policy.patrol_horizon + 1e-9, 0.25)]
    room = min(np.hypot(*(way - (1.5, y)).T).min() for y in sweep) - radius - hull
    assert room > policy.margin - policy.cell
    np.testing.assert_array_equal(state["grid"], grid)  # what moves is no part of the map


@pytest.mark.parametrize(("now", "found"), [(1.5, True), (0.6, False)])
def test_who_has_no_way_around_all_that_is_swept_plans_around_a_third_of_it_or_keeps_its_plan(
    now: float, found: bool
) -> None:
    policy, briefing = AstarTracker(), told("p3dx")
    hull, radius, v = ROBOTS["p3dx"].hull_radius, float(OBSTACLES["radius"][MOVING]), -0.6
    assert briefing.patrols is not None
    memory = planned(policy, briefing, 0.0, 1.7)
    state = memory[0]
    t = 0.05 * float(state["steps"])
    briefing.patrols[0, MOVING] = (now - v * (5.0 + t), 1.7, v, 0.0, 30.0, 5.0)  # comes along the way
    # within the horizon it is where the robot stands, within a third of it only if it is that near already
    swept = [[now + v * after for after in np.arange(0.0, most, 0.25)] for most in (3.0, 1.0)]
    assert [min(map(abs, xs)) > radius + hull + policy.margin for xs in swept] == [False, found]
    memory["points"][0, :2] = straight = np.array([[0.0, 1.7], GOALS[1, :2]])
    memory["arc"][0, 1], memory["num_points"], memory["segment"] = 3.4, 2, 0
    memory["held_up"], memory["planned_at"] = 1000, -1000
    pose = np.array([[0.0, 1.7, 0.0]])
    seen = Observation(pose, np.zeros((1, 2)), GOALS[1:, :2] - pose[:, :2], np.zeros(1), np.zeros(1), np.empty((1, 0)))
    before = int(state["plans"])
    policy.act(seen, briefing, memory)
    assert state["plans"] == before + 1
    points = state["points"][: int(state["num_points"])]
    if not found:
        np.testing.assert_array_equal(points, straight)
        return
    way = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(points)])
    room = min(np.hypot(*(way - (x, 1.7)).T).min() for x in swept[1]) - radius - hull
    assert room > policy.margin - policy.cell


@pytest.mark.parametrize("sunk", [0.06, 0.13, 0.24])
@pytest.mark.parametrize("which", ["start", "end", "both"])
def test_an_end_that_lies_too_near_to_a_wall_is_gone_to_from_the_free_cell_next_to_it(sunk: float, which: str) -> None:
    """As long as there is one within 0.3 m; of a cell that is free the end itself takes the place."""
    base = ROBOTS["p3dx"]
    level = -0.4 + base.hull_radius  # m, of who just fits beside the wall
    at = {end: level - sunk if which in (end, "both") else level + 0.3 for end in ("start", "end")}
    goal = np.array([[[2.013, at["end"], 0.0]]])
    briefing = dataclasses.replace(
        told("p3dx"), obstacles=obstacle_field(box(0.0, -0.5, 8.0, 0.2))[None].copy(),
        num_obstacles=np.ones(1, np.int64), goals=goal, num_goals=np.ones(1, np.int64), patrols=None,
    )  # fmt: skip
    policy = AstarTracker(margin=0.0)
    p = policy.params(briefing, theta=True, snap=0.3, spacing=2.0, rounds=0, patience_steps=20)  # as it is found
    prices = np.array([astar_tracker.clearance_prices(base.hull_radius, 0.0, 0.0)] * len(astar_tracker.MARGIN_SHARES))
    memory = policy.reset(briefing)
    pose = np.array([[-0.986, at["start"], 0.0]])
    astar_tracker.decide(p, prices, Map.of(briefing), pose, np.zeros(1), np.zeros(1), memory)
    state = memory[0]
    points, cell, origin = state["points"][: int(state["num_points"])], float(state["cell"]), state["origin"]
    fits = FARTHEST - UNIT * state["grid"].astype(float) >= base.hull_radius - 1e-9
    centres = origin + cell * (np.stack(np.indices(fits.shape)[::-1], axis=-1) + 0.5)  # rows, columns, (x, y)
    for end, place in (("start", pose[0, :2]), ("end", goal[0, 0, :2])):
        column, row = ((place - origin) / cell).astype(int)
        away = np.hypot(*(np.indices(fits.shape) - np.array([row, column])[:, None, None]))
        nearest = fits & (away == away[fits].min())
        through = min(np.hypot(*(points - centre).T).min() for centre in centres[nearest])
        assert fits[row, column] == (which not in (end, "both"))
        assert (through < 1e-9) == (not fits[row, column])
        assert points[0 if end == "start" else -1] == pytest.approx(place)
