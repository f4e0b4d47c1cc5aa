"""How far a run has come: a bar on a terminal, a line now and then elsewhere. All on stderr."""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

import rich.console
import rich.progress

T = TypeVar("T")

_PAUSE = 5.0  # s, between lines where there is no terminal


def tracked(items: Iterable[T], total: int, unit: str) -> Iterator[T]:
    """Yields the items and shows how many of the total are done."""
    console = rich.console.Console(file=sys.stderr)
    if console.is_terminal:
        yield from rich.progress.track(items, unit, total, console=console, transient=True)
        return
    told = start = time.perf_counter()
    for done, item in enumerate(items, 1):
        now = time.perf_counter()
        if now - told >= _PAUSE or done == total:
            told = now
            print(f"{done} of {total} {unit}, {now - start:.0f} s", file=sys.stderr, flush=True)
        yield item
