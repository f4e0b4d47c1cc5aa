"""Functions of `sim` about objects: finding, placing, making and removing them, the wheels, sonars and the lidar."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from wayfield.bridges.coppelia import frames, lidar
from wayfield.bridges.coppelia.constants import (
    CONE,
    CUBOID,
    CYLINDER,
    DISC,
    DUMMY,
    HANDLE_ALL,
    HANDLE_PARENT,
    HANDLE_SCENE,
    HANDLE_WORLD,
    JOINT_BASE_FLAG,
    PLANE,
    SHAPE,
    SPHEROID,
    STOPPED,
)
from wayfield.bridges.coppelia.frames import Pose
from wayfield.bridges.coppelia.scene import MAX_ALIAS, MAX_LEVELS, Footprint, Object
from wayfield.bridges.coppelia.signatures import (
    FARTHEST,
    NO_OPTIONS,
    TABLE_SIZE,
    WRONG_TYPE,
    CallError,
    Flagged,
    Joint,
    Matrix,
    Options,
    Sensor,
    Shape,
    Vector,
    Wheel,
    exactly,
    integer,
    node,
    numbers,
    offered,
    sensor,
)
from wayfield.bridges.coppelia.world import MAX_WHEEL_TARGET
from wayfield.envs.scenarios import box, circle

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Caller

# Sensors that scripts request, and what there is in their place.
_NOT_THERE = {
    "camera|vision|kinect|rgb|depth": "there are no cameras; sonars are ultrasonicSensor[i], the planar lidar is lidar",
    "lidar|laser|hokuyo|sick|velodyne": (
        "the only lidar is /PioneerP3DX/lidar of the p3dx, planar, with the signals "
        f"{', '.join((*lidar.RANGE_SIGNALS, lidar.ANGLE_SIGNAL))}, and readVisionSensor of fastHokuyo_sensor1 and 2"
    ),
}

LEAST_HEIGHT = 0.02  # m; a lower shape is no obstacle
MIN_SIZE, MAX_SIZE = 1e-4, 1e4  # m, of a shape


# Finding.


def _handle_of(caller: "Caller", path: str, given: Options, old: bool) -> int:
    scene = caller.world.scene
    try:
        index = integer(caller, given.get("index") or 0)
        if index < 0:
            raise ValueError("it is negative")
    except ValueError as error:
        raise CallError(WRONG_TYPE, f"options.index: {error}") from None
    obj: Object | None = None
    hint = f"no object {path[:80]!r}; sim.getObjectsInTree(sim.handle_scene) lists them"
    try:
        obj = scene.find(path, index)
    except ValueError:
        if old:
            obj = scene.find_old(path)
        hint = f"{path[:80]!r} is no path such as '/PioneerP3DX/leftMotor'"
    if obj is not None:
        if scene.is_old(path):
            caller.server.log("renamed", f"{path[:80]!r} is taken for {scene.short_path(obj)}")
        return obj.handle
    if given.get("noError"):
        return -1
    for words, offers in _NOT_THERE.items():
        if re.search(words, path.lower()):
            hint = offers
    raise CallError("object does not exist, or alias/path is ill formatted.", hint)


@offered()
def get_object(caller: "Caller", path: str, given: Options = NO_OPTIONS) -> int:
    """Returns the handle of the object at a path."""
    return _handle_of(caller, path, given, old=False)


@offered()
def get_object_handle(caller: "Caller", path: str, given: Options = NO_OPTIONS) -> int:
    """Returns the handle of the object at a path, or of a name from before CoppeliaSim 4.2."""
    return _handle_of(caller, path, given, old=True)


@offered("getObjectAlias", "getObjectName")
def get_object_alias(caller: "Caller", scene_object: Object, option: int = -1) -> str:
    """Returns the alias of an object, or its path."""
    scene = caller.world.scene
    if option == 0:
        return scene.indexed(scene_object)
    if option in (1, 5):
        return scene.short_path(scene_object)
    if option == 2:
        return scene.full_path(scene_object)
    return f"{scene_object.alias}__{scene_object.handle}__" if option == 4 else scene_object.alias


@offered()
def set_object_alias(caller: "Caller", scene_object: Object, alias: str) -> None:
    """Sets the alias of an object."""
    _refuse_part(scene_object, "its name is fixed")
    if not 0 < len(alias) <= MAX_ALIAS or not all(c.isalnum() or c in "_- ." for c in alias):
        raise CallError(WRONG_TYPE, f"an alias is 1 to {MAX_ALIAS} letters, digits, '_', '-', '.' and blanks")
    scene_object.alias = alias


@offered()
def get_object_parent(caller: "Caller", scene_object: Object) -> int:
    """Returns the handle of an object's parent, or -1."""
    return -1 if scene_object.parent is None else scene_object.parent.handle


@offered()
def get_object_child(caller: "Caller", scene_object: Object, index: int) -> int:
    """Returns the handle of an object's child, or -1."""
    return scene_object.children[index].handle if 0 <= index < len(scene_object.children) else -1


@offered()
def set_object_parent(caller: "Caller", scene_object: Object, parent: int = HANDLE_WORLD, keep: bool = True) -> None:
    """Attaches an object to a parent; `keep` keeps its pose in the world, else its relative pose stays."""
    _refuse_part(scene_object, "its parent is fixed")
    to = None if parent == HANDLE_WORLD else node(caller, parent)
    if scene_object.footprint is not None:
        if to is not None:
            raise CallError("object is an obstacle.", "it stands on the floor; only the world can be its parent")
        return
    if to is not None:
        if _below(to, scene_object):
            raise CallError("object is its own parent.", "the new parent is below the object")
        levels = sum(1 for _ in to.ancestors()) + 1 + _levels(scene_object)
        if levels > MAX_LEVELS:
            raise CallError("object cannot be attached.", f"the tree would have {levels} levels; {MAX_LEVELS} is most")
    caller.world.scene.attach(scene_object, to, keep)


def _below(one: Object, other: Object) -> bool:
    """Returns whether an object is another or below it."""
    return one is other or any(each is other for each in one.ancestors())


def _levels(scene_object: Object) -> int:
    return 1 + max(map(_levels, scene_object.children), default=0)


@offered()
def get_objects_in_tree(caller: "Caller", handle: int, kind: int = HANDLE_ALL, bits: int = 0) -> list[int]:
    """Returns the handles of an object and all below it, or of the whole scene."""
    scene = caller.world.scene
    if handle in (HANDLE_SCENE, HANDLE_WORLD):
        objects = list(scene.roots) if bits & 2 else [each for root in scene.roots for each in root.tree()]
    else:
        base = node(caller, handle)
        below = base.children if bits & 2 else [each for child in base.children for each in child.tree()]
        objects = [*([] if bits & 1 else [base]), *below]
    return [each.handle for each in objects if kind in (HANDLE_ALL, each.kind)]


@offered()
def get_objects(caller: "Caller", index: int, kind: int = HANDLE_ALL) -> int:
    """Returns the handle of the index-th object of a type, -1 past the end."""
    handles = [each.handle for each in caller.world.scene.objects.values() if kind in (HANDLE_ALL, each.kind)]
    return handles[index] if 0 <= index < len(handles) else -1


@offered()
def get_object_type(caller: "Caller", scene_object: Object) -> int:
    """Returns the type of an object."""
    return scene_object.kind


@offered()
def is_handle(caller: "Caller", handle: int) -> bool:
    """Returns whether an object has the handle."""
    return handle in caller.world.scene.objects


# Poses. `to` is the handle of the reference frame.


def _frame(caller: "Caller", scene_object: Object, to: int) -> Pose:
    """Returns the reference frame of an object's relative pose, in the world."""
    if to == HANDLE_PARENT:
        return caller.world.scene.frame(scene_object.parent)
    other = node(caller, to)
    return caller.world.scene.pose(other) if to & JOINT_BASE_FLAG else caller.world.scene.frame(other)


def _relative_pose(caller: "Caller", scene_object: Object, to: int) -> Pose:
    """Returns the pose of an object in a reference frame."""
    pose = caller.world.scene.pose(scene_object)
    return pose if to == HANDLE_WORLD else frames.composed(frames.inverse(_frame(caller, scene_object, to)), pose)


@offered()
def get_object_position(caller: "Caller", scene_object: Object, to: int = HANDLE_WORLD) -> list[float]:
    """Returns the position of an object, m."""
    return list(_relative_pose(caller, scene_object, to)[:3])


@offered()
def get_object_orientation(caller: "Caller", scene_object: Object, to: int = HANDLE_WORLD) -> list[float]:
    """Returns the Euler angles of an object, rad."""
    return list(frames.euler_from_quaternion(_relative_pose(caller, scene_object, to)[3:]))


@offered()
def get_object_quaternion(caller: "Caller", which: Flagged, to: int = HANDLE_WORLD) -> list[float]:
    """Returns the quaternion of an object."""
    return get_object_pose(caller, which, to)[3:]


@offered()
def get_object_pose(caller: "Caller", which: Flagged, to: int = HANDLE_WORLD) -> list[float]:
    """Returns the pose of an object."""
    obj, scalar_first = which
    px, py, pz, x, y, z, w = _relative_pose(caller, obj, to)
    return [px, py, pz, w, x, y, z] if scalar_first else [px, py, pz, x, y, z, w]


@offered()
def get_object_matrix(caller: "Caller", scene_object: Object, to: int = HANDLE_WORLD) -> list[float]:
    """Returns the matrix of an object."""
    return frames.matrix_of(_relative_pose(caller, scene_object, to))


def _refuse_part(scene_object: Object, why: str) -> None:
    if scene_object.part:
        raise CallError("object is a part of the robot.", f"{scene_object.alias}: {why}")


def _pose(place: Sequence[float], turn: Sequence[float]) -> Pose:
    try:
        return frames.pose_of(place, turn)
    except ValueError as error:
        raise CallError(WRONG_TYPE, str(error)) from None


def _pose_of_matrix(values: Sequence[float]) -> Pose:
    try:
        return frames.pose_from_matrix(values)
    except ValueError as error:
        raise CallError(WRONG_TYPE, str(error)) from None


def _move(caller: "Caller", scene_object: Object, to: int, place: Sequence[float], turn: Sequence[float]) -> None:
    """Moves an object to a position and a quaternion in a reference frame."""
    if scene_object is not caller.world.scene.base:
        _refuse_part(scene_object, "its place on the robot is fixed; move the robot")
    pose = _pose(place, turn)
    if to != HANDLE_WORLD:
        if to != HANDLE_PARENT and _below(node(caller, to), scene_object):
            raise CallError(WRONG_TYPE, "an object cannot be placed relative to itself or to what is below it")
        pose = frames.composed(_frame(caller, scene_object, to), pose)
    if max(map(abs, pose[:3])) > FARTHEST:
        raise CallError(WRONG_TYPE, f"the place is beyond {FARTHEST:g} m")
    # rounding must not pile up over a thousand poses
    caller.world.move(scene_object, _pose(pose[:3], pose[3:]))


def _either_order(caller: "Caller", first: Any, second: Any, count: int) -> tuple[list[float], int]:
    """Returns the numbers and the reference frame of a setter; in old scripts the frame comes first."""
    if not isinstance(first, list):
        first, second = second, first
    return exactly(count)(caller, first), HANDLE_WORLD if second is None else integer(caller, second)


@offered()
def set_object_position(caller: "Caller", scene_object: Object, first: Any, second: Any = None) -> None:
    """Sets the position of an object; its orientation stays."""
    place, to = _either_order(caller, first, second, 3)
    _move(caller, scene_object, to, place, _relative_pose(caller, scene_object, to)[3:])


@offered()
def set_object_orientation(caller: "Caller", scene_object: Object, first: Any, second: Any = None) -> None:
    """Sets the Euler angles of an object; its position stays."""
    (alpha, beta, gamma), to = _either_order(caller, first, second, 3)
    _move(
        caller,
        scene_object,
        to,
        _relative_pose(caller, scene_object, to)[:3],
        frames.quaternion_from_euler(alpha, beta, gamma),
    )


@offered()
def set_object_quaternion(caller: "Caller", which: Flagged, first: Any, second: Any = None) -> None:
    """Sets the quaternion of an object; its position stays."""
    obj, scalar_first = which
    turn, to = _either_order(caller, first, second, 4)
    turn = [*turn[1:], turn[0]] if scalar_first else turn
    _move(caller, obj, to, _relative_pose(caller, obj, to)[:3], turn)


@offered()
def set_object_pose(caller: "Caller", which: Flagged, first: Any, second: Any = None) -> None:
    """Sets the pose of an object."""
    obj, scalar_first = which
    values, to = _either_order(caller, first, second, 7)
    _move(caller, obj, to, values[:3], [*values[4:], values[3]] if scalar_first else values[3:])


@offered()
def set_object_matrix(caller: "Caller", scene_object: Object, first: Any, second: Any = None) -> None:
    """Sets the matrix of an object."""
    values, to = _either_order(caller, first, second, 12)
    pose = _pose_of_matrix(values)
    _move(caller, scene_object, to, pose[:3], pose[3:])


@offered("getObjectVelocity", "getVelocity")
def get_object_velocity(caller: "Caller", scene_object: Object) -> tuple[list[float], list[float]]:
    """Returns the linear (m/s) and the angular (rad/s) velocity of an object's origin, in the world."""
    linear, angular = caller.world.velocity(scene_object)
    return list(linear), list(angular)


@offered()
def multiply_matrices(caller: "Caller", a: Matrix, b: Matrix) -> list[float]:
    """Returns the product of two matrices."""
    return frames.matrix_of(frames.composed(_pose_of_matrix(a), _pose_of_matrix(b)))


@offered()
def get_matrix_inverse(caller: "Caller", values: Matrix) -> list[float]:
    """Returns the inverse of a matrix."""
    return frames.matrix_of(frames.inverse(_pose_of_matrix(values)))


@offered()
def multiply_vector(caller: "Caller", values: list[float], vector: Vector) -> list[float]:
    """Returns the product of a matrix or a pose, and a point."""
    if len(values) not in (7, 12):
        raise CallError(TABLE_SIZE, f"a matrix has 12 numbers and a pose 7, got {len(values)}")
    pose = _pose(values[:3], values[3:]) if len(values) == 7 else _pose_of_matrix(values)
    return list(frames.composed(pose, (*vector, 0.0, 0.0, 0.0, 1.0))[:3])


# Wheels.


@offered()
def set_joint_target_velocity(caller: "Caller", wheel: Wheel, velocity: float, params: Any = None) -> int:
    """Sets the target speed of a wheel, rad/s."""
    world = caller.world
    if velocity != 0.0 and world.state == STOPPED and not world.set_while_stopped:
        world.set_while_stopped = True
        caller.server.log("wheels", "set while stopped; they turn after sim.startSimulation (or serve with --start)")
    world.targets[wheel.wheel] = min(max(velocity, -MAX_WHEEL_TARGET), MAX_WHEEL_TARGET)
    return 1


@offered()
def get_joint_target_velocity(caller: "Caller", joint: Joint) -> float:
    """Returns the target speed of a wheel, rad/s; 0 for a free joint."""
    return float(caller.world.targets[joint.wheel]) if joint.wheel >= 0 else 0.0


@offered()
def get_joint_velocity(caller: "Caller", joint: Joint) -> float:
    """Returns the speed of a wheel in the last pass, rad/s; 0 for a free joint."""
    return float(caller.world.speeds[joint.wheel]) if joint.wheel >= 0 else 0.0


@offered()
def get_joint_position(caller: "Caller", joint: Joint) -> float:
    """Returns the angle of a wheel, rad; 0 for a free joint."""
    return float(caller.world.angles[joint.wheel]) if joint.wheel >= 0 else 0.0


# Sonars and lidar.


@offered()
def read_vision_sensor(caller: "Caller", scene_object: Object) -> tuple[int, list[float], list[float]]:
    """Returns the points of a half of the lidar in the last pass: 0, an empty packet, and that of `lidar.points`."""
    if scene_object.scans < 0:
        raise CallError(
            "object is not a vision sensor.", "the scene has no cameras; the halves of the lidar are offered"
        )
    ranges = caller.world.scan()
    return (-1, [], []) if ranges is None else (0, [], lidar.points(ranges, scene_object.scans))


@offered()
def read_proximity_sensor(caller: "Caller", sensor: Sensor) -> Any:
    """Returns the reading of a sonar in the last pass."""
    return caller.world.reading(sensor)


@offered()
def handle_proximity_sensor(caller: "Caller", handle: int) -> Any:
    """Returns the reading of a sonar now; for sim.handle_all that of the last sonar."""
    sonars = [each for each in caller.world.scene.objects.values() if each.sonar is not None]
    if handle != HANDLE_ALL:
        sonars = [sensor(caller, handle)]
    if not sonars:
        raise CallError("object is not a proximity sensor.", "the scene has none")
    return [caller.world.sense(each) for each in sonars][-1]


@offered()
def check_proximity_sensor(caller: "Caller", sensor: Sensor, entity: int = HANDLE_ALL) -> Any:
    """Returns the reading of a sonar now, of one object or of all; null where there is no echo."""
    only = None if entity == HANDLE_ALL else node(caller, entity)
    hit, *rest = caller.world.peek(sensor, only)
    return (hit, *rest) if hit else (0, None, None, None, None)


# Making and removing.


def add_object(caller: "Caller", alias: str, kind: int, to: Object | None = None, **settings: Any) -> Object:
    """Returns a new object; one that is made while the simulation runs is removed at its end.

    Raises:
        CallError: if the scene is full.
    """
    try:
        return caller.world.scene.add(alias, kind, to, created=caller.world.state != 0, **settings)
    except ValueError as error:
        raise CallError("object could not be created.", str(error)) from None


@offered()
def create_dummy(caller: "Caller", size: float = 0.01, colour: list[Any] | None = None) -> int:
    """Returns the handle of a new dummy at the world's origin."""
    if not 0.0 <= size <= MAX_SIZE:
        raise CallError(WRONG_TYPE, f"the size is {size:g} m; it must be 0 to {MAX_SIZE:g}")
    return add_object(caller, "Dummy", DUMMY, size=size, colour=colour_of(caller, colour)).handle


def colour_of(caller: "Caller", values: list[Any] | None) -> tuple[float, float, float] | None:
    """Returns red, green and blue, 0 to 1, of the first three of 3 to 12 numbers; None where there are none."""
    if not values:
        return None
    given = numbers(caller, values)
    if not 3 <= len(given) <= 12:
        raise CallError(TABLE_SIZE, f"a colour has 3 to 12 numbers, got {len(given)}")
    red, green, blue = (min(max(each, 0.0), 1.0) for each in given[:3])
    return red, green, blue


@offered()
def create_primitive_shape(caller: "Caller", kind: int, sizes: list[float], bits: int = 0) -> int:
    """Returns the handle of a new shape at the world's origin.

    Its footprint is an obstacle to the hull and to sonars, unless it is lower than 2 cm.
    """
    names = {PLANE: "Plane", DISC: "Disc", CUBOID: "Cuboid", SPHEROID: "Sphere", CYLINDER: "Cylinder", CONE: "Cone"}
    if kind not in names:
        raise CallError(WRONG_TYPE, f"primitive shape type {kind} is unknown")
    sizes = [*sizes, *([sizes[-1]] * (3 - len(sizes)) if sizes else [])][:3]
    if len(sizes) < 3:
        raise CallError(TABLE_SIZE, "sizes are three numbers")
    flat = kind in (PLANE, DISC)
    if not all(MIN_SIZE <= size <= MAX_SIZE for size in sizes[: 2 if flat else 3]):
        raise CallError(WRONG_TYPE, f"sizes must be {MIN_SIZE:g} to {MAX_SIZE:g} m")
    length, width, height = sizes[0], sizes[1], 0.0 if flat else sizes[2]
    primitive = (kind, (length, width, height))
    if height < LEAST_HEIGHT:
        return add_object(caller, names[kind], SHAPE, primitive=primitive).handle
    record = box(0.0, 0.0, length, width) if kind == CUBOID else circle(0.0, 0.0, 0.25 * (length + width))
    created = caller.world.state != 0
    try:
        new = caller.world.add_obstacle(names[kind], Footprint(record), height, primitive=primitive, created=created)
    except ValueError as error:
        raise CallError("object could not be created.", str(error)) from None
    new.pose = frames.ORIGIN
    return new.handle


def _remove(caller: "Caller", chosen: Sequence[Object]) -> None:
    for each in chosen:
        for child in each.tree():
            _refuse_part(child, "the robot stays")
    caller.world.remove(chosen)


@offered()
def remove_object(caller: "Caller", scene_object: Object) -> int:
    """Removes an object from the scene."""
    _remove(caller, [scene_object])
    return 1


@offered()
def remove_objects(caller: "Caller", handles: list[Any], later: bool = False) -> None:
    """Removes objects from the scene."""
    _remove(caller, list(dict.fromkeys(node(caller, handle) for handle in handles)))


@offered()
def remove_model(caller: "Caller", scene_object: Object, later: bool = False) -> int:
    """Removes an object and all below it from the scene; returns how many."""
    chosen = list(scene_object.tree())
    _remove(caller, chosen)
    return len(chosen)


@offered()
def get_shape_geom_info(caller: "Caller", shape: Shape) -> tuple[int, int, list[float]]:
    """Returns the bits of a shape (2 convex, 4 primitive), its kind of primitive, and its sizes, m."""
    if shape.primitive is None:
        return 1, 0, [0.0, 0.0, 0.0, 0.0]
    kind, sizes = shape.primitive
    return 6, kind, [*map(float, sizes), 0.0]
