"""The response of bases whose sheets say more than accelerations and a lag: delay, gain, decelerations, saturation.

Of the command c, the base sets u(t) = g c(t - d), an axis at a time, and saturates it. The reference r follows u with
no more than the acceleration A, or the deceleration D while its speed falls; the wheels follow r with the lag tau:

    r' = sat(u - r),  tau v' = r - v

In the response "continuous" that holds within the control period too. The period is cut where a delayed command
changes, where r turns from D to A, and where it arrives at u. Between cuts r is linear, r(s) = r0 + k s, and

    v(s) = r(s) - k tau + (v0 - r0 + k tau) exp(-s/tau)

in closed form. In the response "stepped" delays are whole periods, and r jumps at the beginning of each.

The pose goes along the arc of the mean twist: exact in the heading, and per period T off by at most
T^3 (|v'| |w| + |v| |w'|) / 12 sideways, 0.05 mm at 1.2 m/s, 3 rad/s and the accelerations of the P3-DX.
"""

import math

from wayfield.envs.robots.kinematics import limit_acceleration, saturation_factor, steered
from wayfield.system.compiled import compiled, inlined
from wayfield.system.elementary import exponential


@compiled
def request(p, s, actions, i, vx, vy, yaw_rate):
    """Puts the twist requested of robot i in front of the ones before, which lie behind its action, the newest first.

    In the response "stepped" the reference takes its step.
    """
    first = p.requests
    for k in range(actions.shape[1] - 1, first + 2, -1):
        actions[i, k] = actions[i, k - 3]
    actions[i, first] = vx
    actions[i, first + 1] = vy
    actions[i, first + 2] = yaw_rate
    _, _, _, s.saturated = held(p, p.gains[0] * vx, p.gains[1] * vy, p.gains[2] * yaw_rate)
    if not p.continuous:
        vx, vy, yaw_rate, _ = wanted(p, actions, i, p.dt)
        falls = s.command_vx * (vx - s.command_vx) + s.command_vy * (vy - s.command_vy) < 0.0
        slows = s.command_yaw_rate * (yaw_rate - s.command_yaw_rate) < 0.0
        s.command_vx, s.command_vy, s.command_yaw_rate = limit_acceleration(
            (s.command_vx, s.command_vy, s.command_yaw_rate),
            (vx, vy, yaw_rate),
            p.deceleration if falls else p.acceleration,
            p.yaw_deceleration if slows else p.yaw_acceleration,
            p.dt,
        )
        s.command_yaw_rate = steered(p, s.command_vx, s.command_yaw_rate)


@inlined
def held(p, vx, vy, yaw_rate):
    """Returns the twist that the wheels can turn for, and 1 where it is not the given one, else 0."""
    if not p.wheel_saturation:
        factor = saturation_factor(p, vx, vy, yaw_rate)
        return factor * vx, factor * vy, steered(p, factor * vx, factor * yaw_rate), 1 if factor < 1.0 else 0
    # the driver's limit first, then each wheel's
    turn = min(max(yaw_rate, -p.turn_speed), p.turn_speed)
    beyond = 1 if turn != yaw_rate else 0
    held_vx = 0.0
    held_vy = 0.0
    held_yaw_rate = 0.0
    clipped = False
    for k in range(p.num_wheels):
        speed = p.wheel_matrix[k, 0] * vx + p.wheel_matrix[k, 1] * vy + p.wheel_matrix[k, 2] * turn
        most = min(max(speed, -p.wheel_speed_limit), p.wheel_speed_limit)
        clipped |= most != speed
        held_vx += p.forward_matrix[0, k] * most
        held_vy += p.forward_matrix[1, k] * most
        held_yaw_rate += p.forward_matrix[2, k] * most
    if not clipped:
        return vx, vy, steered(p, vx, turn), beyond
    return held_vx, held_vy, steered(p, held_vx, held_yaw_rate), 1


@inlined
def wanted(p, actions, i, time):
    """Returns the twist (saturated) that the base sets for the commands in effect at a time of the period, s."""
    vx = actions[i, p.requests + 3 * (p.delay_periods[0] + (1 if time < p.delay_rest[0] else 0))]
    vy = actions[i, p.requests + 3 * (p.delay_periods[1] + (1 if time < p.delay_rest[1] else 0)) + 1]
    yaw_rate = actions[i, p.requests + 3 * (p.delay_periods[2] + (1 if time < p.delay_rest[2] else 0)) + 2]
    return held(p, p.gains[0] * vx, p.gains[1] * vy, p.gains[2] * yaw_rate)


@inlined
def lagged(speed, reference, slope, time, lag):
    """Returns the speed after a time in which the reference rises from a value with a slope, and its integral."""
    risen = reference + slope * time
    way = time * (reference + 0.5 * slope * time)
    if lag == 0.0:
        return risen, way
    behind = slope * lag
    to = (risen - behind) + (speed - reference + behind) * exponential(-time / lag)
    return to, way - lag * (to - speed)


@compiled
def respond(p, s, actions, i, begin, end):
    """Moves reference and wheels of robot i on, between two times (s) of its control period.

    Returns the mean of the twist that the wheels turn for.
    """
    x_way = 0.0
    y_way = 0.0
    turn = 0.0
    time = begin
    while time < end:
        until = end
        vx = s.command_vx
        vy = s.command_vy
        yaw_rate = s.command_yaw_rate
        if p.continuous:
            for axis in range(3):
                if time < p.delay_rest[axis] < until:
                    until = p.delay_rest[axis]
            vx, vy, yaw_rate, _ = wanted(p, actions, i, time)
        span = until - time
        x_gone, y_gone = translate(p, s, vx, vy, span)
        x_way += x_gone
        y_way += y_gone
        turn += rotate(p, s, yaw_rate, span)
        time = until
    whole = end - begin
    return x_way / whole, y_way / whole, turn / whole


@inlined
def translate(p, s, vx, vy, span):
    """Moves the velocity on, towards a wanted one; returns the way (x, y) of it, m in the body frame."""
    dx = vx - s.command_vx
    dy = vy - s.command_vy
    change = math.sqrt(dx * dx + dy * dy)
    x_way = 0.0
    y_way = 0.0
    left = span
    if change > 0.0:
        dx /= change
        dy /= change
        # its size falls up to the point of the line that is nearest to rest
        falling = min(max(-(s.command_vx * dx + s.command_vy * dy), 0.0), change)
        for rising in range(2):
            much = change - falling if rising else falling
            rate = p.acceleration if rising else p.deceleration
            needed = much / rate
            if not (needed > 0.0 and left > 0.0):
                continue
            time = min(needed, left)
            s.wheel_vx, x_gone = lagged(s.wheel_vx, s.command_vx, rate * dx, time, p.lags[0])
            s.wheel_vy, y_gone = lagged(s.wheel_vy, s.command_vy, rate * dy, time, p.lags[1])
            x_way += x_gone
            y_way += y_gone
            if needed <= left and (rising or falling == change):
                s.command_vx = vx
                s.command_vy = vy
            else:
                s.command_vx += rate * dx * time
                s.command_vy += rate * dy * time
            left -= time
    if left > 0.0:
        s.wheel_vx, x_gone = lagged(s.wheel_vx, s.command_vx, 0.0, left, p.lags[0])
        s.wheel_vy, y_gone = lagged(s.wheel_vy, s.command_vy, 0.0, left, p.lags[1])
        x_way += x_gone
        y_way += y_gone
    return x_way, y_way


@inlined
def rotate(p, s, yaw_rate, span):
    """Moves the yaw rate on, towards a wanted one; returns the angle turned by, rad."""
    change = abs(yaw_rate - s.command_yaw_rate)
    side = math.copysign(1.0, yaw_rate - s.command_yaw_rate)
    falling = min(max(-s.command_yaw_rate * side, 0.0), change)
    turned = 0.0
    left = span
    for rising in range(2):
        much = change - falling if rising else falling
        rate = p.yaw_acceleration if rising else p.yaw_deceleration
        needed = much / rate
        if not (needed > 0.0 and left > 0.0):
            continue
        time = min(needed, left)
        s.wheel_yaw_rate, gone = lagged(s.wheel_yaw_rate, s.command_yaw_rate, rate * side, time, p.lags[2])
        turned += gone
        if needed <= left and (rising or falling == change):
            s.command_yaw_rate = yaw_rate
        else:
            s.command_yaw_rate += rate * side * time
        left -= time
    if left > 0.0:
        s.wheel_yaw_rate, gone = lagged(s.wheel_yaw_rate, s.command_yaw_rate, 0.0, left, p.lags[2])
        turned += gone
    return turned
