"""What a frame shows, stroke by stroke, stated once more in plain Python: colours, places, sizes and order."""

import cmath
import dataclasses
import itertools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from wayfield.envs.geometry import OBSTACLE
from wayfield.envs.grids import OccupancyGrid
from wayfield.envs.robots import ROBOTS

pytest.importorskip("pygame")
import pygame

from wayfield.envs import rendering
from wayfield.envs.rendering import Canvas, Ghost, Mark, Renderer, Scene, View

# Okabe and Ito 2008, and greys of ours
BLUE, SKY, GREEN, ORANGE = (0, 114, 178), (86, 180, 233), (0, 158, 115), (230, 159, 0)
VERMILLION, PURPLE, WHITE = (213, 94, 0), (204, 121, 167), (255, 255, 255)
FLOOR, LINES, CORRIDOR, PATH = (248, 249, 250), (231, 234, 237), (222, 238, 249), (146, 154, 164)
HULL, FIXED, INK = (190, 218, 236), (96, 106, 117), (52, 58, 66)

Stroke = tuple[str, Any, Any, tuple[float, ...]]  # what, colour, points in px, sizes in px


class Sketch(Canvas):
    """A canvas that only notes what it is asked to draw."""

    def __init__(self, view: View) -> None:
        super().__init__(view.size_px)
        self.strokes: list[Stroke] = []

    def rectangle(self, colour: Any, x: float, y: float, width: float, height: float) -> None:
        self.strokes.append(("rectangle", colour, [(x, y)], (width, height)))

    def disc(self, colour: Any, at: Any, radius: float, width: float = 0.0) -> None:
        self.strokes.append(("disc", colour, [tuple(at)], (radius, width)))

    def polygon(self, colour: Any, corners: Any, width: float = 0.0) -> None:
        self.strokes.append(("polygon", colour, corners, (width,)))

    def line(self, colour: Any, points: Any, width: float) -> None:
        self.strokes.append(("line", colour, points, (width,)))

    def translucent_lines(self, colour: Any, alpha: int, ends: Any, width: float) -> None:
        self.strokes.append(("rays", colour, np.reshape(ends, (-1, 2)), (alpha, width)))

    def translucent(self, alpha: int, at: Any, radius: float, draw: Any) -> None:
        self.strokes.append(("through", alpha, [tuple(at)], (radius,)))
        draw(self)


def same(found: list[Stroke], wanted: list[Stroke]) -> None:
    assert [stroke[:2] for stroke in found] == [stroke[:2] for stroke in wanted]
    for (kind, colour, points, sizes), (_, _, at, told) in zip(found, wanted, strict=True):
        assert sizes == pytest.approx(told), (kind, colour)
        at, points = np.array(at), np.array(points)
        if kind == "line":  # a point that is given twice shows nothing
            points = points[np.append(True, (np.diff(points, axis=0) != 0.0).any(axis=1))]
        np.testing.assert_allclose(points, at, atol=1e-6, err_msg=f"{kind} {colour}")


class Sheet:
    """Where the world lies in a frame: metres to pixels, as complex numbers turn them."""

    def __init__(self, view: View) -> None:
        self.view, self.scale = view, view.scale

    def __call__(self, *points: complex) -> list[tuple[float, float]]:
        middle = complex(*self.view.centre)
        return [
            (self.view.width_px / 2 + self.scale * (p - middle).real,
             self.view.height_px / 2 - self.scale * (p - middle).imag)
            for p in points
        ]  # fmt: skip


def body(pose: Any, *points: complex) -> list[complex]:
    """Returns points of a body in the world."""
    return [complex(pose[0], pose[1]) + cmath.rect(1.0, pose[2]) * p for p in points]


def of_robot(px: Sheet, robot: Any, pose: Any) -> Iterator[Stroke]:
    # a robot of less than 10 px is drawn as large
    larger = max(1.0, 10.0 / (px.scale * robot.hull_radius))
    radius, (centre,) = larger * robot.hull_radius * px.scale, px(complex(*pose[:2]))

    def drawn(*points: complex) -> list[tuple[float, float]]:
        return px(*body(pose, *(larger * p for p in points)))

    if robot.hull_box is None:
        for colour, more, width in ((WHITE, 1.5, 0.0), (HULL, 0.0, 0.0), (BLUE, 0.0, 1.5)):
            yield "disc", colour, [centre], (radius + more, width)
    else:
        a, b = (0.5 * side for side in robot.hull_box)
        corners = [complex(a, b), complex(-a, b), complex(-a, -b), complex(a, -b)]
        yield "polygon", BLUE, drawn(*corners), (0.0,)
        yield "polygon", HULL, drawn(*(0.94 * p for p in corners)), (0.0,)
    # a side behind each wheel, square to the way out to it, wheels counter-clockwise
    sides = []
    for at in sorted((complex(wheel.x, wheel.y) for wheel in robot.built), key=cmath.phase):
        inset = 0.72 * abs(at)
        half = 0.75 * math.sqrt(robot.hull_radius**2 - inset**2)
        half = min(half, inset * math.tan(0.65 * math.pi / len(robot.built)))
        outwards = at / abs(at)
        sides += [inset * outwards - 1j * outwards * half, inset * outwards + 1j * outwards * half]
    yield "polygon", BLUE, drawn(*sides), (0.0,)
    for wheel in robot.built:
        rim, across = (cmath.rect(share * wheel.radius, wheel.direction) for share in (1.0, 0.25))
        corners = [complex(wheel.x, wheel.y) + a * rim + b * 1j * across
                   for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]  # fmt: skip
        yield "polygon", INK, drawn(*corners), (0.0,)
    nose = (0.55 + 0j, -0.3 + 0.38j, -0.1 + 0j, -0.3 - 0.38j)
    yield "polygon", WHITE, drawn(*(robot.hull_radius * p for p in nose)), (0.0,)


def of_obstacle(px: Sheet, o: Any) -> Iterator[Stroke]:
    # whose least half width is 1.5 px
    least = 1.5 / px.scale - o["radius"]
    half = complex(max(o["half_length"], least), max(o["half_width"], least))
    outline = []
    for quarter, corner in enumerate((half, -half.conjugate(), -half, half.conjugate())):
        turns = [quarter + k / 15 for k in range(16)] if o["radius"] > 0.0 else [quarter]
        outline += [corner + cmath.rect(o["radius"], 0.5 * math.pi * turn) for turn in turns]
    corners = px(*body((o["x"], o["y"], math.atan2(o["sin"], o["cos"])), *outline))
    if o["mass"] > 0.0:
        yield "polygon", ORANGE, corners, (0.0,)
        yield "polygon", VERMILLION, corners, (1.5,)
    else:
        yield "polygon", FIXED, corners, (0.0,)


def of_arrow(at: Any, heading: float, length: float, width: float) -> Iterator[Stroke]:
    tip = cmath.rect(1.0, -heading)  # y goes down
    neck, start = length - 3.5 * width, complex(*at)
    points = [start, start + neck * tip, start + length * tip]
    points += [start + (neck + 2j * sign * width) * tip for sign in (1, -1)]
    a, b, *head = ((p.real, p.imag) for p in points)
    yield "line", GREEN, [a, b], (width,)
    yield "polygon", GREEN, head, (0.0,)


def of_goals(px: Sheet, goals: Any, tolerance: float) -> Iterator[Stroke]:
    places = px(*(complex(x, y) for x, y, _ in goals))
    if tolerance > 0.0:
        yield "disc", GREEN, places[-1:], (tolerance * px.scale, 1.5)
    for at, (_, _, heading) in zip(places[:-1], goals[:-1], strict=True):
        if not math.isnan(heading):
            yield from of_arrow(at, heading, 17.0, 1.5)
        yield "disc", GREEN, [at], (5.0, 0.0)
        yield "disc", WHITE, [at], (3.0, 0.0)
    if not math.isnan(goals[-1][2]):
        yield from of_arrow(places[-1], goals[-1][2], 26.0, 2.5)
    yield "disc", WHITE, places[-1:], (7.0, 0.0)
    yield "disc", GREEN, places[-1:], (5.5, 0.0)


def of_rays(px: Sheet, scene: Scene) -> Iterator[Stroke]:
    """Yields the rays; and when all that stands is drawn, where they end."""
    at = complex(*scene.pose[:2])
    reach = scene.max_range or math.inf
    most = 2.0 * max(px.view.size_px) / px.scale
    ranges = [reach if math.isnan(r) else min(r, reach) for r in scene.ranges]
    ends = px(*(at + cmath.rect(min(r, most), scene.pose[2] + turn)
                for r, turn in zip(ranges, scene.beam_angles, strict=True)))  # fmt: skip
    yield "rays", SKY, [point for end in ends for point in (*px(at), end)], (120, 1.0)
    for r, end in zip(ranges, ends, strict=True):
        if r < reach:
            yield "disc", WHITE, [end], (3.5, 0.0)
            yield "disc", SKY, [end], (2.5, 0.0)


def of_moment(px: Sheet, scene: Scene) -> Iterator[Stroke]:
    rays, *hits = of_rays(px, scene)
    yield rays
    for o in scene.obstacles:
        yield from of_obstacle(px, o)
    yield from hits
    for mark in scene.marks:
        places = px(*(complex(*p) for p in mark.points))
        if mark.line > 0.0:
            yield "line", mark.colour, places, (mark.line,)
            continue
        for at in places:
            size = max(mark.radius * px.scale, mark.pixels, 1.0)
            yield "disc", mark.colour, [at], (size, 1.5 if mark.outline else 0.0)
    yield from of_goals(px, scene.goals, scene.goal_tolerance)
    (start,) = px(complex(*scene.start))
    for sign in (1, -1):
        yield "line", INK, [(start[0] + k, start[1] + sign * k) for k in (-4, 4)], (2.0,)
    yield "line", BLUE, px(*(complex(*p) for p in scene.trail)), (1.5,)
    for ghost in scene.ghosts:
        if ghost.trail is not None:
            yield "line", PURPLE, px(*(complex(*p) for p in ghost.trail)), (1.5,)
        reach = max(px.scale * ghost.robot.hull_radius, 10.0) + 3.0
        yield "through", 90, px(complex(*ghost.pose[:2])), (reach,)
        yield from of_robot(px, ghost.robot, ghost.pose)
    robot, ahead, near = (complex(*p) for p in (scene.pose[:2], scene.lookahead, scene.reference))
    yield "line", PURPLE, px(robot, ahead), (1.0,)
    yield "line", VERMILLION, px(ahead, near), (1.0,)
    yield from of_robot(px, scene.robot, scene.pose)
    yield "disc", WHITE, px(ahead), (7.0, 0.0)
    yield "disc", PURPLE, px(ahead), (6.5, 2.5)
    yield "disc", WHITE, px(near), (5.0, 0.0)
    yield "disc", VERMILLION, px(near), (3.5, 0.0)


def scene_of(robot: str, seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 8.0, (30, 2))
    obstacles = np.zeros(5, OBSTACLE)
    obstacles["x"], obstacles["y"] = places[:5].T
    turns = rng.uniform(-3.0, 3.0, 5)
    obstacles["sin"], obstacles["cos"] = np.sin(turns), np.cos(turns)
    # a disc, a box, a rounded box, a wall, a speck
    obstacles["half_length"], obstacles["half_width"] = (0.0, 0.6, 0.5, 0.9, 0.0), (0.0, 0.3, 0.2, 0.0, 0.0)
    obstacles["radius"], obstacles["mass"] = (0.4, 0.0, 0.1, 0.0, 0.003), (0.0, 3.0, 2.0, 0.0, 0.0)
    angles = np.linspace(-2.0, 2.0, 9)
    ranges = rng.uniform(0.5, 5.0, 9)
    ranges[:3] = np.nan, np.inf, 100.0
    return Scene(
        robot=ROBOTS[robot], pose=(*places[5], 2.2), bounds=(0.0, -1.0, 9.0, 8.0), obstacles=obstacles,
        goals=np.column_stack([places[6:10], [0.4, np.nan, -2.0, 1.0 if seed else np.nan]]), goal_tolerance=0.2 * seed,
        ranges=ranges, beam_angles=angles, max_range=4.0 * seed, trail=places[10:12], reference=tuple(places[12]),
        lookahead=tuple(places[13]), start=tuple(places[14]),
        marks=(Mark(places[15:18], SKY, radius=0.1, pixels=2.0), Mark(places[18:20], INK, pixels=4.0, outline=True),
               Mark(places[20:21], BLUE), Mark(places[21:23], GREEN, line=1.2)),
        ghosts=(Ghost(ROBOTS["omni4"], (*places[23], -0.8), places[24:26]),
                Ghost(ROBOTS["jackal"], (*places[26], 3.0))),
    )  # fmt: skip


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("robot", ["p3dx", "omni3", "jackal", "mecanum4"])
def test_a_moment_is_drawn_layer_by_layer(robot: str, seed: int) -> None:
    scene = scene_of(robot, seed)
    view = Renderer("rgb_array", 20).view(scene)
    sketch = Sketch(view)
    rendering._draw_moment(sketch, view, scene)
    same(sketch.strokes, list(of_moment(Sheet(view), scene)))


@pytest.mark.parametrize(("wide", "step"), [(0.05, 0.1), (9.0, 1.0), (40.0, 5.0), (200.0, 10.0), (4e9, 5e8)])
def test_the_floor_has_lines_at_whole_steps_and_nothing_of_it_lies_in_the_strips(wide: float, step: float) -> None:
    bounds = (-0.3 * wide, -0.2 * wide, 0.7 * wide, 0.6 * wide)
    view = Renderer("rgb_array", 20).view(dataclasses.replace(scene_of("p3dx", 0), bounds=bounds))
    # at least 24 px apart, at 1 or 5 times a power of ten
    assert rendering._grid_step(view) == pytest.approx(step)
    sketch, px = Sketch(view), Sheet(view)
    rendering._draw_floor(sketch, view)
    assert sketch.surface.get_at((0, 0))[:3] == WHITE
    width, high = view.width_px, view.height_px - 2 * view.strip_px
    wanted: list[Stroke] = [("rectangle", FLOOR, [(0, view.strip_px)], (width, high))]
    near = range(-200, 200)
    for k in near:
        ((x, _),) = px(complex(k * step, 0))
        if 0 <= x <= width:
            wanted.append(("rectangle", LINES, [(x, view.strip_px)], (1, high)))
    for k in near:
        ((_, y),) = px(complex(0, k * step))
        if view.strip_px <= y <= view.strip_px + high:
            wanted.append(("rectangle", LINES, [(0, y)], (width, 1)))
    same(sketch.strokes, wanted)


def test_a_band_is_a_quad_a_side_and_a_disc_a_corner() -> None:
    view = Renderer("rgb_array", 20).view(scene_of("p3dx", 0))
    sketch = Sketch(view)
    points = np.array([[20.0, 30.0], [20.0, 30.0], [80.0, 110.0], [200.0, 90.0]])
    rendering._draw_path(sketch, view, points, 0.3)
    wide = 0.3 * view.scale
    wanted: list[Stroke] = [("disc", CORRIDOR, [tuple(p)], (wide, 0.0)) for p in points[[0, 2, 3, 3]]]  # the end twice
    for a, b in ((points[0], points[2]), (points[2], points[3])):
        along = complex(*(b - a)) / abs(complex(*(b - a)))
        aside = np.array([(1j * along).real, (1j * along).imag]) * wide
        wanted.append(("polygon", CORRIDOR, [a + aside, b + aside, b - aside, a - aside], (0.0,)))
    wanted.append(("line", PATH, points[[0, 2, 3]], (2.0,)))
    same(sketch.strokes, wanted)
    sketch.strokes.clear()
    rendering._draw_path(sketch, view, points, 0.0)
    assert [stroke[0] for stroke in sketch.strokes] == ["line"]


def test_thinning_keeps_the_ends_and_a_point_a_step() -> None:
    rng = np.random.default_rng(3)
    steps = rng.uniform(0.0, 0.4, 400)
    line = np.column_stack([np.append(0.0, np.cumsum(steps)), np.zeros(401)])
    line[[7, 9]] = np.nan
    kept = rendering._thinned(line, 2.0)[:, 0]
    assert kept[0] == 0.0
    assert kept[-1] == line[-1, 0]
    # who is the first beyond each step
    good = line[np.isfinite(line[:, 0]), 0]
    first = [good[good >= k * 2.0][0] for k in range(1, int(good[-1] // 2.0) + 1)]
    np.testing.assert_array_equal(kept, [0.0, *first, *([good[-1]] if first[-1] < good[-1] else [])])
    many = np.column_stack([np.arange(65_000.0), np.zeros(65_000)])
    few = rendering._thinned(many, 1.0)[:, 0]
    np.testing.assert_array_equal(few, np.append(np.arange(0.0, 65_000.0, 4.0), 64_999.0))
    for count in range(3):
        np.testing.assert_array_equal(rendering._thinned(line[:count], 1.0)[:count], line[:count])


def test_a_frame_fits_its_world_and_its_words() -> None:
    for size, strip in ((299, 0), (300, 28), (640, 28)):
        for wide, high in ((1.0, 1.0), (0.92, 1.0), (0.8, 1.0), (0.1, 1.0), (1.5, 1.0), (9.0, 1.0), (0.0, 0.0)):
            width, height, found = rendering._frame_size_px((2.0, 3.0, 2.0 + wide, 3.0 + high), size)
            assert found == strip
            share = min(max((wide or 1.0) / (high or 1.0), 0.75), 2.2)
            room = size - 2 * strip
            wanted = size if share > 0.9 else room * share
            assert abs(width - wanted) <= 1
            assert abs(height - 2 * strip - min(room, wanted / share)) <= 1
            assert width % 2 == height % 2 == 0


def places_of(texts: Any) -> list[tuple[float, float, float, float]]:
    """Returns left, top, right and bottom of each text."""
    return [(x, y, x + word.get_width(), y + word.get_height()) for word, (x, y) in texts]


def test_words_stand_in_the_middle_of_their_lines_and_touch_nothing() -> None:
    scene = scene_of("p3dx", 1)
    scene = dataclasses.replace(scene, path=np.zeros((2, 2)), bounds=(0.0, 0.0, 3.0, 9.0))
    renderer = Renderer("rgb_array", 20, 320)
    view = renderer.view(scene)
    sketch = Sketch(view)
    (scale, caption) = places_of(renderer._draw_header(sketch, view, "some words " * 20))
    bar, *ends = sketch.strokes
    middle, length = view.strip_px / 2, rendering._grid_step(view) * view.scale
    right = view.width_px - 12.0
    same([bar], [("rectangle", INK, [(right - length, middle - 1)], (length, 2))])
    same(ends, [("rectangle", INK, [(x, middle - 4)], (2, 8)) for x in (right - length, right - 2)])
    assert scale[2] == right - length - 7.0  # beside the bar
    assert caption[0] == 12.0
    assert scale[0] - 14.0 - 12.0 < caption[2] + 10.0 <= scale[0] - 14.0 + 10.0  # as long as there is room
    for _, top, _, bottom in (scale, caption):
        assert (top + bottom) / 2 == middle
    assert len(renderer._draw_header(sketch, view, "")) == 1

    sketch.strokes.clear()
    texts = renderer._draw_legend(sketch, view, scene)
    words = places_of(texts)
    lines = sorted({(top + bottom) / 2 for _, top, _, bottom in words})
    assert len(lines) > 1
    assert lines[-1] == view.height_px - view.strip_px / 2
    assert np.diff(lines).tolist() == [20.0] * (len(lines) - 1)
    for line in lines:
        row = [word for word in words if (word[1] + word[3]) / 2 == line]
        assert row[0][0] == 14.0 + 20.0
        # 16 px to the next symbol, 20 to its word; and no further than 8 px from the frame's side
        assert all(after[0] - before[2] == 36.0 for before, after in itertools.pairwise(row))
        assert row[-1][2] <= view.width_px - 8
        following = [word for word in words if (word[1] + word[3]) / 2 == line + 20.0]
        if following:
            assert row[-1][2] + 36.0 + following[0][2] - following[0][0] > view.width_px - 8
    # a symbol of each, 14 px before its word, in the word's line
    places = [np.mean(stroke[2], axis=0) for stroke in sketch.strokes if stroke[0] != "rectangle"]
    assert {float(x) for x, _ in places} <= {left - 14.0 for left, *_ in words}
    assert {float(y) for _, y in places} <= set(lines)


def test_the_legend_names_what_there_is() -> None:
    full = dataclasses.replace(scene_of("p3dx", 1), path=np.zeros((2, 2)))
    assert full.obstacles is not None
    words = ["path", "trail", "ghost", "rays", "fixed", "movable", "start", "waypoint", "goal", "look-ahead", "target"]
    assert [word for word, _ in rendering._legend(full)] == words

    def without(**layers: Any) -> set[str]:
        return set(words) - {word for word, _ in rendering._legend(dataclasses.replace(full, **layers))}

    assert without(path=None) == {"path"}
    assert without(trail=full.trail[:0]) == {"trail"}  # type: ignore[index]
    assert without(ghosts=full.ghosts[1:]) == {"ghost"}
    assert without(ranges=np.zeros(0)) == {"rays"}
    assert without(obstacles=full.obstacles[1:3]) == {"fixed"}
    assert without(obstacles=full.obstacles[[0, 3]]) == {"movable"}
    grid = OccupancyGrid(np.ones((2, 2), np.bool_), 0.5)
    assert without(obstacles=None, grid=grid) == {"movable"}
    assert without(obstacles=None) == {"fixed", "movable"}
    assert without(start=None) == {"start"}
    assert without(goals=full.goals[-1:]) == {"waypoint"}  # type: ignore[index]
    assert without(goals=None) == {"waypoint", "goal"}
    assert without(lookahead=None) == {"look-ahead"}
    assert without(reference=None) == {"target"}
    sizes = {}
    for word, symbol in rendering._legend(full):
        view = Renderer("rgb_array", 20).view(full)
        sketch = Sketch(view)
        symbol(sketch, np.array([100.0, 50.0]))
        sizes[word] = sketch.strokes
    for word, colour, width in (("path", PATH, 2.0), ("trail", BLUE, 1.5), ("ghost", PURPLE, 1.5), ("rays", SKY, 1.0)):
        same(sizes[word], [("line", colour, [(92.0, 50.0), (108.0, 50.0)], (width,))])
    for word, colour in (("fixed", FIXED), ("movable", ORANGE)):
        same(sizes[word], [("rectangle", colour, [(95.0, 45.0)], (10, 10))])


def test_notes_stand_line_by_line_on_a_panel_that_holds_them() -> None:
    renderer = Renderer("rgb_array", 20)
    view = renderer.view(scene_of("p3dx", 0))
    sketch = Sketch(view)
    assert renderer._draw_notes(sketch, view, ()) == []
    assert not sketch.strokes
    notes = places_of(renderer._draw_notes(sketch, view, ("one", "a longer one", "two")))
    ((_, colour, [(left, top)], (width, height)),) = sketch.strokes
    assert (colour, left, top) == (WHITE, 8, view.strip_px + 8)
    line = notes[1][1] - notes[0][1]
    assert line == notes[2][1] - notes[1][1] == notes[0][3] - notes[0][1] + 4.0
    for note in notes:
        assert note[0] == left + 8.0
        assert note[2] <= left + width - 8.0
        assert top + 6.0 <= note[1]
        assert note[3] <= top + height
    assert max(note[2] for note in notes) == left + width - 8.0
    assert (notes[0][1] - top, top + height - notes[-1][3]) == (6.0, 8.0)


def test_texts_are_cut_where_there_is_no_room_and_nowhere_else() -> None:
    whole = rendering._fitted_text("a caption", math.inf)
    exact = rendering._fitted_text("a caption", whole.get_width())
    assert exact.get_size() == whole.get_size()
    assert pygame.image.tobytes(exact, "RGBA") == pygame.image.tobytes(whole, "RGBA")
    cut = rendering._fitted_text("a caption", whole.get_width() - 1)
    assert 0.6 * whole.get_width() < cut.get_width() < whole.get_width()
    pygame.font.init()
    font = pygame.font.Font(None, 19)
    assert whole.get_width() == font.size("a caption")[0]
    fitting = max(font.size(f"{'a caption'[:k]}…")[0] for k in range(1, 9) if font.size(f"{'a caption'[:k]}…")[0] <= 40)
    assert rendering._fitted_text("a caption", 40).get_width() == fitting
    assert rendering._fitted_text("a caption", 2).get_width() <= 2


@pytest.mark.parametrize("cell", [0.004, 0.07, 0.6])
def test_a_dot_is_dark_where_something_under_it_is_occupied(cell: float) -> None:
    rng = np.random.default_rng(5)
    occupied = rng.random((40, 30)) < 0.05
    grid = OccupancyGrid(occupied, cell, (3.0, 2.0, 0.4), "free")
    view = Renderer("rgb_array", 20, 120).view(dataclasses.replace(scene_of("p3dx", 0), bounds=(0.0, 0.0, 6.0, 5.0)))
    canvas = Canvas(view.size_px)
    found = rendering._occupied_dots(canvas, view, grid)
    assert found.shape == (2 * view.width_px, 2 * view.height_px)
    dot = 1.0 / (2.0 * view.scale)  # m
    times = min(math.ceil(dot / cell), 8)
    for i, j in rng.integers(0, found.shape, (400, 2)).tolist() + np.argwhere(found)[:200].tolist():
        # a square of so many looks: any of them in an occupied cell
        looks = []
        for a in range(times):
            for b in range(times):
                x = view.centre[0] + (i + (a + 0.5) / times - view.width_px) * dot
                y = view.centre[1] - (j + (b + 0.5) / times - view.height_px) * dot
                at = (complex(x, y) - complex(3.0, 2.0)) * cmath.rect(1.0, -0.4) / cell
                row, column = math.floor(at.imag), math.floor(at.real)
                looks.append(0 <= row < 40 and 0 <= column < 30 and bool(occupied[row, column]))
        assert found[i, j] == any(looks)
    assert found.any()


# What reaches the surface: twice as large, whole dots, clipped.


def inked(canvas: Canvas) -> NDArray[np.bool_]:
    return np.asarray(pygame.surfarray.array3d(canvas.surface)).any(axis=2)


def test_strokes_are_drawn_twice_as_large_and_within_the_clip() -> None:
    canvas = Canvas((60, 40))
    assert canvas.surface.get_size() == (120, 80)
    canvas.rectangle(WHITE, 5.2, 6.7, 10, 3.25)
    columns, rows = np.nonzero(inked(canvas))
    assert (columns.min(), columns.max() + 1, rows.min(), rows.max() + 1) == (10, 30, 14, 20)
    canvas.surface.fill(0)
    canvas.disc(WHITE, np.array([30.0, 20.0]), 8.0)
    assert inked(canvas).sum() == pytest.approx(math.pi * 16.0**2, rel=0.05)
    assert np.argwhere(inked(canvas)).mean(axis=0) == pytest.approx([60.0, 40.0], abs=0.6)
    canvas.surface.fill(0)
    canvas.disc(WHITE, np.array([30.0, 20.0]), 8.0, 1.5)
    assert inked(canvas).sum() == pytest.approx(math.pi * (16.0**2 - 13.0**2), rel=0.1)
    canvas.surface.fill(0)
    canvas.line(WHITE, np.array([[10.0, 5.0], [10.0, 25.0], [50.0, 25.0]]), 2.0)
    assert inked(canvas).sum() == pytest.approx(4 * (40 + 80), rel=0.1)
    canvas.line(WHITE, np.array([[10.0, 35.0]]), 2.0)  # one point is no line
    canvas.surface.fill(0)
    canvas.clip((10, 8, 20, 6))
    canvas.rectangle(WHITE, 0, 0, 60, 40)
    columns, rows = np.nonzero(inked(canvas))
    assert (columns.min(), columns.max() + 1, rows.min(), rows.max() + 1) == (20, 60, 16, 28)
    canvas.clip(None)
    canvas.surface.fill(0)
    canvas.polygon(WHITE, np.array([[10.0, 10.0], [30.0, 10.0], [30.0, 20.0], [10.0, 20.0]]))
    assert inked(canvas).sum() == pytest.approx(40 * 20, rel=0.1)
    assert canvas.smoothed().get_size() == (60, 40)
    # pygame counts in 32 bits
    assert rendering._dots(np.array([[np.nan, 1e12], [-1e12, 1.26]])) == [[-20_000, 20_000], [-20_000, 3]]


def test_what_is_translucent_lets_through_what_lies_below() -> None:
    canvas = Canvas((60, 40))
    canvas.surface.fill((100, 100, 100))
    canvas.translucent(90, np.array([30.0, 20.0]), 10.0, lambda it: it.rectangle((255, 0, 0), 0, 0, 60, 40))
    drawn = pygame.surfarray.array3d(canvas.surface).astype(int)
    through = np.abs(drawn - (100 + 155 * 90 / 255, 100 - 100 * 90 / 255, 100 - 100 * 90 / 255)).max(axis=2) <= 2
    columns, rows = np.nonzero(through)
    assert (columns.min(), columns.max() + 1, rows.min(), rows.max() + 1) == (40, 80, 20, 60)
    assert through.sum() == 40 * 40
    canvas.surface.fill((100, 100, 100))
    ends = np.array([[[10.0, 20.0], [50.0, 20.0]], [[200.0, 300.0], [220.0, 300.0]]])
    canvas.translucent_lines((255, 0, 0), 120, ends, 2.0)
    drawn = pygame.surfarray.array3d(canvas.surface).astype(int)
    changed = (drawn != 100).any(axis=2)
    assert changed.sum() == pytest.approx(80 * 4, rel=0.05)
    assert np.abs(drawn[changed] - (100 + 155 * 120 / 255, 100 - 100 * 120 / 255, 100 - 100 * 120 / 255)).max() <= 2
    for nowhere in (np.array([500.0, 20.0]), np.array([30.0, -400.0])):
        canvas.translucent(90, nowhere, 5.0, lambda it: pytest.fail("drawn beyond the frame"))


# ---- what the tasks hand to a frame


def told_of(env_id: str, index: int, actions: list[list[float]], **kwargs: Any) -> Any:
    """Returns a task, the state of its robot after some actions, and what a frame is told of it."""
    env: Any = gymnasium.make(f"wayfield/{env_id}-v0", **kwargs).unwrapped
    env.reset(seed=3, options={"scenario": index})
    for action in actions:
        env.step(np.array(action, np.float32))
    state = env.batch.states[0].copy()
    drawing = env.task.drawing(state)
    env.close()
    return env.task, state, drawing


def corners_of(points: Any, margin: float) -> list[float]:
    return [float(each) for each in (*(np.min(points, axis=0) - margin), *(np.max(points, axis=0) + margin))]


@pytest.mark.parametrize("scenario", ["splines/test", "figure_eight_lap"])
def test_a_frame_of_a_path_holds_its_corridor_and_both_points_of_document_a(scenario: str) -> None:
    task, state, told = told_of("DiffDrivePathFollowing", 0, [[0.4, 0.6]] * 7, scenario=scenario)
    course = task.scenarios[0]
    lap = [course.path.points[:1]] if course.path.closed else []
    np.testing.assert_allclose(told["path"], np.vstack([course.path.points, *lap]), atol=1e-9)
    assert told["corridor"] == course.corridor
    assert list(told["bounds"]) == pytest.approx(corners_of(told["path"], course.corridor + task.robot.hull_radius))
    assert told["start"] == pytest.approx(tuple((course.start or course.path.points[0])[:2]), abs=1e-6)
    at, ahead = complex(state["x"], state["y"]), 0.5 * cmath.exp(1j * state["heading"])
    assert complex(*told["lookahead"]) == pytest.approx(at + ahead)
    # the nearest point of the path to the one that is half a metre ahead
    ends = told["path"] @ np.array([1.0, 1j])
    shares = np.linspace(0.0, 1.0, 50)[:, None]
    least = np.abs((1.0 - shares) * ends[:-1] + shares * ends[1:] - complex(*told["lookahead"])).min()
    assert abs(complex(*told["reference"]) - complex(*told["lookahead"])) == pytest.approx(least, abs=1e-4)
    error = 100.0 * float(state["cross_track_error"])
    assert told["caption"] == f"t {0.35:5.2f} s   cross-track error {error:+6.1f} cm"


@pytest.mark.parametrize("scenario", ["moving_crowd/test", "doors_medium/test", "clutter_10/test"])
def test_a_frame_of_a_field_holds_all_that_stands_and_moves(scenario: str) -> None:
    task, state, told = told_of("OmniGoalObstacles", 2, [[0.2, 0.1, 0.3]] * 4, scenario=scenario)
    world = task.scenarios[2]
    points = [complex(*world.start[:2]), complex(*world.goal[:2]), *(complex(*each) for each in world.waypoints)]
    for k, each in enumerate(world.obstacles):
        long, wide = each["half_length"], each["half_width"]
        turn = complex(each["cos"], each["sin"])
        round_ = [each["radius"] * side for side in (1, 1j, -1, -1j)]
        shape = [turn * complex(a * long, b * wide) + r for a in (-1, 1) for b in (-1, 1) for r in round_]
        places = [complex(each["x"], each["y"])]
        way = world.patrols[k]
        if way["leg_time"] > 0.0:
            first = complex(way["x"], way["y"])
            places += [first, first + way["leg_time"] * complex(way["vx"], way["vy"])]
        points += [place + corner for place in places for corner in shape]
    assert (scenario == "moving_crowd/test") == bool((world.patrols["leg_time"] > 0.0).any())
    flat = np.array([[each.real, each.imag] for each in points])
    assert list(told["bounds"]) == pytest.approx(corners_of(flat, 2.0 * task.robot.hull_radius))
    assert told["start"] == world.start[:2]
    assert told["goals"][-1].tolist() == list(world.goal)
    assert np.isnan(told["goals"][:-1, 2]).all()
    assert (told["goal_tolerance"], told["max_range"]) == (world.position_tolerance, task.max_range)
    assert told["grid"] is None
    away, room = float(state["goal_distance"]), float(state["clearance"])
    assert told["caption"] == f"t {0.2:5.2f} s   goal {away:5.2f} m   clearance {room:5.2f} m"


def test_a_frame_of_a_large_map_shows_where_the_robot_drives(tmp_path: Path) -> None:
    cells = np.zeros((600, 400), bool)
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = True, True, True, True
    np.save(tmp_path / "hall.npy", cells)
    scene = {"start": [1, 30, 0], "goal": [4, 30.5, 0], "heading_tolerance": 3.14}
    for size, least in ((0.1, 2.0), (0.02, 0.0)):
        told = scene | {"map": {"file": "hall.npy", "resolution": size}}
        if size < 0.1:  # a room of 8 x 12 m is shown whole
            told |= {"start": [1, 6, 0], "goal": [4, 6.5, 0]}
        (tmp_path / "scene.json").write_text(json.dumps(told), encoding="utf-8")
        task, state, drawn = told_of("DiffDriveGoalObstacles", 0, [], scenario=str(tmp_path / "scene.json"))
        if not least:
            room = corners_of([[0.0, 0.0], [8.0, 12.0]], 2.0 * task.robot.hull_radius)
            assert list(drawn["bounds"]) == pytest.approx(room)
            continue
        left, low, right, high = drawn["bounds"]
        assert (right, low, high) == pytest.approx((4.0 + least, 30.25 - 1.5 - least, 30.25 + 1.5 + least))
        assert -0.3 < left < 0.0  # the wall, and what is beyond it just so
        # wherever it goes, the robot is seen with what is around it; a frame moves once a metre
        seen = set()
        for x in np.arange(1.0, 18.0, 0.05):
            state["x"], state["y"] = x, 40.0
            bounds = task.drawing(state)["bounds"]
            seen.add(bounds)
            assert bounds[0] <= 1.0
            assert bounds[2] >= min(max(x, 4.0) + 1.5, 40.0)
            assert bounds[3] >= 41.5
        assert 13 <= len(seen) <= 15
