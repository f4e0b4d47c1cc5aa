"""Ctrl-C of the overview: what is done is shown, and the same command goes on there."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wayfield.benchmarks.records.run_folder import file_digest, read_manifest

OVERVIEW = [sys.executable, "-m", "wayfield.command", "evaluate", "--workers", "2"]
LONGEST = 900.0  # s, for a machine that compiles everything


def begun(folder: Path) -> subprocess.Popen[str]:
    """Returns a run of the overview that works in a folder."""
    return subprocess.Popen(OVERVIEW, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals differ")
def test_an_interrupted_overview_shows_what_is_done_and_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "results" / "overview"
    with begun(tmp_path) as run:
        until = time.monotonic() + LONGEST
        while len(list(folder.glob("contests/unfinished/*/part.json"))) < 3 and time.monotonic() < until:
            assert run.poll() is None, run.communicate()
            time.sleep(0.05)
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=60)
    assert run.returncode == 130, err
    # both tables hold lines of what has been driven
    assert "So far:" in out
    assert "kinematic" in out[out.index("So far:") :]  # of the documents
    assert "for a reliable comparison run" in out
    last = err.splitlines()[-1]
    assert last.startswith("evaluate: interrupted; ") or last.startswith("wayfield evaluate: interrupted; ")
    assert last.endswith("the same command goes on there")
    assert " left" in err
    assert "Traceback" not in err
    # parts alone are left, whole
    parts = {part.parent for part in folder.glob("contests/unfinished/*/part.json")}
    assert len(parts) >= 3
    for part in parts:
        digests = json.loads((part / "part.json").read_text())
        assert {name: file_digest(part / name) for name in digests} == digests
    left = {each.name for each in folder.rglob("*") if each.is_file() and each.parent not in parts}
    assert left <= {".lock", ".parts"}

    with begun(tmp_path) as again:
        out, err = again.communicate(timeout=LONGEST)
    assert again.returncode == 0, err
    assert f"{len(parts)} of " in next(line for line in err.splitlines() if "are there from before" in line)
    for place in (folder, folder / "contests", folder / "documents"):
        files = read_manifest(place)["files"]
        assert {name: file_digest(place / name) for name in files} == files
    assert not list(folder.rglob("unfinished"))
