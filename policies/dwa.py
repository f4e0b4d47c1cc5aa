"""The dynamic window approach: the best of the arcs that a robot can reach soon and can still stop on."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.briefing import Briefing
from wayfield.envs.compiled import compiled
from wayfield.envs.geometry import bearing, sin_cos, wrap_angle
from wayfield.envs.kinematics import integrate_arc, saturation_factor
from wayfield.policies.detour import COLUMNS, seek
from wayfield.policies.policy import check_gain
from wayfield.policies.stopping import (
    SECTORS,
    braking_speed,
    check_beams,
    find_hits,
    free_time,
    measured_twists,
    plant,
    sees_all_round,
    set_command,
    step_and_stop,
)


@dataclasses.dataclass(frozen=True)
class Dwa:
    max_speed: float = 0.6  # m/s
    max_yaw_rate: float = 1.5  # rad/s
    margin: float = 0.03  # m, kept between hull and hits
    window: float = 0.5  # s, in which the twists of the window can be reached
    horizon: float = 2.0  # s, that the arcs are looked along
    heading: float = 0.5
    clearance: float = 0.3
    velocity: float = 0.2
    progress: float = 1.0
    room: float = 0.5
    room_range: float = 0.3
    stop_radius: float = 0.08  # m
    turn_gain: float = 2.0
    patience: float = 2.0  # s
    reach: float = 0.5  # m
    recall: float = 2.0  # s
    first_leg: float = 3.0  # m

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        check_beams(self, briefing)
        memory = np.zeros((briefing.num_envs, 4 + COLUMNS + 3 * SECTORS))
        memory[:, 8] = -1.0
        return memory

    def act(self, observation, briefing, memory):
        twists = np.empty((len(memory), 3))
        beams = briefing.beam_angles
        choose_twists(
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
            (self.max_speed, self.max_yaw_rate, self.margin, self.window, self.horizon, self.heading, self.clearance,
            self.velocity, self.progress, self.room, self.room_range, self.stop_radius, self.turn_gain, self.patience, self.reach, self.recall, self.first_leg),
            memory,
            twists,
        )
        return twists[:, briefing.robot.twist_axes]


SPEEDS = 7
TURNS = 15


@compiled
def choose_twists(ranges, directions, max_range, goals, poses, heading_errors, waypoints_left, twist, plant, wheel_matrix,
    hull_radius, delay, sideways, gains, memory, twists):
    (max_speed, max_yaw_rate, margin, window, horizon, k_heading, k_clearance, k_velocity, k_progress,
     k_room, room_range, stop_radius, turn_gain, patience, reach, recall, first_leg) = gains
    acceleration, yaw_acceleration, _, _, wheel_limit, dt = plant
    hits = np.empty((ranges.shape[1] + SECTORS, 3))
    candidates = np.empty((SPEEDS * TURNS, 4))
    farthest = max_speed * (horizon + delay + 0.5 * max_speed / acceleration) + hull_radius + margin + room_range
    for i in range(ranges.shape[0]):
        count = find_hits(ranges, i, directions, max_range, farthest, hull_radius + margin, poses, recall, dt, memory, 4 + COLUMNS, hits)
        gx = goals[i, 0]
        gy = goals[i, 1]
        d = math.sqrt(gx * gx + gy * gy)
        last = waypoints_left[i] == 0.0
        if not last or d > 2.0 * stop_radius:
            memory[i, 3] = 0.0
        elif d <= stop_radius:
            memory[i, 3] = 1.0
        goal_bearing = bearing(gy, gx)
        error = heading_errors[i]
        turn = max(-max_yaw_rate, min(max_yaw_rate, turn_gain * error))
        if memory[i, 3] == 1.0:
            if abs(error) < 0.02:
                turn = 0.0
            set_command(plant, wheel_matrix, memory, i, 0.0, 0.0, turn)
            twists[i, 0] = 0.0
            twists[i, 1] = 0.0
            twists[i, 2] = turn
            continue
        aim, around = seek(hits, count, poses, goal_bearing, d, waypoints_left[i], patience, reach, first_leg, dt, memory, i, 4)
        if around:
            d = 2.0
            goal_bearing = aim
            s, o = sin_cos(aim)
            gx = d * o
            gy = d * s
        fastest = max_speed
        if last and not around:
            fastest = min(fastest, braking_speed(d, 0.7 * acceleration, delay))
        change = min(acceleration * window, max_speed)
        spin = yaw_acceleration * window
        low = max(memory[i, 0] - acceleration * window, 0.0)
        high = max(min(memory[i, 0] + acceleration * window, fastest), low)
        right = max(memory[i, 2] - spin, -max_yaw_rate)
        left = min(memory[i, 2] + spin, max_yaw_rate)
        best = -1
        best_score = -np.inf
        for a in range(SPEEDS):
            for b in range(TURNS):
                c = a * TURNS + b
                if sideways:
                    if acceleration == np.inf:
                        vx = 0.0
                        vy = 0.0
                    else:
                        vx = memory[i, 0]
                        vy = memory[i, 1]
                    s, o = sin_cos(goal_bearing + 2.0 * math.pi * b / TURNS)
                    vx += change * a / (SPEEDS - 1) * o
                    vy += change * a / (SPEEDS - 1) * s
                    v = math.sqrt(vx * vx + vy * vy)
                    if v > fastest:
                        vx *= fastest / v
                        vy *= fastest / v
                        v = fastest
                    w = turn
                else:
                    v = low + (high - low) * a / (SPEEDS - 1)
                    vx = v
                    vy = 0.0
                    w = right + (left - right) * b / (TURNS - 1)
                factor = saturation_factor(wheel_matrix, wheel_matrix.shape[0], wheel_limit, vx, vy, w)
                vx *= factor
                vy *= factor
                v *= factor
                w *= factor
                candidates[c, 0] = vx
                candidates[c, 1] = vy
                candidates[c, 2] = w
                free = free_time(hits, count, vx, vy, w, horizon)
                room = max(free - delay, 0.0)
                if v > 2.0 * acceleration * room or (abs(w) > 2.0 * yaw_acceleration * room and v > 0.0):
                    candidates[c, 3] = -np.inf
                    continue
                # heading after turning brakes
                brake = dt + 0.5 * abs(w) / yaw_acceleration
                if sideways:
                    ahead = 1.0 - abs(wrap_angle(goal_bearing - bearing(vy, vx))) / math.pi if v > 1e-6 else 0.0
                else:
                    ahead = 1.0 - abs(wrap_angle(goal_bearing - w * brake)) / math.pi
                until = min(free, horizon, d / max(v, 1e-9))
                x, y, h = integrate_arc(0.0, 0.0, 0.0, vx, vy, w, until)
                nearer = (d - math.sqrt((gx - x) ** 2 + (gy - y) ** 2)) / (max_speed * horizon)
                near = room_range * room_range
                if k_room > 0.0:
                    x, y, h = integrate_arc(0.0, 0.0, 0.0, vx, vy, w, min(until, 1.0))
                    keep = (hull_radius + room_range) ** 2
                    for j in range(count):
                        dx = hits[j, 0] - x
                        dy = hits[j, 1] - y
                        keep = min(keep, dx * dx + dy * dy)
                    near = max(math.sqrt(keep) - hull_radius, 0.0) / room_range
                score = k_heading * ahead + k_clearance * free / horizon + k_velocity * v / max_speed + k_progress * nearer + k_room * near
                candidates[c, 3] = score
        vx = 0.0
        vy = 0.0
        w = 0.0
        for _ in range(SPEEDS * TURNS):
            best = -1
            best_score = -np.inf
            for c in range(SPEEDS * TURNS):
                if candidates[c, 3] > best_score:
                    best = c
                    best_score = candidates[c, 3]
            if best < 0:
                break
            if step_and_stop(plant, hits, count, memory, twist, i, candidates[best, 0], candidates[best, 1], candidates[best, 2]):
                vx = candidates[best, 0]
                vy = candidates[best, 1]
                w = candidates[best, 2]
                break
            candidates[best, 3] = -np.inf
        set_command(plant, wheel_matrix, memory, i, vx, vy, w)
        twists[i, 0] = vx
        twists[i, 1] = vy
        twists[i, 2] = w
