"""Work on many machines: the same rows wherever they are made, none twice, and one line whatever is lost."""

import dataclasses
import json
import multiprocessing
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.contests import CONTESTS, Course, Entrants
from wayfield.benchmarks.runs import shards
from wayfield.benchmarks.runs.payloads import payload, sent
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.tuning import random_scenes
from wayfield.envs.robots import ROBOTS
from wayfield.system.executors import HERE, TRIES, Executor, Failed, workers

ROOT = Path(__file__).parents[2]
CONTEST = ("--suite", "path-following", "--policies", "pure_pursuit,stanley", "--gains", "default")
ASKED = (*CONTEST, "--families", "circles,splines", "--episodes", "2")


def on_paths(families: tuple[str, ...] = ("circles", "splines"), count: int = 2) -> list[Setting]:
    """Returns parts of a small contest."""
    contest = CONTESTS["path-following"]
    entrants = Entrants(("pure_pursuit", "stanley"), ("default",))
    cases = [case for name in families for case in contest.cases(ROBOTS["p3dx"], Course(name, "test"), entrants)]
    return [Setting("a test", case, "kinematic", "lagged", 7, count) for case in cases]


def rows_of(setting: Setting) -> list[dict[str, str]]:
    """Returns the rows of a setting."""
    return [row for row, _ in episodes(setting)]


# Executors.


@pytest.fixture
def threads() -> Iterator[Executor]:
    """Returns an executor of threads, to which this process is far away."""
    with ThreadPoolExecutor(4) as pool:
        yield Executor.of(pool)


def test_results_come_in_the_order_of_the_work_whoever_is_first(threads: Executor) -> None:
    late = threading.Event()

    def work(k: int) -> int:
        if k == 0:
            assert late.wait(60)
        if k == 7:
            late.set()
        return k * k

    assert list(threads(work, range(20))) == [k * k for k in range(20)]
    late.clear()
    done = [k for k, _ in threads.as_done(work, range(20))]
    assert sorted(done) == list(range(20))
    assert done.index(7) < done.index(0)


def test_a_part_that_fails_once_is_done_and_one_that_fails_twice_is_told_while_the_rest_goes_on(
    threads: Executor,
) -> None:
    calls: list[str] = []

    def work(name: str) -> str:
        calls.append(name)
        if name == "bad" or (name == "unlucky" and calls.count(name) == 1):
            raise ValueError(f"{name} it is")
        return name

    done = []
    with pytest.raises(Failed, match=r"^1 of 4 failed twice: bad \(ValueError: bad it is\)$"):
        done.extend(threads.as_done(work, ["good", "bad", "unlucky", "fine"]))
    assert sorted(name for _, name in done) == ["fine", "good", "unlucky"]
    assert (calls.count("bad"), calls.count("unlucky"), calls.count("good")) == (TRIES, 2, 1)


# Payloads: what travels.


def _of_two(_: int) -> str:
    try:
        with workers(2) as executor:
            return str(list(executor(abs, [1])))
    except ValueError as error:
        return str(error)


def test_a_process_that_may_start_no_others_says_so_in_a_line() -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        (told,) = pool.map(_of_two, [0])
    assert told.startswith("workers is 2; ")
    assert told.endswith("it must be 1")


def test_a_folder_of_scenarios_travels_whole(tmp_path: Path, threads: Executor) -> None:
    """A drawn room, whose case names a folder with a map and its image; what lies deeper comes along."""
    (room,) = random_scenes.write_rooms(tmp_path / "rooms", 1, 3)
    place = random_scenes.Place("rooms", CONTESTS["goal-obstacles"], ROBOTS["p3dx"], [room])
    case = dataclasses.replace(place.case(room, "zero", {}), max_episode_steps=20)
    setting = Setting("a test", case, "kinematic", "lagged", 0, 2, members=(0, 2))
    here = rows_of(setting)
    (Path(room.file) / "more").mkdir()
    (Path(room.file) / "more" / "notes.txt").write_text("deeper\n")
    packed = payload(setting)
    assert {Path(name).name for name in packed.files} == {"map.yaml", "map.pgm", "cases.csv", "notes.txt"}
    shutil.rmtree(room.file)
    function, _ = sent(threads, rows_of, [])
    assert list(threads(function, [packed])) == [here]
    assert here[0]["scenario"] == room.file


def test_agents_travel(tmp_path: Path, threads: Executor) -> None:
    from wayfield.policies.trained.ppo import shipped

    agent = shipped("path_following", "p3dx")[3]
    best = tmp_path / "mine" / "seed_3" / "best"
    best.mkdir(parents=True)
    for file in agent.iterdir():
        (best / file.name).write_bytes(file.read_bytes())
    (setting, *_) = on_paths(("circles",), 1)
    case = dataclasses.replace(setting.case, policy="ppo", gains={"seed": 3, "home": str(tmp_path / "mine")})
    setting = dataclasses.replace(setting, case=dataclasses.replace(case, max_episode_steps=100))
    here = rows_of(setting)
    packed = payload(setting)
    assert all(str(best) in name for name in packed.files)
    for file in best.iterdir():
        file.unlink()
    function, _ = sent(threads, rows_of, [])
    assert list(threads(function, [packed])) == [here]
    assert str(tmp_path) in here[0]["gains"]


# Dask distributed.

distributed = pytest.importorskip("distributed")
pytest.importorskip("cryptography", reason='needs pip install "wayfield[cluster]"')


@pytest.mark.slow
def test_a_cluster_whose_workers_are_killed_makes_the_same_rows_and_none_twice(tmp_path: Path) -> None:
    from wayfield.system.cluster import cluster

    settings = [dataclasses.replace(each, seed=seed) for seed in range(6) for each in on_paths(count=1)]
    for name in ("cluster", "one"):
        (tmp_path / name).mkdir()
    kept: list[Path] = []
    keep = shards.keep
    chance = random.Random(18)
    kills = sorted(chance.sample(range(1, 18), 2))

    def noted(part: shards.Part, files: Any) -> None:
        assert not part.folder.exists()
        kept.append(part.folder)
        keep(part, files)
        if len(kept) in kills:
            running = list(executor._client.run(os.getpid, on_error="ignore").values())  # type: ignore[attr-defined]
            os.kill(chance.choice(running), signal.SIGKILL)

    with pytest.MonkeyPatch.context() as patch, cluster("local", 2) as executor:
        patch.setattr(shards, "keep", noted)
        rows, worst = shards.run_contest(settings, tmp_path / "cluster", executor)
    assert len(kept) == len(set(kept)) == len(settings)
    one, alone = shards.run_contest(settings, tmp_path / "one", HERE)
    assert rows == one
    assert {key: each.poses.tobytes() for key, each in worst.items()} == {
        key: each.poses.tobytes() for key, each in alone.items()
    }
    assert len({(row["policy"], row["scenario"], row["seed"]) for row in rows}) == len(rows) == len(settings)


def test_nobody_else_of_this_machine_reaches_the_workers_that_are_started_here() -> None:
    from wayfield.system.cluster import cluster

    with cluster("local", 1) as executor:
        address = executor._client.scheduler.address  # type: ignore[attr-defined]
        assert list(executor(abs, [-3])) == [3]
        others = distributed.Security(), distributed.Security.temporary()
        for reached, security in ((address.replace("tls", "tcp"), others[0]), (address, others[1])):
            with pytest.raises(OSError, match=r"certificate|closed|connect"):
                distributed.Client(reached, timeout=5, security=security, set_as_default=False)


class Place:
    """A scheduler and its workers, each a process of its own that speaks over 127.0.0.1."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.processes = folder, []  # type: tuple[Path, list[subprocess.Popen[str]]]
        self.address = ""

    def start(self, kind: str, *words: str, preload: str = "") -> subprocess.Popen[str]:
        """Starts a scheduler or a worker; `preload` is what it runs first."""
        if preload:
            file = self.folder / f"preload_{len(self.processes)}.py"
            file.write_text(preload)
            words = (*words, "--preload", str(file))
        command = [sys.executable, "-m", "distributed.cli.dask_" + kind, *words]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=self.folder)
        self.processes.append(process)
        return process

    def scheduler(self, preload: str = "") -> subprocess.Popen[str]:
        """Starts the scheduler and waits until it listens."""
        process = self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", preload=preload)
        self.address = _said(process, r"Scheduler at:\s+(tcp://\S+)")
        return process

    def worker(self, name: str, preload: str = "") -> subprocess.Popen[str]:
        """Starts a worker and waits until it is known."""
        words = (self.address, "--nthreads", "1", "--name", name, "--no-dashboard", "--no-nanny")
        process = self.start("worker", *words, "--local-directory", str(self.folder), preload=preload)
        _said(process, r"(Registered to):\s+tcp://")
        return process

    def end(self) -> None:
        """Ends them all."""
        for process in self.processes:
            process.kill()
            process.communicate()


def _said(process: subprocess.Popen[str], pattern: str) -> str:
    """Returns what a process says on stderr, once it says it; what it says later is read and let go."""
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(pattern, line):
            threading.Thread(target=process.stderr.read, daemon=True).start()
            return found[1]
    raise AssertionError(f"it ended with {process.wait()} before it said {pattern}")


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    found = Place(tmp_path)
    yield found
    found.end()


def evaluate(*words: str) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(main, words)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_scheduler_and_two_workers_make_the_rows_of_one_process_and_refuse_a_third_by_name(
    place: Place, tmp_path: Path
) -> None:
    place.scheduler()
    place.worker("first")
    place.worker("second")
    place.worker("stranger", "from wayfield.system import identity\nidentity.source_digest = lambda: '0' * 64\n")
    # one process here, which is for the figures: none beside it need start
    found = evaluate(*ASKED, "--cluster", place.address, "--workers", "1", "--out", str(tmp_path / "far"))
    assert found.exit_code == 0, found.stderr
    alone = evaluate(*ASKED, "--workers", "1", "--out", str(tmp_path / "near"))
    assert alone.exit_code == 0, alone.stderr
    assert (tmp_path / "far/episodes.csv").read_bytes() == (tmp_path / "near/episodes.csv").read_bytes()
    assert not (tmp_path / "far/unfinished").exists()
    refused = [line for line in found.stderr.splitlines() if "refused" in line]
    assert len(refused) == 1
    assert re.search(r"worker stranger tcp://127\.0\.0\.1:\d+ is refused: code and agents 0{12} there", refused[0])
    assert re.search(r"scheduler tcp://\S+, 3 workers; watch them at http://", found.stderr)


@pytest.mark.slow
def test_a_scheduler_and_two_workers_train_and_drive_a_robot_whose_data_sheet_they_do_not_have(
    place: Place, tmp_path: Path
) -> None:
    """The agents and the rows of one process, bit for bit; a worker that opens the sheet where it lies here fails."""
    here = tmp_path / "here"
    here.mkdir()
    content = json.loads((resources.files("wayfield.envs.robots") / "data_sheets" / "turtlebot3.json").read_text())
    (here / "mine.json").write_text(json.dumps(content | {"name": "mine"}))
    kept_out = (
        "import sys\n\ndef kept_out(event, arguments):\n"
        f"    if event == 'open' and str(arguments[0]).endswith(({str(here / 'mine.json')!r}, 'here/mine.json')):\n"
        "        raise PermissionError(arguments[0])\n\nsys.addaudithook(kept_out)\n"
    )
    place.scheduler()
    place.worker("first", kept_out)
    place.worker("second", kept_out)
    small = ("num_envs=24", "horizon=4", "batch_size=48", "epochs=1", "hidden=4", "validations=2", "steps=192")
    learnt = ["train.py", "wayfield/DiffDrivePathFollowing-v0", "--preset", "path_following_plain", "--seeds", "2"]
    learnt += [word for each in small for word in ("--set", each)]
    driven = ["evaluate.py", *CONTEST, "--families", "circles", "--episodes", "2"]
    found = {}
    for where, more in (("far", ["--cluster", place.address]), ("near", [])):
        for script, *words in (learnt, driven):
            command = [sys.executable, str(ROOT / script), *words, "--robot", "mine.json", *more]
            command += ["--out", f"{where}_{script.removesuffix('.py')}"]
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                cwd=here,
                timeout=600,
                env=os.environ | {"OMP_NUM_THREADS": "1"},
            )
            assert done.returncode == 0, done.stderr
        weights = [here / f"{where}_train" / f"seed_{k}" / "best" / "weights.safetensors" for k in range(2)]
        found[where] = [file.read_bytes() for file in (*weights, here / f"{where}_evaluate" / "episodes.csv")]
    assert found["far"] == found["near"]
    assert b"mine" in found["far"][2]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_scheduler_that_is_lost_is_one_line_and_what_was_done_is_kept(place: Place, tmp_path: Path) -> None:
    scheduler = place.scheduler()
    place.worker(
        "slow",
        "import time\nfrom wayfield.benchmarks.runs import shards\n"
        "shards.play = lambda setting, play=shards.play: (time.sleep(0.3), play(setting))[1]\n",
    )
    command = [sys.executable, str(ROOT / "evaluate.py"), *ASKED, "--cluster", place.address, "--workers", "1"]
    command += ["--out", "far"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    kept = tmp_path / "far" / "unfinished"
    late = time.monotonic() + 300.0
    while len(list(kept.glob("[!.]*"))) < 2 and process.poll() is None and time.monotonic() < late:
        time.sleep(0.02)
    scheduler.kill()
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 1, errors
    last = errors.strip().splitlines()[-1]
    assert re.fullmatch(
        rf"evaluate: the scheduler {place.address} is lost; \d+ of \d+ parts are kept in far/unfinished: "
        "the same command goes on there",
        last,
    )
    assert "Traceback" not in errors
    assert len(list(kept.glob("[!.]*"))) >= 2
    assert evaluate(*ASKED, "--workers", "1", "--out", str(tmp_path / "far")).exit_code == 0


@pytest.mark.parametrize(
    ("address", "told"),
    [
        pytest.param("tcp://127.0.0.1:9", "is no scheduler that can be reached within", marks=pytest.mark.slow),
        ("nonsense://x", "is no address; it must be like tcp://host:8786"),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_line(tmp_path: Path, address: str, told: str) -> None:
    found = evaluate(*ASKED, "--cluster", address, "--out", str(tmp_path / "far"))
    assert found.exit_code == 1, found.stderr
    (line,) = [line for line in found.stderr.splitlines() if not line.startswith("first run")]
    assert line.startswith(f"evaluate: --cluster '{address}' {told}")
    assert not (tmp_path / "far").exists()
