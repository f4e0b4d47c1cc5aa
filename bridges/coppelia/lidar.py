"""The planar lidar of the P3DX: CoppeliaSim's fastHokuyo, 684 beams over 240 degrees with a reach of 5 m."""

import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.world.geometry import ray_to_box, ray_to_circle
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos

BEAMS = 684
REACH = 5.0  # m; a beam that meets nothing reads it
_FIELD = math.radians(240.0)
ANGLES = np.linspace(-0.5 * _FIELD + _FIELD / BEAMS, 0.5 * _FIELD, BEAMS)  # rad, from right to left, 0 ahead

# The signals that scripts read, packed as float32: the distances (m), and the angles of the beams (rad).
RANGE_SIGNALS = ("PioneerP3dxLidarData", "hokuyo_range_data")
ANGLE_SIGNAL = "hokuyo_angle_data"


@compiled
def scan(obstacles, count, x, y, heading, angles, reach, ranges):
    """Writes the distance (m) along each beam from (x, y) to the nearest of `count` obstacles, at most `reach`."""
    ranges[:] = reach
    for k in range(len(angles)):
        uy, ux = sin_cos(heading + angles[k])
        for j in range(count):
            o = obstacles[j]
            cx = o.x - x
            cy = o.y - y
            if o.half_length == 0.0 and o.half_width == 0.0:
                distance = ray_to_circle(cx, cy, o.radius, ux, uy)
            else:
                half_length = o.half_length + (o.radius if o.half_length > 0.0 else 0.0)
                distance = ray_to_box(cx, cy, o.cos, o.sin, half_length, o.half_width + o.radius, ux, uy)
            ranges[k] = min(ranges[k], distance)


def packed(values: NDArray[np.float64]) -> bytes:
    """Returns numbers as little-endian float32, as `sim.packFloatTable` does."""
    return values.astype("<f4").tobytes()


def points(ranges: NDArray[np.float64], side: int) -> list[float]:
    """Returns a half of the beams as `sim.readVisionSensor` reports them: width, height, and x, y, z, distance each.

    Args:
        side: 0 is the right half, 1 the left one.
    """
    half = slice(side * BEAMS // 2, (side + 1) * BEAMS // 2)
    angles, distances = ANGLES[half], ranges[half]
    rows = np.column_stack([distances * np.cos(angles), distances * np.sin(angles), np.zeros(len(angles)), distances])
    return [float(len(angles)), 1.0, *rows.ravel().tolist()]
