"""The response of a base to its commands: delay, gain, saturation, slew and first-order lag, exact between events.

    u(t) = g c(t - d)                 of the held command c, with delay d and gain g
    u -> saturated                    each axis by itself, both by one factor, or each wheel by itself
    r'   = A or D towards u           |r| rises with the acceleration A and falls with the deceleration D
    v'   = (r - v) / tau              lag

Time is cut where a command takes effect, at measurements, and where r reaches u or 0. Between cuts r(s) = r_0 + k s and

    v(s) = r(s) - k tau + (v_0 - r_0 + k tau) exp(-s / tau)

so that there is no step size, and v and its derivatives with respect to every parameter are exact.
"""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.system.compiled import compiled

AXES, TWIST, WHEELS = range(3)  # what saturates: each axis by itself, both by one factor, each wheel by itself
SATURATIONS = ("axes", "twist", "wheels")
# of one axis; the limit of two axes is a pair: two speeds, or a wheel's speed and half of the track
AXIS = ("delay", "gain", "acceleration", "deceleration", "lag")
PAIR = (*(f"{name}_v" for name in AXIS), *(f"{name}_w" for name in AXIS), "limit_1", "limit_2")

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclasses.dataclass(frozen=True)
class Drive:
    """Commands and measured speeds of a drive; forward (m/s) in column 0, yaw rate (rad/s) in column 1."""

    command_times: Floats  # (m,) s, ascending
    commands: Floats  # (m, 2), each held until the next
    times: Floats  # (n,) s, ascending
    speeds: Floats  # (n, 2)
    starts: Flags  # (n,) where the response begins anew at what was measured
    counted: Flags  # (n,) what residuals count
    reported: Floats = dataclasses.field(
        default_factory=lambda: np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    )  # (2, 2) least and largest speeds of each axis that odometry reports

    def only(self, counted: Flags) -> "Drive":
        """Returns the same drive, of which only these residuals count."""
        return dataclasses.replace(self, counted=self.counted & counted)


@compiled
def respond(times, starts, measured, cuts, targets, cut_slopes, target_slopes, rise, fall, lag, work, v, slopes):  # type: ignore[no-untyped-def]
    """Fills `v` (n,) with the response at the times, and `slopes` (n, q + 3) with its derivatives.

    Args:
        times: (n,) s, ascending.
        starts: (n,) where the response begins anew, in the state `measured` (n,).
        cuts: (m,) s, ascending, where targets change.
        targets: (m,) to which r goes from then on; 0 before the first.
        cut_slopes, target_slopes: (m, q) derivatives of both with respect to q parameters.
        rise, fall: acceleration and deceleration of r, whose derivatives are columns q and q + 1.
        lag: tau, s, whose derivative is column q + 2.
        work: (q + 3,) memory for the derivatives of r and, behind them, (q + 3,) for those of v.
    """
    q = cut_slopes.shape[1]
    e = 0
    t = 0.0
    u = 0.0
    r = 0.0
    y = 0.0
    for i in range(times.shape[0]):
        if starts[i] or i == 0:
            t = times[i]
            while e < cuts.shape[0] and cuts[e] <= t:
                u = targets[e]
                e += 1
            r = measured[i]
            y = r
            work[:] = 0.0
        while t < times[i]:
            event = e < cuts.shape[0] and cuts[e] <= times[i]
            stop = max(cuts[e], t) if event else times[i]
            r, y = run(stop - t, u, r, y, e, target_slopes, rise, fall, lag, work)
            t = stop
            if event:
                before = slew(r, u, rise, fall)
                u = targets[e]
                bend = before - slew(r, u, rise, fall)
                for j in range(q):  # r is continuous, its slope is not: a later cut shifts what follows
                    work[j] += bend * cut_slopes[e, j]
                e += 1
        v[i] = y
        for j in range(q + 3):
            slopes[i, j] = work[q + 3 + j]


@compiled
def slew(r, u, rise, fall):  # type: ignore[no-untyped-def]
    """Returns the slope of r on its way to u: `fall` where |r| falls, `rise` where it grows."""
    if r == u:
        return 0.0
    falls = (r > 0.0 and u < r) or (r < 0.0 and u > r)
    return math.copysign(fall if falls else rise, u - r)


@compiled
def run(span, u, r, y, e, target_slopes, rise, fall, lag, work):  # type: ignore[no-untyped-def]
    """Returns r and v after a span of time with one target, whose derivatives are those before event `e`."""
    count = work.shape[0] // 2
    q = count - 3
    while True:
        k = slew(r, u, rise, fall)
        s = span
        goal = 0.0 if r * u < 0.0 else u  # at 0 the slope changes from `fall` to `rise`
        reached = k != 0.0 and (goal - r) / k <= span
        if reached:
            s = (goal - r) / k
        decay = math.exp(-s / lag)
        away = y - r + k * lag
        column = q + 1 if (r > 0.0 and k < 0.0) or (r < 0.0 and k > 0.0) else q
        for j in range(count):
            a = work[j]
            b = math.copysign(1.0, k) if j == column and k != 0.0 else 0.0
            z = a + b * (s - lag) + (work[count + j] - a + b * lag) * decay
            if j == q + 2:
                z += -k + k * decay + away * decay * s / (lag * lag)
            work[count + j] = z
            work[j] = a + b * s
        y = r + k * (s - lag) + away * decay
        if not reached:
            return r + k * s, y
        r = goal
        span -= s
        after = slew(r, u, rise, fall)
        for j in range(count):
            if after != 0.0:
                work[j] *= after / k
            else:
                work[j] = target_slopes[e - 1, j] if j < q and e > 0 else 0.0
        if after == 0.0 and span <= 0.0:
            return r, y


@compiled
def merge(command_times, commands, pair, saturation, cuts, targets, cut_slopes, target_slopes):  # type: ignore[no-untyped-def]
    """Fills what `respond` takes with the saturated targets of two axes, (2 m,) cuts and (2, 2 m) targets.

    Args:
        pair: the parameters of PAIR. The derivatives' columns are delay and gain of v, of w, and both limits.
    """
    d = pair[0], pair[5]
    m = command_times.shape[0]
    i = 0
    j = 0
    cut_slopes[:, :] = 0.0
    target_slopes[:, :, :] = 0.0
    for e in range(2 * m):
        ahead = i < m and (j >= m or command_times[i] + d[0] <= command_times[j] + d[1])
        if ahead:
            cuts[e] = command_times[i] + d[0]
            cut_slopes[e, 0] = 1.0
            i += 1
        else:
            cuts[e] = command_times[j] + d[1]
            cut_slopes[e, 2] = 1.0
            j += 1
        cv = commands[i - 1, 0] if i else 0.0
        cw = commands[j - 1, 1] if j else 0.0
        saturate(cv, cw, pair[1], pair[6], pair[10], pair[11], saturation, e, targets, target_slopes)


@compiled
def saturate(cv, cw, gv, gw, p, q, saturation, e, targets, slopes):  # type: ignore[no-untyped-def]
    """Fills the saturated targets of two commands and their derivatives; p and q are the limits of PAIR."""
    uv = gv * cv
    uw = gw * cw
    v, w = targets[0], targets[1]
    dv, dw = slopes[0], slopes[1]
    v[e] = uv
    w[e] = uw
    dv[e, 1] = cv
    dw[e, 3] = cw
    if saturation == AXES:
        if abs(uv) > p:
            v[e] = math.copysign(p, uv)
            dv[e, 1] = 0.0
            dv[e, 4] = math.copysign(1.0, uv)
        if abs(uw) > q:
            w[e] = math.copysign(q, uw)
            dw[e, 3] = 0.0
            dw[e, 5] = math.copysign(1.0, uw)
        return
    fastest = abs(uv) + q * abs(uw)
    if fastest <= p:
        return
    if saturation == TWIST:
        sv = math.copysign(1.0, uv)
        sw = math.copysign(1.0, uw)
        share = p / fastest
        v[e] = share * uv
        w[e] = share * uw
        dv[e, 1] = share * cv * (1.0 - abs(uv) / fastest)
        dv[e, 3] = -share * uv * q * sw * cw / fastest
        dv[e, 4] = uv / fastest
        dv[e, 5] = -share * uv * abs(uw) / fastest
        dw[e, 1] = -share * uw * sv * cv / fastest
        dw[e, 3] = share * cw * (1.0 - q * abs(uw) / fastest)
        dw[e, 4] = uw / fastest
        dw[e, 5] = -share * uw * abs(uw) / fastest
        return
    v[e] = 0.0
    w[e] = 0.0
    dv[e, 1] = 0.0
    dw[e, 3] = 0.0
    for side in (-1.0, 1.0):
        wheel = uv + side * q * uw
        clipped = abs(wheel) > p
        speed = math.copysign(p, wheel) if clipped else wheel
        v[e] += 0.5 * speed
        w[e] += 0.5 * side * speed / q
        dw[e, 5] -= 0.5 * side * speed / (q * q)
        if clipped:
            sign = math.copysign(1.0, wheel)
            dv[e, 4] += 0.5 * sign
            dw[e, 4] += 0.5 * side * sign / q
        else:
            dv[e, 1] += 0.5 * cv
            dv[e, 3] += 0.5 * side * q * cw
            dv[e, 5] += 0.5 * side * uw
            dw[e, 1] += 0.5 * side * cv / q
            dw[e, 3] += 0.5 * cw
            dw[e, 5] += 0.5 * uw / q


def pair_response(
    drive: Drive, saturation: int, numbers: Floats, axes: tuple[int, ...] = (0, 1)
) -> tuple[Floats, Floats]:
    """Returns the response (2, n) of both axes, as far as odometry reports it, and its derivatives (2, n, 12).

    Args:
        drive: what was commanded, and when it was measured.
        saturation: AXES, with the limits of v and w; TWIST or WHEELS, with a wheel's speed (m/s) and half of the
            track (m).
        numbers: as PAIR names them.
        axes: 0, forward, and 1, yaw; or one of them, whose response is (1, n).
    """
    n, m = len(drive.times), len(drive.command_times)
    cuts, targets = np.empty(2 * m), np.empty((2, 2 * m))
    cut_slopes, target_slopes = np.empty((2 * m, 6)), np.empty((2, 2 * m, 6))
    merge(drive.command_times, drive.commands, numbers, saturation, cuts, targets, cut_slopes, target_slopes)
    v, slopes = np.empty((len(axes), n)), np.zeros((len(axes), n, len(PAIR)))
    result = np.empty((n, 9))
    for row, axis in enumerate(axes):
        measured = np.ascontiguousarray(drive.speeds[:, axis])
        rise, fall, lag = numbers[5 * axis + 2 : 5 * axis + 5].tolist()
        respond(
            drive.times, drive.starts, measured, cuts, targets[axis], cut_slopes, target_slopes[axis],
            rise, fall, lag, np.empty(18), v[row], result,
        )  # fmt: skip
        slopes[row][:, [0, 1, 5, 6, 10, 11]] = result[:, :6]
        slopes[row][:, 5 * axis + 2 : 5 * axis + 5] = result[:, 6:]
        least, most = drive.reported[:, axis]
        slopes[row][(v[row] < least) | (v[row] > most)] = 0.0
        np.clip(v[row], least, most, out=v[row])
    return v, slopes


def held(times: Floats, values: NDArray[Any], at: Floats) -> NDArray[Any]:
    """Returns the value that is held at each time: the last before it, 0 before the first."""
    last = np.searchsorted(times, at, side="right") - 1
    latest: NDArray[Any] = np.where(last >= 0, values[np.maximum(last, 0)], 0.0)
    return latest
