"""Training: the vector environment adapter, presets, runs that stop and go on, and what is refused."""

# ruff: noqa: E402  what is optional is asked for before it is imported

import contextlib
import dataclasses
import errno
import functools
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")

from oracles.short_runs import SEEKER, SHORT
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from wayfield.envs.scenarios import GOAL_SCENARIOS
from wayfield.policies.learned.agent import Agent, Network, load_agent
from wayfield.policies.learned.features_dock import DockFeatures
from wayfield.policies.learned.features_team import TeamFeatures
from wayfield.policies.pilot import Pilot
from wayfield.policies.training import checkpoints
from wayfield.policies.training import run as training_run
from wayfield.policies.training.command import main
from wayfield.policies.training.curves import read_curve
from wayfield.policies.training.learner import PpoLearner
from wayfield.policies.training.presets import PRESETS, Preset, Sac, overridden
from wayfield.policies.training.run import Job, Report, plan_of, train
from wayfield.policies.training.sac import SacLearner
from wayfield.policies.training.shaping import GoalReward, TeamReward
from wayfield.policies.training.validation import validate
from wayfield.policies.training.ways import left_from, way_field
from wayfield.system.readers import READERS

PATH, OMNI = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"

PLAIN, RESIDUAL = "path_following_plain", "path_following_residual"

# a run of seconds: few robots, few paths
SMALL = PRESETS[PLAIN].changed(
    paces=(0.6,),
    shares=((0.5, {"scenario": "s_curve"}), (0.5, {"scenario": "circle", "noise": 1.0})),
    validation={"scenario": "s_curve", "actuators": "lagged"},
    **SHORT,
)


def job(folder: Path, preset: Any = SMALL, **changes: Any) -> Job:
    return dataclasses.replace(Job(PATH, preset, (), 0, folder), **changes)


def quiet(report: Report) -> None:
    """Looks away."""


def weights(folder: Path) -> list[Any]:
    arrays, _ = checkpoints.read_state(folder / checkpoints.LAST)
    return [array for name, array in sorted(arrays.items())]


def counts(folder: Path) -> list[Any]:
    """Returns the frames and updates of the last state, and where its random generators are."""
    _, numbers = checkpoints.read_state(folder / checkpoints.LAST)
    return [numbers[name] for name in ("frames", "updates", "random.numpy", "generators")]


def curve_but_for_seconds(folder: Path) -> list[list[str]]:
    rows = [line.split(",") for line in (folder / checkpoints.CURVE).read_text().splitlines()]
    column = rows[0].index("seconds")
    return [row[:column] + row[column + 1 :] for row in rows]


class Killed(Exception):
    """Stands for a power cut."""


TAUGHT = SMALL.changed(controller="lqr", imitation=16 * 8 * 2, steps=16 * 8 * 8, paces=(0.4, 0.6))
# a replay buffer that comes round, not with the end of an update, and random actions until after the first update
REPLAYING = SMALL.changed(batch_size=16, algorithm=Sac(16 * 22, learning_starts=16 * 10, gradient_steps=2))


SEEKING = SMALL.changed(
    shares=((1.0, {"scenario": "discs", "num_beams": 24, "max_range": 5.0, "robot": "omni3"}),),
    validation={"scenario": "discs", "num_beams": 24, "max_range": 5.0},
    **SEEKER,
    paces=(0.4, 0.6),
)


# worlds of several robots, who begin anew in the places of others, and of people
GUIDED = SEEKING.changed(
    task="teams",
    shares=((0.5, {"scenario": "circle_2/train"}), (0.5, {"scenario": "doorway_4/train", "disturbance": "moderate"})),
    validation={"scenario": "circle_2/validation"},
    features=TeamFeatures(num_beams=24, pool=4, bodies=3),
    reward=TeamReward(),
    controller="orca_team",
    controller_gains="default",
    guards=True,
    paces=(0.6,),
)
MEETING = GUIDED.changed(
    task="people",
    shares=((1.0, {"scenario": "crowdnav_5"}),),
    validation={"scenario": "crowdnav_5/validation"},
    conditions=((0.8, {"scenario": "lanes_12/validation", "visible": True}),),
    guards=False,
)
# of a team, by the scan alone
SCANNING = GUIDED.changed(features=SEEKING.features, controller="vfh_plus", guards=False)


@pytest.mark.parametrize(
    ("env_id", "preset"),
    [
        (PATH, SMALL),
        pytest.param(PATH, TAUGHT, marks=pytest.mark.slow),  # one that has lessons is stopped, below
        *((PATH, REPLAYING), (OMNI, SEEKING)),
        pytest.param("wayfield/OmniTeam-v0", GUIDED, marks=pytest.mark.slow),
        pytest.param("wayfield/OmniTeam-v0", SCANNING, marks=pytest.mark.slow),
        pytest.param("wayfield/OmniPeople-v0", MEETING, marks=pytest.mark.slow),
    ],
    ids=["plain", "taught", "replaying", "seeking", "guided", "scanning", "meeting"],
)
def test_a_run_that_was_killed_goes_on_as_if_it_had_not_been(
    tmp_path: Path, env_id: str, preset: Preset, monkeypatch: pytest.MonkeyPatch
) -> None:
    # validations of a few seconds: whole ones take longer than all the rest
    monkeypatch.setattr(training_run, "validate", lambda *asked: validate(*asked[:-1], clock=100))
    train(job(tmp_path / "whole", preset, env_id=env_id), quiet)
    for name, last in (("early", 1), ("late", 5)) if preset is SMALL else (("between", 3),):
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
        assert counts(folder) == counts(tmp_path / "whole")
        assert curve_but_for_seconds(folder) == curve_but_for_seconds(tmp_path / "whole")
    card = json.loads((tmp_path / "whole" / checkpoints.BEST / "card.json").read_text(encoding="utf-8"))
    # a controller that a network adds to has taught it nothing
    assert card["training"].get("taught_by", "") == (preset.prior.controller if preset.prior.imitation else "")
    assert card.get("base", {}).get("controller", "") == (preset.prior.controller if preset.prior.reach else "")
    assert load_agent(tmp_path / "whole" / checkpoints.BEST).features == preset.features
    # where there is more than one field, a curve has the successes in each, and the card those of the best
    fields = {name: shares for name, shares in read_curve(tmp_path / "whole").items() if name.startswith("success in ")}
    several = ["success in crowdnav_5, 0.6 m/s", "success in lanes_12, 0.8 m/s, seen"]
    assert list(fields) == (several if preset.worlds.conditions else [])
    for shares, measured in zip(fields.values(), card["measured"], strict=False):
        assert measured["success"] in shares


@pytest.mark.parametrize("arrival", [0.0, 20.0])
def test_learning_and_driving_command_the_same_twists(arrival: float) -> None:
    """What a network adds to a controller, and the law that ends the way, are to the learner as to what ships."""
    features = dataclasses.replace(SEEKING.features, arrival=arrival)
    learner = PpoLearner(SEEKING.changed(paces=(0.5,), features=features, arriving=True), OMNI, 3)
    env = learner.env
    network = Network.of(learner.layers())
    card = {"robots": ["omni3"], "dt": 0.05}
    agent: Any = Agent(network, features, SEEKING.actions, card, 0.5, SEEKING.base)
    inputs = env.reset()
    (part,) = env.worlds.parts
    pilot = Pilot(agent, part)
    pilot.reset()
    asked: list[Any] = []
    step = part.step
    part.step = lambda actions: (asked.append(actions), step(actions))[1]  # type: ignore[method-assign]
    for _ in range(10):  # no episode ends
        theirs = pilot.command(env.observations)
        inputs, _, ended, _ = env.step(network(inputs))
        assert not ended.any()
        np.testing.assert_array_equal(asked[-1], theirs)


@pytest.mark.parametrize("lessons", [pytest.param(0, marks=pytest.mark.slow), 4096])
def test_lessons_bring_a_network_to_drive_like_its_teacher(lessons: int) -> None:
    preset = SMALL.changed(shares=((1.0, {"scenario": "circle"}),), num_envs=64, time_limit=200, controller="lqr",
        imitation=64 * 8 * 60, imitation_rate=4e-3 if lessons else 1e-3, steps=10**6, lessons=lessons,
    )  # fmt: skip
    apart = []
    for taught in (False, True):
        learner = PpoLearner(preset, PATH, 0)
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
    assert preset.prior.imitation <= seen[-1] == learner.frames < 1.1 * preset.prior.imitation


@pytest.mark.parametrize("changes", [{}, {"lessons": 64}, {"imitation": 0, "controller": ""}])
@pytest.mark.parametrize("steps", [128, 641, 1000, 1280])
def test_a_run_is_whole_updates_and_passes_its_steps_by_less_than_one(changes: Any, steps: int, tmp_path: Path) -> None:
    preset = TAUGHT.changed(steps=steps, **({"imitation": steps // 3} | changes))
    plan = plan_of(preset)
    assert steps <= plan.frames < steps + plan.unit
    if not preset.prior.imitation:
        last = train(job(tmp_path, preset.changed(validations=1)), quiet)
        assert (last.frames, last.of, last.done) == (plan.frames, plan.frames, True)


def test_a_second_signal_cuts_a_run_off_and_later_ones_are_as_before() -> None:
    def before(number: int, frame: Any) -> None:
        came.append(number)

    came: list[int] = []
    handler = signal.signal(signal.SIGTERM, before)
    try:
        for first, second in itertools.product((signal.SIGINT, signal.SIGTERM), repeat=2):
            with training_run.interruptible() as interrupted:
                assert interrupted.number == 0
                signal.raise_signal(first)
                assert interrupted.number == first
                with pytest.raises(KeyboardInterrupt):
                    signal.raise_signal(second)
        assert signal.getsignal(signal.SIGTERM) is before
        with training_run.interruptible((signal.SIGINT,)) as interrupted:
            signal.raise_signal(signal.SIGTERM)
        assert (interrupted.number, came) == (0, [signal.SIGTERM])
    finally:
        signal.signal(signal.SIGTERM, handler)


LATE = {"scenario": "circle", "actuators": "lagged"}
LESSONS = TAUGHT.changed(
    shares=((1.0, LATE),), imitation=16 * 8 * 5, steps=16 * 8 * 7, lessons=300, controller_gains="default"
)
ADDING = SMALL.changed(
    shares=((1.0, LATE),),
    controller="regulated_pure_pursuit",
    controller_gains="default",
    reach=0.25,
    time_limit=40,
)
PARKED = SMALL.changed(
    task="docking",
    shares=((1.0, {"scenario": "moving/train", "num_beams": 24, "max_range": 5.0, "actuators": "lagged"}),),
    validation={"scenario": "open/validation", "num_beams": 24, "max_range": 5.0},
    features=DockFeatures(num_beams=24, pool=4, hull_radius=0.26),
    robot="p3dx",
    reward=GoalReward(),
    controller="reeds_shepp",
    controller_gains="default",
    imitation=16 * 8 * 4,
)


@pytest.mark.parametrize(
    ("env_id", "preset"),
    [
        pytest.param(PATH, SMALL, marks=pytest.mark.slow),  # it is killed, above
        *((PATH, LESSONS), (PATH, ADDING)),
        ("wayfield/DiffDriveDocking-v0", PARKED),
    ],
    ids=["plain", "lessons", "adding to one that is late", "taught by a planner"],
)
def test_a_run_that_is_stopped_wherever_it_can_be_goes_on_from_there(
    tmp_path: Path, env_id: str, preset: Preset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training_run, "validate", lambda *asked: validate(*asked[:-1], clock=50))
    if preset.prior.controller and env_id == PATH:  # a pilot foresees where a base is that answers late
        sheet = READERS["data sheet of a robot"].fill(tmp_path)
        sheet.write_text(
            json.dumps({**json.loads(sheet.read_text()), "turning_radius": 0.0})
        )  # the law turns on the spot
        preset = preset.changed(robot=str(sheet))
    train(job(tmp_path / "whole", preset, env_id=env_id), quiet)
    folder, stopped, reached = tmp_path / "run", None, [0]
    while stopped is None or not stopped.done:
        number = (signal.SIGINT, signal.SIGTERM)[len(reached) % 2]
        before = signal.getsignal(number)
        mine = job(folder, preset, env_id=env_id, resume=stopped is not None)
        stopped = train(mine, lambda report, number=number: signal.raise_signal(number))
        assert signal.getsignal(number) is before
        assert stopped.stopped == (0 if stopped.done else number)
        reached.append(stopped.frames)
    assert reached == sorted(reached), "every stop keeps what came before it"
    for mine, other in zip(weights(folder), weights(tmp_path / "whole"), strict=True):
        np.testing.assert_array_equal(mine, other)
    assert counts(folder) == counts(tmp_path / "whole")
    assert curve_but_for_seconds(folder) == curve_but_for_seconds(tmp_path / "whole")


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_seeds_run_side_by_side_and_leave_curves_logs_and_agents(
    count: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = range(3, 3 + count)
    # a path: to drive those of every family takes longer than all the rest
    monkeypatch.setitem(
        PRESETS, PLAIN, PRESETS[PLAIN].changed(shares=SMALL.worlds.shares, validation=SMALL.worlds.validation)
    )
    out = tmp_path / "out"
    small = ("num_envs=64", "horizon=8", "batch_size=64", "epochs=1", "hidden=8", "validations=1")
    settings = [word for each in small for word in ("--set", each)]
    asked = ("--steps", "1024", "--seeds", str(count), "--seed", "3")
    with pytest.raises(SystemExit) as caught:
        main([PATH, "--preset", PLAIN, *asked, "--out", str(out), *settings])
    assert caught.value.code == 0
    said = capsys.readouterr()
    told = said.out.splitlines()
    assert [line.split(":")[0] for line in told] == [f"seed {seed}" for seed in wanted]
    # without a terminal a line a validation, once; on a busy machine one of how far it is may come before
    validated = sorted(line for line in said.err.splitlines() if "success" in line)
    assert [line.split(",")[0] for line in validated] == [f"seed {seed}: 1" for seed in wanted], said.err
    assert all("024 of 1,024 frames" in line for line in validated)
    assert all(part in told[0] for part in ("done", "frames/s", "environment", "update", "last validation"))
    digests = set()
    for seed in wanted:
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
    assert len(digests) == count
    assert (out / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_the_agent_drives_as_the_network_that_was_trained() -> None:
    learner = PpoLearner(SMALL, PATH, 0)
    learner.update()
    network = Network.of(learner.layers())
    inputs = np.random.default_rng(0).normal(size=(100, network.sizes[0])).astype(np.float32)
    with torch.no_grad():
        mean = learner.ppo.policy.get_distribution(torch.from_numpy(inputs)).mode().numpy()
    assert np.abs(network(inputs) - mean).max() < 1e-5


def test_the_agent_that_is_kept_is_the_first_of_the_best_and_patience_ends_the_run(tmp_path: Path) -> None:
    still = SMALL.changed(learning_rate=1e-12, final_learning_rate=0.0)  # no validation beats the first
    for name, preset, rows in (("short", still.changed(patience=1), 2), ("whole", SMALL, 3)):
        train(job(tmp_path / name, preset), quiet)
        curve, card = read_curve(tmp_path / name), load_agent(tmp_path / name / "best").card
        best = int(np.argmax(curve["score"]))
        assert len(curve["score"]) == rows
        assert card["validation"]["score"] == pytest.approx(curve["score"][best])
        assert card["training"]["frames"] == curve["frames"][best]


def test_the_agent_of_sac_drives_by_the_squashed_mean(tmp_path: Path) -> None:
    train(job(tmp_path / "run", REPLAYING), quiet)
    agent = load_agent(tmp_path / "run" / "best")
    learner = SacLearner(REPLAYING, PATH, 0)
    inputs = 3.0 * np.random.default_rng(0).normal(size=(100, agent.network.sizes[0])).astype(np.float32)
    wanted, _ = learner.sac.predict(inputs, deterministic=True)
    assert np.abs(Network.of(learner.layers())(inputs) - wanted).max() < 1e-5
    # in its folder the last layer passes on what the one before has squashed
    assert agent.card["network"]["hidden"] == [*REPLAYING.learning.hidden, 2]
    assert agent.card["training"]["algorithm"] == "sac"
    np.testing.assert_array_equal(agent.network.numbers[-6:], [1.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    assert np.abs(agent.network(inputs)).max() <= 1.0
    assert len(read_curve(tmp_path / "run")["critic_loss"]) == REPLAYING.learning.validations


def test_what_sac_replays_follows_one_another_but_where_an_episode_ends() -> None:
    random = Sac(16 * 40, learning_starts=10**6)
    preset = REPLAYING.changed(horizon=1, algorithm=random, time_limit=9, shares=((1.0, {"scenario": "circle"}),))
    learner = SacLearner(preset, PATH, 0)
    rewards = [learner.update()["reward"] for _ in range(40)]
    replay = learner.sac.replay_buffer
    assert replay is not None
    ended = replay.dones[:-1] == 1.0
    seen, following = replay.observations[1:], replay.next_observations[:-1]
    np.testing.assert_array_equal(seen[~ended], following[~ended])
    assert (seen[ended] != following[ended]).any(axis=1).all()
    # the clock has no say in what a place is worth
    assert (replay.timeouts[8] == replay.dones[8]).all()
    assert replay.dones[8].all()
    np.testing.assert_allclose(rewards, replay.rewards.mean(axis=1) / (1.0 - preset.learning.discount), rtol=1e-5)


def test_sac_learns_the_best_action_where_nothing_follows() -> None:
    """Of steps that end, with a reward of -(a - (0.5, -0.25))^2, the mean comes to that action; drawn at random."""
    rates = {"learning_rate": 6e-3, "final_learning_rate": 6e-3}
    preset = REPLAYING.changed(hidden=(32, 32), algorithm=Sac(16 * 20), **rates)
    learner = SacLearner(preset, PATH, 0)
    replay, rng = learner.sac.replay_buffer, np.random.default_rng(0)
    assert replay is not None
    best = np.array([0.5, -0.25], np.float32)
    replay.actions[:] = rng.uniform(-1.0, 1.0, replay.actions.shape)
    replay.rewards[:] = -np.square(replay.actions - best).sum(axis=-1)
    replay.dones[:], replay.full = 1.0, True
    learner.sac.train(gradient_steps=400, batch_size=64)
    inputs = np.zeros((1, int(learner.sac.observation_space.shape[0])), np.float32)  # type: ignore[index]
    assert np.abs(Network.of(learner.layers())(inputs) - best).max() < 0.15


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["activation=relu"], "activation must be tanh"),
        (["sac.buffer_size=many"], "sac.buffer_size must be a whole number"),
        (["sac.buffer_size=1023"], "num_envs x horizon = 1024"),
        (["sac=1"], "has parts: sac.buffer_size"),
    ],
)
def test_what_does_not_go_with_sac_is_refused(settings: list[str], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        overridden(PRESETS["path_following_sac"], settings)


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
        ([PATH, "--preset", "omni3_goal"], "is for wayfield/OmniGoalObstacles-v0"),
        ([PATH, "--set", "learning_rat=1"], "Did you mean 'learning_rate'"),
        (["wayfield/Nowhere-v0"], "has no preset"),
        (["omni3_goal"], "It is one of wayfield/OmniGoalObstacles-v0, which takes --preset omni3_goal."),
        ([PATH, "--preset", "path_folowing"], "Did you mean 'path_following'"),
        ([PATH, "--set", "learning_rate"], "key=value"),
        ([PATH, "--set", "reward=1"], "has parts"),
        ([PATH, "--steps", "0"], "steps must be a whole number >= 1"),
        ([PATH, "--preset", PLAIN, "--steps", str(1024 * 32 - 1)], "at least one update, num_envs x horizon = 32768"),
        ([PATH, "--preset", PLAIN, "--set", "controller=lqr"], "either teaches"),
        ([PATH, "--set", "num_envs=4"], "too few robots"),
        ([PATH, "--preset", RESIDUAL, "--set", "controller=dwa"], "does not read"),
        ([PATH, "--preset", "path_following", "--set", "steps=400000"], "imitation must be"),
        ([PATH, "--resume"], "no run to resume"),
        ([PATH, "--seed", "99999999999"], "2147483647"),
        pytest.param(
            [PATH, "--preset", PLAIN, "--set", "num_envs=65536", "--set", "horizon=65536", "--steps", "9" * 11],
            "memory",
            marks=pytest.mark.slow,
        ),
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
    other = SMALL.changed(name="another")
    for wrong, said in (
        (job(folder), "--resume"),
        (job(folder, preset=other, resume=True), "preset 'path_following_plain', not 'another'"),
        (job(folder, env_id=OMNI, resume=True), "env_id"),
        (job(folder, seed=1, resume=True), "seed"),
        (job(folder, settings=("epochs=2",), resume=True), r"with settings \[\], not \['epochs=2'\]; .* another --out"),
    ):
        with pytest.raises(ValueError, match=said):
            train(wrong, quiet)
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("diary")
    with pytest.raises(ValueError, match="not empty"):
        train(job(tmp_path / "letters"), quiet)
    (tmp_path / "file").write_text("diary")
    with pytest.raises(ValueError, match="is no folder"):
        train(job(tmp_path / "file"), quiet)


# ---- what is damaged, and what is cut off


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder of a run that came to its end; tests copy it."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    assert train(job(folder), quiet).done
    return folder


def tensors_of_ones(file: Path) -> None:
    """Fills all arrays of a file with bytes 0xff: every float is no number."""
    content = file.read_bytes()
    first = 8 + int.from_bytes(content[:8], "little")
    file.write_bytes(content[:first] + b"\xff" * (len(content) - first))


def flipped(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-1000] ^= 1
    file.write_bytes(bytes(content))


def other_number(file: Path) -> None:
    content = file.read_bytes()
    changed = content.replace(b'run_updates\\": 6', b'run_updates\\": 5')
    assert changed != content
    file.write_bytes(changed)


DAMAGES: dict[str, Callable[[Path], Any]] = {
    "ones": tensors_of_ones,
    "number": other_number,
    "vast": lambda file: os.truncate(file, 2**36),
    "folder": lambda file: (file.unlink(), file.mkdir()),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_state_is_refused_and_the_one_before_it_used(tmp_path: Path, finished: Path, damage: str) -> None:
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    best = load_agent(folder / "best").network.numbers
    before, _ = checkpoints.read_state(folder / checkpoints.PREVIOUS)
    DAMAGES[damage](folder / checkpoints.LAST)
    if damage == "folder":
        (folder / checkpoints.LAST).rmdir()
    state, said = checkpoints.last_state(folder)
    assert state is not None
    assert state[1]["run_updates"] == 4
    for name, array in before.items():
        np.testing.assert_array_equal(state[0][name], array)
    assert checkpoints.LAST in said
    assert said.endswith("going on from the save before it")
    assert "\n" not in said
    # it is the last now: both gone is one line, and the best agent is as it was
    if damage != "number":
        DAMAGES[damage](folder / checkpoints.LAST)
        if (folder / checkpoints.LAST).exists():
            with pytest.raises(ValueError, match=r"last\.safetensors.*no save before it") as caught:
                train(job(folder, resume=True), quiet)
            assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(load_agent(folder / "best").network.numbers, best)


def test_a_run_that_falls_back_ends_as_if_nothing_had_happened(tmp_path: Path, finished: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    tensors_of_ones(folder / checkpoints.LAST)
    notes = set()
    last = train(job(folder, resume=True), lambda report: notes.add(report.note))
    assert last.done
    (note,) = notes
    assert "going on from the save before it" in note
    for mine, other in zip(weights(folder), weights(finished), strict=True):
        np.testing.assert_array_equal(mine, other)
    assert curve_but_for_seconds(folder) == curve_but_for_seconds(finished)
    mine, other = (load_agent(each / "best").network.numbers for each in (folder, finished))
    np.testing.assert_array_equal(mine, other)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are cut off at a chosen moment by fork")
def test_a_state_that_is_killed_at_any_moment_leaves_the_last_or_this_one(tmp_path: Path) -> None:
    from oracles.killed import killed_at

    found, count = set(), 0
    while True:
        folder = tmp_path / f"run_{count}"
        folder.mkdir()
        for k in (1, 2):
            checkpoints.write_state(folder, {"a": np.full(3, k)}, {"k": k})

        def write(folder: Path = folder) -> None:
            checkpoints.write_state(folder, {"a": np.full(3, 3)}, {"k": 3})

        killed = killed_at(count, write)
        state, _ = checkpoints.last_state(folder)
        assert state is not None
        assert (state[0]["a"] == state[1]["k"]).all()
        found.add(state[1]["k"])
        if not killed:
            break
        count += 1
    assert count > 3
    assert found == {2, 3}
    assert state[1]["k"] == 3


@pytest.mark.parametrize("update", [1, 4])
def test_a_training_that_diverges_is_refused_and_leaves_the_best_agent(
    tmp_path: Path, finished: Path, monkeypatch: pytest.MonkeyPatch, update: int
) -> None:
    folder, done = tmp_path / "run", 0
    from wayfield.policies.training.proximal import Proximal

    learn = Proximal.train

    def diverge(ppo: Any) -> None:
        nonlocal done
        learn(ppo)
        done += 1
        if done == update:
            with torch.no_grad():
                next(ppo.policy.parameters()).fill_(float("nan"))

    monkeypatch.setattr(Proximal, "train", diverge)
    with pytest.raises(FloatingPointError, match=r"diverged.*not finite") as caught:
        train(job(folder), quiet)
    assert "\n" not in str(caught.value)
    if update > 2:
        assert np.isfinite(load_agent(folder / "best").network.numbers).all()
    else:
        assert not (folder / "best").exists()
    monkeypatch.undo()
    assert train(job(folder, resume=True), quiet).done
    for mine, other in zip(weights(folder), weights(finished), strict=True):
        np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("content", [b"{", b"\xff\xfe", b"[" * 10**6, b"1e999"])
def test_a_description_or_curve_of_no_use_is_named(tmp_path: Path, finished: Path, content: bytes) -> None:
    shutil.copytree(finished, tmp_path / "run")
    for name, read in ((checkpoints.RUN, checkpoints.read_run), (checkpoints.CURVE, read_curve)):
        (tmp_path / "run" / name).write_bytes(content)
        with pytest.raises(ValueError, match=name.replace(".", r"\.")) as caught:
            read(tmp_path / "run")
        assert len(str(caught.value)) < 500


@contextlib.contextmanager
def held_elsewhere(folder: Path) -> Iterator[None]:
    """Holds a run's folder in another process while the block runs."""
    code = (
        "import sys; from pathlib import Path; from wayfield.system.storage import locked\n"
        "with locked(Path(sys.argv[1]), ''): print(flush=True); sys.stdin.read()"
    )
    words = [sys.executable, "-c", code, str(folder / checkpoints.LOCK)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        yield


def test_two_trainings_never_write_one_folder(
    tmp_path: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "seed_0"
    shutil.copytree(finished, folder)
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file() and file.name != ".lock"}
    with held_elsewhere(folder):
        with pytest.raises(BlockingIOError, match="is being written by another training"):
            train(job(folder, resume=True), quiet)
        described = json.loads((folder / checkpoints.RUN).read_text())
        (folder / checkpoints.RUN).write_text(json.dumps(described | {"steps": 40000, "settings": ["steps=40000"]}))
        settings = ["--preset", PLAIN, "--steps", "40000", "--seeds", "2"]
        with pytest.raises(SystemExit) as caught:
            main([PATH, *settings, "--out", str(tmp_path), "--resume"])
        (folder / checkpoints.RUN).write_bytes(before[folder / checkpoints.RUN])
    assert caught.value.code == 1
    said = capsys.readouterr().err
    assert "another training" in said
    assert said.count("\n") == 1
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file() and file.name != ".lock"} == before
    assert train(job(folder, resume=True), quiet).done


@pytest.mark.parametrize("there", [False, True], ids=["new", "resumed"])
def test_a_full_disk_at_the_first_save_leaves_what_was_there(
    tmp_path: Path, finished: Path, monkeypatch: pytest.MonkeyPatch, there: bool
) -> None:
    folder = tmp_path / "out" / "seed_0"
    if there:
        shutil.copytree(finished, folder)
        before = {file: file.read_bytes() for file in (folder / "best").iterdir()}

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space"):
            train(job(folder, resume=there), quiet)
    if there:
        assert {file: file.read_bytes() for file in (folder / "best").iterdir()} == before
    else:
        assert not (tmp_path / "out").exists()
    assert train(job(folder, resume=there), quiet).done


# ---- the command as it is run, in processes of its own

TRAIN = [sys.executable, str(Path(__file__).parents[2] / "train.py"), PATH, "--preset", PLAIN]
TINY = [
    "--set",
    "num_envs=64",
    "--set",
    "horizon=8",
    "--set",
    "batch_size=64",
    "--set",
    "epochs=1",
    "--set",
    "hidden=8",
]


def children_of(process: int) -> set[int]:
    """Returns the processes below one that run training, by what Linux tells."""
    below: set[int] = set()
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            parts = file.read_text().rpartition(")")[2].split()
            if int(parts[1]) == process and "spawn_main" in file.with_name("cmdline").read_text():
                below.add(int(file.parent.name))
    return below


def running(processes: set[int]) -> set[int]:
    found = set()
    for each in processes:
        with contextlib.suppress(OSError):
            if Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
                found.add(each)
    return found


def wait_until(held: Callable[[], Any], seconds: float = 180.0) -> None:
    end = time.monotonic() + seconds
    while not held():
        assert time.monotonic() < end
        time.sleep(0.1)


def let_go(folder: Path) -> bool:
    """Returns whether nobody writes a folder of training any more."""
    from wayfield.policies.training.run import held

    try:
        with held(folder):
            return True
    except BlockingIOError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_seeds_end_with_their_command(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "out"
    steps = ["--steps", str(512 * 4000), "--set", "validations=400"]
    words = [*TRAIN, *TINY, *steps, "--seeds", "2", "--out", str(out)]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as run:
        wait_until(lambda: all((out / f"seed_{k}" / checkpoints.LAST).exists() for k in (0, 1)))
        children = children_of(run.pid)
        assert len(children) == 2
        run.send_signal(number)
        run.wait(120)
        assert run.stderr is not None
        said = run.stderr.read() if number != signal.SIGKILL else ""
    wait_until(lambda: not running(children))
    assert run.returncode == (-number if number == signal.SIGKILL else 128 + number)
    assert "Traceback" not in said
    for k in (0, 1):
        assert checkpoints.last_state(out / f"seed_{k}")[0] is not None
        load_agent(out / f"seed_{k}" / "best")
        # a process counts as ended while threads of it still end, and lets go of its files with the last
        wait_until(functools.partial(let_go, out / f"seed_{k}"))


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_all_while_they_start_is_one_line(tmp_path: Path, number: signal.Signals) -> None:
    for wait in (0.3, 1.0, 2.0, 4.0):
        words = [*TRAIN, "--seeds", "2", "--out", str(tmp_path / "out")]
        with subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        ) as run:
            time.sleep(wait)
            os.killpg(run.pid, number)  # as a terminal and a scheduler do: the children too
            _, said = run.communicate(timeout=120)
        assert run.returncode == 128 + number, said
        assert "Traceback" not in said
        assert said.count("\n") == 1


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="pipes")
def test_a_reader_that_has_gone_costs_nothing(tmp_path: Path) -> None:
    words = [*TRAIN, *TINY, "--steps", "1024", "--set", "validations=1", "--out", str(tmp_path / "größe 走")]
    read, write = os.pipe()
    os.close(read)
    gone = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert gone.returncode != 0
    assert all(line.startswith(b"seed 0: ") and b" frames, " in line for line in gone.stderr.splitlines())
    assert (tmp_path / "größe 走" / "curves.png").exists()
