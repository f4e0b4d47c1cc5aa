"""The figure of learning curves."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from wayfield.envs.tasks.specs import EVERY
from wayfield.policies.training.checkpoints import CURVE, IN_FIELD
from wayfield.system.checks import shown
from wayfield.system.readers import of_folder, reader
from wayfield.system.reading import MOST_TEXT, read_bytes
from wayfield.system.storage import write_whole


class Panel(NamedTuple):
    """What a panel shows."""

    column: str  # of the curve
    label: str
    share: bool = False  # from 0 to 1
    scale: str = "linear"


PANELS = {
    "path": (
        Panel("success", "success (share)", share=True),
        Panel("error", "cross-track RMS, IQM (m)", scale="log"),
        Panel("p95", "95th percentile of the error (m)", scale="log"),
    ),
    "reference": (
        Panel("success", "success (share)", share=True),
        Panel("error", "RMS error after 10 s, IQM (m)", scale="log"),
        Panel("p95", "95th percentile of the error (m)", scale="log"),
    ),
    "goal": (
        Panel("success", "success (share)", share=True),
        Panel("collision", "collisions (share)", share=True),
        Panel("error", "time to the goal, IQM (s)"),
    ),
}  # by what is observed


_SAMPLE = "frames,success,collision,error,p95\n1024,0.5,0,0.1,0.3\n2048,1.0,0,0.05,0.2\n"


@reader("learning curve", CURVE, {CURVE: _SAMPLE}, of_folder)
def read_curve(folder: Path) -> dict[str, list[float]]:
    """Returns the columns of a run's learning curve.

    Raises:
        ValueError: naming the file, the row, the field and its value, if it is damaged.
    """
    file = folder / CURVE
    try:
        rows = list(csv.DictReader(io.StringIO(read_bytes(file, MOST_TEXT).decode("utf-8")), strict=True))
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{file} is no CSV of text: {error}") from None
    if not rows or not {"frames", *(panel.column for panels in PANELS.values() for panel in panels)} <= set(rows[0]):
        raise ValueError(f"{file} holds no learning curve: it must have rows, and columns such as frames and success")
    curve: dict[str, list[float]] = {name: [] for name in rows[0]}
    for k, row in enumerate(rows):
        for name, value in row.items():
            try:
                curve[name].append(float(value))
            except (ValueError, TypeError, KeyError):
                raise ValueError(f"{file}: {name} of row {k + 1} must be a number, got {shown(value)}") from None
    return curve


def draw_curves(folders: Sequence[Path], task: str, file: Path, title: str) -> None:
    """Draws the validation curves of runs over frames, a thin line each, to an image file.

    Where runs were validated in several fields, one more panel has the successes in each, in the mean over the runs
    that have come as far.
    """
    from matplotlib.figure import Figure

    panels: tuple[Panel, ...] = PANELS[EVERY[task].observes]
    curves = [read_curve(folder) for folder in folders]
    fields = [name for name in curves[0] if name.startswith(IN_FIELD) and all(name in curve for curve in curves)]
    if fields:
        panels = (*panels, Panel(IN_FIELD, "success (share), by field", share=True))
    figure = Figure((4.0 * len(panels), 3.8), layout="constrained")
    axes = figure.subplots(1, len(panels))
    for folder, curve in zip(folders, curves, strict=True):
        frames = [each / 1e6 for each in curve["frames"]]
        for axis, panel in zip(axes, panels, strict=True):
            if panel.column in curve:
                axis.plot(frames, curve[panel.column], linewidth=1.0, alpha=0.8, label=folder.name.replace("_", " "))
    for name in fields:
        of: dict[float, list[float]] = {}
        for curve in curves:
            for frames_seen, share in zip(curve["frames"], curve[name], strict=True):
                of.setdefault(frames_seen / 1e6, []).append(share)
        means = [sum(shares) / len(shares) for _, shares in sorted(of.items())]
        axes[-1].plot(sorted(of), means, linewidth=1.0, label=name.removeprefix(IN_FIELD))
        axes[-1].legend(fontsize="medium", frameon=False)
    for axis, panel in zip(axes, panels, strict=True):
        axis.grid(color="#E7EAED")
        axis.spines[["top", "right"]].set_visible(False)
        axis.set_xlabel("million training steps")
        axis.set_ylabel(panel.label)
        axis.set_yscale(panel.scale)
        if panel.share:
            axis.set_ylim(-0.02, 1.02)
    axes[0].legend(fontsize="medium", frameon=False)
    figure.suptitle(title, fontsize="large")
    drawn = io.BytesIO()
    figure.savefig(drawn, format=file.suffix.removeprefix("."))
    write_whole(file, drawn.getvalue())
