"""Environments through pickle and copy: what comes out goes on bit for bit as what went in."""

import copy
import json
import pathlib
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle
import gymnasium
import numpy as np
import pytest
from oracles.bits import differences

import wayfield  # noqa: F401  registers the ids
from wayfield.envs.pymunk_plant import PymunkPlant

PATH, GOAL, DRIVE = (
    "wayfield/DiffDrivePathFollowing-v0",
    "wayfield/OmniGoalObstacles-v0",
    "wayfield/DiffDriveGoalObstacles-v0",
)
DOCK = "wayfield/DiffDriveDocking-v0"
KINDS: list[tuple[str, dict[str, Any]]] = [
    (PATH, {"disturbance": "strong", "actuators": "lagged"}),
    (GOAL, {"disturbance": "severe", "noise": 1.0, "robot": "omni4", "pose_source": "odometry"}),
    (DRIVE, {"scenario": "moving_crowd/train", "num_beams": 16}),
    (PATH, {"dynamics": "pymunk"}),
    (DOCK, {"scenario": "moving/train", "actuators": "lagged", "noise": 1.0}),
    (GOAL, {"dynamics": "pymunk", "end_on_contact": False, "disturbance": "moderate"}),
]
WAYS: list[Callable[[Any], Any]] = [
    lambda env: pickle.loads(pickle.dumps(env)),
    lambda env: cloudpickle.loads(cloudpickle.dumps(env)),
    copy.deepcopy,
]
# every kind, and every way with two of them
COPIES = [(*kind, WAYS[k % 3]) for k, kind in enumerate(KINDS)]


def go_on(env: Any, steps: int, dice: np.random.Generator) -> list[Any]:
    """Returns the results of `steps` steps with resets where a single environment needs them."""
    results: list[Any] = []
    for _ in range(steps):
        space = env.action_space
        result = env.step(dice.uniform(space.low, space.high).astype(np.float32))
        results.append(result)
        if np.ndim(result[2]) == 0 and (result[2] or result[3]):
            results.append(env.reset())
    return results


@pytest.mark.parametrize(("env_id", "kwargs", "way"), COPIES)
def test_a_single_environment_goes_on_as_its_copy(
    env_id: str, kwargs: dict[str, Any], way: Callable[[Any], Any]
) -> None:
    env = gymnasium.make(env_id, max_episode_steps=150, **kwargs)
    env.reset(seed=7)
    env.action_space.seed(8)  # a space that was never seeded draws its seed at the first sample
    go_on(env, 70, np.random.default_rng(1))
    twin = way(env)
    assert twin.unwrapped.np_random is not env.unwrapped.np_random
    assert twin.spec == env.spec
    assert not differences(env.action_space.sample(), twin.action_space.sample())
    own = go_on(env, 200, np.random.default_rng(2))
    assert not differences(tuple(own), tuple(go_on(twin, 200, np.random.default_rng(2))))


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(("env_id", "kwargs", "way"), COPIES)
def test_a_vector_environment_goes_on_as_its_copy(
    env_id: str, kwargs: dict[str, Any], way: Callable[[Any], Any], mode: str
) -> None:
    envs = gymnasium.make_vec(env_id, 3, max_episode_steps=71, autoreset_mode=mode, **kwargs)
    envs.reset(seed=7)
    go_on(envs, 71, np.random.default_rng(1))  # in NextStep the rows' next step resets them
    twin = way(envs)
    own = go_on(envs, 200, np.random.default_rng(2))
    assert not differences(tuple(own), tuple(go_on(twin, 200, np.random.default_rng(2))))
    assert any(result[3].any() for result in own)


def test_a_copy_made_before_the_first_reset_is_as_good_as_new() -> None:
    env = gymnasium.make(GOAL)
    twin = pickle.loads(pickle.dumps(env))
    with pytest.raises(gymnasium.error.ResetNeeded):
        twin.unwrapped.step(np.zeros(3, np.float32))
    assert not differences(env.reset(seed=3), twin.reset(seed=3))


@pytest.mark.parametrize(
    ("patrol", "way"),
    [({}, WAYS[0]), ({"patrol": {"vx": 0.0, "vy": -0.3, "leg_time": 3.0}}, copy.deepcopy)],
    ids=["pushed", "moving too"],
)
def test_a_copy_goes_on_in_the_middle_of_a_contact(
    patrol: dict[str, Any], way: Callable[[Any], Any], tmp_path: pathlib.Path
) -> None:
    things = [
        {"kind": "box", "x": 0.7, "y": 0.1, "length": 0.4, "width": 0.4, "heading": 0.3, "mass": 2.0},
        {"kind": "circle", "x": 1.2, "y": 0.4, "radius": 0.2, "mass": 1.0},
        {"kind": "circle", "x": 1.2, "y": 0.8, "radius": 0.2, **patrol},
    ]
    file = str(tmp_path / "things.json")
    pathlib.Path(file).write_text(json.dumps({"goal": [90.0, 90.0, 0.0], "obstacles": things}))
    env = gymnasium.make(DRIVE, scenario=file, dynamics="pymunk", end_on_contact=False, end_on_success=False)
    env.reset(seed=0)
    forward = np.array([0.6, 0.15], np.float32)
    touched = 0
    for _ in range(60):
        env.step(forward)
        plant = env.unwrapped.batch.plant
        assert isinstance(plant, PymunkPlant)
        touched += plant.worlds[0] is not None
        if touched == 10:
            break
    assert touched == 10, "nothing was touched"
    twin = way(env)
    env_bodies, twin_bodies = [], []
    for _ in range(200):
        assert not differences(env.step(forward), twin.step(forward))
        env_bodies.append(env.unwrapped.batch.obstacles.tobytes())
        twin_bodies.append(twin.unwrapped.batch.obstacles.tobytes())
    assert env_bodies == twin_bodies
    assert len(set(env_bodies)) > 10, "nothing moved"
