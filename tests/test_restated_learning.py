"""What a training counts, keeps, tells and draws, stated once more beside a learner of a few lines."""

import contextlib
import dataclasses
import json
import math
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click.testing
import matplotlib.figure
import numpy as np
import pytest

from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies.learned.agent import CARD, load_agent
from wayfield.policies.learned.perception import Perception
from wayfield.policies.policy import check_gain, check_whole
from wayfield.policies.training import checkpoints, command, measured, run, slices
from wayfield.policies.training.checkpoints import BEST, CURVE, LAST, LOCK, RUN
from wayfield.policies.training.curves import draw_curves
from wayfield.policies.training.presets import PRESETS, Preset
from wayfield.policies.training.run import Job, Report
from wayfield.policies.training.validation import Score

PATH, DOCK = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveDocking-v0"
UPDATE = 24 * 4  # frames


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
            "return": score.reward, "reward": math.nan if taught else 0.125 * done, "std": math.nan if taught else 0.025 * done,
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


@pytest.mark.parametrize(("patience", "validations"), [(1, 2), (2, 3), (3, 6), (0, 6)])
def test_patience_counts_validations_since_the_best(
    patience: int, validations: int, tmp_path: Path, told: Told
) -> None:
    told.scores[:] = [0.5, 0.4, 0.3, 0.6, 0.1, 0.0] if patience == 3 else [0.5, 0.4, 0.3, 0.2, 0.1, 0.0]
    reports, last = went(began(tmp_path, preset_of(steps=UPDATE * 12, validations=6, patience=patience)))
    assert len(told.asked) == validations
    assert last.done
    assert last.frames == 2 * validations * UPDATE == reports[-1].frames
