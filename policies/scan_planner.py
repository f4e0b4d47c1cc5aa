"""A planner without a map: it draws its own from the scans, takes what it has not seen for free, and plans in it."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled, inlined
from wayfield.envs.geometry import sin_cos
from wayfield.policies.grid_search import pulled, search, traced
from wayfield.policies.policy import check_gain, check_scan
from wayfield.policies.polyline_tracker import (
    PLAN,
    PolylineTracker,
    clearance_at,
    clearance_prices,
    command,
    free_arc,
    lay,
    nearest_free,
    plan_arrays,
    plan_is_clear,
    point_at,
    project,
    relax,
    stopping_speed,
    track,
)
from wayfield.policies.scan_map import (
    BARRED,
    CELLS,
    SUB,
    enter_point,
    enter_scan,
    mark,
    move_grid,
    stamps,
)
from wayfield.policies.stopping import (
    SECTORS,
    beam_directions,
    find_approaching,
    find_hits,
    fresh_scans,
    full_twists,
    plant_model,
    sees_all_round,
    step_and_stop,
)

POINTS = 512  # of a plan

MEMORY = [
    *PLAN,
    ("points", np.float64, (POINTS, 2)),
    ("arc", np.float64, (POINTS,)),
    ("planned_at", np.int64),  # step of the last search
    ("forgotten", np.int64),  # how often the map was
    ("seen", np.float64, (3 * SECTORS,)),  # of `find_hits`
    ("nearest", np.float64),  # m, the surface nearest to the robot
    ("closing", np.float64),  # m/s, at which that comes nearer by itself
    ("grid", np.uint8, (CELLS, CELLS)),
    ("evidence", np.int8, (CELLS, CELLS)),
    ("spots", np.uint16, (CELLS, CELLS)),
]

NEAR = 1.5  # m, within which the hits themselves are looked at
RECALL = 1.0  # s, for which they are remembered


@dataclasses.dataclass(frozen=True)
class ScanPlanner(PolylineTracker):
    """Maps what its beams hit, plans a way to the goal as if all else were free, drives it, and plans anew when wrong.

    The grid, 160 x 160 cells of `cell` (12.8 m square) in the frame of the measured pose, holds for each cell the
    evidence of the scans (a hit counts 6, up to 18, a beam that goes through -1, so that what has moved away is
    forgotten), the spots of its hits to a quarter of a cell, and the clearance of its centre from all spots, kept up to
    date by stamping. The grid is laid half-way to the goal, at most a quarter of its side from the robot, and again
    when the robot comes within a tenth of its side of the border; what leaves it is forgotten. A goal beyond it is
    replaced by the nearest cell within.

    A* searches cells with clearance above hull radius + `margin`; a metre costs 1 + weight times what lacks to
    `wanted_clearance`. If there is no way, cells down to hull radius - `give` serve, for a cell's centre may lie beside
    the middle of a gap; a gap that turns out too narrow when the robot stands before it is barred. If there is no way
    still, the robot forgets the map but for what it now sees. The way is straightened by line of sight, let go like an
    elastic band, and driven by the law of `PolylineTracker`; into cells not seen yet the robot drives with room to stop
    before them, or creeps. Whatever it drives, it slows until it can stop before the hits themselves, of this scan and
    of the last second. It plans anew when the plan gets blocked, the goal changes, it has been moved more than
    `astray`, is stuck, or `period` has passed.

    What comes nearer by itself (`find_approaching`) is also entered where it will be in `foresight`, so that ways lead
    around it; one that is `evade_within` away, or will be in `evade_time`, is backed away from.

    Serves differential drives and omni bases (which look where they go when the beams are less than a full circle).
    Any number of beams and field of view; few beams see late. Limits: a differential drive cannot step aside of what
    comes from the side; a wall that distant beams miss looks open; a pose that drifts smears the map.

    Source: Koenig and Likhachev, T-RO 21(3), 2005 (free-space assumption; here with A* from scratch); occupancy
    evidence as in Elfes 1989; elastic band as in Quinlan and Khatib 1993.
    """

    cell: float = 0.08  # m
    margin: float = 0.02  # m, beside the hull, least
    give: float = 0.03  # m, of the hull, where there is no other way
    wanted_clearance: float = 0.2  # m, beside the hull
    weight: float = 3.0
    period: float = 4.0  # s
    pause: float = 0.3  # s, between searches at least, unless the block is near
    astray: float = 0.5  # m
    creep: float = 0.15  # m/s, into what has not been seen
    foresight: float = 1.2  # s, for which what comes nearer by itself is put forward
    evade_within: float = 0.2  # m, beside the hull, of what comes nearer by itself
    evade_time: float = 1.0  # s, until it would be that near

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("cell", "wanted_clearance", "period", "astray", "creep"):
            check_gain(self, name, above=0.0)
        for name in ("margin", "give", "weight", "pause", "foresight", "evade_within", "evade_time"):
            check_gain(self, name, least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty map and no plan for each robot: `MEMORY` records (b,), with the scans to see motion by.

        Raises:
            ValueError: if there are no beams.
        """
        check_scan(self, briefing.beam_angles, briefing)
        scans = fresh_scans(briefing)
        memory = np.zeros(briefing.num_envs, np.dtype([*MEMORY, ("scans", np.float64, scans.shape[1:])]))
        memory["scans"] = scans
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s.

        Raises:
            ValueError: if the scan has another number of beams than the briefing.
        """
        check_scan(self, observation.ranges, briefing)
        radius = briefing.robot.hull_radius
        reach = radius + self.wanted_clearance + 1.5 * self.cell
        prices = np.array(
            [
                clearance_prices(radius + self.margin, radius + self.wanted_clearance, self.weight),
                clearance_prices(radius - self.give, radius + self.wanted_clearance, self.weight),
                clearance_prices(radius + 0.5 * self.wanted_clearance, 0.0, 0.0),  # where lines are drawn straight
            ]
        )
        decide(
            self.limits(briefing),
            (self.cell, self.margin, self.give, self.wanted_clearance, self.astray, self.creep),
            (round(self.period / briefing.dt), round(self.pause / briefing.dt)),
            prices,
            beam_directions(briefing),
            briefing.max_range,
            sees_all_round(briefing),
            observation.pose,
            observation.goal,
            observation.goal_heading_error,
            observation.waypoints_left,
            observation.ranges,
            (memory["grid"], memory["evidence"], memory["spots"], stamps(self.cell, reach)),
            plan_arrays(memory),
            (memory["target"], memory["steps"], memory["plans"], memory["no_path"], memory["planned_at"]),
            memory["forgotten"],
            (memory["seen"], memory["scans"], self.foresight),
            (memory["nearest"], memory["closing"], self.evade_within, self.evade_time),
            plant_model(briefing),
            full_twists(briefing, observation.twist),
        )
        return self.twists(briefing, memory)


@compiled
def decide(
    limits, mapping, timing, prices, beams, max_range, full_circle, poses, goals, heading_errors, waypoints_left,
    ranges, chart, plan, log, forgotten, recalled, evading, model, twists,
):  # fmt: skip
    """Sets the commands of all robots: enters the scans, plans where it must be, and tracks."""
    cell_size, margin, give, wanted, astray, creep = mapping
    seen, scans, foresight = recalled
    grid, evidence, spots, _ = chart
    points, arc, num_points, segments, arrived, stuck, commands, origin, cell = plan
    target, steps, plans, no_path, planned_at = log
    size = grid.shape[1]
    # the brakes are those of this law
    plant = (limits.acceleration, limits.yaw_acceleration, *model[2:])
    hits = np.empty((2 * beams.shape[0] + SECTORS, 3))
    scratch_size = 1
    costs = np.empty(0)
    estimates = np.empty(0)
    parents = np.empty(0, np.int32)
    heap = np.empty(0, np.int32)
    places = np.empty(0, np.int32)
    for i in range(poses.shape[0]):
        x = poses[i, 0]
        y = poses[i, 1]
        heading = poses[i, 2]
        sine, cosine = sin_cos(heading)
        goal_x = x + cosine * goals[i, 0] - sine * goals[i, 1]
        goal_y = y + sine * goals[i, 0] + cosine * goals[i, 1]
        # half-way to the goal, but no more than a quarter of the grid away
        quarter = 0.25 * size * cell_size
        middle_x = x + min(max(0.5 * (goal_x - x), -quarter), quarter)
        middle_y = y + min(max(0.5 * (goal_y - y), -quarter), quarter)
        if steps[i] == 0:
            cell[i] = cell_size
            origin[i, 0] = middle_x - 2.0 * quarter
            origin[i, 1] = middle_y - 2.0 * quarter
        off = max(abs(x - origin[i, 0] - 2.0 * quarter), abs(y - origin[i, 1] - 2.0 * quarter))
        if off > 1.6 * quarter:
            move_grid(chart, i, origin, cell, middle_x, middle_y)
            num_points[i] = 0
        enter_scan(chart, i, origin, cell, x, y, heading, beams, ranges, max_range, limits.hull_radius)
        count = find_hits(
            ranges, i, beams, max_range, NEAR, limits.hull_radius + 0.5 * limits.skin, poses, RECALL, limits.dt, seen,
            0, hits,
        )  # fmt: skip
        foreseen = find_approaching(
            ranges, i, beams, max_range, limits.hull_radius, poses, foresight, limits.dt, scans, 0, hits, count
        )
        for j in range(count, foreseen):
            enter_point(
                chart, i, origin, cell, x + cosine * hits[j, 0] - sine * hits[j, 1],
                y + sine * hits[j, 0] + cosine * hits[j, 1],
            )  # fmt: skip
        # what is out of the grid is headed for through the nearest cell within
        inside_x = min(max(goal_x, origin[i, 0] + 3.0 * cell_size), origin[i, 0] + (size - 3.0) * cell_size)
        inside_y = min(max(goal_y, origin[i, 1] + 3.0 * cell_size), origin[i, 1] + (size - 3.0) * cell_size)
        goal_is_inside = inside_x == goal_x and inside_y == goal_y
        waited = steps[i] - planned_at[i]
        n = num_points[i]
        s = 0.0
        due = plans[i] == 0
        if n > 0:
            s, away, _ = project(points, arc, n, segments, i, x, y)
            if away > astray or stuck[i] >= 10 or waited >= timing[0]:
                due = waited >= timing[1]
            if abs(target[i, 0] - inside_x) + abs(target[i, 1] - inside_y) > 0.5 * cell_size:
                due = due or waited >= timing[1]
            needed = limits.hull_radius - 0.01 if no_path[i] == 0 else limits.hull_radius - give - 0.01
            if not plan_is_clear(grid, points, arc, n, segments[i], i, origin, cell, 6.0, needed):
                near = not plan_is_clear(grid, points, arc, n, segments[i], i, origin, cell, 1.0, needed)
                due = due or waited >= timing[1] or (near and waited >= timing[1] // 3)
        else:
            due = due or waited >= timing[1]
        if due and arrived[i] == 0:
            if scratch_size < size * size:
                scratch_size = size * size
                costs = np.empty(scratch_size)
                estimates = np.empty(scratch_size)
                parents = np.empty(scratch_size, np.int32)
                heap = np.empty(scratch_size, np.int32)
                places = np.empty(scratch_size, np.int32)
            if stuck[i] >= 10:
                bar_gap(chart, plan, i, limits.hull_radius + margin)
            plans[i] += 1
            planned_at[i] = steps[i]
            stuck[i] = 0
            target[i, 0] = inside_x
            target[i, 1] = inside_y
            found = False
            no_path[i] = 0
            for choice in range(4):
                if choice == 2:
                    # the map must be wrong: begin again with what is seen now
                    forgotten[i] += 1
                    grid[i] = 0
                    evidence[i] = 0
                    spots[i] = 0
                    enter_scan(
                        chart, i, origin, cell, x, y, heading, beams, ranges, max_range, limits.hull_radius
                    )  # fmt: skip
                found = plan_way(
                    limits, wanted, prices[choice % 2], prices[2], grid, plan, i, x, y, inside_x, inside_y,
                    costs, estimates, parents, heap, places,
                )  # fmt: skip
                if found:
                    no_path[i] = choice % 2
                    break
            if not found:
                num_points[i] = 0
                no_path[i] = 1
            s = 0.0
        speed_limit = np.inf
        if num_points[i] > 0:
            known = seen_ahead(evidence, points, arc, num_points[i], segments[i], i, s, origin, cell)
            speed_limit = max(creep, stopping_speed(known, limits.acceleration, limits.delay))
        last = commands[i, 0], commands[i, 1], commands[i, 2]
        stood = stuck[i]
        if arrived[i] == 1 or not evade(
            limits, grid, plan, evading, twists, ranges, beams, i, x, y, heading, steps[i], foreseen > count
        ):
            # between its cells the grid can say half a cell less than there is
            track(
                limits, grid, plan, i, x, y, heading, heading_errors[i], waypoints_left[i] < 0.5 and goal_is_inside,
                not full_circle, speed_limit, -0.5 * cell_size,
            )  # fmt: skip
        if keep_room(limits, plant, commands, twists, i, last, hits, count):
            stuck[i] = stood + 1
        steps[i] += 1


@inlined
def keep_room(limits, plant, commands, twists, i, last, hits, count):
    """Slows robot i's command so that it can stop before all hits; returns whether that leaves it standing.

    The grid is too coarse for the narrowest gaps: of what is near, the hits themselves say where it is.
    """
    vx = commands[i, 0]
    vy = commands[i, 1]
    yaw_rate = commands[i, 2]
    commands[i, 0], commands[i, 1], commands[i, 2] = last
    for share in (1.0, 0.6, 0.3, 0.1):
        if step_and_stop(plant, hits, count, commands, twists, i, share * vx, share * vy, share * yaw_rate):
            command(limits, commands, i, share * vx, share * vy, share * yaw_rate)
            return False
    command(limits, commands, i, 0.0, 0.0, 0.0)
    return True


@compiled
def evade(limits, grid, plan, evading, twists, ranges, beams, i, x, y, heading, step, approached):
    """Sets robot i's command away from what comes nearer by itself; returns whether anything does.

    The distance to the nearest surface falls by the part of the robot's velocity that points there; what it falls by
    besides, smoothed, is the surface's own.
    """
    _, _, _, _, _, _, commands, origin, cell = plan
    nearest, closing, within, ahead = evading
    k = 0
    for beam in range(1, beams.shape[0]):
        if ranges[i, beam] < ranges[i, k]:
            k = beam
    distance = ranges[i, k]
    ux = beams[k, 0]
    uy = beams[k, 1]
    own = twists[i, 0] * ux + twists[i, 1] * uy
    rate = (nearest[i] - distance) / limits.dt - own
    # a jump is another surface
    if step == 0 or abs(rate) > 1.5:
        rate = 0.0
    closing[i] += 0.2 * (rate - closing[i])
    nearest[i] = distance
    if not approached or closing[i] < 0.12 or distance - limits.hull_radius > within + closing[i] * ahead:
        return False
    needed = limits.hull_radius + limits.skin
    best = 0.0
    best_x = 0.0
    best_y = 0.0
    for option in range(5 if limits.holonomic else 1):
        turn = (0.0, 0.5, -0.5, 1.0, -1.0)[option]
        sine, cosine = sin_cos(turn)
        vx = -(cosine * ux - sine * uy)
        vy = -(sine * ux + cosine * uy)
        if not limits.holonomic:
            vx = -1.0 if ux > 0.0 else 1.0
            vy = 0.0
        free = free_arc(grid, i, origin, cell, x, y, heading, vx, vy, 0.0, 0.6, needed)
        speed = min(stopping_speed(free, limits.acceleration, limits.delay), limits.max_speed) * cosine
        if speed > best + 1e-9:
            best = speed
            best_x = speed * vx / cosine
            best_y = speed * vy / cosine
    command(limits, commands, i, best_x, best_y, 0.0)
    return True


@compiled
def plan_way(
    limits, wanted, prices, straight, grid, plan, i, x, y, goal_x, goal_y, costs, estimates, parents, heap, places
):  # fmt: skip
    """Lays robot i's polyline from (x, y) to the goal, or near it; returns whether there is a way."""
    points, arc, num_points, segments, _, _, _, origin, cell = plan
    levels = grid[i]
    size = grid.shape[1]
    row = int((y - origin[i, 1]) / cell[i])
    column = int((x - origin[i, 0]) / cell[i])
    start = nearest_free(levels, prices, row, column, 5)
    goal = nearest_free(
        levels, prices, int((goal_y - origin[i, 1]) / cell[i]), int((goal_x - origin[i, 0]) / cell[i]), 5
    )
    if start < 0 or goal < 0 or not search(levels, prices, start, goal, False, costs, estimates, parents, heap, places):
        return False
    cells = pulled(levels, straight, traced(parents, goal, size))
    corners = np.empty((cells.shape[0] + 2, 2))
    corners[0, 0] = x
    corners[0, 1] = y
    # the end cells stand for the ends, unless those lie in a blocked cell
    skip_first = 1 if start == row * size + column else 0
    last = cells.shape[0]
    end_x = origin[i, 0] + (cells[last - 1, 1] + 0.5) * cell[i]
    end_y = origin[i, 1] + (cells[last - 1, 0] + 0.5) * cell[i]
    if abs(end_x - goal_x) <= 0.51 * cell[i] and abs(end_y - goal_y) <= 0.51 * cell[i]:
        last -= 1
    count = 1
    for k in range(skip_first, last):
        corners[count, 0] = origin[i, 0] + (cells[k, 1] + 0.5) * cell[i]
        corners[count, 1] = origin[i, 1] + (cells[k, 0] + 0.5) * cell[i]
        count += 1
    corners[count, 0] = goal_x
    corners[count, 1] = goal_y
    count += 1
    pinned = np.zeros(count, np.bool_)
    held = lay(points, arc, num_points, segments, i, corners[:count], pinned, cell[i])
    relax(grid, points, arc, num_points, i, origin, cell, held, limits.hull_radius + wanted, limits.hull_radius, 20)
    return True


@compiled
def bar_gap(chart, plan, i, narrow):
    """Bars the narrowest place of the next metre of robot i's polyline, if it has less than `narrow` clearance (m)."""
    grid, evidence, _, _ = chart
    points, arc, num_points, segments, _, _, _, origin, cell = plan
    least = narrow
    found = -1
    for k in range(segments[i] + 1, num_points[i]):
        if arc[i, k] > arc[i, segments[i]] + 1.0:
            break
        clearance = clearance_at(grid, i, origin, cell, points[i, k, 0], points[i, k, 1])
        if clearance < least:
            least = clearance
            found = k
    if found >= 0:
        row = int((points[i, found, 1] - origin[i, 1]) / cell[i])
        column = int((points[i, found, 0] - origin[i, 0]) / cell[i])
        evidence[i, row, column] = BARRED
        mark(chart, i, row, column, SUB * SUB // 2 + SUB // 2)


@inlined
def seen_ahead(evidence, points, arc, n, segment, i, s, origin, cell):
    """Returns how far (m) along robot i's polyline all cells have been seen, looked up to a metre ahead."""
    ahead = 0.0
    while ahead < 1.0:
        px, py = point_at(points, arc, n, segment, i, s + ahead)
        row = int((py - origin[i, 1]) / cell[i])
        column = int((px - origin[i, 0]) / cell[i])
        if evidence[i, row, column] == 0:
            break
        ahead += 0.5 * cell[i]
    return ahead
