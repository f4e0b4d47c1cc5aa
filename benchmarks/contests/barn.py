"""The contest in the worlds of the BARN challenge: by the challenge's rules, and with the P3DX at its own speed.

Source: Perille, Truong, Xiao and Stone, Benchmarking metric ground navigation, SSRR 2020; the challenge's run.py.
Nothing is trained or tuned on these worlds.
"""

import dataclasses
import math

from wayfield.benchmarks.contests import columns
from wayfield.benchmarks.contests.contest import Column, Published
from wayfield.benchmarks.contests.goal_obstacles import GOAL_OBSTACLES, ON_REQUEST, ON_REQUEST_NOTE
from wayfield.benchmarks.records.cases import Rules
from wayfield.policies.parts.tuned import PACE

SPEED = 2.0  # m/s, the most of the challenge's Jackal, behind its optimal times
# m/s, cruising speed of the entries: the score is full from a mean of 1 m/s on, and nothing is won by more
TARGET = 1.2
CLOCK_FROM = 0.1  # m from the start
LIMIT = 100.0  # s
BEAMS, ANGLE, RANGE = 720, math.radians(270.0), 30.0  # of its scanner, m

_NOTES = (
    "Start, goal, tolerance (1 m), clock (100 s, from the first 0.1 m) and the formula are the challenge's: a score of "
    "success x OT/clip(T, 2 OT, 8 OT), as from 2024 on, or clip(T, 4 OT, 8 OT), as in 2022, with OT the published path "
    "and both end legs at {speed:g} m/s. Entries with a cruising speed are asked for {target:g} m/s, and SCT is "
    "against that; the score is full from a mean of {half:g} m/s on. Families are worlds by their numbers, which go "
    "by difficulty. A score at its ceiling, 0.5, ranks nobody: entries are ranked by success and SCT. Beside them "
    "stand the share of worlds at the ceiling, by how many seconds a success is later than the ceiling asks for, the "
    "mean of the least clearances and the smallest of all. A simulation without Gazebo: scores are a proxy of the "
    "challenge's. {robot}Policies with the "
    "map have more inputs than the others: they are an upper reference. " + ON_REQUEST_NOTE
)

CHALLENGE = dataclasses.replace(
    GOAL_OBSTACLES,
    env_kwargs={"num_beams": BEAMS, "field_of_view": ANGLE, "max_range": RANGE},
    columns=(
        Column("score (2, 8)", "barn_score", 4, with_interval=True),
        Column("at the ceiling (%)", "barn_at_ceiling", 1, 100.0),
        Column("later than the ceiling (s)", "barn_late", 2, successes_only=True),
        Column("score 2022 (4, 8)", "barn_score_2022", 4, with_interval=True),
        columns.COLLISION,
        columns.TIMEOUT,
        columns.SCT,
        columns.SPL,
        columns.IMPUTED,
        columns.TIME,
        Column("mean speed of successes (m/s)", "mean_speed", 2, successes_only=True),
        Column("least clearance (m)", "min_clearance", 3),
        Column("smallest clearance (m)", "min_clearance", 3, reduction="min"),
        columns.LDLJ,
        columns.FAULTS,
    ),
    ranked=(("success", -1.0), ("sct", -1.0)),  # a score at its ceiling ranks nobody
    notes=_NOTES.format(
        speed=SPEED, target=TARGET, half=0.5 * SPEED, robot="The Jackal's hull is its rectangle of 0.508 m by 0.43 m. "
    ),
    on_request=ON_REQUEST,
    label="barn",
    heading="BARN, the challenge's rules",
    rules=Rules(TARGET, SPEED, CLOCK_FROM, LIMIT),
    # no figure of ours stands in the challenge's lists, and no figure of theirs was made here
    published=(
        Published("2022", "DWA, baseline", "0.159 (4, 8)", "log in the organisers' repository; its README says 0.169"),
        Published("2024", "LfLH, best baseline", "0.435 (2, 8)", "others' notes on the organisers' report"),
        Published("2024", "AIMS", "0.472 (2, 8)", "others' notes on the organisers' report"),
        Published("2024", "LiCS-KI", "0.476 (2, 8)", "others' notes on the organisers' report"),
        Published("2026", "Robo (NMPC)", "0.4515 (2, 8)", "the organisers"),
        Published("2026", "EW-Glab (A*, distance field, TEB)", "0.488 (2, 8)", "the organisers"),
        Published("2026", "IN2BOT (A*, VFH*, fuzzy speed)", "0.4975 (2, 8)", "the organisers"),
    ),
)

OWN_SPEED = dataclasses.replace(
    CHALLENGE,
    env_kwargs=GOAL_OBSTACLES.env_kwargs,
    notes=_NOTES.format(
        speed=PACE,
        target=PACE,
        half=0.5 * PACE,
        robot="The robot and its scan are those of goal reaching, not the challenge's. ",
    ),
    label="barn-p3dx",
    heading="BARN, the P3DX at its own speed",
    rules=Rules(PACE, PACE, CLOCK_FROM, LIMIT),
)
