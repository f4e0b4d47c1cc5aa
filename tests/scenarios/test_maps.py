"""Maps from files: what ROS and MovingAI mean by theirs, and broken ones, each refused in a line that says why."""

import json
import os
import shutil
import struct
import tracemalloc
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from wayfield.envs.scenarios import goal_scenarios, maps
from wayfield.envs.scenarios.files import field_scenario_from_file
from wayfield.system.objects import FileNote

YAML = """image: room.pgm
resolution: 0.5
origin: [-1.0, -2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
# rows of brightness, the top row first: black, white, the 205 that map_saver writes for unknown
PIXELS = np.array([[0, 254, 205, 254], [0, 254, 254, 254], [0, 0, 0, 254]], np.uint8)
OCTILE = "type octile\nheight 3\nwidth 4\nmap\n.G..\n@T.O\nS.W.\n"
PROBLEMS = "version 1\n0\troom.map\t4\t3\t0\t0\t3\t0\t3.0\n2\troom.map\t4\t3\t1\t2\t3\t2\t5.0\n"
SCENE = {"goal": [0.75, -0.75, 0.0], "start": [-0.25, -0.75, 0.0], "map": "room.yaml"}


def good(folder: Path) -> None:
    """Fills a folder with one good map of each kind."""
    Image.fromarray(PIXELS).save(folder / "room.pgm")
    Image.fromarray(PIXELS).save(folder / "room.png")
    (folder / "room.yaml").write_text(YAML, encoding="utf-8")
    (folder / "room.map").write_text(OCTILE, encoding="utf-8")
    (folder / "room.scen").write_text(PROBLEMS, encoding="utf-8")
    np.save(folder / "room.npy", PIXELS == 0)
    (folder / "scene.json").write_text(json.dumps(SCENE), encoding="utf-8")


def test_a_ros_map_is_read_as_map_server_reads_it(tmp_path: Path) -> None:
    good(tmp_path)
    grid = maps.grid_from_file(str(tmp_path / "room.yaml"))
    # the top row of the image is the last of the grid; unknown counts as occupied
    np.testing.assert_array_equal(grid.occupied[::-1], [[1, 0, 1, 0], [1, 0, 0, 0], [1, 1, 1, 0]])
    assert (grid.resolution, grid.origin, grid.beyond) == (0.5, (-1.0, -2.0, 0.0), "occupied")
    # the lower left pixel's corner is the origin
    assert grid.is_occupied(np.array([[-0.9, -1.9], [0.6, -1.9], [-0.9, -0.6], [-0.4, -0.6]])).tolist() == [
        *(True, False, True, False)
    ]
    free = maps.grid_from_file(str(tmp_path / "room.yaml"), "free")
    np.testing.assert_array_equal(free.occupied[::-1], PIXELS == 0)
    assert free.beyond == "free"


@pytest.mark.parametrize(
    ("lines", "occupied"),
    [
        ("negate: 1", [0, 1, 1, 1]),
        ("mode: scale\nnegate: 0", [1, 0, 0, 0]),
        ("mode: raw\nnegate: 0", [0, 0, 0, 0]),
        ("occupied_thresh: 0.1\nfree_thresh: 0.05", [1, 0, 1, 0]),
        ("occupied_thresh: 6.5e-1", [1, 0, 0, 0]),
    ],
)
def test_thresholds_and_modes_of_a_ros_map(tmp_path: Path, lines: str, occupied: list[int]) -> None:
    good(tmp_path)
    told = "image: room.png\nresolution: 5e-1\norigin: [-1, -2, 3.0e-1]\n" + lines + "\n"
    (tmp_path / "other.yaml").write_text(told, encoding="utf-8")
    grid = maps.grid_from_file(str(tmp_path / "other.yaml"), "free")
    assert grid.occupied[-1].astype(int).tolist() == occupied
    assert grid.origin == (-1.0, -2.0, 0.3)


@pytest.mark.parametrize("name", ["room.yaml", "room.npy"])
def test_cells_of_sizes_that_no_map_has_are_told_of(name: str, tmp_path: Path) -> None:
    good(tmp_path)

    def read(size: float) -> None:
        (tmp_path / "room.yaml").write_text(YAML.replace("0.5\n", f"{size}\n", 1), encoding="utf-8")
        maps.grid_from_file(str(tmp_path / name), **({"resolution": size} if name.endswith("npy") else {}))

    for size in (50, 20, 5, 0.002):  # centimetres, cells a metre, kilometres
        with pytest.warns(FileNote, match=f"{name}: resolution is {size:g} m a cell, usual are 0.01 to 0.5; it is in "):
            read(size)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for size in (0.005, 0.05, 0.5, 1.0):  # of public maps
            read(size)


def test_an_origin_in_degrees_is_told_of(tmp_path: Path) -> None:
    good(tmp_path)
    (tmp_path / "other.yaml").write_text("image: room.png\nresolution: 0.5\norigin: [-1, -2, 90]\n", encoding="utf-8")
    with pytest.warns(FileNote, match=r"other.yaml: origin\[2\] is 90 rad, more than a turn; degrees must be"):
        maps.grid_from_file(str(tmp_path / "other.yaml"))


def map_server(colours: NDArray[np.uint8], settings: dict[str, Any]) -> NDArray[np.int64]:
    """Returns what map_server makes of pixels (rows, columns, channels), one by one: 100, 0, -1 or what lies between.

    Source: navigation2, nav2_map_server, loadMapFromFile of map_io.cpp since pull request 5071.
    """
    found = np.zeros(colours.shape[:2], np.int64)
    low, high = np.float32(settings["free_thresh"]), np.float32(settings["occupied_thresh"])
    for at in np.ndindex(found.shape):
        red, green, blue = colours[at][:3].tolist()
        level = round(0.212656 * red + 0.715158 * green + 0.072186 * blue)
        shade = np.float32(level) / np.float32(255.0)
        occupancy = shade if settings["negate"] else np.float32(1.0) - shade
        if settings["mode"] == "raw":
            found[at] = level if level <= 100 else -1
        elif len(colours[at]) == 4 and colours[at][3] < 255:
            found[at] = -1
        elif occupancy >= high:
            found[at] = 100
        elif occupancy <= low:
            found[at] = 0
        else:
            found[at] = -1 if settings["mode"] == "trinary" else 50  # or another number between, as it is nearer to
    return found


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize(
    ("negate", "high", "low"), [(0, 0.62, 0.23), (1, 0.62, 0.23), (0, 1.0, 0.0), (1, 0.8, 0.2), (0, 0.65, 0.196)]
)
def test_every_pixel_is_what_map_server_makes_of_it(
    tmp_path: Path, channels: int, mode: str, negate: int, high: float, low: float
) -> None:
    rng = np.random.default_rng(channels)
    pixels = rng.integers(0, 256, (25, 30, channels), np.uint8)
    pixels[::2, ..., -1] = 255  # half of them opaque
    pixels[:6, :, : max(channels - 1, 1)] = np.repeat([0, 255, 205, 204, 51, 1], 5).reshape(6, 5, 1).repeat(6, 1)
    Image.fromarray(pixels.squeeze()).save(tmp_path / "a.png")
    wide = pixels if channels > 2 else np.concatenate([pixels[..., :1]] * 3 + [pixels[..., 1:]], axis=2)
    settings = {"mode": mode, "negate": negate, "occupied_thresh": high, "free_thresh": low}
    told = map_server(wide, settings)
    lines = [f"{key}: {value}" for key, value in (settings | {"mode": mode.title()}).items()]
    text = "\r\n".join(["image: a.png", "resolution: 0.5", "origin: [0, 0, 0]", *lines])
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    file = str(tmp_path / "a.yaml")
    raw = mode == "raw"
    occupied, free = told >= (100 * high if raw else 100), (told >= 0) & (told <= (100 * low if raw else 0))
    np.testing.assert_array_equal(maps.grid_from_file(file, "free").occupied[::-1], occupied)
    np.testing.assert_array_equal(maps.grid_from_file(file, "occupied").occupied[::-1], ~free)


def test_a_bare_picture_of_map_saver_keeps_its_unknown_cells(tmp_path: Path) -> None:
    good(tmp_path)
    for name in ("room.pgm", "room.png"):
        known = maps.grid_from_file(str(tmp_path / name), "free", resolution=0.5)
        unknown = maps.grid_from_file(str(tmp_path / name), "occupied", resolution=0.5)
        np.testing.assert_array_equal((unknown.occupied & ~known.occupied)[::-1], PIXELS == 205)


@pytest.mark.parametrize(
    "image",
    [
        *("room.pgm", "./room.pgm", "maps/room.pgm", "../maps/room.pgm", "/home/me/maps/room.pgm", "~/maps/room.pgm"),
        r"C:\maps\room.pgm", "linked/other.pgm",
    ],
)  # fmt: skip
def test_the_picture_is_found_beside_the_map_whatever_folder_it_names(tmp_path: Path, image: str) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "scene").mkdir()
    good(tmp_path / "maps")
    (tmp_path / "store").mkdir()
    (tmp_path / "maps" / "room.pgm").rename(tmp_path / "store" / "other.pgm")  # as data sets of large files keep them
    (tmp_path / "maps" / "room.pgm").symlink_to(tmp_path / "store" / "other.pgm")
    (tmp_path / "maps" / "linked").symlink_to(tmp_path / "store")
    file = tmp_path / "maps" / "room.yaml"
    file.write_text(YAML.replace("room.pgm", image), encoding="utf-8")
    (tmp_path / "scene" / "maps").symlink_to(tmp_path / "maps")  # as a workspace is installed with links
    (tmp_path / "scene" / "scene.json").write_text(json.dumps(SCENE | {"map": "maps/room.yaml"}), encoding="utf-8")
    grid = field_scenario_from_file(str(tmp_path / "scene" / "scene.json")).grid
    assert grid is not None
    assert grid.occupied.tolist() == maps.grid_from_file(str(file)).occupied.tolist()
    assert grid.occupied[::-1].tolist() == (PIXELS < 254).tolist()
    (tmp_path / "scene" / "alone.yaml").symlink_to(file)  # or with a link to the map alone
    assert maps.grid_from_file(str(tmp_path / "scene" / "alone.yaml")).occupied.tolist() == grid.occupied.tolist()
    named = [str(each) for each in maps.map_files(str(tmp_path / "scene" / "scene.json"), "maps/room.yaml")]
    assert all(Path(each).is_file() for each in named)


def test_arrays_have_their_lowest_row_first(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[0, 100, -1], [0, 0, 1]], np.int8))
    grid = maps.grid_from_file(str(tmp_path / "a.npy"), "free", resolution=1.0, origin=(2.0, 3.0, 0.0))
    assert grid.occupied.tolist() == [[False, True, False], [False, False, True]]
    assert grid.is_occupied(np.array([3.5, 3.5]))
    assert maps.grid_from_file(str(tmp_path / "a.npy"), resolution=1.0).occupied[0].tolist() == [False, True, True]


def test_movingai_maps_and_problems(tmp_path: Path) -> None:
    good(tmp_path)
    # as the published reader: the ends of lines are white space, of whatever kind
    (tmp_path / "room.map").write_bytes(OCTILE.replace("\n", " \t\r\n").encode() + b"\r\n")
    (tmp_path / "room.scen").write_bytes(PROBLEMS.replace("\n", "\t\r\n").encode())
    grid = maps.grid_from_file(str(tmp_path / "room.map"))
    np.testing.assert_array_equal(grid.occupied[::-1], [[0, 0, 0, 0], [1, 1, 0, 1], [0, 0, 1, 0]])
    first, second = maps.scenarios_of_problems(str(tmp_path / "room.scen"), resolution=2.0)
    # x to the right, y down from the top: the middle of a cell
    assert first.start == (1.0, 5.0, 0.0)
    assert first.goal == (7.0, 5.0, 0.0)
    assert second.start == (3.0, 1.0, 0.0)
    assert first.grid is second.grid
    assert maps.problems_of(str(tmp_path / "room.scen"))[1].length == 5.0
    assert [each.name for each in goal_scenarios(str(tmp_path / "room.scen"), 0.25)] == ["room.scen 0", "room.scen 1"]


def test_a_scenario_names_its_map(tmp_path: Path) -> None:
    good(tmp_path)
    scenario = field_scenario_from_file(str(tmp_path / "scene.json"))
    assert scenario.grid is not None
    assert scenario.grid.name == "room.yaml"
    (tmp_path / "sub").mkdir()
    shutil.copy(tmp_path / "room.png", tmp_path / "sub")
    told = {"file": "sub/room.png", "resolution": 0.5, "origin": [-1, -2, 0], "unknown": "free"}
    (tmp_path / "scene.json").write_text(json.dumps(SCENE | {"map": told}), encoding="utf-8")
    other = field_scenario_from_file(str(tmp_path / "scene.json"))
    assert other.grid is not None
    assert other.grid.beyond == "free"
    assert other.grid.decisive()[-1] != scenario.grid.decisive()[-1]


Break = Callable[[Path], object]


def _text(name: str, old: str, new: str) -> Break:
    def change(folder: Path) -> None:
        file = folder / name
        text = file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new, 1), encoding="utf-8")

    return change


def _bytes(name: str, content: bytes) -> Break:
    return lambda folder: (folder / name).write_bytes(content)


def _png(width: int, height: int, kind: int = 0) -> bytes:
    """Returns a PNG whose head promises a size and whose body holds next to nothing."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b"")


def _pickled(folder: Path) -> None:
    np.save(folder / "room.npy", np.array([[{"a": 1}]], object), allow_pickle=True)


BROKEN: list[tuple[str, str, Break, str]] = [
    ("yaml no image", "room.yaml", _text("room.yaml", "image: room.pgm\n", ""), "'image' is missing"),
    ("yaml image is no image", "room.yaml", _text("room.yaml", "room.pgm", "room.yaml"), "must end in"),
    ("yaml negate 2", "room.yaml", _text("room.yaml", "negate: 0", "negate: 2"), "negate is 2"),
    ("yaml misspelt", "room.yaml", _text("room.yaml", "negate", "negat"), "Did you mean 'negate'"),
    ("yaml no fields", "room.yaml", _bytes("room.yaml", b"- 1\n- 2\n"), "holds no fields"),
    ("yaml long", "room.yaml", _bytes("room.yaml", b"#" * 70_000), "characters"),
    ("yaml image is missing", "room.yaml", lambda f: (f / "room.pgm").unlink(), "image is 'room.pgm'; there is no"),
    ("yaml absolute image", "room.yaml", _text("room.yaml", "room.pgm", "/home/a.pgm"), "'/home/a.pgm'; there is no"),
    ("yaml image above", "room.yaml", _text("room.yaml", "room.pgm", "../a.pgm"), "'../a.pgm'; there is no a.pgm in"),
    ("yaml image is a folder", "room.yaml", _text("room.yaml", "room.pgm", "../.."), "lead out of the folder"),
    ("scene map above", "scene.json", _text("scene.json", "room.yaml", "../room.yaml"), "lead out of the folder"),
    ("yaml resolution a word", "room.yaml", _text("room.yaml", ": 0.5", ": fine"), "resolution is 'fine'"),
    ("yaml thresholds crossed", "room.yaml", _text("room.yaml", "0.196", "0.7"), "free_thresh is 0.7"),
    ("yaml mode", "room.yaml", _text("room.yaml", "negate: 0", "mode: trinarry"), "Did you mean 'trinary'"),
    ("yaml twice", "room.yaml", _text("room.yaml", "negate: 0", "negate: 0\nnegate: 1"), "'negate' is given twice"),
    ("yaml code", "room.yaml", _text("room.yaml", "0.5", "!!python/object/apply:os.getcwd []"), "room.yaml:2"),
    ("yaml deep", "room.yaml", _bytes("room.yaml", b"image: " + b"[" * 50_000), "nested too deeply"),
    ("yaml bytes", "room.yaml", _bytes("room.yaml", b"\xff\xfe\x00"), "no UTF-8"),
    ("pgm cut off", "room.yaml", _bytes("room.pgm", b"P5\n4 3\n255\n\0\0"), "room.pgm"),
    ("pgm huge", "room.yaml", _bytes("room.pgm", b"P5\n100000 100000\n255\n"), "room.pgm"),
    ("png huge", "room.png", _bytes("room.png", _png(100_000, 100_000)), "room.png"),
    ("npy pipe", "room.npy", lambda f: (f / "room.npy").unlink() or os.mkfifo(f / "room.npy"), "a folder or a device"),
    ("npy objects", "room.npy", _pickled, "it holds pickled objects"),
    ("npy archive", "room.npy", lambda f: np.savez((f / "room.npy").open("wb"), a=np.zeros(2)), "it is an archive"),
    ("npy numbers", "room.npy", lambda f: np.save(f / "room.npy", np.zeros((2, 2))), "bool or whole numbers"),
    ("map rows", "room.map", _text("room.map", "height 3", "height 5"), "height is 5"),
    ("scen columns", "room.scen", _text("room.scen", "\t3.0\n", "\n"), "room.scen:2: has 8 columns"),
    ("scen version", "room.scen", _text("room.scen", "version 1", "version 7"), "room.scen:1"),
    ("scen short", "room.scen", _text("room.scen", "\t3.0\n", "\t2.99\n"), "length is 2.99; it must be at least 3,"),
    ("scene map of another kind", "scene.json", _text("scene.json", "room.yaml", "scene.json"), "suffix '.json'"),
    ("scene resolution missing", "scene.json", _text("scene.json", "room.yaml", "room.png"), "'resolution' is missing"),
    ("scen outside", "room.scen", _text("room.scen", "\t0\t0\t3\t0\t", "\t0\t0\t9\t0\t"), "room.scen:2: goal x is 9"),
    ("scen map is missing", "room.scen", lambda f: (f / "room.map").unlink(), "room.scen:2: map is 'room.map'; there"),
    ("scene map absolute", "scene.json", _text("scene.json", "room.yaml", "/tmp/room.yaml"), "map.file is"),
    ("scene setting of a ROS map", "scene.json",
     _text("scene.json", '"room.yaml"', '{"file": "room.yaml", "resolution": 1}'), "'resolution' is not known"),
]  # fmt: skip


def read(file: str) -> object:
    """Reads a file of any of the kinds."""
    if file.endswith(".scen"):
        return maps.scenarios_of_problems(file)
    if file.endswith(".json"):
        return field_scenario_from_file(file)
    return maps.grid_from_file(file, **({} if file.endswith((".yaml", ".map")) else {"resolution": 0.5}))


@pytest.mark.parametrize(("name", "change", "wanted"), [each[1:] for each in BROKEN], ids=[each[0] for each in BROKEN])
def test_what_is_broken_is_refused_in_a_line_that_names_file_and_field(
    tmp_path: Path, name: str, change: Break, wanted: str
) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    good(folder)
    change(folder)
    file = str(folder / name)
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=wanted) as refused:
            read(file)
        assert tracemalloc.get_traced_memory()[1] < 2**26
    finally:
        tracemalloc.stop()
    text = str(refused.value)
    assert "\n" not in text
    assert str(folder) in text
    assert len(text) < 400
