"""What the report says of a contest: who wins, with intervals, and the numbers behind its charts."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from wayfield.benchmarks.aggregates import interval, iqm
from wayfield.benchmarks.contests import COST, OWN_SPLIT, Contest
from wayfield.benchmarks.results import Row
from wayfield.benchmarks.standings import (
    Entry,
    by_entry,
    by_scenario,
    costs,
    front_points,
    how_often_better,
    label,
    success_interval,
    values,
)
from wayfield.benchmarks.table import Table
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.scenarios import TIERS

MAP = "map"  # what an upper reference is told
MOST_SMALL = 5  # lines of the small table

Chart = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Finding:
    """What a contest's episodes say: a sentence, a small table, and charts as plain data."""

    sentence: str
    small: Table
    charts: tuple[Chart, ...]


@dataclasses.dataclass(frozen=True)
class _Standing:
    """One entry's share of successes and its cost, each with its 95 % interval."""

    entry: Entry
    told: str
    success: tuple[float, float, float]
    cost: tuple[float, float, float]
    speed: float  # m/s, of the successes


def found(contest: Contest, robot: str, rows: Sequence[Row]) -> Finding:
    """Returns the finding of the episodes of one contest and robot, those that entries are ranked on.

    Where each family has one scenario, a resample within families would draw the same again: all are one stratum then.
    """
    if len({_scenario(row) for row in rows}) == len({row["family"] for row in rows}):
        rows = [row | {"split": OWN_SPLIT} for row in rows]
    entries = by_entry(rows)
    standings = {entry: _standing(entry, mine, contest) for entry, mine in entries.items()}
    by_cost = contest.heat.metric == COST
    ranked = sorted(standings.values(), key=lambda each: _rank(each, by_cost))
    rivals = [each for each in ranked if MAP not in each.told] or ranked
    best = rivals[0]
    level = []
    for each in rivals[1:]:
        _, low, high = how_often_better(entries[best.entry], entries[each.entry], contest)
        if low <= 0.5 <= high:
            level.append(each)
    count = len({_scenario(row) for row in rows})
    families = len({row["family"] for row in rows})
    sentence = (
        f"{contest.spec.title} with {robot}: {len(entries)} policies on the same {count} scenarios of {families} "
        f"families. {_who(best, level, contest, by_cost)}"
    )
    if len(rivals) < len(ranked):
        above = min((each for each in ranked if MAP in each.told), key=lambda each: _rank(each, by_cost))
        achieved = _achieved(above, contest, by_cost)
        sentence += f" {label(above.entry)}, which is told the map, is the upper reference: {achieved}."
    charts = [_bars(contest, robot, list(standings.values()), by_cost), _duels(contest, robot, entries)]
    charts.append(_heat(contest, robot, entries))
    return Finding(sentence, _small(contest, robot, rivals, level, ranked, by_cost), tuple(charts))


def _scenario(row: Row) -> tuple[str, str]:
    return row["scenario"], row["episode"]


def _rank(each: _Standing, by_cost: bool) -> tuple[float, float]:
    return (each.cost[0], -each.success[0]) if by_cost else (-each.success[0], each.cost[0])


def _standing(entry: Entry, rows: Sequence[Row], contest: Contest) -> _Standing:
    cost = costs(rows, contest)
    won = [row for row in rows if row["success"] == "1"]
    return _Standing(
        entry,
        rows[0]["knows"],
        (float(values(rows, "success").mean()), *success_interval(rows)),
        (float(iqm(cost)), *interval(*by_scenario(rows, cost), iqm)),
        float(iqm(values(won, "mean_speed"))) if won else math.nan,
    )


def _achieved(each: _Standing, contest: Contest, by_cost: bool) -> str:
    if not by_cost:
        share, low, high = (100.0 * value for value in each.success)
        return f"{share:.1f} % success [{low:.1f}, {high:.1f}]"
    unit, decimals = contest.spec.cost.unit, contest.spec.cost.decimals
    found, least, most = (f"{value:.{decimals}f}" for value in each.cost)
    return f"{contest.spec.cost.name} {found} {unit} [{least}, {most}]"


def _who(best: _Standing, level: Sequence[_Standing], contest: Contest, by_cost: bool) -> str:
    won = _achieved(best, contest, by_cost)
    if not level:
        return f"{label(best.entry)} wins: {won}."
    names = [label(each.entry) for each in level]
    with_whom = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"A draw: {label(best.entry)} ({won}) and {with_whom} cannot be told apart in pairs."


def _small(
    contest: Contest,
    robot: str,
    rivals: Sequence[_Standing],
    level: Sequence[_Standing],
    ranked: Sequence[_Standing],
    by_cost: bool,
) -> Table:
    """Returns the small table: the first few, then the trained agents and the upper reference where they are not."""
    shown = list(rivals[:MOST_SMALL])
    shown += [each for each in ranked if each not in shown and (each.entry[1] == "trained" or MAP in each.told)][:2]
    cost, decimals = contest.spec.cost, contest.spec.cost.decimals
    lines = []
    for each in shown:
        verdict = "first" if each is rivals[0] else "draw" if each in level else ""
        if MAP in each.told and rivals[0].told != each.told:
            verdict = "told map"
        share, low, high = (100.0 * value for value in each.success)
        of_cost = "{:.{d}f} [{:.{d}f}, {:.{d}f}]".format(*each.cost, d=decimals)
        lines.append([label(each.entry), f"{share:.1f} [{low:.1f}, {high:.1f}]", of_cost, f"{each.speed:.2f}", verdict])
    header = ["policy", "success (%)", f"{cost.name} ({cost.unit})", "speed (m/s)", "verdict"]
    note = (
        f"Ranked by {cost.name if by_cost else 'success'}. Brackets: 95 % intervals. {cost.name} is the interquartile "
        f"mean over all episodes, a failure counted as {contest.counted}. Speed is of the successes. "
        "Draws: pairs whose interval holds one half. "
        f"{len(ranked) - len(shown)} more are in the full table."
    )
    return Table(f"{contest.spec.title}, {robot}", header, lines, note)


def _bars(contest: Contest, robot: str, standings: Sequence[_Standing], by_cost: bool) -> Chart:
    """Returns success, or the cost where that tells entries apart, of each entry with its interval."""
    cost = contest.spec.cost
    unit, name, factor = (cost.unit, cost.name, 1.0) if by_cost else ("%", "success", 100.0)
    rows = [
        {"label": label(each.entry), "values": [factor * value for value in (each.cost if by_cost else each.success)]}
        for each in standings
    ]
    return {
        "kind": "bars",
        "title": f"{contest.spec.title}, {robot}: {name} ({unit})",
        "unit": unit,
        "log": by_cost and contest.log_cost,
        "decimals": cost.decimals if by_cost else 1,
        "most": None if by_cost else 100.0,
        "rows": rows,
    }


def _duels(contest: Contest, robot: str, entries: Mapping[Entry, list[Row]]) -> Chart:
    """Returns how often the entry of a line does better than that of a column, with intervals."""
    names = list(entries)
    cells: list[list[list[float] | None]] = [[None] * len(names) for _ in names]
    for i, a in enumerate(names):
        for j in range(i):
            often, low, high = how_often_better(entries[a], entries[names[j]], contest)
            cells[i][j] = [often, low, high]
            cells[j][i] = [1.0 - often, 1.0 - high, 1.0 - low]
    return {
        "kind": "duels",
        "title": f"{contest.spec.title}, {robot}: policy against policy",
        "labels": [label(entry) for entry in names],
        "cells": cells,
    }


def _heat(contest: Contest, robot: str, entries: Mapping[Entry, list[Row]]) -> Chart:
    """Returns success and cost of the successes of each entry in each family and in each tier."""
    rows = [row for mine in entries.values() for row in mine]
    columns = [("family", name) for name in dict.fromkeys(row["family"] for row in rows)]
    columns += [("tier", name) for name in TIERS if any(row["tier"] == name for row in rows)]
    cells = []
    for mine in entries.values():
        line = []
        for column, name in columns:
            group = [row for row in mine if row[column] == name]
            won = [row for row in group if row["success"] == "1"]
            cost = float(iqm(values(won, contest.spec.cost.metric))) if won else None
            line.append([len(won), len(group), cost])
        cells.append(line)
    return {
        "kind": "heat",
        "title": f"{contest.spec.title}, {robot}: families and tiers",
        "contest": contest.name,
        "robot": robot,
        "by_cost": contest.heat.metric == COST,
        "factor": contest.heat.factor,
        "decimals": contest.heat.decimals,
        "what": contest.heat.title,
        "ends": list(contest.heat.ends),
        "labels": [label(entry) for entry in entries],
        "columns": [list(column) for column in columns],
        "cells": cells,
    }


def front_chart(contest: Contest, robot: str, rows: Sequence[Row]) -> Chart:
    """Returns the speed-accuracy front from the rows of its split."""
    series = []
    for entry, mine in by_entry(rows).items():
        points = [
            {"x": point.pace, "y": point.error, "low": point.low, "high": point.high, "lost": point.lost,
             "asked": point.asked}
            for point in front_points(contest, mine)
        ]  # fmt: skip
        series.append({"label": label(entry), "points": points})
    cost = contest.spec.cost
    return {
        "kind": "front",
        "title": f"{contest.spec.title}, {robot}: speed and accuracy",
        "x": "mean speed (m/s)",
        "y": f"{cost.name} ({cost.unit})",
        "log": contest.log_cost,
        "series": series,
    }


def ladder_chart(contest: Contest, robot: str, rows: Sequence[Row]) -> Chart:
    """Returns the success of each entry at each level of disturbance."""
    levels = [level for level in LEVELS if any(row["disturbance"] == level for row in rows)]
    series = []
    for entry, mine in by_entry(rows).items():
        points = []
        for k, level in enumerate(levels):
            group = [row for row in mine if row["disturbance"] == level]
            low, high = success_interval(group)
            share = float(values(group, "success").mean())
            points.append({"x": k, "y": 100 * share, "low": 100 * low, "high": 100 * high, "asked": level})
        series.append({"label": label(entry), "points": points})
    return {
        "kind": "ladder",
        "title": f"{contest.spec.title}, {robot}: under disturbances",
        "x": "level of disturbance",
        "y": "success (%)",
        "log": False,
        "levels": levels,
        "series": series,
    }
