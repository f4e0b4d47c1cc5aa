"""The line on stderr of a process that compiles, and its absence."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

MANY = """
from wayfield.system.compiled import compiled
{quiet}

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

print(chain({length})(1.0), chain({length} + 1)(1.0))
"""


def stderr(tmp_path: Path, text: str) -> str:
    (tmp_path / "many.py").write_text(text)
    settings = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "many.py"]
    return subprocess.run(command, cwd=tmp_path, env=settings, capture_output=True, text=True, check=True).stderr


@pytest.mark.parametrize(
    ("length", "quiet", "lines"),
    [(14, "", 1), (14, "import gymnasium; gymnasium.logger.min_level = gymnasium.logger.ERROR", 0)],
    ids=["much", "quiet"],
)
def test_a_process_that_compiles_much_says_so_once(tmp_path: Path, length: int, quiet: str, lines: int) -> None:
    text = MANY.format(length=length, quiet=quiet)
    assert [stderr(tmp_path, text).count("first run: the kernels are compiled") for _ in range(2)] == [lines, 0]
