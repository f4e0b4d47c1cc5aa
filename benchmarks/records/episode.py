"""An episode as a typed record: the columns that its row has, and a table of many rows.

Text is at the edge alone: `results` reads and writes it. A table holds a column as one array: a number in eight bytes,
of a text that comes again a code, so that ten million episodes fit in memory (docs/scale.md). What is selected of a
table shares its columns.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from wayfield.system.checks import shown

Row = Mapping[str, Any]  # one episode: a value, or its text, by the name of its column

_T = TypeVar("_T")
_AT_ONCE = 4096  # rows that are taken in together


def text(value: float) -> str:
    """Returns a number so that reading it gives the same number; NaN is the empty cell, whole numbers have no point."""
    if math.isnan(value):
        return ""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of the episodes. A number that an episode has not is NaN, a text that it has not is empty."""

    name: str
    dtype: type[str] | type[int] | type[float]
    unit: str  # "" of texts, flags, shares and counts
    meaning: str
    written: Callable[[float], str] = text  # how its numbers stand in files


CONDITIONS = (
    Column("trajectory", str, "", "key of the episode in trajectories.npz; empty if the trajectory is not kept"),
    Column("suite", str, "", "suite of the run"),
    Column("contest", str, "", "contest or reference paper (A, B, C) of the episode; of a file, its kind of scenario"),
    Column("family", str, "", "family of the scenario, or its name in the paper or file"),
    Column("scenario", str, "", "name of the scenario in the environment"),
    Column("robot", str, "", "robot, by name or data sheet"),
    Column("disturbance", str, "", "level of disturbance"),
    Column("policy", str, "", "policy"),
    Column("gains_name", str, "", "origin of the gains: default, tuned, robust, hand-tuned, paper, trained"),
    Column("gains", str, "", "gains that differ from the policy's defaults"),
    Column("dynamics", str, "", "plant: kinematic, pymunk, mujoco or coppelia"),
    Column("actuators", str, "", "tier of the actuators"),
    Column("seed", int, "", "seed of the episode"),
    Column("episode", int, "", "number of the episode in its case; in contests the number of the scenario"),
    Column("arrival_radius", float, "m", "distance within which a waypoint counts as reached"),
    Column("split", str, "", "frozen split of the scenario, front, own or public"),
    Column("speed", float, "m/s", "cruising speed of a point of the speed-accuracy front"),
    Column("failure_cost", float, "that of the cost", "cost of a failed episode", repr),
    Column("knows", str, "", "input before the episode: path, map, bodies; sensors: none"),
    Column("parameters", str, "", "number of parameters of the policy"),
    Column("learned_from", str, "", "environment steps of the search or the training"),
    Column("agent_seed", str, "", "training seed of an agent"),
    Column("tier", str, "", "easy, medium or hard"),
    Column("quantity", float, "that of the family", "geometric quantity that defines the tier", repr),
)

METRICS = (  # in the order of the file
    Column("success", float, "", "1 if the task was solved"),
    Column("collision", float, "", "1 if a collision ended the episode"),
    Column("left_corridor", float, "", "1 if the robot left the corridor of the path"),
    Column("timeout", float, "", "1 if the time limit ended the episode"),
    Column("time", float, "s", "duration of the episode"),
    Column("path_length", float, "m", "length of the driven path"),
    Column("mean_speed", float, "m/s", "driven length over duration"),
    Column("completion", float, "", "largest share of the path that was driven"),
    Column("cross_track_rms", float, "m", "RMS cross-track error over the driven arc length"),
    Column("cross_track_rms_time", float, "m", "RMS cross-track error over time"),
    Column("cross_track_mean", float, "m", "mean absolute cross-track error over the driven arc length"),
    Column("cross_track_max", float, "m", "largest absolute cross-track error"),
    Column("cross_track_p95", float, "m", "95th percentile of the absolute cross-track error over the arc length"),
    Column("steady_offset", float, "m", "mean signed cross-track error over the last quarter of the arc length"),
    Column("heading_error_rms", float, "rad", "RMS heading error over the driven arc length"),
    Column("reference_jumps", float, "", "jumps of the reference point by more than 0.5 m"),
    Column("acquisition_time", float, "s", "settling time on the path"),
    Column("acquisition_area", float, "m s", "integral of the absolute cross-track error over the settling time"),
    Column("tracking_rms", float, "m", "RMS cross-track error over time after settling"),
    Column("min_clearance", float, "m", "smallest clearance"),
    Column("mean_clearance", float, "m", "mean clearance"),
    Column("near_share", float, "", "share of the time with a clearance under 0.1 m"),
    Column("centre_distance", float, "m", "smallest distance from the robot's centre to an obstacle's centre"),
    Column("final_x", float, "m", "x at the end"),
    Column("final_y", float, "m", "y at the end"),
    Column("final_x_error", float, "m", "absolute error in x at the end"),
    Column("final_y_error", float, "m", "absolute error in y at the end"),
    Column("final_position_error", float, "m", "distance to the goal at the end"),
    Column("final_heading_error", float, "rad", "absolute heading error at the end"),
    Column("effort", float, "rad^2/s", "integral of the squared wheel speeds"),
    Column("saturated_share", float, "", "share of the time with a saturated wheel"),
    Column("ldlj", float, "", "log dimensionless jerk; higher is smoother"),
    Column("squared_jerk", float, "m^2/s^5", "integral of the squared jerk"),
    Column("velocity_smoothness", float, "m/s^2", "mean absolute change of the speed; lower is smoother"),
    Column("faults", float, "", "number of decisions in which the policy used its fallback"),
    Column("spl", float, "", "success weighted by shortest over driven length"),
    Column("sct", float, "", "success weighted by fastest over driven time"),
    Column("barn_score", float, "", "score of the BARN challenge from 2024 on"),
    Column("barn_score_2022", float, "", "score of the BARN challenge of 2022"),
    Column("arrival_path_length", float, "m", "driven length at the last arrival"),
    Column("arrival_heading_error", float, "rad", "absolute heading error at the last arrival"),
)

# Of a world of several bodies, whose robots' metrics are means over them, but for the flags: success of all, collision
# of any. Gaps are between hulls.
OF_CROWDS = (
    Column("arrived", float, "", "share of the policy's robots that arrived"),
    Column("arrived_beside", float, "", "share of the other policy's robots that arrived, in cross-play"),
    Column("touched_wall", float, "", "share of the robots that hit a static obstacle"),
    Column("touched_robot", float, "", "share of the robots that hit a robot"),
    Column("touched_person", float, "", "share of the robots that hit a person"),
    Column("caused", float, "", "share of the robots that caused their collision, at more than 0.05 m/s"),
    Column("stuck", float, "", "share of the robots that timed out after moving less than 0.1 m in 10 s"),
    Column("deadlock", float, "", "1 if every robot that timed out was stuck"),
    Column("extra_time", float, "s", "time beyond the straight line at the target speed, mean of robots that arrived"),
    Column("extra_time_p75", float, "s", "the same, 75th percentile"),
    Column("extra_time_p90", float, "s", "the same, 90th percentile"),
    Column("makespan_ratio", float, "", "last arrival over the longest straight-line time at the target speed"),
    Column("flow_rate", float, "1/(m s)", "number of robots over gap width and last arrival"),
    Column("fairness", float, "", "Jain's index of straight-line time over time; failed robots count 0"),
    Column("least_gap", float, "m", "smallest gap to a body"),
    Column("least_gap_people", float, "m", "smallest gap to a person"),
    Column("intimate_share", float, "", "share of the time within 0.45 m of a person"),
    Column("close_share", float, "", "share of the time within 0.5 m of a person"),
    Column("personal_share", float, "", "share of the time within 1.2 m of a person"),
    Column("danger_share", float, "", "share of the time with a gap under 0.2 m to a person"),
    Column("intrusion", float, "", "share of the time where a person will be within 1.25 s"),
    Column("intrusion_gap", float, "m", "mean gap to the nearest person in that time"),
    Column("people_slowed", float, "m/s", "mean speed of the people without robots minus that with robots"),
    Column("people_extra_time", float, "s", "mean delay of the people at their goals because of robots"),
)

ARRIVALS = Column("arrival_time_N", float, "s", "time until waypoint N was reached; after the last waypoint, the goal")

COLUMNS: Mapping[str, Column] = {column.name: column for column in (*CONDITIONS, *METRICS, *OF_CROWDS)}


class Episodes(Sequence[Row]):
    """A table of episodes: `episodes["success"]` is a column, `episodes[3]` a row, a mask, slice or index more rows.

    A column that `COLUMNS` does not name holds numbers where all of its cells are numbers or empty, else texts. An
    integer that an episode has not is -1.

    Args:
        rows: values or their texts, taken one after the other and not kept; a row may lack columns.

    Raises:
        ValueError: if a column of numbers holds anything else; the message names row and column.
    """

    def __init__(self, rows: Iterable[Row] = ()) -> None:
        self._at: NDArray[np.int64] | None = None  # the rows of the columns that are its own; None: all
        self._columns, self._count = _taken(
            (
                {name: [row.get(name, "") for row in some] for name in dict.fromkeys(itertools.chain(*some))},
                len(some),
            )
            for some in _batches(rows)
        )

    @classmethod
    def of(cls, rows: Iterable[Row]) -> "Episodes":
        """Returns rows as a table; one that is a table already is itself."""
        return rows if isinstance(rows, cls) else cls(rows)

    @classmethod
    def of_lines(cls, names: Sequence[str], lines: Iterable[Sequence[str]]) -> "Episodes":
        """Returns the episodes of a table of texts, whose lines have as many cells as there are names."""
        episodes = cls()
        episodes._columns, episodes._count = _taken(
            (dict(zip(names, zip(*some, strict=True), strict=True)), len(some)) for some in _batches(lines)
        )
        return episodes

    @property
    def names(self) -> list[str]:
        """Returns the names of the columns, in the order in which they came up."""
        return list(self._columns)

    def __len__(self) -> int:
        return self._count if self._at is None else len(self._at)

    @overload
    def __getitem__(self, key: str) -> NDArray[Any]: ...
    @overload
    def __getitem__(self, key: int) -> Row: ...
    @overload
    def __getitem__(self, key: "slice | NDArray[Any]") -> "Episodes": ...
    def __getitem__(self, key: "str | int | slice | NDArray[Any]") -> "NDArray[Any] | Row | Episodes":
        if isinstance(key, str):
            column = self._columns[key]
            return column.values if self._at is None else column.take(self._at).values
        if isinstance(key, int):
            k = range(len(self))[key]
            return _View(self._columns, k if self._at is None else int(self._at[k]))
        part = Episodes()
        part._columns, part._count = self._columns, self._count
        part._at = (np.arange(self._count) if self._at is None else self._at)[key]
        return part

    def __iter__(self) -> Iterator[Row]:
        return (_View(self._columns, k) for k in (range(self._count) if self._at is None else self._at.tolist()))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Episodes):
            return NotImplemented
        return self.names == other.names and all(
            np.array_equal(mine, theirs, equal_nan=mine.dtype.kind == theirs.dtype.kind == "f")
            for mine, theirs in ((self[name], other[name]) for name in self.names)
        )

    __hash__ = None  # type: ignore[assignment]

    def numbers(self, name: str) -> NDArray[np.float64]:
        """Returns a column of numbers; NaN where there is no such column."""
        return self[name] if name in self._columns else np.full(len(self), np.nan)

    def texts(self, name: str) -> list[str]:
        """Returns the cells of a column as they stand in files; empty where there is no such column."""
        if name not in self._columns:
            return [""] * len(self)
        column, values = COLUMNS.get(name), self[name]
        if values.dtype.kind == "i":
            return ["" if value < 0 else str(value) for value in values.tolist()]
        if values.dtype.kind == "f":
            return list(map(column.written if column else text, values.tolist()))
        return list(values)

    def where(self, **cells: Any) -> "Episodes":
        """Returns the episodes whose columns hold what is given for them: a value, or one of a collection of values."""
        there = np.ones(len(self), np.bool_)
        for name, wanted in cells.items():
            several = isinstance(wanted, Collection) and not isinstance(wanted, str)
            there &= np.isin(*self._codes(name, list(wanted) if several else [wanted]))
        return self[np.flatnonzero(there)]

    def unique(self, name: str) -> list[Any]:
        """Returns the different values of a column, in the order in which they come up."""
        first = np.unique(self._codes(name)[0], return_index=True)[1]
        return list(self[np.sort(first)][name].tolist())

    def numbered(self, *names: str) -> NDArray[np.int64]:
        """Returns for each episode the number of its group: those with the same values in some columns are one."""
        number = np.zeros(len(self), np.int64)
        for name in names:
            distinct, inverse = np.unique(self._codes(name)[0], return_inverse=True)
            _, first, number = np.unique(number * len(distinct) + inverse, return_index=True, return_inverse=True)
            number = np.argsort(np.argsort(first))[number]  # in the order in which they come up
        return number

    def split(self, number: NDArray[np.int64]) -> "list[Episodes]":
        """Returns the episodes in groups, given the number of each one's group, in their order."""
        order = np.argsort(number, kind="stable")
        ends = np.cumsum(np.bincount(number))
        return [self[part] for part in np.split(order, ends[:-1])] if len(self) else []

    def groups(self, *names: str) -> "dict[Any, Episodes]":
        """Returns the episodes by the value that they have in a column, or their values in several.

        Groups, and the episodes in them, stand in the order in which they come up.
        """
        groups = self.split(self.numbered(*names))
        keys = (tuple(group[0][name] for name in names) for group in groups)
        return {key if len(names) > 1 else key[0]: group for key, group in zip(keys, groups, strict=True)}

    def with_column(self, name: str, cells: Sequence[Any]) -> "Episodes":
        """Returns the episodes with a column in place of the one of that name, or behind all."""
        given, count = _taken([({name: cells}, len(cells))])
        if count != len(self):
            raise ValueError(f"column {name!r} has {count} cells for {len(self)} episodes")
        wider = Episodes()
        mine = self._columns if self._at is None else {key: each.take(self._at) for key, each in self._columns.items()}
        wider._columns, wider._count = mine | given, count
        return wider

    def _codes(self, name: str, wanted: Sequence[Any] = ()) -> tuple[NDArray[Any], NDArray[Any]]:
        """Returns a column as numbers that are equal where its values are, and those of the values that are wanted."""
        column = self._columns[name]
        held = column.held if self._at is None else column.held[self._at]
        if column.words is None:
            return held, np.asarray(wanted)
        return held, np.flatnonzero([word in wanted for word in column.words] if wanted else ())


class _View(Mapping[str, Any]):
    """A row of `Episodes`, which is no more than where it stands."""

    __slots__ = ("_columns", "_k")

    def __init__(self, columns: "dict[str, _Held]", k: int) -> None:
        self._columns, self._k = columns, k

    def __getitem__(self, name: str) -> Any:
        column = self._columns[name]
        value = column.held[self._k].item()
        return value if column.words is None else column.words[value]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


@dataclasses.dataclass(frozen=True)
class _Held:
    """A column: its numbers, or a code for each of its words."""

    held: NDArray[Any]
    words: NDArray[np.object_] | None

    def take(self, at: NDArray[np.int64]) -> "_Held":
        return _Held(self.held[at], self.words)

    @property
    def values(self) -> NDArray[Any]:
        return self.held if self.words is None else self.words[self.held]


def _batches(given: Iterable[_T]) -> Iterator[list[_T]]:
    """Yields the things together, some at a time."""
    rest = iter(given)
    while some := list(itertools.islice(rest, _AT_ONCE)):
        yield some


def _taken(batches: Iterable[tuple[Mapping[str, Sequence[Any]], int]]) -> tuple[dict[str, _Held], int]:
    """Returns the columns of batches, each of which has some columns and a number of rows; and the number of all."""
    columns: dict[str, _Taking] = {}
    count = 0
    for batch, more in batches:
        for name in batch:
            if name not in columns:
                columns[name] = _Taking(name)
                columns[name].take([""] * count, 0)
        for name, column in columns.items():
            column.take(batch[name] if name in batch else [""] * more, count)
        count += more
    return {
        name: columns.pop(name).held() for name in list(columns)
    }, count  # a column's parts go before the next is made


def _constant(numbers: NDArray[Any]) -> NDArray[Any]:
    """Returns numbers, in the room of one where all are the same, as in a column that does not apply."""
    first = numbers[:1].copy()
    same = np.array_equal(numbers, np.broadcast_to(first, numbers.shape), equal_nan=True)
    return np.broadcast_to(first, numbers.shape) if same else numbers


class _Taking:
    """A column that takes in cells."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._dtype = COLUMNS[name].dtype if name in COLUMNS else None
        self._parts: list[NDArray[Any]] = []
        self._codes: dict[str, int] = {}

    def take(self, cells: Sequence[Any], before: int) -> None:
        """Takes in further cells, behind so many others."""
        if self._dtype in (float, int):
            self._parts.append(self._numbers(cells, before))
            return
        codes = self._codes
        words = (cell if isinstance(cell, str) else text(cell) for cell in cells)
        taken = np.array([codes.setdefault(word, len(codes)) for word in words], np.uint32)
        self._parts.append(taken.astype(np.min_scalar_type(max(len(codes) - 1, 0))))

    def _numbers(self, cells: Sequence[Any], before: int) -> NDArray[Any]:
        """Returns cells as numbers; ValueError if one is none."""
        read, none, dtype = (int, -1, np.int64) if self._dtype is int else (float, math.nan, np.float64)
        k = 0
        try:
            numbers = np.empty(len(cells), dtype)
            for k, cell in enumerate(cells):
                numbers[k] = none if cell == "" else read(cell)
        except (OverflowError, ValueError):
            raise ValueError(
                f"row {before + k + 1}: column {self._name!r} holds {shown(cells[k])}; it must be "
                f"a {'whole ' * (read is int)}number or empty"
            ) from None
        numbers += 0  # no negative zeros
        return _constant(numbers)

    def held(self) -> _Held:
        """Returns the column of all that was taken in."""
        held = np.concatenate(self._parts)
        if self._dtype in (float, int) and held.size and all(part.strides == (0,) for part in self._parts):
            held = _constant(held)
        if self._dtype in (float, int):
            return _Held(held, None)
        if self._dtype is None:
            try:
                return _Held(np.array([float(word or math.nan) for word in self._codes])[held], None)
            except ValueError:
                pass
        return _Held(held, np.array([*self._codes], np.object_))
