"""The vector field histogram, second edition: steers through the best of the gaps that the scan shows."""

import dataclasses
import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots.kinematics import saturation_factor, to_body_frame
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.detour import DETOUR, LOOK, seek
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ScanLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.stopping import (
    APPROACH,
    REST,
    SECTORS,
    SIGHTS,
    Scan,
    Seen,
    admissible,
    arrived,
    braking_speed,
    find_approaching,
    find_hits,
    free_time,
    remembering,
    rest_radius,
    sees_all_round,
    set_command,
    step_and_stop,
    turn_towards,
)
from wayfield.system.compiled import allocating, any_layout, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

DIRECTIONS = 144  # sectors of the histograms, in the world frame, from -pi on
WIDTH = 2.0 * math.pi / DIRECTIONS
SPEEDS = 8  # tried, from the fastest down
AHEAD = 2.0  # s, that the arc is looked along
CELL = 0.1  # m, side of a cell of the grid that magnitudes are summed over, the paper's
MOVING = 0.05  # m/s, from which a motion has a direction

STATE = [
    ("command", np.float64, (3,)),  # the last, as the plant takes it, m/s and rad/s
    *REST,
    ("previous", np.float64),  # direction chosen last, rad, world frame; NaN before, and where there was none
    ("detour", DETOUR),
    ("binary", np.int64, (DIRECTIONS,)),  # the binary histogram, 1: blocked
    *SIGHTS,
]


@dataclasses.dataclass(frozen=True)
class VfhPlus(ScanLaw):
    """Steers for the cheapest of the directions that no obstacle, grown by the robot's radius, stands in.

    1. Primary histogram. A hit at the distance d < window fills the sectors within asin(min(1, r / d)) of its own, r
       the hull's radius + safety, with the magnitude 1 - (d / window)^2; each keeps the largest. Hits beyond the goal
       do not count. The paper sums, over the cells of a grid, and so does the law with `magnitudes` "sum": over the
       cells of CELL in which there is a hit, each counted once, at its centre and with full certainty. A wall then
       weighs more than a post and is kept farther away from; a largest value depends on no cell and no number of beams.
       Where a goal in the window leaves the hull less than its safety, obstacles are grown by what it leaves, no less
       than the hull and the margin.
    2. Binary histogram. A sector is blocked from `high` on, free below `low`, and keeps what it was in between.
    3. Masked histogram. A differential drive that moves at v turns on circles of radius v / max_yaw_rate or more: a hit
       within r of such a circle on its side blocks what lies beyond it. An omni base turns at once, and so does a
       robot that stands. Where the mask leaves nothing, the robot brakes and turns by the binary histogram.
    4. Candidates. A gap of at most `wide` offers its middle; a wider one the directions half of `wide` from either edge
       and the goal's, if it lies between them, or anywhere in the gap once the goal is within the window: half of
       `wide` off the edge of a disc beside the goal, the robot would circle the disc for ever. All around is the goal's
       where nothing is blocked. The least of
       mu_goal |c - goal| + mu_heading |c - course| + mu_previous |c - previous| is steered for.

    w = turn_gain c for a differential drive, v = max_speed max(cos c, 0)^2 (1 - slowing h), h the primary histogram
    straight ahead, less at the goal and where it could not stop on its arc before a hit (`parts.stopping`: the
    admissible velocities of the dynamic window approach and the plant's own model). An omni base drives in direction c
    and turns to the goal heading; with a scan that does not surround it, it is driven like a differential drive. Where
    every direction is blocked the robot brakes and stands; if its scan does not surround it, it turns on the spot.

    A robot that stops coming nearer for `patience` seconds follows the obstacle in its way (`parts.detour`): the
    detour's direction takes the place of the goal's; patience = inf is the paper's law. What is near stays known for
    `recall` seconds after it drops out of sight. What comes nearer counts as if it were also where it will be in
    `foresight` seconds (`parts.stopping`); foresight = 0 takes what moves for standing still, as the paper does.
    Limits: a gap is seen only where it is 2 r wide and, from afar, wider by a sector; what is not seen is taken for
    free, and what crosses the way without coming nearer is not foreseen. Serves both kinds of robot.

    Source: Ulrich and Borenstein, VFH+: Reliable Obstacle Avoidance for Fast Mobile Robots, ICRA 1998.
    """

    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    max_yaw_rate: float = gain(1.5, "rad/s", "at most", above=0.0)
    turn_gain: float = gain(2.5, "1/s", "yaw rate per radian to the chosen direction", above=0.0)
    safety: float = gain(0.05, "m", "that obstacles are grown by besides the hull", least=0.0, search=(0.01, 0.15))
    margin: float = gain(0.03, "m", "that no stop may use up", least=0.0)
    window: float = gain(1.5, "m", "around the robot, whose hits count", above=0.0)
    low: float = gain(0.3, "1", "threshold under which a sector is free", above=0.0, search=(0.1, 0.6))
    high: float = gain(0.5, "1", "threshold over which a sector is blocked", least="low", below=1.0)
    wide: float = gain(1.0, "rad", "of an opening, beyond which it has two candidates", above=0.0)
    slowing: float = gain(
        0.5, "1", "share of the speed that full density takes", least=0.0, most=1.0, search=(0.1, 1.0)
    )
    mu_goal: float = gain(5.0, "1", "weight of the direction of the goal", least=0.0)
    mu_heading: float = gain(2.0, "1", "weight of the robot's heading", least=0.0)
    mu_previous: float = gain(2.0, "1", "weight of the last choice", least=0.0, search=(0.5, 5.0))
    stop_radius: float = gain(0.08, "m", "or less where the goal asks for it", least=0.0)
    patience: float = gain(2.0, "s", "inf for no detours", least=0.0, finite=False, search=(2.0, 30.0))
    reach: float = gain(0.5, "m", "a detour takes directions that are free this far", above=0.0)
    first_leg: float = gain(3.0, "m", "before a detour tries the other side", above=0.0)
    recall: float = gain(2.0, "s", "for which what is near stays known out of sight", least=0.0)
    foresight: float = gain(1.5, "s", "0 takes what moves for standing still", least=0.0)
    magnitudes: Literal["largest", "sum"] = gain("largest", "", "what a sector keeps of those of its hits")
    sideways: bool = gain(True, "", "whether an omni base drives in any direction, not as a unicycle")

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what each robot remembers, (b,): a record of STATE and the scans of `remembering`.

        Raises:
            ValueError: if the robot has no range scan.
        """
        memory = remembering(self, briefing, STATE)
        memory["state"]["stop_radius"] = rest_radius(self.stop_radius, briefing.position_tolerance)
        memory["state"]["previous"] = np.nan
        memory["state"]["detour"]["waypoints"] = np.nan
        return memory

    def act_on(
        self, scan: Scan, observation: goal_reaching.Observation, briefing: Briefing, state: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t) in m/s and rad/s."""
        all_round = sees_all_round(briefing)
        p = params(
            self,
            briefing,
            all_round=all_round,
            sideways=self.sideways and briefing.robot.holonomic and all_round,
            summed=self.magnitudes == "sum",
        )
        twists = np.empty((len(state), 3))
        steer(p, scan, Seen.of(observation, briefing), state, twists)
        return twists[:, briefing.robot.twist_axes]


@any_layout
@allocating
def steer(params, scan, seen, memory, twists):
    """Fills the (b, 3) twists of `VfhPlus.act`.

    Beside the gains: `sideways`, whether it drives in any direction, and `summed`, whether magnitudes add up.
    """
    p = params[0]
    points = np.empty((2 * scan.ranges.shape[1] + SECTORS, 3))
    primary = np.empty(DIRECTIONS)
    blocked = np.empty(DIRECTIONS, np.bool_)
    radius = p.plant.hull_radius + p.margin
    cells = np.empty((points.shape[0], 2))
    farthest = max(p.window, radius + max(p.max_speed * AHEAD, LOOK))
    for i in range(scan.ranges.shape[0]):
        m = memory[i]
        count = find_hits(p, scan, seen, m, i, farthest, radius, points, 0.0)
        if p.foresight > 0.0:
            count = find_approaching(p, scan, seen, m, i, radius, points, count)
        hits = points[:count]
        heading = seen.poses[i, 2]
        weighed = hits
        if p.summed:
            weighed = cells[: cells_of(hits, seen.poses[i], cells)]
        d = math.sqrt(seen.goals[i, 0] ** 2 + seen.goals[i, 1] ** 2)
        twist = 0.0, 0.0, turn_towards(seen.heading_errors[i], p.turn_gain, p.max_yaw_rate)
        if not arrived(m, d, seen.waypoints_left[i]):
            aim, around = seek(p, hits, seen, m, i)
            choice, barred = choose_direction(p, weighed, m, heading, aim, d, around, primary, blocked)
            fastest = 0.0 if barred else p.max_speed
            if math.isnan(choice):
                twist = 0.0, 0.0, 0.0 if p.all_round else turn_towards(aim, p.turn_gain, p.max_yaw_rate)
            else:
                if around and p.sideways:
                    # where it goes at once; a differential drive has yet to turn
                    m.detour.course = choice
                elif not around and seen.waypoints_left[i] == 0.0:
                    delay = p.plant.lag + p.plant.dt
                    fastest = min(fastest, braking_speed(d, APPROACH * p.plant.acceleration, delay))
                turn = wrap_angle(choice - heading)
                twist = fastest_that_stops(
                    p, hits, m.command, seen.twists[i], heading, turn, fastest, primary, twist[2]
                )
        twists[i, 0], twists[i, 1], twists[i, 2] = twist
        set_command(p.plant, m.command, twists[i, 0], twists[i, 1], twists[i, 2])


@inlined
def choose_direction(p, hits, m, heading, aim, d, around, primary, blocked):
    """Returns the direction to steer for (rad, world frame; NaN: none) and whether the mask alone left none.

    Fills the primary histogram, which the speed is read from, and keeps the binary one and the choice in the memory.
    """
    speed = math.sqrt(m.command[0] ** 2 + m.command[1] ** 2)
    if not p.sideways:
        course = heading
    elif speed > MOVING:
        course = heading + bearing(m.command[1], m.command[0])
    else:
        course = math.nan
    close = not around and d < p.window
    grown = p.plant.hull_radius + p.safety
    goal = (math.inf, 0.0)
    if close:
        sine, cosine = sin_cos(aim)
        goal = (d * cosine, d * sine)
        grown = min(grown, max(p.plant.hull_radius + p.margin, nearest_to(hits, goal)))
    seen = p.window if around else min(p.window, d + grown)
    circling = speed / p.max_yaw_rate if speed > MOVING and not p.sideways else math.nan
    left, right = fill_primary(p, hits, heading, seen, grown, goal, circling, primary)
    fill_binary(p, primary, m.binary)
    fill_masked(m.binary, heading, left, right, blocked)
    choice = best_direction(p, blocked, heading + aim, close, course, m.previous)
    barred = math.isnan(choice)
    if barred:
        for k in range(DIRECTIONS):
            blocked[k] = m.binary[k] == 1
        choice = best_direction(p, blocked, heading + aim, close, course, m.previous)
    m.previous = choice
    return choice, barred


@inlined
def nearest_to(hits, point):
    """Returns the distance (m) of a point (body frame) from the nearest hit; infinity without any."""
    nearest = math.inf
    for j in range(hits.shape[0]):
        dx = hits[j, 0] - point[0]
        dy = hits[j, 1] - point[1]
        nearest = min(nearest, math.sqrt(dx * dx + dy * dy))
    return nearest


@inlined
def past(x, y, goal, grown):
    """Returns whether a hit lies behind the goal (body frame; none: infinity) as seen on the straight way to it.

    It would block that way in the histogram, though nobody goes there.
    """
    if goal[0] == math.inf:
        return False
    d = math.sqrt(goal[0] * goal[0] + goal[1] * goal[1])
    return x * goal[0] + y * goal[1] >= d * d and abs(goal[0] * y - goal[1] * x) < d * grown


@inlined
def fill_primary(p, hits, heading, seen, grown, goal, circling, primary):
    """Stage 1: fills the primary polar histogram from the hits nearer than `seen` (m), and not past the goal.

    Beside it, of the same hits, the limits of stage 3: returns the directions (rad, body frame) to the left and to the
    right beyond which circles of radius `circling` (m) do not reach; pi and -pi where nothing is in their way, or where
    `circling` is NaN.
    """
    left = math.pi
    right = -math.pi
    primary[:] = 0.0
    for j in range(hits.shape[0]):
        x = hits[j, 0]
        y = hits[j, 1]
        distance = max(math.sqrt(x * x + y * y), 1e-6)
        if distance >= seen or past(x, y, goal, grown):
            continue
        beam = bearing(y, x)
        # a robot within the grown obstacle has half of all directions before it
        sine = min(1.0, grown / distance)
        half = bearing(sine, math.sqrt(1.0 - sine * sine)) / WIDTH
        middle = (wrap_angle(heading + beam) + math.pi) / WIDTH - 0.5
        magnitude = 1.0 - (distance / p.window) ** 2
        for k in range(math.ceil(middle - half), math.floor(middle + half) + 1):
            before = primary[k % DIRECTIONS]
            primary[k % DIRECTIONS] = before + magnitude if p.summed else max(before, magnitude)
        if blocks_circle(x, y, circling, grown) and beam >= 0.0:
            left = min(left, beam)
        if blocks_circle(x, -y, circling, grown) and beam <= 0.0:
            right = max(right, beam)
    return left, right


@inlined
def cells_of(hits, pose, cells):
    """Fills `cells` with the centres (m, body frame) of the world's cells that hold a hit; returns how many."""
    x, y, heading = pose
    sine, cosine = sin_cos(heading)
    count = 0
    for j in range(hits.shape[0]):
        u = math.floor((x + cosine * hits[j, 0] - sine * hits[j, 1]) / CELL) + 0.5
        v = math.floor((y + sine * hits[j, 0] + cosine * hits[j, 1]) / CELL) + 0.5
        bx, by = to_body_frame(x, y, sine, cosine, CELL * u, CELL * v)
        known = False
        for k in range(count):
            known = known or (abs(cells[k, 0] - bx) < 0.5 * CELL and abs(cells[k, 1] - by) < 0.5 * CELL)
        if not known:
            cells[count, 0] = bx
            cells[count, 1] = by
            count += 1
    return count


@inlined
def blocks_circle(x, y, circling, grown):
    """Returns whether a hit lies on the way of a grown robot that circles to the left; never for a radius of NaN."""
    return x * x + (y - circling) ** 2 < (circling + grown) ** 2


@inlined
def fill_binary(p, primary, binary):
    """Stage 2: the binary polar histogram, with the hysteresis of its two thresholds."""
    for k in range(DIRECTIONS):
        if primary[k] >= p.high:
            binary[k] = 1
        elif primary[k] < p.low:
            binary[k] = 0


@inlined
def fill_masked(binary, heading, left, right, blocked):
    """Stage 3: the masked polar histogram, in which what turning circles do not reach is blocked too."""
    for k in range(DIRECTIONS):
        beyond = wrap_angle((k + 0.5) * WIDTH - math.pi - heading)
        blocked[k] = binary[k] == 1 or beyond > left or beyond < right


@inlined
def best_direction(p, blocked, goal, close, course, previous):
    """Stage 4: returns the cheapest candidate of the gaps between blocked sectors (rad, world frame), NaN without any.

    A gap is walked through from the first blocked sector on, all around, so that one that lies across the end of the
    histogram is as whole as any other.
    """
    first = 0
    while first < DIRECTIONS and not blocked[first]:
        first += 1
    if first == DIRECTIONS:
        return wrap_angle(goal)
    best = math.nan
    least = math.inf
    start = 0  # of the gap, 0 outside
    for n in range(1, DIRECTIONS + 1):
        if not blocked[(first + n) % DIRECTIONS]:
            if start == 0:
                start = n
        elif start > 0:
            edge = (first + start) * WIDTH - math.pi
            gap = (n - start) * WIDTH
            start = 0
            inset = 0.5 * min(p.wide, gap)
            off = wrap_angle(goal - edge - 0.5 * gap)
            for c in range(3):
                # the ends of the gap, set in (its middle twice where it is narrow), and the goal between them
                candidate = edge + (inset if c == 0 else gap - inset)
                if c == 2:
                    # a way that is free as far as a goal in the window needs no distance from the edge
                    if abs(off) > 0.5 * gap - (0.0 if close else inset):
                        continue
                    candidate = goal
                cost = p.mu_goal * abs(wrap_angle(candidate - goal))
                if not math.isnan(course):
                    cost += p.mu_heading * abs(wrap_angle(candidate - course))
                if not math.isnan(previous):
                    cost += p.mu_previous * abs(wrap_angle(candidate - previous))
                if cost < least:
                    least = cost
                    best = wrap_angle(candidate)
    return best


@inlined
def fastest_that_stops(p, hits, command, wheels, heading, turn, fastest, primary, w):
    """Returns the twist of the highest of some speeds, `fastest` at most, after which the robot can still stop.

    Args:
        turn: rad, body frame, the direction to steer for.
        w: rad/s, the yaw rate of a base that drives in any direction; another turns there.
    """
    sine, cosine = sin_cos(turn)
    if not p.sideways:
        w = turn_towards(turn, p.turn_gain, p.max_yaw_rate)
        fastest *= max(cosine, 0.0) ** 2
        sine = 0.0
        cosine = 1.0
        turn = 0.0
    k = int((wrap_angle(heading + turn) + math.pi) / WIDTH) % DIRECTIONS
    fastest *= 1.0 - p.slowing * min(primary[k], 1.0)
    plant = p.plant
    vx = 0.0
    vy = 0.0
    for n in range(SPEEDS, -1, -1):
        v = fastest * n / SPEEDS
        factor = saturation_factor(plant, v * cosine, v * sine, w)
        vx = factor * v * cosine
        vy = factor * v * sine
        free = free_time(hits, vx, vy, factor * w, AHEAD)
        if admissible(plant, free, factor * v, 0.0) and step_and_stop(plant, hits, command, wheels, vx, vy, factor * w):
            return vx, vy, factor * w
    return vx, vy, w
