"""Pure pursuit: the arc to a point of the path ahead."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.carrot import (
    distance_left,
    place_on_lap,
    point_at_distance,
    pursuit_curvature,
    stopping_speed,
)
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import PathLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.rehearsal import rehearse
from wayfield.policies.parts.steering import Motion, unicycle_twists
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import sin_cos


@dataclasses.dataclass(frozen=True)
class PurePursuit(PathLaw):
    """Drives the arc that leaves along the heading and meets the path `lookahead_distance` away, at constant speed.

    With (x, y) that point in the body frame, d = hypot(x, y), and s the arc length left to the end of an open path:

        curvature = 2 y / d^2,  v = min(speed, sqrt(2 deceleration s)),  w = v curvature

    The point is where the path, followed from the robot's own projection, first leaves the circle of radius
    `lookahead_distance` around the robot; on the polyline itself, not one of its vertices. So d is that distance,
    except for a robot farther than that from its path, which gets its projection, and where the path curls up inside
    the circle. On an arc of a circle the law is exact: a robot on it, along it, stays.

    There is no regard for what the base can do. Where acceleration limits make the yaw rate come late, a short distance
    or a high speed throws the robot out of sharp corners: with 3 rad/s^2 and 0.1 s of lag it holds right angles at the
    default gains, and leaves them by a metre at twice the speed or half the distance. A point straight behind the robot
    gives no curvature. Drives any robot as a unicycle, differential and omni.

    Source: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, 1992.
    """

    lookahead_distance: float = gain(0.5, "m", "of the pursued point", above=0.0, search=(0.15, 1.0))
    speed: float = gain(0.6, "m/s", "of cruising", above=0.0)
    deceleration: float = gain(
        1.0, "m/s^2", "towards the end of an open path; no more than the base can", above=0.0, search=(0.3, 1.0)
    )
    window: float = gain(1.5, "m", "arc length searched ahead of the projection", above=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty memory; warns once of a path that it gets lost on: `rehearse`."""
        rehearse(self, briefing)
        return np.empty((briefing.num_envs, 0))

    def act(
        self, observation: path_following.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        del memory
        p = params(self, briefing, deceleration=min(self.deceleration, briefing.actuators.acceleration))
        twists = np.empty((len(observation.pose), 2))
        pursue(p, *smoothed(briefing.path, Motion.of(observation)), twists)
        return unicycle_twists(briefing.robot, twists[:, 0], twists[:, 1])


@any_layout
@compiled
def pursue(params, course, motion, twists):
    """Fills the (b, 2) speeds and yaw rates of `PurePursuit.act`, by one record of gains for all or one for each."""
    vertices, runs, path_index = course
    for i in range(path_index.shape[0]):
        p = params[min(i, params.shape[0] - 1)]
        run = runs[path_index[i]]
        x, y, heading = motion.poses[i]
        sine, cosine = sin_cos(heading)
        along, segment = place_on_lap(vertices, run, motion.arc_lengths[i])
        px, py = point_at_distance(vertices, run, x, y, along, segment, p.lookahead_distance, p.window)
        curvature, _, _ = pursuit_curvature(x, y, sine, cosine, px, py)
        v = min(p.speed, stopping_speed(distance_left(run, along), p.deceleration))
        twists[i, 0] = v
        twists[i, 1] = v * curvature
