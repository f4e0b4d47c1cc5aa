"""Reciprocal collision avoidance among robots and people that are tracked: every robot takes half of the change."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import team_worlds
from wayfield.envs.crowds.half_planes import best_velocity, shared_half_plane
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import CrowdLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.policy import check_scan
from wayfield.policies.parts.steering import driven_by_point, point_ahead
from wayfield.system.compiled import allocating, any_layout, compiled
from wayfield.system.elementary import sin_cos

_STANDS_BELOW = 0.01  # m/s
_ON_A_BODY = 0.1  # m, about a body's hull, within which a beam ends at it
_TURNED = 2.0  # s, for which the wanted velocity of who is stuck stays turned
_AWAY = 4.0  # s, for which who gives way stays away, times how often
_ALIKE = 1e-5  # m, between distances that count as equal: what is seen has single precision
_SLOWER = 0.03
_BLOCKS = 0.6  # m between hulls, within which a robot ahead is in the way

MEMORY = np.dtype(
    [
        ("x", np.float64),  # m, where it was when it last got on
        ("y", np.float64),
        ("waited", np.float64),  # s, since then
        ("turned", np.float64),  # s, for which the wanted velocity stays turned
        ("times", np.int64),  # in a row that it was stuck
        ("begun", np.int64),
        ("pace", np.float64),  # share of the speed that it drives, of `pace`; 0: not known yet
        ("yields", np.int64),  # 1: it gives way while turned; -1: another does, and it goes straight on
    ],
    align=True,
)


@dataclasses.dataclass(frozen=True)
class OrcaTeam(CrowdLaw):
    """Drives the velocity nearest to the wanted one that keeps clear of tracked bodies and of what the scan meets.

    Each tracked body leaves the half-plane of optimal reciprocal collision avoidance, of which the robot takes `share`
    of the change of velocity among robots, `people_share` among people, and all of it against what stands. What beams
    meet that is no tracked body leaves n . v >= -(D - R) / wall_horizon. The velocity solves

        min |v - u|  subject to  n_j . v >= b_j,  |v| <= max_speed,   u = max_speed or k |e| towards the goal

    by incremental linear programming, the half-planes of what stands first; these are never given up.

    A differential drive is driven by a point `ahead` (L) of the axle, which can take up any velocity u:

        v = u_x,  w = u_y / L,  both scaled by one factor where |w| is too large,

    with a disc of R + L about that point; a bound on the tracking error instead freezes from eight robots on a circle.
    Where all are symmetric, no robot would ever move on: u is turned to the right by `turn`, for everybody; and by
    `stuck_turn` for 2 s once it has not come 0.1 m on for `patience`, by twice that the next time, and so on up to
    `most_turn`: so a robot jammed in a ring goes round it. Two who meet in a door would turn aside for ever: with
    `back_off`, one who is stuck behind a tracked robot gives way if it comes before that in the order of (x, y), which
    needs no word between them: it goes back by `back_off` and stays away for 4 s, the next time for twice both, and so
    on, while the other does not turn. Where the nearest two are equally far when they are first seen, as on a circle, a
    robot drives slower by 3 % for each of them that comes before it in that order: who all do the same, jam or touch.

    It has access to bodies, not to a map: it stops in dead ends. Velocities are taken to last. The point's guarantee is
    lost while |w| saturates: of exactly symmetric circles of 4 m, differential drives solve those of up
    to 16, and touch each other in denser ones; moved by up to 0.5 m, circles of 32 are solved.

    Source: van den Berg, Guy, Lin and Manocha, ISRR 2009 (STAR 70, 2011); the effective centre: Snape, van den Berg,
    Guy and Manocha, IROS 2010.
    """

    horizon: float = gain(3.0, "s", "in which no body is met", above=0.0, search=(0.5, 16.0))
    wall_horizon: float = gain(0.5, "s", "in which nothing that stands is met", above=0.0, search=(0.2, 2.0))
    margin: float = gain(0.05, "m", "kept between hulls", least=0.0, search=(0.0, 0.3))
    wall_margin: float = gain(0.02, "m", "kept between hull and walls", least=0.0)
    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    k: float = gain(1.0, "1/s", "speed per metre from the goal", above=0.0, search=(0.5, 4.0))
    ahead: float = gain(0.15, "m", "of the axle, of the point that a differential drive is driven by", above=0.0)
    share: float = gain(0.5, "1", "of the change of velocity, among robots", above=0.0, most=1.0)
    people_share: float = gain(
        1.0, "1", "of the change of velocity, among people", above=0.0, most=1.0, search=(0.3, 1.0)
    )
    turn: float = gain(0.05, "rad", "to the right, of the wanted velocity", least=0.0, search=(0.0, 0.2))
    stuck_turn: float = gain(0.6, "rad", "to the right, of the wanted velocity of who is stuck", least=0.0)
    most_turn: float = gain(1.8, "rad", "at most, of who is stuck time and again", least=0.0)
    patience: float = gain(3.0, "s", "after which who does not get on is stuck", above=0.0, search=(1.0, 6.0))
    back_off: float = gain(
        0.0, "m", "back, of who gives way to a robot that it is stuck behind; 0: nobody", least=0.0, search=(0.0, 1.0)
    )

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns MEMORY records (b,)."""
        return np.zeros(briefing.num_envs, MEMORY)

    def act(
        self, observation: team_worlds.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s."""
        return self.keep_clear(observation, briefing, self.wanted(observation, briefing, memory))

    def wanted(
        self, observation: team_worlds.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the velocities (b, 2) that it would drive were it alone, m/s, body frame."""
        out = np.empty((len(memory), 2))
        seen = (observation.pose, observation.goal, observation.bodies)
        want(params(self, briefing), *map(np.ascontiguousarray, seen), memory, out)
        return out

    def keep_clear(
        self, observation: team_worlds.Observation, briefing: Briefing, wanted: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s, of the velocities nearest to wanted ones (b, 2) that keep clear."""
        if len(briefing.beam_angles):
            check_scan(self, observation.ranges, briefing)
        robot = briefing.robot
        twist = np.zeros((len(wanted), 3))
        twist[:, [0, 2] if not robot.holonomic else [0, 1, 2]] = observation.twist
        beams = np.column_stack([np.cos(briefing.beam_angles), np.sin(briefing.beam_angles)])
        p = params(self, briefing, **point_ahead(self, briefing))
        out = np.zeros((len(wanted), len(robot.twist_axes)))
        arrays = (twist, observation.bodies, observation.ranges, beams, wanted)
        avoid(p, *map(np.ascontiguousarray, arrays), out)
        return out


@any_layout
@compiled
def want(params, poses, goals, bodies, memory, out):
    """Fills the (b, 2) velocities of `OrcaTeam.wanted`."""
    p = params[0]
    for i in range(poses.shape[0]):
        m = memory[i]
        dx = poses[i, 0] - m.x
        dy = poses[i, 1] - m.y
        if m.begun == 0 or dx * dx + dy * dy > 0.01:
            m.begun = 1
            m.x = poses[i, 0]
            m.y = poses[i, 1]
            m.waited = 0.0
            if m.turned == 0.0:
                m.times = 0
        m.waited += p.plant.dt
        m.turned = max(m.turned - p.plant.dt, 0.0)
        if m.turned > 0.0 and m.yields == 1:
            m.waited = 0.0  # it stands of its own will
        if m.waited > p.patience:
            m.waited = 0.0
            m.turned = _TURNED
            m.times += 1
            m.yields = order_at_door(p, poses[i], goals[i], bodies[i]) if p.back_off > 0.0 else 0
            if m.yields == 1:
                m.turned = _AWAY * m.times
        aside = min(p.stuck_turn * m.times, p.most_turn)
        sine, cosine = sin_cos(-(aside if m.turned > 0.0 and m.yields == 0 else p.turn))
        distance = math.sqrt(goals[i, 0] * goals[i, 0] + goals[i, 1] * goals[i, 1])
        if m.pace == 0.0:
            m.pace = pace(poses[i], bodies[i])
        speed = (m.pace if m.pace > 0.0 else 1.0) * min(p.k * distance, p.max_speed) / max(distance, 1e-12)
        if m.turned > 0.0 and m.yields == 1:
            # backwards as far as it shall, then it stands
            going = _AWAY * m.times - m.turned < p.back_off * m.times / p.max_speed
            speed = -p.max_speed / max(distance, 1e-12) if going else 0.0
        out[i, 0] = speed * (cosine * goals[i, 0] - sine * goals[i, 1])
        out[i, 1] = speed * (sine * goals[i, 0] + cosine * goals[i, 1])


@compiled
def pace(pose, bodies):
    """Returns the share of its speed at which a robot drives that sees the first two others; 0 while it does not.

    It is 1 unless the two are equally far, as on a circle: then less by `_SLOWER` for each that comes before the robot
    in the order of (x, y), so that they do not all do the same.
    """
    if bodies.shape[0] < 2 or bodies[1, 6] < 0.5:
        return 0.0
    sine, cosine = sin_cos(pose[2])
    share = 1.0
    for j in range(2):
        x = bodies[j, 0]
        y = bodies[j, 1]
        dx = cosine * x - sine * y
        dy = sine * x + cosine * y
        share -= _SLOWER if dx < 0.0 or (dx == 0.0 and dy < 0.0) else 0.0
    apart = math.sqrt(bodies[0, 0] ** 2 + bodies[0, 1] ** 2) - math.sqrt(bodies[1, 0] ** 2 + bodies[1, 1] ** 2)
    return share if abs(apart) < _ALIKE else 1.0


@compiled
def order_at_door(p, pose, goal, bodies):
    """Returns 1 if a robot gives way to the nearest one before it, -1 if that one does, 0 if there is none near.

    Both see the same two places, so that they agree without a word: the first in the order of (x, y) gives way.
    """
    nearest = 2.0 * p.plant.hull_radius + _BLOCKS
    order = 0
    sine, cosine = sin_cos(pose[2])
    for j in range(bodies.shape[0]):
        x = bodies[j, 0]
        y = bodies[j, 1]
        distance = math.sqrt(x * x + y * y)
        is_robot = bodies[j, 6] > 0.5 and bodies[j, 5] < 1.5
        if is_robot and distance < nearest and x * goal[0] + y * goal[1] > 0.0:
            nearest = distance
            dx = cosine * x - sine * y
            dy = sine * x + cosine * y
            order = 1 if dx > 0.0 or (dx == 0.0 and dy > 0.0) else -1
    return order


@any_layout
@allocating
def avoid(params, measured, bodies, ranges, beams, wanted, out):
    """Fills the (b, t) twists of `OrcaTeam.keep_clear`."""
    p = params[0]
    lines = np.empty((bodies.shape[1] + ranges.shape[1], 3))
    scratch = np.empty(lines.shape)
    for i in range(measured.shape[0]):
        total, hard = fill_lines(p, measured, bodies, ranges, beams, i, lines)
        ux, uy = best_velocity(lines, total, hard, p.max_speed, wanted[i, 0], wanted[i, 1], scratch)
        out[i, 0], out[i, 1] = driven_by_point(p, ux, uy)


@compiled
def fill_lines(p, twists, bodies, ranges, beams, i, lines):
    """Fills the half-planes of robot i, rows (nx, ny, b) in the body frame, of the point that is driven.

    Returns how many they are, and how many of them, the first, belong to what stands: these are never given up.
    """
    num_bodies = bodies.shape[1]
    ahead = p.ahead
    radius = p.plant.hull_radius + ahead
    own = (twists[i, 0], twists[i, 1] + ahead * twists[i, 2])
    total = 0
    for k in range(ranges.shape[1]):
        distance = ranges[i, k]
        if distance >= p.max_range:
            continue
        x = distance * beams[k, 0]
        y = distance * beams[k, 1]
        tracked = False
        for j in range(num_bodies):
            if bodies[i, j, 6] > 0.5:
                dx = x - bodies[i, j, 0]
                dy = y - bodies[i, j, 1]
                reach = bodies[i, j, 4] + _ON_A_BODY
                tracked = tracked or dx * dx + dy * dy < reach * reach
        away = math.sqrt((x - ahead) * (x - ahead) + y * y)
        if tracked or away > radius + p.wall_margin + 2.0 * p.max_speed * p.wall_horizon or away < 1e-9:
            continue
        lines[total, 0] = (ahead - x) / away
        lines[total, 1] = -y / away
        lines[total, 2] = min(-(away - radius - p.wall_margin) / p.wall_horizon, 0.0)
        total += 1
    hard = total
    for j in range(num_bodies):
        if bodies[i, j, 6] < 0.5:
            continue
        vx = bodies[i, j, 2]
        vy = bodies[i, j, 3]
        speed = math.sqrt(vx * vx + vy * vy)
        x = bodies[i, j, 0] - ahead
        y = bodies[i, j, 1]
        reach = radius + bodies[i, j, 4] + 2.0 * p.margin
        is_robot = bodies[i, j, 5] < 1.5
        share = p.share if is_robot else p.people_share
        if is_robot:
            reach += ahead  # it swings about its axle as this one does
        if speed < _STANDS_BELOW:
            share = 1.0
        lines[total, 0], lines[total, 1], lines[total, 2] = shared_half_plane(
            x, y, reach, own, (vx, vy), p.horizon, 0.5, share
        )
        total += 1
    return total, hard
