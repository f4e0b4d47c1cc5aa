"""Paths from text tables: x,y columns, CoppeliaSim's seven columns, and race circuits."""

import dataclasses
import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.world.paths import Path
from wayfield.system.checks import FARTHEST, MOST_POINTS, shown
from wayfield.system.objects import read_text
from wayfield.system.readers import reader

TABLE_SUFFIXES = (".csv", ".txt")
_COPPELIASIM_COLUMNS = 7  # x, y, z, qx, qy, qz, qw
_TRACK_WIDTHS = {"w_tr_right_m", "w_tr_left_m"}  # name the circuits of the TUM racetrack database
# Numerals as NumPy's reader takes them: no digit separators, no hexadecimals
_NUMERAL = re.compile(
    r"[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE | re.ASCII
)


@dataclasses.dataclass(frozen=True)
class _Layout:
    """What the first lines of a table tell about the rest."""

    first_row: int  # index of the first line with data
    delimiter: str | None  # None for white space
    width: int  # columns of the first row
    columns: tuple[int, int]  # of x and y
    named: bool  # whether a header named the columns
    circuit: bool  # closed although the last point does not repeat the first


_POSES = "".join(f"{x}, 0.5, 0, 0, 0, 0, 1\n" for x in range(5))
_CIRCUIT = "# x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3,3\n20,0,3,3\n20,20,3,3\n0,20,3,3\n"


@reader("path table", "path.csv", {"path.csv": "name,x,y\na,0,0\nb,1,0.5\nc,2,0\nd,3,1\n"})
@reader("path table of poses", "path.csv", {"path.csv": _POSES})
@reader("path table of a circuit", "path.csv", {"path.csv": _CIRCUIT})
@reader("path table with spaces", "path.txt", {"path.txt": "0 0\n1 0.5\n2 0\n# end\n0 0\n"})
def path_from_table(file: str, scale: float = 1.0, closed: bool | None = None) -> Path:
    """Returns the path of a text table, its coordinates multiplied by `scale`.

    Read are: columns named x and y (or x_m and y_m) in a header, among any others; two columns x, y without a
    header; seven columns x, y, z, qx, qy, qz, qw without a header (CoppeliaSim's customData.PATH); circuits
    with the header `# x_m,y_m,w_tr_right_m,w_tr_left_m` (TUMFTM/racetrack-database). Separated by commas or
    white space; a # starts a comment. Unless it is said by `closed`, the path is closed for a circuit, and where the
    last point repeats the first; an open one then goes all the way back.

    Raises:
        ValueError: if the file is no such table; one line that starts with file:line.
        OSError: if it cannot be opened, FileNotFoundError if there is none.
    """
    lines = read_text(file).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if len(lines) > 2 * MOST_POINTS:
        raise _fault(file, 2 * MOST_POINTS, f"the table goes on; it must have at most {MOST_POINTS} points")
    layout = _layout(file, lines)
    points = _points(file, lines, layout)
    with np.errstate(over="ignore"):  # an infinite product is reported below
        points *= scale
    far = np.flatnonzero(~(np.abs(points) <= FARTHEST).all(axis=1))  # true for NaN as well
    if len(far):
        at = points[far[0]].tolist()
        line = _line_of(lines, layout, far[0])
        raise _fault(file, line, f"point {at} is not finite or beyond {FARTHEST:g} m")

    if len(points) > MOST_POINTS:
        line = _line_of(lines, layout, MOST_POINTS)
        raise _fault(file, line, f"the table has {len(points)} points; it must have at most {MOST_POINTS}")
    repeats_first = len(points) > 1 and bool((points[0] == points[-1]).all())
    same = np.flatnonzero((np.diff(points, axis=0) == 0.0).all(axis=1))
    if len(same):
        line = _line_of(lines, layout, same[0] + 1)
        at = points[same[0]].tolist()
        raise _fault(file, line, f"point {at} repeats the one before it; remove the row")
    closed = (layout.circuit or repeats_first) if closed is None else closed
    if repeats_first and closed:
        points = points[:-1]
    least = 3 if closed else 2
    if len(points) < least:
        kind = "a closed path" if closed else "a path"
        line = _line_of(lines, layout, len(points) - 1)
        raise _fault(file, line, f"the table ends after {len(points)} distinct point(s); {kind} needs at least {least}")
    return Path(points, closed)


def _layout(file: str, lines: list[str]) -> _Layout:
    """Returns the layout of the table, from its header, if any, and its first row."""
    names: list[str] = []
    for i, line in enumerate(lines):
        if line.lstrip().startswith("#"):
            fields = _header(line.lstrip("# \t"))
            if _xy_columns(fields):
                names = fields
            continue
        text = line.split("#", 1)[0].strip()
        delimiter = "," if "," in text else None
        fields = _fields(text, delimiter)
        if not fields:
            continue
        if not names and not any(_NUMERAL.fullmatch(field) for field in fields):
            names = _header(text)
            if not _xy_columns(names):
                raise _fault(
                    file,
                    i + 1,
                    f"{shown(text)} is neither a row of numbers nor a header with columns x and y",
                )
            continue
        columns = _xy_columns(names) or (0, 1)
        if names and len(fields) <= max(columns):
            raise _fault(file, i + 1, f"{shown(text)} has {len(fields)} column(s), the header names {len(names)}")
        if not names and len(fields) not in (2, _COPPELIASIM_COLUMNS):
            raise _fault(
                file,
                i + 1,
                f"{shown(text)} has {len(fields)} column(s); without a header it must be 2 (x, y) or 7 "
                "(x, y, z, qx, qy, qz, qw)",
            )
        return _Layout(i, delimiter, len(fields), columns, bool(names), set(names) >= _TRACK_WIDTHS)
    raise _fault(file, len(lines), "the table has no points")


def _points(file: str, lines: list[str], layout: _Layout) -> NDArray[np.float64]:
    """Returns x and y of every row, shape (n, 2), unscaled."""
    if layout.named:  # NumPy looks at the columns that it is asked for: a field left out would shift the others
        for number, text in _rows(lines, layout):
            width = len(_fields(text, layout.delimiter))
            if width != layout.width:
                raise _fault(file, number, f"{shown(text)} has {width} column(s), the first row has {layout.width}")
    try:
        table = np.loadtxt(
            lines,
            delimiter=layout.delimiter,
            skiprows=layout.first_row,
            usecols=layout.columns if layout.named else None,  # all: a row of another width is then an error
            ndmin=2,
            encoding=None,
        )
    except ValueError as error:
        # NumPy counts rows, not lines: look for the offender again, slowly
        for number, text in _rows(lines, layout):
            fields = _fields(text, layout.delimiter)
            if len(fields) <= max(layout.columns) or (not layout.named and len(fields) != layout.width):
                problem = f"{shown(text)} has {len(fields)} column(s), the first row has {layout.width}"
                raise _fault(file, number, problem) from None
            for field in [fields[c] for c in layout.columns] if layout.named else fields:
                if not _NUMERAL.fullmatch(field):
                    raise _fault(file, number, f"{shown(field)} is not a number") from None
        raise ValueError(f"{file}: {' '.join(str(error).split())}") from None
    return np.ascontiguousarray(table[:, :2])


def _fields(text: str, delimiter: str | None) -> list[str]:
    """Returns the fields of a row, without white space and comment; none for an empty row."""
    text = text.split("#", 1)[0].strip()
    return [field.strip() for field in text.split(delimiter)] if text else []


def _header(text: str) -> list[str]:
    """Returns the names in a header, in lower case, without quotation marks."""
    return [field.strip(' "').lower() for field in text.split("," if "," in text else None)]


def _xy_columns(names: list[str]) -> tuple[int, int] | None:
    """Returns which columns hold x and y, or None when the names lack one."""
    for x, y in (("x", "y"), ("x_m", "y_m")):
        if x in names and y in names:
            return names.index(x), names.index(y)
    return None


def _rows(lines: list[str], layout: _Layout) -> Iterator[tuple[int, str]]:
    """Yields line number and text of every row of data."""
    for i in range(layout.first_row, len(lines)):
        if lines[i].split("#", 1)[0].strip():
            yield i + 1, lines[i]


def _line_of(lines: list[str], layout: _Layout, row: int) -> int:
    """Returns the line number of a row of data."""
    return [number for number, _ in _rows(lines, layout)][row]


def _fault(file: str, line: int, problem: str) -> ValueError:
    return ValueError(f"{file}:{line}: {problem}")
