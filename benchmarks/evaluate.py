"""The command line: runs a suite, prints its tables, and writes its episodes, trajectories, tables and figures."""

import contextlib
import importlib.util
import os
import signal
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import click
import rich.console

import wayfield.policies
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.command_line import Choice, Names, OneLineErrors, Scale
from wayfield.benchmarks.contest_report import ContestOptions, contest_report
from wayfield.benchmarks.contests import CONTESTS, DISTURBANCES, OVERVIEW
from wayfield.benchmarks.documents import documents
from wayfield.benchmarks.own_path import POLICIES as PATH_POLICIES
from wayfield.benchmarks.own_path import own_path
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.results import TABLE, read_rows, staging, write_rows, write_trajectories
from wayfield.benchmarks.suite import Setting, run
from wayfield.benchmarks.tables import Table, tables
from wayfield.benchmarks.workers import Map, workers
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.scenarios import splits

DOCUMENTS = "documents"
SUITES = (OVERVIEW, DOCUMENTS, *CONTESTS, DISTURBANCES)
DYNAMICS = {"kinematic": ("kinematic",), "pymunk": ("pymunk",), "both": ("kinematic", "pymunk")}
GAINS = {
    **{name: (name,) for name in ("default", "tuned", "best", "paper")},
    "all": ("default", "tuned", "paper"),
}
FAMILIES = tuple(name for task in splits.FAMILIES.values() for name in task)
_NOTE_WIDTH = 120  # of the notes under the tables, in characters


@click.command(
    "evaluate", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.option(
    "--suite",
    type=Choice("--suite", SUITES),
    help="What to run.  [default: overview; documents where there are other options but --out, --seed and --workers]",
)
@click.option(
    "--policies",
    type=Names("--policies", (*wayfield.policies.POLICIES, "all")),
    help="Only these policies.  [default: all that the suite names]",
)
@click.option(
    "--dynamics", type=Choice("--dynamics", DYNAMICS), help="The plants.  [default: both; kinematic in contests]"
)
@click.option(
    "--actuators",
    type=Choice("--actuators", ACTUATORS),
    help="The actuator tier.  [default: ideal; lagged in contests]",
)
@click.option("--robot", type=Choice("--robot", ROBOTS), help="The robot of a contest.  [default: p3dx]")
@click.option("--gains", type=Choice("--gains", GAINS), help="The gains of a contest.  [default: all]")
@click.option(
    "--agents",
    "homes",
    multiple=True,
    metavar="DIR",
    help="Also the agents of a folder that train.py wrote, in contests; may be repeated.",
)
@click.option("--families", type=Names("--families", FAMILIES), help="Only these families of scenarios, in contests.")
@click.option(
    "--path", "path", metavar="FILE", help="Follow the path of a .csv, .txt or .json file instead of a suite."
)
@click.option("--scale", type=Scale(), help="Multiplies the path's coordinates: 0.02 or 1:50.  [default: 1]")
@click.option(
    "--episodes",
    type=click.IntRange(min=1),
    help="Episodes of each case, with the seeds S, S + 1, ...; in contests the first scenarios of each family.",
)
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
    suite: str | None,
    policies: tuple[str, ...] | None,
    dynamics: str | None,
    actuators: str | None,
    robot: str | None,
    gains: str | None,
    homes: tuple[str, ...],
    families: tuple[str, ...] | None,
    path: str | None,
    scale: float | None,
    episodes: int | None,
    seed: int,
    out: str | None,
    video: bool,
    count: int | None,
) -> None:
    """Runs a suite and prints its tables: the experiments of the three documents beside what they published
    (documents); controllers and trained agents against each other on frozen test scenarios (path-following,
    goal-obstacles), and under growing disturbances (disturbances); or the documents and a test scenario a family
    (overview).

    Every policy meets the same scenarios, starts and disturbances. The results folder receives the episodes
    (episodes.csv), trajectories (trajectories.npz), tables (.md, .csv, .tex) and figures (.svg, .png). A contest that
    is interrupted goes on where it was when the same command is given again.
    """
    _need("matplotlib", "evaluate")
    if video:
        _need("pygame", "render")
        _need("moviepy", "render")
    if out is not None and not out.strip():
        raise click.UsageError("--out is empty; it must name a folder")
    if scale is not None and path is None:
        raise click.UsageError("--scale belongs to --path FILE")
    if policies is not None and "all" in policies:
        policies = None
    count = count or min(os.cpu_count() or 1, 4)
    narrowed = any((policies, dynamics, actuators, robot, gains, homes, families, path, episodes, video))
    if suite is None:
        suite = DOCUMENTS if narrowed else OVERVIEW
    if suite == OVERVIEW:
        if narrowed:
            raise click.UsageError(f"--suite {OVERVIEW} takes no options but --out, --seed and --workers")
        _overview(Path("results") / OVERVIEW if out is None else Path(out), seed, count)
        return
    if path is None and suite != DOCUMENTS:
        if video:
            raise click.UsageError(f"--video belongs to --suite {DOCUMENTS}")
        if dynamics == "both":
            raise click.UsageError("--dynamics both belongs to the documents; a contest is run on one plant")
        folder = Path("results") / suite if out is None else Path(out)
        options = ContestOptions(
            suite,
            tuple(CONTESTS) if suite == DISTURBANCES else (suite,),
            policies,
            (*DYNAMICS[dynamics or "kinematic"],),
            actuators or "lagged",
            robot or "p3dx",
            GAINS[gains or "all"],
            families,
            episodes,
            seed,
            homes,
        )
        with _ended_by_signals():
            _print(contest_report(options, folder, count))
        click.echo(f"Results are in {folder}{os.sep}")
        return
    for option, value in (("--robot", robot), ("--gains", gains), ("--agents", homes), ("--families", families)):
        if value:
            raise click.UsageError(f"{option} belongs to the contests: --suite {', '.join((*CONTESTS, DISTURBANCES))}")
    dynamics, actuators = dynamics or "both", actuators or "ideal"
    cases = _cases_of_path(path, scale or 1.0, policies) if path is not None else _cases_of_documents(policies)
    name = suite if path is None else "path"
    folder = Path("results") / name if out is None else Path(out)
    _documents(name, cases, DYNAMICS[dynamics], actuators, seed, episodes, folder, count, video)


def _overview(folder: Path, seed: int, count: int) -> None:
    """Runs the documents, and the contests on a scenario of each family."""
    _documents(DOCUMENTS, documents(), DYNAMICS["both"], "ideal", seed, None, folder / DOCUMENTS, count, video=False)
    options = ContestOptions(
        OVERVIEW, tuple(CONTESTS), None, DYNAMICS["kinematic"], "lagged", "p3dx", GAINS["best"], None, None, seed
    )
    with _ended_by_signals():
        _print(contest_report(options, folder / "contests", count))
    click.echo(f"Results are in {folder}{os.sep}")


def _documents(
    name: str,
    cases: Sequence[Case],
    plants: Sequence[str],
    actuators: str,
    seed: int,
    episodes: int | None,
    folder: Path,
    count: int,
    video: bool,
) -> None:
    """Runs cases of the documents or of a path, prints their tables and writes their files."""
    settings = [
        Setting(name, case, plant, actuators, seed, episodes or case.episodes) for case in cases for plant in plants
    ]
    with contextlib.ExitStack() as stack:
        stack.enter_context(_ended_by_signals())
        try:
            stage = stack.enter_context(staging(folder))
        except OSError as error:
            raise click.ClickException(f"--out {str(folder)!r} cannot be written: {error}") from None
        share = stack.enter_context(workers(count))
        try:
            rows, trajectories = run(settings, share)
        except ValueError as error:  # a damaged agent
            raise click.ClickException(str(error)) from None
        write_rows(stage, rows)
        write_trajectories(stage, trajectories)
        shown = _report(stage, cases, share)
        if video:
            from wayfield.benchmarks.video import film

            film(stage / "video", cases, plants[0], actuators, seed)
    _print(shown)
    click.echo(f"Results are in {folder}{os.sep}")


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Makes the process end in order, with its staging folders cleared away, when it is asked to end."""
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _need(module: str, extra: str) -> None:
    """Refuses to start when an optional dependency is missing, rather than fail at the end."""
    if importlib.util.find_spec(module) is None:
        raise click.ClickException(f'{module} is missing: pip install "wayfield[{extra}]"')


def _cases_of_documents(policies: tuple[str, ...] | None) -> tuple[Case, ...]:
    """Returns the documents' cases of the wanted policies."""
    cases = documents()
    if policies is None:
        return cases
    for name in policies:
        if all(case.policy != name for case in cases):
            raise click.UsageError(f"--policies {name!r} has no case in suite {DOCUMENTS!r}")
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
