"""Work that is handed over before it is asked for, so that no process waits while there is some."""

import concurrent.futures
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any

from wayfield.system.executors import HERE, Engine


def ahead(engine: Engine) -> Engine:
    """Returns an engine to which work can be handed over ahead; as it is, one that works at once, or elsewhere."""
    return engine if engine is HERE or engine.remote else Ahead(engine)


class Ahead(Engine):
    """The processes that an engine has on this machine; work can be handed over before somebody waits for it."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(self._begun_or_new, engine._tries, engine._ahead)
        self._engine = engine
        self._begun: dict[tuple[Any, str], Future[Any]] = {}
        self._all: dict[tuple[Any, str], Future[Any]] = {}

    def begin(self, function: Callable[[Any], Any], items: Iterable[Any]) -> None:
        """Hands items over, behind those before them; whoever asks for them later finds them begun."""
        for item in items:
            future = self._engine._submit(function, item)
            self._begun[function, repr(item)] = self._all[function, repr(item)] = future

    def settle(self) -> None:
        """Waits until all that was begun is done, well or not."""
        concurrent.futures.wait(self._begun.values())

    def ended(self, function: Callable[[Any], Any], items: Iterable[Any]) -> dict[int, Any]:
        """Returns what was made of those items, by their number, that were handed over ahead and have ended well."""
        futures = ((k, self._all.get((function, repr(item)))) for k, item in enumerate(items))
        done = ((k, each) for k, each in futures if each is not None and each.done() and not each.cancelled())
        return {k: each.result() for k, each in done if each.exception() is None}

    def _begun_or_new(self, function: Callable[[Any], Any], item: Any) -> "Future[Any]":
        begun = self._begun.pop((function, repr(item)), None) if self._begun else None
        return begun or self._engine._submit(function, item)
