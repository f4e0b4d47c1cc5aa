"""Trained agents: the network's numbers, what they see, and the files they are kept in."""

import dataclasses
import itertools
import json
import math
import os
import shutil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.killed import killed_at

import wayfield  # noqa: F401  registers the ids
from wayfield.envs import goal_reaching
from wayfield.envs.robots import ACTUATORS, ROBOTS, Actuators
from wayfield.policies.learned import perception
from wayfield.policies.learned.agent import (
    CARD,
    WEIGHTS,
    Agent,
    Network,
    load_agent,
    save_agent,
    signed,
    weights_digest,
)
from wayfield.policies.learned.conditions import effective_actuators, network_speed
from wayfield.policies.learned.perception import Actions, GoalFeatures, PathFeatures, Perception
from wayfield.policies.learned.residual import Base
from wayfield.policies.pilot import Pilot
from wayfield.system.storage import digest

PATH, OMNI, DIFF = (
    "wayfield/DiffDrivePathFollowing-v0",
    "wayfield/OmniGoalObstacles-v0",
    "wayfield/DiffDriveGoalObstacles-v0",
)


def layers_of(sizes: list[int], seed: int = 0) -> list[tuple[Any, Any]]:
    rng = np.random.default_rng(seed)
    return [
        (rng.normal(0.0, 0.5, (go, come)).astype(np.float32), rng.normal(0.0, 0.1, go).astype(np.float32))
        for come, go in itertools.pairwise(sizes)
    ]


def make_folder(folder: Path, task: str = "path_following", **changes: Any) -> Path:
    """Writes an agent with random weights and returns its folder."""
    path = task == "path_following"
    features = PathFeatures() if path else GoalFeatures()
    based = changes.get("base") is not None
    actions = Actions("unicycle" if path else "planar")
    num_twist = 2 if path else 3
    layers = layers_of([Perception(features, actions, num_twist, 0.05, based).num_inputs, 16, 8, 2])
    card = {
        "name": "a test", "env_id": PATH if path else OMNI, "task": task,
        "robots": ["p3dx"] if path else ["omni3"], "dt": 0.05, "speed": 0.6,
        "features": dataclasses.asdict(features), "actions": dataclasses.asdict(actions),
        "network": {"hidden": [16, 8], "num_twist": num_twist, "activation": "tanh"}, "sha256": weights_digest(layers),
        "training": {"steps": 1000},
    }  # fmt: skip
    save_agent(folder, layers, card | changes)
    return folder


def test_the_network_is_the_matrix_product_with_tanh_between() -> None:
    layers = layers_of([7, 5, 4, 2])
    x = np.random.default_rng(1).normal(size=(20, 7)).astype(np.float32)
    (a, p), (b, q), (c, r) = layers
    expected = c @ np.tanh(b @ np.tanh(a @ x.T + p[:, None]) + q[:, None]) + r[:, None]
    np.testing.assert_allclose(Network.of(layers)(x), expected.T, atol=1e-5)


@pytest.mark.parametrize("sizes", [[33, 64, 64, 2], [46, 128, 3], [5, 1]])
def test_the_network_agrees_with_torch(sizes: list[int]) -> None:
    torch = pytest.importorskip("torch")
    layers = layers_of(sizes)
    x = np.random.default_rng(1).normal(size=(300, sizes[0])).astype(np.float32)
    y = torch.from_numpy(x)
    for k, (weight, bias) in enumerate(layers):
        y = torch.nn.functional.linear(y, torch.from_numpy(weight), torch.from_numpy(bias))
        y = torch.tanh(y) if k < len(layers) - 1 else y
    assert np.abs(Network.of(layers)(x) - y.numpy()).max() < 1e-5


PURSUIT = {"controller": "regulated_pure_pursuit", "gains": {"min_radius": 0.5}, "reach": 0.25}
HISTOGRAM = {"controller": "vfh_plus", "gains": {}, "reach": 0.5}


@pytest.mark.parametrize(
    ("task", "env_id", "base"),
    [
        ("path_following", PATH, None),
        ("goal_reaching", OMNI, None),
        ("path_following", PATH, PURSUIT),
        ("goal_reaching", OMNI, HISTOGRAM),
    ],
)
def test_a_robot_in_a_batch_acts_exactly_as_alone(
    tmp_path: Path, task: str, env_id: str, base: dict[str, Any] | None
) -> None:
    agent = load_agent(make_folder(tmp_path, task, base=base))
    kwargs = {"num_beams": 72} if task == "goal_reaching" else {}
    envs = gymnasium.make_vec(env_id, 5, vectorization_mode="vector_entry_point", noise=1.0, **kwargs)
    pilot = Pilot(agent, envs)
    observations, _ = envs.reset(seed=3)
    pilot.reset()
    singles = [gymnasium.make(env_id, noise=1.0, **kwargs) for _ in range(5)]
    pilots = [Pilot(agent, each) for each in singles]
    alone = [each.reset(seed=3 + i)[0] for i, each in enumerate(singles)]
    for each in pilots:
        each.reset()
    for _ in range(20):
        actions = pilot.act(observations)
        mine = [each.act(seen) for each, seen in zip(pilots, alone, strict=True)]
        np.testing.assert_array_equal(actions, mine)
        observations, *_ = envs.step(actions)
        alone = [each.step(action)[0] for each, action in zip(singles, mine, strict=True)]


@pytest.mark.parametrize("base", [None, PURSUIT])
def test_a_row_that_is_reset_forgets(tmp_path: Path, base: dict[str, Any] | None) -> None:
    agent = load_agent(make_folder(tmp_path, base=base))
    envs = gymnasium.make_vec(PATH, 3, vectorization_mode="vector_entry_point")
    pilot = Pilot(agent, envs)
    observations, _ = envs.reset(seed=0)
    pilot.reset()
    first = pilot.act(observations)
    pilot.act(observations)
    pilot.reset(np.array([1]))
    again = pilot.act(observations)
    np.testing.assert_array_equal(again[1], first[1])
    assert (again[0] != first[0]).any()


@given(seed=st.integers(0, 2**32 - 1), planar=st.booleans(), reverse=st.floats(0.0, 1.0))
def test_actions_are_those_of_their_twists(seed: int, planar: bool, reverse: float) -> None:
    rng = np.random.default_rng(seed)
    meaning = Actions("planar" if planar else "unicycle", 1.5, reverse)
    actions = (rng.uniform(-1.0, 1.0, (20, 2)) / (math.sqrt(2.0) if planar else 1.0)).astype(np.float32)
    speeds, angles = rng.uniform(0.1, 1.2, 20), rng.uniform(-3.0, 3.0, 20)
    twists = meaning.twists(actions, speeds, angles, ROBOTS["omni3" if planar else "p3dx"])
    np.testing.assert_allclose(meaning.of_twists(twists, speeds, angles), actions, atol=1e-5)


@pytest.mark.parametrize(
    ("env_id", "base", "kwargs"),
    [
        (PATH, Base("lqr", {"q_e": 60.0}, 0.3), {"scenario": "s_curve", "actuators": "lagged", "noise": 1.0}),
        (OMNI, Base("dwa", {}, 0.3), {"scenario": "discs", "num_beams": 72, "max_range": 5.0}),
    ],
)
def test_a_network_that_adds_nothing_leaves_its_controller_alone(
    env_id: str, base: Base, kwargs: dict[str, Any]
) -> None:
    path = env_id == PATH
    features = PathFeatures() if path else GoalFeatures(braking=0.0)
    actions = Actions("unicycle" if path else "planar")
    inputs = Perception(features, actions, 2 if path else 3, 0.05, True).num_inputs
    nothing = Network.of([(np.zeros((2, inputs), np.float32), np.zeros(2, np.float32))])
    robot = "p3dx" if path else "omni3"
    agent: Any = Agent(nothing, features, actions, {"robots": [robot], "dt": 0.05}, 0.5, base)
    controller = base.policy(0.5)
    assert agent.knows == controller.knows
    envs = gymnasium.make_vec(env_id, 4, vectorization_mode="vector_entry_point", **kwargs)
    pilots = [Pilot(agent, envs), Pilot(controller, envs)]
    observations, _ = envs.reset(seed=0)
    for pilot in pilots:
        pilot.reset()
    for _ in range(60):
        mine, theirs = (pilot.act(observations) for pilot in pilots)
        np.testing.assert_array_equal(mine, theirs)
        observations, *_ = envs.step(mine)


@given(seed=st.integers(0, 2**32 - 1), reach=st.floats(0.01, 1.0), planar=st.booleans())
def test_what_is_added_stays_within_reach_and_speed(seed: int, reach: float, planar: bool) -> None:
    rng = np.random.default_rng(seed)
    robot = ROBOTS["omni3" if planar else "p3dx"]
    axes = len(robot.twist_axes)
    asked, speeds = rng.uniform(-0.5, 0.5, (50, axes)), rng.uniform(0.1, 0.5, 50)
    actions = rng.uniform(-1.0, 1.0, (50, 2)).astype(np.float32)
    meaning = Actions("planar" if planar else "unicycle", 2.0)
    twists = meaning.added(asked, actions, reach, speeds, rng.uniform(-3.0, 3.0, 50), robot)
    forward = slice(0, 2 if planar else 1)
    ours, theirs = (np.linalg.norm(each[:, forward], axis=1) for each in (twists, asked))
    assert (ours <= np.maximum(speeds, theirs) + 1e-12).all()
    change = np.linalg.norm((twists - asked)[:, forward], axis=1)
    assert (change <= reach * speeds * (math.sqrt(2.0) if planar else 0.5) + 1e-9).all()
    if planar:
        np.testing.assert_array_equal(twists[:, 2], asked[:, 2])
    else:
        np.testing.assert_allclose(twists[:, 1] - asked[:, 1], reach * 2.0 * actions[:, 1], atol=1e-7)


def test_an_omni_robot_sees_and_does_the_same_turned() -> None:
    """In the frame of the goal, turning robot, goal and scan together by whole beams changes nothing but the frame."""
    features, rng, beams = GoalFeatures(num_beams=72), np.random.default_rng(0), 72
    goal, twist = rng.normal(size=(1, 2)), rng.normal(size=(1, 3))
    ranges = rng.uniform(0.3, 5.0, (1, beams))
    for shift in (1, 17, 36, 60):
        angle = shift * 2.0 * math.pi / beams  # the robot turns by this, so that all it sees turns back
        cosine, sine = math.cos(angle), math.sin(angle)
        back = np.array([[cosine, sine], [-sine, cosine]])
        turned_twist = np.column_stack([twist[:, :2] @ back.T, twist[:, 2]])
        seen = []
        for g, t, r in ((goal, twist, ranges), (goal @ back.T, turned_twist, np.roll(ranges, -shift, axis=1))):
            out = np.empty((1, features.width(3)), np.float32)
            observation = goal_reaching.Observation(np.zeros((1, 3)), t, g, np.zeros(1), np.zeros(1), r)
            frame = features.observe(observation, np.ones(1), out)
            velocity = Actions("planar").twists(np.array([[0.3, 0.2]], np.float32), np.ones(1), frame, ROBOTS["omni3"])
            seen.append((out, velocity[:, :2]))
        np.testing.assert_allclose(seen[1][0], seen[0][0], atol=1e-6)
        np.testing.assert_allclose(seen[1][1], seen[0][1] @ back.T, atol=1e-9)


def seeker(
    pose: tuple[float, float, float], goal: tuple[float, float], ranges: NDArray[np.float64] | None = None
) -> goal_reaching.Observation:
    """Returns what one robot observes, in an empty world unless its scan (1, 72) is given."""
    seen = np.full((1, 72), 5.0) if ranges is None else ranges
    return goal_reaching.Observation(
        np.array([pose]), np.zeros((1, 3)), np.array([goal]), np.zeros(1), np.zeros(1), seen
    )


@given(seed=st.integers(0, 2**32 - 1), planar=st.booleans(), reaction=st.floats(0.0, 0.5), braking=st.floats(0.3, 2.0))
def test_no_guarded_twist_is_too_fast_to_stop(seed: int, planar: bool, reaction: float, braking: float) -> None:
    rng = np.random.default_rng(seed)
    features, base = GoalFeatures(braking=braking, reaction=reaction), ACTUATORS["ideal"]
    ranges = rng.uniform(0.2, 2.0, (20, 72))
    twists = rng.uniform(-1.0, 1.0, (20, 3 if planar else 2))
    seen = goal_reaching.Observation(*[np.zeros((20, 1))] * 5, ranges)
    guarded = features.guarded(seen, twists.copy(), 0.6, base)
    angles = np.arange(72) * 2.0 * math.pi / 72 - math.pi
    room = np.maximum(ranges - features.hull_radius - features.gap, 0.0)
    # within the time `reaction` at v and then braking, the way is v reaction + v^2 / (2 braking)
    towards = guarded[:, :1] * np.cos(angles) + (guarded[:, 1:2] * np.sin(angles) if planar else 0.0)
    towards = np.maximum(towards, 0.0)
    assert (towards * reaction + towards**2 / (2.0 * braking) <= room + 1e-9).all()
    np.testing.assert_array_equal(guarded[:, -1], twists[:, -1])
    assert (np.linalg.norm(guarded[:, :-1], axis=1) <= np.linalg.norm(twists[:, :-1], axis=1) + 1e-9).all()


@given(count=st.integers(32, 720), seed=st.integers(0, 2**32 - 1))
def test_a_scan_of_any_number_of_beams_is_read_by_nearness(count: int, seed: int) -> None:
    """Of more beams the least within half a step of the known ones, of fewer the nearest."""
    ranges = np.random.default_rng(seed).uniform(0.3, 5.0, (3, count))
    known = GoalFeatures(num_beams=72).read(ranges)
    away = np.abs((np.arange(count) / count - np.arange(72)[:, None] / 72 + 0.5) % 1.0 - 0.5)  # parts of the circle
    for j in range(72):
        most = max(0.5 / 72, away[j].min()) + 1e-12
        np.testing.assert_array_equal(known[:, j], ranges[:, away[j] <= most].min(axis=1))


@given(
    distance=st.floats(0.02, 0.5), around=st.floats(-3.1, 3.1), turn=st.floats(-3.1, 3.1), planar=st.booleans(),
    tier=st.sampled_from(["ideal", "lagged", "slow"]),
)  # fmt: skip
def test_near_its_goal_a_robot_ends_at_it_and_at_its_heading(
    distance: float, around: float, turn: float, planar: bool, tier: str
) -> None:
    """Exact arcs of a base behind its accelerations and its lag; x, y, heading in the frame of the goal."""
    features, base = GoalFeatures(arrival=0.55), ACTUATORS[tier]
    x, y, heading = -distance * math.cos(around), -distance * math.sin(around), -turn
    asked, moved = np.zeros(3), np.zeros(3)
    most = np.array([base.acceleration, base.acceleration, base.yaw_acceleration]) * 0.05
    for _ in range(400):
        c, s = math.cos(heading), math.sin(heading)
        goal = np.array([[-c * x - s * y, s * x - c * y]])
        error = np.array([math.remainder(-heading, 2.0 * math.pi)])
        seen = goal_reaching.Observation(*[np.zeros((1, 3))] * 2, goal, error, np.zeros(1), np.full((1, 72), 5.0))
        axes = [0, 1, 2] if planar else [0, 2]
        twist = np.zeros(3)
        twist[axes] = features.arrived(seen, np.full((1, len(axes)), 9.0), 0.6, base)[0]
        asked = asked + np.clip(twist - asked, -most, most)
        moved = asked + (moved - asked) * (math.exp(-0.05 / base.lag) if base.lag else 0.0)
        x, y = x + 0.05 * (c * moved[0] - s * moved[1]), y + 0.05 * (s * moved[0] + c * moved[1])
        heading += 0.05 * moved[2]
    assert math.hypot(x, y) < 0.05
    assert abs(math.remainder(heading, 2.0 * math.pi)) < 0.05


def test_far_from_its_goal_or_before_a_waypoint_the_network_drives() -> None:
    features, base, twists = GoalFeatures(arrival=0.2), ACTUATORS["lagged"], np.array([[0.5, 0.2, 0.3]])
    for at, left in (((0.25, 0.0), 0.0), ((0.1, 0.0), 1.0)):
        seen = seeker((0.0, 0.0, 0.0), at)._replace(waypoints_left=np.array([left]))
        np.testing.assert_array_equal(features.arrived(seen, twists.copy(), 0.6, base), twists)


# ---- what is new to an agent

TRAINED_ON = {"actuators": ["lagged"], "disturbances": ["none"], "speeds": [0.4, 0.8], "beams": [72]}


@given(speed=st.floats(0.05, 1.2), a=st.floats(0.05, 0.99), lag=st.floats(0.1, 1.0))
def test_a_slow_base_stops_on_the_way_on_which_the_known_one_does(speed: float, a: float, lag: float) -> None:
    env = gymnasium.make(PATH, actuators="lagged")
    env.reset(seed=0)
    told = env.unwrapped.briefing("sensors")
    slow = dataclasses.replace(told, actuators=Actuators(True, a, 3.0, lag))
    card = {"trained_on": TRAINED_ON}
    v = network_speed(card, slow, speed)
    assert v <= speed
    assert v * lag + v * v / (2.0 * a) == pytest.approx(speed * 0.1 + speed * speed / 2.0)
    assert network_speed(card, told, speed) == speed
    assert network_speed({}, slow, speed) == speed
    assert network_speed({"trained_on": {**TRAINED_ON, "actuators": ["ideal"]}}, slow, speed) == speed
    assert effective_actuators(card, slow) is slow.actuators


@pytest.mark.parametrize(
    "more",
    [
        {"cruises": {"lagged": [[0.4, 0.3]]}},
        {"cruises": {"lagged": [[0.4, 0.3], [0.8, 0.3]]}, "trained_on": TRAINED_ON},
        {"trained_on": {**TRAINED_ON, "speeds": [-1.0]}},
        {"trained_on": {**TRAINED_ON, "actuators": ["quick"]}},
        {"measured": [{"asked_speed": 0.6}]},
    ],
)
def test_a_card_that_says_nothing_sensible_of_its_conditions_is_named(tmp_path: Path, more: dict[str, Any]) -> None:
    folder = make_folder(tmp_path, "goal_reaching", **more)
    with pytest.raises(ValueError, match=rf"{CARD}: {next(iter(more))}"):
        load_agent(folder)


# ---- files


def test_saved_and_loaded_agents_act_alike(tmp_path: Path) -> None:
    agent = load_agent(make_folder(tmp_path / "a"))
    assert isinstance(agent, Agent)
    assert agent.knows == "sensors"
    assert agent.speed == 0.6
    assert load_agent(tmp_path / "a", speed=0.3).speed == 0.3
    assert sorted(each.name for each in (tmp_path / "a").iterdir()) == [CARD, WEIGHTS]


def test_a_missing_damaged_or_foreign_file_is_named(tmp_path: Path) -> None:
    whole = make_folder(tmp_path / "whole")

    def broken(name: str, change: Any) -> Path:
        folder = tmp_path / name
        shutil.copytree(whole, folder)
        change(folder)
        return folder

    def edit(**changes: Any) -> Any:
        def change(folder: Path) -> None:
            card = json.loads((folder / CARD).read_text())
            (folder / CARD).write_text(json.dumps(signed(card | changes)))

        return change

    def changed(**values: Any) -> Any:
        return json.loads((whole / CARD).read_text())["features"] | values

    def spoil(folder: Path) -> None:
        content = bytearray((folder / WEIGHTS).read_bytes())
        content[-5] ^= 1
        (folder / WEIGHTS).write_bytes(bytes(content))

    cases = {
        "no_card": (lambda f: (f / CARD).unlink(), CARD),
        "no_weights": (lambda f: (f / WEIGHTS).unlink(), WEIGHTS),
        "cut": (lambda f: (f / WEIGHTS).write_bytes((f / WEIGHTS).read_bytes()[:-100]), "damaged"),
        "flipped": (spoil, "SHA-256"),
        "no_json": (lambda f: (f / CARD).write_text("{"), "no JSON"),
        "nested": (lambda f: (f / CARD).write_text("[" * 10**6), "nested too deeply"),
        "vast": (lambda f: os.truncate(f / CARD, 2**36), "at most"),
        "format": (lambda f: (f / CARD).write_text('{"format": 99}'), "format 99"),
        "features": (edit(features={"size": 3}), "features"),
        "frames": (edit(features=changed(frames=0)), "frames"),
        "speed": (edit(speed=math.nan), "speed"),
    }
    for name, (change, said) in cases.items():
        folder = broken(name, change)
        with pytest.raises(ValueError, match=said) as caught:
            load_agent(folder)
        assert str(folder) in str(caught.value)


@pytest.mark.parametrize(
    ("env_id", "kwargs", "said"),
    [
        (DIFF, {"num_beams": 72}, "omni3, not p3dx"),
        (OMNI, {"num_beams": 31}, "at least 32, over the full circle"),
        (OMNI, {"num_beams": 72, "field_of_view": 3.0}, "full circle"),
    ],
)
def test_an_agent_refuses_what_it_was_not_trained_for(
    tmp_path: Path, env_id: str, kwargs: dict[str, Any], said: str
) -> None:
    agent = load_agent(make_folder(tmp_path, "goal_reaching"))
    env = gymnasium.make(env_id, **kwargs)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=said):
        Pilot(agent, env).reset()


def test_an_agent_refuses_another_task(tmp_path: Path) -> None:
    agent = load_agent(make_folder(tmp_path))
    with pytest.raises(TypeError, match="Agent reads"):
        Pilot(agent, gymnasium.make(OMNI))


def test_a_bad_speed_is_refused(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    for speed in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="speed"):
            load_agent(folder, speed=speed)


def test_inference_imports_neither_torch_nor_stable_baselines(tmp_path: Path) -> None:
    import subprocess
    import sys

    make_folder(tmp_path / "a")
    code = (
        "import sys; from wayfield.policies.learned.agent import load_agent; load_agent(sys.argv[1]); "
        "print([m for m in ('torch', 'stable_baselines3') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "a")], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("task", "lacks"), [("path_following", ["limits"]), ("goal_reaching", ["limits", "arrival", "moving"])]
)
def test_agents_of_earlier_formats_are_still_read(tmp_path: Path, task: str, lacks: list[str]) -> None:
    folder = make_folder(tmp_path / "a", task)
    card = json.loads((folder / CARD).read_text())
    now = load_agent(folder)
    for name in lacks:
        del card["features"][name]
    del card["actions"]["reverse"]
    for number in (1, 2, 3):
        old = {**signed(card), "format": number}
        del old["digest"]
        if number > 1:
            old["digest"] = digest(old)
        (folder / CARD).write_text(json.dumps(old))
        assert load_agent(folder).card["format"] == number
        assert load_agent(folder).features == now.features


def test_weights_that_are_not_finite_are_not_saved_over_good_ones(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "a")
    card = json.loads((folder / CARD).read_text())
    before = load_agent(folder).network.numbers
    for bad in (math.nan, math.inf, -math.inf):
        layers = layers_of([int(load_agent(folder).network.sizes[0]), 16, 8, 2])
        layers[1][0][3, 2] = bad
        with pytest.raises(ValueError, match=r"layer_1\.weight has numbers that are not finite"):
            save_agent(folder, layers, card | {"sha256": weights_digest(layers)})
    np.testing.assert_array_equal(load_agent(folder).network.numbers, before)


def test_agents_that_ship_have_weights_of_eight_bits() -> None:
    for folder in sorted((Path(perception.__file__).parents[1] / "agents").glob("*/seed_*")):
        assert not (load_agent(folder).network.numbers.view(np.uint32) & 0xFFFF).any(), folder


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are cut off at a chosen moment by fork")
@pytest.mark.parametrize(
    "first", [pytest.param(True, marks=pytest.mark.slow), False], ids=["no agent before", "an agent before"]
)
def test_a_save_that_is_killed_at_any_moment_leaves_the_old_agent_or_the_new(tmp_path: Path, first: bool) -> None:
    made = [make_folder(tmp_path / name, speed=speed) for name, speed in (("a", 0.5), ("b", 0.7), ("c", 0.9))]
    inputs = int(load_agent(made[0]).network.sizes[0])

    def save(k: int, folder: Path) -> None:
        layers = layers_of([inputs, 16, 8, 2], seed=k)
        card = json.loads((made[k] / CARD).read_text())
        save_agent(folder, layers, card | {"sha256": weights_digest(layers)})

    def check(folder: Path, allowed: tuple[int, ...]) -> int:
        agent = load_agent(folder)
        k = [0.5, 0.7, 0.9].index(agent.speed)
        assert k in allowed
        np.testing.assert_array_equal(agent.network.numbers, Network.of(layers_of([inputs, 16, 8, 2], seed=k)).numbers)
        return k

    tmp_path.chmod(0o755)
    moments, found = 0, set()
    for count in itertools.count():
        folder = tmp_path / f"best_{count}"
        if not first:
            save(0, folder)
        killed = killed_at(count, lambda folder=folder: save(1, folder))  # type: ignore[misc]
        if folder.exists() or not first:
            found.add(check(folder, (0, 1)))
        # what comes after is cut off too, its weights beside the card of those before, and then left to end
        if killed_at(3, lambda folder=folder: save(2, folder)) and (folder.exists() or not first):  # type: ignore[misc]
            check(folder, (0, 1))
        save(2, folder)
        assert check(folder, (2,)) == 2
        assert folder.stat().st_mode & 0o777 == 0o755  # who may read what lies around it may read the agent
        assert sorted(each.name for each in folder.iterdir() if not each.name.startswith(".")) == [CARD, WEIGHTS]
        if not killed:
            break
        moments += 1
    assert moments > 5
    assert found == ({1} if first else {0, 1})
