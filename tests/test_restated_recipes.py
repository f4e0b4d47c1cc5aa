"""What the page is handed to decide and to step, made anew for a few and held against what ships with the page."""

import base64
import json
from importlib import resources
from typing import Any

import numpy as np
import pytest

from wayfield.benchmarks.contests import CONTESTS, Contest
from wayfield.benchmarks.report import recipes
from wayfield.benchmarks.report.recipes import Blobs

PAGE = resources.files("wayfield.benchmarks.report") / "page"


@pytest.fixture(scope="module")
def shipped() -> Any:
    return json.loads((PAGE / "kernels.json").read_text(encoding="utf-8"))


def resolved(value: Any, blobs: list[str], key: str = "") -> Any:
    """Returns tables with constants in place of their numbers."""
    if isinstance(value, dict):
        inside = {name: resolved(each, blobs, name) for name, each in value.items() if name != "params"}
        params = {name: blobs[each] for name, each in value.get("params", {}).items()}
        return inside | ({"params": params} if "params" in value else {})
    if isinstance(value, list | tuple):
        return [resolved(each, blobs) for each in value]
    return blobs[value] if key in ("blob", "sizes", "numbers", "directions") and isinstance(value, int) else value


@pytest.mark.parametrize("task", ["path_following", "goal_reaching", "docking"])
def test_a_task_is_stepped_by_these_tables(task: str, shipped: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recipes, "FITTING", ("omni3", "p3dx"))
    monkeypatch.setattr(recipes, "ACTUATORS", ("lagged",))
    monkeypatch.setattr(recipes, "DISTURBANCES", ("none", "severe"))
    blobs = Blobs()
    told = json.loads(json.dumps(recipes.task_tables(task, blobs)))
    found, wanted = resolved(told, blobs.listed()), resolved(shipped["tasks"][task], shipped["blobs"])
    assert set(found["params"]) == {
        f"{robot} lagged {level}" for robot in ("omni3", "p3dx") for level in ("none", "severe")
    }
    assert set(found["robots"]) == {"omni3", "p3dx"}
    for name in ("params", "robots"):
        wanted[name] = {key: each for key, each in wanted[name].items() if key in found[name]}
    assert found == wanted


@pytest.mark.parametrize(
    ("task", "robot", "actuators", "name", "gains_name"),
    [
        ("path_following", "p3dx", "lagged", "lqr", "tuned"),
        ("path_following", "omni3", "slow", "stanley", "default"),
        ("goal_reaching", "omni3", "lagged", "scan_planner", "default"),
        ("goal_reaching", "p3dx", "ideal", "dwa", "paper"),
        ("docking", "p3dx", "lagged", "polar", "default"),
    ],
)
def test_a_law_decides_by_this_recipe(
    task: str, robot: str, actuators: str, name: str, gains_name: str, shipped: Any
) -> None:
    contest = next(each for each in CONTESTS.values() if each.spec.name == task)
    env = recipes.environment(task, robot, actuators, f"{contest.timed_on}/test")
    sets = dict(contest.gain_sets(name, robot, ("default", "tuned", "paper")))
    blobs = Blobs()
    told = json.loads(json.dumps(recipes.recipe(task, name, sets[gains_name], env, blobs)))
    label = name if gains_name == "default" else f"{name} ({gains_name})"
    wanted = shipped["pilots"][f"{task} {robot} {actuators} {label}"]
    assert resolved(told, blobs.listed()) == resolved(wanted, shipped["blobs"])
    env.close()


@pytest.mark.parametrize(
    ("task", "robot"), [("path_following", "p3dx"), ("goal_reaching", "omni3"), ("docking", "p3dx")]
)
def test_an_agent_decides_by_this_recipe(task: str, robot: str, shipped: Any) -> None:
    contest = next(each for each in CONTESTS.values() if each.spec.name == task)
    env = recipes.environment(task, robot, "ideal", f"{contest.timed_on}/test")
    blobs = Blobs()
    told = json.loads(json.dumps(recipes.network_recipe(task, robot, 0, env, blobs)))
    found = resolved(told, blobs.listed())
    wanted = resolved(shipped["pilots"][f"{task} {robot} ideal ppo (trained)"], shipped["blobs"])
    # from an exponential, of which NumPy's releases have other last bits
    np.testing.assert_allclose(found.pop("shares", []), wanted.pop("shares", []), rtol=1e-12)
    assert found == wanted
    env.close()


def test_the_rest_of_the_tables(shipped: Any) -> None:
    assert json.loads(json.dumps(recipes.disturbance_tables())) == shipped["disturbances"]
    assert list(recipes.ACTUATORS) == shipped["tiers"]
    assert {name: recipes.layout(each) for name, each in recipes._RECORDS.items()} == shipped["records"]
    every = {task for task, _ in recipes.jobs()}
    assert every == set(shipped["tasks"])
    robots = {key.split()[1] for key in shipped["pilots"]}
    assert robots == set(recipes.FITTING)
    there = {(key.split()[0], key.split()[3]) for key in shipped["pilots"]}
    assert {job for job in recipes.jobs() if job[1]} == there
    assert len(shipped["blobs"]) == len(set(shipped["blobs"]))
    assert all(base64.b64decode(each) for each in shipped["blobs"])


def test_the_page_has_every_law_by_its_sets_and_of_the_agents_the_first(
    shipped: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recipes, "FITTING", ("p3dx",))
    monkeypatch.setattr(recipes, "ACTUATORS", ("lagged",))
    monkeypatch.setattr(recipes, "environment", lambda *words: words)
    monkeypatch.setattr(recipes, "task_tables", lambda task, blobs: blobs.put(np.array([len(task)])))
    monkeypatch.setattr(recipes, "recipe", lambda task, name, gains, env, blobs: (task, name, gains, env))
    monkeypatch.setattr(recipes, "network_recipe", lambda task, robot, seed, env, blobs: (task, robot, seed, env))
    # as where a single agent ships
    found = Contest.gain_sets
    monkeypatch.setattr(
        Contest, "gain_sets", lambda *words: [("trained", {"seed": 0})] if words[1] == "ppo" else found(*words)
    )
    told = recipes.tables()
    assert list(told["tasks"]) == list(shipped["tasks"])
    assert set(told["pilots"]) == {key for key in shipped["pilots"] if key.split()[1:3] == ["p3dx", "lagged"]}
    for key, (task, of, which, env) in told["pilots"].items():
        name, _, gains_name = key.split(maxsplit=3)[3].partition(" (")
        contest = next(each for each in CONTESTS.values() if each.spec.name == task)
        assert key.startswith(f"{task} p3dx lagged ")
        assert env == (task, "p3dx", "lagged", f"{contest.timed_on}/test")
        if name == "ppo":
            assert (of, which) == ("p3dx", 0)
        else:
            sets = dict(found(contest, name, "p3dx", ("default", "tuned", "paper")))
            assert (of, which) == (name, sets[gains_name[:-1] or "default"])
    assert len(told["blobs"]) == len({len(task) for task in shipped["tasks"]})
