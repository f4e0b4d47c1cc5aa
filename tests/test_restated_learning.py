"""What a training counts, keeps, tells and draws, stated once more beside a learner of a few lines."""

import contextlib
import dataclasses
import errno
import json
import math
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click.testing
import matplotlib.figure
import numpy as np
import pytest

from wayfield.envs.engines import Failed
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies.learned.agent import CARD, load_agent
from wayfield.policies.learned.perception import Perception
from wayfield.policies.learned.ppo import shipped
from wayfield.policies.policy import check_gain, check_whole
from wayfield.policies.training import checkpoints, command, learner, measured, run, slices, validation
from wayfield.policies.training.checkpoints import BEST, CURVE, LAST, LOCK, RUN
from wayfield.policies.training.curves import draw_curves
from wayfield.policies.training.presets import PRESETS, Preset
from wayfield.policies.training.run import Job, Report
from wayfield.policies.training.validation import Score

PATH, DOCK = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveDocking-v0"
UPDATE = 24 * 4  # frames
DT = 0.05


def preset_of(name: str = "path_following_plain", **changes: Any) -> Preset:
    small: dict[str, Any] = {"num_envs": 24, "horizon": 4, "batch_size": 48, "hidden": (3,), "validations": 3}
    return dataclasses.replace(PRESETS[name], **{"steps": UPDATE * 7, **small, **changes})


class Fake:
    """A learner whose network is a number, which grows with every update."""

    LOGGED = ("std",)

    def __init__(self, preset: Preset) -> None:
        self.preset, self.frames, self.value = preset, 0, 0.0
        self.width = Perception(preset.features, preset.actions, 2, 0.05, preset.base is not None).num_inputs
        self.seconds = {"environment": 0.0, "validation": 0.0}
        worlds = SimpleNamespace(task=SimpleNamespace(robot=ROBOTS["p3dx"], options=SimpleNamespace(dt=0.05)))
        self.closed = 0
        self.env = SimpleNamespace(worlds=worlds, close=self.close)
        self.checked = 0

    def close(self) -> None:
        self.closed += 1

    def layers(self) -> Any:
        sizes = [(3, self.width), (2, 3)]
        return [(np.full(size, self.value, np.float32), np.zeros(size[0], np.float32)) for size in sizes]

    def teach(self) -> Iterator[int]:
        for k in (1, 2, 3):
            self.frames = k * self.preset.imitation // 3
            yield self.frames

    def check_finite(self) -> None:
        self.checked += 1

    def update(self) -> dict[str, float]:
        self.frames += UPDATE
        self.value += 0.25
        return {"reward": 0.5 * self.value, "std": 0.1 * self.value, "loss": 9.0}

    def state(self) -> Any:
        return {"value": np.array([self.value])}, {"frames": self.frames}

    def restore(self, arrays: Any, numbers: Any) -> None:
        self.value, self.frames = float(arrays["value"][0]), numbers["frames"]


def score_of(k: int, scores: list[float]) -> Score:
    return Score(scores[k % len(scores)], 0.9 - 0.01 * k, 0.1, 0.01 * (k + 1), 0.02, 0.03, 0.5, 7.0 + k)


@dataclasses.dataclass
class Told:
    """What was asked of validations, and what they found."""

    scores: list[float]
    asked: list[Any] = dataclasses.field(default_factory=list)

    def __call__(self, agent: Any, env_id: str, kwargs: Any, clock: int) -> Score:
        self.asked.append((agent.speed, env_id, dict(kwargs), clock, float(agent.network.numbers[0])))
        return score_of(len(self.asked) - 1, self.scores)


class Written:
    """TensorBoard's writer, of which only the last is asked."""

    last: "Written"

    def __init__(self, folder: str, purge_step: int | None) -> None:
        self.folder, self.purged, self.open = folder, purge_step, True
        self.scalars: list[tuple[str, float, int]] = []
        Written.last = self

    def add_scalar(self, name: str, value: float, frames: int) -> None:
        assert self.open
        self.scalars.append((name, value, frames))

    def close(self) -> None:
        self.open = False


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    found = Told([0.3, 0.1, 0.5, 0.7, 0.2, 0.6])
    monkeypatch.setattr(run, "SummaryWriter", Written)
    monkeypatch.setattr(run, "validate", found)
    monkeypatch.setattr(run, "cruises", lambda agent: {"lagged": [[0.4, 0.1 * float(agent.network.numbers[0])]]})
    return found


def began(folder: Path, preset: Preset, resume: bool = False, env_id: str = PATH) -> Any:
    job = Job(env_id, preset, ("validations=3",), 4, folder, resume, threads=2, command="as typed")
    return run._Run(job, Fake(preset))  # type: ignore[arg-type]


def went(each: Any, after: int = 10**9) -> tuple[list[Report], Report]:
    """Returns the reports of a run that is interrupted after so many, and the last."""
    reports: list[Report] = []
    last = each.go(reports.append, lambda: len(reports) >= after)
    return reports, last


@pytest.mark.parametrize(
    ("updates", "validations", "imitation"), [(7, 3, 0), (7, 3, 2), (10, 4, 0), (3, 5, 0), (5, 2, 1)]
)
def test_a_run_validates_evenly_and_at_its_end(
    updates: int, validations: int, imitation: int, tmp_path: Path, told: Told
) -> None:
    more: dict[str, Any] = {"controller": "lqr", "imitation": imitation * UPDATE} if imitation else {}
    # the last update begins whatever is left of the frames
    steps = (updates + imitation) * UPDATE - 5
    preset = preset_of(steps=steps, validations=validations, **more)
    reports, last = went(began(tmp_path, preset))
    every = max(1, round(updates / validations))
    at = [k for k in range(1, updates + 1) if k % every == 0 or k == updates]
    first = 3 * (imitation > 0)
    frames = [k * imitation * UPDATE // 3 for k in range(1, first + 1)]
    shown = [False] * first
    if imitation:  # what was taught may be the best
        frames.append(frames[-1])
        shown.append(True)
    frames += [(imitation + k) * UPDATE for k in range(1, updates + 1)]
    shown += [k in at for k in range(1, updates + 1)]
    assert [each.frames for each in reports] == frames
    assert [each.row is not None for each in reports] == shown
    assert {(each.seed, each.steps, each.done, each.stopped, each.note) for each in reports} == {
        (4, steps, False, 0, "")
    }
    assert (last.done, last.frames, last.row) == (True, frames[-1], reports[-1].row)
    # each validation drives what was learned by then, where and as fast as the preset says
    kwargs = dict(preset.validation)
    values = [0.0] * bool(imitation) + [0.25 * k for k in at]
    assert told.asked == [(0.6, PATH, kwargs, TASKS["path_following"].clock, value) for value in values]
    numbers = [score_of(k, told.scores) for k in range(len(told.asked))]
    rows = [each.row for each in reports if each.row is not None]
    for k, (row, score) in enumerate(zip(rows, numbers, strict=True)):
        taught = bool(imitation) and k == 0
        done = 0 if taught else at[k - bool(imitation)]
        wanted = {
            **dataclasses.asdict(score), "frames": float((imitation + done) * UPDATE), "updates": float(done),
            "return": score.reward,
            "reward": math.nan if taught else 0.125 * done, "std": math.nan if taught else 0.025 * done,
        }  # fmt: skip
        assert row.keys() - {"seconds"} == wanted.keys()
        assert {name: row[name] for name in wanted} == pytest.approx(wanted, nan_ok=True)
        assert 0.0 <= row["seconds"] < 60.0
    written = Written.last
    scalars = [(f"wayfield/{name}", value, int(row["frames"])) for row in rows for name, value in row.items()]
    assert str(written.scalars) == str(scalars)
    assert (written.folder, written.purged, written.open) == (str(tmp_path / "tensorboard"), None, False)
    # of equals the first is kept, and the card says what it was
    best = max(range(len(numbers)), key=lambda k: (numbers[k].score, -k))
    agent = load_agent(tmp_path / BEST)
    card = agent.card
    assert float(agent.network.numbers[0]) == pytest.approx(values[best], abs=1e-9)
    assert card["validation"] == {
        **{name: each for name, each in dataclasses.asdict(numbers[best]).items() if name != "reward"},
        "return": 7.0 + best,
    }  # fmt: skip
    training = card["training"]
    assert training["frames"] == rows[best]["frames"]
    assert training["run_frames"] == frames[-1]
    assert (training["seconds"], training["run_seconds"] >= training["seconds"]) == (rows[best]["seconds"], True)
    assert 0.0 <= training["run_cpu_seconds"] < 60.0
    assert (training["algorithm"], training["command"], training["preset"]) == ("ppo", "as typed", preset.name)
    assert (training["seed"], training["steps"], training["settings"]) == (4, steps, ["validations=3"])
    teacher = {"taught_by": "lqr", "taught_with": preset.gains} if imitation else {}
    assert {name: each for name, each in training.items() if name.startswith("taught")} == teacher
    assert card["name"] == f"{preset.name}, seed 4"
    assert (card["task"], card["env_id"], card["robots"], card["dt"]) == ("path_following", PATH, ["p3dx"], 0.05)
    assert card["sheets"] == {"p3dx": ROBOTS["p3dx"].digest}
    assert (card["speed"], card["env_kwargs"], "cruises" in card, "base" in card) == (0.6, kwargs, False, False)
    width = len(agent.network.numbers[:0]) + int(agent.network.sizes[0])
    assert card["network"] == {
        "hidden": [3], "activation": "tanh", "num_twist": 2, "parameters": 3 * width + 3 + 2 * 3 + 2,
    }  # fmt: skip
    assert card["measured"] == [{"asked_speed": 0.6, "env_kwargs": kwargs, **dataclasses.asdict(numbers[best])}]
    assert card["trained_on"] == {
        "actuators": ["lagged"], "disturbances": ["none", "moderate"], "speeds": [0.4, 0.6, 0.8, 1.05], "beams": [],
    }  # fmt: skip
    curve = (tmp_path / CURVE).read_text().splitlines()
    assert curve[0].split(",") == list(rows[0])
    assert len(curve) == len(rows) + 1
    description = json.loads((tmp_path / RUN).read_text())
    assert (description["threads"], description["command"], description["env_id"]) == (2, "as typed", PATH)
    assert description["versions"] == run.versions() == training["versions"]
    assert set(run.versions()) <= {"python", *run.PACKAGES}


def test_a_run_is_worth_the_mean_over_its_conditions_and_tells_of_each(tmp_path: Path, told: Told) -> None:
    slow = {"scenario": "all/validation", "actuators": "slow"}
    preset = preset_of(conditions=((0.5, slow), (1.05, {})), paced=True, robot="p3dx", speed=0.7, steps=UPDATE * 2)
    each = began(tmp_path, preset)
    reports, _ = went(each)
    base = {**preset.validation, "robot": "p3dx"}
    conditions = [(0.7, base), (0.5, {**slow, "robot": "p3dx"}), (1.05, {"robot": "p3dx"})]
    assert [(speed, kwargs) for speed, _, kwargs, *_ in told.asked] == conditions * 2
    for k, report in enumerate(reports):
        assert report.row is not None
        assert report.row["score"] == pytest.approx(sum(told.scores[3 * k : 3 * k + 3]) / 3.0)
        assert report.row["success"] == score_of(3 * k, told.scores).success  # the first's
    # (0.3 + 0.1 + 0.5) / 3 < (0.7 + 0.2 + 0.6) / 3
    card = load_agent(tmp_path / BEST).card
    assert card["measured"] == [
        {"asked_speed": speed, "env_kwargs": kwargs, **dataclasses.asdict(score_of(3 + k, told.scores))}
        for k, (speed, kwargs) in enumerate(conditions)
    ]
    assert card["cruises"] == {"lagged": [[0.4, pytest.approx(0.05)]]}
    assert card["env_kwargs"] == base
    # taken up again it says the same, and has nothing left to do
    again = began(tmp_path, preset, resume=True)
    assert (again.updates, again.taught, again.best_row, again.measured) == (2, True, each.best_row, each.measured)
    assert went(again)[0] == []


@pytest.mark.parametrize("after", [1, 4, 6])
def test_a_run_that_was_interrupted_ends_as_the_whole_one(after: int, tmp_path: Path, told: Told) -> None:
    preset = preset_of(steps=UPDATE * 9, controller="lqr", imitation=UPDATE * 2)
    whole, end = went(began(tmp_path / "whole", preset))
    told.asked.clear()
    first = began(tmp_path / "cut", preset)
    reports, last = went(first, after)
    assert len(reports) == after
    assert not last.done
    if after < 4:  # while it is taught there is nothing to go on from
        assert (last.frames, (tmp_path / "cut" / LAST).exists(), told.asked) == (0, False, [])
    else:
        assert last.frames == reports[-1].frames
        assert last.row == reports[3].row if after < 6 else reports[5].row
        assert first.learner.closed == 1
    assert not Written.last.open
    rest, again = went(began(tmp_path / "cut", preset, resume=True))
    assert again.done
    # what was cut off is drawn anew
    assert Written.last.purged == (None if after < 4 else last.frames + 1)
    kept = [] if after < 4 else reports
    assert [each.frames for each in kept + rest] == [each.frames for each in whole]
    rows, wanted = ([each.row for each in told if each.row] for told in (kept + rest, whole))
    assert all(
        {**mine, "seconds": 0.0} == pytest.approx({**other, "seconds": 0.0}, nan_ok=True)
        for mine, other in zip(rows, wanted, strict=True)
    )
    assert again.frames == end.frames
    pair = [load_agent(tmp_path / name / BEST).network.numbers for name in ("whole", "cut")]
    np.testing.assert_array_equal(*pair)


def test_what_followers_and_seekers_cost_is_worked_out_by_hand() -> None:
    """Of 21 robots the middle half are the 6th to the 16th, and the 20th is the 95th percentile."""
    count, clock = 21, 400
    rng = np.random.default_rng(3)
    order = rng.permutation(count)
    followed = validation.Followed(count, clock, DT)
    state = np.dtype([("arc_length", np.float64), ("cross_track_error", np.float64)])
    before, after = np.zeros(count, state), np.zeros(count, state)
    # 1 m at a constant error, 0 to 0.2 m; what is driven once a robot has ended is not counted
    before["cross_track_error"] = after["cross_track_error"] = 0.01 * order
    after["arc_length"] = 1.0
    followed.step(before, after, np.ones(count, bool))
    before["cross_track_error"] = 9.0
    followed.step(before, after, np.zeros(count, bool))
    well = np.ones(count)
    score, error, costs = followed.judged(well, 1.0 - well, np.full(count, 100.0))
    assert costs == pytest.approx(0.01 * order)
    assert (score, error) == pytest.approx((-(0.1 + 0.25 * 0.19), 0.1))
    well[order >= 19] = 0.0  # the two worst, who count as 1 m
    score, error, costs = followed.judged(well, 1.0 - well, np.full(count, 100.0))
    assert (score, error, costs.max()) == pytest.approx((-(0.1 + 0.25), 0.1, 1.0))
    reached = validation.Reached(count, clock, DT)
    reached.step(before, after, np.ones(count, bool))
    hit = np.where(order == 20, 1.0, 0.0)
    score, error, times = reached.judged(well, hit, 10.0 * order)
    assert score == pytest.approx(-(sum(10.0 * k / clock for k in range(19)) + 1.0 + 2.0) / count)
    assert error == pytest.approx(DT * 10.0 * 9.0)  # of the 19 that succeeded
    assert times == pytest.approx(np.where(order < 19, DT * 10.0 * order, DT * clock))
    assert math.isnan(reached.judged(0.0 * well, hit, 10.0 * order)[1])


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_a_card_tells_of_all_layers_of_a_network(robot: str) -> None:
    task: Any = SimpleNamespace(robot=ROBOTS[robot], options=SimpleNamespace(dt=0.05))
    layers: Any = [(np.zeros((n, m)), np.zeros(n)) for n, m in ((5, 7), (4, 5), (6, 4), (2, 6))]
    card = run.described_agent(preset_of(activation="relu"), task, PATH, {}, "one", layers)
    assert card["network"] == {
        "hidden": [5, 4, 6], "activation": "relu", "num_twist": 2 if robot == "p3dx" else 3,
        "parameters": 5 * 8 + 4 * 6 + 6 * 5 + 2 * 7,
    }  # fmt: skip


@pytest.mark.parametrize("older", [False, True])
def test_a_run_counts_the_seconds_that_it_works_and_its_learner_on_what(
    older: bool, tmp_path: Path, told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A state of older releases knows neither processor time nor measured paces: the former counts from then on."""
    clock = SimpleNamespace(now=100.0, computed=40.0)  # s; of the processor half as fast
    stopwatch = SimpleNamespace(perf_counter=lambda: clock.now, process_time=lambda: clock.computed)
    monkeypatch.setattr(run, "time", stopwatch)
    monkeypatch.setattr(learner, "time", stopwatch)

    def takes(seconds: float) -> None:
        clock.now += seconds
        clock.computed += 0.5 * seconds

    class Slow(Fake):
        def teach(self) -> Iterator[int]:
            for frames in super().teach():
                takes(2.0)
                yield frames

        def update(self) -> dict[str, float]:
            takes(3.0)
            return super().update()

    def slow(*asked: Any) -> Score:
        takes(5.0)
        return told(*asked)

    monkeypatch.setattr(run, "validate", slow)
    preset = preset_of(steps=UPDATE * 8, validations=3, controller="lqr", imitation=UPDATE * 2)  # after 2, 4, 6 updates
    job = Job(PATH, preset, (), 4, tmp_path)
    reports, _ = went(run._Run(job, Slow(preset)), 8)  # type: ignore[arg-type]
    before = clock.computed - 40.0
    takes(1000.0)  # until it is taken up again
    if older:
        state = checkpoints.read_state

        def without(folder: Path) -> Any:
            arrays, numbers = state(folder)  # type: ignore[misc]
            del numbers["cpu_seconds"], numbers["cruises"]
            return arrays, numbers

        monkeypatch.setattr(checkpoints, "read_state", without)
    last = run._Run(dataclasses.replace(job, resume=True), Slow(preset))  # type: ignore[arg-type]
    takes(1.0)
    reports += went(last)[0]
    rows = [each.row for each in reports if each.row is not None]
    assert [row["seconds"] for row in rows] == [11.0, 22.0, 33.0, 44.0]
    assert reports[-1].seconds["validation"] == 20.0
    training = load_agent(tmp_path / BEST).card["training"]
    assert (training["seconds"], training["run_seconds"], training["run_cpu_seconds"]) == (
        44.0, 44.0, 22.5 - before if older else 22.5
    )  # fmt: skip
    assert before > 1.0

    def collected() -> float:
        takes(3.0)
        seconds["environment"] += 4.0
        takes(4.0)
        return 0.5

    seconds = {"environment": 1.0, "rollout policy": 10.0, "update": 20.0}
    model = SimpleNamespace(
        _update_current_progress_remaining=lambda *_: None, logger=SimpleNamespace(name_to_value={"train/std": 0.25})
    )
    part = SimpleNamespace(
        seconds=seconds, frames=48, preset=preset, env=SimpleNamespace(share=0.0), model=model, _collect=collected,
        _learn=lambda: takes(2.0), check_finite=lambda: None,
    )  # fmt: skip
    assert learner.Learner.update(part) == {"reward": pytest.approx(0.5 / (1.0 - preset.discount)), "std": 0.25}  # type: ignore[arg-type]
    assert seconds == {"environment": 5.0, "rollout policy": 13.0, "update": 22.0}
    assert part.env.share == 48 / preset.steps
    timed = SimpleNamespace(_env=SimpleNamespace(step_wait=lambda: takes(6.0)), seconds=seconds)
    learner.Timed.step_wait(timed)  # type: ignore[arg-type]
    assert seconds["environment"] == 11.0

    def lessons(*_: Any) -> Iterator[int]:
        for frames in (10, 20):
            learner.Timed.step_wait(timed)  # type: ignore[arg-type]
            yield frames

    monkeypatch.setattr(learner, "teach", lessons)
    ppo = SimpleNamespace(_setup_learn=lambda *_: (0, None), num_timesteps=0)
    pupil = SimpleNamespace(preset=preset, seed=0, env=None, ppo=ppo, seconds=seconds, _timed=timed)
    assert list(learner.PpoLearner.teach(pupil)) == [10, 20]  # type: ignore[arg-type]
    assert (seconds["imitation"], seconds["environment"], ppo.num_timesteps) == (12.0, 11.0, 20)
    assert timed.seconds is seconds


@pytest.mark.parametrize(("patience", "validations"), [(1, 2), (2, 3), (3, 6), (0, 6)])
def test_patience_counts_validations_since_the_best(
    patience: int, validations: int, tmp_path: Path, told: Told
) -> None:
    told.scores[:] = [0.5, 0.4, 0.3, 0.6, 0.1, 0.0] if patience == 3 else [0.5, 0.4, 0.3, 0.2, 0.1, 0.0]
    reports, last = went(began(tmp_path, preset_of(steps=UPDATE * 12, validations=6, patience=patience)))
    assert len(told.asked) == validations
    assert last.done
    assert last.frames == 2 * validations * UPDATE == reports[-1].frames


# What is told and drawn.


ROW = {"success": 0.756, "collision": 0.032, "error": 7.25678, "return": 12.345, "frames": 960.0}


@pytest.mark.parametrize("task", TASKS)
def test_a_run_is_told_in_a_line(task: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    preset = next(each for each in PRESETS.values() if each.task == task)
    jobs = [Job(PATH, preset, (), k, tmp_path / f"seed_{k}") for k in range(5)]
    seconds = {"imitation": 0.0, "environment": 3.0, "update": 1.0, "validation": 4.0}
    reports = [
        Report(0, 8_000, 9_000, ROW, seconds, done=True),
        Report(1, 5_000, 9_000, None, seconds, stopped=15),
        Report(2, 0, 9_000, error="out of memory"),
        Report(3, 0, 9_000),
        Report(4, 400, 9_000, None, {"validation": 2.0}, stopped=2),
    ]
    cost = {"path_following": "left 3%, RMS error 7.2568 m"}.get(task, "collided 3%, time 7.3 s")
    found = f"success 76%, {cost}, return 12.3"
    lines = [
        f"seed 0: done; 2,000 frames/s (environment 38%, update 12%, validation 50%); last validation: {found}; "
        f"{tmp_path / 'seed_0' / 'best'}",
        "seed 1: stopped, go on with --resume; 1,250 frames/s (environment 38%, update 12%, validation 50%); "
        f"last validation: no validation yet; {tmp_path / 'seed_1' / 'best'}",
        f"seed 3: stopped, go on with --resume; nothing (); last validation: no validation yet; "
        f"{tmp_path / 'seed_3' / 'best'}",
        "seed 4: stopped, go on with --resume; nothing (validation 100%); last validation: no validation yet; "
        f"{tmp_path / 'seed_4' / 'best'}",
    ]
    assert command._told(jobs, reports, preset) == 130  # that of the last that a signal stopped
    said = capsys.readouterr()
    assert said.out.splitlines() == lines
    assert said.err == "seed 2: out of memory\n"
    assert command._told(jobs[:3], reports[:3], preset) == 143
    assert command._told(jobs[2:4], reports[2:4], preset) == 1
    assert command._told(jobs[:1], reports[:1], preset) == 0


def test_a_command_asks_for_a_run_a_seed_and_shares_the_cores_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[tuple[list[Job], int]] = []
    drawn: list[Any] = []

    def trained(jobs: list[Job], at_once: int) -> list[Report]:
        asked.append((jobs, at_once))
        for job in jobs[:2]:  # the others have not come to a validation
            checkpoints.write_run(job.folder, job.described())
            (job.folder / CURVE).touch()
        return [Report(job.seed, 10, 10, done=True) for job in jobs]

    def train(*words: str) -> click.testing.Result:
        return click.testing.CliRunner().invoke(command.main, [PATH, *words])

    cluster = [False]
    monkeypatch.setattr(command, "_trained", trained)
    monkeypatch.setattr(command, "draw_curves", lambda *told: drawn.append(told))
    monkeypatch.setattr(command, "cluster_given", lambda: cluster[0])
    monkeypatch.setattr(command.os, "sched_getaffinity", lambda process: set(range(7)), raising=False)
    monkeypatch.chdir(tmp_path)
    words = ("--set", "clip=0.15", "--steps", "600000", "--robot", "p3dx")
    for seeds, threads, at_once, far in ((1, 7, 1, False), (2, 3, 2, False), (9, 1, 7, False), (2, 1, 2, True)):
        cluster[0] = far
        out = tmp_path / f"{seeds}_{far}"
        done = train(*words, "--seed", "4", "--seeds", str(seeds), "--out", str(out))
        assert done.exit_code == 0, done.output
        jobs, together = asked.pop()
        assert together == at_once
        assert [job.seed for job in jobs] == list(range(4, 4 + seeds))
        for job in jobs:
            assert (job.env_id, job.folder, job.threads, job.resume) == (PATH, out / f"seed_{job.seed}", threads, False)
            assert job.settings == ("clip=0.15", "steps=600000", "robot=p3dx")  # in which the later one counts
            assert (job.preset.name, job.preset.clip, job.preset.steps) == ("path_following", 0.15, 600_000)
            assert job.preset.robot == "p3dx"
        ((folders, task, file, title),) = drawn
        assert folders == [out / "seed_4", out / "seed_5"][:seeds]
        assert (task, file.parent, PATH in title, "path_following" in title) == ("path_following", out, True, True)
        drawn.clear()
    # what was begun goes on, what was not begins
    out = tmp_path / "2_False"
    assert train(*words, "--seed", "4", "--seeds", "3", "--out", str(out), "--resume").exit_code == 0
    assert [(job.seed, job.resume) for job in asked.pop()[0]] == [(4, True), (5, True), (6, False)]
    for more, said in ((("--seed", "4"), "holds a run"), (("--seed", "7", "--resume"), "holds no run to resume")):
        refused = train(*words, *more, "--out", str(out))
        assert (refused.exit_code, said in refused.output) == (2, True), refused.output
    assert train("--preset", "path_following_plain").exit_code == 0
    assert asked.pop()[0][0].folder == Path("results/training/path_following_plain/seed_0")
    for error, status, said in (
        (OSError(errno.ENOSPC, "no room"), 1, "the disk is full"),
        (FloatingPointError("it diverged"), 1, "it diverged"),
        (ValueError("it is damaged"), 2, "it is damaged"),
    ):
        monkeypatch.setattr(command, "_trained", lambda *_, error=error: (_ for _ in ()).throw(error))
        failed = train("--out", str(tmp_path / "none"))
        assert (failed.exit_code, said in failed.output, len(failed.output.splitlines())) == (status, True, 1)


def test_where_nobody_looks_a_line_is_printed_a_validation_or_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    clock = [100.0]
    monkeypatch.setattr(command.time, "monotonic", lambda: clock[0])
    preset = preset_of()
    jobs = [Job(PATH, preset, (), k, tmp_path / f"seed_{k}") for k in (3, 4)]
    at: list[tuple[float, Report]] = [
        (101.0, Report(3, 96, 672, note="going on from the save before it")),
        (105.0, Report(3, 192, 672, ROW | {"frames": 192.0}, note="going on from the save before it")),
        (106.0, Report(3, 288, 672, ROW | {"frames": 192.0})),  # the same again
        (131.0, Report(4, 96, 672)),
        (134.9, Report(3, 384, 672)),
        (135.1, Report(3, 1_480, 1_672)),
        (136.0, Report(4, 192, 672)),
        (166.5, Report(3, 576, 672)),
    ]

    def trained(given: Any, at_once: int, report: Any) -> list[Report]:
        assert (given, at_once) == (jobs, 2)
        for now, each in at:
            clock[0] = now
            report(each)
        return [each for _, each in at[-2:]]

    monkeypatch.setattr(command, "train_all", trained)
    assert command._trained(jobs, 2) == [at[-2][1], at[-1][1]]
    said = capsys.readouterr()
    assert said.out == ""
    assert [line for line in said.err.splitlines() if "note" not in line] == [
        "seed 3: going on from the save before it",
        "seed 3: 192 of 672 frames, 5 s; success 76%, left 3%, RMS error 7.2568 m, return 12.3",
        "seed 4: 96 of 672 frames, 31 s",
        "seed 3: 1,480 of 1,672 frames, 35 s",
        "seed 3: 576 of 672 frames, 66 s",
    ]


def test_where_a_cluster_is_given_the_runs_are_trained_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    jobs, asked = [Job(PATH, preset_of(), (), 0, tmp_path)], []

    @contextlib.contextmanager
    def shared_out(at_once: int) -> Iterator[str]:
        asked.append(at_once)
        yield "engine"

    monkeypatch.setattr(command, "shared_out", shared_out)
    monkeypatch.setattr(command, "train_far", lambda engine, given, show: [engine, given, callable(show)])
    monkeypatch.setattr(command, "train_all", lambda given, at_once, show: [given, at_once, callable(show)])
    for given, found in ((False, [jobs, 3, True]), (True, ["engine", jobs, True])):
        monkeypatch.setattr(command, "cluster_given", lambda given=given: given)
        assert command._trained(jobs, 3) == found
    assert asked == [3]


def test_curves_are_drawn_over_millions_of_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Any] = []

    class Figure(matplotlib.figure.Figure):
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            figures.append(self)

    monkeypatch.setattr(matplotlib.figure, "Figure", Figure)
    names = ["frames", "success", "collision", "error", "p95"]
    rng = np.random.default_rng(3)
    folders = []
    for k in (0, 7):
        folders.append(tmp_path / f"seed_{k}")
        folders[-1].mkdir()
        numbers = np.column_stack([1e5 * np.arange(1.0, 4.0), rng.random((3, 4))])
        text = [",".join(names), *(",".join(map(str, row)) for row in numbers.tolist())]
        (folders[-1] / CURVE).write_text("\n".join(text) + "\n")
    shown = {
        "path_following": [("success", "success"), ("error", "cross-track RMS, IQM (m)"),
                           ("p95", "its 95th percentile (m)")],
        "docking": [("success", "success"), ("collision", "collisions"), ("error", "time to the goal, IQM (s)")],
    }  # fmt: skip
    for task, panels in shown.items():
        file = tmp_path / f"{task}.png"
        draw_curves(folders, task, file, "as it went")
        assert file.read_bytes().startswith(b"\x89PNG")
        figure = figures.pop()
        assert figure.get_suptitle() == "as it went"
        for (column, label), axis in zip(panels, figure.axes, strict=True):
            assert (axis.get_xlabel(), axis.get_ylabel()) == ("million frames", label)
            assert axis.get_yscale() == ("log" if task == "path_following" and column != "success" else "linear")
            share = column in ("success", "collision")
            assert (axis.get_ylim() == (-0.02, 1.02)) == share
            assert [each.get_label() for each in axis.lines] == ["seed_0", "seed_7"]
            for folder, line in zip(folders, axis.lines, strict=True):
                rows = np.genfromtxt(folder / CURVE, delimiter=",", names=True)
                np.testing.assert_allclose(line.get_xdata(), rows["frames"] / 1e6)
                np.testing.assert_allclose(line.get_ydata(), rows[column])
        assert [axis.get_legend() is None for axis in figure.axes] == [False, True, True]


def test_a_folder_that_holds_something_else_is_refused(tmp_path: Path) -> None:
    def refused(what: str) -> None:
        with pytest.raises(ValueError, match=what):
            command.check_out(tmp_path / "out")

    command.check_out(tmp_path / "out" / "deeper")
    (tmp_path / "out").mkdir()
    command.check_out(tmp_path / "out")
    (tmp_path / "out" / ".lock").touch()
    (tmp_path / "out" / "seed_12").mkdir()
    command.check_out(tmp_path / "out")  # begun, and no run in it yet
    for other in ("curves.png", "seed_1a", "my_seed_1"):
        (tmp_path / "out" / other).touch()
        refused("not empty and holds no training runs")
        (tmp_path / "out" / "seed_12" / RUN).touch()
        command.check_out(tmp_path / "out")  # what lies beside runs is theirs
        (tmp_path / "out" / "seed_12" / RUN).unlink()
        (tmp_path / "out" / other).unlink()
    (tmp_path / "out" / "seed_12").rmdir()
    (tmp_path / "out" / ".lock").unlink()
    (tmp_path / "out").rmdir()
    (tmp_path / "out").touch()
    refused("is a file")
    with pytest.raises(ValueError, match="is a file"):
        command.check_out(tmp_path / "out" / "deeper")


@pytest.mark.parametrize("lacking", [os.W_OK, os.X_OK, 0])
def test_a_folder_that_may_not_be_written_in_is_refused_before_the_run(
    lacking: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether it is there, or would have to be made in one that is."""
    asked = []

    def access(path: Path, mode: int) -> bool:  # the administrator may do all
        asked.append(path)
        return not mode & lacking

    monkeypatch.setattr(command.os, "access", access)
    for folder in (tmp_path, tmp_path / "new" / "deeper"):
        if lacking:
            with pytest.raises(ValueError, match=f"cannot be written: no permission in {re.escape(str(tmp_path))}$"):
                command.check_out(folder)
        else:
            command.check_out(folder)
    assert asked == [tmp_path, tmp_path]


# Measured, and in slices.


def test_a_card_is_measured_anew_and_nothing_else_of_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    preset = preset_of(steps=UPDATE)
    went(began(tmp_path, preset))
    before = load_agent(tmp_path / BEST)
    told.asked.clear()
    told.scores = [each - 0.25 for each in told.scores]  # told a speed, it does otherwise
    monkeypatch.setattr(measured, "validate", told)
    monkeypatch.setattr(measured, "cruises", lambda agent: {"lagged": [[0.4, 0.39]]})
    done = click.testing.CliRunner().invoke(measured.main, [str(tmp_path / BEST)])
    assert done.exit_code == 0, done.output
    card = load_agent(tmp_path / BEST).card
    base = dict(preset.validation)
    clock, value = TASKS["path_following"].clock, float(before.network.numbers[0])
    asked = [(0.6, base), (0.6, base | {"actuators": "slow"}), (1.05, base)]
    assert told.asked == [(speed, PATH, kwargs, clock, value) for speed, kwargs in asked]
    scores = [dataclasses.asdict(score_of(k, told.scores)) for k in range(3)]
    assert card["cruises"] == {"lagged": [[0.4, 0.39]]}
    assert card["validation"] == {
        **{name: each for name, each in scores[0].items() if name != "reward"}, "return": scores[0]["reward"],
    }  # fmt: skip
    assert card["measured"] == [
        {"asked_speed": speed, "env_kwargs": kwargs, **score}
        for (speed, kwargs), score in zip(asked[1:], scores[1:], strict=True)
    ]
    changed = {"cruises", "validation", "measured", "digest", "format", "sha256"}
    assert {k: v for k, v in card.items() if k not in changed} == {
        k: v for k, v in before.card.items() if k not in changed
    }
    place = "all/validation"
    assert done.output == f"{tmp_path / BEST}: {place} slow 0.6 m/s: 89 %, {place} lagged 1.05 m/s: 88 %\n"


@pytest.mark.parametrize("task", ["goal_reaching", "docking"])
def test_who_follows_no_path_is_measured_at_the_speed_that_it_is_told(
    task: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its mean speed is none that it was asked to hold: no cruises, and its validation is that of its training."""
    asked: list[tuple[float, dict[str, Any]]] = []

    def validated(agent: Any, env_id: str, kwargs: Any, clock: int) -> Score:
        assert (env_id, clock) == (before.card["env_id"], TASKS[task].clock)
        asked.append((agent.speed, dict(kwargs)))
        return score_of(len(asked), [0.5])

    folder = shutil.copytree(shipped(task, "p3dx")[0], tmp_path / BEST)
    before = load_agent(folder)
    monkeypatch.setattr(measured, "validate", validated)
    monkeypatch.setattr(measured, "cruises", lambda agent: {"lagged": [[0.4, 0.39]]})
    done = click.testing.CliRunner().invoke(measured.main, [str(folder)])
    assert done.exit_code == 0, done.output
    card = load_agent(folder).card
    assert asked == measured.conditions(before)
    assert [(each["asked_speed"], each["env_kwargs"]) for each in card["measured"]] == asked
    assert [each["success"] for each in card["measured"]] == [0.9 - 0.01 * (k + 1) for k in range(len(asked))]
    changed = {"measured", "digest", "format"}
    assert {k: v for k, v in card.items() if k not in changed} == {
        k: v for k, v in before.card.items() if k not in changed
    }


def test_a_cruise_is_what_is_driven_where_nothing_is_known_of_it(monkeypatch: pytest.MonkeyPatch, told: Told) -> None:
    driven = {("lagged", 0.4): 0.38124, ("lagged", 0.6): 0.38119, ("lagged", 0.8): 0.7, ("slow", 0.4): 0.0,
              ("slow", 0.6): 0.5, ("slow", 0.8): 0.50004}  # fmt: skip
    asked = []

    def validated(agent: Any, env_id: str, kwargs: Any, clock: int, every: int) -> Any:
        assert "cruises" not in agent.card or agent.card["cruises"] == {}
        assert (env_id, kwargs["scenario"], kwargs["num_beams"]) == (PATH, "all/train", 9)
        assert (clock, every) == (TASKS["path_following"].clock, 16)
        asked.append((kwargs["actuators"], agent.speed))
        return SimpleNamespace(speed=driven[asked[-1]])

    monkeypatch.setattr(measured, "validate", validated)

    @dataclasses.dataclass(frozen=True)
    class Known:
        card: Any
        speed: float

    card = {
        "task": "path_following", "env_id": PATH, "cruises": {"lagged": [[0.4, 0.1]]},
        "env_kwargs": {"scenario": "all/validation", "actuators": "ideal", "num_beams": 9},
        "trained_on": {"actuators": ["lagged", "slow"], "speeds": [0.8, 0.4, 0.6]},
    }  # fmt: skip
    found = measured.cruises(Known(card, 0.6))  # type: ignore[arg-type]
    # a speed at which it is no faster than at a lower one is left out
    assert found == {"lagged": [[0.4, 0.3812], [0.8, 0.7]], "slow": [[0.6, 0.5]]}
    assert asked == sorted(driven)


def test_a_slice_goes_on_from_its_files_and_ends_behind_a_validation(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(slices.time, "monotonic", lambda: clock[0])
    seen: dict[str, Any] = {}

    def trained(job: Job, report: Any, signals: Any, asked: Any) -> Report:
        seen.update(job=job, there={each.name for each in job.folder.rglob("*")}, signals=tuple(signals))
        seen["asked"] = []
        for now, row in ((70.0, None), (30.0, ROW), (59.9, None), (60.0, None)):
            clock[0] = now
            report(Report(job.seed, 1, 2, row))
            seen["asked"].append(asked())
        job.folder.mkdir(exist_ok=True)
        for name in (LAST, RUN, LOCK, "best/card.json"):
            (job.folder / name).parent.mkdir(exist_ok=True)
            (job.folder / name).write_text(name)
        return Report(job.seed, 5, 9, ROW)

    monkeypatch.setattr(slices, "train", trained)
    job = Job(PATH, preset_of(), (), 8, Path("far away"))
    last, files = slices.train_slice(slices.Slice(job, {}, 60.0))
    assert seen["asked"] == [False, False, False, True]
    assert (seen["job"].resume, seen["job"].folder.name, seen["signals"], seen["there"]) == (False, "seed_8", (), set())
    assert last == Report(8, 5, 9, ROW)
    # the state comes last to be written and first to be told, the lock stays
    assert list(files) == [LAST, "best/card.json", RUN]
    assert files["best/card.json"] == b"best/card.json"
    clock[0] = 0.0
    own = dataclasses.replace(job, preset=dataclasses.replace(job.preset, robot="p3dx"))
    object.__setattr__(own.preset, "robot", "/not/here/mine.json")
    monkeypatch.setattr(Preset, "__post_init__", lambda preset: None)
    slices.train_slice(slices.Slice(own, files, 60.0, b"a sheet"))
    assert (seen["job"].resume, Path(seen["job"].preset.robot).name) == (True, "mine.json")
    assert seen["there"] == {LAST, "best", CARD, RUN}
    assert str(slices.Slice(job, {}, 1.0)) == "seed 8"


def test_runs_take_turns_and_what_came_back_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ends = {0: 3, 1: 1, 2: 2}
    written: list[str] = []
    write_whole = slices.write_whole
    monkeypatch.setattr(
        slices, "write_whole", lambda file, content: (written.append(file.name), write_whole(file, content))
    )
    jobs = [Job(PATH, preset_of(), (), k, tmp_path / f"seed_{k}") for k in ends]
    turns: list[int] = []
    told: list[Report] = []

    class Engine:
        def as_done(self, function: Any, pieces: Any) -> Iterator[Any]:
            assert function is slices.train_slice
            for k, piece in enumerate(pieces):
                seed, was = piece.job.seed, piece.files.get("count", b"")
                turns.append(seed)
                assert (piece.seconds, piece.sheet) == (9.0, None)
                assert list(piece.files) == (["count", "best/card.json"] if was else [])
                files = {"count": was + b"x", "best/card.json": b"card"}
                yield k, (Report(seed, len(was) + 1, 7, done=len(was) + 1 == ends[seed]), files)

    last = slices.train_far(Engine(), jobs, told.append, 9.0)  # type: ignore[arg-type]
    assert turns == [0, 1, 2, 0, 2, 0]
    assert [(each.seed, each.frames, each.done) for each in last] == [(0, 3, True), (1, 1, True), (2, 2, True)]
    assert [each.seed for each in told] == turns
    # as they came: the state before what follows from it, so that it is never behind that
    assert written == ["count", "card.json"] * len(turns)
    for k, count in ends.items():
        assert (tmp_path / f"seed_{k}" / "count").read_bytes() == b"x" * count
        assert (tmp_path / f"seed_{k}" / "best" / "card.json").read_bytes() == b"card"


def test_a_run_that_fails_says_so_and_the_others_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = [Job(PATH, preset_of(), (), k, tmp_path / f"seed_{k}") for k in (5, 6)]

    class Engine:
        def as_done(self, function: Any, pieces: Any) -> Iterator[Any]:
            first, second = next(pieces), next(pieces)
            yield 1, (Report(second.job.seed, 9, 9, done=True), {})
            raise Failed([(first, RuntimeError("it broke\n  twice"))], 2, 2)

    last = slices.train_far(Engine(), jobs, lambda report: None)  # type: ignore[arg-type]
    assert last == [Report(5, 0, jobs[0].preset.steps, error="it broke twice"), Report(6, 9, 9, done=True)]


def test_a_state_knows_itself_by_all_that_it_holds(tmp_path: Path) -> None:
    """By names, kinds, shapes and bytes of its arrays, and by its numbers."""
    arrays = {"a": np.arange(6.0, dtype=np.float32), "b": np.zeros(2, np.int64)}
    states = [
        (arrays, {"k": 1}), (arrays, {"k": 2}), ({"c": arrays["a"], "b": arrays["b"]}, {"k": 1}),
        (arrays | {"a": arrays["a"].reshape(2, 3)}, {"k": 1}), (arrays | {"a": arrays["a"].view(np.int32)}, {"k": 1}),
        (arrays | {"a": -arrays["a"]}, {"k": 1}), ({"a": arrays["a"]}, {"k": 1}),
    ]  # fmt: skip
    digests = {checkpoints._digest(each, json.dumps(numbers)) for each, numbers in states}
    assert len(digests) == len(states)
    assert checkpoints._digest(dict(reversed(arrays.items())), json.dumps({"k": 1})) in digests
    assert all(re.fullmatch("[0-9a-f]{64}", each) for each in digests)


# What is refused.


@dataclasses.dataclass(frozen=True)
class Gains:
    number: Any = 1.0


@pytest.mark.parametrize(
    ("bounds", "taken", "refused", "wanted"),
    [
        ({}, (-1e9, 0.0, 1e9), (-math.inf,), "a finite number"),
        ({"above": 0.0}, (1e-9, 1e9), (0.0, -1.0), "a finite number > 0"),
        ({"least": 0.5}, (0.5, 2.0), (0.49, math.inf), "a finite number >= 0.5"),
        ({"above": -1.0, "least": 3.0}, (3.0,), (-1.0, 2.9), "a finite number > -1"),
        ({"above": 0.0, "most": 1.0}, (1.0,), (0.0,), "a finite number > 0"),
        ({"least": 0.0, "finite": False}, (math.inf, 1e9), (-1.0, -math.inf), "a number >= 0"),
    ],
)
def test_a_gain_is_refused_beyond_its_bounds(bounds: Any, taken: Any, refused: Any, wanted: str) -> None:
    for each in taken:
        check_gain(Gains(each), "number", **bounds)
    for each in (*refused, math.nan, "1", None, True, 1j, 10**400):
        with pytest.raises(ValueError, match=f"Gains: number must be {re.escape(wanted)}, got"):
            check_gain(Gains(each), "number", **bounds)
    most = bounds.get("most", 1e9)
    with pytest.raises(ValueError, match=re.escape(f"Gains: number must be at most {most:g} in size, got ")):
        check_gain(Gains(1.001 * most), "number", **bounds)


def test_a_whole_number_is_refused_beyond_its_bounds() -> None:
    for bounds, taken, refused in (({}, (0, 10_000), (-1, 10_001)), ({"least": 2, "most": 5}, (2, 5), (1, 6))):
        for each in taken:
            check_whole(Gains(each), "number", **bounds)
        for each in (*refused, 2.5, "3", None, True):
            with pytest.raises(ValueError, match="Gains: number must be"):
                check_whole(Gains(each), "number", **bounds)
