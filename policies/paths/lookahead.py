"""Document A's look-ahead proportional controller with exponential mode switching."""

import dataclasses
import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.paths import along_lap, nearest_ahead, segment_at, vertex
from wayfield.policies.parts.carrot import leg_that_leaves
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import PathLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.rehearsal import rehearse
from wayfield.policies.parts.steering import Motion, unicycle_twists
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import bearing, sin_cos, wrap_angle


@dataclasses.dataclass(frozen=True)
class Lookahead(PathLaw):
    """Steers at the path point nearest to a point ahead of the robot; aligns with the path when it is close to it.

    With p_LA the point `lookahead_distance` ahead of the robot, (x, y) the path point nearest to p_LA in the body frame
    and th_ref the reference heading:

        e_d = x,  e_h = atan2(y, x),  e_o = wrap(th_ref - th),  mode = exp(-hypot(x, y) / mode_distance)
        v = k_lin e_d,  w = k_ang (1 - mode) e_h + k_ori mode e_o

    While it tracks, the reference point stays about `lookahead_distance` away: e_d settles there, not at zero, v at
    k_lin * lookahead_distance, and the mode at exp(-10), so that the blend acts only at the start, at corners and at
    the path's end. On a circle the documented gain settles 0.10 to 0.15 m outside; k_ang = 2 k_lin is pure pursuit's
    equivalent and 10 to 36 times more accurate. An omni base is driven as a unicycle.

    Source: document A (Pioneer P3DX path tracking); the search window and the retuned gain are corrections.
    """

    lookahead_distance: float = gain(0.5, "m", "of the point ahead", above=0.0, search=(0.15, 0.8))
    k_lin: float = gain(1.2, "1/s", "speed per metre to the point ahead")
    k_ang: float = gain(0.8, "1/s", "yaw rate per radian to the point ahead", search=(1.0, 12.0))
    k_ori: float = gain(8.0, "1/s", "yaw rate per radian from the heading, near the point")
    mode_distance: float = gain(0.05, "m", "from the point ahead, within which the heading is held", above=0.0)
    search: Literal["whole", "window"] = gain("whole", "", "whole path, as documented, or ahead of the projection")
    window: float = gain(1.5, "m", "searched ahead of the projection when search = 'window'", above=0.0)
    reference_heading: float | None = gain(None, "rad", "yaw of the disc object; None reads the local path tangent")

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns an empty memory; warns once of a path that it gets lost on: `rehearse`."""
        rehearse(self, briefing)
        return np.empty((briefing.num_envs, 0))

    def errors(
        self, pose: NDArray[np.float64], arc_length: NDArray[np.float64], briefing: Briefing
    ) -> NDArray[np.float64]:
        """Returns (b, 5): the reference point x, y (m, body frame), e_h, e_o (rad) and its arc length (m).

        Args:
            pose: (b, 3) x, y (m), heading (rad).
            arc_length: (b,) of the robot's own projection, m; where the search window starts.
        """
        p = params(
            self,
            briefing,
            window=self.window if self.search == "window" else math.inf,
            disc_heading=math.nan if self.reference_heading is None else float(self.reference_heading),
        )
        errors = np.empty((len(pose), 5))
        reference_points(p, briefing.path, pose, arc_length, errors)
        return errors

    def act(
        self, observation: path_following.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): v in m/s, w in rad/s."""
        del memory
        course, motion = smoothed(briefing.path, Motion.of(observation))
        driven = dataclasses.replace(briefing, path=course)
        x, y, e_h, e_o, _ = self.errors(motion.poses, motion.arc_lengths, driven).T
        mode = np.exp(-np.hypot(x, y) / self.mode_distance)
        yaw_rate = self.k_ang * (1.0 - mode) * e_h + self.k_ori * mode * e_o
        return unicycle_twists(briefing.robot, self.k_lin * x, yaw_rate)


@any_layout
@compiled
def reference_points(params, course, poses, arc_lengths, errors):
    """Fills the (b, 5) errors of `Lookahead.errors`.

    An infinite window searches the whole path, from its start; a NaN disc heading reads the path's tangent.
    """
    p = params[0]
    vertices, runs, path_index = course
    for i in range(poses.shape[0]):
        run = runs[path_index[i]]
        x, y, heading = poses[i]
        sine, cosine = sin_cos(heading)
        ahead_x = x + p.lookahead_distance * cosine
        ahead_y = y + p.lookahead_distance * sine
        s = arc_lengths[i]
        lap = math.floor(s / run.length) * run.length if run.closed else 0.0
        segment = segment_at(vertices, run, s - lap)
        span = 4.0 * p.lookahead_distance if math.isinf(p.window) else p.window
        s, segment = nearest_ahead(vertices, run, ahead_x, ahead_y, s, segment, span)
        if math.isinf(p.window):
            # the nearest point of the whole path, which cannot be farther away than what was just found
            a = vertex(vertices, run, segment)
            along = along_lap(vertices, run, s, segment) - a.s
            dx = ahead_x - a.x - along * a.ux
            dy = ahead_y - a.y - along * a.uy
            bound = math.sqrt(dx * dx + dy * dy)
            s, segment = nearest_ahead(vertices, run, ahead_x, ahead_y, 0.0, 0, np.inf, bound * (1.0 + 1e-9) + 1e-9)
        # at a corner the path goes on along the segment that leaves it: the one that enters would hold the robot there
        segment, along = leg_that_leaves(vertices, run, s, segment)
        tangent = vertex(vertices, run, segment)
        x, y = to_body_frame(x, y, sine, cosine, tangent.x + along * tangent.ux, tangent.y + along * tangent.uy)
        reference_heading = tangent.heading if math.isnan(p.disc_heading) else p.disc_heading
        errors[i, 0] = x
        errors[i, 1] = y
        errors[i, 2] = bearing(y, x)
        errors[i, 3] = wrap_angle(reference_heading - heading)
        errors[i, 4] = s
