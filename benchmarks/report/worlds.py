"""The scenarios of a run as plain numbers, so that a page can draw them and drive in them without the package."""

import base64
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils.seeding import np_random

from wayfield.benchmarks.records.run_folder import WORLDS
from wayfield.benchmarks.runs.suite import Setting
from wayfield.envs.robots import ROBOTS, Robot, robot_of
from wayfield.envs.scenarios import TASKS, scenarios_of, spec_of, wall
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.tasks.specs import CROWDS, EVERY
from wayfield.envs.world.grids import NO_GRIDS, lay_grids
from wayfield.system.readers import of_folder, reader
from wayfield.system.reading import is_number
from wayfield.system.storage import write_whole

World = dict[str, Any]

IN_PAGE = {name: spec for name, spec in EVERY.items() if spec.observes != "reference"}  # tasks that it has kernels of

MOST_CELLS = 100_000  # bytes of a map's cells in a page; of a larger one the outline's walls are driven among
MOST_BODIES, MOST_TRACKED = 64, 4_000  # bodies, and numbers of recorded ways, of a world that a page drives in
DRAWS = 6  # uniform numbers of a reset, at most: the scenario, the start, a shove


def keys_of(setting: Setting) -> list[str]:
    """Returns the key of the world of each episode of a setting; without one where the world is not known before."""
    count = len(_bank(setting))
    # of worlds of several bodies the first is always the first of the bank
    known = setting.case.every_scenario or spec_of(setting.case.env_id) in CROWDS.values()
    if count > 1 and not known:
        return [""] * setting.episodes
    scale = setting.case.env_kwargs.get("scale", 1.0)
    walked = "".join(f"#{each}" for each in _walked(setting) if each is not None)
    return [f"{setting.case.scenario}#{_member(setting, k, count)}#{scale:g}{walked}" for k in range(setting.episodes)]


def _walked(setting: Setting) -> tuple[bool | None, str | None]:
    """Returns whether people of a setting see robots, and by which law they walk; None: as the scenario says."""
    return setting.case.env_kwargs.get("visible"), setting.case.env_kwargs.get("people")


def _member(setting: Setting, k: int, count: int) -> int:
    """Returns which scenario of a bank of `count` the k-th episode of a setting is in."""
    return setting.members[k] if setting.members else k % count


def worlds_of(settings: Iterable[Setting]) -> dict[str, World]:
    """Returns the scenarios that some settings drive in, by their key."""
    worlds: dict[str, World] = {}
    for setting in settings:
        for k, key in enumerate(keys_of(setting)):
            if key and key not in worlds:
                bank = _bank(setting)
                draws = np_random(setting.seed + k)[0].random(DRAWS).tolist()
                worlds[key] = plain(bank[_member(setting, k, len(bank))], setting.case.max_episode_steps) | {
                    "draws": draws
                }
    return worlds


def _bank(setting: Setting) -> tuple[Any, ...]:
    case = setting.case
    scale = case.env_kwargs.get("scale", 1.0)
    scenarios = scenarios_of(spec_of(case.env_id), case.scenario, _robot(setting).hull_radius, scale)
    if spec_of(case.env_id) in CROWDS.values():
        return tuple(each.walked(*_walked(setting)) for each in scenarios)
    return scenarios


def _robot(setting: Setting) -> Robot:
    """Returns the robot that a setting names, or that its environment has by default."""
    case = setting.case
    if "robot" in case.env_kwargs:
        return robot_of(case.env_kwargs["robot"])
    return next(robot for robot in ROBOTS.values() if spec_of(case.env_id).env_id(robot) == case.env_id)


def plain(scenario: Any, steps: int) -> World:
    """Returns a scenario as lists and numbers that JSON keeps to the last bit, with its clock in control periods."""
    if isinstance(scenario, TeamScenario):
        return _crowd(scenario, steps)
    spec = next(spec for spec in TASKS.values() if spec.scenario is type(scenario))
    quantity = scenario.quantity if math.isfinite(scenario.quantity) else None
    world: World = {
        "kind": spec.kind,
        "name": scenario.name,
        "family": scenario.family,
        "tier": scenario.tier,
        "quantity": quantity,
        "steps": steps,
        "start_offset": scenario.start_offset,
        "start_turn": scenario.start_turn,
    }
    if spec.on_path:
        return world | {
            "path": scenario.path.points.tolist(),
            "closed": scenario.path.closed,
            "laps": scenario.laps,
            "start": scenario.start and list(scenario.start),
            "corridor": scenario.corridor,
        }
    return (
        world
        | {
            "start": list(scenario.start),
            "goal": list(scenario.goal),
            "waypoints": [list(point) for point in scenario.waypoints],
            "obstacles": [list(each[:-1]) for each in scenario.obstacles.tolist()],
            "patrols": [list(each[-1]) for each in scenario.obstacles.tolist()] if scenario.moving.any() else [],
            "position_tolerance": scenario.position_tolerance,
            "heading_tolerance": scenario.heading_tolerance,
            "waypoint_radius": scenario.waypoint_radius,
        }
        | _closing(scenario)
        | _map(scenario)
    )


def _crowd(scenario: TeamScenario, steps: int) -> World:
    """Returns a world of several bodies: what the first robot is asked, the others' goals, and all their radii.

    Where they are few enough to be driven in a page, also the others' starts, and how people walk: WALK records.
    """
    kind = "team" if scenario.team > 1 else "people"
    own = {name: getattr(scenario, name) for name in ("name", "family", "tier")}
    quantity = scenario.quantity if math.isfinite(scenario.quantity) else None
    # None: a robot, as large as the first
    radii = [None] * (scenario.team - 1) + scenario.walks["radius"].tolist()
    others = [list(each.goal) for each in scenario.robots[1:]]
    world = {"kind": kind, "quantity": quantity, "bodies": radii, "goals": others}
    tracks, rows = scenario.tracks[scenario.walked_rows], scenario.walks["rows"]
    if len(radii) <= MOST_BODIES and tracks.size <= MOST_TRACKED:
        walks = scenario.walks.copy()
        walks["first"] = np.cumsum(rows) - rows
        world |= {
            "starts": [list(each.start) for each in scenario.robots[1:]],
            "walks": [list(each) for each in walks.tolist()],
            "tracks": tracks.tolist(),
            "reach": scenario.reach,
        }
    return plain(scenario.robots[0], steps) | own | world


def _closing(scenario: Any) -> World:
    """Returns how far each obstacle is moved up to a smaller hull, (m, 2), where any is."""
    closing = np.asarray(getattr(scenario, "closing", ()))
    return {"closing": closing.tolist()} if closing.any() else {}


def _map(scenario: Any) -> World:
    """Returns what a map has occupied: its outline as walls, to be drawn, and unless it is large, what kernels read."""
    grid = scenario.grid
    if grid is None:
        return {}
    world: World = {"walls": [list(wall(*ends).tolist()) for ends in grid.outline().reshape(-1, 4).tolist()]}
    if grid.cells.nbytes <= MOST_CELLS:
        frames, cells = lay_grids([grid], np.zeros(1, NO_GRIDS.frames.dtype))
        world["grid"] = {"frame": list(frames[0].tolist()), "cells": base64.b64encode(cells.tobytes()).decode()}
    return world


def write_worlds(folder: Path, settings: Iterable[Setting]) -> None:
    """Writes the scenarios that some settings drive in, and of each row which it drives in and its robot's hull."""
    settings = list(settings)
    keys = [key for setting in settings for key in keys_of(setting)]
    robots = [robot for setting in settings for robot in [_robot(setting)] * setting.episodes]
    hulls = [[*robot.hull_box, robot.hull_x] if robot.hull_box is not None else robot.hull_radius for robot in robots]
    content = {"worlds": worlds_of(settings), "rows": keys, "hulls": hulls}
    write_whole(folder / WORLDS, json.dumps(content, separators=(",", ":")).encode())


@reader(
    "worlds",
    WORLDS,
    {WORLDS: '{"worlds": {"a#0#1": {"kind": "path", "path": [[0, 0]]}}, "rows": ["a#0#1"], "hulls": [0.2]}'},
    of_folder,
)
def read_worlds(folder: Path) -> tuple[Mapping[str, World], list[str], list[float | list[float]]]:
    """Returns the scenarios of a run by their key, and of each row its key and, where told, its hull (m).

    A hull is its radius, or length and width of a rectangle and how far ahead of the pose its middle lies.

    Raises:
        ValueError: if the file is no such JSON; the message names it.
        OSError: if it cannot be opened.
    """
    file = folder / WORLDS
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        worlds, rows, hulls = content["worlds"], content["rows"], content.get("hulls", [])
        if not isinstance(worlds, dict) or not all(
            isinstance(each, dict) and "kind" in each for each in worlds.values()
        ):
            raise ValueError("worlds must be an object of scenarios, each with a kind")
        if not isinstance(rows, list) or not all(key == "" or key in worlds for key in rows):
            raise ValueError("rows must be a list of keys of worlds")
        if not isinstance(hulls, list) or not all(map(_is_hull, hulls)):
            raise ValueError("hulls must be a list of radii, or of lists of a length, a width and how far ahead, in m")
        if len(hulls) not in (0, len(rows)):
            raise ValueError(f"hulls has {len(hulls)} entries, one for each of {len(rows)} rows there must be")
    except (LookupError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"{file} holds no worlds: {error}") from None
    return worlds, rows, hulls


def _is_hull(value: Any) -> bool:
    """Returns whether a value is a radius, or length and width of a rectangle and, where told, its middle."""
    numbers = value if isinstance(value, list) and len(value) in (2, 3) else [value]
    return all(map(is_number, numbers)) and min(numbers[:2]) >= 0.0
