"""Angles, and the union of circles, boxes and walls that rays, contacts and the physics engine share.

One record describes every shape: half extents, an angle, and a radius. A circle has half extents of zero, a wall has a
half width of zero, boxes and walls have a radius of zero. One signed distance therefore serves every kind, and the ray
query ends on the very surface that the distance query measures to.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.world.movers import PATROL
from wayfield.system.compiled import compiled, inlined

OBSTACLE = np.dtype(
    [
        ("x", np.float64),  # centre, m
        ("y", np.float64),  # centre, m
        ("cos", np.float64),  # of the heading of the long axis
        ("sin", np.float64),
        ("half_length", np.float64),  # along the heading, m; 0 for a circle
        ("half_width", np.float64),  # across the heading, m; 0 for a circle and for a wall
        ("radius", np.float64),  # m; 0 for a box and for a wall
        ("mass", np.float64),  # kg; 0 when the obstacle is fixed to the floor, or to its patrol
        ("patrol", PATROL),  # by which it moves; leg_time 0 where it stands
    ]
)

Bounds = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max, m

# Of a world that is much larger than what is done in it, a picture shows a square about that.
_AROUND = 1.0 / 3.0  # of the extent, on each side
_LEAST_AROUND = 2.0  # m
_LARGE = 2.0  # times the square, from which on a world is not shown whole

MANY = 48  # obstacles, of more than which those out of reach are passed over


def lengths(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the lengths (...) of vectors (..., 2): a square root has the same bits everywhere, `np.hypot` not."""
    sizes: NDArray[np.float64] = np.sqrt(vectors[..., 0] * vectors[..., 0] + vectors[..., 1] * vectors[..., 1])
    return sizes


@inlined
def clearance_to(obstacle, x, y):
    """Returns the signed distance (m) from the point (x, y) to the obstacle's surface, negative inside it."""
    dx = x - obstacle.x
    dy = y - obstacle.y
    if obstacle.half_length + obstacle.half_width == 0.0 and obstacle.cos == 1.0:
        # a circle that was never turned: the bits of what follows, sooner
        return math.sqrt(dx * dx + dy * dy) - obstacle.radius
    across = abs(obstacle.cos * dy - obstacle.sin * dx) - obstacle.half_width
    along = abs(obstacle.cos * dx + obstacle.sin * dy) - obstacle.half_length
    outside = math.sqrt(max(along, 0.0) ** 2 + max(across, 0.0) ** 2)
    return outside + min(max(along, across), 0.0) - obstacle.radius


@compiled
def clearance(obstacles, count, x, y):
    """Returns the signed distance (m) from (x, y) to the nearest of the first `count` obstacles; inf if none."""
    nearest = np.inf
    for j in range(count):
        nearest = min(nearest, clearance_to(obstacles[j], x, y))
    return nearest


@inlined
def beyond(obstacle, x, y, reach):
    """Returns whether all of an obstacle is certainly farther from (x, y) than `reach` (m)."""
    dx = obstacle.x - x
    dy = obstacle.y - y
    reach += obstacle.half_length + obstacle.half_width + obstacle.radius
    # more than rounding would take off
    return reach > 0.0 and dx * dx + dy * dy > 1.000001 * reach * reach


@inlined
def row_clearance(obstacles, i, count, x, y):
    """Returns `clearance` for row i of a batch of obstacles (b, m); a view of the row would cost more than the work."""
    nearest = np.inf
    if count > MANY:
        # what lies farther off than the nearest so far is not measured
        for j in range(count):
            if not beyond(obstacles[i, j], x, y, nearest):
                nearest = min(nearest, clearance_to(obstacles[i, j], x, y))
        return nearest
    for j in range(count):
        nearest = min(nearest, clearance_to(obstacles[i, j], x, y))
    return nearest


@compiled
def nearest_surface(obstacle, x, y):
    """Returns (distance, nx, ny): signed distance (m) to the obstacle and the unit vector away from it at (x, y)."""
    dx = x - obstacle.x
    dy = y - obstacle.y
    along = obstacle.cos * dx + obstacle.sin * dy
    across = obstacle.cos * dy - obstacle.sin * dx
    out_along = abs(along) - obstacle.half_length
    out_across = abs(across) - obstacle.half_width
    if out_along > 0.0 or out_across > 0.0:
        a = math.copysign(max(out_along, 0.0), along)
        b = math.copysign(max(out_across, 0.0), across)
        size = math.sqrt(a * a + b * b)
    else:
        # inside the core: the nearest side, and the middle of a circle looks along its axis
        size = 1.0
        a = math.copysign(1.0, along) if out_along >= out_across else 0.0
        b = 0.0 if out_along >= out_across else math.copysign(1.0, across)
    a /= size
    b /= size
    return (
        clearance_to(obstacle, x, y),
        obstacle.cos * a - obstacle.sin * b,
        obstacle.sin * a + obstacle.cos * b,
    )


@inlined
def ray_to_circle(cx, cy, radius, ux, uy):
    """Returns the distance (m) from the origin along the unit vector (ux, uy) to a circle at (cx, cy); inf if missed.

    A ray that starts inside has distance 0.
    """
    along = cx * ux + cy * uy
    across = cx * uy - cy * ux
    # the cross product keeps the digits that |c|^2 - along^2 would cancel
    half_chord_squared = radius * radius - across * across
    if half_chord_squared < 0.0:
        return np.inf
    half_chord = math.sqrt(half_chord_squared)
    if along + half_chord < 0.0:
        return np.inf
    return max(along - half_chord, 0.0)


@inlined
def ray_to_box(cx, cy, cosine, sine, half_length, half_width, ux, uy):
    """Returns the distance (m) from the origin along the unit vector (ux, uy) to a box or wall; inf if missed.

    The box stands at (cx, cy) with its long axis along (cosine, sine). The ray is clipped against one pair of sides
    after the other; one that starts inside has distance 0.
    """
    px = -(cosine * cx + sine * cy)
    py = -(cosine * cy - sine * cx)
    vx = cosine * ux + sine * uy
    vy = cosine * uy - sine * ux
    if half_width == 0.0 and vy != 0.0:
        distance = -py / vy
        return distance if distance >= 0.0 and abs(px + distance * vx) <= half_length else np.inf
    enter, leave = clipped(px, vx, half_length, 0.0, np.inf)
    enter, leave = clipped(py, vy, half_width, enter, leave)
    return enter if enter <= leave else np.inf


@inlined
def clipped(place, way, half, enter, leave):
    """Returns the part of a ray, from `enter` to `leave`, between the sides at -half and half; (inf, -inf) for none.

    place, way: of the ray along the axis across the sides.
    """
    if way == 0.0:
        return (enter, leave) if abs(place) <= half else (np.inf, -np.inf)
    inverse = 1.0 / way
    reach = abs(half * inverse)
    return max(enter, -place * inverse - reach), min(leave, -place * inverse + reach)


def corners_of(obstacles: NDArray[np.void]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the lower left and the upper right corners (n, 2) of upright boxes that obstacles (n,) just fit in."""
    length, width, cosine, sine = (np.abs(obstacles[name]) for name in ("half_length", "half_width", "cos", "sin"))
    reach = np.column_stack([cosine * length + sine * width, sine * length + cosine * width])
    reach += obstacles["radius"][:, None]
    centres = np.column_stack([obstacles["x"], obstacles["y"]])
    return centres - reach, centres + reach


def surroundings(near: NDArray[np.float64], world: NDArray[np.float64]) -> Bounds | None:
    """Returns what a picture of a large world shows: a square about points, cut off where the world ends.

    None where the world is not large beside that: it is shown whole.

    Args:
        near: (n, 2) m, what is done in the world.
        world: (m, 2) m, points between which the world lies.
    """
    low, high = near.min(axis=0), near.max(axis=0)
    first, last = np.minimum(world.min(axis=0), low), np.maximum(world.max(axis=0), high)
    extent = float((high - low).max())
    half = 0.5 * extent + max(_AROUND * extent, _LEAST_AROUND)
    if float((last - first).max()) <= _LARGE * 2.0 * half:
        return None
    middle, rim = 0.5 * (low + high), 0.04 * half  # so that the sides of the world are seen
    (x0, y0), (x1, y1) = np.maximum(middle - half, first - rim), np.minimum(middle + half, last + rim)
    return float(x0), float(y0), float(x1), float(y1)
