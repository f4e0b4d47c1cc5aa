"""The command line: runs a suite, prints its tables, and writes its episodes, trajectories, tables and figures."""

import contextlib
import dataclasses
import functools
import importlib.util
import os
import signal
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import rich.console

import wayfield.policies
from wayfield.benchmarks.ahead import Ahead, ahead
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.contest_options import ContestOptions
from wayfield.benchmarks.contest_report import (
    Short,
    contest_report,
    contest_section,
    drawing,
    holding,
    near,
    settings_of,
)
from wayfield.benchmarks.contests import CONTESTS, DISTURBANCES, GAINS, OVERVIEW, Course
from wayfield.benchmarks.document_tables import document_tables, ranked, reproduced
from wayfield.benchmarks.documents import documents
from wayfield.benchmarks.own_policies import own_policy, told_of_models
from wayfield.benchmarks.own_scenario import own_cases, own_courses, without_way
from wayfield.benchmarks.parcels import in_order
from wayfield.benchmarks.parts import Part, parts_of, play
from wayfield.benchmarks.public_suites import PUBLIC, racetrack_courses
from wayfield.benchmarks.report.drives import drive_of, write_drives
from wayfield.benchmarks.report.page import SMALL_BUDGET, Section, write_page
from wayfield.benchmarks.report.worlds import write_worlds
from wayfield.benchmarks.results import TABLE, Row, read_rows, readable, write_rows, write_trajectories
from wayfield.benchmarks.run_folder import REPORT, Run, default_folder, staging
from wayfield.benchmarks.suite import WORST, Setting, episodes, heads_first, run
from wayfield.benchmarks.table import Table
from wayfield.benchmarks.terminal import print_short
from wayfield.envs.command_line import (
    SEED,
    Choice,
    Names,
    OneLineErrors,
    RobotChoice,
    Scale,
    command_given,
    on_cluster,
    shared_out,
)
from wayfield.envs.engines import Engine, cores
from wayfield.envs.robots import ACTUATORS, ROBOTS, Robot
from wayfield.envs.scenarios import TASKS
from wayfield.policies import make
from wayfield.policies.policy import lacks

DOCUMENTS = "documents"
SUITES = (OVERVIEW, DOCUMENTS, *CONTESTS, DISTURBANCES, *PUBLIC)
MODES = tuple(mode for suite in PUBLIC.values() if len(suite.modes) > 1 for mode in suite.modes)
DYNAMICS = {"kinematic": ("kinematic",), "pymunk": ("pymunk",), "both": ("kinematic", "pymunk")}
FAMILIES = tuple(name for spec in TASKS.values() for name in spec.families)
KEPT = {"worst": WORST, "all": None}
_NOTE_WIDTH = 120  # of the notes under the tables, in characters
_LEAST_WIDTH = 12  # of a cell in a narrow terminal, in characters


@click.command("evaluate", cls=OneLineErrors, context_settings={"max_content_width": 100})
@click.option(
    "--suite",
    type=Choice("--suite", SUITES),
    help="What to run.  [default: overview; documents where there are other options but --out, --seed and --workers]",
)
@click.option(
    "--policies",
    type=Names("--policies", (*wayfield.policies.POLICIES, "all")),
    help="Only these policies, or all.  [default: those of the suite; public benchmarks leave out mppi, nav2_mppi]",
)
@click.option(
    "--dynamics",
    type=Choice("--dynamics", DYNAMICS),
    help="The plants.  [default: both; kinematic in contests and overview]",
)
@click.option(
    "--actuators",
    type=Choice("--actuators", ACTUATORS),
    help="The actuator tier.  [default: ideal; lagged in contests]",
)
@click.option(
    "--robot",
    type=RobotChoice("--robot"),
    help="The robot of a contest, --path or --scenarios: one that ships, or a data sheet of your own.  [default: p3dx]",
)
@click.option("--gains", type=Choice("--gains", GAINS), help="The gains of a contest.  [default: all]")
@click.option(
    "--agents",
    "homes",
    multiple=True,
    metavar="DIR",
    help="Also the agents of a folder that train.py wrote, in contests; may be repeated.",
)
@click.option(
    "--policy",
    "own",
    multiple=True,
    metavar="SOURCE",
    help="Also a policy of your own, in contests: module:Class, with gains as key=value behind it in the same word, or "
    "a model.zip of stable-baselines3, which can run code when it is loaded; may be repeated.",
)
@click.option("--families", type=Names("--families", FAMILIES), help="Only these families of scenarios, in contests.")
@click.option(
    "--split",
    type=Choice("--split", ("test", "claims")),
    help="The frozen scenarios of a contest: 10 a family (test), or 100 others, which tell differences of a point "
    "(claims).  [default: test]",
)
@click.option(
    "--path",
    "path",
    metavar="FILE",
    help="A scenario of your own (.json; a path also .csv, .txt), instead of a suite.",
)
@click.option(
    "--scenarios",
    metavar="FOLDER",
    help="A contest on the scenario files of a folder (.json; paths also .csv, .txt), instead of a suite.",
)
@click.option("--scale", type=Scale(), help="Multiplies the coordinates of paths: 0.02 or 1:50.  [default: 1]")
@click.option("--data", metavar="FOLDER", help="The official files of a public benchmark.")
@click.option(
    "--mode",
    type=Choice("--mode", MODES),
    help="Of barn: the challenge's rules with its Jackal at 2 m/s, or the P3DX at its own speed.  [default: challenge]",
)
@click.option(
    "--episodes",
    type=click.IntRange(min=1),
    help="Episodes of each case, with the seeds S, S + 1, ...; in contests the first scenarios of each family.",
)
@click.option("--seed", type=SEED, default=0, show_default=True, metavar="S", help="The first seed.")
@click.option(
    "--out",
    metavar="DIR",
    help="Folder of the results.  [default: results/SUITE, and what differs from the defaults]",
)
@click.option("--full", is_flag=True, help="Print every table, not only one small table a task.")
@click.option("--video", is_flag=True, help="Film a few representative cases as well.")
@click.option(
    "--keep-trajectories",
    "keep",
    type=Choice("--keep-trajectories", KEPT),
    help="Of which episodes of a contest: the three worst of each entry, as poses, or all of them, with speeds and "
    "errors too; documents keep all.  [default: worst]",
)
@click.option(
    "--workers",
    "count",
    type=click.IntRange(min=1),
    help="Processes that share the work.  [default: a core each, at most 4]",
)
@on_cluster
def main(**given: Any) -> None:
    """Runs a suite and prints its tables: the experiments of the three documents beside what they published
    (documents); controllers and trained agents against each other on the frozen test scenarios of a task (its name),
    and under growing disturbances (disturbances), or in public benchmarks whose files you have (barn, mrpb, movingai,
    racetracks); or the documents and a test scenario a family (overview).

    Every policy meets the same scenarios, starts and disturbances. The results folder receives the episodes
    (episodes.csv), trajectories (trajectories.npz), tables (.md, .csv, .tex) and figures (.svg, .png). A contest that
    is interrupted goes on where it was when the same command is given again.
    """
    asked = Asked(**given)
    asked.check()
    if asked.path is not None:
        asked.run_path()
    elif asked.scenarios is not None:
        asked.run_scenarios()
    elif asked.wanted in PUBLIC:
        asked.run_public()
    elif asked.wanted == OVERVIEW:
        asked.run_overview()
    elif asked.wanted == DOCUMENTS:
        asked.run_documents()
    else:
        contests = tuple(CONTESTS) if asked.wanted == DISTURBANCES else (asked.wanted,)
        asked.run_contest(asked.wanted, contests)


@dataclasses.dataclass(frozen=True)
class Asked:
    """The options of the command as they were given."""

    suite: str | None
    policies: tuple[str, ...] | None
    dynamics: str | None
    actuators: str | None
    robot: Robot | None
    gains: str | None
    homes: tuple[str, ...]
    own: tuple[str, ...]
    families: tuple[str, ...] | None
    split: str | None
    path: str | None
    scenarios: str | None
    scale: float | None
    data: str | None
    mode: str | None
    episodes: int | None
    seed: int
    out: str | None
    full: bool
    video: bool
    keep: str | None
    count: int | None

    @property
    def command(self) -> str:
        """Returns the command that was given."""
        return readable(command_given("python evaluate.py"))

    @property
    def processes(self) -> int:
        """Returns how many processes share the work."""
        return self.count or cores()

    @property
    def names(self) -> tuple[str, ...] | None:
        """Returns the policies that were named; None for all."""
        return None if self.policies is not None and "all" in self.policies else self.policies

    @property
    def narrowed(self) -> bool:
        """Returns whether there are other options than those that every suite takes."""
        few = (self.names, self.dynamics, self.actuators, self.robot, self.gains, self.homes, self.own, self.families)
        more = (self.path, self.scenarios, self.data, self.mode, self.split, self.episodes, self.video, self.keep)
        return any((*few, *more))

    @property
    def wanted(self) -> str:
        """Returns the suite that was asked for, or follows."""
        return self.suite or (DOCUMENTS if self.narrowed else OVERVIEW)

    @property
    def differing(self) -> dict[str, Any]:
        """Returns what is not as by default, by its name, for the name of the folder; None and nothing else is."""
        return {
            "robot": str(self.robot) if self.robot not in (None, ROBOTS["p3dx"]) else None,
            "agents": tuple(Path(home).resolve().name for home in self.homes),
            "own": tuple(readable(text) for text in self.own),
            **{"policies": self.names, "families": self.families, "split": self.split},
            **{"scale": self.scale, "episodes": self.episodes, "seed": self.seed},
            "trajectories": "all_trajectories" if self.keep == "all" else None,
        }

    def folder(self, name: str, differing: dict[str, Any]) -> Path:
        """Returns the folder of the results."""
        return Path(self.out) if self.out is not None else default_folder(name, differing)

    def check(self) -> None:
        """Refuses options that are empty or belong elsewhere, and to start where something is missing."""
        _need("matplotlib", "evaluate")
        if self.video:
            _need("pygame", "render")
            _need("moviepy", "render")
        for option, value, what in (
            ("--out", self.out, "folder"),
            ("--path", self.path, "file"),
            ("--scenarios", self.scenarios, "folder"),
            ("--data", self.data, "folder"),
        ):
            if value is not None and not value.strip():
                raise click.UsageError(f"{option} is empty; it must name a {what}")
        instead = [
            option
            for option, value in (("--suite", self.suite), ("--path", self.path), ("--scenarios", self.scenarios))
            if value is not None
        ]
        if len(instead) > 1:
            raise click.UsageError(f"{instead[1]} takes the place of {instead[0]}: give one of them")
        if self.scale is not None and self.path is None and self.scenarios is None and self.wanted != "racetracks":
            raise click.UsageError("--scale belongs to --path FILE, --scenarios FOLDER or --suite racetracks")
        self._check_public()
        if self.wanted == OVERVIEW:
            if self.narrowed:
                raise click.UsageError(f"--suite {OVERVIEW} takes no options but --out, --seed, --workers, --cluster")
        elif self.path is not None or (self.wanted == DOCUMENTS and self.scenarios is None):
            self._check_no_contest()
        elif self.video:
            raise click.UsageError(f"--video belongs to --suite {DOCUMENTS}")
        elif self.dynamics == "both":
            raise click.UsageError("--dynamics both belongs to the documents; a contest is run on one plant")
        elif self.scenarios is not None and self.families is not None:
            raise click.UsageError("--families belongs to the frozen scenarios; of --scenarios each file is a family")
        elif self.scenarios is not None and self.split is not None:
            raise click.UsageError("--split belongs to the frozen scenarios; --scenarios brings its own")

    def _check_public(self) -> None:
        """Refuses what a public benchmark lacks, and what belongs to one elsewhere."""
        if self.wanted not in PUBLIC:
            for option, value in (("--data", self.data), ("--mode", self.mode)):
                if value is not None:
                    raise click.UsageError(f"{option} belongs to public benchmarks: --suite {', '.join(PUBLIC)}")
            return
        suite = PUBLIC[self.wanted]
        if self.data is None:
            raise click.UsageError(f"--suite {self.wanted} needs --data FOLDER, the folder of its official files")
        if self.mode is not None and self.mode not in suite.modes:
            raise click.UsageError(f"--mode {self.mode!r} is none of suite {self.wanted!r}")
        mode = suite.modes[self.mode or next(iter(suite.modes))]
        if mode.fixed and self.robot not in (None, ROBOTS[mode.robot]):
            raise click.UsageError(f"--robot of this mode of {self.wanted} is {mode.robot}: see --mode")
        if self.families is not None:
            raise click.UsageError(
                "--families belongs to the frozen scenarios; --episodes takes the first of each course"
            )

    def _check_no_contest(self) -> None:
        for option, value in (
            *(
                ("--robot", self.robot if self.path is None else None),
                ("--gains", self.gains),
                ("--agents", self.homes),
                ("--policy", self.own),
            ),
            *(("--families", self.families), ("--split", self.split), ("--keep-trajectories", self.keep)),
        ):
            if value:
                raise click.UsageError(
                    f"{option} belongs to the contests: --suite {', '.join((*CONTESTS, DISTURBANCES))}"
                )

    def run_overview(self) -> None:
        """Runs the documents, and the contests on a scenario of each family."""
        folder = self.folder(OVERVIEW, self.differing)
        robot = ROBOTS["p3dx"]
        first = [name for contest in CONTESTS.values() for name in contest.overview if not lacks(make(name), robot)]
        options = ContestOptions(
            *(
                OVERVIEW,
                tuple(CONTESTS),
                tuple(dict.fromkeys(first)),
                DYNAMICS["kinematic"],
                "lagged",
                robot,
                GAINS["best"],
            ),
            *(None, None),
            self.seed,
            command=self.command,
        )
        this, inner = Run(OVERVIEW, self.command), folder / "contests"
        with holding(inner, options.run):  # is it free? Better told before the documents are run
            pass
        cases = documents()
        settings = settings_of(options)
        # the same processes do all of it: with each comes what it imports, reads and, the first time, compiles
        with _ended_by_signals(), shared_out(self.processes) as processes, contextlib.ExitStack() as stack:
            engine = ahead(processes)
            _begin(engine, self._settings_of(DOCUMENTS, cases), parts_of(settings, inner))
            stack.enter_context(holding(folder, this))
            stage = stack.enter_context(staging(folder, this))
            shown = stack.enter_context(self._cases_section(DOCUMENTS, cases, folder / DOCUMENTS, engine))
            contests = stack.enter_context(contest_section(options, settings, inner, engine, self.processes))
            told = write_page(stage / REPORT, "wayfield: overview", [contests, shown], self.command, SMALL_BUDGET)
        self._tell([*contests.tables, *shown.tables], told, folder)

    def run_documents(self) -> None:
        """Runs the experiments of the documents."""
        differing = self.differing | _conditions(self.dynamics, "both", self.actuators, "ideal")
        cases, folder = _cases_of_documents(self.names), self.folder(DOCUMENTS, differing)
        shown, told = self._run_cases(DOCUMENTS, cases, folder)
        self._tell(shown, told, folder)

    def run_path(self) -> None:
        """Runs all that can do it on a path, or in a goal scenario, of the user's own."""
        assert self.path is not None
        with _one_line("--path", self.path):
            cases = own_cases(self.path, self.scale, self.names, self.robot or "p3dx")
            hopeless = without_way(self.path, self.robot or "p3dx") if self.scale is None else ""
        if hopeless:  # before hours of driving
            click.echo(f"evaluate: {hopeless}", err=True)
        differing = self.differing | _conditions(self.dynamics, "both", self.actuators, "ideal")
        folder = self.folder(cases[0].document, {"file": Path(self.path).stem} | differing)
        shown, [(sentence, table)] = self._run_cases(cases[0].document, cases, folder)
        self._tell(shown, [(f"{hopeless}. {sentence}" if hopeless else sentence, table)], folder)

    def run_scenarios(self) -> None:
        """Runs a contest on the scenario files of a folder."""
        assert self.scenarios is not None
        with _one_line("--scenarios", self.scenarios):
            contest, courses = own_courses(self.scenarios, self.scale, self.robot or "p3dx")
        self.run_contest(contest.name, (contest.name,), courses)

    def run_public(self) -> None:
        """Runs a public benchmark on its official files."""
        assert self.data is not None
        suite = PUBLIC[self.wanted]
        name = self.mode or next(iter(suite.modes))
        robot = self.robot or ROBOTS[suite.modes[name].robot]
        folder = os.path.abspath(self.data)
        with _one_line("--data", self.data):
            if not os.path.isdir(folder):
                raise ValueError(f"{self.data!r} is no folder; it must be the one of the official files")
            if self.scale is None:
                courses = suite.courses(folder, robot)
            else:
                courses = racetrack_courses(folder, robot, self.scale)
        contest = suite.contest(name)
        # "all" leaves out none here: some drive in a public benchmark on request alone
        policies = contest.policies if "all" in (self.policies or ()) else self.policies
        dataclasses.replace(self, robot=robot, policies=policies).run_contest(contest.name, (contest.name,), courses)

    def run_contest(self, suite: str, contests: tuple[str, ...], courses: tuple[Course, ...] = ()) -> None:
        """Runs contests, on the frozen scenarios, on courses of the user's own or on those of a public benchmark."""
        with _one_line("--policy", ""):
            own = tuple(own_policy(text) for text in self.own)
        for warning in told_of_models(own):
            click.echo(f"evaluate: {warning}", err=True)
        options = ContestOptions(
            suite,
            contests,
            self.names,
            DYNAMICS[self.dynamics or "kinematic"],
            self.actuators or "lagged",
            self.robot or ROBOTS["p3dx"],
            GAINS[self.gains or "all"],
            self.families,
            self.episodes,
            self.seed,
            self.homes,
            own,
            courses,
            self.command,
            KEPT[self.keep or "worst"],
            self.split or "test",
        )
        differing = (
            ({"scenarios": Path(self.scenarios).resolve().name} if self.scenarios is not None else {})
            | self.differing
            | _conditions(self.dynamics, "kinematic", self.actuators, "lagged")
            | {"gains": self.gains if self.gains != "all" else None}
        )
        folder = self.folder(suite, differing)
        with _ended_by_signals(), shared_out(self.processes) as engine:
            tables, told = contest_report(options, folder, engine, self.processes)
        self._tell(tables, told, folder)

    def _tell(self, tables: Sequence[Table], told: Iterable[tuple[str, Table]], folder: Path) -> None:
        """Prints who wins and a small table a task, or with --full every table; names the report on the last line."""
        if self.full:
            _print(tables)
        else:
            print_short(told)
            print(f"All tables, figures and episodes are in {folder}{os.sep}; --full prints the tables.")
        print(f"Report: {folder / REPORT}")

    def _run_cases(self, name: str, cases: Sequence[Case], folder: Path) -> tuple[list[Table], Short]:
        """Runs cases of the documents or of a path; returns their tables and what they say."""
        with (
            _ended_by_signals(),
            shared_out(self.processes) as engine,
            self._cases_section(name, cases, folder, engine) as section,
        ):
            told = write_page(section.folder / REPORT, f"wayfield: {name}", [section], self.command)
        return list(section.tables), told

    def _settings_of(self, name: str, cases: Sequence[Case]) -> list[Setting]:
        """Returns the settings of cases of the documents or of a path."""
        # the overview is awaited: the plant of its contests is enough there
        plants = DYNAMICS[self.dynamics or ("kinematic" if self.wanted == OVERVIEW else "both")]
        actuators = self.actuators or "ideal"
        return [
            Setting(name, case, plant, actuators, self.seed, self.episodes or case.episodes)
            for case in cases
            for plant in plants
        ]

    @contextlib.contextmanager
    def _cases_section(self, name: str, cases: Sequence[Case], folder: Path, engine: Engine) -> Iterator[Section]:
        """Runs cases and writes their files where they are not in the folder yet; yields that, as `contest_section`."""
        from wayfield.benchmarks.document_figures import draw, stem_of, wanted_figures  # which takes a second

        settings = self._settings_of(name, cases)
        kinds = dict.fromkeys(stem_of(case.document) for case in cases)
        films = ("video/*.mp4",) if self.video else ()
        figures = [f"{kind}_*.{suffix}" for kind in kinds for suffix in ("svg", "png")]
        this = Run(name, self.command, (*figures, *films))
        with holding(folder, this), staging(folder, this) as stage, near(engine, self.processes) as here:
            try:
                rows, trajectories = run(settings, functools.partial(in_order, engine))
            except ValueError as error:  # a damaged agent
                raise click.ClickException(str(error)) from None
            write_rows(stage, rows)
            write_trajectories(stage, trajectories)
            write_drives(stage, {k: drive_of(each) for k, each in enumerate(trajectories.values())})
            write_worlds(stage, settings)
            written = read_rows(stage)
            shown = write_case_tables(stage, written, cases)
            with drawing(here, draw, wanted_figures(stage, written)):
                if self.video:
                    from wayfield.benchmarks.video import film

                    film(stage / "video", cases, settings[0].dynamics, settings[0].actuators, self.seed)
                told = reproduced(written, cases) if name == DOCUMENTS else ranked(written)
                yield Section(stage, shown, told)


def write_case_tables(folder: Path, rows: Sequence[Row], cases: Iterable[Case]) -> list[Table]:
    """Writes the tables of cases into the folder of their run; returns them."""
    shown = document_tables(rows, cases)
    (folder / TABLE).write_text("\n".join(table.markdown() for table in shown), encoding="utf-8")
    return shown


def _begin(engine: Engine, cases: Sequence[Setting], parts: Sequence[Part]) -> None:
    """Hands over all work of the overview at once, so that no process waits for another before the end."""
    if not isinstance(engine, Ahead):
        return
    left = [part.setting for part in parts if not part.folder.is_dir()]
    work = [*((episodes, setting) for setting in cases), *((play, setting) for setting in left)]
    for i in heads_first([setting for _, setting in work]):
        function, setting = work[i]
        engine.begin(function, [setting])


def _conditions(dynamics: str | None, plant: str, actuators: str | None, tier: str) -> dict[str, Any]:
    """Returns plants and actuators where they are not the default ones."""
    return {
        "plant": dynamics if dynamics != plant else None,
        "tier": actuators if actuators != tier else None,
    }


@contextlib.contextmanager
def _one_line(option: str, value: str) -> Iterator[None]:
    """Turns what is wrong with the value of an option into a line that names the option."""
    try:
        yield
    except OSError as error:
        where = f" ({error.filename})" if error.filename and str(error.filename) != value else ""
        raise click.UsageError(f"{option} {value!r} cannot be read: {error.strerror or error}{where}") from None
    except ValueError as error:
        text = str(error)
        raise click.UsageError(text if text.startswith("--") else f"{option} {text}") from None


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


def _print(shown: Iterable[Table]) -> None:
    """Prints the tables: as wide as they need to be, or with the columns that the terminal has room for."""
    paper = rich.console.Console(width=1000)
    console = rich.console.Console() if sys.stdout.isatty() else paper
    for table in shown:
        whole = table.terminal()
        columns = len(table.header)
        if paper.measure(whole).maximum > console.width:
            whole = table.terminal(stacked=True)
        while columns > 4 and paper.measure(whole).maximum > console.width:
            columns -= 1
            whole = table.terminal(columns, stacked=True)
        if paper.measure(whole).maximum > console.width:
            whole = table.terminal(columns, stacked=True, cell_width=max(console.width // columns - 4, _LEAST_WIDTH))
        with console.capture() as capture:
            console.print(whole)
        for line in capture.get().splitlines():
            print(line.rstrip())
        note = table.note
        if columns < len(table.header):
            note += f" Left out for want of width: {', '.join(table.header[columns:])}; all columns are in table.md."
        # a command in it shall stay one that can be copied
        print(textwrap.fill(note, min(console.width, _NOTE_WIDTH), break_on_hyphens=False) + "\n")
