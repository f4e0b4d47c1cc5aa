"""One training run: updates, validations, checkpoints; killed at any moment, it goes on from the last of them."""

import concurrent.futures
import contextlib
import dataclasses
import importlib.metadata
import math
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torch
from numpy.typing import NDArray
from torch.utils.tensorboard.writer import SummaryWriter

from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.tasks.specs import EVERY
from wayfield.policies.learned.agent import Agent, Network, rounded, save_agent, weights_digest
from wayfield.policies.learned.features_sheet import SHEET, numbers_of
from wayfield.policies.training import checkpoints
from wayfield.policies.training.imitation import frames_taught, up_to
from wayfield.policies.training.learner import Layers, Learner, PpoLearner
from wayfield.policies.training.measured import cruises, measurement
from wayfield.policies.training.presets import MOST_LESSONS, PRESETS, Preset
from wayfield.policies.training.sac import SacLearner
from wayfield.policies.training.validation import Score, finite, validate
from wayfield.system.checks import shown
from wayfield.system.storage import clear_stale, locked

LEARNERS: Mapping[str, type[Learner]] = {"ppo": PpoLearner, "sac": SacLearner}  # by the name of a preset's learner
ANY = {2: "differential drive", 3: "omni base"}  # by the number of twist components
USELESS = 0.05  # success, below which a clone is useless
WORTH = 0.5  # success of its teacher, from which it is the clone's fault
LESSONS = 2**19  # as the goal seekers' presets have
PACKAGES = ("wayfield", "gymnasium", "numpy", "numba", "torch", "stable-baselines3", "safetensors")


@dataclasses.dataclass(frozen=True)
class Plan:
    """What a run comes to in whole chunks, rollouts and updates."""

    taught: int  # frames of imitation
    updates: int  # after it
    unit: int  # frames of an update

    @property
    def frames(self) -> int:
        """Returns the frames of the run."""
        return self.taught + self.updates * self.unit


def plan_of(preset: Preset) -> Plan:
    """Returns the plan of a preset: so many updates that its `steps` are reached, and passed by less than one.

    A preset with the number of steps that it is listed with keeps the updates that the agents which ship had: an update
    more in some, for the frames that its imitation is longer by than asked were not counted.
    """
    worlds, learning, prior = preset.worlds, preset.learning, preset.prior
    unit, taught = preset.frames_per_update, 0
    if prior.imitation:
        taught = frames_taught(prior.imitation, worlds.num_envs, learning.horizon, not prior.begins)
    given = PRESETS.get(preset.name)
    listed = given is not None and _lengths(given) == _lengths(preset)
    rest = learning.steps - (prior.imitation if listed else taught)
    return Plan(taught, up_to(max(rest, 0), unit) // unit, unit)


def _lengths(preset: Preset) -> tuple[int, ...]:
    return preset.learning.steps, preset.prior.imitation, preset.worlds.num_envs, preset.learning.horizon


@dataclasses.dataclass(frozen=True)
class Job:
    """The settings of one run."""

    env_id: str
    preset: Preset  # with the settings in place
    settings: tuple[str, ...]
    seed: int
    folder: Path
    resume: bool = False
    threads: int = 1
    command: str = ""

    @property
    def plan(self) -> Plan:
        """Returns what the run comes to."""
        return plan_of(self.preset)

    def described(self) -> dict[str, Any]:
        """Returns the key of this run."""
        return {
            "env_id": self.env_id,
            "preset": self.preset.name,
            "settings": list(self.settings),
            "steps": self.preset.learning.steps,
            "seed": self.seed,
            **self.preset.worlds.sheet,
        }


@dataclasses.dataclass(frozen=True)
class Report:
    """How far a run is."""

    seed: int
    frames: int
    of: int  # frames, that it has when it is done
    row: Mapping[str, float] | None = None  # of the curve, after a validation
    seconds: Mapping[str, float] = dataclasses.field(default_factory=dict)
    done: bool = False
    stopped: int = 0  # the number of the signal that it was stopped by
    note: str = ""  # what the user should know of a run that goes on
    error: str = ""


def check_folder(job: Job) -> None:
    """Raises ValueError when the folder holds another run, or this one without --resume."""
    if job.folder.exists() and not job.folder.is_dir():
        raise ValueError(f"{job.folder} is no folder; choose another --out")
    there = checkpoints.read_run(job.folder)
    if there is None:
        # what begins with a dot is the lock, or what was left half-written
        if job.folder.exists() and any(not each.name.startswith(".") for each in job.folder.iterdir()):
            raise ValueError(f"{job.folder} is not empty and holds no training run; choose another --out")
        if job.resume:
            raise ValueError(f"{job.folder} holds no run to resume")
        return
    if not job.resume:
        raise ValueError(f"{job.folder} holds a run; continue it with --resume or choose another --out")
    for key, asked in job.described().items():
        had = there.get(key)
        if had != asked:
            if isinstance(had, list) and isinstance(asked, list) and sorted(map(str, had)) != sorted(asked):
                had, asked = (
                    [each for each in one if each not in other] for one, other in ((had, asked), (asked, had))
                )
            raise ValueError(
                f"{job.folder} holds a run with {key} {shown(had)}, not {shown(asked)}; it cannot be resumed so: give "
                "the words that it began with, or another --out"
            )


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Holds a run's folder while the block runs, and clears what dead processes left there half-written.

    A folder that is made for it goes again if no run begins in it.

    Raises:
        BlockingIOError: if another process trains in it.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with locked(folder / checkpoints.LOCK, f"{folder} is being written by another training; wait for it to end"):
            clear_stale(folder)
            yield
    finally:
        if made and not (folder / checkpoints.RUN).exists():
            with contextlib.suppress(OSError):
                (folder / checkpoints.LOCK).unlink(missing_ok=True)
                for each in made:
                    each.rmdir()


SIGNALS = (signal.SIGINT, signal.SIGTERM)


def train(
    job: Job,
    report: Callable[[Report], None],
    signals: Sequence[signal.Signals] = SIGNALS,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Report:
    """Runs a job to its end, or until Ctrl-C or SIGTERM, which save; returns the last report.

    Args:
        signals: those that save and end the run.
        stop_requested: returns whether another signal to stop was given.

    Raises:
        ValueError: if the folder holds another run, or files in it are damaged.
        FloatingPointError: if the training diverged; the last checkpoint stands.
        OSError: if a checkpoint cannot be written; the last one stands. BlockingIOError if another process holds the
            folder.
    """
    check_folder(job)
    torch.set_num_threads(job.threads)
    learner = LEARNERS[job.preset.learning.algorithm.name](
        job.preset, job.env_id, job.seed
    )  # refuses what cannot be before anything is written
    with held(job.folder):
        check_folder(job)
        run = _Run(job, learner)
        with interruptible(signals) as interrupted:
            last = run.go(report, lambda: interrupted.number > 0 or stop_requested())
    return last if last.done else dataclasses.replace(last, stopped=interrupted.number)


class _Begun(NamedTuple):
    """A validation that another thread is at."""

    layers: Layers
    row: dict[str, float]  # of the curve, as far as it is known
    logged: Mapping[str, float]
    state: checkpoints.State  # of the run, when it began
    outcome: concurrent.futures.Future[tuple[dict[str, Any], list[Score], list[dict[str, Any]]]]


class _Run:
    def __init__(self, job: Job, learner: Learner) -> None:
        self.job = job
        self.preset = preset = job.preset
        self.learner = learner
        state, self.note = checkpoints.last_state(job.folder) if job.resume else (None, "")
        self.updates = 0
        self.total = job.plan.updates
        self.interval = max(1, round(self.total / preset.learning.validations))
        self.rows: list[dict[str, float]] = []
        self.seconds = 0.0
        self._computed, self._began = 0.0, time.process_time()  # s, before this process took it up; when it did
        self.best: Layers = []
        self.best_row: dict[str, float] = {}
        self.measured: list[dict[str, Any]] = []  # of the best, in each condition
        self.cruises: dict[str, Any] = {}  # of the best
        self.kwargs = preset.env_kwargs(preset.worlds.validation)
        self.further = [(speed, preset.env_kwargs(kwargs)) for speed, kwargs in preset.worlds.conditions]
        self.clock = round(preset.worlds.size * EVERY[preset.worlds.task].clock)
        self._begun: _Begun | None = None
        self._beside = concurrent.futures.ThreadPoolExecutor(1)
        # patience decides by what was found, and SAC's replay buffer is too large to be copied
        self._waits = preset.learning.patience > 0 or preset.learning.algorithm.name == "sac"
        if state is not None:
            try:
                self._restore(*state)
            except (
                LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, StopIteration, ValueError,
            ) as error:  # fmt: skip
                raise ValueError(f"{job.folder / checkpoints.LAST} is damaged or of another run: {error}") from None
        elif not job.resume:
            checkpoints.write_run(
                job.folder, job.described() | {"command": job.command, "threads": job.threads, "versions": versions()}
            )
        purged = self.learner.frames + 1 if self.learner.frames else None  # what was cut off is drawn anew
        self.writer = SummaryWriter(str(job.folder / "tensorboard"), purge_step=purged)

    def go(self, report: Callable[[Report], None], interrupted: Callable[[], bool]) -> Report:
        if self.learner.teaching is not None:
            self._teach(report, interrupted)
        if self.learner.teaching is None and self.preset.prior.imitation and not self.rows:
            self._validate(dict.fromkeys(("reward", *self.learner.LOGGED), math.nan))  # what was taught may be the best
            self._settle()
            last = dataclasses.replace(self._report(self.rows[-1]), error=self._useless_clone())
            report(last)
            if last.error:
                self._close()
                return last
        while not (self.learner.teaching or self.updates >= self.total or interrupted() or self._given_up()):
            began = time.perf_counter()
            try:
                logged = self.learner.update()
            except FloatingPointError:
                self._settle()
                raise
            self.updates += 1
            self.seconds += time.perf_counter() - began
            if self.updates % self.interval == 0 or self.updates == self.total:
                self._settle(report)
                self._validate(logged)
            waits = self._waits or self.updates == self.total
            if self._begun and (waits or self._begun.outcome.done()):
                self._settle(report)
            else:
                report(self._report(None))
        self._settle()
        done = self.learner.teaching is None and (self.updates >= self.total or self._given_up())
        if not done:
            self._save(self._state())
        self._close()
        return dataclasses.replace(self._report(self.rows[-1] if self.rows else None), done=done)

    def _teach(self, report: Callable[[Report], None], interrupted: Callable[[], bool]) -> None:
        began = time.perf_counter()
        for _ in self.learner.teach():
            report(self._report(None))
            if interrupted():
                break
        self.learner.check_finite()
        self.seconds += time.perf_counter() - began

    def _close(self) -> None:
        self._beside.shutdown()
        self.writer.close()
        self.learner.env.close()

    def _useless_clone(self) -> str:
        """Returns a line that says that the clone hardly ever succeeds where its teacher does; "" if it is not so."""
        preset, prior, clone = self.preset, self.preset.prior, self.rows[-1]["success"]
        if clone >= USELESS or prior.begins:
            return ""
        teacher = preset.controller_at(preset.worlds.speed)
        there = validate(teacher, self.job.env_id, self.kwargs, self.clock).success
        if there < WORTH:
            return ""
        given = PRESETS.get(preset.name, preset).prior
        frames = given.imitation if given.imitation > prior.imitation else 2 * prior.imitation
        lessons = given.lessons if given.lessons > prior.lessons else max(2 * prior.lessons, LESSONS)
        return (
            f"stopped before PPO: the clone of {prior.controller} has {clone:.0%} success on "
            f"validation, {prior.controller} {there:.0%}; begin anew with --set imitation={frames} (now "
            f"{prior.imitation}) or --set lessons={min(lessons, MOST_LESSONS)} (now {prior.lessons}), or insist with "
            "--resume"
        )

    @property
    def cpu_seconds(self) -> float:
        """Returns the processor time that the run has taken so far, of all threads, s."""
        return self._computed + time.process_time() - self._began

    def _given_up(self) -> bool:
        """Returns whether the last `patience` validations brought nothing better."""
        patience = self.preset.learning.patience
        return bool(patience and self.rows and self.updates - self.best_row["updates"] >= patience * self.interval)

    def _report(self, row: Mapping[str, float] | None) -> Report:
        seconds = dict(self.learner.seconds)
        return Report(self.job.seed, self.learner.frames, self.job.plan.frames, row, seconds, note=self.note)

    def _validate(self, logged: Mapping[str, float]) -> None:
        """Begins a validation beside the updates that follow; `_settle` takes what it finds."""
        layers, preset = self.learner.layers(), self.preset
        network = Network.of(layers, preset.learning.activation)
        card = self._card(layers, {}, [], {})
        agent = Agent(network, preset.features, preset.actions, card, preset.worlds.speed, preset.base)
        row = {"frames": float(self.learner.frames), "updates": float(self.updates), "seconds": round(self.seconds, 1)}
        self._begun = _Begun(layers, row, logged, self._state(), self._beside.submit(self._measured, agent))

    def _measured(self, agent: Agent) -> tuple[dict[str, Any], list[Score], list[dict[str, Any]]]:
        """Returns how fast an agent drives, where that is asked, its scores, and those as a card has them."""
        result = cruises(agent) if self.preset.worlds.paced else {}
        agent = dataclasses.replace(agent, card={**agent.card, "cruises": result})
        scores, measured = [], []
        for speed, kwargs in ((self.preset.worlds.speed, self.kwargs), *self.further):
            scores.append(validate(dataclasses.replace(agent, speed=speed), self.job.env_id, kwargs, self.clock))
            measured.append(measurement(speed, kwargs, dataclasses.asdict(scores[-1])))
        return result, scores, measured

    def _settle(self, report: Callable[[Report], None] = lambda report: None) -> None:
        """Waits for the validation that was begun, if any, notes what it found, and saves the state of that time."""
        if self._begun is None:
            return
        (layers, row, logged, state, outcome), self._begun = self._begun, None
        began = time.perf_counter()
        result, scores, measured = outcome.result()
        took = time.perf_counter() - began
        self.learner.seconds["validation"] += took
        self.seconds += took
        score = dataclasses.replace(scores[0], score=sum(each.score for each in scores) / len(scores))
        row = row | dataclasses.asdict(score)
        row |= {name: logged[name] for name in self.learner.LOGGED if name in logged}
        row["return"], row["reward"] = score.reward, logged["reward"]
        if self.further:
            row |= {in_field(each): each["success"] for each in measured}
        self.rows.append(row)
        for name, value in row.items():
            self.writer.add_scalar(f"wayfield/{name}", value, int(row["frames"]))
        if not self.best or score.score > self.best_row["score"]:
            self.best, self.best_row, self.measured, self.cruises = layers, row, measured, result
        self._save(state)
        report(self._report(row))

    def _state(self) -> checkpoints.State:
        """Returns what decides how the run goes on, but for what validations found."""
        arrays, numbers = self.learner.state()
        return arrays, numbers | {"run_updates": self.updates}

    def _save(self, state: checkpoints.State) -> None:
        """Writes the state first: whatever else is cut off is written anew from it."""
        arrays, numbers = state
        for k, (weight, bias) in enumerate(self.best):
            arrays[f"best.{k}.weight"], arrays[f"best.{k}.bias"] = weight, bias
        numbers |= {
            "rows": self.rows,
            "best_row": self.best_row,
            "measured": self.measured,
            "cruises": self.cruises,
            "seconds": self.seconds,
            "cpu_seconds": self.cpu_seconds,
            "parts": self.learner.seconds,
        }
        checkpoints.write_state(self.job.folder, arrays, numbers)
        self._publish()

    def _publish(self) -> None:
        if self.rows:
            checkpoints.write_curve(self.job.folder, self.rows)
            best = rounded(self.best)
            card = self._card(best, self.best_row, self.measured, self.cruises)
            save_agent(self.job.folder / checkpoints.BEST, best, card)

    def _restore(self, arrays: dict[str, NDArray[Any]], numbers: dict[str, Any]) -> None:
        self.learner.restore(arrays, numbers)
        self.updates, self.rows, self.best_row = numbers["run_updates"], numbers["rows"], numbers["best_row"]
        self.measured, self.cruises = numbers["measured"], numbers.get("cruises", {})
        self.seconds, self._computed = numbers["seconds"], numbers.get("cpu_seconds", 0.0)
        self.learner.seconds.update(numbers["parts"])
        k = 0
        while f"best.{k}.weight" in arrays:
            self.best.append((arrays[f"best.{k}.weight"], arrays[f"best.{k}.bias"]))
            k += 1
        self._publish()

    def _card(
        self,
        layers: Layers,
        row: Mapping[str, float],
        measured: Sequence[Mapping[str, Any]],
        paces: Mapping[str, Any],
    ) -> dict[str, Any]:
        preset, task = self.preset, self.learner.env.worlds.task
        more: dict[str, Any] = {"cruises": dict(paces)} if paces else {}
        began: dict[str, Any] = {}
        if preset.prior.begins:
            began = {"began_as": f"{preset.prior.begins}, {preset.worlds.robot}, seed {self.job.seed}"}
        elif preset.prior.imitation:  # a controller that it adds to is its `base`, and teaches nothing
            began = {"taught_by": preset.prior.controller, "taught_with": preset.gains}
        name = f"{preset.name}, seed {self.job.seed}"
        return described_agent(preset, task, self.job.env_id, self.kwargs, name, layers) | {
            "training": {
                **self.job.described(),
                "algorithm": preset.learning.algorithm.name,
                **began,
                "command": self.job.command,
                "frames": int(row.get("frames", 0)),
                "seconds": row.get("seconds", 0.0),
                "run_frames": self.learner.frames,
                "run_seconds": round(self.seconds, 1),
                "run_cpu_seconds": round(self.cpu_seconds, 1),
                "versions": versions(),
            },
            "trained_on": trained_on(preset, self.learner.env.briefings),
            "validation": finite({name: value for name, value in row.items() if name in _SCORES}),
            "measured": list(measured),
            **more,
        }


def in_field(condition: Mapping[str, Any]) -> str:
    """Returns the column of a learning curve with the successes in a condition that was measured."""
    kwargs = condition["env_kwargs"]
    how = {True: ", seen", False: ", unseen", None: ""}[kwargs.get("visible")]
    return f"{checkpoints.IN_FIELD}{kwargs['scenario'].partition('/')[0]}, {condition['asked_speed']:g} m/s{how}"


def trained_on(preset: Preset, briefings: Sequence[Briefing] = ()) -> dict[str, Any]:
    """Returns what a network met in training: actuators, disturbances, requested speeds (m/s), beams, team sizes.

    Of drawn robots, in place of these, the least and the most of each number of SHEET.

    Args:
        briefings: of the parts of the worlds, needed where robots are drawn.
    """
    if preset.worlds.drawn:
        parts = preset.parts
        conditions = [numbers_of(each, pace) for each, (_, _, pace) in zip(briefings, parts, strict=True)]
        ranges = {
            name: [min(each[name] for each in conditions), max(each[name] for each in conditions)] for name in SHEET
        }
        noise = list(dict.fromkeys(str(kwargs["disturbance"]) for _, kwargs, _ in parts))
        return {"ranges": ranges, "robots": preset.worlds.drawn, "disturbances": noise}
    worlds = [preset.env_kwargs(kwargs) for _, kwargs in preset.worlds.shares]
    tiers = [str(kwargs.get("actuators", "ideal")) for kwargs in worlds]
    levels = [str(kwargs.get("disturbance", "none")) for kwargs in worlds]
    return ({"teams": preset.worlds.teams} if preset.worlds.teams else {}) | {
        "actuators": list(dict.fromkeys(tiers)),
        "disturbances": list(dict.fromkeys(levels)),
        "speeds": list(preset.worlds.paces),
        "beams": sorted({int(kwargs["num_beams"]) for kwargs in worlds if "num_beams" in kwargs}),
    }


_SCORES = {field.name for field in dataclasses.fields(Score)} - {"reward"} | {"return"}


def described_agent(
    preset: Preset, task: Any, env_id: str, kwargs: Mapping[str, Any], name: str, layers: Layers
) -> dict[str, Any]:
    """Returns what the card of an agent of a preset says of it, but for its training and validation."""
    return {
        "name": name,
        "env_id": env_id,
        "env_kwargs": dict(kwargs),
        "task": preset.worlds.task,
        "robots": [task.robot.name] if not preset.worlds.drawn else [f"any {ANY[len(task.robot.twist_axes)]}"],
        "sheets": {task.robot.name: task.robot.digest} if not preset.worlds.drawn else {},
        "dt": task.options.dt,
        "speed": preset.worlds.speed,
        "observation": list(preset.features.fields),
        "features": dataclasses.asdict(preset.features),
        "actions": dataclasses.asdict(preset.actions),
        **({} if preset.base is None else {"base": dataclasses.asdict(preset.base)}),
        "network": {
            "hidden": [len(bias) for _, bias in layers[:-1]],
            "activation": preset.learning.activation,
            "num_twist": len(task.robot.twist_axes),
            "parameters": sum(weight.size + bias.size for weight, bias in layers),
        },
        "sha256": weights_digest(layers),
    }


def versions() -> dict[str, str]:
    """Returns the versions of what a run rests on."""
    result = {"python": platform.python_version()}
    for package in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            result[package] = importlib.metadata.version(package)
    return result


class Interrupted:
    """The number of the signal that ends a run between two updates; 0 while there is none."""

    number = 0


@contextlib.contextmanager
def interruptible(signals: Sequence[signal.Signals] = SIGNALS) -> Iterator[Interrupted]:
    """Yields what signals tell, so that a run can end between two updates; a second signal cuts it off."""
    interrupted = Interrupted()
    if threading.current_thread() is not threading.main_thread():
        yield interrupted
        return

    def stop(number: int, frame: Any) -> None:
        if interrupted.number:
            raise KeyboardInterrupt
        interrupted.number = number

    before = {each: signal.signal(each, stop) for each in signals}
    try:
        yield interrupted
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
