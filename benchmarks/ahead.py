"""Work that is handed over before it is asked for, so that no process waits while there is some."""

import concurrent.futures
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any

from wayfield.envs.engines import HERE, Engine


def ahead(engine: Engine) -> Engine:
    """Returns an engine to which work can be handed over ahead; as it is, one that works at once, or elsewhere."""
    return engine if engine is HERE or engine.remote else Ahead(engine)


class Ahead(Engine):
    """The processes that an engine has on this machine; work can be handed over before somebody waits for it."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(self._begun_or_new, engine._tries, engine._ahead)
        self._engine = engine
        self._begun: dict[tuple[Any, str], Future[Any]] = {}

    def begin(self, function: Callable[[Any], Any], items: Iterable[Any]) -> None:
        """Hands items over, behind those before them; whoever asks for them later finds them begun."""
        for item in items:
            self._begun[function, repr(item)] = self._engine._submit(function, item)

    def settle(self) -> None:
        """Waits until all that was begun is done, well or not."""
        concurrent.futures.wait(self._begun.values())

    def _begun_or_new(self, function: Callable[[Any], Any], item: Any) -> "Future[Any]":
        begun = self._begun.pop((function, repr(item)), None) if self._begun else None
        return begun or self._engine._submit(function, item)
