"""Laws on bases that answer late: the state that a command will meet is predicted, and so is all that is observed."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.policies import Pilot, make
from wayfield.policies.learned.conditions import NewToAgent
from wayfield.policies.parts.forward_prediction import ForwardPrediction

PERIODS = 5  # of the delay
LATE = dataclasses.replace(ROBOTS["p3dx"], delay=(0.25, 0.25), gain=(0.9, 0.7), lag=(0.1, 0.15), decelerations=(0.7, 2))
PROMPT = dataclasses.replace(LATE, delay=(), gain=())
ALONG_PATHS = ("pure_pursuit", "regulated_pure_pursuit", "stanley", "lqr", "ilqr", "mpc", "lookahead_retuned")
TO_DOCKS = ("smooth_pose", "mpc_pose", "reeds_shepp", "polar")


def made(env_id: str, robot: Robot, num_envs: int = 3, **kwargs: Any) -> Any:
    """Returns a native vector, each row on a scenario of its own, with its first observations."""
    env: Any = gymnasium.make_vec(
        env_id, num_envs, vectorization_mode="vector_entry_point", robot=robot, actuators="lagged", **kwargs
    )
    seen, _ = env.reset(seed=3, options={"scenario": list(range(num_envs))})
    return env, seen


def poses_of(robot: Robot, name: str, steps: int) -> NDArray[np.float64]:
    """Returns the poses (steps + 1, 3, 3) of a law on three paths, or to three docks."""
    if name in ALONG_PATHS:
        env, seen = made("wayfield/DiffDrivePathFollowing-v0", robot, scenario="splines/train")
    else:
        env, seen = made("wayfield/DiffDriveDocking-v0", robot, scenario="open/train", end_on_success=False)
    pilot = Pilot(make(name), env)
    pilot.reset()
    poses = []
    for _ in range(steps + 1):
        poses.append([[state[each] for each in ("x", "y", "heading")] for state in env.batch.states])
        seen, *_ = env.step(pilot.command(seen))
    return np.array(poses)


@pytest.mark.parametrize("name", ALONG_PATHS + TO_DOCKS)
def test_a_late_base_drives_as_a_prompt_one_only_later(name: str) -> None:
    late = poses_of(LATE, name, 100)
    prompt = poses_of(PROMPT, name, 100 - PERIODS)
    np.testing.assert_allclose(late[PERIODS:], prompt, atol=2e-3)
    assert np.abs(prompt[-1, :, :2] - prompt[0, :, :2]).max() > 0.5


@pytest.mark.parametrize("response", ["stepped", "continuous"])
@pytest.mark.parametrize("saturation", ["twist", "wheels"])
def test_the_predicted_state_is_that_of_the_plant(response: str, saturation: str) -> None:
    delay = 0.25 if response == "stepped" else 0.225  # and half a period at a held reference
    robot = dataclasses.replace(LATE, delay=(delay, delay), response=response, saturation=saturation)
    env, seen = made("wayfield/DiffDriveGoalObstacles-v0", robot, scenario="open_fields/train")
    ahead = ForwardPrediction(env.briefing("sensors"))
    rng = np.random.default_rng(0)
    predicted = []
    for step in range(60):
        fields = env.task.layout.unpack(ahead.observed(seen))
        predicted.append(np.concatenate([fields.pose, fields.twist], axis=1))
        if step >= PERIODS:
            states = env.batch.states
            true = np.stack([states[each] for each in ("x", "y", "heading", "vx", "yaw_rate")], axis=1)
            error = np.abs(predicted[step - PERIODS] - true)
            # what is predicted holds the reference for half a period in which the plant ramps on
            slack = 1.0 if response == "continuous" else 0.0
            most = np.array([1e-5 + slack * 6e-4, 1e-5 + slack * 6e-4, 1e-5 + slack * 3e-3, 1e-5 + 0.03 * slack,
                             1e-5 + 0.1 * slack])  # fmt: skip
            assert (error < most).all()
        action = rng.uniform(-1.0, 1.0, (3, 2)) * (1.5, 4.0) * (step % 7 > 1)
        ahead.sent(action)
        seen, _, ended, *_ = env.step(action)
        assert not ended.any()


def test_the_predicted_scan_is_that_seen_from_there() -> None:
    env, seen = made("wayfield/DiffDriveGoalObstacles-v0", LATE, scenario="rooms/train", num_beams=72)
    ahead = ForwardPrediction(env.briefing("sensors"))
    errors, old = [], []
    predicted = []
    scans = []
    for step in range(40):
        predicted.append(env.task.layout.unpack(ahead.observed(seen)).ranges)
        scans.append(env.task.layout.unpack(seen).ranges)
        if step >= PERIODS:
            errors.append(np.abs(predicted[-1 - PERIODS] - scans[-1]))
            old.append(np.abs(scans[-1 - PERIODS] - scans[-1]))
        action = np.tile([0.5, 0.9 * np.sin(0.3 * step)], (3, 1))
        ahead.sent(action)
        seen, *_ = env.step(action)
    # walls are seen to the centimetre; behind edges nothing was seen
    assert np.median(errors) < 0.01 < 0.05 < np.mean(old)
    assert np.quantile(errors, 0.9) < 0.1


@pytest.mark.parametrize(("mine", "other"), [((0.4, 0.9), (0.0, 0.0)), ((0.0, 0.9), (0.3, 0.0))])
def test_the_predicted_bodies_are_those_seen_from_there(mine: Sequence[float], other: Sequence[float]) -> None:
    """Where another stands, and, turned on the spot, the velocity of one who drives."""
    pair = TeamScenario.made("pair", [(0.0, 0.0, 0.0), (1.5, 0.4, 2.0)], [(5.0, 0.0, 0.0), (0.0, 5.0, 0.0)])
    env: Any = gymnasium.make_vec(
        "wayfield/DiffDriveTeam-v0", 2, robot=LATE, actuators="lagged", scenario=pair, sees="bodies"
    )
    seen, _ = env.reset(seed=3)
    ahead = ForwardPrediction(env.briefing("bodies"))
    predicted, true = [], []
    for _ in range(60):
        predicted.append(env.task.layout.unpack(ahead.observed(seen)).bodies[0, 0])
        true.append(env.task.layout.unpack(seen).bodies[0, 0])
        action = np.array([mine, other])
        ahead.sent(action)
        seen, *_ = env.step(action)
    # the velocity of one who drives once it has its speed
    begin, columns = (35, slice(2, 4)) if any(other) else (PERIODS, slice(4))
    there, before = (np.array(true[at : at + 60 - begin])[:, columns] for at in (begin, begin - PERIODS))
    np.testing.assert_allclose(np.array(predicted[begin - PERIODS : -PERIODS])[:, columns], there, atol=1e-3)
    assert np.abs(there - before).max() > 0.03


@pytest.mark.parametrize("num_envs", [1, 3])
def test_a_scan_that_nothing_moved_stays(num_envs: int) -> None:
    env, seen = made("wayfield/DiffDriveGoalObstacles-v0", LATE, num_envs, scenario="rooms/train", num_beams=72)
    ahead = ForwardPrediction(env.briefing("sensors"))
    np.testing.assert_allclose(ahead.observed(seen), seen, atol=2e-3)


def outcomes(name: str, robot: Robot) -> tuple[int, int]:
    """Returns how many of 10 robots among discs reach their goals, and how many touch something."""
    env, seen = made(
        "wayfield/DiffDriveGoalObstacles-v0", robot, 10, scenario="clutter_10/validation", num_beams=72,
        max_episode_steps=800,
    )  # fmt: skip
    pilot = Pilot(make(name), env)
    pilot.reset()
    done, reached, touched = np.zeros((3, 10), np.bool_)
    while not done.all():
        seen, _, terminated, truncated, info = env.step(pilot.command(seen))
        ended = (terminated | truncated) & ~done
        reached[ended], touched[ended] = info["success"][ended], info["collision"][ended]
        done |= ended
    return int(reached.sum()), int(touched.sum())


def test_an_agent_drives_its_base_with_a_delay_and_says_that_it_is_new() -> None:
    late = dataclasses.replace(LATE, name="measured", delay=(0.22, 0.25), saturation="wheels", response="continuous",
                               rated_wheel_speed=11.5, acceleration=0.9)  # fmt: skip
    effective = tuple(dataclasses.replace(each, y=1.04 * each.y) for each in LATE.wheels)  # as `identify` writes them
    late = dataclasses.replace(late, track=2.0 * LATE.wheels[1].y, wheels=effective)
    with pytest.warns(NewToAgent, match="a response of its own, predicted"):
        reached, touched = outcomes("ppo", late)
    assert reached >= 7
    assert touched <= 1
    fat = dataclasses.replace(late, hull_radius=0.3)
    with pytest.raises(ValueError, match="no agent of seed 0 ships for goal_reaching with measured"):
        outcomes("ppo", fat)


@pytest.mark.parametrize("name", ["dwa", "vfh_plus"])
def test_laws_of_the_scan_touch_nothing_that_stands(name: str) -> None:
    reached, touched = outcomes(name, dataclasses.replace(LATE, gain=(1, 0.8), decelerations=(0.6, 2)))
    assert touched == 0
    assert reached >= 5
