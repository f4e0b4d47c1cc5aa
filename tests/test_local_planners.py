"""Seekers that see only their scan: what they make of constructed scans, and that they can always stop."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.kinematics import integrate_arc
from wayfield.envs.records import lag_factors
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.sensing import beam_angles
from wayfield.policies import vfh_plus
from wayfield.policies.dwa import Dwa, heading_left, score
from wayfield.policies.mppi import Mppi
from wayfield.policies.nav2_dwb import Nav2Dwb
from wayfield.policies.nav2_mppi import Nav2Mppi
from wayfield.policies.parts.params import params
from wayfield.policies.parts.stopping import INTERVAL, Scan, Seen, find_approaching, free_time, sees_all_round
from wayfield.policies.pilot import Pilot
from wayfield.policies.scan_planner import ScanPlanner
from wayfield.policies.vfh_plus import DIRECTIONS, VfhPlus

Array = NDArray[np.float64]
PLANNERS = [Dwa, VfhPlus]
every_planner = pytest.mark.parametrize("planner", PLANNERS)
every_robot = pytest.mark.parametrize("robot", ["p3dx", "omni4"])
ID = {
    "p3dx": "wayfield/DiffDriveGoalObstacles-v0",
    "omni3": "wayfield/OmniGoalObstacles-v0",
    "omni4": "wayfield/OmniGoalObstacles-v0",
}
MAX_RANGE = 5.0

free = compiled(lambda hits, vx, vy, w, longest: free_time(hits, vx, vy, w, longest))
approaching = compiled(
    lambda params, scan, seen, memory, radius, hits: find_approaching(
        params[0], scan, seen, memory[0], 0, radius, hits, 0
    )
)


def come_nearer(
    briefing: Briefing, ranges: Array, x: float, radius: float, foresight: float, memory: NDArray[Any], hits: Array
) -> int:
    """Fills the hits with what a robot at (x, 0) foresees, and returns how many they are."""
    policy = Dwa(foresight=foresight)
    seen = observed(briefing, ranges)._replace(pose=np.array([[x, 0.0, 0.0]]))
    sighted = Scan.of(policy, seen, briefing, memory), Seen.of(seen, briefing)
    return int(approaching(params(policy, briefing), *sighted, memory["state"], radius, hits))


def briefing_of(
    robot: str, beams: int = 72, actuators: str = "lagged", field_of_view: float = 2.0 * math.pi, num_envs: int = 1
) -> Briefing:
    """Returns what a robot with a scan is told."""
    layout = Observation.layout(len(ROBOTS[robot].twist_axes), beams, MAX_RANGE)
    angles = beam_angles(beams, field_of_view)
    return Briefing(num_envs, ROBOTS[robot], ACTUATORS[actuators], 0.05, "twist", layout, angles, MAX_RANGE)


def scan(angles: Array, walls: list[tuple[float, float, float, float]]) -> Array:
    """Returns the ranges (1, beams) to walls from (x1, y1) to (x2, y2), seen from the origin."""
    ranges = np.full(len(angles), MAX_RANGE)
    for k, angle in enumerate(angles):
        u = np.array([math.cos(angle), math.sin(angle)])
        for x1, y1, x2, y2 in walls:
            matrix = np.array([[u[0], x1 - x2], [u[1], y1 - y2]])
            if abs(np.linalg.det(matrix)) > 1e-12:
                distance, share = np.linalg.solve(matrix, [x1, y1])
                if distance >= 0.0 and 0.0 <= share <= 1.0:
                    ranges[k] = min(ranges[k], distance)
    return ranges[None]


def observed(
    briefing: Briefing, ranges: Array, goal: tuple[float, float] = (4.0, 0.0), turn: float = 0.0, twist: Any = None
) -> Observation:
    """Returns the observation of a robot at the origin."""
    b = briefing.num_envs
    axes = len(briefing.robot.twist_axes)
    return Observation(
        pose=np.zeros((b, 3)),
        twist=np.zeros((b, axes)) if twist is None else np.atleast_2d(twist),
        goal=np.tile(goal, (b, 1)),
        goal_heading_error=np.full(b, turn),
        waypoints_left=np.zeros(b),
        ranges=np.tile(ranges, (b, 1)),
    )


def first_twist(planner: Any, briefing: Briefing, ranges: Array, goal: tuple[float, float] = (4.0, 0.0)) -> Array:
    """Returns the first twist (t,) from rest."""
    twist: Array = planner.act(observed(briefing, ranges, goal), briefing, planner.reset(briefing))[0]
    return twist


def drive(
    planner: Any,
    scene: dict[str, Any],
    robot: str,
    folder: Path,
    steps: int,
    beams: int = 72,
    actuators: str = "lagged",
    **options: Any,
) -> tuple[Array, dict[str, Any]]:
    """Returns the poses (steps, 3) that the planner drives from the origin, and the last info."""
    file = folder / "scene.json"
    file.write_text(json.dumps({"start": [0, 0, 0], "heading_tolerance": math.pi, "position_tolerance": 0.2} | scene))
    env: Any = gymnasium.make(
        ID[robot], robot=robot, scenario=str(file), num_beams=beams, actuators=actuators, **options
    )
    seen, info = env.reset(seed=0)
    pilot = Pilot(planner, env)
    pilot.reset()
    poses = []
    for _ in range(steps):
        seen, _, terminated, _, info = env.step(pilot.act(seen))
        poses.append([env.unwrapped.batch.states[0][name] for name in ("x", "y", "heading")])
        if terminated:
            break
    return np.array(poses), info


def walls(*ends: tuple[float, float, float, float]) -> list[dict[str, Any]]:
    return [{"kind": "wall", "x1": a, "y1": b, "x2": c, "y2": d} for a, b, c, d in ends]


# The free arc.


@given(
    x=st.floats(-3.0, 3.0),
    y=st.floats(-3.0, 3.0),
    vx=st.floats(-1.0, 1.0),
    vy=st.floats(-1.0, 1.0),
    w=st.one_of(st.just(0.0), st.floats(-2.0, 2.0)),
    radius=st.floats(0.05, 0.5),
)
def test_the_free_time_is_when_the_arc_first_comes_within_the_radius(
    x: float, y: float, vx: float, vy: float, w: float, radius: float
) -> None:
    radius = min(radius, (1.0 - 1e-6) * math.hypot(x, y))
    if radius < 1e-3 or math.hypot(vx, vy) < 1e-3:
        return
    longest = 6.0
    until = free(np.array([[x, y, radius]]), vx, vy, w, longest)
    times = np.linspace(0.0, longest, 3001)
    path = np.array([integrate_arc(0.0, 0.0, 0.0, vx, vy, w, t)[:2] for t in times])
    distance = np.hypot(path[:, 0] - x, path[:, 1] - y)
    assert 0.0 <= until <= longest
    assert (distance[times < until - 1e-9] >= radius - 1e-5).all()
    if until < longest:
        touching = integrate_arc(0.0, 0.0, 0.0, vx, vy, w, until)
        assert math.hypot(touching[0] - x, touching[1] - y) == pytest.approx(radius, abs=1e-5)


@given(
    speed=st.floats(0.2, 1.0), w=st.floats(0.5, 2.0), side=st.sampled_from([1.0, -1.0]),
    turn=st.floats(0.4, 2.0 * math.pi - 0.4), beside=st.floats(-0.9, 0.9),
)  # fmt: skip
def test_a_hit_on_the_circle_is_met_after_the_way_round_to_it(
    speed: float, w: float, side: float, turn: float, beside: float
) -> None:
    """Also one that lies behind the robot, which a circle leads to last: the centre is then (turn - edge) / w away."""
    r, radius = speed / w, 0.2 * speed / w
    rho = r + beside * radius
    x, y = rho * math.sin(turn), side * (r - rho * math.cos(turn))
    edge = math.acos((r * r + rho * rho - radius * radius) / (2.0 * r * rho))
    until = free(np.array([[x, y, radius]]), speed, 0.0, side * w, 20.0)
    assert until == pytest.approx((turn - edge) / w, abs=1e-9)


# What comes nearer.


def foreseen(motion: Any, velocity: float, radius: float = 0.3, foresight: float = 1.0, noise: float = 0.0) -> Array:
    """Returns what a robot that drives along the x axis from the origin foresees after 1.2 s, in its body frame.

    Args:
        motion: gives the walls of the world at a time (s).
    """
    briefing = briefing_of("omni4", 144)
    angles = briefing.beam_angles
    memory, hits = Dwa().reset(briefing), np.empty((len(angles), 3))
    rng = np.random.default_rng(0)
    count = 0
    for k in range(25):
        x = velocity * 0.05 * k
        layout = [(x1 - x, y1, x2 - x, y2) for x1, y1, x2, y2 in motion(0.05 * k)]
        ranges = scan(angles, layout)
        ranges = np.where(ranges < MAX_RANGE, ranges + noise * rng.uniform(-1.0, 1.0, ranges.shape), MAX_RANGE)
        count = come_nearer(briefing, ranges, x, radius, foresight, memory, hits)
    return hits[:count]


@pytest.mark.parametrize("speed", [0.4, 0.7])
@pytest.mark.parametrize("velocity", [-0.3, 0.0, 0.3])
def test_a_wall_that_comes_is_foreseen_where_it_will_be(speed: float, velocity: float) -> None:
    found = foreseen(lambda t: [(2.8 - speed * t, -1.0, 2.8 - speed * t, 1.0)], velocity, foresight=0.5)
    assert len(found) >= 5
    np.testing.assert_allclose(found[:, 0], 2.8 - speed * (1.2 + 0.5) - velocity * 1.2, atol=1e-9)


def test_what_comes_is_put_no_nearer_than_the_robot_keeps_its_distance() -> None:
    found = foreseen(lambda t: [(2.0 - 0.6 * t, -1.0, 2.0 - 0.6 * t, 1.0)], 0.0, radius=0.5, foresight=5.0)
    away = np.hypot(found[:, 0], found[:, 1])
    assert (away >= 0.5 - 1e-9).all()
    assert away.min() < 0.5 + 1e-6
    assert (found[:, 2] < away).all()


@pytest.mark.parametrize("velocity", [-0.6, 0.0, 0.6])
def test_what_stands_or_goes_away_is_not_foreseen(velocity: float) -> None:
    room = [(2.5, -2, 2.5, 2), (2.5, 2, -2, 2), (-2, 2, -2, -2), (-2, -2, 2.5, -2), (1.2, 0.8, 1.5, 1.2)]
    assert len(foreseen(lambda t: room, velocity)) == 0
    assert len(foreseen(lambda t: room, velocity, noise=0.01)) == 0
    assert len(foreseen(lambda t: [(1.0 + 0.5 * t, -1.0, 1.0 + 0.5 * t, 1.0)], velocity)) == 0
    assert len(foreseen(lambda t: [], velocity)) == 0


def test_nothing_is_foreseen_before_two_scans_lie_apart() -> None:
    assert INTERVAL > 0.1
    briefing = briefing_of("omni4", 72)
    memory, hits = Dwa().reset(briefing), np.empty((72, 3))
    for k in range(2):
        ranges = scan(briefing.beam_angles, [(2.0 - 0.03 * k, -1.0, 2.0 - 0.03 * k, 1.0)])
        assert come_nearer(briefing, ranges, 0.0, 0.3, 1.0, memory, hits) == 0


# What a robot can do with what it decides.


def stops_clear(briefing: Briefing, command: Array, twist: Array, action: Array, points: Array, radius: float) -> bool:
    """Returns whether a robot that drives an action for a period and then brakes keeps its distance to points (k, 2).

    The plant written out again: saturation apart, acceleration limits, lag, and the motion between in small steps.
    """
    plant, dt = briefing.actuators, briefing.dt
    axes = briefing.robot.twist_axes
    c, wheel, target = np.zeros(3), np.zeros(3), np.zeros(3)
    c[list(axes)], wheel[list(axes)], target[list(axes)] = command, twist, action
    decay, mean = lag_factors(plant.lag, dt)
    pose = (0.0, 0.0, 0.0)
    for _ in range(200):
        change = target[:2] - c[:2]
        size = float(np.hypot(*change))
        c[:2] += change * min(1.0, plant.acceleration * dt / size if size else 1.0)
        c[2] += np.clip(target[2] - c[2], -plant.yaw_acceleration * dt, plant.yaw_acceleration * dt)
        for _ in range(5):
            pose = integrate_arc(*pose, *(c + mean * (wheel - c)), dt / 5)
            if len(points) and np.hypot(points[:, 0] - pose[0], points[:, 1] - pose[1]).min() < radius:
                return False
        wheel = c + decay * (wheel - c)
        target = np.zeros(3)
        if np.abs(wheel).max() < 1e-4:
            break
    return True


@every_planner
@every_robot
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
@settings(max_examples=2 * settings().max_examples // 5)
@given(seed=st.integers(0, 10_000), near=st.floats(0.1, 2.0), share=st.floats(0.0, 1.0))
def test_what_a_planner_drives_leaves_room_to_stop_before_every_hit(
    planner: Any, robot: str, actuators: str, seed: int, near: float, share: float
) -> None:
    briefing = briefing_of(robot, 48, actuators)
    rng = np.random.default_rng(seed)
    hull = briefing.robot.hull_radius
    ranges = np.where(rng.random((1, 48)) < 0.5, rng.uniform(hull + 0.03, hull + 0.03 + near, (1, 48)), MAX_RANGE)
    points = np.column_stack([ranges[0] * np.cos(briefing.beam_angles), ranges[0] * np.sin(briefing.beam_angles)])
    points = points[ranges[0] < MAX_RANGE]
    policy = planner()
    memory = policy.reset(briefing)
    axes = list(briefing.robot.twist_axes)
    # a robot that has driven its command for long, as fast as it may and still stop
    command = np.zeros(3)
    command[axes] = share * rng.uniform(-1.0, 1.0, len(axes)) * np.where(np.array(axes) == 2, 1.5, 0.6)
    if robot == "p3dx":
        command[0] = abs(command[0])
    moving = actuators != "ideal"
    if moving and stops_clear(briefing, command[axes], command[axes], 0.0 * command[axes], points, hull + 0.031):
        memory["state"]["command"] = command
    before = memory["state"]["command"][0, axes].copy()
    goal = tuple(rng.uniform(-3.0, 3.0, 2).tolist())
    action = policy.act(observed(briefing, ranges, goal, 0.3, before), briefing, memory)[0]
    assert stops_clear(briefing, before, before, action, points, hull)


@pytest.mark.parametrize("actuators", ["lagged", "slow"])
@pytest.mark.parametrize("distance", [0.36, 0.45, 0.6, 0.8, 1.1, 1.5])
@pytest.mark.parametrize("slant", [0.0, 0.4])
def test_dwa_drives_the_fastest_twist_of_its_window_that_is_admissible(
    actuators: str, distance: float, slant: float
) -> None:
    """Fox's v <= sqrt(2 dist a) and |w| <= sqrt(2 angle a_w) on the arc that is left after lag and control period."""
    briefing = briefing_of("p3dx", 144, actuators)
    planner = Dwa(heading=0.0, clearance=0.0, velocity=1.0, progress=0.0, room=0.0, window=2.0, foresight=0.0)
    ends = (distance - 5.0 * math.tan(slant), -5.0, distance + 5.0 * math.tan(slant), 5.0)
    ranges = scan(briefing.beam_angles, [ends])
    v, w = first_twist(planner, briefing, ranges, (40.0, 0.0))
    plant, robot = ACTUATORS[actuators], ROBOTS["p3dx"]
    hits = np.column_stack([ranges[0] * np.cos(briefing.beam_angles), ranges[0] * np.sin(briefing.beam_angles)])
    radius = robot.hull_radius + planner.margin
    hits = np.column_stack([hits, np.full(len(hits), radius)])[ranges[0] < MAX_RANGE - 1e-9]
    a, a_w, delay = plant.acceleration, plant.yaw_acceleration, plant.lag + 0.05

    def spare(v: float, w: float) -> float:
        """Returns by which factor the twist is slower than Fox allows."""
        left = free(hits, v, 0.0, w, planner.horizon) - delay
        if left <= 0.0:
            return 0.0
        return min(2.0 * a * left / max(v, 1e-12), 2.0 * a_w * left / max(abs(w), 1e-12))

    assert v == 0.0 or spare(v, w) >= 1.0 - 1e-9
    fastest = min(a * planner.window, planner.max_speed)
    turns = min(a_w * planner.window, planner.max_yaw_rate)
    for faster in np.linspace(0.0, fastest, 7):
        if faster > v + 1e-9:
            for turn in np.linspace(-turns, turns, 15):
                # the base saturates, and a stop that comes too close is refused besides
                if robot.rated_wheel_speed >= np.abs(robot.wheel_speeds_from_twist(np.array([faster, turn]))).max():
                    assert spare(faster, turn) < 1.3


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_of_two_arcs_alike_dwa_drives_the_one_that_is_free_for_longer(side: float) -> None:
    """A post ahead, a wall to one side, the goal dead ahead: an arc and its mirror image differ in free time alone."""
    briefing = briefing_of("p3dx", 144, "ideal")
    planner = Dwa(heading=0.0, clearance=1.0, velocity=0.3, progress=0.0, room=0.0, foresight=0.0)
    ranges = scan(briefing.beam_angles, [(1.0, -0.2, 1.0, 0.2), (-0.5, 0.5 * side, 3.0, 0.5 * side)])
    v, w = first_twist(planner, briefing, ranges)
    assert v > 0.2
    assert side * w < 0.0
    angles = briefing.beam_angles
    hits = np.column_stack([ranges[0] * np.cos(angles), ranges[0] * np.sin(angles), np.full(len(angles), 0.28)])
    hits = hits[ranges[0] < MAX_RANGE - 1e-9]
    assert free(hits, v, 0.0, w, 2.0) > free(hits, v, 0.0, -w, 2.0)


@every_planner
@every_robot
def test_a_driven_robot_stops_in_front_of_what_it_cannot_pass(planner: Any, robot: str, tmp_path: Path) -> None:
    scene = {"goal": [4, 0, 0], "obstacles": walls((2, -3, 2, 3), (2, 3, -1, 3), (-1, 3, -1, -3), (-1, -3, 2, -3))}
    for actuators in ("ideal", "lagged", "slow"):
        poses, info = drive(planner(), scene, robot, tmp_path, 400, actuators=actuators)
        assert not info["collision"]
        assert poses[:, 0].max() < 2.0 - ROBOTS[robot].hull_radius


# Constructed scans.


@every_planner
@every_robot
@pytest.mark.parametrize("actuators", ["ideal", "lagged"])
def test_a_corridor_is_driven_straight(planner: Any, robot: str, actuators: str, tmp_path: Path) -> None:
    scene = {"goal": [6, 0, 0], "obstacles": walls((-2, -0.6, 8, -0.6), (-2, 0.6, 8, 0.6))}
    poses, info = drive(planner(), scene, robot, tmp_path, 500, actuators=actuators)
    assert info["success"]
    assert np.abs(poses[:, 1]).max() < 0.15


@every_planner
@every_robot
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_gap_in_a_wall_is_headed_for(planner: Any, robot: str, side: float, tmp_path: Path) -> None:
    near, far = side * 0.3, side * 1.3
    scene = {"goal": [4, side, 0], "obstacles": walls((1.5, -side * 4, 1.5, near), (1.5, far, 1.5, side * 4))}
    poses, info = drive(planner(), scene, robot, tmp_path, 400)
    assert info["success"]
    crossing = np.flatnonzero(poses[:, 0] > 1.5)[0]
    assert 0.3 < side * poses[crossing, 1] < 1.3
    assert (side * poses[:crossing, 1]).min() > -0.1  # nor did it look for a way on the other side first


@every_planner
@every_robot
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_wall_ahead_makes_it_turn_aside(planner: Any, robot: str, side: float, tmp_path: Path) -> None:
    scene = {"goal": [4, 0, 0], "obstacles": walls((2, -side * 1.2, 2, side * 0.3))}
    poses, info = drive(planner(), scene, robot, tmp_path, 800)
    assert info["success"]
    crossing = poses[np.flatnonzero(poses[:, 0] > 2.0)[0], 1]
    hull = ROBOTS[robot].hull_radius
    assert side * crossing > 0.3 + 0.9 * hull or side * crossing < -1.2 - 0.9 * hull


@every_robot
def test_a_valley_behind_is_one_though_the_histogram_ends_in_it(robot: str) -> None:
    # free only straight behind, where the sectors of both ends of the histogram meet
    briefing = briefing_of(robot, 180)
    around = scan(briefing.beam_angles, [(0.7, -0.7, 0.7, 0.7), (0.7, 0.7, -3, 0.7), (0.7, -0.7, -3, -0.7)])
    policy = VfhPlus()
    memory = policy.reset(briefing)
    twist = policy.act(observed(briefing, around), briefing, memory)[0]
    assert abs(abs(memory["state"]["previous"][0]) - math.pi) < 0.1
    if robot == "p3dx":
        assert twist[0] == 0.0  # turns on the spot
        assert abs(twist[1]) > 1.0
    else:
        assert twist[0] < -0.1
        assert abs(twist[1]) < 0.05


@every_planner
@every_robot
def test_a_robot_that_is_boxed_in_stands(planner: Any, robot: str) -> None:
    briefing = briefing_of(robot, 72)
    gap = briefing.robot.hull_radius + 0.03
    twist = first_twist(planner(), briefing, np.full((1, 72), gap))
    assert np.abs(twist[: len(twist) - 1]).max() == 0.0
    if planner is VfhPlus:
        assert twist[-1] == 0.0
    # with a scan that does not surround it, it looks around
    half = briefing_of(robot, 72, field_of_view=math.pi)
    twist = first_twist(planner(), half, np.full((1, 72), gap), (0.0, 4.0))
    assert np.abs(twist[: len(twist) - 1]).max() == 0.0
    assert twist[-1] > 0.0


@every_robot
def test_vfh_plus_decides_alike_with_few_beams_and_with_many(robot: str) -> None:
    layouts = [
        [(1.0, -0.2, 1.0, 3.0)],
        [(1.1, -4.0, 1.1, 0.0), (1.1, 1.0, 1.1, 4.0)],
        [(-3.0, 0.6, 3.0, 0.6), (-3.0, -0.6, 3.0, -0.6)],
        [(0.8, -0.5, 0.8, 0.5), (0.8, 0.5, -0.5, 0.9)],
    ]
    for layout in layouts:
        choices, twists = [], []
        for beams in (90, 180, 360, 720):
            briefing = briefing_of(robot, beams)
            policy = VfhPlus()
            memory = policy.reset(briefing)
            twists.append(policy.act(observed(briefing, scan(briefing.beam_angles, layout)), briefing, memory)[0])
            choices.append(memory["state"]["previous"][0])
        # an edge lies between two beams: 4 degrees of 90, and two sectors of 2.5
        off = np.angle(np.exp(1j * (np.array(choices) - choices[-1])))
        assert np.abs(off).max() < math.radians(9.0)
        assert np.abs(np.array(twists) - twists[-1]).max() < 0.4


left_over = compiled(lambda params, aim, w: heading_left(params[0], aim, 0.4, 0.0, w))


@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.sampled_from(["lagged", "slow"]))
def test_the_heading_of_dwa_is_that_after_a_period_and_the_brakes(aim: float, w: float, actuators: str) -> None:
    briefing = briefing_of("p3dx", actuators=actuators)
    braking = briefing.actuators.yaw_acceleration
    turned, rate, dt = w * 0.05, w, 1e-4
    while abs(rate) > braking * dt:
        slower = rate - math.copysign(braking * dt, rate)
        turned, rate = turned + 0.5 * (rate + slower) * dt, slower
    left = left_over(params(Dwa(), briefing, all_round=True, sideways=False), aim, w)
    assert left == pytest.approx(abs(math.remainder(aim - turned, 2.0 * math.pi)), abs=1e-3)


@every_planner
@every_robot
@pytest.mark.parametrize("left", [0.12, 0.2, 0.3])
def test_at_its_goal_a_planner_drives_no_faster_than_it_can_stop_there(planner: Any, robot: str, left: float) -> None:
    """v (lag + dt) + v^2 / 2 a = distance, with 0.7 of the base's acceleration: it comes and goes on at that speed."""
    briefing = briefing_of(robot)
    delay, braking = briefing.actuators.lag + 0.05, 0.7 * briefing.actuators.acceleration
    fastest = -braking * delay + math.sqrt((braking * delay) ** 2 + 2.0 * braking * left)
    policy = planner()
    memory = policy.reset(briefing)
    memory["state"]["command"][0, 0] = fastest
    twist = [fastest, *[0.0] * (len(briefing.robot.twist_axes) - 1)]
    seen = observed(briefing, np.full((1, 72), MAX_RANGE), (left, 0.0), twist=[twist])
    assert 0.8 * fastest <= policy.act(seen, briefing, memory)[0, 0] <= fastest + 1e-9


objective = compiled(
    lambda params, hits, twist, aim, d, goal_x, goal_y: score(params[0], hits, twist, aim, d, goal_x, goal_y)
)


@given(
    st.floats(0.05, 0.6), st.floats(-1.0, 1.0), st.floats(1.0, 3.0), st.floats(0.5, 2.2), st.floats(-0.5, 0.5),
    st.tuples(*[st.floats(0.0, 2.0)] * 5),
)  # fmt: skip
def test_the_objective_of_dwa_is_its_printed_sum(
    v: float, aim: float, d: float, x: float, y: float, weights: tuple[float, ...]
) -> None:
    """Straight ahead past one hit, or up to it: shares of half a turn, of the horizon, of the speed, and so on."""
    law = Dwa(**dict(zip(("heading", "clearance", "velocity", "progress", "room"), weights, strict=True)))
    briefing, radius = briefing_of("p3dx", actuators="ideal"), 0.28
    room = math.sqrt(radius * radius - y * y) if abs(y) < radius else math.nan
    free = law.horizon if math.isnan(room) else min(law.horizon, max(x - room, 0.0) / v)
    goal = d * math.cos(aim), d * math.sin(aim)
    found = objective(
        params(law, briefing, all_round=True, sideways=False), np.array([[x, y, radius]]), np.array([v, 0.0, 0.0]),
        aim, d, *goal,
    )  # fmt: skip
    if free <= 0.05:  # a control period
        assert found == -math.inf
        return
    until = min(free, d / v)
    nearer = d - math.hypot(goal[0] - v * until, goal[1])
    ahead = v * min(until, 1.0)
    hull = briefing.robot.hull_radius
    gap = max(min(math.hypot(x - ahead, y) - hull, law.room_range), 0.0)
    shares = [
        1.0 - abs(aim) / math.pi,
        free / law.horizon,
        v / law.max_speed,
        nearer / (law.max_speed * law.horizon),
        gap / law.room_range if law.room else 1.0,
    ]
    assert found == pytest.approx(float(np.dot(weights, shares)), abs=1e-9)


@pytest.mark.parametrize("magnitude", [0.05, 0.15, 0.25])
@pytest.mark.parametrize("slowing", [0.0, 0.5, 1.0])
def test_vfh_plus_slows_down_by_the_histogram_of_its_direction(magnitude: float, slowing: float) -> None:
    briefing, policy = briefing_of("p3dx", actuators="ideal"), VfhPlus(slowing=slowing)
    ranges = np.full((1, 72), MAX_RANGE)
    distance = policy.window * math.sqrt(1.0 - magnitude)  # too far away to block
    ranges[0, 36] = distance
    v, w = first_twist(policy, briefing, ranges)
    assert (v, w) == pytest.approx((policy.max_speed * (1.0 - slowing * magnitude), 0.0), abs=1e-6)


def test_the_thresholds_of_vfh_plus_have_hysteresis() -> None:
    briefing = briefing_of("p3dx", 72)
    policy = VfhPlus(recall=0.0)

    def blocked_after(*distances: float) -> bool:
        memory = policy.reset(briefing)
        for distance in distances:
            ranges = np.full((1, 72), MAX_RANGE)
            ranges[0, 36] = distance  # straight ahead
            policy.act(observed(briefing, ranges), briefing, memory)
        return bool(memory["state"]["binary"][0, DIRECTIONS // 2] == 1)

    far, between, near = (policy.window * math.sqrt(1.0 - magnitude) for magnitude in (0.25, 0.4, 0.6))
    assert not blocked_after(far)
    assert blocked_after(near)
    assert not blocked_after(between)
    assert blocked_after(near, between)
    assert not blocked_after(near, between, far, between)


def test_vfh_plus_masks_what_its_turning_circle_cannot_reach() -> None:
    # a post close ahead on the left and a goal on the left behind it: free for a standing robot, not for a moving one
    briefing = briefing_of("p3dx", 180)
    layout = [(0.45, 0.42, 0.55, 0.42)]
    choices = []
    for speed in (0.0, 0.6):
        policy = VfhPlus(max_yaw_rate=0.6)
        memory = policy.reset(briefing)
        memory["state"]["command"][0, 0] = speed
        policy.act(
            observed(briefing, scan(briefing.beam_angles, layout), (0.0, 3.0), twist=[speed, 0.0]), briefing, memory
        )
        choices.append(memory["state"]["previous"][0])
    assert choices[0] == pytest.approx(0.5 * math.pi, abs=0.3)
    assert choices[1] < 0.6


# Symmetries.


@every_planner
def test_turning_scene_and_goal_turns_what_an_omni_robot_does(planner: Any) -> None:
    briefing = briefing_of("omni4", 72)
    policy = planner()
    alike = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        k = int(rng.integers(1, 72))
        ranges = np.where(rng.random((1, 72)) < 0.4, rng.uniform(0.4, 3.0, (1, 72)), MAX_RANGE)
        goal = rng.uniform(-3.0, 3.0, 2)
        turn = 2.0 * math.pi * k / 72
        c, s = math.cos(turn), math.sin(turn)
        rotation = np.array([[c, -s], [s, c]])
        here = first_twist(policy, briefing, ranges, tuple(goal))
        there = first_twist(policy, briefing, np.roll(ranges, k, axis=1), tuple(rotation @ goal))
        assert there[2] == here[2]
        alike += np.allclose(there[:2], rotation @ here[:2], atol=1e-6)
    # rounding may put a beam that lies on the edge of a sector on either side of it, one time in some hundreds
    assert alike >= 58


@every_planner
@every_robot
def test_a_row_of_a_batch_acts_exactly_as_alone(planner: Any, robot: str) -> None:
    options: dict[str, Any] = {"robot": robot, "actuators": "lagged", "num_beams": 72, "scenario": "mixed"}
    many: Any = gymnasium.make_vec(ID[robot], 6, vectorization_mode="vector_entry_point", **options)
    seen, _ = many.reset(seed=4)
    pilot = Pilot(planner(patience=0.5), many)
    pilot.reset()
    alone: Any = gymnasium.make(ID[robot], **options)
    first, _ = alone.reset(seed=4 + 3)
    lone = Pilot(planner(patience=0.5), alone)
    lone.reset()
    for _ in range(150):
        actions, action = pilot.act(seen), lone.act(first)
        assert action.tobytes() == actions[3].tobytes()
        seen, _, ended, _, _ = many.step(actions)
        first, *_ = alone.step(action)
        if ended[3]:
            break


# To the goal.


@every_planner
@pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4"])
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
def test_a_goal_pose_in_the_open_is_reached_and_kept(planner: Any, robot: str, actuators: str, tmp_path: Path) -> None:
    scene = {"goal": [2, 1.5, -2.0], "heading_tolerance": 0.1, "position_tolerance": 0.1}
    poses, info = drive(planner(), scene, robot, tmp_path, 600, actuators=actuators, end_on_success=False)
    away = np.hypot(poses[:, 0] - 2.0, poses[:, 1] - 1.5)
    assert info["success"]
    assert away[-100:].max() < 0.1
    assert np.ptp(poses[-40:], axis=0).max() < 0.01  # at rest
    # it does not overshoot: nobody passes the goal by more than the tolerance
    assert (poses[:, :2] @ [0.8, 0.6]).max() < 2.5 + 0.1


@every_planner
@every_robot
@pytest.mark.parametrize("tolerance", [0.1, 0.04])
def test_a_planner_tuned_for_goals_reached_from_afar_comes_as_near_as_its_own_asks(
    planner: Any, robot: str, tolerance: float, tmp_path: Path
) -> None:
    scene = {"goal": [1, 0.5, 1.0], "heading_tolerance": 0.1, "position_tolerance": tolerance}
    poses, info = drive(planner(stop_radius=0.15), scene, robot, tmp_path, 400, end_on_success=False)
    assert info["success"]
    away = np.hypot(*(poses[-20:, :2] - (1.0, 0.5)).T)
    assert away.max() < tolerance
    assert np.ptp(poses[-20:], axis=0).max() < 0.01
    # where the goal is reached from afar it rests as far off as its gain lets it
    wide = scene | {"position_tolerance": 0.2}
    poses, info = drive(planner(stop_radius=0.15), wide, robot, tmp_path, 400, end_on_success=False)
    assert info["success"]
    assert away.max() + 0.01 < math.dist(poses[-1, :2], (1.0, 0.5)) <= 0.15


@every_planner
@every_robot
def test_waypoints_are_driven_through(planner: Any, robot: str, tmp_path: Path) -> None:
    scene = {"goal": [4, 0, 0], "waypoints": [[2, 1.5]], "waypoint_radius": 0.3}
    poses, info = drive(planner(), scene, robot, tmp_path, 400)
    assert info["success"]
    assert np.hypot(poses[:, 0] - 2.0, poses[:, 1] - 1.5).min() <= 0.3
    slow = np.hypot(*np.diff(poses[20:-40, :2], axis=0).T)
    assert slow.min() > 0.0  # no stop on the way


@every_planner
@every_robot
def test_a_dead_end_is_left_by_a_detour_and_holds_who_makes_none(planner: Any, robot: str, tmp_path: Path) -> None:
    scene = {
        "goal": [4.5, 0, 0],
        "obstacles": walls((2.5, -0.8, 2.5, 0.8), (1.0, 0.8, 2.5, 0.8), (1.0, -0.8, 2.5, -0.8)),
    }
    assert drive(planner(), scene, robot, tmp_path, 1200)[1]["success"]
    if planner is Dwa:
        assert not drive(planner(patience=math.inf), scene, robot, tmp_path, 1200)[1]["success"]


def test_a_differential_drive_that_sees_all_round_backs_away_from_what_comes() -> None:
    def last_speed(wall_speed: float, field_of_view: float = 2.0 * math.pi, **gains: float) -> float:
        briefing = briefing_of("p3dx", 72, field_of_view=field_of_view)
        policy = Dwa(**gains)
        memory = policy.reset(briefing)
        for k in range(20):
            x = 0.5 + wall_speed * (1.0 - 0.05 * k)
            seen = scan(briefing.beam_angles, [(x, -2.0, x, 2.0)])
            # held where it is
            memory["state"]["command"] = 0.0
            twist = policy.act(observed(briefing, seen), briefing, memory)[0]
        return float(twist[0])

    assert last_speed(0.5) < -0.05
    assert last_speed(0.5, retreat=0.0) >= 0.0
    assert last_speed(0.5, foresight=0.0) >= 0.0
    assert last_speed(0.5, field_of_view=math.pi) >= 0.0
    assert last_speed(0.0) >= 0.0


@pytest.mark.parametrize(("planner", "robot"), [(Dwa, "omni4"), (VfhPlus, "omni4"), (VfhPlus, "p3dx")])
def test_a_disc_that_comes_head_on_is_let_past(planner: Any, robot: str, tmp_path: Path) -> None:
    # from ahead, 5 cm off the robot's line: one that stood still would be run over
    patrol = {"vx": -0.3, "vy": 0.0, "leg_time": 30.0}
    disc = {"kind": "circle", "x": 5.0, "y": 0.05, "radius": 0.25, "patrol": patrol}
    poses, info = drive(planner(), {"goal": [6, 0, 0], "obstacles": [disc]}, robot, tmp_path, 800)
    assert info["success"]
    assert not info["collision"]
    assert np.abs(poses[:, 1]).max() > 0.3  # it made room


def test_an_omni_base_may_be_driven_as_a_differential_drive_is() -> None:
    """It turns to where it goes, and never drives aside; a differential drive is driven the same either way."""
    rng = np.random.default_rng(5)
    for robot in ("omni4", "p3dx"):
        briefing, aside, same = briefing_of(robot), [], []
        for _ in range(50):
            ranges = rng.uniform(0.3, MAX_RANGE, (1, 72))
            free, driven = (first_twist(VfhPlus(sideways=sideways), briefing, ranges) for sideways in (True, False))
            aside.append((free[1], driven[1]))
            same.append(np.array_equal(free, driven))
        if robot == "p3dx":
            assert all(same)
        else:
            assert np.abs(np.array(aside)[:, 0]).max() > 0.1
            assert (np.array(aside)[:, 1] == 0.0).all()


@pytest.mark.parametrize("beams", [2, 3, 24, 72])
def test_a_scan_surrounds_the_robot_until_a_beam_of_it_is_missing(beams: int) -> None:
    whole = briefing_of("p3dx", beams)
    assert sees_all_round(whole)
    for others in (whole.beam_angles[1:], whole.beam_angles[:-1], whole.beam_angles[:1], whole.beam_angles[:0]):
        assert not sees_all_round(dataclasses.replace(whole, beam_angles=others))
    half = briefing_of("p3dx", beams, field_of_view=math.pi)
    assert sees_all_round(half) == (beams == 2)  # of two the one gap is as wide as the other


# What is refused.


@pytest.mark.parametrize("planner", [*PLANNERS, Mppi, ScanPlanner, Nav2Dwb, Nav2Mppi])
def test_a_scan_without_beams_or_with_others_is_refused(planner: Any) -> None:
    with pytest.raises(ValueError, match="num_beams is 0"):
        planner().reset(briefing_of("p3dx", 0))
    briefing = briefing_of("p3dx", 72)
    for beams in (0, 36, 71, 73, 144):
        with pytest.raises(ValueError, match=f"ranges has {beams} values, the scan has 72 beams"):
            first_twist(planner(), briefing, np.full((1, beams), MAX_RANGE))


@pytest.mark.parametrize(
    ("planner", "gain", "value"),
    [
        (Dwa, "max_speed", 0.0),
        (Dwa, "horizon", math.inf),
        (Dwa, "margin", -0.1),
        (Dwa, "patience", math.nan),
        (VfhPlus, "window", 0.0),
        (VfhPlus, "high", 0.1),
        (VfhPlus, "high", 1.0),
        (VfhPlus, "slowing", 1.5),
        (VfhPlus, "recall", -1.0),
        (VfhPlus, "foresight", -1.0),
        (VfhPlus, "sideways", 0.5),
        (Dwa, "foresight", math.inf),
        (Dwa, "retreat", -0.1),
    ],
)
def test_gains_out_of_range_are_refused(planner: Any, gain: str, value: float) -> None:
    with pytest.raises(ValueError, match=gain):
        planner(**{gain: value})


@pytest.mark.parametrize("aside", [0.0, -0.1, 0.2])
@pytest.mark.parametrize("radius", [0.3, 0.5])
@pytest.mark.parametrize("left", [0.055, 0.03, 0.01])
def test_vfh_plus_turns_in_to_a_goal_right_behind_a_disc(
    radius: float, aside: float, left: float, tmp_path: Path
) -> None:
    """The goal leaves the hull its safety of 0.05 m, or less: there is a way, and no reason to circle the disc."""
    along = 4.0 - math.sqrt((radius + 0.25 + left) ** 2 - aside**2)
    disc = {"kind": "circle", "x": along, "y": aside, "radius": radius}
    file = tmp_path / "behind.json"
    file.write_text(json.dumps({"start": [0, 0, 0], "goal": [4, 0, 0], "obstacles": [disc]}))
    env = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", scenario=str(file), actuators="lagged")
    seen, info = env.reset(seed=0)
    pilot = Pilot(VfhPlus(), env)
    pilot.reset()
    over = False
    while not over:
        seen, _, terminated, truncated, info = env.step(pilot.act(seen))
        over = terminated or truncated
    assert info["success"]
    assert info["time"] < 16.0  # 4.6 m at 0.6 m/s, and the turn to the goal heading


cells_of = compiled(lambda hits, pose, cells: vfh_plus.cells_of(hits, pose, cells))


@given(
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)), min_size=1, max_size=60),
    st.tuples(*(st.floats(-3.0, 3.0) for _ in range(3))),
)
def test_a_cell_counts_once_however_many_hits_it_holds(
    drawn: list[tuple[float, float]], pose: tuple[float, float, float]
) -> None:
    hits = np.column_stack([np.array(drawn), np.zeros(len(drawn))])
    s, c = math.sin(pose[2]), math.cos(pose[2])
    turn = np.array([[c, -s], [s, c]])
    places = hits[:, :2] @ turn.T + pose[:2]
    # a hit on the border of two cells may lie in either
    near_border = np.abs(places / vfh_plus.CELL - np.rint(places / vfh_plus.CELL)).min() < 1e-9
    cells = np.empty((2 * len(drawn), 2))
    count = cells_of(np.vstack([hits, hits]), np.array(pose), cells)
    if not near_border:
        assert count == len(np.unique(np.floor(places / vfh_plus.CELL), axis=0))
    centres = cells[:count] @ turn.T + pose[:2]
    for place in places:
        assert np.abs(centres - place).max(axis=1).min() <= 0.5 * vfh_plus.CELL + 1e-9


def test_summed_magnitudes_grow_with_the_wall_and_largest_ones_do_not() -> None:
    """A sector in which a wall fills several cells weighs their sum, by the paper, or the nearest of them."""
    briefing = briefing_of("p3dx", 360)
    primaries = {}
    for kind in ("largest", "sum"):
        policy = VfhPlus(magnitudes=kind)  # type: ignore[arg-type]
        p = params(policy, briefing, all_round=True, sideways=False, summed=kind == "sum")
        # three posts in a row of cells before the robot, near enough that each fills the sector straight ahead
        for posts in (1, 3):
            hits = np.array([[0.75, 0.1 * k + 0.05, 0.28] for k in (0, -1, 1)[:posts]])
            primary = np.empty(DIRECTIONS)
            primary_of(p, hits, policy.window, primary)
            primaries[kind, posts] = primary[DIRECTIONS // 2]
    one = primaries["largest", 1]
    assert primaries["largest", 3] == pytest.approx(one, abs=0.02)
    assert primaries["sum", 1] == one
    assert primaries["sum", 3] == pytest.approx(3.0 * one, rel=0.03)


@compiled
def primary_of(params, hits, seen, primary):  # type: ignore[no-untyped-def]
    """Fills the primary histogram of a robot that faces along x, with no goal near and no circle to drive."""
    p = params[0]
    grown = p.plant.hull_radius + p.safety
    vfh_plus.fill_primary(p, hits, 0.0, seen, grown, (math.inf, 0.0), math.nan, primary)
