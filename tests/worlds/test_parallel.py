"""A world as PettingZoo's ParallelEnv: its own checks, and the bits of the native vector."""

import gymnasium
import numpy as np
import pytest

import wayfield

pytest.importorskip("pettingzoo")
from pettingzoo.test import parallel_api_test, parallel_seed_test

DIFF = "wayfield/DiffDriveTeam-v0"


def test_pettingzoo_finds_nothing_to_say() -> None:
    parallel_api_test(wayfield.parallel_env(DIFF, scenario="crossing_4", max_episode_steps=40), num_cycles=100)
    parallel_seed_test(lambda: wayfield.parallel_env(DIFF, scenario="circle_4", noise=1.0), num_cycles=40)


def test_a_world_of_a_batch_is_the_parallel_world_of_its_seed() -> None:
    options = {"scenario": "crossing_4", "noise": 1.0}
    worlds = gymnasium.make_vec(DIFF, num_envs=8, max_episode_steps=120, **options)
    rng = np.random.default_rng(0)
    drives = [rng.uniform(0.0, 0.6, (8, 2)) for _ in range(120)]
    seen = [worlds.reset(seed=3)[0]] + [worlds.step(drive) for drive in drives]
    for w in range(2):
        world = wayfield.parallel_env(DIFF, max_episode_steps=120, **options)
        observations, _ = world.reset(seed=3 + w)
        for r in range(4):
            assert observations[f"robot_{r}"].tobytes() == seen[0][4 * w + r].tobytes()
        for drive, (rows, rewards, terminated, truncated, _) in zip(drives, seen[1:], strict=True):
            agents = list(world.agents)
            said = world.step({agent: drive[4 * w + int(agent[6:])] for agent in agents})
            for agent in agents:
                i = 4 * w + int(agent[6:])
                assert said[0][agent].tobytes() == rows[i].tobytes()
                assert said[1][agent] == rewards[i]
                assert (said[2][agent], said[3][agent]) == (terminated[i], truncated[i])
            if not world.agents:
                break


def test_names_spaces_and_state() -> None:
    world = wayfield.parallel_env(DIFF, scenario="circle_4", max_episode_steps=20_000)
    assert world.metadata["name"] == "wayfield_diff_drive_team_v0"
    assert world.possible_agents == [f"robot_{r}" for r in range(4)]
    for agent in world.possible_agents:
        assert world.observation_spaces[agent] is world.observation_space(agent)
        assert world.action_spaces[agent] is world.action_space(agent)
    world.reset(seed=0)
    assert world.state().shape == (28,)
    with pytest.raises(ValueError, match="env_id="):
        wayfield.parallel_env("wayfield/OmniDocking-v0")


@pytest.mark.parametrize("team", [1, 4])
def test_frames_are_those_of_the_single_environment_episode_by_episode(team: int) -> None:
    options = {"scenario": "circle_4", "team": team, "render_mode": "rgb_array"}
    world, env = wayfield.parallel_env(DIFF, **options), gymnasium.make(DIFF, **options)
    for seed in (0, 1):
        world.reset(seed=seed), env.reset(seed=seed)
        assert (world.render() == env.render()).all()
        for _ in range(20):
            world.step({agent: np.array([0.5, 0.1]) for agent in world.agents})
            env.step(np.full(env.action_space.shape, [0.5, 0.1]))
        assert (world.render() == env.render()).all()


def test_actions_of_others_than_the_agents_and_wrong_options_are_refused_and_nothing_moves() -> None:
    world, untouched = (wayfield.parallel_env(DIFF, scenario="circle_4") for _ in range(2))
    for each in (world, untouched):
        each.reset(seed=0)
    good = {agent: np.array([0.5, 0.1]) for agent in world.agents}
    refused = [
        ({}, "actions lack 'robot_0'"),
        (good | {"robot_4": good["robot_0"]}, "agent='robot_4' is unknown"),
        (good | {"robot_2": [0.1]}, "shape"),
        (good | {"robot_2": [np.nan, 0.0]}, "finite"),
        (list(good.values()), "actions must be a dict"),
    ]
    for actions, says in refused:
        with pytest.raises((TypeError, ValueError), match=says):
            world.step(actions)
    for options in ({"scenari": 0}, {"scenario": 64}, {"scenario": [0, 1, 1, 1]}, 5, []):
        with pytest.raises((TypeError, ValueError), match="options"):
            world.reset(options=options)
    assert all((world.step(good)[0][agent] == untouched.step(good)[0][agent]).all() for agent in good)


def test_actions_of_robots_that_have_ended_are_of_no_effect() -> None:
    """Learners act for all of `possible_agents`, or for those that are left."""
    world, other = (wayfield.parallel_env(DIFF, scenario="crossing_4") for _ in range(2))
    for each in (world, other):
        each.reset(seed=1)
    everyone = {agent: np.array([0.6, 0.0]) for agent in world.agents}
    while len(world.agents) == 4:
        world.step(everyone), other.step(everyone)
    assert world.agents
    seen, *_ = world.step(everyone)
    alone, *_ = other.step({agent: everyone[agent] for agent in other.agents})
    assert {agent: each.tobytes() for agent, each in seen.items()} == {
        agent: each.tobytes() for agent, each in alone.items()
    }


def test_stable_baselines_has_rows_that_never_wait() -> None:
    pytest.importorskip("stable_baselines3")
    from wayfield.envs.sb3 import NativeVecEnv

    with pytest.raises(ValueError, match='ends must be "respawn"'):
        NativeVecEnv(DIFF, 8, scenario="crossing_4")
    env = NativeVecEnv(DIFF, 8, scenario="crossing_4", ends="respawn", max_episode_steps=30)
    env.seed(0)
    env.reset()
    ended = 0
    for _ in range(100):
        observations, _, ends, infos = env.step(np.tile([0.6, 0.1], (8, 1)))
        ended += int(ends.sum())
        assert all("terminal_observation" in infos[i] for i in np.flatnonzero(ends))
        assert np.isfinite(observations).all()
    assert ended >= 24
