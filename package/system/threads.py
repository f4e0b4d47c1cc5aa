"""Threads that share out the rows of a batch: compiled code lets Python go, so that several run at once."""

import functools
import itertools
import os
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wayfield.system.compiled import machine_code
from wayfield.system.sharing import BEGUN, BRIEF, all_left, entered, left, shares_of

# What each thread of a job does: takes rows, by its number from 0 on and the job's shares, until none are left.
Turn = Callable[[int, NDArray[np.int64]], Any]
Made = TypeVar("Made")

_LEAST = 32  # rows of a block: fewer are done sooner than another thread is woken
_PAUSE = 1e-4  # s, between looks for threads that take their time


class _Job:
    """The threads' next job, in a linked list: a late thread goes through every job and finds it done."""

    def __init__(self, threads: int) -> None:
        self.shares = shares_of(threads)
        self.gate = threading.Lock()  # shut until the job begins
        self.gate.acquire()
        self.turn: Turn | None = None
        self.errors: list[BaseException] = []
        self.following: _Job

    def help(self, thread: int) -> None:
        """Does what one of the other threads can of it."""
        turn = self.turn
        if turn is not None:  # otherwise it has ended
            try:
                turn(thread, self.shares)
            except BaseException as error:
                self.errors.append(error)


class ThreadPool:
    """Threads besides the caller's; they wait while there is no work, and end with the process."""

    def __init__(self, others: int) -> None:
        self._threads = others + 1
        self._coming = job = _Job(self._threads)
        self._lock = threading.Lock()
        self._entered = machine_code(entered, job.shares)
        self._left = machine_code(left, job.shares, job.shares)
        self._all_left = machine_code(all_left, job.shares)
        for k in range(1, self._threads):
            threading.Thread(target=self._serve, args=(k, job), name="wayfield rows", daemon=True).start()

    def share(self, turn: Turn, meanwhile: Callable[[], None] | None = None) -> None:
        """Lets each thread take its turn; returns when all are done.

        Args:
            turn: lets Python go and sets `shares[BEGUN]` as soon as it may be taken by others.
            meanwhile: what the caller's thread does between a brief turn and another. Not before: the others begin when
                it lets Python go, which Python code does not for milliseconds.

        Raises:
            BaseException: the first of those that turns raised, once all have ended.
        """
        with self._lock:
            job = self._coming
            job.following = self._coming = _Job(self._threads)
            job.turn = turn
            job.shares[BRIEF] = meanwhile is not None
            job.gate.release()
        try:
            job.help(0)
            if meanwhile is not None:
                meanwhile()
        finally:
            if meanwhile is not None:
                job.shares[BRIEF] = 0
                job.help(0)
            while not self._all_left(job.shares):
                time.sleep(_PAUSE)
            job.turn = None
        if job.errors:
            raise job.errors[0]

    def run(self, work: Callable[[int], None], count: int) -> None:
        """Does blocks 0 to count - 1, in any order and several at once; returns when all are done.

        Raises:
            BaseException: the first of those that blocks raised, once all blocks have ended.
        """
        blocks = iter(range(count))  # whose `next` no other thread can break into
        errors: list[BaseException] = []

        def turn(thread: int, shares: NDArray[np.int64]) -> None:
            shares[BEGUN] = 1
            for k in blocks:
                try:
                    work(k)
                except BaseException as error:
                    errors.append(error)

        self.share(turn)
        if errors:
            raise errors[0]

    def _serve(self, thread: int, job: _Job) -> None:
        before = shares_of(0)
        while True:
            if not self._left(before, job.shares):
                with job.gate:
                    pass
            self._entered(job.shares)
            job.help(thread)
            before, job = job.shares, job.following


@functools.cache
def thread_pool(num_threads: int) -> ThreadPool:
    """Returns the pool of so many threads, the caller's own among them, which all batches of a process share."""
    return ThreadPool(num_threads - 1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=thread_pool.cache_clear)  # threads stay behind in the parent


def one_a_thread(make: Callable[..., Made]) -> Callable[..., Made]:
    """Returns a function that makes a thing once in each thread for the same arguments: a solver has a memory."""
    made = functools.lru_cache(lambda thread, *arguments: make(*arguments))
    return lambda *arguments: made(threading.get_ident(), *arguments)


def bounds(rows: int, blocks: int) -> list[tuple[int, int]]:
    """Returns the first row and the one behind the last of each of at most so many blocks, alike and not small."""
    blocks = max(1, min(blocks, rows // _LEAST))
    return list(itertools.pairwise(rows * k // blocks for k in range(blocks + 1)))
