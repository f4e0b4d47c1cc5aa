"""Probability of improvement of every pair of entries of a contest, paired by scenario."""

import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np

from wayfield.benchmarks.contests import Contest
from wayfield.benchmarks.leaderboards.entries import Array, Entry, by_scenario, label
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.statistics.crossed import LEAST
from wayfield.benchmarks.statistics.paired import Difference, advantage, difference, of_pairs


def better_table(contest: Contest, title: str, entries: Mapping[Entry, Episodes], source: str) -> Table:
    """Returns the paired matrix: how often the policy of the line does better than that of the column."""
    runs = {entry: Runs.of(rows, contest) for entry, rows in entries.items()}
    often: dict[tuple[Entry, Entry], str] = {}
    for a, b in itertools.combinations(entries, 2):
        share = how_often_better(runs[a], runs[b]).value
        often[a, b], often[b, a] = f"{0.5 + share:.2f}", f"{0.5 - share:.2f}"
    lines = [[label(a), *(often.get((a, b), "") for b in entries)] for a in entries]
    note = (
        "Share of the scenarios in which the policy of the line does better than that of the column, draws "
        f"counted half: success first, then the lower {contest.cost.name}. A share is no verdict: those are in "
        f"the table of pairs. {source}"
    )
    return Table(f"{title}: better than", ["policy", *map(label, entries)], lines, note)


@dataclasses.dataclass(frozen=True)
class Runs:
    """What a comparison takes of an entry's episodes: tables (s, r), a line a scenario and a column a trained agent.

    The lines stand in the order of the scenarios' names, so that those of two entries are the same scenarios.
    """

    scenarios: list[tuple[str, int]]
    strata: list[str]
    won: Array  # 0 or 1
    measured: Array  # what a success costs; 0 where a run that failed has none

    @classmethod
    def of(cls, rows: Episodes, contest: Contest) -> "Runs":
        """Returns those of the episodes of an entry; ValueError if not every agent has met every scenario once."""
        ordered = rows[np.lexsort((rows["episode"].astype(str), rows["scenario"].astype(str)))]
        won, strata = by_scenario(ordered, ordered["success"])
        measured, _ = by_scenario(ordered, np.nan_to_num(ordered.numbers(contest.cost.metric)))
        places = dict.fromkeys(zip(ordered["scenario"], ordered["episode"].tolist(), strict=True))
        return cls(list(places), strata, won, measured)


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


def cost_difference(a: Runs, b: Runs) -> tuple[Difference, float]:
    """Returns the cost of A less that of B in the scenarios that both solve, and the lesser one of the two there.

    ValueError as `how_often_better`. It is the mean over the scenarios. Families in which both solve fewer than `LEAST`
    are left out; NaN where that leaves none.
    """
    _check_paired(a, b)
    both = (a.won[:, :, np.newaxis] * b.won[:, np.newaxis, :]) == 1.0
    strata = np.asarray(a.strata)
    solved = both.any(axis=(1, 2))
    counted = solved & np.array([(solved & (strata == name)).sum() >= LEAST for name in a.strata], bool)
    if not counted.any():
        return Difference(math.nan, math.nan, math.nan, math.nan), math.nan
    one, other = (
        np.where(both, each, np.nan)[counted] for each in (a.measured[:, :, np.newaxis], b.measured[:, np.newaxis, :])
    )
    pairs = one - other
    # an agent that fails where another of its set succeeds: its place is taken by the mean of the others there
    pairs = np.where(np.isnan(pairs), np.nanmean(pairs, axis=(1, 2), keepdims=True), pairs)
    level = min(float(np.nanmean(each, axis=(1, 2)).mean()) for each in (one, other))
    return of_pairs(pairs, strata[counted].tolist(), "mean"), level


def _check_paired(a: Runs, b: Runs) -> None:
    if a.scenarios != b.scenarios:
        raise ValueError("the two policies have not met the same scenarios: the comparison would not be paired")
