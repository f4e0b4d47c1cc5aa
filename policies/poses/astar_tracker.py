"""The privileged upper reference among obstacles: a shortest way over the given map, and a law that drives it."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.scenarios.ways import grid_over
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.geometry import clearance_to
from wayfield.envs.world.grids import grid_clearance
from wayfield.envs.world.movers import any_moves, motion_at, moves
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.polyline_tracker import (
    FARTHEST,
    FINE_CELL,
    UNIT,
    PolylineTracker,
    level_of,
    plan_fields,
    plan_way,
    point_at,
    project,
    track,
)
from wayfield.policies.parts.steering import Map
from wayfield.system.checks import memory as check_memory
from wayfield.system.compiled import allocating, any_layout, assign, compiled, inlined

# Of a side of the grid: as few as hold the world in cells no wider than FINE_CELL. Where WIDE do not, cells are wider,
# and more are taken only for WIDE_SHARE of a map's own cell: in that, a gap of one cell has room for a hull.
CELLS = (256, 1024, 2048, 4096)
WIDE = 2048
WIDE_SHARE = 1.0 / 3.0
LARGE_WORLD = 80.0  # m, up to which a world without a map has always been held by the fewest
ROOM = 1.0  # m, around what the grid holds
# Between two neighbours with more clearance than this, in sides of a cell, there is no wall: half of the diagonal.
SAFE = 0.7072
PIECE_END = 2.0  # m, before the end of a piece of a long way at which the next is planned
# where cells are wider than FINE_CELL, of the shortest way: what is longer is not taken for the sake of more room
DETOUR = 1.1
MARGIN_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the wanted margin, tried in turn

# steps in a row in which patrols slowed a robot down; m, of `PolylineTracker.stay`
_MORE = [("held_up", np.int64), ("stay", np.float64)]


@dataclasses.dataclass(frozen=True)
class AstarTracker(PolylineTracker):
    """Plans with Theta* over the true obstacles, then tracks the polyline: an upper reference, not a fair rival.

    A grid of 256 x 256 cells holds the exact clearance of each cell's centre (to 5 mm, rounded down). Its cells are
    `cell` wide, or as wide as it takes to hold start, goals and the obstacles up to `surroundings` around them, and all
    of a map; it has 1,024, 2,048 or 4,096 on a side where the cells would be too wide. Cells with less than hull radius
    + margin are blocked; the margins are `margin` times 1, 3/4, 1/2, 1/4, 0, the first with a way to the next waypoint
    or goal is taken, never the narrower and shorter one. Where cells are wider than 0.1 m, ways that keep so much along
    all of their lines, not only at the middles of cells, come first, and none is taken that is more than a tenth longer
    than the shortest of all. The polyline is then let go like an elastic band towards `wanted_clearance`, and driven by
    the law of `PolylineTracker`. Moved more than `astray` off it, the robot plans anew, and so it does near the end of
    what the polyline holds of a way of many hundred metres, or turns, and at each waypoint. A robot without a way
    stands still, and memory["no_path"] is 1.

    Obstacles on patrol are left out of the map. Their scripts are known: the greatest of the speeds max_speed, half
    of it, 0 and -half that stays `patrol_clearance` clear of them for `patrol_horizon` is driven. A robot so held up
    for `patience` plans anew around what they sweep within that time, or within a third of it, and keeps its plan if
    there is no such way.

    Serves differential drives and omni bases. Limits: the elastic band is local, and speed is not part of the search.

    Source: Hart, Nilsson and Raphael 1968; Nash, Daniel, Koenig and Felner 2007; see `grid_search`.
    """

    cell: float = gain(0.05, "m", "side of a cell of the grid", above=0.0)
    margin: float = gain(0.12, "m", "beside the hull, wanted of the plan", least=0.0, search=(0.03, 0.2))
    wanted_clearance: float = gain(0.2, "m", "beside the hull, for the bent plan", least=0.0, search=(0.05, 0.5))
    surroundings: float = gain(8.0, "m", "around robot and goal that the grid holds", above=0.0)
    astray: float = gain(0.5, "m", "from the plan, beyond which it is made anew", above=0.0)
    patrol_clearance: float = gain(0.15, "m", "kept from where patrols will be", least=0.0)
    patrol_horizon: float = gain(3.0, "s", "for which patrols are foreseen", above=0.0)
    patience: float = gain(0.5, "s", "before a patrol, until the plan is made anew", least=0.0)

    knows: ClassVar[str] = "map"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns memory without plans, `memory_of` records (b,): a robot plans when it first acts.

        Raises:
            ValueError: if so many robots have no room for their grids.
        """
        memory = np.zeros(briefing.num_envs, memory_of(briefing, _MORE))
        memory["stay"] = self.stay(briefing)
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s."""
        p = self.params(
            briefing, theta=True, snap=0.3, spacing=2.0, rounds=60, patience_steps=round(self.patience / briefing.dt)
        )
        map_ = Map.of(briefing)
        decide(p, map_, observation.pose, observation.goal_heading_error, observation.waypoints_left, memory)
        return self.twists(briefing, memory)


def memory_of(briefing: Briefing, more: list[Any]) -> np.dtype[Any]:
    """Returns the record that a robot's plan and grid are kept in, and `more` fields, large enough for its world.

    Raises:
        ValueError: if the robots together have no room for them.
    """
    map_ = Map.of(briefing)
    side = max((world_side(map_, i) for i in range(briefing.num_envs)), default=0.0)
    cells = CELLS[0]
    if len(map_.cells) or side > LARGE_WORLD:
        cell = max(FINE_CELL, side / (WIDE - 2))
        if len(map_.cells):
            finest = float(np.min(map_.frames["grid_cell"], where=map_.frames["grid_cell"] > 0.0, initial=np.inf))
            cell = min(cell, max(FINE_CELL, WIDE_SHARE * finest))
        cells = next((each for each in CELLS if side <= cell * (each - 2)), CELLS[-1])
    kind = np.dtype([*plan_fields(2 * cells), *more, ("grid", np.uint8, (cells, cells))], align=True)
    check_memory(
        f"the grids of {briefing.num_envs} robots, {cells} x {cells} cells each,", briefing.num_envs * kind.itemsize
    )
    return kind


def world_side(map_: Map, i: int) -> float:
    """Returns the greater side (m) of the box around all of robot i's map, with ROOM around it."""
    standing = map_.obstacles[i, : map_.counts[i]]
    standing = standing[standing["patrol"]["leg_time"] <= 0.0]
    goals = map_.goals[i, : map_.num_goals[i], :2]
    corners = corners_of(map_.frames[i])
    x, y, columns, rows = grid_over(standing, np.vstack([goals, corners]), ROOM, 1.0)
    del x, y
    return float(max(columns, rows))


@allocating
def corners_of(frame):
    """Returns the corners (4, 2) of a scenario's grid, m; (0, 2) where there is none."""
    corners = np.empty((4 if frame.grid_cell > 0.0 else 0, 2))
    for k in range(corners.shape[0]):
        u = frame.grid_cell * frame.grid_columns * (k & 1)
        v = frame.grid_cell * frame.grid_rows * (k >> 1)
        corners[k, 0] = frame.grid_x + frame.grid_cos * u - frame.grid_sin * v
        corners[k, 1] = frame.grid_y + frame.grid_sin * u + frame.grid_cos * v
    return corners


@any_layout
@compiled
def decide(params, map_, poses, heading_errors, waypoints_left, memory):
    """Sets the commands of all robots; plans for those that have not, are off their plan, or are held up."""
    p = params[0]
    for i in range(poses.shape[0]):
        m = memory[i]
        x = poses[i, 0]
        y = poses[i, 1]
        pose = x, y, poses[i, 2]
        first = min(max(map_.num_goals[i] - 1 - int(waypoints_left[i]), 0), map_.num_goals[i] - 1)
        # a leg at a time: a way that turns back at a waypoint has places that lie under each other
        stops = map_.goals[i, first : first + 1, :2]
        due = m.plans == 0
        s = 0.0
        if m.num_points > 0:
            s, away, _ = project(m, x, y)
            due = away > p.astray or m.stuck > 60 or (m.arc[m.num_points - 1] - s < PIECE_END and is_piece(m, stops))
        if due:
            if m.plans == 0:
                lay_grid(p, m, map_, i, x, y)
            m.stuck = 0
            m.plans += 1
            m.no_path = 0 if plan_with_room(p, m, x, y, stops) else 1
            if m.no_path == 1:
                m.num_points = 0
            m.arrived = 0
            s = 0.0
        speed_limit = np.inf
        if any_moves(map_.obstacles, i, map_.counts[i]) and m.num_points > 0:
            time = m.steps * p.plant.dt
            speed_limit = speed_among(p, m, map_, i, s, time)
            m.held_up = m.held_up + 1 if speed_limit < np.inf else 0
            waited = m.steps - m.planned_at
            if m.held_up > p.patience_steps and waited > p.patience_steps and m.arrived == 0:
                m.planned_at = m.steps
                m.plans += 1
                dodge(p, m, map_, i, x, y, stops, time)
                s, _, _ = project(m, x, y)
                speed_limit = speed_among(p, m, map_, i, s, time)
        if speed_limit <= 0.0 and m.arrived == 1:
            speed_limit = np.inf
        # between its cells the grid can say half a cell less than there is
        is_goal = first == map_.num_goals[i] - 1
        track(p, m, pose, heading_errors[i], is_goal, False, speed_limit, -0.5 * m.cell)
        m.steps += 1


@inlined
def is_piece(m, stops):
    """Returns whether the polyline is but the beginning of the way, whose rest had no room in it."""
    last = stops.shape[0] - 1
    end = m.points[m.num_points - 1]
    return abs(end[0] - stops[last, 0]) + abs(end[1] - stops[last, 1]) > 1e-6


@allocating
def plan_with_room(p, m, x, y, stops):
    """Lays the way with the widest of the margins that has one; returns whether one has.

    A metre of a way costs 1 where a margin is kept and inf where it is not: a row of prices for each margin.
    """
    prices = np.empty((len(MARGIN_SHARES), 256))
    for choice in range(prices.shape[0]):
        least = p.plant.hull_radius + p.margin * MARGIN_SHARES[choice] - 1e-9
        for units in range(256):
            prices[choice, units] = 1.0 if FARTHEST - UNIT * units >= least else np.inf
    if m.cell <= FINE_CELL:
        for choice in range(prices.shape[0]):
            if plan_way(p, m, prices[choice], prices[choice], x, y, stops, np.inf) < np.inf:
                return True
        return False
    # the last has the most ways, and so the shortest
    narrow = prices[prices.shape[0] - 1]
    longest = DETOUR * plan_way(p, m, narrow, narrow, x, y, stops, np.inf)
    if longest == np.inf:
        return False
    # between the middles of wide cells there may be less room than at them: first where there is enough anyhow
    short = math.ceil(SAFE * m.cell / UNIT)
    for choice in range(prices.shape[0]):
        stricter = np.full(256, np.inf)
        for units in range(short, 256):
            stricter[units - short] = prices[choice, units]
        if plan_way(p, m, stricter, stricter, x, y, stops, longest) < np.inf:
            return True
    for choice in range(prices.shape[0] - 1):
        if plan_way(p, m, prices[choice], prices[choice], x, y, stops, longest) < np.inf:
            return True
    return True


@allocating
def dodge(p, m, map_, i, x, y, stops, time):
    """Plans robot i's way around what the patrols sweep in a while, or a third of it; without one it keeps its plan."""
    still = m.grid.copy()
    reach = p.plant.hull_radius + p.wanted_clearance + 2.0 * m.cell
    for horizon in (p.patrol_horizon, p.patrol_horizon / 3.0):
        for j in range(map_.counts[i]):
            o = map_.obstacles[i, j]
            if not moves(o):
                continue
            after = 0.0
            while after <= horizon:
                mx, my, _, _ = motion_at(o, time + after)
                # farther away, it will have gone on by the time the robot gets there
                if (mx - x) ** 2 + (my - y) ** 2 < 9.0:
                    stamp(m, o, mx - o.x, my - o.y, reach)
                after += 0.25
        planned = plan_with_room(p, m, x, y, stops)
        assign(m.grid, still)
        if planned:
            return


@allocating
def lay_grid(p, m, map_, i, x, y):
    """Sets where robot i's grid lies and how wide its cells are, and fills it with what stands."""
    low_x = x
    high_x = x
    low_y = y
    high_y = y
    for k in range(map_.num_goals[i]):
        low_x = min(low_x, map_.goals[i, k, 0])
        high_x = max(high_x, map_.goals[i, k, 0])
        low_y = min(low_y, map_.goals[i, k, 1])
        high_y = max(high_y, map_.goals[i, k, 1])
    # around the outermost obstacles too, but not to the ends of the world
    around = p.surroundings
    bounds = (low_x - around, high_x + around, low_y - around, high_y + around)
    for j in range(map_.counts[i]):
        o = map_.obstacles[i, j]
        if moves(o):
            continue
        half_x = abs(o.cos) * o.half_length + abs(o.sin) * o.half_width + o.radius
        half_y = abs(o.sin) * o.half_length + abs(o.cos) * o.half_width + o.radius
        low_x = min(low_x, max(o.x - half_x, bounds[0]))
        high_x = max(high_x, min(o.x + half_x, bounds[1]))
        low_y = min(low_y, max(o.y - half_y, bounds[2]))
        high_y = max(high_y, min(o.y + half_y, bounds[3]))
    frame = map_.frames[i]
    corners = corners_of(frame)
    for k in range(corners.shape[0]):
        low_x = min(low_x, corners[k, 0])
        high_x = max(high_x, corners[k, 0])
        low_y = min(low_y, corners[k, 1])
        high_y = max(high_y, corners[k, 1])
    cells = m.grid.shape[0]
    side = max(high_x - low_x, high_y - low_y) + 2.0 * ROOM
    m.cell = max(p.cell, side / (cells - 1))
    m.origin[0] = 0.5 * (low_x + high_x - m.cell * cells)
    m.origin[1] = 0.5 * (low_y + high_y - m.cell * cells)
    if corners.shape[0] > 0:
        fit_grid(m, frame, side, low_x, low_y)
        fill_grid(m, frame, map_.cells)
    for j in range(map_.counts[i]):
        if not moves(map_.obstacles[i, j]):
            stamp(m, map_.obstacles[i, j], 0.0, 0.0, FARTHEST)


@compiled
def fit_grid(m, frame, side, low_x, low_y):
    """Lays the cells so that the middles of a map's cells are middles of theirs: a way one cell wide is met.

    A map's cell is an odd number of theirs, or theirs an odd number of the map's. A map that is turned is met anyhow.
    """
    least = max(m.cell, side / (m.grid.shape[0] - 3))
    times = math.floor(frame.grid_cell / least)
    if times >= 1:
        m.cell = frame.grid_cell / (times - 1 if times % 2 == 0 else times)
    else:
        times = math.ceil(least / frame.grid_cell)
        m.cell = frame.grid_cell * (times + 1 if times % 2 == 0 else times)
    # without room to widen them so far, where they are
    if m.cell > 1.5 * least:
        m.cell = least
    m.origin[0] = frame.grid_x + m.cell * math.floor((low_x - ROOM - frame.grid_x) / m.cell)
    m.origin[1] = frame.grid_y + m.cell * math.floor((low_y - ROOM - frame.grid_y) / m.cell)


@compiled
def fill_grid(m, frame, cells):
    """Sets the clearances in the grid to those of a map."""
    for row in range(m.grid.shape[0]):
        for column in range(m.grid.shape[1]):
            x = m.origin[0] + (column + 0.5) * m.cell
            y = m.origin[1] + (row + 0.5) * m.cell
            m.grid[row, column] = safe_level(m, grid_clearance(frame, cells, x, y))


@inlined
def safe_level(m, clearance):
    """Returns `level_of` a clearance (m), but that of no room at all where a wall could stand between neighbours."""
    return np.uint8(255) if clearance < SAFE * m.cell and m.cell > FINE_CELL else level_of(clearance)


@compiled
def stamp(m, o, shift_x, shift_y, reach):
    """Lowers the clearance in the grid to that of an obstacle, shifted, as far as `reach` (m) from it."""
    half_x = abs(o.cos) * o.half_length + abs(o.sin) * o.half_width + o.radius + reach
    half_y = abs(o.sin) * o.half_length + abs(o.cos) * o.half_width + o.radius + reach
    x = m.origin[0] - shift_x
    y = m.origin[1] - shift_y
    last = m.grid.shape[0] - 1
    low_column = max(math.floor((o.x - half_x - x) / m.cell - 0.5), 0)
    high_column = min(math.ceil((o.x + half_x - x) / m.cell - 0.5), last)
    low_row = max(math.floor((o.y - half_y - y) / m.cell - 0.5), 0)
    high_row = min(math.ceil((o.y + half_y - y) / m.cell - 0.5), last)
    for row in range(low_row, high_row + 1):
        for column in range(low_column, high_column + 1):
            level = safe_level(m, clearance_to(o, x + (column + 0.5) * m.cell, y + (row + 0.5) * m.cell))
            if level > m.grid[row, column]:
                m.grid[row, column] = level


@compiled
def speed_among(p, m, map_, i, s, time):
    """Returns the greatest speed (m/s) along the polyline that keeps clear of the patrols; else the clearest."""
    clearest = -np.inf
    best = 0.0
    for option in range(4):
        speed = (1.0, 0.5, 0.0, -0.5)[option] * p.max_speed
        least = np.inf
        after = 0.0
        while after < p.patrol_horizon:
            px, py = point_at(m, 0, max(s + speed * after, 0.0))
            for j in range(map_.counts[i]):
                o = map_.obstacles[i, j]
                if not moves(o):
                    continue
                mx, my, _, _ = motion_at(o, time + after)
                least = min(least, clearance_to(o, px - mx + o.x, py - my + o.y) - p.plant.hull_radius)
            after += 0.1
        if least >= p.patrol_clearance:
            return np.inf if option == 0 else speed
        if least > clearest:
            clearest = least
            best = speed
    return best
