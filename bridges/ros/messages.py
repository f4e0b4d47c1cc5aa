"""What passes between robot and driver, as plain values in SI units: x ahead, y left, counter-clockwise (REP 103)."""

import dataclasses
import math
import struct

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, slots=True)
class Twist:
    """A body twist: m/s ahead and to the left, rad/s."""

    vx: float = 0.0
    vy: float = 0.0
    yaw_rate: float = 0.0

    @property
    def is_finite(self) -> bool:
        """Returns whether every component is a number."""
        return math.isfinite(self.vx) and math.isfinite(self.vy) and math.isfinite(self.yaw_rate)


STILL = Twist()


@dataclasses.dataclass(frozen=True, slots=True)
class Odometry:
    """A measured pose in the odometry's frame and the measured body twist."""

    stamp: float  # s, of the header
    frame: str
    x: float  # m
    y: float
    heading: float  # rad
    twist: Twist = STILL

    @property
    def is_finite(self) -> bool:
        """Returns whether pose and twist are numbers."""
        return math.isfinite(self.x + self.y + self.heading) and self.twist.is_finite


@dataclasses.dataclass(frozen=True, slots=True)
class Scan:
    """A scan as sensor_msgs/LaserScan has it: beam k looks along angle_min + k angle_increment."""

    stamp: float  # s, of the header
    angle_min: float  # rad, frame of the scanner
    angle_max: float
    angle_increment: float  # either sign
    range_min: float  # m
    range_max: float
    ranges: NDArray[np.float64]  # (n,) m


@dataclasses.dataclass(frozen=True, slots=True)
class Goal:
    """A pose to reach; a heading that is NaN is any."""

    frame: str
    x: float  # m
    y: float
    heading: float = math.nan  # rad


def path_of(content: bytes) -> tuple[str, NDArray[np.float64]]:
    """Returns the frame and the points (n, 2), m, of a nav_msgs/Path as it comes from the network (CDR).

    rclpy makes an object of every pose, and lets no other thread run meanwhile: 1.4 s for 20,000 poses.

    Raises:
        ValueError: if the bytes are no such message.
    """
    order = "<" if content[1:2] == b"\x01" else ">"
    at = 4  # behind the encapsulation, from which on numbers are aligned

    def header() -> str:
        nonlocal at
        at += -at % 4 + 8  # the stamp
        (length,) = struct.unpack_from(f"{order}I", content, at)
        text = content[at + 4 : at + 3 + length]
        at += 4 + length
        return text.decode("utf-8", "replace")

    try:
        frame = header()
        at += -at % 4
        (count,) = struct.unpack_from(f"{order}I", content, at)
        at += 4
        points = []
        for _ in range(count):
            header()
            at += (4 - at) % 8
            points.append(struct.unpack_from(f"{order}2d", content, at))
            at += 56
    except struct.error as error:
        raise ValueError(f"path cannot be read: {error}") from None
    return frame, np.array(points, np.float64).reshape(-1, 2)


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Returns the yaw (rad) of a quaternion; NaN where it has no length."""
    if not x * x + y * y + z * z + w * w > 0.0:
        return math.nan
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def quaternion_of(yaw: float) -> tuple[float, float]:
    """Returns z and w of the quaternion that turns by a yaw (rad)."""
    return math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def wrapped(angle: float) -> float:
    """Returns an angle (rad) in [-pi, pi]."""
    return math.remainder(angle, 2.0 * math.pi)
