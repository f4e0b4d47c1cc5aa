"""The adapter for stable-baselines3: DummyVecEnv's steps, Monitor's episodes, and what the usual wrappers ask for."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

import wayfield  # noqa: F401  registers the ids
from wayfield.envs.sb3 import NativeVecEnv

PATH, OMNI = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"


@pytest.mark.parametrize(
    ("env_id", "kwargs"),
    [
        (PATH, {"scenario": "circle", "noise": 1.0, "actuators": "lagged"}),
        (OMNI, {"scenario": "discs", "num_beams": 8, "robot": "omni4"}),
    ],
)
def test_rows_are_monitored_dummy_vec_envs_of_the_same_environments(env_id: str, kwargs: dict[str, Any]) -> None:
    given: dict[str, Any] = {"max_episode_steps": 60, **kwargs}
    own = {"max_episode_steps": 45, "noise": 0.5}  # of the second world, where it says otherwise than what is for all
    native = NativeVecEnv(env_id, [(2, {}), (4, own)], **given)
    worlds, count = [given] * 2 + [given | own] * 4, 6
    dummy = DummyVecEnv([lambda each=each: Monitor(gymnasium.make(env_id, **each)) for each in worlds])
    for env in (native, dummy):
        env.seed(5)
    np.testing.assert_array_equal(native.reset(), dummy.reset())
    rng, late, done = np.random.default_rng(0), 0, 0
    space = native.action_space
    for step in range(200):
        # the first robot drives straight out of bounds or into something, the others at random
        if step == 70:  # in the middle of episodes: others begin, and what was paid in these counts no more
            np.testing.assert_array_equal(native.reset(), dummy.reset())
        actions = rng.uniform(0.3 * space.low, 0.3 * space.high, (count, *space.shape)).astype(np.float32)
        actions[0] = 0.0
        actions[0, 0] = space.high[0]
        if step == 75:  # in the middle of episodes, of which nothing is left
            np.testing.assert_array_equal(native.reset(), dummy.reset())
        ours, theirs = native.step(actions), dummy.step(actions)
        for mine, other in zip(ours[:3], theirs[:3], strict=True):
            np.testing.assert_array_equal(mine, np.asarray(other, mine.dtype), err_msg=f"step {step}")
        for i in np.flatnonzero(ours[2]):
            mine, other = dict(ours[3][i]), dict(theirs[3][i])
            np.testing.assert_array_equal(mine.pop("terminal_observation"), other.pop("terminal_observation"))
            episode, monitored = mine.pop("episode"), other.pop("episode")
            assert episode["l"] == monitored["l"]
            assert episode["r"] == pytest.approx(monitored["r"], abs=2e-6)  # Monitor rounds to the sixth place
            assert episode["t"] >= 0.0
            assert mine.pop("is_success") == other["success"]
            assert mine == other
            late += mine["TimeLimit.truncated"]
            done += 1
    assert late >= 12  # of most robots two in turn: what the first earned is not the second's
    assert done > late


@pytest.mark.parametrize(("env_id", "kwargs"), [(PATH, {}), (OMNI, {"scenario": "moving_crossing/train"})])
def test_robots_that_are_put_back_go_on_as_they_did(env_id: str, kwargs: dict[str, Any]) -> None:
    """With commands on their way, wheels that lag, noise, and shoves to come: in robots of another process too."""
    worlds = [(3, {"disturbance": "severe"}), (2, {"noise": 1.0}), (1, {"disturbance": "delay_2"})]

    def made() -> NativeVecEnv:
        return NativeVecEnv(env_id, worlds, max_episode_steps=30, actuators="slow", **kwargs)

    first, other = made(), made()
    first.seed(3)
    first.reset()
    space, rng = first.action_space, np.random.default_rng(2)
    actions = rng.uniform(space.low, space.high, (120, 6, *space.shape)).astype(np.float32)
    for action in actions[:50]:
        first.step(action)
    arrays, generators = first.arrays(), first.generators()
    runs = []
    for env, back in ((first, False), (first, True), (other, True)):
        if back:
            env.restore(arrays, generators)
        runs.append([env.step(action)[:3] for action in actions[50:]])
    assert np.any([done for _, _, done in runs[0]])
    for again in runs[1:]:
        for k, (ours, theirs) in enumerate(zip(runs[0], again, strict=True)):
            for mine, yours in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(mine, yours, err_msg=f"step {k}")


def test_the_usual_wrapper_and_learner_find_what_they_ask_for() -> None:
    env = VecMonitor(
        NativeVecEnv(OMNI, 4, scenario="discs", max_episode_steps=20), info_keywords=("success", "collision")
    )
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=1, seed=0, device="cpu")
    model.learn(256)
    assert model.ep_info_buffer is not None
    assert model.ep_success_buffer is not None
    assert len(model.ep_info_buffer) == len(model.ep_success_buffer) >= 8
    assert all({"r", "l", "t", "success", "collision"} <= set(each) for each in model.ep_info_buffer)
    assert max(each["l"] for each in model.ep_info_buffer) == 20


def test_worlds_that_differ_in_what_is_seen_and_no_worlds_are_refused() -> None:
    with pytest.raises(ValueError, match="observation space"):
        NativeVecEnv(OMNI, [(1, {}), (1, {"num_beams": 4})])
    with pytest.raises(ValueError, match="at least one"):
        NativeVecEnv(PATH, [])
