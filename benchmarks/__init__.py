"""Who did it better: cases as data, one rollout loop, metrics of recorded trajectories, and tables and figures of them.

From Python, `compare` holds a contest and returns its rows and tables; `read_rows` and `read_trajectories` read the
folder of a run; `evaluate` is the command line.

`cases` says what a case is, `documents`, `own_scenario` and `contests` list them, `own_policies` brings policies from
outside, `rollout` drives them, `trajectory` is what is kept of an episode, `metrics` measures it, `suite` and `parts`
play many, `results` writes and reads them, `run_folder` says where, `document_tables` and `document_figures`,
`standings` and `contest_figures`, and `video` show them; `drives`, `play` and `lists` are for one robot and for what
there is, and `throughput` times the environments themselves.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wayfield.benchmarks.comparison import Comparison, compare
    from wayfield.benchmarks.results import read_rows, read_trajectories
    from wayfield.benchmarks.trajectory import Trajectory

__all__ = ["Comparison", "Trajectory", "compare", "read_rows", "read_trajectories"]

_WHERE = {
    **dict.fromkeys(("Comparison", "compare"), "comparison"),
    **dict.fromkeys(("read_rows", "read_trajectories"), "results"),
    "Trajectory": "trajectory",
}


def __getattr__(name: str) -> Any:
    """Returns what is loaded only when asked for: `compare` needs the extra "evaluate", and all take their time."""
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_WHERE[name]}"), name)
