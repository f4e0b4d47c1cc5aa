"""Kanayama's tracking law of a unicycle."""

import dataclasses

from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos


@compiled
def track(params, aims, memory, twists):
    """Fills the speeds and yaw rates of the twists (b, t) of `Kanayama`."""
    p = params[0]
    for i in range(aims.shape[0]):
        e = aims[i]
        sine, cosine = sin_cos(e.turn)
        twists[i, 0] = e.vx * cosine + p.k_x * e.x
        twists[i, -1] = e.yaw_rate + e.vx * (p.k_y * e.y + p.k_th * sine)


@dataclasses.dataclass(frozen=True)
class Kanayama(ReferenceLaw):
    """Feedback of the error in the robot's frame, by a Lyapunov function, on top of the reference's twist.

    With (e_x, e_y, e_th) the reference minus the robot in the robot's frame, and (v_r, w_r) its twist:

        v = v_r cos(e_th) + k_x e_x
        w = w_r + v_r (k_y e_y + k_th sin(e_th))

    V = (e_x^2 + e_y^2)/2 + (1 - cos e_th)/k_y falls along all motions for v_r > 0. Where the reference turns on the
    spot the heading's error stays as it is: v_r is its only gain. About a circle the characteristic polynomial is

        s^3 + (k_x + v k_th) s^2 + (v^2 k_y + w^2 + k_x v k_th) s + k_x v^2 k_y + w^2 v k_th

    The gains printed in the paper, 10, 64 and 16, are stable about a circle on a base with a lag, and still swing for
    ever where its accelerations are bounded: the defaults were searched.

    Source: Kanayama, Kimura, Miyazaki, Noguchi, A stable tracking control method for an autonomous mobile robot, ICRA
    1990.
    """

    k_x: float = gain(4.2, "1/s", "of the error ahead", above=0.0, search=(0.5, 10.0))
    k_y: float = gain(12.9, "1/m^2", "of the error aside", above=0.0, search=(1.0, 60.0))
    k_th: float = gain(5.5, "1/m", "of the heading's error", above=0.0, search=(0.5, 16.0))

    decide = staticmethod(track)
