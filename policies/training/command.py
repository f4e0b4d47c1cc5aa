"""The command line of training; `train.py` at the root runs it."""

import errno
import math
import os
import re
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import rich.box
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from wayfield.envs.tasks.specs import EVERY, TaskSpec
from wayfield.policies.training.checkpoints import BEST, CURVE, RUN
from wayfield.policies.training.curves import draw_curves
from wayfield.policies.training.presets import PRESETS, Preset, overridden, preset_for, preset_ids, settable
from wayfield.policies.training.run import Job, Plan, Report, check_folder, held
from wayfield.policies.training.seeds import train_all
from wayfield.policies.training.slices import train_far
from wayfield.system.checks import printable
from wayfield.system.command_line import SEED, OneLineErrors, cluster_given, command_given, on_cluster, say, shared_out
from wayfield.system.storage import clear_stale

MOST_SEEDS = 1000
CURVES = "curves.png"
_PAUSE = 30.0  # s, after which a line is printed where there is no terminal


class _Train(OneLineErrors):
    interrupted = "interrupted; where a run has saved, --resume goes on from there"


def _listed(env_id: str | None, name: str | None) -> None:
    """Prints what --set can change, with the defaults of a preset, or of the first of each task."""
    if env_id is None and name is not None:
        env_id = PRESETS[name].worlds.env_ids[0] if name in PRESETS else ""
    tasks = {preset.worlds.task: preset for preset in reversed(PRESETS.values())}
    try:
        presets = [preset_for(env_id, name)] if env_id is not None else list(reversed(tasks.values()))
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    console = Console(width=shutil.get_terminal_size().columns)  # COLUMNS, the terminal's, or 80
    for preset in presets:
        title = f"--set KEY=VALUE of preset {preset.name}, for {', '.join(preset.worlds.env_ids)}"
        table = Table(title=title, title_justify="left", box=rich.box.SIMPLE_HEAD, pad_edge=False)
        for header in ("key", "default", "range", "what it is"):
            table.add_column(header, no_wrap=header == "key", overflow="fold")
        for key, each in settable(preset).items():
            meaning = ", ".join(filter(None, (each.unit.strip("1"), each.meaning)))
            table.add_row(key, _setting(each.default), each.range, meaning)
        with console.capture() as capture:
            console.print(table)
        click.echo("\n".join(line.rstrip() for line in capture.get().splitlines()))


def _setting(value: Any) -> str:
    """Returns a value as `--set` takes it."""
    if isinstance(value, tuple):
        return ",".join(map(_setting, value)) or "empty"
    if value is None or isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return str(value) or "empty"


@click.command(cls=_Train, name="train")
@click.argument("env_id", required=False)
@click.option(
    "--preset", "name", help=f"Task, reward and algorithm: {', '.join(PRESETS)}; default: that of the environment."
)
@click.option("--robot", metavar="NAME|FILE.json", help="Robot, instead of the preset's.")
@click.option("--steps", type=int, help="Training steps, instead of the preset's.")
@click.option("--seed", type=SEED, default=0, show_default=True, help="First training seed.")
@click.option(
    "--seeds",
    type=click.IntRange(1, MOST_SEEDS),
    default=1,
    show_default=True,
    help="Number of training seeds, run in parallel.",
)
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder to write; default: results/training/PRESET."
)
@click.option("--resume", is_flag=True, help="Continue the runs in the folder.")
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Change a setting of the preset; may be repeated."
)
@click.option("--settings", "listing", is_flag=True, help="List the keys of --set with defaults and ranges, and exit.")
@on_cluster
def main(
    env_id: str | None,
    name: str | None,
    robot: str | None,
    steps: int | None,
    seed: int,
    seeds: int,
    out: Path | None,
    resume: bool,
    settings: tuple[str, ...],
    listing: bool,
) -> None:
    """Trains an agent on ENV_ID, such as wayfield/DiffDrivePathFollowing-v0, by PPO or the algorithm of its preset.

    It writes curves.png and, for each seed, a folder seed_N with best/ (the agent that did best in validation),
    last.safetensors and previous.safetensors (to continue from), curve.csv and tensorboard/. You can stop it with
    Ctrl-C or SIGTERM and continue with --resume.
    """
    if f"wayfield/{env_id}" in preset_ids():
        env_id = f"wayfield/{env_id}"
    if listing:
        _listed(env_id, name)
        return
    if env_id is None:
        of = PRESETS[name].worlds.env_ids if name in PRESETS else ("wayfield/DiffDrivePathFollowing-v0",)
        raise click.UsageError(f"ENV_ID is missing, such as {' or '.join(of)}")
    try:
        preset = preset_for(env_id, name)
        scaled = _scaled(preset, settings, steps)
        if steps is not None:
            settings = (*settings, f"steps={steps}", *scaled)
        if robot is not None:
            settings = (*settings, f"robot={robot}")
        given, preset = preset.prior.imitation, overridden(preset, settings)
        folder = Path("results/training") / preset.name if out is None else out
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        command = command_given("python train.py")
        jobs = [
            Job(
                env_id,
                preset,
                settings,
                each,
                folder / f"seed_{each}",
                resume and (folder / f"seed_{each}" / RUN).exists(),
                1 if cluster_given() else max(1, cores // seeds),
                command,
            )
            for each in range(seed, seed + seeds)
        ]
        if resume and not any(job.resume for job in jobs):
            raise ValueError(f"{folder} holds no run to resume")
        check_out(folder)
        for job in jobs:
            check_folder(job)
            if job.folder.exists():
                with held(job.folder):  # or say at once that another process does
                    pass
        click.echo(f"train: {_planned(jobs[0].plan, preset, given if scaled else 0)}", err=True)
        last = _trained(jobs, min(cores, seeds))
        drawn = [job.folder for job in jobs if (job.folder / CURVE).exists()]
        if drawn:
            clear_stale(folder)
            draw_curves(drawn, preset.worlds.task, folder / CURVES, f"{env_id}, preset {preset.name}: validation")
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except FloatingPointError as error:
        raise click.ClickException(str(error)) from None
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        raise click.ClickException("the disk is full; what was saved before stands, --resume goes on from it") from None
    sys.exit(_reported(jobs, last, preset))


def _scaled(preset: Preset, settings: tuple[str, ...], steps: int | None) -> tuple[str, ...]:
    """Returns the setting that scales a preset's imitation with --steps; nothing where it is set, or there is none."""
    if steps is None or steps == preset.learning.steps or not preset.prior.imitation:
        return ()
    if any(each.startswith("imitation=") for each in settings):
        return ()
    return (f"imitation={round(preset.prior.imitation * steps / preset.learning.steps)}",)


def _planned(plan: Plan, preset: Preset, given: int) -> str:
    """Returns a line about the frames of a run; `given`: those of the imitation, if it was scaled."""
    updates = f"{plan.updates} update{'' if plan.updates == 1 else 's'} of {plan.unit:,}"
    retained = f" (scaled with --steps from {given:,}; --set imitation={given} keeps it)" if given else ""
    parts = f"{plan.taught:,} of imitation{retained} and {updates}" if plan.taught else updates
    rounded = "" if plan.frames == preset.learning.steps else f", for {preset.learning.steps:,} asked"
    return f"{plan.frames:,} frames{rounded}: {parts}"


def check_out(folder: Path) -> None:
    """Raises ValueError unless a folder can be made or written in, and is empty or holds training runs."""
    try:
        str(folder.absolute()).encode()
    except UnicodeEncodeError:  # TensorBoard's writer would fail on it later
        raise ValueError(
            f"--out {str(folder)!a} has characters that this locale cannot name; set PYTHONUTF8=1 or choose another"
        ) from None
    above = next(each for each in (folder.absolute(), *folder.absolute().parents) if os.path.lexists(each))
    if not above.is_dir():
        raise ValueError(f"--out {folder} cannot be a folder: {above} is a file")
    if not os.access(above, os.W_OK | os.X_OK):
        raise ValueError(f"--out {folder} cannot be written: no permission in {above}")
    if folder.exists():
        there = [each for each in folder.iterdir() if not each.name.startswith(".")]
        seeds = [each for each in there if re.fullmatch(r"seed_\d+", each.name)]
        # what lies beside runs is theirs, the figure that is drawn again; beside nothing it is somebody else's
        if len(there) > len(seeds) and not any((each / RUN).exists() for each in seeds):
            raise ValueError(f"--out {folder} is not empty and holds no training runs; choose another")


def _trained(jobs: Sequence[Job], at_once: int) -> list[Report]:
    """Returns the last reports of the jobs, and shows how far they are."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    console = Console(stderr=True)
    with Progress(
        *columns,
        TimeRemainingColumn(),
        TextColumn("{task.fields[score]}"),
        # older releases of rich end what is disabled with a blank line
        console=console if console.is_terminal else Console(quiet=True),
        disable=not console.is_terminal,
        transient=True,  # what is left is what `_reported` says, or one line about what went wrong
    ) as bar:
        tasks = {job.seed: bar.add_task(f"seed {job.seed}", total=job.plan.frames, score="") for job in jobs}
        task = EVERY[jobs[0].preset.worlds.task]

        noted = set()
        began = time.monotonic()
        printed = {job.seed: (began, 0.0) for job in jobs}  # when a line of a seed was, and its last validation

        def show(report: Report) -> None:
            if report.note and report.seed not in noted:
                noted.add(report.seed)
                console.print(
                    printable(f"seed {report.seed}: {report.note}"), markup=False, highlight=False, soft_wrap=True
                )
            fields: Any = {} if report.row is None else {"score": _scores(report.row, task)}
            bar.update(tasks[report.seed], completed=report.frames, **fields)
            if not console.is_terminal:  # which has no bar: a line a validation, and now and then before the first
                at, validated = printed[report.seed]
                reached = validated if report.row is None else report.row["frames"]
                if reached > validated or time.monotonic() - at > _PAUSE:
                    printed[report.seed] = time.monotonic(), reached
                    result = f"; {fields['score']}" if reached > validated else ""
                    far = f"{report.frames:,} of {report.of:,} frames, {time.monotonic() - began:.0f} s"
                    click.echo(f"seed {report.seed}: {far}{result}", err=True)

        if cluster_given():
            with shared_out(at_once) as executor:
                return train_far(executor, jobs, show)
        return train_all(jobs, at_once, show)


def _scores(row: Any, task: TaskSpec) -> str:
    """Returns a validation in few words."""
    cost = (
        "" if math.isnan(row["error"]) else f", {task.cost.name} {row['error']:.{task.cost.decimals}f} {task.cost.unit}"
    )
    if task.on_path and row["success"] < 1.0:  # it is a mean over all
        cost += f" (a failure counts as {task.cost.failure:g} {task.cost.unit})"
    return f"success {row['success']:.0%}, {task.failed} {row['collision']:.0%}{cost}, return {row['return']:.1f}"


def _reported(jobs: Sequence[Job], last: Sequence[Report], preset: Preset) -> int:
    """Prints how each run ended and where the time went; returns the exit status."""
    status = 0
    for job, report in zip(jobs, last, strict=True):
        if report.error:
            say(f"seed {job.seed}: {report.error}", err=True)
            status = status or 1
            continue
        if report.stopped:
            status = 128 + report.stopped
        if not (job.folder / RUN).exists():
            say(f"seed {job.seed}: stopped before it began; nothing was saved")
            continue
        total = sum(report.seconds.values())
        shares = ", ".join(f"{name} {value / total:.0%}" for name, value in report.seconds.items() if value)
        training = total - report.seconds.get("validation", 0.0)
        speed = f"{report.frames / training:,.0f} frames/s ({shares})" if training else "not begun"
        end = "done" if report.done else f"stopped at {report.frames:,} of {report.of:,} frames, go on with --resume"
        result, there = "no validation yet", job.folder
        if report.row:
            result, there = f"last validation: {_scores(report.row, EVERY[preset.worlds.task])}", job.folder / BEST
        say(f"seed {job.seed}: {end}; {speed}; {result}; {there}")
    return status
