"""Every policy by its name."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from wayfield.envs import team_worlds
from wayfield.envs.tasks.specs import TaskSpec
from wayfield.policies.learned.residual import Base
from wayfield.policies.parts.gain import Range, gains_of
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.policies.parts.policy import Policy, observation_of
from wayfield.policies.paths.ilqr import Ilqr
from wayfield.policies.paths.lookahead import Lookahead
from wayfield.policies.paths.lqr import Lqr
from wayfield.policies.paths.mpc import Mpc
from wayfield.policies.paths.pure_pursuit import PurePursuit
from wayfield.policies.paths.regulated_pure_pursuit import RegulatedPurePursuit
from wayfield.policies.paths.stanley import Stanley
from wayfield.policies.poses.astar_tracker import AstarTracker
from wayfield.policies.poses.mpc_pose import MpcPose
from wayfield.policies.poses.polar import Polar
from wayfield.policies.poses.potential_field import CorrectedField, PotentialField
from wayfield.policies.poses.reeds_shepp import ReedsShepp
from wayfield.policies.poses.reeds_shepp_scan import ReedsSheppScan
from wayfield.policies.poses.smooth_pose import SmoothPose
from wayfield.policies.poses.waypoint import Waypoint
from wayfield.policies.random import Random
from wayfield.policies.references.backstepping import Backstepping
from wayfield.policies.references.feed_forward import FeedForward
from wayfield.policies.references.feedback_linear import FeedbackLinear
from wayfield.policies.references.governed import Governed
from wayfield.policies.references.kanayama import Kanayama
from wayfield.policies.references.offset_point import OffsetPoint
from wayfield.policies.references.pid_omni import PidOmni
from wayfield.policies.references.samson import Samson
from wayfield.policies.references.timed_ilqr import TimedIlqr
from wayfield.policies.references.timed_mpc import TimedMpc
from wayfield.policies.references.tv_lqr import TvLqr
from wayfield.policies.scans.dwa import Dwa
from wayfield.policies.scans.mppi import Mppi
from wayfield.policies.scans.nav2_dwb import Nav2Dwb
from wayfield.policies.scans.nav2_mppi import Nav2Mppi
from wayfield.policies.scans.scan_planner import ScanPlanner
from wayfield.policies.scans.vfh_plus import VfhPlus
from wayfield.policies.teams.central import Central
from wayfield.policies.teams.orca import Orca
from wayfield.policies.teams.orca_team import OrcaTeam
from wayfield.policies.teams.orca_team_map import OrcaTeamMap
from wayfield.policies.teams.social_force import SocialForce
from wayfield.policies.trained.any_robot import AnyRobot
from wayfield.policies.trained.hybrid import Hybrid
from wayfield.policies.trained.people_free import PeopleFree
from wayfield.policies.trained.ppo import Ppo
from wayfield.policies.trained.team_guided import TeamGuided
from wayfield.policies.trained.team_scan import TeamScan
from wayfield.policies.zero import Zero
from wayfield.system.checks import choose

PATHS, GOALS, DOCKS, TIMED = "path-following", "goal-obstacles", "docking", "trajectory-tracking"  # contests
CROWDS = ("teams", "people")


class Listed(NamedTuple):
    """A policy in the registry: what makes it, what it is, whose law it is, and the contests that it enters."""

    make: Callable[..., Policy]
    what: str
    source: str  # its class has the whole of it
    contests: tuple[str, ...] = ()
    searched: tuple[str, ...] | None = None  # gains; None: all that say where
    protected: str = ""  # what it remembers beside its last command, and what keeps it from harm, in words


_SCANS = "remembers what it has seen, leaves traps by a way around, foresees what moves"
_NAV2 = "a map of all its scans and the scan planner's plan, slows before what it sees, recovers where it is stuck"

# in the order of the tables
ABOUT: dict[str, Listed] = {
    "lookahead_documented": Listed(
        Lookahead,
        "look-ahead P controller as printed: whole-path search",
        "P3DX look-ahead report",
        (PATHS,),
        searched=(),
    ),
    "lookahead_retuned": Listed(
        partial(Lookahead, k_ang=2.4, search="window"),
        "the same with pure pursuit's equivalent gain, and a search that does not jump at crossings",
        "P3DX look-ahead report",
        (PATHS,),
    ),
    "pure_pursuit": Listed(PurePursuit, "the arc to a point of the path ahead", "Coulter 1992", (PATHS,)),
    "regulated_pure_pursuit": Listed(
        RegulatedPurePursuit, "slows down for bends and for what the base can reach", "Macenski et al. 2023", (PATHS,)
    ),
    "polar": Listed(
        Polar,
        "feedback of polar coordinates to a pose, forward or backward",
        "Aicardi et al. 1995; Astolfi 1999",
        (DOCKS, *CROWDS),
    ),
    "smooth_pose": Listed(
        SmoothPose,
        "the smooth pose law: to a pose, or along a path",
        "Park and Kuipers 2011",
        (PATHS, DOCKS),
        searched=("k1", "k2", "beta", "lookahead_distance"),
    ),
    "smooth_pose_backward": Listed(
        partial(SmoothPose, backward=True, arrival_radius=0.02),
        "the same, forward or backward to a pose, and nearer to it",
        "Park and Kuipers 2011",
        (DOCKS,),
        searched=("k1", "k2", "beta", "speed", "deceleration", "arrival_radius"),
    ),
    "stanley": Listed(Stanley, "steering on a virtual front axle", "Hoffmann et al. 2007", (PATHS,)),
    "lqr": Listed(
        Lqr, "linear-quadratic regulator in path coordinates, feed-forward, speed profile", "Rajamani", (PATHS,)
    ),
    "ilqr": Listed(
        Ilqr,
        "the plan of mpc by iterative LQR: dynamic programming, no solver",
        "Li and Todorov 2004; Tassa et al. 2014",
        (PATHS,),
        protected="its plan",
    ),
    "mpc": Listed(
        Mpc,
        "model predictive control, real-time iteration on OSQP",
        "Lam et al. 2010; Diehl et al. 2005",
        (PATHS,),
        protected="its plan; stops where no plan is found",
    ),
    "feed_forward": Listed(FeedForward, "the reference's twist, blind to errors: a floor", "", (TIMED,), searched=()),
    "kanayama": Listed(
        Kanayama,
        "feedback of the error in the robot's frame, by a Lyapunov function",
        "Kanayama et al. 1990",
        (TIMED,),
    ),
    "samson": Listed(
        Samson, "the same error, by poles of one damping at the reference's speed", "Samson 1993", (TIMED,)
    ),
    "offset_point": Listed(
        OffsetPoint, "leads a point ahead of the axle after the reference's", "Siciliano et al. 2009", (TIMED,)
    ),
    "feedback_linear": Listed(
        FeedbackLinear,
        "dynamic feedback linearisation: poles of the error in the world",
        "Oriolo et al. 2002",
        (TIMED,),
        protected="the speed that it integrates",
    ),
    "backstepping": Listed(
        Backstepping, "backstepping of the error ahead on the one aside", "Jiang and Nijmeijer 1997", (TIMED,)
    ),
    "governed": Listed(
        Governed,
        "samson, with a clock that waits for the base: stays on the path, comes late",
        "Samson 1993; Garone et al. 2017",
        (TIMED,),
        protected="its reference's time",
    ),
    "tv_lqr": Listed(
        TvLqr,
        "time-varying LQR on the exact motion of a period",
        "Anderson and Moore 1990",
        (TIMED,),
        protected="which period comes next",
    ),
    "timed_ilqr": Listed(
        TimedIlqr,
        "the plan of tv_lqr's sum within the base's accelerations, by iterative LQR",
        "Li and Todorov 2004; Tassa et al. 2014",
        (TIMED,),
        protected="its plan",
    ),
    "timed_mpc": Listed(
        TimedMpc,
        "the plan of the same sum by a quadratic program a control period",
        "Kuehne et al. 2004; Diehl et al. 2005",
        (TIMED,),
        protected="its plan",
    ),
    "pid_omni": Listed(
        PidOmni,
        "feed-forward and PI feedback, each direction by itself",
        "Astrom and Hagglund 1995",
        (TIMED,),
        protected="the integral of its error",
    ),
    "mpc_pose": Listed(
        MpcPose,
        "model predictive control to a pose, forward or backward, on OSQP",
        "Worthmann et al. 2016",
        (DOCKS,),
        protected="its plan",
    ),
    "reeds_shepp": Listed(
        ReedsShepp,
        "the shortest way of a car that goes both ways, and a tracker",
        "Reeds and Shepp 1990",
        (DOCKS,),
        protected="its plan, made anew where the map moves into it",
    ),
    "reeds_shepp_scan": Listed(
        ReedsSheppScan,
        "the same around what the scan shows",
        "Reeds and Shepp 1990",
        (DOCKS,),
        protected="its plan, made anew where something is on it; waits for what moves; stands where none is free",
    ),
    "waypoint": Listed(
        Waypoint, "exponential decay of the pose error, waypoint after waypoint", "three-wheel omni paper", (DOCKS,)
    ),
    "apf_documented": Listed(PotentialField, "potential field of points as printed", "four-wheel APF paper", (GOALS,)),
    "apf_escape": Listed(
        partial(PotentialField, escape=True), "the same with the avoiding force at local minima", "four-wheel APF paper"
    ),
    "apf_corrected": Listed(
        CorrectedField, "potential field of surfaces, capped attraction", "Khatib 1986; Ge and Cui 2000", (GOALS, DOCKS)
    ),
    "vfh_plus": Listed(
        VfhPlus,
        "vector field histogram + on the scan",
        "Ulrich and Borenstein 1998",
        (GOALS, *CROWDS),
        protected=_SCANS,
    ),
    "dwa": Listed(Dwa, "dynamic window approach on the scan", "Fox et al. 1997", (GOALS, *CROWDS), protected=_SCANS),
    "mppi": Listed(
        Mppi,
        "model predictive path integral control on the scan",
        "Williams et al. 2018",
        (GOALS, *CROWDS),
        protected="its plan and how long the way is around what it sees",
    ),
    "nav2_dwb": Listed(
        Nav2Dwb,
        "Nav2's DWB as Nav2 configures it, on the scan planner's map and plan",
        "Nav2; Fox et al. 1997",
        (GOALS, *CROWDS),
        protected=_NAV2,
    ),
    "nav2_mppi": Listed(
        Nav2Mppi,
        "Nav2's MPPI as Nav2 configures it, on the same",
        "Nav2; Williams et al. 2018",
        (GOALS, *CROWDS),
        protected=_NAV2,
    ),
    "orca": Listed(
        Orca,
        "reciprocal velocity obstacles, with all of the responsibility",
        "van den Berg et al. 2011",
        (GOALS,),
        protected="gives up no half-plane of what stands",
    ),
    "orca_team": Listed(
        OrcaTeam,
        "reciprocal velocity obstacles among tracked bodies",
        "van den Berg et al. 2011; Snape et al. 2010",
        CROWDS,
        protected="where it last got on; gives up no half-plane of what stands",
    ),
    "orca_team_map": Listed(
        OrcaTeamMap,
        "the same along a shortest way on the map",
        "van den Berg et al. 2011",
        CROWDS,
        protected="a way on the whole map, where it last got on; gives up no half-plane of what stands",
    ),
    "central": Listed(
        Central,
        "plans for all robots at once, told all goals: the upper reference of teams",
        "Erdmann and Lozano-Perez 1987; Cap et al. 2015",
        (CROWDS[0],),
        searched=(),
        protected="its plan, and the clock that all robots of a world share",
    ),
    "social_force": Listed(
        SocialForce,
        "the social force of people, among tracked bodies",
        "Moussaïd et al. 2009",
        CROWDS,
        protected="the velocity that it asks for",
    ),
    "team_guided": Listed(
        TeamGuided,
        "the agents that ship for teams: a network wants a velocity, orca_team keeps it clear",
        "Schulman et al. 2017; van den Berg et al. 2011",
        ("teams",),
        protected="where it was 1 to 10 s ago and where it last got on; gives up no half-plane of what stands",
    ),
    "team_scan": Listed(
        TeamScan,
        "the agents that ship for teams by their scans alone: a goal seeker that went on among its copies",
        "Schulman et al. 2017; Long et al. 2018",
        ("teams",),
        protected="where it was, and what it saw 0.5 s ago; nears nothing seen faster than it could stop",
    ),
    "people_free": Listed(
        PeopleFree,
        "the agents that ship for one robot among people: a network adds to what orca_team drives",
        "Schulman et al. 2017; van den Berg et al. 2011",
        ("people",),
        protected="where it was 1 to 10 s ago, and what orca_team does; nothing keeps it from harm",
    ),
    "scan_planner": Listed(
        ScanPlanner,
        "plans on a map of its own scans, as if the unseen were free",
        "Koenig and Likhachev 2005",
        (GOALS, *CROWDS),
        protected="a map of all its scans, foresees what moves, brakes before what it cannot see past",
    ),
    "astar_tracker": Listed(
        AstarTracker,
        "Theta* on the whole map, then a tracker: the privileged reference",
        "Nash et al. 2007",
        (GOALS,),
        protected="plans on the whole map, waits for what moves",
    ),
    "ppo": Listed(
        Ppo,
        "the agents that ship, trained by proximal policy optimisation",
        "Schulman et al. 2017",
        (PATHS, TIMED, GOALS, DOCKS),
    ),
    "hybrid": Listed(
        Hybrid, "the scan planner plans, the agent that ships drives along its way", "Faust et al. 2018", (GOALS,)
    ),
    "any_robot": Listed(
        AnyRobot,
        "drives every base by its data sheet: the scan planner plans, one agent drives, a shield brakes",
        "Faust et al. 2018; Bastani 2021",
        (GOALS,),
        protected="as the scan planner; brakes before what its base could not stop at",
    ),
    "zero": Listed(Zero, "stands still: the floor", "", (DOCKS, TIMED)),
    "random": Listed(Random, "random twists: the floor", "", (DOCKS,)),
}

POLICIES: dict[str, Callable[..., Policy]] = {name: listed.make for name, listed in ABOUT.items()}

# The name of a trained agent's policy that a new release will have, and the one under which results are stored.
RENAMED = {"agent": "ppo"}


def entering(contest: str) -> tuple[str, ...]:
    """Returns the names of the policies that enter a contest."""
    return tuple(name for name, listed in ABOUT.items() if contest in listed.contests)


def drives(name: str, spec: TaskSpec) -> bool:
    """Returns whether a policy drives a task: it reads what the task gives; who reads the scan drives among others too.

    One that enters contests of crowds alone drives the tasks of those: it was made, or trained, for them.
    """
    made, contests = make(name), ABOUT[name].contests
    if contests and set(contests) <= set(CROWDS):
        return spec.suite in contests
    among = spec.suite in CROWDS and team_worlds.Observation in made.observes
    return among or observation_of(spec) in made.observes


def searched_gains(name: str) -> dict[str, Range]:
    """Returns which gains of a policy a search looks for, and where."""
    ranges = {gain: each.search for gain, each in gains_of(POLICIES[name]()).items() if each.search}
    chosen = ABOUT[name].searched
    return ranges if chosen is None else {gain: ranges[gain] for gain in chosen}


def make(name: str, **gains: Any) -> Policy:
    """Returns the policy of that name, with the given gains in place of its defaults.

    Raises:
        ValueError: if there is no policy of that name, or a gain is out of range.
        TypeError: if the policy has no such gain.
    """
    name = RENAMED.get(name, name)
    choose("policy", name, POLICIES)
    return POLICIES[name](**gains)


class NoCruisingSpeed(ValueError):
    """A policy has no cruising speed, and one was requested."""


def cruising(name: str, gains: Mapping[str, Any], speed: float) -> dict[str, float]:
    """Returns the gains that make a policy cruise at a speed (m/s), given its other gains.

    Raises:
        NoCruisingSpeed: if the policy has none.
        ValueError: as `make`.
        TypeError: as `make`.
    """
    policy: Any = make(name, **gains)
    if isinstance(policy, ReferenceLaw):
        return {}  # the reference sets the speed
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


def at_speed(name: str, gains: Mapping[str, Any], speed: float) -> Policy:
    """Returns a policy with the given gains and those that make it cruise at a speed (m/s).

    Raises:
        ValueError: as `make` and `cruising`.
        TypeError: as `make`.
    """
    return make(name, **{**gains, **cruising(name, gains, speed)})


Base.make = staticmethod(at_speed)
