"""The pictures of the documentation: python benchmarks/studies/pictures.py

A sheet of each task with a scenario of every family, as the frozen training split begins, and of each environment the
whole way of a policy in one picture and a short film of it. A sheet carries a digest of what it shows, by which a test
sees that it is of today.
"""

import dataclasses
import hashlib
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from PIL import Image, PngImagePlugin

from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, TEAMS, Film
from wayfield.benchmarks.figures.drawing import PATH_COLOUR, RC, SOLID, colour, goal_mark, obstacle_patches, subplots
from wayfield.benchmarks.figures.one_drive import Drive, Place
from wayfield.benchmarks.figures.video import Way, gif, moments
from wayfield.envs.rendering import Renderer
from wayfield.envs.robots import robot_of
from wayfield.envs.scenarios import TaskSpec, splits
from wayfield.envs.single import FPS
from wayfield.envs.tasks.specs import CROWDS, EVERY
from wayfield.envs.world.movers import turns
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

FOLDER = "docs/pictures"
BUDGET = 2_000_000  # bytes of the folder
DIGEST = "wayfield"  # the text of a sheet's file that holds its digest
HULL = 0.3  # m, of the disc at the start: the largest that families have room for
_COLUMNS = 5
_COLOURS = 160  # of a picture; fewer, and marks of few pixels take the colour of others
_PICTURE_PX, _FILM_PX = 560, 280
_SKIP, _PACE = 5, 2.5  # control periods between two frames of a film; times the robot's


FILMS: Mapping[str, Film] = {
    contest.spec.ids[holonomic]: film
    for contest in (*CONTESTS.values(), TEAMS, ALL_CONTESTS["people-seen"])
    for holonomic, film in contest.films.items()
}


# Of the policies that cannot drive in the page, whose own pages show these; and of teams and people.
POLICY_FILMS: Mapping[str, Film] = {
    "lookahead_documented": Film("lookahead_documented", "circuits/train", 0, "p3dx"),
    "lookahead_retuned": Film("lookahead_retuned", "circuits/train", 0, "p3dx"),
    "mpc": Film("mpc", "circuits/train", 0, "p3dx"),
    "mpc_pose": Film("mpc_pose", "open/train", 1, "p3dx"),
    "apf_documented": Film("apf_documented", "apf_1", 0, "omni4", 15.0),
    "apf_escape": Film("apf_escape", "apf_1", 0, "omni4"),
    "nav2_dwb": Film("nav2_dwb", "clutter_10/train", 1, "turtlebot3"),
    "nav2_mppi": Film("nav2_mppi", "clutter_10/train", 1, "turtlebot3"),
    "hybrid": Film("hybrid", "clutter_10/train", 1, "p3dx"),
}

# Of bases whose hulls are larger than the frozen scenes are for.
HULL_FILMS: Mapping[str, Film] = {
    "mir100_door": Film("scan_planner", "doors_narrow/train@0.60", 1, "mir100", 120.0),
    "husky_crowd": Film("scan_planner", "moving_crowd/train@0.60", 0, "husky", 120.0),
}


def stem_of(env_id: str) -> str:
    """Returns what the files of an environment are called, without their ends."""
    return env_id.partition("/")[2].partition("-v")[0]


def sheet_name(spec: TaskSpec) -> str:
    """Returns the file of a task's sheet."""
    return f"{spec.name}_families.png"


def example(spec: TaskSpec, family: str) -> Any:
    """Returns the scenario that stands for a family: the first of its training split."""
    return splits.split(spec.name, family, "train")[0]


def digest(spec: TaskSpec) -> str:
    """Returns a digest of what the sheet of a task shows: its families and their scenarios, in whole micrometres."""
    sha = hashlib.sha256()
    for family in spec.families:
        scenario = example(spec, family)
        if spec.on_path:
            numbers = scenario.path.points
        elif spec in CROWDS.values():
            people = [scenario.walks[name] for name in ("x", "y", "goal_x", "goal_y", "radius")]
            numbers = np.concatenate([np.ravel(scenario.starts), np.ravel(scenario.goals), *people])
        else:
            there = [scenario.obstacles[name] for name in ("x", "y", "half_length", "half_width", "radius")]
            numbers = np.concatenate([scenario.start, scenario.goal, *there])
        sha.update(family.encode() + np.rint(1e6 * np.asarray(numbers, np.float64)).astype("<i8").tobytes())
    return sha.hexdigest()


def sheet(spec: TaskSpec) -> Figure:
    """Returns a figure with a scenario of each family of a task."""
    rows = math.ceil(len(spec.families) / _COLUMNS)
    figure, axes = subplots(rows, _COLUMNS, figsize=(2.0 * _COLUMNS, 2.2 * rows), squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for axis, family in zip(axes.flat, spec.families, strict=False):
        scenario = example(spec, family)
        if spec.on_path:
            _path(axis, scenario)
        elif spec in CROWDS.values():
            _crowd(axis, scenario)
        else:
            _field(axis, scenario)
        axis.set_title(family, fontsize=10.5)
        axis.set_aspect("equal", adjustable="datalim")
        axis.margins(0.08)
    figure.tight_layout()
    return figure


def _arrow(axis: Any, pose: Any, length: float, ink: str) -> None:
    """Draws where a pose looks."""
    x, y, heading = pose
    tip = (x + length * math.cos(heading), y + length * math.sin(heading))
    look = {"arrowstyle": "-|>", "color": ink, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", tip, (x, y), arrowprops=look, annotation_clip=False, zorder=5)


def _path(axis: Any, scenario: Any) -> None:
    """Draws a path and where it starts."""
    points = scenario.path.points
    if scenario.path.closed:
        points = np.vstack([points, points[:1]])
    axis.plot(*points.T, color=colour(1), linewidth=1.6)
    ahead = points[1] - points[0]
    span = float(np.ptp(points, axis=0).max())
    _arrow(axis, (*points[0], math.atan2(ahead[1], ahead[0])), 0.14 * span, colour(0))
    axis.plot(*points[0], "o", color=colour(0), markersize=4)
    _scale(axis, points)


def _crowd(axis: Any, scenario: Any) -> None:
    """Draws obstacles, of each robot its start and the way to its goal, and where people walk to."""
    obstacle_patches(axis, scenario.robots[0].obstacles)
    for walk in scenario.walks:
        place = float(walk["x"]), float(walk["y"])
        axis.add_patch(Circle(place, float(walk["radius"]), facecolor=colour(3), edgecolor="none", zorder=3))
        axis.plot(*np.array([place, (walk["goal_x"], walk["goal_y"])]).T, color=colour(3), linewidth=0.4, alpha=0.5)
    for k, (start, goal) in enumerate(zip(scenario.starts, scenario.goals, strict=True)):
        ink = colour(k if scenario.team > 1 else 1)
        at = float(start[0]), float(start[1])
        axis.add_patch(Circle(at, HULL, facecolor="none", edgecolor=ink, linewidth=1.0, zorder=4))
        axis.plot(*np.array([start[:2], goal[:2]]).T, color=ink, linewidth=0.5, linestyle="--", zorder=1)
        axis.plot(*goal[:2], "*", color=ink, markersize=6 if scenario.team < 32 else 3, zorder=4)
    _scale(axis, np.vstack([scenario.starts[:, :2], scenario.goals[:, :2]]))


def _field(axis: Any, scenario: Any) -> None:
    """Draws obstacles, the ways of those that move, the start with the largest hull, and the goal."""
    obstacle_patches(axis, scenario.obstacles)
    for ends in turns(scenario.obstacles):
        axis.plot(*ends.T, color=colour(0), linewidth=1.0, linestyle=":")
    start, goal = np.array(scenario.start), np.array(scenario.goal)
    ring = {"facecolor": "none", "edgecolor": colour(1), "linewidth": 1.4, "zorder": 4}
    axis.add_patch(Circle((float(start[0]), float(start[1])), HULL, **ring))
    _arrow(axis, start, 1.6 * HULL, colour(1))
    axis.plot(*np.array([start[:2], goal[:2]]).T, color=PATH_COLOUR, linewidth=0.8, linestyle="--", zorder=1)
    goal_mark(axis, goal)
    if scenario.heading_tolerance < math.pi:
        _arrow(axis, goal, 1.6 * HULL, "black")
    _scale(axis, np.array([start[:2], goal[:2]]))


def _scale(axis: Any, points: Any) -> None:
    """Draws a metre below what is shown."""
    axis.autoscale_view()
    bottom, top = axis.get_ylim()
    low = bottom - 0.07 * max(top - bottom, *np.ptp(points, axis=0))
    left = float(np.min(points[:, 0]))
    axis.plot((left, left + 1.0), (low, low), color=SOLID, linewidth=2.0, solid_capstyle="butt")
    axis.text(left + 1.15, low, "1 m", va="center", fontsize=9, color=SOLID)


def _png(image: Any, comment: str = "") -> bytes:
    """Returns a picture of PIL as a PNG of few colours, with a text in it."""
    info = PngImagePlugin.PngInfo()
    if comment:
        info.add_text(DIGEST, comment)
    content = io.BytesIO()
    image.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE).save(content, "PNG", optimize=True, pnginfo=info)
    return content.getvalue()


def sheet_png(spec: TaskSpec) -> bytes:
    """Returns the sheet of a task as a PNG."""
    with matplotlib.rc_context(RC):
        figure = sheet(spec)
        content = io.BytesIO()
        figure.savefig(content, format="png", dpi=100)
    return _png(Image.open(content), digest(spec))


def driven(env_id: str, shown: Film) -> tuple[bytes, bytes]:
    """Returns the whole way of a drive in an environment, as a PNG, and a film of it as a GIF."""
    place = Place(env_id, shown.scenario, shown.index, robot_of(shown.robot), "lagged", None, None, (), 0, "tuned")
    env = place.make(shown.policy)
    drive = Drive(env, place.policy(shown.policy, env))
    drive.begin(0, shown.index)
    renderer, way, frames = Renderer("rgb_array", FPS, _FILM_PX), Way(drive.single.task.options.dt), []
    for k, moment in enumerate(moments([drive], shown.seconds)):
        way.note(moment.scene)
        if moment.last or k % _SKIP == 0:
            # rays change everywhere in every frame: without them a film is a quarter as large
            frame = renderer.draw(dataclasses.replace(moment.scene, ranges=None))
            assert frame is not None
            frames += [frame] * (4 if moment.last else 1)
    env.close()
    click.echo(f"{env_id}: {shown.policy} in {shown.scenario} {shown.index}: {drive.status}")
    film = b"".join(gif(frames, _SKIP * drive.single.task.options.dt / _PACE))
    return _png(Image.fromarray(way.picture(_PICTURE_PX))), film


def id_of(shown: Film) -> str:
    """Returns the environment of a drive."""
    named = shown.scenario.partition("/")[0]
    spec = next(spec for spec in EVERY.values() if named in {*spec.families, *spec.presets})
    return spec.env_id(robot_of(shown.robot))


def files() -> dict[str, bytes]:
    """Returns all pictures by their names."""
    made = {sheet_name(spec): sheet_png(spec) for spec in EVERY.values()}
    for name, shown in POLICY_FILMS.items():
        made[f"policy_{name}.gif"] = driven(id_of(shown), shown)[1]
    for name, shown in HULL_FILMS.items():
        made[f"hull_{name}.png"] = driven(id_of(shown), shown)[0]
    for env_id, shown in FILMS.items():
        made[f"{stem_of(env_id)}.png"], made[f"{stem_of(env_id)}.gif"] = driven(env_id, shown)
    return made


@click.command("pictures", cls=OneLineErrors)
@click.option("--out", type=click.Path(path_type=Path), default=FOLDER, show_default=True, help="The folder.")
def main(out: Path) -> None:
    """Makes the documentation's pictures: every family of scenarios, and a drive in every environment."""
    made = files()
    total = sum(map(len, made.values()))
    if total > BUDGET:
        raise click.ClickException(f"the pictures have {total:,} bytes; at most {BUDGET:,} may be")
    out.mkdir(parents=True, exist_ok=True)
    for name, content in made.items():
        write_whole(out / name, content)
    click.echo(f"{len(made)} pictures in {out}: {total:,} bytes")


if __name__ == "__main__":
    main()
