"""Plays the twist of its reference: the floor of laws that follow in time, and what an agent may add to."""

import dataclasses

from wayfield.envs.robots import Actuators, Robot
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.system.compiled import compiled


@compiled
def play(params, aims, memory, twists):
    """Fills the twists (b, t) of `FeedForward`."""
    for i in range(aims.shape[0]):
        twists[i, 0] = aims[i].vx
        if twists.shape[1] == 3:
            twists[i, 1] = aims[i].vy
        twists[i, -1] = aims[i].yaw_rate


@dataclasses.dataclass(frozen=True)
class FeedForward(ReferenceLaw):
    """Asks for the reference's twist of the time at which the command has its effect, blind to where the robot is.

    v = v_r, w = w_r, and sideways likewise on a base that goes there. What errors there are stay, and those of slip and
    wheels add up. An agent that adds to it decides about the reference, and need not learn how to drive along it.
    """

    def check(self, robot: Robot, actuators: Actuators, dt: float) -> None:
        """Refuses nothing: errors neither fall nor grow by themselves."""

    decide = staticmethod(play)
