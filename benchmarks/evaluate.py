"""The command line: runs a suite, prints its tables, and writes its episodes, trajectories, tables and figures."""

import contextlib
import importlib.util
import os
import signal
import sys
import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path

import click
import rich.console

import wayfield.policies
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.command_line import Choice, Names, OneLineErrors, Scale
from wayfield.benchmarks.documents import documents
from wayfield.benchmarks.own_path import POLICIES as PATH_POLICIES
from wayfield.benchmarks.own_path import own_path
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.results import TABLE, read_rows, staging, write_rows, write_trajectories
from wayfield.benchmarks.suite import Setting, run
from wayfield.benchmarks.tables import Table, tables
from wayfield.benchmarks.workers import Map, workers
from wayfield.envs.robots import ACTUATORS

SUITES: dict[str, Callable[[], tuple[Case, ...]]] = {"documents": documents}
DYNAMICS = {"kinematic": ("kinematic",), "pymunk": ("pymunk",), "both": ("kinematic", "pymunk")}
_NOTE_WIDTH = 120  # of the notes under the tables, in characters


@click.command(
    "evaluate", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.option("--suite", type=Choice("--suite", SUITES), default="documents", show_default=True, help="What to run.")
@click.option(
    "--policies",
    type=Names("--policies", wayfield.policies.POLICIES),
    help="Only these policies.  [default: all that the suite names]",
)
@click.option("--dynamics", type=Choice("--dynamics", DYNAMICS), default="both", show_default=True, help="The plants.")
@click.option(
    "--actuators", type=Choice("--actuators", ACTUATORS), default="ideal", show_default=True, help="The actuator tier."
)
@click.option(
    "--path", "path", metavar="FILE", help="Follow the path of a .csv, .txt or .json file instead of a suite."
)
@click.option("--scale", type=Scale(), help="Multiplies the path's coordinates: 0.02 or 1:50.  [default: 1]")
@click.option("--episodes", type=click.IntRange(min=1), help="Episodes of each case, with the seeds S, S + 1, ...")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="S", help="The first seed.")
@click.option("--out", metavar="DIR", help="Folder of the results.  [default: results/<suite>]")
@click.option("--video", is_flag=True, help="Film a few representative cases as well.")
@click.option(
    "--workers",
    "count",
    type=click.IntRange(min=1),
    help="Processes that share the work.  [default: a core each, at most 4]",
)
def main(
    suite: str,
    policies: tuple[str, ...] | None,
    dynamics: str,
    actuators: str,
    path: str | None,
    scale: float | None,
    episodes: int | None,
    seed: int,
    out: str | None,
    video: bool,
    count: int | None,
) -> None:
    """Runs the documented experiments and prints our figures beside the published ones.

    Every policy meets the same scenarios, starts and disturbances. The results folder receives the episodes
    (episodes.csv), the trajectories (trajectories.npz), the tables (table.md) and the figures (.svg, .png).
    """
    _need("matplotlib", "evaluate")
    if video:
        _need("pygame", "render")
        _need("moviepy", "render")
    if out is not None and not out.strip():
        raise click.UsageError("--out is empty; it must name a folder")
    if scale is not None and path is None:
        raise click.UsageError("--scale belongs to --path FILE")
    cases = _cases_of_path(path, scale or 1.0, policies) if path is not None else _cases_of_suite(suite, policies)
    name = suite if path is None else "path"
    folder = Path("results") / name if out is None else Path(out)
    settings = [
        Setting(name, case, plant, actuators, seed, episodes or case.episodes)
        for case in cases
        for plant in DYNAMICS[dynamics]
    ]
    with contextlib.ExitStack() as stack:
        # so that the staging folder is cleared away when the process is asked to end
        stack.callback(signal.signal, signal.SIGTERM, signal.signal(signal.SIGTERM, lambda *_: sys.exit(143)))
        try:
            stage = stack.enter_context(staging(folder))
        except OSError as error:
            raise click.ClickException(f"--out {str(folder)!r} cannot be written: {error}") from None
        share = stack.enter_context(workers(count or min(os.cpu_count() or 1, 4)))
        rows, trajectories = run(settings, share)
        write_rows(stage, rows)
        write_trajectories(stage, trajectories)
        shown = _report(stage, cases, share)
        if video:
            from wayfield.benchmarks.video import film

            film(stage / "video", cases, DYNAMICS[dynamics][0], actuators, seed)
    _print(shown)
    click.echo(f"Results are in {folder}{os.sep}")


def _need(module: str, extra: str) -> None:
    """Refuses to start when an optional dependency is missing, rather than fail at the end."""
    if importlib.util.find_spec(module) is None:
        raise click.ClickException(f'{module} is missing: pip install "wayfield[{extra}]"')


def _cases_of_suite(suite: str, policies: tuple[str, ...] | None) -> tuple[Case, ...]:
    """Returns the suite's cases of the wanted policies."""
    cases = SUITES[suite]()
    if policies is None:
        return cases
    for name in policies:
        if all(case.policy != name for case in cases):
            raise click.UsageError(f"--policies {name!r} has no case in suite {suite!r}")
    return tuple(case for case in cases if case.policy in policies)


def _cases_of_path(file: str, scale: float, policies: tuple[str, ...] | None) -> tuple[Case, ...]:
    """Returns the cases on a path of the user's own."""
    for name in policies or ():
        if name not in PATH_POLICIES:
            raise click.UsageError(
                f"--policies {name!r} does not follow paths; choose from {', '.join(map(repr, PATH_POLICIES))}"
            )
    try:
        return own_path(file, scale, policies or PATH_POLICIES)
    except OSError as error:
        raise click.UsageError(f"--path {file!r} cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise click.UsageError(f"--path {error}") from None


def _report(folder: Path, cases: Iterable[Case], share: Map) -> list[Table]:
    """Writes tables and figures into a folder, from its episodes and trajectories alone; returns the tables."""
    from wayfield.benchmarks.figures import FIGURES, draw

    rows = read_rows(folder)
    shown = tables(rows, cases)
    (folder / TABLE).write_text("\n".join(table.markdown() for table in shown), encoding="utf-8")
    documents = dict.fromkeys(row["document"] for row in rows)
    wanted = [(folder, document, name) for document in documents for name in FIGURES[document]]
    for _ in tracked(share(draw, wanted), len(wanted), "figures"):
        pass
    return shown


def _print(shown: Iterable[Table]) -> None:
    """Prints the tables: as wide as they need to be, or with the columns that the terminal has room for."""
    paper = rich.console.Console(width=1000)
    console = rich.console.Console() if sys.stdout.isatty() else paper
    for table in shown:
        whole = table.terminal()
        columns = len(table.header)
        while columns > 4 and paper.measure(whole).maximum > console.width:
            columns -= 1
            whole = table.terminal(columns)
        with console.capture() as capture:
            console.print(whole)
        for line in capture.get().splitlines():
            print(line.rstrip())
        note = table.note
        if columns < len(table.header):
            note += f" Left out for want of width: {', '.join(table.header[columns:])}; all columns are in table.md."
        print(textwrap.fill(note, min(console.width, _NOTE_WIDTH)) + "\n")
