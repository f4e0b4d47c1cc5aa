"""What a robot can measure: its pose, its twist, and the ranges around it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots.kinematics import integrate_arc
from wayfield.envs.world.blocks import BLOCK, next_block
from wayfield.envs.world.geometry import MANY, beyond, ray_to_box, ray_to_circle
from wayfield.system.compiled import inlined
from wayfield.system.elementary import sin_cos, sines, wrap_angle

# Columns of a row of noise: x, y, heading, four encoders, then one a beam, and where beams drop out one more a beam.
POSE_NOISE_COLUMNS = 3
BEAM_NOISE_COLUMN = 7


def beam_angles(num_beams: int, field_of_view: float) -> NDArray[np.float64]:
    """Returns the directions (rad, body frame) of the beams, evenly spaced from right to left.

    A full circle starts straight behind and leaves out the closing beam; a narrower field of view has a beam at each
    end.
    """
    if field_of_view >= 2.0 * math.pi:
        return np.linspace(-math.pi, math.pi, num_beams, endpoint=False)
    if num_beams == 1:
        return np.zeros(1)
    return np.linspace(-0.5 * field_of_view, 0.5 * field_of_view, num_beams)


def beam_directions(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the cosines and sines (n, 2) of the directions of beams, rad."""
    return np.ascontiguousarray(sines(angles)[::-1].T)


@inlined
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


@inlined
def advance_odometry(p, s, vx, vy, yaw_rate, noise, i, row):
    """Integrates the mean twist (of the drive wheels, or of the body for passive wheels) over the step just made."""
    read_vx, read_vy, read_yaw_rate = encoder_twist(p, vx, vy, yaw_rate, noise, i, row)
    s.odometry_x, s.odometry_y, s.odometry_heading = integrate_arc(
        s.odometry_x, s.odometry_y, s.odometry_heading, read_vx, read_vy, read_yaw_rate, p.dt
    )


@inlined
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


@inlined
def coarse_angle(y, x):
    """Returns atan2(y, x) to within 0.005 rad: enough to choose beams, and several times faster."""
    ax = abs(x)
    ay = abs(y)
    q = min(ax, ay) / max(ax, ay, 1e-300)
    angle = q * (0.7853981633974483 + 0.273 * (1.0 - q))
    if ay > ax:
        angle = 1.5707963267948966 - angle
    if x < 0.0:
        angle = 3.141592653589793 - angle
    return math.copysign(angle, y)


# Widens every interval of beams by more than the errors of its coarse angles, rad.
_ANGLE_MARGIN = 0.012


@inlined
def circle_bearings(px, py, radius, max_range):
    """Returns (right, left): bearings between which a circle at (px, py) in the body frame lies.

    right > left when all of it is out of range.
    """
    squared = px * px + py * py
    middle = coarse_angle(py, px)
    # q + (pi/2 - 1) q^3 is never below asin(q)
    q = radius / math.sqrt(squared)
    half = q * (1.0 + 0.5707963267948966 * q * q) + _ANGLE_MARGIN
    half = math.pi if not q < 1.0 else half
    far = max_range + radius
    half = -1.0 if squared > far * far else half
    return middle - half, middle + half


@inlined
def box_bearings(px, py, cosine, sine, half_length, half_width, max_range):
    """Returns `circle_bearings` for a box or wall whose long axis points along (cosine, sine) in the body frame."""
    # the robot in the box's frame
    x = -(cosine * px + sine * py)
    y = -(cosine * py - sine * px)
    gap_x = max(abs(x) - half_length, 0.0)
    gap_y = max(abs(y) - half_width, 0.0)
    if gap_x * gap_x + gap_y * gap_y > max_range * max_range:
        return 1.0, -1.0
    if gap_x < 1e-6 and gap_y < 1e-6:
        return -math.pi, math.pi
    # what of the length is in range: a long wall reaches far beyond it
    reach = math.sqrt(max_range * max_range - gap_y * gap_y)
    right_x = max(-half_length, x - reach) - x
    right_y = -half_width - y
    left_x = right_x
    left_y = right_y
    for corner in range(1, 4 if half_width > 0.0 else 2):
        cx = (min(half_length, x + reach) if corner & 1 else max(-half_length, x - reach)) - x
        cy = (half_width if corner & 2 else -half_width) - y
        # seen from outside, all corners lie within half a turn: cross products tell which is outermost
        if right_x * cy - right_y * cx < 0.0:
            right_x = cx
            right_y = cy
        if left_x * cy - left_y * cx > 0.0:
            left_x = cx
            left_y = cy
    right = coarse_angle(sine * right_x + cosine * right_y, cosine * right_x - sine * right_y)
    left = coarse_angle(sine * left_x + cosine * left_y, cosine * left_x - sine * left_y)
    if left < right - _ANGLE_MARGIN:
        left += 6.283185307179586
    return right - _ANGLE_MARGIN, left + _ANGLE_MARGIN


# Bearings of so many obstacles are found side by side, by the same arithmetic without a branch: that a processor does
# for several at once. No power of two, so that their numbers do not all want the same place in its cache.
TOGETHER = 120
# the numbers of an obstacle, in rows of TOGETHER: where it is, m, and the bearings of its ends, rad, in the body frame;
# then the indices of those in reach
_PX, _PY, _RIGHT, _LEFT, _SEEN = (row * TOGETHER for row in range(5))
ROOM = 5 * TOGETHER  # numbers that `scan_ranges` needs room for

BESIDE = 16  # beams that are shortened side by side, those that meet nothing among them


class Lidar(NamedTuple):
    """A range scanner: beam k looks along first_beam + k beam_step."""

    beams: NDArray[np.float64]  # (2, num_beams) cosines and sines of the beams in the body frame
    first_beam: float  # rad, body frame
    beam_step: float  # rad
    max_range: float  # m
    scratch: NDArray[np.float64]  # (ROOM,)
    ways: NDArray[np.float32]  # for maps (grid_scans.SCRATCH,)
    words: NDArray[np.uint64]  # for maps (grid_scans.WORDS,)


@inlined
def find_spans(max_range, scratch, obstacles, field, first, last, pose):
    """Writes where some obstacles of a row are and their bearings, and which are in reach; returns how many those are.

    Args:
        first, last: the obstacles meant, from the first on and without the last, at most TOGETHER.
        pose: x, y (m), sine and cosine of the heading.
    """
    x, y, s, c = pose
    for k in range(last - first):
        obstacle = obstacles[field, np.uint64(first + k)]
        dx = obstacle.x - x
        dy = obstacle.y - y
        px = c * dx + s * dy
        py = c * dy - s * dx
        right, left = circle_bearings(px, py, obstacle.radius, max_range)
        scratch[_PX + k] = px
        scratch[_PY + k] = py
        scratch[_RIGHT + k] = right
        scratch[_LEFT + k] = left
    seen = 0
    for k in range(last - first):
        obstacle = obstacles[field, np.uint64(first + k)]
        if obstacle.half_length != 0.0 or obstacle.half_width != 0.0:
            if last > MANY and beyond(obstacle, x, y, max_range):
                continue
            scratch[_RIGHT + k], scratch[_LEFT + k] = box_bearings(
                scratch[_PX + k],
                scratch[_PY + k],
                obstacle.cos * c + obstacle.sin * s,
                obstacle.sin * c - obstacle.cos * s,
                obstacle.half_length,
                obstacle.half_width,
                max_range,
            )
        scratch[_SEEN + seen] = k
        # out of range, or nowhere: what is no number has no beams
        seen += 1 if scratch[_RIGHT + k] <= scratch[_LEFT + k] else 0
    return seen


@inlined
def scan_ranges(lidar, obstacles, field, count, blocks, pose, ranges, i, column):
    """Writes to ranges[i, column:] the distance (m) along each beam to the nearest obstacle, at most max_range.

    Each obstacle is taken into the body frame and asked only about the beams that can meet it, and some beside them, so
    that the cost goes with what the robot sees, not with beams times obstacles.

    Args:
        lidar: a Lidar.
        obstacles: OBSTACLE records, (rows, m); the first `count` of row `field` are used.
        blocks: how many blocks those are in, see `blocks.in_blocks`; 0: in none.
        pose: x, y (m), heading (rad).
        ranges: (b, n) array of any float type. Its indices are unsigned: a signed one is first asked whether it counts
            from the end.
    """
    x, y, heading = pose
    place = np.uint64(column)
    for k in range(np.uint64(lidar.beams.shape[1])):
        ranges[i, place + k] = lidar.max_range
    s, c = sin_cos(heading)
    first = 0
    block = 0
    while first < count:
        last = min(first + TOGETHER, count)
        if blocks > 0:
            block = next_block(obstacles, field, count, blocks, block, x, y, lidar.max_range)
            if block == blocks:
                break
            first = block * BLOCK
            last = min(first + BLOCK, count)
            block += 1
        # First all bearings, then all beams: how many beams an obstacle has cannot be foretold, and a processor that
        # guesses wrong should not have to wait for an angle to find out.
        seen = find_spans(lidar.max_range, lidar.scratch, obstacles, field, first, last, (x, y, s, c))
        for j in range(seen):
            index = np.uint64(lidar.scratch[np.uint64(_SEEN + j)])
            shorten(lidar, obstacles[field, np.uint64(first) + index], index, (s, c), ranges, i, place)
        first = last


@inlined
def shorten_to(lidar, shapes, count, pose, ranges, i, column):
    """Shortens the beams of ranges[i, column:] to the first `count` shapes of a row, (1, m): see `scan_ranges`."""
    x, y, heading = pose
    place = np.uint64(column)
    s, c = sin_cos(heading)
    first = 0
    while first < count:
        last = min(first + TOGETHER, count)
        seen = find_spans(lidar.max_range, lidar.scratch, shapes, 0, first, last, (x, y, s, c))
        for j in range(seen):
            index = np.uint64(lidar.scratch[np.uint64(_SEEN + j)])
            shorten(lidar, shapes[0, np.uint64(first) + index], index, (s, c), ranges, i, place)
        first = last


@inlined
def shorten(lidar, obstacle, j, turned, ranges, i, column):
    """Shortens the beams that may meet the obstacle whose numbers stand in column j of the scratch.

    Args:
        turned: sine and cosine of the robot's heading.
    """
    beams, first_beam, beam_step, _, scratch, _, _ = lidar
    s, c = turned
    num_beams = beams.shape[1]
    inverse_step = 1.0 / beam_step
    # beams around the full circle: one interval that may run over the closing beam, else one interval a turn
    wraps = abs(num_beams * beam_step - 6.283185307179586) < 1e-9
    px = scratch[np.uint64(_PX) + j]
    py = scratch[np.uint64(_PY) + j]
    right = scratch[np.uint64(_RIGHT) + j] - first_beam
    left = scratch[np.uint64(_LEFT) + j] - first_beam
    is_circle = obstacle.half_length == 0.0 and obstacle.half_width == 0.0
    cosine = obstacle.cos * c + obstacle.sin * s
    sine = obstacle.sin * c - obstacle.cos * s
    box = (px, py, cosine, sine, obstacle.half_length, obstacle.half_width)
    for turn in range(0 if wraps else -1, 1 if wraps else 2):
        first = (right + turn * 6.283185307179586) * inverse_step
        last = (left + turn * 6.283185307179586) * inverse_step
        # clipped while they are floats, so that they are indices of beams whatever the angles are
        if wraps:
            low = math.ceil(min(max(-1.0 * num_beams, first), 1.0 * num_beams))
            high = min(math.floor(min(max(-1.0 * num_beams, last), 2.0 * num_beams)), low + num_beams - 1)
        else:
            low = math.ceil(min(max(0.0, first), 1.0 * num_beams))
            high = math.floor(min(max(-1.0, last), num_beams - 1.0))
        while low <= high:
            # up to the closing beam, and on behind it
            k = low + num_beams if low < 0 else low - num_beams if low >= num_beams else low
            end = min(k + high - low, num_beams - 1)
            low += end - k + 1
            while k <= end:
                if num_beams < BESIDE:
                    shorten_one(beams, box, obstacle.radius, is_circle, ranges, i, column, np.uint64(k))
                    k += 1
                    continue
                # not beyond the last beam
                k = min(k, num_beams - BESIDE)
                if is_circle:
                    shorten_to_circle(beams, px, py, obstacle.radius, ranges, i, column, np.uint64(k))
                else:
                    shorten_to_box(beams, box, ranges, i, column, np.uint64(k))
                k += BESIDE


@inlined
def shorten_one(beams, box, radius, is_circle, ranges, i, column, k):
    """Shortens beam k to where it meets an obstacle."""
    px, py, cosine, sine, half_length, half_width = box
    if is_circle:
        distance = ray_to_circle(px, py, radius, beams[0, k], beams[1, k])
    else:
        distance = ray_to_box(px, py, cosine, sine, half_length, half_width, beams[0, k], beams[1, k])
    if distance < ranges[i, column + k]:
        ranges[i, column + k] = distance


@inlined
def shorten_to_circle(beams, px, py, radius, ranges, i, column, first):
    """Shortens BESIDE beams, from the first on, to where they meet a circle.

    The arithmetic is that of `geometry.ray_to_circle` without a branch, and so are the bits.
    """
    for k in range(np.uint64(BESIDE)):
        ux = beams[0, first + k]
        uy = beams[1, first + k]
        along = px * ux + py * uy
        across = px * uy - py * ux
        half_chord_squared = radius * radius - across * across
        half_chord = math.sqrt(max(half_chord_squared, 0.0))
        distance = max(along - half_chord, 0.0)
        so_far = ranges[i, column + first + k]
        meets = (half_chord_squared >= 0.0) & (along + half_chord >= 0.0) & (distance < so_far)
        ranges[i, column + first + k] = distance if meets else so_far


@inlined
def shorten_to_box(beams, box, ranges, i, column, first):
    """Shortens BESIDE beams, from the first on, to where they meet a box or wall: as `geometry.ray_to_box` does."""
    cx, cy, cosine, sine, half_length, half_width = box
    px = -(cosine * cx + sine * cy)
    py = -(cosine * cy - sine * cx)
    for k in range(np.uint64(BESIDE)):
        ux = beams[0, first + k]
        uy = beams[1, first + k]
        vx = cosine * ux + sine * uy
        vy = cosine * uy - sine * ux
        # along a pair of sides it never gets to them: it is between them all the way, or beside them
        along_x = vx == 0.0
        along_y = vy == 0.0
        inverse_x = 1.0 / vx
        inverse_y = 1.0 / vy
        reach_x = abs(half_length * inverse_x)
        reach_y = abs(half_width * inverse_y)
        enter = 0.0 if along_x else max(0.0, -px * inverse_x - reach_x)
        leave = np.inf if along_x else min(np.inf, -px * inverse_x + reach_x)
        enter = enter if along_y else max(enter, -py * inverse_y - reach_y)
        leave = leave if along_y else min(leave, -py * inverse_y + reach_y)
        beside = (along_x & (abs(px) > half_length)) | (along_y & (abs(py) > half_width))
        meets = (not beside) & (not enter > leave)
        through = -py / vy
        is_wall = (half_width == 0.0) & (not along_y)
        meets = (through >= 0.0) & (abs(px + through * vx) <= half_length) if is_wall else meets
        distance = through if is_wall else enter
        so_far = ranges[i, column + first + k]
        ranges[i, column + first + k] = distance if meets & (distance < so_far) else so_far


@inlined
def add_range_noise(p, num_beams, noise, i, row, ranges, column):
    """Disturbs each range that hit something; a beam that meets nothing keeps max_range."""
    if p.range_noise > 0.0:
        for k in range(num_beams):
            distance = ranges[i, column + k]
            if distance < p.max_range:
                distance += p.range_noise * noise[i, row, BEAM_NOISE_COLUMN + k]
                ranges[i, column + k] = min(max(distance, 0.0), p.max_range)


@inlined
def drop_beams(p, num_beams, noise, i, row, ranges, column):
    """Empties each beam with the probability of a dropout: it reads max_range."""
    if p.dropout_below > -np.inf:
        for k in range(num_beams):
            if noise[i, row, BEAM_NOISE_COLUMN + num_beams + k] < p.dropout_below:
                ranges[i, column + k] = p.max_range
