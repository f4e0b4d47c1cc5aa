"""What the report says of a contest: who wins, with intervals, and the numbers behind its charts."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from wayfield.benchmarks.aggregates import iqm, mean
from wayfield.benchmarks.contests import COST, PACE_TOLERANCE, Column, Contest
from wayfield.benchmarks.entries import (
    OFF_PACE,
    Entry,
    by_entry,
    by_slowness,
    costs,
    failing,
    label,
    mean_interval,
    mean_speed,
    off_pace,
    seeds_told,
    shown_speed,
    success_interval,
    values,
)
from wayfield.benchmarks.matrix import Runs, how_often_better, success_difference
from wayfield.benchmarks.paired import SIGNIFICANT, Difference, holm
from wayfield.benchmarks.results import Row
from wayfield.benchmarks.standings import Standings, front_points
from wayfield.benchmarks.standings import ranked as in_order
from wayfield.benchmarks.table import Table
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.scenarios import TIERS

MAP = "map"  # what an upper reference is told
MOST_SMALL = 3  # rivals in the small table

Chart = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Finding:
    """What a contest's episodes say: a sentence, a small table, and charts as plain data."""

    sentence: str
    small: Table
    charts: tuple[Chart, ...]


@dataclasses.dataclass(frozen=True)
class _Standing:
    """One entry's share of successes and its cost, each with its 95 % interval where there are enough scenarios."""

    entry: Entry
    told: str
    success: tuple[float, ...]  # value, low and high; the value alone of too few scenarios
    cost: tuple[float, ...]  # the mean over all runs, by which the full table ranks
    speed: float  # m/s, mean of the successes
    away: bool  # whether that is off the speed that was asked for: such entries stand below the others
    score: tuple[float, ...]  # the mean of what it is ranked by, where that is neither success nor cost; else nothing


def found(contest: Contest, robot: str, rows: Sequence[Row]) -> Finding:
    """Returns the finding of the episodes of one contest and robot, those that entries are ranked on."""
    entries = by_entry(rows)
    standings = {entry: _standing(entry, mine, contest) for entry, mine in entries.items()}
    by_cost = contest.heat.metric == COST
    ranked = [standings[entry] for entry in in_order(Standings(contest, "", entries, ""))]
    rivals = [each for each in ranked if MAP not in each.told] or ranked
    best = rivals[0]
    # of what they are ranked by: who fails more often and is quicker where it succeeds has not drawn
    first, *others = (Runs.of(entries[each.entry], contest) for each in rivals)
    compared = how_often_better if by_cost else success_difference
    ps = holm([compared(first, each).p for each in others])
    # who errs as little by driving slower has not drawn
    level = [each for each, p in zip(rivals[1:], ps, strict=True) if p >= SIGNIFICANT and each.away == best.away]
    told = not any(math.isnan(p) for p in ps)  # of too few scenarios nothing is said
    count = len({(row["scenario"], row["episode"]) for row in rows})
    families = len({row["family"] for row in rows})
    if len(rivals) == 1:
        verdict = f"{label(best.entry)} has no rival: {_achieved(best, contest, by_cost)}."
    else:
        verdict = _who(best, level, contest, by_cost) if told else _first(best, contest, by_cost)
    sentence = (
        f"{contest.title} with {robot}: {_count(len(entries), 'policy', 'policies')} on the same "
        f"{_count(count, 'scenario', 'scenarios')} of {_count(families, 'family', 'families')}. {verdict}"
    )
    if len(rivals) < len(ranked):
        above = next(each for each in ranked if MAP in each.told)
        reference = _achieved(above, contest, by_cost)
        sentence += f" {label(above.entry)}, told the map, is the upper reference: {reference}."
    small, seeds = _small(contest, robot, rivals, level, ranked, by_cost), seeds_told(rows, contest)
    if "alone" in seeds:
        small = dataclasses.replace(small, note=f"{small.note} Trained agents: {seeds}.")
    charts = [_bars(contest, robot, list(standings.values()), by_cost), _duels(contest, robot, entries)]
    charts.append(_heat(contest, robot, entries))
    return Finding(sentence, small, tuple(charts))


def _standing(entry: Entry, rows: Sequence[Row], contest: Contest) -> _Standing:
    cost = costs(rows, contest)
    column = _scored(contest)
    scores = values(rows, column.metric) if column else None
    return _Standing(
        entry,
        rows[0]["knows"],
        (float(values(rows, "success").mean()), *(success_interval(rows) or ())),
        (float(mean(cost)), *(mean_interval(rows, cost, float(values(rows, "failure_cost").mean())) or ())),
        mean_speed(rows),
        off_pace(rows, contest.pace),
        () if scores is None else (float(mean(scores)), *(mean_interval(rows, scores, 0.0) or ())),
    )


def _scored(contest: Contest) -> Column | None:
    """Returns the column that a contest with a score of its own is ranked by; None where success or cost decide."""
    metric = contest.ranked[0][0]
    return None if metric in ("success", COST) else next(each for each in contest.columns if each.metric == metric)


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _with_ends(found: tuple[float, ...], factor: float, decimals: int) -> str:
    """Returns a value with its interval in brackets, where it has one."""
    value, *ends = (f"{factor * each:.{decimals}f}" for each in found)
    return f"{value} [{ends[0]}, {ends[1]}]" if ends else value


def _achieved(each: _Standing, contest: Contest, by_cost: bool) -> str:
    if not by_cost:
        return f"success {_with_ends(each.success, 100.0, 1)} %"
    cost = contest.spec.cost
    return f"{cost.name} {_with_ends(each.cost, 1.0, cost.decimals)} {cost.unit}"


def _who(best: _Standing, level: Sequence[_Standing], contest: Contest, by_cost: bool) -> str:
    won = _achieved(best, contest, by_cost)
    if not level:
        return f"{label(best.entry)} wins: {won}."
    names = [label(each.entry) for each in level]
    with_whom = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    by = "in pairs" if by_cost else "by their success"
    return f"A draw: {label(best.entry)} ({won}) and {with_whom} cannot be told apart {by}."


def _first(best: _Standing, contest: Contest, by_cost: bool) -> str:
    """Returns who comes first where there are too few scenarios to say more."""
    won = _achieved(best, contest, by_cost)
    return f"{label(best.entry)} comes first ({won}); too few scenarios to tell policies apart."


def _small(
    contest: Contest,
    robot: str,
    rivals: Sequence[_Standing],
    level: Sequence[_Standing],
    ranked: Sequence[_Standing],
    by_cost: bool,
) -> Table:
    """Returns the small table: the first few, then the trained agents and the best upper reference."""
    shown = list(rivals[:MOST_SMALL])
    trained = [each for each in ranked if each.entry[1] == "trained"]
    told_map = [each for each in ranked if MAP in each.told]
    shown += [each for more in (trained, told_map[:1]) for each in more if each not in shown]
    cost, decimals = contest.spec.cost, contest.spec.cost.decimals
    column = _scored(contest)
    lines = []
    for each in shown:
        verdict = "first" if each is rivals[0] else "draw" if each in level else ""
        if MAP in each.told and rivals[0].told != each.told:
            verdict = "told map"
        elif each.away and not rivals[0].away:
            verdict = "off speed"
        shares, of_cost = _with_ends(each.success, 100.0, 1), _with_ends(each.cost, 1.0, decimals)
        score = [_with_ends(each.score, 1.0, 3)] if column else []
        speed = shown_speed(each.speed, 2) + OFF_PACE * each.away
        lines.append([label(each.entry), *score, shares, of_cost, speed, verdict])
    name = cost.name if by_cost else f"imputed {cost.name}"
    by = column.header if column else cost.name if by_cost else "success"
    header = ["policy", *([by] if column else []), "success (%)", f"{name} ({cost.unit})", "speed (m/s)", "verdict"]
    note = (
        f"Ranked by {by}. Brackets: 95 % intervals, where there are scenarios enough. "
        f"{name[0].upper()}{name[1:]} is the mean over all runs, a failure counted as {failing(contest)}. Speed is "
        "that of the successes. Draws: not told apart from the first by a paired test, after Holm's correction. "
        f"{len(ranked) - len(shown)} more are in the full table."
    )
    if any(each.away for each in shown):
        note += (
            f" {OFF_PACE}: off the {contest.pace:g} m/s asked for by more than {100.0 * PACE_TOLERANCE:.0f} %; such "
            "entries stand below the others, the nearest to it first, and are not ranked."
        )
    return Table(f"{contest.title}, {robot}", header, lines, note)


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
        "title": f"{contest.title}, {robot}: {name} ({unit})",
        "unit": unit,
        "log": by_cost and contest.log_cost,
        "decimals": cost.decimals if by_cost else 1,
        "most": None if by_cost else 100.0,
        "rows": rows,
    }


def _duels(contest: Contest, robot: str, entries: Mapping[Entry, list[Row]]) -> Chart:
    """Returns how often the entry of a line does better than that of a column, and whether a paired test is sure."""
    runs = [Runs.of(rows, contest) for rows in entries.values()]
    cells: list[list[list[float] | None]] = [[None] * len(runs) for _ in runs]
    pairs: dict[tuple[int, int], Difference] = {}
    for i, a in enumerate(runs):
        for j, b in enumerate(runs[:i]):
            pairs[i, j] = how_often_better(a, b)
    speeds = [mean_speed(rows) for rows in entries.values()]
    for ((i, j), each), p in zip(pairs.items(), holm([each.p for each in pairs.values()]), strict=True):
        ahead, behind = (speeds[i], speeds[j]) if each.value > 0.0 else (speeds[j], speeds[i])
        sure = float(p < SIGNIFICANT and not by_slowness(ahead, behind, contest))
        cells[i][j], cells[j][i] = [0.5 + each.value, sure], [0.5 - each.value, sure]
    return {
        "kind": "duels",
        "title": f"{contest.title}, {robot}: policy against policy",
        "labels": [label(entry) for entry in entries],
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
        "title": f"{contest.title}, {robot}: families and tiers",
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
    """Returns the speed-accuracy front from the rows of its split; where no run succeeds there is no mean speed."""
    series = []
    for entry, mine in by_entry(rows).items():
        points = [
            {"x": point.pace, "y": point.error, "low": point.error if math.isnan(point.low) else point.low,
             "high": point.error if math.isnan(point.high) else point.high, "lost": point.lost, "asked": point.asked}
            for point in front_points(contest, mine) if not math.isnan(point.pace)
        ]  # fmt: skip
        if points:
            series.append({"label": label(entry), "points": points})
    cost = contest.spec.cost
    return {
        "kind": "front",
        "title": f"{contest.title}, {robot}: speed and accuracy",
        "x": "mean speed (m/s)",
        "y": f"typical {cost.name} ({cost.unit})",  # the interquartile mean, as in the table of the front
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
            share = float(values(group, "success").mean())
            low, high = success_interval(group) or (share, share)
            points.append({"x": k, "y": 100 * share, "low": 100 * low, "high": 100 * high, "asked": level})
        series.append({"label": label(entry), "points": points})
    return {
        "kind": "ladder",
        "title": f"{contest.title}, {robot}: under disturbances",
        "x": "level of disturbance",
        "y": "success (%)",
        "log": False,
        "levels": levels,
        "series": series,
    }
