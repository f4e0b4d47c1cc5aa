"""A plan of speeds and yaw rates driven by the plant's own model, and its derivatives: what predictive laws share.

m is a record with `plant` (see `params.PLANT`), and substeps, control periods in a step.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots.kinematics import integrate_arc, sinc
from wayfield.system.compiled import inlined
from wayfield.system.elementary import sin_cos

Array = NDArray[np.float64]


class Slopes(NamedTuple):
    """The derivatives of the state by the commands of the steps so far, (n,) each.

    Those of the lagging speed by v and of the lagging yaw rate by w are the same.
    """

    lagging: Array
    x_v: Array
    y_v: Array
    x_w: Array
    y_w: Array
    heading_w: Array


@inlined
def lagged_period(m, pose, twist, command):
    """Returns (pose, lagging twist, mean twist over it) after a control period under a command (v, w).

    The heading counts on beyond half a turn.
    """
    x, y, heading = pose
    v, w = twist
    command_v, command_w = command
    mean_v = command_v + m.plant.lag_mean * (v - command_v)
    mean_w = command_w + m.plant.lag_mean * (w - command_w)
    v = command_v + m.plant.lag_decay * (v - command_v)
    w = command_w + m.plant.lag_decay * (w - command_w)
    to_x, to_y, _ = integrate_arc(x, y, heading, mean_v, 0.0, mean_w, m.plant.dt)
    return (to_x, to_y, heading + m.plant.dt * mean_w), (v, w), (mean_v, mean_w)


@inlined
def drive_on(m, pose, twist, before, after, share, k, slopes):
    """Returns pose and lagging twist after a control period of step k, and moves their derivatives on.

    Args:
        before, after: the commands (v, w) of the step before and of this one.
        share: of the change between them that is done by the end of the period.
    """
    x, y, heading = pose
    command_v = before[0] + share * (after[0] - before[0])
    command_w = before[1] + share * (after[1] - before[1])
    (to_x, to_y, to_heading), twist, (mean_v, mean_w) = lagged_period(m, pose, twist, (command_v, command_w))
    half_turn = 0.5 * mean_w * m.plant.dt
    sine, cosine = sin_cos(heading + half_turn)
    chord = sinc(half_turn)
    bend = sinc_slope(half_turn)
    x_v = m.plant.dt * chord * cosine
    y_v = m.plant.dt * chord * sine
    x_w = 0.5 * m.plant.dt * m.plant.dt * mean_v * (bend * cosine - chord * sine)
    y_w = 0.5 * m.plant.dt * m.plant.dt * mean_v * (bend * sine + chord * cosine)
    for a in range(k + 1):
        held = share if a == k else (1.0 - share if a == k - 1 else 0.0)
        mean = held + m.plant.lag_mean * (slopes.lagging[a] - held)
        slopes.lagging[a] = held + m.plant.lag_decay * (slopes.lagging[a] - held)
        slopes.x_v[a] += x_v * mean
        slopes.y_v[a] += y_v * mean
        slopes.x_w[a] += x_w * mean - (to_y - y) * slopes.heading_w[a]
        slopes.y_w[a] += y_w * mean + (to_x - x) * slopes.heading_w[a]
        slopes.heading_w[a] += m.plant.dt * mean
    return (to_x, to_y, to_heading), twist


@inlined
def sinc_slope(angle):
    """Returns the derivative of sin(angle) / angle."""
    if abs(angle) < 1e-2:
        # Taylor series; the next term is below 1e-15
        return angle * (-1 / 3 + angle * angle * (1 / 30 - angle * angle / 840))
    sine, cosine = sin_cos(angle)
    return (cosine - sine / angle) / angle
