"""What the report says of a contest: its result, with intervals, and the numbers behind its charts."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from wayfield.benchmarks.contests import COST, GAINS_NAMES, OWN_SPLIT, PACE_TOLERANCE, Column, Contest
from wayfield.benchmarks.entrants.own_policies import OWN
from wayfield.benchmarks.leaderboards.disclosure import inputs
from wayfield.benchmarks.leaderboards.entries import (
    COMPARED,
    MAP,
    OFF_PACE,
    Entry,
    by_entry,
    class_words,
    label,
    mean_interval,
    mean_speed,
    off_pace,
    scenarios,
    seeds_driven,
    shown_speed,
    solved_mean_cell,
    success_interval,
    successes,
)
from wayfield.benchmarks.leaderboards.leaderboard import Standings, front_points
from wayfield.benchmarks.leaderboards.leaderboard import ranked as in_order
from wayfield.benchmarks.leaderboards.matrix import Runs, how_often_better
from wayfield.benchmarks.leaderboards.verdicts import (
    EQUIVALENT,
    FEW,
    FIRST,
    OPEN,
    OTHER,
    SCENES,
    SLOWER,
    WORSE,
    Verdict,
    by_scenes,
    judged,
    pairs_table,
)
from wayfield.benchmarks.records.episode import Episodes, text
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.statistics.aggregates import mean
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.scenarios import TIERS

MOST_SMALL = 3  # rivals in the small table

TOO_FEW = "too few scenarios to tell policies apart"

Chart = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Finding:
    """What a contest's episodes say: a sentence, a small table, and charts as plain data."""

    sentence: str
    small: Table
    charts: tuple[Chart, ...]
    duel: Mapping[str, Any]  # the first entry and the next, which the replay opens on


@dataclasses.dataclass(frozen=True)
class _Standing:
    """One entry's share of successes, and what a success comes to."""

    entry: Entry
    access: str
    success: tuple[float, ...]  # value, low and high; the value alone of too few scenarios
    cost: str  # of the successes, with its interval, as tables show it; "" without one
    speed: float  # m/s, mean of the successes
    away: bool  # whether that is off the requested speed
    score: tuple[float, ...]  # the mean of what it is ranked by, where that is neither success nor cost; else nothing


def finding_of(contest: Contest, robot: str, rows: Episodes, named: tuple[str, ...] = ()) -> Finding:
    """Returns the finding of the episodes of one contest and robot: the first entry, on the splits that are ranked.

    The verdicts are those of the table of pairs of the same rows, corrected for all of its lines.

    Args:
        named: policies that the small table shows wherever they come.
    """
    table = pairs_table(rows, "")
    lines = [dict(zip(table.header, line, strict=True)) for line in table.rows]
    verdicts = {(line[SCENES], line[FIRST], line[OTHER]): each for line, each in zip(lines, judged(lines), strict=True)}
    rows = rows.where(split=COMPARED)
    contest = contest.of_rows(rows)
    entries = by_entry(rows)
    sentences = []
    for scenes, mine in by_scenes(contest, rows).items():
        standings = _standings(contest, mine)
        words = _who(standings, {pair[1:]: each for pair, each in verdicts.items() if pair[0] == scenes}, contest)
        sentences.append(f"{scenes[0].upper()}{scenes[1:]}: {words}" if scenes else words)
    # families that gains are not searched in, such as references too fast for the base, would rule a mean over all
    ruled = rows.where(family=contest.tuned_on) or rows if contest.tuned_on else rows
    ranked = _standings(contest, ruled)
    rivals = _rivals(ranked)
    small = _small(contest, robot, rivals, ranked, named)
    without = sorted({*rows.unique("family")} - {*ruled.unique("family")})
    if without:
        small = dataclasses.replace(small, note=f"{small.note} Without {_named(without)}.")
    of, on = _count(len(entries), "entry", "entries"), _count(scenarios(rows), "scenario", "scenarios")
    shown = f" ({len(small.rows)} shown)" if len(small.rows) < len(entries) else ""
    families = _count(len(rows.unique("family")), "family", "families")
    base = robot + class_words(rows[0]["split"])
    sentence = f"{contest.title} with {base}: {of}{shown} on the same {on} of {families}. {' '.join(sentences)}"
    if all(each.endswith(f"{TOO_FEW}.") for each in sentences):  # the table says the rest
        own = OWN_SPLIT in rows.unique("split")  # no suite holds them
        suite = (
            "too few to settle it"
            if own
            else f"for a reliable comparison run `wayfield evaluate --suite {contest.name}`"
        )
        pace = "" if contest.pace is None else f", target speed {contest.pace:g} m/s"
        sentence = f"{contest.title}, {robot}{pace}: {_lead(rivals, contest)} "
        but = f", without {_named(without)}" if without else ""
        sentence += f"(only {_count(scenarios(ruled), 'scenario', 'scenarios')}{but}; {suite})."
    elif len(rivals) < len(ranked):
        above = next(each for each in ranked if MAP in each.access)
        sentence += f" {label(above.entry)} has access to the map, an upper reference: {_achieved(above, contest)}."
    seeds = seeds_driven([rows], contest)
    if "alone" in seeds:
        small = dataclasses.replace(small, note=f"{small.note} Trained agents: {seeds}.")
    charts = (_bars(contest, robot, ranked), _duels(contest, robot, entries), _heat(contest, robot, entries))
    of_policy = {each.entry[0]: each.entry for each in reversed(rivals)}  # the best entry of each
    of_policy = {each.entry[0]: of_policy[each.entry[0]] for each in rivals}  # in their order
    duel = {"contest": contest.name, "robot": robot, "policies": [label(each) for each in of_policy.values()][:2]}
    return Finding(sentence, small, charts, duel)


def _standings(contest: Contest, rows: Episodes) -> list[_Standing]:
    """Returns the entries as they are ranked."""
    entries = in_order(Standings(contest, "", by_entry(rows), ""))
    return [_standing(entry, mine, contest) for entry, mine in entries.items()]


def _rivals(ranked: Sequence[_Standing]) -> list[_Standing]:
    """Returns the entries without those that have access to the map, unless there are no others."""
    return [each for each in ranked if MAP not in each.access] or list(ranked)


def _standing(entry: Entry, rows: Episodes, contest: Contest) -> _Standing:
    column = _scored(contest)
    scores = rows.numbers(column.metric) if column else None
    return _Standing(
        entry,
        rows[0]["knows"],
        (float(rows["success"].mean()), *(success_interval(rows) or ())),
        solved_mean_cell(rows, contest.cost.metric, contest),
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


def _with_ends(values: tuple[float, ...], factor: float, decimals: int) -> str:
    """Returns a value with its interval in brackets, where it has one."""
    value, *ends = (f"{factor * each:.{decimals}f}" for each in values)
    return f"{value} [{ends[0]}, {ends[1]}]" if ends else value


def _achieved(each: _Standing, contest: Contest) -> str:
    success = f"success {_with_ends(each.success, 100.0, 1)} %"
    if not each.cost:
        return success
    unit = "mm" if contest.cost.unit == "m" else contest.cost.unit
    pace = "" if contest.pace is None else f" at {shown_speed(each.speed, 2)} m/s"
    return f"{success}, {contest.cost.name} {each.cost} {unit}{pace}"


def _lead(rivals: Sequence[_Standing], contest: Contest) -> str:
    """Returns the first entry and the next by what sets them apart: success, else the cost."""
    first, *others = rivals
    if not others:
        return f"{label(first.entry)} has no rival, {_achieved(first, contest)}"
    unit = "mm" if contest.cost.unit == "m" else contest.cost.unit
    numbers = [each.cost.partition(" [")[0] for each in (first, others[0])]
    if first.success[0] != others[0].success[0] or not all(numbers):
        unit, numbers = "%", [f"{100.0 * each.success[0]:.0f}" for each in (first, others[0])]
    names = [label(each.entry) for each in (first, others[0])]
    slow = first.away and first.speed < (contest.pace or 0.0)
    verb = f"is slower than asked and comes to {numbers[0]}" if slow else f"leads with {numbers[0]}"
    return f"{names[0]} {verb} {unit}, next {names[1]} with {numbers[1]} {unit}"


def _who(ranked: Sequence[_Standing], verdicts: Mapping[tuple[str, str], Verdict], contest: Contest) -> str:
    """Returns the first entry without access to the map, and how the others stand beside it."""
    rivals = _rivals(ranked)
    best = rivals[0]
    name, won = label(best.entry), _achieved(best, contest)
    if len(rivals) == 1:
        return f"{name} has no rival: {won}."
    outcomes = {}
    for each in rivals[1:]:
        pair = name, label(each.entry)
        outcomes[pair[1]] = (verdicts[pair] if pair in verdicts else verdicts[pair[::-1]].turned).outcome
    if FEW in outcomes.values():
        return f"{name} leads ({won}); {TOO_FEW}."
    of = {
        each: [name for name, verdict in outcomes.items() if verdict == each]
        for each in (EQUIVALENT, OPEN, SLOWER, WORSE)
    }
    sentence = f"{name} leads: {won}; next {label(rivals[1].entry)}: {_achieved(rivals[1], contest)}."
    if behind := of[WORSE]:  # success is ranked by its mean: where it does not decide, one may be faster, or closer
        better = "faster" if contest.cost.unit == "s" else "closer"
        sentence += f" With equivalent success, or a tie, {_named(behind)} {_is(behind)} {better}."
    for verdict, words in ((EQUIVALENT, "Equivalent"), (OPEN, "Tie"), (SLOWER, "At a different speed")):
        if of[verdict]:
            sentence += f" {words}: {_named(of[verdict])}."
    return sentence


def _named(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _is(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _small(
    contest: Contest,
    robot: str,
    rivals: Sequence[_Standing],
    ranked: Sequence[_Standing],
    named: tuple[str, ...],
) -> Table:
    """Returns the small table: the first few and those named, the user's own, trained agents, the best with a map."""
    shown = list(rivals[:MOST_SMALL])
    requested = [each for each in ranked if each.entry[0] in named]
    own = [each for each in ranked if each.entry[1] == OWN or each.entry[1] not in GAINS_NAMES]
    trained = [each for each in ranked if each.entry[1] == "trained"]
    with_map = [each for each in ranked if MAP in each.access]
    for each in (*requested, *own, *trained, *with_map[:1]):
        if each not in shown:
            shown.append(each)
    column = _scored(contest)
    lines = []
    for each in shown:
        score = [_with_ends(each.score, 1.0, 3)] if column else []
        speed = shown_speed(each.speed, 2) + OFF_PACE * each.away
        lines.append([label(each.entry), *score, _with_ends(each.success, 100.0, 1), each.cost, speed])
        lines[-1].append(inputs(each.access, contest.spec.observes))
    cost = contest.cost
    unit = "mm" if cost.unit == "m" else cost.unit
    header = ["policy", *([column.header] if column else []), "success (%)", f"{cost.name} ({unit})", "speed (m/s)"]
    note = (
        f"Ranked by {column.header if column else f'success, then by {cost.name}'}. Brackets: 95 % intervals, where "
        f"there are scenarios enough. {cost.name[0].upper()}{cost.name[1:]} and speed are means over successful runs."
    )
    if left := len(ranked) - len(shown):
        note += f" {left} more in the full table."
    if any(each.away for each in shown):
        note += f" {OFF_PACE}: more than {100.0 * PACE_TOLERANCE:.0f} % off the target speed of {contest.pace:g} m/s; "
        note += "compare its error with care."
    return Table(f"{contest.title}, {robot}", [*header, "inputs"], lines, note)


def _bars(contest: Contest, robot: str, ranked: Sequence[_Standing]) -> Chart:
    """Returns the success of each entry with its interval."""
    rows = [{"label": label(each.entry), "values": [100.0 * value for value in each.success]} for each in ranked]
    return {
        "kind": "bars",
        "title": f"{contest.title}, {robot}: success (%)",
        "unit": "%",
        "decimals": 1,
        "most": 100.0,
        "rows": rows,
    }


def _duels(contest: Contest, robot: str, entries: Mapping[Entry, Episodes]) -> Chart:
    """Returns how often the entry of a line does better than that of a column; a share, and no verdict."""
    runs = [Runs.of(rows, contest) for rows in entries.values()]
    cells: list[list[float | None]] = [[None] * len(runs) for _ in runs]
    for i, a in enumerate(runs):
        for j, b in enumerate(runs[:i]):
            share = how_often_better(a, b).value
            cells[i][j], cells[j][i] = 0.5 + share, 0.5 - share
    return {
        "kind": "duels",
        "title": f"{contest.title}, {robot}: policy against policy",
        "labels": [label(entry) for entry in entries],
        "cells": cells,
    }


def _heat(contest: Contest, robot: str, entries: Mapping[Entry, Episodes]) -> Chart:
    """Returns success and cost of the successes of each entry in each family and in each tier."""
    families, tiers = (
        dict.fromkeys(each for mine in entries.values() for each in mine.unique(name)) for name in ("family", "tier")
    )
    columns = [("family", name) for name in families] + [("tier", name) for name in TIERS if name in tiers]
    cells = []
    for mine in entries.values():
        line = []
        for column, name in columns:
            group = mine.where(**{column: name})
            won = successes(group)
            cost = float(won.numbers(contest.spec.cost.metric).mean()) if won else None
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


def front_chart(contest: Contest, robot: str, rows: Episodes) -> Chart:
    """Returns the speed-accuracy front from the rows of its split; where no run succeeds there is no mean speed."""
    contest = contest.of_rows(rows)
    series = []
    for entry, mine in by_entry(rows).items():
        points = [
            {"x": point.pace, "y": point.error, "low": point.error if math.isnan(point.low) else point.low,
             "high": point.error if math.isnan(point.high) else point.high, "lost": point.lost,
             "asked": text(point.target_speed)}
            for point in front_points(contest, mine) if not math.isnan(point.pace)
        ]  # fmt: skip
        if points:
            series.append({"label": label(entry), "points": points})
    cost = contest.cost
    return {
        "kind": "front",
        "title": f"{contest.title}, {robot}: speed and accuracy",
        "x": "mean speed (m/s)",
        "y": f"{cost.name} ({cost.unit})",
        "log": contest.log_cost,
        "series": series,
    }


def ladder_chart(contest: Contest, robot: str, rows: Episodes) -> Chart:
    """Returns the success of each entry at each level of disturbance."""
    there = rows.unique("disturbance")
    levels = [level for level in LEVELS if level in there]
    series = []
    for entry, mine in by_entry(rows).items():
        points = []
        for k, level in enumerate(levels):
            group = mine.where(disturbance=level)
            share = float(group["success"].mean())
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
