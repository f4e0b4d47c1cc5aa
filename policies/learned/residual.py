"""The controller under an agent: a network may add to what a controller asks for instead of driving by itself."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield import policies
from wayfield.envs.checks import shown
from wayfield.policies.policy import Policy, check_gain

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Base:
    """A controller, and how far a network may lead away from it.

    The twist is the controller's and, in proportion to `reach`, what the network's actions a in [-1, 1] mean around
    their middle: v = v_b + reach speed a_0 / 2 and w = w_b + reach yaw_rate a_1 ("unicycle"), or the velocity u = u_b +
    reach speed (a_0, a_1) in the frame of the features and the controller's turning ("planar"). The robot drives no
    faster than the larger of the controller's speed and the one asked for. The network is told what the controller
    asks for.

    Source: Johannink et al., "Residual reinforcement learning for robot control", ICRA 2019.

    Raises:
        ValueError: if the controller is unknown or has no cruising speed, or a gain or reach is out of range.
    """

    controller: str  # a name of policies.make
    gains: Mapping[str, Any]
    reach: float

    def __post_init__(self) -> None:
        check_gain(self, "reach", above=0.0)
        self.policy(1.0)

    def policy(self, speed: float) -> Policy:
        """Returns the controller at a cruising speed (m/s)."""
        return controller_at(self.controller, self.gains, speed)


def controller_at(name: str, gains: Mapping[str, Any], speed: float) -> Policy:
    """Returns a classical controller with those gains, at a cruising speed (m/s).

    Raises:
        ValueError: if the controller is unknown or has no cruising speed, or a gain is unknown or out of range.
    """
    if name == "ppo":
        raise ValueError("controller must be a classical one, got 'ppo'")
    try:
        return policies.make(name, **{**gains, **policies.cruising(name, gains, speed)})
    except TypeError as error:
        raise ValueError(f"controller {shown(name)} with gains {shown(gains)}: {error}") from None
