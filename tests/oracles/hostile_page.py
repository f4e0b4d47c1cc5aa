"""A page of which every text is hostile."""

from typing import Any

import numpy as np

from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.report.page import Content
from wayfield.benchmarks.report.worlds import plain
from wayfield.envs.scenarios import splits

HOSTILE = "<script>alert(1)</script>&\"'"


def hostile() -> Content:
    scenario = splits.split("goal_reaching", "clutter_5", "test")[0]
    told: dict[str, Any] = {
        **{"contest": HOSTILE, "family": HOSTILE, "tier": HOSTILE, "policy": HOSTILE, "agent": "", "robot": "p3dx"},
        **{"plant": "kinematic", "actuators": "lagged", "disturbance": "none", "outcome": "collision", "time": 1.0},
        **{"world": 0, "episode": 0},
    }
    return Content(
        sentences=[HOSTILE],
        small=[Table(HOSTILE, [HOSTILE], [[HOSTILE]], HOSTILE)],
        tables=[Table(HOSTILE, [HOSTILE, "n"], [[HOSTILE, "2"], ["b", "10"]], HOSTILE)],
        worlds=[plain(scenario, 1200) | {"name": HOSTILE}],
        episodes=[told],
        drives=[np.cumsum(np.full((60, 3), 30, np.int32), axis=0)],
        missing=[HOSTILE],
    )
