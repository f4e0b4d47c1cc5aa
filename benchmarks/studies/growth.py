"""Steps per second as robots, obstacles, maps, beams, teams and threads grow: python benchmarks/studies/growth.py

Writes docs/growth.csv and draws docs/growth.png from it; with --drawn the figure alone. The sizes take turns,
round after round, so that a machine that slows down slows all of them; the median of the rounds counts.
"""

import io
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numba
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator, NullLocator
from part_rows import read, write
from throughput import NUM_SCANNING, Contender, building, discs, measured, spread, vector_steps

from wayfield.benchmarks.figures.drawing import PALETTE, RC
from wayfield.benchmarks.records.cases import GOAL_REACHING, PATH_FOLLOWING
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

DOCS = Path(__file__).parents[2] / "docs"
FIELDS = ("grows", "environment", "size", "robots", "steps_per_second")
TEAM = "wayfield/DiffDriveTeam-v0"
PANELS = {  # what grows, and the environments that it grows in
    "robots": ("path following", "goal reaching, 32 beams"),
    "obstacles": ("goal reaching, 72 beams",),
    "map cells": ("goal reaching, 72 beams",),
    "beams": ("goal reaching among 12 discs",),
    "robots of a team": ("teams, 32 beams",),
    "threads": ("path following", "goal reaching, 720 beams"),
}
SIZES: Mapping[str, Sequence[int]] = {
    "robots": [4**k for k in range(8)],
    "obstacles": [4**k for k in range(7)],
    "map cells": [100**2, 300**2, 1000**2, 2000**2],
    "beams": [8, 32, 72, 180, 360, 720, 1440],
    "robots of a team": [1, 2, 4, 8, 16, 32, 64, 128, 256],
    "threads": [1, 2],
}


def contenders(folder: Path) -> Iterator[tuple[str, str, int, Contender]]:
    """Yields what grows, the environment, the size and what is timed, which has begun."""
    rng = np.random.default_rng(0)
    goal: dict[str, Any] = {"scenario": "discs", "num_beams": 32}

    def made(panel: str, k: int, size: int, robots: int, env_id: str, **kwargs: Any) -> tuple[str, str, int, Contender]:
        steps = vector_steps(env_id, robots, **kwargs)
        steps()
        return panel, PANELS[panel][k], size, Contender(f"{panel} {size}", robots, steps)

    def written(name: str, scenario: Mapping[str, Any]) -> str:
        file = folder / f"{name}.json"
        file.write_text(json.dumps(scenario), encoding="utf-8")
        return str(file)

    for n in SIZES["robots"]:
        yield made("robots", 0, n, n, PATH_FOLLOWING)
        yield made("robots", 1, n, n, GOAL_REACHING, **goal)
    scan: dict[str, Any] = {"num_beams": 72, "max_range": 5.0}
    for n in SIZES["obstacles"]:
        file = written(f"discs{n}", discs(n, rng))
        yield made("obstacles", 0, n, NUM_SCANNING, GOAL_REACHING, scenario=file, **scan)
    rooms = building(rng)
    for n in SIZES["map cells"]:
        half = round(n**0.5) // 2
        np.save(folder / f"{n}.npy", rooms[1000 - half : 1000 + half, 1000 - half : 1000 + half])
        map_file = {"file": f"{n}.npy", "resolution": 0.1, "origin": [-0.1 * half, -0.1 * half, 0]}
        file = written(f"map{n}", {"start": [0, 0, 0], "goal": [3, 0, 0], "map": map_file})
        yield made("map cells", 0, n, NUM_SCANNING, GOAL_REACHING, scenario=file, **scan)
    for n in SIZES["beams"]:
        yield made("beams", 0, n, NUM_SCANNING, GOAL_REACHING, scenario="discs", num_beams=n)
    for n in SIZES["robots of a team"]:
        yield made("robots of a team", 0, n, 1024, TEAM, scenario=spread(n), num_beams=32)
    for n in SIZES["threads"]:
        yield made("threads", 0, n, 4096, PATH_FOLLOWING, num_threads=n)
        yield made("threads", 1, n, 4096, GOAL_REACHING, **goal | {"num_beams": 720}, num_threads=n)


def figure(rows: Sequence[Mapping[str, str]]) -> bytes:
    """Returns the figure as PNG: a panel for each thing that grows."""
    with rc_context(RC):
        drawn = Figure((12.0, 6.8), layout="constrained")
        for axes, (panel, names) in zip(drawn.subplots(2, 3).flat, PANELS.items(), strict=True):
            for k, name in enumerate(names):
                mine = [row for row in rows if (row["grows"], row["environment"]) == (panel, name)]
                sizes, rates = ([float(row[key]) for row in mine] for key in ("size", "steps_per_second"))
                axes.plot(sizes, rates, "os"[k] + "-", color=PALETTE[k], label=name)
            axes.set(xscale="log", yscale="log", xlabel=panel, title=f"{panel[0].upper()}{panel[1:]}")
            axes.set_ylim(1e4, 3e7)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(LogLocator())
                axis.set_minor_locator(NullLocator())
                axis.set_major_formatter(EngFormatter(sep=" "))
            if panel == "threads":
                axes.set_xticks(SIZES[panel], SIZES[panel])
            axes.legend(fontsize=10, loc="upper left")
        drawn.supylabel("robot steps a second")
        file = io.BytesIO()
        drawn.savefig(file, format="png", dpi=100)
    return file.getvalue()


@click.command("growth", cls=OneLineErrors)
@click.option("--rounds", type=click.IntRange(min=1), default=5, show_default=True, help="Turns of each size.")
@click.option("--seconds", type=float, default=0.2, show_default=True, help="Of a turn.")
@click.option("--drawn", is_flag=True, help="Draws what the table has.")
def main(rounds: int, seconds: float, drawn: bool) -> None:
    """Measures how fast steps are as worlds grow, and draws it."""
    table = DOCS / "growth.csv"
    if not drawn:
        numba.set_num_threads(1)
        with tempfile.TemporaryDirectory() as folder:
            chosen = list(contenders(Path(folder)))
        rates = measured([each for *_, each in chosen], rounds, seconds)
        lines = [
            dict(zip(FIELDS, (panel, name, size, each.robots, f"{rate:.4g}"), strict=True))
            for (panel, name, size, each), (_, rate) in zip(chosen, rates, strict=True)
        ]
        write(table, FIELDS, lines)
    write_whole(DOCS / "growth.png", figure(read(table)))


if __name__ == "__main__":
    main()
