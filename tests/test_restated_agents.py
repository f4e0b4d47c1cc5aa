"""What an agent knows of where it may drive, and how its parts decide together, stated once more."""

import dataclasses
import itertools
import json
import math
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield
from wayfield import policies
from wayfield.envs.robots import ACTUATORS, ROBOTS, Actuators
from wayfield.policies.learned import agent as agents
from wayfield.policies.learned import conditions, reading
from wayfield.policies.learned.agent import Agent, Network, held_law, load_agent, read_card, rounded
from wayfield.policies.learned.conditions import driven_as, driven_speed, outside
from wayfield.policies.learned.perception import GoalFeatures, hold
from wayfield.policies.learned.ppo import shipped, shipped_agent, trained
from wayfield.policies.learned.residual import Base, controller_at
from wayfield.policies.pilot import Pilot
from wayfield.policies.training import measured
from wayfield.policies.training.presets import PRESETS, overridden, settable
from wayfield.policies.training.run import trained_on
from wayfield.policies.training.settings import _text, rows
from wayfield.policies.training.validation import Score, validated

PATH, GOAL = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveGoalObstacles-v0"
TIERS: Any = (*ACTUATORS.values(), *(Actuators(True, a, w, lag) for a, w, lag in itertools.product(
    (0.3, 1.0, 1.5), (1.0, 3.0, 4.0), (0.05, 0.1, 0.3))))  # fmt: skip


def briefing_of(env_id: str, **kwargs: Any) -> Any:
    env = gymnasium.make(env_id, **kwargs)
    env.reset(seed=0)
    return env.unwrapped.briefing("sensors")  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def told() -> Any:
    return briefing_of(PATH)


def stopping(speed: float, base: Actuators) -> float:
    """Returns the way (m) on which a base stops."""
    return speed * base.lag + speed**2 / (2.0 * base.acceleration)


@pytest.mark.parametrize("known", [("lagged",), ("slow",), ("lagged", "slow"), ("ideal",), ("slow", "ideal", "lagged")])
def test_which_base_an_agent_drives_a_base_as_and_how_fast(known: tuple[str, ...], told: Any) -> None:
    cruises = {"lagged": [[0.4, 0.3], [0.8, 0.5]], "slow": [[0.5, 0.4]]}
    card = {"trained_on": {"actuators": [*known], "speeds": [0.8, 0.4], "disturbances": [], "beams": []}}
    card["cruises"] = {tier: each for tier, each in cruises.items() if tier in known}
    bases = [ACTUATORS[tier] for tier in known]
    for own, speed in itertools.product(TIERS, (0.2, 0.45, 0.7, 0.9)):
        here = dataclasses.replace(told, actuators=own)
        best = max(bases, key=lambda each: each.acceleration)
        is_quicker = (
            own.acceleration >= best.acceleration
            and own.yaw_acceleration >= best.yaw_acceleration
            and own.lag <= best.lag
        )
        wanted = own if own in bases or not is_quicker else best
        assert driven_as(card, here) == wanted
        if wanted in bases:
            pairs = card["cruises"].get(known[bases.index(wanted)], [])
            asked = speed
            if pairs and speed <= pairs[-1][1]:
                steps = [[0.0, 0.0], *pairs]
                for (a, b), (c, d) in itertools.pairwise(steps):
                    if b <= speed <= d:
                        asked = a + (c - a) * (speed - b) / (d - b)
            elif pairs:
                asked = pairs[-1][0] if pairs[-1][0] < 0.8 else max(pairs[-1][0], speed)
            assert driven_speed(card, here, speed) == pytest.approx(asked)
            continue
        worst = min(bases, key=lambda each: each.acceleration)
        slowed = driven_speed(card, here, speed)
        if worst.acceleration == math.inf or stopping(speed, own) <= stopping(speed, worst):
            assert slowed == speed
        else:
            assert slowed < speed
            assert stopping(slowed, own) == pytest.approx(stopping(speed, worst))
    assert driven_as({}, told) is told.actuators
    assert driven_speed({}, told, 0.33) == 0.33
    assert outside({}, told, 9.0) == ""


MEASURED = [
    {"asked_speed": 0.6, "env_kwargs": {"actuators": "slow", "num_beams": 72}, "success": 0.91, "collision": 0.04,
     "error": 13.37},
    {"asked_speed": 1.05, "env_kwargs": {"actuators": "lagged"}, "success": 0.8, "collision": 0.1, "error": 0.01234},
    {"asked_speed": 0.6, "env_kwargs": {}, "success": 0.5, "collision": 0.2, "error": None},
]  # fmt: skip
SAID = [
    "91 % succeeded, 4 % failed badly, 13.4 s (slow, 0.6 m/s, 72 beams)",
    "80 % succeeded, 10 % failed badly, 0.0123 m off (lagged, 1.05 m/s)",
    "50 % succeeded, 20 % failed badly (ideal, 0.6 m/s)",
]
VALIDATED = "97 % succeeded, 1 % failed badly, 11.0 s (lagged, 0.6 m/s, 72 beams)"


@pytest.mark.parametrize(
    ("kwargs", "speed", "news", "nearest"),
    [
        ({"actuators": "lagged", "num_beams": 72}, 0.6, "", ""),
        ({"actuators": "ideal", "num_beams": 72}, 0.6, "", ""),  # driven as the lagged one
        ({"actuators": "lagged", "num_beams": 72}, 0.397, "", ""),
        ({"actuators": "lagged", "num_beams": 72}, 0.807, "", ""),
        ({"actuators": "lagged", "num_beams": 72}, 0.39, "at 0.39 m/s, not 0.4 to 0.8", VALIDATED),
        ({"actuators": "lagged", "num_beams": 72}, 0.9, "at 0.9 m/s, not 0.4 to 0.8", VALIDATED),
        ({"actuators": "lagged", "num_beams": 32}, 1.05,
         "at 1.05 m/s, not 0.4 to 0.8 and with 32 beams, not 72", SAID[1]),
        ({"actuators": "slow", "num_beams": 72}, 0.6,
         "with actuators 'slow', not lagged (so at no more than X m/s)", SAID[0]),
        ({"actuators": "ideal", "num_beams": 32}, 0.6, "with 32 beams, not 72", SAID[2]),
        # the tier says more than the beams
        ({"actuators": "ideal", "num_beams": 72}, 0.9, "at 0.9 m/s, not 0.4 to 0.8", SAID[2]),
    ],
)  # fmt: skip
def test_the_line_that_warns(kwargs: dict[str, Any], speed: float, news: str, nearest: str) -> None:
    here = briefing_of(GOAL, **kwargs)
    card = {
        "name": "one, seed 3", "speed": 0.6, "env_kwargs": {"actuators": "lagged", "num_beams": 72},
        "trained_on": {"actuators": ["lagged"], "speeds": [0.8, 0.4], "disturbances": [], "beams": [72]},
        "validation": {"success": 0.97, "collision": 0.01, "error": 11.02}, "measured": MEASURED,
    }  # fmt: skip
    base = ACTUATORS["slow"]
    way = stopping(speed, ACTUATORS["lagged"])
    v = base.acceleration * (math.sqrt(base.lag**2 + 2.0 * way / base.acceleration) - base.lag)
    news = news.replace("X", f"{v:.2f}")
    wanted = f"one drives {news}, which it was trained on; nearest to that, {nearest}" if news else ""
    assert outside(card, here, speed) == wanted
    if news:
        bare = {name: each for name, each in card.items() if name not in ("measured", "validation", "name")}
        assert outside(bare, here, speed).endswith("nearest to that, nothing was measured")
        assert outside(bare, here, speed).startswith("an agent drives")
        alone = {**card, "trained_on": {**card["trained_on"], "speeds": [0.5], "beams": []}}
        assert ("at 0.9 m/s, not 0.5," in outside(alone, here, 0.9) + ",") or "and with" in outside(alone, here, 0.9)
        assert "beams, not any" in outside(alone, here, 0.9)


@pytest.mark.parametrize(
    ("condition", "whole"),
    [
        ({"env_kwargs": {}, "asked_speed": 1, "success": 0.5, "collision": 0.0}, True),
        ({"env_kwargs": {}, "asked_speed": 1, "success": 0.5, "collision": 0.0, "error": None}, True),
        ({"env_kwargs": {}, "asked_speed": 1, "success": 0.5, "collision": 0.0, "error": "x"}, False),
        ({"env_kwargs": {}, "asked_speed": 1, "success": math.nan, "collision": 0.0}, False),
        ({"env_kwargs": {}, "asked_speed": 1, "success": 0.5}, False),
        ({"env_kwargs": [], "asked_speed": 1, "success": 0.5, "collision": 0.0}, False),
        ([], False),
    ],
)
def test_what_of_a_card_counts_as_measured(condition: Any, whole: bool) -> None:
    card = {"measured": [condition]}
    if whole:
        conditions.check_conditions(card)
    else:
        with pytest.raises(ValueError, match=r"measured\[0\]"):
            conditions.check_conditions(card)


def outputs_of(network: Network, inputs: Any) -> Any:
    """Returns what a network answers, by matrices of doubles."""
    values, first = np.asarray(inputs, float), 0
    pairs = list(itertools.pairwise(network.sizes.tolist()))
    for k, (come, go) in enumerate(pairs):
        weight = network.numbers[first : first + come * go].reshape(come, go).astype(float)
        values = values @ weight + network.numbers[first + come * go : first + (come + 1) * go]
        first += (come + 1) * go
        if k < len(pairs) - 1:
            values = np.maximum(values, 0.0) if network.activation == "relu" else np.tanh(values)
    return values


def cases() -> Iterator[tuple[str, str, str, int]]:
    yield "path_following", "p3dx", PATH, 0
    yield "goal_reaching", "p3dx", GOAL, 72
    yield "goal_reaching", "omni3", "wayfield/OmniGoalObstacles-v0", 72
    yield "docking", "p3dx", "wayfield/DiffDriveDocking-v0", 72


@pytest.mark.parametrize(("task", "robot", "env_id", "beams"), list(cases()))
@pytest.mark.parametrize("tier", ["ideal", "lagged", "slow", "slower"])
@pytest.mark.filterwarnings("ignore::wayfield.policies.learned.conditions.NewToAgent")
def test_an_agent_decides_by_its_parts_one_after_the_other(
    task: str, robot: str, env_id: str, beams: int, tier: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(agents, "_WARNED", set())
    agent = dataclasses.replace(shipped_agent(task, robot, 0), speed=0.5)
    based = task == "path_following" and tier == "lagged"
    if based:  # a network of its own that adds to a law
        base = Base("pure_pursuit", {}, 0.3)
        seen = agent.perception(briefing_of(env_id)).num_inputs + 2
        rng = np.random.default_rng(2)
        layers = [(rng.normal(0.0, 0.3, (8, seen)), np.zeros(8)), (rng.normal(0.0, 0.4, (2, 8)), np.zeros(2))]
        agent = dataclasses.replace(agent, network=Network.of(layers), base=base)
        assert agent.knows == policies.make("pure_pursuit").knows
    kwargs = {"num_beams": beams} if beams else {}
    given_tier = "slow" if tier == "slower" else tier
    env = gymnasium.make_vec(
        env_id, 4, vectorization_mode="vector_entry_point", actuators=given_tier, robot=robot, **kwargs
    )
    pilot = Pilot(agent, env)
    observation, _ = env.reset(seed=3)
    pilot.reset()
    if tier == "slower":  # than any that it was trained on
        pilot.briefing = dataclasses.replace(pilot.briefing, actuators=Actuators(True, 0.3, 0.8, 0.25))
    here = pilot.briefing
    actuators, speed = driven_as(agent.card, here), driven_speed(agent.card, here, 0.5)
    is_held = actuators != here.actuators
    assert is_held == (tier == "ideal")
    assert (speed < 0.45) == (tier == "slower")
    perception, axes = agent.perception(here), list(here.robot.twist_axes)
    memory, speeds = perception.fresh(4), np.full(4, speed)
    held, given = np.zeros((4, 2, 3)), np.zeros((4, 3))
    law = controller_at("pure_pursuit", {}, 0.5) if based else None
    kept = law.reset(here) if law else None
    near = np.empty(0, int)
    if beams:
        near = here.layout.unpack(np.arange(observation.shape[1], dtype=float)[None]).ranges[0].astype(int)
    draws = np.random.default_rng(7)
    for k in range(6):
        # what stands comes near on one side, so that the guard has to do, and the more the longer a base turns on
        sides = np.cos(np.linspace(-np.pi, np.pi, len(near)) - draws.uniform(-np.pi, np.pi, (4, 1)))
        room = (1.5, 1.0, 0.7, 0.4, 0.2, 0.1)[k] * np.exp(1.5 * sides)
        observation[:, near] = np.minimum(observation[:, near], here.robot.hull_radius + room)
        seen = here.layout.unpack(observation.astype(float))
        if is_held:
            seen = seen._replace(twist=seen.twist + (held[:, 1] - given)[:, axes])
        asked = law.act(seen, here, kept) if law else None
        limits = None
        if agent.features.limits:
            told = (agent.features.speed_scale / actuators.acceleration,
                    agent.features.yaw_scale / actuators.yaw_acceleration, actuators.lag / 0.1)  # fmt: skip
            limits = np.minimum(np.float32(told), np.float32(5.0))
        inputs, angles = perception.inputs(seen, speeds, memory, asked, limits)
        actions = np.clip(outputs_of(agent.network, inputs), -1.0, 1.0).astype(np.float32)
        perception.remember(inputs, actions, memory)
        if asked is None:
            twists = agent.actions.twists(actions, speeds, angles, here.robot)
        else:
            twists = agent.actions.added(asked, actions, 0.3, speeds, angles, here.robot)
        twists = agent.features.arrived(seen, twists, speed, actuators)
        twists = agent.features.guarded(seen, twists, speed, actuators, eased=True)
        if is_held:
            hold(*held_law(here, actuators), held, twists)
            given[:, axes] = twists
        found = pilot.command(observation)
        np.testing.assert_allclose(found, twists, atol=2e-5)
        observation, *_ = env.step(found)
    env.close()


def test_a_base_is_held_by_the_limits_of_the_slower_one(told: Any) -> None:
    robot = told.robot
    for own, slower in itertools.product((ACTUATORS["ideal"], Actuators(True, 2.0, 4.0, 0.02)), TIERS[1:3]):
        law, matrix = held_law(dataclasses.replace(told, actuators=own), slower)
        decay = math.exp(-told.dt / (slower.lag - own.lag))
        mean = (1.0 - decay) * (slower.lag - own.lag) / told.dt
        most = robot.rated_wheel_speed if slower.at_rated_speed else robot.peak_wheel_speed
        wanted = [slower.acceleration, slower.yaw_acceleration, told.dt, decay, mean, most, robot.turn_speed]
        assert law.tolist() == pytest.approx(wanted)
        np.testing.assert_array_equal(matrix, robot.wheel_matrix)


def test_agents_are_found_by_their_seeds(tmp_path: Path) -> None:
    for name in ("seed_10/best", "seed_2/best", "seed_02/best", "seed_x/best", "seed_7", "other/best"):
        (tmp_path / name).mkdir(parents=True)
    assert list(trained(str(tmp_path))) == [2, 10]
    assert trained(str(tmp_path))[10] == tmp_path / "seed_10" / "best"
    home = Path(wayfield.__file__).parent / "policies" / "agents" / "docking_p3dx"
    assert shipped("docking", "p3dx") == {k: home / f"seed_{k}" for k in range(len(list(home.iterdir())))}
    with pytest.raises(ValueError, match="no agent of seed 99 ships for docking with p3dx; there are seeds 0, 1, 2"):
        shipped_agent("docking", "p3dx", 99)
    with pytest.raises(ValueError, match="there are none"):
        shipped_agent("docking", "kobuki", 0)
    assert shipped_agent("docking", "p3dx", 1, 0.3).speed == 0.3
    assert shipped_agent("docking", "p3dx", 1).speed == load_agent(home / "seed_1").card["speed"]


def test_an_agent_of_ones_own_drives_and_not_the_one_that_ships(tmp_path: Path, told: Any) -> None:
    home = Path(wayfield.__file__).parent / "policies" / "agents" / "path_following_p3dx"
    for seed, of in ((0, 1), (3, 0)):  # seed 0 here is another one there
        shutil.copytree(home / f"seed_{of}", tmp_path / f"seed_{seed}" / "best")
    for seed, of in ((0, 1), (3, 0)):
        mine: Any = policies.make("ppo", seed=seed, home=str(tmp_path))
        assert mine.agent(told).card["sha256"] == load_agent(home / f"seed_{of}").card["sha256"]
        assert mine.knows == "sensors"
    slow: Any = policies.make("ppo", seed=3, home=str(tmp_path), speed=0.4)
    assert slow.agent(told).speed == 0.4
    ships: Any = policies.make("ppo", seed=0, speed=0.4)
    assert ships.agent(told).card["sha256"] == load_agent(home / "seed_0").card["sha256"]
    with pytest.raises(ValueError, match="holds agents for path_following, not for goal_reaching"):
        slow.agent(briefing_of(GOAL))
    lost: Any = policies.make("ppo", seed=1, home=str(tmp_path))
    with pytest.raises(ValueError, match=r"no agent of seed 1 is in .*; there are seeds 0, 3"):
        lost.agent(told)


def test_the_nearest_number_of_eight_bits() -> None:
    rng = np.random.default_rng(0)
    numbers = np.concatenate([rng.normal(size=400), [0.0, -0.0, 1.0, 1.0 + 2.0**-8, 1.0 + 3.0 * 2.0**-8]]).astype(
        np.float32
    )
    ((found, _),) = rounded([(numbers, numbers)])
    for number, near in zip(numbers.astype(float).tolist(), found.astype(float).tolist(), strict=True):
        fraction, exponent = math.frexp(number)
        # eight bits of a fraction from 0.5 to 1; Python rounds halves to the even one too
        assert near == math.ldexp(round(fraction * 256.0) / 256.0, exponent)


def test_in_what_an_agent_is_measured() -> None:
    speeds_of = {"path_following": [1.05], "goal_reaching": [0.3, 1.0, 0.6, 0.6], "docking": [0.6]}
    for task, robot, _, beams in cases():
        agent = shipped_agent(task, robot, 0)
        own = dict(agent.card["env_kwargs"])
        found = measured.conditions(agent)
        assert found[0] == (agent.speed, {**own, "actuators": "slow"})
        of_robot = {"robot": own["robot"]} if "robot" in own else {}
        made = {"actuators": "ideal", "num_beams": 32, **of_robot}
        rest = {
            "path_following": [own],
            "goal_reaching": [own, own, {"scenario": "discs", **made}, {"scenario": "open_field", **made}],
            "docking": [{"scenario": "all/validation", **made}],
        }[task]
        assert found[1:] == list(zip(speeds_of[task], rest, strict=True))
        assert (beams == 72) == ("num_beams" in own)
    score = {"success": 1.0, "error": math.nan}
    assert measured.measurement(0.6, {"a": 1}, score) == {
        "asked_speed": 0.6, "env_kwargs": {"a": 1}, "success": 1.0, "error": None,
    }  # fmt: skip
    nobody_came = Score(-2.0, 0.0, 1.0, math.nan, 60.0, 60.0, 0.3, -4.0)
    assert validated(nobody_came) == {
        "score": -2.0, "success": 0.0, "collision": 1.0, "error": None, "median": 60.0, "p95": 60.0, "speed": 0.3,
        "return": -4.0,
    }  # fmt: skip


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_s_worlds_and_settings(name: str) -> None:
    preset = PRESETS[name]
    worlds = [dict(kwargs) for _, kwargs in preset.worlds]
    found = trained_on(preset)
    assert found["actuators"] == [*dict.fromkeys(each.get("actuators", "ideal") for each in worlds)]
    assert found["disturbances"] == [*dict.fromkeys(each.get("disturbance", "none") for each in worlds)]
    assert found["speeds"] == [*preset.paces]
    assert found["beams"] == sorted({each["num_beams"] for each in worlds if "num_beams" in each})
    assert sum(share for share, _ in preset.worlds) == pytest.approx(1.0)
    counts = [count for count, _, _ in preset.parts]
    assert sum(counts) == preset.num_envs
    for (count, kwargs, pace), ((share, world), asked) in zip(
        preset.parts, itertools.product(preset.worlds, preset.paces), strict=True
    ):
        assert (kwargs, pace) == (world, asked)
        assert abs(count - preset.num_envs * share / len(preset.paces)) <= 1.5
    if isinstance(preset.features, GoalFeatures):  # it sees by the scan that it has, of the hull that it has
        assert preset.robot is not None
        assert preset.features.hull_radius == ROBOTS[preset.robot].hull_radius
        for each in (*worlds, preset.validation, *(kwargs for _, kwargs in preset.conditions)):
            assert (each["num_beams"], each["max_range"]) == (preset.features.num_beams, preset.features.max_range)
    splits = [*(str(each["scenario"]).partition("/")[2] for each in worlds)]
    chosen = [str(kwargs["scenario"]) for kwargs in (preset.validation, *(each for _, each in preset.conditions))]
    assert (set(splits), set(chosen)) == ({"train"}, {"all/validation"})
    # another robot comes with its hull, unless another is asked for
    if isinstance(preset.features, GoalFeatures) and not preset.reach:
        settings = [
            f"robot={next(each for each in ('omni4', 'p3dx') if each != preset.robot)}",
            "controller_gains=default",
        ]
        assert overridden(preset, settings).features == dataclasses.replace(
            preset.features, hull_radius=ROBOTS[settings[0].partition("=")[2]].hull_radius
        )
        other = overridden(preset, [*settings, "features.hull_radius=0.123"])
        assert other.features == dataclasses.replace(preset.features, hull_radius=0.123)
    # every key takes its own default, as it is listed, and changes nothing
    listed = {key: default for key, default, _, _ in rows(preset)}
    again = overridden(preset, [f"{key}={'' if text == 'empty' else text}" for key, text in listed.items()])
    assert again == preset
    assert list(listed) == [key for key, _ in settable(preset)]


def test_the_gains_of_a_controller_that_teaches() -> None:
    for name, robot in (("diff_drive_goal", "p3dx"), ("omni4_goal", "omni4"), ("omni3_goal", "omni3")):
        preset = dataclasses.replace(PRESETS[name], controller="dwa")
        tuned = policies.tuned_gains("dwa", "goal-obstacles", robot)
        for asked, wanted in (("tuned", tuned), ("default", {}), ("shipped", tuned)):  # by it, no agent was taught
            found = dataclasses.replace(preset, controller_gains=asked)  # type: ignore[arg-type]
            assert found.gains == wanted
            assert found.controller_at(0.45) == controller_at("dwa", wanted, 0.45)
        taught = read_card(shipped("goal_reaching", robot)[0] / "card.json")["training"]
        preset = dataclasses.replace(PRESETS[name], controller=taught["taught_by"], controller_gains="shipped")
        assert preset.gains == taught["taught_with"]
        assert preset.controller_at(0.45) == controller_at(taught["taught_by"], taught["taught_with"], 0.45)


def test_a_controller_under_an_agent_cruises_at_the_speed_that_is_asked_for() -> None:
    """Whatever speed its gains were tuned for, and with all else of them."""
    for policy in ("lqr", "stanley", "mpc", "pure_pursuit", "regulated_pure_pursuit", "lookahead_retuned", "dwa"):
        gains = policies.tuned_gains(policy, "goal-obstacles" if policy == "dwa" else "path-following", "p3dx")
        for speed in (0.25, 0.6, 1.05):
            for law in (controller_at(policy, gains, speed), Base(policy, gains, 0.2).policy(speed)):
                has: Any = vars(law)
                cruise = next(name for name in ("k_lin", "speed", "max_speed") if name in has)
                ahead = has["lookahead_distance"] if cruise == "k_lin" else 1.0  # that law settles at v = k_lin L
                assert has[cruise] * ahead == pytest.approx(speed)
                assert {name: has[name] for name in gains if name != cruise} == {
                    name: each for name, each in gains.items() if name != cruise
                }


def test_what_is_read_of_files_is_plain_and_bounded(tmp_path: Path) -> None:
    numbers = 0, -3, 2**63 - 1, -(2**63), 0.5, -1e308, 5e-324
    others = (
        *(2**63, -(2**63) - 1, 10**400, math.inf, -math.inf, math.nan), True, None, "1", [1.0], np.float64(1.0)
    )  # fmt: skip
    assert all(map(reading.is_number, numbers))
    assert not any(map(reading.is_number, others))
    assert [value for value in (0, 1, 2, 4, 5, 3.0, True, "3") if reading.is_whole(value, 1, 4)] == [1, 2, 4]
    file = tmp_path / "file"
    file.write_bytes(b'{"a": 1}')
    assert reading.read_bytes(file, 8) == b'{"a": 1}'
    assert reading.read_object(file) == {"a": 1}
    for each, most, words in (
        (file, 7, f"{file} has 8 bytes; at most 7 can be right"),
        (tmp_path, 8, f"{tmp_path} cannot be read: it is no file"),
        (tmp_path / "none", 8, f"{tmp_path / 'none'} cannot be read: No such file or directory"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(words)}$"):
            reading.read_bytes(each, most)
    with pytest.raises(ValueError, match=r"^here holds \[1\]; it must be one object$"):
        reading.parsed_object(b"[1]", "here")
    with pytest.raises(ValueError, match=r"^here is no JSON: "):
        reading.parsed_object(b"\xff", "here")


def test_a_value_as_set_takes_it() -> None:
    values = [(0.1, 2.0), (), None, True, False, 0.1, 1.0, 1 / 3, 1e-7, "", "lqr", 12, 1234567.0]
    assert [_text(value) for value in values] == [
        *("0.1,2", "empty", "none", "true", "false", "0.1", "1", repr(1 / 3), "1e-07", "empty", "lqr", "12"),
        "1234567.0",
    ]


def test_a_controller_has_its_gains_and_its_speed() -> None:
    law: Any = controller_at("lookahead_retuned", {"k_ang": 2.0}, 0.4)
    assert law.k_ang == 2.0
    assert law.k_lin == pytest.approx(0.4 / law.lookahead_distance)
    with pytest.raises(ValueError, match="classical"):
        controller_at("ppo", {}, 0.4)
    with pytest.raises(ValueError, match="with gains"):
        controller_at("lqr", {"speedy": 1.0}, 0.4)
    assert json.loads(json.dumps(dataclasses.asdict(Base("lqr", {}, 0.1)))) == {
        "controller": "lqr", "gains": {}, "reach": 0.1,
    }  # fmt: skip
    assert set(ROBOTS) >= {"p3dx", "omni3"}
    assert isinstance(shipped_agent("docking", "p3dx", 0), Agent)
