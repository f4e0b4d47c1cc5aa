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


@inlined
def moves(obstacle):
    """Returns whether an OBSTACLE record moves by its script."""
    return obstacle.patrol.leg_time > 0.0


@compiled
def motion_at(obstacle, time):
    """Returns (x, y, vx, vy), m and m/s, of a moving obstacle's centre `time` seconds into the episode."""
    patrol = obstacle.patrol
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


def turns(obstacles: NDArray[np.void]) -> NDArray[np.float64]:
    """Returns the places (k, 2, 2), m, between which the k go that move of OBSTACLE records (m,)."""
    moving = obstacles["patrol"][obstacles["patrol"]["leg_time"] > 0.0]
    begin = np.column_stack([moving["x"], moving["y"]])
    leg = moving["leg_time"][:, None] * np.column_stack([moving["vx"], moving["vy"]])
    return np.stack([begin, begin + leg], axis=1)


@inlined
def any_moves(obstacles, i, count):
    """Returns whether one of the first `count` obstacles (b, m) of row i moves."""
    moving = False
    for j in range(count):
        moving = moving or moves(obstacles[i, j])
    return moving


@inlined
def go_on(obstacles, i, count, time):
    """Puts those of the first `count` obstacles (b, m) of row i, or None, that move where they are at a time (s)."""
    if obstacles is not None:
        for j in range(count):
            if moves(obstacles[i, j]):
                obstacles[i, j].x, obstacles[i, j].y, _, _ = motion_at(obstacles[i, j], time)
