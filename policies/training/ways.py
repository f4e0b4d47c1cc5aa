"""What is left of the shortest way to the goal, for a teacher with access to the map."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.sb3 import NativeVecEnv
from wayfield.envs.scenarios import GoalScenario
from wayfield.envs.scenarios.ways import clearances, grid_over, reached
from wayfield.envs.world.reeds_shepp import PLAN, plan_to
from wayfield.system.compiled import allocating, compiled

CELL = 0.1  # m
MARGIN = 1.0  # m, that a grid goes beyond all that stands
DEAR = 0.35  # m of clearance beyond the hull, under which a metre costs more
SWEEPS = 200  # at most; a maze needs a few dozen
RADIUS = 0.25  # m, of the circles of a manoeuvre
SLACK = 0.06  # m
MOST_NODES = 2**22  # of a scenario's grid: 200 m x 200 m


class Ways:
    """A grid of each scenario with the way from every node to the goal, around what stands; called with the worlds.

    A metre near an obstacle costs up to twice as much, so that the shortest way keeps off the corners. Nodes inside the
    hull's reach of an obstacle are passable at ten times the price: a way is never infinite.
    """

    cell, dear = CELL, DEAR  # m
    straight = False  # whether a bank in which nothing stands has no grids

    def __init__(self, worlds: NativeVecEnv) -> None:
        # of each part; None: nothing stands there, the straight way is the shortest
        self.grids: list[tuple[NDArray[Any], ...] | None] = []
        done: dict[tuple[str, Any, float], tuple[NDArray[np.float32], NDArray[np.float64]]] = {}
        for part in worlds.parts:
            hull = part.task.robot.hull_radius
            fields = []
            task: Any = part.task
            courses = task.courses_of()
            if self.straight and not any(len(each.obstacles) for each in courses):
                self.grids.append(None)
                continue
            for scenario in courses:
                # robots of one team have a name in common, and larger ones another way
                key = scenario.name, tuple(scenario.goal), hull
                if key not in done:
                    done[key] = way_field(scenario, hull, self.cell, self.dear)
                fields.append(done[key])
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
            if grid is None:
                left[rows] = states["remaining_distance"]
                continue
            left_from(*grid, states["scenario"], states["x"], states["y"], left[rows], self.cell)
        return left


class TeamWays(Ways):
    """The same, of which a world has one a robot; where nothing stands in any world, the straight way."""

    straight = True


class Manoeuvres(Ways):
    """The longer of two ways that are both too short: around what stands, and that of a car that goes both ways.

    The car has the space to itself, on circles of RADIUS: a base that turns on the spot needs none, but what it drives
    smoothly has some. The way around what stands is a point's, that does not mind its heading nor how near it passes,
    and is known no better than SLACK.
    """

    cell, dear = 0.05, 0.0

    def __init__(self, worlds: NativeVecEnv) -> None:
        super().__init__(worlds)
        self.goals = [np.array([each.goal for each in part.task.scenarios]) for part in worlds.parts]

    def __call__(self, worlds: NativeVecEnv) -> NDArray[np.float64]:
        """Returns what is left of the way of every robot, m."""
        around, left = super().__call__(worlds), np.empty(worlds.num_envs)
        for goals, part, rows in zip(self.goals, worlds.parts, worlds.rows, strict=True):
            states = part.batch.states
            poses = np.column_stack([states["x"], states["y"], states["heading"]])
            manoeuvre_from(poses, goals[states["scenario"]], RADIUS, left[rows])
        return np.maximum(left, around - SLACK)


# by task
WAYS: Mapping[str, type[Ways | Manoeuvres]] = {
    "goal_reaching": Ways,
    "docking": Manoeuvres,
    "teams": TeamWays,
    "people": TeamWays,
}


def way_field(
    scenario: GoalScenario, hull_radius: float, cell: float = CELL, dear: float = DEAR
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Returns the way (rows, columns) from each node of a grid to the goal, m, and the grid's first node (x, y).

    Args:
        cell: m, of the grid.
        dear: m of clearance beyond the hull, under which a metre costs more.

    Raises:
        ValueError: if the scenario is too large for a grid.
    """
    standing = scenario.fixed
    ends = [scenario.start[:2], scenario.goal[:2]]
    corners = ends if scenario.grid is None else np.vstack([ends, scenario.grid.corners])
    x, y, columns, rows = grid_over(standing, corners, MARGIN, cell)
    if columns * rows > MOST_NODES:
        raise ValueError(
            f"shortest_ways: scenario {scenario.name!r} is {cell * columns:.0f} m x {cell * rows:.0f} m; a teacher who "
            f"knows the way needs a world of at most {MOST_NODES:,} cells of {cell:g} m"
        )
    spare = np.ascontiguousarray(clearances(standing, x, y, cell, columns, rows).T)
    if scenario.grid is not None:
        row, column = np.indices(spare.shape)
        nodes = np.column_stack([x + cell * column.ravel(), y + cell * row.ravel()])
        spare = np.minimum(spare, scenario.grid.clearances(nodes).reshape(spare.shape))
    spare -= hull_radius
    price = np.where(
        spare < (0.0 if dear else -0.5 * cell), 10.0, 1.0 + (np.clip(1.0 - spare / dear, 0.0, 1.0) if dear else 0.0)
    )
    ways = np.full((rows, columns), np.inf)
    low = np.array([x, y])
    column, row = np.rint((scenario.goal[:2] - low) / cell).astype(int).tolist()
    ways[row, column] = 0.0
    sweep(cell * price, ways)
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
def left_from(lengths, shapes, origins, scenarios, xs, ys, left, cell=CELL):
    """Fills the ways left (b,) from positions: between nodes, in proportion."""
    for i in range(left.shape[0]):
        k = scenarios[i]
        first = shapes[k, 0]
        rows = shapes[k, 1]
        columns = shapes[k, 2]
        u = min(max((xs[i] - origins[k, 0]) / cell, 0.0), columns - 1.001)
        v = min(max((ys[i] - origins[k, 1]) / cell, 0.0), rows - 1.001)
        column = int(u)
        row = int(v)
        u -= column
        v -= row
        at = first + row * columns + column
        low = (1.0 - u) * lengths[at] + u * lengths[at + 1]
        high = (1.0 - u) * lengths[at + columns] + u * lengths[at + columns + 1]
        left[i] = (1.0 - v) * low + v * high


@allocating
def manoeuvre_from(poses, goals, radius, left):
    """Fills the lengths (b,), m, of the shortest ways of a car from poses (b, 3) to others."""
    plan = np.empty((PLAN, 2))
    for i in range(left.shape[0]):
        left[i] = plan_to(poses[i], goals[i], radius, 0.0, plan)
