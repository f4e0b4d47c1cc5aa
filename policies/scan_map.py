"""A map that a robot draws of its scans: evidence of what is taken, and how near to that each cell is.

A chart is four arrays: the clearance levels (b, CELLS, CELLS) as planners read them, the evidence, the spots of the
hits in each cell, and the table of `stamps`.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.compiled import compiled, inlined
from wayfield.envs.geometry import sin_cos
from wayfield.policies.polyline_tracker import FARTHEST, UNIT

CELLS = 160  # of a side of the grid
SUB = 4  # spots of a cell's side, for where in it the hits were

# What a scan says of a cell, added up: above 0 it is taken, below 0 seen free, 0 unknown.
HIT = 6
MOST = 18
LEAST = -4
BARRED = 127  # a gap in which the robot does not fit: no beam takes that back


@compiled
def enter_scan(chart, i, origin, cell, x, y, heading, beams, ranges, max_range, hull_radius):
    """Enters robot i's scan: evidence along the beams, spots and clearance at their ends."""
    grid, evidence, _, _ = chart
    size = grid.shape[1]
    scale = 1.0 / cell[i]
    u = (x - origin[i, 0]) * scale
    v = (y - origin[i, 1]) * scale
    sine, cosine = sin_cos(heading)
    # where the robot stands is free
    span = int(hull_radius * scale)
    for row in range(max(int(v) - span, 0), min(int(v) + span + 1, size)):
        for column in range(max(int(u) - span, 0), min(int(u) + span + 1, size)):
            if (row - int(v)) ** 2 + (column - int(u)) ** 2 <= span * span:
                weaken(chart, i, row, column)
    # what the beams go through first, so that a hit of this scan is not undone by its neighbours
    for k in range(beams.shape[0]):
        ux = cosine * beams[k, 0] - sine * beams[k, 1]
        uy = sine * beams[k, 0] + cosine * beams[k, 1]
        # up to a cell before the end
        length = (min(ranges[i, k], max_range)) * scale - 1.0
        column = int(u)
        row = int(v)
        step_column = 1 if ux > 0.0 else -1
        step_row = 1 if uy > 0.0 else -1
        per_column = 1.0 / max(abs(ux), 1e-12)
        per_row = 1.0 / max(abs(uy), 1e-12)
        next_column = (column + 1 - u if ux > 0.0 else u - column) * per_column
        next_row = (row + 1 - v if uy > 0.0 else v - row) * per_row
        while True:
            if next_column < next_row:
                if next_column > length:
                    break
                column += step_column
                next_column += per_column
            else:
                if next_row > length:
                    break
                row += step_row
                next_row += per_row
            if row < 0 or column < 0 or row >= size or column >= size:
                break
            e = evidence[i, row, column]
            if LEAST < e < BARRED:
                if e == 1:
                    weaken(chart, i, row, column)
                else:
                    evidence[i, row, column] = e - 1
    for k in range(beams.shape[0]):
        if ranges[i, k] >= max_range * (1.0 - 1e-6):
            continue
        hit_x = x + (cosine * beams[k, 0] - sine * beams[k, 1]) * ranges[i, k]
        hit_y = y + (sine * beams[k, 0] + cosine * beams[k, 1]) * ranges[i, k]
        enter_point(chart, i, origin, cell, hit_x, hit_y)


@compiled
def enter_point(chart, i, origin, cell, x, y):
    """Enters a point that is taken."""
    grid, evidence, _, _ = chart
    size = grid.shape[1]
    u = (x - origin[i, 0]) / cell[i]
    v = (y - origin[i, 1]) / cell[i]
    column = math.floor(u)
    row = math.floor(v)
    if row < 0 or column < 0 or row >= size or column >= size:
        return
    if evidence[i, row, column] != BARRED:
        evidence[i, row, column] = min(max(evidence[i, row, column], 0) + HIT, MOST)
    spot_column = min(int((u - column) * SUB), SUB - 1)
    spot_row = min(int((v - row) * SUB), SUB - 1)
    mark(chart, i, row, column, spot_row * SUB + spot_column)


@compiled
def mark(chart, i, row, column, spot):
    """Enters a spot of a cell, and the clearance around it."""
    grid, _, spots, _ = chart
    bit = np.uint16(1 << spot)
    if spots[i, row, column] & bit == 0:
        spots[i, row, column] |= bit
        stamp(chart, i, row, column, spot, 0, grid.shape[1], 0, grid.shape[1])


@functools.cache
def stamps(cell: float, reach: float) -> NDArray[np.uint8]:
    """Returns the levels that a spot gives the cells around its own, (SUB, SUB, side, side): 0 beyond `reach` (m).

    The first two indices are the spot's row and column in its cell, which is the one in the middle of the others.
    """
    half = math.ceil(reach / cell)
    around = np.arange(-half, half + 1) + 0.5
    spot = (np.arange(SUB) + 0.5) / SUB
    away = around - spot[:, None]  # (SUB, side) cells
    distance = cell * np.hypot(away[:, None, :, None], away[None, :, None, :])
    # from the near side of the spot
    clearance = distance - 0.5 / SUB * cell
    levels = np.clip(np.ceil((FARTHEST - clearance) / UNIT - 1e-6), 0.0, 255.0)
    return np.where(distance <= reach, levels, 0.0).astype(np.uint8)


@inlined
def stamp(chart, i, row, column, spot, low_row, high_row, low_column, high_column):
    """Lowers the clearance around a spot of a cell, in the window of rows and columns from low to before high."""
    grid, _, _, table = chart
    half = table.shape[2] // 2
    first = max(low_column, column - half)
    last = min(high_column, column + half + 1)
    for r in range(max(low_row, row - half), min(high_row, row + half + 1)):
        # rows of their own, without branches: a byte at a time this was most of the work
        levels = table[spot // SUB, spot % SUB, r - row + half, first - column + half :]
        cells = grid[i, r, first:last]
        for k in range(last - first):
            cells[k] = max(cells[k], levels[k])


@compiled
def weaken(chart, i, row, column):
    """Takes evidence off a cell; one that is no longer taken loses its spots, and clearance around it is made anew."""
    grid, evidence, spots, table = chart
    size = grid.shape[1]
    if evidence[i, row, column] == BARRED:
        return
    evidence[i, row, column] = max(evidence[i, row, column] - 1, LEAST)
    if evidence[i, row, column] > 0 or spots[i, row, column] == 0:
        return
    evidence[i, row, column] = -1
    spots[i, row, column] = 0
    half = table.shape[2] // 2
    low_row = max(row - half, 0)
    high_row = min(row + half + 1, size)
    low_column = max(column - half, 0)
    high_column = min(column + half + 1, size)
    for r in range(low_row, high_row):
        for c in range(low_column, high_column):
            grid[i, r, c] = 0
    for r in range(max(row - 2 * half, 0), min(row + 2 * half + 1, size)):
        for c in range(max(column - 2 * half, 0), min(column + 2 * half + 1, size)):
            if spots[i, r, c] == 0:
                continue
            for spot in range(SUB * SUB):
                if spots[i, r, c] & np.uint16(1 << spot):
                    stamp(chart, i, r, c, spot, low_row, high_row, low_column, high_column)


@compiled
def move_grid(chart, i, origin, cell, x, y):
    """Moves robot i's grid by whole cells so that (x, y) lies in its middle; what leaves it is forgotten."""
    grid, evidence, spots, _ = chart
    size = grid.shape[1]
    columns = math.floor((x - origin[i, 0]) / cell[i]) - size // 2
    rows = math.floor((y - origin[i, 1]) / cell[i]) - size // 2
    old_grid = grid[i].copy()
    old_evidence = evidence[i].copy()
    old_spots = spots[i].copy()
    grid[i] = 0
    evidence[i] = 0
    spots[i] = 0
    for row in range(max(-rows, 0), min(size - rows, size)):
        for column in range(max(-columns, 0), min(size - columns, size)):
            grid[i, row, column] = old_grid[row + rows, column + columns]
            evidence[i, row, column] = old_evidence[row + rows, column + columns]
            spots[i, row, column] = old_spots[row + rows, column + columns]
    origin[i, 0] += columns * cell[i]
    origin[i, 1] += rows * cell[i]
