"""The agents that ship: each loads, drives the robot that its card names, and is refused elsewhere."""

import math
import re
import shutil
from importlib import resources
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner

import wayfield  # noqa: F401  registers the ids
from wayfield import policies
from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.contests import CONTESTS, Course, Entrants
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.episodes.rollout import roll_out
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.results import read_rows
from wayfield.envs.scenarios import GoalScenario
from wayfield.envs.scenarios.docking_families import DockingScenario
from wayfield.policies.learned.agent import load_agent, read_card
from wayfield.policies.learned.conditions import held_pace
from wayfield.policies.pilot import Pilot
from wayfield.policies.trained.ppo import shipped
from wayfield.policies.training.measured import conditions
from wayfield.policies.training.presets import PRESETS
from wayfield.policies.training.run import trained_on
from wayfield.policies.training.validation import validate

PATH_ID, DIFF_GOAL_ID = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveGoalObstacles-v0"
DOCK_ID, OMNI_DOCK_ID = "wayfield/DiffDriveDocking-v0", "wayfield/OmniDocking-v0"
KINDS = (
    ("path_following", "p3dx"),
    *(("goal_reaching", robot) for robot in ("p3dx", "omni3", "omni4")),
    *(("docking", robot) for robot in ("p3dx", "omni3", "omni4")),
    *(("trajectory_tracking", robot) for robot in ("p3dx", "omni3")),
)
FEWER = {
    **{("docking", robot): 5 for robot in ("p3dx", "omni3", "omni4")},
    ("trajectory_tracking", "omni3"): 5,
}  # where ten would be too much to install
AGENTS = [(*kind, seed, folder) for kind in KINDS for seed, folder in shipped(*kind).items()]


def test_seeds_of_each_kind_ship_and_are_small() -> None:
    """Those of the first seeds, from 0 on: none between is left out."""
    for kind in KINDS:
        assert list(shipped(*kind)) == list(range(FEWER.get(kind, 10))), kind
        for folder in shipped(*kind).values():  # what its preset teaches with today, whatever was tuned since
            card = read_card(folder / "card.json")
            training, base = card["training"], card.get("base") or {}
            assert PRESETS[training["preset"]].prior.controller == training.get("taught_by", base.get("controller"))
            assert PRESETS[training["preset"]].gains == training.get("taught_with", base.get("gains"))
    home = Path(str(resources.files("wayfield.policies"))) / "agents"
    assert sum(file.stat().st_size for file in home.rglob("*") if file.is_file()) < 20_500_000


@pytest.mark.parametrize(("task", "robot", "seed", "folder"), AGENTS)
def test_each_loads_and_its_card_says_how_it_was_made(task: str, robot: str, seed: int, folder: Path) -> None:
    agent = load_agent(folder)
    assert agent.card["task"] == task
    assert agent.card["robots"] == [robot]
    assert agent.card["training"]["seed"] == seed
    assert agent.card["training"]["frames"] <= agent.card["training"]["steps"] * 1.02
    assert re.match(r"(python )?(train\.py|wayfield train) ", agent.card["training"]["command"])
    assert agent.num_parameters == agent.card["network"]["parameters"]
    # by a preset that trains the same today: who trains anew gets what ships
    card, preset = agent.card, PRESETS[agent.card["training"]["preset"]]
    assert (agent.features, agent.actions, agent.base) == (preset.features, preset.actions, preset.base)
    assert (agent.speed, agent.network.activation) == (preset.worlds.speed, preset.learning.activation)
    assert tuple(card["network"]["hidden"]) == preset.learning.hidden
    assert card["training"]["steps"] == preset.learning.steps
    assert not card["training"]["settings"]
    assert card["trained_on"] == trained_on(preset)
    assert (card["task"], card["env_id"] in preset.worlds.env_ids) == (preset.worlds.task, True)
    assert card["env_kwargs"] == {**preset.worlds.validation} | (
        {} if preset.worlds.robot is None else {"robot": preset.worlds.robot}
    )
    # and it was measured wherever an agent of its task is today
    assert [(each["asked_speed"], each["env_kwargs"]) for each in card["measured"]] == conditions(agent)


def test_agents_follow_paths_at_the_speed_they_are_asked_for() -> None:
    env: Any = gymnasium.make_vec(PATH_ID, 10, scenario="circles/validation", actuators="lagged")
    paces = []
    for speed in (0.4, 0.8):
        seen, _ = env.reset(seed=0, options={"scenario": list(range(10))})
        pilot = Pilot(policies.make("ppo", seed=0, speed=speed), env)
        pilot.reset()
        far = np.zeros(10)
        for k in range(200):
            seen, _, terminated, truncated, info = env.step(pilot.act(seen))
            assert not (terminated | truncated)[info["cross_track_error"] > 0.2].any()
            if k == 199:
                far = np.abs(info["cross_track_error"])
        assert np.median(far) < 0.03
        paces.append(float(info["arc_length"].mean()) / 10.0)
    # the first seconds go to the start beside the path, and on an even curve what they cost in the mean is made good
    assert 0.3 < paces[0] < 0.44
    assert 0.6 < paces[1] < 0.9


def test_a_validation_of_every_third_scenario_is_that_of_those() -> None:
    case = Case(
        "", "", PATH_ID, "splines/validation", "pure_pursuit", max_episode_steps=40, every_scenario=True
    )  # fmt: skip
    conditions = {"scenario": case.scenario, "actuators": "lagged"}
    found = validate(policies.make("pure_pursuit"), PATH_ID, conditions, 40, seed=5, every=3)
    driven = roll_out(case, actuators="lagged", seed=5, episodes=4, members=(0, 3, 6, 9))
    assert found.speed == pytest.approx(np.mean([measure(each)["mean_speed"] for each in driven]))


@pytest.mark.parametrize(("tier", "speed"), [("lagged", 0.6), ("ideal", 0.6), ("lagged", 0.3)])
def test_path_followers_that_make_nothing_up_hold_the_speed_in_the_mean_of_all_paths(tier: str, speed: float) -> None:
    """Within the 3 % by which the tables call a row paced, on paths that were not looked at to find what to tell."""
    found = validate(
        policies.make("ppo", seed=2, speed=speed, pace_time=0.0),
        PATH_ID,
        {"scenario": "all/validation", "actuators": tier},
        4000,
        every=4,
    )
    assert found.success == 1.0
    assert found.speed == pytest.approx(speed, rel=0.03)


@pytest.mark.parametrize(
    ("family", "tier", "speed"),
    [("circuits", "lagged", 0.6), ("circuits", "slow", 0.4), ("splines", "ideal", 0.6), ("circles", "lagged", 0.3)],
)
def test_path_followers_hold_the_speed_that_they_are_asked_for_on_the_path_at_hand(
    family: str, tier: str, speed: float
) -> None:
    where = {"scenario": f"{family}/validation", "actuators": tier}
    folder = shipped("path_following", "p3dx")[1]
    for policy in (policies.make("ppo", seed=1, speed=speed), load_agent(folder, speed=speed)):
        found = validate(policy, PATH_ID, where, 2400, every=3)
        assert found.success == 1.0
        assert found.speed == pytest.approx(speed, rel=0.03)


@pytest.mark.parametrize("slower", [0.0, 0.15, 0.3])
def test_the_way_that_is_late_brings_the_mean_to_the_asked_speed(slower: float) -> None:
    asked, dt, v, way = 0.6, 0.05, 0.0, 0.0
    paced = np.array([[-dt * asked, 0.0]])
    for _ in range(2400):
        told = asked + held_pace(asked, paced, np.array([[v, 0.0]]), dt)[0] / 4.0
        new = v + min(max((1.0 - slower) * told - v, -dt), dt)
        way += 0.5 * dt * (v + new)
        v = new
    assert way / (2400 * dt) == pytest.approx(asked, rel=0.02)


@pytest.mark.parametrize(
    ("env_id", "tier", "beams"),
    [(DOCK_ID, "ideal", 32), (DOCK_ID, "slow", 72), (OMNI_DOCK_ID, "ideal", 32)],
)
def test_agents_dock_where_a_user_meets_them_first(env_id: str, tier: str, beams: int) -> None:
    """By the defaults of `make` and on the other bases they come to rest, and seldom touch."""
    env: Any = gymnasium.make_vec(env_id, 40, scenario="all/validation", actuators=tier, num_beams=beams)
    seen, _ = env.reset(seed=0, options={"scenario": list(range(40))})
    pilot = Pilot(policies.make("ppo", seed=0), env)
    pilot.reset()
    alive, won, hit = np.ones(40, bool), np.zeros(40, bool), np.zeros(40, bool)
    for _ in range(600):
        seen, _, terminated, truncated, info = env.step(pilot.act(seen))
        won |= alive & info["success"]
        hit |= alive & info["collision"]
        alive &= ~(terminated | truncated)
    assert won.mean() > 0.7
    assert hit.mean() < 0.2


@pytest.mark.parametrize(("robot", "tolerance"), [("p3dx", 0.05), ("p3dx", 0.01), ("omni4", 0.05)])
def test_agents_dock_from_beside_the_pose_as_near_as_it_asks(robot: str, tolerance: float) -> None:
    """Where a network stands, a law docks: from all sides of a pose, that it is parallel to in every second case."""
    rng = np.random.default_rng(4)
    docks = []
    for k in range(40):
        away, around = rng.uniform(0.1, 1.5), rng.uniform(-math.pi, math.pi)
        turn = rng.uniform(-math.pi, math.pi) if k % 2 else 0.0
        start = away * math.cos(around), away * math.sin(around), turn
        docks.append(DockingScenario(f"beside_{k}", (0.0, 0.0, 0.0), start, position_tolerance=tolerance))
    where = {"scenario": docks, "actuators": "lagged", "num_beams": 72, "max_range": 5.0, "robot": robot}
    found = validate(policies.make("ppo", seed=0), DOCK_ID if robot == "p3dx" else OMNI_DOCK_ID, where, 1200)
    assert found.success >= 0.95
    assert found.collision == 0.0


@pytest.mark.parametrize(("robot", "seed"), [("p3dx", 0), ("omni4", 1)])
def test_agents_dock_beyond_what_moves(robot: str, seed: int) -> None:
    where = {"scenario": "moving/test", "actuators": "lagged", "num_beams": 72, "max_range": 5.0, "robot": robot}
    found = validate(policies.make("ppo", seed=seed), DOCK_ID if robot == "p3dx" else OMNI_DOCK_ID, where, 1200)
    assert found.success >= 0.85


@pytest.mark.parametrize("name", ["ppo", "hybrid"])
def test_agents_come_as_near_to_a_goal_as_it_asks(name: str) -> None:
    goals = [
        GoalScenario(f"near_{k}", (1.5 * math.cos(k), 1.5 * math.sin(k), 2.0 * k % 3.0), position_tolerance=tolerance)
        for k, tolerance in enumerate((0.01, 0.006, 0.1, 0.01))
    ]
    where = {"scenario": goals, "actuators": "lagged", "num_beams": 72, "max_range": 5.0}
    assert validate(policies.make(name), DIFF_GOAL_ID, where, 1200).success == 1.0


def test_other_seeds_robots_and_scans_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="no agent of seed 99 ships for path_following with p3dx; there are seeds"):
        _start(PATH_ID, "ppo", seed=99)
    with pytest.raises(ValueError, match="over the full circle"):
        _start(DIFF_GOAL_ID, "ppo", {"field_of_view": 3.0})
    for gains, said in (({"seed": -1}, "seed"), ({"seed": 0.5}, "seed"), ({"speed": -0.1}, "speed")):
        with pytest.raises(ValueError, match=said):
            policies.make("ppo", **gains)


def _start(env_id: str, name: str, kwargs: dict[str, Any] | None = None, **gains: Any) -> None:
    env = gymnasium.make(env_id, **kwargs or {})
    env.reset(seed=0)
    Pilot(policies.make(name, **gains), env).reset()


def test_a_contest_holds_a_case_for_each_seed() -> None:
    contest = CONTESTS["path-following"]
    for gains_names in (("default",), ("tuned",), ("best",), ("default", "tuned")):
        cases = list(contest.cases("p3dx", Course("circles", "test"), Entrants(("ppo",), gains_names)))
        assert [case.gains["seed"] for case in cases] == list(shipped("path_following", "p3dx"))
        assert {case.gains_name for case in cases} == {"trained"}


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """Returns a folder as train.py leaves it, with the agents of two seeds."""
    for seed in (1, 4):
        shutil.copytree(shipped("path_following", "p3dx")[seed], tmp_path / "mine" / f"seed_{seed}" / "best")
    (tmp_path / "mine" / "seed_7").mkdir()  # has no agent yet
    return tmp_path / "mine"


def test_agents_of_your_own_drive_as_those_that_ship(home: Path) -> None:
    env: Any = gymnasium.make(PATH_ID, scenario="s_curve", actuators="lagged")
    seen, _ = env.reset(seed=0)
    acts = []
    for gains in ({}, {"home": str(home)}):
        pilot = Pilot(policies.make("ppo", seed=4, **gains), env)
        pilot.reset()
        acts.append(pilot.act(seen))
    np.testing.assert_array_equal(*acts)
    with pytest.raises(ValueError, match=r"no agent of seed 0 is in .*mine; there are seeds 1, 4"):
        _start(PATH_ID, "ppo", home=str(home))
    with pytest.raises(ValueError, match="agents for path_following, not for goal_reaching"):
        _start(DIFF_GOAL_ID, "ppo", seed=1, home=str(home))
    with pytest.raises(ValueError, match="home must be"):
        policies.make("ppo", home=3)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_agents_of_your_own_take_part_in_a_contest_under_the_name_of_their_folder(home: Path) -> None:
    out = home.parent / "out"
    small = ("--families", "circles", "--episodes", "2", "--workers", "1", "--policies", "pure_pursuit")
    run = CliRunner().invoke(
        main, ["--suite", "path-following", *small, "--gains", "default", "--agents", str(home), "--out", str(out)]
    )
    assert run.exit_code == 0, run.output
    rows = [row for row in read_rows(out) if row["split"] == "test"]
    assert {(row["policy"], row["gains_name"]) for row in rows} == {("pure_pursuit", "default"), ("ppo", "mine")}
    assert len(rows) == 2 + 2 * 2
    table = (out / "path_following_p3dx.csv").read_text()
    assert "ppo,mine," in table
    assert f"--agents {home}" in (out / "table.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--suite", "path-following", "--agents", "nowhere"), "'nowhere' holds no trained agents"),
        (("--suite", "goal-obstacles", "--agents", "mine"), "holds no agents for suite 'goal-obstacles'"),
        (("--suite", "path-following", "--agents", "mine", "--agents", "mine"), "must differ"),
        (("--suite", "documents", "--agents", "mine"), "--agents belongs to the contests"),
    ],
)
def test_folders_without_fitting_agents_are_refused_in_one_line(
    arguments: tuple[str, ...], said: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(home.parent)
    run = CliRunner().invoke(main, [*arguments, "--out", "out"])
    assert run.exit_code in (1, 2)
    assert said in run.stderr
    assert run.stderr.count("\n") == 1
    assert not Path("out").exists()


@pytest.mark.parametrize(("task", "robot"), KINDS)
def test_the_onnx_graph_agrees_with_the_network(task: str, robot: str, tmp_path: Path) -> None:
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    from wayfield.policies.learned.onnx import export_onnx

    agent = load_agent(shipped(task, robot)[0])
    export_onnx(agent, tmp_path / "agent.onnx")
    session = runtime.InferenceSession(tmp_path / "agent.onnx", providers=["CPUExecutionProvider"])
    inputs = np.random.default_rng(0).normal(size=(200, int(agent.network.sizes[0]))).astype(np.float32)
    (actions,) = session.run(["action"], {"features": inputs})
    assert np.abs(actions - np.clip(agent.network(inputs), -1.0, 1.0)).max() < 1e-5
    assert [file.name for file in tmp_path.iterdir()] == ["agent.onnx"]


def onnx(*arguments: object) -> Any:
    pytest.importorskip("onnx")
    from wayfield.policies.learned.onnx import main as export

    return CliRunner().invoke(export, [str(each) for each in arguments])


def test_the_onnx_command_writes_once_and_asks_for_force_to_overwrite(tmp_path: Path) -> None:
    agent, file = shipped(*KINDS[0])[0], tmp_path / "agent.onnx"
    assert onnx(agent, file).exit_code == 0
    graph = file.read_bytes()
    file.write_bytes(b"a diary")
    run = onnx(agent, file)
    assert (run.exit_code, run.stderr.count("\n")) == (2, 1)
    assert "--force" in run.stderr
    assert file.read_bytes() == b"a diary"
    assert onnx(agent, file, "--force").exit_code == 0
    assert file.read_bytes() == graph


def test_the_onnx_command_helps_and_refuses_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    agent = shipped(*KINDS[0])[0]
    for asked in (("--help",), ("-h",), (agent, "-h")):
        run = onnx(*asked)
        assert run.exit_code == 0
        assert "FOLDER" in run.output
    for wrong, said in (
        ((), "FOLDER"),
        ((agent,), "FILE"),
        ((agent, "-x"), "-x"),
        (("nowhere", "a.onnx"), "card.json cannot be read"),
        ((agent, "nowhere/a.onnx"), "no folder"),
        ((agent, tmp_path), "directory"),
    ):
        run = onnx(*wrong)
        assert run.exit_code == 2, wrong
        assert said in run.stderr
        assert run.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
