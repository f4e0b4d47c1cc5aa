"""Samson's tracking law of a unicycle, with gains that follow the reference's speed."""

import dataclasses
import math

from wayfield.envs.robots.kinematics import sinc
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos


@compiled
def follow_samson(params, aims, memory, twists):
    """Fills the speeds and yaw rates of the twists (b, t) of `Samson`."""
    p = params[0]
    for i in range(aims.shape[0]):
        e = aims[i]
        k = 2.0 * p.zeta * math.sqrt(e.yaw_rate * e.yaw_rate + p.b * e.vx * e.vx)
        _, cosine = sin_cos(e.turn)
        twists[i, 0] = e.vx * cosine + k * e.x
        twists[i, -1] = e.yaw_rate + p.b * e.vx * sinc(e.turn) * e.y + k * e.turn


@dataclasses.dataclass(frozen=True)
class Samson(ReferenceLaw):
    """Feedback whose poles about a steady reference are those of one damping, at a frequency that its speed sets.

    With (e_x, e_y, e_th) the reference minus the robot in the robot's frame, and (v_r, w_r) its twist:

        k = 2 zeta sqrt(w_r^2 + b v_r^2)
        v = v_r cos(e_th) + k e_x
        w = w_r + b v_r sinc(e_th) e_y + k e_th

    About a circle the characteristic polynomial is (s + 2 zeta a)(s^2 + 2 zeta a s + a^2), a^2 = w_r^2 + b v_r^2. It
    holds every start whose reference moves; at rest k is 0, and what is left of an error stays.

    Source: Samson, Time-varying feedback stabilization of car-like wheeled mobile robots, IJRR 12(1), 1993, in the form
    of De Luca, Oriolo, Samson, Feedback control of a nonholonomic car-like robot, 1998.
    """

    zeta: float = gain(0.81, "1", "damping", above=0.0, search=(0.4, 1.2))
    b: float = gain(13.0, "1/m^2", "how soon an error aside is taken back", above=0.0, search=(1.0, 100.0))

    decide = staticmethod(follow_samson)
