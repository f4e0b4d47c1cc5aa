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
MOST_NODES = 4_000_000  # of a grid; in a larger world cells are larger
_BORDER = 1.0  # m, kept around everything: a way may lead round the outermost obstacle


@functools.lru_cache(maxsize=4096)
def shortest_way(scenario: GoalScenario, hull_radius: float) -> float:
    """Returns the length (m) of a shortest way for the hull's centre, through the waypoints, to the goal's tolerance.

    Theta* on a grid of 4 cm (of more where the world is large), around what stands: a pushable obstacle can be pushed,
    and a moving one leaves. Cells count as free down to half a cell less than the hull needs, so that the grid closes
    no way that there is: where the length is off, it is mostly short.

    Raises:
        ValueError: if there is no way.
    """
    standing = scenario.obstacles[(scenario.obstacles["mass"] == 0.0) & (scenario.patrols["leg_time"] == 0.0)]
    stops = np.array([scenario.start[:2], *scenario.waypoints, scenario.goal[:2]])
    reach = standing["radius"] + np.hypot(standing["half_length"], standing["half_width"])
    centres = np.column_stack([standing["x"], standing["y"]])
    corners = [stops, centres - reach[:, None], centres + reach[:, None]]
    if scenario.grid is not None:
        corners.append(scenario.grid.corners)
    ends = np.vstack(corners)
    low = ends.min(axis=0) - hull_radius - _BORDER
    extent = ends.max(axis=0) + hull_radius + _BORDER - low
    cell = max(CELL, math.sqrt(extent.prod() / MOST_NODES))
    columns, rows = np.ceil(extent / cell).astype(int) + 1
    needed = hull_radius - 0.5 * cell
    blocked = occupancy(standing, (*low.tolist(), cell), int(rows), int(columns), needed)
    if scenario.grid is not None:
        nodes = np.stack(np.meshgrid(*(low[k] + cell * np.arange(n) for k, n in ((0, columns), (1, rows)))), axis=-1)
        blocked |= (scenario.grid.clearances(nodes.reshape(-1, 2)) < needed).reshape(rows, columns)
    total = 0.0
    for a, b in itertools.pairwise(stops):
        cells = [(round((y - low[1]) / cell), round((x - low[0]) / cell)) for x, y in (a, b)]
        way = theta_star(blocked, *cells)
        if not math.isfinite(way.length):
            raise ValueError(f"scenario {scenario.name!r} has no way for a hull of {hull_radius:g} m")
        total += max(way.length * cell, math.dist(a, b))
    return max(total - scenario.position_tolerance, CELL)


@compiled
def occupancy(
    obstacles: NDArray[np.void], place: tuple[float, float, float], rows: int, columns: int, needed: float
) -> NDArray[np.bool_]:
    """Returns which nodes of a grid have less than `needed` (m) of clearance.

    Args:
        place: x, y of the first node and the distance between neighbours, m.
    """
    x, y, cell = place
    blocked = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            free = clearance(obstacles, len(obstacles), x + column * cell, y + row * cell)
            blocked[row, column] = free < needed
    return blocked
