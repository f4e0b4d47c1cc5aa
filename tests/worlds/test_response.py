"""Bases with a delay and a response of their own: the plants against the equations, integrated in steps of 0.1 ms."""

import contextlib
import copy
import dataclasses
import itertools
import math
import pickle
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from wayfield.envs.robots import ROBOTS, Actuators, Robot
from wayfield.envs.robots.response import respond
from wayfield.envs.vector import NativeVectorEnv
from wayfield.policies import Pilot, make

DT = 0.05
FINE = 1e-4  # s
IDS = {False: "wayfield/DiffDriveGoalObstacles-v0", True: "wayfield/OmniGoalObstacles-v0"}


@pytest.fixture(autouse=True, scope="module")
def _open_field(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Makes this folder the working one: it holds a scenario in the open, far from its goal."""
    folder = tmp_path_factory.mktemp("open")
    (folder / "open.json").write_text('{"goal": [900, 900, 0]}', encoding="utf-8")
    with contextlib.chdir(folder):
        yield


HEAVY = dataclasses.replace(  # a skid steer with the numbers of a real one
    ROBOTS["jackal"],
    name="heavy",
    acceleration=3.3,
    yaw_acceleration=7.0,
    turn_speed=math.inf,
    lag=(0.25, 0.30),
    delay=(0.30, 0.26),
    gain=(1.01, 0.77),
    decelerations=(4.5, 5.0),
    saturation="wheels",
    response="continuous",
)
ROUND = dataclasses.replace(
    ROBOTS["omni4"], name="round", lag=(0.1, 0.12, 0.05), delay=(0.03, 0.08, 0.2), response="continuous"
)
QUICK = dataclasses.replace(ROBOTS["p3dx"], name="quick", delay=(0.13, 0.06), lag=0.0, response="continuous")


def world(robot: Robot, num_envs: int = 1, **options: Any) -> NativeVectorEnv:
    """Returns robots in the open, far from everything."""
    env = gymnasium.make_vec(
        IDS[robot.holonomic],
        num_envs,
        vectorization_mode="vector_entry_point",
        robot=robot,
        scenario="open.json",
        actuators=options.pop("actuators", "lagged"),
        max_episode_steps=None,
        **options,
    )
    assert isinstance(env, NativeVectorEnv)
    env.reset(seed=0)
    return env


def drive(robot: Robot, commands: NDArray[np.float64], **options: Any) -> tuple[NDArray[np.float64], ...]:
    """Returns wheel twists, references and poses (n, 3) at the ends of the periods of commands (n, axes)."""
    env = world(robot, **options)
    states = env.batch.states
    names = ("vx", "vy", "yaw_rate")
    found = []
    for command in commands:
        env.step(command[None])
        found.append(
            [
                *(states[f"wheel_{name}"][0] for name in names),
                *(states[f"command_{name}"][0] for name in names),
                *(states[name][0] for name in ("x", "y", "heading")),
            ]
        )
    told = np.array(found)
    return told[:, :3], told[:, 3:6], told[:, 6:]


def steps(robot: Robot, count: int, seed: int, hold: int = 7, most: float = 1.6) -> NDArray[np.float64]:
    """Returns random commands, each held for some periods, some beyond the wheels."""
    rng = np.random.default_rng(seed)
    asked = rng.uniform(-most, most, (count // hold + 1, len(robot.twist_axes))) * robot.max_twist
    return np.repeat(asked, hold, axis=0)[:count]


def integrated(robot: Robot, commands: NDArray[np.float64], fine: float = FINE) -> tuple[NDArray[np.float64], ...]:
    """Returns what `drive` does by the equations in small steps: speeds and references after each, then the pose."""
    actuators: Actuators = robot.actuators("lagged")
    response = actuators.response
    assert response is not None
    limit = robot.rated_wheel_speed
    axes = list(robot.twist_axes)
    given = np.zeros((len(commands), 3))
    given[:, axes] = commands
    inverse = np.linalg.pinv(robot.wheel_matrix)
    each = round(DT / fine)
    reference, speed, pose = np.zeros(3), np.zeros(3), np.zeros(3)
    lags = np.maximum(response.lags, 1e-12)
    decay = np.exp(-fine / lags)
    found = []
    for k in range(len(commands) * each):
        time = (k + 0.5) * fine
        late = [math.floor((time - delay) / DT) for delay in response.delays]
        target = np.array([given[n, a] if n >= 0 else 0.0 for a, n in enumerate(late)]) * response.gains
        if response.wheel_saturation:
            target[2] = np.clip(target[2], -robot.turn_speed, robot.turn_speed)
            wheels = robot.wheel_matrix @ target
            if np.abs(wheels).max() > limit:
                target = inverse @ np.clip(wheels, -limit, limit)
        else:
            target = target / max(
                np.abs(robot.wheel_matrix @ target).max() / limit, abs(target[2]) / robot.turn_speed, 1
            )
        change = target - reference
        before = reference.copy()
        length = math.hypot(*change[:2])
        rate = response.deceleration if before[:2] @ change[:2] < 0 else actuators.acceleration
        reference[:2] += change[:2] * (min(1.0, rate * fine / length) if length > 0 else 0.0)
        rate = response.yaw_deceleration if before[2] * change[2] < 0 else actuators.yaw_acceleration
        reference[2] += np.clip(change[2], -rate * fine, rate * fine)
        middle = 0.5 * (before + reference)
        after = middle + (speed - middle) * decay
        vx, vy, yaw_rate = 0.5 * (speed + after)
        angle = pose[2] + 0.5 * fine * yaw_rate
        pose += fine * np.array([
            vx * math.cos(angle) - vy * math.sin(angle), vx * math.sin(angle) + vy * math.cos(angle), yaw_rate
        ])  # fmt: skip
        speed = after
        if k % each == each - 1:
            found.append([*speed, *reference, *pose])
    told = np.array(found)
    return told[:, :3], told[:, 3:6], told[:, 6:]


@pytest.mark.parametrize("robot", [HEAVY, ROUND, QUICK], ids=str)
def test_the_response_is_that_of_the_equations(robot: Robot) -> None:
    """Speeds within 1e-4 of their spread; the pose, on the arc of the mean twist, within 1 cm in 5 s."""
    commands = steps(robot, 100, seed=3)
    speeds, references, poses = drive(robot, commands)
    right_speeds, right_references, right_poses = integrated(robot, commands)
    for axis in (0, 2) if not robot.holonomic else range(3):
        spread = np.std(right_speeds[:, axis])
        assert np.sqrt(np.mean((speeds - right_speeds)[:, axis] ** 2)) < 1e-4 * spread * (10 if robot is QUICK else 1)
        assert np.sqrt(np.mean((references - right_references)[:, axis] ** 2)) < 1e-3 * spread
    turned = np.angle(np.exp(1j * (poses[:, 2] - right_poses[:, 2])))
    assert np.abs(turned).max() < 1e-3  # the steps' own: the arc's heading is exact
    away = poses[:, :2] - poses[0, :2] - (right_poses[:, :2] - right_poses[0, :2])
    print(robot, np.abs(away).max(), np.abs(turned).max())
    assert np.abs(away).max() < 0.01


def test_a_longer_delay_shifts_the_response() -> None:
    commands = steps(HEAVY, 120, seed=1)
    later = dataclasses.replace(HEAVY, delay=tuple(delay + 2 * DT for delay in HEAVY.delay))
    speeds, _, _ = drive(HEAVY, commands)
    late, _, _ = drive(later, commands)
    np.testing.assert_allclose(late[2:], speeds[:-2], atol=1e-12)
    # nothing comes before its time, and what comes then is small at first
    moved = np.flatnonzero(np.abs(speeds[:, 2]) > 0)[0]
    assert moved * DT < HEAVY.delay[1] < (moved + 1) * DT


def test_a_gain_scales_the_command() -> None:
    scaled = dataclasses.replace(HEAVY, gain=(0.5, 2.0))
    plain = dataclasses.replace(HEAVY, gain=())
    commands = steps(HEAVY, 80, seed=2)
    speeds, _, _ = drive(scaled, commands)
    np.testing.assert_allclose(speeds, drive(plain, commands * (0.5, 2.0))[0], atol=1e-12)


@given(
    before=st.tuples(st.floats(-1.5, 1.5), st.floats(-3.0, 3.0)),
    after=st.tuples(st.floats(-1.5, 1.5), st.floats(-3.0, 3.0)),
    lag=st.sampled_from([0.0, 1e-6, 0.1, 0.3]),
    delay=st.floats(0.0, 0.3),
    slower=st.floats(0.2, 5.0),
)
@settings(deadline=None, max_examples=40)
def test_no_step_overshoots_and_no_speed_changes_faster_than_it_may(
    before: tuple[float, float], after: tuple[float, float], lag: float, delay: float, slower: float
) -> None:
    quick = ROBOTS["p3dx"].acceleration, ROBOTS["p3dx"].yaw_acceleration
    robot = dataclasses.replace(
        ROBOTS["p3dx"],
        name="any",
        lag=(lag, lag),
        delay=(delay, delay),  # with two, wheels clip one axis while the other's command is under way
        decelerations=(quick[0] * slower, quick[1] * slower),
        saturation="wheels",
        response="continuous",
    )
    commands = np.repeat([[0.0, 0.0], before, after], [1, 60, 60], axis=0)
    speeds, references, _ = drive(robot, commands)
    for axis, most in ((0, quick[0] * max(slower, 1.0)), (2, quick[1] * max(slower, 1.0))):
        assert np.abs(np.diff(speeds[:, axis])).max() <= most * DT * (1.0 + 1e-9) + 1e-12
        assert np.abs(np.diff(references[:, axis])).max() <= most * DT * (1.0 + 1e-9) + 1e-12
        for part in references[1:60, axis], references[60:, axis]:
            # monotone, on the way from one command to the next by a twist that wheels may clip meanwhile
            assert np.abs(part).max() <= max(abs(part[0]), np.abs(references[[59, -1], axis]).max()) + 1e-9
        lowest, highest = references[:, axis].min(), references[:, axis].max()
        assert lowest - 1e-9 <= speeds[:, axis].min()
        assert speeds[:, axis].max() <= highest + 1e-9


@pytest.mark.parametrize("robot", [HEAVY, ROUND, QUICK], ids=str)
def test_a_period_cut_anywhere_is_the_same(robot: Robot) -> None:
    """The closed form holds for any steps: two ways through the same period end alike, and their ways add up."""
    env = world(robot)
    rng = np.random.default_rng(5)
    for command in steps(robot, 60, seed=4, hold=3):
        env.step(command[None])
        twin = copy.deepcopy(env.batch)
        whole = respond(env.batch.task.params[0], env.batch.states[0], env.batch.columns, 0, 0.0, DT)
        cuts = [0.0, *np.sort(rng.uniform(0.0, DT, 3)), DT]
        way = np.zeros(3)
        for begin, end in itertools.pairwise(cuts):
            part = respond(twin.task.params[0], twin.states[0], twin.columns, 0, begin, end)
            way += (end - begin) * np.array(part)
        np.testing.assert_allclose(way, DT * np.array(whole), atol=1e-12)
        for name in ("wheel_vx", "wheel_vy", "wheel_yaw_rate", "command_vx", "command_vy", "command_yaw_rate"):
            assert twin.states[name][0] == pytest.approx(env.batch.states[name][0], abs=1e-12)


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_a_stepped_delay_is_that_of_the_disturbance(dynamics: str) -> None:
    """Whole periods on both axes, and nothing else on the sheet: as if the command were late."""
    robot = dataclasses.replace(ROBOTS["p3dx"], name="late", delay=(0.09, 0.11))  # to the nearest period
    commands = steps(robot, 100, seed=6)
    found = drive(robot, commands, dynamics=dynamics)
    wanted = drive(ROBOTS["p3dx"], commands, dynamics=dynamics, disturbance="delay_2")
    for mine, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-9)


def test_the_tier_ideal_has_no_delay() -> None:
    commands = steps(HEAVY, 40, seed=8)
    names = ("lag", "delay", "gain", "decelerations", "saturation", "response")
    plain = dataclasses.replace(HEAVY, **{name: getattr(ROBOTS["p3dx"], name) for name in names})
    for mine, other in zip(
        drive(HEAVY, commands, actuators="ideal"), drive(plain, commands, actuators="ideal"), strict=True
    ):
        np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
@pytest.mark.parametrize("robot", [HEAVY, ROUND], ids=str)
def test_rows_copies_and_single_robots_are_alike(robot: Robot, dynamics: str) -> None:
    """A row, resets in between, equals a lone robot; a pickle in mid-episode goes on as what it was made from."""
    options: dict[str, Any] = {
        "robot": robot, "dynamics": dynamics, "actuators": "lagged", "noise": 1.0, "disturbance": "moderate",
        "scenario": "rooms/test" if robot.hull_radius <= 0.3 else "open.json", "max_episode_steps": 40,
    }  # fmt: skip
    many = gymnasium.make_vec(IDS[robot.holonomic], 3, vectorization_mode="vector_entry_point", **options)
    alone = gymnasium.make(IDS[robot.holonomic], **options)
    seen, _ = many.reset(seed=5)
    lone, _ = alone.reset(seed=6)
    over = False
    rng = np.random.default_rng(1)
    for k in range(90):
        if k == 55:
            many = pickle.loads(pickle.dumps(many))
        actions = rng.uniform(-1.0, 1.0, many.action_space.shape) * many.action_space.high  # type: ignore[operator, attr-defined]
        seen, *_ = many.step(actions)
        if over:
            lone, _ = alone.reset()
            over = False
        else:
            lone, _, ended, cut, _ = alone.step(actions[1])
            over = ended or cut
        np.testing.assert_array_equal(seen[1], lone)


def test_a_simulator_of_its_own_refuses_such_a_base() -> None:
    with pytest.raises(ValueError, match="robot 'heavy' has a delay or a response of its own"):
        gymnasium.make(IDS[False], robot=HEAVY, dynamics="coppelia", actuators="lagged")


def test_who_knows_of_the_delay_brakes_in_time() -> None:
    """Clutter, and a base that is late by a quarter of a second and brakes slower than it speeds up."""
    robot = dataclasses.replace(
        ROBOTS["p3dx"],
        name="late",
        acceleration=0.7,
        lag=(0.18, 0.15),
        delay=(0.25, 0.25),
        decelerations=(0.5, 2.0),
        saturation="wheels",
        response="continuous",
    )
    count = 12
    env = gymnasium.make_vec(
        IDS[False],
        count,
        vectorization_mode="vector_entry_point",
        robot=robot,
        scenario="clutter_10/train",
        actuators="lagged",
        num_beams=72,
        max_episode_steps=800,
    )
    pilot = Pilot(make("scan_planner"), env)
    observations, _ = env.reset(seed=0, options={"scenario": np.arange(count)})
    pilot.reset()
    over, hit = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    while not over.all():
        observations, _, terminated, truncated, info = env.step(pilot.command(observations))
        hit |= info["collision"] & ~over
        over |= terminated | truncated
    assert hit.sum() <= 3  # of those who do not know of it more than half touch something
