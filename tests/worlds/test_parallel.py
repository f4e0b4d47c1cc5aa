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


def test_names_and_state() -> None:
    world = wayfield.parallel_env(DIFF, scenario="circle_4")
    assert world.metadata["name"] == "wayfield_diff_drive_team_v0"
    assert world.possible_agents == [f"robot_{r}" for r in range(4)]
    assert world.observation_space("robot_0") is world.observation_space("robot_0")
    world.reset(seed=0)
    assert world.state().shape == (28,)
    with pytest.raises(ValueError, match="actions lack 'robot_0'"):
        world.step({})
    with pytest.raises(ValueError, match="env_id="):
        wayfield.parallel_env("wayfield/OmniDocking-v0")


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
