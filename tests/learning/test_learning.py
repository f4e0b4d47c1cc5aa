"""What a learner sees, is paid for, is taught and is judged by, each worked out a second time."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

pytest.importorskip("stable_baselines3")

from oracles.short_runs import SEEKER, SHORT

from wayfield import policies
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.episodes.rollout import roll_out
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.statistics.aggregates import iqm
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import path_scenarios, splits
from wayfield.policies.learned.perception import PathFeatures, limits_of
from wayfield.policies.training import imitation
from wayfield.policies.training.learner import make_worlds
from wayfield.policies.training.presets import PRESETS, Preset
from wayfield.policies.training.shaping import GoalReward, PathReward, Shaped
from wayfield.policies.training.validation import validate

PATH, OMNI = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"
DT = 0.05  # s

FOLLOWING = PRESETS["path_following_plain"].changed(
    shares=((0.5, {"scenario": "s_curve"}), (0.5, {"scenario": "circle", "noise": 1.0, "actuators": "slow"})),
    validation={"scenario": "s_curve", "actuators": "lagged"},
    features=PathFeatures(previous=3, limits=True),
    reward=PathReward(chatter_cost=0.5),
    paces=(0.4, 0.6),
    **SHORT,
)
SEEKING = FOLLOWING.changed(
    shares=(
        (0.5, {"scenario": "discs", "num_beams": 24, "max_range": 5.0}),
        (0.5, {"scenario": "discs", "num_beams": 24, "max_range": 5.0, "max_episode_steps": 11}),
    ),
    **SEEKER,
)


def begun(preset: Preset, env_id: str, seed: int = 3) -> tuple[Shaped, NDArray[np.float32]]:
    """Returns the worlds of a preset and their first inputs."""
    env = make_worlds(preset, env_id)
    env.seed(seed)
    return env, env.reset()


# What is seen.


@pytest.mark.parametrize(("env_id", "preset"), [(PATH, FOLLOWING), (OMNI, SEEKING)], ids=["following", "seeking"])
def test_a_row_sees_what_an_agent_sees_that_began_with_its_episode(env_id: str, preset: Preset) -> None:
    """Before, at and after an end: the memory of the last episode is gone, and that of the new one begins."""
    env, inputs = begun(preset, env_id)
    perception, layout = env.perception, env.worlds.task.layout
    memory = perception.fresh(env.num_envs)
    paces = np.repeat([pace for _, _, pace in preset.parts], [count for count, _, _ in preset.parts])
    pilots = env.make_pilots(preset.controller_at) if preset.prior.reach else []
    limits = np.concatenate(
        [[limits_of(preset.features, part.task.options.actuators)] * part.num_envs for part in env.worlds.parts]
    )

    def fields(observations: NDArray[np.float32]) -> Any:
        return layout.unpack(observations.astype(np.float64))

    rng, ends = np.random.default_rng(0), 0
    for _ in range(3 * preset.worlds.time_limit + 5):
        asked = env.ask(pilots) if pilots else None
        expected, _ = perception.inputs(fields(env.observations), paces, memory, asked, limits)
        np.testing.assert_array_equal(inputs, expected)
        actions = rng.uniform(-1.0, 1.0, (env.num_envs, 2)).astype(np.float32)
        perception.remember(inputs, actions, memory)
        inputs, _, ended, infos = env.step(actions)
        rows = np.flatnonzero(ended)
        ends += len(rows)
        if len(rows):
            finals = fields(env.worlds.final_observations(rows))
            of_rows = None if asked is None else asked[rows]
            last, _ = perception.inputs(finals, paces[rows], memory[rows], of_rows, limits[rows])
            np.testing.assert_array_equal([infos[i]["terminal_observation"] for i in rows], last)
            memory[rows] = perception.fresh(len(rows))
            env.tell(pilots, ended)
    assert ends >= 3 * env.num_envs


def test_only_the_clock_truncates() -> None:
    """Straight on, the circle's corridor is left in a certain step; a clock that runs out in it changes nothing."""
    preset = FOLLOWING.changed(
        shares=((1.0, {"scenario": "circle"}),), paces=(0.6,), num_envs=1, horizon=64, time_limit=1000
    )

    def first_end(clock: int) -> tuple[int, dict[str, Any]]:
        env, _ = begun(preset.changed(time_limit=clock), PATH)
        for step in range(1, clock + 1):
            _, _, ended, infos = env.step(np.array([[1.0, 0.0]]))
            if ended[0]:
                return step, infos[0]
        raise AssertionError("the clock should have run out")

    left, info = first_end(1000)
    assert left < 500
    assert info["TimeLimit.truncated"] is False
    step, info = first_end(left)
    assert (step, info["TimeLimit.truncated"]) == (left, False)
    step, info = first_end(left - 1)
    assert (step, info["TimeLimit.truncated"]) == (left - 1, True)


# What is paid.

cost = st.floats(0.0, 100.0)


@given(
    st.builds(PathReward, cost, cost, st.floats(0.0, 1.0), cost, cost, cost, cost, st.floats(0.05, 1.0), cost),
    st.floats(-0.05, 0.1), st.floats(-1.0, 1.0), st.floats(0.1, 1.5), st.tuples(*[st.floats(0.0, 8.0)] * 2),
    st.floats(0.0, 1.0), st.booleans(),
)  # fmt: skip
def test_the_reward_of_a_path_is_its_formula(
    reward: PathReward, ds: float, e: float, u: float, changes: tuple[float, float], share: float, left: bool
) -> None:
    told = {
        "progress": np.array([0.0, ds]),
        "cross_track_error": np.array([0.0, e]),
        "left_corridor": np.array([False, left]),
    }
    found = reward(told, np.array([1.0, u]), np.array([[0.0, changes[0]], [0.0, changes[1]]]), DT, share)
    # from leniency to 1 over the first half of a run, and the cost of a stall from the first to the last over all of it
    strictness = 1.0 if share > 0.5 else reward.leniency + (1.0 - reward.leniency) * share / 0.5
    stall_cost = (1.0 - share) * reward.stall_cost + share * reward.final_stall_cost
    pace = ds / (u * DT)
    expected = pace * (1.0 - strictness * reward.error_cost * abs(e)) - strictness * reward.error_rate * abs(e)
    expected -= reward.jerk_cost * changes[0] + reward.chatter_cost * changes[1]
    expected -= stall_cost * min(max(1.0 - pace / reward.stall_share, 0.0), 1.0)
    expected -= reward.failure if left else 0.0
    assert found[1] == pytest.approx(expected, rel=1e-9, abs=1e-9)
    # who stands on the path pays for standing alone
    assert found[0] == pytest.approx(-stall_cost)


@given(
    st.builds(GoalReward, cost, cost, st.floats(0.01, 1.0), cost, cost, cost),
    st.floats(-0.1, 0.1), st.floats(-0.1, 1.0), st.floats(0.1, 1.5), st.floats(0.0, 8.0), st.booleans(), st.booleans(),
)  # fmt: skip
def test_the_reward_of_a_goal_is_its_formula(
    reward: GoalReward, ds: float, clearance: float, u: float, change: float, arrived: bool, touched: bool
) -> None:
    told = {
        "progress": np.array([ds]),
        "clearance": np.array([clearance]),
        "success": np.array([arrived]),
        "collision": np.array([touched]),
    }
    (found,) = reward(told, np.array([u]), np.array([[change], [9.0]]), DT, 0.3)
    near = min(max(0.0, 1.0 - clearance / reward.near), 1.0)  # a hull is never nearer than contact
    expected = ds / (u * DT) - reward.time_cost - reward.near_cost * near**2 - reward.jerk_cost * change
    expected += (reward.success if arrived else 0.0) - (reward.collision if touched else 0.0)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("env_id", "preset"), [(PATH, FOLLOWING), (OMNI, SEEKING)], ids=["following", "seeking"])
def test_rows_are_paid_at_their_own_pace_for_what_the_world_tells(env_id: str, preset: Preset) -> None:
    """With the change between clipped actions, progress on the shortest way where it is known, and times 1 - gamma."""
    env, _ = begun(preset, env_id)
    env.share = 0.3
    rng = np.random.default_rng(1)
    before, before_that = np.zeros((2, env.num_envs, 2), np.float32)
    paces = np.repeat([pace for _, _, pace in preset.parts], [count for count, _, _ in preset.parts])
    ends = 0
    for _ in range(2 * preset.worlds.time_limit):
        actions = rng.uniform(-2.0, 2.0, (env.num_envs, 2)).astype(np.float32)
        left = None if env.ways is None else env.ways(env.worlds)
        _, rewards, ended, _ = env.step(actions)
        actions = np.clip(actions, -1.0, 1.0)
        told = dict(env.worlds.infos)
        if left is not None:
            assert env.ways is not None
            # where the next episode has begun, the way that was left is not known any more
            told["progress"] = np.where(ended, np.minimum(told["progress"], 0.1), left - env.ways(env.worlds))
        changes = np.square([actions - before, actions - 2.0 * before + before_that]).sum(axis=2)
        expected = preset.reward(told, paces, changes, DT, 0.3) * (1.0 - preset.learning.discount)
        np.testing.assert_allclose(rewards, expected, rtol=1e-5, atol=1e-6)
        before_that = np.where(ended[:, None], np.float32(0.0), before)
        before = np.where(ended[:, None], np.float32(0.0), actions)
        ends += int(ended.sum())
    assert ends >= 2 * env.num_envs


# What is trained with.


@example(shares=[0.21875, 1.0, 1.0, 1.0], paces=[1.0, 1.0, 1.0, 1.0], num_envs=200)  # rounded, there were four too many
@given(
    st.lists(st.floats(0.2, 1.0), min_size=1, max_size=4), st.lists(st.floats(0.1, 1.5), min_size=1, max_size=4),
    st.integers(200, 1100),
)  # fmt: skip
def test_robots_are_shared_out_to_the_worlds_and_paces(shares: list[float], paces: list[float], num_envs: int) -> None:
    worlds = tuple((share / sum(shares), {"num_preview": k}) for k, share in enumerate(shares))
    parts = FOLLOWING.changed(shares=worlds, paces=tuple(paces), num_envs=num_envs, steps=10**6).parts
    assert sum(count for count, _, _ in parts) == num_envs
    asked = [(share / len(paces) * num_envs, kwargs, pace) for share, kwargs in worlds for pace in paces]
    for (count, kwargs, pace), (wanted, asked_kwargs, asked_pace) in zip(parts, asked, strict=True):
        assert abs(count - wanted) <= 1.5 + 1e-9
        assert (kwargs, pace) == (asked_kwargs, asked_pace)


def test_a_world_s_own_arguments_go_before_those_of_all() -> None:
    """Its clock and its robot, where it says so; the preset's elsewhere, and the pace of its part."""
    own = {"scenario": "circle", "max_episode_steps": 7, "robot": "turtlebot3", "actuators": "slow"}
    preset = FOLLOWING.changed(
        shares=((0.5, {"scenario": "s_curve"}), (0.5, own)), time_limit=9, robot="p3dx", paces=(0.2, 0.3)
    )
    env = make_worlds(preset, PATH)
    slow = ROBOTS["turtlebot3"].actuators("slow")
    found = [(part.max_episode_steps, part.task.robot.name, part.task.scenarios[0].name) for part in env.worlds.parts]
    first, last = path_scenarios("s_curve")[0].name, path_scenarios("circle")[0].name
    assert found == [(9, "p3dx", first)] * 2 + [(7, "turtlebot3", last)] * 2
    assert [part.task.options.actuators == slow for part in env.worlds.parts] == [False, False, True, True]
    assert env.speeds.tolist() == [0.2] * 4 + [0.3] * 4 + [0.2] * 4 + [0.3] * 4


# What is taught.


@pytest.mark.parametrize("room", [500, 3000])
def test_lessons_keep_early_and_late_ones_alike(room: int) -> None:
    """Of 2,000 that came in lots, each is as likely among those that are kept; what was seen stays with its answer."""
    lessons = imitation.Lessons(room, 1, np.random.default_rng(0))
    for first in range(0, 2000, 100):
        came = np.arange(first, first + 100, dtype=np.float32)
        lessons.add(came[:, None], np.column_stack([came, -came]))
    drawn = np.concatenate([np.hstack([x, y]) for x, y in lessons.batches(20 * imitation.BATCH)])
    assert len(drawn) == 20 * imitation.BATCH
    np.testing.assert_array_equal(drawn[:, 0], drawn[:, 1])
    np.testing.assert_array_equal(drawn[:, 0], -drawn[:, 2])
    kept = np.unique(drawn[:, 0])
    assert len(kept) == min(room, 2000)
    # of 500 of 2,000, a quarter of which is expected of each quarter: 125, with a standard deviation under 10
    shares = np.histogram(kept, 4, (0, 2000))[0] / len(kept)
    assert np.abs(shares - 0.25).max() < 0.1


# What is judged.


@pytest.mark.parametrize(
    ("env_id", "scenario", "policy", "clock", "kwargs"),
    [
        # the clock ends the longer circuits; a shove across the way is out of the corridor
        (PATH, "circuits/validation", "pure_pursuit", 450, {}),
        (PATH, "splines/validation", "pure_pursuit", 1200, {"shove": (2.0, 0.0, 1.05, 0.0)}),
        (OMNI, "clutter_10/validation", "apf_corrected", 600, {}),
        (OMNI, "clutter_5/validation", "waypoint", 1200, {}),
    ],
)
def test_a_score_is_that_of_its_costs(
    env_id: str, scenario: str, policy: str, clock: int, kwargs: dict[str, Any]
) -> None:
    """The same episodes, driven and measured by the benchmarks."""
    conditions = {"scenario": scenario, "actuators": "lagged", **kwargs}
    found = validate(policies.make(policy), env_id, conditions, clock, seed=5)
    task = "path_following" if env_id == PATH else "goal_reaching"
    count = len(splits.split(task, *scenario.split("/")))
    case = Case(
        "", "", env_id, scenario, policy, env_kwargs=kwargs, max_episode_steps=clock, every_scenario=True
    )  # fmt: skip
    rows = [measure(each) for each in roll_out(case, actuators="lagged", seed=5, episodes=count)]
    won = np.array([row["success"] for row in rows])
    times = np.array([row["time"] for row in rows])
    assert 0.0 < won.mean() < 1.0  # both kinds of end, or this tests little
    if env_id == PATH:
        costs = np.where(won == 1.0, [row["cross_track_rms"] for row in rows], 1.0)
        assert found.score == pytest.approx(-(float(iqm(costs)) + float(np.percentile(costs, 95)) / 4.0))
        assert found.error == pytest.approx(float(iqm(costs)))
        assert found.p95 == pytest.approx(float(np.percentile(costs, 95)))
        assert found.median == pytest.approx(float(np.median(costs)))
        failed = "left_corridor"
    else:
        collided = np.array([row["collision"] for row in rows])
        costs = np.where(won == 1.0, times / (clock * DT), np.where(collided == 1.0, 2.0, 1.0))
        assert found.score == pytest.approx(-costs.mean())
        assert found.error == pytest.approx(float(iqm(times[won == 1.0])))
        late = np.where(won == 1.0, times, clock * DT)
        assert found.p95 == pytest.approx(float(np.percentile(late, 95)))
        assert found.median == pytest.approx(float(np.median(late)))
        failed = "collision"
    assert found.success == pytest.approx(won.mean())
    assert found.collision == pytest.approx(np.mean([row[failed] for row in rows]))
    assert found.speed == pytest.approx(np.mean([row["mean_speed"] for row in rows]))


@pytest.mark.parametrize("kind", [PathReward, GoalReward])
def test_a_weight_of_a_reward_is_a_finite_number(kind: Any) -> None:
    for field in dataclasses.fields(kind):
        for value in (math.inf, -math.inf, math.nan, "much"):
            with pytest.raises(ValueError, match=rf"{field.name} must be a finite number"):
                kind(**{field.name: value})
