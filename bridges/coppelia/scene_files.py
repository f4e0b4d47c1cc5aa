"""Scenes of the user's own: a JSON file with named objects, and a script that sets up the scene."""

import os
import runpy
import warnings
from typing import TYPE_CHECKING, Any

from wayfield.bridges.coppelia import frames
from wayfield.bridges.coppelia.constants import CONSTANTS, CUBOID, CYLINDER, DISC, DUMMY, SHAPE, SPHEROID
from wayfield.bridges.coppelia.models import P3DX_BASE_HEIGHT
from wayfield.bridges.coppelia.scene import MAX_ALIAS, MAX_OBJECTS, Footprint
from wayfield.bridges.coppelia.scenes import SCENES, Conditions, add_path, make_world, path_table
from wayfield.bridges.coppelia.signatures import FUNCTIONS, NULL, Callback, Wait
from wayfield.bridges.coppelia.world import World
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import box, circle
from wayfield.envs.scenarios.maps import note_degrees
from wayfield.envs.scenarios.scenario import LONG
from wayfield.envs.world.paths import Path
from wayfield.system.checks import choose, number, numbers_of, pose, shown, truth
from wayfield.system.objects import FileNote, check_keys, fault, json_object
from wayfield.system.readers import reader

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Server

OBJECTS = "objects"  # the field that makes a file a scene
_SOLID = ("radius", "height", "obstacle")
# Kinds of objects, and their fields besides kind, name, at and colour.
_KINDS = {
    "dummy": ("size",),
    "disc": ("radius",),
    "box": ("length", "width", "height", "obstacle"),
    "cylinder": _SOLID,
    "sphere": ("radius", "obstacle"),
    "robot": (),
    "path": ("points", "closed"),
}
_SAMPLE = """{"scene": "empty", "start": [0, 0, 0.5], "objects": [{"kind": "dummy", "name": "P1", "at": [1, 0.5]},
{"kind": "disc", "name": "Goal", "at": [2, 1], "radius": 0.2, "colour": [0, 0.6, 0.4]},
{"kind": "sphere", "name": "Sphere", "at": [0, 2], "radius": 0.1, "obstacle": false},
{"kind": "box", "name": "Wall", "at": [3, 0, 1.57], "length": 4, "width": 0.2, "height": 0.5},
{"kind": "cylinder", "name": "Post", "at": [-2, 0], "radius": 0.2}, {"kind": "robot", "at": [-2, 2, 0]},
{"kind": "path", "name": "Track", "points": [[0, 0], [1, 1], [2, 0]], "closed": true}]}"""


@reader("scene", "scene.json", {"scene.json": _SAMPLE}, lambda function, file: function(str(file), Conditions()))
def scene_from_file(file: str, conditions: Conditions) -> World:
    """Returns the world of a scene file: a JSON object with "objects", and as wanted "scene" and "start".

    "scene" is the name of the scene that the objects come to, "empty" by default. "start" is [x, y, heading] of the
    robot's origin (m, rad). An object has a "kind", a "name" (except a robot), a place "at" [x, y] or [x, y, heading],
    and the fields of its kind: dummy (size), disc (radius; a marker on the floor), box (length, width, height),
    cylinder (radius, height), sphere (radius), robot (the hull of another P3DX, which stands), path (points, closed).
    Boxes, cylinders and spheres are obstacles unless "obstacle" is false; markers and dummies may have a "colour".

    Raises:
        ValueError: if the file is no such scene; one line with the file, the field and the value.
        OSError: if it cannot be opened.
    """
    fields = json_object(file)
    check_keys(file, "", fields, ("scene", "start", OBJECTS), (OBJECTS,))
    objects = fields[OBJECTS]
    if not isinstance(objects, list) or len(objects) > MAX_OBJECTS:
        raise fault(file, f"{OBJECTS} is {shown(objects)}; it must be a list of at most {MAX_OBJECTS} objects")
    try:
        name = fields.get("scene", "empty")
        choose("scene", name, SCENES)
        world = make_world(name, conditions, files=False)
        world.scene.name = os.path.splitext(os.path.basename(file))[0]
        if "start" in fields:
            x, y, heading = pose("start", fields["start"])
            assert world.scene.base is not None
            world.move(world.scene.base, frames.yawed(x, y, world.model.height, heading))
        for i, each in enumerate(objects):
            place = f"{OBJECTS}[{i}]"
            if not isinstance(each, dict):
                raise fault(file, f"{place} is {shown(each)}; it must be an object")
            choose(f"{place}.kind", each.get("kind"), _KINDS)
            known = ("kind", "name", "at", "colour", *_KINDS[each["kind"]])
            wanted = ("name",) if each["kind"] == "path" else ("at",) if each["kind"] == "robot" else ("name", "at")
            check_keys(file, f"{place}.", each, known, wanted)
            _add(world, place, each)
    except ValueError as error:
        raise fault(file, error) from None
    _doubt(file, "start", fields.get("start"))
    for i, each in enumerate(objects):
        _doubt(file, f"{OBJECTS}[{i}].at", each.get("at"))
        for field in ("radius", "width", "height", "size"):
            if each.get(field, 0.0) > 20.0:
                _say_metres(file, f"{OBJECTS}[{i}].{field}", each[field], 20.0)
    return world


def _doubt(file: str, place: str, at: list[float] | None) -> None:
    """Says of a place whose heading is in degrees, or that is in other units than metres."""
    if at is None:
        return
    if len(at) == 3:
        note_degrees(file, f"{place}[2]", at[2])
    if (far := max(map(abs, at[:2]))) > LONG:
        _say_metres(file, place, far, LONG)


def _say_metres(file: str, place: str, value: float, most: float) -> None:
    warnings.warn(
        f"{file}: {place} is {value:g} m, usual is at most {most:g}; lengths are in m", FileNote, stacklevel=3
    )


def _add(world: World, place: str, fields: dict[str, Any]) -> None:
    """Adds an object of a file to a world; `place` is where the file has it."""
    kind = fields["kind"]
    alias = fields.get("name", "PioneerP3DX")
    if (
        not isinstance(alias, str)
        or not 0 < len(alias) <= MAX_ALIAS
        or not all(c.isalnum() or c in "_- ." for c in alias)
    ):
        raise ValueError(f"{place}.name is {shown(alias)}; it must be letters, digits, '_', '-', '.' and blanks")
    if kind == "path":
        closed = fields.get("closed", False)
        truth(f"{place}.closed", closed)
        rows = path_table(Path(fields.get("points", []), closed))
        add_path(world, rows, rows[:-1] if closed else rows).alias = alias
        return
    at = fields["at"]
    x, y, heading = pose(f"{place}.at", [*at, 0.0] if isinstance(at, list) and len(at) == 2 else at)

    def size(field: str, usual: float) -> float:
        value = fields.get(field, usual)
        number(f"{place}.{field}", value, above=0.0, most=1000.0)
        return float(value)

    colour: Any = fields.get("colour")
    if colour is not None:
        colour = numbers_of(f"{place}.colour", colour, 3, "red, green, blue from 0 to 1")
    if kind == "dummy":
        world.scene.add(alias, DUMMY, None, frames.yawed(x, y, 0.0, heading), size=size("size", 0.1), colour=colour)
        return
    solid = kind != "disc"
    if kind == "box":
        length, width, height = size("length", 0.5), size("width", 0.5), size("height", 0.5)
        primitive, record = (CUBOID, (length, width, height)), box(x, y, length, width, heading)
    else:
        radius = ROBOTS["p3dx"].hull_radius if kind == "robot" else size("radius", 0.25)
        high = {"disc": 0.002, "sphere": 2.0 * radius, "robot": 2.0 * P3DX_BASE_HEIGHT}
        height = high[kind] if kind in high else size("height", 0.5)
        shape = {"disc": DISC, "sphere": SPHEROID}.get(kind, CYLINDER)
        primitive, record = (shape, (2.0 * radius, 2.0 * radius, height)), circle(x, y, radius)
    if "obstacle" in fields:
        truth(f"{place}.obstacle", fields["obstacle"])
        solid = fields["obstacle"]
    if solid:
        new = world.add_obstacle(alias, Footprint(record), height, primitive=primitive, colour=colour)
        new.pose = frames.yawed(x, y, 0.5 * height, heading)
    else:
        high_up = height if kind == "disc" else 0.5 * height
        world.scene.add(alias, SHAPE, None, frames.yawed(x, y, high_up, heading), primitive=primitive, colour=colour)


class Hand:
    """The functions and constants of `sim`, called in the server's own process before it serves."""

    def __init__(self, server: "Server") -> None:
        from wayfield.bridges.coppelia.server import Caller, Client

        self._caller = Caller(server, Client("setup", "setup", 600.0))

    def __getattr__(self, name: str) -> Any:
        if name in CONSTANTS:
            return CONSTANTS[name]
        function = FUNCTIONS.get(f"sim.{name}")
        if function is None:
            raise AttributeError(f"sim.{name} is not offered")

        def call(*args: Any) -> Any:
            result = function(self._caller, list(args))
            if isinstance(result, Wait | Callback):
                raise RuntimeError(f"sim.{name} waits for a pass; a setup script runs before the first one")
            return None if result is NULL else result

        return call


def run_setup(file: str, server: "Server") -> None:
    """Runs the user's script with `sim`, which sets up the scene of a server that does not serve yet."""
    runpy.run_path(file, init_globals={"sim": Hand(server)}, run_name="__setup__")
