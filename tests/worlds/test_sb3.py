"""The adapter for stable-baselines3: DummyVecEnv's steps, Monitor's episodes, and what the usual wrappers ask for."""

from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecCheckNan, VecFrameStack, VecMonitor, VecNormalize

import wayfield  # noqa: F401  registers the ids
from wayfield.envs.sb3 import NativeVecEnv
from wayfield.envs.tasks.specs import EVERY

PATH, OMNI = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"


SETTINGS: dict[str, dict[str, Any]] = {
    PATH: {"scenario": "circle", "noise": 1.0, "actuators": "lagged"},
    OMNI: {"scenario": "discs", "num_beams": 8, "robot": "omni4"},
    "wayfield/DiffDriveTeam-v0": {"team": 1},  # a world of several robots is no environment of DummyVecEnv's
    "wayfield/OmniTeam-v0": {"team": 1, "scenario": "crossing_4"},
}
IDS = [each for spec in EVERY.values() for each in spec.ids.values()]


def check_step(mine: tuple[Any, ...], other: tuple[Any, ...], full: bool) -> None:
    """Holds that a step of ours is that of monitored environments in a DummyVecEnv, key by key of the infos."""
    for ours, theirs in zip(mine[:3], other[:3], strict=True):
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)
    assert type(mine[3]) is list
    for ended, ours, theirs in zip(mine[2], mine[3], other[3], strict=True):
        ours, theirs = dict(ours), dict(theirs)
        if not ended:
            assert ours == (theirs if full else {})
            continue
        np.testing.assert_array_equal(ours.pop("terminal_observation"), theirs.pop("terminal_observation"))
        episode, monitored = ours.pop("episode"), theirs.pop("episode")
        assert episode["l"] == monitored["l"]
        assert episode["r"] == pytest.approx(monitored["r"], abs=2e-6)  # Monitor rounds to the sixth place
        assert episode["t"] >= 0.0
        assert ours.pop("is_success") == theirs["success"]
        assert ours == theirs


@pytest.mark.parametrize("env_id", IDS)
def test_rows_are_monitored_dummy_vec_envs_of_the_same_environments(env_id: str) -> None:
    given: dict[str, Any] = {"max_episode_steps": 60} | SETTINGS.get(env_id, {})
    own = {"max_episode_steps": 45, "noise": 0.5}  # of the second world, where it says otherwise than what is for all
    brief = NativeVecEnv(env_id, [(2, {}), (4, own)], **given)
    full = NativeVecEnv(env_id, [(2, {}), (4, own)], full_infos=True, **given)
    worlds, count = [given] * 2 + [given | own] * 4, 6
    dummy = DummyVecEnv([lambda each=each: Monitor(gymnasium.make(env_id, **each)) for each in worlds])
    last = len(brief.task.scenarios) // brief.task.team - 1
    options: dict[int, Any] = {  # of resets in the middle of episodes: what was paid in those counts no more
        70: None,
        75: {"scenario": last},
        80: [{}, {"scenario": last}, {}, {"scenario": 0}, {"scenario": np.int64(last)}, {}],
    }
    assert brief.seed(5) == full.seed(5) == dummy.seed(5)
    first = [env.reset() for env in (brief, full, dummy)]
    rng, late, done = np.random.default_rng(0), 0, 0
    space = brief.action_space
    for step in range(200):
        if step in options:
            for env in (brief, full, dummy):
                env.set_options(options[step])
            first = [env.reset() for env in (brief, full, dummy)]
        for k, env in enumerate((brief, full)):
            np.testing.assert_array_equal(first[k], first[2])
            assert env.reset_infos == dummy.reset_infos, f"step {step}"
        # the first robot drives straight out of bounds or into something, the others at random
        actions = rng.uniform(0.3 * space.low, 0.3 * space.high, (count, *space.shape)).astype(np.float32)
        actions[0] = 0.0
        actions[0, 0] = space.high[0]
        steps = [env.step(actions) for env in (brief, full, dummy)]
        check_step(steps[0], steps[2], full=False)
        check_step(steps[1], steps[2], full=True)
        ends = steps[2][2]
        done += ends.sum()
        late += sum(info["TimeLimit.truncated"] for info in steps[2][3])
        for info in (*steps[0][3], *steps[1][3], *brief.reset_infos, *full.reset_infos, *dummy.reset_infos):
            info["mine"] = step  # is nobody else's, and of no later step
        for env in (brief, full, dummy):
            env.reset_infos = [{k: v for k, v in info.items() if k != "mine"} for info in env.reset_infos]
    assert late >= 12  # of most robots two in turn: what the first earned is not the second's
    assert done > late or "Path" not in env_id


def test_attributes_are_those_of_rows() -> None:
    native = NativeVecEnv(PATH, [(2, {}), (2, {"noise": 1.0})], max_episode_steps=60)
    dummy = DummyVecEnv([lambda: Monitor(gymnasium.make(PATH, max_episode_steps=60)) for _ in range(4)])
    for env in (native, dummy):
        env.seed(3)
        env.reset()
    assert native.metadata["render_fps"] == dummy.metadata["render_fps"]
    for name in ("action_space", "observation_space", "render_mode", "np_random_seed", "np_random"):
        for indices in (None, 2, -1, [0, 3], np.array([1])):
            ours, theirs = (env.get_attr(name, indices) for env in (native, dummy))
            if name == "np_random":
                ours, theirs = ([each.bit_generator.seed_seq.entropy for each in pair] for pair in (ours, theirs))
            assert ours == theirs, (name, indices)
            assert native.env_is_wrapped(Monitor, indices) == dummy.env_is_wrapped(Monitor, indices)
    for env in (native, dummy):
        assert not env.has_attr("nothing")
        with pytest.raises(IndexError):
            env.get_attr("render_mode", 4)
    for refused in (lambda: native.set_attr("gain", 1), lambda: native.env_method("harder")):
        with pytest.raises(NotImplementedError, match=r"make_vec_env\(env_id, num_envs\)"):
            refused()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"scenari": 0}, "Did you mean 'scenario'"),
        ({"scenario": 10**6}, "from 0 to 63, got 1000000"),
        ([{}, {"scenario": 64}], "from 0 to 63, got 64"),
        ([{}, {"seed": 0}], "'seed' is unknown"),
        ([{}], "a list of 2"),
        (5, "a list of 2, got 5"),
        ([{}, 5], "options must be a dict or None, got 5"),
    ],
)
def test_options_that_no_reset_takes_are_refused(options: Any, says: str) -> None:
    env = NativeVecEnv(PATH, 2)
    env.set_options(options)
    with pytest.raises((TypeError, ValueError), match=says):
        env.reset()


class Straight:
    """Drives straight on, whatever it sees."""

    def predict(self, observations: Any, state: Any = None, **_: Any) -> tuple[Any, Any]:
        return np.tile([0.4, 0.0], (len(observations), 1)).astype(np.float32), state


def test_rewards_are_true_behind_normalisation() -> None:
    def dummy(count: int, **kwargs: Any) -> DummyVecEnv:
        return DummyVecEnv([lambda: Monitor(gymnasium.make(PATH, **kwargs)) for _ in range(count)])

    paid = []
    for made in (partial(NativeVecEnv, PATH), dummy):
        trained, judged = (VecNormalize(VecFrameStack(VecCheckNan(made(3, max_episode_steps=50)), 2)) for _ in range(2))
        judged.seed(0)
        rewards, lengths = evaluate_policy(Straight(), judged, 7, return_episode_rewards=True)
        model = PPO("MlpPolicy", trained, n_steps=64, batch_size=64, n_epochs=1, seed=0, device="cpu")
        model.learn(192, callback=(watch := EvalCallback(judged, n_eval_episodes=5, eval_freq=64, verbose=0)))
        trainings = [episode["r"] for episode in model.ep_info_buffer or []]
        paid.append((*rewards, *lengths, *trainings, watch.last_mean_reward))
    assert len(paid[0]) > 15
    assert paid[0] == pytest.approx(paid[1], abs=2e-6)


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
    robots = NativeVecEnv(OMNI, 4, scenario="discs", max_episode_steps=20)
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):  # it has no need of another
        env = VecMonitor(robots, info_keywords=("success", "collision"))
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
    with pytest.raises(TypeError, match=r"n_envs is called worlds here: NativeVecEnv\(env_id, 4\)"):
        NativeVecEnv(PATH, n_envs=4)
    for word in ("env_kwargs", "wrapper_class", "monitor_dir", "vec_env_cls", "start_method"):
        with pytest.raises(TypeError, match=rf"^{word} is of make_vec_env; .* NativeVecEnv\(env_id, 4, robot="):
            NativeVecEnv(PATH, 2, **{word: {}})
    for made in ([PATH], [lambda: gymnasium.make(PATH)], gymnasium.make(PATH)):
        with pytest.raises(TypeError, match=r"^env_id is .* go into DummyVecEnv"):
            NativeVecEnv(made)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="autoreset_mode is not for NativeVecEnv"):
        NativeVecEnv(PATH, autoreset_mode="NextStep")
    for worlds in ([], [2, 3], [(2, None)], "4"):
        with pytest.raises(ValueError, match=r"worlds must be .* at least one .*, got "):
            NativeVecEnv(PATH, worlds)  # type: ignore[arg-type]
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset before np_random"):
        NativeVecEnv(PATH, 2).get_attr("np_random")
