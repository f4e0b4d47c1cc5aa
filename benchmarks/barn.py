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
import tempfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import click
import rich.console
import rich.table

from wayfield.benchmarks.cases import DIFF_DRIVE_GOAL_REACHING, Case
from wayfield.benchmarks.contest_report import holding
from wayfield.benchmarks.contests import CONTESTS, TRAINED
from wayfield.benchmarks.entries import by_entry, label, success_interval
from wayfield.benchmarks.parcels import in_order
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.report.drives import Drive, drive_of, write_drives
from wayfield.benchmarks.report.page import Section, write_page
from wayfield.benchmarks.report.worlds import write_worlds
from wayfield.benchmarks.results import TABLE, Row, number, readable, write_rows
from wayfield.benchmarks.run_folder import REPORT, Run, default_folder, staging
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.benchmarks.table import Table
from wayfield.envs.checks import MOST_POINTS, shown
from wayfield.envs.command_line import Names, OneLineErrors, on_cluster, shared_out, words_given
from wayfield.envs.engines import cores
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


def _driven(setting: Setting) -> tuple[Row, Drive]:
    ((row, trajectory),) = episodes(setting)
    seed = setting.case.gains["seed"] if setting.case.policy in TRAINED else ""
    # the scratch file's name is that of its world
    row = row | {"scenario": Path(row["scenario"]).stem, "split": setting.case.split, "agent_seed": str(seed)}
    return row, drive_of(trajectory)


HEADER = ["policy", "gains", "success", "95 % interval", "collision", "timeout", "BARN score", "SPL", "time (s)"]


def barn_table(rows: Sequence[Row], count: int) -> Table:
    """Returns successes and scores of each policy and each set of its gains over `count` worlds."""
    lines = []
    for entry, mine in by_entry(rows).items():
        won = [row for row in mine if number(row, "success") == 1.0]
        ends = success_interval(mine)
        lines.append([
            *entry,
            f"{len(won)}/{len(mine)}",
            f"[{ends[0]:.2f}, {ends[1]:.2f}]" if ends else "",
            *(f"{sum(number(row, name) for row in mine):.0f}" for name in ("collision", "timeout")),
            *(f"{sum(number(row, name) for row in mine) / len(mine):.3f}" for name in ("barn_score", "spl")),
            f"{sum(number(row, 'time') for row in won) / len(won):.1f}" if won else "",
        ])  # fmt: skip
    note = "The challenge's rules, our robot and scan: scores compare with each other, not with the published ones."
    return Table(f"BARN, {count} worlds, p3dx, lagged actuators", HEADER, lines, note)


def told_of(rows: Sequence[Row], table: Table) -> tuple[str, Table]:
    """Returns who gets the best score, as a sentence, and the table."""
    scores = {
        entry: sum(number(row, "barn_score") for row in mine) / len(mine) for entry, mine in by_entry(rows).items()
    }
    ranked = sorted(scores.items(), key=lambda each: -each[1])
    first = by_entry(rows)[ranked[0][0]]
    share, ends = sum(number(row, "success") for row in first) / len(first), success_interval(first)
    best = [label(entry) for entry, score in ranked if score == ranked[0][1]]
    who = f"{best[0]} has the best score" if len(best) == 1 else f"A draw of {', '.join(best)}"
    shown = f" [{100 * ends[0]:.0f}, {100 * ends[1]:.0f}]" if ends else ""
    sentence = f"{table.title}: {who}, {ranked[0][1]:.3f}, with {100 * share:.0f} % success{shown}."
    return sentence, table


@click.command("barn", cls=OneLineErrors)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--policies", type=Names("--policies", CONTEST.policies), help="Only these.  [default: all of goal-obstacles]"
)
@click.option("--first", type=click.IntRange(min=1), help="Only the first worlds.")
@click.option("--out", metavar="DIR", help="Folder of the results.  [default: results/barn, and what differs]")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
@on_cluster
def main(folder: Path, policies: tuple[str, ...] | None, first: int | None, out: str | None, count: int | None) -> None:
    """Drives every policy through the BARN worlds in FOLDER, prints successes and the BARN score, writes a report."""
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
        with shared_out(count or cores()) as engine:
            try:
                driven = list(tracked(in_order(engine, _driven, settings), len(settings), "runs"))
            except ValueError as error:  # a world without a way has no shortest one to compare with
                raise click.UsageError(f"FOLDER {str(folder)!r}: {error}") from None
        rows = [row for row, _ in driven]
        made = barn_table(rows, len(found))
        differing = {"policies": policies, "first": str(first) if first else None}
        command = readable(f"python -m wayfield.benchmarks.barn {words_given()}")
        target, this = default_folder("barn", differing) if out is None else Path(out), Run("barn", command)
        with holding(target, this), staging(target, this) as stage:
            write_rows(stage, rows)
            write_drives(stage, {k: drive for k, (_, drive) in enumerate(driven)})
            write_worlds(stage, settings)
            (stage / TABLE).write_text(made.markdown(), encoding="utf-8")
            write_page(stage / REPORT, "wayfield: BARN", [Section(stage, [made], told_of(rows, made))], command)
    table = rich.table.Table(title=made.title, title_justify="left")
    for header in HEADER:
        table.add_column(header, justify="left" if header in ("policy", "gains") else "right")
    for line in made.rows:
        table.add_row(*line)
    rich.console.Console(width=120).print(table)
    print(f"Report: {target / REPORT}")


if __name__ == "__main__":
    main()
