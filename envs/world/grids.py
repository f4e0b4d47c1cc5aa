"""Occupancy grids: a world as a picture, for rays, for clearances, and for the end of an episode by contact.

What stands is the union of the occupied cells, as squares. Rays end on their sides, by the traversal of Amanatides and
Woo, and the clearance is the distance to them, both exact but for rounding: a cell holds how far one may go from it
without looking, and how far the nearest occupied cell of its column is.
"""

import collections
import dataclasses
import functools
import hashlib
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from wayfield.envs.world.blocks import blocks_clearance
from wayfield.envs.world.geometry import row_clearance
from wayfield.system.checks import FARTHEST, choose, number, pose, shown
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import sin_cos

MOST_SIDE = 16_383  # cells
MOST_CELLS = 2**26  # 8,192 x 8,192
LEAST_CELL = 1e-3  # m
BEYOND = ("occupied", "free")

# A cell in nine bytes, in nine planes one behind the other. Eight hold its rooms, one for each octant that a ray may go
# on in: up or down the rows and the columns, and along the rows or the columns, whichever it is nearer to. 0 where it
# is occupied, else the most n, up to 255, for which all is free that such a ray may pass within n x n cells from it on:
# so far along as a of them, it is at most a + 1 aside. They have a rim, one cell wide, of zeros: a ray that leaves the
# grid ends there. The last plane tells how many rows away the nearest occupied cell of its column is, up or down, at
# most 255.
_OCTANTS = 8
_MOST = 255
# and of each row so many columns at a time, in two bytes, how many rows away the nearest of them is
_BLOCK = 16

# So many beams go on side by side, by the same arithmetic without a branch: that a processor does for several at once.
# No power of two, so that their numbers do not all want the same place in its cache.
TOGETHER = 1008
BESIDE = 8  # of those, so many at once; a divisor
# the numbers of a beam on its way, in rows of TOGETHER; those from `last` on are the bits of whole ones
_BEAM = collections.namedtuple("_BEAM", "slope start sure last room along aside step_along step_aside here")
_AT = _BEAM(*(np.uint64(TOGETHER * row) for row in range(len(_BEAM._fields))))
SCRATCH = TOGETHER * len(_BEAM._fields)  # numbers that `scan_grid` needs room for

# for BESIDE beams each: which of them have not all ended; whose they are; and where his grid begins
_GOING = TOGETHER // BESIDE
_HELD = _GOING
_FIRST = 2 * _GOING
WORDS = 3 * _GOING

# instead of a beam's `along`: it left a grid beyond which all is free; single precision cannot tell where it goes on
_OUT = np.int32(-1)
_UNSURE = np.int32(-2)
_ROUNDING = np.float32(2.0**-24)  # relative, of single precision
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)

# Where a scenario's grid lies: what a record of the bank has besides.
FRAME = [
    ("grid_x", np.float64),  # m, the corner of the first cell, world frame
    ("grid_y", np.float64),
    ("grid_cos", np.float64),  # of the direction of the rows
    ("grid_sin", np.float64),
    ("grid_cell", np.float64),  # m, a side of a cell; 0: the scenario has no grid
    ("grid_rows", np.int64),
    ("grid_columns", np.int64),
    ("grid_first", np.int64),  # where its bytes begin
    ("grid_closed", np.int64),  # 1: what lies beyond it is occupied
]


class Grids(NamedTuple):
    """The grids of a bank, as compiled functions read them."""

    frames: NDArray[np.void]  # (scenarios,) records with the fields of FRAME
    cells: NDArray[np.uint8]  # of all grids, one behind the other, each plane row by row; none in a bank without


NO_GRIDS = Grids(np.zeros(1, np.dtype(FRAME, align=True)), np.zeros(0, np.uint8))


# Compared by identity, like the scenarios that share it.
@dataclasses.dataclass(frozen=True, eq=False, init=False)
class OccupancyGrid:
    """A world of square cells, each occupied or free.

    Takes nine bytes a cell, however many robots and scenarios share it.

    Raises:
        ValueError: if a value is out of its range or the array is none of such a shape; the message names the field.
    """

    shape: tuple[int, int]  # rows and columns
    cells: NDArray[np.uint8] = dataclasses.field(repr=False)  # as the compiled functions read them
    resolution: float  # m, a side of a cell
    origin: tuple[float, float, float]  # pose of the grid's corner: x, y (m), yaw (rad)
    beyond: str  # what lies beyond the grid, "occupied" or "free"
    name: str  # of the file, for messages

    def __init__(
        self,
        occupied: NDArray[np.bool_],
        resolution: float,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        beyond: str = "occupied",
        name: str = "",
    ) -> None:
        """Takes an array (rows, columns), of which nothing is kept; row 0 is the lowest: rows go along y."""
        if not isinstance(occupied, np.ndarray) or occupied.ndim != 2 or occupied.dtype != np.bool_:
            raise ValueError(f"occupied is {shown(occupied)}; it must be a bool array (rows, columns)")
        rows, columns = occupied.shape
        check_size("occupied", rows, columns)
        frozen = functools.partial(object.__setattr__, self)
        frozen("shape", (rows, columns))
        frozen("resolution", number("resolution", resolution, least=LEAST_CELL, most=FARTHEST))
        frozen("origin", pose("origin", origin))
        choose("beyond", beyond, BEYOND)
        frozen("beyond", beyond)
        frozen("name", name)
        for x, y in self.corners.tolist():
            if max(abs(x), abs(y)) > FARTHEST:
                raise ValueError(
                    f"resolution is {self.resolution:g} and origin {self.origin}; with {columns} x {rows} cells the "
                    f"grid must lie within {FARTHEST:g} m of the world's origin"
                )
        frozen("cells", _measured(occupied))

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Returns which cells (rows, columns) are occupied, read again from the grid at each call."""
        return self._window(0, self.shape[0], 0, self.shape[1])

    def _window(self, low: int, high: int, left: int, right: int) -> NDArray[np.bool_]:
        """Returns which cells are occupied of the rows and columns from the first to the last, that one without."""
        found: NDArray[np.bool_] = self._rooms[low + 1 : high + 1, left + 1 : right + 1] == 0
        return found

    @property
    def _rooms(self) -> NDArray[np.uint8]:
        """Returns the first plane of rooms with its rim."""
        rows, columns = self.shape
        return self.cells[: (rows + 2) * (columns + 2)].reshape(rows + 2, columns + 2)

    def __deepcopy__(self, memo: dict[int, Any]) -> "OccupancyGrid":
        """Returns the grid itself: it never changes, and is large."""
        del memo
        return self

    def decisive(self) -> list[Any]:
        """Returns all that distinguishes this grid, as `GoalScenario.decisive` does: of the cells a SHA-256."""
        cells = np.frombuffer(hashlib.sha256(np.packbits(self.occupied).tobytes()).digest(), np.uint16)
        return [self.shape, cells, self.resolution, self.origin, self.beyond == "occupied"]

    @property
    def corners(self) -> NDArray[np.float64]:
        """Returns the corners (4, 2) of the grid, m, world frame."""
        rows, columns = self.shape
        return self.points(np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], float))

    def points(self, at: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the points (..., 2), m, world frame, of places (..., 2) in cells along the rows and the columns."""
        x, y, yaw = self.origin
        s, c = sin_cos(yaw)
        u, v = self.resolution * at[..., 0], self.resolution * at[..., 1]
        return np.stack([x + c * u - s * v, y + s * u + c * v], axis=-1)

    def places(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the places (..., 2) in cells of points (..., 2), m, world frame: the inverse of `points`."""
        x, y, yaw = self.origin
        s, c = sin_cos(yaw)
        dx, dy = points[..., 0] - x, points[..., 1] - y
        return np.stack([c * dx + s * dy, c * dy - s * dx], axis=-1) / self.resolution

    def edges_within(self, low: tuple[float, float], high: tuple[float, float]) -> list[tuple[int, int]]:
        """Returns row and column of the occupied cells with a free side that touch a box between two points, m.

        Where what lies beyond the grid is occupied, cells beyond it too.
        """
        corners = self.places(np.array([low, (high[0], low[1]), high, (low[0], high[1])]))
        (j0, i0), (j1, i1) = np.floor(corners.min(axis=0)).astype(int), np.floor(corners.max(axis=0)).astype(int) + 1
        rows, columns = self.shape
        beyond = self.beyond == "occupied"
        # one more on every side, for the neighbours
        around = np.full((i1 - i0 + 2, j1 - j0 + 2), beyond)
        a, b, c, d = max(i0 - 1, 0), min(i1 + 1, rows), max(j0 - 1, 0), min(j1 + 1, columns)
        if a < b and c < d:
            around[a - i0 + 1 : b - i0 + 1, c - j0 + 1 : d - j0 + 1] = self._window(a, b, c, d)
        inner = around[1:-1, 1:-1]
        buried = around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:]
        return [(i + i0, j + j0) for i, j in np.argwhere(inner & ~buried).tolist()]

    def outline(self) -> NDArray[np.float64]:
        """Returns the straight sides (k, 2, 2) between what is occupied and what is free, m, world frame."""
        around = np.pad(self.occupied, 1, constant_values=self.beyond == "occupied")
        parts = []
        for sides, swap in (
            (around[1:, 1:-1] != around[:-1, 1:-1], False),
            (around[1:-1, 1:] != around[1:-1, :-1], True),
        ):
            # sides in a line are one
            lines = np.pad(sides.T if swap else sides, ((0, 0), (1, 1))).astype(np.int8)
            line, begin = np.nonzero(np.diff(lines, axis=1) == 1)
            _, end = np.nonzero(np.diff(lines, axis=1) == -1)
            ends = np.stack([np.stack([begin, line], axis=-1), np.stack([end, line], axis=-1)], axis=1)
            parts.append(self.points((ends[..., ::-1] if swap else ends).astype(np.float64)))
        return np.concatenate(parts)

    def clearances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the distance (n,) in m from points (n, 2) to what is occupied; 0 within, inf where nothing is."""
        grids = lay_grids([self], np.zeros(1, NO_GRIDS.frames.dtype))
        found: NDArray[np.float64] = _clearances(grids.frames, grids.cells, np.ascontiguousarray(points, np.float64))
        return found

    def rays(self, points: NDArray[np.float64], headings: NDArray[np.float64], max_range: float) -> NDArray[np.float64]:
        """Returns the distance (n,) in m along rays from points (n, 2) at headings (n,) rad, at most max_range."""
        grids = lay_grids([self], np.zeros(1, NO_GRIDS.frames.dtype))
        lengths = np.full(len(points), float(max_range))
        starts, ways = np.ascontiguousarray(points, np.float64), np.ascontiguousarray(headings, np.float64)
        _rays(grids.frames, grids.cells, starts, ways, lengths)
        return lengths

    def is_occupied(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns whether points (..., 2), m, world frame, lie in what is occupied."""
        columns, rows = np.moveaxis(np.floor(self.places(points)), -1, 0)
        inside = (rows >= 0) & (rows < self.shape[0]) & (columns >= 0) & (columns < self.shape[1])
        at = np.where(inside, rows + 1, 0).astype(np.int64), np.where(inside, columns + 1, 0).astype(np.int64)
        found: NDArray[np.bool_] = np.where(inside, self._rooms[at] == 0, self.beyond == "occupied")
        return found


def check_size(field: str, rows: int, columns: int) -> None:
    """Raises ValueError, naming the field, unless there are cells and no more than fit."""
    if rows < 1 or columns < 1:
        raise ValueError(f"{field} has {columns} x {rows} cells; there must be at least one")
    if max(rows, columns) > MOST_SIDE or rows * columns > MOST_CELLS:
        raise ValueError(
            f"{field} has {columns} x {rows} cells; there must be at most {MOST_SIDE:,} on a side and {MOST_CELLS:,} "
            "in all"
        )


def lay_grids(grids: Sequence[OccupancyGrid | None], frames: NDArray[np.void]) -> Grids:
    """Returns the grids of a bank's scenarios, each grid once.

    Args:
        frames: (scenarios,) records, whose fields of FRAME are filled.
    """
    first: dict[OccupancyGrid, int] = {}
    count = 0
    for frame, grid in zip(frames, grids, strict=True):
        if grid is None:
            continue
        if grid not in first:
            first[grid] = count
            count += grid.cells.size
        x, y, yaw = grid.origin
        frame["grid_x"], frame["grid_y"] = x, y
        frame["grid_sin"], frame["grid_cos"] = sin_cos(yaw)
        frame["grid_cell"] = grid.resolution
        frame["grid_rows"], frame["grid_columns"] = grid.shape
        frame["grid_first"] = first[grid]
        frame["grid_closed"] = grid.beyond == "occupied"
    if len(first) <= 1:  # nothing is copied
        return Grids(frames, next(iter(first)).cells if first else NO_GRIDS.cells)
    cells = np.concatenate([grid.cells for grid in first])
    for grid, begin in first.items():
        # a part of what the bank has, not another copy
        object.__setattr__(grid, "cells", cells[begin : begin + grid.cells.size])
    return Grids(frames, cells)


def frames_of(grids: Grids, scenarios: NDArray[np.int64]) -> Grids:
    """Returns the grids with a frame for each of some robots, those of their scenarios (b,), and nothing else in it."""
    frames = np.zeros(len(scenarios), NO_GRIDS.frames.dtype)
    for name in frames.dtype.names or ():
        frames[name] = grids.frames[name][scenarios]
    return Grids(frames, grids.cells)


def _measured(occupied: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Returns the planes of a grid, one behind the other."""
    rows, columns = occupied.shape
    blocks = -(-columns // _BLOCK)
    rooms = _OCTANTS * (rows + 2) * (columns + 2)
    cells = np.zeros(rooms + rows * columns + 2 * rows * blocks, np.uint8)
    planes, away, nearest = np.split(cells, [rooms, rooms + rows * columns])
    _measure_rooms(occupied, planes.reshape(_OCTANTS, rows + 2, columns + 2))
    _measure_columns(occupied, away.reshape(rows, columns), nearest.reshape(rows, blocks, 2))
    return cells


@compiled
def _measure_rooms(occupied, planes):
    """Fills planes (8, rows + 2, columns + 2) of rooms: one more than the least of the two cells that come next.

    Those are the next along and the next along and aside. A ray may come to the next aside before: where that is
    occupied, the room is 1.
    """
    rows, columns = occupied.shape
    for octant in range(_OCTANTS):
        step_column = -1 if octant & 1 else 1
        step_row = -1 if octant & 2 else 1
        along_row = step_row if octant & 4 else 0
        along_column = 0 if octant & 4 else step_column
        aside_row = step_row - along_row
        aside_column = step_column - along_column
        for a in range(rows):
            i = a + 1 if step_row < 0 else rows - a
            for b in range(columns):
                j = b + 1 if step_column < 0 else columns - b
                if occupied[i - 1, j - 1]:
                    continue
                room: Any = 0
                # the rim is 0: nothing is known to be free beyond the grid
                if planes[octant, i + aside_row, j + aside_column] > 0:
                    room = min(
                        np.int64(planes[octant, i + along_row, j + along_column]),
                        np.int64(planes[octant, i + step_row, j + step_column]),
                    )
                planes[octant, i, j] = min(room + 1, _MOST)


@allocating
def _measure_columns(occupied, away, nearest):
    """Fills how many rows away the nearest occupied cell of a column is, and the nearest of each block of columns."""
    rows, columns = occupied.shape
    nothing = MOST_SIDE + 1
    for way in range(2):
        # how far behind the last occupied cell of each column is
        behind = np.full(columns, nothing)
        for a in range(rows):
            i = rows - 1 - a if way else a
            for j in range(columns):
                behind[j] = 0 if occupied[i, j] else min(behind[j] + 1, nothing)
                found = min(behind[j], _MOST)
                away[i, j] = min(found, np.int64(away[i, j])) if way else found
            for block in range(nearest.shape[1]):
                least: Any = nothing
                if way:
                    least = np.int64(nearest[i, block, 0]) | np.int64(nearest[i, block, 1]) << 8
                for j in range(block * _BLOCK, min((block + 1) * _BLOCK, columns)):
                    least = min(least, behind[j])
                nearest[i, block, 0] = least & 255
                nearest[i, block, 1] = least >> 8


def _same_bits(of, given):
    """Returns the compiled function that returns the number of one of Numba's types with the bits of one of another."""

    def same_bits(typingctx, number):
        def code(context, builder, signature, arguments):
            return builder.bitcast(arguments[0], context.get_value_type(of))

        return of(given), code

    return intrinsic(same_bits)


# Of single precision all is kept in one array: of two a compiler would not know that they never overlap, and would do
# nothing for several beams at once.
bits = _same_bits(types.float32, types.int32)
whole = _same_bits(types.int32, types.float32)
long_number = _same_bits(types.float64, types.int64)
long_whole = _same_bits(types.int64, types.float64)


@inlined
def grid_place(frame, x, y):
    """Returns the place of a point, in cells along the rows and along the columns of a scenario's grid."""
    dx = x - frame.grid_x
    dy = y - frame.grid_y
    u = (frame.grid_cos * dx + frame.grid_sin * dy) / frame.grid_cell
    v = (frame.grid_cos * dy - frame.grid_sin * dx) / frame.grid_cell
    return u, v


@inlined
def first_column(frame):
    """Returns where the plane of columns begins: behind those of the rooms."""
    return frame.grid_first + _OCTANTS * (frame.grid_rows + 2) * (frame.grid_columns + 2)


@inlined
def least_in_block(cells, around, block, u, v, best):
    """Returns the least of `best` and of the squared distances from (u, v) to what a block's columns have near by."""
    start, _, rows, columns, row = around
    # on a side where a column's nearest occupied cell is, the next row is nearer to it
    upper = start + columns if row + 1 < rows else start
    lower = start - columns if row > 0 else start
    height = v - row
    here = max(-height, height - 1.0, 0.0)
    first = block * _BLOCK
    # numbers that are not below 0 are in the order of their bits, whose least a processor finds for several at once
    least = long_whole(best)
    for k in range(np.uint64(min(_BLOCK, columns - first))):
        away = cells[np.uint64(start + first) + k]
        j = np.float64(np.int32(first + np.int64(k)))
        before = j - u
        after = u - j - 1.0
        aside = before if before > after else after
        aside = aside if aside > 0.0 else 0.0
        up = away - height if cells[np.uint64(upper + first) + k] < away else np.inf
        down = away + (height - 1.0) if cells[np.uint64(lower + first) + k] < away else np.inf
        rise = up if up < down else down
        rise = rise if away > 0 else here
        squared = long_whole(aside * aside + rise * rise)
        least = squared if squared < least else least
    return long_number(least)


@compiled
def far_rise(cells, place, columns, rows, row, v):
    """Returns how far, in cells, from height v in a row a column's nearest occupied cell is, where it is _MOST away."""
    up = rows_on(cells, place, columns, rows - 1 - row)
    down = rows_on(cells, place, -columns, row)
    rise = np.inf
    if up >= 0:
        rise = row + up - v
    if down >= 0:
        rise = min(rise, v - (row - down) - 1.0)
    return rise


@inlined
def rows_on(cells, place, step, most):
    """Returns how many rows on, of at most `most`, the next occupied cell of a column is; -1 where there is none.

    Args:
        place: of a cell with nothing nearer than _MOST rows either way.
        step: from a row to the next, on the way looked at.
    """
    gone = np.int64(0)
    while gone + _MOST <= most:
        gone += _MOST
        away = np.int64(cells[np.uint64(place + gone * step)])
        if away < _MOST:
            return gone + away
    return np.int64(-1)


@inlined
def least_far_in_block(cells, around, block, u, v, best):
    """Returns `least_in_block` of the columns in which the nearest occupied cell is too far away for a byte."""
    start, _, rows, columns, row = around
    for j in range(block * _BLOCK, min((block + 1) * _BLOCK, columns)):
        aside = max(j - u, u - j - 1.0, 0.0)
        if cells[np.uint64(start + j)] == _MOST and aside * aside < best:
            rise = far_rise(cells, start + j, columns, rows, row, v)
            best = min(best, aside * aside + rise * rise)
    return best


@inlined
def least_around(cells, around, u, v, best, far):
    """Returns the least of `best` and of the squared distances from (u, v) to what the columns tell, outwards.

    Args:
        around: where the row's cells and its blocks begin, the grid's rows and columns, and the row.
        far: whether to look for what is too far away for a byte, too.
    """
    _, nearest, _, columns, _ = around
    blocks = (columns + _BLOCK - 1) // _BLOCK
    own = int(min(max(0.0, math.floor(u)), columns - 1.0)) // _BLOCK
    passed = 0
    # the own one, the next on the right, the next on the left, and so on, until nothing on either side is near enough
    for k in range(2 * blocks):
        block = own + (k + 1) // 2 if k % 2 == 1 else own - k // 2
        aside = max(block * _BLOCK - u, u - (block + 1) * _BLOCK, 0.0)
        passed += 1
        if 0 <= block < blocks and aside * aside < best:
            passed = 0
            # nothing of a block is nearer than its nearest row, by which it is passed over as a whole
            if aside * aside + block_rise(cells, nearest + 2 * block) < best:
                best = least_in_block(cells, around, block, u, v, best)
                if far:
                    best = least_far_in_block(cells, around, block, u, v, best)
        elif passed == 2:
            break
    return best


@inlined
def block_rise(cells, place):
    """Returns the least squared distance, in cells, up or down to what is occupied in the columns of a block."""
    away = np.int64(cells[np.uint64(place)]) | np.int64(cells[np.uint64(place + 1)]) << 8
    rise = max(away - 1.0, 0.0)
    return rise * rise if away <= MOST_SIDE else np.inf


@compiled
def least_far(cells, around, u, v, best):
    """Returns `least_around` with what is too far away for a byte."""
    return least_around(cells, around, u, v, best, True)


@compiled
def grid_clearance(frame, cells, x, y):
    """Returns the distance (m) from (x, y) to what is occupied in a scenario's grid: 0 within, inf where nothing is.

    Column after column, outwards, until the next is farther away than what was found: each tells its nearest occupied
    cell, and each block of columns the nearest of all. It is the minimum that Felzenszwalb and Huttenlocher (Theory of
    Computing 8, 2012) take for the centres of all cells at once, of this very point.
    """
    if frame.grid_cell == 0.0:
        return np.inf
    u, v = grid_place(frame, x, y)
    rows = frame.grid_rows
    columns = frame.grid_columns
    best = np.inf
    if frame.grid_closed == 1:
        # said so that a place that is no number is none within
        if not (0.0 <= u <= columns and 0.0 <= v <= rows):
            return 0.0
        side = min(u, columns - u, v, rows - v)
        best = side * side
    row = int(min(max(0.0, math.floor(v)), rows - 1.0))
    first = first_column(frame)
    blocks = (columns + _BLOCK - 1) // _BLOCK
    around = first + row * columns, first + rows * columns + 2 * row * blocks, rows, columns, row
    near = least_around(cells, around, u, v, min(best, 1.0 * _MOST * _MOST), False)
    # what is nearer than a byte tells has been found
    best = near if near < _MOST * _MOST else least_far(cells, around, u, v, best)
    return math.sqrt(best) * frame.grid_cell


@inlined
def rows_away(frame, cells, row, column):
    """Returns how many rows from a cell nothing of its column is nearer than: the nearest occupied one, or _MOST."""
    return np.int64(cells[np.uint64(first_column(frame) + row * frame.grid_columns + column)])


@compiled
def grid_normal(frame, cells, x, y):
    """Returns the unit vector away from what is occupied at (x, y), by central differences of the clearance."""
    h = 1e-4 * frame.grid_cell
    nx = grid_clearance(frame, cells, x + h, y) - grid_clearance(frame, cells, x - h, y)
    ny = grid_clearance(frame, cells, x, y + h) - grid_clearance(frame, cells, x, y - h)
    size = math.sqrt(nx * nx + ny * ny)
    return (nx / size, ny / size) if size > 0.0 else (0.0, 0.0)


@inlined
def clearance_around(robots, i, s, x, y):
    """Returns the signed distance (m) from (x, y) to the nearest thing around robot i, in its grid too; inf if none.

    Args:
        robots: `stepping.Robots`.
    """
    if s.num_blocks > 0:
        nearest = blocks_clearance(robots.obstacles, s.field, s.num_obstacles, s.num_blocks, x, y)
    else:
        nearest = row_clearance(robots.obstacles, s.field, s.num_obstacles, x, y)
    if robots.grids.cells.shape[0] > 0:
        nearest = min(nearest, grid_clearance(robots.grids.frames[s.scenario], robots.grids.cells, x, y))
    return nearest


@inlined
def ray_from(cells, area, gone, i, j, place, way, reach):
    """Returns how far a ray goes that has gone some way to the cell (i, j), at most reach, all in cells.

    The traversal of Amanatides and Woo (Eurographics 1987), from one square of cells to the next instead of from cell
    to cell: on the way to the side where the ray leaves the square there is nothing to meet. Where it enters an
    occupied cell depends on that side alone, so that no rounding adds up.

    Args:
        area: the grid's first byte, its rows and columns, and whether what lies beyond it is occupied.
        place: where the ray begins, along the rows and the columns.
        way: a unit vector.
    """
    first, rows, columns, closed = area
    u, v = place
    du, dv = way
    inverse_u = 1.0 / du if du != 0.0 else np.inf
    inverse_v = 1.0 / dv if dv != 0.0 else np.inf
    step_u = 1 if du >= 0.0 else -1
    step_v = 1 if dv >= 0.0 else -1
    # a square's far side, from the place: at its first cell plus the room, or at that less the room and one more
    far_u = -u if du >= 0.0 else 1.0 - u
    far_v = -v if dv >= 0.0 else 1.0 - v
    width = columns + 2
    octant = (0 if du >= 0.0 else 1) + (0 if dv >= 0.0 else 2) + (4 if abs(dv) > abs(du) else 0)
    plane = first + octant * (rows + 2) * width + width + 1
    while gone < reach:
        room = np.int64(cells[np.uint64(plane + i * width + j)])
        if room == 0:
            inside = 0 <= j < columns and 0 <= i < rows
            return gone if inside or closed == 1 else reach
        to_u = (j + step_u * room + far_u) * inverse_u
        to_v = (i + step_v * room + far_v) * inverse_v
        gone = min(to_u, to_v)
        if gone >= reach:
            return reach
        if to_u < to_v:
            j += step_u * room
            at = int(v + gone * dv)
            i = min(max(at, i), i + room - 1) if dv >= 0.0 else max(min(at, i), i - room + 1)
        else:
            i += step_v * room
            at = int(u + gone * du)
            j = min(max(at, j), j + room - 1) if du >= 0.0 else max(min(at, j), j - room + 1)
    return reach


@compiled
def entry(rows, columns, u, v, du, dv):
    """Returns (gone, row, column): how far away a ray from beyond the grid enters it, and where; inf if it does not."""
    to_u = 0.0
    to_v = 0.0
    if du != 0.0:
        to_u = (-u if du > 0.0 else columns - u) / du
    if dv != 0.0:
        to_v = (-v if dv > 0.0 else rows - v) / dv
    gone = max(to_u, to_v, 0.0)
    column = math.floor(u + gone * du)
    row = math.floor(v + gone * dv)
    # which side is entered is known, whatever rounding says
    if gone == to_u and du != 0.0:
        column = 0 if du > 0.0 else columns - 1
    if gone == to_v and dv != 0.0:
        row = 0 if dv > 0.0 else rows - 1
    if not (0 <= column < columns and 0 <= row < rows):
        return np.inf, 0, 0
    return gone, row, column


@compiled
def grid_ray(frame, cells, u, v, du, dv, reach):
    """Returns how far a ray goes from the place (u, v) along the unit vector (du, dv), at most reach, all in cells."""
    rows = frame.grid_rows
    columns = frame.grid_columns
    area = frame.grid_first, rows, columns, frame.grid_closed
    if 0.0 <= u < columns and 0.0 <= v < rows:
        return ray_from(cells, area, 0.0, int(v), int(u), (u, v), (du, dv), reach)
    if frame.grid_closed == 1:
        return 0.0
    gone, i, j = entry(rows, columns, u, v, du, dv)
    return ray_from(cells, area, gone, i, j, (u, v), (du, dv), reach)


@compiled
def scan_grid(frame, cells, pose, beams, ranges, i, column, scratch, words):
    """Shortens ranges[i, column:] (m) to the distance along each beam to what is occupied in a scenario's grid.

    `ray_from` for many beams at once, with the same bits: in turns those that have not ended leap, BESIDE at once. In
    which cell a beam ends is found in single precision, and how far that is, from the side that it enters by, in double
    precision. What passes the corner of a cell too near by for single precision to tell the side is left to `ray_from`.

    Args:
        pose: x, y (m), heading (rad).
        beams: (2, n) cosines and sines of the beams in the body frame.
        ranges: (b, n) array of any float type, as `sensing.scan_ranges` leaves it.
        scratch: (SCRATCH,) room for numbers of single precision.
        words: (WORDS,) room for whole ones.
    """
    seen = seen_from(frame, pose)
    for first in range(0, beams.shape[1], TOGETHER):
        part = first, min(beams.shape[1] - first, TOGETHER), 0
        if set_out(frame, cells, seen, beams, part, ranges, i, column, scratch, words):
            travel(cells, scratch, words, part[1])
            arrive(frame, cells, seen, beams, part, ranges, i, column, scratch)


@inlined
def seen_from(frame, pose):
    """Returns a pose in a scenario's grid: the place, in cells, and the cosine and the sine of the heading."""
    x, y, heading = pose
    u, v = grid_place(frame, x, y)
    s, c = sin_cos(heading)
    return u, v, c * frame.grid_cos + s * frame.grid_sin, s * frame.grid_cos - c * frame.grid_sin


@inlined
def way_of(beams, k, cosine, sine):
    """Returns the unit vector of beam k in a grid where the heading has that cosine and that sine."""
    # unsigned: a signed index is first asked whether it counts from the end
    ahead = beams[0, np.uint64(k)]
    aside = beams[1, np.uint64(k)]
    return cosine * ahead - sine * aside, sine * ahead + cosine * aside


@inlined
def set_out(frame, cells, seen, beams, part, ranges, i, column, scratch, words):
    """Writes where beams of a scan begin, for `travel`; returns False where there is nothing to travel for.

    From beyond the grid the beams are looked along at once, and there is nothing left.

    Args:
        seen: `seen_from`.
        part: the first beam meant, how many, and where those stand among what goes on together.
    """
    if frame.grid_cell == 0.0:
        return False
    first, count, at = part
    u, v, cosine, sine = seen
    if not (abs(cosine) < 2.0 and abs(sine) < 2.0):
        return False  # no number, or one that is no angle: such beams meet nothing
    if not (0.0 <= u < frame.grid_columns and 0.0 <= v < frame.grid_rows):
        for k in range(first, first + count):
            look_along(frame, cells, (u, v), way_of(beams, k, cosine, sine), ranges, i, np.uint64(column + k))
        return False
    aim(frame, cells, seen, beams, part, ranges, i, column, scratch)
    # beams that are none, up to a whole number of BESIDE, are where there is no room
    end = at + (count + BESIDE - 1) // BESIDE * BESIDE
    for k in range(np.uint64(at + count), np.uint64(end)):
        scratch[_AT.room + k] = bits(np.int32(0))
    for k in range(np.uint64(at // BESIDE), np.uint64(end // BESIDE)):
        words[np.uint64(_FIRST) + k] = frame.grid_first
    return True


@inlined
def look_along(frame, cells, place, way, ranges, i, k):
    """Shortens ranges[i, k] (m) to the distance from a place along a unit vector, by `grid_ray`."""
    u, v = place
    du, dv = way
    reach = ranges[i, k] / frame.grid_cell
    distance = grid_ray(frame, cells, u, v, du, dv, reach)
    if distance < reach:
        ranges[i, k] = distance * frame.grid_cell


@inlined
def aim(frame, cells, seen, beams, part, ranges, i, column, scratch):
    """Writes what `leap` reads of beams that begin within the grid.

    All as if each went up the rows and the columns, and counted from the cell where it begins, along the axis to which
    it is nearer: how far aside of that it is at `along` is start + along slope, with a slope of at most 1.

    Args:
        seen: `seen_from`.
        part: as in `set_out`.
    """
    first, count, at = part
    u, v, cosine, sine = seen
    j = math.floor(u)
    row = math.floor(v)
    width = np.int32(frame.grid_columns + 2)
    size = np.int32((frame.grid_rows + 2) * (frame.grid_columns + 2))
    begin = np.int32((np.int64(row) + 1) * (frame.grid_columns + 2) + np.int64(j) + 1)
    begin_back = np.int32(begin + size)
    begin_down = np.int32(begin + 2 * size)
    begin_back_down = np.int32(begin + 3 * size)
    steep = np.int32(4 * size)
    # all begin in one cell: of its rooms there are eight
    ahead_up = np.int32(cells[np.uint64(frame.grid_first + begin)])
    back_up = np.int32(cells[np.uint64(frame.grid_first + begin_back)])
    ahead_down = np.int32(cells[np.uint64(frame.grid_first + begin_down)])
    back_down = np.int32(cells[np.uint64(frame.grid_first + begin_back_down)])
    up_ahead = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin + steep))])
    up_back = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin_back + steep))])
    down_ahead = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin_down + steep))])
    down_back = np.int32(cells[np.uint64(frame.grid_first + np.int32(begin_back_down + steep))])
    across = np.float32(frame.grid_rows + frame.grid_columns)
    cells_per_metre = np.float32(1.0 / frame.grid_cell)
    part_u = np.float32(u - j)
    part_v = np.float32(v - row)
    # on its own, as double precision goes on half as many beams at once
    for k in range(count):
        du, dv = way_of(beams, first + k, cosine, sine)
        scratch[_AT.slope + np.uint64(at + k)] = du
        scratch[_AT.start + np.uint64(at + k)] = dv
    for k in range(count):
        place = np.uint64(at + k)
        du = scratch[_AT.slope + place]
        dv = scratch[_AT.start + place]
        left = du < _ZERO
        down = dv < _ZERO
        swap = abs(dv) > abs(du)
        reach = np.float32(ranges[i, np.uint64(column + first + k)]) * cells_per_metre
        reach = reach if reach < across else across
        along = abs(dv if swap else du)
        slope = abs(du if swap else dv) / along
        from_u = _ONE - part_u if left else part_u
        from_v = _ONE - part_v if down else part_v
        begun = from_v if swap else from_u
        scratch[_AT.slope + place] = slope
        scratch[_AT.start + place] = (from_u if swap else from_v) - begun * slope
        # by no less than three times what rounding may put a crossing off: five roundings of where it is, and eight of
        # a cell. What passes so near by a corner of what is free on its way ends the leap so near by one, too
        scratch[_AT.sure + place] = _HALF - _ROUNDING * (np.float32(15.0) * reach + np.float32(75.0))
        # where it goes no further, and rounding does not matter
        scratch[_AT.last + place] = bits(np.int32(begun + reach * along + np.float32(2.0)))
        room_up = back_up if left else ahead_up
        room_down = back_down if left else ahead_down
        room_flat = room_down if down else room_up
        steep_up = up_back if left else up_ahead
        steep_down = down_back if left else down_ahead
        room_steep = steep_down if down else steep_up
        scratch[_AT.room + place] = bits(room_steep if swap else room_flat)
        here_up = begin_back if left else begin
        here_down = begin_back_down if left else begin_down
        here = here_down if down else here_up
        scratch[_AT.here + place] = bits(np.int32(here + (steep if swap else np.int32(0))))
        step_u = np.int32(-1) if left else np.int32(1)
        step_v = np.int32(-width) if down else width
        scratch[_AT.step_along + place] = bits(step_v if swap else step_u)
        scratch[_AT.step_aside + place] = bits(step_u if swap else step_v)
        scratch[_AT.along + place] = bits(np.int32(0))
        scratch[_AT.aside + place] = bits(np.int32(0))


@inlined
def arrive(frame, cells, seen, beams, part, ranges, i, column, scratch):
    """Shortens the ranges of the beams of `set_out` that have met something.

    The cell in which a beam has ended is entered by that of its two sides which is met last: as far away as `ray_from`
    says, to the bit.

    Args:
        seen: `seen_from`.
        part: as in `set_out`.
    """
    first, count, at = part
    u, v, cosine, sine = seen
    if frame.grid_closed == 0:
        stop_inside(frame, u, v, scratch, at, count)
    j = np.int32(math.floor(u))
    row = np.int32(math.floor(v))
    back_j = np.int32(-j)
    back_row = np.int32(-row)
    least = np.int32(0)
    for k in range(count):
        du, dv = way_of(beams, first + k, cosine, sine)
        along = whole(scratch[_AT.along + np.uint64(at + k)])
        aside = whole(scratch[_AT.aside + np.uint64(at + k)])
        swap = abs(whole(scratch[_AT.step_along + np.uint64(at + k)])) > 1
        # whether it came from beside the cell: at the side before it, it was not yet at its height. Where it begins, it
        # came from nowhere else
        height = np.float32(along) * scratch[_AT.slope + np.uint64(at + k)] + scratch[_AT.start + np.uint64(at + k)]
        beside = (along == 0) | (aside > np.int32(height))
        by_u = beside == swap
        far = aside if beside else along
        far_u = back_j if du < 0.0 else j
        far_v = back_row if dv < 0.0 else row
        from_u = u - 1.0 if du < 0.0 else -u
        from_v = v - 1.0 if dv < 0.0 else -v
        side = np.float64(np.int32(far + (far_u if by_u else far_v))) + (from_u if by_u else from_v)
        gone = side * (1.0 / abs(du if by_u else dv))
        # where it begins, too, and where that makes it no number
        distance = (gone if gone > 0.0 else 0.0) * frame.grid_cell
        place = np.uint64(column + first + k)
        so_far = ranges[i, place]
        ranges[i, place] = distance if (distance < so_far) & (along >= 0) else so_far
        least = along if along < least else least
    if least == _UNSURE:
        look_closely(frame, cells, seen, beams, part, ranges, i, column, scratch)


@compiled
def look_closely(frame, cells, seen, beams, part, ranges, i, column, scratch):
    """Shortens the ranges of the beams that passed so near by a corner that single precision could not tell the side.

    Args:
        seen: `seen_from`.
        part: as in `set_out`.
    """
    first, count, at = part
    u, v, cosine, sine = seen
    for k in range(count):
        if whole(scratch[_AT.along + np.uint64(at + k)]) == _UNSURE:
            way = way_of(beams, first + k, cosine, sine)
            look_along(frame, cells, (u, v), way, ranges, i, np.uint64(column + first + k))


@inlined
def scan_grids(frames, cells, states, which, hull_radius, lidar, ranges, column):
    """Runs `scan_grid` for some robots, as many at once as go together.

    Where a robot's clearance tells that nothing of its grid is in reach, no beam is looked along.

    Args:
        frames, cells: Grids.
        states: records of the robots.
        which: indices of robots, empty for all in order; which robots not, empty for none; and of the indices the first
            that is meant, and the one behind the last.
        hull_radius: m, from where the clearance counts.
        lidar: sensing.Lidar.
    """
    count = lidar.beams.shape[1]
    if count == 0:
        return
    wide = (count + BESIDE - 1) // BESIDE * BESIDE
    held = 0
    rows, skip, first, last = which
    for j in range(first, last):
        i = rows[j] if rows.shape[0] > 0 else j
        if skip.shape[0] > 0 and skip[i]:
            continue
        s = states[i]
        frame = frames[s.scenario]
        if not s.clearance + hull_radius < lidar.max_range:
            continue
        pose = (s.x, s.y, s.heading)
        if wide > TOGETHER:
            scan_grid(frame, cells, pose, lidar.beams, ranges, i, column, lidar.ways, lidar.words)
            continue
        part = 0, count, held * wide
        seen = seen_from(frame, pose)
        if set_out(frame, cells, seen, lidar.beams, part, ranges, i, column, lidar.ways, lidar.words):
            lidar.words[np.uint64(_HELD + held)] = i
            for k in range(4):
                lidar.scratch[np.uint64(4 * held + k)] = seen[k]
            held += 1
        if (held + 1) * wide > TOGETHER:
            land(frames, cells, states, lidar, ranges, column, held)
            held = 0
    if held > 0:
        land(frames, cells, states, lidar, ranges, column, held)


@compiled
def land(frames, cells, states, lidar, ranges, column, held):
    """Brings the beams of the first robots that are held to their ends."""
    count = lidar.beams.shape[1]
    wide = (count + BESIDE - 1) // BESIDE * BESIDE
    travel(cells, lidar.ways, lidar.words, held * wide)
    for k in range(held):
        i = np.int64(lidar.words[np.uint64(_HELD + k)])
        at = np.uint64(4 * k)
        seen = lidar.scratch[at], lidar.scratch[at + 1], lidar.scratch[at + 2], lidar.scratch[at + 3]
        frame = frames[states[i].scenario]
        arrive(frame, cells, seen, lidar.beams, (0, count, k * wide), ranges, i, column, lidar.ways)


@inlined
def travel(cells, scratch, words, count):
    """Lets all beams leap until the last has ended; those beside each other that all have ended are passed over."""
    left = np.uint64((count + BESIDE - 1) // BESIDE)
    for k in range(left):
        words[k] = k
    while left > 0:
        # one after the other: what has just been written here and there cannot be read at once
        for k in range(left):
            leap(scratch, words[k] * np.uint64(BESIDE))
        going = np.uint64(0)
        for k in range(left):
            which = words[k]
            rooms = look(cells, scratch, which * np.uint64(BESIDE), words[np.uint64(_FIRST) + which])
            words[going] = which
            going += np.uint64(1) if rooms != 0 else np.uint64(0)
        left = going


@inlined
def look(cells, scratch, first, begin):
    """Writes the rooms of BESIDE beams where `leap` said, in the grid that begins there; returns 0 if all are 0."""
    rooms = np.uint64(0)
    for k in range(np.uint64(BESIDE)):
        room = np.uint64(cells[begin + np.uint64(whole(scratch[_AT.room + first + k]))])
        scratch[_AT.room + first + k] = bits(np.int32(room))
        rooms |= room
    return rooms


@inlined
def leap(scratch, first):
    """Lets BESIDE beams go on to where they leave the squares that they are in; one whose room is 0 stays.

    Instead of a beam's room, it writes where to look for the next: that takes the same place.

    A beam rises by no more than it goes along: at the far end of a square it is at most one row beyond it, and then it
    left through the last column.
    """
    for j in range(np.uint64(BESIDE)):
        k = first + j
        room = whole(scratch[_AT.room + k])
        along = np.int32(whole(scratch[_AT.along + k]) + room)
        aside = whole(scratch[_AT.aside + k])
        at = np.float32(along) * scratch[_AT.slope + k] + scratch[_AT.start + k]
        to_aside = np.int32(at)
        part = at - np.float32(to_aside)
        sure = abs(part - _HALF) < scratch[_AT.sure + k]
        moves = room != 0
        beyond = moves & (to_aside >= np.int32(aside + room))
        to_along = np.int32(along - (np.int32(1) if beyond else np.int32(0)))
        to_aside = to_aside if moves else aside
        place = whole(scratch[_AT.here + k])
        place += to_along * whole(scratch[_AT.step_along + k]) + to_aside * whole(scratch[_AT.step_aside + k])
        # where the first cell of the rim is, there is no room either
        goes = sure & (to_along < whole(scratch[_AT.last + k])) & moves
        scratch[_AT.room + k] = bits(np.int32(place) if goes else np.int32(0))
        scratch[_AT.along + k] = bits(_UNSURE if moves & (not sure) else to_along)
        scratch[_AT.aside + k] = bits(to_aside)


@inlined
def stop_inside(frame, u, v, scratch, at, count):
    """Marks the beams that have ended on the rim of a grid, beyond which all is free."""
    j = np.int64(math.floor(u))
    i = np.int64(math.floor(v))
    for k in range(np.uint64(at), np.uint64(at + count)):
        along = whole(scratch[_AT.along + k])
        aside = whole(scratch[_AT.aside + k])
        step_along = whole(scratch[_AT.step_along + k])
        step_aside = whole(scratch[_AT.step_aside + k])
        # a row is at least three places long, with its rim
        swap = abs(step_along) > 1
        at_u = aside * step_aside if swap else along * step_along
        at_v = along if swap else aside
        column = j + at_u
        row = i + (at_v if (step_along if swap else step_aside) > 0 else -at_v)
        # without a branch, as all here
        inside = (column >= 0) & (column < frame.grid_columns) & (row >= 0) & (row < frame.grid_rows)
        scratch[_AT.along + k] = bits(along if inside | (along == _UNSURE) else _OUT)


@allocating
def _clearances(frames, cells, points):
    found = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        found[k] = grid_clearance(frames[0], cells, points[k, 0], points[k, 1])
    return found


@allocating
def _rays(frames, cells, points, headings, lengths):
    ahead = np.array([[1.0], [0.0]])
    scratch = np.empty(SCRATCH, np.float32)
    words = np.empty(WORDS, np.uint64)
    for k in range(points.shape[0]):
        pose = (points[k, 0], points[k, 1], headings[k])
        scan_grid(frames[0], cells, pose, ahead, lengths.reshape(-1, 1), k, 0, scratch, words)
