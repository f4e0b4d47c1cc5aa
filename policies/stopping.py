"""What a robot that sees only its range scan must know before it moves: the hits, the free arc, the room to stop."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import inlined
from wayfield.envs.geometry import bearing, sin_cos
from wayfield.envs.kinematics import integrate_arc, limit_acceleration, saturation_factor, to_body_frame
from wayfield.envs.records import lag_factors
from wayfield.policies.policy import check_scan

SECTORS = 36  # of the memory of what was seen near the robot, three columns each
RECALL_RANGE = 1.2  # m
INTERVAL = 0.2  # s, between the scans that motion is seen by
WATCHED = 3.5  # m, how far away motion is looked for
WHOLE = 0.4  # m; hits of neighbouring beams that are nearer to each other than this lie on one surface
MOVED = 0.06  # m, nearer, before a surface counts as moving
FASTEST = 1.0  # m/s, of surfaces that come nearer
STILL = 1e-3  # m/s; slower than this a robot has stopped: a lag of 0.25 s carries it 0.25 mm farther
LONGEST_STOP = 1000  # control periods that a stop is predicted for
APPROACH = 0.7  # share of the acceleration that a robot brakes with at its goal, so that it does not overshoot


def beam_directions(briefing: Briefing) -> NDArray[np.float64]:
    """Returns the unit vectors (beams, 2) of the beams in the body frame."""
    return np.column_stack([np.cos(briefing.beam_angles), np.sin(briefing.beam_angles)])


def fresh_scans(briefing: Briefing) -> NDArray[np.float64]:
    """Returns the columns (b, n) of a memory in which `find_approaching` keeps two scans, before the first."""
    scans = np.full((briefing.num_envs, 2 + 4 * len(briefing.beam_angles)), np.nan)
    scans[:, :2] = 0.0
    return scans


def sees_all_round(briefing: Briefing) -> bool:
    """Returns whether the beams surround the robot: the gap behind it is no wider than those between neighbours."""
    angles = briefing.beam_angles
    return len(angles) > 1 and bool(2.0 * math.pi - (angles[-1] - angles[0]) < 1.5 * (angles[1] - angles[0]))


def plant_model(briefing: Briefing) -> tuple[float, float, float, float, float, float]:
    """Returns what the plant is predicted with, all of it on the data sheet.

    The acceleration (m/s^2), the yaw acceleration (rad/s^2), the share of a deviation that the lag leaves after a
    control period, its mean share over the period, the limit of the wheel speeds (rad/s) and the control period (s).
    """
    robot, actuators = briefing.robot, briefing.actuators
    limit = robot.rated_wheel_speed if actuators.at_rated_speed else robot.peak_wheel_speed
    decay, mean = lag_factors(actuators.lag, briefing.dt)
    return actuators.acceleration, actuators.yaw_acceleration, decay, mean, limit, briefing.dt


def full_twists(briefing: Briefing, twist: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the twists (b, 3) whose commandable components are given, (b, t); the others are zero."""
    full = np.zeros((len(twist), 3))
    full[:, briefing.robot.twist_axes] = twist
    return full


def sensed(policy: Any, observation: goal_reaching.Observation, briefing: Briefing) -> tuple[Any, ...]:
    """Returns what the kernels of DWA and VFH+ take before memory and twists: what is sensed, the robot, the gains.

    Raises:
        ValueError: if the scan has another number of beams than the briefing.
    """
    check_scan(policy, observation.ranges, briefing)
    all_round = sees_all_round(briefing)
    return (
        observation.ranges,
        beam_directions(briefing),
        briefing.max_range,
        observation.goal,
        observation.pose,
        observation.goal_heading_error,
        observation.waypoints_left,
        full_twists(briefing, observation.twist),
        plant_model(briefing),
        briefing.robot.wheel_matrix,
        briefing.robot.hull_radius,
        briefing.actuators.lag + briefing.dt,
        briefing.robot.holonomic and all_round,
        all_round,
        tuple(map(float, vars(policy).values())),
    )


@inlined
def find_hits(ranges, i, directions, max_range, farthest, radius, poses, recall, dt, memory, k, hits):
    """Fills `hits` (beams + SECTORS, 3) with the points met within `farthest` (m), now or lately; returns their number.

    A row is x, y (m, body frame) and the distance (m) that the robot's centre has to keep: `radius`, or, where the
    robot is nearer to the hit already, the distance it has. It may leave such a hit, or stay, but not approach it.

    What is near can drop out of sight: a door post between two beams, a thin wall seen end-on. memory[i, k:] keeps the
    nearest point of each sector around the robot, in the world frame, for `recall` (s) after it was last seen.
    """
    x = poses[i, 0]
    y = poses[i, 1]
    sine, cosine = sin_cos(poses[i, 2])
    near = np.full((SECTORS, 4), np.inf)  # x, y, distance, seconds left
    for j in range(SECTORS):
        left = memory[i, k + 3 * j + 2] - dt
        if left > 0.0:
            bx, by = to_body_frame(x, y, sine, cosine, memory[i, k + 3 * j], memory[i, k + 3 * j + 1])
            remember(near, bx, by, max(math.sqrt(bx * bx + by * by), 1e-6), left)
    count = 0
    for j in range(ranges.shape[1]):
        distance = max(ranges[i, j], 1e-6)
        # observations have single precision
        if distance < min(farthest, (1.0 - 1e-6) * max_range):
            hits[count, 0] = distance * directions[j, 0]
            hits[count, 1] = distance * directions[j, 1]
            hits[count, 2] = min(radius, (1.0 - 1e-6) * distance)
            if distance < RECALL_RANGE:
                remember(near, hits[count, 0], hits[count, 1], distance, recall)
            count += 1
    for j in range(SECTORS):
        memory[i, k + 3 * j + 2] = 0.0
        if near[j, 2] < RECALL_RANGE:
            bx = near[j, 0]
            by = near[j, 1]
            memory[i, k + 3 * j] = x + cosine * bx - sine * by
            memory[i, k + 3 * j + 1] = y + sine * bx + cosine * by
            memory[i, k + 3 * j + 2] = near[j, 3]
            if near[j, 3] < recall:
                hits[count, 0] = bx
                hits[count, 1] = by
                hits[count, 2] = min(radius, (1.0 - 1e-6) * near[j, 2])
                count += 1
    return count


@inlined
def find_approaching(ranges, i, directions, max_range, radius, poses, foresight, dt, memory, k, hits, count):
    """Adds to the hits where surfaces that come nearer will be in `foresight` (s); returns the new number of hits.

    A surface moves along its normal, by as much as a hit lies before the line through two neighbouring hits of an older
    scan. It is put forward until the robot's centre would have to keep its distance at most: what comes cuts off the
    way before it, and does not hold the robot. memory[i, k:] keeps the ages (s) of an older and a newer scan and their
    points in the world frame, NaN where a beam met nothing.
    """
    beams = ranges.shape[1]
    older = k + 2
    newer = older + 2 * beams
    x = poses[i, 0]
    y = poses[i, 1]
    sine, cosine = sin_cos(poses[i, 2])
    memory[i, k] += dt
    memory[i, k + 1] += dt
    age = memory[i, k]
    if memory[i, k + 1] > INTERVAL - 1e-9:
        for n in range(2 * beams):
            memory[i, older + n] = memory[i, newer + n]
            memory[i, newer + n] = np.nan
        memory[i, k] = memory[i, k + 1]
        memory[i, k + 1] = 0.0
        age = memory[i, k]
    for j in range(beams):
        distance = ranges[i, j]
        if not 0.0 < distance < min(WATCHED, (1.0 - 1e-6) * max_range):
            continue
        px = x + distance * (cosine * directions[j, 0] - sine * directions[j, 1])
        py = y + distance * (sine * directions[j, 0] + cosine * directions[j, 1])
        if memory[i, k + 1] == 0.0:
            memory[i, newer + 2 * j] = px
            memory[i, newer + 2 * j + 1] = py
        if distance <= radius:
            continue
        nearest = FASTEST * age * FASTEST * age
        rx = 0.0
        ry = 0.0
        for n in range(beams):
            m = n + 1 if n + 1 < beams else 0
            ax = px - memory[i, older + 2 * n]
            ay = py - memory[i, older + 2 * n + 1]
            ux = memory[i, older + 2 * m] - memory[i, older + 2 * n]
            uy = memory[i, older + 2 * m + 1] - memory[i, older + 2 * n + 1]
            length = ux * ux + uy * uy
            along = ax * ux + ay * uy
            across = ax * uy - ay * ux
            # no comparison holds for NaN
            if 0.0 < length < WHOLE * WHOLE and 0.0 <= along <= length and across * across < nearest * length:
                nearest = across * across / length
                rx = across * uy / length
                ry = -across * ux / length
        nearer = (rx * (x - px) + ry * (y - py)) / distance
        if nearer > MOVED:
            moved = math.sqrt(nearest)
            ahead = min(foresight * moved / age, distance - radius) / moved
            hits[count, 0] = distance * directions[j, 0] + ahead * (cosine * rx + sine * ry)
            hits[count, 1] = distance * directions[j, 1] + ahead * (cosine * ry - sine * rx)
            hits[count, 2] = (1.0 - 1e-6) * radius
            count += 1
    return count


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
def free_time(hits, count, vx, vy, yaw_rate, longest):
    """Returns for how long (s, at most `longest`) a constant twist keeps its distance to all hits.

    In closed form: the centre runs on a circle of radius r around the ICC, of which a hit at the distance rho from the
    ICC forbids the part within its own radius R, acos((r^2 + rho^2 - R^2) / (2 r rho)) to either side. Most hits are
    done with by |rho - r| >= R, without a root; steps along the arc would look at every hit in every one.
    """
    speed = math.sqrt(vx * vx + vy * vy)
    if speed == 0.0:
        return longest
    if abs(yaw_rate) * longest < 1e-4:
        for j in range(count):
            along = (hits[j, 0] * vx + hits[j, 1] * vy) / speed
            across = (hits[j, 1] * vx - hits[j, 0] * vy) / speed
            half_chord = hits[j, 2] * hits[j, 2] - across * across
            if half_chord > 0.0 and along > 0.0:
                longest = min(longest, max(along - math.sqrt(half_chord), 0.0) / speed)
        return longest
    icc_x = -vy / yaw_rate
    icc_y = vx / yaw_rate
    r = speed / abs(yaw_rate)
    for j in range(count):
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
def admissible(free, speed, yaw_rate, plant, delay):
    """Returns whether a robot that answers after `delay` (s) can stop on its arc, which is free for `free` (s).

    Fox's v <= sqrt(2 dist a) and |w| <= sqrt(2 angle a_w) with dist = v t and angle = |w| t, for the time t that is
    left when the brakes bite: v <= 2 a t and |w| <= 2 a_w t.
    """
    left = free - delay
    return speed == 0.0 or (left > 0.0 and speed <= 2.0 * plant[0] * left and abs(yaw_rate) <= 2.0 * plant[1] * left)


@inlined
def braking_speed(distance, acceleration, delay):
    """Returns the speed (m/s) from which a robot that answers after `delay` (s) can stop within `distance` (m).

    The root of v delay + v^2 / (2 a) = distance, written so that an infinite acceleration leaves distance / delay.
    """
    return 2.0 * distance / (delay + math.sqrt(delay * delay + 2.0 * distance / acceleration))


@inlined
def step_and_stop(plant, hits, count, command, twist, i, vx, vy, yaw_rate):
    """Returns whether the robot keeps its distance to all hits if it drives a twist for one period and then brakes.

    Predicts what the plant does with a twist that no wheel is too slow for: acceleration limits from the last command,
    lag from the measured twist, an exact arc, until the robot rests. Whoever takes only twists that pass, and brakes
    where none does, can go on with the stop he knew of a period ago, and touches nothing that he saw.
    """
    acceleration, yaw_acceleration, decay, mean, _, dt = plant
    command_vx = command[i, 0]
    command_vy = command[i, 1]
    command_yaw_rate = command[i, 2]
    wheel_vx = twist[i, 0]
    wheel_vy = twist[i, 1]
    wheel_yaw_rate = twist[i, 2]
    x = 0.0
    y = 0.0
    heading = 0.0
    for _ in range(LONGEST_STOP):
        command_vx, command_vy, command_yaw_rate = limit_acceleration(
            command_vx, command_vy, command_yaw_rate, vx, vy, yaw_rate, acceleration, yaw_acceleration, dt
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
        for j in range(count):
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
def set_command(plant, wheel_matrix, command, i, vx, vy, yaw_rate):
    """Turns row i of the last commands into what the plant makes of a new one: saturation, acceleration limits."""
    acceleration, yaw_acceleration, _, _, wheel_limit, dt = plant
    factor = saturation_factor(wheel_matrix, wheel_matrix.shape[0], wheel_limit, vx, vy, yaw_rate)
    command[i, 0], command[i, 1], command[i, 2] = limit_acceleration(
        command[i, 0],
        command[i, 1],
        command[i, 2],
        factor * vx,
        factor * vy,
        factor * yaw_rate,
        acceleration,
        yaw_acceleration,
        dt,
    )


@inlined
def arrived(memory, i, k, d, waypoints_left, stop_radius):
    """Returns whether the robot, `d` (m) from its goal, rests there, and keeps that in memory[i, k].

    It comes to rest within `stop_radius` (m) and stays until it finds itself twice as far away.
    """
    if waypoints_left > 0.0 or d > 2.0 * stop_radius:
        memory[i, k] = 0.0
    elif d <= stop_radius:
        memory[i, k] = 1.0
    return memory[i, k] == 1.0


@inlined
def turn_towards(error, turn_gain, fastest):
    """Returns the yaw rate (rad/s) that takes out a heading error (rad); 0 where that is below a degree."""
    return 0.0 if abs(error) < 0.0175 else max(-fastest, min(fastest, turn_gain * error))
