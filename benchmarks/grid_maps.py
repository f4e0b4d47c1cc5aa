"""Grid maps and problems of the MovingAI benchmarks (Sturtevant, Benchmarks for grid-based pathfinding, 2012)."""

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.checks import shown
from wayfield.envs.readers import reader

_FREE = frozenset(".GS")  # floor, and swamp, which is walked into from the floor
_BLOCKED = frozenset("@OTW")  # out of bounds, trees, and water, which is not


class GridProblem(NamedTuple):
    """One problem of a .scen file."""

    map_name: str
    shape: tuple[int, int]  # rows, columns of its map
    start: tuple[int, int]  # row, column
    goal: tuple[int, int]
    optimal_length: float  # octile, no corner cut, as printed: to about 1e-8


@reader("grid map", "a.map", {"a.map": "type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\n..S.\n"})
def grid_map(file: str | os.PathLike[str]) -> NDArray[np.bool_]:
    """Returns the blocked cells (rows, columns) of a .map file; row 0 is its first line.

    Raises:
        ValueError: if it is no such map; the message names the file, the line and what is wrong with it.
    """
    lines = _lines(file)
    head = [line.split() for line in lines[:4]]
    if len(head) < 4 or head[0] != ["type", "octile"] or head[3] != ["map"]:
        raise ValueError(f"{file}: a map starts with the lines 'type octile', 'height', 'width', 'map'")
    size = {}
    for number, words in ((2, head[1]), (3, head[2])):
        if len(words) != 2 or words[0] not in ("height", "width") or not words[1].isdigit() or int(words[1]) < 1:
            raise ValueError(f"{file}:{number}: {shown(lines[number - 1])} is no height or width")
        size[words[0]] = int(words[1])
    if len(size) < 2:
        raise ValueError(f"{file}: height and width must both be given")
    rows = lines[4:]
    while rows and not rows[-1]:
        rows.pop()
    if len(rows) != size["height"]:
        raise ValueError(f"{file}: height {size['height']} is announced, but there are {len(rows)} rows")
    for number, row in enumerate(rows, 5):
        if len(row) != size["width"]:
            raise ValueError(f"{file}:{number}: {len(row)} cells, not {size['width']}")
        for cell in set(row) - _FREE - _BLOCKED:
            raise ValueError(f"{file}:{number}: {cell!r} is no cell; free are . G S, blocked @ O T W")
    return np.array([[cell in _BLOCKED for cell in row] for row in rows])


@reader("grid problems", "a.scen", {"a.scen": "version 1\n0\ta.map\t4\t3\t0\t0\t3\t2\t4.41\n"})
def grid_problems(file: str | os.PathLike[str]) -> list[GridProblem]:
    """Returns the problems of a .scen file.

    Raises:
        ValueError: if it is no such file; the message names the file, the line and what is wrong with it.
    """
    lines = _lines(file)
    if not lines or lines[0].split()[:1] != ["version"]:
        raise ValueError(f"{file}: the first line must be 'version 1'")
    problems = []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip():
            continue
        words = line.split("\t")
        if len(words) != 9:
            raise ValueError(f"{file}:{number}: {len(words)} columns, not 9 separated by tabs")
        try:
            columns, rows, start_x, start_y, goal_x, goal_y = (int(word) for word in words[2:8])
            optimal_length = float(words[8])
        except ValueError as error:
            raise ValueError(f"{file}:{number}: {error}") from None
        for x, y in ((start_x, start_y), (goal_x, goal_y)):
            if not (0 <= x < columns and 0 <= y < rows):
                raise ValueError(f"{file}:{number}: x {x}, y {y} is outside {columns} x {rows} cells")
        problems.append(GridProblem(words[1], (rows, columns), (start_y, start_x), (goal_y, goal_x), optimal_length))
    return problems


def _lines(file: str | os.PathLike[str]) -> list[str]:
    with open(file, encoding="utf-8") as text:
        try:
            return text.read().splitlines()
        except UnicodeDecodeError:
            raise ValueError(f"{file}: is not a text file") from None
