"""The privileged upper reference among obstacles: a shortest way over the map it is told, and a law that drives it."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled, inlined
from wayfield.envs.geometry import clearance_to
from wayfield.envs.patrols import patrol_at
from wayfield.policies.grid_search import any_angle_way
from wayfield.policies.policy import check_gain
from wayfield.policies.polyline_tracker import (
    FARTHEST,
    PLAN,
    PolylineTracker,
    clearance_prices,
    lay,
    level_of,
    nearest_free,
    plan_arrays,
    point_at,
    project,
    relax,
    track,
)

CELLS = 256  # of a side of the grid
POINTS = 512  # of a plan

MEMORY = np.dtype([*PLAN, ("points", np.float64, (POINTS, 2)), ("arc", np.float64, (POINTS,)),
                   ("held_up", np.int64), ("planned_at", np.int64), ("grid", np.uint8, (CELLS, CELLS))])  # fmt: skip


@dataclasses.dataclass(frozen=True)
class AstarTracker(PolylineTracker):
    """Plans with Theta* over the true obstacles, then tracks the polyline: an upper reference, not a fair rival.

    A grid of 256 x 256 cells holds the exact clearance of each cell's centre (to 5 mm, rounded down). Its cells are
    `cell` wide, or as wide as it takes to hold start, goals and the obstacles up to `surroundings` around them. Cells
    with less than hull radius + margin are blocked; the margins are `margin` times 1, 3/4, 1/2, 1/4, 0, the first with
    a way from goal to goal is taken, never the narrower and shorter one. The polyline is then let go like an elastic
    band towards `wanted_clearance`, and driven by the law of `PolylineTracker`. Moved more than `astray` off it, the
    robot plans anew. A robot without a way stands still, and memory["no_path"] is 1.

    Obstacles on patrol are left out of the map. Their scripts are known: the greatest of the speeds max_speed, half
    of it, 0 and -half that stays `patrol_clearance` clear of them for `patrol_horizon` is driven. A robot so held up
    for `patience` plans anew around what they sweep within that time, or within a third of it, and keeps its plan if
    there is no such way.

    Serves differential drives and omni bases. Limits: the elastic band is local, and speed is not part of the search.

    Source: Hart, Nilsson and Raphael 1968; Nash, Daniel, Koenig and Felner 2007; see `grid_search`.
    """

    cell: float = 0.05  # m
    margin: float = 0.12  # m, beside the hull, wanted of the plan
    wanted_clearance: float = 0.2  # m, beside the hull, towards which the plan is bent
    surroundings: float = 8.0  # m
    astray: float = 0.5  # m
    patrol_clearance: float = 0.15  # m
    patrol_horizon: float = 3.0  # s
    patience: float = 0.5  # s

    knows: ClassVar[str] = "map"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("cell", "surroundings", "astray", "patrol_horizon"):
            check_gain(self, name, above=0.0)
        for name in ("margin", "wanted_clearance", "patrol_clearance", "patience"):
            check_gain(self, name, least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns memory without plans, `MEMORY` records (b,): a robot plans when it first acts."""
        return np.zeros(briefing.num_envs, MEMORY)

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s."""
        limits = self.limits(briefing)
        radius = briefing.robot.hull_radius
        prices = np.array([clearance_prices(radius + self.margin * share, 0.0, 0.0) for share in _MARGIN_SHARES])
        decide(
            limits,
            (self.cell, self.surroundings, self.wanted_clearance, self.astray),
            (self.patrol_clearance, self.patrol_horizon, round(self.patience / briefing.dt)),
            prices,
            briefing.obstacles,
            briefing.num_obstacles,
            briefing.patrols,
            briefing.goals,
            briefing.num_goals,
            observation.pose,
            observation.goal_heading_error,
            observation.waypoints_left,
            memory["grid"],
            plan_arrays(memory),
            memory["steps"],
            memory["plans"],
            memory["no_path"],
            (memory["held_up"], memory["planned_at"]),
        )
        return self.twists(briefing, memory)


_MARGIN_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)


@compiled
def decide(
    limits, mapping, dodging, prices, obstacles, counts, patrols, goals, num_goals, poses, heading_errors,
    waypoints_left, grid, plan, steps, plans, no_path, waiting,
):  # fmt: skip
    """Sets the commands of all robots; plans for those that have not, are off their plan, or are held up."""
    points, arc, num_points, segments, arrived, stuck, _commands, origin, cell = plan
    held_up, planned_at = waiting
    astray = mapping[3]
    for i in range(poses.shape[0]):
        x = poses[i, 0]
        y = poses[i, 1]
        first = max(num_goals[i] - 1 - int(waypoints_left[i]), 0)
        due = plans[i] == 0
        s = 0.0
        if num_points[i] > 0:
            s, away, _ = project(points, arc, num_points[i], segments, i, x, y)
            due = away > astray or stuck[i] > 60
        if due:
            stuck[i] = 0
            plans[i] += 1
            if plans[i] == 1:
                lay_grid(mapping, obstacles, counts, patrols, goals, num_goals, i, x, y, origin, cell, grid.shape[1])
                for j in range(counts[i]):
                    if patrols[i, j].leg_time <= 0.0:
                        stamp(grid, i, obstacles[i, j], 0.0, 0.0, origin, cell, FARTHEST)
            found = plan_way(limits, mapping[2], prices, goals, num_goals, first, i, x, y, grid, plan)
            no_path[i] = 0 if found else 1
            if not found:
                num_points[i] = 0
            arrived[i] = 0
            s = 0.0
        moving = False
        for j in range(counts[i]):
            moving = moving or patrols[i, j].leg_time > 0.0
        speed_limit = np.inf
        if moving and num_points[i] > 0:
            time = steps[i] * limits.dt
            speed_limit = speed_among(limits, dodging, obstacles, patrols, counts, plan, i, s, time)
            held_up[i] = held_up[i] + 1 if speed_limit < np.inf else 0
            if held_up[i] > dodging[2] and steps[i] - planned_at[i] > dodging[2] and arrived[i] == 0:
                planned_at[i] = steps[i]
                plans[i] += 1
                dodge(
                    limits, mapping, dodging, prices, obstacles, counts, patrols, goals, num_goals, first, i, x, y,
                    time, grid, plan,
                )  # fmt: skip
                s, _, _ = project(points, arc, num_points[i], segments, i, x, y)
                speed_limit = speed_among(limits, dodging, obstacles, patrols, counts, plan, i, s, time)
        if speed_limit <= 0.0 and arrived[i] == 1:
            speed_limit = np.inf
        # between its cells the grid can say half a cell less than there is
        track(
            limits, grid, plan, i, x, y, poses[i, 2], heading_errors[i], True, False, speed_limit, -0.5 * cell[i]
        )  # fmt: skip
        steps[i] += 1


@compiled
def dodge(
    limits, mapping, dodging, prices, obstacles, counts, patrols, goals, num_goals, first, i, x, y, time, grid, plan
):  # fmt: skip
    """Plans robot i's way around what the patrols sweep in a while, or a third of it; without one it keeps its plan."""
    _, _, _, _, _, _, _, origin, cell = plan
    still = grid[i].copy()
    reach = limits.hull_radius + mapping[2] + 2.0 * cell[i]
    for horizon in (dodging[1], dodging[1] / 3.0):
        for j in range(counts[i]):
            if patrols[i, j].leg_time <= 0.0:
                continue
            after = 0.0
            while after <= horizon:
                mx, my, _, _ = patrol_at(patrols[i, j], time + after)
                # farther away, it will have gone on by the time the robot gets there
                if (mx - x) ** 2 + (my - y) ** 2 < 9.0:
                    o = obstacles[i, j]
                    stamp(grid, i, o, mx - o.x, my - o.y, origin, cell, reach)
                after += 0.25
        found = plan_way(limits, mapping[2], prices, goals, num_goals, first, i, x, y, grid, plan)
        grid[i] = still
        if found:
            return


@compiled
def lay_grid(mapping, obstacles, counts, patrols, goals, num_goals, i, x, y, origin, cell, size):
    """Sets where robot i's grid lies, and how wide its cells are."""
    low_x = x
    high_x = x
    low_y = y
    high_y = y
    for k in range(num_goals[i]):
        low_x = min(low_x, goals[i, k, 0])
        high_x = max(high_x, goals[i, k, 0])
        low_y = min(low_y, goals[i, k, 1])
        high_y = max(high_y, goals[i, k, 1])
    # around the outermost obstacles too, but not to the ends of the world
    around = mapping[1]
    bounds = (low_x - around, high_x + around, low_y - around, high_y + around)
    for j in range(counts[i]):
        o = obstacles[i, j]
        if patrols[i, j].leg_time > 0.0:
            continue
        half_x = abs(o.cos) * o.half_length + abs(o.sin) * o.half_width + o.radius
        half_y = abs(o.sin) * o.half_length + abs(o.cos) * o.half_width + o.radius
        low_x = min(low_x, max(o.x - half_x, bounds[0]))
        high_x = max(high_x, min(o.x + half_x, bounds[1]))
        low_y = min(low_y, max(o.y - half_y, bounds[2]))
        high_y = max(high_y, min(o.y + half_y, bounds[3]))
    room = 1.0  # m
    side = max(high_x - low_x, high_y - low_y) + 2.0 * room
    cell[i] = max(mapping[0], side / (size - 1))
    origin[i, 0] = 0.5 * (low_x + high_x - cell[i] * size)
    origin[i, 1] = 0.5 * (low_y + high_y - cell[i] * size)


@compiled
def stamp(grid, i, o, shift_x, shift_y, origin, cell, reach):
    """Lowers the clearance in robot i's grid to that of an obstacle, shifted, as far as `reach` (m) from it."""
    size = grid.shape[1]
    half_x = abs(o.cos) * o.half_length + abs(o.sin) * o.half_width + o.radius + reach
    half_y = abs(o.sin) * o.half_length + abs(o.cos) * o.half_width + o.radius + reach
    x = origin[i, 0] - shift_x
    y = origin[i, 1] - shift_y
    low_column = max(math.floor((o.x - half_x - x) / cell[i] - 0.5), 0)
    high_column = min(math.ceil((o.x + half_x - x) / cell[i] - 0.5), size - 1)
    low_row = max(math.floor((o.y - half_y - y) / cell[i] - 0.5), 0)
    high_row = min(math.ceil((o.y + half_y - y) / cell[i] - 0.5), size - 1)
    for row in range(low_row, high_row + 1):
        for column in range(low_column, high_column + 1):
            level = level_of(clearance_to(o, x + (column + 0.5) * cell[i], y + (row + 0.5) * cell[i]))
            if level > grid[i, row, column]:
                grid[i, row, column] = level


@compiled
def plan_way(limits, bend_to, prices, goals, num_goals, first, i, x, y, grid, plan):
    """Lays robot i's polyline from (x, y) through its goals from the `first` on; returns whether there is a way."""
    points, arc, num_points, segments, _, _, _, origin, cell = plan
    size = grid.shape[1]
    levels = grid[i]
    legs = num_goals[i] - first
    costs = np.empty(size * size)
    estimates = np.empty(size * size)
    parents = np.empty(size * size, np.int32)
    heap = np.empty(size * size, np.int32)
    places = np.empty(size * size, np.int32)
    corners = np.empty((POINTS // 4, 2))
    pinned = np.zeros(POINTS // 4, np.bool_)
    for choice in range(prices.shape[0]):
        reach = math.ceil(0.3 / cell[i])
        corners[0, 0] = x
        corners[0, 1] = y
        count = 1
        found = True
        for leg in range(legs):
            from_x = corners[count - 1, 0]
            from_y = corners[count - 1, 1]
            to_x = goals[i, first + leg, 0]
            to_y = goals[i, first + leg, 1]
            start = nearest_free(
                levels, prices[choice], int((from_y - origin[i, 1]) / cell[i]), int((from_x - origin[i, 0]) / cell[i]),
                reach,
            )  # fmt: skip
            goal = nearest_free(
                levels, prices[choice], int((to_y - origin[i, 1]) / cell[i]), int((to_x - origin[i, 0]) / cell[i]),
                reach,
            )  # fmt: skip
            if start < 0 or goal < 0:
                found = False
                break
            cells, _ = any_angle_way(levels, prices[choice], start, goal, costs, estimates, parents, heap, places)
            if cells.shape[0] == 0 or count + cells.shape[0] + 1 > corners.shape[0]:
                found = False
                break
            for k in range(cells.shape[0]):
                # the end cells stand for the ends, unless those lie in a blocked cell
                if k == 0 and near(from_x, from_y, origin, cell, i, cells[0]):
                    continue
                if k == cells.shape[0] - 1 and near(to_x, to_y, origin, cell, i, cells[k]):
                    continue
                corners[count, 0] = origin[i, 0] + (cells[k, 1] + 0.5) * cell[i]
                corners[count, 1] = origin[i, 1] + (cells[k, 0] + 0.5) * cell[i]
                pinned[count] = False
                count += 1
            corners[count, 0] = to_x
            corners[count, 1] = to_y
            pinned[count] = True
            count += 1
        if not found:
            continue
        held = lay(points, arc, num_points, segments, i, corners[:count], pinned, 2.0 * cell[i])
        relax(
            grid, points, arc, num_points, i, origin, cell, held, limits.hull_radius + bend_to, limits.hull_radius, 60
        )  # fmt: skip
        return True
    return False


@inlined
def near(x, y, origin, cell, i, at):
    """Returns whether a point lies in a cell."""
    return (
        abs(origin[i, 0] + (at[1] + 0.5) * cell[i] - x) <= 0.51 * cell[i]
        and abs(origin[i, 1] + (at[0] + 0.5) * cell[i] - y) <= 0.51 * cell[i]
    )


@compiled
def speed_among(limits, dodging, obstacles, patrols, counts, plan, i, s, time):
    """Returns the greatest speed (m/s) along robot i's polyline that keeps clear of the patrols; else the clearest."""
    points, arc, num_points, _, _, _, _, _, _ = plan
    n = num_points[i]
    clearest = -np.inf
    best = 0.0
    for option in range(4):
        speed = (1.0, 0.5, 0.0, -0.5)[option] * limits.max_speed
        least = np.inf
        after = 0.0
        while after < dodging[1]:
            px, py = point_at(points, arc, n, 0, i, max(s + speed * after, 0.0))
            for j in range(counts[i]):
                if patrols[i, j].leg_time <= 0.0:
                    continue
                mx, my, _, _ = patrol_at(patrols[i, j], time + after)
                o = obstacles[i, j]
                least = min(least, clearance_to(o, px - mx + o.x, py - my + o.y) - limits.hull_radius)
            after += 0.1
        if least >= dodging[0]:
            return np.inf if option == 0 else speed
        if least > clearest:
            clearest = least
            best = speed
    return best
