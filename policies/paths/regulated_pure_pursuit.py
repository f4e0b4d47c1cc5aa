"""Regulated pure pursuit: pure pursuit that slows down in time, turns on the spot, and asks for what can be reached."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.robots.kinematics import saturation_factor
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.carrot import distance_left, place_on_lap, pose_ahead, pursuit_curvature, stopping_speed
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import PathLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.steering import Motion, unicycle_twists, widest_turn
from wayfield.system.compiled import any_layout, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos, wrap_angle

MOST_SAMPLES = 10_000.0  # of the way ahead
SAMPLING = 0.05  # m, between the places ahead whose bend limits the speed


@dataclasses.dataclass(frozen=True)
class RegulatedPurePursuit(PathLaw):
    """Pursues a point of the path ahead, no faster than the path's bends, its end and the base permit.

    With v_0, w_0 the last command, L = clip(lookahead_time v_0, min_lookahead, max_lookahead), (x, y) the path point L
    ahead of the robot's projection along the path, in the body frame, and c(D) the mean curvature |turn| / bend_span of
    the path from D to D + bend_span ahead:

        curvature = 2 y / (x^2 + y^2),  angle = atan2(y, x)
        v_c(D) = max(speed min(1, 1 / (min_radius c(D))), min_speed)
        v_max = min over D of sqrt(v_c(D)^2 + 2 deceleration max(D - lag v_0, 0)), and sqrt(2 deceleration s) at the end
        |angle| <= rotate_angle:  the fastest (v, w) nearest to w = curvature v in the window
            |v - v_0| <= acceleration dt,  |w - w_0| <= yaw_acceleration dt,  v <= v_max unless it cannot brake so fast
        beyond:  v brakes to 0,  w = sign(angle) min(max_yaw_rate, sqrt(2 yaw_acceleration |angle|)) in the window

    A corner is a turn within bend_span like any other, so that the robot slows before it. No wheel is asked for more
    than it can turn, so that the base drives just what it is asked for.

    It pays for its accuracy in time: it creeps round corners. The point ahead is one of path distance, so that a
    crossing does not lead astray, but a robot far off its path drives at it steeply. Drives any robot as a unicycle,
    differential and omni.

    Source: Macenski et al., Regulated Pure Pursuit for Robot Path Tracking, arXiv 2305.20026, 2023; the window is that
    of dynamic window pure pursuit, arXiv 2601.15006; to look at the bends ahead, rather than at the arc being driven,
    is ours.
    """

    speed: float = gain(0.6, "m/s", "of cruising", above=0.0)
    min_speed: float = gain(0.05, "m/s", "in bends", above=0.0, search=(0.02, 0.3))
    min_lookahead: float = gain(0.3, "m", "least", above=0.0, search=(0.03, 0.5))
    max_lookahead: float = gain(0.4, "m", "most", above=0.0, least="min_lookahead", search=(0.06, 0.8))
    lookahead_time: float = gain(
        0.66, "s", "in which the point ahead is reached, between the two", above=0.0, search=(0.05, 1.5)
    )
    min_radius: float = gain(0.4, "m", "bends tighter than this are driven slower", above=0.0, search=(0.1, 1.0))
    bend_span: float = gain(0.2, "m", "of path over which a turn counts as a bend", above=0.0, search=(0.05, 0.6))
    rotate_angle: float = gain(
        0.785, "rad", "to the point ahead, beyond which the robot turns on the spot", above=0.0, search=(0.15, 3.0)
    )
    max_yaw_rate: float = gain(2.0, "rad/s", "of turns on the spot", above=0.0, search=(0.5, 4.0))
    deceleration: float = gain(0.8, "m/s^2", "before bends and the end, at most", above=0.0, search=(0.3, 1.0))
    yaw_acceleration: float = gain(
        2.5, "rad/s^2", "of turns on the spot; no more than the base can", above=0.0, search=(0.5, 3.0)
    )

    needs: ClassVar[tuple[str, ...]] = ("turns_on_the_spot",)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the last command of each robot, (b, 2): forward speed and yaw rate, at rest."""
        return np.zeros((briefing.num_envs, 2))

    def act(
        self, observation: path_following.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s, which the base can set within one control period."""
        p = params(
            self,
            briefing,
            deceleration=min(self.deceleration, briefing.actuators.acceleration),
            yaw_acceleration=min(self.yaw_acceleration, briefing.actuators.yaw_acceleration),
        )
        pursue(p, *smoothed(briefing.path, Motion.of(observation)), memory)
        return unicycle_twists(briefing.robot, memory[:, 0], memory[:, 1])


@any_layout
@compiled
def pursue(params, course, motion, commands):
    """Replaces the (b, 2) last commands by the next ones of `RegulatedPurePursuit.act`."""
    p = params[0]
    plant = p.plant
    vertices, runs, path_index = course
    for i in range(path_index.shape[0]):
        run = runs[path_index[i]]
        x, y, heading = motion.poses[i]
        v0 = commands[i, 0]
        w0 = commands[i, 1]
        sine, cosine = sin_cos(heading)
        along, segment = place_on_lap(vertices, run, motion.arc_lengths[i])
        distance = min(max(p.lookahead_time * v0, p.min_lookahead), p.max_lookahead)
        px, py, _ = pose_ahead(vertices, run, along, segment, distance)
        curvature, px, py = pursuit_curvature(x, y, sine, cosine, px, py)
        angle = bearing(py, px)
        v_low = max(v0 - plant.acceleration * plant.dt, 0.0)
        w_low = w0 - plant.yaw_acceleration * plant.dt
        w_high = w0 + plant.yaw_acceleration * plant.dt
        if abs(angle) > p.rotate_angle:
            v = v_low
            w = math.copysign(min(p.max_yaw_rate, math.sqrt(2.0 * p.yaw_acceleration * abs(angle))), angle)
            w = min(max(w, w_low), w_high)
        else:
            v_max = speed_ahead(p, vertices, run, along, segment, plant.lag * v0)
            v_max *= saturation_factor(plant, v_max, 0.0, curvature * v_max)
            v_high = max(min(v0 + plant.acceleration * plant.dt, v_max), v_low)
            v, w = fastest_on_line(curvature, v_low, v_high, w_low, w_high)
        # off the line a wheel may still be asked for too much; braking makes room for at least a part of the last turn
        most = widest_turn(plant, v)
        if w_low > most or w_high < -most:
            v = v_low
            most = widest_turn(plant, v)
        commands[i, 0] = v
        commands[i, 1] = min(max(w, -most), most)


@inlined
def speed_ahead(p, vertices, run, along, segment, blind):
    """Returns the speed (m/s) that leaves room to slow down for every bend ahead and for the end of the path.

    Args:
        blind: m, driven before the wheels follow a command.
    """
    v_max = min(p.speed, stopping_speed(distance_left(run, along), p.deceleration))
    reach = blind + 0.5 * p.speed * p.speed / p.deceleration
    for j in range(int(min(max(0.0, reach / SAMPLING), MOST_SAMPLES)) + 1):
        ahead = j * SAMPLING
        _, _, enter = pose_ahead(vertices, run, along, segment, ahead)
        _, _, leave = pose_ahead(vertices, run, along, segment, ahead + p.bend_span)
        turn = abs(wrap_angle(leave - enter))
        v = max(p.speed * min(1.0, p.bend_span / max(p.min_radius * turn, 1e-12)), p.min_speed)
        v_max = min(v_max, math.sqrt(v * v + 2.0 * p.deceleration * max(ahead - blind, 0.0)))
    return v_max


@inlined
def fastest_on_line(curvature, v_low, v_high, w_low, w_high):
    """Returns the (v, w) of the window nearest to the line w = curvature v, and the fastest of equally near ones."""
    side = 1.0 if curvature >= 0.0 else -1.0
    if side < 0.0:
        w_low, w_high = -w_high, -w_low
    steepness = abs(curvature)
    v = v_high
    if steepness * v_high > w_high and steepness > 0.0:
        # where the line leaves the window at its top, or the corner nearest to a line that passes above the window
        v = max(w_high / steepness, v_low)
    return v, side * min(max(steepness * v, w_low), w_high)
