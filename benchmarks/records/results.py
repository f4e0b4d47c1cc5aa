"""The files of a benchmark run: written whole or not at all, known again by their digests, and read back."""

import csv
import dataclasses
import zipfile
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from wayfield.benchmarks.records.archive import Archive
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.system.readers import of_folder, reader

EPISODES = "episodes.csv"
TRAJECTORIES = "trajectories.npz"
TABLE = "table.md"

_Table = TypeVar("_Table")
_AT_ONCE = 4096  # rows that are text together

_FIELDS = tuple(field.name for field in dataclasses.fields(Trajectory))


def write_rows(folder: Path, rows: Iterable[Row]) -> None:
    """Writes the episodes, with a column for every name that any row has."""
    episodes = Episodes.of(rows)
    with open(folder / EPISODES, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(episodes.names)
        for first in range(0, len(episodes), _AT_ONCE):
            some = episodes[first : first + _AT_ONCE]
            writer.writerows(zip(*map(some.texts, some.names), strict=True))


@reader("episodes", EPISODES, {EPISODES: "policy,episode,success,time\npure_pursuit,0,1,12.5\nlqr,0,0,\n"}, of_folder)
def read_rows(folder: Path) -> Episodes:
    """Returns the episodes of a run.

    Raises:
        ValueError: if the file is no such table; the message names file and line.
        OSError: if it cannot be opened.
    """
    return read_table(folder / EPISODES, Episodes.of_lines)


def read_table(file: Path, made: Callable[[list[str], Iterator[list[str]]], _Table]) -> _Table:
    """Returns what is made of the columns' names and the lines of a CSV file with a header.

    Raises:
        ValueError: if it is no such table; the message names file and line, or row.
        OSError: if it cannot be opened.
    """
    with open(file, newline="", encoding="utf-8") as stream:
        lines = csv.reader(stream, strict=True)
        try:
            names = next(lines, [])
            return made(names, _filled(lines, len(names)))
        except (csv.Error, UnicodeDecodeError) as error:
            raise ValueError(f"{file}:{max(lines.line_num, 1)}: {error}") from None
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from None


def _filled(lines: Iterable[list[str]], count: int) -> Iterator[list[str]]:
    """Yields the lines that are not empty; csv.Error where one has not as many cells as there are columns."""
    for line in lines:
        if line and len(line) != count:
            raise csv.Error(f"the row has more or fewer cells than the {count} columns of the header")
        if line:
            yield line


def readable(name: str) -> str:
    """Returns a name from the system as text: its bytes need not be UTF-8, nor the locale take them for it."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def write_trajectories(folder: Path, trajectories: Mapping[str, Trajectory]) -> None:
    """Writes the trajectories, each of their fields as the array `<key>/<field>`; empty arrays are left out.

    They are taken one after the other and not kept; the file is as `numpy.savez_compressed` makes it.
    """
    with zipfile.ZipFile(folder / TRAJECTORIES, "w", zipfile.ZIP_DEFLATED) as archive:
        for key, trajectory in trajectories.items():
            for field in _FIELDS:
                array = np.asarray(getattr(trajectory, field))
                if array.dtype.hasobject:  # would be written as a pickle, which no reader of ours opens
                    raise TypeError(f"{key}/{field} is an array of objects, not of numbers")
                if array.size:
                    with archive.open(f"{key}/{field}.npy", "w", force_zip64=True) as stream:
                        np.lib.format.write_array(stream, array, allow_pickle=False)


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
