"""The folder of a run: which files a run may write there, and how they get there atomically.

A finished run leaves `run.json` beside its files: what was run, by which code, and the SHA-256 of each file. A later
run of the same suite may replace those files, and no others: a file of one of our names that is not listed there, or
that has been edited since, is foreign.
"""

import contextlib
import dataclasses
import fnmatch
import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from wayfield.benchmarks.records.results import EPISODES, SWEEP, TABLE, TRAJECTORIES
from wayfield.system.identity import source_digest
from wayfield.system.readers import of_folder, reader
from wayfield.system.storage import clear_stale, locked, sync_folder, temporary_folder, write_whole, writers

MANIFEST = "run.json"
LOCK = ".lock"
REPORT = "report.html"
DRIVES, WORLDS = "drives.npz", "worlds.json"  # what the report replays, and where
UNFINISHED = "unfinished"  # folder of the parts of a run that was interrupted

_NAMED = ("episodes", "scale", "seed")  # whose values alone say nothing in a folder's name
_LONGEST_NAME = 120
_SAMPLE = '{"suite": "path", "command": "evaluate", "code": "0a", "files": {"table.md": "1b"}, "replaced": {}}'


@dataclasses.dataclass(frozen=True)
class Run:
    """What is run, and the names of what it writes."""

    suite: str
    command: str  # that does the same again
    names: tuple[str, ...] = ()  # patterns of the files beside those that every run writes


@reader("manifest of a run", MANIFEST, {MANIFEST: _SAMPLE}, of_folder)
def read_manifest(folder: Path) -> dict[str, Any]:
    """Returns the manifest of a finished run.

    Raises:
        ValueError: if it is no JSON object; the message names the file.
        OSError: if it cannot be opened.
    """
    file = folder / MANIFEST
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{file} is no JSON: {error}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{file} must hold a JSON object")
    return content


def default_folder(suite: str, differing: Mapping[str, Any]) -> Path:
    """Returns the default folder of a run: the suite, and all options that differ from the defaults.

    Args:
        differing: what is not as by default, by its name; what is None, 0 or empty is.
    """
    words = [suite]
    for name, value in differing.items():
        if value:
            text = "+".join(map(str, value)) if isinstance(value, tuple) else str(value)
            words.append(f"{name}_{text}" if name in _NAMED else text)
    name = re.sub(r"[^\w.+-]", "_", "-".join(words))
    if len(name) > _LONGEST_NAME:
        name = f"{name[:_LONGEST_NAME]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
    return Path("results") / name


@contextlib.contextmanager
def held(out: Path, run: Run) -> Iterator[None]:
    """Makes a folder and keeps other runs from it while the block runs; if that fails and leaves nothing, so does this.

    Raises:
        BlockingIOError: at once, if another run works there.
        FileExistsError: at once, if there is a file that another has made and this run may write; the message names it.
        OSError: at once, if nothing can be written there.
    """
    refuse_foreign(out, run)
    made = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        with locked(out / LOCK, _busy(out)):
            clear_stale(out)
            refuse_foreign(out, run)  # once more: until now another could have finished
            yield
    except BaseException:
        with contextlib.suppress(OSError):
            if made and os.listdir(out) == [LOCK]:
                (out / LOCK).unlink()
            for folder in made:
                folder.rmdir()
        raise


@contextlib.contextmanager
def staging(out: Path, run: Run) -> Iterator[Path]:
    """Yields an empty folder inside of `out`, which is held; what lies in it at the end is moved into `out`.

    With it comes a new manifest; files of the run before that this one does not make are deleted. On an error or an
    interruption `out` is as it was.

    Raises:
        FileExistsError: at the end, if a file that another has made has come in the way; the message names it.
        OSError: if something cannot be written; the message names where it would have been.
    """
    stage = temporary_folder(out)
    try:
        yield stage
        _publish(stage, out, run)
    except OSError as error:
        if isinstance(error.filename, str) and Path(error.filename).is_relative_to(stage):
            error.filename = str(out / Path(error.filename).relative_to(stage))
        raise
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def refuse_foreign(out: Path, run: Run) -> None:
    """Raises OSError, naming the culprit, unless `out` can be a folder and all in it that the run may write is ours."""
    above = next(folder for folder in (out, *out.parents) if folder.exists())
    if not above.is_dir():
        raise NotADirectoryError(f"{above} is a file, not a folder")
    if above != out:
        return
    known = _known_files(out, run)
    present = [PurePosixPath(file.relative_to(out)) for file in (*out.glob("*"), *out.glob("video/*"))]
    patterns = (EPISODES, SWEEP, TRAJECTORIES, TABLE, REPORT, DRIVES, WORLDS, *run.names)
    _refuse(out, (str(name) for name in present if any(fnmatch.fnmatch(str(name), each) for each in patterns)), known)


def _refuse(out: Path, names: Iterable[str], known: Mapping[str, set[str]]) -> None:
    """Raises OSError for the first of the names in `out` that is there and not one of the known files."""
    for name in names:
        file = out / name
        if file.is_dir():
            raise IsADirectoryError(f"{file} is a folder, not a file")
        if not os.path.lexists(file):
            continue
        if name not in known:
            raise FileExistsError(f"{file} is not from a run of ours: move it away, or give another --out")
        if file_digest(file) not in known[name]:
            raise FileExistsError(f"{file} was changed since its run: move it away, or give another --out")


@reader("run of a folder", MANIFEST, {MANIFEST: _SAMPLE}, lambda read, file: read(file.parent, Run("path", "evaluate")))
def _known_files(out: Path, run: Run) -> dict[str, set[str]]:
    """Returns the files that runs of this suite have left in a folder, each with the SHA-256s that it may have."""
    file = out / MANIFEST
    if not os.path.lexists(file):
        return {}
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        suite, command = content["suite"], content["command"]
        known: dict[str, set[str]] = {}
        for listed in (content["files"], content["replaced"]):
            for name, sha256 in listed.items():
                if (
                    not isinstance(sha256, str)
                    or PurePosixPath(name).is_absolute()
                    or ".." in PurePosixPath(name).parts
                ):
                    raise ValueError(name)
                known.setdefault(name, set()).add(sha256)
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError):
        raise FileExistsError(f"{file} is not from a run of ours: move it away, or give another --out") from None
    if suite != run.suite:
        raise FileExistsError(f"{out} holds the results of another run, `{command}`: give another --out")
    return known


def _publish(stage: Path, out: Path, run: Run) -> None:
    """Moves the files of a finished run into its folder, with the manifest that lists them.

    While they move, the manifest lists both the old files and the new: a crash leaves no file unlisted.
    """
    staged = {file.relative_to(stage).as_posix(): file for file in sorted(stage.rglob("*")) if file.is_file()}
    known = _known_files(out, run)
    _refuse(out, staged, known)
    for file in staged.values():
        with open(file, "rb+") as stream:
            os.fsync(stream.fileno())
    manifest = {
        "suite": run.suite,
        "command": run.command,
        "code": source_digest(),
        "files": {name: file_digest(file) for name, file in staged.items()},
        "replaced": {name: sha256 for name in known if (sha256 := _present(out / name)) in known[name]},
    }
    _write_json(out / MANIFEST, manifest)
    for name, file in staged.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(file, out / name)
    for name in known.keys() - staged.keys():
        if _present(out / name) in known[name]:
            (out / name).unlink()
    for folder in {out, *((out / name).parent for name in staged)}:
        sync_folder(folder)
    _write_json(out / MANIFEST, manifest | {"replaced": {}})


def _write_json(file: Path, content: Mapping[str, Any]) -> None:
    write_whole(file, (json.dumps(content, indent=1) + "\n").encode())


def _busy(out: Path) -> str:
    """Returns the message for a second run."""
    others = ", ".join(map(str, writers(out)))
    return f"another run{others and f' (process {others})'} works in {out}: wait until it ends, or give another --out"


def _present(file: Path) -> str:
    """Returns the SHA-256 of a file; nothing where there is none."""
    return file_digest(file) if file.is_file() else ""


def file_digest(file: Path) -> str:
    """Returns the SHA-256 of a file."""
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
