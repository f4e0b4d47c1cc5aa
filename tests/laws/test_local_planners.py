"""Seekers that see only their scan: what they make of constructed scans, and that they can always stop."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.local_planning import MAX_RANGE, Array, briefing_of, drive, free, observed, scan

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.kinematics import integrate_arc
from wayfield.envs.robots.records import lag_factors
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.params import params
from wayfield.policies.parts.stopping import INTERVAL, Scan, Seen, find_approaching, sees_all_round
from wayfield.policies.scans.dwa import Dwa
from wayfield.policies.scans.mppi import Mppi
from wayfield.policies.scans.nav2_dwb import Nav2Dwb
from wayfield.policies.scans.nav2_mppi import Nav2Mppi
from wayfield.policies.scans.scan_planner import ScanPlanner
from wayfield.policies.scans.vfh_plus import VfhPlus
from wayfield.system.compiled import compiled

PLANNERS = [Dwa, VfhPlus]
every_planner = pytest.mark.parametrize("planner", PLANNERS)
every_robot = pytest.mark.parametrize("robot", ["p3dx", "omni4"])

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


def first_twist(planner: Any, briefing: Briefing, ranges: Array, goal: tuple[float, float] = (4.0, 0.0)) -> Array:
    """Returns the first twist (t,) from rest."""
    twist: Array = planner.act(observed(briefing, ranges, goal), briefing, planner.reset(briefing))[0]
    return twist


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


# To the goal.


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
