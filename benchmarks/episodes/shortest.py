"""The shortest way to a goal, with which driven ways are compared."""

import functools
import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.scenarios import GoalScenario
from wayfield.envs.world.geometry import clearance
from wayfield.envs.world.grids import NO_GRIDS, grid_clearance, lay_grids
from wayfield.policies.parts.grid_search import theta_star
from wayfield.system.compiled import allocating

CELL = 0.04  # m, unless the world is so large that there would be more than
MOST_NODES = 2**22
# Between two neighbours with more clearance than this, in sides of a cell, there is no wall: half of the diagonal.
_SAFE = 0.7072
_BORDER = 1.0  # m, kept around everything: a way may lead round the outermost obstacle


@functools.lru_cache(maxsize=4096)
def shortest_way(scenario: GoalScenario, hull_radius: float) -> float:
    """Returns the length (m) of a shortest way for the hull's centre, through the waypoints, to the goal's tolerance.

    Theta* on a grid of 4 cm, coarser in worlds of more than four million nodes, around what stands: a pushable obstacle
    can be pushed, and a moving one leaves. Cells count as free down to half a cell less than the hull needs, so that
    the grid closes no way that there is: where the length is off, it is mostly short. No way leads through a wall.

    Raises:
        ValueError: if there is no way.
    """
    standing = scenario.fixed
    stops = np.array([scenario.start[:2], *scenario.waypoints, scenario.goal[:2]])
    reach = standing["radius"] + np.hypot(standing["half_length"], standing["half_width"])
    centres = np.column_stack([standing["x"], standing["y"]])
    corners = np.vstack([stops, centres - reach[:, None], centres + reach[:, None]])
    if scenario.grid is not None:
        corners = np.vstack([corners, scenario.grid.corners])
    low = corners.min(axis=0) - hull_radius - _BORDER
    sides = corners.max(axis=0) + hull_radius + _BORDER - low
    cell = max(CELL, math.sqrt(float(sides.prod()) / MOST_NODES))
    columns, rows = np.ceil(sides / cell).astype(int) + 1
    grids = lay_grids([scenario.grid], NO_GRIDS.frames.copy())
    needed = hull_radius - 0.5 * cell if cell == CELL else max(hull_radius - 0.5 * cell, _SAFE * cell)
    blocked = occupancy(standing, grids, low, cell, (int(rows), int(columns)), needed)
    total = 0.0
    for a, b in itertools.pairwise(stops):
        cells = [(round((y - low[1]) / cell), round((x - low[0]) / cell)) for x, y in (a, b)]
        way = theta_star(blocked, *cells)
        if not math.isfinite(way.length):
            raise ValueError(f"scenario {scenario.name!r} has no way for a hull of {hull_radius:g} m")
        total += max(way.length * cell, math.dist(a, b))
    return max(total - scenario.position_tolerance, CELL)


@allocating
def occupancy(obstacles: Any, grids: Any, low: Any, cell: float, shape: Any, needed: float) -> NDArray[np.bool_]:
    """Returns which nodes (rows, columns), `cell` (m) apart from `low` on, have less than `needed` (m) of clearance."""
    blocked = np.zeros(shape, np.bool_)
    for row in range(shape[0]):
        for column in range(shape[1]):
            x = low[0] + column * cell
            y = low[1] + row * cell
            free = clearance(obstacles, len(obstacles), x, y)
            if grids.cells.shape[0] > 0:
                free = min(free, grid_clearance(grids.frames[0], grids.cells, x, y))
            blocked[row, column] = free < needed
    return blocked
