"""Where the campaign works: a copy of the package, commands that run on it, and what they leave behind."""

import contextlib
import dataclasses
import hashlib
import importlib
import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

import wayfield
from wayfield import benchmarks, envs, policies
from wayfield.command import COMMANDS as INSTALLED
from wayfield.envs.processes import end_with_parent

_PROGRESS = re.compile(r"\d+ of \d+ |first run: ")  # how lines about progress begin, which may come before a refusal
_PATIENCE = 120.0  # s
_LONGEST = 1500  # characters of a line that says what is wrong
MARK = "WAYFIELD_FAULTS"  # environment variable by which the processes of a command are known
# where each command's click object is; a test knows whether one is forgotten
ENTRIES = {
    **{name: f"{each.module}:{each.function}" for name, each in INSTALLED.items()},
    "onnx": "wayfield.policies.learned.onnx:main",
    "freeze": "wayfield.envs.scenarios.freeze:main",
    **{name: f"wayfield.policies.training.{name}:main" for name in ("measured", "offline")},
    "simulator": "wayfield.envs.coppelia.__main__:main",
    "report": "wayfield.benchmarks.report.__main__:main",
    **{name: f"wayfield.benchmarks.report.{name}:main" for name in ("demo", "speed", "wasm")},
    "faults": "wayfield.benchmarks.faults.__main__:main",
    **{
        name: f"wayfield.benchmarks.{name}:main"
        for name in (
            "audit", "cluster_cost", "coppelia", "coppelia_latency", "coverage", "decisions", "fingerprints",
            "learners", "pictures", "publish", "record", "robot_page", "throughput", "transfer", "tune_all",
        )
    },
}  # fmt: skip
_ROOT = ("evaluate.py", "train.py")  # the repository's scripts
# what installers make of the entry point
_SCRIPT = "import sys\nfrom wayfield.command import main\nif __name__ == '__main__':\n    sys.exit(main())\n"


def found(command: str) -> click.Command:
    """Returns a command's click object."""
    module, _, function = ENTRIES[command].partition(":")
    entry: click.Command = getattr(importlib.import_module(module), function)
    return entry


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
            return f"traceback: {_short(lines[-1])}"
        if self.status is None:
            return None if 0 in allowed else "not refused: it was still running"
        if self.status not in allowed:
            return f"status {self.status}, not {' or '.join(map(str, allowed))}: {_short(self.err or self.out)}"
        if self.status in (1, 2) and (len(lines) != 1 or len(lines[0]) > _LONGEST):
            return f"{len(lines)} lines on stderr, of {len(self.err)} characters, not a short one: {_short(self.err)}"
        return None


class Place:
    """The folders of a campaign. Leave with `close`: it ends every process that was started."""

    def __init__(self, out: Path) -> None:
        self.out = out.resolve()
        self.code = self.out / "work" / "code"
        self.samples = self.out / "work" / "samples"
        self.scratch = self.out / "work" / "scratch"
        self._marks = (f"{os.getpid()}-{k}" for k in itertools.count())
        self._used: list[str] = []
        self.references: dict[str, tuple[dict[str, str], float]] = {}  # what `runs.reference` found
        shutil.rmtree(self.scratch, ignore_errors=True)
        for folder in (self.code, self.samples, self.scratch):
            folder.mkdir(parents=True, exist_ok=True)
        self.restore()

    def restore(self) -> None:
        """Makes the copy of the package equal to the package again."""
        for part, module in (("", wayfield), ("envs", envs), ("policies", policies), ("benchmarks", benchmarks)):
            source = Path(module.__path__[0])
            _mirror(source, self.code / "wayfield" / part, keep=("envs", "policies", "benchmarks") if not part else ())

    @contextlib.contextmanager
    def folder(self) -> Iterator[Path]:
        """Yields an empty folder, which is deleted afterwards."""
        found = self.scratch / next(self._marks)
        found.mkdir()
        try:
            yield found
        finally:
            shutil.rmtree(found, ignore_errors=True)

    def environment(self, mark: str = "", **changes: str) -> dict[str, str]:
        """Returns the environment variables of a process that runs on the copy."""
        kept = {name: os.environ[name] for name in ("PATH", "LANG", "LD_LIBRARY_PATH") if name in os.environ}
        home = self.out / "work" / "home"
        home.mkdir(exist_ok=True)
        return {
            **kept,
            "HOME": str(home),
            "MPLCONFIGDIR": str(home),
            "MINARI_DATASETS_PATH": str(home / "minari"),
            "PYTHONPATH": str(self.code),
            "NUMBA_CACHE_DIR": str(self.out / "work" / "compiled"),
            "OMP_NUM_THREADS": "1",
            "OMP_WAIT_POLICY": "PASSIVE",
            MARK: mark,
            **changes,
        }

    def start(
        self,
        command: str,
        arguments: Sequence[str],
        folder: Path,
        *,
        before: Callable[[], None] | None = None,
        output: str = "",
        environment: Mapping[str, str] | None = None,
    ) -> "Running":
        """Starts a command in a folder; its output goes to files beside that folder.

        Args:
            output: "closed" or "pipe", one whose reader has gone, takes the place of standard output.
        """
        driver = self._driver(command)
        mark = next(self._marks)
        self._used.append(mark)
        return Running(
            [sys.executable, *driver, *arguments],
            mark,
            folder,
            self.environment(mark, **(environment or {})),
            self.scratch,
            on_cores(2, before) if command == "train" else before,
            output,
        )

    def _driver(self, command: str) -> list[str]:
        """Returns what Python runs: the repository's script, the installed command, or a module."""
        own = Path(wayfield.__path__[0]).parent / command
        if command in _ROOT and own.is_file():
            return [str(own)]
        name = command.removesuffix(".py")
        if name not in INSTALLED:
            return ["-m", ENTRIES[name].partition(":")[0]]
        script = self.out / "work" / "scripts" / "wayfield"
        script.parent.mkdir(parents=True, exist_ok=True)
        script.write_text(_SCRIPT, encoding="utf-8")
        return [str(script), name]

    def warm(self, command: str, arguments: Sequence[str], folder: Path) -> None:
        """Runs a command once, so that its machine code is kept."""
        self.run(command, arguments, folder, 600.0)

    def run(self, command: str, arguments: Sequence[str], folder: Path, limit: float = 60.0, **kwargs: Any) -> Ended:
        """Runs a command to its end, or for `limit` seconds."""
        running = self.start(command, arguments, folder, **kwargs)
        return running.wait(limit)

    def close(self) -> None:
        """Ends whatever was started, and clears what it left."""
        for mark in self._used:
            end_marked(mark)
        shutil.rmtree(self.scratch, ignore_errors=True)


class Running:
    """A command that was started."""

    def __init__(
        self,
        line: Sequence[str],
        mark: str,
        folder: Path,
        environment: Mapping[str, str],
        scratch: Path,
        before: Callable[[], None] | None,
        output: str,
    ) -> None:
        parent = os.getpid()

        def prepare() -> None:
            end_with_parent(parent)
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs ignore it, and so would this
            if before is not None:
                before()

        self.mark = mark
        self._files = [scratch / f"{mark}.out", scratch / f"{mark}.err"]
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

    def send(self, number: int) -> None:
        """Sends a signal to the command's first process alone."""
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(number)

    def computed(self, seconds: float) -> None:
        """Waits until it has computed for so long: on a busy machine a moment of the clock may be none of its own."""
        until = time.monotonic() + _PATIENCE
        while computed(self.process.pid) < seconds and time.monotonic() < until and self.process.poll() is None:
            time.sleep(0.01)

    def ended(self) -> bool:
        """Returns whether its first process has ended."""
        return self.process.poll() is not None

    def ends_within(self, seconds: float) -> bool:
        """Returns whether its first process ends within so many seconds; returns when it does."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)
        return self.ended()

    def left(self) -> list[str]:
        """Returns the command lines of its processes that are still there some seconds after the first has ended."""
        return left_running(self.mark)

    def wait(self, limit: float) -> Ended:
        """Returns how it ended; after the limit (s) all its processes are killed."""
        try:
            status: int | None = self.process.wait(limit)
        except subprocess.TimeoutExpired:
            status = None
        if status is None:
            with contextlib.suppress(ProcessLookupError):  # its session, those too that are just beginning a program
                os.killpg(self.process.pid, signal.SIGKILL)
            end_marked(self.mark)
            self.process.wait()
        out, err = (file.read_text(encoding="utf-8", errors="replace") for file in self._files)
        return Ended(status, out, err)


def on_cores(count: int, before: Callable[[], None] | None = None) -> Callable[[], None]:
    """Returns what keeps a new process to some cores: many threads of a small network mostly wait for one another."""

    def prepare() -> None:
        if hasattr(os, "sched_setaffinity"):
            cores = sorted(os.sched_getaffinity(0))
            first = os.getpid() % len(cores)
            os.sched_setaffinity(0, (cores + cores)[first : first + count])
        if before is not None:
            before()

    return prepare


def computed(process: int) -> float:
    """Returns the seconds that a process has computed."""
    with contextlib.suppress(OSError), open(f"/proc/{process}/stat", encoding="utf-8") as stream:
        words = stream.read().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def left_running(mark: str, patience: float = 3.0) -> list[str]:
    """Returns the command lines of the processes of a mark that are still there after some seconds."""
    until = time.monotonic() + patience
    while (found := list(_marked(mark))) and time.monotonic() < until:
        time.sleep(0.1)
    lines = []
    for process in found:
        with contextlib.suppress(OSError):
            lines.append(Path(f"/proc/{process}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return lines


def end_marked(mark: str) -> None:
    """Kills all processes of a mark.

    One that is just beginning a program has no environment for a moment, in which it is not seen: none are left where
    none were seen twice.
    """
    unseen = 0
    while unseen < 2:
        found = list(_marked(mark))
        unseen = 0 if found else unseen + 1
        for process in found:
            with contextlib.suppress(OSError):
                os.kill(process, signal.SIGKILL)
        time.sleep(0.02)


def _marked(mark: str) -> Iterator[int]:
    wanted = f"{MARK}={mark}".encode()
    for entry in os.listdir("/proc"):
        if not entry.isdigit() or int(entry) == os.getpid():
            continue
        with contextlib.suppress(OSError):
            state = Path(f"/proc/{entry}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            if state[0] != "Z" and wanted in Path(f"/proc/{entry}/environ").read_bytes().split(b"\0"):
                yield int(entry)


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


def _mirror(source: Path, target: Path, keep: Sequence[str] = ()) -> None:
    target.mkdir(parents=True, exist_ok=True)
    names = {each.name for each in source.iterdir() if each.name != "__pycache__"} - set(keep)
    for left in target.iterdir():
        if left.name not in names | {"__pycache__", *keep}:
            shutil.rmtree(left) if left.is_dir() else left.unlink()
    for name in names:
        if (source / name).is_dir():
            _mirror(source / name, target / name)
            continue
        old = (target / name).stat() if (target / name).exists() else None
        new = (source / name).stat()
        if old is None or (old.st_mtime_ns, old.st_size) != (new.st_mtime_ns, new.st_size):
            shutil.copy2(source / name, target / name)


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) < 300 else f"{line[:140]} ... {line[-140:]}"
