"""What the network of a robot among others sees: a goal seeker's, and the bodies that are tracked for it."""

import dataclasses
import math
from typing import ClassVar

import numpy as np

from wayfield.envs import team_worlds
from wayfield.envs.crowds.bodies import NEAREST
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.features import LIMIT, Array, Numbers, unchanged
from wayfield.policies.learned.features_goal import GoalFeatures
from wayfield.policies.parts.gain import gain
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import sin_cos

A_BODY = 6  # numbers of `fill_bodies` for each
HEADING = 2  # numbers of a base that has a front


@dataclasses.dataclass(frozen=True)
class TeamFeatures(GoalFeatures):
    """Of a robot among others: what a goal seeker sees, and the nearest bodies.

    Besides the numbers of `GoalFeatures`, in the frame "goal": of each of the `bodies` nearest ones where it is (m, in
    proportion up to `body_scale`), its velocity over ground, the nearness n = range_scale / (range_scale + d) of the
    gap d between the hulls, and whether it is a person; zeros where nobody is. A differential drive also sees its own
    heading in that frame. Nothing is guarded here: the agent's controller is.
    """

    trails: tuple[float, ...] = gain((1.0, 3.0, 10.0), "s", "of points that trail behind", words="a,b,... > 0")
    limits: bool = gain(True, "", "whether the base's accelerations and lag are seen")
    bodies: int = gain(5, "1", "seen, the nearest first", least=0, most=NEAREST)
    body_scale: float = gain(2.0, "m", "up to which places of bodies are seen in proportion", above=0.0)

    fields: ClassVar[tuple[str, ...]] = ("pose", "twist", "goal", "bodies", "ranges")
    observation: ClassVar[type] = team_worlds.Observation

    def check(self, briefing: Briefing) -> None:
        """Raises ValueError unless the robots have a scan that can be read, and see bodies."""
        super().check(briefing)
        if briefing.sight <= 0.0:
            raise ValueError('needs bodies; make the environment with sees="bodies"')

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return super().width(num_twist) + A_BODY * self.bodies + (HEADING if num_twist == 2 else 0)

    def observe(self, observation: team_worlds.Observation, speeds: Array, out: Numbers) -> Array:  # type: ignore[override]
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in, rad."""
        fronted = observation.twist.shape[-1] == 2
        at = out.shape[1] - A_BODY * self.bodies - (HEADING if fronted else 0)
        angles = super().observe(observation, speeds, out[:, :at])  # type: ignore[arg-type]
        scales = np.array([self.hull_radius, self.range_scale, self.body_scale, self.speed_scale])
        fill_bodies(observation.bodies, angles, scales, self.bodies, fronted, out[:, at:])
        return angles

    guarded = unchanged  # what guards is behind them


@any_layout
@compiled
def fill_bodies(bodies, angles, scales, count, fronted, out):
    """Fills what `TeamFeatures.observe` adds."""
    hull, range_scale, body_scale, speed_scale = scales
    for i in range(out.shape[0]):
        sine, cosine = sin_cos(angles[i])
        for j in range(count):
            k = A_BODY * j
            if bodies[i, j, 6] < 0.5:
                for c in range(A_BODY):
                    out[i, k + c] = 0.0
                continue
            x = bodies[i, j, 0]
            y = bodies[i, j, 1]
            vx = bodies[i, j, 2] / speed_scale
            vy = bodies[i, j, 3] / speed_scale
            gap = max(math.sqrt(x * x + y * y) - hull - bodies[i, j, 4], 0.0)
            out[i, k] = min(max((cosine * x + sine * y) / body_scale, -LIMIT), LIMIT)
            out[i, k + 1] = min(max((cosine * y - sine * x) / body_scale, -LIMIT), LIMIT)
            out[i, k + 2] = min(max(cosine * vx + sine * vy, -LIMIT), LIMIT)
            out[i, k + 3] = min(max(cosine * vy - sine * vx, -LIMIT), LIMIT)
            out[i, k + 4] = range_scale / (range_scale + gap)
            out[i, k + 5] = 1.0 if bodies[i, j, 5] > 1.5 else 0.0
        if fronted:
            out[i, A_BODY * count] = cosine
            out[i, A_BODY * count + 1] = -sine
