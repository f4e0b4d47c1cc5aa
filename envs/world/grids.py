"""Occupancy grids: a world as a picture, for rays, for clearances, and for the end of an episode by contact.

What stands is the union of the occupied cells, as squares. Rays end on their sides, by the traversal of Amanatides and
Woo, and the clearance is the distance to them, both exact but for rounding: a cell holds how far one may go from it
without looking, and how far the nearest occupied cell of its column is.
"""

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
        window: NDArray[np.bool_] = self._rooms[low + 1 : high + 1, left + 1 : right + 1] == 0
        return window

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
        clearances: NDArray[np.float64] = _clearances(
            grids.frames, grids.cells, np.ascontiguousarray(points, np.float64)
        )
        return clearances

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
        occupied: NDArray[np.bool_] = np.where(inside, self._rooms[at] == 0, self.beyond == "occupied")
        return occupied


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
                distance = min(behind[j], _MOST)
                away[i, j] = min(distance, np.int64(away[i, j])) if way else distance
            for block in range(nearest.shape[1]):
                least: Any = nothing
                if way:
                    least = np.int64(nearest[i, block, 0]) | np.int64(nearest[i, block, 1]) << 8
                for j in range(block * _BLOCK, min((block + 1) * _BLOCK, columns)):
                    least = min(least, behind[j])
                nearest[i, block, 0] = least & 255
                nearest[i, block, 1] = least >> 8


def same_bits(of, given):
    """Returns the compiled function that returns the number of one of Numba's types with the bits of one of another."""

    def number_of(typingctx, number):
        def code(context, builder, signature, arguments):
            return builder.bitcast(arguments[0], context.get_value_type(of))

        return of(given), code

    return intrinsic(number_of)


long_number = same_bits(types.float64, types.int64)
long_whole = same_bits(types.int64, types.float64)


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


@inlined
def seen_from(frame, pose):
    """Returns a pose in a scenario's grid: the place, in cells, and the cosine and the sine of the heading."""
    x, y, heading = pose
    u, v = grid_place(frame, x, y)
    s, c = sin_cos(heading)
    return u, v, c * frame.grid_cos + s * frame.grid_sin, s * frame.grid_cos - c * frame.grid_sin


@inlined
def look_along(frame, cells, place, way, ranges, i, k):
    """Shortens ranges[i, k] (m) to the distance from a place along a unit vector, by `grid_ray`."""
    u, v = place
    du, dv = way
    reach = ranges[i, k] / frame.grid_cell
    distance = grid_ray(frame, cells, u, v, du, dv, reach)
    if distance < reach:
        ranges[i, k] = distance * frame.grid_cell


@allocating
def _clearances(frames, cells, points):
    clearances = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        clearances[k] = grid_clearance(frames[0], cells, points[k, 0], points[k, 1])
    return clearances


@allocating
def _rays(frames, cells, points, headings, lengths):
    for k in range(points.shape[0]):
        u, v, du, dv = seen_from(frames[0], (points[k, 0], points[k, 1], headings[k]))
        if abs(du) < 2.0 and abs(dv) < 2.0:  # what is no number meets nothing
            look_along(frames[0], cells, (u, v), (du, dv), lengths.reshape(-1, 1), k, 0)
