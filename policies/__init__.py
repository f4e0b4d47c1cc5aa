"""Policies: classical controllers and trained agents behind one interface, and the pilot that drives an environment.

One file a law; `policy` (what a policy is), `pilot`, `registry` (all of them by name), `tuned` (gains found by search).
In rooms of their own: `parts`, what laws share; `learned`, agents; `training`, how they are made.
"""

from wayfield.policies.learned.agent import load_agent
from wayfield.policies.pilot import Pilot
from wayfield.policies.policy import Policy
from wayfield.policies.registry import ABOUT, POLICIES, About, NoCruisingSpeed, cruising, make
from wayfield.policies.tuned import NotTuned, tuned_gains

__all__ = [
    "ABOUT",
    "POLICIES",
    "About",
    "NoCruisingSpeed",
    "NotTuned",
    "Pilot",
    "Policy",
    "cruising",
    "load_agent",
    "make",
    "tuned_gains",
]
