"""Recordings of drives: bags of ROS 1 and ROS 2, and tables of comma-separated values. ROS itself is not needed.

Messages are read by their standard definitions. Those that a bag brings along are code to the library that reads bags,
and stay unread.
"""

import contextlib
import csv
import dataclasses
import hashlib
import importlib.util
import io
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.identify.response import Floats
from wayfield.system.checks import choose, printable, repeated, shown
from wayfield.system.extras import installs
from wayfield.system.objects import fault, read_text
from wayfield.system.readers import of_path, reader

STAMPS = ("auto", "header", "arrival")
COMMANDS = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
ODOMETRY = ("nav_msgs/msg/Odometry",)
POSES = ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
SCANS = ("sensor_msgs/msg/LaserScan",)
MOST_MESSAGES = 5_000_000  # of a topic
MOST_SCANS = 2000  # that are kept, of those at rest; more say no more of their noise
MOST_BEAMS = 20_000  # of a scan; those of more say nothing of a lidar, and none is read
COLUMNS = ("t", "v_cmd", "w_cmd", "v", "w", "x", "y", "heading")
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|[^A-Za-z_\s./\[\]()-]")  # of a header, camel case apart; "°" is one
_NANOSECONDS = {"nsec", "nsecs", "nanosec", "nanosecs"}  # beside a column of whole seconds
_COMMANDED, _MEASURED = {"cmd", "command", "commanded"}, {"odom", "odometry", "measured"}
_SPELT: Mapping[str, tuple[set[str], ...]] = {  # of COLUMNS, the words that a header may have for each
    "t": ({"t"}, {"time"}, {"timestamp"}, {"stamp"}),
    "v": ({"v"}, {"vx"}, {"v", "x"}, {"vel", "x"}, {"linear", "x"}, {"vel", "linear", "x"}),
    "w": (
        {"w"}, {"wz"}, {"w", "z"}, {"omega"}, {"omega", "z"}, {"yaw", "rate"}, {"yawrate"}, {"angular", "z"},
        {"vel", "angular", "z"},
    ),
}  # fmt: skip
_UNITS: Mapping[str, Mapping[str, float]] = {
    "t": {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "v": {"": 1.0, "m/s": 1.0, "mps": 1.0, "km/h": 1 / 3.6, "kmh": 1 / 3.6, "kph": 1 / 3.6, "cm/s": 0.01, "mm/s": 1e-3},
    "w": {"": 1.0, "rad/s": 1.0, "rads": 1.0, **dict.fromkeys(("deg/s", "degs", "dps", "°/s"), math.pi / 180.0)},
}
ECHOED = {9: {"v_cmd": 3, "w_cmd": 8}, 89: {"v": 47, "w": 52}}  # cells of a TwistStamped and of an Odometry


@dataclasses.dataclass(frozen=True)
class Topics:
    """The topics of a bag that are read."""

    cmd: str = "/cmd_vel"
    odom: str = "/odom"
    truth: str | None = None
    scan: str | None = "/scan"


@dataclasses.dataclass(frozen=True)
class Log:
    """What was recorded of a drive; times in seconds from its first message on."""

    name: str  # of the file
    digest: str  # SHA-256 of what was read
    stamps: str  # "header", "arrival" or "table": what the times are
    command_times: Floats  # (m,)
    commands: Floats  # (m, 2) m/s and rad/s
    times: Floats  # (n,) of odometry
    speeds: Floats  # (n, 2) its twist
    poses: Floats = dataclasses.field(
        default_factory=lambda: np.empty((0, 3))
    )  # (n, 3) its x, y, heading; none in a table
    truth_times: Floats = dataclasses.field(default_factory=lambda: np.empty(0))  # (k,)
    truth: Floats = dataclasses.field(default_factory=lambda: np.empty((0, 3)))  # (k, 3)
    scan_times: Floats = dataclasses.field(default_factory=lambda: np.empty(0))  # (s,)
    scans: Floats = dataclasses.field(default_factory=lambda: np.empty((0, 0)))  # (s, beams) m
    skew: float = 0.0  # s, by which commands arrive later after their stamps than odometry after its own


def read_log(files: Sequence[str | Path], topics: Topics | None = None, stamps: str = "auto") -> Log:
    """Returns the recording of a bag, or of one or two tables.

    Args:
        files: one bag: a .bag of ROS 1, a folder of ROS 2 with sqlite3 or MCAP, a bare .mcap or .db3; or one or two
            .csv.
        topics: of a bag.
        stamps: "header" or "arrival"; "auto" takes headers where commands and odometry have them, not left
            at 0, else arrivals for all.

    Raises:
        ValueError: in one line, if the file is none of those, damaged, lacks a topic, or holds what is no number.
        OSError: if it cannot be opened.
        ModuleNotFoundError: if it is a bag, and rosbags is not installed.
    """
    choose("stamps", stamps, STAMPS)
    paths = [Path(each) for each in files]
    for path in paths:
        if not path.exists():
            raise FileNotFoundError(2, "there is no such file", str(path))
    if all(path.suffix.lower() == ".csv" for path in paths):
        if len(paths) > 2:
            raise ValueError(f"{len(paths)} tables were given; a drive is one or two")
        return read_tables(*paths)
    if len(paths) > 1:
        raise ValueError("a bag stands alone; only tables (.csv) may be two")
    return read_bag(paths[0], topics or Topics(), stamps)


_TABLE = "t,v_cmd,w_cmd,v,w\n0.0,0,0,0,0\n0.1,0.5,0.1,0,0\n0.2,0.5,0.1,0.2,0.05\n"


@reader("table of a drive", "drive.csv", {"drive.csv": _TABLE}, of_path)
def read_tables(file: Path, other: Path | None = None) -> Log:
    """Returns the recording of one or two tables with the columns t, v_cmd, w_cmd and t, v, w.

    A row belongs to the commands if it has both of theirs, and likewise to the odometry; x, y and heading (rad) are a
    true pose. What `ros2 topic echo --csv` writes of TwistStamped and Odometry is taken as well.

    Time and speeds may be called otherwise: see `_column`.

    Raises:
        ValueError: in one line that starts with file:line, if a column is missing or a cell is no number.
        OSError: if a file cannot be opened.
    """
    rows: dict[tuple[str, ...], list[list[float]]] = {COLUMNS[1:3]: [], COLUMNS[3:5]: [], COLUMNS[5:]: []}
    sha = hashlib.sha256()
    for path in (file, other) if other is not None else (file,):
        text = read_text(str(path))
        sha.update(text.encode())
        for line, cells, units in _cells(path, text):
            for names, table in rows.items():
                values = [cells.get(name, "") for name in ("t", *names)]
                if all(values):
                    numbers = [
                        _number(f"{path}:{line}", name, cell) * units.get(name, 1.0)
                        for name, cell in zip(("t", *names), values, strict=True)
                    ]
                    table.append(numbers)
    for names, what in ((COLUMNS[1:3], "commands"), (COLUMNS[3:5], "odometry")):
        if not rows[names]:
            raise ValueError(
                f"{file}: holds no {what}; name columns {', '.join(('t', *names))} in the first line of a table, "
                f"here {shown(text.partition(chr(10))[0].strip())}, with units that are not SI, such as v_cmd (km/h)"
            )
    commands, odometry, truth = (np.array(table).reshape(len(table), 1 + len(names)) for names, table in rows.items())
    start = min(commands[0, 0], odometry[0, 0])
    return Log(
        file.name if other is None else f"{file.name}, {other.name}", sha.hexdigest(), "table",
        commands[:, 0] - start, np.ascontiguousarray(commands[:, 1:]),
        odometry[:, 0] - start, np.ascontiguousarray(odometry[:, 1:]),
        truth_times=truth[:, 0] - start, truth=truth[:, 1:],
    )  # fmt: skip


def _column(name: str) -> tuple[str, float] | None:
    """Returns which of COLUMNS a table calls so, and its unit in those of SI; None where none, or it is not sure.

    Other words for time and speeds are in `_SPELT`, with "cmd" or "command" beside those of a command. A unit may stand
    behind: time_ms, "v (km/h)", w_deg_s. Whether linear.x is a command or not, "cmd" or "odom" beside it must say.
    """
    words = [each.lower() for each in _WORD.findall(name)]
    commanded = not _COMMANDED.isdisjoint(words)
    measured = not _MEASURED.isdisjoint(words) or words.count("twist") == 2  # as in the messages of odometry
    unsure = commanded == measured and (commanded or not {"linear", "angular"}.isdisjoint(words))
    for end in () if unsure else range(len(words), 0, -1):
        own = set(words[:end]) - _COMMANDED - _MEASURED - {"twist"}
        for column, spellings in _SPELT.items():
            unit = _UNITS[column].get("/".join(words[end:]))
            if unit is not None and own in spellings and not (column == "t" and (commanded or measured)):
                return f"{column}_cmd" if commanded else column, unit
    return None


def _header(path: Path, names: Sequence[str]) -> dict[int, tuple[str, float]]:
    """Returns the columns of a table by their place, each with its unit; ValueError where one comes twice."""
    if parts := [name for name in names if not _NANOSECONDS.isdisjoint(_WORD.findall(name.lower()))]:
        raise ValueError(f"{path}:1: {shown(parts[0])} is a part of a time; write one column t, s, with decimals")
    known = {k: (name, 1.0) for k, name in enumerate(names) if name in COLUMNS}
    exact = {name for name, _ in known.values()}
    for k, name in enumerate(names):
        if k not in known and (found := _column(name)) is not None and found[0] not in exact:
            known[k] = found
    if twice := repeated(name for name, _ in known.values()):
        both = " and ".join(shown(names[k]) for k, (name, _) in known.items() if name == twice)
        raise ValueError(f"{path}:1: the columns {both} could all be {twice}; name one of them {twice}")
    return known


def _cells(path: Path, text: str) -> Iterator[tuple[int, dict[str, str], dict[str, float]]]:
    """Yields each row of a table with its line, by the names of its columns, and the units of those."""
    try:
        separator = next((each for each in ";\t" if each in text.partition("\n")[0]), ",")
        rows = csv.reader(io.StringIO(text), delimiter=separator, strict=True)
        header = [each.strip() for each in next(rows, [])]
        known = _header(path, header)
        timed = any(name == "t" for name, _ in known.values())
        if not timed and len(header) in ECHOED:
            for row in itertools.chain([header], filter(None, rows)):
                if len(row) != len(header) or not (row[0] + row[1]).isdigit():
                    raise ValueError(f"{path}:{rows.line_num}: is no message as line 1, which ros2 topic echo wrote")
                numbers = {name: row[place] for name, place in ECHOED[len(header)].items()}
                yield rows.line_num, {"t": f"{row[0]}.{row[1]:0>9}", **numbers}, {}
            return
        if not timed:
            bare = len(header) == 6 and header[0][:1] in "-.0123456789"
            timeless = "; a Twist that ros2 topic echo wrote has no time: record a bag" if bare else ""
            raise ValueError(
                f"{path}:1: columns are {shown(header)}; they must be some of {', '.join(COLUMNS)}, named in the "
                f"first line, each once{timeless}"
            )
        units = dict(known.values())
        for row in rows:
            if not row:
                continue
            if len(row) != len(header):
                raise ValueError(f"{path}:{rows.line_num}: has {len(row)} cells; the header has {len(header)}")
            yield rows.line_num, {name: row[k].strip() for k, (name, _) in known.items()}, units
    except csv.Error as error:
        raise ValueError(f"{path}:{rows.line_num}: {error}") from None


def _number(place: str, name: str, cell: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        pointed = " with a decimal point" if "," in cell else ""
        raise ValueError(f"{place}: {name} is {shown(cell)}; it must be a finite number{pointed}")
    return number


def _sample_bag(folder: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    kinds: Any = store.types
    vector, stamp = kinds["geometry_msgs/msg/Vector3"], kinds["builtin_interfaces/msg/Time"]
    twist = kinds["geometry_msgs/msg/Twist"](vector(0.1, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    header = kinds["std_msgs/msg/Header"](stamp(1, 0), "odom")
    pose = kinds["geometry_msgs/msg/Pose"](
        kinds["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    odometry = kinds["nav_msgs/msg/Odometry"](
        header, "base_link",
        kinds["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
        kinds["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
    )  # fmt: skip
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, message in (("/cmd_vel", twist), ("/odom", odometry)):
            connection = writer.add_connection(topic, message.__msgtype__, typestore=store)
            for k in range(3):
                writer.write(connection, 10**9 * (k + 1), store.serialize_cdr(message, message.__msgtype__))
    (folder / "bag" / "bag.mcap").rename(folder / "drive.mcap")


def _read_sample(function: Any, file: Path) -> Any:
    return function(file, Topics(), "auto")


@reader("bag of a drive", "drive.mcap", _sample_bag, _read_sample)
def read_bag(file: Path, topics: Topics, stamps: str = "auto") -> Log:
    """Returns the recording of a bag; see `read_log`."""
    if importlib.util.find_spec("rosbags") is None:
        raise ModuleNotFoundError(f"{file}: bags are read by rosbags: {installs('bags')}", name="rosbags")
    with _opened(file) as (source, deserialize):
        there = {each.topic: each.msgtype for each in source.connections}
        wanted = {topics.cmd: COMMANDS, topics.odom: ODOMETRY}
        if topics.truth is not None:
            wanted[topics.truth] = POSES
        for topic, kinds in wanted.items():
            _check_topic(file, topic, kinds, source.connections)
        if topics.scan is not None and there.get(topics.scan) in SCANS:
            wanted[topics.scan] = SCANS
        messages = _messages(file, source, deserialize, wanted, stamps)
    commands, odometry = messages[topics.cmd], messages[topics.odom]
    start = min(commands[0][0, 0], odometry[0][0, 0])
    truth = messages.get(topics.truth or "", (np.empty((0, 4)),))[0]
    scans = messages.get(topics.scan or "", (np.empty((0, 1)),))[0]
    late, other = (each[2] - each[0][:, 0] for each in (commands, odometry))
    skew = float(np.median(late - np.interp(commands[2], odometry[2], other)))
    return Log(
        file.name, _digest(file), commands[1], commands[0][:, 0] - start, np.ascontiguousarray(commands[0][:, 1:]),
        odometry[0][:, 0] - start, np.ascontiguousarray(odometry[0][:, 1:3]), odometry[0][:, 3:],
        truth[:, 0] - start, truth[:, -3:], scans[:, 0] - start, scans[:, 1:],
        skew,
    )  # fmt: skip


def _digest(file: Path) -> str:
    """Returns the SHA-256 of a bag, of a folder that of its files in order."""
    sha = hashlib.sha256()
    for each in sorted(file.rglob("*")) if file.is_dir() else [file]:
        if each.is_file():
            with open(each, "rb") as stream:
                while block := stream.read(2**20):
                    sha.update(block)
    return sha.hexdigest()


@contextlib.contextmanager
def _opened(file: Path) -> Iterator[tuple[Any, Any]]:
    """Opens a bag; yields its reader, and what makes messages of its bytes.

    Raises:
        ValueError: in one line, whatever the library raises for a damaged file, there or while it is read.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys import Stores, get_typestore

    first = file.suffix == ".bag"
    if not first and not file.is_dir() and file.suffix not in (".mcap", ".db3"):
        raise fault(str(file), "is no recording; it must be a .bag, a folder of ROS 2, an .mcap, a .db3 or a .csv")
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.LATEST)
    try:
        source: Any = Reader1(file) if first else Reader2(file)
        with source:
            yield source, store.deserialize_ros1 if first else store.deserialize_cdr
    except (_Refused, OSError, MemoryError) as error:
        if isinstance(error, MemoryError):
            raise ValueError(f"{file}: is larger than the memory of this machine") from None
        if isinstance(error, _Refused):
            raise ValueError(*error.args) from None
        if file.is_dir() and not (file / "metadata.yaml").is_file():
            raise fault(str(file), "is a folder without metadata.yaml; a recording of ROS 2 has one") from None
        raise
    except Exception as error:  # the library has no one error for damaged files: struct's, zlib's, apsw's, its own
        why = printable(" ".join(f"{type(error).__name__}: {error}".split()))[:160]
        raise ValueError(f"{file}: is damaged or was not closed, and cannot be read ({why})") from None


class _Refused(Exception):
    """What is wrong with a bag that can be read."""


def _check_topic(file: Path, topic: str, kinds: Sequence[str], connections: Sequence[Any]) -> None:
    """Raises _Refused unless a topic is there, of one of the kinds, with messages."""
    matching = [each for each in connections if each.topic == topic]
    if not matching:
        there = ", ".join(sorted({f"{each.topic} ({each.msgtype})" for each in connections})) or "none"
        raise _Refused(f"{file}: has no topic {topic}; its topics are {there}")
    for each in matching:
        if each.msgtype not in kinds:
            raise _Refused(f"{file}: topic {topic} is of type {each.msgtype}; it must be {' or '.join(kinds)}")
    if not sum(each.msgcount for each in matching):
        raise _Refused(f"{file}: topic {topic} has no messages")


def _messages(
    file: Path, source: Any, deserialize: Any, wanted: Mapping[str, Sequence[str]], stamps: str
) -> dict[str, tuple[Floats, str, Floats]]:
    """Returns the rows (n, 1 + columns) of each topic, time first in s, what the times are, and the arrivals (n,) s."""
    connections = [each for each in source.connections if each.topic in wanted]
    stamped = all(each.msgtype != COMMANDS[0] for each in connections)
    if stamps == "header" and not stamped:
        plain = next(each.topic for each in connections if each.msgtype == COMMANDS[0])
        raise _Refused(f"{file}: --stamps header, but {plain} is of type {COMMANDS[0]}, which has no header")
    by_header = stamped if stamps == "auto" else stamps == "header"
    rows: dict[str, list[NDArray[Any]]] = {topic: [] for topic in wanted}
    arrivals: dict[str, list[float]] = {topic: [] for topic in wanted}
    for connection, arrival, raw in source.messages(connections=connections):
        rows_of = rows[connection.topic]
        if wanted[connection.topic] is SCANS and len(rows_of) >= MOST_SCANS:
            continue
        if len(rows_of) >= MOST_MESSAGES:
            raise _Refused(f"{file}: topic {connection.topic} has more than {MOST_MESSAGES} messages")
        if wanted[connection.topic] is SCANS and len(raw) > 8 * MOST_BEAMS + 1000:  # ranges and intensities
            raise _Refused(
                f"{file}: a scan of topic {connection.topic} has {len(raw)} bytes; scans of at most {MOST_BEAMS} beams "
                "are read: name another topic, such as --scan none"
            )
        message = deserialize(raw, connection.msgtype)
        stamp = message.header.stamp if by_header else None
        nanoseconds = arrival if stamp is None else stamp.sec * 10**9 + stamp.nanosec
        rows_of.append(np.array([1e-9 * nanoseconds, *_values(message, connection.msgtype)]))
        arrivals[connection.topic].append(1e-9 * arrival)
    results = {}
    for topic, rows_of in rows.items():
        if not rows_of and topic in wanted and wanted[topic] is not SCANS:
            raise _Refused(f"{file}: topic {topic} has no messages")
        widths = {len(each) for each in rows_of}
        if len(widths) > 1:  # scans of several sizes
            rows_of = [each for each in rows_of if len(each) == max(widths)]
        table = np.array(rows_of) if rows_of else np.empty((0, 1))
        if wanted[topic] is not SCANS and not np.isfinite(table).all():
            at = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
            raise _Refused(
                f"{file}: message {at} of topic {topic} holds {shown(table[at, 1:].tolist())}; all must be finite"
            )
        if by_header and wanted[topic] is not SCANS and not table[:, 0].any():  # headers that nobody filled in
            if stamps == "header":
                raise _Refused(f"{file}: --stamps header, but all those of topic {topic} are 0")
            return _messages(file, source, deserialize, wanted, "arrival")
        results[topic] = table, "header" if by_header else "arrival", np.array(arrivals[topic])
    return results


def _values(message: Any, kind: str) -> Sequence[float] | Floats:
    """Returns the numbers of a message: a twist, a twist and pose, a pose, or ranges."""
    if kind in SCANS:
        ranges = np.asarray(message.ranges, np.float64)  # many drivers write a number out of range for "no return"
        return np.where((ranges >= message.range_min) & (ranges < message.range_max), ranges, np.inf)
    if kind in COMMANDS:
        twist = message.twist if kind == COMMANDS[1] else message
        return [twist.linear.x, twist.angular.z]
    pose = message.pose if kind == POSES[1] else message.pose.pose
    q = pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    place = [pose.position.x, pose.position.y, heading]
    return [message.twist.twist.linear.x, message.twist.twist.angular.z, *place] if kind in ODOMETRY else place
