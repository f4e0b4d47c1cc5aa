"""Obstacles that move by a script: to and fro between two points, whatever the robot does."""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.system.compiled import compiled, inlined

PATROL = np.dtype(
    [
        ("x", np.float64),  # m, where the first leg begins
        ("y", np.float64),
        ("vx", np.float64),  # m/s, on the first leg; the next is the way back
        ("vy", np.float64),
        ("leg_time", np.float64),  # s, after which the obstacle turns back; 0: it does not move
        ("phase", np.float64),  # s, how far into its patrol it is when the episode starts
    ]
)


@compiled
def patrol_at(patrol, time):
    """Returns (x, y, vx, vy), m and m/s, of a moving obstacle's centre `time` seconds into the episode."""
    elapsed = time + patrol.phase
    leg = math.floor(elapsed / patrol.leg_time)
    along = elapsed - leg * patrol.leg_time
    way = 1.0
    if leg - 2.0 * math.floor(0.5 * leg) == 1.0:
        along = patrol.leg_time - along
        way = -1.0
    return (
        patrol.x + along * patrol.vx,
        patrol.y + along * patrol.vy,
        way * patrol.vx,
        way * patrol.vy,
    )


def turns(patrols: NDArray[np.void]) -> NDArray[np.float64]:
    """Returns the places (k, 2, 2), m, between which the k obstacles go that move; patrols: (m,) PATROL records."""
    moving = patrols[patrols["leg_time"] > 0.0]
    begin = np.column_stack([moving["x"], moving["y"]])
    leg = moving["leg_time"][:, None] * np.column_stack([moving["vx"], moving["vy"]])
    return np.stack([begin, begin + leg], axis=1)


@inlined
def any_moves(patrols, row, count):
    """Returns whether one of the first `count` obstacles of a row of PATROL records moves."""
    found = False
    for j in range(count):
        found = found or patrols[row, j].leg_time > 0.0
    return found


@inlined
def patrol(patrols, scenario, obstacles, i, count, time):
    """Puts the moving ones of the first `count` obstacles of row i where they are `time` seconds into the episode.

    Args:
        patrols: (scenarios, m) PATROL records, parallel to the obstacles.
        obstacles: (b, m) OBSTACLE records.
    """
    for j in range(count):
        if patrols[scenario, j].leg_time > 0.0:
            obstacles[i, j].x, obstacles[i, j].y, _, _ = patrol_at(patrols[scenario, j], time)
