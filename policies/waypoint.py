"""Document B's kinematic waypoint controller for omni robots."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.gain import Gains, gain
from wayfield.policies.parts.params import params
from wayfield.system.compiled import compiled
from wayfield.system.elementary import sin_cos


@dataclasses.dataclass(frozen=True)
class Waypoint(Gains):
    """Lets the pose error decay exponentially: x' = lam (x* - x), one waypoint after the other.

    The next waypoint is taken once the position error is under `switching_radius` (0.25 m is the accuracy the document
    claims, 0.35 m what it used). Waypoints have no heading: the robot keeps its own until the last leg, then turns to
    the goal heading, to the left when it is exactly half a turn away. It rests inside `final_tolerance`, which is not
    the switching radius: stopping at 0.35 m would leave the heading 24 degrees off. Pushed away, it drives back.

    lam is not printed; lam = 1 asks 5 m/s at the start of the document's first run. The base scales all wheels by one
    factor when that is too fast. Holonomic robots only.

    Source: document B (three-omni-wheel robot, kinematic control).
    """

    lam: float = gain(1.0, "1/s", "rate of the decay of the pose error", above=0.0)
    switching_radius: float = gain(0.35, "m", "from a waypoint, within which the next one is headed for", above=0.0)
    final_tolerance: float = gain(0.01, "m", "and rad for the heading", least=0.0)

    knows: ClassVar[str] = "goal"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)
    needs: ClassVar[tuple[str, ...]] = ("holonomic",)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the index of the waypoint that each robot drives to, (b,)."""
        return np.zeros(briefing.num_envs, np.int64)

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, 3): m/s, m/s, rad/s."""
        twists = np.empty((len(memory), 3))
        seen = observation.pose, observation.goal_heading_error
        drive(params(self, briefing), briefing.goal, *seen, memory, twists)
        return twists


@compiled
def drive(params, told, poses, turns, memory, twists):
    """Fills the (b, 3) twists of `Waypoint.act` and keeps the indices up to date."""
    p = params[0]
    for i in range(poses.shape[0]):
        last = told.num_goals[i] - 1
        x, y, heading = poses[i]
        ex = told.goals[i, memory[i], 0] - x
        ey = told.goals[i, memory[i], 1] - y
        if memory[i] < last and math.sqrt(ex * ex + ey * ey) < p.switching_radius:
            memory[i] += 1
            ex = told.goals[i, memory[i], 0] - x
            ey = told.goals[i, memory[i], 1] - y
        turn = turns[i] if memory[i] == last else 0.0
        near = math.sqrt(ex * ex + ey * ey) <= p.final_tolerance and abs(turn) <= p.final_tolerance
        rate = 0.0 if memory[i] == last and near else p.lam
        sine, cosine = sin_cos(heading)
        twists[i, 0] = rate * (cosine * ex + sine * ey)
        twists[i, 1] = rate * (cosine * ey - sine * ex)
        twists[i, 2] = rate * turn
