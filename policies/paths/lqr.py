"""Linear-quadratic regulator in path coordinates, with curvature feed-forward and a speed profile."""

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import PathLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.speed_profile import curvature_at, heading_at, limits, reference_at, speed_at
from wayfield.policies.parts.steering import Motion, unicycle_twists
from wayfield.system.compiled import any_layout, compiled, inlined
from wayfield.system.elementary import sin_cos, wrap_angle
from wayfield.system.linear import product, riccati

Array = NDArray[np.float64]

SLOWEST = 0.05  # m/s; a robot at rest cannot mend a cross-track error: there the Riccati equation has no solution
ROWS = 24  # of the table of gains
NEWTON_STEPS = 3  # of the projection on the rounded path


@dataclasses.dataclass(frozen=True)
class Lqr(PathLaw):
    """Linear feedback of the path errors with the optimal gains, feed-forward of the curvature, and a speed profile.

    In path coordinates, with e the distance from the path, + left of it, th_e the heading error and kappa the path's
    curvature:

        e' = v sin(th_e),  th_e' = w - w_ref,  w_ref = v kappa cos(th_e) / (1 - kappa e)
        w = w_ref(ahead) - k2 (clip(k1 e / k2, +-max_approach) + th_e) - k3 (w_measured - w_ref(here))

    which for small errors is w = w_ref - k1 e - k2 th_e - k3 (w_measured - w_ref). The gains minimise the sum of
    q_e e^2 + q_th th_e^2 + (w - w_ref)^2 under the sampled plant with its actuator lag (`model`): the solution of the
    discrete Riccati equation, in a table over v. w_ref is read ahead by v (lag + dt/2), where the robot is when the
    wheels answer; else every curve is steered too late.

    Reference and speed come from `speed_profile`: corners are rounded over `rounding`, and the speed keeps the limits
    of lateral acceleration, yaw rate and yaw acceleration, slows down for what lies ahead, and is 0 at an open path's
    end. The command changes by no more than the plant follows, so that v and w lag alike and w / v stays kappa. A robot
    that looks more than 90 degrees off turns on the spot.

    Optimal for small errors and unbounded yaw acceleration; high weights saturate it at corners.

    Source: Rajamani, Vehicle Dynamics and Control, for the path coordinates. Serves differential drive, and omni drive
    as a unicycle.
    """

    speed: float = gain(0.6, "m/s", "wanted on a straight line", above=0.0)
    q_e: float = gain(
        40.0, "1/m^2", "weight of the cross-track error; the yaw rate's is 1", above=0.0, search=(5.0, 1000.0)
    )
    q_th: float = gain(4.0, "1/rad^2", "weight of the heading error", above=0.0, search=(0.5, 40.0))
    rounding: float = gain(0.1, "m", "h: corners become bends of length 4h", above=0.0, search=(0.03, 0.3))
    acceleration: float = gain(1.0, "m/s^2", "along the path", above=0.0)
    lateral_acceleration: float = gain(1.0, "m/s^2", "in bends", above=0.0, search=(0.3, 2.0))
    share: float = gain(0.8, "1", "of the limits, in the speed profile", above=0.0, search=(0.4, 1.0), linear=True)
    max_approach: float = gain(
        1.0, "rad", "angle to the path at which a far robot comes back", above=0.0, search=(0.4, 1.5)
    )

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the speed commanded last, (b, 1) m/s: the robots are at rest."""
        return np.zeros((briefing.num_envs, 1))

    def gains(self, briefing: Briefing) -> tuple[Array, Array]:
        """Returns the table of speeds (n,) m/s and of the gains k1, k2, k3 at each, (n, 3)."""
        return gain_table(self.speed, briefing.dt, briefing.actuators.reaction, self.q_e, self.q_th)

    def act(self, observation: path_following.Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t): m/s and rad/s."""
        actuators = briefing.actuators
        p = params(
            self,
            briefing,
            preview=actuators.reaction + 0.5 * briefing.dt,
            most_change=actuators.acceleration * briefing.dt,
            **limits(briefing, self.acceleration, self.lateral_acceleration, self.share),
        )
        command = np.empty((2, len(observation.pose)))
        driven = smoothed(briefing.path, Motion.of(observation), ends_only=True)
        steer_rows(p, *self.gains(briefing), *driven, memory, command)
        return unicycle_twists(briefing.robot, command[0], command[1])


def model(speed: float, dt: float, lag: float) -> tuple[Array, Array]:
    """Returns (A, B) of the errors (e, th_e, w) over one control period.

    The plant as it is: the yaw rate lags, and its mean over the period turns the robot along an exact arc.
    """
    decay = math.exp(-dt / lag) if lag > 0.0 else 0.0
    mean = lag / dt * (1.0 - decay)  # share that the old yaw rate has in the period's mean
    a = np.array(
        [
            [1.0, speed * dt, 0.5 * speed * dt**2 * mean],
            [0.0, 1.0, dt * mean],
            [0.0, 0.0, decay],
        ]
    )
    b = np.array([[0.5 * speed * dt**2 * (1.0 - mean)], [dt * (1.0 - mean)], [1.0 - decay]])
    return a, b


@functools.lru_cache(maxsize=64)
def gain_table(speed: float, dt: float, lag: float, q_e: float, q_th: float) -> tuple[Array, Array]:
    """Returns speeds (n,) m/s and the optimal gains at each, (n, 3)."""
    speeds = np.linspace(min(SLOWEST, 0.5 * speed), 1.25 * speed, ROWS)
    gains = np.empty((ROWS, 3))
    cost = np.diag([q_e, q_th, 0.0])
    for v, row in zip(speeds.tolist(), gains, strict=True):
        a, b = model(v, dt, lag)
        p = riccati(a, b, cost, 1.0)
        pull = product(b.T, p)
        row[:] = product(pull, a)[0] / (1.0 + product(pull, b)[0, 0])
    speeds.setflags(write=False)
    gains.setflags(write=False)
    return speeds, gains


@any_layout
@compiled
def steer_rows(params, speeds, gains, course, motion, memory, command):
    """Fills the command (2, b), v in m/s and w in rad/s, and keeps v in the memory (b, 1).

    Beside the gains: `preview` (s), how far ahead w_ref is read, and `most_change` (m/s) of the speed in a period.
    """
    p = params[0]
    vertices, runs, path_index = course
    for i in range(path_index.shape[0]):
        run = runs[path_index[i]]
        x, y, heading = motion.poses[i]
        speed = max(motion.twists[i, 0], 0.0)
        yaw_rate = motion.twists[i, motion.twists.shape[1] - 1]
        s, tangent, e = on_rounded_path(vertices, run, motion.arc_lengths[i], p.rounding, x, y)
        th_e = wrap_angle(heading - tangent)
        facing = max(sin_cos(th_e)[1], 0.0)
        kappa = curvature_at(vertices, run, s, p.rounding)
        # beyond the centre of the curve the path coordinates end
        stretch = facing / max(1.0 - kappa * e, 0.5)
        ahead = s + p.preview * speed
        v = facing * speed_at(vertices, run, ahead, p.rounding, p)
        v = min(max(v, memory[i, 0] - p.most_change), memory[i, 0] + p.most_change)
        memory[i, 0] = v
        k1, k2, k3 = gains_at(speeds, gains, speed)
        approach = min(max(k1 / k2 * e, -p.max_approach), p.max_approach)
        feed_forward = v * curvature_at(vertices, run, ahead, p.rounding) * stretch
        command[0, i] = v
        command[1, i] = feed_forward - k2 * (approach + th_e) - k3 * (yaw_rate - speed * kappa * stretch)


@inlined
def on_rounded_path(vertices, run, s, rounding, x, y):
    """Returns (s, tangent, e): the nearest point of the rounded path, from the nearest of the path as it is, at s (m).

    The path as it is leaps at corners. tangent in rad; e in m, how far to the left of it (x, y) lies.
    """
    tangent = heading_at(vertices, run, s, rounding)
    along, e = from_path(vertices, run, s, rounding, tangent, x, y)
    for _ in range(NEWTON_STEPS):
        beyond = s + min(max(along, -rounding), rounding)
        there = heading_at(vertices, run, beyond, rounding)
        # where the path turns back on itself there is no going round the tip
        if abs(wrap_angle(there - tangent)) > 0.5 * math.pi:
            break
        s = beyond
        tangent = there
        along, e = from_path(vertices, run, s, rounding, tangent, x, y)
    return s, tangent, e


@inlined
def gains_at(speeds, gains, speed):
    """Returns the gains k1, k2, k3 at a speed (m/s), linear between the rows of their table."""
    row = (speed - speeds[0]) / (speeds[1] - speeds[0])
    row = min(max(0.0, row), speeds.shape[0] - 1.0)
    j = min(int(row), speeds.shape[0] - 2)
    part = row - j
    k1 = gains[j, 0] + part * (gains[j + 1, 0] - gains[j, 0])
    k2 = gains[j, 1] + part * (gains[j + 1, 1] - gains[j, 1])
    k3 = gains[j, 2] + part * (gains[j + 1, 2] - gains[j, 2])
    return k1, k2, k3


@compiled
def from_path(vertices, run, s, rounding, tangent, x, y):
    """Returns how far (x, y) lies along and to the left of the rounded path's point and tangent at s, m."""
    px, py = reference_at(vertices, run, s, rounding)
    sine, cosine = sin_cos(tangent)
    return to_body_frame(px, py, sine, cosine, x, y)
