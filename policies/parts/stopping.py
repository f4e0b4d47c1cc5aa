"""What a robot that sees only its range scan must know before it moves: the hits, the free arc, the room to stop."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots import sensing
from wayfield.envs.robots.kinematics import integrate_arc, limit_acceleration, limits, to_body_frame
from wayfield.envs.robots.records import aligned
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.policy import Policy, check_scan
from wayfield.system.compiled import allocating, any_layout, inlined
from wayfield.system.elementary import bearing, sin_cos

SECTORS = 36  # of the memory of what was seen near the robot
RECALL_RANGE = 1.2  # m
INTERVAL = 0.2  # s, between the scans that motion is seen by
WATCHED = 3.5  # m, how far away motion is looked for
WHOLE = 0.4  # m; hits of neighbouring beams that are nearer to each other than this lie on one surface
BLOCK = 16  # neighbouring beams, whose lines are looked at together
MOVED = 0.06  # m, nearer, before a surface counts as moving
FASTEST = 1.0  # m/s, of surfaces that come nearer
STILL = 1e-3  # m/s; slower than this a robot has stopped: a lag of 0.25 s carries it 0.25 mm farther
STANDS = 0.02  # m/s, measured; slower than this a robot may turn, but stays where it is
LONGEST_STOP = 1000  # control periods that a stop is predicted for
NEAR_ENOUGH = 0.8  # of the distance at which a goal is reached: a robot that rests there is, noise and all
APPROACH = 0.7  # share of the acceleration that a robot brakes with at its goal, so that it does not overshoot


# What a robot remembers of its scans; the points of two earlier ones lie beside this, see `remembering`.
RECALLED = ("recalled", np.float64, (SECTORS, 3))  # of `find_hits`: x, y (m, world frame) and for how long still (s)
SIGHTS = [
    RECALLED,
    ("older_age", np.float64),  # s, of the two scans of `find_approaching`
    ("newer_age", np.float64),
]
# What it remembers at its goal.
REST = [
    ("resting", np.int64),  # 1: it has come there
    ("stop_radius", np.float64),  # m, of `rest_radius`
]


class Scan(NamedTuple):
    """The scans of b robots, now and earlier."""

    ranges: NDArray[np.float64]  # (b, beams) m
    directions: NDArray[np.float64]  # (beams, 2) unit vectors, body frame
    reach: float  # m, what a beam reads that meets nothing
    older: NDArray[np.float64]  # (b, beams, 2) m, world frame; NaN where a beam met nothing
    newer: NDArray[np.float64]

    @classmethod
    def of(
        cls, policy: Policy, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> "Scan":
        """Returns what is seen, and what a memory made by `remembering` holds of it.

        Raises:
            ValueError: if the scan has another number of beams than the briefing.
        """
        check_scan(policy, observation.ranges, briefing)
        ranges = np.ascontiguousarray(observation.ranges)
        return cls(ranges, beam_directions(briefing), briefing.max_range, memory["older"], memory["newer"])


class Seen(NamedTuple):
    """What b seekers of a goal observe besides their scans."""

    poses: NDArray[np.float64]  # (b, 3) m, rad
    goals: NDArray[np.float64]  # (b, 2) m, body frame
    heading_errors: NDArray[np.float64]  # (b,) rad
    waypoints_left: NDArray[np.float64]  # (b,)
    twists: NDArray[np.float64]  # (b, 3) m/s and rad/s; components that the robot cannot command are 0

    @classmethod
    def of(cls, observation: goal_reaching.Observation, briefing: Briefing) -> "Seen":
        """Returns the fields of an observation. One kernel serves every batch: slices of one row would need another."""
        twists = np.zeros((len(observation.twist), 3))
        twists[:, briefing.robot.twist_axes] = observation.twist
        return cls(
            np.ascontiguousarray(observation.pose),
            np.ascontiguousarray(observation.goal),
            np.ascontiguousarray(observation.goal_heading_error),
            np.ascontiguousarray(observation.waypoints_left),
            twists,
        )


def beam_directions(briefing: Briefing) -> NDArray[np.float64]:
    """Returns the unit vectors (beams, 2) of the beams in the body frame."""
    return sensing.beam_directions(briefing.beam_angles)


def remembering(policy: Policy, briefing: Briefing, state: list[Any]) -> NDArray[Any]:
    """Returns the memory (b,) of a law that keeps a record `state` of those fields, and SIGHTS, and two scans.

    The scans stand beside the record lest a law be compiled anew for every number of beams.

    Raises:
        ValueError: if the robot has no range scan.
    """
    check_scan(policy, briefing.beam_angles, briefing)
    points = (len(briefing.beam_angles), 2)
    retained = [("state", aligned(state)), ("older", np.float64, points), ("newer", np.float64, points)]
    memory = np.zeros(briefing.num_envs, retained)
    memory["older"] = memory["newer"] = np.nan
    return memory


def rest_radius(stop_radius: float, tolerance: NDArray[np.float64] | None) -> Any:
    """Returns how far from its goal (m, or rad) each robot may come to rest: `stop_radius`, or less if the goal asks.

    A law may have been tuned for goals that are reached from farther away than the one that it is driven to.
    """
    return stop_radius if tolerance is None else np.minimum(stop_radius, NEAR_ENOUGH * tolerance)


def sees_all_round(briefing: Briefing) -> bool:
    """Returns whether the beams surround the robot: the gap behind it is no wider than those between neighbours."""
    angles = briefing.beam_angles
    return len(angles) > 1 and bool(2.0 * math.pi - (angles[-1] - angles[0]) < 1.5 * (angles[1] - angles[0]))


@allocating
def find_hits(p, scan, seen, m, i, farthest, radius, hits, beside):
    """Fills `hits` (beams + SECTORS, 3) with the points met within `farthest` (m), now or lately; returns their number.

    A row is x, y (m, body frame) and the distance (m) that the robot's centre has to keep: `radius`, or, where the
    robot is nearer to the hit already, the distance it has. It may leave such a hit, or stay, but not approach it.

    What is near can drop out of sight: a door post between two beams, a thin wall seen end-on. The memory keeps the
    nearest point of each sector around the robot for `recall` (s) after it was last seen, and nearer than `beside` (m)
    for as long as the robot stands.
    """
    near = recalled_near(p, seen, m, i, beside)
    count = enter_hits(p, scan, i, farthest, radius, near, hits)
    return keep_near(p, seen, m, i, near, radius, hits, count)


@inlined
def enter_hits(p, scan, i, farthest, radius, near, hits):
    """Fills `hits` and `near` with what robot i meets now, see `find_hits`; returns the number of hits."""
    ranges = scan.ranges
    directions = scan.directions
    count = 0
    for j in range(ranges.shape[1]):
        distance = max(ranges[i, j], 1e-6)
        # observations have single precision
        if distance < min(farthest, (1.0 - 1e-6) * scan.reach):
            hits[count, 0] = distance * directions[j, 0]
            hits[count, 1] = distance * directions[j, 1]
            hits[count, 2] = min(radius, (1.0 - 1e-6) * distance)
            if distance < RECALL_RANGE:
                remember(near, hits[count, 0], hits[count, 1], distance, p.recall)
            count += 1
    return count


@allocating
def recalled_near(p, seen, m, i, beside):
    """Returns what is still known near robot i, (SECTORS, 4): x, y, distance (m, body frame) and for how long (s).

    Nothing nearer than `beside` (m) is forgotten while the robot stands.
    """
    x = seen.poses[i, 0]
    y = seen.poses[i, 1]
    sine, cosine = sin_cos(seen.poses[i, 2])
    vx = seen.twists[i, 0]
    vy = seen.twists[i, 1]
    kept = beside if vx * vx + vy * vy < STANDS * STANDS else 0.0
    near = np.full((SECTORS, 4), np.inf)
    recalled = m.recalled
    for j in range(SECTORS):
        if recalled[j, 2] > 0.0:
            bx, by = to_body_frame(x, y, sine, cosine, recalled[j, 0], recalled[j, 1])
            distance = max(math.sqrt(bx * bx + by * by), 1e-6)
            left = recalled[j, 2] - p.plant.dt
            if distance < kept:
                left = min(recalled[j, 2], p.recall - p.plant.dt)
            if left > 0.0:
                remember(near, bx, by, distance, left)
    return near


@inlined
def keep_near(p, seen, m, i, near, radius, hits, count):
    """Keeps the nearest points in the memory, and adds those to the hits that are out of sight; returns their number.

    radius: m, that the robot's centre has to keep from them, in the third column, as in `find_hits`.
    """
    x = seen.poses[i, 0]
    y = seen.poses[i, 1]
    sine, cosine = sin_cos(seen.poses[i, 2])
    recalled = m.recalled
    for j in range(SECTORS):
        recalled[j, 2] = 0.0
        if near[j, 2] < RECALL_RANGE:
            bx = near[j, 0]
            by = near[j, 1]
            recalled[j, 0] = x + cosine * bx - sine * by
            recalled[j, 1] = y + sine * bx + cosine * by
            recalled[j, 2] = near[j, 3]
            if near[j, 3] < p.recall:
                hits[count, 0] = bx
                hits[count, 1] = by
                hits[count, 2] = min(radius, (1.0 - 1e-6) * near[j, 2])
                count += 1
    return count


@allocating
def find_approaching(p, scan, seen, m, i, radius, hits, count):
    """Adds to the hits where surfaces that come nearer will be in `foresight` (s); returns the new number of hits.

    A surface moves along its normal, by as much as a hit lies before the line through two neighbouring hits of an older
    scan. It is put forward until the robot's centre would have to keep its distance at most: what comes cuts off the
    way before it, and does not hold the robot. The memory keeps the ages of an older and a newer scan and their points.
    """
    directions = scan.directions
    beams = directions.shape[0]
    older = scan.older[i]
    newer = scan.newer[i]
    x = seen.poses[i, 0]
    y = seen.poses[i, 1]
    sine, cosine = sin_cos(seen.poses[i, 2])
    m.older_age += p.plant.dt
    m.newer_age += p.plant.dt
    if m.newer_age > INTERVAL - 1e-9:
        for j in range(beams):
            for axis in range(2):
                older[j, axis] = newer[j, axis]
                newer[j, axis] = np.nan
        m.older_age = m.newer_age
        m.newer_age = 0.0
    age = m.older_age
    lines = older.copy()  # side by side: a row of a memory is not, which a loop over all pairs would pay for
    boxes = boxes_of(lines)
    for j in range(beams):
        distance = scan.ranges[i, j]
        if not 0.0 < distance < min(WATCHED, (1.0 - 1e-6) * scan.reach):
            continue
        px = x + distance * (cosine * directions[j, 0] - sine * directions[j, 1])
        py = y + distance * (sine * directions[j, 0] + cosine * directions[j, 1])
        if m.newer_age == 0.0:
            newer[j, 0] = px
            newer[j, 1] = py
        if distance <= radius:
            continue
        squared, rx, ry = step_of_surface(lines, boxes, px, py, FASTEST * age * FASTEST * age)
        nearer = (rx * (x - px) + ry * (y - py)) / distance
        if nearer > MOVED:
            moved = math.sqrt(squared)
            ahead = min(p.foresight * moved / age, distance - radius) / moved
            hits[count, 0] = distance * directions[j, 0] + ahead * (cosine * rx + sine * ry)
            hits[count, 1] = distance * directions[j, 1] + ahead * (cosine * ry - sine * rx)
            hits[count, 2] = (1.0 - 1e-6) * radius
            count += 1
    return count


@any_layout
@allocating
def find_approached(scan, poses, ages, radius, approached):
    """Fills of robots (b,) whether a surface comes nearer by itself, by scans that `find_approaching` has just aged.

    Args:
        poses: (b, 3) m, rad.
        ages: (b,) s, of the older scans.
        radius: m, of the hull: what is nearer is not looked at.
    """
    for i in range(approached.shape[0]):
        approached[i] = False
        lines = scan.older[i].copy()
        boxes = boxes_of(lines)
        most = FASTEST * ages[i] * FASTEST * ages[i]
        sine, cosine = sin_cos(poses[i, 2])
        for j in range(scan.directions.shape[0]):
            distance = scan.ranges[i, j]
            if not radius < distance < min(WATCHED, (1.0 - 1e-6) * scan.reach):
                continue
            ux = cosine * scan.directions[j, 0] - sine * scan.directions[j, 1]
            uy = sine * scan.directions[j, 0] + cosine * scan.directions[j, 1]
            _, rx, ry = step_of_surface(lines, boxes, poses[i, 0] + distance * ux, poses[i, 1] + distance * uy, most)
            if -(rx * ux + ry * uy) > MOVED:
                approached[i] = True
                break


@allocating
def boxes_of(older):
    """Returns what the lines of BLOCK beams each run within, (blocks, 4): the least x and y, and the most, m."""
    beams = older.shape[0]
    boxes = np.empty(((beams + BLOCK - 1) // BLOCK, 4))
    boxes[:, :2] = np.inf
    boxes[:, 2:] = -np.inf
    for n in range(beams):
        k = n + 1 if n + 1 < beams else 0
        ux = older[k, 0] - older[n, 0]
        uy = older[k, 1] - older[n, 1]
        if 0.0 < ux * ux + uy * uy < WHOLE * WHOLE:
            box = boxes[n // BLOCK]
            for axis in range(2):
                box[axis] = min(box[axis], older[n, axis], older[k, axis])
                box[2 + axis] = max(box[2 + axis], older[n, axis], older[k, axis])
    return boxes


@inlined
def step_of_surface(older, boxes, px, py, most):
    """Returns (squared length, x, y), m, of the shortest step, under sqrt(most), to a point from lines of a scan.

    A line joins the hits of neighbouring beams that lie on one surface; the step is 0, 0 where none is near. Blocks of
    lines that are farther away than the shortest so far, by `boxes_of`, are not looked at.
    """
    beams = older.shape[0]
    rx = 0.0
    ry = 0.0
    for block in range(boxes.shape[0]):
        x = max(boxes[block, 0] - px, px - boxes[block, 2], 0.0)
        y = max(boxes[block, 1] - py, py - boxes[block, 3], 0.0)
        # wider by what rounding could do to a line just beside
        if x * x + y * y > 1.001 * most + 1e-6:
            continue
        for n in range(block * BLOCK, min((block + 1) * BLOCK, beams)):
            k = n + 1 if n + 1 < beams else 0
            ax = px - older[n, 0]
            ay = py - older[n, 1]
            ux = older[k, 0] - older[n, 0]
            uy = older[k, 1] - older[n, 1]
            length = ux * ux + uy * uy
            along = ax * ux + ay * uy
            across = ax * uy - ay * ux
            # no comparison holds for NaN
            if 0.0 < length < WHOLE * WHOLE and 0.0 <= along <= length and across * across < most * length:
                most = across * across / length
                rx = across * uy / length
                ry = -across * ux / length
    return most, rx, ry


@inlined
def remember(near, x, y, distance, left):
    """Puts a point into its sector unless a nearer one is there."""
    sector = int((bearing(y, x) / (2.0 * math.pi) + 0.5) * SECTORS) % SECTORS
    if distance < near[sector, 2]:
        near[sector, 0] = x
        near[sector, 1] = y
        near[sector, 2] = distance
        near[sector, 3] = left


@inlined
def free_time(hits, vx, vy, yaw_rate, longest):
    """Returns for how long (s, at most `longest`) a constant twist keeps its distance to all hits.

    In closed form: the centre runs on a circle of radius r around the ICC, of which a hit at the distance rho from the
    ICC forbids the part within its own radius R, acos((r^2 + rho^2 - R^2) / (2 r rho)) to either side. Most hits are
    done with by |rho - r| >= R, without a root; steps along the arc would look at every hit in every one.
    """
    speed = math.sqrt(vx * vx + vy * vy)
    if speed == 0.0:
        return longest
    if abs(yaw_rate) * longest < 1e-4:
        for j in range(hits.shape[0]):
            along = (hits[j, 0] * vx + hits[j, 1] * vy) / speed
            across = (hits[j, 1] * vx - hits[j, 0] * vy) / speed
            half_chord = hits[j, 2] * hits[j, 2] - across * across
            if half_chord > 0.0 and along > 0.0:
                longest = min(longest, max(along - math.sqrt(half_chord), 0.0) / speed)
        return longest
    icc_x = -vy / yaw_rate
    icc_y = vx / yaw_rate
    r = speed / abs(yaw_rate)
    for j in range(hits.shape[0]):
        dx = hits[j, 0] - icc_x
        dy = hits[j, 1] - icc_y
        rho_squared = dx * dx + dy * dy
        inner = r - hits[j, 2]
        outer = r + hits[j, 2]
        if rho_squared >= outer * outer or (inner > 0.0 and rho_squared <= inner * inner):
            continue
        cosine = (r * r + rho_squared - hits[j, 2] * hits[j, 2]) / max(2.0 * r * math.sqrt(rho_squared), 1e-300)
        # a hit whose radius takes in the whole circle takes in the robot, which has to leave it another way
        edge = bearing(math.sqrt(max(1.0 - cosine * cosine, 0.0)), cosine) if cosine > -1.0 else math.pi
        # from the robot to the hit around the ICC, in the sense of the motion
        turn = math.copysign(1.0, yaw_rate) * bearing(icc_y * dx - icc_x * dy, -icc_x * dx - icc_y * dy)
        if turn < 0.0:
            turn += 2.0 * math.pi
        longest = min(longest, max(turn - edge, 0.0) / abs(yaw_rate))
    return longest


@inlined
def admissible(plant, free, speed, yaw_rate):
    """Returns whether a robot can stop on its arc, which is free for `free` (s): whether the twist is in Fox's V_a.

    v <= sqrt(2 dist a) and |w| <= sqrt(2 angle a_w) with dist = v t and angle = |w| t, for the time t that is left when
    the brakes bite, after lag and control period: v <= 2 a t and |w| <= 2 a_w t.
    """
    left = free - (plant.lag + plant.dt)
    return speed == 0.0 or (
        left > 0.0 and speed <= 2.0 * plant.acceleration * left and abs(yaw_rate) <= 2.0 * plant.yaw_acceleration * left
    )


@inlined
def braking_speed(distance, acceleration, delay):
    """Returns the speed (m/s) from which a robot that answers after `delay` (s) can stop within `distance` (m).

    The root of v delay + v^2 / (2 a) = distance, written so that an infinite acceleration leaves distance / delay.
    """
    return 2.0 * distance / (delay + math.sqrt(delay * delay + 2.0 * distance / acceleration))


@inlined
def step_and_stop(plant, hits, command, wheels, vx, vy, yaw_rate):
    """Returns whether the robot keeps its distance to all hits if it drives a twist for one period and then brakes.

    Predicts what the plant does with a twist that no wheel is too slow for: acceleration limits from the last command,
    lag from the measured twist, an exact arc, until the robot rests. Whoever takes only twists that pass, and brakes
    where none does, can go on with the stop he knew of a period ago, and touches nothing that he saw.

    Args:
        command, wheels: (3,) the last command and the measured twist, m/s and rad/s.
    """
    acceleration = plant.acceleration
    yaw_acceleration = plant.yaw_acceleration
    decay = plant.lag_decay
    mean = plant.lag_mean
    dt = plant.dt
    command_vx = command[0]
    command_vy = command[1]
    command_yaw_rate = command[2]
    wheel_vx = wheels[0]
    wheel_vy = wheels[1]
    wheel_yaw_rate = wheels[2]
    x = 0.0
    y = 0.0
    heading = 0.0
    for _ in range(LONGEST_STOP):
        command_vx, command_vy, command_yaw_rate = limit_acceleration(
            (command_vx, command_vy, command_yaw_rate), (vx, vy, yaw_rate), acceleration, yaw_acceleration, dt
        )
        x, y, heading = integrate_arc(
            x,
            y,
            heading,
            command_vx + mean * (wheel_vx - command_vx),
            command_vy + mean * (wheel_vy - command_vy),
            command_yaw_rate + mean * (wheel_yaw_rate - command_yaw_rate),
            dt,
        )
        wheel_vx = command_vx + decay * (wheel_vx - command_vx)
        wheel_vy = command_vy + decay * (wheel_vy - command_vy)
        wheel_yaw_rate = command_yaw_rate + decay * (wheel_yaw_rate - command_yaw_rate)
        for j in range(hits.shape[0]):
            dx = hits[j, 0] - x
            dy = hits[j, 1] - y
            if dx * dx + dy * dy < hits[j, 2] * hits[j, 2]:
                return False
        if max(abs(wheel_vx), abs(wheel_vy), abs(command_vx), abs(command_vy)) < STILL:
            return True
        vx = 0.0
        vy = 0.0
        yaw_rate = 0.0
    return True


@inlined
def set_command(plant, command, vx, vy, yaw_rate):
    """Turns the last command (3,) into what the plant makes of a new one."""
    last = command[0], command[1], command[2]
    command[0], command[1], command[2], _ = limits(plant, last, (vx, vy, yaw_rate), plant.dt)


@inlined
def arrived(m, d, waypoints_left):
    """Returns whether the robot, `d` (m) from its goal, rests there, and remembers that.

    It comes to rest within the memory's `stop_radius` (m) and stays until it finds itself twice as far away.
    """
    if waypoints_left > 0.0 or d > 2.0 * m.stop_radius:
        m.resting = 0
    elif d <= m.stop_radius:
        m.resting = 1
    return m.resting == 1


@inlined
def turn_towards(error, turn_gain, fastest):
    """Returns the yaw rate (rad/s) that takes out a heading error (rad); 0 where that is below a degree."""
    return 0.0 if abs(error) < 0.0175 else max(-fastest, min(fastest, turn_gain * error))
