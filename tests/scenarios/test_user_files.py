"""Files of the user's at the edge of what they may hold, and what stands in worlds, maps and tables."""

import dataclasses
import json
import math
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from PIL import Image

import wayfield  # noqa: F401
from wayfield.envs.scenarios import TASKS, GoalScenario, PathScenario, box, maps, obstacle_field, scenarios_of
from wayfield.envs.scenarios.files import field_scenario_from_file, kind_of, path_scenario_from_file
from wayfield.envs.scenarios.tables import path_from_table

ROOM = "type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\n....\n"


def line(**changes: Any) -> str:
    """Returns a line of a list of problems, fields as they are named there."""
    fields = {"bucket": 0, "map": "room.map", "width": 4, "height": 3, "x0": 0, "y0": 0, "x1": 3, "y1": 2, "way": 4.5}
    return "version 1\n" + "\t".join(map(str, (fields | changes).values())) + "\n"


def test_a_problem_names_its_map_in_a_folder_or_beside_it(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    beside, within, problems = tmp_path / "room.map", tmp_path / "sub" / "room.map", tmp_path / "a.scen"
    problems.write_text(line(map="sub/room.map"))
    with pytest.raises(ValueError, match=r"a\.scen:2: map is 'sub/room\.map'; there is no such file beside it"):
        maps.problems_of(str(problems))
    beside.write_text(ROOM)
    assert maps.problems_of(str(problems))[0].map == str(beside)
    within.write_text(ROOM)
    assert maps.problems_of(str(problems))[0].map == str(within)


def test_lengths_of_problems_are_metres(tmp_path: Path) -> None:
    (tmp_path / "room.map").write_text(ROOM)
    problems = tmp_path / "a.scen"
    problems.write_text(line() + line(x1=0, y1=0, way=0).partition("\n")[2])
    far, here = maps.scenarios_of_problems(str(problems), 0.5)
    assert far.published_length == 2.25
    assert math.isnan(here.published_length)
    problems.write_text(line(way=1e6))
    assert maps.scenarios_of_problems(str(problems))[0].published_length == 1e6
    with pytest.raises(ValueError, match="problem 0 has the optimal length"):
        maps.scenarios_of_problems(str(problems), 1.001)
    problems.write_text(line(width=5))
    with pytest.raises(ValueError, match=r"problem 0 is on a map of 5 x 3 cells; .* has 4 x 3"):
        maps.scenarios_of_problems(str(problems))


def test_a_map_of_letters_is_read_to_its_last_row(tmp_path: Path) -> None:
    file = tmp_path / "room.map"
    file.write_text("type octile\nheight 2\nwidth 6\nmap\n.GS@OT\nW.....\n\n  \n")
    grid = maps.grid_from_file(str(file))
    np.testing.assert_array_equal(grid.occupied, [[1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 1, 1]])
    assert (grid.resolution, grid.origin, grid.beyond) == (1.0, (0.0, 0.0, 0.0), "occupied")
    good = "type octile\nheight 2\nwidth 3\nmap\n...\n...\n"
    for old, new, at, told in (
        ("height 2", "height", 2, "it must be 'height N'"),
        ("map\n", "map map\n", 4, "it must be 'map'"),
        ("height 2", "height 3", 6, "the map has 2 rows; height is 3"),
        ("...\n...\n", "...\n....\n", 6, "the row has 4 cells; width is 3"),
        ("...\n...\n", ".é.\n...\n", 5, "'é' is no cell"),
    ):  # fmt: skip
        file.write_text(good.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(ValueError, match=rf"room\.map:{at}: .*{told}"):
            maps.grid_from_file(str(file))


# Tables of points.


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ("x,y\n# a note\n0,0\n\n1,0\n2e6,0\n", 6, r"point \[2000000\.0, 0\.0\] is not finite or beyond"),
        ("# x_m,y_m,w_tr_right_m,w_tr_left_m\n0,0,3,3\n\n1,1,3,3\n", 4, "ends after 2 distinct .* closed path needs"),
        ("0 0\n1 1 # the end\n0 0\n", 2, "ends after 2 distinct"),
    ],
)
def test_lines_are_counted_as_an_editor_counts_them(tmp_path: Path, text: str, line: int, told: str) -> None:
    file = tmp_path / "table.txt"
    file.write_text(text)
    with pytest.raises(ValueError, match=rf"table\.txt:{line}: .*{told}"):
        path_from_table(str(file))


def test_columns_are_found_by_their_names(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    points = [(0.0, 0.0), (1.0, 0.5), (2.0, -1.0)]
    for head, row in (
        ("y,x", "{1},{0}"), ('"X" , "Y"', "{0},{1}"), ("# y, time, x", "{1}, 7, {0}"), ("t,x_m,y_m", "9,{0},{1}"),
        ("y x t", "{1} {0} 3"), ("# x y\n# nothing", "{0}\t{1}"),
        ("# 0b1f\n# s_m; x_m; y_m; psi_rad", "9; {0}; {1}; 7"), ("Y [m]\tX [m]", "{1}\t{0}"), ("x;y", "{0};{1}"),
        ("%time,field.header.frame_id,field.pose.pose.position.x,field.pose.pose.position.y,"
         "field.pose.pose.orientation.x,field.pose.pose.orientation.y,field.twist.twist.linear.x,"
         "field.twist.twist.linear.y", "9,odom,{0},{1},7,7,7,7"),
        ("__time,/odom/pose/pose/position/x,/odom/pose/pose/position/y", "9,{0},{1}"),
        ("t\tposX\tposY\tvelX\tvelY", "9\t{0}\t{1}\t7\t7"), ("northing,easting,zone", "{1},{0},32N"),
        ("x_mm,y_mm", "{0}e3,{1}e3"), ("t;Y [cm];X [cm]", "9;{1}e2;{0}e2"), ("% x y", "{0} {1}"),
        ("// x_coordinate, y_coordinate", "{0}, {1}"), ('"x","y","name"', '"{0}","{1}","a"'),
        ("# timestamp tx ty tz qx qy qz qw", "1.7e9 {0} {1} 0 0 0 0 1"), ("", "1.7e9 {0} {1} 0 0 0 0.6 0.8"),
        ("", "{0};{1};"), ("x,y,", "{0},{1},"),
    ):  # fmt: skip
        file.write_text(head + "\n" + "".join(row.format(*point) + "\n" for point in points))
        path = path_from_table(str(file), 2.0)
        assert path.points.tolist() == [[2.0 * x, 2.0 * y] for x, y in points], head
        assert not path.closed
    # a circuit is closed without its first point at the end, other widths are not
    for widths, closed in (("w_tr_right_m,w_tr_left_m", True), ("w_tr_right_m,width", False)):
        file.write_text(f"# x_m,y_m,{widths}\n" + "".join(f"{x},{y},3,3\n" for x, y in points))
        assert path_from_table(str(file)).closed is closed
    file.write_text("1e6,0\n0,-1e6\n")
    assert path_from_table(str(file)).points.tolist() == [[1e6, 0.0], [0.0, -1e6]]
    with pytest.raises(ValueError, match=r"table\.csv:1: "):
        path_from_table(str(file), 1.0000001)


def ring(share: float, count: int, digits: int = 17) -> list[tuple[float, float]]:
    """Returns points of a circle of radius 1 m from its start over that share of a turn, both ends included."""
    angles = np.linspace(0.0, 2.0 * math.pi * share, count)
    return [(round(math.cos(each), digits), round(math.sin(each), digits)) for each in angles]


@pytest.mark.parametrize("suffix", ["csv", "json"])
@pytest.mark.parametrize(
    ("points", "count", "closed", "said"),
    [
        (ring(1.0, 60), 59, True, "m from its start: taken as closed"),
        (ring(1.0 + 1e-5, 60), 59, True, "m from its start: taken as closed"),
        ([*ring(1.0, 60)[:-1], (1.0, 0.0)], 59, True, ""),  # to the digit
        (ring(1.0 - 1 / 60, 60, 4), 60, True, '"closed": false'),  # as racing lines are written
        (ring(0.99, 600), 600, False, '"closed": true'),
        (ring(0.75, 60), 60, False, ""),
        # two lanes of a mower: the end is a step beside the start, and no circuit
        ([(0.5 * k, 0.0) for k in range(6)] + [(2.5 - 0.5 * k, 0.5) for k in range(6)], 12, False, ""),
    ],
)
def test_a_path_that_comes_back_is_closed_or_a_line_says_that_it_is_not(
    tmp_path: Path, recwarn: pytest.WarningsRecorder, suffix: str, points: Any, count: int, closed: bool, said: str
) -> None:
    file = tmp_path / f"a.{suffix}"
    content: dict[str, Any] = {"path": points}
    file.write_text("".join(f"{x},{y}\n" for x, y in points) if suffix == "csv" else json.dumps(content))
    path = path_scenario_from_file(str(file)).path
    assert (len(path.points), path.closed) == (count, closed)
    told = [str(each.message) for each in recwarn]
    assert [said in each and str(file) in each for each in told] == [True] * bool(said)
    if suffix == "json":  # what is said counts
        for wanted in (True, False):
            file.write_text(json.dumps(content | {"closed": wanted}))
            assert path_scenario_from_file(str(file)).path.closed is wanted
        assert len(recwarn) == bool(said)


@pytest.mark.parametrize("suffix", ["csv", "json"])
@pytest.mark.parametrize("ends", [(0.0, 1.0), (0.0, 0.0)])
def test_points_of_a_robot_that_stands_are_left_out(suffix: str, ends: tuple[float, float], tmp_path: Path) -> None:
    moved = [(0.0, 0.0), (2.0, 0.0), (1.0, -1.0), (2.0, 0.0), ends]  # it comes by a place again, which counts
    stood = [each for k, each in enumerate(moved) for _ in range(1 + 2 * (k % 2 == 0))]
    paths = []
    for points in (moved, stood):
        file = tmp_path / f"{len(points)}.{suffix}"
        file.write_text("".join(f"{x},{y}\n" for x, y in points) if suffix == "csv" else json.dumps({"path": points}))
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            paths.append(path_scenario_from_file(str(file)).path)
        told = [str(each.message) for each in said]
        assert ["6 points equal to the one before, left out" in each for each in told] == [True] * (points is stood)
    assert paths[0].closed == paths[1].closed == (ends == (0.0, 0.0))
    np.testing.assert_array_equal(*(path.points for path in paths))


@pytest.mark.parametrize("suffix", ["csv", "json"])
def test_a_reference_that_stands_is_refused(suffix: str, tmp_path: Path) -> None:
    points = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (2.0, 0.0)]
    rows = "t,x,y\n" + "".join(f"{k},{x},{y}\n" for k, (x, y) in enumerate(points))
    file = tmp_path / f"a.{suffix}"
    file.write_text(rows if suffix == "csv" else json.dumps({"path": points, "times": [0, 1, 2, 3]}))
    with pytest.raises(ValueError, match="repeat"):
        path_scenario_from_file(str(file), spec=TASKS["trajectory_tracking"])


@pytest.mark.slow
def test_what_was_taken_for_granted_is_said_once_however_many_read_the_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("".join(f"{x},{y}\n" for x, y in ring(1.0, 60)))
    words = ["--path", str(tmp_path / "a.csv"), "--policies", "pure_pursuit,lqr", "--workers", "2"]
    run = subprocess.run(
        [sys.executable, "-m", "wayfield.command", "evaluate", *words, "--out", str(tmp_path / "out")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert run.stderr.count("taken as closed") == 1
    assert "UserWarning" not in run.stderr


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("500000.5,5400000\n500001,5400000\n", r":1: .*beyond 1e\+06 m; subtract an origin .* \(500000, 5400000\)"),
        ("0,0\n1,1\n5e6,0\n", r":3: point \[5000000.0, 0.0\] is not finite or beyond 1e\+06 m$"),
        ("x;y\n1,5;2,5\n", ":2: '1,5' is not a number; write its decimals with a point; .* by semicolons"),
        ("1,5\t2,5\n", ":1: '1,5' is not a number; write its decimals with a point; .* by tabs"),
        ("1,5 2,5\n", ":1: '1,5' is not a number; write its decimals with a point; .* by white space"),
        ("1,5,2,5\n", ":1: .* has 4 column.* by commas, decimals have a point"),
        ("1;2;3\n", ":1: .* has 3 column.* name them in a first line, such as x,y,speed; .* by semicolons"),
        ("cx,cy\n0,0\n1,1\n", ":1: 'cx,cy' is neither a row .* names the columns of the place x and y"),
        ("(0, 0)\n(1, 1)\n", ":1: .* is neither a row of numbers, such as 1.5,0.2, nor"),
        ("t,x,y\n[s],[m],[m]\n0,0,0\n1,1,1\n", r":2: '\[s\],\[m\],\[m\]' is no row of numbers; remove it, or put a #"),
        ("x,y\n0,0\n,\n1,1\n", ":3: a column is empty; leave out the row"),
        ("# lat,lon\n48.1,11.5\n48.2,11.5\n", ":1: latitude and longitude are degrees; project them to metres"),
        ("/a/position/x,/a/position/y,/b/position/x,/b/position/y\n0,0,1,1\n", "/b/position/x' could both be x; leave"),
        ("0,0,0,0,0,0,0,0\n1,1,1,0,0,0,0,0\n", ":1: .* are 0, 0, 0, 0, which is no .*; 8 columns .* be time, x, y,"),
        ("0,-0.4,-0.7,5.6,0,8,0\n1,0.2,-1.5,5.6,0,8,0\n", ":1: .* are 5.6, 0, 8, 0, which is no unit quaternion"),
    ],
)  # fmt: skip
def test_a_table_of_another_convention_is_refused_with_what_to_type(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "table.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=told) as refused:
        path_scenario_from_file(str(file))
    assert "\n" not in str(refused.value)


def test_an_array_of_points_is_answered_with_how_it_is_written(tmp_path: Path) -> None:
    np.save(tmp_path / "path.npy", np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"path\.npy: a path is read from \.csv, .*: numpy\.savetxt\("):
        path_scenario_from_file(str(tmp_path / "path.npy"))


@pytest.mark.parametrize("name", ["office.yaml", "office.pgm", "office.map", "OFFICE.YML"])
@pytest.mark.parametrize("task", ["PathFollowing", "GoalObstacles", "Docking", "Team", "People"])
def test_a_map_alone_is_answered_with_a_scenario_that_can_be_read(tmp_path: Path, name: str, task: str) -> None:
    (tmp_path / name).write_text("image: office.pgm\n")
    with pytest.raises(ValueError, match=rf"{name}: is a map; .* write (\{{.*\}}) to mine.json") as refused:
        gymnasium.make(f"wayfield/DiffDrive{task}-v0", scenario=str(tmp_path / name))
    told = json.loads(str(refused.value).partition("write ")[2].partition(" to mine")[0])
    assert set(told) == {"start", "dock" if task == "Docking" else "goal", "map"}
    Image.fromarray(np.full((200, 200), 254, np.uint8)).save(tmp_path / "office.pgm")
    ros = "image: office.pgm\nresolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.2\nnegate: 0\n"
    content = {"map": "type octile\nheight 12\nwidth 12\nmap\n" + ("." * 12 + "\n") * 12, "pgm": None}
    if (text := content.get(name.lower().rpartition(".")[2], ros)) is not None:
        (tmp_path / name).write_text(text)
    (tmp_path / "mine.json").write_text(json.dumps(told))
    gymnasium.make(f"wayfield/DiffDrive{'Docking' if task == 'Docking' else 'GoalObstacles'}-v0",
                   scenario=str(tmp_path / "mine.json"))  # fmt: skip


@pytest.mark.parametrize("task", ["PathFollowing", "GoalObstacles"])
def test_a_plan_or_a_goal_in_yaml_is_not_called_a_map(tmp_path: Path, task: str) -> None:
    file = tmp_path / "plan.yaml"
    file.write_text("header: {frame_id: map}\nposes:\n- pose: {position: {x: 0.0, y: 0.0, z: 0.0}}\n")
    with pytest.raises(ValueError, match=r"plan\.yaml: is no map, for it has no image; a .* is read from \..*json"):
        gymnasium.make(f"wayfield/DiffDrive{task}-v0", scenario=str(file))


@pytest.mark.parametrize("task", ["PathFollowing", "GoalObstacles", "Docking", "People"])
@pytest.mark.parametrize("name", ["office.yaml", "plan.pgm", "track.tsv", "scene.json", "./track", "/no/folder"])
def test_a_file_that_is_missing_is_said_to_be(name: str, task: str) -> None:
    with pytest.raises(OSError, match=r"there is no file /") as refused:
        gymnasium.make(f"wayfield/DiffDrive{task}-v0", scenario=name)
    assert str(refused.value).endswith(name.removeprefix("."))


def test_a_folder_of_a_map_without_cases_is_answered_with_a_scenario(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text("image: office.pgm\n")
    with pytest.raises(ValueError, match=r"map\.yaml: is a map; .* write .* to mine.json beside it"):
        gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", scenario=str(tmp_path))


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        ('{"goal": [1, 0, 0]}', "goal"), ('{"dock": [1, 0, 0]}', "dock"), ('{"path": [[0, 0], [1, 0]]}', "path"),
        # its own word tells more than the one that any pose may have, whichever comes first
        ('{"goal": [1, 0, 0], "dock": [1, 0, 0]}', "dock"), ('{"dock": [1, 0, 0], "goal": [1, 0, 0]}', "dock"),
        ("{}", "path"), ("[]", "path"), ('"goal"', "path"), ('{"goal": ', "path"), ("[" * 100_000, "path"),
    ],
)  # fmt: skip
def test_a_file_is_of_the_task_whose_word_it_has(tmp_path: Path, content: str, kind: str) -> None:
    for name, wanted in (("mine.json", kind), ("MINE.JSON", kind), ("goal.csv", "path")):
        file = tmp_path / name
        file.write_text(content)
        assert kind_of(str(file)) == wanted


@dataclasses.dataclass(frozen=True, eq=False)
class TimedPath(PathScenario):
    """A path of another task, with a field of its own."""

    arrival: float = 30.0
    file_fields: ClassVar[tuple[str, ...]] = (*PathScenario.file_fields, "arrival")


def test_a_second_task_on_paths_has_files_names_and_lists_of_its_own(tmp_path: Path) -> None:
    spec = dataclasses.replace(TASKS["path_following"], kind="timed")
    vars(spec)["repertoire"] = dataclasses.replace(TASKS["path_following"].repertoire, scenario=TimedPath)
    file = tmp_path / "mine.json"
    for word in ("timed", "path"):
        file.write_text(json.dumps({word: [[0, 0], [2, 0], [2, 2]], "arrival": 20.0}))
        (scenario,) = scenarios_of(spec, str(file), 0.3)
        assert (type(scenario), scenario.arrival, scenario.length) == (TimedPath, 20.0, 4.0)
        assert scenarios_of(spec, [scenario], 0.3) == (scenario,)
    file.write_text("[[0, 0], [2, 0], [2, 2]]")
    assert path_scenario_from_file(str(file), spec=spec).length == 4.0
    with pytest.raises(ValueError, match="it must be a DockingScenario"):
        scenarios_of(TASKS["docking"], [scenario], 0.3)
    file.write_text('{"timed": [[0, 0], [2, 0]], "path": [[0, 0], [2, 0]]}')
    with pytest.raises(ValueError, match="exactly one of the fields 'timed' and 'path' and 'path_file'"):
        path_scenario_from_file(str(file), spec=spec)
    with pytest.raises(ValueError, match=r"unknown timed scenario 'straigth'\. Did you mean 'straight'"):
        scenarios_of(spec, "straigth", 0.3)


def test_scenarios_made_in_python_are_driven_as_those_of_a_file(tmp_path: Path) -> None:
    made = GoalScenario("mine", goal=(3.0, 1.0, 0.5), obstacles=obstacle_field(box(1.5, 0.8, 0.4, 0.2, heading=0.7)))
    file = tmp_path / "mine.json"
    standing = {"kind": "box", "x": 1.5, "y": 0.8, "length": 0.4, "width": 0.2, "heading": 0.7}
    file.write_text(json.dumps({"goal": [3, 1, 0.5], "obstacles": [standing]}))
    found = []
    for scenario in (made, [made], str(file)):
        env = gymnasium.make("wayfield/OmniGoalObstacles-v0", scenario=scenario)
        observation, _ = env.reset(seed=1)
        for _ in range(20):
            observation, *_ = env.step(env.action_space.high)
        found.append(observation.tobytes())
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize(
    ("scenario", "told"),
    [
        (GoalScenario("mine", goal=(3.0, 1.0, 0.5)), "scenario is a GoalScenario; here it must be a PathScenario"),
        ([], "an empty list"),
    ],
)
def test_scenarios_of_another_task_are_refused(scenario: Any, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        gymnasium.make("wayfield/DiffDrivePathFollowing-v0", scenario=scenario)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"start": [0, 0, 90], "goal": [5, 0, 0]}, r"start\[2\] is 90 rad, more than a turn; degrees must be"),
        ({"goal": [5, 0, 0], "heading_tolerance": 5}, "heading_tolerance is 5 rad, more than half a turn; degrees"),
        ({"goal": [5, 0, 0], "start_turn": 90}, "start_turn is 90 rad, more than half a turn"),
        (
            {"goal": [5, 0, 0], "obstacles": [{"kind": "box", "x": 2, "y": 2, "length": 1, "width": 2, "heading": 45}]},
            r"obstacles\[0\].heading is 45 rad, more than a turn",
        ),
        ({"goal": [5, 0, 0], "heading_tolerance": 3.2, "start_turn": 3.15}, ""),
        ({"start": [1, 2, 0.01], "goal": [1, 2.05, 0]}, "the robot starts at its goal; the episode ends at"),
        ({"start": [0, 0, -6.28], "goal": [5, 0, 6.28]}, ""),
        ({"start": [1, 2, 0], "goal": [1, 2, 0], "waypoints": [[3, 3]]}, ""),
        ({"start": [1, 2, 0], "goal": [1, 2, 2]}, ""),
    ],
)
def test_a_scene_that_is_hardly_meant_so_is_told_of(tmp_path: Path, fields: Any, said: str) -> None:
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(fields))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        field_scenario_from_file(str(file))
    assert [bool(re.search(said, str(each.message))) for each in told] == [True] * bool(said)


CURVE = np.column_stack([np.linspace(0.0, 8.0, 60), np.sin(np.linspace(0.0, 8.0, 60))])
IN_MM = "the path is 9,695 m long, 162 m from point to point; lengths are in m: scale 0.001 is for a path in mm"


@pytest.mark.parametrize(
    ("name", "points", "fields", "said"),
    [
        ("mine.csv", 1000.0 * CURVE, {}, IN_MM),
        ("mine.json", 1000.0 * CURVE, {}, IN_MM),
        ("mine.json", 100.0 * CURVE, {}, "the path is 969 m long, 16 m from point"),
        ("mine.json", [(0, 0), (3000, 0), (3000, 3000)], {}, "the path is 6,000 m long"),
        ("mine.csv", [52.1, 13.2] + 1e-3 * CURVE, {}, "the path is only 0.0097 m long"),
        ("mine.json", CURVE, {"corridor": 500}, "corridor is 500 m, usual is 0.01 to 20"),
        ("mine.json", CURVE, {"corridor": 0.001}, "corridor is 0.001 m, usual is 0.01 to 20"),
        ("mine.csv", CURVE, {}, ""),
        ("mine.json", [(0.5 * k, 0.0) for k in range(2000)], {}, ""),  # a kilometre, point by point
    ],
)
def test_a_path_in_other_units_is_doubted_in_a_line(
    tmp_path: Path, name: str, points: Any, fields: dict[str, Any], said: str
) -> None:
    file = tmp_path / name
    if name.endswith(".csv"):
        np.savetxt(file, points, delimiter=",", header="x,y", fmt="%.9f")
    else:
        file.write_text(json.dumps({"path": np.asarray(points).tolist(), **fields}))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        scenarios_of(TASKS["path_following"], str(file), 0.3, 1.0)
    assert [str(each.message)[: len(f"mine: {said}")] for each in found] == ([f"mine: {said}"] if said else [])


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("t,x,y", "column 't' is not followed"),
        ("time_ms,x,y", "column 'time_ms' is not followed"),
        ("x,y,speed,stamp", "columns 'stamp' and 'speed' are not followed"),
        ("x,y,vx_mps", "column 'vx_mps' is not followed"),
        ("x,y,curvature", ""),
        ("", "column 'time' is not followed"),
    ],
)
@pytest.mark.parametrize("name", ["mine.csv", "mine.json"])
def test_times_and_speeds_that_a_path_does_not_follow_are_named(
    tmp_path: Path, header: str, said: str, name: str
) -> None:
    columns = header.split(",") if header else ["t", "x", "y", "z", "qx", "qy", "qz", "qw"]
    known = {"x": CURVE[::6, 0], "y": CURVE[::6, 1], "qw": np.ones(10)}
    rows = [known.get(each, np.arange(10) * (each in ("t", "stamp", "time_ms"))) for each in columns]
    np.savetxt(tmp_path / "mine.csv", np.column_stack(rows), delimiter=",", header=header, fmt="%.9f")
    (tmp_path / "mine.json").write_text('{"path_file": "mine.csv"}')
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        (path,) = scenarios_of(TASKS["path_following"], str(tmp_path / name), 0.3, 1.0)
    lines = [str(each.message) for each in found]
    assert [said in each for each in lines] == [True] * bool(said)
    if "reference" not in "".join(lines):
        return
    written = lines[0][lines[0].index("{") :]  # what it says to write follows the times
    (tmp_path / "other.json").write_text(written)
    (reference,) = scenarios_of(TASKS["trajectory_tracking"], str(tmp_path / "other.json"), 0.3, 1.0)
    np.testing.assert_array_equal(reference.path.points, path.path.points)
    assert len(reference.times) == 10


@pytest.mark.parametrize("field", ["times", "time", "headings"])
def test_a_path_with_times_is_answered_with_the_word_that_has_them(tmp_path: Path, field: str) -> None:
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"path": CURVE.tolist(), field: list(range(60))}))
    with pytest.raises(ValueError, match=f'field \'{field}\' is not known.* write "reference" for "path"') as found:
        path_scenario_from_file(str(file))
    assert len(str(found.value).splitlines()) == 1


def test_a_place_beside_a_map_is_told_where_the_map_lies(tmp_path: Path) -> None:
    Image.fromarray(np.full((60, 100), 254, np.uint8)).save(tmp_path / "room.png")
    on_map = {"file": "room.png", "resolution": 0.1, "origin": [-4, -3, 0]}
    (tmp_path / "scene.json").write_text(json.dumps({"start": [0, 0, 0], "goal": [7, 1, 0], "map": on_map}))
    with pytest.raises(ValueError, match=r"spans x from -4 to 6 m and y from -3 to 3 m; the goal at \(7, 1\) lies out"):
        gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", scenario=str(tmp_path / "scene.json"))
