"""Rays end on the surfaces that clearance measures to; odometry and noise are what they say."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS, records
from wayfield.envs.robots.sensing import ROOM, Lidar, beam_angles, scan_ranges
from wayfield.envs.scenarios import box, circle, obstacle_field, wall
from wayfield.envs.world.blocks import blocks_clearance, in_blocks
from wayfield.envs.world.geometry import clearance

GOAL_ID = "wayfield/OmniGoalObstacles-v0"
PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
IDS = {"p3dx": PATH_ID, "omni3": GOAL_ID, "omni4": GOAL_ID}
FULL = 2.0 * math.pi

COORDINATES = st.floats(-4.0, 4.0).map(lambda value: round(value, 6))
SIZES = st.floats(0.05, 2.0)
OBSTACLES = st.one_of(
    st.builds(circle, COORDINATES, COORDINATES, SIZES),
    st.builds(box, COORDINATES, COORDINATES, SIZES, SIZES, st.floats(-4.0, 4.0)),
    st.builds(wall, COORDINATES, COORDINATES, st.floats(4.5, 6.0), COORDINATES),
)
FIELDS_OF_VIEW = st.one_of(st.just(FULL), st.floats(0.1, FULL), st.sampled_from([math.pi, 6.25, 6.28]))


def scan(
    field: NDArray[np.void], pose: tuple[float, float, float], num_beams: int, field_of_view: float, max_range: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the directions (world frame) and the ranges of a scan."""
    angles = beam_angles(num_beams, field_of_view)
    ranges = np.full((1, num_beams), np.nan)
    lidar = Lidar(
        np.vstack([np.cos(angles), np.sin(angles)]),
        float(angles[0]),
        float(angles[1] - angles[0]) if num_beams > 1 else FULL,
        max_range,
        np.empty(ROOM),
        np.empty(0, np.float32),
        np.empty(0, np.uint64),
    )
    fields, blocks = in_blocks(field[None], np.array([len(field)]))
    scan_ranges(lidar, fields, 0, len(field), blocks[0], pose, ranges, 0, 0)
    return pose[2] + angles, ranges[0]


def first_hit(obstacle: np.void, x: float, y: float, angle: float, grown: float) -> float:
    """Returns the distance along a ray to an obstacle grown by some metres: edge by edge, not the code under test."""
    c, s = float(obstacle["cos"]), float(obstacle["sin"])
    offset = np.array([x - obstacle["x"], y - obstacle["y"]])
    p = np.array([c * offset[0] + s * offset[1], c * offset[1] - s * offset[0]])
    u = np.array([math.cos(angle) * c + math.sin(angle) * s, math.sin(angle) * c - math.cos(angle) * s])
    if obstacle["radius"] > 0.0:
        radius = obstacle["radius"] + grown
        if np.hypot(*p) <= radius:
            return 0.0
        roots = np.roots([1.0, 2.0 * p @ u, p @ p - radius**2])
        real = roots.real[(np.abs(roots.imag) == 0.0) & (roots.real >= 0.0)]
        return float(real.min(initial=math.inf))
    a, b = obstacle["half_length"] + grown, max(obstacle["half_width"] + grown, 0.0)
    if abs(p[0]) <= a and abs(p[1]) <= b:
        return 0.0
    nearest = math.inf
    corners = np.array([[a, b], [-a, b], [-a, -b], [a, -b]])
    for q, r in itertools.pairwise([*corners, corners[0]]):
        side = r - q
        determinant = u[1] * side[0] - u[0] * side[1]
        if abs(determinant) > 1e-100:
            d = q - p
            t = (d[1] * side[0] - d[0] * side[1]) / determinant
            k = (u[0] * d[1] - u[1] * d[0]) / determinant
            if t >= 0.0 and 0.0 <= k <= 1.0:
                nearest = min(nearest, t)
    return nearest


@given(
    st.lists(OBSTACLES, max_size=5),
    COORDINATES,
    COORDINATES,
    st.floats(-3.14, 3.14),
    st.integers(1, 40),
    FIELDS_OF_VIEW,
    st.floats(0.5, 9.0),
)
def test_rays_end_on_the_first_surface(
    obstacles: list[np.void],
    x: float,
    y: float,
    heading: float,
    num_beams: int,
    field_of_view: float,
    max_range: float,
) -> None:
    field = obstacle_field(*obstacles)
    # on a surface, rounding decides what is ahead
    assume(abs(clearance(field, len(field), x, y)) > 1e-9)
    directions, ranges = scan(field, (x, y, heading), num_beams, field_of_view, max_range)
    assert (ranges >= 0.0).all()
    assert (ranges <= max_range).all()
    blur = 1e-9
    for angle, distance in zip(directions, ranges, strict=True):
        if distance < max_range:
            gap = clearance(field, len(field), x + distance * math.cos(angle), y + distance * math.sin(angle))
            assert gap == pytest.approx(0.0, abs=1e-9) if distance > 0.0 else gap <= 1e-9
        # a grazing ray hits or misses by rounding: between obstacles a nanometre larger and smaller it has to lie
        near = min((first_hit(o, x, y, angle, blur) for o in field), default=math.inf)
        far = min((first_hit(o, x, y, angle, -blur) for o in field), default=math.inf)
        assert min(near, max_range) - 1e-8 <= distance <= min(far, max_range) + 1e-8


@given(st.integers(0, 2**32 - 1), st.floats(-3.14, 3.14))
def test_of_many_obstacles_in_blocks_the_nearest_is_met_as_of_few(seed: int, heading: float) -> None:
    rng = np.random.default_rng(seed)
    many = obstacle_field(*(circle(*rng.uniform(-9.0, 9.0, 2), rng.uniform(0.05, 0.4)) for _ in range(300)))
    pose = 0.0, 0.0, heading
    few = [scan(many[k : k + 100], pose, 40, FULL, 8.0)[1] for k in (0, 100, 200)]
    np.testing.assert_allclose(scan(many, pose, 40, FULL, 8.0)[1], np.minimum.reduce(few), atol=1e-12)
    placed, blocks = in_blocks(many[None], np.array([300]))
    assert blocks[0] > 0
    assert blocks_clearance(placed, 0, 300, blocks[0], 0.0, 0.0) == pytest.approx(clearance(many, 300, 0.0, 0.0))


@given(st.integers(2, 720), st.floats(0.1, 6.2))
def test_beams_are_even_and_symmetric(num_beams: int, field_of_view: float) -> None:
    angles = beam_angles(num_beams, field_of_view)
    np.testing.assert_allclose(angles, -angles[::-1], atol=1e-9)
    np.testing.assert_allclose(np.diff(angles), field_of_view / (num_beams - 1), atol=1e-9)
    around = beam_angles(num_beams, FULL)
    assert around[0] == -math.pi
    np.testing.assert_allclose(np.diff(around), FULL / num_beams, atol=1e-9)
    assert around[-1] + FULL / num_beams == pytest.approx(math.pi)


# Through the environments.


def room(folder: Path, *obstacles: dict[str, Any], **fields: Any) -> str:
    file = folder / "room.json"
    file.write_text(json.dumps({"goal": [90.0, 90.0, 0.0], "obstacles": obstacles, **fields}))
    return str(file)


def test_the_scan_of_a_robot_in_a_walled_square(tmp_path: Path) -> None:
    corners = [(-2.0, -1.0), (3.0, -1.0), (3.0, 2.0), (-2.0, 2.0), (-2.0, -1.0)]
    walls = [{"kind": "wall", "x1": a, "y1": b, "x2": c, "y2": d} for (a, b), (c, d) in itertools.pairwise(corners)]
    env: Any = gymnasium.make(GOAL_ID, scenario=room(tmp_path, *walls), num_beams=4, max_range=9.0).unwrapped
    observation, _ = env.reset(seed=0)
    # straight behind, to the right, ahead, to the left
    assert env.task.layout.unpack(observation[None]).ranges[0] == pytest.approx([2.0, 1.0, 3.0, 2.0])
    env = gymnasium.make(GOAL_ID, scenario=room(tmp_path, *walls), num_beams=3, field_of_view=math.pi).unwrapped
    observation, _ = env.reset(seed=0)
    assert env.task.layout.unpack(observation[None]).ranges[0] == pytest.approx([1.0, 3.0, 2.0])


@pytest.mark.parametrize("num_beams", [0, 1, 2, 720])
def test_any_number_of_beams(tmp_path: Path, num_beams: int) -> None:
    ahead = {"kind": "box", "x": 2.0, "y": 0.0, "length": 1.0, "width": 1.0}
    env: Any = gymnasium.make(GOAL_ID, scenario=room(tmp_path, ahead), num_beams=num_beams, field_of_view=1.0)
    env = env.unwrapped
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    (ranges,) = env.task.layout.unpack(observation[None]).ranges
    assert ranges.shape == (num_beams,)
    if num_beams % 2:
        assert ranges[num_beams // 2] == pytest.approx(1.5)


def drive(env: Any, actions: NDArray[np.float64]) -> NDArray[np.void]:
    """Returns the state record after each step, (t,)."""
    state = env.batch.states[0]
    states = []
    for action in actions:
        env.step(action)
        states.append(state.copy())
    return np.array(states)


def wandering(robot: str, steps: int, seed: int = 0) -> NDArray[np.float64]:
    most = ROBOTS[robot].max_twist
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, len(most))) * np.minimum(most, 2.0)


def make(robot: str, folder: Path, **kwargs: Any) -> Any:
    if robot == "p3dx":
        file = folder / "line.csv"
        file.write_text("-90,0\n90,0\n")
        kwargs["scenario"] = str(file)
    else:
        kwargs["scenario"] = room(folder)
    env: Any = gymnasium.make(IDS[robot], robot=robot, **kwargs).unwrapped
    env.reset(seed=1)
    return env


@pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4"])
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
def test_odometry_without_noise_is_the_truth(tmp_path: Path, robot: str, actuators: str) -> None:
    env = make(robot, tmp_path, actuators=actuators, pose_source="odometry")
    states = drive(env, wandering(robot, 300))
    for name in ("x", "y"):
        np.testing.assert_allclose(states[f"measured_{name}"], states[name], atol=1e-9)
    turn = states["measured_heading"] - states["heading"]
    np.testing.assert_allclose(np.sin(turn / 2.0), 0.0, atol=1e-9)
    for name in ("vx", "vy", "yaw_rate"):
        np.testing.assert_allclose(states[f"measured_{name}"], states[name], atol=1e-9)
    assert np.ptp(states["x"]) > 0.2


@pytest.mark.parametrize("yaw_rate", [0.5, -1.0])
def test_two_encoders_without_the_rotation_term_drift(tmp_path: Path, yaw_rate: float) -> None:
    drift = {}
    for source in ("odometry", "odometry_uncorrected"):
        env = make("omni3", tmp_path, pose_source=source)
        spin = np.tile([0.0, 0.0, yaw_rate * math.pi / 3.0], (round(60 / abs(yaw_rate)), 1))
        state = drive(env, spin)[-1]
        assert abs(state["heading"]) == pytest.approx(math.pi)
        drift[source] = math.hypot(state["measured_x"] - state["x"], state["measured_y"] - state["y"])
        assert abs(state["measured_heading"]) == pytest.approx(math.pi)
    # two readings l w off along -45 and -135 degrees: a speed of sqrt(2) l w, turned by half a circle
    assert drift["odometry_uncorrected"] == pytest.approx(2.0 * math.sqrt(2.0) * 0.1)
    assert drift["odometry_uncorrected"] == pytest.approx(0.283, abs=5e-4)
    assert drift["odometry"] < 1e-12


# Noise.


def within(sample: NDArray[np.float64], deviation: float) -> None:
    """Asserts a normal sample's mean and standard deviation at five standard errors."""
    n = sample.size
    assert abs(sample.mean()) < 5.0 * deviation / math.sqrt(n)
    assert sample.std() == pytest.approx(deviation, rel=5.0 / math.sqrt(2.0 * n))


@pytest.mark.parametrize("noise", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_pose_noise_has_the_stated_deviation(tmp_path: Path, robot: str, noise: float) -> None:
    states = drive(make(robot, tmp_path, noise=noise), wandering(robot, 1500))
    for name, deviation in (("x", records.POSITION_NOISE), ("y", records.POSITION_NOISE)):
        within(states[f"measured_{name}"] - states[name], noise * deviation)
    turn = states["measured_heading"] - states["heading"]
    within(np.arctan2(np.sin(turn), np.cos(turn)), noise * records.HEADING_NOISE)
    # the state itself is not disturbed
    truth = drive(make(robot, tmp_path), wandering(robot, 1500))
    assert truth[["x", "y", "heading"]].tolist() == states[["x", "y", "heading"]].tolist()


@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_encoder_noise_is_relative(tmp_path: Path, noise: float) -> None:
    env = make("p3dx", tmp_path, noise=noise, pose_source="odometry")
    twist = np.array([0.3, 0.4])
    states = drive(env, np.tile(twist, (2000, 1)))
    right, left = ROBOTS["p3dx"].wheel_speeds_from_twist(twist)
    measured = np.column_stack([states["measured_vx"], states["measured_yaw_rate"]])
    rates = ROBOTS["p3dx"].wheel_speeds_from_twist(measured)
    within(rates[:, 0] - right, noise * records.ENCODER_NOISE * right)
    within(rates[:, 1] - left, noise * records.ENCODER_NOISE * left)
    # each wheel has an error of its own
    assert abs(np.corrcoef(rates.T)[0, 1]) < 5.0 / math.sqrt(2000)
    standing = drive(make("p3dx", tmp_path, noise=noise, pose_source="odometry"), np.zeros((50, 2)))
    assert not standing["measured_vx"].any()


def test_odometry_drifts_as_the_noise_of_its_wheels(tmp_path: Path) -> None:
    steps, speed = 100, 0.5
    ends = []
    for seed in range(60):
        env = make("p3dx", tmp_path, noise=1.0, pose_source="odometry")
        env.reset(seed=seed)
        state = drive(env, np.tile([speed, 0.0], (steps, 1)))[-1]
        ends.append(state["odometry_heading"])
        assert state["measured_x"] == state["odometry_x"]
    # the difference of two independent wheels over the track, a random walk of `steps` steps
    step = math.sqrt(2.0) * records.ENCODER_NOISE * speed * 0.05 / 0.381
    within(np.array(ends), step * math.sqrt(steps))


def test_range_noise_disturbs_hits_only(tmp_path: Path) -> None:
    wall_ahead = {"kind": "wall", "x1": 2.0, "y1": -9.0, "x2": 2.0, "y2": 9.0}
    env: Any = gymnasium.make(GOAL_ID, scenario=room(tmp_path, wall_ahead), noise=1.0, num_beams=2, max_range=4.0)
    env = env.unwrapped
    env.reset(seed=0)
    scans = np.array([env.step(np.zeros(3))[0][-2:] for _ in range(1500)], np.float64)
    assert (scans[:, 0] == 4.0).all()
    within(scans[:, 1] - 2.0, records.RANGE_NOISE)
    assert env.observation_space.contains(env.step(np.zeros(3))[0])


@given(st.integers(2, 16), st.floats(math.pi, FULL), st.floats(-3.0, 3.0), st.floats(0.2, 2.0))
def test_a_wall_behind_is_seen_from_both_ends_of_the_scan(
    num_beams: int, field_of_view: float, heading: float, distance: float
) -> None:
    c, s = math.cos(heading), math.sin(heading)
    ends = [(-distance * c - k * s, -distance * s + k * c) for k in (-4.0, 4.0)]
    behind = wall(*ends[0], *ends[1])
    directions, ranges = scan(obstacle_field(behind), (0.0, 0.0, heading), num_beams, field_of_view, 3.0)
    wanted = [min(first_hit(behind, 0.0, 0.0, angle, 0.0), 3.0) for angle in directions]
    np.testing.assert_allclose(ranges, wanted, atol=1e-9)
