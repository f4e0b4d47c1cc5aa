"""What a process says of compiling on stderr, each once."""

import multiprocessing
import sys
import warnings

_told: set[str] = set()


def tell_of_no_cache(problem: str) -> None:
    """Says that compiled code is not kept."""
    if "no cache" not in _told:
        _told.add("no cache")
        warnings.warn(
            f"wayfield compiles anew in every process, up to a minute: compiled code is not kept: {problem}",
            RuntimeWarning,
            stacklevel=5,
        )


def tell_of_damage(problem: str) -> None:
    """Says that machine code which the package carries is damaged, so that it is compiled instead."""
    if "damage" not in _told:
        _told.add("damage")
        warnings.warn(f"wayfield is damaged, install it again: {problem}", RuntimeWarning, stacklevel=6)


def tell_of_compiling(takes: str) -> None:
    """Says that kernels are compiled; no-op in a worker, where that was said of every process, and where Gymnasium's
    logger shows no warnings.

    Args:
        takes: how long.
    """
    if {"compiling", "no cache"} & _told or multiprocessing.parent_process() is not None:
        return
    _told.add("compiling")
    logger = sys.modules.get("gymnasium.logger")
    if logger is None or logger.min_level <= logger.WARN:
        print(f"first run: the kernels are compiled, which takes {takes}", file=sys.stderr, flush=True)
