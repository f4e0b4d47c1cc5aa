"""Lab 1: the look-ahead controller, and a path that breaks it."""

import numpy as np


def lookahead(pose: tuple[float, float, float], path: np.ndarray) -> tuple[float, float, float, float, float]:
    """Returns e_d (m), e_h, e_o (rad), v (m/s), w (rad/s) at a pose x, y (m), heading (rad); the path is (n, 2), m."""
    return 0.0, 0.0, 0.0, 0.0, 0.0


def offset(radius: float) -> float:
    """Returns how far outside a circle of that radius the robot settles, m."""
    return 0.0


BREAKS = [[0.0, 0.0], [4.0, 0.0]]  # a path, m, that the documented controller does not complete
