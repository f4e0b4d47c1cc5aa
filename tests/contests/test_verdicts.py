"""Verdicts on pairs, and what tables and charts make of a law that never arrives."""

import dataclasses
import json
import math

import numpy as np
import pytest
import scipy.stats
from oracles import table_formulas
from oracles.drawn_tables import (
    COMMAND,
    NAN,
    groups,
    named,
    number,
    rows_of,
)

from wayfield.benchmarks.contests import CONTESTS, Column
from wayfield.benchmarks.leaderboards import verdicts
from wayfield.benchmarks.leaderboards.entries import by_entry
from wayfield.benchmarks.leaderboards.leaderboard import Standings, contest_tables, standings_table
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.report import findings
from wayfield.benchmarks.statistics.paired import difference, exact_limit

SAME, SLOW = ("0.6", "0.6"), ("0.5", "0.6")
FEWER, MORE = ("fewer successes", "more successes")
UNSURE = (f"{FEWER} (not significant)", f"{MORE} (not significant)")


def line_of(
    success: tuple[float, float, float],
    cost: tuple[float, float, float],
    unit: str = "s",
    speeds: tuple[str, str] = SAME,
    limit: float = 0.9,
) -> dict[str, str]:
    """Returns a line of a table of pairs: of each difference the ends of its interval and its p, the lesser cost 10."""
    told = {"success (points)": f"{sum(success[:2]) / 2}", "cost where both succeed": f"{sum(cost[:2]) / 2}"}
    ends = dict(
        zip(("from", "to", "p of success", "cost from", "cost to", "p of cost"), (*success, *cost), strict=True)
    )
    told |= {name: "" if math.isnan(each) else f"{each}" for name, each in ends.items()} | {"lesser cost": "10"}
    told["exact limit (points)"] = f"{limit}"
    asked = "0.6" if unit == "mm" else ""
    return told | {"unit": unit, "asked (m/s)": asked, "speed (m/s)": speeds[0], "its speed (m/s)": speeds[1]}


# of success in points, of cost where the lesser is 10, so that half a second is within the margin
BETTER, WORSE, BARELY = (3.0, 7.0, 1e-6), (-7.0, -3.0, 1e-6), (-7.0, -0.2, 0.04)
ALIKE, OPEN = (-0.5, 0.9, 0.9), (-3.0, 3.0, 0.9)
LESS, MORE_COST, TRIFLE, NONE = (-3.0, -1.0, 1e-6), (1.0, 3.0, 1e-6), (0.1, 0.4, 1e-6), (NAN, NAN, NAN)


@pytest.mark.parametrize(
    ("line", "outcome", "words", "turned"),
    [
        (line_of(BETTER, MORE_COST), "better", MORE, FEWER),  # however slow
        (line_of(WORSE, LESS), "worse", FEWER, MORE),
        (line_of(OPEN, LESS), "better", "tie in success; faster", "tie in success; slower"),
        (line_of(ALIKE, MORE_COST), "worse", "equivalent in success; slower", "equivalent in success; faster"),
        (line_of(ALIKE, TRIFLE), "equivalent", "equivalent", "equivalent"),  # as safe, and a little slower
        # too few scenes to show that the successes are alike, whatever their interval says
        (line_of(ALIKE, TRIFLE, limit=1.01), "tie", *["tie in success; equivalent in time"] * 2),
        (line_of(ALIKE, OPEN), "tie", *["equivalent in success; tie in time"] * 2),
        (line_of(OPEN, TRIFLE), "tie", *["tie in success; equivalent in time"] * 2),
        (line_of(OPEN, OPEN), "tie", "tie", "tie"),
        (line_of(OPEN, NONE, "mm"), "tie", "tie", "tie"),
        # a difference that correction takes away is no likeness: a time that says otherwise decides nothing
        (line_of(BARELY, LESS), "tie", *UNSURE),
        (line_of(BARELY, TRIFLE), "tie", *UNSURE),
        (line_of((-0.9, -0.1, 0.04), TRIFLE), "tie", *UNSURE),  # who fails more often is no tie, however little
        (line_of(BARELY, MORE_COST), "worse", "tie in success; slower", "tie in success; faster"),
        (
            line_of(ALIKE, LESS, "mm"),
            "better",
            *(f"equivalent in success; {x} error" for x in ("lower", "higher")),
        ),
        (
            line_of(ALIKE, LESS, "mm", SLOW),
            "at different speeds",
            "equivalent in success; lower error at a lower speed",
            "equivalent in success; higher error at a higher speed",
        ),
        (
            line_of(ALIKE, LESS, "mm", SLOW[::-1]),
            "better",
            *(f"equivalent in success; {x} error" for x in ("lower", "higher")),
        ),
        (line_of(ALIKE, TRIFLE, "mm", SLOW), "tie", *["equivalent in success; tie in error"] * 2),
        # the interval of an error leaves out zero, and the correction takes that away: no verdict, and no word of a tie
        (
            line_of(OPEN, (-3.0, -0.9, 0.04), "mm"),
            "tie",
            *(f"tie in success; {x} error (not significant)" for x in ("lower", "higher")),
        ),
        (line_of(BARELY, (0.9, 3.0, 0.04)), "tie", *UNSURE),
        (line_of(NONE, NONE), "too few scenarios", "too few scenarios", "too few scenarios"),
    ],
)
def test_a_verdict_is_on_success_then_on_what_both_solve(
    line: dict[str, str], outcome: str, words: str, turned: str
) -> None:
    others = [line_of(OPEN, OPEN)] * 3  # which correction counts
    (found, *_) = verdicts.judged([line, *others])
    assert (found.outcome, found.words, found.turned.words) == (outcome, words, turned)
    ps = table_formulas.stepped_down([float(line[name] or "nan") for name in ("p of success", "p of cost")] + [0.9] * 6)
    assert table_formulas.verdict(line, *ps[:2]) == words


def test_no_scene_that_one_alone_solves_is_alike_from_368_scenes_on() -> None:
    for scenes, wanted in ((367, "tie"), (368, "equivalent")):
        found = difference(np.ones((scenes, 1)), np.ones((scenes, 1)), [""] * scenes, "share")
        assert verdicts.outcome(found.low, found.high, 1.0, verdicts.MARGIN, found.limit) == wanted
        assert found.limit == pytest.approx(1.0 - 0.025 ** (1.0 / scenes), rel=1e-12)


@pytest.mark.parametrize("scenes", [368, 500, 1000])
def test_who_is_a_point_worse_is_called_alike_in_a_fortieth_of_samples_at_most(scenes: int) -> None:
    """Summed over all samples, however many scenes the worse one solves alone."""
    counts = range(40)
    alike = [
        (won, lost) for won in counts for lost in range(won, 40) if exact_limit(won, lost, scenes) <= verdicts.MARGIN
    ]
    alike += [(lost, won) for won, lost in alike if won != lost]
    assert max(map(sum, alike)) < 40  # none beyond these counts
    for alone in (0.0, 0.0005, 0.002, 0.005, 0.02):
        shares = [alone, alone + verdicts.MARGIN, 1.0 - 2.0 * alone - verdicts.MARGIN]
        samples = [[won, lost, scenes - won - lost] for won, lost in alike]
        assert scipy.stats.multinomial.pmf(samples, scenes, shares).sum() <= 0.0251, alone


def test_scenes_that_stand_still_and_that_move_are_compared_apart() -> None:
    contest = CONTESTS["goal-obstacles"]
    rows = [row for row in rows_of(contest, 1) if row["split"] == "test"]
    families = list(dict.fromkeys(row["family"] for row in rows))
    names = dict(zip(families, ("rooms", "moving_crowd"), strict=True))
    moved = [row | {"family": names[row["family"]]} for row in rows]
    table = verdicts.pairs_table(Episodes(moved), COMMAND)
    apart = {
        scenes: verdicts.pairs_table(Episodes(row for row in moved if row["family"] == name), COMMAND)
        for scenes, name in (("static obstacles", "rooms"), ("moving obstacles", "moving_crowd"))
    }
    for scenes, alone in apart.items():
        assert [row for row in table.rows if row[1] == scenes] == alone.rows
    assert {row[1] for row in table.rows} == {"static obstacles", "moving obstacles"}


def test_beside_the_first_who_is_slow_the_first_at_the_requested_speed_is_compared_with_all() -> None:
    rows = [row for row in rows_of(CONTESTS["path-following"], 2) if row["split"] == "test" and row["policy"] != "ppo"]
    won = {named(entry): sum(number(row, "success") for row in mine) for entry, mine in groups(rows).items()}
    first, second = sorted(won, key=lambda name: -won[name])[:2]
    assert first == "C"  # which drives at 0.47 m/s, and B at 0.66
    assert second != "B"
    table = verdicts.pairs_table(Episodes(rows), COMMAND)
    pairs = {frozenset(row[2:4]) for row in table.rows}
    assert pairs == {frozenset((one, other)) for one in (first, second) for other in won if other != one}
    assert len(pairs) == len(table.rows)


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
    finding = findings.finding_of(contest, "p3dx", Episodes(row for row in lost if row["split"] == "test"))
    swept = [row for row in lost if row["split"] == "front"]
    front = findings.front_chart(contest, "p3dx", Episodes(swept))
    assert [each["label"] for each in front["series"]] == [named(entry) for entry in groups(swept) if entry[0] != "C"]
    once = [row | {"success": "1"} if row["speed"] == "0.9" else row for row in swept]
    *_, last = findings.front_chart(contest, "p3dx", Episodes(once))["series"]
    assert [point["asked"] for point in last["points"]] == ["0.9"]
    assert json.dumps([*finding.charts, front], allow_nan=False)


def test_a_column_of_a_later_version_leaves_tables_of_earlier_rows_as_they_are() -> None:
    contest = CONTESTS["docking"]
    rows = by_entry(Episodes.of(rows_of(contest, 0)).where(split="test"))
    now = Standings(contest, "docking", rows, COMMAND)
    wider = dataclasses.replace(contest, columns=(Column("later", "later"), *contest.columns))
    assert standings_table(dataclasses.replace(now, contest=wider), {}, Episodes()) == standings_table(
        now, {}, Episodes()
    )
