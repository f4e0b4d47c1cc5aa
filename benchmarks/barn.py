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
from pathlib import Path

import click
import rich.console
import rich.table

from wayfield.benchmarks.cases import DIFF_DRIVE_GOAL_REACHING, Case
from wayfield.benchmarks.command_line import Names, OneLineErrors
from wayfield.benchmarks.contest_tables import success_interval
from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.results import Row, number
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.benchmarks.workers import workers

CYLINDERS = "cylinders.csv.gz"
START = (-2.25, 3.0, math.pi / 2)  # x, y (m), heading (rad)
GOAL = (-2.25, 13.0, math.pi / 2)
TOLERANCE = 1.0  # m
CLOCK = 2000  # control periods, 100 s
CONTEST = CONTESTS["goal-obstacles"]


def worlds(folder: Path) -> dict[int, list[dict[str, float | str]]]:
    """Returns the obstacles of each world, as scenario files name them.

    Raises:
        ValueError: if the file is no such table; the message names the line.
        OSError: if it cannot be opened.
    """
    found: dict[int, list[dict[str, float | str]]] = {}
    file = folder / CYLINDERS
    try:
        with gzip.open(file, "rt", newline="", encoding="utf-8") as lines:
            for place, row in enumerate(csv.DictReader(lines), 2):
                try:
                    circle: dict[str, float | str] = {
                        "kind": "circle",
                        **{name: float(row[f"{name}_m"]) for name in ("x", "y", "radius")},
                    }
                    found.setdefault(int(row["world"]), []).append(circle)
                except (KeyError, TypeError, ValueError):
                    raise ValueError(f"{file}:{place}: {row} lacks a number world, x_m, y_m or radius_m") from None
    except (gzip.BadGzipFile, EOFError, UnicodeDecodeError) as error:
        raise ValueError(f"{file} is no gzipped table: {error}") from None
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
            )
            found.append(Setting("barn", case, "kinematic", actuators, 0, 1))
    return found


def _row(setting: Setting) -> Row:
    ((row, _),) = episodes(setting)
    return row


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
            settings += settings_of(world, str(file), policies or CONTEST.policies, "lagged")
        with workers(count or min(os.cpu_count() or 1, 4)) as share:
            try:
                rows = list(tracked(share(_row, settings), len(settings), "runs"))
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
        low, high = success_interval(mine)
        table.add_row(
            *entry,
            f"{len(won)}/{len(mine)}",
            f"[{low:.2f}, {high:.2f}]",
            *(f"{sum(number(row, name) for row in mine):.0f}" for name in ("collision", "timeout")),
            *(f"{sum(number(row, name) for row in mine) / len(mine):.3f}" for name in ("barn_score", "spl")),
            f"{sum(number(row, 'time') for row in won) / len(won):.1f}" if won else "",
        )
    rich.console.Console(width=120).print(table)


if __name__ == "__main__":
    main()
