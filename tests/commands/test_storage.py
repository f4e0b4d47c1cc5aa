"""Files are whole or not there, whoever writes beside and whenever a process is killed."""

import multiprocessing
import os
import subprocess
import sys

import pytest

from wayfield.system import storage


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    file = tmp_path / "gains.json"
    storage.write_whole(file, b"old")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        storage.write_whole(file, b"new")
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


def _write_many(file, content):
    for _ in range(100):
        storage.write_whole(file, content)


def test_racing_writers_never_fail_and_never_mix(tmp_path):
    file = tmp_path / "state"
    contents = [bytes([65 + k]) * 10_000 for k in range(2)]
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=_write_many, args=(file, content)) for content in contents]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        if file.exists():
            assert file.read_bytes() in contents
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("clear", [storage.clear_stale, lambda folder: storage.write_whole(folder / "a", b"")])
def test_what_a_dead_process_left_is_cleared_and_what_a_living_one_writes_is_not(tmp_path, clear):
    child = subprocess.run(
        [
            sys.executable,
            "-c",
            f"from wayfield.system import storage; import pathlib, os\n"
            f"storage.temporary_folder(pathlib.Path({str(tmp_path)!r})); os._exit(9)",
        ],
        check=False,
    )
    assert child.returncode == 9
    ours = storage.temporary_folder(tmp_path)
    foreign = tmp_path / ".wayfield-notes"
    foreign.write_text("mine")
    assert len(list(tmp_path.iterdir())) == 3
    clear(tmp_path)
    assert sorted({*tmp_path.iterdir()} - {tmp_path / "a"}) == sorted([ours, foreign])


@pytest.mark.parametrize("kind", ["text", "folder", "link"])
def test_what_is_no_lock_is_refused_and_stays_as_it_is(tmp_path, kind):
    file, there = tmp_path / "lock", tmp_path / "mine.txt"
    there.write_text("mine")
    if kind == "folder":
        file.mkdir()
    elif kind == "link":
        file.symlink_to(there)
    else:
        file.write_text("mine")
    with pytest.raises(FileExistsError, match="is not a lock of ours"), storage.locked(file, "busy"):
        pass
    assert file.is_dir() if kind == "folder" else file.read_text() == "mine"
    assert sorted(tmp_path.iterdir()) == [file, there]
