"""The worlds of the BARN challenge, from the files that its makers publish.

A folder holds `world_N.world` (Gazebo's SDF, of cylinders) and `path_N.npy`, itself or in folders below it, as the
repositories of the challenge and of the data set have them; or, in place of worlds, the table `cylinders.csv.gz` with
the columns world, x_m, y_m, radius_m.

Source: Perille, Truong, Xiao and Stone, Benchmarking metric ground navigation, SSRR 2020; the challenge's run.py.
"""

import csv
import functools
import gzip
import math
import os
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.scenarios.arrays import stored_array
from wayfield.envs.scenarios.obstacles import box, circle, obstacle_field
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.system.checks import FARTHEST, MOST_BYTES, MOST_OBSTACLES, MOST_POINTS, real, shown
from wayfield.system.objects import check_ordinary, fault, state_of
from wayfield.system.readers import reader
from wayfield.system.unpacking import rows

CYLINDERS = "cylinders.csv.gz"
START = (-2.25, 3.0, math.pi / 2)  # x, y (m), heading (rad)
GOAL = (-2.25, 13.0, math.pi / 2)
TOLERANCE = 1.0  # m
CELL = 0.15  # m, of the grid that paths are given on: twice the cylinders' radius
FIRST_CELL = (-4.575, 5.075)  # m, x of row 0 and y of column 0
DEEPEST = 64  # elements in elements of a world file
MOST_FILES = 100_000  # that a folder is searched for worlds in

_WORLD, _PATH = re.compile(r"world_(\d{1,6})\.world"), re.compile(r"path_(\d{1,6})\.npy")
_NUMBERS = ("x", "y", "radius")
_LONGEST = 4096  # bytes of a line of the table
_HARMLESS = ("model://sun", "model://ground_plane")  # what a world may include: a robot does not run into it
# attributes of a pose, with the values that leave it what it is without them
_PLAIN_POSE = {
    "frame": ("",),
    "relative_to": ("",),
    "degrees": ("false", "0"),
    "rotation_format": ("euler_rpy",),
}


def barn_scenarios(folder: str | os.PathLike[str]) -> tuple[GoalScenario, ...]:
    """Returns the challenge's scenario in each world of a folder, by the worlds' numbers.

    From (-2.25, 3) facing +y to within 1 m of the point 10 m ahead; the published length is that of the world's path
    with the legs from the start and to the goal.

    Raises:
        ValueError: if there are no worlds, one has no path, or a file is faulty; one line that names file and field.
        OSError: if a file cannot be opened.
    """
    folder = Path(os.path.abspath(folder))
    worlds, paths = _listed(folder, _WORLD), _listed(folder, _PATH)
    table = folder / CYLINDERS
    files = (*worlds.values(), *paths.values(), *([table] if table.is_file() else []))
    return _scenarios(str(folder), tuple(map(state_of, files)))


@functools.lru_cache(maxsize=8)
def _scenarios(folder: str, states: tuple[tuple[str, int, int, int, int], ...]) -> tuple[GoalScenario, ...]:
    """Returns the scenarios of a folder whose files are in these states."""
    files = [Path(name) for name, *_ in states]
    paths = {int(match[1]): file for file in files if (match := _PATH.fullmatch(file.name))}
    obstacles: dict[int, list[np.void]] = {}
    sources: dict[int, Path] = {}
    for file in files:
        if file.name == CYLINDERS:
            obstacles |= read_cylinders(file)
            sources = dict.fromkeys(obstacles, file)
    for file in files:
        if match := _WORLD.fullmatch(file.name):
            obstacles[int(match[1])], sources[int(match[1])] = read_world(file), file
    if not obstacles:
        raise ValueError(
            f"{folder}: holds no worlds of the BARN challenge: no world_N.world and no {CYLINDERS}; people are .txt"
        )
    made = []
    for world in sorted(obstacles):
        if world not in paths:
            raise ValueError(
                f"{folder}: path_{world}.npy is missing, the published path of world {world} ({sources[world]})"
            )
        try:
            made.append(
                GoalScenario(
                    f"world_{world}",
                    GOAL,
                    START,
                    obstacles=obstacle_field(*obstacles[world]),
                    position_tolerance=TOLERANCE,
                    heading_tolerance=math.pi,
                    published_length=way_length(read_path(paths[world])),
                )
            )
        except ValueError as error:
            raise fault(str(sources[world]), f"world {world}: {error}") from None
    return tuple(made)


def way_length(cells: NDArray[Any]) -> float:
    """Returns the length (m) of a published path of cells (n, 2), with the legs from the start and to the goal."""
    points = np.vstack([START[:2], CELL * cells + FIRST_CELL, GOAL[:2]])
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _files(folder: Path) -> Iterator[Path]:
    """Yields the files of a folder and of those below it."""
    count = 0
    for place, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            count += 1
            if count > MOST_FILES:
                raise ValueError(f"{folder}: holds more than {MOST_FILES} files; it must be the folder of the worlds")
            yield Path(place) / name


def _listed(folder: Path, pattern: re.Pattern[str]) -> dict[int, Path]:
    """Returns the files of a name with a number, by the number; ValueError where two have the same."""
    files: dict[int, Path] = {}
    for file in _files(folder):
        if match := pattern.fullmatch(file.name):
            number = int(match[1])
            if number in files:
                raise ValueError(f"{folder}: holds {files[number]} and {file}; it must hold one of each number")
            files[number] = file
    return files


def _sample_table(folder: Path) -> None:
    rows = ["world,x_m,y_m,radius_m", "0,-2,8,0.1", "0,-3,7,0.1", "1,-2.5,8,0.1"]
    (folder / CYLINDERS).write_bytes(gzip.compress("\n".join(rows).encode()))
    _sample_paths(folder, 2)


def _sample_paths(folder: Path, count: int) -> None:
    for world in range(count):
        np.save(folder / f"path_{world}.npy", np.array([[15, 0], [15, 10], [16, 20], [15, 29]]))


@reader("BARN worlds of a table", CYLINDERS, _sample_table, lambda _, file: barn_scenarios(file.parent))
def read_cylinders(file: Path) -> dict[int, list[np.void]]:
    """Returns the obstacles of each world of a gzipped table.

    Raises:
        ValueError: if the file is no such table; the message names the line.
        OSError: if it cannot be opened.
    """
    worlds: dict[int, list[np.void]] = {}
    place = 0  # the last line that was read whole
    check_ordinary(file, f"{file}:1:")
    try:
        with gzip.open(file, "rb") as stream:
            lines = rows(stream, _LONGEST, MOST_BYTES)
            names = next(lines, [])
            for place, cells in enumerate(lines, 2):
                row = dict(zip(names, cells, strict=False))
                if place > MOST_POINTS:
                    raise ValueError(f"{file} has more than {MOST_POINTS} lines, which no set of worlds has")
                try:
                    world, numbers = int(row["world"]), {name: float(row[f"{name}_m"]) for name in _NUMBERS}
                except (KeyError, TypeError, ValueError):
                    raise ValueError(
                        f"{file}:{place}: {shown(row)} lacks a number world, x_m, y_m or radius_m"
                    ) from None
                try:
                    worlds.setdefault(world, []).append(circle(**numbers))
                except ValueError as error:
                    raise ValueError(f"{file}:{place}: {error}") from None
    except csv.Error as error:
        raise ValueError(f"{file}:{place + 1}: {error}") from None
    except (gzip.BadGzipFile, zlib.error, EOFError, UnicodeDecodeError) as error:
        raise ValueError(f"{file}:{place + 1}: it is no gzipped table: {error}") from None
    if not worlds:
        raise ValueError(f"{file}: holds no cylinders")
    return worlds


_SAMPLE_WORLD = """<sdf version='1.6'><world name='default'>
<model name='ground_plane'><static>1</static><link name='link'><collision name='collision'><geometry><plane><normal>
0 0 1</normal><size>100 100</size></plane></geometry></collision></link></model>
<model name='unit_cylinder_0'><static>1</static><pose frame=''>-0.075 0.075 0 0 0 0</pose><link name='link'>
<collision name='collision'><geometry><cylinder><radius>0.075</radius><length>1</length></cylinder></geometry>
</collision></link></model>
<model name='unit_box_0'><pose>-3 8 0 0 0 0.5</pose><link name='link'><pose>0.1 0 0 0 0 0</pose>
<collision name='collision'><geometry><box><size>0.3 0.2 1</size></box></geometry></collision></link></model>
</world></sdf>"""


def _sample_folder(folder: Path) -> None:
    (folder / "world_0.world").write_text(_SAMPLE_WORLD, encoding="utf-8")
    _sample_paths(folder, 1)


class _Element:
    """An element of an XML file: its name, its line, its attributes, the text in it, what it holds."""

    __slots__ = ("attributes", "line", "name", "parts", "text")

    def __init__(self, name: str, line: int, attributes: dict[str, str]) -> None:
        self.name, self.line, self.attributes, self.text = name, line, attributes, ""
        self.parts: list[_Element] = []

    def named(self, name: str) -> Iterator["_Element"]:
        """Yields the parts of that name."""
        return (part for part in self.parts if part.name == name)


@reader("BARN world", "world_0.world", _sample_folder, lambda _, file: barn_scenarios(file.parent))
def read_world(file: Path) -> list[np.void]:
    """Returns the obstacles of a Gazebo world: the cylinders and boxes that its models collide with.

    The ground plane is none, and the saved state at the end of the file, which repeats the poses, is not read.

    Raises:
        ValueError: if the file is no such world; one line that starts with file:line.
        OSError: if it cannot be opened.
    """
    check_ordinary(file, f"{file}:1:")
    size = os.path.getsize(file)
    if size > MOST_BYTES:
        raise ValueError(f"{file}:1: holds {size} bytes; it must be at most {MOST_BYTES}")
    with open(file, "rb") as stream:
        root = _tree(file, stream.read(MOST_BYTES))
    worlds = list(root.named("world")) if root.name == "sdf" else []
    if len(worlds) != 1:
        raise ValueError(f"{file}:{root.line}: holds {len(worlds)} elements sdf/world; it must hold one")
    obstacles: list[np.void] = []
    for line, solid in _solids(file, (worlds[0],)):
        obstacles.append(solid)
        if len(obstacles) > MOST_OBSTACLES:
            raise ValueError(
                f"{file}:{line}: is obstacle {len(obstacles)}; there must be at most {MOST_OBSTACLES} in a world"
            )
    if not obstacles:
        raise ValueError(f"{file}:{worlds[0].line}: the world holds no obstacles, no collision/geometry/cylinder")
    return obstacles


def _solids(file: Path, within: tuple[_Element, ...]) -> Iterator[tuple[int, np.void]]:
    """Yields the obstacles in a world or a model, the last of the elements that it stands in, each with its line."""
    for include in within[-1].named("include"):
        uri = next((part.text.strip() for part in include.named("uri")), "")
        if uri not in _HARMLESS:
            raise ValueError(f"{file}:{include.line}: includes {shown(uri)}, which is not in the file; it must hold it")
    for model in within[-1].named("model"):
        yield from _solids(file, (*within, model))
    for link in within[-1].named("link"):
        for collision in link.named("collision"):
            for geometry in collision.named("geometry"):
                place = _composed(file, *within, link, collision)
                for shape in geometry.parts:
                    if shape.name != "plane":
                        yield shape.line, _solid(file, shape, place)


def _tree(file: Path, content: bytes) -> _Element:
    """Returns the root of an XML file's content without a document type: no entities, nothing from elsewhere."""
    parser = expat.ParserCreate()
    parser.buffer_text = True
    top = _Element("", 1, {})
    stack = [top]

    def begin(name: str, attributes: dict[str, str]) -> None:
        if len(stack) > DEEPEST:
            raise ValueError(
                f"{file}:{parser.CurrentLineNumber}: <{name[:40]}> is nested more than {DEEPEST} elements deep"
            )
        stack.append(_Element(name, parser.CurrentLineNumber, attributes))
        stack[-2].parts.append(stack[-1])

    def end(name: str) -> None:
        del name
        stack.pop()

    def text(content: str) -> None:
        if not stack[-1].parts:
            stack[-1].text += content

    def refuse(*_: Any) -> None:
        raise ValueError(f"{file}:{parser.CurrentLineNumber}: has a document type (<!DOCTYPE); a world has none")

    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = text, refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        problem = expat.errors.messages.get(error.code, "broken")
        raise ValueError(f"{file}:{error.lineno}: is no XML: {problem}") from None
    except (LookupError, UnicodeError) as error:  # an encoding that there is not
        raise ValueError(f"{file}:{parser.CurrentLineNumber}: is no XML: {error}") from None
    return top.parts[0]


def _composed(file: Path, *elements: _Element) -> tuple[float, float, float]:
    """Returns the pose (x, y, yaw) in the world of the last of some elements, each in the frame of the one before."""
    x = y = yaw = 0.0
    for element in elements:
        for pose in element.named("pose"):
            for name, plain in _PLAIN_POSE.items():
                if pose.attributes.get(name, plain[0]) not in plain:
                    raise ValueError(
                        f"{file}:{pose.line}: pose has {name}={shown(pose.attributes[name])}; it must be in the "
                        "frame of the element that it stands in, x y z in metres and roll pitch yaw in radians"
                    )
            dx, dy, _, roll, pitch, turn = _numbers(file, pose, 6, "x y z roll pitch yaw")
            if roll or pitch:
                raise ValueError(
                    f"{file}:{pose.line}: pose is {shown(pose.text.strip())}; roll and pitch must be 0 in the plane"
                )
            x, y = x + math.cos(yaw) * dx - math.sin(yaw) * dy, y + math.sin(yaw) * dx + math.cos(yaw) * dy
            yaw += turn
    return x, y, yaw


def _solid(file: Path, shape: _Element, place: tuple[float, float, float]) -> np.void:
    """Returns the obstacle of an element of a geometry."""
    x, y, yaw = place
    sizes = {"cylinder": ("radius", 1, "m"), "box": ("size", 3, "x y z")}
    if shape.name not in sizes:
        raise ValueError(f"{file}:{shape.line}: geometry <{shape.name[:40]}> is not known; it must be cylinder or box")
    name, count, meaning = sizes[shape.name]
    element = next(shape.named(name), None)
    if element is None:
        raise ValueError(f"{file}:{shape.line}: <{shape.name}> has no <{name}>")
    numbers = _numbers(file, element, count, meaning)
    try:
        return circle(x, y, numbers[0]) if shape.name == "cylinder" else box(x, y, numbers[0], numbers[1], yaw)
    except ValueError as error:
        raise ValueError(f"{file}:{element.line}: {error}") from None


def _numbers(file: Path, element: _Element, count: int, meaning: str) -> list[float]:
    """Returns the numbers in the text of an element."""
    try:
        numbers = [float(word) for word in element.text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(each) <= FARTHEST for each in numbers):
        raise ValueError(
            f"{file}:{element.line}: {element.name} is {shown(element.text.strip())}; it must be {count} finite "
            f"number{'s' * (count > 1)} ({meaning}), at most {FARTHEST:g} in size"
        )
    return numbers


def _read_beside(read: Callable[..., Any], file: Path) -> Any:
    return read(file), barn_scenarios(file.parent)


@reader("BARN path", "path_0.npy", _sample_folder, _read_beside)
def read_path(file: Path) -> NDArray[np.float64]:
    """Returns the cells (n, 2), row and column, of a published path.

    Raises:
        ValueError: if the file is no such array; one line that starts with the file.
        OSError: if it cannot be opened.
    """
    try:
        array = stored_array(str(file))
        if array.dtype.kind not in "iuf":
            raise ValueError(f"dtype is {shown(str(array.dtype))}; it must be numbers")
        if array.ndim != 2 or array.shape[1] != 2 or not 1 <= len(array) <= MOST_POINTS:
            raise ValueError(f"shape is {array.shape}; it must be (n, 2), rows and columns of 1 to {MOST_POINTS} cells")
        cells = np.asarray(array, np.float64)
    except ValueError as error:
        raise fault(str(file), f"is no path: {error}") from None
    bad = np.flatnonzero(~(np.abs(cells) <= FARTHEST).all(axis=1))
    if len(bad):
        at = [real(each) for each in cells[bad[0]].tolist()]
        raise fault(str(file), f"cell {bad[0]} is {at}; it must be finite and at most {FARTHEST:g} in size")
    return cells
