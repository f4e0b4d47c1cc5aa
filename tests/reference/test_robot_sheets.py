"""Robots in plain Python: what follows from a data sheet, and how far it may go in a sub-step."""

import cmath
import dataclasses
import json
import math
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wayfield.bridges.coppelia.sandbox import Sandbox
from wayfield.envs.robots import (
    ACTUATORS,
    ROBOTS,
    Robot,
    Wheel,
    read_robot,
)
from wayfield.envs.robots.records import POSE_SOURCES, odometry_matrices

PAIR: dict[str, Any] = {
    "drive": "differential", "wheels": {"radius": 0.05, "track": 0.3}, "hull": {"radius": 0.25}, "mass": 9.0,
    "inertia": 0.3, "friction": 0.8, "rated_wheel_speed": 12.0,
}  # fmt: skip
RING = [{"x": 0.2 * math.cos(a), "y": 0.2 * math.sin(a), "direction": a - 1.5, "radius": 0.05} for a in (0.5, 2.5, 4.5)]
OMNI: dict[str, Any] = PAIR | {"drive": "omni", "wheels": RING}


def read(folder: Path, content: dict[str, Any], name: str = "mine.json") -> Robot:
    (folder / name).write_text(json.dumps(content), encoding="utf-8")
    return read_robot(str(folder / name))


def test_a_skid_steer_is_built_narrower_than_it_turns(tmp_path: Path) -> None:
    wheels = {"radius": 0.05, "track": 0.3}
    wide = read(tmp_path, PAIR | {"wheels": wheels | {"effective_track": 0.4}})
    assert [wheel.y for wheel in wide.wheels] == [-0.2, 0.2]
    assert [(wheel.x, wheel.y) for wheel in wide.built] == [(0.0, -0.15), (0.0, 0.15)]
    long = read(tmp_path, PAIR | {"wheels": wheels | {"wheelbase": 0.2}})
    corners = {(x, y) for x in (-0.1, 0.1) for y in (-0.15, 0.15)}
    assert {(wheel.x, wheel.y) for wheel in long.built} == corners
    assert [wheel.y for wheel in long.wheels] == [-0.15, 0.15]
    # made in Python: without a track, its wheels stand where they act
    bare = dataclasses.replace(long, track=None)
    assert {(wheel.x, wheel.y) for wheel in bare.built} == corners
    assert dataclasses.replace(long, track=None, wheelbase=0.0).built == long.wheels
    for drive, more in (("omni", {"track": 0.3}), ("omni", {"wheelbase": 0.2})):
        with pytest.raises(ValueError, match="belong to the drive differential"):
            dataclasses.replace(ROBOTS["omni3"], name="odd", drive=drive, **more)


@pytest.mark.parametrize("name", ROBOTS)
def test_wheels_turn_as_fast_as_their_contact_points_move(name: str) -> None:
    robot = ROBOTS[name]
    rng = np.random.default_rng(1)
    for _ in range(5):
        twist = rng.normal(size=3) * (1.0, robot.holonomic, 1.0)
        speeds = robot.wheel_speeds_from_twist(twist[list(robot.twist_axes)])
        for wheel, speed in zip(robot.wheels, speeds, strict=True):
            velocity = complex(*twist[:2]) + 1j * twist[2] * complex(wheel.x, wheel.y)
            axis = cmath.rect(1.0, wheel.direction + wheel.roller_angle)
            held = (velocity * axis.conjugate()).real  # what the roller does not let go by
            assert wheel.radius * math.cos(wheel.roller_angle) * speed == pytest.approx(held, abs=1e-12)
    units = np.eye(len(robot.twist_axes))
    most = [robot.rated_wheel_speed / np.abs(robot.wheel_speeds_from_twist(unit)).max() for unit in units]
    assert robot.max_twist == pytest.approx([*most[:-1], min(most[-1], robot.turn_speed)])
    assert robot.forward_matrix == pytest.approx(np.linalg.pinv(robot.wheel_matrix), abs=1e-12)
    assert robot.least_half == pytest.approx(min(robot.hull_box) / 2 if robot.hull_box else robot.hull_radius)
    for tier, (acceleration, yaw_acceleration, lag) in {"lagged": (1.0, 1.0, 1.0), "slow": (0.5, 0.5, 2.5)}.items():
        found = robot.actuators(tier)
        assert found.at_rated_speed
        assert found.acceleration == pytest.approx(acceleration * robot.acceleration)
        assert found.yaw_acceleration == pytest.approx(yaw_acceleration * robot.yaw_acceleration)
        assert found.lag == pytest.approx(lag * robot.lag)
    assert robot.actuators("ideal") == ACTUATORS["ideal"]


@pytest.mark.parametrize("drive", ["differential", "omni"])
def test_no_robot_goes_further_than_its_hull_in_a_sub_step(tmp_path: Path, drive: str) -> None:
    sheet = PAIR if drive == "differential" else OMNI
    robot = read(tmp_path, sheet)
    angles = np.linspace(0.0, math.pi, 20_001) if robot.holonomic else np.zeros(1)
    fastest = 12.0 / min(
        np.abs(robot.wheel_matrix[:, :2] @ (math.cos(angle), math.sin(angle))).max() for angle in angles
    )
    most = 12.0 * (0.25 / 0.01) / fastest
    assert read(tmp_path, sheet | {"peak_wheel_speed": 0.998 * most}).peak_wheel_speed > 12.0
    with pytest.raises(ValueError, match=r"would go further than its hull\.radius in 0\.01 s"):
        read(tmp_path, sheet | {"peak_wheel_speed": 1.002 * most})


def test_the_plants_alone_drive_exactly_straight_whatever_the_wheels() -> None:
    rng = np.random.default_rng(0)
    p3dx, rounded = ROBOTS["p3dx"], np.zeros(3, int)
    for _ in range(60):
        radius, half = round(rng.uniform(0.05, 0.15), 4), round(rng.uniform(0.05, 0.19), 4)
        wheels = tuple(dataclasses.replace(each, radius=radius, y=math.copysign(half, each.y)) for each in p3dx.wheels)
        robot = dataclasses.replace(p3dx, wheels=wheels)
        exact = [[0.5 * radius] * 2, [0.0, 0.0], [radius / (2.0 * half), -radius / (2.0 * half)]]
        rounded += np.array(robot.forward_matrix != exact).any(axis=1)
        sandbox = Sandbox(robot, "kinematic", "lagged", 0.05, 0, False)
        assert sandbox.params["forward_matrix"][0, :3, :2].tolist() == exact
    assert min(rounded[0], rounded[2]) > 5  # of the pseudo-inverse


def test_a_robot_can_measure_its_pose_by_what_it_has() -> None:
    """Document B's two passive wheels, or the driven ones; the printed sum is of at most four omni wheels."""
    made = []
    for n in (4, 5):
        ways = [2.0 * math.pi * k / n for k in range(n)]
        wheels = tuple(Wheel(0.13 * math.cos(a), 0.13 * math.sin(a), 0.03, a + 0.5 * math.pi - math.pi) for a in ways)
        made.append(dataclasses.replace(ROBOTS["omni4"], name=f"ring{n}", wheels=wheels))
    for robot in (*ROBOTS.values(), *made):
        wanted = ["ground_truth", "odometry"]
        wanted += ["odometry_uncorrected"] * bool(robot.encoders)
        wanted += ["odometry_plain_sum"] * (robot.drive == "omni" and len(robot.wheels) <= 4)
        for source in POSE_SOURCES[1:]:
            with nullcontext() if source in wanted else pytest.raises(ValueError, match=source):
                odometry_matrices(robot, source)
