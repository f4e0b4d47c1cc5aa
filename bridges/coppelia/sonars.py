"""Sonars of the P3DX: the nearest point of a surface in the sensor's sector.

The sector has 15 degrees to each side of the axis and 1 m of reach. A point is detected only if the surface normal is
within 45 degrees of the ray. Both conditions, and the extent of a straight face, are intervals of bearings. The
distance to a face grows with the angle from its perpendicular, to a disc with the angle from its centre. Hence the
nearest point lies at the bearing of the common interval nearest to that direction; no rays are sampled.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

HALF_ANGLE = math.radians(15.0)
REACH = 1.0  # m
BLIND = 0.05  # m; a nearer surface hides everything
INCIDENCE = math.radians(45.0)


class Echo(NamedTuple):
    """The detected point, relative to the sensor's axis."""

    distance: float  # m
    aside: float  # rad, bearing from the axis, + to the left
    normal: float  # rad, direction of the surface's normal from the axis
    obstacle: int  # index


def echo(x: float, y: float, bearing: float, obstacles: Iterable[Any]) -> Echo | None:
    """Returns the echo of OBSTACLE records at a sonar at (x, y) with an axis along `bearing`, or None."""
    best: Echo | None = None
    for j, obstacle in enumerate(obstacles):
        cx, cy, cosine, sine, half_length, half_width, radius, *_ = obstacle
        dx, dy = cx - x, cy - y
        far = REACH + radius + half_length + half_width
        if dx * dx + dy * dy > far * far:
            continue
        if half_length == 0.0 and half_width == 0.0:
            hits = [_of_disc(dx, dy, radius, bearing)]
        else:
            hits = [_of_face(*face, bearing) for face in _faces(dx, dy, cosine, sine, half_length, half_width, radius)]
        for hit in hits:
            if hit is not None and (best is None or hit[0] < best.distance):
                best = Echo(*hit, j)
    return best if best is not None and BLIND <= best.distance <= REACH else None


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def _nearest(to: float, low: float, high: float) -> float | None:
    """Returns the number of [low, high] nearest to another; None for an empty interval."""
    return min(max(to, low), high) if low <= high else None


def _of_disc(dx: float, dy: float, radius: float, bearing: float) -> tuple[float, float, float] | None:
    """Returns distance, bearing from the axis and normal of the nearest point of a disc."""
    distance = math.hypot(dx, dy)
    if distance <= radius:
        return 0.0, 0.0, 0.0  # inside: blind
    middle = _wrapped(math.atan2(dy, dx) - bearing)
    # sin(incidence) = distance sin(offset) / radius
    widest = math.asin(min(radius * math.sin(INCIDENCE) / distance, 1.0))
    aside = _nearest(middle, max(-HALF_ANGLE, middle - widest), min(HALF_ANGLE, middle + widest))
    if aside is None:
        return None
    offset = aside - middle
    across = distance * math.sin(offset)
    reach = distance * math.cos(offset) - math.sqrt(max(radius * radius - across * across, 0.0))
    # from the centre to the point
    normal = math.atan2(
        reach * math.sin(aside) - distance * math.sin(middle), reach * math.cos(aside) - distance * math.cos(middle)
    )
    return reach, aside, normal


def _faces(
    dx: float, dy: float, cosine: float, sine: float, half_length: float, half_width: float, radius: float
) -> Iterator[tuple[float, float, float, float]]:
    """Yields the straight faces of a box or a wall towards the sensor.

    Each is (direction of its perpendicular, length of that, ends of the face to the right and to the left of the
    foot), rad and m.
    """
    # the sensor in the frame of the obstacle
    along = -(cosine * dx + sine * dy)
    across = -(cosine * dy - sine * dx)
    heading = math.atan2(sine, cosine)
    half_width += radius
    half_length += radius if half_length > 0.0 else 0.0
    inside = abs(along) < half_length and abs(across) < half_width
    if inside:
        yield heading, 0.0, 0.0, 0.0
        return
    gap = abs(across) - half_width
    if gap >= 0.0:
        way = -math.copysign(1.0, across)  # towards the face
        yield heading + way * 0.5 * math.pi, gap, *_sides(-way * along, half_length)
    gap = abs(along) - half_length
    if gap >= 0.0 and half_width > 0.0:
        way = -math.copysign(1.0, along)
        yield heading + (0.0 if way > 0.0 else math.pi), gap, *_sides(way * across, half_width)


def _sides(place: float, half: float) -> tuple[float, float]:
    """Returns the ends of a face to the right and to the left of a place on it, m."""
    return -half - place, half - place


def _of_face(
    direction: float, gap: float, right: float, left: float, bearing: float
) -> tuple[float, float, float] | None:
    """Returns distance, bearing from the axis and normal of the nearest point of a straight face."""
    if gap <= 0.0:
        # on the face or inside: blind, if the sector has any of it
        return (0.0, 0.0, 0.0) if right <= 0.0 <= left else None
    middle = _wrapped(direction - bearing)
    low = max(-HALF_ANGLE, middle - INCIDENCE, middle + math.atan2(right, gap))
    high = min(HALF_ANGLE, middle + INCIDENCE, middle + math.atan2(left, gap))
    aside = _nearest(middle, low, high)
    if aside is None:
        return None
    return gap / math.cos(aside - middle), aside, _wrapped(middle + math.pi)
