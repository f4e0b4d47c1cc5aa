"""Worker processes: the same work on several cores, with the results in the order of the work."""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from wayfield.envs.processes import end_with_parent, interrupts_held

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]


MOST = 4  # processes, unless more are asked for: with each comes what it imports and compiles


def cores() -> int:
    """Returns how many processes share the work by default: the cores that this one may use, `MOST` at most."""
    # of a container or under taskset these are fewer than the machine has
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(there, MOST)


@contextlib.contextmanager
def workers(count: int) -> Iterator[Map]:
    """Yields a `map` that works in `count` processes, or in this one when `count` is 1. They end with this one.

    Raises:
        ChildProcessError: if a process is killed from outside.
    """
    if count == 1:
        yield map
        return
    # spawned, not forked: compiled code and figures hold threads, which a fork would cut off
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(os.getpid(),))

    def share(function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        with _told_of_the_killed(), interrupts_held():  # this starts the processes
            found = pool.map(function, items)
        return results(found)

    def results(found: Iterator[Any]) -> Iterator[Any]:
        with _told_of_the_killed():
            yield from found

    try:
        yield share
    except BaseException:
        # what is under way may take a minute: nobody who interrupts wants to wait for it
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextlib.contextmanager
def _told_of_the_killed() -> Iterator[None]:
    """Says in a line that a process is gone."""
    try:
        yield
    except BrokenProcessPool:
        raise ChildProcessError(
            "a worker process was killed, as a system does that runs out of memory; fewer --workers need less"
        ) from None


def _begin(parent: int) -> None:
    """Leaves Ctrl-C to the parent process, which then stops the pool, and its own end too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(parent)
