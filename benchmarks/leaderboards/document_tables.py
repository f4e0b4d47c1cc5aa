"""The tables of the documents, from the rows of the results alone: our figures beside what there is to compare with.

Two kinds of figures are kept apart, each with its plant: means that a document prints, and reference solutions of its
equations, which no document prints.
"""

import dataclasses
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.contests import OF_KIND
from wayfield.benchmarks.contests.contest import DEGREES
from wayfield.benchmarks.entrants.documents import TITLES
from wayfield.benchmarks.leaderboards.disclosure import inputs
from wayfield.benchmarks.records.cases import Case, Figure
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.statistics.crossed import exact_interval
from wayfield.policies import make

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
        "the document's real runs, which were disturbed too, stopped short of the goal. Its mean x error of "
        "scenario 2, 0.058 m, is 0.020 m when a misprint among its lines is mended."
    ),
}


@dataclasses.dataclass(frozen=True)
class Compared:
    """A figure of ours beside one of a source."""

    case: Case
    dynamics: str
    metric: str
    figure: Figure
    printed: bool  # by the document; else it is a reference solution of its equations
    ours: float  # the mean of the episodes; NaN where none has it
    off: float  # relative; inf where it never came

    @property
    def met(self) -> bool:
        """Returns whether it is met within `CLOSE`."""
        return self.off <= CLOSE


def document_tables(rows: Episodes, cases: Iterable[Case]) -> list[Table]:
    """Returns a table for each document that the rows hold, and where there is one, what was compared and not met."""
    known = {case.key: case for case in cases}
    tables = [_table(document, mine, known) for document, mine in rows.groups("contest").items()]
    shown = [each for each in compared(rows, known.values()) if each.printed or not each.met]
    return [*tables, _agreement_table(shown)] if shown else tables


def compared(rows: Episodes, cases: Iterable[Case]) -> list[Compared]:
    """Returns every figure of ours that a document prints, or that its equations have a reference solution for."""
    known = {case.key: case for case in cases}
    pairs = []
    for (document, experiment, policy, gains, dynamics, _), group in _groups(rows, "contest").items():
        case = known.get((document, experiment, policy, gains))
        if case is None:
            continue
        for printed, figures in ((True, case.published), (False, case.reference)):
            for metric, figure in figures.items():
                values = _known(group, metric)
                ours = statistics.fmean(values) if len(values) else math.nan
                pairs.append(
                    Compared(case, dynamics, metric, figure, printed, ours, deviation(group, {metric: figure}))
                )
    return pairs


def reproduced(rows: Episodes, cases: Iterable[Case]) -> tuple[str, Table]:
    """Returns how well the documents are met, as a sentence and as a small table, a document on a plant a line."""
    known = list(cases)
    pairs = compared(rows, known)
    lines = []
    for document in dict.fromkeys(each.case.contest for each in pairs):
        prints = any(case.published for case in known if case.contest == document)
        of_document = [each for each in pairs if each.case.contest == document]
        for plant in dict.fromkeys(each.dynamics for each in of_document):
            here = [each for each in of_document if each.dynamics == plant]
            of_equations = [each for each in here if not each.printed]
            median = f"{100.0 * statistics.median(each.off for each in of_equations):.1f} %" if of_equations else ""
            of_print = _share_met([each for each in here if each.printed]) if prints else "prints none"
            lines.append([document, plant, _share_met(of_equations), median, of_print])
    names = "; ".join(f"{key} = {TITLES[key].partition(': ')[2]}" for key in rows.unique("contest") if key in TITLES)
    sentence = f"Reference papers: {names}{f'. {agreement(pairs)}' if pairs else f'; {len(rows)} runs.'}"
    header = ["paper", "plant", "reference met", "median off", "printed met"]
    return sentence, Table("The three reference papers", header, lines, "")


def agreement(pairs: Sequence[Compared]) -> str:
    """Returns on which plant how many reference solutions and how many printed means are met, in words."""
    sentences = []
    for plant in dict.fromkeys(each.dynamics for each in pairs):
        here = [each for each in pairs if each.dynamics == plant]
        equations, means = ([each for each in here if each.printed is kind] for kind in (False, True))
        words = f"{_share_met(equations)} reference solutions of their equations"
        printed = f" and {_share_met(means)} average values printed in C" if means else ""
        sentences.append(f"{plant}, {words}{printed}")
    met = f"{'; '.join(sentences)} are met within {100.0 * CLOSE:.0f} %."
    return f"{met[0].upper()}{met[1:]} A and B print no values."


def _share_met(pairs: Sequence[Compared]) -> str:
    return f"{sum(each.met for each in pairs)} of {len(pairs)}" if pairs else ""


def _agreement_table(pairs: Sequence[Compared]) -> Table:
    """Returns every printed mean beside ours, and the reference solutions that are not met."""
    lines = []
    for each in pairs:
        case = each.case
        column = next(column for column in _COLUMNS[case.contest] if each.metric in column.metrics)
        unit = column.header.partition("(")[2].rstrip(")")
        name = f"{each.metric.replace('_', ' ')} ({unit})"
        ours = "never" if math.isnan(each.ours) else _fixed(column.factor * each.ours, column.decimals + 1)
        kind = f"printed, {case.source}" if each.printed else "reference"
        off = _off(each.off)
        place = f"{case.contest}, {case.family}, {each.dynamics}"
        theirs = _published(column, each.figure)
        lines.append([kind, place, f"{case.policy} {case.gains_text}".strip(), name, theirs, ours, off])
    note = (
        "Every mean that a document prints, and every reference solution that is off by more than "
        f"{100.0 * CLOSE:.0f} %. Reference solutions are closed forms or integrations of the documents' equations by "
        "other code; no document prints them."
    )
    header = ["of", "experiment and plant", "policy", "what", "theirs", "ours", "off by"]
    return Table("Printed means, and reference solutions that are not met", header, lines, note)


def ranked(rows: Episodes) -> tuple[str, Table]:
    """Returns the ranking in a scenario of the user's own, as a sentence and as a small table.

    A run that succeeds comes before one that fails; then what the task compares successes by counts.
    """
    compared = OF_KIND[rows[0]["contest"]].spec.cost
    metric, name, decimals = compared.metric, f"{compared.name} ({compared.unit})", max(compared.decimals, 2)

    def cost(row: Row) -> float:
        return math.inf if math.isnan(row[metric]) else float(row[metric])

    order = sorted(rows, key=lambda row: (row["success"] != 1.0, cost(row)))
    observes = OF_KIND[rows[0]["contest"]].spec.observes
    count, plants = len({(row["policy"], row["gains"]) for row in rows}), len(rows.unique("dynamics"))
    runs = len(rows) // plants // count
    lines = [
        [
            row["policy"] + (f", seed {row['seed']}" if runs > 1 else ""),
            row["dynamics"],
            _ending(row),
            f"{cost(row):.{decimals}f}",
            f"{row['mean_speed']:.2f}",
            inputs(make(row["policy"]).knows, observes),
        ]
        for row in order
    ]
    first = order[0]
    won = f"{first['policy']} does best: {name.split(' (')[0]} {cost(first):.{decimals}f} {name.split('(')[1][:-1]}"
    if first["success"] != 1.0:
        won = "No policy succeeds"
    policies = f"{count} {'policy' if count == 1 else 'policies'}"
    met = f"{rows[0]['family']}: {policies}, one scenario, {rows[0]['actuators']} actuators."
    each = "one run each, so without an interval" if runs == 1 else f"{runs} runs each, the best run counts"
    sentence = f"{met} {won}; {each}."
    header = ["policy", "plant", "outcome", name, "speed (m/s)", "inputs"]
    return sentence, Table(str(rows[0]["family"]), header, lines, "")


CLOSE = 0.05  # relative deviation of a figure that counts as met


def _groups(rows: Episodes, *above: str) -> dict[tuple[str, ...], Episodes]:
    """Returns the episodes of each line of a document's table."""
    return rows.groups(*above, "family", "policy", "gains", "dynamics", "actuators")


def _shown(document: str) -> tuple[tuple[Column, ...], str]:
    """Returns the columns of a document's table, or of that of a scenario of the user's own, and its note."""
    if document in _COLUMNS:
        return _COLUMNS[document], _NOTES[document]
    contest = OF_KIND[document]
    columns = (Column(each.header, (each.metric,), each.decimals, each.factor) for each in contest.own_columns)
    return tuple(columns), contest.own_note


def _table(document: str, rows: Episodes, cases: Mapping[tuple[str, str, str, str], Case]) -> Table:
    columns, note = _shown(document)
    groups = _groups(rows)
    tiers = rows.unique("actuators")
    lines = []
    for (experiment, policy, gains, dynamics, actuators), group in groups.items():
        case = cases.get((document, experiment, policy, gains))
        known = (case.published or case.reference) if case else {}
        source = (case.source or "reference") if case and known else ""
        plant = dynamics if tiers == ["ideal"] else f"{dynamics}, {actuators}"
        name = f"{policy} {gains}".strip()
        cells = [_cell(column, group, known) for column in columns]
        lines.append([experiment, name, plant, _outcome(group), *cells, source, _deviation(group, known)])
    header = ["experiment", "policy", "plant", "outcome", *(column.header for column in columns), "beside", "off by"]
    # a column that no row of this run fills only takes room, as the name of a single scenario does, which is the title
    first = 1 if document not in TITLES and len(rows.unique("family")) == 1 else 0
    filled = [i for i in range(first, len(header)) if i < 4 or any(line[i] for line in lines)]
    if any(line[-2] for line in lines):
        note = (
            "Cells read ours / theirs. Theirs is a reference solution of the document's equations, which it does not "
            "print, or a mean that it prints in the table named; off by is the largest deviation. " + note
        )
    return Table(
        TITLES.get(document, f"{document.title()}: {rows[0]['family']}"),
        [header[i] for i in filled],
        [[line[i] for i in filled] for line in lines],
        note,
    )


def _cell(column: Column, group: Episodes, published: Mapping[str, Figure]) -> str:
    """Returns the mean of each metric, with the standard deviation of several episodes, and the figures beside it."""
    ours = [_measured(column, metric, group) for metric in column.metrics]
    theirs = [_published(column, published[metric]) for metric in column.metrics if metric in published]
    text = ", ".join(each for each in ours if each)
    if not theirs:
        return text
    return f"{text or 'never'} / {', '.join(theirs)}"


def _measured(column: Column, metric: str, group: Episodes) -> str:
    values = (column.factor * _known(group, metric)).tolist()
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


def _outcome(group: Episodes) -> str:
    """Returns how a single episode ended, or the share of successes of several with its 95 % interval."""
    if len(group) == 1:
        return _ending(group[0])
    successes = int((group["success"] == 1.0).sum())
    low, high = exact_interval(successes / len(group), len(group))
    return f"{successes}/{len(group)} [{low:.2f}, {high:.2f}]"


def _ending(row: Row) -> str:
    """Returns how an episode ended, in words."""
    return next(name for name in _OUTCOMES if row[name] == 1.0).replace("_", " ")


def _known(group: Episodes, metric: str) -> NDArray[np.float64]:
    """Returns a metric of the episodes that have it."""
    values = group.numbers(metric)
    return values[~np.isnan(values)]


def _deviation(group: Episodes, figures: Mapping[str, Figure]) -> str:
    """Returns the largest relative deviation of the means from figures of a source, in words."""
    return _off(deviation(group, figures)) if figures else ""


def _off(worst: float) -> str:
    if math.isinf(worst):
        return "never"
    return f"{100.0 * worst:.1f} %" if worst < 1.0 else "> 100 %"


def deviation(group: Episodes, figures: Mapping[str, Figure]) -> float:
    """Returns the largest relative deviation of the means from figures of a source; inf where one never came."""
    worst = 0.0
    for metric, figure in figures.items():
        values = _known(group, metric)
        if not len(values):
            return math.inf
        low, high = figure if isinstance(figure, tuple) else (figure, figure)
        mean = statistics.fmean(values)
        beyond = max(low - mean, mean - high, 0.0)
        worst = max(worst, beyond / abs(low if mean < low else high))
    return worst
