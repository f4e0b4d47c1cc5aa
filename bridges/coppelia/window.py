"""The window of a server: the scene from above, with markers, dummies, paths and drawing objects."""

import time
from typing import TYPE_CHECKING

import numpy as np

from wayfield.bridges.coppelia import frames
from wayfield.bridges.coppelia.constants import DISC, DUMMY
from wayfield.bridges.coppelia.drawing import Drawing
from wayfield.bridges.coppelia.scene import Object
from wayfield.bridges.coppelia.world import World
from wayfield.envs.rendering import Colour, Mark, Renderer, Scene

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Server

FPS = 20  # frames in a second, at most
_INK: Colour = (52, 58, 66)
_DUMMY_COLOUR: Colour = (204, 121, 167)
_LINES, _TRIANGLES, _LINE_STRIP = 1, 2, 8
_METRES = (7, 9, 10, 11, 12)  # kinds of drawing objects whose size is in metres


class Window:
    """Shows a server's world while it serves."""

    def __init__(self, render_mode: str = "human") -> None:
        self._renderer = Renderer(render_mode, 10 * FPS)  # the server's loop keeps the time
        self._next = 0.0

    def show(self, server: "Server") -> None:
        """Draws a frame, at most `FPS` a second."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + 1.0 / FPS
            self._renderer.draw(picture(server.world))

    def close(self) -> None:
        """Closes the window."""
        self._renderer.close()


def picture(world: World) -> Scene:
    """Returns the drawing of a world."""
    x, y, heading = world.robot_pose
    bounds = world.bounds or (x - 2.5, y - 2.5, x + 2.5, y + 2.5)
    # the view follows a robot beyond the floor
    bounds = (min(bounds[0], x), min(bounds[1], y), max(bounds[2], x), max(bounds[3], y))
    marks: list[Mark] = []
    path = None
    for node in world.scene.objects.values():
        if node.part or node.footprint is not None:
            continue
        if "PATH" in node.data and path is None:
            path = _rows(world, node)
        mark = _mark(world, node)
        if mark is not None:
            marks.append(mark)
    for drawing in world.drawings.drawings.values():
        marks += _drawn(world, drawing)
    count = int(world.batch.states["num_obstacles"][0])
    return Scene(
        robot=world.model.robot,
        pose=(x, y, heading),
        bounds=bounds,
        path=path,
        obstacles=world.batch.obstacles[0, :count],
        trail=np.array(world.trail).reshape(-1, 2),
        marks=tuple(marks),
        caption=f"{world.scene.name}   t {world.time:5.2f} s",
    )


def _rows(world: World, node: Object) -> np.ndarray | None:
    data = node.data["PATH"]
    if not isinstance(data, bytes) or len(data) % 56 or not data:
        return None  # clients may write any bytes there
    rows = np.frombuffer(data, "<f8").reshape(-1, 7)[:, :3]
    if not np.isfinite(rows).all():
        return None
    place = world.scene.pose(node)
    turn = np.array(frames.rotation(place[3:]))
    return np.asarray((rows @ turn.T + place[:3])[:, :2])


def _mark(world: World, node: Object) -> Mark | None:
    """Returns the mark of a marker on the floor or of a dummy; None for other objects."""
    pose = world.scene.pose(node)
    colour = None if node.colour is None else _shade(node.colour)
    if node.kind == DUMMY and node.alias not in ("Path", "ctrlPt"):
        return Mark(np.array([pose[:2]]), colour or _DUMMY_COLOUR, max(0.5 * node.size, 0.02))
    if node.primitive is not None and node.primitive[0] == DISC:
        return Mark(np.array([pose[:2]]), colour or _INK, 0.5 * node.primitive[1][0], outline=True)
    return None


def _drawn(world: World, drawing: Drawing) -> list[Mark]:
    """Returns the marks of a drawing object: points, or polylines."""
    if not drawing.items:
        return []
    points = np.array(drawing.items)
    node = world.scene.objects.get(drawing.parent)
    corners = points[:, : drawing.width if drawing.kind in (_LINES, _TRIANGLES) else 3].reshape(len(points), -1, 3)
    if node is not None:
        place = world.scene.pose(node)
        corners = corners @ np.array(frames.rotation(place[3:])).T + place[:3]
    flat = corners[:, :, :2]
    colour = _shade(drawing.colour)
    if drawing.kind == _LINE_STRIP:
        return [Mark(flat[:, 0], colour, line=max(drawing.size, 1.0))]
    if drawing.kind in (_LINES, _TRIANGLES):
        closed = np.concatenate([flat, flat[:, :1]], axis=1) if drawing.kind == _TRIANGLES else flat
        return [Mark(each, colour, line=max(drawing.size, 1.0)) for each in closed]
    radius = 0.5 * drawing.size if drawing.kind in _METRES else 0.0
    return [Mark(flat[:, 0], colour, radius, pixels=0.0 if radius else max(0.5 * drawing.size, 1.0))]


def _shade(colour: tuple[float, float, float]) -> Colour:
    red, green, blue = (round(255 * min(max(each, 0.0), 1.0)) for each in colour)
    return red, green, blue
