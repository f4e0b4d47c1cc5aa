"""The files of a benchmark run: written whole or not at all, known again by their digests, and read back."""

import csv
import dataclasses
import itertools
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
SWEEP = "speed_sweep.csv"  # of policies asked for one speed after the other, which are no rows of a contest
TRAJECTORIES = "trajectories.npz"
TABLE = "table.md"

_Table = TypeVar("_Table")
_AT_ONCE = 4096  # rows that are text together

_FIELDS = tuple(field.name for field in dataclasses.fields(Trajectory))


def write_rows(folder: Path, rows: Iterable[Row]) -> None:
    """Writes the episodes, with a column for every name that any row has; those of speed sweeps to a file of their own.

    Raises:
        ValueError: if those of speed sweeps do not come last.
    """
    episodes = Episodes.of(rows)
    swept = np.asarray(episodes["split"]) == "front" if "split" in episodes.names else np.zeros(len(episodes), np.bool_)
    last = int(len(swept) - swept.sum())
    if not swept[last:].all():
        raise ValueError("the episodes of speed sweeps must come last")
    _write(folder / EPISODES, episodes, 0, last)
    if last < len(episodes):
        _write(folder / SWEEP, episodes, last, len(episodes))


def _write(file: Path, episodes: Episodes, begin: int, end: int) -> None:
    with open(file, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(episodes.names)
        for first in range(begin, end, _AT_ONCE):
            some = episodes[first : min(first + _AT_ONCE, end)]
            writer.writerows(zip(*map(some.texts, episodes.names), strict=True))


@reader("episodes", EPISODES, {EPISODES: "policy,episode,success,time\npure_pursuit,0,1,12.5\nlqr,0,0,\n"}, of_folder)
def read_rows(folder: Path) -> Episodes:
    """Returns the episodes of a run, those of its speed sweep last.

    Raises:
        ValueError: if a file is no such table; the message names file and line.
        OSError: if it cannot be opened.
    """
    return read_run(folder, Episodes.of_lines)


def read_run(folder: Path, made: Callable[[list[str], Iterator[list[str]]], _Table]) -> _Table:
    """Returns what is made of the columns' names and the lines of a run's episodes, those of its speed sweep last.

    Raises:
        ValueError: if a file is no such table; the message names file and line.
        OSError: if it cannot be opened.
    """

    def joined(names: list[str], lines: Iterator[list[str]]) -> _Table:
        def swept(others: list[str], more: Iterator[list[str]]) -> list[list[str]]:
            if others != names:
                raise ValueError(f"its columns are not those of {EPISODES}")
            return list(more)

        there = (folder / SWEEP).is_file()
        return made(names, itertools.chain(lines, read_table(folder / SWEEP, swept) if there else ()))

    return read_table(folder / EPISODES, joined)


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
