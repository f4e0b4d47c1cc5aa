"""Public benchmarks: from the folder of their official files to the contests and the courses that they are run as."""

import dataclasses
import math
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path

from wayfield.benchmarks.contests import ALL_CONTESTS, PUBLIC_SPLIT, Contest, Course
from wayfield.benchmarks.contests.barn import LIMIT
from wayfield.benchmarks.contests.mrpb import TARGET as MRPB_SPEED
from wayfield.benchmarks.contests.racetracks import SCALE
from wayfield.benchmarks.entrants.own_scenario import own_scenario
from wayfield.benchmarks.episodes.shortest import shortest_way
from wayfield.envs.robots import Robot
from wayfield.envs.scenarios import TASKS, goal_scenarios, scenarios_of
from wayfield.envs.scenarios.barn import barn_scenarios
from wayfield.envs.scenarios.mrpb import CASES, CONFIG, MAP, is_mrpb
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.policies.parts.tuned import PACE
from wayfield.system.objects import FileNote

GROUP = 50  # worlds of BARN, by their numbers: a family, and what an interrupted run has as a whole
PROBLEMS = 12  # of each list of MovingAI's
_SETS_OFF = 10.0  # s, in which a robot must have left the first 0.1 m


@dataclasses.dataclass(frozen=True)
class Mode:
    """One way to run a public benchmark."""

    contest: str
    robot: str  # the default
    fixed: bool = False  # whether no other robot can be chosen


@dataclasses.dataclass(frozen=True)
class PublicSuite:
    """A public benchmark: its modes, the first of which is the default, and its courses in a folder for a robot."""

    modes: Mapping[str, Mode]
    courses: Callable[[str, Robot], tuple[Course, ...]]

    def contest(self, mode: str) -> Contest:
        """Returns the contest of a mode."""
        return ALL_CONTESTS[self.modes[mode].contest]


def barn_courses(folder: str, robot: Robot) -> tuple[Course, ...]:
    """Returns the worlds of a folder, fifty numbers a course.

    Raises:
        ValueError: if a file is faulty, or a world has no room for the robot; one line that names it.
        OSError: if a file cannot be opened.
    """
    named = {each.name: k for k, each in enumerate(barn_scenarios(folder))}
    bank = goal_scenarios(folder, robot.hull_radius)
    groups: dict[int, list[int]] = {}
    for name, k in named.items():
        try:
            shortest_way(bank[k], robot.hull_radius)
        except ValueError as error:
            raise ValueError(f"{folder}: {error}") from None
        groups.setdefault(int(name.removeprefix("world_")) // GROUP, []).append(k)
    steps = math.ceil((LIMIT + _SETS_OFF) / CONTROL_PERIOD)
    return tuple(
        Course(f"worlds {GROUP * j} to {GROUP * j + GROUP - 1}", PUBLIC_SPLIT, folder, steps, members=tuple(members))
        for j, members in sorted(groups.items())
    )


def racetrack_courses(folder: str, robot: Robot, scale: float = SCALE) -> tuple[Course, ...]:
    """Returns the circuits of a folder, a course each, made small by the scale; warns of each faulty file.

    Raises:
        ValueError: if there are none, or all are faulty; one line that names the first.
        OSError: if a file cannot be opened.
    """
    del robot
    files = sorted(file for file in Path(folder).iterdir() if file.suffix.lower() == ".csv" and file.name[0] != ".")
    if not files:
        raise ValueError(f"{folder}: holds no circuits: no .csv file")

    def course(file: Path) -> Course:
        own = own_scenario(str(file), scale)
        if not own.scenario.path.closed:
            raise ValueError(f"{file}: is no circuit; its header must be # x_m,y_m,w_tr_right_m,w_tr_left_m")
        return Course(file.stem, PUBLIC_SPLIT, own.file, own.steps, own.env_kwargs)

    return _those_that_can(course, files, "circuits")


def mrpb_courses(folder: str, robot: Robot) -> tuple[Course, ...]:
    """Returns the maps of a folder, a course each with its cases; warns of each case and map that cannot be driven.

    Raises:
        ValueError: if there are none, or none can be driven; one line that names the first.
        OSError: if a file cannot be opened.
    """
    every = (Path(folder), *sorted(Path(folder).iterdir()))
    places = [place for place in every if (place / CASES).is_file() or (place / CONFIG).is_file()]
    if not any(map(is_mrpb, places)):
        raise ValueError(f"{folder}: holds no maps of MRPB: no folder with {MAP} and {CASES} or {CONFIG}")

    def course(place: Path) -> Course:
        if not is_mrpb(place):
            raise ValueError(f"{place}: has no {MAP}; worlds in which others move are not read")
        bank = scenarios_of(TASKS["goal_reaching"], str(place), robot.hull_radius)
        lengths, problems = {}, []
        for k, each in enumerate(bank):
            try:
                lengths[k] = shortest_way(each, robot.hull_radius)
            except ValueError as error:
                problems.append(f"{place}: {each.name}: {error}")
        if not lengths:
            raise ValueError(problems[0])
        for problem in problems:
            warnings.warn(
                f"{problem}; it is left out, {len(lengths)} of {len(bank)} cases are driven", FileNote, stacklevel=2
            )
        clock = _clock(max(lengths.values()), MRPB_SPEED)
        return Course(place.name, PUBLIC_SPLIT, str(place), clock, members=tuple(lengths))

    return _those_that_can(course, places, "maps")


def movingai_courses(folder: str, robot: Robot) -> tuple[Course, ...]:
    """Returns the lists of problems of a folder, a course each with twelve of its problems, evenly by their lengths.

    Warns of each list that is faulty.

    Raises:
        ValueError: if there are none, or all are faulty; one line that names the first.
        OSError: if a file cannot be opened.
    """
    files = sorted(Path(folder).rglob("*.scen"))
    if not files:
        raise ValueError(f"{folder}: holds no problems: no .scen file")
    if len({file.name for file in files}) < len(files):
        raise ValueError(f"{folder}: holds two .scen files of the same name; their names must differ")

    def course(file: Path) -> Course:
        bank = scenarios_of(TASKS["goal_reaching"], str(file), robot.hull_radius)
        lengths = {k: each.published_length for k, each in enumerate(bank) if each.published_length > 0.0}
        order = sorted(lengths, key=lengths.__getitem__)
        if not order:
            raise ValueError(f"{file}: holds no problem with a way to go; the optimal length of each is 0")
        count = min(PROBLEMS, len(order))
        members = tuple(order[(2 * j + 1) * len(order) // (2 * count)] for j in range(count))
        steps = _clock(lengths[members[-1]], PACE)
        return Course(file.stem, PUBLIC_SPLIT, str(file), steps, members=members)

    return _those_that_can(course, files, "lists")


def _those_that_can(course: Callable[[Path], Course], places: list[Path], what: str) -> tuple[Course, ...]:
    """Returns the course of each place and warns of those that have none; ValueError where none has one."""
    courses, problems = [], []
    for place in places:
        try:
            courses.append(course(place))
        except ValueError as error:
            problems.append(str(error))
    if not courses:
        raise ValueError(problems[0])
    for problem in problems:
        warnings.warn(
            f"{problem}; it is left out, {len(courses)} of {len(places)} {what} are driven", FileNote, stacklevel=3
        )
    return tuple(courses)


def _clock(length: float, speed: float) -> int:
    """Returns the control periods for a way of that length (m) at half the speed, and some to set off and settle."""
    return math.ceil((2.0 * length / speed + 20.0) / CONTROL_PERIOD)


PUBLIC: Mapping[str, PublicSuite] = {
    "barn": PublicSuite(
        {"challenge": Mode("barn", "jackal", fixed=True), "p3dx": Mode("barn-p3dx", "p3dx", fixed=True)}, barn_courses
    ),
    "mrpb": PublicSuite({"cases": Mode("mrpb", "p3dx")}, mrpb_courses),
    "movingai": PublicSuite({"problems": Mode("movingai", "p3dx")}, movingai_courses),
    "racetracks": PublicSuite({"laps": Mode("racetracks", "p3dx")}, racetrack_courses),
}
