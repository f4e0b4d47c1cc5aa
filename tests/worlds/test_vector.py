"""The native vector environment against Gymnasium's vector of single environments, bit for bit."""

import functools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from numpy.typing import NDArray
from oracles.bits import differences

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.tasks.specs import TASKS

PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
GOAL_ID = "wayfield/OmniGoalObstacles-v0"
OMNI_PATH_ID = "wayfield/OmniPathFollowing-v0"
DIFF_GOAL_ID = "wayfield/DiffDriveGoalObstacles-v0"
OMNI_DOCK_ID, DIFF_DOCK_ID = "wayfield/OmniDocking-v0", "wayfield/DiffDriveDocking-v0"
IDS = [name for spec in TASKS.values() for name in spec.ids.values()]  # of one robot; teams have tests of their own
every_id = pytest.mark.parametrize("env_id", IDS)

# Short clocks and a full tilt at whatever stands in the way: both kinds of end come often.
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "path": (PATH_ID, {}),
    "path-wheels-noise": (PATH_ID, {"action_mode": "wheel_speeds", "noise": 1.0}),
    "path-lagged-odometry": (PATH_ID, {"actuators": "lagged", "pose_source": "odometry", "noise": 2.0}),
    "path-shove": (PATH_ID, {"scenario": "circle", "shove": (0.5, 0.1, 0.2, 0.3), "num_preview": 3}),
    "path-pymunk": (PATH_ID, {"dynamics": "pymunk", "noise": 1.0}),
    "path-pymunk-slow": (PATH_ID, {"dynamics": "pymunk", "actuators": "slow", "pose_source": "odometry"}),
    "goal": (GOAL_ID, {}),
    "goal-omni4-wheels-noise": (GOAL_ID, {"robot": "omni4", "action_mode": "wheel_speeds", "noise": 1.0}),
    "goal-lagged-odometry": (GOAL_ID, {"actuators": "lagged", "pose_source": "odometry", "noise": 1.0}),
    "goal-uncorrected": (GOAL_ID, {"scenario": "mixed", "pose_source": "odometry_uncorrected", "num_beams": 7}),
    "goal-waypoints": (GOAL_ID, {"scenario": "omni3_waypoints", "end_on_success": False, "num_beams": 0}),
    "goal-open": (GOAL_ID, {"scenario": "open_field", "robot": "omni4", "field_of_view": 3.0}),
    "goal-pymunk": (GOAL_ID, {"dynamics": "pymunk", "noise": 1.0, "actuators": "lagged"}),
    "omni-path": (OMNI_PATH_ID, {"noise": 1.0}),
    "omni-path-omni4-odometry": (OMNI_PATH_ID, {"robot": "omni4", "pose_source": "odometry", "actuators": "slow"}),
    "omni-path-pymunk": (OMNI_PATH_ID, {"dynamics": "pymunk", "pose_source": "odometry_uncorrected"}),
    "diff-goal": (DIFF_GOAL_ID, {"noise": 1.0}),
    "diff-goal-wheels-severe": (DIFF_GOAL_ID, {"action_mode": "wheel_speeds", "disturbance": "severe"}),
    "diff-goal-pymunk": (DIFF_GOAL_ID, {"dynamics": "pymunk", "actuators": "lagged", "pose_source": "odometry"}),
    "dock-wall": (DIFF_DOCK_ID, {"scenario": "wall", "actuators": "lagged"}),
    "dock-moving-noise": (DIFF_DOCK_ID, {"scenario": "moving/test", "noise": 1.0, "disturbance": "moderate"}),
    "dock-omni4-berth": (OMNI_DOCK_ID, {"scenario": "berth", "robot": "omni4", "action_mode": "wheel_speeds"}),
    "dock-pymunk": (OMNI_DOCK_ID, {"scenario": "all", "dynamics": "pymunk", "pose_source": "odometry"}),
    "goal-moving-noise": (GOAL_ID, {"scenario": "moving_crowd/test", "noise": 1.0, "actuators": "lagged"}),
    "goal-moving-pymunk": (
        GOAL_ID,
        {"scenario": "moving_crossing/test", "dynamics": "pymunk", "actuators": "slow"},
    ),
    "goal-pymunk-pushing": (GOAL_ID, {"dynamics": "pymunk", "scenario": "push_box", "end_on_contact": False}),
}
# where nothing but the clock, or a goal that random motion does not find, ends an episode
UNBOUNDED = {"path-shove", "goal-waypoints", "goal-open", "goal-pymunk-pushing"}
every_case = pytest.mark.parametrize("case", CASES)
every_mode = pytest.mark.parametrize("autoreset_mode", ["NextStep", "SameStep"])


def sync(case: str, num_envs: int, autoreset_mode: str, max_episode_steps: int) -> Any:
    env_id, options = CASES[case]
    return gymnasium.make_vec(
        env_id,
        num_envs,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode(autoreset_mode)},
        max_episode_steps=max_episode_steps,
        **options,
    )


def native(case: str, num_envs: int, autoreset_mode: str = "NextStep", max_episode_steps: int = 37) -> Any:
    env_id, options = CASES[case]
    return gymnasium.make_vec(
        env_id, num_envs, autoreset_mode=autoreset_mode, max_episode_steps=max_episode_steps, **options
    )


def actions_for(env: Any, steps: int, num_envs: int, seed: int = 0) -> NDArray[np.float32]:
    """Returns actions (steps, num_envs, a) that hold a direction for a while, some of them beyond the bounds."""
    most = env.single_action_space.high
    held = np.random.default_rng(seed).uniform(-1.2, 1.2, (steps // 9 + 1, num_envs, len(most))) * most
    held[..., 0] = np.abs(held[..., 0])
    return np.repeat(held, 9, axis=0)[:steps].astype(np.float32)


def kept(env: Any) -> dict[str, Any]:
    """Returns what a batch knows of its robots, and its plant of what they met."""
    batch, found = env.batch, {"delayed": env.batch.delayed.copy()}
    records = {"states": batch.states}
    if batch.plant is not None:
        records |= {"progress": batch.plant.progress, "bodies": batch.plant.bodies}
        found["worlds"] = tuple(batch.plant.worlds)
    for name, record in records.items():
        found |= {f"{name}.{field}": record[field].copy() for field in record.dtype.names}
    return found


# each mode under each clock, one of the four with each case
MODES_AND_CLOCKS = [(case, ("NextStep", "SameStep")[k % 2], (37, 200)[k // 2 % 2]) for k, case in enumerate(CASES)]


@pytest.mark.parametrize(("case", "autoreset_mode", "clock"), MODES_AND_CLOCKS)
def test_rows_equal_single_environments(case: str, autoreset_mode: str, clock: int) -> None:
    num_envs, steps = 3, 500
    ours, theirs = native(case, num_envs, autoreset_mode, clock), sync(case, num_envs, autoreset_mode, clock)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"]
    assert not differences(ours.reset(seed=11), theirs.reset(seed=11))
    ends = np.zeros(2)
    for k, action in enumerate(actions_for(ours, steps, num_envs)):
        a, b = ours.step(action), theirs.step(action)
        for name, x, y in zip(("observations", "rewards", "terminated", "truncated", "infos"), a, b, strict=True):
            assert not differences(x, y, f"step {k} {name}")
        ends += a[2].sum(), a[3].sum()
    if clock == 37:
        assert ends[1] > 0
    elif case not in UNBOUNDED:
        assert ends[0] > 0


@every_case
def test_a_seed_means_one_trajectory(case: str) -> None:
    env = native(case, 4)
    # as many steps as end episodes of all rows by the clock, which the next step would begin anew
    actions = actions_for(env, 3 * 38 - 1, 4)
    fresh = native(case, 4)
    runs = []
    for each in (env, env, fresh):
        # of an episode that was nothing is left, also where no observation tells it
        first = each.reset(seed=5)
        runs.append([(*first, kept(each)), *map(each.step, actions)])
        assert "noise" not in CASES[case][1] or differences(each.reset()[0], first[0])
    for other in runs[1:]:
        for a, b in zip(runs[0], other, strict=True):
            for x, y in zip(a, b, strict=True):
                assert not differences(x, y)


@every_mode
def test_seeds_by_row(autoreset_mode: str) -> None:
    seeds = [7, None, 3]
    env = native("goal", 3, autoreset_mode)
    first, _ = env.reset(seed=seeds)
    for i in (0, 2):
        single, _ = gymnasium.make(GOAL_ID).reset(seed=seeds[i])
        assert first[i].tobytes() == single.tobytes()
    assert len(env.np_random) == 3
    # a later reset without seeds goes on in each row's own numbers
    single = gymnasium.make(GOAL_ID)
    single.reset(seed=7)
    assert env.reset()[0][0].tobytes() == single.reset()[0].tobytes()
    # seeded anew where a seed is given, and told so
    again, _ = env.reset(seed=[None, 5, None])
    assert env.np_random_seed == (7, 5, 3)
    assert again[0].tobytes() == single.reset()[0].tobytes()
    assert again[1].tobytes() == single.reset(seed=5)[0].tobytes()
    # in whatever form the numbers of a row come
    for same in (
        np.array([7, 8, 9]),
        np.array([7, 8, 9], np.uint32),
        (7, 8, 9),
        range(7, 10),
        np.int64(7),
        np.array(7),
    ):
        assert env.reset(seed=same)[0].tobytes() == env.reset(seed=7)[0].tobytes()


@every_id
def test_an_option_of_reset_chooses_the_scenario_of_each_row(env_id: str) -> None:
    env: Any = gymnasium.make_vec(env_id, 3, noise=1.0, max_episode_steps=4)
    single: Any = gymnasium.make(env_id, noise=1.0, max_episode_steps=4)
    for chosen in ([5, 0, 63], np.array([7, 8, 9]), (1, 1, 2), 4, np.int32(6)):
        first, _ = env.reset(seed=3, options={"scenario": chosen})
        rows = np.broadcast_to(chosen, 3).tolist()
        assert env.batch.states["scenario"].tolist() == rows
        for i, k in enumerate(rows):
            assert first[i].tobytes() == single.reset(seed=3 + i, options={"scenario": k})[0].tobytes()
    # of options a row, those that choose nothing leave the draw
    first, _ = env.reset(seed=3, options=[{"scenario": 5}, {}, None])
    for i, options in enumerate(({"scenario": 5}, None, None)):
        assert first[i].tobytes() == single.reset(seed=3 + i, options=options)[0].tobytes()
    # what follows is drawn again, as without the option
    following = []
    for options in ({"scenario": 4}, None, {}):
        env.reset(seed=3, options=options)
        for _ in range(5):
            env.step(np.zeros(env.action_space.shape, np.float32))
        following.append(env.batch.states["scenario"].tolist())
    assert following[0] == following[1] == following[2] != [4, 4, 4]
    count = len(env.task.scenarios)
    wrong = rf"options\['scenario'\] must be an int or 3 ints from 0 to {count - 1}, got"
    env.reset(seed=9)
    wanted, _ = env.reset()
    env.reset(seed=9)
    for bad in ([1, 2], [1, 2, count], [0, 0, -1], [1.0, 2.0, 3.0], count, True, None, "a"):
        with pytest.raises(ValueError, match=wrong):
            env.reset(seed=5, options={"scenario": bad})
    for seed in (-1, [1, 2], [1, 2, -1], 2**128 - 2):
        with pytest.raises(ValueError, match="seed"):
            env.reset(seed=seed)
    # what was refused has changed nothing
    assert env.np_random_seed == (9, 10, 11)
    assert env.reset()[0].tobytes() == wanted.tobytes()


def test_next_step_resets_move_nothing(tmp_path: Path) -> None:
    file = tmp_path / "wall.json"
    ahead = {"kind": "wall", "x1": 1.0, "y1": -9.0, "x2": 1.0, "y2": 9.0}
    file.write_text(json.dumps({"goal": [5, 0, 0], "obstacles": [ahead]}))
    env: Any = gymnasium.make_vec(GOAL_ID, 2, scenario=str(file))
    first, _ = env.reset(seed=0)
    actions = np.array([[1.0, 0.0, 0.0], [0.1, 0.0, 0.0]], np.float32)
    for _ in range(30):
        observations, rewards, terminated, _, info = env.step(actions)
        if terminated[0]:
            break
    assert info["collision"].tolist() == [True, False]
    observations, rewards, terminated, truncated, info = env.step(actions)
    assert observations[0].tobytes() == first[0].tobytes()
    assert rewards[0] == 0.0
    assert not terminated.any()
    assert not truncated.any()
    assert info["time"][0] == 0.0
    assert info["time"][1] > 0.5


def test_same_step_hands_over_the_final_observation() -> None:
    env = native("path", 5, "SameStep", 20)
    single = gymnasium.make(PATH_ID, max_episode_steps=20)
    env.reset(seed=2)
    single.reset(seed=2)
    for action in actions_for(env, 20, 5, seed=4) * np.float32(0.1):
        observations, _, terminated, truncated, info = env.step(action)
        last = single.step(action[0])
    assert truncated.all()
    assert not terminated.any()
    assert info["_final_obs"].all()
    assert info["final_obs"][0].tobytes() == last[0].tobytes()
    assert {name: values[0] for name, values in info["final_info"].items() if name[0] != "_"} == last[4]
    assert observations[0].tobytes() == single.reset()[0].tobytes()
    assert (info["time"] == 0.0).all()


def test_what_is_kept_is_not_overwritten() -> None:
    for mode in ("NextStep", "SameStep"):
        env = native("goal", 3, mode, 5)
        kept = [env.reset(seed=0), *(env.step(action) for action in actions_for(env, 12, 3))]
        copies = [tuple(np.array(part) if isinstance(part, np.ndarray) else part for part in each) for each in kept]
        times = [each[-1]["time"].copy() for each in kept]
        for action in actions_for(env, 12, 3, seed=1):
            env.step(action)
        for each, copy, time in zip(kept, copies, times, strict=True):
            assert all(np.array_equal(x, y) for x, y in zip(each[:-1], copy[:-1], strict=True))
            assert each[-1]["time"].tolist() == time.tolist()


def test_asynchronous_workers_that_are_spawned_say_the_same() -> None:
    make = functools.partial(gymnasium.make, "wayfield:" + GOAL_ID, noise=1.0, max_episode_steps=15)
    workers: Any = AsyncVectorEnv([make, make], context="spawn")
    try:
        ours = gymnasium.make_vec(GOAL_ID, 2, noise=1.0, max_episode_steps=15)
        assert not differences(ours.reset(seed=1), workers.reset(seed=1))
        for action in actions_for(ours, 40, 2):
            for x, y in zip(ours.step(action), workers.step(action), strict=True):
                assert not differences(x, y)
    finally:
        workers.close()


# What is refused.


@every_id
@pytest.mark.parametrize(("spoil", "error"), [(math.nan, ValueError), (math.inf, ValueError), ("text", TypeError)])
@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_one_bad_row_moves_no_robot(env_id: str, spoil: Any, error: type[Exception], dynamics: str) -> None:
    env: Any = gymnasium.make_vec(env_id, 3, dynamics=dynamics)
    env.reset(seed=0)
    good = env.action_space.high * 0.5
    env.step(good)
    before = env.batch.states.tobytes()
    bad = good.astype(object if isinstance(spoil, str) else np.float64)
    bad[2, 0] = spoil
    with pytest.raises(error):
        env.step(bad)
    with pytest.raises(ValueError, match="shape"):
        env.step(good[:2])
    assert env.batch.states.tobytes() == before
    twin: Any = gymnasium.make_vec(env_id, 3, dynamics=dynamics)
    twin.reset(seed=0)
    twin.step(good)
    assert env.step(good)[0].tobytes() == twin.step(good)[0].tobytes()


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_arguments_are_checked() -> None:
    for env_id in IDS:
        with pytest.raises(ValueError, match="num_envs must be a whole number >= 1, got 0"):
            gymnasium.make_vec(env_id, 0)
        with pytest.raises(ValueError, match=r"autoreset_mode='Samestep' is unknown\. Did you mean 'SameStep'"):
            gymnasium.make_vec(env_id, 2, autoreset_mode="Samestep")
        with pytest.raises(ValueError, match="human"):
            gymnasium.make_vec(env_id, 2, render_mode="human")
        env: Any = gymnasium.make_vec(env_id, 2)
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(env.action_space.high)
        with pytest.raises(ValueError, match="options"):
            env.reset(options={"start": 1})
        with pytest.raises(ValueError, match="seed must be an int or 2 of them, got 3"):
            env.reset(seed=[1, 2, 3])
