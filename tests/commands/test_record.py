"""Recorded data sets: what is read back is what was driven, and seed and actions drive it again, bit for bit."""

import functools
import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding

pytest.importorskip("mcap", reason='needs pip install "wayfield[record]"')
pytest.importorskip("pyarrow", reason='needs pip install "wayfield[record]"')
pytest.importorskip("minari", reason='needs pip install "wayfield[record]"')

import minari
from mcap.reader import make_reader
from minari.data_collector.episode_buffer import EpisodeBuffer

from wayfield import policies
from wayfield.benchmarks.episodes.recorder import Start, record
from wayfield.benchmarks.recordings.mcap_file import write_mcap
from wayfield.benchmarks.recordings.record import main
from wayfield.policies.parts.tuned import tuned_set
from wayfield.policies.training.recorded import KEY, opened

PATHS, GOALS = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"
NOISY = {"scenario": "splines/train", "actuators": "lagged", "noise": 1.0, "max_episode_steps": 60}
CROWD = {"scenario": "moving_crowd/train", "actuators": "lagged", "num_beams": 24, "max_episode_steps": 60}
STARTS = [Start(7 + k, k % 3) for k in range(5)]


def episodes(env_id, policy, robots, starts=STARTS, exploration=0.2, **kwargs):
    env = gymnasium.make_vec(env_id, robots, vectorization_mode="vector_entry_point", **kwargs)
    found = dict(record(env, policies.make(policy), starts, exploration))
    env.close()
    assert sorted(found) == list(range(len(starts)))
    return [found[k] for k in range(len(starts))]


def assert_equal(one, other):
    for name in ("observations", "actions", "rewards", "terminations", "truncations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert one.infos.keys() == other.infos.keys()
    for name in one.infos:
        np.testing.assert_array_equal(one.infos[name], other.infos[name], err_msg=name)


@pytest.mark.parametrize(("env_id", "policy", "kwargs"), [(PATHS, "pure_pursuit", NOISY), (GOALS, "vfh_plus", CROWD)])
def test_seed_and_actions_drive_an_episode_again(env_id, policy, kwargs):
    env = gymnasium.make(env_id, **kwargs)
    for episode in episodes(env_id, policy, 2, **kwargs):
        seen, told = env.reset(seed=episode.start.seed, options={"scenario": episode.start.scenario})
        for k in range(len(episode.actions) + 1):
            np.testing.assert_array_equal(seen, episode.observations[k])
            assert {name: values[k] for name, values in episode.infos.items()} == told
            if k < len(episode.actions):
                assert env.action_space.contains(episode.actions[k])
                seen, reward, terminated, truncated, told = env.step(episode.actions[k])
                ends = terminated, truncated and not terminated
                assert (reward, *ends) == (episode.rewards[k], episode.terminations[k], episode.truncations[k])
        assert terminated or truncated
    env.close()


def test_an_episode_is_the_same_however_many_robots_drive_beside_it():
    alone = episodes(PATHS, "lqr", 1, **NOISY)
    for robots in (2, 5):
        for one, other in zip(alone, episodes(PATHS, "lqr", robots, **NOISY), strict=True):
            assert_equal(one, other)


def test_exploration_is_the_noise_that_was_asked_for():
    starts = [Start(k, 0) for k in range(200)]
    kwargs = NOISY | {"max_episode_steps": 20}
    driven = np.concatenate([e.actions for e in episodes(PATHS, "zero", 50, starts, 0.1, **kwargs)])
    most = gymnasium.make(PATHS).action_space.high
    np.testing.assert_allclose(driven.std(axis=0) / most, 0.1, rtol=0.06)
    np.testing.assert_allclose(driven.mean(axis=0) / most, 0.0, atol=0.01)


def test_exploration_draws_apart_from_the_episode():
    """What the seed gives an episode's start and disturbances is not given to its noise once more."""
    (driven,) = episodes(PATHS, "zero", 1, [Start(7, 0)], 0.1, **NOISY | {"max_episode_steps": 20})
    noise = driven.actions / gymnasium.make(PATHS).action_space.high / 0.1
    seeds_own = seeding.np_random(7)[0].standard_normal(4 * noise.size)
    assert np.abs(seeds_own[:, None] - noise.ravel()).min(axis=0).max() > 1e-3


def recorded(*words):
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    return ended.value.code


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    return tmp_path


WORDS = ("pure_pursuit", "lqr", "--family", "splines", "--episodes", "5", "--exploration", "0.1")


def test_a_set_is_read_back_as_it_was_driven_and_recorded_again_alike(home, capsys):
    assert recorded(*WORDS, "--dataset", "here/one-v0", "--mcap", str(home / "first.mcap")) == 0
    told = capsys.readouterr().out
    read = minari.load_dataset("here/one-v0")
    folder = Path(told.rpartition(" files in ")[2].strip())
    assert (folder.stat().st_mode & 0o777, (folder / "data" / "metadata.json").is_file()) == (0o755, True)
    assert f"here/one-v0: 5 episodes, {read.total_steps:,} steps, " in told
    assert f"SHA-256 {read.storage.metadata[KEY]['digest'][:16]}..." in told
    about = opened("here/one-v0").storage.metadata[KEY]  # whose numbers have that digest
    assert read.total_episodes == 5
    assert read.total_steps == sum(len(each) for each in read)
    # the default gains where a search found none that were better
    names = {"search": "tuned", "hand": "hand-tuned", "default": "default"}
    best = {policy: tuned_set(policy, "path-following") for policy in ("pure_pursuit", "lqr")}
    assert set(about["policies"]) == {f"{policy}, {names[found.chosen]}" for policy, found in best.items()}
    fields = about["fields"]
    assert list(fields)[:2] == ["pose", "twist"]
    assert fields["preview"]["columns"][1] == read.observation_space.shape[0]
    told = [each[KEY] for each in read.storage.get_episode_metadata(range(5))]
    assert [each["policy"] for each in told] == ["pure_pursuit"] * 2 + ["lqr"] * 3
    # each episode has the seed after that of the one before
    assert about["seeds"] == [0, 4]
    assert sorted(int(each["seed"]) for each in read.storage.get_episode_metadata(range(5))) == [0, 1, 2, 3, 4]
    assert about["families"] == ["splines"]
    env = read.recover_environment()
    assert env.observation_space == read.observation_space
    seen, _ = env.reset(seed=0, options={"scenario": 0})
    np.testing.assert_array_equal(seen, read[0].observations[0])
    env.close()

    assert recorded(*WORDS, "--dataset", "here/two-v0") == 0
    assert minari.load_dataset("here/two-v0").storage.metadata[KEY]["digest"] == about["digest"]
    assert recorded(*WORDS, "--dataset", "here/three-v0", "--seed", "1") == 0
    third = minari.load_dataset("here/three-v0").storage.metadata[KEY]
    assert third["digest"] != about["digest"]
    assert third["seeds"] == [1, 5]
    with (home / "first.mcap").open("rb") as file:
        assert {channel.topic for _, channel, _ in make_reader(file).iter_messages()} >= {"/tf", "/action", "/told"}


def test_the_environment_of_a_set_of_several_families_replays_all_of_it(home):
    words = ("pure_pursuit", "lqr", "--family", "splines", "--family", "circles", "--episodes", "5")
    assert recorded(*words, "--dataset", "here/all-v0") == 0
    read = minari.load_dataset("here/all-v0")
    env = read.recover_environment()
    for episode, about in zip(read, read.storage.get_episode_metadata(range(5)), strict=True):
        seen, _ = env.reset(seed=int(about["seed"]), options=about["options"])
        driven = [seen, *(env.step(action)[0] for action in episode.actions)]
        np.testing.assert_array_equal(driven, episode.observations)
    env.close()


@pytest.mark.parametrize("dataset", ["mine", "my set-v0", "../mine-v0"])
def test_a_name_that_is_none_of_minaris_is_refused_in_a_line(home, capsys, dataset):
    assert recorded("lqr", "--dataset", dataset) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"record: --dataset {dataset!r}")
    assert said.count("\n") == 1
    assert not any(home.iterdir())


def test_columns_are_those_of_minaris_own_writer(home):
    assert recorded("lqr", "--family", "splines", "--episodes", "1", "--dataset", "ours-v0") == 0
    ours = minari.load_dataset("ours-v0")
    episode = ours[0]
    buffer = EpisodeBuffer(
        seed=0,
        observations=episode.observations,
        actions=episode.actions,
        rewards=episode.rewards.tolist(),
        terminations=episode.terminations.tolist(),
        truncations=episode.truncations.tolist(),
        infos={name: values.tolist() for name, values in episode.infos.items()},
    )
    spaces = {"observation_space": ours.observation_space, "action_space": ours.action_space}
    with pytest.warns(UserWarning, match="is set to None"):
        theirs = minari.create_dataset_from_buffers("theirs-v0", [buffer], data_format="arrow", **spaces)
    assert_equal(episode, theirs[0])
    import pyarrow.ipc

    schemas = [
        pyarrow.ipc.open_file(Path(each.spec.data_path) / "0" / "part-0.arrow").schema.remove_metadata()
        for each in (ours, theirs)
    ]
    assert schemas[0].equals(schemas[1])


def test_what_is_there_is_not_overwritten_unless_it_is_ours_and_asked_for(home, capsys):
    words = ("zero", "--suite", "path-following", "--family", "splines", "--episodes", "1", "--dataset", "mine-v0")
    assert recorded(*words) == 0
    assert recorded(*words) == 1
    assert "there already" in capsys.readouterr().err
    assert recorded(*words, "--force") == 0
    (home / "foreign-v0" / "data").mkdir(parents=True)
    (home / "foreign-v0" / "data" / "metadata.json").write_text(json.dumps({"total_steps": 0}))
    assert recorded(*words[:-1], "foreign-v0", "--force") == 1
    assert "was not recorded by this command" in capsys.readouterr().err
    assert json.loads((home / "foreign-v0" / "data" / "metadata.json").read_text()) == {"total_steps": 0}
    assert sorted(each.name for each in home.iterdir() if not each.name.startswith(".")) == ["foreign-v0", "mine-v0"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["pure_persuit"], "Did you mean 'pure_pursuit'"),
        (["random"], "zero --exploration 1"),
        (["pure_pursuit", "vfh_plus"], "no suite has all of the policies"),
        (["vfh_plus", "--robot", "p3dx", "--family", "push_boxes"], "--family"),
        (["lqr", "--exploration", "nan"], "--exploration"),
    ],
)
def test_wrong_words_are_one_line_and_nothing_is_written(home, capsys, words, text):
    assert recorded(*words) == 2
    error = capsys.readouterr().err
    assert text in error
    assert error.count("\n") == 1
    assert not list(home.iterdir())


def test_an_mcap_file_holds_the_episode(tmp_path):
    episode = episodes(GOALS, "vfh_plus", 1, STARTS[:1], **CROWD)[0]
    env = gymnasium.make(GOALS, **CROWD)
    file = tmp_path / "episode.mcap"
    write_mcap(file, env, episode, {"policy": "vfh_plus"})
    said = {}
    strict = functools.partial(json.loads, parse_constant=pytest.fail)  # of what no JSON has
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert json.loads(schema.data)["title"] == schema.name
            said.setdefault(channel.topic, []).append((message.log_time, strict(message.data)))
    steps = len(episode.actions)
    assert [len(said[topic]) for topic in ("/tf", "/scan", "/told", "/action")] == [steps + 1] * 3 + [steps]
    env.reset(seed=episode.start.seed, options={"scenario": episode.start.scenario})
    for k, action in enumerate(episode.actions):
        time, transform = said["/tf"][k]
        state = env.unwrapped.batch.states[0]
        assert time == round(k * 0.05 * 1e9)
        assert (transform["translation"]["x"], transform["translation"]["y"]) == (state["x"], state["y"])
        turned = 2.0 * np.arctan2(transform["rotation"]["z"], transform["rotation"]["w"])
        np.testing.assert_allclose(np.cos(turned - state["heading"]), 1.0, atol=1e-12)
        np.testing.assert_array_equal(np.float32(said["/action"][k][1]["action"]), action)
        seen = env.unwrapped.task.layout.unpack(episode.observations[k]).ranges
        # as REP 117 has it: what is beyond the range is infinite
        np.testing.assert_array_equal(said["/scan"][k][1]["ranges"], np.where(seen < 5.0, seen, np.inf))
        env.step(action)
    # what moves is told again at every step
    first, later = said["/scene"][0][1]["entities"], said["/scene"][5][1]["entities"]
    assert any(entity["arrows"] for entity in first)
    (hull,) = [entity for entity in first if entity["id"] == "hull"]
    radius = env.unwrapped.task.robot.hull_radius
    assert (hull["frame_id"], hull["cylinders"][0]["size"]["x"]) == ("base", 2.0 * radius)
    moved = {entity["id"]: entity for entity in later}
    standing = [entity for entity in first if entity["id"] in moved]
    assert len(standing) == len(moved) > 0
    assert any(entity["cylinders"] != moved[entity["id"]]["cylinders"] for entity in standing)
    env.close()
    other = gymnasium.make(GOALS, **CROWD | {"noise": 1.0})
    with pytest.raises(ValueError, match="drives differently"):
        write_mcap(tmp_path / "other.mcap", other, episode, {})
    assert not (tmp_path / "other.mcap").exists()
