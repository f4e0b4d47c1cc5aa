"""Functions of `sim` about paths, and the packed tables that their rows are stored in."""

import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from wayfield.bridges.coppelia import curves
from wayfield.bridges.coppelia.calls_data import put
from wayfield.bridges.coppelia.calls_objects import add_object
from wayfield.bridges.coppelia.codec import MAX_ITEMS
from wayfield.bridges.coppelia.constants import DUMMY
from wayfield.bridges.coppelia.curves import Rows
from wayfield.bridges.coppelia.signatures import (
    FARTHEST,
    NO_OPTIONS,
    TABLE_SIZE,
    WRONG_TYPE,
    CallError,
    Options,
    Vector,
    integer,
    number,
    numbers,
    offered,
)

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Caller

MAX_ROWS = 100_000
PATH_CLOSED, PATH_ORIENTED = 2, 16


@offered()
def create_path(
    caller: "Caller", points: list[Any], bits: int = 0, subdivision: int = 100, smoothness: float = 1.0
) -> int:
    """Returns the handle of a new path through control points: a dummy with its rows as data."""
    if points and all(isinstance(each, list) for each in points):
        points = [each for row in points for each in row]
    closed = bool(bits & PATH_CLOSED)
    controls = _rows(numbers(caller, points), 7, 3 if closed else 2)
    if bits & PATH_ORIENTED:
        raise CallError(WRONG_TYPE, "computed orientations, bit 16, are not offered; quaternions are interpolated")
    if len(controls) > MAX_ROWS or not 2 <= subdivision <= MAX_ROWS:
        raise CallError(WRONG_TYPE, f"control points and subdivisions are at most {MAX_ROWS:,}, subdivisions 2 or more")
    if not 0.0 <= smoothness <= 1.0:
        raise CallError(WRONG_TYPE, f"smoothness is {smoothness:g}; it must be 0 to 1")
    sizes = np.sqrt((controls[:, 3:] ** 2).sum(axis=1, keepdims=True))
    if (sizes < 1e-9).any():
        raise CallError(WRONG_TYPE, "a control point's quaternion is zero")
    controls[:, 3:] /= sizes
    if curves.lengths_of(controls)[-1] == 0.0:
        raise CallError(WRONG_TYPE, "all control points are the same")
    rows = curves.path_rows(controls, closed, subdivision, smoothness)
    path = add_object(caller, "Path", DUMMY)
    try:
        put(caller, path.handle, path.data, "PATH", curves.packed(rows))
        put(caller, path.handle, path.data, "PATHCTRLPTS", curves.packed(controls))
        for row in controls.tolist():
            add_object(caller, "ctrlPt", DUMMY, path, pose=tuple(row))
    except CallError:
        caller.world.remove([*path.children, path])
        raise
    return path.handle


def _rows(values: list[float], columns: int, rows: int) -> Rows:
    """Returns numbers as a table (n, columns).

    Raises:
        CallError: if they do not fill it, there are fewer rows, or a number is too large.
    """
    if columns < 1 or len(values) % columns or len(values) < columns * rows:
        raise CallError(TABLE_SIZE, f"{len(values)} numbers are not {rows} or more rows of {columns}")
    table = np.array(values, np.float64).reshape(-1, columns)
    if np.abs(table).max() > FARTHEST:
        raise CallError(WRONG_TYPE, f"a number is beyond {FARTHEST:g}")
    return table


def _lengths(values: list[float], rows: int) -> Rows:
    """Returns the lengths (rows,) to the rows of a path."""
    if len(values) != rows:
        raise CallError(TABLE_SIZE, f"{len(values)} lengths for {rows} rows")
    lengths = _rows(values, 1, 1)[:, 0]
    if (np.diff(lengths) < 0.0).any():
        raise CallError(WRONG_TYPE, "the lengths must ascend")
    return lengths


@offered()
def get_path_lengths(caller: "Caller", path: list[float], columns: int, callback: Any = None) -> Any:
    """Returns the length of a path to each of its rows, and that of the whole, m."""
    if callback is not None:
        raise CallError("not offered by wayfield's server: distances by a function of the client's")
    lengths = curves.lengths_of(_rows(path, columns, 1))
    return lengths.tolist(), float(lengths[-1])


@offered()
def get_closest_pos_on_path(caller: "Caller", path: list[float], lengths: list[float], point: Vector) -> float:
    """Returns the length to the point of a path (rows of x, y, z) that is nearest to a point, m."""
    rows = _rows(path, 3, 2)
    return curves.nearest_length(rows, _lengths(lengths, len(rows)), point)


@offered()
def get_path_interpolated_config(
    caller: "Caller",
    path: list[float],
    lengths: list[float],
    t: float,
    method: Options = NO_OPTIONS,
    types: list[Any] | None = None,
) -> list[float]:
    """Returns the row of a path at a length, by the rule of `curves.interpolated`."""
    if not lengths or len(path) % len(lengths):
        raise CallError(TABLE_SIZE, f"{len(path)} numbers are not a row for each of {len(lengths)} lengths")
    columns = len(path) // len(lengths)
    rows = _rows(path, columns, 2)
    kind, strength = method.get("type", "linear"), number(caller, method.get("strength", 1.0))
    if kind not in ("linear", "quadraticBezier") or not 0.0 <= strength <= 1.0:
        raise CallError(WRONG_TYPE, "method.type is 'linear' or 'quadraticBezier', method.strength 0 to 1")
    strength = max(strength, curves.MIN_STRENGTH) if kind == "quadraticBezier" else 0.0
    closed = not method.get("forceOpen") and bool((np.abs(rows[0] - rows[-1]) < 1e-9).all()) and len(rows) > 2
    row = curves.interpolated(
        rows, _lengths(lengths, len(rows)), np.array([t]), _types(caller, types, columns), strength, closed
    )
    return [float(each) for each in row[0]]


def _types(caller: "Caller", given: list[Any] | None, columns: int) -> list[int]:
    """Returns the types of the columns of a path; without any, all are numbers."""
    types = [integer(caller, each) for each in given or [0] * columns]
    words = "".join(map(str, types)).replace("2222", "")
    if len(types) != columns or not {0, 1, 2}.issuperset(types) or "2" in words:
        raise CallError(WRONG_TYPE, f"types are {columns} of 0 (a number), 1 (an angle), or four times 2 (quaternion)")
    return types


# Packed tables, little-endian. The waiting client packs by itself, the asyncio client calls the server.


def _pack(code: str) -> Any:
    def pack(caller: "Caller", values: list[float], start: int = 0, count: int = 0) -> bytes:
        """Returns numbers as bytes."""
        start = max(start, 0)
        chosen: list[Any] = values[start : start + count] if count > 0 else values[start:]
        if code not in "fd":
            chosen = [integer(caller, each) for each in chosen]
        try:
            return struct.pack(f"<{len(chosen)}{code}", *chosen)
        except (OverflowError, struct.error) as error:
            raise CallError(WRONG_TYPE, str(error)) from None

    return pack


def _unpack(code: str) -> Any:
    size = struct.calcsize(f"<{code}")

    def unpack(caller: "Caller", data: bytes, start: int = 0, count: int = 0, offset: int = 0) -> Any:
        """Returns the numbers in bytes."""
        first = max(start, 0) * size + max(offset, 0)
        chosen = data[first : first + count * size] if count > 0 else data[first:]
        if len(chosen) % size or len(chosen) // size > MAX_ITEMS:
            raise CallError(TABLE_SIZE, f"{len(chosen)} bytes are not {MAX_ITEMS:,} or fewer numbers of {size}")
        return list(struct.unpack(f"<{len(chosen) // size}{code}", chosen))

    return unpack


for _kind, _code in {"UInt8": "B", "UInt16": "H", "UInt32": "I", "Int32": "i", "Float": "f", "Double": "d"}.items():
    offered(f"pack{_kind}Table")(_pack(_code))
    offered(f"unpack{_kind}Table")(_unpack(_code))
