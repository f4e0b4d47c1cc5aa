"""Plans the shortest way of a car that goes both ways, around what stands and past what moves, and tracks it."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.geometry import clearance
from wayfield.envs.world.grids import grid_clearance
from wayfield.envs.world.movers import any_moves, motion_at, moves
from wayfield.envs.world.reeds_shepp import PLAN, is_free, plan_to, pose_along
from wayfield.policies.parts.arriving import gentle, is_there, stay_radius, turn_rate
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.steering import Map, unicycle_twists
from wayfield.system.compiled import allocating, any_layout, assign, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

FIELDS: list[Any] = [
    ("plan", np.float64, (PLAN, 2)),  # turn and length in radii of each piece
    ("start", np.float64, (3,)),  # pose where the plan begins, m and rad
    ("radius", np.float64),  # m, of its circles; 0: there is none
    ("length", np.float64),  # m
    ("along", np.float64),  # m, of it that is done
    ("off", np.float64),  # 1 once the robot has set off on it
    ("settling", np.float64),  # m, of the tracker
    ("begun", np.float64),  # m, of it, where the robot set off last
    ("arrived", np.float64),
    ("stay", np.float64),  # m, of `stay_radius`
    ("steps", np.float64),  # since the episode began
    ("no_path", np.int64),  # plans that are not free, for want of one that is
]
MEMORY = np.dtype(FIELDS)

_STRAIGHTS = 6  # lengths of the last piece that are tried, in either direction
_STRAIGHT_STEP = 0.3  # m, between them
_WINDOW = 0.15  # m, how far ahead of the last place on the plan the next one is looked for
PAUSE = 0.25  # s, between searches for a way where there is none
GRAIN = 0.005  # m, between the places that are looked at
_LEAST_SPEED = 0.02  # m/s, at which a piece is ended
_OVER = 0.005  # m, by which a lag carries the robot past its end at most: the deceleration times the lag squared
_STEADY = 0.3  # of `settling`: the way driven within the lag, up to which errors decay
STRAY = 0.15  # m, from the plan, beyond which another is made
_ROOM = 0.05  # m, that it wants to spare beside what moves
_EARLY, _LATE = 0.2, 0.5  # s, by which it may be at a place before its time and after it
_STOOD = 7  # times `_LATE`, for which nothing may come to where the robot stops on its way
_STRIDE = 0.04  # m, between the places at which it looks for what moves


@dataclasses.dataclass(frozen=True)
class ReedsShepp(GoalLaw):
    """Drives along the shortest way to the goal of a car that can only turn on circles of `radius`, either way.

    Of the ways that end with a straight piece of -1.5 to 1.5 m it takes the shortest on which the hull has `margin` to
    spare from all that stands; where there is none, one of half the radius, then without the margin. Where there is
    none either, which the memory's field `no_path` counts, it stands. Where something moves, it sets off once that
    leaves every place of the way free when the robot will be there, and stops again where it no longer does, unless
    something comes to where it would stop. A late base then takes up to twice `settling`, and so drives faster.

    Along the way, with e the robot's place left of it, th its heading off it, kappa the curvature a little ahead, by
    what the actuators lag, and d = 1 or -1 the direction,

        v = d min(speed, max_yaw_rate / |kappa|, sqrt(2 deceleration s), 0.3 L / tau),
        w = v kappa - |v| (2 th / L + d e / L^2),

    s the way left to the next change of direction, brings both errors down critically damped over L = `settling`, and
    does so on a base that lags by tau as long as it drives but a share of L within tau; faster it would swing. Past its
    end a lag carries the robot by no more than 5 mm: it brakes with at most 0.005 m / tau^2. At the goal (see
    `arrival_radius` of `SmoothPose`) it turns on the spot by what is left. Off the way by 0.15 m, or at its end but not
    at the goal, it plans anew. It plans to the next waypoint, with the heading towards that, and then to the goal.

    Source: Reeds and Shepp, Optimal Paths for a Car That Goes Both Forwards and Backwards, Pacific J. Math. 145(2),
    1990. The straight end, the waiting and the tracking law are ours.
    """

    radius: float = gain(0.4, "m", "of the plan's arcs", above=0.0, search=(0.15, 0.8))
    margin: float = gain(0.02, "m", "beside the hull, that the plan keeps", least=0.0, search=(0.005, 0.04))
    settling: float = gain(0.15, "m", "of way in which errors of the tracker decay", above=0.0, search=(0.08, 0.4))
    speed: float = gain(0.4, "m/s", "at most", above=0.0, search=(0.2, 0.6))
    deceleration: float = gain(0.4, "m/s^2", "no more than half of what the base can", above=0.0, search=(0.2, 0.8))
    arrival_radius: float = gain(
        0.02, "m", "within which it turns to the heading, or less if the goal asks for it", above=0.0
    )
    turn_gain: float = gain(2.0, "1/s", "of the turn at the goal", above=0.0)
    yaw_acceleration: float = gain(1.0, "rad/s^2", "of the turn at the goal; no more than the base can", above=0.0)
    max_yaw_rate: float = gain(1.2, "rad/s", "at most", above=0.0)

    knows: ClassVar[str] = "map"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the plans of each robot, MEMORY records (b,), none yet."""
        memory = np.zeros(briefing.num_envs, MEMORY)
        memory["stay"] = stay_radius(self.arrival_radius, briefing)
        return memory

    def paced(self, briefing: Briefing) -> dict[str, float]:
        """Returns what the law reads beside its gains."""
        return {
            **gentle(self, briefing),
            "preview": briefing.actuators.reaction + briefing.dt,
            "pause_steps": max(round(PAUSE / briefing.dt), 1),
        }

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        p = params(self, briefing, **self.paced(briefing))
        twists = np.empty((len(observation.pose), 2))
        map_ = Map.of(briefing)
        target = observation.goal, observation.goal_heading_error, observation.waypoints_left
        drive(p, map_, observation.pose, *target, memory, twists)
        return unicycle_twists(briefing.robot, twists[:, 0], twists[:, 1])


@any_layout
@compiled
def drive(params, map_, poses, goals, turns, waypoints_left, memory, twists):
    """Fills the (b, 2) speeds and yaw rates of `ReedsShepp.act` and keeps the memory up to date."""
    p = params[0]
    for i in range(poses.shape[0]):
        m = memory[i]
        now = m.steps * p.plant.dt
        m.steps += 1.0
        gx = goals[i, 0]
        gy = goals[i, 1]
        turn = bearing(gy, gx) if waypoints_left[i] > 0.0 else turns[i]
        if m.radius > 0.0 and is_elsewhere(m, poses, i, gx, gy):
            m.radius = 0.0
        ended = m.radius > 0.0 and m.length - m.along < GRAIN
        note_arrival(p, m, gx, gy)
        twists[i, 0] = 0.0
        if m.arrived == 1.0 and waypoints_left[i] == 0.0:
            twists[i, 1] = turn_rate(p, turn)
            continue
        twists[i, 1] = 0.0
        if m.radius == 0.0 or ended or not advance(m, poses, i):
            if m.no_path > 0 and m.steps % p.pause_steps != 0.0:
                continue
            without = m.no_path
            make_plan(p, map_, poses, (gx, gy, turn), m, i)
            if m.no_path > without:
                m.radius = 0.0  # it stands, rather than drive into what it knows of
                continue
        if not goes_on(p, map_, m, i, now, poses):
            continue
        twists[i, 0], twists[i, 1] = tracked(p, poses, m, i)


@inlined
def is_elsewhere(m, poses, i, gx, gy):
    """Returns whether the plan ends at another goal than (gx, gy) in the robot's frame, m: a waypoint was passed."""
    x, y, _ = pose_along(m.plan, m.radius, m.start, m.length)
    sine, cosine = sin_cos(poses[i, 2])
    dx = poses[i, 0] + cosine * gx - sine * gy - x
    dy = poses[i, 1] + sine * gx + cosine * gy - y
    return dx * dx + dy * dy > STRAY * STRAY


@inlined
def note_arrival(p, m, gx, gy):
    """Notes whether the robot is at its goal, (gx, gy) in its frame, m; see `arrival_radius` of `SmoothPose`."""
    # on the last piece backward the goal lies ahead of the robot's back
    way = -1.0 if m.radius > 0.0 and direction(m) < 0.0 else 1.0
    near = m.radius > 0.0 and m.length - m.along < m.stay
    m.arrived = (
        1.0
        if (m.arrived == 1.0 or near or gx * gx + gy * gy < GRAIN * GRAIN)
        and is_there(m.arrived == 1.0, way * gx, way * gy, p.arrival_radius, m.stay)
        else 0.0
    )


@compiled
def direction(m):
    """Returns 1 where the plan goes forward at the robot's place on it, -1 where backward, 0 at its end."""
    left = m.along / m.radius
    for k in range(PLAN):
        length = abs(m.plan[k, 1])
        if left < length - 1e-9:
            return math.copysign(1.0, m.plan[k, 1])
        left -= length
    return 0.0


@compiled
def curvature(m, s):
    """Returns the curvature (1/m) of the plan at arc length s, signed by the turn when driven forward."""
    left = s / m.radius
    bend = 0.0
    for k in range(PLAN):
        length = abs(m.plan[k, 1])
        if length > 1e-9:
            bend = m.plan[k, 0] / m.radius
        if left < length - 1e-9:
            break
        left -= length
    return bend


@compiled
def leg_end(m):
    """Returns the arc length (m) at which the direction changes next, or the plan ends."""
    way = direction(m)
    s = 0.0
    for k in range(PLAN):
        length = abs(m.plan[k, 1]) * m.radius
        if length > 1e-9:
            if s + length > m.along + 1e-9 and m.plan[k, 1] * way < 0.0:
                return s
            s += length
    return m.length


@compiled
def advance(m, poses, i):
    """Moves the robot's place on its plan on to the nearest one ahead; returns whether it is still near the plan."""
    end = leg_end(m)
    last = min(m.along + _WINDOW, end)
    best = np.inf
    s = m.along
    place = s
    while True:
        x, y, _ = pose_along(m.plan, m.radius, m.start, s)
        distance = (x - poses[i, 0]) ** 2 + (y - poses[i, 1]) ** 2
        if distance < best:
            best = distance
            place = s
        if s >= last:
            break
        s = min(s + GRAIN, last)
    m.along = place
    if end - place < 2.0 * GRAIN and end < m.length:
        m.along = end + 1e-6  # the next leg
    return best <= STRAY * STRAY


@allocating
def make_plan(p, map_, poses, goal, m, i):
    """Makes the plan of robot i anew, from where it is to the goal, a pose in its frame."""
    obstacles, counts = map_[:2]
    sine, cosine = sin_cos(poses[i, 2])
    at = np.empty(3)
    at[0] = poses[i, 0] + cosine * goal[0] - sine * goal[1]
    at[1] = poses[i, 1] + sine * goal[0] + cosine * goal[1]
    at[2] = poses[i, 2] + goal[2]
    standing = np.empty((1, obstacles.shape[1]), obstacles.dtype)
    count = 0
    for j in range(counts[i]):
        if not moves(obstacles[i, j]):
            standing[0, count] = obstacles[i, j]
            count += 1
    assign(m.start, poses[i])
    m.along = 0.0
    m.off = 0.0
    plan = np.empty((PLAN, 2))
    # nearer to what stands than the margin, at either end, one can but go away or dock
    room = min(
        clearance(standing[0], count, at[0], at[1]), clearance(standing[0], count, poses[i, 0], poses[i, 1])
    ) - p.plant.hull_radius  # fmt: skip
    frames = map_.frames[i : i + 1]
    if map_.cells.shape[0] > 0:
        room = min(room, grid_clearance(frames[0], map_.cells, at[0], at[1]) - p.plant.hull_radius)
        beside = grid_clearance(frames[0], map_.cells, poses[i, 0], poses[i, 1]) - p.plant.hull_radius
        room = min(room, beside)
    field = standing, count, frames, map_.cells
    for attempt in range(4):
        radius = p.radius if attempt % 2 == 0 else 0.5 * p.radius
        margin = min(p.margin, room - 0.02) if attempt < 2 else min(0.0, room - 0.02)
        best = np.inf
        for k in range(2 * _STRAIGHTS - 1):
            straight = _STRAIGHT_STEP * ((k + 1) // 2) * (1.0 if k % 2 else -1.0)
            length = plan_to(m.start, at, radius, straight, plan)
            needed = p.plant.hull_radius + margin
            if length < best and is_free(plan, radius, m.start, length, field, needed, (0.0, 1.0)):
                best = length
                assign(m.plan, plan)
        if best < np.inf:
            m.radius = radius
            m.length = best
            return
    m.no_path += 1
    m.radius = p.radius
    m.length = plan_to(m.start, at, p.radius, 0.0, m.plan)


@compiled
def goes_on(p, map_, m, i, now, poses):
    """Returns whether robot i sets off, or drives on: where what moves leaves it its way, or comes to where it is."""
    m.settling = p.settling
    if not any_moves(map_.obstacles, i, map_.counts[i]):
        return True
    # on a late base at twice the pace, for what leaves a gap does not for long
    late = max(p.preview - p.plant.dt, 1e-9)
    m.settling = max(p.settling, min(2.0 * p.settling, p.speed * late / _STEADY))
    if m.off == 0.0:
        m.begun = m.along
    if is_passable(p, map_, m, i, now):
        m.off = 1.0
    elif m.off == 1.0:
        # to stop takes it a little on
        for k in range(_STOOD):
            for j in range(map_.counts[i]):
                if moves(map_.obstacles[i, j]):
                    ox, oy, _, _ = motion_at(map_.obstacles[i, j], now + _LATE * k)
                    apart = math.sqrt((ox - poses[i, 0]) ** 2 + (oy - poses[i, 1]) ** 2)
                    if apart - map_.obstacles[i, j].radius < p.plant.hull_radius + 2.0 * _ROOM:
                        return True
        m.off = 0.0
    return m.off == 1.0


@compiled
def is_passable(p, map_, m, i, now):
    """Returns whether what moves leaves the robot the rest of its way, if it drives on now.

    The robot is taken to be at each place of its plan from a little before to a little after it should be, by the
    speeds of `tracked` and the same acceleration from where it set off.
    """
    obstacles, counts = map_[:2]
    needed = p.plant.hull_radius + _ROOM
    time = now + p.preview
    begun = m.begun
    s = m.along
    here = s
    last_end = leg_end(m)
    while s < m.length:
        m.along = s
        end = leg_end(m)
        if end > last_end:
            begun = s
            last_end = end
        x, y, _ = pose_along(m.plan, m.radius, m.start, s)
        for shift in (-_EARLY, 0.0, _LATE):
            for j in range(counts[i]):
                if moves(obstacles[i, j]):
                    ox, oy, _, _ = motion_at(obstacles[i, j], max(time + shift, now))
                    dx = ox - x
                    dy = oy - y
                    if math.sqrt(dx * dx + dy * dy) - obstacles[i, j].radius < needed:
                        m.along = here
                        return False
        v = min(wanted_speed(p, m, end), math.sqrt(2.0 * p.deceleration * (s - begun + _STRIDE)))
        time += _STRIDE / max(v, _LEAST_SPEED)
        s += _STRIDE
    m.along = here
    return True


@inlined
def wanted_speed(p, m, end):
    """Returns the speed (m/s) at the robot's place on a leg that ends at arc length `end`."""
    bend = abs(curvature(m, m.along))
    late = max(p.preview - p.plant.dt, 1e-9)
    steady = _STEADY * m.settling / late
    braking = min(p.deceleration, min(_OVER, 0.5 * m.stay) / (late * late))
    v = min(p.speed, steady, p.max_yaw_rate / max(bend, 1e-9), math.sqrt(2.0 * braking * (end - m.along)))
    return max(v, min(_LEAST_SPEED, 0.5 * m.stay / late))


@inlined
def tracked(p, poses, m, i):
    """Returns (v, w) along the plan."""
    way = direction(m)
    if way == 0.0:
        way = 1.0
    x, y, heading = pose_along(m.plan, m.radius, m.start, m.along)
    sine, cosine = sin_cos(heading)
    aside = cosine * (poses[i, 1] - y) - sine * (poses[i, 0] - x)
    off = wrap_angle(poses[i, 2] - heading)
    end = leg_end(m)
    v = wanted_speed(p, m, end)
    ahead = min(m.along + v * p.preview, end - 1e-6)
    w = way * v * curvature(m, ahead) - v * (2.0 * off / m.settling + way * aside / (m.settling * m.settling))
    share = min(1.0, p.max_yaw_rate / max(abs(w), 1e-12))
    return share * way * v, share * w
