"""What a replay needs of an episode: its poses and errors, quantised to a millimetre and a milliradian."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.records.archive import Archive
from wayfield.benchmarks.records.run_folder import DRIVES
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.system.readers import of_folder, reader

QUANTUM = 1e-3  # m and rad
MOST_DRIVES = 50_000  # of a run: a report has room for some thousand

MOST_BODIES = 64  # beside a robot, whose places are kept: of larger worlds none is
AWAY = 2**27  # quanta: x and y of a body that is not there

# (n + 1, 3): x, y, heading without jumps, in quanta; of path followers (n + 1, 4), the error; of worlds of several
# bodies (n + 1, 3 + 2 m), x and y of each
Drive = NDArray[np.int32]


def drive_of(trajectory: Trajectory) -> Drive:
    """Returns the poses of a trajectory, and its cross-track errors or other bodies where it has some, in quanta."""
    columns = [trajectory.poses[:, 0], trajectory.poses[:, 1], np.unwrap(trajectory.poses[:, 2])]
    if len(trajectory.cross_track_errors):
        columns.append(trajectory.cross_track_errors)
    if 0 < len(trajectory.other_radii) <= MOST_BODIES:
        there = np.nan_to_num(trajectory.others / QUANTUM, nan=float(AWAY))
        columns += [QUANTUM * each for each in there.reshape(len(there), -1).T]
    numbers = np.column_stack(columns) / QUANTUM
    return np.rint(np.clip(numbers, -(2**30), 2**30)).astype(np.int32)


def write_drives(folder: Path, drives: Mapping[int, Drive]) -> None:
    """Writes the drives of some episodes, by the number of their row."""
    columns = [drive.shape[1] for drive in drives.values()]
    flat = [drive.T.ravel() for drive in drives.values()]
    np.savez_compressed(
        folder / DRIVES,
        rows=np.array(list(drives), np.int64),
        columns=np.array(columns, np.int64),
        steps=np.array([len(drive) for drive in drives.values()], np.int64),
        numbers=np.concatenate(flat) if flat else np.empty(0, np.int32),
    )


def _sample(folder: Path) -> None:
    write_drives(folder, {0: np.zeros((4, 3), np.int32), 2: np.ones((5, 4), np.int32)})


@reader("drives", DRIVES, _sample, of_folder)
def read_drives(folder: Path) -> dict[int, Drive]:
    """Returns the drives of a run by the number of their row.

    Raises:
        ValueError: if the file is damaged or holds anything else; the message names it.
        OSError: if it cannot be opened.
    """
    with Archive(folder / DRIVES) as archive:
        return _taken_apart(**{name: archive[name] for name in ("rows", "columns", "steps", "numbers")})


def _taken_apart(
    rows: NDArray[np.int64], columns: NDArray[np.int64], steps: NDArray[np.int64], numbers: NDArray[np.int32]
) -> dict[int, Drive]:
    """Returns the drives that four arrays hold."""
    for name, array, kind in (("rows", rows, "i8"), ("columns", columns, "i8"), ("steps", steps, "i8")):
        if array.dtype != kind or array.ndim != 1 or len(array) != len(rows) or (array < 0).any():
            raise ValueError(f"{name} must be {len(rows)} whole numbers, none below 0")
    if numbers.dtype != np.int32 or numbers.ndim != 1:
        raise ValueError("numbers must be a row of int32")
    if not ((columns == 4) | (columns % 2 == 1) & (columns >= 3)).all() or (steps > len(numbers)).any():
        raise ValueError("a drive must have 4 or 3, 5, 7, ... columns and no more steps than there are numbers")
    ends = np.cumsum(columns * steps)
    if len(numbers) != (ends[-1] if len(ends) else 0):
        raise ValueError(f"there are {len(numbers)} numbers; rows, columns and steps say otherwise")
    pieces = np.split(numbers, ends[:-1]) if len(ends) else []
    return {int(row): piece.reshape(int(width), -1).T for row, width, piece in zip(rows, columns, pieces, strict=True)}


def packed(drive: Drive) -> bytes:
    """Returns a drive as bytes that deflate well: second differences of each column, folded to whole numbers >= 0.

    A number 2 k stands for k and 2 k - 1 for -k; first come the low 16 bits' low bytes, then their high bytes, then the
    upper 16 bits in the same order. The page's `unpacked` undoes it.
    """
    second = np.diff(drive.astype(np.int64), 2, axis=0, prepend=np.zeros((2, drive.shape[1]), np.int64)).T.ravel()
    folded = np.where(second > 0, 2 * second - 1, -2 * second).astype(np.uint32)
    return folded.astype("<u4").view(np.uint8).reshape(-1, 4).T.tobytes()
