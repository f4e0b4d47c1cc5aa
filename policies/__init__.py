"""Policies: classical controllers behind one interface, and the pilot that drives an environment with one."""

import difflib
from collections.abc import Callable
from functools import partial
from typing import Any

from wayfield.policies.lookahead import Lookahead
from wayfield.policies.policy import Pilot, Policy
from wayfield.policies.potential_field import CorrectedField, PotentialField
from wayfield.policies.random import Random
from wayfield.policies.waypoint import Waypoint
from wayfield.policies.zero import Zero

__all__ = ["POLICIES", "Pilot", "Policy", "make"]

POLICIES: dict[str, Callable[..., Policy]] = {
    # stands still: the floor
    "zero": Zero,
    # random twists: the floor
    "random": Random,
    # document A as printed: whole-path search, k_ang = 0.8
    "lookahead_documented": Lookahead,
    # document A with pure pursuit's equivalent gain and a search that does not jump at crossings
    "lookahead_retuned": partial(Lookahead, k_ang=2.4, search="window"),
    # document B: exponential decay of the pose error, waypoint after waypoint
    "waypoint": Waypoint,
    # document C as printed
    "apf_documented": PotentialField,
    # document C with the avoiding force at local minima
    "apf_escape": partial(PotentialField, escape=True),
    # the potential field put right: surfaces, FIRAS and Ge-Cui repulsion, capped attraction
    "apf_corrected": CorrectedField,
}


def make(name: str, **gains: Any) -> Policy:
    """Returns the policy of that name, with the given gains in place of its defaults.

    Raises:
        ValueError: if there is no policy of that name, or a gain is out of range.
        TypeError: if the policy has no such gain.
    """
    if not isinstance(name, str) or name not in POLICIES:
        near = difflib.get_close_matches(str(name), POLICIES, 1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"policy {name!r} is unknown.{hint} Choose from {', '.join(map(repr, POLICIES))}.")
    return POLICIES[name](**gains)
