"""A recording takes the place of another of ours alone, and at no moment is there neither."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("pyarrow", reason='needs pip install "wayfield[record]"')
pytest.importorskip("minari", reason='needs pip install "wayfield[record]"')

from wayfield.benchmarks.recordings import record
from wayfield.system.storage import restore_folder

WORDS = ("pure_pursuit", "--suite", "path-following", "--family", "splines", "--episodes", "1", "--dataset", "mine-v0")
# ends at the n-th call that changes what a folder holds, before it is done or after
KILLED = """
import os, pathlib, sys, signal
from wayfield.system import storage
left = [int(sys.argv[3])]
def counted(event, arguments):
    if event in ("os.rename", "os.rmdir", "os.remove", "shutil.rmtree"):
        left[0] -= 1
        if left[0] < 0:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(counted)
storage.replace_folder(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
"""


def recorded(*words: str) -> str:
    """Returns what the command prints, behind its exit status."""
    result = CliRunner().invoke(record.main, [*WORDS, *words])
    return f"{result.exit_code} {result.output}"


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Returns the folder of the sets."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    return tmp_path


@pytest.mark.parametrize("name", ["notes.txt", "notes.mcap"])
@pytest.mark.parametrize("force", [(), ("--force",)])
def test_a_file_of_somebody_s_is_never_replaced(name: str, force: tuple[str, ...], home: Path) -> None:
    (home / name).write_text("notes")
    told = recorded("--mcap", str(home / name), *force)
    assert told.startswith("1 ")
    assert f"{home / name} was not recorded by this command" in told
    assert (home / name).read_text() == "notes"
    assert not (home / "sets" / "mine-v0").exists()


def test_an_mcap_file_of_ours_is_replaced_by_force_alone(home: Path) -> None:
    file = home / "first.mcap"
    assert recorded("--mcap", str(file)).startswith("0 ")
    before = file.read_bytes()
    other = ("--mcap", str(file), "--seed", "5", "--dataset", "other-v0")
    assert "is there already" in recorded(*other)
    assert file.read_bytes() == before
    assert recorded(*other, "--force").startswith("0 ")
    assert file.read_bytes() != before
    assert recorded("--mcap", str(file), "--seed", "6", "--force").startswith("0 ")  # the set too
    assert sorted(each.name for each in (home / "sets").iterdir() if not each.name.endswith(".lock")) == [
        "mine-v0",
        "other-v0",
    ]


@pytest.mark.parametrize("left", range(6))
def test_a_kill_at_any_moment_of_a_replacement_leaves_the_old_set_or_the_new_one(left: int, home: Path) -> None:
    old, new = home / "set", home / "staged"
    for folder in (old, new):
        folder.mkdir()
        for k in range(2):
            (folder / f"{k}").write_text(folder.name)
    run = subprocess.run([sys.executable, "-c", KILLED, new, old, str(left)], check=False)
    assert run.returncode in (0, -signal.SIGKILL)
    restore_folder(old)
    texts = {file.read_text() for file in old.iterdir()}
    assert texts in ({"set"}, {"staged"})
    assert len(list(old.iterdir())) == 2


def test_a_full_disk_leaves_nothing(home: Path) -> None:
    full = ["-c", "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))\n"
            "from wayfield.benchmarks.recordings.record import main; main()"]  # fmt: skip
    done = subprocess.run(
        [sys.executable, *full, *WORDS[:-1], "far/away/mine-v0"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert sum(not line.startswith("1 of 1 ") for line in done.stderr.splitlines()) == 1
    assert [each.name for each in home.rglob("*")] in ([], ["sets"])  # Minari makes the folder of all
