"""Hulls that are rectangles: their distance from what stands around, against formulas of another kind, and contact."""

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.hulls import boxes_clearance, clearance_of, grid_rectangle_distance, rectangle_distance
from wayfield.envs.scenarios import box, circle, wall
from wayfield.envs.world.geometry import clearance_to
from wayfield.envs.world.grids import NO_GRIDS, OccupancyGrid, lay_grids
from wayfield.system.elementary import sin_cos

JACKAL = ROBOTS["jackal"]
HALVES = (0.254, 0.215)  # m
OFF = 0.11  # m, from the pose to the middle of a hull
AHEAD, BEHIND = (dataclasses.replace(JACKAL, name=f"off{x}", hull_x=x) for x in (OFF, -OFF))
PLACE, ANGLE, SIZE = st.floats(-3.0, 3.0), st.floats(-7.0, 7.0), st.floats(0.05, 2.0)
SHAPES = st.one_of(
    st.builds(circle, PLACE, PLACE, SIZE),
    st.builds(box, PLACE, PLACE, SIZE, SIZE, ANGLE),
    st.builds(lambda x, y, angle, length: wall(x, y, x + length * math.cos(angle), y + length * math.sin(angle)),
              PLACE, PLACE, ANGLE, SIZE),
)  # fmt: skip
POSES = st.tuples(PLACE, PLACE, ANGLE)


def distance(obstacle: Any, pose: tuple[float, float, float]) -> float:
    sine, cosine = sin_cos(pose[2])
    return float(rectangle_distance(obstacle, pose[0], pose[1], cosine, sine, *HALVES))


def outline(x: float, y: float, angle: float, half_length: float, half_width: float) -> np.ndarray:
    """Returns the corners (4, 2) of a rectangle."""
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return np.array([[x, y] + a * half_length * along + b * half_width * across for a, b in signs])


def to_segment(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    way = b - a
    share = np.clip((point - a) @ way / max(way @ way, 1e-300), 0.0, 1.0)
    return float(np.linalg.norm(point - a - share * way))


def between(one: np.ndarray, other: np.ndarray) -> float:
    """Returns the distance of two outlines that do not cross: from the corners of one to the sides of the other."""
    sides = [(each[k], each[(k + 1) % 4]) for each in (one, other) for k in range(4)]
    return min(to_segment(point, *side) for j, point in enumerate(np.vstack([one, other]))
               for side in (sides[4:] if j < 4 else sides[:4]))  # fmt: skip


def overlap(one: np.ndarray, other: np.ndarray) -> bool:
    """Returns whether two rectangles overlap: one is clipped by the sides of the other, and something is left."""
    left = [tuple(point) for point in one]
    for k in range(4):
        (ax, ay), (bx, by) = other[k], other[(k + 1) % 4]
        inside = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in left]
        kept: list[tuple[float, float]] = []
        for (p, at_p), (q, at_q) in itertools.pairwise([*zip(left, inside, strict=True), (left[0], inside[0])]):
            if at_p >= 0.0:
                kept.append(p)
            if at_p * at_q < 0.0:
                share = at_p / (at_p - at_q)
                kept.append((p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])))
        left = kept
        if not left:
            return False
    return True


@given(SHAPES, POSES)
def test_the_distance_is_that_of_outlines(obstacle: Any, pose: tuple[float, float, float]) -> None:
    found = distance(obstacle, pose)
    mine = outline(*pose, *HALVES)
    if obstacle["half_length"] == 0.0:
        middle = np.array([obstacle["x"], obstacle["y"]])
        apart = min(to_segment(middle, mine[k], mine[(k + 1) % 4]) for k in range(4))
        within = boxes_clearance(np.array([circle(*middle.tolist(), 1e-9)]), 1, pose, *HALVES) < 0.0
        assert found == pytest.approx((-apart if within else apart) - obstacle["radius"], abs=1e-9)
        return
    theirs = outline(
        *(obstacle[name].item() for name in ("x", "y")),
        math.atan2(obstacle["sin"], obstacle["cos"]),
        *(obstacle[name].item() for name in ("half_length", "half_width")),
    )
    if found > 0.0:
        assert found == pytest.approx(between(mine, theirs), abs=1e-9)
    elif found < -1e-9 and obstacle["half_width"] > 0.0:
        assert overlap(mine, theirs)
        # moved apart by that much along some side's normal they only touch, and nowhere by less
        normals = [(math.cos(a), math.sin(a)) for turn in (pose[2], math.atan2(obstacle["sin"], obstacle["cos"]))
                   for a in (turn, turn + math.pi / 2, turn + math.pi, turn - math.pi / 2)]  # fmt: skip
        apart = [not overlap(mine - found * np.array(each) * (1.0 + 1e-6), theirs) for each in normals]
        assert any(apart)
        assert all(overlap(mine - found * np.array(each) * (1.0 - 1e-6), theirs) for each in normals)


@given(SHAPES, POSES, POSES)
def test_the_distance_moves_with_both_and_a_disc_bounds_it(
    obstacle: Any, pose: tuple[float, float, float], shift: tuple[float, float, float]
) -> None:
    dx, dy, turn = shift
    moved = obstacle.copy()
    c, s = math.cos(turn), math.sin(turn)
    moved["x"], moved["y"] = dx + c * obstacle["x"] - s * obstacle["y"], dy + s * obstacle["x"] + c * obstacle["y"]
    moved["cos"] = c * obstacle["cos"] - s * obstacle["sin"]
    moved["sin"] = s * obstacle["cos"] + c * obstacle["sin"]
    there = (dx + c * pose[0] - s * pose[1], dy + s * pose[0] + c * pose[1], pose[2] + turn)
    found = distance(obstacle, pose)
    assert distance(moved, there) == pytest.approx(found, abs=1e-9)
    middle = clearance_to(obstacle, pose[0], pose[1])
    assert middle - JACKAL.hull_radius <= found + 1e-9
    if found > 0.0:
        assert found <= middle - JACKAL.least_half + 1e-9


def test_a_grid_is_its_cells() -> None:
    rng = np.random.default_rng(3)
    for beyond, share in (("free", 0.02), ("free", 0.15), ("occupied", 0.05)):
        occupied = rng.random((25, 35)) < share
        grid = OccupancyGrid(occupied, 0.1, (-1.5, -1.0, 0.4), beyond)
        grids = lay_grids([grid], np.zeros(1, NO_GRIDS.frames.dtype))
        places = grid.points(np.argwhere(occupied)[:, ::-1] + 0.5).tolist()
        around = [(-50.5, 12.5), (85.5, 12.5)], [(17.5, -50.0), (17.5, 75.0)]
        cells = [box(x, y, 0.1, 0.1, 0.4) for x, y in places]
        if beyond == "occupied":
            for (ax, ay), (bx, by) in around:
                for x, y in grid.points(np.array([(ax, ay), (bx, by)])).tolist():
                    wide = ay == by
                    cells.append(box(x, y, *((10.1, 40.0) if wide else (40.0, 10.0)), 0.4))
        field = np.array(cells)
        for _ in range(1000):
            pose = (rng.uniform(-2, 3), rng.uniform(-2, 3), rng.uniform(-4, 4))
            sine, cosine = sin_cos(pose[2])
            found = grid_rectangle_distance(grids.frames[0], grids.cells, (*pose[:2], cosine, sine), *HALVES)
            expected = boxes_clearance(field, len(field), pose, *HALVES)
            if expected > 0.0:
                assert found == pytest.approx(expected, abs=1e-9)
            else:
                assert found <= 1e-12


def world(folder: Path, **fields: Any) -> str:
    file = folder / "scene.json"
    file.write_text(json.dumps({"goal": [9, 0, 0], "heading_tolerance": 3} | fields), encoding="utf-8")
    return str(file)


def jackal(scenario: str, dynamics: str = "kinematic", robot: Any = "jackal") -> Any:
    return gymnasium.make(
        "wayfield/DiffDriveGoalObstacles-v0", robot=robot, scenario=scenario, dynamics=dynamics, num_beams=8
    )


# the walls leave a way of 0.48 m, wider than the hull (0.43 m), narrower than it is across (0.666 m)
LANE = [{"kind": "wall", "x1": 1, "y1": y, "x2": 6, "y2": y} for y in (-0.24, 0.24)]


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_it_drives_through_a_lane_that_is_too_narrow_to_turn_in(dynamics: str, tmp_path: Path) -> None:
    env = jackal(world(tmp_path, obstacles=LANE), dynamics)
    env.reset(seed=0)
    for _ in range(70):
        _, _, terminated, _, info = env.step(np.array([1.0, 0.0], np.float32))
        assert not terminated
    x = float(env.unwrapped.batch.states["x"][0])
    assert 3.0 < x < 4.0
    assert info["clearance"] == pytest.approx(0.24 - 0.215, abs=1e-9)  # the side, not a disc
    for _ in range(40):
        _, _, terminated, _, info = env.step(np.array([0.0, 0.5], np.float32))
        if terminated:
            break
    assert info["collision"]
    # the corner touches where a half diagonal at that angle reaches the wall
    turned = float(env.unwrapped.batch.states["heading"][0])
    reach = 0.254 * math.sin(turned) + 0.215 * math.cos(turned)
    assert reach == pytest.approx(0.24, abs=1e-6 if dynamics == "kinematic" else 3e-3)


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_it_is_never_inside_of_anything(dynamics: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    shapes = [
        *({"kind": "circle", "x": x, "y": y, "radius": 0.15} for x in (1.1, 2.4) for y in (-0.8, 0.1, 0.9)),
        {"kind": "box", "x": 1.7, "y": 1.3, "length": 0.8, "width": 0.2, "heading": 0.6},
        *({"kind": "wall", "x1": -1, "y1": y, "x2": 4, "y2": y} for y in (-1.6, 1.9)),
        *({"kind": "wall", "x1": x, "y1": -1.6, "x2": x, "y2": 1.9} for x in (-1, 4)),
    ]
    env = jackal(world(tmp_path, obstacles=shapes, goal=[3.3, 0, 0], start=[0, 0, 0]), dynamics)
    touched = 0
    for seed in range(40):
        env.reset(seed=seed)
        for k in range(120):
            if k % 15 == 0:
                action = rng.uniform([-2.0, -3.0], [2.0, 3.0])
            _, _, terminated, truncated, info = env.step(action.astype(np.float32))
            state = env.unwrapped.batch.states[0]
            pose = tuple(float(state[name]) for name in ("x", "y", "heading"))
            field = env.unwrapped.batch.obstacles[0]
            assert info["clearance"] == pytest.approx(clearance_of(JACKAL, field, len(field), pose), abs=1e-9)
            assert info["clearance"] >= (0.0 if dynamics == "kinematic" else -0.015)
            if terminated or truncated:
                touched += bool(info["collision"])
                break
    assert touched > 20


@pytest.mark.parametrize("robot", ["jackal", "p3dx"])
@pytest.mark.parametrize("mapped", [False, True])
def test_whatever_it_drives_into_it_comes_no_deeper_than_contact_needs(
    mapped: bool, robot: str, tmp_path: Path
) -> None:
    """A wall, or the same one of a map; a hundredth of a second at full speed would be 2 cm."""
    around: dict[str, Any] = {"obstacles": [{"kind": "wall", "x1": 1.5, "y1": -2.0, "x2": 1.5, "y2": 2.0}]}
    if mapped:
        room = np.zeros((20, 20), np.bool_)
        room[:, 17] = True
        np.save(tmp_path / "room.npy", room)
        around = {"map": {"file": "room.npy", "resolution": 0.2, "origin": [-1.9, -2.0, 0.0], "unknown": "free"}}
    file = world(tmp_path, start=[0, 0, 0], goal=[-1.0, 0, 0], **around)
    env: Any = gymnasium.make_vec(
        "wayfield/DiffDriveGoalObstacles-v0", 12, robot=robot, scenario=file, dynamics="pymunk", num_beams=8
    )
    env.reset(seed=0)
    speeds, met = np.linspace(0.4, 2.0, 12), np.zeros(12, np.bool_)
    for _ in range(80):
        *_, info = env.step(np.column_stack([speeds, np.zeros(12)]).astype(np.float32))
        hit = info["collision"]
        assert (np.abs(info["clearance"][hit]) < 1e-3).all()
        met |= hit
    assert met.all()


def test_a_shove_does_not_turn_it_into_a_wall(tmp_path: Path) -> None:
    env: Any = gymnasium.make(
        "wayfield/DiffDriveGoalObstacles-v0",
        robot="jackal",
        num_beams=0,
        shove=(2.5, 0.0, 0.0, 1.5),
        scenario=world(tmp_path, obstacles=LANE),
    )
    env.reset(seed=0)
    for _ in range(60):
        _, _, terminated, _, info = env.step(np.array([1.0, 0.0], np.float32))
        if terminated:
            break
    state = env.unwrapped.batch.states[0]
    assert info["collision"]
    assert info["time"] == pytest.approx(2.55)
    assert state["heading"] == 0.0
    assert info["clearance"] > 0.0


def cleared(robot: Any, poses: np.ndarray, scenario: str) -> np.ndarray:
    """Returns the clearances that a batch of robots has at poses (n, 3), once none of them has moved for a period."""
    env: Any = gymnasium.make_vec(
        "wayfield/DiffDriveGoalObstacles-v0", len(poses), robot=robot, scenario=scenario, num_beams=0
    )
    env.reset(seed=0)
    states = env.batch.states
    states["x"], states["y"], states["heading"] = poses.T
    states["clearance"] = np.inf
    *_, info = env.step(np.zeros((len(poses), 2), np.float32))
    return np.array(info["clearance"])


@pytest.mark.parametrize("mapped", [False, True])
def test_a_hull_off_the_axle_is_one_about_its_own_middle(mapped: bool, tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    shapes: list[dict[str, Any]] = []
    for x, y, size in zip(*rng.uniform(-8.0, 8.0, (2, 60)), rng.uniform(0.1, 0.5, 60), strict=True):
        if math.hypot(x, y) > 1.5:
            shapes.append({"kind": "box", "x": x, "y": y, "heading": 5.0 * size, "length": size, "width": 0.2})
            shapes.append({"kind": "circle", "x": y, "y": x, "radius": 0.5 * size})
    around: dict[str, Any] = {"obstacles": shapes, "goal": [0.5, 0, 0]}
    if mapped:
        room = rng.random((80, 80)) < 0.02
        room[33:47, 33:47] = False
        np.save(tmp_path / "room.npy", room)
        around["map"] = {"file": "room.npy", "resolution": 0.2, "origin": [-8.0, -8.0, 0.0], "unknown": "free"}
    file = world(tmp_path, **around)
    poses = rng.uniform((-8.0, -8.0, -3.1), (8.0, 8.0, 3.1), (400, 3))
    ways = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2]), np.zeros(len(poses))])
    found = cleared(AHEAD, poses, file)
    assert (found < 0.0).sum() > 20
    np.testing.assert_allclose(found, cleared(JACKAL, poses + OFF * ways, file), rtol=0.0, atol=1e-9)
    # driven backwards the other end is ahead
    turned = poses.copy()
    turned[:, 2] += np.where(turned[:, 2] > 0.0, -math.pi, math.pi)
    np.testing.assert_allclose(found, cleared(BEHIND, turned, file), rtol=0.0, atol=1e-9)
    if not mapped:
        env = jackal(file, robot=AHEAD).unwrapped
        field = env.batch.obstacles[0]
        alone = [clearance_of(AHEAD, field, len(shapes), pose) for pose in poses.tolist()]
        np.testing.assert_allclose(found, alone, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_turning_on_the_spot_it_touches_with_its_longer_end_alone(dynamics: str, tmp_path: Path) -> None:
    longer, shorter = (math.hypot(HALVES[0] + off, HALVES[1]) for off in (OFF, -OFF))
    assert pytest.approx(longer, abs=1e-12) == AHEAD.hull_radius == BEHIND.hull_radius
    disc = {"kind": "circle", "x": 3.0, "y": 0.5 * (longer + shorter) + 0.05, "radius": 0.05}
    file = world(tmp_path, obstacles=[disc])
    headings = []
    for robot, way in ((AHEAD, 1.0), (BEHIND, -1.0), (AHEAD, -1.0)):
        env = jackal(file, dynamics, robot).unwrapped
        env.reset(seed=0)
        state, field = env.batch.states[0], env.batch.obstacles[0]
        state["x"], state["clearance"], collision = 3.0, clearance_of(robot, field, 1, (3.0, 0.0, 0.0)), False
        while abs(state["heading"]) < 2.5 and not collision:
            _, _, _, _, info = env.step(np.array([0.0, 0.5 * way], np.float32))
            collision = bool(info["collision"])
        assert collision == (len(headings) < 2)  # its shorter end goes by
        headings.append(float(state["heading"]))
        if collision:
            pose = tuple(float(state[name]) for name in ("x", "y", "heading"))
            assert clearance_of(robot, field, 1, pose) == pytest.approx(0.0, abs=3e-3)
    assert 0.0 < headings[0] < 0.5 * math.pi
    assert headings[0] == pytest.approx(-headings[1], abs=1e-6 if dynamics == "kinematic" else 1e-2)


def test_a_wall_of_a_map_is_seen_beside_a_long_hull_to_the_end_of_the_range(tmp_path: Path) -> None:
    room = np.zeros((200, 200), np.bool_)
    room[148] = True  # from y = 4.8 m on, of a range of 5 m
    np.save(tmp_path / "room.npy", room)
    file = world(tmp_path, map={"file": "room.npy", "resolution": 0.1, "origin": [-10, -10, 0], "unknown": "free"})
    seen = []
    for robot in ("p3dx", "mir100"):
        env: Any = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", robot=robot, scenario=file, num_beams=72)
        seen.append(env.unwrapped.task.layout.unpack(env.reset(seed=0)[0]).ranges)
    assert seen[0].min() == pytest.approx(4.8)
    np.testing.assert_array_equal(*seen)
