"""The tables of a contest, from the rows of its episodes and the measured decision times."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.aggregates import better, interval, iqm, mean
from wayfield.benchmarks.contests import CONTESTS, COST, OWN_SPLIT, TRANSFER_SPLIT, Column, Contest
from wayfield.benchmarks.intervals import wilson
from wayfield.benchmarks.results import Row, number
from wayfield.benchmarks.table import Table
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.scenarios import TIERS
from wayfield.envs.task import CONTROL_PERIOD

Entry = tuple[str, str]  # policy, and the name of its gains
Array = NDArray[np.float64]

COMPARED = ("test", OWN_SPLIT)  # the splits that entries are ranked on

_REDUCTIONS = {"iqm": iqm, "mean": mean}


@dataclasses.dataclass(frozen=True)
class Standings:
    """The episodes of one contest under one set of conditions, by entry."""

    contest: Contest
    title: str
    entries: Mapping[Entry, list[Row]]
    command: str  # what made the rows

    @property
    def own(self) -> bool:
        """Returns whether the scenarios are from the user's files."""
        return next(iter(self.entries.values()))[0]["split"] == OWN_SPLIT

    @property
    def source(self) -> str:
        """Returns the words of a note that say where the table comes from."""
        return made_by(self.command)


def contest_tables(
    rows: Sequence[Row], decisions: Sequence[Mapping[str, str]], command: str, ladder: bool
) -> dict[str, Table]:
    """Returns the tables of a run by the name of their file.

    Args:
        rows: the episodes.
        decisions: rows of `decisions.csv`; those that are missing leave their cells empty.
        command: what made the rows.
        ladder: whether the run is one over the levels of disturbance.

    Raises:
        ValueError: if the rows are not those of a contest of this version.
    """
    check_columns(rows)
    found: dict[str, Table] = {}
    for contest in CONTESTS.values():
        of_contest = [row for row in rows if row["contest"] == contest.name]
        for robot in dict.fromkeys(row["robot"] for row in of_contest):
            mine = [row for row in of_contest if row["robot"] == robot]
            stem = f"{contest.stem}_{robot}"
            title = f"{contest.spec.title}, {robot}, {mine[0]['actuators']} actuators, {mine[0]['dynamics']} plant"
            if ladder:
                found[f"{stem}_ladder"] = ladder_table(contest, title, mine, command)
                continue
            test = Standings(contest, title, by_entry(row for row in mine if row["split"] in COMPARED), command)
            seen = by_entry(row for row in mine if row["split"] == TRANSFER_SPLIT)
            found[stem] = standings_table(test, seen, [each for each in decisions if each["robot"] == robot])
            found[f"{stem}_families"] = family_table(test)
            found[f"{stem}_tiers"] = tier_table(test)
            found[f"{stem}_better"] = better_table(test)
            swept = [row for row in mine if row["split"] == "front"]
            if swept:
                found[f"{stem}_front"] = front_table(contest, title, swept, command)
            if any(row["agent_seed"] for rows_of in test.entries.values() for row in rows_of):
                found[f"{stem}_seeds"] = seed_table(test)
    return found


def check_columns(rows: Sequence[Row]) -> None:
    """Raises ValueError, naming the columns, unless the rows are those of a contest of this version."""
    missing = [name for name in _NEEDED if rows and name not in rows[0]]
    if missing:
        raise ValueError(
            f"the episodes have no column {', '.join(missing)}: they are of an earlier version; run the contest again"
        )


_NEEDED = ("contest", "family", "split", "failure_cost", "agent_seed", "knows")


def by_entry(rows: Iterable[Row]) -> dict[Entry, list[Row]]:
    """Returns the rows of each entry, in the order in which entries come up."""
    entries: dict[Entry, list[Row]] = {}
    for row in rows:
        entries.setdefault((row["policy"], row["gains_name"]), []).append(row)
    return entries


def label(entry: Entry) -> str:
    """Returns how tables and figures call an entry."""
    policy, gains_name = entry
    return policy if gains_name == "default" else f"{policy} ({gains_name})"


def values(rows: Sequence[Row], metric: str) -> Array:
    """Returns a metric of each episode."""
    return np.array([number(row, metric) for row in rows])


def costs(rows: Sequence[Row], contest: Contest) -> Array:
    """Returns the cost of each episode; that of a failure is in its row."""
    return np.where(
        values(rows, "success") == 1.0, values(rows, contest.spec.cost.metric), values(rows, "failure_cost")
    )


def by_scenario(rows: Sequence[Row], numbers: Array) -> tuple[Array, list[str]]:
    """Returns numbers, one an episode, as a table (s, r), a line a scenario and a column a trained agent; and strata.

    The strata are the families; scenarios from the user's files, each of which is its own family, are one stratum.

    Raises:
        ValueError: if not every agent has met every scenario once.
    """
    agents = {seed: k for k, seed in enumerate(dict.fromkeys(row["agent_seed"] for row in rows))}
    strata = {_scenario(row): OWN_SPLIT if row["split"] == OWN_SPLIT else row["family"] for row in rows}
    lines = {scenario: k for k, scenario in enumerate(strata)}
    table = np.full((len(lines), len(agents)), np.nan)
    for row, value in zip(rows, numbers, strict=True):
        table[lines[_scenario(row)], agents[row["agent_seed"]]] = value
    if table.size != len(rows) or np.isnan(table).any():
        raise ValueError(f"{rows[0]['policy']}: {len(agents)} agents and {len(lines)} scenarios in {len(rows)} runs")
    return table, list(strata.values())


def standings_table(
    standings: Standings, seen: Mapping[Entry, list[Row]], decisions: Sequence[Mapping[str, str]]
) -> Table:
    """Returns the main table: an entry a line, what it achieved first, what it is made of last."""
    contest = standings.contest
    lines = []
    for entry, rows in standings.entries.items():
        cells = [*entry, success_cell(rows)]
        cells += [_cell(column, rows, contest) for column in contest.columns]
        times = [each for each in decisions if (each["policy"], each["gains_name"]) == entry and each["batch"] == "1"]
        cells.append(f"{float(times[0]['p99_ms']):.2f}" if times else "")
        cells.append(_gap(seen.get(entry, []), rows, contest))
        cells += [rows[0][name] for name in ("knows", "parameters", "learned_from")]
        lines.append(cells)
    header = ["policy", "gains", "success", *(column.header for column in contest.columns)]
    header += ["compute p99 (ms)", contest.gap.header, "knows", "parameters", "learned from"]
    count = len(next(iter(standings.entries.values())))
    met = "scenarios from the user's files" if standings.own else "test scenarios"
    strata = "" if standings.own else ", stratified by family"
    note = (
        f"{count} {met}, each policy in the same ones, from the same starts with the same seeds; success with "
        "its 95 % Wilson interval; numbers are interquartile means over the episodes (SPL, SCT, BARN and shares: means)"
        f", brackets 95 % bootstrap intervals{strata}. Rows of trained agents hold every seed; "
        "their intervals, that of success too, resample seeds and scenarios. Learned from: runs on "
        f"{TRANSFER_SPLIT} scenarios, or frames of {CONTROL_PERIOD:g} s on training scenarios. A failure counts as "
        f"{contest.counted}; times without 'imputed', speed and effort are of the successes. Compute: "
        "one decision of one robot, measured alone. Gap: what the entry does better on the "
        f"{TRANSFER_SPLIT} split, on which gains were tuned, than on test. {standings.source} {contest.notes}"
    )
    return Table(standings.title, header, lines, note)


def family_table(standings: Standings) -> Table:
    """Returns successes, and the cost of the successes, of each entry in each family."""
    families = list(dict.fromkeys(row["family"] for rows in standings.entries.values() for row in rows))
    lines = []
    for entry, rows in standings.entries.items():
        cells = []
        for family in families:
            mine = [row for row in rows if row["family"] == family]
            cells.append(_short_cell(mine, standings.contest))
        lines.append([label(entry), *cells])
    note = f"{_reading(standings.contest)} {standings.source}"
    return Table(f"{standings.title}: by family", ["policy", *families], lines, note)


def tier_table(standings: Standings) -> Table:
    """Returns the same by tier."""
    lines = []
    for entry, rows in standings.entries.items():
        groups = [[row for row in rows if row["tier"] == tier] for tier in TIERS]
        lines.append([label(entry), *(_short_cell(group, standings.contest) for group in groups)])
    note = f"{_reading(standings.contest)} {standings.source} Tiers go by a geometric quantity of the scenario."
    return Table(f"{standings.title}: by tier", ["policy", *TIERS], lines, note)


def seed_table(standings: Standings) -> Table:
    """Returns each trained agent by itself, beside the documented controller: a seed that is under it has failed."""
    contest = standings.contest
    documented = standings.entries.get((contest.policies[0], "default"))

    def standing(rows: Sequence[Row]) -> tuple[float, float]:
        return float(values(rows, "success").mean()), -float(iqm(costs(rows, contest)))

    lines = []
    for entry, rows in standings.entries.items():
        for seed in dict.fromkeys(row["agent_seed"] for row in rows if row["agent_seed"]):
            mine = [row for row in rows if row["agent_seed"] == seed]
            won, cost = standing(mine)
            over = "" if documented is None else "yes" if standing(mine) > standing(documented) else "no"
            lines.append([*entry, seed, f"{100.0 * won:.1f}", f"{-cost:.{contest.spec.cost.decimals}f}", over])
    note = (
        f"Success in per cent, then interquartile mean over the scenarios. Over {contest.policies[0]}: more "
        f"successes, or as many at a lower cost. {standings.source}"
    )
    header = ["policy", "gains", "seed", "success (%)", contest.cost_header, f"over {contest.policies[0]}"]
    return Table(f"{standings.title}: trained agents", header, lines, note)


def better_table(standings: Standings) -> Table:
    """Returns the paired matrix: how often the policy of the line does better than that of the column."""
    entries = list(standings.entries)
    lines = []
    for a in entries:
        cells = []
        for b in entries:
            if a == b:
                cells.append("")
                continue
            often, low, high = how_often_better(standings.entries[a], standings.entries[b], standings.contest)
            # an interval clear of one half is marked: this pair is decided
            mark = "*" if low > 0.5 or high < 0.5 else ""
            cells.append(f"{often:.2f}{mark}")
        lines.append([label(a), *cells])
    note = (
        "Share of the scenarios in which the policy of the line does better than that of the column, draws "
        f"counted half: success first, then the lower {standings.contest.spec.cost.name}; a star marks a 95 % "
        f"{'' if standings.own else 'stratified-'}bootstrap interval clear of 0.5. {standings.source}"
    )
    return Table(f"{standings.title}: better than", ["policy", *map(label, entries)], lines, note)


def how_often_better(rows_a: Sequence[Row], rows_b: Sequence[Row], contest: Contest) -> tuple[float, float, float]:
    """Returns how often A beats B over the scenarios that both met, and its 95 % interval.

    Raises:
        ValueError: if the two have not met the same scenarios.
    """
    rows_a, rows_b = (sorted(rows, key=_scenario) for rows in (rows_a, rows_b))
    if list(dict.fromkeys(map(_scenario, rows_a))) != list(dict.fromkeys(map(_scenario, rows_b))):
        raise ValueError("the two policies have not met the same scenarios: the comparison would not be paired")
    sides = []
    for rows in (rows_a, rows_b):
        won, strata = by_scenario(rows, values(rows, "success"))
        # a run that fails may have no cost: it is not looked at
        sides += [won, by_scenario(rows, np.nan_to_num(values(rows, contest.spec.cost.metric)))[0]]
    wins = better(*sides)
    low, high = interval(wins, strata, mean)
    return float(wins.mean()), low, high


@dataclasses.dataclass(frozen=True)
class Point:
    """One entry at one cruising speed."""

    asked: str  # m/s, the cruising speed
    pace: float  # m/s, IQM of the mean speeds
    error: float  # m, IQM of the costs
    low: float  # m, of the error's 95 % interval
    high: float
    lost: bool  # whether a run has failed


def front_points(contest: Contest, rows: Sequence[Row]) -> list[Point]:
    """Returns the points of the speed-accuracy front of one entry."""
    points = []
    for asked in dict.fromkeys(row["speed"] for row in rows):
        group = [row for row in rows if row["speed"] == asked]
        error = costs(group, contest)
        low, high = interval(*by_scenario(group, error), iqm)
        pace = float(iqm(values(group, "mean_speed")))
        lost = bool((values(group, "success") == 0.0).any())
        points.append(Point(asked, pace, float(iqm(error)), low, high, lost))
    return points


def front_table(contest: Contest, title: str, rows: Sequence[Row], command: str) -> Table:
    """Returns the error and the mean speed of each entry at each cruising speed that it was asked for."""
    asked = list(dict.fromkeys(row["speed"] for row in rows))
    cost, decimals = contest.spec.cost, contest.spec.cost.decimals
    lines = []
    for entry, mine in by_entry(rows).items():
        points = {point.asked: point for point in front_points(contest, mine)}
        found = [points[speed] for speed in asked]
        lines.append([label(entry), *(_point_cell(point, decimals) for point in found)])
    note = (
        f"{cost.name} in {cost.unit} with its 95 % bootstrap interval, a failure counted as {contest.counted} | mean "
        "speed in m/s, policies without a cruising speed left out; interquartile "
        f"means over the scenarios of the front. {made_by(command)}"
    )
    return Table(f"{title}: asked for (m/s)", ["policy", *asked], lines, note)


def _point_cell(point: Point, decimals: int) -> str:
    error, low, high = (f"{each:.{decimals}f}" for each in (point.error, point.low, point.high))
    return f"{error} [{low}, {high}] | {point.pace:.2f}"


def ladder_table(contest: Contest, title: str, rows: Sequence[Row], command: str) -> Table:
    """Returns success and error (or time) of each entry at each level of disturbance."""
    lines = []
    levels = [level for level in LEVELS if any(row["disturbance"] == level for row in rows)]
    levels += [level for level in dict.fromkeys(row["disturbance"] for row in rows) if level not in levels]
    for entry, mine in by_entry(rows).items():
        groups = [[row for row in mine if row["disturbance"] == level] for level in levels]
        lines.append([label(entry), *(_short_cell(group, contest, success_cell(group)) for group in groups)])
    brackets = "Brackets: 95 % intervals, Wilson's or for trained agents bootstrap."
    note = f"{_reading(contest)} {made_by(command)} {brackets}"
    return Table(f"{title}: disturbances", ["policy", *levels], lines, note)


def success_cell(rows: Sequence[Row]) -> str:
    """Returns the share of successes in per cent with its 95 % interval."""
    low, high = success_interval(rows)
    return f"{100.0 * values(rows, 'success').mean():.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


def success_interval(rows: Sequence[Row]) -> tuple[float, float]:
    """Returns the 95 % interval of the share of successes: Wilson's, or for trained agents the bootstrap's."""
    table, strata = by_scenario(rows, values(rows, "success"))
    return wilson(int(table.sum()), len(table)) if table.shape[1] == 1 else interval(table, strata, mean)


def _cell(column: Column, rows: Sequence[Row], contest: Contest) -> str:
    if column.successes_only:
        rows = [row for row in rows if number(row, "success") == 1.0]
    measured = _measured(column, rows, contest)
    found = measured[~np.isnan(measured)]
    if not len(found):
        return ""
    reduce = _REDUCTIONS[column.reduction]
    text = f"{float(reduce(found)) * column.factor:.{column.decimals}f}"
    if column.with_interval:
        low, high = (end * column.factor for end in interval(*by_scenario(rows, measured), reduce))
        text += f" [{low:.{column.decimals}f}, {high:.{column.decimals}f}]"
    return text


def _measured(column: Column, rows: Sequence[Row], contest: Contest) -> Array:
    return costs(rows, contest) if column.metric == COST else values(rows, column.metric)


def _short_cell(rows: Sequence[Row], contest: Contest, success: str = "") -> str:
    """Returns the share of successes in per cent, or what is given in its place, and the IQM of the successes' cost."""
    if not rows:
        return ""
    won = [row for row in rows if number(row, "success") == 1.0]
    text = success or f"{100.0 * len(won) / len(rows):.0f}"
    if won:
        cost = contest.spec.cost
        text += f" | {float(iqm(values(won, cost.metric))):.{cost.decimals}f}"
    return text


def _reading(contest: Contest) -> str:
    """Returns how a cell of `_short_cell` is read."""
    cost = contest.spec.cost
    return f"Success in per cent | {cost.name} in {cost.unit}, interquartile mean over the successes."


def _gap(seen: Sequence[Row], test: Sequence[Row], contest: Contest) -> str:
    """Returns what an entry does better on the split that gains were tuned on; "" where it has not been there."""
    if not seen:
        return ""
    column = contest.gap
    reduce = _REDUCTIONS[column.reduction]
    there, here = (float(reduce(_measured(column, rows, contest))) for rows in (seen, test))
    better_there = here - there if column.metric == COST else there - here  # lower costs are better
    return f"{column.factor * better_there:+.{column.decimals}f}"


def _scenario(row: Row) -> tuple[str, str]:
    return row["scenario"], row["episode"]


def made_by(command: str) -> str:
    """Returns the words of a note that say where a table comes from."""
    return f"Made by `{command}`, wayfield {version('wayfield')}."
