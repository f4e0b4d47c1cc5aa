"""Circles, boxes and walls as OBSTACLE records. A mass of 0 fixes an obstacle to the floor."""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.geometry import OBSTACLE
from wayfield.envs.scenarios.validation import checked_number


def circle(x: float, y: float, radius: float, mass: float = 0.0) -> np.void:
    """Returns the OBSTACLE record of a disc.

    Args:
        x, y: centre, m.
        radius: m, above 0.
        mass: kg; 0 when fixed.

    Raises:
        ValueError: if a value is not finite or out of its range; the message names field and value.
    """
    return _record(
        checked_number("circle x", x),
        checked_number("circle y", y),
        radius=checked_number("circle radius", radius, above=0.0),
        mass=checked_number("circle mass", mass, least=0.0),
    )


def box(x: float, y: float, length: float, width: float, heading: float = 0.0, mass: float = 0.0) -> np.void:
    """Returns the OBSTACLE record of a rectangle.

    Args:
        x, y: centre, m.
        length: side along the heading, m, above 0.
        width: side across the heading, m, above 0.
        heading: rad.
        mass: kg; 0 when fixed.

    Raises:
        ValueError: if a value is not finite or out of its range; the message names field and value.
    """
    heading = checked_number("box heading", heading)
    return _record(
        checked_number("box x", x),
        checked_number("box y", y),
        direction=(math.cos(heading), math.sin(heading)),
        half_length=checked_number("box length", length, above=0.0) / 2,
        half_width=checked_number("box width", width, above=0.0) / 2,
        mass=checked_number("box mass", mass, least=0.0),
    )


def wall(x1: float, y1: float, x2: float, y2: float) -> np.void:
    """Returns the OBSTACLE record of a wall without thickness, fixed to the floor.

    Args:
        x1, y1: one end, m.
        x2, y2: the other end, m.

    Raises:
        ValueError: if a value is not finite or both ends are the same point; the message names field and
            value.
    """
    x1, y1 = checked_number("wall x1", x1), checked_number("wall y1", y1)
    x2, y2 = checked_number("wall x2", x2), checked_number("wall y2", y2)
    length = math.hypot(x2 - x1, y2 - y1)
    if length == 0.0:
        raise ValueError(f"wall x2, y2 is {(x2, y2)}, the same as x1, y1; the ends of a wall must differ")
    return _record(
        (x1 + x2) / 2,
        (y1 + y2) / 2,
        direction=((x2 - x1) / length, (y2 - y1) / length),
        half_length=length / 2,
    )


def obstacle_field(*obstacles: np.void) -> NDArray[np.void]:
    """Returns the records as a read-only array of dtype OBSTACLE and shape (number of records,)."""
    field = np.array(list(obstacles), OBSTACLE)
    field.setflags(write=False)
    return field


def described(obstacle: np.void) -> str:
    """Returns an obstacle in words, for messages, such as "circle of radius 0.3 m at (1, 2)"."""
    at = f"at ({obstacle['x']:g}, {obstacle['y']:g})"
    if obstacle["half_length"] == 0.0 and obstacle["half_width"] == 0.0:
        return f"circle of radius {obstacle['radius']:g} m {at}"
    if obstacle["half_width"] == 0.0:
        return f"wall of length {2 * obstacle['half_length']:g} m {at}"
    return f"box of {2 * obstacle['half_length']:g} x {2 * obstacle['half_width']:g} m {at}"


def _record(
    x: float,
    y: float,
    *,
    direction: tuple[float, float] = (1.0, 0.0),
    half_length: float = 0.0,
    half_width: float = 0.0,
    radius: float = 0.0,
    mass: float = 0.0,
) -> np.void:
    field: NDArray[np.void] = np.array([(x, y, *direction, half_length, half_width, radius, mass)], OBSTACLE)
    record: np.void = field[0]
    return record
