"""The tables of a contest, cell by cell, stated once more in plain loops over rows at random."""

import itertools
import json
import math
import statistics
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest

from wayfield.benchmarks import claims, standings
from wayfield.benchmarks.aggregates import better, counted_interval, interval, iqm
from wayfield.benchmarks.contests import CONTESTS, Column, Contest
from wayfield.benchmarks.crossed import share_interval
from wayfield.benchmarks.entries import success_cell
from wayfield.benchmarks.kept_rows import packed, thinned, unpacked
from wayfield.benchmarks.matrix import Runs, cost_difference, how_often_better, success_difference
from wayfield.benchmarks.paired import Difference, difference, holm
from wayfield.benchmarks.report import findings
from wayfield.benchmarks.standings import Standings, contest_tables
from wayfield.benchmarks.table import Table
from wayfield.envs.disturbances import LEVELS

NAN = math.nan
COMMAND = "python evaluate.py --suite x"
ENTRIES = (("ppo", "trained"), ("A", "default"), ("A", "tuned"), ("B", "default"), ("C", "default"))
TIERS = ("easy", "medium", "hard")
FRONT = ("0.3", "0.9")


def rows_of(contest: Contest, seed: int, levels: Sequence[str] = ("none",)) -> list[dict[str, str]]:
    """Returns a contest's rows: five entries in fourteen scenarios of two families, on three splits."""
    rng = np.random.default_rng(seed)
    first = contest.policies[0]
    metrics = {column.metric for column in contest.columns} | {contest.spec.cost.metric, "collision"}
    metrics -= {"cost", "success"}
    courses = [("test", ""), ("validation", ""), *(("front", speed) for speed in FRONT)]
    found = []
    for entry, level in itertools.product(ENTRIES, levels):
        skill = rng.uniform(0.5, 0.97)
        if entry == ("C", "default"):
            skill = 0.0 if seed % 2 else 1.0
        cruise = {"A": 0.6, "B": 0.66, "C": 0.47}.get(entry[0], 0.595)
        for (split, speed), agent in itertools.product(courses, ("3", "0") if entry[0] == "ppo" else ("",)):
            for k in rng.permutation(14).tolist():
                family, episode = ("wide", k) if k < 8 else ("narrow", k - 8)
                won = float(rng.random() < skill)
                cells = {name: float(rng.gamma(3.0, 0.02)) for name in sorted(metrics)}
                cells |= {"success": won, "collision": float(not won and rng.random() < 0.5)}
                cells["mean_speed"] = float(rng.normal(float(speed) if speed == "0.9" else cruise, 0.004))
                cells["time"] = float(rng.uniform(8.0, 50.0))
                cells["ldlj"] = NAN if k == 5 and entry[0] == "B" else -float(rng.gamma(9.0))
                cells[contest.spec.cost.metric] = float(rng.gamma(3.0, 0.02)) * (1.0 if contest.pace else 300.0)
                if not won and entry[0] == "B":
                    cells[contest.spec.cost.metric] = NAN  # there may be none of a run that fails
                found.append(
                    {
                        "suite": contest.name, "contest": contest.name, "family": family, "robot": "p3dx",
                        "scenario": f"{family}/{split}", "disturbance": level, "gains": "", "dynamics": "kinematic",
                        "policy": first if entry[0] == "A" else entry[0], "gains_name": entry[1], "split": split,
                        "actuators": "lagged", "seed": str(k), "episode": str(episode), "tier": TIERS[k % 3],
                        "speed": speed, "agent_seed": agent, "knows": f"knows {entry[0]}", "parameters": "7",
                        "learned_from": f"from {entry[1]}", "failure_cost": "1.0" if contest.pace else "60.0",
                        **{name: "" if math.isnan(cell) else repr(cell) for name, cell in cells.items()},
                    }
                )  # fmt: skip
    return found


def number(row: Any, name: str) -> float:
    return float(row[name]) if row[name] else NAN


def groups(rows: Sequence[Any]) -> dict[tuple[str, str], list[Any]]:
    """Returns the rows by policy and gains, in the order in which they come."""
    found: dict[tuple[str, str], list[Any]] = {}
    for row in rows:
        found.setdefault((row["policy"], row["gains_name"]), []).append(row)
    return found


def named(entry: tuple[str, str]) -> str:
    return entry[0] if entry[1] == "default" else f"{entry[0]} ({entry[1]})"


def costs_of(rows: Sequence[Any], metric: str) -> list[float]:
    return [number(row, metric) if number(row, "success") else number(row, "failure_cost") for row in rows]


def table_of(rows: Sequence[Any], numbers: Sequence[float]) -> tuple[Any, list[str]]:
    """Returns numbers of rows by scenario and agent, in the order of the first rows, and the families."""
    scenarios, agents = ([*dict.fromkeys(keys)] for keys in (
        [(row["scenario"], row["episode"]) for row in rows], [row["agent_seed"] for row in rows]))  # fmt: skip
    table = np.full((len(scenarios), len(agents)), NAN)
    for row, value in zip(rows, numbers, strict=True):
        table[scenarios.index((row["scenario"], row["episode"])), agents.index(row["agent_seed"])] = value
    return table, [name.partition("/")[0] for name, _ in scenarios]


def told(value: float, ends: Any, factor: float, decimals: int) -> str:
    text = f"{factor * value:.{decimals}f}"
    return text if ends is None else f"{text} [{', '.join(f'{factor * end:.{decimals}f}' for end in ends)}]"


def won_told(rows: Sequence[Any]) -> str:
    won = [number(row, "success") for row in rows]
    return told(statistics.fmean(won), share_interval(*table_of(rows, won)), 100.0, 1)


def cell_of(column: Column, rows: Sequence[Any], contest: Contest) -> str:
    """Returns what a column shows of some rows."""
    rows = [row for row in rows if number(row, "success") or not column.successes_only]
    of_cost = column.metric == "cost"
    metric = contest.spec.cost.metric if of_cost else column.metric
    numbers = costs_of(rows, metric) if of_cost or column.imputed else [number(row, metric) for row in rows]
    known = [each for each in numbers if not math.isnan(each)]
    if not known:
        return ""
    ends = None
    if column.with_interval and len(known) == len(numbers):
        table, strata = table_of(rows, numbers)
        if column.reduction == "mean":
            failure = number(rows[0], "failure_cost") if of_cost or column.imputed else 0.0
            won = table_of(rows, [number(row, "success") for row in rows])[0]
            ends = counted_interval(table, won, failure, strata)
        else:
            ends = interval(table, strata, iqm)
    value = {"mean": statistics.fmean, "max": max, "iqm": lambda all_: float(iqm(np.array(all_)))}[column.reduction]
    return told(value(known), ends, column.factor, column.decimals)


def short_of(rows: Sequence[Any], contest: Contest, success: str = "") -> str:
    if not rows:
        return ""
    success = success or f"{100.0 * statistics.fmean(number(row, 'success') for row in rows):.0f}"
    cost = contest.spec.cost
    return f"{success} | {statistics.fmean(costs_of(rows, cost.metric)):.{cost.decimals}f}"


def speed_of(rows: Sequence[Any]) -> float:
    speeds = [number(row, "mean_speed") for row in rows if number(row, "success")]
    return statistics.fmean(speeds) if speeds else NAN


def shown_pace(speed: float) -> str:
    return "-" if math.isnan(speed) else f"{speed:.2f}"


def is_off(rows: Sequence[Any], asked: float | None) -> bool:
    return asked is not None and abs(speed_of(rows) - asked) > 0.03 * asked  # of NaN it is false


def in_order(entries: dict[tuple[str, str], list[Any]], contest: Contest) -> list[tuple[str, str]]:
    """Returns the entries as they stand: those on the asked speed first, then by success where it counts, then cost."""
    off = {entry: is_off(rows, contest.pace) for entry, rows in entries.items()}

    def key(entry: tuple[str, str]) -> tuple[float, ...]:
        rows = entries[entry]
        won = -statistics.fmean(number(row, "success") for row in rows)
        cost = statistics.fmean(costs_of(rows, contest.spec.cost.metric))
        behind = abs(speed_of(rows) - 0.6) if off[entry] and not all(off.values()) else 0.0
        return (behind, cost) if contest.pace else (behind, won, cost)

    return sorted(entries, key=key)


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
        *("", "told", "families", "tiers", "better", "differences", "front", "seeds", "claims"),
    ]
    made = f"Made by `{COMMAND}`, wayfield {version('wayfield')}."
    for name, table in tables.items():
        assert table.title.startswith(title if name != "claims" else "What trained agents win"), name
        assert (made if name != "claims" else f"Made by `{COMMAND}`.") in table.note, name
        assert all(len(row) == len(table.header) for row in table.rows), name
    rows = [row for row in drawn[1] if row["split"] == "test" and row["policy"] != "ppo"]
    untiered = contest_tables([row | {"tier": ""} for row in rows], [], COMMAND, ladder=False)
    stem = f"{contest.name.replace('-', '_')}_p3dx"
    assert list(untiered) == [stem, *(f"{stem}_{name}" for name in ("told", "families", "better", "differences"))]
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


@pytest.mark.parametrize("name", CONTESTS)
def test_the_note_of_the_standings_says_which_scenarios_and_how_its_brackets_are_made(name: str) -> None:
    contest = CONTESTS[name]
    rows = [row for row in rows_of(contest, 0) if row["split"] == "test"]
    count = len({(row["family"], row["scenario"], row["episode"]) for row in rows})
    apart = [row | {"family": f"{row['family']} {row['scenario']} {row['episode']}"} for row in rows]
    # split, rows, how they are called, and whether each scenario is a stratum of its own or all are one
    for split, mine, called, alone in (
        ("test", rows, "test scenarios", False),
        ("own", rows, "scenarios from the user's files", True),
        ("public", rows, "scenarios of the public benchmark, on which nothing was trained or tuned", False),
        ("public", apart, "scenarios of the public benchmark, on which nothing was trained or tuned", True),
    ):
        entries = groups([row | {"split": split} for row in mine])
        for seen in (False, True):
            note = standings._standings_note(Standings(contest, "t", entries, COMMAND), seen)
            assert note.startswith(f"{count} {called}, each policy in the same ones")
            assert ("bootstrap, stratified by family, agents" in note) is not alone
            assert ("bootstrap, agents" in note) is alone
            assert f"none where {'there are' if alone else 'a family has'} fewer than 5 scenarios" in note
            assert (" Gap: what the entry does better on the validation split" in note) is seen
            marked = "such entries stand below the others, the nearest to it first, and are not ranked." in note
            assert marked is (contest.pace is not None)
            assert "frames of 0.05 s" in note


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
            numbers = costs_of(mine, contest.spec.cost.metric)
            ends = interval(*table_of(mine, numbers), iqm)
            text = told(float(iqm(np.array(numbers))), ends, 1.0, contest.spec.cost.decimals)
            cells.append(f"{text} | {shown_pace(speed_of(mine))}{'‡' * is_off(mine, float(asked))}")
        wanted.append(cells)
    assert tables["front"].rows == wanted


def by_agents(rows: Sequence[Any], name: str) -> dict[tuple[str, str], list[float]]:
    """Returns a number of every agent, by scenario."""
    found: dict[tuple[str, str], list[float]] = {}
    for row in sorted(rows, key=lambda row: row["agent_seed"]):
        found.setdefault((row["scenario"], row["episode"]), []).append(number(row, name))
    return found


def signed(found: Difference, p: float, factor: float, decimals: int) -> list[str]:
    if math.isnan(found.low):
        return [f"{factor * found.value:+.{decimals}f}", ""]
    ends = ", ".join(f"{factor * end:+.{decimals}f}" for end in (found.low, found.high))
    return [f"{factor * found.value:+.{decimals}f} [{ends}]", "< 0.001" if p < 0.001 else f"{p:.3f}"]


def test_who_beats_whom(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    pairs = [*itertools.combinations(entries, 2)]
    cost = contest.spec.cost
    runs = {entry: Runs.of(mine, contest) for entry, mine in entries.items()}
    found = {pair: how_often_better(runs[pair[0]], runs[pair[1]]) for pair in pairs}
    ps = dict(zip(pairs, holm([each.p for each in found.values()]), strict=True))
    at = [named(entry) for entry in entries]
    assert tables["better"].header == ["policy", *at]
    for (a, b), each in found.items():
        ours, theirs = entries[a], entries[b]
        count = [
            better(*(np.array([x]) for x in (wa, np.nan_to_num(ca), wb, np.nan_to_num(cb))))[0]
            for key in by_agents(ours, "success")
            for wa, ca in zip(by_agents(ours, "success")[key], by_agents(ours, cost.metric)[key], strict=True)
            for wb, cb in zip(by_agents(theirs, "success")[key], by_agents(theirs, cost.metric)[key], strict=True)
        ]
        assert each.value + 0.5 == pytest.approx(statistics.fmean(count), rel=1e-12)
        sure = ps[a, b] < 0.05
        ahead, behind = (ours, theirs) if each.value > 0.0 else (theirs, ours)
        slower = contest.pace is not None and speed_of(ahead) < 0.97 * speed_of(behind)
        mark = ("‡" if slower else "*") if sure else ""
        i, j = list(entries).index(a), list(entries).index(b)
        assert tables["better"].rows[i][j + 1] == f"{0.5 + each.value:.2f}{mark}"
        assert tables["better"].rows[j][i + 1] == f"{0.5 - each.value:.2f}{mark}"
    assert [row[k + 1] for k, row in enumerate(tables["better"].rows)] == [""] * len(at)
    assert [row[0] for row in tables["better"].rows] == at


def test_differences_in_pairs(drawn: Any) -> None:
    contest, entries, tables, _ = pieces(drawn)
    pairs = [*itertools.combinations(entries, 2)]
    cost = contest.spec.cost
    runs = {entry: Runs.of(mine, contest) for entry, mine in entries.items()}
    won = [success_difference(runs[a], runs[b]) for a, b in pairs]
    cheaper = [cost_difference(runs[a], runs[b], contest) for a, b in pairs]
    ps = [holm([each.p for each in column]) for column in (won, cheaper)]
    factor = 1000.0 if cost.unit == "m" else 1.0
    wanted = []
    for k, (a, b) in enumerate(pairs):
        cells = [*signed(won[k], ps[0][k], 100.0, 1), *signed(cheaper[k], ps[1][k], factor, 2)]
        wanted.append([named(a), named(b), *cells])
        ours, theirs = entries[a], entries[b]
        share = [statistics.fmean(number(row, "success") for row in rows) for rows in (ours, theirs)]
        assert won[k].value == pytest.approx(share[0] - share[1], abs=1e-12)
        if cost.unit == "s":
            mean = [statistics.fmean(costs_of(rows, cost.metric)) for rows in (ours, theirs)]
            assert cheaper[k].value == pytest.approx(mean[0] - mean[1], rel=1e-9)
    assert tables["differences"].rows == wanted
    unit = "mm" if cost.unit == "m" else cost.unit
    assert tables["differences"].header[4] == f"{cost.name} ({unit})"
    # errors have long tails; a time that ends at the clock counts in full
    kind = "mean" if cost.unit == "s" else "interquartile mean"
    assert f"{cost.name} in {unit}, {kind} of the differences" in tables["differences"].note


def test_what_a_failure_more_costs_is_added_to_a_difference_of_times() -> None:
    contest = CONTESTS["goal-obstacles"]
    entries = groups([row for row in rows_of(contest, 4) if row["split"] == "test"])
    for a, b in itertools.combinations(entries, 2):
        both = [*entries[a], *entries[b]]
        took = [number(row, contest.spec.cost.metric) for row in both if number(row, "success")]
        tables = [
            table_of(rows, costs_of(rows, contest.spec.cost.metric))
            for rows in (sorted(entries[each], key=lambda row: (row["scenario"], row["episode"])) for each in (a, b))
        ]
        wanted = difference(tables[0][0], tables[1][0], tables[0][1], "mean", 60.0 - statistics.fmean(took))
        found = cost_difference(Runs.of(entries[a], contest), Runs.of(entries[b], contest), contest)
        assert (found.value, found.low, found.high, found.p) == pytest.approx(
            (wanted.value, wanted.low, wanted.high, wanted.p), rel=1e-9, nan_ok=True
        )
    with pytest.raises(ValueError, match="not met the same"):
        success_difference(Runs.of(entries[a], contest), Runs.of(entries[b][:-1], contest))


def verdict(p: float, ahead: bool) -> str:
    return "too few scenarios" if math.isnan(p) else "not told apart" if p >= 0.05 else "wins" if ahead else "loses"


def test_what_agents_win(drawn: Any) -> None:
    contest, _, tables, _ = pieces(drawn)
    conditions: dict[str, list[Any]] = {}
    for row in drawn[1]:
        if row["split"] != "validation":
            words = f"{contest.title}, p3dx" + (f", asked for {row['speed']} m/s" if row["speed"] else "")
            conditions.setdefault(words, []).append(row)
    lines, ps = [], []
    for words, rows in conditions.items():
        entries = groups(rows)
        for other, theirs in entries.items():
            if other[0] != "ppo":
                ours = entries["ppo", "trained"]
                two = Runs.of(ours, contest), Runs.of(theirs, contest)
                pair = success_difference(*two), cost_difference(*two, contest)
                ps += [each.p for each in pair]
                lines.append((words, other, theirs, ours, pair))
    corrected = holm(ps)
    wanted = []
    for k, (words, other, theirs, ours, (won, cost)) in enumerate(lines):
        p, q = corrected[2 * k], corrected[2 * k + 1]
        speeds = speed_of(ours), speed_of(theirs)
        of_cost = verdict(q, cost.value < 0.0)
        ahead, behind = speeds if cost.value < 0.0 else speeds[::-1]
        if of_cost in ("wins", "loses") and contest.pace and ahead < 0.97 * behind:
            of_cost = "not at one speed"
        factor, unit = (1000.0, " mm") if contest.spec.cost.unit == "m" else (1.0, " s")
        shown = signed(cost, q, factor, 2)
        success = signed(won, p, 100.0, 1)
        wanted.append(
            {
                "condition": words, "policy": "ppo (trained)", "against": named(other), "is told": theirs[0]["knows"],
                "success (points)": success[0], "p": success[1], "on success": verdict(p, won.value > 0.0),
                "cost": shown[0] + unit, "p of it": shown[1], "on cost": of_cost,
                "speeds (m/s)": " / ".join(map(shown_pace, speeds)) if contest.pace else "",
            }
        )  # fmt: skip
    table = tables["claims"]
    assert [dict(zip(table.header, row, strict=True)) for row in table.rows] == wanted
    assert f"for the {2 * len(lines)} claims" in table.note


@pytest.mark.parametrize("name", CONTESTS)
def test_who_errs_less_by_driving_slower_is_not_told_to_win_whichever_it_is(name: str) -> None:
    contest, alike = CONTESTS[name], Difference(0.0, -1.0, 1.0, 1.0)
    for value, speeds in itertools.product((-0.1, 0.1), ((0.6, 0.6), (0.5, 0.6), (0.6, 0.5), (0.585, 0.6))):
        cost = Difference(value, value - 0.01, value + 0.01, 0.001)
        one = claims.Comparison(contest, "c", ("ppo", "trained"), ("B", "tuned"), "path", alike, cost, speeds)
        ahead, behind = speeds if value < 0.0 else (speeds[1], speeds[0])
        slower = contest.pace is not None and ahead < 0.97 * behind
        assert one.of_cost(0.01) == ("not at one speed" if slower else "wins" if value < 0.0 else "loses")
        assert one.of_cost(0.06) == "not told apart"
        assert one.of_cost(NAN) == "too few scenarios"


def test_a_summary_lists_whom_agents_beat() -> None:
    lines = []
    verdicts = ("wins", "loses", "not told apart", "too few scenarios")
    for k, (won, cost) in enumerate(itertools.product(verdicts, (*verdicts, "not at one speed"))):
        for condition, policy in (("first", "ppo (trained)"), ("second", "hybrid (trained)")):
            lines.append(
                {"condition": condition, "policy": policy, "against": f"p{k}", "on success": won, "on cost": cost}
            )
    sides: dict[str, list[str]] = {name: [] for name in (*verdicts, "not at one speed")}
    for k, (won, cost) in enumerate(itertools.product(verdicts, (*verdicts, "not at one speed"))):
        sides[won if won in ("wins", "loses") else cost].append(f"`p{k}`")
    alike = sides["not told apart"] + sides["too few scenarios"]
    cells = [", ".join(each) for each in (sides["wins"], sides["loses"], alike, sides["not at one speed"])]
    assert claims.summary(lines) == [["first", "`ppo`", *cells], ["second", "`hybrid`", *cells]]
    assert claims.summary(lines[:1])[0][2:] == ["`p0`", "-", "-", "-"]


@pytest.mark.parametrize("name", CONTESTS)
def test_the_ladder(name: str) -> None:
    contest = CONTESTS[name]
    levels = ("severe", "none", "light")  # in no order
    rows = [row | {"suite": "disturbances"} for row in rows_of(contest, 2, levels) if row["split"] == "test"]
    rows = [row for row in rows if not (row["policy"] == "B" and row["disturbance"] == "light")]
    tables = contest_tables(rows, [], COMMAND, ladder=True)
    stem = f"{contest.name.replace('-', '_')}_p3dx_ladder"
    assert list(tables) == [stem, f"{stem}_claims"]
    ordered = [level for level in LEVELS if level in levels]
    assert tables[stem].header == ["policy", *ordered]
    wanted = []
    for entry, mine in groups(rows).items():
        cells = []
        for level in ordered:
            here = [row for row in mine if row["disturbance"] == level]
            cells.append(short_of(here, contest, won_told(here)) if here else "")
            assert not here or success_cell(here) == won_told(here)
        wanted.append([named(entry), *cells])
    assert tables[stem].rows == wanted
    conditions = dict.fromkeys(row[0] for row in tables[f"{stem}_claims"].rows)
    assert set(conditions) == {
        *(f"{contest.title}, p3dx, {level} disturbance" for level in ("severe", "light")),
        f"{contest.title}, p3dx, undisturbed, fewer scenarios",
    }
    alone = contest_tables([row for row in rows if row["policy"] != "ppo"], [], COMMAND, ladder=True)
    assert list(alone) == [stem]


def test_rows_that_are_kept_have_six_digits_of_what_tables_show() -> None:
    contest = CONTESTS["path-following"]
    rows = [row | {"own": "1.5", "steady_offset": "0.25"} for row in rows_of(contest, 3)]
    kept = thinned(rows)
    shown = {column.metric for column in contest.columns} - {"cost"} | {
        "success",
        "collision",
        contest.spec.cost.metric,
    }
    few = {"success", "collision", "mean_speed", contest.spec.cost.metric}
    names = {"suite", "contest", "family", "scenario", "robot", "disturbance", "policy", "gains_name", "gains"}
    names |= {"dynamics", "actuators", "seed", "episode", "split", "tier", "speed", "agent_seed", "knows"}
    names |= {"parameters", "learned_from", "failure_cost"}
    for row, mine in zip(rows, kept, strict=True):
        assert set(mine) >= names | shown
        for name, cell in mine.items():
            if name in names:
                assert cell == row[name]
            elif name not in (shown if row["split"] == "test" else few) or not row[name]:
                assert cell == ""
            else:
                assert cell == f"{float(row[name]):.6g}"
    assert unpacked(packed(kept), "here") == kept


# What the report says of the same rows.


def charted(numbers: Sequence[float], expected: Sequence[float]) -> None:
    assert list(numbers) == pytest.approx(list(expected), rel=1e-12)


def test_the_charts_of_a_report_hold_the_numbers_of_the_rows(drawn: Any) -> None:
    contest, entries, _, _ = pieces(drawn)
    by_cost, cost = contest.pace is not None, contest.spec.cost
    rows = [row | {"success": f"{float(row['success']):g}"} for mine in entries.values() for row in mine]
    finding = findings.found(contest, "p3dx", rows)
    bars, duels, heat = finding.charts
    assert [bars[name] for name in ("kind", "unit", "log", "decimals", "most")] == (
        ["bars", cost.unit, True, cost.decimals, None] if by_cost else ["bars", "%", False, 1, 100.0]
    )
    for line, (entry, mine) in zip(bars["rows"], entries.items(), strict=True):
        assert line["label"] == named(entry)
        won = [number(row, "success") for row in mine]
        if by_cost:
            table, strata = table_of(mine, costs_of(mine, cost.metric))
            ends = counted_interval(table, table_of(mine, won)[0], number(mine[0], "failure_cost"), strata)
            charted(line["values"], [float(table.mean()), *(ends or ())])
        else:
            ends = share_interval(*table_of(mine, won))
            assert ends is not None
            charted(line["values"], [100.0 * each for each in (statistics.fmean(won), *ends)])
    assert duels["labels"] == heat["labels"] == [named(entry) for entry in entries]
    pairs = [*itertools.combinations(range(len(entries)), 2)]
    keys = list(entries)
    runs = [Runs.of(entries[key], contest) for key in keys]
    found = {(i, j): how_often_better(runs[i], runs[j]) for i, j in pairs}
    ps = dict(zip(pairs, holm([each.p for each in found.values()]), strict=True))
    for (i, j), each in found.items():
        ahead, behind = (i, j) if each.value > 0.0 else (j, i)
        speeds = [speed_of(entries[keys[k]]) for k in (ahead, behind)]
        sure = float(ps[i, j] < 0.05 and not (by_cost and speeds[0] < 0.97 * speeds[1]))
        assert duels["cells"][i][j] == pytest.approx([0.5 + each.value, sure])
        assert duels["cells"][j][i] == pytest.approx([0.5 - each.value, sure])
    assert all(duels["cells"][i][i] is None for i in range(len(keys)))
    families = [*dict.fromkeys(row["family"] for row in rows)]
    assert heat["columns"] == [*(["family", name] for name in families), *(["tier", name] for name in TIERS)]
    for cells, mine in zip(heat["cells"], entries.values(), strict=True):
        for (column, name), (won, count, typical) in zip(heat["columns"], cells, strict=True):
            group = [row for row in mine if row[column] == name]
            good = [number(row, cost.metric) for row in group if number(row, "success")]
            assert (won, count) == (len(good), len(group))
            assert typical == (pytest.approx(float(iqm(np.array(good)))) if good else None)
    assert (heat["by_cost"], heat["factor"], heat["decimals"]) == (by_cost, 100.0, 1 if by_cost else 0)
    swept = [row for row in drawn[1] if row["split"] == "front"]
    front = findings.front_chart(contest, "p3dx", swept)
    # who never succeeds has no mean speed, and no place on the front
    there = [(entry, mine) for entry, mine in groups(swept).items() if not math.isnan(speed_of(mine))]
    for series, (entry, mine) in zip(front["series"], there, strict=True):
        assert series["label"] == named(entry)
        for point, asked in zip(series["points"], FRONT, strict=True):
            here = [row for row in mine if row["speed"] == asked]
            assert not math.isnan(speed_of(here))
            numbers = costs_of(here, cost.metric)
            typical = float(iqm(np.array(numbers)))
            ends = interval(*table_of(here, numbers), iqm) or (typical, typical)
            assert (point["x"], point["y"], point["low"], point["high"]) == pytest.approx(
                (speed_of(here), typical, *ends), nan_ok=True
            )
            assert (point["asked"], point["lost"]) == (asked, any(not number(row, "success") for row in here))


def test_the_chart_of_a_ladder_holds_shares_and_their_ends() -> None:
    contest = CONTESTS["docking"]
    rows = [row for row in rows_of(contest, 5, ("severe", "none")) if row["split"] == "test"]
    chart = findings.ladder_chart(contest, "p3dx", rows)
    assert chart["levels"] == ["none", "severe"]
    for series, (entry, mine) in zip(chart["series"], groups(rows).items(), strict=True):
        assert series["label"] == named(entry)
        for k, level in enumerate(("none", "severe")):
            here = [row for row in mine if row["disturbance"] == level]
            won = [number(row, "success") for row in here]
            low, high = share_interval(*table_of(here, won)) or (0.0, 0.0)
            point = series["points"][k]
            assert (point["x"], point["asked"]) == (k, level)
            charted(
                [point[name] for name in ("y", "low", "high")], [100 * statistics.fmean(won), 100 * low, 100 * high]
            )
    few = [row for row in rows if int(row["episode"]) < 3]
    for series in findings.ladder_chart(contest, "p3dx", few)["series"]:
        assert all(point["low"] == point["y"] == point["high"] for point in series["points"])


@pytest.mark.parametrize("map_told", [False, True])
def test_the_small_table_and_the_sentence(drawn: Any, map_told: bool) -> None:
    contest, entries, _, _ = pieces(drawn)
    by_cost, cost = contest.pace is not None, contest.spec.cost
    told_map = {("B", "default"), ("C", "default")} if map_told else set()
    rows = [
        row | {"knows": "map" if entry in told_map else "sensors"} for entry, mine in entries.items() for row in mine
    ]
    entries = groups(rows)
    finding = findings.found(contest, "p3dx", rows)
    order = in_order(entries, contest)
    rivals = [entry for entry in order if entry not in told_map]
    best, pairs = rivals[0], []
    for other in rivals[1:]:
        two = Runs.of(entries[best], contest), Runs.of(entries[other], contest)
        pairs.append(how_often_better(*two) if by_cost else success_difference(*two))
    off = {entry: is_off(mine, contest.pace) for entry, mine in entries.items()}
    level = [
        other
        for other, p in zip(rivals[1:], holm([each.p for each in pairs]), strict=True)
        if p >= 0.05 and off[other] == off[best]
    ]
    shown = [*rivals[:3]]
    upper = [entry for entry in order if entry in told_map][:1]
    shown += [entry for entry in [*(each for each in order if each[1] == "trained"), *upper] if entry not in shown]
    wanted = []
    for entry in shown:
        mine = entries[entry]
        verdict = "first" if entry == best else "draw" if entry in level else ""
        if entry in told_map:
            verdict = "told map"
        elif off[entry] and not off[best]:
            verdict = "off speed"
        table, strata = table_of(mine, costs_of(mine, cost.metric))
        won = table_of(mine, [number(row, "success") for row in mine])[0]
        ends = counted_interval(table, won, number(mine[0], "failure_cost"), strata)
        text = told(float(table.mean()), ends, 1.0, cost.decimals)
        pace = shown_pace(speed_of(mine)) + "‡" * off[entry]
        wanted.append([named(entry), won_told(mine), text, pace, verdict])
    assert finding.small.rows == wanted
    assert f"{len(order) - len(shown)} more are in the full table" in finding.small.note
    assert ("‡: off the" in finding.small.note) == any(off[entry] for entry in shown)
    achieved = {line[0]: f"{cost.name} {line[2]} {cost.unit}" if by_cost else f"success {line[1]} %" for line in wanted}
    families = len({row["family"] for row in rows})
    sentence = f"{contest.title} with p3dx: 5 policies on the same 14 scenarios of {families} families. "
    if level:
        names = [named(entry) for entry in level]
        whom = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
        how = "in pairs" if by_cost else "by their success"
        sentence += f"A draw: {named(best)} ({achieved[named(best)]}) and {whom} cannot be told apart {how}."
    else:
        sentence += f"{named(best)} wins: {achieved[named(best)]}."
    if map_told:
        sentence += f" {named(upper[0])}, told the map, is the upper reference: {achieved[named(upper[0])]}."
    assert finding.sentence == sentence


def test_the_sentence_where_there_is_little_to_say() -> None:
    contest = CONTESTS["docking"]
    rows = [row for row in rows_of(contest, 0) if row["split"] == "test"]
    few = [row for row in rows if int(row["episode"]) < 2]
    sentence = findings.found(contest, "p3dx", few).sentence
    assert "5 policies on the same 4 scenarios of 2 families." in sentence
    assert sentence.endswith("too few scenarios to tell policies apart.")
    alone = [row for row in rows if row["policy"] == "ppo" and row["episode"] == row["seed"] == "3"]
    sentence = findings.found(contest, "p3dx", alone).sentence
    assert "1 policy on the same 1 scenario of 1 family. ppo (trained) has no rival: success" in sentence


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
    finding = findings.found(contest, "p3dx", [row for row in lost if row["split"] == "test"])
    swept = [row for row in lost if row["split"] == "front"]
    front = findings.front_chart(contest, "p3dx", swept)
    assert [each["label"] for each in front["series"]] == [named(entry) for entry in groups(swept) if entry[0] != "C"]
    once = [row | {"success": "1"} if row["speed"] == "0.9" else row for row in swept]
    *_, last = findings.front_chart(contest, "p3dx", once)["series"]
    assert [point["asked"] for point in last["points"]] == ["0.9"]
    assert json.dumps([*finding.charts, front], allow_nan=False)
