"""The banks of scenarios that the environments draw from: by name, from a frozen split, or from the user's file."""

import functools
import os
import warnings
from typing import Any

import numpy as np

from wayfield.envs.scenarios.barn import barn_scenarios
from wayfield.envs.scenarios.files import field_scenario_from_file, of_no_scenario, path_scenario_from_file
from wayfield.envs.scenarios.maps import MAP_SUFFIXES, scenarios_of_problems
from wayfield.envs.scenarios.mrpb import CASES, CONFIG, MAP, is_mrpb, mrpb_scenarios
from wayfield.envs.scenarios.scenario import GoalScenario, PathScenario, check_clear
from wayfield.envs.scenarios.splits import SPLITS, families, split
from wayfield.envs.scenarios.tables import TABLE_SUFFIXES
from wayfield.envs.tasks.specs import EVERY, TASKS, TaskSpec
from wayfield.system.checks import number, shown, suggestion
from wayfield.system.objects import FileNote

_PROBLEMS = ".scen"
_FILE_SUFFIXES = (*TABLE_SUFFIXES, ".json", _PROBLEMS)
_PATHS, _GOALS = TASKS["path_following"], TASKS["goal_reaching"]


def scenarios_of(spec: TaskSpec, name: str, hull_radius: float, scale: float = 1.0) -> tuple[Any, ...]:
    """Returns the scenarios of a task by a name, for a robot: `path_scenarios` or `field_scenarios`."""
    if issubclass(spec.scenario, PathScenario):
        return path_scenarios(name, scale, spec)
    return field_scenarios(spec, name, hull_radius)


def path_scenarios(name: str, scale: float = 1.0, spec: TaskSpec = _PATHS) -> tuple[Any, ...]:
    """Returns the scenarios of a name, of a task on paths: one, or the many of a random family.

    A path of the user's that robots may not follow to its end is warned of.

    Args:
        name: a name of the task's presets, PATH_SCENARIOS; one of its families or "all", as it is for its training
            split or with "/train", "/validation" or "/test" behind it; or a table or .json file; see
            `path_scenario_from_file`. Or a `PathScenario`, or a list of some, or of names of families.
        scale: multiplies the positions of paths and starts, not the corridor or the start offsets.

    Raises:
        ValueError: if the name is unknown, the scale is not above 0, or the file is faulty.
        OSError: if the file cannot be opened.
    """
    scale = number("scale", scale, above=0.0)
    if (own := _own(spec, name)) is not None:
        return _warned_of(_scaled(own, scale))
    if isinstance(name, str) and name in spec.presets:
        return _named_path_scenarios(spec.name, name, scale)
    if (frozen := _frozen_split(spec, name)) is not None:
        return _scaled(frozen, scale)
    if not _means_file(name):
        raise _unknown(spec, name)
    return _warned_of((path_scenario_from_file(os.fspath(name), scale, spec),))


def _warned_of(scenarios: tuple[Any, ...]) -> tuple[Any, ...]:
    for each in scenarios:
        if said := each.doubt():
            warnings.warn(f"{each.name}: {said}", FileNote, stacklevel=4)
    return scenarios


def goal_scenarios(name: str, hull_radius: float) -> tuple[GoalScenario, ...]:
    """Returns the goal-reaching scenarios of a name: `field_scenarios` of that task."""
    return field_scenarios(_GOALS, name, hull_radius)


def field_scenarios(spec: TaskSpec, name: Any, hull_radius: float) -> tuple[Any, ...]:
    """Returns the scenarios of a name, of a task among obstacles: one, or the many of a random family.

    Args:
        name: a name of the task's presets; one of its families or "all", as it is for its training split or with
            "/train", "/validation" or "/test" behind it, and then "@0.45" for hulls to 0.45 m; a .json file, see
            `field_scenario_from_file`; or for goals a .scen file, the problems of a MovingAI map with cells of 1 m, or
            a folder: worlds of the BARN challenge, or a map of MRPB with its cases. Or a scenario, `spec.scenario`, or
            a list of some, or of names of families.
        hull_radius: m, the robot's; it fits at every start and goal, and a random family leaves it a way.

    Raises:
        ValueError: if the name is unknown, the hull does not fit, or the file is faulty.
        OSError: if the file cannot be opened.
    """
    hull_radius = number("hull_radius", hull_radius, above=0.0)
    if (own := _own(spec, name)) is not None:
        for scenario in own:
            check_clear(scenario, hull_radius)
        return _warned_of(own)
    if isinstance(name, str) and name in spec.presets:
        return _named_field_scenarios(spec.name, name, hull_radius)
    if (frozen := _frozen_split(spec, name)) is not None:
        if not isinstance(name, str):
            return tuple(scenario for each in name for scenario in field_scenarios(spec, each, hull_radius))
        bare, _, hull = name.partition("@")
        most = float(hull or spec.repertoire.largest_hull)
        if hull_radius > most:
            whole = spec.repertoire.split_for(bare if "/" in bare else f"{bare}/train", hull_radius)
            family = spec.families.get(bare.partition("/")[0])
            has_classes = "@" in whole and not (family and family.needs_forces)
            fits = f"; its hull class is {whole!r}" if has_classes else ""
            raise ValueError(
                f"hull_radius is {hull_radius:.3g}; {name!r} was searched for ways of hulls of at most {most:g} m{fits}"
            )
        return _fitted(frozen, most - hull_radius)
    if not _means_file(name):
        raise _unknown(spec, name)
    cases = _from_file(spec, os.fspath(name))
    fitting, problems = [], []
    for scenario in cases:
        try:
            check_clear(scenario, hull_radius)
            fitting.append(scenario)
        except ValueError as error:
            problems.append(f"{name}: {error}")
    # of the many cases of a public benchmark one may be none for this hull
    if problems and not (fitting and os.path.isdir(name) and is_mrpb(name)):
        raise ValueError(problems[0])
    for problem in problems:
        warnings.warn(
            f"{problem}; it is left out, {len(fitting)} of {len(cases)} cases are driven", FileNote, stacklevel=2
        )
    return _warned_of(tuple(fitting))


def _own(spec: TaskSpec, given: Any) -> tuple[Any, ...] | None:
    """Returns scenarios that were given as such, one or a list; None where a name was.

    Raises:
        ValueError: if one is of another task, or the list is empty.
    """
    scenarios = tuple(given) if isinstance(given, list | tuple) else (given,)
    if not scenarios:
        raise ValueError("scenario is an empty list; it must hold one scenario or more")
    kinds = tuple(each.scenario for each in TASKS.values())
    if not any(isinstance(each, kinds) for each in scenarios):
        return None
    for each in scenarios:
        if not isinstance(each, spec.scenario):
            raise ValueError(f"scenario is a {type(each).__name__}; here it must be a {spec.scenario.__name__}")
    return scenarios


def _from_file(spec: TaskSpec, name: str) -> tuple[Any, ...]:
    """Returns the scenarios of a file or a folder of the user's."""
    if spec.scenario is GoalScenario:
        if os.path.isdir(name) and not _has_suffix(name):
            if is_mrpb(name):
                return mrpb_scenarios(name)
            if os.path.isfile(file := os.path.join(name, MAP)):
                raise of_no_scenario(file, f"{CASES} or {CONFIG} is missing")
            return barn_scenarios(name)
        if name.lower().endswith(_PROBLEMS):
            return scenarios_of_problems(name)
    return (field_scenario_from_file(name, spec),)


# A vector of single environments asks for the same bank once per robot. Files are read anew: the user edits
# them.
@functools.lru_cache
def _named_path_scenarios(task: str, name: str, scale: float) -> tuple[PathScenario, ...]:
    bank = EVERY[task].presets[name]()
    return _scaled(bank, scale)


def _scaled(scenarios: tuple[PathScenario, ...], scale: float) -> tuple[PathScenario, ...]:
    """Returns path scenarios with their positions multiplied; ValueError, naming the scale, if that leaves no path."""
    if scale == 1.0:
        return scenarios
    try:
        return tuple(scenario.scaled(scale) for scenario in scenarios)
    except ValueError as error:
        raise ValueError(f"scale is {scale:g}: {error}") from None


@functools.lru_cache
def _named_field_scenarios(task: str, name: str, hull_radius: float) -> tuple[Any, ...]:
    bank: tuple[Any, ...] = EVERY[task].presets[name](hull_radius)
    for scenario in bank:
        for robot in getattr(scenario, "robots", (scenario,)):
            check_clear(robot, hull_radius)
    return bank


@functools.lru_cache
def _fitted(scenarios: tuple[Any, ...], shrinkage: float) -> tuple[Any, ...]:
    """Returns the scenarios for a hull that is smaller by `shrinkage` (m) than the one that they were made for."""
    return tuple(scenario.fitted(shrinkage) for scenario in scenarios) if shrinkage else scenarios


def _frozen_split(task: TaskSpec, name: Any) -> tuple[Any, ...] | None:
    """Returns the scenarios of a split's name, "family" or "family/split", or of several; None when it names no family.

    Raises:
        ValueError: if the family has no such split, or the split is damaged.
    """
    if isinstance(name, list | tuple):
        parts = [_frozen_split(task, each) for each in name]
        return None if None in parts else tuple(scenario for part in parts for scenario in part or ())
    whole, at, hull = name.partition("@") if isinstance(name, str) else ("", "", "")
    family, slash, part = whole.partition("/")
    if at and _has_suffix(hull):
        return None
    if family not in families(task.name) or _has_suffix(part):
        return None
    if slash and part not in SPLITS:
        near = suggestion(part, SPLITS)
        raise ValueError(f"{family!r} has no split {shown(part)}; the splits are {', '.join(SPLITS)}.{near}")
    return split(task.name, family, f"{part or 'train'}{at}{hull}")


def _means_file(name: Any) -> bool:
    """Returns whether a name that is not registered is meant as a file.

    Raises:
        ValueError: if it is neither text nor a path.
    """
    name = os.fspath(name) if isinstance(name, os.PathLike) else name
    if not isinstance(name, str):
        how = ""
        if isinstance(name, int):
            how = f"; a family's scenario of that number is chosen by reset(options={{'scenario': {name}}})"
        elif isinstance(name, dict):
            how = "; a scene goes into a file: pathlib.Path('scene.json').write_text(json.dumps(scene))"
        elif isinstance(name, list | tuple) and all(isinstance(each, str) for each in name):
            how = "; a list holds names of families alone"
        elif isinstance(name, list | tuple | np.ndarray):
            how = "; points of a path go into a file: numpy.savetxt('path.csv', points, delimiter=',')"
        raise ValueError(f"scenario must be a name or a file, got {shown(name)}{how}")
    meant = _has_suffix(name) or name.lower().endswith(MAP_SUFFIXES) or os.path.isabs(name) or name[:1] in (".", "~")
    if meant and ("\0" in name or (not name.isprintable() and not os.path.exists(name))):
        raise ValueError(f"scenario {shown(name)} is no name of a file")
    return meant or os.path.exists(name)


def _has_suffix(name: str) -> bool:
    return os.path.splitext(name)[1].lower() in _FILE_SUFFIXES


def _unknown(task: TaskSpec, name: str) -> ValueError:
    known = (*task.presets, *families(task.name))
    family, _, part = os.fspath(name).partition("/")
    near = suggestion(family, known).replace("'?", f"/{part}'?") if part in SPLITS else suggestion(name, known)
    if others := [spec for spec in EVERY.values() if family in spec.families or name in spec.presets]:
        ids = dict.fromkeys(env_id for spec in others for env_id in spec.ids.values())
        near = f" It belongs to {', '.join(ids)}."
    return ValueError(
        f"unknown {task.kind} scenario {shown(name)}.{near} The names are {', '.join(known)}; families end in /train, "
        f"/validation or /test if wanted; a file is named by its path and ends in {', '.join(_FILE_SUFFIXES)}."
    )
