"""Scenarios: the documents' courses, the random families, and what is said about faulty files."""

import dataclasses
import json
import math
import re
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.surfaces import clearances
from scipy import ndimage

from wayfield.envs.crowds.people import ORCA, REPLAY, WALK
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import (
    GOAL_SCENARIOS,
    PATH_SCENARIOS,
    GoalScenario,
    PathScenario,
    box,
    circle,
    goal_scenarios,
    path_scenarios,
    wall,
)
from wayfield.envs.scenarios.curves import CubicSpline
from wayfield.envs.scenarios.docking_families import DockingScenario
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.envs.world.paths import Path

DATA = FilePath(__file__).parents[3] / "shared" / "data"
HULL_RADII = [least_or_most(robot.hull_radius for robot in ROBOTS.values()) for least_or_most in (min, max)]
LINE = Path([(0.0, 0.0), (5.0, 0.0)])
RING = Path([(0.0, 0.0), (5.0, 0.0), (0.0, 5.0)], closed=True)


def steps(path: Path) -> NDArray[np.float64]:
    points = np.vstack([path.points, path.points[:1]]) if path.closed else path.points
    lengths: NDArray[np.float64] = np.hypot(*np.diff(points, axis=0).T)
    return lengths


# ---- named paths


@pytest.mark.parametrize("name", PATH_SCENARIOS)
def test_every_named_path_is_evenly_spaced(name: str) -> None:
    for scenario in path_scenarios(name):
        assert scenario.name.startswith(name)
        # the documents' tables are 0.02 m apart; a bank of random paths is coarser
        spacing = 0.04 if name == "random_splines" else 0.02
        assert steps(scenario.path) == pytest.approx(spacing, rel=0.02)
        # along the curve the spacing is one number; a chord across a bend is a little shorter
        assert np.ptp(steps(scenario.path)) < 5e-3 * spacing
        assert not scenario.path.points.flags.writeable


@pytest.mark.parametrize(("name", "radius"), [("circle_r0.5", 0.5), ("circle", 1.0), ("circle_r2", 2.0)])
def test_circles(name: str, radius: float) -> None:
    (scenario,) = path_scenarios(name)
    path = scenario.path
    assert np.hypot(*path.points.T) == pytest.approx(radius)
    assert path.length == pytest.approx(2.0 * math.pi * radius, rel=1e-3)
    assert path.points[0] == pytest.approx([radius, 0.0])
    assert path.points[1, 1] > 0.0  # counter-clockwise
    assert path.closed
    assert scenario.laps == 0


@pytest.mark.parametrize(("name", "wavelength"), [("s_curve", 6.0), ("s_curve_tight", 3.0)])
def test_sines(name: str, wavelength: float) -> None:
    (scenario,) = path_scenarios(name)
    x, y = scenario.path.points.T
    assert y == pytest.approx(np.sin(2.0 * np.pi * x / wavelength), abs=1e-12)
    assert (x[0], x[-1]) == pytest.approx((0.0, 12.0))
    fine = np.linspace(0.0, 12.0, 1_000_001)
    slope = 2.0 * np.pi / wavelength * np.cos(2.0 * np.pi * fine / wavelength)
    assert scenario.path.length == pytest.approx(12.0 * np.sqrt(1.0 + slope**2).mean(), rel=1e-3)
    assert not scenario.path.closed


@pytest.mark.parametrize(("name", "laps"), [("figure_eight", 0), ("figure_eight_lap", 1)])
def test_figure_eights(name: str, laps: int) -> None:
    (scenario,) = path_scenarios(name)
    x, y = scenario.path.points.T
    # the curve without its parameter: y^2 = x^2 (1 - x^2 / 4)
    assert y**2 == pytest.approx(x**2 * (1.0 - x**2 / 4.0), abs=1e-9)
    t = np.linspace(0.0, 2.0 * np.pi, 100_001)[:-1]
    length = 2.0 * np.pi * np.hypot(2.0 * np.cos(t), 2.0 * np.cos(2.0 * t)).mean()
    assert scenario.path.length == pytest.approx(length, rel=1e-3)
    assert scenario.path.closed
    assert scenario.laps == laps


@pytest.mark.parametrize(("name", "corners", "turn", "length"), [("right_angle", 4, 90, 15), ("zigzag", 5, 120, 12)])
def test_polylines(name: str, corners: int, turn: float, length: float) -> None:
    (scenario,) = path_scenarios(name)
    a, b = np.diff(scenario.path.points, axis=0)[:-1], np.diff(scenario.path.points, axis=0)[1:]
    turns = np.abs(np.degrees(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))))
    assert turns[turns > 1e-6] == pytest.approx([turn] * corners)
    assert scenario.path.length == pytest.approx(length)


def test_random_splines_are_smooth_and_mixed() -> None:
    scenarios = path_scenarios("random_splines")
    assert len(scenarios) == 64
    assert {scenario.path.closed for scenario in scenarios} == {True, False}
    for scenario in scenarios:
        assert 8.0 <= scenario.path.length <= 20.0
        assert (scenario.corridor, scenario.start_offset, scenario.start_turn) == (0.5, 0.1, 0.3)
        points = scenario.path.points
        if scenario.path.closed:
            points = np.vstack([points, points[:2]])
        a, b = np.diff(points, axis=0)[:-1], np.diff(points, axis=0)[1:]
        turns = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))
        assert (np.abs(turns) / np.hypot(*a.T)).max() <= 2.0
    lengths = {round(scenario.path.length, 6) for scenario in scenarios}
    assert len(lengths) == 64


@pytest.mark.parametrize("closed", [False, True])
def test_spline_agrees_with_scipy(closed: bool) -> None:
    from scipy.interpolate import CubicSpline as Reference

    points = np.random.default_rng(3).normal(size=(7, 2))
    spline = CubicSpline.through(points, closed)
    reference = Reference(spline.knots, spline.points, bc_type="periodic" if closed else "natural")
    t = np.linspace(0.0, spline.knots[-1], 500)
    assert spline(t) == pytest.approx(reference(t).T)
    (dx, dy), (ddx, ddy) = reference(t, 1).T, reference(t, 2).T
    assert spline.curvature(t) == pytest.approx((dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3)


@pytest.mark.parametrize("name", ["straight_offset", "random_splines", "straights/test", "table.csv", "mine.json"])
def test_scale_multiplies_positions_and_leaves_the_rest(tmp_path: FilePath, name: str) -> None:
    """Of every kind of path: a course of a document, a random bank, a family, a table, a file."""
    if "." in name:
        written(tmp_path, "0,0\n4,0\n4,3\n", "table.csv")
        started = {"start": [0.2, 0.1, 0.3], "start_offset": 0.1, "start_turn": 0.2, "corridor": 0.7}
        name = str(tmp_path / name) if name == "table.csv" else written(tmp_path, {"path_file": "table.csv"} | started)
    plain, scaled = path_scenarios(name), path_scenarios(name, 0.5)
    assert len(plain) == len(scaled)
    for one, other in zip(plain, scaled, strict=True):
        assert other.path.points == pytest.approx(0.5 * one.path.points)
        assert other.path.closed == one.path.closed
        if one.start is None:
            assert other.start is None
        else:
            x, y, heading = one.start
            assert other.start == pytest.approx((0.5 * x, 0.5 * y, heading))
        assert [getattr(other, field) for field in ("corridor", "laps", "start_offset", "start_turn")] == [
            getattr(one, field) for field in ("corridor", "laps", "start_offset", "start_turn")
        ]


# ---- named goals


@pytest.mark.parametrize("hull_radius", HULL_RADII)
@pytest.mark.parametrize("name", GOAL_SCENARIOS)
def test_every_named_goal_is_clear_or_refused_to_a_hull(name: str, hull_radius: float) -> None:
    if hull_radius > 0.36 and name in ("apf_2", "cellular"):  # the widest way in them
        with pytest.raises(ValueError, match="hull"):
            goal_scenarios(name, hull_radius)
        return
    for scenario in goal_scenarios(name, hull_radius):
        ends = np.array([scenario.start[:2], scenario.goal[:2]])
        assert (clearances(scenario.obstacles, ends) >= hull_radius).all()
        assert scenario.obstacles.dtype == OBSTACLE
        assert not scenario.obstacles.flags.writeable


@pytest.mark.parametrize("hull_radius", HULL_RADII)
@pytest.mark.parametrize("name", ["discs", "mixed"])
def test_random_fields_leave_a_way(name: str, hull_radius: float) -> None:
    scenarios = goal_scenarios(name, hull_radius)
    assert len(scenarios) == 64
    # another grid than the generator's, finer and with diagonals
    axis = np.linspace(-5.0, 5.0, 144)
    nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    for scenario in scenarios[::8]:
        ends = np.array([scenario.start[:2], scenario.goal[:2]])
        assert len(scenario.obstacles) == 16
        assert 6.0 <= math.dist(*ends) <= 9.0
        assert (clearances(scenario.obstacles, ends) >= hull_radius + 0.1).all()
        free = (clearances(scenario.obstacles, nodes) >= hull_radius).reshape(len(axis), -1)
        regions, _ = ndimage.label(free, np.ones((3, 3)))
        i, j = np.rint((ends + 5.0) / (axis[1] - axis[0])).astype(int).T
        assert regions[i[0], j[0]] == regions[i[1], j[1]] != 0


@pytest.mark.parametrize("switching_radius", [0.0, 0.25, 0.35])
def test_waypoint_course_is_clear_even_with_cut_corners(switching_radius: float) -> None:
    (scenario,) = goal_scenarios("omni3_waypoints", 0.3)
    at = np.array(scenario.start[:2])
    for waypoint in np.array([*scenario.waypoints, scenario.goal[:2]]):
        leg = waypoint - at
        end = waypoint - leg / np.hypot(*leg) * switching_radius
        course = np.linspace(at, end, 500)
        assert clearances(scenario.obstacles, course).min() > 0.3 + 0.05
        at = end


def test_a_hull_too_large_for_a_field_is_refused() -> None:
    for hull_radius in (1.8, 5.5):
        with pytest.raises(ValueError, match=f"hull_radius is {hull_radius}; 'discs' has no 64 fields"):
            goal_scenarios("discs", hull_radius)


@pytest.mark.parametrize("name", ["circl", "nowhere", "a\0b"])
def test_unknown_path_names_are_answered_with_the_known(name: str) -> None:
    with pytest.raises(ValueError, match="unknown path scenario") as caught:
        path_scenarios(name)
    assert repr(name) in str(caught.value)
    assert "figure_eight_lap" in str(caught.value)
    assert ("Did you mean 'circle" in str(caught.value)) == ("irc" in name)


def test_unknown_goal_name() -> None:
    with pytest.raises(ValueError, match=r"unknown goal scenario 'apf1'. Did you mean 'apf_1'\?.*omni3_goal"):
        goal_scenarios("apf1", 0.3)


@pytest.mark.parametrize("value", [0.0, math.nan, "1"])
def test_scale_and_hull_radius_must_be_positive_numbers(value: float) -> None:
    with pytest.raises(ValueError, match=re.escape(f"scale is {value!r}")):
        path_scenarios("circle", value)
    with pytest.raises(ValueError, match=re.escape(f"hull_radius is {value!r}")):
        goal_scenarios("apf_1", value)


# ---- values


@pytest.mark.parametrize(
    ("path", "settings", "message"),
    [
        (LINE, {"laps": 2}, "laps is 2; an open path"),
        (RING, {"laps": -1}, "laps is -1"),
        (LINE, {"corridor": math.nan}, "corridor is nan"),
        (LINE, {"start": (0.0, 0.0)}, "start is (0.0, 0.0); it must be 3 numbers"),
        (LINE, {"start": (0.0, 2.0, 0.0)}, "2 m from the path; the corridor is 1 m"),
        (Path([(0.0, 0.0), (1e10, 0.0)]), {}, "path has a point beyond"),
    ],
)
def test_faulty_path_scenarios_are_refused(path: Path, settings: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        PathScenario("faulty", path, **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"goal": (1.0, 2.0)}, "goal is (1.0, 2.0); it must be 3 numbers (x, y, heading)"),
        ({"waypoints": ((1.0, 2.0), (3.0,))}, "waypoints[1] is (3.0,)"),
        ({"position_tolerance": 0.0}, "position_tolerance is 0.0"),
        ({"obstacles": np.zeros((2, 8))}, "it must be an OBSTACLE record"),
        ({"obstacles": np.array([(0, 0, 1, 0, -1, 1, 0, 0, (0,) * 6)], OBSTACLE)}, "obstacles[0].half_length is -1.0"),
    ],
)
def test_faulty_goal_scenarios_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        GoalScenario("faulty", **{"goal": (1.0, 0.0, 0.0), **settings})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (circle, (0, 0, 1, -1), "circle mass is -1"),
        (box, (0, 0, 1, 1, "east"), "box heading is 'east'"),
        (wall, (1, 2, 1, 2), "wall x2, y2 is (1.0, 2.0)"),
    ],
)
def test_faulty_obstacles_are_refused(make: object, arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        make(*arguments)  # type: ignore[operator]


# ---- tables


def test_xy_tables_of_every_form_agree(tmp_path: FilePath) -> None:
    points = [(0.0, 0.0), (1.0, 0.5), (2.5, -1e-3)]
    forms = {
        "plain.csv": "\n".join(f"{x},{y}" for x, y in points),
        "spaces.txt": "\r\n".join(f"  {x}\t{y} " for x, y in points),
        "old_mac.txt": "\r".join(f"{x} {y}" for x, y in points),
        "header.csv": "t,Y,x,note\n" + "".join(f"7,{y},{x},fine\n" for x, y in points),
        "savetxt.csv": "# x y\n\n" + "".join(f"{x} {y}  # here, or so\n" for x, y in points),
        "excel.csv": "\ufeffsep=;\r\nx;y\r\n" + "".join(f"{x};{y}\r\n" for x, y in points),
        "marked.CSV": "\ufeffx_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in points),
        "coppelia.csv": "".join(f"{x},{y},0.1,0,0,0,1\n" for x, y in points),
        "coppelia.txt": "".join(f"{x} {y} 0.1 0 0 0 1\n" for x, y in points),
    }
    for name, text in forms.items():
        (tmp_path / name).write_text(text, encoding="utf-8", newline="")
        (scenario,) = path_scenarios(str(tmp_path / name))
        assert scenario.path.points.tolist() == [list(point) for point in points], name
        assert not scenario.path.closed
        assert (scenario.laps, scenario.corridor, scenario.start) == (1, 1.0, None)
        assert scenario.name == name.split(".")[0]


@pytest.mark.parametrize("tail", ["", ",0.138,0,0,0,1"])
def test_a_repeated_first_point_closes_the_path(tmp_path: FilePath, tail: str) -> None:
    file = tmp_path / "ring.csv"
    file.write_text("".join(f"{point}{tail}\n" for point in ("0,0", "1,0", "1,1", "0,0")))
    (scenario,) = path_scenarios(str(file), 2.0)
    assert scenario.path.closed
    assert scenario.laps == 1
    assert scenario.path.points.tolist() == [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [
        (b"", 1, "the table has no points"),
        (b"1\n2\n", 1, "'1' has 1 column(s); without a header it must be 2 (x, y), 7"),
        (b"i,x,y\n0,0\n", 2, "has 2 column(s), the header names 3"),
        (b'"x","y"\n"0,5","1,5"\n"1,5","2,0"\n', 2, "has 4 column(s), the header names 2"),
        (b"x,y,width\n0,0,1\n1,1\n2,2,1\n", 3, "has 2 column(s), the first row has 3"),
        (b"1,2\n3,4\n1,2\n", 2, "ends after 2 distinct point(s); a closed path needs at least 3"),
        (b"0,0\n# c\n0,0\n", 1, "ends after 1 distinct point(s); a path needs at least 2"),
        (b"0,0\n1,two\n3,4\n", 2, "'two' is not a number"),
        (b"a,b\n1,2\n", 1, "'a,b' is neither a row of numbers, such as 1.5,0.2, nor a header"),
        (b"0,0\n1e300,1\n", 2, "or beyond 1e+06 m"),
        (b"0,0\n1,1\n2\n", 3, "has 1 column(s), the first row has 2"),
        (b"0,0\n1,1\n\x93NUMPY\xff\n", 3, "byte 0x93 is no UTF-8"),
    ],
)
def test_faulty_tables_name_file_and_line(tmp_path: FilePath, content: bytes, line: int, message: str) -> None:
    file = tmp_path / "table.csv"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        path_scenarios(str(file))
    assert str(caught.value).startswith(f"{file}:{line}: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250 + len(str(file))


def test_missing_files_and_folders(tmp_path: FilePath) -> None:
    with pytest.raises(FileNotFoundError, match=r"absent\.csv"):
        path_scenarios(str(tmp_path / "absent.csv"))
    with pytest.raises(FileNotFoundError, match=r"absent\.json"):
        goal_scenarios(str(tmp_path / "absent.json"), 0.3)
    folder = tmp_path / "folder.csv"
    folder.mkdir()
    with pytest.raises(ValueError, match=r"folder\.csv:1: is a folder"):
        path_scenarios(str(folder))
    with pytest.raises(ValueError, match="is a folder or a device; it must be a file"):
        path_scenarios(str(tmp_path))
    (tmp_path / "path.csv").touch()
    with pytest.raises(ValueError, match=r"suffix '\.csv' is not known; a goal scenario is read from \.json"):
        goal_scenarios(str(tmp_path / "path.csv"), 0.3)


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6, allow_subnormal=False)] * 2), min_size=2, max_size=30, unique=True))
def test_points_survive_the_way_through_a_file(
    tmp_path_factory: pytest.TempPathFactory, points: list[tuple[float, float]]
) -> None:
    # shorter paths are refused, and a circuit's last point is its first one
    assume(np.hypot(*np.diff([*points, points[0]], axis=0).T).min() > 1e-3)
    file = tmp_path_factory.getbasetemp() / "round_trip.csv"
    file.write_text("\n".join(f"{x!r},{y!r}" for x, y in points))
    (scenario,) = path_scenarios(str(file))
    assert scenario.path.points.tolist() == [list(point) for point in points]


@pytest.mark.skipif(not (DATA / "tum_racetracks").is_dir(), reason=f"no race circuits in {DATA}")
def test_race_circuits_load_at_scale() -> None:
    files = sorted((DATA / "tum_racetracks").glob("*.csv"))
    assert files
    for file in files:
        rows = np.array([line.split(",")[:2] for line in file.read_text().splitlines()[1:]], float)
        ring = np.vstack([rows, rows[:1]])
        (scenario,) = path_scenarios(str(file), 0.02)
        assert scenario.path.closed
        assert scenario.path.points == pytest.approx(0.02 * rows)
        assert scenario.path.length == pytest.approx(0.02 * np.hypot(*np.diff(ring, axis=0).T).sum())
        assert 2200 < scenario.path.length / 0.02 < 7000


# ---- Python


def person(**fields: float) -> NDArray[np.void]:
    walks = np.zeros(1, WALK)
    usual = {"law": ORCA, "x": 3.0, "goal_x": 5.0, "speed": 1.0, "radius": 0.2, "horizon": 2.0, "wall_horizon": 1.0}
    for name, value in (usual | fields).items():
        walks[name] = value
    return walks


REPLAYED = {"law": REPLAY, "rows": 2, "frame_time": 0.4}
GOOD: dict[Any, dict[str, Any]] = {
    PathScenario: {"name": "a", "path": Path([[0, 0], [5, 0]])},
    GoalScenario: {"name": "a", "goal": (3.0, 0.0, 0.0)},
    DockingScenario: {"name": "a", "goal": (3.0, 0.0, 0.0)},
    TeamScenario: {
        "name": "a",
        "robots": (GoalScenario("r", (3.0, 0.0, 0.0)),),
        "walks": person(),
        "tracks": np.zeros((2, 4)),
    },
}
UNKNOWN = {"quantity", "bound", "published_length"}  # where nothing is known, NaN stands for it


@pytest.mark.parametrize(("made", "field"), [(made, each.name) for made in GOOD for each in dataclasses.fields(made)])
def test_a_scenario_made_in_python_refuses_what_is_no_value_by_the_fields_name(made: Any, field: str) -> None:
    made(**GOOD[made])
    for value in (math.nan, math.inf, -math.inf, 1e300, True, object(), np.full((1, 4), math.nan)):
        if field in UNKNOWN and value is math.nan:
            continue
        with pytest.raises(ValueError, match=field) as refused:
            made(**{**GOOD[made], field: value})
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("field", WALK.names or ())
def test_a_person_refuses_what_is_no_number_by_the_fields_name(field: str) -> None:
    good = GOOD[TeamScenario]
    bad = (math.nan, math.inf, 1e300, -1e300) if WALK[field].kind == "f" else (-1, 10**9, 2**63 - 2)
    for value in bad:
        # whose rows are read
        walks = person(**(REPLAYED if field in ("frame_time", "first", "rows") else {}) | {field: value})
        with pytest.raises(ValueError, match=rf"walks\[0\](\.{field} is| has rows)"):
            TeamScenario(**{**good, "walks": walks})
    for law, needed in ((ORCA, "horizon"), (ORCA, "wall_horizon"), (REPLAY, "frame_time")):
        with pytest.raises(ValueError, match=rf"walks\[0\].{needed} is 0.0; it must be from 0.001"):
            TeamScenario(**{**good, "walks": person(**REPLAYED | {"law": law, needed: 0.0})})
    for value in (math.nan, -math.inf, 1e300):
        with pytest.raises(ValueError, match=r"tracks\[1, 2\] is"):
            TeamScenario(**{**good, "tracks": np.array([[0.0] * 4, [0.0, 0.0, value, 0.0]])})


# ---- JSON


def written(folder: FilePath, content: object, name: str = "mine.json") -> str:
    file = folder / name
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(file)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", ":1: Expecting value"),
        ('{"path":\n[[0, 0], [1 1]]}', ":2: "),
        ('{"path": [[0, 0], [NaN, 1]]}', "NaN is not a number of JSON"),
        ('{"laps": 1, "laps": 2, "path": []}', "field 'laps' is given twice"),
        ({"pth": []}, "Did you mean 'path'?"),
        ({"path": [], "path_file": "a.csv"}, "exactly one of"),
        ({"path": [[0, 0], [1, "2"]]}, "path[1][1] is '2'; it must be a finite number"),
        ({"path": [[0, 0], [1, 1]], "closed": "yes"}, "closed is 'yes'; it must be true or false"),
        (
            {"path_file": "scenario.json"},
            "path_file is 'scenario.json'; it must be the name of a table, .csv",
        ),
    ],
)
def test_faulty_path_json_is_explained(tmp_path: FilePath, content: object, message: str) -> None:
    file = written(tmp_path, content)
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        path_scenarios(file)
    assert str(caught.value).startswith(f"{file}:")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({}, "field 'goal' is missing"),
        ({"goal": [1, 2, 0], "tolerance": 1}, "field 'tolerance' is not known; the fields are goal, start"),
        ({"goal": [1, 2, 0], "waypoints": [3]}, "waypoints[0] is 3; it must be 2 numbers (x, y)"),
        ({"goal": [1, 2, 0], "obstacles": [[1, 2]]}, "obstacles[0] is [1, 2]; it must be an object"),
        ({"goal": [1, 2, 0], "obstacles": [{"kind": "circl"}]}, "Did you mean 'circle'?"),
        (
            {"goal": [1, 2, 0], "obstacles": [{"kind": "circle", "x": 0, "y": 0, "r": 1}]},
            "field 'obstacles[0].r' is not known; the fields are x, y, radius, mass",
        ),
        (
            {"goal": [9, 2, 0], "obstacles": [{"kind": "circle", "x": 0, "y": 0, "radius": "1"}]},
            "obstacles[0]: circle radius is '1'; it must be a finite number of at least 1e-09",
        ),
        (
            {"goal": [9, 2, 0], "obstacles": [{"kind": "circle", "x": 9, "y": 2, "radius": 1}]},
            "obstacles[0] (circle of radius 1 m at (9, 2)) is over the goal",
        ),
    ],
)
def test_faulty_goal_json_is_explained(tmp_path: FilePath, content: object, message: str) -> None:
    file = written(tmp_path, content)
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        goal_scenarios(file, 0.3)
    assert str(caught.value).startswith(f"{file}:")
    assert "\n" not in str(caught.value)
