"""Input-output linearisation of a point ahead of the axle."""

import dataclasses

from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos


@compiled
def lead_point(params, aims, memory, twists):
    """Fills the speeds and yaw rates of the twists (b, t) of `OffsetPoint`."""
    p = params[0]
    for i in range(aims.shape[0]):
        e = aims[i]
        sine, cosine = sin_cos(e.turn)
        aside = e.vy + p.b * e.yaw_rate
        twists[i, 0] = cosine * e.vx - sine * aside + p.k * (e.x + p.b * (cosine - 1.0))
        twists[i, -1] = (sine * e.vx + cosine * aside + p.k * (e.y + p.b * sine)) / p.b


@dataclasses.dataclass(frozen=True)
class OffsetPoint(ReferenceLaw):
    """A point ahead of the axle, which can move in any direction, goes after the same point of the reference.

    With p_b the point at the distance b ahead, p_r,b that of the reference, and T, N the robot's heading and normal:

        u = p_r,b' + k (p_r,b - p_b),  v = u.T,  w = u.N / b

    so that the point's error decays as e^(-k t) from every start. The heading follows by itself while the reference
    goes forward, and runs away where it backs.

    Source: Siciliano, Sciavicco, Villani, Oriolo, Robotics, 2009, section 11.6.1.
    """

    b: float = gain(0.34, "m", "of the point ahead of the axle", above=0.0, search=(0.05, 0.6))
    k: float = gain(3.4, "1/s", "of the point's error", above=0.0, search=(0.5, 8.0))

    decide = staticmethod(lead_point)
