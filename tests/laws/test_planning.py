"""Shortest ways on grids against known optima, and the two planners that drive them."""

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray
from oracles.drives import end_of
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.policies import make
from wayfield.policies.parts.grid_search import a_star, sees, theta_star
from wayfield.policies.parts.polyline_tracker import FARTHEST, UNIT
from wayfield.policies.parts.scan_map import CHART, SUB, mark, stamps, weaken
from wayfield.policies.pilot import Pilot
from wayfield.policies.poses import astar_tracker
from wayfield.policies.poses.astar_tracker import AstarTracker
from wayfield.policies.scans.scan_planner import ScanPlanner
from wayfield.policies.training.ways import sweep
from wayfield.system.compiled import compiled

MOVINGAI = Path(__file__).parents[3] / "shared" / "data" / "movingai"
ID_OF = {"p3dx": "wayfield/DiffDriveGoalObstacles-v0"} | dict.fromkeys(
    ("omni3", "omni4"), "wayfield/OmniGoalObstacles-v0"
)
PLANNERS = (AstarTracker, ScanPlanner)
Grid = NDArray[np.bool_]

entered = compiled(lambda chart, table, row, column, spot: mark(chart[0], table, row, column, spot))
weakened = compiled(lambda chart, table, row, column: weaken(chart[0], table, row, column))


def state_of(pilot: Pilot) -> NDArray[np.void]:
    """Returns what a planner remembers besides earlier scans."""
    memory = pilot.memory
    return memory["state"] if "state" in (memory.dtype.names or ()) else memory


grids = arrays.arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12)), elements=st.booleans())
sparse_grids = arrays.arrays(
    np.bool_, st.tuples(st.integers(2, 20), st.integers(2, 20)), elements=st.sampled_from([False, False, False, True])
)


def ends_of(grid: Grid) -> tuple[tuple[int, int], tuple[int, int]]:
    """Returns the first and the last free cell, or corners where none is."""
    free = np.argwhere(~grid)
    if not len(free):
        return (0, 0), (grid.shape[0] - 1, grid.shape[1] - 1)
    return (int(free[0, 0]), int(free[0, 1])), (int(free[-1, 0]), int(free[-1, 1]))


def optimum(grid: Grid, start: tuple[int, int], goal: tuple[int, int]) -> float:
    """Returns the length of the shortest way by Dijkstra's algorithm on the explicit graph."""
    rows, columns = grid.shape
    edges = []
    for (r, c), blocked in np.ndenumerate(grid):
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            to_r, to_c = r + dr, c + dc
            if blocked or not (0 <= to_r < rows and 0 <= to_c < columns):
                continue
            if not (grid[to_r, to_c] or grid[r, to_c] or grid[to_r, c]):
                edges.append((r * columns + c, to_r * columns + to_c, math.hypot(dr, dc)))
    if grid[start] or grid[goal]:
        return math.inf
    i, j, length = np.array(edges).reshape(-1, 3).T
    graph = coo_array((length, (i.astype(np.int32), j.astype(np.int32))), shape=(grid.size, grid.size))
    first, last = (int(r * columns + c) for r, c in (start, goal))
    return float(dijkstra(graph.tocsr(), directed=False, indices=first)[last])


# Known optima.


def grid_map(file: Path) -> Grid:
    """Returns the blocked cells of a map of the MovingAI benchmarks (Sturtevant, T-CIAIG 2012); row 0 comes first."""
    rows = file.read_text().split("map\n", 1)[1].split()
    return np.array([[cell in "@OTW" for cell in row] for row in rows])


class Problem(NamedTuple):
    """A line of a .scen file of the MovingAI benchmarks."""

    map_name: str
    shape: tuple[int, int]  # rows, columns of its map
    start: tuple[int, int]  # row, column
    goal: tuple[int, int]
    optimal_length: float  # octile, no corner cut, as printed: to about 1e-8


def grid_problems(file: Path) -> list[Problem]:
    """Returns the problems of a .scen file."""
    problems = []
    for line in file.read_text().splitlines()[1:]:
        _, name, *numbers, length = line.split("\t")
        columns, rows, start_x, start_y, goal_x, goal_y = map(int, numbers)
        problems.append(Problem(name, (rows, columns), (start_y, start_x), (goal_y, goal_x), float(length)))
    return problems


@pytest.mark.skipif(not MOVINGAI.is_dir(), reason="needs the MovingAI maps in ../shared/data")
@pytest.mark.parametrize("share", [64, pytest.param(1, marks=pytest.mark.slow)], ids=["sample", "all"])
def test_movingai_problems_are_solved_with_their_published_length(share: int) -> None:
    count = 0
    for file in sorted(MOVINGAI.glob("*.map")):
        grid = grid_map(file)
        for problem in grid_problems(MOVINGAI / f"{file.stem}-random-1.scen")[::share]:
            assert problem.map_name == file.name
            assert problem.shape == grid.shape
            along_cells = a_star(grid, problem.start, problem.goal)
            assert along_cells.length == pytest.approx(problem.optimal_length, abs=2e-8)
            any_angle = theta_star(grid, problem.start, problem.goal)
            assert any_angle.length <= along_cells.length
            assert any_angle.length >= math.dist(problem.start, problem.goal) - 1e-9
            count += 1
    assert count > 1000 / share


def line_of_sight(grid: Grid, a: tuple[int, ...], b: tuple[int, ...]) -> bool:
    """Returns whether the straight line between the centres of two cells touches free cells only."""
    return bool(sees(np.ascontiguousarray(grid).view(np.uint8), np.array([1.0, np.inf]), *a, *b))


@given(grids)
def test_a_star_is_as_short_as_dijkstra(grid: Grid) -> None:
    start, goal = ends_of(grid)
    assert a_star(grid, start, goal).length == pytest.approx(optimum(grid, start, goal), rel=1e-12)


@given(sparse_grids)
def test_ways_go_through_free_cells_and_cut_no_corner(grid: Grid) -> None:
    start, goal = ends_of(grid)
    along_cells, any_angle = a_star(grid, start, goal), theta_star(grid, start, goal)
    assert any_angle.length <= along_cells.length
    assert math.isinf(any_angle.length) == math.isinf(along_cells.length)
    for way in (along_cells, any_angle):
        if math.isinf(way.length):
            assert len(way.cells) == 0
            continue
        assert tuple(way.cells[0]) == start
        assert tuple(way.cells[-1]) == goal
        assert not grid[tuple(way.cells.T)].any()
        assert np.hypot(*np.diff(way.cells, axis=0).T).sum() == pytest.approx(way.length, rel=1e-12)
        assert all(line_of_sight(grid, tuple(a), tuple(b)) for a, b in zip(way.cells, way.cells[1:], strict=False))
    for (r, c), (to_r, to_c) in zip(along_cells.cells, along_cells.cells[1:], strict=False):
        assert max(abs(to_r - r), abs(to_c - c)) == 1
        assert not grid[r, to_c]
        assert not grid[to_r, c]


@given(sparse_grids, st.data())
def test_line_of_sight_is_what_the_line_touches_and_symmetric(grid: Grid, data: st.DataObject) -> None:
    cell = st.tuples(*(st.integers(0, size - 1) for size in grid.shape))
    a, b = data.draw(cell), data.draw(cell)
    # the closed squares that the segment touches in more than a corner of their own outside, by clipping
    touched = False
    for r, c in np.argwhere(grid):
        enter, leave = 0.0, 1.0
        for p, q, middle in zip(a, b, (r, c), strict=True):
            if p == q:
                if abs(p - middle) >= 0.5:
                    enter, leave = 1.0, 0.0
                continue
            near, far = sorted(((middle - 0.5 - p) / (q - p), (middle + 0.5 - p) / (q - p)))
            enter, leave = max(enter, near), min(leave, far)
        touched |= enter <= leave + 1e-12
    assert line_of_sight(grid, a, b) == (not touched)
    assert line_of_sight(grid, b, a) == line_of_sight(grid, a, b)


def test_what_cannot_be_searched_is_said() -> None:
    grid = np.zeros((4, 5), np.bool_)
    grid[:, 2] = True
    for way in (a_star(grid, (0, 0), (0, 4)), theta_star(grid, (0, 0), (0, 4)), a_star(grid, (0, 2), (0, 0))):
        assert way.length == math.inf
        assert way.cells.shape == (0, 2)
    assert a_star(grid, (1, 1), (1, 1)).length == 0.0
    assert theta_star(grid, (1, 1), (1, 1)).cells.tolist() == [[1, 1]]
    with pytest.raises(ValueError, match=r"goal \(0, 5\) is outside the grid of 4 x 5 cells"):
        a_star(grid, (0, 0), (0, 5))
    with pytest.raises(ValueError, match="must be a bool array"):
        theta_star(np.zeros((4, 5)), (0, 0), (0, 1))


# Driving.


def wall(x1: float, y1: float, x2: float, y2: float) -> dict[str, Any]:
    return {"kind": "wall", "x1": x1, "y1": y1, "x2": x2, "y2": y2}


SQUARE = [wall(-5, -5, 5, -5), wall(5, -5, 5, 5), wall(5, 5, -5, 5), wall(-5, 5, -5, -5)]
# the robot starts inside: the goal lies behind the wall before it
U_TRAP = [*SQUARE, wall(1, -1, 1, 1), wall(-0.5, -1, 1, -1), wall(-0.5, 1, 1, 1)]
DOOR = [*SQUARE, wall(0, -5, 0, 1.2), wall(0, 2.0, 0, 5)]
CELL = [*SQUARE, wall(2, -2, 4, -2), wall(4, -2, 4, 0), wall(4, 0, 2, 0), wall(2, 0, 2, -2)]


def world(tmp_path: Path, obstacles: list[dict[str, Any]], **fields: Any) -> str:
    file = tmp_path / "world.json"
    file.write_text(json.dumps({"start": [0, 0, 0], "goal": [3, -1, 0.5], "obstacles": obstacles} | fields))
    return str(file)


def drive(policy: Any, robot: str, scenario: str, **options: Any) -> tuple[dict[str, Any], Pilot]:
    """Returns the last info of an episode, and the pilot that drove it."""
    settings = {"actuators": "lagged", "num_beams": 72} | options
    env = gymnasium.make(ID_OF[robot], robot=robot, scenario=scenario, **settings)
    pilot = Pilot(policy, env)
    return end_of(env, pilot), pilot


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
@pytest.mark.parametrize(("obstacles", "start"), [(U_TRAP, [0, 0, 0]), (DOOR, [-3, -2, 2.0])], ids=["u_trap", "door"])
def test_planners_reach_pose_and_heading_of_the_goal(
    tmp_path: Path, planner: Any, robot: str, obstacles: list[dict[str, Any]], start: list[float]
) -> None:
    info, pilot = drive(planner(), robot, world(tmp_path, obstacles, start=start))
    assert info["success"]
    assert info["goal_distance"] <= 0.1
    assert abs(info["goal_heading_error"]) <= 0.1
    assert state_of(pilot)["no_path"].tolist() == [0]


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("actuators", ["ideal", "slow"])
def test_planners_drive_every_tier_of_actuators(tmp_path: Path, planner: Any, actuators: str) -> None:
    info, _ = drive(planner(), "omni4", world(tmp_path, U_TRAP), actuators=actuators)
    assert info["success"]


@pytest.mark.parametrize("planner", PLANNERS)
def test_planners_bear_noise(tmp_path: Path, planner: Any) -> None:
    info, _ = drive(planner(), "p3dx", world(tmp_path, U_TRAP), noise=1.0)
    assert info["success"]


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_a_scan_planner_with_a_narrow_view_looks_where_it_goes(tmp_path: Path, robot: str) -> None:
    info, _ = drive(ScanPlanner(), robot, world(tmp_path, U_TRAP), num_beams=30, field_of_view=2.0)
    assert info["success"]


def test_a_goal_beyond_the_grid_is_reached(tmp_path: Path) -> None:
    far = world(tmp_path, [wall(4, -2, 4, 2)], goal=[20, 3, 0])
    for planner in PLANNERS:
        assert drive(planner(), "omni3", far)[0]["success"]


def test_waypoints_are_passed_in_order(tmp_path: Path) -> None:
    course = world(tmp_path, SQUARE, waypoints=[[3, 3], [-3, 3], [-3, -3]], goal=[3, -3, 0], waypoint_radius=0.2)
    for planner in PLANNERS:
        for robot in ("p3dx", "omni3"):
            assert drive(planner(), robot, course)[0]["success"]


def test_patrols_are_waited_for(tmp_path: Path) -> None:
    """A disc goes to and fro in a corridor's crossing: who does not look at it is run over."""
    disc = {"kind": "circle", "x": 1.5, "y": -1.6, "radius": 0.4}
    patrol = {"vx": 0.0, "vy": 0.4, "leg_time": 8.0, "phase": 0.0}
    obstacles = [wall(-1, -0.6, 0.8, -0.6), wall(-1, 0.6, 0.8, 0.6), {**disc, "patrol": patrol}]
    for robot in ("p3dx", "omni3"):
        info, _ = drive(AstarTracker(), robot, world(tmp_path, obstacles, goal=[4, 0, 0]))
        assert info["success"]


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_a_disc_that_comes_head_on_is_let_past(tmp_path: Path, planner: Any, robot: str) -> None:
    """Who drives on, or only stops, is run over."""
    patrol = {"vx": -0.4, "vy": 0.0, "leg_time": 12.5, "phase": 0.0}
    disc = {"kind": "circle", "x": 5.5, "y": 0.05, "radius": 0.3, "patrol": patrol}
    info, _ = drive(planner(), robot, world(tmp_path, [disc], goal=[6.5, 0, 0]))
    assert info["success"]


def test_a_robot_without_a_way_stands_still_and_says_so(tmp_path: Path) -> None:
    for robot in ("p3dx", "omni3"):
        info, pilot = drive(AstarTracker(), robot, world(tmp_path, CELL))
        assert not info["success"]
        assert not info["collision"]
        assert state_of(pilot)["no_path"].tolist() == [1]
        assert not state_of(pilot)["command"].any()
        assert info["goal_distance"] == pytest.approx(math.hypot(3, 1))


def test_a_way_longer_than_a_plan_is_driven_in_pieces_none_of_which_crosses_a_wall(tmp_path: Path) -> None:
    """Up and down between thin walls: some 220 m, of which a plan has room for less."""
    walls = np.zeros((192, 160), np.bool_)
    for k in range(1, 16):
        walls[12 * k, 10 * (k % 2) : 150 + 10 * (k % 2)] = True  # a gap at one end or the other, in turn
    np.save(tmp_path / "m.npy", walls)
    told = {"start": [0.5, 0.6, 0], "goal": [8.0, 18.6, 0], "heading_tolerance": 3.1}
    told["map"] = {"file": "m.npy", "resolution": 0.1}
    (tmp_path / "s.json").write_text(json.dumps(told), encoding="utf-8")
    env: Any = gymnasium.make(ID_OF["p3dx"], scenario=str(tmp_path / "s.json"), max_episode_steps=20_000, num_beams=0)
    observation, _ = env.reset(seed=0)
    pilot = Pilot(AstarTracker(), env)
    pilot.reset()
    plans, over = 0, False
    while not over:
        observation, _, terminated, truncated, info = env.step(pilot.act(observation))
        over = terminated or truncated
        state = state_of(pilot)[0]
        if state["plans"] > plans:
            plans = int(state["plans"])
            points = state["points"][: state["num_points"]]
            shares = np.linspace(0.0, 1.0, 9)[:, None, None]
            along = (points[:-1] + shares * (points[1:] - points[:-1])).reshape(-1, 2)
            assert env.unwrapped.batch.task.scenarios[0].grid.clearances(along).min() > 0.1
    assert info["success"]
    assert plans >= 2


@settings(max_examples=settings().max_examples // 5)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.1, 0.25, 0.35]))
def test_among_wide_cells_gaps_of_one_cell_are_ways_and_the_plan_is_hardly_longer_than_the_shortest(
    tmp_path_factory: pytest.TempPathFactory, seed: int, share: float
) -> None:
    """A map of metres whose third is more than the few cells of a grid can hold: a way wherever A* along it has one."""
    rng = np.random.default_rng(seed)
    occupied = rng.random((80, 80)) < share
    free = np.argwhere(~occupied)
    start, goal = (tuple(free[k].tolist()) for k in rng.integers(len(free), size=2))
    folder = tmp_path_factory.mktemp("map")
    np.save(folder / "m.npy", occupied)
    told = {name: [at[1] + 0.5, at[0] + 0.5, 0] for name, at in (("start", start), ("goal", goal))}
    told["map"] = {"file": "m.npy", "resolution": 1.0}
    (folder / "s.json").write_text(json.dumps(told), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(astar_tracker, "CELLS", (64, 256))  # 256 as everywhere: a grid of another size is compiled for
        patch.setattr(astar_tracker, "WIDE", 64)
        env: Any = gymnasium.make(ID_OF["p3dx"], scenario=str(folder / "s.json"), num_beams=0)
        observation, _ = env.reset(seed=0)
        pilot = Pilot(AstarTracker(), env)
        pilot.reset()
        pilot.act(observation)
    state = state_of(pilot)[0]
    assert state["cell"] == pytest.approx(1.0 / 3.0)
    shortest = a_star(occupied, start, goal).length
    assert (state["no_path"] == 0) == math.isfinite(shortest)
    points = state["points"][: state["num_points"]]
    if len(points) > 1:
        assert state["arc"][len(points) - 1] < astar_tracker.DETOUR * shortest + 0.5
        shares = np.linspace(0.0, 1.0, 9)[:, None, None]
        along = (points[:-1] + shares * (points[1:] - points[:-1])).reshape(-1, 2)
        assert env.unwrapped.batch.task.scenarios[0].grid.clearances(along).min() > 0.36  # hull and half of the margin


ROWS = st.integers(0, 15)


@given(st.lists(st.tuples(ROWS, ROWS, st.integers(0, SUB * SUB - 1), st.none() | st.integers(0, 39)), max_size=40))
@example([(5, 5, 0, None), (5, 7, 9, None), (9, 1, 3, 0)])
@example([(0, 3, 2, None), (15, 15, 1, None), (4, 3, 5, None), (4, 4, 5, 2)])
def test_a_scan_map_holds_the_clearance_of_the_spots_it_has(entries: list[tuple[int, int, int, int | None]]) -> None:
    """Whatever was entered and taken back, each cell knows how near the nearest spot left is, near ones only."""
    cell, reach = 0.1, 0.55
    chart, table = np.zeros(1, CHART), stamps(cell, reach)
    grid, evidence, spots = (chart[0][name] for name in ("grid", "evidence", "spots"))
    for k, (row, column, spot, back) in enumerate(entries):
        evidence[row, column] = 1
        entered(chart, table, row, column, spot)
        if back is not None:  # all of a cell that was entered before
            gone = entries[back % (k + 1)][:2]
            weakened(chart, table, *gone)
            assert spots[gone] == 0
    left = np.array(
        [
            (column + (spot % SUB + 0.5) / SUB, row + (spot // SUB + 0.5) / SUB)
            for row, column in np.argwhere(spots)
            for spot in range(SUB * SUB)
            if spots[row, column] >> spot & 1
        ]
    ).reshape(-1, 2)
    for (row, column), level in np.ndenumerate(grid[:32, :32]):
        away = np.hypot(*(left - (column + 0.5, row + 0.5)).T).min(initial=np.inf) * cell
        if away > reach + 1e-9:
            assert level == 0
        elif away < reach - 1e-9:
            clearance = away - 0.5 / SUB * cell
            assert clearance - UNIT - 1e-6 <= FARTHEST - UNIT * level <= clearance + 1e-6


@pytest.mark.parametrize(
    "name", ["astar_tracker", "reeds_shepp", "reeds_shepp_scan", "mpc_pose", "smooth_pose", "waypoint"]
)
@pytest.mark.parametrize(
    ("waypoints", "goal"),
    [
        ([(3.0, 0.0), (3.0, 3.0), (0.0, 3.0)], (0.0, 0.0, 0.0)),
        ([(6.0, 0.0)], (3.0, 0.0, 0.0)),
        ([(3.0, 0.0), (0.0, 0.0), (3.0, 0.0)], (0.0, 0.0, 0.0)),
    ],
    ids=["loop", "goal on the way", "back and forth"],
)
def test_a_goal_that_is_passed_on_the_way_to_a_waypoint_is_not_reached(name: str, waypoints: Any, goal: Any) -> None:
    scenario = GoalScenario("route", (0.0, 0.0, 0.0), goal, waypoints, heading_tolerance=3.14, waypoint_radius=0.2)
    robot = "omni3" if name == "waypoint" else "p3dx"
    env: Any = gymnasium.make(ID_OF[robot], robot=robot, scenario=scenario, max_episode_steps=1200)
    observation, _ = env.reset(seed=0)
    pilot = Pilot(make(name), env)
    pilot.reset()
    terminated = truncated = False
    while not (terminated or truncated):
        observation, _, terminated, truncated, info = env.step(pilot.command(observation))
    assert info["success"], info


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
