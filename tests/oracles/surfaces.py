"""Distances to obstacles, not by the formula under test: measured to the nearest point of a rectangle."""

import numpy as np
from numpy.typing import NDArray


def clearances(obstacles: NDArray[np.void], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns distances (k,) from points (k, 2) to the nearest surface, 0 inside."""
    nearest = np.full(len(points), np.inf)
    for o in obstacles:
        along, across = np.array([o["cos"], o["sin"]]), np.array([-o["sin"], o["cos"]])
        offset = points - [o["x"], o["y"]]
        u = np.clip(offset @ along, -o["half_length"], o["half_length"])
        v = np.clip(offset @ across, -o["half_width"], o["half_width"])
        gap = np.linalg.norm(offset - u[:, None] * along - v[:, None] * across, axis=1) - o["radius"]
        nearest = np.minimum(nearest, np.maximum(gap, 0.0))
    return nearest
