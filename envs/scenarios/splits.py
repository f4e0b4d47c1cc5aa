"""The frozen splits: which seeds of each family are for training, validation and testing, and a hash of what they make.

A split file holds seeds, not geometry: loading makes the scenarios anew and compares their hash with the one that was
frozen, so that a table made with a split is about the same scenarios everywhere. `freeze` writes the files.
"""

import functools
import hashlib
import itertools
import json
import math
import pathlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario
from wayfield.envs.tasks.specs import CLASS_STEP, EVERY, LARGEST_CLASS, TASKS
from wayfield.system.checks import LAST_SEED, shown, suggestion
from wayfield.system.readers import reader

# scenarios a family; "claims" are test scenarios too, enough of them to tell differences of a point
SPLITS = {"train": 64, "validation": 10, "test": 10, "claims": 100}
FOLDER = pathlib.Path(__file__).resolve().parent / "splits"  # of the repository, where links of an install lead


def split(task: str, family: str, name: str) -> tuple[Any, ...]:
    """Returns the scenarios of a frozen split in their order, each with its tier and the quantity behind it.

    Args:
        task: a name of TASKS.
        family: a name of its families; or "all", those of the newest version of it (`members`) one after the other,
            but for those that need pymunk; or "all_1", those of version 1.
        name: "train", "validation", "test" or "claims"; with "@0.45" behind it, for the hull class 0.45 m.

    Raises:
        ValueError: if a name is unknown, or the file is damaged, or the scenarios are not those that were frozen.
    """
    name, at, hull = name.partition("@") if isinstance(name, str) else (name, "", "")
    for what, value, known in (("task", task, EVERY), ("family", family, families(task)), ("split", name, SPLITS)):
        if value not in known:
            raise ValueError(
                f"{what} is {shown(value)}; it must be one of {', '.join(known)}.{suggestion(value, known)}"
            )
    if at:
        _check_class(task, family, name, hull)
    if family not in EVERY[task].families:
        version = int(family.removeprefix("all_")) if family != "all" else None
        every = (each for each in members(task, version) if not EVERY[task].families[each].needs_forces)
        return tuple(scenario for each in every for scenario in split(task, each, f"{name}{at}{hull}"))
    if at:
        return _of_class(task, family, name, float(hull))
    return _split(file_of(task, name), task, family, name)


def _check_class(task: str, family: str, name: str, text: str) -> None:
    """Raises ValueError if a text names no hull class, or a family has none."""
    spec = EVERY[task]
    largest = spec.repertoire.largest_hull
    if spec.repertoire.size is None or (family in spec.families and spec.families[family].needs_forces):
        hulls = f"hulls of at most {largest:g} m" if largest < math.inf else "every hull"
        raise ValueError(
            f"{family}/{name} has no hull class {shown('@' + text)}: its scenarios are for {hulls}; goals have "
            "classes, but for push_boxes, and docks"
        )
    least = round(largest + CLASS_STEP, 2)
    try:
        hull = float(text)
    except ValueError:
        hull = math.nan
    written = text in (f"{hull:.2f}", f"{hull:g}")
    if not (written and least <= hull <= LARGEST_CLASS and spec.repertoire.hull_class(hull) == hull):
        raise ValueError(
            f"class {shown('@' + text)} must be @{least:.2f} to @{LARGEST_CLASS:.2f}, in steps of {CLASS_STEP:g} m; "
            f"hulls of at most {largest:g} m have none: type {family}/{name}"
        )


@functools.lru_cache
def _of_class(task: str, family: str, name: str, hull: float) -> tuple[Any, ...]:
    """Returns a family's frozen split for a hull class (m).

    Scenes that are scaled keep their proofs. A dock without a way for the hull is replaced by the next seed that has
    one.
    """
    spec, frozen, result = EVERY[task], split(task, family, name), list[Any]()
    seeds = itertools.count(int(frozen[-1].name.rpartition("_")[2]) + 1)
    similar = spec.repertoire.size_of(f"@{hull}") != 1.0
    for scenario in frozen:
        made = scenario.of_class(hull)
        while not similar and not spec.feasible(made, hull):
            other = spec.families[family].make(next(seeds))
            if spec.feasible(other):
                quantity = spec.quantity(other)
                made = _with_tier(other, quantity, spec.tier(quantity)).of_class(hull)
        result.append(made)
    return tuple(result)


def file_of(task: str, name: str) -> pathlib.Path:
    """Returns the file of a task's split: one for all but "claims", which is as large as they and has its own."""
    return FOLDER / (f"{task}_claims.json" if name == "claims" else f"{task}.json")


def tiers(task: str, family: str, name: str) -> tuple[str, ...]:
    """Returns the tiers of a family's frozen split in its order, as the file has them; none where it is not frozen."""
    frozen = _read(file_of(task, name))["families"].get(family, {name: {"tiers": ()}})
    return tuple(map(str, frozen[name]["tiers"]))


def families(task: str) -> tuple[str, ...]:
    """Returns "all", its versions as "all_1", and the names of a task's families; none for an unknown task."""
    if task not in EVERY:
        return ()
    versions = (f"all_{k}" for k in range(1, len(_versions(task)) + 1))
    return ("all", *versions, *EVERY[task].families)


def members(task: str, version: int | None = None) -> tuple[str, ...]:
    """Returns the families that "all" means in a version, by default the newest.

    A family that is frozen later belongs to none: what agents learned from and contests are about stays the same until
    `freeze --all` makes another version.
    """
    return _versions(task)[-1 if version is None else version - 1]


@functools.cache
def _versions(task: str) -> tuple[tuple[str, ...], ...]:
    file = file_of(task, "train")
    try:
        listed = _read(file)["all"]
        versions = tuple(tuple(map(str, each)) for each in listed)
        if not versions or {name for each in versions for name in each} - set(EVERY[task].families):
            raise ValueError('"all" names no known families')
    except (OSError, LookupError, TypeError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"{file}: the file is damaged: {error}; install wayfield anew") from None
    return versions


def digest(scenarios: Iterable[PathScenario | GoalScenario]) -> str:
    """Returns the SHA-256 of names, tiers and geometry."""
    sha = hashlib.sha256()
    for scenario in scenarios:
        sha.update(f"{scenario.name} {scenario.tier} {scenario.quantity:.6f}\n".encode())
        sha.update(canonical(scenario))
    return sha.hexdigest()


def canonical(scenario: PathScenario | GoalScenario) -> bytes:
    """Returns all that decides an episode as little-endian 64-bit integers, in millionths of m, rad, s or kg."""
    flat = np.concatenate([np.ravel(np.asarray(each, np.float64)) for each in scenario.decisive()])
    return np.rint(flat * 1e6).astype("<i8").tobytes()


class _NotFrozen(ValueError):
    """A family that the split files do not hold yet."""


def _shipped(folder: pathlib.Path) -> None:
    (folder / "path_following.json").write_bytes((FOLDER / "path_following.json").read_bytes())


@reader(
    "split",
    "path_following.json",
    _shipped,
    lambda read, file: read(file, "path_following", next(iter(TASKS["path_following"].families)), "test"),
)
@functools.lru_cache
def _split(file: pathlib.Path, task: str, family: str, name: str) -> tuple[Any, ...]:
    """Returns the scenarios of one family's split, made from its seeds and compared with its hash."""
    try:
        of_task = _read(file)["families"]
        if family not in of_task:
            command = f"python -m wayfield.envs.scenarios.freeze {family}"
            raise _NotFrozen(f"{file}: family {family!r} is not frozen: {command}")
        frozen = of_task[family][name]
        seeds, quantities, tiers, sha256 = (frozen[key] for key in ("seeds", "quantities", "tiers", "sha256"))
        if not isinstance(seeds, list) or not all(type(seed) is int and 0 <= seed <= LAST_SEED for seed in seeds):
            raise ValueError("a seed is no whole number")
        if len(seeds) != SPLITS[name]:
            raise ValueError(f"there are {len(seeds)} seeds, not {SPLITS[name]}")
        scenarios = tuple(
            _with_tier(EVERY[task].families[family].make(seed), float(quantity), str(tier))
            for seed, quantity, tier in zip(seeds, quantities, tiers, strict=True)
        )
    except _NotFrozen:
        raise
    except (OSError, LookupError, TypeError, ValueError, ArithmeticError, RecursionError, MemoryError) as error:
        problem = f"the file is damaged: {type(error).__name__}: {' '.join(str(error).split())}"
    else:
        actual = digest(scenarios)
        if actual == sha256:
            return scenarios
        problem = (
            f"the scenarios are not those that were frozen: their SHA-256 is {actual[:12]}..., not {shown(sha256)}"
        )
    raise ValueError(f"{file}: family {family!r}, split {name!r}: {problem}; install wayfield anew")


@functools.lru_cache
def _read(file: pathlib.Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


def _with_tier(scenario: Any, quantity: float, tier: str) -> Any:
    """Returns the scenario with its tier. Set in place: to replace it would check all of it again."""
    object.__setattr__(scenario, "quantity", quantity)
    object.__setattr__(scenario, "tier", tier)
    return scenario
