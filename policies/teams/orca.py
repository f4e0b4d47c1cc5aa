"""Optimal reciprocal collision avoidance, with the whole duty of avoiding on the robot's side."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.crowds.half_planes import best_velocity, disc_half_plane
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.geometry import nearest_surface
from wayfield.envs.world.grids import grid_clearance, grid_normal, grid_place, grid_ray
from wayfield.envs.world.movers import motion_at, moves
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.polyline_tracker import clearance_at, point_at, project
from wayfield.policies.parts.steering import Map
from wayfield.policies.parts.stopping import Seen
from wayfield.policies.poses.astar_tracker import lay_grid, memory_of, plan_with_room
from wayfield.system.checks import LAST_SEED
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import bearing, logarithm, sin_cos

LOOKS = (3.0, 2.0, 1.4, 1.0, 0.7, 0.5, 0.35)  # m along the way, tried as the point to drive at, the farthest first
LOOKS_AROUND = 24  # directions in which a grid is looked at
STRIDE = 0.05  # m, between the places at which a straight line is looked along
ASTRAY = 0.5  # m, off the way, from which on it is planned anew


@dataclasses.dataclass(frozen=True)
class Orca(GoalLaw):
    """Drives the velocity nearest to the wanted one that keeps clear of every obstacle for a time ahead.

    With p the way to a disc's centre, R the sum of the radii, v_o its velocity, and the velocity obstacle

        VO = {v: |p - (v - v_o) t| < R for some t in (0, horizon]}

    the half-plane of a disc is n . v >= b, tangent to VO at the boundary point nearest to the robot's velocity: the
    robot takes all of the change, since the others do not react. Walls and boxes, standing or moving, allow

        n . (v - v_o) >= -(D - R) / wall_horizon

    with D the distance to the nearest point of the surface and n the direction away from it, which is the half-plane of
    a standing obstacle tangent nearest to standstill. A convex obstacle lies behind the tangent at its nearest point:
    what keeps these half-planes for the time ahead keeps clear, and standstill keeps those of all that stands. The
    velocity driven solves

        min |v - u|  subject to  n_j . v >= b_j,  |v| <= max_speed,   u = max_speed or k |e| along the way to the goal

    by incremental linear programming in the order of the obstacles, what stands first. When no velocity keeps every
    half-plane, those of what moves are moved outwards by the least common violation, by linear programming in three
    dimensions; those of what stands are never given up, since standstill keeps them. What moves and is nearer than R is
    left at (R - D) / recovery. The wanted velocity u is turned by `perturbation`, to a side that `seed` fixes, lest the
    robot stop in front of a disc on its line.

    A differential drive cannot take up a velocity at once. It turns towards it at turn_gain times the angle in between,
    which leads it off the way of a holonomic robot by |v| f(angle) / turn_gain; R is enlarged by `tracking_error`, and
    speed is held down to where the bound is not above that (Alonso-Mora et al., who bound a different tracking law).
    Until it has turned it drives where it looks, at no more than (D - R) / wall_horizon towards what stands, R not
    enlarged.

    The way is a shortest one around what stands, by Theta* on the map and bent towards `wanted_clearance` like that of
    the A* tracker; u points at the farthest place on it, up to 3 m on, that the robot sees in a straight line with room
    for its hull, as agents of RVO2 steer for the vertices of their roadmap, and |e| is the length of the way left. Half
    a metre off it the robot plans anew. With `roadmap` off u points straight at the goal: the law without a memory,
    which dead ends hold. The others' motion is no part of the way.

    It knows the map and the motion of all that moves, and takes of it what is within `sensing_radius`: perception is
    perfect, where scans would have to be clustered and tracked. Velocities are taken to last: where a patrol turns back
    is not foreseen. Two discs too near each other hold it, and so does a door that leaves the enlarged R no room; a
    differential drive can be run into while it still turns. Both kinds of robot; within `arrival_radius` of the goal a
    differential drive turns to the goal heading, unless it has to give way.

    Source: van den Berg, Guy, Lin and Manocha, Reciprocal n-body collision avoidance, ISRR 2009 (STAR 70, 2011), and
    the roadmap example of their library RVO2;
    Alonso-Mora, Breitenmoser, Rufli, Beardsley and Siegwart, DARS 2010 (STAR 83, 2013).
    """

    horizon: float = gain(2.0, "s", "in which no disc is met", above=0.0, search=(0.5, 4.0))
    wall_horizon: float = gain(0.5, "s", "in which no wall or box is met", above=0.0, search=(0.1, 2.0))
    recovery: float = gain(0.5, "s", "in which what moves and is too near is left", above=0.0)
    sensing_radius: float = gain(5.0, "m", "within which obstacles count", above=0.0)
    margin: float = gain(0.05, "m", "kept between hull and obstacles", least=0.0, search=(0.01, 0.1))
    max_speed: float = gain(0.6, "m/s", "at most", above=0.0)
    k: float = gain(1.0, "1/s", "speed per metre from the goal", above=0.0)
    perturbation: float = gain(0.1, "rad", "of the wanted velocity", least=0.0)
    tracking_error: float = gain(0.05, "m", "of a differential drive", least=0.0, search=(0.01, 0.1))
    turn_gain: float = gain(3.0, "1/s", "yaw rate per radian", above=0.0)
    max_yaw_rate: float = gain(0.5, "rad/s", "of an omni base's turn, which bends its velocity by the lag", above=0.0)
    arrival_radius: float = gain(0.05, "m", "from the goal, within which it turns to the heading", least=0.0)
    roadmap: bool = gain(True, "", "whether the wanted velocity points along a way around what stands")
    cell: float = gain(0.05, "m", "of the grid of that way", above=0.0)
    wanted_clearance: float = gain(0.2, "m", "beside the hull, towards which the way is bent", least=0.0)
    surroundings: float = gain(8.0, "m", "around start, goals and robot, of obstacles that the grid holds", above=0.0)
    seed: int = gain(0, "1", "of the law's own random numbers", most=LAST_SEED)

    knows: ClassVar[str] = "map"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns `memory_of` records (b,): the number of decisions, which tells where things move to, and its way."""
        return np.zeros(briefing.num_envs, memory_of(briefing, []))

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s."""
        robot = briefing.robot
        side = 1.0 if np.random.default_rng(self.seed).random() < 0.5 else -1.0
        p = params(
            self,
            briefing,
            tracking_error=0.0 if robot.holonomic else self.tracking_error,
            perturbation=side * self.perturbation,
            theta=True,  # these four are the planner's, see `plan_way`
            snap=0.3,
            spacing=2.0,
            rounds=60,
        )
        twists = np.empty((len(memory), 3))
        decide(p, Map.of(briefing), Seen.of(observation, briefing), memory, twists)
        return twists[:, robot.twist_axes]


@compiled
def tracking_drift(angle):
    """Returns by how many metres, at a speed of 1 m/s and a turn gain of 1/s, the tracking law leaves the wanted way.

    While the angle e >= 0 decays exponentially the robot drives cos e of the speed: the drift is the integral of
    (1 - cos^2 e, cos e sin e) de / e from 0 to the angle, to 3 % for angles up to a quarter turn, above which the robot
    turns on the spot and lags by the whole way.
    """
    e = min(angle, 0.5 * math.pi)
    z = e * e
    along = 0.5 * z * (1.0 - z / 6.0 + z * z / 67.5) + logarithm(max(angle / (0.5 * math.pi), 1.0))
    across = e * (1.0 - 2.0 * z / 9.0 + 2.0 * z * z / 75.0)
    return math.sqrt(along * along + across * across)


@any_layout
@allocating
def decide(params, map_, seen, memory, twists):
    """Fills the (b, 3) twists of `Orca`, m/s and rad/s.

    Beside the gains: `perturbation` with its side, and `tracking_error` 0 for an omni base.
    """
    p = params[0]
    most = most_lines(map_)
    lines = np.empty((most, 3))
    scratch = np.empty((most, 3))
    forward = np.empty(twists.shape[0])
    for i in range(twists.shape[0]):
        m = memory[i]
        total, hard = fill_lines(p, map_, seen.poses, seen.twists, i, m.steps * p.plant.dt, lines, forward)
        wanted_x, wanted_y = wanted(p, m, map_, seen, i)
        ux, uy = best_velocity(lines, total, hard, p.max_speed, wanted_x, wanted_y, scratch)
        m.steps += 1
        sine, cosine = sin_cos(seen.poses[i, 2])
        twists[i, 0], twists[i, 1], twists[i, 2] = followed(
            p, seen, i, cosine * ux + sine * uy, cosine * uy - sine * ux, forward[i]
        )


@inlined
def most_lines(map_):
    """Returns how many half-planes `fill_lines` leaves at most."""
    return map_.obstacles.shape[1] + (1 + LOOKS_AROUND if map_.cells.shape[0] > 0 else 0)


@inlined
def followed(p, seen, i, ux, uy, forward):
    """Returns the twist by which robot i drives a velocity (ux, uy), body frame, m/s; forward: m/s free ahead.

    An omni base drives it as it is. A differential drive turns towards it, and drives forward with what lies ahead and
    the bound on the tracking error leaves of the speed at this angle, as `velocity_twists` has it.
    """
    turn = seen.heading_errors[i]
    if p.plant.holonomic == 1:
        most = p.max_yaw_rate / p.turn_gain
        return ux, uy, p.turn_gain * min(max(turn, -most), most)
    speed = math.sqrt(ux * ux + uy * uy)
    distance = math.sqrt(seen.goals[i, 0] * seen.goals[i, 0] + seen.goals[i, 1] * seen.goals[i, 1])
    # unless something drives it away
    rests = distance <= p.arrival_radius and seen.waypoints_left[i] < 0.5 and speed <= p.k * p.arrival_radius
    angle = bearing(uy, ux) if speed >= 1e-9 else 0.0
    drift = speed * tracking_drift(abs(angle)) / p.turn_gain
    share = min(1.0, p.tracking_error / max(drift, 1e-12))
    ahead = min(max(share * ux, 0.0), forward)
    return 0.0 if rests else ahead, 0.0, p.turn_gain * (turn if rests else angle)


# The way around what stands.


@compiled
def wanted(p, m, map_, seen, i):
    """Returns the velocity (m/s, world frame) that robot i would drive were it alone."""
    sine, cosine = sin_cos(seen.poses[i, 2])
    # where to, and how far that way is
    to_x = cosine * seen.goals[i, 0] - sine * seen.goals[i, 1]
    to_y = sine * seen.goals[i, 0] + cosine * seen.goals[i, 1]
    way = math.sqrt(to_x**2 + to_y**2)
    if p.roadmap:
        to_x, to_y, way = along_the_way(p, m, map_, i, seen.poses, seen.waypoints_left[i], to_x, to_y)
    speed = min(p.k * way, p.max_speed) / max(math.sqrt(to_x**2 + to_y**2), 1e-12)
    turn_s, turn_c = sin_cos(p.perturbation * min(way, 1.0))
    return speed * (turn_c * to_x - turn_s * to_y), speed * (turn_s * to_x + turn_c * to_y)


@compiled
def along_the_way(p, m, map_, i, poses, waypoints_left, goal_x, goal_y):
    """Returns (x, y, length): from robot i to the place on its way that it drives at, and the way left, m, world frame.

    Plans the way where there is none to the next goal yet, or the robot has left it. goal_x, goal_y: from the robot to
    the goal, which it drives at where there is no way.
    """
    x = poses[i, 0]
    y = poses[i, 1]
    nth = min(max(map_.num_goals[i] - 1 - int(waypoints_left), 0), map_.num_goals[i] - 1)
    stops = map_.goals[i, nth : nth + 1, :2]
    due = m.plans == 0 or m.planned_at != nth
    s = 0.0
    if m.num_points > 0 and not due:
        s, away, _ = project(m, x, y)
        due = away > ASTRAY
    if due:
        if m.plans == 0:
            lay_grid(p, m, map_, i, x, y)
        m.plans += 1
        m.planned_at = nth
        m.no_path = 0 if plan_with_room(p, m, x, y, stops) else 1
        if m.no_path == 1:
            m.num_points = 0
        s = 0.0
    if m.num_points == 0:
        return goal_x, goal_y, math.sqrt(goal_x * goal_x + goal_y * goal_y)
    to_x = goal_x
    to_y = goal_y
    for k in range(len(LOOKS)):
        ahead_x, ahead_y = point_at(m, m.segment, s + LOOKS[k])
        to_x = ahead_x - x
        to_y = ahead_y - y
        if in_sight(p, m, x, y, to_x, to_y):
            break
    left = max(m.arc[m.num_points - 1] - s, 0.0)
    return to_x, to_y, max(left, math.sqrt(to_x * to_x + to_y * to_y))


@inlined
def in_sight(p, m, x, y, dx, dy):
    """Returns whether the hull fits along the line from (x, y) over (dx, dy), m; it may leave a tight place."""
    needed = min(p.plant.hull_radius + 0.5 * p.margin, clearance_at(m, x, y) - 0.5 * m.cell)
    steps = math.ceil(math.sqrt(dx * dx + dy * dy) / STRIDE)
    free = True
    for n in range(1, steps + 1):
        free = free and clearance_at(m, x + n / steps * dx, y + n / steps * dy) >= needed
    return free


@inlined
def fill_lines(p, map_, poses, measured, i, time, lines, forward):
    """Fills the half-planes of robot i, rows (nx, ny, b) in the world frame, and the speed at which it may drive ahead.

    Returns how many they are, and how many of them belong to what stands: these come first, since standstill keeps
    them, and they are never given up.
    """
    room = p.plant.hull_radius + p.margin
    radius = room + p.tracking_error
    x = poses[i, 0]
    y = poses[i, 1]
    sine, cosine = sin_cos(poses[i, 2])
    vx = cosine * measured[i, 0] - sine * measured[i, 1]
    vy = sine * measured[i, 0] + cosine * measured[i, 1]
    total = 0
    hard = 0
    forward[i] = p.max_speed
    for kind in range(2):
        for j in range(map_.counts[i]):
            obstacle = map_.obstacles[i, j]
            moving = moves(obstacle)
            if moving != (kind == 1):
                continue
            # seen from where the obstacle is now, the robot is moved instead
            ox = 0.0
            oy = 0.0
            o_vx = 0.0
            o_vy = 0.0
            if moving:
                now_x, now_y, o_vx, o_vy = motion_at(obstacle, time)
                ox = now_x - obstacle.x
                oy = now_y - obstacle.y
            distance, near_x, near_y = nearest_surface(obstacle, x - ox, y - oy)
            if distance > p.sensing_radius:
                continue
            if obstacle.half_length == 0.0 and obstacle.half_width == 0.0:
                px = obstacle.x + ox - x
                py = obstacle.y + oy - y
                reach = obstacle.radius + radius
                nx, ny, b = disc_half_plane(px, py, reach, vx - o_vx, vy - o_vy, p.horizon, p.recovery)
            else:
                nx = near_x
                ny = near_y
                b = (radius - distance) / (p.wall_horizon if distance > radius else p.recovery)
            if not moving:
                b = min(b, 0.0)
                ahead = -(near_x * cosine + near_y * sine)
                if ahead > 0.0:
                    forward[i] = min(forward[i], max(distance - room, 0.0) / (p.wall_horizon * ahead))
            lines[total, 0] = nx
            lines[total, 1] = ny
            lines[total, 2] = b + nx * o_vx + ny * o_vy
            total += 1
        if kind == 0:
            if map_.cells.shape[0] > 0:
                total = fill_grid_lines(p, map_, (x, y, sine, cosine), (vx, vy), i, lines, total, forward)
            hard = total
    return total, hard


@compiled
def fill_grid_lines(p, map_, at, velocity, i, lines, total, forward):
    """Fills the half-planes that the grid leaves robot i behind `total` others; returns how many there are then.

    The nearest place that is occupied counts as a wall, and what is seen in some directions around as points.

    Args:
        at: x, y (m), sine and cosine of the heading.
        velocity: m/s, world frame.
    """
    x, y, sine, cosine = at
    frame = map_.frames[i]
    room = p.plant.hull_radius + p.margin
    radius = room + p.tracking_error
    distance = grid_clearance(frame, map_.cells, x, y)
    if distance > p.sensing_radius:
        return total
    nx, ny = grid_normal(frame, map_.cells, x, y)
    lines[total, 0] = nx
    lines[total, 1] = ny
    lines[total, 2] = min((radius - distance) / (p.wall_horizon if distance > radius else p.recovery), 0.0)
    total += 1
    ahead = -(nx * cosine + ny * sine)
    if ahead > 0.0:
        forward[i] = min(forward[i], max(distance - room, 0.0) / (p.wall_horizon * ahead))
    u, v = grid_place(frame, x, y)
    reach = p.sensing_radius / frame.grid_cell
    for k in range(LOOKS_AROUND):
        uy, ux = sin_cos(2.0 * math.pi * k / LOOKS_AROUND)
        du = frame.grid_cos * ux + frame.grid_sin * uy
        dv = frame.grid_cos * uy - frame.grid_sin * ux
        seen = grid_ray(frame, map_.cells, u, v, du, dv, reach)
        if seen >= reach:
            continue
        away = seen * frame.grid_cell
        nx, ny, b = disc_half_plane(
            away * ux, away * uy, radius, velocity[0], velocity[1], p.horizon, p.recovery
        )  # fmt: skip
        lines[total, 0] = nx
        lines[total, 1] = ny
        lines[total, 2] = min(b, 0.0)
        total += 1
        ahead = ux * cosine + uy * sine
        if ahead > 0.0:
            forward[i] = min(forward[i], max(away - room, 0.0) / (p.wall_horizon * ahead))
    return total
