"""Reference implementations of what planners make of their world and of what moves in it."""

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
from wayfield.envs.tasks.briefing import Briefing, Goals, Surroundings
from wayfield.envs.world.grids import NO_GRIDS, OccupancyGrid, lay_grids
from wayfield.envs.world.movers import motion_at
from wayfield.policies import astar_tracker, scan_planner
from wayfield.policies.astar_tracker import AstarTracker
from wayfield.policies.parts.steering import Map
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
    obstacles = OBSTACLES[None].copy()
    obstacles[0, MOVING]["patrol"] = (*(OBSTACLES[MOVING][name].item() for name in ("x", "y")), 0.4, 0.7, 4.0, 0.9)
    grids = NO_GRIDS if grid is None else lay_grids([grid], np.zeros(1, NO_GRIDS.frames.dtype))
    base = ROBOTS[robot]
    return Briefing(
        1, base, ACTUATORS["lagged"], 0.05, "twist", Observation.layout(len(base.twist_axes), 0, 5.0), np.empty(0), 5.0,
        map=Surroundings.of(obstacles, np.array([len(OBSTACLES)]), grids),
        goal=Goals(GOALS[None], np.array([2])),
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
    disc = briefing.map.obstacles[0, MOVING]  # type: ignore[union-attr]
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
                mx, my, _, _ = motion_at(disc, time + 0.1 * k)
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


def sighted(robot: str) -> Briefing:
    base = ROBOTS[robot]
    layout = Observation.layout(len(base.twist_axes), len(BEAMS), 5.0)
    return Briefing(1, base, ACTUATORS["lagged"], 0.05, "twist", layout, BEAMS, 5.0)


def observed(robot: str, pose: Any, goal: Any, ranges: Any) -> Observation:
    t = len(ROBOTS[robot].twist_axes)
    return Observation(
        np.array([pose]), np.zeros((1, t)), np.array([goal]), np.zeros(1), np.zeros(1), np.array([ranges])
    )


room_kept = compiled(lambda p, m, wheels, last, hits: scan_planner.keep_room(p[0], m[0], wheels, last, hits))


def planner_params(policy: ScanPlanner, briefing: Briefing) -> Any:
    return policy.params(
        briefing, theta=False, snap=0.0, spacing=1.0, rounds=1, recall=1.0, period_steps=60, pause_steps=20,
        all_round=True,
    )  # fmt: skip


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
            briefing = dataclasses.replace(
                told("p3dx"),
                map=Surroundings.of(OBSTACLES[None], np.zeros(1, np.int64)),
                goal=Goals(np.array([[[*goal, 0.0]]]), np.array([1])),
            )
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


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_is_held_up_plans_around_what_moves_wherever_it_will_be_for_a_while(side: float) -> None:
    policy, briefing = AstarTracker(), told("p3dx")
    hull, radius = ROBOTS["p3dx"].hull_radius, float(OBSTACLES["radius"][MOVING])
    assert briefing.map is not None
    briefing.map.patrols[0, MOVING] = (1.5, 1.7 - 1.5 * side, 0.0, 0.3 * side, 30.0, 5.0)  # on the way, and going aside
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


@pytest.mark.parametrize("sunk", [0.06, 0.13, 0.24])
@pytest.mark.parametrize("which", ["start", "end", "both"])
def test_an_end_that_lies_too_near_to_a_wall_is_gone_to_from_the_free_cell_next_to_it(sunk: float, which: str) -> None:
    """As long as there is one within 0.3 m; of a cell that is free the end itself takes the place."""
    base = ROBOTS["p3dx"]
    level = -0.4 + base.hull_radius  # m, of who just fits beside the wall
    at = {end: level - sunk if which in (end, "both") else level + 0.3 for end in ("start", "end")}
    goal = np.array([[[2.013, at["end"], 0.0]]])
    briefing = dataclasses.replace(
        told("p3dx"),
        map=Surroundings.of(obstacle_field(box(0.0, -0.5, 8.0, 0.2))[None].copy(), np.ones(1, np.int64)),
        goal=Goals(goal, np.ones(1, np.int64)),
    )
    policy = AstarTracker(margin=0.0)
    p = policy.params(briefing, theta=True, snap=0.3, spacing=2.0, rounds=0, patience_steps=20)  # as it is found
    memory = policy.reset(briefing)
    pose = np.array([[-0.986, at["start"], 0.0]])
    astar_tracker.decide(p, Map.of(briefing), pose, np.zeros(1), np.zeros(1), memory)
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
