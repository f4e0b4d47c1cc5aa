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
        "The agent is `any_robot`: PPO below a planner, trained in other scenes. Theirs is TD3 without a planner, "
        "trained in such worlds. The networks that their repository publishes set the gains of a planner; none drives.",
        "Our worlds come from the same cellular automaton, with other seeds. There is no Gazebo.",
        "Their DWA may drive at 0.5 m/s and their agents at 2.0 m/s; our agent may drive at 1.2 m/s.",
        "Our `dwa` is no TrajectoryPlannerROS. In another file of theirs (data/dwa.txt) that one reaches 94.7 % of the "
        "goals in their 50 test worlds, since there a contact does not end a drive.",
    ),
    would_change="Their 300 worlds (`--suite barn --data FOLDER` reads them), an agent trained by their reward, a "
    "search of DWA's gains.",
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
