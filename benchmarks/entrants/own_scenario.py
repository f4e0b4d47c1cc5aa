"""Scenarios from the user's own files: all that take part in a contest, on a path, to a goal or a dock of a file."""

import contextlib
import dataclasses
import functools
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from wayfield import policies
from wayfield.benchmarks.contests import OF_KIND, OWN_SPLIT, Contest, Course
from wayfield.benchmarks.episodes.shortest import shortest_way
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.run_folder import file_digest
from wayfield.envs.robots import AnyRobot, robot_of, shipped_name
from wayfield.envs.scenarios import scenarios_of
from wayfield.envs.scenarios.files import kind_of
from wayfield.envs.scenarios.maps import map_files
from wayfield.envs.scenarios.tables import TABLE_SUFFIXES
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.policies.parts.policy import check_robot, lacks
from wayfield.system.checks import FINEST
from wayfield.system.objects import json_object
from wayfield.system.readers import reader

POLICIES = {kind: tuple(dict.fromkeys((*contest.policies, "zero", "random"))) for kind, contest in OF_KIND.items()}
SUFFIXES = (*TABLE_SUFFIXES, ".json")

# The clock: slower than the look-ahead law gets on any but the tightest bends, and time to set off and settle.
_SPEED = 0.25  # m/s
_SLACK = 20.0  # s
_CORNER, _TURNING = 0.3, 1.0  # rad, from which on a path has a corner, and rad/s, to stop there, turn and set off
_DETOUR = 3.0  # times the straight way, that obstacles may make of it; times the shortest on a map
_SLIM = 0.1  # m, radius of a hull that gets through where most do
_LONGEST = 10_000.0  # m: several hours of driving, minutes of computing


@dataclasses.dataclass(frozen=True)
class OwnScenario:
    """A path or a goal scenario of a file, with a clock that is long enough."""

    contest: Contest
    file: str  # absolute: a bare name could be that of a preset
    scenario: Any
    steps: int  # control periods, the clock
    scale: float | None  # of a path

    @property
    def env_kwargs(self) -> dict[str, Any]:
        """Returns the options of the environment that are the scenario's."""
        return {} if self.scale is None else {"scale": self.scale}

    @property
    def is_path(self) -> bool:
        """Returns whether it is a path, beside which nothing stands."""
        return self.contest.spec.on_path

    @functools.cached_property
    def tiered(self) -> Any:
        """Returns the scenario with its tier and the quantity behind it."""
        quantity = self.contest.spec.quantity(self.scenario)
        return dataclasses.replace(self.scenario, quantity=quantity, tier=self.contest.spec.tier(quantity))


_SAMPLES = {"a.json": '{"goal": [3, 0, 0.5], "obstacles": [{"kind": "circle", "x": 1.5, "y": 2, "radius": 0.3}]}'}


@reader("scenario of one's own", "a.json", _SAMPLES)
@reader("path of one's own", "b.json", {"b.json": '{"path": [[0, 0], [2, 0], [2, 2]]}'})
def own_scenario(file: str, scale: float | None = None) -> OwnScenario:
    """Returns the scenario of a file.

    Args:
        scale: multiplies the coordinates of a path.

    Raises:
        ValueError: if the file holds no scenario or a very long way, or a goal scenario is scaled.
        OSError: if it cannot be opened.
    """
    file = os.path.abspath(file)
    return _own(file, scale, _digests(file))


def _digests(file: str) -> str:
    """Returns the SHA-256 of a scenario's file, and of its map's; what is wrong with them, their reader will say."""
    files = [file]
    with contextlib.suppress(ValueError):
        if file.lower().endswith(".json") and (map_file := json_object(file).get("map")) is not None:
            files += map_files(file, map_file)
    return " ".join(file_digest(Path(each)) for each in files if os.path.isfile(each))


@functools.lru_cache(maxsize=1024)
def _own(file: str, scale: float | None, digest: str) -> OwnScenario:
    """Returns the scenario of a file with those digests."""
    del digest
    contest = OF_KIND[kind_of(file)]
    spec = contest.spec
    scenario: Any
    if not spec.on_path:
        if scale is not None:
            raise ValueError(f"--scale belongs to paths: the file holds a {spec.kind} scenario")
        (scenario,) = scenarios_of(spec, file, FINEST)
        length, turning, shorter = _DETOUR * _straight_way(scenario), 0.0, ""
        if scenario.grid is not None:
            # a maze can make more of it than obstacles
            with contextlib.suppress(ValueError):
                length = max(length, _DETOUR * shortest_way(scenario, _SLIM))
    else:
        scale = scale or 1.0
        (scenario,) = scenarios_of(spec, file, FINEST, scale)
        length = scenario.length
        laps = length / scenario.path.length
        turning = min(laps * _corners(scenario.path) / _TURNING, length / _SPEED)
        shorter = f" with --scale, {_LONGEST / length * scale:.2g} for example"
    if length > _LONGEST:
        raise ValueError(
            f"{file}: the way is {length:,.0f} m long, which is many hours of driving; make it at most "
            f"{_LONGEST:,.0f} m{shorter}"
        )
    seconds = max(length / _SPEED + turning, *getattr(scenario, "times", ()), 0.0)  # those of a reference are its own
    steps = math.ceil((seconds + _SLACK) / CONTROL_PERIOD)
    return OwnScenario(contest, file, scenario, steps, scale)


def own_cases(
    file: str, scale: float | None = None, names: tuple[str, ...] | None = None, robot: AnyRobot = "p3dx"
) -> tuple[Case, ...]:
    """Returns a case for each policy on the path or in the goal scenario of a file.

    Args:
        scale: as for `own_scenario`.
        names: of the policies; None: all that can do it.
        robot: one that ships, a data sheet, or a `Robot`.

    Raises:
        ValueError: as `own_scenario`, or if a policy or the robot cannot do it.
        OSError: if the file cannot be opened.
    """
    own, robot = own_scenario(file, scale), robot_of(robot)
    kind = own.contest.spec.kind
    for name in names or ():
        if name not in POLICIES[kind]:
            known = ", ".join(map(repr, POLICIES[kind]))
            raise ValueError(f"--policies {name!r} does not {OF_KIND[kind].spec.asks}; choose from {known}")
        check_robot(policies.make(name), robot)
    untrained = own.contest.without_agents(POLICIES[kind], robot)
    for name in names or ():
        if name in untrained:
            raise ValueError(f"--{untrained[name]}")
    if not own.is_path:
        scenarios_of(own.contest.spec, own.file, robot.hull_radius)
    if names is None:
        there = (name for name in POLICIES[kind] if name not in untrained)
        names = tuple(name for name in there if not lacks(policies.make(name), robot))
    return tuple(
        Case(
            kind,
            own.scenario.name,
            own.contest.env_id(robot),
            own.file,
            name,
            env_kwargs={**own.contest.env_kwargs, **own.env_kwargs, "robot": shipped_name(robot)},
            max_episode_steps=own.steps,
            filmed=name in ("lookahead_retuned", "scan_planner"),
        )
        for name in names
    )


def without_way(file: str, robot: AnyRobot = "p3dx") -> str:
    """Returns a line that says that the file's scenario leaves the robot no way to its goal; "" if there is one.

    Of a path, and where the file cannot be read or the robot does not fit, it says nothing: `own_cases` does.
    """
    try:
        own = own_scenario(file)
        if not own.is_path:
            shortest_way(own.scenario, robot_of(robot).hull_radius)
    except ValueError as error:
        return f"{file}: {error}: whoever drives there, nobody arrives"
    return ""


def own_courses(folder: str, scale: float | None, robot: AnyRobot) -> tuple[Contest, tuple[Course, ...]]:
    """Returns the contest that a folder of scenario files is for, and a course for each file, called like it.

    Files of other types than tables and .json are not looked at.

    Raises:
        ValueError: if there are none, or of several kinds, or a file is no scenario that the robot can do.
        OSError: if the folder or a file cannot be opened.
    """
    files = sorted(file for file in Path(folder).iterdir() if file.suffix.lower() in SUFFIXES and file.name[0] != ".")
    if not files:
        raise ValueError(f"{folder!r} holds no scenarios: no {', '.join(SUFFIXES)} file")
    own = [own_scenario(str(file), scale if OF_KIND[kind_of(str(file))].spec.on_path else None) for file in files]
    kinds = {each.contest.spec.kind: file.name for each, file in zip(own, files, strict=True)}
    if len(kinds) > 1:
        mixture = " and ".join(f"a {kind} ({name})" for kind, name in kinds.items())
        raise ValueError(f"{folder!r} holds {mixture}; a contest needs files of one kind")
    stems: dict[str, str] = {}
    for file in files:
        if file.stem in stems:
            raise ValueError(f"{folder!r} holds {stems[file.stem]} and {file.name}; their names must differ")
        stems[file.stem] = file.name
    contest = own[0].contest
    if scale is not None and own[0].scale is None:
        raise ValueError(f"--scale belongs to paths: the files hold {contest.spec.kind} scenarios")
    hull = robot_of(robot).hull_radius
    for each in own if not own[0].is_path else ():
        scenarios_of(contest.spec, each.file, hull)
        try:
            shortest_way(each.scenario, hull)
        except ValueError as error:
            raise ValueError(f"{each.file}: {error}") from None
    return contest, tuple(
        Course(file.stem, OWN_SPLIT, each.file, each.steps, each.env_kwargs)
        for file, each in zip(files, own, strict=True)
    )


def _corners(path: Any) -> float:
    """Returns by how much (rad) a path turns in its corners, all together."""
    points = np.vstack([path.points, path.points[:2]]) if path.closed else path.points
    headings = np.arctan2(*np.diff(points, axis=0).T[::-1])
    turns = np.abs(np.remainder(np.diff(headings) + math.pi, 2.0 * math.pi) - math.pi)
    return float(turns[turns > _CORNER].sum())


def _straight_way(scenario: Any) -> float:
    """Returns the length (m) from the start over the waypoints to the goal, whatever stands there."""
    places = np.vstack([scenario.start[:2], np.reshape(scenario.waypoints, (-1, 2)), scenario.goal[:2]])
    return float(np.hypot(*np.diff(places, axis=0).T).sum())
