"""Paths from text tables: columns of x and y by name, CoppeliaSim's seven columns, and race circuits."""

import dataclasses
import math
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.world.geometry import lengths
from wayfield.envs.world.paths import Path
from wayfield.system.checks import FARTHEST, MOST_POINTS, real, shown
from wayfield.system.objects import FileNote, read_text
from wayfield.system.readers import reader

TABLE_SUFFIXES = (".csv", ".tsv", ".txt")
_POSE_COLUMNS = (7, 8)  # x, y, z, qx, qy, qz, qw as CoppeliaSim writes them, behind a time as TUM has trajectories
SAME_PLACE = 1e-3  # m, within which the last point of a circuit is the first one again
_UNIT = 0.01  # by which the squares of a quaternion may sum to something else than 1
_SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", None: "white space"}
_TRACK_WIDTHS = {"w_tr_right_m", "w_tr_left_m"}  # name the circuits of the TUM racetrack database
# Numerals as NumPy's reader takes them: no digit separators, no hexadecimals
_NUMERAL = re.compile(
    r"[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE | re.ASCII
)
_COMMENT = re.compile(r"^(?:[#%\s]|//)+")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
# Words of a header, camel case apart. A column of x is named so alone, or beside these words, the first set first.
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")
_AS_X = {"easting": "x", "east": "x", "tx": "x", "northing": "y", "north": "y", "ty": "y"}
_UNITS = {**dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0), "cm": 0.01, "mm": 0.001}
_AS_TIME = {"t", "time", "times", "stamp", "timestamp", "sec", "secs", "seconds"}
_AS_SPEED = {"speed", "speeds", "velocity", "vel", "vx", "v"}
_AS_HEADING = {"theta", "yaw", "heading", "headings", "psi"}
_TICKS = {
    **dict.fromkeys(("ms", "msec", "msecs", "millis"), 1e-3), **dict.fromkeys(("us", "usec", "usecs"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec"), 1e-9),
}  # fmt: skip
_CLOCK = 1e11  # s, that no clock shows before the year 5138
_BESIDE_X: tuple[frozenset[str], ...] = (
    frozenset(),
    frozenset(_UNITS),
    frozenset({*_UNITS, "pos", "position", "pose", "point", "poses", "translation"}),
    frozenset(
        {*_UNITS, "waypoint", "world", "map", "odom", "local", "utm", "coord", "coordinate", "ref", "center", "centre"}
    ),
)
_NO_PLACE = {"orientation", "rotation", "twist", "linear", "angular", "velocity", "vel", "acceleration", "covariance"}
_DEGREES = ({"lat", "latitude"}, {"lon", "lng", "long", "longitude"})


@dataclasses.dataclass(frozen=True)
class _Layout:
    """What the first lines of a table tell about the rest."""

    first_row: int  # index of the first line with data
    delimiter: str | None  # of _SEPARATORS
    width: int  # columns of the first row
    columns: tuple[int, ...]  # of x and y, and where asked for that of the time
    named: bool  # whether a header named the columns
    circuit: bool  # closed although the last point does not repeat the first
    unit: float  # m, of x and y
    tick: float  # s, of the time
    stamps: tuple[str, ...]  # the column of times, where it is not asked for
    others: tuple[str, ...]  # columns that nobody asks for, of speeds or beside times of headings


_POSES = "".join(f"{x}, 0.5, 0, 0, 0, 0, 1\n" for x in range(5))
_CIRCUIT = "# x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3,3\n20,0,3,3\n20,20,3,3\n0,20,3,3\n"
_RACING_LINE = "# s_m; x_m; y_m; psi_rad\n0; 0; 0; 0\n1; 1; 0; 0\n2; 2; 0.1; 0.1\n3; 3; 0.3; 0.2\n"


@reader("path table", "path.csv", {"path.csv": "name,x,y\na,0,0\nb,1,0.5\nc,2,0\nd,3,1\n"})
@reader("path table of poses", "path.csv", {"path.csv": _POSES})
@reader("path table of a circuit", "path.csv", {"path.csv": _CIRCUIT})
@reader("path table of a racing line", "path.csv", {"path.csv": _RACING_LINE})
@reader("path table with spaces", "path.txt", {"path.txt": "0 0\n1 0.5\n2 0\n# end\n0 0\n"})
def path_from_table(file: str, scale: float = 1.0, closed: bool | None = None) -> Path:
    """Returns the path of a text table, its coordinates multiplied by `scale`.

    Read are: columns named in a header, among any others: x and y, with a unit (x_m, "x [mm]"), as positions of ROS
    messages (field.pose.position.x, /odom/pose/pose/position/x, pos_x) or as easting and northing; two columns x, y
    without a header; seven columns x, y, z, qx, qy, qz, qw without a header (CoppeliaSim's customData.PATH), and the
    same behind a time (trajectories of the TUM RGB-D benchmark, as evo writes them); circuits with the header
    `# x_m,y_m,w_tr_right_m,w_tr_left_m` (TUMFTM/racetrack-database). Separated by semicolons, commas, tabs or other
    white space; a # starts a comment, and quotation marks and a separator at the end of every line are left out.

    Unless it is said by `closed`, the path is closed for a circuit and where the table comes back to its start; see
    `closing`. A line says so where the last point does not repeat the first to the digit.

    Raises:
        ValueError: if the file is no such table; one line that starts with file:line.
        OSError: if it cannot be opened, FileNotFoundError if there is none.
    """
    return _read(file, scale, closed)[0]


@reader("reference table", "reference.csv", {"reference.csv": "t,x,y\n0,0,0\n4,1,0.5\n8,2,0\n12,3,1\n"})
def timed_path_from_table(file: str, scale: float = 1.0) -> tuple[Path, tuple[float, ...]]:
    """Returns the open path of a text table, as `path_from_table`, and the times (s) of its points; () without any.

    Times are in the column named t, time, stamp or timestamp, with a unit or in seconds, or before the seven columns of
    poses. Without a unit, stamps that no clock shows in seconds are in milli-, micro- or nanoseconds, as ROS has them.

    Raises:
        ValueError, OSError: as `path_from_table`.
    """
    return _read(file, scale, False, timed=True)


def _read(file: str, scale: float, closed: bool | None, timed: bool = False) -> tuple[Path, tuple[float, ...]]:
    """Returns the path of a table, and the times of its points where they are asked for and there."""
    lines = read_text(file).replace('"', "").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    last = {line.rstrip()[-1:] for line in lines if _fields(line, None)}
    if last in ({","}, {";"}):
        lines = [line.rstrip().removesuffix(*last) for line in lines]
    if len(lines) > 2 * MOST_POINTS:
        raise _fault(file, 2 * MOST_POINTS, f"the table goes on; it must have at most {MOST_POINTS} points")
    layout = _layout(file, lines, timed)
    table = _points(file, lines, layout)
    points, times = np.ascontiguousarray(table[:, :2]), table[:, 2:].ravel().tolist()
    first = points[0].tolist()
    scale *= layout.unit
    with np.errstate(over="ignore"):  # an infinite product is reported below
        points *= scale
    far = np.flatnonzero(~(np.abs(points) <= FARTHEST).all(axis=1))  # true for NaN as well
    if len(far):
        line = _line_of(lines, layout, far[0])
        problem = f"point {points[far[0]].tolist()} is not finite or beyond {FARTHEST:g} m"
        raise _fault(file, line, problem + origin_to_subtract(first, scale))

    if len(points) > MOST_POINTS:
        line = _line_of(lines, layout, MOST_POINTS)
        raise _fault(file, line, f"the table has {len(points)} points; it must have at most {MOST_POINTS}")
    same = np.flatnonzero((np.diff(points, axis=0) == 0.0).all(axis=1))
    if len(same) and times:  # the reference would stand
        line = _line_of(lines, layout, same[0] + 1)
        more = "1 more row does" if len(same) == 2 else f"{len(same) - 1} more rows do"
        others = f"; {more} so: keep one row for each place" if len(same) > 1 else "; remove the row"
        raise _fault(file, line, f"point {points[same[0]].tolist()} repeats the one before it{others}")
    points, closed, said = closing(points, closed, layout.circuit)
    if said:
        where = (
            f' in a .json file beside it, with "path_file": "{os.path.basename(file)}"' if '"closed"' in said else ""
        )
        warnings.warn(f"{file}: {said}{where}", FileNote, stacklevel=2)
    least = 3 if closed else 2
    if len(points) < least:
        kind = "a closed path" if closed else "a path"
        line = _line_of(lines, layout, len(points) - 1)
        raise _fault(file, line, f"the table ends after {len(points)} distinct point(s); {kind} needs at least {least}")
    if layout.stamps or layout.others:
        warnings.warn(f"{file}: {_unread(file, layout, timed)}", FileNote, stacklevel=2)
    tick = layout.tick
    while times and abs(times[0]) * tick > _CLOCK:
        tick *= 1e-3
    return Path(points, closed), tuple(tick * each for each in times)


def _unread(file: str, layout: _Layout, timed: bool) -> str:
    """Returns a line on what stands in a table and is not followed, and what follows it."""
    names = [shown(each) for each in (*layout.stamps, *layout.others)]
    said = f"column{'s' * (len(names) > 1)} {' and '.join(names)} {'is' if len(names) == 1 else 'are'} not followed"
    if timed:
        return f"{said}; headings are a list of a .json file, see docs/scenarios.md"
    said += ", a path is driven at the policy's own speed; "
    if not layout.stamps:
        return f"{said}give its points times to follow: wayfield/DiffDriveTrajectoryTracking-v0"
    return (
        f"{said}wayfield/DiffDriveTrajectoryTracking-v0 follows times, as does evaluate --path of a .json file beside "
        f'it with {{"reference": "{os.path.basename(file)}"}}'
    )


def closing(
    points: NDArray[np.float64], closed: bool | None, circuit: bool = False
) -> tuple[NDArray[np.float64], bool, str]:
    """Returns the points of a path without repeated ones, whether it is closed, and a line on what is not as given.

    Left out are points equal to the one before, as of a robot that stood, and a first one repeated by a closed path.
    Where nothing is said the path is closed if its last point lies within 1 mm (or a hundredth of its length) of the
    first one, which it then stands for, or if from the last point it goes on to the first one as from point to point:
    no more than half a median step further, without a corner of 45 degrees, after eight points or more.

    Args:
        points: (n, 2), m.
        closed: what the user says; None: nothing.
        circuit: whether the file is one of a circuit.
    """
    stays = np.ones(len(points), np.bool_)
    stays[1:] = (points[1:] != points[:-1]).any(axis=1)
    points, closed, said = _closing(points[stays], closed, circuit)
    if count := int((~stays).sum()):
        left = f"has {count} point{'s' * (count > 1)} equal to the one before, left out"
        said = f"{left}; {said}" if said else left
    return points, closed, said


def _closing(points: NDArray[np.float64], closed: bool | None, circuit: bool) -> tuple[NDArray[np.float64], bool, str]:
    if len(points) < 3:
        return points, bool(closed or circuit), ""
    steps = np.diff(points, axis=0)
    sizes = lengths(steps)
    across = points[0] - points[-1]
    gap = math.hypot(*across)
    repeats = gap <= min(SAME_PLACE, 0.01 * float(sizes.sum()))
    if closed is False or (not repeats and (closed or circuit)):
        return points, bool(closed is not False), ""
    if repeats:
        said = gap > 0.0 and closed is None and not circuit
        return points[:-1], True, f"ends {gap:.2g} m from its start: taken as closed" if said else ""
    corners = steps[[0, -1]] @ across / np.maximum(sizes[[0, -1]] * gap, np.finfo(float).tiny)
    if len(points) >= 8 and gap <= 1.5 * np.median(sizes) and corners.min() > math.sqrt(0.5):
        return points, True, f'ends a step of {gap:.2g} m before its start: taken as closed; else say "closed": false'
    if gap <= 0.02 * sizes.sum():
        return points, False, f'ends {gap:.2g} m from its start: taken as open; to close it, say "closed": true'
    return points, False, ""


def origin_to_subtract(first: Sequence[Any], scale: float) -> str:
    """Returns what to do about points too far away, where the path's first (x, y) is: the origin to subtract; or ""."""
    x, y = (real(each) for each in first)
    far = math.isfinite(x + y) and max(abs(x), abs(y)) * scale > FARTHEST
    return f"; subtract an origin near the path from all points, such as ({x:.0f}, {y:.0f})" if far else ""


def _layout(file: str, lines: list[str], timed: bool) -> _Layout:
    """Returns the layout of the table, from its header, if any, and its first row; timed: with the column of times."""
    names: list[str] = []
    columns = None
    for i, line in enumerate(lines):
        if i == 0 and re.fullmatch(r"sep=\S?", line.strip(), re.IGNORECASE):
            continue  # Excel writes it, and hides it
        if line.lstrip().startswith("#"):
            header = _header(line)
            if xy := _xy_columns(file, i + 1, header):
                names, columns = header, xy
            continue
        text = line.split("#", 1)[0].strip()
        delimiter = _separator(text)
        fields = _fields(text, delimiter)
        if not fields:
            continue
        number = [_NUMERAL.fullmatch(field) or _DECIMAL_COMMA.fullmatch(field) for field in fields]
        if not any(number):
            header = _header(text)
            if xy := _xy_columns(file, i + 1, header):
                names, columns = header, xy
                continue
            raise _fault(
                file,
                i + 1,
                f"{shown(text)} is no row of numbers; remove it, or put a # before it"
                if names
                else f"{shown(text)} is neither a row of numbers, such as 1.5,0.2, nor a header that names the columns "
                "of the place x and y, in m, cm or mm, such as x,y,speed or x_mm,y_mm",
            )
        separated = f"the columns are separated by {_SEPARATORS[delimiter]}, decimals have a point"
        # with white space a field left out would shift the others, as do more values than names: decimals with commas
        shifted = any(fields[len(names) :]) or (delimiter is None and len(fields) != len(names))
        if names and (len(fields) <= max(columns or ()) or shifted):
            problem = f"{shown(text)} has {len(fields)} column(s), the header names {len(names)}; {separated}"
            raise _fault(file, i + 1, problem)
        if not names and len(fields) not in (2, *_POSE_COLUMNS):
            raise _fault(
                file,
                i + 1,
                f"{shown(text)} has {len(fields)} column(s); without a header it must be 2 (x, y), 7 (x, y, z, qx, qy, "
                f"qz, qw) or 8 (time before them): name them in a first line, such as x,y,speed; {separated}",
            )
        circuit = {name.lower() for name in names} >= _TRACK_WIDTHS
        units = [_UNITS[each] for each in _words(names[columns[0]]) if each in _UNITS] if columns else []
        x = 1 if len(fields) == _POSE_COLUMNS[1] else 0
        clock = [k for k, name in enumerate(names) if set(_words(name)) & _AS_TIME] if columns else [0] * x
        ticks = [_TICKS[each] for each in _words(names[clock[0]]) if each in _TICKS] if columns and clock else []
        placed = (*(columns or (x, x + 1)), *(clock[:1] if timed else ()))
        unit, tick = (units or [1.0])[0], (ticks or [1.0])[0]
        stamps = () if timed else tuple(names[k] if names else "time" for k in clock[:1])
        others = tuple(name for name in names if set(_words(name)) & (_AS_HEADING if timed else _AS_SPEED))
        return _Layout(i, delimiter, len(fields), placed, bool(names), circuit, unit, tick, stamps, others)
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
                    what = f"{shown(field)} is not a number" if field else "a column is empty; leave out the row"
                    comma = "; write its decimals with a point" if _DECIMAL_COMMA.fullmatch(field) else ""
                    separated = f"the columns are separated by {_SEPARATORS[layout.delimiter]}"
                    raise _fault(file, number, f"{what}{comma}; {separated}") from None
        raise ValueError(f"{file}: {' '.join(str(error).split())}") from None
    if layout.named:
        return np.ascontiguousarray(table)
    if layout.width in _POSE_COLUMNS:
        turns = table[:, -4:]
        odd = np.flatnonzero(~(np.abs((turns**2).sum(axis=1) - 1.0) <= _UNIT))
        if len(odd):
            raise _fault(
                file,
                _line_of(lines, layout, odd[0]),
                f"the last four columns are {', '.join(f'{each:g}' for each in turns[odd[0]])}, which is no unit "
                f"quaternion; {layout.width} columns without a header must be {'time, ' * (layout.width == 8)}x, y, z, "
                "qx, qy, qz, qw: name others in a first line, such as s,x,y,psi,kappa,vx,ax",
            )
    return np.ascontiguousarray(table[:, layout.columns])


def _fields(text: str, delimiter: str | None) -> list[str]:
    """Returns the fields of a row, without white space and comment; none for an empty row."""
    text = text.split("#", 1)[0].strip()
    return [field.strip() for field in text.split(delimiter)] if text else []


def _separator(text: str) -> str | None:
    """Returns what separates the columns of a line; commas between digits alone are those of decimals."""
    if ";" in text:
        return ";"
    words = text.split()
    if "," in text and not (len(words) > 1 and all(_DECIMAL_COMMA.fullmatch(word) for word in words)):
        return ","
    return "\t" if "\t" in text and "\t\t" not in text else None


def _header(text: str) -> list[str]:
    """Returns the names in a header, without what marks it as a comment."""
    text = _COMMENT.sub("", text.strip())
    return [field.strip(" '") for field in text.split(_separator(text))]


def _words(name: str) -> list[str]:
    """Returns the words that a column's name consists of, x and y for what means them."""
    return [_AS_X.get(each.lower(), each.lower()) for each in _WORD.findall(name)]


def _xy_columns(file: str, line: int, names: list[str]) -> tuple[int, int] | None:
    """Returns which columns hold x and y, or None when the names lack one.

    Raises:
        ValueError: if several could be meant, or places are given in degrees.
    """
    words = [_words(name) for name in names]
    for beside in _BESIDE_X:
        pairs = []
        for k, each in enumerate(words):
            own = set(each) - {"x"}
            # of a ROS topic any words stand before; of its messages the last ones tell
            if each.count("x") == 1 and (own <= beside or (own & beside - _UNITS.keys() and not own & _NO_PLACE)):
                other = ["y" if word == "x" else word for word in each]
                if other in words:
                    pairs.append((k, words.index(other)))
        if len(pairs) > 1:
            both = " and ".join(shown(names[k]) for k, _ in pairs[:2])
            raise _fault(file, line, f"the columns {both} could both be x; leave one, or name it x and its partner y")
        if pairs:
            return pairs[0]
    if all(any(set(each) & degrees for each in words) for degrees in _DEGREES):
        raise _fault(
            file, line, "latitude and longitude are degrees; project them to metres, such as UTM less an origin, as x,y"
        )
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
