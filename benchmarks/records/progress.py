"""How far a run has come: a bar on a terminal, a line now and then elsewhere. All on stderr."""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

import rich.console
import rich.progress
import rich.text

from wayfield.system import compile_notices
from wayfield.system.compiled import is_stored

T = TypeVar("T")

_PAUSE = 5.0  # s, between lines where there is no terminal
_FIRST = 1.0  # s, before the first of them
_TYPICAL = 0.1  # of all must be done before their mean time is that of the rest


def tell_of_compiling(kernel: Any) -> bool:
    """Says that a first run compiles, where no code of a kernel is kept yet; returns whether that is so."""
    compiles = not is_stored(kernel)
    if compiles:
        compile_notices.tell_of_compiling("about a minute")
    return compiles


def tracked(items: Iterable[T], total: int, unit: str, compiles: bool = False) -> Iterator[T]:
    """Yields the items and shows how many of the total are done, and from the first on how long the rest takes.

    Args:
        compiles: whether kernels are compiled meanwhile, so that the rest takes less time than what is done.
    """
    console = rich.console.Console(file=sys.stderr)
    if console.is_terminal:
        columns = rich.progress.Progress.get_default_columns()[:-1]
        with rich.progress.Progress(*columns, _Left(compiles), console=console, transient=True) as bar:
            yield from bar.track(items, total, description=unit)
        return
    start = time.perf_counter()
    due = start + _FIRST
    for done, item in enumerate(items, 1):
        now = time.perf_counter()
        if now >= due or done == total:
            due = now + _PAUSE
            left = _left(done, total, now - start, compiles)
            print(f"{done} of {total} {unit}, {now - start:.0f} s{left and ', '}{left}", file=sys.stderr, flush=True)
        yield item


class _Left(rich.progress.ProgressColumn):
    """How long the rest takes; rich's own column is silent until the second item."""

    def __init__(self, compiles: bool) -> None:
        super().__init__()
        self._compiles = compiles

    def render(self, task: rich.progress.Task) -> rich.text.Text:
        """Returns the time left, or the time since the start before the first item."""
        elapsed, total = task.elapsed or 0.0, int(task.total or 0)
        return rich.text.Text(_left(int(task.completed), total, elapsed, self._compiles) or f"{elapsed:.0f} s")


def _left(done: int, total: int, elapsed: float, compiles: bool) -> str:
    """Returns how long the rest takes, in words: a bound while little is done, as the first items take longer."""
    if not 0 < done < total:
        return ""
    rest = elapsed * (total - done) / done
    word = "up to" if compiles or done < _TYPICAL * total else "about"
    return f"{word} {rest:.0f} s left" if rest < 100.0 else f"{word} {rest / 60.0:.0f} min left"
