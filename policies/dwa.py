"""The dynamic window approach: the best of the arcs that a robot can reach soon, and on which it can still stop."""

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
from wayfield.policies.detour import COLUMNS, WAYPOINTS, seek
from wayfield.policies.policy import check_gain, check_scan
from wayfield.policies.stopping import (
    APPROACH,
    SECTORS,
    admissible,
    arrived,
    braking_speed,
    find_approaching,
    find_hits,
    free_time,
    fresh_scans,
    sensed,
    set_command,
    step_and_stop,
    turn_towards,
)

SPEEDS = 7  # of the grid of twists; for an omni base: of changes of velocity
TURNS = 15  # of the grid of twists; for an omni base: of their directions

# Columns of the memory; the last command is 0 to 2.
RESTING = 3
DETOUR = 4
RECALL = DETOUR + COLUMNS
SCANS = RECALL + 3 * SECTORS


@dataclasses.dataclass(frozen=True)
class Dwa:
    """Drives the arc that heads best for the goal, of those that it can reach soon and stop on before any hit.

    The dynamic window holds the twists (v, w) within `window` seconds of acceleration of the last command (all of them
    in the tier "ideal"), v from 0 to max_speed, |w| <= max_yaw_rate. Of its 7 x 15 twists those count that are
    admissible: with t the time that the arc stays `margin` clear of all hits, less lag and control period,

        v <= 2 a t,  |w| <= 2 a_w t        that is, v <= sqrt(2 dist a), |w| <= sqrt(2 angle a_w)

    and the one with the largest

        heading (1 - |turn left to the goal| / pi) + clearance t / horizon + velocity v / max_speed
        + progress (approach to the goal) / (max_speed horizon) + room (gap at the arc's end) / room_range

    is driven, if the plant's own model can stop it after one more control period; else the next best, else the brakes.
    The turn left is what remains once the rotation has been braked (Fox's heading). The last two terms are critics
    beside the paper's three: `progress` is measured at the end of the arc (cut at the hit, the goal, the horizon),
    `room` a second along it. Weights of zero leave Fox's objective.

    An omni base has no need to turn: its grid is 7 changes of velocity in 15 directions, counted from the goal's, while
    it turns to the goal heading; its heading term is the angle between velocity and goal. With a scan that does not
    surround it, it is driven like a differential drive, so as not to go where it does not look. The robot slows down at
    the goal, rests within stop_radius and turns to the goal heading.

    A robot that stops coming nearer for `patience` seconds follows the obstacle in its way (policies/detour.py);
    patience = inf is Fox's law, which a dead end holds. What is near stays known for `recall` seconds after it drops
    out of sight. What comes nearer counts as if it were also where it will be in `foresight` seconds
    (policies/stopping.py), and a differential drive that sees all around may then back away at up to `retreat`;
    foresight = 0 takes what moves for standing still, as Fox does. Limits: it takes what it has not seen for free,
    also a thin wall seen end-on between two beams, and does not foresee what crosses its way without coming nearer;
    a differential drive is often run into by a disc that comes straight at it. Serves both kinds of robot.

    Source: Fox, Burgard and Thrun, IEEE Robotics and Automation Magazine 4(1), 1997.
    """

    max_speed: float = 0.6  # m/s
    max_yaw_rate: float = 1.5  # rad/s
    window: float = 0.5  # s
    horizon: float = 2.0  # s
    margin: float = 0.03  # m
    heading: float = 0.5
    clearance: float = 0.3
    velocity: float = 0.2
    progress: float = 1.0
    room: float = 1.0
    room_range: float = 0.3  # m, beyond which more room is worth nothing
    turn_gain: float = 2.0  # 1/s, to the goal heading
    stop_radius: float = 0.08  # m
    patience: float = 2.0  # s, inf for no detours
    reach: float = 0.5  # m, a detour takes directions that are free this far
    first_leg: float = 3.0  # m, before a detour tries the other side
    recall: float = 2.0  # s
    foresight: float = 1.5  # s, 0 takes what moves for standing still
    retreat: float = 0.3  # m/s, backwards, at most, where something comes nearer

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def __post_init__(self) -> None:
        for name in ("max_speed", "max_yaw_rate", "window", "horizon", "room_range", "reach", "first_leg"):
            check_gain(self, name, above=0.0)
        for name in ("margin", "heading", "clearance", "velocity", "progress", "room", "turn_gain", "stop_radius"):
            check_gain(self, name, least=0.0)
        check_gain(self, "patience", least=0.0, finite=False)
        for name in ("recall", "foresight", "retreat"):
            check_gain(self, name, least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what each robot remembers, a row of numbers: the columns are named above.

        Raises:
            ValueError: if the robot has no range scan.
        """
        check_scan(self, briefing.beam_angles, briefing)
        memory = np.hstack([np.zeros((briefing.num_envs, SCANS)), fresh_scans(briefing)])
        memory[:, DETOUR + WAYPOINTS] = np.nan
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t) in m/s and rad/s.

        Raises:
            ValueError: if the scan has another number of beams than the briefing.
        """
        twists = np.empty((len(memory), 3))
        choose_twists(*sensed(self, observation, briefing), memory, twists)
        return twists[:, briefing.robot.twist_axes]


@compiled
def choose_twists(
    ranges, directions, max_range, goals, poses, heading_errors, waypoints_left, twist, plant, wheel_matrix,
    hull_radius, delay, sideways, all_round, gains, memory, twists,
):  # fmt: skip
    """Fills the (b, 3) twists of `Dwa.act`; `sideways`: whether the grid is one of velocities.

    `all_round`: whether the scan surrounds the robot, so that it may back away.
    """
    (max_speed, max_yaw_rate, window, horizon, margin, k_heading, k_clearance, k_velocity, k_progress, k_room,
     room_range, turn_gain, stop_radius, patience, reach, first_leg, recall, foresight, retreat) = gains  # fmt: skip
    acceleration, yaw_acceleration, _, _, wheel_limit, dt = plant
    hits = np.empty((2 * ranges.shape[1] + SECTORS, 3))
    candidates = np.empty((SPEEDS * TURNS, 4))  # a twist and its score
    radius = hull_radius + margin
    stopping = max_speed * (delay + dt + max_speed / acceleration)
    farthest = radius + room_range + max(max_speed * horizon, stopping, 3.0)
    for i in range(ranges.shape[0]):
        count = find_hits(
            ranges, i, directions, max_range, farthest, radius, poses, recall, dt, memory, RECALL, hits
        )  # fmt: skip
        backwards = 0.0
        if foresight > 0.0:
            standing = count
            count = find_approaching(
                ranges, i, directions, max_range, radius, poses, foresight, dt, memory, SCANS, hits, count
            )  # fmt: skip
            backwards = -retreat if all_round and count > standing else 0.0
        goal_x = goals[i, 0]
        goal_y = goals[i, 1]
        d = math.sqrt(goal_x * goal_x + goal_y * goal_y)
        turn = turn_towards(heading_errors[i], turn_gain, max_yaw_rate)
        chosen = -1
        if arrived(memory, i, RESTING, d, waypoints_left[i], stop_radius):
            chosen = 0
            candidates[0, 0] = 0.0
            candidates[0, 1] = 0.0
            candidates[0, 2] = turn
        else:
            aim, around = seek(
                hits, count, poses, bearing(goal_y, goal_x), d, waypoints_left[i], patience, reach, first_leg, dt,
                memory, i, DETOUR,
            )  # fmt: skip
            fastest = max_speed
            if around:
                # a goal as far away as an arc can lead
                d = max_speed * horizon
                goal_x = d * sin_cos(aim)[1]
                goal_y = d * sin_cos(aim)[0]
            elif waypoints_left[i] == 0.0:
                fastest = min(fastest, braking_speed(d, APPROACH * acceleration, delay))
            # the window; that of an omni base is a disc around its velocity
            instant = acceleration == np.inf
            centre_x = 0.0 if instant else memory[i, 0]
            centre_y = 0.0 if instant else memory[i, 1]
            change = min(acceleration * window, max_speed)
            slow = max(memory[i, 0] - acceleration * window, backwards)
            fast = max(min(memory[i, 0] + acceleration * window, fastest), slow)
            right = max(memory[i, 2] - yaw_acceleration * window, -max_yaw_rate)
            left = min(memory[i, 2] + yaw_acceleration * window, max_yaw_rate)
            for c in range(SPEEDS * TURNS):
                a = c // TURNS
                b = c % TURNS
                if sideways:
                    sine, cosine = sin_cos(aim + 2.0 * math.pi * b / TURNS)
                    vx = centre_x + change * a / (SPEEDS - 1) * cosine
                    vy = centre_y + change * a / (SPEEDS - 1) * sine
                    w = turn
                    shorten = min(1.0, fastest / max(math.sqrt(vx * vx + vy * vy), 1e-12))
                    vx *= shorten
                    vy *= shorten
                else:
                    vx = slow + (fast - slow) * a / (SPEEDS - 1)
                    vy = 0.0
                    w = right + (left - right) * b / (TURNS - 1)
                factor = saturation_factor(wheel_matrix, wheel_matrix.shape[0], wheel_limit, vx, vy, w)
                vx *= factor
                vy *= factor
                w *= factor
                candidates[c, 0] = vx
                candidates[c, 1] = vy
                candidates[c, 2] = w
                candidates[c, 3] = -np.inf
                v = math.sqrt(vx * vx + vy * vy)
                free = free_time(hits, count, vx, vy, w, horizon)
                if not admissible(free, v, w, plant, delay):
                    continue
                if sideways:
                    off = abs(wrap_angle(aim - bearing(vy, vx))) if v > 1e-6 else math.pi
                else:
                    off = abs(wrap_angle(aim - w * (dt + 0.5 * abs(w) / yaw_acceleration)))
                until = min(free, d / max(v, 1e-9))
                x, y, _ = integrate_arc(0.0, 0.0, 0.0, vx, vy, w, until)
                nearer = d - math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
                gap = room_range
                if k_room > 0.0:
                    x, y, _ = integrate_arc(0.0, 0.0, 0.0, vx, vy, w, min(until, 1.0))
                    nearest = (hull_radius + room_range) ** 2
                    for j in range(count):
                        dx = hits[j, 0] - x
                        dy = hits[j, 1] - y
                        nearest = min(nearest, dx * dx + dy * dy)
                    gap = max(math.sqrt(nearest) - hull_radius, 0.0)
                candidates[c, 3] = (
                    k_heading * (1.0 - off / math.pi)
                    + k_clearance * free / horizon
                    + k_velocity * (v if sideways else vx) / max_speed
                    + k_progress * nearer / (max_speed * horizon)
                    + k_room * gap / room_range
                )
            for _ in range(SPEEDS * TURNS):
                best = 0
                for c in range(1, SPEEDS * TURNS):
                    if candidates[c, 3] > candidates[best, 3]:
                        best = c
                if candidates[best, 3] == -np.inf:
                    break
                vx = candidates[best, 0]
                vy = candidates[best, 1]
                w = candidates[best, 2]
                if step_and_stop(plant, hits, count, memory, twist, i, vx, vy, w):
                    chosen = best
                    break
                candidates[best, 3] = -np.inf
        for k in range(3):
            twists[i, k] = candidates[chosen, k] if chosen >= 0 else 0.0
        set_command(plant, wheel_matrix, memory, i, twists[i, 0], twists[i, 1], twists[i, 2])
