"""The commands that measure or tune at length, with clocks, environments and searches that only pretend."""

import contextlib
import itertools
import json
import math
import os
import re
import sys
import types
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner

import wayfield.policies
from wayfield.benchmarks import cluster_cost, coppelia_latency, throughput, tune_all
from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.throughput import Contender
from wayfield.benchmarks.tune import SEARCHED
from wayfield.envs.scenarios import TASKS
from wayfield.policies.tuned import tuned_conditions


class Clock:
    """Goes on by a second whenever it is read, or by what is put into `now`."""

    def __init__(self, tick: float = 0.0) -> None:
        self.now, self.tick = 50.0, tick

    def perf_counter(self) -> float:
        self.now += self.tick
        return self.now

    def process_time(self) -> float:
        return 0.25 * self.now

    def thread_time(self) -> float:
        self.now += 0.125
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def cells(output: str) -> list[list[str]]:
    """Returns the cells of the lines of a table that was printed."""
    return [[each.strip() for each in re.split("[│┃]", line)[1:-1]] for line in output.splitlines() if "│" in line]


# ---- steps a second


class Envs:
    """An environment that counts."""

    def __init__(self) -> None:
        self.seeds: list[Any] = []
        self.actions: list[int] = []
        self.unwrapped = self.action_space = self
        self.shape = (2,)
        self.drawn = 0

    def seed(self, number: int) -> None:
        self.seeds.append(("actions", number))

    def sample(self) -> int:
        self.drawn += 1
        return self.drawn

    def reset(self, seed: int | None = None) -> tuple[str, dict[str, int]]:
        self.seeds.append(("reset", seed))
        return "seen", {}

    def step(self, action: Any) -> tuple[Any, ...]:
        self.actions.append(action)
        return None, 0.0, isinstance(action, int) and action % 100 == 0, False, {}


def test_steps_are_of_actions_drawn_beforehand(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    env = Envs()

    def make(*words: Any, **more: Any) -> Envs:
        made.append((words, more))
        return env

    monkeypatch.setattr(throughput.gymnasium, "make_vec", make)
    monkeypatch.setattr(throughput.gymnasium, "make", make)
    steps = throughput.vector_steps("id", 8, noise=1.0)
    assert env.seeds == [("actions", 0), ("reset", 0)]
    assert not env.actions
    assert steps() == 8 * 16
    assert env.actions == list(range(1, 17))
    assert made == [(("id", 8), {"vectorization_mode": "vector_entry_point", "noise": 1.0})]
    env.__init__()  # type: ignore[misc]
    steps = throughput.single_steps("id", noise=2.0)
    assert steps() == 256
    assert env.actions == list(range(1, 257))
    # one that has ended begins anew
    assert env.seeds == [("actions", 0), ("reset", 0), ("reset", None), ("reset", None)]
    assert made[1] == (("id",), {"noise": 2.0})


@pytest.mark.parametrize("count", [16, 64, 1024])
def test_fields_of_discs_and_boxes_are_as_dense_and_clear_of_start_and_goal(count: int) -> None:
    for make in (throughput.discs, throughput.boxes):
        field = make(count, np.random.default_rng(count))
        assert (field["start"], field["goal"]) == ([0, 0, 0], [3, 0, 0])
        assert len(field["obstacles"]) == count
        for each in field["obstacles"]:
            assert max(abs(each["x"]), abs(each["y"])) <= 1.25 * math.sqrt(count)
            assert min(math.hypot(each["x"], each["y"]), math.hypot(each["x"] - 3.0, each["y"])) > 1.0
            if make is throughput.discs:
                assert (each["kind"], each["radius"]) == ("circle", 0.2)
            else:
                assert (each["kind"], each["length"], each["width"]) == ("box", 0.4, 0.3)
                assert abs(each["heading"]) <= 3.0
    places = np.random.default_rng(count).uniform(-1.25 * math.sqrt(count), 1.25 * math.sqrt(count), (4 * count, 2))
    free = [(x, y) for x, y in places.tolist() if min(math.hypot(x, y), math.hypot(x - 3.0, y)) > 1.0][:count]
    assert [(each["x"], each["y"]) for each in field["obstacles"]] == free
    headings = [each["heading"] for each in field["obstacles"]]
    assert min(headings) < -1.5
    assert max(headings) > 1.5


def test_maps_of_blocks_and_of_a_building() -> None:
    def cleared(occupied: Any) -> None:
        assert occupied.shape == (2000, 2000)
        assert occupied.dtype == np.bool_
        assert not occupied[980:1020, 980:1050].any()
        for k, edge in ((979, (979, slice(980, 1050))), (1020, (1020, slice(980, 1050)))):
            del k
            assert occupied[edge].shape == (70,)

    full = throughput.blocks(1.0, np.random.default_rng(0))
    assert full.sum() == 2000 * 2000 - 40 * 70  # nothing else is cleared
    for side in (4, 1):
        occupied = throughput.blocks(0.1, np.random.default_rng(0), *(() if side == 4 else (side,)))
        cleared(occupied)
        assert occupied.mean() == pytest.approx(0.1, abs=0.003)
        corner = occupied[:900, :900].reshape(900 // side, side, 900 // side, side)
        assert (corner.all(axis=(1, 3)) == corner.any(axis=(1, 3))).all()
        assert (corner[:, :, 1:] != corner[:, :, :-1]).any()
    assert (throughput.blocks(0.5, np.random.default_rng(1))[0, ::4]).std() > 0.4
    rng = np.random.default_rng(7)
    wanted = np.zeros((2000, 2000), np.bool_)
    walls = [wall for wall in itertools.accumulate(rng.integers(40, 90, 60).tolist()) if wall < 1990]
    for wall in walls:
        wanted[wall : wall + 2] = True
        wanted[:, wall : wall + 2] = True
    for first, last in itertools.pairwise(walls):
        for wall in walls:
            door, other = rng.integers(first + 4, last - 14, 2).tolist()
            wanted[wall : wall + 2, door : door + 12] = False
            wanted[other : other + 12, wall : wall + 2] = False
    for row, column, length, width in rng.integers((0, 0, 2, 2), (1994, 1994, 7, 7), (1600, 4)).tolist():
        wanted[row : row + width, column : column + length] = True
    wanted[980:1020, 980:1050] = False
    found = throughput.building(np.random.default_rng(7))
    cleared(found)
    assert (found == wanted).all()


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Returns what steps are asked for: id, number, keywords, and the scenario's file as it was then."""
    seen: list[Any] = []

    def steps(env_id: str, count: int = 0, **more: Any) -> Callable[[], int]:
        file = str(more.get("scenario", ""))
        content = json.loads(Path(file).read_text(encoding="utf-8")) if file.endswith(".json") else None
        if content and "map" in content:
            content["map"]["cells"] = np.load(Path(file).parent / content["map"]["file"])
        taken: list[int] = []
        seen.append((env_id, count, more, content, taken))
        return lambda: taken.append(1) or 1  # type: ignore[func-returns-value]

    monkeypatch.setattr(throughput, "vector_steps", steps)
    monkeypatch.setattr(throughput, "single_steps", steps)
    monkeypatch.setattr(throughput, "deciding_steps", lambda *words: steps(*words[:2], num_threads=words[2]))
    return seen


def test_scans_are_timed_among_discs_boxes_and_on_maps(asked: list[Any]) -> None:
    found = throughput.scanning()
    assert len(found) == len(asked) == 3 + 2 + 3 + 3 + 1
    assert all(each.robots == 256 and each.cartpole == (each.name == "CartPole-v1") for each in found)
    for each, (env_id, count, more, content, _) in zip(found, asked, strict=True):
        assert count == 256
        if each.cartpole:
            assert (env_id, more) == ("CartPole-v1", {})
            continue
        assert (more["num_beams"], more["max_range"]) == (72, 5.0)
        assert "Goal" in env_id
        assert each.name.startswith("goal reaching, 72 rays, ")
        if match := re.search(r"([\d,]+) (disc|boxe)s$", each.name):
            assert len(content["obstacles"]) == int(match[1].replace(",", ""))
            assert content["obstacles"][0]["kind"] == ("circle" if match[2] == "disc" else "box")
            continue
        told = content["map"]
        assert (content["start"], content["goal"]) == ([0, 0, 0], [3, 0, 0])
        assert (told["resolution"], told["origin"]) == (0.1, [-100, -100, 0])
        share = float(told["cells"].mean())
        if match := re.search(r"([\d.]+)% in (\w+)", each.name):
            assert share == pytest.approx(float(match[1]) / 100.0, rel=0.1)
            single = told["cells"][:900, :900].reshape(225, 4, 225, 4)
            assert (single.any(axis=(1, 3)) == single.all(axis=(1, 3))).all() == (match[2] == "blocks")
        else:
            assert each.name.endswith("a building")
            assert 0.02 < share < 0.2
    counts = [int(n.replace(",", "")) for each in found for n in re.findall(r"([\d,]+) (?:discs|boxes)", each.name)]
    assert counts == [16, 64, 1024, 64, 1024]
    shares = [float(n) for each in found for n in re.findall(r"([\d.]+)%", each.name)]
    assert shares == [0.1, 10.0, 30.0, 6.0, 10.0]


def test_what_is_timed_beside_cartpole(asked: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(throughput, "scanning", list)
    found = throughput.contenders()
    assert len(found) == len(asked)
    by_steps = {id(each.steps): each for each in found}
    assert len(by_steps) == len(found)
    assert all(len(taken) == 1 for *_, taken in asked)  # the first steps compile
    docking = TASKS["docking"].ids[True]
    pairs = sorted((env_id, count, str(sorted(more.items()))) for env_id, count, more, *_ in asked)
    path, goal = throughput.PATH_FOLLOWING, throughput.GOAL_REACHING
    discs: dict[str, Any] = {"num_beams": 32, "scenario": "discs"}
    pymunk = {"dynamics": "pymunk"}
    wanted = [
        (path, 1024, {}), (path, 0, {}), (path, 64, pymunk),
        *((goal, 1024, discs | {"num_beams": n}) for n in (32, 72, 720)),
        (goal, 1024, {"scenario": "open_field"}), (goal, 0, discs), (goal, 64, discs | pymunk),
        (docking, 1024, {"scenario": "open"}), ("CartPole-v1", 1024, {}), ("CartPole-v1", 0, {}),
        ("CartPole-v1", 64, {}),
    ]  # fmt: skip
    assert pairs == sorted((env_id, count, str(sorted(more.items()))) for env_id, count, more in wanted)
    for each in found:
        assert each.cartpole == (each.name == "CartPole-v1")
        assert each.robots == (64 if "pymunk" in each.name else each.robots)
    robots = [each.robots for each in found if each.cartpole]
    assert sorted(robots) == [1, 64, 1024]
    assert {each.robots for each in found} == set(robots)
    rays = [re.findall(r"\d+", each.name) for each in found if "rays" in each.name]
    assert sorted(itertools.chain(*rays)) == ["32", "32", "32", "72", "720"]


def test_threads_are_timed_beside_one(asked: list[Any]) -> None:
    found = throughput.threaded(3)
    assert [each.name.rpartition(",")[2] for each in found] == [" 1 thread", " 3 threads"] * 5
    assert [more["num_threads"] for *_, more, _, _ in asked] == [1, 3] * 5
    assert [each.robots for each in found] == [4096] * 8 + [512] * 2
    assert [(env_id, count) for env_id, count, *_ in asked[::2]] == [
        (throughput.PATH_FOLLOWING, 4096), *[(throughput.GOAL_REACHING, 4096)] * 3, ("dwa", 512),
    ]  # fmt: skip
    assert [more.get("num_beams") for *_, more, _, _ in asked[::2]] == [None, 32, 72, 720, None]
    assert all(len(taken) == 1 for *_, taken in asked)


def test_a_policy_decides_twice_on_the_same_observations(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []

    class Pilot:
        def __init__(self, *words: Any) -> None:
            seen.append(words)

        def reset(self) -> None:
            seen.append("reset")

        def command(self, observations: Any) -> None:
            seen.append(observations)

    env = Envs()
    made: list[Any] = []
    monkeypatch.setattr(wayfield.policies, "Pilot", Pilot)
    monkeypatch.setattr(wayfield.policies, "make", lambda name: name)
    monkeypatch.setattr(throughput.gymnasium, "make_vec", lambda *words, **more: made.append((words, more)) or env)
    steps = throughput.deciding_steps("dwa", 512, 3)
    assert seen == [("dwa", env, 3), "reset"]
    assert env.seeds == [("reset", 0)]
    assert steps() == 1024
    assert seen[2:] == ["seen", "seen"]
    ((words, more),) = made
    assert words == (throughput.GOAL_REACHING, 512)
    assert (more["scenario"], more["num_beams"]) == ("clutter_10/test", 72)


def test_a_rate_is_steps_over_time_and_a_contender_s_the_median_of_its_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(throughput, "time", clock)

    def steps() -> int:
        clock.now += 0.25
        return 10

    assert throughput.rate(steps, 1.0) == 40.0
    assert clock.now == 51.0
    assert throughput.rate(steps, 0.9) == 40.0
    assert clock.now == 52.0
    assert throughput.rate(steps, 0.0) == 40.0  # one turn at least
    assert clock.now == 52.25
    rates = iter([5.0, 1.0, 9.0, 3.0, 1.0, 8.0])
    asked: list[Any] = []
    monkeypatch.setattr(throughput, "rate", lambda steps, seconds: asked.append((steps, seconds)) or next(rates))
    chosen = [Contender("a", 1, len), Contender("b", 1, max)]  # type: ignore[arg-type]
    assert throughput.measured(chosen, 3, 0.5) == [(chosen[0], 5.0), (chosen[1], 3.0)]
    assert asked == [(len, 0.5), (max, 0.5)] * 3  # in turns


def test_rates_are_told_beside_cartpole_s_with_as_many_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [
        (Contender("x", 1024, len), 3_000_000.0), (Contender("CartPole-v1", 1024, len, cartpole=True), 4_000_000.0),
        (Contender("y", 1, len), 90_000.4), (Contender("CartPole-v1", 1, len, cartpole=True), 30_000.0),
    ]  # fmt: skip
    seen: list[Any] = []
    threads: list[int] = []
    monkeypatch.setattr(throughput, "contenders", lambda: "all")
    monkeypatch.setattr(throughput, "threaded", lambda n: f"{n} threads")
    monkeypatch.setattr(throughput, "measured", lambda *words: seen.append(words) or found)
    monkeypatch.setattr(throughput.numba, "set_num_threads", threads.append)
    done = CliRunner().invoke(throughput.main, [])
    assert done.exit_code == 0, done.output
    assert seen == [("all", 5, 0.5)]
    assert threads == [1]
    assert cells(done.output) == [
        ["x", "1,024", "3,000,000", "0.75"], ["CartPole-v1", "1,024", "4,000,000", "1.00"],
        ["y", "1", "90,000", "3.00"], ["CartPole-v1", "1", "30,000", "1.00"],
    ]  # fmt: skip
    assert "median of 5 rounds" in " ".join(done.output.split())
    assert f"NumPy {np.__version__}" in done.output
    # a hundred columns, whatever the terminal has
    found[0] = (Contender("x" * 55, 1024, len), found[0][1])
    for words in ([], ["--threads", "4"]):
        lines = CliRunner().invoke(throughput.main, words).output.splitlines()
        assert next(len(line) for line in lines if "x" * 55 in line) > 80
    found[0] = (Contender("x", 1024, len), found[0][1])
    seen.clear()
    seen.append(())
    done = CliRunner().invoke(throughput.main, ["--rounds", "2", "--seconds", "60", "--threads", "4"])
    assert seen[1:] == [("4 threads", 2, 60.0)]
    assert cells(done.output) == [
        ["x", "1,024", "3,000,000", ""], ["CartPole-v1", "1,024", "4,000,000", "1.33"],
        ["y", "1", "90,000", ""], ["CartPole-v1", "1", "30,000", "0.33"],
    ]  # fmt: skip
    assert "median of 2 rounds" in " ".join(done.output.split())
    for seconds in ("0", "-1", "nan", "60.1", "inf"):
        assert CliRunner().invoke(throughput.main, ["--seconds", seconds]).exit_code == 2
    assert len(seen) == 2


def test_memory_is_what_fifty_thousand_robots_more_take(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: list[Any] = []

    class Pool:
        def __init__(self, count: int, context: Any) -> None:
            assert count == 1
            assert context.get_start_method() == "spawn"

        def __enter__(self) -> "Pool":
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def submit(self, function: Any, env_id: str, count: int) -> Any:
            assert function is throughput.resident_with
            counts.append((env_id, count))
            return types.SimpleNamespace(result=lambda: 10**9 * (count == 1) + 7000 + 1234 * count)

    monkeypatch.setattr(throughput, "ProcessPoolExecutor", Pool)
    done = CliRunner().invoke(throughput.main, ["--memory"])
    assert done.exit_code == 0, done.output
    ids = sorted(each for each in gymnasium.registry if each.startswith("wayfield/"))
    assert cells(done.output) == [[each, "1,234", "1.23"] for each in ids]
    assert counts == [(each, count) for each in ids for count in (1, 1000, 51_000)]
    env = Envs()
    monkeypatch.setattr(throughput.gymnasium, "make_vec", lambda *words, **more: env)
    monkeypatch.setattr(throughput, "_resident", lambda: 77 + len(env.actions))
    assert throughput.resident_with("id", 9) == 80  # after three steps
    assert env.seeds == [("reset", 0)]
    assert all((action == np.zeros(2)).all() for action in env.actions)


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="as Linux tells it")
def test_what_is_resident_is_what_the_system_says() -> None:
    with open("/proc/self/status", encoding="utf-8") as file:
        (kib,) = re.findall(r"VmRSS:\s+(\d+) kB", file.read())
    assert throughput._resident() == pytest.approx(1024 * int(kib), rel=0.05)


# ---- what sharing out costs


class Engine:
    def __init__(self, clock: Clock, each: float) -> None:
        self.clock, self.each = clock, each
        self.parts: list[Any] = []

    def as_done(self, function: Any, parts: Iterable[Any]) -> Iterator[Any]:
        for k, part in enumerate(parts):
            self.parts.append((function, part))
            self.clock.now += self.each
            yield k, function(part)


def test_what_a_part_costs_and_how_well_workers_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(cluster_cost, "time", clock)
    engine = Engine(clock, 0.5)
    assert cluster_cost.cost(engine, 8) == (0.5, 0.125)  # type: ignore[arg-type]
    assert engine.parts == [(cluster_cost.nothing, k) for k in range(8)]
    began = clock.now
    assert cluster_cost.busy(1.0) == 1.0
    assert 1.0 <= clock.now - began <= 1.25
    monkeypatch.setattr(cluster_cost, "busy", lambda seconds: seconds)
    engine.parts.clear()
    assert cluster_cost.taken(engine, 4, 0.3) == 2.0  # type: ignore[arg-type]
    assert [part for _, part in engine.parts] == [0.3] * 4
    assert cluster_cost.nothing(3) == 3
    seen: list[Any] = []

    @contextlib.contextmanager
    def cluster(kind: str, count: int) -> Iterator[str]:
        yield f"{kind} {count}"

    def taken(engine: Any, count: int, seconds: float) -> float:
        seen.append((engine, count, seconds))
        return {"local 1": 8.0, "local 2": 5.0}.get(engine, 8.0)

    monkeypatch.setattr(cluster_cost, "cluster", cluster)
    monkeypatch.setattr(cluster_cost, "taken", taken)
    monkeypatch.setattr(cluster_cost, "cost", lambda engine, parts: seen.append((engine, parts)) or (0.0023, 0.0011))
    done = CliRunner().invoke(cluster_cost.main, ["--parts", "30", "--busy", "20", "--seconds", "0.4"])
    assert done.exit_code == 0, done.output
    assert cells(done.output) == [
        ["none", "", "", "8.00", "1.00"], ["1", "2.30", "1.10", "8.00", "1.00"], ["2", "2.30", "1.10", "5.00", "0.80"],
    ]  # fmt: skip
    assert seen[0][1:] == (20, 0.4)
    for n in (1, 2):
        assert seen[3 * n - 2 : 3 * n + 1] == [(f"local {n}", n, 0.01), (f"local {n}", 30), (f"local {n}", 20, 0.4)]
    assert "20 parts of" in " ".join(done.output.split())


# ---- how fast the server answers


def test_latency_is_told_in_medians(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(coppelia_latency, "time", clock)
    durations = iter([3.0, 1.0, 10.0, 2.0])

    def call() -> None:
        clock.now += next(durations)

    assert coppelia_latency.median_time(call, 4) == 2.5
    calls: list[str] = []

    class Sim:
        def __getattr__(self, name: str) -> Any:
            def called(*words: Any) -> Any:
                calls.append(" ".join([name, *map(str, words)]))
                clock.now += 0.0001 if name == "getObjectPosition" else 0.0002
                return words[0] if name == "getObject" else None

            return called

    class Client:
        def __init__(self, port: int) -> None:
            assert port == 77

        def require(self, name: str) -> Sim:
            assert name == "sim"
            return Sim()

    module = types.ModuleType("coppeliasim_zmqremoteapi_client")
    module.RemoteAPIClient = Client  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    lateness = [0.001, 0.009, 0.0101, 0.5, 0.002]
    plants: list[str] = []

    @contextlib.contextmanager
    def served(dynamics: str) -> Iterator[Any]:
        plants.append(dynamics)
        yield 77, lambda: (lateness, 0.05 * clock.now)

    monkeypatch.setattr(coppelia_latency, "served", served)
    done = CliRunner().invoke(coppelia_latency.main, ["--calls", "11", "--seconds", "4", "--dynamics", "pymunk"])
    assert done.exit_code == 0, done.output
    assert plants == ["pymunk"]
    assert [line[1] for line in cells(done.output)] == ["100 us", "0.90 ms", "60.0 %", "5.00 %"]
    assert "of 5" in done.output
    loop = ["getObjectPosition /PioneerP3DX", "getObjectOrientation /PioneerP3DX"]
    loop += ["setJointTargetVelocity /leftMotor 1.0", "setJointTargetVelocity /rightMotor 1.0", "step"]
    paths = ["/PioneerP3DX", "/leftMotor", "/rightMotor"]
    assert calls == [
        *(f"getObject {path}" for path in paths), *loop[:1] * 11, "startSimulation", "stopSimulation True",
        "setStepping True", "startSimulation", *loop * 11, "stopSimulation True",
    ]  # fmt: skip
    lateness.clear()
    done = CliRunner().invoke(coppelia_latency.main, ["--calls", "10", "--seconds", "1"])
    assert plants[1:] == ["kinematic"]
    assert cells(done.output)[2][1] == "0.0 %"


def test_a_server_in_another_process_is_asked_and_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[Any] = []

    class Pipe:
        def send(self, what: Any) -> None:
            said.append(("send", what))

        def recv(self) -> Any:
            return 23 if ("send", True) not in said else ([0.1], 2.0)

        def close(self) -> None:
            said.append("close")

    class Process:
        def __init__(self, target: Any, args: Any, daemon: bool) -> None:
            assert target is coppelia_latency._serve
            assert args[1:] == ("pymunk", os.getpid())
            assert daemon

        def __getattr__(self, name: str) -> Any:
            return lambda *words: said.append((name, *words))

    context = types.SimpleNamespace(Pipe=lambda: (Pipe(), Pipe()), Process=Process)
    monkeypatch.setattr(coppelia_latency.multiprocessing, "get_context", lambda kind: context)
    with coppelia_latency.served("pymunk") as (port, ask):
        assert port == 23
        assert ask() == ([0.1], 2.0)
        assert said == [("start",), "close", ("send", True)]
    assert said[3:] == ["close", ("join", 5), ("kill",)]


# ---- gains for every condition


def test_every_policy_is_tuned_for_every_condition_that_tables_show() -> None:
    wanted = list(tune_all.conditions())
    assert len(set(wanted)) == len(wanted)
    paths = CONTESTS["path-following"]
    of_paths = {("p3dx", v, "none") for v in (*paths.speeds, 0.6)} | {("p3dx", 0.6, tune_all.ROBUST_LEVEL)}
    of_paths |= {("omni3", 0.6, "none"), ("omni4", 0.6, "none")}
    of_goals = {(robot, 0.6, "none") for robot in ("p3dx", "omni3", "omni4")} | {("p3dx", 0.6, tune_all.ROBUST_LEVEL)}
    for name, contest in CONTESTS.items():
        mine = {"path-following": of_paths, "goal-obstacles": of_goals}.get(name, {("p3dx", 0.6, "none")})
        there = {each[1:] for each in wanted if each[0] == name}
        assert there == {(policy, *each) for policy in contest.policies if policy in SEARCHED for each in mine}
    # what most tables show first: of all contests the default, then the robust of paths beside another robot's goals
    places = {(suite, *rest): k for k, (suite, _, *rest) in enumerate(wanted)}
    assert all(places[name, "p3dx", 0.6, "none"] < places["path-following", "p3dx", 0.6, tune_all.ROBUST_LEVEL]
               for name in CONTESTS)  # fmt: skip
    asked = [
        speed for suite, _, robot, speed, level in wanted if (suite, robot, level) == ("path-following", "p3dx", "none")
    ]
    order = list(dict.fromkeys(asked))
    assert order[0] == 0.6
    assert order[1:] == sorted(order[1:], reverse=True)
    goals = list(dict.fromkeys(tuple(each) for suite, _, *each in wanted if suite == "goal-obstacles"))
    assert [robot for robot, *_ in goals] == ["p3dx", "omni3", "omni4", "p3dx"]
    assert tune_all._apart("omni3_0.6_none", "p3dx", 0.6, "none") > tune_all._apart(
        "p3dx_0.6_mild", "p3dx", 0.6, "none"
    )
    assert tune_all._apart("p3dx_0.6_mild", "p3dx", 0.6, "none") > tune_all._apart("p3dx_1.0_none", "p3dx", 0.6, "none")
    assert tune_all._apart("p3dx_0.3_none", "p3dx", 0.6, "none") == (False, False, pytest.approx(0.3))


def test_what_ships_is_not_tuned_again_unless_forced(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    searches: list[Any] = []
    written: list[Path] = []

    class Search:
        def __init__(self, *words: Any) -> None:
            searches.append(words)

        def run(self, engine: Any) -> dict[str, Any]:
            assert engine == "engine"
            return {"of": searches[-1][0]}

    @contextlib.contextmanager
    def shared_out(count: int) -> Iterator[str]:
        assert count == 1
        yield "engine"

    wanted = [
        ("path-following", "lqr", "p3dx", 0.6, "none"),
        ("path-following", "mpc", "omni3", 0.6, "none"),
        ("goal-obstacles", "dwa", "p3dx", 0.6, "none"),
        ("path-following", "lqr", "p3dx", 0.3, "none"),
    ]
    for suite in CONTESTS:
        (tmp_path / suite).mkdir()
    (tmp_path / "goal-obstacles" / "dwa_p3dx_0.6_none.json").touch()
    monkeypatch.setattr(tune_all, "conditions", lambda: iter(wanted))
    monkeypatch.setattr(tune_all, "Search", Search)
    monkeypatch.setattr(tune_all, "shared_out", shared_out)
    monkeypatch.setattr(tune_all, "folder_of", lambda suite: tmp_path / suite)
    monkeypatch.setattr(tune_all, "write_gains", lambda file, content: written.append((file, content)))
    monkeypatch.setattr(tune_all, "told", lambda content: f"told {content['of']}")
    monkeypatch.setattr(tune_all, "start_of", lambda policy, suite, known: f"{suite} {policy} {known}")
    done = CliRunner().invoke(tune_all.main, [])
    assert done.exit_code == 0, done.output
    of_search = [(words[0], words[1].name, words[2].name, *words[3:10]) for words in searches]
    assert of_search == [
        ("lqr", "path-following", "p3dx", 0.6, "none", "lagged", 8_000_000, 400, 10, 0),
        ("mpc", "path-following", "omni3", 0.6, "none", "lagged", 1_000_000, 400, 10, 0),
        ("lqr", "path-following", "p3dx", 0.3, "none", "lagged", 8_000_000, 400, 10, 0),
    ]
    names = ["lqr_p3dx_0.6_none", "mpc_omni3_0.6_none", "lqr_p3dx_0.3_none"]
    assert [file for file, _ in written] == [tmp_path / "path-following" / f"{name}.json" for name in names]
    assert done.output.splitlines() == [f"{name}: told {name.partition('_')[0]}" for name in names]
    for (policy, *_), name in zip(of_search, names, strict=True):
        known = [each for each in tuned_conditions(policy, "path-following") if f"{policy}_{each}" != name]
        robot, speed, level = name.split("_")[1:]
        nearest = min(known, key=lambda each: tune_all._apart(each, robot, float(speed), level))
        starts = next(words[10] for words, other in zip(searches, names, strict=True) if other == name)
        assert starts == (f"path-following {policy} {nearest}",)
    for words, policies in (
        (["--force"], ["lqr", "mpc", "dwa", "lqr"]), (["--suites", "goal-obstacles"], []),
        (["--suites", "goal-obstacles", "--force"], ["dwa"]), (["--policies", "mpc,dwa"], ["mpc"]),
        (["--suites", "path-following", "--policies", "lqr", "--frames", "9", "--trials", "2", "--scenarios", "3",
          "--seed", "4"], ["lqr", "lqr"]),
    ):  # fmt: skip
        searches.clear()
        assert CliRunner().invoke(tune_all.main, words).exit_code == 0
        assert [each[0] for each in searches] == policies
    assert searches[0][6:10] == (9, 2, 3, 4)
