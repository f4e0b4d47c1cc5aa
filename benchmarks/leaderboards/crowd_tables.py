"""Tables over several contests of crowds: cross-play of policies, and the effect of the people's law and sight.

A world is one value: intervals are over worlds, stratified by family.
"""

from collections.abc import Mapping

from wayfield.benchmarks.contests import ALL_CONTESTS, CROSS, TEAMS, Contest
from wayfield.benchmarks.leaderboards.entries import COMPARED, Entry, by_entry, by_scenario, label, success_cell
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.table import Table, code_span
from wayfield.benchmarks.statistics.aggregates import interval, mean

_BESIDE = "beside "


def crowd_tables(rows: Episodes, command: str) -> dict[str, Table]:
    """Returns, by the name of their file, the tables over several contests that the rows of a run allow."""
    tables: dict[str, Table] = {}
    there = rows.where(split=COMPARED) if rows else rows
    for robot, mine in (there.groups("robot") if there else {}).items():
        if crossed := mine.where(contest=CROSS.name):
            tables[f"teams_{robot}_matrix"] = cross_table(robot, crossed, mine.where(contest=TEAMS.name), command)
        among = {name: each for name, each in mine.groups("contest").items() if _is_people(ALL_CONTESTS[name])}
        if len(among) > 1:
            tables[f"people_{robot}_matrix"] = people_table(robot, among, command)
    return tables


def _is_people(contest: Contest) -> bool:
    return contest.spec.name == "people"


def cross_table(robot: str, crossed: Episodes, alone: Episodes, command: str) -> Table:
    """Returns the cross-play: how many robots of the line's policy arrive beside the column's policy.

    Args:
        crossed: rows of worlds of two policies.
        alone: those of worlds of one, which stand on the diagonal.
    """
    names = crossed.unique("policy")
    pairs = {(name, mine[0]["gains_name"].removeprefix(_BESIDE)): mine for (name, _), mine in by_entry(crossed).items()}
    for (name, _), mine in by_entry(alone).items():
        if (name, name) not in pairs:  # the first set, as in the cross-play
            pairs[name, name] = mine
    lines = [
        [name, *(_arrived(pairs[name, beside]) if (name, beside) in pairs else "" for beside in names)]
        for name in names
    ]
    note = (
        "Share of the robots of the line's policy that arrive, in per cent, where every other robot is driven by the "
        "column's; on the diagonal all are. Brackets: 95 % bootstrap intervals over the worlds, by family. "
        f"Made by {code_span(command)}."
    )
    return Table(
        f"Teams, {robot}: who suffers from whom", ["policy", *(f"beside {name}" for name in names)], lines, note
    )


def _arrived(rows: Episodes) -> str:
    shares = rows.numbers("arrived")
    ends = interval(*by_scenario(rows, shares), mean)
    shown = f"{100.0 * shares.mean():.1f}"
    return shown if ends is None else f"{shown} [{100.0 * ends[0]:.1f}, {100.0 * ends[1]:.1f}]"


def people_table(robot: str, among: Mapping[str, Episodes], command: str) -> Table:
    """Returns successes of each policy by the law of the people, and whether they see the robot."""
    entries: dict[Entry, None] = {}
    for rows in among.values():
        entries |= dict.fromkeys(by_entry(rows))
    cells = {name: by_entry(rows) for name, rows in among.items()}
    lines = [
        [label(entry), *(success_cell(of[entry]) if entry in of else "" for of in cells.values())] for entry in entries
    ]
    header = ["policy", *(ALL_CONTESTS[name].title.removeprefix("Among people ") for name in among)]
    note = (
        "Successes in per cent, in the same scenarios in every column: only what the people do differs. Brackets: 95 % "
        f"intervals over the scenarios. Made by {code_span(command)}."
    )
    return Table(f"Among people, {robot}: the people's law, and whether they see the robot", header, lines, note)
