"""Who does better than whom: every pair of entries of a contest, in the scenarios that both met."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from wayfield.benchmarks.contests import PACE_TOLERANCE, Contest
from wayfield.benchmarks.entries import (
    OFF_PACE,
    Array,
    Entry,
    by_scenario,
    by_slowness,
    label,
    mean_speed,
    scenario,
    values,
)
from wayfield.benchmarks.paired import SIGNIFICANT, Difference, advantage, difference, holm
from wayfield.benchmarks.results import Row
from wayfield.benchmarks.table import Table

ADDED = ", with two scenarios added to successes and times, in which one of the two fails"


def better_table(contest: Contest, title: str, entries: Mapping[Entry, list[Row]], source: str) -> Table:
    """Returns the paired matrix: how often the policy of the line does better than that of the column."""
    pairs = list(itertools.combinations(entries, 2))
    runs = {entry: Runs.of(rows, contest) for entry, rows in entries.items()}
    found = [how_often_better(runs[a], runs[b]) for a, b in pairs]
    decided = [p < SIGNIFICANT for p in holm([each.p for each in found])]  # of NaN it is false
    speeds = {entry: mean_speed(rows) for entry, rows in entries.items()}
    often: dict[tuple[Entry, Entry], str] = {}
    for (a, b), each, sure in zip(pairs, found, decided, strict=True):
        ahead, behind = (a, b) if each.value > 0.0 else (b, a)
        mark = "*" * sure
        if sure and by_slowness(speeds[ahead], speeds[behind], contest):
            mark = OFF_PACE
        often[a, b] = f"{0.5 + each.value:.2f}{mark}"
        often[b, a] = f"{0.5 - each.value:.2f}{mark}"
    lines = [[label(a), *(often.get((a, b), "") for b in entries)] for a in entries]
    slower = (
        ""
        if contest.pace is None
        else f" {OFF_PACE} in its place: who does better is the slower one by over {100.0 * PACE_TOLERANCE:.0f} %."
    )
    note = (
        "Share of the scenarios in which the policy of the line does better than that of the column, draws "
        f"counted half: success first, then the lower {contest.spec.cost.name}; a star marks a paired test whose p, "
        f"corrected by Holm's method for the {len(pairs)} pairs of this table, is under {SIGNIFICANT:g}."
        f"{slower} {source}"
    )
    return Table(f"{title}: better than", ["policy", *map(label, entries)], lines, note)


def difference_table(contest: Contest, title: str, entries: Mapping[Entry, list[Row]], source: str) -> Table:
    """Returns every pair's difference of successes and of costs with its interval and its corrected p."""
    pairs = list(itertools.combinations(entries, 2))
    runs = {entry: Runs.of(rows, contest) for entry, rows in entries.items()}
    of_success = [success_difference(runs[a], runs[b]) for a, b in pairs]
    of_cost = [cost_difference(runs[a], runs[b], contest) for a, b in pairs]
    ps = [holm([each.p for each in column]) for column in (of_success, of_cost)]
    lines = []
    for k, (a, b) in enumerate(pairs):
        cells = difference_cells(of_success[k], ps[0][k], 100.0, 1)
        cells += difference_cells(of_cost[k], ps[1][k], *shown_as(contest))
        lines.append([label(a), label(b), *cells])
    unit = cost_unit(contest)
    note = (
        "The first policy less the second, over the scenarios that both met: successes in points, "
        f"{contest.spec.cost.name} in {unit}, {kind_of_mean(contest)} of the differences, a failure counted. Brackets: "
        f"95 % intervals of the paired t-test{ADDED}; p corrected by Holm's method for the {len(pairs)} pairs. {source}"
    )
    header = ["policy", "less", "success (points)", "p of it", f"{contest.spec.cost.name} ({unit})", "p of this"]
    return Table(f"{title}: paired differences", header, lines, note)


def shown_as(contest: Contest) -> tuple[float, int]:
    """Returns the factor and the decimals with which differences of cost are shown."""
    return (1e3, 2) if contest.spec.cost.unit == "m" else (1.0, 2)


def cost_unit(contest: Contest) -> str:
    """Returns the unit in which differences of cost are shown."""
    return "mm" if contest.spec.cost.unit == "m" else contest.spec.cost.unit


def kind_of_mean(contest: Contest) -> str:
    """Returns how differences of cost are reduced, in words."""
    return "mean" if contest.spec.cost.unit == "s" else "interquartile mean"


@dataclasses.dataclass(frozen=True)
class Runs:
    """What a comparison takes of an entry's episodes: tables (s, r), a line a scenario and a column a trained agent.

    The lines stand in the order of the scenarios' names, so that those of two entries are the same scenarios.
    """

    scenarios: list[tuple[str, str]]
    strata: list[str]
    won: Array  # 0 or 1
    measured: Array  # what a success costs; 0 where a run that failed has none
    failing: Array  # what a failure counts as

    @classmethod
    def of(cls, rows: Sequence[Row], contest: Contest) -> "Runs":
        """Returns those of the episodes of an entry; ValueError if not every agent has met every scenario once."""
        ordered = sorted(rows, key=scenario)
        won, strata = by_scenario(ordered, values(ordered, "success"))
        measured, _ = by_scenario(ordered, np.nan_to_num(values(ordered, contest.spec.cost.metric)))
        failing, _ = by_scenario(ordered, values(ordered, "failure_cost"))
        return cls(list(dict.fromkeys(map(scenario, ordered))), strata, won, measured, failing)

    @property
    def costs(self) -> Array:
        """Returns the cost of each run, failures counted."""
        return np.where(self.won == 1.0, self.measured, self.failing)


def how_often_better(a: Runs, b: Runs) -> Difference:
    """Returns by how much A beats B more often than in half of the scenarios that both met.

    Raises:
        ValueError: if the two have not met the same scenarios.
    """
    _check_paired(a, b)
    return advantage(a.won, a.measured, b.won, b.measured, a.strata)


def success_difference(a: Runs, b: Runs) -> Difference:
    """Returns the share of successes of A less that of B; ValueError as `how_often_better`."""
    _check_paired(a, b)
    return difference(a.won, b.won, a.strata, "share")


def cost_difference(a: Runs, b: Runs, contest: Contest) -> Difference:
    """Returns the cost of A less that of B, failures counted; ValueError as `how_often_better`.

    Of times it is the mean. Of errors it is the interquartile mean: a failure counts as a hundred times what others
    err, and a mean would be that of the failures, which `success_difference` tells.
    """
    _check_paired(a, b)
    if contest.spec.cost.unit != "s":
        return difference(a.costs, b.costs, a.strata, "iqm")
    taken = np.concatenate([each.measured[each.won == 1.0] for each in (a, b)])
    failing = np.concatenate([each.failing.ravel() for each in (a, b)])
    dearer = float(failing.mean() - taken.mean()) if len(taken) else 0.0
    return difference(a.costs, b.costs, a.strata, "mean", dearer)


def _check_paired(a: Runs, b: Runs) -> None:
    if a.scenarios != b.scenarios:
        raise ValueError("the two policies have not met the same scenarios: the comparison would not be paired")


def difference_cells(found: Difference, corrected: float, factor: float, decimals: int) -> list[str]:
    """Returns the cells of a difference: its value with its interval, and its corrected p."""
    value = f"{factor * found.value:+.{decimals}f}"
    if math.isnan(found.low):
        return [value, ""]
    return [f"{value} [{factor * found.low:+.{decimals}f}, {factor * found.high:+.{decimals}f}]", shown_p(corrected)]


def shown_p(p: float) -> str:
    """Returns a p as it is shown."""
    return "" if math.isnan(p) else "< 0.001" if p < 1e-3 else f"{p:.3f}"
