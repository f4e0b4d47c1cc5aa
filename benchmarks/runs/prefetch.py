"""Prefetching: work is submitted before its results are needed, so that no process is idle."""

import concurrent.futures
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any

from wayfield.system.executors import HERE, Executor


def prefetching(executor: Executor) -> Executor:
    """Returns an executor that prefetches; the same one, if it works in this process or on other machines."""
    return executor if executor is HERE or executor.remote else Prefetch(executor)


class Prefetch(Executor):
    """An executor of local processes that also takes work whose results are needed later."""

    def __init__(self, executor: Executor) -> None:
        super().__init__(self._begun_or_new, executor._tries, executor._ahead)
        self._executor = executor
        self._begun: dict[tuple[Any, str], Future[Any]] = {}
        self._all: dict[tuple[Any, str], Future[Any]] = {}

    def begin(self, function: Callable[[Any], Any], items: Iterable[Any]) -> None:
        """Submits items behind those submitted before; a later call for their results finds them begun."""
        for item in items:
            future = self._executor._submit(function, item)
            self._begun[function, repr(item)] = self._all[function, repr(item)] = future

    def settle(self) -> None:
        """Waits until all items that were begun have ended, with a result or an error."""
        concurrent.futures.wait(self._begun.values())

    def ended(self, function: Callable[[Any], Any], items: Iterable[Any]) -> dict[int, Any]:
        """Returns the results, by item number, of the prefetched items that have ended without an error."""
        futures = ((k, self._all.get((function, repr(item)))) for k, item in enumerate(items))
        done = ((k, each) for k, each in futures if each is not None and each.done() and not each.cancelled())
        return {k: each.result() for k, each in done if each.exception() is None}

    def _begun_or_new(self, function: Callable[[Any], Any], item: Any) -> "Future[Any]":
        begun = self._begun.pop((function, repr(item)), None) if self._begun else None
        return begun or self._executor._submit(function, item)
