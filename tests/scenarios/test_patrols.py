"""Obstacles that move by themselves: where they are, what they hit, and who is told."""

import cmath
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios.obstacles import moving_circle
from wayfield.envs.world.movers import motion_at

DT = 0.05
GOAL_ID = "wayfield/OmniGoalObstacles-v0"
ID_OF = {"omni3": GOAL_ID, "omni4": GOAL_ID, "p3dx": "wayfield/DiffDriveGoalObstacles-v0"}
every_plant = pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
every_robot = pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4"])


def disc(x: float, y: float, vx: float, vy: float, leg_time: float, phase: float = 0.0) -> dict[str, Any]:
    patrol = {"vx": vx, "vy": vy, "leg_time": leg_time, "phase": phase}
    return {"kind": "circle", "x": x, "y": y, "radius": 0.3, "patrol": patrol}


# Beside, around and far from the origin, none of them over it.
CROWD = [
    disc(1.5, -2.0, 0.0, 0.6, 5.0),
    {"kind": "circle", "x": -2.0, "y": -2.0, "radius": 0.2},
    disc(-3.0, 2.0, 0.8, -0.3, 4.0, 2.5),
    disc(2.0, 2.0, -0.4, 0.1, 1.7, 20.0),
]


def scenario(folder: Path, *obstacles: dict[str, Any], **fields: Any) -> str:
    file = folder / "moving.json"
    file.write_text(json.dumps({"goal": [90.0, 90.0, 0.0], "obstacles": obstacles, **fields}))
    return str(file)


def made(file: str, robot: str = "omni3", **kwargs: Any) -> Any:
    """Returns a freshly reset environment that ends at no contact it can survive."""
    kwargs.setdefault("end_on_contact", kwargs.get("dynamics") != "pymunk")
    env: Any = gymnasium.make(ID_OF[robot], scenario=file, robot=robot, **kwargs).unwrapped
    env.reset(seed=0)
    return env


def place_of(patrol: dict[str, Any], x: float, y: float, time: float) -> tuple[float, float]:
    """Returns where a disc is: to and fro, a triangle wave."""
    part = (time + patrol.get("phase", 0.0)) % (2.0 * patrol["leg_time"])
    along = min(part, 2.0 * patrol["leg_time"] - part)
    return x + along * patrol["vx"], y + along * patrol["vy"]


@given(st.floats(0.01, 9.0), st.floats(0.0, 20.0), st.floats(0.0, 100.0))
def test_a_patrol_goes_to_and_fro(leg_time: float, phase: float, time: float) -> None:
    x, y, vx, vy = motion_at(moving_circle(1.0, -2.0, 0.3, 0.5, -1.5, leg_time, phase), time)
    wanted = place_of({"vx": 0.5, "vy": -1.5, "leg_time": leg_time, "phase": phase}, 1.0, -2.0, time)
    assert (x, y) == pytest.approx(wanted, abs=1e-6)
    assert abs(vx) == 0.5
    assert vy == -3.0 * vx


@every_plant
@every_robot
def test_obstacles_are_where_their_patrols_say(tmp_path: Path, robot: str, dynamics: str) -> None:
    env = made(scenario(tmp_path, *CROWD), robot, dynamics=dynamics)
    for _ in range(2):
        env.reset(seed=0)
        for k in range(150):
            for each, obstacle in zip(CROWD, env.batch.obstacles[0], strict=True):
                wanted = (each["x"], each["y"])
                if "patrol" in each:
                    wanted = place_of(each["patrol"], *wanted, k * DT)
                assert (obstacle["x"], obstacle["y"]) == pytest.approx(wanted, abs=1e-9)
            env.step(np.zeros(env.action_space.shape))


@every_plant
@pytest.mark.parametrize("sideways", [0.0, 1.5])  # m/s, to and fro: wheels that slip
def test_ranges_and_clearance_follow_what_moves(tmp_path: Path, sideways: float, dynamics: str) -> None:
    env = made(scenario(tmp_path, disc(4.0, 0.0, -0.5, 0.0, 4.0)), dynamics=dynamics, num_beams=4)
    for k in range(1, 100):
        observation, *_, info = env.step(np.array([0.0, sideways if k % 16 < 8 else -sideways, 0.0]))
        there = place_of({"vx": -0.5, "vy": 0.0, "leg_time": 4.0}, 4.0, 0.0, k * DT)[0]
        x, y, heading = env.batch.states[["x", "y", "heading"]][0]
        # the beam ahead ends on the disc, or passes it
        seen = complex(there - x, -y) * cmath.rect(1.0, -heading)
        ahead = seen.real - math.sqrt(0.09 - seen.imag**2) if abs(seen.imag) < 0.3 else env.task.max_range
        assert observation[-2] == pytest.approx(ahead, abs=1e-5)
        assert info["clearance"] == pytest.approx(math.hypot(there - x, y) - 0.6, abs=1e-9)


# What they hit.


@every_robot
@pytest.mark.parametrize("angle", np.linspace(-3.0, 3.0, 5))
def test_a_standing_robot_is_run_into(tmp_path: Path, robot: str, angle: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    env = made(scenario(tmp_path, disc(2.0 * c, 2.0 * s, -0.47 * c, -0.47 * s, 9.0)), robot)
    meets = (2.0 - 0.3 - ROBOTS[robot].hull_radius) / 0.47
    for k in range(1, 100):
        _, reward, terminated, _, info = env.step(np.zeros(env.action_space.shape))
        assert terminated == info["collision"] == (k * DT > meets)
        if terminated:
            break
    assert reward < -4.0
    assert -0.47 * DT <= info["clearance"] < 0.0
    state = env.batch.states[0]
    assert (state["x"], state["y"], state["vx"], state["yaw_rate"]) == (0.0, 0.0, 0.0, 0.0)


@every_plant
def test_who_drives_off_in_time_is_not_hit(tmp_path: Path, dynamics: str) -> None:
    # 0.9 m ahead of the disc: enough to speed up in
    file = scenario(tmp_path, disc(1.5, 0.0, -0.5, 0.0, 9.0))
    for speed, hit in ((-0.5, False), (-0.3, True), (0.0, True)):
        env = made(file, dynamics=dynamics, actuators="lagged")
        touched = False
        for _ in range(170):
            *_, info = env.step(np.array([speed, 0.0, 0.0]))
            touched = touched or info["collision"]
        assert touched == hit


def test_the_robot_sweeps_against_where_they_are_at_the_end_of_the_step(tmp_path: Path) -> None:
    # both meet head on: the disc first moves by 0.05 m, then the robot as far as it can
    env = made(scenario(tmp_path, disc(1.0, 0.0, -1.0, 0.0, 9.0)))
    for k in range(1, 20):
        *_, info = env.step(np.array([0.7, 0.0, 0.0]))
        gap = 0.4 - k * DT * 1.7
        if gap <= 0.0:
            break
        assert info["clearance"] == pytest.approx(gap, abs=1e-9)
    assert info["collision"]
    assert 0.0 <= info["clearance"] < 1e-6


@every_robot
def test_in_the_physics_engine_the_robot_is_pushed_along(tmp_path: Path, robot: str) -> None:
    env = made(scenario(tmp_path, disc(1.0, 0.0, -0.5, 0.0, 3.0)), robot, dynamics="pymunk", actuators="lagged")
    hull = ROBOTS[robot].hull_radius
    meets = (0.7 - hull) / 0.5
    state = env.batch.states[0]
    touched = 0
    for k in range(1, 59):
        *_, info = env.step(np.zeros(env.action_space.shape))
        touched += info["collision"]
        if k * DT > meets + DT:
            # in touch, at the speed of the disc: 1 - 0.5 t - 0.3 is its edge
            assert info["collision"]
            assert state["x"] == pytest.approx(0.7 - 0.5 * k * DT - hull, abs=1e-4)
            assert state["vx"] == pytest.approx(-0.5, abs=0.05)
        assert info["clearance"] > -1e-4
    assert touched > 10
    # the disc turns back at 3 s, and the robot stands again
    for _ in range(20):
        *_, info = env.step(np.zeros(env.action_space.shape))
    assert not info["collision"]
    assert state["vx"] == 0.0
    assert info["clearance"] > 0.2


@every_robot
def test_both_plants_agree_while_nothing_touches(tmp_path: Path, robot: str) -> None:
    file = scenario(tmp_path, *CROWD)
    envs = [made(file, robot, dynamics=name, actuators="lagged", num_beams=16) for name in ("kinematic", "pymunk")]
    for k in range(150):
        turn = 0.4 * math.sin(0.1 * k)
        action = np.array([0.15, turn] if robot == "p3dx" else [0.1, 0.1, turn])
        (a, *_, info), (b, *_) = (env.step(action) for env in envs)
        assert not info["collision"]
        np.testing.assert_allclose(a, b, atol=1e-6)
