"""Recorded people, from the user's own files: ETH's `obsmat.txt`, and the four columns of UCY and TrajNet.

A row says where a person was in a frame: ETH frame, id, x, z, y and the velocities, which are not read; UCY and TrajNet
frame, id, x, y; lengths in metres; a first line may name these columns. Rows of a person follow each other by one step
of frames, 0.4 s in most of these sets. A recorded person does not react: tables of replayed people compare with no
others.

Source: Pellegrini et al., You'll never walk alone, ICCV 2009; Lerner et al., Crowds by example, 2007; Kothari et al.,
Human trajectory forecasting in crowds, 2021 (TrajNet++).
"""

import array
import functools
import hashlib
import math
import os
import warnings
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.crowds.people import REPLAY, STAYS, WALK
from wayfield.envs.scenarios.draws import rounded
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.scenarios.team_scenario import MOST_PEOPLE, TeamScenario
from wayfield.system.checks import number, shown
from wayfield.system.elementary import bearing
from wayfield.system.objects import FileNote, read_text
from wayfield.system.readers import of_path, reader

ETH, PLAIN = "obsmat.txt", ".txt"
RATE = 2.5  # rows of a person in a second
_RATES = 0.1, 1000.0  # that it may be
LONGEST_GAP = 2.0  # s, in which a person is taken to walk straight on
RADIUS = 0.25  # m, of a recorded person
LONGEST = 60.0  # s, of a window
SHORTEST, NEAREST_GOAL = 4.0, 3.0  # s and m, of the way that the robot takes over
MOST_SCENARIOS = 64
MOST_ROWS = 1_000_000
FASTEST = 4.0  # m/s, in the median step of a person that walks
_FARTHEST = 10_000  # m, of a person from the origin
_LARGEST = 2**53  # of frames and ids: microseconds since 1970 are fewer
_ASTRAY = 0.25  # steps, by which a row may come early or late
_JUMP = 3.0  # times FASTEST, and times the median pace of a file: no person moves on so
_AWAY = 1.0  # m, that a person goes who does not stand
_SLOW = 0.05  # m/s, of a set whose unit is another
_USUAL = 0.5, 1.3, 2.0  # m/s, of people who walk: at least, in the mean, at most in the median of a set

_ETH_SAMPLE = "".join(
    f"{780 + 6 * k} {i} {0.5 * k * (3 - 2 * i):.3e} 0 {2.0 * i:.3e} 1 0 0\n" for i in (1, 2) for k in range(16)
)
_PLAIN_SAMPLE = "".join(f"{10 * k}\t{i}\t{0.5 * k * (3 - 2 * i)}\t{2.0 * i}\n" for k in range(16) for i in (1, 2))


class Person(NamedTuple):
    """The track of a person between two gaps."""

    name: str
    begins: int  # the step of the first row
    places: NDArray[np.float64]  # x, y (m) a step, (rows, 2)


def is_recording(name: object) -> bool:
    """Returns whether a scenario's name is meant as a recording: a .txt file, or a folder of some without a map.

    An @ and the rate in Hz may be behind it.
    """
    text = os.fspath(name) if isinstance(name, str | os.PathLike) else None
    if not isinstance(text, str) or "\0" in text:
        return False
    text = _at_rate(text)[0]
    if not os.path.isdir(text):
        return text.lower().endswith(PLAIN)
    files = os.listdir(text)
    return "map.yaml" not in files and any(each.lower().endswith(PLAIN) for each in files)


def _at_rate(text: str) -> tuple[str, Any]:
    """Returns the file or folder of a name, and the rate behind its @ if there is one, a number if it is that."""
    name, at, rate = text.rpartition("@")
    if not at or os.path.basename(rate) != rate or os.path.exists(text):
        return text, None
    try:
        return name, float(rate)
    except ValueError:
        return name, rate


def recorded(name: str | os.PathLike[str], rate: float | None = None) -> tuple[TeamScenario, ...]:
    """Returns the scenarios of a recording, at most 64: in each the robot takes a person's start, goal and time.

    A window begins when that person comes and lasts 60 s; all others walk as they did. Rows that are missing for up to
    2 s are filled in along a straight line; over a longer gap a person leaves and another comes. A line says so, and
    where people are unusually quick or slow for the rate.

    Args:
        name: a .txt file, or a folder: its `obsmat.txt` or its one .txt file. Behind an @, as in "crowd.txt@25", it
            may say the rate.
        rate: rows of a person in a second, Hz; None: 2.5, and a line if people then walk as nobody does.

    Raises:
        ValueError: if a file is faulty, or no person in it walks far enough; one line that begins with the file.
        OSError: if it cannot be opened.
    """
    place, behind = _at_rate(os.fspath(name))
    file = _file_of(os.path.abspath(place))
    rate = rate if behind is None else behind
    if rate is not None:
        where = "rate" if behind is None else f"{os.fspath(name)}: rate"
        number(where, rate, least=_RATES[0], most=_RATES[1])
    return _scenarios(file, hashlib.sha256(read_text(file).encode()).hexdigest(), rate)


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
def _scenarios(file: str, digest: str, rate: float | None) -> tuple[TeamScenario, ...]:
    """Returns the scenarios of a file with that digest."""
    del digest
    people = (read_eth if os.path.basename(file) == ETH else read_plain)(Path(file), rate)
    crowd = _Crowd(os.path.basename(os.path.dirname(file)) or "recording", people, 1.0 / (rate or RATE))
    walkers = [k for k in range(len(people)) if crowd.has_way(k)]
    if not walkers:
        raise ValueError(
            f"{file}: nobody walks {NEAREST_GOAL:g} m in {SHORTEST:g} s from a free place; a person must, whom the "
            "robot stands for"
        )
    every = np.unique(np.linspace(0, len(walkers) - 1, min(len(walkers), MOST_SCENARIOS)).round().astype(int))
    return tuple(crowd.without(walkers[k]) for k in every.tolist())


class _Crowd:
    """All people of a recording, whose windows are cut out one by one."""

    def __init__(self, name: str, people: list[Person], step: float) -> None:
        self.name, self.people, self.step = name, people, step
        self.begins = np.array([each.begins for each in people])
        self.rows = np.array([len(each.places) for each in people])
        self.first = np.cumsum([0, *self.rows[:-1]])
        self.places = np.concatenate([each.places for each in people])
        # central differences: Catmull and Rom's
        rates = [np.gradient(each.places, axis=0) for each in people]
        self.tracks = np.column_stack([self.places, np.concatenate(rates)])  # one array for all scenarios
        walks = np.zeros(len(people), WALK)
        walks["law"], walks["then"], walks["radius"], walks["frame_time"] = REPLAY, STAYS, RADIUS, step
        walks["goal_x"], walks["goal_y"] = self.places[self.first + self.rows - 1].T
        speeds = [float(np.hypot(*np.diff(each.places, axis=0).T).mean()) / step for each in people]
        walks["speed"], walks["first"], walks["rows"] = np.minimum(speeds, 3.0), self.first, self.rows
        self.walks = walks

    def way(self, person: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Returns where the robot that stands for a person starts and shall go, x and y (m)."""
        places = self.people[person].places
        start, goal = places[[0, min(len(places) - 1, round(LONGEST / self.step))]].tolist()
        return (start[0], start[1]), (goal[0], goal[1])

    def others(self, person: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Returns who else is there in a person's window, how many steps later they come, and where they are then."""
        late = self.begins - self.begins[person]
        there = (late * self.step <= LONGEST) & (late + self.rows > 0)
        there[person] = False
        who = np.flatnonzero(there)[:MOST_PEOPLE]
        late = late[who]
        return who, late, self.places[self.first[who] + np.maximum(-late, 0)]

    def has_way(self, person: int) -> bool:
        """Returns whether a person has a way to go and the robot room to start."""
        start, goal = self.way(person)
        if (self.rows[person] - 1) * self.step < SHORTEST or math.dist(start, goal) < NEAREST_GOAL:
            return False
        _, late, places = self.others(person)
        return not (np.hypot(*(places[late <= 0] - start).T) < LARGEST_HULL + RADIUS).any()

    def without(self, person: int) -> TeamScenario:
        """Returns the scenario in which the robot stands for a person."""
        start, goal = self.way(person)
        who, late, places = self.others(person)
        walks = self.walks[who]
        walks["x"], walks["y"] = places.T
        walks["begins"] = late * self.step
        ahead = rounded(bearing.py_func(goal[1] - start[1], goal[0] - start[0]))
        return TeamScenario.made(
            f"{self.name}_{self.people[person].name}",
            [(*start, ahead)],
            [(*goal, ahead)],
            walks=walks,
            tracks=self.tracks,
            family="replay",
        )


@reader("recording of ETH", ETH, {ETH: _ETH_SAMPLE}, of_path)
def read_eth(file: Path, rate: float | None = None) -> list[Person]:
    """Returns the tracks of people, of a file with the columns frame, id, x, z, y, v_x, v_z, v_y.

    Args:
        rate: rows of a person in a second; None: 2.5.

    Raises:
        ValueError: if the file is no such table; one line that begins with file:line and names the column.
        OSError: if it cannot be opened.
    """
    return _read(file, ("frame", "id", "x", "z", "y", "v_x", "v_z", "v_y"), rate)


@reader("recording of UCY or TrajNet", "crowd.txt", {"crowd.txt": _PLAIN_SAMPLE}, of_path)
def read_plain(file: Path, rate: float | None = None) -> list[Person]:
    """Returns the tracks of people, of a file with the columns frame, id, x, y; see `read_eth`."""
    return _read(file, ("frame", "id", "x", "y"), rate)


def _read(file: Path, columns: tuple[str, ...], rate: float | None) -> list[Person]:
    wanted = {name: columns.index(name) for name in ("frame", "id", "x", "y")}
    lines, numbers = array.array("q"), array.array("d")
    for line, text in enumerate(read_text(str(file)).splitlines(), 1):
        cells = text.replace(",", " ").split()
        is_header = not lines and tuple(each.lower() for each in cells) == columns
        if not cells or cells[0].startswith("#") or is_header:
            continue
        if not lines and not any(character.isdigit() for character in text):
            raise ValueError(
                f"{file}:{line}: is {shown(text)}; a line that names columns is {' '.join(columns)}, or begins with #"
            )
        if len(lines) == MOST_ROWS:
            raise ValueError(f"{file}:{line}: the rows go on; there must be at most {MOST_ROWS}")
        if len(cells) != len(columns):
            raise ValueError(f"{file}:{line}: has {len(cells)} columns; a row has {len(columns)}: {', '.join(columns)}")
        lines.append(line)
        try:
            frame, person, x, y = [float(cells[k]) for k in wanted.values()]
        except ValueError:
            frame = person = x = y = math.nan
        whole = frame.is_integer() and person.is_integer() and -_LARGEST <= frame <= _LARGEST >= abs(person)
        if not (whole and abs(x) <= _FARTHEST and abs(y) <= _FARTHEST):
            _refuse_row(f"{file}:{line}", {name: cells[k] for name, k in wanted.items()})
        numbers.extend((frame, person, x, y))
    if not lines:
        raise ValueError(f"{file}:1: holds no rows; a row is {', '.join(columns)}")
    table = np.frombuffer(numbers).reshape(-1, len(wanted))
    order = np.lexsort((table[:, 0], table[:, 1]))
    table = table[order]
    twice = np.flatnonzero((np.diff(table[:, :2], axis=0) == 0.0).all(axis=1))
    if len(twice):
        row = min(twice, key=lambda k: lines[order[k + 1]])
        frame, person = table[row, :2].astype(np.int64).tolist()
        raise ValueError(
            f"{file}:{lines[order[row + 1]]}: id {person} is in frame {frame} twice, first in line "
            f"{lines[order[row]]}; it must be there once"
        )
    return _walked(file, np.split(table, np.flatnonzero(np.diff(table[:, 1])) + 1), rate)


def _refuse_row(line: str, cells: dict[str, str]) -> NoReturn:
    """Raises ValueError for the first of a row's cells that is no number of its column's."""
    for name, text in cells.items():
        whole = name in ("frame", "id")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if whole and not (value.is_integer() and abs(value) <= _LARGEST):
            raise ValueError(f"{line}: {name} is {shown(text)}; it must be a whole number, at most {_LARGEST} in size")
        if not whole and not abs(value) <= _FARTHEST:
            raise ValueError(
                f"{line}: {name} is {shown(text)}; it must be a number from -{_FARTHEST:g} to {_FARTHEST:g}, in m"
            )
    raise AssertionError(line)


def _walked(file: Path, people: list[NDArray[np.float64]], rate: float | None) -> list[Person]:
    """Returns the tracks at one rate of people, each with rows (n, 4) of frame, id, x and y in the order of frames."""
    frames = [each[:, 0].astype(np.int64) for each in people]
    step = _step(np.concatenate([np.diff(each) for each in frames]))
    if not step:
        raise ValueError(f"{file}:1: no id has two rows; at least one must, at different frames")
    longest = (max(math.floor(LONGEST_GAP * (rate or RATE)), 1) + _ASTRAY) * step
    origin = min(each[0] for each in frames)
    # m a frame, beyond which nobody walks: an id that was given to another; not where coordinates are no metres
    walks = zip(people, frames, strict=True)
    paces = [np.hypot(*np.diff(rows[:, 2:], axis=0).T) / np.diff(mine) for rows, mine in walks]
    most = _JUMP * max(FASTEST / ((rate or RATE) * step), _median([rows[:, 2:] for rows in people], paces))
    persons: list[Person] = []
    filled = parted = size = 0
    for rows, mine, pace in zip(people, frames, paces, strict=True):
        parts = np.split(np.arange(len(mine)), np.flatnonzero((np.diff(mine) > longest) | (pace > most)) + 1)
        parted += len(parts) - 1
        size += sum(int((mine[part[-1]] - mine[part[0]]) / step) + 1 for part in parts)
        if size > MOST_ROWS:
            raise ValueError(f"{file}:1: has more than {MOST_ROWS} rows when gaps are filled in; there must be fewer")
        for k, part in enumerate(parts):
            since = mine[part] - mine[part[0]]
            at = step * np.arange(int(since[-1] / step + _ASTRAY) + 1)
            if len(at) < 2:
                continue
            between = np.column_stack([np.interp(at, since, axis) for axis in rows[part, 2:].T])
            filled += len(at) - len(np.unique(np.rint(since / step)))
            late, rest = divmod(int(mine[part[0]] - origin), step)
            name = f"{int(rows[0, 1])}" if k == 0 else f"{int(rows[0, 1])}.{k}"
            # a person annotated between the frames of others is moved to the next of theirs
            persons.append(Person(name, int(late) + (2 * rest > step), between))
    said = [f"{filled} missing rows are filled in along straight lines"] * bool(filled)
    parting = f"at {parted} gaps of more than {LONGEST_GAP:g} s, or jumps, a person leaves and another comes"
    said += [parting] * bool(parted)
    if said:
        warnings.warn(f"{file}: {', and '.join(said)}; rows are {step:g} frames apart", FileNote, stacklevel=2)
    _check_speed(file, persons, rate)
    return persons


def _step(apart: NDArray[np.int64]) -> float:
    """Returns how many frames are between rows: what is usual, or the mean where stamps tremble; 0: nobody has two."""
    if not len(apart):
        return 0
    sizes, often = np.unique(apart, return_counts=True)
    usual = int(sizes[often.argmax()])
    near = apart[np.abs(apart - usual) <= _ASTRAY * usual]
    return usual if often.max() >= 0.9 * len(near) else float(near.mean())


def _median(tracks: list[NDArray[np.float64]], paces: list[NDArray[np.float64]]) -> float:
    """Returns the median pace of those who get somewhere, as most of a queue do not; of all where nobody does."""
    walk = [pace for places, pace in zip(tracks, paces, strict=True) if np.ptp(places, axis=0).max() >= _AWAY]
    return float(np.median(np.concatenate([np.zeros(0), *(walk or paces)])))


def _check_speed(file: Path, people: list[Person], rate: float | None) -> None:
    """Checks that people walk as people do; warns where they walk as few do and nobody said how far apart rows are."""
    steps = [np.hypot(*np.diff(each.places, axis=0).T) for each in people]
    median = _median([each.places for each in people], steps) * (rate or RATE) if steps else 0.0
    pace = f"people walk at {median:.3g} m/s in the median, at {1.0 / (rate or RATE):g} s between rows"
    slow, usual, quick = _USUAL
    near = (rate or RATE) * usual / max(median, 1e-9)
    other = f"; name another rate, in rows a second, behind the file, such as {file.name}@{near:.3g}"
    other *= _RATES[0] <= near <= _RATES[1]
    if not _SLOW <= median <= FASTEST:
        raise ValueError(f"{file}:1: {pace}; it must be from {_SLOW:g} to {FASTEST:g} m/s: x and y must be in m{other}")
    if rate is None and not slow <= median <= quick:
        warnings.warn(f"{file}: {pace}{other} for {usual:g} m/s", FileNote, stacklevel=2)
