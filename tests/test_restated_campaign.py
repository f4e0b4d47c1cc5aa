"""The fault campaign with commands that only pretend: what it asks for, counts, keeps, and takes for a fault."""

import contextlib
import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

import click
import pytest

import wayfield
from wayfield.benchmarks.faults import campaign, commands, disk, foreign, kills, place, runs, together
from wayfield.benchmarks.faults.place import Ended
from wayfield.envs.command_line import Names

WELL = Ended(0, "", "")
Act = Callable[[Path, Sequence[str]], Ended | None]


class Pretended:
    """A command that does its work at once, and ends when it is waited for, by a signal, or not at all."""

    def __init__(self, owner: "Pretence", command: str, line: Sequence[str], folder: Path) -> None:
        self.owner = owner
        owner.started.append((command, tuple(line)))
        act = owner.acts.pop(0) if len(owner.acts) > 1 else owner.acts[0]
        self.end = act(folder, line) or WELL

    def send(self, number: int) -> None:
        self.owner.sent.append(number)

    def computed(self, seconds: float) -> None:
        self.owner.waited.append(seconds)

    def ended(self) -> bool:
        return self.owner.over

    def ends_within(self, seconds: float) -> bool:
        self.owner.waited.append(seconds)
        return self.owner.obeys

    def left(self) -> list[str]:
        return self.owner.orphans

    def wait(self, limit: float) -> Ended:
        self.owner.limits.append(limit)
        return self.end


class Pretence:
    """Stands in for `place.Place`: notes what is asked, and answers by `acts`, the last of them for all that follow."""

    def __init__(self, tmp_path: Path, *acts: Act) -> None:
        self.out = self.code = tmp_path
        self.tmp_path = tmp_path
        self.acts = list(acts)
        self.references: dict[str, tuple[dict[str, str], float]] = {}
        self.started: list[tuple[str, tuple[str, ...]]] = []
        self.sent: list[int] = []
        self.waited: list[float] = []
        self.limits: list[float] = []
        self.keywords: list[dict[str, Any]] = []
        self.warmed: list[str] = []
        self.orphans: list[str] = []
        self.over, self.obeys = False, True
        self.restored = 0
        self.folders = 0

    @contextlib.contextmanager
    def folder(self) -> Iterator[Path]:
        self.folders += 1
        found = self.tmp_path / f"folder_{self.folders}"
        found.mkdir()
        yield found

    def start(self, command: str, line: Sequence[str], folder: Path, **keywords: Any) -> Pretended:
        self.keywords.append(keywords)
        return Pretended(self, command, line, folder)

    def run(self, command: str, line: Sequence[str], folder: Path, limit: float = 60.0, **keywords: Any) -> Ended:
        return self.start(command, line, folder, **keywords).wait(limit)

    def warm(self, command: str, line: Sequence[str], folder: Path) -> None:
        self.warmed.append(command)
        (folder / runs.OUT / "warm").write_text("", encoding="utf-8")

    def restore(self) -> None:
        self.restored += 1


def _writes(files: dict[str, str], end: Ended = WELL) -> Act:
    def act(folder: Path, line: Sequence[str]) -> Ended:
        for name, text in files.items():
            file = folder / runs.OUT / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        return end

    return act


def _digests(files: dict[str, str], folder: Path) -> dict[str, str]:
    folder.mkdir()
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return place.contents(folder)


CONTEST = {"episodes.csv": "a", "trajectories.npz": "b", "table.md": "c"}
TUNED = {"gains.json": "{}"}


# ---- the campaign itself


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


class Worker:
    """Stands in for `server.Server`."""

    made: ClassVar[list["Worker"]] = []

    def __init__(self, where: Any, **environment: str) -> None:
        self.environment, self.steps, self.closed, self.asked = environment, 0, False, []
        Worker.made.append(self)

    def ask(self, module: str, spec: dict[str, Any]) -> str | None:
        self.asked.append((module, spec))
        return spec.get("trial", spec).get("answer")

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    Worker.made = []
    monkeypatch.setattr(campaign, "time", found)
    monkeypatch.setattr(campaign, "Server", Worker)
    return found


class Out:
    def __init__(self, out: Path) -> None:
        self.out = out


def _groups(clock: Clock, seconds: dict[str, float], steps: int = 0, **more: Any) -> dict[str, campaign.Group]:
    def attempt(spec: dict[str, Any], where: Any, server: Any) -> str | None:
        clock.now += spec["takes"]
        server.steps += steps
        found: str | None = spec.get("answer")
        return found

    def trials(takes: float) -> Callable[[random.Random], Iterator[dict[str, Any]]]:
        def drawn(rng: random.Random) -> Iterator[dict[str, Any]]:
            while True:
                yield {"takes": takes, "number": rng.random(), **more}

        return drawn

    shares = {"first": 0.5, "second": 0.3, "third": 0.2}
    return {name: campaign.Group(shares[name], trials(takes), attempt) for name, takes in seconds.items()}


def test_groups_share_the_time_and_what_one_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    assert sum(group.share for group in campaign.GROUPS.values()) == pytest.approx(1.0)
    monkeypatch.setattr(campaign, "GROUPS", _groups(clock, {"first": 1.0, "second": 1.0, "third": 100.0}, steps=7))
    told: list[str] = []
    # of 60 s 24 (0.3 of 0.5) to the second and 16 to the third, who does one trial whatever it takes
    counts = campaign.run(Out(tmp_path), ("second", "third"), 1.0, 0, told.append)  # type: ignore[arg-type]
    assert counts["second"] == campaign.Count(37, 0, 7 * 37, 37.0)  # the first trial that ends after 36 s is the last
    assert counts["third"] == campaign.Count(1, 0, 7, 100.0)
    assert not told
    assert all(worker.closed for worker in Worker.made)
    assert all(worker.environment == {"NUMBA_BOUNDSCHECK": "1"} for worker in Worker.made)
    assert not (tmp_path / campaign.FINDINGS).exists()
    before = campaign.totals_of(tmp_path)
    assert before["second"] == {"tried": 37, "failed": 0, "steps": 259, "seconds": 37.0}
    # what the first saves is there for those that follow; what one takes too long, is gone
    counts = campaign.run(Out(tmp_path), ("third", "second"), 1.0, 0, told.append)  # type: ignore[arg-type]
    assert (counts["third"].tried, counts["second"].tried) == (1, 1)
    after = campaign.totals_of(tmp_path)
    assert after["second"] == {"tried": 38, "failed": 0, "steps": 266, "seconds": 38.0}
    assert after["third"] == {"tried": 2, "failed": 0, "steps": 14, "seconds": 200.0}


def test_what_took_less_than_its_share_leaves_the_rest_to_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    groups = _groups(clock, {"first": 1.0, "second": 1.0})
    short = campaign.Group(0.5, lambda rng: iter([{"takes": 4.0}]), groups["first"].attempt)
    monkeypatch.setattr(campaign, "GROUPS", groups | {"first": short})
    counts = campaign.run(Out(tmp_path), ("first", "second"), 0.5, 0, lambda line: None)  # type: ignore[arg-type]
    assert counts["first"].tried == 1
    assert counts["first"].seconds == 4.0
    assert counts["second"].tried == 27  # 26 s were left


def test_every_group_does_a_trial_though_it_may_take_longer_than_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    attempt = _groups(clock, {"first": 1.0})["first"].attempt
    listed = [{"takes": 70.0, "limit": 90.0}, {"takes": 9.0, "limit": 90.0}]
    groups = {name: campaign.Group(0.5, lambda rng: iter(listed), attempt) for name in ("first", "second")}
    monkeypatch.setattr(campaign, "GROUPS", groups)
    counts = campaign.run(Out(tmp_path), ("first", "second"), 1.0, 0, lambda line: None)  # type: ignore[arg-type]
    assert [(each.tried, each.seconds) for each in counts.values()] == [(1, 70.0), (1, 70.0)]


def test_a_campaign_that_is_stopped_has_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
        yield {"takes": 2.0}
        raise KeyboardInterrupt

    groups = _groups(clock, {"first": 1.0})
    monkeypatch.setattr(campaign, "GROUPS", {"first": campaign.Group(1.0, trials, groups["first"].attempt)})
    with pytest.raises(KeyboardInterrupt):
        campaign.run(Out(tmp_path), ("first",), 1.0, 0, lambda line: None)  # type: ignore[arg-type]
    assert campaign.totals_of(tmp_path) == {"first": {"tried": 1, "failed": 0, "steps": 0, "seconds": 2.0}}
    assert Worker.made[0].closed


def test_three_findings_of_a_kind_are_kept_and_told_and_all_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    specs = [{"takes": 0.0, "command": "tune", "answer": f"line {k} of 'x{k}' in /a/b{k}", "k": k} for k in range(5)]
    specs += [{"takes": 0.0, "command": "train", "answer": "line 9 of 'x' in /a", "k": 9, "content": "C" * 400}]
    specs += [
        {"takes": 0.0, "command": "train", "k": 10},
        {"takes": 0.0, "limit": 61.0},
        {"takes": 60.0, "limit": 59.0},
    ]
    groups = _groups(clock, {"first": 1.0})
    listed = campaign.Group(1.0, lambda rng: iter(specs), groups["first"].attempt)
    monkeypatch.setattr(campaign, "GROUPS", {"first": listed})
    told: list[str] = []
    counts = campaign.run(Out(tmp_path), ("first",), 1.0, 0, told.append)  # type: ignore[arg-type]
    assert (counts["first"].tried, counts["first"].failed) == (8, 6)  # what may take too long is left out
    assert len(told) == 4
    files = sorted((tmp_path / campaign.FINDINGS).iterdir())
    kept = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    assert sorted(each["trial"]["k"] for each in kept) == [0, 1, 2, 9]
    for each, file in zip(kept, files, strict=True):
        (line,) = (line for line in told if str(file) in line)
        assert each == {"group": "first", "problem": each["trial"]["answer"], "trial": each["trial"]}
        assert line.startswith(f"first: {each['problem']}\n    {file}: ")
        assert "CCC" not in line
        assert line.endswith(json.dumps({name: value for name, value in each["trial"].items() if name != "content"}))
        assert file.name.startswith("first_")
        assert len(file.stem) == len("first_") + 12


def test_findings_of_one_cause_are_those_that_differ_by_numbers_and_names() -> None:
    kind = campaign._kind
    assert kind({}, "at 1 'a' \"b\" /c/d e") == kind({}, "at 22 'xx' \"y\" /z e") != kind({}, "at 1 f")
    for name in ("reader", "mutated", "command", "run"):
        assert kind({name: "x"}, "p") == ("x", "p")
    assert kind({"command": "c", "mutated": "m"}, "p")[0] == "m"
    assert len(kind({}, "p" * 200)[1]) == 80
    long = {"a": "x" * 300}
    assert campaign._brief(long) == json.dumps(long)[:300] + "..."
    exact = {"a": "x" * (299 - len(json.dumps({"a": ""})))}
    assert campaign._brief(exact) == json.dumps(exact)
    assert campaign._brief({"a": exact["a"] + "x"}).endswith("...")


def test_a_forked_trial_is_done_by_a_worker_and_a_kept_one_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    monkeypatch.setattr(campaign, "GROUPS", _groups(clock, {"first": 1.0}))
    spec = {"takes": 1.0, "answer": "wrong", "forked": True}
    file = campaign.kept(tmp_path, "first", spec, "wrong")
    assert file == campaign.kept(tmp_path, "first", dict(reversed(spec.items())), "other")  # by what it is, not when
    assert campaign.repeated(Out(tmp_path), file) == "wrong"  # type: ignore[arg-type]
    assert Worker.made[0].asked == [("forks", {"group": "first", "trial": spec})]
    assert clock.now == 100.0
    file = campaign.kept(tmp_path, "first", spec | {"forked": False}, "wrong")
    assert campaign.repeated(Out(tmp_path), file) == "wrong"  # type: ignore[arg-type]
    assert not Worker.made[1].asked
    assert clock.now == 101.0
    assert all(worker.closed for worker in Worker.made)
    for text in (
        "x",
        "[]",
        "{}",
        '{"group": "first"}',
        '{"group": "nobody", "trial": {}}',
        '{"group": "first", "trial": 1}',
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match="keeps no trial of a fault campaign"):
            campaign.repeated(Out(tmp_path), file)  # type: ignore[arg-type]


def test_groups_draw_apart_and_a_seed_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    seen: list[float] = []

    def attempt(spec: dict[str, Any], where: Any, server: Any) -> None:
        clock.now += 1000.0
        seen.append(spec["number"])

    groups = _groups(clock, {"first": 1.0, "second": 1.0})
    monkeypatch.setattr(
        campaign, "GROUPS", {name: campaign.Group(0.5, each.trials, attempt) for name, each in groups.items()}
    )
    for seed in (0, 1, 0):
        campaign.run(Out(tmp_path), ("first", "second"), 1.0, seed, lambda line: None)  # type: ignore[arg-type]
    assert len(set(seen)) == 4
    assert seen[:2] == seen[4:]


# ---- the place


def test_how_a_command_ends_is_at_fault() -> None:
    assert Ended(1, "", "3 of 9 parts\nfirst run: compiles\n\nno\n").said == ["", "no"]
    assert Ended(1, "", " first run: compiles\n3 of 9 parts\nno").said == ["no"]
    assert Ended(None, "", "").fault((0, 1)) is None
    assert Ended(None, "", "").fault((1, 2)) == "not refused: it was still running"
    assert Ended(3, "out", "").fault((1, 2)) == "status 3, not 1 or 2: out"
    assert Ended(3, "out", "err").fault((1, 2)) == "status 3, not 1 or 2: err"
    assert Ended(0, "", "a\nb").fault((0, 1)) is None  # an end that is well may say what it likes
    for status in (1, 2):
        assert Ended(status, "", "x" * 1500).fault((1, 2)) is None
        assert Ended(status, "", "x" * 1501).fault((1, 2)) is not None
        assert Ended(status, "", "").fault((1, 2)) is not None
        assert (
            Ended(status, "", "one\ntwo").fault((1, 2))
            == "2 lines on stderr, of 7 characters, not a short one: one two"
        )
    assert Ended(130, "", "one\ntwo").fault((130,)) is None
    trace = "Traceback (most recent call last)\n  at\nKeyError: 1"
    assert Ended(None, "", trace).fault((0,)) == "traceback: KeyError: 1"
    assert place._short("a\n b" * 2) == "a ba b"
    assert place._short("x" * 299) == "x" * 299
    assert place._short("a" * 140 + "b" * 20 + "c" * 140) == "a" * 140 + " ... " + "c" * 140


def test_contents_are_told_apart_by_name_and_bytes(tmp_path: Path) -> None:
    before = _digests({"a": "1", "b/c": "2", "__pycache__/d": "3"}, tmp_path / "x")
    assert sorted(before) == ["a", "b", "b/c"]
    assert before["b"] == ""
    assert len({*before.values()}) == 3
    assert len(before["a"]) == 64
    same = _digests({"a": "1", "b/c": "2", "more": ""}, tmp_path / "y")
    assert place.changed(before, same) == []
    assert place.changed(before, {"b": "", "b/c": before["a"]}) == ["a deleted", "b/c changed"]


def test_a_copy_is_made_equal_and_left_alone_where_it_is(tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "target"
    _digests({"a.py": "1", "b/c.py": "22", "__pycache__/a.pyc": "", "b/__pycache__/c.pyc": ""}, source)
    place._mirror(source, target)
    copied = place.contents(source)
    assert place.contents(target) == copied
    assert not list(target.rglob("*.pyc"))
    (target / "__pycache__").mkdir()
    (target / "__pycache__" / "a.pyc").touch()
    (target / "odd").mkdir()
    (target / "odd" / "file").touch()
    (target / "odd.py").touch()
    (target / "kept").mkdir()
    (target / "a.py").write_text("333", encoding="utf-8")
    (source / "kept").mkdir()
    (source / "kept" / "new.py").touch()
    place._mirror(source, target, keep=("kept",))
    assert place.contents(target) == copied | {"kept": ""}
    assert (target / "__pycache__" / "a.pyc").exists()
    inode = (target / "b" / "c.py").stat()
    (target / "a.py").write_text("4", encoding="utf-8")  # of the same length, at another time
    os.utime(target / "a.py", (1, 1))
    place._mirror(source, target, keep=("kept",))
    assert (target / "a.py").read_text(encoding="utf-8") == "1"
    assert (target / "b" / "c.py").stat().st_ctime_ns == inode.st_ctime_ns  # not copied again


def test_a_place_copies_the_package_and_clears_what_was_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mirrored: list[tuple[Path, Path, tuple[str, ...]]] = []
    monkeypatch.setattr(place, "_mirror", lambda source, target, keep=(): mirrored.append((source, target, keep)))
    (tmp_path / "work" / "scratch" / "old").mkdir(parents=True)
    found = place.Place(tmp_path)
    code = tmp_path / "work" / "code" / "wayfield"
    parts = ("envs", "policies", "benchmarks")
    assert [(target, keep) for _, target, keep in mirrored] == [(code, parts), *((code / part, ()) for part in parts)]
    assert [source.name for source, *_ in mirrored[1:]] == list(parts)
    assert not list(found.scratch.iterdir())
    assert found.samples.is_dir()
    with found.folder() as one, found.folder() as other:
        assert one.is_dir()
        assert other.is_dir()
        assert one != other
        assert one.parent == found.scratch
    assert not one.exists()
    assert not other.exists()
    monkeypatch.setenv("LANG", "C.UTF-8")
    monkeypatch.setenv("SECRET", "x")
    variables = found.environment("mark", MORE="1", OMP_NUM_THREADS="2")
    home = str(tmp_path / "work" / "home")
    assert Path(home).is_dir()
    assert variables["PATH"] == os.environ["PATH"]
    assert variables["LANG"] == "C.UTF-8"
    assert {name: value for name, value in variables.items() if name not in ("PATH", "LANG", "LD_LIBRARY_PATH")} == {
        "HOME": home,
        "MPLCONFIGDIR": home,
        "MINARI_DATASETS_PATH": f"{home}/minari",
        "PYTHONPATH": str(tmp_path / "work" / "code"),
        "NUMBA_CACHE_DIR": str(tmp_path / "work" / "compiled"),
        "OMP_NUM_THREADS": "2",
        "OMP_WAIT_POLICY": "PASSIVE",
        place.MARK: "mark",
        "MORE": "1",
    }
    assert found._driver("audit") == ["-m", "wayfield.benchmarks.audit"]
    for command in ("tune", "tune.py"):
        script, name = found._driver(command)
        assert name == "tune"
        assert "from wayfield.command import main" in Path(script).read_text(encoding="utf-8")
    own = Path(wayfield.__path__[0]).parent / "evaluate.py"
    assert (found._driver("evaluate.py") == [str(own)]) == own.is_file()


def test_a_place_starts_commands_by_their_marks_and_ends_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(place, "_mirror", lambda *_: None)
    monkeypatch.setattr(place.Place, "restore", lambda self: None)
    lines: list[tuple[Any, ...]] = []
    limits: list[float] = []

    class Seen:
        def __init__(self, *arguments: Any) -> None:
            lines.append(arguments)

        def wait(self, limit: float) -> Ended:
            limits.append(limit)
            return WELL

    ended: list[str] = []
    monkeypatch.setattr(place, "Running", Seen)
    monkeypatch.setattr(place, "end_marked", ended.append)
    monkeypatch.setattr(place, "on_cores", lambda count, before: (count, before))
    found = place.Place(tmp_path)
    assert found.run("audit", ["-x"], tmp_path, before=len, output="pipe", environment={"A": "1"}) == WELL  # type: ignore[arg-type]
    found.run("train", ["id"], tmp_path, 7.0, before=len)  # type: ignore[arg-type]
    found.warm("audit", [], tmp_path)
    assert limits == [60.0, 7.0, 600.0]
    line, mark, folder, variables, scratch, before, output = lines[0]
    assert line == [sys.executable, "-m", "wayfield.benchmarks.audit", "-x"]
    assert (folder, scratch, before, output) == (tmp_path, found.scratch, len, "pipe")
    assert variables["A"] == "1"
    assert variables[place.MARK] == mark
    assert lines[1][5] == (2, len)
    assert lines[1][6] == ""
    marks = [each[1] for each in lines]
    assert len(set(marks)) == 3
    found.close()
    assert ended == marks
    assert not found.scratch.exists()


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="looks processes up as Linux shows them")
def test_a_command_runs_is_sent_signals_and_is_ended_with_all_it_started(tmp_path: Path) -> None:
    def started(script: str, output: str = "", before: Callable[[], None] | None = None) -> place.Running:
        mark = f"test-{os.getpid()}-{len(list(tmp_path.iterdir()))}"
        variables = {"PATH": os.environ["PATH"], place.MARK: mark}
        return place.Running(["/bin/sh", "-c", script], mark, tmp_path, variables, tmp_path, before, output)

    running = started('echo out; echo "err$PWD" >&2; exit 3', before=lambda: os.chdir("/"))
    assert running.wait(20.0) == Ended(3, "out\n", "err/\n")
    running = started("echo $$; exec sleep 50")
    assert not running.ends_within(0.0)
    assert not running.ended()
    running.send(signal.SIGINT)  # which a shell's jobs in the background would not hear
    assert running.ends_within(20.0)
    assert running.ended()
    assert running.left() == []
    assert running.wait(1.0).status == -signal.SIGINT
    running.send(signal.SIGINT)  # to nobody
    running = started("sleep 51 & sleep 52")
    assert running.wait(0.05).status is None
    assert not list(place._marked(running.mark))
    # once the shell's child is what it runs
    running = started("sleep 53 & until grep -q ^sleep /proc/$!/cmdline; do sleep 0.01; done; exit 0")
    assert running.ends_within(20.0)
    assert [line.strip() for line in place.left_running(running.mark, 0.0)] == ["sleep 53"]
    place.end_marked(running.mark)
    assert not place.left_running(running.mark, 0.0)
    assert started("echo x || exit 9", "closed").wait(20.0).status in (1, 9)
    assert started("trap '' PIPE; echo x || exit 9", "pipe").wait(20.0).status == 9
    assert place.computed(os.getpid()) == pytest.approx(sum(os.times()[:2]), abs=0.5)
    assert place.computed(2**30) == 0.0


def test_a_process_is_ended_that_is_not_seen_while_it_begins_a_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans = iter([[7], [], [7, 8], [], []])
    killed: list[tuple[int, int]] = []
    with monkeypatch.context() as patched:
        patched.setattr(place, "_marked", lambda _: next(scans))
        patched.setattr(place.os, "kill", lambda *asked: killed.append(asked))
        patched.setattr(place.time, "sleep", lambda _: None)
        place.end_marked("a")
    assert killed == [(7, signal.SIGKILL), (7, signal.SIGKILL), (8, signal.SIGKILL)]
    assert next(scans, None) is None
    monkeypatch.setattr(place, "_marked", lambda _: ())  # all of them at once
    variables = {"PATH": os.environ["PATH"], place.MARK: "b"}
    running = place.Running(["/bin/sh", "-c", "sleep 9 & sleep 8"], "b", tmp_path, variables, tmp_path, None, "")
    begun = time.monotonic()
    assert running.wait(0.1).status is None
    assert running.process.returncode == -signal.SIGKILL
    assert time.monotonic() - begun < 7.0


def test_a_command_keeps_to_some_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[set[int]] = []
    done: list[str] = []
    monkeypatch.setattr(place.os, "sched_getaffinity", lambda _: {3, 5, 9}, raising=False)
    monkeypatch.setattr(place.os, "sched_setaffinity", lambda _, cores: taken.append(set(cores)), raising=False)
    for number in range(3):
        monkeypatch.setattr(place.os, "getpid", lambda number=number: number)
        place.on_cores(2, lambda: done.append("before"))()
        place.on_cores(1)()
    assert taken == [{3, 5}, {3}, {5, 9}, {5}, {9, 3}, {9}]
    assert done == ["before"] * 3


# ---- what a run leaves


def test_a_reference_is_what_the_second_of_two_runs_leaves(tmp_path: Path) -> None:
    work = Pretence(tmp_path, _writes(CONTEST))
    found = runs.reference("contest", work)
    wanted = _digests(CONTEST, tmp_path / "wanted")
    assert isinstance(found, tuple)
    assert found[0] == wanted
    assert 0.0 <= found[1] < 5.0
    run = runs.RUNS["contest"]
    assert work.warmed == ["evaluate"]
    assert work.started == [("evaluate", (*run.arguments, "--out", "out"))]
    assert work.limits == [runs.LIMIT]
    assert runs.reference("contest", work) is found or runs.reference("contest", work) == found
    assert len(work.started) == 1  # known
    fails = Pretence(tmp_path / "wanted", _writes({}, Ended(4, "", "why")))
    assert runs.reference("tuning", fails) == "undisturbed it ends with status 4: why"
    assert not fails.references


def test_results_differ_by_bytes_and_by_names(tmp_path: Path) -> None:
    wanted = _digests(CONTEST, tmp_path / "wanted")
    cases: dict[str, tuple[dict[str, str], str | None]] = {
        "same": (CONTEST, None),
        "other": (CONTEST | {"episodes.csv": "x"}, "episodes.csv differs from the undisturbed run"),
        "less": ({"episodes.csv": "a"}, "trajectories.npz is missing, unlike in the undisturbed run"),
        "more": (CONTEST | {"odd": "", "tensorboard.log": ""}, "leaves other files: odd"),
        "table": (CONTEST | {"table.md": "another"}, None),  # which may name the command
        "none": (
            {name: CONTEST[name] for name in ("episodes.csv", "trajectories.npz")},
            "leaves other files: table.md",
        ),
    }
    for name, (files, said) in cases.items():
        _digests(files, tmp_path / name)
        assert runs.differs("contest", tmp_path / name, wanted) == said
    for name, run in runs.RUNS.items():
        assert run.line == [*run.arguments, "--out", run.out]
        assert run.results
        assert run.out == ("out/gains.json" if run.command == "tune" else "out")
        given = dict(zip(run.arguments, run.arguments[1:], strict=False))
        if run.command != "train":
            assert given["--workers"] == ("1" if "in one process" in name else "2")
        if run.command == "evaluate":
            assert given["--episodes"] == ("1" if "in one process" in name else "2")
        else:
            assert len(run.results) == int(given.get("--seeds", "1"))
    assert runs.RUNS["training"].results[1] == "seed_1/best/weights.safetensors"
    assert all(each in runs.RUNS for each in runs.FORKED.values())
    assert runs.FORKED["one training"] == "one training"


def test_a_run_is_run_again_until_it_is_done(tmp_path: Path) -> None:
    wanted = _digests(CONTEST, tmp_path / "wanted")
    line = tuple(runs.RUNS["contest"].line)
    work = Pretence(tmp_path, _writes({}, Ended(1, "", "there is no run to resume")), _writes(CONTEST))
    with work.folder() as folder:
        assert runs.finished("contest", work, folder, wanted, ["--resume"]) is None
    assert work.started == [("evaluate", (*line, "--resume")), ("evaluate", line)]
    assert set(work.limits) == {runs.LIMIT}
    for arguments, said in (((), "no run to resume"), (("--resume",), "other")):
        work = Pretence(tmp_path / "wanted", _writes({}, Ended(1, "", f"a  {said}")), _writes(CONTEST))
        with contextlib.suppress(FileExistsError), work.folder() as folder:
            assert (
                runs.finished("contest", work, folder, wanted, arguments)
                == f"run again it ends with status 1: a {said}"
            )
            assert len(work.started) == 1
        (tmp_path / "wanted" / "folder_1").rename(tmp_path / f"used{len(arguments)}")
    for name in ("a/unfinished/p/rows.json", "a/unfinished/.q/rows.json", "b/rows.json"):
        (tmp_path / "out" / name).parent.mkdir(parents=True)
        (tmp_path / "out" / name).touch()
    assert runs.parts_of(tmp_path) == [tmp_path / "out" / name for name in ("a/unfinished/p/rows.json", "b/rows.json")]


# ---- kills


def _kill(
    tmp_path: Path, spec: dict[str, Any], files: dict[str, str], *acts: Act, **state: Any
) -> tuple[Any, Pretence]:
    work = Pretence(tmp_path, *acts)
    for name, value in state.items():
        setattr(work, name, value)
    wanted = _digests(files, tmp_path / "wanted")
    work.references[spec["run"]] = wanted, 10.0
    return kills.attempt(spec, work, None), work


def test_a_killed_run_must_end_leave_nobody_and_be_done_again(tmp_path: Path) -> None:
    folders = (tmp_path / str(k) for k in range(20))

    def tried(spec: dict[str, Any], files: dict[str, str], *acts: Act, **state: Any) -> tuple[Any, Pretence]:
        here = next(folders)
        here.mkdir()
        return _kill(here, spec, files, *acts, **state)

    spec = {"run": "contest", "signal": "SIGTERM", "at": [0.3, 0.6]}
    nothing = _writes({}, Ended(-15, "", ""))
    said, work = tried(spec, CONTEST, nothing, nothing, _writes(CONTEST))
    assert said is None
    assert work.sent == [signal.SIGTERM] * 2
    assert work.waited == [3.0, 30.0, 6.0, 30.0]
    assert work.limits == [runs.LIMIT] * 3
    assert len(work.started) == 3
    said, work = tried(spec, CONTEST, nothing, obeys=False)
    assert said == "SIGTERM does not end it within 30 s"
    assert work.limits == [0.0]
    said, work = tried(spec, CONTEST, nothing, orphans=["sh -c", "b"])
    assert said == "SIGTERM leaves 2 processes running: sh -c"
    assert work.limits == [0.0]
    said, _ = tried(spec, CONTEST, _writes({}, Ended(1, "", "Traceback\nKeyError: 'x'\n")))
    assert said == "traceback after SIGTERM: KeyError: 'x'"
    said, _ = tried(spec, CONTEST, nothing, nothing, _writes(CONTEST | {"episodes.csv": "x"}))
    assert said == "episodes.csv differs from the undisturbed run"
    # a search that was done before it was killed would refuse to be done again
    tuned = {"run": "tuning", "signal": "SIGKILL", "at": [0.9, 0.9]}
    for there, wrong in ((TUNED, None), ({"gains.json": "x"}, "gains.json differs from the undisturbed run")):
        said, work = tried(tuned, TUNED, _writes(there))
        assert said == wrong
        assert len(work.started) == 1
        assert work.sent == [signal.SIGKILL]
    # a training goes on where it was, if it had begun
    weights = {"seed_0/best/weights.safetensors": "w"}
    trained = {"run": "one training", "signal": "SIGINT", "at": [0.5]}
    for first, more in ((weights, ("--resume",)), ({}, ())):
        said, work = tried(trained, weights, _writes(first), _writes(weights))
        line = tuple(runs.RUNS["one training"].line)
        assert said is None
        assert work.started == [("train", line), ("train", (*line, *more))]
    broken = Pretence(tmp_path, _writes({}, Ended(9, "", "e")))
    broken.warm = lambda *_: None  # type: ignore[method-assign]
    assert kills.attempt(spec, broken, None) == "undisturbed it ends with status 9: e"


ROWS = '[{"policy": "lqr", "success": "1", "x": "2"}]'


def _damage(damage: str, after: dict[str, str], seen: list[tuple[str, bytes | None]], end: Ended = WELL) -> list[Act]:
    part = {"unfinished/p/rows.json": ROWS, "unfinished/p/trajectories.npz": "T" * 200}

    def again(folder: Path, line: Sequence[str]) -> Ended:
        here = folder / "out" / "unfinished" / "p"
        drawn = here / "trajectories.npz"
        seen.append(
            ((here / "rows.json").read_bytes().decode("latin-1"), drawn.read_bytes() if drawn.exists() else None)
        )
        for file in sorted((folder / "out").rglob("*"), reverse=True):
            file.rmdir() if file.is_dir() else file.unlink()
        return _writes(after, end)(folder, line) or WELL

    return [_writes(part), again]


@pytest.mark.parametrize("damage", ["number", "truncate", "flip", "delete"])
def test_a_damaged_part_is_driven_again_or_refused(tmp_path: Path, damage: str) -> None:
    seen: list[tuple[str, bytes | None]] = []
    said, work = _kill(tmp_path, {"run": "contest", "damage": damage}, CONTEST, *_damage(damage, CONTEST, seen))
    assert said is None
    assert work.limits == [0.0, runs.LIMIT]
    ((rows, drawn),) = seen
    if damage == "number":
        assert json.loads(rows) == [{"policy": "lqr", "success": "0.25", "x": "2"}]
        assert drawn == b"T" * 200
    elif damage == "truncate":
        assert rows == ROWS
        assert drawn == b"T" * 100
    elif damage == "flip":
        where = len(ROWS) // 2
        assert rows == ROWS[:where] + chr(ord(ROWS[where]) ^ 128) + ROWS[where + 1 :]
        assert drawn == b"T" * 200
    else:
        assert rows == ROWS
        assert drawn is None


@pytest.mark.parametrize(
    ("after", "end", "said"),
    [
        (CONTEST | {"episodes.csv": "x"}, WELL, "episodes.csv differs from the undisturbed run"),
        ({}, Ended(1, "", "the part is damaged"), None),
        ({}, Ended(2, "", "no"), "status 2, not 0 or 1: no"),
    ],
)
def test_what_follows_a_damaged_part(tmp_path: Path, after: dict[str, str], end: Ended, said: str | None) -> None:
    spec = {"run": "contest", "damage": "flip"}
    assert _kill(tmp_path, spec, CONTEST, *_damage("flip", after, [], end))[0] == said


def test_a_run_that_is_done_before_a_part_is_seen_is_not_damaged(tmp_path: Path) -> None:
    said, work = _kill(tmp_path, {"run": "contest", "damage": "flip"}, CONTEST, _writes({}), over=True)
    assert said is None
    assert len(work.started) == 1


# ---- several in one folder


def test_of_two_in_one_folder_one_ends_well_and_its_results_are_there(tmp_path: Path) -> None:
    folders = (tmp_path / str(k) for k in range(20))

    def tried(second: str, first_end: Ended, second_end: Ended, files: dict[str, str], **more: Any) -> Any:
        here = next(folders)
        here.mkdir()
        work = Pretence(here, _writes({}, first_end), _writes(files, second_end))
        wanted = _digests(CONTEST, here / "wanted")
        work.references = {"contest": (wanted, 10.0), second: (wanted, 10.0)}
        found = together.attempt({"first": "contest", "second": second, "delay": 0.0} | more, work, None)
        assert [command for command, _ in work.started] == ["evaluate"] * 2
        return found

    no = Ended(1, "", "another run works here")
    assert tried("contest", WELL, no, CONTEST) is None
    assert tried("contest", WELL, WELL, CONTEST) is None
    assert tried("contest", no, no, CONTEST) == "neither ends well: another run works here / another run works here"
    assert tried("another contest", no, WELL, CONTEST) is None
    assert "two different runs end well in one folder" in tried("another contest", WELL, WELL, CONTEST)
    assert tried("contest", WELL, no, {"episodes.csv": "x"}) == "episodes.csv differs from the undisturbed run"
    assert tried("contest", WELL, Ended(1, "", "one\ntwo"), CONTEST).startswith("2 lines on stderr")
    assert tried("contest", WELL, Ended(5, "", "five"), CONTEST) == "status 5, not 0 or 1 or 2: five"


def test_a_training_that_was_cut_is_resumed_by_both(tmp_path: Path) -> None:
    weights = {"seed_0/best/weights.safetensors": "w"}
    for begun in (True, False):
        here = tmp_path / str(begun)
        here.mkdir()
        work = Pretence(here, _writes({"seed_0/run.json": ""} if begun else {}), _writes(weights))
        work.references["one training"] = (
            _digests(weights | ({"seed_0/run.json": ""} if begun else {}), here / "w"),
            10.0,
        )
        spec = {"first": "one training", "second": "one training", "delay": 0.0, "cut": 0.7}
        assert together.attempt(spec, work, None) is None
        assert work.limits[0] == 7.0
        assert len(work.started) == 3
        assert [line[-1] == "--resume" for _, line in work.started] == [False, begun, begun]


def test_another_run_leaves_the_parts_of_the_first(tmp_path: Path) -> None:
    part = {"unfinished/p/rows.json": ROWS}

    def loses(folder: Path, line: Sequence[str]) -> Ended:
        (folder / "out" / "unfinished" / "p" / "rows.json").unlink()
        return WELL

    for k, (second, over, said, begun) in enumerate(
        (
            (_writes({}), False, None, 2),
            (loses, False, "1 parts of the other run are lost", 2),
            (_writes({}, Ended(7, "", "seven")), False, "status 7, not 0 or 1 or 2: seven", 2),
            (loses, True, None, 1),
        )
    ):
        here = tmp_path / str(k)
        here.mkdir()
        work = Pretence(here, _writes({} if over else part), second)
        work.over = over
        work.references = {"contest": ({}, 1.0), "another contest": ({}, 1.0)}
        spec = {"first": "contest", "second": "another contest", "parts": True}
        assert together.attempt(spec, work, None) == said
        assert len(work.started) == begun
        assert work.limits == [0.0, runs.LIMIT][:begun] * (begun - 1)


# ---- files of others, disks, wrong lines


def test_files_of_somebody_else_stay_as_they_are(tmp_path: Path) -> None:
    def harms(folder: Path, line: Sequence[str]) -> Ended:
        (folder / "out" / "table.md").write_text("mine", encoding="utf-8")
        return WELL

    for k, (act, more, said) in enumerate(
        (
            (_writes({"episodes.csv": "new"}), {}, None),
            (harms, {}, "somebody else's out/table.md changed"),
            (_writes({}, Ended(1, "", "a\nb")), {}, "2 lines on stderr, of 3 characters, not a short one: a b"),
            (_writes({}, Ended(3, "", "a")), {}, "status 3, not 0 or 1 or 2: a"),
        )
    ):
        for run in ("contest", "path", "one training"):
            here = tmp_path / f"{k}{run}"
            here.mkdir()
            work = Pretence(here, act)
            spec = {"run": run, "names": ["table.md", "deep/er"], **more}
            assert foreign.attempt(spec, work, None) == said
            ((command, line),) = work.started
            assert command == ("train" if "training" in run else "evaluate")
            assert work.limits == [runs.LIMIT]
            assert line[line.index("--out") + 1] == "out"
            assert (here / "folder_1" / "out" / "deep" / "er").read_text(encoding="utf-8") == "somebody else's\n"
            assert (here / "folder_1" / "way.csv").exists() == (run == "path")
    work = Pretence(tmp_path, _writes({}))
    foreign.attempt({"run": "contest", "names": ["x"], "content": "{}", "forked": True}, work, None)
    assert work.started == [("evaluate", tuple(runs.RUNS["contest in one process"].line))]
    assert (tmp_path / "folder_1" / "out" / "x").read_text(encoding="utf-8") == "{}"


def test_every_name_is_tried_alone_then_two_that_do_not_hold_each_other() -> None:
    drawn = foreign.trials(random.Random(0))
    every = {(run, name) for run, names in foreign._NAMES.items() for name in names}
    alone = [next(drawn) for _ in every]
    assert {(each["run"], *each["names"]) for each in alone} == every
    assert [not each["forked"] for each in alone[:3]] == [True] * 3
    assert all(each["forked"] for each in alone[3:])
    for _ in range(200):
        pair = next(drawn)
        a, b = pair["names"]
        assert pair["forked"]
        assert {a, b} <= set(foreign._NAMES[pair["run"]])
        assert a != b
        assert not f"{a}/".startswith(f"{b}/")
        assert not f"{b}/".startswith(f"{a}/")


def test_a_disk_that_is_full_or_closed_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mounted: list[tuple[str, int]] = []

    def mount(folder: Path, size: int, stack: Any) -> bool:
        mounted.append((folder.name, size))
        return size > 0

    monkeypatch.setattr(disk, "_mounted", mount)

    def loses(folder: Path, line: Sequence[str]) -> Ended:
        (folder / "out" / "notes.txt").unlink()
        return WELL

    refused = Ended(1, "", "no room")
    cases: tuple[tuple[dict[str, Any], Act, str | None], ...] = (
        ({"how": "full", "size": 4096}, _writes({}, refused), None),
        ({"how": "full", "size": 4096}, _writes({}), None),
        ({"how": "limit", "size": 100}, loses, "notes.txt deleted, which was there before"),
        ({"how": "limit", "size": 100}, _writes({}, Ended(5, "", "x")), "status 5, not 0 or 1 or 2: x"),
        ({"how": "read-only"}, _writes({}, refused), None),
        ({"how": "read-only"}, lambda folder, line: None, "status 0, not 1 or 2: "),
    )
    for k, (spec, act, said) in enumerate(cases):
        here = tmp_path / str(k)
        here.mkdir()
        work = Pretence(here, (lambda folder, line: refused) if spec["how"] == "read-only" and said is None else act)
        work.references["contest"] = {}, 1.0
        assert disk.attempt({"run": "contest"} | spec, work, None) == said
        (keywords,) = work.keywords
        assert (keywords["before"] is None) == (spec["how"] == "full")
        assert work.limits == [runs.LIMIT]
        assert (keywords["before"] is disk._without_override) == (spec["how"] == "read-only")
        out = here / "folder_1" / "out"
        assert out.stat().st_mode & 0o777 == 0o755 or spec["how"] != "read-only"  # open again
    assert mounted == [("out", 4096)] * 2
    work = Pretence(tmp_path, _writes({}))
    work.references["contest"] = {}, 1.0
    assert disk.attempt({"run": "contest", "how": "full", "size": 0}, work, None) is None
    assert not work.started
    set_to: list[Any] = []
    monkeypatch.setattr(disk.resource, "setrlimit", lambda *what: set_to.append(what))
    disk._limited(123)()
    assert set_to == [(disk.resource.RLIMIT_FSIZE, (123, 123))]


def test_disks_are_mounted_in_whole_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[list[str]] = []

    class Mounted:
        returncode = 0

    def run(line: list[str], **_: Any) -> Mounted:
        lines.append(line)
        return Mounted()

    monkeypatch.setattr(disk.subprocess, "run", run)
    monkeypatch.setattr(disk.os, "geteuid", lambda: 0)
    for size, pages in ((0, 1), (1, 1), (4096, 1), (20_000, 4)):
        lines.clear()
        with contextlib.ExitStack() as stack:
            assert disk._mounted(tmp_path, size, stack)
            assert len(lines) == 1
            assert f"nr_blocks={pages},nr_inodes=64" in lines[0]
            assert lines[0][-1] == str(tmp_path)
            full = tmp_path / "full"
            assert full.exists() == (size == 0)
            if not size:
                assert full.stat().st_size == 4096
                full.unlink()
        assert lines[1] == ["umount", "-l", str(tmp_path)]
    Mounted.returncode = 1
    with contextlib.ExitStack() as stack:
        lines.clear()
        assert not disk._mounted(tmp_path, 1, stack)
    assert len(lines) == 1
    monkeypatch.setattr(disk.os, "geteuid", lambda: 1)
    assert not disk._mounted(tmp_path, 1, contextlib.ExitStack())
    assert len(lines) == 1


def test_a_command_starts_where_nothing_can_be_written(tmp_path: Path) -> None:
    for command, word in (("evaluate", "-h"), ("train", "--help")):
        here = tmp_path / command
        (here / "code" / "deep").mkdir(parents=True)
        modes: list[int] = []

        def act(folder: Path, line: Sequence[str], here: Path = here, modes: list[int] = modes) -> Ended:
            modes.extend(each.stat().st_mode & 0o777 for each in (folder, here / "code", here / "code" / "deep"))
            return Ended(3, "", "x") if here.name == "train" else WELL

        work = Pretence(here, act)
        work.code = here / "code"
        said = disk.attempt({"run": command, "how": "no cache"}, work, None)
        assert said == (None if command == "evaluate" else "status 3, not 0: x")
        assert work.started == [(command, (word,))]
        assert modes == [0o555] * 3
        assert work.limits == [runs.LIMIT]
        assert work.keywords[0]["environment"]["HOME"] == str(here / "folder_1")
        assert work.keywords[0]["before"] is disk._without_override
        assert {each.stat().st_mode & 0o777 for each in (here / "folder_1", here / "code", here / "code" / "deep")} == {
            0o755
        }


class Asked:
    def __init__(self, answer: str | None) -> None:
        self.answer = answer
        self.specs: list[dict[str, Any]] = []

    def ask(self, module: str, spec: dict[str, Any]) -> str | None:
        assert module == "commands"
        self.specs.append(spec)
        return self.answer


def test_a_wrong_line_writes_nothing_and_leaves_what_ships(tmp_path: Path) -> None:
    for name in ("policies/gains", "envs/scenarios/splits"):
        (tmp_path / "wayfield" / name).mkdir(parents=True)
        (tmp_path / "wayfield" / name / "a").write_text("1", encoding="utf-8")
    (tmp_path / "work").mkdir()
    work = Pretence(tmp_path, lambda folder, line: None)
    server = Asked(None)
    spec = {"command": "onnx", "arguments": ["AGENT", "FILE", "x"], "allowed": [1, 2]}
    assert commands.attempt(spec, work, server) is None
    (asked,) = server.specs
    agent, way, other = asked["arguments"]
    assert agent.endswith("agents/goal_reaching_p3dx/seed_0")
    assert Path(way).is_file()
    assert other == "x"
    assert asked["folder"] == str(tmp_path / "folder_1")
    assert asked["command"] == "onnx"
    assert commands.attempt(spec, work, Asked("bad")) == "bad"

    def writes(folder: Path, line: Sequence[str]) -> Ended:
        for k in range(7):
            (folder / f"f{k}").touch()
        return Ended(2, "", "no")

    work.acts = [writes]
    own = spec | {"own": True}
    assert commands.attempt(own, work, None) == "wrote f0, f1, f2, f3, f4"
    assert commands.attempt(own | {"writes": True}, work, None) is None
    assert commands.attempt(own | {"allowed": [0], "writes": True}, work, None) == "status 2, not 0: no"

    def rewrites(folder: Path, line: Sequence[str]) -> Ended:
        (tmp_path / "wayfield" / "policies/gains" / "a").write_text("2", encoding="utf-8")
        return Ended(2, "", "no")

    work.acts = [rewrites]
    assert commands.attempt(own, work, None) == "rewrites what ships: policies/gains/a changed"
    assert work.restored == 1


def test_a_line_of_its_own_is_interrupted_and_says_so_in_one_line(tmp_path: Path) -> None:
    def tried(end: Ended, **spec: Any) -> tuple[str | None, Pretence]:
        work = Pretence(tmp_path, lambda folder, line: end)
        return commands._own({"command": "tune", "allowed": [0, 130]} | spec, ["a", "\udcff"], work, tmp_path), work

    said, work = tried(WELL)
    assert said is None
    assert work.limits == [120.0]
    assert not work.sent
    assert work.started == [("tune", ("a", b"\xff"))]  # type: ignore[comparison-overlap]
    assert work.keywords == [{"output": "", "environment": None}]
    said, work = tried(Ended(130, "", "tune: interrupted"), interrupt=0.6, output="pipe", environment={"A": "1"})
    assert said is None
    assert work.sent == [signal.SIGINT]
    assert work.waited == [0.6]
    assert work.limits == [40.0]
    assert work.keywords == [{"output": "pipe", "environment": {"A": "1"}}]
    assert tried(WELL, limit=5.0)[1].limits == [5.0]
    assert tried(Ended(None, "", ""), interrupt=0.1)[0] == "Ctrl-C does not end it"
    assert tried(Ended(None, "", ""))[0] is None
    assert tried(Ended(130, "", "a\nb"), interrupt=0.1)[0] == "2 lines about an interruption"
    assert tried(Ended(130, "", ""), interrupt=0.1)[0] == "0 lines about an interruption"
    assert tried(Ended(0, "", "a\nb"), interrupt=0.1)[0] is None
    assert tried(Ended(3, "", "a"), interrupt=0.1)[0] == "status 3, not 0 or 130: a"


def test_a_refusal_may_not_take_long(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    clock = Clock()
    made: list[tuple[Any, ...]] = []
    state: dict[str, Any] = {"end": Ended(2, "", "no"), "took": 0.0, "limit": None}

    class Forked:
        def __init__(self, *arguments: Any) -> None:
            made.append(arguments)

        def wait(self, limit: float) -> Ended:
            clock.now += state["took"]
            state["limit"] = limit
            found: Ended = state["end"]
            return found

    monkeypatch.setattr(commands, "time", clock)
    monkeypatch.setattr(commands, "Fork", Forked)
    spec = {"command": "tune", "arguments": ["x"], "folder": str(tmp_path), "allowed": [1, 2]}
    for took, more, said in (
        (15.0, {}, None),
        (15.5, {}, "refused only after 16 s of work"),
        (9.0, {"quick": 8.0}, "refused only after 9 s of work"),
        (99.0, {"allowed": [0, 2]}, None),
        (99.0, {"allowed": [1]}, "status 2, not 1: no"),
    ):
        state["took"] = took
        assert commands.inside(spec | more) == ({} if said is None else {"problem": said})
        assert state["limit"] == 15.0
    commands.inside(spec | {"limit": 90.0})
    assert state["limit"] == 90.0
    assert made[0] == ("tune", ["x"], tmp_path)


def test_what_an_option_surely_refuses() -> None:
    def wrong(kind: click.ParamType, *texts: str) -> list[str]:
        return [text for text in texts if commands._is_wrong(click.Option(["--x"], type=kind), text)]

    texts = ("x", "", "nan", "-inf", "inf", "1" * 400, "1.5", "0", "1", "2", "3", "-1")
    assert wrong(click.IntRange(1, 2), *texts) == ["x", "", "nan", "-inf", "inf", "1" * 400, "1.5", "0", "3", "-1"]
    assert wrong(click.IntRange(0, min_open=True), "0", "1", "-1") == ["0", "-1"]
    assert wrong(click.IntRange(max=2), "2", "3", "-9") == ["3"]
    assert wrong(click.FloatRange(1.0, 2.0), *texts) == ["x", "", "nan", "-inf", "inf", "1" * 400, "0", "3", "-1"]
    assert wrong(click.FloatRange(0.0, min_open=True), "0", "0.1") == ["0"]
    assert wrong(click.INT, "1", "-1", "x", "1.5", "", "nan") == ["x", "1.5", "", "nan"]
    assert wrong(click.Choice(["a", "b"]), "a", "c") == ["c"]
    assert wrong(Names("--x", ("a", "b")), "a", "a, b", "a,c", "") == ["a,c", ""]
    assert wrong(click.STRING, "x", "", "nan") == []
    ratio = click.types.StringParamType()
    ratio.name = "number or ratio"
    assert wrong(ratio, "x", "", " ", "nan", "-1", "0", "1.5", "1e3") == ["x", "", " ", "nan", "-1", "0"]


def test_lines_with_one_thing_wrong_are_of_every_kind() -> None:
    for command, right in commands.COMMANDS.items():
        options = [
            each for each in place.found(command).params if isinstance(each, click.Option) and each.name != "help"
        ]
        flags = {flag for each in options for flag in each.opts}
        lines = [commands._wrong(command, random.Random(k))["arguments"] for k in range(150)]
        behind = [line[len(right) :] for line in lines if line[: len(right)] == list(right)]
        assert ["one", "too", "many"] in behind
        assert any(each[:1] == ["--nothing"] for each in behind)
        if any(not each.is_flag for each in options):
            assert any(len(each) == 1 and each[0] in flags for each in behind)  # its value is missing
            refuses = any(
                commands._is_wrong(each, text) for each in options if not each.is_flag for text in commands._TYPED
            )
            typed = any(len(each) == 2 and each[0] in flags and each[1] not in flags for each in behind)
            assert typed == refuses
        if right:
            assert [] in lines
            assert any(line[0] == "" for line in lines if line)
        for each in options:
            bare = [line for line in behind if line and line[0] in each.opts]
            assert not each.is_flag or not bare  # which would be right
            assert not each.is_flag or any(line == [f"{each.opts[0]}=1"] for line in behind) or len(options) > 8


def test_what_is_not_as_in_a_fork_is_tried_in_a_process_of_its_own() -> None:
    # one that has the package loaded has its locale, its output and its signals already
    for command, line, allowed, how in commands._LISTED:
        # nor do the forks know commands that have no table of options here
        if {"environment", "output", "interrupt"} & {*how} or command not in commands.COMMANDS:
            assert how["own"] is True, (command, line)
        assert {*allowed} <= {0, 1, 2, 130, 141}
        assert (130 in allowed) == ("interrupt" in how)
        assert (141 in allowed) == (how.get("output") == "pipe")
