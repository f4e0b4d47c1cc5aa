"""Writes the frozen splits anew: `python -m wayfield.envs.scenarios.freeze [FAMILY ...]`, for developers, some minutes.

A seed is taken when what it makes can be done: the largest robot has room at start and goal and a proven way past all
that stands, which is not too long. Freezing again after a change of a family changes what published tables are about.
"""

import argparse
import json
import math
import re
from typing import Any

from wayfield.envs.geometry import clearance
from wayfield.envs.scenarios import splits, ways
from wayfield.envs.scenarios.goal_families import LARGEST_HULL, ROOM
from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario
from wayfield.envs.scenarios.tracing import sharpness

_FIRST_SEEDS = {"train": 0, "validation": 1_000_000, "test": 2_000_000}  # no seed is in two splits
_LONGEST_WAY = 20.0  # m; 60 s at 0.6 m/s are 36 m
_LEAST_SPARE = 0.05  # m, of a goal beside an obstacle


def quantity(scenario: PathScenario | GoalScenario) -> float:
    """Returns what the tier of a scenario is read from, rounded to 1e-6.

    A path: its sharpness, 1/m. A goal: the room on the way, m: the radius of the largest disc that has a way (at most
    1 m, around all that moving discs sweep), over the detour of a disc of 0.3 m.
    """
    if isinstance(scenario, PathScenario):
        return round(float(sharpness(scenario.path.points, scenario.path.closed, splits.SHARPNESS_WINDOW)), 6)
    return round(ways.clear_radius(scenario, sweeping=True) / ways.detour(scenario, LARGEST_HULL), 6)


def admissible(scenario: PathScenario | GoalScenario) -> bool:
    """Returns whether the largest robot can do it."""
    if isinstance(scenario, PathScenario):
        return True
    obstacles = scenario.obstacles
    spare = _LEAST_SPARE if scenario.family == "near_goal" else ROOM
    return (
        clearance(obstacles, len(obstacles), *scenario.start[:2]) >= LARGEST_HULL + ROOM
        and clearance(obstacles, len(obstacles), *scenario.goal[:2]) >= LARGEST_HULL + spare
        and math.dist(scenario.start[:2], scenario.goal[:2]) >= 2.0
        and ways.clear_radius(scenario) >= LARGEST_HULL
        and ways.way_length(scenario, LARGEST_HULL) <= _LONGEST_WAY
    )


def frozen(task: str, family: str, name: str) -> dict[str, Any]:
    """Returns what the split file says about one split of a family."""
    seeds: list[int] = []
    scenarios: list[Any] = []
    seed = _FIRST_SEEDS[name]
    while len(seeds) < splits.SPLITS[name]:
        scenario = splits.FAMILIES[task][family](seed)
        if admissible(scenario):
            object.__setattr__(scenario, "quantity", quantity(scenario))
            object.__setattr__(scenario, "tier", splits.tier(task, scenario.quantity))
            scenarios.append(scenario)
            seeds.append(seed)
        seed += 1
    return {
        "sha256": splits.digest(scenarios),
        "seeds": seeds,
        "tiers": [scenario.tier for scenario in scenarios],
        "quantities": [scenario.quantity for scenario in scenarios],
    }


def main() -> None:
    """Writes the split files of both tasks, one family after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("families", nargs="*", metavar="FAMILY", help="those to freeze again; all by default")
    wanted = parser.parse_args().families
    for task, families in splits.FAMILIES.items():
        file = splits.FOLDER / f"{task}.json"
        written = json.loads(file.read_text(encoding="utf-8"))["families"] if file.exists() else {}
        for family in families:
            if not wanted or family in wanted:
                written[family] = {name: frozen(task, family, name) for name in splits.SPLITS}
                in_order = {each: written[each] for each in families if each in written}
                file.write_text(_text(task, in_order), encoding="utf-8")
                print(task, family, flush=True)


def _text(task: str, families: dict[str, Any]) -> str:
    """Returns the text of a split file, a line a list: a change is then seen for what it is."""
    text = json.dumps({"task": task, "families": families}, indent=1)
    return re.sub(r"\n {5,}|\n {4}(?=])", "", text) + "\n"


if __name__ == "__main__":
    main()
