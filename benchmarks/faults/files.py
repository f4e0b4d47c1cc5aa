"""Damaged files of every registered kind: read, or refused in one line that names the file; what is read is used."""

import base64
import importlib
import os
import pkgutil
import random
import resource
import shutil
import sys
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from wayfield import benchmarks, envs, policies
from wayfield.benchmarks.faults import mutations
from wayfield.benchmarks.faults.steps import BOUNDS as BOUNDS
from wayfield.envs.readers import READERS

_LISTED = (
    *(("goal scenario", key, raw) for key in ("start", "goal") for raw in ("[0, 0, 1e20]", "[0, 0, 1e300]")),
    ("goal scenario", "start_turn", "1e20"),
    ("goal scenario", "start_turn", "1e300"),
    ("path scenario", "start", "[0, 0, 1e20]"),
    ("path scenario", "start_turn", "1e300"),
    ("path scenario", "laps", "1" + "0" * 400),
    ("gains", "gains", "[" * 100_000 + "]" * 100_000),
    ("gains", "trials", "1" + "0" * 400),
    ("agent's card", "dt", "1e400"),
    ("agent's card", "features", "[" * 100_000 + "]" * 100_000),
    ("training run", "steps", "1" + "0" * 5000),
)
_GROWTH = 1 << 30  # bytes that reading and using a file of these sizes may take at most


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields what once went wrong, then a random mutation of each kind of file in turn, without end."""
    load_all()
    names = sorted(READERS)
    for name, key, raw in _LISTED:
        if name in names:
            yield {"reader": name, "key": key, "raw": raw}
    for name in names:
        bomb = ("bomb",) if READERS[name].file.endswith(("npz", "zip")) else ()
        for kind in ("missing", "folder", "whole", "truncate", *bomb):
            yield {"reader": name, "mutation": kind, "seed": rng.randrange(2**31)}
        for kind in ("ones", "tensors", "tensors") if READERS[name].file.endswith(".safetensors") else ():
            yield {"reader": name, "mutation": kind, "seed": rng.randrange(2**31)}
    while True:
        for name in names:
            yield {"reader": name, "mutation": "any", "seed": rng.randrange(2**31)}


def attempt(spec: dict[str, Any], place: Any, server: Any) -> str | None:
    """Returns what is wrong with the outcome of a trial."""
    load_all()
    sample = place.samples / READERS[spec["reader"]].name.replace(" ", "_").replace("'", "")
    if not sample.exists():
        problem = server.ask("files", {"sample": spec["reader"], "folder": str(sample)})
        if problem:
            shutil.rmtree(sample, ignore_errors=True)
            return f"no sample: {problem}"
    if "content" not in spec and spec.get("mutation") not in ("missing", "folder", "bomb"):
        content = _content(spec, sample / READERS[spec["reader"]].file)
        if len(content) < 200_000:  # so that a finding can be repeated whatever becomes of the mutations
            spec["content"] = base64.b64encode(zlib.compress(content)).decode()
    with place.folder() as folder:
        found: str | None = server.ask("files", spec | {"from": str(sample), "folder": str(folder)})
        return found


def load_all() -> None:
    """Imports every module of the package whose extra is installed, so that every reader is known."""
    for part in (envs, policies, benchmarks):
        for module in pkgutil.walk_packages(part.__path__, f"{part.__name__}."):
            if not module.name.startswith("wayfield.benchmarks.faults"):
                try:
                    importlib.import_module(module.name)
                except ModuleNotFoundError as error:
                    if (error.name or "").startswith("wayfield"):
                        raise


def _content(spec: Mapping[str, Any], good: Path) -> bytes:
    if "content" in spec:
        return zlib.decompress(base64.b64decode(spec["content"]))
    content = good.read_bytes()
    if "raw" in spec:
        return mutations.with_value(content, spec["key"], spec["raw"])
    rng = random.Random(spec["seed"])
    if spec["mutation"] == "any":
        return mutations.damaged(content, good.name, rng)
    return mutations.NAMED[spec["mutation"]](content, rng)


def inside(spec: dict[str, Any]) -> dict[str, Any]:
    """Returns what was wrong with reading a damaged file, in a worker."""
    load_all()
    folder = Path(spec["folder"])
    if "sample" in spec:
        folder.mkdir(parents=True)
        file = READERS[spec["sample"]].fill(folder)
        READERS[spec["sample"]].read(file)
        return {}
    reader = READERS[spec["reader"]]
    for each in Path(spec["from"]).rglob("*"):
        target = folder / each.relative_to(spec["from"])
        if each.is_dir():
            target.mkdir(exist_ok=True)
        elif target != folder / reader.file:
            target.parent.mkdir(exist_ok=True, parents=True)
            os.link(each, target)
    file = folder / reader.file
    if spec.get("mutation") == "folder":
        file.mkdir()
    elif spec.get("mutation") != "missing":
        file.write_bytes(_content(spec, Path(spec["from"]) / reader.file))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    _WATCH.begin()
    try:
        found = reader.read(file)
        _WATCH.end()
        _use(found, file)
    except (ValueError, OSError) as error:
        text = str(error)
        if "\n" in text or len(text) > 2000 or not (file.name in text or str(folder) in text):
            return {"problem": f"{type(error).__name__} is no line that names the file: {text[:300]!r}"}
    except BaseException as error:
        return {"problem": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
    finally:
        seen = _WATCH.end()
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) << 10
    if seen:
        return {"problem": f"reading did {seen[0]}"}
    if grown > _GROWTH:
        return {"problem": f"reading took {grown >> 20} MiB"}
    return {}


def _use(found: Any, file: Path) -> None:
    """Uses what a damaged file gave: what reads well may still break what works with it."""
    from wayfield.benchmarks.faults import use

    use.used(found, file)


class _Watch:
    """Notes, from the interpreter's audit events, what a trial executes or writes outside of the compiler's cache."""

    _EXECUTED = ("os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.fork", "socket.connect")
    _WRITTEN = ("os.remove", "os.rename", "os.rmdir", "shutil.rmtree")

    def __init__(self) -> None:
        self._seen: list[str] = []
        self._on = False
        self._hooked = False
        self._allowed = os.environ.get("NUMBA_CACHE_DIR", "/dev/null")

    def begin(self) -> None:
        self._seen, self._on = [], True
        if not self._hooked:
            self._hooked = True
            sys.addaudithook(self._note)

    def end(self) -> list[str]:
        self._on = False
        return self._seen

    def _note(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._on:
            return
        if event in self._EXECUTED:
            self._seen.append(f"{event} {arguments!r}"[:200])
        elif event == "open":
            path, mode, flags = arguments
            writes = (isinstance(mode, str) and set(mode) & set("wax+")) or (flags or 0) & (os.O_WRONLY | os.O_RDWR)
            if writes and not self._own(str(path)):
                self._seen.append(f"open {path} for writing")
        elif event in self._WRITTEN and not self._own(str(arguments[0])):
            self._seen.append(f"{event} {arguments[0]}")

    def _own(self, path: str) -> bool:
        """Returns whether Python or the compiler keeps its own there."""
        return path.startswith((self._allowed, "/dev/")) or ".pyc" in path


_WATCH = _Watch()
