"""Gains beside each other where they were chosen and where they were not: python benchmarks/studies/transfer.py

The default, the tuned and the published gains of every policy with a tuned set, for each robot that one was tuned for:
on the validation split that chose the tuned ones, on the test split, in drawn rooms of other sizes and densities, with
other hulls where the set is the P3DX's, and in the worlds of BARN if their folder is given. Nothing is tuned here.
"""

import contextlib
import dataclasses
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import rich.console

from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, FOUND, Course
from wayfield.benchmarks.entrants.public_suites import PUBLIC
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.progress import tracked
from wayfield.benchmarks.records.results import TABLE, write_rows
from wayfield.benchmarks.records.run_folder import Run, held, staging
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.runs.shards import described
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.crossed import exact_interval
from wayfield.benchmarks.tuning.random_scenes import OTHER_HULLS, PAIRS, SEEDS, Place, in_rooms, write_rooms
from wayfield.benchmarks.tuning.tune import SEARCHED
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.scenarios import SPLITS
from wayfield.system.command_line import SEED, Names, OneLineErrors, on_cluster, shared_out

CONTEST = CONTESTS["goal-obstacles"]
GAINS = ("default", "tuned", "paper")
TUNED_FOR = tuple(ROBOTS[name] for name in ("p3dx", "omni3", "omni4"))
SUITE = "transfer"
TRANSFER = "transfer.csv"
BUDGET = "learned from"
_BUDGET = 3  # its place among the columns
PLACES = ("validation", "test", "rooms", *(f"rooms, {robot.name}" for robot in OTHER_HULLS["p3dx"]), "BARN")


@dataclasses.dataclass(frozen=True)
class Entry:
    """A set of gains of a policy, and the robot that it is shown for."""

    robot: Robot
    policy: str
    gains_name: str
    gains: Mapping[str, Any]


def entries(names: Sequence[str] | None) -> Iterator[Entry]:
    """Yields the sets of gains of the policies that have a tuned one, of the named ones or all, by robot."""
    for robot in TUNED_FOR:
        for name in CONTEST.policies:
            if name not in SEARCHED or (names is not None and name not in names):
                continue
            sets = list(CONTEST.gain_sets(name, robot, GAINS))
            if any(gains_name in FOUND for gains_name, _ in sets):
                yield from (Entry(robot, name, *each) for each in sets)


def places(robot: Robot, rooms: Sequence[Course], data: str | None) -> Iterator[Place]:
    """Yields where gains that were tuned for a robot are tried."""
    count = len(CONTEST.families("kinematic"))
    for split in ("validation", "test"):
        members = tuple(range(count * SPLITS[split]))
        yield Place(split, CONTEST, robot, [Course("all", split, members=members)])
    yield from in_rooms(CONTEST, robot, rooms)
    if data is not None:
        courses = PUBLIC["barn"].courses(data, robot)
        yield Place("BARN", ALL_CONTESTS[PUBLIC["barn"].modes["p3dx"].contest], robot, courses)


def tried(asked: tuple[Entry, Place, Course]) -> list[Row]:
    """Returns a row for each episode of an entry on a course."""
    entry, place, course = asked
    case = place.case(course, entry.policy, entry.gains)
    case = dataclasses.replace(case, gains_name=entry.gains_name)
    setting = Setting(SUITE, case, "kinematic", "lagged", 0, len(course.members), members=course.members)
    of_sets = {"robot": entry.robot.name, "policy": entry.policy, "gains_name": entry.gains_name}
    learned = described(CONTEST, dataclasses.replace(case, env_kwargs={"robot": entry.robot.name}))["learned_from"]
    return [
        {
            **of_sets,
            "learned_from": learned,
            "place": place.name,
            "scenario": f"{place.name}, {course.family}" if course.file else row["scenario"],
            "episode": member,
            "success": row["success"],
        }
        for member, (row, _) in zip(course.members, episodes(setting), strict=True)
    ]


def transfer_table(rows: Sequence[Row], command: str) -> Table:
    """Returns how often each set of gains reaches the goal in each place, from the rows of all."""
    rows = Episodes.of(rows)
    places = rows.groups("place")
    there = [place for place in PLACES if place in places]
    lines = []
    for key, found in rows.groups("robot", "policy", "gains_name", "learned_from").items():
        reached = {place: group["success"] == 1.0 for place, group in found.groups("place").items()}
        lines.append([*key, *(_cell(reached.get(place, ())) for place in there)])
    worlds = len(places["rooms"].unique("scenario")) if "rooms" in places else 0
    note = (
        "Goals reached in per cent; brackets: Clopper and Pearson's 95 % interval. Chosen on validation, and since the "
        "search has rooms too, in those of other seeds; nothing was chosen or tuned in the other places. Rooms: "
        f"{worlds} of 8 to 20 m with discs on 2 to 12 % of their floor, "
        f"{PAIRS} ways in each, with the robot's own hull or that of another, which then drives with the P3DX's gains. "
        f"BARN: its worlds with the robot and the scan of goal reaching. Made by `{command}`."
    )
    return Table(
        "Gains where they were chosen, and where they were not",
        ["robot", "policy", "gains", BUDGET, *there],
        lines,
        note,
    )


def _cell(reached: Sequence[bool]) -> str:
    if not len(reached):
        return ""
    share = int(sum(reached)) / len(reached)
    low, high = exact_interval(share, len(reached))
    return f"{100.0 * share:.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


@click.command("transfer", cls=OneLineErrors)
@click.option("--policies", "names", type=Names("--policies", SEARCHED), help="Comma-separated.  [default: all tuned]")
@click.option("--rooms", type=click.IntRange(1, 1000), default=16, show_default=True, help="Four ways in each.")
@click.option("--data", type=click.Path(exists=True, file_okay=False), help="The folder of BARN's official worlds.")
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of the rooms.")
@click.option("--out", metavar="DIR", help="Also write the table there, and the episodes.")
@click.option("--workers", "count", type=click.IntRange(min=1), default=1, show_default=True, help="Processes.")
@on_cluster
def main(names: tuple[str, ...] | None, rooms: int, data: str | None, seed: int, out: str | None, count: int) -> None:
    """Prints how often gains reach the goal where they were chosen, and where they were not."""
    sets = list(entries(names))
    if not sets:
        raise click.UsageError(f"--policies {','.join(names or ())}: nothing was tuned for them in goal reaching")
    if seed in SEEDS.values():
        raise click.UsageError(f"--seed {seed}: gains were chosen in the rooms of that seed; take another")
    # where the worlds lie on this machine is not what was run
    told = {"policies": ",".join(names or ()), "rooms": rooms if rooms != 16 else "", "data": data and "BARN"}
    words = [f"--{name} {value}" for name, value in {**told, "seed": seed or ""}.items() if value]
    command = " ".join(["python benchmarks/studies/transfer.py", *words])
    run = Run(SUITE, command, (TRANSFER,))
    with contextlib.ExitStack() as held_open:
        try:
            if out is not None:
                held_open.enter_context(held(Path(out), run))
            folder = held_open.enter_context(tempfile.TemporaryDirectory())
            executor = held_open.enter_context(shared_out(count))
            found = write_rooms(Path(folder), rooms, seed)
            of_robot = {
                robot: list(places(robot, found, os.path.abspath(data) if data else None)) for robot in TUNED_FOR
            }
            wanted = [
                (entry, place, course) for entry in sets for place in of_robot[entry.robot] for course in place.courses
            ]
            rows = [row for part in tracked(executor(tried, wanted), len(wanted), "parts") for row in part]
            table = transfer_table(rows, command)
            if out is not None:
                with staging(Path(out), run) as stage:
                    write_rows(stage, rows)
                    (stage / TRANSFER).write_text(table.csv(), encoding="utf-8")
                    (stage / TABLE).write_text(table.markdown(), encoding="utf-8")
        except (OSError, ValueError) as error:
            raise click.ClickException(str(error)) from None
    # the budget stands in the files: a terminal has no room for it
    lines = [[*line[:_BUDGET], *line[_BUDGET + 1 :]] for line in table.rows]
    narrow = dataclasses.replace(table, header=[each for each in table.header if each != BUDGET], rows=lines)
    rich.console.Console(width=100).print(narrow.terminal(stacked=True))
    print(table.note)


if __name__ == "__main__":
    main()
