"""The shortest way to a goal, with which driven ways are compared."""

import functools
import itertools
import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.compiled import compiled
from wayfield.envs.geometry import clearance
from wayfield.envs.scenarios import GoalScenario
from wayfield.policies.parts.grid_search import theta_star

CELL = 0.04  # m
_BORDER = 1.0  # m, kept around everything: a way may lead round the outermost obstacle


@functools.lru_cache(maxsize=4096)
def shortest_way(scenario: GoalScenario, hull_radius: float) -> float:
    """Returns the length (m) of a shortest way for the hull's centre, through the waypoints, to the goal's tolerance.

    Theta* on a grid of 4 cm, around what stands: a pushable obstacle can be pushed, and a moving one leaves. Cells
    count as free down to half a cell less than the hull needs, so that the grid closes no way that there is: where the
    length is off, it is mostly short.

    Raises:
        ValueError: if there is no way.
    """
    standing = scenario.obstacles[(scenario.obstacles["mass"] == 0.0) & (scenario.patrols["leg_time"] == 0.0)]
    stops = np.array([scenario.start[:2], *scenario.waypoints, scenario.goal[:2]])
    reach = standing["radius"] + np.hypot(standing["half_length"], standing["half_width"])
    centres = np.column_stack([standing["x"], standing["y"]])
    corners = np.vstack([stops, centres - reach[:, None], centres + reach[:, None]])
    low = corners.min(axis=0) - hull_radius - _BORDER
    columns, rows = np.ceil((corners.max(axis=0) + hull_radius + _BORDER - low) / CELL).astype(int) + 1
    blocked = occupancy(standing, *low.tolist(), int(rows), int(columns), hull_radius - 0.5 * CELL)
    total = 0.0
    for a, b in itertools.pairwise(stops):
        cells = [(round((y - low[1]) / CELL), round((x - low[0]) / CELL)) for x, y in (a, b)]
        way = theta_star(blocked, *cells)
        if not math.isfinite(way.length):
            raise ValueError(f"scenario {scenario.name!r} has no way for a hull of {hull_radius:g} m")
        total += max(way.length * CELL, math.dist(a, b))
    return max(total - scenario.position_tolerance, CELL)


@compiled
def occupancy(
    obstacles: NDArray[np.void], x: float, y: float, rows: int, columns: int, needed: float
) -> NDArray[np.bool_]:
    """Returns which nodes of a grid with its first node at (x, y) have less than `needed` (m) of clearance."""
    blocked = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            free = clearance(obstacles, len(obstacles), x + column * CELL, y + row * CELL)
            blocked[row, column] = free < needed
    return blocked
