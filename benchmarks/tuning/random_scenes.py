"""Drawn rooms, in which gains are searched, chosen and tried: other sizes and densities than a split has, other hulls.

Rooms of the search, of the choice and of the table of gains elsewhere have seeds of their own: nothing is chosen in
those of the table.
"""

import dataclasses
import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from wayfield.benchmarks.contests import PUBLIC_SPLIT, Contest, Course, Entrants
from wayfield.benchmarks.records.cases import Case
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.scenarios.mrpb import CASES, COLUMNS, MAP
from wayfield.envs.world.grids import OccupancyGrid

# whose gains other hulls drive with, too: a disc of 0.1 m, and a rectangle
OTHER_HULLS: Mapping[str, tuple[Robot, ...]] = {"p3dx": tuple(ROBOTS[name] for name in ("turtlebot3", "jackal"))}
WIDEST = 0.36  # m, of a disc that has a way in every room
SIDES = (8.0, 20.0)  # m, of a room
SHARES = (0.02, 0.12)  # of its floor, that discs stand on
SEARCHED_SHARES = (0.02, 0.16)  # of that, where gains are searched and chosen
RADII = (0.15, 0.4)  # m, of those
CELL = 0.05  # m
PAIRS = 4  # of start and goal, in a room
STEPS = 4000  # control periods, the clock in a room: 40 m at a third of the requested speed
SEARCHED_STEPS = 2400  # of that, where gains are searched and chosen: most arrivals need less than half
LEAST_WAY = 5.0  # m, from start to goal
SEEDS: Mapping[str, int] = {"train": 4000, "validation": 5000}  # of the rooms in which gains are searched and chosen


@dataclasses.dataclass(frozen=True)
class Place:
    """Where gains are tried."""

    name: str
    contest: Contest
    robot: Robot  # that drives there
    courses: Sequence[Course]
    level: str = "none"  # of disturbance

    def case(self, course: Course, policy: str, gains: Mapping[str, Any]) -> Case:
        """Returns the case of a policy on a course with gains, which may be another robot's."""
        (case,) = self.contest.cases(self.robot, course, Entrants((policy,), ("default",)), self.level)
        return dataclasses.replace(case, gains={**case.gains, **gains})


def room(rng: np.random.Generator, shares: tuple[float, float] = SHARES) -> tuple[NDArray[np.bool_], list[Any]]:
    """Returns a walled room of a drawn size, in cells, and the poses (x, y, heading) of PAIRS starts and goals, m.

    There is a way for a disc of WIDEST from each start to its goal.

    Args:
        shares: of the floor that discs stand on, between which it is drawn.
    """
    while True:
        side = rng.uniform(*SIDES)
        count = math.ceil(side / CELL)
        middles = CELL * (np.arange(count) + 0.5)
        occupied = np.zeros((count, count), np.bool_)
        wanted = rng.uniform(*shares) * count * count
        while occupied.sum() < wanted:
            x, y, radius = *rng.uniform(0.0, side, 2), rng.uniform(*RADII)
            occupied |= (middles[None, :] - x) ** 2 + (middles[:, None] - y) ** 2 < radius * radius
        nodes = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
        clear = OccupancyGrid(occupied, CELL).clearances(nodes).reshape(count, count) > WIDEST
        parts, _ = scipy.ndimage.label(clear)
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0
        there = nodes[(parts == sizes.argmax()).ravel()]
        pairs: list[tuple[float, ...]] = []
        for _ in range(200 if len(there) else 0):
            start, goal = there[rng.integers(len(there), size=2)]
            if math.dist(start, goal) >= LEAST_WAY:
                pairs.append((*start, rng.uniform(-3.0, 3.0), *goal, rng.uniform(-3.0, 3.0)))
            if len(pairs) == PAIRS:
                return occupied, pairs


def write_rooms(
    folder: Path,
    count: int,
    seed: int,
    shares: tuple[float, float] = SHARES,
    steps: int = STEPS,
    size: float = 1.0,
    seen: Mapping[str, Any] | None = None,
) -> list[Course]:
    """Writes so many rooms, each as a map of MRPB with its cases; returns a course each, with that clock.

    Args:
        size: multiplies all lengths, and the clock.
        seen: keyword arguments of the environments there.
    """
    rng = np.random.default_rng(seed)
    courses = []
    for k in range(count):
        occupied, cases = room(rng, shares)
        home = folder / f"room_{k}"
        home.mkdir(parents=True)
        # row 0 of an image is the highest
        image = np.where(occupied, 0, 254).astype(np.uint8)[::-1]
        header = f"P5 {image.shape[1]} {image.shape[0]} 255\n".encode()
        (home / "map.pgm").write_bytes(header + image.tobytes())
        text = f"image: map.pgm\nresolution: {CELL * size}\norigin: [0, 0, 0]\nnegate: 0\n"
        (home / MAP).write_text(text + "occupied_thresh: 0.65\nfree_thresh: 0.196\n", encoding="utf-8")
        places = np.array(cases) * [size, size, 1.0, size, size, 1.0]
        lines = [",".join(f"{value:.4f}" for value in case) for case in places.tolist()]
        (home / CASES).write_text("\n".join([",".join(COLUMNS), *lines, ""]), encoding="utf-8")
        clock = round(size * steps)
        courses.append(Course(home.name, PUBLIC_SPLIT, str(home), clock, seen or {}, tuple(range(PAIRS))))
    return courses


def searched_rooms(
    folder: Path, split: str, count: int, size: float = 1.0, seen: Mapping[str, Any] | None = None
) -> list[Course]:
    """Writes so many rooms of those in which gains are searched, or chosen: see `write_rooms`."""
    return write_rooms(folder / split, count, SEEDS[split], SEARCHED_SHARES, SEARCHED_STEPS, size, seen)


def in_rooms(contest: Contest, robot: Robot, rooms: Sequence[Course], level: str = "none") -> Iterator[Place]:
    """Yields the places where gains of a robot are tried in rooms: with its own hull, and with those of others."""
    yield Place("rooms", contest, robot, rooms, level)
    for other in OTHER_HULLS.get(robot.name, ()) if ROBOTS.get(robot.name) == robot else ():
        yield Place(f"rooms, {other.name}", contest, other, rooms, level)


def digest(rooms: Sequence[Course]) -> str:
    """Returns the SHA-256 of the files of rooms."""
    sha = hashlib.sha256()
    for course in rooms:
        for file in sorted(Path(course.file).iterdir()):
            sha.update(file.read_bytes())
    return sha.hexdigest()
