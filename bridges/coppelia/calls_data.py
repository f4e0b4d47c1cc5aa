"""Functions of `sim` about data that clients store: signals, properties and data blocks, drawing objects."""

from collections.abc import MutableMapping
from typing import TYPE_CHECKING, Any

import cbor2

from wayfield.bridges.coppelia import lidar
from wayfield.bridges.coppelia.calls_objects import colour_of
from wayfield.bridges.coppelia.constants import HANDLE_ALL, HANDLE_APP, HANDLE_MASK, HANDLE_WORLD
from wayfield.bridges.coppelia.drawing import Drawing
from wayfield.bridges.coppelia.scene import Object
from wayfield.bridges.coppelia.signatures import (
    FARTHEST,
    NO_OPTIONS,
    NULL,
    TABLE_SIZE,
    WRONG_TYPE,
    CallError,
    Name,
    Options,
    Table,
    Target,
    Wrong,
    node,
    numbers,
    offered,
)

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Caller

MAX_STORED = 64 * 2**20  # bytes of all signals and blocks together
MAX_ENTRIES = 1024  # signals and blocks

Store = MutableMapping[str, Any]


def put(caller: "Caller", owner: int, store: Store, key: str, value: Any) -> None:
    """Stores a value, or removes it where it is None.

    Raises:
        CallError: if there is no room; the old value stays.
    """
    sizes = caller.server.stored
    if len(sizes) >= MAX_ENTRIES or sum(sizes.values()) > MAX_STORED // 2:
        # entries of removed objects
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


# Signals. A signal keeps its type, whatever the name of the function.


def _set_signal(caller: "Caller", key: Name, value: Any = None) -> None:
    """Sets a signal."""
    put(caller, 0, caller.world.signals, key, value)


def _get_signal(caller: "Caller", key: Name) -> Any:
    """Returns a signal, or null."""
    signal = caller.world.signals.get(key)
    return _lidar_signal(caller, key) if signal is None else signal


def _lidar_signal(caller: "Caller", key: str) -> Any:
    """Returns a signal of the lidar, which is packed once it is read; else null."""
    if key not in (*lidar.RANGE_SIGNALS, lidar.ANGLE_SIGNAL):
        return NULL
    ranges = caller.world.scan()
    if ranges is None:
        return NULL
    return lidar.packed(lidar.ANGLES if key == lidar.ANGLE_SIGNAL else ranges)


def _clear_signal(caller: "Caller", key: Name) -> None:
    """Removes a signal."""
    put(caller, 0, caller.world.signals, key, None)


_SIGNALS = {"String": Any, "Buffer": bytes, "Int32": int, "Integer": int, "Float": float, "Double": float}
for _kind, _hint in _SIGNALS.items():
    offered(f"set{_kind}Signal", value=_hint)(_set_signal)
    offered(f"get{_kind}Signal")(_get_signal)
    offered(f"clear{_kind}Signal")(_clear_signal)


# Properties: customData.NAME of objects; signal.NAME of objects, of the scene and of the app.


def _property(caller: "Caller", where: Object | int, key: str) -> tuple[int, Store, str]:
    """Returns the owner, the store and the key of a property.

    Raises:
        CallError: if it is neither customData.NAME nor signal.NAME.
    """
    kind, _, rest = key.partition(".")
    if kind not in ("customData", "signal") or not rest:
        raise CallError("property is unknown.", f"{key[:80]!r}; customData.NAME and signal.NAME are offered")
    if isinstance(where, Object):
        return where.handle, where.data, rest if kind == "customData" else key
    if where == HANDLE_APP:
        return -1, caller.world.app_signals, key
    return 0, caller.world.signals, rest if kind == "signal" else key


def _get_property(caller: "Caller", where: Target, key: Name, given: Options = NO_OPTIONS) -> Any:
    """Returns a property; a missing one is null with the option noError, else an error."""
    try:
        _, store, entry = _property(caller, where, key)
        if entry in store:
            return store[entry]
        if store is caller.world.signals and (signal := _lidar_signal(caller, entry)) is not NULL:
            return signal
        raise CallError("property is unknown.", f"{key[:80]!r}")
    except CallError:
        if given.get("noError"):
            return NULL
        raise


@offered()
def remove_property(caller: "Caller", where: Target, key: Name) -> None:
    """Removes a property."""
    put(caller, *_property(caller, where, key), None)


def _set_property(caller: "Caller", where: Target, key: Name, value: Any) -> None:
    """Sets a property."""
    put(caller, *_property(caller, where, key), value)


_PROPERTIES = {"Buffer": bytes, "String": str, "Float": float, "Int": int, "Bool": bool, "Table": Table}
for _kind, _hint in _PROPERTIES.items():
    offered(f"get{_kind}Property")(_get_property)
    offered(f"set{_kind}Property", value=_hint)(_set_property)


# Data blocks: the older name of the properties customData.NAME.


@offered()
def read_custom_data_block(caller: "Caller", scene_object: Object, key: Name) -> Any:
    """Returns a data block of an object, or no bytes."""
    return scene_object.data.get(key.removeprefix("@tmp."), b"")


@offered("readCustomBufferData", "readCustomStringData")
def read_custom_data(caller: "Caller", scene_object: Object, key: Name) -> Any:
    """Returns a data block of an object, or null."""
    return scene_object.data.get(key.removeprefix("@tmp."), NULL)


@offered("writeCustomDataBlock", "writeCustomBufferData", "writeCustomStringData")
def write_custom_data(caller: "Caller", scene_object: Object, key: Name, value: bytes | None = None) -> None:
    """Writes a data block of an object; null or no bytes remove it."""
    put(caller, scene_object.handle, scene_object.data, key.removeprefix("@tmp."), value or None)


# Drawing objects.


@offered()
def add_drawing_object(
    caller: "Caller",
    kind: int,
    size: float,
    tolerance: float = 0.0,
    parent: int = HANDLE_WORLD,
    most: int = 0,
    colour: list[Any] | None = None,
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


def _drawing(caller: "Caller", handle: int) -> Drawing:
    # flags of the handle, such as handleflag_addmultiple, come on top
    drawing = caller.world.drawings.drawings.get(handle & HANDLE_MASK) if handle >= 0 else None
    if drawing is None:
        raise CallError("drawing object does not exist.", f"none has the handle {handle}")
    return drawing


@offered()
def add_drawing_object_item(caller: "Caller", handle: int, values: list[Any] | None = None) -> int:
    """Returns 1 where an item was added to a drawing object, else 0; no numbers remove all its items."""
    drawing = _drawing(caller, handle)
    if not values:
        drawing.items.clear()
        return 0
    given = numbers(caller, values)
    if max(map(abs, given)) > FARTHEST:
        raise Wrong(f"a number is beyond {FARTHEST:g}")
    if len(given) < drawing.width:
        raise CallError(TABLE_SIZE, f"an item has {drawing.width} numbers, got {len(given)}")
    if caller.world.drawings.full:
        raise CallError("no more items can be drawn.", "all drawing objects together are full")
    starts = range(0, len(given) - drawing.width + 1, drawing.width)
    return [drawing.add(given[first : first + drawing.width]) for first in starts][-1]


@offered()
def remove_drawing_object(caller: "Caller", handle: int) -> None:
    """Removes a drawing object; for sim.handle_all every one."""
    drawings = caller.world.drawings.drawings
    if handle == HANDLE_ALL:
        drawings.clear()
        return
    _drawing(caller, handle)
    del drawings[handle & HANDLE_MASK]
