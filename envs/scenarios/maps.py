"""Occupancy grids from files: ROS maps, MovingAI maps and problems, images, arrays.

The size of every file is read from its head and checked before anything of that size is made.
"""

import contextlib
import dataclasses
import math
import os
import re
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from wayfield.envs.scenarios.arrays import stored_array
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.envs.world.grids import BEYOND, MOST_CELLS, OccupancyGrid, check_size
from wayfield.system.checks import (
    FARTHEST,
    MOST_OBSTACLES,
    WHOLE_TURN,
    choose,
    number,
    pose,
    real,
    repeated,
    shown,
    suggestion,
)
from wayfield.system.objects import FileNote, check_keys, check_ordinary, fault, read_text
from wayfield.system.readers import reader

IMAGE_SUFFIXES = (".pgm", ".png", ".pbm", ".ppm", ".bmp")
MAP_SUFFIXES = (".yaml", ".yml", ".map", ".npy", *IMAGE_SUFFIXES)
MODES = ("trinary", "scale", "raw")
MOVINGAI_CELL = 1.0  # m, a side of a cell of a MovingAI map by default: the sets have none of their own
USUAL = (0.005, 2.0)  # m, a side of a cell: from the finest maps of laser scanners to games', of which a cell is a body
ROUNDED = 1e-3  # share of a published length that may be lost where it was written with few digits

_FORMATS = ("PPM", "PNG", "BMP")  # that Pillow may try, whatever a file is called
_LONGEST_NAME = 255  # characters, as file systems have it
_MOST_NESTED = 100  # brackets and dashes behind dashes
_MOST_YAML = 65_536  # characters
_SETTINGS = ("resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
_FREE, _BLOCKED = ".GS", "@OTW"  # swamp can be driven on; water cannot be driven into from elsewhere
# what reading a damaged image raises; of Pillow are a SyntaxError (a broken PNG), an AssertionError and, before release
# 11, an AttributeError (no palette)
_DAMAGED = (
    OSError, ValueError, SyntaxError, EOFError, LookupError, TypeError, OverflowError, MemoryError, AssertionError,
    AttributeError,
)  # fmt: skip
_REC_709 = (0.212656, 0.715158, 0.072186, 0.0)  # of red, green and blue in the brightness
_NUMERAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)

_PGM = b"P5\n# a room\n6 4\n255\n" + bytes([0] * 7 + [254] * 4 + [0] * 2 + [254] * 2 + [205, 254] + [0] * 7)
_YAML = """image: room.pgm
resolution: 0.5
origin: [-1.0, -1.0, 0.1]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
_OCTILE = "type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\n....\n"
_PROBLEMS = "version 1\n0\troom.map\t4\t3\t0\t0\t3\t2\t4.41421356\n0\troom.map\t4\t3\t3\t0\t0\t0\t3.00000000\n"


def _fill_ros(folder: Path) -> None:
    (folder / "room.yaml").write_text(_YAML, encoding="utf-8")
    (folder / "room.pgm").write_bytes(_PGM)


def _fill_pgm(folder: Path) -> None:
    (folder / "room.pgm").write_bytes(_PGM)


def _fill_png(folder: Path) -> None:
    Image.fromarray(np.array([[0, 255, 255], [0, 0, 255]], np.uint8)).save(folder / "room.png")


def _fill_array(folder: Path) -> None:
    np.save(folder / "room.npy", np.array([[0, 100, -1], [0, 0, 100]], np.int8))


def _read_scaled(read: Callable[..., Any], file: Path) -> Any:
    return read(str(file), resolution=0.5)


@reader("ROS map", "room.yaml", _fill_ros)
@reader("map as a PGM image", "room.pgm", _fill_pgm, _read_scaled)
@reader("map as a PNG image", "room.png", _fill_png, _read_scaled)
@reader("map as an array", "room.npy", _fill_array, _read_scaled)
@reader("MovingAI map", "room.map", {"room.map": _OCTILE})
def grid_from_file(file: str, unknown: str = "occupied", **settings: Any) -> OccupancyGrid:
    """Returns the occupancy grid of a file.

    Read are: maps of ROS's map_server (.yaml, with an image beside it); MovingAI's grid maps (.map); images (.pgm,
    .png, .pbm, .ppm, .bmp), dark where they are occupied, their top row the highest; arrays (.npy: bool, or whole
    numbers as in nav_msgs/OccupancyGrid: 0 free, above it occupied, below it unknown), their first row the lowest.

    Pixels are taken as by nav2_map_server since navigation2's pull request 5071 of April 2025 (map_io.cpp): brightness
    is one of 256 levels, of a colour that of Rec. 709; at a threshold a cell is occupied, or free; what is not wholly
    opaque is unknown, but in mode "raw".

    Args:
        file: a path.
        unknown: what cells are that the map does not know, and all that lies beyond it: "occupied" or "free".
        settings: what a ROS map's file says itself, under its names. Of all others: "resolution", m, a side of a cell,
            without which no image or array is read (1 m for a MovingAI map), and "origin", the pose (x, y, yaw) of the
            lower left corner, by default (0, 0, 0). Of images also "negate" (1: bright is occupied), "mode",
            "occupied_thresh" (0.65) and "free_thresh" (0.196: the grey 205 that map_saver writes is unknown).

    Raises:
        ValueError: if the file is no such map, is too large, or a setting does not belong; one line that starts with
            the file and names the field.
        OSError: if it cannot be opened.
    """
    suffix = os.path.splitext(file)[1].lower()
    if suffix not in MAP_SUFFIXES:
        raise fault(file, f"suffix {suffix!r} is not known; a map is read from {', '.join(MAP_SUFFIXES)}")
    try:
        choose("unknown", unknown, BEYOND)
        if suffix in (".yaml", ".yml"):
            check_keys(file, "", settings, ())
            return _ros_grid(file, unknown)
        check_keys(file, "", settings, _SETTINGS if suffix in IMAGE_SUFFIXES else _SETTINGS[:2])
        if suffix == ".map":
            settings.setdefault("resolution", MOVINGAI_CELL)
        if "resolution" not in settings:
            raise ValueError("field 'resolution' is missing: the side of a cell, m")
        return _grid_of(file, file, settings, unknown)
    except ValueError as error:
        raise fault(file, error) from None


def file_beside(file: str, field: str, name: Any) -> str:
    """Returns the path of a file that another one names, relative to its own folder; links are followed.

    Raises:
        ValueError: naming the field, if it is no name or leads out of that folder.
    """
    if not isinstance(name, str) or not 0 < len(name) <= _LONGEST_NAME or not name.isprintable():
        raise ValueError(f"{field} is {shown(name)}; it must be the name of a file")
    if os.path.isabs(name) or re.match(r"[A-Za-z]:|[\\/~]", name):
        raise ValueError(f"{field} is {shown(name)}; it must be relative to the folder of {os.path.basename(file)}")
    if os.path.normpath(name).split(os.sep)[0] == os.pardir:
        raise ValueError(f"{field} is {shown(name)}; it must not lead out of the folder of {os.path.basename(file)}")
    return os.path.join(os.path.dirname(file), name)


def _picture(file: str, name: Any) -> str:
    """Returns the path of a ROS map's picture: as the map names it, or else of that name beside the map.

    map_saver writes where it was called from, so that a map that was moved names a folder of its maker's.
    """
    bare = re.split(r"[\\/]", name)[-1] if isinstance(name, str) else name
    beside = file_beside(file, "image", bare if bare not in ("", ".", "..") else name)
    for each in (file, os.path.realpath(file)):  # a workspace may be installed with a link to the map alone
        with contextlib.suppress(ValueError):
            if os.path.exists(named := file_beside(each, "image", name)):
                return named
        if os.path.exists(picture := os.path.join(os.path.dirname(each), os.path.basename(beside))):
            return picture
    return beside


def map_of(file: str, field: str, value: Any) -> OccupancyGrid:
    """Returns the grid that a scenario's file names: a map beside it, or an object with its "file" and settings.

    Raises:
        ValueError: if there is no such map; one line that names the field, or starts with the map's file.
        OSError: if it cannot be opened.
    """
    settings = dict(value) if isinstance(value, dict) else {"file": value}
    if "file" not in settings:
        raise ValueError(f"{field} is {shown(value)}; it must be the name of a map, or an object with its 'file'")
    return grid_from_file(file_beside(file, f"{field}.file", settings.pop("file")), **settings)


def map_files(file: str, value: Any) -> list[str]:
    """Returns the files that a scenario's map consists of: the map, and the image of a ROS map."""
    files = [file_beside(file, "map.file", value.get("file") if isinstance(value, dict) else value)]
    if files[0].lower().endswith((".yaml", ".yml")):
        files.append(_picture(files[0], _ros_fields(files[0])["image"]))
    return files


@dataclasses.dataclass(frozen=True)
class Problem:
    """A problem of a MovingAI benchmark: from one cell of a map to another."""

    bucket: int
    map: str  # path of the map's file
    size: tuple[int, int]  # columns, rows of the map
    start: tuple[int, int]  # column and row, from the top
    goal: tuple[int, int]
    length: float  # cells, of the shortest way to the eight neighbours that cuts no corner

    def scenario(self, name: str, grid: OccupancyGrid, **settings: Any) -> GoalScenario:
        """Returns the problem as a goal scenario, from the middle of one cell to that of another, at any heading."""
        (x0, y0), (x1, y1) = grid.points(
            np.array([[column + 0.5, self.size[1] - row - 0.5] for column, row in (self.start, self.goal)])
        ).tolist()
        tolerances = {"position_tolerance": 0.2, "heading_tolerance": math.pi} | settings
        return GoalScenario(name, (x1, y1, 0.0), start=(x0, y0, 0.0), grid=grid, **tolerances)


@reader("MovingAI problems", "room.map.scen", {"room.map": _OCTILE, "room.map.scen": _PROBLEMS})
def problems_of(file: str) -> tuple[Problem, ...]:
    """Returns the problems of a MovingAI .scen file.

    A line holds bucket, map, its width and height, start x and y, goal x and y (from the top left, 0 the first), and
    the optimal length. The map lies beside the file, or in a folder there as its name says.

    Raises:
        ValueError: if the file is no such list, or names no map beside it; one line that starts with file:line.
        OSError: if it cannot be opened.
    """
    lines = read_text(file).splitlines()
    first = lines[0].split() if lines else []
    if len(first) != 2 or first[0] != "version" or real(_number(first[1])) != 1.0:
        raise ValueError(f"{file}:1: is {shown(lines[0] if lines else '')}; it must be 'version 1'")
    if len(lines) > MOST_OBSTACLES:
        raise ValueError(f"{file}:{MOST_OBSTACLES}: the problems go on; there must be at most {MOST_OBSTACLES}")
    problems = []
    for i, line in enumerate(lines[1:], 2):
        if line.strip():
            try:
                problems.append(_problem(file, line))
            except ValueError as error:
                raise ValueError(f"{file}:{i}: {error}") from None
    if not problems:
        raise ValueError(f"{file}:{len(lines)}: holds no problem")
    return tuple(problems)


def scenarios_of_problems(file: str, resolution: float = MOVINGAI_CELL) -> tuple[GoalScenario, ...]:
    """Returns the goal scenarios of a MovingAI .scen file in its order; all on one map share its grid.

    Args:
        resolution: m, a side of a cell.

    Raises:
        ValueError: as `problems_of` and `grid_from_file`, or if the map has another size or a problem leaves it.
        OSError: if a file cannot be opened.
    """
    grids: dict[str, OccupancyGrid] = {}
    stem = os.path.basename(file)
    scenarios = []
    for k, problem in enumerate(problems_of(file)):
        if problem.map not in grids:
            grids[problem.map] = grid_from_file(problem.map, resolution=resolution)
        rows, columns = grids[problem.map].shape
        if problem.size != (columns, rows):
            raise fault(
                file, f"problem {k} is on a map of {problem.size[0]} x {problem.size[1]} cells; {problem.map} has "
                f"{columns} x {rows}"
            )  # fmt: skip
        length = problem.length * resolution or math.nan  # a robot that is there has no way
        if length > FARTHEST:
            raise fault(file, f"problem {k} has the optimal length {length:g} m; it must be at most {FARTHEST:g}")
        scenarios.append(problem.scenario(f"{stem} {k}", grids[problem.map], published_length=length))
    return tuple(scenarios)


def _problem(file: str, line: str) -> Problem:
    line = line.rstrip()
    fields = line.split("\t") if "\t" in line else line.split()
    if len(fields) != 9:
        raise ValueError(f"has {len(fields)} columns; a problem has 9")
    names = ("bucket", "", "width", "height", "start x", "start y", "goal x", "goal y")
    whole = {}
    for name, text in zip(names, fields, strict=False):
        if name:
            if not re.fullmatch(r"\d{1,9}", text.strip(), re.ASCII):
                raise ValueError(f"{name} is {shown(text)}; it must be a whole number")
            whole[name] = int(text)
    for axis, side in (("x", "width"), ("y", "height")):
        for end in ("start", "goal"):
            if whole[f"{end} {axis}"] >= whole[side]:
                cell = whole[f"{end} {axis}"]
                raise ValueError(f"{end} {axis} is {cell}; it must be below the {side}, {whole[side]}")
    length = number("optimal length", _number(fields[8].strip()), least=0.0, most=math.inf)
    straight = math.hypot(whole["goal x"] - whole["start x"], whole["goal y"] - whole["start y"])
    if 0.0 < length < straight - ROUNDED * (1.0 + straight):
        raise ValueError(
            f"optimal length is {length:g}; it must be at least {straight:g}, as long as the straight line, in cells"
        )
    path = file_beside(file, "map", fields[1].strip())
    if not os.path.exists(path):
        path = file_beside(file, "map", os.path.basename(fields[1].strip()))
    if not os.path.exists(path):
        raise ValueError(f"map is {shown(fields[1].strip())}; there is no such file beside it")
    return Problem(
        whole["bucket"],
        path,
        (whole["width"], whole["height"]),
        (whole["start x"], whole["start y"]),
        (whole["goal x"], whole["goal y"]),
        length,
    )


def note_degrees(file: str, field: str, value: Any, half: bool = False) -> None:
    """Says of an angle beyond a turn, or half of one, that it is read in radians."""
    turns = abs(real(value)) / WHOLE_TURN
    if (0.52 if half else 1.0) < turns < math.inf:  # 3.2 is written for half a turn
        more = f"{field} is {value:g} rad, more than {'half ' * half}a turn"
        warnings.warn(f"{file}: {more}; degrees must be multiplied by pi / 180", FileNote, stacklevel=3)


def _number(text: Any) -> Any:
    """Returns the number of a numeral, which YAML 1.1 leaves as text where it is 5e-2; anything else as it is."""
    return float(text) if isinstance(text, str) and _NUMERAL.fullmatch(text) else text


def _ros_fields(file: str) -> dict[str, Any]:
    """Returns the fields of a ROS map's YAML, checked to be there; what is in them is not."""
    text = read_text(file)
    if len(text) > _MOST_YAML:
        raise fault(file, f"has {len(text)} characters; a map's YAML must have at most {_MOST_YAML}")
    # the parser takes time with the square of the depth, and a map's YAML is flat but for its origin
    if sum(map(text.count, ("[", "{", "- -", "? ?"))) > _MOST_NESTED:
        raise fault(file, "is nested too deeply")
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if anchor := getattr(event, "anchor", None):  # a few aliases of aliases stand for billions of values
                line = event.start_mark.line + 1
                raise ValueError(
                    f"{file}:{line}: {shown(anchor)} is an anchor or an alias; write out what it stands for"
                )
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if not isinstance(node, yaml.MappingNode):
            raise fault(file, "holds no fields; it must be lines such as 'image: map.pgm'")
        twice = repeated(each.value for each, _ in node.value if isinstance(each, yaml.ScalarNode))
        if twice is not None:
            raise fault(file, f"field {shown(twice)} is given twice")
        fields = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line + 1 if mark is not None else 1
        raise ValueError(f"{file}:{line}: {getattr(error, 'problem', None) or 'is no YAML'}") from None
    except RecursionError:
        raise fault(file, "is nested too deeply") from None
    for key in fields:
        # others ignore what they do not know, so that a map's maker may leave notes; what is misspelt is no note
        near = suggestion(key, ("image", *_SETTINGS)) if isinstance(key, str) else ""
        if key not in ("image", *_SETTINGS) and near:
            raise fault(file, f"field {shown(key)} is not known.{near}")
    for key in ("image", "resolution", "origin"):
        if key not in fields:
            raise fault(file, f"field {key!r} is missing")
    return {key: fields[key] for key in ("image", *_SETTINGS) if key in fields}


def _ros_grid(file: str, unknown: str) -> OccupancyGrid:
    """Returns the grid of a map_server YAML file."""
    fields = _ros_fields(file)
    name = fields.pop("image")
    image = _picture(file, name)
    if os.path.splitext(image)[1].lower() not in IMAGE_SUFFIXES:
        raise ValueError(f"image is {name!r}; it must end in {', '.join(IMAGE_SUFFIXES)}")
    if not os.path.exists(image):
        raise ValueError(
            f"image is {name!r}; there is no {os.path.basename(image)} in {os.path.dirname(image) or '.'}: put it there"
        )
    return _grid_of(file, image, fields, unknown)


def _grid_of(file: str, content: str, settings: dict[str, Any], unknown: str) -> OccupancyGrid:
    """Returns the grid of a map's content, a file, by its settings."""
    settings = {key: _number(value) for key, value in settings.items()}
    origin = settings.get("origin", (0.0, 0.0, 0.0))
    if isinstance(origin, list | tuple):
        origin = tuple(_number(each) for each in origin)
        note_degrees(file, "origin[2]", origin[-1] if len(origin) == 3 else None)
    origin = pose("origin", origin)
    side = number("resolution", settings["resolution"], above=0.0)
    if not USUAL[0] <= side <= USUAL[1]:
        more = f"resolution is {side:g} m a cell, usual are 0.01 to 0.5"
        warnings.warn(f"{file}: {more}; it is in metres, not in centimetres or cells a metre", FileNote, stacklevel=3)
    suffix = os.path.splitext(content)[1].lower()
    if suffix == ".map":
        occupied = _octile(content)
    else:
        read = _array if suffix == ".npy" else _image
        occupied, known = read(content, settings)
        if unknown == "occupied":
            occupied |= ~known
    return OccupancyGrid(occupied, settings["resolution"], origin, unknown, os.path.basename(file))


def _octile(file: str) -> NDArray[np.bool_]:
    """Returns the occupancy of a MovingAI map, its last line first."""
    text = read_text(file).replace("\r\n", "\n")
    lines = text.split("\n")
    head = [line.split() for line in lines[:4]]
    sizes = {}
    for i, words in enumerate((["type", "octile"], ["height"], ["width"], ["map"])):
        got = head[i] if i < len(head) else []
        sized = words[0] in ("height", "width")
        if got[: len(words)] != words or len(got) != len(words) + sized or (
            sized and not re.fullmatch(r"\d{1,9}", got[1], re.ASCII)
        ):  # fmt: skip
            wanted = f"'{words[0]} N'" if sized else f"{' '.join(words)!r}"
            raise ValueError(f"{file}:{i + 1}: is {shown(lines[i] if i < len(lines) else '')}; it must be {wanted}")
        if sized:
            sizes[words[0]] = int(got[1])
    rows, columns = sizes["height"], sizes["width"]
    check_size("map", rows, columns)
    body = lines[4:]
    while body and not body[-1].strip():
        body.pop()
    if len(body) != rows:
        raise ValueError(f"{file}:{4 + len(body)}: the map has {len(body)} rows; height is {rows}")
    body = [line.rstrip() for line in body]
    for i, line in enumerate(body):
        if len(line) != columns:
            raise ValueError(f"{file}:{5 + i}: the row has {len(line)} cells; width is {columns}")
    try:
        cells = np.frombuffer("".join(body).encode("ascii"), np.uint8).reshape(rows, columns)
    except UnicodeEncodeError:
        cells = np.zeros((rows, columns), np.uint8)
    known = np.isin(cells, np.frombuffer((_FREE + _BLOCKED).encode(), np.uint8))
    if not known.all():
        i = int(np.flatnonzero(~known.all(axis=1))[0])
        odd = next(each for each in body[i] if each not in _FREE + _BLOCKED)
        raise ValueError(f"{file}:{5 + i}: {odd!r} is no cell; the cells are {' '.join(_FREE + _BLOCKED)}")
    return np.isin(cells, np.frombuffer(_BLOCKED.encode(), np.uint8))[::-1].copy()


def _image(file: str, settings: Mapping[str, Any]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns which cells of an image are occupied and which are known, by the rules of map_server."""
    mode = settings.get("mode", "trinary")
    mode = mode.lower() if isinstance(mode, str) else mode
    choose("mode", mode, MODES)
    negate = settings.get("negate", 0)
    if not (isinstance(negate, bool | int | float) and negate in (0, 1)):
        raise ValueError(f"negate is {shown(negate)}; it must be 0 or 1")
    high = number("occupied_thresh", settings.get("occupied_thresh", 0.65), least=0.0, most=1.0)
    low = number("free_thresh", settings.get("free_thresh", 0.196), least=0.0, most=1.0)
    if low >= high:
        raise ValueError(f"free_thresh is {low:g}; it must be below occupied_thresh, {high:g}")
    light, opaque = _brightness(file)
    # of each brightness, whether it counts as occupied, and whether as known; in single precision, as there
    levels = np.arange(256, dtype=np.float32)
    if mode == "raw":
        share = levels / 100.0
        opaque = None
    else:
        share = levels / np.float32(255.0)
        share = share if negate else 1.0 - share
    occupied, free = share >= np.float32(high), share <= np.float32(low)
    if mode == "raw":
        occupied &= levels <= 100
    taken = occupied[light]
    known = (occupied | free)[light]
    if opaque is not None:
        taken &= opaque
        known &= opaque
    return taken[::-1].copy(), known[::-1].copy()


def _brightness(file: str) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    """Returns the brightness (rows, columns) of an image, top row first, and where it is wholly opaque; None: all."""
    name = os.path.basename(file)
    check_ordinary(file, f"image {name}")
    try:
        with warnings.catch_warnings():
            # Pillow's bound is above ours
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(file, formats=_FORMATS) as image:
                check_size(f"image {name}", image.height, image.width)
                if image.mode.startswith("I") or image.mode == "F":
                    deep = np.asarray(image)
                    if deep.dtype.kind not in "iu" or deep.min() < 0 or deep.max() > 65535:
                        raise ValueError(f"image {name} has pixels of {image.mode}; it must have 8 or 16 bits")
                    return ((deep.astype(np.uint32) + 128) // 257).astype(np.uint8), None
                clear = image.has_transparency_data
                if image.mode in ("1", "L") and not clear:
                    return np.asarray(image.convert("L")), None
                whole = image.convert("RGBA" if clear else "RGB")
                opaque = np.asarray(whole.getchannel("A")) == 255 if clear else None
                return np.asarray(whole.convert("RGB").convert("L", _REC_709)), opaque
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise ValueError(f"image {name} is too large; it must have at most {MOST_CELLS:,} pixels") from None
    except UnidentifiedImageError:
        raise ValueError(f"image {name} cannot be read; it must be {', '.join(_FORMATS)}") from None
    except FileNotFoundError:
        raise
    except _DAMAGED as error:
        text = " ".join(str(error).split())
        raise ValueError(text if name in text else f"image {name} is damaged: {text[:200]}") from None


def _array(file: str, settings: Mapping[str, Any]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns which cells of a stored array are occupied and which are known."""
    del settings
    stored = stored_array(file)
    if stored.ndim != 2 or stored.dtype.kind not in "biu":
        held = f"{stored.dtype} of shape {stored.shape}"
        raise ValueError(f"holds {shown(held)[1:-1]}; it must be bool or whole numbers, (rows, columns)")
    check_size("array", *stored.shape)
    cells = np.asarray(stored)
    return np.asarray(cells > 0), np.asarray(cells >= 0)
