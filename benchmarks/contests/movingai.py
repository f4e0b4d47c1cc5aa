"""The contest on the grid maps of MovingAI, problems with known optimal lengths.

Source: Sturtevant, Benchmarks for grid-based pathfinding, IEEE TCIAIG 4(2), 2012. Nothing is trained or tuned on these
maps.
"""

import dataclasses

from wayfield.benchmarks.contests import columns
from wayfield.benchmarks.contests.contest import Column
from wayfield.benchmarks.contests.goal_obstacles import GOAL_OBSTACLES, ON_REQUEST, ON_REQUEST_NOTE
from wayfield.benchmarks.records.cases import Rules
from wayfield.policies.parts.tuned import PACE

MOVINGAI = dataclasses.replace(
    GOAL_OBSTACLES,
    columns=(
        columns.COLLISION,
        columns.TIMEOUT,
        columns.SPL,
        columns.SCT,
        columns.IMPUTED,
        columns.TIME,
        Column("path of successes (m)", "path_length", 1, successes_only=True),
        Column("least clearance (m)", "min_clearance", 3),
        columns.LDLJ,
        columns.FAULTS,
    ),
    notes=(
        "Cells are 1 m wide. SPL and SCT compare with the published optimal length, that of a way over the eight "
        "neighbours of a cell that cuts no corner: a robot that turns freely can be shorter, and counts as 1. Policies "
        "with the map have more inputs than the others: they are an upper reference. "
        f"{ON_REQUEST_NOTE} Simulation only."
    ),
    on_request=ON_REQUEST,
    label="movingai",
    heading="MovingAI grid maps",
    rules=Rules(PACE, published_way=True),
)
