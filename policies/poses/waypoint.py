"""Document B's kinematic waypoint controller for omni robots."""

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.stopping import rest_radius
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import sin_cos

MEMORY = np.dtype(
    [
        ("index", np.int64),  # of the waypoint
        ("near", np.float64),  # m, and rad, within which it rests: `rest_radius`
        ("turn", np.float64),
    ]
)


@dataclasses.dataclass(frozen=True)
class Waypoint(GoalLaw):
    """Lets the pose error decay exponentially: x' = lam (x* - x), one waypoint after the other.

    The next waypoint is taken once it counts as passed and the error is under `switching_radius` (0.25 m is the
    accuracy the document claims, 0.35 m what it used). Waypoints have no heading: the robot keeps its own until the
    last leg, then turns to the goal heading, to the left when it is exactly half a turn away. It rests inside
    `final_tolerance`, which is not the switching radius: stopping at 0.35 m would leave the heading 24 degrees off.
    Pushed away, it drives back.

    lam is not printed; lam = 1 asks 5 m/s at the start of the document's first run. The base scales all wheels by one
    factor when that is too fast. Holonomic robots only.

    Source: document B (three-omni-wheel robot, kinematic control).
    """

    lam: float = gain(1.0, "1/s", "rate of the decay of the pose error", above=0.0)
    switching_radius: float = gain(0.35, "m", "from a waypoint, within which the next one is headed for", above=0.0)
    final_tolerance: float = gain(0.01, "m", "and rad for the heading, or less where the goal asks for it", least=0.0)

    knows: ClassVar[str] = "goal"
    needs: ClassVar[tuple[str, ...]] = ("holonomic",)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the waypoint that each robot drives to and where it rests, MEMORY records (b,)."""
        memory = np.zeros(briefing.num_envs, MEMORY)
        memory["near"] = rest_radius(self.final_tolerance, briefing.position_tolerance)
        memory["turn"] = rest_radius(self.final_tolerance, briefing.heading_tolerance)
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, 3): m/s, m/s, rad/s."""
        twists = np.empty((len(memory), 3))
        seen = observation.pose, observation.goal_heading_error, observation.waypoints_left
        drive(params(self, briefing), briefing.goal, *seen, memory, twists)
        return twists


@any_layout
@compiled
def drive(params, map_, poses, turns, waypoints_left, memory, twists):
    """Fills the (b, 3) twists of `Waypoint.act` and keeps the indices up to date."""
    p = params[0]
    for i in range(poses.shape[0]):
        last = map_.num_goals[i] - 1
        m = memory[i]
        x, y, heading = poses[i]
        ex = map_.goals[i, m.index, 0] - x
        ey = map_.goals[i, m.index, 1] - y
        passed = waypoints_left[i] < last - m.index  # the task may want it from nearer
        if passed and m.index < last and math.sqrt(ex * ex + ey * ey) < p.switching_radius:
            m.index += 1
            ex = map_.goals[i, m.index, 0] - x
            ey = map_.goals[i, m.index, 1] - y
        turn = turns[i] if m.index == last else 0.0
        near = math.sqrt(ex * ex + ey * ey) <= m.near and abs(turn) <= m.turn
        rate = 0.0 if m.index == last and near else p.lam
        sine, cosine = sin_cos(heading)
        twists[i, 0] = rate * (cosine * ex + sine * ey)
        twists[i, 1] = rate * (cosine * ey - sine * ex)
        twists[i, 2] = rate * turn
