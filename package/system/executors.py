"""Executors: work in this process, in others of this machine, or wherever another library's executor runs it."""

import concurrent.futures
import contextlib
import itertools
import multiprocessing
import os
import queue
import signal
import socket
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from wayfield.system.checks import printable
from wayfield.system.identity import differences, identity
from wayfield.system.objects import FileNote
from wayfield.system.processes import end_with_parent, interrupts_held

MOST = 4  # processes, by default: with each comes what it imports and compiles

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]
Submit = Callable[[Callable[[Any], Any], Any], "Future[Any]"]

TRIES = 2  # of an item on machines that may fail for reasons of their own
_AHEAD = 10_000  # items that are handed over before the first has come back: what a scheduler holds with ease
_LOOK = 5.0  # s without a result, after which an executor looks whether any worker is left
_KILLED = "a worker process was killed, as a system does that runs out of memory; fewer --workers need less"
_NAMED = 3  # failed items that are named


def cores() -> int:
    """Returns how many processes share the work by default: the cores that this one may use, `MOST` at most."""
    # of a container or under taskset these are fewer than the machine has
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(there, MOST)


class Refused(RuntimeError):
    """A worker has other code, agents or libraries than this process, so that its rows would not go with ours."""

    def __init__(self, worker: str, why: str) -> None:
        super().__init__(worker, why)
        self.worker, self.why = worker, why

    def __str__(self) -> str:
        return f"worker {self.worker} is refused: {self.why}"


class Failed(RuntimeError):
    """Some items failed as often as they may; all others were done.

    Attributes:
        failures: each item with its last error.
        done: what was made of the others, where nothing else keeps it.
    """

    def __init__(self, failures: list[tuple[Any, BaseException]], total: int, tries: int) -> None:
        self.failures = failures
        self.done: Any = None
        often = {1: "once", 2: "twice"}.get(tries, f"{tries} times")
        named = [f"{item} ({_line_of(error)})" for item, error in failures[:_NAMED]]
        more = [f"and {len(failures) - _NAMED} more"] if len(failures) > _NAMED else []
        super().__init__(f"{len(failures)} of {total} failed {often}: {'; '.join(named + more)}")


class Executor:
    """Calls a function with each of many items, through a `submit` like that of `concurrent.futures.Executor`.

    Args:
        submit: hands over one call and returns its future.
        tries: how often an item may fail. With one, the first error is raised at once; with more, the others are done
            first, and then Failed is raised.
        ahead: items that are handed over before the first has come back.
        remote: whether it may be done on other machines, which have none of the files of this one.
    """

    def __init__(self, submit: Submit, tries: int = 1, ahead: int = _AHEAD, remote: bool = False) -> None:
        self._submit, self._tries, self._ahead, self.remote = submit, tries, ahead, remote

    @classmethod
    def of(cls, other: concurrent.futures.Executor) -> "Executor":
        """Returns one that submits to another library's: of Dask, Ray, SLURM (submitit), MPI, or processes."""
        mine = identity()
        return cls(lambda function, item: other.submit(_checked, function, item, mine), TRIES, remote=True)

    def __call__(self, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        """Yields the results in the order of the items.

        Raises:
            ChildProcessError: if a process of this machine was killed.
            Failed: once all others are done, if items failed as often as they may; those behind them are not yielded.
            ConnectionError: if all workers are lost.
        """
        early: dict[int, Any] = {}
        place = 0
        for k, result in self.as_done(function, items):
            early[k] = result
            while place in early:
                yield early.pop(place)
                place += 1

    def as_done(self, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """Yields the number of an item and its result, each as soon as it is there.

        Raises:
            Failed: at the end, if items failed as often as they may.
            ConnectionError: if all workers are lost.
        """
        left = enumerate(items)
        running: dict[Future[Any], tuple[int, Any, int]] = {}
        ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        failures: list[tuple[Any, BaseException]] = []
        total = 0

        def start(k: int, item: Any, failed: int) -> None:
            future = self._submit(function, item)
            running[future] = k, item, failed
            future.add_done_callback(ended.put)

        try:
            while True:
                for k, item in itertools.islice(left, self._ahead - len(running)):
                    start(k, item, 0)
                    total += 1
                if not running:
                    break
                try:
                    future = ended.get(timeout=_LOOK)
                except queue.Empty:
                    self._look()
                    continue
                k, item, failed = running.pop(future)
                try:
                    result = future.result()
                except concurrent.futures.CancelledError:
                    self._look()
                    raise ConnectionError("those who do the work have let go of it") from None
                except BrokenProcessPool:
                    raise ChildProcessError(_KILLED) from None
                except Exception as error:
                    failed += 0 if self._elsewhere(error) else 1
                    if failed < self._tries:
                        start(k, item, failed)
                    elif self._tries == 1:
                        raise
                    else:
                        failures.append((item, error))
                    continue
                yield k, result
        finally:
            for future in running:
                future.cancel()
        if failures:
            raise Failed(failures, total, self._tries)

    def _look(self) -> None:
        """Raises ConnectionError if all workers are lost."""

    def _elsewhere(self, error: Exception) -> bool:
        """Returns whether an error is the worker's alone, so that the item goes to another and has not failed."""
        del error
        return False


def _at_once(function: Callable[[Any], Any], item: Any) -> "Future[Any]":
    future: Future[Any] = Future()
    future.set_result(function(item))
    return future


HERE = Executor(_at_once, ahead=1)  # one after the other in this process


def _checked(function: Callable[[Any], Any], item: Any, wanted: dict[str, str]) -> Any:
    """Returns what a function makes of an item; raises Refused where the installation is another than is wanted."""
    if other := differences(identity(), wanted):
        raise Refused(f"{socket.gethostname()} (process {os.getpid()})", other)
    return function(item)


@contextlib.contextmanager
def workers(count: int) -> Iterator[Executor]:
    """Yields an executor of `count` processes, or of this one when `count` is 1. They end with this one.

    Raises:
        ChildProcessError: if a process is killed from outside.
        ValueError: if this process may start no others, or a script would start anew in each.
    """
    if count == 1:
        yield HERE
        return
    if multiprocessing.current_process().daemon:
        raise ValueError(
            f"workers is {count}; within a worker of Dask or of a multiprocessing.Pool, which may start no processes, "
            "it must be 1"
        )
    if script := _unguarded():
        raise ValueError(
            f"workers is {count}, and each process runs {printable(script)} from its first line: put what that does "
            'under a line if __name__ == "__main__":'
        )
    # spawned, not forked: compiled code and figures hold threads, which a fork would cut off
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(os.getpid(),))

    def submit(function: Callable[[Any], Any], item: Any) -> "Future[Any]":
        try:
            with interrupts_held():  # this starts the processes
                return pool.submit(function, item)
        except BrokenProcessPool:
            raise ChildProcessError(_KILLED) from None

    try:
        yield Executor(submit)
    except BaseException:
        # what is under way may take a minute: nobody who interrupts wants to wait for it
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _unguarded() -> str:
    """Returns the script that runs, if it does all its work where a process imports it, as each that it starts does."""
    script = str(getattr(sys.modules["__main__"], "__file__", None) or "")
    if not script.endswith(".py") or os.path.basename(script) == "__main__.py":  # which no process imports
        return ""
    try:
        with open(script, encoding="utf-8", errors="replace") as file:
            return "" if "__main__" in file.read() else script
    except OSError:
        return ""


def _begin(parent: int) -> None:
    """Leaves Ctrl-C to the parent process, which then stops the pool, and its own end too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", FileNote)  # the parent has read the files, and said so
    warnings.showwarning = lambda message, *_, **__: say(str(message))
    end_with_parent(parent)


def _line_of(error: BaseException) -> str:
    """Returns an error in a line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


def say(line: str) -> None:
    """Prints a line on stderr."""
    print(printable(line), file=sys.stderr, flush=True)
