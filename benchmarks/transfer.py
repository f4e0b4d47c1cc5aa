"""Gains beside each other where they were chosen and where they were not: python -m wayfield.benchmarks.transfer

The default, the tuned and the published gains of a policy, on the validation split that chose the tuned ones, on the
test split, in drawn rooms of other sizes and densities with other hulls, and in the worlds of BARN if their folder is
given. Nothing is tuned here.
"""

import dataclasses
import math
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import rich.console
import rich.table
import scipy.ndimage
from numpy.typing import NDArray

from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, PUBLIC_SPLIT, Contest, Course, Entrants
from wayfield.benchmarks.crossed import exact_interval
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.public_suites import PUBLIC
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.benchmarks.tune import SEARCHED
from wayfield.envs.command_line import SEED, Names, OneLineErrors, on_cluster, shared_out
from wayfield.envs.grids import OccupancyGrid
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import SPLITS
from wayfield.envs.scenarios.mrpb import CASES, COLUMNS, MAP

CONTEST = CONTESTS["goal-obstacles"]
GAINS = ("default", "tuned", "paper")
TUNED_FOR = ROBOTS["p3dx"]
HULLS = tuple(ROBOTS[name] for name in ("turtlebot3", "p3dx", "jackal"))  # discs of 0.1 and 0.25 m, and a rectangle
WIDEST = 0.36  # m, of a disc that has a way in every room
SIDES = (8.0, 20.0)  # m, of a room
SHARES = (0.02, 0.12)  # of its floor, that discs stand on
RADII = (0.15, 0.4)  # m, of those
CELL = 0.05  # m
PAIRS = 4  # of start and goal, in a room
STEPS = 4000  # control periods, the clock in a room: 40 m at a third of the asked speed
LEAST_WAY = 5.0  # m, from start to goal


def room(rng: np.random.Generator) -> tuple[NDArray[np.bool_], list[tuple[float, ...]]]:
    """Returns a walled room of a drawn size, in cells, and the poses (x, y, heading) of PAIRS starts and goals, m.

    There is a way for a disc of WIDEST from each start to its goal.
    """
    while True:
        side = rng.uniform(*SIDES)
        count = math.ceil(side / CELL)
        middles = CELL * (np.arange(count) + 0.5)
        occupied = np.zeros((count, count), np.bool_)
        wanted = rng.uniform(*SHARES) * count * count
        while occupied.sum() < wanted:
            x, y, radius = *rng.uniform(0.0, side, 2), rng.uniform(*RADII)
            occupied |= (middles[None, :] - x) ** 2 + (middles[:, None] - y) ** 2 < radius * radius
        nodes = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
        clear = OccupancyGrid(occupied, CELL).clearances(nodes).reshape(count, count) > WIDEST
        parts, _ = scipy.ndimage.label(clear)
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0
        there = nodes[(parts == sizes.argmax()).ravel()]
        found: list[tuple[float, ...]] = []
        for _ in range(200 if len(there) else 0):
            start, goal = there[rng.integers(len(there), size=2)]
            if math.dist(start, goal) >= LEAST_WAY:
                found.append((*start, rng.uniform(-3.0, 3.0), *goal, rng.uniform(-3.0, 3.0)))
            if len(found) == PAIRS:
                return occupied, found


def write_rooms(folder: Path, count: int, seed: int) -> list[Course]:
    """Writes so many rooms, each as a map of MRPB with its cases; returns a course each."""
    rng = np.random.default_rng(seed)
    courses = []
    for k in range(count):
        occupied, cases = room(rng)
        home = folder / f"room_{k}"
        home.mkdir()
        # row 0 of an image is the highest
        image = np.where(occupied, 0, 254).astype(np.uint8)[::-1]
        header = f"P5 {image.shape[1]} {image.shape[0]} 255\n".encode()
        (home / "map.pgm").write_bytes(header + image.tobytes())
        told = f"image: map.pgm\nresolution: {CELL}\norigin: [0, 0, 0]\nnegate: 0\n"
        (home / MAP).write_text(told + "occupied_thresh: 0.65\nfree_thresh: 0.196\n", encoding="utf-8")
        lines = [",".join(f"{value:.4f}" for value in case) for case in cases]
        (home / CASES).write_text("\n".join([",".join(COLUMNS), *lines, ""]), encoding="utf-8")
        courses.append(Course(home.name, PUBLIC_SPLIT, str(home), STEPS, members=tuple(range(PAIRS))))
    return courses


def places(rooms: Sequence[Course], data: str | None) -> Iterator[tuple[str, Contest, Any, list[Course]]]:
    """Yields where gains are tried: a name, the contest, the robot, and the courses."""
    count = len(CONTEST.families("kinematic"))
    for split in ("validation", "test"):
        members = tuple(range(count * SPLITS[split]))
        yield split, CONTEST, TUNED_FOR, [Course("all", split, members=members)]
    for robot in HULLS:
        yield f"rooms, {robot.name}", CONTEST, robot, list(rooms)
    if data is not None:
        courses = PUBLIC["barn"].courses(data, TUNED_FOR)
        yield "BARN", ALL_CONTESTS[PUBLIC["barn"].modes["p3dx"].contest], TUNED_FOR, list(courses)


def case_of(contest: Contest, robot: Any, course: Course, policy: str, gains: dict[str, Any]) -> Case:
    """Returns the case of a policy with gains that may be another robot's."""
    (case,) = contest.cases(robot, course, Entrants((policy,), ("default",)))
    return dataclasses.replace(case, gains={**case.gains, **gains})


def reached(setting: Setting) -> list[bool]:
    """Returns whether each episode of a setting ended in success."""
    return [row["success"] == "1" for row, _ in episodes(setting)]


@click.command("transfer", cls=OneLineErrors)
@click.option("--policies", "names", type=Names("--policies", SEARCHED), default="vfh_plus,dwa,scan_planner")
@click.option("--rooms", type=click.IntRange(1, 1000), default=16, show_default=True, help="Four ways in each.")
@click.option("--data", type=click.Path(exists=True, file_okay=False), help="The folder of BARN's official worlds.")
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of the rooms.")
@click.option("--workers", "count", type=click.IntRange(min=1), default=1, show_default=True, help="Processes.")
@on_cluster
def main(names: tuple[str, ...], rooms: int, data: str | None, seed: int, count: int) -> None:
    """Prints how often gains reach the goal where they were chosen, and where they were not."""
    entries = [(name, *each) for name in names for each in CONTEST.gain_sets(name, TUNED_FOR, GAINS)]
    with tempfile.TemporaryDirectory() as folder, shared_out(count) as engine:
        tried = list(places(write_rooms(Path(folder), rooms, seed), os.path.abspath(data) if data else None))
        settings = [
            Setting("transfer", case, "kinematic", "lagged", 0, len(course.members), members=course.members)
            for name, _, gains in entries
            for _, contest, robot, courses in tried
            for course in courses
            for case in (case_of(contest, robot, course, name, gains),)
        ]
        done = iter(list(tracked(engine(reached, settings), len(settings), "parts")))
        table = rich.table.Table(
            title=f"Goals reached (%), and the 95 % interval; {rooms} rooms of 8 to 20 m, seed {seed}",
            title_justify="left",
        )
        for header in ("policy", "gains", *(place for place, *_ in tried)):
            named = header in ("policy", "gains")
            table.add_column(header, justify="left" if named else "right", no_wrap=named)
        for name, gains_name, _ in entries:
            cells = []
            for *_, courses in tried:
                found = [each for _ in courses for each in next(done)]
                share = sum(found) / len(found)
                low, high = exact_interval(share, len(found))
                cells.append(f"{100.0 * share:.1f}\n[{100.0 * low:.0f}, {100.0 * high:.0f}]")
            table.add_row(name, gains_name, *cells)
    rich.console.Console(width=100).print(table)


if __name__ == "__main__":
    main()
