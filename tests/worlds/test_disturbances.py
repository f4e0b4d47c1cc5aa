"""What is wrong with a robot moves it, delays it and blinds it as the sheet says; nothing wrong changes nothing."""

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.disturbances import DISTURBANCES, LEVELS, SHOVE_FROM, SHOVE_UNTIL, Disturbance
from wayfield.envs.robots.kinematics import integrate_arc

DT = 0.05
FREE = {"p3dx": "wayfield/DiffDriveGoalObstacles-v0", "omni3": "wayfield/OmniGoalObstacles-v0"}
FREE["omni4"] = FREE["omni3"]
every_plant = pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
every_robot = pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4"])


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Returns a function that makes a robot in the open with something wrong, its goal far away."""

    def made(robot: str, wrong: Disturbance | str, *, obstacles: Any = (), **kwargs: Any) -> Any:
        file = tmp_path / "open.json"
        file.write_text(json.dumps({"goal": [90.0, 90.0, 0.0], "obstacles": obstacles}))
        if isinstance(wrong, Disturbance):
            monkeypatch.setitem(DISTURBANCES, "made", wrong)
            wrong = "made"
        env: Any = gymnasium.make(FREE[robot], robot=robot, scenario=str(file), disturbance=wrong, **kwargs).unwrapped
        env.reset(seed=0)
        return env

    return made


def pose(env: Any) -> NDArray[np.float64]:
    state = env.batch.states[0]
    return np.array([state["x"], state["y"], state["heading"]])


def drive(env: Any, twist: Any, steps: int) -> NDArray[np.float64]:
    """Returns the pose after that many steps of a twist (v_x, v_y, yaw rate)."""
    action = np.array(twist, np.float64)[list(env.task.robot.twist_axes)]
    for _ in range(steps):
        env.step(action)
    return pose(env)


# The ladder.


@every_plant
def test_every_rung_drives_further_off(make: Any, dynamics: str) -> None:
    ends = []
    for name in LEVELS:
        wrong = dataclasses.replace(DISTURBANCES[name], shove=0.0)
        ends.append(drive(make("omni3", wrong, dynamics=dynamics, actuators="lagged"), (0.5, 0.1, 0.4), 60))
    off = [np.hypot(*(end - ends[0])[:2]) for end in ends]
    assert all(low < high for low, high in itertools.pairwise(off))


# Wheels.


@every_plant
@pytest.mark.parametrize("error", [0.01, 0.03, -0.02])
def test_unequal_wheels_drive_a_circle_of_the_exact_radius(make: Any, dynamics: str, error: float) -> None:
    speed, steps = 0.5, 80
    env = make("p3dx", Disturbance(wheel_radius_error=error), dynamics=dynamics, actuators="lagged")
    x, y, heading = drive(env, (speed, 0.0, 0.0), steps)
    # right wheel r (1 + e), left r (1 - e): the middle rolls at v, about a point half a track over e to the left
    radius = 0.381 / 2.0 / error
    assert x == pytest.approx(radius * math.sin(heading), abs=1e-9)
    assert y == pytest.approx(radius * (1.0 - math.cos(heading)), abs=1e-9)
    gone = speed * steps * DT - speed**2 / 2.0 - speed * 0.1
    assert heading == pytest.approx(gone / radius, rel=1e-2)


@every_plant
@every_robot
def test_a_wide_track_turns_less(make: Any, robot: str, dynamics: str) -> None:
    env = make(robot, Disturbance(track_error=0.04), dynamics=dynamics)
    turned = drive(env, (0.0, 0.0, 0.5), 40)[2]
    # a traction limit bends only the start in the physics engine
    assert turned == pytest.approx(1.0 / 1.04, abs=1e-9 if dynamics == "kinematic" else 0.05)
    x, y, heading = drive(make(robot, Disturbance(track_error=0.04)), (0.5, 0.0, 0.0), 40)
    assert (x, y, heading) == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("robot", ["omni3", "omni4"])
def test_an_omni_base_moves_by_the_least_squares_of_its_wheels(make: Any, robot: str) -> None:
    error, twist = 0.02, np.array([0.3, -0.2, 0.4])
    env = make(robot, Disturbance(wheel_radius_error=error))
    drive(env, twist, 1)
    each = ROBOTS[robot]
    signs = np.array([1.0, -1.0, 1.0, -1.0])[: len(each.wheel_matrix)]
    true = each.wheel_matrix / (1.0 + signs * error)[:, None]
    state = env.batch.states[0]
    residual = each.wheel_matrix @ twist - true @ [state["vx"], state["vy"], state["yaw_rate"]]
    np.testing.assert_allclose(true.T @ residual, 0.0, atol=1e-12)
    # three wheels all roll, four have to slip
    assert (np.abs(residual).max() < 1e-12) == (robot == "omni3")


# Slip.


@every_plant
@every_robot
@pytest.mark.parametrize("slip", [0.02, 0.15])
def test_slip_is_the_share_of_the_way_that_is_lost(make: Any, robot: str, dynamics: str, slip: float) -> None:
    nominal = make(robot, "none", dynamics=dynamics, actuators="lagged")
    env = make(robot, Disturbance(slip=slip), dynamics=dynamics, actuators="lagged", pose_source="odometry")
    wanted, got = (drive(each, (0.4, 0.0, 0.0), 60) for each in (nominal, env))
    assert got[0] == pytest.approx((1.0 - slip) * wanted[0], abs=1e-9)
    believed = env.batch.states["measured_x"][0]
    passive = bool(ROBOTS[robot].encoders)
    assert believed == pytest.approx(got[0] if passive else wanted[0], abs=1e-9)


@pytest.mark.parametrize("robot", ["omni3", "omni4"])
@pytest.mark.parametrize("yaw_rate", [0.8, -0.5])
@pytest.mark.parametrize(("vx", "vy"), [(0.5, 0.0), (0.0, 0.5), (-0.3, 0.4)])
def test_side_slip_of_an_omni_base_is_against_its_centripetal_acceleration(
    make: Any, robot: str, yaw_rate: float, vx: float, vy: float
) -> None:
    seconds = 0.05
    got = drive(make(robot, Disturbance(side_slip=seconds)), (vx, vy, yaw_rate), 30)
    # w x v is (-w vy, w vx)
    drifting = vx + seconds * yaw_rate * vy, vy - seconds * yaw_rate * vx
    assert got == pytest.approx(integrate_arc(0.0, 0.0, 0.0, *drifting, yaw_rate, 1.5), abs=1e-9)


@pytest.mark.parametrize("yaw_rate", [0.8, -0.5])
def test_side_slip_drifts_outwards(make: Any, yaw_rate: float) -> None:
    seconds, speed = 0.05, 0.6
    env = make("p3dx", Disturbance(side_slip=seconds))
    got = drive(env, (speed, 0.0, yaw_rate), 30)
    wanted = integrate_arc(0.0, 0.0, 0.0, speed, -seconds * yaw_rate * speed, yaw_rate, 1.5)
    assert got == pytest.approx(wanted, abs=1e-9)
    # the circle is wider by the angle that the body drifts at
    assert math.hypot(1.0, seconds * yaw_rate) > 1.0
    straight = drive(make("p3dx", Disturbance(side_slip=seconds)), (speed, 0.0, 0.0), 30)
    assert straight == pytest.approx((0.9, 0.0, 0.0), abs=1e-9)


@every_robot
def test_both_plants_agree_on_what_is_wrong_while_wheels_grip(make: Any, robot: str) -> None:
    wrong = dataclasses.replace(DISTURBANCES["severe"], shove=0.0)
    kinematic, pymunk = (
        make(robot, wrong, dynamics=name, actuators="lagged", pose_source="odometry")
        for name in ("kinematic", "pymunk")
    )
    rng = np.random.default_rng(0)
    for _ in range(20):
        twist = rng.uniform(-0.3, 0.3, 3)
        for env in (kinematic, pymunk):
            drive(env, twist, 8)
        np.testing.assert_allclose(pose(pymunk), pose(kinematic), rtol=0.0, atol=1e-9)
        for name in ("measured_x", "measured_y", "measured_heading", "measured_vx"):
            assert pymunk.batch.states[name][0] == pytest.approx(kinematic.batch.states[name][0], abs=1e-9)


def test_the_measured_twist_is_what_encoders_read(make: Any) -> None:
    env = make("p3dx", Disturbance(slip=0.1, wheel_radius_error=0.02))
    drive(env, (0.5, 0.0, 0.2), 5)
    state = env.batch.states[0]
    assert (state["measured_vx"], state["measured_yaw_rate"]) == pytest.approx((0.5, 0.2))
    assert state["vx"] < 0.46
    # the pose stays the true one
    assert (state["measured_x"], state["measured_y"]) == (state["x"], state["y"])


# Readings.


@pytest.mark.parametrize("share", [0.02, 0.2])
def test_beams_drop_out_at_their_rate(make: Any, share: float) -> None:
    around = [{"kind": "wall", "x1": -3, "y1": y, "x2": 3, "y2": y} for y in (-2.0, 2.0)]
    around += [{"kind": "wall", "x1": x, "y1": -3, "x2": x, "y2": 3} for x in (-2.0, 2.0)]
    env = make("omni3", Disturbance(range_dropout=share), obstacles=around, num_beams=64, max_range=9.0)
    scans = np.array([env.step(np.zeros(3))[0][-64:] for _ in range(600)])
    true = env.task.layout.unpack(make("omni3", "none", obstacles=around, num_beams=64, max_range=9.0).reset()[0][None])
    dropped = scans == 9.0
    n = dropped.size
    assert abs(dropped.mean() - share) < 5.0 * math.sqrt(share * (1.0 - share) / n)
    # each beam for itself, anew in every step
    for a, b in ((dropped[:, :-1], dropped[:, 1:]), (dropped[:-1], dropped[1:])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 5.0 / math.sqrt(n)
    # the others read what is there
    assert (scans == true.ranges)[~dropped].all()


# Delay.


@every_plant
@every_robot
@pytest.mark.parametrize("steps", [1, 2, 3])
def test_a_command_acts_exactly_so_many_steps_later(make: Any, robot: str, dynamics: str, steps: int) -> None:
    prompt = make(robot, "none", dynamics=dynamics, actuators="lagged")
    late = make(robot, f"delay_{steps}", dynamics=dynamics, actuators="lagged")
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1.0, 1.0, prompt.action_space.shape) * prompt.action_space.high for _ in range(30)]
    poses = [pose(prompt)] * steps
    for action in actions:
        prompt.step(action)
        poses.append(pose(prompt))
    for _ in range(2):
        late.reset(seed=0)  # what was asked before is forgotten
        for action, wanted in zip(actions, poses, strict=False):
            late.step(action)
            assert pose(late).tolist() == wanted.tolist()


def test_a_delay_does_not_hide_a_bad_action(make: Any) -> None:
    env, calm = (make("p3dx", "delay_2") for _ in range(2))
    for k in range(12):
        if k == 5:
            for bad in (math.nan, math.inf):
                with pytest.raises(ValueError, match=r"of robot 0 is not finite"):
                    env.step(np.array([0.1, bad]))
        action = np.array([0.1 * k, 0.3])
        assert env.step(action)[0].tobytes() == calm.step(action)[0].tobytes()


# Shoves.


def test_drawn_shoves_go_anywhere_at_any_time(make: Any) -> None:
    """Evenly over the whole circle, wrap-around counted, and over the time between the first and the last."""
    env: Any = gymnasium.make_vec(
        FREE["omni3"], 600, vectorization_mode="vector_entry_point", disturbance="shove", scenario="open_field"
    ).unwrapped
    env.reset(seed=0)
    before = env.batch.states.copy()
    angles, times = np.full(600, np.nan), np.full(600, np.nan)
    for k in range(round(SHOVE_UNTIL / DT) + 1):
        env.step(np.zeros((600, 3), np.float32))
        now = env.batch.states
        dx, dy = now["x"] - before["x"], now["y"] - before["y"]
        moved = np.hypot(dx, dy) > 0.0
        angles[moved], times[moved] = np.arctan2(dy, dx)[moved], k * DT
        before = now.copy()
    ordered = np.sort(angles)
    assert np.diff([*ordered, ordered[0] + 2.0 * math.pi]).max() < 0.12
    # the mean direction of n even ones is of the order of 1 / sqrt(n)
    assert np.hypot(np.cos(angles).mean(), np.sin(angles).mean()) < 3.0 / math.sqrt(600)
    assert SHOVE_FROM <= times.min() < SHOVE_FROM + 0.1
    assert SHOVE_UNTIL - 0.1 < times.max() <= SHOVE_UNTIL
    assert abs(np.corrcoef(times, np.cos(angles))[0, 1]) < 0.15


def test_a_shove_is_drawn_only_where_there_is_one() -> None:
    observations = []
    for name in ("none", "wheel_error", "shove"):
        env = gymnasium.make(FREE["omni3"], disturbance=name)
        env.reset(seed=3)
        observations.append(env.reset()[0][:3].tolist())
    assert observations[0] == observations[1] != observations[2]


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_drifts_go_as_far_as_their_integral_and_wheels_do_not_see_them(dynamics: str) -> None:
    """A gust ends 0.1 m away; what swings is away by 0.05 m/s (1 - cos) / omega, and comes back after 4 s."""
    for name in ("gust", "periodic"):
        env: Any = gymnasium.make(FREE["omni3"], disturbance=name, dynamics=dynamics, scenario="open_field").unwrapped
        env.reset(seed=1)
        state = env.batch.states[0]
        begin = complex(state["x"], state["y"])
        first, way = int(state["shove_step"]), np.exp(1j * state["shove_direction"])
        for k in range(first + 100):
            env.step(np.zeros(3, np.float32))
            t = max(k + 1 - first, 0) * DT
            gone = 0.05 * min(t, 2.0) if name == "gust" else 0.05 * (1.0 - math.cos(0.5 * math.pi * t)) * 2.0 / math.pi
            assert abs(complex(state["x"], state["y"]) - begin - gone * way) < 2e-5
        assert abs(complex(state["odometry_x"], state["odometry_y"]) - begin) < 1e-12
