"""Shortest ways on grids of eight neighbours: A* along the cells, Theta* at any angle.

The work is done on bytes: `levels[row, column]` is a level, and `prices[level]` what a metre of it costs, at least 1,
or inf where there is no way. A bool occupancy array is the smallest case; a planner keeps the nearness of obstacles in
the bytes and chooses its margins, or what a narrow place costs, by the prices alone.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wayfield.system.compiled import allocating, assign, compiled, inlined

UNSEEN = -1  # place of a cell that is not in the heap yet
CLOSED = -2  # place of a cell whose way is settled
_DIAGONAL = math.sqrt(2.0)
_OCCUPANCY_PRICES = np.array([1.0, np.inf])


class Way(NamedTuple):
    """A way over a grid."""

    cells: NDArray[np.int64]  # (n, 2) row, column, from start to goal; A* lists all, Theta* the turns; n = 0: none
    length: float  # between the centres of the cells, in sides of a cell; inf without a way


def a_star(blocked: ArrayLike, start: tuple[int, int], goal: tuple[int, int]) -> Way:
    """Returns a shortest way over free cells to the eight neighbours; a diagonal step needs both cells beside it free.

    A* with the octile distance, which never falls by more than a step costs (is consistent), so that each cell is
    settled once and the length is the optimum. Among equal estimates the cell farther on goes first, then the one of
    the lower row and column: the same grid gives the same way. No way, and a blocked start or goal, give no cells and
    an infinite length.

    Source: Hart, Nilsson and Raphael, IEEE T-SSC 4(2), 1968; corners as in Sturtevant's grid benchmarks, T-CIAIG 2012.

    Args:
        blocked: (rows, columns) bool.
        start, goal: row, column.

    Raises:
        ValueError: if blocked is no such array, or start or goal lie outside it.
    """
    levels, first, last = _checked(blocked, start, goal)
    scratch = Scratch.of(levels.size)
    if not search(levels, _OCCUPANCY_PRICES, first, last, False, scratch):
        return Way(np.empty((0, 2), np.int64), math.inf)
    cells = traced(scratch.parents, last, levels.shape[1])
    return Way(cells, octile_length(cells))


def theta_star(blocked: ArrayLike, start: tuple[int, int], goal: tuple[int, int]) -> Way:
    """Returns a short way at any angle, straight from turn to turn, never longer than that of `a_star`.

    Theta*: a cell's parent is its neighbour's parent wherever that is in line of sight (`sees`). It is greedy, not
    optimal, and in rare grids longer than the way along the cells. The way of A*, with every turn left out that line of
    sight allows, therefore stands beside it, and the shorter of the two is returned: never longer by construction.

    Source: Nash, Daniel, Koenig and Felner, AAAI 2007. Arguments and errors as in `a_star`.
    """
    levels, first, last = _checked(blocked, start, goal)
    return Way(*any_angle_way(levels, _OCCUPANCY_PRICES, first, last, Scratch.of(levels.size)))


def _checked(blocked: ArrayLike, start: tuple[int, int], goal: tuple[int, int]) -> tuple[NDArray[np.uint8], int, int]:
    """Returns the occupancy as bytes and the flat indices of start and goal."""
    grid = np.ascontiguousarray(blocked)
    if grid.ndim != 2 or grid.dtype != np.bool_ or grid.size == 0:
        raise ValueError(f"blocked must be a bool array (rows, columns), got {grid.dtype} of shape {grid.shape}")
    for name, (row, column) in (("start", start), ("goal", goal)):
        if not (0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]):
            raise ValueError(f"{name} {row, column} is outside the grid of {grid.shape[0]} x {grid.shape[1]} cells")
    columns = grid.shape[1]
    return grid.view(np.uint8), int(start[0] * columns + start[1]), int(goal[0] * columns + goal[1])


class Scratch(NamedTuple):
    """The arrays a search works in, one entry a cell."""

    costs: NDArray[np.float64]  # of the best way known from the start
    estimates: NDArray[np.float64]  # of a whole way through the cell
    parents: NDArray[np.int32]
    heap: NDArray[np.int32]  # open cells, the most promising first
    places: NDArray[np.int32]  # of the cells in the heap

    @classmethod
    def of(cls, size: int) -> "Scratch":
        """Returns scratch for grids of up to `size` cells."""
        return cls(np.empty(size), np.empty(size), *(np.empty(size, np.int32) for _ in range(3)))


@allocating
def scratch_for(size):
    """Returns what `Scratch.of` does, inside of a kernel."""
    return Scratch(
        np.empty(size),
        np.empty(size),
        np.empty(size, np.int32),
        np.empty(size, np.int32),
        np.empty(size, np.int32),
    )


@allocating
def any_angle_way(levels, prices, start, goal, scratch):
    """Returns (cells, length) of `theta_star` between flat indices; the cells are (0, 2) where there is no way."""
    columns = levels.shape[1]
    if not search(levels, prices, start, goal, False, scratch):
        return np.empty((0, 2), np.int64), np.inf
    cells = traced(scratch.parents, goal, columns)
    best = pulled(levels, prices, cells)
    # a string pulled tight is longer by rounding only, which is taken off
    shortest = min(straight_length(best), octile_length(cells))
    search(levels, prices, start, goal, True, scratch)
    cells = traced(scratch.parents, goal, columns)
    length = straight_length(cells)
    if length < shortest:
        best = cells
        shortest = length
    return best, shortest


@compiled
def octile_length(cells):
    """Returns the length of a way from neighbour to neighbour: straight steps and sqrt(2) diagonal ones, counted."""
    diagonal = 0
    for k in range(1, cells.shape[0]):
        if cells[k, 0] != cells[k - 1, 0] and cells[k, 1] != cells[k - 1, 1]:
            diagonal += 1
    return cells.shape[0] - 1 - diagonal + diagonal * _DIAGONAL


@compiled
def straight_length(cells):
    """Returns the length of the straight lines from cell to cell."""
    length = 0.0
    for k in range(1, cells.shape[0]):
        rows = float(cells[k, 0] - cells[k - 1, 0])
        columns = float(cells[k, 1] - cells[k - 1, 1])
        length += math.sqrt(rows * rows + columns * columns)
    return length


@compiled
def search(levels, prices, start, goal, any_angle, scratch):
    """Returns whether there is a way from start to goal (flat indices), and leaves it in `parents`.

    A step costs its length times the mean price of its two cells. With `any_angle` parents are whatever is in line of
    sight, lengths alone count, and the prices only tell free from blocked.
    """
    costs, estimates, parents, heap, places = scratch
    rows, columns = levels.shape
    if prices[levels[start // columns, start % columns]] == np.inf:
        return False
    goal_row = goal // columns
    goal_column = goal % columns
    if prices[levels[goal_row, goal_column]] == np.inf:
        return False
    costs[: rows * columns] = np.inf
    places[: rows * columns] = UNSEEN
    costs[start] = 0.0
    estimates[start] = 0.0
    parents[start] = start
    heap[0] = start
    places[start] = 0
    size = 1
    while size > 0:
        node = heap[0]
        if node == goal:
            return True
        size -= 1
        places[node] = CLOSED
        if size > 0:
            last = heap[size]
            heap[0] = last
            places[last] = 0
            sink(scratch, size)
        row = node // columns
        column = node - row * columns
        for dr in range(-1, 2):
            to_row = row + dr
            if to_row < 0 or to_row >= rows:
                continue
            for dc in range(-1, 2):
                to_column = column + dc
                if to_column < 0 or to_column >= columns:
                    continue
                neighbour = to_row * columns + to_column
                if places[neighbour] == CLOSED or is_cut(levels, prices, row, column, to_row, to_column):
                    continue
                if any_angle:
                    cost, origin = cost_in_sight(levels, prices, node, neighbour, scratch)
                else:
                    price = prices[levels[row, column]] + prices[levels[to_row, to_column]]
                    step = _DIAGONAL if dr != 0 and dc != 0 else 1.0
                    cost = costs[node] + step * 0.5 * price
                    origin = node
                if cost >= costs[neighbour]:
                    continue
                costs[neighbour] = cost
                parents[neighbour] = origin
                a = float(abs(goal_row - to_row))
                b = float(abs(goal_column - to_column))
                if any_angle:
                    estimates[neighbour] = cost + math.sqrt(a * a + b * b)
                else:
                    estimates[neighbour] = cost + max(a, b) + (_DIAGONAL - 1.0) * min(a, b)
                if places[neighbour] == UNSEEN:
                    heap[size] = neighbour
                    places[neighbour] = size
                    size += 1
                rise(scratch, places[neighbour])
    return False


@inlined
def is_cut(levels, prices, row, column, to_row, to_column):
    """Returns whether there is no step to a neighbour: it, or a cell beside a diagonal step, is blocked."""
    if prices[levels[to_row, to_column]] == np.inf:
        return True
    diagonal = row != to_row and column != to_column
    return diagonal and (prices[levels[row, to_column]] == np.inf or prices[levels[to_row, column]] == np.inf)


@inlined
def cost_in_sight(levels, prices, node, neighbour, scratch):
    """Returns the cost of a way at any angle to a neighbour and the cell it comes from straight: Theta*'s step."""
    columns = levels.shape[1]
    to_row = neighbour // columns
    to_column = neighbour - to_row * columns
    row = node // columns
    column = node - row * columns
    cost = scratch.costs[node] + (_DIAGONAL if row != to_row and column != to_column else 1.0)
    parent = scratch.parents[node]
    if parent != node:
        parent_row = parent // columns
        parent_column = parent - parent_row * columns
        a = float(to_row - parent_row)
        b = float(to_column - parent_column)
        direct = scratch.costs[parent] + math.sqrt(a * a + b * b)
        # the straight line is never longer: sight is asked only where it would be of use
        if direct < scratch.costs[neighbour] and sees(levels, prices, parent_row, parent_column, to_row, to_column):
            return direct, parent
    return cost, node


@inlined
def goes_first(a, b, estimates, costs):
    """Returns whether open cell a goes before b: by the estimate, then the farther from the start, then the index."""
    if estimates[a] != estimates[b]:
        return estimates[a] < estimates[b]
    if costs[a] != costs[b]:
        return costs[a] > costs[b]
    return a < b


@inlined
def rise(scratch, place):
    """Moves the cell at `place` of the heap up to where it belongs."""
    costs, estimates, _, heap, places = scratch
    node = heap[place]
    while place > 0:
        above = (place - 1) >> 1
        if not goes_first(node, heap[above], estimates, costs):
            break
        heap[place] = heap[above]
        places[heap[place]] = place
        place = above
    heap[place] = node
    places[node] = place


@inlined
def sink(scratch, size):
    """Moves the cell on top of the heap down to where it belongs."""
    costs, estimates, _, heap, places = scratch
    node = heap[0]
    place = 0
    while True:
        below = 2 * place + 1
        if below >= size:
            break
        if below + 1 < size and goes_first(heap[below + 1], heap[below], estimates, costs):
            below += 1
        if not goes_first(heap[below], node, estimates, costs):
            break
        heap[place] = heap[below]
        places[heap[place]] = place
        place = below
    heap[place] = node
    places[node] = place


@compiled
def sees(levels, prices, row, column, to_row, to_column):
    """Returns whether the line between two cells' centres touches no blocked cell, corners counted: it is symmetric.

    Whole numbers only. After i crossings of vertical and j of horizontal cell borders the next ones come at the shares
    (2i + 1)/(2 |columns|) and (2j + 1)/(2 |rows|) of the line; where both come at once the line runs through a corner,
    and the two cells beside it must be free as for a diagonal step.
    """
    dr = abs(to_row - row)
    dc = abs(to_column - column)
    step_row = 1 if to_row > row else -1
    step_column = 1 if to_column > column else -1
    if prices[levels[row, column]] == np.inf:
        return False
    vertical = dr  # (2i + 1) |rows|
    horizontal = dc  # (2j + 1) |columns|
    while row != to_row or column != to_column:
        if vertical < horizontal:
            column += step_column
            vertical += 2 * dr
        elif horizontal < vertical:
            row += step_row
            horizontal += 2 * dc
        else:
            if prices[levels[row + step_row, column]] == np.inf or prices[levels[row, column + step_column]] == np.inf:
                return False
            row += step_row
            column += step_column
            vertical += 2 * dr
            horizontal += 2 * dc
        if prices[levels[row, column]] == np.inf:
            return False
    return True


@allocating
def traced(parents, goal, columns):
    """Returns the cells (n, 2), row and column, from the start to the goal (flat index)."""
    count = 1
    node = goal
    while parents[node] != node:
        node = parents[node]
        count += 1
    cells = np.empty((count, 2), np.int64)
    node = goal
    for k in range(count - 1, -1, -1):
        cells[k, 0] = node // columns
        cells[k, 1] = node % columns
        node = parents[node]
    return cells


@allocating
def pulled(levels, prices, cells):
    """Returns the cells of a way without the turns that line of sight makes needless: a string pulled tight."""
    corners = np.empty_like(cells)
    assign(corners[0], cells[0])
    count = 1
    for k in range(1, cells.shape[0] - 1):
        last = corners[count - 1]
        if not sees(levels, prices, last[0], last[1], cells[k + 1, 0], cells[k + 1, 1]):
            assign(corners[count], cells[k])
            count += 1
    if cells.shape[0] > 1:
        assign(corners[count], cells[-1])
        count += 1
    return corners[:count].copy()
