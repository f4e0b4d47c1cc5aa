"""The scenarios of a run as plain numbers, so that a page can draw them and drive in them without the package."""

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gymnasium.utils.seeding import np_random

from wayfield.benchmarks.run_folder import WORLDS
from wayfield.benchmarks.suite import Setting
from wayfield.envs.readers import of_folder, reader
from wayfield.envs.robots import ROBOTS, robot_of
from wayfield.envs.scenarios import TASKS, TaskSpec, scenarios_of, wall
from wayfield.envs.storage import write_whole

World = dict[str, Any]

DRAWS = 6  # uniform numbers of a reset, at most: the scenario, the start, a shove


def spec_of(env_id: str) -> TaskSpec:
    """Returns the task of an environment's registered id."""
    return next(spec for spec in TASKS.values() if env_id in spec.ids.values())


def keys_of(setting: Setting) -> list[str]:
    """Returns the key of the world of each episode of a setting; without one where the world is not known before."""
    count = len(_bank(setting))
    if count > 1 and not setting.case.every_scenario:
        return [""] * setting.episodes
    scale = setting.case.env_kwargs.get("scale", 1.0)
    return [f"{setting.case.scenario}#{k % count}#{scale:g}" for k in range(setting.episodes)]


def worlds_of(settings: Iterable[Setting]) -> dict[str, World]:
    """Returns the scenarios that some settings drive in, by their key."""
    found: dict[str, World] = {}
    for setting in settings:
        for k, key in enumerate(keys_of(setting)):
            if key and key not in found:
                bank = _bank(setting)
                draws = np_random(setting.seed + k)[0].random(DRAWS).tolist()
                found[key] = plain(bank[k % len(bank)], setting.case.max_episode_steps) | {"draws": draws}
    return found


def _bank(setting: Setting) -> tuple[Any, ...]:
    case = setting.case
    spec = spec_of(case.env_id)
    robots = [robot for robot in ROBOTS.values() if spec.env_id(robot) == case.env_id]
    robot = robot_of(case.env_kwargs["robot"]) if "robot" in case.env_kwargs else robots[0]
    return scenarios_of(spec, case.scenario, robot.hull_radius, case.env_kwargs.get("scale", 1.0))


def plain(scenario: Any, steps: int) -> World:
    """Returns a scenario as lists and numbers that JSON keeps to the last bit, with its clock in control periods."""
    kind = next(spec.kind for spec in TASKS.values() if spec.scenario is type(scenario))
    quantity = scenario.quantity if math.isfinite(scenario.quantity) else None
    world: World = {
        "kind": kind,
        "name": scenario.name,
        "family": scenario.family,
        "tier": scenario.tier,
        "quantity": quantity,
        "steps": steps,
        "start_offset": scenario.start_offset,
        "start_turn": scenario.start_turn,
    }
    if kind == "path":
        return world | {
            "path": scenario.path.points.tolist(),
            "closed": scenario.path.closed,
            "laps": scenario.laps,
            "start": scenario.start and list(scenario.start),
            "corridor": scenario.corridor,
        }
    return world | {
        "start": list(scenario.start),
        "goal": list(scenario.goal),
        "waypoints": [list(point) for point in scenario.waypoints],
        "obstacles": [list(each) for each in (*scenario.obstacles.tolist(), *_walls(scenario))],
        "patrols": [list(each) for each in scenario.patrols.tolist()] if scenario.patrols["leg_time"].any() else [],
        "position_tolerance": scenario.position_tolerance,
        "heading_tolerance": scenario.heading_tolerance,
        "waypoint_radius": scenario.waypoint_radius,
    }


def _walls(scenario: Any) -> list[Any]:
    """Returns the sides of what a map has occupied, as the walls that they are to a page that knows no maps."""
    if scenario.grid is None:
        return []
    outline = scenario.grid.outline().reshape(-1, 4).tolist()
    return [wall(*ends).tolist() for ends in outline]


def write_worlds(folder: Path, settings: Iterable[Setting]) -> None:
    """Writes the scenarios that some settings drive in, and which each episode drives in, in the order of the rows."""
    settings = list(settings)
    keys = [key for setting in settings for key in keys_of(setting)]
    content = {"worlds": worlds_of(settings), "rows": keys}
    write_whole(folder / WORLDS, json.dumps(content, separators=(",", ":")).encode())


@reader(
    "worlds",
    WORLDS,
    {WORLDS: '{"worlds": {"a#0#1": {"kind": "path", "path": [[0, 0]]}}, "rows": ["a#0#1"]}'},
    of_folder,
)
def read_worlds(folder: Path) -> tuple[Mapping[str, World], list[str]]:
    """Returns the scenarios of a run by their key, and the key of each row.

    Raises:
        ValueError: if the file is no such JSON; the message names it.
        OSError: if it cannot be opened.
    """
    file = folder / WORLDS
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        worlds, rows = content["worlds"], content["rows"]
        if not isinstance(worlds, dict) or not all(
            isinstance(each, dict) and "kind" in each for each in worlds.values()
        ):
            raise ValueError("worlds must be an object of scenarios, each with a kind")
        if not isinstance(rows, list) or not all(key == "" or key in worlds for key in rows):
            raise ValueError("rows must be a list of keys of worlds")
    except (LookupError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"{file} holds no worlds: {error}") from None
    return worlds, rows
