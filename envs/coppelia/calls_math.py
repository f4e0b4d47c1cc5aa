"""Functions of `sim` that only compute: matrices, poses, Euler angles, paths as tables, packed tables."""

import array
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wayfield.envs.checks import shown
from wayfield.envs.coppelia import curves, frames
from wayfield.envs.coppelia.codec import MAX_ITEMS
from wayfield.envs.coppelia.signatures import (
    FARTHEST,
    TABLE_SIZE,
    WRONG_TYPE,
    CallError,
    Optional,
    Wrong,
    angles,
    anything,
    blob,
    integer,
    matrix,
    number,
    numbers,
    offered,
    options,
    pose,
    position,
)

if TYPE_CHECKING:
    from wayfield.envs.coppelia.server import Caller

MAX_ROWS = 100_000  # of a path that is made


def checked_pose(place: Sequence[float], turn: Sequence[float]) -> frames.Pose:
    """Returns the pose of a position and a quaternion.

    Raises:
        CallError: if the quaternion is zero.
    """
    try:
        return frames.pose_of(place, turn)
    except ValueError as error:
        raise CallError(WRONG_TYPE, str(error)) from None


def checked_matrix(values: Sequence[float]) -> frames.Pose:
    """Returns the pose of a matrix.

    Raises:
        CallError: if it is no rotation and translation.
    """
    try:
        return frames.pose_from_matrix(values)
    except ValueError as error:
        raise CallError(WRONG_TYPE, str(error)) from None


@offered(position, angles)
def build_matrix(caller: "Caller", place: list[float], euler: list[float]) -> list[float]:
    """Returns the matrix of a position and Euler angles."""
    return frames.matrix_of((*place, *frames.quaternion_from_euler(*euler)))


@offered(matrix, matrix)
def multiply_matrices(caller: "Caller", a: list[float], b: list[float]) -> list[float]:
    """Returns the product of two matrices."""
    return frames.matrix_product(a, b)


@offered(matrix)
def get_matrix_inverse(caller: "Caller", values: list[float]) -> list[float]:
    """Returns the matrix that undoes another."""
    return frames.matrix_of(frames.inverse(checked_matrix(values)))


@offered(matrix)
def invert_matrix(caller: "Caller", values: list[float]) -> list[float]:
    """Returns the matrix that undoes another."""
    return frames.matrix_of(frames.inverse(checked_matrix(values)))


@offered(numbers, position)
def multiply_vector(caller: "Caller", values: list[float], vector: list[float]) -> list[float]:
    """Returns a point, given in the frame of a matrix or a pose, in the frame that it is given in."""
    if len(values) == 7:
        place = checked_pose(values[:3], values[3:])
    elif len(values) == 12:
        place = checked_matrix(values)
    else:
        raise CallError(TABLE_SIZE, f"a matrix has 12 numbers and a pose 7, got {len(values)}")
    return list(frames.composed(place, (*vector, 0.0, 0.0, 0.0, 1.0))[:3])


@offered(position, numbers)
def build_pose(caller: "Caller", place: list[float], turn: list[float]) -> list[float]:
    """Returns the pose of a position and Euler angles or a quaternion."""
    if len(turn) == 3:
        turn = list(frames.quaternion_from_euler(*turn))
    if len(turn) != 4:
        raise CallError(TABLE_SIZE, f"Euler angles are 3 numbers and a quaternion 4, got {len(turn)}")
    return list(checked_pose(place, turn))


@offered(pose)
def pose_to_matrix(caller: "Caller", values: list[float]) -> list[float]:
    """Returns the matrix of a pose."""
    return frames.matrix_of(checked_pose(values[:3], values[3:]))


@offered(matrix)
def matrix_to_pose(caller: "Caller", values: list[float]) -> list[float]:
    """Returns the pose of a matrix."""
    return list(checked_matrix(values))


@offered(pose, pose)
def multiply_poses(caller: "Caller", a: list[float], b: list[float]) -> list[float]:
    """Returns the pose b, given in the frame of a, in the frame that a is given in."""
    return list(frames.composed(checked_pose(a[:3], a[3:]), checked_pose(b[:3], b[3:])))


@offered(pose)
def get_pose_inverse(caller: "Caller", values: list[float]) -> list[float]:
    """Returns the pose that undoes another."""
    return list(frames.inverse(checked_pose(values[:3], values[3:])))


@offered(pose, pose, number)
def interpolate_poses(caller: "Caller", a: list[float], b: list[float], share: float) -> list[float]:
    """Returns the pose a share of the way from one to another."""
    first, second = checked_pose(a[:3], a[3:]), checked_pose(b[:3], b[3:])
    share = min(max(share, 0.0), 1.0)
    place = [p + share * (q - p) for p, q in zip(first[:3], second[:3], strict=True)]
    return [*place, *frames.slerped(first[3:], second[3:], share)]


@offered(matrix, matrix, number)
def interpolate_matrices(caller: "Caller", a: list[float], b: list[float], share: float) -> list[float]:
    """Returns the matrix a share of the way from one to another."""
    between = interpolate_poses(caller, list(checked_matrix(a)), list(checked_matrix(b)), share)
    return frames.matrix_of(between)


@offered(matrix)
def get_euler_angles_from_matrix(caller: "Caller", m: list[float]) -> list[float]:
    """Returns the Euler angles of a matrix."""
    return list(frames.euler_from_rotation((m[0:3], m[4:7], m[8:11])))


@offered(number, number, number)
def alpha_beta_gamma_to_yaw_pitch_roll(
    caller: "Caller", alpha: float, beta: float, gamma: float
) -> tuple[float, float, float]:
    """Returns yaw, pitch and roll of Euler angles."""
    return frames.yaw_pitch_roll_from_euler(alpha, beta, gamma)


@offered(number, number, number)
def yaw_pitch_roll_to_alpha_beta_gamma(
    caller: "Caller", yaw: float, pitch: float, roll: float
) -> tuple[float, float, float]:
    """Returns the Euler angles of yaw, pitch and roll."""
    return frames.euler_from_yaw_pitch_roll(yaw, pitch, roll)


# Paths as tables.


def table(values: Sequence[float], columns: int, rows: int = 1) -> curves.Table:
    """Returns numbers as a table of so many columns.

    Raises:
        CallError: if they do not fill it, or there are too few rows.
    """
    if columns < 1 or len(values) % columns or len(values) < columns * rows:
        raise CallError(TABLE_SIZE, f"{len(values)} numbers are not {rows} or more rows of {columns}")
    return _bounded(np.array(values, np.float64)).reshape(-1, columns)


def _bounded(values: curves.Table) -> curves.Table:
    if len(values) and np.abs(values).max() > FARTHEST:
        raise CallError(WRONG_TYPE, f"a number is beyond {FARTHEST:g}")
    return values


def _types(caller: "Caller", given: Any, columns: int) -> list[int]:
    types = [0] * columns if not given else [integer(caller, each) for each in given]
    fours = 0
    for each in types:
        if each not in (0, 1, 2) or (each != 2 and fours % 4):
            raise CallError(WRONG_TYPE, "types are 0 (a number), 1 (an angle) or four times 2 (a quaternion)")
        fours += each == 2
    if fours % 4 or len(types) != columns:
        raise CallError(TABLE_SIZE, f"types must be one a column, {columns}")
    return types


def _method(caller: "Caller", given: dict[str, Any]) -> tuple[float, bool | None]:
    """Returns the strength of the rounding and whether the path is open whatever its ends."""
    kind = given.get("type", "linear")
    if kind not in ("linear", "quadraticBezier"):
        raise CallError(WRONG_TYPE, "method.type is 'linear' or 'quadraticBezier'")
    strength = number(caller, given.get("strength", 1.0))
    if not 0.0 <= strength <= 1.0:
        raise CallError(WRONG_TYPE, f"method.strength is {strength:g}; it must be 0 to 1")
    forced = bool(given.get("forceOpen", False))
    return (max(strength, curves.MIN_STRENGTH) if kind == "quadraticBezier" else 0.0), forced


def _lengths(values: list[float], rows: int) -> curves.Table:
    lengths = _bounded(np.array(values, np.float64))
    if len(lengths) != rows:
        raise CallError(TABLE_SIZE, f"{len(lengths)} lengths for {rows} rows")
    if len(lengths) and (np.diff(lengths) < 0.0).any():
        raise CallError(WRONG_TYPE, "the lengths must ascend")
    return lengths


def _at(
    caller: "Caller",
    values: list[float],
    lengths: list[float],
    at: curves.Table,
    method: dict[str, Any],
    types: list[Any] | None,
) -> curves.Table:
    if not lengths or len(values) % len(lengths):
        raise CallError(TABLE_SIZE, f"{len(values)} numbers are not a row for each of {len(lengths)} lengths")
    columns = len(values) // len(lengths)
    rows = table(values, columns, 2)
    strength, forced = _method(caller, method)
    closed = not forced and bool((np.abs(rows[0] - rows[-1]) < 1e-9).all()) and len(rows) > 2
    return curves.interpolated(rows, _lengths(lengths, len(rows)), at, _types(caller, types, columns), strength, closed)


def array_of_types(caller: "Caller", value: Any) -> list[Any]:
    """Returns an array of column types."""
    if not isinstance(value, list) or len(value) > 64:
        raise Wrong(f"it must be an array of at most 64, got {shown(value)}")
    return value


@offered(numbers, numbers, number, Optional(options, {}), Optional(array_of_types))
def get_path_interpolated_config(
    caller: "Caller",
    path: list[float],
    lengths: list[float],
    t: float,
    method: dict[str, Any],
    types: list[Any] | None,
) -> list[float]:
    """Returns the row of a path at a length of the way."""
    row: list[float] = _at(caller, path, lengths, np.array([t]), method, types)[0].tolist()
    return row


@offered(numbers, numbers, integer, Optional(options, {}), Optional(array_of_types))
def resample_path(
    caller: "Caller",
    path: list[float],
    lengths: list[float],
    count: int,
    method: dict[str, Any],
    types: list[Any] | None,
) -> list[float]:
    """Returns a path of `count` rows spaced evenly along another."""
    if not 2 <= count <= MAX_ROWS or count * len(path) > MAX_ITEMS * max(len(lengths), 1):
        raise CallError(WRONG_TYPE, f"the number of rows must be 2 to {MAX_ROWS:,}, and fit in a reply; got {count}")
    at = np.linspace(0.0, lengths[-1] if lengths else 0.0, count)
    rows: list[float] = _at(caller, path, lengths, at, method, types).ravel().tolist()
    return rows


@offered(numbers, integer, Optional(anything))
def get_path_lengths(caller: "Caller", path: list[float], columns: int, callback: Any) -> tuple[list[float], float]:
    """Returns the length of the way to each row of a path, and that of the whole."""
    if callback is not None:
        raise CallError("not offered by wayfield's server: distances by a function of the client's")
    lengths = curves.lengths_of(table(path, columns))
    return lengths.tolist(), float(lengths[-1])


@offered(numbers, numbers, position)
def get_closest_pos_on_path(caller: "Caller", path: list[float], lengths: list[float], point: list[float]) -> float:
    """Returns the length of the way to the point of a path (x, y, z a row) that is nearest to a point."""
    rows = table(path, 3, 2)
    return curves.nearest_length(rows, _lengths(lengths, len(rows)), point)


@offered(numbers, numbers, Optional(numbers), Optional(array_of_types))
def get_config_distance(
    caller: "Caller", a: list[float], b: list[float], metric: list[float] | None, types: list[Any] | None
) -> float:
    """Returns the distance of two rows of numbers."""
    if len(a) != len(b) or not a:
        raise CallError(TABLE_SIZE, f"the rows have {len(a)} and {len(b)} numbers")
    weights = metric or [1.0] * len(a)
    if len(weights) != len(a):
        raise CallError(TABLE_SIZE, f"metric must have {len(a)} numbers, got {len(weights)}")
    rows = table([*a, *b, *weights], len(a), 3)
    return curves.config_distance(rows[0], rows[1], rows[2].tolist(), _types(caller, types, len(a)))


# Packed tables: the clients that wait pack by themselves, those of asyncio ask the server.

_PACKED = {"UInt8": "B", "UInt16": "H", "UInt32": "I", "Int32": "i", "Float": "f", "Double": "d"}


def _little(values: "array.array[Any]") -> "array.array[Any]":
    if sys.byteorder == "big":
        values.byteswap()
    return values


def _packer(code: str) -> Any:
    def pack(caller: "Caller", values: list[float], start: int, count: int) -> bytes:
        """Returns numbers as bytes."""
        chosen = values[max(start, 0) : max(start, 0) + count] if count > 0 else values[max(start, 0) :]
        try:
            packed = array.array(code, chosen if code in "fd" else [integer(caller, each) for each in chosen])
        except (OverflowError, ValueError) as error:
            raise CallError(WRONG_TYPE, str(error)) from None
        return _little(packed).tobytes()

    return pack


def _unpacker(code: str) -> Any:
    def unpack(caller: "Caller", data: bytes, start: int, count: int, offset: int) -> list[Any]:
        """Returns the numbers in bytes."""
        packed = array.array(code)
        size = packed.itemsize
        first = max(start, 0) * size + max(offset, 0)
        chosen = data[first : first + count * size] if count > 0 else data[first:]
        if len(chosen) % size or len(chosen) // size > MAX_ITEMS:
            raise CallError(TABLE_SIZE, f"{len(chosen)} bytes are not {MAX_ITEMS:,} or fewer numbers of {size}")
        packed.frombytes(chosen)
        return _little(packed).tolist()

    return unpack


for _kind, _code in _PACKED.items():
    offered(numbers, Optional(integer, 0), Optional(integer, 0), name=f"pack{_kind}Table")(_packer(_code))
    offered(blob, Optional(integer, 0), Optional(integer, 0), Optional(integer, 0), name=f"unpack{_kind}Table")(
        _unpacker(_code)
    )
