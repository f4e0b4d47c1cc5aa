"""The frozen splits: which seeds of each family are for training, validation and testing, and a hash of what they make.

A split file holds seeds, not geometry: loading makes the scenarios anew and compares their hash with the one that was
frozen, so that a table made with a split is about the same scenarios everywhere. `freeze` writes the files.
"""

import functools
import hashlib
import json
import pathlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from wayfield.envs.scenarios.goal_families import GOAL_FAMILIES
from wayfield.envs.scenarios.path_families import PATH_FAMILIES
from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario
from wayfield.envs.scenarios.validation import shown, suggestion

FAMILIES: Mapping[str, Mapping[str, Callable[[int], Any]]] = {
    "path_following": PATH_FAMILIES,
    "goal_reaching": GOAL_FAMILIES,
}
SPLITS = {"train": 64, "validation": 10, "test": 10}  # scenarios a family
TIERS = ("easy", "medium", "hard")
# Where a tier ends. Paths: the sharpness that easy and medium ones stay below, 1/m; goals: the room that they have at
# least, m.
TIER_BOUNDS = {"path_following": (1.0, 2.5), "goal_reaching": (0.6, 0.35)}
SHARPNESS_WINDOW = 0.3  # m
FOLDER = pathlib.Path(__file__).parent / "splits"
NEEDS_PYMUNK = ("push_boxes",)  # left out of "all"


def split(task: str, family: str, name: str) -> tuple[Any, ...]:
    """Returns the scenarios of a frozen split in their order, each with its tier and the quantity behind it.

    Args:
        task: "path_following" or "goal_reaching".
        family: a name of FAMILIES[task], or "all": the families one after the other, but for `push_boxes`.
        name: "train", "validation" or "test".

    Raises:
        ValueError: if a name is unknown, or the file is damaged, or the scenarios are not those that were frozen.
    """
    for what, value, known in (("task", task, FAMILIES), ("family", family, families(task)), ("split", name, SPLITS)):
        if value not in known:
            raise ValueError(
                f"{what} is {shown(value)}; it must be one of {', '.join(known)}.{suggestion(value, known)}"
            )
    if family == "all":
        every = (each for each in FAMILIES[task] if each not in NEEDS_PYMUNK)
        return tuple(scenario for each in every for scenario in split(task, each, name))
    return _split(FOLDER / f"{task}.json", task, family, name)


def families(task: str) -> tuple[str, ...]:
    """Returns the names of a task's families, and "all"; none for an unknown task."""
    return ("all", *FAMILIES[task]) if task in FAMILIES else ()


def tier(task: str, quantity: float) -> str:
    """Returns the tier of a scenario of this sharpness (1/m) or room (m)."""
    first, second = TIER_BOUNDS[task]
    sign = 1.0 if first < second else -1.0
    return TIERS[int(sign * quantity >= sign * first) + int(sign * quantity >= sign * second)]


def digest(scenarios: Iterable[PathScenario | GoalScenario]) -> str:
    """Returns the SHA-256 of names, tiers and geometry."""
    sha = hashlib.sha256()
    for scenario in scenarios:
        sha.update(f"{scenario.name} {scenario.tier} {scenario.quantity:.6f}\n".encode())
        sha.update(canonical(scenario))
    return sha.hexdigest()


def canonical(scenario: PathScenario | GoalScenario) -> bytes:
    """Returns all that decides an episode as little-endian 64-bit integers, in millionths of m, rad, s or kg."""
    numbers: Sequence[Any]
    if isinstance(scenario, PathScenario):
        path = scenario.path
        start = scenario.start or path.start_pose
        scatter = (scenario.start_offset, scenario.start_turn)
        numbers = [len(path.points), path.points, path.closed, start, scatter, scenario.laps, scenario.corridor]
    else:
        o = scenario.obstacles
        x, y = o["half_length"] * o["cos"], o["half_length"] * o["sin"]
        # the ends of the long axis: those of a wall are whole numbers
        ends = [o["x"] - x, o["y"] - y, o["x"] + x, o["y"] + y]
        shapes = [*ends, 2.0 * o["half_width"], o["radius"], o["mass"]]
        asked = (scenario.position_tolerance, scenario.heading_tolerance, scenario.waypoint_radius)
        scatter = (scenario.start_offset, scenario.start_turn)
        moves = [scenario.patrols[name] for name in scenario.patrols.dtype.names or ()]
        sizes = len(o), len(scenario.waypoints)
        numbers = [sizes, scenario.start, scenario.goal, scenario.waypoints, *shapes, *moves, asked, scatter]
    flat = np.concatenate([np.ravel(np.asarray(each, np.float64)) for each in numbers])
    return np.rint(flat * 1e6).astype("<i8").tobytes()


@functools.lru_cache
def _split(file: pathlib.Path, task: str, family: str, name: str) -> tuple[Any, ...]:
    """Returns the scenarios of one family's split, made from its seeds and compared with its hash."""
    try:
        frozen = _read(file)["families"][family][name]
        seeds, quantities, tiers, sha256 = (frozen[key] for key in ("seeds", "quantities", "tiers", "sha256"))
        if not all(type(seed) is int for seed in seeds):
            raise ValueError("a seed is no whole number")
        scenarios = tuple(
            _with_tier(FAMILIES[task][family](seed), float(quantity), str(tier))
            for seed, quantity, tier in zip(seeds, quantities, tiers, strict=True)
        )
    except (OSError, LookupError, TypeError, ValueError) as error:
        problem = f"the file is damaged: {type(error).__name__}: {' '.join(str(error).split())}"
    else:
        found = digest(scenarios)
        if found == sha256 and len(scenarios) == SPLITS[name]:
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
