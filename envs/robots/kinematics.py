"""How wheeled robots move in the plane: rigid-body wheel maps, saturation, actuator dynamics, exact arcs.

Pure scalar functions of one robot. The environments, the vector environments and the predictive models of controllers
all call these, so that there is one statement of motion. A twist is (v_x, v_y, yaw_rate) in the body frame: m/s, m/s,
rad/s.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wayfield.system.compiled import inlined
from wayfield.system.elementary import sin_cos, wrap_angle


def wheel_matrix(
    positions: ArrayLike, directions: ArrayLike, radii: ArrayLike, roller_angles: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """Returns the (n, 3) matrix from twist to wheel speeds (rad/s) of a rigid base.

    Row i is r_i cos(g_i) w_i = a_i . (v + yaw_rate x p_i) of a wheel at p_i: the speed of the body at the wheel's
    contact point along a_i, the direction in which the wheel holds on to the floor, at the angle b_i + g_i. Across it
    the rollers turn freely. b_i is the drive direction and g_i the angle from it to the axis of the roller: zero for
    plain and omni wheels, whose rolling constraint this is then, and +-45 degrees for mecanum wheels (Lynch and Park,
    Modern Robotics, 2017, eq. 13.5; Muir and Neuman, "Kinematic modeling of wheeled mobile robots", 1987).

    Args:
        positions: (n, 2) contact points in the body frame, m.
        directions: (n,) angles b of the drive directions in the body frame, rad.
        radii: m, one or (n,).
        roller_angles: rad, one or (n,), less than a right angle in size.
    """
    px, py = np.asarray(positions, dtype=np.float64).T
    rollers = np.broadcast_to(np.asarray(roller_angles, dtype=np.float64), px.shape)
    angles = np.asarray(directions, dtype=np.float64) + rollers
    # in plain Python, of the same bits: every command reads the robots' sheets, and few go on to anything compiled
    s, c = np.array([sin_cos.py_func(angle) for angle in angles.tolist()]).T
    _, slant = np.array([sin_cos.py_func(angle) for angle in rollers.tolist()]).T
    held: NDArray[np.float64] = np.asarray(radii, dtype=np.float64) * slant
    matrix: NDArray[np.float64] = np.column_stack([c, s, px * s - py * c]) / held[:, None]
    return matrix


def plain_sum_matrix(matrix: ArrayLike, radii: ArrayLike) -> NDArray[np.float64]:
    """Returns the (3, n) forward map as documents B and C print it: a plain sum, r [cos a; sin a; 1/l] of omni wheels.

    It over-reads by n/2 in translation and by n in rotation. The right map is the pseudo-inverse of `wheel_matrix`.
    """
    r = np.asarray(radii, dtype=np.float64)
    constraint = np.asarray(matrix, dtype=np.float64) * r.reshape(-1, 1)
    return r * np.vstack([constraint[:, 0], constraint[:, 1], 1.0 / constraint[:, 2]])


@inlined
def limits(plant, command, twist, dt):
    """Returns what a base makes of a requested twist dt after its last command: v_x, v_y, yaw rate, saturation factor.

    No wheel turns faster than it can, no change is faster than the accelerations allow, and a base that is steered
    turns on no smaller radius than its own.

    Args:
        plant: a record with what `saturation_factor` and `steered` read, `acceleration` and `yaw_acceleration`.
        command: (v_x, v_y, yaw rate), the last that was set.
        twist: likewise, the requested one.
    """
    vx, vy, yaw_rate = twist
    factor = saturation_factor(plant, vx, vy, yaw_rate)
    vx, vy, yaw_rate = limit_acceleration(
        command, (factor * vx, factor * vy, factor * yaw_rate), plant.acceleration, plant.yaw_acceleration, dt
    )
    return vx, vy, steered(plant, vx, yaw_rate), factor


@inlined
def saturation_factor(plant, vx, vy, yaw_rate):
    """Returns the one factor in (0, 1] by which a twist is scaled so that no wheel turns faster than it can.

    Nor does the base turn faster than its driver lets it. One factor for all keeps the direction of motion and the ICC
    radius; clipping each wheel would bend the path.

    Args:
        plant: a record with `num_wheels`, `wheel_matrix`, `wheel_speed_limit` and `turn_speed` (rad/s).
    """
    matrix = plant.wheel_matrix
    fastest = 0.0
    for i in range(plant.num_wheels):
        fastest = max(fastest, abs(matrix[i, 0] * vx + matrix[i, 1] * vy + matrix[i, 2] * yaw_rate))
    factor = 1.0
    if fastest > plant.wheel_speed_limit:
        factor = plant.wheel_speed_limit / fastest
    if factor * abs(yaw_rate) > plant.turn_speed:
        factor = plant.turn_speed / abs(yaw_rate)
    return factor


@inlined
def saturated(plant, vx, vy, yaw_rate):
    """Returns what the wheels can turn of a twist: `saturation_factor` times it."""
    factor = saturation_factor(plant, vx, vy, yaw_rate)
    return factor * vx, factor * vy, factor * yaw_rate


@inlined
def steered(plant, vx, yaw_rate):
    """Returns the yaw rate, cut so that the base turns on no smaller radius than `turning_radius`, m."""
    if plant.turning_radius > 0.0:
        most = abs(vx) / plant.turning_radius
        yaw_rate = min(max(yaw_rate, -most), most)
    return yaw_rate


@inlined
def limit_acceleration(command, twist, acceleration, yaw_acceleration, dt):
    """Returns the twist nearest to the wanted one that can be set dt after the last command.

    The change of velocity is shortened along its own direction to acceleration * dt (m/s), the change of yaw rate
    clipped to yaw_acceleration * dt (rad/s).
    """
    vx, vy, yaw_rate = command
    to_vx, to_vy, to_yaw_rate = twist
    dx = to_vx - vx
    dy = to_vy - vy
    change = math.sqrt(dx * dx + dy * dy)
    most = acceleration * dt
    if change > most:
        dx *= most / change
        dy *= most / change
        to_vx = vx + dx
        to_vy = vy + dy
    turn = to_yaw_rate - yaw_rate
    most = yaw_acceleration * dt
    if abs(turn) > most:
        to_yaw_rate = yaw_rate + math.copysign(most, turn)
    return to_vx, to_vy, to_yaw_rate


@inlined
def integrate_arc(x, y, heading, vx, vy, yaw_rate, dt):
    """Returns the pose (m, m, rad in (-pi, pi]) after a constant body twist has acted for dt.

    The exact exponential of SE(2): the chord of the arc has length |v| dt sin(h)/h and leaves at heading + h, with h
    half the turn (Lynch and Park, Modern Robotics, sec. 13.3.3).
    """
    half_turn = 0.5 * yaw_rate * dt
    s, c = sin_cos(heading + half_turn)
    chord = dt * sinc(half_turn)
    return (
        x + chord * (c * vx - s * vy),
        y + chord * (s * vx + c * vy),
        wrap_angle(heading + 2.0 * half_turn),
    )


@inlined
def sinc(angle):
    """Returns sin(angle) / angle, and 1 at zero."""
    z = angle * angle
    if z < 0.25:
        # Taylor series, (-1)^k z^k / (2k + 1)!; the next term is below 1e-19
        return 1.0 + z * (-1 / 6 + z * (1 / 120 + z * (-1 / 5040 + z * (
            1 / 362880 + z * (-1 / 39916800 + z * (1 / 6227020800 - z * (1 / 1307674368000)))
        ))))  # fmt: skip
    return sin_cos(angle)[0] / angle


@inlined
def to_body_frame(x, y, sin_heading, cos_heading, px, py):
    """Returns the point (px, py) as seen from the pose: bT_w = [R^T, -R^T t; 0 1] applied to the point."""
    dx = px - x
    dy = py - y
    return cos_heading * dx + sin_heading * dy, cos_heading * dy - sin_heading * dx
