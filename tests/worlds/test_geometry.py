"""Angles against the C library, and the signed distance against the geometry it stands for."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from wayfield.envs.scenarios import box, circle, obstacle_field, wall
from wayfield.envs.world.geometry import beyond, clearance, clearance_to, nearest_surface
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

ANGLES = st.floats(-1e5, 1e5)
COORDINATES = st.floats(-5.0, 5.0).map(lambda value: round(value, 6))
SIZES = st.floats(0.05, 3.0)
BOXES = st.builds(box, COORDINATES, COORDINATES, SIZES, SIZES, st.floats(-7.0, 7.0))
CIRCLES = st.builds(circle, COORDINATES, COORDINATES, SIZES)
WALLS = st.builds(wall, COORDINATES, COORDINATES, st.floats(6.0, 9.0), COORDINATES)
OBSTACLES = st.one_of(CIRCLES, BOXES, WALLS)


@given(ANGLES)
def test_sin_cos_agrees_with_the_c_library(angle: float) -> None:
    sine, cosine = sin_cos(angle)
    # 2.3e-16 of our own and half a unit in the last place of the library's
    assert abs(sine - math.sin(angle)) <= 3.5e-16
    assert abs(cosine - math.cos(angle)) <= 3.5e-16


@pytest.mark.parametrize("quarter", range(-9, 10))
def test_sin_cos_at_quarter_turns(quarter: int) -> None:
    angle = quarter * math.pi / 2.0
    assert sin_cos(angle) == pytest.approx((math.sin(angle), math.cos(angle)), abs=3.5e-16)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_bearing_agrees_with_the_c_library(y: float, x: float) -> None:
    assume(max(abs(x), abs(y)) > 1e-290)
    # modulo the sign of a straight angle, 3e-16 of our own and one unit in the last place of pi/2 to pi
    assert abs(bearing(y, x) - math.atan2(y, x)) <= 5e-16


def test_the_zero_vector_has_bearing_zero() -> None:
    assert bearing(0.0, 0.0) == 0.0


@given(ANGLES)
def test_wrap_angle_keeps_the_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    turns = (angle - wrapped) / (2.0 * math.pi)
    # 1e5 rad have a spacing of 1.5e-11
    assert abs(turns - round(turns)) < 1e-11
    assert wrap_angle(wrapped) == wrapped


@given(st.integers(-1000, 1000), st.integers(-3, 3))
def test_wrap_angle_beside_odd_multiples_of_half_a_turn(multiple: int, steps: int) -> None:
    angle = (2 * multiple + 1) * math.pi
    for _ in range(abs(steps)):
        angle = math.nextafter(angle, math.copysign(math.inf, steps))
    assert -math.pi < wrap_angle(angle) <= math.pi


def test_half_a_turn_is_taken_to_the_left() -> None:
    assert wrap_angle(math.pi) == math.pi
    assert wrap_angle(-math.pi) == math.pi


@given(OBSTACLES, COORDINATES, COORDINATES)
def test_clearance_is_the_distance_to_the_nearest_point_outside(obstacle: np.void, x: float, y: float) -> None:
    axis = np.array([obstacle["cos"], obstacle["sin"]])
    offset = np.array([x - obstacle["x"], y - obstacle["y"]])
    along, across = offset @ axis, offset @ np.array([-axis[1], axis[0]])
    nearest = [
        np.clip(along, -obstacle["half_length"], obstacle["half_length"]),
        np.clip(across, -obstacle["half_width"], obstacle["half_width"]),
    ]
    gap = math.hypot(along - nearest[0], across - nearest[1])
    assume(gap > 0.0)
    assert clearance_to(obstacle, x, y) == pytest.approx(gap - obstacle["radius"], abs=1e-12)


@given(BOXES, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_clearance_inside_a_box_is_minus_the_depth(obstacle: np.void, u: float, v: float) -> None:
    along, across = u * obstacle["half_length"], v * obstacle["half_width"]
    x = obstacle["x"] + obstacle["cos"] * along - obstacle["sin"] * across
    y = obstacle["y"] + obstacle["sin"] * along + obstacle["cos"] * across
    depth = min(obstacle["half_length"] - abs(along), obstacle["half_width"] - abs(across))
    assert clearance_to(obstacle, x, y) == pytest.approx(-depth, abs=1e-12)


@given(st.lists(OBSTACLES, max_size=4), COORDINATES, COORDINATES, COORDINATES, COORDINATES)
def test_clearance_changes_by_at_most_a_metre_a_metre(
    obstacles: list[np.void], x: float, y: float, to_x: float, to_y: float
) -> None:
    field = obstacle_field(*obstacles)
    a, b = clearance(field, len(field), x, y), clearance(field, len(field), to_x, to_y)
    if not obstacles:
        assert a == b == math.inf
    else:
        assert abs(a - b) <= math.hypot(to_x - x, to_y - y) + 1e-12
        assert a == min(clearance_to(obstacle, x, y) for obstacle in field)


@given(OBSTACLES, COORDINATES, COORDINATES)
def test_the_normal_is_the_gradient_of_the_distance(obstacle: np.void, x: float, y: float) -> None:
    distance, nx, ny = nearest_surface(obstacle, x, y)
    assert distance == clearance_to(obstacle, x, y)
    assert math.hypot(nx, ny) == pytest.approx(1.0, abs=1e-12)
    h = 1e-6
    slope = (
        (clearance_to(obstacle, x + h, y) - clearance_to(obstacle, x - h, y)) / (2.0 * h),
        (clearance_to(obstacle, x, y + h) - clearance_to(obstacle, x, y - h)) / (2.0 * h),
    )
    # where the surface has two nearest points there is no gradient
    assume(math.hypot(*slope) > 1.0 - 1e-6)
    assert (nx, ny) == pytest.approx(slope, abs=1e-3)


@given(OBSTACLES, COORDINATES, COORDINATES)
def test_stepping_back_along_the_normal_ends_on_the_surface(obstacle: np.void, x: float, y: float) -> None:
    distance, nx, ny = nearest_surface(obstacle, x, y)
    assume(distance > 1e-9)
    assert clearance_to(obstacle, x - distance * nx, y - distance * ny) == pytest.approx(0.0, abs=1e-9)


@given(OBSTACLES, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(0.0, 6.0))
def test_what_is_passed_over_is_farther_away(obstacle: np.void, x: float, y: float, reach: float) -> None:
    assert not beyond(obstacle, x, y, reach) or clearance_to(obstacle, x, y) > reach


@given(SIZES, st.floats(-7.0, 7.0), st.floats(0.1, 3.0))
def test_a_corner_within_reach_is_not_passed_over(side: float, heading: float, reach: float) -> None:
    """A square stands with a corner towards the point, at nine tenths of the reach."""
    away = 0.9 * reach + 0.5 * math.sqrt(2.0) * side
    x, y = away * math.cos(heading + 0.25 * math.pi), away * math.sin(heading + 0.25 * math.pi)
    assert not beyond(box(0.0, 0.0, side, side, heading), x, y, reach)
