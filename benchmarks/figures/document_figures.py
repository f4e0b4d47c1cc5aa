"""The figures that the documents print, and those of scenarios of one's own, from rows and trajectories alone."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wayfield.benchmarks.contests import OF_KIND
from wayfield.benchmarks.entrants.documents import TITLES
from wayfield.benchmarks.figures.drawing import (
    HANDLE,
    PATH_COLOUR,
    SOLID,
    STYLES,
    colour,
    floor_plan,
    goal_mark,
    obstacle_patches,
    saved,
    subplots,
    surroundings,
    wall_lines,
)
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.results import read_rows, read_trajectories
from wayfield.benchmarks.records.trajectory import Trajectory

Run = tuple[Row, Trajectory]
Experiments = Mapping[str, Sequence[Run]]

_FLOOR = ("zero", "random")


def draw(wanted: tuple[Path, str, str]) -> None:
    """Draws one of the figures as .svg and .png, given the folder of the run, the document and the figure's name.

    The first episode of a case stands for it, and the first plant of the run; the tables compare the plants.
    """
    folder, document, name = wanted
    rows = read_rows(folder).where(contest=document)
    rows = rows.where(episode=0, dynamics=rows[0]["dynamics"])
    # the floor is shown only where there are no controllers
    rows = rows.where(policy=set(rows.unique("policy")) - {*_FLOOR}) or rows
    trajectories = read_trajectories(folder, set(rows["trajectory"]))
    experiments: dict[str, list[Run]] = {}
    for row in rows:
        experiments.setdefault(row["family"], []).append((row, trajectories[row["trajectory"]]))
    stem = f"{stem_of(document)}_{name}"
    saved(lambda: figures_of(document)[name](experiments), folder / stem)


def wanted_figures(folder: Path, rows: Episodes) -> list[tuple[Path, str, str]]:
    """Returns the arguments of `draw` for every figure of the rows of a run."""
    return [(folder, document, name) for document in rows.unique("contest")
            for name in figures_of(document)]  # fmt: skip


def looks(experiments: Experiments) -> dict[str, dict[str, str]]:
    """Returns colour and line style of each run by its label, the same in all parts of a figure.

    A policy has the colour of its place in the order in which they come up; runs of one colour, be it a policy's with
    several gains or those of two where policies outnumber colours, have a line style each.
    """
    runs = [row for group in experiments.values() for row, _ in group]
    names = list(dict.fromkeys(row["policy"] for row in runs))
    styles: dict[str, dict[str, str]] = {}
    taken: Counter[str] = Counter()
    for row in runs:
        if (label := _label(row)) not in styles:
            tint = colour(names.index(row["policy"]))
            styles[label] = {"color": tint, "linestyle": STYLES[taken[tint] % len(STYLES)]}
            taken[tint] += 1
    return styles


def stem_of(document: str) -> str:
    """Returns what the names of a document's figures, or those of a scenario of the user's own, begin with."""
    return f"document_{document.lower()}" if document in TITLES else document


def driven_paths(experiments: Experiments) -> Figure:
    """Returns document A's driven paths, with start and end."""
    of_run = looks(experiments)
    columns = min(len(experiments), 4)
    lines = -(-len(experiments) // columns)
    width, height = (3.6, 2.6) if len(experiments) > 1 else (8.0, 6.0)
    figure, axes = subplots(
        lines, columns, figsize=(width * columns, height * lines + 0.6), layout="constrained", squeeze=False
    )
    for axis in axes.flat[len(experiments) :]:
        axis.set_visible(False)
    for axis, (experiment, group) in zip(axes.flat, experiments.items(), strict=False):
        axis.plot(*group[0][1].path.T, color=PATH_COLOUR, linewidth=3.5, alpha=0.6, label="path")
        for row, trajectory in group:
            _driven(axis, trajectory, of_run[_label(row)], _label(row))
        floor_plan(axis, experiment)
    _legend(figure, axes)
    return figure


def reference_errors(experiments: Experiments) -> Figure:
    """Returns document A's errors e_d and e_h of the reference point over time."""
    return _over_time(
        experiments, "$e_d$ (m)", "$e_h$ (deg)", lambda each: (each.references[:, 0], each.references[:, 2])
    )


def tracked_errors(experiments: Experiments) -> Figure:
    """Returns the distance from a timed reference and the error of the heading over time."""
    return _over_time(
        experiments,
        "distance (m)",
        "heading error (deg)",
        lambda each: (np.hypot(*each.tracked.T[:2]), each.tracked[:, 2]),
    )


def _over_time(experiments: Experiments, place: str, heading: str, errors: Callable[[Trajectory], Any]) -> Figure:
    """Returns a row of two plots for each experiment: of the errors (m, rad) that each run has over time."""
    of_run = looks(experiments)
    figure, axes = subplots(
        len(experiments),
        2,
        figsize=(11.0, 1.55 * len(experiments) + 1.5),
        layout="constrained",
        squeeze=False,
        sharex=True,
    )
    for (along, turn), (experiment, group) in zip(axes, experiments.items(), strict=True):
        for row, trajectory in group:
            style = of_run[_label(row)] | {"label": _label(row)}
            off, turned = errors(trajectory)
            along.plot(trajectory.times, off, **style)
            turn.plot(trajectory.times, np.degrees(turned), **style)
        along.set_title(experiment, loc="left")
        _open_up(along, 0.1)
        _open_up(turn, 20.0)
        along.set_ylabel(place, parse_math=True)
        turn.set_ylabel(heading, parse_math=True)
    for axis in axes[-1]:
        axis.set_xlabel("time (s)")
        axis.set_xlim(left=0.0)
    _legend(figure, axes)
    return figure


def waypoints(experiments: Experiments) -> Figure:
    """Returns document B's figure: for each experiment the driven paths, the error norm, and its parts over time."""
    of_run = looks(experiments)
    figure, axes = subplots(
        len(experiments), 3, figsize=(13.0, 3.9 * len(experiments)), layout="constrained", squeeze=False
    )
    for (plan, norm, parts), (experiment, group) in zip(axes, experiments.items(), strict=True):
        bounds = surroundings([trajectory for _, trajectory in group])
        obstacle_patches(plan, group[0][1].obstacles, bounds)
        wall_lines(plan, group[0][1].walls, bounds)
        goals = group[0][1].goals
        if len(goals) > 1:
            plan.plot(*goals[:-1, :2].T, "o", color=SOLID, markersize=6, fillstyle="none", label="waypoint")
        goal_mark(plan, goals[-1])
        for (row, trajectory), style in zip(group, STYLES, strict=False):
            look = {"color": of_run[_label(row)]["color"], "linestyle": style}
            _driven(plan, trajectory, look, _label(row))
            error = goals[-1] - trajectory.poses
            norm.plot(trajectory.times, np.hypot(error[:, 0], error[:, 1]), **look, label=_label(row))
            # half a turn to go reads +pi, as the controller turns
            turn = np.pi - (np.pi - error[:, 2]) % (2.0 * np.pi)
            for values, part, shade in (
                (error[:, 0], "x (m)", "#D55E00"),
                (error[:, 1], "y (m)", "#009E73"),
                (turn, "heading (rad)", "#CC79A7"),
            ):
                parts.plot(trajectory.times, values, style, color=shade, label=part if style == "-" else None)
        floor_plan(plan, experiment, bounds)
        norm.set_ylabel("distance to the goal (m)")
        parts.set_ylabel("error: goal minus pose")
        for axis in (norm, parts):
            axis.set_xlabel("time (s)")
            axis.set_xlim(left=0.0)
        norm.set_ylim(bottom=0.0)
        for axis in (plan, norm, parts):
            axis.legend(fontsize=8)
    return figure


def goal_seekers(experiments: Experiments) -> Figure:
    """Returns document C's figure: for each scenario the driven paths and the distance to the goal over time."""
    of_run = looks(experiments)
    figure, axes = subplots(
        len(experiments), 2, figsize=(12.0, 4.4 * len(experiments) + 0.9), layout="constrained", squeeze=False
    )
    for (plan, distance), (experiment, group) in zip(axes, experiments.items(), strict=True):
        bounds = surroundings([trajectory for _, trajectory in group])
        obstacle_patches(plan, group[0][1].obstacles, bounds)
        wall_lines(plan, group[0][1].walls, bounds)
        goal_mark(plan, group[0][1].goals[-1])
        for row, trajectory in group:
            _driven(plan, trajectory, of_run[_label(row)], _label(row))
            error = trajectory.goals[-1, :2] - trajectory.poses[:, :2]
            distance.plot(trajectory.times, np.hypot(*error.T), **of_run[_label(row)], label=_label(row))
        floor_plan(plan, experiment, bounds)
        distance.set_xlabel("time (s)")
        distance.set_ylabel("distance to the goal (m)")
        distance.set_xlim(left=0.0)
        distance.set_ylim(bottom=0.0)
    _legend(figure, axes)
    return figure


Figures = Mapping[str, Callable[[Experiments], Figure]]

FIGURES: Mapping[str, Figures] = {
    "A": {"trajectories": driven_paths, "errors": reference_errors},
    "B": {"waypoints": waypoints},
    "C": {"potential_field": goal_seekers},
}
_OWN: Mapping[str, Figures] = {
    "path": {"trajectories": driven_paths, "errors": reference_errors},
    "reference": {"trajectories": driven_paths, "errors": tracked_errors},
    "goal": {"trajectories": goal_seekers},
}  # by what is observed


def figures_of(document: str) -> Figures:
    """Returns the figures of a document, or those of a scenario of the user's own, by their names."""
    return FIGURES[document] if document in FIGURES else _OWN[OF_KIND[document].spec.observes]


def _label(row: Row) -> str:
    return f"{row['policy']} {row['gains']}".strip()


def _driven(axis: Any, trajectory: Trajectory, look: Mapping[str, str], label: str) -> None:
    """Draws a driven path with its start and end."""
    x, y = trajectory.poses[:, :2].T
    axis.plot(x, y, **look, label=label)
    axis.plot(x[0], y[0], "o", color="black", markersize=5, zorder=5)
    axis.plot(
        x[-1], y[-1], "s", color=look["color"], markersize=5, markeredgecolor="black", markeredgewidth=0.6, zorder=5
    )


def _open_up(axis: Any, least: float) -> None:
    """Widens the y axis to at least that range, so that rounding errors do not fill it."""
    low, high = axis.get_ylim()
    if high - low < least:
        middle = 0.5 * (low + high)
        axis.set_ylim(middle - 0.5 * least, middle + 0.5 * least)


def _legend(figure: Figure, axes: Any) -> None:
    """Puts one legend for all axes below them, where it covers nothing."""
    entries: dict[str, Any] = {}
    for axis in axes.flat:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    columns = min(len(entries), 4)
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns, handlelength=HANDLE)
