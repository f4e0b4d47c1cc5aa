"""Kernels compiled with Numba's public options alone: the same bits as those compiled in parts."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

STEPS = """
import hashlib, sys
import gymnasium, numpy as np, wayfield
from wayfield.policies import Pilot, make

for name, law in zip(sys.argv[1::2], sys.argv[2::2]):
    digest = hashlib.sha256()
    envs = gymnasium.make_vec(f"wayfield/{name}-v0", 3, disturbance="moderate")
    pilot = Pilot(make(law), envs)
    observations, _ = envs.reset(seed=3)
    pilot.reset()
    for _ in range(12):
        observations, rewards, *_ = envs.step(pilot.act(observations))
        digest.update(observations.tobytes() + rewards.tobytes())
    print(name, digest.hexdigest())
"""
DRIVES = {"DiffDrivePathFollowing": "stanley", "OmniGoalObstacles": "polar", "DiffDriveDocking": "smooth_pose"}


def run(code: str, *words: str, plain: bool, cache: Path | None = None) -> "subprocess.CompletedProcess[str]":
    settings = os.environ | {"WAYFIELD_PLAIN_JIT": "1" if plain else "0"}
    settings |= {} if cache is None else {"NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(command, env=settings, capture_output=True, text=True, check=True)


@pytest.mark.slow
@pytest.mark.parametrize("task", DRIVES)
def test_the_plain_mode_gives_the_same_bits(task: str) -> None:
    plain, usual = (run(STEPS, task, DRIVES[task], plain=mode).stdout for mode in (True, False))
    assert plain.startswith(task)
    assert plain == usual


def test_the_plain_mode_keeps_what_it_compiled_and_uses_none_of_numbas_private_parts(tmp_path: Path) -> None:
    code = "import sys, math; from wayfield.system.elementary import sin_cos; print(sin_cos(0.5), "
    code += "sum(sin_cos.stats.cache_hits.values()), 'wayfield.system.numba_internals' in sys.modules)"
    said = [run(code, plain=plain, cache=tmp_path).stdout for plain in (True, True, False)]
    bits = said[0].rpartition(")")[0]
    assert said == [f"{bits}) {hits}\n" for hits in ("0 False", "1 False", "0 True")]


@pytest.mark.parametrize(
    ("before", "says"),
    [
        ("numba.__version__ = '0.99.0'", "is newer than those tested"),
        ("import numba.core.codegen as c; del c.JITCodeLibrary", "lacks what they rely on"),
    ],
)
def test_another_numba_is_used_in_the_plain_mode_with_one_warning(before: str, says: str, tmp_path: Path) -> None:
    code = f"import numba; {before}; from wayfield.system.elementary import sin_cos; print(len(sin_cos(0.5)))"
    found = run(code, plain=False, cache=tmp_path)
    assert found.stdout == "2\n"
    assert found.stderr.count("RuntimeWarning") == 1
    assert says in found.stderr


def test_without_a_compiler_one_line_says_what_to_unset() -> None:
    env = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    words = [sys.executable, "-c", "import wayfield.envs.batch"]
    refused = subprocess.run(words, env=env, capture_output=True, text=True, check=False)
    assert refused.stderr.splitlines()[-1].startswith("ImportError: NUMBA_DISABLE_JIT is set")
