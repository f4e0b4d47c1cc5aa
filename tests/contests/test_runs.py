"""Runs: they touch nobody's files but their own, survive crashes, and end in one line whatever happens to them."""

import dataclasses
import errno
import io
import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from wayfield.benchmarks.commands.contest_options import Options
from wayfield.benchmarks.contests import OVERVIEW
from wayfield.benchmarks.records import archive
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.results import (
    EPISODES,
    TRAJECTORIES,
    read_rows,
    read_trajectories,
    write_rows,
    write_trajectories,
)
from wayfield.benchmarks.records.run_folder import MANIFEST, Run, held, staging
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.runs import shards
from wayfield.benchmarks.runs.suite import Setting, together
from wayfield.system.command_line import OneLineErrors
from wayfield.system.executors import HERE, workers

SUITE = Run("a test", "python evaluate.py --a test", ("figure_*.svg",))


def run(out, files, suite=SUITE):
    """Runs something that writes these files."""
    with held(out, suite), staging(out, suite) as stage:
        for name, text in files.items():
            (stage / name).parent.mkdir(exist_ok=True)
            (stage / name).write_text(text)


def test_a_file_that_is_edited_while_the_next_run_works_is_left_to_whoever_edited_it(tmp_path):
    run(tmp_path, {"figure_a.svg": "a", "figure_b.svg": "b", "figure_c.svg": "c"})
    with held(tmp_path, SUITE), staging(tmp_path, SUITE) as stage:
        (stage / "figure_a.svg").write_text("a again")
        (tmp_path / "figure_b.svg").write_text("mine")
    assert content(tmp_path) == {"figure_a.svg": "a again", "figure_b.svg": "mine"}


def content(out):
    """Returns the text of every file in a folder, but for the lock."""
    return {
        str(file.relative_to(out)): file.read_text()
        for file in out.rglob("*")
        if file.is_file() and file.name not in (".lock", MANIFEST)
    }


# What a run may touch.


def test_a_run_replaces_its_own_files_and_takes_those_away_that_it_no_longer_makes(tmp_path):
    out = tmp_path / "deep" / "out"
    run(out, {"table.md": "1", "figure_a.svg": "1", "video/a.mp4": "1"})
    (out / "notes.txt").write_text("mine")
    (out / "video" / "cat.mp4").write_text("mine")
    run(out, {"table.md": "2", "figure_b.svg": "2"})
    assert content(out) == {"table.md": "2", "figure_b.svg": "2", "notes.txt": "mine", "video/cat.mp4": "mine"}


@pytest.mark.parametrize("name", ["table.md", "figure_mine.svg", MANIFEST])
@pytest.mark.parametrize("ran", [False, True])
def test_a_file_of_somebody_else_is_refused_by_name_before_anything_runs(tmp_path, name, ran):
    if ran:
        run(tmp_path, {"figure_a.svg": "1", "table.md": "1"} | ({"figure_mine.svg": "1"} if "mine" in name else {}))
    (tmp_path / name).write_text("precious")
    before = content(tmp_path)
    with pytest.raises(FileExistsError, match=name), held(tmp_path, SUITE):
        pytest.fail("it ran")
    assert content(tmp_path) == before
    assert (tmp_path / name).read_text() == "precious"


def test_a_file_that_comes_while_a_run_works_is_kept(tmp_path):
    def running():
        with held(tmp_path, SUITE), staging(tmp_path, SUITE) as stage:
            (stage / "figure_new.svg").write_text("ours")
            (stage / "figure_a.svg").write_text("ours")
            (tmp_path / "figure_new.svg").write_text("precious")

    with pytest.raises(FileExistsError, match="figure_new"):
        running()
    assert content(tmp_path) == {"figure_new.svg": "precious"}


def test_the_results_of_another_suite_are_refused(tmp_path):
    run(tmp_path, {"table.md": "1"})
    with pytest.raises(FileExistsError, match=r"another run, `python evaluate\.py --a test`"):
        run(tmp_path, {"table.md": "2"}, dataclasses.replace(SUITE, suite="another"))
    assert content(tmp_path) == {"table.md": "1"}


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[" * 100_000,
        '{"suite": "a test", "command": "", "files": {"../out": "0"}, "replaced": {}}',
        "\0",
    ],
)
def test_a_manifest_that_is_none_is_refused(tmp_path, text):
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(FileExistsError, match=MANIFEST):
        run(tmp_path, {"table.md": "2"})
    assert (tmp_path / MANIFEST).read_text() == text


@pytest.mark.parametrize("moves", range(6))
def test_a_crash_between_any_two_moves_leaves_files_that_the_next_run_knows_for_its_own(tmp_path, monkeypatch, moves):
    run(tmp_path, {"table.md": "1", "figure_a.svg": "1", "figure_b.svg": "1"})
    replace, left = os.replace, [moves]

    def crashing(*names):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        replace(*names)

    monkeypatch.setattr(os, "replace", crashing)
    try:
        run(tmp_path, {"table.md": "2", "figure_a.svg": "2", "figure_c.svg": "2"})
    except KeyboardInterrupt:
        assert moves < 5
    monkeypatch.undo()
    found = content(tmp_path)
    assert set(found.values()) <= {"1", "2"}
    run(tmp_path, {"table.md": "3"})
    assert content(tmp_path) == {"table.md": "3"}


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("there", [False, True])
def test_a_run_that_fails_leaves_the_folder_as_it_was(tmp_path, error, there):
    out = tmp_path / "deep" / "out"
    if there:
        run(out, {"table.md": "1"})

    def failing():
        with held(out, SUITE), staging(out, SUITE) as stage:
            (stage / "table.md").write_text("half")
            raise error

    with pytest.raises(error):
        failing()
    assert (content(out) if there else list(tmp_path.iterdir())) == ({"table.md": "1"} if there else [])


def test_what_cannot_be_written_is_named_as_it_would_have_been(tmp_path):
    with pytest.raises(OSError, match="No space") as caught, held(tmp_path, SUITE), staging(tmp_path, SUITE) as stage:
        raise OSError(errno.ENOSPC, "No space left on device", str(stage / "episodes.csv"))
    assert caught.value.filename == str(tmp_path / "episodes.csv")


def test_a_second_run_in_a_folder_is_told_who_works_there(tmp_path):
    code = (
        "import pathlib\n"
        "from wayfield.benchmarks.records.run_folder import Run, held\n"
        f"try:\n    with held(pathlib.Path({str(tmp_path)!r}), Run('a test', '')): print('held')\n"
        "except BlockingIOError as error: print(error)"
    )
    with held(tmp_path, SUITE), staging(tmp_path, SUITE):
        told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.count("\n") == 1
    assert f"another run (process {os.getpid()}) works in {tmp_path}" in told.stdout


# Parts, with episodes that are made up: what is tested is what becomes of them.


@pytest.fixture
def made_up(monkeypatch):
    """Makes up episodes; the list receives each setting that is played."""
    played = []

    def episodes(setting):
        played.append(setting)
        case = setting.case
        row = {
            **{"suite": setting.suite, "contest": case.contest, "policy": case.policy, "gains_name": "trained"},
            **{"robot": "p3dx", "disturbance": "none", "scenario": case.scenario},
        }
        return [
            (row | {"episode": i, "success": 1.0, "time": float(i), "cross_track_rms": 0.1 * i}, driven(i))
            for i in range(setting.episodes)
        ]

    monkeypatch.setattr(shards, "episodes_together", lambda settings: list(map(episodes, settings)))
    return played


def driven(i):
    """Returns a trajectory of its own."""
    return Trajectory(times=np.arange(3.0), poses=np.full((3, 3), float(i)))


def setting(name, family, policy="zero"):
    """Returns a part of a contest."""
    case = Case(name, family, "", f"{family}/test", policy, env_kwargs={"robot": "p3dx"}, split="test")
    return Setting("a test", case, "kinematic", "ideal", 0, 5)


SETTINGS = [setting("path-following", "circles"), setting("path-following", "splines")]


def settled(settings, out):
    """Returns the rows and worst trajectories of a contest, the latter as lists."""
    rows, worst = shards.run_contest(settings, out, HERE)
    return rows, {key: trajectory.poses.tolist() for key, trajectory in worst.items()}


@pytest.mark.parametrize("name", ["rows.json", TRAJECTORIES, "part.json"])
@pytest.mark.parametrize("damage", ["number", "cut", "gone"])
def test_a_damaged_part_is_played_again_with_one_line_that_says_so(tmp_path, made_up, capsys, name, damage):
    first = settled(SETTINGS, tmp_path)
    part = shards.parts_of(SETTINGS, tmp_path)[0]
    file = part.folder / name
    whole = file.read_bytes()
    made_up.clear()
    capsys.readouterr()
    if damage == "gone":
        file.unlink()
    else:
        digit = max(i for i, byte in enumerate(whole) if chr(byte) in "012345678")
        changed = whole[:digit] + bytes([whole[digit] + 1]) + whole[digit + 1 :]
        file.write_bytes(changed if damage == "number" else whole[: len(whole) // 2])
    assert settled(SETTINGS, tmp_path) == first
    assert made_up == [SETTINGS[0]]
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "damaged" in line]
    assert str(part.folder) in line
    assert "zero on circles/test" in line
    made_up.clear()
    assert settled(SETTINGS, tmp_path) == first
    assert not made_up


# Files that are read back.


def rows_and_trajectories(folder):
    """Writes a small run."""
    write_rows(folder, [{"policy": "zero", "time": "1.5"}, {"policy": "lqr", "time": ""}])
    write_trajectories(folder, {"00000": driven(1), "00001": driven(2)})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"policy,time\nzero,1\nlqr\n", r"episodes\.csv:3: .* cells"),
        (b"policy,time\nzero,\xff\n", r"episodes\.csv:\d: .*utf-8"),
        (b'policy,time\n"zero,1\n', r"episodes\.csv:2: unexpected end"),
        (b"policy,time\nzero,1\nlqr,soon\n", r"episodes\.csv: row 2: column 'time' holds 'soon'; it must be a number"),
    ],
)
def test_a_damaged_table_is_refused_by_file_and_line(tmp_path, text, said):
    (tmp_path / EPISODES).write_bytes(text)
    with pytest.raises(ValueError, match=said):
        read_rows(tmp_path)


@given(st.data())
def test_trajectories_come_back_or_are_refused_by_file_whatever_bytes_are_wrong(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp() / "bytes"
    folder.mkdir(exist_ok=True)
    rows_and_trajectories(folder)
    file = folder / TRAJECTORIES
    whole = file.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    changed = whole[:at] + data.draw(st.binary(min_size=0, max_size=3)) + whole[at + data.draw(st.integers(0, 3)) :]
    file.write_bytes(changed)
    said = f"{file}: "
    try:
        read_trajectories(folder)
    except ValueError as error:  # any other is the failure
        said = str(error)
    assert said.startswith(f"{file}: ")
    assert "\n" not in said


def test_what_would_unpack_to_much_is_refused_where_nothing_honest_is_packed_so_densely(tmp_path, monkeypatch):
    dense, loose = np.zeros(20_000), np.random.default_rng(0).random(20_000)
    for name, numbers in (("dense", dense), ("loose", loose)):
        np.savez_compressed(tmp_path / f"{name}.npz", a=numbers)
    packed = (tmp_path / "dense.npz").stat().st_size
    assert 8 * len(dense) > 100 * packed
    for most, read in ((8 * len(dense) + 500, {"dense", "loose"}), (8 * len(dense) - 1, {"loose"}), (100, {"loose"})):
        monkeypatch.setattr(archive, "MOST_BYTES", most)
        for name, numbers in (("dense", dense), ("loose", loose)):
            if name in read:
                with archive.Archive(tmp_path / f"{name}.npz") as opened:
                    np.testing.assert_array_equal(opened["a"], numbers)
            else:
                with (
                    pytest.raises(ValueError, match=rf"{name}\.npz: the file is damaged: it would unpack to"),
                    archive.Archive(tmp_path / f"{name}.npz"),
                ):
                    pytest.fail("it was opened")


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,)}",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1,)}",
        "__import__('os').abort()",
    ],
)
def test_an_array_that_claims_to_be_what_it_is_not_is_refused_by_name(tmp_path, header):
    member = io.BytesIO()
    text = header.encode() + b"\n"
    member.write(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(12))
    with zipfile.ZipFile(tmp_path / TRAJECTORIES, "w") as archive:
        archive.writestr("00000/poses.npy", member.getvalue())
    with pytest.raises(ValueError, match=r"trajectories\.npz: 00000/poses: "):
        read_trajectories(tmp_path)


# Processes.


def test_a_worker_that_is_killed_is_told_as_such():
    with pytest.raises(ChildProcessError, match="a worker process was killed"), workers(2) as share:
        list(share(signal.raise_signal, 2 * [signal.SIGKILL]))


@pytest.mark.parametrize("guard", ["if True:", 'if __name__ == "__main__":'])
def test_a_script_that_would_start_anew_in_each_worker_is_told_where_to_put_what_it_does(guard: str, tmp_path: Path):
    """It ended as if a worker had been killed for want of memory, after each had begun the script again."""
    lines = ["from wayfield.system.executors import workers", guard, "    print('begins', flush=True)"]
    lines += ["    with workers(2) as share:", "        print(list(share(abs, [-1, -2])))"]
    script = tmp_path / "mine.py"
    script.write_text("\n".join(lines))
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert run.stdout.count("begins") == 1
    if guard == "if True:":
        assert run.stderr.splitlines()[-1].startswith("ValueError: workers is 2, and each process runs ")
        assert 'if __name__ == "__main__":' in run.stderr
    else:
        assert run.stdout.endswith("[1, 2]\n")


_WORKING = """
import os, sys, time
from wayfield.system.executors import workers

def work(_):
    os.write(1, f"{os.getpid()}\\n".encode())  # at once, or the other's may come between
    time.sleep(60)

if __name__ == "__main__":
    with workers(2) as share:
        print("starts", flush=True)
        list(share(work, range(2)))
"""


def working(tmp_path):
    """Starts a process with two workers in a process group of its own."""
    (tmp_path / "working.py").write_text(_WORKING)
    return subprocess.Popen(
        [sys.executable, str(tmp_path / "working.py")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def alive(process):
    """Returns whether a process runs."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="there is no /proc")
def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    with working(tmp_path) as parent:
        assert parent.stdout.readline() == "starts\n"
        children = [int(parent.stdout.readline()) for _ in range(2)]
        parent.kill()
        parent.wait()
        until = time.monotonic() + 120.0
        while any(map(alive, children)) and time.monotonic() < until:
            time.sleep(0.05)
        assert not any(map(alive, children))


@pytest.mark.skipif(os.name != "posix", reason="signals differ")
@pytest.mark.parametrize("command", ["evaluate", "train"])
def test_an_interruption_while_modules_load_is_one_line(command, tmp_path):
    script = Path(__file__).parents[2] / f"{command}.py"
    # the first of the modules that take long takes as long as it needs here
    (tmp_path / "numpy.py").write_text("import time\nprint('loading', flush=True)\ntime.sleep(600)\n")
    told = os.environ | {"PYTHONPATH": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, str(script), "--help"], env=told, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "loading\n"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=300)
    assert (process.returncode, errors) == (130, f"{command}: interrupted; nothing was written\n")


# Command lines.

_COMMAND = """
import sys, click, rich.console
from wayfield.system.command_line import OneLineErrors
from wayfield.system.executors import HERE, workers

@click.command("shown", cls=OneLineErrors)
@click.argument("how")
def main(how):
    for _ in range(2_000):
        print(40 * "g\\xf6\\xf6l \\xb1 1") if how == "print" else None
        click.echo(20 * "words words words") if how == "click" else None
        rich.console.Console().print(5 * "words words") if how == "rich" else None

main()
"""


def shown(how, stdout, **environment):
    """Runs a command that prints much, to what a shell would call `stdout`; returns status and stderr."""
    done = subprocess.run(
        ["bash", "-c", f'"$0" -c "$1" {how} {stdout}; echo "status ${{PIPESTATUS[0]}}" >&2', sys.executable, _COMMAND],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | environment,
    )
    *lines, status = done.stderr.splitlines()
    return int(status.removeprefix("status ")), lines


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.parametrize("how", ["print", "click", "rich"])
def test_a_reader_that_goes_ends_a_command_quietly(how):
    assert shown(how, "| head -n 1 >/dev/null") == (141, [])


@pytest.mark.skipif(not Path("/dev/full").exists() or shutil.which("bash") is None, reason="there is no /dev/full")
def test_a_full_disk_behind_the_output_is_one_line():
    status, lines = shown("print", ">/dev/full")
    assert status == 1
    assert lines == ["shown: the disk is full"]


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_output_that_is_closed_or_takes_ascii_alone_is_no_error():
    ascii_alone = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    assert shown("print", ">/dev/null", **ascii_alone) == (0, [])
    assert shown("rich", ">&-") == (0, [])


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError("Unable to allocate 9 EiB"), 1, "out of memory: Unable to allocate 9 EiB"),
        (OSError(errno.ENOSPC, "No space left on device", "a.csv"), 1, f"the disk is full: {Path('a.csv').resolve()}"),
        (PermissionError(errno.EACCES, "Permission denied", "a.csv"), 1, "a.csv"),
        (BlockingIOError("another run works here"), 1, "another run works here"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 141, ""),
        (click.UsageError("wrong"), 2, "wrong"),
    ],
)
def test_what_is_the_user_s_or_the_machine_s_is_one_line(error, status, said):
    @click.command("fails", cls=OneLineErrors)
    def fails():
        raise error

    result = CliRunner().invoke(fails)
    assert result.exit_code == status
    assert result.stderr.count("\n") == (1 if said else 0)
    assert said in result.stderr


def test_a_defect_of_ours_is_a_traceback():
    @click.command("fails", cls=OneLineErrors)
    def fails():
        raise ValueError("a defect")

    assert isinstance(CliRunner().invoke(fails).exception, ValueError)


@pytest.mark.parametrize(("splits", "apart"), [("own own front front", 2), ("own", 0), ("", 0)])
def test_a_speed_sweep_has_a_file_of_its_own(tmp_path, splits, apart):
    rows = [{"policy": f"p{k}", "split": split, "success": 1.0} for k, split in enumerate(splits.split())]
    write_rows(tmp_path, rows)
    assert (tmp_path / "speed_sweep.csv").is_file() == bool(apart)
    assert len((tmp_path / "episodes.csv").read_text().splitlines()) == 1 + len(rows) - apart
    assert [(row["policy"], row["split"]) for row in read_rows(tmp_path)] == [(r["policy"], r["split"]) for r in rows]


@pytest.mark.parametrize(
    ("contest", "policy"),
    [
        ("path-following", "regulated_pure_pursuit"),
        ("goal-obstacles", "vfh_plus"),
        ("docking", "ppo"),
        ("trajectory-tracking", "kanayama"),
    ],
)
def test_families_that_are_driven_at_once_are_driven_as_alone(contest: str, policy: str) -> None:
    options = Options(suite=OVERVIEW, contests=(contest,), policies=(policy,), gains="best", episodes=2)
    settings = options.settings()
    groups = together(settings)
    assert sorted(k for group in groups for k in group) == list(range(len(settings)))
    chosen = [settings[k] for k in max(groups, key=len)[-3:]]
    assert len(chosen) == 3
    for setting, found in zip(chosen, shards.played_together(chosen), strict=True):
        for (row, trajectory), (other, alone) in zip(found, shards.played(setting), strict=True):
            assert repr(row) == repr(other)
            assert trajectory.poses.tobytes() == alone.poses.tobytes()
