"""The tables of a contest, cell by cell, in plain loops over rows at random."""

import itertools
import json
import math
import statistics
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest
from oracles.drawn_tables import (
    COMMAND,
    FRONT,
    NAN,
    TIERS,
    cell_of,
    costs_of,
    groups,
    in_order,
    is_off,
    named,
    number,
    rows_of,
    short_of,
    shown_pace,
    solved_of,
    speed_of,
    table_of,
    told,
    typical_of,
    won_told,
)

from wayfield.benchmarks.contests import CONTESTS, Contest
from wayfield.benchmarks.leaderboards import verdicts
from wayfield.benchmarks.leaderboards.entries import success_cell
from wayfield.benchmarks.leaderboards.leaderboard import contest_tables
from wayfield.benchmarks.leaderboards.matrix import Runs, success_difference
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.report import findings
from wayfield.benchmarks.statistics.aggregates import better, interval, iqm
from wayfield.benchmarks.statistics.paired import holm
from wayfield.envs.robots.disturbances import LEVELS


@pytest.fixture(
    scope="module",
    params=[("path-following", 0), ("path-following", 1), ("goal-obstacles", 1), ("docking", 0)],
    ids=str,
)
def drawn(request: pytest.FixtureRequest) -> tuple[Contest, list[dict[str, str]], dict[str, Table]]:
    """Returns a contest, its rows, and its tables."""
    contest = CONTESTS[request.param[0]]
    rows = rows_of(contest, request.param[1])
    decided = [
        {"policy": "B", "gains_name": "default", "robot": "p3dx", "batch": "1", "p99_ms": "0.4567"},
        {"policy": "B", "gains_name": "default", "robot": "p3dx", "batch": "256", "p99_ms": "9.9"},
        {"policy": "C", "gains_name": "default", "robot": "omni3", "batch": "1", "p99_ms": "8.8"},
    ]
    return contest, rows, contest_tables(rows, decided, COMMAND, ladder=False)


def pieces(drawn: Any) -> tuple[Contest, dict[tuple[str, str], list[Any]], dict[str, Table], str]:
    """Returns the contest, the rows of the test split by entry, and the tables by what their names end in."""
    contest, rows, tables = drawn
    stem = f"{contest.name.replace('-', '_')}_p3dx"
    assert all(name.startswith(stem) for name in tables)
    short = {name.removeprefix(stem).removeprefix("_"): table for name, table in tables.items()}
    title = f"{contest.spec.title}, p3dx, lagged actuators, kinematic plant"
    return contest, groups([row for row in rows if row["split"] == "test"]), short, title


def test_a_run_has_every_table_that_its_rows_allow(drawn: Any) -> None:
    contest, entries, tables, title = pieces(drawn)
    assert list(tables) == [
        *("", "board", "told", "families", "tiers", "better", "pairs", "front", "seeds", "claims"),
    ]
    made = f"Made by `{COMMAND}`, wayfield {version('wayfield')}."
    for name, table in tables.items():
        known = {"claims": "What trained agents win", "pairs": "Every pair"}
        assert table.title.startswith(known.get(name, title)), name
        assert (f"Made by `{COMMAND}`." if name in known else made) in table.note, name
        assert all(len(row) == len(table.header) for row in table.rows), name
    rows = [row for row in drawn[1] if row["split"] == "test" and row["policy"] != "ppo"]
    untiered = contest_tables([row | {"tier": ""} for row in rows], [], COMMAND, ladder=False)
    stem = f"{contest.name.replace('-', '_')}_p3dx"
    assert list(untiered) == [stem, *(f"{stem}_{name}" for name in ("board", "told", "families", "better", "pairs"))]
    assert "compute p99 (ms)" not in untiered[stem].header
    assert len(untiered[stem].header) == 6 + len(contest.columns)
    two = contest_tables([*rows, *(row | {"robot": "omni3"} for row in rows[:28])], [], COMMAND, ladder=False)
    assert [len(two[name].rows) for name in (stem, stem.replace("p3dx", "omni3"))] == [len(entries) - 1, 2]


def test_the_standings(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    table = tables[""]
    seen = groups([row for row in drawn[1] if row["split"] == "validation"])
    assert table.header == [
        *("policy", "gains", "success (%)", *(column.header for column in contest.columns)),
        *("compute p99 (ms)", contest.gap.header, "knows", "parameters", "learned from"),
    ]
    wanted = []
    for entry in in_order(entries, contest):
        rows, gap = entries[entry], contest.gap
        cells = [cell_of(column, rows, contest) for column in contest.columns]
        for k, column in enumerate(contest.columns):
            cells[k] += "‡" * (column.metric == "mean_speed" and is_off(rows, contest.pace))
        if gap.metric == "cost":
            here, there = (
                float(iqm(np.array(costs_of(each, contest.spec.cost.metric)))) for each in (rows, seen[entry])
            )
            more = f"{here - there:+.4f}"
        else:
            here, there = (statistics.fmean(number(row, "success") for row in each) for each in (rows, seen[entry]))
            more = f"{100.0 * (there - here):+.1f}"
        compute = "0.46" if entry[0] == "B" else ""
        last = [rows[0][name] for name in ("knows", "parameters", "learned_from")]
        wanted.append([*entry, won_told(rows), *cells, compute, more, *last])
    assert table.rows == wanted
    assert table.note.startswith("14 test scenarios")  # of agents, whose runs are more, too
    assert ("off the 0.6 m/s asked for by more than 3 %" in table.note) == (contest.pace is not None)


def test_families_and_tiers(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    families = [*dict.fromkeys(row["family"] for rows in entries.values() for row in rows)]
    for name, key, columns in (("families", "family", families), ("tiers", "tier", TIERS)):
        assert tables[name].header == ["policy", *columns]
        assert tables[name].rows == [
            [named(entry), *(short_of([row for row in rows if row[key] == each], contest) for each in columns)]
            for entry, rows in entries.items()
        ]


def test_each_agent_by_itself(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    documented = entries[contest.policies[0], "default"]
    cost = contest.spec.cost

    def standing(rows: Sequence[Any]) -> tuple[float, float]:
        return statistics.fmean(number(row, "success") for row in rows), -statistics.fmean(costs_of(rows, cost.metric))

    wanted = []
    for seed in dict.fromkeys(row["agent_seed"] for row in entries["ppo", "trained"]):
        mine = [row for row in entries["ppo", "trained"] if row["agent_seed"] == seed]
        there = [row for row in drawn[1] if row["split"] == "validation" and row["agent_seed"] == seed]
        won = statistics.fmean(number(row, "success") for row in there)
        if contest.pace:
            bar = "yes" if float(iqm(np.array(costs_of(there, cost.metric)))) < 0.0148 else "no"
        elif contest.name == "docking":
            bar = "yes" if won >= 0.8 else "no"
        else:
            bar = ""  # none of the family that it is about
        over = "yes" if standing(mine) > standing(documented) else "no"
        share, less = standing(mine)
        wanted.append(["ppo", "trained", seed, f"{100.0 * share:.1f}", f"{-less:.{cost.decimals}f}", bar, over])
    assert tables["seeds"].rows == wanted
    assert tables["seeds"].header[4] == next(each.header for each in contest.columns if each.metric == "cost")


def test_the_front(drawn: Any) -> None:
    contest, _, tables, _ = pieces(drawn)
    assert tables["front"].header == ["policy", *FRONT]
    wanted = []
    for entry, rows in groups([row for row in drawn[1] if row["split"] == "front"]).items():
        cells = [named(entry)]
        for asked in FRONT:
            mine = [row for row in rows if row["speed"] == asked]
            numbers = costs_of(mine, contest.cost.metric)
            ends = interval(*table_of(mine, numbers), iqm)
            text = told(float(iqm(np.array(numbers))), ends, 1.0, contest.cost.decimals)
            cells.append(f"{text} | {shown_pace(speed_of(mine))}{'‡' * is_off(mine, float(asked))}")
        wanted.append(cells)
    assert tables["front"].rows == wanted


def by_agents(rows: Sequence[Any], name: str) -> dict[tuple[str, str], list[float]]:
    """Returns a number of every agent, by scenario."""
    found: dict[tuple[str, str], list[float]] = {}
    for row in sorted(rows, key=lambda row: row["agent_seed"]):
        found.setdefault((row["scenario"], row["episode"]), []).append(number(row, name))
    return found


def test_how_often_each_does_better(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    cost = contest.cost
    at = [named(entry) for entry in entries]
    assert tables["better"].header == ["policy", *at]
    for (i, a), (j, b) in itertools.combinations(enumerate(entries), 2):
        ours, theirs = entries[a], entries[b]
        count = [
            better(*(np.array([x]) for x in (wa, np.nan_to_num(ca), wb, np.nan_to_num(cb))))[0]
            for key in by_agents(ours, "success")
            for wa, ca in zip(by_agents(ours, "success")[key], by_agents(ours, cost.metric)[key], strict=True)
            for wb, cb in zip(by_agents(theirs, "success")[key], by_agents(theirs, cost.metric)[key], strict=True)
        ]
        share = statistics.fmean(count)
        assert float(tables["better"].rows[i][j + 1]) == pytest.approx(share, abs=0.00501)
        assert float(tables["better"].rows[j][i + 1]) == pytest.approx(1.0 - share, abs=0.00501)
    assert [row[k + 1] for k, row in enumerate(tables["better"].rows)] == [""] * len(at)
    assert [row[0] for row in tables["better"].rows] == at


def test_the_leaderboard(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    wanted = []
    for entry in in_order(entries, contest):
        rows = entries[entry]
        settled = []
        for name, *shown in (("acquisition_time", 1.0, 2), ("acquisition_area", 1e3, 0)):
            if contest.spec.on_path:
                table, strata = solved_of(rows, name)
                ends = interval(table, strata, iqm) if len(table) else None
                settled.append(told(float(iqm(table.ravel())), ends, *shown) if len(table) else "")
        speed = "-" if math.isnan(speed_of(rows)) else f"{speed_of(rows):.3f}"
        last = [rows[0][name] for name in ("knows", "learned_from")]
        wanted.append(["", *entry, won_told(rows), typical_of(rows, contest), *settled, speed, *last])
    assert tables["board"].rows == wanted  # families that the contest does not know stand together


def test_pairs_are_differences_of_success_and_of_cost_where_both_succeed(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    lines = [dict(zip(tables["pairs"].header, row, strict=True)) for row in tables["pairs"].rows]
    main = [line for line in lines if "asked for" not in line["condition"]]
    first = in_order(entries, contest)[0]
    asked = {entry for entry in entries if entry[0] == "ppo"} | {first}
    met = {frozenset((line["policy"], line["beside"])) for line in main}
    assert met == {
        frozenset(map(named, pair)) for pair in itertools.combinations(entries, 2) if asked & set(pair)
    }  # every other entry beside the agents, and beside who comes first
    assert all(line["policy"].startswith("ppo") for line in main if "ppo (trained)" in line.values())
    by_name = {named(entry): mine for entry, mine in entries.items()}
    factor = 1e3 if contest.cost.unit == "m" else 1.0
    for line in main:
        ours, theirs = by_name[line["policy"]], by_name[line["beside"]]
        share = [statistics.fmean(number(row, "success") for row in rows) for rows in (ours, theirs)]
        assert float(line["success (points)"]) == pytest.approx(100.0 * (share[0] - share[1]), abs=0.00501)
        wanted, count = of_both(ours, theirs, contest)
        if count:
            assert float(line["cost where both succeed"]) == pytest.approx(factor * wanted, abs=0.000501)
        else:
            assert line["cost where both succeed"] == ""
    with pytest.raises(ValueError, match="not met the same"):
        success_difference(*(Runs.of(Episodes(rows), contest) for rows in (ours, theirs[:-1])))


def of_both(ours: Sequence[Any], theirs: Sequence[Any], contest: Contest) -> tuple[float, int]:
    """Returns the cost of the first less the other's where both succeed, and in how many scenarios of full families."""
    metric = contest.cost.metric
    found: dict[str, list[list[float]]] = {}
    for key in dict.fromkeys((row["scenario"], row["episode"]) for row in ours):
        runs = [[row for row in rows if (row["scenario"], row["episode"]) == key] for rows in (ours, theirs)]
        numbers = [
            number(a, metric) - number(b, metric) if number(a, "success") and number(b, "success") else NAN
            for a in runs[0]
            for b in runs[1]
        ]
        there = [each for each in numbers if not math.isnan(each)]
        if there:
            filled = [statistics.fmean(there) if math.isnan(each) else each for each in numbers]
            found.setdefault(runs[0][0]["family"], []).append(filled)
    kept = [each for lines in found.values() if len(lines) >= 5 for line in lines for each in line]
    reduce = np.mean if contest.cost.unit == "s" else iqm
    return (float(reduce(np.array(kept))) if kept else NAN), len(kept)


OPEN = "no significant difference in success"
SAME = ("0.6", "0.6")


def line_of(
    success: float, p_success: float, cost: float, p_cost: float, unit: str = "s", speeds: tuple[str, str] = ("", "")
) -> dict[str, str]:
    """Returns a line of a table of pairs."""
    told = {"success (points)": f"{success}", "p of success": "" if math.isnan(p_success) else f"{p_success}"}
    told |= {"cost where both succeed": f"{cost}", "p of cost": "" if math.isnan(p_cost) else f"{p_cost}"}
    asked = "0.6" if unit == "mm" else ""
    return told | {"unit": unit, "asked (m/s)": asked, "speed (m/s)": speeds[0], "its speed (m/s)": speeds[1]}


@pytest.mark.parametrize(
    ("line", "outcome", "words", "turned"),
    [
        (line_of(5, 1e-6, 3, 1e-6), "wins", "more successes", "fewer successes"),  # however slow
        (line_of(-5, 1e-6, -3, 1e-6), "loses", "fewer successes", "more successes"),
        (line_of(0.1, 0.9, -3, 1e-6), "wins", f"{OPEN}; quicker", f"{OPEN}; slower"),
        (line_of(0.1, 0.9, 3, 1e-6), "loses", f"{OPEN}; slower", f"{OPEN}; quicker"),
        (line_of(0.1, 0.9, 3, 0.9), "alike", f"{OPEN} or time", f"{OPEN} or time"),
        (line_of(0.1, 0.9, 3, 0.9, "mm", SAME), "alike", f"{OPEN} or error", f"{OPEN} or error"),
        # a difference that correction takes away is no likeness: a time that says otherwise decides nothing
        (line_of(-5, 0.04, -3, 1e-6), "alike", *(f"{each} successes (not significant)" for each in ("fewer", "more"))),
        (line_of(-5, 0.04, -3, 0.9), "alike", *(f"{each} successes (not significant)" for each in ("fewer", "more"))),
        (line_of(-5, 0.04, 3, 1e-6), "loses", f"{OPEN}; slower", f"{OPEN}; quicker"),
        (line_of(0, 0.9, -3, 1e-6, "mm", SAME), "wins", f"{OPEN}; errs less", f"{OPEN}; errs more"),
        (
            line_of(0, 0.9, -3, 1e-6, "mm", ("0.5", "0.6")),
            "not at one speed",
            f"{OPEN}; errs less at a lower speed",
            f"{OPEN}; errs more at a higher speed",
        ),
        (line_of(0, 0.9, -3, 1e-6, "mm", ("0.6", "0.5")), "wins", f"{OPEN}; errs less", f"{OPEN}; errs more"),
        (line_of(0, NAN, -3, NAN), "too few scenarios", "too few scenarios", "too few scenarios"),
    ],
)
def test_a_verdict_is_on_success_then_on_what_both_solve(
    line: dict[str, str], outcome: str, words: str, turned: str
) -> None:
    others = [line_of(0, 0.8, 0, 0.8)] * 3  # which correction counts
    (found, *_) = verdicts.judged([line, *others])
    assert (found.outcome, found.words, found.reversed_words) == (outcome, words, turned)


def test_a_verdict_is_corrected_for_all_that_is_shown_together(drawn: Any) -> None:
    _, _, tables, _ = pieces(drawn)
    lines = [dict(zip(tables["pairs"].header, row, strict=True)) for row in tables["pairs"].rows]
    ps = [float(line[name] or NAN) for line in lines for name in ("p of success", "p of cost")]
    corrected = holm(ps)
    found = verdicts.judged(lines)
    assert [each.p_success for each in found] == pytest.approx(corrected[::2], nan_ok=True)
    assert [each.p_cost for each in found] == pytest.approx(corrected[1::2], nan_ok=True)
    claims = [dict(zip(tables["claims"].header, row, strict=True)) for row in tables["claims"].rows]
    told = {(line["condition"], line["policy"], line["beside"]): line["verdict"] for line in claims}
    wanted = {
        (line["condition"], line["policy"], line["beside"]): each.words
        for line, each in zip(lines, found, strict=True)
        if line["policy"].startswith("ppo")
    }
    assert told == wanted
    assert f"{2 * len(lines)} comparisons" in tables["claims"].note


def test_scenes_that_stand_still_and_that_move_are_compared_apart() -> None:
    contest = CONTESTS["goal-obstacles"]
    rows = [row for row in rows_of(contest, 1) if row["split"] == "test"]
    families = list(dict.fromkeys(row["family"] for row in rows))
    names = dict(zip(families, ("rooms", "moving_crowd"), strict=True))
    moved = [row | {"family": names[row["family"]]} for row in rows]
    table = verdicts.pairs_table(Episodes(moved), COMMAND)
    apart = {
        scenes: verdicts.pairs_table(Episodes(row for row in moved if row["family"] == name), COMMAND)
        for scenes, name in (("still", "rooms"), ("moving", "moving_crowd"))
    }
    for scenes, alone in apart.items():
        assert [row for row in table.rows if row[1] == scenes] == alone.rows
    assert {row[1] for row in table.rows} == {"still", "moving"}


@pytest.mark.parametrize("name", CONTESTS)
def test_the_ladder(name: str) -> None:
    contest = CONTESTS[name]
    levels = ("severe", "none", "light")  # in no order
    rows = [row | {"suite": "disturbances"} for row in rows_of(contest, 2, levels) if row["split"] == "test"]
    rows = [row for row in rows if not (row["policy"] == "B" and row["disturbance"] == "light")]
    tables = contest_tables(rows, [], COMMAND, ladder=True)
    stem = f"{contest.name.replace('-', '_')}_p3dx_ladder"
    assert list(tables) == [stem, f"{stem}_pairs", f"{stem}_claims"]
    ordered = [level for level in LEVELS if level in levels]
    assert tables[stem].header == ["policy", *ordered]
    wanted = []
    for entry, mine in groups(rows).items():
        cells = []
        for level in ordered:
            here = [row for row in mine if row["disturbance"] == level]
            cells.append(short_of(here, contest, won_told(here)) if here else "")
            assert not here or success_cell(Episodes(here)) == won_told(here)
        wanted.append([named(entry), *cells])
    assert tables[stem].rows == wanted
    conditions = dict.fromkeys(row[0] for row in tables[f"{stem}_claims"].rows)
    assert set(conditions) == {
        *(f"{contest.title}, p3dx, {level} disturbance" for level in ("severe", "light")),
        f"{contest.title}, p3dx, undisturbed, fewer scenarios",
    }
    alone = contest_tables([row for row in rows if row["policy"] != "ppo"], [], COMMAND, ladder=True)
    assert list(alone) == [stem]


# What the report says of the same rows.


def test_a_law_that_never_arrives_is_in_tables_and_charts_that_a_page_can_hold() -> None:
    contest = CONTESTS["path-following"]
    lost = [
        row | {"success": "0"} if row["policy"] == "C" else row | {"success": f"{number(row, 'success'):g}"}
        for row in rows_of(contest, 2)
    ]
    tables = contest_tables(lost, [], COMMAND, ladder=False)
    stem = "path_following_p3dx"
    for name in (stem, f"{stem}_front", f"{stem}_claims"):
        assert not any("nan" in cell for row in tables[name].rows for cell in row), name
    assert next(row for row in tables[f"{stem}_front"].rows if row[0] == "C")[1].endswith("| -")
    finding = findings.found(contest, "p3dx", Episodes(row for row in lost if row["split"] == "test"))
    swept = [row for row in lost if row["split"] == "front"]
    front = findings.front_chart(contest, "p3dx", Episodes(swept))
    assert [each["label"] for each in front["series"]] == [named(entry) for entry in groups(swept) if entry[0] != "C"]
    once = [row | {"success": "1"} if row["speed"] == "0.9" else row for row in swept]
    *_, last = findings.front_chart(contest, "p3dx", Episodes(once))["series"]
    assert [point["asked"] for point in last["points"]] == ["0.9"]
    assert json.dumps([*finding.charts, front], allow_nan=False)
