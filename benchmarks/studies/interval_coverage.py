"""How often the intervals of the tables hold, measured by simulation: python benchmarks/studies/interval_coverage.py

In made-up populations whose true value is known, samples as large as those of the suites are drawn, and it is counted
how often the interval that a table would show holds that value. Families differ in level and spread, scenarios are
skewed, runs fail, agents differ from each other: as in the suites, or worse.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import click
import numpy as np
import rich.console
from numpy.typing import NDArray

from wayfield.benchmarks.records.progress import tracked
from wayfield.benchmarks.records.results import TABLE
from wayfield.benchmarks.records.run_folder import Run, held, staging
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.statistics.aggregates import counted_interval, interval, iqm, mean
from wayfield.benchmarks.statistics.crossed import LEAST, exact_interval, share_interval
from wayfield.benchmarks.statistics.paired import difference
from wayfield.system.command_line import OneLineErrors
from wayfield.system.executors import cores, workers

Array = NDArray[np.float64]
Ends = tuple[float, float] | None

SUITE = "coverage"
COVERAGE = "coverage.csv"
SIMULATIONS = 1_000
HOLDS = 0.93  # what a 95 % interval must cover to be shown
RESAMPLES = 500  # of each interval, where the tables take more
_MANY_SCENARIOS, _MANY_AGENTS = 2_000, 100  # of each family, from which the true value comes
_FAILURE = 1.0  # m, what a lost path counts as
_CLOCK = 60.0  # s, what a goal that is not reached counts as
_TYPICAL = 9.0  # s, of the goals that are
_SHOWN = (
    "in the standings, path following",
    "in the standings, goal reaching",
    "on the front",
    "in the standings, docking",
    "on the ladder, path following",
    "on the ladder, goal reaching",
)


@dataclasses.dataclass(frozen=True)
class Design:
    """A population, a sample of it, and the interval that is taken of the sample."""

    what: str  # the kind of interval
    where: str
    families: int
    scenarios: int  # of each family
    agents: int  # 1: a policy without training
    draw: Callable[[np.random.Generator, int, int, int], Array]  # families, scenarios, agents -> (f, s, r)
    reduce: Callable[[Array], Array]
    ends: Callable[[Array, list[str], int], Ends]


def errors(lost: float) -> Callable[[np.random.Generator, int, int, int], Array]:
    """Returns a population of RMS errors, m: levels of the families over a decade, skewed, a share of runs lost."""

    def draw(rng: np.random.Generator, families: int, scenarios: int, agents: int) -> Array:
        level = np.linspace(-1.0, 1.0, families)[:, np.newaxis, np.newaxis]
        spread = np.linspace(0.2, 0.8, families)[:, np.newaxis, np.newaxis]
        scenario = rng.normal(size=(families, scenarios, 1))
        agent = 0.15 * rng.normal(size=(1, 1, agents)) if agents > 1 else 0.0
        both = 0.3 * rng.normal(size=(families, scenarios, agents)) if agents > 1 else 0.0
        sample = 0.01 * np.exp(level + spread * scenario + agent + both)
        return np.where(rng.random(sample.shape) < lost, _FAILURE, sample)

    return draw


def successes(failing: float) -> Callable[[np.random.Generator, int, int, int], Array]:
    """Returns a population of successes, 0 or 1: most failures in a few families, agents that differ."""

    def draw(rng: np.random.Generator, families: int, scenarios: int, agents: int) -> Array:
        share = 2.0 * failing * np.linspace(0.0, 1.0, families)[:, np.newaxis, np.newaxis]
        hardness = rng.gamma(1.0, size=(families, scenarios, 1)) if agents > 1 else np.ones((families, scenarios, 1))
        agent = rng.gamma(10.0, 0.1, size=(1, 1, agents)) if agents > 1 else 1.0
        chance = np.minimum(share * hardness * agent, 1.0)
        return (rng.random((families, scenarios, agents)) >= chance).astype(np.float64)

    return draw


def scores(rng: np.random.Generator, families: int, scenarios: int, agents: int) -> Array:
    """Returns a population of scores in 0..1, a success times how near to the best, such as SPL or SCT."""
    won = successes(0.1)(rng, families, scenarios, agents)
    level = np.linspace(0.3, 0.9, families)[:, np.newaxis, np.newaxis]
    return np.clip(level + 0.1 * rng.normal(size=won.shape), 0.0, 1.0) * won


def times(failing: float) -> Callable[[np.random.Generator, int, int, int], Array]:
    """Returns a population of times, s: levels of the families, skewed; a failure counts as the whole clock."""

    def draw(rng: np.random.Generator, families: int, scenarios: int, agents: int) -> Array:
        won = successes(failing)(rng, families, scenarios, agents)
        level = np.linspace(1.6, 2.6, families)[:, np.newaxis, np.newaxis]
        scenario = 0.3 * rng.normal(size=(families, scenarios, 1))
        agent = 0.05 * rng.normal(size=(1, 1, agents)) if agents > 1 else 0.0
        both = 0.1 * rng.normal(size=won.shape) if agents > 1 else 0.0
        return np.where(won == 1.0, np.minimum(np.exp(level + scenario + agent + both), 0.9 * _CLOCK), _CLOCK)

    return draw


def pairs_of_errors(rng: np.random.Generator, families: int, scenarios: int, agents: int) -> Array:
    """Returns a population of differences of errors, m, in the same scenarios."""
    ours, theirs = errors(0.0)(rng, families, scenarios, agents), errors(0.0)(rng, families, scenarios, 1)
    return ours - 1.1 * theirs


def pairs_of_successes(failing: float) -> Callable[[np.random.Generator, int, int, int], Array]:
    """Returns a population of differences of successes, -1 to 1."""

    def draw(rng: np.random.Generator, families: int, scenarios: int, agents: int) -> Array:
        return successes(failing)(rng, families, scenarios, agents) - successes(failing)(rng, families, scenarios, 1)

    return draw


def pairs_of_times(failing: float, other: float) -> Callable[[np.random.Generator, int, int, int], Array]:
    """Returns a population of differences of times, s, of two that fail with different shares."""

    def draw(rng: np.random.Generator, families: int, scenarios: int, agents: int) -> Array:
        return times(failing)(rng, families, scenarios, agents) - times(other)(rng, families, scenarios, 1)

    return draw


def bootstrap(statistic: Callable[[Array], Array]) -> Callable[[Array, list[str], int], Ends]:
    """Returns what the tables show of an error or a score."""

    def ends(values: Array, strata: list[str], seed: int) -> Ends:
        return interval(values, strata, statistic, seed, RESAMPLES)

    return ends


def of_counted(failure: float) -> Callable[[Array, list[str], int], Ends]:
    """Returns what the tables show of a mean in which a failure counts as `failure`, and no success does."""

    def ends(values: Array, strata: list[str], seed: int) -> Ends:
        return counted_interval(values, (values != failure).astype(np.float64), failure, strata, seed, RESAMPLES)

    return ends


def of_pairs(
    reduction: Literal["mean", "iqm", "share"], dearer: float = 0.0
) -> Callable[[Array, list[str], int], Ends]:
    """Returns what the tables show of a paired difference."""

    def ends(values: Array, strata: list[str], seed: int) -> Ends:
        del seed
        change = difference(values, np.zeros((len(values), 1)), strata, reduction, dearer)
        return change.low, change.high

    return ends


def of_shares(values: Array, strata: list[str], seed: int) -> Ends:
    """Returns what the tables show of a share of successes."""
    del seed
    return share_interval(values, strata)


def designs() -> list[Design]:
    """Returns the intervals of the tables, each in samples of the size that the suites have."""
    every = []
    sizes = {(13, 10): _SHOWN[0], (20, 10): _SHOWN[1], (13, 5): _SHOWN[2]}
    for (families, count), where in sizes.items():
        for agents in (1, 10):
            paths = families == 13
            if paths:
                boot = bootstrap(iqm)
                every.append(Design("error, IQM", where, families, count, agents, errors(0.0), iqm, boot))
                every.append(Design("error, IQM, 7 % lost", where, families, count, agents, errors(0.07), iqm, boot))
                pair = of_pairs("iqm")
                every.append(
                    Design("paired difference of errors", where, families, count, agents, pairs_of_errors, iqm, pair)
                )
            else:
                every.append(Design("score, mean", where, families, count, agents, scores, mean, of_counted(0.0)))
    for families, where in ((20, _SHOWN[1]), (5, _SHOWN[3])):
        for agents in (1, 10):
            of_all = families, 10, agents
            for failing in (0.0, 0.02, 0.15):
                name = f"time, {100.0 * (1.0 - failing):.0f} % reached"
                every.append(Design(name, where, *of_all, times(failing), mean, of_counted(_CLOCK)))
            pair, draw = of_pairs("mean", _CLOCK - _TYPICAL), pairs_of_times(0.004, 0.02)
            every.append(Design("paired difference of times, 99.6 and 98 %", where, *of_all, draw, mean, pair))
    for families, count, where in ((13, 10, _SHOWN[0]), (20, 10, _SHOWN[1]), (13, 5, _SHOWN[4]), (20, 5, _SHOWN[5])):
        for agents in (1, 10):
            for failing in (0.01, 0.15):
                of_all = families, count, agents
                name = f"success, {100.0 * (1.0 - failing):.0f} %"
                every.append(Design(name, where, *of_all, successes(failing), mean, of_shares))
                draw = pairs_of_successes(failing)
                every.append(Design(f"paired difference of {name}", where, *of_all, draw, mean, of_pairs("share")))
    return every


def covered(job: tuple[int, int, int]) -> int:
    """Returns how many intervals of a design hold the true value: its index, the simulations, and the seed."""
    index, simulations, seed = job
    design = designs()[index]
    rng = np.random.default_rng([seed, index])
    many = _MANY_AGENTS if design.agents > 1 else 1
    scenarios = _MANY_SCENARIOS * (1 if many > 1 else 20)
    true = float(design.reduce(design.draw(rng, design.families, scenarios, many).ravel()))
    strata = [f"{k}" for k in range(design.families) for _ in range(design.scenarios)]
    held_by = 0
    for k in range(simulations):
        sample = design.draw(rng, design.families, design.scenarios, design.agents)
        ends = design.ends(sample.reshape(len(strata), -1), strata, k)
        assert ends is not None
        held_by += ends[0] <= true <= ends[1]
    return held_by


def coverage_table(count: int, simulations: int, seed: int, command: str) -> Table:
    """Returns the coverage of every design, measured in `count` processes."""
    every = designs()
    with workers(count) as in_parallel:
        wanted = [(k, simulations, seed) for k in range(len(every))]
        shares = list(tracked(in_parallel(covered, wanted), len(wanted), "designs"))
    lines = []
    for design, held_by in zip(every, shares, strict=True):
        low, high = exact_interval(held_by / simulations, simulations)
        who = "a policy" if design.agents == 1 else f"{design.agents} agents"
        cells = [design.what, design.where, f"{design.families} x {design.scenarios}", who]
        lines.append([*cells, f"{100.0 * held_by / simulations:.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"])
    note = (
        f"In {simulations:,} samples of each of these made-up populations, how many of the 95 % intervals held the "
        f"true value; no kind of interval is shown that holds less than {100.0 * HOLDS:.0f} % where a family has "
        f"{LEAST} scenarios, and none where it has fewer. Brackets: Clopper and Pearson's of the measured share. Made "
        f"by `{command}`."
    )
    return Table("How often the intervals hold", ["interval", "where", "scenarios", "of", "covers (%)"], lines, note)


@click.command("coverage", cls=OneLineErrors)
@click.option("--simulations", type=click.IntRange(min=10), default=SIMULATIONS, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--out", metavar="DIR", help="Also write the table there.")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
def main(simulations: int, seed: int, out: str | None, count: int | None) -> None:
    """Measures by simulation how often the intervals of the tables hold what they should."""
    command = "python benchmarks/studies/interval_coverage.py"
    if simulations != SIMULATIONS:
        command += f" --simulations {simulations}"
    if seed:
        command += f" --seed {seed}"
    table = coverage_table(count or cores(), simulations, seed, command)
    if out is not None:
        run = Run(SUITE, command, (COVERAGE,))
        try:
            with held(Path(out), run), staging(Path(out), run) as stage:
                (stage / COVERAGE).write_text(table.csv(), encoding="utf-8")
                (stage / TABLE).write_text(table.markdown(), encoding="utf-8")
        except OSError as error:
            raise click.ClickException(f"--out {out!r} cannot be written: {error}") from None
    rich.console.Console(width=120).print(table.terminal())
    print(table.note)


if __name__ == "__main__":
    main()
