"""What is written to disk: whole or not at all, by one process at a time, and known again by its digest."""

import contextlib
import ctypes
import errno
import hashlib
import json
import os
import shutil
import socket
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import filelock

_PREFIX = ".wayfield-"  # of everything temporary: .wayfield-HOST-PROCESS-RANDOM


def write_whole(file: Path, content: bytes | Iterable[bytes]) -> None:
    """Writes a file so that at any moment, a crash and a loss of power included, the old or the new content is there.

    What writers that are gone have left half-written beside it is deleted. Content may come piece by piece.

    Raises:
        OSError: if it cannot be written; what was there before still is.
    """
    clear_stale(file.parent)
    try:
        handle, name = tempfile.mkstemp(prefix=_own_prefix(), dir=file.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(file)) from None  # the user's name, not that of ours
    try:
        with open(handle, "wb") as stream:
            stream.writelines([content] if isinstance(content, bytes) else content)
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


def replace_folder(new: Path, old: Path) -> None:
    """Puts a folder in the place of another, which is deleted: at any moment the old or the new one is there, whole.

    Where the system cannot exchange two names at once, there is a moment without either: what is killed then leaves the
    old one beside its place, and `restore_folder` puts it back.

    Raises:
        OSError: if it cannot be done; the old one is there then.
    """
    if hasattr(os, "sync"):
        os.sync()  # the old one goes when the new one is on the disk
    if not _exchanged(new, old):
        aside = _aside(old)
        old.rename(aside)
        try:
            new.rename(old)
        except OSError:
            aside.rename(old)
            raise
        aside.rename(new)
    sync_folder(old.parent)
    shutil.rmtree(new, ignore_errors=True)


def restore_folder(folder: Path) -> None:
    """Puts back a folder that a killed `replace_folder` has left beside its place."""
    if not os.path.lexists(folder) and _aside(folder).is_dir():
        _aside(folder).rename(folder)


def _aside(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.before")


def _exchanged(one: Path, other: Path) -> bool:
    """Exchanges the names of two folders at once; returns whether the system and the file system can."""
    try:
        exchange = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):  # not Linux
        return False
    here, at_once = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of <fcntl.h> and <stdio.h>
    return bool(exchange(here, os.fsencode(one), here, os.fsencode(other), ctypes.c_uint(at_once)) == 0)


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

    Where the file system has no locks (Lustre mounted without `flock`, some of FUSE), the lock is a marker beside the
    file, `FILE.held`, that names host and process. It is taken over once that process of this machine is gone.

    Args:
        busy: what BlockingIOError says when another process holds it.

    Raises:
        BlockingIOError: at once, if another process holds the lock.
        FileExistsError: if the file is no lock: locks are empty, and what is opened as one is cut to nothing.
        OSError: if the file system has no locks, and the filelock that is installed is too old for markers.
    """
    if os.path.lexists(file) and (not stat.S_ISREG((there := os.lstat(file)).st_mode) or there.st_size):
        raise FileExistsError(f"{file} is not a lock of ours: move it away")
    lock: filelock.BaseFileLock
    if soft := not _has_locks(file):
        file = file.with_name(f"{file.name}.held")
        if not hasattr(filelock.SoftFileLock, "pid"):  # its markers would stay behind every process that is killed
            raise OSError(f"the file system of {file} has no locks (flock): pip install -U filelock, for markers")
        if _holder(file) is None:
            raise FileExistsError(f"{file} is not a marker of ours: move it away")
        lock = filelock.SoftFileLock(file)
    else:
        lock = filelock.FileLock(file)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise BlockingIOError(f"{busy}{(soft and _holder(file)) or ''}") from None
    try:
        yield
    finally:
        lock.release()


def _has_locks(file: Path) -> bool:
    """Returns whether the file system of a lock file, which is made if it is not there, has locks."""
    if os.name != "posix":  # others lock otherwise
        return True
    import fcntl

    handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    try:
        fcntl.flock(handle, fcntl.LOCK_UN)  # disturbs nobody
    except OSError as error:
        if error.errno in (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK):
            return False
        raise
    finally:
        os.close(handle)
    return True


def _holder(marker: Path) -> str | None:
    """Returns what there is to say of the process that left a marker; None of a file that is no marker."""
    try:
        if not stat.S_ISREG(os.lstat(marker).st_mode):
            return None
        with open(marker, "rb") as stream:
            process, _, rest = stream.read(1024).partition(b"\n")
    except FileNotFoundError:
        return ""
    host = rest.partition(b"\n")[0].decode(errors="replace")
    if not process.isdigit():
        return None if process else ""  # it is about to be written
    gone = f"if it is gone, delete {marker}: this file system has no locks"
    return f" (process {process.decode()} of {host}; {gone})"


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
