"""Our own: the scan planner reaches more goals among static obstacles than the PPO agents that ship."""

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.papers.claim import Claim, Printed, Side, Training

CLAIM = Claim(
    name="own_goals",
    sentence="`scan_planner` reaches more goals than PPO among static obstacles, without a map.",
    source="wayfield, README, Who wins",
    printed=(Printed("scan_planner", "99.1 %", "README"), Printed("PPO", "97.2 %", "README")),
    setting="P3DX, lagged actuators, 72 beams, the static families of the claims split.",
    differs=("Nothing: it is our setting. The claim favours a controller, so that (b) is the trained agent.",),
    would_change="An agent with a memory of where it was: what it loses are dead ends.",
    contest="goal-obstacles",
    families=CONTESTS["goal-obstacles"].scenes["static obstacles"],
    robot="p3dx",
    measure="success",
    agent=Side("`scan_planner`, hand-tuned", "scan_planner", "hand-tuned", "compared by hand, no record of a search"),
    untuned=None,
    tuned=Side("PPO, ten seeds", "ppo", "trained", "preset diff_drive_goal, 3.2 M steps a seed"),
    training=Training("diff_drive_goal", "wayfield/DiffDriveGoalObstacles-v0", "goal_reaching_p3dx"),
    scenes=100,
)
