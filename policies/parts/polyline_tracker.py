"""The tracking law that planners share: along a polyline, through a grid that tells how near the obstacles are."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots.kinematics import integrate_arc, limit_acceleration, to_body_frame
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.grid_search import (
    any_angle_way,
    pulled,
    scratch_for,
    search,
    straight_length,
    traced,
)
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params_of
from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.stopping import rest_radius
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

# A grid's bytes hold how near the obstacles are: the clearance of a cell's centre falls short of FARTHEST by so many
# units. Zero, what fresh memory holds, is clear.
UNIT = 0.005  # m
FINE_CELL = 0.1  # m, a side of a cell at whose middle is known what is at all of it, nearly
FARTHEST = 255 * UNIT  # m

STRIDE = 0.04  # m, between the places at which an arc ahead is tried

POINTS = 512  # of a plan
TURN_SHARE = 4  # points of a plan for each turn of a way, goals included


def plan_fields(points: int) -> list[Any]:
    """Returns the fields of a robot's part of a planner's memory, for plans of so many points, but for its `grid`."""
    return [
        ("command", np.float64, (3,)),  # the last commanded twist, m/s and rad/s
        ("origin", np.float64, (2,)),  # corner of the grid's first cell, m, world frame
        ("cell", np.float64),  # m
        ("target", np.float64, (2,)),  # where the plan ends, m, world frame
        ("points", np.float64, (points, 2)),  # of the polyline, m, world frame
        ("arc", np.float64, (points,)),  # m, of the points along it
        ("num_points", np.int64),  # 0: there is no plan
        ("segment", np.int64),  # of the polyline, on which the robot is
        ("arrived", np.int64),  # 1: at the goal, turning to its heading
        ("steps", np.int64),  # since the episode began
        ("stuck", np.int64),  # steps in a row without a way to move
        ("no_path", np.int64),  # 1: the last search found no way
        ("plans", np.int64),  # searches so far
        ("planned_at", np.int64),  # step of the last search; of the A* tracker, of the last around patrols
    ]


PLAN = plan_fields(POINTS)


@dataclasses.dataclass(frozen=True)
class PolylineTracker(GoalLaw, Policy):
    """Regulated pursuit of a polyline, with room to stop: the gains that planners share. They add reset and act.

    With s the projection on the polyline (searched in a window around the last one), c the least clearance of the
    polyline up to `lookahead` further on, r the hull radius, share = (c - r)/slow_clearance between 0 and 1, (x, y) in
    the body frame the point max(share, 0.3) `lookahead` further on, kappa = 2 y/(x^2 + y^2) the curvature of the arc to
    it, rest the way left, a and T the deceleration and the dead time, D(v) = v T + v^2/(2 a):

        v = min(max_speed, max_speed / (min_turn_radius |kappa|), max_yaw_rate / |kappa|,
                slow_speed + (max_speed - slow_speed) share, D^-1(rest)),    w = kappa v

    Beyond `rotate_beyond` of bearing the robot stops and turns on the spot, w = sqrt(2 alpha |bearing|) at most. An
    omni base drives straight at the point and turns independently. Both slow to D^-1(free), where free is the way along
    the arc actually driven on which the hull keeps `skin` of room; where that is short, nearer points are tried (a
    half, a quarter of the way), which turn towards the polyline. At its end the robot stops and turns to the heading.

    Source: regulated pure pursuit, Macenski et al., Autonomous Robots 47, 2023 (arXiv 2305.20026), with the curvature
    limit as a yaw-rate limit; room to stop as in Fox, Burgard and Thrun, RAM 4(1), 1997.
    """

    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    acceleration: float = gain(0.8, "m/s^2", "at most, and at most 0.8 of what the base can do", above=0.0)
    yaw_acceleration: float = gain(2.4, "rad/s^2", "likewise", above=0.0)
    max_yaw_rate: float = gain(1.5, "rad/s", "at most", above=0.0)
    lookahead: float = gain(0.4, "m", "along the polyline", above=0.0)
    min_turn_radius: float = gain(0.4, "m", "where the speed begins to fall", above=0.0)
    rotate_beyond: float = gain(0.785, "rad", "bearing beyond which a differential drive turns on the spot", above=0.0)
    slow_speed: float = gain(0.2, "m/s", "with no room beside the hull", above=0.0)
    slow_clearance: float = gain(0.15, "m", "room beside the hull for the full speed", above=0.0)
    skin: float = gain(0.01, "m", "room that the hull keeps where it can", least=0.0)
    arrive: float = gain(0.015, "m", "from the goal, or less if the goal asks for it", above=0.0)

    def params(self, briefing: Briefing, **more: float) -> NDArray[np.void]:
        """Returns what the law reads, see `params.params`: the plant's accelerations are those that the law allows."""
        gentle = dataclasses.replace(
            briefing.actuators,
            acceleration=min(self.acceleration, 0.8 * briefing.actuators.acceleration),
            yaw_acceleration=min(self.yaw_acceleration, 0.8 * briefing.actuators.yaw_acceleration),
        )
        return params_of(
            self,
            briefing.robot,
            gentle,
            briefing.dt,
            acceleration=gentle.acceleration,
            yaw_acceleration=gentle.yaw_acceleration,
            slow_speed=min(self.slow_speed, self.max_speed),
            delay=briefing.actuators.reaction + 2.0 * briefing.dt,  # s, until the base follows a command
            **more,
        )

    def stay(self, briefing: Briefing) -> Any:
        """Returns how far from its goal (m) each robot may stay once it arrived."""
        return rest_radius(self.arrive + 0.05, briefing.position_tolerance)

    def twists(self, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t) of the commands in memory."""
        return memory["command"][:, list(briefing.robot.twist_axes)]


def clearance_prices(least: float, wanted: float, weight: float) -> NDArray[np.float64]:
    """Returns what a metre costs at each level of a grid, (256,): inf with less clearance than `least`, 1 at `wanted`.

    In between 1 + weight times the share of wanted - least that is missing; wanted <= least is all or nothing.
    """
    clearance = FARTHEST - UNIT * np.arange(256)
    missing = np.clip((wanted - clearance) / max(wanted - least, 1e-9), 0.0, 1.0)
    return np.where(clearance >= least - 1e-9, 1.0 + weight * missing, np.inf)


@inlined
def level_of(clearance):
    """Returns the byte of a clearance (m), rounded to the side of caution."""
    return np.uint8(min(max(math.ceil((FARTHEST - clearance) / UNIT - 1e-6), 0.0), 255.0))


@compiled
def clearance_at(m, x, y):
    """Returns the clearance (m) at a point, between those of the four cells around it; FARTHEST beyond the grid."""
    grid = m.grid
    u = (x - m.origin[0]) / m.cell - 0.5
    v = (y - m.origin[1]) / m.cell - 0.5
    column = math.floor(u)
    row = math.floor(v)
    if column < 0 or row < 0 or column + 1 >= grid.shape[1] or row + 1 >= grid.shape[0]:
        return FARTHEST
    u -= column
    v -= row
    near = (1.0 - u) * grid[row, column] + u * grid[row, column + 1]
    far = (1.0 - u) * grid[row + 1, column] + u * grid[row + 1, column + 1]
    return FARTHEST - UNIT * ((1.0 - v) * near + v * far)


@inlined
def stopping_speed(distance, acceleration, delay):
    """Returns the speed (m/s) from which the robot stops within the distance (m): v delay + v^2/(2 a) = distance."""
    if distance <= 0.0:
        return 0.0
    dead = acceleration * delay
    return math.sqrt(dead * dead + 2.0 * acceleration * distance) - dead


@compiled
def free_arc(m, pose, ux, uy, curvature, reach, needed):
    """Returns how far (m, at most `reach`) the disc can go along an arc with `needed` clearance.

    A disc that has less already may go where it does not get less still.

    Args:
        pose: (x, y, heading).
        ux, uy: direction of motion in the body frame, a unit vector.
        curvature: 1/m, turn of the body per metre.
    """
    x, y, heading = pose
    needed = min(needed, clearance_at(m, x, y) - 1e-4)
    gone = 0.0
    while gone < reach:
        stride = min(STRIDE, reach - gone + 1e-9)
        x, y, heading = integrate_arc(x, y, heading, ux, uy, curvature, stride)
        if clearance_at(m, x, y) < needed:
            return gone
        gone += stride
    return reach


@compiled
def track(p, m, pose, heading_error, is_goal, facing, speed_limit, least_room):
    """Sets a robot's command by the law of `PolylineTracker`.

    Args:
        p: the record of `PolylineTracker.params`.
        m: the robot's record of PLAN, its `grid` (rows, columns) of bytes, and m.stay (m) of `PolylineTracker.stay`.
        pose: (x, y, heading).
        heading_error: rad, of the goal heading.
        is_goal: whether the polyline ends at the goal rather than at a waypoint.
        facing: whether an omni base looks where it goes, rather than turning to the goal heading.
        speed_limit: m/s; below zero the robot backs away along the polyline.
        least_room: m, what may become of the skin where the polyline is narrow; below zero where the grid says less
            than there is.
    """
    x, y, heading = pose
    n = m.num_points
    if n == 0:
        command(p, m, 0.0, 0.0, 0.0)
        return
    end_x = m.points[n - 1, 0]
    end_y = m.points[n - 1, 1]
    s, _away, tangent = project(m, x, y)
    distance = math.sqrt((end_x - x) ** 2 + (end_y - y) ** 2)
    rest = max(m.arc[n - 1] - s, distance if s > m.arc[n - 1] - 0.3 else 0.0)
    if is_goal:
        if distance < min(p.arrive, 0.5 * m.stay):
            m.arrived = 1
        elif distance > m.stay:
            m.arrived = 0
        if m.arrived == 1:
            settle(p, m, pose, heading_error)
            return
    else:
        m.arrived = 0
        rest += 0.3  # a waypoint is passed, not stopped at
    if speed_limit < 0.0:
        back_away(p, m, pose, tangent, -speed_limit)
        return
    narrow = narrowest(p, m, s)
    share = min(max((narrow - p.plant.hull_radius) / p.slow_clearance, 0.0), 1.0)
    allowed = min(p.slow_speed + (p.max_speed - p.slow_speed) * share, speed_limit)
    allowed = min(allowed, stopping_speed(rest, p.acceleration, p.delay))
    # where the polyline itself is narrower the hull follows it
    needed = p.plant.hull_radius + min(p.skin, max(narrow - p.plant.hull_radius - UNIT, least_room))
    # where there is little room the robot keeps to the polyline instead of cutting its corners
    ahead = p.lookahead * max(share, 0.3)
    best, vx, vy, w = pursue(p, m, pose, s, tangent, ahead, allowed, needed)
    if best < 0.02 and allowed > 0.05:
        m.stuck += 1
    else:
        m.stuck = 0
    if p.plant.holonomic:
        speed = math.sqrt(vx * vx + vy * vy)
        if facing and rest > 0.3 and speed > 0.05:
            px, py = point_at(m, m.segment, s + 0.5)
            heading_error = wrap_angle(bearing(py - y, px - x) - heading)
        # turning turns the velocity too: no faster than a part of the acceleration can make up for
        most = 0.4 * p.acceleration / max(speed, 0.1)
        w = min(max(turn_rate(p, heading_error), -most), most)
    command(p, m, vx, vy, w)


@inlined
def settle(p, m, pose, heading_error):
    """Sets the command of a robot at its goal: it turns to the heading, and an omni base keeps its place."""
    m.stuck = 0
    vx = 0.0
    vy = 0.0
    if p.plant.holonomic:
        x, y, heading = pose
        sine, cosine = sin_cos(heading)
        vx, vy = to_body_frame(x, y, sine, cosine, m.points[m.num_points - 1, 0], m.points[m.num_points - 1, 1])
    command(p, m, vx, vy, turn_rate(p, heading_error))


@inlined
def facing_late(p, m):
    """Returns by how much (rad) an omni base will have turned when it does what it is told.

    The velocity asked for acts late, and turns with the body until then: the base aims for where it faces then.
    """
    return 0.7 * p.delay * m.command[2] if p.plant.holonomic else 0.0


@inlined
def back_away(p, m, pose, tangent, fastest):
    """Sets the command that backs away along the polyline's tangent (rad), at `fastest` (m/s) at most."""
    _, _, heading = pose
    ty, tx = sin_cos(tangent - heading - facing_late(p, m))
    if not p.plant.holonomic:
        tx = 1.0
        ty = 0.0
    free = free_arc(m, pose, -tx, -ty, 0.0, 0.5, p.plant.hull_radius + p.skin)
    v = min(fastest, stopping_speed(free, p.acceleration, p.delay))
    command(p, m, -v * tx, -v * ty, 0.0)


@inlined
def narrowest(p, m, s):
    """Returns the least clearance (m) of the polyline from arc length s to `lookahead` further on."""
    narrow = FARTHEST
    for k in range(9):
        px, py = point_at(m, m.segment, s + 0.125 * k * p.lookahead)
        narrow = min(narrow, clearance_at(m, px, py))
    return narrow


@inlined
def pursue(p, m, pose, s, tangent, ahead, allowed, needed):
    """Returns (speed, vx, vy, yaw_rate): the fastest of the ways to a point `ahead` (m), a half, a quarter of that.

    A way that is nearly as fast as the robot wants is not bettered. The speed is that of turning on the spot, 0.02 m/s,
    where the point lies too far aside.
    """
    x, y, heading = pose
    sine, cosine = sin_cos(heading + facing_late(p, m))
    best = -1.0
    twist = 0.0, 0.0, 0.0
    for _ in range(3):
        px, py = point_at(m, m.segment, s + ahead)
        bx, by = to_body_frame(x, y, sine, cosine, px, py)
        if p.plant.holonomic:
            # how sharply the way turns: the angle from the polyline's direction to the point
            turn = wrap_angle(bearing(py - y, px - x) - tangent)
            speed, vx, vy, wanted = straight_to(p, m, pose, bx, by, turn, allowed, needed)
            w = 0.0
        elif abs(bearing(by, bx)) > p.rotate_beyond:
            # turning on the spot is always free for a disc
            if best < 0.02:
                best = 0.02
                twist = 0.0, 0.0, turn_rate(p, bearing(by, bx))
            break
        else:
            speed, w, wanted = arc_to(p, m, pose, bx, by, allowed, needed)
            vx = speed
            vy = 0.0
        if speed > best:
            best = speed
            twist = vx, vy, w
        if speed >= 0.6 * wanted:
            break
        ahead *= 0.5
    return best, twist[0], twist[1], twist[2]


@inlined
def straight_to(p, m, pose, bx, by, turn, allowed, needed):
    """Returns (speed, vx, vy, wanted speed) of an omni base that drives straight at (bx, by), m, body frame.

    Args:
        turn: rad, by which the way turns there.
    """
    d = max(math.sqrt(bx * bx + by * by), 1e-9)
    v = allowed
    bend = 2.0 * abs(sin_cos(turn)[0]) / d if abs(turn) < 1.57 else 2.0 / d
    if d > 0.1:
        v = min(v, math.sqrt(0.5 * p.acceleration / max(bend, 1e-9)))
    vx, vy, _ = limit_acceleration(
        (m.command[0], m.command[1], 0.0), (v * bx / d, v * by / d, 0.0), p.acceleration, p.yaw_acceleration, p.plant.dt
    )
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > 1e-6:
        bend = m.command[2] / max(speed, 0.1)
        reach = min(speed * p.delay + 0.5 * speed * speed / p.acceleration + STRIDE, d)
        free = free_arc(m, pose, vx / speed, vy / speed, bend, reach, needed)
        most = stopping_speed(free, p.acceleration, p.delay)
        # also the straight way at the point, where braking has bent the limited velocity away from it
        if most < speed:
            vx *= most / speed
            vy *= most / speed
            if most < 0.3 * speed:
                free = free_arc(m, pose, bx / d, by / d, bend, reach, needed)
                most = min(v, stopping_speed(free, p.acceleration, p.delay))
                vx = most * bx / d
                vy = most * by / d
            speed = most
    return speed, vx, vy, v


@inlined
def arc_to(p, m, pose, bx, by, allowed, needed):
    """Returns (speed, yaw rate, wanted speed) of a differential drive on the arc to (bx, by), m, body frame."""
    d = max(math.sqrt(bx * bx + by * by), 1e-9)
    last_v = m.command[0]
    curvature = 2.0 * by / (d * d)
    v = min(allowed, p.max_yaw_rate / max(abs(curvature), 1e-9))
    v = min(v, p.max_speed / max(p.min_turn_radius * abs(curvature), 1e-9))
    v = min(max(v, min(0.05, allowed)), last_v + p.acceleration * p.plant.dt)
    v = max(v, last_v - p.acceleration * p.plant.dt)
    w = limited(curvature * v, m.command[2], p.yaw_acceleration * p.plant.dt)
    reach = min(v * p.delay + 0.5 * v * v / p.acceleration + STRIDE, d)
    bend = min(max(w / max(v, 0.05), -10.0), 10.0)
    free = free_arc(m, pose, 1.0, 0.0, bend, reach, needed)
    most = min(v, stopping_speed(free, p.acceleration, p.delay))
    # blocked close ahead: turn towards the polyline
    return most, curvature * most if most > 0.05 else turn_rate(p, bearing(by, bx)), v


@inlined
def limited(wanted, last, most):
    """Returns the value nearest to the wanted one within `most` of the last."""
    return min(max(wanted, last - most), last + most)


@inlined
def turn_rate(p, angle):
    """Returns the yaw rate (rad/s) that turns by an angle and can stop there."""
    return math.copysign(min(p.max_yaw_rate, stopping_speed(abs(angle), p.yaw_acceleration, p.delay)), angle)


@inlined
def command(p, m, vx, vy, yaw_rate):
    """Sets the command nearest to the wanted twist that the limits allow."""
    last = m.command
    last[0], last[1], last[2] = limit_acceleration(
        (last[0], last[1], last[2]), (vx, vy, yaw_rate), p.acceleration, p.yaw_acceleration, p.plant.dt
    )


@compiled
def project(m, x, y):
    """Returns (s, away, tangent): the polyline's point nearest to (x, y), within a metre of way around the last.

    s in m along the polyline, away the distance to it in m, tangent its direction there in rad; the segment is kept.
    """
    points = m.points
    arc = m.arc
    n = m.num_points
    first = max(m.segment - 1, 0)
    limit = arc[min(m.segment + 1, n - 1)] + 1.0
    nearest = np.inf
    s = 0.0
    segment = first
    for k in range(first, n - 1):
        if arc[k] > limit:
            break
        ax = points[k, 0]
        ay = points[k, 1]
        ex = points[k + 1, 0] - ax
        ey = points[k + 1, 1] - ay
        length = arc[k + 1] - arc[k]
        share = min(max(((x - ax) * ex + (y - ay) * ey) / max(length * length, 1e-12), 0.0), 1.0)
        dx = ax + share * ex - x
        dy = ay + share * ey - y
        d = dx * dx + dy * dy
        if d < nearest - 1e-12:
            nearest = d
            s = arc[k] + share * length
            segment = k
    m.segment = segment
    after = min(segment + 1, n - 1)
    tangent = bearing(points[after, 1] - points[segment, 1], points[after, 0] - points[segment, 0])
    return s, math.sqrt(nearest), tangent


@compiled
def point_at(m, segment, s):
    """Returns the polyline's point at arc length s, searched from a segment on; the last one beyond the end."""
    points = m.points
    arc = m.arc
    k = segment
    while k + 2 < m.num_points and arc[k + 1] < s:
        k += 1
    length = arc[k + 1] - arc[k]
    share = min(max((s - arc[k]) / max(length, 1e-12), 0.0), 1.0)
    return (
        points[k, 0] + share * (points[k + 1, 0] - points[k, 0]),
        points[k, 1] + share * (points[k + 1, 1] - points[k, 1]),
    )


# The way of a plan: searched for in the grid, laid as a polyline, let go like an elastic band.


@allocating
def plan_way(p, m, prices, straight, x, y, stops, longest):
    """Lays the polyline from (x, y) through the stops (k, 2), the last of them its end; returns the length of the way.

    Without a way, or with one longer than `longest` (both m), it is inf, and the polyline stays as it was. Of p it
    reads, beside the hull's radius and `wanted_clearance`: `theta`, whether the ways are Theta*'s over all cells that
    have a price, or A*'s for those prices, drawn straight; `snap` (m, rounded up to cells), how far a free cell may lie
    from a blocked stop; `spacing` (cells, none taken for wider than FINE_CELL) of the points; and `rounds` of the
    elastic band. Of a way at any angle that is too long for the points, or has too many turns, the beginning is laid.

    Args:
        prices, straight: (256,) of a metre at each level of the grid, for the search and for lines of sight.
    """
    size = m.grid.shape[1]
    scratch = scratch_for(size * size)
    reach = math.ceil(p.snap / m.cell)
    turns = m.points.shape[0] // TURN_SHARE
    corners = np.empty((turns, 2))
    pinned = np.zeros(turns, np.bool_)
    corners[0, 0] = x
    corners[0, 1] = y
    count = 1
    length = 0.0
    for k in range(stops.shape[0]):
        row, column = cell_of(m, corners[count - 1, 0], corners[count - 1, 1])
        start = nearest_free(m.grid, prices, row, column, reach)
        to_row, to_column = cell_of(m, stops[k, 0], stops[k, 1])
        goal = nearest_free(m.grid, prices, to_row, to_column, reach)
        if start < 0 or goal < 0:
            return np.inf
        if p.theta:
            cells, sides = any_angle_way(m.grid, prices, start, goal, scratch)
            if cells.shape[0] == 0:
                return np.inf
            enter = 1 if stands_for(m, cells[0], corners[count - 1, 0], corners[count - 1, 1]) else 0
        else:
            if not search(m.grid, prices, start, goal, False, scratch):
                return np.inf
            cells = pulled(m.grid, straight, traced(scratch.parents, goal, size))
            sides = straight_length(cells)
            enter = 1 if start == row * size + column else 0
        length += sides * m.cell
        if length > longest:
            return np.inf
        cut = count + cells.shape[0] + 1 > turns
        if cut:
            if not p.theta:
                return np.inf
            cells = cells[: turns - count]
        # the end cells stand for the ends, unless those lie in a blocked cell
        leave = cells.shape[0]
        if not cut and stands_for(m, cells[leave - 1], stops[k, 0], stops[k, 1]):
            leave -= 1
        for c in range(enter, leave):
            corners[count, 0] = m.origin[0] + (cells[c, 1] + 0.5) * m.cell
            corners[count, 1] = m.origin[1] + (cells[c, 0] + 0.5) * m.cell
            count += 1
        if cut:
            break
        corners[count, 0] = stops[k, 0]
        corners[count, 1] = stops[k, 1]
        pinned[count] = True
        count += 1
    # among wide cells no farther apart than among fine ones: between points the band looks at nothing
    # and no farther than leaves none between two with room for the hull
    widest = p.plant.hull_radius if p.theta else np.inf
    held = lay(m, corners[:count], pinned, p.spacing * min(m.cell, FINE_CELL), widest)
    relax(m, held, p.plant.hull_radius + p.wanted_clearance, p.plant.hull_radius, p.rounds)
    return length


@inlined
def cell_of(m, x, y):
    """Returns the row and the column of the cell that a point lies in."""
    return int((y - m.origin[1]) / m.cell), int((x - m.origin[0]) / m.cell)


@inlined
def stands_for(m, at, x, y):
    """Returns whether a point lies in a cell (row, column), or by a hundredth of its side beyond."""
    return (
        abs(m.origin[0] + (at[1] + 0.5) * m.cell - x) <= 0.51 * m.cell
        and abs(m.origin[1] + (at[0] + 0.5) * m.cell - y) <= 0.51 * m.cell
    )


@allocating
def lay(m, corners, pinned, spacing, widest):
    """Lays the polyline along the corners (k, 2), with points about `spacing` (m) apart, or as many as fit.

    Where they would be more than `widest` (m) apart, it ends before the corners do.

    Returns which points are held: the ends, and those at pinned corners.
    """
    points = m.points
    most = points.shape[0]
    total = 0.0
    for k in range(corners.shape[0] - 1):
        dx = corners[k + 1, 0] - corners[k, 0]
        dy = corners[k + 1, 1] - corners[k, 1]
        total += math.sqrt(dx * dx + dy * dy)
    spacing = max(spacing, min(total / max(most - 2 * corners.shape[0], most // 4), widest))
    held = np.zeros(most, np.bool_)
    points[0, 0] = corners[0, 0]
    points[0, 1] = corners[0, 1]
    held[0] = True
    n = 1
    for k in range(corners.shape[0] - 1):
        dx = corners[k + 1, 0] - corners[k, 0]
        dy = corners[k + 1, 1] - corners[k, 1]
        pieces = max(math.ceil(math.sqrt(dx * dx + dy * dy) / spacing - 1e-9), 1)
        for j in range(1, pieces + 1):
            if n == most:
                break
            points[n, 0] = corners[k, 0] + dx * j / pieces
            points[n, 1] = corners[k, 1] + dy * j / pieces
            n += 1
        held[n - 1] = held[n - 1] or pinned[k + 1]
    held[n - 1] = True
    if n == 1:
        points[1, 0] = points[0, 0]
        points[1, 1] = points[0, 1]
        held[1] = True
        n = 2
    m.num_points = n
    m.segment = 0
    measure_arc(m)
    return held


@compiled
def measure_arc(m):
    """Fills the arc lengths of the polyline."""
    points = m.points
    m.arc[0] = 0.0
    for k in range(1, m.num_points):
        dx = points[k, 0] - points[k - 1, 0]
        dy = points[k, 1] - points[k - 1, 1]
        m.arc[k] = m.arc[k - 1] + math.sqrt(dx * dx + dy * dy)


@compiled
def relax(m, held, wanted, least, rounds):
    """Lets the polyline go like an elastic band: it shortens, and moves off obstacles nearer than `wanted` (m).

    A point moves only to where its clearance is `least`, or no less than it was; held points stay.
    Source: Quinlan and Khatib, ICRA 1993, the two forces.
    """
    points = m.points
    step = 0.5 * m.cell
    for _ in range(rounds):
        for k in range(1, m.num_points - 1):
            if held[k]:
                continue
            x = points[k, 0]
            y = points[k, 1]
            here = clearance_at(m, x, y)
            to_x = x + 0.4 * (0.5 * (points[k - 1, 0] + points[k + 1, 0]) - x)
            to_y = y + 0.4 * (0.5 * (points[k - 1, 1] + points[k + 1, 1]) - y)
            if here < wanted:
                gx = clearance_at(m, x + step, y) - clearance_at(m, x - step, y)
                gy = clearance_at(m, x, y + step) - clearance_at(m, x, y - step)
                # across the band only: along it, points would slide out of the narrow places
                tx = points[k + 1, 0] - points[k - 1, 0]
                ty = points[k + 1, 1] - points[k - 1, 1]
                across = (tx * gy - ty * gx) / max(tx * tx + ty * ty, 1e-12)
                push = min(0.4 * (wanted - here), 0.04) / max(2.0 * step, math.sqrt(gx * gx + gy * gy))
                to_x -= push * across * ty
                to_y += push * across * tx
            if clearance_at(m, to_x, to_y) >= min(least, here):
                points[k, 0] = to_x
                points[k, 1] = to_y
    measure_arc(m)


@compiled
def plan_is_clear(m, reach, needed):
    """Returns whether the next `reach` (m) of the polyline have the clearance needed."""
    limit = m.arc[m.segment] + reach
    for k in range(m.segment + 1, m.num_points):
        if m.arc[k] > limit:
            break
        if clearance_at(m, m.points[k, 0], m.points[k, 1]) < needed:
            return False
    return True


@compiled
def nearest_free(levels, prices, row, column, reach):
    """Returns the flat index of the free cell nearest to a cell, at most `reach` cells off; -1 if there is none."""
    rows, columns = levels.shape
    row = min(max(row, 0), rows - 1)
    column = min(max(column, 0), columns - 1)
    if prices[levels[row, column]] < np.inf:
        return row * columns + column
    cell = -1
    nearest = reach * reach + 1
    for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
        for c in range(max(column - reach, 0), min(column + reach + 1, columns)):
            d = (r - row) ** 2 + (c - column) ** 2
            if d < nearest and prices[levels[r, c]] < np.inf:
                nearest = d
                cell = r * columns + c
    return cell
