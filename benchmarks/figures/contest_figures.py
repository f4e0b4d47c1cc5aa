"""The figures of a contest: results by family, by speed and by disturbance, and the worst episodes."""

import itertools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from wayfield.benchmarks.contests import ALL_CONTESTS, COST, PUBLIC_SPLIT, Contest
from wayfield.benchmarks.figures.drawing import (
    HANDLE,
    PATH_COLOUR,
    colour,
    floor_plan,
    goal_mark,
    look,
    obstacle_patches,
    saved,
    subplots,
    surroundings,
    wall_lines,
)
from wayfield.benchmarks.leaderboards.entries import COMPARED, by_entry, check_columns, label, successes
from wayfield.benchmarks.leaderboards.leaderboard import front_points
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.results import read_rows, read_trajectories
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.runs.shards import badness
from wayfield.benchmarks.runs.suite import WORST
from wayfield.benchmarks.statistics.aggregates import mean
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.world.geometry import Bounds

PANELS = 3  # beside each other in the figure of the front


def draw_contest(wanted: tuple[Path, str, str, str]) -> None:
    """Draws a figure as .svg and .png, given the folder of the run, the contest, the robot and the figure's name."""
    folder, name, robot, figure_name = wanted
    contest = ALL_CONTESTS[name]
    rows = read_rows(folder).where(contest=name, robot=robot)
    saved(lambda: FIGURES[figure_name](contest, rows, folder), folder / f"{contest.stem}_{robot}_{figure_name}")


def wanted_figures(folder: Path, rows: Episodes, ladder: bool) -> list[tuple[Path, str, str, str]]:
    """Returns the arguments of `draw_contest` for every figure that the rows of a run allow.

    Raises:
        ValueError: if the rows are not those of a contest of this version.
    """
    check_columns(rows)
    figures = []
    for (name, robot), mine in rows.groups("contest", "robot").items():
        if ladder:
            figures.append((folder, name, robot, "ladder"))
            continue
        figures += [(folder, name, robot, figure) for figure in ("worst", "families")]
        if "front" in mine.unique("split"):
            figures.append((folder, name, robot, "front"))
    return sorted(figures, key=lambda each: each[-1] == "families")  # those that take long first


def families(contest: Contest, rows: Episodes, folder: Path) -> Figure:
    """Returns the heat map: success of each entry in each family, or the cost behind it, as the contest has it."""
    del folder
    entries = by_entry(rows.where(split=COMPARED))
    names = rows.unique("family")
    success = np.full((len(entries), len(names)), np.nan)
    cost = np.full_like(success, np.nan)
    for i, mine in enumerate(entries.values()):
        for j, family in enumerate(names):
            group = mine.where(family=family)
            won = successes(group)
            success[i, j] = len(won) / len(group) if group else np.nan
            cost[i, j] = float(mean(won.numbers(contest.spec.cost.metric))) if won else np.nan
    heat = contest.heat
    by_cost = heat.metric == COST
    labels = [label(entry) for entry in entries]
    split = next(iter(entries.values()))[0]["split"]
    title = f"{contest.title}: {heat.title} by family, {split} scenarios"
    width = max(1.2 + 0.11 * max(map(len, labels)) + 0.75 * len(names), 0.13 * len(title))  # in, room for each letter
    figure, axis = subplots(figsize=(width, 2.4 + 0.42 * len(entries)))
    figure.set_layout_engine("constrained", w_pad=0.15)  # letters are wider in the .png than in the .svg
    low, high = np.log10(heat.ends) if by_cost else heat.ends
    shown = np.log10(np.maximum(cost, heat.ends[0])) if by_cost else success
    image = axis.imshow(shown, cmap=heat.map_name, aspect="auto", vmin=low, vmax=high)
    axis.grid(False)
    for i in range(len(entries)):
        for j in range(len(names)):
            text = _heat_cell(contest, success[i, j], cost[i, j])
            *light, _ = image.cmap(image.norm(shown[i, j])) if not np.isnan(shown[i, j]) else (1.0, 1.0, 1.0, 1.0)
            dark = float(np.dot(light, (0.2126, 0.7152, 0.0722))) < 0.5  # relative luminance
            axis.text(j, i, text, ha="center", va="center", fontsize=10.5, color="white" if dark else "black")
    axis.set_xticks(range(len(names)), [name.replace("_", " ") for name in names], rotation=45, ha="right")
    axis.set_yticks(range(len(entries)), labels)
    figure.suptitle(title, x=0.01, ha="left", fontsize=matplotlib.rcParams["axes.titlesize"])
    return figure


def _heat_cell(contest: Contest, success: float, cost: float) -> str:
    """Returns the text of a cell of the heat map; a share of successes stands under a cost where some have failed."""
    heat = contest.heat
    if heat.metric != COST:
        return f"{heat.factor * success:.{heat.decimals}f}"
    if np.isnan(cost):
        return "lost"
    text = f"{heat.factor * cost:.{heat.decimals}f}"
    return text if success == 1.0 else f"{text}\n{100.0 * success:.0f} %"


def front(contest: Contest, rows: Episodes, folder: Path) -> Figure:
    """Returns the speed-accuracy front: mean speed against error, each policy in a panel before all the others.

    The sets of gains of a policy share its panel, each with a marker of its own.
    """
    del folder
    swept = rows.where(split="front")
    contest = contest.of_rows(swept)
    entries = by_entry(swept)
    points = {entry: front_points(contest, mine) for entry, mine in entries.items()}
    names = list(dict.fromkeys(policy for policy, _ in entries))
    across = min(len(names), PANELS)
    down = -(-len(names) // across)
    figure, panels = subplots(
        down, across, figsize=(3.6 * across, 3.2 * down + 0.6), layout="constrained", sharex=True, sharey=True,
        squeeze=False,
    )  # fmt: skip
    for axis, name in itertools.zip_longest(panels.flat, names):
        if name is None:
            axis.axis("off")
            continue
        for entry, curve in points.items():
            if entry[0] != name:
                axis.plot([each.pace for each in curve], [each.error for each in curve], color="0.85", zorder=1)
        for k, entry in enumerate(entry for entry in entries if entry[0] == name):
            curve = points[entry]
            pace, error, lows, highs = (
                np.array([getattr(point, each) for point in curve]) for each in ("pace", "error", "low", "high")
            )
            lossy = np.array([point.lost for point in curve])
            axis.plot(pace, error, **look(k), label=entry[1], zorder=3)
            axis.fill_between(pace, lows, highs, color=colour(k), alpha=0.15, linewidth=0)
            axis.plot(pace[lossy], error[lossy], "o", color="white", markeredgecolor=colour(k), markersize=9, zorder=4)
        axis.set_title(name, loc="left")
        axis.tick_params(labelbottom=True)
        axis.legend(fontsize=10, handlelength=HANDLE)
    if contest.log_cost:
        _log_scale(panels[0, 0])
    figure.supxlabel("mean speed (m/s)", fontsize=12)
    figure.supylabel(f"{contest.cost.name} ({contest.cost.unit})", fontsize=12)
    rings = f"rings: some runs failed, each counts as {contest.counted}"
    figure.suptitle(f"{contest.title}: speed and accuracy ({rings})", x=0.01, ha="left", fontsize=13)
    return figure


def _log_scale(axis: Any) -> None:
    """Makes the y axis logarithmic where it has data, with plain numbers at 1, 2 and 5 of each decade."""
    if not any(np.isfinite(line.get_ydata()).any() for line in axis.lines):
        return
    axis.set_yscale("log")
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.yaxis.set_minor_formatter(NullFormatter())


def ladder(contest: Contest, rows: Episodes, folder: Path) -> Figure:
    """Returns success and cost of each entry against the level of disturbance."""
    del folder
    there = rows.unique("disturbance")
    levels = [level for level in LEVELS if level in there]
    figure, (top, bottom) = subplots(2, 1, figsize=(10.0, 9.5), layout="constrained", sharex=True)
    for k, (entry, mine) in enumerate(by_entry(rows).items()):
        style = look(k) | {"markersize": 4.5}
        groups = [mine.where(disturbance=level) for level in levels]
        success = [float(mean(group["success"])) if group else np.nan for group in groups]
        won = [successes(group) if group else group for group in groups]
        cost = [float(mean(group.numbers(contest.spec.cost.metric))) if group else np.nan for group in won]
        top.plot(range(len(levels)), 100.0 * np.array(success), label=label(entry), **style)
        bottom.plot(range(len(levels)), np.array(cost), **style)
    top.set_ylabel("success (%)")
    top.set_ylim(-3.0, 103.0)
    bottom.set_ylabel(f"{contest.spec.cost.name} of the successes ({contest.spec.cost.unit})")
    if contest.log_cost:
        _log_scale(bottom)
    bottom.set_xticks(range(len(levels)), levels)
    bottom.set_xlabel("level of disturbance")
    top.set_title(f"{contest.title}: under disturbances", loc="left")
    handles = top.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, fontsize=11, handlelength=HANDLE)
    return figure


def worst(contest: Contest, rows: Episodes, folder: Path) -> Figure:
    """Returns the three worst test episodes of each entry over their scenarios."""
    tested = by_entry(rows.where(split=COMPARED))
    cost = contest.spec.cost.metric
    entries = {
        entry: sorted(mine[mine["trajectory"] != ""], key=lambda row: badness(row, cost))[:WORST]
        for entry, mine in tested.items()
    }
    trajectories = read_trajectories(folder, {row["trajectory"] for mine in entries.values() for row in mine})
    columns = max(len(mine) for mine in entries.values())
    figure, axes = subplots(
        len(entries), columns, figsize=(4.0 * columns, 3.5 * len(entries) + 0.4), layout="constrained", squeeze=False
    )
    for line, (entry, mine) in zip(axes, entries.items(), strict=True):
        for axis in line[len(mine) :]:
            axis.set_visible(False)
        for axis, row in zip(line, mine, strict=False):
            bounds = surroundings([trajectories[row["trajectory"]]])
            _driven_scene(axis, trajectories[row["trajectory"]], bounds)
            public = row["split"] == PUBLIC_SPLIT
            place = Path(row["scenario"]).name if public else f"{row['family']} {row['episode']}"
            seed = f", agent seed {row['agent_seed']}" if row["agent_seed"] != "" else ""
            floor_plan(axis, f"{label(entry)}{seed}\n{place}: {_ending(contest, row)}", bounds)
            axis.title.set_fontsize(10)
    figure.legend(handles=_keys(contest), loc="outside upper left", ncols=4)
    return figure


def _keys(contest: Contest) -> list[Line2D]:
    """Returns what the lines and marks of a driven scene are."""
    if contest.spec.cost.unit == "m":
        aim = Line2D([], [], color=PATH_COLOUR, linewidth=3.0, alpha=0.6, label="path")
    else:
        aim = Line2D(
            [], [], color="#F0E442", marker="*", markeredgecolor="black", markersize=12, linestyle="", label="goal"
        )
    return [
        aim,
        Line2D([], [], color=colour(0), label="robot"),
        Line2D([], [], color="black", marker="o", markersize=4, linestyle="", label="start"),
        Line2D([], [], color=colour(1), marker="s", markersize=4, markeredgecolor="black", linestyle="", label="end"),
    ]


def _driven_scene(axis: Any, trajectory: Trajectory, bounds: Bounds | None) -> None:
    """Draws the scenario within the bounds and the driven way, from a disc at the start to a square at the end."""
    if len(trajectory.path):
        axis.plot(*trajectory.path.T, color=PATH_COLOUR, linewidth=3.0, alpha=0.6)
    obstacle_patches(axis, trajectory.obstacles, bounds)
    wall_lines(axis, trajectory.walls, bounds)
    if len(trajectory.goals) and not len(trajectory.path):
        goal_mark(axis, trajectory.goals[-1])
    x, y = trajectory.poses[:, :2].T
    axis.plot(x, y, color=colour(0), linewidth=1.2)
    axis.plot(x[0], y[0], "o", color="black", markersize=4, zorder=5)
    axis.plot(x[-1], y[-1], "s", color=colour(1), markersize=4, markeredgecolor="black", zorder=5)


def _ending(contest: Contest, row: Row) -> str:
    for name in ("collision", "left_corridor", "timeout"):
        if row[name] == 1.0:
            return name.replace("_", " ")
    cost = contest.spec.cost
    return f"{cost.name} {row[cost.metric]:.3g} {cost.unit}"


FIGURES: Mapping[str, Callable[[Contest, Episodes, Path], Figure]] = {
    "families": families,
    "front": front,
    "ladder": ladder,
    "worst": worst,
}
