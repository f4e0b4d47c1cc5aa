"""Who did it better: cases as data, one rollout loop, metrics of recorded trajectories, and tables and figures of them.

From Python, `compare` holds a contest and returns its rows and tables; `evaluate` is the command line.

`cases` says what a case is, `documents`, `own_scenario` and `contests` list them, `own_policies` brings policies from
outside, `rollout` drives them, `trajectory` is what is kept of an episode, `metrics` measures it, `suite` and `parts`
play many, `results` writes and reads them, `run_folder` says where, `document_tables` and `document_figures`,
`standings` and `contest_figures`, and `video` show them, and `throughput` times the environments themselves.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wayfield.benchmarks.comparison import Comparison, compare

__all__ = ["Comparison", "compare"]


def __getattr__(name: str) -> Any:
    """Returns what is loaded only when asked for, since it needs the extra "evaluate"."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from wayfield.benchmarks import comparison

    return getattr(comparison, name)
