"""A worker process that does thousands of trials, and is started anew when one of them ends it."""

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from typing import Any

from wayfield.benchmarks.faults.place import Place, computed, end_marked

_CPU = 20.0  # s of computing without a sign of life after which a trial hangs; compiling is not counted
_WALL = 600.0  # s, on a busy machine
_MEMORY = 12 << 30  # bytes of addresses; libraries and compiled code take a third of it


class Server:
    """Sends trials to a worker, and says what went wrong: an ill outcome, a crash or no end."""

    def __init__(self, place: Place, **environment: str) -> None:
        self._place, self._environment = place, environment
        self._process: subprocess.Popen[bytes] | None = None
        self.steps = 0

    def ask(self, module: str, spec: dict[str, Any]) -> str | None:
        """Returns what is wrong with the outcome of a trial; None where nothing is."""
        process = self._process or self._started()
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps([module, spec]).encode() + b"\n")
            process.stdin.flush()
        answer = self._answer(process)
        if isinstance(answer, str):
            self.close()
            return answer
        self.steps += answer.get("steps", 0)
        problem = answer.get("problem")
        return None if problem is None else str(problem)

    def close(self) -> None:
        """Ends the worker."""
        process, self._process = self._process, None
        if process is not None:
            end_marked(f"server-{os.getpid()}-{id(self)}")
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):
                        stream.close()

    def _started(self) -> "subprocess.Popen[bytes]":
        mark = f"server-{os.getpid()}-{id(self)}"
        # Numba's cache does not tell code that checks bounds from code that does not
        compiled = str(self._place.out / "work" / "compiled_checked")
        environment = self._place.environment(
            mark, PYTHONFAULTHANDLER="1", NUMBA_CACHE_DIR=compiled, **self._environment
        )
        log = open(self._place.out / "work" / "worker.log", "ab")  # noqa: SIM115  the child keeps it
        with log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "wayfield.benchmarks.faults.worker", str(os.getpid()), str(_MEMORY)],
                cwd=self._place.scratch, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log,
            )  # fmt: skip
        return self._process

    def _answer(self, process: "subprocess.Popen[bytes]") -> dict[str, Any] | str:
        """Returns the worker's answer, or how it failed to give one."""
        assert process.stdout is not None
        buffer = b""
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            began, before = time.monotonic(), computed(process.pid)
            while True:
                if selector.select(timeout=0.5):
                    piece = os.read(process.stdout.fileno(), 1 << 16)
                    if not piece:
                        return _ended(process.wait())
                    buffer += piece
                    if buffer.strip(b".").endswith(b"\n"):
                        answer: dict[str, Any] = json.loads(buffer.strip(b".\n"))
                        return answer
                    began, before = time.monotonic(), computed(process.pid)  # a sign of life: it compiles
                spent = computed(process.pid) - before
                if spent > _CPU or time.monotonic() - began > _WALL:
                    return f"no end: {spent:.0f} s of computing"


def _ended(status: int) -> str:
    return f"crash: {signal.Signals(-status).name}" if status < 0 else f"crash: the process ended with status {status}"
