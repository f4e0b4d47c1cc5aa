"""The command line: runs a suite, prints its tables, and writes its episodes, trajectories, tables and figures."""

import contextlib
import dataclasses
import importlib.util
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import rich.console

import wayfield.policies
from wayfield.benchmarks.commands.contest_options import (
    DOCUMENTS,
    DYNAMICS,
    PAPERS,
    QUICK,
    QUICK_FAMILIES,
    QUICK_POLICIES,
    STORED,
    Options,
    WrongOption,
)
from wayfield.benchmarks.commands.contest_report import (
    Interrupted,
    Short,
    contest_report,
    contest_section,
    drawing,
    holding,
    near,
    quick_report,
    settings_of,
    short_findings,
    tell_left_out,
)
from wayfield.benchmarks.contests import (
    ALL_CONTESTS,
    CONTESTS,
    CROSS,
    CROWD_SUITES,
    DISTURBANCES,
    GAINS,
    OVERVIEW,
    PUBLIC_SPLIT,
    Contest,
    Course,
)
from wayfield.benchmarks.contests.contest import with_agents
from wayfield.benchmarks.contests.crowds import CASES, CLOCK, PEOPLE_LAWS, people_contests
from wayfield.benchmarks.entrants.documents import documents
from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.benchmarks.entrants.own_scenario import own_cases, own_courses, own_scenario, without_way
from wayfield.benchmarks.entrants.public_suites import PUBLIC, racetrack_courses
from wayfield.benchmarks.leaderboards.document_tables import document_tables, ranked, reproduced
from wayfield.benchmarks.leaderboards.terminal import MOST_LINES, print_short
from wayfield.benchmarks.papers import CLAIMS
from wayfield.benchmarks.papers.claim import drive, lines_of, of_rows, train, written
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.replays import drive_of, write_drives
from wayfield.benchmarks.records.results import TABLE, read_rows, readable, write_rows, write_trajectories
from wayfield.benchmarks.records.run_folder import REPORT, Run, staging
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.report.page import Section, write_page
from wayfield.benchmarks.report.worlds import write_worlds
from wayfield.benchmarks.runs.payloads import sent
from wayfield.benchmarks.runs.prefetch import Prefetch, prefetching
from wayfield.benchmarks.runs.shards import Part, load, parts_of, play_together, rows_so_far
from wayfield.benchmarks.runs.suite import (
    Episode,
    Group,
    Setting,
    episodes,
    episodes_together,
    gathered,
    heads_first,
    run,
    together,
)
from wayfield.envs import goal_reaching
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.robot_option import robot_option
from wayfield.envs.tasks.specs import EVERY
from wayfield.policies import make
from wayfield.policies.parts.policy import lacks
from wayfield.policies.registry import RENAMED
from wayfield.system.checks import unread
from wayfield.system.command_line import (
    SEED,
    Choice,
    Names,
    OneLineErrors,
    Scale,
    command_given,
    on_cluster,
    say,
    shared_out,
)
from wayfield.system.compiled import is_stored
from wayfield.system.executors import Executor
from wayfield.system.extras import installs
from wayfield.system.storage import write_whole

SUITES = (OVERVIEW, DOCUMENTS, *CONTESTS, *CROWD_SUITES, DISTURBANCES, PAPERS, *PUBLIC)
MODES = tuple(mode for suite in PUBLIC.values() if len(suite.modes) > 1 for mode in suite.modes)
FAMILIES = tuple(name for spec in EVERY.values() for name in spec.families)
_NOTE_WIDTH = 120  # of the notes under the tables, in characters
_QUICK_WIDTH = 80  # of the tables of a first look, in characters
_LEAST_WIDTH = 12  # of a cell in a narrow terminal, in characters


class _Policies(Names):
    """Names of policies; one of the user's own is sent to the option --policy."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        for name in str(value).split(","):
            if ":" in name or name.endswith(".zip"):
                raise click.UsageError(f"--policies {name!r} is none of the package's; your own is --policy {name}")
        return super().convert(value, param, ctx)


_LINES = "\n".join(f"  {name:25} {contest.spec.asks}" for name, contest in CONTESTS.items())
HELP = f"""Compares policies on the same scenarios, starts and disturbances: prints tables and writes report.html.

\b
Suites:
  overview                  four tasks of one robot, the three reference papers
{_LINES}
  disturbances              all these tasks, under growing disturbances
  teams, people, crowdnav   several robots; one robot among people
  documents                 scenarios of the three reference papers
  papers                    a published claim, re-run: --claim NAME
  barn, mrpb, movingai,
  racetracks                public benchmarks, from --data FOLDER

The results folder has episodes (episodes.csv), trajectories (trajectories.npz), tables (.md, .csv, .tex) and
figures (.svg, .png). Give the same command again to continue an interrupted run.
"""


@click.command("evaluate", help=HELP, cls=OneLineErrors, context_settings={"max_content_width": 100})
@click.option(
    "--suite",
    type=Choice("--suite", SUITES),
    help="What to run, see above.  [default: overview; documents with --policies, --dynamics, --actuators, --episodes "
    "or --video]",
)
@click.option(
    "--policies",
    type=_Policies("--policies", (*wayfield.policies.POLICIES, *RENAMED, "all")),
    help="Only these policies of the package, or all.  [default: those of the suite but any_robot and slow ones]",
)
@click.option(
    "--dynamics",
    type=Choice("--dynamics", DYNAMICS),
    help="The plants.  [default: kinematic; both in suite documents]",
)
@click.option(
    "--actuators",
    type=Choice("--actuators", ACTUATORS),
    help="The actuator tier.  [default: lagged; ideal in suite documents]",
)
@robot_option(
    "The robot of a contest, --path or --scenarios: one that ships, or a data sheet of your own.  [default: p3dx]"
)
@click.option("--gains", type=Choice("--gains", GAINS), help="Sets of gains in a contest.  [default: all]")
@click.option(
    "--agents",
    "homes",
    multiple=True,
    metavar="DIR",
    help="Add your trained agents to a contest: a folder of wayfield train; may be repeated.",
)
@click.option(
    "--policy",
    "own",
    multiple=True,
    metavar="SOURCE",
    help="Add a policy of your own to those of --policies: module:Class, with gains as key=value in the same word, a "
    "model.zip of stable-baselines3 (loading it can run code), or among people the weights of a CrowdNav network; may "
    "be repeated.",
)
@click.option("--families", type=Names("--families", FAMILIES), help="Only these families of scenarios, in contests.")
@click.option(
    "--split",
    type=Choice("--split", ("test", "claims")),
    help="Test scenarios of a contest: 10 a family (test), or 100 others (claims), which show differences of one "
    "percentage point.  [default: test]",
)
@click.option(
    "--claim", type=Choice("--claim", CLAIMS), help="Papers: the published claim to run again; see docs/claims.md."
)
@click.option("--train", is_flag=True, help="Papers: train the claim's agents anew, and run it with them.")
@click.option("--steps", type=click.IntRange(min=1), help="Papers: training steps of a seed with --train.")
@click.option("--cross", is_flag=True, help="Teams: also all pairs of policies in one scene, half and half.")
@click.option(
    "--people",
    type=Names("--people", (*PEOPLE_LAWS, "all")),
    help="People: how they walk; each model reacts to the robot in one contest, not in the other.  [default: own]",
)
@click.option(
    "--path",
    "path",
    metavar="FILE",
    help="Your own scenario (.json; a path also .csv, .tsv, .txt), instead of a suite.",
)
@click.option(
    "--scenarios",
    metavar="FOLDER",
    help="A contest on the scenario files of a folder (.json; paths also .csv, .tsv, .txt), instead of a suite.",
)
@click.option("--scale", type=Scale(), help="Multiplies the coordinates of paths: 0.02 or 1:50.  [default: 1]")
@click.option("--data", metavar="FOLDER", help="The official files of a public benchmark, or of a claim.")
@click.option(
    "--mode",
    type=Choice("--mode", MODES),
    help="BARN: the challenge's rules with its Jackal at 2 m/s, or the P3DX at its own speed.  [default: challenge]",
)
@click.option(
    "--episodes",
    type=click.IntRange(min=1),
    help="Episodes of each case, with seeds S, S + 1, ...; in contests: the first scenarios of each family.",
)
@click.option("--seed", type=SEED, default=0, show_default=True, metavar="S", help="The first seed.")
@click.option(
    "--out",
    metavar="DIR",
    help="Folder of the results.  [default: results/SUITE, with the options that are not default]",
)
@click.option(
    "--quick", is_flag=True, help="A first look: three tasks, three policies each, four scenarios, in results/quick."
)
@click.option("--full", is_flag=True, help="Print every table, not only one small table a task.")
@click.option("--video", is_flag=True, help="Also film a few representative cases.")
@click.option(
    "--keep-trajectories",
    "keep",
    type=Choice("--keep-trajectories", STORED),
    help="Trajectories to keep in a contest: poses of the three worst of each entry, or all, with speeds and errors; "
    "suite documents keeps all.  [default: worst]",
)
@click.option(
    "--workers",
    "count",
    type=click.IntRange(min=1),
    help="Processes that share the work.  [default: a core each, at most 4; for --quick, once it is compiled, 1]",
)
@on_cluster
def main(**given: Any) -> None:
    """Runs what the options say."""
    options = Options(**given, command=readable(command_given("python evaluate.py")))
    _need("matplotlib", "evaluate")
    if options.video:
        _need("pygame", "render")
        _need("moviepy", "render")
    try:
        options.check()
    except WrongOption as error:
        raise click.UsageError(f"--{error}") from None
    if options.kind in PUBLIC:
        run_public(options)
    else:
        RUNS[options.kind](options)


def run_quick(options: Options) -> None:
    """Runs a few policies on a few scenarios of each contest."""
    folder = options.folder(QUICK, options.differing("kinematic", "lagged"))
    few = dataclasses.replace(options, suite=QUICK, policies=QUICK_POLICIES, families=QUICK_FAMILIES)
    few = dataclasses.replace(few, contests=tuple(CONTESTS), gains="best")
    # once all is compiled, another process takes longer to start than it would save
    with shared_out(options.count or (1 if is_stored(goal_reaching.step_rows) else options.processes)) as executor:
        findings = quick_report(few, folder, executor)
    print_short(findings, _QUICK_WIDTH)
    say("Four scenarios a task are a first look, not a verdict. Next: wayfield evaluate")
    say(f"Tables and a figure: {folder}")


def run_overview(options: Options) -> None:
    """Runs the documents, and the contests on a scenario of each family."""
    folder = options.folder(OVERVIEW, options.differing("both", "ideal"))
    robot = ROBOTS["p3dx"]
    first = [name for contest in CONTESTS.values() for name in contest.overview if not lacks(make(name), robot)]
    inside = dataclasses.replace(options, contests=tuple(CONTESTS), policies=tuple(dict.fromkeys(first)), gains="best")
    inside = dataclasses.replace(inside, suite=OVERVIEW)
    this, inner = Run(OVERVIEW, options.command), folder / "contests"
    with holding(inner, inside.run):  # refused before the documents are run, if it is not free
        pass
    cases = documents()
    done: dict[int, list[Episode]] = {}
    with contextlib.ExitStack() as starting:
        # the same processes do all of it: with each comes what it imports, reads and, the first time, compiles
        executor = prefetching(starting.enter_context(shared_out(options.processes)))
        if isinstance(executor, Prefetch):  # they import while this one reads what there is to do
            executor.begin(load, range(options.processes))
        settings = settings_of(inside)
        parts = parts_of(settings, inner)
        processes = starting.pop_all()
    try:
        with processes, contextlib.ExitStack() as stack:
            _begin(executor, _settings_of(options, DOCUMENTS, cases), parts)
            stack.enter_context(holding(folder, this))
            stage = stack.enter_context(staging(folder, this))
            shown = stack.enter_context(_cases_section(options, DOCUMENTS, cases, folder / DOCUMENTS, executor, done))
            contests = stack.enter_context(contest_section(inside, settings, inner, executor, options.processes))
            sections = [contests, shown]
            findings = write_page(stage / REPORT, "wayfield: overview", sections, options.command)
    except (KeyboardInterrupt, SystemExit, Interrupted):
        with contextlib.suppress(KeyboardInterrupt, SystemExit):  # a second interrupt, before the tables are shown
            _tell_so_far(inside, _settings_of(options, DOCUMENTS, cases), cases, done, parts, executor)
        raise Interrupted("interrupted", parts) from None
    *of_contests, (of_documents, _) = findings  # one plant: the sentence says what its table would
    _tell(options, [*contests.tables, *shown.tables], [*of_contests, (of_documents, None)], folder)


def _tell_so_far(
    options: Options,
    settings: Sequence[Setting],
    cases: Sequence[Case],
    done: Mapping[int, list[Episode]],
    parts: Sequence[Part],
    executor: Executor,
) -> None:
    """Prints what an overview that was interrupted has found, and keeps the parts that are done."""
    ended: Mapping[int, Any] = {}
    if isinstance(executor, Prefetch):
        done = {**done, **_ended(executor, episodes_together, settings)}
        ended = _ended(executor, play_together, [part.setting for part in parts])
    findings: Short = []
    if ended or any(part.folder.is_dir() for part in parts):
        with holding(parts[0].folder.parents[1], options.run):
            findings += short_findings(rows_so_far(parts, ended))
    if done:
        findings.append(reproduced(gathered(done)[0], cases))
    say("\nSo far:")
    print_short(findings)


def _ended(executor: Prefetch, function: Callable[[Any], Any], settings: Sequence[Setting]) -> dict[int, Any]:
    """Returns what has become of settings that were begun `together`, by their numbers."""
    groups = together(settings)
    results = executor.ended(function, [tuple(settings[k] for k in group) for group in groups])
    return {k: result for g, each in results.items() for k, result in zip(groups[g], each, strict=True)}


def run_documents(options: Options) -> None:
    """Runs the experiments of the documents."""
    differing = options.differing("both", "ideal")
    cases, folder = _cases_of_documents(options.names), options.folder(DOCUMENTS, differing)
    shown, findings = _run_cases(options, DOCUMENTS, cases, folder)
    _tell(options, shown, findings, folder)


def run_path(options: Options) -> None:
    """Runs all that can do it on a path, or in a goal scenario, of the user's own."""
    assert options.path is not None
    with _one_line("--path", options.path):
        names = options.names and _with_agents(options, [own_scenario(options.path, options.scale).contest])
        cases = own_cases(options.path, options.scale, names, options.robot or "p3dx")
        hopeless = without_way(options.path, options.robot or "p3dx") if options.scale is None else ""
    tell_left_out(options, [own_scenario(options.path, options.scale).contest])
    if hopeless:  # before hours of driving
        say(f"evaluate: {hopeless}", err=True)
    differing = options.differing("kinematic", "lagged")
    folder = options.folder(cases[0].contest, {"file": Path(options.path).stem} | differing)
    shown, [(sentence, table)] = _run_cases(options, cases[0].contest, cases, folder)
    _tell(options, shown, [(f"{hopeless}. {sentence}" if hopeless else sentence, table)], folder)


def run_scenarios(options: Options) -> None:
    """Runs a contest on the scenario files of a folder."""
    assert options.scenarios is not None
    with _one_line("--scenarios", options.scenarios):
        if os.path.isfile(options.scenarios):
            raise ValueError(f"{options.scenarios!r} is a file, not a folder; for one scenario use --path")
        contest, courses = own_courses(options.scenarios, options.scale, options.robot or "p3dx")
    _run_contests(options, contest.name, (contest.name,), courses)


def run_public(options: Options) -> None:
    """Runs a public benchmark on its official files."""
    assert options.data is not None
    suite = PUBLIC[options.wanted]
    name = options.mode or next(iter(suite.modes))
    robot = options.robot or ROBOTS[suite.modes[name].robot]
    folder = os.path.abspath(options.data)
    with _one_line("--data", options.data):
        if not os.path.isdir(folder):
            raise ValueError(
                f"{options.data!r} is no folder; it must be the one of the official files; there is none at "
                f"{os.path.abspath(options.data)}"
            )
        if options.scale is None:
            courses = suite.courses(folder, robot)
        else:
            courses = racetrack_courses(folder, robot, options.scale)
    contest = suite.contest(name)
    _run_contests(dataclasses.replace(options, robot=robot), contest.name, (contest.name,), courses)


def run_contest(options: Options) -> None:
    """Runs a contest on its frozen scenarios, or all of them under growing disturbances."""
    name = options.wanted
    contests = tuple(CONTESTS) if name == DISTURBANCES else CROWD_SUITES.get(name, (name,))
    courses: tuple[Course, ...] = ()
    if options.cross:
        contests = (*contests, CROSS.name)
    if options.people:
        contests = people_contests(options.people)
    if name == "crowdnav":
        courses = (Course(name, PUBLIC_SPLIT, name, CLOCK, members=tuple(range(CASES))),)
    _run_contests(options, name, contests, courses)


def _run_contests(options: Options, suite: str, contests: tuple[str, ...], courses: tuple[Course, ...] = ()) -> None:
    """Runs contests, on the frozen scenarios, on courses of the user's own or on those of a public benchmark."""
    with _one_line("--policy", ""):
        own = tuple(own_policy(text) for text in options.own)
    policies = _with_agents(options, [ALL_CONTESTS[name] for name in contests])
    here = dataclasses.replace(
        options,
        suite=suite,
        contests=contests,
        policies=policies,
        entering=own,
        courses=courses,
        on_request="all" in (options.policies or ()),
    )
    differing = (
        ({"scenarios": Path(options.scenarios).resolve().name} if options.scenarios is not None else {})
        | options.differing("kinematic", "lagged")
        | {"gains": options.gains if options.gains != "all" else None}
    )
    folder = options.folder(suite, differing)
    with shared_out(options.processes) as executor:
        tables, findings = contest_report(here, folder, executor, options.processes)
    _tell(options, tables, findings, folder)


def run_papers(options: Options) -> None:
    """Runs a published claim again, and prints the verdict."""
    if options.claim is None:
        raise click.UsageError(f"--suite {PAPERS} needs --claim NAME, one of {', '.join(CLAIMS)}")
    claim = CLAIMS[options.claim]
    if claim.published:
        raise click.UsageError(f"--claim {claim.name} is driven by a study of a clone: {claim.published}")
    if options.train and claim.training is None:
        raise click.UsageError(f"--train: claim {claim.name} has no agent that was trained")
    if bool(claim.data) != bool(options.data):
        need = f"needs --data FOLDER, a folder with {claim.data}" if claim.data else "needs no --data"
        raise click.UsageError(f"--claim {claim.name} {need}")
    differing = {"claim": claim.name, "episodes": options.episodes, "train": options.train or None}
    folder = options.folder(PAPERS, {**differing, "steps": options.steps})
    home = Path(os.path.abspath(options.data)) if options.data else folder / "agents" if options.train else None
    if home is not None and options.train:
        _need("torch", "train")
        try:
            train(claim, home, options.steps)
        except subprocess.CalledProcessError as error:
            raise click.ClickException("the training failed, as said above") from error
    # agents trained anew stand in for those that ship in this process alone
    with shared_out(1 if options.train else options.processes) as executor:
        try:
            rows = list(drive(claim, options.episodes or 0, home, executor))
        except ValueError as error:  # of a claim that is being written
            raise click.ClickException(f"claim {claim.name}: {error}") from error
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / f"{claim.name}.csv", written(rows))
    finding, sides, strata = of_rows(claim, rows)
    for line in lines_of(claim, finding, sides, len(strata)):
        say(line)
    say(f"Episodes: {folder / claim.name}.csv")


RUNS: Mapping[str, Callable[[Options], None]] = {
    QUICK: run_quick,
    "path": run_path,
    "scenarios": run_scenarios,
    OVERVIEW: run_overview,
    DOCUMENTS: run_documents,
    PAPERS: run_papers,
    "contest": run_contest,
}  # by kind


def _with_agents(options: Options, contests: Sequence[Contest]) -> tuple[str, ...] | None:
    """Returns the policies that were named, without trained ones of which no agent is there, beside others.

    A line on stderr names each that is left out; where nothing else is named, the error will.
    """
    if options.names is None or (options.homes and "ppo" in options.names):  # the agents there are its own
        return options.names
    names, left_out = with_agents(contests, options.names, options.robot or ROBOTS["p3dx"], bool(options.own))
    for line in left_out:
        say(f"evaluate: {line}", err=True)
    return names


def _tell(
    options: Options, tables: Sequence[Table], findings: Iterable[tuple[str, Table | None]], folder: Path
) -> None:
    """Prints the result and a small table of each task, with --full every table; the last line names the report."""
    if options.full:
        _print(tables)
    else:
        # who is named stays in sight
        print_short(findings, lines=None if options.names or options.own or options.homes else MOST_LINES)
        say(f"Tables, figures, episodes: {folder}{os.sep}; --full prints the tables.")
    say(f"Report: {folder / REPORT}")


def _run_cases(options: Options, name: str, cases: Sequence[Case], folder: Path) -> tuple[list[Table], Short]:
    """Runs cases of the documents or of a path; returns their tables and what they say."""
    with (
        shared_out(options.processes) as executor,
        _cases_section(options, name, cases, folder, executor, {}) as section,
    ):
        findings = write_page(section.folder / REPORT, f"wayfield: {name}", [section], options.command)
    return list(section.tables), findings


def _settings_of(options: Options, name: str, cases: Sequence[Case]) -> list[Setting]:
    """Returns the settings of cases of the documents or of a path."""
    # the overview is awaited: the plant of its contests is enough there; one's own scenario is driven as in contests
    own = options.kind == "path"
    plants = DYNAMICS[options.dynamics or ("kinematic" if own or options.wanted == OVERVIEW else "both")]
    actuators = options.actuators or ("lagged" if own else "ideal")
    return [
        Setting(name, case, plant, actuators, options.seed, options.episodes or case.episodes)
        for case in cases
        for plant in plants
    ]


@contextlib.contextmanager
def _cases_section(
    options: Options, name: str, cases: Sequence[Case], folder: Path, executor: Executor, done: dict[int, list[Episode]]
) -> Iterator[Section]:
    """Runs cases and writes their files where they are not in the folder yet; yields that, as `contest_section`.

    Args:
        done: receives the episodes of each setting as they come.
    """
    from wayfield.benchmarks.figures.document_figures import draw, stem_of, wanted_figures  # which takes a second

    settings = _settings_of(options, name, cases)
    kinds = dict.fromkeys(stem_of(case.contest) for case in cases)
    films = ("video/*.mp4",) if options.video else ()
    figures = [f"{kind}_*.{suffix}" for kind in kinds for suffix in ("svg", "png")]
    this = Run(name, options.command, (*figures, *films))
    with holding(folder, this), staging(folder, this) as stage, near(executor, options.processes) as here:
        try:
            if executor.remote:  # with its files
                run(settings, [[k] for k in range(len(settings))], lambda work: _apart(executor, work), done)
            else:
                run(settings, together(settings), lambda work: executor.as_done(episodes_together, work), done)
        except ValueError as error:  # a damaged agent
            raise click.ClickException(str(error)) from None
        rows, trajectories = gathered(done)
        write_rows(stage, rows)
        write_trajectories(stage, trajectories)
        write_drives(stage, {k: drive_of(each) for k, each in enumerate(trajectories.values())})
        write_worlds(stage, settings)
        written = read_rows(stage)
        with drawing(here, draw, wanted_figures(stage, written)):
            shown = write_case_tables(stage, written, cases)
            if options.video:
                from wayfield.benchmarks.figures.video import film

                film(stage / "video", cases, settings[0].dynamics, settings[0].actuators, options.seed)
            findings = reproduced(written, cases) if name == DOCUMENTS else ranked(written)
            yield Section(stage, shown, findings)


def _apart(executor: Executor, work: Iterable[Group]) -> Iterator[tuple[int, list[list[Episode]]]]:
    """Yields what becomes of groups of one on other machines, as `AsDone`."""
    for k, rows in executor.as_done(*sent(executor, episodes, [setting for (setting,) in work])):
        yield k, [rows]


def write_case_tables(folder: Path, rows: Episodes, cases: Iterable[Case]) -> list[Table]:
    """Writes the tables of cases into the folder of their run; returns them."""
    shown = document_tables(rows, cases)
    (folder / TABLE).write_text("\n".join(table.markdown() for table in shown), encoding="utf-8")
    return shown


def _begin(executor: Executor, cases: Sequence[Setting], parts: Sequence[Part]) -> None:
    """Hands over all work of the overview at once, so that no process waits for another before the end."""
    if not isinstance(executor, Prefetch):
        return
    left = [part.setting for part in parts if not part.folder.is_dir()]
    work: list[tuple[Any, Group]] = []
    for function, settings in ((episodes_together, cases), (play_together, left)):
        work += [(function, tuple(settings[k] for k in group)) for group in together(settings)]
    for i in heads_first([group[0] for _, group in work]):
        function, group = work[i]
        executor.begin(function, [group])


@contextlib.contextmanager
def _one_line(option: str, value: str) -> Iterator[None]:
    """Turns what is wrong with the value of an option into a line that names the option."""
    try:
        yield
    except OSError as error:
        raise click.UsageError(f"{option} {value!r} cannot be read: {unread(error.filename or value, error)}") from None
    except ValueError as error:
        text = str(error)
        raise click.UsageError(text if text.startswith("--") else f"{option} {text}") from None


def _need(module: str, extra: str) -> None:
    """Refuses to start when an optional dependency is missing, rather than fail at the end."""
    if importlib.util.find_spec(module) is None:
        raise click.ClickException(f"{module} is missing: {installs(extra)}")


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
