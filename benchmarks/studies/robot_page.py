"""The robots that ship and their sources, with a drawing to scale: python benchmarks/studies/robot_page.py

What stands between the markers of `docs/robots.md` and `docs/data_sheet.md`, and the drawing, come from the data
sheets; all else is written by hand.
"""

import math
from pathlib import Path
from typing import Any

import click
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Polygon, Rectangle
from numpy.typing import NDArray
from results_page import between

from wayfield.benchmarks.commands.lists import hull_words
from wayfield.benchmarks.figures.drawing import RC, colour, subplots
from wayfield.benchmarks.records.table import Table
from wayfield.envs.robots import FULL_TURN, ROBOTS, Robot, Sensors, Wheel
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

BEGIN, END = "<!-- robots: made by python benchmarks/studies/robot_page.py -->", "<!-- end of robots -->"
PAGE, SOURCES, DRAWING = "robots.md", "data_sheet.md", "robots.png"
_COLUMNS = 5  # of the drawing
_WIDE = 0.5  # of a wheel, times its radius; data sheets do not say
_ROLLERS = 5  # drawn on a wheel
_BODY, _INK, _SOFT = "#E3EDF7", "#2B3440", "#9AA2AC"


def _corners(wheel: Wheel) -> NDArray[np.float64]:
    """Returns the corners (4, 2) of a wheel seen from above, m."""
    c, s = math.cos(wheel.direction), math.sin(wheel.direction)
    half = np.array([[1.0, _WIDE], [-1.0, _WIDE], [-1.0, -_WIDE], [1.0, -_WIDE]]) * wheel.radius
    corners: NDArray[np.float64] = half @ np.array([[c, s], [-s, c]]) + (wheel.x, wheel.y)
    return corners


def _rollers(axis: Any, wheel: Wheel) -> None:
    """Draws the axes of some rollers as they lie on the floor: the direction in which the wheel pulls."""
    along = np.array([math.cos(wheel.direction), math.sin(wheel.direction)])
    across = np.array([-along[1], along[0]])
    pull = along * math.cos(wheel.roller_angle) + across * math.sin(wheel.roller_angle)
    spread = along if wheel.roller_angle else across * _WIDE
    reach = min(_WIDE / max(abs(math.sin(wheel.roller_angle)), 1e-9), 0.35) * wheel.radius
    for k in range(_ROLLERS):
        share = (2.0 * k / (_ROLLERS - 1) - 1.0) * 0.75
        middle = np.array([wheel.x, wheel.y]) + share * wheel.radius * spread
        ends = np.array([middle - reach * pull, middle + reach * pull])
        axis.plot(*ends.T, color="white", linewidth=0.7, solid_capstyle="butt", zorder=4)


def _robot(axis: Any, robot: Robot, most: float) -> None:
    """Draws a robot from above, ahead to the right: hull, wheels as built and as they act, rollers, encoders, scan."""
    if robot.hull_box is None:
        hull: Any = Circle((0.0, 0.0), robot.hull_radius)
    else:
        length, width = robot.hull_box
        hull = Rectangle((robot.hull_x - 0.5 * length, -0.5 * width), length, width)
    hull.set(facecolor=_BODY, edgecolor=colour(1), linewidth=1.2)
    axis.add_patch(hull)
    for wheel in robot.built:
        axis.add_patch(Polygon(_corners(wheel), facecolor=_INK, edgecolor=_INK, linewidth=0.5, zorder=3))
        if robot.holonomic:
            _rollers(axis, wheel)
    if robot.built != robot.wheels:
        for wheel in robot.wheels:
            axis.add_patch(Polygon(_corners(wheel), fill=False, edgecolor=colour(0), linestyle="--", zorder=3))
    for wheel in robot.encoders:
        axis.add_patch(Polygon(_corners(wheel), facecolor=_SOFT, edgecolor=_SOFT, zorder=3))
    head = 0.45 * robot.hull_radius
    axis.annotate("", (head, 0.0), (-0.25 * head, 0.0), arrowprops={"arrowstyle": "-|>", "color": colour(1)}, zorder=5)
    half = math.degrees(0.5 * robot.sensors.angle)
    around = 2.0 * robot.hull_radius + 0.04
    axis.add_patch(Arc((0.0, 0.0), around, around, theta1=-half, theta2=half, color=colour(5), linewidth=1.6))
    axis.set(xlim=(-most, most), ylim=(-most, most), aspect="equal")
    axis.axis("off")
    axis.set_title(f"{robot.name}\n{robot.drive}\nhull {hull_words(robot)}", fontsize=10.5)


def drawing() -> Figure:
    """Returns all robots, each to the same scale."""
    most = 1.08 * max(robot.hull_radius for robot in ROBOTS.values()) + 0.02
    rows = math.ceil(len(ROBOTS) / _COLUMNS)
    figure, axes = subplots(rows, _COLUMNS, figsize=(2.5 * _COLUMNS, 3.3 * rows + 0.5), squeeze=False)
    for axis, robot in zip(axes.flat, ROBOTS.values(), strict=False):
        _robot(axis, robot, most)
    for axis in axes.flat[len(ROBOTS) :]:
        axis.axis("off")
    first = axes[0, 0]
    low = 0.06 - most
    first.plot((-most, 0.1 - most), (low, low), color=_INK, linewidth=2.0, solid_capstyle="butt")
    first.text(0.12 - most, low, "0.1 m", va="center", fontsize=11)
    note = (
        "Seen from above, ahead is to the right. Lines on wheels: axes of the rollers on the floor.\n"
        "Grey: encoder wheels. Dashed: where a skid steer's wheels act. "
        "Light blue: field of view of the lidar, not its range."
    )
    figure.text(0.01, 0.01, note, fontsize=10)
    figure.subplots_adjust(0.01, 0.09, 0.99, 0.88, hspace=0.42)
    return figure


def _row(robot: Robot) -> list[str]:
    """Returns a robot's row of the table."""
    radii = sorted({wheel.radius for wheel in robot.wheels})
    twist = ", ".join(f"{value:.3g}" for value in robot.max_twist)
    scan = robot.sensors
    angle = "full circle" if scan.angle == FULL_TURN else f"{scan.angle:.3g} rad"
    return [
        f"`{robot.name}`",
        robot.title,
        robot.drive,
        f"{robot.hull_radius:.3g}",
        ", ".join(f"{radius:g}" for radius in radii),
        twist,
        f"{robot.acceleration:g}, {robot.yaw_acceleration:g}, {robot.actuators('lagged').lag:g}",
        f"{robot.mass:g}, {robot.inertia:g}, {robot.friction:g}",
        f"{scan.beams}, {scan.range:g} m, {angle}" if scan != Sensors() else "",
    ]


_SOURCES = (
    "Where the numbers of each data sheet come from. Documents A, B and C are [the three reference "
    "papers](documents.md): the P3DX look-ahead report, the three-wheel omni paper and the four-wheel APF paper "
    "(artificial potential fields). `chosen` numbers are ours."
)


def generated() -> dict[str, list[str]]:
    """Returns what stands between the markers, by page: the drawing and the table; the source of every number."""
    header = [
        "name",
        "robot",
        "drive",
        "hull radius (m)",
        "wheel radius (m)",
        "top speeds: v_x, (v_y,) yaw rate (m/s, rad/s)",
        "`lagged`: acceleration (m/s², rad/s²), lag (s)",
    ]
    header += ["mass (kg), inertia (kg m²), friction", "scan"]
    note = (
        "Hull radius: that of the enclosing disc. Top speeds are at rated wheel speed, each axis alone. Where the "
        "column `scan` is empty, `gymnasium.make` uses its default: 32 beams, 5 m, full circle. Documents B and C are "
        f"reference papers; [sources]({SOURCES}#sources) says where each number comes from."
    )
    table = Table("Included robots", header, [_row(robot) for robot in ROBOTS.values()], note).markdown()
    sources = [f"## Sources\n\n{_SOURCES}\n"]
    for robot in ROBOTS.values():
        lines = "\n".join(f"- `{field}`: {source}" for field, source in robot.sources.items())
        sources.append(f"### {robot.name}: {robot.title}\n\n{lines}\n")
    return {PAGE: [f"![Every robot to scale]({DRAWING})\n", table], SOURCES: sources}


@click.command("robot_page", cls=OneLineErrors)
@click.option(
    "--docs",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=Path("docs"),
    show_default=True,
    help=f"The folder with {PAGE} and {SOURCES}.",
)
def main(docs: Path) -> None:
    """Writes the robots that ship and their sources between the markers, and a drawing to scale, from data sheets."""
    try:
        pages = {
            docs / name: between((docs / name).read_text(encoding="utf-8"), BEGIN, END, lines)
            for name, lines in generated().items()
        }
    except (OSError, ValueError) as reason:
        raise click.ClickException(f"{docs}: {reason}") from None
    with matplotlib.rc_context(RC):
        drawing().savefig(docs / DRAWING, dpi=110)
    for page, text in pages.items():
        write_whole(page, text.encode())
    click.echo(f"{len(ROBOTS)} robots in {docs / PAGE}")


if __name__ == "__main__":
    main()
