"""What is kept of an episode: enough to compute every metric and draw every figure without the environment."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _nothing() -> Any:
    return np.empty(0)


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """An episode of n steps, seen n + 1 times: at the start and after every step. World frame, SI.

    What a task does not have is an empty array.
    """

    times: Array  # (n + 1,)
    poses: Array  # (n + 1, 3) true x, y, heading
    twists: Array = dataclasses.field(default_factory=_nothing)  # (n + 1, 3) true body twist
    wheel_speeds: Array = dataclasses.field(default_factory=_nothing)  # (n + 1, w) rad/s
    saturated: Array = dataclasses.field(
        default_factory=_nothing
    )  # (n + 1,) 1 where the wheels could not turn as fast as commanded
    clearances: Array = dataclasses.field(default_factory=_nothing)  # (n + 1,) from the hull to the nearest obstacle
    # path following
    arc_lengths: Array = dataclasses.field(
        default_factory=_nothing
    )  # (n + 1,) of the projection on the path, counting over the laps
    cross_track_errors: Array = dataclasses.field(default_factory=_nothing)  # (n + 1,) + left of the path
    heading_errors: Array = dataclasses.field(default_factory=_nothing)  # (n + 1,) heading minus path tangent
    references: Array = dataclasses.field(
        default_factory=_nothing
    )  # (n + 1, 5) x, y, e_h, e_o and arc length of `Lookahead.errors`
    # of a reference: (n + 1, 5) of it minus the robot x, y, heading in the robot's frame, then the commanded yaw rate,
    # then 1 where a limit of speed or acceleration was reached
    tracked: Array = dataclasses.field(default_factory=_nothing)
    floor: float = math.nan  # m, RMS error of the regulator that proves it
    # the world
    path: Array = dataclasses.field(default_factory=_nothing)  # (k, 2) polyline; a closed one repeats its first point
    lap_length: float = 0.0  # of a closed path, else 0
    completion: float = 0.0  # share of the path that was driven; laps on a closed one
    goals: Array = dataclasses.field(
        default_factory=_nothing
    )  # (k, 3) waypoints and, last, the goal pose or the end of the path
    obstacles: NDArray[Any] = dataclasses.field(
        default_factory=_nothing
    )  # (m,) OBSTACLE records, as they stood at the start
    walls: Array = dataclasses.field(default_factory=_nothing)  # (k, 2, 2) the sides of what a map has occupied
    # other robots, then people: (n + 1, m, 2) x, y, NaN while one is not there; their radii (m,); 1 of a person (m,)
    others: Array = dataclasses.field(default_factory=_nothing)
    other_radii: Array = dataclasses.field(default_factory=_nothing)
    other_people: Array = dataclasses.field(default_factory=_nothing)
    # the end
    success: bool = False
    collision: bool = False
    left_corridor: bool = False
    faults: int = 0  # how often the policy had to fall back: QPs that were not solved, planners without a way
    # the rules of a public benchmark
    clock_from: float = 0.0  # m from the start, at which the clock starts
    limit: float = math.inf  # s, of that clock
    # what the driven way is compared with; NaN where there is nothing to compare
    shortest: float = math.nan  # of the ways to the goal's tolerance that are free for the hull
    max_speed: float = math.nan  # of the base, or the contest's cruising speed where that is lower
    optimal_time: float = math.nan  # s, of a public benchmark's rules
    acceleration: float = math.inf  # of the base

    @property
    def dt(self) -> float:
        """Returns the control period."""
        return float(self.times[1] - self.times[0])
