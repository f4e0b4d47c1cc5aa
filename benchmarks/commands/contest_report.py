"""From the options of a contest to its files: parts are played, decisions are timed, tables and figures are made."""

import contextlib
import errno
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from wayfield.benchmarks.commands.contest_options import Options, WrongOption
from wayfield.benchmarks.contests import ALL_CONTESTS, Contest
from wayfield.benchmarks.contests.contest import left_out
from wayfield.benchmarks.leaderboards.leaderboard import contest_tables
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.progress import tracked
from wayfield.benchmarks.records.replays import write_drives
from wayfield.benchmarks.records.results import TABLE, read_rows, write_rows, write_trajectories
from wayfield.benchmarks.records.run_folder import REPORT, Run, held, staging
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.report.findings import finding_of
from wayfield.benchmarks.report.page import Section, write_page
from wayfield.benchmarks.report.worlds import write_worlds
from wayfield.benchmarks.runs.decisions import DECISIONS, Timing, measured, read_decisions, write_decisions
from wayfield.benchmarks.runs.prefetch import Prefetch
from wayfield.benchmarks.runs.shards import Part, clear_parts, drives_of, parts_of, run_contest
from wayfield.benchmarks.runs.suite import Setting
from wayfield.envs.robots import ROBOTS, Sensors
from wayfield.system.command_line import say
from wayfield.system.executors import Executor, Failed, workers

Short = list[tuple[str, Table]]  # of each task: the result as a sentence and a small table


def contest_report(options: Options, folder: Path, executor: Executor, count: int) -> tuple[list[Table], Short]:
    """Plays a contest by an executor, writes its files and its page into the folder; returns tables and what they say.

    Args:
        count: processes of this machine for what needs its files, where the executor has none of them.
    """
    settings = settings_of(options)
    tell_left_out(options, [ALL_CONTESTS[name] for name in options.contests])
    with contest_section(options, settings, folder, executor, count) as section:
        title = f"wayfield: {options.wanted}"
        return list(section.tables), write_page(section.folder / REPORT, title, [section], options.command)


def quick_report(options: Options, folder: Path, executor: Executor) -> Short:
    """Plays a contest and writes its files with one picture, without decision times or a page; returns what it says."""
    from wayfield.benchmarks.figures.contest_figures import draw_contest, wanted_figures  # which takes a second

    settings = settings_of(options)
    with holding(folder, options.run):
        parts = parts_of(settings, folder)
        with _stopped_in_a_line(parts), staging(folder, options.run) as stage:
            rows, trajectories = run_contest(settings, folder, executor)
            write_rows(stage, rows)
            write_trajectories(stage, trajectories)
            written = read_rows(stage)
            write_tables(stage, written, options.command, ladder=False)
            draw_contest(next(each for each in wanted_figures(stage, written, ladder=False) if "worst" in each))
        clear_parts(parts)
    return short_findings(written)


def short_findings(rows: Episodes) -> Short:
    """Returns the result of each contest in the rows of a run on one robot: a sentence and a small table."""
    findings = [
        finding_of(ALL_CONTESTS[name], rows["robot"][0], rows.where(contest=name)) for name in rows.unique("contest")
    ]
    return [(each.sentence, each.small) for each in findings]


def settings_of(options: Options) -> list[Setting]:
    """Returns every part of a contest's run, or says what is wrong with the options."""
    try:
        return options.settings()
    except WrongOption as error:
        raise click.UsageError(f"--{error}") from None
    except ValueError as error:  # a damaged split or agent, or a policy of the user's own that fails
        raise click.ClickException(str(error)) from None


def tell_left_out(options: Options, contests: Sequence[Contest]) -> None:
    """Says on stderr which entrants the robot leaves out, where none was named, and what of its sheet is not used."""
    robot = options.chosen_robot
    lines = [] if options.policies else list(left_out(contests, robot))
    scans = {
        (each.env_kwargs["num_beams"], each.env_kwargs["max_range"])
        for each in contests
        if "num_beams" in each.env_kwargs
    }
    sheet = robot.sensors.beams, robot.sensors.range
    if robot.name not in ROBOTS and sheet != (Sensors.beams, Sensors.range) and scans - {sheet}:
        used = " or ".join(f"{beams} beams to {most:g} m" for beams, most in sorted(scans))
        lines.append(f"sensors of robot {robot.name!r} are not used but for the angle; every robot here has {used}")
    for line in lines:
        say(f"evaluate: {line}", err=True)


@contextlib.contextmanager
def contest_section(
    options: Options, settings: Sequence[Setting], folder: Path, executor: Executor, count: int
) -> Iterator[Section]:
    """Plays a contest and writes its files where they are not in the folder yet; that is yielded, with the tables.

    Meanwhile its figures are drawn. Once the block has ended well they are waited for, and all moves into the folder.
    """
    from wayfield.benchmarks.figures.contest_figures import draw_contest, wanted_figures  # which takes a second

    run = options.run
    with holding(folder, run):
        parts = parts_of(settings, folder)
        with _stopped_in_a_line(parts), staging(folder, run) as stage, near(executor, count) as here:
            _play(options, settings, folder, stage, executor, here)
            rows = read_rows(stage)
            with drawing(here, draw_contest, wanted_figures(stage, rows, options.ladder)):
                tables = write_tables(stage, rows, options.command, options.ladder)
                yield Section(stage, tables, named=options.names or ())
        clear_parts(parts)


@contextlib.contextmanager
def _stopped_in_a_line(parts: Sequence[Part]) -> Iterator[None]:
    """Turns what ends a contest before its time into a line that says how many of its parts are kept."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        raise Interrupted("interrupted", parts) from None
    except Failed as error:
        raise Stopped(str(error), parts) from None
    except (OSError, MemoryError) as error:
        if isinstance(error, BrokenPipeError):
            raise
        full = isinstance(error, OSError) and error.errno == errno.ENOSPC
        raise Stopped("the disk is full" if full else str(error) or "out of memory", parts) from None
    except ValueError as error:  # a damaged agent, or a policy of the user's own that fails
        raise click.ClickException(str(error)) from None


@contextlib.contextmanager
def drawing(executor: Executor, draw: Callable[[Any], None], wanted: Sequence[Any]) -> Iterator[None]:
    """Has figures drawn while the block runs, where the executor can, and waits for them at its end."""
    if isinstance(executor, Prefetch):
        executor.begin(draw, wanted)
    yield
    for _ in tracked(executor(draw, wanted), len(wanted), "figures"):
        pass


@contextlib.contextmanager
def holding(folder: Path, run: Run) -> Iterator[None]:
    """Holds the folder of a run, or says why that cannot be."""
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(held(folder, run))
        except OSError as error:
            raise click.ClickException(f"--out {str(folder)!r} cannot be written: {error}") from None
        yield


def _play(
    options: Options, settings: Sequence[Setting], folder: Path, stage: Path, executor: Executor, here: Executor
) -> None:
    """Plays the parts of a contest and writes what they tell; decisions are timed by `here`, of this machine."""
    rows, trajectories = run_contest(settings, folder, executor)
    write_rows(stage, rows)
    write_trajectories(stage, trajectories)
    write_drives(stage, drives_of(parts_of(settings, folder)))
    write_worlds(stage, settings)
    if not options.ladder:
        if isinstance(executor, Prefetch):
            executor.settle()  # after the rest, alone on the machine
        for timings in here(_timed, [options.timed()]):  # by one that has driven: what drives is in its memory
            write_decisions(stage, timings)


def _timed(cases: Sequence[Case]) -> list[Timing]:
    return measured(cases, batches=(1,), rounds=2)


@contextlib.contextmanager
def near(executor: Executor, count: int) -> Iterator[Executor]:
    """Yields an executor whose workers have the files of this machine: the one that is there, or `count` processes."""
    if not executor.remote:
        yield executor
        return
    with workers(count) as here:
        yield here


class Stopped(click.ClickException):
    """The run ended before its time; what is finished is kept."""

    def __init__(self, why: str, parts: Sequence[Part]) -> None:
        done = sum(part.folder.is_dir() for part in parts)
        super().__init__(
            f"{why}; {done} of {len(parts)} parts are kept in {parts[0].folder.parent}: the same command goes on there"
        )


class Interrupted(Stopped):
    """The run was interrupted by a signal."""

    exit_code = 130


def write_tables(folder: Path, rows: Episodes, command: str, ladder: bool) -> list[Table]:
    """Writes the tables of a run into its folder, from its files; returns them."""
    timed = read_decisions(folder) if (folder / DECISIONS).is_file() else []
    tables = contest_tables(rows, timed, command, ladder)
    (folder / TABLE).write_text("\n".join(table.markdown() for table in tables.values()), encoding="utf-8")
    for name, table in tables.items():
        (folder / f"{name}.csv").write_text(table.csv(), encoding="utf-8")
        (folder / f"{name}.tex").write_text(table.latex(), encoding="utf-8")
    return list(tables.values())
