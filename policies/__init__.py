"""Policies: classical controllers and trained agents behind one interface, and the pilot that drives an environment.

One file a law, in rooms: `paths`, `poses`, `scans`, `teams`, `trained`. `registry` has all, `pilot` drives them.
`parts`: what a policy is, and what laws share; `learned`: agents; `training`: how they are made.
"""

from wayfield.policies.learned.agent import load_agent
from wayfield.policies.parts.barrier import Barrier, cbf
from wayfield.policies.parts.gain import Gains, gain, gains_of
from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.shield import Shield, Shielded
from wayfield.policies.parts.tuned import NotTuned, tuned_gains
from wayfield.policies.pilot import Pilot
from wayfield.policies.registry import ABOUT, POLICIES, Listed, NoCruisingSpeed, cruising, drives, make, searched_gains

__all__ = [
    "ABOUT",
    "POLICIES",
    "Barrier",
    "Gains",
    "Listed",
    "NoCruisingSpeed",
    "NotTuned",
    "Pilot",
    "Policy",
    "Shield",
    "Shielded",
    "cbf",
    "cruising",
    "drives",
    "gain",
    "gains_of",
    "load_agent",
    "make",
    "searched_gains",
    "tuned_gains",
]
