"""Clearances and rays of occupancy grids, square by square."""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.world.grids import OccupancyGrid

FREE = "free"
Array = NDArray[np.float64]


def clearances(grid: OccupancyGrid, points: Array) -> Array:
    """Returns the distance of each point to all occupied squares, one by one, and to the border where it counts."""
    rows, columns = np.nonzero(grid.occupied)
    sides = grid.occupied.shape[::-1]
    found = []
    for u, v in grid.places(points).tolist():
        aside = np.maximum(np.maximum(columns - u, u - columns - 1), 0.0)
        above = np.maximum(np.maximum(rows - v, v - rows - 1), 0.0)
        near = np.sqrt(aside**2 + above**2).min() if len(rows) else math.inf
        if grid.beyond != FREE:
            near = min(near, max(0.0, min(u, sides[0] - u, v, sides[1] - v)))
        found.append(near * grid.resolution)
    return np.array(found)


def rays(grid: OccupancyGrid, points: Array, headings: Array, max_range: float) -> Array:
    """Returns the ray lengths by clipping each ray against every occupied square."""
    rows, columns = np.nonzero(grid.occupied)
    sides = grid.occupied.shape[::-1]
    found = []
    for (u, v), heading in zip(grid.places(points).tolist(), (headings - grid.origin[2]).tolist(), strict=True):
        du, dv = math.cos(heading), math.sin(heading)
        enter, leave = np.zeros(len(rows)), np.full(len(rows), math.inf)
        for at, way, low in ((u, du, columns), (v, dv, rows)):
            a, b = (low - at) / way, (low + 1 - at) / way
            enter, leave = np.maximum(enter, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
        met = enter[enter <= leave].min(initial=math.inf)
        if grid.beyond != FREE:
            out = [
                (side - at) / way if way > 0 else -at / way for at, way, side in ((u, du, sides[0]), (v, dv, sides[1]))
            ]
            inside = 0 <= u < sides[0] and 0 <= v < sides[1]
            met = min(met, *out) if inside else 0.0
        found.append(min(met * grid.resolution, max_range))
    return np.array(found)
