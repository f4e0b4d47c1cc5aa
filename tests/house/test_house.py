"""Rules of the house that the source itself must keep."""

import ast
import functools
import graphlib
import importlib.util
import itertools
import os
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import pytest

from wayfield.benchmarks.contests import CONTESTS
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies import POLICIES

MOST_LINES = 80  # of a function, without its docstring

ROOT = Path(__file__).parents[2]
PACKAGES = ("system", "envs", "policies", "benchmarks", "bridges")
LAWS = ("paths", "references", "poses", "scans", "teams", "trained")  # rooms of policies
NO_LAWS = {"policies/scans/costmap"}
FLOORS = {"policies/zero", "policies/random"}
# Where a class of one task is asked for, and why that is no second notion of a task.
ASKS_FOR_A_CLASS = {
    "envs/scenarios/team_scenario.py": "the robots of a team are goal seekers, each of them",
    "benchmarks/episodes/rollout.py": "hands what a path follower alone has to the metrics of paths",
    "policies/learned/perception.py": "crumbs are what goal seekers alone drop",
    "policies/training/presets.py": "features of a path have a preview, those of goals a scan",
}
OF_ONE_TASK = {
    *("PathScenario", "GoalScenario", "DockingScenario", "PathFollowing", "GoalReaching", "Docking"),
    *("PathFeatures", "GoalFeatures", "DockFeatures", "PathReward", "GoalReward", "Observation"),
}

# What lies at the root: the folders, and the files that somebody or some tool looks for there.
AT_THE_ROOT = {
    *(".ci", ".github", "benchmarks", "bridges", "docs", "envs", "examples", "package", "policies", "tests"),
    *("CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "README.md"),
    *(".gitignore", "constraints-oldest.txt", "constraints.txt", "pyproject.toml", "setup.cfg"),
    *("evaluate.py", "train.py"),
}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@functools.cache
def trees() -> dict[str, ast.Module]:
    """Returns every module of the installed package, parsed, by room and file."""
    found = {}
    for room in PACKAGES:
        spec = importlib.util.find_spec(f"wayfield.{room}")
        assert spec is not None
        assert spec.submodule_search_locations
        folder = Path(next(iter(spec.submodule_search_locations)))
        # parts of an installation may be links, which rglob does not follow
        walked = (Path(here, name) for here, _, names in os.walk(folder, followlinks=True) for name in names)
        for file in sorted(each for each in walked if each.suffix == ".py"):
            name = f"{room}/{file.relative_to(folder).as_posix()}"
            if "studies" in name:  # of a clone, beside what is installed
                continue
            found[name] = ast.parse(file.read_text(encoding="utf-8"))
    return found


@functools.cache
def nodes() -> dict[str, list[ast.AST]]:
    """Returns all nodes of every module of the installed package: to walk them takes as long as all that is asked."""
    return {name: list(ast.walk(tree)) for name, tree in trees().items()}


@pytest.fixture(scope="module", autouse=True)
def _forgotten() -> Iterator[None]:
    """Lets go of a million nodes, which every collection of garbage of the tests behind these would look at."""
    yield
    for each in (trees, nodes, modules_of_tests):
        each.cache_clear()


def lines(function: Function) -> int:
    """Returns how many lines a function has, from `def` on, without its docstring."""
    first = function.body[0]
    docstring = first.end_lineno - first.lineno + 1 if ast.get_docstring(function) is not None else 0  # type: ignore[operator]
    return function.end_lineno - function.lineno + 1 - docstring  # type: ignore[operator]


def test_no_function_is_longer_than_a_page() -> None:
    functions = ((name, node) for name, found in nodes().items() for node in found if isinstance(node, Function))
    long = {f"{name}:{node.name}": length for name, node in functions if (length := lines(node)) > MOST_LINES}
    assert not long


def test_nothing_lies_at_the_root_by_accident() -> None:
    told = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if told.returncode != 0:
        pytest.skip("no git repository")
    assert {name.split("/")[0] for name in told.stdout.splitlines()} - AT_THE_ROOT == set()


def rooms() -> list[str]:
    """Returns the rooms of the table in docs/architecture.md, lowest floor first."""
    table = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("## Rooms")[2]
    return re.findall(r"^\| `([\w/]+)` \|", table.partition("\n## ")[0], re.MULTILINE)


def room_of(module: str, known: Sequence[str]) -> str | None:
    """Returns the room of a module, the innermost one, by its dotted name without the package's."""
    parts = module.split(".")
    parts = ["package", *parts] if parts[0] == "system" else parts
    names = ("/".join(parts[:count]) for count in range(len(parts), 0, -1))
    return next((name for name in names if name in known), None)


def imported(module: Sequence[ast.AST]) -> Iterator[str]:
    """Yields what a module imports of the package, wherever in it, by dotted names without the package's."""
    for node in module:
        names = []
        if isinstance(node, ast.Import):
            names = [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names = [f"{node.module}.{each.name}" for each in node.names]
        for name in names:
            package, _, rest = name.partition(".")
            if package == "wayfield" and rest:
                yield rest


def test_a_room_imports_from_rooms_above_it_in_the_table_of_the_architecture() -> None:
    known = rooms()
    assert len(known) > 15
    upward = set()
    for name, found in nodes().items():
        if name in ("benchmarks/__init__.py", "bridges/__init__.py"):  # of no room
            continue
        own = room_of(name.removesuffix(".py").replace("/", "."), known)
        assert own is not None, f"{name} is in no room of docs/architecture.md"
        for module in imported(found):
            room = room_of(module, known)
            if room is not None and known.index(room) > known.index(own):
                upward.add((name, room))
    assert upward == set()


def while_loaded(body: Sequence[ast.AST]) -> Iterator[ast.AST]:
    """Yields what runs when a module is loaded: not what stands in functions, nor what only type checkers read."""
    for node in body:
        if isinstance(node, Function) or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)):
            continue
        yield node
        for branch in ("body", "handlers", "orelse", "finalbody"):
            yield from while_loaded(getattr(node, branch, ()))


def test_no_modules_import_each_other_while_they_are_loaded() -> None:
    modules = {name.removesuffix(".py").removesuffix("/__init__").replace("/", "."): name for name in trees()}
    needs: dict[str, set[str]] = {}
    for own, name in modules.items():
        needs[own] = set()
        for dotted in imported(list(while_loaded(trees()[name].body))):
            there = [each for each in itertools.accumulate(dotted.split("."), "{}.{}".format) if each in modules]
            # packages on the way are loaded first; a module's own have begun before it
            needs[own] |= {*there[-1:], *(each for each in there[:-1] if not own.startswith(f"{each}."))}
        needs[own].discard(own)
    graphlib.TopologicalSorter(needs).prepare()  # raises CycleError, which names the modules of a circle


def test_every_law_is_a_policy_by_name() -> None:
    def module(policy: Callable[..., Any]) -> str:
        return str((policy.func if isinstance(policy, functools.partial) else policy).__module__)

    of_laws = tuple(f"policies/{each}/" for each in LAWS)
    laws = {name.removesuffix(".py") for name in trees() if name.startswith(of_laws) and "__init__" not in name}
    registered = {module(policy).removeprefix("wayfield.").replace(".", "/") for policy in POLICIES.values()}
    assert registered == (laws - NO_LAWS) | FLOORS


def test_every_task_has_a_contest_and_a_world_for_every_robot() -> None:
    assert {spec.suite for spec in TASKS.values()} <= set(CONTESTS)
    for spec in TASKS.values():
        for robot in ROBOTS.values():
            # not docking's default: frozen families have no room for a large hull, presets for every one
            env: Any = gymnasium.make(spec.env_id(robot), robot=robot.name, scenario=next(iter(spec.presets))).unwrapped
            assert env.task.spec is spec
            assert env.task.robot is robot


def test_nobody_guesses_which_task_it_is() -> None:
    """No comparison with a task's name, and no class of one task asked for; a registry by name is a lookup."""
    names = {word for spec in TASKS.values() for word in (spec.name, spec.suite)}
    asking = set()
    for name, found in nodes().items():
        for node in found:
            if isinstance(node, ast.Compare):
                constants = {each.value for each in ast.walk(node) if isinstance(each, ast.Constant)}
                assert not names & constants, f"{name}:{node.lineno}"
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance":
                wanted = {each.id for each in ast.walk(node.args[1]) if isinstance(each, ast.Name)}
                wanted |= {each.attr for each in ast.walk(node.args[1]) if isinstance(each, ast.Attribute)}
                if wanted & OF_ONE_TASK:
                    asking.add(name)
    assert asking <= set(ASKS_FOR_A_CLASS)


# What a task that is another with other numbers takes, tests and pages aside; CONTRIBUTING.md has the same list.
FILES_OF_A_TASK = {
    *("envs/{task}.py", "envs/scenarios/{task}_families.py", "envs/tasks/specs.py"),
    *("envs/scenarios/splits/{task}.json", "envs/scenarios/splits/{task}_claims.json"),
    *("benchmarks/contests/{task}.py", "benchmarks/contests/__init__.py"),
}
# Where it is named besides, because somebody wanted to.
NAMES_A_TASK = {
    "policies/registry.py": "the contest that a policy enters",
    "policies/learned/perception.py": "what its agents see",
    "policies/training/presets.py": "how they are trained",
    "policies/training/ways.py": "along what their progress is measured",
    "policies/training/measured.py": "in what they are measured besides",
}


def words(module: Sequence[ast.AST]) -> Iterator[str]:
    """Yields what a module's code names: variables, attributes, modules, texts; not its comments and docstrings."""
    told = set()
    for node in module:
        if isinstance(node, ast.Module | ast.ClassDef | Function) and ast.get_docstring(node) is not None:
            told.add(node.body[0].value)  # type: ignore[attr-defined]
    for node in module:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in told:
            yield node.value
        elif isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{each.name}" for each in node.names)


def test_a_task_with_other_numbers_takes_few_files() -> None:
    naming = {name for name, found in nodes().items() if any("docking" in word.lower() for word in words(found))}
    wanted = {name.format(task="docking") for name in FILES_OF_A_TASK if name.endswith(".py")}
    assert wanted <= naming <= wanted | set(NAMES_A_TASK)


# Tests go through the public interface. What they patch of the package all the same, with the reason why; an object's
# attribute bears the name of its variable.
PATCHED = {
    "wayfield.benchmarks.figures.document_figures.draw": "figures take as long as the rest of a run",
    "wayfield.benchmarks.figures.contest_figures.draw_contest": "as above",
    "wayfield.benchmarks.statistics.aggregates.MANY": "rows from which on an interval is estimated otherwise",
    "wayfield.benchmarks.records.archive.MOST_BYTES": "a limit of gigabytes",
    "wayfield.benchmarks.runs.shards.episodes_together": "what becomes of the files of a part, whoever drove it",
    "wayfield.benchmarks.runs.shards.keep": "workers are killed in the moment in which a part is kept",
    "wayfield.bridges.coppelia.calls_data.MAX_STORED": "a limit of megabytes",
    "wayfield.bridges.coppelia.server.MAX_CLIENTS": "a limit of many connections",
    "wayfield.bridges.coppelia.server.MAX_MESSAGE": "a limit of megabytes",
    "wayfield.envs.robots.disturbances.DISTURBANCES.made": "single causes, which no level has",
    "wayfield.policies.learned.agent.Agent.keeps_pace": "a set does not tell what an agent remembers",
    "wayfield.envs.goal_reaching.field_scenarios": "a thousand starts that no split holds",
    "wayfield.envs.scenarios.splits.FOLDER": "damaged splits, in place of those that ship",
    "wayfield.envs.scenarios.tables.MOST_POINTS": "a limit of millions",
    "wayfield.policies.poses.astar_tracker.CELLS": "gaps of one cell, on a grid small enough for brute force",
    "wayfield.policies.poses.astar_tracker.WIDE": "as above",
    "wayfield.policies.training.presets.PRESETS.PLAIN": "a preset that is trained in seconds",
    "wayfield.policies.training.proximal.Proximal.train": "an update that leaves weights which are not finite",
    "wayfield.policies.training.run.validate": "validations of seconds: whole ones take longer than all the rest",
}
# What is read of a private name, and why.
PRIVATE = {
    **dict.fromkeys(("_asdict", "_fields", "_replace"), "public names of every named tuple"),
    "_exit": "os._exit is public",
    "_Run": "a training that goes on from a damaged state, up to its first update",
    "_client": "the process ids of a cluster's workers, one of which is killed",
}
PATCHES = {"setattr", "delattr", "setitem", "delitem"}


@functools.cache
def modules_of_tests() -> dict[str, ast.Module]:
    """Returns every module of the rooms of the tests, parsed, by its path."""
    home = Path(__file__).parents[1]
    files = [home / "conftest.py", *sorted(home.glob("*/*.py"))]
    return {file.relative_to(home).as_posix(): ast.parse(file.read_text(encoding="utf-8")) for file in files}


def origins(tree: ast.Module) -> dict[str, str]:
    """Returns the dotted name of everything that a module imports, by the name that it has there."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for each in node.names:
                first = each.name.split(".")[0]
                found[each.asname or first] = each.name if each.asname else first
        elif isinstance(node, ast.ImportFrom):
            found |= {each.asname or each.name: f"{node.module}.{each.name}" for each in node.names}
    return found


def patched(tree: ast.Module) -> Iterator[str]:
    """Yields the dotted name of what a module patches of the package, or of an object that it has made."""
    known = origins(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in PATCHES:
            owner, *rest = node.args
            if isinstance(owner, ast.Constant):
                name = str(owner.value)
            else:
                root, _, path = ast.unparse(owner).partition(".")
                of = rest[0].value if isinstance(rest[0], ast.Constant) else ast.unparse(rest[0])
                name = ".".join(part for part in (known.get(root, root), path, str(of)) if part)
            if root_of(name) == "wayfield" or root_of(name) not in {root_of(each) for each in known.values()}:
                yield name
        elif isinstance(node, ast.Import | ast.ImportFrom):
            assert not any("mock" in each.name for each in node.names)


def root_of(name: str) -> str:
    return name.split(".")[0]


def read_privately(tree: ast.Module) -> Iterator[str]:
    """Yields private names of others that a module reads: attributes, imports, and names in dotted texts."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Attribute) and node.attr[0] == "_" and ast.unparse(node.value) not in {"self", "cls"}:
            names = [node.attr]
        elif isinstance(node, ast.ImportFrom):
            names = [each.name for each in node.names]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("wayfield."):
            names = node.value.split(".")
        yield from (each for each in names if each.startswith("_") and not each.startswith("__"))


def test_tests_patch_nothing_of_the_package_but_what_is_listed() -> None:
    patches = {(file, each) for file, tree in modules_of_tests().items() for each in patched(tree)}
    assert {(file, each) for file, each in patches if each not in PATCHED} == set()
    assert {each for _, each in patches} >= {"wayfield.benchmarks.runs.shards.keep"}, "finds none"


def test_tests_read_no_private_names_but_what_is_listed() -> None:
    reads = {(file, each) for file, tree in modules_of_tests().items() for each in read_privately(tree)}
    assert {(file, each) for file, each in reads if each not in PRIVATE} == set()
