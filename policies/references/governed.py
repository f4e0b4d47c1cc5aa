"""A clock governor: a law that lets its reference wait."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.lead import aims_of
from wayfield.policies.parts.params import params
from wayfield.policies.references.samson import Samson, follow_samson
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import sin_cos, wrap_angle


@dataclasses.dataclass(frozen=True)
class Governed(Samson):
    """Samson's law on a reference whose clock goes on only as fast as the robot comes after.

    With e_x the error ahead, the reference's time s goes at the rate s' = clip(1 - c e_x, 0, 1), and its twist is that
    share of what it says. A base that cannot keep up cuts inside of bends by any law; this one stays on the path, and
    comes late: it trades the error off the path, which falls to e_x = (1 - s') / c, for one in time.

    Source: Garone, Di Cairano, Kolmanovsky, Reference and command governors for systems with constraints: a survey,
    Automatica 75, 2017, for the idea; the rate is an addition.
    """

    c: float = gain(20.0, "1/m", "by which the clock waits for an error ahead", above=0.0, search=(2.0, 50.0))

    knows: ClassVar[str] = "path"

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns a memory (b, 4), of which the last number is the reference's time in control periods."""
        return Samson(self.lead, 0.0, self.zeta, self.b).reset(briefing)

    def act(
        self, observation: trajectory_tracking.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        assert briefing.reference is not None
        seen = observation._replace(
            error=np.empty_like(observation.error),
            reference_twist=np.empty_like(observation.reference_twist),
            preview=np.empty_like(observation.preview),
        )
        wait(*briefing.reference, briefing.preview_spacing / briefing.dt, self.c, observation.pose, memory,
             seen.error, seen.reference_twist, seen.preview)  # fmt: skip
        aims = aims_of(type(self).__name__, seen, briefing, self.lead)
        twists = np.empty((len(aims), 2))
        follow_samson(params(self, briefing), aims, twists)
        out = np.zeros((len(aims), len(briefing.robot.twist_axes)))
        out[:, 0], out[:, -1] = twists.T
        return out


@any_layout
@compiled
def wait(samples, times, index, stride, c, poses, memory, error, twist, preview):
    """Fills what robots (b, 3) observe of references at their own times and rates, and moves those times on."""
    last = twist.shape[1] - 1
    for i in range(poses.shape[0]):
        run = times[index[i]]
        rate = 0.0
        sine, cosine = sin_cos(poses[i, 2])
        for j in range(preview.shape[1] + 1):
            at = memory[i, 3] + j * stride * rate
            k = int(at)
            z = at - k
            behind = k + 1
            if k > run.last:
                k = run.last - run.lap + 1 + (k - run.last - 1) % run.lap
            if behind > run.last:
                behind = run.last - run.lap + 1 + (behind - run.last - 1) % run.lap
            a = samples[run.first + k]
            b = samples[run.first + behind]
            x, y = to_body_frame(poses[i, 0], poses[i, 1], sine, cosine, a.x + z * (b.x - a.x), a.y + z * (b.y - a.y))
            if j == 0:
                rate = min(max(1.0 - c * x, 0.0), 1.0)
            turn = wrap_angle(a.heading + z * wrap_angle(b.heading - a.heading) - poses[i, 2])
            vx = rate * (a.vx + z * (b.vx - a.vx))
            vy = rate * (a.vy + z * (b.vy - a.vy))
            w = rate * (a.yaw_rate + z * (b.yaw_rate - a.yaw_rate))
            if j == 0:
                error[i, 0], error[i, 1], error[i, 2] = x, y, turn
                twist[i, 0] = vx
                if last == 2:
                    twist[i, 1] = vy
                twist[i, last] = w
            else:
                preview[i, j - 1, 0], preview[i, j - 1, 1], preview[i, j - 1, 2] = x, y, turn
                preview[i, j - 1, 3] = vx
                if last == 2:
                    preview[i, j - 1, 4] = vy
                preview[i, j - 1, 3 + last] = w
        memory[i, 3] += rate
