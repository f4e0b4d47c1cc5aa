"""The tables of a contest, from the rows of its episodes and the measured decision times."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import numpy as np

from wayfield.benchmarks.contests import (
    ALL_CONTESTS,
    COST,
    OWN_SPLIT,
    PACE_TOLERANCE,
    PUBLIC_SPLIT,
    TRANSFER_SPLIT,
    Contest,
)
from wayfield.benchmarks.leaderboards.crowd_tables import crowd_tables
from wayfield.benchmarks.leaderboards.disclosure import disclosed, inputs
from wayfield.benchmarks.leaderboards.entries import (
    COMPARED,
    ENDINGS,
    OFF_PACE,
    Entry,
    by_entry,
    by_scenario,
    cell,
    check_columns,
    class_words,
    costs,
    failing,
    gap,
    imputed,
    in_order,
    label,
    levels_of,
    mean_speed,
    off_pace,
    reading,
    scenarios,
    seeds_driven,
    short_cell,
    shown_speed,
    solved_mean_cell,
    success_cell,
)
from wayfield.benchmarks.leaderboards.matrix import better_table
from wayfield.benchmarks.leaderboards.verdicts import by_scenes, claims_table, pairs_table
from wayfield.benchmarks.records.episode import Episodes, Row, text
from wayfield.benchmarks.records.table import Table, code_span
from wayfield.benchmarks.statistics.aggregates import interval, mean
from wayfield.envs.scenarios import TIERS
from wayfield.envs.tasks.task import CONTROL_PERIOD


@dataclasses.dataclass(frozen=True)
class Standings:
    """The episodes of one contest under one set of conditions, by entry."""

    contest: Contest
    title: str
    entries: Mapping[Entry, Episodes]
    command: str  # what made the rows

    @property
    def own(self) -> bool:
        """Returns whether the scenarios are from the user's files."""
        return bool(next(iter(self.entries.values()))[0]["split"] == OWN_SPLIT)

    @property
    def public(self) -> bool:
        """Returns whether the scenarios are those of a public benchmark."""
        return bool(next(iter(self.entries.values()))[0]["split"] == PUBLIC_SPLIT)

    @property
    def source(self) -> str:
        """Returns the words of a note that say where the table comes from."""
        return made_by(self.command)


def contest_tables(rows: Sequence[Row], decisions: Sequence[Row], command: str, ladder: bool) -> dict[str, Table]:
    """Returns the tables of a run by the name of their file.

    Args:
        rows: the episodes.
        decisions: rows of `decisions.csv`; those that are missing leave their cells empty.
        command: what made the rows.
        ladder: whether the run is one over the levels of disturbance.

    Raises:
        ValueError: if the rows are not those of a contest of this version.
    """
    rows, decisions = Episodes.of(rows), Episodes.of(decisions)
    check_columns(rows)
    tables: dict[str, Table] = {}
    for contest in ALL_CONTESTS.values():
        for robot, mine in (rows.where(contest=contest.name).groups("robot") if rows else {}).items():
            stem = f"{contest.stem}_{robot}"
            title = f"{contest.title}, {robot}, {mine[0]['actuators']} actuators, {mine[0]['dynamics']} plant"
            _, at, hull = mine[0]["split"].partition("@")
            larger = contest.spec.repertoire.size_of(mine[0]["split"])
            title += class_words(mine[0]["split"]) + (f" (scenes x {larger:.3g})" if larger != 1.0 else "")
            if ladder:
                tables[f"{stem}_ladder"] = ladder_table(contest, title, mine, command)
                if any(mine.unique("agent_seed")):
                    tables[f"{stem}_ladder_pairs"] = pairs_table(mine, command)
                    tables[f"{stem}_ladder_claims"] = claims_table(tables[f"{stem}_ladder_pairs"], command)
                continue
            tested = mine.where(split=COMPARED)
            test = Standings(contest.of_rows(tested), title, by_entry(tested), command)
            seen = by_entry(mine.where(split=f"{TRANSFER_SPLIT}{at}{hull}"))
            tables[stem] = standings_table(test, seen, decisions.where(robot=robot) if decisions else decisions)
            tables[f"{stem}_board"] = board_table(test, decisions.where(robot=robot) if decisions else decisions)
            tables[f"{stem}_told"] = disclosure_table(test)
            tables[f"{stem}_families"] = family_table(test)
            if any(mine.unique("tier")):
                tables[f"{stem}_tiers"] = tier_table(test)
            if contest.published:
                tables[f"{stem}_published"] = published_table(test)
            tables[f"{stem}_better"] = better_table(test.contest, title, test.entries, test.source)
            tables[f"{stem}_pairs"] = pairs_table(mine, command)
            swept = mine.where(split="front")
            if swept:
                tables[f"{stem}_front"] = front_table(contest, title, swept, command)
            if any(mine.where(split=COMPARED).unique("agent_seed")):
                tables[f"{stem}_seeds"] = seed_table(test, seen)
                tables[f"{stem}_claims"] = claims_table(tables[f"{stem}_pairs"], command)
    return tables | crowd_tables(rows, command)


def ranked(standings: Standings) -> dict[Entry, Episodes]:
    """Returns the entries in the order of the contest's ranking, `entries.in_order`."""
    return {entry: standings.entries[entry] for entry in in_order(standings.contest, standings.entries)}


SCENES, PLACE_POLICY, PLACE_GAINS, SUCCESS, SPEED, ACCESS, LEARNED = (
    *("scenes", "policy", "gains", "success (%)", "speed (m/s)", "inputs", "training steps"),
)


DECISION = "ms a decision"
# what a leaderboard of path followers has beside the tracking error: header, metric, factor to its unit, decimals
_BEFORE_TRACKING = (("acquisition (s)", "acquisition_time", 1.0, 2), ("area (mm s)", "acquisition_area", 1e3, 0))


_SMOOTH = ("min_clearance", "ldlj")  # what a leaderboard has behind the speed


def _steps(rows: Episodes) -> str:
    """Returns how many steps the training of an entry took, or the search of its gains."""
    return str(rows[0]["learned_from"]).replace(" frames", "")


def board_table(standings: Standings, decisions: Episodes) -> Table:
    """Returns the leaderboard: of each kind of scenes the entries as they are ranked, with success and cost apart.

    Columns that say nothing of anybody are left out.
    """
    contest = standings.contest
    kinds: dict[str, dict[Entry, Episodes]] = {}
    for entry, rows in standings.entries.items():
        for scenes, mine in by_scenes(contest, rows).items():
            kinds.setdefault(scenes, {})[entry] = mine
    cost = contest.cost
    more = _BEFORE_TRACKING if contest.compared_by else ()
    ends, smooth = ([each for each in contest.columns if each.metric in of] for of in (ENDINGS, _SMOOTH))
    lines = []
    for scenes, entries in kinds.items():
        for entry, rows in ranked(dataclasses.replace(standings, entries=entries)).items():
            measured = [solved_mean_cell(rows, cost.metric, contest)]
            measured += [
                solved_mean_cell(rows, metric, contest, factor, decimals) for _, metric, factor, decimals in more
            ]
            speed = shown_speed(mean_speed(rows), 3)
            cells = [
                scenes,
                *entry,
                success_cell(rows),
                *(cell(each, rows, contest) for each in ends),
                *measured,
                speed,
            ]
            times = decisions.where(policy=entry[0], gains_name=entry[1], batch=1) if decisions else ()
            took = f"{times[0]['median_ms']:.3f}" if times else ""
            cells += [*(cell(each, rows, contest) for each in smooth), took]
            lines.append([*cells, inputs(rows[0]["knows"], contest.spec.observes), _steps(rows)])
    unit = "mm" if cost.unit == "m" else cost.unit
    note = (
        f"Ranked by success, then by {cost.name}. {cost.name[0].upper()}{cost.name[1:]}: mean of the runs that "
        f"succeeded, each entry at its own speed. Collisions, timeouts and left corridors are shares of all runs; "
        f"least clearance and LDLJ are means of all runs. {BRACKETS} {standings.source}"
    )
    header = [SCENES, PLACE_POLICY, PLACE_GAINS, SUCCESS, *(each.header for each in ends), f"{cost.name} ({unit})"]
    header += [*(name for name, *_ in more), SPEED, *(each.header for each in smooth), DECISION, ACCESS, LEARNED]
    said = [k < 3 or any(line[k] for line in lines) for k in range(len(header))]
    header, *lines = (list(itertools.compress(line, said)) for line in (header, *lines))
    return Table(f"{standings.title}: leaderboard", header, lines, note)


def standings_table(standings: Standings, seen: Mapping[Entry, Episodes], decisions: Episodes) -> Table:
    """Returns the main table: an entry a line, what it achieved first, what it is made of last."""
    contest = standings.contest
    there = {name for rows in standings.entries.values() for name in (*rows.names, COST)}
    columns = [each for each in contest.columns if each.metric in there]  # rows of earlier versions have fewer
    lines = []
    for entry, rows in ranked(standings).items():
        cells = [*entry, success_cell(rows)]
        for column in columns:
            mark = OFF_PACE if column.metric == "mean_speed" and off_pace(rows, contest.pace) else ""
            cells.append(cell(column, rows, contest) + mark)
        if decisions:
            times = decisions.where(policy=entry[0], gains_name=entry[1], batch=1)
            cells.append(f"{times[0]['p99_ms']:.2f}" if times else "")
        if seen:
            cells.append(gap(seen.get(entry), rows, contest))
        cells += [inputs(rows[0]["knows"], contest.spec.observes), rows[0]["parameters"], _steps(rows)]
        lines.append(cells)
    header = ["policy", "gains", "success (%)", *(column.header for column in columns)]
    header += ["compute p99 (ms)"] * bool(decisions) + [contest.gap.header if contest.gap else ""] * bool(seen)
    header += ["inputs", "parameters", "training steps"]
    return Table(standings.title, header, lines, _standings_note(standings, bool(seen)))


def _standings_note(standings: Standings, with_gap: bool) -> str:
    """Returns how the main table is read."""
    contest = standings.contest
    rows = next(iter(standings.entries.values()))
    seeds = seeds_driven(standings.entries.values(), contest)
    count = scenarios(rows)  # agents have a run each
    met = "scenarios from the user's files" if standings.own else "test scenarios"
    if standings.public:
        met = "scenarios of the public benchmark, on which nothing was trained or tuned"
    alone = standings.own or (standings.public and len(rows.unique("family")) == count)
    strata = "" if alone else ", stratified by family"
    brackets = BRACKETS.replace("where a family has", "where there are") if alone else BRACKETS
    sentences = (
        f" Gap: what the entry does better on the {TRANSFER_SPLIT} split, on which gains were chosen, than on test."
        if with_gap
        else ""
    )
    pace = (
        ""
        if contest.pace is None
        else f" {OFF_PACE}: the mean speed is off the {contest.pace:g} m/s asked for by more than "
        f"{100.0 * PACE_TOLERANCE:.0f} %: read its error at that speed."
    )
    return (
        f"{count} {met}, each policy in the same ones, from the same starts with the same seeds. {brackets} Errors: "
        f"bootstrap{strata}, agents drawn with the scenarios; times and scores: that of the successes, with the "
        "interval of the share of failures. Numbers are means over the episodes, but for "
        f"IQM, the interquartile mean. Rows of trained agents hold {seeds}. A "
        f"failure counts as {contest.counted}; speed, time of successes and effort are of the successes and "
        f"rank nobody. Training steps: of {CONTROL_PERIOD:g} s, driven by the training or the search. Compute: one "
        f"decision of one robot, measured alone.{sentences}{pace} {standings.source} {contest.notes}"
    )


BRACKETS = (
    "Brackets are 95 % intervals, none where a family has fewer than 5 scenarios. Success: Clopper and Pearson's, in "
    "as many trials as leave the mean as uncertain, at most one a scenario."
)


def disclosure_table(standings: Standings) -> Table:
    """Returns the privileged information, sensors, memory and protections of each entry."""
    lines = []
    for entry, rows in standings.entries.items():
        disclosure = disclosed(*entry, rows[0]["knows"], standings.contest)
        lines.append([label(entry), disclosure.briefing, disclosure.sees, disclosure.protected, _steps(rows)])
    note = f"What a policy gets before an episode and at every step, and what protects the robot. {standings.source}"
    header = ["policy", "before the episode", "at every step", "memory and safeguards", "training steps"]
    return Table(f"{standings.title}: what each has", header, lines, note)


def family_table(standings: Standings) -> Table:
    """Returns successes, and the cost, of each entry in each family."""
    families = list(dict.fromkeys(each for rows in standings.entries.values() for each in rows.unique("family")))
    return _table_by(standings, "family", families, "")


def _table_by(standings: Standings, column: str, values: Sequence[str], note: str) -> Table:
    """Returns a table of short cells with a column for each value of a column of the rows."""
    lines = []
    for entry, rows in standings.entries.items():
        groups = [rows.where(**{column: value}) for value in values]
        lines.append([label(entry), *(short_cell(group, standings.contest) for group in groups)])
    whole = f"{reading(standings.contest)} {standings.source}{note}"
    return Table(f"{standings.title}: by {column}", ["policy", *values], lines, whole)


def published_table(standings: Standings) -> Table:
    """Returns what others have published for a public benchmark, and beside it the scores of this run."""
    contest = standings.contest
    column = contest.columns[0]
    header = ["year", "entry", "score", "source"]
    lines = [[each.year, each.entry, each.score, each.source] for each in contest.published]
    ours = f"this run, {scenarios(next(iter(standings.entries.values())))} scenarios"
    for entry, rows in ranked(standings).items():
        lines.append(["", label(entry), f"{cell(column, rows, contest)} {column.header.partition(' ')[2]}", ours])
    note = (
        "Published scores are simulations in Gazebo, of other worlds of the same kind; those of this run come from a "
        f"simulation without Gazebo and are a proxy. Clips in brackets: scores of other clips do not compare. "
        f"{standings.source}"
    )
    return Table(f"{standings.title}: beside what is published", header, lines, note)


def tier_table(standings: Standings) -> Table:
    """Returns the same by tier."""
    return _table_by(standings, "tier", TIERS, " Tiers go by a geometric quantity of the scenario.")


def seed_table(standings: Standings, seen: Mapping[Entry, Episodes]) -> Table:
    """Returns each trained agent by itself, beside what it was to reach and the contest's first policy that has driven.

    Args:
        seen: the rows of the validation split, by which it is judged whether a seed has reached its bar.
    """
    contest = standings.contest
    there = [name for name in contest.policies if (name, "default") in standings.entries]
    first = there[0] if there else contest.policies[0]
    documented = standings.entries.get((first, "default"))

    def standing(rows: Episodes) -> tuple[float, float]:
        return float(rows["success"].mean()), -float(costs(rows, contest).mean())

    lines = []
    for entry, rows in standings.entries.items():
        for seed in filter(None, rows.unique("agent_seed")):
            mine = rows.where(agent_seed=seed)
            won, cost = standing(mine)
            over = "" if documented is None else "yes" if standing(mine) > standing(documented) else "no"
            judged = seen[entry].where(agent_seed=seed) if entry in seen else None
            reached = contest.bar.reached(judged) if contest.bar and judged else None
            bar = "" if reached is None else "yes" if reached else "no"
            lines.append([*entry, seed, f"{100.0 * won:.1f}", f"{-cost:.{contest.spec.cost.decimals}f}", bar, over])
    bar_words = contest.bar.words if contest.bar else "none is set"
    note = (
        f"Success in per cent, then the mean over the scenarios, a failure counted as {failing(contest)}. Bar: "
        f"{bar_words}. Over {first}: more successes, or as many at a lower cost. "
        f"{standings.source}"
    )
    header = ["policy", "gains", "seed", "success (%)", contest.cost_header]
    header += ["reaches the bar", f"over {first}"]
    return Table(f"{standings.title}: trained agents", header, lines, note)


@dataclasses.dataclass(frozen=True)
class Point:
    """One entry at one cruising speed."""

    target_speed: float  # m/s, the mean speed
    pace: float  # m/s, mean speed of the successes
    error: float  # m, mean of the costs
    low: float  # m, of the error's 95 % interval; NaN where there is none
    high: float
    lost: bool  # whether a run has failed
    off_pace: bool  # whether the pace is not the requested one


def front_points(contest: Contest, rows: Episodes) -> list[Point]:
    """Returns the points of the speed-accuracy front of one entry, by what the contest compares successes by."""
    points = []
    for requested, group in rows.groups("speed").items():
        error = imputed(group, contest.cost.metric)
        ends = interval(*by_scenario(group, error), mean) or (np.nan, np.nan)
        lost = bool((group["success"] == 0.0).any())
        away = off_pace(group, requested)
        points.append(Point(requested, mean_speed(group), float(error.mean()), *ends, lost, away))
    return points


def front_table(contest: Contest, title: str, rows: Episodes, command: str) -> Table:
    """Returns the error and the mean speed of each entry at each requested cruising speed."""
    contest = contest.of_rows(rows)
    requested = rows.unique("speed")
    cost, decimals = contest.cost, contest.cost.decimals
    lines = []
    for entry, mine in by_entry(rows).items():
        points = {point.target_speed: point for point in front_points(contest, mine)}
        cells = (_point_cell(points[each], decimals) if each in points else "" for each in requested)
        lines.append([label(entry), *cells])
    note = (
        f"{cost.name} in {cost.unit}, mean with its 95 % bootstrap interval, a failure counted as "
        f"{failing(contest)} | mean speed of the successes in m/s; {OFF_PACE}: off the asked one by more than "
        f"{100.0 * PACE_TOLERANCE:.0f} %: read its error at that speed. Policies without a cruising speed are left "
        f"out. {made_by(command)}"
    )
    return Table(f"{title}: asked for (m/s)", ["policy", *map(text, requested)], lines, note)


def _point_cell(point: Point, decimals: int) -> str:
    error = f"{point.error:.{decimals}f}"
    if not np.isnan(point.low):
        error += f" [{point.low:.{decimals}f}, {point.high:.{decimals}f}]"
    return f"{error} | {shown_speed(point.pace, 2)}{OFF_PACE * point.off_pace}"


def ladder_table(contest: Contest, title: str, rows: Episodes, command: str) -> Table:
    """Returns success and error (or time) of each entry at each level of disturbance."""
    levels = levels_of(rows)
    lines = []
    for entry, mine in by_entry(rows).items():
        groups = [mine.where(disturbance=level) for level in levels]
        lines.append(
            [label(entry), *(short_cell(group, contest, success_cell(group) if group else "") for group in groups)]
        )
    note = f"{reading(contest)} {BRACKETS} {made_by(command)}"
    return Table(f"{title}: disturbances", ["policy", *levels], lines, note)


def made_by(command: str) -> str:
    """Returns the words of a note that say where a table comes from."""
    return f"Made by {code_span(command)}, wayfield {version('wayfield')}."
