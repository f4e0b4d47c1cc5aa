"""The line on stderr of a process that compiles, and its absence."""

import os
import subprocess
import sys
from pathlib import Path

MANY = """
from wayfield.system.compiled import compiled

def chain(length):
    @compiled
    def last(x):
        return x + 1.0
    kernels = [last]
    for _ in range(length):
        kernels.append(linked(kernels[-1]))
    return kernels[-1]

def linked(inner):
    @compiled
    def link(x):
        return inner(x) + 1.0
    return link

print(chain(14)(1.0), chain(15)(1.0))
"""


def stderr(tmp_path: Path, text: str) -> str:
    (tmp_path / "many.py").write_text(text)
    settings = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "many.py"]
    return subprocess.run(command, cwd=tmp_path, env=settings, capture_output=True, text=True, check=True).stderr


def test_a_process_that_compiles_much_says_so_once(tmp_path: Path) -> None:
    assert [stderr(tmp_path, MANY).count("first run: the kernels are compiled") for _ in range(2)] == [1, 0]
