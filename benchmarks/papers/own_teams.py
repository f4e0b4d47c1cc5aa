"""Our own: agents that see their scan alone bring more teams home in the open than DWA."""

from wayfield.benchmarks.papers.claim import Claim, Printed, Side

CLAIM = Claim(
    name="own_teams",
    sentence="Agent `team_scan` solves more scenes than `dwa` with teams in the open, by lidar alone.",
    source="wayfield, README of commit 562e860, Who wins",
    printed=(Printed("team_scan", "95.4 %", "README"), Printed("dwa", "71.0 %", "README")),
    setting="Teams of omni3, lagged actuators, 72 beams, families without walls of up to 32 robots.",
    differs=(
        "Nothing: it is our setting. No gains of `dwa` were searched in teams, so that (b) is another controller.",
    ),
    would_change="Other teams or robots: README said this until the gains of `vfh_plus` were searched in teams.",
    contest="teams",
    families=(),
    robot="omni3",
    measure="success",
    agent=Side("`team_scan`, the seeds that ship", "team_scan", "trained", "preset team_scan, 2.4 M steps a seed"),
    untuned=Side("`dwa`, default gains", "dwa"),
    tuned=Side("`vfh_plus`, tuned in teams", "vfh_plus", "tuned", "wayfield tune, 3.6 M steps"),
    published="python benchmarks/studies/flocks.py --drive teams",
)
