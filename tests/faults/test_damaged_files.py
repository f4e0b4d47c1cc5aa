"""Damaged files of every registered kind are read, or refused in one line that names the file; none is executed."""

import importlib
import itertools
import pkgutil
import random
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from faults import mutations
from hypothesis import given
from hypothesis import strategies as st

from wayfield import benchmarks, bridges, envs, policies
from wayfield.envs.scenarios import TASKS, GoalScenario, PathScenario
from wayfield.system.readers import READERS, Reader

pytestmark = pytest.mark.filterwarnings("default")  # those of NumPy, of shapes beyond all numbers

ENVS = {PathScenario: "wayfield/DiffDrivePathFollowing-v0", GoalScenario: "wayfield/OmniGoalObstacles-v0"}
# the readers whose files a digest vouches for, and the keys below which it does
VOUCHED: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(
        ("agent's card", "path agent's card", "agent's weights", "rows of a part", "sources of a part"), ()
    ),
    **dict.fromkeys(("trajectories of a part", "digests of a part", "training state", "state before the last"), ()),
    **{"card of a submission": ("episodes",), "episodes of a submission": ()},
    "split": ("families", next(iter(TASKS["path_following"].families)), "test"),
}
EXECUTED = ("os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.fork", "socket.connect")
WRITTEN = ("os.remove", "os.rename", "os.rmdir", "shutil.rmtree")
_places = itertools.count()  # one of its own for each: some readers keep what they have read of a place
_seen: list[str] | None = None  # what is executed or deleted while a file is read, by the interpreter's audit events


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if _seen is not None and event in EXECUTED + WRITTEN:
        path = str(arguments[0]) if arguments else ""
        if ".pyc" not in path and ".nb" not in path:  # which Python and Numba keep
            _seen.append(f"{event} {path}")


sys.addaudithook(_note)


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """Returns the folder of a good file of every reader; several may share one."""
    for part in (envs, policies, benchmarks, bridges):
        for module in pkgutil.walk_packages(part.__path__, f"{part.__name__}."):
            if module.name == "wayfield.bridges.ros.nodes":
                continue  # alone needs rclpy
            try:
                importlib.import_module(module.name)
            except ModuleNotFoundError as missing:
                if str(missing.name).startswith("wayfield"):
                    raise
                pytest.skip(f'{module.name} needs {missing.name}: pip install -e ".[dev]"')
    filled: dict[int, Path] = {}
    for reader in READERS.values():
        if id(reader.sample) not in filled:
            filled[id(reader.sample)] = tmp_path_factory.mktemp("sample")
            reader.fill(filled[id(reader.sample)])
    folders = {name: filled[id(reader.sample)] for name, reader in READERS.items()}
    for name, reader in READERS.items():
        assert (folders[name] / reader.file).is_file(), name
        assert reader.read(folders[name] / reader.file) is not None, name
    yield folders
    for folder in filled.values():
        shutil.rmtree(folder)


def outcome(reader: Reader, sample: Path, content: bytes | None) -> Any:
    """Returns what a reader makes of its file with another content, or the one line in which it refuses it."""
    global _seen
    folder = sample.with_name(f"damaged{next(_places)}")
    shutil.copytree(sample, folder)
    file = folder / reader.file
    try:
        if content is None:
            file.unlink()
        else:
            file.write_bytes(content)
        _seen = []
        try:
            found = reader.read(file)
            if type(found) in ENVS:
                driven(ENVS[type(found)], file)
        except (ValueError, OSError) as error:
            found = str(error)
            assert "\n" not in found
            assert len(found) <= 2000
            assert file.name in found or str(folder) in found, found
        seen, _seen = _seen, None
        assert not seen
        return found
    finally:
        _seen = None
        shutil.rmtree(folder)


def driven(env_id: str, file: Path) -> None:
    """Takes some steps in a scenario that was read, with numbers that stay numbers."""
    env: Any = gymnasium.make(env_id, disable_env_checker=True, scenario=str(file))
    env.reset(seed=0)
    for _ in range(5):
        observation, reward, *_ = env.step(env.action_space.high)
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)


@given(st.data(), st.integers(0, 2**31 - 1))
def test_a_damaged_file_is_read_or_refused_in_a_line(samples: dict[str, Path], data: st.DataObject, seed: int) -> None:
    name = data.draw(st.sampled_from(sorted(samples)))
    reader, rng = READERS[name], random.Random(seed)
    good = (samples[name] / reader.file).read_bytes()
    missing = rng.random() < 0.05
    outcome(reader, samples[name], None if missing else mutations.damaged(good, reader.file, rng))


@given(st.sampled_from(sorted(VOUCHED)), st.integers(0, 2**31 - 1))
def test_another_content_under_the_same_digest_is_refused(samples: dict[str, Path], name: str, seed: int) -> None:
    good = (samples[name] / READERS[name].file).read_bytes()
    nudged = mutations.nudged(good, READERS[name].file, random.Random(seed), VOUCHED[name])
    assert isinstance(outcome(READERS[name], samples[name], nudged), str)
