"""The page of the robots has a line a data sheet, below what is written by hand."""

from pathlib import Path

import robot_page
from click.testing import CliRunner

from wayfield.envs.robots import FULL_TURN, ROBOTS


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
