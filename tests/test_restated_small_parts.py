"""Small parts of the environments, stated once more: blocks of obstacles, checks of values, engines, a cluster's."""

import contextlib
import math
import re
import signal
import types
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wayfield.envs import blocks, checks, cluster, crew, engines, grids
from wayfield.envs.crew import bounds
from wayfield.envs.geometry import OBSTACLE
from wayfield.envs.scenarios.tables import path_from_table

# Blocks of obstacles.


def scattered(rng: np.random.Generator, count: int) -> Any:
    field = np.zeros(count, OBSTACLE)
    field["x"], field["y"] = rng.uniform(-20, 20, count), rng.uniform(-5, 9, count)
    field["cos"] = 1.0
    for name in ("half_length", "half_width", "radius"):
        field[name] = rng.uniform(0.0, 0.5, count)
    return field


def halved(part: Any) -> None:
    """Asserts that a part is halved across where it is wide, the first half of whole blocks, twice as many each."""
    if len(part) <= 16:
        return
    half = 16 * 2 ** (math.ceil(math.log2(len(part) / 16)) - 1)
    across = "x" if np.ptp(part["x"]) >= np.ptp(part["y"]) else "y"
    assert part[across][:half].max() <= part[across][half:].min()
    halved(part[:half])
    halved(part[half:])


@pytest.mark.parametrize("count", [129, 144, 200, 256, 257, 700])
def test_many_obstacles_are_halved_into_blocks_with_discs_around_them(count: int) -> None:
    rng = np.random.default_rng(count)
    fields = np.zeros((3, count), OBSTACLE)
    counts = np.array([count, 128, count - 1])
    for row, number in zip(fields, counts, strict=True):
        row[:number] = scattered(rng, number)
    placed, found = blocks.in_blocks(fields, counts)
    assert found.tolist() == [math.ceil(count / 16), 0, math.ceil((count - 1) / 16) if count > 129 else 0]
    assert placed[1, :128].tolist() == fields[1, :128].tolist()
    whole = math.ceil(count / 16)
    assert placed.shape == (3, count + whole + math.ceil(whole / 16))
    for row, number, many in zip(placed, counts.tolist(), found.tolist(), strict=True):
        if not many:
            continue
        assert sorted(row[:number].tolist()) == sorted(fields[0 if number == count else 2, :number].tolist())
        halved(row[:number])
        of_blocks, of_many = row[number : number + many], row[number + many : number + many + math.ceil(many / 16)]
        for discs, inside in ((of_blocks, row[:number]), (of_many, of_blocks)):
            for k, disc in enumerate(discs):
                part = inside[16 * k : 16 * k + 16]
                x, y = (0.5 * (part[a].min() + part[a].max()) for a in "xy")
                far = np.hypot(part["x"] - x, part["y"] - y) + part["half_length"] + part["half_width"] + part["radius"]
                assert (disc["x"], disc["y"]) == (x, y)
                assert disc["radius"] == pytest.approx(far.max(), rel=2e-9)
                assert disc["radius"] >= far.max()
                assert (disc["cos"], disc["sin"], disc["half_length"], disc["half_width"]) == (1.0, 0.0, 0.0, 0.0)
    few, none = blocks.in_blocks(fields[:, :128], np.array([128, 5, 0]))
    assert not none.any()
    assert few.shape == (3, 128)


def test_rows_are_shared_out_alike_in_blocks_that_are_not_small() -> None:
    for rows in (1, 31, 32, 63, 64, 100, 1000):
        for most in (1, 2, 3, 8):
            found = bounds(rows, most)
            assert len(found) == max(1, min(most, rows // 32))
            assert [first for first, _ in found] + [rows] == [0] + [last for _, last in found]
            sizes = [last - first for first, last in found]
            assert max(sizes) - min(sizes) <= 1


def test_a_crew_has_as_many_threads_as_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[str] = []
    thread = types.SimpleNamespace(start=lambda: None)
    monkeypatch.setattr(crew.threading, "Thread", lambda **kwargs: begun.append(kwargs["name"]) or thread)
    for count in (1, 2, 5):
        begun.clear()
        assert len(crew.crew.__wrapped__(count)._coming.shares) == len(crew.shares_of(count))
        assert len(begun) == count - 1


# Grids.


def test_a_ray_from_beyond_a_grid_enters_it_by_a_side() -> None:
    rng = np.random.default_rng(6)
    rows, columns, met = 4, 7, 0
    for _ in range(400):
        u, v = rng.choice([-3.0, -0.05, 0.5, 2.5, 6.5, 7.05, 9.0], 1)[0], rng.choice([-2.0, -0.05, 0.5, 3.5, 4.05, 6.0])
        if 0.0 <= u <= columns and 0.0 <= v <= rows:
            continue
        angle = rng.choice([0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi, rng.uniform(-3.0, 3.0)])
        du, dv = (round(math.cos(angle), 15), round(math.sin(angle), 15))
        gone, row, column = grids.entry.py_func(rows, columns, u, v, du + 0.0, dv + 0.0)
        # where it is within the sides of either direction at once
        low, high = 0.0, math.inf
        for place, way, side in ((u, du, columns), (v, dv, rows)):
            if way == 0.0:
                low = low if 0.0 <= place <= side else math.inf
            else:
                ends = sorted(((0.0 - place) / way, (side - place) / way))
                low, high = max(low, ends[0]), min(high, ends[1])
        if low < high:
            met += 1
            assert gone == pytest.approx(low)
            assert column == min(max(math.floor(u + (low + 1e-9) * du), 0), columns - 1)
            assert row == min(max(math.floor(v + (low + 1e-9) * dv), 0), rows - 1)
        else:
            assert gone == math.inf
    assert met > 40


# Values.


def test_values_are_shown_on_a_line_of_sixty_characters() -> None:
    assert checks.shown("x" * 58) == repr("x" * 58)
    assert checks.shown("x" * 59) == "'" + "x" * 56 + "..."
    assert len(checks.shown("y" * 10_000)) == 60
    assert checks.shown([1, 2]) == "[1, 2]"
    assert checks.shown(np.zeros((2, 2))).count("\n") == 0
    deep: list[Any] = []
    deep.append([deep])
    assert checks.shown(deep) == "[[[...]]]"
    assert checks.shown(10**6000) == "a int too long to print"


@pytest.mark.parametrize(
    ("value", "found"),
    [(1, 1.0), (np.float32(0.5), 0.5), (10**400, math.inf), (-(10**400), -math.inf), (True, math.nan), ("1", math.nan),
     (None, math.nan), (1j, math.nan), (np.array([1.0]), math.nan)],
)  # fmt: skip
def test_what_is_a_real_number(value: Any, found: float) -> None:
    assert checks.real(value) == pytest.approx(found, nan_ok=True)


def refused(words: str, function: Any, *args: Any, **kwargs: Any) -> None:
    with pytest.raises((ValueError, TypeError), match=re.escape(words)):
        function(*args, **kwargs)


def test_bounds_hold_on_both_sides_and_messages_tell_them() -> None:
    assert checks.number("f", 1e6) == 1e6
    assert checks.number("f", -1e6) == -1e6
    assert checks.number("f", 2, least=2.0, most=3.0) == 2.0
    assert type(checks.number("f", 2)) is float
    for value, kwargs, words in (
        (1.1e6, {}, "f is 1100000.0; it must be a finite number of at most 1e+06 in size"),
        (-1.1e6, {}, "at most 1e+06 in size"),
        (1.9, {"least": 2.0}, "it must be a finite number of at least 2"),
        (2.0, {"above": 2.0}, "it must be a finite number above 2"),
        (9.0, {"least": 2.0, "most": 8.0}, "a finite number of at least 2, at most 8 in size"),
        (9.0, {"above": 0.0, "most": 8.0}, "a finite number above 0, at most 8 in size"),
        (math.nan, {}, "it must be a finite number"),
        (math.inf, {"most": math.inf}, "it must be a finite number"),
    ):
        refused(words, checks.number, "f", value, **kwargs)
    assert checks.numbers_of("f", [1, 2.5], 2, "a, b") == (1.0, 2.5)
    for values in ([1], [1, 2, 3], "ab", b"ab", {1: 2, 3: 4}, 5, iter([1, 2])):
        refused("it must be 2 numbers (a, b)", checks.numbers_of, "f", values, 2, "a, b")
    refused("f[1] is nan", checks.numbers_of, "f", [1, math.nan], 2, "a, b")
    turn = 2.0 * math.pi
    for angle in (0.0, 4.0, -turn, turn):
        assert checks.heading("f", angle) == angle
    assert checks.heading("f", turn + 0.5) == pytest.approx(0.5)
    assert checks.heading("f", -3 * turn - 0.5) == pytest.approx(-0.5)
    refused("1e+06", checks.heading, "f", 1.1e6)
    assert checks.pose("f", (1, 2, turn + 0.25)) == (1.0, 2.0, pytest.approx(0.25))
    refused("f[2]", checks.pose, "f", (1, 2, 1e7))
    for value in (1e6, 2.0):
        checks.positive("f", value, least=2.0)
    for value, words in ((0.0, "> 0"), (-1, "> 0"), (math.inf, "> 0"), (1.9, "from 2 to 1e+06"), (1.1e6, "from 2 to")):
        refused(words, checks.positive, "f", value, least=2.0)
    for value in (3, 10_000, np.int64(5)):
        checks.whole("f", value, 3)
    for value, words in ((2, "a whole number >= 3"), (True, ">= 3"), (5.0, ">= 3"), (10_001, "from 3 to 10000")):
        refused(words, checks.whole, "f", value, 3)
    refused("True or False, got 1", checks.truth, "f", 1)
    checks.truth("f", np.bool_(False))
    refused("f='sloow' is unknown. Did you mean 'slow'? Choose from 'slow', 'fast'.", checks.choose, "f", "sloow",
            ["slow", "fast"])  # fmt: skip
    for value in (None, 0, 2**128 - 1, np.int64(3)):
        checks.seed("f", value)
    for value in (-1, 2**128):
        refused("from 0 to 2^128 - 1", checks.seed, "f", value)
    for value in (True, 1.0, "1"):
        refused("f must be a whole number or None", checks.seed, "f", value)
    checks.memory("it", checks.machine_memory())
    refused("it would take", checks.memory, "it", checks.machine_memory() + 1)


def test_points_of_a_table_are_near_enough_on_every_side(tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    for x, y in ((1e6, 0), (-1e6, 0), (0, 1e6), (0, -1e6)):
        file.write_text(f"0,0\n{x},{y}\n")
        assert path_from_table(str(file), 1.0).points.tolist() == [[0, 0], [x, y]]
        file.write_text(f"0,0\n1,1\n{1.01 * x},{1.01 * y}\n")
        refused("is not finite or beyond 1e+06 m", path_from_table, str(file), 1.0)
        refused("path.csv:3: point", path_from_table, str(file), 1.0)
        assert len(path_from_table(str(file), 0.5).points) == 3
    for text, words in (
        ("0,0\n1,1\n1,1\n2,2\n", "point [1.0, 1.0] repeats the one before it"),
        ("0,0\n", "a path needs at least 2"),
        ("0,0\n1,1\n0,0\n", "a closed path needs at least 3"),
    ):
        file.write_text(text)
        refused(words, path_from_table, str(file), 1.0)
    file.write_text("0,0\n1,0\n1,1\n0,0\n")
    found = path_from_table(str(file), 2.0)
    assert found.closed
    assert found.points.tolist() == [[0, 0], [2, 0], [2, 2]]


# Engines.


def test_a_process_of_a_pool_leaves_interrupts_to_its_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[Any] = []
    monkeypatch.setattr(engines.signal, "signal", lambda *args: said.append(args))
    monkeypatch.setattr(engines, "end_with_parent", said.append)
    engines._begin(77)
    assert said == [(signal.SIGINT, signal.SIG_IGN), 77]


def test_no_more_processes_than_cores_and_four(monkeypatch: pytest.MonkeyPatch) -> None:
    for there, count in ((1, 1), (3, 3), (4, 4), (9, 4)):
        monkeypatch.setattr(engines.os, "sched_getaffinity", lambda _, there=there: set(range(there)), raising=False)
        assert engines.cores() == count
    monkeypatch.delattr(engines.os, "sched_getaffinity")
    for told, count in ((None, 1), (2, 2), (16, 4)):
        monkeypatch.setattr(engines.os, "cpu_count", lambda told=told: told)
        assert engines.cores() == count


def test_what_failed_is_told_in_a_line() -> None:
    failures = [(k, ValueError(f"no\n {k}")) for k in range(5)]
    assert str(engines.Failed(failures[:1], 9, 1)) == "1 of 9 failed once: 0 (ValueError: no 0)"
    three = "; ".join(f"{k} (ValueError: no {k})" for k in range(3))
    assert str(engines.Failed(failures[:3], 9, 2)) == f"3 of 9 failed twice: {three}"
    assert engines.Failed(failures, 9, 3).failures == failures
    assert engines.Failed(failures, 9, 3).done is None
    assert str(engines.Failed(failures, 9, 3)) == f"5 of 9 failed 3 times: {three}; and 2 more"


# A cluster's engine, with a stand-in for its client.


class Client:
    def __init__(self, *workers: str) -> None:
        self.status = "running"
        self.there = {worker: {"name": f"n-{worker}" if worker != "c" else "c"} for worker in workers}
        self.answers: dict[str, Any] = {}
        self.submitted: list[tuple[Any, ...]] = []

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        assert n_workers == -1
        return {"workers": self.there}

    def run(self, function: Any, on_error: str) -> dict[str, Any]:
        assert on_error == "return"
        return self.answers

    def submit(self, *args: Any, **kwargs: Any) -> Any:
        self.submitted.append((args, kwargs))
        done: Future[Any] = Future()
        done.set_result(args[2])
        return done


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Any:
    said: list[str] = []

    def make(*workers: str) -> tuple[Any, Client, list[str]]:
        client = Client(*workers)
        dask = types.SimpleNamespace(
            cfexecutor=types.SimpleNamespace(ClientExecutor=lambda given, pure: given if not pure else None)
        )
        monkeypatch.setattr(cluster, "_dask", lambda: dask)
        monkeypatch.setattr(cluster, "say", said.append)
        monkeypatch.setattr(cluster, "identity", lambda: {"code": "1"})
        return cluster._Cluster(client, "tcp://x:1"), client, said

    return make


def test_workers_of_other_code_are_refused_once_each_and_get_no_work(made: Any) -> None:
    engine, client, said = made("a", "b", "c")
    client.answers = {"a": {"code": "1"}, "b": {"code": "2"}, "c": RuntimeError("not\n there")}
    engine.meet()
    engine.meet()
    assert len(said) == 2
    assert said[0].startswith("worker n-b b is refused: ")
    assert said[1] == "worker c is refused: not there"
    assert list(engine(str, [5, 6])) == [5, 6]
    assert [kwargs for _, kwargs in client.submitted] == [{"workers": ["a"], "allow_other_workers": True}] * 2
    wanted = [(cluster._asked, str, item, {"code": "1"}) for item in (5, 6)]
    assert [args for args, _ in client.submitted] == wanted
    engine._look()
    assert len(said) == 2
    del client.there["a"]
    engine._look()
    engine._look()
    assert said[2:] == ["no workers are left at tcp://x:1; the run goes on once there are some"]
    list(engine(str, [7]))
    assert client.submitted[-1][1] == {}
    client.there["a"] = {}
    engine._look()
    del client.there["a"]
    engine._look()
    assert len(said) == 4
    client.status = "closed"
    for call in (engine._look, lambda: list(engine(str, [1]))):
        with pytest.raises(ConnectionError, match="the scheduler tcp://x:1 is lost"):
            call()


def test_a_cluster_that_is_refused_as_a_whole_is_none(made: Any) -> None:
    engine, client, said = made("a", "b")
    client.answers = {"a": {"code": "2"}, "b": {"code": "2"}}
    with pytest.raises(cluster.NoScheduler, match="each one is refused"):
        engine.meet()
    engine, client, said = made("a", "b")
    engine.meet()  # there is nobody yet
    assert list(engine(str, [1])) == [1]
    assert client.submitted[0][1] == {}
    said.clear()
    assert not engine._elsewhere(ValueError("own"))
    assert engine._elsewhere(cluster.Refused("a", "other code"))
    assert said == ["worker n-a a is refused: other code"]
    with pytest.raises(ConnectionError, match="no worker at tcp://x:1 can take part"):
        engine._elsewhere(cluster.Refused("b", "other code"))


def test_work_is_done_where_the_installation_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    worker = types.SimpleNamespace(address="tcp://w:2")
    monkeypatch.setattr(cluster, "_dask", lambda: types.SimpleNamespace(get_worker=lambda: worker))
    for module, run in ((cluster, cluster._asked), (engines, engines._checked)):
        monkeypatch.setattr(module, "identity", lambda: {"code": "1"})
        assert run(abs, -3, {"code": "1"}) == 3
        with pytest.raises(engines.Refused, match="code"):
            run(abs, -3, {"code": "2"})
    assert cluster._minor("3.11.4") == "3.11"


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, ValueError])
def test_who_breaks_off_waits_for_no_work_that_is_under_way(
    monkeypatch: pytest.MonkeyPatch, error: type[BaseException] | None
) -> None:
    """Processes that work for an engine are ended with an error, and let go at an ordinary end."""
    done: list[Any] = []
    child = types.SimpleNamespace(terminate=lambda: done.append("terminated"))
    pool = types.SimpleNamespace(shutdown=lambda **how: done.append(how))
    monkeypatch.setattr(engines, "ProcessPoolExecutor", lambda *_, **__: pool)
    monkeypatch.setattr(engines.multiprocessing, "active_children", lambda: [child, child])
    ends = contextlib.nullcontext() if error is None else pytest.raises(error)
    with ends, engines.workers(2):
        if error is not None:
            raise error
    assert done == ["terminated"] * (0 if error is None else 2) + [{"wait": True, "cancel_futures": True}]
