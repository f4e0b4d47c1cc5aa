"""What the figures draw, curve by curve and cell by cell, stated once more from the rows and the trajectories."""

import dataclasses
import itertools
import math
import statistics
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import same_color, to_hex
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import NullFormatter
from test_restated_tables import FRONT, costs_of, groups, is_off, named, number, rows_of, speed_of, table_of

from wayfield.benchmarks import contest_figures, document_figures, pictures
from wayfield.benchmarks.aggregates import interval, iqm
from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.drawing import MANY_WALLS, colour, look, obstacle_patches, plt, wall_lines
from wayfield.benchmarks.report.drives import drive_of, packed, read_drives, write_drives
from wayfield.benchmarks.results import write_trajectories
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.scenarios import TASKS, box, circle, obstacle_field, wall

NOWHERE = Path("nowhere")


@pytest.fixture(autouse=True)
def _closed() -> Any:
    yield
    plt.close("all")


def curve(axis: Any, k: int) -> Any:
    return np.array(axis.lines[k].get_data(), float)


def inches(figure: Any) -> tuple[float, float]:
    """Returns a figure's width and height: each row of its axes has a height of its own, so that none is squeezed."""
    width, height = figure.get_size_inches()
    return round(float(width), 6), round(float(height), 6)


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


def test_obstacles_are_drawn_where_they_stand() -> None:
    _, axis = plt.subplots()
    obstacles = driven(0, False).obstacles
    obstacle_patches(axis, obstacles)
    disc, cuboid, thin = axis.patches
    assert isinstance(disc, Circle)
    assert (*disc.center, disc.radius) == pytest.approx((1.0, 2.0, 0.3))
    for patch, at, turn, sides in ((cuboid, 1j, 0.5, (0.4, 0.2)), (thin, 1.5 + 2.0j, math.atan2(4.0, 3.0), (5.0, 0.0))):
        assert isinstance(patch, Polygon)
        corners = {complex(*np.round(xy, 9)) for xy in patch.get_xy()}
        signs = itertools.product((-0.5, 0.5), repeat=2)
        wanted = [at + complex(a * sides[0], b * sides[1]) * np.exp(1j * turn) for a, b in signs]
        assert corners == {complex(round(each.real, 9), round(each.imag, 9)) for each in wanted}
        first, second, third = (complex(*xy) for xy in patch.get_xy()[:3])
        assert abs(abs(second - first) - sides[0]) < 1e-9  # around, not across
        assert abs(abs(third - second) - sides[1]) < 1e-9
    assert (cuboid.get_linewidth(), thin.get_linewidth()) == (0.0, 2.0)
    walls = np.arange(8.0).reshape(2, 2, 2)
    wall_lines(axis, walls)
    wall_lines(axis, np.empty(0))
    (lines,) = (each for each in axis.collections if isinstance(each, LineCollection))
    np.testing.assert_array_equal(np.array(lines.get_segments()), walls)
    assert (lines.get_linewidth().tolist(), lines.get_rasterized()) == ([1.0], False)
    wall_lines(axis, np.zeros((4 * MANY_WALLS, 2, 2)))
    lines = axis.collections[-1]  # a picture in a drawing of lines
    assert (lines.get_linewidth().tolist(), lines.get_rasterized()) == ([0.5], True)


def test_no_two_of_three_dozen_curves_look_alike() -> None:
    looks = [(each["color"], each["linestyle"]) for each in map(look, range(36))]
    assert len(set(looks)) == 36
    assert len({colour(k) for k in range(9)}) == 9
    assert looks[9] == (colour(0), "--")
    assert len({look(k)["marker"] for k in range(9)}) == 9
    # where a colour comes again, the marker is another too
    assert all(look(k)["marker"] != look(k - 9)["marker"] for k in range(9, 36))


@pytest.mark.parametrize("name", CONTESTS)
def test_the_map_of_families(name: str) -> None:
    contest = CONTESTS[name]
    rows = rows_of(contest, 1)
    figure = contest_figures.families(contest, rows, NOWHERE)
    (axis,) = figure.axes
    entries = groups([row for row in rows if row["split"] == "test"])
    families = [*dict.fromkeys(row["family"] for row in rows)]
    assert [each.get_text() for each in axis.get_yticklabels()] == [*map(named, entries)]
    assert [each.get_text() for each in axis.get_xticklabels()] == families
    assert inches(figure)[1] == pytest.approx(1.9 + 0.33 * len(entries))
    title, longest = figure.get_suptitle(), max(len(named(entry)) for entry in entries)
    assert inches(figure)[0] == pytest.approx(max(1.0 + 0.085 * longest + 0.62 * len(families), 0.1 * len(title)))
    by_cost = name == "path-following"
    (image,) = axis.images
    texts = {(round(each.get_position()[1]), round(each.get_position()[0])): each for each in axis.texts}
    for (i, mine), (j, family) in itertools.product(enumerate(entries.values()), enumerate(families)):
        group = [row for row in mine if row["family"] == family]
        won = [row for row in group if number(row, "success")]
        share = len(won) / len(group)
        value = share
        if by_cost and won:
            cost = float(iqm(np.array([number(row, contest.spec.cost.metric) for row in won])))
            value = math.log10(max(cost, 1e-3))
            text = f"{100.0 * cost:.1f}" + (f"\n{100.0 * share:.0f} %" if share < 1.0 else "")
        else:
            value, text = (math.nan, "lost") if by_cost else (share, f"{100.0 * share:.0f}")
        assert texts[i, j].get_text() == text
        shown = image.get_array()[i, j]
        assert float(np.ma.filled(shown, np.nan)) == pytest.approx(value, nan_ok=True)
        red, green, blue, _ = image.cmap(image.norm(value)) if not math.isnan(value) else (1.0,) * 4
        ink = "white" if 0.2126 * red + 0.7152 * green + 0.0722 * blue < 0.5 else "black"
        assert same_color(texts[i, j].get_color(), ink)
    assert image.get_clim() == ((-3.0, 0.0) if by_cost else (0.0, 1.0))
    assert figure.get_suptitle() == f"{contest.title}: {contest.heat.title} by family, test scenarios"


def test_the_front_and_the_ladder() -> None:
    contest = CONTESTS["path-following"]
    metric = contest.spec.cost.metric
    rows = rows_of(contest, 2)
    (axis,) = contest_figures.front(contest, rows, NOWHERE).axes
    assert inches(axis.figure) == (8.6, 5.6)
    swept = groups([row for row in rows if row["split"] == "front"])
    bands = [each for each in axis.collections if isinstance(each, PolyCollection)]
    for k, mine in enumerate(swept.values()):
        at = [[row for row in mine if row["speed"] == speed] for speed in FRONT]
        costs = [costs_of(group, metric) for group in at]
        points = [[speed_of(group) for group in at], [float(iqm(np.array(each))) for each in costs]]
        np.testing.assert_allclose(curve(axis, 2 * k), points)
        lossy = [any(not number(row, "success") for row in group) for group in at]
        np.testing.assert_allclose(curve(axis, 2 * k + 1), np.array(points)[:, lossy])
        ends = [interval(*table_of(group, each), iqm) for group, each in zip(at, costs, strict=True)]
        corners = bands[k].get_paths()[0].vertices
        for speed, pair in zip(points[0], ends, strict=True):
            assert pair is not None
            ys = corners[np.isclose(corners[:, 0], speed), 1]
            assert (ys.min(), ys.max()) == pytest.approx(pair)
        assert same_color(axis.lines[2 * k].get_color(), colour(k))
    assert [each.get_text() for each in axis.get_legend().get_texts()] == [*map(named, swept)]
    assert (axis.get_yscale(), axis.get_xlabel(), axis.get_ylabel()) == ("log", "mean speed (m/s)", "RMS error (m)")
    assert isinstance(axis.yaxis.get_minor_formatter(), NullFormatter)
    assert axis.yaxis.get_major_formatter()(0.02) == "0.02"
    assert "each counts as an RMS error of 1 m" in axis.get_title(loc="left")

    levels = ("none", "light", "severe")
    rows = [row for row in rows_of(contest, 3, levels[::-1]) if row["split"] == "test"]
    rows = [row for row in rows if (row["policy"], row["disturbance"]) != ("B", "light")]
    top, bottom = contest_figures.ladder(contest, rows, NOWHERE).axes
    for k, mine in enumerate(groups(rows).values()):
        at = [[row for row in mine if row["disturbance"] == level] for level in levels]
        won = [[number(row, metric) for row in group if number(row, "success")] for group in at]
        shares = [100.0 * len(w) / len(g) if g else math.nan for g, w in zip(at, won, strict=True)]
        typical = [float(iqm(np.array(each))) if each else math.nan for each in won]
        np.testing.assert_allclose(curve(top, k), [range(3), shares])
        np.testing.assert_allclose(curve(bottom, k), [range(3), typical])
    assert [each.get_text() for each in bottom.get_xticklabels()] == [*levels]
    labels = top.get_ylabel(), bottom.get_ylabel(), bottom.get_xlabel()
    assert labels == ("success (%)", "RMS error of the successes (m)", "level of disturbance")
    assert (top.get_ylim(), bottom.get_yscale()) == ((-3.0, 103.0), "log")
    assert legend_of(top.figure) == [*map(named, groups(rows))]
    assert inches(top.figure) == (8.6, 8.0)
    assert not is_off([], None)


def test_the_worst_three_of_each_entry(tmp_path: Path) -> None:
    contest = CONTESTS["goal-obstacles"]
    metric = contest.spec.cost.metric
    rows = [row for row in rows_of(contest, 4) if row["policy"] in ("B", "C")]
    rows = [
        row | {"trajectory": f"{k:05d}" if k % 2 else "", "left_corridor": "", "timeout": ""}
        for k, row in enumerate(rows)
    ]
    rows = [row | {"timeout": "1"} if row["success"] == row["collision"] == "0.0" else row for row in rows]
    tested = groups([row for row in rows if row["split"] == "test"])
    drives = {row["trajectory"]: driven(k + 2, False) for k, row in enumerate(rows) if row["trajectory"]}
    write_trajectories(tmp_path, drives)
    figure = contest_figures.worst(contest, rows, tmp_path)

    def badness(row: Any) -> tuple[float, float]:
        value = number(row, metric)
        return number(row, "success"), 0.0 if math.isnan(value) else -value

    axes = [axis for axis in figure.axes if axis.get_visible()]
    assert inches(figure) == (10.2, round(2.9 * len(tested), 6))
    wanted = []
    for entry, mine in tested.items():
        worst = sorted((row for row in mine if row["trajectory"]), key=badness)[:3]
        for row in worst:
            end = "collision" if row["collision"] == "1.0" else "timeout" if row["timeout"] else ""
            end = end or f"time {number(row, metric):.3g} s"
            wanted.append((f"{named(entry)}\n{row['family']} {row['episode']}: {end}", drives[row["trajectory"]]))
    assert [axis.get_title(loc="left") for axis in axes] == [title for title, _ in wanted]
    for axis, (_, trajectory) in zip(axes, wanted, strict=True):
        goal, way, start, end = (curve(axis, k) for k in range(4))
        np.testing.assert_array_equal(goal[:, 0], trajectory.goals[-1, :2])
        np.testing.assert_array_equal(way, trajectory.poses[:, :2].T)
        np.testing.assert_array_equal(start[:, 0], trajectory.poses[0, :2])
        np.testing.assert_array_equal(end[:, 0], trajectory.poses[-1, :2])
        assert len(axis.patches) == 3
        assert axis.get_aspect() == 1.0
    asked = contest_figures.wanted_figures(tmp_path, rows, ladder=False)
    assert [each[1:] for each in asked] == [("goal-obstacles", "p3dx", each) for each in ("families", "worst", "front")]
    calm = [row for row in rows if row["split"] == "test"]
    assert [each[3] for each in contest_figures.wanted_figures(tmp_path, calm, ladder=False)] == ["families", "worst"]
    assert [each[3] for each in contest_figures.wanted_figures(tmp_path, calm, ladder=True)] == ["ladder"]


def experiments(path: bool) -> dict[str, list[tuple[dict[str, str], Trajectory]]]:
    def row(policy: str, gains: str = "") -> dict[str, str]:
        return {"policy": policy, "gains": gains}

    return {
        "one": [(row("p"), driven(0, path)), (row("q", "k=2"), driven(1, path)), (row("q"), driven(2, path))],
        "two": [(row("q"), driven(3, path))],
    }


# the same in every part of a figure, as its one legend has them
STYLE_OF = {("p", ""): "-", ("q", "k=2"): "-", ("q", ""): "--"}


def legend_of(figure: Any) -> list[str]:
    return [each.get_text() for each in figure.legends[0].get_texts()]


def check_driven(axis: Any, first: int, trajectory: Trajectory, tint: str, style: str) -> None:
    """Asserts that three lines are a way, its start and its end."""
    way, start, end = (curve(axis, first + k) for k in range(3))
    np.testing.assert_array_equal(way, trajectory.poses[:, :2].T)
    np.testing.assert_array_equal(start[:, 0], trajectory.poses[0, :2])
    np.testing.assert_array_equal(end[:, 0], trajectory.poses[-1, :2])
    assert same_color(axis.lines[first].get_color(), tint)
    assert axis.lines[first].get_linestyle() == style


def test_paths_and_errors_of_a_document() -> None:
    told = experiments(True)
    figure = document_figures.driven_paths(told)
    for axis, (name, group) in zip(figure.axes, told.items(), strict=True):
        assert axis.get_title(loc="left") == name
        np.testing.assert_array_equal(curve(axis, 0), group[0][1].path.T)
        for k, (row, trajectory) in enumerate(group):
            style = STYLE_OF[row["policy"], row["gains"]]
            check_driven(axis, 1 + 3 * k, trajectory, colour("pq".index(row["policy"])), style)
    assert legend_of(figure) == ["path", "p", "q k=2", "q"]
    many = document_figures.driven_paths({str(k): told["two"] for k in range(6)})
    assert [axis.get_visible() for axis in many.axes] == [True] * 6 + [False] * 2
    one = document_figures.driven_paths({"one": told["one"]})
    assert [inches(each) for each in (one, figure, many)] == [(8.0, 6.6), (7.2, 3.2), (14.4, 5.8)]

    figure = document_figures.reference_errors(told)
    axes = np.array(figure.axes).reshape(2, 2)
    for (along, turn), (name, group) in zip(axes, told.items(), strict=True):
        assert along.get_title(loc="left") == name
        for k, (row, trajectory) in enumerate(group):
            for axis in (along, turn):
                assert same_color(axis.lines[k].get_color(), colour("pq".index(row["policy"])))
                assert axis.lines[k].get_linestyle() == STYLE_OF[row["policy"], row["gains"]]
            np.testing.assert_array_equal(curve(along, k), [trajectory.times, trajectory.references[:, 0]])
            np.testing.assert_allclose(curve(turn, k), [trajectory.times, np.degrees(trajectory.references[:, 2])])
        for axis, least in ((along, 0.1), (turn, 20.0)):
            low, high = axis.get_ylim()
            assert high - low >= least
            for line in axis.lines:
                assert low <= line.get_ydata().min() <= line.get_ydata().max() <= high
        assert along.get_xlim()[0] == 0.0
        assert (along.get_ylabel(), turn.get_ylabel()) == ("$e_d$ (m)", "$e_h$ (deg)")
    assert [axis.get_xlabel() for axis in figure.axes[-2:]] == ["time (s)"] * 2
    assert legend_of(figure) == ["p", "q k=2", "q"]
    alone = document_figures.reference_errors({"small": told["one"][1:2]})
    assert [inches(each) for each in (alone, figure)] == [(11.0, 3.05), (11.0, 4.6)]
    small = alone.axes
    for axis, least in zip(small, (0.1, 20.0), strict=True):
        low, high = axis.get_ylim()
        drawn = curve(axis, 0)[1]
        assert high - low == pytest.approx(least)
        # about the middle of what is drawn, whose margins are alike
        assert 0.5 * (low + high) == pytest.approx(0.5 * (drawn.min() + drawn.max()), abs=1e-9)


@pytest.mark.parametrize("path", [True, False])
def test_no_two_of_a_dozen_policies_look_alike_and_the_legend_says_which(path: bool) -> None:
    policies = CONTESTS["goal-obstacles"].policies
    rows = [{"policy": name, "gains": ""} for name in policies]
    told = {"one": [(row, driven(k, path)) for k, row in enumerate(rows)], "two": [(rows[-1], driven(0, path))]}
    for draw in document_figures.figures_of("path" if path else "goal").values():
        figure = draw(told)
        said = dict(zip(legend_of(figure), figure.legends[0].get_lines(), strict=True))
        looks = {name: (to_hex(said[name].get_color()), said[name].get_linestyle()) for name in policies}
        assert len(set(looks.values())) == len(policies) == 12
        # two dashes and the gap between them, at least
        assert figure.legends[0].handlelength * figure.legends[0].get_texts()[0].get_fontsize() >= 2.0 * 3.7 + 1.6
        for axis in figure.axes:
            for line in axis.lines:
                if line.get_label() in looks:
                    assert (to_hex(line.get_color()), line.get_linestyle()) == looks[line.get_label()]


def test_ways_to_poses_of_a_document() -> None:
    told = experiments(False)
    figure = document_figures.waypoints(told)
    axes = np.array(figure.axes).reshape(2, 3)
    for (plan, norm, parts), (name, group) in zip(axes, told.items(), strict=True):
        assert plan.get_title(loc="left") == name
        goals = group[0][1].goals
        np.testing.assert_array_equal(curve(plan, 0), goals[:-1, :2].T)
        np.testing.assert_array_equal(curve(plan, 1)[:, 0], goals[-1, :2])
        for k, ((row, trajectory), style) in enumerate(zip(group, ("-", "--", ":"), strict=False)):
            check_driven(plan, 2 + 3 * k, trajectory, colour("pq".index(row["policy"])), style)
            off = goals[-1] - trajectory.poses
            np.testing.assert_allclose(curve(norm, k), [trajectory.times, [math.hypot(*each[:2]) for each in off]])
            turns = [math.remainder(each, 2.0 * math.pi) for each in off[:, 2]]
            for part, values in enumerate((off[:, 0], off[:, 1], turns)):
                np.testing.assert_allclose(curve(parts, 3 * k + part), [trajectory.times, values], atol=1e-9)
        assert [each.get_text() for each in parts.get_legend().get_texts()] == ["x (m)", "y (m)", "heading (rad)"]
        assert (norm.get_xlim()[0], norm.get_ylim()[0], parts.get_xlim()[0]) == (0.0, 0.0, 0.0)
        assert (plan.get_xlabel(), plan.get_ylabel(), plan.get_aspect()) == ("x (m)", "y (m)", 1.0)
        labels = [(axis.get_xlabel(), axis.get_ylabel()) for axis in (norm, parts)]
        assert labels == [("time (s)", "distance to the goal (m)"), ("time (s)", "error: goal minus pose")]
        assert len(plan.patches) == 3
    assert inches(figure) == (13.0, 7.8)
    figure = document_figures.goal_seekers(told)
    assert inches(figure) == (12.0, 9.7)
    axes = np.array(figure.axes).reshape(2, 2)
    for (plan, distance), (_, group) in zip(axes, told.items(), strict=True):
        np.testing.assert_array_equal(curve(plan, 0)[:, 0], group[0][1].goals[-1, :2])
        for k, (row, trajectory) in enumerate(group):
            style = STYLE_OF[row["policy"], row["gains"]]
            check_driven(plan, 1 + 3 * k, trajectory, colour("pq".index(row["policy"])), style)
            off = [math.dist(trajectory.goals[-1, :2], each) for each in trajectory.poses[:, :2]]
            np.testing.assert_allclose(curve(distance, k), [trajectory.times, off])
            assert distance.lines[k].get_linestyle() == style
        assert (distance.get_xlim()[0], distance.get_ylim()[0]) == (0.0, 0.0)
        assert (distance.get_xlabel(), distance.get_ylabel()) == ("time (s)", "distance to the goal (m)")
    assert legend_of(figure) == ["p", "q k=2", "q"]
    assert document_figures.stem_of("A") == "document_a"
    assert document_figures.stem_of("goal") == "goal"
    rows = [{"document": name} for name in ("A", "A", "goal", "path")]
    assert [each[1:] for each in document_figures.wanted_figures(NOWHERE, rows)] == [
        *(
            ("A", "trajectories"),
            ("A", "errors"),
            ("goal", "trajectories"),
            ("path", "trajectories"),
            ("path", "errors"),
        ),
    ]


def unfolded(content: bytes, columns: int) -> Any:
    """Returns what a page unpacks: planes of bytes, folded numbers, second differences."""
    planes = np.frombuffer(content, np.uint8).reshape(4, -1)
    numbers = []
    for column in planes.T.tolist():
        folded = column[0] + 256 * column[1] + 65536 * column[2] + 16777216 * column[3]
        numbers.append((folded + 1) // 2 if folded % 2 else -(folded // 2))
    lines = np.array(numbers).reshape(columns, -1)
    return np.cumsum(np.cumsum(lines, axis=1), axis=1).T


@pytest.mark.parametrize("path", [True, False])
def test_a_drive_is_whole_millimetres_and_comes_back(path: bool, tmp_path: Path) -> None:
    trajectory = driven(0, path)
    drive = drive_of(trajectory)
    turns, last = [], None
    for heading in trajectory.poses[:, 2].tolist():
        if last is not None:
            heading = last + math.remainder(heading - last, 2.0 * math.pi)
        turns.append(heading)
        last = heading
    wanted = [trajectory.poses[:, 0], trajectory.poses[:, 1], turns, *([trajectory.cross_track_errors] if path else [])]
    np.testing.assert_array_equal(drive, np.rint(1000.0 * np.column_stack(wanted)))
    np.testing.assert_array_equal(unfolded(packed(drive), drive.shape[1]), drive)
    write_drives(tmp_path, {3: drive, 1: drive[:7], 9: drive[:1]})
    back = read_drives(tmp_path)
    assert list(back) == [3, 1, 9]
    for one, other in zip(back.values(), (drive, drive[:7], drive[:1]), strict=True):
        np.testing.assert_array_equal(one, other)
    write_drives(tmp_path, {})
    assert read_drives(tmp_path) == {}
    assert statistics.fmean(drive[:1, 0]) == round(1000.0 * float(trajectory.poses[0, 0]))


def arrows(axis: Any) -> list[tuple[complex, complex]]:
    """Returns from where to where the arrows of an axis lead."""
    return [(complex(*each.xyann), complex(*each.xy)) for each in axis.texts if hasattr(each, "xyann")]


def test_a_picture_of_a_family_shows_its_path_or_its_field() -> None:
    for family in ("circuits", "splines"):
        scenario = pictures.example(TASKS["path_following"], family)
        _, axis = plt.subplots()
        pictures._path(axis, scenario)
        points = scenario.path.points
        shown = np.vstack([points, points[:1]]) if scenario.path.closed else points
        np.testing.assert_array_equal(curve(axis, 0), shown.T)
        np.testing.assert_array_equal(curve(axis, 1)[:, 0], points[0])
        ((tail, tip),) = arrows(axis)
        first, second = complex(*points[0]), complex(*points[1])
        span = max(float(points[:, k].max() - points[:, k].min()) for k in (0, 1))
        assert tail == first
        assert tip - tail == pytest.approx(0.14 * span * (second - first) / abs(second - first))
        bar = curve(axis, 2)
        assert bar[0] == pytest.approx([points[:, 0].min(), points[:, 0].min() + 1.0])
        assert bar[1, 0] == bar[1, 1] < points[:, 1].min()
    for family in ("moving_crowd", "rooms"):
        scenario = pictures.example(TASKS["goal_reaching"], family)
        _, axis = plt.subplots()
        pictures._field(axis, scenario)
        moving = [each for each in scenario.patrols if each["leg_time"] > 0.0]
        for k, each in enumerate(moving):
            here, way = complex(each["x"], each["y"]), each["leg_time"] * complex(each["vx"], each["vy"])
            ends = curve(axis, k)
            assert [complex(*end) for end in ends.T] == pytest.approx([here, here + way])
        start, goal = (complex(*pose[:2]) for pose in (scenario.start, scenario.goal))
        straight = curve(axis, len(moving))
        assert [complex(*end) for end in straight.T] == pytest.approx([start, goal])
        assert complex(*curve(axis, len(moving) + 1)[:, 0]) == goal
        ring = axis.patches[-1]
        assert (complex(*ring.center), ring.radius) == (start, 0.3)
        found = arrows(axis)
        poses = [scenario.start, *([scenario.goal] if scenario.heading_tolerance < math.pi else [])]
        for (tail, tip), (x, y, heading) in zip(found, poses, strict=True):
            assert tail == complex(x, y)
            assert tip - tail == pytest.approx(0.48 * np.exp(1j * heading))
        assert len(axis.patches) == len(scenario.obstacles) + 1


def test_a_sheet_has_a_place_for_every_family() -> None:
    spec = TASKS["docking"]
    figure = pictures.sheet(spec)
    titles = [axis.get_title() for axis in figure.axes]
    assert titles[: len(spec.families)] == [*spec.families]
    assert set(titles[len(spec.families) :]) <= {""}
    assert len(titles) % 5 == 0
    assert not any(axis.axison for axis in figure.axes)
    assert pictures.digest(spec) != pictures.digest(TASKS["goal_reaching"])
    assert pictures.stem_of("wayfield/OmniDocking-v0") == "OmniDocking"


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
    plans += [(contest_figures.worst(contest, [told], tmp_path).axes[0], 1.0)]
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
