"""Rows of a contest made by hand."""

from typing import Any

import numpy as np

from wayfield.benchmarks.records.episode import Row

PATHS, GOALS = "path-following", "goal-obstacles"
COUNT = 8  # scenarios of each of two families


def made(contest: str, policy: str, cells: dict[str, Any], split: str = "test", **more: str) -> list[Row]:
    """Returns a row for each of 2 x COUNT scenarios; cells: numbers by metric, one a scenario or one for all."""
    found = []
    for k in range(2 * COUNT):
        family = ("wide", "narrow")[k // COUNT]
        row = {
            "suite": "x", "contest": contest, "family": family, "scenario": f"{family}/{split}", "robot": "p3dx",
            "disturbance": "none", "policy": policy, "gains_name": "default", "gains": "", "dynamics": "kinematic",
            "actuators": "lagged", "seed": str(k), "episode": str(k % COUNT), "split": split,
            "tier": ("easy", "medium", "hard")[k % 3], "speed": "", "agent_seed": "",
            "knows": "sensors", "parameters": "", "learned_from": "",
            "failure_cost": "1.0" if contest == PATHS else "60.0",
        }  # fmt: skip
        values = {name: np.broadcast_to(np.asarray(each, float), 2 * COUNT)[k] for name, each in cells.items()}
        found.append(row | {name: repr(float(each)) for name, each in values.items()} | more)
    return found
