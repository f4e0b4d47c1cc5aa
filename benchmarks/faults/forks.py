"""Commands as forks of a worker that has their modules loaded: what takes seconds to begin takes hundredths of one."""

import contextlib
import functools
import importlib
import io
import itertools
import os
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from wayfield.benchmarks.faults import life
from wayfield.benchmarks.faults.place import Ended, on_cores
from wayfield.envs.processes import end_with_parent

# each command's click object
MODULES = {
    "train": "wayfield.policies.training.command",
    **{name: f"wayfield.benchmarks.{name}"
       for name in ("evaluate", "decisions", "throughput", "tune", "fingerprints")},
}  # fmt: skip
_LATER = ("wayfield.policies.training.run",)  # what commands import only when they work
_WAIT = 0.005  # s


class Fork:
    """A command that was started in a fork of this process; used like `place.Running`."""

    def __init__(
        self, command: str, arguments: Sequence[str], folder: Path, before: Callable[[], None] | None = None
    ) -> None:
        main = importlib.import_module(MODULES[command]).main
        self._files = [folder.parent / f"{folder.name}-{time.monotonic_ns()}.{name}" for name in ("out", "err")]
        self._status: int | None = None
        parent = os.getpid()
        prepare = on_cores(1, before) if command == "train" else before
        self._process = os.fork()
        if not self._process:
            _become(main, [command, *arguments], folder, self._files, parent, prepare)

    def send(self, number: int) -> None:
        """Sends a signal to the command's first process alone."""
        if not self.ended():
            os.kill(self._process, number)

    def ended(self) -> bool:
        """Returns whether it has ended."""
        if self._status is None:
            done, code = os.waitpid(self._process, os.WNOHANG)
            if done:
                self._status = os.waitstatus_to_exitcode(code)
        return self._status is not None

    def ends_within(self, seconds: float) -> bool:
        """Returns whether it ends within so many seconds; returns when it does."""
        until = time.monotonic() + seconds
        while not self.ended():
            if time.monotonic() > until:
                return False
            life.signs += 1
            time.sleep(_WAIT)
        return True

    def left(self) -> list[str]:
        """Returns what is left running of a command that has ended."""
        until = time.monotonic() + 3.0
        while time.monotonic() < until:
            try:
                os.killpg(self._process, 0)
            except ProcessLookupError:
                return []
            time.sleep(_WAIT)
        return [f"the group of process {self._process}"]

    def wait(self, limit: float) -> Ended:
        """Returns how it ended; after the limit (s) all its processes are killed."""
        in_time = self.ends_within(limit)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process, signal.SIGKILL)
        self.ends_within(60.0)
        texts = [file.read_bytes().decode(errors="replace") if file.exists() else "" for file in self._files]
        for file in self._files:
            file.unlink(missing_ok=True)
        return Ended(self._status if in_time else None, *texts)


class Forks:
    """Starts commands as forks; stands in for `place.Place` in a worker."""

    def __init__(self) -> None:
        self.references: dict[str, tuple[dict[str, str], float]] = {}
        self._names = (f"fork-{os.getpid()}-{k}" for k in itertools.count())
        for name in (*MODULES.values(), *_LATER):
            importlib.import_module(name)

    def warm(self, command: str, arguments: Sequence[str], folder: Path) -> None:
        """Runs a command once, in this process where no threads are left of it: forks then have its machine code."""
        if command == "train":
            self.run(command, arguments, folder, 600.0)
            return
        words, here = sys.argv, Path.cwd()
        try:
            os.chdir(folder)
            sys.argv = [command, *arguments]
            with contextlib.suppress(SystemExit):
                importlib.import_module(MODULES[command]).main()
        finally:
            os.chdir(here)
            sys.argv = words

    @contextlib.contextmanager
    def folder(self) -> Iterator[Path]:
        """Yields an empty folder, which is deleted afterwards."""
        found = Path.cwd() / next(self._names)
        found.mkdir()
        try:
            yield found
        finally:
            shutil.rmtree(found, ignore_errors=True)

    def start(
        self, command: str, arguments: Sequence[str], folder: Path, *, before: Callable[[], None] | None = None
    ) -> Fork:
        """Starts a command in a folder."""
        return Fork(command, arguments, folder, before)

    def run(
        self,
        command: str,
        arguments: Sequence[str],
        folder: Path,
        limit: float = 60.0,
        *,
        before: Callable[[], None] | None = None,
    ) -> Ended:
        """Runs a command to its end, or for `limit` seconds."""
        return self.start(command, arguments, folder, before=before).wait(limit)


@functools.cache
def _forks() -> Forks:
    return Forks()


def inside(spec: dict[str, Any]) -> dict[str, Any]:
    """Returns what was wrong with a trial of a group, done with forks of this worker."""
    group = importlib.import_module(f"wayfield.benchmarks.faults.{spec['group']}")
    problem = group.attempt(spec["trial"], _forks(), None)
    return {} if problem is None else {"problem": problem}


def _become(
    main: Callable[[], object],
    words: list[str],
    folder: Path,
    files: Sequence[Path],
    parent: int,
    before: Callable[[], None] | None,
) -> None:
    """Turns a fork into the command; does not return."""
    status = 70
    try:
        os.setsid()
        end_with_parent(parent)
        for number, file in enumerate(files, 1):
            os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), number)
        os.chdir(folder)
        sys.stdout = io.TextIOWrapper(os.fdopen(1, "wb", closefd=False), encoding="utf-8", write_through=True)
        sys.stderr = io.TextIOWrapper(
            os.fdopen(2, "wb", closefd=False), encoding="utf-8", errors="backslashreplace", write_through=True
        )
        sys.argv = words
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if before is not None:
            before()
        main()  # ends by SystemExit
    except SystemExit as error:
        if isinstance(error.code, str):
            print(error.code, file=sys.stderr)
        status = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
        status = 1
    finally:
        sys.stdout.flush()
        os._exit(status)
