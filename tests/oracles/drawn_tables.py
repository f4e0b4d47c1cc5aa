"""Rows of contests at random, and what tables show of rows, in plain loops."""

import itertools
import math
import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np

from wayfield.benchmarks.contests import Column, Contest
from wayfield.benchmarks.statistics.aggregates import counted_interval, interval, iqm, mean
from wayfield.benchmarks.statistics.crossed import share_interval

NAN = math.nan
COMMAND = "python evaluate.py --suite x"
ENTRIES = (("ppo", "trained"), ("A", "default"), ("A", "tuned"), ("B", "default"), ("C", "default"))
TIERS = ("easy", "medium", "hard")
FRONT = ("0.3", "0.9")


def rows_of(contest: Contest, seed: int, levels: Sequence[str] = ("none",)) -> list[dict[str, str]]:
    """Returns a contest's rows: five entries in fourteen scenarios of two families, on three splits."""
    rng = np.random.default_rng(seed)
    first = contest.policies[0]
    metrics = {column.metric for column in contest.columns} | {contest.spec.cost.metric, "collision"}
    metrics -= {"cost", "success"}
    courses = [("test", ""), ("validation", ""), *(("front", speed) for speed in FRONT)]
    found = []
    for entry, level in itertools.product(ENTRIES, levels):
        skill = rng.uniform(0.5, 0.97)
        if entry == ("C", "default"):
            skill = 0.0 if seed % 2 else 1.0
        cruise = {"A": 0.6, "B": 0.66, "C": 0.47}.get(entry[0], 0.595)
        for (split, speed), agent in itertools.product(courses, ("3", "0") if entry[0] == "ppo" else ("",)):
            for k in rng.permutation(14).tolist():
                family, episode = ("wide", k) if k < 8 else ("narrow", k - 8)
                won = float(rng.random() < skill)
                cells = {name: float(rng.gamma(3.0, 0.02)) for name in sorted(metrics)}
                cells |= {"success": won, "collision": float(not won and rng.random() < 0.5)}
                cells["mean_speed"] = float(rng.normal(float(speed) if speed == "0.9" else cruise, 0.004))
                cells["time"] = float(rng.uniform(8.0, 50.0))
                cells["ldlj"] = NAN if k == 5 and entry[0] == "B" else -float(rng.gamma(9.0))
                cells[contest.spec.cost.metric] = float(rng.gamma(3.0, 0.02)) * (1.0 if contest.pace else 300.0)
                if not won and entry[0] == "B":
                    cells[contest.spec.cost.metric] = NAN  # there may be none of a run that fails
                found.append(
                    {
                        "suite": contest.name, "contest": contest.name, "family": family, "robot": "p3dx",
                        "scenario": f"{family}/{split}", "disturbance": level, "gains": "", "dynamics": "kinematic",
                        "policy": first if entry[0] == "A" else entry[0], "gains_name": entry[1], "split": split,
                        "actuators": "lagged", "seed": str(k), "episode": str(episode), "tier": TIERS[k % 3],
                        "speed": speed, "agent_seed": agent, "knows": f"knows {entry[0]}", "parameters": "7",
                        "learned_from": f"from {entry[1]}", "failure_cost": "1.0" if contest.pace else "60.0",
                        **{name: "" if math.isnan(cell) else repr(cell) for name, cell in cells.items()},
                    }
                )  # fmt: skip
    return found


def number(row: Any, name: str) -> float:
    return float(row[name]) if row[name] else NAN


def groups(rows: Sequence[Any]) -> dict[tuple[str, str], list[Any]]:
    """Returns the rows by policy and gains, in the order in which they come."""
    found: dict[tuple[str, str], list[Any]] = {}
    for row in rows:
        found.setdefault((row["policy"], row["gains_name"]), []).append(row)
    return found


def named(entry: tuple[str, str]) -> str:
    return entry[0] if entry[1] == "default" else f"{entry[0]} ({entry[1]})"


def costs_of(rows: Sequence[Any], metric: str) -> list[float]:
    return [number(row, metric) if number(row, "success") else number(row, "failure_cost") for row in rows]


def table_of(rows: Sequence[Any], numbers: Sequence[float]) -> tuple[Any, list[str]]:
    """Returns numbers of rows by scenario and agent, in the order of the first rows, and the families."""
    scenarios, agents = ([*dict.fromkeys(keys)] for keys in (
        [(row["scenario"], row["episode"]) for row in rows], [row["agent_seed"] for row in rows]))  # fmt: skip
    table = np.full((len(scenarios), len(agents)), NAN)
    for row, value in zip(rows, numbers, strict=True):
        table[scenarios.index((row["scenario"], row["episode"])), agents.index(row["agent_seed"])] = value
    return table, [name.partition("/")[0] for name, _ in scenarios]


def told(value: float, ends: Any, factor: float, decimals: int) -> str:
    text = f"{factor * value:.{decimals}f}"
    return text if ends is None else f"{text} [{', '.join(f'{factor * end:.{decimals}f}' for end in ends)}]"


def won_told(rows: Sequence[Any]) -> str:
    won = [number(row, "success") for row in rows]
    return told(statistics.fmean(won), share_interval(*table_of(rows, won)), 100.0, 1)


def cell_of(column: Column, rows: Sequence[Any], contest: Contest) -> str:
    """Returns what a column shows of some rows."""
    rows = [row for row in rows if number(row, "success") or not column.successes_only]
    of_cost = column.metric == "cost"
    metric = contest.spec.cost.metric if of_cost else column.metric
    numbers = costs_of(rows, metric) if of_cost or column.imputed else [number(row, metric) for row in rows]
    known = [each for each in numbers if not math.isnan(each)]
    if not known:
        return ""
    ends = None
    if column.with_interval and len(known) == len(numbers):
        table, strata = table_of(rows, numbers)
        if column.reduction == "mean":
            failure = number(rows[0], "failure_cost") if of_cost or column.imputed else 0.0
            won = table_of(rows, [number(row, "success") for row in rows])[0]
            ends = counted_interval(table, won, failure, strata)
        else:
            ends = interval(table, strata, iqm)
    value = {"mean": statistics.fmean, "max": max, "iqm": lambda all_: float(iqm(np.array(all_)))}[column.reduction]
    return told(value(known), ends, column.factor, column.decimals)


def short_of(rows: Sequence[Any], contest: Contest, success: str = "") -> str:
    if not rows:
        return ""
    success = success or f"{100.0 * statistics.fmean(number(row, 'success') for row in rows):.0f}"
    cost = contest.spec.cost
    return f"{success} | {statistics.fmean(costs_of(rows, cost.metric)):.{cost.decimals}f}"


def speed_of(rows: Sequence[Any]) -> float:
    speeds = [number(row, "mean_speed") for row in rows if number(row, "success")]
    return statistics.fmean(speeds) if speeds else NAN


def shown_pace(speed: float) -> str:
    return "-" if math.isnan(speed) else f"{speed:.2f}"


def is_off(rows: Sequence[Any], asked: float | None) -> bool:
    return asked is not None and abs(speed_of(rows) - asked) > 0.03 * asked  # of NaN it is false


def solved_of(rows: Sequence[Any], metric: str) -> tuple[Any, list[str]]:
    """Returns a metric as a table of the scenarios that are solved, who fails there at the mean of the others."""
    met: dict[tuple[str, str], list[Any]] = {}
    for row in rows:
        met.setdefault((row["scenario"], row["episode"]), []).append(row)
    lines, strata = [], []
    for runs in met.values():
        took = [number(row, metric) for row in runs if number(row, "success")]
        if took:
            lines.append([number(row, metric) if number(row, "success") else statistics.fmean(took) for row in runs])
            strata.append(runs[0]["family"])
    return np.array(lines), strata


def typical_of(rows: Sequence[Any], contest: Contest) -> str:
    """Returns the cost of the successes as tables show it."""
    table, strata = solved_of(rows, contest.cost.metric)
    if not len(table):
        return ""
    in_mm = contest.cost.unit == "m"
    reduce = iqm if in_mm else np.mean
    ends = interval(table, strata, iqm if in_mm else mean)
    return told(float(reduce(table.ravel())), ends, 1e3 if in_mm else 1.0, 2 if in_mm else 1)


def in_order(entries: dict[tuple[str, str], list[Any]], contest: Contest) -> list[tuple[str, str]]:
    """Returns the entries as they stand: by success, then by the cost of the successes."""

    def key(entry: tuple[str, str]) -> tuple[float, ...]:
        rows = entries[entry]
        won = -statistics.fmean(number(row, "success") for row in rows)
        table, _ = solved_of(rows, contest.cost.metric)
        if not len(table):
            return won, math.inf
        return won, float((iqm if contest.cost.unit == "m" else np.mean)(table.ravel()))

    return sorted(entries, key=key)
