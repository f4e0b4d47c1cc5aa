"""The tables of a contest, from the rows of its episodes, the measured decision times and the cards of agents."""

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

import wayfield.policies
from wayfield.benchmarks.aggregates import better, interval, iqm, mean
from wayfield.benchmarks.contests import CONTESTS, TRAINED, TRANSFER_SPLIT, Contest
from wayfield.benchmarks.intervals import wilson
from wayfield.benchmarks.results import Row, number
from wayfield.benchmarks.tables import Table
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.task import CONTROL_PERIOD
from wayfield.policies.agent import load_agent
from wayfield.policies.ppo import shipped, trained
from wayfield.policies.tuned import tuning_runs

Entry = tuple[str, str]  # policy, and the name of its gains
Array = NDArray[np.float64]

TIERS = ("easy", "medium", "hard")
CORRIDOR = 1.0  # m, what a run that leaves the corridor counts as
IMPUTED = "imputed"  # the metric of `costs`


@dataclasses.dataclass(frozen=True)
class Column:
    """One column of the standings: a metric, how it is reduced, and how it is shown."""

    header: str
    metric: str
    decimals: int = 3
    factor: float = 1.0
    with_interval: bool = False
    successes_only: bool = False
    reduction: str = "iqm"


_COLUMNS: Mapping[str, tuple[Column, ...]] = {
    "path-following": (
        Column("RMS error (m)", IMPUTED, 4, with_interval=True),
        Column("p95 (m)", "cross_track_p95", 4),
        Column("max (m)", "cross_track_max", 3),
        Column("RMS over time (m)", "cross_track_rms_time", 4),
        Column("mean speed (m/s)", "mean_speed", 2, successes_only=True),
        Column("time (s)", "time", 1, successes_only=True),
        Column("LDLJ", "ldlj", 2),
        Column("effort (rad²/s)", "effort", 0, successes_only=True),
        Column("saturated (%)", "saturated_share", 1, 100.0, reduction="mean"),
        Column("faults", "faults", 2, reduction="mean"),
    ),
    "goal-obstacles": (
        Column("collision (%)", "collision", 1, 100.0, reduction="mean"),
        Column("SPL", "spl", 3, with_interval=True, reduction="mean"),
        Column("SCT", "sct", 3, with_interval=True, reduction="mean"),
        Column("BARN", "barn_score", 3, reduction="mean"),
        Column("time (s)", "time", 1, successes_only=True),
        Column("imputed (s)", IMPUTED, 1),
        Column("least clearance (m)", "min_clearance", 3),
        Column("mean (m)", "mean_clearance", 2),
        Column("under 0.1 m (%)", "near_share", 1, 100.0, reduction="mean"),
        Column("LDLJ", "ldlj", 2),
        Column("effort (rad²/s)", "effort", 0, successes_only=True),
        Column("faults", "faults", 2, reduction="mean"),
    ),
}

_REDUCTIONS = {"iqm": iqm, "mean": mean}


@dataclasses.dataclass(frozen=True)
class Standings:
    """The episodes of one contest under one set of conditions, by entry."""

    contest: Contest
    title: str
    entries: Mapping[Entry, list[Row]]


def contest_tables(
    rows: Sequence[Row], decisions: Sequence[Mapping[str, str]], command: str, ladder: bool
) -> dict[str, Table]:
    """Returns the tables of a run by the name of their file.

    Args:
        rows: the episodes.
        decisions: rows of `decisions.csv`; those that are missing leave their cells empty.
        command: what made the rows.
        ladder: whether the run is one over the levels of disturbance.
    """
    found: dict[str, Table] = {}
    for name, contest in CONTESTS.items():
        of_contest = [row for row in rows if row["document"] == name]
        for robot in dict.fromkeys(row["robot"] for row in of_contest):
            mine = [row for row in of_contest if row["robot"] == robot]
            stem = f"{name.replace('-', '_')}_{robot}"
            title = f"{contest.title}, {robot}, {mine[0]['actuators']} actuators, {mine[0]['dynamics']} plant"
            if ladder:
                found[f"{stem}_ladder"] = ladder_table(contest, title, mine, command)
                continue
            test = Standings(contest, title, by_entry(row for row in mine if row["split"] == "test"))
            seen = by_entry(row for row in mine if row["split"] == TRANSFER_SPLIT)
            found[stem] = standings_table(test, seen, [each for each in decisions if each["robot"] == robot], command)
            found[f"{stem}_families"] = family_table(test, command)
            found[f"{stem}_tiers"] = tier_table(test, command)
            found[f"{stem}_better"] = better_table(test, command)
            swept = [row for row in mine if row["split"] == "front"]
            if swept:
                found[f"{stem}_front"] = front_table(contest, title, swept, command)
            if any(policy in TRAINED for policy, _ in test.entries):
                found[f"{stem}_seeds"] = seed_table(test, command)
    return found


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
    """Returns the cost of each episode; a failure costs the whole clock, or the corridor's half width."""
    found = values(rows, contest.cost)
    failed = contest.max_episode_steps * CONTROL_PERIOD if contest.cost == "time" else CORRIDOR
    return np.where(values(rows, "success") == 1.0, found, failed)


def by_scenario(rows: Sequence[Row], numbers: Array) -> tuple[Array, list[str]]:
    """Returns numbers, one an episode, as a table (s, r), a line a scenario and a column a trained agent; and families.

    Raises:
        ValueError: if not every agent has met every scenario once.
    """
    agents = {gains: k for k, gains in enumerate(dict.fromkeys(row["gains"] for row in rows))}
    families = {_scenario(row): row["experiment"] for row in rows}
    lines = {scenario: k for k, scenario in enumerate(families)}
    table = np.full((len(lines), len(agents)), np.nan)
    for row, value in zip(rows, numbers, strict=True):
        table[lines[_scenario(row)], agents[row["gains"]]] = value
    if table.size != len(rows) or np.isnan(table).any():
        raise ValueError(f"{rows[0]['policy']}: {len(agents)} agents and {len(lines)} scenarios in {len(rows)} runs")
    return table, list(families.values())


def cost(entry: Entry, contest: Contest, row: Row) -> tuple[str, str, str]:
    """Returns what an entry knows, how many numbers it is made of, and what they were learned from."""
    policy, gains_name = entry
    if policy in TRAINED:
        seed, home = re.fullmatch(r"seed=(\d+)(?: home=(.*))?", row["gains"]).groups()  # type: ignore[union-attr]
        folders = trained(home) if home else shipped(contest.task, row["robot"])
        agent = load_agent(folders[int(seed)])
        training = agent.card["training"]
        taught = f", taught by {training['taught_by']}" if "taught_by" in training else ""
        return agent.knows, f"{agent.num_parameters:,}", f"{training['steps'] / 1e6:.1f} M frames{taught}"
    made = wayfield.policies.make(policy)
    runs = tuning_runs(policy, contest.name) if gains_name == "tuned" else 0
    return made.knows, str(len(dataclasses.fields(made))), f"{runs:,} runs" if runs else ""  # type: ignore[arg-type]


def standings_table(
    standings: Standings, seen: Mapping[Entry, list[Row]], decisions: Sequence[Mapping[str, str]], command: str
) -> Table:
    """Returns the main table: an entry a line, success first."""
    columns = _COLUMNS[standings.contest.name]
    lines = []
    for entry, rows in standings.entries.items():
        policy, gains_name = entry
        cells = [policy, gains_name, *cost(entry, standings.contest, rows[0])]
        cells.append(success_cell(rows))
        cells += [_cell(column, rows, standings.contest) for column in columns]
        times = [each for each in decisions if (each["policy"], each["gains_name"]) == entry and each["batch"] == "1"]
        cells.append(f"{float(times[0]['p99_ms']):.2f}" if times else "")
        cells.append(_gap(seen.get(entry, []), rows, standings.contest))
        lines.append(cells)
    header = ["policy", "gains", "knows", "parameters", "learned from", "success"]
    header += [column.header for column in columns]
    header += ["compute p99 (ms)", _GAP_HEADERS[standings.contest.name]]
    count = len(next(iter(standings.entries.values())))
    note = (
        f"{count} test scenarios, each policy in the same ones, from the same starts with the same seeds; success with "
        "its 95 % Wilson interval; numbers are interquartile means over the episodes (SPL, SCT, BARN and shares: means)"
        ", brackets 95 % bootstrap intervals, stratified by family. Rows of trained agents hold every seed; "
        "their intervals, that of success too, resample seeds and scenarios. Learned from: runs on "
        f"{TRANSFER_SPLIT} scenarios, or frames of {CONTROL_PERIOD:g} s on training scenarios. A failure counts as "
        f"{_IMPUTED[standings.contest.name]}; times without 'imputed', speed and effort are of the successes. Compute: "
        "one decision of one robot, measured alone. Gap: what the entry does better on the "
        f"{TRANSFER_SPLIT} split, on which gains were tuned, than on test. "
        f"Made by `{command}`, wayfield {_version()}. {_NOT_SHOWN[standings.contest.name]}"
    )
    return Table(standings.title, header, lines, note)


_GAP_HEADERS = {"path-following": "gap (RMS, m)", "goal-obstacles": "gap (success, %)"}
_IMPUTED = {"path-following": "an RMS error of 1 m", "goal-obstacles": "the whole clock in 'imputed'"}
_NOT_SHOWN = {
    "path-following": (
        "The policies cruise at the speed of their gains, 0.6 m/s where there is no other, and slow down as they see "
        "fit: read error and speed together, or the speed-accuracy front. Simulation only."
    ),
    "goal-obstacles": "Policies that know the map are told what others must find out: they are an upper reference. "
    "Simulation only.",
}


def family_table(standings: Standings, command: str) -> Table:
    """Returns successes, and for path following the RMS error, of each entry in each family."""
    families = list(dict.fromkeys(row["experiment"] for rows in standings.entries.values() for row in rows))
    lines = []
    for entry, rows in standings.entries.items():
        cells = []
        for family in families:
            mine = [row for row in rows if row["experiment"] == family]
            cells.append(_short_cell(mine, standings.contest))
        lines.append([label(entry), *cells])
    return Table(f"{standings.title}: by family", ["policy", *families], lines, _short_note(standings.contest, command))


def tier_table(standings: Standings, command: str) -> Table:
    """Returns the same by tier."""
    lines = []
    for entry, rows in standings.entries.items():
        groups = [[row for row in rows if row["tier"] == tier] for tier in TIERS]
        lines.append([label(entry), *(_short_cell(group, standings.contest) for group in groups)])
    return Table(
        f"{standings.title}: by tier",
        ["policy", *TIERS],
        lines,
        _short_note(standings.contest, command) + " Tiers go by a geometric quantity of the scenario.",
    )


def seed_table(standings: Standings, command: str) -> Table:
    """Returns each trained agent by itself, beside the documented controller: a seed that is under it has failed."""
    contest = standings.contest
    documented = standings.entries.get((contest.policies[0], "default"))

    def standing(rows: Sequence[Row]) -> tuple[float, float]:
        return float(values(rows, "success").mean()), -float(iqm(costs(rows, contest)))

    lines = []
    for (policy, _), rows in standings.entries.items():
        if policy not in TRAINED:
            continue
        for gains in dict.fromkeys(row["gains"] for row in rows):
            mine = [row for row in rows if row["gains"] == gains]
            won, _ = standing(mine)
            over = "" if documented is None else "yes" if standing(mine) > standing(documented) else "no"
            error = f"{float(iqm(costs(mine, contest))):.4f}"
            lines.append([policy, gains, f"{100.0 * won:.1f}", error, over])
    what = "RMS error (m)" if contest.cost != "time" else "imputed (s)"
    note = (
        f"Success in per cent, then interquartile mean over the test scenarios. Over {contest.policies[0]}: more "
        f"successes, or as many at a lower cost. Made by `{command}`, wayfield {_version()}."
    )
    header = ["policy", "seed", "success (%)", what, f"over {contest.policies[0]}"]
    return Table(f"{standings.title}: trained agents", header, lines, note)


def better_table(standings: Standings, command: str) -> Table:
    """Returns the paired matrix: how often the policy of the line does better than that of the column."""
    entries = list(standings.entries)
    lines = []
    for a in entries:
        cells = []
        for b in entries:
            if a == b:
                cells.append("")
                continue
            share, low, high = better_share(standings.entries[a], standings.entries[b], standings.contest.cost)
            # an interval clear of one half is marked: this pair is decided
            mark = "*" if low > 0.5 or high < 0.5 else ""
            cells.append(f"{share:.2f}{mark}")
        lines.append([label(a), *cells])
    note = (
        "Share of the test scenarios in which the policy of the line does better than that of the column, draws "
        f"counted half: success first, then the lower {standings.contest.cost.replace('_', ' ')}; a star marks a 95 % "
        f"stratified-bootstrap interval clear of 0.5. Made by `{command}`, wayfield {_version()}."
    )
    return Table(f"{standings.title}: better than", ["policy", *map(label, entries)], lines, note)


def better_share(rows_a: Sequence[Row], rows_b: Sequence[Row], cost: str) -> tuple[float, float, float]:
    """Returns how often A beats B over the scenarios that both met, and its 95 % interval.

    Raises:
        ValueError: if the two have not met the same scenarios.
    """
    rows_a, rows_b = (sorted(rows, key=_scenario) for rows in (rows_a, rows_b))
    if list(dict.fromkeys(map(_scenario, rows_a))) != list(dict.fromkeys(map(_scenario, rows_b))):
        raise ValueError("the two policies have not met the same scenarios: the comparison would not be paired")
    sides = []
    for rows in (rows_a, rows_b):
        won, families = by_scenario(rows, values(rows, "success"))
        # a run that fails may have no cost: it is not looked at
        sides += [won, by_scenario(rows, np.nan_to_num(values(rows, cost)))[0]]
    shares = better(*sides)
    low, high = interval(shares, families, mean)
    return float(shares.mean()), low, high


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
    lines = []
    for entry, mine in by_entry(rows).items():
        points = {point.asked: point for point in front_points(contest, mine)}
        found = [points[speed] for speed in asked]
        lines.append([label(entry), *(f"{p.error:.4f} [{p.low:.4f}, {p.high:.4f}] | {p.pace:.2f}" for p in found)])
    note = (
        "RMS error in m with its 95 % bootstrap interval, a failure counted as 1 m | mean speed in m/s; interquartile "
        f"means over the test scenarios of the front. Made by `{command}`, wayfield {_version()}."
    )
    return Table(f"{title}: asked for (m/s)", ["policy", *asked], lines, note)


def ladder_table(contest: Contest, title: str, rows: Sequence[Row], command: str) -> Table:
    """Returns success and error (or time) of each entry at each level of disturbance."""
    lines = []
    levels = [level for level in LEVELS if any(row["disturbance"] == level for row in rows)]
    levels += [level for level in dict.fromkeys(row["disturbance"] for row in rows) if level not in levels]
    for entry, mine in by_entry(rows).items():
        groups = [[row for row in mine if row["disturbance"] == level] for level in levels]
        lines.append([label(entry), *(_short_cell(group, contest, success_cell(group)) for group in groups)])
    note = f"{_short_note(contest, command)} Brackets: 95 % intervals, Wilson's or for trained agents bootstrap."
    return Table(f"{title}: disturbances", ["policy", *levels], lines, note)


def success_cell(rows: Sequence[Row]) -> str:
    """Returns the share of successes in per cent with its 95 % interval."""
    low, high = success_interval(rows)
    return f"{100.0 * values(rows, 'success').mean():.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


def success_interval(rows: Sequence[Row]) -> tuple[float, float]:
    """Returns the 95 % interval of the share of successes: Wilson's, or for trained agents the bootstrap's."""
    table, families = by_scenario(rows, values(rows, "success"))
    return wilson(int(table.sum()), len(table)) if table.shape[1] == 1 else interval(table, families, mean)


def _cell(column: Column, rows: Sequence[Row], contest: Contest) -> str:
    if column.successes_only:
        rows = [row for row in rows if number(row, "success") == 1.0]
    measured = costs(rows, contest) if column.metric == IMPUTED else values(rows, column.metric)
    found = measured[~np.isnan(measured)]
    if not len(found):
        return ""
    reduce = _REDUCTIONS[column.reduction]
    text = f"{float(reduce(found)) * column.factor:.{column.decimals}f}"
    if column.with_interval:
        low, high = (end * column.factor for end in interval(*by_scenario(rows, measured), reduce))
        text += f" [{low:.{column.decimals}f}, {high:.{column.decimals}f}]"
    return text


def _short_cell(rows: Sequence[Row], contest: Contest, success: str = "") -> str:
    """Returns the share of successes in per cent, or what is given in its place, and the IQM of the successes' cost."""
    if not rows:
        return ""
    won = [row for row in rows if number(row, "success") == 1.0]
    text = success or f"{100.0 * len(won) / len(rows):.0f}"
    if won:
        decimals = 3 if contest.cost != "time" else 1
        text += f" | {float(iqm(values(won, contest.cost))):.{decimals}f}"
    return text


def _short_note(contest: Contest, command: str) -> str:
    what = "cross-track RMS in m" if contest.cost != "time" else "time in s"
    reading = f"Success in per cent | {what}, interquartile mean over the successes."
    return f"{reading} Made by `{command}`, wayfield {_version()}."


def _gap(seen: Sequence[Row], test: Sequence[Row], contest: Contest) -> str:
    if not seen:
        return ""
    if contest.cost == "time":
        return f"{100.0 * (values(seen, 'success').mean() - values(test, 'success').mean()):+.1f}"
    return f"{float(iqm(costs(test, contest))) - float(iqm(costs(seen, contest))):+.4f}"


def _scenario(row: Row) -> tuple[str, str]:
    return row["scenario"], row["episode"]


def _version() -> str:
    from importlib.metadata import version

    return version("wayfield")
