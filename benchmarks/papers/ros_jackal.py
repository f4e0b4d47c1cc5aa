"""Learned navigation beats DWA in cluttered static worlds."""

from wayfield.benchmarks.contests import PUBLIC_SPLIT, Course
from wayfield.benchmarks.papers.claim import Claim, Gate, Printed, Side, Training

WORLDS = 32

CLAIM = Claim(
    name="ros_jackal",
    sentence="Learned navigation succeeds more often than DWA in cluttered static worlds.",
    source="Xu, Liu, Xiao, Nair, Stone: Benchmarking RL techniques for autonomous navigation, ICRA 2023, "
    "arXiv 2210.04839",
    printed=(
        Printed("DWA, success in 50 static test worlds", "43 %", "README of Daffan/ros_jackal"),
        Printed("the best learned policy (Lagrangian)", "74 +- 2 %", "README of Daffan/ros_jackal"),
    ),
    setting="A Jackal with lagged actuators and 72 beams in 32 worlds of BARN's cellular automaton, other seeds.",
    differs=(
        "Worlds are made by the same automaton, not their files; no Gazebo; the hull is a disc or a box.",
        "The agent is `any_robot`, trained for goals in our scenes below a planner, not their TD3 in these worlds.",
        "Their DWA is capped at 0.5 m/s, their agents at 2.0 m/s; our agent drives at up to 1.2 m/s.",
    ),
    would_change="Their 300 worlds (--suite barn reads them), an agent trained by their reward, and a search for DWA.",
    contest="goal-obstacles",
    families=("cellular",),
    robot="jackal",
    measure="success",
    agent=Side("`any_robot`", "any_robot", "default", "preset any_diff_drive_goal, 3.0 M steps, other scenes"),
    untuned=Side(
        "DWA, Fox's objective, at most 0.5 m/s",
        "wayfield.policies.scans.dwa:Dwa max_speed=0.5 progress=0.0 room=0.0 foresight=0.0",
    ),
    tuned=None,
    training=Training("any_diff_drive_goal", "wayfield/DiffDriveGoalObstacles-v0", "goal_reaching_any_diff_drive"),
    gate=Gate(0.43, "their DWA in their worlds"),
    course=Course("cellular", PUBLIC_SPLIT, "cellular", 1600, members=tuple(range(WORLDS))),
    scenes=WORLDS,
)
