"""A contest as a function: policies in, rows and tables out, nothing written."""

import concurrent.futures
import contextlib
import dataclasses
import importlib.util
import os
import warnings
from collections.abc import Iterable, Iterator
from typing import Any

from wayfield import policies as registry
from wayfield.benchmarks.commands.contest_options import Options, WrongOption
from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, GAINS
from wayfield.benchmarks.contests.contest import with_agents
from wayfield.benchmarks.entrants.own_policies import own_object, own_policy
from wayfield.benchmarks.entrants.own_scenario import own_courses
from wayfield.benchmarks.leaderboards.entries import COMPARED
from wayfield.benchmarks.leaderboards.leaderboard import contest_tables
from wayfield.benchmarks.records.cases import Entrant
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.runs.payloads import sent
from wayfield.benchmarks.runs.shards import played
from wayfield.benchmarks.runs.suite import Setting
from wayfield.envs.robots import ACTUATORS, AnyRobot, robot_of
from wayfield.envs.tasks.task import IN_PROCESS
from wayfield.policies.registry import RENAMED
from wayfield.system import checks
from wayfield.system.executors import Executor, Failed
from wayfield.system.executors import workers as processes


@dataclasses.dataclass(frozen=True)
class Comparison:
    """What a comparison found."""

    episodes: Episodes
    tables: dict[str, Table]  # as a contest's, by the names that their files would have

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Returns a dict for each episode: numbers as numbers, NaN where one does not apply, names as text."""
        return list(map(dict, self.episodes))

    def frame(self) -> Any:
        """Returns the rows as a pandas DataFrame, or as they are where pandas is not installed."""
        if importlib.util.find_spec("pandas") is None:
            return self.rows
        import pandas

        return pandas.DataFrame({name: self.episodes[name] for name in self.episodes.names})


def compare(
    policies: Iterable[Any],
    contest: str | os.PathLike[str] = "goal-obstacles",
    families: Iterable[str] | None = None,
    episodes: int | None = None,
    robot: AnyRobot = "p3dx",
    dynamics: str = "kinematic",
    actuators: str = "lagged",
    gains: str = "best",
    seed: int = 0,
    workers: int | concurrent.futures.Executor = 1,
) -> Comparison:
    """Returns how policies do against each other in the same scenarios. Nothing is written.

    A trained policy of which no agent ships for the robot is left out beside others, with a UserWarning.

    Args:
        policies: names of POLICIES, objects with the four members of `Policy`, "module:Class key=value ...", or the
            model.zip of stable-baselines3, which can run code when it is loaded.
        contest: a name of CONTESTS, such as "path-following", or a folder of scenario files.
        families: of the test split; None: all.
        robot: the name of one that ships, the .json file of a data sheet, or a `wayfield.envs.robots.Robot`.
        episodes: the first of each family; None: all. Of a file, how often it is driven; None: once.
        gains: of policies that are named: "best", which is the tuned ones where there are any, "default", "tuned",
            "paper" or "all".
        workers: processes that share the work; with several, objects must be such as can be pickled. Or an executor,
            wherever it takes the work: `distributed.Client(...).get_executor()`, one of submitit, mpi4py or Ray, or of
            `concurrent.futures`. Files that are named travel along.

    Raises:
        ValueError: if an argument names nothing that there is, or a policy cannot take part; the message names it.
        OSError: if a folder or a file cannot be read.
        wayfield.system.executors.Failed: if parts failed twice with an executor; all others are done, and their rows
            are in its `done`.
    """
    for field, value, choices in (
        ("dynamics", dynamics, IN_PROCESS),
        ("actuators", actuators, ACTUATORS),
        ("gains", gains, GAINS),
    ):
        checks.choose(field, value, choices)
    robot = robot_of(robot)
    checks.whole("seed", seed, 0, 2**31 - 1)
    if not isinstance(workers, concurrent.futures.Executor):
        checks.whole("workers", workers, 1)
    if episodes is not None:
        checks.whole("episodes", episodes, 1)
    if isinstance(contest, os.PathLike) or os.path.isdir(contest):
        of_folder, courses = own_courses(os.fspath(contest), None, robot)
        if families is not None:
            raise WrongOption("families belong to the frozen scenarios; of a folder each file is a family")
        name = of_folder.name
    else:
        checks.choose("contest", contest, CONTESTS)
        name, courses = contest, ()
    names, own = _sorted_out(policies)
    names, left_out = with_agents([ALL_CONTESTS[name]], names, robot, bool(own))
    for line in left_out:
        warnings.warn(line, UserWarning, stacklevel=2)
    options = Options(
        suite=name,
        contests=(name,),
        policies=names,
        dynamics=dynamics,
        actuators=actuators,
        robot=robot,
        gains=gains,
        families=tuple(families) if families is not None else None,
        episodes=episodes,
        seed=seed,
        entering=own,
        courses=courses,
        command="wayfield.benchmarks.compare",
    )
    settings = [setting for setting in options.settings() if _ranked(setting)]
    there = (
        contextlib.nullcontext(Executor.of(workers))
        if isinstance(workers, concurrent.futures.Executor)
        else processes(workers)
    )
    failures: list[Failed] = []
    with there as executor:
        rows = Episodes(_in_order(executor, settings, failures))
    for failed in failures:
        failed.done = rows
        raise failed
    return Comparison(rows, contest_tables(rows, [], options.command, ladder=False))


def _in_order(executor: Executor, settings: list[Setting], failures: list[Failed]) -> Iterator[Row]:
    """Yields the rows of settings in their order, each as soon as it can be; notes what failed and leaves it out."""
    early: dict[int, list[Row]] = {}
    place = 0
    try:
        for k, rows in executor.as_done(*sent(executor, _rows, settings)):
            early[k] = rows
            while place in early:
                yield from early.pop(place)
                place += 1
    except Failed as failed:
        failures.append(failed)
    for k in sorted(early):
        yield from early[k]


def _sorted_out(given: Iterable[Any]) -> tuple[tuple[str, ...], tuple[Entrant, ...]]:
    """Returns the names of policies of the package, and the others.

    Raises:
        ValueError: if one is neither.
    """
    if isinstance(given, str):
        raise WrongOption(f"policies is {given!r}; it must be a list of policies")
    names: list[str] = []
    own: list[Entrant] = []
    count: dict[type, int] = {}
    for each in given:
        if not isinstance(each, str | os.PathLike):
            count[type(each)] = count.get(type(each), 0) + 1
            own.append(own_object(each, count[type(each)]))
        elif ":" in os.fspath(each) or os.fspath(each).lower().endswith(".zip"):
            own.append(own_policy(os.fspath(each)))
        else:
            name = RENAMED.get(os.fspath(each), os.fspath(each))
            checks.choose("policies", name, registry.POLICIES)
            names.append(name)
    if not names and not own:
        raise WrongOption("policies is empty; it must name at least one policy")
    return tuple(dict.fromkeys(names)), tuple(own)


def _ranked(setting: Setting) -> bool:
    """Returns whether a setting is one of the comparison itself, not of the front or of the split for tuning."""
    return setting.case.speed is None and setting.case.split in COMPARED


def _rows(setting: Setting) -> list[Row]:
    return [row for row, _ in played(setting)]
