"""What a robot can measure: its pose, its twist, and the ranges around it."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wayfield.envs.geometry import ray_to_box, ray_to_circle, sin_cos, wrap_angle
from wayfield.envs.kinematics import integrate_arc

# Columns of a row of noise: x, y, heading, four encoders, then one a beam.
POSE_NOISE_COLUMNS = 3
BEAM_NOISE_COLUMN = 7


def beam_angles(num_beams: int, field_of_view: float) -> NDArray[np.float64]:
    """Returns the directions (rad, body frame) of the beams, evenly spaced from right to left.

    A full circle starts straight behind and leaves out the closing beam; a narrower field of view has a beam at each
    end.
    """
    if field_of_view >= 2.0 * math.pi:
        return -math.pi + 2.0 * math.pi / num_beams * np.arange(num_beams)
    if num_beams == 1:
        return np.zeros(1)
    return -0.5 * field_of_view + field_of_view / (num_beams - 1) * np.arange(num_beams)


@njit(cache=True, error_model="numpy", inline="always")
def encoder_twist(p, vx, vy, yaw_rate, noise, i, row):
    """Returns the twist that odometry reads off the encoders when they roll for the given twist.

    noise[i, row] holds standard normal numbers; each encoder's rate is off by a relative error of its own.
    """
    read_vx = 0.0
    read_vy = 0.0
    read_yaw_rate = 0.0
    for k in range(p.num_encoders):
        rate = p.encoder_matrix[k, 0] * vx + p.encoder_matrix[k, 1] * vy + p.encoder_matrix[k, 2] * yaw_rate
        if p.encoder_noise > 0.0:
            rate *= 1.0 + p.encoder_noise * noise[i, row, POSE_NOISE_COLUMNS + k]
        read_vx += p.odometry_matrix[0, k] * rate
        read_vy += p.odometry_matrix[1, k] * rate
        read_yaw_rate += p.odometry_matrix[2, k] * rate
    return read_vx, read_vy, read_yaw_rate


@njit(cache=True, error_model="numpy", inline="always")
def advance_odometry(p, s, vx, vy, yaw_rate, noise, i, row):
    """Integrates the mean twist (of the drive wheels, or of the body for passive wheels) over the step just made."""
    read_vx, read_vy, read_yaw_rate = encoder_twist(p, vx, vy, yaw_rate, noise, i, row)
    s.odometry_x, s.odometry_y, s.odometry_heading = integrate_arc(
        s.odometry_x, s.odometry_y, s.odometry_heading, read_vx, read_vy, read_yaw_rate, p.dt
    )


@njit(cache=True, error_model="numpy", inline="always")
def measure(p, s, noise, i, row):
    """Sets the pose and twist that the robot believes."""
    if p.perfect_pose:
        s.measured_x = s.x
        s.measured_y = s.y
        s.measured_heading = s.heading
        s.measured_vx = s.vx
        s.measured_vy = s.vy
        s.measured_yaw_rate = s.yaw_rate
        return
    if p.pose_from_odometry:
        s.measured_x = s.odometry_x
        s.measured_y = s.odometry_y
        s.measured_heading = s.odometry_heading
    else:
        s.measured_x = s.x + p.position_noise * noise[i, row, 0]
        s.measured_y = s.y + p.position_noise * noise[i, row, 1]
        s.measured_heading = wrap_angle(s.heading + p.heading_noise * noise[i, row, 2])
    if p.passive_encoders:
        s.measured_vx, s.measured_vy, s.measured_yaw_rate = encoder_twist(p, s.vx, s.vy, s.yaw_rate, noise, i, row)
    else:
        s.measured_vx, s.measured_vy, s.measured_yaw_rate = encoder_twist(
            p, s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate, noise, i, row
        )


@njit(cache=True, error_model="numpy", inline="always")
def coarse_angle(y, x):
    """Returns atan2(y, x) to within 0.005 rad: enough to choose beams, and several times faster."""
    ax = abs(x)
    ay = abs(y)
    q = min(ax, ay) / max(ax, ay)
    angle = q * (0.7853981633974483 + 0.273 * (1.0 - q))
    if ay > ax:
        angle = 1.5707963267948966 - angle
    if x < 0.0:
        angle = 3.141592653589793 - angle
    return math.copysign(angle, y)


# Widens every interval of beams by more than the errors of its coarse angles, rad.
_ANGLE_MARGIN = 0.015


@njit(cache=True, error_model="numpy", inline="always")
def circle_bearings(px, py, radius, max_range):
    """Returns (middle, right, left): a circle lies between the bearings middle + right and middle + left.

    A circle out of range has right > left. The circle stands at (px, py) in the body frame.
    """
    squared = px * px + py * py
    far = max_range + radius
    if squared > far * far:
        return 0.0, 1.0, -1.0
    beyond = squared - radius * radius
    if beyond <= 0.0:
        return 0.0, -math.pi, math.pi
    half = coarse_angle(radius, math.sqrt(beyond)) + _ANGLE_MARGIN
    return coarse_angle(py, px), -half, half


@njit(cache=True, error_model="numpy", inline="always")
def box_bearings(px, py, cosine, sine, half_length, half_width, max_range):
    """Returns `circle_bearings` for a box or wall whose long axis points along (cosine, sine) in the body frame.

    Seen from its nearest point, a convex shape lies within a quarter turn to either side; what of it is in range lies
    within acos(nearest distance / max_range).
    """
    # the robot in the box's frame, and the box's nearest point
    x = -(cosine * px + sine * py)
    y = -(cosine * py - sine * px)
    to_x = min(max(x, -half_length), half_length) - x
    to_y = min(max(y, -half_width), half_width) - y
    distance = math.sqrt(to_x * to_x + to_y * to_y)
    if distance > max_range:
        return 0.0, 1.0, -1.0
    if distance < 1e-6:
        return 0.0, -math.pi, math.pi
    widest = coarse_angle(math.sqrt(max_range * max_range - distance * distance), distance)
    right = 0.0
    left = 0.0
    for corner in range(4 if half_width > 0.0 else 2):
        cx = (half_length if corner & 1 else -half_length) - x
        cy = (half_width if corner & 2 else -half_width) - y
        angle = coarse_angle(to_x * cy - to_y * cx, to_x * cx + to_y * cy)
        right = min(right, angle)
        left = max(left, angle)
    return (
        coarse_angle(sine * to_x + cosine * to_y, cosine * to_x - sine * to_y),
        max(right, -widest) - _ANGLE_MARGIN,
        min(left, widest) + _ANGLE_MARGIN,
    )


@njit(cache=True, error_model="numpy", inline="always")
def scan_ranges(obstacles, i, count, x, y, heading, beams, first_beam, beam_step, max_range, ranges, column):
    """Writes to ranges[i, column:] the distance (m) along each beam to the nearest obstacle, at most max_range.

    Beam k looks along heading + first_beam + k * beam_step. Each obstacle is taken into the body frame and asked only
    about the beams that can meet it, so that the cost goes with what the robot sees, not with beams times obstacles.

    Args:
        obstacles: (b, m) OBSTACLE records; the first `count` of row i are used.
        beams: (num_beams, 2) cosine and sine of the beams in the body frame.
        ranges: (b, n) array of any float type.
    """
    num_beams = beams.shape[0]
    for k in range(num_beams):
        ranges[i, column + k] = max_range
    s, c = sin_cos(heading)
    inverse_step = 1.0 / beam_step
    # beams around the full circle: one interval that may run over the closing beam, else one interval a turn
    wraps = num_beams * beam_step > 6.28318
    for j in range(count):
        obstacle = obstacles[i, j]
        dx = obstacle.x - x
        dy = obstacle.y - y
        px = c * dx + s * dy
        py = c * dy - s * dx
        is_circle = obstacle.half_length == 0.0 and obstacle.half_width == 0.0
        if is_circle:
            middle, right, left = circle_bearings(px, py, obstacle.radius, max_range)
        else:
            cosine = obstacle.cos * c + obstacle.sin * s
            sine = obstacle.sin * c - obstacle.cos * s
            half_length = obstacle.half_length
            half_width = obstacle.half_width
            middle, right, left = box_bearings(px, py, cosine, sine, half_length, half_width, max_range)
        middle -= first_beam
        for turn in range(0 if wraps else -1, 1 if wraps else 2):
            low = int(math.ceil((middle + right + turn * 6.283185307179586) * inverse_step))
            high = int(math.floor((middle + left + turn * 6.283185307179586) * inverse_step))
            if wraps:
                high = min(high, low + num_beams - 1)
            else:
                low = max(low, 0)
                high = min(high, num_beams - 1)
            for k in range(low, high + 1):
                beam = k
                if k < 0:
                    beam += num_beams
                elif k >= num_beams:
                    beam -= num_beams
                if is_circle:
                    distance = ray_to_circle(px, py, obstacle.radius, beams[beam, 0], beams[beam, 1])
                else:
                    distance = ray_to_box(
                        px, py, cosine, sine, half_length, half_width, beams[beam, 0], beams[beam, 1]
                    )
                if distance < ranges[i, column + beam]:
                    ranges[i, column + beam] = distance


@njit(cache=True, error_model="numpy", inline="always")
def add_range_noise(p, num_beams, noise, i, row, ranges, column):
    """Disturbs each range that hit something; a beam that meets nothing keeps max_range."""
    if p.range_noise > 0.0:
        for k in range(num_beams):
            distance = ranges[i, column + k]
            if distance < p.max_range:
                distance += p.range_noise * noise[i, row, BEAM_NOISE_COLUMN + k]
                ranges[i, column + k] = min(max(distance, 0.0), p.max_range)
