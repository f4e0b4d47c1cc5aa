"""A clock governor: a law that lets its reference wait."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.robots.references import sample_index
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.references.samson import Samson
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import sin_cos, wrap_angle


@dataclasses.dataclass(frozen=True)
class Governed(Samson):
    """Samson's law on a reference whose clock goes on only as fast as the robot comes after.

    With e_x the error ahead, the reference's time s goes at the rate s' = clip(1 + h - c e_x, least_rate, 1 + h), and
    its twist is that share of what it says; h is `hurry` while s is late, and 0 otherwise. At rate 0 Samson's gains are
    0 too, and both would wait for ever. A base that cannot keep up cuts inside of bends by any law; this one stays on
    the path, and comes late: it trades the error off the path for one in time, which grows for as long as the base
    cannot. A start beside the reference makes it wait as well: with a large c and little hurry it is late for minutes.

    Source: Garone, Di Cairano, Kolmanovsky, Reference and command governors for systems with constraints: a survey,
    Automatica 75, 2017, for the idea; the rate is an addition.
    """

    c: float = gain(5.0, "1/m", "by which the clock waits for an error ahead", above=0.0, search=(2.0, 50.0))
    least_rate: float = gain(
        0.5, "1", "of the clock, at which the law still acts", above=0.0, most=1.0, search=(0.2, 1.0)
    )
    hurry: float = gain(
        0.5, "1", "by which the clock goes faster while it is late", least=0.0, most=1.0, search=(0.0, 1.0)
    )

    knows: ClassVar[str] = "path"

    # of the memory (b, 4) the last two are the time and the reference's, in control periods
    def check(self, robot: Robot, actuators: Actuators, dt: float) -> None:
        """Raises ValueError if errors would grow with the law's gains on a base whose clock does not wait."""
        Samson(self.lead, 0.0, self.zeta, self.b).check(robot, actuators, dt)

    def act(
        self, observation: trajectory_tracking.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        assert briefing.reference is not None
        b, points, numbers = observation.preview.shape
        seen = np.zeros((b, points + 1, numbers))
        stride, gains = briefing.preview_spacing / briefing.dt, (self.c, self.least_rate, self.hurry)
        wait(*briefing.reference, stride, gains, observation.pose, memory, seen)
        now = observation._replace(error=seen[:, 0, :3], reference_twist=seen[:, 0, 3:], preview=seen[:, 1:])
        return super().act(now, briefing, memory)


@any_layout
@compiled
def wait(samples, times, index, stride, gains, poses, memory, seen):
    """Fills what robots (b, 3) see of references at their own times and rates, (b, 1 + k, 3 + t), and moves those on.

    Poses in the frame of the robot and twists, now and ahead.
    """
    c, least, hurry = gains
    last = seen.shape[2] - 1
    for i in range(poses.shape[0]):
        run = times[index[i]]
        rate = 0.0
        sine, cosine = sin_cos(poses[i, 2])
        for j in range(seen.shape[1]):
            at = memory[i, 3] + j * stride * rate
            k = int(at)
            z = at - k
            a = samples[sample_index(run, k)]
            b = samples[sample_index(run, k + 1)]
            x, y = to_body_frame(poses[i, 0], poses[i, 1], sine, cosine, a.x + z * (b.x - a.x), a.y + z * (b.y - a.y))
            if j == 0:
                most = 1.0 + min(hurry, memory[i, 2] - memory[i, 3])
                rate = min(max(most - c * x, least), most)
            seen[i, j, 0] = x
            seen[i, j, 1] = y
            seen[i, j, 2] = wrap_angle(a.heading + z * wrap_angle(b.heading - a.heading) - poses[i, 2])
            seen[i, j, 3] = rate * (a.vx + z * (b.vx - a.vx))
            if last == 5:
                seen[i, j, 4] = rate * (a.vy + z * (b.vy - a.vy))
            seen[i, j, last] = rate * (a.yaw_rate + z * (b.yaw_rate - a.yaw_rate))
        memory[i, 2] += 1.0
        memory[i, 3] += rate
