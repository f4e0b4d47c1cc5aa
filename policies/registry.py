"""Every policy by its name."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from wayfield.envs.checks import choose
from wayfield.policies.astar_tracker import AstarTracker
from wayfield.policies.dwa import Dwa
from wayfield.policies.hybrid import Hybrid
from wayfield.policies.learned.ppo import Ppo
from wayfield.policies.lookahead import Lookahead
from wayfield.policies.lqr import Lqr
from wayfield.policies.mpc import Mpc
from wayfield.policies.mpc_pose import MpcPose
from wayfield.policies.mppi import Mppi
from wayfield.policies.nav2_dwb import Nav2Dwb
from wayfield.policies.nav2_mppi import Nav2Mppi
from wayfield.policies.orca import Orca
from wayfield.policies.polar import Polar
from wayfield.policies.policy import Policy
from wayfield.policies.potential_field import CorrectedField, PotentialField
from wayfield.policies.pure_pursuit import PurePursuit
from wayfield.policies.random import Random
from wayfield.policies.reeds_shepp import ReedsShepp
from wayfield.policies.regulated_pure_pursuit import RegulatedPurePursuit
from wayfield.policies.scan_planner import ScanPlanner
from wayfield.policies.smooth_pose import SmoothPose
from wayfield.policies.stanley import Stanley
from wayfield.policies.vfh_plus import VfhPlus
from wayfield.policies.waypoint import Waypoint
from wayfield.policies.zero import Zero

POLICIES: dict[str, Callable[..., Policy]] = {
    "zero": Zero,
    "random": Random,
    "lookahead_documented": Lookahead,
    "lookahead_retuned": partial(Lookahead, k_ang=2.4, search="window"),
    "waypoint": Waypoint,
    "apf_documented": PotentialField,
    "apf_escape": partial(PotentialField, escape=True),
    "apf_corrected": CorrectedField,
    "pure_pursuit": PurePursuit,
    "regulated_pure_pursuit": RegulatedPurePursuit,
    "stanley": Stanley,
    "lqr": Lqr,
    "mpc": Mpc,
    "smooth_pose": SmoothPose,
    "smooth_pose_backward": partial(SmoothPose, backward=True, arrival_radius=0.02),
    "polar": Polar,
    "mpc_pose": MpcPose,
    "reeds_shepp": ReedsShepp,
    "dwa": Dwa,
    "vfh_plus": VfhPlus,
    "mppi": Mppi,
    "nav2_dwb": Nav2Dwb,
    "nav2_mppi": Nav2Mppi,
    "orca": Orca,
    "scan_planner": ScanPlanner,
    "astar_tracker": AstarTracker,
    "ppo": Ppo,
    "hybrid": Hybrid,
}


class About(NamedTuple):
    """What a policy is, in a line, and whose law it is; its class has the whole source."""

    what: str
    source: str


ABOUT: dict[str, About] = {
    "zero": About("stands still: the floor", ""),
    "random": About("random twists: the floor", ""),
    "lookahead_documented": About("look-ahead P controller as printed: whole-path search", "document A"),
    "lookahead_retuned": About(
        "the same with pure pursuit's equivalent gain, and a search that does not jump at crossings", "document A"
    ),
    "waypoint": About("exponential decay of the pose error, waypoint after waypoint", "document B"),
    "apf_documented": About("potential field of points as printed", "document C"),
    "apf_escape": About("the same with the avoiding force at local minima", "document C"),
    "apf_corrected": About("potential field of surfaces, capped attraction", "Khatib 1986; Ge and Cui 2000"),
    "pure_pursuit": About("the arc to a point of the path ahead", "Coulter 1992"),
    "regulated_pure_pursuit": About("slows down for bends and for what the base can reach", "Macenski et al. 2023"),
    "stanley": About("steering on a virtual front axle", "Hoffmann et al. 2007"),
    "lqr": About("linear-quadratic regulator in path coordinates, feed-forward, speed profile", "Rajamani"),
    "mpc": About("model predictive control, real-time iteration on OSQP", "Lam et al. 2010; Diehl et al. 2005"),
    "smooth_pose": About("the smooth pose law: to a pose, or along a path", "Park and Kuipers 2011"),
    "smooth_pose_backward": About("the same, forward or backward to a pose, and nearer to it", "Park and Kuipers 2011"),
    "polar": About("feedback of polar coordinates to a pose, forward or backward", "Aicardi et al. 1995; Astolfi 1999"),
    "mpc_pose": About("model predictive control to a pose, forward or backward, on OSQP", "Worthmann et al. 2016"),
    "reeds_shepp": About("the shortest way of a car that goes both ways, and a tracker", "Reeds and Shepp 1990"),
    "dwa": About("dynamic window approach on the scan", "Fox et al. 1997"),
    "vfh_plus": About("vector field histogram + on the scan", "Ulrich and Borenstein 1998"),
    "mppi": About("model predictive path integral control on the scan", "Williams et al. 2018"),
    "nav2_dwb": About("Nav2's DWB as Nav2 configures it, on the scan planner's map and plan", "Nav2; Fox et al. 1997"),
    "nav2_mppi": About("Nav2's MPPI as Nav2 configures it, on the same", "Nav2; Williams et al. 2018"),
    "orca": About("reciprocal velocity obstacles, with all of the responsibility", "van den Berg et al. 2011"),
    "scan_planner": About("plans on a map of its own scans, as if the unseen were free", "Koenig and Likhachev 2005"),
    "astar_tracker": About("Theta* on the whole map, then a tracker: the privileged reference", "Nash et al. 2007"),
    "ppo": About("the agents that ship, trained by proximal policy optimisation", "Schulman et al. 2017"),
    "hybrid": About("the scan planner plans, the agent that ships drives along its way", "Faust et al. 2018"),
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
