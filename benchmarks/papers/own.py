"""Our own claims: what README says of controllers beside the agents that ship."""

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.papers.claim import Claim, Printed, Side, Training

CLAIMS = (
    Claim(
        name="own_paths",
        sentence="`ilqr` tracks smooth paths more closely than PPO.",
        source="wayfield, README, Who wins",
        printed=(
            Printed("ilqr, RMS cross-track error after settling", "1.02 mm", "README"),
            Printed("PPO", "2.93 mm", "README"),
        ),
        setting="P3DX, lagged actuators, ten smooth families of the split claims, a hundred paths each.",
        differs=("Nothing: it is our setting. The claim favours a controller, so that (b) is the trained agent.",),
        would_change="An agent by other rewards or more steps; `ilqr` reads the path, the agent a preview of a metre.",
        contest="path-following",
        families=CONTESTS["path-following"].scenes["smooth paths"],
        robot="p3dx",
        measure="error",
        agent=Side("`ilqr`, hand-tuned", "ilqr", "hand-tuned", "compared by hand, no record of a search"),
        untuned=None,
        tuned=Side("PPO, ten seeds", "ppo", "trained", "preset path_following_tiers, 8.0 M steps a seed"),
        training=Training("path_following_tiers", "wayfield/DiffDrivePathFollowing-v0", "path_following_p3dx"),
        split="claims",
        scenes=100,
    ),
    Claim(
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
        agent=Side(
            "`scan_planner`, hand-tuned", "scan_planner", "hand-tuned", "compared by hand, no record of a search"
        ),
        untuned=None,
        tuned=Side("PPO, ten seeds", "ppo", "trained", "preset diff_drive_goal, 3.2 M steps a seed"),
        training=Training("diff_drive_goal", "wayfield/DiffDriveGoalObstacles-v0", "goal_reaching_p3dx"),
        scenes=100,
    ),
    Claim(
        name="own_teams",
        sentence="Agent `team_scan` solves more scenes than `dwa` with teams in the open, by lidar alone.",
        source="wayfield, README of commit 562e860, Who wins",
        printed=(Printed("team_scan", "95.4 %", "README"), Printed("dwa", "71.0 %", "README")),
        setting="Teams of omni3, lagged actuators, 72 beams, families without walls of up to 32 robots.",
        differs=(
            "Nothing: it is our setting. No gains of `dwa` were searched in teams, so that (b) is another controller.",
        ),
        would_change=(
            "Other teams or robots: README said this until `vfh_plus` was searched, and `scan_planner` entered."
        ),
        contest="teams",
        families=(),
        robot="omni3",
        measure="success",
        agent=Side("`team_scan`, the seeds that ship", "team_scan", "trained", "preset team_scan, 2.4 M steps a seed"),
        untuned=Side("`dwa`, default gains", "dwa"),
        tuned=Side(
            "`scan_planner`, default gains",
            "scan_planner",
            "default",
            "goals: 0.8 M steps, defaults kept; teams: none",
        ),
        published="python benchmarks/studies/flocks.py --drive teams",
    ),
)
