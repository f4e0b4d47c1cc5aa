"""The tracking law that planners share: along a polyline, through a grid that tells how near the obstacles are."""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled, inlined
from wayfield.envs.geometry import bearing, sin_cos, wrap_angle
from wayfield.envs.kinematics import integrate_arc, limit_acceleration, to_body_frame
from wayfield.policies.policy import Policy, check_gain

# A grid's bytes hold how near the obstacles are: the clearance of a cell's centre falls short of FARTHEST by so many
# units. Zero, what fresh memory holds, is clear.
UNIT = 0.005  # m
FARTHEST = 255 * UNIT  # m

STRIDE = 0.04  # m, between the places at which an arc ahead is tried

# A robot's part of a planner's memory, besides its grid.
PLAN = [
    ("command", np.float64, (3,)),  # the last twist asked for, m/s and rad/s
    ("origin", np.float64, (2,)),  # corner of the grid's first cell, m, world frame
    ("cell", np.float64),  # m
    ("target", np.float64, (2,)),  # where the plan ends, m, world frame
    ("num_points", np.int64),  # 0: there is no plan
    ("segment", np.int64),  # of the polyline, on which the robot is
    ("arrived", np.int64),  # 1: at the goal, turning to its heading
    ("steps", np.int64),  # since the episode began
    ("stuck", np.int64),  # steps in a row without a way to move
    ("no_path", np.int64),  # 1: the last search found no way
    ("plans", np.int64),  # searches so far
]


class Limits(NamedTuple):
    """The gains of the tracking law and what the base can do, as the compiled law takes them."""

    holonomic: bool
    hull_radius: float
    dt: float
    delay: float  # s, until the base does what it is told
    acceleration: float
    yaw_acceleration: float
    max_speed: float
    max_yaw_rate: float
    lookahead: float
    min_turn_radius: float
    rotate_beyond: float
    slow_speed: float
    slow_clearance: float
    skin: float
    arrive: float


@dataclasses.dataclass(frozen=True)
class PolylineTracker(Policy):
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

    max_speed: float = 0.6  # m/s
    acceleration: float = 0.8  # m/s^2, at most, and at most 0.8 of what the base can do
    yaw_acceleration: float = 2.4  # rad/s^2, likewise
    max_yaw_rate: float = 1.5  # rad/s
    lookahead: float = 0.4  # m
    min_turn_radius: float = 0.4  # m, where the speed begins to fall
    rotate_beyond: float = 0.785  # rad, bearing beyond which a differential drive turns on the spot
    slow_speed: float = 0.2  # m/s, with no room beside the hull
    slow_clearance: float = 0.15  # m, room beside the hull for the full speed
    skin: float = 0.01  # m, room that the hull keeps where it can
    arrive: float = 0.015  # m, from the goal

    def __post_init__(self) -> None:
        for name in (
            *("max_speed", "acceleration", "yaw_acceleration", "max_yaw_rate", "lookahead", "min_turn_radius"),
            *("rotate_beyond", "slow_speed", "slow_clearance", "arrive"),
        ):
            check_gain(self, name, above=0.0)
        check_gain(self, "skin", least=0.0)

    def limits(self, briefing: Briefing) -> Limits:
        """Returns the gains with what the robot can do."""
        actuators = briefing.actuators
        return Limits(
            holonomic=briefing.robot.holonomic,
            hull_radius=briefing.robot.hull_radius,
            dt=briefing.dt,
            delay=actuators.lag + 2.0 * briefing.dt,
            acceleration=min(self.acceleration, 0.8 * actuators.acceleration),
            yaw_acceleration=min(self.yaw_acceleration, 0.8 * actuators.yaw_acceleration),
            max_speed=self.max_speed,
            max_yaw_rate=self.max_yaw_rate,
            lookahead=self.lookahead,
            min_turn_radius=self.min_turn_radius,
            rotate_beyond=self.rotate_beyond,
            slow_speed=min(self.slow_speed, self.max_speed),
            slow_clearance=self.slow_clearance,
            skin=self.skin,
            arrive=self.arrive,
        )

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
def clearance_at(grid, i, origin, cell, x, y):
    """Returns the clearance (m) at a point, between those of the four cells around it; FARTHEST beyond the grid."""
    u = (x - origin[i, 0]) / cell[i] - 0.5
    v = (y - origin[i, 1]) / cell[i] - 0.5
    column = math.floor(u)
    row = math.floor(v)
    if column < 0 or row < 0 or column + 1 >= grid.shape[2] or row + 1 >= grid.shape[1]:
        return FARTHEST
    u -= column
    v -= row
    near = (1.0 - u) * grid[i, row, column] + u * grid[i, row, column + 1]
    far = (1.0 - u) * grid[i, row + 1, column] + u * grid[i, row + 1, column + 1]
    return FARTHEST - UNIT * ((1.0 - v) * near + v * far)


@inlined
def stopping_speed(distance, acceleration, delay):
    """Returns the speed (m/s) from which the robot stops within the distance (m): v delay + v^2/(2 a) = distance."""
    if distance <= 0.0:
        return 0.0
    dead = acceleration * delay
    return math.sqrt(dead * dead + 2.0 * acceleration * distance) - dead


@compiled
def free_arc(grid, i, origin, cell, x, y, heading, ux, uy, curvature, reach, needed):
    """Returns how far (m, at most `reach`) the disc can go along an arc with `needed` clearance.

    A disc that has less already may go where it does not get less still.

    Args:
        ux, uy: direction of motion in the body frame, a unit vector.
        curvature: 1/m, turn of the body per metre.
    """
    needed = min(needed, clearance_at(grid, i, origin, cell, x, y) - 1e-4)
    gone = 0.0
    while gone < reach:
        stride = min(STRIDE, reach - gone + 1e-9)
        x, y, heading = integrate_arc(x, y, heading, ux, uy, curvature, stride)
        if clearance_at(grid, i, origin, cell, x, y) < needed:
            return gone
        gone += stride
    return reach


@compiled
def track(limits, grid, plan, i, x, y, heading, heading_error, is_goal, facing, speed_limit, least_room):
    """Sets robot i's command by the law of `PolylineTracker`.

    Args:
        limits: `Limits`.
        grid: (b, rows, columns) bytes.
        plan: tuple of the arrays (b, ...) of `plan_arrays`.
        heading_error: rad, of the goal heading.
        is_goal: whether the polyline ends at the goal rather than at a waypoint.
        facing: whether an omni base looks where it goes, rather than turning to the goal heading.
        speed_limit: m/s; below zero the robot backs away along the polyline.
        least_room: m, what may become of the skin where the polyline is narrow; below zero where the grid says less
            than there is.
    """
    points, arc, num_points, segments, arrived, stuck, commands, origin, cell = plan
    p = limits
    n = num_points[i]
    if n == 0:
        command(p, commands, i, 0.0, 0.0, 0.0)
        return
    end_x = points[i, n - 1, 0]
    end_y = points[i, n - 1, 1]
    s, _away, tangent = project(points, arc, n, segments, i, x, y)
    rest = max(arc[i, n - 1] - s, math.sqrt((end_x - x) ** 2 + (end_y - y) ** 2) if s > arc[i, n - 1] - 0.3 else 0.0)
    if is_goal:
        distance = math.sqrt((end_x - x) ** 2 + (end_y - y) ** 2)
        if distance < p.arrive:
            arrived[i] = 1
        elif distance > 0.05 + p.arrive:
            arrived[i] = 0
        if arrived[i] == 1:
            stuck[i] = 0
            if p.holonomic:
                sine, cosine = sin_cos(heading)
                ex, ey = to_body_frame(x, y, sine, cosine, end_x, end_y)
                command(p, commands, i, ex, ey, turn_rate(p, heading_error))
            else:
                command(p, commands, i, 0.0, 0.0, turn_rate(p, heading_error))
            return
    else:
        arrived[i] = 0
        rest += 0.3  # a waypoint is passed, not stopped at
    # the velocity asked for acts late, and turns with the body until then: an omni base aims for where it faces then
    late = 0.7 * p.delay * commands[i, 2] if p.holonomic else 0.0
    sine, cosine = sin_cos(heading + late)
    if speed_limit < 0.0:
        ty, tx = sin_cos(tangent - heading - late)
        back = free_arc(
            grid, i, origin, cell, x, y, heading, -tx if p.holonomic else -1.0, -ty if p.holonomic else 0.0, 0.0,
            0.5, p.hull_radius + p.skin,
        )  # fmt: skip
        v = min(-speed_limit, stopping_speed(back, p.acceleration, p.delay))
        if p.holonomic:
            command(p, commands, i, -v * tx, -v * ty, 0.0)
        else:
            command(p, commands, i, -v, 0.0, 0.0)
        return
    # what the polyline allows
    narrow = FARTHEST
    for k in range(9):
        px, py = point_at(points, arc, n, segments[i], i, s + 0.125 * k * p.lookahead)
        narrow = min(narrow, clearance_at(grid, i, origin, cell, px, py))
    share = min(max((narrow - p.hull_radius) / p.slow_clearance, 0.0), 1.0)
    allowed = min(p.slow_speed + (p.max_speed - p.slow_speed) * share, speed_limit)
    allowed = min(allowed, stopping_speed(rest, p.acceleration, p.delay))
    # where the polyline itself is narrower the hull follows it
    needed = p.hull_radius + min(p.skin, max(narrow - p.hull_radius - UNIT, least_room))
    last_v = commands[i, 0]
    best = -1.0
    best_v = 0.0
    best_vy = 0.0
    best_w = 0.0
    # where there is little room the robot keeps to the polyline instead of cutting its corners
    ahead = p.lookahead * max(share, 0.3)
    for _ in range(3):
        px, py = point_at(points, arc, n, segments[i], i, s + ahead)
        bx, by = to_body_frame(x, y, sine, cosine, px, py)
        d = max(math.sqrt(bx * bx + by * by), 1e-9)
        if p.holonomic:
            v = allowed
            # how sharply the way turns: the angle from the polyline's direction to the point
            turn = wrap_angle(bearing(py - y, px - x) - tangent)
            bend = 2.0 * abs(math.sin(turn)) / d if abs(turn) < 1.57 else 2.0 / d
            if d > 0.1:
                v = min(v, math.sqrt(0.5 * p.acceleration / max(bend, 1e-9)))
            vx = v * bx / d
            vy = v * by / d
            vx, vy, _ = limit_acceleration(
                commands[i, 0], commands[i, 1], 0.0, vx, vy, 0.0, p.acceleration, p.yaw_acceleration, p.dt
            )
            speed = math.sqrt(vx * vx + vy * vy)
            if speed > 1e-6:
                bend = commands[i, 2] / max(speed, 0.1)
                reach = min(speed * p.delay + 0.5 * speed * speed / p.acceleration + STRIDE, d)
                free = free_arc(
                    grid, i, origin, cell, x, y, heading, vx / speed, vy / speed, bend, reach, needed
                )  # fmt: skip
                most = stopping_speed(free, p.acceleration, p.delay)
                # also the straight way at the point, where braking has bent the limited velocity away from it
                if most < speed:
                    vx *= most / speed
                    vy *= most / speed
                    if most < 0.3 * speed:
                        free = free_arc(
                            grid, i, origin, cell, x, y, heading, bx / d, by / d, bend, reach, needed
                        )  # fmt: skip
                        most = min(v, stopping_speed(free, p.acceleration, p.delay))
                        vx = most * bx / d
                        vy = most * by / d
                    speed = most
            if speed > best:
                best = speed
                best_v = vx
                best_vy = vy
            good = speed >= 0.6 * v
        else:
            angle = bearing(by, bx)
            if abs(angle) > p.rotate_beyond:
                # turning on the spot is always free for a disc
                w = turn_rate(p, angle)
                if best < 0.02:
                    best = 0.02
                    best_v = 0.0
                    best_w = w
                break
            curvature = 2.0 * by / (d * d)
            v = min(allowed, p.max_yaw_rate / max(abs(curvature), 1e-9))
            v = min(v, p.max_speed / max(p.min_turn_radius * abs(curvature), 1e-9))
            v = min(max(v, min(0.05, allowed)), last_v + p.acceleration * p.dt)
            v = max(v, last_v - p.acceleration * p.dt)
            w = limited(curvature * v, commands[i, 2], p.yaw_acceleration * p.dt)
            reach = min(v * p.delay + 0.5 * v * v / p.acceleration + STRIDE, d)
            bend = min(max(w / max(v, 0.05), -10.0), 10.0)
            free = free_arc(grid, i, origin, cell, x, y, heading, 1.0, 0.0, bend, reach, needed)
            most = min(v, stopping_speed(free, p.acceleration, p.delay))
            if most > best:
                best = most
                best_v = most
                # blocked close ahead: turn towards the polyline
                best_w = curvature * most if most > 0.05 else turn_rate(p, angle)
            good = most >= 0.6 * v
        if good:
            break
        ahead *= 0.5
    if best < 0.02 and allowed > 0.05:
        stuck[i] += 1
    else:
        stuck[i] = 0
    if p.holonomic:
        speed = math.sqrt(best_v * best_v + best_vy * best_vy)
        if facing and rest > 0.3 and speed > 0.05:
            px, py = point_at(points, arc, n, segments[i], i, s + 0.5)
            heading_error = wrap_angle(bearing(py - y, px - x) - heading)
        # turning turns the velocity too: no faster than a part of the acceleration can make up for
        most = 0.4 * p.acceleration / max(speed, 0.1)
        best_w = min(max(turn_rate(p, heading_error), -most), most)
    command(p, commands, i, best_v, best_vy, best_w)


@inlined
def limited(wanted, last, most):
    """Returns the value nearest to the wanted one within `most` of the last."""
    return min(max(wanted, last - most), last + most)


@inlined
def turn_rate(p, angle):
    """Returns the yaw rate (rad/s) that turns by an angle and can stop there."""
    return math.copysign(min(p.max_yaw_rate, stopping_speed(abs(angle), p.yaw_acceleration, p.delay)), angle)


@inlined
def command(p, commands, i, vx, vy, yaw_rate):
    """Sets the command nearest to the wanted twist that the limits allow."""
    commands[i, 0], commands[i, 1], commands[i, 2] = limit_acceleration(
        commands[i, 0], commands[i, 1], commands[i, 2], vx, vy, yaw_rate, p.acceleration, p.yaw_acceleration, p.dt
    )


@compiled
def project(points, arc, n, segments, i, x, y):
    """Returns (s, away, tangent): the polyline's point nearest to (x, y), within a metre of way around the last.

    s in m along the polyline, away the distance to it in m, tangent its direction there in rad; the segment is kept.
    """
    first = max(segments[i] - 1, 0)
    limit = arc[i, min(segments[i] + 1, n - 1)] + 1.0
    nearest = np.inf
    s = 0.0
    found = first
    for k in range(first, n - 1):
        if arc[i, k] > limit:
            break
        ax = points[i, k, 0]
        ay = points[i, k, 1]
        ex = points[i, k + 1, 0] - ax
        ey = points[i, k + 1, 1] - ay
        length = arc[i, k + 1] - arc[i, k]
        share = min(max(((x - ax) * ex + (y - ay) * ey) / max(length * length, 1e-12), 0.0), 1.0)
        dx = ax + share * ex - x
        dy = ay + share * ey - y
        d = dx * dx + dy * dy
        if d < nearest - 1e-12:
            nearest = d
            s = arc[i, k] + share * length
            found = k
    segments[i] = found
    after = min(found + 1, n - 1)
    tangent = bearing(points[i, after, 1] - points[i, found, 1], points[i, after, 0] - points[i, found, 0])
    return s, math.sqrt(nearest), tangent


@compiled
def point_at(points, arc, n, segment, i, s):
    """Returns the point at arc length s, searched from a segment on; the last one beyond the end."""
    k = segment
    while k + 2 < n and arc[i, k + 1] < s:
        k += 1
    length = arc[i, k + 1] - arc[i, k]
    share = min(max((s - arc[i, k]) / max(length, 1e-12), 0.0), 1.0)
    return (
        points[i, k, 0] + share * (points[i, k + 1, 0] - points[i, k, 0]),
        points[i, k, 1] + share * (points[i, k + 1, 1] - points[i, k, 1]),
    )


@compiled
def lay(points, arc, num_points, segments, i, corners, pinned, spacing):
    """Lays robot i's polyline along the corners (k, 2), with points about `spacing` (m) apart, or as many as fit.

    Returns which points are pinned: those at pinned corners.
    """
    room = points.shape[1]
    total = 0.0
    for k in range(corners.shape[0] - 1):
        total += math.hypot(corners[k + 1, 0] - corners[k, 0], corners[k + 1, 1] - corners[k, 1])
    spacing = max(spacing, total / max(room - 2 * corners.shape[0], room // 4))
    held = np.zeros(room, np.bool_)
    points[i, 0, 0] = corners[0, 0]
    points[i, 0, 1] = corners[0, 1]
    held[0] = True
    n = 1
    for k in range(corners.shape[0] - 1):
        dx = corners[k + 1, 0] - corners[k, 0]
        dy = corners[k + 1, 1] - corners[k, 1]
        pieces = max(math.ceil(math.hypot(dx, dy) / spacing - 1e-9), 1)
        for j in range(1, pieces + 1):
            if n == room:
                break
            points[i, n, 0] = corners[k, 0] + dx * j / pieces
            points[i, n, 1] = corners[k, 1] + dy * j / pieces
            n += 1
        held[n - 1] = held[n - 1] or pinned[k + 1]
    held[n - 1] = True
    if n == 1:
        points[i, 1] = points[i, 0]
        held[1] = True
        n = 2
    num_points[i] = n
    segments[i] = 0
    measure_arc(points, arc, n, i)
    return held


@compiled
def measure_arc(points, arc, n, i):
    """Fills the arc lengths of robot i's polyline."""
    arc[i, 0] = 0.0
    for k in range(1, n):
        dx = points[i, k, 0] - points[i, k - 1, 0]
        dy = points[i, k, 1] - points[i, k - 1, 1]
        arc[i, k] = arc[i, k - 1] + math.sqrt(dx * dx + dy * dy)


@compiled
def relax(grid, points, arc, num_points, i, origin, cell, held, wanted, least, rounds):
    """Lets robot i's polyline go like an elastic band: it shortens, and moves off obstacles nearer than `wanted` (m).

    A point moves only to where its clearance is `least`, or no less than it was; held points stay.
    Source: Quinlan and Khatib, ICRA 1993, the two forces.
    """
    n = num_points[i]
    step = 0.5 * cell[i]
    for _ in range(rounds):
        for k in range(1, n - 1):
            if held[k]:
                continue
            x = points[i, k, 0]
            y = points[i, k, 1]
            here = clearance_at(grid, i, origin, cell, x, y)
            to_x = x + 0.4 * (0.5 * (points[i, k - 1, 0] + points[i, k + 1, 0]) - x)
            to_y = y + 0.4 * (0.5 * (points[i, k - 1, 1] + points[i, k + 1, 1]) - y)
            if here < wanted:
                gx = clearance_at(grid, i, origin, cell, x + step, y) - clearance_at(
                    grid, i, origin, cell, x - step, y
                )  # fmt: skip
                gy = clearance_at(grid, i, origin, cell, x, y + step) - clearance_at(
                    grid, i, origin, cell, x, y - step
                )  # fmt: skip
                # across the band only: along it, points would slide out of the narrow places
                tx = points[i, k + 1, 0] - points[i, k - 1, 0]
                ty = points[i, k + 1, 1] - points[i, k - 1, 1]
                across = (tx * gy - ty * gx) / max(tx * tx + ty * ty, 1e-12)
                push = min(0.4 * (wanted - here), 0.04) / max(2.0 * step, math.sqrt(gx * gx + gy * gy))
                to_x -= push * across * ty
                to_y += push * across * tx
            if clearance_at(grid, i, origin, cell, to_x, to_y) >= min(least, here):
                points[i, k, 0] = to_x
                points[i, k, 1] = to_y
    measure_arc(points, arc, n, i)


@compiled
def plan_is_clear(grid, points, arc, n, segment, i, origin, cell, reach, needed):
    """Returns whether the next `reach` (m) of robot i's polyline have the clearance needed."""
    limit = arc[i, segment] + reach
    for k in range(segment + 1, n):
        if arc[i, k] > limit:
            break
        if clearance_at(grid, i, origin, cell, points[i, k, 0], points[i, k, 1]) < needed:
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
    found = -1
    nearest = reach * reach + 1
    for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
        for c in range(max(column - reach, 0), min(column + reach + 1, columns)):
            d = (r - row) ** 2 + (c - column) ** 2
            if d < nearest and prices[levels[r, c]] < np.inf:
                nearest = d
                found = r * columns + c
    return found


def plan_arrays(memory: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Returns the fields of memory that `track` reads and writes."""
    return tuple(
        memory[name]
        for name in ("points", "arc", "num_points", "segment", "arrived", "stuck", "command", "origin", "cell")
    )
