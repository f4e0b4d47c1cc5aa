"""Published claims, run again: one file a claim. Our own come first."""

from wayfield.benchmarks.papers import (
    crowdnav,
    dwa_switch,
    own_goals,
    own_paths,
    own_teams,
    ros_jackal,
)
from wayfield.benchmarks.papers.claim import Claim

CLAIMS: dict[str, Claim] = {
    each.CLAIM.name: each.CLAIM for each in (own_paths, own_goals, own_teams, crowdnav, ros_jackal, dwa_switch)
}
