"""Public benchmarks: their official files, their own rules, and what is refused."""

import dataclasses
import gzip
import io
import itertools
import json
import math
import os
import re
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks.commands import evaluate
from wayfield.benchmarks.contests import PUBLIC_SPLIT, Entrants
from wayfield.benchmarks.entrants.own_scenario import without_way
from wayfield.benchmarks.entrants.public_suites import PUBLIC, mrpb_courses, racetrack_courses
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.episodes.rollout import roll_out
from wayfield.benchmarks.episodes.shortest import shortest_way
from wayfield.benchmarks.records.results import read_rows
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import goal_scenarios
from wayfield.envs.scenarios.barn import CYLINDERS, barn_scenarios, read_cylinders, read_path, read_world, way_length
from wayfield.policies import Pilot, make
from wayfield.system.readers import READERS

SHARED = Path(__file__).parents[3] / "shared" / "data"
BARN = SHARED / "barn"
HEADER = "world,x_m,y_m,radius_m\n"


def cylinder(k: int, x: float, y: float, radius: float = 0.075) -> str:
    """Returns a model of a world as the generator of the data set writes it."""
    return (
        f"<model name='unit_cylinder_{k}'><static>1</static><pose frame=''>{x:f} {y:f} 0.0 0.0 0.0 0.0</pose>"
        f"<link name='link'><collision name='collision'><geometry><cylinder><radius>{radius:f}</radius>"
        "<length>1.0</length></cylinder></geometry></collision><visual name='visual'><geometry><cylinder><radius>9"
        "</radius><length>1</length></cylinder></geometry></visual></link></model>\n"
    )


def sdf(*models: str) -> str:
    plane = (
        "<model name='ground_plane'><link name='link'><collision name='collision'><geometry><plane><normal>0 0 1"
        "</normal><size>100 100</size></plane></geometry></collision></link></model>\n"
    )
    state = "<state world_name='default'><model name='unit_cylinder_0'><pose>9 9 0 0 0 0</pose></model></state>"
    return f"<sdf version='1.6'>\n<world name='default'>\n{plane}{''.join(models)}{state}</world></sdf>"


def written(folder: Path, worlds: dict[int, str]) -> Path:
    """Returns a folder of worlds, laid out as the challenge's repository is."""
    (folder / "path_files").mkdir(parents=True)
    for number, text in worlds.items():
        (folder / f"world_{number}.world").write_text(text, encoding="utf-8")
        np.save(folder / "path_files" / f"path_{number}.npy", np.array([[15, 0], [15, 10], [17, 20], [15, 29]]))
    return folder


@pytest.fixture
def worlds(tmp_path: Path) -> Path:
    walls = [cylinder(k, x, 5.075 + 0.15 * k) for x in (-4.5, 0.0) for k in range(30)]
    return written(
        tmp_path / "BARN",
        {0: sdf(*walls), 7: sdf(*walls, cylinder(99, -1.9, 8.0, 0.3)), 51: sdf(*walls, cylinder(99, -2.6, 9.0, 0.3))},
    )


def test_a_world_is_what_its_models_collide_with(worlds: Path) -> None:
    found = read_world(worlds / "world_7.world")
    assert len(found) == 61
    assert {obstacle["radius"].item() for obstacle in found} == {0.075, 0.3}  # neither the plane, nor what is seen
    assert (found[-1]["x"], found[-1]["y"]) == (-1.9, 8.0)
    text = sdf(cylinder(0, 1.0, 2.0)).replace("<link name='link'><coll", "<link><pose>1 0 0 0 0 1</pose><coll")
    text = text.replace("0.0 0.0 0.0 0.0</pose>", f"0 0 0 {math.pi / 2}</pose>")
    (worlds / "world_8.world").write_text(text, encoding="utf-8")
    (turned,) = read_world(worlds / "world_8.world")
    assert (turned["x"], turned["y"]) == pytest.approx((1.0, 3.0))  # the link's pose is in the model's frame
    nested = f"<model name='shelf'><pose>1 0 0 0 0 {math.pi / 2}</pose>{cylinder(0, 2.0, 1.0)}</model>"
    floor = "<include><uri>model://ground_plane</uri></include>"
    (worlds / "world_8.world").write_text(sdf(nested, floor), encoding="utf-8")
    (stands,) = read_world(worlds / "world_8.world")
    assert (stands["x"], stands["y"]) == pytest.approx((0.0, 2.0))  # and a model's in that of the model around it


def test_scenarios_are_the_challenges(worlds: Path) -> None:
    bank = goal_scenarios(str(worlds), ROBOTS["jackal"].hull_radius)
    assert [each.name for each in bank] == ["world_0", "world_7", "world_51"]
    for each in bank:
        assert each.start == pytest.approx((-2.25, 3.0, math.pi / 2))
        assert each.goal[:2] == pytest.approx((-2.25, 13.0))
        assert each.position_tolerance == 1.0
        assert each.heading_tolerance == math.pi
    # row 15 is x = -2.325, column 0 y = 5.075
    legs = math.dist((-2.25, 3), (-2.325, 5.075)), 1.5, math.hypot(0.3, 1.5), math.hypot(0.3, 1.35)
    assert bank[0].published_length == pytest.approx(sum(legs) + math.dist((-2.325, 9.425), (-2.25, 13)))
    (worlds / "world_7.world").unlink()
    assert [each.name for each in barn_scenarios(worlds)] == ["world_0", "world_51"]  # files are read anew


def official(seconds: float, cells: np.ndarray, low: float) -> float:
    """Returns the score of a success as the challenge's run.py computes it, step by step."""
    gazebo = [(-2.25, 3.0)]
    for row, column in cells:
        gazebo.append((row * (0.075 * 2) - 0.075 - 30 * 0.075 * 2, column * (0.075 * 2) + 0.075 + 5))
    gazebo.append((-2.25 + 0.0, 3.0 + 10.0))
    length = 0.0
    for p1, p2 in itertools.pairwise(gazebo):
        length += ((p1[0] - p2[0]) ** 2 + (p1[1] - p2[1]) ** 2) ** 0.5
    optimal = length / 2
    return float(optimal / np.clip(seconds, low * optimal, 8 * optimal))


def straight(seconds: float, waits: float = 0.0) -> Trajectory:
    """Returns a run that stands for a while, then goes 9 m ahead at an even pace."""
    times = np.arange(0.0, waits + seconds + 1e-9, 0.05)
    y = 3.0 + 9.0 * np.clip((times - waits) / seconds, 0.0, 1.0)
    poses = np.column_stack([np.full(len(times), -2.25), y, np.full(len(times), math.pi / 2)])
    return Trajectory(times=times, poses=poses, success=True, shortest=9.0, max_speed=2.0, clock_from=0.1, limit=100.0)


def test_the_score_is_the_official_one_in_every_world(worlds: Path) -> None:
    folder = BARN if BARN.exists() else worlds
    paths = {int(file.stem[5:]): file for file in folder.rglob("path_*.npy")}
    scenarios = barn_scenarios(folder)
    assert len(scenarios) == (60 if BARN.exists() else 3)
    for scenario, seconds in zip(scenarios, itertools.cycle((9.0, 13.0, 30.0, 80.0)), strict=False):
        cells = np.load(paths[int(scenario.name[6:])], allow_pickle=False)
        run = dataclasses.replace(straight(seconds), optimal_time=scenario.published_length / 2.0)
        found = measure(run)
        clock = seconds - 0.05 * math.ceil(seconds * 0.1 / 9.0 / 0.05 - 1e-9)  # it starts 0.1 m on
        assert found["time"] == pytest.approx(clock)
        assert found["barn_score"] == pytest.approx(official(clock, cells, 2.0), rel=1e-9)
        assert found["barn_score_2022"] == pytest.approx(official(clock, cells, 4.0), rel=1e-9)
    lengths = [each.published_length for each in scenarios]
    assert 10.0 <= min(lengths) <= max(lengths) <= 2 * 6.95  # as the organisers tell of their 300


def test_the_clock_starts_with_the_first_decimetre_and_ends_after_a_hundred_seconds() -> None:
    assert measure(straight(50.0, waits=60.0))["success"] == 1.0
    assert measure(straight(50.0, waits=60.0))["time"] == pytest.approx(49.45, abs=0.11)
    late = measure(straight(101.5))
    assert (late["success"], late["timeout"], late["barn_score"]) == (0.0, 1.0, 0.0)
    never = measure(Trajectory(times=np.arange(9.0), poses=np.zeros((9, 3)), clock_from=0.1, limit=100.0))
    assert (never["success"], never["timeout"]) == (0.0, 1.0)


BROKEN_WORLDS: dict[str, tuple[str, str]] = {
    "nothing": ("", ":1: is no XML: no element found"),
    "another root": ("<robot/>", "sdf/world"),
    "a negative radius": (sdf(cylinder(0, 1, 2, -1.0)), "radius is -1"),
    "too deep": ("<a>" * 99 + "</a>" * 99, "nested more than"),
    "an entity": ("<!DOCTYPE s [<!ENTITY a 'aa'>]>\n" + sdf(cylinder(0, 1, 2)), "document type"),
    "no obstacle": (sdf(), "holds no obstacles"),
    "a word in a pose": (sdf(cylinder(0, 1, 2)).replace("2.000000 0.0", "two 0.0"), "pose is .* 6 finite numbers"),
    "the frame of another": (
        sdf(cylinder(0, 1, 2)).replace("frame=''>1", "relative_to='shelf'>1"),
        ":4: pose has relative_to='shelf'",
    ),
    "what is not in it": (
        sdf(cylinder(0, 1, 2), "<include>\n<uri>model://shelf</uri></include>"),
        ":5: includes 'model://shelf'",
    ),
    "roll": (sdf(cylinder(0, 1, 2)).replace("0.0 0.0 0.0 0.0</pose>", "0 0.5 0 0</pose>"), "roll and pitch"),
    "a mesh": (sdf(cylinder(0, 1, 2).replace("cylinder>", "mesh>")), "geometry <mesh> is not known"),
}


@pytest.mark.parametrize("broken", BROKEN_WORLDS)
def test_a_broken_world_is_a_line_that_names_it(broken: str, worlds: Path) -> None:
    text, said = BROKEN_WORLDS[broken]
    file = worlds / "world_7.world"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said) as caught:
        barn_scenarios(worlds)
    assert str(caught.value).startswith(f"{file}:")
    assert "\n" not in str(caught.value)


def saved(array: object) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)  # type: ignore[arg-type]
    return stream.getvalue()


BROKEN_PATHS: dict[str, tuple[bytes, str]] = {
    "nothing": (b"", "is no path"),
    "words": (saved(np.array([["a", "b"]])), "dtype"),
    "objects": (saved(np.array([[1, "x"]], object)), "is no path"),
    "a column more": (saved(np.zeros((3, 3))), r"shape is \(3, 3\)"),
    "NaN": (saved(np.array([[1.0, 2.0], [math.nan, 1.0]])), "cell 1 is"),
}


@pytest.mark.parametrize("broken", BROKEN_PATHS)
def test_a_broken_path_is_a_line_that_names_it(broken: str, worlds: Path) -> None:
    content, said = BROKEN_PATHS[broken]
    file = worlds / "path_files" / "path_7.npy"
    file.write_bytes(content)
    for read in (lambda: read_path(file), lambda: barn_scenarios(worlds)):
        with pytest.raises(ValueError, match=said) as caught:
            read()
        assert str(file) in str(caught.value)
        assert "\n" not in str(caught.value)


def table(folder: Path, text: str) -> Path:
    with gzip.open(folder / CYLINDERS, "wt", encoding="utf-8") as stream:
        stream.write(text)
    return folder / CYLINDERS


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEADER, "holds no cylinders"),
        (HEADER + '0,1,2,0.1\n"0"x,1,2,0.1\n', r":3: .* expected after"),
        (HEADER + "0,1,2,0.1\n0,1,wide,0.1\n", r":3: .* lacks a number"),
    ],
)
def test_other_tables_are_refused_by_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        read_cylinders(table(tmp_path, text))


def test_a_table_cut_anywhere_is_one_line_that_names_it(tmp_path: Path) -> None:
    file = table(tmp_path, HEADER + "".join(f"{k},-5,{k},0.1\n" for k in range(200)))
    whole = file.read_bytes()
    for at in range(1, len(whole), 17):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 : at + 5])
        with pytest.raises(ValueError, match=r"cylinders\.csv\.gz:\d+: "):
            read_cylinders(file)


def ring(x: float) -> list[str]:
    """Returns a pen, 4.5 m x 6 m, that leaves the robot no way out."""
    across = [cylinder(k, x - 4.5 + 0.15 * k, y) for k in range(31) for y in (1.8, 8.0)]
    return across + [cylinder(k, side, 1.8 + 0.15 * k) for k in range(42) for side in (x - 4.5, x)]


def without_a_path(folder: Path) -> None:
    (folder / "path_files" / "path_7.npy").unlink()


def twice(folder: Path) -> None:
    (folder / "more").mkdir()
    (folder / "more" / "world_7.world").write_text(sdf(cylinder(0, 1, 2)), encoding="utf-8")


def shut_in(folder: Path) -> None:
    (folder / "world_7.world").write_text(sdf(*ring(0.0)), encoding="utf-8")


def on_the_start(folder: Path) -> None:
    (folder / "world_7.world").write_text(sdf(cylinder(0, -2.25, 3.2)), encoding="utf-8")


def empty(folder: Path) -> None:
    for file in folder.rglob("*.*"):
        file.unlink()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (without_a_path, "path_7.npy is missing"),
        (twice, "it must hold one of each number"),
        (shut_in, "'world_7' has no way"),
        (on_the_start, "'world_7': obstacles[0]"),
        (empty, "holds no worlds of the BARN challenge"),
    ],
)
def test_a_folder_that_cannot_be_run_is_one_line(worlds: Path, spoil: Callable[[Path], None], said: str) -> None:
    spoil(worlds)
    run = CliRunner().invoke(evaluate.main, ["--suite", "barn", "--data", str(worlds)])
    assert run.exit_code == 2, run.output
    assert said in run.output.replace("\n", " ")
    assert not (worlds / "results").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--suite", "barn"], "needs --data FOLDER"),
        (["--suite", "barn", "--data", "nowhere"], "'nowhere' is no folder"),
        (["--suite", "path-following", "--data", "x"], "--data belongs to public benchmarks"),
        (["--suite", "racetracks", "--data", "x", "--mode", "p3dx"], "none of suite 'racetracks'"),
        (["--suite", "barn", "--data", "x", "--families", "rooms"], "--families"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(words: list[str], said: str) -> None:
    run = CliRunner().invoke(evaluate.main, words)
    assert run.exit_code == 2
    assert said in run.output
    assert run.output.strip().count("\n") <= 1


def test_circuits_are_laps_in_small(tmp_path: Path) -> None:
    angles = np.linspace(0.0, 2.0 * math.pi, 100, endpoint=False)
    rows = [f"{100 * math.cos(a):f},{60 * math.sin(a):f},5.0,5.0" for a in angles]
    file = tmp_path / "Oval.csv"
    file.write_text("# x_m,y_m,w_tr_right_m,w_tr_left_m\n" + "\n".join(rows) + "\n", encoding="utf-8")
    for other in ("README.md", ".Oval.csv", "Oval.txt"):  # what else lies there, and what editors leave
        (tmp_path / other).write_text("no circuit", encoding="utf-8")
    (course,) = racetrack_courses(str(tmp_path), ROBOTS["p3dx"])
    assert (course.family, course.split, course.env_kwargs) == ("Oval", PUBLIC_SPLIT, {"scale": 0.02})
    contest = PUBLIC["racetracks"].contest("laps")
    (case,) = contest.cases("p3dx", course, Entrants(("pure_pursuit",), ("default",)))
    assert case.gains["speed"] == 0.6
    (driven,) = roll_out(case)
    assert driven.success
    assert driven.completion >= 0.98
    assert driven.lap_length == pytest.approx(0.02 * 510.5, rel=0.01)  # Ramanujan's of the ellipse
    file.write_text("x,y\n0,0\n1,1\n2,0\n", encoding="utf-8")
    with pytest.raises(ValueError, match="is no circuit"):
        racetrack_courses(str(tmp_path), ROBOTS["p3dx"])
    file.unlink()
    with pytest.raises(ValueError, match="holds no circuits"):
        racetrack_courses(str(tmp_path), ROBOTS["p3dx"])


def ros_map(folder: Path) -> Path:
    """Returns a folder with a map, 6 m x 4 m of free floor between walls of 0.2 m cells, and two cases."""
    folder.mkdir(parents=True)
    cells = np.full((20, 30), 254, np.uint8)
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = 0, 0, 0, 0
    cells[10:19, 15] = 0  # a wall from below, with a gap of 1.8 m above it
    (folder / "map.pgm").write_bytes(b"P5 30 20 255\n" + cells.tobytes())
    text = "image: map.pgm\nresolution: 0.2\norigin: [-3, -2, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    (folder / "map.yaml").write_text(text, encoding="utf-8")
    (folder / "cases.csv").write_text(CASES_HEADER + "-2,-1,0,2,-1,0\n-2,1,0.5,2,1,-3.14\n", encoding="utf-8")
    return folder


CASES_HEADER = "start_x,start_y,start_heading,goal_x,goal_y,goal_heading\n"
CONFIG_TEXT = "\n".join(
    f'<arg name="{end}_pose_{axis}" default="{value}"/>'
    for end, values in (("initial", (-2, -1, 0)), ("goal", (2, -1, 0)))
    for axis, value in zip("xya", values, strict=True)
)


def test_cases_of_mrpb_are_poses_on_its_map(tmp_path: Path) -> None:
    folder = ros_map(tmp_path / "maze")
    (course,) = mrpb_courses(str(tmp_path), ROBOTS["p3dx"])
    assert (course.family, course.members) == ("maze", (0, 1))
    first, second = goal_scenarios(str(folder), 0.25)
    assert (first.start, first.goal) == ((-2.0, -1.0, 0.0), (2.0, -1.0, 0.0))
    assert second.goal[2] == -3.14
    assert (first.position_tolerance, first.heading_tolerance) == (0.2, 0.1)
    assert first.grid is second.grid
    # the wall stands at x = 0, from below: the way leads round its upper end
    assert shortest_way(first, 0.25) == pytest.approx(2.0 * math.hypot(2.0, 1.1 + 0.1) - 0.2, rel=0.05)
    # all cases of a map have one clock, long enough for the longest of them at half the benchmark's speed
    shorter, longer = sorted(shortest_way(each, ROBOTS["p3dx"].hull_radius) for each in (first, second))
    assert course.steps == math.ceil((2.0 * longer / 0.55 + 20.0) / 0.05) > (2.0 * shorter / 0.55 + 20.0) / 0.05 + 1.0
    (folder / "cases.csv").unlink()
    (folder / "config.txt").write_text("# Test 1\n" + CONFIG_TEXT + "\n\n", encoding="utf-8")
    (told,) = goal_scenarios(str(folder), 0.25)
    assert (told.start, told.goal) == (first.start, first.goal)


def test_a_case_of_mrpb_that_no_robot_can_drive_is_left_out_and_told_of(tmp_path: Path) -> None:
    folder = ros_map(tmp_path / "maze")
    with (folder / "cases.csv").open("a", encoding="utf-8") as file:
        file.write("-2.95,0,0,2,1,0\n")  # in the wall
    with pytest.warns(UserWarning, match="'maze 3': .* occupied or unknown over the start .* 2 of 3 cases are driven"):
        (course,) = mrpb_courses(str(tmp_path), ROBOTS["p3dx"])
    assert course.members == (0, 1)
    cells = np.full((20, 30), 254, np.uint8)
    cells[:, 15] = 0  # a wall across
    (folder / "map.pgm").write_bytes(b"P5 30 20 255\n" + cells.tobytes())
    (folder / "cases.csv").write_text(CASES_HEADER + "-2,-1,0,2,-1,0\n-2,1,0,-1,1,0\n", encoding="utf-8")
    with pytest.warns(UserWarning, match="'maze 1' has no way for a hull of 0.25 m; .* 1 of 2 cases are driven"):
        (course,) = mrpb_courses(str(tmp_path), ROBOTS["p3dx"])
    assert course.members == (1,)


def test_a_map_of_mrpb_that_cannot_be_driven_is_left_out_and_counted(tmp_path: Path) -> None:
    for name in ("maze", "office", "room"):
        ros_map(tmp_path / name)
    (tmp_path / "office" / "cases.csv").write_text(CASES_HEADER + "-2.95,0,0,2,1,0\n", encoding="utf-8")  # in the wall
    (tmp_path / "room" / "map.pgm").unlink()
    (tmp_path / "six_people").mkdir()
    (tmp_path / "six_people" / "config.txt").write_text(CONFIG_TEXT, encoding="utf-8")
    with pytest.warns(UserWarning, match="it is left out, 1 of 4 maps are driven") as told:
        (course,) = mrpb_courses(str(tmp_path), ROBOTS["p3dx"])
    assert course.family == "maze"
    named = zip(("office 1", "room/map.yaml", "six_people: has no map.yaml"), told, strict=True)
    assert all(name in str(each.message) for name, each in named)
    (tmp_path / "maze" / "cases.csv").write_text(CASES_HEADER, encoding="utf-8")
    with pytest.raises(ValueError, match="holds no cases"):
        mrpb_courses(str(tmp_path), ROBOTS["p3dx"])


BROKEN_CASES = {
    "nothing": ("cases.csv", "", "header is ''"),
    "no case": ("cases.csv", CASES_HEADER, "holds no cases"),
    "five cells": ("cases.csv", CASES_HEADER + "1,2,3,4,5\n", ":2: has 5 cells"),
    "a word": ("cases.csv", CASES_HEADER + "1,2,3,4,5,6\n1,two,3,4,5,6\n", ":3: start_y is 'two'"),
    "no launch argument": ("config.txt", "goal_pose_x: 3\n", ":1: is 'goal_pose_x: 3'"),
    "twice": ("config.txt", CONFIG_TEXT.replace("pose_y", "pose_x"), "initial_pose_x is given twice"),
    "half a case": ("config.txt", CONFIG_TEXT.rpartition("\n")[0], "case 1 has no goal_heading"),
}


@pytest.mark.parametrize("broken", BROKEN_CASES)
def test_broken_cases_are_a_line_that_names_them(broken: str, tmp_path: Path) -> None:
    name, text, said = BROKEN_CASES[broken]
    folder = ros_map(tmp_path / "maze")
    (folder / "cases.csv").unlink()
    (folder / name).write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        goal_scenarios(str(folder), 0.25)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def run(words: list[str], out: Path) -> str:
    command = CliRunner().invoke(evaluate.main, [*words, "--workers", "1", "--out", str(out)])
    assert command.exit_code == 0, command.output
    assert (out / "report.html").is_file()
    return (out / "table.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_barn_is_run_as_other_contests_are(worlds: Path, tmp_path: Path) -> None:
    words = ["--suite", "barn", "--data", str(worlds), "--policies", "vfh_plus,astar_tracker", "--gains", "default"]
    for mode, title in (("challenge", "the challenge's rules, jackal"), ("p3dx", "the P3DX at its own speed, p3dx")):
        out = tmp_path / mode
        told = run([*words, "--mode", mode], out)
        assert f"BARN, {title}" in told
        assert "beside what is published" in told
        rows = read_rows(out)
        for policy in ("vfh_plus", "astar_tracker"):
            met = [row["scenario"] for row in rows if row["policy"] == policy]
            assert met == ["world_0", "world_7", "world_51"]
        assert {row["family"] for row in rows} == {"worlds 0 to 49", "worlds 50 to 99"}
        for row in rows:
            if row["success"] == 1.0:
                length = {each.name: each.published_length for each in barn_scenarios(worlds)}[row["scenario"]]
                optimal = length / (2.0 if mode == "challenge" else 0.6)
                expected = optimal / np.clip(row["time"], 2.0 * optimal, 8.0 * optimal)
                assert row["barn_score"] == pytest.approx(float(expected))


@pytest.mark.slow
def test_maps_are_run_as_other_contests_are(tmp_path: Path) -> None:
    ros_map(tmp_path / "maps" / "maze")
    told = run(
        ["--suite", "mrpb", "--data", str(tmp_path / "maps"), "--policies", "vfh_plus", "--gains", "default"],
        tmp_path / "mrpb",
    )
    for column in ("safety", "motion efficiency", "velocity smoothness"):
        assert column in told
    assert [row["scenario"] for row in read_rows(tmp_path / "mrpb")] == ["maze 1", "maze 2"]
    if SHARED.exists():
        words = ["--suite", "movingai", "--data", str(SHARED / "movingai"), "--policies", "vfh_plus", "--episodes", "2"]
        told = run([*words, "--gains", "default"], tmp_path / "movingai")
        assert len(read_rows(tmp_path / "movingai")) == 6


@pytest.mark.slow
def test_the_planner_told_the_map_says_that_there_is_no_way(tmp_path: Path) -> None:
    rows = ["." * 240 if k != 100 else "@" * 240 for k in range(240)]
    (tmp_path / "m.map").write_text("type octile\nheight 240\nwidth 240\nmap\n" + "\n".join(rows), encoding="utf-8")
    told = {"start": [20.5, 20.5, 0.0], "goal": [20.5, 200.5, 0.0], "map": {"file": "m.map", "resolution": 1.0}}
    file = tmp_path / "m.json"
    file.write_text(json.dumps(told), encoding="utf-8")
    assert "'m' has no way for a hull of 0.25 m" in without_way(str(file))
    env = gymnasium.make_vec(
        "wayfield/DiffDriveGoalObstacles-v0", 1, vectorization_mode="vector_entry_point", scenario=str(file)
    )
    pilot = Pilot(make("astar_tracker"), env)
    observations, _ = env.reset(seed=0)
    pilot.reset()
    for _ in range(20):
        action = pilot.command(observations)
        observations, *_ = env.step(action)
        assert (action == 0.0).all()
    assert pilot.memory["no_path"].all()


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.exists(), reason="the maps are not here")
def test_the_planner_told_the_map_arrives_in_every_public_problem() -> None:
    """Twelve problems of each list of MovingAI's, and every case of MRPB."""
    robot = ROBOTS["p3dx"]
    for suite, mode, folder in (("movingai", "problems", "movingai"), ("mrpb", "cases", "mrpb")):
        for course in PUBLIC[suite].courses(str(SHARED / folder), robot):
            entrants = Entrants(("astar_tracker",), ("default",))
            (case,) = PUBLIC[suite].contest(mode).cases(robot, course, entrants)
            driven = roll_out(case, actuators="lagged", episodes=len(course.members), members=course.members)
            assert [measure(each)["success"] for each in driven] == [1.0] * len(course.members), course.family


@pytest.mark.skipif(not BARN.exists(), reason="the worlds are not here")
def test_the_worlds_and_the_table_of_the_data_set_agree() -> None:
    derived = read_cylinders(BARN / CYLINDERS)
    assert sorted(derived) == list(range(0, 300, 5))
    for file in BARN.glob("world_*.world"):
        mine = sorted((o["x"].item(), o["y"].item(), o["radius"].item()) for o in read_world(file))
        theirs = sorted((o["x"].item(), o["y"].item(), o["radius"].item()) for o in derived[int(file.stem[6:])])
        np.testing.assert_allclose(mine, theirs, atol=1e-9)
    lengths = [way_length(read_path(file)) for file in BARN.rglob("path_*.npy")]
    assert 5.0 <= min(lengths) / 2.0 <= max(lengths) / 2.0 <= 6.94  # s, as the organisers' 300 worlds have them


def test_a_goal_that_no_way_leads_to_is_told_of(tmp_path: Path) -> None:
    file = tmp_path / "shut.json"
    corners = [(3, -1), (5, -1), (5, 1), (3, 1), (3, -1)]
    walls = [{"kind": "wall", "x1": a, "y1": b, "x2": c, "y2": d} for (a, b), (c, d) in itertools.pairwise(corners)]
    for standing, told in ((walls, "scenario 'shut' has no way for a hull of 0.25 m"), (walls[:2], "")):
        file.write_text(json.dumps({"goal": [4, 0, 0], "obstacles": standing}), encoding="utf-8")
        said = without_way(str(file))
        assert told in said
        assert bool(said) == bool(told)
    file.write_text('{"path": [[0, 0], [2, 0]]}', encoding="utf-8")
    assert without_way(str(file)) == ""


def test_a_folder_whose_file_was_changed_is_read_anew_whatever_its_time_says(tmp_path: Path) -> None:
    READERS["BARN worlds of a table"].fill(tmp_path)
    file = tmp_path / CYLINDERS
    table = gzip.decompress(file.read_bytes())
    file.write_bytes(gzip.compress(table, 0))
    before, first = file.stat(), barn_scenarios(tmp_path)[0]
    file.write_bytes(gzip.compress(table.replace(b"0,-2,8,0.1", b"0,-1,8,0.1"), 0))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (file.stat().st_size, file.stat().st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    assert barn_scenarios(tmp_path)[0].obstacles.tobytes() != first.obstacles.tobytes()
