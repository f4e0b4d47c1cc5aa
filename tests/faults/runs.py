"""Short runs of the commands that take long: killed, together in one folder, over files of others, on full disks.

Each is run undisturbed first. A module of the campaign for each of the four groups would share most of its lines.
"""

import contextlib
import ctypes
import itertools
import os
import random
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from place import NotTried, changed, contents

_CONTEST = "--suite path-following --gains default --families straights,circles"
_TRAINING = """wayfield/DiffDrivePathFollowing-v0 --preset path_following_plain --steps 4096 --set num_envs=64
    --set horizon=8 --set batch_size=64 --set epochs=1 --set hidden=8 --set validations=2"""
_TUNING = "lqr --suite path-following --trials 2 --scenarios 1"
_WEIGHTS = "out/seed_{}/best/weights.safetensors"
LIMIT = 400.0  # s, that a run may take on a machine that must compile first
_PATIENCE = 30.0  # s, in which a signal must end a run: a training finishes its update


class Run(NamedTuple):
    """A command in a folder, which writes below `out`, and the files that must come out bit for bit."""

    command: str
    line: list[str]
    results: tuple[str, ...] = ()


def _run(command: str, line: str, *results: str, out: str = "out") -> Run:
    return Run(command, [*line.split(), "--out", out], results)


_ROWS = ("out/episodes.csv", "out/trajectories.npz")
RUNS = {
    "contest": _run("evaluate", f"{_CONTEST} --policies pure_pursuit --episodes 1 --workers 1", *_ROWS),
    "another contest": _run("evaluate", f"{_CONTEST} --policies stanley --episodes 1 --workers 1", *_ROWS),
    "training": _run("train", f"{_TRAINING} --seeds 1", _WEIGHTS.format(0)),
    "tuning": _run("tune", f"{_TUNING} --workers 1", "out/gains.json", out="out/gains.json"),
    "shared contest": _run("evaluate", f"{_CONTEST} --policies pure_pursuit,stanley --episodes 2 --workers 2", *_ROWS),
    "another shared contest": _run("evaluate", f"{_CONTEST} --policies smooth_pose --episodes 2 --workers 2", *_ROWS),
    "two trainings": _run("train", f"{_TRAINING} --seeds 2", _WEIGHTS.format(0), _WEIGHTS.format(1)),
    "shared tuning": _run("tune", f"{_TUNING} --workers 2", "out/gains.json", out="out/gains.json"),
    "path": _run("evaluate", "--path way.csv --policies pure_pursuit --dynamics kinematic --episodes 1 --workers 1"),
}
_ALONE = ("contest", "training", "tuning")  # in one process


def _reference(name: str, place: Any) -> tuple[dict[str, str], float]:
    """Returns what a run leaves undisturbed and the seconds that it takes; the first one compiles."""
    if name not in place.references:
        for _ in range(2):
            with _out(place) as folder:
                began = time.monotonic()
                ended = place.run(*RUNS[name][:2], folder, LIMIT)
                if ended.status != 0:
                    raise AssertionError(f"undisturbed it ends with status {ended.status}: {ended.err[-300:]}")
                place.references[name] = contents(folder), time.monotonic() - began
    return place.references[name]


@contextlib.contextmanager
def _out(place: Any) -> Iterator[Path]:
    with place.folder() as folder:
        (folder / "out").mkdir()
        yield folder


def _differs(name: str, folder: Path, wanted: dict[str, str]) -> str | None:
    """Returns how a folder differs from what the run leaves undisturbed; None where it does not."""
    found = contents(folder)
    for file in RUNS[name].results:
        if found.get(file) != wanted[file]:
            return f"{file} {'differs from' if file in found else 'is missing, unlike in'} the undisturbed run"
    odd = {each for each in set(found) ^ set(wanted) if "tensorboard" not in each}
    return f"leaves other files: {', '.join(sorted(odd)[:4])}" if odd else None


def _again(name: str, place: Any, folder: Path, wanted: dict[str, str]) -> str | None:
    """Runs until it is done; returns what is wrong with that or with the results."""
    more = _resumed(name, folder)
    ended = place.run(RUNS[name].command, [*RUNS[name].line, *more], folder, LIMIT)
    if more and "no run to resume" in ended.err:
        ended = place.run(*RUNS[name][:2], folder, LIMIT)
    if ended.status != 0:
        return f"run again it ends with status {ended.status}: {' '.join(ended.err.split())[-300:]}"
    return _differs(name, folder, wanted)


def _resumed(name: str, folder: Path) -> list[str]:
    there = any((folder / "out").glob("seed_*/run.json"))
    return ["--resume"] if there and RUNS[name].command == "train" else []


def _parts(place: Any, name: str, folder: Path) -> list[Path]:
    """Starts a contest and kills it when a part of it is finished; returns the rows of the parts."""
    running = place.start(*RUNS[name][:2], folder)
    until = time.monotonic() + LIMIT
    while time.monotonic() < until:
        found = [each for each in folder.glob("out/**/rows.json") if not each.parent.name.startswith(".")]
        if found:
            running.end()
            return found
        if running.ends_within(0.01):
            raise NotTried("the run was done before a part of it was seen")
    raise AssertionError(f"no part was done within {LIMIT:g} s")


class Kills:
    """SIGKILL, SIGTERM and SIGINT at any moment, and damaged parts; run again until they are done."""

    @staticmethod
    def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
        """Yields a kill in the middle of each run, damages of parts, then kills at random, without end."""
        for run, share in (("contest", 0.6), ("training", 0.7), ("tuning", 0.6)):
            yield {"run": run, "signal": "SIGKILL", "at": [share]}
        for damage in ("number", "truncate", "flip", "delete"):
            yield {"run": "contest", "damage": damage}
        for k in itertools.count():
            # processes below others take many times as long
            run = rng.choice(_ALONE if k % 10 else ("shared contest", "two trainings", "shared tuning"))
            moments = [round(rng.uniform(0.02, 1.05), 3) for _ in range(rng.choice((1, 1, 2)))]
            yield {"run": run, "signal": rng.choice(("SIGKILL", "SIGKILL", "SIGTERM", "SIGINT")), "at": moments}

    @staticmethod
    def attempt(spec: dict[str, Any], place: Any) -> str | None:
        """Returns what is wrong with the run's end, what it leaves running, or with its results in the end."""
        name = spec["run"]
        wanted, seconds = _reference(name, place)
        with _out(place) as folder:
            if "damage" in spec:
                _damage(_parts(place, name, folder)[0], spec["damage"])
                return _again(name, place, folder, wanted)
            for share in spec["at"]:
                running = place.start(RUNS[name].command, [*RUNS[name].line, *_resumed(name, folder)], folder)
                running.ends_within(share * seconds)
                running.process.send_signal(getattr(signal, spec["signal"]))
                if not running.ends_within(_PATIENCE):
                    return f"{spec['signal']} does not end it within {_PATIENCE:g} s"
                if running.stays():
                    return f"{spec['signal']} leaves processes behind"
                ended = running.wait(0.0)
                if "Traceback" in ended.err:
                    return f"traceback after {spec['signal']}: {ended.said[-1][:200]}"
                if RUNS[name].command == "tune" and (folder / "out" / "gains.json").exists():
                    return _differs(name, folder, wanted)  # done before it was killed; it refuses to do it again
            return _again(name, place, folder, wanted)


def _damage(rows: Path, kind: str) -> None:
    """Damages a finished part of a contest."""
    drawn = rows.with_name("trajectories.npz")
    if kind == "number":
        text = rows.read_text(encoding="utf-8")
        start = text.index('"success": "') + len('"success": "')
        rows.write_text(text[:start] + "0.25" + text[text.index('"', start) :], encoding="utf-8")
    elif kind == "truncate":
        drawn.write_bytes(drawn.read_bytes()[:100])
    elif kind == "flip":
        content = bytearray(rows.read_bytes())
        content[len(content) // 2] ^= 0x80
        rows.write_bytes(bytes(content))
    else:
        drawn.unlink()


class Together:
    """Runs at once, or one over another's parts, in one folder: results are right, nobody's parts are lost."""

    @staticmethod
    def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
        """Yields pairs that start together, a resumed pair, a run over another's parts; then pairs, without end."""
        pairs = [("contest", "contest"), ("contest", "another contest"), ("tuning", "tuning"), ("training", "training")]
        yield {"first": "contest", "second": "another contest", "parts": True}
        for first, second in pairs:
            yield {"first": first, "second": second, "delay": 0.0}
        yield {"first": "training", "second": "training", "delay": 0.0, "cut": 0.7}
        yield {"first": "shared contest", "second": "another shared contest", "delay": 0.0}
        while True:
            first, second = rng.choice(pairs)
            yield {"first": first, "second": second, "delay": round(rng.uniform(0.0, 1.0), 3)}

    @staticmethod
    def attempt(spec: dict[str, Any], place: Any) -> str | None:
        """Returns what is wrong with the ends of two runs or with what they leave."""
        names = spec["first"], spec["second"]
        known = {name: _reference(name, place) for name in names}
        with _out(place) as folder:
            if spec.get("parts"):
                parts = _parts(place, names[0], folder)
                fault = place.run(*RUNS[names[1]][:2], folder, LIMIT).fault((0, 1, 2))
                lost = [each for each in parts if not each.exists()]
                return fault or (f"{len(lost)} parts of the other run are lost" if lost else None)
            more: list[str] = []
            if "cut" in spec:
                running = place.start(*RUNS[names[0]][:2], folder)
                running.ends_within(spec["cut"] * known[names[0]][1])
                running.end()
                more = _resumed(names[0], folder)
            both = []
            for name in names:
                both.append(place.start(RUNS[name].command, [*RUNS[name].line, *more], folder))
                time.sleep(spec["delay"] * known[name][1] if len(both) == 1 else 0.0)
            ends = [running.wait(LIMIT) for running in both]
            fault = next(filter(None, (ended.fault((0, 1, 2)) for ended in ends)), None)
            if fault:
                return fault
            done = [name for name, ended in zip(names, ends, strict=True) if ended.status == 0]
            if not done:
                return f"neither ends well: {ends[0].err.strip()} / {ends[1].err.strip()}"
            if len(set(done)) == 2:
                return "two different runs end well in one folder: one's results are lost"
            return _differs(done[0], folder, known[done[0]][0])


_THEIRS = "somebody else's\n"
_NAMES = {
    "contest": (
        "unfinished/notes.txt", "unfinished/deep/er/notes.txt", "unfinished", "table.md", "episodes.csv",
        "trajectories.npz", "run.json", "manifest.json", "table.md/notes.txt", "notes.txt", ".wayfield-x/notes.txt",
        ".lock", "figures/notes.txt", "video/notes.txt",
    ),
    "path": ("table.md", "episodes.csv", "unfinished/notes.txt", "trajectories.npz", "run.json"),
    "training": (
        "seed_0/run.json", "seed_0/best/weights.safetensors", "seed_0/best", "seed_0/last.safetensors", "seed_0",
        "seed_0/curve.csv", "seed_0/.lock", "seed_0/notes.txt", "curves.png", "seed_0/tensorboard/notes.txt",
    ),
}  # fmt: skip


class Foreign:
    """Files of others under our names in --out: never changed, never deleted."""

    @staticmethod
    def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
        """Yields every name alone, the likeliest first, in an order of the seed's own; then two at a time."""
        listed = [("contest", "unfinished/notes.txt"), ("contest", "table.md"), ("path", "table.md")]
        others = [(run, name) for run, names in _NAMES.items() for name in names if (run, name) not in listed]
        rng.shuffle(others)
        for run, name in (*listed, *others):
            yield {"run": run, "names": [name]}
        while True:
            run = rng.choice(tuple(_NAMES))
            names = rng.sample(_NAMES[run], 2)
            if not any(f"{a}/".startswith(f"{b}/") for a in names for b in names if a is not b):
                yield {"run": run, "names": names, "content": rng.choice(("", "{}", _THEIRS))}

    @staticmethod
    def attempt(spec: dict[str, Any], place: Any) -> str | None:
        """Returns what became of somebody else's file."""
        with _out(place) as folder:
            (folder / "way.csv").write_text("x,y\n0,0\n1,0\n2,0.5\n", encoding="utf-8")
            for name in spec["names"]:
                file = folder / "out" / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(spec.get("content", _THEIRS), encoding="utf-8")
            before = contents(folder)
            ended = place.run(*RUNS[spec["run"]][:2], folder, LIMIT)
            harmed = changed(before, contents(folder))
            return f"somebody else's {harmed[0]}" if harmed else ended.fault((0, 1, 2))


class Disk:
    """Disks that are full or cannot be written: one line, and what was there stays."""

    @staticmethod
    def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
        """Yields caches and folders that are read-only, disks and files of several sizes; then others, without end."""
        for command in ("train", "evaluate"):
            yield {"run": command, "how": "no cache"}
        for run in _ALONE:
            yield {"run": run, "how": "read-only"}
        for size in (0, 4096, 20_000):
            for run in _ALONE:
                yield {"run": run, "how": "full", "size": size}
        for how, run in itertools.product(("limit",), ("training", "contest")):
            yield {"run": run, "how": how, "size": rng.choice((100, 3000, 10_000))}
        while True:
            size = int(10.0 ** rng.uniform(2.0, 6.0))
            yield {"run": rng.choice(_ALONE), "how": rng.choice(("full", "limit")), "size": size}

    @staticmethod
    def attempt(spec: dict[str, Any], place: Any) -> str | None:
        """Returns what is wrong with how a command meets such a disk."""
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(_out(place))
            if spec["how"] == "no cache":
                return _without_cache(spec["run"], place, folder)
            out, before = folder / "out", None
            if spec["how"] == "full":
                _mount(out, spec["size"], stack)
            _reference(spec["run"], place)  # so that the compiler has nothing left to write
            (out / "notes.txt").write_text("there before\n" if spec.get("size", 1) else "", encoding="utf-8")
            if spec["how"] == "read-only":
                stack.callback(out.chmod, 0o755)
                out.chmod(0o555)
                before = _without_override
            elif spec["how"] == "limit":
                before = _limited(spec["size"])
            there = contents(out)
            ended = place.run(*RUNS[spec["run"]][:2], folder, LIMIT, before=before)
            harmed = changed(there, contents(out))
            allowed = (1, 2) if spec["how"] == "read-only" else (0, 1, 2)  # a small run may fit
            return f"{harmed[0]}, which was there before" if harmed else ended.fault(allowed)


def _without_cache(command: str, place: Any, folder: Path) -> str | None:
    """Starts a command where neither home nor the package can be written, as in a system's package on a server."""
    closed = [folder, *(each for each in place.code.rglob("*") if each.is_dir()), place.code]
    for each in closed:
        each.chmod(0o555)
    try:
        environment = {"HOME": str(folder), "NUMBA_CACHE_DIR": "", "MPLCONFIGDIR": "/tmp"}
        return place.run(command, ["--help"], folder, LIMIT, before=_without_override, environment=environment).fault(
            (0,)
        )
    finally:
        for each in closed:
            each.chmod(0o755)


def _mount(folder: Path, size: int, stack: contextlib.ExitStack) -> None:
    """Puts a disk of that size (bytes) over a folder."""
    if shutil.which("mount") is None or os.geteuid() != 0:
        raise NotTried("only root may mount a small disk; the limit on files stands in for it")
    pages = max(1, size // 4096)
    line = ["mount", "-t", "tmpfs", "-o", f"nr_blocks={pages},nr_inodes=64", "wayfield-faults", str(folder)]
    mounted = subprocess.run(line, capture_output=True, check=False, text=True)
    if mounted.returncode:
        raise NotTried(f"a small disk cannot be mounted: {' '.join(mounted.stderr.split())}")
    stack.callback(subprocess.run, ["umount", "-l", str(folder)], capture_output=True, check=False)
    if not size:
        (folder / "full").write_bytes(bytes(4096 * pages))


def _without_override() -> None:
    """Takes from root, too, the right to write and read what nobody may."""
    library = ctypes.CDLL(None, use_errno=True)
    for capability in (1, 2):
        library.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


def _limited(size: int) -> Callable[[], None]:
    """Returns what limits the files of a new process to a size (bytes)."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
