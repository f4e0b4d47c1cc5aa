"""What shows that a base can follow a reference: a regulator that follows it, and never asks for more than there is.

Time-varying LQR about the reference, on the exact motion of a control period, starts on the reference. Where no limit
of the base cuts its commands and its RMS error is under a millimetre, the reference can be followed, and that error is
the floor of laws. To play the commands of the reference blindly is no proof: rounding adds up to millimetres.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.kinematics import integrate_arc, limits, to_body_frame
from wayfield.envs.robots.references import RAMP, TIMES, Laid, base_of, lay_out, sample_index
from wayfield.system.compiled import allocating, assign, inlined
from wayfield.system.elementary import sin_cos, wrap_angle

PROVERS = ("p3dx", "turtlebot3", "jackal", "omni3")
PERIODS = 1200  # of a proof
DT = 0.05  # s
FLOOR = 1e-3  # m
# of m^2 and rad^2; of the command in m^2/s^2 and rad^2/s^2
WEIGHTS = np.array([10.0, 10.0, 1.0]), np.array([1.0, 1.0, 0.5])


class Lag(NamedTuple):
    """What the motion about a reference takes from a base: see the fields of BASE and of PLANT."""

    dt: float
    lag_decay: float
    lag_mean: float

    @classmethod
    def of(cls, base: NDArray[np.void]) -> "Lag":
        """Returns that of a (1,) record with these fields: one type for all, so that it is compiled once."""
        return cls(*(float(base[0][name]) for name in cls._fields))


@inlined
def wanted_twist(base, a, b):
    """Returns the command at sample a after which the wheels' twist is that of sample b."""
    d = base.lag_decay
    return (b.vx - d * a.vx) / (1.0 - d), (b.vy - d * a.vy) / (1.0 - d), (b.yaw_rate - d * a.yaw_rate) / (1.0 - d)


@inlined
def linearise(base, holonomic, a, b, matrix, inputs):
    """Fills the exact period about samples a to b: of the error in the reference's frame, then the wheels' twist."""
    dt = base.dt
    m = base.lag_mean
    cx, cy, cw = wanted_twist(base, a, b)
    vx = cx + m * (a.vx - cx)
    vy = cy + m * (a.vy - cy)
    w = cw + m * (a.yaw_rate - cw)
    turn = w * dt
    sine, cosine = sin_cos(turn)
    # of the chord: sin(turn) / turn and (1 - cos(turn)) / turn, and their derivatives
    s = 1.0 - turn * turn / 6.0
    c = turn * (0.5 - turn * turn / 24.0)
    ds = -turn / 3.0
    dc = 0.5 - turn * turn / 8.0
    dx = dt * (s * vx - c * vy)
    dy = dt * (c * vx + s * vy)
    matrix[:] = 0.0
    inputs[:] = 0.0
    matrix[0, 0] = cosine
    matrix[0, 1] = sine
    matrix[1, 0] = -sine
    matrix[1, 1] = cosine
    matrix[0, 2] = sine * dx - cosine * dy
    matrix[1, 2] = cosine * dx + sine * dy
    matrix[2, 2] = 1.0
    last = 2 if holonomic else 1
    for j in range(last + 1):
        if j == last:
            px = dt * dt * (ds * vx - dc * vy)
            py = dt * dt * (dc * vx + ds * vy)
            turned = dt
        elif j == 0:
            px = dt * s
            py = dt * c
            turned = 0.0
        else:
            px = -dt * c
            py = dt * s
            turned = 0.0
        x = cosine * px + sine * py
        y = cosine * py - sine * px
        inputs[0, j] = (1.0 - m) * x
        inputs[1, j] = (1.0 - m) * y
        inputs[2, j] = (1.0 - m) * turned
        inputs[3 + j, j] = 1.0 - base.lag_decay
        matrix[0, 3 + j] = m * x
        matrix[1, 3 + j] = m * y
        matrix[2, 3 + j] = m * turned
        matrix[3 + j, 3 + j] = base.lag_decay


@inlined
def solved(matrix, right):
    """Replaces right (n, k) by the solution of matrix (n, n) x = right, positive definite, by elimination."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1, n):
            factor = matrix[j, i] / matrix[i, i]
            for k in range(i, n):
                matrix[j, k] -= factor * matrix[i, k]
            for k in range(right.shape[1]):
                right[j, k] -= factor * right[i, k]
    for i in range(n - 1, -1, -1):
        for k in range(right.shape[1]):
            for j in range(i + 1, n):
                right[i, k] -= matrix[i, j] * right[j, k]
            right[i, k] /= matrix[i, i]


@allocating
def regulator(samples, all_times, lag, holonomic, q, r):
    """Returns the gains (n, t, 3 + t) of each sample of a reference: command = wanted - gain (error, wheel deviation).

    The Riccati recursion backwards in time, twice round a lap (Anderson and Moore, Optimal Control, 1990, section 2.4).

    Args:
        samples, all_times: SAMPLE records and (1,) TIMES.
        lag: of the base, by `Lag.of`.
        q: (3,) weights of the errors in x, y (1/m^2) and heading (1/rad^2).
        r: (3,) weights of the command's deviations.
    """
    times = all_times[0]
    t = 3 if holonomic else 2
    n = 3 + t
    a = np.zeros((n, n))
    b = np.zeros((n, t))
    p = np.zeros((n, n))
    for j in range(3):
        p[j, j] = q[j]
    pa = np.zeros((n, n))
    pb = np.zeros((n, t))
    size = np.zeros((t, t))
    right = np.zeros((t, n))
    cross = np.zeros((t, n))
    gains = np.zeros((times.last + 1, t, n))
    turns = 2 if times.lap > 1 else 1
    for _ in range(turns):
        for k in range(times.last, -1, -1):
            here = samples[sample_index(times, k)]
            there = samples[sample_index(times, k + 1)]
            linearise(lag, holonomic, here, there, a, b)
            pa[:] = 0.0
            pb[:] = 0.0
            size[:] = 0.0
            right[:] = 0.0
            for i in range(n):
                for m in range(n):
                    for j in range(n):
                        pa[i, j] += p[i, m] * a[m, j]
                    for j in range(t):
                        pb[i, j] += p[i, m] * b[m, j]
            for i in range(t):
                size[i, i] = r[2] if i == t - 1 else r[i]
                for m in range(n):
                    for j in range(t):
                        size[i, j] += b[m, i] * pb[m, j]
                    for j in range(n):
                        right[i, j] += b[m, i] * pa[m, j]
            assign(cross, right)
            solved(size, right)
            assign(gains[k], right)
            for i in range(n):
                for j in range(n):
                    value = 0.0
                    for m in range(n):
                        value += a[m, i] * pa[m, j]
                    for m in range(t):
                        value -= cross[m, i] * right[m, j]
                    p[i, j] = value
            for j in range(3):
                p[j, j] += q[j]
            for i in range(n):
                for j in range(i):
                    p[i, j] = p[j, i] = 0.5 * (p[i, j] + p[j, i])
    return gains


@inlined
def regulated(base, holonomic, gains, a, b, pose, twist):
    """Returns the command at sample a, before sample b: gains (t, 3 + t) on the error of a pose and a wheels' twist."""
    cx, cy, cw = wanted_twist(base, a, b)
    sine, cosine = sin_cos(a.heading)
    x, y = to_body_frame(a.x, a.y, sine, cosine, pose[0], pose[1])
    turn = wrap_angle(pose[2] - a.heading)
    for j in range(gains.shape[0]):
        away = gains[j, 0] * x + gains[j, 1] * y + gains[j, 2] * turn + gains[j, 3] * (twist[0] - a.vx)
        if holonomic:
            away += gains[j, 4] * (twist[1] - a.vy)
        away += gains[j, gains.shape[1] - 1] * (twist[2] - a.yaw_rate)
        if j == gains.shape[0] - 1:
            cw -= away
        elif j == 0:
            cx -= away
        else:
            cy -= away
    return cx, cy, cw


@allocating
def followed(samples, all_times, bases, holonomic, gains, periods):
    """Returns how many of some periods are limited, and the RMS error (m), from the exact start."""
    base = bases[0]
    times = all_times[0]
    first = samples[times.first]
    x = first.x
    y = first.y
    heading = first.heading
    twist = (first.vx, first.vy, first.yaw_rate)
    command = twist
    limited = 0
    squares = 0.0
    for k in range(periods):
        here = sample_index(times, k)
        there = samples[sample_index(times, k + 1)]
        at = here - times.first
        requested = regulated(base, holonomic, gains[at], samples[here], there, (x, y, heading), twist)
        vx, vy, w, factor = limits(base, command, requested, base.dt)
        if factor < 1.0 or abs(vx - requested[0]) + abs(vy - requested[1]) + abs(w - requested[2]) > 1e-9:
            limited += 1
        m = base.lag_mean
        d = base.lag_decay
        mean = (vx + m * (twist[0] - vx), vy + m * (twist[1] - vy), w + m * (twist[2] - w))
        twist = (vx + d * (twist[0] - vx), vy + d * (twist[1] - vy), w + d * (twist[2] - w))
        command = (vx, vy, w)
        x, y, heading = integrate_arc(x, y, heading, mean[0], mean[1], mean[2], base.dt)
        squares += (x - there.x) * (x - there.x) + (y - there.y) * (y - there.y)
    return limited, math.sqrt(squares / periods)


def proof(laid: Laid, base: NDArray[np.void], holonomic: bool) -> tuple[int, float]:
    """Returns how many of PERIODS the regulator is limited in, and its RMS error, m."""
    times = np.zeros(1, TIMES)
    times["last"], times["lap"] = len(laid.samples) - 1, laid.lap
    gains = regulator(laid.samples, times, Lag.of(base), holonomic, *WEIGHTS)
    limited, floor = followed(laid.samples, times, base, holonomic, gains, PERIODS)
    return int(limited), float(floor)


def proven(scenario: Any) -> bool:
    """Returns whether all PROVERS follow a reference unlimited and within a millimetre; one that takes more: none."""
    for name in PROVERS:
        robot = ROBOTS[name]
        base = base_of(robot, robot.actuators("lagged"), DT)
        knots = scenario.knots_of(robot.holonomic)
        laid = lay_out(knots, scenario.path.closed, scenario.share, RAMP, base, robot.holonomic)
        limited, floor = proof(laid, base, robot.holonomic)
        if (limited == 0 and floor < FLOOR) != (scenario.share <= 1.0):
            return False
    return True
