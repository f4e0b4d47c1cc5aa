"""One process at a time works in a folder, on file systems without locks too."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

# Lustre without the mount option `flock`, and others, answer so to every call
WITHOUT = """
import errno, fcntl, sys
def flock(*arguments):
    raise OSError(getattr(errno, sys.argv[2]), "no locks here")
fcntl.flock = flock
"""
HOLD = """
import sys, pathlib
from wayfield.system.storage import locked
try:
    with locked(pathlib.Path(sys.argv[1]), "another works here"):
        print("held", flush=True)
        sys.stdin.readline()
except OSError as error:
    print(type(error).__name__, error, flush=True)
"""
pytestmark = pytest.mark.skipif(os.name != "posix", reason="flock is POSIX")


def holder(file: Path, code: str) -> subprocess.Popen[str]:
    """Returns a process that holds a lock until its input ends, or has said why not."""
    return subprocess.Popen(
        [sys.executable, "-c", WITHOUT + HOLD, file, code], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )


def line(process: subprocess.Popen[str]) -> str:
    """Returns the first line that a process prints."""
    assert process.stdout is not None
    return process.stdout.readline()


@pytest.mark.parametrize("code", ["ENOSYS"])
def test_without_locks_a_marker_keeps_a_second_process_out_until_the_first_is_gone(code: str, tmp_path: Path) -> None:
    file = tmp_path / ".lock"
    file.touch()  # of an earlier run
    first = holder(file, code)
    assert line(first) == "held\n"
    second = holder(file, code)
    told, _ = second.communicate("\n")
    assert told.startswith("BlockingIOError another works here")
    assert f"process {first.pid} " in told
    first.send_signal(signal.SIGKILL)
    first.communicate()
    third = holder(file, code)
    assert line(third) == "held\n"
    third.communicate("\n")
    assert [each.name for each in tmp_path.iterdir()] == [".lock"]


def test_a_file_of_somebody_s_in_the_place_of_the_marker_stays(tmp_path: Path) -> None:
    notes = tmp_path / ".lock.held"
    notes.write_text("notes")
    told, _ = holder(tmp_path / ".lock", "ENOSYS").communicate("\n")
    assert told.startswith(f"FileExistsError {notes} is not a marker")
    assert notes.read_text() == "notes"
