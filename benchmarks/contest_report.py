"""From the options of a contest to its files: which parts are played, what is timed, tabled and drawn."""

import contextlib
import dataclasses
import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.contest import UNFINISHED, clear_parts, finished, run_contest
from wayfield.benchmarks.contest_tables import contest_tables
from wayfield.benchmarks.contests import (
    CONTESTS,
    DISTURBANCES,
    FRONT_SCENARIOS,
    GAINS_NAMES,
    LADDER_SCENARIOS,
    OVERVIEW,
    OVERVIEW_SCENARIOS,
    SPEEDS,
    TRANSFER_SPLIT,
    Contest,
    families,
)
from wayfield.benchmarks.decisions import measured, read_decisions, timed_cases, write_decisions
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.results import TABLE, read_rows, staging, write_rows, write_trajectories
from wayfield.benchmarks.suite import Setting
from wayfield.benchmarks.tables import Table
from wayfield.benchmarks.workers import Map, workers
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.scenarios import splits


@dataclasses.dataclass(frozen=True)
class ContestOptions:
    """What the command line asks of a contest."""

    suite: str
    contests: tuple[str, ...]
    policies: tuple[str, ...] | None  # None: all of the contest
    dynamics: tuple[str, ...]
    actuators: str
    robot: str
    gains_names: tuple[str, ...]
    families: tuple[str, ...] | None  # None: all
    episodes: int | None  # the first scenarios of each family; None: all
    seed: int
    homes: tuple[str, ...] = ()  # folders of training runs that take part

    @property
    def ladder(self) -> bool:
        """Returns whether the run goes over the levels of disturbance."""
        return self.suite == DISTURBANCES

    @property
    def command(self) -> str:
        """Returns the command that makes the same tables."""
        if self.suite == OVERVIEW:
            return "python evaluate.py"
        words = ["python evaluate.py", "--suite", self.suite, "--robot", self.robot, "--actuators", self.actuators]
        if self.policies is not None:
            words += ["--policies", ",".join(self.policies)]
        if self.dynamics != ("kinematic",):
            words += ["--dynamics", "both" if len(self.dynamics) > 1 else self.dynamics[0]]
        if len(self.gains_names) == 1:
            words += ["--gains", *self.gains_names]
        if self.families is not None:
            words += ["--families", ",".join(self.families)]
        if self.episodes is not None:
            words += ["--episodes", str(self.episodes)]
        if self.seed:
            words += ["--seed", str(self.seed)]
        for home in self.homes:
            words += ["--agents", shlex.quote(home)]
        return " ".join(words)

    def names(self, contest: Contest) -> tuple[str, ...]:
        """Returns the policies of a contest that take part."""
        return tuple(name for name in contest.policies if self.policies is None or name in self.policies)

    def settings(self) -> list[Setting]:
        """Returns every part of the run, in the order of the tables.

        Raises:
            click.UsageError: if a policy takes part in none of the contests.
        """
        for name in self.policies or ():
            if all(name not in CONTESTS[each].policies for each in self.contests):
                raise click.UsageError(f"--policies {name!r} takes no part in suite {self.suite!r}")
        for home in self.homes:
            if not home.strip() or Path(home).resolve().name in GAINS_NAMES:
                raise click.UsageError(
                    f"--agents {home!r} needs a name of its own; {', '.join(GAINS_NAMES)} mean something else"
                )
            if not any(list(CONTESTS[each].own_sets(home, self.robot)) for each in self.contests):
                raise click.UsageError(f"--agents {home!r} holds no agents for suite {self.suite!r} and {self.robot}")
        if len({Path(home).resolve().name for home in self.homes}) < len(self.homes):
            raise click.UsageError(f"--agents must differ in their last names, got {', '.join(self.homes)}")
        found = []
        for contest in (CONTESTS[name] for name in self.contests):
            for plant in self.dynamics:
                for family in families(contest, plant):
                    if self.families is None or family in self.families:
                        found += list(self._family(contest, plant, family))
        if not found:
            raise click.UsageError(
                f"--suite {self.suite}: nothing is left to run with these policies, gains, plants and families"
            )
        return found

    def _family(self, contest: Contest, plant: str, family: str) -> Iterator[Setting]:
        """Yields the parts of one family of scenarios."""
        names = self.names(contest)
        # the ladder and the front have one row a policy
        best = ("best",) if len(self.gains_names) > 1 else self.gains_names
        if self.ladder:
            for level in LEVELS:
                cases = contest.cases(self.robot, family, "test", names, best, level, homes=self.homes)
                yield from self._settings(contest, plant, cases, LADDER_SCENARIOS)
            return
        cases = contest.cases(self.robot, family, "test", names, self.gains_names, homes=self.homes)
        if self.suite == OVERVIEW:
            yield from self._settings(contest, plant, cases, OVERVIEW_SCENARIOS)
            return
        yield from self._settings(contest, plant, cases)
        if "tuned" in self.gains_names:
            cases = contest.cases(self.robot, family, TRANSFER_SPLIT, names, ("tuned",), homes=self.homes)
            yield from self._settings(contest, plant, cases)
        if contest.cost != "time":
            for speed in SPEEDS:
                cases = contest.cases(self.robot, family, "test", names, best, speed=speed, homes=self.homes)
                yield from self._settings(contest, plant, cases, FRONT_SCENARIOS)

    def _settings(
        self, contest: Contest, plant: str, cases: Iterable[Case], most: int | None = None
    ) -> Iterator[Setting]:
        """Yields a part for each case, on the first scenarios of its family: all, `most`, or as many as asked for."""
        for case in cases:
            family, split = case.scenario.split("/")
            limits = [len(splits.split(contest.task, family, split)), most, self.episodes]
            count = min(limit for limit in limits if limit is not None)
            yield Setting(self.suite, case, plant, self.actuators, self.seed, count)


def contest_report(options: ContestOptions, folder: Path, count: int) -> list[Table]:
    """Plays a contest in `count` processes, writes its files into the folder, and returns its tables."""
    try:
        settings = options.settings()
    except ValueError as error:  # a damaged split or agent
        raise click.ClickException(str(error)) from None
    with contextlib.ExitStack() as stack:
        try:
            stage = stack.enter_context(staging(folder))
        except OSError as error:
            raise click.ClickException(f"--out {str(folder)!r} cannot be written: {error}") from None
        share = stack.enter_context(workers(count))
        try:
            rows, trajectories = run_contest(settings, folder, share)
        except (KeyboardInterrupt, SystemExit):
            raise Interrupted(folder, len(settings)) from None
        except ValueError as error:  # a damaged agent
            raise click.ClickException(str(error)) from None
        write_rows(stage, rows)
        write_trajectories(stage, trajectories)
        if not options.ladder:
            # after the rest, alone on the machine
            cases = [
                case
                for name in options.contests
                for case in timed_cases(
                    name, options.robot, options.names(CONTESTS[name]), options.gains_names, options.homes
                )
            ]
            write_decisions(stage, measured(cases, batches=(1,), rounds=2))
        tables = write_report(stage, options.command, options.ladder, share)
    clear_parts(folder)
    return tables


class Interrupted(click.ClickException):
    """The run was asked to end; what is finished is kept."""

    exit_code = 130

    def __init__(self, folder: Path, total: int) -> None:
        done = len(finished(folder))
        super().__init__(
            f"interrupted; {done} of {total} parts are kept in {folder / UNFINISHED}: the same command goes on there"
        )


def write_report(folder: Path, command: str, ladder: bool, share: Map) -> list[Table]:
    """Writes tables and figures into a folder, from the files of its run; returns the tables."""
    from wayfield.benchmarks.contest_figures import draw_contest, wanted_figures

    rows = read_rows(folder)
    tables = contest_tables(rows, [] if ladder else read_decisions(folder), command, ladder)
    (folder / TABLE).write_text("\n".join(table.markdown() for table in tables.values()), encoding="utf-8")
    for name, table in tables.items():
        (folder / f"{name}.csv").write_text(table.csv(), encoding="utf-8")
        (folder / f"{name}.tex").write_text(table.latex(), encoding="utf-8")
    wanted = wanted_figures(folder, rows, ladder)
    for _ in tracked(share(draw_contest, wanted), len(wanted), "figures"):
        pass
    return list(tables.values())
