"""Published claims, run again: one file a claim. Our own come first."""

from wayfield.benchmarks.papers import (
    applr,
    crowdnav,
    crowdnav_sarl,
    dwa_switch,
    lookahead_ppo,
    own_goals,
    own_paths,
    own_teams,
    ros_jackal,
    training_worlds,
)
from wayfield.benchmarks.papers.claim import Claim

_OWN = (own_paths, own_goals, own_teams)
_PAPERS = (crowdnav, crowdnav_sarl, ros_jackal, dwa_switch, lookahead_ppo, training_worlds, applr)
CLAIMS: dict[str, Claim] = {each.CLAIM.name: each.CLAIM for each in (*_OWN, *_PAPERS)}
