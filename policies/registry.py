"""Every policy by its name."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from wayfield.envs.checks import choose
from wayfield.policies.astar_tracker import AstarTracker
from wayfield.policies.dwa import Dwa
from wayfield.policies.learned.ppo import Ppo
from wayfield.policies.lookahead import Lookahead
from wayfield.policies.lqr import Lqr
from wayfield.policies.mpc import Mpc
from wayfield.policies.mppi import Mppi
from wayfield.policies.orca import Orca
from wayfield.policies.policy import Policy
from wayfield.policies.potential_field import CorrectedField, PotentialField
from wayfield.policies.pure_pursuit import PurePursuit
from wayfield.policies.random import Random
from wayfield.policies.regulated_pure_pursuit import RegulatedPurePursuit
from wayfield.policies.scan_planner import ScanPlanner
from wayfield.policies.smooth_pose import SmoothPose
from wayfield.policies.stanley import Stanley
from wayfield.policies.vfh_plus import VfhPlus
from wayfield.policies.waypoint import Waypoint
from wayfield.policies.zero import Zero

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
    # the arc to a point of the path ahead (Coulter)
    "pure_pursuit": PurePursuit,
    # pure pursuit that slows down for bends and for what the base can reach (Macenski et al.)
    "regulated_pure_pursuit": RegulatedPurePursuit,
    # steering on a virtual front axle (Hoffmann et al.)
    "stanley": Stanley,
    # linear-quadratic regulator in path coordinates, with feed-forward and speed profile
    "lqr": Lqr,
    # model predictive control, real-time iteration on OSQP
    "mpc": Mpc,
    # the smooth pose law (Park and Kuipers): to a pose, or along a path
    "smooth_pose": SmoothPose,
    # dynamic window approach (Fox, Burgard and Thrun)
    "dwa": Dwa,
    # vector field histogram + (Ulrich and Borenstein)
    "vfh_plus": VfhPlus,
    # model predictive path integral control (Williams et al.)
    "mppi": Mppi,
    # optimal reciprocal collision avoidance (van den Berg et al.), with full responsibility
    "orca": Orca,
    # plans on a map of its own scans, as if what it has not seen were free
    "scan_planner": ScanPlanner,
    # Theta* on the whole map, then a tracker: the privileged upper reference
    "astar_tracker": AstarTracker,
    # the agents that ship, trained with proximal policy optimisation (Schulman et al.)
    "ppo": Ppo,
}


def make(name: str, **gains: Any) -> Policy:
    """Returns the policy of that name, with the given gains in place of its defaults.

    Raises:
        ValueError: if there is no policy of that name, or a gain is out of range.
        TypeError: if the policy has no such gain.
    """
    choose("policy", name, POLICIES)
    return POLICIES[name](**gains)


class NoCruisingSpeed(ValueError):
    """A policy was asked to cruise that has no speed to cruise at."""


def cruising(name: str, gains: Mapping[str, Any], speed: float) -> dict[str, float]:
    """Returns the gains that make a policy cruise at a speed (m/s), given its other gains.

    Raises:
        NoCruisingSpeed: if the policy has none.
        ValueError: as `make`.
        TypeError: as `make`.
    """
    policy: Any = make(name, **gains)
    if isinstance(policy, Lookahead):
        # the law settles at v = k_lin L; the ratio of the default gains says what curves are driven at any speed
        k_lin = speed / policy.lookahead_distance
        if name == "lookahead_documented" or "k_ang" in gains:  # a gain that was given is kept
            return {"k_lin": k_lin}
        return {"k_lin": k_lin, "k_ang": policy.k_ang / policy.k_lin * k_lin}
    for key in ("speed", "max_speed"):
        if hasattr(policy, key):
            return {key: speed}
    raise NoCruisingSpeed(f"policy {name!r} has no cruising speed")
