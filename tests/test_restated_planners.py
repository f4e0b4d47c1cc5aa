"""What planners know of their world and of what moves in it, stated once more in plain Python."""

import math
from typing import Any

import numpy as np
import pytest
from test_grids import clearances

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.grids import NO_GRIDS, OccupancyGrid, frames_of, lay_grids
from wayfield.envs.patrols import PATROL, patrol_at
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.scenarios.obstacles import box, circle, obstacle_field
from wayfield.policies import astar_tracker, scan_planner
from wayfield.policies.astar_tracker import AstarTracker
from wayfield.policies.nav2_dwb import Nav2Dwb
from wayfield.policies.nav2_mppi import Nav2Mppi
from wayfield.policies.parts.steering import Map
from wayfield.policies.parts.stopping import Scan, Seen
from wayfield.policies.scan_planner import ScanPlanner

FARTHEST, UNIT = 1.275, 0.005  # m
OBSTACLES = obstacle_field(
    circle(1.9, 0.6, 0.25), box(0.2, 2.1, 1.1, 0.4, 0.5), circle(-1.7, -1.1, 0.2), circle(0.9, -1.6, 0.3),
    box(30.0, 0.7, 0.5, 9.0, 0.2),
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
    briefing, pose = sighted("p3dx"), (0.3, -0.2, 0.0)
    memory = policy.reset(briefing)
    policy.act(observed("p3dx", pose, goal, np.full(72, 5.0)), briefing, memory)
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
