"""Whether a law that follows in time is stable as it is sampled: its spectral radius about a circle."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.robots.records import lag_factors
from wayfield.envs.tasks.briefing import Briefing

Array = NDArray[np.float64]

SPEED, RADIUS = 0.6, 1.0  # m/s or half of what the base can, m: of the circle
_PREVIEW, _SPACING = 8, 0.1  # samples, s
_SETTLING = 10  # control periods, after which what a law keeps is steady
_OFF = 1e-6  # m, rad, m/s, rad/s: of a derivative


def check_stable(law: Any, robot: Robot, actuators: Actuators, dt: float) -> None:
    """Raises ValueError, with the spectral radius, where a law's errors grow about a circle on a base."""
    key = (law, id(robot), actuators, dt)
    if key not in _RADII:
        _RADII[key] = float(np.abs(eigenvalues(law, robot, actuators, dt)).max()), robot
    if not (radius := _RADII[key][0]) < 1.0:
        raise ValueError(
            f"{type(law).__name__}: errors about a circle grow by {radius:.4g} a control period with these gains on "
            f"{robot.name!r} (lag {actuators.reaction:g} s); it must be less than 1: lower the gains"
        )


# the robot is kept, so that its id stays its own
_RADII: dict[tuple[Any, ...], tuple[float, Robot]] = {}


def eigenvalues(law: Any, robot: Robot, actuators: Actuators, dt: float) -> NDArray[np.complex128]:
    """Returns the factors by which errors of a law about a steady circle change in a control period.

    They are those of the exact period's derivative: by the pose, by the twist that the wheels turn for, by the last
    command and by what the law keeps. Their largest size is the spectral radius: at 1 or more, errors grow. Limits of
    the base are left out: gains under 1 may swing for ever where its accelerations are bounded.

    Args:
        law: a `ReferenceLaw`, whose memory (b, 4) begins at zero.
    """
    axes = len(robot.twist_axes)
    v = min(SPEED, 0.5 * float(robot.max_twist[0]))
    circle = np.array([v, *[0.0] * (axes - 2), v / RADIUS])
    ahead = _arc(np.tile(circle, (_PREVIEW, 1)), _SPACING * np.arange(1.0, _PREVIEW + 1)[:, None])
    briefing = Briefing(
        1, robot, actuators, dt, "twist", trajectory_tracking.Observation.layout(axes, _PREVIEW), np.empty(0), 0.0,
        preview_spacing=_SPACING,
    )  # fmt: skip
    memory = np.zeros((1, 4))
    decay, mean = lag_factors(actuators.reaction, dt)
    step = _arc(circle[None], np.array([[dt]]))[0]

    def period(states: Array, memory: Array) -> tuple[Array, Array]:
        """Returns robots (b, 3 + 2 axes) in the reference's frame, and what the law keeps of them, a period later."""
        pose, wheels, command = states[:, :3], states[:, 3 : 3 + axes], states[:, 3 + axes :]
        memory = memory.copy()
        there = np.concatenate([np.zeros((len(states), 1, 3)), np.tile(ahead, (len(states), 1, 1))], axis=1)
        seen = _seen(pose[:, None], there)
        twists = np.broadcast_to(circle, (len(states), axes))
        preview = np.concatenate([seen[:, 1:], np.tile(circle, (len(states), _PREVIEW, 1))], axis=2)
        observation = trajectory_tracking.Observation(
            pose.copy(), wheels.copy(), seen[:, 0], twists.copy(), command.copy(), np.zeros(len(states)), preview
        )
        requested = law.act(observation, briefing, memory)
        moved = _arc(requested + mean * (wheels - requested), np.array([[dt]]))
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        after = pose + np.column_stack(
            [c * moved[:, 0] - s * moved[:, 1], s * moved[:, 0] + c * moved[:, 1], moved[:, 2]]
        )
        return np.column_stack([_seen(step, after), requested + decay * (wheels - requested), requested]), memory

    states = np.concatenate([np.zeros(3), circle, circle])[None]
    for _ in range(_SETTLING):
        memory = period(states, memory)[1]
    whole = np.column_stack([states, memory])
    n = whole.shape[1]
    both = np.concatenate([whole + _OFF * np.eye(n), whole - _OFF * np.eye(n)])
    after = np.column_stack(period(both[:, : states.shape[1]], both[:, states.shape[1] :]))
    matrix = (after[:n] - after[n:]) / (2.0 * _OFF)
    is_state = np.abs(matrix - np.eye(n)).sum(axis=1) > 1e-9  # a number that a law never changes is no state of its own
    return np.asarray(np.linalg.eigvals(matrix[np.ix_(is_state, is_state)]), np.complex128)


def _arc(twists: Array, times: Array) -> Array:
    """Returns the poses (b, 3) after constant twists (b, 2 or 3) have acted for times (b, 1) or (1, 1), s."""
    vx, w = twists[:, 0], twists[:, -1]
    vy = twists[:, 1] if twists.shape[1] == 3 else np.zeros(len(twists))
    half = 0.5 * w * times[:, 0]
    chord = times[:, 0] * np.sinc(half / np.pi)
    c, s = np.cos(half), np.sin(half)
    return np.column_stack([chord * (c * vx - s * vy), chord * (s * vx + c * vy), 2.0 * half])


def _seen(frames: Array, poses: Array) -> Array:
    """Returns poses (..., 3) in frames (..., 3)."""
    c, s = np.cos(frames[..., 2]), np.sin(frames[..., 2])
    dx, dy = poses[..., 0] - frames[..., 0], poses[..., 1] - frames[..., 1]
    turn = poses[..., 2] - frames[..., 2]
    return np.stack([c * dx + s * dy, c * dy - s * dx, turn + np.zeros_like(dx)], axis=-1)
