"""Functions of `sim` about data: signals, blocks of objects, paths, and what is drawn."""

from collections.abc import MutableMapping
from typing import TYPE_CHECKING, Any

import cbor2
import numpy as np

from wayfield.envs.coppelia import curves
from wayfield.envs.coppelia.calls_math import MAX_ROWS, table
from wayfield.envs.coppelia.calls_objects import add_object, colour_of
from wayfield.envs.coppelia.constants import DUMMY, HANDLE_ALL, HANDLE_APP, HANDLE_WORLD
from wayfield.envs.coppelia.drawing import Drawing
from wayfield.envs.coppelia.scene import Object
from wayfield.envs.coppelia.signatures import (
    FARTHEST,
    NULL,
    TABLE_SIZE,
    WRONG_TYPE,
    CallError,
    Optional,
    Wrong,
    anything,
    array,
    blob,
    exactly,
    integer,
    name,
    node,
    number,
    numbers,
    offered,
    options,
    position,
    shown,
    target,
    text,
    truth,
)

if TYPE_CHECKING:
    from wayfield.envs.coppelia.server import Caller

MAX_STORED = 64 * 2**20  # bytes of all signals and blocks together
MAX_ENTRIES = 1024  # signals and blocks
UNKNOWN_PROPERTY = "property is unknown."
INVALID_PROPERTY = "invalid property name."
PATH_POINTS_SHOWN, PATH_CLOSED, PATH_ORIENTED = 8, 2, 16

Store = MutableMapping[str, Any]


def _put(caller: "Caller", owner: int, store: Store, key: str, value: Any) -> None:
    """Keeps a value, or forgets it where it is None.

    Raises:
        CallError: if there is no room; what was kept before stays.
    """
    sizes = caller.server.stored
    if len(sizes) >= MAX_ENTRIES or sum(sizes.values()) > MAX_STORED // 2:
        # what objects held that are gone
        for entry in [each for each in sizes if each[0] > 0 and each[0] not in caller.world.scene.objects]:
            del sizes[entry]
    if value is None:
        store.pop(key, None)
        sizes.pop((owner, key), None)
        return
    size = len(value) if isinstance(value, bytes | str) else len(cbor2.dumps(value))
    if (owner, key) not in sizes and len(sizes) >= MAX_ENTRIES:
        raise CallError("no more data can be stored.", f"there are {MAX_ENTRIES:,} signals and blocks, the most")
    if sum(sizes.values()) - sizes.get((owner, key), 0) + size > MAX_STORED:
        raise CallError("no more data can be stored.", f"signals and blocks may take {MAX_STORED:,} bytes together")
    store[key] = value
    sizes[owner, key] = size


# Signals. What is put in comes out, whatever the function's name says.


def _set_signal(caller: "Caller", key: str, value: Any) -> None:
    """Sets a signal."""
    _put(caller, 0, caller.world.signals, key, value)


def _get_signal(caller: "Caller", key: str) -> Any:
    """Returns a signal, or null."""
    value = caller.world.signals.get(key)
    return NULL if value is None else value


def _clear_signal(caller: "Caller", key: str) -> None:
    """Forgets a signal."""
    _put(caller, 0, caller.world.signals, key, None)


for _kind, _value in (
    ("String", anything),
    ("Buffer", blob),
    ("Int32", integer),
    ("Integer", integer),
    ("Float", number),
    ("Double", number),
):
    offered(name, Optional(_value), name=f"set{_kind}Signal")(_set_signal)
    offered(name, name=f"get{_kind}Signal")(_get_signal)
    offered(name, name=f"clear{_kind}Signal")(_clear_signal)


# Properties: customData.NAME of objects; signal.NAME of objects, of the scene and of the app.


def _property(caller: "Caller", where: "Object | int", key: str) -> tuple[int, Store, str]:
    """Returns the owner, the store and the name in it of a property.

    Raises:
        CallError: if it is neither customData.NAME nor signal.NAME.
    """
    kind, _, rest = key.partition(".")
    if kind not in ("customData", "signal") or not rest:
        raise CallError(UNKNOWN_PROPERTY, f"{key[:80]!r}; customData.NAME and signal.NAME are offered")
    if isinstance(where, Object):
        return where.handle, where.data, rest if kind == "customData" else key
    if where == HANDLE_APP:
        return -1, caller.world.app_signals, key
    return 0, caller.world.signals, rest if kind == "signal" else key


def _get_property(caller: "Caller", where: "Object | int", key: str, given: dict[str, Any]) -> Any:
    """Returns a property; where there is none, null if the options say noError."""
    value = None
    try:
        _, store, entry = _property(caller, where, key)
        value = store.get(entry)
        if value is None:
            raise CallError(UNKNOWN_PROPERTY, f"{key[:80]!r}")
    except CallError:
        if not given.get("noError"):
            raise
    return NULL if value is None else value


def _remove_property(caller: "Caller", where: "Object | int", key: str, given: dict[str, Any]) -> None:
    """Forgets a property."""
    owner, store, entry = _property(caller, where, key)
    _put(caller, owner, store, entry, None)


def _set_property(caller: "Caller", where: "Object | int", key: str, value: Any, given: dict[str, Any]) -> None:
    """Sets a property."""
    owner, store, entry = _property(caller, where, key)
    _put(caller, owner, store, entry, value)


def _any_table(caller: "Caller", value: Any) -> Any:
    """Returns an array or a map."""
    if not isinstance(value, list | dict):
        raise Wrong(f"got {shown(value)}")
    return value


for _kind, _value in (
    ("Buffer", blob),
    ("String", text),
    ("Float", number),
    ("Int", integer),
    ("Bool", truth),
    ("Table", _any_table),
):
    offered(target, name, Optional(options, {}), name=f"get{_kind}Property")(_get_property)
    offered(target, name, _value, Optional(options, {}), name=f"set{_kind}Property")(_set_property)
offered(target, name, Optional(options, {}), name="removeProperty")(_remove_property)


# Blocks: the older way to a property customData.NAME.


def _reader(empty: Any) -> Any:
    def read(caller: "Caller", found: Object, key: str) -> Any:
        """Returns a block of an object."""
        return found.data.get(key.removeprefix("@tmp."), empty)

    return read


for _name, _empty in (
    ("readCustomDataBlock", b""),
    ("readCustomBufferData", NULL),
    ("readCustomStringData", NULL),
    ("readCustomTableData", {}),
):
    offered(node, name, name=_name)(_reader(_empty))


def _write(caller: "Caller", found: Object, key: str, value: Any) -> None:
    """Writes a block of an object; null or nothing forgets it."""
    _put(caller, found.handle, found.data, key.removeprefix("@tmp."), value if value not in (b"", "") else None)


for _name, _value in (
    ("writeCustomDataBlock", blob),
    ("writeCustomBufferData", blob),
    ("writeCustomStringData", text),
    ("writeCustomTableData", _any_table),
):
    offered(node, name, Optional(_value), name=_name)(_write)


# Paths.


def path_data(rows: curves.Table) -> bytes:
    """Returns the rows of a path as a block: little-endian float64."""
    return np.ascontiguousarray(rows, "<f8").tobytes()


def _rows_of(values: list[Any], caller: "Caller") -> list[float]:
    """Returns the numbers of control points, which may be one array or an array a point."""
    if values and all(isinstance(each, list) for each in values):
        return [each for row in values for each in numbers(caller, row)]
    return numbers(caller, values)


@offered(
    array,
    Optional(integer, 0),
    Optional(integer, 100),
    Optional(number, 1.0),
    Optional(integer, 0),
    Optional(position, [0.0, 0.0, 1.0]),
)
def create_path(
    caller: "Caller",
    points: list[Any],
    bits: int,
    subdivision: int,
    smoothness: float,
    orientation: int,
    up: list[float],
) -> int:
    """Returns the handle of a new path: a dummy whose data are its rows and its control points."""
    try:
        values = _rows_of(points, caller)
    except ValueError as error:
        raise CallError(WRONG_TYPE, f"the control points: {error}") from None
    closed = bool(bits & PATH_CLOSED)
    controls = table(values, 7, 3 if closed else 2)
    if len(controls) > MAX_ROWS or not 2 <= subdivision <= MAX_ROWS:
        raise CallError(WRONG_TYPE, f"control points and subdivisions are at most {MAX_ROWS:,}, subdivisions 2 or more")
    if not 0.0 <= smoothness <= 1.0:
        raise CallError(WRONG_TYPE, f"smoothness is {smoothness:g}; it must be 0 to 1")
    if not 0 <= orientation <= 5:
        raise CallError(WRONG_TYPE, f"orientationMode is {orientation}; it must be 0 to 5")
    sizes = np.sqrt((controls[:, 3:] ** 2).sum(axis=1, keepdims=True))
    if (sizes < 1e-9).any():
        raise CallError(WRONG_TYPE, "a control point's quaternion is zero")
    controls[:, 3:] /= sizes
    if curves.lengths_of(controls)[-1] == 0.0:
        raise CallError(WRONG_TYPE, "all control points are the same")
    rows = curves.path_rows(controls, closed, subdivision, smoothness)
    if bits & PATH_ORIENTED:
        if len(rows) > MAX_ROWS // 10 or max(map(abs, up)) < 1e-9:
            raise CallError(WRONG_TYPE, f"a path with computed orientation has at most {MAX_ROWS // 10:,} rows")
        rows = curves.oriented(rows, closed, orientation, up)
    return add_path(caller, rows, controls).handle


def add_path(caller: "Caller", rows: curves.Table, controls: curves.Table) -> Object:
    """Returns a new path with a dummy at each control point.

    Raises:
        CallError: if there is no room for it.
    """
    path = add_object(caller, "Path", DUMMY)
    try:
        _put(caller, path.handle, path.data, "PATH", path_data(rows))
        _put(caller, path.handle, path.data, "PATHCTRLPTS", path_data(controls))
        for row in controls.tolist():
            add_object(caller, "ctrlPt", DUMMY, path, pose=tuple(row))
    except CallError:
        caller.world.remove([*path.children, path])
        raise
    return path


# Drawing.


@offered(
    integer,
    number,
    Optional(number, 0.0),
    Optional(integer, HANDLE_WORLD),
    Optional(integer, 0),
    Optional(array),
    Optional(anything),
    Optional(anything),
    Optional(anything),
)
def add_drawing_object(
    caller: "Caller",
    kind: int,
    size: float,
    tolerance: float,
    parent: int,
    most: int,
    colour: list[Any] | None,
    *rest: Any,
) -> int:
    """Returns the handle of a new drawing object."""
    if not (0.0 <= size <= FARTHEST and 0.0 <= tolerance <= FARTHEST):
        raise CallError(WRONG_TYPE, f"size and tolerance must be 0 to {FARTHEST:g}")
    if parent >= 0:
        node(caller, parent)
    shade = colour_of(caller, colour) or (0.0, 0.0, 0.0)
    try:
        return caller.world.drawings.add(kind, size, tolerance, max(parent, -1), most, shade)
    except ValueError as error:
        raise CallError("drawing object could not be created.", str(error)) from None


def _drawing(caller: "Caller", value: Any) -> Drawing:
    """Returns the handle of a drawing object."""
    # flags of the handle, such as handleflag_addmultiple, come on top
    handle = integer(caller, value)
    found = caller.world.drawings.drawings.get(handle & 0xFFFFF) if handle >= 0 else None
    if found is None:
        raise CallError("drawing object does not exist.", f"none has the handle {handle}")
    return found


@offered(_drawing, Optional(array))
def add_drawing_object_item(caller: "Caller", found: Drawing, values: list[Any] | None) -> int:
    """Returns 1 where an item was added to a drawing object, 0 where not; nothing empties it."""
    if not values:
        found.items.clear()
        return 0
    try:
        given = exactly(len(values), FARTHEST)(caller, values)
    except ValueError as error:
        raise CallError(WRONG_TYPE, str(error)) from None
    if len(given) < found.width:
        raise CallError(TABLE_SIZE, f"an item has {found.width} numbers, got {len(given)}")
    if caller.world.drawings.full:
        raise CallError("no more items can be drawn.", "all drawing objects together are full")
    added = 0
    for first in range(0, len(given) - found.width + 1, found.width):
        added = found.add(given[first : first + found.width])
    return added


@offered(integer)
def remove_drawing_object(caller: "Caller", handle: int) -> None:
    """Removes a drawing object, or all of them."""
    drawings = caller.world.drawings.drawings
    if handle == HANDLE_ALL:
        drawings.clear()
        return
    _drawing(caller, handle)
    del drawings[handle & 0xFFFFF]
