"""Does training with a base's imperfections help in another engine? python benchmarks/studies/domain.py

A path follower is trained on the kinematic plant, on the data sheet as it is, on the sheet that was identified of the
base in MuJoCo, or with slip, wheel errors and delays drawn; then it drives the test paths on both plants. Rows are kept
as physics_domain.csv, a part that is there is not made again, and physics.py makes the page of them.
"""

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch
from learning import score
from part_rows import drive_missing, read
from sim_to_sim import CHAIN

from wayfield.envs.robots import ROBOTS, Robot
from wayfield.policies.training.learner import PpoLearner
from wayfield.policies.training.presets import PRESETS, Preset
from wayfield.system.command_line import OneLineErrors

DOMAIN = Path("docs/results/physics_domain.csv")
FIELDS = ("training", "seed", "plant", "success", "error", "speed")
PLAIN = PRESETS["path_following_plain"]
BASE, PLANTS, SEEDS = "p3dx", ("kinematic", "mujoco"), 3
STEPS = 2_000_000
_TIER = {"scenario": "all/train", "actuators": "lagged"}
_SHORT = {"max_episode_steps": 100}


def identified() -> Robot:
    """Returns the base as `wayfield identify` found it from its log in MuJoCo."""
    text = next(row["found"] for row in read(CHAIN) if (row["robot"], row["sheet"]) == (BASE, "identified"))
    cells = dict(cell.split("=") for cell in text.split(";"))
    fits = {name: tuple(float(each) for each in cell.split()) for name, cell in cells.items()}
    track = fits["track"][0]
    base = ROBOTS[BASE]
    wheels = [dataclasses.replace(each, y=float(np.copysign(0.5 * track, each.y))) for each in base.wheels]
    return dataclasses.replace(base, name="identified", wheels=tuple(wheels), gain=fits["gain"], lag=fits["lag"])


def trainings() -> Mapping[str, Sequence[tuple[float, Mapping[str, Any]]]]:
    """Returns what the shares of the worlds differ in, by the name of the training."""
    mine = {"robot": identified()}
    drawn = [{"disturbance": name} for name in ("slip", "wheel_error", "delay_1", "delay_2")]
    return {
        "data sheet": [(0.6, _TIER), (0.4, _TIER | _SHORT)],
        "identified sheet": [(0.6, _TIER | mine), (0.4, _TIER | mine | _SHORT)],
        "slip, wheel errors and delays drawn": [
            (0.3, _TIER), (0.2, _TIER | _SHORT), *((0.125, _TIER | each) for each in drawn),
        ],
    }  # fmt: skip


def rows_of(preset: Preset, seed: int) -> list[tuple[Any, ...]]:
    """Trains a seed, and returns its rows: a row a plant, with success, IQM of the errors (m) and speed (m/s)."""
    torch.set_num_threads(1)
    own = PpoLearner(preset, preset.worlds.env_ids[0], seed)
    while own.frames < preset.learning.steps:
        own.update()
    network = own.layers()
    lines = []
    for plant in PLANTS:
        test = {"scenario": "all/test", "actuators": "lagged", "dynamics": plant}
        with torch.no_grad():
            made = score(preset.changed(validation=test), network)
        lines.append((plant, f"{made.success:.4f}", f"{made.error:.6f}", f"{made.speed:.4f}"))
    return lines


def parts() -> Iterator[tuple[dict[str, str], Any]]:
    """Yields each training that the rows may lack."""
    for seed in range(SEEDS):
        for name, shares in trainings().items():
            preset = PLAIN.changed(name=f"domain_{len(shares)}", shares=tuple(shares), steps=STEPS)
            yield {"training": name, "seed": str(seed)}, functools.partial(rows_of, preset, seed)


@click.command(cls=OneLineErrors)
def main() -> None:
    """Trains and drives what is not in the rows."""
    drive_missing(DOMAIN, FIELDS, parts())


if __name__ == "__main__":
    main()
