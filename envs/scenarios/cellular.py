"""Random worlds of the BARN challenge's kind: cylinders in the cells that a cellular automaton leaves filled.

Start, goal, walls and cells lie as in the challenge's own worlds, of which none is among these: what is trained or
tuned here has not seen them.

Source: Perille, Truong, Xiao and Stone, Benchmarking metric ground navigation, SSRR 2020.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.scenarios.barn import CELL, GOAL, START, TOLERANCE
from wayfield.envs.scenarios.draws import Draw, rounded
from wayfield.envs.scenarios.obstacles import circle, obstacle_field
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.system.checks import number

BANK_SIZE = 32
SIDE = 30  # cells, of the square field
HALF_HULL = 2  # cells, that the Jackal takes up to each side of its own
_FILLS, _ROUNDS = (0.15, 0.2, 0.25, 0.3), (2, 3, 4)  # of the automaton: each pair is as frequent
_FULL, _EMPTY = 5, 1  # neighbours of eight from which on a cell is filled, and up to which it is emptied
_FIRST = (-4.425, 5.175)  # m, x and y of the field's first cylinder
_WALL = 64  # cylinders of a side wall
_LEAST = 0.36  # m, of the disc that passes: the narrowest of the published worlds


def cellular(hull_radius: float) -> tuple[GoalScenario, ...]:
    """Returns 32 worlds, those of the seeds 0 to 31.

    Raises:
        ValueError: if the hull (m) is larger than what passes in each of them.
    """
    if number("hull_radius", hull_radius, above=0.0) > _LEAST:
        raise ValueError(f"hull_radius is {hull_radius:g}; 'cellular' leaves a way for at most {_LEAST:g} m")
    return tuple(map(cellular_world, range(BANK_SIZE)))


def cellular_world(seed: int) -> GoalScenario:
    """Returns the world of a seed: from (-2.25, 3), facing +y, to within 1 m of the point 10 m ahead.

    Cells of 0.15 m are filled at random and smoothed, until a square of five cells can be moved through the field.
    """
    draw = Draw("cellular", seed)
    fill, rounds = _FILLS[draw.whole(0, 3)], _ROUNDS[draw.whole(0, 2)]
    filled = grown(draw, fill, rounds)
    while not passable(filled):
        filled = grown(draw, fill, rounds)
    x0, y0 = _FIRST
    low = y0 - CELL * (_WALL - SIDE)
    places = [(x0 + CELL * i, low) for i in range(SIDE)]
    places += [(x0 + CELL * i, low + CELL * j) for i in (0, SIDE - 1) for j in range(1, _WALL)]
    places += [(x0 + CELL * (i + 1), y0 + CELL * j) for i, j in np.argwhere(filled[1:-1])]
    return GoalScenario(
        f"cellular_{seed}",
        goal=GOAL,
        start=START,
        obstacles=obstacle_field(*(circle(rounded(float(x)), rounded(float(y)), CELL / 2.0) for x, y in places)),
        position_tolerance=TOLERANCE,
        heading_tolerance=math.pi,
        family="cellular",
    )


def grown(draw: Draw, fill: float, rounds: int) -> NDArray[np.bool_]:
    """Returns which cells (across, ahead) are filled: at random, then smoothed by their neighbours; walls beside."""
    filled = np.reshape(draw.chances(fill, SIDE * SIDE), (SIDE, SIDE))
    filled[[0, -1]] = True
    for _ in range(rounds):
        around = np.pad(filled.astype(np.int64), 1)
        around[[0, -1]] = 1
        beside = [around[i : i + SIDE, j : j + SIDE] for i in range(3) for j in range(3) if (i, j) != (1, 1)]
        count = np.sum(beside, axis=0)
        filled = (filled & (count > _EMPTY)) | (count >= _FULL)
    return filled


def passable(filled: NDArray[np.bool_]) -> bool:
    """Returns whether a square of five cells can be moved from the field's first row of cells ahead to its last."""
    around = np.pad(filled, HALF_HULL)
    width = 2 * HALF_HULL + 1
    free = ~np.any([around[i : i + SIDE, j : j + SIDE] for i in range(width) for j in range(width)], axis=0)
    reached = np.zeros_like(free)
    reached[:, 0] = free[:, 0]
    while True:
        more = reached.copy()
        more[1:] |= reached[:-1]
        more[:-1] |= reached[1:]
        more[:, 1:] |= reached[:, :-1]
        more[:, :-1] |= reached[:, 1:]
        more &= free
        if np.array_equal(more, reached):
            return bool(reached[:, -1].any())
        reached = more
