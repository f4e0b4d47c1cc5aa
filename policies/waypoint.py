"""Document B's kinematic waypoint controller for omni robots."""

import dataclasses
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.briefing import Briefing
from wayfield.envs.geometry import lengths, sines
from wayfield.policies.policy import check_gain


@dataclasses.dataclass(frozen=True)
class Waypoint:
    """Lets the pose error decay exponentially: x' = lam (x* - x), one waypoint after the other.

    The next waypoint is taken once the position error is under `switching_radius` (0.25 m is the accuracy the document
    claims, 0.35 m what it used). Waypoints have no heading: the robot keeps its own until the last leg, then turns to
    the goal heading, to the left when it is exactly half a turn away. It rests inside `final_tolerance`, which is not
    the switching radius: stopping at 0.35 m would leave the heading 24 degrees off. Pushed away, it drives back.

    lam is not printed; lam = 1 asks 5 m/s at the start of the document's first run. The base scales all wheels by one
    factor when that is too fast. Holonomic robots only.

    Source: document B (three-omni-wheel robot, kinematic control).
    """

    lam: float = 1.0  # 1/s
    switching_radius: float = 0.35  # m
    final_tolerance: float = 0.01  # m, and rad for the heading

    knows: ClassVar[str] = "goal"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)
    needs: ClassVar[tuple[str, ...]] = ("holonomic",)

    def __post_init__(self) -> None:
        check_gain(self, "lam", above=0.0)
        check_gain(self, "switching_radius", above=0.0)
        check_gain(self, "final_tolerance", least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the index of the waypoint that each robot drives to, (b,)."""
        return np.zeros(briefing.num_envs, np.int64)

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, 3): m/s, m/s, rad/s."""
        assert briefing.goals is not None
        assert briefing.num_goals is not None
        rows = np.arange(len(memory))
        last = briefing.num_goals - 1
        position = observation.pose[:, :2]
        error = briefing.goals[rows, memory, :2] - position
        memory += (memory < last) & (lengths(error) < self.switching_radius)
        error = briefing.goals[rows, memory, :2] - position
        turn = np.where(memory == last, observation.goal_heading_error, 0.0)
        arrived = (memory == last) & (lengths(error) <= self.final_tolerance) & (np.abs(turn) <= self.final_tolerance)
        rate = np.where(arrived, 0.0, self.lam)
        sine, cosine = sines(observation.pose[:, 2])
        return np.column_stack(
            [
                rate * (cosine * error[:, 0] + sine * error[:, 1]),
                rate * (cosine * error[:, 1] - sine * error[:, 0]),
                rate * turn,
            ]
        )
