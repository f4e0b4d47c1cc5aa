"""Park and Kuipers' smooth pose law: to a pose of given position and heading along a graceful curve."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.arriving import is_there, stay_radius, turn_rate
from wayfield.policies.parts.carrot import distance_left, place_on_lap, pose_ahead, stopping_speed
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.params import params
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.steering import Motion, unicycle_twists
from wayfield.system.compiled import any_layout, compiled, inlined
from wayfield.system.elementary import bearing, power, sin_cos, wrap_angle

_HYSTERESIS = 0.5 * math.pi  # rad, by which the other way must be better to be taken instead

MEMORY = np.dtype(
    [
        ("arrived", np.float64),  # 1: at the goal
        ("way", np.float64),  # 1 forward, -1 backward, 0: not chosen
        ("stay", np.float64),  # m, of `stay_radius`
    ]
)


@dataclasses.dataclass(frozen=True)
class SmoothPose(Gains):
    """Drives to a pose along a curve that ends in its heading; follows a path by chasing a pose on it.

    With r the distance to the pose, delta the robot's heading and phi the pose's, both relative to the line of sight
    from the robot to the pose, and s the way left to the goal or to the end of an open path:

        curvature = -1/r (k2 (delta - atan(-k1 phi)) + (1 + k1 / (1 + (k1 phi)^2)) sin delta)
        v = min(speed / (1 + beta |curvature|^lam), sqrt(2 deceleration s)),  w = v curvature

    The heading falls onto atan(-k1 phi), k2 times faster than phi falls, which brings the robot onto the line that runs
    through the pose. As it stands, v |curvature| falls again where the curvature exceeds (beta (lam - 1))^(-1/lam), so
    that a robot beside its goal would all but stop: there the yaw rate is held instead, v ~ 1 / |curvature|. To cut the
    curvature would not do: the robot could go round the goal on that circle for ever.

    A path is followed by chasing the pose (point and tangent) `lookahead_distance` ahead along it. On an arc of a
    circle k1 = 1, k2 = 3 make that exact up to the fourth order of the angle between the two.

    A goal is reached in the same way, whatever stands in between; a waypoint is driven at without a heading of its own.
    The law is singular at r = 0. Within arrival_radius, or twice that with the goal no longer ahead, the robot counts
    as there: it stops and turns on the spot by the error e, |w| = min(turn_gain e, sqrt(2 yaw_acceleration e),
    max_yaw_rate), and goes on only once it is farther away than twice that. Drives any robot as a unicycle,
    differential and omni.

    With `backward` it may also drive to a goal in reverse: the same law in a frame turned by half a turn, v
    negated. It takes the way on which |delta| + |phi| is smaller, and changes it where the other is by 90 degrees less.

    Source: Park and Kuipers, A Smooth Control Law for Graceful Motion of Differential Wheeled Mobile Robots in 2D
    Environment, ICRA 2011. The held yaw rate, the braking and the turn at the end are ours.
    """

    k1: float = gain(1.0, "1", "steepness of the approach", above=0.0, search=(0.3, 3.0))
    k2: float = gain(3.0, "1", "of the heading, relative to the approach", above=0.0, search=(1.0, 10.0))
    speed: float = gain(0.6, "m/s", "of cruising", above=0.0, search=(0.2, 0.6))
    beta: float = gain(0.1, "m^lam", "how much bends slow down", above=0.0, search=(0.01, 1.0))
    lam: float = gain(2.0, "1", "power with which sharper bends slow down more", above=1.0)
    lookahead_distance: float = gain(0.6, "m", "along a path", above=0.0, search=(0.25, 1.0))
    deceleration: float = gain(
        0.5,
        "m/s^2",
        "towards the goal or an open end, at most",
        above=0.0,
        search=(0.2, 0.8),
    )
    arrival_radius: float = gain(
        0.05,
        "m",
        "within which it turns to the heading, or less if the goal asks for it",
        above=0.0,
        search=(0.01, 0.05),
    )
    turn_gain: float = gain(2.0, "1/s", "of the turn at the goal", above=0.0)
    yaw_acceleration: float = gain(1.0, "rad/s^2", "of the turn at the goal; no more than the base can", above=0.0)
    max_yaw_rate: float = gain(1.5, "rad/s", "of the turn at the goal", above=0.0)
    backward: bool = gain(False, "", "whether it may drive to a goal in reverse")

    knows: ClassVar[str] = "path"
    observes: ClassVar[tuple[type, ...]] = (path_following.Observation, goal_reaching.Observation)
    needs: ClassVar[tuple[str, ...]] = ("turns_on_the_spot",)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns whether each robot has arrived at its goal and which way it drives, MEMORY records (b,)."""
        memory = np.zeros(briefing.num_envs, MEMORY)
        memory["stay"] = stay_radius(self.arrival_radius, briefing)
        return memory

    def act(
        self,
        observation: path_following.Observation | goal_reaching.Observation,
        briefing: Briefing,
        memory: NDArray[Any],
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        p = params(
            self,
            briefing,
            # where v |curvature| is largest: beyond, the yaw rate is held
            peak=(self.beta * (self.lam - 1.0)) ** (-1.0 / self.lam),
            deceleration=min(self.deceleration, briefing.actuators.acceleration),
            yaw_acceleration=min(self.yaw_acceleration, briefing.actuators.yaw_acceleration),
        )
        twists = np.empty((len(observation.pose), 2))
        seen: Any = observation
        if briefing.path is not None:
            chase(p, *smoothed(briefing.path, Motion.of(seen)), twists)
        else:
            approach(p, seen.goal, seen.goal_heading_error, seen.waypoints_left, memory, twists)
        return unicycle_twists(briefing.robot, twists[:, 0], twists[:, 1])


@inlined
def smooth_curvature(r, delta, phi, k1, k2):
    """Returns the curvature (1/m) of Park and Kuipers' law, for r > 0 in m and angles in rad."""
    steep = 1.0 + k1 / (1.0 + (k1 * phi) * (k1 * phi))
    return -(steep * sin_cos(delta)[0] + k2 * (delta - bearing(-k1 * phi, 1.0))) / r


@inlined
def graceful(p, px, py, turn):
    """Returns (v, w) towards a pose at (px, py) in the body frame (m), its heading `turn` (rad) off the robot's."""
    r = math.sqrt(px * px + py * py)
    delta = -bearing(py, px)
    curvature = smooth_curvature(max(r, 1e-6), delta, wrap_angle(turn + delta), p.k1, p.k2)
    bend = min(abs(curvature), p.peak)
    v = p.speed / (1.0 + p.beta * power(bend, p.lam))
    if abs(curvature) > p.peak:
        v *= p.peak / abs(curvature)
    return v, v * curvature


@any_layout
@compiled
def chase(params, course, motion, twists):
    """Fills the (b, 2) speeds and yaw rates of `SmoothPose.act` along a path."""
    p = params[0]
    vertices, runs, path_index = course
    for i in range(path_index.shape[0]):
        run = runs[path_index[i]]
        x, y, heading = motion.poses[i]
        sine, cosine = sin_cos(heading)
        along, segment = place_on_lap(vertices, run, motion.arc_lengths[i])
        px, py, tangent = pose_ahead(vertices, run, along, segment, p.lookahead_distance)
        px, py = to_body_frame(x, y, sine, cosine, px, py)
        v, w = graceful(p, px, py, wrap_angle(tangent - heading))
        brake = min(1.0, stopping_speed(distance_left(run, along), p.deceleration) / v)
        twists[i, 0] = brake * v
        twists[i, 1] = brake * w


@inlined
def detour_angle(px, py, turn):
    """Returns |delta| + |phi| (rad) of a pose at (px, py) in the robot's frame, its heading `turn` off the robot's."""
    delta = -bearing(py, px)
    return abs(delta) + abs(wrap_angle(turn + delta))


@inlined
def chosen_way(p, way, px, py, turn):
    """Returns which way to drive to a pose, 1 forward or -1 backward, given the one taken so far, 0 for none."""
    if not p.backward:
        return 1.0
    gain = detour_angle(px, py, turn) - detour_angle(-px, -py, turn)  # of driving backward
    return -1.0 if gain > way * _HYSTERESIS else 1.0


@any_layout
@compiled
def approach(params, goals, turns, waypoints_left, memory, twists):
    """Fills the (b, 2) speeds and yaw rates of `SmoothPose.act` towards a goal and keeps the memory up to date."""
    p = params[0]
    for i in range(goals.shape[0]):
        m = memory[i]
        px = goals[i, 0]
        py = goals[i, 1]
        if waypoints_left[i] > 0.0:
            m.arrived = 0.0
            m.way = 0.0
            twists[i, 0], twists[i, 1] = graceful(p, px, py, bearing(py, px))
            continue
        m.way = chosen_way(p, m.way, px, py, turns[i])
        px *= m.way
        py *= m.way
        m.arrived = 1.0 if is_there(m.arrived == 1.0, px, py, p.arrival_radius, m.stay) else 0.0
        if m.arrived == 1.0:
            twists[i, 0] = 0.0
            twists[i, 1] = turn_rate(p, turns[i])
        else:
            v, w = graceful(p, px, py, turns[i])
            brake = min(1.0, stopping_speed(math.sqrt(px * px + py * py), p.deceleration) / v)
            twists[i, 0] = m.way * brake * v
            twists[i, 1] = brake * w
