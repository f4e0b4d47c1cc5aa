"""Estimated gains of a reference's twist: what a base with slip and worn wheels must be asked for.

Where a base goes slower than its wheels turn, a law without an integral stays behind by a constant. With a and c the
estimates, the law is handed v_r (1 + a) and w_r (1 + c), and

    a' = k e_x v_r,  c' = k (e_th + 2 e_y) w_r,  each within 0.3

They rest where the reference rests, and nothing winds up there. It is the gradient of the error by an unknown gain,
as in the MIT rule (Astrom and Wittenmark, Adaptive Control, 1995, section 5.2).
"""

from wayfield.system.compiled import compiled

MOST = 0.3
ASIDE = 2.0  # 1/m, of the error aside in that of the turning


@compiled
def estimate_gains(aims, rate, dt, memory):
    """Scales the twists of AIM records (b,) by the estimates in memory (b, >= 2), and moves those on by a period.

    Args:
        rate: k, of both estimates.
        dt: s.
    """
    for i in range(aims.shape[0]):
        e = aims[i]
        a = memory[i, 0] + dt * rate * e.x * e.vx
        c = memory[i, 1] + dt * rate * (e.turn + ASIDE * e.y) * e.yaw_rate
        memory[i, 0] = min(max(a, -MOST), MOST)
        memory[i, 1] = min(max(c, -MOST), MOST)
        e.vx *= 1.0 + memory[i, 0]
        e.vx_rate *= 1.0 + memory[i, 0]
        e.vy *= 1.0 + memory[i, 0]
        e.vy_rate *= 1.0 + memory[i, 0]
        e.yaw_rate *= 1.0 + memory[i, 1]
        e.yaw_acceleration *= 1.0 + memory[i, 1]
