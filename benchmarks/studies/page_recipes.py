"""What the page hands to the compiled functions, in the order in which Python does: found by watching Python do it."""

import base64
import contextlib
import dataclasses
import importlib
import importlib.util
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from page_looks import ALONG_PATHS as LOOKS_ALONG_PATHS
from page_looks import AMONG_BODIES as LOOKS_AMONG_BODIES
from page_looks import TO_POSES as LOOKS_TO_POSES
from page_looks import Look, dock_by_scan, orca_of_team, orca_of_team_map

from wayfield.benchmarks.contests import COMPLETE, CONTESTS, Contest
from wayfield.benchmarks.contests.crowds import PEOPLE, TEAMS
from wayfield.benchmarks.report.worlds import IN_PAGE
from wayfield.envs import scenarios
from wayfield.envs.batch import ALONE, Results
from wayfield.envs.crowds.bodies import HULL, PLACE
from wayfield.envs.crowds.people import WALK, WALKER
from wayfield.envs.robots import ACTUATORS, ROBOTS, Robot
from wayfield.envs.robots.disturbances import DISTURBANCES
from wayfield.envs.robots.records import MAX_WHEELS
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.tasks.briefing import Briefing, Course
from wayfield.envs.tasks.specs import CROWDS
from wayfield.envs.vector import NativeVectorEnv
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.envs.world.grids import NO_GRIDS
from wayfield.envs.world.paths import RUN, VERTEX
from wayfield.policies import Pilot, cruising, make
from wayfield.policies.learned.agent import SHIELD, Agent
from wayfield.policies.learned.conditions import effective_actuators, network_speed, out_of_distribution
from wayfield.policies.learned.features_sheet import RobotFeatures
from wayfield.policies.learned.perception import limits_of
from wayfield.policies.parts import forward_prediction, path_smoothing, shield
from wayfield.policies.parts.gain import Gain, gains_of
from wayfield.policies.parts.params import PLANT
from wayfield.policies.parts.policy import lacks
from wayfield.policies.parts.stopping import NEAR_ENOUGH
from wayfield.policies.registry import NoCruisingSpeed
from wayfield.policies.trained.any_robot import APPROACHED, BEHIND_PLANNER, PACE, WAY, AnyRobot, agents_of
from wayfield.system.compiled import allocating, compiled
from wayfield.system.elementary import bearing

# The compiled decision of each policy that has one, along a path and to a pose: module and function, and where the
# twist is read from afterwards. "unicycle" is a speed and a yaw rate, "planar" a twist of three; a field is one of a
# record of memory.
Decision = tuple[str, str, str, str]
ALONG_PATHS: Mapping[str, Decision] = {
    "pure_pursuit": ("pure_pursuit", "pursue", "twists", "unicycle"),
    "regulated_pure_pursuit": ("regulated_pure_pursuit", "pursue", "commands", "unicycle"),
    "smooth_pose": ("smooth_pose", "chase", "twists", "unicycle"),
    "stanley": ("stanley", "steer_rows", "command", "unicycle"),
    "lqr": ("lqr", "steer_rows", "command", "unicycle"),
    "ilqr": ("ilqr", "plan_rows", "twists", "unicycle"),
}
ENDS_ONLY = ("lqr",)  # of those, which all drive a path without its wiggles: rounds the path itself
TO_POSES: Mapping[str, Decision] = {
    "polar": ("polar", "approach", "twists", "unicycle"),
    "smooth_pose": ("smooth_pose", "approach", "twists", "unicycle"),
    "smooth_pose_backward": ("smooth_pose", "approach", "twists", "unicycle"),
    "reeds_shepp": ("reeds_shepp", "drive", "twists", "unicycle"),
    "reeds_shepp_scan": ("reeds_shepp_scan", "drive", "twists", "unicycle"),  # in steps, of JOINED
    "waypoint": ("waypoint", "drive", "twists", "planar"),
    "apf_corrected": ("potential_field", "steer", "twists", "planar"),
    "vfh_plus": ("vfh_plus", "steer", "twists", "planar"),
    "dwa": ("dwa", "choose_twists", "twists", "planar"),
    "mppi": ("mppi", "decide", "twists", "planar"),
    "scan_planner": ("scan_planner", "decide", "memory.command", "planar"),
    "astar_tracker": ("astar_tracker", "decide", "memory.command", "planar"),
    "orca": ("orca", "decide", "twists", "planar"),
}
# Among other bodies, whose robots each have the law; "axes" are the components that the base can command.
AMONG_BODIES: Mapping[str, Decision] = {
    **{name: TO_POSES[name] for name in ("polar", "vfh_plus", "dwa", "mppi", "scan_planner")},
    "orca_team": ("orca_team", "decide", "out", "axes"),  # in steps, of JOINED
    "orca_team_map": ("orca_team_map", "decide", "out", "axes"),
    "social_force": ("social_force", "push", "out", "axes"),
}
OF_ANY_TASK = ("smooth_pose",)  # drives in the page wherever it can, besides those that enter the contest
# Trained agents, which put together what several functions fill.
AGENT = "ppo"
AGENTS = (AGENT, "hybrid", "any_robot", "team_guided", "team_scan", "people_free")
NETWORK_ALONG_PATHS = (("perception", "fill_path"), ("agent", "hold"), ("agent", "forward"))
NETWORK_TO_POSES = (
    ("perception", "fill_goal"),
    ("perception", "fill_trails"),
    ("perception", "fill_crumbs"),
    ("perception", "fill_moving"),
    ("perception", "turn"),
    ("perception", "arrive"),
    ("perception", "guard"),
    ("agent", "hold"),
    ("agent", "forward"),
)
# and ORCA under the network, or behind it
NETWORK_AMONG_BODIES = (
    *NETWORK_TO_POSES,
    ("perception", "fill_bodies"),
    ("orca_team", "want"),
    ("orca_team", "avoid"),
)
# and a planner above it
PLANNED = (("scan_planner", "decide"), ("hybrid", "lead"), ("any_robot", "find_approached"))
NETWORKS: Mapping[str, Sequence[tuple[str, str]]] = {
    "path": NETWORK_ALONG_PATHS,
    "goal": (*NETWORK_TO_POSES, *PLANNED),
    "dock": (*NETWORK_TO_POSES, ("perception", "fill_pose")),
    **dict.fromkeys(("team", "people"), NETWORK_AMONG_BODIES),
}  # by kind

# Where those of perception's are called that are not called there; the page knows all by that name.
CALLED_IN: Mapping[str, str] = {
    "fill_path": "features_path",
    **dict.fromkeys(("fill_goal", "arrive", "guard"), "features_goal"),
    "fill_pose": "features_dock",
    "fill_bodies": "features_team",
}
_OF_PERCEPTION = (*CALLED_IN.values(), "arrival", "guard")
ROOMS = ("paths", "poses", "scans", "teams", "learned", "trained")  # of the modules that are named here

# What an argument of a law is, by its name; all else is a constant.
ROLES = {
    "course.vertices": "briefing.vertices",
    "course.runs": "briefing.runs",
    "course.path_index": "briefing.path_index",
    "rough": "briefing.rough",
    "motion.poses": "seen.pose",
    "motion.twists": "seen.twist",
    "motion.arc_lengths": "seen.arc_length",
    "scan.ranges": "seen.ranges",
    "ranges": "seen.ranges",
    "whole.ranges": "seen.ranges",
    "whole.older": "memory",
    "whole.newer": "memory",
    "laid.obstacles": "fresh",
    "laid.counts": "fresh",
    "standing": "fresh",
    "scan.older": "memory",
    "scan.newer": "memory",
    "seen.poses": "seen.pose",
    "poses": "seen.pose",
    "seen.goals": "seen.goal",
    "goals": "seen.goal",
    "seen.heading_errors": "seen.goal_heading_error",
    "heading_errors": "seen.goal_heading_error",
    "turns": "seen.goal_heading_error",
    "seen.waypoints_left": "seen.waypoints_left",
    "waypoints_left": "seen.waypoints_left",
    "seen.twists": "seen.twist3",
    "measured": "seen.twist3",
    "bodies": "seen.bodies",
    "wanted": "out",
    "map_.obstacles": "briefing.obstacles",
    "map_.counts": "briefing.num_obstacles",
    "map_.goals": "briefing.goals",
    "map_.num_goals": "briefing.num_goals",
    "map_.frames": "briefing.frames",
    "map_.cells": "briefing.cells",
    "memory": "memory",
    "plans": "memory",
    "damping": "memory",
    "commands": "memory",
    "arrived": "memory",
    "twists": "out",
    "command": "out",
    "out": "out",
}

# What a law's record has of the base besides `plant`, by field: how it comes from a data sheet, and from which number,
# a gain by its name or the record's own field. Laws that are not here keep tables of their base.
_BOUNDED = {"deceleration": ("least", "deceleration"), "yaw_acceleration": ("least_yaw", "yaw_acceleration")}
OF_SHEETS: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "pure_pursuit": {"deceleration": _BOUNDED["deceleration"]},
    "regulated_pure_pursuit": _BOUNDED,
    "smooth_pose": _BOUNDED,
    "smooth_pose_backward": _BOUNDED,
    "stanley": {"yaw_acceleration": ("share_yaw", "share")},
    "apf_corrected": {},
    "vfh_plus": {},
    "dwa": {},
    "mppi": {"step_decay": ("decay", "step_time"), "step_mean": ("mean", "step_time")},
    "orca": {},
    "orca_team": {"max_yaw_rate": ("most_yaw", "")},
    "social_force": {"max_yaw_rate": ("most_yaw", "")},
    "polar": {**_BOUNDED, "deceleration": ("least_half", "deceleration")},
    "reeds_shepp": {**_BOUNDED, "deceleration": ("least_half", "deceleration"), "preview": ("late", "")},
}

_UNREACHED = 1e9  # m/s and rad/s

Leaf = tuple[str, Any]  # name, and the array or number


def leaves(names: Sequence[str], values: Sequence[Any]) -> list[Leaf]:
    """Returns the arrays and numbers of some arguments, those of a bundle with its name in front."""
    parts: list[Leaf] = []
    for name, value in zip(names, values, strict=True):
        if isinstance(value, tuple):
            parts += [(f"{name}.{field}", each) for field, each in zip(value._fields, value, strict=True)]  # type: ignore[attr-defined]
        else:
            parts.append((name, value))
    return parts


def names_of(kernel: Any) -> tuple[str, ...]:
    """Returns the names of the arguments of a compiled function."""
    code = kernel.py_func.__code__
    return tuple(code.co_varnames[: code.co_argcount])


@contextlib.contextmanager
def watched(module: Any, name: str, calls: list[tuple[Any, tuple[Any, ...]]]) -> Iterator[None]:
    """Notes every call of a compiled function of a module, with copies of what it is handed."""
    kernel = getattr(module, name)

    def noting(*values: Any) -> Any:
        calls.append((kernel, tuple(_copied(value) for value in values)))
        return kernel(*values)

    setattr(module, name, noting)
    try:
        yield
    finally:
        setattr(module, name, kernel)


def _copied(value: Any) -> Any:
    if isinstance(value, tuple):
        return type(value)(*(_copied(each) for each in value))
    return np.array(value, order="C") if isinstance(value, np.ndarray) else value


def contest_of(task: str) -> Contest:
    """Returns the contest of a task."""
    every = (*CONTESTS.values(), TEAMS, PEOPLE["people-seen"])
    return next(contest for contest in every if contest.spec.name == task)


def decisions(task: str) -> dict[str, Decision]:
    """Returns the compiled decisions of those that drive in the page in a task."""
    contest = contest_of(task)
    known = AMONG_BODIES if task in CROWDS else ALONG_PATHS if contest.spec.on_path else TO_POSES
    return {name: each for name, each in known.items() if name in (*contest.policies, *OF_ANY_TASK)}


def look_of(task: str, name: str) -> Look | None:
    """Returns what the page draws of a policy's looking ahead in a task."""
    if task in CROWDS and name in LOOKS_AMONG_BODIES:
        return LOOKS_AMONG_BODIES[name]
    return (LOOKS_ALONG_PATHS if contest_of(task).spec.on_path else LOOKS_TO_POSES).get(name)


def agents(task: str) -> tuple[str, ...]:
    """Returns the trained agents that enter the contest of a task."""
    return tuple(name for name in AGENTS if name in contest_of(task).policies)


def agent_labels(task: str, name: str, robot: str) -> list[str]:
    """Returns what a trained agent of the first seed is called with a robot; nothing where none drives it."""
    if name == "any_robot" and not agents_of(ROBOTS[robot]):
        return []
    sets = contest_of(task).gain_sets(name, robot, ("default",))
    return [name if of == "default" else f"{name} ({of})" for of, gains in sets if not gains.get("seed")]


def network(task: str) -> list[tuple[Any, str]]:
    """Returns the modules and names of the compiled functions of the agents that ship for a task."""
    return [(of_policies(module, name), name) for module, name in NETWORKS[contest_of(task).spec.kind]]


# Of laws that decide in steps: the one kernel that the page calls, and each step's module and function, with what has
# another name in that kernel, or none.
JOINED: Mapping[str, tuple[Any, tuple[tuple[str, str, Mapping[str, str]], ...]]] = {
    "orca_team": (orca_of_team, (("orca_team", "want", {"params": "", "out": ""}), ("orca_team", "avoid", {}))),
    "orca_team_map": (
        orca_of_team_map,
        (
            ("orca_team_map", "find_targets", {"params": "planner"}),
            ("orca_team", "want", {"params": "", "goals": "", "out": ""}),
            ("orca_team", "avoid", {}),
        ),
    ),
    "reeds_shepp_scan": (
        dock_by_scan,
        (("reeds_shepp_scan", "lay_hits", {}), ("reeds_shepp_scan", "drive", {"map_": "laid", "poses": ""})),
    ),
}


def first_of(task: str, name: str, policy: Any, env: NativeVectorEnv) -> tuple[Any, tuple[Any, ...]]:
    """Returns the compiled function by which a policy decides in the page, and what its first decision hands it."""
    pilot = Pilot(policy, env)
    observation, _ = env.reset(seed=0)
    pilot.reset()
    return handed_to(task, name, pilot, observation)


def handed_to(task: str, name: str, pilot: Pilot, observation: Any) -> tuple[Any, tuple[Any, ...]]:
    """Returns the compiled function by which a policy decides in the page, and what a decision hands it."""
    if name not in JOINED:
        module, function, *_ = decisions(task)[name]
        ((kernel, values),) = noted(pilot, observation, [(of_policies(module), function)])
        return kernel, values
    kernel, steps = JOINED[name]
    known: dict[str, Any] = {}
    calls = noted(pilot, observation, [(of_policies(module), function) for module, function, _ in steps])
    for (part, values), (_, _, renamed) in zip(calls, steps, strict=True):
        handed = {renamed.get(each, each): value for each, value in zip(names_of(part), values, strict=True)}
        known = handed | known  # the memory is that of the first step
    return kernel, tuple(known[each] for each in names_of(kernel))


def halves(numbers: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Returns numbers of eight bits' precision as two planes of bytes (2, n), the upper ones first.

    They deflate better so; the page's `Network` puts them together.

    Raises:
        ValueError: if a number has more bits than its upper half holds.
    """
    bits = np.ascontiguousarray(numbers, np.float32).view(np.uint32)
    if (bits & 0xFFFF).any():
        raise ValueError("weights must be rounded as agents are when they are saved")
    return np.stack([bits >> 24, bits >> 16 & 0xFF]).astype(np.uint8)


def environment(
    task: str, robot: str | Robot, actuators: str, scenario: str, disturbance: str = "none"
) -> NativeVectorEnv:
    """Returns an environment as the contest of the task has it, with one robot; a sheet is a differential one."""
    contest = contest_of(task)
    if scenario.endswith("/test"):
        hull = (robot if isinstance(robot, Robot) else ROBOTS[robot]).hull_radius
        scenario = contest.spec.repertoire.split_for(scenario, hull)
    env = gymnasium.make_vec(
        contest.env_id(BASE if isinstance(robot, Robot) else robot),
        1,
        vectorization_mode="vector_entry_point",
        scenario=scenario,
        robot=robot,
        actuators=actuators,
        disturbance=disturbance,
        max_episode_steps=contest.spec.clock,
        **contest.env_kwargs,
    )
    assert isinstance(env, NativeVectorEnv)
    return env


def first_decision(env: NativeVectorEnv, policy: Any, functions: Sequence[tuple[Any, str]]) -> list[tuple[Any, Any]]:
    """Returns the calls that a policy's first decision makes, with the memory that it begins with."""
    pilot = Pilot(policy, env)
    observation, _ = env.reset(seed=0)
    pilot.reset()
    return noted(pilot, observation, functions)


def noted(pilot: Pilot, observation: Any, functions: Sequence[tuple[Any, str]]) -> list[tuple[Any, Any]]:
    """Returns the calls of some functions that a decision makes, with the memory that it begins with."""
    calls: list[tuple[Any, tuple[Any, ...]]] = []
    with contextlib.ExitStack() as stack:
        for module, name in functions:
            stack.enter_context(watched(module, name, calls))
        pilot.act(observation)
    return calls


def of_policies(name: str, function: str = "") -> Any:
    """Returns a module of the policies, that of a function where perception's are meant."""
    if name == "perception":
        name = CALLED_IN.get(function, name)
    modules = (f"wayfield.policies.{room}.{name}" for room in ROOMS)
    return importlib.import_module(next(each for each in modules if importlib.util.find_spec(each)))


# What predicts the state of a base that answers late, for all laws.
LATE = "late"
_PREDICTS = ("look_ahead", "move", "view", "rescan", "follow", "compensate", "advance")


def predictions(task: str) -> list[tuple[Any, Any]]:
    """Returns the calls that predict for the first decision of a base that answers late."""
    robot = dataclasses.replace(ROBOTS[BASE], name=LATE, delay=(0.12, 0.16), response="continuous")
    env = environment(task, robot, "lagged", f"{contest_of(task).timed_on}/test")
    policy = make("pure_pursuit" if contest_of(task).spec.on_path else "polar")
    return first_decision(env, policy, [(forward_prediction, name) for name in _PREDICTS])


def late_table(task: str, blobs: "Blobs") -> dict[str, Any]:
    """Returns the constants of a task that predictions read: of its scan, or of the preview of its path."""
    calls = {name_of(kernel): dict(leaves(names_of(kernel), each)) for kernel, each in predictions(task)}
    if "follow" in calls:
        return {"spacing": float(calls["follow"]["spacing"])}
    scan = calls["rescan"]
    numbers = {name: float(scan[name]) for name in ("first", "step", "closed", "most")}
    return {**numbers, "beams": blobs.put(scan["beams"])}


class Blobs:
    """Constants, each kept once, as base64."""

    def __init__(self) -> None:
        self.index: dict[bytes, int] = {}

    def put(self, array: NDArray[Any]) -> int:
        """Returns the number of a constant."""
        return self.index.setdefault(np.ascontiguousarray(array).tobytes(), len(self.index))

    def listed(self) -> list[str]:
        """Returns all constants in order."""
        return [base64.b64encode(each).decode() for each in self.index]


def recipe(
    task: str, name: str, gains: Mapping[str, Any], limits: Mapping[str, float], env: NativeVectorEnv, blobs: Blobs
) -> dict[str, Any]:
    """Returns how the page makes a policy decide: the export, its arguments, and where the twist is.

    Args:
        limits: of the gains that the page can change, as `gain_limits` finds them.
    """
    module, function, out, kind = decisions(task)[name]
    policy: Any = make(name, **gains)
    kernel, given = first_of(task, name, policy, env)
    handed = dict(leaves(names_of(kernel), given))
    arguments = [_argument(each, value, blobs) for each, value in handed.items()]
    memory = handed.get("memory")
    fields = (memory.dtype.fields if memory is not None else None) or {}
    field = 0
    if "." in out:
        out, part = out.split(".")
        field = int(fields[part][1])
    # a robot rests nearer to goals that ask for it, which the page's visitor may draw
    rest = [int(fields["stop_radius"][1]), policy.stop_radius, NEAR_ENOUGH] if "stop_radius" in fields else None
    values = {field: getattr(policy, field) for field in limits}
    return {
        "make": {"name": name, "gains": {each: "inf" if value == math.inf else value for each, value in gains.items()}},
        "gains": {field: value for field, value in values.items() if math.isfinite(value)},
        "limits": {field: most for field, most in limits.items() if math.isfinite(most)},
        "export": export_of(module, function),
        "arguments": arguments,
        "out": out,
        "offset": field,
        "kind": kind,
        "knows": policy.knows,
        "rest": rest,
        "smooth": task == "path_following" and ("ends" if name in ENDS_ONLY else "whole"),
        "sheet": of_sheet(name, policy, handed) if name in OF_SHEETS else None,
        "look": look_table(module, look) if (look := look_of(task, name)) else None,
    }


def of_sheet(name: str, policy: Any, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Returns where a law's record holds numbers of the base, so that the page can put in those of another one."""
    fields = arguments["params"].dtype.fields
    numbers = []
    for field, (kind, source) in OF_SHEETS[name].items():
        number = getattr(policy, source, None) if kind not in ("decay", "mean") else arguments["params"][0][source]
        numbers.append([int(fields[field][1]), kind, float(number or 0.0)])
    return {"plant": int(fields["plant"][1]), "fields": numbers}


def look_table(module: str, look: Look) -> dict[str, Any]:
    """Returns how the page calls what finds the numbers of a law's overlay."""
    table = {"kind": look.kind, "title": look.title, "shape": list(look.shape), "places": look.places}
    return table | {"export": look_export(module, look)}


def handed_to_look(look: Look, kernel: Any, values: tuple[Any, ...], places: NDArray[Any]) -> tuple[Any, ...]:
    """Returns what the function of an overlay is handed, of what a decision was; it fills the last."""
    known = dict(zip(names_of(kernel), values, strict=True))
    known |= {"places": places, "looked": np.zeros(look.shape)}
    return tuple(known[each] for each in names_of(look.kernel))


Places = dict[str, list[list[Any]]]  # by gain, where the decision's arguments hold it: the argument, its byte or None


def sliders_of(task: str, name: str, env: NativeVectorEnv) -> dict[str, Any]:
    """Returns the gains of a policy that the page can change, and the names of the others."""
    places = gain_places(task, name, env)
    sliders, fixed = [], []
    for field, each in gains_of(make(name)).items():
        if field not in places:
            fixed.append(field)
            continue
        low, high = ends_of(each)
        above = next((end for end in (each.above, each.least) if isinstance(end, str)), None)
        about = {"name": field, "unit": "" if each.unit == "1" else each.unit, "about": each.meaning, "above": above}
        sliders.append({**about, "low": low, "high": high, "whole": each.kind is int, "places": places[field]})
    return {"gains": sliders, "fixed": fixed}


def ends_of(each: Gain) -> tuple[float, float]:
    """Returns between which values a slider changes a gain: where it is searched, or a quarter to four times of it."""
    bounds = [float(end) for end in (each.above, each.least) if isinstance(end, float | int)]
    if each.search is not None:
        low, high = each.search.low, each.search.high
    elif each.default:
        low, high = sorted((0.25 * each.default, 4.0 * each.default))
    else:
        low, high = 0.0, 1.0
    low, high = min(low, each.default), max(high, each.default)
    low, high = max(low, *bounds), min(high, each.below, each.most)
    return (round(low), round(high)) if each.kind is int else (low, high)


_PLACES: dict[tuple[str, str], Places] = {}


def gain_places(task: str, name: str, env: NativeVectorEnv) -> Places:
    """Returns where a policy's gains stand among the arguments of its decision, of those that stand there as they are.

    Found by changing each to the ends of its slider: all numbers that differ then must be the gain itself.
    """
    if (task, name) not in _PLACES:
        before = _numbers(task, name, {}, env)
        reached: Places = {}
        for field, each in gains_of(make(name)).items():
            if each.kind not in (int, float) or not math.isfinite(each.default) or field == "seed":
                continue
            tried = [_differing(task, name, field, value, before, env) for value in (*ends_of(each), _near(each))]
            known = [places for places in tried if places is not None]
            if len(known) >= 2 and known[0] and all(places == known[0] for places in known):
                reached[field] = known[0]
        _PLACES[task, name] = reached
    return _PLACES[task, name]


def gain_limits(task: str, name: str, env: NativeVectorEnv) -> dict[str, float]:
    """Returns the gains that the page can change on a base, and the most that each counts there: inf without a bound.

    A law takes the lesser of some gains and of what the actuators can do. A gain that other numbers are made of on this
    base is left out, but for those that `OF_SHEETS` tells the page how to make.
    """
    before = _numbers(task, name, {}, env)
    gains = gains_of(make(name))
    limits = {}
    for field, places in gain_places(task, name, env).items():
        low, high = ends_of(gains[field])
        if _held(task, name, {field: high}, before, places, env) == high:
            limits[field] = math.inf
            continue
        held = {end: _held(task, name, {field: end}, before, places, env) for end in (low, _near(gains[field]), high)}
        taken = {end: number for end, number in held.items() if number is not None}
        most = max(taken.values(), default=math.nan)
        if len(taken) >= 2 and all(number == min(end, most) for end, number in taken.items()):
            limits[field] = math.inf if most == max(taken) else most
    return limits


def _held(
    task: str, name: str, gains: Mapping[str, float], before: Mapping[str, Any], places: list[list[Any]], env: Any
) -> float | None:
    """Returns the number at a gain's places once it has a value; None where it is refused, nan where others change."""
    ((field, value),) = gains.items()
    try:
        after = _numbers(task, name, gains, env)
    except ValueError:
        return None
    kind: Any = np.int64 if isinstance(value, int) else np.float64
    numbers = set()
    for each, new in after.items():
        old = before.get(each)
        mine = [offset for argument, offset in places if argument == each]
        if not isinstance(new, np.ndarray):
            numbers |= {new} if mine else set()
            if not mine and new != old:
                return math.nan
            continue
        if old is None or len(old) != len(new):
            return math.nan
        rest = new[: len(new) - len(new) % 8].view(kind)
        numbers |= {rest[offset // 8].item() for offset in mine}
        made = _made(task, name, field, env) if each == "params" else set()
        other = np.flatnonzero(old != new) // 8 * 8
        if not {int(offset) for offset in other} <= {*mine, *made}:
            return math.nan
    return float(numbers.pop()) if len(numbers) == 1 else math.nan


def _made(task: str, name: str, field: str, env: NativeVectorEnv) -> set[int]:
    """Returns the bytes of a law's record that the page fills by itself once a gain has another value."""
    made = [each for each, source in OF_SHEETS.get(name, {}).items() if source == ("share_yaw", field)]
    if not made:
        return set()
    kernel, values = first_of(task, name, make(name), env)
    fields = dict(leaves(names_of(kernel), values))["params"].dtype.fields
    return {int(fields[each][1]) for each in made}


def _near(each: Gain) -> float:
    if each.kind is int:
        return float(each.default + 1)
    near = 1.01 * each.default + (each.default == 0.0) * 0.01
    return float(near if near < min(each.below, each.most + 1e-9) else 0.99 * each.default)


def _numbers(task: str, name: str, gains: Mapping[str, Any], env: NativeVectorEnv) -> dict[str, Any]:
    """Returns the constants, first memory and numbers that a decision is handed, by argument."""
    kernel, values = first_of(task, name, make(name, **gains), env)
    return {
        each: np.frombuffer(np.ascontiguousarray(value).tobytes(), np.uint8) if isinstance(value, np.ndarray) else value
        for each, value in leaves(names_of(kernel), values)
        if not isinstance(value, np.ndarray) or ROLES.get(each, "constant") in ("constant", "memory")
    }


def _differing(
    task: str, name: str, field: str, value: float, before: Mapping[str, Any], env: NativeVectorEnv
) -> list[list[Any]] | None:
    """Returns where a decision's numbers are the value once a gain has it; [] if others change too; None if refused."""
    default = getattr(make(name), field)
    if value == default:
        return None
    try:
        after = _numbers(task, name, {field: value}, env)
    except ValueError:
        return None
    places: list[list[Any]] = []
    for each, old in before.items():
        new = after.get(each)
        if not isinstance(old, np.ndarray):
            if old != new:
                if old != default or new != value:
                    return []
                places.append([each, None])
            continue
        if new is None or len(old) != len(new):
            return []
        if (old == new).all():
            continue
        kind = np.int64 if isinstance(default, int) else np.float64
        rest = len(old) % 8
        a, b = (numbers[: len(numbers) - rest].view(kind) for numbers in (old, new))
        other = np.flatnonzero(a.view(np.int64) != b.view(np.int64))
        if (a[other] != default).any() or (b[other] != value).any():
            return []
        places += [[each, 8 * int(k)] for k in other]
    return places


def export_of(module: str, function: str) -> str:
    """Returns the name of a function in the WebAssembly module."""
    return f"{module}_{function}"


def name_of(kernel: Any) -> str:
    """Returns the name of a compiled function."""
    name: str = kernel.py_func.__name__
    return name


def export_in(kernel: Any) -> str:
    """Returns the name in the WebAssembly module of a function of a trained agent."""
    module = kernel.py_func.__module__.rpartition(".")[2]
    return export_of("perception" if module in _OF_PERCEPTION else module, name_of(kernel))


def look_export(module: str, look: Look) -> str:
    """Returns the name in the WebAssembly module of what finds the numbers of an overlay, for a law's memory."""
    return export_of(module, name_of(look.kernel))


def _argument(name: str, value: Any, blobs: Blobs) -> dict[str, Any]:
    role = ROLES.get(name, "constant")
    if not isinstance(value, np.ndarray):
        return {"name": name, "role": "number", "value": float(value)}
    entry: dict[str, Any] = {"name": name, "role": role, "shape": list(value.shape), "size": value.dtype.itemsize}
    if role in ("constant", "memory"):
        entry["blob"] = blobs.put(value)
    return entry


def agent_calls(task: str, pilot: Pilot, env: NativeVectorEnv) -> list[tuple[Any, Any]]:
    """Returns the calls of a trained agent's first decision, and of its shield where that may act in the page."""
    observation, _ = env.reset(seed=0)
    pilot.reset()
    calls = noted(pilot, observation, network(task))
    if shielded_from(agent_of(pilot), pilot.briefing):
        calls += shield_calls(SHIELD, pilot, observation)
    return calls


def shield_calls(behind: shield.Shield, pilot: Pilot, observation: Any) -> list[tuple[Any, Any]]:
    """Returns the call of a shield."""
    calls: list[tuple[Any, tuple[Any, ...]]] = []
    fields = pilot.briefing.layout.unpack(observation.astype(np.float64))
    still = np.zeros((1, len(pilot.briefing.robot.twist_axes)))
    with watched(shield, "filter_twists", calls):
        behind.passed(fields, pilot.briefing, behind.reset(pilot.briefing), still)
    return calls


def agent_of(pilot: Pilot) -> Agent:
    """Returns the agent that a pilot's policy drives with."""
    policy: Any = pilot.policy
    agent: Agent = policy.agent(pilot.briefing)
    return agent


def shielded_from(agent: Agent, briefing: Briefing) -> int:
    """Returns the least team of robots that an agent is shielded in; 0: it is in none."""
    if agent.features.shielded in (False, "always"):
        return int(bool(agent.features.shielded))
    teams = agent.card["trained_on"].get("teams")
    return 1 if out_of_distribution(agent.card, briefing, agent.speed) else max(teams) + 1 if teams else 0


def network_recipe(
    task: str, name: str, seed: int, env: NativeVectorEnv, blobs: Blobs
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Returns how the page makes a trained agent decide, and the gains of it that the page can change."""
    # the laws that drive where a network stands are not in the page
    gains = {"seed": seed, **({"patience": 0.0} if task in ("docking", "path_following") else {})}
    policy = make(name, **gains)
    pilot = Pilot(policy, env)
    noted_calls = agent_calls(task, pilot, env)
    calls = {name_of(kernel): dict(leaves(names_of(kernel), values)) for kernel, values in noted_calls}
    agent = agent_of(pilot)
    actuators = effective_actuators(agent.card, pilot.briefing)
    forward = calls["forward"]
    perception = agent.perception(pilot.briefing)
    features: Any = perception.features  # of a kind that its task says
    actions = perception.actions
    table: dict[str, Any] = {
        "make": {"name": name, "gains": gains},
        "network": True,
        "knows": policy.knows,
        "speed": features.speed_scale
        if isinstance(features, RobotFeatures)
        else agent.speed
        if agent.keeps_pace
        else network_speed(agent.card, pilot.briefing, agent.speed),
        "kind": actions.kind,
        "yaw_rate": actions.yaw_rate,
        "reverse": actions.reverse,
        "previous": features.previous,
        "frames": features.frames,
        "stride": features.stride,
        "limits": limits_of(features, actuators).tolist() if features.limits else [],
        "trails": len(features.trails),
        "crumbs": features.crumbs,
        "crumbed": features.crumbed,
        "moved": features.moved,
        "width": features.width(len(env.task.robot.twist_axes)),
        "inputs": int(forward["sizes"][0]),
        "memory": perception.fresh(1).nbytes // 4,
        "rectified": bool(forward["rectified"]),
        "sizes": blobs.put(forward["sizes"]),
        "layers": len(forward["sizes"]),
        "widest": int(forward["sizes"].max()),
        "numbers": blobs.put(halves(forward["numbers"])),
        "count": len(forward["numbers"]),
        "task": task,
        "near_enough": NEAR_ENOUGH,
    }
    for function, call in calls.items():
        if "scales" in call:
            table[f"{function}_scales"] = np.asarray(call["scales"]).tolist()
    if "fill_trails" in calls:
        table["shares"] = calls["fill_trails"]["shares"].tolist()
    if "fill_goal" in calls:
        goal = calls["fill_goal"]
        table |= {"max_range": float(goal["max_range"]), "pool": int(goal["pool"]), "ahead": bool(goal["ahead"])}
    if agent.keeps_pace:
        most = max(agent.card["trained_on"]["speeds"])
        table["pace"] = {"time": agent.pace_time, "most": most, "dt": pilot.briefing.dt}
    if features.posed:
        table |= {"posed": features.posed, "rest": features.rest, "rest_turn": features.rest_turn}
    if "fill_bodies" in calls:
        bodies = calls["fill_bodies"]
        table |= {"bodied": bodies["out"].shape[1], "bodies": int(bodies["count"]), "fronted": bool(bodies["fronted"])}
    parts = {
        name_of(kernel): part_of(kernel, values, blobs)
        for kernel, values in noted_calls
        if name_of(kernel) in ("want", "avoid", "filter_twists", "decide")
    }
    if agent.base is not None:
        if agent.actions.kind != "planar":
            raise NotImplementedError(f"{name}: the page adds planar actions alone to a base, not unicycle ones")
        laws = {each: parts[each] | {"speed": place_of_speed(calls[each]["params"])} for each in ("want", "avoid")}
        table["base"] = {"guards": agent.base.guards, "reach": agent.base.reach} | laws
    if shielded_from(agent, pilot.briefing):
        table["shield"] = {"from": shielded_from(agent, pilot.briefing)} | parts["filter_twists"]
    if isinstance(features, RobotFeatures):
        table |= of_any_robot(features)
    if "decide" in parts:
        table |= planned(pilot, env, agent.speed, parts["decide"], calls["decide"]["memory"].dtype, blobs)
    if "guard" in calls:
        table["guard"] = np.asarray(calls["guard"]["law"]).tolist()
    if "hold" in calls:
        # JSON has no infinity: a limit that nothing reaches serves as well
        table["hold"] = np.minimum(calls["hold"]["law"], _UNREACHED).tolist()
        table["matrix"] = np.asarray(calls["hold"]["matrix"]).tolist()
    sliders: dict[str, Any] = {"gains": [], "fixed": list(gains_of(policy))}
    speeds = agent.card["trained_on"].get("speeds", [agent.speed])
    low, high = min(speeds), max(speeds)
    if agent.base is not None and low < high:
        speed: dict[str, Any] = {
            "name": "speed",
            "unit": "m/s",
            "about": "the most that it drives",
            "above": None,
            "places": [],
        }
        sliders["gains"].append(speed | {"low": low, "high": high, "whole": False})
        sliders["fixed"].remove("speed")
    # a base slower than those it knows is driven more slowly by a law of its own
    known = table["speed"] == agent.speed and bool(sliders["gains"])
    return table | {"gains": {"speed": agent.speed} if known else {}, "cruise": "speed" if known else None}, sliders


def part_of(kernel: Any, values: Sequence[Any], blobs: Blobs) -> dict[str, Any]:
    """Returns how the page calls one of the functions of a policy that calls several."""
    arguments = [_argument(each, value, blobs) for each, value in leaves(names_of(kernel), values)]
    return {"export": export_in(kernel), "arguments": arguments}


def of_any_robot(features: RobotFeatures) -> dict[str, Any]:
    """Returns what `RobotFeatures` do besides what `GoalFeatures` do.

    Raises:
        NotImplementedError: if the robot has other beams than the network sees.
    """
    beams, looked = features.windows
    if beams.tolist() != [[k] for k in range(features.num_beams)] or not looked.all():
        raise NotImplementedError("the page reads a scan as it is, with the beams that the network sees")
    scales = {"way": features.way_scale, "range": features.range_scale, "own": features.own_range}
    return {"any": scales | {"count": features.num_beams // features.pool}}


def planned(
    pilot: Pilot, env: NativeVectorEnv, speed: float, decide: dict[str, Any], state: np.dtype[Any], blobs: Blobs
) -> dict[str, Any]:
    """Returns what stands above an agent: `Hybrid`'s planner, and when `AnyRobot` lets that drive by itself.

    Args:
        speed: m/s, the agent's.
        decide: how the page calls the planner, whose memory is `state`.
    """
    policy: Any = pilot.policy
    fields = layout(state)["fields"]
    table = {
        "planner": decide | {"out": "memory", "offset": fields["command"][0]},
        "lead": policy.ahead,
        "look": look_table("scan_planner", LOOKS_TO_POSES["scan_planner"]),
    }
    if isinstance(policy, AnyRobot):
        ((kernel, values),) = shield_calls(BEHIND_PLANNER, pilot, env.reset(seed=0)[0])
        table["alone"] = {
            "patience": policy.patience * max(1.0, PACE / speed),
            "dt": pilot.briefing.dt,
            "way": WAY,
            "approached": APPROACHED,
            "radius": pilot.briefing.robot.hull_radius,
            "fields": {name: fields[name] for name in ("num_points", "segment", "arc", "older_age")},
            "behind": part_of(kernel, values, blobs),
        }
    return table


def place_of_speed(params: NDArray[Any]) -> int:
    """Returns the byte of a law's record that holds its cruising speed."""
    assert params.dtype.fields is not None
    return int(params.dtype.fields["max_speed"][1])


def cruise_of(name: str, gains: Mapping[str, Any]) -> str | None:
    """Returns the gain that holds a policy's cruising speed; None for one without."""
    try:
        return next(iter(cruising(name, gains, 1.0)))
    except NoCruisingSpeed:
        return None


def layout(dtype: np.dtype[Any]) -> dict[str, Any]:
    """Returns the size of a record, and the place and type of each of its fields; of a record in it, of its first."""

    def of(field: np.dtype[Any]) -> str:
        return of(next(iter(field.fields.values()))[0]) if field.fields else field.base.str

    fields = {name: [int(place[1]), of(place[0])] for name, place in (dtype.fields or {}).items()}
    return {"size": dtype.itemsize, "fields": fields}


def rows_of(env: NativeVectorEnv) -> str:
    """Returns what step and reset of a task are called in the module: tasks share them that differ in numbers alone."""
    kernel: Any = type(env.task).step_rows
    return str(kernel.py_func.__module__).rpartition(".")[2]


def task_tables(task: str, blobs: Blobs) -> dict[str, Any]:
    """Returns what the page needs to step a task: layouts, and the constants of each robot, tier and disturbance."""
    contest = contest_of(task)
    scenario = f"{contest.timed_on}/test"
    table: dict[str, Any] = {"kind": contest.spec.kind, "steps": contest.spec.clock, "params": {}, "robots": {}}
    for robot in fitting(task):
        for actuators in ACTUATORS:
            for disturbance in DISTURBANCES:
                env = environment(task, robot, actuators, scenario, disturbance)
                table["params"][f"{robot} {actuators} {disturbance}"] = blobs.put(env.task.params)
        axes = list(env.task.robot.twist_axes)
        fields = [[field.name, list(field.shape)] for field in env.task.layout.fields]
        table["robots"][robot] = {
            "axes": axes,
            "size": env.task.layout.size,
            "fields": fields,
            "max_twist": env.task.robot.max_twist.tolist(),
            "hull": env.task.robot.hull_radius,
        }
    table["ids"] = {robot: contest.env_id(robot) for robot in fitting(task)}
    # whether people see the robot is said by each of them
    table["kwargs"] = {name: each for name, each in contest.env_kwargs.items() if name != "visible"}
    kind = contest.spec.scenario
    table["scenario"] = [
        "wayfield.envs.scenarios" if hasattr(scenarios, kind.__name__) else kind.__module__,
        kind.__name__,
    ]
    table["rows"] = rows_of(env)
    table["sheet"] = layout(env.task.params.dtype)["fields"]
    table["state"] = layout(env.task.state_dtype)
    table["course"] = layout(env.task.world.courses.dtype)
    table["numbers"] = [*env.task.info_names, "reward"]
    table["flags"] = [*env.task.flag_names, "ended"]
    table["draws"] = env.task.draws
    table["beams"] = env.task.num_beams
    table["directions"] = blobs.put(env.task.world.beams) if env.task.num_beams else None
    table["tracks"] = env.task.noise_columns
    table["late"] = None if task in CROWDS else late_table(task, blobs)
    return table


def disturbance_tables() -> dict[str, Any]:
    """Returns what the page itself does of each disturbance: delays, drawn shoves, empty beams."""
    return {
        name: {"delay": each.action_delay, "shove": float(each.displaces), "drops": each.range_dropout > 0.0,
               "noisy": max(each.pose_noise, each.encoder_noise, each.range_noise, each.range_dropout) > 0.0}
        for name, each in DISTURBANCES.items()
    }  # fmt: skip


def tables(robots: Sequence[str] = (), tiers: Sequence[str] = ()) -> dict[str, Any]:
    """Returns all that the page needs beside the WebAssembly module.

    Args:
        robots: those that policies are prepared for; all that fit the families where none is named.
        tiers: of actuators, that policies are prepared for; all where none is named.
    """
    blobs = Blobs()
    content: dict[str, Any] = {
        "tasks": {},
        "pilots": {},
        "sliders": {},
        "disturbances": disturbance_tables(),
        "tiers": list(ACTUATORS),
        "sheet": {
            "base": BASE,
            "plant": layout(PLANT)["fields"],
            "wheels": MAX_WHEELS,
            "sensors": dataclasses.asdict(ROBOTS[BASE].sensors),
            "tiers": {
                # None: without a limit
                name: [each.at_rated_speed, *(_finite(a) for a in (each.acceleration, each.yaw_acceleration)), each.lag]
                for name, each in ACTUATORS.items()
            },
        },
        "records": {name: layout(each) for name, each in _RECORDS.items()},
    }
    for task in IN_PAGE:
        content["tasks"][task] = task_tables(task, blobs)
        contest = contest_of(task)
        for robot in (each for each in robots or ROBOTS if each in fitting(task)):
            for actuators in tiers or ACTUATORS:
                env = environment(task, robot, actuators, f"{contest.timed_on}/test")
                for name in decisions(task):
                    if lacks(make(name), ROBOTS[robot]):
                        continue
                    if f"{task} {name}" not in content["sliders"]:
                        content["sliders"][f"{task} {name}"] = sliders_of(task, name, env)
                    sets = list(contest.gain_sets(name, robot, ("default", "tuned", "paper"))) or [("default", {})]
                    limits = gain_limits(task, name, env)
                    for gains_name, gains in sets:
                        label = name if gains_name == "default" else f"{name} ({gains_name})"
                        key = f"{task} {robot} {actuators} {label}"
                        content["pilots"][key] = recipe(task, name, gains, limits, env, blobs)
                        content["pilots"][key]["cruise"] = None if gains_name in COMPLETE else cruise_of(name, gains)
                for name in agents(task):
                    for label in agent_labels(task, name, robot):
                        key = f"{task} {robot} {actuators} {label}"
                        content["pilots"][key], sliders = network_recipe(task, name, 0, env, blobs)
                        content["sliders"][f"{task} {name}"] = sliders
    content["blobs"] = blobs.listed()
    return content


BASE = "p3dx"  # whose records those of a differential data sheet are made from, in the page


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


LARGER = 0.35  # m: hulls of the class of jackal, with which the page makes scenes larger


def fitting(task: str) -> tuple[str, ...]:
    """Returns the robots that the scenes of a task in the page have room for."""
    most = LARGEST_HULL if task in CROWDS else LARGER
    return tuple(name for name, robot in ROBOTS.items() if robot.hull_radius <= most)


_RECORDS = {
    "walk": WALK,
    "walker": WALKER,
    "place": PLACE,
    "hull": HULL,
    "obstacle": OBSTACLE,
    "vertex": VERTEX,
    "run": RUN,
    "frame": NO_GRIDS.frames.dtype,
    "late_model": np.dtype(forward_prediction.MODEL, align=True),
    "late_state": forward_prediction.STATE,
}


@compiled
def fill_bearings(y: Any, x: Any, angles: Any) -> None:
    """Fills the angles (k,) of vectors with these components, (k,) each."""
    for i in range(angles.shape[0]):
        angles[i] = bearing(y[i], x[i])


@allocating
def smooth_course(points: Any, closed: Any, ends_only: Any, out: Any) -> None:
    """Fills how many points the path has without its wiggles, and below these (n, 3); see `path_smoothing`."""
    smoothed = path_smoothing.smooth_points(points, closed, ends_only)
    out[0, 0] = smoothed.shape[0]
    for k in range(min(smoothed.shape[0], out.shape[0] - 1)):
        out[k + 1] = smoothed[k]


@allocating
def place_on_course(course: Any, given: Any, laps: Any, arc_lengths: Any) -> None:
    """Puts the arc lengths (1,) along the path without wiggles in place of those along the path as it is, m."""
    vertices, runs, path_index = course
    arc_lengths[:] = path_smoothing.places(vertices, runs, path_index, given, laps, arc_lengths)


Export = tuple[Any, list[Leaf], tuple[Any, ...]]  # a compiled function, and an example of what it is handed


def jobs() -> list[tuple[str, str]]:
    """Returns what the functions of the module are found by: a task and a policy; "" for the task's own functions."""
    return [
        (task, name)
        for task in IN_PAGE
        for name in ("", *decisions(task), *(() if task in CROWDS else (LATE,)), *agents(task))
    ]


def exports(task: str, policy: str) -> dict[str, Export]:
    """Returns the functions of the WebAssembly module that a job of `jobs` stands for, by their names there."""
    contest = contest_of(task)
    timed_on = f"{contest.timed_on}/test"
    if policy in AGENTS:
        exported: dict[str, Export] = {}
        for robot in fitting(task):  # agents of one may call more than those of another
            if not agent_labels(task, policy, robot):
                continue
            # a quick base shows all that an agent calls: it is held to what the agent knows
            env = environment(task, robot, "ideal", timed_on)
            for kernel, values in agent_calls(task, Pilot(make(policy), env), env):
                exported.setdefault(export_in(kernel), (kernel, leaves(names_of(kernel), values), values))
        return exported
    if policy == LATE:
        return {
            export_of(LATE, name_of(kernel)): (kernel, leaves(names_of(kernel), values), values)
            for kernel, values in predictions(task)
        }
    env = environment(task, "p3dx" if contest.spec.on_path else "omni3", "lagged", timed_on)
    if policy:
        module, function, *_ = decisions(task)[policy]
        kernel, values = first_of(task, policy, make(policy), env)
        exported = {export_of(module, function): (kernel, leaves(names_of(kernel), values), values)}
        if (look := look_of(task, policy)) is not None:
            handed = handed_to_look(look, kernel, values, np.zeros((look.places, 2)))
            exported[look_export(module, look)] = (look.kernel, leaves(names_of(look.kernel), handed), handed)
        return exported
    batch, kinds = env.batch, type(env.task)
    results = Results(env.task, 1)
    outputs = (results.observations, results.numbers, results.flags)
    rows, draws = np.zeros(1, np.int64), np.zeros((1, batch.draws))
    reset = (
        env.task.params,
        batch.states,
        batch.obstacles,
        rows,
        draws,
        batch.noise,
        *env.task.world,
        *batch.own,
        *outputs,
    )
    step = (7, 0, ALONE, *batch._inputs, *outputs)
    corners = (np.zeros(2), np.zeros(2), np.zeros(2))
    smoothing: tuple[Any, ...] = ()
    if contest.spec.on_path:
        course = Course(env.task.world.vertices, env.task.world.runs, rows)
        placing = (course, np.zeros(2), np.zeros(1), np.zeros(1))
        smoothing = (
            ("smooth_course", smooth_course, (np.zeros((2, 3)), False, False, np.zeros((2, 3)))),
            ("place_on_course", place_on_course, placing),
        )
    return {
        name: (kernel, leaves(names_of(kernel), values), values)
        for name, kernel, values in (
            ("fill_bearings", fill_bearings, corners),
            *smoothing,
            (f"{rows_of(env)}_step", kinds.step_rows, step),
            (f"{rows_of(env)}_reset", kinds.reset_rows, reset),
        )
    }
