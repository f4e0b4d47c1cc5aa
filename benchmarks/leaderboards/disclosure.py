"""What a policy has beside its law: privileged information, sensors, memory and protections."""

import dataclasses
from collections.abc import Mapping

from wayfield.benchmarks.contests import PAPER, TRAINED, Contest
from wayfield.policies import ABOUT
from wayfield.policies.learned.agent import PATIENCE

_BRIEFINGS: Mapping[str, str] = {
    "sensors": "nothing",
    "path": "the whole path",
    "reference": "the whole reference",
    "goal": "the goal",
    "bodies": "nothing",
    "map": "the goal, every obstacle and how it moves",
    "team_map": "the goals of the whole team, every obstacle and how it moves; in every step, where all robots are",
}
_SEES: Mapping[str, str] = {
    "path": "its exact pose, errors and twist; the true path, a metre ahead",
    "reference": "its exact pose, errors, twist and command; the reference, 0.8 s ahead",
    "goal": "its exact pose and twist, where the goal is, its scan",
    "bodies": "its exact pose and twist, where the goal is, its scan, the ten nearest bodies in sight",
}
_INPUTS: Mapping[str, Mapping[str, str]] = {
    "path": {"sensors": "path errors", "path": "whole path"},
    "reference": {"sensors": "reference, 0.8 s", "path": "whole reference"},
    "goal": {"sensors": "lidar", "path": "goal"},
}  # of what a task observes: what `knows` means there
_AGENT_ON_PATHS = (
    "its last commands; holds a quicker base to the accelerations and the lag that it knows; its reward was the exact "
    "error"
)
_AGENT_AT_GOALS = (
    "where it was 1 to 30 s ago; a guard keeps it from nearing what it sees faster than it could stop; a law drives "
    "the last 0.5 m and turns to the heading; holds a quicker base to what it knows; its reward used the shortest way"
)
_AGENT_AT_DOCKS = (
    "its last command; a guard keeps it from nearing what it sees faster than it could stop, and stops it within "
    f"0.02 m and 0.02 rad of the pose; once it has made no way for {PATIENCE:g} s, or the scans show that something "
    "moves, the law `reeds_shepp_scan` drives; holds a quicker base to what it knows; its teacher and its reward knew "
    "the map"
)
_HYBRID_AT_GOALS = (
    "a map of all its scans and a plan; the agent that drives to a point ahead on it has a guard, which keeps it from "
    "nearing what it sees faster than it could stop, and a law for the last 0.5 m, and holds a quicker base to what it "
    "knows; its reward used the shortest way"
)
_AGENTS: Mapping[str, str] = {"path": _AGENT_ON_PATHS, "goal": _AGENT_AT_GOALS, "dock": _AGENT_AT_DOCKS}


@dataclasses.dataclass(frozen=True)
class Disclosure:
    """What a reader must know of an entry before comparing it with another, in words."""

    briefing: str  # before an episode
    sees: str  # in every step
    protected: str  # what it remembers, and what keeps it from harm


def inputs(knows: str, observes: str) -> str:
    """Returns the inputs of a policy with access `knows`, in words, in a task that observes `observes`."""
    own = "own, " if knows.startswith("own, ") else ""
    known = knows.removeprefix(own)
    return own + _INPUTS.get(observes, {}).get(known, known)


def disclosed(policy: str, gains_name: str, knows: str, contest: Contest) -> Disclosure:
    """Returns what an entry has; of a policy from outside of the package, what it declares that it knows."""
    observed, known = contest.spec.observes, knows.removeprefix("own, ")
    sees = _SEES["bodies" if known == "bodies" else observed]
    # a policy with access to the path gets the goal where there is no path
    privileged = _BRIEFINGS.get(observed if known == "path" else known, knows)
    if policy in TRAINED:
        alone = _HYBRID_AT_GOALS if policy == "hybrid" else _AGENTS.get(contest.spec.kind, "")
        return Disclosure(privileged, sees, ABOUT[policy].protected or alone)
    if policy in PAPER and gains_name == "paper":
        return Disclosure(privileged, sees, "nothing, as published")
    return Disclosure(privileged, sees, ABOUT[policy].protected if policy in ABOUT else "")
