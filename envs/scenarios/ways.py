"""Ways for a disc through a goal scenario, found by search on a fine grid.

The clearance of a point changes by at most a metre per metre. On the straight line of length d between two nodes with
clearances a and b it is therefore nowhere below (a + b - d)/2: a way along such lines is proven for a disc of that
radius, not only likely.
"""

import functools
import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.envs.world.geometry import clearance
from wayfield.system.compiled import allocating, compiled, inlined

STEP = (
    0.02  # m, of the grid: a door of 0.65 m is then proven for a disc of 0.3 m; larger where there would be more than
)
MOST_NODES = 4_000_000
_AROUND = 1.2  # m, that the grid goes beyond all that stands
_WIDEST = 1.0  # m, wider ways are treated alike
_FINENESS = 1e-4  # m, of the clear radius


class Grid(NamedTuple):
    """The nodes of a search, row by row along y."""

    clear: NDArray[np.float64]  # (nx * ny,) clearances, m
    nx: int
    ny: int
    x: float  # of the first node, m
    y: float
    step: float  # m, between nodes


def clear_radius(scenario: GoalScenario, sweeping: bool = False, size: float = 1.0) -> float:
    """Returns the radius (m) of the largest disc that has a way from start to goal: proven, and at most 1 x size.

    Not above 0 when there is none.

    Args:
        scenario: its moving obstacles are left out, unless
        sweeping: takes them to be everywhere on their patrols at once.
        size: multiplies the step of the grid and what it goes beyond all that stands.
    """
    taken = taken_up(scenario, sweeping)
    ends = np.array([scenario.start[:2], scenario.goal[:2]])
    at_ends = [clearance(taken, len(taken), x, y) for x, y in ends.tolist()]
    if scenario.grid is not None:
        at_ends = np.minimum(at_ends, scenario.grid.clearances(ends)).tolist()
    grid = _grid(scenario, sweeping and bool(scenario.moving.any()), size)
    return float(_clear_radius(grid, ends, np.array(at_ends), _WIDEST * size))


def way_length(
    scenario: GoalScenario, hull_radius: float, start: tuple[float, float] | None = None, size: float = 1.0
) -> float:
    """Returns the length (m) of the shortest way of a disc to the goal, past what stands; inf when there is none.

    By the eikonal equation on the grid (Sethian, PNAS 1996), at most some per cent long.

    Args:
        scenario: its moving obstacles are left out.
        hull_radius: m, of the disc.
        start: x, y (m) instead of the scenario's.
        size: as of `clear_radius`.
    """
    x, y = start or scenario.start[:2]
    return float(_way_length(_grid(scenario, False, size), x, y, *scenario.goal[:2], hull_radius))


def detour(scenario: GoalScenario, hull_radius: float) -> float:
    """Returns how much longer than the straight line the way of a disc is that follows that line until it is stopped.

    From there it takes the shortest way. 1 when the straight line is free; inf without a way.
    """
    (x0, y0), (x1, y1) = scenario.start[:2], scenario.goal[:2]
    standing = taken_up(scenario, False)
    step = STEP if scenario.grid is None else _grid(scenario, False).step
    straight = math.hypot(x1 - x0, y1 - y0)
    stop, run = (x0, y0), 0.0
    for s in np.arange(0.0, straight, 0.01).tolist():
        at = x0 + (x1 - x0) * s / straight, y0 + (y1 - y0) * s / straight
        room = clearance(standing, len(standing), *at)
        if scenario.grid is not None:
            room = min(room, scenario.grid.clearances(np.array([at]))[0])
        if room < hull_radius + 1.5 * step:  # the nodes around are still clear
            break
        stop, run = at, s
    else:
        return 1.0
    return (run + way_length(scenario, hull_radius, stop)) / straight


def taken_up(scenario: GoalScenario, sweeping: bool) -> NDArray[np.void]:
    """Returns the obstacles that stand, and with `sweeping` the capsules that the others sweep; OBSTACLE records."""
    taken = scenario.obstacles.copy()
    for obstacle in taken:
        patrol = obstacle["patrol"]
        dx, dy = patrol["vx"] * patrol["leg_time"], patrol["vy"] * patrol["leg_time"]
        length = math.hypot(dx, dy)
        if length > 0.0:
            obstacle["x"], obstacle["y"] = patrol["x"] + 0.5 * dx, patrol["y"] + 0.5 * dy
            obstacle["cos"], obstacle["sin"] = dx / length, dy / length
            obstacle["half_length"] = 0.5 * length
    return taken if sweeping else taken[~scenario.moving]


@functools.lru_cache(maxsize=2)  # one scenario is asked several things
def _grid(scenario: GoalScenario, sweeping: bool, size: float = 1.0) -> Grid:
    """Returns the nodes over obstacles, start and goal."""
    taken = taken_up(scenario, sweeping)
    ends = np.array([scenario.start[:2], scenario.goal[:2]])
    if scenario.grid is None:
        step = STEP * size
        x, y, nx, ny = grid_over(taken, ends, _AROUND * size, step)
        return Grid(clearances(taken, x, y, step, nx, ny).ravel(), nx, ny, x, y, step)
    ends = np.vstack([ends, scenario.grid.corners])
    x, y, nx, ny = grid_over(taken, ends, _AROUND, STEP)
    step = STEP * max(1.0, math.sqrt(nx * ny / MOST_NODES))
    x, y, nx, ny = grid_over(taken, ends, _AROUND, step)
    i, j = np.divmod(np.arange(nx * ny), ny)
    nodes = np.column_stack([x + i * step, y + j * step])
    clear = np.minimum(clearances(taken, x, y, step, nx, ny).ravel(), scenario.grid.clearances(nodes))
    return Grid(clear, nx, ny, x, y, step)


def grid_over(
    obstacles: NDArray[np.void], points: ArrayLike, margin: float, step: float
) -> tuple[float, float, int, int]:
    """Returns x, y (m) of the first node of a grid over obstacles and points (n, 2), and its nodes along x and y.

    It goes beyond them by `margin` (m); its nodes are `step` (m) apart.
    """
    cosine, sine = np.abs(obstacles["cos"]), np.abs(obstacles["sin"])
    along, across = obstacles["half_length"], obstacles["half_width"]
    reach = np.column_stack([cosine * along + sine * across, sine * along + cosine * across])
    reach += obstacles["radius"][:, None]
    centres = np.column_stack([obstacles["x"], obstacles["y"]])
    corners = np.vstack([points, centres - reach, centres + reach])
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
    nx, ny = (np.ceil((high - low) / step).astype(int) + 1).tolist()
    x, y = low.tolist()
    return x, y, nx, ny


@allocating
def clearances(obstacles, x, y, step, nx, ny):
    """Returns the clearance (nx, ny) of the nodes of a grid with its first node at (x, y), all in m."""
    clear = np.empty((nx, ny))
    for i in range(nx):
        for j in range(ny):
            clear[i, j] = clearance(obstacles, len(obstacles), x + i * step, y + j * step)
    return clear


@compiled
def _clear_radius(grid, ends, at_ends, widest):
    """Returns the largest radius for which the fill passes, by bisection."""
    high = min(widest, at_ends[0], at_ends[1])
    if _passes(grid, ends, at_ends, high):
        return high
    low = 0.0
    if not _passes(grid, ends, at_ends, low):
        return low
    while high - low > _FINENESS:
        middle = 0.5 * (low + high)
        if _passes(grid, ends, at_ends, middle):
            low = middle
        else:
            high = middle
    return low


@allocating
def _passes(grid, ends, at_ends, radius):
    """Returns whether lines that are clear for a disc join the start, by way of nodes, to the goal."""
    clear, nx, ny, x, y, step = grid
    near_goal = np.zeros(nx * ny, np.bool_)
    seen = np.zeros(nx * ny, np.bool_)
    waiting = np.empty(nx * ny, np.int64)
    size = 0
    for end in range(2):
        i = int((ends[end, 0] - x) / step)
        j = int((ends[end, 1] - y) / step)
        for node in (i * ny + j, i * ny + j + 1, (i + 1) * ny + j, (i + 1) * ny + j + 1):
            dx = x + (node // ny) * step - ends[end, 0]
            dy = y + (node % ny) * step - ends[end, 1]
            if 0.5 * (clear[node] + at_ends[end] - math.sqrt(dx * dx + dy * dy)) >= radius:
                if end == 1:
                    near_goal[node] = True
                else:
                    seen[node] = True
                    waiting[size] = node
                    size += 1
    while size > 0:
        size -= 1
        node = waiting[size]
        if near_goal[node]:
            return True
        i = node // ny
        j = node - i * ny
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                if 0 <= i + di < nx and 0 <= j + dj < ny:
                    other = node + di * ny + dj
                    gap = step * math.sqrt(di * di + dj * dj)
                    if not seen[other] and 0.5 * (clear[node] + clear[other] - gap) >= radius:
                        seen[other] = True
                        waiting[size] = other
                        size += 1
    return False


@inlined
def reached(a, b, cost):
    """Returns the eikonal equation's value at a node: `cost` a step, a and b the least neighbours along x and y.

    The upwind (Godunov) scheme: Rouy and Tourin, SIAM J. Numer. Anal. 29(3), 1992.
    """
    apart = abs(a - b)
    if apart < cost:
        return 0.5 * (a + b + math.sqrt(2.0 * cost * cost - apart * apart))
    return min(a, b) + cost


@allocating
def _way_length(grid, x0, y0, x1, y1, radius):
    """Returns the arrival time at (x0, y0) of a front from (x1, y1) with unit speed through the clear nodes."""
    clear, nx, ny, x, y, step = grid
    arrival = np.full(nx * ny, np.inf)
    done = np.zeros(nx * ny, np.bool_)
    front = [(0.0, 0)]
    front.pop()
    i0 = int((x1 - x) / step)
    j0 = int((y1 - y) / step)
    for i in range(max(i0 - 4, 0), min(i0 + 6, nx)):
        for j in range(max(j0 - 4, 0), min(j0 + 6, ny)):
            if clear[i * ny + j] >= radius:
                arrival[i * ny + j] = math.sqrt((x + i * step - x1) ** 2 + (y + j * step - y1) ** 2)
                heapq.heappush(front, (arrival[i * ny + j], i * ny + j))
    while len(front) > 0:
        time, node = heapq.heappop(front)
        if done[node]:
            continue
        done[node] = True
        i = node // ny
        j = node - i * ny
        gap = math.sqrt((x + i * step - x0) ** 2 + (y + j * step - y0) ** 2)
        if gap < 1.5 * step:
            return time + gap
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            p = i + di
            q = j + dj
            if not (0 <= p < nx and 0 <= q < ny):
                continue
            other = p * ny + q
            if done[other] or clear[other] < radius:
                continue
            a = min(arrival[other - ny] if p > 0 else np.inf, arrival[other + ny] if p < nx - 1 else np.inf)
            b = min(arrival[other - 1] if q > 0 else np.inf, arrival[other + 1] if q < ny - 1 else np.inf)
            new = reached(a, b, step)
            if new < arrival[other]:
                arrival[other] = new
                heapq.heappush(front, (new, other))
    return np.inf
