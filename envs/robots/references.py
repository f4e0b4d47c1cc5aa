"""References with a time law: where a base shall be at each control period, how it shall move there, and its limits.

A reference is laid out once, a SAMPLE a period, from knots: values and two derivatives of x, y and the heading, with
polynomials of degree 5 between them. What a base must be commanded for it is c = v + lag v', with v its twist; how much
of the base's wheels and accelerations that takes is its share. No share above 1 can be followed.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.robots.records import MAX_WHEELS, lag_factors, padded
from wayfield.envs.world.geometry import lengths
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

Array = NDArray[np.float64]

SAMPLE = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("heading", np.float64),  # rad, (-pi, pi]
        ("vx", np.float64),  # twist in the frame of the pose, m/s, rad/s
        ("vy", np.float64),
        ("yaw_rate", np.float64),
        ("vx_rate", np.float64),  # its derivatives, m/s^2, rad/s^2
        ("vy_rate", np.float64),
        ("yaw_acceleration", np.float64),
    ],
    align=True,
)
TIMES = np.dtype(
    [
        ("first", np.int64),  # index of the sample of period 0
        ("last", np.int64),  # period of the last sample
        ("lap", np.int64),  # periods at the end that come again for ever; 1: the last sample is held
    ],
    align=True,
)
# What of a base decides its share; fields of the same names as a policy's PLANT record.
BASE = np.dtype(
    [
        ("dt", np.float64),
        ("num_wheels", np.int64),
        ("wheel_matrix", np.float64, (MAX_WHEELS, 3)),
        ("wheel_speed_limit", np.float64),
        ("turn_speed", np.float64),
        ("turning_radius", np.float64),
        ("acceleration", np.float64),
        ("yaw_acceleration", np.float64),
        ("lag", np.float64),
        ("lag_decay", np.float64),
        ("lag_mean", np.float64),
    ],
    align=True,
)
LIMITS = ("wheel speed", "yaw rate", "acceleration", "yaw acceleration", "turning radius", "motion sideways")
SIDEWAYS = 1e-3  # m/s, of a reference of a base that cannot go sideways: what rounding leaves
KNOT = 10  # numbers of a knot: time, then x, y and heading, each with two derivatives


class References(NamedTuple):
    """The references of b robots."""

    samples: NDArray[np.void]  # (n,) SAMPLE records of all references
    times: NDArray[np.void]  # TIMES records
    which: NDArray[np.int64]  # (b,) of each robot


def base_of(robot: Robot, actuators: Actuators, dt: float) -> NDArray[np.void]:
    """Returns (1,) BASE: a base at its rated wheel speed; one without bounds and lag as if in the tier "lagged"."""
    if math.isinf(actuators.acceleration):
        actuators = robot.actuators("lagged")
    made = np.zeros(1, BASE)
    made["dt"] = dt
    made["num_wheels"] = len(robot.wheel_matrix)
    made["wheel_matrix"] = padded(robot.wheel_matrix, (MAX_WHEELS, 3))
    made["wheel_speed_limit"] = robot.rated_wheel_speed
    made["turn_speed"] = robot.turn_speed
    made["turning_radius"] = robot.turning_radius
    made["acceleration"], made["yaw_acceleration"] = actuators.surely
    made["lag"] = actuators.reaction
    made["lag_decay"], made["lag_mean"] = lag_factors(actuators.reaction, dt)
    return made


@inlined
def sample_index(times, k):
    """Returns the index of the sample of period k >= 0: beyond the last the lap comes again."""
    if k > times.last:
        k = times.last - times.lap + 1 + (k - times.last - 1) % times.lap
    return times.first + k


@inlined
def quintic(z, h, knots, i, j):
    """Returns the value and three derivatives at share z of the piece from knot i, of the numbers at column j."""
    p = knots[i, j]
    v = knots[i, j + 1] * h
    a = knots[i, j + 2] * h * h
    d = knots[i + 1, j] - p
    end_v = knots[i + 1, j + 1] * h
    end_a = knots[i + 1, j + 2] * h * h
    c3 = 10.0 * d - 6.0 * v - 4.0 * end_v - 1.5 * a + 0.5 * end_a
    c4 = -15.0 * d + 8.0 * v + 7.0 * end_v + 1.5 * a - end_a
    c5 = 6.0 * d - 3.0 * v - 3.0 * end_v - 0.5 * a + 0.5 * end_a
    return (
        p + z * (v + z * (0.5 * a + z * (c3 + z * (c4 + z * c5)))),
        (v + z * (a + z * (3.0 * c3 + z * (4.0 * c4 + z * 5.0 * c5)))) / h,
        (a + z * (6.0 * c3 + z * (12.0 * c4 + z * 20.0 * c5))) / (h * h),
        (6.0 * c3 + z * (24.0 * c4 + z * 60.0 * c5)) / (h * h * h),
    )


@allocating
def evaluate(knots, at):
    """Returns the values and three derivatives (columns, 4, m) at arguments (m,) of knots (n, 1 + 3 columns)."""
    columns = (knots.shape[1] - 1) // 3
    values = np.zeros((columns, 4, at.shape[0]))
    last = knots.shape[0] - 2
    for k in range(at.shape[0]):
        i = 0
        while i < last and knots[i + 1, 0] <= at[k]:
            i += 1
        h = knots[i + 1, 0] - knots[i, 0]
        for c in range(columns):
            value, d, dd, ddd = quintic((at[k] - knots[i, 0]) / h, h, knots, i, 1 + 3 * c)
            values[c, 0, k] = value
            values[c, 1, k] = d
            values[c, 2, k] = dd
            values[c, 3, k] = ddd
    return values


@compiled
def fill(knots, clock, ramp, dt, round_, samples):
    """Fills samples, one a period dt, of knots (n, KNOT) whose time is in units of `clock` (s), round again or not.

    Time sets in smoothly over the first `ramp` seconds, at the end of which half of them have passed.
    """
    i = 0
    last = knots.shape[0] - 2
    end = knots[last + 1, 0]
    for k in range(samples.shape[0]):
        t = k * dt
        rate = 1.0
        rise = 0.0
        passed = t - 0.5 * ramp
        if t < ramp:
            z = t / ramp
            rate = z * z * z * (10.0 + z * (-15.0 + z * 6.0))
            rise = z * z * (30.0 + z * (-60.0 + z * 30.0)) / ramp
            passed = ramp * z * z * z * z * (2.5 + z * (-3.0 + z))
        rate /= clock
        rise /= clock
        tau = passed / clock
        if tau >= end:
            lap = end if round_ else 0.0
            tau = min(tau - lap, end)
            i = 0 if round_ and tau < knots[i, 0] else i
        while i < last and knots[i + 1, 0] <= tau:
            i += 1
        h = knots[i + 1, 0] - knots[i, 0]
        z = (tau - knots[i, 0]) / h
        x, dx, ddx, _ = quintic(z, h, knots, i, 1)
        y, dy, ddy, _ = quintic(z, h, knots, i, 4)
        turn, dturn, ddturn, _ = quintic(z, h, knots, i, 7)
        sine, cosine = sin_cos(turn)
        ddx = ddx * rate * rate + dx * rise
        ddy = ddy * rate * rate + dy * rise
        dx *= rate
        dy *= rate
        s = samples[k]
        s.x = x
        s.y = y
        s.heading = wrap_angle(turn)
        s.vx = cosine * dx + sine * dy
        s.vy = cosine * dy - sine * dx
        s.yaw_rate = dturn * rate
        s.vx_rate = cosine * ddx + sine * ddy + s.yaw_rate * s.vy
        s.vy_rate = cosine * ddy - sine * ddx - s.yaw_rate * s.vx
        s.yaw_acceleration = ddturn * rate * rate + dturn * rise


@allocating
def shares(samples, bases, holonomic, worst, where):
    """Fills the largest share (LIMITS,) of each limit that samples take, and the period (LIMITS,) of each."""
    base = bases[0]
    matrix = base.wheel_matrix
    worst[:] = 0.0
    where[:] = 0
    most = np.zeros(6)
    last_x = 0.0
    last_y = 0.0
    last_w = 0.0
    for k in range(samples.shape[0]):
        s = samples[k]
        x = s.vx + base.lag * s.vx_rate
        y = (s.vy + base.lag * s.vy_rate) if holonomic else 0.0
        w = s.yaw_rate + base.lag * s.yaw_acceleration
        most[:] = 0.0
        for j in range(base.num_wheels):
            spin = abs(matrix[j, 0] * x + matrix[j, 1] * y + matrix[j, 2] * w)
            most[0] = max(most[0], spin / base.wheel_speed_limit)
        most[1] = abs(w) / base.turn_speed
        if k > 0:
            dx = x - last_x
            dy = y - last_y
            most[2] = math.sqrt(dx * dx + dy * dy) / (base.acceleration * base.dt)
            most[3] = abs(w - last_w) / (base.yaw_acceleration * base.dt)
        if base.turning_radius > 0.0 and abs(s.yaw_rate) > 1e-6:
            most[4] = base.turning_radius * abs(s.yaw_rate) / max(abs(s.vx), 1e-9) * (1.0 - 1e-6)
        if not holonomic:
            most[5] = abs(s.vy) / SIDEWAYS
        for j in range(6):
            if most[j] > worst[j]:
                worst[j] = most[j]
                where[j] = k
        last_x = x
        last_y = y
        last_w = w


class Laid(NamedTuple):
    """A reference laid out for a base."""

    samples: NDArray[np.void]
    lap: int
    clock: float  # s, of a unit of the knots' time
    worst: Array  # (LIMITS,) shares
    where: NDArray[np.int64]  # (LIMITS,) periods


def lay_out(
    knots: Array, round_: bool, share: float | None, ramp: float, base: NDArray[np.void], holonomic: bool
) -> Laid:
    """Returns a reference for a base, its clock scaled until it takes the `share` of what wheels and motors can.

    That of a closed curve is rounded up to whole periods a lap.

    Args:
        knots: (n, KNOT).
        round_: whether they are a lap.
        share: above 0; None: the knots' time is in seconds.
        ramp: s, over which a reference that begins in motion sets in from rest; 0: it begins rolling.
        base: (1,) BASE.
    """
    dt = float(base["dt"][0])
    span = float(knots[-1, 0] - knots[0, 0])
    clock = 1.0 if share is None else 40.0
    worst, where = np.zeros(len(LIMITS)), np.zeros(len(LIMITS), np.int64)
    ramp = math.ceil(ramp / dt) * dt

    def laid() -> NDArray[np.void]:
        periods = clock * span / dt
        count = round(ramp / dt) + round(periods) if round_ else math.ceil(periods + 0.5 * ramp / dt - 1e-9) + 1
        samples = np.zeros(count, SAMPLE)
        fill(knots, clock, ramp, dt, round_, samples)
        shares(samples, base, holonomic, worst, where)
        return samples

    samples = laid()
    for _ in range(_MOST_TURNS if share is not None else 0):
        assert share is not None
        ratio = float(worst[:_SCALED].max()) / share
        if abs(ratio - 1.0) < 1e-9:
            break
        clock *= math.sqrt(ratio)
        samples = laid()
    if round_:
        clock = math.ceil(clock * span / dt - 1e-9) * dt / span
        samples = laid()
    else:
        for name in SAMPLE.names[3:]:  # type: ignore[index]
            samples[name][-1] = 0.0  # held
    return Laid(samples, round(clock * span / dt) if round_ else 1, clock, worst, where)


_MOST_TURNS = 40
_TREMBLING = 20.0  # times what a base can, that a recorded track asks for by its noise, and a plan by a slip of the pen
_SCALED = 4  # of LIMITS, those that more time helps
RAMP = 2.0  # s


def beyond(laid: Laid, base: NDArray[np.void], scaled: bool) -> str:
    """Returns which limit of a base a reference exceeds most, where and by how much; "" where it keeps to all.

    scaled: whether the clock was: what more time helps is then as was asked.
    """
    first = _SCALED if scaled else 0
    worst = first + int(laid.worst[first:].argmax())
    share, at = float(laid.worst[worst]), float(laid.where[worst] * base["dt"][0])
    if share <= 1.0 + 1e-9:
        return ""
    s = laid.samples[laid.where[worst]]
    if LIMITS[worst] == "motion sideways":
        return f"moves sideways at {abs(s['vy']):.3g} m/s at {at:.2f} s, which this base cannot: turn it along the path"
    if LIMITS[worst] == "turning radius":
        least = float(base["turning_radius"][0])
        return f"turns on {least / share:.3g} m at {at:.2f} s; this base turns on no less than {least:g} m"
    rests = "" if scaled else "; it begins and ends at rest"
    fewer = ", or keep fewer points if they tremble" * (share > _TREMBLING and not scaled)
    return f"takes {share:.2f} times this base's {LIMITS[worst]} at {at:.2f} s; give it more time there{fewer}{rests}"


# ---- smooth curves through points


@allocating
def spline(points, times):
    """Returns the first and second derivatives (n, 2, columns) at the points (n, columns) of the spline of degree 5.

    It goes through points[i] at times[i], four times differentiable; its third and fourth derivative are 0 at the ends.
    The conditions are a block tridiagonal system, eliminated block by block (Thomas).
    """
    n, columns = points.shape
    coefficients = np.zeros((n, 2, columns))
    upper = np.zeros((n, 2, 2))
    right = np.zeros((n, 2, columns))
    for i in range(n):
        lower = np.zeros((2, 2))
        middle = np.zeros((2, 2))
        above = np.zeros((2, 2))
        value = np.zeros((2, columns))
        if i > 0:  # minus the third and fourth derivative at the end of the piece before
            h = times[i] - times[i - 1]
            middle[0, 0] += 36.0 / (h * h)
            middle[0, 1] -= 9.0 / h
            lower[0, 0] += 24.0 / (h * h)
            lower[0, 1] += 3.0 / h
            middle[1, 0] += 192.0 / (h * h * h)
            middle[1, 1] -= 36.0 / (h * h)
            lower[1, 0] += 168.0 / (h * h * h)
            lower[1, 1] += 24.0 / (h * h)
            for c in range(columns):
                d = points[i, c] - points[i - 1, c]
                value[0, c] += 60.0 * d / (h * h * h)
                value[1, c] += 360.0 * d / (h * h * h * h)
        if i < n - 1:  # plus those at the beginning of the piece behind
            h = times[i + 1] - times[i]
            middle[0, 0] -= 36.0 / (h * h)
            middle[0, 1] -= 9.0 / h
            above[0, 0] -= 24.0 / (h * h)
            above[0, 1] += 3.0 / h
            middle[1, 0] += 192.0 / (h * h * h)
            middle[1, 1] += 36.0 / (h * h)
            above[1, 0] += 168.0 / (h * h * h)
            above[1, 1] -= 24.0 / (h * h)
            for c in range(columns):
                d = points[i + 1, c] - points[i, c]
                value[0, c] -= 60.0 * d / (h * h * h)
                value[1, c] += 360.0 * d / (h * h * h * h)
        if i > 0:
            for a in range(2):
                for b in range(2):
                    for c in range(2):
                        middle[a, b] -= lower[a, c] * upper[i - 1, c, b]
                for c in range(columns):
                    for b in range(2):
                        value[a, c] -= lower[a, b] * right[i - 1, b, c]
        det = middle[0, 0] * middle[1, 1] - middle[0, 1] * middle[1, 0]
        for b in range(2):
            upper[i, 0, b] = (middle[1, 1] * above[0, b] - middle[0, 1] * above[1, b]) / det
            upper[i, 1, b] = (middle[0, 0] * above[1, b] - middle[1, 0] * above[0, b]) / det
        for c in range(columns):
            right[i, 0, c] = (middle[1, 1] * value[0, c] - middle[0, 1] * value[1, c]) / det
            right[i, 1, c] = (middle[0, 0] * value[1, c] - middle[1, 0] * value[0, c]) / det
    for i in range(n - 1, -1, -1):
        for a in range(2):
            for c in range(columns):
                coefficients[i, a, c] = right[i, a, c]
                if i < n - 1:
                    for b in range(2):
                        coefficients[i, a, c] -= upper[i, a, b] * coefficients[i + 1, b, c]
    return coefficients


def splined(points: Array, at: Array) -> Array:
    """Returns the knots (n, 1 + 3 columns) of the spline of degree 5 through points (n, columns) at arguments (n,)."""
    derivatives = spline(points, at)
    if len(points) == 2:  # a line: more than one curve has no higher derivatives at its ends
        derivatives[:] = np.stack([(points[1] - points[0]) / (at[1] - at[0]), np.zeros(points.shape[1])])
    columns = (np.column_stack([points[:, c], derivatives[:, :, c]]) for c in range(points.shape[1]))
    return np.column_stack([at, *columns])


def chords(points: Array) -> Array:
    """Returns the length (n,) of the polyline through points (n, 2) up to each of them, m."""
    return np.concatenate([[0.0], np.cumsum(lengths(np.diff(points, axis=0)))])


@compiled
def unwind(headings):
    """Adds whole turns to headings (n,), so that none is more than half a turn from the one before."""
    for i in range(1, headings.shape[0]):
        headings[i] = headings[i - 1] + wrap_angle(headings[i] - headings[i - 1])


@allocating
def tangents(first):
    """Returns the directions (n,) of vectors (n, 2), without jumps."""
    bearings = np.zeros(first.shape[0])
    for i in range(first.shape[0]):
        bearings[i] = bearing(first[i, 1], first[i, 0])
    unwind(bearings)
    return bearings
