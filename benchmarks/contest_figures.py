"""The figures of a contest: who is how good where, at what speed, under what disturbance, and what went worst."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from wayfield.benchmarks.aggregates import iqm, mean
from wayfield.benchmarks.contest_tables import by_entry, front_points, label, values
from wayfield.benchmarks.contests import CONTESTS, Contest
from wayfield.benchmarks.figures import PATH_COLOUR, RC, floor_plan, goal_mark, obstacle_patches
from wayfield.benchmarks.results import Row, number, read_rows, read_trajectories
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.disturbances import LEVELS

# Okabe and Ito's palette; with the line styles it tells two dozen entries apart.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D1F", "#B2182B")
_STYLES = ("-", "--")
_MARKERS = "osD^vP*Xh"


def draw_contest(wanted: tuple[Path, str, str, str]) -> None:
    """Draws a figure as .svg and .png, given the folder of the run, the contest, the robot and the figure's name."""
    folder, name, robot, figure_name = wanted
    contest = CONTESTS[name]
    rows = [row for row in read_rows(folder) if row["document"] == name and row["robot"] == robot]
    with plt.rc_context(RC):
        figure = FIGURES[figure_name](contest, rows, folder)
        stem = f"{name.replace('-', '_')}_{robot}_{figure_name}"
        figure.savefig(folder / f"{stem}.svg", metadata={"Date": None})
        figure.savefig(folder / f"{stem}.png", dpi=130)
        plt.close(figure)


def wanted_figures(folder: Path, rows: Sequence[Row], ladder: bool) -> list[tuple[Path, str, str, str]]:
    """Returns the arguments of `draw_contest` for every figure that the rows of a run allow."""
    pairs = dict.fromkeys((row["document"], row["robot"]) for row in rows)
    found = []
    for name, robot in pairs:
        if ladder:
            found.append((folder, name, robot, "ladder"))
            continue
        found += [(folder, name, robot, figure) for figure in ("families", "worst")]
        if any(row["document"] == name and row["split"] == "front" for row in rows):
            found.append((folder, name, robot, "front"))
    return found


def families(contest: Contest, rows: Sequence[Row], folder: Path) -> Figure:
    """Returns the heat map: success of each entry in each family, with the error behind it for path following."""
    del folder
    entries = by_entry(row for row in rows if row["split"] == "test")
    names = list(dict.fromkeys(row["experiment"] for row in rows))
    success = np.full((len(entries), len(names)), np.nan)
    cost = np.full_like(success, np.nan)
    for i, mine in enumerate(entries.values()):
        for j, family in enumerate(names):
            group = [row for row in mine if row["experiment"] == family]
            won = [row for row in group if number(row, "success") == 1.0]
            success[i, j] = len(won) / len(group) if group else np.nan
            cost[i, j] = float(iqm(values(won, contest.cost))) if won else np.nan
    by_error = contest.cost != "time"
    figure, axis = plt.subplots(figsize=(3.2 + 0.62 * len(names), 1.9 + 0.33 * len(entries)), layout="constrained")
    shown = np.log10(np.maximum(cost, 1e-3)) if by_error else success
    image = axis.imshow(
        shown,
        cmap="viridis_r" if by_error else "viridis",
        aspect="auto",
        vmin=-3.0 if by_error else 0.0,
        vmax=0.0 if by_error else 1.0,
    )
    axis.grid(False)
    for i in range(len(entries)):
        for j in range(len(names)):
            if by_error:
                text = "lost" if np.isnan(cost[i, j]) else f"{100.0 * cost[i, j]:.1f}"
                if not np.isnan(cost[i, j]) and success[i, j] < 1.0:
                    text += f"\n{100.0 * success[i, j]:.0f} %"
            else:
                text = f"{100.0 * success[i, j]:.0f}"
            shade = float(image.norm(float(shown[i, j]))) if not np.isnan(shown[i, j]) else 0.0  # type: ignore[arg-type]
            light = shade < 0.55 if not by_error else shade > 0.45
            white = light and not np.isnan(shown[i, j])
            axis.text(j, i, text, ha="center", va="center", fontsize=6.5, color="white" if white else "black")
    axis.set_xticks(range(len(names)), [name.replace("_", " ") for name in names], rotation=45, ha="right")
    axis.set_yticks(range(len(entries)), [label(entry) for entry in entries])
    what = "RMS cross-track error of the successes (cm)" if by_error else "success (%)"
    axis.set_title(f"{contest.title}: {what} by family, test split", loc="left")
    return figure


def front(contest: Contest, rows: Sequence[Row], folder: Path) -> Figure:
    """Returns the speed-accuracy front: mean speed against RMS error, each entry swept over its cruising speed."""
    del folder
    swept = [row for row in rows if row["split"] == "front"]
    figure, axis = plt.subplots(figsize=(8.6, 5.6), layout="constrained")
    for k, (entry, mine) in enumerate(by_entry(swept).items()):
        points = front_points(contest, mine)
        pace, error, lows, highs = (
            np.array([getattr(point, name) for point in points]) for name in ("pace", "error", "low", "high")
        )
        lossy = np.array([point.lost for point in points])
        colour = _COLOURS[k % len(_COLOURS)]
        axis.plot(pace, 100.0 * error, "-", color=colour, marker=_MARKERS[k % len(_MARKERS)], label=label(entry))
        axis.fill_between(pace, 100.0 * lows, 100.0 * highs, color=colour, alpha=0.12, linewidth=0)
        axis.plot(pace[lossy], 100.0 * error[lossy], "o", color="white", markeredgecolor=colour, markersize=9, zorder=4)
    axis.set_yscale("log")
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel("mean speed (m/s)")
    axis.set_ylabel("RMS cross-track error (cm)")
    axis.set_title(f"{contest.title}: speed and accuracy (rings: some runs failed, each counts as 1 m)", loc="left")
    axis.legend(fontsize=8, ncols=2)
    return figure


def ladder(contest: Contest, rows: Sequence[Row], folder: Path) -> Figure:
    """Returns success and cost of each entry against the level of disturbance."""
    del folder
    levels = [level for level in LEVELS if any(row["disturbance"] == level for row in rows)]
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(8.6, 8.0), layout="constrained", sharex=True)
    for k, (entry, mine) in enumerate(by_entry(rows).items()):
        style: dict[str, Any] = {
            "color": _COLOURS[k % len(_COLOURS)],
            "linestyle": _STYLES[k // len(_COLOURS) % len(_STYLES)],
            "marker": _MARKERS[k % len(_MARKERS)],
            "markersize": 4.5,
        }
        groups = [[row for row in mine if row["disturbance"] == level] for level in levels]
        share = [float(mean(values(group, "success"))) if group else np.nan for group in groups]
        won = [[row for row in group if number(row, "success") == 1.0] for group in groups]
        cost = [float(iqm(values(group, contest.cost))) if group else np.nan for group in won]
        top.plot(range(len(levels)), 100.0 * np.array(share), label=label(entry), **style)
        bottom.plot(range(len(levels)), np.array(cost), **style)
    top.set_ylabel("success (%)")
    top.set_ylim(-3.0, 103.0)
    bottom.set_ylabel("time of the successes (s)" if contest.cost == "time" else "RMS error of the successes (m)")
    if contest.cost != "time":
        bottom.set_yscale("log")
    bottom.set_xticks(range(len(levels)), levels)
    bottom.set_xlabel("level of disturbance")
    top.set_title(f"{contest.title}: under disturbances", loc="left")
    figure.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    return figure


def worst(contest: Contest, rows: Sequence[Row], folder: Path) -> Figure:
    """Returns the three worst test episodes of each entry over their scenarios."""
    tested = by_entry(row for row in rows if row["split"] == "test")
    entries = {entry: [row for row in mine if row["trajectory"]] for entry, mine in tested.items()}
    trajectories = read_trajectories(folder, {row["trajectory"] for mine in entries.values() for row in mine})
    columns = max(len(mine) for mine in entries.values())
    figure, axes = plt.subplots(
        len(entries), columns, figsize=(3.4 * columns, 2.9 * len(entries)), layout="constrained", squeeze=False
    )
    for line, (entry, mine) in zip(axes, entries.items(), strict=True):
        for axis in line[len(mine) :]:
            axis.set_visible(False)
        for axis, row in zip(line, mine, strict=False):
            _driven_scene(axis, trajectories[row["trajectory"]])
            floor_plan(axis, f"{label(entry)}\n{row['experiment']} {row['episode']}: {_ending(contest, row)}")
            axis.title.set_fontsize(8)
            axis.set_xlabel("")
            axis.set_ylabel("")
    return figure


def _driven_scene(axis: Any, trajectory: Trajectory) -> None:
    """Draws the scenario and the driven way, from a disc at the start to a square at the end."""
    if len(trajectory.path):
        axis.plot(*trajectory.path.T, color=PATH_COLOUR, linewidth=3.0, alpha=0.6)
    obstacle_patches(axis, trajectory.obstacles)
    if len(trajectory.goals) and not len(trajectory.path):
        goal_mark(axis, trajectory.goals[-1])
    x, y = trajectory.poses[:, :2].T
    axis.plot(x, y, color=_COLOURS[0], linewidth=1.2)
    axis.plot(x[0], y[0], "o", color="black", markersize=4, zorder=5)
    axis.plot(x[-1], y[-1], "s", color=_COLOURS[1], markersize=4, markeredgecolor="black", zorder=5)


def _ending(contest: Contest, row: Row) -> str:
    for name in ("collision", "left_corridor", "timeout"):
        if number(row, name) == 1.0:
            return name.replace("_", " ")
    unit = "s" if contest.cost == "time" else "m RMS"
    return f"{number(row, contest.cost):.3g} {unit}"


FIGURES: Mapping[str, Callable[[Contest, Sequence[Row], Path], Figure]] = {
    "families": families,
    "front": front,
    "ladder": ladder,
    "worst": worst,
}
