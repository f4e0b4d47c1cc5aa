"""Dynamic feedback linearisation of a unicycle."""

import dataclasses
import math

from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos

_BEGUN, _SPEED = 2, 3  # of the memory


@compiled
def linearised(params, aims, memory, twists):
    """Fills the speeds and yaw rates of the twists (b, t) of `FeedbackLinear`."""
    p = params[0]
    kd = 2.0 * p.zeta * p.a
    kp = p.a * p.a
    fastest = p.plant.wheel_speed_limit / max(abs(p.plant.wheel_matrix[0, 0]), 1e-9)
    for i in range(aims.shape[0]):
        e = aims[i]
        if memory[i, _BEGUN] == 0.0:
            memory[i, _BEGUN] = 1.0
            memory[i, _SPEED] = e.vx
        xi = memory[i, _SPEED]
        if abs(xi) < p.least_speed:
            xi = math.copysign(p.least_speed, xi)
        sine, cosine = sin_cos(e.turn)
        aside = e.vx * e.yaw_rate
        u = cosine * e.vx_rate - sine * aside + kd * (cosine * e.vx - xi) + kp * e.x
        twists[i, 0] = xi
        twists[i, -1] = (sine * e.vx_rate + cosine * aside + kd * sine * e.vx + kp * e.y) / xi
        memory[i, _SPEED] = min(max(xi + p.plant.dt * u, -fastest), fastest)


@dataclasses.dataclass(frozen=True)
class FeedbackLinear(ReferenceLaw):
    """The acceleration of the robot's place is chosen, and driven by a speed that is integrated.

    With p the robot's place, T, N its heading and the normal of it, and xi the speed that the law keeps:

        u = p_r'' + k_d (p_r' - xi T) + k_p (p_r - p),  k_p = a^2,  k_d = 2 zeta a
        v = xi,  w = u.N / xi,  xi' = u.T

    so that the error in the world obeys e'' + k_d e' + k_p e = 0. It is singular at xi = 0: |xi| is held above
    `least_speed`, at which the law creeps where it should rest. xi is sent before it is integrated; the other way round
    it would be late by a period.

    Source: Oriolo, De Luca, Vendittelli, WMR control via dynamic feedback linearization, IEEE Trans. Control Systems
    Technology 10(6), 2002.
    """

    a: float = gain(2.26, "rad/s", "of the error's poles", above=0.0, search=(0.5, 3.5))
    zeta: float = gain(0.81, "1", "their damping", above=0.0, search=(0.4, 1.2))
    least_speed: float = gain(0.05, "m/s", "held, to keep off the singularity", above=0.0, search=(0.01, 0.3))

    decide = staticmethod(linearised)
