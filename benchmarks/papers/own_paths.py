"""Our own: ilqr tracks smooth paths more closely than the PPO agents that ship."""

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.papers.claim import Claim, Printed, Side, Training

CLAIM = Claim(
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
)
