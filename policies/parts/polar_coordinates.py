"""Feedback of the polar coordinates of a pose: see `Polar`."""

import math

from wayfield.system.compiled import inlined
from wayfield.system.elementary import bearing, wrap_angle


@inlined
def polar_twist(p, px, py, turn):
    """Returns (v, w) of the law towards a pose at (px, py) in the robot's frame (m), its heading `turn` (rad) off.

    p: a record with the gains k_rho, k_alpha, k_beta (1/s) and the bounds max_speed, max_yaw_rate and deceleration.
    """
    rho = math.sqrt(px * px + py * py)
    alpha = bearing(py, px)
    beta = wrap_angle(turn - alpha)
    v = p.k_rho * rho
    w = p.k_alpha * alpha + p.k_beta * beta
    share = min(1.0, p.max_speed / v, math.sqrt(2.0 * p.deceleration * rho) / v, p.max_yaw_rate / max(abs(w), 1e-12))
    return share * v, share * w
