"""Stanley's steering law on a base that has no front axle: a virtual one lies ahead of it."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.paths import nearest_ahead, segment_at, vertex
from wayfield.policies.parts.carrot import leg_that_leaves
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import PathLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.steering import Motion, unicycle_twists
from wayfield.system.compiled import any_layout, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Stanley(PathLaw):
    """Turns a virtual front wheel along the path and towards it, by an angle that grows with the distance from it.

    Stanley (virtual front axle): the wheel lies d = `axle_distance` ahead of the robot's centre and rolls at the speed
    u. With psi the path's heading at the point nearest to the wheel, e the wheel's distance from that point, + left of
    the path, th the robot's heading and u_m the measured speed of the wheel:

        steering = wrap(psi - th) - atan(k e / (k_s + u_m)),  within +-max_steering, changing by max_steering_rate
        v = u cos(steering),  w = u sin(steering) / d
        u = min(speed, d sqrt(2 alpha |steering|) / |sin(steering)|)

    (v, w d) is the velocity of the point d ahead, so that this is the one twist that rolls the wheel where it is
    steered; sin and not tan because u is the wheel's speed, not the centre's. Hence e' = -u sin(atan(k e / (k_s + u))),
    for small errors e' = -k e u / (k_s + u). The bound on u lets the base end its turn, w^2 <= 2 alpha |steering|, with
    alpha a `share` of its yaw acceleration; without it the robot rocks at corners. v is never negative: a robot that
    looks more than 90 degrees off turns on the spot.

    The wheel finds the path, the centre does not: on a circle of radius R it runs R - sqrt(R^2 - d^2) inside, 0.046 m
    for R = 1 m and d = 0.3 m. The law looks at no curvature ahead and brakes for no corner before it steers. At an open
    path's end it does not stop.

    Source: Hoffmann, Tomlin, Montemerlo, Thrun, ACC 2007; the virtual axle and the bound on u are additions. Serves
    differential drive, and omni drive as a unicycle.
    """

    k: float = gain(1.5, "1/s", "of the cross-track error at the front axle", above=0.0, search=(0.5, 5.0))
    k_s: float = gain(0.1, "m/s", "keeps the law from flipping over at rest", above=0.0, search=(0.01, 0.5))
    speed: float = gain(0.6, "m/s", "of the wheel", above=0.0)
    axle_distance: float = gain(0.22, "m", "d, of the virtual axle", above=0.0, search=(0.05, 0.4))
    max_steering: float = gain(0.5 * math.pi, "rad", "of the virtual wheel", above=0.0, most=0.5 * math.pi)
    max_steering_rate: float = gain(10.0, "rad/s", "of the virtual wheel", above=0.0, search=(2.0, 20.0))
    share: float = gain(0.5, "1", "of the yaw acceleration", above=0.0, search=(0.2, 1.0))
    window: float = gain(1.0, "m", "of path that is searched for the wheel, ahead of the projection", above=0.0)

    needs: ClassVar[tuple[str, ...]] = ("turns_on_the_spot",)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the steering angles, (b, 1) rad: straight ahead."""
        return np.zeros((briefing.num_envs, 1))

    def act(self, observation: path_following.Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t): m/s and rad/s."""
        p = params(
            self,
            briefing,
            max_change=self.max_steering_rate * briefing.dt,
            yaw_acceleration=self.share * briefing.actuators.yaw_acceleration,
        )
        command = np.empty((2, len(observation.pose)))
        steer_rows(p, *smoothed(briefing.path, Motion.of(observation)), memory, command)
        return unicycle_twists(briefing.robot, command[0], command[1])


@any_layout
@compiled
def steer_rows(params, course, motion, memory, command):
    """Fills the command (2, b), v in m/s and w in rad/s, and moves the steering angles of the memory (b, 1)."""
    p = params[0]
    vertices, runs, path_index = course
    twists = motion.twists
    for i in range(path_index.shape[0]):
        run = runs[path_index[i]]
        x, y, heading = motion.poses[i]
        sine, cosine = sin_cos(heading)
        x += p.axle_distance * cosine
        y += p.axle_distance * sine
        e, tangent = from_path(vertices, run, motion.arc_lengths[i], p.window, x, y)
        turn = wrap_angle(tangent - heading)
        sideways = p.axle_distance * twists[i, twists.shape[1] - 1]
        rolling = math.sqrt(twists[i, 0] * twists[i, 0] + sideways * sideways)
        steering = turn - bearing(p.k * e, p.k_s + rolling)
        steering = min(max(steering, -p.max_steering), p.max_steering)
        steering = min(max(steering, memory[i, 0] - p.max_change), memory[i, 0] + p.max_change)
        memory[i, 0] = steering
        sine, cosine = sin_cos(steering)
        # the wheel rolls no faster than the base can end the turn that it steers: w^2 / 2 alpha <= |steering|
        rolling = p.speed
        if steering != 0.0:
            rolling = min(p.speed, p.axle_distance * math.sqrt(2.0 * p.yaw_acceleration * abs(steering)) / abs(sine))
        command[0, i] = rolling * max(cosine, 0.0) if abs(turn) <= 0.5 * math.pi else 0.0
        command[1, i] = rolling * sine / p.axle_distance


@inlined
def from_path(vertices, run, s, window, x, y):
    """Returns (e, heading): how far left of the path's nearest point (x, y) lies, m, and its heading there, rad.

    It is looked for from arc length s (m) on, over `window` (m).
    """
    lap = math.floor(s / run.length) * run.length if run.closed else 0.0
    s, segment = nearest_ahead(vertices, run, x, y, s, segment_at(vertices, run, s - lap), window)
    # at a corner the path goes on along the segment that leaves it: the one that enters would lead straight on
    segment, along = leg_that_leaves(vertices, run, s, segment)
    a = vertex(vertices, run, segment)
    # the distance from the nearest point and not from the segment's line: past a corner the line is nearer
    dx = x - a.x - along * a.ux
    dy = y - a.y - along * a.uy
    return math.copysign(math.sqrt(dx * dx + dy * dy), a.ux * dy - a.uy * dx), a.heading
