"""Rows of contests at random."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from wayfield.benchmarks.contests import Contest

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
