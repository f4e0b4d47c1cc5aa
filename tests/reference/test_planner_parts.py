"""Reference implementations of what planners make of their world and of what moves in it."""

import dataclasses
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
from wayfield.policies.poses.astar_tracker import AstarTracker
from wayfield.policies.scans.scan_planner import ScanPlanner
from wayfield.policies.training.ways import sweep

FARTHEST, UNIT = 1.275, 0.005  # m
OBSTACLES = obstacle_field(
    circle(1.9, 0.6, 0.25), box(0.2, 2.1, 1.1, 0.4, 0.5), circle(-1.7, -1.1, 0.2), circle(0.9, -1.6, 0.3),
    box(15.0, 0.7, 0.5, 9.0, 0.2),
)  # fmt: skip
MOVING = 3
GOALS = np.array([[2.2, -0.9, 0.0], [3.4, 1.7, 0.5]])


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


# The shortest way.


def test_a_way_solves_the_eikonal_equation_to_the_end_of_a_spiral() -> None:
    side, cell = 33, 0.1
    costs = np.full((side, side), cell)
    row, column, length = side - 2, 1, side - 2
    walls = np.zeros((side, side), bool)
    for k in range(14):  # arms of a spiral, two cells from each other
        for _ in range(max(length, 0)):
            walls[row, column] = True
            row += (0, -1, 0, 1)[k % 4]
            column += (1, 0, -1, 0)[k % 4]
        length -= 2 if k else 1
    costs[walls] = 10.0 * cell
    ways = np.full((side, side), np.inf)
    ways[side // 2, side // 2] = 0.0
    sweep(costs, ways)
    assert np.isfinite(ways).all()
    beyond = np.pad(ways, 1, constant_values=np.inf)
    low = np.minimum(beyond[:-2, 1:-1], beyond[2:, 1:-1]), np.minimum(beyond[1:-1, :-2], beyond[1:-1, 2:])
    a, b = np.minimum(*low), np.maximum(*low)
    with np.errstate(invalid="ignore"):
        both = 0.5 * (a + b + np.sqrt(2.0 * costs**2 - (b - a) ** 2))
    wanted = np.where(b - a >= costs, a + costs, both)
    wanted[side // 2, side // 2] = 0.0
    np.testing.assert_allclose(ways, wanted, atol=2e-6)
    assert ways.max() > 2.0 * math.hypot(side, side) * 0.5 * cell  # round the arms, not straight
