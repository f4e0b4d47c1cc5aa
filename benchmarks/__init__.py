"""Contests: cases as data, one rollout loop, metrics of recorded trajectories, tables and figures.

From Python, `compare` holds a contest and returns its rows and tables; `read_rows` and `read_trajectories` read the
folder of a run; `evaluate` is the command line.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wayfield.benchmarks.commands.comparison import Comparison, compare
    from wayfield.benchmarks.records.results import read_rows, read_trajectories
    from wayfield.benchmarks.records.trajectory import Trajectory

__all__ = ["Comparison", "Trajectory", "compare", "read_rows", "read_trajectories"]

_WHERE = {
    **dict.fromkeys(("Comparison", "compare"), "commands.comparison"),
    **dict.fromkeys(("read_rows", "read_trajectories"), "records.results"),
    "Trajectory": "records.trajectory",
}


def __getattr__(name: str) -> Any:
    """Returns what is loaded only when asked for: `compare` needs the extra "evaluate", and all take their time."""
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_WHERE[name]}"), name)
