"""The kinematic plant: from an action to wheel speeds, and from wheel speeds to motion on an exact arc."""

import math

from wayfield.envs.robots.hulls import hull_clearance, swing
from wayfield.envs.robots.kinematics import integrate_arc, limits
from wayfield.envs.robots.records import stop
from wayfield.envs.robots.response import request, respond
from wayfield.envs.robots.sensing import advance_odometry
from wayfield.system.compiled import inlined
from wayfield.system.elementary import sin_cos, wrap_angle

# A hull stops this far from a surface when the sweep finds contact, so that rounding never puts it inside.
SKIN = 1e-9  # m
STRIDE = 2e-4  # m, the least that a sweep goes at once
# Where a sweep ends in any case. The longest shove takes 7e5 strides; what is left after is not gone.
MOST_STRIDES = 1_000_000


@inlined
def command(p, s, actions, i):
    """Turns an action into the twist commanded to the wheels: what its `limits` leave of it."""
    vx = 0.0
    vy = 0.0
    yaw_rate = 0.0
    if p.twist_action:
        vx = actions[i, 0]
        if p.holonomic:
            vy = actions[i, 1]
            yaw_rate = actions[i, 2]
        else:
            yaw_rate = actions[i, 1]
    else:
        # wheel speeds of an omni base can contradict each other: the pseudo-inverse is what rolls without slip
        for k in range(p.num_wheels):
            vx += p.forward_matrix[0, k] * actions[i, k]
            vy += p.forward_matrix[1, k] * actions[i, k]
            yaw_rate += p.forward_matrix[2, k] * actions[i, k]
    # beyond any wheel, and below where squares overflow
    largest = max(abs(vx), abs(vy), abs(yaw_rate))
    if largest > 1e9:
        vx *= 1e9 / largest
        vy *= 1e9 / largest
        yaw_rate *= 1e9 / largest
    if p.responds:
        request(p, s, actions, i, vx, vy, yaw_rate)
        return
    last = s.command_vx, s.command_vy, s.command_yaw_rate
    s.command_vx, s.command_vy, s.command_yaw_rate, factor = limits(p, last, (vx, vy, yaw_rate), p.dt)
    s.saturated = factor < 1.0


@inlined
def lagging_twist(s, share):
    """Returns the commanded twist plus a share of what the wheels still deviate from it."""
    return (
        s.command_vx + share * (s.wheel_vx - s.command_vx),
        s.command_vy + share * (s.wheel_vy - s.command_vy),
        s.command_yaw_rate + share * (s.wheel_yaw_rate - s.command_yaw_rate),
    )


@inlined
def body_twist(p, vx, vy, yaw_rate):
    """Returns the twist of the body whose wheels turn for the given one: see `disturbances.Disturbance`."""
    if not p.distorted:
        return vx, vy, yaw_rate
    m = p.distortion
    body_vx = m[0, 0] * vx + m[0, 1] * vy + m[0, 2] * yaw_rate
    body_vy = m[1, 0] * vx + m[1, 1] * vy + m[1, 2] * yaw_rate
    body_yaw_rate = m[2, 0] * vx + m[2, 1] * vy + m[2, 2] * yaw_rate
    # against the centripetal acceleration w x v
    drift = p.side_slip * body_yaw_rate
    return body_vx + drift * body_vy, body_vy - drift * body_vx, body_yaw_rate


@inlined
def drive(p, s, robots, actions, i, row):
    """Moves the robot by one control period: first-order lag, then an exact arc that stops where the hull touches."""
    if p.responds:
        mean_vx, mean_vy, mean_yaw_rate = respond(p, s, actions, i, 0.0, p.dt)
    else:
        mean_vx, mean_vy, mean_yaw_rate = lagging_twist(s, p.lag_mean)
        s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate = lagging_twist(s, p.lag_decay)
    body_vx, body_vy, body_yaw_rate = body_twist(p, mean_vx, mean_vy, mean_yaw_rate)
    s.vx, s.vy, s.yaw_rate = body_twist(p, s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate)
    s.contact = 0
    sweep(p, s, robots, i, body_vx, body_vy, body_yaw_rate)
    if not p.perfect_pose:
        if p.passive_encoders:
            mean_vx = body_vx
            mean_vy = body_vy
            mean_yaw_rate = body_yaw_rate
        advance_odometry(p, s, mean_vx, mean_vy, mean_yaw_rate, robots.noise, i, row)


@inlined
def sweep(p, s, robots, i, vx, vy, yaw_rate):
    """Moves the pose along the arc of a constant twist, up to the first contact of the hull.

    Conservative advancement: the hull can go as far as its clearance without touching anything, wherever that leads, so
    that a fast robot cannot jump through a thin wall. Close to a surface it goes on in strides; once one ends
    in contact, bisection finds the pose just before it.
    """
    travel = p.dt * (math.sqrt(vx * vx + vy * vy) + swing(p, yaw_rate))
    if s.clearance >= travel:
        s.x, s.y, s.heading = integrate_arc(s.x, s.y, s.heading, vx, vy, yaw_rate, p.dt)
        s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
        return
    x = s.x
    y = s.y
    heading = s.heading
    gone = 0.0  # share of the step that is known to be free
    blocked = 1.0  # share at which the hull is known to touch, once it does
    for _ in range(MOST_STRIDES):
        if not (blocked - gone) * travel > SKIN:
            break
        if s.contact:
            ahead = 0.5 * (gone + blocked)
        else:
            ahead = min(gone + max(s.clearance - SKIN, STRIDE) / travel, 1.0)
        to_x, to_y, to_heading = integrate_arc(x, y, heading, vx, vy, yaw_rate, p.dt * ahead)
        clear = hull_clearance(p, robots, i, s, to_x, to_y, to_heading)
        if clear < SKIN and clear < s.clearance:
            s.contact = 1
            blocked = ahead
        else:
            gone = ahead
            s.x = to_x
            s.y = to_y
            s.heading = to_heading
            s.clearance = clear
    if s.contact:
        stop(s)


@inlined
def shove(p, s, robots, i):
    """Displaces the pose where the given shove is due, or the drawn one or its drift, up to the first contact."""
    given = s.steps == p.shove_step
    since = s.steps - s.shove_step
    drawn = s.shove_step >= 0 and 0 <= since < p.shove_periods
    if not (given or drawn):
        return
    dx = p.shove_x if given else 0.0
    dy = p.shove_y if given else 0.0
    turn = p.shove_heading if given else 0.0
    if drawn:
        sine, cosine = sin_cos(s.shove_direction)
        size = p.drawn_shove
        if p.shove_swing > 0.0:
            size *= sin_cos(p.shove_swing * (since + 0.5))[0]
        dx += size * cosine
        dy += size * sine
    sine, cosine = sin_cos(s.heading)
    vx = (cosine * dx + sine * dy) / p.dt
    vy = (cosine * dy - sine * dx) / p.dt
    # the displacement is no motion of the wheels: twist and odometry do not see it
    body_vx = s.vx
    body_vy = s.vy
    body_yaw_rate = s.yaw_rate
    sweep(p, s, robots, i, vx, vy, 0.0)
    if not s.contact:
        s.vx = body_vx
        s.vy = body_vy
        s.yaw_rate = body_yaw_rate
    if p.hull_length > 0.0:
        # a rectangle that has no room for the turn stays as it stands
        clear = hull_clearance(p, robots, i, s, s.x, s.y, wrap_angle(s.heading + turn))
        if clear < SKIN and clear < s.clearance:
            s.contact = 1
            stop(s)
            return
        s.clearance = clear
    s.heading = wrap_angle(s.heading + turn)
