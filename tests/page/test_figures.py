"""Figures show obstacles where they stand, curves that differ, and of a large world what is driven in."""

import dataclasses
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb
from oracles.drawn_tables import rows_of

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.figures import contest_figures, document_figures
from wayfield.benchmarks.figures.drawing import PALETTE, colour, floor_plan, look, saved, subplots
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.results import write_trajectories
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.report import page
from wayfield.envs.scenarios import box, circle, obstacle_field, wall


def driven(seed: int, path: bool) -> Trajectory:
    rng = np.random.default_rng(seed)
    n = 20
    poses = np.column_stack([np.cumsum(rng.normal(0.1, 0.1, (n, 2)), axis=0), np.cumsum(rng.normal(0.0, 0.9, n))])
    return Trajectory(
        times=0.05 * np.arange(n),
        poses=poses,
        cross_track_errors=rng.normal(size=n) if path else np.empty(0),
        references=0.001 * rng.normal(size=(n, 5)) if seed == 1 else rng.normal(size=(n, 5)),
        path=np.cumsum(rng.normal(1.0, 0.2, (5, 2)), axis=0) if path else np.empty((0, 2)),
        goals=rng.normal(size=(3, 3)),
        obstacles=obstacle_field(circle(1.0, 2.0, 0.3), box(0.0, 1.0, 0.4, 0.2, 0.5), wall(0.0, 0.0, 3.0, 4.0)),
        walls=rng.normal(size=(2, 2, 2)),
    )


def test_no_two_of_three_dozen_curves_look_alike() -> None:
    looks = [(each["color"], each["linestyle"]) for each in map(look, range(36))]
    assert len(set(looks)) == 36
    assert len({colour(k) for k in range(9)}) == 9
    assert looks[9] == (colour(0), "--")
    assert len({look(k)["marker"] for k in range(9)}) == 9
    # where a colour comes again, the marker is another too
    assert all(look(k)["marker"] != look(k - 9)["marker"] for k in range(9, 36))


def legend_of(figure: Any) -> list[str]:
    return [each.get_text() for each in figure.legends[0].get_texts()]


@pytest.mark.parametrize("path", [True, False])
def test_no_two_of_a_dozen_policies_look_alike_and_the_legend_says_which(path: bool) -> None:
    policies = CONTESTS["goal-obstacles"].policies
    rows = [{"policy": name, "gains": ""} for name in policies]
    told = {"one": [(row, driven(k, path)) for k, row in enumerate(rows)], "two": [(rows[-1], driven(0, path))]}
    for draw in document_figures.figures_of("path" if path else "goal").values():
        figure = draw(told)
        said = dict(zip(legend_of(figure), figure.legends[0].get_lines(), strict=True))
        looks = {name: (to_hex(said[name].get_color()), said[name].get_linestyle()) for name in policies}
        assert len(set(looks.values())) == len(policies)
        # two dashes and the gap between them, at least
        assert figure.legends[0].handlelength * figure.legends[0].get_texts()[0].get_fontsize() >= 2.0 * 3.7 + 1.6
        for axis in figure.axes:
            for line in axis.lines:
                if line.get_label() in looks:
                    assert (to_hex(line.get_color()), line.get_linestyle()) == looks[line.get_label()]


def short_drive(goal: tuple[float, float], side: float) -> Trajectory:
    """Returns a straight drive from (1, 1) within the four walls of a square world, in which a disc stands far away."""
    corners = np.array([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side], [0.0, 0.0]])
    cells = np.array([[[x, y], [x + 0.1, y]] for x in np.arange(0.5, side, 1.0) for y in np.arange(0.5, side, 1.0)])
    poses = np.column_stack([np.linspace((1.0, 1.0), goal, 9), np.zeros(9)])
    return dataclasses.replace(
        driven(0, False),
        times=0.05 * np.arange(9),
        poses=poses,
        goals=np.array([[*goal, 0.0]]),
        obstacles=obstacle_field(circle(side - 1.0, side - 1.0, 0.3), circle(2.0, 1.5, 0.2)),
        walls=np.concatenate([np.stack([corners[:-1], corners[1:]], axis=1), cells]),
    )


def test_of_a_large_world_what_lies_around_the_drives_is_shown(tmp_path: Path) -> None:
    world = short_drive((4.0, 1.0), 60.0)
    farther = short_drive((4.0, 4.0), 60.0)
    row = {"policy": "p", "gains": ""}
    both = {"one": [(row, world), (row | {"policy": "q"}, farther)]}
    write_trajectories(tmp_path, {"00000": world})
    contest = CONTESTS["goal-obstacles"]
    told = rows_of(contest, 4)[0] | {"split": "test", "trajectory": "00000", "left_corridor": "", "timeout": ""}
    figures = document_figures.goal_seekers(both), document_figures.waypoints(both)
    plans = [(figure.axes[0], 4.0) for figure in figures]
    plans += [(contest_figures.worst(contest, Episodes([told]), tmp_path).axes[0], 1.0)]
    for axis, top in plans:
        axis.figure.draw_without_rendering()
        (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
        # the extent of the drives is 3 m; on each side at least 2 m, unless the world ends
        assert right == pytest.approx(6.0, abs=0.01)
        assert -0.5 < left < 0.0
        assert -0.5 < low < 0.0
        assert high == pytest.approx(0.5 * (1.0 + top) + 3.5)
        box = axis.get_window_extent()
        assert 0.7 <= box.width / box.height <= 1.5
        assert len(axis.patches) == 1
        (lines,) = (each for each in axis.collections if isinstance(each, LineCollection))
        drawn = np.array(lines.get_segments())
        cells = math.floor(right + 0.5) * math.floor(high + 0.5)
        assert len(drawn) == 2 + cells
    # a margin of a third where that is more, and the whole of a world that is not large
    far = short_drive((10.0, 1.0), 60.0)
    assert document_figures.goal_seekers({"one": [(row, far)]}).axes[0].get_xlim()[1] == pytest.approx(13.0)
    for side, goal in ((13.0, (4.0, 1.0)), (60.0, (30.0, 1.0))):
        drive = short_drive(goal, side)
        (axis, _) = document_figures.goal_seekers({"one": [(row, drive)]}).axes
        axis.figure.draw_without_rendering()
        for ends in (axis.get_xlim(), axis.get_ylim()):
            assert ends[0] <= 0.0
            assert ends[1] >= side
        assert len(axis.patches) == 2
        (lines,) = (each for each in axis.collections if isinstance(each, LineCollection))
        assert len(lines.get_segments()) == len(drive.walls)


def test_figures_leave_the_backend_the_style_and_the_figures_of_the_process_alone(tmp_path: Path) -> None:
    program = f"""
import importlib, pathlib, pkgutil
import matplotlib
matplotlib.use("svg")
import matplotlib.pyplot as plt
own = plt.figure()
before = dict(matplotlib.rcParams)
for package in ("benchmarks.figures", "bridges.identify", "benchmarks.commands", "benchmarks.report"):
    home = importlib.import_module("wayfield." + package)
    for module in pkgutil.iter_modules(home.__path__, home.__name__ + "."):
        importlib.import_module(module.name)
from wayfield.benchmarks.figures import drawing
stem = pathlib.Path({str(tmp_path / "a")!r})
drawing.saved(lambda: drawing.subplots(2, figsize=(3, 2), layout="constrained")[0], stem)
print(matplotlib.get_backend(), plt.get_fignums(), dict(matplotlib.rcParams) == before)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "svg [1] True"
    assert {each.name for each in tmp_path.iterdir()} == {"a.svg", "a.png"}


def test_colours_stay_apart_for_colour_blind_readers() -> None:
    """In CIELAB, as seen without and with protanopia, deuteranopia and tritanopia (Machado et al. 2009)."""
    style = page.asset("page.css")
    # those of policies, and that of their thinking, which the picture shows beside them
    themes = [re.findall(r"--(?:c\d|think): (#\w{6})", block) for block in style.split("color-scheme:")[1:]]
    eyes = [
        np.eye(3),
        np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
        np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]),
        np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]]),
    ]
    least = (20.0, 20.0, 20.0, 12.0)  # the last eye is one of many thousands
    for palette, size in ((PALETTE, 9), *((theme, 10) for theme in themes if theme)):
        assert len(palette) == size
        linear = np.array([to_rgb(each) for each in palette])
        linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
        for eye, bound in zip(eyes, least, strict=True):
            seen = np.clip(linear @ eye.T, 0.0, 1.0)
            xyz = seen @ np.array([[0.4339, 0.2126, 0.0177], [0.3762, 0.7152, 0.1095], [0.1899, 0.0722, 0.8728]])
            f = np.cbrt(xyz)  # without the linear part near black, which moves no pair here below the bound
            lab = np.column_stack([116 * f[:, 1], 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])])
            apart = np.linalg.norm(lab[:, None] - lab, axis=2)
            assert apart[np.triu_indices(size, 1)].min() > bound


def test_a_title_does_not_cover_what_is_added_to_the_numbers_of_its_axis(tmp_path: Path) -> None:
    made: list[Any] = []

    def far_away() -> Any:
        figure, axis = subplots(figsize=(4.0, 3.0), layout="constrained")
        axis.plot([0.0, 1.0], [4.5e6, 4.5e6 + 1.0])
        floor_plan(axis, "a title that begins above the numbers of the axis")
        made.append(figure)
        return figure

    saved(far_away, tmp_path / "far")
    made[-1].dpi = 130  # of the .png, which was drawn last
    axis = made[-1].axes[0]
    added = axis.yaxis.get_offset_text()
    assert added.get_text()
    title = next(each for each in axis.get_children() if getattr(each, "get_text", str)().startswith("a title"))
    assert title.get_window_extent().y0 >= added.get_window_extent().y1 - 0.5
