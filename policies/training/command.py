"""The command line of training; `train.py` at the root runs it."""

import errno
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from wayfield.policies.training.checkpoints import BEST, CURVE
from wayfield.policies.training.curves import draw_curves
from wayfield.policies.training.presets import PRESETS, Preset, overridden, preset_for
from wayfield.policies.training.run import Job, Report, check_folder
from wayfield.policies.training.seeds import train_all


class _OneLine(click.Command):
    """A command whose every refusal is one line on stderr: status 2 for wrong input, 1 for the rest."""

    def main(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Runs the command and exits."""
        kwargs["standalone_mode"] = False
        try:
            status = super().main(*args, **kwargs)
        except click.ClickException as error:
            self._exit(error.exit_code, error.format_message())
        except (click.Abort, KeyboardInterrupt):
            self._exit(130, "interrupted twice; go on from the last save with --resume")
        except OSError as error:
            if error.errno == errno.ENOSPC:
                self._exit(1, "the disk is full; the last save stands, go on from it with --resume")
            self._exit(1, str(error))
        sys.exit(status if isinstance(status, int) else 0)

    def _exit(self, status: int, message: str) -> NoReturn:
        click.echo(f"train: {' '.join(message.split())}", err=True)
        sys.exit(status)


@click.command(cls=_OneLine, name="train.py")
@click.argument("env_id")
@click.option("--preset", "name", help=f"What is trained and how: {', '.join(PRESETS)}; default: the environment's.")
@click.option("--steps", type=int, help="Frames, in place of the preset's.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="The first seed.")
@click.option("--seeds", type=click.IntRange(min=1), default=1, show_default=True, help="Runs, side by side.")
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder; default: results/training/PRESET."
)
@click.option("--resume", is_flag=True, help="Go on with the runs in the folder.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="A value of the preset; may be repeated.")
def main(
    env_id: str,
    name: str | None,
    steps: int | None,
    seed: int,
    seeds: int,
    out: Path | None,
    resume: bool,
    settings: tuple[str, ...],
) -> int:
    """Trains an agent by PPO on ENV_ID, such as wayfield/DiffDrivePathFollowing-v0.

    In the folder: a folder seed_N for every seed, with best/ (the agent that did best on validation scenarios),
    last.safetensors (to go on from), curve.csv and tensorboard/; and curves.png of all seeds. Ctrl-C saves.
    """
    if steps is not None:
        settings = (*settings, f"steps={steps}")
    try:
        preset = overridden(preset_for(env_id, name), settings)
        folder = Path("results/training") / preset.name if out is None else out
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        command = shlex.join(["python", "train.py", *sys.argv[1:]])
        jobs = [
            Job(
                env_id,
                preset,
                settings,
                each,
                folder / f"seed_{each}",
                resume and (folder / f"seed_{each}").exists(),
                max(1, cores // seeds),
                command,
            )
            for each in range(seed, seed + seeds)
        ]
        if resume and not any(job.resume for job in jobs):
            raise ValueError(f"{folder} holds no run to resume")
        for job in jobs:
            check_folder(job)
        last = _trained(jobs, min(cores, seeds))
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    status = _told(jobs, last, preset)
    drawn = [job.folder for job in jobs if (job.folder / CURVE).exists()]
    if drawn:
        draw_curves(drawn, preset.task, folder / "curves.png", f"{env_id}, preset {preset.name}: validation")
    return status


def _trained(jobs: Sequence[Job], at_once: int) -> list[Report]:
    """Returns the last reports of the jobs, and shows how far they are."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    console = Console(stderr=True)
    with Progress(
        *columns,
        TimeRemainingColumn(),
        TextColumn("{task.fields[score]}"),
        console=console,
        disable=not console.is_terminal,
        transient=True,  # what is left is what `_told` says, or one line about what went wrong
    ) as bar:
        tasks = {job.seed: bar.add_task(f"seed {job.seed}", total=job.preset.steps, score="") for job in jobs}
        kind = jobs[0].preset.task

        def show(report: Report) -> None:
            fields: Any = {} if report.row is None else {"score": _scores(report.row, kind)}
            bar.update(tasks[report.seed], completed=report.frames, **fields)

        return train_all(jobs, at_once, show)


def _scores(row: Any, task: str) -> str:
    """Returns a validation in few words."""
    failed = "left" if task == "path_following" else "collided"
    error = f"error {100.0 * row['error']:.2f} cm" if task == "path_following" else f"time {row['error']:.1f} s"
    return f"success {row['success']:.0%}, {failed} {row['collision']:.0%}, {error}, return {row['return']:.1f}"


def _told(jobs: Sequence[Job], last: Sequence[Report], preset: Preset) -> int:
    """Prints how each run ended and where the time went; returns the exit status."""
    status = 0
    for job, report in zip(jobs, last, strict=True):
        if report.error:
            click.echo(f"seed {job.seed}: {report.error}", err=True)
            status = 1
            continue
        total = sum(report.seconds.values())
        shares = ", ".join(f"{name} {value / total:.0%}" for name, value in report.seconds.items() if value)
        training = total - report.seconds.get("validation", 0.0)
        speed = f"{report.frames / training:,.0f} frames/s" if training else "nothing"
        found = _scores(report.row, preset.task) if report.row else "no validation yet"
        end = "done" if report.done else "stopped, go on with --resume"
        click.echo(f"seed {job.seed}: {end}; {speed} ({shares}); last validation: {found}; {job.folder / BEST}")
    return status
