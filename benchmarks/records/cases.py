"""What a benchmark case is: an environment, a policy, and the figures that the two are compared with. Pure data."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Protocol

from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.tuned import PACE

PATH_FOLLOWING = "wayfield/DiffDrivePathFollowing-v0"
GOAL_REACHING = "wayfield/OmniGoalObstacles-v0"

# One figure, or the lower and upper end of a range.
Figure = float | tuple[float, float]


class Entrant(Protocol):
    """A policy from outside of the package: plain data that travels to other processes and makes the policy there."""

    @property
    def name(self) -> str:
        """Returns how tables call it."""

    @property
    def gains_name(self) -> str:
        """Returns "own", with the gains that were given."""

    @property
    def gains(self) -> Mapping[str, Any]:
        """Returns the gains that were given."""

    def make(self, gains: Mapping[str, Any]) -> Policy:
        """Returns the policy with these gains; ValueError, in one line, if it cannot be made."""

    def cruising(self, speed: float) -> dict[str, Any] | None:
        """Returns the gains that make it cruise at a speed (m/s); None if it has no cruising speed."""

    def described(self) -> tuple[str, str]:
        """Returns how many numbers it is made of and what they were learned from, in words; "" where not known."""


@dataclasses.dataclass(frozen=True)
class Rules:
    """What a public benchmark's rules say of speed, clock and way."""

    speed: float  # m/s, cruising speed of the entries; SCT compares with the least time at this speed
    optimal_speed: float = math.nan  # m/s, at which the published way takes the optimal time
    clock_from: float = 0.0  # m from the start, at which the clock starts
    limit: float = math.inf  # s, of that clock
    published_way: bool = False  # whether SPL compares with the published way


@dataclasses.dataclass(frozen=True)
class Case:
    """A policy in a scenario. Every policy of an experiment meets the same scenario, starts and disturbances."""

    contest: str  # the table it belongs to: of a contest, of a document, or of a kind of scenario of the user's own
    family: str  # what the table calls the scenario
    env_id: str
    scenario: str
    policy: str
    gains: Mapping[str, Any] = dataclasses.field(default_factory=dict)  # in place of the policy's defaults
    env_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    max_episode_steps: int = 1200
    episodes: int = 1  # unless the command line says otherwise
    arrival_radius: float | None = None  # m, within which a waypoint or the goal counts as arrived at in the document
    published: Mapping[str, Figure] = dataclasses.field(default_factory=dict)  # by metric, SI: what the source prints
    source: str = ""  # where it prints that
    # by metric, SI: solutions of the source's equations, closed or integrated, that the source does not print
    reference: Mapping[str, Figure] = dataclasses.field(default_factory=dict)
    filmed: bool = False  # whether it is one of those that a video shows
    gains_name: str = "default"  # where the gains come from
    speed: float | None = None  # m/s, of a point of the speed-accuracy front
    every_scenario: bool = False  # episode i takes scenario i of the bank, instead of one that is drawn
    split: str = ""  # of a contest's scenarios
    entrant: Entrant | None = None  # makes the policy if it is not one of the package
    rules: Rules | None = None  # of a public benchmark
    beside: str = ""  # the policy of every other robot of a team, from the second on; "": all have the same

    @property
    def target_speed(self) -> float:
        """Returns the requested cruising speed (m/s); inf outside of contests, which have none."""
        if self.rules is not None:
            return self.rules.speed
        return (self.speed or PACE) if self.split else math.inf

    @property
    def gains_text(self) -> str:
        """Returns the gains that differ from the policy's defaults, such as "tau=0.5 max_speed=0.3"."""
        return " ".join(
            f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in self.gains.items()
        )

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Returns the key of the case within its suite."""
        return self.contest, self.family, self.policy, self.gains_text
