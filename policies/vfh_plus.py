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
from wayfield.envs.kinematics import saturation_factor
from wayfield.policies.detour import COLUMNS, COURSE, LOOK, WAYPOINTS, seek
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

DIRECTIONS = 144  # sectors of the histograms, in the world frame, from -pi on
WIDTH = 2.0 * math.pi / DIRECTIONS
SPEEDS = 8  # tried, from the fastest down
AHEAD = 2.0  # s, that the arc is looked along
MOVING = 0.05  # m/s, from which a motion has a direction

# Columns of the memory; the last command is 0 to 2.
RESTING = 3
PREVIOUS = 4  # direction chosen last, rad, world frame
DETOUR = 5
RECALL = DETOUR + COLUMNS
BINARY = RECALL + 3 * SECTORS
SCANS = BINARY + DIRECTIONS


@dataclasses.dataclass(frozen=True)
class VfhPlus:
    """Steers for the cheapest of the directions that no obstacle, grown by the robot's radius, stands in.

    1. Primary histogram. A hit at the distance d < window fills the sectors within asin(min(1, r / d)) of its own, r
       the hull's radius + safety, with the magnitude 1 - (d / window)^2; each keeps the largest. The paper sums over
       the cells of a grid, so that its thresholds depend on how many there are; a largest value does not depend on the
       number of beams. Hits beyond the goal do not count.
    2. Binary histogram. A sector is blocked from `high` on, free below `low`, and keeps what it was in between.
    3. Masked histogram. A differential drive that moves at v turns on circles of radius v / max_yaw_rate or more: a hit
       within r of such a circle on its side blocks what lies beyond it. An omni base turns at once, and so does a
       robot that stands. Where the mask leaves nothing, the robot brakes and turns by the binary histogram.
    4. Candidates. A gap of at most `wide` offers its middle; a wider one the directions half of `wide` from either edge
       and the goal's, if it lies between them. All around is the goal's where nothing is blocked. The least of
       mu_goal |c - goal| + mu_heading |c - course| + mu_previous |c - previous| is steered for.

    w = turn_gain c for a differential drive, v = max_speed max(cos c, 0)^2 (1 - slowing h), h the primary histogram
    straight ahead, less at the goal and where it could not stop on its arc before a hit (policies/stopping.py: the
    admissible velocities of the dynamic window approach and the plant's own model). An omni base drives in direction c
    and turns to the goal heading; with a scan that does not surround it, it is driven like a differential drive. Where
    every direction is blocked the robot brakes and stands; if its scan does not surround it, it turns on the spot.

    A robot that stops coming nearer for `patience` seconds follows the obstacle in its way (policies/detour.py): the
    detour's direction takes the place of the goal's; patience = inf is the paper's law. What is near stays known for
    `recall` seconds after it drops out of sight. What comes nearer counts as if it were also where it will be in
    `foresight` seconds (policies/stopping.py); foresight = 0 takes what moves for standing still, as the paper does.
    Limits: a gap is seen only where it is 2 r wide and, from afar, wider by a sector; what is not seen is taken for
    free, and what crosses the way without coming nearer is not foreseen. Serves both kinds of robot.

    Source: Ulrich and Borenstein, VFH+: Reliable Obstacle Avoidance for Fast Mobile Robots, ICRA 1998.
    """

    max_speed: float = 0.6  # m/s
    max_yaw_rate: float = 1.5  # rad/s
    turn_gain: float = 2.5  # 1/s
    safety: float = 0.05  # m, that obstacles are grown by besides the hull
    margin: float = 0.03  # m, that no stop may use up
    window: float = 1.5  # m
    low: float = 0.3
    high: float = 0.5
    wide: float = 1.0  # rad
    mu_goal: float = 5.0
    mu_heading: float = 2.0
    mu_previous: float = 2.0
    slowing: float = 0.5
    stop_radius: float = 0.08  # m
    patience: float = 2.0  # s, inf for no detours
    reach: float = 0.5  # m, a detour takes directions that are free this far
    first_leg: float = 3.0  # m, before a detour tries the other side
    recall: float = 2.0  # s
    foresight: float = 1.5  # s, 0 takes what moves for standing still

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def __post_init__(self) -> None:
        for name in ("max_speed", "max_yaw_rate", "turn_gain", "window", "low", "wide", "reach", "first_leg"):
            check_gain(self, name, above=0.0)
        for name in (
            "safety",
            "margin",
            "mu_goal",
            "mu_heading",
            "mu_previous",
            "slowing",
            "stop_radius",
            "recall",
            "foresight",
        ):
            check_gain(self, name, least=0.0)
        check_gain(self, "high", least=self.low)
        check_gain(self, "patience", least=0.0, finite=False)
        if self.high >= 1.0 or self.slowing > 1.0:
            raise ValueError(
                f"VfhPlus: high must be below 1 and slowing at most 1, got {self.high!r} and {self.slowing!r}"
            )

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what each robot remembers, a row of numbers: the columns are named above.

        Raises:
            ValueError: if the robot has no range scan.
        """
        check_scan(self, briefing.beam_angles, briefing)
        memory = np.hstack([np.zeros((briefing.num_envs, SCANS)), fresh_scans(briefing)])
        memory[:, PREVIOUS] = np.nan
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
        steer(*sensed(self, observation, briefing), memory, twists)
        return twists[:, briefing.robot.twist_axes]


@compiled
def steer(
    ranges, directions, max_range, goals, poses, heading_errors, waypoints_left, twist, plant, wheel_matrix,
    hull_radius, delay, sideways, all_round, gains, memory, twists,
):  # fmt: skip
    """Fills the (b, 3) twists of `VfhPlus.act`; `sideways`: whether the robot drives in any direction."""
    (max_speed, max_yaw_rate, turn_gain, safety, margin, window, low, high, wide, mu_goal, mu_heading, mu_previous,
     slowing, stop_radius, patience, reach, first_leg, recall, foresight) = gains  # fmt: skip
    acceleration, _, _, _, wheel_limit, dt = plant
    hits = np.empty((2 * ranges.shape[1] + SECTORS, 3))
    primary = np.empty(DIRECTIONS)
    blocked = np.empty(DIRECTIONS, np.bool_)
    radius = hull_radius + margin
    grown = hull_radius + safety
    farthest = max(window, radius + max(max_speed * AHEAD, LOOK))
    for i in range(ranges.shape[0]):
        count = find_hits(
            ranges, i, directions, max_range, farthest, radius, poses, recall, dt, memory, RECALL, hits
        )  # fmt: skip
        if foresight > 0.0:
            count = find_approaching(
                ranges, i, directions, max_range, radius, poses, foresight, dt, memory, SCANS, hits, count
            )  # fmt: skip
        heading = poses[i, 2]
        d = math.sqrt(goals[i, 0] ** 2 + goals[i, 1] ** 2)
        vx = 0.0
        vy = 0.0
        w = turn_towards(heading_errors[i], turn_gain, max_yaw_rate)
        if not arrived(memory, i, RESTING, d, waypoints_left[i], stop_radius):
            aim, around = seek(
                hits, count, poses, bearing(goals[i, 1], goals[i, 0]), d, waypoints_left[i], patience, reach, first_leg,
                dt, memory, i, DETOUR,
            )  # fmt: skip
            speed = math.sqrt(memory[i, 0] ** 2 + memory[i, 1] ** 2)
            if not sideways:
                course = heading
            elif speed > MOVING:
                course = heading + bearing(memory[i, 1], memory[i, 0])
            else:
                course = math.nan
            circling = speed / max_yaw_rate if speed > MOVING and not sideways else math.nan
            seen = window if around else min(window, d + grown)
            left, right = fill_histogram(primary, hits, count, heading, grown, seen, window, circling)
            for k in range(DIRECTIONS):
                if primary[k] >= high:
                    memory[i, BINARY + k] = 1.0
                elif primary[k] < low:
                    memory[i, BINARY + k] = 0.0
                beyond = wrap_angle((k + 0.5) * WIDTH - math.pi - heading)
                blocked[k] = memory[i, BINARY + k] == 1.0 or beyond > left or beyond < right
            fastest = max_speed
            weights = (mu_goal, mu_heading, mu_previous)
            choice = best_direction(blocked, heading + aim, course, memory[i, PREVIOUS], wide, weights)
            if math.isnan(choice):
                fastest = 0.0
                for k in range(DIRECTIONS):
                    blocked[k] = memory[i, BINARY + k] == 1.0
                choice = best_direction(blocked, heading + aim, course, memory[i, PREVIOUS], wide, weights)
            memory[i, PREVIOUS] = choice
            if math.isnan(choice):
                w = 0.0 if all_round else turn_towards(aim, turn_gain, max_yaw_rate)
            else:
                if around and sideways:
                    # where it goes at once; a differential drive has yet to turn
                    memory[i, DETOUR + COURSE] = choice
                elif not around and waypoints_left[i] == 0.0:
                    fastest = min(fastest, braking_speed(d, APPROACH * acceleration, delay))
                turn = wrap_angle(choice - heading)
                sine, cosine = sin_cos(turn)
                if not sideways:
                    w = turn_towards(turn, turn_gain, max_yaw_rate)
                    fastest *= max(cosine, 0.0) ** 2
                    sine = 0.0
                    cosine = 1.0
                    turn = 0.0
                k = int((wrap_angle(heading + turn) + math.pi) / WIDTH) % DIRECTIONS
                fastest *= 1.0 - slowing * primary[k]
                for n in range(SPEEDS, -1, -1):
                    v = fastest * n / SPEEDS
                    factor = saturation_factor(
                        wheel_matrix, wheel_matrix.shape[0], wheel_limit, v * cosine, v * sine, w
                    )  # fmt: skip
                    vx = factor * v * cosine
                    vy = factor * v * sine
                    free = free_time(hits, count, vx, vy, factor * w, AHEAD)
                    if admissible(free, factor * v, 0.0, plant, delay) and step_and_stop(
                        plant, hits, count, memory, twist, i, vx, vy, factor * w
                    ):
                        w *= factor
                        break
        twists[i, 0] = vx
        twists[i, 1] = vy
        twists[i, 2] = w
        set_command(plant, wheel_matrix, memory, i, vx, vy, w)


@inlined
def fill_histogram(primary, hits, count, heading, grown, seen, window, circling):
    """Fills the primary histogram from the hits nearer than `seen` (m).

    Returns the directions (rad, body frame) to the left and to the right beyond which circles of radius `circling` (m)
    do not reach; pi and -pi where nothing is in their way, or where `circling` is NaN.
    """
    left = math.pi
    right = -math.pi
    primary[:] = 0.0
    for j in range(count):
        x = hits[j, 0]
        y = hits[j, 1]
        distance = math.sqrt(x * x + y * y)
        if distance >= seen:
            continue
        beam = bearing(y, x)
        # a robot within the grown obstacle has half of all directions before it
        sine = min(1.0, grown / distance)
        half = bearing(sine, math.sqrt(1.0 - sine * sine)) / WIDTH
        middle = (wrap_angle(heading + beam) + math.pi) / WIDTH - 0.5
        magnitude = 1.0 - (distance / window) ** 2
        for k in range(math.ceil(middle - half), math.floor(middle + half) + 1):
            primary[k % DIRECTIONS] = max(primary[k % DIRECTIONS], magnitude)
        keep = (circling + grown) ** 2
        if beam >= 0.0 and x * x + (y - circling) ** 2 < keep:
            left = min(left, beam)
        if beam <= 0.0 and x * x + (y + circling) ** 2 < keep:
            right = max(right, beam)
    return left, right


@inlined
def best_direction(blocked, goal, course, previous, wide, weights):
    """Returns the cheapest candidate of the gaps between blocked sectors (rad, world frame), NaN if all are blocked.

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
            inset = 0.5 * min(wide, gap)
            off = wrap_angle(goal - edge - 0.5 * gap)
            for c in range(3):
                # the ends of the gap, set in (its middle twice where it is narrow), and the goal between them
                candidate = edge + (inset if c == 0 else gap - inset)
                if c == 2:
                    if abs(off) > 0.5 * gap - inset:
                        continue
                    candidate = goal
                cost = weights[0] * abs(wrap_angle(candidate - goal))
                if not math.isnan(course):
                    cost += weights[1] * abs(wrap_angle(candidate - course))
                if not math.isnan(previous):
                    cost += weights[2] * abs(wrap_angle(candidate - previous))
                if cost < least:
                    least = cost
                    best = wrap_angle(candidate)
    return best
