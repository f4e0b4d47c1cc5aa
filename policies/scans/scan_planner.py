"""A planner without a map: it draws its own from the scans, takes what it has not seen for free, and plans in it."""

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots import Robot
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ScanLaw
from wayfield.policies.parts.polyline_tracker import (
    PLAN,
    PolylineTracker,
    clearance_at,
    clearance_prices,
    command,
    free_arc,
    plan_is_clear,
    plan_way,
    point_at,
    project,
    stopping_speed,
    track,
)
from wayfield.policies.parts.scan_map import (
    BARRED,
    CELLS,
    CHART,
    SUB,
    enter_point,
    enter_scan,
    forget,
    mark,
    move_grid,
    stamps,
)
from wayfield.policies.parts.stopping import (
    SECTORS,
    SIGHTS,
    Scan,
    Seen,
    find_approaching,
    find_hits,
    remembering,
    sees_all_round,
    step_and_stop,
)
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import sin_cos

STATE = [
    *PLAN,
    ("stay", np.float64),  # m, of `PolylineTracker.stay`
    ("forgotten", np.int64),  # how often the map was
    ("nearest", np.float64),  # m, the surface nearest to the robot
    ("closing", np.float64),  # m/s, at which that comes nearer by itself
    *SIGHTS,
    *CHART,
]

NEAR = 1.5  # m, within which the hits themselves are looked at
RECALL, LONG_RECALL = 1.0, 10.0  # s, for which they are remembered; the longer by a hull that may fill a door
BESIDE = 1.25  # radii of such a hull, nearer than which it remembers hits for as long as it stands: it may be in a door
FINE, HULL = 0.35, 0.3  # m: up to which hull the grid is as `cell` says, and the one that `cell` is for


@dataclasses.dataclass(frozen=True)
class ScanPlanner(PolylineTracker, ScanLaw):
    """Maps what its beams hit, plans a way to the goal as if all else were free, drives it, and plans anew when wrong.

    The grid, 160 x 160 cells of `cell` (12.8 m square) in the frame of the measured pose, holds for each cell the
    evidence of the scans (a hit counts 6, up to 18, a beam that goes through -1, so that what has moved away is
    forgotten), the spots of its hits to a quarter of a cell, and the clearance of its centre from all spots, kept up to
    date by stamping. The grid is laid half-way to the goal, at most a quarter of its side from the robot, and again
    when the robot comes within a tenth of its side of the border; what leaves it is forgotten. A goal beyond it is
    replaced by the nearest cell within. For a hull above 0.35 m `cell` and `give` are multiplied by hull / 0.3 m: it
    has farther to go round what stands.

    A* searches cells with clearance above hull radius + `margin`; a metre costs 1 + weight times what lacks to
    `wanted_clearance`. If there is no way, cells down to hull radius - `give` serve, for a cell's centre may lie beside
    the middle of a gap; a gap that turns out too narrow when the robot stands before it is barred. If there is no way
    still, the robot forgets the map but for what it now sees. The way is straightened by line of sight, let go like an
    elastic band, and driven by the law of `PolylineTracker`; into cells not seen yet the robot drives with room to stop
    before them, or creeps. Whatever it drives, it slows until it can stop before the hits themselves, of this scan and
    of the last second. A round hull of 0.35 m and more may fill the narrowest doors of its class: it remembers hits for
    ten seconds, those beside it for as long as it stands, and keeps them in the map, where beams that pass beside the
    end of a thin wall would take it out (a box is narrower than the disc around it). It plans anew when the plan gets
    blocked, the goal changes, it has been moved more than `astray`, is stuck, or `period` has passed.

    What comes nearer by itself (`find_approaching`) is also entered where it will be in `foresight`, so that ways lead
    around it; one that is `evade_within` away, or will be in `evade_time`, is backed away from.

    Serves differential drives and omni bases (which look where they go when the beams are less than a full circle).
    Any number of beams and field of view; few beams see late. Limits: a differential drive cannot step aside of what
    comes from the side; a wall that distant beams miss looks open; a pose that drifts smears the map.

    Source: Koenig and Likhachev, T-RO 21(3), 2005 (free-space assumption; here with A* from scratch); occupancy
    evidence as in Elfes 1989; elastic band as in Quinlan and Khatib 1993.
    """

    cell: float = gain(0.08, "m", "side of a cell of the grid", above=0.0)
    margin: float = gain(0.02, "m", "beside the hull, least", least=0.0, search=(0.005, 0.06))
    give: float = gain(0.03, "m", "of the hull, where there is no other way", least=0.0)
    wanted_clearance: float = gain(0.2, "m", "beside the hull", above=0.0, search=(0.05, 0.4))
    weight: float = gain(3.0, "1", "of lacking clearance, in the price of a metre", least=0.0, search=(0.5, 10.0))
    period: float = gain(4.0, "s", "between plans, at most", above=0.0)
    pause: float = gain(0.3, "s", "between searches at least, unless the block is near", least=0.0)
    astray: float = gain(0.5, "m", "from the plan, beyond which it is made anew", above=0.0)
    creep: float = gain(0.15, "m/s", "into what has not been seen", above=0.0)
    foresight: float = gain(1.2, "s", "for which what comes nearer is put forward", least=0.0, search=(0.5, 3.0))
    evade_within: float = gain(0.2, "m", "beside the hull, of what comes nearer by itself", least=0.0)
    evade_time: float = gain(1.0, "s", "until it would be that near", least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty map and no plan for each robot, (b,): a record of STATE and the scans of `remembering`.

        Raises:
            ValueError: if there are no beams.
        """
        memory = remembering(self, briefing, STATE)
        memory["state"]["stay"] = self.stay(briefing)
        return memory

    def act_on(
        self, scan: Scan, observation: goal_reaching.Observation, briefing: Briefing, state: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t) in m/s and rad/s."""
        radius = briefing.robot.hull_radius
        self = _for_hull(self, radius)
        recall = self.recall(briefing.robot)
        prices = search_prices(radius, self.margin, self.give, self.wanted_clearance, self.weight)
        p = self.params(
            briefing,
            **search(self.cell),
            recall=recall,
            beside=BESIDE * radius if recall > RECALL else 0.0,
            period_steps=round(self.period / briefing.dt),
            pause_steps=round(self.pause / briefing.dt),
            all_round=sees_all_round(briefing),
        )
        table = stamps(self.cell, radius + self.wanted_clearance + 1.5 * self.cell)
        decide(p, prices, table, scan, Seen.of(observation, briefing), state)
        return self.twists(briefing, state)

    def recall(self, robot: Robot) -> float:
        """Returns for how long (s) hits are remembered that are out of sight."""
        return LONG_RECALL if fills_doors(robot) else RECALL

    def driven(self, memory: NDArray[Any], commands: NDArray[np.float64]) -> None:
        """Takes the commands (b, 3), as the plant takes them, that were driven in place of those it asked for."""
        memory["state"]["command"] = commands


def fills_doors(robot: Robot) -> bool:
    """Returns whether a robot's hull may fill the narrowest doors of its class: a box is narrower than its disc."""
    return robot.hull_box is None and robot.hull_radius >= FINE


def search(cell: float) -> dict[str, float]:
    """Returns how `plan` looks for a way on a grid of what is seen, with cells of this side (m)."""
    return {"theta": False, "snap": 4.5 * cell, "spacing": 1.0, "rounds": 20}


def search_prices(radius: float, margin: float, give: float, wanted: float, weight: float) -> NDArray[np.float64]:
    """Returns the prices of a cell, by its clearance, of each of the searches of `plan`; all in m beside the hull."""
    return np.array(
        [
            clearance_prices(radius + margin, radius + wanted, weight),
            clearance_prices(radius - give, radius + wanted, weight),
            clearance_prices(radius + 0.5 * wanted, 0.0, 0.0),  # where lines are drawn straight
        ]
    )


@functools.lru_cache
def _for_hull(law: ScanPlanner, radius: float) -> ScanPlanner:
    """Returns a law with the grid for a hull (m)."""
    size = radius / HULL if radius > FINE else 1.0
    return dataclasses.replace(law, cell=size * law.cell, give=size * law.give)


@any_layout
@allocating
def decide(params, prices, table, scan, seen, memory):
    """Sets the commands of all robots: enters the scans, plans where it must be, and tracks."""
    p = params[0]
    points = np.empty((2 * scan.ranges.shape[1] + SECTORS, 3))
    for i in range(scan.ranges.shape[0]):
        m = memory[i]
        pose, goal, inside = enter(p, m, table, scan, seen, i)
        x, y, heading = pose
        sine, cosine = sin_cos(heading)
        count = find_hits(p, scan, seen, m, i, NEAR, p.plant.hull_radius + 0.5 * p.skin, points, p.beside)
        foreseen = find_approaching(p, scan, seen, m, i, p.plant.hull_radius, points, count)
        # beams that pass beside the end of a thin wall take it off the map, where they look through its cell
        for j in range(0 if p.recall > RECALL else count, foreseen):
            hit_x = x + cosine * points[j, 0] - sine * points[j, 1]
            hit_y = y + sine * points[j, 0] + cosine * points[j, 1]
            enter_point(m, table, hit_x, hit_y)
        due, s = plan_is_due(p, m, x, y, inside[0], inside[1])
        if due and m.arrived == 0:
            plan(p, m, prices, table, scan, i, pose, inside[0], inside[1])
            s = 0.0
        speed_limit = np.inf
        if m.num_points > 0:
            speed_limit = max(p.creep, stopping_speed(seen_ahead(m, s), p.acceleration, p.delay))
        last = m.command[0], m.command[1], m.command[2]
        stood = m.stuck
        if m.arrived == 1 or not evade(p, m, scan, seen, i, foreseen > count):
            is_goal = seen.waypoints_left[i] < 0.5 and inside == goal
            # between its cells the grid can say half a cell less than there is
            track(p, m, pose, seen.heading_errors[i], is_goal, not p.all_round, speed_limit, -0.5 * p.cell)
        if keep_room(p, m, seen.twists[i], last, points[:count]):
            m.stuck = stood + 1
        m.steps += 1


@inlined
def enter(p, m, table, scan, seen, i):
    """Enters robot i's scan into its grid; returns its pose, its goal, and the point to plan to, m, world frame.

    What is out of the grid is headed for through the nearest cell within.
    """
    x = seen.poses[i, 0]
    y = seen.poses[i, 1]
    pose = x, y, seen.poses[i, 2]
    sine, cosine = sin_cos(seen.poses[i, 2])
    goal_x = x + cosine * seen.goals[i, 0] - sine * seen.goals[i, 1]
    goal_y = y + sine * seen.goals[i, 0] + cosine * seen.goals[i, 1]
    place_grid(p, m, x, y, goal_x, goal_y)
    enter_scan(m, table, scan, i, pose, p.plant.hull_radius)
    inside_x = min(max(goal_x, m.origin[0] + 3.0 * p.cell), m.origin[0] + (CELLS - 3.0) * p.cell)
    inside_y = min(max(goal_y, m.origin[1] + 3.0 * p.cell), m.origin[1] + (CELLS - 3.0) * p.cell)
    return pose, (goal_x, goal_y), (inside_x, inside_y)


@inlined
def place_grid(p, m, x, y, goal_x, goal_y):
    """Lays the grid half-way to the goal, but no more than a quarter of it away, and again where it gets too near."""
    quarter = 0.25 * CELLS * p.cell
    middle_x = x + min(max(0.5 * (goal_x - x), -quarter), quarter)
    middle_y = y + min(max(0.5 * (goal_y - y), -quarter), quarter)
    if m.steps == 0:
        m.cell = p.cell
        m.origin[0] = middle_x - 2.0 * quarter
        m.origin[1] = middle_y - 2.0 * quarter
    off = max(abs(x - m.origin[0] - 2.0 * quarter), abs(y - m.origin[1] - 2.0 * quarter))
    if off > 1.6 * quarter:
        move_grid(m, middle_x, middle_y)
        m.num_points = 0


@inlined
def plan_is_due(p, m, x, y, target_x, target_y):
    """Returns whether to plan (anew), and how far along its plan (m) the robot is.

    Args:
        target_x, target_y: where a plan would have to lead, m.
    """
    waited = m.steps - m.planned_at
    rested = waited >= p.pause_steps
    if m.num_points == 0:
        return m.plans == 0 or rested, 0.0
    s, away, _ = project(m, x, y)
    due = m.plans == 0
    if away > p.astray or m.stuck >= 10 or waited >= p.period_steps:
        due = rested
    if abs(m.target[0] - target_x) + abs(m.target[1] - target_y) > 0.5 * p.cell:
        due = due or rested
    needed = p.plant.hull_radius - 0.01 if m.no_path == 0 else p.plant.hull_radius - p.give - 0.01
    if not plan_is_clear(m, 6.0, needed):
        near = not plan_is_clear(m, 1.0, needed)
        due = due or rested or (near and waited >= p.pause_steps // 3)
    return due, s


@allocating
def plan(p, m, prices, table, scan, i, pose, target_x, target_y):
    """Plans robot i's way: by the wanted margin, or a narrower one, or these two once the map is forgotten.

    Args:
        prices: (3, 256) for the wanted margin, for the narrower one, and for lines of sight.
    """
    if m.stuck >= 10:
        bar_gap(m, table, p.plant.hull_radius + p.margin)
    m.plans += 1
    m.planned_at = m.steps
    m.stuck = 0
    m.target[0] = target_x
    m.target[1] = target_y
    stops = np.empty((1, 2))
    stops[0, 0] = target_x
    stops[0, 1] = target_y
    for choice in range(4):
        if choice == 2:
            # the map must be wrong: begin again with what is seen now
            m.forgotten += 1
            forget(m)
            enter_scan(m, table, scan, i, pose, p.plant.hull_radius)
        if plan_way(p, m, prices[choice % 2], prices[2], pose[0], pose[1], stops, np.inf) < np.inf:
            m.no_path = choice % 2
            return
    m.num_points = 0
    m.no_path = 1


@inlined
def keep_room(p, m, wheels, last, hits):
    """Slows the command so that the robot can stop before all hits; returns whether that leaves it standing.

    The grid is too coarse for the narrowest gaps: of what is near, the hits themselves say where it is.

    Args:
        wheels: (3,) the measured twist.
        last: the command before this one.
    """
    vx = m.command[0]
    vy = m.command[1]
    yaw_rate = m.command[2]
    m.command[0], m.command[1], m.command[2] = last
    for share in (1.0, 0.6, 0.3, 0.1):
        # the brakes of the plant that it reads are those of this law
        if step_and_stop(p.plant, hits, m.command, wheels, share * vx, share * vy, share * yaw_rate):
            command(p, m, share * vx, share * vy, share * yaw_rate)
            return False
    command(p, m, 0.0, 0.0, 0.0)
    return True


@compiled
def evade(p, m, scan, seen, i, approached):
    """Sets robot i's command away from what comes nearer by itself; returns whether anything does.

    The distance to the nearest surface falls by the part of the robot's velocity that points there; what it falls by
    besides, smoothed, is the surface's own.
    """
    k = 0
    for beam in range(1, scan.directions.shape[0]):
        if scan.ranges[i, beam] < scan.ranges[i, k]:
            k = beam
    distance = scan.ranges[i, k]
    ux = scan.directions[k, 0]
    uy = scan.directions[k, 1]
    own = seen.twists[i, 0] * ux + seen.twists[i, 1] * uy
    rate = (m.nearest - distance) / p.plant.dt - own
    # a jump is another surface
    if m.steps == 0 or abs(rate) > 1.5:
        rate = 0.0
    m.closing += 0.2 * (rate - m.closing)
    m.nearest = distance
    within = p.evade_within + m.closing * p.evade_time
    if not approached or m.closing < 0.12 or distance - p.plant.hull_radius > within:
        return False
    needed = p.plant.hull_radius + p.skin
    pose = seen.poses[i, 0], seen.poses[i, 1], seen.poses[i, 2]
    best = 0.0
    best_x = 0.0
    best_y = 0.0
    for option in range(5 if p.plant.holonomic else 1):
        turn = (0.0, 0.5, -0.5, 1.0, -1.0)[option]
        sine, cosine = sin_cos(turn)
        vx = -(cosine * ux - sine * uy)
        vy = -(sine * ux + cosine * uy)
        if not p.plant.holonomic:
            vx = -1.0 if ux > 0.0 else 1.0
            vy = 0.0
        free = free_arc(m, pose, vx, vy, 0.0, 0.6, needed)
        speed = min(stopping_speed(free, p.acceleration, p.delay), p.max_speed) * cosine
        if speed > best + 1e-9:
            best = speed
            best_x = speed * vx / cosine
            best_y = speed * vy / cosine
    command(p, m, best_x, best_y, 0.0)
    return True


@compiled
def bar_gap(m, table, narrow):
    """Bars the narrowest place of the next metre of the polyline, if it has less than `narrow` clearance (m)."""
    least = narrow
    gap = -1
    for k in range(m.segment + 1, m.num_points):
        if m.arc[k] > m.arc[m.segment] + 1.0:
            break
        clearance = clearance_at(m, m.points[k, 0], m.points[k, 1])
        if clearance < least:
            least = clearance
            gap = k
    if gap >= 0:
        size = m.evidence.shape[0]
        row = min(max(int((m.points[gap, 1] - m.origin[1]) / m.cell), 0), size - 1)
        column = min(max(int((m.points[gap, 0] - m.origin[0]) / m.cell), 0), size - 1)
        m.evidence[row, column] = BARRED
        mark(m, table, row, column, SUB * SUB // 2 + SUB // 2)


@inlined
def seen_ahead(m, s):
    """Returns how far (m) along the polyline all cells have been seen, looked up to a metre ahead of s."""
    ahead = 0.0
    while ahead < 1.0:
        px, py = point_at(m, m.segment, s + ahead)
        row = int((py - m.origin[1]) / m.cell)
        column = int((px - m.origin[0]) / m.cell)
        inside = 0 <= row < m.evidence.shape[0] and 0 <= column < m.evidence.shape[1]
        if not inside or m.evidence[row, column] == 0:
            break
        ahead += 0.5 * m.cell
    return ahead
