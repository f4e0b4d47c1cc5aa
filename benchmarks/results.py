"""The files of a benchmark run: written whole or not at all, known again by their digests, and read back."""

import csv
import dataclasses
import math
from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wayfield.benchmarks.archive import Archive
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.checks import shown
from wayfield.envs.readers import of_folder, reader

EPISODES = "episodes.csv"
TRAJECTORIES = "trajectories.npz"
TABLE = "table.md"

Row = dict[str, str]  # one episode: a column's text by its name, empty where it does not apply

_FIELDS = tuple(field.name for field in dataclasses.fields(Trajectory))


def write_rows(folder: Path, rows: Sequence[Row]) -> None:
    """Writes the episodes, with a column for every name that any row has."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with open(folder / EPISODES, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


@reader("episodes", EPISODES, {EPISODES: "policy,episode,success,time\npure_pursuit,0,1,12.5\nlqr,0,0,\n"}, of_folder)
def read_rows(folder: Path) -> list[Row]:
    """Returns the episodes of a run.

    Raises:
        ValueError: if the file is no such table; the message names file and line.
        OSError: if it cannot be opened.
    """
    return read_table(folder / EPISODES)


def read_table(file: Path) -> list[Row]:
    """Returns the rows of a CSV file with a header, each by the names of its columns.

    Raises:
        ValueError: if it is no such table; the message names file and line.
        OSError: if it cannot be opened.
    """
    rows: list[Row] = []
    with open(file, newline="", encoding="utf-8") as lines:
        reader = csv.DictReader(lines, strict=True)
        try:
            for row in reader:
                if None in row or None in row.values():
                    count = len(reader.fieldnames or ())
                    raise ValueError(f"the row has more or fewer cells than the {count} columns of the header")
                rows.append(row)
        except (csv.Error, ValueError) as error:
            raise ValueError(f"{file}:{max(reader.reader.line_num, 1)}: {error}") from None
    return rows


def text(value: float) -> str:
    """Returns a number so that reading it gives the same number; NaN is the empty cell, whole numbers have no point."""
    if math.isnan(value):
        return ""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def readable(name: str) -> str:
    """Returns a name from the system as text: its bytes need not be UTF-8, nor the locale take them for it."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def number(row: Row, name: str) -> float:
    """Returns the number in a cell; NaN when it is empty or missing.

    Raises:
        ValueError: if it holds anything else; the message names the column.
    """
    cell = row.get(name)
    try:
        return float(cell or math.nan)
    except ValueError:
        raise ValueError(f"column {name!r} holds {shown(cell)}; it must be a number or empty") from None


def write_trajectories(folder: Path, trajectories: dict[str, Trajectory]) -> None:
    """Writes the trajectories, each of their fields as the array `<key>/<field>`; empty arrays are left out."""
    arrays = {
        f"{key}/{field}": array
        for key, trajectory in trajectories.items()
        for field in _FIELDS
        if (array := np.asarray(getattr(trajectory, field))).size
    }
    for name, array in arrays.items():
        if array.dtype.hasobject:  # would be written as a pickle, which no reader of ours opens
            raise TypeError(f"{name} is an array of objects, not of numbers")
    np.savez_compressed(folder / TRAJECTORIES, **arrays)  # type: ignore[arg-type]


def _sample_trajectories(folder: Path) -> None:
    driven = Trajectory(times=np.arange(5.0), poses=np.ones((5, 3)))
    write_trajectories(folder, {"00000": driven, "00001": driven})


@reader("trajectories", TRAJECTORIES, _sample_trajectories, of_folder)
def read_trajectories(folder: Path, keys: Container[str] | None = None) -> dict[str, Trajectory]:
    """Returns the trajectories of a run, or those of some keys; the keys are the episodes' column `trajectory`.

    Raises:
        ValueError: if the file is damaged or holds anything else; the message names file and array.
        OSError: if it cannot be opened.
    """
    fields: dict[str, dict[str, Any]] = {}
    with Archive(folder / TRAJECTORIES) as archive:
        for name in archive.names:
            key, _, field = name.partition("/")
            if field not in _FIELDS:
                raise ValueError(f"{name} is no field of a trajectory")
            if keys is None or key in keys:
                array = archive[name]
                fields.setdefault(key, {})[field] = array.item() if array.ndim == 0 else array
        return {key: Trajectory(**values) for key, values in fields.items()}
