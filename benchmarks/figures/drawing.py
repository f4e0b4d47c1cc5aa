"""What all figures share: colours, styles, scenes, and how a figure is saved."""

import contextlib
import gc
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.world import geometry
from wayfield.envs.world.geometry import Bounds, corners_of

__all__ = [
    "HANDLE",
    "PALETTE",
    "PATH_COLOUR",
    "RC",
    "SOLID",
    "STYLES",
    "colour",
    "floor_plan",
    "goal_mark",
    "look",
    "obstacle_patches",
    "saved",
    "subplots",
    "surroundings",
    "wall_lines",
]

# Near Okabe and Ito's, searched so that all nine stay apart under protanopia and deuteranopia too; with the line styles
# they tell three dozen curves apart. A colour goes by the order in which policies come up in a figure, so that a new
# policy has one.
PALETTE = ("#C55A08", "#025EB5", "#00B670", "#AE7CA0", "#FFAB02", "#44B3FC", "#090407", "#56205C", "#902920")
STYLES = ("-", "--", ":", "-.")
HANDLE = 3.5  # length of a line of a legend, in font sizes, so that dashes are seen
_MARKERS = "osD^vP*Xh"
MANY_WALLS = 10_000  # more make files of many megabytes, and hide what is free
PATH_COLOUR = "#9AA2AC"
SOLID = "#606A75"

RC: Any = {
    "font.size": 12,
    "axes.titlesize": 12,
    "axes.titley": 1.0,  # where it is anyway: to look for room takes a tenth of the time of a figure
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#E7EAED",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "svg.hashsalt": "wayfield",  # the same figure gives the same file
    "text.parse_math": False,  # a "$" in a name is a dollar; a label that is a formula says so
}


def colour(k: int) -> str:
    """Returns the colour of the k-th policy of a figure."""
    return PALETTE[k % len(PALETTE)]


def look(k: int) -> dict[str, Any]:
    """Returns colour, line style and marker of the k-th curve of a figure."""
    again = k // len(PALETTE)  # the colour was there so often
    marker = _MARKERS[(k + again) % len(_MARKERS)]
    return {"color": colour(k), "linestyle": STYLES[again % len(STYLES)], "marker": marker}


def saved(make: Callable[[], Figure], stem: Path) -> None:
    """Makes a figure in the style of the house and writes it as STEM.svg and STEM.png."""
    with matplotlib.rc_context(RC), _uncollected():
        figure = _laid_out(make)
        if any(axis.yaxis.get_offset_text().get_text() for axis in figure.axes):  # a title makes room for it
            with matplotlib.rc_context({"axes.titley": None}):
                figure = _laid_out(make)
        figure.savefig(f"{stem}.svg", metadata={"Date": None})
        figure.savefig(f"{stem}.png", dpi=130)


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """Lets no one look for waste: what a figure is made of lives until it is saved. The looks take a tenth of it."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _laid_out(make: Callable[[], Figure]) -> Figure:
    figure = make()
    layout, dpi = figure.get_layout_engine(), figure.dpi
    if layout is not None:  # once, as for the .svg: `savefig` would draw all that there is for it, in vain
        FigureCanvasSVG(figure)
        figure.dpi = 72
        layout.execute(figure)
        figure.dpi = dpi
        figure.set_layout_engine(None)
    return figure


def subplots(rows: int = 1, columns: int = 1, layout: Any = None, **kwargs: Any) -> tuple[Figure, Any]:
    """Returns what pyplot's do, of a figure for files alone: pyplot's backend and figures stay the user's."""
    figure = Figure(figsize=kwargs.pop("figsize"), layout=layout)
    return figure, figure.subplots(rows, columns, **kwargs)


def goal_mark(axis: Any, goal: np.ndarray) -> None:
    """Marks a goal with a star."""
    axis.plot(*goal[:2], "*", color="#F0E442", markeredgecolor="black", markeredgewidth=0.6, markersize=13, zorder=4)


def surroundings(trajectories: Sequence[Trajectory]) -> Bounds | None:
    """Returns the part of a large world to show, about the drive and the task; None: all of the world."""
    near = [trajectory.poses[:, :2] for trajectory in trajectories]
    near += [trajectory.goals[:, :2] for trajectory in trajectories if len(trajectory.goals)]
    near += [trajectory.path for trajectory in trajectories if len(trajectory.path)]
    world = [trajectory.walls.reshape(-1, 2) for trajectory in trajectories]
    for trajectory in trajectories:
        world += corners_of(trajectory.obstacles) if len(trajectory.obstacles) else ()
    return geometry.surroundings(np.vstack(near), np.vstack([near[0], *world]))


def _inside(low: np.ndarray, high: np.ndarray, bounds: Bounds | None) -> Any:
    """Returns which of the upright boxes (n, 2) between low and high have a part within the bounds."""
    if bounds is None:
        return slice(None)
    return ((high >= bounds[:2]) & (low <= bounds[2:])).all(axis=1)


def obstacle_patches(axis: Any, obstacles: np.ndarray, bounds: Bounds | None = None) -> None:
    """Draws circles, boxes and walls, of which something is within the bounds."""
    for each in obstacles[_inside(*corners_of(obstacles), bounds)] if len(obstacles) else ():
        centre = (float(each["x"]), float(each["y"]))
        if each["half_length"] == 0.0 and each["half_width"] == 0.0:
            axis.add_patch(Circle(centre, each["radius"], color=SOLID, alpha=0.55, linewidth=0))
            continue
        along = np.array([each["cos"], each["sin"]])
        long, wide = along * each["half_length"], np.array([-along[1], along[0]]) * each["half_width"]
        corners = [np.add(centre, a * long + b * wide) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
        axis.add_patch(Polygon(corners, color=SOLID, alpha=0.55, linewidth=0 if each["half_width"] else 2))


def wall_lines(axis: Any, walls: np.ndarray, bounds: Bounds | None = None) -> None:
    """Draws the sides (k, 2, 2) of what a map has occupied, of which something is within the bounds.

    Very many are drawn thinly, and in a vector file as a picture.
    """
    if len(walls):
        walls = walls[_inside(walls.min(axis=1), walls.max(axis=1), bounds)]
    if len(walls):
        many = len(walls) > MANY_WALLS
        width = math.sqrt(MANY_WALLS / len(walls)) if many else 1.0
        axis.add_collection(LineCollection(list(walls), colors=SOLID, linewidths=width, rasterized=many))


def floor_plan(axis: Any, title: str, bounds: Bounds | None = None) -> None:
    """Gives both axes one scale, names and a title; shows the bounds, or without them all that is drawn."""
    axis.set_title(title, loc="left")
    if bounds is None:
        axis.set_aspect("equal", adjustable="datalim")
    else:
        axis.set(xlim=bounds[::2], ylim=bounds[1::2])
        axis.set_aspect("equal", adjustable="box")  # beyond the bounds nothing is drawn
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
