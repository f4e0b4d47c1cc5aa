"""Recorded people, from the user's own files: ETH's `obsmat.txt`, and the four columns of UCY and TrajNet.

A row says where a person was in a frame: ETH frame, id, x, z, y and the velocities, which are not read; UCY and TrajNet
frame, id, x, y; lengths in metres. Rows of a person follow each other by one step of frames, 0.4 s in all these sets.
A recorded person does not react: tables of replayed people compare with no others.

Source: Pellegrini et al., You'll never walk alone, ICCV 2009; Lerner et al., Crowds by example, 2007; Kothari et al.,
Human trajectory forecasting in crowds, 2021 (TrajNet++).
"""

import functools
import itertools
import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.crowds.people import REPLAY, STAYS, WALK
from wayfield.envs.scenarios.draws import rounded
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.scenarios.team_scenario import MOST_PEOPLE, TeamScenario
from wayfield.system.checks import number, shown
from wayfield.system.elementary import bearing
from wayfield.system.objects import read_text
from wayfield.system.readers import of_path, reader

ETH, PLAIN = "obsmat.txt", ".txt"
STEP = 0.4  # s, between the rows of a person
RADIUS = 0.25  # m, of a recorded person
LONGEST = 60.0  # s, of a window
SHORTEST, NEAREST_GOAL = 4.0, 3.0  # s and m, of the way that the robot takes over
MOST_SCENARIOS = 64
MOST_ROWS = 1_000_000
FASTEST = 4.0  # m/s, in the median step of a person that walks
_SLOW = 0.05  # m/s, of a set whose unit or frame rate is another

_ETH_SAMPLE = "".join(
    f"{780 + 6 * k} {i} {0.5 * k * (3 - 2 * i):.3e} 0 {2.0 * i:.3e} 1 0 0\n" for i in (1, 2) for k in range(16)
)
_PLAIN_SAMPLE = "".join(f"{10 * k}\t{i}\t{0.5 * k * (3 - 2 * i)}\t{2.0 * i}\n" for k in range(16) for i in (1, 2))

Walked = dict[int, tuple[int, NDArray[np.float64]]]  # of each person the first step, and x, y (m) a step, (rows, 2)


def is_recording(name: object) -> bool:
    """Returns whether a scenario's name is meant as a recording: a .txt file, or a folder of some without a map."""
    text = os.fspath(name) if isinstance(name, str | os.PathLike) else None
    if not isinstance(text, str) or "\0" in text:
        return False
    if not os.path.isdir(text):
        return text.lower().endswith(PLAIN)
    files = os.listdir(text)
    return "map.yaml" not in files and any(each.lower().endswith(PLAIN) for each in files)


def recorded(name: str | os.PathLike[str]) -> tuple[TeamScenario, ...]:
    """Returns the scenarios of a recording, at most 64: in each the robot takes a person's start, goal and time.

    A window begins when that person comes and lasts 60 s; all others walk as they did.

    Args:
        name: a .txt file, or a folder: its `obsmat.txt` or its one .txt file.

    Raises:
        ValueError: if a file is faulty, or no person in it walks far enough; one line that begins with the file.
        OSError: if it cannot be opened.
    """
    file = _file_of(os.path.abspath(os.fspath(name)))
    stamp = os.stat(file)
    return _scenarios(file, stamp.st_mtime_ns, stamp.st_size)


def _file_of(name: str) -> str:
    if not os.path.isdir(name):
        return name
    if os.path.exists(os.path.join(name, ETH)):
        return os.path.join(name, ETH)
    files = sorted(each for each in os.listdir(name) if each.lower().endswith(PLAIN) and each[0] != ".")
    if len(files) != 1:
        raise ValueError(f"{name}: has {len(files)} .txt files and no {ETH}; name one of them")
    return os.path.join(name, files[0])


@functools.lru_cache(maxsize=8)
def _scenarios(file: str, modified: int, size: int) -> tuple[TeamScenario, ...]:
    del modified, size
    walked = (read_eth if os.path.basename(file) == ETH else read_plain)(Path(file))
    found = []
    for person in walked:
        scenario = _taken_over(os.path.basename(os.path.dirname(file)) or "recording", walked, person)
        if scenario is not None:
            found.append(scenario)
    if not found:
        raise ValueError(
            f"{file}: nobody walks {NEAREST_GOAL:g} m in {SHORTEST:g} s from a free place; a person must, whom the "
            "robot stands for"
        )
    every = np.unique(np.linspace(0, len(found) - 1, min(len(found), MOST_SCENARIOS)).round().astype(int))
    return tuple(found[k] for k in every.tolist())


def _taken_over(name: str, walked: Walked, person: int) -> TeamScenario | None:
    """Returns the scenario in which the robot stands for a person; None where that has no way or no room."""
    begins, places = walked[person]
    start, goal = places[0].tolist(), places[min(len(places) - 1, round(LONGEST / STEP))].tolist()
    if (len(places) - 1) * STEP < SHORTEST or math.dist(start, goal) < NEAREST_GOAL:
        return None
    walks, tracks, first = [], [], 0
    for other, (begun, theirs) in walked.items():
        late = begun - begins
        if other == person or late * STEP > LONGEST or late + len(theirs) - 1 < 0:
            continue
        if late <= 0 and math.dist(theirs[-late], start) < LARGEST_HULL + RADIUS:
            return None
        walk = np.zeros(1, WALK)
        here = theirs[max(-late, 0)]
        walk["law"], walk["then"], walk["radius"] = REPLAY, STAYS, RADIUS
        walk["x"], walk["y"] = here
        walk["goal_x"], walk["goal_y"] = theirs[-1]
        walk["speed"] = min(float(np.hypot(*np.diff(theirs, axis=0).T).mean()) / STEP, 3.0)
        walk["frame_time"], walk["begins"], walk["first"], walk["rows"] = STEP, late * STEP, first, len(theirs)
        rates = np.gradient(theirs, axis=0)  # central differences: Catmull and Rom's
        walks.append(walk)
        tracks.append(np.column_stack([theirs, rates]))
        first += len(theirs)
        if len(walks) == MOST_PEOPLE:
            break
    ahead = rounded(bearing.py_func(goal[1] - start[1], goal[0] - start[0]))
    return TeamScenario.made(
        f"{name}_{person}",
        [(*start, ahead)],
        [(*goal, ahead)],
        walks=np.concatenate(walks) if walks else np.zeros(0, WALK),
        tracks=np.concatenate(tracks) if tracks else np.zeros((0, 4)),
        family="replay",
    )


@reader("recording of ETH", ETH, {ETH: _ETH_SAMPLE}, of_path)
def read_eth(file: Path) -> Walked:
    """Returns the tracks of people, of a file with the columns frame, id, x, z, y, v_x, v_z, v_y.

    Raises:
        ValueError: if the file is no such table; one line that begins with file:line and names the column.
        OSError: if it cannot be opened.
    """
    return _read(file, ("frame", "id", "x", "z", "y", "v_x", "v_z", "v_y"))


@reader("recording of UCY or TrajNet", "crowd.txt", {"crowd.txt": _PLAIN_SAMPLE}, of_path)
def read_plain(file: Path) -> Walked:
    """Returns the tracks of people, of a file with the columns frame, id, x, y; see `read_eth`."""
    return _read(file, ("frame", "id", "x", "y"))


def _read(file: Path, columns: tuple[str, ...]) -> Walked:
    rows: dict[int, dict[int, tuple[int, float, float]]] = {}  # by person and frame: the line, x, y
    x, y = columns.index("x"), columns.index("y")
    count = 0
    for line, text in enumerate(read_text(str(file)).splitlines(), 1):
        cells = text.replace(",", " ").split()
        if not cells or cells[0].startswith("#"):
            continue
        count += 1
        try:
            if count > MOST_ROWS:
                raise ValueError(f"the rows go on; there must be at most {MOST_ROWS}")
            if len(cells) != len(columns):
                raise ValueError(f"has {len(cells)} columns; a row has {len(columns)}: {', '.join(columns)}")
            frame, person = (_whole(name, cell) for name, cell in zip(columns[:2], cells, strict=False))
            place = _metres("x", cells[x]), _metres("y", cells[y])
            mine = rows.setdefault(person, {})
            if frame in mine:
                raise ValueError(
                    f"id {person} is in frame {frame} twice, first in line {mine[frame][0]}; it must be there once"
                )
            mine[frame] = (line, *place)
        except ValueError as error:
            raise ValueError(f"{file}:{line}: {error}") from None
    if not rows:
        raise ValueError(f"{file}:1: holds no rows; a row is {', '.join(columns)}")
    return _walked(file, rows)


def _walked(file: Path, rows: dict[int, dict[int, tuple[int, float, float]]]) -> Walked:
    """Returns the rows a person, checked to follow each other at one rate at which people walk."""
    steps: dict[int, int] = {}
    for mine in rows.values():
        frames = sorted(mine)
        for a, b in itertools.pairwise(frames):
            steps[b - a] = steps.get(b - a, 0) + 1
    if not steps:
        raise ValueError(f"{file}:1: nobody has two rows; somebody must")
    step = max(steps, key=lambda each: (steps[each], -each))
    origin = min(min(mine) for mine in rows.values())
    found: Walked = {}
    speeds: list[float] = []
    for person, mine in sorted(rows.items()):
        frames = sorted(mine)
        for a, b in itertools.pairwise(frames):
            if b - a != step:
                line = mine[b][0]
                raise ValueError(
                    f"{file}:{line}: id {person} has no row between the frames {a} and {b}; its rows must be {step} "
                    "frames apart, as most are"
                )
        late, rest = divmod(frames[0] - origin, step)
        if rest and len(frames) > 1 and 2 * rest > step:
            late += 1  # a person annotated between the frames of others is moved to the next of theirs
        if len(frames) > 1:
            places = np.array([mine[frame][1:] for frame in frames])
            speeds += (np.hypot(*np.diff(places, axis=0).T) / STEP).tolist()
            found[person] = late, places
    median = float(np.median(speeds))
    if not _SLOW <= median <= FASTEST:
        raise ValueError(
            f"{file}:1: people walk at {median:.3g} m/s in the median, at {STEP:g} s between rows; it must be from "
            f"{_SLOW:g} to {FASTEST:g} m/s: x and y in m, rows at 2.5 Hz"
        )
    return found


def _whole(name: str, text: str) -> int:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value.is_integer() or abs(value) > 2**40:
        raise ValueError(f"{name} is {shown(text)}; it must be a whole number")
    return int(value)


def _metres(name: str, text: str) -> float:
    try:
        return number(name, float(text), most=1e4)
    except ValueError:
        raise ValueError(f"{name} is {shown(text)}; it must be a number from -10000 to 10000, in m") from None
