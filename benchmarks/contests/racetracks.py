"""The contest on real circuits, made small: the centre lines of TUM's racetrack database at 1:50.

Source: TUMFTM/racetrack-database (LGPL-3.0). Nothing is trained or tuned on these circuits.
"""

import dataclasses

from wayfield.benchmarks.contests.path_following import PATH_FOLLOWING
from wayfield.benchmarks.records.cases import Rules
from wayfield.policies.parts.tuned import PACE

SCALE = 1.0 / 50.0

RACETRACKS = dataclasses.replace(
    PATH_FOLLOWING,
    speeds=(),
    notes=(
        "One lap of each circuit's centre line, made small by the scale, from its first point; the corridor of 1 m is "
        "the task's, not the circuit's width. " + PATH_FOLLOWING.notes
    ),
    label="racetracks",
    heading="Racetracks, path following",
    rules=Rules(PACE),
)
