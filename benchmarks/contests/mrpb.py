"""The contest on the maps of MRPB, a benchmark of local planners made for the P3DX, by the benchmark's own metrics.

Source: Wen et al., MRPB 1.0: a unified benchmark for the evaluation of mobile robot local planning approaches, 2020
(arXiv 2011.00491), and metrics.cpp of its repository. Nothing is trained or tuned on these maps.
"""

import dataclasses

from wayfield.benchmarks.contests import columns
from wayfield.benchmarks.contests.contest import Column
from wayfield.benchmarks.contests.goal_obstacles import GOAL_OBSTACLES, ON_REQUEST, ON_REQUEST_NOTE
from wayfield.benchmarks.records.cases import Rules

TARGET = 0.55  # m/s, the benchmark's bound for the P3DX

MRPB = dataclasses.replace(
    GOAL_OBSTACLES,
    columns=(
        columns.COLLISION,
        Column("safety: least clearance (m)", "min_clearance", 3),
        Column("safety: under 0.1 m (% of time)", "near_share", 1, 100.0),
        Column("motion efficiency (s)", "time", 1, successes_only=True),
        columns.IMPUTED,
        Column("velocity smoothness (m/s²)", "velocity_smoothness", 3),
        columns.SPL,
        columns.SCT,
        Column("path of successes (m)", "path_length", 1, successes_only=True),
        columns.LDLJ,
        columns.FAULTS,
    ),
    notes=(
        "Goals are poses, to 0.2 m and 0.1 rad. Safety, motion efficiency, velocity smoothness and compute are the "
        "benchmark's metrics: the share of time in danger, whose distance it leaves to the user (here 0.1 m from the "
        "hull), the travel time, the mean |dv|/dt, the time of a decision. Entries with a cruising speed are asked for "
        f"{TARGET:g} m/s, the benchmark's bound. It hands local planners a global plan; those here get none unless "
        f"they know the map. {ON_REQUEST_NOTE} Simulation only."
    ),
    on_request=ON_REQUEST,
    label="mrpb",
    heading="MRPB",
    rules=Rules(TARGET),
)
