"""A map that a robot draws of its scans: evidence of what is taken, and how near to that each cell is.

A robot's map is part of its memory: a record with the fields of CHART and `origin` (m) and `cell` (m) of the grid.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from wayfield.policies.parts.polyline_tracker import FARTHEST, UNIT
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import sin_cos

CELLS = 160  # of a side of the grid
SUB = 4  # spots of a cell's side, for where in it the hits were

CHART = [
    ("grid", np.uint8, (CELLS, CELLS)),  # clearance levels, as planners read them
    ("evidence", np.int8, (CELLS, CELLS)),
    ("spots", np.uint16, (CELLS, CELLS)),  # of the hits in each cell, a bit each
]

# What a scan says of a cell, added up: above 0 it is taken, below 0 seen free, 0 unknown.
HIT = 6
MOST = 18
LEAST = -4
BARRED = 127  # a gap in which the robot does not fit: no beam takes that back


@compiled
def enter_scan(m, table, scan, i, pose, hull_radius):
    """Enters robot i's scan: evidence along the beams, spots and clearance at their ends.

    Args:
        table: of `stamps`.
        pose: (x, y, heading).
    """
    x, y, heading = pose
    scale = 1.0 / m.cell
    u = (x - m.origin[0]) * scale
    v = (y - m.origin[1]) * scale
    sine, cosine = sin_cos(heading)
    # where the robot stands is free
    span = int(hull_radius * scale)
    for row in range(max(int(v) - span, 0), min(int(v) + span + 1, CELLS)):
        for column in range(max(int(u) - span, 0), min(int(u) + span + 1, CELLS)):
            if (row - int(v)) ** 2 + (column - int(u)) ** 2 <= span * span:
                weaken(m, table, row, column)
    # what the beams go through first, so that a hit of this scan is not undone by its neighbours
    beams = scan.directions
    for k in range(beams.shape[0]):
        ux = cosine * beams[k, 0] - sine * beams[k, 1]
        uy = sine * beams[k, 0] + cosine * beams[k, 1]
        # up to a cell before the end
        enter_beam(m, table, u, v, ux, uy, min(scan.ranges[i, k], scan.reach) * scale - 1.0)
    for k in range(beams.shape[0]):
        if scan.ranges[i, k] >= scan.reach * (1.0 - 1e-6):
            continue
        hit_x = x + (cosine * beams[k, 0] - sine * beams[k, 1]) * scan.ranges[i, k]
        hit_y = y + (sine * beams[k, 0] + cosine * beams[k, 1]) * scan.ranges[i, k]
        enter_point(m, table, hit_x, hit_y)


@inlined
def enter_beam(m, table, u, v, ux, uy, length):
    """Enters that a beam goes through all cells from (u, v) on, in cells, along (ux, uy), for a `length` of cells."""
    evidence = m.evidence
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
        if row < 0 or column < 0 or row >= CELLS or column >= CELLS:
            break
        e = evidence[row, column]
        if LEAST < e < BARRED:
            if e == 1:
                weaken(m, table, row, column)
            else:
                evidence[row, column] = e - 1


@compiled
def enter_point(m, table, x, y):
    """Enters a point that is taken."""
    evidence = m.evidence
    u = (x - m.origin[0]) / m.cell
    v = (y - m.origin[1]) / m.cell
    column = math.floor(u)
    row = math.floor(v)
    if row < 0 or column < 0 or row >= CELLS or column >= CELLS:
        return
    if evidence[row, column] != BARRED:
        evidence[row, column] = min(max(evidence[row, column], 0) + HIT, MOST)
    spot_column = min(int((u - column) * SUB), SUB - 1)
    spot_row = min(int((v - row) * SUB), SUB - 1)
    mark(m, table, row, column, spot_row * SUB + spot_column)


@compiled
def mark(m, table, row, column, spot):
    """Enters a spot of a cell, and the clearance around it."""
    bit = np.uint16(1 << spot)
    if m.spots[row, column] & bit == 0:
        m.spots[row, column] |= bit
        stamp(m.grid, table, row, column, spot, (0, CELLS, 0, CELLS))


@compiled
def forget(m):
    """Empties the map."""
    m.grid[:] = 0
    m.evidence[:] = 0
    m.spots[:] = 0


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
def stamp(grid, table, row, column, spot, window):
    """Lowers the clearance around a spot of a cell, in the window of rows, columns from low to before high."""
    low_row, high_row, low_column, high_column = window
    half = table.shape[2] // 2
    first = max(low_column, column - half)
    last = min(high_column, column + half + 1)
    for r in range(max(low_row, row - half), min(high_row, row + half + 1)):
        # rows of their own, without branches: a byte at a time this was most of the work
        levels = table[spot // SUB, spot % SUB, r - row + half, first - column + half :]
        cells = grid[r, first:last]
        for k in range(last - first):
            cells[k] = max(cells[k], levels[k])


@compiled
def weaken(m, table, row, column):
    """Takes evidence off a cell; one that is no longer taken loses its spots, and clearance around it is made anew."""
    grid = m.grid
    evidence = m.evidence
    spots = m.spots
    if evidence[row, column] == BARRED:
        return
    evidence[row, column] = max(evidence[row, column] - 1, LEAST)
    if evidence[row, column] > 0 or spots[row, column] == 0:
        return
    evidence[row, column] = -1
    spots[row, column] = 0
    half = table.shape[2] // 2
    low_row = max(row - half, 0)
    high_row = min(row + half + 1, CELLS)
    low_column = max(column - half, 0)
    high_column = min(column + half + 1, CELLS)
    for r in range(low_row, high_row):
        for c in range(low_column, high_column):
            grid[r, c] = 0
    for r in range(max(row - 2 * half, 0), min(row + 2 * half + 1, CELLS)):
        for c in range(max(column - 2 * half, 0), min(column + 2 * half + 1, CELLS)):
            if spots[r, c] == 0:
                continue
            for spot in range(SUB * SUB):
                if spots[r, c] & np.uint16(1 << spot):
                    stamp(grid, table, r, c, spot, (low_row, high_row, low_column, high_column))


@allocating
def move_grid(m, x, y):
    """Moves the grid by whole cells so that (x, y) lies in its middle; what leaves it is forgotten."""
    columns = math.floor((x - m.origin[0]) / m.cell) - CELLS // 2
    rows = math.floor((y - m.origin[1]) / m.cell) - CELLS // 2
    old_grid = m.grid.copy()
    old_evidence = m.evidence.copy()
    old_spots = m.spots.copy()
    forget(m)
    for row in range(max(-rows, 0), min(CELLS - rows, CELLS)):
        for column in range(max(-columns, 0), min(CELLS - columns, CELLS)):
            m.grid[row, column] = old_grid[row + rows, column + columns]
            m.evidence[row, column] = old_evidence[row + rows, column + columns]
            m.spots[row, column] = old_spots[row + rows, column + columns]
    m.origin[0] += columns * m.cell
    m.origin[1] += rows * m.cell
