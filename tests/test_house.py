"""Rules of the house that the source itself must keep."""

import ast
import functools
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium

from wayfield.benchmarks.contests import CONTESTS
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies import POLICIES

MOST_ARGUMENTS = 10
MOST_LINES = 80  # of a function, without its docstring

# More arguments, with the reason why: what a user may choose is an option of its own; compiled entry points take the
# arrays of a batch one by one, since a compiled call pays for a bundle.
WIDE = {
    "benchmarks/tune.py:main",
    "envs/sandbox.py:step_rows",
    "envs/goal_reaching.py:__init__",
    "envs/goal_reaching.py:reset_rows",
    "envs/goal_reaching.py:step_rows",
    "envs/path_following.py:__init__",
    "envs/path_following.py:reset_rows",
    "envs/path_following.py:step_rows",
}

# What a room may import besides itself: the one direction.
BELOW = {"envs": set(), "policies": {"envs"}, "benchmarks": {"envs", "policies"}}
# Of policies, what is no law.
NO_LAWS = {"__init__", "pilot", "policy", "registry", "tuned"}
# Where a class of one task is asked for, and why that is no second notion of a task.
ASKS_FOR_A_CLASS = {
    "benchmarks/rollout.py": "hands what a path follower alone has to the metrics of paths",
    "policies/learned/perception.py": "crumbs are what goal seekers alone drop",
}
OF_ONE_TASK = {
    *("PathScenario", "GoalScenario", "DockingScenario", "PathFollowing", "GoalReaching", "Docking"),
    *("PathFeatures", "GoalFeatures", "DockFeatures", "PathReward", "GoalReward", "Observation"),
}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@functools.cache
def trees() -> dict[str, ast.Module]:
    """Returns every module of the installed package, parsed, by room and file."""
    found = {}
    for room in BELOW:
        spec = importlib.util.find_spec(f"wayfield.{room}")
        assert spec is not None
        assert spec.submodule_search_locations
        folder = Path(next(iter(spec.submodule_search_locations)))
        for file in sorted(folder.rglob("*.py")):
            name = f"{room}/{file.relative_to(folder).as_posix()}"
            found[name] = ast.parse(file.read_text(encoding="utf-8"))
    return found


def functions() -> Iterator[tuple[str, Function]]:
    """Yields every function of the installed package, methods and nested ones too, with its file and name."""
    for name, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, Function):
                yield f"{name}:{node.name}", node


def imported(tree: ast.Module) -> Iterator[str]:
    """Yields the rooms of the package that a module imports from, wherever in it."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names = [f"{node.module}.{each.name}" for each in node.names]
        for name in names:
            package, _, rest = name.partition(".")
            if package == "wayfield" and rest:
                yield rest.split(".")[0]


def arguments(function: Function) -> int:
    """Returns how many arguments a function takes."""
    taken = function.args
    named = len(taken.posonlyargs) + len(taken.args) + len(taken.kwonlyargs)
    return named + (taken.vararg is not None) + (taken.kwarg is not None)


def lines(function: Function) -> int:
    """Returns how many lines a function has, from `def` on, without its docstring."""
    first = function.body[0]
    docstring = first.end_lineno - first.lineno + 1 if ast.get_docstring(function) is not None else 0  # type: ignore[operator]
    return function.end_lineno - function.lineno + 1 - docstring  # type: ignore[operator]


def test_there_are_functions_to_look_at() -> None:
    assert len(list(functions())) > 500


def test_no_function_takes_more_arguments_than_can_be_told_apart() -> None:
    wide = {name for name, function in functions() if arguments(function) > MOST_ARGUMENTS}
    assert wide <= WIDE
    assert len(WIDE) <= 8


def test_no_function_is_longer_than_a_page() -> None:
    long = {name: lines(function) for name, function in functions() if lines(function) > MOST_LINES}
    assert not long


def test_imports_point_one_way() -> None:
    seen = set()
    for name, tree in trees().items():
        room = name.split("/")[0]
        rooms = set(imported(tree)) & set(BELOW)
        assert rooms <= BELOW[room] | {room}, name
        seen |= {(room, each) for each in rooms}
    assert {("policies", "envs"), ("benchmarks", "policies")} <= seen


def test_every_law_is_a_policy_by_name() -> None:
    def module(policy: Callable[..., Any]) -> str:
        return str((policy.func if isinstance(policy, functools.partial) else policy).__module__)

    laws = {name.removesuffix(".py") for name in trees() if name.startswith("policies/") and name.count("/") == 1}
    laws -= {f"policies/{each}" for each in NO_LAWS}
    registered = {module(policy).removeprefix("wayfield.").replace(".", "/") for policy in POLICIES.values()}
    assert registered == laws | {"policies/learned/ppo"}


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
    for name, tree in trees().items():
        for node in ast.walk(tree):
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
    *("envs/{task}.py", "envs/scenarios/{task}_families.py", "envs/specs.py"),
    *("envs/scenarios/splits/{task}.json", "envs/scenarios/splits/{task}_claims.json"),
    *("benchmarks/contests/{task}.py", "benchmarks/contests/__init__.py"),
}
# Where it is named besides, because somebody wanted to.
NAMES_A_TASK = {
    "benchmarks/coverage.py": "how well the intervals of its standings hold",
    "benchmarks/throughput.py": "its steps a second beside those of the others",
    "policies/learned/perception.py": "what its agents see",
    "policies/training/presets.py": "how they are trained",
    "policies/training/ways.py": "along what their progress is measured",
    "policies/training/measured.py": "in what they are measured besides",
}


def words(tree: ast.Module) -> Iterator[str]:
    """Yields what a module's code names: variables, attributes, modules, texts; not its comments and docstrings."""
    told = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | Function) and ast.get_docstring(node) is not None:
            told.add(node.body[0].value)  # type: ignore[attr-defined]
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in told:
            yield node.value
        elif isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{each.name}" for each in node.names)


def test_a_task_with_other_numbers_takes_few_files() -> None:
    assert len(FILES_OF_A_TASK) <= 8
    naming = {name for name, tree in trees().items() if any("docking" in word.lower() for word in words(tree))}
    wanted = {name.format(task="docking") for name in FILES_OF_A_TASK if name.endswith(".py")}
    assert wanted <= naming <= wanted | set(NAMES_A_TASK)
