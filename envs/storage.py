"""What is written to disk: whole or not at all, by one process at a time, and known again by its digest."""

import contextlib
import hashlib
import json
import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import filelock

_PREFIX = ".wayfield-"  # of everything temporary: .wayfield-HOST-PROCESS-RANDOM


def write_whole(file: Path, content: bytes) -> None:
    """Writes a file so that at any moment, a crash and a loss of power included, the old or the new content is there.

    What writers that are gone have left half-written beside it is deleted.

    Raises:
        OSError: if it cannot be written; what was there before still is.
    """
    clear_stale(file.parent)
    handle, name = tempfile.mkstemp(prefix=_own_prefix(), dir=file.parent)
    try:
        with open(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, 0o666 & ~_umask())  # mkstemp's files are for their owner alone
        os.replace(name, file)
        sync_folder(file.parent)
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name)


def temporary_folder(above: Path) -> Path:
    """Returns a new folder in `above`, which `clear_stale` deletes once this process is gone."""
    return Path(tempfile.mkdtemp(prefix=_own_prefix(), dir=above))


def sync_folder(folder: Path) -> None:
    """Makes sure that renamed files keep their new names through a loss of power."""
    if os.name != "posix":  # folders cannot be opened elsewhere
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def clear_stale(folder: Path) -> None:
    """Deletes what processes of this machine that are gone have left half-written in a folder."""
    for left, process in _temporary(folder):
        if _alive(process):
            continue
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def writers(folder: Path) -> list[int]:
    """Returns the processes of this machine that write in a folder: those alive with something temporary there."""
    return sorted({process for _, process in _temporary(folder) if _alive(process)})


def _temporary(folder: Path) -> Iterator[tuple[Path, int]]:
    """Yields what processes of this machine have written for a while, each with its process."""
    prefix = f"{_PREFIX}{_host()}-"
    for left in folder.glob(f"{prefix}*"):
        process = left.name.removeprefix(prefix).split("-")[0]
        if process.isdigit():
            yield left, int(process)


@contextlib.contextmanager
def locked(file: Path, busy: str) -> Iterator[None]:
    """Holds a lock file while the block runs; the system lets it go when the process ends, however it ends.

    Args:
        busy: what BlockingIOError says when another process holds it.

    Raises:
        BlockingIOError: at once, if another process holds the lock.
        FileExistsError: if the file is no lock: locks are empty, and what is opened as one is cut to nothing.
    """
    if os.path.lexists(file) and (not stat.S_ISREG((there := os.lstat(file)).st_mode) or there.st_size):
        raise FileExistsError(f"{file} is not a lock of ours: move it away")
    lock = filelock.FileLock(file)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise BlockingIOError(busy) from None
    try:
        yield
    finally:
        lock.release()


def digest(content: Mapping[str, Any]) -> str:
    """Returns the SHA-256 of a JSON object, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _own_prefix() -> str:
    return f"{_PREFIX}{_host()}-{os.getpid()}-"


def _host() -> str:
    """Returns this machine's name as a part of a file's name; process numbers mean something on one machine alone."""
    return "".join(c if c.isalnum() else "_" for c in socket.gethostname())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _alive(process: int) -> bool:
    if os.name != "posix":
        return True  # a signal 0 would end the process there: rather leave a file than take it from its writer
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    try:
        state = Path(f"/proc/{process}/stat").read_bytes().rpartition(b")")[2].split()[:1]
    except OSError:  # not Linux, or it has just gone
        return True
    return state not in ([b"Z"], [b"X"])  # dead, but its new parent has not looked yet
