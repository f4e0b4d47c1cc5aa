"""The dynamic window approach: the best of the arcs that a robot can reach soon, and on which it can still stop."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots.kinematics import integrate_arc, saturated
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.detour import DETOUR, seek
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

SPEEDS = 7  # of the grid of twists; for an omni base: of changes of velocity
TURNS = 15  # of the grid of twists; for an omni base: of their directions

STATE = [
    ("command", np.float64, (3,)),  # the last, as the plant takes it, m/s and rad/s
    *REST,
    ("detour", DETOUR),
    *SIGHTS,
]


@dataclasses.dataclass(frozen=True)
class Dwa(ScanLaw):
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
    the goal, rests within stop_radius, or nearer where the goal asks for it, and turns to the goal heading.

    A robot that stops coming nearer for `patience` seconds follows the obstacle in its way (`parts.detour`);
    patience = inf is Fox's law, which a dead end holds. What is near stays known for `recall` seconds after it drops
    out of sight. What comes nearer counts as if it were also where it will be in `foresight` seconds
    (`parts.stopping`), and a differential drive that sees all around may then back away at up to `retreat`;
    foresight = 0 takes what moves for standing still, as Fox does. Limits: it takes what it has not seen for free,
    also a thin wall seen end-on between two beams, and does not foresee what crosses its way without coming nearer;
    a differential drive is often run into by a disc that comes straight at it. Serves both kinds of robot.

    Source: Fox, Burgard and Thrun, IEEE Robotics and Automation Magazine 4(1), 1997.
    """

    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    max_yaw_rate: float = gain(1.5, "rad/s", "at most", above=0.0)
    window: float = gain(0.5, "s", "of acceleration, that spans the dynamic window", above=0.0)
    horizon: float = gain(2.0, "s", "for which arcs are looked at", above=0.0)
    margin: float = gain(0.03, "m", "beside the hull, kept clear of hits", least=0.0)
    heading: float = gain(0.5, "1", "weight of the heading towards the goal", least=0.0, search=(0.1, 2.0))
    clearance: float = gain(0.3, "1", "weight of the time until a hit", least=0.0, search=(0.05, 1.0))
    velocity: float = gain(0.2, "1", "weight of the speed", least=0.0, search=(0.05, 1.0))
    progress: float = gain(1.0, "1", "weight of the approach to the goal", least=0.0, search=(0.2, 4.0))
    room: float = gain(1.0, "1", "weight of the gap a second ahead", least=0.0, search=(0.3, 3.0))
    room_range: float = gain(0.3, "m", "beyond which more room is worth nothing", above=0.0)
    turn_gain: float = gain(2.0, "1/s", "to the goal heading", least=0.0)
    # past a goal beside an obstacle a detour leads away, perhaps for good: the range of the search begins at 0.05 m
    stop_radius: float = gain(0.08, "m", "or less where the goal asks for it", least=0.0, search=(0.05, 0.18))
    patience: float = gain(2.0, "s", "inf for no detours", least=0.0, finite=False)
    reach: float = gain(0.5, "m", "a detour takes directions that are free this far", above=0.0)
    first_leg: float = gain(3.0, "m", "before a detour tries the other side", above=0.0)
    recall: float = gain(2.0, "s", "for which what is near stays known out of sight", least=0.0)
    foresight: float = gain(1.5, "s", "0 takes what moves for standing still", least=0.0)
    retreat: float = gain(0.3, "m/s", "backwards, at most, where something comes nearer", least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what each robot remembers, (b,): a record of STATE and the scans of `remembering`.

        Raises:
            ValueError: if the robot has no range scan.
        """
        memory = remembering(self, briefing, STATE)
        memory["state"]["stop_radius"] = rest_radius(self.stop_radius, briefing.position_tolerance)
        memory["state"]["detour"]["waypoints"] = np.nan
        return memory

    def act_on(
        self, scan: Scan, observation: goal_reaching.Observation, briefing: Briefing, state: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t) in m/s and rad/s."""
        all_round = sees_all_round(briefing)
        p = params(self, briefing, all_round=all_round, sideways=briefing.robot.holonomic and all_round)
        twists = np.empty((len(state), 3))
        choose_twists(p, scan, Seen.of(observation, briefing), state, twists)
        return twists[:, briefing.robot.twist_axes]


@any_layout
@allocating
def choose_twists(params, scan, seen, memory, twists):
    """Fills the (b, 3) twists of `Dwa.act`.

    Beside the gains: `sideways`, whether the grid is one of velocities, and `all_round`, whether the scan surrounds the
    robot, so that it may back away.
    """
    p = params[0]
    points = np.empty((2 * scan.ranges.shape[1] + SECTORS, 3))
    candidates = np.empty((SPEEDS * TURNS, 4))  # a twist and its score
    radius = p.plant.hull_radius + p.margin
    delay = p.plant.lag + p.plant.dt
    stopping = p.max_speed * (delay + p.plant.dt + p.max_speed / p.plant.acceleration)
    farthest = radius + p.room_range + max(p.max_speed * p.horizon, stopping, 3.0)
    for i in range(scan.ranges.shape[0]):
        m = memory[i]
        count = find_hits(p, scan, seen, m, i, farthest, radius, points, 0.0)
        slowest = 0.0
        if p.foresight > 0.0:
            standing = count
            count = find_approaching(p, scan, seen, m, i, radius, points, count)
            slowest = -p.retreat if p.all_round and count > standing else 0.0
        hits = points[:count]
        goal_x = seen.goals[i, 0]
        goal_y = seen.goals[i, 1]
        d = math.sqrt(goal_x * goal_x + goal_y * goal_y)
        turn = turn_towards(seen.heading_errors[i], p.turn_gain, p.max_yaw_rate)
        twist = 0.0, 0.0, turn
        if not arrived(m, d, seen.waypoints_left[i]):
            aim, around = seek(p, hits, seen, m, i)
            fastest = p.max_speed
            if around:
                # a goal as far away as an arc can lead
                d = p.max_speed * p.horizon
                goal_x = d * sin_cos(aim)[1]
                goal_y = d * sin_cos(aim)[0]
            elif seen.waypoints_left[i] == 0.0:
                fastest = min(fastest, braking_speed(d, APPROACH * p.plant.acceleration, delay))
            if p.sideways:
                fill_disc(p, m.command, aim, turn, fastest, candidates)
            else:
                fill_window(p, m.command, slowest, fastest, candidates)
            for c in range(SPEEDS * TURNS):
                candidates[c, 3] = score(p, hits, candidates[c], aim, d, goal_x, goal_y)
            twist = best_that_stops(p.plant, hits, m.command, seen.twists[i], candidates)
        twists[i, 0], twists[i, 1], twists[i, 2] = twist
        set_command(p.plant, m.command, twists[i, 0], twists[i, 1], twists[i, 2])


# The search space, Fox's V_d: what can be reached within `window`, cut to what the wheels can turn.


@inlined
def fill_window(p, command, slowest, fastest, candidates):
    """Fills the twists of a differential drive: forward speeds from `slowest` to `fastest` (m/s), and yaw rates."""
    slow = max(command[0] - p.plant.acceleration * p.window, slowest)
    fast = max(min(command[0] + p.plant.acceleration * p.window, fastest), slow)
    right = max(command[2] - p.plant.yaw_acceleration * p.window, -p.max_yaw_rate)
    left = min(command[2] + p.plant.yaw_acceleration * p.window, p.max_yaw_rate)
    for c in range(SPEEDS * TURNS):
        v = slow + (fast - slow) * (c // TURNS) / (SPEEDS - 1)
        w = right + (left - right) * (c % TURNS) / (TURNS - 1)
        put(p.plant, candidates, c, v, 0.0, w)


@inlined
def fill_disc(p, command, aim, turn, fastest, candidates):
    """Fills the twists of an omni base: a disc of velocities around its own, in directions counted from `aim` (rad)."""
    instant = p.plant.acceleration == np.inf
    centre_x = 0.0 if instant else command[0]
    centre_y = 0.0 if instant else command[1]
    change = min(p.plant.acceleration * p.window, p.max_speed)
    for c in range(SPEEDS * TURNS):
        a = c // TURNS
        b = c % TURNS
        sine, cosine = sin_cos(aim + 2.0 * math.pi * b / TURNS)
        vx = centre_x + change * a / (SPEEDS - 1) * cosine
        vy = centre_y + change * a / (SPEEDS - 1) * sine
        shorten = min(1.0, fastest / max(math.sqrt(vx * vx + vy * vy), 1e-12))
        put(p.plant, candidates, c, shorten * vx, shorten * vy, turn)


@inlined
def put(plant, candidates, c, vx, vy, w):
    """Enters a twist, cut to what the wheels can turn."""
    candidates[c, 0], candidates[c, 1], candidates[c, 2] = saturated(plant, vx, vy, w)


# The objective, Fox's G: a weighted sum of what speaks for a twist, if that is admissible.


@inlined
def score(p, hits, twist, aim, d, goal_x, goal_y):
    """Returns the value of the objective for a twist; -inf if it is not admissible.

    Args:
        aim: rad, the direction to the goal.
        d, goal_x, goal_y: the distance to the goal and where it is, m.
    """
    vx = twist[0]
    vy = twist[1]
    w = twist[2]
    v = math.sqrt(vx * vx + vy * vy)
    free = free_time(hits, vx, vy, w, p.horizon)
    if not admissible(p.plant, free, v, w):
        return -np.inf
    until = min(free, d / max(v, 1e-9))
    return (
        p.heading * (1.0 - heading_left(p, aim, vx, vy, w) / math.pi)
        + p.clearance * free / p.horizon
        + p.velocity * (v if p.sideways else vx) / p.max_speed
        + p.progress * approach(vx, vy, w, until, d, goal_x, goal_y) / (p.max_speed * p.horizon)
        + p.room * gap_ahead(p, hits, vx, vy, w, until) / p.room_range
    )


@inlined
def heading_left(p, aim, vx, vy, w):
    """Returns the angle (rad) to the goal that is left once the rotation has been braked, or of an omni's velocity."""
    if p.sideways:
        return abs(wrap_angle(aim - bearing(vy, vx))) if math.sqrt(vx * vx + vy * vy) > 1e-6 else math.pi
    return abs(wrap_angle(aim - w * (p.plant.dt + 0.5 * abs(w) / p.plant.yaw_acceleration)))


@inlined
def approach(vx, vy, w, until, d, goal_x, goal_y):
    """Returns by how much (m) the goal, `d` away, is nearer at the end of the arc, after `until` (s)."""
    x, y, _ = integrate_arc(0.0, 0.0, 0.0, vx, vy, w, until)
    return d - math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)


@inlined
def gap_ahead(p, hits, vx, vy, w, until):
    """Returns the gap (m, at most `room_range`) between hull and hits a second along the arc, or at its end."""
    if p.room == 0.0:
        return p.room_range
    x, y, _ = integrate_arc(0.0, 0.0, 0.0, vx, vy, w, min(until, 1.0))
    nearest = (p.plant.hull_radius + p.room_range) ** 2
    for j in range(hits.shape[0]):
        dx = hits[j, 0] - x
        dy = hits[j, 1] - y
        nearest = min(nearest, dx * dx + dy * dy)
    return max(math.sqrt(nearest) - p.plant.hull_radius, 0.0)


@inlined
def best_that_stops(plant, hits, command, wheels, candidates):
    """Returns the twist of the highest score after which the robot can still stop; standstill if there is none."""
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
        if step_and_stop(plant, hits, command, wheels, vx, vy, w):
            return vx, vy, w
        candidates[best, 3] = -np.inf
    return 0.0, 0.0, 0.0
