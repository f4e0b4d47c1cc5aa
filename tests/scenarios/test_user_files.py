"""Files of the user's at the edge of what they may hold, and what stands in worlds, maps and tables."""

import cmath
import json
import math
import os
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield  # noqa: F401
from wayfield.envs.scenarios import GoalScenario, box, maps, obstacle_field
from wayfield.envs.scenarios.barn import read_world, way_length
from wayfield.envs.scenarios.files import kind_of
from wayfield.envs.scenarios.mrpb import COLUMNS, read_cases
from wayfield.envs.scenarios.tables import path_from_table
from wayfield.envs.world.grids import check_size
from wayfield.system.storage import write_whole

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


def test_a_problem_lies_on_its_map(tmp_path: Path) -> None:
    (tmp_path / "room.map").write_text(ROOM)
    problems = tmp_path / "a.scen"
    for changes, told in (
        ({"x0": 3, "x1": 0, "y0": 2}, ""), ({"x0": 4}, "start x is 4; it must be below the width, 4"),
        ({"y0": 3}, "start y is 3; it must be below the height, 3"), ({"x1": 4}, "goal x is 4"),
        ({"y1": 3}, "goal y is 3"),
        ({"x0": -1}, "start x is '-1'"), ({"bucket": 1_000_000_000}, "bucket is '1000000000'"), ({"bucket": 9}, ""),
        ({"way": -1.0}, "optimal length is -1"), ({"way": "nan"}, "optimal length is 'nan'"), ({"way": 0}, ""),
        ({"more": 1}, "has 10 columns; a problem has 9"),
    ):  # fmt: skip
        problems.write_text(line(**changes))
        if told:
            with pytest.raises(ValueError, match=rf"a\.scen:2: {told}"):
                maps.problems_of(str(problems))
        else:
            (problem,) = maps.problems_of(str(problems))
            assert (problem.bucket, problem.size) == (changes.get("bucket", 0), (4, 3))
            assert problem.length == changes.get("way", 4.5)
    problems.write_text(line(x0=1, y0=0, x1=2, y1=2))
    grid = maps.grid_from_file(str(tmp_path / "room.map"), resolution=0.5, origin=(1.0, 2.0, 0.3))
    scenario = maps.problems_of(str(problems))[0].scenario("mine", grid, heading_tolerance=1.0)
    # the middle of a cell, columns to the right, rows down from the top
    for found, (u, v) in ((scenario.start, (1.5, 2.5)), (scenario.goal, (2.5, 0.5))):
        at = complex(1.0, 2.0) + 0.5 * complex(u, v) * cmath.rect(1.0, 0.3)
        assert found == pytest.approx((at.real, at.imag, 0.0))
    assert (scenario.position_tolerance, scenario.heading_tolerance) == (0.2, 1.0)
    for version in ("version 1.0", "version 1e0"):
        problems.write_text(line().replace("version 1", version))
        assert len(maps.problems_of(str(problems))) == 1
    for version in ("version 2", "version", "version 1 1", "vers 1", ""):
        problems.write_text(line().replace("version 1", version))
        with pytest.raises(ValueError, match=r"a\.scen:1: is .*; it must be 'version 1'"):
            maps.problems_of(str(problems))
    problems.write_text(line() + "\n\n" + line(x0=9).partition("\n")[2])
    with pytest.raises(ValueError, match=r"a\.scen:5: start x"):
        maps.problems_of(str(problems))
    problems.write_text("version 1\n\n\n")
    with pytest.raises(ValueError, match=r"a\.scen:3: holds no problem"):
        maps.problems_of(str(problems))


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
        ("type octile", "type", 1, "it must be 'type octile'"), ("height 2", "height", 2, "it must be 'height N'"),
        ("height 2", "height 2 2", 2, "it must be 'height N'"), ("width 3", "width -3", 3, "it must be 'width N'"),
        ("map\n", "mop\n", 4, "it must be 'map'"), ("map\n", "map map\n", 4, "it must be 'map'"),
        ("height 2", "height 3", 6, "the map has 2 rows; height is 3"),
        ("map\n...", "map\n..", 5, "the row has 2 cells"),
        ("...\n...\n", "...\n....\n", 6, "the row has 4 cells; width is 3"),
        ("...\n...\n", "...\n.x.\n", 6, "'x' is no cell"),
        ("...\n...\n", ".é.\n...\n", 5, "'é' is no cell"),
    ):  # fmt: skip
        file.write_text(good.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(ValueError, match=rf"room\.map:{at}: .*{told}"):
            maps.grid_from_file(str(file))
    file.write_text("type octile\n")
    with pytest.raises(ValueError, match=r"room\.map:2: is ''; it must be 'height N'"):
        maps.grid_from_file(str(file))


def test_thresholds_are_shares_the_lower_below_the_higher(tmp_path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.arange(256, dtype=np.uint8)[None]).save(tmp_path / "a.png")
    file = str(tmp_path / "a.png")
    for low, high in ((0.0, 1.0), (0.25, 0.65), (0.0, 5e-324)):
        grid = maps.grid_from_file(file, "free", resolution=1.0, free_thresh=low, occupied_thresh=high)
        known = maps.grid_from_file(file, resolution=1.0, free_thresh=low, occupied_thresh=high)
        share = (255 - np.arange(256)) / 255
        np.testing.assert_array_equal(grid.occupied[0], share > high)
        np.testing.assert_array_equal(known.occupied[0], ~(share < low))
    for low, high, told in ((0.5, 0.5, "free_thresh is 0.5; it must be below occupied_thresh, 0.5"),
                            (-0.1, 0.5, "free_thresh"), (0.5, 1.1, "occupied_thresh")):  # fmt: skip
        with pytest.raises(ValueError, match=told):
            maps.grid_from_file(file, resolution=1.0, free_thresh=low, occupied_thresh=high)
    for negate in (1, True, 1.0):
        grid = maps.grid_from_file(file, "free", resolution=1.0, negate=negate)
        np.testing.assert_array_equal(grid.occupied[0], np.arange(256) / 255 > 0.65)
    for negate in (2, None, -1, 0.5):
        with pytest.raises(ValueError, match="negate is"):
            maps.grid_from_file(file, resolution=1.0, negate=negate)


def test_names_of_maps_have_a_length(tmp_path: Path) -> None:
    scene = str(tmp_path / "scene.json")
    longest = "x" * 251 + ".map"
    assert maps.file_beside(scene, "map.file", longest) == str(tmp_path / longest)
    assert maps.file_beside("scene.json", "map.file", "sub/room.map") == "sub/room.map"
    for bad in ("x" + longest, "", 3, None, "a\nb"):
        with pytest.raises(ValueError, match=r"map\.file is .*; it must be the name of a file"):
            maps.file_beside(scene, "map.file", bad)
    for bad in ("/room.map", "~/room.map", "C:room.map", "\\room.map"):
        with pytest.raises(ValueError, match="must be relative to the folder of scene"):
            maps.file_beside(scene, "map.file", bad)
    with pytest.raises(ValueError, match="must not lead out of the folder"):
        maps.file_beside(scene, "map.file", "sub/../../room.map")


def test_a_yaml_has_as_many_characters_and_brackets_as_it_may(tmp_path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.zeros((2, 3), np.uint8)).save(tmp_path / "room.png")
    file = tmp_path / "room.yaml"
    told = "image: room.png\nresolution: 0.5\norigin: [0, 0, 0]\n"
    for more, problem in (
        ("#" * (65_536 - len(told)), ""), ("#" * (65_537 - len(told)), "65537 characters"),
        ("notes: " + "[], " * 0 + "[" + ", ".join(["[]"] * 98) + "]\n", ""),
        ("notes: [" + ", ".join(["[]"] * 99) + "]\n", "nested too deeply"),
    ):  # fmt: skip
        file.write_text(told + more)
        if problem:
            with pytest.raises(ValueError, match=problem):
                maps.grid_from_file(str(file))
        else:
            assert maps.grid_from_file(str(file)).shape == (2, 3)


# Worlds of Gazebo.


def test_poses_in_poses_are_composed(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    poses = [(*rng.uniform(-2.0, 2.0, 2), rng.uniform(-1.0, 1.0)) for _ in range(5)]
    world, model, inner, link, collision = (f"<pose>{x} {y} 7 0 0 {yaw}</pose>" for x, y, yaw in poses)
    shapes = "<geometry><box><size>0.6 0.4 9</size></box><cylinder><radius>0.2</radius></cylinder></geometry>"
    file = tmp_path / "world_0.world"
    file.write_text(
        f"<sdf><world>{world}<model>{model}<model>{inner}<link>{link}<collision>{collision}{shapes}</collision></link>"
        "</model></model></world></sdf>"
    )
    at, turn = 0j, 0.0
    for x, y, yaw in poses:
        at, turn = at + complex(x, y) * cmath.rect(1.0, turn), turn + yaw
    plate, post = read_world(file)
    for solid in (plate, post):
        assert (solid["x"], solid["y"]) == pytest.approx((at.real, at.imag))
    assert (plate["half_length"], plate["half_width"], post["radius"]) == (0.3, 0.2, 0.2)
    assert (plate["cos"], plate["sin"]) == pytest.approx((math.cos(turn), math.sin(turn)))


def test_elements_are_as_deep_as_they_may_be(tmp_path: Path) -> None:
    file = tmp_path / "world_0.world"
    post = "<geometry><cylinder><radius>0.2</radius></cylinder></geometry>"
    for models, good in ((57, True), (58, False)):  # of sdf, world, link, collision, geometry, cylinder, radius too
        nested = "<model>" * models + f"<link><collision>{post}</collision></link>" + "</model>" * models
        file.write_text(f"<sdf><world>{nested}</world></sdf>")
        if good:
            assert len(read_world(file)) == 1
        else:
            with pytest.raises(ValueError, match="is nested more than 64 elements deep"):
                read_world(file)


def test_the_way_of_a_world_is_that_of_its_cells_with_both_legs() -> None:
    cells = np.array([[10, 3], [12, 3], [12, 7]])
    corners = [(-2.25, 3.0), *((-4.575 + 0.15 * i, 5.075 + 0.15 * j) for i, j in cells), (-2.25, 13.0)]
    assert way_length(cells) == pytest.approx(sum(map(math.dist, corners, corners[1:])))


# Tables of points.


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ("x,y\n# a note\n0,0\n\n1,0\n2e6,0\n", 6, r"point \[2000000\.0, 0\.0\] is not finite or beyond"),
        ("0,0\n\n# a note\n1,1\n\n1,1\n2,2\n", 6, r"point \[1\.0, 1\.0\] repeats"),
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


def test_what_a_model_includes_is_refused_however_deep_it_stands(tmp_path: Path) -> None:
    file = tmp_path / "world_0.world"
    post = "<link><collision><geometry><cylinder><radius>0.2</radius></cylinder></geometry></collision></link>"
    for uri, good in (("model://sun", True), ("model://ground_plane", True), ("model://table", False)):
        include = f"<include><uri>{uri}</uri></include>"
        for world in (f"{include}<model>{post}</model>", f"<model>{include}{post}</model>",
                      f"<model><model>{include}</model>{post}</model>"):  # fmt: skip
            file.write_text(f"<sdf><world>{world}</world></sdf>")
            if good:
                assert len(read_world(file)) == 1
            else:
                with pytest.raises(ValueError, match="includes 'model://table', which is not in the file"):
                    read_world(file)


def test_cases_of_mrpb_may_have_empty_lines_between_them(tmp_path: Path) -> None:
    file = tmp_path / "cases.csv"
    rows = ["1,2,0.5,3,4,-0.5", "", "0,0,0,1,1,1", ""]
    file.write_text("\n".join([",".join(COLUMNS), *rows]) + "\n")
    assert read_cases(file) == [(1.0, 2.0, 0.5, 3.0, 4.0, -0.5), (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)]
    file.write_text("\n".join([",".join(COLUMNS), *rows, "1,2,3"]) + "\n")
    with pytest.raises(ValueError, match=r"cases\.csv:6: has 3 cells; a case has 6"):
        read_cases(file)


def test_a_file_that_is_written_whole_may_be_read_by_whom_the_mask_lets(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        for mask in (0o027, 0o000, 0o077):
            os.umask(mask)
            write_whole(tmp_path / "ours", b"1")
            (tmp_path / "theirs").write_bytes(b"1")
            assert (tmp_path / "ours").stat().st_mode == (tmp_path / "theirs").stat().st_mode
            (tmp_path / "theirs").unlink()
    finally:
        os.umask(before)


def test_a_map_has_as_many_cells_as_it_may() -> None:
    for rows, columns in ((1, 1), (1, 16_383), (16_383, 4096), (8192, 8192)):
        check_size("map", rows, columns)
    for rows, columns in ((1, 16_384), (16_384, 1), (8192, 8193), (16_383, 4097)):
        with pytest.raises(ValueError, match=r"at most 16,383 on a side and 67,108,864 in all"):
            check_size("map", rows, columns)
    for rows, columns in ((0, 1), (1, 0)):
        with pytest.raises(ValueError, match="there must be at least one"):
            check_size("map", rows, columns)


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


def test_a_scenario_whose_start_is_blocked_is_refused() -> None:
    blocked = GoalScenario("mine", goal=(3.0, 1.0, 0.5), obstacles=obstacle_field(box(0.0, 0.0, 0.4, 0.2)))
    with pytest.raises(ValueError, match="start"):
        gymnasium.make("wayfield/OmniGoalObstacles-v0", scenario=blocked)
