"""What trained agents win, what they lose, and what is not told apart: a line a comparison, none left out.

A claim is a paired difference over the scenarios that both have met, with its interval and a p that is corrected by
Holm's method for all claims of a run. Whoever errs less by driving more slowly has won nothing.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

from wayfield.benchmarks.contests import ALL_CONTESTS, PACE_TOLERANCE, TRAINED, Contest
from wayfield.benchmarks.crossed import LEAST
from wayfield.benchmarks.entries import COMPARED, Entry, by_entry, by_slowness, grouped, label, mean_speed, shown_speed
from wayfield.benchmarks.matrix import (
    ADDED,
    Runs,
    cost_difference,
    cost_unit,
    difference_cells,
    shown_as,
    success_difference,
)
from wayfield.benchmarks.paired import SIGNIFICANT, Difference, holm
from wayfield.benchmarks.results import Row
from wayfield.benchmarks.table import Table

WINS, LOSES, ALIKE, SLOWER = "wins", "loses", "not told apart", "not at one speed"
FEW = "too few scenarios"
VERDICTS = (WINS, LOSES, ALIKE, SLOWER, FEW)


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Trained agents against another entry under one condition."""

    contest: Contest
    condition: str
    agents: Entry
    other: Entry
    knows: str  # what the other is told
    success: Difference
    cost: Difference
    speeds: tuple[float, float]  # m/s, of the agents and of the other

    def of_success(self, p: float) -> str:
        """Returns the verdict on successes, by a corrected p."""
        return _verdict(p, self.success.value > 0.0)

    def of_cost(self, p: float) -> str:
        """Returns the verdict on the cost, by a corrected p."""
        fewer = self.cost.value < 0.0
        found = _verdict(p, fewer)
        ahead, behind = self.speeds if fewer else self.speeds[::-1]
        return SLOWER if found in (WINS, LOSES) and by_slowness(ahead, behind, self.contest) else found


def _verdict(p: float, ahead: bool) -> str:
    if math.isnan(p):
        return FEW
    if p >= SIGNIFICANT:
        return ALIKE
    return WINS if ahead else LOSES


def comparisons(rows: Sequence[Row]) -> Iterator[Comparison]:
    """Yields the agents against every other entry under every condition of a run."""
    for name, of_contest in grouped(rows, "contest").items():
        for robot, mine in grouped(of_contest, "robot").items():
            for condition, here in conditions(ALL_CONTESTS[name], robot, mine).items():
                yield from _against(ALL_CONTESTS[name], condition, by_entry(here))


def conditions(contest: Contest, robot: str, rows: Sequence[Row]) -> Mapping[str, list[Row]]:
    """Returns the rows of each condition in which entries met the same scenarios, by its name."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        if row["split"] not in (*COMPARED, "front"):
            continue
        words = [contest.title, robot]
        if row["split"] == "claims":
            words.append("on the split claims")
        if row.get("speed"):  # a run without a front has no such column
            words.append(f"asked for {row['speed']} m/s")
        if row["disturbance"] != "none":
            words.append(f"{row['disturbance']} disturbance")
        if row["suite"] not in ALL_CONTESTS and row["disturbance"] == "none":
            words.append("undisturbed, fewer scenarios")
        found.setdefault(", ".join(words), []).append(row)
    return found


def _against(contest: Contest, condition: str, entries: Mapping[Entry, list[Row]]) -> Iterator[Comparison]:
    runs = {entry: Runs.of(rows, contest) for entry, rows in entries.items()}
    speeds = {entry: mean_speed(rows) for entry, rows in entries.items()}
    for agents in entries:
        if agents[0] not in TRAINED:
            continue
        for other in entries:
            if other != agents and other[0] not in TRAINED:
                yield Comparison(
                    contest,
                    condition,
                    agents,
                    other,
                    entries[other][0]["knows"],
                    success_difference(runs[agents], runs[other]),
                    cost_difference(runs[agents], runs[other], contest),
                    (speeds[agents], speeds[other]),
                )


HEADER = ("condition", "policy", "against", "is told")
SUCCESS, OF_SUCCESS, COST, OF_COST = "success (points)", "on success", "cost", "on cost"


def claims_table(rows: Sequence[Row], command: str) -> Table:
    """Returns every comparison of trained agents in a run."""
    found = list(comparisons(rows))
    ps = holm([each.p for one in found for each in (one.success, one.cost)])
    lines = []
    for one, p_success, p_cost in zip(found, ps[::2], ps[1::2], strict=True):
        success = difference_cells(one.success, p_success, 100.0, 1)
        cost = difference_cells(one.cost, p_cost, *shown_as(one.contest))
        cost[0] = f"{cost[0]} {cost_unit(one.contest)}"
        speeds = "" if one.contest.pace is None else " / ".join(shown_speed(each, 2) for each in one.speeds)
        names = one.condition, label(one.agents), label(one.other), one.knows
        lines.append([*names, *success, one.of_success(p_success), *cost, one.of_cost(p_cost), speeds])
    note = (
        "The agents less the other, over the scenarios that both met, all training seeds counted: successes in points; "
        "errors (interquartile mean of the differences) and times (mean), failures counted. Brackets: 95 % intervals "
        f"of paired t-tests{ADDED}; agents and scenarios are both a sample. p: corrected by Holm's method for the "
        f"{2 * len(found)} claims of this table, decided under {SIGNIFICANT:g}; none where a family has fewer than "
        f"{LEAST} scenarios. {SLOWER.capitalize()}: who errs less is the slower one by over "
        f"{100.0 * PACE_TOLERANCE:.0f} %; the speeds are the mean speeds of both. Made by `{command}`."
    )
    header = [*HEADER, SUCCESS, "p", OF_SUCCESS, COST, "p of it", OF_COST, "speeds (m/s)"]
    return Table("What trained agents win, and what they do not", header, lines, note)


def summary(lines: Sequence[Row]) -> list[list[str]]:
    """Returns for each condition and its agents whom they beat, lose to, and are not told apart from.

    Args:
        lines: those of a claims table. Success decides; where it does not, the cost does.
    """
    found = []
    for condition, of_condition in grouped(lines, "condition").items():
        for agents, mine in grouped(of_condition, "policy").items():
            sides: dict[str, list[str]] = {verdict: [] for verdict in VERDICTS}
            for line in mine:
                decided = line[OF_SUCCESS] in (WINS, LOSES)
                sides[line[OF_SUCCESS] if decided else line[OF_COST]].append(f"`{line['against']}`")
            told = (sides[WINS], sides[LOSES], sides[ALIKE] + sides[FEW], sides[SLOWER])
            name = f"`{agents.removesuffix(' (trained)')}`"
            found.append([condition, name, *(", ".join(each) or "-" for each in told)])
    return found


SUMMARY_HEADER = ["condition", "agents, all seeds", WINS, LOSES, ALIKE, SLOWER]
