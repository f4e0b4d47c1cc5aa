"""Rigid-body wheel maps, saturation, actuator dynamics and exact arcs against their textbook definitions."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.linalg import expm

from wayfield.envs.robots import ACTUATORS, ROBOTS, Robot, kinematics
from wayfield.envs.robots.kinematics import integrate_arc, limit_acceleration, limits, saturation_factor, to_body_frame
from wayfield.envs.robots.records import lag_factors
from wayfield.policies.parts.params import plant

SPEEDS = st.floats(-3.0, 3.0)
TWISTS = st.tuples(SPEEDS, SPEEDS, st.floats(-8.0, 8.0))
POSES = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-3.14, 3.14))
OMNI = [robot for robot in ROBOTS.values() if robot.holonomic]


def se2(x: float, y: float, heading: float) -> NDArray[np.float64]:
    c, s = math.cos(heading), math.sin(heading)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def ring(radius: float, drive_directions: list[float]) -> list[tuple[float, float]]:
    """Returns wheel positions from which the given drive directions all turn the base to the left."""
    return [(radius * math.cos(a - math.pi / 2), radius * math.sin(a - math.pi / 2)) for a in drive_directions]


# The maps.


@given(v=SPEEDS, w=SPEEDS, wheel_radius=st.floats(0.01, 0.5), half_track=st.floats(0.02, 1.0))
def test_differential_drive_map(v: float, w: float, wheel_radius: float, half_track: float) -> None:
    matrix = kinematics.wheel_matrix([(0.0, -half_track), (0.0, half_track)], [0.0, 0.0], wheel_radius)
    right, left = matrix @ (v, 0.0, w)
    assert right * wheel_radius == pytest.approx(v + half_track * w, abs=1e-9)
    assert left * wheel_radius == pytest.approx(v - half_track * w, abs=1e-9)


@given(
    twist=TWISTS,
    wheel_radius=st.floats(0.01, 0.3),
    reach=st.floats(0.05, 1.0),
    directions=st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=4),
)
def test_omni_drive_map(
    twist: tuple[float, float, float], wheel_radius: float, reach: float, directions: list[float]
) -> None:
    speeds = kinematics.wheel_matrix(ring(reach, directions), directions, wheel_radius) @ twist
    vx, vy, yaw_rate = twist
    for a, speed in zip(directions, speeds, strict=True):
        wanted = vx * math.cos(a) + vy * math.sin(a) + reach * yaw_rate
        assert speed * wheel_radius == pytest.approx(wanted, abs=1e-9)


@given(st.sampled_from([each for each in OMNI if each.drive == "omni"]), TWISTS)
def test_the_printed_plain_sum_over_reads(robot: Robot, twist: tuple[float, float, float]) -> None:
    printed = kinematics.plain_sum_matrix(robot.wheel_matrix, robot.wheel_radii)
    n = len(robot.wheel_matrix)
    read = printed @ (robot.wheel_matrix @ twist)
    vx, vy, yaw_rate = twist
    np.testing.assert_allclose(read, [n / 2 * vx, n / 2 * vy, n * yaw_rate], atol=1e-9)


# Saturation.


@given(
    robot=st.sampled_from([*ROBOTS.values()]), twist=TWISTS, limit=st.floats(0.5, 60.0),
    turn_limit=st.floats(0.1, 10.0) | st.just(math.inf),
)  # fmt: skip
def test_saturation_keeps_direction_and_is_no_tighter_than_it_must(
    robot: Robot, twist: tuple[float, float, float], limit: float, turn_limit: float
) -> None:
    sheet = plant(robot, robot.actuators("lagged"), 0.05)
    sheet["wheel_speed_limit"], sheet["turn_speed"] = limit, turn_limit
    factor = saturation_factor(sheet[0], *twist)
    # how many times too fast the wheels would turn, and the base
    over = max(np.abs(robot.wheel_matrix @ twist).max() / limit, abs(twist[2]) / turn_limit)
    assert 0.0 < factor <= 1.0
    if over <= 1.0 - 1e-12:
        assert factor == 1.0
    else:
        assert factor * over == pytest.approx(1.0)


# Acceleration and lag.


@given(TWISTS, TWISTS, st.floats(0.1, 5.0), st.floats(0.1, 9.0), st.floats(0.01, 0.2))
def test_acceleration_limits(
    twist: tuple[float, float, float],
    wanted: tuple[float, float, float],
    acceleration: float,
    yaw_acceleration: float,
    dt: float,
) -> None:
    got = np.array(limit_acceleration(twist, wanted, acceleration, yaw_acceleration, dt))
    change, asked = got - twist, np.subtract(wanted, twist)
    speed, asked_speed = np.hypot(*change[:2]), np.hypot(*asked[:2])
    assert speed == pytest.approx(min(asked_speed, acceleration * dt), abs=1e-12)
    # along the wanted change, not along an axis of its own
    assert abs(change[0] * asked[1] - change[1] * asked[0]) <= 1e-9
    assert change[:2] @ asked[:2] >= 0.0
    assert change[2] == pytest.approx(np.clip(asked[2], -yaw_acceleration * dt, yaw_acceleration * dt), abs=1e-12)


def test_no_limit_is_no_limit() -> None:
    assert limit_acceleration((0.0, 0.0, 0.0), (5.0, -2.0, 60.0), math.inf, math.inf, 0.05) == (5.0, -2.0, 60.0)


@given(TWISTS, st.floats(0.05, 2.0), st.integers(0, 100))
def test_a_steered_base_turns_on_no_smaller_radius_than_its_own(
    wanted: tuple[float, float, float], radius: float, seed: int
) -> None:
    car = dataclasses.replace(ROBOTS["p3dx"], name="car", turning_radius=radius)
    sheet = plant(car, car.actuators("lagged"), 0.05)[0]
    last = (0.0, 0.0, 0.0)
    for turn in np.random.default_rng(seed).uniform(-2.0, 2.0, 40):
        *last, _ = limits(sheet, tuple(last), (wanted[0], 0.0, wanted[2] + turn), 0.05)
        assert abs(last[2]) * radius <= abs(last[0]) * (1.0 + 1e-12)
        assert abs(last[2]) <= car.max_twist[1] * (1.0 + 1e-12)
    fastest = car.max_twist[1]
    assert saturation_factor(sheet, radius * fastest, 0.0, fastest) == pytest.approx(1.0)
    assert saturation_factor(sheet, 1.01 * radius * fastest, 0.0, 1.01 * fastest) < 0.999


@given(st.floats(0.01, 2.0), st.floats(0.001, 0.5))
def test_lag_factors_are_those_of_a_first_order_response(lag: float, dt: float) -> None:
    decay, mean = lag_factors(lag, dt)
    t = np.linspace(0.0, dt, 20_001)
    deviation = np.exp(-t / lag)
    assert decay == pytest.approx(deviation[-1])
    assert mean == pytest.approx(trapezoid(deviation, t) / dt, rel=1e-6)


def test_no_lag_leaves_no_deviation() -> None:
    assert lag_factors(0.0, 0.05) == (0.0, 0.0)
    assert ACTUATORS["ideal"].lag == 0.0


# Motion.


@given(POSES, TWISTS, st.floats(0.001, 1.0))
def test_integration_is_the_exponential_of_se2(
    pose: tuple[float, float, float], twist: tuple[float, float, float], dt: float
) -> None:
    vx, vy, yaw_rate = twist
    generator = np.array([[0.0, -yaw_rate, vx], [yaw_rate, 0.0, vy], [0.0, 0.0, 0.0]])
    moved = se2(*integrate_arc(*pose, *twist, dt))
    np.testing.assert_allclose(moved, se2(*pose) @ expm(dt * generator), atol=1e-10)


@given(st.floats(0.05, 3.0), st.floats(-5.0, 5.0).filter(lambda w: abs(w) > 1e-3), POSES)
def test_a_differential_drive_turns_around_its_icc(v: float, w: float, pose: tuple[float, float, float]) -> None:
    radius = v / w
    x, y, heading = pose
    centre = np.array([x - radius * math.sin(heading), y + radius * math.cos(heading)])
    for _ in range(5):
        x, y, heading = integrate_arc(x, y, heading, v, 0.0, w, 0.1)
        assert np.hypot(*(np.array([x, y]) - centre)) == pytest.approx(abs(radius), rel=1e-9)
        assert -math.pi < heading <= math.pi


@given(POSES, TWISTS)
def test_two_half_steps_make_a_step(pose: tuple[float, float, float], twist: tuple[float, float, float]) -> None:
    halfway = integrate_arc(*pose, *twist, 0.025)
    np.testing.assert_allclose(
        se2(*integrate_arc(*halfway, *twist, 0.025)), se2(*integrate_arc(*pose, *twist, 0.05)), atol=1e-12
    )


@given(st.floats(0.0, 1e-6))
def test_slow_turns_join_straight_lines_smoothly(yaw_rate: float) -> None:
    x, y, _ = integrate_arc(0.0, 0.0, 0.0, 2.0, 0.0, yaw_rate, 1.0)
    assert x == pytest.approx(2.0, abs=1e-11)
    assert y == pytest.approx(yaw_rate, abs=1e-11)


@given(st.floats(0.49, 0.51), st.floats(4.0, 8.0))
def test_both_branches_of_sinc_agree(angle: float, other: float) -> None:
    assert kinematics.sinc(angle) == pytest.approx(math.sin(angle) / angle, abs=4e-16)
    assert kinematics.sinc(other) == pytest.approx(math.sin(other) / other, abs=4e-16)


@given(POSES, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_points_in_the_body_frame(pose: tuple[float, float, float], px: float, py: float) -> None:
    x, y, heading = pose
    wanted = np.linalg.inv(se2(*pose)) @ (px, py, 1.0)
    got = to_body_frame(x, y, math.sin(heading), math.cos(heading), px, py)
    np.testing.assert_allclose(got, wanted[:2], atol=1e-12)
