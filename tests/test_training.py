"""Training: the vector environment adapter, presets, runs that stop and go on, and what is refused."""

# ruff: noqa: E402  what is optional is asked for before it is imported

import dataclasses
import errno
import os
import signal
import threading
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")

from stable_baselines3.common.vec_env import DummyVecEnv
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from wayfield.envs.scenarios import GOAL_SCENARIOS
from wayfield.policies.agent import Agent, Network, load_agent
from wayfield.policies.features import Actions, GoalFeatures
from wayfield.policies.policy import Pilot
from wayfield.policies.training import checkpoints
from wayfield.policies.training.command import main
from wayfield.policies.training.curves import read_curve
from wayfield.policies.training.learner import Learner, policy_layers
from wayfield.policies.training.presets import PRESETS, Preset, overridden, preset_for
from wayfield.policies.training.run import Job, Report, _Run, train
from wayfield.policies.training.shaping import GoalReward
from wayfield.policies.training.ways import left_from, way_field
from wayfield.policies.training.worlds import Worlds

PATH, OMNI = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"

PLAIN, RESIDUAL = "path_following_plain", "path_following_residual"

# a run of seconds: few robots, few paths
SMALL = dataclasses.replace(
    PRESETS[PLAIN],
    paces=(0.6,),
    worlds=((0.5, {"scenario": "s_curve"}), (0.5, {"scenario": "circle", "noise": 1.0})),
    validation={"scenario": "s_curve", "actuators": "lagged"},
    num_envs=16,
    horizon=8,
    batch_size=64,
    epochs=1,
    hidden=(8,),
    steps=16 * 8 * 6,
    validations=3,
    clock=15,
)


def job(folder: Path, preset: Any = SMALL, **changes: Any) -> Job:
    return dataclasses.replace(Job(PATH, preset, (), 0, folder), **changes)


def quiet(report: Report) -> None:
    """Looks away."""


@pytest.mark.parametrize(
    ("env_id", "kwargs"),
    [
        (PATH, {"scenario": "circle", "noise": 1.0, "actuators": "lagged"}),
        (OMNI, {"scenario": "discs", "num_beams": 8, "robot": "omni4"}),
    ],
)
def test_worlds_are_dummy_vec_envs_of_the_same_environments(env_id: str, kwargs: dict[str, Any]) -> None:
    clock, count = 60, 6
    worlds = Worlds(env_id, [(2, {**kwargs, "max_episode_steps": clock}), (4, {**kwargs, "max_episode_steps": clock})])
    dummy = DummyVecEnv([lambda: gymnasium.make(env_id, max_episode_steps=clock, **kwargs)] * count)
    for env in (worlds, dummy):
        env.seed(5)
    np.testing.assert_array_equal(worlds.reset(), dummy.reset())
    rng, late, done = np.random.default_rng(0), 0, 0
    space = worlds.action_space
    for step in range(150):
        # the first robot drives straight out of bounds or into something, the others at random
        actions = rng.uniform(0.3 * space.low, 0.3 * space.high, (count, *space.shape)).astype(np.float32)
        actions[0] = 0.0
        actions[0, 0] = space.high[0]
        ours, theirs = worlds.step(actions), dummy.step(actions)
        for mine, other in zip(ours[:3], theirs[:3], strict=True):
            np.testing.assert_array_equal(mine, np.asarray(other, mine.dtype), err_msg=f"step {step}")
        for i in np.flatnonzero(ours[2]):
            np.testing.assert_array_equal(ours[3][i]["terminal_observation"], theirs[3][i]["terminal_observation"])
            assert ours[3][i]["TimeLimit.truncated"] == theirs[3][i]["TimeLimit.truncated"]
            late += ours[3][i]["TimeLimit.truncated"]
            done += 1
    assert late >= 8
    assert done > late


def weights(folder: Path) -> list[Any]:
    state = checkpoints.read_state(folder)
    assert state is not None
    return [array for name, array in sorted(state[0].items())]


def curve_but_for_seconds(folder: Path) -> list[list[str]]:
    rows = [line.split(",") for line in (folder / checkpoints.CURVE).read_text().splitlines()]
    column = rows[0].index("seconds")
    return [row[:column] + row[column + 1 :] for row in rows]


class Killed(Exception):
    """Stands for a power cut."""


TAUGHT = dataclasses.replace(SMALL, controller="lqr", lessons=16 * 8 * 2, steps=16 * 8 * 8, paces=(0.4, 0.6))
ADDING = dataclasses.replace(SMALL, controller="lqr", reach=0.2, paces=(0.4, 0.6))


# all that a robot can remember: crumbs, trails, frames, and what its controller does
SEEKING = dataclasses.replace(
    SMALL,
    task="goal_reaching",
    worlds=((1.0, {"scenario": "discs", "num_beams": 24, "max_range": 5.0, "robot": "omni3"}),),
    validation={"scenario": "discs", "num_beams": 24, "max_range": 5.0},
    features=GoalFeatures(num_beams=24, pool=4, crumbs=4, crumb_gap=0.05, frames=2, stride=2),
    actions=Actions("planar"),
    reward=GoalReward(),
    robot="omni3",
    shortest_ways=True,
    controller="vfh_plus",
    reach=0.3,
    paces=(0.4, 0.6),
)


@pytest.mark.parametrize(
    ("env_id", "preset"),
    [(PATH, SMALL), (PATH, TAUGHT), (PATH, ADDING), (OMNI, SEEKING)],
    ids=["plain", "taught", "adding", "seeking"],
)
def test_a_run_that_was_killed_goes_on_as_if_it_had_not_been(tmp_path: Path, env_id: str, preset: Preset) -> None:
    train(job(tmp_path / "whole", preset, env_id=env_id), quiet)
    for name, last in (("early", 1), ("between", 3), ("late", 5)):
        folder = tmp_path / name
        count = 0

        def cut(report: Report, last: int = last) -> None:
            nonlocal count
            count += 1
            if count == last:
                raise Killed

        with pytest.raises(Killed):
            train(job(folder, preset, env_id=env_id), cut)
        train(job(folder, preset, env_id=env_id, resume=True), quiet)
        for mine, other in zip(weights(folder), weights(tmp_path / "whole"), strict=True):
            np.testing.assert_array_equal(mine, other)
        assert curve_but_for_seconds(folder) == curve_but_for_seconds(tmp_path / "whole")


def test_learning_and_driving_command_the_same_twists() -> None:
    """What a network adds to a controller means the same to the learner's worlds as to the agent that ships."""
    learner = Learner(dataclasses.replace(SEEKING, paces=(0.5,)), OMNI, 3)
    env = learner.env
    network = Network.of(learner.layers())
    card = {"robots": ["omni3"], "dt": 0.05}
    agent: Any = Agent(network, SEEKING.features, SEEKING.actions, card, 0.5, SEEKING.base)
    inputs = env.reset()
    (part,) = env.worlds.parts
    pilot = Pilot(agent, part)
    pilot.reset()
    asked: list[Any] = []
    step = part.step
    part.step = lambda actions: (asked.append(actions), step(actions))[1]  # type: ignore[method-assign]
    for _ in range(10):  # no episode ends
        theirs = pilot.act(env.observations)
        inputs, _, ended, _ = env.step(network(inputs))
        assert not ended.any()
        np.testing.assert_array_equal(asked[-1], theirs)


def test_lessons_bring_a_network_to_drive_like_its_teacher() -> None:
    preset = dataclasses.replace(
        SMALL, worlds=((1.0, {"scenario": "circle"}),), num_envs=64, clock=200, controller="lqr", lessons=64 * 8 * 60,
        steps=10**6,
    )  # fmt: skip
    apart = []
    for taught in (False, True):
        learner = Learner(preset, PATH, 0)
        seen = list(learner.teach()) if taught else []
        inputs = learner.env.reset()
        pilots = learner.env.make_pilots(preset.controller_at)
        network = Network.of(learner.layers())
        differences = []
        for _ in range(100):
            wanted = learner.env.actions_of(learner.env.ask(pilots))
            differences.append(np.abs(np.clip(network(inputs), -1.0, 1.0) - wanted).mean())
            inputs, _, ended, _ = learner.env.step(wanted)
            learner.env.tell(pilots, ended)
        apart.append(np.mean(differences))
    assert apart[1] < 0.4 * apart[0]
    assert seen == sorted(seen)
    assert preset.lessons <= seen[-1] == learner.frames < 1.1 * preset.lessons


def test_ctrl_c_saves_and_the_run_goes_on_from_there(tmp_path: Path) -> None:
    train(job(tmp_path / "whole"), quiet)
    folder = tmp_path / "run"

    def press(report: Report) -> None:
        if report.frames == 16 * 8 * 3:
            signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    stopped = train(job(folder), press)
    assert signal.getsignal(signal.SIGINT) is before
    assert not stopped.done
    assert stopped.frames == 16 * 8 * 3
    assert train(job(folder, resume=True), quiet).done
    for mine, other in zip(weights(folder), weights(tmp_path / "whole"), strict=True):
        np.testing.assert_array_equal(mine, other)


def test_seeds_run_side_by_side_and_leave_curves_logs_and_agents(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    small = ("num_envs=64", "horizon=8", "batch_size=64", "epochs=1", "hidden=8", "validations=1")
    settings = [word for each in small for word in ("--set", each)]
    with pytest.raises(SystemExit) as caught:
        main([PATH, "--preset", PLAIN, "--steps", "1024", "--seeds", "2", "--seed", "3", "--out", str(out), *settings])
    assert caught.value.code == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in told] == ["seed 3", "seed 4"]
    assert all(part in told[0] for part in ("done", "frames/s", "environment", "update", "last validation"))
    digests = set()
    for seed in (3, 4):
        folder = out / f"seed_{seed}"
        curve = read_curve(folder)
        assert curve["frames"] == [1024.0]
        digests.add(load_agent(folder / checkpoints.BEST).card["sha256"])
        events = EventAccumulator(str(folder / "tensorboard"))
        events.Reload()
        for name in ("success", "error", "return"):
            (event,) = events.Scalars(f"wayfield/{name}")
            assert event.step == 1024
            assert event.value == pytest.approx(curve[name][0], rel=1e-6)
    assert len(digests) == 2
    assert (out / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_a_full_disk_leaves_the_last_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "run"
    train(job(folder), quiet)
    before = (folder / checkpoints.LAST).read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        checkpoints.write_state(folder, {"a": np.zeros(3)}, {})
    assert (folder / checkpoints.LAST).read_bytes() == before
    assert not list(folder.glob("*.part"))


def test_the_agent_drives_as_the_network_that_was_trained(tmp_path: Path) -> None:
    run = _Run(job(tmp_path / "run"))
    run.go(quiet, threading.Event())
    agent = load_agent(tmp_path / "run" / "best")
    np.testing.assert_array_equal(agent.network.numbers, Network.of(run.best).numbers)
    inputs = np.random.default_rng(0).normal(size=(100, agent.network.sizes[0])).astype(np.float32)
    network = Network.of(policy_layers(run.learner.ppo.policy))
    with torch.no_grad():
        mean = run.learner.ppo.policy.get_distribution(torch.from_numpy(inputs)).mode().numpy()
    assert np.abs(network(inputs) - mean).max() < 1e-5
    assert agent.card["training"]["frames"] > 0


def test_the_way_left_is_the_distance_where_nothing_stands_and_longer_behind_a_wall() -> None:
    open_field = GOAL_SCENARIOS["open_field"](0.3)[0]
    ways, low = way_field(open_field, 0.3)
    shape = np.array([[0, *ways.shape]])

    def left(x: float, y: float) -> float:
        out = np.empty(1)
        left_from(ways.ravel(), shape, low[None], np.zeros(1, np.int64), np.array([x]), np.array([y]), out)
        return float(out[0])

    goal = np.array(open_field.goal[:2])
    start = np.array(open_field.start[:2])
    for share in (0.0, 0.3, 0.7):
        at = start + share * (goal - start)
        assert left(*at) == pytest.approx(np.hypot(*(goal - at)), rel=0.05, abs=0.1)
    held = GOAL_SCENARIOS["held_by_wall"](0.3)[0]
    ways, low = way_field(held, 0.3)
    column, row = np.rint((np.array(held.start[:2]) - low) / 0.1).astype(int)
    # around the end of a wall of 3 m halfway, 0.3 m off it: two legs of at least hypot(1.5, 1.8) m
    assert 2.0 * np.hypot(1.5, 1.8) < ways[row, column] < 2.0 * np.hypot(1.5, 1.8) + 1.5


# ---- what is refused


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["wayfield/Nowhere-v0"], "has no preset"),
        ([PATH, "--preset", "path_folowing"], "Did you mean 'path_following'"),
        ([PATH, "--preset", "omni3_goal"], "is for wayfield/OmniGoalObstacles-v0"),
        ([PATH, "--set", "learning_rat=1"], "Did you mean 'learning_rate'"),
        ([PATH, "--set", "reward.eror_cost=1"], "Did you mean 'error_cost'"),
        ([PATH, "--set", "reward=1"], "has parts"),
        ([PATH, "--set", "epochs=many"], "whole number"),
        ([PATH, "--set", "learning_rate=nan"], "finite"),
        ([PATH, "--set", "learning_rate"], "key=value"),
        ([PATH, "--steps", "0"], "steps is 0"),
        ([PATH, "--preset", PLAIN, "--set", "controller=lqr"], "either teaches"),
        ([PATH, "--preset", PLAIN, "--set", "reach=0.2"], "either teaches"),
        ([PATH, "--set", "batch_size=1"], "batch_size must be at least 2"),
        ([PATH, "--set", "patience=-3"], "patience must be at least 0"),
        ([PATH, "--set", "features.stride=0"], "stride"),
        ([PATH, "--set", "reward.stall_share=0"], "stall_share"),
        ([PATH, "--set", "paces=0.5,fast"], "paces must be a finite number"),
        ([PATH, "--set", "controller=LQR"], "controller='LQR' is unknown"),
        ([PATH, "--set", "features.num_preview=4", "--steps", "600000"], "the agent knows 4"),
        ([PATH, "--set", "gains=default"], "key 'gains' is unknown"),
        ([PATH, "--set", "num_envs=4"], "too few robots"),
        ([PATH, "--preset", RESIDUAL, "--set", "controller=lqrr"], "Did you mean 'lqr'"),
        ([PATH, "--preset", RESIDUAL, "--set", "controller=dwa"], "does not read"),
        ([PATH, "--preset", "path_following", "--steps", "400000"], "lessons must be"),
        ([PATH, "--resume"], "no run to resume"),
    ],
)
def test_wrong_input_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    with pytest.raises(SystemExit) as caught:
        main([*arguments, "--out", str(tmp_path / "out")])
    assert caught.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_with_another_run_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    train(job(folder), quiet)
    other = dataclasses.replace(SMALL, name="another")
    for wrong, said in (
        (job(folder), "--resume"),
        (job(folder, preset=other, resume=True), "preset 'path_following_plain', not 'another'"),
        (job(folder, env_id=OMNI, resume=True), "env_id"),
        (job(folder, seed=1, resume=True), "seed"),
        (job(folder, settings=("epochs=2",), resume=True), "settings"),
    ):
        with pytest.raises(ValueError, match=said):
            train(wrong, quiet)
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("diary")
    with pytest.raises(ValueError, match="not empty"):
        train(job(tmp_path / "letters"), quiet)
    (folder / checkpoints.LAST).write_bytes(b"damaged")
    with pytest.raises(ValueError, match="damaged"):
        train(job(folder, resume=True), quiet)


def test_settings_take_the_place_of_numbers_of_every_kind() -> None:
    preset = overridden(
        preset_for(PATH, None),
        ["steps=2_000_000", "hidden=32,16", "reward.jerk_cost=0.1", "activation=relu", "shortest_ways=true"],
    )
    assert (preset.steps, preset.hidden, preset.reward.jerk_cost) == (2_000_000, (32, 16), 0.1)
    assert (preset.activation, preset.shortest_ways) == ("relu", True)
