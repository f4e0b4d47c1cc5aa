"""Policies in the worlds of the BARN challenge: python -m wayfield.benchmarks.barn FOLDER

The folder holds `cylinders.csv.gz` with the columns world, x_m, y_m, radius_m. The rules are the challenge's: from
(-2.25, 3) facing +y to within 1 m of the point 10 m ahead, any contact fails, and so does the clock after 100 s. The
robot is a P3DX (a disc of 0.25 m) with the scan of the goal-obstacles contest, not the challenge's Jackal: scores
compare with each other, not with the published ones. Nothing is trained or tuned on these worlds.

Source: Perille, Truong, Xiao and Stone, Benchmarking metric ground navigation, SSRR 2020.
"""

import csv
import gzip
import json
import math
import os
import tempfile
import zlib
from pathlib import Path

import click
import rich.console
import rich.table

from wayfield.benchmarks.cases import DIFF_DRIVE_GOAL_REACHING, Case
from wayfield.benchmarks.contests import CONTESTS, TRAINED
from wayfield.benchmarks.entries import success_interval
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.results import Row, number
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.benchmarks.workers import workers
from wayfield.envs.checks import MOST_POINTS, shown
from wayfield.envs.command_line import Names, OneLineErrors
from wayfield.envs.readers import of_folder, reader
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import circle, goal_scenarios

CYLINDERS = "cylinders.csv.gz"
START = (-2.25, 3.0, math.pi / 2)  # x, y (m), heading (rad)
GOAL = (-2.25, 13.0, math.pi / 2)
TOLERANCE = 1.0  # m
CLOCK = 2000  # control periods, 100 s
CONTEST = CONTESTS["goal-obstacles"]
_NUMBERS = ("x", "y", "radius")


def _sample_worlds(folder: Path) -> None:
    rows = ["world,x_m,y_m,radius_m", "0,-2,8,0.1", "0,-3,7,0.1", "1,-2.5,8,0.1"]
    (folder / CYLINDERS).write_bytes(gzip.compress("\n".join(rows).encode()))


@reader("BARN worlds", CYLINDERS, _sample_worlds, of_folder)
def worlds(folder: Path) -> dict[int, list[dict[str, float | str]]]:
    """Returns the obstacles of each world, as scenario files name them.

    Raises:
        ValueError: if the file is no such table; the message names the line.
        OSError: if it cannot be opened.
    """
    found: dict[int, list[dict[str, float | str]]] = {}
    file = folder / CYLINDERS
    place = 0  # the last line that was read whole
    try:
        with gzip.open(file, "rt", newline="", encoding="utf-8") as lines:
            for place, row in enumerate(csv.DictReader(lines, strict=True), 2):
                if place > MOST_POINTS:
                    raise ValueError(f"{file} has more than {MOST_POINTS} lines, which no set of worlds has")
                try:
                    world, numbers = int(row["world"]), {name: float(row[f"{name}_m"]) for name in _NUMBERS}
                except (KeyError, TypeError, ValueError):
                    raise ValueError(
                        f"{file}:{place}: {shown(row)} lacks a number world, x_m, y_m or radius_m"
                    ) from None
                try:
                    circle(**numbers)
                except ValueError as error:
                    raise ValueError(f"{file}:{place}: {error}") from None
                found.setdefault(world, []).append({"kind": "circle", **numbers})
    except csv.Error as error:
        raise ValueError(f"{file}:{place + 1}: {error}") from None
    except (gzip.BadGzipFile, zlib.error, EOFError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}:{place + 1}: it is no gzipped table: {error}") from None
    if not found:
        raise ValueError(f"{file} holds no cylinders")
    return found


def settings_of(world: int, file: str, names: tuple[str, ...], actuators: str) -> list[Setting]:
    """Returns a setting for each policy and each set of its gains in one world."""
    found = []
    for name in names:
        for gains_name, gains in CONTEST.gain_sets(name, "p3dx", ("default", "tuned")):
            case = Case(
                "barn",
                "worlds",
                DIFF_DRIVE_GOAL_REACHING,
                file,
                name,
                gains,
                {"robot": "p3dx", **CONTEST.env_kwargs},
                CLOCK,
                gains_name=gains_name,
                every_scenario=True,
                split="worlds",
            )
            found.append(Setting("barn", case, "kinematic", actuators, world, 1))
    return found


def _row(setting: Setting) -> Row:
    ((row, _),) = episodes(setting)
    seed = setting.case.gains["seed"] if setting.case.policy in TRAINED else ""
    return row | {"split": setting.case.split, "agent_seed": str(seed)}


@click.command("barn", cls=OneLineErrors)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--policies", type=Names("--policies", CONTEST.policies), help="Only these.  [default: all of goal-obstacles]"
)
@click.option("--first", type=click.IntRange(min=1), help="Only the first worlds.")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
def main(folder: Path, policies: tuple[str, ...] | None, first: int | None, count: int | None) -> None:
    """Drives every policy through the BARN worlds in FOLDER and prints successes and the BARN score."""
    try:
        found = dict(list(worlds(folder).items())[:first])
    except OSError as error:
        raise click.UsageError(f"FOLDER {str(folder)!r} cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    with tempfile.TemporaryDirectory() as scratch:
        settings = []
        for world, obstacles in found.items():
            file = Path(scratch) / f"world_{world}.json"
            content = {
                "start": START,
                "goal": GOAL,
                "obstacles": obstacles,
                "position_tolerance": TOLERANCE,
                "heading_tolerance": math.pi,
            }
            file.write_text(json.dumps(content), encoding="utf-8")
            try:
                goal_scenarios(str(file), ROBOTS["p3dx"].hull_radius)
            except ValueError as error:
                # the scratch file is gone when this is read: the table is what can be looked at
                fault = str(error).removeprefix(f"{file}: ")
                raise click.UsageError(f"{folder / CYLINDERS}: world {world}: {fault}") from None
            settings += settings_of(world, str(file), policies or CONTEST.policies, "lagged")
        with workers(count or min(os.cpu_count() or 1, 4)) as in_parallel:
            try:
                rows = list(tracked(in_parallel(_row, settings), len(settings), "runs"))
            except ValueError as error:  # a world without a way has no shortest one to compare with
                raise click.UsageError(f"FOLDER {str(folder)!r}: {error}") from None
    table = rich.table.Table(title=f"BARN, {len(found)} worlds, p3dx, lagged actuators", title_justify="left")
    for header in (
        "policy",
        "gains",
        "success",
        "95 % interval",
        "collision",
        "timeout",
        "BARN score",
        "SPL",
        "time (s)",
    ):
        table.add_column(header, justify="left" if header in ("policy", "gains") else "right")
    for entry in dict.fromkeys((row["policy"], row["gains_name"]) for row in rows):
        mine = [row for row in rows if (row["policy"], row["gains_name"]) == entry]
        won = [row for row in mine if number(row, "success") == 1.0]
        ends = success_interval(mine)
        table.add_row(
            *entry,
            f"{len(won)}/{len(mine)}",
            f"[{ends[0]:.2f}, {ends[1]:.2f}]" if ends else "",
            *(f"{sum(number(row, name) for row in mine):.0f}" for name in ("collision", "timeout")),
            *(f"{sum(number(row, name) for row in mine) / len(mine):.3f}" for name in ("barn_score", "spl")),
            f"{sum(number(row, 'time') for row in won) / len(won):.1f}" if won else "",
        )
    rich.console.Console(width=120).print(table)


if __name__ == "__main__":
    main()
