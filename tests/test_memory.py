"""Memory: a million robots within a stated size, and no growth however long they drive."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

ROW = 800  # bytes, of an episode where its tables are made, the columns and all that is made on the way: docs/scale.md
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


def test_tables_of_many_episodes_take_the_stated_size_a_row(tmp_path: Path) -> None:
    (grown,) = told(
        f"""
import pathlib, resource
from wayfield.benchmarks.results import read_rows, write_rows
from wayfield.benchmarks.standings import contest_tables
of_all = dict(
    contest="path-following", suite="path-following", robot="p3dx", split="test", disturbance="none",
    dynamics="kinematic", actuators="lagged", failure_cost="1.5", agent_seed="", knows="path", parameters="3",
    learned_from="", gains_name="tuned",
    collision="0", left_corridor="0", timeout="0", tier="easy", speed="", gains="", arrival_radius="",
)
shown = ("cross_track_rms", "mean_speed", "time", "settled_rms", "cross_track_max")
metrics = (*shown, *(f"metric_{{k}}" for k in range(15)))
rng = np.random.default_rng(0)
def rows(count):
    for k in range(count):
        family, episode = divmod(k // 2, count // 20)
        yield of_all | dict(
            policy=f"policy_{{k % 2}}", family=f"f{{family}}", scenario=f"f{{family}}/test", episode=str(episode),
            seed=str(episode), success=str(int(rng.random() < 0.9)),
        ) | {{name: repr(0.01 + 0.01 * float(value)) for name, value in zip(metrics, rng.random(20))}}
def tables(count):
    folder = pathlib.Path({str(tmp_path)!r})
    write_rows(folder, rows(count))
    assert contest_tables(read_rows(folder), [], "made up", False)["path_following_p3dx"].rows
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
tables(52_000)  # more than are resampled
small = resident()
print(tables(120_000) - small)
"""
    )
    assert grown < 120_000 * ROW
