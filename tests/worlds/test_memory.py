"""Memory: a million robots within a stated size, and no growth however long they drive."""

import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

STATED_ROWS = 0.8e9  # bytes, of a million rows and what their tables make on the way: docs/scale.md
STATED = 2.5e9  # bytes, of a million path followers, observations and infos of a step among them: docs/scale.md

BEGIN = """
import os, gymnasium, numpy as np, wayfield
def resident():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
def made(count):
    return gymnasium.make_vec("wayfield/DiffDrivePathFollowing-v0", count, vectorization_mode="vector_entry_point")
"""


def told(code: str) -> list[float]:
    """Returns the numbers that a fresh process prints."""
    done = subprocess.run([sys.executable, "-c", BEGIN + code], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


def test_a_million_path_followers_take_the_stated_size() -> None:
    (grown,) = told(
        "small = made(10); small.reset(seed=0); before = resident()\n"
        "envs = made(1_000_000); envs.reset(seed=0)\n"
        "for _ in range(3): found = envs.step(np.zeros(envs.action_space.shape, np.float32))\n"
        "print(resident() - before)"
    )
    assert 1e9 < grown < STATED


def test_ten_million_steps_leave_the_memory_as_it_was() -> None:
    after = told(
        "envs = made(1000); envs.reset(seed=0); envs.action_space.seed(0); actions = envs.action_space.sample()\n"
        "for k in range(10_000):\n"
        "    envs.step(actions)\n"
        "    if k % 1000 == 999: print(resident())"
    )
    assert max(after) - after[0] < 2e6


def test_the_tables_of_a_million_rows_take_the_stated_size() -> None:
    """The rows of few episodes again and again, each in a scenario of its own and with numbers of its own."""
    (grown,) = told(
        "import re\n"
        "from wayfield.benchmarks import compare\n"
        "from wayfield.benchmarks.records.episode import Episodes\n"
        "from wayfield.benchmarks.leaderboards.leaderboard import contest_tables\n"
        # not that of getrusage, which a process takes over from the one that it was forked from
        "def peak():\n"
        "    return 1024 * int(re.search(r'VmHWM:\\s*(\\d+)', open('/proc/self/status').read())[1])\n"
        "laws = ['pure_pursuit', 'stanley', 'lqr', 'regulated_pure_pursuit']\n"
        "some = [dict(row) for row in compare(laws, 'path-following', ['circles', 'splines'], 2).episodes]\n"
        "rng = np.random.default_rng(0)\n"
        "def row(k):\n"
        "    found = dict(some[k % len(some)])\n"
        "    of_its_own = 2 * (k // len(some)) + found['episode']\n"
        "    for name, cell in found.items():\n"
        "        if isinstance(cell, float) and cell % 1.0:\n"
        "            found[name] = cell * (1.0 + 1e-3 * rng.standard_normal())\n"
        "    return found | {'seed': of_its_own, 'scenario': f'{found[\"scenario\"]}_{of_its_own}'}\n"
        "before = peak()\n"
        "rows = Episodes(row(k) for k in range(1_000_000))\n"
        "contest_tables(rows, [], 'a test', ladder=False)\n"
        "print(peak() - before)"
    )
    assert 0.1e9 < grown < STATED_ROWS
