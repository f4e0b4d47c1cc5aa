"""The files of a benchmark run: written whole or not at all, and read back."""

import contextlib
import csv
import dataclasses
import math
import os
import shutil
import tempfile
from collections.abc import Container, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wayfield.benchmarks.trajectory import Trajectory

EPISODES = "episodes.csv"
TRAJECTORIES = "trajectories.npz"
TABLE = "table.md"

Row = dict[str, str]  # one episode: a column's text by its name, empty where it does not apply


@contextlib.contextmanager
def staging(out: Path) -> Iterator[Path]:
    """Yields an empty folder on the same disk as `out`; what lies in it at the end is moved into `out`, file by file.

    On an error or an interruption the folder is deleted and `out` is as it was.

    Raises:
        OSError: at once, if nothing can be written to `out`.
    """
    above = out
    while not above.exists() and above != above.parent:
        above = above.parent
    if not above.is_dir():
        raise NotADirectoryError(f"{above} is a file, not a folder")
    for name in (EPISODES, TRAJECTORIES, TABLE):
        if (out / name).is_dir():
            raise IsADirectoryError(f"{out / name} is a folder, not a file")
    stage = Path(tempfile.mkdtemp(prefix=".wayfield-", dir=above))
    try:
        yield stage
        for file in sorted(stage.rglob("*")):
            if file.is_file():
                target = out / file.relative_to(stage)
                target.parent.mkdir(parents=True, exist_ok=True)
                os.replace(file, target)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def write_rows(folder: Path, rows: Sequence[Row]) -> None:
    """Writes the episodes, with a column for every name that any row has."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with open(folder / EPISODES, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_rows(folder: Path) -> list[Row]:
    """Returns the episodes of a run."""
    with open(folder / EPISODES, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def text(value: float) -> str:
    """Returns a number so that reading it gives the same number; NaN is the empty cell, whole numbers have no point."""
    if math.isnan(value):
        return ""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def number(row: Row, name: str) -> float:
    """Returns the number in a cell; NaN when it is empty or missing."""
    return float(row.get(name) or math.nan)


def write_trajectories(folder: Path, trajectories: dict[str, Trajectory]) -> None:
    """Writes the trajectories, each of their fields as the array `<key>/<field>`; empty arrays are left out."""
    arrays = {
        f"{key}/{field.name}": array
        for key, trajectory in trajectories.items()
        for field in dataclasses.fields(trajectory)
        if (array := np.asarray(getattr(trajectory, field.name))).size
    }
    np.savez_compressed(folder / TRAJECTORIES, allow_pickle=False, **arrays)


def read_trajectories(folder: Path, keys: Container[str] | None = None) -> dict[str, Trajectory]:
    """Returns the trajectories of a run, or those of some keys; the keys are the episodes' column `trajectory`."""
    fields: dict[str, dict[str, Any]] = {}
    with np.load(folder / TRAJECTORIES, allow_pickle=False) as archive:
        for name in archive.files:
            key, field = name.split("/")
            if keys is None or key in keys:
                array = archive[name]
                fields.setdefault(key, {})[field] = array.item() if array.ndim == 0 else array
    return {key: Trajectory(**values) for key, values in fields.items()}
