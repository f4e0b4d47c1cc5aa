"""The vector field histogram, second edition: steers through the best of the gaps that the scan shows."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled, inlined
from wayfield.envs.geometry import bearing, sin_cos, wrap_angle
from wayfield.policies.detour import COLUMNS, seek
from wayfield.policies.policy import check_gain
from wayfield.policies.stopping import (
    SECTORS,
    arrived,
    braking_speed,
    check_beams,
    find_hits,
    free_time,
    measured_twists,
    plant,
    sees_all_round,
    set_command,
    step_and_stop,
    turn_towards,
)

DIRECTIONS = 144  # sectors of the histogram
SPEEDS = 8  # tried, from the fastest to standing


@dataclasses.dataclass(frozen=True)
class VfhPlus:
    max_speed: float = 0.6  # m/s
    max_yaw_rate: float = 1.5  # rad/s
    turn_gain: float = 2.5  # 1/s
    safety: float = 0.05  # m
    margin: float = 0.03  # m
    window: float = 1.5  # m
    low: float = 0.3
    high: float = 0.5
    wide: float = 1.0  # rad
    mu_goal: float = 5.0
    mu_heading: float = 2.0
    mu_previous: float = 2.0
    slowing: float = 0.5
    stop_radius: float = 0.08  # m
    patience: float = 2.0  # s
    reach: float = 0.5  # m
    first_leg: float = 3.0  # m
    recall: float = 2.0  # s

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        check_beams(self, briefing)
        memory = np.zeros((briefing.num_envs, 5 + COLUMNS + 3 * SECTORS + DIRECTIONS))
        memory[:, 4] = np.nan
        memory[:, 9] = -1.0
        return memory

    def act(self, observation, briefing, memory):
        twists = np.empty((len(memory), 3))
        beams = briefing.beam_angles
        steer(
            np.ascontiguousarray(observation.ranges),
            np.column_stack([np.cos(beams), np.sin(beams)]),
            briefing.max_range,
            observation.goal,
            observation.pose,
            observation.goal_heading_error,
            observation.waypoints_left,
            measured_twists(briefing, observation.twist),
            plant(briefing),
            briefing.robot.wheel_matrix,
            briefing.robot.hull_radius,
            briefing.actuators.lag + briefing.dt,
            briefing.robot.holonomic and sees_all_round(briefing),
            sees_all_round(briefing),
            tuple(float(x) for x in dataclasses.astuple(self)),
            memory,
            twists,
        )
        return twists[:, briefing.robot.twist_axes]


@inlined
def consider(direction, aim, course, previous, mu_goal, mu_heading, mu_previous, best, least):
    """Returns the cheaper of a candidate direction and the best so far, with its cost."""
    cost = mu_goal * abs(wrap_angle(direction - aim))
    if not math.isnan(course):
        cost += mu_heading * abs(wrap_angle(direction - course))
    if not math.isnan(previous):
        cost += mu_previous * abs(wrap_angle(direction - previous))
    if cost < least:
        return direction, cost
    return best, least


@inlined
def best_gap(blocked, aim, course, previous, wide, mu_goal, mu_heading, mu_previous):
    """Returns the cheapest candidate direction (rad) of the gaps between blocked sectors; NaN if all are blocked.

    Directions are in the frame of the sectors.
    """
    step = 2.0 * math.pi / DIRECTIONS
    first = -1
    for k in range(DIRECTIONS):
        if blocked[k]:
            first = k
            break
    if first < 0:
        return aim
    best = math.nan
    least = math.inf
    start = -1  # of the gap being walked through, counted from the first blocked sector on, all around
    for n in range(1, DIRECTIONS + 1):
        if not blocked[(first + n) % DIRECTIONS]:
            if start < 0:
                start = n
            continue
        if start < 0:
            continue
        right = -math.pi + (first + start) * step
        width = (n - start) * step
        if width <= wide:
            best, least = consider(
                right + 0.5 * width, aim, course, previous, mu_goal, mu_heading, mu_previous, best, least
            )
        else:
            for side in (0.5 * wide, width - 0.5 * wide):
                best, least = consider(right + side, aim, course, previous, mu_goal, mu_heading, mu_previous, best, least)
            inside = wrap_angle(aim - right - 0.5 * width)
            if abs(inside) < 0.5 * (width - wide):
                best, least = consider(aim, aim, course, previous, mu_goal, mu_heading, mu_previous, best, least)
        start = -1
    return wrap_angle(best) if not math.isnan(best) else best


@compiled
def steer(ranges, directions, max_range, goals, poses, heading_errors, waypoints_left, twist, plant, wheel_matrix,
    hull_radius, delay, sideways, all_round, gains, memory, twists):
    (max_speed, max_yaw_rate, turn_gain, safety, margin, window, low, high, wide, mu_goal, mu_heading, mu_previous,
     slowing, stop_radius, patience, reach, first_leg, recall) = gains
    acceleration, yaw_acceleration, _, _, wheel_limit, dt = plant
    binary = 5 + COLUMNS + 3 * SECTORS
    step = 2.0 * math.pi / DIRECTIONS
    hits = np.empty((ranges.shape[1] + SECTORS, 3))
    histogram = np.empty(DIRECTIONS)
    blocked = np.empty(DIRECTIONS, np.bool_)
    enlarged = hull_radius + safety
    farthest = max(window, max_speed * (delay + 0.5 * max_speed / acceleration) + hull_radius + margin + 0.5, reach + enlarged, 3.0)
    for i in range(ranges.shape[0]):
        count = find_hits(ranges, i, directions, max_range, farthest, hull_radius + margin, poses, recall, dt, memory, 5 + COLUMNS, hits)
        heading = poses[i, 2]
        d = math.sqrt(goals[i, 0] ** 2 + goals[i, 1] ** 2)
        turn = turn_towards(heading_errors[i], turn_gain, max_yaw_rate)
        if arrived(memory, i, 3, d, waypoints_left[i], stop_radius):
            set_command(plant, wheel_matrix, memory, i, 0.0, 0.0, turn)
            twists[i, 0] = 0.0
            twists[i, 1] = 0.0
            twists[i, 2] = turn
            continue
        goal_bearing = bearing(goals[i, 1], goals[i, 0])
        aim, around = seek(hits, count, poses, goal_bearing, d, waypoints_left[i], patience, reach, first_leg, dt, memory, i, 5)
        # primary histogram
        histogram[:] = 0.0
        seen = window if around else min(window, d + enlarged)
        # a driven differential drive reaches no direction that its turning circles cannot get to
        moving = math.sqrt(memory[i, 0] ** 2 + memory[i, 1] ** 2)
        masked = not sideways and moving > 0.05
        turning = moving / max_yaw_rate
        left = math.pi
        right = -math.pi
        for j in range(count):
            distance = math.sqrt(hits[j, 0] ** 2 + hits[j, 1] ** 2)
            if distance >= seen:
                continue
            beam = bearing(hits[j, 1], hits[j, 0])
            sine = min(enlarged / distance, 1.0)
            half = bearing(sine, math.sqrt(1.0 - sine * sine))
            magnitude = 1.0 - (distance / window) ** 2
            centre = (wrap_angle(heading + beam) + math.pi) / step - 0.5  # in sectors
            for k in range(math.ceil(centre - half / step), math.floor(centre + half / step) + 1):
                histogram[k % DIRECTIONS] = max(histogram[k % DIRECTIONS], magnitude)
            if masked:
                keep = (turning + enlarged) ** 2
                if beam >= 0.0 and hits[j, 0] ** 2 + (hits[j, 1] - turning) ** 2 < keep:
                    left = min(left, beam)
                if beam <= 0.0 and hits[j, 0] ** 2 + (hits[j, 1] + turning) ** 2 < keep:
                    right = max(right, beam)
        course = 0.0
        if sideways:
            course = bearing(memory[i, 1], memory[i, 0]) if moving > 0.05 else math.nan
        for k in range(DIRECTIONS):
            if histogram[k] > high:
                memory[i, binary + k] = 1.0
            elif histogram[k] < low:
                memory[i, binary + k] = 0.0
            body = wrap_angle(-math.pi + (k + 0.5) * step - heading)
            blocked[k] = memory[i, binary + k] == 1.0 or (masked and (body > left or body < right))
        choice = best_gap(blocked, wrap_angle(aim + heading), course + heading, memory[i, 4], wide, mu_goal, mu_heading, mu_previous)
        fastest = max_speed
        if math.isnan(choice) and masked:
            for k in range(DIRECTIONS):
                blocked[k] = memory[i, binary + k] == 1.0
            choice = best_gap(blocked, wrap_angle(aim + heading), course + heading, memory[i, 4], wide, mu_goal, mu_heading, mu_previous)
            fastest = 0.0
        memory[i, 4] = choice
        if around and sideways and not math.isnan(choice):
            memory[i, 6] = choice
        vx = 0.0
        vy = 0.0
        w = 0.0
        if not math.isnan(choice):
            choice = wrap_angle(choice - heading)
            if waypoints_left[i] == 0.0 and not around:
                fastest = min(fastest, braking_speed(d, 0.7 * acceleration, delay))
            sine, cosine = sin_cos(choice)
            if sideways:
                w = turn
                ahead = choice
            else:
                w = turn_towards(choice, turn_gain, max_yaw_rate)
                fastest *= max(cosine, 0.0) ** 2
                sine = 0.0
                cosine = 1.0
                ahead = 0.0
            k = int((wrap_angle(heading + ahead) + math.pi) / step) % DIRECTIONS
            fastest *= 1.0 - slowing * histogram[k]
            for n in range(SPEEDS, -1, -1):
                v = fastest * n / SPEEDS
                vx = v * cosine
                vy = v * sine
                free = free_time(hits, count, vx, vy, w, 2.0)
                if v <= 2.0 * acceleration * max(free - delay, 0.0) and step_and_stop(plant, hits, count, memory, twist, i, vx, vy, w):
                    break
        elif not all_round:
            w = turn_towards(aim, turn_gain, max_yaw_rate)
        set_command(plant, wheel_matrix, memory, i, vx, vy, w)
        twists[i, 0] = vx
        twists[i, 1] = vy
        twists[i, 2] = w
