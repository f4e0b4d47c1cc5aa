"""What a process says of compiling on stderr, each once."""

import multiprocessing
import os
import sys
import warnings

_shown: set[str] = set()
NO_CACHE = "WAYFIELD_TOLD_OF_NO_CACHE"  # in the environment, which the processes that one starts inherit


def tell_of_no_cache(problem: str) -> None:
    """Says that compiled code is not kept; the processes that this one starts do not say it again."""
    if NO_CACHE not in os.environ:
        os.environ[NO_CACHE] = "1"
        warnings.warn(
            f"wayfield compiles anew in every process, up to a minute: compiled code is not kept: {problem}",
            RuntimeWarning,
            stacklevel=5,
        )


def tell_of_damage(problem: str) -> None:
    """Says that machine code which the package carries is damaged, so that it is compiled instead."""
    if "damage" not in _shown:
        _shown.add("damage")
        warnings.warn(f"wayfield is damaged, install it again: {problem}", RuntimeWarning, stacklevel=6)


def tell_of_compiling(takes: str) -> None:
    """Says that kernels are compiled; no-op in a worker, where that was said of every process, and where Gymnasium's
    logger shows no warnings.

    Args:
        takes: how long.
    """
    if "compiling" in _shown or NO_CACHE in os.environ or multiprocessing.parent_process() is not None:
        return
    _shown.add("compiling")
    logger = sys.modules.get("gymnasium.logger")
    if logger is None or logger.min_level <= logger.WARN:
        print(f"first run: the kernels are compiled, which takes {takes}", file=sys.stderr, flush=True)
