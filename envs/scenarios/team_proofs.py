"""Proofs that a team can reach its goals, whatever each robot does: by one turn of all, or one after another.

- Rigid turn: where every goal is its start mirrored at one centre, half a turn of the whole configuration keeps all
  distances. The longest way is pi R, where the straight one is 2 R.
- One after another: an order in which each robot has a way clear of the goals of those before it and of the starts of
  those behind it (well-formed: Cap, Vokrinek and Kleiner 2015), found greedily on a grid.
"""

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.scenarios.ways import clearances, grid_over
from wayfield.system.compiled import allocating, inlined

_FINE = 0.05  # m, between nodes; a way leads from node to node, each clear by what lies between
_ASIDE = 0.05  # m, that goals of a turn may lie beside the mirrored starts: the last move of each
_AROUND = 2.0  # m, beyond obstacles, starts and goals


def prove(scenario: TeamScenario, hull_radius: float) -> tuple[str, float]:
    """Returns what proves that discs can reach their goals, and the makespan over the longest straight way.

    ("", inf) when nothing was found. The makespan is that of robots at one speed.
    """
    starts, goals = scenario.starts[:, :2], scenario.goals[:, :2]
    longest = float(scenario.straight.max())
    turned, aside = _turn(starts, goals)
    if aside < _ASIDE and not len(scenario.obstacles) and _apart(starts) >= 2.0 * hull_radius + 4.0 * aside:
        return "rigid turn", (math.pi * turned + aside) / longest
    x, y, nx, ny = grid_over(scenario.obstacles, np.vstack([starts, goals]), _AROUND, _FINE)
    clear = clearances(scenario.obstacles, x, y, _FINE, nx, ny)
    total = float(_one_after_another(clear, x, y, _FINE, starts.copy(), goals.copy(), float(hull_radius)))
    return ("one after another", total / longest) if math.isfinite(total) else ("", math.inf)


def _turn(starts: NDArray[np.float64], goals: NDArray[np.float64]) -> tuple[float, float]:
    """Returns the largest distance (m) of a start from a centre, and how far goals are from starts mirrored there."""
    centre = 0.5 * (starts + goals).mean(axis=0)
    aside = np.sqrt(((goals + starts - 2.0 * centre) ** 2).sum(axis=1)).max()
    return float(np.sqrt(((starts - centre) ** 2).sum(axis=1)).max()), float(aside)


def _apart(places: NDArray[np.float64]) -> float:
    """Returns the least distance (m) of two places; inf of one."""
    gaps = np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2))
    np.fill_diagonal(gaps, np.inf)
    return float(gaps.min())


@allocating
def _one_after_another(clear, x, y, step, starts, goals, radius):
    """Returns the sum of the ways (m) of robots that drive one after another; inf when some have none."""
    n = starts.shape[0]
    nx, ny = clear.shape
    places = starts.copy()
    there = np.zeros(n, np.bool_)
    taken = np.zeros(nx * ny, np.int64)
    spare = 0.7072 * step
    free = np.empty(nx * ny, np.bool_)
    for i in range(nx):
        for j in range(ny):
            free[i * ny + j] = clear[i, j] >= radius + spare
    for k in range(n):
        _stamp(taken, nx, ny, x, y, step, places[k, 0], places[k, 1], 2.0 * radius + spare, 1)
    cost = np.empty(nx * ny)
    total = 0.0
    left = n
    while left > 0:
        moved = False
        for k in range(n):
            if there[k]:
                continue
            _stamp(taken, nx, ny, x, y, step, places[k, 0], places[k, 1], 2.0 * radius + spare, -1)
            way = _way(free, taken, cost, nx, ny, x, y, step, places[k], goals[k])
            if way < np.inf:
                total += way
                there[k] = True
                places[k] = goals[k]
                left -= 1
                moved = True
            _stamp(taken, nx, ny, x, y, step, places[k, 0], places[k, 1], 2.0 * radius + spare, 1)
        if not moved:
            return np.inf
    return total


@inlined
def _stamp(taken, nx, ny, x, y, step, px, py, reach, sign):
    """Counts the nodes within reach (m) of a place as taken once more, or once less."""
    i0 = max(math.floor((px - reach - x) / step), 0)
    i1 = min(math.ceil((px + reach - x) / step), nx - 1)
    j0 = max(math.floor((py - reach - y) / step), 0)
    j1 = min(math.ceil((py + reach - y) / step), ny - 1)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            dx = x + i * step - px
            dy = y + j * step - py
            if dx * dx + dy * dy < reach * reach:
                taken[i * ny + j] += sign


@allocating
def _way(free, taken, cost, nx, ny, x, y, step, start, goal):
    """Returns the length (m) of a shortest way along nodes that no other robot takes, by A*; inf if there is none."""
    a = math.floor((start[0] - x) / step + 0.5) * ny + math.floor((start[1] - y) / step + 0.5)
    b = math.floor((goal[0] - x) / step + 0.5) * ny + math.floor((goal[1] - y) / step + 0.5)
    if not free[a] or not free[b] or taken[a] > 0 or taken[b] > 0:
        return np.inf
    cost[:] = np.inf
    cost[a] = 0.0
    bi = b // ny
    bj = b % ny
    front = [(0.0, 0.0, a)]
    while len(front) > 0:
        _, gone, node = heapq.heappop(front)
        if node == b:
            return gone + 2.0 * step
        if gone > cost[node]:
            continue
        i = node // ny
        j = node - i * ny
        for di in range(-1, 2):
            for dj in range(-1, 2):
                p = i + di
                q = j + dj
                if (di == 0 and dj == 0) or not (0 <= p < nx and 0 <= q < ny):
                    continue
                other = p * ny + q
                if not free[other] or taken[other] > 0:
                    continue
                new = gone + step * math.sqrt(di * di + dj * dj)
                if new < cost[other]:
                    cost[other] = new
                    dx = abs(bi - p)
                    dy = abs(bj - q)
                    ahead = step * (max(dx, dy) + 0.41421356 * min(dx, dy))
                    heapq.heappush(front, (new + ahead, new, other))
    return np.inf
