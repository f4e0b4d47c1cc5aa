"""Where the campaign works: a copy of the package, commands that run on it, and a process for what may crash."""

import contextlib
import dataclasses
import functools
import hashlib
import importlib
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

import wayfield
from wayfield import benchmarks, envs, policies
from wayfield.command import COMMANDS as INSTALLED
from wayfield.system.processes import end_with_parent

_PROGRESS = re.compile(r"\d+ of \d+ |first run: ")  # how lines about progress begin, which may come before a refusal
_LONGEST = 1500  # characters of a line that says what is wrong
_WALL = 600.0  # s, for one trial of the inside, on a busy machine
_ROOT = ("evaluate.py", "train.py")  # the repository's scripts
_PARTS = (("", wayfield), ("envs", envs), ("policies", policies), ("benchmarks", benchmarks))

# as an installation's script is: known by its name while modules load, and safe to import in spawned workers
_LAUNCHER = """import sys
sys.path[0] = {code!r}
from wayfield.command import main
if __name__ == "__main__":
    sys.exit(main())
"""


class NotTried(Exception):
    """A trial cannot be done here; the message says why."""


@functools.cache
def entries() -> dict[str, tuple[str, str]]:
    """Returns module and function of every command: those of `wayfield`, and of each module that can be started."""
    found = {name: (each.module, each.function) for name, each in INSTALLED.items() if name != "ros"}
    found |= {f"ros.{name}": (INSTALLED["ros"].module, name) for name in ("sim", "drive", "excite")}
    for part, module in _PARTS[1:]:
        root = Path(module.__path__[0])
        for file in sorted(root.rglob("*.py")):
            name = ".".join((f"wayfield.{part}", *file.relative_to(root).with_suffix("").parts))
            text = file.read_text(encoding="utf-8")
            if (
                '\nif __name__ == "__main__":' in text
                and "OneLineErrors" in text
                and (name, "main") not in found.values()
            ):
                short_name = name.removesuffix(".__main__").rpartition(".")[2]
                found[f"{part}.{short_name}" if short_name in found else short_name] = name, "main"
    return found


@functools.cache
def entry(command: str) -> click.Command:
    """Returns the click object of a command; ModuleNotFoundError if its extra is not installed."""
    module, function = entries()[command]
    found: click.Command = getattr(importlib.import_module(module), function)
    return found


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int | None  # None: it was still running when the time was over
    out: str
    err: str

    @property
    def said(self) -> list[str]:
        """Returns the lines on stderr that are not about progress."""
        return [line for line in self.err.strip().splitlines() if not _PROGRESS.match(line)]

    def fault(self, allowed: Sequence[int]) -> str | None:
        """Returns what is wrong with the end; None where nothing is.

        Args:
            allowed: exit statuses; where they are refusals, exactly one line must say why.
        """
        lines = self.said
        if "Traceback (most recent call last)" in self.err:
            return f"traceback: {short(lines[-1])}"
        if self.status is None:
            return None if 0 in allowed else "not refused: it was still running"
        if self.status not in allowed:
            return f"status {self.status}, not {' or '.join(map(str, allowed))}: {short(self.err or self.out)}"
        if self.status in (1, 2) and (len(lines) != 1 or len(lines[0]) > _LONGEST):
            return f"{len(lines)} lines on stderr, of {len(self.err)} characters, not a short one: {short(self.err)}"
        return None


class Place:
    """The folders of a campaign. Leave with `close`: it ends every process that was started."""

    def __init__(self, out: Path) -> None:
        work = out.resolve() / "work"
        self.code, self.samples, self.scratch = work / "code", work / "samples", work / "scratch"
        self.home = work / "home"
        self._names = (f"{k}" for k in itertools.count())
        self._running: list[Running] = []
        self.references: dict[str, Any] = {}  # what undisturbed runs left, by their names
        self.inside = Inside(self)
        for folder in (self.scratch, self.samples):  # samples of another version may be of another format
            shutil.rmtree(folder, ignore_errors=True)
        for folder in (self.code, self.samples, self.scratch, self.home):
            folder.mkdir(parents=True, exist_ok=True)
        self.restore()

    def restore(self) -> None:
        """Makes the copy of the package equal to the package again."""
        shutil.rmtree(self.code)
        for part, module in _PARTS:
            shutil.copytree(module.__path__[0], self.code / "wayfield" / part, dirs_exist_ok=True,
                            ignore=shutil.ignore_patterns("__pycache__"))  # fmt: skip
        (self.code / "bin").mkdir()
        (self.code / "bin" / "wayfield").write_text(_LAUNCHER.format(code=str(self.code)))

    @contextlib.contextmanager
    def folder(self) -> Iterator[Path]:
        """Yields an empty folder, which is deleted afterwards."""
        found = self.scratch / next(self._names)
        found.mkdir()
        try:
            yield found
        finally:
            shutil.rmtree(found, ignore_errors=True)

    def environment(self, **changes: str) -> dict[str, str]:
        """Returns the environment variables of a process that runs on the copy."""
        kept = {name: os.environ[name] for name in ("PATH", "LANG", "LD_LIBRARY_PATH") if name in os.environ}
        home = {name: str(self.home) for name in ("HOME", "MPLCONFIGDIR", "MINARI_DATASETS_PATH")}
        compiled = {"NUMBA_CACHE_DIR": str(self.home / "compiled"), "PYTHONPATH": str(self.code)}
        return {**kept, **home, **compiled, "OMP_NUM_THREADS": "1", "OMP_WAIT_POLICY": "PASSIVE", **changes}

    def start(self, command: str, arguments: Sequence[str], folder: Path, *, before: Callable[[], None] | None = None,
              output: str = "", environment: Mapping[str, str] | None = None) -> "Running":  # fmt: skip
        """Starts a command in a folder; its output goes to files beside that folder.

        Args:
            output: "closed" or "pipe", one whose reader has gone, takes the place of standard output.
        """
        script = Path(__file__).parents[2] / command
        if command in _ROOT and script.is_file():
            line = [str(script)]
        elif (name := command.removesuffix(".py")) in INSTALLED:
            line = [str(self.code / "bin" / "wayfield"), name]
        else:
            line = ["-m", entries()[name][0]]
        found = Running(
            [sys.executable, *line, *arguments], self.environment(**(environment or {})), folder, before, output
        )
        self._running.append(found)
        return found

    def run(self, command: str, arguments: Sequence[str], folder: Path, limit: float = 60.0, **kwargs: Any) -> Ended:
        """Runs a command to its end, or for `limit` seconds."""
        return self.start(command, arguments, folder, **kwargs).wait(limit)

    def close(self) -> None:
        """Ends whatever was started, and clears what it left."""
        self.inside.close()
        for running in self._running:
            running.end()
        shutil.rmtree(self.scratch, ignore_errors=True)


class Running:
    """A command that was started, in a session of its own."""

    def __init__(self, line: Sequence[str], environment: Mapping[str, str], folder: Path,
                 before: Callable[[], None] | None, output: str) -> None:  # fmt: skip
        parent = os.getpid()

        def prepare() -> None:
            end_with_parent(parent)
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs ignore it, and so would this
            if before is not None:
                before()

        self._files = [folder.parent / f"{folder.name}-{time.monotonic_ns()}.{name}" for name in ("out", "err")]
        with open(self._files[0], "wb") as out, open(self._files[1], "wb") as err:
            shown: Any = out
            if output == "closed":
                line = ["/bin/sh", "-c", 'exec "$@" >&-', "sh", *line]
            elif output == "pipe":
                reader, shown = os.pipe()
                os.close(reader)
            self.process = subprocess.Popen(
                line, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=shown, stderr=err,
                start_new_session=True, preexec_fn=prepare,
            )  # fmt: skip
            if output == "pipe":
                os.close(shown)

    def computes(self, seconds: float) -> None:
        """Waits until it has computed for so long: on a busy machine a moment of the clock may be none of its own."""
        until = time.monotonic() + 120.0
        while time.monotonic() < until and self.process.poll() is None:
            words = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
            if (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK") >= seconds:
                return
            time.sleep(0.01)

    def ends_within(self, seconds: float) -> bool:
        """Returns whether its first process ends within so many seconds; returns when it does."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)
        return self.process.poll() is not None

    def stays(self) -> bool:
        """Returns whether processes of its session are still there some seconds after its first has ended."""
        until = time.monotonic() + 3.0
        while time.monotonic() < until:
            try:
                os.killpg(self.process.pid, 0)
            except ProcessLookupError:
                return False
            time.sleep(0.05)
        return True

    def end(self) -> None:
        """Kills all processes of its session."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def wait(self, limit: float) -> Ended:
        """Returns how it ended; after the limit (s) all its processes are killed."""
        in_time = self.ends_within(limit)
        if not in_time:
            self.end()
        out, err = (file.read_text(encoding="utf-8", errors="replace") for file in self._files)
        return Ended(self.process.returncode if in_time else None, out, err)


class Inside:
    """A process that does thousands of trials, and is started anew when one of them ends it."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._process: subprocess.Popen[str] | None = None
        self.steps = 0

    def ask(self, group: str, spec: Mapping[str, Any]) -> str | None:
        """Returns what is wrong with the outcome of a trial: an ill outcome, a crash or no end; None if nothing is."""
        process = self._process = self._process or self._started()
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps([group, spec]) + "\n")
            process.stdin.flush()
        timer = threading.Timer(_WALL, process.kill)
        timer.daemon = True
        timer.start()
        try:
            line = process.stdout.readline()
        finally:
            timer.cancel()
        if line:
            answer = json.loads(line)
            self.steps += answer.get("steps", 0)
            return answer.get("problem")
        status = process.wait()
        self.close()
        if status in (-signal.SIGPROF, -signal.SIGKILL):
            return f"no end, by {signal.Signals(-status).name}"
        return f"crash: {signal.Signals(-status).name if status < 0 else f'the process ended with status {status}'}"

    def close(self) -> None:
        """Ends the process and what it has started."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.communicate()
            self._process = None

    def _started(self) -> "subprocess.Popen[str]":
        # Numba's cache does not tell code that checks bounds from code that does not
        environment = self._place.environment(
            NUMBA_BOUNDSCHECK="1", NUMBA_CACHE_DIR=str(self._place.home / "checked"), PYTHONFAULTHANDLER="1"
        )
        with open(self._place.home / "inside.log", "ab") as log:
            return subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("inside.py"))], cwd=self._place.scratch, env=environment,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True,
                preexec_fn=functools.partial(end_with_parent, os.getpid()),
            )  # fmt: skip


def contents(folder: Path) -> dict[str, str]:
    """Returns the SHA-256 of every file below a folder by its name, "" for a folder; but for compiled code."""
    return {
        str(each.relative_to(folder)): hashlib.sha256(each.read_bytes()).hexdigest() if each.is_file() else ""
        for each in sorted(folder.rglob("*"))
        if "__pycache__" not in each.parts
    }


def changed(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Returns what was there before and is gone or another now."""
    return [f"{name} {'changed' if name in after else 'deleted'}" for name in before if after.get(name) != before[name]]


def short(text: str) -> str:
    """Returns a text as one line, without its middle where it is long."""
    line = " ".join(text.split())
    return line if len(line) < 300 else f"{line[:140]} ... {line[-140:]}"
