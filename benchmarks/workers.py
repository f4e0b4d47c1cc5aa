"""Worker processes: the same work on several cores, with the results in the order of the work."""

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]


@contextlib.contextmanager
def workers(count: int) -> Iterator[Map]:
    """Yields a `map` that works in `count` processes, or in this one when `count` is 1."""
    if count == 1:
        yield map
        return
    # spawned, not forked: compiled code and figures hold threads, which a fork would cut off
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), initializer=_ignore_interrupt)
    try:
        yield pool.map
    except BaseException:
        # what is under way may take a minute: nobody who interrupts wants to wait for it
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _ignore_interrupt() -> None:
    """Leaves Ctrl-C to the parent process, which then stops the pool."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
