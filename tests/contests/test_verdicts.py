"""Verdicts on pairs, and what tables and charts make of a law that never arrives."""

import json
import math

import pytest
from oracles.drawn_tables import (
    COMMAND,
    NAN,
    groups,
    named,
    number,
    rows_of,
)

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.leaderboards import verdicts
from wayfield.benchmarks.leaderboards.leaderboard import contest_tables
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.report import findings

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
