"""One verdict a pair of entries, defined once: by success; where that is open, by time or error of common successes.

Success comes first, as a paired difference over the scenarios that both met. Where that is not significant, the time or
the error decides, in the scenarios that both solve; not so where the interval of the successes speaks for the other
side. A p is corrected by Holm's method for every comparison
that is shown together, and every table, sentence and figure takes the verdict from here. Scenes that stand still and
scenes that move are compared apart, so that a difference in some is claimed of those alone.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from wayfield.benchmarks.contests import ALL_CONTESTS, DISTURBANCES, PACE_TOLERANCE, TRAINED, Contest
from wayfield.benchmarks.leaderboards.entries import COMPARED, Entry, by_entry, label, leader, mean_speed, shown_speed
from wayfield.benchmarks.leaderboards.matrix import Runs, cost_difference, how_often_better, success_difference
from wayfield.benchmarks.records.episode import Episodes, Row, text
from wayfield.benchmarks.records.table import Table, code_span
from wayfield.benchmarks.statistics.crossed import LEAST
from wayfield.benchmarks.statistics.paired import SIGNIFICANT, Difference, holm

WINS, LOSES, ALIKE, SLOWER, FEW = "wins", "loses", "alike", "not at one speed", "too few scenarios"


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two entries in the same scenarios."""

    contest: Contest
    condition: str
    scenes: str  # which of a contest's scenes; "" for all
    first: Entry
    other: Entry
    knows: tuple[str, str]  # what each has access to
    scenarios: int
    success: Difference  # of the first less the other
    cost: Difference  # likewise, where both succeed
    often: float  # share of the scenarios in which the first does better, draws counted half
    speeds: tuple[float, float]  # m/s


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What is said of a pair: of its first entry beside the other."""

    outcome: str  # WINS, LOSES, ALIKE, SLOWER or FEW
    on_success: bool  # whether successes decide
    words: str
    p_success: float  # corrected; NaN of too few scenarios
    p_cost: float

    @property
    def reversed_words(self) -> str:
        """Returns what is said of the other entry beside the first."""
        return _turned(self.words)


_OPPOSITES = (
    ("more successes", "fewer successes"),
    ("more successes (not significant)", "fewer successes (not significant)"),
    ("quicker", "slower"),
    ("errs less at a lower speed", "errs more at a higher speed"),
    ("errs less", "errs more"),
)


def _turned(words: str) -> str:
    for one, other in _OPPOSITES:
        if words.endswith(one):
            return words.removesuffix(one) + other
        if words.endswith(other):
            return words.removesuffix(other) + one
    return words


OPEN = "no significant difference in success"


def judged(lines: Sequence[Row]) -> list[Verdict]:
    """Returns the verdict of each line of tables of pairs, corrected for all of these lines together."""
    ps = holm([float(line[name] or math.nan) for line in lines for name in (P_SUCCESS, P_COST)])
    return [_verdict(line, *two) for line, *two in zip(lines, ps[::2], ps[1::2], strict=True)]


def _verdict(line: Row, p_success: float, p_cost: float) -> Verdict:
    on_time = line[UNIT] == "s"
    if math.isnan(p_success):
        return Verdict(FEW, False, FEW, p_success, p_cost)
    ahead = float(line[SUCCESS]) > 0.0
    words = "more successes" if ahead else "fewer successes"
    if p_success < SIGNIFICANT:
        return Verdict(WINS if ahead else LOSES, True, words, p_success, p_cost)
    decided = not math.isnan(p_cost) and p_cost < SIGNIFICANT
    less = decided and float(line[COST]) < 0.0
    if float(line[P_SUCCESS]) < SIGNIFICANT and not (decided and less == ahead):
        # significant before correction: not so alike that a cost may decide which does not say the same
        return Verdict(ALIKE, False, f"{words} (not significant)", p_success, p_cost)
    if not decided:
        words = f"{OPEN} or {'time' if on_time else 'error'}"
        return Verdict(ALIKE, False, words, p_success, p_cost)
    if on_time:
        words = "quicker" if less else "slower"
    else:
        words = "errs less" if less else "errs more"
        speeds = [float(each) if each not in ("", "-") else math.nan for each in (line[SPEED], line[OTHER_SPEED])]
        best, worst = speeds if less else speeds[::-1]
        if line[PACED] and best < (1.0 - PACE_TOLERANCE) * worst:
            words += " at a lower speed" if less else " at a higher speed"
            return Verdict(SLOWER, False, f"{OPEN}; {words}", p_success, p_cost)
    return Verdict(WINS if less else LOSES, False, f"{OPEN}; {words}", p_success, p_cost)


def pairs(rows: Episodes) -> Iterator[Pair]:
    """Yields pairs of a run: trained agents beside every other, and the first entry without access to the map."""
    for name, of_contest in rows.groups("contest").items():
        contest = ALL_CONTESTS[name]
        for robot, mine in of_contest.groups("robot").items():
            for condition, here in conditions(contest, robot, mine).items():
                for scenes, there in by_scenes(contest, here).items():
                    yield from _pairs(contest.of_rows(there), condition, scenes, by_entry(there))


def by_scenes(contest: Contest, rows: Episodes) -> dict[str, Episodes]:
    """Returns the rows of each kind of a contest's scenes, by its name; all as "" where it does not tell kinds."""
    known = {family for families in contest.scenes.values() for family in families}
    if not set(rows.unique("family")) <= known:
        return {"": rows}
    found = {scenes: rows.where(family=families) for scenes, families in contest.scenes.items()}
    return {scenes: mine for scenes, mine in found.items() if mine}


def _pairs(contest: Contest, condition: str, scenes: str, entries: Mapping[Entry, Episodes]) -> Iterator[Pair]:
    some = next(iter(entries.values()))[0]
    ranks = some["split"] in COMPARED and some["suite"] != DISTURBANCES
    runs = {entry: Runs.of(rows, contest) for entry, rows in entries.items()}
    speeds = {entry: mean_speed(rows) for entry, rows in entries.items()}
    asked = {entry for entry in entries if entry[0] in TRAINED} | ({leader(contest, entries)} if ranks else set())
    # agents first, so that what is said is said of them
    ordered = sorted(entries, key=lambda entry: (entry[0] not in TRAINED, entry not in asked))
    for a, b in itertools.combinations(ordered, 2):
        if a not in asked:
            continue
        yield Pair(
            contest,
            condition,
            scenes,
            a,
            b,
            (entries[a][0]["knows"], entries[b][0]["knows"]),
            len(runs[a].won),
            success_difference(runs[a], runs[b]),
            cost_difference(runs[a], runs[b], contest),
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
    words = [contest.title, robot]
    if row["split"] == "claims":
        words.append("on the split claims")
    if row["split"] == "front":
        words.append(f"asked for {text(row['speed'])} m/s")
    if row["disturbance"] != "none":
        words.append(f"{row['disturbance']} disturbance")
    elif row["suite"] not in ALL_CONTESTS:
        words.append("undisturbed, fewer scenarios")
    return ", ".join(words)


CONDITION, SCENES, FIRST, OTHER = "condition", "scenes", "policy", "beside"
ACCESS, OTHER_ACCESS = "has access to", "which has"
SUCCESS, P_SUCCESS = "success (points)", "p of success"
OF, COST, UNIT, P_COST = "compared by", "cost where both succeed", "unit", "p of cost"
OFTEN, PACED, SPEED, OTHER_SPEED = "better in (%)", "asked (m/s)", "speed (m/s)", "its speed (m/s)"
HEADER = [
    *(CONDITION, SCENES, FIRST, OTHER, ACCESS, OTHER_ACCESS, "scenarios"),
    *(
        SUCCESS,
        "from",
        "to",
        P_SUCCESS,
        OF,
        COST,
        "cost from",
        "cost to",
        UNIT,
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
        cost = _numbers(each.cost, 1e3 if in_mm else 1.0, 3)
        lines.append(
            [
                *(each.condition, each.scenes, label(each.first), label(each.other), *each.knows, str(each.scenarios)),
                *(*success, each.contest.cost.name, *cost[:3], "mm" if in_mm else each.contest.cost.unit, cost[3]),
                f"{100.0 * each.often:.1f}",
                "" if each.contest.pace is None else f"{each.contest.pace:g}",
                *(shown_speed(speed, 4) for speed in each.speeds),
            ]
        )
    note = (
        "The first policy less the other, over the scenarios that both met, all training seeds counted: successes in "
        "points, then errors or times (mean of the differences) of the scenarios that both solve, "
        f"in families with {LEAST} such scenarios or more. From and to: 95 % intervals of paired t-tests; agents and "
        f"scenarios are both a sample. p: before any correction. Made by {code_span(command)}."
    )
    return Table("Every pair", HEADER, lines, note)


def _numbers(found: Difference, factor: float, decimals: int) -> list[str]:
    values = [factor * each for each in (found.value, found.low, found.high)]
    shown = ["" if math.isnan(each) else f"{each:+.{decimals}f}" for each in values]
    return [*shown, "" if math.isnan(found.p) else f"{found.p:.3g}"]


def claims_table(found: Table, command: str) -> Table:
    """Returns what trained agents win, lose and leave open, of a table of pairs, corrected for all of its lines."""
    rows = [dict(zip(found.header, line, strict=True)) for line in found.rows]
    lines = [
        [row[CONDITION], row[SCENES], row[FIRST], row[OTHER], row[OTHER_ACCESS], *shown(row, each)]
        for row, each in zip(rows, judged(rows), strict=True)
        if row[FIRST].partition(" ")[0] in TRAINED
    ]
    note = (
        "The verdict is on success; where that is not significant, on the time or the error of the scenarios that both "
        "solve, unless the interval of the successes speaks for the other side. Brackets: 95 % intervals. p: corrected "
        "by Holm's method for the "
        f"{2 * len(rows)} comparisons of all pairs of this run, decided under {SIGNIFICANT:g}. Who errs less at a "
        f"lower speed, by over {100.0 * PACE_TOLERANCE:.0f} %, has not won. Made by {code_span(command)}."
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
