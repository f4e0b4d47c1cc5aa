"""What is left of the shortest way to the goal, for a teacher who knows the map."""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.compiled import compiled
from wayfield.envs.sb3 import NativeVecEnv
from wayfield.envs.scenarios import GoalScenario
from wayfield.envs.scenarios.ways import clearances, grid_over, reached

CELL = 0.1  # m
MARGIN = 1.0  # m, that a grid goes beyond all that stands
DEAR = 0.35  # m of clearance beyond the hull, under which a metre costs more
SWEEPS = 200  # at most; a maze needs a few dozen
MOST_NODES = 2**22  # of a scenario's grid: 200 m x 200 m


class Ways:
    """A grid of each scenario with the way from every node to the goal, around what stands; called with the worlds.

    A metre near an obstacle costs up to twice as much, so that the shortest way keeps off the corners. Nodes inside the
    hull's reach of an obstacle are passable at ten times the price: a way is never infinite.
    """

    def __init__(self, worlds: NativeVecEnv) -> None:
        self.grids = []
        done: dict[str, tuple[NDArray[np.float32], NDArray[np.float64]]] = {}
        for part in worlds.parts:
            hull = part.task.robot.hull_radius
            fields = []
            for scenario in part.task.scenarios:
                if scenario.name not in done:
                    done[scenario.name] = way_field(scenario, hull)
                fields.append(done[scenario.name])
            shape = np.array([field.shape for field, _ in fields])
            first = np.concatenate([[0], np.cumsum(shape.prod(axis=1))[:-1]])
            self.grids.append(
                (
                    np.concatenate([field.ravel() for field, _ in fields]),
                    np.column_stack([first, shape]),
                    np.array([origin for _, origin in fields]),
                )
            )

    def __call__(self, worlds: NativeVecEnv) -> NDArray[np.float64]:
        """Returns what is left of the way of every robot, m."""
        left = np.empty(worlds.num_envs)
        for grid, part, rows in zip(self.grids, worlds.parts, worlds.rows, strict=True):
            states = part.batch.states
            left_from(*grid, states["scenario"], states["x"], states["y"], left[rows])
        return left


def way_field(scenario: GoalScenario, hull_radius: float) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Returns the way (rows, columns) from each node of a grid to the goal, m, and the grid's first node (x, y).

    Raises:
        ValueError: if the scenario is too large for a grid.
    """
    standing = scenario.obstacles[(scenario.obstacles["mass"] == 0.0) & (scenario.patrols["leg_time"] == 0.0)]
    ends = [scenario.start[:2], scenario.goal[:2]]
    corners = ends if scenario.grid is None else np.vstack([ends, scenario.grid.corners])
    x, y, columns, rows = grid_over(standing, corners, MARGIN, CELL)
    if columns * rows > MOST_NODES:
        raise ValueError(
            f"shortest_ways: scenario {scenario.name!r} is {CELL * columns:.0f} m x {CELL * rows:.0f} m; a teacher who "
            f"knows the way needs a world of at most {MOST_NODES:,} cells of {CELL:g} m"
        )
    spare = np.ascontiguousarray(clearances(standing, x, y, CELL, columns, rows).T)
    if scenario.grid is not None:
        row, column = np.indices(spare.shape)
        nodes = np.column_stack([x + CELL * column.ravel(), y + CELL * row.ravel()])
        spare = np.minimum(spare, scenario.grid.clearances(nodes).reshape(spare.shape))
    spare -= hull_radius
    price = np.where(spare < 0.0, 10.0, 1.0 + np.clip(1.0 - spare / DEAR, 0.0, 1.0))
    ways = np.full((rows, columns), np.inf)
    low = np.array([x, y])
    column, row = np.rint((scenario.goal[:2] - low) / CELL).astype(int).tolist()
    ways[row, column] = 0.0
    sweep(CELL * price, ways)
    return ways.astype(np.float32), low


@compiled
def sweep(costs, ways):
    """Lowers the ways (rows, columns) until |grad way| is the cost of a cell everywhere but where it was 0.

    The fast sweeping method: Zhao, "A fast sweeping method for eikonal equations", Mathematics of Computation 74, 2005.
    """
    rows, columns = ways.shape
    for turn in range(SWEEPS):
        changed = False
        for j in range(rows):
            row = j if turn % 2 == 0 else rows - 1 - j
            for k in range(columns):
                column = k if turn // 2 % 2 == 0 else columns - 1 - k
                a = math.inf
                b = math.inf
                if row > 0:
                    a = ways[row - 1, column]
                if row < rows - 1:
                    a = min(a, ways[row + 1, column])
                if column > 0:
                    b = ways[row, column - 1]
                if column < columns - 1:
                    b = min(b, ways[row, column + 1])
                if min(a, b) == math.inf:
                    continue
                way = reached(b, a, costs[row, column])
                if way < ways[row, column] - 1e-6:
                    ways[row, column] = way
                    changed = True
        if not changed and turn % 4 == 3:
            return


@compiled
def left_from(lengths, shapes, origins, scenarios, xs, ys, left):
    """Fills the ways left (b,) from positions: between nodes, in proportion."""
    for i in range(left.shape[0]):
        k = scenarios[i]
        first = shapes[k, 0]
        rows = shapes[k, 1]
        columns = shapes[k, 2]
        u = min(max((xs[i] - origins[k, 0]) / CELL, 0.0), columns - 1.001)
        v = min(max((ys[i] - origins[k, 1]) / CELL, 0.0), rows - 1.001)
        column = int(u)
        row = int(v)
        u -= column
        v -= row
        at = first + row * columns + column
        low = (1.0 - u) * lengths[at] + u * lengths[at + 1]
        high = (1.0 - u) * lengths[at + columns] + u * lengths[at + columns + 1]
        left[i] = (1.0 - v) * low + v * high
