"""Occupancy grids: rays and clearances beside independent measures; a world of cells is that world of boxes."""

import dataclasses
import json
import math
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.grid_measures import FREE, Array, clearances, rays

import wayfield.envs
from wayfield.envs.scenarios import maps
from wayfield.envs.scenarios.obstacles import box, obstacle_field
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.envs.world.grid_scans import SCRATCH, TOGETHER, WORDS, scan_grid
from wayfield.envs.world.grids import MOST_SIDE, NO_GRIDS, OccupancyGrid, lay_grids
from wayfield.system.elementary import sines

DATA = Path(__file__).parents[3] / "shared" / "data"
PUBLIC = ("ros_maps/turtlebot3_world.yaml", "ros_maps/depot.yaml", *(f"mrpb/{n}/map.yaml" for n in ("maze", "room02")))


def assert_measured(grid: OccupancyGrid, count: int, seed: int) -> None:
    """Holds rays and clearances of random poses, some of them beside the grid, against the independent measures."""
    rng = np.random.default_rng(seed)
    points = grid.points(rng.uniform(-0.1, 1.1, (count, 2)) * grid.occupied.shape[::-1])
    headings = rng.uniform(-3.0, 3.0, count)
    expected = clearances(grid, points)
    np.testing.assert_allclose(grid.clearances(points), expected, rtol=0, atol=1e-6 * grid.resolution)
    assert ((expected == 0.0) == grid.is_occupied(points)).all()
    measured = grid.rays(points, headings, 30.0)
    off = np.abs(measured - rays(grid, points, headings, 30.0)) > 1e-6 * grid.resolution
    # a ray through the very corner of a square may go either way
    assert off.sum() <= 1e-3 * count, np.flatnonzero(off)


@pytest.mark.parametrize("beyond", ["occupied", "free"])
@pytest.mark.parametrize("density", [0.0, 0.002, 0.05, 0.4])
def test_rays_and_clearances_are_those_of_the_occupied_squares(density: float, beyond: str) -> None:
    rng = np.random.default_rng(5)
    occupied = rng.random((61, 97)) < density
    assert_measured(OccupancyGrid(occupied, 0.05, (-3.0, 2.0, 0.7), beyond), 500, 1)
    assert_measured(OccupancyGrid(occupied.T.copy(), 0.3, (10.0, -2.0, 0.0), beyond), 200, 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLIC)
def test_rays_and_clearances_on_public_maps(name: str) -> None:
    if not (DATA / name).exists():
        pytest.skip("../shared/data is not here")
    for unknown in ("occupied", "free"):
        assert_measured(maps.grid_from_file(str(DATA / name), unknown), 10_000, 3)


@given(st.integers(0, 2**32 - 1), st.floats(-3.0, 3.0), st.sampled_from(["occupied", "free"]))
@settings(max_examples=30, deadline=None)
def test_a_clearance_changes_by_no_more_than_a_metre_per_metre_and_a_ray_ends_on_a_surface(
    seed: int, yaw: float, beyond: str
) -> None:
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(rng.random((12, 17)) < 0.1, 0.5, (1.0, 2.0, yaw), beyond)
    points = grid.points(rng.uniform(0.0, 1.0, (60, 2)) * (17, 12))
    headings = rng.uniform(-math.pi, math.pi, 60)
    ways = np.column_stack([np.cos(headings), np.sin(headings)])
    here = grid.clearances(points)
    there = grid.clearances(points + 0.3 * ways)
    if beyond == "occupied" or grid.occupied.any():
        assert (np.abs(here - there) <= 0.3 + 1e-9).all()
    lengths = grid.rays(points, headings, 4.0)
    assert (lengths >= np.minimum(here, 4.0) - 1e-9).all()
    hits = lengths < 4.0
    assert (grid.clearances(points + lengths[:, None] * ways)[hits] <= 1e-9).all()


def traversed(grid: OccupancyGrid, place: Array, way: Array, reach: float) -> float:
    """Returns how far a ray goes, in cells, by the traversal of Amanatides and Woo from cell to cell."""
    rows, columns = grid.occupied.shape
    (u, v), (du, dv) = place.tolist(), way.tolist()
    j, i, gone = int(u), int(v), 0.0
    step_u, step_v = 1 if du >= 0.0 else -1, 1 if dv >= 0.0 else -1
    inverse_u, inverse_v = (1.0 / each if each else math.inf for each in (du, dv))
    while gone < reach:
        if not (0 <= i < rows and 0 <= j < columns):
            return gone if grid.beyond != FREE else reach
        if grid.occupied[i, j]:
            return gone
        to_u = (j + step_u + (-u if du >= 0.0 else 1.0 - u)) * inverse_u
        to_v = (i + step_v + (-v if dv >= 0.0 else 1.0 - v)) * inverse_v
        gone = min(to_u, to_v)
        i, j = (i, j + step_u) if to_u < to_v else (i + step_v, j)
    return reach


def near_corners(grid: OccupancyGrid, place: Array, rng: np.random.Generator, count: int) -> Array:
    """Returns unit vectors (count, 2) past corners of what is occupied, nearer by than single precision tells."""
    cells = np.argwhere(grid.occupied)[:, ::-1] if grid.occupied.any() else rng.integers(0, 30, (40, 2))
    nearest = cells[np.argsort(np.hypot(*(cells - place).T))[:40]]
    ways = nearest[rng.integers(0, len(nearest), count)] + rng.integers(0, 2, (count, 2)) - place
    aside = np.exp(rng.uniform(math.log(1e-8), math.log(3e-6), count)) * rng.choice([-1.0, 1.0], count)
    ways += (aside / np.hypot(*ways.T))[:, None] * ways[:, ::-1] * (-1.0, 1.0)
    return ways / np.hypot(*ways.T)[:, None]


@pytest.mark.parametrize("beyond", ["occupied", "free"])
@pytest.mark.parametrize("density", [0.0, 0.01, 0.1, 0.4])
def test_a_scan_has_the_bits_of_the_traversal_from_cell_to_cell(density: float, beyond: str) -> None:
    rng = np.random.default_rng(11)
    grid = OccupancyGrid(rng.random((37, 53)) < density, 0.25, beyond=beyond)
    grids = lay_grids([grid], np.zeros(1, NO_GRIDS.frames.dtype))
    around = sines(np.linspace(-3.1, 3.1, TOGETHER // 4))[::-1]  # with those past corners more than go at once
    anywhere = rng.uniform(0.0, 1.0, (1, 2)) * (53 * 0.25, 37 * 0.25)
    # so near to a corner of cells, free and occupied ones, that single precision does not tell from it
    by_corners = 0.25 * rng.integers(1, 36, (4, 2)) + rng.choice([-1e-11, 1e-11], (4, 2))
    for point, count in zip([*anywhere, *by_corners], [800] + [20] * 4, strict=True):
        place = grid.places(point)
        past = near_corners(grid, place, rng, count).T
        beams = np.ascontiguousarray(np.hstack([around, past]))
        # what stands nearer than the map has been seen already; nothing has before the beams past corners
        before = rng.uniform(0.0, 8.0, (1, beams.shape[1]))
        before[0, around.shape[1] :] = 8.0
        ranges = before.copy()
        scan_grid(
            grids.frames[0],
            grids.cells,
            (*point, 0.0),
            beams,
            ranges,
            0,
            0,
            np.empty(SCRATCH, np.float32),
            np.empty(WORDS, np.uint64),
        )
        for k, beam in enumerate(beams.T):
            reach = before[0, k] / 0.25
            gone = traversed(grid, place, beam, reach)
            assert ranges[0, k] == (gone * 0.25 if gone < reach else before[0, k])


def test_the_outline_is_as_long_as_the_sides_between_occupied_and_free() -> None:
    occupied = np.zeros((4, 6), np.bool_)
    occupied[1:3, 2:5] = True
    outline = OccupancyGrid(occupied, 0.5, (1.0, 1.0, 0.3), "free").outline()
    assert sorted(np.hypot(*(outline[:, 1] - outline[:, 0]).T).round(9).tolist()) == [1.0, 1.0, 1.5, 1.5]
    closed = OccupancyGrid(occupied, 0.5).outline()
    assert np.hypot(*(closed[:, 1] - closed[:, 0]).T).sum() == pytest.approx(5.0 + 10.0)


def _worlds(folder: Path) -> tuple[str, str]:
    """Writes one world twice, as a map and as boxes; returns the two scenario files."""
    rng = np.random.default_rng(3)
    blocked = rng.random((12, 14)) < 0.12
    blocked[4:9, 0:5] = False
    resolution, origin = 0.9, (1.0, -1.0, 0.3)
    grid = OccupancyGrid(blocked, resolution, origin, "free")
    start, goal = grid.points(np.array([[2.0, 6.0], [2.2, 6.5]])).tolist()
    common = {"start": [*start, 0.0], "goal": [*goal, 0.0], "start_turn": 3.0, "position_tolerance": 0.01}
    np.save(folder / "room.npy", blocked)
    told = {"file": "room.npy", "resolution": resolution, "origin": list(origin), "unknown": "free"}
    (folder / "cells.json").write_text(json.dumps({**common, "map": told}), encoding="utf-8")
    at = grid.points(np.argwhere(blocked)[:, ::-1] + 0.5).tolist()
    boxes = [
        {"kind": "box", "x": x, "y": y, "length": resolution, "width": resolution, "heading": origin[2]} for x, y in at
    ]
    (folder / "boxes.json").write_text(json.dumps({**common, "obstacles": boxes}), encoding="utf-8")
    return str(folder / "cells.json"), str(folder / "boxes.json")


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
@pytest.mark.parametrize("wrong", [{}, {"noise": 1.0, "disturbance": "moderate"}], ids=["right", "wrong"])
def test_a_world_of_cells_is_that_world_of_boxes(tmp_path: Path, wrong: dict[str, Any], dynamics: str) -> None:
    """Scans, clearances, contacts and ends, step by step, in both plants; and what sensors make of them."""
    both = [
        gymnasium.make_vec(
            "wayfield/OmniGoalObstacles-v0",
            64,
            vectorization_mode="vector_entry_point",
            scenario=file,
            num_beams=48,
            dynamics=dynamics,
            **wrong,
        )
        for file in _worlds(tmp_path)
    ]
    cells, boxes = (envs.reset(seed=1)[0] for envs in both)
    np.testing.assert_allclose(cells, boxes, atol=1e-5)
    both[0].action_space.seed(0)
    ends = 0
    for step in range(200):
        if step % 20 == 0:
            action = 0.9 * both[0].action_space.sample()
        one, other = (envs.step(action) for envs in both)
        np.testing.assert_allclose(one[0], other[0], atol=1e-5)
        np.testing.assert_array_equal(one[2], other[2])
        np.testing.assert_allclose(one[4]["clearance"], other[4]["clearance"], atol=1e-6)
        np.testing.assert_array_equal(one[4]["collision"], other[4]["collision"])
        ends += int(one[2].sum())
    assert ends > 5


def test_a_thing_is_pushed_against_a_wall_of_the_grid_and_stays_there(tmp_path: Path) -> None:
    (tmp_path / "room.map").write_text(
        "type octile\nheight 4\nwidth 12\nmap\n" + "........@...\n" * 4, encoding="utf-8"
    )
    scene = {
        "start": [1.0, 1.0, 0.0],
        "goal": [3.5, 1.5, 1.0],
        "map": {"file": "room.map", "resolution": 0.5},
        "obstacles": [{"kind": "box", "x": 2.0, "y": 1.0, "length": 0.4, "width": 0.4, "mass": 1.0}],
    }
    (tmp_path / "scene.json").write_text(json.dumps(scene), encoding="utf-8")
    env: Any = gymnasium.make(
        "wayfield/DiffDriveGoalObstacles-v0",
        scenario=str(tmp_path / "scene.json"),
        dynamics="pymunk",
        end_on_contact=False,
    ).unwrapped
    env.reset(seed=0)
    copied = None
    for step in range(200):
        env.step(np.array([0.4, 0.0]))
        if step == 120:
            copied = pickle.loads(pickle.dumps(env))
    pushed = env.batch.obstacles[0, 0]
    # between the wall at 4 m and the hull
    assert 3.7 < pushed["x"] < 3.8 + 2e-3
    assert env.batch.states["x"][0] < 4.0 - 0.4 - 0.25 + 5e-3
    assert copied is not None
    for _ in range(79):
        copied.step(np.array([0.4, 0.0]))
    assert copied.batch.obstacles[0, 0]["x"] == pushed["x"]


def test_what_is_no_grid_is_refused() -> None:
    free = np.zeros((3, 4), np.bool_)
    for wrong, values in (
        ("occupied", {"occupied": np.zeros((3, 4))}),
        ("at least one", {"occupied": np.zeros((0, 4), np.bool_)}),
        ("at most", {"occupied": np.zeros((1, MOST_SIDE + 1), np.bool_)}),
        ("resolution", {"resolution": math.nan}),
        ("origin", {"origin": (0.0, 0.0)}),
        ("beyond", {"beyond": "walls"}),
    ):
        with pytest.raises(ValueError, match=wrong):
            OccupancyGrid(**({"occupied": free, "resolution": 0.1} | values))


def test_obstacles_stand_on_top_of_a_grid() -> None:
    occupied = np.zeros((20, 20), np.bool_)
    grid = OccupancyGrid(occupied, 0.5)
    scenario = wayfield.envs.scenarios.GoalScenario(
        "room", (8.0, 5.0, 0.0), start=(2.0, 5.0, 0.0), grid=grid, obstacles=obstacle_field(box(5.0, 5.0, 1.0, 1.0))
    )
    assert scenario.obstacles.dtype == OBSTACLE
    wayfield.envs.scenarios.check_clear(scenario, 0.25)
    blocked = occupied.copy()
    blocked[10, 16] = True
    with pytest.raises(ValueError, match="goal"):
        wayfield.envs.scenarios.check_clear(dataclasses.replace(scenario, grid=OccupancyGrid(blocked, 0.5)), 0.25)
