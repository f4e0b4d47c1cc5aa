"""The drawing of the robots that ship, piece by piece from their data sheets."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.colors import to_hex
from matplotlib.patches import Arc, Circle, Polygon, Rectangle

from wayfield.benchmarks import robot_page
from wayfield.benchmarks.drawing import colour, plt
from wayfield.benchmarks.lists import hull_words
from wayfield.envs.robots import FULL_TURN, ROBOTS, Robot, Wheel


def corners(wheel: Wheel) -> list[tuple[float, float]]:
    """Returns the corners of a wheel as wide as its radius."""
    c, s = math.cos(wheel.direction), math.sin(wheel.direction)
    found = []
    for ahead, left in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        a, b = ahead * wheel.radius, 0.5 * left * wheel.radius
        found.append((wheel.x + a * c - b * s, wheel.y + a * s + b * c))
    return found


def rollers(wheel: Wheel) -> list[list[tuple[float, float]]]:
    """Returns the ends of five lines along which the wheel pulls, along it, or across it where it has no rollers."""
    c, s = math.cos(wheel.direction), math.sin(wheel.direction)
    g = wheel.roller_angle
    pull = (c * math.cos(g) - s * math.sin(g), s * math.cos(g) + c * math.sin(g))
    reach = wheel.radius * min(0.35, 0.5 / abs(math.sin(g)) if math.sin(g) else math.inf)
    found = []
    for share in (-0.75, -0.375, 0.0, 0.375, 0.75):
        along = (c, s) if g else (-0.5 * s, 0.5 * c)
        x, y = wheel.x + share * wheel.radius * along[0], wheel.y + share * wheel.radius * along[1]
        found.append([(x - reach * pull[0], y - reach * pull[1]), (x + reach * pull[0], y + reach * pull[1])])
    return found


@pytest.fixture
def figure():  # type: ignore[no-untyped-def]
    found = robot_page.drawing()
    yield found
    plt.close(found)


def test_every_robot_is_drawn_from_its_sheet(figure) -> None:  # type: ignore[no-untyped-def]
    axes = figure.axes
    assert len(axes) == 4 * math.ceil(len(ROBOTS) / 4)
    most = max(robot.hull_radius for robot in ROBOTS.values()) * 1.08 + 0.02
    assert tuple(figure.get_size_inches()) == pytest.approx((10.0, 2.75 * len(axes) / 4 + 0.3))
    for axis, robot in zip(axes, ROBOTS.values(), strict=False):
        _as_on_its_sheet(axis, robot, most, first=axis is axes[0])
    for axis in axes:
        assert not axis.axison
    for axis in axes[len(ROBOTS) :]:
        assert not axis.patches
    (note,) = figure.texts
    assert "axes of the rollers" in note.get_text()
    assert note.get_position() == (0.01, 0.01)
    (length,) = axes[0].texts[-1:]
    assert length.get_text() == "0.1 m"


def _as_on_its_sheet(axis, robot: Robot, most: float, first: bool) -> None:  # type: ignore[no-untyped-def]
    assert axis.get_title() == f"{robot.name}\n{robot.drive}, hull {hull_words(robot)}"
    assert (*axis.get_xlim(), *axis.get_ylim()) == pytest.approx((-most, most, -most, most))
    assert axis.get_aspect() == 1.0
    hull, *others = axis.patches
    if robot.hull_box is None:
        assert isinstance(hull, Circle)
        assert (hull.radius, hull.center) == (robot.hull_radius, (0.0, 0.0))
    else:
        length, width = robot.hull_box
        assert isinstance(hull, Rectangle)
        assert (hull.get_width(), hull.get_height()) == (length, width)
        assert hull.get_xy() == (-length / 2, -width / 2)
    polygons = [each for each in others if isinstance(each, Polygon)]
    skids = robot.wheels if robot.built != robot.wheels else ()
    drawn = [*robot.built, *skids, *robot.encoders]
    assert len(polygons) == len(drawn)
    for k, (patch, wheel) in enumerate(zip(polygons, drawn, strict=True)):
        assert np.array(patch.get_xy())[:4] == pytest.approx(np.array(corners(wheel)))
        dashed = len(robot.built) <= k < len(robot.built) + len(skids)
        assert patch.get_fill() is not dashed
        assert (patch.get_linestyle() == "--") is dashed
        if dashed:
            assert to_hex(patch.get_edgecolor()) == to_hex(colour(0))
        else:
            soft = k >= len(robot.built)
            assert to_hex(patch.get_facecolor()) == (robot_page._SOFT if soft else robot_page._INK).lower()
        assert patch.get_zorder() == 3
    (arc,) = (each for each in others if isinstance(each, Arc))
    half = 90.0 * robot.sensors.angle / math.pi
    assert (arc.theta1, arc.theta2) == pytest.approx((-half, half))
    assert (arc.width, arc.height) == pytest.approx((2 * robot.hull_radius + 0.04,) * 2)
    assert tuple(arc.center) == (0.0, 0.0)
    lines = [np.array(each.get_xydata()) for each in axis.lines]
    wanted = [ends for wheel in robot.built for ends in rollers(wheel)] if robot.holonomic else []
    scale = [[(-most, 0.06 - most), (0.1 - most, 0.06 - most)]] if first else []
    assert len(lines) == len(wanted) + len(scale)
    for line, ends in zip(lines, [*wanted, *scale], strict=True):
        assert line == pytest.approx(np.array(ends))
    arrow = axis.texts[0]
    assert arrow.xy == pytest.approx((0.45 * robot.hull_radius, 0.0))
    assert arrow.xyann == pytest.approx((-0.25 * 0.45 * robot.hull_radius, 0.0))
    if first:
        assert axis.texts[-1].get_position() == pytest.approx((0.12 - most, 0.06 - most))


def test_a_line_of_the_table_is_a_data_sheet() -> None:
    text = robot_page.generated()
    lines = {line.split("|")[1].strip(): [cell.strip() for cell in line.split("|")[1:-1]]
             for line in text.splitlines() if line.startswith("| `")}  # fmt: skip
    assert list(lines) == [f"`{name}`" for name in ROBOTS]
    for robot in ROBOTS.values():
        _, title, drive, radii, most, lagged, mass, scan = lines[f"`{robot.name}`"]
        assert (title, drive) == (robot.title, robot.drive)
        assert sorted(map(float, radii.split(", "))) == [float(each) for each in radii.split(", ")]
        assert {float(each) for each in radii.split(", ")} == {float(f"{wheel.radius:g}") for wheel in robot.wheels}
        assert most == ", ".join(f"{value:.3g}" for value in robot.max_twist)
        assert lagged == f"{robot.acceleration:g}, {robot.yaw_acceleration:g}, {robot.lag:g}"
        assert mass == f"{robot.mass:g}, {robot.inertia:g}, {robot.friction:g}"
        if scan:
            beams, reach, angle = scan.split(", ")
            assert (int(beams), reach) == (robot.sensors.beams, f"{robot.sensors.range:g} m")
            assert angle == ("round" if robot.sensors.angle == FULL_TURN else f"{robot.sensors.angle:.3g} rad")
        below = text.partition(f"### {robot.name}: {robot.title}\n")[2].partition("### ")[0]
        assert [line for line in below.splitlines() if line] == [
            f"- `{field}`: {source}" for field, source in robot.sources.items()
        ]
    assert any(line[-1] for line in lines.values())
    assert any(not line[-1] for line in lines.values())


def test_what_stands_above_the_mark_stays(tmp_path: Path) -> None:
    page = tmp_path / robot_page.PAGE
    done = CliRunner().invoke(robot_page.main, ["--docs", str(tmp_path)])
    assert done.exit_code == 1
    assert "has no line" in done.output
    assert not list(tmp_path.iterdir())
    page.write_text(f"mine\n{robot_page.MARK}old", encoding="utf-8")
    done = CliRunner().invoke(robot_page.main, ["--docs", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert page.read_text(encoding="utf-8") == f"mine\n{robot_page.MARK}\n{robot_page.generated()}"
    assert (tmp_path / robot_page.DRAWING).read_bytes()[:4] == b"\x89PNG"
    assert done.output == f"{len(ROBOTS)} robots in {page}\n"
