"""Thousands of obstacles that stand still: put in order, so that neighbours are a block, and passed over by the block.

A packed R-tree (Leutenegger, Lopez and Edgington, ICDE 1997) of two levels, with discs around what a node holds: blocks
out of a scan's reach, or farther than what was found to be near, are passed over. What is looked at is measured as
without, and a least number does not depend on the order: the bits are those of looking at all.
"""

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.world.geometry import OBSTACLE, beyond, clearance_to
from wayfield.system.compiled import inlined

BLOCK = 16  # obstacles; and so many blocks have a disc around them in turn
FEW = 128  # obstacles, up to which it is as fast to look at each


def in_blocks(fields: NDArray[np.void], counts: NDArray[np.int64]) -> tuple[NDArray[np.void], NDArray[np.int64]]:
    """Returns fields (rows, m + n) whose rows of many obstacles are in blocks, and how many blocks (rows,) they have.

    Behind the obstacles of such a row stand a disc around each block, and then one around each BLOCK blocks. Rows of
    few are as they were; without any other the fields are the very same array.

    Args:
        fields: OBSTACLE records, (rows, m).
        counts: (rows,) how many of a row there are.
    """
    blocks = np.where(counts > FEW, -(-counts // BLOCK), 0)
    if not blocks.any():
        return fields, blocks
    more = blocks + -(-blocks // BLOCK)
    placed = np.zeros((len(fields), max(fields.shape[1], int((counts + more).max()))), OBSTACLE)
    placed[:, : fields.shape[1]] = fields
    for row, count, number in zip(placed, counts.tolist(), blocks.tolist(), strict=True):
        if number:
            row[:count] = row[:count][_order(np.column_stack([row["x"], row["y"]])[:count])]
            row[count : count + number] = _around(row[:count])
            row[count + number : count + number + -(-number // BLOCK)] = _around(row[count : count + number])
    return placed, blocks


def _order(centres: NDArray[np.float64]) -> NDArray[np.int64]:
    """Returns the order (n,) of points (n, 2) in which neighbours are together, halved across where they are wide."""
    order = np.arange(len(centres))
    parts = [(0, len(centres))]
    while parts:
        first, last = parts.pop()
        if last - first <= BLOCK:
            continue
        part = order[first:last]
        across = int(np.argmax(np.ptp(centres[part], axis=0)))
        order[first:last] = part[np.argsort(centres[part, across], kind="stable")]
        # the first half is of whole blocks, twice as many each time: so are the blocks of blocks
        half = BLOCK
        while 2 * half < last - first:
            half *= 2
        parts += [(first, first + half), (first + half, last)]
    return order


def _around(records: NDArray[np.void]) -> NDArray[np.void]:
    """Returns a disc, as an OBSTACLE record, around all of each BLOCK records."""
    discs = np.zeros(-(-len(records) // BLOCK), OBSTACLE)
    for disc, first in zip(discs, range(0, len(records), BLOCK), strict=True):
        part = records[first : first + BLOCK]
        x, y = 0.5 * (part["x"].min() + part["x"].max()), 0.5 * (part["y"].min() + part["y"].max())
        far = np.sqrt((part["x"] - x) ** 2 + (part["y"] - y) ** 2)
        far += part["half_length"] + part["half_width"] + part["radius"]
        disc["x"], disc["y"], disc["cos"] = x, y, 1.0
        disc["radius"] = (1.0 + 1e-9) * far.max()
    return discs


@inlined
def next_block(obstacles, i, count, blocks, k, x, y, reach):
    """Returns the next block of row i, from k on, that is not beyond `reach` (m) from (x, y); `blocks` if none is."""
    while k < blocks:
        if k % BLOCK == 0 and beyond(obstacles[i, count + blocks + k // BLOCK], x, y, reach):
            k += BLOCK
        elif beyond(obstacles[i, count + k], x, y, reach):
            k += 1
        else:
            return k
    return blocks


@inlined
def nearest_block(obstacles, i, count, blocks, x, y):
    """Returns the block of row i, by the discs, that is worth looking at first for what is nearest to (x, y)."""
    first = 0
    last = (blocks + BLOCK - 1) // BLOCK
    start = count + blocks
    # first the nearest disc around blocks, then the nearest block of it
    for _ in range(2):
        best = first
        least = np.inf
        for k in range(first, last):
            away = clearance_to(obstacles[i, start + k], x, y)
            if away < least:
                best = k
                least = away
        if start == count:
            break
        start = count
        first = best * BLOCK
        last = min(first + BLOCK, blocks)
    return best


@inlined
def blocks_clearance(obstacles, i, count, blocks, x, y):
    """Returns `geometry.row_clearance` of a row of `in_blocks` that is in blocks."""
    nearest = np.inf
    k = nearest_block(obstacles, i, count, blocks, x, y)
    for j in range(k * BLOCK, min((k + 1) * BLOCK, count)):
        nearest = min(nearest, clearance_to(obstacles[i, j], x, y))
    k = next_block(obstacles, i, count, blocks, 0, x, y, nearest)
    while k < blocks:
        for j in range(k * BLOCK, min((k + 1) * BLOCK, count)):
            nearest = min(nearest, clearance_to(obstacles[i, j], x, y))
        k = next_block(obstacles, i, count, blocks, k + 1, x, y, nearest)
    return nearest
