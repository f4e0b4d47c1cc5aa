"""The policies that pursue a point or a pose of the path ahead: where they look, how they steer, where they stop."""

import json
import math
from pathlib import Path as File
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs import goal_reaching, path_following
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.scenarios.curves import circle_path
from wayfield.envs.tasks.briefing import Briefing, Course
from wayfield.envs.world.paths import Path, PathPool
from wayfield.policies.parts.carrot import place_on_lap, point_at_distance, pose_ahead
from wayfield.policies.parts.policy import Policy
from wayfield.policies.paths.pure_pursuit import PurePursuit
from wayfield.policies.paths.regulated_pure_pursuit import RegulatedPurePursuit
from wayfield.policies.pilot import Pilot
from wayfield.policies.poses.smooth_pose import SmoothPose, smooth_curvature

Array = NDArray[np.float64]

PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
OMNI_PATH_ID = "wayfield/OmniPathFollowing-v0"
GOAL_ID = "wayfield/DiffDriveGoalObstacles-v0"
POLICIES: list[Any] = [PurePursuit, RegulatedPurePursuit, SmoothPose]
every_policy = pytest.mark.parametrize("kind", POLICIES, ids=[kind.__name__ for kind in POLICIES])

coordinates = st.floats(-3.0, 3.0).map(lambda x: round(x, 2))
polylines = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=8, unique=True)
angles = st.floats(-3.1, 3.1)
distances = st.floats(0.05, 5.0)


def told(num_envs: int, actuators: str = "ideal", paths: list[Path] | None = None) -> Briefing:
    """Returns the briefing of robots that are all on the first path."""
    kind: Any = path_following.Observation if paths else goal_reaching.Observation
    layout = kind.layout(2, 0) if paths else kind.layout(2, 0, 5.0)
    return Briefing(
        num_envs=num_envs,
        robot=ROBOTS["p3dx"],
        actuators=ACTUATORS[actuators],
        dt=0.05,
        action_mode="twist",
        layout=layout,
        beam_angles=np.empty(0),
        max_range=0.0,
        path=Course.of(PathPool.of(paths), np.zeros(num_envs, np.int64)) if paths else None,
    )


def first_twist(policy: Any, path: Path, pose: tuple[float, float, float], s: float, actuators: str = "ideal") -> Any:
    """Returns v (m/s) and w (rad/s) of a robot at rest at a pose, whose projection has arc length s (m)."""
    briefing = told(1, actuators, [path])
    zero = np.zeros(1)
    seen = path_following.Observation(
        np.array([pose]), np.zeros((1, 2)), zero, zero, np.array([s]), np.zeros((1, 0, 2))
    )
    return policy.act(seen, briefing, policy.reset(briefing))[0].tolist()


def drive(policy: Policy, env_id: str, num_envs: int = 1, seed: int = 0, **options: Any) -> tuple[Any, Array, Any, Any]:
    """Returns the states (n + 1, b) and actions (n, b, a) up to the end of the last first episode, when each of those
    ended, and whether in success."""
    env: Any = gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point", **options)
    pilot = Pilot(policy, env)
    seen, _ = env.reset(seed=seed)
    pilot.reset()
    states, actions = [env.batch.states.copy()], []
    ended, succeeded = np.zeros(num_envs, np.int64), np.zeros(num_envs, bool)
    while not ended.all():
        actions.append(pilot.command(seen))
        seen, _, terminated, truncated, info = env.step(actions[-1])
        states.append(env.batch.states.copy())
        now = (terminated | truncated) & (ended == 0)
        ended[now] = len(actions)
        succeeded |= now & info["success"]
    return np.array(states), np.array(actions), ended, succeeded


# Where they look.


@given(polylines, st.booleans(), st.floats(0.1, 1.5), st.floats(0.0, 0.999), st.floats(-0.8, 0.8), angles)
def test_the_carrot_is_the_first_point_at_its_distance(
    corners: Any, closed: bool, distance: float, share: float, aside: float, bearing: float
) -> None:
    pool = PathPool.of([Path(corners, closed)])
    run = pool.runs[0]
    length = float(run["length"])
    along, segment = place_on_lap(pool.vertices, run, share * length)
    px, py, _ = pose_ahead(pool.vertices, run, along, segment, 0.0)
    x, y = px + aside * math.cos(bearing), py + aside * math.sin(bearing)
    window = length if closed else math.inf
    carrot = point_at_distance(pool.vertices, run, x, y, along, segment, distance, window)
    # the oracle: the path ahead in small steps, an open one straight on beyond its end
    ahead = np.linspace(0.0, length if closed else length + 4.0, 3000)
    points = np.array([pose_ahead(pool.vertices, run, along, segment, d)[:2] for d in ahead])
    away = np.hypot(points[:, 0] - x, points[:, 1] - y)
    assume(abs(away[0] - distance) > 1e-9)  # on the circle to begin with: inside for one rounding, outside for another
    outside = away >= distance
    step = ahead[1]
    if outside[0]:
        assert carrot == pytest.approx((px, py), abs=1e-9)
        return
    if not outside.any():
        return
    assert math.dist(carrot, (x, y)) == pytest.approx(distance, abs=1e-9)
    # not beyond the first sample outside; a path that only touches the circle may have left it between two
    k = int(outside.argmax())
    assert np.hypot(*(points[: k + 1] - carrot).T).min() <= step


@given(polylines, st.floats(0.0, 1.0), st.floats(0.0, 6.0))
def test_a_pose_ahead_lies_on_the_polyline_and_beyond_its_end_straight_on(
    corners: Any, share: float, distance: float
) -> None:
    path = Path(corners)
    pool = PathPool.of([path])
    run = pool.runs[0]
    along, segment = place_on_lap(pool.vertices, run, share * path.length)
    x, y, heading = pose_ahead(pool.vertices, run, along, segment, distance)
    s = along + distance
    vertices = path.vertices
    beyond = max(s - path.length, 0.0)
    last = vertices[-1]
    assert x == pytest.approx(np.interp(s, vertices["s"], vertices["x"]) + beyond * last["ux"], abs=1e-9)
    assert y == pytest.approx(np.interp(s, vertices["s"], vertices["y"]) + beyond * last["uy"], abs=1e-9)
    assert np.isclose(vertices["heading"], heading).any()


@given(st.floats(0.0, 40.0), st.floats(0.0, 20.0))
def test_a_pose_ahead_goes_round_a_closed_path(s: float, distance: float) -> None:
    """Laps on, or several laps at once: a small circle may be shorter than the way that is looked ahead."""
    pool = PathPool.of([circle_path(0.5)])
    run = pool.runs[0]
    x, y, _ = pose_ahead(pool.vertices, run, *place_on_lap(pool.vertices, run, s), distance)
    turn = 2.0 * math.pi * (s + distance) / run["length"]
    spacing = float(pool.vertices["s"][1])
    # between two vertices the polygon lies inside the circle by its sagitta
    assert math.dist((x, y), (0.5 * math.cos(turn), 0.5 * math.sin(turn))) <= 1.01 * spacing**2 / (8.0 * 0.5) + 1e-9


# Pure pursuit.


@given(st.floats(0.4, 3.0), st.floats(0.1, 0.7), st.integers(0, 500), st.booleans())
def test_pure_pursuit_on_a_circle_has_its_curvature(radius: float, share: float, index: int, clockwise: bool) -> None:
    lookahead = 2.0 * radius * share
    points = circle_path(radius).points[:: -1 if clockwise else 1]
    path = Path(points, closed=True)
    k = index % len(points)
    x, y = points[k]
    side = -1.0 if clockwise else 1.0
    tangent = math.atan2(y, x) + side * 0.5 * math.pi
    policy = PurePursuit(lookahead_distance=lookahead, window=2.0 * math.pi * radius)
    v, w = first_twist(policy, path, (x, y, tangent), float(path.vertices["s"][k]))
    assert v == policy.speed
    # the carrot lies within a chord's sagitta of the circle
    sagitta = float(path.vertices["s"][1]) ** 2 / (8.0 * radius)
    assert abs(w / v - side / radius) <= 2.0 * 1.01 * sagitta / lookahead**2 + 1e-9


# Everyone, on the road.


@every_policy
def test_a_crossing_leads_nobody_astray(kind: Any) -> None:
    states, _, _, _ = drive(kind(), PATH_ID, scenario="figure_eight", actuators="lagged")
    assert states["arc_length"][-1, 0] > 20.0
    assert np.abs(states["cross_track_error"]).max() < 0.05
    assert np.abs(states["heading_error"]).max() < 0.5


@every_policy
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
def test_everyone_finishes_paths_of_all_kinds_in_one_batch(kind: Any, actuators: str) -> None:
    states, _, _, succeeded = drive(kind(), PATH_ID, 32, scenario="random_splines", actuators=actuators)
    assert len(set(states["scenario"][0].tolist())) > 10
    assert succeeded.all()


@every_policy
@pytest.mark.parametrize("robot", ["omni3", "omni4"])
def test_an_omni_base_is_driven_as_a_unicycle(kind: Any, robot: str) -> None:
    _, actions, _, succeeded = drive(kind(), OMNI_PATH_ID, 8, robot=robot, actuators="lagged")
    assert succeeded.all()
    assert not actions[:, :, 1].any()


@every_policy
def test_at_the_end_of_a_path_robots_stand_still(kind: Any) -> None:
    path = Path([(0.0, 0.0), (4.0, 0.0)])
    assert first_twist(kind(), path, (4.0, 0.0, 0.0), 4.0, "lagged") == [0.0, 0.0]
    states, _, ended, succeeded = drive(kind(), PATH_ID, scenario="straight", actuators="lagged")
    assert succeeded.all()
    # 1 m/s^2 stops it in the 5 cm that are left, but for what it does not shed in the lag and a control period
    assert states["vx"][ended[0], 0] <= math.sqrt(2.0 * 1.0 * 0.05) + 1.0 * (0.1 + 0.05)


def test_a_lookahead_range_must_be_one() -> None:
    with pytest.raises(ValueError, match=r"max_lookahead must be .*>= min_lookahead = 0\.5, got 0\.4"):
        RegulatedPurePursuit(min_lookahead=0.5, max_lookahead=0.4)


# Regulated pure pursuit.


@given(st.floats(0.8, 3.1), st.booleans())
def test_regulated_pursuit_turns_on_the_spot_no_faster_than_it_can_stop(angle: float, left: bool) -> None:
    policy = RegulatedPurePursuit()
    side = 1.0 if left else -1.0
    v, w = first_twist(policy, Path([(0.0, 0.0), (5.0, 0.0)]), (1.0, 0.0, -side * angle), 1.0)
    assert v == 0.0
    most = min(policy.max_yaw_rate, math.sqrt(2.0 * policy.yaw_acceleration * angle))
    assert w == pytest.approx(side * most, rel=1e-9)


@given(st.floats(0.1, 2.0), st.floats(0.3, 2.5), st.integers(1, 150))
def test_regulated_pursuit_can_always_slow_down_before_a_corner(distance: float, turn: float, pieces: int) -> None:
    """At any distance before a corner, whether the legs have two points or many."""
    policy = RegulatedPurePursuit(deceleration=0.5)
    legs = np.linspace(0.0, 3.0, pieces + 1)
    corner = np.array([3.0, 0.0])
    onward = corner + legs[1:, None] * [math.cos(turn), math.sin(turn)]
    path = Path(np.vstack([np.column_stack([legs, np.zeros(pieces + 1)]), onward]))
    v, _ = first_twist(policy, path, (3.0 - distance, 0.0, 0.0), 3.0 - distance)
    curvature = turn / policy.bend_span
    slow = max(policy.speed * min(1.0, 1.0 / (policy.min_radius * curvature)), policy.min_speed)
    # the corner lies in a bend that begins `bend_span` before it; bends are looked for every 5 cm
    left = max(distance - policy.bend_span + 0.05, 0.0)
    assert v <= math.sqrt(slow**2 + 2.0 * policy.deceleration * left) + 1e-9
    if distance > policy.bend_span + policy.speed**2 / (2.0 * policy.deceleration):
        assert v == policy.speed


# The smooth pose law.


@given(distances, angles, angles, st.floats(0.5, 3.0), st.floats(1.0, 8.0))
def test_the_heading_falls_onto_the_approach_at_the_rate_k2(
    r: float, delta: float, phi: float, k1: float, k2: float
) -> None:
    """With v = 1, phi' = sin(delta)/r and delta' = w + sin(delta)/r, z = delta - atan(-k1 phi) obeys z' = -k2 z/r."""
    curvature = smooth_curvature(r, delta, phi, k1, k2)
    line_of_sight = math.sin(delta) / r
    z = delta - math.atan(-k1 * phi)
    rate = curvature + line_of_sight + k1 / (1.0 + (k1 * phi) ** 2) * line_of_sight
    assert rate == pytest.approx(-k2 * z / r, abs=1e-9 / r)


@given(st.floats(0.01, 0.5), st.floats(0.3, 3.0))
def test_on_an_arc_the_smooth_pose_law_has_its_curvature_to_fourth_order(half_turn: float, radius: float) -> None:
    r = 2.0 * radius * math.sin(half_turn)
    curvature = smooth_curvature(r, -half_turn, half_turn, 1.0, 3.0)
    assert abs(curvature * radius - 1.0) <= 0.5 * half_turn**4 + 1e-12


def test_the_smooth_pose_law_drives_at_waypoints_and_then_to_the_goal(tmp_path: File) -> None:
    file = tmp_path / "course.json"
    file.write_text(json.dumps({"waypoints": [[2, 1], [1, 3], [-1, 2]], "goal": [0, 0, 1.5], "waypoint_radius": 0.1}))
    *_, succeeded = drive(SmoothPose(), GOAL_ID, scenario=str(file), actuators="lagged", num_beams=0)
    assert succeeded.all()


def test_a_pose_under_the_robot_is_no_singularity() -> None:
    briefing = told(3)
    policy = SmoothPose()
    zero = np.zeros(3)
    for waypoints_left in (0.0, 1.0):
        seen = goal_reaching.Observation(
            np.zeros((3, 3)),
            np.zeros((3, 2)),
            np.array([[0.0, 0.0], [1e-9, 0.0], [0.0, -1e-30]]),
            np.array([0.0, math.pi, -1.0]),
            zero + waypoints_left,
            np.zeros((3, 0)),
        )
        twists = policy.act(seen, briefing, policy.reset(briefing))
        assert np.isfinite(twists).all()
        assert (np.abs(twists[:, 1]) <= policy.max_yaw_rate).all()
