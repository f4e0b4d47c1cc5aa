"""The tables of the documents, one each: our figures beside the published ones, from the rows of the results alone."""

import dataclasses
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence

from wayfield.benchmarks.cases import Case, Figure
from wayfield.benchmarks.contests import OF_KIND
from wayfield.benchmarks.contests.contest import DEGREES
from wayfield.benchmarks.crossed import exact_interval
from wayfield.benchmarks.documents import TITLES
from wayfield.benchmarks.results import Row, number
from wayfield.benchmarks.table import Table

_OUTCOMES = ("success", "collision", "left_corridor", "timeout")


@dataclasses.dataclass(frozen=True)
class Column:
    """One column: the metrics that its cells show, the factor to the shown unit, and the decimals."""

    header: str
    metrics: tuple[str, ...]
    decimals: int = 3
    factor: float = 1.0


_PATH_COLUMNS = (
    Column("RMS error (m)", ("cross_track_rms",)),
    Column("over time (m)", ("cross_track_rms_time",)),
    Column("max (m)", ("cross_track_max",)),
    Column("steady offset (m)", ("steady_offset",), 4),
    Column("mean speed (m/s)", ("mean_speed",), 2),
    Column("time (s)", ("time",), 2),
    Column("jumps", ("reference_jumps",), 0),
)

_COLUMNS = {
    "A": _PATH_COLUMNS,
    "B": (
        Column("arrivals (s)", tuple(f"arrival_time_{i}" for i in range(1, 5)), 2),
        Column("path length then (m)", ("arrival_path_length",), 2),
        Column("heading off then (deg)", ("arrival_heading_error",), 1, DEGREES),
        Column("time (s)", ("time",), 2),
        Column("final error (m)", ("final_position_error",)),
        Column("(deg)", ("final_heading_error",), 1, DEGREES),
        Column("clearance (m)", ("min_clearance",), 2),
    ),
    "C": (
        Column("within 0.25 m (s)", ("arrival_time_1",), 2),
        Column("time (s)", ("time",), 2),
        Column("from centres (m)", ("centre_distance",), 2),
        Column("final x error (m)", ("final_x_error",)),
        Column("y (m)", ("final_y_error",)),
        Column("heading (deg)", ("final_heading_error",), 1, DEGREES),
        Column("ends at (m)", ("final_x", "final_y")),
    ),
}

_NOTES = {
    "A": (
        "Cross-track errors: RMS over the driven arc length, then over time as published; + is left of the path. "
        "A success on a course without end is a lap inside the corridor of 1 m; "
        "jumps are leaps of the reference point by more than 0.5 m."
    ),
    "B": "Arrivals at the waypoints and the goal, within 0.25 m or the switching radius.",
    "C": (
        "A success is within 2 cm. The rows with a stop radius are runs with 1 mm of noise in the measured position: "
        "the document's real runs, which were disturbed too, stopped short of the goal. Table 1 prints an x error of "
        "0.058 m for scenario 2, 0.020 m when a misprint is mended."
    ),
}


def document_tables(rows: Sequence[Row], cases: Iterable[Case]) -> list[Table]:
    """Returns a table for each document that the rows hold, with the figures published for the cases."""
    published = {case.key: case.published for case in cases}
    order = list(dict.fromkeys(row["document"] for row in rows))
    return [_table(document, [row for row in rows if row["document"] == document], published) for document in order]


def reproduced(rows: Sequence[Row], cases: Iterable[Case]) -> tuple[str, Table]:
    """Returns how well the published figures are met, as a sentence and as a small table, a document a line."""
    published = {case.key: case.published for case in cases}
    lines = []
    met = asked = 0
    for document in dict.fromkeys(row["document"] for row in rows):
        mine = [row for row in rows if row["document"] == document]
        off = [
            deviation(group, {metric: figure})
            for (experiment, policy, gains, *_), group in _groups(mine).items()
            for metric, figure in published.get((document, experiment, policy, gains), {}).items()
        ]
        if off:
            close = sum(each <= CLOSE for each in off)
            met, asked = met + close, asked + len(off)
            missed = sum(math.isinf(each) for each in off)
            title = TITLES.get(document, document).removeprefix("Document ")
            lines.append([title, f"{close} of {len(off)}", f"{100.0 * statistics.median(off):.1f} %", str(missed)])
    sentence = f"The documents: {met} of {asked} published figures are met within {100.0 * CLOSE:.0f} %."
    if not asked:
        sentence = f"The documents: {len(rows)} runs, for none of which a figure was published."
    note = "Figures of every plant; what never came is an arrival of which the document tells and ours has none."
    return sentence, Table("The three documents", ["document", "met", "median off", "never came"], lines, note)


def ranked(rows: Sequence[Row]) -> tuple[str, Table]:
    """Returns who does best in a scenario of the user's own, as a sentence and as a small table.

    A run that succeeds comes before one that fails; then the error counts on a path, and elsewhere the time.
    """
    on_path = any(row["cross_track_rms"] for row in rows)
    metric, name, decimals = ("cross_track_rms", "RMS error (m)", 4) if on_path else ("time", "time (s)", 2)

    def cost(row: Row) -> float:
        value = number(row, metric)
        return math.inf if math.isnan(value) else value

    order = sorted(rows, key=lambda row: (row["success"] != "1", cost(row)))
    lines = [
        [
            row["policy"],
            row["dynamics"],
            _outcome([row]),
            f"{cost(row):.{decimals}f}",
            f"{number(row, 'mean_speed'):.2f}",
        ]
        for row in order
    ]
    first, plants = order[0], len({row["dynamics"] for row in rows})
    won = f"{first['policy']} does best: {name.split(' (')[0]} {cost(first):.{decimals}f} {name.split('(')[1][:-1]}"
    if first["success"] != "1":
        won = "No policy succeeds"
    met = f"{rows[0]['experiment']}: {len(rows) // plants} policies, one scenario."
    sentence = f"{met} {won}; one run each, so without an interval."
    header = ["policy", "plant", "outcome", name, "speed (m/s)"]
    return sentence, Table(str(rows[0]["experiment"]), header, lines, "")


CLOSE = 0.05  # of a published figure: relative deviation that counts as met


def _groups(rows: Sequence[Row]) -> dict[tuple[str, ...], list[Row]]:
    """Returns the episodes of each line of a document's table."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        key = tuple(row[name] for name in ("experiment", "policy", "gains", "dynamics", "actuators"))
        groups.setdefault(key, []).append(row)
    return groups


def _shown(document: str) -> tuple[tuple[Column, ...], str]:
    """Returns the columns of a document's table, or of that of a scenario of the user's own, and its note."""
    if document in _COLUMNS:
        return _COLUMNS[document], _NOTES[document]
    contest = OF_KIND[document]
    columns = (Column(each.header, (each.metric,), each.decimals, each.factor) for each in contest.own_columns)
    return tuple(columns), contest.own_note


def _table(
    document: str, rows: Sequence[Row], published: Mapping[tuple[str, str, str, str], Mapping[str, Figure]]
) -> Table:
    columns, note = _shown(document)
    groups = _groups(rows)
    tiers = {row["actuators"] for row in rows}
    lines = []
    compared = False
    for (experiment, policy, gains, dynamics, actuators), group in groups.items():
        known = published.get((document, experiment, policy, gains), {})
        compared = compared or bool(known)
        plant = dynamics if tiers == {"ideal"} else f"{dynamics}, {actuators}"
        name = f"{policy} {gains}".strip()
        cells = [_cell(column, group, known) for column in columns]
        lines.append([experiment, name, plant, _outcome(group), *cells, _deviation(group, known)])
    header = ["experiment", "policy", "plant", "outcome", *(column.header for column in columns), "off by"]
    # a column that no row of this run fills only takes room
    filled = [i for i in range(len(header)) if i < 4 or any(line[i] for line in lines)]
    if compared:
        note = "Cells read ours / published; off by is the largest deviation from a published figure. " + note
    return Table(
        TITLES.get(document, f"{document.title()}: {rows[0]['experiment']}"),
        [header[i] for i in filled],
        [[line[i] for i in filled] for line in lines],
        note,
    )


def _cell(column: Column, group: Sequence[Row], published: Mapping[str, Figure]) -> str:
    """Returns the mean of each metric, with the standard deviation of several episodes, and the published figures."""
    ours = [_measured(column, metric, group) for metric in column.metrics]
    theirs = [_published(column, published[metric]) for metric in column.metrics if metric in published]
    text = ", ".join(each for each in ours if each)
    if not theirs:
        return text
    return f"{text or 'never'} / {', '.join(theirs)}"


def _measured(column: Column, metric: str, group: Sequence[Row]) -> str:
    values = [value * column.factor for row in group if not math.isnan(value := number(row, metric))]
    if not values:
        return ""
    text = _fixed(statistics.fmean(values), column.decimals)
    if len(values) > 1:
        text += f" ± {statistics.stdev(values):.{column.decimals}f}"
    if len(values) < len(group):
        text += f" ({len(values)} of {len(group)})"
    return text


def _published(column: Column, figure: Figure) -> str:
    ends = figure if isinstance(figure, tuple) else (figure,)
    return " to ".join(_fixed(end * column.factor, column.decimals) for end in ends)


def _fixed(value: float, decimals: int) -> str:
    """Returns the value with that many decimals, never a negative zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _outcome(group: Sequence[Row]) -> str:
    """Returns how a single episode ended, or the share of successes of several with its 95 % interval."""
    if len(group) == 1:
        return next(name for name in _OUTCOMES if number(group[0], name) == 1.0).replace("_", " ")
    successes = sum(number(row, "success") == 1.0 for row in group)
    low, high = exact_interval(successes / len(group), len(group))
    return f"{successes}/{len(group)} [{low:.2f}, {high:.2f}]"


def _deviation(group: Sequence[Row], published: Mapping[str, Figure]) -> str:
    """Returns the largest relative deviation of the means from the published figures, in words."""
    worst = deviation(group, published)
    if not published:
        return ""
    if math.isinf(worst):
        return "never"
    return f"{100.0 * worst:.1f} %" if worst < 1.0 else "> 100 %"


def deviation(group: Sequence[Row], published: Mapping[str, Figure]) -> float:
    """Returns the largest relative deviation of the means from the published figures; inf where one never came."""
    worst = 0.0
    for metric, figure in published.items():
        values = [value for row in group if not math.isnan(value := number(row, metric))]
        if not values:
            return math.inf
        low, high = figure if isinstance(figure, tuple) else (figure, figure)
        mean = statistics.fmean(values)
        beyond = max(low - mean, mean - high, 0.0)
        worst = max(worst, beyond / abs(low if mean < low else high))
    return worst
