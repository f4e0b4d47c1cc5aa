"""The controller under an agent: a network may add to what a controller asks for instead of driving by itself."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.policy import Policy
from wayfield.system.checks import shown


@dataclasses.dataclass(frozen=True)
class Base(Gains):
    """A controller, and how far a network may lead away from it.

    The twist is the controller's and, in proportion to `reach`, what the network's actions a in [-1, 1] mean around
    their middle: v = v_b + reach speed a_0 / 2 and w = w_b + reach yaw_rate a_1 ("unicycle"), or the velocity u = u_b +
    reach speed (a_0, a_1) in the frame of the features and the controller's turning ("planar"). The robot drives no
    faster than the larger of the controller's speed and the one asked for. The network is told what the controller
    asks for.

    Where the controller `guards`, the network adds to the velocity that it wants, u = u_b + reach speed (a_0, a_1), no
    faster than that speed; what it drives by u is the controller's, which keeps clear as ever.

    Source: Johannink et al., "Residual reinforcement learning for robot control", ICRA 2019.

    Raises:
        ValueError: if the controller is unknown or has no cruising speed, or a gain or reach is out of range.
    """

    # a policy of a name, with gains, at a cruising speed (m/s); the registry hands it over, for it imports agents
    make: ClassVar[Callable[[str, Mapping[str, Any], float], Policy]]

    controller: str  # a name of policies.make
    gains: Mapping[str, Any]
    reach: float = gain(1.0, "1", "share of its twists that the network adds", above=0.0)
    guards: bool = gain(False, "", "whether it keeps clear by what the network wants")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.guards and not hasattr(self.policy(1.0), "keep_clear"):
            raise ValueError(f"controller must be one that keeps clear by a wanted velocity, got {self.controller!r}")
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
        return Base.make(name, gains, speed)
    except TypeError as error:
        raise ValueError(f"controller {shown(name)} with gains {shown(gains)}: {error}") from None
