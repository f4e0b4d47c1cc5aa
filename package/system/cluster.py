"""Work on many machines, shared out by a scheduler of Dask distributed. Needs the extra `cluster`.

A worker's installation is checked before it gets work, and again with each item, since others may join later: one whose
code, agents or libraries differ is named in a line and gets no work. What a lost worker had under way goes to others;
Dask gives up an item once it has taken four workers with it, and the executor tries that once more.
"""

import asyncio
import contextlib
import logging
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

from wayfield.system.executors import TRIES, Executor, Refused, say
from wayfield.system.identity import differences, identity
from wayfield.system.processes import interrupts_held

LOCAL = "local"  # in place of an address: a scheduler and workers that are started here and end with this process
_CONNECT = 10.0  # s
_ADDRESS = re.compile(r"((tcp|tls|ucx|ws|wss)://)?[^\s/]+:\d+/?")
_TALKATIVE = ("distributed", "tornado", "asyncio")  # loggers
_MUST_AGREE = ("distributed", "dask", "cloudpickle")  # what client and scheduler speak with each other


class NoScheduler(ConnectionError):
    """There is no scheduler to work with; the message goes on behind its address."""


@contextlib.contextmanager
def cluster(address: str, count: int) -> Iterator[Executor]:
    """Yields the executor of a scheduler, and says where its workers can be watched.

    Args:
        address: such as tcp://host:8786 or tls://host:8786, with the certificates of Dask's configuration; or "local".
        count: processes that "local" starts.

    Raises:
        NoScheduler: if none answers there, it is of another version, or it has workers and refuses all of them.
        ConnectionError: while it works, if the scheduler is lost.
    """
    distributed = _dask()
    for name in list(logging.root.manager.loggerDict):
        if name.split(".")[0] in _TALKATIVE:  # what concerns the user is a line
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    security = None  # that of Dask's configuration
    with contextlib.ExitStack() as stack:
        if address == LOCAL:
            security = _of_this_process()
            with interrupts_held():
                here = distributed.LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                    security=security,
                )
            stack.callback(_quietly, here.close)
            address = here.scheduler_address
        client = _client(address, security)
        stack.callback(_quietly, client.close)
        executor = _Cluster(client, address)
        workers = client.scheduler_info(n_workers=-1)["workers"]
        say(f"scheduler {address}, {len(workers)} workers; watch them at {client.dashboard_link}")
        executor.meet()
        yield executor


def _dask() -> Any:
    """Returns Dask distributed, which is loaded only where it is used."""
    import distributed

    return distributed


def _quietly(close: Callable[[], Any]) -> None:
    """Lets go of what may be gone already."""
    with contextlib.suppress(Exception):
        close()


def _of_this_process() -> Any:
    """Returns credentials that nobody else on this machine has: whoever reaches a worker can run code on it."""
    try:
        return _dask().Security.temporary()
    except ImportError:
        raise NoScheduler('needs cryptography: pip install -c constraints.txt ".[cluster]"') from None


def _client(address: str, security: Any) -> Any:
    """Returns the client of a scheduler; NoScheduler if there is none that it can work with."""
    if not _ADDRESS.fullmatch(address):
        raise NoScheduler("is no address; it must be like tcp://host:8786 or tls://host:8786, or local")
    try:
        scheduler = asyncio.run(_versions_at(address, security))
    except Exception as error:  # whatever answers there, of whatever version
        why = " ".join(str(error).split()) or type(error).__name__
        raise NoScheduler(f"is no scheduler that can be reached within {_CONNECT:g} s: {why[:300]}") from None
    theirs, ours = (
        {**each["packages"], "python": _minor(each["host"]["python"])}
        for each in (scheduler, _dask().versions.get_versions())
    )
    if other := differences(theirs, {name: str(ours[name]) for name in ("python", *_MUST_AGREE)}):
        raise NoScheduler(f"is a scheduler of another version: {other}")
    return _dask().Client(address, timeout=_CONNECT, set_as_default=False, security=security)


async def _versions_at(address: str, security: Any) -> Any:
    """Returns what a scheduler says of its versions, before anything else is made of it."""
    distributed = _dask()
    security = security or distributed.Security()
    speaking = distributed.rpc(address, connection_args=security.get_connection_args("client"), timeout=_CONNECT)
    try:
        return await asyncio.wait_for(speaking.versions(packages=[]), _CONNECT)
    finally:
        await speaking.close_rpc()


def _minor(version: str) -> str:
    return ".".join(version.split(".")[:2])


def _presented() -> dict[str, str]:
    return identity()


class _Cluster(Executor):
    """An executor whose items go to the workers of a scheduler, but for those that are refused."""

    def __init__(self, client: Any, address: str) -> None:
        super().__init__(self._handed_over, TRIES, remote=True)
        self._client, self._address = client, address
        self._mine = identity()
        self._refused: set[str] = set()  # addresses
        self._alone = False  # whether it has been said that there are no workers
        self._executor: Any = _dask().cfexecutor.ClientExecutor(client, pure=False)

    def meet(self) -> None:
        """Checks the installations of all workers; NoScheduler if all must be refused."""
        workers: dict[str, Any] = self._client.run(_presented, on_error="return")
        for worker, who in workers.items():
            other = differences(who, self._mine) if isinstance(who, dict) else " ".join(str(who).split())[:300]
            if other:
                self._refuse(worker, other)
        if workers and not set(workers) - self._refused:
            raise NoScheduler("has no worker that can take part: each one is refused")

    def _refuse(self, worker: str, why: str) -> None:
        if worker not in self._refused:
            self._refused.add(worker)
            name = self._workers().get(worker, {}).get("name", "")
            say(str(Refused(f"{name} {worker}".strip() if str(name) != worker else worker, why)))

    def _workers(self) -> dict[str, Any]:
        return dict(self._client.scheduler_info(n_workers=-1)["workers"])

    def _handed_over(self, function: Callable[[Any], Any], item: Any) -> "Future[Any]":
        if self._client.status != "running":
            raise ConnectionError(f"the scheduler {self._address} is lost")
        more: dict[str, Any] = {}
        if self._refused and (taken := set(self._workers()) - self._refused):
            more = {"workers": sorted(taken), "allow_other_workers": True}  # where none of them is left
        future: Future[Any] = self._executor.submit(_worked, function, item, self._mine, **more)
        return future

    def _look(self) -> None:
        if self._client.status != "running":
            raise ConnectionError(f"the scheduler {self._address} is lost")
        there = set(self._workers()) - self._refused
        if not there and not self._alone:
            say(f"no workers are left at {self._address}; the run goes on once there are some")
        self._alone = not there

    def _elsewhere(self, error: Exception) -> bool:
        if not isinstance(error, Refused):
            return False
        self._refuse(error.worker, error.why)
        if not set(self._workers()) - self._refused:
            raise ConnectionError(f"no worker at {self._address} can take part: each one is refused")
        return True


def _worked(function: Callable[[Any], Any], item: Any, wanted: dict[str, str]) -> Any:
    """Returns what a function makes of an item; raises Refused where the worker's installation is another."""
    if other := differences(identity(), wanted):
        raise Refused(_dask().get_worker().address, other)
    return function(item)
