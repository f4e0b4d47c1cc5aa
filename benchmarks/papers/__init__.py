"""Published claims, run again: one file a claim. Our own come first."""

from wayfield.benchmarks.papers import (
    applr,
    crowdnav,
    crowdnav_sarl,
    dwa_switch,
    lookahead_ppo,
    own,
    ros_jackal,
    training_worlds,
)
from wayfield.benchmarks.papers.claim import Claim

_PAPERS = (crowdnav, crowdnav_sarl, ros_jackal, dwa_switch, lookahead_ppo, training_worlds, applr)
CLAIMS: dict[str, Claim] = {each.name: each for each in (*own.CLAIMS, *(paper.CLAIM for paper in _PAPERS))}
