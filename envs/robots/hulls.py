"""How far the hull of a robot, a disc or a rectangle, is from what stands around it."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Robot
from wayfield.envs.world.blocks import BLOCK, nearest_block, next_block
from wayfield.envs.world.geometry import clearance
from wayfield.envs.world.grids import clearance_around, grid_clearance, grid_place, rows_away
from wayfield.system.compiled import compiled, inlined
from wayfield.system.elementary import sin_cos


def clearance_of(robot: Robot, obstacles: NDArray[np.void], count: int, pose: Any) -> float:
    """Returns the signed distance (m) from a robot's hull at a pose to the nearest of `count` obstacles; inf if none.

    Args:
        obstacles: (m,) OBSTACLE records, of which the first `count` are meant.
        pose: x, y (m), heading (rad).
    """
    x, y, heading = (float(each) for each in pose)
    if robot.hull_box is None:
        return float(clearance(obstacles, count, x, y)) - robot.hull_radius
    half_length, half_width = (0.5 * side for side in robot.hull_box)
    sine, cosine = sin_cos(heading)
    middle = x + robot.hull_x * cosine, y + robot.hull_x * sine, heading
    return float(boxes_clearance(obstacles, count, middle, half_length, half_width))


@inlined
def hull_clearance(p, robots, i, s, x, y, heading):
    """Returns the signed distance (m) from the hull of robot i at a pose to the nearest thing around it; inf if none.

    Args:
        p: a record with the fields of records.ROBOT_PARAMS.
        robots: `stepping.Robots`.
    """
    return clearance_among(robots.obstacles, p, robots, i, s, x, y, heading)


@inlined
def clearance_among(obstacles, p, robots, i, s, x, y, heading):
    """Returns `hull_clearance` among obstacles, which may be None: Numba leaves out the rest then."""
    if obstacles is None:
        return np.inf
    if p.hull_length > 0.0:
        return box_clearance(p, robots, i, s, x, y, heading)
    return clearance_around(robots, i, s, x, y) - p.hull_radius


@inlined
def swing(p, yaw_rate):
    """Returns the speed (m/s) at which a turn may bring a point of the hull nearer to something: none of a disc's."""
    return abs(yaw_rate) * p.hull_radius if p.hull_length > 0.0 else 0.0


@inlined
def least_reach(p):
    """Returns the radius (m) of the largest disc about the pose that the hull holds."""
    if p.hull_length > 0.0:
        return min(0.5 * p.hull_width, 0.5 * p.hull_length - abs(p.hull_x))
    return p.hull_radius


@compiled
def box_clearance(p, robots, i, s, x, y, heading):
    """Returns `hull_clearance` of a rectangle."""
    sine, cosine = sin_cos(heading)
    half_length = 0.5 * p.hull_length
    half_width = 0.5 * p.hull_width
    x += p.hull_x * cosine
    y += p.hull_x * sine
    pose = (x, y, cosine, sine)
    count = s.num_obstacles
    blocks = s.num_blocks
    if blocks == 0:
        nearest = nearer_rectangle(p, robots.obstacles, s.field, 0, count, pose, np.inf)
    else:
        k = nearest_block(robots.obstacles, s.field, count, blocks, x, y)
        last = min((k + 1) * BLOCK, count)
        nearest = nearer_rectangle(p, robots.obstacles, s.field, k * BLOCK, last, pose, np.inf)
        k = next_block(robots.obstacles, s.field, count, blocks, 0, x, y, nearest + p.hull_radius)
        while k < blocks:
            last = min((k + 1) * BLOCK, count)
            nearest = nearer_rectangle(p, robots.obstacles, s.field, k * BLOCK, last, pose, nearest)
            k = next_block(robots.obstacles, s.field, count, blocks, k + 1, x, y, nearest + p.hull_radius)
    if robots.grids.cells.shape[0] > 0:
        frame = robots.grids.frames[s.scenario]
        nearest = min(nearest, grid_rectangle_distance(frame, robots.grids.cells, pose, half_length, half_width))
    return nearest


@inlined
def nearer_rectangle(p, obstacles, i, first, last, pose, nearest):
    """Returns the least of `nearest` and the signed distances (m) from a robot's rectangle to obstacles of row i.

    Args:
        first, last: the obstacles meant, from the first on and without the last.
        pose: x, y (m) of its middle, cosine and sine of the heading.
    """
    x, y, cosine, sine = pose
    for j in range(first, last):
        obstacle = obstacles[i, j]
        # the discs around both are farther apart than what was found: most obstacles are no nearer
        dx = obstacle.x - x
        dy = obstacle.y - y
        reach = (
            nearest
            + p.hull_radius
            + obstacle.radius
            + math.sqrt(obstacle.half_length * obstacle.half_length + obstacle.half_width * obstacle.half_width)
        )
        if reach > 0.0 and dx * dx + dy * dy >= reach * reach:
            continue
        distance = rectangle_distance(obstacle, x, y, cosine, sine, 0.5 * p.hull_length, 0.5 * p.hull_width)
        nearest = min(nearest, distance)
    return nearest


@compiled
def boxes_clearance(obstacles, count, pose, half_length, half_width):
    """Returns the signed distance (m) from a rectangle to the nearest of the first `count` obstacles; inf if none.

    Args:
        pose: x, y (m), heading (rad) of its middle.
        half_length, half_width: m, along and across the heading.
    """
    x, y, heading = pose
    sine, cosine = sin_cos(heading)
    nearest = np.inf
    for j in range(count):
        nearest = min(nearest, rectangle_distance(obstacles[j], x, y, cosine, sine, half_length, half_width))
    return nearest


@compiled
def rectangle_distance(obstacle, x, y, cosine, sine, half_length, half_width):
    """Returns the signed distance (m) from a rectangle at (x, y), its long axis along (cosine, sine), to an obstacle.

    Where they overlap it is the negative length of the shortest way apart.
    """
    # the obstacle in the rectangle's frame
    dx = obstacle.x - x
    dy = obstacle.y - y
    px = cosine * dx + sine * dy
    py = cosine * dy - sine * dx
    if obstacle.half_length == 0.0 and obstacle.half_width == 0.0:
        along = abs(px) - half_length
        across = abs(py) - half_width
        outside = math.sqrt(max(along, 0.0) ** 2 + max(across, 0.0) ** 2)
        return outside + min(max(along, across), 0.0) - obstacle.radius
    c = obstacle.cos * cosine + obstacle.sin * sine
    s = obstacle.sin * cosine - obstacle.cos * sine
    sizes = (half_length, half_width, obstacle.half_length, obstacle.half_width)
    return rectangles_apart(px, py, c, s, sizes) - obstacle.radius


@inlined
def rectangles_apart(px, py, c, s, sizes):
    """Returns the signed distance between a rectangle at the origin and one at (px, py), its long axis along (c, s).

    Apart, the distance is that of a corner of one to the other. Where they overlap no axis of a side separates them
    (Gottschalk, Lin and Manocha, SIGGRAPH 1996), and the one along which they overlap least tells how deep.

    Args:
        sizes: half the length and the width of the first, then of the other.
    """
    a, b, h, w = sizes
    # the first in the frame of the other
    qx = -(c * px + s * py)
    qy = -(c * py - s * px)
    separation = max(
        abs(px) - a - h * abs(c) - w * abs(s),
        abs(py) - b - h * abs(s) - w * abs(c),
        abs(qx) - h - a * abs(c) - b * abs(s),
        abs(qy) - w - a * abs(s) - b * abs(c),
    )
    if separation > 0.0:
        squared = np.inf
        for corner in range(4):
            u = h if corner & 1 else -h
            v = w if corner & 2 else -w
            gap_x = max(abs(px + c * u - s * v) - a, 0.0)
            gap_y = max(abs(py + s * u + c * v) - b, 0.0)
            squared = min(squared, gap_x * gap_x + gap_y * gap_y)
            u = a if corner & 1 else -a
            v = b if corner & 2 else -b
            gap_x = max(abs(qx + c * u + s * v) - h, 0.0)
            gap_y = max(abs(qy - s * u + c * v) - w, 0.0)
            squared = min(squared, gap_x * gap_x + gap_y * gap_y)
        separation = math.sqrt(squared)
    return separation


@compiled
def grid_rectangle_distance(frame, cells, pose, half_length, half_width):
    """Returns the signed distance (m) from a rectangle to what is occupied in a scenario's grid; inf where nothing is.

    Column after column, outwards from the rectangle's middle, until the next is farther away than what was found; in a
    column from one occupied cell to the next. Where they overlap it is that to the cell that is overlapped most.

    Args:
        pose: x, y (m) of its middle, cosine and sine of its heading.
    """
    if frame.grid_cell == 0.0:
        return np.inf
    x, y, cosine, sine = pose
    u, v = grid_place(frame, x, y)
    c = cosine * frame.grid_cos + sine * frame.grid_sin
    s = sine * frame.grid_cos - cosine * frame.grid_sin
    a = half_length / frame.grid_cell
    b = half_width / frame.grid_cell
    rows = frame.grid_rows
    columns = frame.grid_columns
    wide = a * abs(c) + b * abs(s)
    high = a * abs(s) + b * abs(c)
    best = np.inf
    if frame.grid_closed == 1:
        best = min(u - wide, columns - u - wide, v - high, rows - v - high)
        # said so that a place that is no number is none within
        if not best > 0.0:
            return best * frame.grid_cell
    # the rectangle holds the disc about its middle that is as wide as it
    best = min(best, grid_clearance(frame, cells, x, y) / frame.grid_cell - min(a, b))
    middle = int(min(max(0.0, math.floor(u)), columns - 1.0))
    sizes = (a, b, 0.5, 0.5)
    for k in range(columns):
        # what the nearer side of the columns k to the right and to the left has to the rectangle's box, at least
        right = middle + k - (u + wide)
        left = (u - wide) - (middle - k + 1)
        if right > best and left > best:
            break
        for side in range(1 if k == 0 else 2):
            column = middle - k if side else middle + k
            if not (0 <= column < columns) or (left if side else right) > best:
                continue
            row: Any = int(min(max(0.0, math.floor(v - high - best)), rows - 1.0))
            while row < rows and row - (v + high) <= best:
                away = rows_away(frame, cells, row, column)
                if away > 0:
                    row += away
                    continue
                dx = column + 0.5 - u
                dy = row + 0.5 - v
                best = min(best, rectangles_apart(c * dx + s * dy, c * dy - s * dx, c, -s, sizes))
                row += 1
    return best * frame.grid_cell


@compiled
def touched(p, robots, i, s, j, x, y, heading):
    """Returns how deep (m) the hull of robot i at a pose is in obstacle j around it, or for j = -1 in its grid.

    It is the rectangle's; negative where they are apart.
    """
    sine, cosine = sin_cos(heading)
    half_length = 0.5 * p.hull_length
    half_width = 0.5 * p.hull_width
    x += p.hull_x * cosine
    y += p.hull_x * sine
    if j >= 0:
        return -rectangle_distance(robots.obstacles[s.field, j], x, y, cosine, sine, half_length, half_width)
    frame = robots.grids.frames[s.scenario]
    return -grid_rectangle_distance(frame, robots.grids.cells, (x, y, cosine, sine), half_length, half_width)


@compiled
def way_out(p, robots, i, s, j, x, y, heading):
    """Returns the unit vector along which the rectangle of `touched` comes out fastest, by central differences."""
    h = 1e-7
    nx = touched(p, robots, i, s, j, x - h, y, heading) - touched(p, robots, i, s, j, x + h, y, heading)
    ny = touched(p, robots, i, s, j, x, y - h, heading) - touched(p, robots, i, s, j, x, y + h, heading)
    size = math.sqrt(nx * nx + ny * ny)
    return (nx / size, ny / size) if size > 0.0 else (0.0, 0.0)
