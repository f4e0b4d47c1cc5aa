"""Circles, boxes and walls as OBSTACLE records: what stands, what can be pushed, and what moves by a script."""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.world.geometry import OBSTACLE
from wayfield.envs.world.movers import motion_at
from wayfield.system.checks import FASTEST, FINEST, HEAVIEST, LIGHTEST, LONGEST, SHORTEST, number
from wayfield.system.checks import heading as checked_heading
from wayfield.system.elementary import sin_cos


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
        number("circle x", x),
        number("circle y", y),
        radius=number("circle radius", radius, least=FINEST),
        mass=_mass("circle mass", mass),
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
    sine, cosine = sin_cos.py_func(checked_heading("box heading", heading))  # the presets are made by every command
    return _record(
        number("box x", x),
        number("box y", y),
        direction=(cosine, sine),
        half_length=number("box length", length, least=FINEST) / 2,
        half_width=number("box width", width, least=FINEST) / 2,
        mass=_mass("box mass", mass),
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
    x1, y1 = number("wall x1", x1), number("wall y1", y1)
    x2, y2 = number("wall x2", x2), number("wall y2", y2)
    length = math.hypot(x2 - x1, y2 - y1)
    if length == 0.0:
        raise ValueError(f"wall x2, y2 is {(x2, y2)}, the same as x1, y1; the ends of a wall must differ")
    return _record(
        (x1 + x2) / 2,
        (y1 + y2) / 2,
        direction=((x2 - x1) / length, (y2 - y1) / length),
        half_length=length / 2,
    )


def moving_circle(
    x: float, y: float, radius: float, vx: float, vy: float, leg_time: float, phase: float = 0.0
) -> np.void:
    """Returns the OBSTACLE record of a disc that goes to and fro on a line, whatever it meets.

    Args:
        x, y: centre where the first leg begins, m.
        radius: m, above 0.
        vx, vy: velocity on the first leg, m/s; the next is the way back.
        leg_time: s, of one leg, above 0.
        phase: s, how far into the patrol the disc is when the episode starts.

    Raises:
        ValueError: if a value is not finite or out of its range; the message names field and value.
    """
    values = (
        number("circle x", x),
        number("circle y", y),
        number("patrol vx", vx, most=FASTEST),
        number("patrol vy", vy, most=FASTEST),
        number("patrol leg_time", leg_time, least=SHORTEST, most=LONGEST),
        number("patrol phase", phase, least=0.0, most=LONGEST),
    )
    disc = circle(values[0], values[1], radius)
    disc["patrol"] = values
    disc["x"], disc["y"], _, _ = motion_at(disc, 0.0)
    return disc


def _mass(field: str, mass: float) -> float:
    """Returns the mass (kg) of what can be pushed, or 0 for what is fixed."""
    return 0.0 if mass == 0 and not isinstance(mass, bool) else number(field, mass, least=LIGHTEST, most=HEAVIEST)


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


_STANDS = (0.0,) * 6  # a PATROL


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
    field: NDArray[np.void] = np.array([(x, y, *direction, half_length, half_width, radius, mass, _STANDS)], OBSTACLE)
    record: np.void = field[0]
    return record
