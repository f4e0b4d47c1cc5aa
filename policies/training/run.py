"""One training run: updates, validations, checkpoints; killed at any moment, it goes on from the last of them."""

import contextlib
import dataclasses
import importlib.metadata
import math
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch.utils.tensorboard.writer import SummaryWriter

from wayfield.policies.agent import FORMAT, Agent, Network, save_agent, weights_digest
from wayfield.policies.training import checkpoints
from wayfield.policies.training.learner import Layers, Learner
from wayfield.policies.training.presets import Preset
from wayfield.policies.training.validation import Score, validate

PACKAGES = ("wayfield", "gymnasium", "numpy", "numba", "torch", "stable-baselines3", "safetensors")
VALIDATION_CLOCK = {"path_following": 2400, "goal_reaching": 1200}  # control periods, those of the contests


@dataclasses.dataclass(frozen=True)
class Job:
    """What one run is asked to do."""

    env_id: str
    preset: Preset  # with the settings in place
    settings: tuple[str, ...]
    seed: int
    folder: Path
    resume: bool = False
    threads: int = 1
    command: str = ""

    def described(self) -> dict[str, Any]:
        """Returns what tells this run from another."""
        return {
            "env_id": self.env_id,
            "preset": self.preset.name,
            "settings": list(self.settings),
            "steps": self.preset.steps,
            "seed": self.seed,
        }


@dataclasses.dataclass(frozen=True)
class Report:
    """How far a run is."""

    seed: int
    frames: int
    steps: int
    row: Mapping[str, float] | None = None  # of the curve, after a validation
    seconds: Mapping[str, float] = dataclasses.field(default_factory=dict)
    done: bool = False
    error: str = ""


def check_folder(job: Job) -> None:
    """Raises ValueError when the folder holds another run, or this one and it was not asked to be resumed."""
    there = checkpoints.read_run(job.folder)
    if there is None:
        if job.folder.exists() and any(job.folder.iterdir()):
            raise ValueError(f"{job.folder} is not empty and holds no training run; choose another --out")
        if job.resume:
            raise ValueError(f"{job.folder} holds no run to resume")
        return
    if not job.resume:
        raise ValueError(f"{job.folder} holds a run; continue it with --resume or choose another --out")
    for key, value in job.described().items():
        if there[key] != value:
            raise ValueError(
                f"{job.folder} holds a run with {key} {there[key]!r}, not {value!r}; it cannot be resumed so"
            )


def train(job: Job, report: Callable[[Report], None]) -> Report:
    """Runs a job to its end, or until Ctrl-C, which saves; returns the last report.

    Raises:
        ValueError: if the folder holds another run, or files in it are damaged.
        OSError: if a checkpoint cannot be written; the last one stands.
    """
    check_folder(job)
    torch.set_num_threads(job.threads)
    run = _Run(job)
    with interruptible() as interrupted:
        return run.go(report, interrupted)


class _Run:
    def __init__(self, job: Job) -> None:
        self.job = job
        self.preset = preset = job.preset
        state = checkpoints.read_state(job.folder) if job.resume else None
        self.learner = Learner(preset, job.env_id, job.seed)
        self.updates = 0
        self.total = math.ceil((preset.steps - preset.lessons) / (preset.num_envs * preset.horizon))
        self.interval = max(1, round(self.total / preset.validations))
        self.rows: list[dict[str, float]] = []
        self.seconds = 0.0
        self.best: Layers = []
        self.best_row: dict[str, float] = {}
        self.kwargs = dict(preset.validation) | ({} if preset.robot is None else {"robot": preset.robot})
        self.taught = state is not None or not preset.lessons
        if state is not None:
            try:
                self._restore(*state)
            except (KeyError, IndexError, TypeError, RuntimeError, StopIteration, ValueError) as error:
                raise ValueError(f"{job.folder / checkpoints.LAST} is damaged or of another run: {error}") from None
        elif not job.resume:
            checkpoints.write_run(
                job.folder, job.described() | {"command": job.command, "threads": job.threads, "versions": versions()}
            )
        purged = self.learner.frames + 1 if self.learner.frames else None  # what was cut off is drawn anew
        self.writer = SummaryWriter(str(job.folder / "tensorboard"), purge_step=purged)

    def go(self, report: Callable[[Report], None], interrupted: threading.Event) -> Report:
        if not self.taught:
            began = time.perf_counter()
            for frames in self.learner.teach():
                report(dataclasses.replace(self._report(None), frames=frames))
                if interrupted.is_set():  # lessons are short: they are given anew
                    self.writer.close()
                    return dataclasses.replace(self._report(None), frames=0)
            self.taught = True
            self.seconds = time.perf_counter() - began
        while self.updates < self.total and not interrupted.is_set() and not self._given_up():
            began = time.perf_counter()
            logged = self.learner.update()
            self.updates += 1
            self.seconds += time.perf_counter() - began
            if self.updates % self.interval == 0 or self.updates == self.total:
                self._validate(logged)
                self._save()
                report(self._report(self.rows[-1]))
            else:
                report(self._report(None))
        done = self.updates == self.total or self._given_up()
        if not done:
            self._save()
        self.writer.close()
        self.learner.env.close()
        return dataclasses.replace(self._report(self.rows[-1] if self.rows else None), done=done)

    def _given_up(self) -> bool:
        """Returns whether the last `patience` validations brought nothing better."""
        patience = self.preset.patience
        return bool(patience and self.rows and self.updates - self.best_row["updates"] >= patience * self.interval)

    def _report(self, row: Mapping[str, float] | None) -> Report:
        return Report(self.job.seed, self.learner.frames, self.preset.steps, row, dict(self.learner.seconds))

    def _validate(self, logged: Mapping[str, float]) -> None:
        began = time.perf_counter()
        layers = self.learner.layers()
        network = Network.of(layers, self.preset.activation)
        card = self._card(layers, {})
        preset = self.preset
        agent: Any = Agent(network, preset.features, preset.actions, card, preset.speed, preset.base)
        score = validate(agent, self.job.env_id, self.kwargs, VALIDATION_CLOCK[self.preset.task])
        took = time.perf_counter() - began
        self.learner.seconds["validation"] += took
        self.seconds += took
        row = {
            "frames": float(self.learner.frames),
            "updates": float(self.updates),
            "seconds": round(self.seconds, 1),
            **dataclasses.asdict(score),
            **{name: logged[name] for name in ("approx_kl", "std", "explained_variance") if name in logged},
        }
        row["return"], row["reward"] = score.reward, logged["reward"]
        self.rows.append(row)
        for name, value in row.items():
            self.writer.add_scalar(f"wayfield/{name}", value, self.learner.frames)
        if not self.best or score.score > self.best_row["score"]:
            self.best, self.best_row = layers, row

    def _save(self) -> None:
        """Writes the state first: whatever else is cut off is written anew from it."""
        arrays, numbers = self.learner.state()
        for k, (weight, bias) in enumerate(self.best):
            arrays[f"best.{k}.weight"], arrays[f"best.{k}.bias"] = weight, bias
        numbers |= {
            "run_updates": self.updates,
            "rows": self.rows,
            "best_row": self.best_row,
            "seconds": self.seconds,
            "parts": self.learner.seconds,
        }
        checkpoints.write_state(self.job.folder, arrays, numbers)
        self._publish()

    def _publish(self) -> None:
        if self.rows:
            checkpoints.write_curve(self.job.folder, self.rows)
            save_agent(self.job.folder / checkpoints.BEST, self.best, self._card(self.best, self.best_row))

    def _restore(self, arrays: dict[str, NDArray[Any]], numbers: dict[str, Any]) -> None:
        self.learner.restore(arrays, numbers)
        self.updates, self.rows, self.best_row = numbers["run_updates"], numbers["rows"], numbers["best_row"]
        self.seconds = numbers["seconds"]
        self.learner.seconds.update(numbers["parts"])
        k = 0
        while f"best.{k}.weight" in arrays:
            self.best.append((arrays[f"best.{k}.weight"], arrays[f"best.{k}.bias"]))
            k += 1
        self._publish()

    def _card(self, layers: Layers, row: Mapping[str, float]) -> dict[str, Any]:
        preset, task = self.preset, self.learner.env.worlds.task
        return {
            "format": FORMAT,
            "name": f"{preset.name}, seed {self.job.seed}",
            "env_id": self.job.env_id,
            "env_kwargs": self.kwargs,
            "task": preset.task,
            "robots": [task.robot.name],
            "dt": task.options.dt,
            "speed": preset.speed,
            "observation": list(preset.features.fields),
            "features": dataclasses.asdict(preset.features),
            "actions": dataclasses.asdict(preset.actions),
            **({} if preset.base is None else {"base": dataclasses.asdict(preset.base)}),
            "network": {
                "hidden": list(preset.hidden),
                "activation": preset.activation,
                "num_twist": len(task.robot.twist_axes),
                "parameters": sum(weight.size + bias.size for weight, bias in layers),
            },
            "sha256": weights_digest(layers),
            "training": {
                **self.job.described(),
                **({"taught_by": preset.controller, "taught_with": preset.gains} if preset.lessons else {}),
                "command": self.job.command,
                "frames": int(row.get("frames", 0)),
                "seconds": row.get("seconds", 0.0),
                "run_frames": self.learner.frames,
                "run_seconds": round(self.seconds, 1),
                "versions": versions(),
            },
            "validation": {
                name: None if math.isnan(value) else value for name, value in row.items() if name in _SCORES
            },
        }


_SCORES = {field.name for field in dataclasses.fields(Score)} - {"reward"} | {"return"}


def versions() -> dict[str, str]:
    """Returns the versions of what a run rests on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[package] = importlib.metadata.version(package)
    return found


@contextlib.contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Yields an event that Ctrl-C sets, so that a run can end between two updates; a second Ctrl-C cuts it off."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return

    def stop(number: int, frame: Any) -> None:
        if event.is_set():
            raise KeyboardInterrupt
        event.set()

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)
