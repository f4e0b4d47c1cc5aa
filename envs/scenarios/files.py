"""Scenarios from the user's files: JSON for every task, and bare path tables."""

import functools
import inspect
import json
import math
import os
import pathlib
import re
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from wayfield.envs.scenarios.maps import MAP_SUFFIXES, map_of, note_degrees
from wayfield.envs.scenarios.obstacles import box, circle, moving_circle, obstacle_field, wall
from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario
from wayfield.envs.scenarios.tables import (
    TABLE_SUFFIXES,
    closing,
    origin_to_subtract,
    path_from_table,
    timed_path_from_table,
)
from wayfield.envs.tasks.specs import TASKS, TaskSpec
from wayfield.envs.world.paths import Path
from wayfield.system.checks import (
    FARTHEST,
    MOST_OBSTACLES,
    MOST_POINTS,
    numbers_of,
    pose,
    shown,
    suggestion,
)
from wayfield.system.elementary import wrap_angle
from wayfield.system.objects import FileNote, check_keys, check_ordinary, fault, json_object, read_text
from wayfield.system.readers import reader

_WAY, _TABLE_FILE, _GOAL = "path", "path_file", "goal"  # the fields that a file of any path, and of any pose, may have
_KINDS = {spec.kind: spec for spec in TASKS.values()}
_OBSTACLE_KINDS: Mapping[str, Callable[..., np.void]] = {"circle": circle, "box": box, "wall": wall}


# good files, which tests damage
_TABLE = "x,y\n0,0\n1,0.5\n2,0\n3,1\n"
_PATH = """{"path": [[0, 0], [2, 0], [2, 2], [0, 2]], "closed": true, "laps": 2, "start": [0.1, 0.05, 0.2],
"start_offset": 0.1, "start_turn": 0.3, "corridor": 0.8}"""
_POSE = """{"goal": [3, 0, 0.5], "start": [0, 0, 0.1], "waypoints": [[1, 1], [2, -1]], "start_offset": 0.1,
"start_turn": 0.3, "position_tolerance": 0.1, "heading_tolerance": 0.2, "waypoint_radius": 0.5, "obstacles": [
{"kind": "circle", "x": 1.5, "y": 2, "radius": 0.3}, {"kind": "box", "x": 1, "y": -2, "length": 1, "width": 0.5,
"heading": 0.3, "mass": 2}, {"kind": "wall", "x1": -1, "y1": -3, "x2": 4, "y2": -3}, {"kind": "circle", "x": -2, "y": 0,
"radius": 0.2, "patrol": {"vx": 0, "vy": 0.3, "leg_time": 5}}]}"""
_ON_MAP = """{"goal": [3, 0.5, 0], "start": [0.5, 0.5, 0], "heading_tolerance": 3, "obstacles": [{"kind": "circle",
"x": 1.5, "y": 2.5, "radius": 0.2}], "map": {"file": "room.map", "resolution": 1, "origin": [0, 0, 0]}}"""
_ROOM = "type octile\nheight 4\nwidth 5\nmap\n.....\n.@T@.\n...@.\n.....\n"


@reader("path scenario", "path.json", {"path.json": _PATH})
@reader("path scenario of a table", "path.json", {"path.json": '{"path_file": "table.csv"}', "table.csv": _TABLE})
def path_scenario_from_file(file: str, scale: float = 1.0, spec: TaskSpec = TASKS["path_following"]) -> PathScenario:
    """Returns the scenario of a table or a .json file, of a task on paths, its positions multiplied by `scale`.

    For tables see `path_from_table`. A JSON file holds the points [[x, y], ...], or one object with them as "path",
    also called as the task calls it, or with "path_file" (a table, relative to the JSON file), and as wanted "closed",
    "laps", "start" [x, y, heading], "start_offset", "start_turn", "corridor" and what else its class has in
    `file_fields`, with the meaning and defaults there.

    Raises:
        ValueError: if the file cannot be read as such; one line that starts with the file and names the field
            and the value.
        OSError: if it cannot be opened, FileNotFoundError if there is none.
    """
    name, suffix = os.path.splitext(os.path.basename(file))
    timed = "times" in spec.scenario.file_fields
    if suffix.lower() in TABLE_SUFFIXES:
        try:
            scenario: PathScenario = spec.scenario(name, **_of_table(file, scale, None, timed))
            return scenario
        except ValueError as error:
            raise fault(file, error) from None
    if suffix.lower() != ".json":
        wanted = f"a path is read from {', '.join(TABLE_SUFFIXES)} or .json"
        if suffix.lower() in (".npy", ".npz") and os.path.isfile(file):
            raise fault(file, f"{wanted}: numpy.savetxt('path.csv', points, delimiter=',')")
        raise of_no_scenario(file, wanted)
    fields = json_object(file, _WAY)
    _note_degrees(file, fields, "start")
    for field in ("times", "time", "headings"):
        if field in fields and not timed:
            more = 'a trajectory has them: write "reference" for "path", and see docs/scenarios.md'
            raise fault(file, f"field {field!r} is not known, for a path is driven at the policy's own speed; {more}")
    paths = tuple(dict.fromkeys((spec.kind, _WAY, _TABLE_FILE)))
    check_keys(file, "", fields, (*paths, *spec.scenario.file_fields))
    if len(given := [field for field in paths if field in fields]) != 1:
        raise fault(file, f"exactly one of the fields {' and '.join(map(repr, paths))} must be given")
    closed = fields.pop("closed", False if timed else None)
    if not (closed is None or isinstance(closed, bool)):
        raise fault(file, f"closed is {shown(closed)}; it must be true or false")
    try:
        way = fields.pop(given[0])
        if given[0] == _TABLE_FILE or (timed and isinstance(way, str)):
            fields = _of_table(_beside(file, given[0], way), scale, closed, timed) | fields
        else:
            fields[_WAY] = _listed_path(file, way, closed, scale, timed)
        if fields.get("start") is not None:
            x, y, heading = pose("start", fields["start"])
            fields["start"] = (x * scale, y * scale, heading)
        scenario = spec.scenario(name, **fields)
    except ValueError as error:
        raise fault(file, error) from None
    return scenario


def _readers(function: Callable[..., Any]) -> Callable[..., Any]:
    """Registers the reader of poses, once for each kind of them."""
    for kind, spec in _KINDS.items():
        if not issubclass(spec.scenario, GoalScenario):
            continue
        read = functools.partial(_read, spec)
        sample = {f"{kind}.json": _POSE.replace(_GOAL, kind)}
        function = reader(f"{kind} scenario", f"{kind}.json", sample, read)(function)
    return function


def _read(spec: TaskSpec, read: Callable[..., Any], file: pathlib.Path) -> Any:
    return read(str(file), spec)


@_readers
@reader("goal scenario on a map", "on_map.json", {"on_map.json": _ON_MAP, "room.map": _ROOM})
def field_scenario_from_file(file: str, spec: TaskSpec = TASKS["goal_reaching"]) -> GoalScenario:
    """Returns the scenario of a .json file, of a task in which a pose is reached.

    It holds one object: "goal" [x, y, heading], also called as the task calls it ("dock"), and as wanted "start"
    [x, y, heading], "waypoints" [[x, y], ...], "obstacles" (a list of objects with a "kind", circle, box or wall, and
    the arguments of the constructor of that name; a circle may have a "patrol", an object with the further arguments
    of `moving_circle`), "map" (the name of a map beside the file, or an object with its "file" and the settings of
    `grid_from_file`), "start_offset", "start_turn", "position_tolerance", "heading_tolerance", "waypoint_radius" and
    what else its class has in `file_fields`, with the meaning and defaults there.

    Raises:
        ValueError: if the file cannot be read as such; one line that starts with the file and names the field
            and the value.
        OSError: if it cannot be opened, FileNotFoundError if there is none.
    """
    name, suffix = os.path.splitext(os.path.basename(file))
    if suffix.lower() != ".json":
        raise of_no_scenario(file, "a goal scenario is read from .json", spec.kind)
    fields = json_object(file)
    kind = spec.kind
    _note_degrees(file, fields, "start", _GOAL, kind)
    if kind == _GOAL:
        check_keys(file, "", fields, (_GOAL, *spec.scenario.file_fields), required=(_GOAL,))
    else:
        if (kind in fields) == (_GOAL in fields):
            raise fault(file, f"exactly one of the fields {kind!r} and {_GOAL!r} must be given")
        check_keys(file, "", fields, (kind, _GOAL, *spec.scenario.file_fields))
        if kind in fields:
            fields[_GOAL] = _pose_of(file, kind, fields.pop(kind))
    for field in ("waypoints", "obstacles"):
        if not isinstance(fields.get(field, []), list):
            raise fault(file, f"{field} is {shown(fields[field])}; it must be a list")
        if len(fields.get(field, [])) > MOST_OBSTACLES:
            raise fault(file, f"{field} has {len(fields[field])} entries; there must be at most {MOST_OBSTACLES}")
    records = [_obstacle(file, f"obstacles[{j}]", value) for j, value in enumerate(fields.pop("obstacles", []))]
    try:
        if "map" in fields:
            fields["grid"] = map_of(file, "map", fields.pop("map"))
        obstacles = obstacle_field(*records)
        scenario: GoalScenario = spec.scenario(name, **fields, obstacles=obstacles)
    except ValueError as error:
        raise fault(file, error) from None
    (x, y, heading), (u, v, there) = scenario.start, scenario.goal
    far = math.hypot(u - x, v - y) > scenario.position_tolerance
    if not (far or scenario.waypoints or abs(wrap_angle(there - heading)) > scenario.heading_tolerance):
        warnings.warn(f"{file}: the robot starts at its {kind}; the episode ends at once", FileNote, stacklevel=2)
    return scenario


def of_no_scenario(file: str, wanted: str, kind: str = _GOAL) -> ValueError:
    """Returns the error of a file by whose name it is no scenario; of a map it shows the scenario to write.

    Raises FileNotFoundError where there is none.
    """
    check_ordinary(file, f"{file}:")
    name, suffix = os.path.basename(file), os.path.splitext(file)[1]
    if suffix.lower() not in MAP_SUFFIXES:
        return fault(file, f"suffix {suffix!r} is not known; {wanted}")
    listed = suffix.lower() in (".yaml", ".yml")
    if listed and not re.search(r"^image\s*:", read_text(file), re.MULTILINE):
        return fault(file, f"is no map, for it has no image; {wanted}")
    bare = not listed and suffix.lower() != ".map"
    example = json.dumps(
        {"start": [1, 2, 0], kind: [9, 4, 0], "map": {"file": name, "resolution": 0.05} if bare else name}
    )
    return fault(file, f"is a map; a scenario also has a start and a {kind}: write {example} to mine.json beside it")


def _note_degrees(file: str, fields: Mapping[str, Any], *poses: str) -> None:
    """Says of headings beyond a turn, and of tolerances and ranges beyond half of one, that they are in radians."""
    for name in dict.fromkeys(poses):
        value = fields.get(name)
        if isinstance(value, list) and len(value) == 3:
            note_degrees(file, f"{name}[2]", value[2])
    for name in ("start_turn", "heading_tolerance"):  # half ranges: half a turn is all there is
        note_degrees(file, name, fields.get(name), half=True)


def _pose_of(file: str, field: str, value: Any) -> tuple[float, float, float]:
    try:
        return pose(field, value)
    except ValueError as error:
        raise fault(file, error) from None


def _beside(file: str, field: str, table: Any) -> str:
    """Returns the table that a field of a JSON file names."""
    if not isinstance(table, str) or os.path.splitext(table)[1].lower() not in TABLE_SUFFIXES:
        raise ValueError(f"{field} is {shown(table)}; it must be the name of a table, {', '.join(TABLE_SUFFIXES)}")
    return os.path.join(os.path.dirname(file), table)


def _of_table(table: str, scale: float, closed: bool | None, timed: bool) -> dict[str, Any]:
    """Returns what a scenario has of a table: its path, closed as is said or else as it comes, or path and times."""
    if timed:
        return dict(zip((_WAY, "times"), timed_path_from_table(table, scale), strict=True))
    return {_WAY: path_from_table(table, scale, closed)}


def _listed_path(file: str, points: Any, closed: bool | None, scale: float, timed: bool) -> Path:
    """Returns the path of the points in a JSON file; closed None: as `closing` finds. Each of `timed` ones counts."""
    if not isinstance(points, list):
        raise ValueError(f"path is {shown(points)}; it must be a list of [x, y]")
    if len(points) > MOST_POINTS:
        raise ValueError(f"path has {len(points)} points; there must be at most {MOST_POINTS}")
    try:
        pairs = [numbers_of(f"path[{i}]", point, 2, "x, y") for i, point in enumerate(points)]
    except ValueError as error:
        pair = isinstance(points[0], list) and len(points[0]) == 2
        raise ValueError(f"{error}{origin_to_subtract(points[0], scale) if pair else ''}") from None
    for i, (x, y) in enumerate(pairs):
        if max(abs(x), abs(y)) * scale > FARTHEST:
            raise ValueError(f"path[{i}] is {(x, y)}; it must lie within {FARTHEST:g} m of the origin")
    corners, said = np.reshape([(x * scale, y * scale) for x, y in pairs], (-1, 2)), ""
    if not timed:
        corners, closed, said = closing(corners, closed)
    if said:
        warnings.warn(f"{file}: path {said}", FileNote, stacklevel=2)
    return Path(corners, bool(closed))


def _obstacle(file: str, place: str, value: Any) -> np.void:
    """Returns the OBSTACLE record of one entry of a goal scenario's obstacles."""
    if not isinstance(value, dict):
        raise fault(file, f"{place} is {shown(value)}; it must be an object with a kind")
    arguments = dict(value)
    kind = arguments.pop("kind", None)
    if not isinstance(kind, str) or kind not in _OBSTACLE_KINDS:
        near = suggestion(kind, _OBSTACLE_KINDS) if isinstance(kind, str) else ""
        raise fault(file, f"{place}.kind is {shown(kind)}; it must be one of {', '.join(_OBSTACLE_KINDS)}.{near}")
    patrol = arguments.pop("patrol", None) if kind == "circle" else None
    _check_arguments(file, f"{place}.", arguments, _OBSTACLE_KINDS[kind])
    note_degrees(file, f"{place}.heading", arguments.get("heading"))
    try:
        if patrol is None:
            return _OBSTACLE_KINDS[kind](**arguments)
        if not isinstance(patrol, dict):
            raise ValueError(f"patrol is {shown(patrol)}; it must be an object")
        if arguments.pop("mass", 0.0) != 0.0:
            raise ValueError("a circle with a patrol cannot have a mass")
        of_patrol = [name for name in inspect.signature(moving_circle).parameters if name not in arguments]
        check_keys(file, f"{place}.patrol.", patrol, of_patrol, of_patrol[:-1])
        return moving_circle(**arguments, **patrol)
    except ValueError as error:
        raise fault(file, error if str(error).startswith(f"{file}:") else f"{place}: {error}") from None


def _check_arguments(file: str, place: str, fields: dict[str, Any], make: Callable[..., np.void]) -> None:
    """Refuses an object that does not hold what a constructor takes."""
    parameters = inspect.signature(make).parameters
    required = [name for name, parameter in parameters.items() if parameter.default is parameter.empty]
    check_keys(file, place, fields, parameters, required)


def _content(file: str) -> Any:
    """Returns what a JSON file holds; None where it is no such file."""
    if not file.lower().endswith(".json"):
        return None
    try:
        return json.loads(read_text(file))
    except (ValueError, RecursionError):
        return None


def is_scene(file: str) -> bool:
    """Returns whether a file holds a scene of named objects, which is no scenario of a task."""
    content = _content(file)
    return isinstance(content, dict) and not content.keys().isdisjoint({"scene", "objects"})


def kind_of(file: str) -> str:
    """Returns the kind of the task that a file is a scenario of; what is wrong with one, its reader will say."""
    content = _content(file)
    # a word of its own tells more than those that any path, or any pose, may have
    kinds = sorted(_KINDS, key=(_GOAL, _WAY).__contains__)
    return next((kind for kind in kinds if isinstance(content, dict) and kind in content), _WAY)
