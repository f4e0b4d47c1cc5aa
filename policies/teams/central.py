"""A central planner of teams, the upper reference: one who is told all goals plans the ways of all robots in time."""

import dataclasses
import heapq
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import team_worlds
from wayfield.envs.scenarios.ways import clearances, grid_over
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import CrowdLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.steering import driven_by_point
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import sin_cos

KNOTS = 256  # of a robot's plan, at most
_AROUND = 1.5  # m, of the grid beyond all that is on it
_NODES = 250  # along a side of the grid, at most: larger worlds have larger cells
_EXPANDED = 300_000  # nodes of a search in space and time, at most
_BUCKET = 0.2  # s, within which two arrivals at a node are alike
_WAIT = 0.25  # s
_LONGEST = 120.0  # s, of a plan
_PATIENCE = 5.0  # s, for which all wait for one who is behind
_FORESEEN = 1.0  # s, of bends that the clock slows down for
_ROUNDS = 3  # times the robots of a world: how often one that found no way is moved to the front

MEMORY = np.dtype(
    [
        ("knots", np.int64),  # of its plan; 0: none was found
        ("planned", np.int64),
        ("time", np.float64),  # s, on the clock of the plans of its world
        ("late", np.float64),  # s, for which it has been behind: who never comes is not waited for
        ("at", np.float64, (KNOTS,)),  # s
        ("x", np.float64, (KNOTS,)),  # m
        ("y", np.float64, (KNOTS,)),
    ],
    align=True,
)


@dataclasses.dataclass(frozen=True)
class Central(CrowdLaw):
    """Plans the ways of all robots of a world once, in space and time, and drives them by one clock.

    Prioritized planning: the robots, those with the longest ways first, are planned one by one by A* over (place,
    time), on a grid with sixteen directions, keeping 2 R + margin from the motion of all that were planned before. One
    that finds no way is moved to the front, and all are planned anew. Bends that neither walls nor others ask for are
    pulled straight. Who has arrived is taken to leave.

    A robot, or the point `ahead` (L) of the axle of a differential drive, with a disc of R + L, follows its plan by

        u = s dp/dt(t + lag of the base) + k (p(t) - x),    dt' = s dt,    s = min(max(0, 1 - e / lag), s_bend)

    where e is the largest error |p - x| of those who have not arrived: all wait for who is late, so that the plans
    hold, but no longer than 5 s for one who does not come. s_bend is so slow that what the base can accelerate cuts no
    bend of anybody's plan within the next second by more than `cut`.

    It is the upper reference of teams: it has access to the map, all goals and all poses ("team_map"), which nobody
    else is told. It is not the shortest makespan, and finds no plan where only a joint search would: who has none
    stands. People and what moves by itself are no part of its plans, nor are maps of cells.

    Planning takes time: in five worlds each of eight families all of 8 to 32 robots arrived, after 0.1 to 10 s of
    planning a world, but before one door 32 take minutes. The page does not drive it: what lays its grid is not
    compiled.

    Source: Erdmann and Lozano-Perez, Algorithmica 2, 1987; Silver, AIIDE 2005; Cap, Vokrinek and Kleiner, ICAPS 2015.
    """

    cell: float = gain(0.1, "m", "of the grid", above=0.0)
    margin: float = gain(0.08, "m", "kept between hulls", least=0.0)
    wall_margin: float = gain(0.05, "m", "kept between hull and what stands", least=0.0)
    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    pace: float = gain(0.95, "1", "of that speed, of the plans: what is left makes up for errors", above=0.0, most=1.0)
    k: float = gain(2.0, "1/s", "velocity per metre from the plan", above=0.0)
    lag: float = gain(0.1, "m", "from the plan, at which its clock stands", above=0.0)
    cut: float = gain(0.03, "m", "by which bends are cut, at most", above=0.0)
    ahead: float = gain(0.1, "m", "of the axle, of the point that a differential drive is driven by", above=0.0)

    knows: ClassVar[str] = "team_map"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns MEMORY records (b,)."""
        return np.zeros(briefing.num_envs, MEMORY)

    def act(self, observation: team_worlds.Observation, briefing: Briefing, memory: NDArray[Any]) -> NDArray[Any]:
        """Returns the twists (b, t): m/s and rad/s.

        Raises:
            ValueError: if the rows are no whole number of worlds.
        """
        if len(memory) % briefing.team:
            raise ValueError(
                f"rows are {len(memory)}; they must be a multiple of {briefing.team}, the robots of a world"
            )
        robot = briefing.robot
        poses = np.ascontiguousarray(observation.pose)
        assert briefing.position_tolerance is not None
        there = np.sqrt((observation.goal**2).sum(axis=-1)) <= briefing.position_tolerance
        there &= observation.waypoints_left == 0.0
        ahead = 0.0 if robot.holonomic else self.ahead
        p = params(self, briefing, ahead=ahead, max_yaw_rate=float(robot.max_twist[-1]))
        unplanned = (memory["planned"] == 0).reshape(-1, briefing.team).any(axis=1)
        for w in np.flatnonzero(unplanned).tolist():
            rows = slice(w * briefing.team, (w + 1) * briefing.team)
            self._plan(p, briefing, rows, poses[rows], memory[rows])
        out = np.zeros((len(memory), len(robot.twist_axes)))
        follow(p, poses, there, memory, briefing.team, out)
        return out

    def _plan(
        self, p: NDArray[Any], briefing: Briefing, rows: slice, poses: NDArray[Any], memory: NDArray[Any]
    ) -> None:
        """Plans for all robots of a world, from where they are."""
        assert briefing.goal is not None
        assert briefing.map is not None
        ahead = p["ahead"][0]
        starts = poses[:, :2] + ahead * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        last = briefing.goal.num_goals[rows] - 1
        goals = np.ascontiguousarray(briefing.goal.goals[rows][np.arange(len(poses)), last, :2])
        obstacles = briefing.map.obstacles[rows][0][: briefing.map.counts[rows][0]]
        points = np.vstack([starts, goals])
        extent = float((points.max(axis=0) - points.min(axis=0)).max())
        cell = max(self.cell, (extent + 2.0 * _AROUND) / _NODES)
        grid = (*grid_over(obstacles, points, _AROUND, cell), cell)
        x, y, nx, ny, _ = grid
        clear = clearances(np.ascontiguousarray(obstacles), x, y, cell, nx, ny)
        memory["planned"], memory["knots"], memory["time"], memory["late"] = 1, 0, 0.0, 0.0
        plan_all(p, clear, grid, np.ascontiguousarray(starts), goals, memory)


@any_layout
@compiled
def follow(params, poses, there, memory, team, out):
    """Fills the (b, t) twists of `Central`, and moves the clocks on."""
    p = params[0]
    ahead = p.ahead
    for first in range(0, poses.shape[0], team):
        worst = 0.0
        slowest = 1.0
        for i in range(first, first + team):
            m = memory[i]
            if m.knots > 0 and not there[i]:
                slowest = min(slowest, rate_before_bends(p, m))
                sine, cosine = sin_cos(poses[i, 2])
                x, y, _, _ = planned(m, m.time)
                dx = x - poses[i, 0] - ahead * cosine
                dy = y - poses[i, 1] - ahead * sine
                error = math.sqrt(dx * dx + dy * dy)
                m.late = m.late + p.plant.dt if error > 0.5 * p.lag else 0.0
                if m.late < _PATIENCE:
                    worst = max(worst, error)
        rate = min(max(0.0, 1.0 - worst / p.lag), slowest)
        for i in range(first, first + team):
            m = memory[i]
            if m.knots == 0:
                continue
            sine, cosine = sin_cos(poses[i, 2])
            x, y, _, _ = planned(m, m.time)
            vx, vy = velocity_ahead(p, m, rate)
            ux = rate * vx + p.k * (x - poses[i, 0] - ahead * cosine)
            uy = rate * vy + p.k * (y - poses[i, 1] - ahead * sine)
            factor = min(1.0, p.max_speed / max(math.sqrt(ux * ux + uy * uy), 1e-12))
            forward = factor * (cosine * ux + sine * uy)
            left = factor * (cosine * uy - sine * ux)
            m.time += rate * p.plant.dt
            out[i, 0], out[i, 1] = driven_by_point(p, forward, left)


@inlined
def planned(m, time):
    """Returns (x, y, vx, vy) of a plan at a time; it stands at its last place from then on."""
    last = m.knots - 1
    if time >= m.at[last]:
        return m.x[last], m.y[last], 0.0, 0.0
    k = knot_before(m.at, m.knots, time)
    span = m.at[k + 1] - m.at[k]
    vx = (m.x[k + 1] - m.x[k]) / span
    vy = (m.y[k + 1] - m.y[k]) / span
    return m.x[k] + (time - m.at[k]) * vx, m.y[k] + (time - m.at[k]) * vy, vx, vy


@inlined
def nimbleness(p):
    """Returns the acceleration (m/s^2) of the point that is driven: sideways, a differential drive's turn gives it."""
    if p.ahead > 0.0:
        return min(p.plant.acceleration, p.plant.yaw_acceleration * p.ahead)
    return p.plant.acceleration


@inlined
def bend_at(m, k):
    """Returns the size (m/s) of the change of velocity at an inner knot of a plan."""
    before = m.at[k] - m.at[k - 1]
    after = m.at[k + 1] - m.at[k]
    dx = (m.x[k + 1] - m.x[k]) / after - (m.x[k] - m.x[k - 1]) / before
    dy = (m.y[k + 1] - m.y[k]) / after - (m.y[k] - m.y[k - 1]) / before
    return math.sqrt(dx * dx + dy * dy)


@inlined
def velocity_ahead(p, m, rate):
    """Returns the velocity of a plan (m/s) that the base shall take up now, since it takes it up late.

    A bend is begun so early that half of its change of velocity is made when it is reached.
    """
    if m.knots > 2 and m.time < m.at[m.knots - 1]:
        k = knot_before(m.at, m.knots, m.time) + 1
        if k < m.knots - 1:
            early = p.plant.lag + 0.5 * p.plant.dt + 0.5 * rate * bend_at(m, k) / nimbleness(p)
            if m.at[k] - m.time < rate * early:
                _, _, vx, vy = planned(m, m.at[k])
                return vx, vy
    _, _, vx, vy = planned(m, m.time)
    return vx, vy


@inlined
def rate_before_bends(p, m):
    """Returns how fast the clock may run, so that a base cuts the next bends of a plan by no more than `cut`.

    A base that turns from one velocity to another with an acceleration a passes the bend at dv^2 / (8 a).
    """
    most = math.sqrt(8.0 * nimbleness(p) * p.cut)
    braking = 0.5 * nimbleness(p) / p.max_speed
    rate = 1.0
    if m.time >= m.at[m.knots - 1]:
        return rate
    k = knot_before(m.at, m.knots, m.time) + 1
    while k < m.knots - 1 and m.at[k] < m.time + _FORESEEN:
        bend = bend_at(m, k)
        if bend > most:
            there = most / bend
            rate = min(rate, math.sqrt(there * there + 2.0 * braking * (m.at[k] - m.time)))
        k += 1
    return rate


@inlined
def knot_before(at, count, time):
    """Returns the last knot, but for the end, that is not after a time."""
    low = 0
    high = count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if at[middle] <= time:
            low = middle
        else:
            high = middle
    return low


@allocating
def plan_all(params, clear, grid, starts, goals, memory):
    """Plans for all robots, one after another; a robot that finds no way comes first in the next round."""
    p = params[0]
    n = starts.shape[0]
    _, _, nx, ny, cell = grid
    radius = p.plant.hull_radius + p.ahead
    free = np.empty(nx * ny, np.bool_)
    ahead = np.empty(nx * ny)
    reached = np.zeros(nx * ny * (math.ceil(_LONGEST / _BUCKET) + 1), np.uint8)
    order = np.empty(n, np.int64)
    length = np.empty(n)
    for i in range(n):
        length[i] = -((goals[i, 0] - starts[i, 0]) ** 2 + (goals[i, 1] - starts[i, 1]) ** 2)
    order[:] = np.argsort(length, kind="mergesort")
    done = np.zeros(n, np.bool_)
    for turn in range(_ROUNDS * n + 1):
        done[:] = False
        failed = -1
        for o in range(n):
            i = order[o]
            a = node_at(grid, starts[i, 0], starts[i, 1])
            b = node_at(grid, goals[i, 0], goals[i, 1])
            # a robot that stands or ends nearer to what stands may be as near on its way
            room = min(radius + p.wall_margin, clear[a // ny, a % ny], clear[b // ny, b % ny])
            for k in range(nx * ny):
                free[k] = clear[k // ny, k % ny] >= room
            way_lengths(free, nx, ny, cell, b, ahead)
            if ahead[a] < np.inf and search(
                p, (clear, room), free, ahead, reached, grid, a, b, starts, goals, i, done, memory
            ):
                done[i] = True
            elif failed < 0:
                failed = o
                break
        if failed < 0:
            return
        if turn == _ROUNDS * n:
            break
        i = order[failed]
        for o in range(failed, 0, -1):
            order[o] = order[o - 1]
        order[0] = i
        if failed == 0:
            return  # not even alone
    return


@inlined
def node_at(grid, px, py):
    """Returns the node nearest to a place."""
    x, y, nx, ny, cell = grid
    i = min(max(math.floor((px - x) / cell + 0.5), 0), nx - 1)
    j = min(max(math.floor((py - y) / cell + 0.5), 0), ny - 1)
    return i * ny + j


@inlined
def direction(d):
    """Returns the step (di, dj) of one of sixteen directions: eight neighbours, and eight a knight's move away."""
    if d < 8:
        k = d if d < 4 else d + 1
        return k // 3 - 1, k % 3 - 1
    k = d - 8
    long, short = (2, 1) if k < 4 else (1, 2)
    return (long if k % 2 == 0 else -long), (short if k // 2 % 2 == 0 else -short)


@inlined
def passable(free, nx, ny, i, j, di, dj):
    """Returns whether a move keeps to free nodes, those beside a knight's move too."""
    p = i + di
    q = j + dj
    if not (0 <= p < nx and 0 <= q < ny) or not free[p * ny + q]:
        return False
    if abs(di) + abs(dj) < 3:
        return True
    si = 1 if di > 0 else -1
    sj = 1 if dj > 0 else -1
    straight = free[(i + si) * ny + j] if abs(di) == 2 else free[i * ny + j + sj]
    return straight and free[(i + si) * ny + j + sj]


@allocating
def way_lengths(free, nx, ny, cell, goal, out):
    """Fills the lengths (m) of the shortest ways of all nodes to one, in sixteen directions."""
    out[:] = np.inf
    out[goal] = 0.0
    front = [(0.0, goal)]
    while len(front) > 0:
        gone, node = heapq.heappop(front)
        if gone > out[node]:
            continue
        i = node // ny
        j = node - i * ny
        for d in range(16):
            di, dj = direction(d)
            if passable(free, nx, ny, i, j, di, dj):
                other = (i + di) * ny + j + dj
                new = gone + cell * math.sqrt(di * di + dj * dj)
                if new < out[other]:
                    out[other] = new
                    heapq.heappush(front, (new, other))


@compiled
def keeps_clear(memory, done, apart, x0, y0, t0, x1, y1, t1):
    """Returns whether a motion along a line keeps its distances (m) from the plans of those that are done."""
    for j in range(done.shape[0]):
        m = memory[j]
        if not done[j] or t0 >= m.at[m.knots - 1]:
            continue
        least = apart[j] * apart[j]
        k = knot_before(m.at, m.knots, t0)
        span = max(t1 - t0, 1e-9)
        vx = (x1 - x0) / span
        vy = (y1 - y0) / span
        while k < m.knots - 1 and m.at[k] < t1:
            begin = max(t0, m.at[k])
            end = min(t1, m.at[k + 1])
            width = m.at[k + 1] - m.at[k]
            wx = (m.x[k + 1] - m.x[k]) / width
            wy = (m.y[k + 1] - m.y[k]) / width
            dx = x0 + (begin - t0) * vx - m.x[k] - (begin - m.at[k]) * wx
            dy = y0 + (begin - t0) * vy - m.y[k] - (begin - m.at[k]) * wy
            rx = vx - wx
            ry = vy - wy
            speed = rx * rx + ry * ry
            share = 0.0
            if speed > 1e-18:
                share = min(max(-(dx * rx + dy * ry) / speed, 0.0), end - begin)
            dx += share * rx
            dy += share * ry
            if dx * dx + dy * dy < least:
                return False
            k += 1
    return True


@allocating
def search(p, walls, free, ahead, reached, grid, a, b, starts, goals, i, done, memory):
    """Plans for robot i from node a to node b by A* over node and time; returns whether there is a way."""
    x, y, nx, ny, cell = grid
    n = done.shape[0]
    speed = p.pace * p.max_speed
    apart = np.empty(n)
    usual = 2.0 * (p.plant.hull_radius + p.ahead) + p.margin
    for j in range(n):
        # who stands nearer at the start may be as near from then on
        gap = math.sqrt((starts[i, 0] - starts[j, 0]) ** 2 + (starts[i, 1] - starts[j, 1]) ** 2)
        apart[j] = max(min(usual, gap - 1.5 * cell), 2.0 * p.plant.hull_radius)
    buckets = math.ceil(_LONGEST / _BUCKET) + 1
    reached[:] = 0
    nodes = np.empty(_EXPANDED, np.int64)
    times = np.empty(_EXPANDED)
    parents = np.empty(_EXPANDED, np.int64)
    count = 0
    front = [(ahead[a] / speed, 0.0, a, -1)]
    while len(front) > 0:
        _, time, node, parent = heapq.heappop(front)
        bucket = node * buckets + math.floor(time / _BUCKET)
        if reached[bucket] == 1:
            continue
        reached[bucket] = 1
        if count == _EXPANDED:
            return False
        nodes[count] = node
        times[count] = time
        parents[count] = parent
        here = count
        count += 1
        u = node // ny
        v = node - u * ny
        if node == b:
            way = way_back(grid, nodes, times, parents, here, starts[i], goals[i], speed)
            return note_plan(memory[i], *pulled_straight(way, walls, grid, memory, done, apart))
        px = x + u * cell
        py = y + v * cell
        for d in range(17):
            di = 0
            dj = 0
            late = time + _WAIT
            if d < 16:
                di, dj = direction(d)
                if not passable(free, nx, ny, u, v, di, dj):
                    continue
                late = time + cell * math.sqrt(di * di + dj * dj) / speed
            other = (u + di) * ny + v + dj
            if late >= _LONGEST or reached[other * buckets + math.floor(late / _BUCKET)] == 1:
                continue
            if keeps_clear(memory, done, apart, px, py, time, px + di * cell, py + dj * cell, late):
                heapq.heappush(front, (late + ahead[other] / speed, late, other, here))
    return False


@allocating
def way_back(grid, nodes, times, parents, last, start, goal, speed):
    """Returns the times (s) and places (m) of a way that ends at an expanded node, from start to goal."""
    x, y, _, ny, cell = grid
    count = 0
    k = last
    while k >= 0:
        count += 1
        k = parents[k]
    at = np.empty(count + 1)
    xs = np.empty(count + 1)
    ys = np.empty(count + 1)
    k = last
    for c in range(count - 1, -1, -1):
        node = nodes[k]
        at[c] = times[k]
        xs[c] = x + node // ny * cell
        ys[c] = y + node % ny * cell
        k = parents[k]
    # the ends lie beside their nodes
    xs[0] = start[0]
    ys[0] = start[1]
    xs[count] = goal[0]
    ys[count] = goal[1]
    rest = math.sqrt((xs[count - 1] - goal[0]) ** 2 + (ys[count - 1] - goal[1]) ** 2)
    at[count] = at[count - 1] + max(rest / speed, 1e-6)
    return at, xs, ys


@allocating
def pulled_straight(way, walls, grid, memory, done, apart):
    """Returns a way with as few bends as walls (clearances, and the least) and the plans of others allow.

    From each place on it goes straight, at one speed, to the last place that it can reach so at the same time: no
    faster than before, and waiting becomes driving slowly.
    """
    at, xs, ys = way
    corners = np.empty(at.shape[0], np.int64)
    corners[0] = 0
    count = 1
    here = 0
    while here < at.shape[0] - 1:
        to = at.shape[0] - 1
        while to > here + 1:
            ends = (xs[here], ys[here], xs[to], ys[to])
            if keeps_off(walls, grid, *ends) and keeps_clear(
                memory, done, apart, ends[0], ends[1], at[here], ends[2], ends[3], at[to]
            ):
                break
            to -= 1
        here = to
        corners[count] = here
        count += 1
    return at[corners[:count]], xs[corners[:count]], ys[corners[:count]]


@inlined
def keeps_off(walls, grid, x0, y0, x1, y1):
    """Returns whether a line keeps its distance from what stands, by the clearances of nodes and between them."""
    clear, room = walls
    x, y, nx, ny, cell = grid
    length = math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
    parts = math.ceil(length / (0.5 * cell))
    for part in range(1, parts):
        share = part / parts
        u = min(max((x0 + share * (x1 - x0) - x) / cell, 0.0), nx - 1.001)
        v = min(max((y0 + share * (y1 - y0) - y) / cell, 0.0), ny - 1.001)
        i = int(u)
        j = int(v)
        u -= i
        v -= j
        low = (1.0 - u) * clear[i, j] + u * clear[i + 1, j]
        high = (1.0 - u) * clear[i, j + 1] + u * clear[i + 1, j + 1]
        if (1.0 - v) * low + v * high < room:
            return False
    return True


@compiled
def note_plan(m, at, xs, ys):
    """Writes a way as a plan; returns whether there is room for it."""
    if at.shape[0] > m.at.shape[0]:
        return False
    for k in range(at.shape[0]):
        m.at[k] = at[k]
        m.x[k] = xs[k]
        m.y[k] = ys[k]
    m.knots = at.shape[0]
    return True
