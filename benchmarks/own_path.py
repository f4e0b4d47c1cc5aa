"""The suite of a path of the user's own: every path-following policy on the path of a file."""

import math
import os
from collections.abc import Iterable

from wayfield import policies
from wayfield.benchmarks.cases import PATH_FOLLOWING, Case
from wayfield.benchmarks.contests import CONTESTS
from wayfield.envs.scenarios import path_scenarios
from wayfield.envs.task import CONTROL_PERIOD

POLICIES = (*CONTESTS["path-following"].policies, "zero", "random")

# The clock: slower than the look-ahead law gets on any but the tightest bends, and time to set off and settle.
_SPEED = 0.25  # m/s
_SLACK = 20.0  # s
_LONGEST = 10_000.0  # m: several hours of driving, minutes of computing


def own_path(file: str, scale: float = 1.0, names: Iterable[str] = POLICIES) -> tuple[Case, ...]:
    """Returns a case for each policy on the path of a file, with a clock that is long enough for its length.

    Raises:
        ValueError: if the file holds no path or a very long one, or a policy is unknown.
        OSError: if it cannot be opened.
    """
    for name in names:
        policies.make(name)
    file = os.path.abspath(file)  # a bare name could be that of a preset
    (scenario,) = path_scenarios(file, scale)
    length = max(scenario.laps, 1) * scenario.path.length
    if length > _LONGEST:
        raise ValueError(
            f"{file}: the way is {length:,.0f} m long, which is many hours of driving; make it at most "
            f"{_LONGEST:,.0f} m with --scale, {_LONGEST / length * scale:.2g} for example"
        )
    seconds = length / _SPEED + _SLACK
    return tuple(
        Case(
            "path",
            scenario.name,
            PATH_FOLLOWING,
            file,
            name,
            env_kwargs={"scale": scale},
            max_episode_steps=math.ceil(seconds / CONTROL_PERIOD),
            filmed=name == "lookahead_retuned",
        )
        for name in names
    )
