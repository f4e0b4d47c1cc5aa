"""The pymunk plant: a rigid body on wheels that can slip, among things that stop it or can be pushed.

A control period is cut into sub-steps. In each, the motors turn the wheels, the floor pulls the body after
them with no more than friction allows, and pymunk resolves the contacts. Two short cuts cost no accuracy and
save nearly all of the time: a robot that slips nowhere and can reach nothing in the period moves as the
kinematic plant's, on the same arc; and pymunk runs only in the sub-steps that end in contact, or while
something pushed still moves.
"""

import array
import math
from typing import Any, NamedTuple

import numpy as np
import pymunk
from numpy.typing import NDArray

from wayfield.envs.robots import Robot
from wayfield.envs.robots.hulls import hull_clearance, swing, touched, way_out
from wayfield.envs.robots.kinematic_plant import body_twist, lagging_twist
from wayfield.envs.robots.kinematics import integrate_arc, sinc
from wayfield.envs.robots.records import (
    MAX_WHEELS,
    ROBOT_PARAMS,
    ROBOT_STATE,
    Array,
    Flags,
    Records,
    lag_factors,
    part_of,
    record,
)
from wayfield.envs.robots.response import respond
from wayfield.envs.robots.sensing import advance_odometry
from wayfield.envs.tasks.stepping import Robots
from wayfield.envs.tasks.task import Options, Task
from wayfield.envs.world.geometry import clearance_to, nearest_surface
from wayfield.envs.world.grids import FRAME, Grids, OccupancyGrid, grid_clearance, grid_normal
from wayfield.envs.world.movers import go_on, motion_at, moves
from wayfield.system.compiled import allocating, any_layout, compiled, machine_code
from wayfield.system.elementary import bearing, sin_cos, wrap_angle
from wayfield.system.linear import pseudo_inverse

GRAVITY = 9.81  # m/s^2
HULL_FRICTION = 0.5  # between the hull and what it touches
FLOOR_FRICTION = 0.4  # under a pushed thing: cardboard on a smooth floor

# 10 ms, as `robots.SUBSTEP`: the fastest omni base (17 m/s, tier "ideal") goes 0.17 m, less than its hull's
# radius, so that its centre cannot get through a wall; data sheets of faster robots are refused. While wheels slip
# under full-speed jumps of the command, halving it moves a robot by up to 3 mm in a second; while they grip, not
# at all.
SUBSTEPS = 5

# Overlap in which a contact is kept, so that pymunk sees it. pymunk does not push apart what overlaps by less
# than the slop; a deeper overlap (a shove, a pushed thing in a corner) shrinks by a fifth at every sub-step.
DEPTH = 1e-5  # m
SLOP = 2e-5  # m
OVERLAP_LEFT = 0.8

ITERATIONS = 30  # of pymunk's solver: enough for a heavy box that the floor holds against a light robot

# What can be pushed and is thinner than THIN is squeezed through a wall by a robot that pushes it there, unless pymunk
# takes shorter steps: 6 for a thickness of 0.08 m, 50 for 0.01 m.
THIN = 0.1  # m
CUTS_BY_THICKNESS = 0.5  # m

NEAR = 0.02  # m, around what moves: cells of a grid are put into the space before they are touched

# Relaxation of sliding wheels: it ends when no impulse changes by more than this share of the largest. An
# omni base takes at most 60 sweeps, a differential drive 100 in 99 of 100 cases; cut off, it is 2e-5 m/s off
# at worst.
MAX_SWEEPS = 200
RELAXED = 1e-14
GRIPPED = 1e-12  # m/s and rad/s: a wheel that slips less than this rolls
AT_REST = 1e-6  # m/s and rad/s: something pushed that is slower than this lies still

BASE = [
    ("mass", np.float64),  # kg
    ("inertia", np.float64),  # kg m^2
    ("wheels", np.int64),
    # twist to the speed over the floor along and across each wheel
    ("directions", np.float64, (MAX_WHEELS, 2, 3)),
    # momentum to the least impulses that give it: the pseudo-inverse
    ("spread", np.float64, (MAX_WHEELS, 2, 3)),
    ("relaxation", np.float64, (MAX_WHEELS,)),  # kg, mass that a wheel feels at its contact point
    ("traction", np.float64),  # N, the most that one wheel can pull
    ("substep", np.float64),  # s
    ("lag_decay", np.float64),  # of the wheels, over a sub-step
    ("lag_mean", np.float64),
]

# Where a robot is within its control period.
PROGRESS = np.dtype(
    [
        ("substep", np.int64),  # how many are over
        # twists of a body that the wheels take along: at the beginning of the sub-step
        ("from_vx", np.float64),
        ("from_vy", np.float64),
        ("from_yaw_rate", np.float64),
        ("mean_vx", np.float64),  # on average over it
        ("mean_vy", np.float64),
        ("mean_yaw_rate", np.float64),
        ("to_vx", np.float64),  # at its end
        ("to_vy", np.float64),
        ("to_yaw_rate", np.float64),
        ("rolled_vx", np.float64),  # twist that the wheels turn for on average over the period
        ("rolled_vy", np.float64),
        ("rolled_yaw_rate", np.float64),
        ("start_x", np.float64),  # pose at the beginning of the period
        ("start_y", np.float64),
        ("start_heading", np.float64),
        ("clearance", np.float64),  # m, at most the true one
        ("pushing", np.int64),  # 1 while something pushed moves
    ],
    align=True,
)

# A dynamic body as pymunk has it; for an obstacle that is fixed the record stays zero.
BODY = np.dtype([(name, np.float64) for name in ("x", "y", "angle", "vx", "vy", "yaw_rate")])


def base_record(robot: Robot, options: Options) -> NDArray[np.void]:
    """Returns the BASE record of a robot: how its wheels hold on to the floor."""
    along = np.zeros((MAX_WHEELS, 2, 3))
    count = len(robot.wheel_positions)
    # a wheel pulls along the axis of the roller on the floor, which turns freely across it
    held = [wheel.radius * sin_cos(wheel.roller_angle)[1] for wheel in robot.wheels]
    along[:count, 0] = robot.wheel_matrix * np.reshape(held, (-1, 1))
    if not robot.holonomic:
        # a plain wheel holds across its drive direction too
        for i, ((px, py), angle) in enumerate(zip(robot.wheel_positions, robot.wheel_directions, strict=True)):
            s, c = sin_cos(angle)
            along[i, 1] = -s, c, px * c + py * s
    feels = (along**2 / np.array([robot.mass, robot.mass, robot.inertia])).sum(axis=2).max(axis=1)
    relaxation = np.divide(1.0, feels, out=np.zeros(MAX_WHEELS), where=feels > 0.0)
    carried = robot.mass * GRAVITY * robot.driven_load
    substep = options.dt / SUBSTEPS
    decay, mean = lag_factors(options.actuators.lag, substep)
    return record(
        BASE,
        {
            "mass": robot.mass,
            "inertia": robot.inertia,
            "wheels": count,
            "directions": along,
            "spread": pseudo_inverse(along.reshape(-1, 3)).T.reshape(MAX_WHEELS, 2, 3),
            "relaxation": relaxation,
            "traction": robot.friction * carried / count,
            "substep": substep,
            "lag_decay": decay,
            "lag_mean": mean,
        },
    )


@compiled
def twist_between_poses(x, y, heading, to_x, to_y, to_heading, dt):
    """Returns the constant body twist that leads from one pose to another in dt, by less than half a turn.

    The logarithm of SE(2): the inverse of `kinematics.integrate_arc`.
    """
    turn = wrap_angle(to_heading - heading)
    s, c = sin_cos(heading + 0.5 * turn)
    scale = 1.0 / (dt * sinc(0.5 * turn))
    dx = scale * (to_x - x)
    dy = scale * (to_y - y)
    return c * dx + s * dy, c * dy - s * dx, turn / dt


@compiled
def turned(x, y, angle):
    """Returns the vector (x, y) turned by an angle."""
    s, c = sin_cos(angle)
    return c * x - s * y, s * x + c * y


@compiled
def grips(b, vx, vy, yaw_rate, to_vx, to_vy, to_yaw_rate, turn):
    """Returns whether the wheels can bring the body from one twist to another within a sub-step.

    Its velocity keeps its direction in the world while the body turns by `turn`: a bend costs traction too.
    """
    vx, vy = turned(vx, vy, -turn)
    px = b.mass * (to_vx - vx)
    py = b.mass * (to_vy - vy)
    spin = b.inertia * (to_yaw_rate - yaw_rate)
    most = b.traction * b.substep
    for i in range(b.wheels):
        along = b.spread[i, 0, 0] * px + b.spread[i, 0, 1] * py + b.spread[i, 0, 2] * spin
        across = b.spread[i, 1, 0] * px + b.spread[i, 1, 1] * py + b.spread[i, 1, 2] * spin
        if along * along + across * across > most * most:
            return False
    return True


@allocating
def slide(b, vx, vy, yaw_rate, to_vx, to_vy, to_yaw_rate):
    """Returns the twist after a sub-step of Coulomb friction at wheels that turn for another twist.

    Sequential impulses: each wheel in turn takes off its slip, its impulse so far clamped to the friction
    circle, until nothing changes (Catto, "Iterative Dynamics with Temporal Coherence", 2005). One relaxation
    factor along and across makes a sliding wheel's impulse point against its slip.
    """
    most = b.traction * b.substep
    impulses = np.zeros((MAX_WHEELS, 2))
    for _ in range(MAX_SWEEPS):
        largest = 0.0
        for i in range(b.wheels):
            d = b.directions[i]
            dx = vx - to_vx
            dy = vy - to_vy
            turn = yaw_rate - to_yaw_rate
            along = impulses[i, 0] - b.relaxation[i] * (d[0, 0] * dx + d[0, 1] * dy + d[0, 2] * turn)
            across = impulses[i, 1] - b.relaxation[i] * (d[1, 0] * dx + d[1, 1] * dy + d[1, 2] * turn)
            size = math.sqrt(along * along + across * across)
            if size > most:
                along *= most / size
                across *= most / size
            along -= impulses[i, 0]
            across -= impulses[i, 1]
            impulses[i, 0] += along
            impulses[i, 1] += across
            vx += (d[0, 0] * along + d[1, 0] * across) / b.mass
            vy += (d[0, 1] * along + d[1, 1] * across) / b.mass
            yaw_rate += (d[0, 2] * along + d[1, 2] * across) / b.inertia
            largest = max(largest, abs(along), abs(across))
        if largest <= RELAXED * most:
            break
    if max(abs(vx - to_vx), abs(vy - to_vy), abs(yaw_rate - to_yaw_rate)) <= GRIPPED:
        return to_vx, to_vy, to_yaw_rate
    return vx, vy, yaw_rate


@compiled
def free(p, s, vx, vy, yaw_rate):
    """Returns whether nothing is in reach of a control period at a twist."""
    return s.clearance > p.dt * (math.sqrt(vx * vx + vy * vy) + swing(p, yaw_rate))


@compiled
def rolled(p, s, robots, i, row, vx, vy, yaw_rate):
    """Moves a robot along the arc of the mean twist that its wheels, which have turned, turned for."""
    s.vx, s.vy, s.yaw_rate = body_twist(p, s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate)
    mean_vx, mean_vy, mean_yaw_rate = body_twist(p, vx, vy, yaw_rate)
    s.x, s.y, s.heading = integrate_arc(s.x, s.y, s.heading, mean_vx, mean_vy, mean_yaw_rate, p.dt)
    s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
    if p.passive_encoders:
        vx = mean_vx
        vy = mean_vy
        yaw_rate = mean_yaw_rate
    if not p.perfect_pose:
        advance_odometry(p, s, vx, vy, yaw_rate, robots.noise, i, row)


@compiled
def roll_on(p, b, s, robots, actions, i, row):
    """Does what `roll` does for a base with a response of its own."""
    command_vx = s.command_vx
    command_vy = s.command_vy
    command_yaw_rate = s.command_yaw_rate
    wheel_vx = s.wheel_vx
    wheel_vy = s.wheel_vy
    wheel_yaw_rate = s.wheel_yaw_rate
    vx, vy, yaw_rate = body_twist(p, wheel_vx, wheel_vy, wheel_yaw_rate)
    holds = s.vx == vx and s.vy == vy and s.yaw_rate == yaw_rate
    for k in range(SUBSTEPS):
        if not holds:
            break
        part_vx, part_vy, part_yaw_rate = respond(p, s, actions, i, k * b.substep, (k + 1) * b.substep)
        _, _, turn = body_twist(p, part_vx, part_vy, part_yaw_rate)
        to_vx, to_vy, to_yaw_rate = body_twist(p, s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate)
        holds = grips(b, vx, vy, yaw_rate, to_vx, to_vy, to_yaw_rate, turn * b.substep)
        vx = to_vx
        vy = to_vy
        yaw_rate = to_yaw_rate
    for again in range(2):
        s.command_vx = command_vx
        s.command_vy = command_vy
        s.command_yaw_rate = command_yaw_rate
        s.wheel_vx = wheel_vx
        s.wheel_vy = wheel_vy
        s.wheel_yaw_rate = wheel_yaw_rate
        if again or not holds:
            break
        # the whole period at once, as in the kinematic plant
        vx, vy, yaw_rate = respond(p, s, actions, i, 0.0, p.dt)
        mean_vx, mean_vy, mean_yaw_rate = body_twist(p, vx, vy, yaw_rate)
        if free(p, s, mean_vx, mean_vy, mean_yaw_rate):
            rolled(p, s, robots, i, row, vx, vy, yaw_rate)
            return True
    return False


@compiled
def roll(p, b, s, robots, actions, i, row):
    """Moves a robot as the kinematic plant does, if its wheels hold all the way and nothing is in reach.

    Returns whether it did.
    """
    if p.responds:
        return roll_on(p, b, s, robots, actions, i, row)
    vx, vy, yaw_rate = body_twist(p, s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate)
    if s.vx != vx or s.vy != vy or s.yaw_rate != yaw_rate:
        return False
    dvx = s.wheel_vx - s.command_vx
    dvy = s.wheel_vy - s.command_vy
    dyaw = s.wheel_yaw_rate - s.command_yaw_rate
    rolled_vx, rolled_vy, rolled_yaw_rate = lagging_twist(s, p.lag_mean)
    mean_vx, mean_vy, mean_yaw_rate = body_twist(p, rolled_vx, rolled_vy, rolled_yaw_rate)
    if not free(p, s, mean_vx, mean_vy, mean_yaw_rate):
        return False
    left = 1.0
    for _ in range(SUBSTEPS):
        part = b.lag_mean * left
        _, _, turn = body_twist(
            p, s.command_vx + part * dvx, s.command_vy + part * dvy, s.command_yaw_rate + part * dyaw
        )
        turn *= b.substep
        left *= b.lag_decay
        to_vx, to_vy, to_yaw_rate = body_twist(
            p, s.command_vx + left * dvx, s.command_vy + left * dvy, s.command_yaw_rate + left * dyaw
        )
        if not grips(b, vx, vy, yaw_rate, to_vx, to_vy, to_yaw_rate, turn):
            return False
        vx = to_vx
        vy = to_vy
        yaw_rate = to_yaw_rate
    s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate = lagging_twist(s, p.lag_decay)
    rolled(p, s, robots, i, row, rolled_vx, rolled_vy, rolled_yaw_rate)
    return True


@compiled
def turn_wheels(p, b, s, m, actions, i):
    """Turns the wheels on by a sub-step: the first-order lag, exactly."""
    if p.responds:
        # what has no lag has jumped to the reference before the sub-step
        m.from_vx, m.from_vy, m.from_yaw_rate = body_twist(
            p,
            s.wheel_vx if p.lags[0] > 0.0 else s.command_vx,
            s.wheel_vy if p.lags[1] > 0.0 else s.command_vy,
            s.wheel_yaw_rate if p.lags[2] > 0.0 else s.command_yaw_rate,
        )
        vx, vy, yaw_rate = respond(p, s, actions, i, (m.substep - 1) * b.substep, m.substep * b.substep)
        m.mean_vx, m.mean_vy, m.mean_yaw_rate = body_twist(p, vx, vy, yaw_rate)
        m.to_vx, m.to_vy, m.to_yaw_rate = body_twist(p, s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate)
        m.rolled_vx += vx / SUBSTEPS
        m.rolled_vy += vy / SUBSTEPS
        m.rolled_yaw_rate += yaw_rate / SUBSTEPS
        return
    vx, vy, yaw_rate = lagging_twist(s, b.lag_mean)
    m.mean_vx, m.mean_vy, m.mean_yaw_rate = body_twist(p, vx, vy, yaw_rate)
    # wheels without lag have jumped to the command before the sub-step
    vx, vy, yaw_rate = lagging_twist(s, 1.0 if b.lag_mean > 0.0 else 0.0)
    m.from_vx, m.from_vy, m.from_yaw_rate = body_twist(p, vx, vy, yaw_rate)
    s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate = lagging_twist(s, b.lag_decay)
    m.to_vx, m.to_vy, m.to_yaw_rate = body_twist(p, s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate)


@compiled
def pull(b, s, m):
    """Sets the twist to which the floor brings the body in a sub-step; returns the pose that it gets to.

    A body that slips is displaced as by a constant acceleration. One whose wheels grip at the end follows
    their exact arc, and on top of it what slip was left at the beginning and faded.
    """
    h = b.substep
    slip_vx = s.vx - m.from_vx
    slip_vy = s.vy - m.from_vy
    slip_yaw_rate = s.yaw_rate - m.from_yaw_rate
    rolling = max(abs(slip_vx), abs(slip_vy), abs(slip_yaw_rate)) <= GRIPPED
    guess = h * (m.mean_yaw_rate if rolling else s.yaw_rate)
    world_vx, world_vy = turned(s.vx, s.vy, s.heading)
    slip_x, slip_y = turned(slip_vx, slip_vy, s.heading)
    gripped = grips(b, s.vx, s.vy, s.yaw_rate, m.to_vx, m.to_vy, m.to_yaw_rate, guess)
    vx = m.to_vx
    vy = m.to_vy
    yaw_rate = m.to_yaw_rate
    if not gripped:
        vx, vy = turned(s.vx, s.vy, -guess)
        vx, vy, yaw_rate = slide(b, vx, vy, s.yaw_rate, m.to_vx, m.to_vy, m.to_yaw_rate)
        gripped = vx == m.to_vx and vy == m.to_vy and yaw_rate == m.to_yaw_rate
    turn = h * (m.mean_yaw_rate + 0.5 * (slip_yaw_rate + yaw_rate - m.to_yaw_rate))
    if gripped:
        x, y, heading = integrate_arc(s.x, s.y, s.heading, m.mean_vx, m.mean_vy, turn / h, h)
        x += 0.5 * h * slip_x
        y += 0.5 * h * slip_y
    else:
        # momentum keeps its direction in the world: undo the error of the guessed turn
        vx, vy = turned(vx, vy, guess - turn)
        heading = wrap_angle(s.heading + turn)
        end_vx, end_vy = turned(vx, vy, heading)
        x = s.x + 0.5 * h * (world_vx + end_vx)
        y = s.y + 0.5 * h * (world_vy + end_vy)
    s.vx = vx
    s.vy = vy
    s.yaw_rate = yaw_rate
    return x, y, heading


@compiled
def keep_out(p, b, s, robots, i, bodies, x, y):
    """Returns the point (x, y) that a sub-step leads to, moved so that the hull gets no deeper into anything.

    pymunk finds a contact only after the overlap: a hull at 1 m/s would be 1 cm inside. Here it is set back
    along the surface normal to a depth of DEPTH, or to the depth that it already had. What moves is met where
    it will be.
    """
    h = b.substep
    obstacles = robots.obstacles
    for _ in range(4):
        moved = False
        for j in range(s.num_obstacles):
            shift_x = h * bodies[i, j].vx
            shift_y = h * bodies[i, j].vy
            depth = p.hull_radius - clearance_to(obstacles[i, j], x - shift_x, y - shift_y)
            if depth <= DEPTH:
                continue
            excess = depth - max(DEPTH, p.hull_radius - clearance_to(obstacles[i, j], s.x, s.y))
            if excess > 1e-9:
                _, nx, ny = nearest_surface(obstacles[i, j], x - shift_x, y - shift_y)
                x += excess * nx
                y += excess * ny
                moved = True
        if robots.grids.cells.shape[0] > 0:
            frame = robots.grids.frames[s.scenario]
            depth = p.hull_radius - grid_clearance(frame, robots.grids.cells, x, y)
            excess = depth - max(DEPTH, p.hull_radius - grid_clearance(frame, robots.grids.cells, s.x, s.y))
            if excess > 1e-9:
                nx, ny = grid_normal(frame, robots.grids.cells, x, y)
                x += excess * nx
                y += excess * ny
                moved = True
        if not moved:
            break
    return x, y


@compiled
def keep_box_out(p, b, s, robots, i, bodies, pose):
    """Returns the point of `keep_out` for a hull that is a rectangle, which a sub-step leads to the pose."""
    x, y, heading = pose
    h = b.substep
    first = -1 if robots.grids.cells.shape[0] > 0 else 0  # the grid
    for _ in range(4):
        moved = False
        for j in range(first, s.num_obstacles):
            shift_x = h * bodies[i, j].vx if j >= 0 else 0.0
            shift_y = h * bodies[i, j].vy if j >= 0 else 0.0
            depth = touched(p, robots, i, s, j, x - shift_x, y - shift_y, heading)
            if depth <= DEPTH:
                continue
            # no deeper than where it was; a corner that a turn brings in is let out
            excess = depth - max(DEPTH, touched(p, robots, i, s, j, s.x, s.y, s.heading))
            if excess > 1e-9:
                nx, ny = way_out(p, robots, i, s, j, x - shift_x, y - shift_y, heading)
                x += excess * nx
                y += excess * ny
                moved = True
        if not moved:
            break
    return x, y


@compiled
def aim(p, b, s, m, robots, i, bodies):
    """Puts what moves by a script where it is at the sub-step's beginning, with the velocity that it has in it."""
    h = b.substep
    obstacles = robots.obstacles
    begin = s.steps * p.dt + (m.substep - 1) * h
    for j in range(s.num_obstacles):
        if moves(obstacles[i, j]):
            obstacles[i, j].x, obstacles[i, j].y, _, _ = motion_at(obstacles[i, j], begin)
            x, y, _, _ = motion_at(obstacles[i, j], begin + h)
            bodies[i, j].vx = (x - obstacles[i, j].x) / h
            bodies[i, j].vy = (y - obstacles[i, j].y) / h


@compiled
def advance(p, b, s, m, robots, actions, i, bodies, hull):
    """Runs sub-steps until pymunk has to resolve one, put into `hull`; returns False at the period's end."""
    moving = p.moving == 1
    while m.substep < SUBSTEPS:
        m.substep += 1
        if moving:
            aim(p, b, s, m, robots, i, bodies)
        turn_wheels(p, b, s, m, actions, i)
        x, y, heading = pull(b, s, m)
        dx = x - s.x
        dy = y - s.y
        m.clearance -= math.sqrt(dx * dx + dy * dy)
        touches = m.pushing == 1
        if p.hull_length > 0.0:
            m.clearance -= swing(p, wrap_angle(heading - s.heading))
        if m.clearance <= 0.0 or touches or moving:
            if p.hull_length > 0.0:
                x, y = keep_box_out(p, b, s, robots, i, bodies, (x, y, heading))
            else:
                x, y = keep_out(p, b, s, robots, i, bodies, x, y)
            if moving:
                time = s.steps * p.dt + m.substep * b.substep
                go_on(robots.obstacles, i, s.num_obstacles, time)
            m.clearance = hull_clearance(p, robots, i, s, x, y, heading)
            touches = touches or m.clearance < 0.0
        s.x = x
        s.y = y
        s.heading = heading
        if touches:
            # pymunk moves a body first and resolves contacts then: let it arrive here
            hull.vx, hull.vy = turned(s.vx, s.vy, heading)
            hull.yaw_rate = s.yaw_rate
            hull.x = x - b.substep * hull.vx
            hull.y = y - b.substep * hull.vy
            hull.angle = heading - b.substep * hull.yaw_rate if p.hull_length > 0.0 else 0.0
            return True
    return False


@compiled
def absorb(p, s, m, robots, i, bodies, hull):
    """Takes over what pymunk made of a sub-step: the velocity after contacts, and the things pushed."""
    vx, vy = turned(s.vx, s.vy, s.heading)
    if hull.vx != vx or hull.vy != vy:
        dvx, dvy = turned(hull.vx - vx, hull.vy - vy, -s.heading)
        s.vx += dvx
        s.vy += dvy
    s.yaw_rate = hull.yaw_rate
    s.x = hull.x
    s.y = hull.y
    if p.hull_length > 0.0:
        s.heading = wrap_angle(hull.angle)
    m.pushing = 0
    obstacles = robots.obstacles
    for j in range(s.num_obstacles):
        if obstacles[i, j].mass > 0.0:
            body = bodies[i, j]
            obstacles[i, j].x = body.x
            obstacles[i, j].y = body.y
            obstacles[i, j].sin, obstacles[i, j].cos = sin_cos(body.angle)
            if max(abs(body.vx), abs(body.vy), abs(body.yaw_rate)) > AT_REST:
                m.pushing = 1
    m.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
    if m.clearance < 0.0:
        s.contact = 1


@compiled
def finish(p, s, m, robots, i, row):
    """Ends the control period: exact clearance, odometry by the drive wheels or by the body's motion."""
    if p.moving:
        go_on(robots.obstacles, i, s.num_obstacles, (s.steps + 1) * p.dt)
    s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
    if p.perfect_pose:
        return
    vx = m.rolled_vx
    vy = m.rolled_vy
    yaw_rate = m.rolled_yaw_rate
    if p.passive_encoders:
        vx, vy, yaw_rate = twist_between_poses(m.start_x, m.start_y, m.start_heading, s.x, s.y, s.heading, p.dt)
    advance_odometry(p, s, vx, vy, yaw_rate, robots.noise, i, row)


class Spaces(NamedTuple):
    """What kernels and pymunk tell each other, of b robots with m obstacles."""

    progress: NDArray[np.void]  # (b,) PROGRESS records
    bodies: NDArray[np.void]  # (b, m) BODY records
    hulls: NDArray[np.void]  # (b,) BODY records
    waiting: NDArray[np.int64]  # (b,) robots that wait for pymunk; as many as the kernels say


@any_layout
@compiled
def drive_rows(params, base, states, obstacles, actions, grids, noise, skip, spaces, moved):
    """Begins a control period, or goes on with it after pymunk; returns how many robots wait for pymunk (again).

    One kernel for both: most of it is the same, and takes some seconds to compile.

    Args:
        moved: how many of `waiting` pymunk has moved; less than 0: the period begins, for all robots but those in
            `skip`.
    """
    robots = Robots(params, states, obstacles, noise, grids)
    progress, bodies, hulls, waiting = spaces
    p = params[0]
    b = base[0]
    begins = moved < 0
    again = 0
    for k in range(states.shape[0] if begins else moved):
        i = k if begins else waiting[k]
        s = states[i]
        m = progress[i]
        row = s.noise_row if noise.shape[1] > 1 else 0
        if begins:
            if skip[i] or (m.pushing == 0 and roll(p, b, s, robots, actions, i, row)):
                continue
            m.substep = 0
            m.start_x = s.x
            m.start_y = s.y
            m.start_heading = s.heading
            m.clearance = s.clearance
            m.rolled_vx, m.rolled_vy, m.rolled_yaw_rate = lagging_twist(s, p.lag_mean)
            if p.responds:
                m.rolled_vx = 0.0
                m.rolled_vy = 0.0
                m.rolled_yaw_rate = 0.0
        else:
            absorb(p, s, m, robots, i, bodies, hulls[i])
        if advance(p, b, s, m, robots, actions, i, bodies, hulls[i]):
            waiting[again] = i
            again += 1
        else:
            finish(p, s, m, robots, i, row)
    return again


class World:
    """The pymunk space around one robot: its hull, what is fixed, what can be pushed, and what moves by a script.

    Of a `grid` the space gets the cells that something comes near, when it does.

    A copy is the space built anew and driven through the same steps. pymunk copies a space without the forces that its
    joints held with, from which the next step goes on: pushed things would part from those of the original.
    """

    def __init__(
        self,
        robot: Robot,
        obstacles: NDArray[np.void],
        substep: float,
        grid: OccupancyGrid | None = None,
    ) -> None:
        self._made_of = (robot, obstacles.copy(), substep, grid)
        self._walls: set[tuple[int, int]] = set()  # the grid's cells that are in the space
        self.grid = grid
        self._steps = array.array("d")  # what moved in each step: hull, then position and velocity of what is scripted
        self.space = pymunk.Space()
        self.space.iterations = ITERATIONS
        self.space.collision_slop = SLOP
        self.space.collision_bias = OVERLAP_LEFT ** (1.0 / substep)  # the share left after a second
        self.hull = pymunk.Body(robot.mass, robot.inertia)
        self.turns = robot.hull_box is not None  # whether it matters how the hull is turned
        self.pushable: list[tuple[int, pymunk.Body]] = []
        self.moving: list[tuple[int, pymunk.Body]] = []
        x, y = (0.5 * side for side in robot.hull_box or (0.0, 0.0))
        shapes: list[pymunk.Shape] = [
            pymunk.Poly.create_box_bb(self.hull, pymunk.BB(robot.hull_x - x, -y, robot.hull_x + x, y))
            if robot.hull_box
            else pymunk.Circle(self.hull, robot.hull_radius)
        ]
        for j, obstacle in enumerate(obstacles):
            if obstacle["patrol"]["leg_time"] > 0.0:
                body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
                body.angle = bearing(obstacle["sin"].item(), obstacle["cos"].item())
                self.space.add(body)
                self.moving.append((j, body))
                shapes.append(_shape(body, obstacle, 0.0, 0.0, 1.0, 0.0))
            elif obstacle["mass"] > 0.0:
                body = self._loose_body(obstacle)
                self.pushable.append((j, body))
                shapes.append(_shape(body, obstacle, 0.0, 0.0, 1.0, 0.0))
            else:
                place = (obstacle[name].item() for name in ("x", "y", "cos", "sin"))
                shapes.append(_shape(self.space.static_body, obstacle, *place))
        for shape in shapes:
            # pymunk multiplies the two
            shape.friction = math.sqrt(HULL_FRICTION)
        self.space.add(self.hull, *shapes)
        loose = obstacles[(obstacles["mass"] > 0.0) & (obstacles["patrol"]["leg_time"] == 0.0)]
        thickness = 2.0 * (np.minimum(loose["half_length"], loose["half_width"]) + loose["radius"])
        thinnest = float(thickness.min(initial=THIN))
        self.cuts = 1 if thinnest >= THIN else math.ceil(CUTS_BY_THICKNESS / thinnest)  # of a sub-step

    def _loose_body(self, obstacle: NDArray[np.void]) -> pymunk.Body:
        """Returns a body that the floor holds by Coulomb friction: joints of limited force, not stiff."""
        mass = obstacle["mass"].item()
        radius = obstacle["radius"].item()
        length = 2.0 * (obstacle["half_length"].item() + radius)
        width = 2.0 * (obstacle["half_width"].item() + radius)
        round_one = obstacle["half_length"] == 0.0 and obstacle["half_width"] == 0.0
        inertia = mass * (0.5 * radius**2 if round_one else (length**2 + width**2) / 12.0)
        body = pymunk.Body(mass, inertia)
        body.position = obstacle["x"].item(), obstacle["y"].item()
        body.angle = bearing(obstacle["sin"].item(), obstacle["cos"].item())
        weight = FLOOR_FRICTION * mass * GRAVITY
        hold = pymunk.PivotJoint(self.space.static_body, body, (body.position.x, body.position.y), (0.0, 0.0))
        hold.max_force = weight
        hold_turn = pymunk.GearJoint(self.space.static_body, body, 0.0, 1.0)
        # the friction moment of a disc of the same area, pressed evenly on the floor
        reach = radius if round_one else math.sqrt(length * width / math.pi)
        hold_turn.max_force = weight * 2.0 / 3.0 * reach
        for joint in (hold, hold_turn):
            joint.max_bias = 0.0
        self.space.add(body, hold, hold_turn)
        return body

    def step(
        self, dt: float, i: int, hulls: NDArray[np.void], bodies: NDArray[np.void], obstacles: NDArray[np.void]
    ) -> None:
        """Moves everything by dt and resolves contacts; reads and writes the BODY records of robot i."""
        motion = list(hulls[i].item())
        for j, _ in self.moving:
            vx, vy = bodies["vx"][i, j].item(), bodies["vy"][i, j].item()
            # like the hull: let it arrive where it is to be
            motion += obstacles["x"][i, j].item() - dt * vx, obstacles["y"][i, j].item() - dt * vy, vx, vy
        self._steps.extend(motion)
        self._advance(dt, motion)
        body = self.hull
        hulls[i] = (*body.position, body.angle if self.turns else 0.0, *body.velocity, body.angular_velocity)
        for j, loose in self.pushable:
            bodies[i, j] = (*loose.position, loose.angle, *loose.velocity, loose.angular_velocity)

    def _advance(self, dt: float, motion: list[float]) -> None:
        """Moves everything by dt: the hull and what a script moves as given in `motion`, the rest by its momentum."""
        body = self.hull
        x, y, angle, vx, vy, body.angular_velocity = motion[:6]
        body.position = x, y
        if self.turns:
            body.angle = angle
        body.velocity = vx, vy
        for k, (_, scripted) in enumerate(self.moving):
            x, y, vx, vy = motion[6 + 4 * k : 10 + 4 * k]
            scripted.position = x, y
            scripted.velocity = vx, vy
        if self.grid is not None:
            self._wall_in(body, dt)
            for _, loose in self.pushable:
                self._wall_in(loose, dt)
        for _ in range(self.cuts):
            self.space.step(dt / self.cuts)

    def _wall_in(self, body: pymunk.Body, dt: float) -> None:
        """Adds to the space the occupied cells that a body can reach within dt and that are not there yet."""
        assert self.grid is not None
        (shape,) = body.shapes
        box = shape.cache_bb()
        reach = dt * body.velocity.length + NEAR
        low, high = (box.left - reach, box.bottom - reach), (box.right + reach, box.top + reach)
        for cell in self.grid.edges_within(low, high):
            if cell not in self._walls:
                self._walls.add(cell)
                row, column = cell
                at = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) + np.array([column, row])
                wall = pymunk.Poly(self.space.static_body, self.grid.points(at).tolist())
                wall.friction = math.sqrt(HULL_FRICTION)
                self.space.add(wall)

    def __reduce__(self) -> tuple[Any, ...]:
        return World, self._made_of, self._steps

    def __setstate__(self, steps: "array.array[float]") -> None:
        substep = self._made_of[2]
        self._steps = steps
        for motion in np.asarray(steps).reshape(-1, 6 + 4 * len(self.moving)).tolist():
            self._advance(substep, motion)


def _shape(
    body: pymunk.Body, obstacle: NDArray[np.void], x: float, y: float, cosine: float, sine: float
) -> pymunk.Shape:
    """Returns the pymunk shape of an obstacle in the body's frame: the very surface that rays meet."""
    length, width, radius = (obstacle[name].item() for name in ("half_length", "half_width", "radius"))
    if length == 0.0 and width == 0.0:
        return pymunk.Circle(body, radius, (x, y))

    def at(along: float, across: float) -> tuple[float, float]:
        return x + cosine * along - sine * across, y + sine * along + cosine * across

    if length == 0.0 or width == 0.0:
        return pymunk.Segment(body, at(-length, -width), at(length, width), radius)
    corners = [at(-length, -width), at(length, -width), at(length, width), at(-length, width)]
    return pymunk.Poly(body, corners, radius=radius)


class PymunkPlant:
    """Drives a batch of robots, each in a pymunk space of its own, built when it first touches something.

    While wheels that grip push with a force F, the body lags behind them by F * sub-step / mass: they pull
    and contacts hold back one after the other.

    Attributes:
        worlds: the `World` of each robot; None where nothing has been touched since the reset.
    """

    def __init__(self, task: Task, num_envs: int) -> None:
        self.task = task
        self.base = base_record(task.robot, task.options)
        self.substep = self.base["substep"].item()
        self.worlds: list[World | None] = [None] * num_envs
        self.progress = np.zeros(num_envs, PROGRESS)
        self.bodies = np.zeros((num_envs, task.max_obstacles), BODY)
        self.hulls = np.zeros(num_envs, BODY)
        self.waiting = np.zeros(num_envs, np.int64)
        self._parts: tuple[Any, ...] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_parts": None}  # machine code is looked up anew

    def _drive_rows(
        self, states: Records, obstacles: Records, actions: Array, noise: Array, skip: Flags, moved: int
    ) -> int:
        """Runs the compiled `drive_rows`."""
        task = self.task
        if self._parts is None or self._parts[0] is not states:
            # of the task's records what a plant reads, so that one kernel does for all tasks
            params, frames = part_of(task.params, ROBOT_PARAMS), part_of(task.grids.frames, FRAME)
            robots, grids = part_of(states, ROBOT_STATE), Grids(frames, task.grids.cells)
            spaces = Spaces(self.progress, self.bodies, self.hulls, self.waiting)
            code = machine_code(
                drive_rows,
                params,
                self.base,
                robots,
                obstacles,
                actions,
                grids,
                noise,
                skip,
                spaces,
                moved,
            )
            self._parts = states, params, robots, grids, spaces, code
        _, params, robots, grids, spaces, code = self._parts
        waiting: int = code(params, self.base, robots, obstacles, actions, grids, noise, skip, spaces, moved)
        return waiting

    def reset(self, rows: NDArray[np.int64], states: NDArray[np.void], obstacles: NDArray[np.void]) -> None:
        """Forgets what the robots in `rows` touched and pushed."""
        del states, obstacles
        self.progress[rows] = 0
        self.bodies[rows] = 0
        for i in rows.tolist():
            self.worlds[i] = None

    def drive(self, states: Records, obstacles: Records, actions: Array, noise: Array, skip: Flags) -> None:
        """Moves every robot that is not in `skip` by one control period."""
        counts = self.task.obstacle_counts(states)
        count = self._drive_rows(states, obstacles, actions, noise, skip, -1)
        while count:
            for i in self.waiting[:count].tolist():
                world = self.worlds[i]
                if world is None:
                    # nothing has been pushed yet, so obstacles are where the reset put them
                    world = self.worlds[i] = World(
                        self.task.robot,
                        obstacles[i, : counts[i]],
                        self.substep,
                        getattr(self.task.scenarios[states[i]["scenario"]], "grid", None),
                    )
                world.step(self.substep, i, self.hulls, self.bodies, obstacles)
            count = self._drive_rows(states, obstacles, actions, noise, skip, count)
