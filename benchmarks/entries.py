"""The rows of a contest as entries: who drove, with which gains, and numbers as tables of scenarios and agents."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.aggregates import counted_interval, interval, iqm, mean
from wayfield.benchmarks.contests import COST, OWN_SPLIT, PACE_TOLERANCE, PUBLIC_SPLIT, Column, Contest
from wayfield.benchmarks.crossed import share_interval
from wayfield.benchmarks.results import Row, number
from wayfield.envs.disturbances import LEVELS
from wayfield.policies.learned.ppo import shipped

Entry = tuple[str, str]  # policy, and the name of its gains
Array = NDArray[np.float64]

COMPARED = ("test", "claims", OWN_SPLIT, PUBLIC_SPLIT)  # the splits that entries are ranked on
OFF_PACE = "‡"

_NEEDED = ("contest", "family", "split", "failure_cost", "agent_seed", "knows")


def greatest(values: Array) -> Array:
    """Returns the greatest value over the last axis."""
    return np.asarray(np.max(values, axis=-1))


REDUCTIONS = {"iqm": iqm, "mean": mean, "max": greatest}


def check_columns(rows: Sequence[Row]) -> None:
    """Raises ValueError, naming the columns, unless the rows are those of a contest of this version."""
    missing = [name for name in _NEEDED if rows and name not in rows[0]]
    if missing:
        raise ValueError(
            f"the episodes have no column {', '.join(missing)}: they are of an earlier version; run the contest again"
        )


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


def seeds_told(rows: Sequence[Row], contest: Contest) -> str:
    """Returns which training runs of the agents that ship drove, in words: of a short run the first alone."""
    driven = {int(row["agent_seed"]) for row in rows if row["gains_name"] == "trained" and row["agent_seed"]}
    robots = {row["robot"] for row in rows}
    there = {seed for robot in robots for seed in shipped(contest.spec.name, robot)}
    return f"seeds {min(driven)} to {max(driven)} alone" if driven and driven < there else "every seed"


def levels_of(rows: Sequence[Row]) -> list[str]:
    """Returns the levels of disturbance that there are rows of, in their order."""
    there = dict.fromkeys(row["disturbance"] for row in rows)
    return [level for level in LEVELS if level in there] + [level for level in there if level not in LEVELS]


def values(rows: Sequence[Row], metric: str) -> Array:
    """Returns a metric of each episode."""
    return np.array([number(row, metric) for row in rows])


def costs(rows: Sequence[Row], contest: Contest) -> Array:
    """Returns the cost of each episode; that of a failure is in its row."""
    return imputed(rows, contest.spec.cost.metric)


def imputed(rows: Sequence[Row], metric: str) -> Array:
    """Returns a metric of each episode, in place of it the cost of a failure, which is in the row, where it failed."""
    return np.where(values(rows, "success") == 1.0, values(rows, metric), values(rows, "failure_cost"))


def scenario(row: Row) -> tuple[str, str]:
    """Returns what tells the scenario of an episode from all others."""
    return row["scenario"], row["episode"]


def by_scenario(rows: Sequence[Row], numbers: Array) -> tuple[Array, list[str]]:
    """Returns numbers, one an episode, as a table (s, r), a line a scenario and a column a trained agent; and strata.

    The strata are the families; scenarios from the user's files, each of which is its own family, are one stratum, and
    so are those of a public benchmark where each is its own.

    Raises:
        ValueError: if not every agent has met every scenario once.
    """
    agents = {seed: k for k, seed in enumerate(dict.fromkeys(row["agent_seed"] for row in rows))}
    strata = {scenario(row): OWN_SPLIT if row["split"] == OWN_SPLIT else row["family"] for row in rows}
    if rows[0]["split"] == PUBLIC_SPLIT and len(set(strata.values())) == len(strata):
        strata = dict.fromkeys(strata, PUBLIC_SPLIT)
    lines = {each: k for k, each in enumerate(strata)}
    table = np.full((len(lines), len(agents)), np.nan)
    filled = np.zeros(table.shape, np.bool_)
    for row, value in zip(rows, numbers, strict=True):
        at = lines[scenario(row)], agents[row["agent_seed"]]
        table[at], filled[at] = value, True
    if table.size != len(rows) or not filled.all():
        raise ValueError(f"{rows[0]['policy']}: {len(agents)} agents and {len(lines)} scenarios in {len(rows)} runs")
    return table, list(strata.values())


def measured(column: Column, rows: Sequence[Row], contest: Contest) -> Array:
    """Returns what a column shows of each episode, before it is reduced."""
    if column.metric == COST:
        return costs(rows, contest)
    return imputed(rows, column.metric) if column.imputed else values(rows, column.metric)


def success_interval(rows: Sequence[Row]) -> tuple[float, float] | None:
    """Returns the 95 % interval of the share of successes, `crossed.share_interval`; None of too few scenarios."""
    return share_interval(*by_scenario(rows, values(rows, "success")))


def mean_interval(rows: Sequence[Row], numbers: Array, failure: float) -> tuple[float, float] | None:
    """Returns the 95 % interval of the mean of numbers, one an episode, of which every failure counts as `failure`."""
    table, strata = by_scenario(rows, numbers)
    return counted_interval(table, by_scenario(rows, values(rows, "success"))[0], failure, strata)


def mean_speed(rows: Sequence[Row]) -> float:
    """Returns the mean speed of the successes, m/s; NaN where there are none."""
    won = [row for row in rows if number(row, "success") == 1.0]
    return float(values(won, "mean_speed").mean()) if won else math.nan


def shown_speed(speed: float, decimals: int) -> str:
    """Returns a mean speed (m/s) as it is shown: "-" where nobody has succeeded."""
    return "-" if math.isnan(speed) else f"{speed:.{decimals}f}"


def off_pace(rows: Sequence[Row], asked: float | None) -> bool:
    """Returns whether the mean speed is off the one that was asked for, m/s; None: none was."""
    if asked is None:
        return False
    speed = mean_speed(rows)
    return not math.isnan(speed) and abs(speed - asked) > PACE_TOLERANCE * asked


def by_slowness(ahead: float, behind: float, contest: Contest) -> bool:
    """Returns whether who does better is the slower one, by its mean speed (m/s), where a contest asks for a speed."""
    return contest.pace is not None and ahead < (1.0 - PACE_TOLERANCE) * behind


def success_cell(rows: Sequence[Row]) -> str:
    """Returns the share of successes in per cent with its 95 % interval."""
    return _with_ends(float(values(rows, "success").mean()), success_interval(rows), 100.0, 1)


def cell(column: Column, rows: Sequence[Row], contest: Contest) -> str:
    """Returns a cell of the standings, empty where nothing was measured."""
    if column.successes_only:
        rows = [row for row in rows if number(row, "success") == 1.0]
    numbers = measured(column, rows, contest)
    found = numbers[~np.isnan(numbers)]
    if not len(found):
        return ""
    reduce = REDUCTIONS[column.reduction]
    ends = None
    if column.with_interval and len(found) == len(numbers):
        if column.reduction == "mean":  # of a score a failure has none
            counts = values(rows, "failure_cost").mean() if column.metric == COST or column.imputed else 0.0
            ends = mean_interval(rows, numbers, float(counts))
        else:
            ends = interval(*by_scenario(rows, numbers), reduce)
    return _with_ends(float(reduce(found)), ends, column.factor, column.decimals)


def _with_ends(value: float, ends: tuple[float, float] | None, factor: float, decimals: int) -> str:
    text = f"{factor * value:.{decimals}f}"
    if ends is None:
        return text
    return f"{text} [{factor * ends[0]:.{decimals}f}, {factor * ends[1]:.{decimals}f}]"


def short_cell(rows: Sequence[Row], contest: Contest, success: str = "") -> str:
    """Returns the share of successes in per cent, or what is given in its place, and the mean cost of all runs."""
    if not rows:
        return ""
    won = float(values(rows, "success").mean())
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


def gap(seen: Sequence[Row], test: Sequence[Row], contest: Contest) -> str:
    """Returns what an entry does better on the split that gains were tuned on; "" where it has not been there."""
    if not seen:
        return ""
    column = contest.gap
    reduce = REDUCTIONS[column.reduction]
    there, here = (float(reduce(measured(column, rows, contest))) for rows in (seen, test))
    better_there = here - there if column.metric == COST else there - here  # lower costs are better
    return f"{column.factor * better_there:+.{column.decimals}f}"


def grouped(rows: Sequence[Row], name: str) -> Mapping[str, list[Row]]:
    """Returns the rows by what stands in a column, in the order in which that comes up."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row[name], []).append(row)
    return found
