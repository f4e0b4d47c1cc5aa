"""How long a decision takes, for one robot and for many: python -m wayfield.benchmarks.runs.decisions

The policies take turns, round after round, so that a machine that slows down slows all of them. The robots drive while
they are timed, so that the decisions are those of real episodes; only the policy is timed, with the unpacking of the
observation, not the environment.
"""

import csv
import dataclasses
import statistics
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import rich.console
import rich.table

from wayfield.benchmarks.contests import CONTESTS, Entrants
from wayfield.benchmarks.episodes.rollout import make_policy, make_vector
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.progress import tracked
from wayfield.benchmarks.records.results import read_table
from wayfield.envs.robots import Robot
from wayfield.envs.robots.robot_option import robot_option
from wayfield.policies.pilot import Pilot
from wayfield.system.command_line import Names, OneLineErrors
from wayfield.system.readers import of_folder, reader

DECISIONS = "decisions.csv"
BATCHES = (1, 256)
_TIMED = tuple(dict.fromkeys(name for contest in CONTESTS.values() for name in contest.policies))
STEPS = {1: 200, 256: 20}  # decisions of a round


@dataclasses.dataclass(frozen=True)
class Timing:
    """The decision times of a policy at one batch size."""

    case: Case
    batch: int
    median_ms: float  # of one call
    p99_ms: float

    @property
    def per_second(self) -> float:
        """Returns decisions (of one robot each) a second."""
        return self.batch / self.median_ms * 1e3

    @property
    def row(self) -> dict[str, str]:
        """Returns the row of the file."""
        return {
            "policy": self.case.policy,
            "gains_name": self.case.gains_name,
            "robot": str(self.case.env_kwargs["robot"]),
            "batch": str(self.batch),
            "median_ms": f"{self.median_ms:.4f}",
            "p99_ms": f"{self.p99_ms:.4f}",
            "per_second": f"{self.per_second:.0f}",
        }


class _Driver:
    """A policy that drives a batch and is timed; episodes that end begin anew."""

    def __init__(self, case: Case, batch: int) -> None:
        self.case, self.batch = case, batch
        self._env: Any = make_vector(case, "kinematic", "lagged", batch)
        self._pilot = Pilot(make_policy(case, 0), self._env)
        self._observations, _ = self._env.reset(seed=0)
        self._pilot.reset()
        self.times: list[float] = []
        self.drive(3)
        self.times = []

    def drive(self, steps: int) -> None:
        """Takes some steps and notes what each decision took, s."""
        for _ in range(steps):
            start = time.perf_counter()
            actions = self._pilot.command(self._observations)
            self.times.append(time.perf_counter() - start)
            self._observations, _, terminated, truncated, _ = self._env.step(actions)
            if (terminated | truncated).any():
                # in this mode the reset comes with the next step, which moves nothing
                self._observations, *_ = self._env.step(actions)
                self._pilot.reset(np.flatnonzero(terminated | truncated))


def measured(cases: Sequence[Case], batches: Iterable[int] = BATCHES, rounds: int = 3) -> list[Timing]:
    """Returns the decision times of each case at each batch size."""
    drivers = [_Driver(case, batch) for case in cases for batch in batches]
    turns = [driver for _ in range(rounds) for driver in drivers]
    for driver in tracked(turns, len(turns), "timings"):
        driver.drive(STEPS.get(driver.batch, 50))
    return [
        Timing(
            driver.case,
            driver.batch,
            1e3 * statistics.median(driver.times),
            1e3 * float(np.percentile(driver.times, 99.0)),
        )
        for driver in drivers
    ]


def write_decisions(folder: Path, timings: Iterable[Timing]) -> None:
    """Writes the decision times as CSV."""
    rows = [timing.row for timing in timings]
    with open(folder / DECISIONS, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


_SAMPLE = "policy,gains_name,robot,batch,median_ms,p99_ms,per_second\nlqr,default,p3dx,1,0.1,0.2,10000\n"


@reader("decisions", DECISIONS, {DECISIONS: _SAMPLE}, of_folder)
def read_decisions(folder: Path) -> Episodes:
    """Returns the decision times of a run.

    Raises:
        ValueError: if the file is no such table; the message names file and line.
    """
    return read_table(folder / DECISIONS, Episodes.of_lines)


@click.command("decisions", cls=OneLineErrors)
@click.option("--policies", type=Names("--policies", _TIMED), help="Only these.  [default: all]")
@robot_option("Or a data sheet.", default="p3dx", show_default=True)
@click.option("--rounds", type=click.IntRange(min=1), default=3, show_default=True, help="Turns of each policy.")
def main(policies: tuple[str, ...] | None, robot: Robot, rounds: int) -> None:
    """Prints how many decisions each policy takes a second."""
    table = rich.table.Table(title=f"Decisions, {robot}, median of {rounds} rounds", title_justify="left")
    for header in ("policy", "robots", "decisions/s", "median of a call (ms)", "p99 (ms)"):
        table.add_column(header, justify="left" if header == "policy" else "right")
    cases_by_name: dict[tuple[str, str], Case] = {}  # of trained agents one
    for contest in CONTESTS.values():
        names = tuple(name for name in contest.policies if not policies or name in policies)
        for case in contest.cases(
            robot, contest.course(contest.timed_on, "test", robot), Entrants(names, ("default",))
        ):
            cases_by_name[contest.name, case.policy] = case
    cases = list(cases_by_name.values())
    if not cases:
        raise click.UsageError(f"--policies {', '.join(policies or ())} cannot be timed with robot {robot}")
    for timing in measured(cases, rounds=rounds):
        table.add_row(
            timing.case.policy,
            str(timing.batch),
            f"{timing.per_second:,.0f}",
            f"{timing.median_ms:.3f}",
            f"{timing.p99_ms:.3f}",
            end_section=timing.batch == BATCHES[-1],
        )
    rich.console.Console(width=100).print(table)


if __name__ == "__main__":
    main()
