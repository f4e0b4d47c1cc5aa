"""The cases of MRPB, a benchmark of local planners for the Pioneer P3DX, from the files that its makers publish.

A folder of a map holds `map.yaml` with its image, and the cases: `config.txt`, as the benchmark's repository has it, or
`cases.csv` with the columns start_x, start_y, start_heading, goal_x, goal_y, goal_heading.

Source: Wen et al., MRPB 1.0: a unified benchmark for the evaluation of mobile robot local planning approaches, 2020
(arXiv 2011.00491).
"""

import contextlib
import csv
import functools
import os
import re
from pathlib import Path

from wayfield.envs.scenarios.maps import grid_from_file, map_files
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.system.checks import MOST_WHOLE, number, shown
from wayfield.system.objects import fault, read_text, state_of
from wayfield.system.readers import of_path, reader

MAP, CASES, CONFIG = "map.yaml", "cases.csv", "config.txt"
POSITION_TOLERANCE, HEADING_TOLERANCE = 0.2, 0.1  # m, rad
COLUMNS = tuple(f"{end}_{name}" for end in ("start", "goal") for name in ("x", "y", "heading"))

_ARGUMENT = re.compile(r'<arg\s+name="(initial|goal)_pose_([xya])"\s+default="([^"]*)"\s*/>')
_OF_ARGUMENT = {"initial": "start", "goal": "goal", "x": "x", "y": "y", "a": "heading"}
_SAMPLE = ",".join(COLUMNS) + "\n-1,0.5,0,3,1,1.57\n0,1,0.5,2,-1,0\n"
_TEXT = "".join(
    f'<arg name="{end}_pose_{axis}" default="{value}"/>\n'
    for end in ("initial", "goal")
    for axis, value in (("x", "1.5"), ("y", "-0.5"), ("a", "3.14"))
)

Case = tuple[float, ...]


def is_mrpb(folder: str | os.PathLike[str]) -> bool:
    """Returns whether a folder holds a map and cases of MRPB."""
    there = Path(folder)
    return (there / MAP).is_file() and ((there / CASES).is_file() or (there / CONFIG).is_file())


def mrpb_scenarios(folder: str | os.PathLike[str]) -> tuple[GoalScenario, ...]:
    """Returns the scenarios of a map's folder, a case each: to 0.2 m and 0.1 rad of the goal pose.

    Raises:
        ValueError: if a file is faulty; one line that starts with the file and names the field.
        OSError: if one cannot be opened.
    """
    there = Path(os.path.abspath(folder))
    cases = there / (CASES if (there / CASES).is_file() else CONFIG)
    files = [str(cases)]
    with contextlib.suppress(ValueError):  # what is wrong with the map is said where it is read
        files += map_files(str(there / MAP), MAP)
    return _scenarios(str(there), str(cases), tuple(state_of(file) for file in files if os.path.exists(file)))


@functools.lru_cache(maxsize=32)
def _scenarios(folder: str, cases: str, states: tuple[tuple[str, int, int, int, int], ...]) -> tuple[GoalScenario, ...]:
    """Returns the scenarios of a folder whose files are in these states."""
    del states
    grid = grid_from_file(str(Path(folder) / MAP))
    listed = (read_cases if cases.endswith(CASES) else read_config)(Path(cases))
    name = os.path.basename(folder)
    try:
        return tuple(
            GoalScenario(
                f"{name} {k + 1}",
                (case[3], case[4], case[5]),
                (case[0], case[1], case[2]),
                grid=grid,
                position_tolerance=POSITION_TOLERANCE,
                heading_tolerance=HEADING_TOLERANCE,
            )
            for k, case in enumerate(listed)
        )
    except ValueError as error:
        raise fault(cases, error) from None


@reader("MRPB cases", CASES, {CASES: _SAMPLE}, of_path)
def read_cases(file: Path) -> list[Case]:
    """Returns the cases of a table: start x, y (m), heading (rad), goal x, y, heading.

    Raises:
        ValueError: if the file is no such table; one line that starts with file:line and names the column.
        OSError: if it cannot be opened.
    """
    lines = csv.reader(read_text(str(file)).splitlines(), strict=True)
    rows: list[Case] = []
    line = 1
    try:
        header = tuple(next(lines, ()))
        if header != COLUMNS:
            raise ValueError(f"the header is {shown(','.join(header))}; it must be {','.join(COLUMNS)}")
        for row in lines:
            line = lines.line_num
            if not row:
                continue
            if len(row) != len(COLUMNS):
                raise ValueError(f"has {len(row)} cells; a case has {len(COLUMNS)}: {', '.join(COLUMNS)}")
            rows.append(_case(dict(zip(COLUMNS, row, strict=True))))
            _check_count(rows)
    except (csv.Error, ValueError) as error:
        raise ValueError(f"{file}:{line}: {error}") from None
    if not rows:
        raise ValueError(f"{file}:1: holds no cases")
    return rows


@reader("MRPB launch arguments", CONFIG, {CONFIG: _TEXT}, of_path)
def read_config(file: Path) -> list[Case]:
    """Returns the cases of a list of launch arguments, as `read_cases` does.

    Raises:
        ValueError: if the file is no such list; one line that starts with file:line and names the argument.
        OSError: if it cannot be opened.
    """
    rows: list[Case] = []
    case: dict[str, str] = {}
    for line, text in enumerate(read_text(str(file)).splitlines(), 1):
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        match = _ARGUMENT.fullmatch(text.strip())
        try:
            if match is None:
                raise ValueError(f'is {shown(text.strip())}; it must be <arg name="initial_pose_x" default="..."/>')
            column = f"{_OF_ARGUMENT[match[1]]}_{_OF_ARGUMENT[match[2]]}"
            if column in case:
                raise ValueError(f"{match[1]}_pose_{match[2]} is given twice in a case")
            case[column] = match[3]
            if len(case) == len(COLUMNS):
                rows.append(_case(case))
                case = {}
                _check_count(rows)
        except ValueError as error:
            raise ValueError(f"{file}:{line}: {error}") from None
    if case or not rows:
        missing = next(name for name in COLUMNS if name not in case)
        raise ValueError(f"{file}: case {len(rows) + 1} has no {missing.replace('start', 'initial')}")
    return rows


def _case(texts: dict[str, str]) -> Case:
    """Returns a case of the texts of its columns."""
    numbers = []
    for name in COLUMNS:
        try:
            value = float(texts[name])
        except ValueError:
            raise ValueError(f"{name} is {shown(texts[name])}; it must be a number") from None
        numbers.append(number(name, value))
    return tuple(numbers)


def _check_count(cases: list[Case]) -> None:
    if len(cases) > MOST_WHOLE:
        raise ValueError(f"the cases go on; there must be at most {MOST_WHOLE}")
