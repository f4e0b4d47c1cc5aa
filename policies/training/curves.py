"""The figure of learning curves."""

import csv
from collections.abc import Sequence
from pathlib import Path

from wayfield.policies.training.checkpoints import CURVE

PANELS = {
    "path_following": (
        ("success", "success"),
        ("error", "cross-track RMS, IQM (m)"),
        ("p95", "its 95th percentile (m)"),
    ),
    "goal_reaching": (("success", "success"), ("collision", "collisions"), ("error", "time to the goal, IQM (s)")),
}


def read_curve(folder: Path) -> dict[str, list[float]]:
    """Returns the columns of a run's learning curve."""
    with open(folder / CURVE, newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


def draw_curves(folders: Sequence[Path], task: str, file: Path, title: str) -> None:
    """Draws the validation curves of runs over frames, a thin line each, to an image file."""
    from matplotlib.figure import Figure

    figure = Figure((10.0, 3.2), layout="constrained")
    panels = figure.subplots(1, 3)
    for folder in folders:
        curve = read_curve(folder)
        frames = [each / 1e6 for each in curve["frames"]]
        for panel, (name, _) in zip(panels, PANELS[task], strict=True):
            panel.plot(frames, curve[name], linewidth=1.0, alpha=0.8, label=folder.name)
    for panel, (name, label) in zip(panels, PANELS[task], strict=True):
        panel.set_xlabel("million frames")
        panel.set_ylabel(label)
        if name in ("success", "collision"):
            panel.set_ylim(-0.02, 1.02)
        elif task == "path_following":
            panel.set_yscale("log")
    panels[0].legend(fontsize="small", frameon=False)
    figure.suptitle(title, fontsize="medium")
    figure.savefig(file)
