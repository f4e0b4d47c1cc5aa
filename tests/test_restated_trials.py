"""What a trial of the fault campaign takes for a fault, tried in this process: steps, files, forks and the worker."""

import base64
import contextlib
import io
import json
import os
import random
import resource
import signal
import sys
import time
import types
import zlib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks.faults import __main__ as command
from wayfield.benchmarks.faults import campaign, files, forks, life, mutations, server, steps, use, worker
from wayfield.benchmarks.faults.place import Ended
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.readers import READERS
from wayfield.envs.robots import ACTUATORS, ROBOTS

# ---- steps


def _drawn(group: Any, count: int) -> list[dict[str, Any]]:
    return [each for each, _ in zip(group.trials(random.Random(0)), range(count), strict=False)]


def test_trials_of_steps_are_first_what_once_crashed_then_any() -> None:
    drawn = _drawn(steps, 1500)
    listed = [each for each in drawn if each["seed"] == 1 and each["steps"] == 60]
    for env_id in steps.IDS:
        path = "Path" in env_id
        mine = [each["kwargs"] for each in listed if each["env"] == env_id]
        wanted = [each for each in steps._LISTED if "shove" in each or path == ("num_beams" not in each)]
        assert mine == wanted
    back = [each for each in drawn if each["steps"] == 300 and each.get("num_envs") == 256]
    assert [each["env"] for each in back] == steps.IDS
    assert all(each["actions"] == "corner" and each["seed"] == 2 and not each["kwargs"] for each in back)
    rest = drawn[len(listed) + len(back) :]
    assert ["mutated" in each for each in rest[:22]] == ([False] + [True] * 10) * 2
    for each in rest:
        if "mutated" in each:
            assert (each["steps"], each["actions"]) == (20, "random")
            continue
        kwargs, path, many = each["kwargs"], "Path" in each["env"], each["num_envs"] >= steps._MANY
        assert each["steps"] == 1000 if many else each["steps"] in (100, 300)
        assert each["num_envs"] <= (64 if kwargs["dynamics"] == "pymunk" else 16_384)
        assert each["actions"] != "wrong" or each["num_envs"] <= 1024
        assert each["clock"] != 1 or each["num_envs"] <= 1024
        assert ("num_preview" in kwargs) == path
        assert ("num_beams" in kwargs) == (not path)
        assert kwargs.get("num_preview", 0) <= (10 if many else 100)
        assert kwargs.get("num_beams", 0) <= (8 if many else 72)
        assert ROBOTS[kwargs["robot"]].holonomic == ("DiffDrive" not in each["env"])
        assert 0.0 <= kwargs["noise"] <= 10.0
        if "shove" in kwargs:
            assert 0.0 <= kwargs["shove"][0] <= 3.0
            assert len(kwargs["shove"]) == 4
        if not path:
            assert 0.1 <= kwargs["field_of_view"] <= 6.28
            assert kwargs["dynamics"] == "kinematic" or isinstance(kwargs["end_on_contact"], bool)
            assert kwargs["dynamics"] != "kinematic" or kwargs["end_on_contact"] is True
    settings = [each for each in rest if "mutated" not in each]
    assert {each["kwargs"]["actuators"] for each in settings} == set(ACTUATORS)
    assert {each["kwargs"]["dynamics"] for each in settings} == {"kinematic", "pymunk"}
    assert {each["num_envs"] for each in settings} == {0, 1, 3, 64, 1024, 4096, 16_384}
    assert {each["autoreset_mode"] for each in settings} == {"NextStep", "SameStep"}
    assert {each["clock"] for each in settings} == {None, 1, 37, 1200}
    shoved = sum("shove" in each["kwargs"] for each in settings)
    assert 0.15 < shoved / len(settings) < 0.45
    changed = {each["mutated"] for each in rest if "mutated" in each}
    assert {"shove", "noise", "reset seed", "options", "num_envs", "clock", "render_mode"} <= changed
    for each in rest:
        name = each.get("mutated")
        if name == "shove":
            assert sorted(map(str, each["kwargs"]["shove"])).count("0") >= 3
        elif name == "render_mode":
            assert each["kwargs"] == {"render_mode": "x"}
        elif name in ("reset seed", "options", "scenario option", "num_envs", "clock", "autoreset_mode"):
            assert name in each
            assert not each["kwargs"]
        elif name:
            assert list(each["kwargs"]) == [name]


class Space:
    low, high, shape, dtype = np.array([-1.0, -2.0]), np.array([1.0, 2.0]), (2,), np.float64


def test_actions_are_random_at_the_corners_extreme_or_wrong() -> None:
    base = types.SimpleNamespace(action_space=Space())
    rng = np.random.default_rng(0)
    drawn = np.array([steps._actions(base, "random", rng, 0) for _ in range(100)])
    assert (abs(drawn) <= Space.high).all()
    assert (abs(drawn).max(axis=0) > 0.9 * Space.high).all()
    corners = [steps._actions(base, "corner", rng, k) for k in range(40)]
    assert all((abs(each) == Space.high).all() for each in corners)
    assert all((each == Space.low).all() for k, each in enumerate(corners) if k % 20 >= 10)
    assert {tuple(each) for k, each in enumerate(corners) if k % 20 < 10} == {(a, b) for a in (-1, 1) for b in (-2, 2)}
    extreme = np.array([steps._actions(base, "extreme", rng, k) for k in range(200)])
    assert extreme.shape == (200, 2)
    assert np.isfinite(extreme).all()
    assert extreme.min() == -1.7e308
    assert extreme.max() == 1e300
    wrong = [steps._actions(base, "wrong", rng, k) for k in range(17)]
    assert str(steps._actions(base, "wrong", rng, 17)) == str(wrong[0])
    assert np.isnan(wrong[0]).all()
    assert np.isinf(wrong[1]).all()
    assert wrong[2:6] == ["x", None, {}, []]
    assert wrong[12] == [-1.0, -2.0]


def test_a_refusal_is_one_line_that_names_the_argument() -> None:
    spec = {"mutated": "reset seed", "kwargs": {}}
    assert steps._refused(ValueError("a seed is no"), spec) == {}
    assert steps._refused(ValueError("x" * 1000), spec) == {}
    for text in ("", "a\nb", "x" * 1001):
        (problem,) = steps._refused(ValueError(text), spec).values()
        assert problem.startswith(f"ValueError of {len(text)} characters is no clear line: ")
    named = {"mutated": "noise", "kwargs": {"noise": "nan"}}
    assert steps._refused(TypeError("noise must be"), named) == {}
    assert steps._refused(TypeError("it must be"), named) == {"problem": "TypeError does not name noise: it must be"}
    assert steps._refused(TypeError("it must be"), {"kwargs": {"noise": 1}}) == {}
    meant = {"nan": np.nan, "inf": np.inf, "-inf": -np.inf}
    assert str([steps._value(each) for each in meant]) == str(list(meant.values()))
    assert steps._value("huge") == 10**400
    assert steps._value([1, ["nan"]])[0] == 1
    assert isinstance(steps._value([1]), tuple)
    assert steps._value({"a": [1]}) == {"a": [1]}
    array = steps._value("array")
    array += 1.0
    assert (steps._value("array") == np.zeros(3)).all()  # its own each time


def _env(**changes: Any) -> Any:
    states = np.zeros(2, [("x", float), ("k", int)])
    options = types.SimpleNamespace(disturbance=types.SimpleNamespace(shove=0.0), dynamics="kinematic")
    found = types.SimpleNamespace(
        observation_space=Space(), action_space=Space(), batch=types.SimpleNamespace(states=states),
        task=types.SimpleNamespace(scenarios=[], options=options), seeds=[],
    )  # fmt: skip
    for name, value in changes.items():
        setattr(found, name, value)
    return found


def test_what_is_unsound_about_a_step() -> None:
    fine = np.array([0.5, -2.0])

    def said(observation: Any = fine, reward: Any = 0.0, info: Any = None, solid: bool = True, base: Any = None) -> Any:
        return steps._unsound(base or _env(), observation, reward, info or {}, set(info or {}), solid)

    assert said() is None
    assert "has shape (3,)" in said(np.zeros(3))
    assert "float32" in said(np.zeros(2, np.float32))
    for wrong in (np.array([0.0, 2.1]), np.array([0.0, -2.1]), np.array([0.0, np.nan])):
        assert said(wrong) == f"observation [1] is {wrong[1]!r}, out of its space"
    assert said(reward=np.array([0.0, np.inf])) == "a reward is [ 0. inf]"
    assert said(reward=np.nan) == "a reward is nan"
    broken = _env()
    broken.batch.states["x"][1] = np.nan
    assert said(base=broken) == "state x is NaN"
    names = {"a", "b"}
    assert steps._unsound(_env(), fine, 0.0, {"a": 1, "b": 2, "final_obs": 3, "_final_obs": 4}, names, True) is None
    told = steps._unsound(_env(), fine, 0.0, {"a": 1, "c": 2}, names, True)
    assert told == "info has other keys than at the reset: ['b', 'c']"
    assert said(info={"clearance": np.array([0.1, -1e-9])}) is None
    assert said(info={"clearance": np.array([0.1, -0.25])}) == "a hull is 0.25 m inside an obstacle"
    assert said(info={"clearance": np.array([0.1, -0.25])}, solid=False) is None
    assert said(info={"arc_length": 1.0, "progress": 0.0}) is None
    assert said(info={"arc_length": 1.0, "progress": np.array([0.0, -0.5])}) == "progress is -0.5"
    assert said(info={"progress": -0.5}) is None


def test_a_row_does_what_the_single_environment_does() -> None:
    class Twin:
        def step(self, action: Any) -> Any:
            assert action == 0.5
            return np.array([1.0, 2.0]), 3.0, ended["is"], False, {"a": 4.0, "b": np.nan}

    ended = {"is": False}

    def said(**changes: Any) -> Any:
        state: dict[str, Any] = {
            "observation": np.array([[9.0, 9.0], [1.0, 2.0]]), "reward": np.array([0.0, 3.0]),
            "terminated": np.array([True, ended["is"]]), "truncated": np.array([True, False]),
            "info": {"a": np.array([0.0, 4.0]), "b": np.array([0.0, np.nan])},
        } | changes  # fmt: skip
        return steps._unequal(Twin(), 0.5, 1, **state)

    assert said() == (None, False)
    assert said(truncated=np.array([False, True])) == (None, True)
    rewarded = "row 1 is rewarded or ends otherwise than the single environment"
    assert said(reward=np.array([3.0, 0.0])) == (rewarded, True)
    assert said(terminated=np.array([False, True])) == (rewarded, True)
    observed = "row 1 observes otherwise than the single environment"
    assert said(observation=np.array([[1.0, 2.0], [1.0, 2.1]])) == (observed, True)
    other = {"a": np.array([4.0, 0.0]), "b": np.array([0.0, np.nan])}
    assert said(info=other) == ("row 1 has another a than the single environment", True)
    ended["is"] = True
    assert said() == (None, True)
    final = {"final_obs": np.array([[0.0, 0.0], [1.0, 2.0]]), "final_info": {"a": np.array([0, 4.0]),
                                                                            "b": np.array([0, np.nan])}}  # fmt: skip
    reset = np.zeros((2, 2))
    assert said(observation=reset, info=final) == (None, True)
    ended["is"] = False
    assert said(observation=reset, info=final | {"a": 0, "b": 0}) == (observed, True)  # nothing has ended


class Stepped:
    """An environment whose steps are what it is told, the last of them for all that follow."""

    def __init__(self, *told: Any, **changes: Any) -> None:
        self.unwrapped = _env(**changes)
        self.told, self.seeds, self.closed, self.taken = list(told), [], 0, 0
        self.unwrapped.step, self.unwrapped.reset = self.step, self.reset

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        self.seeds.append((seed, options))
        if isinstance(seed, str):
            raise ValueError("seed is no number")
        return np.zeros(2), {"a": 1.0}

    def step(self, action: Any) -> Any:
        self.taken += 1
        found = self.told.pop(0) if len(self.told) > 1 else self.told[0]
        if isinstance(found, Exception):
            raise found
        return found

    def close(self) -> None:
        self.closed += 1


FINE = (np.zeros(2), 0.0, False, False, {"a": 1.0})


def test_steps_are_counted_and_what_is_wrong_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    state: dict[str, Any] = {}

    def make(*words: Any, **more: Any) -> Any:
        made.append((words, more))
        return state["env"]

    monkeypatch.setattr(steps.gymnasium, "make", make)
    monkeypatch.setattr(steps.gymnasium, "make_vec", make)
    spec = {"env": "id", "kwargs": {"noise": "nan"}, "num_envs": 0, "actions": "random", "steps": 7, "seed": 3}

    def inside(*told: Any, changes: Any = None, **more: Any) -> Any:
        made.clear()
        state["env"] = Stepped(*told, **(changes or {}))
        before = life.signs
        found = steps.inside(spec | more)
        state["signs"] = life.signs - before
        return found

    assert inside(FINE) == {"steps": 7}
    assert state["signs"] == state["env"].taken == 7
    assert state["env"].closed == 1
    assert state["env"].seeds == [(3, None)]
    assert made[0][0] == ("id",)
    assert np.isnan(made[0][1]["noise"])
    # an episode that has ended begins anew
    over = (np.zeros(2), 0.0, True, False, {"a": 1.0})
    late = (np.zeros(2), 0.0, False, True, {"a": 1.0})
    inside(FINE, over, FINE, late, FINE)
    assert state["env"].seeds == [(3, None), (None, None), (None, None)]
    bad = (np.zeros(2), np.nan, False, False, {"a": 1.0})
    assert inside(FINE, FINE, bad) == {"problem": "step 2: a reward is nan", "steps": 3}
    assert inside(FINE, ValueError("no")) == {"problem": "a finite action is refused: no"}
    assert inside(FINE, ValueError("no"), FINE, actions="wrong") == {"steps": 6}
    assert "no clear line" in inside(FINE, ValueError("a\nb"), actions="wrong")["problem"]
    with pytest.raises(ZeroDivisionError):
        inside(ZeroDivisionError())
    assert state["env"].closed == 1
    assert inside(FINE, **{"reset seed": "x"}) == {}
    assert state["env"].seeds == [("x", None)]
    assert inside(FINE, options=[1], **{"reset seed": 5}) == {"steps": 7}
    assert state["env"].seeds == [(5, (1,))]
    inside(FINE, **{"scenario option": "s"})
    assert state["env"].seeds == [(3, {"scenario": "s"})]
    more = {"num_envs": 6, "autoreset_mode": "SameStep", "clock": 37, "mutated": "clock"}
    assert inside(FINE, **more) == {"steps": 42}
    ((words, given),) = made
    assert words == ("id", 6)
    assert (given["autoreset_mode"], given["max_episode_steps"]) == ("SameStep", 37)
    assert given["vectorization_mode"] == "vector_entry_point"
    assert inside(FINE, num_envs=6, mutated="x") == {"steps": 42}
    assert not {"autoreset_mode", "max_episode_steps"} & set(made[0][1])
    # a hull inside of an obstacle is a fault unless something moves or shoves, or bodies are soft
    inner = (np.zeros(2), 0.0, False, False, {"a": 1.0, "clearance": -1.0})

    def solid(kwargs: Any = None, legs: Any = (), **options: Any) -> bool:
        base = _env()
        for name, value in options.items():
            setattr(base.task.options, name, value)
        patrols = np.array([(each,) for each in legs], [("leg_time", float)])
        base.task.scenarios = [types.SimpleNamespace(patrols=patrols), object()]
        found = Stepped(inner)
        found.unwrapped.task = base.task
        told = steps._driven(found, np.zeros(2), {"a": 1.0, "clearance": 1.0}, spec, kwargs or {})
        return "inside an obstacle" in told.get("problem", "")

    assert solid()
    assert solid(legs=(0.0,))
    assert not solid(legs=(0.0, 2.0))
    assert not solid({"shove": [0, 0, 0, 0]})
    assert not solid(disturbance=types.SimpleNamespace(shove=0.1))
    assert not solid(dynamics="pymunk")


def test_a_row_is_compared_with_an_environment_of_its_own_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = (np.zeros((4, 2)), np.zeros(4), np.zeros(4, bool), np.zeros(4, bool), {"a": np.ones(4)})
    wide = types.SimpleNamespace(low=np.full((4, 2), -1.0), high=np.ones((4, 2)), shape=(4, 2), dtype=np.float64)
    spec = {"env": "id", "kwargs": {}, "num_envs": 4, "actions": "random", "steps": 50, "seed": 3,
            "autoreset_mode": "NextStep"}  # fmt: skip
    row = int(np.random.default_rng(3).integers(4))

    def inside(*told: Any, **more: Any) -> tuple[Any, Stepped]:
        many = Stepped(rows, observation_space=wide, action_space=wide)
        twin = Stepped(*told)
        many.reset = lambda seed=None, options=None: (np.zeros((4, 2)), {"a": np.ones(4)})  # type: ignore[method-assign]
        monkeypatch.setattr(steps.gymnasium, "make", lambda *_, **__: twin)
        monkeypatch.setattr(steps.gymnasium, "make_vec", lambda *_, **__: many)
        return steps.inside(spec | more), twin

    said, twin = inside(FINE)
    assert said == {"steps": 200}
    assert twin.seeds == [(3 + row, None)]
    assert twin.taken == 40  # and no further
    said, twin = inside((np.ones(2), 0.0, False, False, {"a": 1.0}))
    assert said == {"problem": f"step 0: row {row} observes otherwise than the single environment", "steps": 4}
    said, twin = inside(FINE, mutated="seed")
    assert twin.taken == 0
    monkeypatch.setattr(Stepped, "reset", lambda self, seed=None, options=None: (np.ones(2), {}))
    assert inside(FINE)[0] == {"problem": f"row {row} starts otherwise than the single environment"}


# ---- files


@pytest.fixture
def gains(monkeypatch: pytest.MonkeyPatch) -> Any:
    files.load_all()
    monkeypatch.setattr(files, "load_all", lambda: None)
    return next(each for each in READERS.values() if each.name == "gains")


class Answers:
    def __init__(self, *problems: str | None) -> None:
        self.problems, self.asked = list(problems), []

    def ask(self, module: str, spec: dict[str, Any]) -> str | None:
        assert module == "files"
        self.asked.append(spec)
        if "sample" in spec and self.problems[0] is None:
            files.inside(spec)
        return self.problems.pop(0)


class Samples:
    def __init__(self, tmp_path: Path) -> None:
        self.samples, self.tmp_path = tmp_path / "samples", tmp_path

    def folder(self) -> Any:
        found = self.tmp_path / "folder"
        found.mkdir(exist_ok=True)
        return contextlib.nullcontext(found)


def test_a_file_of_every_kind_is_damaged_in_every_way(gains: Any) -> None:
    drawn = _drawn(files, 3 * len(READERS) + 400)
    names = sorted(READERS)
    listed = [each for each in drawn if "raw" in each]
    assert listed == drawn[: len(listed)]
    assert [(each["reader"], each["key"], each["raw"]) for each in listed] == [
        each for each in files._LISTED if each[0] in READERS
    ]
    named = [each for each in drawn if each.get("mutation", "any") != "any"]
    for name in names:
        kinds = [each["mutation"] for each in named if each["reader"] == name]
        file = READERS[name].file
        wanted = ["missing", "folder", "whole", "truncate"] + ["bomb"] * file.endswith(("npz", "zip"))
        assert kinds == wanted + ["ones", "tensors", "tensors"] * file.endswith(".safetensors")
    anything = [each for each in drawn if each.get("mutation") == "any"]
    assert [each["reader"] for each in anything[: 2 * len(names)]] == names * 2
    seeds = [each["seed"] for each in drawn if "seed" in each]
    assert len(set(seeds)) == len(seeds)
    assert max(seeds) < 2**31


def test_a_damaged_file_is_made_of_a_sample_and_kept_with_its_finding(gains: Any, tmp_path: Path) -> None:
    work = Samples(tmp_path)
    spec: dict[str, Any] = {"reader": gains.name, "mutation": "truncate", "seed": 5}
    answers = Answers(None, "bad")
    assert files.attempt(spec, work, answers) == "bad"
    sample = tmp_path / "samples" / "gains"
    assert answers.asked[0] == {"sample": gains.name, "folder": str(sample)}
    good = (sample / gains.file).read_bytes()
    damaged = mutations.NAMED["truncate"](good, random.Random(5))
    assert zlib.decompress(base64.b64decode(spec["content"])) == damaged
    assert answers.asked[1] == spec | {"from": str(sample), "folder": str(tmp_path / "folder")}
    assert files._content(spec, tmp_path) == damaged
    assert files._content({"mutation": "any", "seed": 5}, sample / gains.file) == mutations.damaged(
        good, gains.file, random.Random(5)
    )
    raw = {"key": "gains", "raw": "7"}
    assert json.loads(files._content(raw, sample / gains.file))["gains"] == 7
    for kind in ("missing", "folder", "bomb"):
        spec = {"reader": gains.name, "mutation": kind, "seed": 5}
        assert files.attempt(spec, work, Answers(None)) is None
        assert "content" not in spec
    other = next(each for each in READERS.values() if each.name != gains.name)
    assert files.attempt({"reader": other.name, "mutation": "folder"}, work, Answers("why")) == "no sample: why"


def test_what_is_read_or_refused_in_a_line_that_names_the_file_is_no_fault(
    gains: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "source"
    (source / "deep").mkdir(parents=True)
    (source / "deep" / "other").write_text("x", encoding="utf-8")
    (source / "a.json").write_text("{}", encoding="utf-8")
    state: dict[str, Any] = {}
    folders = iter(range(100))

    def read(file: Path) -> Any:
        state["file"] = file
        state["read"] = file.read_bytes() if file.is_file() else None
        if "error" in state:
            raise state["error"]
        if "does" in state:
            state["does"](file)
        return "found"

    monkeypatch.setitem(READERS, "made up", types.SimpleNamespace(name="made up", file="a.json", read=read))
    used: list[Any] = []
    monkeypatch.setattr(files, "_use", lambda found, file: used.append((found, file)))

    def inside(**more: Any) -> Any:
        folder = tmp_path / f"folder{next(folders)}"
        folder.mkdir()
        content = base64.b64encode(zlib.compress(b"damaged")).decode()
        spec = {"reader": "made up", "from": str(source), "folder": str(folder), "content": content}
        return files.inside(spec | more)

    assert inside() == {}
    file = state["file"]
    assert used == [("found", file)]
    assert state["read"] == b"damaged"
    assert (file.parent / "deep" / "other").read_text(encoding="utf-8") == "x"
    assert (source / "a.json").read_text(encoding="utf-8") == "{}"  # linked files are not written through
    assert inside(mutation="missing") == {}
    assert not state["file"].exists()
    assert inside(mutation="folder") == {}
    assert state["file"].is_dir()
    for error, fault in (
        (ValueError("a.json is no"), False), (OSError("a.json is no"), False), (ValueError("it is no"), True),
        (ValueError("a.json\nis no"), True), (ValueError("a.json" + "x" * 1994), False),
        (ValueError("a.json" + "x" * 1995), True), (KeyError("a.json"), True), (RecursionError("a.json"), True),
    ):  # fmt: skip
        state["error"] = error
        said = inside()
        assert bool(said) is fault, error
        assert not fault or said["problem"].startswith(type(error).__name__)
    state["error"] = ValueError(f"{tmp_path} is no")
    state.pop("error")
    state["does"] = lambda file: (file.parent / "new").write_text("x", encoding="utf-8")
    (seen,) = inside().values()
    assert seen.startswith("reading did open ")
    assert seen.endswith("for writing")
    state["does"] = lambda file: os.remove(file)
    assert inside()["problem"].startswith("reading did os.remove ")
    state["does"] = lambda file: None
    used.clear()
    kib = iter([1000, 1000 + (1 << 20), 0, (1 << 20) + 1])
    usage = types.SimpleNamespace(getrusage=lambda _: types.SimpleNamespace(ru_maxrss=next(kib)), RUSAGE_SELF=0)
    monkeypatch.setattr(files, "resource", usage)
    assert inside() == {}
    assert inside() == {"problem": "reading took 1024 MiB"}


def test_a_watch_sees_what_is_executed_and_written_while_it_is_on(monkeypatch: pytest.MonkeyPatch) -> None:
    hooks: list[Any] = []
    monkeypatch.setattr(files.sys, "addaudithook", hooks.append)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/cache")
    watch = files._Watch()
    watch._note("os.system", ("x",))
    watch.begin()
    watch.begin()
    assert len(hooks) == 1
    for event, arguments, seen in (
        ("os.system", ("x",), True), ("subprocess.Popen", ("x",), True), ("socket.connect", ("x",), True),
        ("open", ("a", "r", 0), False), ("open", ("a", "rb", os.O_RDONLY), False), ("open", ("a", "w", 0), True),
        ("open", ("a", "r+", 0), True), ("open", ("a", None, os.O_WRONLY), True),
        ("open", ("a", None, os.O_RDWR), True),
        ("open", ("a", None, None), False), ("open", ("/cache/a", "w", 0), False),
        ("open", ("/dev/null", "w", 0), False),
        ("open", ("a.pyc.1", "w", 0), False), ("os.rename", ("a", "b"), True), ("os.rename", ("/cache/a", "b"), False),
        ("os.mkdir", ("a",), False),
    ):  # fmt: skip
        before = len(watch._seen)
        hooks[0](event, arguments)
        assert len(watch._seen) - before == seen, (event, arguments)
    found = watch.end()
    hooks[0]("os.system", ("x",))
    assert len(found) == 8
    watch.begin()
    assert watch.end() == []


def test_what_was_read_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.json"
    use.used(7, file)
    use.used({"policy": "lqr", "gains": {}}, file)
    with pytest.raises(ValueError, match=r"^a\.json: "):
        use.used({"policy": "lqr", "gains": {"nothing": 1}}, file)
    use.used({"policy": 1, "gains": {"nothing": 1}}, file)
    use.used({"policy": "nobody", "gains": 1}, file)
    use.used({"0": Trajectory(np.zeros(2), np.zeros((2, 3)))}, file)
    with pytest.raises(AssertionError, match="not finite"):
        use.used({"0": Trajectory(np.zeros(2), np.full((2, 3), np.nan))}, file)
    use.used((1, 2), file)

    class Driven:
        def __init__(self, reward: float = 0.0, contains: bool = True, ends: int = 10**9) -> None:
            self.action_space = Space()
            self.observation_space = types.SimpleNamespace(contains=lambda _: contains)
            self.unwrapped, self.reward, self.ends = self, reward, ends
            self.seeds: list[Any] = []
            self.actions: list[Any] = []

        def reset(self, seed: int) -> None:
            self.seeds.append(seed)

        def step(self, action: Any) -> Any:
            assert (abs(action) <= Space.high).all()
            self.actions.append(action)
            return None, self.reward, len(self.actions) % self.ends == 0, False, {}

    made: list[Any] = []
    for env, count in ((Driven(), 75), (Driven(ends=10), 30)):
        monkeypatch.setattr(use.gymnasium, "make", lambda *words, env=env, **more: made.append((words, more)) or env)
        use._driven("id", scenario="x")
        assert env.seeds == [0, 1, 2]
        assert len(env.actions) == count
        assert (env.actions[0] == np.random.default_rng(0).uniform(Space.low, Space.high)).all()
        assert made[-1] == (("id",), {"disable_env_checker": True, "scenario": "x"})
    for env in (Driven(np.nan), Driven(contains=False)):
        monkeypatch.setattr(use.gymnasium, "make", lambda *_, env=env, **__: env)
        with pytest.raises(AssertionError, match="id yields reward"):
            use._driven("id")
    driven: list[Any] = []
    monkeypatch.setattr(use, "_driven", lambda env_id, **more: driven.append((env_id, more)))
    goal = object.__new__(use.GoalScenario)
    path = object.__new__(use.PathScenario)
    use.used(goal, file)
    use.used(path, file)
    named = {"scenario": str(file)}
    assert driven == [
        ("wayfield/DiffDriveGoalObstacles-v0", named), ("wayfield/OmniGoalObstacles-v0", named),
        ("wayfield/DiffDrivePathFollowing-v0", named),
    ]  # fmt: skip
    assert all(env_id in gymnasium.registry for env_id, _ in driven)


# ---- forks, the worker and its server


def test_a_command_in_a_fork_ends_as_it_would_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()

    def started(main: Any, name: str = "audit", before: Any = None) -> forks.Fork:
        monkeypatch.setattr(forks, "found", lambda _: main)
        return forks.Fork(name, ["a", "b"], folder, before)

    def says() -> None:
        print(" ".join(sys.argv), os.getcwd())
        print("wrong", file=sys.stderr)
        sys.exit(3)

    assert started(says).wait(20.0) == Ended(3, f"audit a b {folder}\n", "wrong\n")
    assert not [each for each in tmp_path.iterdir() if each != folder]  # what it said was taken along

    def ends(code: Any) -> Any:
        return lambda: sys.exit(code)

    for code, status, err in ((None, 0, ""), (0, 0, ""), ("no", 1, "no\n"), (7, 7, "")):
        assert started(ends(code)).wait(20.0) == Ended(status, "", err)
    # whatever bytes it says
    assert started(lambda: sys.exit(os.write(1, b"a\xff"))).wait(20.0) == Ended(2, "a\ufffd", "")

    def raises() -> None:
        raise ValueError("x")

    ended = started(raises).wait(20.0)
    assert ended.status == 1
    assert ended.err.endswith("ValueError: x\n")
    assert (
        started(lambda: sys.exit(len(os.environ.get("X", ""))), before=lambda: os.environ.update(X="xx"))
        .wait(20.0)
        .status
        == 2
    )

    def sleeps() -> None:
        time.sleep(60.0)

    running = started(sleeps)
    assert not running.ended()
    before = life.signs
    assert not running.ends_within(0.03)
    assert life.signs > before
    running.send(signal.SIGKILL)
    assert running.ends_within(20.0)
    assert running.ended()
    assert running.left() == []
    running.send(signal.SIGKILL)  # to nobody
    assert running.wait(1.0).status == -signal.SIGKILL
    assert started(sleeps).wait(0.03).status is None
    monkeypatch.setattr(forks, "on_cores", lambda count, before: lambda: os.environ.update(X="x" * (4 + count)))
    assert started(lambda: sys.exit(len(os.environ.get("X", ""))), "train").wait(20.0).status == 5


def test_forks_stand_in_for_a_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        forks, "found", lambda name: lambda: ran.append((name, list(sys.argv), os.getcwd())) or sys.exit(0)
    )
    monkeypatch.setattr(forks, "_LATER", ())
    ran: list[Any] = []
    made = forks.Forks()
    words, here = list(sys.argv), Path.cwd()
    made.warm("audit", ["x"], tmp_path)
    assert ran == [("audit", ["audit", "x"], str(tmp_path))]
    assert (sys.argv, Path.cwd()) == (words, here)
    asked: list[Any] = []

    class Seen:
        def __init__(self, *arguments: Any) -> None:
            asked.append(arguments)

        def wait(self, limit: float) -> Ended:
            asked.append(limit)
            return Ended(0, "", "")

    monkeypatch.setattr(forks, "Fork", Seen)
    assert made.run("audit", ["y"], tmp_path, before=len) == Ended(0, "", "")  # type: ignore[arg-type]
    made.warm("train", ["z"], tmp_path)
    assert asked == [("audit", ["y"], tmp_path, len), 60.0, ("train", ["z"], tmp_path, None), 600.0]
    monkeypatch.chdir(tmp_path)
    with made.folder() as one, made.folder() as other:
        assert one.parent == other.parent == tmp_path
        assert one != other
    assert not one.exists()
    assert not other.exists()
    monkeypatch.setattr(forks, "_forks", lambda: "forks")
    module = types.SimpleNamespace(attempt=lambda *words: asked.append(words) or answers.pop(0))
    monkeypatch.setattr(forks.importlib, "import_module", lambda name: asked.append(name) or module)
    answers: list[Any] = ["bad", None]
    assert forks.inside({"group": "kills", "trial": {"a": 1}}) == {"problem": "bad"}
    assert asked[-2:] == ["wayfield.benchmarks.faults.kills", ({"a": 1}, "forks", None)]
    assert forks.inside({"group": "kills", "trial": {}}) == {}


def test_the_worker_answers_a_line_with_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[bytes] = []
    limits: list[Any] = []
    monkeypatch.setattr(worker, "end_with_parent", lambda number: limits.append(number))
    monkeypatch.setattr(worker.resource, "setrlimit", lambda *what: limits.append(what))
    monkeypatch.setattr(worker.os, "dup", lambda number: 40 + number)
    monkeypatch.setattr(worker.os, "dup2", lambda *what: limits.append(what))
    monkeypatch.setattr(worker.os, "write", lambda number, text: written.append((number, text)))
    monkeypatch.setattr(worker.event, "register", lambda *_: None)
    monkeypatch.setattr(worker.threading, "Thread", lambda **_: types.SimpleNamespace(start=lambda: None))
    monkeypatch.setattr(worker.traceback, "print_exc", lambda: None)

    def inside(spec: Any) -> Any:
        if "error" in spec:
            raise KeyError("a\n b")
        return {"got": spec}

    seen: list[str] = []
    module = types.SimpleNamespace(inside=inside)
    monkeypatch.setattr(worker.importlib, "import_module", lambda name: seen.append(name) or module)
    monkeypatch.setattr(worker.sys, "argv", ["x", "77", "1000"])
    monkeypatch.setattr(worker.sys, "stdin", io.StringIO('["files", {"a": 1}]\n["steps", {"error": 1}]\n'))
    worker.main()
    assert limits == [77, (resource.RLIMIT_AS, (1000, 1000)), (resource.RLIMIT_CORE, (0, 0)), (2, 1)]
    assert seen == ["wayfield.benchmarks.faults.files", "wayfield.benchmarks.faults.steps"]
    assert [json.loads(text) for _, text in written] == [{"got": {"a": 1}}, {"problem": "KeyError: 'a\\n b'"}]
    assert all(number == 41 and text.endswith(b"\n") for number, text in written)
    listener = worker._Compiling()
    listener.on_start(None)  # type: ignore[arg-type]
    listener.on_start(None)  # type: ignore[arg-type]
    listener.on_end(None)  # type: ignore[arg-type]
    assert listener.depth == 1


def test_a_server_asks_counts_and_says_how_its_worker_ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pieces: list[Any] = []
    written: list[bytes] = []
    ended: list[Any] = []

    class Process:
        pid = 5

        def __init__(self) -> None:
            self.stdin = types.SimpleNamespace(
                write=written.append, flush=lambda: None, close=lambda: ended.append("in")
            )
            self.stdout = types.SimpleNamespace(fileno=lambda: 9, close=lambda: ended.append("out"))

        def wait(self) -> int:
            return -11

        def kill(self) -> None:
            ended.append("kill")

    class Selector:
        def __enter__(self) -> "Selector":
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def register(self, *_: object) -> None:
            pass

        def select(self, timeout: float) -> bool:
            clock["now"] += timeout
            return pieces[0] is not None

    clock = {"now": 0.0, "spent": 0.0}
    monkeypatch.setattr(server.selectors, "DefaultSelector", Selector)
    monkeypatch.setattr(server.os, "read", lambda number, size: pieces.pop(0))
    monkeypatch.setattr(server.time, "monotonic", lambda: clock["now"])
    monkeypatch.setattr(server, "computed", lambda pid: clock["spent"])
    monkeypatch.setattr(server, "end_marked", lambda mark: ended.append("marked"))
    started: list[Any] = []

    def popen(line: Any, **more: Any) -> Process:
        started.append((line, more))
        return Process()

    monkeypatch.setattr(server.subprocess, "Popen", popen)
    (tmp_path / "work").mkdir()
    work = types.SimpleNamespace(
        out=tmp_path, scratch=tmp_path, environment=lambda mark, **more: {"mark": mark, **more}
    )
    asked = server.Server(work, NUMBA_BOUNDSCHECK="1")  # type: ignore[arg-type]
    pieces[:] = [b"..", b'.{"steps"', b": 7}\n", b'{"problem": "bad", "steps": 2}\n', b"{}\n"]
    assert asked.ask("steps", {"a": 1}) is None
    assert asked.steps == 7
    assert asked.ask("steps", {}) == "bad"
    assert asked.steps == 9
    assert asked.ask("files", {}) is None
    assert asked.steps == 9
    assert [json.loads(each) for each in written] == [["steps", {"a": 1}], ["steps", {}], ["files", {}]]
    ((line, more),) = started
    assert line[1:] == ["-m", "wayfield.benchmarks.faults.worker", str(os.getpid()), str(12 << 30)]
    assert more["env"]["NUMBA_CACHE_DIR"] == str(tmp_path / "work" / "compiled_checked")
    assert (more["env"]["NUMBA_BOUNDSCHECK"], more["cwd"]) == ("1", tmp_path)
    assert (tmp_path / "work" / "worker.log").exists()
    pieces[:] = [b""]
    assert asked.ask("steps", {}) == "crash: SIGSEGV"
    assert ended == ["marked", "kill", "in", "out"]
    asked.close()  # nobody is there
    assert len(ended) == 4
    # it computes without a sign of life, or no end is seen
    for spent, told in ((21.0, "no end: 21 s of computing"), (0.0, "no end: 0 s of computing")):
        pieces[:] = [None]
        clock["spent"] = 0.0
        reads = iter([0.0, 19.0, spent])
        last = {"is": 0.0}
        monkeypatch.setattr(
            server,
            "computed",
            lambda pid, reads=reads, last=last: last.__setitem__("is", next(reads, last["is"])) or last["is"],
        )
        if not spent:
            monkeypatch.setattr(server, "computed", lambda pid: 0.0)
        began = clock["now"]
        assert asked.ask("steps", {}) == told
        assert (clock["now"] - began > 600.0) is (spent == 0.0)
    assert len(started) == 3
    assert server._ended(3) == "crash: the process ended with status 3"


# ---- the command


def test_the_command_counts_adds_up_and_ends_with_status_1_where_any_failed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    handlers: list[Any] = []
    asked: list[Any] = []
    closed: list[Path] = []
    counts = {"steps": campaign.Count(1200, 0, 34_000, 5.0), "files": campaign.Count(7, 0, 0, 1.0)}
    totals = {"steps": {"tried": 1300, "failed": 2, "steps": 40_000}, "files": {"tried": 7, "failed": 1, "steps": 0}}

    class Place:
        def __init__(self, out: Path) -> None:
            self.out = out

        def close(self) -> None:
            closed.append(self.out)

    monkeypatch.setattr(command.signal, "signal", lambda number, handler: handlers.append(number))
    monkeypatch.setattr(command, "Place", Place)
    monkeypatch.setattr(command, "run", lambda place, *words: asked.append((place.out, *words[:3])) or counts)
    monkeypatch.setattr(command, "totals_of", lambda out: totals)
    out = tmp_path / "deep" / "out"
    done = CliRunner().invoke(command.main, ["--out", str(out)])
    assert done.exit_code == 0, done.output
    assert handlers == [signal.SIGTERM, signal.SIGINT]
    assert asked == [(out, tuple(campaign.GROUPS), 10.0, 0)]
    assert done.output.splitlines() == [
        "steps        1,200 tried,     0 failed,     5.0 s, 34,000 steps",
        "files            7 tried,     0 failed,     1.0 s",
        "in this folder so far 1,307 tried, 3 failed, 40,000 steps",
    ]
    counts["files"].failed = 1
    done = CliRunner().invoke(command.main, ["--out", str(out), "--only", "files", "--minutes", "2", "--seed", "9"])
    assert done.exit_code == 1
    assert asked[1] == (out, ("files",), 2.0, 9)
    assert closed == [out, out]
    repeats: list[Any] = []
    for answer, status, said in (("bad", 1, "bad"), (None, 0, "nothing is wrong any more")):
        monkeypatch.setattr(command, "repeated", lambda place, file, answer=answer: repeats.append(file) or answer)
        done = CliRunner().invoke(command.main, ["--out", str(out), "--repeat", "x.json"])
        assert (done.exit_code, done.output) == (status, f"{said}\n")
    assert repeats == [Path("x.json")] * 2
    for error in (ValueError("no trial"), OSError("no trial")):
        monkeypatch.setattr(command, "repeated", lambda *_, error=error: (_ for _ in ()).throw(error))
        done = CliRunner().invoke(command.main, ["--out", str(out), "--repeat", "x.json"])
        assert done.exit_code == 2
        assert "no trial" in done.output
    assert len(closed) == 6
    for words in (["--minutes", "nan"], ["--minutes", "0"], ["--out", ""], ["--only", "x"]):
        assert CliRunner().invoke(command.main, words).exit_code == 2
    assert len(asked) == 2
