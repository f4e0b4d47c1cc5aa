"""How far a run has come: a bar on a terminal, a line now and then elsewhere. All on stderr."""

import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import rich.console
import rich.progress

T = TypeVar("T")

_PAUSE = 5.0  # s, between lines where there is no terminal
_FORETELLING = 0.1  # of all must be done before it is said how long the rest takes


def tell_of_compiling(kernel: Any) -> bool:
    """Says that a first run compiles, where numba has kept nothing of a kernel yet; returns whether that is so."""
    kept = getattr(kernel, "_cache", None)
    folder = getattr(kept, "cache_path", None)
    compiles = not isinstance(folder, str) or not any(Path(folder).glob(f"*.{kernel.py_func.__name__}-*.nbi"))
    if compiles:
        print(
            "first run: the kernels are compiled, which takes about a minute and is kept", file=sys.stderr, flush=True
        )
    return compiles


def tracked(items: Iterable[T], total: int, unit: str, foretold: bool = True) -> Iterator[T]:
    """Yields the items and shows how many of the total are done.

    Args:
        foretold: whether to show how long the rest takes: while kernels are compiled, nothing tells.
    """
    console = rich.console.Console(file=sys.stderr)
    if console.is_terminal:
        clock = rich.progress.TimeRemainingColumn() if foretold else rich.progress.TimeElapsedColumn()
        columns = rich.progress.Progress.get_default_columns()[:-1]
        with rich.progress.Progress(*columns, clock, console=console, transient=True) as bar:
            yield from bar.track(items, total, description=unit)
        return
    told = start = time.perf_counter()
    for done, item in enumerate(items, 1):
        now = time.perf_counter()
        if now - told >= _PAUSE or done == total:
            told = now
            # the first of a run may have compiled, which says nothing of the rest
            known = foretold and _FORETELLING * total <= done < total
            left = f", about {(now - start) * (total - done) / done:.0f} s left" if known else ""
            print(f"{done} of {total} {unit}, {now - start:.0f} s{left}", file=sys.stderr, flush=True)
        yield item
