"""The rows of a contest as entries, a policy with a set of gains each, and numbers by scenario and agent."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.contests import COST, OWN_SPLIT, PACE_TOLERANCE, PUBLIC_SPLIT, Column, Contest
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.statistics.aggregates import counted_interval, cvar, interval, iqm, mean
from wayfield.benchmarks.statistics.crossed import share_interval
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.tasks.specs import LARGEST_CLASS

Entry = tuple[str, str]  # policy, and the name of its gains
Array = NDArray[np.float64]

# the splits that entries are ranked on, also those of hull classes
COMPARED = (
    *("test", "claims", OWN_SPLIT, PUBLIC_SPLIT),
    *(f"{split}@{k / 100:.2f}" for split in ("test", "claims") for k in range(5, round(100 * LARGEST_CLASS) + 1, 5)),
)
OFF_PACE = "‡"
# the share of worlds whose score is the most that it can be, and s by which a success is later than that asks for
OF_BARN, BARN_CEILING = ("barn_at_ceiling", "barn_late"), 0.5
TIMEOUT = "timeout"
ENDINGS = ("collision", "left_corridor", TIMEOUT)  # other than success; they exclude each other
MAP = "map"  # what an upper reference has access to

_NEEDED = ("contest", "family", "split", "failure_cost", "agent_seed", "knows")


def class_words(split: str) -> str:
    """Returns what a title says of the hull class of a split's name; "" of one that has none."""
    hull = split.partition("@")[2]
    return f", hull class {hull} m" if hull else ""


def greatest(values: Array) -> Array:
    """Returns the greatest value over the last axis."""
    return np.asarray(np.max(values, axis=-1))


def least(values: Array) -> Array:
    """Returns the least value over the last axis."""
    return np.asarray(np.min(values, axis=-1))


REDUCTIONS = {"iqm": iqm, "mean": mean, "max": greatest, "min": least, "cvar": cvar}


def check_columns(rows: Episodes) -> None:
    """Raises ValueError, naming the columns, unless the rows are those of a contest of this version."""
    missing = [name for name in _NEEDED if rows and name not in rows.names]
    if missing:
        raise ValueError(
            f"the episodes have no column {', '.join(missing)}: they are of an earlier version; run the contest again"
        )


def by_entry(rows: Episodes) -> dict[Entry, Episodes]:
    """Returns the rows of each entry, in the order in which entries come up."""
    return rows.groups("policy", "gains_name")


def label(entry: Entry) -> str:
    """Returns how tables and figures call an entry."""
    policy, gains_name = entry
    return policy if gains_name == "default" else f"{policy} ({gains_name})"


def seeds_driven(entries: Iterable[Episodes], contest: Contest) -> str:
    """Returns which training runs of the agents that ship drove, in words: of a short run the first alone."""
    trained = [rows.where(gains_name="trained") for rows in entries]
    driven = {int(seed) for rows in trained for seed in rows.unique("agent_seed") if seed}
    who = {(policy, robot) for rows in trained for policy in rows.unique("policy") for robot in rows.unique("robot")}
    there = {seed for policy, robot in who for seed in contest.agents_of(policy, robot)}
    return f"seeds {min(driven)} to {max(driven)} alone" if driven and driven < there else "every seed"


def levels_of(rows: Episodes) -> list[str]:
    """Returns the levels of disturbance that there are rows of, in their order."""
    there = rows.unique("disturbance")
    return [level for level in LEVELS if level in there] + [level for level in there if level not in LEVELS]


def successes(rows: Episodes) -> Episodes:
    """Returns the rows of the successes."""
    return rows.where(success=1.0)


def costs(rows: Episodes, contest: Contest) -> Array:
    """Returns the cost of each episode; that of a failure is in its row."""
    return imputed(rows, contest.spec.cost.metric)


def imputed(rows: Episodes, metric: str) -> Array:
    """Returns a metric of each episode, in place of it the cost of a failure, which is in the row, where it failed."""
    return np.where(rows["success"] == 1.0, rows.numbers(metric), rows["failure_cost"])


def scenarios(rows: Episodes) -> int:
    """Returns how many different scenarios the rows are about."""
    return int(rows.numbered("scenario", "episode").max()) + 1


def by_scenario(rows: Episodes, numbers: Array) -> tuple[Array, list[str]]:
    """Returns numbers, one an episode, as a table (s, r), a line a scenario and a column a trained agent; and strata.

    The strata are the families; scenarios from the user's files, each of which is its own family, are one stratum, and
    so are those of a public benchmark where each is its own.

    Raises:
        ValueError: if not every agent has met every scenario once.
    """
    line, agent = rows.numbered("scenario", "episode"), rows.numbered("agent_seed")
    table = np.full((line.max() + 1, agent.max() + 1), np.nan)
    if table.size != len(rows) or np.bincount(line * table.shape[1] + agent).max() > 1:
        raise ValueError(f"{rows[0]['policy']}: {table.shape[1]} agents and {len(table)} scenarios in {len(rows)} runs")
    table[line, agent] = numbers
    firsts = rows[np.unique(line, return_index=True)[1]]
    split, strata = rows[0]["split"], firsts["family"].tolist()
    if split == OWN_SPLIT or (split == PUBLIC_SPLIT and len(set(strata)) == len(strata)):
        strata = [split] * len(strata)
    return table, strata


def measured(column: Column, rows: Episodes, contest: Contest) -> Array:
    """Returns what a column shows of each episode, before it is reduced."""
    if column.metric == COST:
        return costs(rows, contest)
    if column.metric in ENDINGS:
        return ended(rows, column.metric, contest)
    if column.metric in OF_BARN:
        at_ceiling = rows["barn_score"] >= BARN_CEILING - 1e-9
        late = rows["time"] * (1.0 - rows["barn_score"] / BARN_CEILING)
        return np.asarray(at_ceiling, np.float64) if column.metric == OF_BARN[0] else np.where(at_ceiling, 0.0, late)
    return imputed(rows, column.metric) if column.imputed else rows.numbers(column.metric)


def ended(rows: Episodes, how: str, contest: Contest) -> Array:
    """Returns which episodes failed in a way; NaN of all where one does not tell, as in rows of earlier versions.

    One that failed in none of the other ways that the contest knows has run out of time.
    """
    ends = rows.numbers(how)
    if how == TIMEOUT and np.isnan(ends).all():
        others = [each.metric for each in contest.columns if each.metric in ENDINGS and each.metric != TIMEOUT]
        ends = 1.0 - rows["success"] - sum(rows.numbers(each) for each in others)
    ends = np.where(rows["success"] == 1.0, 0.0, ends)
    return np.full(len(rows), np.nan) if np.isnan(ends).any() else ends


def success_interval(rows: Episodes) -> tuple[float, float] | None:
    """Returns the 95 % interval of the share of successes, `crossed.share_interval`; None of too few scenarios."""
    return share_interval(*by_scenario(rows, rows["success"]))


def mean_interval(rows: Episodes, numbers: Array, failure: float) -> tuple[float, float] | None:
    """Returns the 95 % interval of the mean of numbers, one an episode, of which every failure counts as `failure`."""
    table, strata = by_scenario(rows, numbers)
    return counted_interval(table, by_scenario(rows, rows["success"])[0], failure, strata)


def mean_speed(rows: Episodes) -> float:
    """Returns the mean speed of the successes, m/s; NaN where there are none."""
    won = successes(rows)
    return float(won.numbers("mean_speed").mean()) if won else math.nan


def shown_speed(speed: float, decimals: int) -> str:
    """Returns a mean speed (m/s) as it is shown: "-" without a success."""
    return "-" if math.isnan(speed) else f"{speed:.{decimals}f}"


def off_pace(rows: Episodes, requested: float | None) -> bool:
    """Returns whether the mean speed is off the requested one, m/s; None: none was requested."""
    if requested is None:
        return False
    speed = mean_speed(rows)
    return not math.isnan(speed) and abs(speed - requested) > PACE_TOLERANCE * requested


def in_order(contest: Contest, entries: Mapping[Entry, Episodes]) -> list[Entry]:
    """Returns the entries as the contest ranks them.

    Where it is by the cost, that is the one of the successes, for failures have counted before: an entry's own error at
    its own speed. The speed stands beside it, and does not affect the rank.
    """

    def key(entry: Entry) -> tuple[float, ...]:
        rows = entries[entry]
        keys = [
            solved_mean(rows, contest.cost.metric) if metric == COST else sign * float(rows.numbers(metric).mean())
            for metric, sign in contest.ranked
        ]
        return tuple(math.inf if math.isnan(each) else each for each in keys)

    return sorted(entries, key=key)


def leader(contest: Contest, entries: Mapping[Entry, Episodes]) -> Entry:
    """Returns the first entry of those without access to the map, or of all where all have it."""
    order = in_order(contest, entries)
    return next((entry for entry in order if MAP not in entries[entry][0]["knows"]), order[0])


def solved_mean(rows: Episodes, metric: str) -> float:
    """Returns what a scenario costs where it is solved: the mean over the scenarios, as many of each family.

    An agent that fails where another of its set succeeds has the mean of the others there. NaN where nothing is solved.
    """
    table, _ = _solved(rows, metric)
    return float(table.mean()) if len(table) else math.nan


def solved_mean_cell(
    rows: Episodes, metric: str, contest: Contest, factor: float | None = None, decimals: int | None = None
) -> str:
    """Returns `solved_mean` with its 95 % interval over the scenarios that are solved, in mm or as costs by default."""
    table, families = _solved(rows, metric)
    if not len(table):
        return ""
    if factor is None or decimals is None:
        factor, decimals = (1e3, 2) if contest.cost.unit == "m" else (1.0, contest.cost.decimals)
    ends = interval(table, families, mean)
    return _with_ends(solved_mean(rows, metric), ends, factor, decimals)


def _solved(rows: Episodes, metric: str) -> tuple[Array, list[str]]:
    """Returns a metric of the successes as a table (s, r) of the scenarios that are solved, and their strata."""
    table, strata = by_scenario(rows, np.where(rows["success"] == 1.0, rows.numbers(metric), np.nan))
    solved = ~np.isnan(table).all(axis=1)
    table = table[solved]
    means = np.nanmean(table, axis=1, keepdims=True) if len(table) else table
    return np.where(np.isnan(table), means, table), list(itertools.compress(strata, map(bool, np.atleast_1d(solved))))


def success_cell(rows: Episodes) -> str:
    """Returns the share of successes in per cent with its 95 % interval."""
    return _with_ends(float(rows["success"].mean()), success_interval(rows), 100.0, 1)


def cell(column: Column, rows: Episodes, contest: Contest) -> str:
    """Returns a cell of the leaderboard, empty where nothing was measured."""
    if column.successes_only:
        rows = successes(rows)
    numbers = measured(column, rows, contest)
    known = numbers[~np.isnan(numbers)]
    if not len(known):
        return ""
    reduce = REDUCTIONS[column.reduction]
    ends = None
    if column.with_interval and len(known) == len(numbers):
        if column.reduction == "mean":  # of a score a failure has none
            counts = rows["failure_cost"].mean() if column.metric == COST or column.imputed else 0.0
            ends = mean_interval(rows, numbers, float(counts))
        else:
            ends = interval(*by_scenario(rows, numbers), reduce)
    return _with_ends(float(reduce(known)), ends, column.factor, column.decimals)


def _with_ends(value: float, ends: tuple[float, float] | None, factor: float, decimals: int) -> str:
    text = f"{factor * value:.{decimals}f}"
    if ends is None:
        return text
    return f"{text} [{factor * ends[0]:.{decimals}f}, {factor * ends[1]:.{decimals}f}]"


def short_cell(rows: Episodes, contest: Contest, success: str = "") -> str:
    """Returns the share of successes in per cent, or what is given in its place, and the mean cost of all runs."""
    if not rows:
        return ""
    won = float(rows["success"].mean())
    cost = contest.spec.cost
    return f"{success or f'{100.0 * won:.0f}'} | {float(costs(rows, contest).mean()):.{cost.decimals}f}"


def reading(contest: Contest) -> str:
    """Returns how a cell of `short_cell` is read."""
    cost = contest.spec.cost
    return (
        f"Success in per cent | {cost.name} in {cost.unit}, mean of all runs, a failure counted as {failing(contest)}."
    )


def failing(contest: Contest) -> str:
    """Returns what a failure counts as, in words."""
    return contest.counted.partition(" in '")[0]


def gap(seen: Episodes | None, test: Episodes, contest: Contest) -> str:
    """Returns what an entry does better on the split that gains were tuned on; "" where it has not been there."""
    column = contest.gap
    if not seen or column is None:
        return ""
    reduce = REDUCTIONS[column.reduction]
    there, here = (float(reduce(measured(column, rows, contest))) for rows in (seen, test))
    better_there = here - there if column.metric == COST else there - here  # lower costs are better
    return f"{column.factor * better_there:+.{column.decimals}f}"


def grouped(rows: Sequence[Row], name: str) -> Mapping[str, list[Row]]:
    """Returns lines of text by what stands in a column, in the order in which that comes up."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row[name], []).append(row)
    return groups
