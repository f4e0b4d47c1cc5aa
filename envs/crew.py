"""Threads that share out the rows of a batch: compiled code lets Python go, so that several run at once."""

import functools
import itertools
import os
import queue
import threading
from collections.abc import Callable
from typing import TypeVar

Work = Callable[[int], None]  # does block k
Made = TypeVar("Made")

_LEAST = 32  # rows of a block: fewer are done sooner than another thread is woken


class _Job:
    """Blocks of work, of which each thread takes the next as long as there are some."""

    def __init__(self, work: Work, count: int) -> None:
        self._work, self._count = work, count
        self._next, self._ended = itertools.count(), itertools.count(1)  # whose `next` no other thread can break into
        self.errors: list[BaseException] = []
        self.done = threading.Lock()
        self.done.acquire()

    def help(self) -> None:
        """Does blocks until none are left to begin."""
        while self.help_once():
            pass

    def help_once(self) -> bool:
        """Does a block, and returns whether there was one left to begin."""
        k = next(self._next)
        if k >= self._count:
            return False
        try:
            self._work(k)
        except BaseException as error:
            self.errors.append(error)
        if next(self._ended) == self._count:
            self.done.release()
        return True


class Crew:
    """Threads besides the one that calls; they wait where there is nothing to do, and end with the process."""

    def __init__(self, others: int) -> None:
        self._others = others
        self._jobs: queue.SimpleQueue[_Job] = queue.SimpleQueue()
        for _ in range(others):
            threading.Thread(target=self._serve, name="wayfield rows", daemon=True).start()

    def run(self, work: Work, count: int, meanwhile: Callable[[], None] | None = None) -> None:
        """Does blocks 0 to count - 1, in any order and several at once; returns when all are done.

        Args:
            meanwhile: what the caller's thread does behind its first block. Not before: the others begin when it lets
                Python go, which Python code does not for milliseconds.

        Raises:
            BaseException: the first of those that blocks raised, once all blocks have ended.
        """
        job = _Job(work, count)
        for _ in range(min(self._others, count - 1)):
            self._jobs.put(job)
        job.help_once()
        try:
            if meanwhile is not None:
                meanwhile()
        finally:
            job.help()
            job.done.acquire()
        if job.errors:
            raise job.errors[0]

    def _serve(self) -> None:
        while True:
            self._jobs.get().help()


@functools.cache
def crew(num_threads: int) -> Crew:
    """Returns the crew of so many threads, the caller's own among them, which all batches of a process share."""
    return Crew(num_threads - 1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=crew.cache_clear)  # threads stay behind in the parent


def one_a_thread(make: Callable[..., Made]) -> Callable[..., Made]:
    """Returns a function that makes a thing once in each thread for the same arguments: a solver has a memory."""
    made = functools.lru_cache(lambda thread, *arguments: make(*arguments))
    return lambda *arguments: made(threading.get_ident(), *arguments)


def bounds(rows: int, blocks: int, less: int = 0) -> list[tuple[int, int]]:
    """Returns the first row and the one behind the last of each of at most so many blocks, alike and not small.

    The first block has `less` fewer rows, as far as it has them: of the thread that has other work besides.
    """
    blocks = max(1, min(blocks, rows // _LEAST))
    if blocks == 1:
        return [(0, rows)]
    first = max(0, (rows + less) // blocks - less)
    edges = [first + (rows - first) * k // (blocks - 1) for k in range(blocks)]
    return list(itertools.pairwise([0, *edges]))
