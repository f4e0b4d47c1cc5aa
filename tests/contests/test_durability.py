"""What is written outlasts a loss of power: files are synced before they take a place, and folders after."""

import itertools
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wayfield.benchmarks.records.run_folder import MANIFEST, Run, held, staging
from wayfield.policies.learned.agent import CARD, WEIGHTS, load_agent, save_agent
from wayfield.policies.trained.ppo import shipped
from wayfield.policies.training.checkpoints import CURVE, LAST, PREVIOUS, last_state, write_curve, write_state


class Disk:
    """Notes what is synced and what is moved, file by file and folder by folder, by inode."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.synced: set[int] = set()
        self.moved: list[tuple[Path, bool]] = []
        self.late: set[Path] = set()  # folders in which something was moved since they were synced
        sync, replace = os.fsync, os.replace

        def fsync(handle: int) -> None:
            sync(handle)
            self.synced.add(os.fstat(handle).st_ino)
            self.late = {folder for folder in self.late if folder.stat().st_ino != os.fstat(handle).st_ino}

        def put(source: Any, target: Any) -> None:
            within = [Path(source)] if Path(source).is_file() else list(Path(source).rglob("*"))
            self.moved.append((Path(target), all(each.stat().st_ino in self.synced for each in within)))
            replace(source, target)
            self.late.add(Path(target).parent)

        monkeypatch.setattr(os, "fsync", fsync)
        monkeypatch.setattr(os, "replace", put)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    found = Disk(monkeypatch)
    yield found
    assert found.moved
    assert all(was_synced for _, was_synced in found.moved), found.moved
    assert not found.late


def test_the_files_of_a_run(tmp_path: Path, disk: Disk) -> None:
    out, run = tmp_path / "out", Run("a suite", "a command", ("mine.csv", "*/more.csv"))
    with held(out, run), staging(out, run) as stage:
        (stage / "mine.csv").write_text("1\n")
        (stage / "inside").mkdir()
        (stage / "inside" / "more.csv").write_text("2\n")
    assert {target.relative_to(out).as_posix() for target, _ in disk.moved} == {"mine.csv", "inside/more.csv", MANIFEST}
    assert (out / "inside" / "more.csv").read_text() == "2\n"


def test_the_state_of_a_training_and_its_curve(tmp_path: Path, disk: Disk) -> None:
    for frames in (1, 2, 3):
        write_state(tmp_path, {"numbers": np.full(3, frames, np.float32)}, {"frames": frames})
    write_curve(tmp_path, [{"frames": 1.0, "score": 0.5}, {"frames": 2.0, "score": 0.75}])
    assert (tmp_path / CURVE).read_text() == "frames,score\n1.0,0.5\n2.0,0.75\n"
    state, told = last_state(tmp_path)
    assert state is not None
    assert (state[1], told) == ({"frames": 3}, "")
    (tmp_path / LAST).write_bytes(b"torn")
    disk.synced.update(each.stat().st_ino for each in tmp_path.iterdir())
    state, told = last_state(tmp_path)
    assert state is not None
    assert (state[1], state[0]["numbers"].tolist()) == ({"frames": 2}, [2.0] * 3)
    assert told.endswith("going on from the save before it")
    assert not (tmp_path / PREVIOUS).exists()  # it stands as the last now


def test_an_agent(tmp_path: Path, disk: Disk) -> None:
    agent = load_agent(shipped("path_following", "p3dx")[0])
    sizes, layers, first = agent.network.sizes.tolist(), [], 0
    for come, go in itertools.pairwise(sizes):
        weight = agent.network.numbers[first : first + come * go].reshape(come, go).T
        layers.append((weight, agent.network.numbers[first + come * go : first + (come + 1) * go]))
        first += (come + 1) * go
    for _ in range(2):  # the second time in place of the first
        save_agent(tmp_path / "agents" / "best", layers, agent.card)
    names = [target.name for target, _ in disk.moved]
    assert names[-2:] == [CARD, WEIGHTS]
    again = load_agent(tmp_path / "agents" / "best")
    np.testing.assert_array_equal(again.network.numbers, agent.network.numbers)
    assert again.card["sha256"] == agent.card["sha256"]
