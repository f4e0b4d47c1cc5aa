"""Plays the twist of its reference: the floor of laws that follow in time, and what an agent may add to."""

import dataclasses
from typing import Any

from wayfield.envs.robots import Actuators, Robot
from wayfield.policies.parts.laws import ReferenceLaw


@dataclasses.dataclass(frozen=True)
class FeedForward(ReferenceLaw):
    """Asks for the reference's twist of the time at which the command has its effect, blind to where the robot is.

    v = v_r, w = w_r. What errors there are stay, and those of slip and wheels add up. An agent that adds to it decides
    about the reference, and need not learn how to drive along it.
    """

    def check(self, robot: Robot, actuators: Actuators, dt: float) -> None:
        """Refuses nothing: errors neither fall nor grow by themselves."""

    def decide(self, params: Any, aims: Any, memory: Any, twists: Any) -> None:
        """Fills the twists (b, 2) for AIM records (b,)."""
        del params, memory
        twists[:, 0], twists[:, 1] = aims["vx"], aims["yaw_rate"]
