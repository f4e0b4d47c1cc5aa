"""Disks that are full or cannot be written: one line, and what was there stays."""

import contextlib
import ctypes
import os
import random
import resource
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from wayfield.benchmarks.faults.place import changed, contents
from wayfield.benchmarks.faults.runs import FORKED, LIMIT, OUT, RUNS, reference

_CAPBSET_DROP = 24
_OVERRIDING = (1, 2)  # capabilities by which root writes and reads what nobody may


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields caches and folders that are read-only, disks and files of several sizes; then other sizes, without end."""
    for command in ("train", "evaluate"):
        yield {"run": command, "how": "no cache"}
    for run in ("contest", "one training", "tuning"):
        yield {"run": run, "how": "read-only"}
    for size in (0, 4096, 20_000):
        for run in ("one training", "contest", "tuning"):
            yield {"run": run, "how": "full", "size": size}
    for run in ("one training", "contest"):
        yield {"run": run, "how": "limit", "size": rng.choice((100, 3000, 10_000))}
    while True:
        how, run = rng.choice(("full", "limit")), rng.choice(tuple(FORKED.values()))
        yield {"run": run, "how": how, "size": int(10.0 ** rng.uniform(2.0, 6.0)), "forked": True}


def attempt(spec: dict[str, Any], place: Any, server: Any) -> str | None:
    """Returns what is wrong with how a command meets such a disk."""
    del server
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(place.folder())
        if spec["how"] == "no cache":
            return _without_cache(spec["run"], place, folder)
        found = reference(spec["run"], place)  # so that the compiler has nothing left to write
        if isinstance(found, str):
            return found
        out = folder / OUT
        out.mkdir()
        run = RUNS[spec["run"]]
        before: Callable[[], None] | None = None
        if spec["how"] == "full" and not _mounted(out, spec["size"], stack):
            return None  # only root may mount; the limit on files stands in for it
        (out / "notes.txt").write_text("there before\n" if spec.get("size", 1) else "", encoding="utf-8")
        if spec["how"] == "read-only":
            stack.callback(out.chmod, 0o755)
            out.chmod(0o555)
            before = _without_override
        elif spec["how"] == "limit":
            before = _limited(spec["size"])
        there = contents(out)
        ended = place.run(run.command, run.line, folder, LIMIT, before=before)
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
        ended = place.run(command, ["-h" if command == "evaluate" else "--help"], folder, LIMIT,
                          before=_without_override, environment=environment)  # fmt: skip
    finally:
        for each in closed:
            each.chmod(0o755)
    fault: str | None = ended.fault((0,))
    return fault


def _mounted(folder: Path, size: int, stack: contextlib.ExitStack) -> bool:
    """Returns whether a disk of that size (bytes) could be put over a folder."""
    pages = max(1, size // 4096)
    line = ["mount", "-t", "tmpfs", "-o", f"nr_blocks={pages},nr_inodes=64", "wayfield-faults", str(folder)]
    if os.geteuid() != 0 or subprocess.run(line, capture_output=True, check=False).returncode:
        return False
    stack.callback(subprocess.run, ["umount", "-l", str(folder)], capture_output=True, check=False)
    if not size:
        (folder / "full").write_bytes(bytes(4096 * pages))
    return True


def _without_override() -> None:
    """Takes from root, too, the right to write what is read-only."""
    library = ctypes.CDLL(None, use_errno=True)
    for each in _OVERRIDING:
        library.prctl(_CAPBSET_DROP, each, 0, 0, 0)


def _limited(size: int) -> Callable[[], None]:
    """Returns what limits the files of a new process to a size (bytes)."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
