"""Frames of a robot in its world, drawn with pygame: as arrays without any display, or in a window."""

import contextlib
import dataclasses
import itertools
import math
import os
import weakref
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from wayfield.envs.robots import Robot
from wayfield.envs.world.geometry import Bounds
from wayfield.envs.world.grids import OccupancyGrid
from wayfield.system.extras import installs

try:
    import pygame
except ImportError as error:
    raise DependencyNotInstalled(
        f"rendering needs pygame-ce: {installs('render')}; check_env does without, with skip_render_check=True"
    ) from error
if not getattr(pygame, "IS_CE", 0):
    raise DependencyNotInstalled(
        "rendering needs pygame-ce, but pygame is installed over it: pip uninstall -y pygame pygame-ce, then "
        f"{installs('render')}"
    )

Colour = tuple[int, int, int]

# Okabe and Ito's palette, which stays apart under every common colour blindness, on neutral greys.
_BLUE: Colour = (0, 114, 178)
_SKY: Colour = (86, 180, 233)
_GREEN: Colour = (0, 158, 115)
_ORANGE: Colour = (230, 159, 0)
_VERMILLION: Colour = (213, 94, 0)
_PURPLE: Colour = (204, 121, 167)
_WHITE: Colour = (255, 255, 255)
_FLOOR: Colour = (248, 249, 250)
_GRID: Colour = (231, 234, 237)
_CORRIDOR: Colour = (222, 238, 249)
_PATH: Colour = (146, 154, 164)
_HULL: Colour = (190, 218, 236)
_FIXED: Colour = (96, 106, 117)
_INK: Colour = (52, 58, 66)

_YELLOW: Colour = (240, 228, 66)

OF_TEAM = (_BLUE, _VERMILLION, _GREEN, _ORANGE, _SKY, _YELLOW, _INK)  # robots by their number, round and round
_PEOPLE = _PURPLE
_GHOSTS = (_PURPLE, _ORANGE, _GREEN, _VERMILLION, _INK)  # other robots by their number, round and round

_SUPERSAMPLING = 2  # shapes are drawn this much larger and smoothed down
_MARGIN = 0.07  # of the view, on each side of the bounds
_ASPECTS = (0.75, 2.2)  # width over height of the view, so that caption and legend always find room
_STRIP_PX = 28  # for the caption above the view and for the legend below it
_SMALLEST_WITH_TEXT_PX = 300  # frames whose longer side is below show the world alone
_LEAST_WITH_TEXT_PX = (400, 300)  # the same of frames of a given width and height
_FONT_PX = 19
_ROBOT_RADIUS_PX = 10.0  # the least: smaller robots are drawn larger than they are
_WALL_PX = 3.0  # the least width of a wall
_DRAWN_POINTS = 20_000  # of a polyline, at most
_PAST_ALPHA, _GHOST_ALPHA = 90, 190  # of 255: of the robot at another time, of another robot
_MANY_BODIES = 100  # from which on they are drawn as small as they are
_FAR_PX = 20_000.0  # pixel coordinates are clipped here, because pygame counts in 32-bit integers


@dataclasses.dataclass(frozen=True)
class Mark:
    """Something that is shown beside the task: discs at points, or a polyline through them."""

    points: NDArray[np.float64]  # (n, 2) m
    colour: Colour
    radius: float = 0.0  # m, of the discs
    pixels: float = 0.0  # px, the least radius of the discs
    line: float = 0.0  # px, the width of the polyline; 0: discs
    outline: bool = False  # whether the discs are rings


@dataclasses.dataclass(frozen=True)
class Ghost:
    """A robot that is seen through: another one of the same scenario, or the same one at another time."""

    robot: Robot
    pose: tuple[float, float, float]  # x, y, heading
    trail: NDArray[np.float64] | None = None  # (t, 2) past positions
    name: str = ""  # in the legend, of another robot; "": the same one


@dataclasses.dataclass(frozen=True)
class Body:
    """A robot of a team with its goal, or a person, at a moment."""

    at: tuple[float, float, float]  # x, y (m), heading (rad)
    radius: float  # m
    colour: Colour
    person: bool = False
    goal: tuple[float, float] | None = None
    trail: NDArray[np.float64] | None = None  # (t, 2) past positions
    gone: bool = False  # whether it has left, so that only its goal and way are drawn


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """What one frame shows; metres and radians in the world frame."""

    robot: Robot
    pose: tuple[float, float, float]  # x, y, heading
    bounds: Bounds  # of the world to show
    path: NDArray[np.float64] | None = None  # (n, 2) polyline; closed ones repeat the first point
    corridor: float = 0.0  # half width drawn around the path, 0 = none
    obstacles: NDArray[np.void] | None = None  # (m,) records of geometry.OBSTACLE
    grid: OccupancyGrid | None = None
    goals: NDArray[np.float64] | None = None  # (k, 3) remaining poses: waypoints, then the goal; NaN = any heading
    goal_tolerance: float = 0.0  # radius around the goal, 0 = none
    ranges: NDArray[np.float64] | None = None  # (beams,)
    beam_angles: NDArray[np.float64] | None = None  # (beams,) in the body frame
    max_range: float = 0.0  # ranges from here on hit nothing; 0 = no limit
    trail: NDArray[np.float64] | None = None  # (t, 2) past positions
    reference: tuple[float, float] | None = None  # point of the path that is chased
    lookahead: tuple[float, float] | None = None  # look-ahead point of the robot
    start: tuple[float, float] | None = None
    marks: tuple[Mark, ...] = ()  # drawn over the obstacles, below the robot
    bodies: tuple[Body, ...] = ()  # the others, and of a team with `robot` of the first colour
    ghosts: tuple[Ghost, ...] = ()  # drawn below the robot
    name: str = ""  # of the robot, in the legend
    caption: str = ""  # one line
    notes: tuple[str, ...] = ()  # lines in the upper left corner of the world


@dataclasses.dataclass(frozen=True)
class View:
    """Where the world lies in a frame."""

    width_px: int  # of the frame
    height_px: int
    strip_px: int  # height of the strips above and below the world
    scale: float  # px/m
    centre: tuple[float, float]  # of the world shown, m

    @property
    def size_px(self) -> tuple[int, int]:
        """Returns (width, height) of the frame."""
        return self.width_px, self.height_px

    def pixels_from_world(self, points: Any) -> NDArray[np.float64]:
        """Returns pixel coordinates (..., 2), x right and y down, of world points (..., 2) in m."""
        offsets = (np.asarray(points, np.float64) - self.centre) * (self.scale, -self.scale)
        pixels: NDArray[np.float64] = offsets + np.array(self.size_px) / 2
        return pixels

    def world_from_pixels(self, pixels: Any) -> NDArray[np.float64]:
        """Returns world points (..., 2) in m of pixel coordinates (..., 2)."""
        offsets = (np.asarray(pixels, np.float64) - np.array(self.size_px) / 2) / (self.scale, -self.scale)
        points: NDArray[np.float64] = offsets + self.centre
        return points


def _frame_size_px(bounds: Bounds, size_px: int | tuple[int, int]) -> tuple[int, int, int]:
    """Returns width, height and strip height of a frame: that size, or within a square of it and even."""
    if not isinstance(size_px, int):
        words = all(side >= least for side, least in zip(size_px, _LEAST_WITH_TEXT_PX, strict=True))
        return *size_px, _STRIP_PX if words else 0
    strip = _STRIP_PX if size_px >= _SMALLEST_WITH_TEXT_PX else 0
    aspect = float(np.clip(_span(bounds)[0] / _span(bounds)[1], *_ASPECTS))
    room = size_px - 2 * strip
    # a nearly square world fills the square frame
    width = size_px if aspect > 0.9 else room * aspect
    height = min(room, width / aspect)
    return 2 * round(width / 2), 2 * round(height / 2) + 2 * strip, strip


def _span(bounds: Bounds) -> tuple[float, float]:
    """Returns width and height (m) of the bounds, never zero."""
    return max(bounds[2] - bounds[0], 1e-3), max(bounds[3] - bounds[1], 1e-3)


def _view(bounds: Bounds, frame_size_px: tuple[int, int, int]) -> View:
    """Returns the view that fits the bounds with a margin into a frame (width, height, strip height)."""
    width, height, strip = frame_size_px
    span_x, span_y = _span(bounds)
    scale = (1.0 - 2.0 * _MARGIN) * min(width / span_x, (height - 2 * strip) / span_y)
    centre = ((bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2)
    return View(width, height, strip, scale, centre)


class Canvas:
    """A supersampled surface; coordinates, widths and radii are in pixels of the finished frame."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        self.size_px = size_px
        self.surface = pygame.Surface((size_px[0] * _SUPERSAMPLING, size_px[1] * _SUPERSAMPLING), depth=32)

    def smoothed(self) -> pygame.Surface:
        """Returns the finished frame."""
        return pygame.transform.smoothscale(self.surface, self.size_px)

    def clip(self, rectangle: tuple[float, float, float, float] | None) -> None:
        """Keeps all further drawing inside the rectangle (x, y, width, height)."""
        self.surface.set_clip(None if rectangle is None else [round(_SUPERSAMPLING * v) for v in rectangle])

    def rectangle(self, colour: Colour, x: float, y: float, width: float, height: float) -> None:
        """Draws a filled rectangle whose edges lie on whole pixels of the frame, so that they stay crisp."""
        corner = [_SUPERSAMPLING * round(v) for v in (x, y)]
        self.surface.fill(colour, (*corner, round(_SUPERSAMPLING * width), round(_SUPERSAMPLING * height)))

    def paint(self, colour: Colour, dots: NDArray[np.bool_]) -> None:
        """Colours the dots (width, height) of the supersampled surface that are true, within the clip."""
        left, top, width, height = self.surface.get_clip()
        area = slice(left, left + width), slice(top, top + height)
        pygame.surfarray.pixels3d(self.surface)[area][dots[area]] = colour

    def disc(self, colour: Colour, at: NDArray[np.float64], radius: float, width: float = 0.0) -> None:
        """Draws a disc, or a ring of the given width inside the radius."""
        centre = _dots(at)
        pygame.draw.circle(self.surface, colour, centre, _SUPERSAMPLING * radius, round(_SUPERSAMPLING * width))

    def polygon(self, colour: Colour, corners: NDArray[np.float64], width: float = 0.0) -> None:
        """Draws a filled polygon, or its outline."""
        pygame.draw.polygon(self.surface, colour, _dots(corners), round(_SUPERSAMPLING * width))

    def line(self, colour: Colour, points: NDArray[np.float64], width: float) -> None:
        """Draws a polyline (n, 2) that is thin enough to need no round joints."""
        if len(points) > 1:
            pygame.draw.lines(self.surface, colour, False, _dots(points), max(1, round(_SUPERSAMPLING * width)))

    def band(self, colour: Colour, points: NDArray[np.float64], width: float) -> None:
        """Draws a polyline (n, 2) of any width, with round joints and ends."""
        for point in points:
            self.disc(colour, point, width / 2)
        for a, b in itertools.pairwise(points):
            length = math.hypot(*(b - a))
            if length > 0.0:
                across = np.array([a[1] - b[1], b[0] - a[0]]) * (width / 2 / length)
                self.polygon(colour, np.stack([a + across, b + across, b - across, a - across]))

    def translucent_lines(self, colour: Colour, alpha: int, ends: NDArray[np.float64], width: float) -> None:
        """Draws straight lines, ends (n, 2, 2), through which the layers below are seen."""
        points = np.array(_dots(ends))
        corner, far_corner = points.min(axis=(0, 1)), points.max(axis=(0, 1))
        area = pygame.Rect(corner.tolist(), (far_corner - corner + 1).tolist()).inflate(8, 8)
        area = area.clip(self.surface.get_clip())
        if area.width == 0 or area.height == 0:
            return
        layer = pygame.Surface(area.size, pygame.SRCALPHA)
        for a, b in (points - area.topleft).tolist():
            pygame.draw.line(layer, (*colour, alpha), a, b, round(_SUPERSAMPLING * width))
        self.surface.blit(layer, area)

    def translucent(self, alpha: int, at: NDArray[np.float64], radius: float, draw: Callable[["Canvas"], None]) -> None:
        """Draws what a function draws around a point, within a radius, so that the layers below are seen through it."""
        left, top = np.clip(np.floor(_SUPERSAMPLING * (at - radius)), -_FAR_PX, _FAR_PX).astype(np.int64).tolist()
        side = math.ceil(2 * _SUPERSAMPLING * radius)
        area = pygame.Rect(left, top, side, side).clip(self.surface.get_clip())
        if area.width == 0 or area.height == 0:
            return
        below = self.surface.subsurface(area).copy()
        draw(self)
        drawn = self.surface.subsurface(area).copy()
        drawn.set_alpha(alpha)
        self.surface.blit(below, area)
        self.surface.blit(drawn, area)

    def halo_disc(self, colour: Colour, at: NDArray[np.float64], radius: float) -> None:
        """Draws a disc with a white rim that sets it off from what lies below."""
        self.disc(_WHITE, at, radius + 1.5)
        self.disc(colour, at, radius)

    def arrow(self, colour: Colour, at: NDArray[np.float64], heading: float, length: float, width: float) -> None:
        """Draws an arrow from a point along a heading (rad, counter-clockwise as in the world)."""
        ahead = np.array([math.cos(heading), -math.sin(heading)])
        across = np.array([-ahead[1], ahead[0]])
        neck = at + (length - 3.5 * width) * ahead
        self.line(colour, np.stack([at, neck]), width)
        self.polygon(colour, np.stack([at + length * ahead, neck + 2 * width * across, neck - 2 * width * across]))


def _dots(points: NDArray[np.float64]) -> Any:
    """Returns the points as nested lists of integers on the supersampled surface."""
    scaled = np.clip(_SUPERSAMPLING * np.nan_to_num(points, nan=-_FAR_PX), -_FAR_PX, _FAR_PX)
    return np.rint(scaled).astype(np.int64).tolist()


def _thinned(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Returns one point (k, 2) per spacing along a polyline (n, 2), besides its ends; NaN are left out."""
    drawn = points[:: len(points) // _DRAWN_POINTS + 1]
    if len(points) > 0:
        drawn = np.concatenate([drawn, points[-1:]])
    drawn = drawn[np.isfinite(drawn).all(axis=1)]
    if len(drawn) < 3:
        return drawn
    arc_length = np.cumsum(np.hypot(*np.diff(drawn, axis=0).T))
    chosen = np.diff(np.floor(arc_length / spacing), prepend=0.0) > 0.0
    chosen[-1] = True
    return np.concatenate([drawn[:1], drawn[1:][chosen]])


def _placed(points: Any, pose: tuple[float, float, float]) -> NDArray[np.float64]:
    """Returns body-frame points (..., 2) in the world frame."""
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    placed: NDArray[np.float64] = np.asarray(points) @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    return placed


# Layers below everything that moves.


def _grid_step(view: View) -> float:
    """Returns the distance (m) between grid lines: 1 m, more where lines crowd, less in a tiny world."""
    if view.scale > view.width_px:
        return 0.1
    steps = [digit * 10.0**power for power in range(9) for digit in (1, 5)]
    return next((step for step in steps if step * view.scale >= 24.0), steps[-1])


def _draw_floor(canvas: Canvas, view: View) -> None:
    strip = view.strip_px
    canvas.surface.fill(_WHITE)
    canvas.rectangle(_FLOOR, 0, strip, view.width_px, view.height_px - 2 * strip)
    step = _grid_step(view)
    left, top = view.world_from_pixels((0, strip)) / step
    right, bottom = view.world_from_pixels((view.width_px, view.height_px - strip)) / step
    for i in range(math.ceil(left), math.floor(right) + 1):
        canvas.rectangle(_GRID, view.pixels_from_world((i * step, 0))[0], strip, 1, view.height_px - 2 * strip)
    for i in range(math.ceil(bottom), math.floor(top) + 1):
        canvas.rectangle(_GRID, 0, view.pixels_from_world((0, i * step))[1], view.width_px, 1)


def _draw_path(canvas: Canvas, view: View, path: NDArray[np.float64], corridor: float) -> None:
    if corridor > 0.0:
        canvas.band(_CORRIDOR, _thinned(path, 3.0), 2.0 * corridor * view.scale)
    canvas.line(_PATH, _thinned(path, 1.0), 2.0)


# Layers of one moment.


def _ray_ends(view: View, scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Returns where the rays end (beams, 2) in px, and which of them end on something."""
    if scene.ranges is None or scene.beam_angles is None:
        return np.zeros((0, 2)), np.zeros(0, np.bool_)
    reach = scene.max_range if scene.max_range > 0.0 else math.inf
    ranges = np.minimum(np.nan_to_num(scene.ranges, nan=math.inf, posinf=math.inf), reach)
    # a ray without end would lead off every frame
    drawn = np.minimum(ranges, 2.0 * max(view.size_px) / view.scale)
    directions = np.stack([np.cos(scene.beam_angles), np.sin(scene.beam_angles)], axis=-1)
    ends = view.pixels_from_world(_placed(drawn[:, None] * directions, scene.pose))
    return ends, ranges < reach


def _obstacle_outline(obstacle: Any, least_half_width: float) -> NDArray[np.float64]:
    """Returns the outline (n, 2) in m: a box, a wall or a circle is a rectangle whose corners are rounded."""
    radius = float(obstacle["radius"])
    half_length = float(obstacle["half_length"])
    half_width = max(float(obstacle["half_width"]), least_half_width - radius)
    arcs = np.linspace(0.0, math.pi / 2, 16) if radius > 0.0 else np.array([math.pi / 4])
    angles = (arcs + np.arange(4)[:, None] * (math.pi / 2)).ravel()
    signs = np.repeat([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]], len(arcs), axis=0)
    corners = signs * (max(half_length, least_half_width - radius), half_width)
    outline = corners + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return _placed(outline, (obstacle["x"], obstacle["y"], math.atan2(obstacle["sin"], obstacle["cos"])))


def _draw_obstacles(canvas: Canvas, view: View, obstacles: NDArray[np.void]) -> None:
    for obstacle in obstacles:
        corners = view.pixels_from_world(_obstacle_outline(obstacle, _WALL_PX / 2 / view.scale))
        if obstacle["mass"] > 0.0:
            canvas.polygon(_ORANGE, corners)
            canvas.polygon(_VERMILLION, corners, 1.5)
        else:
            canvas.polygon(_FIXED, corners)


def _occupied_dots(canvas: Canvas, view: View, grid: OccupancyGrid) -> NDArray[np.bool_]:
    """Returns which dots (width, height) of the canvas show something of a grid that is occupied."""
    width, height = canvas.surface.get_size()
    # looked at more than once a dot, where cells are smaller than that
    times = min(math.ceil(1.0 / (view.scale * _SUPERSAMPLING * grid.resolution)), 8)
    dots = np.zeros((width, height), np.bool_)
    for i, j in itertools.product(range(times), repeat=2):
        x, y = np.arange(width) + (i + 0.5) / times, np.arange(height) + (j + 0.5) / times
        pixels = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1) / _SUPERSAMPLING
        dots |= grid.is_occupied(view.world_from_pixels(pixels))
    return dots


def _mark_goal(canvas: Canvas, at: NDArray[np.float64], heading: float = math.nan) -> None:
    if math.isfinite(heading):
        canvas.arrow(_GREEN, at, heading, 26.0, 2.5)
    canvas.halo_disc(_GREEN, at, 5.5)


def _mark_waypoint(canvas: Canvas, at: NDArray[np.float64], heading: float = math.nan) -> None:
    if math.isfinite(heading):
        canvas.arrow(_GREEN, at, heading, 17.0, 1.5)
    canvas.disc(_GREEN, at, 5.0)
    canvas.disc(_WHITE, at, 3.0)


def _mark_start(canvas: Canvas, at: NDArray[np.float64]) -> None:
    for sign in (1.0, -1.0):
        canvas.line(_INK, at + np.array([[-4.0, -4.0 * sign], [4.0, 4.0 * sign]]), 2.0)


def _mark_lookahead(canvas: Canvas, at: NDArray[np.float64]) -> None:
    canvas.disc(_WHITE, at, 7.0)
    canvas.disc(_PURPLE, at, 6.5, 2.5)


def _mark_reference(canvas: Canvas, at: NDArray[np.float64]) -> None:
    canvas.halo_disc(_VERMILLION, at, 3.5)


def _draw_mark(canvas: Canvas, view: View, mark: Mark) -> None:
    pixels = view.pixels_from_world(mark.points)
    if mark.line > 0.0:
        canvas.line(mark.colour, _thinned(pixels, 1.0) if len(pixels) > 2 else pixels, mark.line)
        return
    radius = max(mark.radius * view.scale, mark.pixels, 1.0)
    for at in pixels[-_DRAWN_POINTS:]:
        canvas.disc(mark.colour, at, radius, 1.5 if mark.outline else 0.0)


def _draw_goals(canvas: Canvas, view: View, goals: NDArray[np.float64], tolerance: float) -> None:
    if len(goals) == 0:
        return
    pixels = view.pixels_from_world(goals[:, :2])
    if tolerance > 0.0:
        canvas.disc(_GREEN, pixels[-1], tolerance * view.scale, 1.5)
    for at, heading in zip(pixels[:-1], goals[:-1, 2], strict=True):
        _mark_waypoint(canvas, at, heading)
    _mark_goal(canvas, pixels[-1], goals[-1, 2])


def _body_outline(robot: Robot) -> NDArray[np.float64]:
    """Returns the corners (2 n, 2) in m of a body that has one side behind each of the n wheels."""
    wheels = sorted(((wheel.x, wheel.y) for wheel in robot.built), key=lambda place: math.atan2(place[1], place[0]))
    corners = []
    for x, y in wheels:
        distance = math.hypot(x, y)
        inset = 0.72 * distance
        side = 0.75 * math.sqrt(max(robot.hull_radius**2 - inset**2, 0.0))
        # neighbouring sides must not cross
        side = min(side, inset * math.tan(0.65 * math.pi / len(wheels)))
        middle, along = np.array([x, y]) * 0.72, np.array([-y, x]) / max(distance, 1e-9)
        corners += [middle - side * along, middle + side * along]
    return np.stack(corners)


def _wheel_outline(position: tuple[float, float], direction: float, radius: float) -> NDArray[np.float64]:
    """Returns the corners (4, 2) in m of a wheel seen from above."""
    corners = np.array([[1.0, 0.25], [-1.0, 0.25], [-1.0, -0.25], [1.0, -0.25]]) * radius
    return _placed(corners, (*position, direction))


def _draw_robot(
    canvas: Canvas, view: View, robot: Robot, pose: tuple[float, float, float], colour: Colour = _BLUE
) -> None:
    red, green, blue = (round(each + 0.7 * (255 - each)) for each in colour)
    hull = _HULL if colour == _BLUE else (red, green, blue)
    magnification = max(1.0, _ROBOT_RADIUS_PX / (robot.hull_radius * view.scale))
    radius_px = robot.hull_radius * magnification * view.scale

    def pixels(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return view.pixels_from_world(_placed(points * magnification, pose))

    centre = view.pixels_from_world(pose[:2])
    if robot.hull_box is None:
        canvas.disc(_WHITE, centre, radius_px + 1.5)
        canvas.disc(hull, centre, radius_px)
        canvas.disc(colour, centre, radius_px, 1.5)
    else:
        corners = 0.5 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * robot.hull_box
        middle = np.array([robot.hull_x, 0.0])
        canvas.polygon(colour, pixels(corners + middle))
        canvas.polygon(hull, pixels(0.94 * corners + middle))
    canvas.polygon(colour, pixels(_body_outline(robot)))
    for wheel in robot.built:
        canvas.polygon(_INK, pixels(_wheel_outline((wheel.x, wheel.y), wheel.direction, wheel.radius)))
    chevron = np.array([[0.55, 0.0], [-0.3, 0.38], [-0.1, 0.0], [-0.3, -0.38]]) * robot.hull_radius
    canvas.polygon(_WHITE, pixels(chevron))


def _draw_ghost(canvas: Canvas, view: View, ghost: Ghost, colour: Colour) -> None:
    if ghost.trail is not None:
        canvas.line(colour, _thinned(view.pixels_from_world(ghost.trail), 1.0), 1.5)
    reach = max(ghost.robot.hull_radius * view.scale, _ROBOT_RADIUS_PX) + 3.0
    centre = view.pixels_from_world(ghost.pose[:2])
    alpha = _GHOST_ALPHA if ghost.name else _PAST_ALPHA
    canvas.translucent(alpha, centre, reach, lambda it: _draw_robot(it, view, ghost.robot, ghost.pose, colour))


def _ghosts(scene: Scene) -> list[tuple[Ghost, Colour]]:
    """Returns the ghosts with their colours: the robot's own at another time, others one each."""
    named = itertools.cycle(_GHOSTS)
    return [(ghost, next(named) if ghost.name else _BLUE) for ghost in scene.ghosts]


def _draw_bodies(canvas: Canvas, view: View, bodies: tuple[Body, ...]) -> None:
    """Draws the goals and ways of all, and over them robots as discs with a wedge ahead, people with a nose."""
    least = _ROBOT_RADIUS_PX if len(bodies) < _MANY_BODIES else 2.0
    for body in bodies:
        if body.trail is not None and len(body.trail) > 1:
            canvas.line(body.colour, _thinned(view.pixels_from_world(body.trail), 1.0), 1.5)
        if body.goal is not None:
            at = view.pixels_from_world(body.goal)
            canvas.disc(body.colour, at, max(0.4 * body.radius * view.scale, 0.4 * least), 1.5)
    for body in (each for each in bodies if not each.gone):
        centre = view.pixels_from_world(body.at[:2])
        radius = max(body.radius * view.scale, (0.5 if body.person else 1.0) * least)
        wide = min(1.5, 0.2 * radius)
        canvas.disc(_WHITE, centre, radius + wide)
        canvas.disc(body.colour, centre, radius)
        if radius < 3.0:
            continue
        x, y, heading = body.at
        if body.person:
            ahead = view.pixels_from_world((x + math.cos(heading), y + math.sin(heading))) - centre
            nose = centre + 0.55 * radius * ahead / max(float(np.hypot(*ahead)), 1e-9)
            canvas.disc(_WHITE, nose, max(0.22 * radius, 1.0))
            continue
        wedge = np.array([[0.75, 0.0], [-0.45, 0.5], [-0.15, 0.0], [-0.45, -0.5]]) * (radius / view.scale)
        canvas.polygon(_WHITE, view.pixels_from_world(_placed(wedge, (x, y, heading))))


def _draw_chase_line(canvas: Canvas, view: View, scene: Scene) -> None:
    """Draws the line from the robot by way of the look-ahead point to the point that is chased."""
    stops = [scene.pose[:2]]
    for stop, colour in ((scene.lookahead, _PURPLE), (scene.reference, _VERMILLION)):
        if stop is not None:
            canvas.line(colour, view.pixels_from_world([stops[-1], stop]), 1.0)
            stops.append(stop)


def _draw_moment(canvas: Canvas, view: View, scene: Scene) -> None:
    """Draws all layers above the path, the robot and its markers last."""
    ray_ends, hits = _ray_ends(view, scene)
    if len(ray_ends) > 0:
        ray_starts = np.broadcast_to(view.pixels_from_world(scene.pose[:2]), ray_ends.shape)
        canvas.translucent_lines(_SKY, 120, np.stack([ray_starts, ray_ends], axis=1), 1.0)
    if scene.obstacles is not None:
        _draw_obstacles(canvas, view, scene.obstacles)
    for hit in ray_ends[hits]:
        canvas.disc(_WHITE, hit, 3.5)
        canvas.disc(_SKY, hit, 2.5)
    for mark in scene.marks:
        _draw_mark(canvas, view, mark)
    if scene.goals is not None:
        _draw_goals(canvas, view, scene.goals, scene.goal_tolerance)
    if scene.start is not None and not scene.bodies:
        _mark_start(canvas, view.pixels_from_world(scene.start))
    if scene.trail is not None:
        canvas.line(_BLUE, _thinned(view.pixels_from_world(scene.trail), 1.0), 1.5)
    _draw_bodies(canvas, view, scene.bodies)
    for ghost, colour in _ghosts(scene):
        _draw_ghost(canvas, view, ghost, colour)
    _draw_chase_line(canvas, view, scene)
    _draw_robot(canvas, view, scene.robot, scene.pose)
    if scene.lookahead is not None:
        _mark_lookahead(canvas, view.pixels_from_world(scene.lookahead))
    if scene.reference is not None:
        _mark_reference(canvas, view.pixels_from_world(scene.reference))


# Words around the world.

Symbol = Callable[[Canvas, NDArray[np.float64]], None]


def _stroke_symbol(colour: Colour, width: float) -> Symbol:
    def draw(canvas: Canvas, at: NDArray[np.float64]) -> None:
        canvas.line(colour, at + np.array([[-8.0, 0.0], [8.0, 0.0]]), width)

    return draw


def _block_symbol(colour: Colour) -> Symbol:
    def draw(canvas: Canvas, at: NDArray[np.float64]) -> None:
        canvas.rectangle(colour, at[0] - 5, at[1] - 5, 10, 10)

    return draw


def _disc_symbol(colour: Colour) -> Symbol:
    def draw(canvas: Canvas, at: NDArray[np.float64]) -> None:
        canvas.disc(colour, at, 6.0)

    return draw


def person(x: float, y: float, heading: float, radius: float) -> Body:
    """Returns a person to be drawn; m and rad."""
    return Body((x, y, heading), radius, _PEOPLE, person=True)


def _legend(scene: Scene) -> list[tuple[str, Symbol]]:
    """Returns a word and a symbol for each kind of thing in the scene."""
    masses = np.zeros(0) if scene.obstacles is None else scene.obstacles["mass"]
    paths, trails, rays, goals = (
        0 if array is None else len(array) for array in (scene.path, scene.trail, scene.ranges, scene.goals)
    )
    entries: list[tuple[bool, str, Symbol]] = [
        (paths > 0, "path", _stroke_symbol(_PATH, 2.0)),
        (trails > 0, scene.name or "trail", _stroke_symbol(_BLUE, 1.5)),
        *((bool(ghost.name), ghost.name, _stroke_symbol(colour, 1.5)) for ghost, colour in _ghosts(scene)),
        (rays > 0, "lidar", _stroke_symbol(_SKY, 1.0)),
        (bool(np.any(masses <= 0.0)) or scene.grid is not None, "obstacle", _block_symbol(_FIXED)),
        (bool(np.any(masses > 0.0)), "pushable", _block_symbol(_ORANGE)),
        (scene.start is not None and not scene.bodies, "start", _mark_start),
        (any(not body.person for body in scene.bodies), "others", _disc_symbol(OF_TEAM[1])),
        (any(body.person for body in scene.bodies), "people", _disc_symbol(_PEOPLE)),
        (goals > 1, "waypoint", _mark_waypoint),
        (goals > 0, "goal", _mark_goal),
        (scene.lookahead is not None, "look-ahead", _mark_lookahead),
        (scene.reference is not None, "target", _mark_reference),
    ]
    return [(word, symbol) for present, word, symbol in entries if present]


def _scale_bar(view: View) -> tuple[str, float]:
    """Returns the words and the length (px) of the scale bar, which is one step of the grid."""
    step = _grid_step(view)
    return f"{step:g} m", step * view.scale


class Renderer:
    """Draws scenes, in frames of one size; in the mode "human" in a window of its own.

    `close` ends the window, and no other window of the process. Its X and a pygame.QUIT event end it too, and with it
    all drawing.

    Args:
        size_px: (width, height) of the frames; or of their longer side, and the first scene decides on the other.
    """

    _shown: ClassVar["weakref.WeakSet[Renderer]"] = weakref.WeakSet()  # those with a window: all end by QUIT

    def __init__(self, render_mode: str, fps: int, size_px: int | tuple[int, int] = 640) -> None:
        if render_mode not in ("rgb_array", "human"):
            raise ValueError(f'render_mode must be "rgb_array" or "human", not {render_mode!r}')
        self._render_mode = render_mode
        self._fps = fps
        self._size_px = size_px
        self._frame_size_px: tuple[int, int, int] | None = None
        self._canvas: Canvas | None = None
        self._backdrop: Canvas | None = None
        self._backdrop_key: tuple[Any, ...] | None = None
        self._words: dict[str, pygame.Surface] = {}
        self._window: pygame.Window | None = None
        self._clock = pygame.time.Clock()
        self.over = False  # whether the user has closed the window

    def draw(self, scene: Scene) -> NDArray[np.uint8] | None:
        """Returns the frame (height, width, 3) in the mode "rgb_array"; in "human" it shows it instead."""
        if self._render_mode == "human":
            self._hear()
            if not self.over:
                self._show(self._frame(self.view(scene), scene))
            return None
        view = self.view(scene)
        pixels = np.frombuffer(pygame.image.tobytes(self._frame(view, scene), "RGB"), np.uint8)
        return pixels.reshape(view.height_px, view.width_px, 3).copy()

    def view(self, scene: Scene) -> View:
        """Returns where the world lies in the frame of this scene."""
        if self._frame_size_px is None:
            self._frame_size_px = _frame_size_px(scene.bounds, self._size_px)
        return _view(scene.bounds, self._frame_size_px)

    def close(self) -> None:
        """Closes the window; a later `draw` opens a new one, unless the user has closed it."""
        if self._window is not None:
            # not pygame.quit(), nor that of its displays: other users of pygame in this process keep what they opened
            self._window.destroy()
        self._window = None
        self._shown.discard(self)

    def _frame(self, view: View, scene: Scene) -> pygame.Surface:
        if self._canvas is None:
            self._canvas = Canvas(view.size_px)
        canvas = self._canvas
        canvas.clip(None)
        canvas.surface.blit(self._floor_and_path(view, scene).surface, (0, 0))
        canvas.clip((0, view.strip_px, view.width_px, view.height_px - 2 * view.strip_px))
        _draw_moment(canvas, view, scene)
        canvas.clip(None)
        if view.strip_px == 0:
            return canvas.smoothed()
        texts = self._draw_legend(canvas, view, scene) + self._draw_header(canvas, view, scene.caption)
        texts += self._draw_notes(canvas, view, scene.notes)
        frame = canvas.smoothed()
        # text goes on the finished frame, where its own smoothing is sharper than ours
        frame.fblits(texts)
        return frame

    def _floor_and_path(self, view: View, scene: Scene) -> Canvas:
        """Returns the layers that stay for an episode, drawn anew only when they change."""
        path = np.zeros((0, 2)) if scene.path is None else scene.path
        # thinned to a bounded size first, so that comparing a path of a million points costs little
        path = np.concatenate([path[:: len(path) // _DRAWN_POINTS + 1], path[-1:]])
        key = (view, scene.corridor, path.tobytes(), scene.grid)
        if self._backdrop is None or key != self._backdrop_key:
            self._backdrop, self._backdrop_key = Canvas(view.size_px), key
            _draw_floor(self._backdrop, view)
            self._backdrop.clip((0, view.strip_px, view.width_px, view.height_px - 2 * view.strip_px))
            if scene.grid is not None:
                self._backdrop.paint(_FIXED, _occupied_dots(self._backdrop, view, scene.grid))
            _draw_path(self._backdrop, view, view.pixels_from_world(path), scene.corridor)
        return self._backdrop

    def _draw_legend(
        self, canvas: Canvas, view: View, scene: Scene
    ) -> list[tuple[pygame.Surface, tuple[float, float]]]:
        """Draws the symbols and returns the words with their places; rows beyond the first grow upwards."""
        places = []
        x, row = 14.0, 0
        for text, symbol in _legend(scene):
            word = self._word(text)
            if x + 20 + word.get_width() > view.width_px - 8:
                x, row = 14.0, row + 1
            places.append((word, symbol, x, row))
            x += word.get_width() + 36
        texts = []
        for word, symbol, x, word_row in places:
            y = view.height_px - view.strip_px / 2 - 20.0 * (row - word_row)
            symbol(canvas, np.array([x + 6, y]))
            texts.append((word, (x + 20, y - word.get_height() / 2)))
        return texts

    def _draw_header(
        self, canvas: Canvas, view: View, caption: str
    ) -> list[tuple[pygame.Surface, tuple[float, float]]]:
        """Draws the scale bar and returns the texts above the world with their places."""
        words, length = _scale_bar(view)
        scale_word = self._word(words)
        right, middle = view.width_px - 12.0, view.strip_px / 2
        canvas.rectangle(_INK, right - length, middle - 1, length, 2)
        for x in (right - length, right - 2):
            canvas.rectangle(_INK, x, middle - 4, 2, 8)
        place = right - length - scale_word.get_width() - 7
        texts = [(scale_word, (place, middle - scale_word.get_height() / 2))]
        if caption:
            text = _fitted_text(caption, place - 26.0)
            texts.append((text, (12.0, middle - text.get_height() / 2)))
        return texts

    def _draw_notes(
        self, canvas: Canvas, view: View, notes: tuple[str, ...]
    ) -> list[tuple[pygame.Surface, tuple[float, float]]]:
        """Clears a panel for the notes and returns them with their places."""
        words = [self._word(note) for note in notes]
        if words:
            width, line = max(word.get_width() for word in words) + 16, words[0].get_height() + 4
            canvas.rectangle(_WHITE, 8, view.strip_px + 8, width, len(words) * line + 10)
        return [(word, (16.0, view.strip_px + 14.0 + k * line)) for k, word in enumerate(words)]

    def _word(self, word: str) -> pygame.Surface:
        if word not in self._words:
            self._words[word] = _fitted_text(word, math.inf)
        return self._words[word]

    def _show(self, frame: pygame.Surface) -> None:
        surface = None
        if self._window is not None:
            with contextlib.suppress(pygame.error):  # somebody else has called pygame.quit()
                surface = self._window.get_surface()
        if surface is None:
            _open_display()
            self._window = pygame.Window("wayfield", frame.get_size())
            self._shown.add(self)
            surface = self._window.get_surface()
        assert self._window is not None
        surface.blit(frame, (0, 0))
        self._clock.tick(self._fps)
        self._window.flip()

    def _hear(self) -> None:
        """Obeys the X of this window and QUIT; events of other windows stay in the queue."""
        if self._window is None or not pygame.display.get_init():
            return
        for event in pygame.event.get((pygame.WINDOWCLOSE, pygame.QUIT)):
            ends_all = event.type == pygame.QUIT
            mine = ends_all or event.window is self._window
            for renderer in list(self._shown) if ends_all else [self] * mine:
                renderer.over = True
                renderer.close()
            if not mine or (ends_all and pygame.display.get_surface() is not None):
                pygame.event.post(event)  # for the window of the user's own


class NoDisplay(RuntimeError):
    """There is no display to open a window on."""


def _open_display() -> None:
    """Opens the display; NoDisplay if SDL, finding none, fell back to a driver that shows nothing."""
    was_open = pygame.display.get_init()
    pygame.display.init()
    unseen = pygame.display.get_driver() in ("dummy", "offscreen")
    if unseen and not any(map(os.environ.get, ("SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER"))):
        if not was_open:
            pygame.display.quit()
        raise NoDisplay(
            'render_mode="human" found no display to open a window on: run it on a desktop (DISPLAY or WAYLAND_DISPLAY '
            'set), use render_mode="rgb_array", or draw to an unseen window with SDL_VIDEODRIVER=dummy; check_env does '
            "without, with skip_render_check=True"
        )


def _fitted_text(text: str, width_px: float) -> pygame.Surface:
    """Returns one line of text, shortened where it would exceed the width."""
    # a new font each time: one that is kept dies when somebody else calls pygame.quit()
    pygame.font.init()
    font = pygame.font.Font(None, _FONT_PX)
    shown = text
    while shown and font.size(shown)[0] > width_px:
        shown = shown.removesuffix("…")[:-1]
        shown = shown + "…" if shown else ""
    return font.render(shown, True, _INK)
