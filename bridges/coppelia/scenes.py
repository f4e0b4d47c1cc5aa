"""The scenes: those of the documents, plain ones, and every scenario of the environments."""

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from wayfield.bridges.coppelia import curves, frames
from wayfield.bridges.coppelia.constants import CUBOID, CYLINDER, DISC, DUMMY, SHAPE
from wayfield.bridges.coppelia.models import model_of
from wayfield.bridges.coppelia.scene import Footprint, Object
from wayfield.bridges.coppelia.world import World
from wayfield.envs.scenarios import (
    GOAL_SCENARIOS,
    PATH_SCENARIOS,
    TASKS,
    GoalScenario,
    PathScenario,
    TaskSpec,
    box,
    circle,
    scenarios_of,
)
from wayfield.envs.scenarios.files import is_scene, kind_of
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.envs.world.paths import Path
from wayfield.system.checks import suggestion

DOCUMENT_A = "document-a"
_WALL_HEIGHT = 0.5  # m
_MARKER_HEIGHT = 0.002  # m, of discs that lie on the floor
_LEAST_THICKNESS = 0.01  # m, reported for a wall without thickness
_CONTROLS_SHOWN = 200  # dummies at the points of a scenario's path

# Document A's scene, read from its author's file: centre (m) and turn of the walls of 5 x 0.2 m, the path's points.
_WALLS = ((2.4, -0.025, 90.0), (-2.375, 0.025, 90.0), (0.0, 2.4, 0.0), (0.025, -2.4, 0.0))
_PATH_CONTROLS = (
    (-1.8701, 2.225, 0.0, 0.0, 0.0, 0.0, 1.0),
    (-1.43951, -1.552455, 0.0, 0.0, 0.0, 0.195089, 0.980786),
    (2.60524, 0.50524, 0.0, 0.0, 0.0, 0.38268, 0.923881),
    (0.522545, -1.88951, 0.0, 0.0, 0.0, 0.55557, 0.83147),
)
_BASE_START = (-1.475, -1.675, 0.0)  # of the robot's base

# Of the scene "arena": x, y (m), and radius, or length, width (m) and turn (degrees).
_ARENA_HALF = 5.0  # m
_CYLINDERS = ((2.0, 1.5, 0.3), (-2.5, 2.0, 0.4), (1.0, -2.5, 0.25), (-3.0, -2.5, 0.5), (3.5, -1.0, 0.2))
_BOXES = ((0.0, 3.2, 1.2, 0.4, 20.0), (-1.5, -1.2, 0.6, 0.6, 45.0), (3.2, 3.0, 0.8, 0.3, -30.0))


class Conditions(NamedTuple):
    """Robot, plant and time step of a scene."""

    robot: str | None = None  # None: that of the scene
    dynamics: str = "kinematic"
    actuators: str = "ideal"
    half_track: float | None = None  # m; None: CoppeliaSim's P3DX
    dt: float = CONTROL_PERIOD  # s
    number: int = 0  # of the scenario in a bank of many


def make_world(name: str, conditions: Conditions = Conditions(), files: bool = True) -> World:  # noqa: B008
    """Returns the world of a scene, by its name, by a scenario's name or file, or by a scene's file.

    Args:
        files: whether the name may be a file, or a family that is read from one; False for names from clients.

    Raises:
        ValueError: if there is no such scene, or it cannot be made under the conditions.
        OSError: if a file cannot be read.
    """
    if name in SCENES:
        return SCENES[name](name, conditions)
    family = name.partition("/")[0]
    known = (*SCENES, *PATH_SCENARIOS, *GOAL_SCENARIOS)
    for spec in TASKS.values():
        if name in spec.presets or (files and family in spec.families):
            return _scenario_world(spec, name, conditions.number, conditions)
    if files and name.lower().endswith((".json", ".csv", ".txt")):
        if is_scene(name):
            from wayfield.bridges.coppelia.scene_files import scene_from_file

            return scene_from_file(name, conditions)
        (spec,) = (spec for spec in TASKS.values() if spec.kind == kind_of(name))
        return _scenario_world(spec, name, 0, conditions)
    if name.lower().endswith(".ttt"):
        raise ValueError(f"{name!r} is a scene of CoppeliaSim's own format, which is not read; choose a scene by name")
    raise ValueError(f"scene {name!r} is unknown.{suggestion(name, known)} The scenes are {', '.join(known)}")


def _chosen(bank: tuple, name: str, index: int):  # type: ignore[no-untyped-def, type-arg]
    if not 0 <= index < len(bank):
        raise ValueError(f"scene {name!r} has {len(bank)} scenarios; index is {index}")
    return bank[index]


def _bank(spec: TaskSpec, name: str, conditions: Conditions) -> tuple[Any, ...]:
    return scenarios_of(spec, name, model_of(conditions.robot or "p3dx").robot.hull_radius)


def _scenario_world(spec: TaskSpec, name: str, index: int, conditions: Conditions) -> World:
    scenario = _chosen(_bank(spec, name, conditions), name, index)
    return _path_world(scenario, conditions) if spec.on_path else _goal_world(scenario, conditions)


def _world(
    name: str,
    conditions: Conditions,
    start: tuple[float, float, float],
    robot: str = "p3dx",
    moving: bool = False,
    room: int = 0,
) -> World:
    model = model_of(conditions.robot or robot, conditions.half_track)
    return World(name, model, start, conditions.dynamics, conditions.actuators, conditions.dt, moving=moving, room=room)


def _floor(world: World, x: float, y: float, length: float, width: float) -> None:
    world.scene.add(
        "Floor", SHAPE, None, (x, y, 0.0, 0.0, 0.0, 0.0, 1.0), primitive=(CUBOID, (length, width, _MARKER_HEIGHT))
    )
    world.bounds = (x - 0.5 * length, y - 0.5 * width, x + 0.5 * length, y + 0.5 * width)


def _marker(world: World, alias: str, x: float, y: float, radius: float, colour: tuple[float, float, float]) -> None:
    """Adds a disc on the floor, which is no obstacle."""
    primitive = (DISC, (2.0 * radius, 2.0 * radius, _MARKER_HEIGHT))
    pose = (x, y, _MARKER_HEIGHT, 0.0, 0.0, 0.0, 1.0)
    world.scene.add(alias, SHAPE, None, pose, primitive=primitive, colour=colour)


def add_path(world: World, rows: curves.Rows, controls: curves.Rows) -> Object:
    """Adds a path at the world's origin, so that its rows are world coordinates."""
    path = world.scene.add("Path", DUMMY)
    path.data["PATH"], path.data["PATHCTRLPTS"] = curves.packed(rows), curves.packed(controls)
    if len(controls) <= _CONTROLS_SHOWN:
        for row in controls.tolist():
            world.scene.add("ctrlPt", DUMMY, path, tuple(row))
    return path


def _solids(world: World, scenario: GoalScenario) -> None:
    """Adds the obstacles of a scenario, as cylinders, cuboids and walls."""
    for record in scenario.obstacles:
        length, width = 2.0 * float(record["half_length"]), 2.0 * float(record["half_width"])
        radius = float(record["radius"])
        if length == 0.0 and width == 0.0:
            alias, primitive = "Cylinder", (CYLINDER, (2.0 * radius, 2.0 * radius, _WALL_HEIGHT))
        else:
            alias = "Wall" if width == 0.0 else "Cuboid"
            primitive = (CUBOID, (length, max(width, _LEAST_THICKNESS), _WALL_HEIGHT))
        footprint = Footprint(record.copy())
        world.add_obstacle(alias, footprint, _WALL_HEIGHT, primitive=primitive)


def _path_world(scenario: PathScenario, conditions: Conditions) -> World:
    path = scenario.path
    start = path.start_pose if scenario.start is None else scenario.start
    world = _world(scenario.name, conditions, start)
    low, high = path.points.min(axis=0) - 1.0, path.points.max(axis=0) + 1.0
    middle, size = 0.5 * (low + high), high - low
    _floor(world, float(middle[0]), float(middle[1]), float(size[0]), float(size[1]))
    rows = path_table(path)
    add_path(world, rows, rows[:-1] if path.closed else rows)
    end = path.points[0] if path.closed else path.points[-1]
    for alias, (x, y), radius, colour in (
        ("Disc", end.tolist(), 0.25, (0.2, 0.7, 0.3)),
        ("LH", start[:2], 0.05, (0.6, 0.3, 0.7)),
        ("Perp", path.points[0].tolist(), 0.05, (0.9, 0.4, 0.1)),
    ):
        _marker(world, alias, float(x), float(y), radius, colour)
    return world


def path_table(path: Path) -> curves.Rows:
    """Returns a path as rows (n, 7) with the quaternion of its heading; a closed path repeats the first row."""
    vertices = path.vertices
    half = 0.5 * vertices["heading"]
    none = np.zeros(len(vertices))
    return np.column_stack([vertices["x"], vertices["y"], none, none, none, np.sin(half), np.cos(half)])


def _goal_world(scenario: GoalScenario, conditions: Conditions, robot: str = "p3dx") -> World:
    if scenario.grid is not None:
        raise ValueError(f"scenario {scenario.name!r} has a map; a scene has none")
    moving, most = bool(scenario.moving.any()), len(scenario.obstacles)
    world = _world(scenario.name, conditions, scenario.start, robot, moving, most)
    places = [scenario.start[:2], scenario.goal[:2], *scenario.waypoints]
    for record in scenario.obstacles:
        reach = float(record["half_length"] + record["half_width"] + record["radius"])
        places += [(float(record["x"]) + sign * reach, float(record["y"]) + sign * reach) for sign in (-1.0, 1.0)]
    low, high = np.min(places, axis=0) - 1.0, np.max(places, axis=0) + 1.0
    middle, size = 0.5 * (low + high), high - low
    _floor(world, float(middle[0]), float(middle[1]), float(size[0]), float(size[1]))
    _solids(world, scenario)
    x, y, heading = scenario.goal
    goal = frames.yawed(x, y, _MARKER_HEIGHT, heading)
    radius = max(scenario.position_tolerance, 0.05)
    disc = (DISC, (2.0 * radius, 2.0 * radius, _MARKER_HEIGHT))
    world.scene.add("Goal", SHAPE, None, goal, primitive=disc, colour=(0.0, 0.62, 0.45))
    for x, y in scenario.waypoints:
        _marker(world, "Waypoint", x, y, 0.05, (0.0, 0.62, 0.45))
    return world


def _document_a(name: str, conditions: Conditions) -> World:
    x, y, heading = _BASE_START
    ahead = model_of(conditions.robot or "p3dx", conditions.half_track).ahead
    world = _world(name, conditions, (x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading))
    _floor(world, 0.0, 0.0, 5.0, 5.0)
    for x, y, degrees in _WALLS:
        footprint = Footprint(box(x, y, 5.0, 0.2, math.radians(degrees)))
        world.add_obstacle("Cuboid", footprint, _WALL_HEIGHT, primitive=(CUBOID, (5.0, 0.2, _WALL_HEIGHT)))
    _marker(world, "Disc", 1.325, 1.525, 0.25, (0.2, 0.7, 0.3))
    _marker(world, "LH", 0.55, 0.775, 0.05, (0.6, 0.3, 0.7))
    _marker(world, "Perp", -0.7, 1.2, 0.05, (0.9, 0.4, 0.1))
    controls = np.array(_PATH_CONTROLS)
    controls[:, 3:] /= np.sqrt((controls[:, 3:] ** 2).sum(axis=1, keepdims=True))
    add_path(world, curves.path_rows(controls, True, 100, 1.0), controls)
    return world


def _empty(name: str, conditions: Conditions) -> World:
    world = _world(name, conditions, (0.0, 0.0, 0.0))
    _floor(world, 0.0, 0.0, 10.0, 10.0)
    return world


def _arena(name: str, conditions: Conditions) -> World:
    world = _world(name, conditions, (0.0, 0.0, 0.0))
    half, thickness = _ARENA_HALF, 0.2
    _floor(world, 0.0, 0.0, 2.0 * half, 2.0 * half)
    for x, y, degrees in ((half, 0.0, 90.0), (-half, 0.0, 90.0), (0.0, half, 0.0), (0.0, -half, 0.0)):
        footprint = Footprint(box(x, y, 2.0 * half, thickness, math.radians(degrees)))
        world.add_obstacle("Wall", footprint, _WALL_HEIGHT, primitive=(CUBOID, (2.0 * half, thickness, _WALL_HEIGHT)))
    for x, y, radius in _CYLINDERS:
        primitive = (CYLINDER, (2.0 * radius, 2.0 * radius, _WALL_HEIGHT))
        world.add_obstacle("Cylinder", Footprint(circle(x, y, radius)), _WALL_HEIGHT, primitive=primitive)
    for x, y, length, width, degrees in _BOXES:
        footprint = Footprint(box(x, y, length, width, math.radians(degrees)))
        world.add_obstacle("Cuboid", footprint, _WALL_HEIGHT, primitive=(CUBOID, (length, width, _WALL_HEIGHT)))
    return world


def _documented(scenario: str, robot: str, name: str, conditions: Conditions) -> World:
    """Returns the world of a scenario with the robot of its document."""
    conditions = conditions._replace(robot=conditions.robot or robot)
    return _goal_world(_bank(TASKS["goal_reaching"], scenario, conditions)[0], conditions)


SCENES: Mapping[str, Callable[[str, Conditions], World]] = {
    # Document A: four walls, a closed path, markers for the look-ahead point and its foot.
    DOCUMENT_A: _document_a,
    # A floor and the robot.
    "empty": _empty,
    # A walled square of 10 m with cylinders and cuboids.
    "arena": _arena,
    # Document B, experiment 2: the base of three omni wheels among obstacles, three waypoints, a goal.
    "document-b": functools.partial(_documented, "omni3_waypoints", "omni3"),
    # Document C, scenario 1: the base of four omni wheels, a box halfway to the goal.
    "document-c": functools.partial(_documented, "apf_1", "omni4"),
}
