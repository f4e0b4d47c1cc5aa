"""Feed-forward and PI feedback of a base that goes sideways."""

import dataclasses
from typing import ClassVar

from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos


@compiled
def feed_back(params, aims, memory, twists):
    """Fills the (b, 3) twists of `PidOmni`; memory (b, 4) holds the integral in its last two columns, world frame."""
    p = params[0]
    for i in range(aims.shape[0]):
        e = aims[i]
        sine, cosine = sin_cos(e.measured_heading)
        memory[i, 2] += p.plant.dt * (cosine * e.x - sine * e.y)
        memory[i, 3] += p.plant.dt * (sine * e.x + cosine * e.y)
        along = cosine * memory[i, 2] + sine * memory[i, 3]
        aside = cosine * memory[i, 3] - sine * memory[i, 2]
        # velocity and acceleration in the reference's frame
        vx = e.vx + p.ahead * (e.vx_rate - e.yaw_rate * e.vy)
        vy = e.vy + p.ahead * (e.vy_rate + e.yaw_rate * e.vx)
        sine, cosine = sin_cos(e.turn)
        twists[i, 0] = p.forward * (cosine * vx - sine * vy) + p.k_p * e.x + p.k_i * along
        twists[i, 1] = p.forward * (sine * vx + cosine * vy) + p.k_p * e.y + p.k_i * aside
        twists[i, 2] = p.forward * (e.yaw_rate + p.ahead * e.yaw_acceleration) + p.k_th * e.turn


@dataclasses.dataclass(frozen=True)
class PidOmni(ReferenceLaw):
    """Each direction by itself: the reference's velocity, and a share of the error and of its integral.

    With e the reference's place minus the robot's and r' its velocity, in the world, and e_th the heading's error:

        u = r' + lead r'' + k_p e + k_i int(e),  w = w_r + lead w_r' + k_th e_th

    turned into the frame of the robot. Without r' a robot on a circle of radius R would be R w / sqrt(k_p^2 + w^2) off.
    `lead` s of derivative undo what a base with a lag is late by, beyond the prediction of its pose; k_p of more than
    1 / (4 lag) makes it swing.

    Source: Astrom and Hagglund, PID Controllers, 1995, sections 3.2 and 7.2.
    """

    k_p: float = gain(2.0, "1/s", "of the error", least=0.0, search=(0.3, 5.0))
    k_i: float = gain(0.0, "1/s^2", "of its integral", least=0.0)
    k_th: float = gain(2.0, "1/s", "of the heading's error", least=0.0, search=(0.3, 5.0))
    forward: float = gain(1.0, "1", "share of the reference's twist that is asked for", least=0.0)
    ahead: float = gain(
        0.0, "s", "of the reference's acceleration that is asked for besides", least=0.0, search=(0.0, 0.2)
    )

    needs: ClassVar[tuple[str, ...]] = ("holonomic",)

    decide = staticmethod(feed_back)
