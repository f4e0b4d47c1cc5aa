"""Random obstacle fields, each checked by search to leave a way for the robot's hull."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.scenarios.obstacles import box, circle, obstacle_field, wall
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.envs.world.geometry import clearance_to
from wayfield.system.checks import number
from wayfield.system.compiled import allocating, compiled

BANK_SIZE = 64  # scenarios of a random family
HALF_SIDE = 5.0  # m, of the walled square
_SEED = 20_240_601  # fixed, so that a name means the same fields in every process
_DRAWS = 200 * BANK_SIZE  # a hull that has found no field by then is too large for them
_DISTANCES = (6.0, 9.0)  # m, between start and goal in the walled square
_ROOM = 0.1  # m, kept around the hull at start and goal
_GRID = 0.1  # m
# Clearance changes by at most a metre per metre: a node with half a grid step to spare, and a neighbour like
# it, are joined by a straight line that is clear all along.
_MARGIN = _GRID / 2.0

_BORDER = (
    wall(-HALF_SIDE, -HALF_SIDE, HALF_SIDE, -HALF_SIDE),
    wall(HALF_SIDE, -HALF_SIDE, HALF_SIDE, HALF_SIDE),
    wall(HALF_SIDE, HALF_SIDE, -HALF_SIDE, HALF_SIDE),
    wall(-HALF_SIDE, HALF_SIDE, -HALF_SIDE, -HALF_SIDE),
)


def open_field(hull_radius: float) -> tuple[GoalScenario, ...]:
    """Returns 64 random pairs of start and goal, 3 to 6 m apart, with nothing in between."""
    del hull_radius  # nothing to be clear of
    rng = np.random.default_rng(_SEED)
    scenarios = []
    for i in range(BANK_SIZE):
        x, y = rng.uniform(-3.0, 3.0, 2).tolist()
        distance, bearing = rng.uniform(3.0, 6.0), rng.uniform(-math.pi, math.pi)
        scenarios.append(
            GoalScenario(
                f"open_field_{i}",
                goal=(x + distance * math.cos(bearing), y + distance * math.sin(bearing), _heading(rng)),
                start=(x, y, _heading(rng)),
            )
        )
    return tuple(scenarios)


def discs(hull_radius: float) -> tuple[GoalScenario, ...]:
    """Returns 64 walled squares with 12 random circles; see `random_fields` for what they have in common."""
    return random_fields("discs", hull_radius, lambda rng: [_random_circle(rng) for _ in range(12)])


def mixed(hull_radius: float) -> tuple[GoalScenario, ...]:
    """Returns 64 walled squares with 5 circles, 4 turned boxes and 3 interior walls; see `random_fields`."""
    return random_fields(
        "mixed",
        hull_radius,
        lambda rng: [
            *(_random_circle(rng) for _ in range(5)),
            *(_random_box(rng) for _ in range(4)),
            *(_random_wall(rng) for _ in range(3)),
        ],
    )


def random_fields(
    name: str, hull_radius: float, draw_obstacles: Callable[[np.random.Generator], list[np.void]]
) -> tuple[GoalScenario, ...]:
    """Returns 64 scenarios in a walled square of 10 x 10 m around the origin, each with a way to the goal.

    Start and goal are 6 to 9 m apart with 0.1 m to spare around the hull. The same for every call.

    Args:
        name: of the family; a number is appended for each scenario.
        hull_radius: m, the robot's.
        draw_obstacles: returns the obstacles within the walls.

    Raises:
        ValueError: if next to no field has room for the hull.
    """
    reach = HALF_SIDE - number("hull_radius", hull_radius, above=0.0) - _ROOM
    rng = np.random.default_rng(_SEED)
    scenarios: list[GoalScenario] = []
    for _ in range(_DRAWS if 2.0 * math.sqrt(2.0) * reach > _DISTANCES[0] else 0):
        x0, y0, x1, y1 = rng.uniform(-reach, reach, 4).tolist()
        start, goal = (x0, y0, _heading(rng)), (x1, y1, _heading(rng))
        if not _DISTANCES[0] <= math.hypot(x1 - x0, y1 - y0) <= _DISTANCES[1]:
            continue
        obstacles = obstacle_field(*_BORDER, *draw_obstacles(rng))
        room = hull_radius + _ROOM
        clear_ends = has_room(obstacles, x0, y0, room) and has_room(obstacles, x1, y1, room)
        if clear_ends and way_exists(obstacles, x0, y0, x1, y1, hull_radius + _MARGIN):
            scenarios.append(GoalScenario(f"{name}_{len(scenarios)}", goal, start, obstacles=obstacles))
            if len(scenarios) == BANK_SIZE:
                return tuple(scenarios)
    raise ValueError(f"hull_radius is {hull_radius:g}; {name!r} has no {BANK_SIZE} fields with room for it")


@compiled
def has_room(obstacles: NDArray[np.void], x: float, y: float, needed: float) -> bool:
    """Returns whether (x, y) has `needed` (m) of clearance to obstacles (OBSTACLE records, shape (m,))."""
    for j in range(len(obstacles)):  # noqa: SIM110 - not every Numba compiles all() of a generator
        if clearance_to(obstacles[j], x, y) < needed:
            return False
    return True


@allocating
def way_exists(obstacles: NDArray[np.void], x0: float, y0: float, x1: float, y1: float, needed: float) -> bool:
    """Returns whether a grid of 0.1 m over the walled square joins two points (m) along clear nodes.

    Flood fill over the four neighbours, from the node nearest to (x0, y0) to the one nearest to (x1, y1). A
    node is clear when it has `needed` (m) of clearance to the obstacles (OBSTACLE records, shape (m,)).
    """
    n = round(2.0 * HALF_SIDE / _GRID) + 1
    target = round((x1 + HALF_SIDE) / _GRID) * n + round((y1 + HALF_SIDE) / _GRID)
    seen = np.zeros(n * n, np.bool_)
    waiting = np.empty(n * n + 1, np.int64)
    waiting[0] = round((x0 + HALF_SIDE) / _GRID) * n + round((y0 + HALF_SIDE) / _GRID)
    seen[waiting[0]] = True
    size = 1
    while size > 0:
        size -= 1
        node = waiting[size]
        i = node // n
        j = node - i * n
        if not has_room(obstacles, i * _GRID - HALF_SIDE, j * _GRID - HALF_SIDE, needed):
            continue
        if node == target:
            return True
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            if 0 <= i + di < n and 0 <= j + dj < n:
                neighbour = node + di * n + dj
                if not seen[neighbour]:
                    seen[neighbour] = True
                    waiting[size] = neighbour
                    size += 1
    return False


def _heading(rng: np.random.Generator) -> float:
    return float(rng.uniform(-math.pi, math.pi))


def _random_circle(rng: np.random.Generator) -> np.void:
    x, y = rng.uniform(-4.2, 4.2, 2).tolist()
    return circle(x, y, rng.uniform(0.2, 0.5))


def _random_box(rng: np.random.Generator) -> np.void:
    x, y = rng.uniform(-4.0, 4.0, 2).tolist()
    length, width = rng.uniform(0.3, 1.2, 2).tolist()
    return box(x, y, length, width, _heading(rng))


def _random_wall(rng: np.random.Generator) -> np.void:
    x, y = rng.uniform(-3.5, 3.5, 2).tolist()
    half, heading = rng.uniform(0.5, 1.25), _heading(rng)
    dx, dy = half * math.cos(heading), half * math.sin(heading)
    return wall(x - dx, y - dy, x + dx, y + dy)
