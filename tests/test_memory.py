"""Memory: a million robots within a stated size, and no growth however long they drive."""

import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

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
