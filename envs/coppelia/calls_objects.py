"""Functions of `sim` about objects: finding, placing, making and removing them, the wheels and the sonars."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from wayfield.envs.coppelia import frames
from wayfield.envs.coppelia.calls_math import checked_matrix, checked_pose
from wayfield.envs.coppelia.constants import (
    CONE,
    CUBOID,
    CYLINDER,
    DISC,
    DUMMY,
    HANDLE_ALL,
    HANDLE_SCENE,
    HANDLE_WORLD,
    PLANE,
    SHAPE,
    SPHEROID,
)
from wayfield.envs.coppelia.frames import Pose
from wayfield.envs.coppelia.scene import MAX_ALIAS, MAX_LEVELS, Footprint, Object
from wayfield.envs.coppelia.signatures import (
    FARTHEST,
    TABLE_SIZE,
    WORLD,
    WRONG_TYPE,
    CallError,
    Optional,
    anything,
    array,
    exactly,
    flagged,
    integer,
    joint,
    node,
    number,
    numbers,
    offered,
    options,
    parent,
    relative,
    sensor,
    shape,
    text,
    truth,
    wheel,
)
from wayfield.envs.coppelia.world import MAX_WHEEL_TARGET
from wayfield.envs.scenarios import box, circle

if TYPE_CHECKING:
    from wayfield.envs.coppelia.server import Caller

Relative = tuple[str, Object | None, bool]

ILL_FORMATTED = "object does not exist, or alias/path is ill formatted."
PART = "object is a part of the robot."
LEAST_HEIGHT = 0.02  # m; a flatter shape is driven over
MIN_SIZE, MAX_SIZE = 1e-4, 1e4  # m, of a shape


# Finding.


def _found(caller: "Caller", path: str, given: dict[str, Any], old: bool) -> int:
    scene = caller.world.scene
    index = given.get("index", 0)
    try:
        index = integer(caller, 0 if index is None else index)
        if index < 0:
            raise ValueError("it is negative")
    except ValueError as error:
        raise CallError(WRONG_TYPE, f"options.index: {error}") from None
    found: Object | None = None
    hint = f"no object {path[:80]!r}; sim.getObjectsInTree(sim.handle_scene) lists them"
    try:
        found = scene.find(path, index)
    except ValueError:
        if old:
            found = scene.find_old(path)
        hint = f"{path[:80]!r} is no path such as '/PioneerP3DX/leftMotor'"
    if found is not None:
        if scene.is_old(path):
            caller.server.log("renamed", f"{path[:80]!r} is taken for {scene.short_path(found)}")
        return found.handle
    if given.get("noError"):
        return -1
    raise CallError(ILL_FORMATTED, hint)


@offered(text, Optional(options, {}))
def get_object(caller: "Caller", path: str, given: dict[str, Any]) -> int:
    """Returns the handle of the object that a path leads to."""
    return _found(caller, path, given, old=False)


@offered(text, Optional(options, {}))
def get_object_handle(caller: "Caller", path: str, given: dict[str, Any]) -> int:
    """Returns the handle of an object by path, or by the name that it had before CoppeliaSim 4.2."""
    return _found(caller, path, given, old=True)


@offered(node, Optional(integer, -1))
def get_object_alias(caller: "Caller", found: Object, option: int) -> str:
    """Returns an object's alias, or its path."""
    scene = caller.world.scene
    if option == 0:
        return scene.indexed(found)
    if option in (1, 5):
        return scene.short_path(found)
    if option == 2:
        return scene.full_path(found)
    if option == 4:
        return f"{found.alias}__{found.handle}__"
    return found.alias


@offered(node, Optional(integer, -1))
def get_object_name(caller: "Caller", found: Object, option: int) -> str:
    """Returns an object's alias."""
    return get_object_alias(caller, found, option)  # type: ignore[no-any-return]


@offered(node, text)
def set_object_alias(caller: "Caller", found: Object, alias: str) -> None:
    """Gives an object another alias."""
    _refuse_part(found, "its name is fixed")
    if not 0 < len(alias) <= MAX_ALIAS or not all(c.isalnum() or c in "_- ." for c in alias):
        raise CallError(WRONG_TYPE, f"an alias is 1 to {MAX_ALIAS} letters, digits, '_', '-', '.' and blanks")
    found.alias = alias


@offered(node)
def get_object_parent(caller: "Caller", found: Object) -> int:
    """Returns the handle of an object's parent, or -1."""
    return -1 if found.parent is None else found.parent.handle


@offered(node, integer)
def get_object_child(caller: "Caller", found: Object, index: int) -> int:
    """Returns the handle of an object's child, or -1."""
    return found.children[index].handle if 0 <= index < len(found.children) else -1


@offered(node, Optional(parent), Optional(truth, True))
def set_object_parent(caller: "Caller", found: Object, to: Object | None, keep: bool) -> None:
    """Gives an object another parent; it stays where it is, or keeps its pose relative to its parent."""
    _refuse_part(found, "its parent is fixed")
    if found.footprint is not None:
        if to is not None:
            raise CallError("object is an obstacle.", "it stands on the floor; only the world can be its parent")
        return
    if to is not None:
        if to is found or any(each is found for each in to.ancestors()):
            raise CallError("object is its own parent.", "the new parent is below the object")
        levels = sum(1 for _ in to.ancestors()) + 1 + _levels(found)
        if levels > MAX_LEVELS:
            raise CallError("object cannot be attached.", f"the tree would have {levels} levels; {MAX_LEVELS} is most")
    caller.world.scene.attach(found, to, keep)


def _levels(found: Object) -> int:
    return 1 + max(map(_levels, found.children), default=0)


def _of_kind(found: Object, kind: int) -> bool:
    return kind in (HANDLE_ALL, found.kind)


@offered(integer, Optional(integer, HANDLE_ALL), Optional(integer, 0))
def get_objects_in_tree(caller: "Caller", handle: int, kind: int, bits: int) -> list[int]:
    """Returns the handles of an object and all below it, or of the whole scene."""
    scene = caller.world.scene
    if handle in (HANDLE_SCENE, HANDLE_WORLD):
        found = list(scene.roots) if bits & 2 else [each for root in scene.roots for each in root.tree()]
    else:
        base = node(caller, handle)
        below = base.children if bits & 2 else [each for child in base.children for each in child.tree()]
        found = [*([] if bits & 1 else [base]), *below]
    return [each.handle for each in found if _of_kind(each, kind)]


@offered(integer, Optional(integer, HANDLE_ALL))
def get_objects(caller: "Caller", index: int, kind: int) -> int:
    """Returns the handle of the index-th object of a type, -1 past the end."""
    found = [each.handle for each in caller.world.scene.objects.values() if _of_kind(each, kind)]
    return found[index] if 0 <= index < len(found) else -1


@offered(node)
def get_object_type(caller: "Caller", found: Object) -> int:
    """Returns an object's type."""
    return found.kind


@offered(integer)
def is_handle(caller: "Caller", handle: int) -> bool:
    """Returns whether an object has the handle."""
    return handle in caller.world.scene.objects


# Placing.


def _reference(caller: "Caller", found: Object, to: Relative) -> Pose:
    """Returns the frame that a pose is relative to."""
    where, other, still = to
    if where == "world":
        return frames.ORIGIN
    if where == "parent":
        return caller.world.scene.frame(found.parent)
    assert other is not None
    return caller.world.scene.pose(other) if still else caller.world.scene.frame(other)


def _place(caller: "Caller", found: Object, to: Relative) -> Pose:
    """Returns an object's pose relative to another."""
    place = caller.world.scene.pose(found)
    if to is WORLD:
        return place
    return frames.composed(frames.inverse(_reference(caller, found, to)), place)


@offered(node, Optional(relative, WORLD))
def get_object_position(caller: "Caller", found: Object, to: Relative) -> list[float]:
    """Returns an object's position."""
    return list(_place(caller, found, to)[:3])


@offered(node, Optional(relative, WORLD))
def get_object_orientation(caller: "Caller", found: Object, to: Relative) -> list[float]:
    """Returns an object's Euler angles."""
    return list(frames.euler_from_quaternion(_place(caller, found, to)[3:]))


@offered(flagged, Optional(relative, WORLD))
def get_object_quaternion(caller: "Caller", which: tuple[Object, bool], to: Relative) -> list[float]:
    """Returns an object's quaternion."""
    found, scalar_first = which
    x, y, z, w = _place(caller, found, to)[3:]
    return [w, x, y, z] if scalar_first else [x, y, z, w]


@offered(flagged, Optional(relative, WORLD))
def get_object_pose(caller: "Caller", which: tuple[Object, bool], to: Relative) -> list[float]:
    """Returns an object's pose."""
    found, scalar_first = which
    px, py, pz, x, y, z, w = _place(caller, found, to)
    return [px, py, pz, w, x, y, z] if scalar_first else [px, py, pz, x, y, z, w]


@offered(node, Optional(relative, WORLD))
def get_object_matrix(caller: "Caller", found: Object, to: Relative) -> list[float]:
    """Returns an object's matrix."""
    return frames.matrix_of(_place(caller, found, to))


def _refuse_part(found: Object, why: str) -> None:
    if found.part:
        raise CallError(PART, f"{found.alias}: {why}")


def _move(caller: "Caller", found: Object, to: Relative, place: Pose) -> None:
    """Puts an object at a pose relative to another."""
    world = caller.world
    if found is not world.scene.base:
        _refuse_part(found, "its place on the robot is fixed; move the robot")
    if to is not WORLD:
        _, other, _ = to
        if other is not None and (other is found or any(each is found for each in other.ancestors())):
            raise CallError(WRONG_TYPE, "an object cannot be placed relative to itself or to what is below it")
        place = frames.composed(_reference(caller, found, to), place)
    if max(map(abs, place[:3])) > FARTHEST:
        raise CallError(WRONG_TYPE, f"the place is beyond {FARTHEST:g} m")
    # rounding must not pile up over a thousand poses
    world.move(found, checked_pose(place[:3], place[3:]))


def _either_order(caller: "Caller", first: Any, second: Any, count: int) -> tuple[list[float], Relative]:
    """Returns the numbers and the reference of a setter, whose older order is the other way round."""
    if not isinstance(first, list):
        first, second = second, first
    values = exactly(count, FARTHEST)(caller, first)
    return values, WORLD if second is None else relative(caller, second)


_SETTER = (flagged, anything, Optional(anything))


@offered(*_SETTER)
def set_object_position(caller: "Caller", which: tuple[Object, bool], first: Any, second: Any) -> None:
    """Puts an object at a position; how it is turned stays."""
    found, _ = which
    place, to = _either_order(caller, first, second, 3)
    turn = _place(caller, found, to)[3:]
    _move(caller, found, to, (place[0], place[1], place[2], *turn))


@offered(*_SETTER)
def set_object_orientation(caller: "Caller", which: tuple[Object, bool], first: Any, second: Any) -> None:
    """Turns an object to Euler angles; where it is stays."""
    found, _ = which
    euler, to = _either_order(caller, first, second, 3)
    place = _place(caller, found, to)
    _move(caller, found, to, (*place[:3], *frames.quaternion_from_euler(*euler)))


@offered(*_SETTER)
def set_object_quaternion(caller: "Caller", which: tuple[Object, bool], first: Any, second: Any) -> None:
    """Turns an object to a quaternion; where it is stays."""
    found, scalar_first = which
    turn, to = _either_order(caller, first, second, 4)
    if scalar_first:
        turn = [*turn[1:], turn[0]]
    _move(caller, found, to, checked_pose(_place(caller, found, to)[:3], turn))


@offered(*_SETTER)
def set_object_pose(caller: "Caller", which: tuple[Object, bool], first: Any, second: Any) -> None:
    """Puts an object at a pose."""
    found, scalar_first = which
    values, to = _either_order(caller, first, second, 7)
    turn = [*values[4:], values[3]] if scalar_first else values[3:]
    _move(caller, found, to, checked_pose(values[:3], turn))


@offered(*_SETTER)
def set_object_matrix(caller: "Caller", which: tuple[Object, bool], first: Any, second: Any) -> None:
    """Puts an object where a matrix tells."""
    values, to = _either_order(caller, first, second, 12)
    _move(caller, which[0], to, checked_matrix(values))


@offered(node)
def get_object_velocity(caller: "Caller", found: Object) -> tuple[list[float], list[float]]:
    """Returns the linear and the angular velocity of an object's origin, in the world."""
    linear, angular = caller.world.velocity(found)
    return list(linear), list(angular)


@offered(shape)
def get_velocity(caller: "Caller", found: Object) -> tuple[list[float], list[float]]:
    """Returns the linear and the angular velocity of a shape."""
    linear, angular = caller.world.velocity(found)
    return list(linear), list(angular)


# Wheels.


def _once(caller: "Caller", what: str) -> None:
    if what not in caller.server.said:
        caller.server.said.add(what)
        caller.server.log("without effect", what, 10)


@offered(wheel, number, Optional(anything))
def set_joint_target_velocity(caller: "Caller", found: Object, velocity: float, params: Any) -> int:
    """Sets how fast a wheel is to turn, rad/s."""
    caller.world.targets[found.wheel] = min(max(velocity, -MAX_WHEEL_TARGET), MAX_WHEEL_TARGET)
    return 1


@offered(joint)
def get_joint_target_velocity(caller: "Caller", found: Object) -> float:
    """Returns how fast a wheel is to turn, rad/s."""
    return float(caller.world.targets[found.wheel]) if found.wheel >= 0 else 0.0


@offered(joint)
def get_joint_velocity(caller: "Caller", found: Object) -> float:
    """Returns how fast a wheel turned in the last pass, rad/s."""
    return float(caller.world.speeds[found.wheel]) if found.wheel >= 0 else 0.0


@offered(joint)
def get_joint_position(caller: "Caller", found: Object) -> float:
    """Returns the angle of a joint, rad."""
    return float(caller.world.angles[found.wheel]) if found.wheel >= 0 else 0.0


def _no_position(caller: "Caller", found: Object, value: float, params: Any) -> None:
    """Refuses to turn a wheel to an angle."""
    raise CallError("joint is in velocity control.", "wheels turn by sim.setJointTargetVelocity")


offered(joint, number, Optional(anything), name="setJointPosition")(_no_position)
offered(joint, number, Optional(anything), name="setJointTargetPosition")(_no_position)


def _set_force(caller: "Caller", found: Object, force: float, signed: Any) -> int:
    """Takes note of a motor's force, which has no effect."""
    found.data["force"] = force
    _once(caller, "the force of a joint: the plant's motors are those of the robot's data sheet")
    return 1


for _name in ("setJointTargetForce", "setJointForce", "setJointMaxForce"):
    offered(joint, number, Optional(anything), name=_name)(_set_force)

_FORCE = 3.0  # N m


@offered(joint)
def get_joint_target_force(caller: "Caller", found: Object) -> float:
    """Returns the force that a motor may use, N m."""
    return float(found.data.get("force", _FORCE))


@offered(joint)
def get_joint_max_force(caller: "Caller", found: Object) -> float:
    """Returns the force that a motor may use, N m."""
    return float(found.data.get("force", _FORCE))


@offered(joint)
def get_joint_force(caller: "Caller", found: Object) -> float:
    """Returns 0: forces in the motors are not known."""
    return 0.0


@offered(joint)
def get_joint_mode(caller: "Caller", found: Object) -> tuple[int, int]:
    """Returns the mode of a joint: dynamic."""
    return 5, 0


@offered(joint)
def get_joint_type(caller: "Caller", found: Object) -> int:
    """Returns the type of a joint: revolute."""
    return 10


@offered(joint)
def get_joint_interval(caller: "Caller", found: Object) -> tuple[bool, list[float]]:
    """Returns that a joint turns for ever."""
    return True, [-math.pi, 2.0 * math.pi]


# Sonars.


@offered(sensor)
def read_proximity_sensor(caller: "Caller", found: Object) -> Any:
    """Returns what a sonar sensed in the last pass."""
    return caller.world.reading(found)


@offered(integer)
def handle_proximity_sensor(caller: "Caller", handle: int) -> Any:
    """Returns what a sonar senses now; for sim.handle_all what the last of them does."""
    if handle != HANDLE_ALL:
        return caller.world.sense(sensor(caller, handle))
    found = [each for each in caller.world.scene.objects.values() if each.sonar is not None]
    if not found:
        raise CallError("object is not a proximity sensor.", "the scene has none")
    return [caller.world.sense(each) for each in found][-1]


@offered(sensor, Optional(integer, HANDLE_ALL))
def check_proximity_sensor(caller: "Caller", found: Object, entity: int) -> Any:
    """Returns what a sonar senses now of an object, or of all; null where there is nothing."""
    only = None if entity == HANDLE_ALL else node(caller, entity)
    hit, distance, point, handle, normal = caller.world.peek(found, only)
    if not hit:
        return 0, None, None, None, None
    return hit, distance, point, handle, normal


@offered(integer)
def reset_proximity_sensor(caller: "Caller", handle: int) -> None:
    """Makes a sonar, or all of them, read nothing until the next pass."""
    chosen = caller.world.scene.objects.values() if handle == HANDLE_ALL else [sensor(caller, handle)]
    for each in chosen:
        if each.sonar is not None:
            caller.world.reset_reading(each)


# Making and removing.


def add_object(caller: "Caller", alias: str, kind: int, to: Object | None = None, **settings: Any) -> Object:
    """Returns a new object, which goes with the simulation if that runs.

    Raises:
        CallError: if the scene is full.
    """
    try:
        new = caller.world.scene.add(alias, kind, to, created=caller.world.state != 0, **settings)
    except ValueError as error:
        raise CallError("object could not be created.", str(error)) from None
    return new


@offered(Optional(number, 0.01), Optional(array))
def create_dummy(caller: "Caller", size: float, colour: list[Any] | None) -> int:
    """Returns the handle of a new dummy at the world's origin."""
    if not 0.0 <= size <= MAX_SIZE:
        raise CallError(WRONG_TYPE, f"the size is {size:g} m; it must be 0 to {MAX_SIZE:g}")
    return add_object(caller, "Dummy", DUMMY, size=size, colour=colour_of(caller, colour)).handle


def colour_of(caller: "Caller", values: list[Any] | None) -> tuple[float, float, float] | None:
    """Returns red, green and blue, 0 to 1, of the first three of 3 to 12 numbers; None where there are none."""
    if not values:
        return None
    try:
        given = numbers(caller, values)
    except ValueError as error:
        raise CallError(WRONG_TYPE, f"the colour: {error}") from None
    if not 3 <= len(given) <= 12:
        raise CallError(TABLE_SIZE, f"a colour has 3 to 12 numbers, got {len(given)}")
    red, green, blue = (min(max(each, 0.0), 1.0) for each in given[:3])
    return red, green, blue


@offered(integer, numbers, Optional(integer, 0))
def create_primitive_shape(caller: "Caller", kind: int, sizes: list[float], bits: int) -> int:
    """Returns the handle of a new shape that stands on the floor at the world's origin.

    It is an obstacle of its footprint to the hull and to sonars, unless it is flatter than 2 cm.
    """
    names = {PLANE: "Plane", DISC: "Disc", CUBOID: "Cuboid", SPHEROID: "Sphere", CYLINDER: "Cylinder", CONE: "Cone"}
    if kind not in names:
        raise CallError(WRONG_TYPE, f"primitive shape type {kind} is unknown")
    sizes = [*sizes, *([sizes[-1]] * (3 - len(sizes)) if sizes else [])][:3]
    if len(sizes) < 3:
        raise CallError(TABLE_SIZE, "sizes are three numbers")
    if not all(MIN_SIZE <= size <= MAX_SIZE for size in sizes[: 2 if kind in (PLANE, DISC) else 3]):
        raise CallError(WRONG_TYPE, f"sizes must be {MIN_SIZE:g} to {MAX_SIZE:g} m")
    length, width, height = sizes
    if kind in (PLANE, DISC):
        height = 0.0
    primitive = (kind, (length, width, height))
    if height < LEAST_HEIGHT:
        return add_object(caller, names[kind], SHAPE, primitive=primitive).handle
    round_one = kind != CUBOID
    record = circle(0.0, 0.0, 0.25 * (length + width)) if round_one else box(0.0, 0.0, length, width)
    try:
        new = caller.world.add_obstacle(
            names[kind], Footprint(record), height, primitive=primitive, created=caller.world.state != 0
        )
    except ValueError as error:
        raise CallError("object could not be created.", str(error)) from None
    new.pose = frames.ORIGIN
    return new.handle


def _remove(caller: "Caller", chosen: Sequence[Object]) -> None:
    for each in chosen:
        _refuse_part(each, "the robot stays")
        if any(child.part for child in each.tree()):
            raise CallError(PART, "the robot stays")
    caller.world.remove(chosen)


@offered(node)
def remove_object(caller: "Caller", found: Object) -> int:
    """Takes an object out of the scene."""
    _remove(caller, [found])
    return 1


@offered(array, Optional(truth, False))
def remove_objects(caller: "Caller", handles: list[Any], later: bool) -> None:
    """Takes objects out of the scene."""
    try:
        chosen = list(dict.fromkeys(node(caller, handle) for handle in handles))
    except ValueError as error:
        raise CallError(WRONG_TYPE, str(error)) from None
    _remove(caller, chosen)


@offered(node, Optional(truth, False))
def remove_model(caller: "Caller", found: Object, later: bool) -> int:
    """Takes an object and all below it out of the scene."""
    chosen = list(found.tree())
    _remove(caller, chosen)
    return len(chosen)


# Shapes.


def _box_of(found: Object) -> tuple[float, float, float]:
    if found.primitive is not None:
        return found.primitive[1]
    return 0.0, 0.0, 0.0


@offered(shape)
def get_shape_geom_info(caller: "Caller", found: Object) -> tuple[int, int, list[float]]:
    """Returns what a shape is, as bits (2 convex, 4 primitive), the kind of primitive, and its sizes."""
    if found.primitive is None:
        return 1, 0, [0.0, 0.0, 0.0, 0.0]
    kind, sizes = found.primitive
    return 6, kind, [*map(float, sizes), 0.0]


@offered(shape, name="getShapeBB")
def get_shape_bb(caller: "Caller", found: Object) -> tuple[list[float], list[float]]:
    """Returns the sizes of the box around a shape, and its pose in the shape's frame."""
    return list(map(float, _box_of(found))), list(frames.ORIGIN)


_OBJECT_FLOATS = range(15, 21)  # objfloatparam_modelbbox_min_x and the like: the box around an object


@offered(node, integer)
def get_object_float_param(caller: "Caller", found: Object, which: int) -> float:
    """Returns a parameter of an object: 15 to 20 are the box around it, in its frame."""
    if which not in _OBJECT_FLOATS:
        raise CallError(WRONG_TYPE, f"parameter {which} is unknown")
    half = 0.5 * _box_of(found)[(which - 15) % 3]
    return -half if which < 18 else half


@offered(node, integer)
def get_object_int32_param(caller: "Caller", found: Object, which: int) -> int:
    """Returns a parameter of an object: 10 is whether it is visible."""
    if which != 10:
        raise CallError(WRONG_TYPE, f"parameter {which} is unknown")
    return 1


def _without_effect(what: str) -> Any:
    def accept(caller: "Caller", found: Object, *rest: Any) -> int:
        """Takes note of how something is to look, which has no effect."""
        _once(caller, what)
        return 1

    return accept


for _name, _count in (("setObjectInt32Param", 2), ("setObjectFloatParam", 2), ("setModelProperty", 1)):
    offered(node, *[Optional(anything)] * _count, name=_name)(_without_effect(f"sim.{_name}"))


def _set_colour(caller: "Caller", found: Object, first: Any, second: Any, third: Any) -> int:
    """Gives an object a colour, which the window shows of dummies and discs."""
    values = next((each for each in (first, second, third) if isinstance(each, list)), None)
    found.colour = colour_of(caller, values) or found.colour
    return 1


for _name in ("setObjectColor", "setShapeColor"):
    offered(node, Optional(anything), Optional(anything), Optional(anything), name=_name)(_set_colour)
