"""One verdict a pair of entries, defined once: by success; where that does not decide, by time or error.

Every difference has one of three outcomes (`outcome`): better or worse, once its p is corrected by Holm's method for
all comparisons that are shown together; equivalent, where its 95 % interval lies within a margin that was fixed
beforehand, and the exact limit of a share too; or a tie. Success comes first, as a paired difference over the scenarios
that both met. Where it is equivalent or a tie, the time or the error decides, in the scenarios that both solve; not so
where the interval of the successes speaks for the other side. Two entries are equivalent that are so in both; who fails
significantly more often never is, whatever a correction does to its p. Every table, sentence, star and list takes the
verdict from here. Scenes that stand still and scenes that move are compared apart, so that a difference in some is
claimed of those alone.
"""

import dataclasses
import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from wayfield.benchmarks.contests import ALL_CONTESTS, PACE_TOLERANCE, TRAINED, Contest
from wayfield.benchmarks.leaderboards.disclosure import inputs
from wayfield.benchmarks.leaderboards.entries import (
    COMPARED,
    MAP,
    Entry,
    by_entry,
    class_words,
    label,
    leader,
    mean_speed,
    off_pace,
    shown_speed,
)
from wayfield.benchmarks.leaderboards.matrix import Runs, cost_difference, how_often_better, success_difference
from wayfield.benchmarks.records.episode import Episodes, Row, text
from wayfield.benchmarks.records.table import Table, code_span
from wayfield.benchmarks.statistics.crossed import LEAST
from wayfield.benchmarks.statistics.paired import SIGNIFICANT, Difference, holm

BETTER, WORSE, EQUIVALENT, OPEN = "better", "worse", "equivalent", "tie"
SLOWER, FEW = "at different speeds", "too few scenarios"
MARGIN = 0.01  # of success
COST_MARGIN = 0.05  # of the lesser time or error of the two
MARGINS = f"{100.0 * MARGIN:g} point of success and {100.0 * COST_MARGIN:g} % of time or error"


def outcome(low: float, high: float, corrected: float, margin: float, limit: float = 0.0, trifles: bool = False) -> str:
    """Returns what a difference says of the first of two, more being better: BETTER, WORSE, EQUIVALENT or OPEN.

    Args:
        low, high: of its 95 % interval; NaN where nothing is said.
        corrected: its p, after Holm's correction.
        margin: within which the two are equivalent.
        limit: exact one of a share to either side, `Difference.limit`: must lie within the margin too.
        trifles: whether a difference within the margin is none even where the interval leaves out zero: so of time and
            error, not of successes.
    """
    within = low >= -margin and max(high, limit) <= margin
    differs = low > 0.0 or high < 0.0
    if within and (trifles or not differs):
        return EQUIVALENT
    if differs and corrected < SIGNIFICANT:
        return BETTER if low > 0.0 else WORSE
    return OPEN


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two entries in the same scenarios."""

    contest: Contest
    condition: str
    scenes: str  # which of a contest's scenes; "" for all
    first: Entry
    other: Entry
    inputs: tuple[str, str]  # of each, in words
    scenarios: int
    success: Difference  # of the first less the other
    cost: Difference  # likewise, where both succeed
    level: float  # the lesser cost of the two there
    often: float  # share of the scenarios in which the first does better, draws counted half
    speeds: tuple[float, float]  # m/s


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What is said of a pair: of its first entry beside the other."""

    outcome: str  # BETTER, WORSE, EQUIVALENT, OPEN, SLOWER or FEW
    on_success: bool  # whether successes decide
    words: str
    p_success: float  # corrected; NaN of too few scenarios
    p_cost: float

    @property
    def turned(self) -> "Verdict":
        """Returns what is said of the other entry beside the first."""
        outcome = {BETTER: WORSE, WORSE: BETTER}.get(self.outcome, self.outcome)
        return dataclasses.replace(self, outcome=outcome, words=_turned(self.words))


_OPPOSITES = (
    ("more successes", "fewer successes"),
    ("faster", "slower"),
    ("lower error at a lower speed", "higher error at a higher speed"),
    ("lower error", "higher error"),
)


UNSURE = " (not significant)"  # of what the interval says, and the corrected p does not


def _turned(words: str) -> str:
    said = words.removesuffix(UNSURE)
    end = words.removeprefix(said)
    for one, other in _OPPOSITES:
        if said.endswith(one):
            return said.removesuffix(one) + other + end
        if said.endswith(other):
            return said.removesuffix(other) + one + end
    return words


def judged(lines: Sequence[Row]) -> list[Verdict]:
    """Returns the verdict of each line of tables of pairs, corrected for all of these lines together."""
    ps = holm([float(line[name] or math.nan) for line in lines for name in (P_SUCCESS, P_COST)])
    return [_verdict(line, *two) for line, *two in zip(lines, ps[::2], ps[1::2], strict=True)]


def _verdict(line: Row, p_success: float, p_cost: float) -> Verdict:
    cost_name = "time" if line[UNIT] == "s" else "error"
    if math.isnan(p_success):
        return Verdict(FEW, False, FEW, p_success, p_cost)
    low, high = _ends(line, "from", "to")
    success = outcome(low, high, p_success, 100.0 * MARGIN, float(line[LIMIT]))
    words = "more successes" if float(line[SUCCESS]) > 0.0 else "fewer successes"
    if success in (BETTER, WORSE):
        return Verdict(success, True, words, p_success, p_cost)
    least, most = _ends(line, "cost from", "cost to")
    cost = outcome(-most, -least, p_cost, float(line[LEVEL] or 0.0) * COST_MARGIN, trifles=True)
    unsure = cost == OPEN and (least > 0.0 or most < 0.0)
    dearer = cost == WORSE or (unsure and least > 0.0)
    speeds = [float(each) if each not in ("", "-") else math.nan for each in (line[SPEED], line[OTHER_SPEED])]
    best, worst = speeds[::-1] if dearer else speeds
    apart = bool(line[PACED]) and min(speeds) < (1.0 - PACE_TOLERANCE) * max(speeds)
    if cost == EQUIVALENT and apart:
        cost = OPEN  # an error at a lower speed is another one
    if (low > 0.0 or high < 0.0) and cost != (BETTER if low > 0.0 else WORSE):
        # significant before correction: not so alike that a cost may decide which does not say the same
        return Verdict(OPEN, False, f"{words}{UNSURE}", p_success, p_cost)
    if cost == success and not unsure:  # both equivalent, or both a tie
        return Verdict(cost, False, cost, p_success, p_cost)
    before = f"{success} in success; "
    if cost in (EQUIVALENT, OPEN) and not unsure:
        return Verdict(OPEN, False, f"{before}{cost} in {cost_name}", p_success, p_cost)
    words = {"time": ("faster", "slower"), "error": ("lower error", "higher error")}[cost_name][dearer]
    if apart and best < worst:
        words += " at a higher speed" if dearer else " at a lower speed"
        cost = cost if unsure else SLOWER
    return Verdict(cost, False, f"{before}{words}{UNSURE * unsure}", p_success, p_cost)


def _ends(line: Row, low: str, high: str) -> tuple[float, float]:
    return float(line[low] or "nan"), float(line[high] or "nan")


def pairs(rows: Episodes) -> Iterator[Pair]:
    """Yields pairs of a run: beside every other trained agents and the first entries without the map and with it.

    Where a speed is requested, also the first of those that hold it in the mean over all scenes. Of several levels of
    disturbance, agents alone.
    """
    for name, of_contest in rows.groups("contest").items():
        contest = ALL_CONTESTS[name]
        for robot, mine in of_contest.groups("robot").items():
            ladder = len(mine.unique("disturbance")) > 1
            for condition, here in conditions(contest, robot, mine).items():
                ranks = here[0]["split"] in COMPARED and not ladder
                held = {entry for entry, each in by_entry(here).items() if not off_pace(each, contest.pace)}
                for scenes, there in by_scenes(contest, here).items():
                    yield from _pairs(contest.of_rows(there), condition, scenes, by_entry(there), held, ranks)


def by_scenes(contest: Contest, rows: Episodes) -> dict[str, Episodes]:
    """Returns the rows of each kind of a contest's scenes, by its name; all as "" where it does not tell kinds."""
    known = {family for families in contest.scenes.values() for family in families}
    if not set(rows.unique("family")) <= known:
        return {"": rows}
    parts = {scenes: rows.where(family=families) for scenes, families in contest.scenes.items()}
    return {scenes: mine for scenes, mine in parts.items() if mine}


def _pairs(
    contest: Contest,
    condition: str,
    scenes: str,
    entries: Mapping[Entry, Episodes],
    held: Collection[Entry],
    ranks: bool,
) -> Iterator[Pair]:
    observes = contest.spec.observes
    runs = {entry: Runs.of(rows, contest) for entry, rows in entries.items()}
    speeds = {entry: mean_speed(rows) for entry, rows in entries.items()}
    compared = {entry for entry in entries if entry[0] in TRAINED}
    if ranks:
        with_map = {entry: rows for entry, rows in entries.items() if MAP in rows[0]["knows"]}
        at_pace = {entry: rows for entry, rows in entries.items() if entry in held}
        compared |= {leader(contest, each) for each in (entries, with_map, at_pace) if each}
    # agents first, so that what is said is said of them
    ordered = sorted(entries, key=lambda entry: (entry[0] not in TRAINED, entry not in compared))
    for a, b in itertools.combinations(ordered, 2):
        if a not in compared:
            continue
        yield Pair(
            contest,
            condition,
            scenes,
            a,
            b,
            (inputs(entries[a][0]["knows"], observes), inputs(entries[b][0]["knows"], observes)),
            len(runs[a].won),
            success_difference(runs[a], runs[b]),
            *cost_difference(runs[a], runs[b]),
            0.5 + how_often_better(runs[a], runs[b]).value,
            (speeds[a], speeds[b]),
        )


def conditions(contest: Contest, robot: str, rows: Episodes) -> dict[str, Episodes]:
    """Returns the rows of each condition in which entries met the same scenarios, by its name."""
    rows = rows.where(split=(*COMPARED, "front"))
    telling = [name for name in ("split", "speed", "disturbance", "suite") if name in rows.names]
    number = rows.numbered(*telling)
    firsts = rows[np.unique(number, return_index=True)[1]]
    names = [_condition(contest, robot, row) for row in firsts]
    different = list(dict.fromkeys(names))
    place = np.array([different.index(name) for name in names], np.int64)
    return dict(zip(different, rows.split(place[number]), strict=True))


def _condition(contest: Contest, robot: str, row: Row) -> str:
    words = [contest.title, robot + class_words(row["split"])]
    if row["split"].partition("@")[0] == "claims":
        words.append("on the split claims")
    if row["split"] == "front":
        words.append(f"asked for {text(row['speed'])} m/s")
    if row["disturbance"] != "none":
        words.append(f"{row['disturbance']} disturbance")
    elif row["suite"] not in ALL_CONTESTS:
        words.append("undisturbed, fewer scenarios")
    return ", ".join(words)


CONDITION, SCENES, FIRST, OTHER = "condition", "scenes", "policy", "beside"
ACCESS, OTHER_ACCESS = "inputs", "inputs of the other"
SUCCESS, P_SUCCESS = "success (points)", "p of success"
LIMIT = "exact limit (points)"
OF, COST, UNIT, P_COST = "compared by", "cost where both succeed", "unit", "p of cost"
LEVEL = "lesser cost"
OFTEN, PACED, SPEED, OTHER_SPEED = "better in (%)", "asked (m/s)", "speed (m/s)", "its speed (m/s)"
HEADER = [
    *(CONDITION, SCENES, FIRST, OTHER, ACCESS, OTHER_ACCESS, "scenarios"),
    *(
        SUCCESS,
        "from",
        "to",
        P_SUCCESS,
        LIMIT,
        OF,
        COST,
        "cost from",
        "cost to",
        UNIT,
        LEVEL,
        P_COST,
        OFTEN,
        PACED,
        SPEED,
        OTHER_SPEED,
    ),
]


def pairs_table(rows: Episodes, command: str) -> Table:
    """Returns every pair of a run as numbers, from which `judged` makes verdicts; p before any correction."""
    lines = []
    for each in pairs(rows):
        in_mm = each.contest.cost.unit == "m"
        success = _numbers(each.success, 100.0, 2)
        limit = f"{100.0 * each.success.limit:.3f}" if success[3] else ""
        cost = _numbers(each.cost, 1e3 if in_mm else 1.0, 3)
        lines.append(
            [
                *(each.condition, each.scenes, label(each.first), label(each.other), *each.inputs, str(each.scenarios)),
                *(*success, limit, each.contest.cost.name, *cost[:3], "mm" if in_mm else each.contest.cost.unit),
                "" if math.isnan(each.level) else f"{(1e3 if in_mm else 1.0) * each.level:.3f}",
                cost[3],
                f"{100.0 * each.often:.1f}",
                "" if each.contest.pace is None else f"{each.contest.pace:g}",
                *(shown_speed(speed, 4) for speed in each.speeds),
            ]
        )
    note = (
        "The first policy less the other, over the scenarios that both met, all training seeds counted: successes in "
        "points, then errors or times (mean of the differences) of the scenarios that both solve, "
        f"in families with {LEAST} such scenarios or more. From and to: 95 % intervals of paired t-tests; agents and "
        f"scenarios are both a sample. Exact limit: how far apart the successes may be, by the scenarios that one "
        "alone solves; beyond the margin the two are not equivalent. Lesser cost: of the two there. p: before "
        f"any correction. Made by {code_span(command)}."
    )
    return Table("Every pair", HEADER, lines, note)


def _numbers(difference: Difference, factor: float, decimals: int) -> list[str]:
    values = [factor * each for each in (difference.value, difference.low, difference.high)]
    shown = ["" if math.isnan(each) else f"{each:+.{decimals}f}" for each in values]
    return [*shown, "" if math.isnan(difference.p) else f"{difference.p:.3g}"]


def claims_table(pairs: Table, command: str) -> Table:
    """Returns what trained agents win, lose and tie, of a table of pairs, corrected for all of its lines."""
    rows = [dict(zip(pairs.header, line, strict=True)) for line in pairs.rows]
    lines = [
        [row[CONDITION], row[SCENES], row[FIRST], row[OTHER], row[OTHER_ACCESS], *shown(row, each)]
        for row, each in zip(rows, judged(rows), strict=True)
        if row[FIRST].partition(" ")[0] in TRAINED
    ]
    note = (
        "The verdict is on success; where that is equivalent or a tie, on the time or the error of the scenarios that "
        f"both solve, unless the interval of the successes speaks for the other side. Equivalent: within {MARGINS}, "
        "and the exact limit of the successes too. Brackets: 95 % intervals. p: corrected by Holm's method for the "
        f"{2 * len(rows)} comparisons of all pairs of this run, decided under {SIGNIFICANT:g}. A lower error at a "
        f"lower speed, by over {100.0 * PACE_TOLERANCE:.0f} %, is no win. Made by {code_span(command)}."
    )
    header = [CONDITION, SCENES, FIRST, OTHER, OTHER_ACCESS, *SHOWN]
    return Table("What trained agents win, and what they do not", header, lines, note)


SHOWN = ("verdict", SUCCESS, "p", COST, "p of it", OFTEN)


def shown(row: Row, verdict: Verdict) -> list[str]:
    """Returns the cells of a line of pairs as a reader sees them, the verdict first."""
    success = _with_ends(row[SUCCESS], row["from"], row["to"], 1)
    cost = _with_ends(row[COST], row["cost from"], row["cost to"], 2)
    cells = [success, shown_p(verdict.p_success), f"{cost} {row[UNIT]}" if cost else "", shown_p(verdict.p_cost)]
    return [verdict.words, *cells, row[OFTEN]]


def _with_ends(value: str, low: str, high: str, decimals: int) -> str:
    if not value:
        return ""
    one = f"{float(value):+.{decimals}f}"
    return f"{one} [{float(low):+.{decimals}f}, {float(high):+.{decimals}f}]" if low else one


def shown_p(p: float) -> str:
    """Returns a p as it is shown."""
    return "" if math.isnan(p) else "< 0.001" if p < 1e-3 else f"{p:.3f}"
