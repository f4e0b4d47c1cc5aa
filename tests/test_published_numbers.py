"""Numbers that a source prints, and the code's own promises of its defaults, stand in the code as they were printed."""

import ast
import dataclasses
import enum
import importlib
import inspect
import json
import math
import operator
import pkgutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wayfield import policies
from wayfield.envs import docking, goal_reaching, path_following, records
from wayfield.envs.disturbances import DISTURBANCES, LEVELS
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.specs import TASKS
from wayfield.policies.learned.perception import Actions, DockFeatures, GoalFeatures, PathFeatures
from wayfield.policies.training.presets import Sac
from wayfield.policies.training.shaping import GoalReward, PathReward

# The gains that the documents and the papers print, and those that Nav2 ships with (nav2_bringup, Humble for DWB and
# Jazzy for MPPI; costmaps of its local one).
PRINTED: dict[str, dict[str, Any]] = {
    "lookahead_documented": {
        "k_lin": 1.2, "k_ang": 0.8, "k_ori": 8.0, "lookahead_distance": 0.5, "mode_distance": 0.05, "search": "whole",
    },
    # document A's corrected gain: pure pursuit's equivalent, 2 k_lin
    "lookahead_retuned": {"k_lin": 1.2, "k_ang": 2.4, "k_ori": 8.0, "lookahead_distance": 0.5, "search": "window"},
    "waypoint": {"lam": 1.0, "switching_radius": 0.35},
    # document C; tau_l a little above 1, where every equilibrium lies
    "apf_documented": {"k_att": 0.2, "k_rep": 0.52, "tau_l": 1.05, "escape": False},
    "apf_escape": {"k_att": 0.2, "k_rep": 0.52, "tau_l": 1.05, "escape": True},
    "apf_corrected": {"k": 0.6, "eta": 0.02, "rho_0": 0.6, "max_speed": 0.3},
    # Macenski et al. 2023
    "regulated_pure_pursuit": {"rotate_angle": 0.785},
    # Ulrich and Borenstein 1998: mu_1 = 5, mu_2 = mu_3 = 2
    "vfh_plus": {"mu_goal": 5.0, "mu_heading": 2.0, "mu_previous": 2.0},
    # Park and Kuipers 2011
    "smooth_pose": {"k1": 1.0, "k2": 3.0, "lam": 2.0},
    # Astolfi 1999
    "polar": {"k_rho": 3.0, "k_alpha": 8.0, "k_beta": -1.5},
    "nav2_dwb": {
        "max_yaw_rate": 1.0, "acceleration": 2.5, "yaw_acceleration": 3.2, "speeds": 20, "sideways": 5, "turns": 20,
        "horizon": 1.7, "linear_step": 0.05, "angular_step": 0.025, "obstacle": 0.02, "path_distance": 32.0,
        "goal_distance": 24.0, "path_align": 32.0, "goal_align": 24.0, "forward_point": 0.1, "rotate_to_goal": 32.0,
        "slowing": 5.0, "stopped_speed": 0.25,
    },
    "nav2_mppi": {
        "samples": 2000, "steps": 56, "step_time": 0.05, "temperature": 0.3, "gamma": 0.015, "speed_noise": 0.2,
        "yaw_noise": 0.4, "max_reverse": 0.35, "max_yaw_rate": 1.9, "acceleration": 3.0, "yaw_acceleration": 3.5,
        "prune_distance": 1.7, "constraint": 4.0, "cost": 3.81, "collision_cost": 1e6, "near_goal": 1.0,
        "cost_stride": 2, "goal": 5.0, "goal_within": 1.4, "goal_angle": 3.0, "goal_angle_within": 0.5,
        "path_align": 14.0, "path_align_from": 0.5, "path_align_offset": 20, "align_stride": 4, "most_occupied": 0.05,
        "path_follow": 5.0, "path_follow_from": 1.4, "path_follow_offset": 5, "path_angle": 2.0,
        "path_angle_from": 0.5, "path_angle_offset": 4, "path_angle_beyond": 1.0, "prefer_forward": 5.0,
        "prefer_forward_from": 0.5,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", PRINTED)
def test_gains_that_a_source_prints_are_the_defaults(name: str) -> None:
    policy = policies.make(name)
    assert {gain: getattr(policy, gain) for gain in PRINTED[name]} == PRINTED[name]


def test_rewards_weigh_what_their_sheets_say() -> None:
    path, goal, dock = path_following.Params(), goal_reaching.Params(), docking.Params()
    assert (path.error_scale, path.corridor_penalty, path.window, path.end_tolerance) == (0.1, 10.0, 1.0, 0.05)
    for params, weight in ((goal, 0.1), (dock, 0.3)):
        assert (params.heading_weight, params.time_cost) == (weight, 0.01)
        assert (params.success_reward, params.collision_penalty) == (5.0, 5.0)
    assert (goal.rest_speed, goal.rest_yaw_rate) == (math.inf, math.inf)
    assert (dock.rest_speed, dock.rest_yaw_rate) == (0.02, 0.05)


def test_robots_of_the_documents_have_the_documents_numbers() -> None:
    p3dx, omni3, omni4 = (ROBOTS[name] for name in ("p3dx", "omni3", "omni4"))
    assert {wheel.radius for wheel in p3dx.wheels} == {0.0975}
    assert sorted(y for _, y in p3dx.wheel_positions) == [-0.1905, 0.1905]
    for robot, angles, radius, reach in (
        (omni3, (30.0, 150.0, -90.0), 0.075, 0.3),
        (omni4, (45.0, 135.0, -45.0, -135.0), 0.03, 0.13),
    ):
        assert {wheel.radius for wheel in robot.wheels} == {radius}
        turns = [math.degrees(angle) for angle in robot.wheel_directions]
        assert turns == pytest.approx(angles)
        assert [math.hypot(x, y) for x, y in robot.wheel_positions] == pytest.approx([reach] * len(angles))


def test_tiers_of_actuators_and_noise_are_those_of_the_sheets() -> None:
    told = {name: (each.acceleration, each.yaw_acceleration, each.lag) for name, each in ACTUATORS.items()}
    assert told == {"ideal": (math.inf, math.inf, 0.0), "lagged": (1.0, 3.0, 0.1), "slow": (0.5, 1.5, 0.25)}
    noise = records.POSITION_NOISE, records.HEADING_NOISE, records.ENCODER_NOISE, records.RANGE_NOISE
    assert noise == (0.01, 0.01, 0.02, 0.01)


# Of each level: radius, track, slip, side slip, noise of pose, encoders and ranges, dropout, delay, shove.
WRONG = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0),
    "light": (0.005, 0.01, 0.02, 0.01, 0.5, 0.5, 0.5, 0.01, 0, 0.05),
    "moderate": (0.01, 0.02, 0.05, 0.02, 1.0, 1.0, 1.0, 0.02, 1, 0.1),
    "strong": (0.02, 0.03, 0.10, 0.04, 2.0, 2.0, 2.0, 0.05, 2, 0.2),
    "severe": (0.03, 0.05, 0.15, 0.06, 3.0, 3.0, 3.0, 0.10, 3, 0.3),
}
ALONE = {
    "wheel_error": ("wheel_radius_error", "track_error"),
    "slip": ("slip", "side_slip"),
    "noise": ("pose_noise", "encoder_noise", "range_noise"),
    "dropout": ("range_dropout",),
    "shove": ("shove",),
}


def test_levels_that_results_were_published_with_stay_what_they_were() -> None:
    assert tuple(WRONG) == LEVELS
    for name, numbers in WRONG.items():
        assert dataclasses.astuple(DISTURBANCES[name]) == numbers
    strong = dataclasses.asdict(DISTURBANCES["strong"])
    for name, fields in ALONE.items():
        kept = {field: value if field in fields else 0.0 for field, value in strong.items()}
        assert dataclasses.asdict(DISTURBANCES[name]) == kept
    for steps in (1, 2, 3):
        delay = dataclasses.asdict(DISTURBANCES[f"delay_{steps}"])
        assert delay == dict.fromkeys(delay, 0.0) | {"action_delay": steps}


def test_contests_last_a_minute_and_paths_two() -> None:
    assert {spec.clock * 0.05 for spec in TASKS.values() if not spec.on_path} == {60.0}
    assert {spec.clock * 0.05 for spec in TASKS.values() if spec.on_path} == {120.0}
    # a run that fails counts as the whole clock, or as the corridor's metre
    assert {spec.cost.failure for spec in TASKS.values() if not spec.on_path} == {60.0}
    assert {spec.cost.failure for spec in TASKS.values() if spec.on_path} == {1.0}
    assert TASKS["path_following"].tier_bounds == (1.0, 2.5)
    assert TASKS["goal_reaching"].tier_bounds == (0.6, 0.35)


# Gains whose range does not begin at zero: values at its edge, or just inside.
EDGES = {
    ("regulated_pure_pursuit", "max_lookahead"): 0.3,  # min_lookahead
    ("smooth_pose", "lam"): 1.000001,
    ("smooth_pose_backward", "lam"): 1.000001,
    ("polar", "k_alpha"): 3.000001,  # k_rho
    ("polar", "k_beta"): -0.000001,
    ("vfh_plus", "high"): 0.3,  # low
    ("mppi", "cell"): 0.008,  # a five hundredth of the reach
}


@pytest.mark.parametrize("name", policies.POLICIES)
def test_every_gain_is_taken_down_to_the_edge_of_its_range(name: str) -> None:
    for field in dataclasses.fields(policies.make(name)):  # type: ignore[arg-type]
        if field.type is not float:
            continue
        least = EDGES.get((name, field.name), 0.0)
        try:
            policy = policies.make(name, **{field.name: least})
        except ValueError:
            policy = policies.make(name, **{field.name: 1e-6})  # above zero
        assert getattr(policy, field.name) in (least, 1e-6)


# What a class or a function outside the file below takes where it is told nothing, as its docstring and the pages say.
_ONE_ROBOT = {"dynamics": "kinematic", "actuators": "ideal", "disturbance": "none"}
_GIVEN = {**_ONE_ROBOT, "action_mode": "twist", "noise": 0.0, "pose_source": "ground_truth"}
TAKEN: dict[str, dict[str, Any]] = {
    "envs.path_following:DiffDrivePathFollowing": {
        **_GIVEN, "scenario": "random_splines", "scale": 1.0, "num_preview": 10, "preview_spacing": 0.1,
    },
    "envs.goal_reaching:OmniGoalObstacles": {
        **_GIVEN, "scenario": "discs", "end_on_success": True, "end_on_contact": True,
    },
    "envs.docking:OmniDocking": {**_GIVEN, "scenario": "all", "end_on_success": True, "end_on_contact": True},
    "envs.vector:NativeVectorEnv": {"num_envs": 1, "autoreset_mode": "NextStep", "num_threads": 1},
    "envs.batch:Batch": {"num_threads": 1},
    "envs.sb3:NativeVecEnv": {"worlds": 1},
    "envs.grids:OccupancyGrid": {"origin": (0.0, 0.0, 0.0), "beyond": "occupied", "name": ""},
    "envs.paths:Path": {"closed": False},
    "envs.rendering:Renderer": {"size_px": 640},
    "envs.engines:Engine": {"tries": 1, "ahead": 10_000, "remote": False},
    "envs.checks:number": {"least": -math.inf, "above": -math.inf, "most": 1e6},
    "envs.coppelia.server:Server": {"host": "127.0.0.1", "port": 23000, "speed": 1.0},
    "envs.coppelia.world:World": {
        "dynamics": "kinematic", "actuators": "ideal", "dt": 0.05, "moving": False, "room": 0,
    },
    "envs.coppelia.scenes:Conditions": {"dynamics": "kinematic", "actuators": "ideal", "dt": 0.05, "number": 0},
    "envs.coppelia.scenes:make_world": {"files": True},
    "envs.coppelia.scene:Scene.add": {"pose": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)},
    "envs.coppelia.scene:Scene.find": {"index": 0},
    "envs.coppelia.standstill:stand_still": {"timeout": 2.0},
    "envs.coppelia.signatures:exactly": {"most": 1e300},
    "envs.coppelia.curves:lengths_of": {"dimensions": 3},
    "envs.coppelia.curves:interpolated": {"strength": 0.0, "closed": False},
    "envs.coppelia.codec:one_line": {"longest": 200},
    "envs.coppelia.window:Window": {"render_mode": "human"},
    "benchmarks.comparison:compare": {
        "contest": "goal-obstacles", "robot": "p3dx", "dynamics": "kinematic", "actuators": "lagged", "gains": "best",
        "seed": 0, "workers": 1,
    },
    "benchmarks.rollout:roll_out": {
        "dynamics": "kinematic", "actuators": "ideal", "seed": 0, "episodes": 1, "members": (),
    },
    "benchmarks.recorder:record": {"exploration": 0.0},
    "benchmarks.metrics:reference_jumps": {"lap_length": 0.0},
    "benchmarks.paired:difference": {"reduction": "mean", "dearer": 0.0},
    "benchmarks.aggregates:interval": {"seed": 0, "resamples": 2000},
    "benchmarks.audit_formulas:resampled": {"times": 400, "seed": 1},
    "benchmarks.own_scenario:own_cases": {"robot": "p3dx"},
    "benchmarks.faults.place:left_running": {"patience": 3.0},
    "benchmarks.progress:tracked": {"foretold": True},
    "policies.pilot:Pilot": {"num_threads": 1},
}  # fmt: skip


@pytest.mark.parametrize("name", TAKEN)
def test_what_is_taken_where_nothing_is_told(name: str) -> None:
    room, _, made = name.partition(":")
    found = operator.attrgetter(made)(pytest.importorskip(f"wayfield.{room}"))
    told = {name: each.default for name, each in inspect.signature(found).parameters.items()}
    told = {name: each.value if isinstance(each, enum.Enum) else each for name, each in told.items()}
    plainly = {name: each for name, each in told.items() if isinstance(each, bool | int | float | str | tuple)}
    assert {name: each for name, each in plainly.items() if not hasattr(each, "_fields")} == TAKEN[name]


# Every number that results hang on stands once more in a file: that of a law, a plant, a family, a preset, a table. Who
# changes one changes it there too (`python tests/test_published_numbers.py` writes the file), and publishes anew.
NUMBERS = Path(__file__).parent / "fixtures" / "numbers.json"
ROOMS = (
    *("envs", "envs.scenarios", "policies", "policies.parts", "policies.learned", "policies.training"),
    "benchmarks.contests",
)
BESIDES = (
    *(f"benchmarks.{name}" for name in ("aggregates", "claims", "crossed", "metrics", "paired", "shortest", "suite")),
    *(f"benchmarks.{name}" for name in ("audit", "contest_options", "coverage", "decisions", "drives", "entries")),
    *(f"benchmarks.{name}" for name in ("kept_rows", "own_scenario", "public_suites", "recorder")),
    *(f"benchmarks.{name}" for name in ("rollout", "rooms", "throughput", "tune", "tune_all")),
    *(f"benchmarks.report.{name}" for name in ("drives", "worlds")),
)
# what no result hangs on: how it is computed, shown, or read
MACHINES = {
    *("batch", "blocks", "checks", "cluster", "command_line", "compiled", "crew", "engines", "grids", "processes"),
    *("reading", "readers", "rendering", "sandbox", "sb3", "single", "storage", "vector"),
}


def plain(value: Any) -> Any:
    """Returns numbers as they are, and what holds them as lists and dictionaries of them; None of all else."""
    if isinstance(value, bool | int | float | np.integer | np.floating):
        return value.item() if isinstance(value, np.generic) else value
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.names is None and value.size < 100 else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        told = [(field.name, plain(getattr(value, field.name))) for field in dataclasses.fields(value)]
    elif isinstance(value, Mapping):
        told = [(str(name), plain(each)) for name, each in value.items()]
    elif isinstance(value, tuple | list):
        found = [plain(each) for each in value]
        return found if any(each is not None for each in found) else None
    else:
        return None
    return {name: each for name, each in told if each is not None} or None


def is_constant(name: str) -> bool:
    return name.strip("_").isupper() and not name.startswith("__")


def arguments(function: Any) -> dict[str, Any]:
    """Returns the numbers that a function takes where it is told none, by argument."""
    function = getattr(function, "py_func", function)
    told = {name: each.default for name, each in inspect.signature(function).parameters.items()}
    return {name: each for name, each in told.items() if isinstance(each, bool | int | float)}


# Which of these a number may be, the others as they are by default: its range stands once more as well.
ASKED = (-math.inf, -1.0, 0.0, 1e-6, 0.1, 0.5, 1.0, 2.0, 10.0, 1e4, 1e7, 1e9, 1.1e9, math.inf)
COUNTED = (-1, 0, 1, 2, 3, 100, 101, 1000, 1001, 10_000, 10_001, 2**31 - 1, 2**31)


def ranges(made: Any) -> dict[str, str]:
    """Returns which of the numbers asked about each number of a dataclass may be: + or - for each."""
    found = {}
    for field in dataclasses.fields(made):
        value = getattr(made, field.name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            told = ""
            for each in ASKED if isinstance(value, float) else COUNTED:
                try:
                    dataclasses.replace(made, **{field.name: each})
                except (ValueError, MemoryError):
                    told += "-"
                else:
                    told += "+"
            found[field.name] = told
    return found


def assigned(module: Any) -> set[str]:
    """Returns the names of a module's own constants."""
    found = set()
    for node in ast.parse(inspect.getsource(module)).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for each in targets:
            found |= {name.id for name in getattr(each, "elts", [each]) if isinstance(name, ast.Name)}
    return {name for name in found if is_constant(name)}


def numbers() -> dict[str, Any]:
    """Returns the constants and the defaults of every module of the rooms, by their names."""
    names = list(BESIDES)
    for room in ROOMS:
        path = importlib.import_module(f"wayfield.{room}").__path__
        modules = (each.name for each in pkgutil.iter_modules(path) if not each.ispkg)
        names += [f"{room}.{module}" for module in modules if module not in MACHINES]
    found: dict[str, Any] = {f"gains of {name}": plain(policies.make(name)) for name in policies.POLICIES}
    checked = {name: policies.make(name) for name in policies.POLICIES}
    checked |= {each.__name__: each() for each in (Actions, DockFeatures, GoalFeatures, PathFeatures)}
    checked |= {each.__name__: each() for each in (GoalReward, PathReward, Sac)}
    found |= {f"ranges of {name}": ranges(each) for name, each in checked.items()}
    for name in names:
        module = importlib.import_module(f"wayfield.{name}")
        for key in assigned(module):
            found[f"{name}.{key}"] = plain(getattr(module, key))
        for key, value in vars(module).items():
            if dataclasses.is_dataclass(value) and getattr(value, "__module__", "") == module.__name__:
                defaults = {field.name: field.default for field in dataclasses.fields(value)}
                found[f"{name}.{key}"] = plain(defaults)
            owned = vars(value).items() if isinstance(value, type) else [("", value)]
            for inside, each in owned if getattr(value, "__module__", "") == module.__name__ else ():
                told_above = inside == "__init__" and dataclasses.is_dataclass(value)
                if inspect.isfunction(getattr(each, "py_func", each)) and not told_above:
                    found[f"{name}.{key}.{inside}()".replace(".()", "()")] = plain(arguments(each))
    return {name: told for name, told in sorted(found.items()) if told is not None}


def test_the_numbers_are_those_that_results_were_published_with() -> None:
    told, found = json.loads(NUMBERS.read_text(encoding="utf-8")), json.loads(json.dumps(numbers()))
    changed = {name for name in told.keys() | found.keys() if told.get(name) != found.get(name)}
    assert not changed, {name: (told.get(name), found.get(name)) for name in sorted(changed)}


if __name__ == "__main__":
    lines = (f"{json.dumps(name)}: {json.dumps(told)}" for name, told in numbers().items())
    NUMBERS.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
