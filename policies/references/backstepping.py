"""Tracking of a unicycle by backstepping."""

import dataclasses

from wayfield.envs.robots.kinematics import sinc
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos


@compiled
def step_back(params, aims, memory, twists):
    """Fills the speeds and yaw rates of the twists (b, t) of `Backstepping`."""
    p = params[0]
    for i in range(aims.shape[0]):
        e = aims[i]
        sine, cosine = sin_cos(e.turn)
        s = sinc(e.turn)
        # its derivative; the series where the quotient loses its digits
        ds = (cosine - s) / e.turn if abs(e.turn) > 1e-3 else -e.turn * (1.0 / 3.0)
        w = e.yaw_rate + p.g * e.vx * e.y * s + p.k_th * e.turn
        y_rate = e.vx * sine - w * e.x
        turn_rate = e.yaw_rate - w
        w_rate = e.yaw_acceleration + p.k_th * turn_rate
        w_rate += p.g * (e.vx_rate * e.y * s + e.vx * y_rate * s + e.vx * e.y * ds * turn_rate)
        x = e.x - p.k3 * w * e.y
        twists[i, 0] = e.vx * cosine - p.k3 * w_rate * e.y - p.k3 * w * y_rate + p.k4 * x
        twists[i, -1] = w


@dataclasses.dataclass(frozen=True)
class Backstepping(ReferenceLaw):
    """The error ahead is led after one that takes back the error aside by the robot's own turning.

    With (e_x, e_y, e_th) the reference minus the robot in the robot's frame, and (v_r, w_r) its twist:

        w = w_r + g v_r e_y sinc(e_th) + k_th e_th
        x = e_x - k3 w e_y
        v = v_r cos(e_th) - k3 w' e_y + k3 w (w e_x - v_r sin(e_th)) + k4 x

    V = x^2/2 + e_y^2/2 + e_th^2/(2 g) falls by k4 x^2 + k3 w^2 e_y^2 + k_th e_th^2/g: also where the reference turns on
    the spot. It needs the reference's accelerations, in w'.

    Source: Jiang, Nijmeijer, Tracking control of mobile robots: a case study in backstepping, Automatica 33(7), 1997.
    """

    g: float = gain(14.0, "1/m^2", "of the error aside in the turning", above=0.0, search=(1.0, 60.0))
    k_th: float = gain(5.2, "1/s", "of the heading's error", above=0.0, search=(0.5, 10.0))
    k3: float = gain(0.05, "s", "of the error aside in the one ahead", above=0.0, search=(0.01, 1.0))
    k4: float = gain(4.5, "1/s", "of the error ahead", above=0.0, search=(0.5, 10.0))

    decide = staticmethod(step_back)
