"""Where a base and its reference will be once a command has its effect: what laws that follow in time decide by.

A command is felt lag + dt/2 late, with the half period over which it is held. Until then the base does what it was
commanded before, which is known: from the measured pose and twist its pose of that time is predicted, and the reference
is read there. On an exact base that is worth a factor of ten, and no gain is worth it.

Source: Smith, Chemical Engineering Progress 53, 1957, for delays.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.robots.kinematics import integrate_arc, to_body_frame
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.params import plant
from wayfield.system.compiled import any_layout, compiled, inlined
from wayfield.system.elementary import exponential, sin_cos, wrap_angle

# Of each robot: its reference minus itself in its own frame, and the reference's twist with its derivatives there.
AIM = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("turn", np.float64),  # rad
        ("vx", np.float64),  # m/s, in the reference's frame
        ("vy", np.float64),
        ("yaw_rate", np.float64),  # rad/s
        ("vx_rate", np.float64),  # m/s^2, rad/s^2
        ("vy_rate", np.float64),
        ("yaw_acceleration", np.float64),
        ("measured_heading", np.float64),  # rad, of the robot now, in the world
    ],
    align=True,
)


def aims_of(name: str, observation: trajectory_tracking.Observation, briefing: Briefing, leads: bool) -> NDArray[Any]:
    """Returns the AIM records (b,) of robots: now, or where the next command has its effect.

    Raises:
        ValueError: if the preview is too short for that; the message names the policy and what is needed.
    """
    base = plant(briefing.robot, briefing.actuators, briefing.dt)
    spacing = briefing.preview_spacing
    ahead = float(base["lag"][0] + 0.5 * briefing.dt) if leads else 0.0
    points = observation.preview.shape[1]
    if not (points >= 3 and ahead <= points * spacing):
        raise ValueError(
            f"{name} reads its reference up to {max(ahead, 3 * spacing):.3g} s ahead; the preview has {points} samples "
            f"every {spacing:g} s: make the environment with num_preview={max(3, int(np.ceil(ahead / spacing)))}"
        )
    aims = np.zeros(len(observation.pose), AIM)
    aims["measured_heading"] = observation.pose[:, 2]
    fill_aims(
        base, ahead, spacing, observation.twist, observation.command, observation.error, observation.reference_twist,
        observation.preview, aims,
    )  # fmt: skip
    return aims


@inlined
def node(error, twist, preview, i, j, c):
    """Returns number c of the reference (x, y, heading, twist) at the j-th of the times that robot i sees."""
    if j == 0:
        return error[i, c] if c < 3 else twist[i, c - 3]
    return preview[i, j - 1, c]


@inlined
def hermite(z, h, a, va, b, vb):
    """Returns the cubic at share z between two values with their derivatives, h apart."""
    d = b - a
    u = h * va
    w = h * vb
    return a + z * (u + z * (3.0 * d - 2.0 * u - w + z * (u + w - 2.0 * d)))


@inlined
def between(z, a, b, c, d):
    """Returns value and derivative by z of the cubic through values at -1, 0, 1 and 2."""
    first = c - a * (1.0 / 3.0) - 0.5 * b - d * (1.0 / 6.0)
    second = 0.5 * (a + c) - b
    third = (d - a) * (1.0 / 6.0) + 0.5 * (b - c)
    return b + z * (first + z * (second + z * third)), first + z * (2.0 * second + z * 3.0 * third)


@inlined
def read_ahead(error, twist, preview, i, ahead, spacing, aim):
    """Fills an aim with the reference of `ahead` s on, as seen from the body now."""
    last = preview.shape[1]
    t = twist.shape[1]
    j = min(int(ahead / spacing), last - 1)
    z = ahead / spacing - j
    turns = node(error, twist, preview, i, j, 2), node(error, twist, preview, i, j + 1, 2)
    ends = turns[0], turns[0] + wrap_angle(turns[1] - turns[0])
    rates = node(error, twist, preview, i, j, 2 + t), node(error, twist, preview, i, j + 1, 2 + t)
    aim.turn = hermite(z, spacing, ends[0], rates[0], ends[1], rates[1])
    # velocities at both ends, in the body's frame
    s0, c0 = sin_cos(turns[0])
    s1, c1 = sin_cos(turns[1])
    v0 = node(error, twist, preview, i, j, 3)
    v1 = node(error, twist, preview, i, j + 1, 3)
    u0 = node(error, twist, preview, i, j, 4) if t == 3 else 0.0
    u1 = node(error, twist, preview, i, j + 1, 4) if t == 3 else 0.0
    x0 = node(error, twist, preview, i, j, 0)
    y0 = node(error, twist, preview, i, j, 1)
    x1 = node(error, twist, preview, i, j + 1, 0)
    y1 = node(error, twist, preview, i, j + 1, 1)
    aim.x = hermite(z, spacing, x0, c0 * v0 - s0 * u0, x1, c1 * v1 - s1 * u1)
    aim.y = hermite(z, spacing, y0, s0 * v0 + c0 * u0, y1, s1 * v1 + c1 * u1)
    k = min(max(j, 1), last - 2)  # the cubic through four times around
    at = ahead / spacing - k
    for c in range(t):
        value, rate = between(
            at,
            node(error, twist, preview, i, k - 1, 3 + c),
            node(error, twist, preview, i, k, 3 + c),
            node(error, twist, preview, i, k + 1, 3 + c),
            node(error, twist, preview, i, k + 2, 3 + c),
        )
        rate /= spacing
        if c == t - 1:
            aim.yaw_rate = value
            aim.yaw_acceleration = rate
        elif c == 0:
            aim.vx = value
            aim.vx_rate = rate
        else:
            aim.vy = value
            aim.vy_rate = rate


@inlined
def led_to(lag, time, command, wheels):
    """Returns where a command leads to in a time, from the twist that the wheels turn for: (x, y, turn) and the twist.

    Twists have three components.
    """
    left = 0.0
    mean = 0.0
    if lag > 0.0:
        left = exponential(-time / lag)
        mean = (1.0 - left) * lag / time
    vx, vy, w = command[0], command[1], command[2]
    dx, dy, dw = wheels[0] - vx, wheels[1] - vy, wheels[2] - w
    x, y, turn = integrate_arc(0.0, 0.0, 0.0, vx + mean * dx, vy + mean * dy, w + mean * dw, time)
    return x, y, turn, vx + left * dx, vy + left * dy, w + left * dw


@any_layout
@compiled
def fill_aims(bases, ahead, spacing, twists, commands, error, twist, preview, aims):
    """Fills the aims (b,) of robots that go on by their commands (b, t) until `ahead` s from now."""
    base = bases[0]
    last = twists.shape[1] - 1
    for i in range(aims.shape[0]):
        aim = aims[i]
        read_ahead(error, twist, preview, i, ahead, spacing, aim)
        if ahead > 0.0:
            command = commands[i, 0], commands[i, 1] if last == 2 else 0.0, commands[i, last]
            wheels = twists[i, 0], twists[i, 1] if last == 2 else 0.0, twists[i, last]
            led = led_to(base.lag, ahead, command, wheels)
            sine, cosine = sin_cos(led[2])
            aim.x, aim.y = to_body_frame(led[0], led[1], sine, cosine, aim.x, aim.y)
            aim.turn -= led[2]
        aim.turn = wrap_angle(aim.turn)
