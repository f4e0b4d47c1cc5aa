"""Lab 1, model answer."""

import math

import numpy as np

LOOKAHEAD, K_LIN, K_ANG, K_ORI, MODE_DISTANCE = 0.5, 1.2, 0.8, 8.0, 0.05


def lookahead(pose: tuple[float, float, float], path: np.ndarray) -> tuple[float, float, float, float, float]:
    """Returns e_d (m), e_h, e_o (rad), v (m/s), w (rad/s) at a pose x, y (m), heading (rad); the path is (n, 2), m."""
    x, y, heading = pose
    cosine, sine = math.cos(heading), math.sin(heading)
    ahead = np.array([x + LOOKAHEAD * cosine, y + LOOKAHEAD * sine])
    starts, legs = path[:-1], np.diff(path, axis=0)
    share = np.clip(((ahead - starts) * legs).sum(1) / (legs**2).sum(1), 0.0, 1.0)
    feet = starts + share[:, None] * legs
    distances = np.hypot(*(feet - ahead).T)
    k = int(np.argmin(distances))
    (dx, dy), at_its_end = feet[k] - (x, y), share[k] == 1.0 and k + 1 < len(legs)
    leg = legs[k + 1] if at_its_end else legs[k]  # at a corner: the segment that leaves it
    e_d, aside = cosine * dx + sine * dy, cosine * dy - sine * dx
    e_h, turn = math.atan2(aside, e_d), math.atan2(leg[1], leg[0]) - heading
    e_o = math.atan2(math.sin(turn), math.cos(turn))
    mode = math.exp(-math.hypot(e_d, aside) / MODE_DISTANCE)
    return e_d, e_h, e_o, K_LIN * e_d, K_ANG * (1.0 - mode) * e_h + K_ORI * mode * e_o


def offset(radius: float) -> float:
    """Returns how far outside a circle of that radius the robot settles, m.

    On a circle of radius rho, tangentially: the look-ahead point lies at the angle phi = atan(L / rho), the reference
    point at the same angle on the path. The turn is steady where w = v / rho; found by bisection in rho.
    """
    low, high = radius, radius + LOOKAHEAD
    while high - low > 1e-9:
        rho = (low + high) / 2
        phi = math.atan(LOOKAHEAD / rho)
        forward, inward = radius * math.sin(phi), rho - radius * math.cos(phi)
        turns_too_slowly = K_ANG * math.atan2(inward, forward) < K_LIN * forward / rho
        low, high = (rho, high) if turns_too_slowly else (low, rho)
    return low - radius


# a loop that crosses its own way in: the point ahead is nearest to the way out, and the loop is left out
TURNS = np.linspace(0.0, 2.0 * np.pi, 60)
BREAKS = [[0.0, 0.0], *([3.0 + 0.8 * math.sin(a), 0.8 - 0.8 * math.cos(a)] for a in TURNS), [6.0, 0.0]]
