"""The frozen splits: which seeds of each family are for training, validation and testing, and a hash of what they make.

A split file holds seeds, not geometry: loading makes the scenarios anew and compares their hash with the one that was
frozen, so that a table made with a split is about the same scenarios everywhere. `freeze` writes the files.
"""

import functools
import hashlib
import json
import pathlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario
from wayfield.envs.tasks.specs import EVERY, TASKS
from wayfield.system.checks import LAST_SEED, shown, suggestion
from wayfield.system.readers import reader

# scenarios a family; "claims" are test scenarios too, enough of them to tell differences of a point
SPLITS = {"train": 64, "validation": 10, "test": 10, "claims": 100}
FOLDER = pathlib.Path(__file__).resolve().parent / "splits"  # of the repository, where links of an install lead


def split(task: str, family: str, name: str) -> tuple[Any, ...]:
    """Returns the scenarios of a frozen split in their order, each with its tier and the quantity behind it.

    Args:
        task: a name of TASKS.
        family: a name of its families, or "all": the families one after the other, but for those that need pymunk.
        name: "train", "validation", "test" or "claims".

    Raises:
        ValueError: if a name is unknown, or the file is damaged, or the scenarios are not those that were frozen.
    """
    for what, value, known in (("task", task, EVERY), ("family", family, families(task)), ("split", name, SPLITS)):
        if value not in known:
            raise ValueError(
                f"{what} is {shown(value)}; it must be one of {', '.join(known)}.{suggestion(value, known)}"
            )
    if family == "all":
        every = (each for each in EVERY[task].families if each not in EVERY[task].needs_pymunk)
        return tuple(scenario for each in every for scenario in split(task, each, name))
    return _split(file_of(task, name), task, family, name)


def file_of(task: str, name: str) -> pathlib.Path:
    """Returns the file of a task's split: one for all but "claims", which is as large as they and has its own."""
    return FOLDER / (f"{task}_claims.json" if name == "claims" else f"{task}.json")


def tiers(task: str, family: str, name: str) -> tuple[str, ...]:
    """Returns the tiers of a family's frozen split in its order, as the file has them; no scenario is made."""
    return tuple(map(str, _read(file_of(task, name))["families"][family][name]["tiers"]))


def families(task: str) -> tuple[str, ...]:
    """Returns the names of a task's families, and "all"; none for an unknown task."""
    return ("all", *EVERY[task].families) if task in EVERY else ()


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
        frozen = _read(file)["families"][family][name]
        seeds, quantities, tiers, sha256 = (frozen[key] for key in ("seeds", "quantities", "tiers", "sha256"))
        if not isinstance(seeds, list) or not all(type(seed) is int and 0 <= seed <= LAST_SEED for seed in seeds):
            raise ValueError("a seed is no whole number")
        if len(seeds) != SPLITS[name]:
            raise ValueError(f"there are {len(seeds)} seeds, not {SPLITS[name]}")
        scenarios = tuple(
            _with_tier(EVERY[task].families[family](seed), float(quantity), str(tier))
            for seed, quantity, tier in zip(seeds, quantities, tiers, strict=True)
        )
    except (OSError, LookupError, TypeError, ValueError, ArithmeticError, RecursionError, MemoryError) as error:
        problem = f"the file is damaged: {type(error).__name__}: {' '.join(str(error).split())}"
    else:
        found = digest(scenarios)
        if found == sha256:
            return scenarios
        problem = f"the scenarios are not those that were frozen: their SHA-256 is {found[:12]}..., not {shown(sha256)}"
    raise ValueError(f"{file}: family {family!r}, split {name!r}: {problem}; install wayfield anew")


@functools.lru_cache
def _read(file: pathlib.Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


def _with_tier(scenario: Any, quantity: float, tier: str) -> Any:
    """Returns the scenario with its tier. Set in place: to replace it would check all of it again."""
    object.__setattr__(scenario, "quantity", quantity)
    object.__setattr__(scenario, "tier", tier)
    return scenario
