"""The report of an identification: one HTML page with its plots, which need no network, and what to drive next."""

import base64
import dataclasses
import html
import io
import itertools
import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from wayfield.benchmarks.figures.drawing import PALETTE, PATH_COLOUR, RC, subplots
from wayfield.bridges.identify.estimate import Estimate, Fit
from wayfield.bridges.identify.noise import Noise, Rate
from wayfield.bridges.identify.prediction import BLOCK, Prediction
from wayfield.bridges.identify.recording import Log
from wayfield.bridges.identify.response import SATURATIONS, Drive, held
from wayfield.system.storage import write_whole

AXES_NAMES = (("v", "forward speed", "m/s"), ("w", "yaw rate", "rad/s"))
ZOOM = 12.0  # s, of the plot in which steps can be seen
RED, BLUE, GREY = *PALETTE[:2], PATH_COLOUR
SATURATION = {
    "axes": "each axis by itself",
    "twist": "both axes by one factor",
    "wheels": "each wheel by itself",
}


@dataclasses.dataclass(frozen=True)
class Findings:
    """All that a report shows."""

    log: Log
    fit: Fit
    odometry: tuple[Estimate, ...]
    noise: Noise
    rates: list[Rate]
    warnings: tuple[str, ...]
    unbounded: list[str]  # what the log did not say
    tested: Prediction | None
    split: float
    base: str
    command: str

    @property
    def next_drives(self) -> list[str]:
        """Returns what to drive so that what is missing is seen."""
        drives: dict[str, list[str]] = {}
        for each in (*self.fit.estimates, *self.odometry):
            if each.missing:
                drives.setdefault(each.missing, []).append(each.name)
        return [f"{', '.join(names)}: {what}" for what, names in drives.items()]


def write_report(file: Path, findings: Findings) -> list[Path]:
    """Writes the page and, beside it, its two plots; returns the files.

    Raises:
        OSError: if one cannot be written.
    """
    with matplotlib.rc_context(RC):
        plots = {"response": _response(findings), "residuals": _residuals(findings)}
    files = []
    for name, content in plots.items():
        files.append(file.with_name(f"{file.stem}_{name}.png"))
        write_whole(files[-1], content)
    write_whole(file, _page(findings, plots).encode())
    return [file, *files]


def _response(findings: Findings) -> bytes:
    """Returns measured and fitted speeds: the whole drive, and the seconds with the largest commands."""
    drive, fit = findings.fit.drive, findings.fit
    figure, panels = subplots(2, 2, figsize=(12, 7), width_ratios=(2, 1), layout="constrained")
    for axis, (_, name, unit) in enumerate(AXES_NAMES):
        start = _busiest(drive, axis)
        for panel, whole in zip(panels[axis], (True, False), strict=True):
            panel.step(
                drive.command_times, drive.commands[:, axis], where="post", color=GREY, linewidth=0.8, label="commanded"
            )
            panel.plot(
                drive.times, drive.speeds[:, axis], ".", color=BLUE, markersize=2 if whole else 4, label="measured"
            )
            for part in _parts(drive):
                panel.plot(
                    drive.times[part], fit.response[axis][part], color=RED, linewidth=0.9 if whole else 1.4,
                    label="model" if part.start == 0 else None,
                )  # fmt: skip
            panel.set_xlim(*((drive.times[0], drive.times[-1]) if whole else (start, start + ZOOM)))
        panels[axis, 0].set_ylabel(f"{name} ({unit})")
        panels[axis, 1].set_title(f"the {ZOOM:g} s of largest changes")
    for panel in panels[1]:
        panel.set_xlabel("time (s)")
    panels[0, 0].legend(loc="upper right", ncols=3)
    return _png(figure)


def _residuals(findings: Findings) -> bytes:
    """Returns what the fit leaves: over time, as a histogram beside a normal one, and its correlation over time."""
    drive, fit = findings.fit.drive, findings.fit
    figure, panels = subplots(2, 3, figsize=(13, 6), width_ratios=(2, 1, 1), layout="constrained")
    for axis, (_, name, unit) in enumerate(AXES_NAMES):
        left = fit.residuals()[axis]
        over, spread, again = panels[axis]
        over.plot(drive.times[drive.counted & ~fit.wrong], left, ".", color=BLUE, markersize=2)
        over.axhline(0.0, color=GREY, linewidth=0.8)
        over.set_ylabel(f"residual of\n{name} ({unit})")
        deviation = max(float(fit.noise[axis]), 1e-9)
        reach = np.linspace(-4.0, 4.0, 41) * deviation
        spread.hist(np.clip(left, reach[0], reach[-1]), reach, density=True, color=BLUE, alpha=0.6)
        spread.plot(reach, np.exp(-0.5 * (reach / deviation) ** 2) / (deviation * math.sqrt(2.0 * math.pi)), color=RED)
        spread.set_xlabel(unit)
        spread.set_yticks([])
        lags = np.arange(0, min(40, len(left) // 4))
        centred = left - left.mean()
        total = max(float(centred @ centred), 1e-300)
        again.bar(lags, [float(centred[k:] @ centred[: len(left) - k]) / total for k in lags], color=BLUE)
        again.axhline(0.0, color=GREY, linewidth=0.8)
        again.set_ylim(-0.5, 1.05)
    panels[0, 1].set_title("histogram and normal density")
    panels[0, 2].set_title("autocorrelation")
    panels[1, 0].set_xlabel("time (s)")
    panels[1, 2].set_xlabel("lag (samples)")
    return _png(figure)


def _busiest(drive: Drive, axis: int) -> float:
    """Returns the time from which on commands of an axis change most, over ZOOM."""
    grid = np.arange(drive.times[0], max(drive.times[-1] - ZOOM, drive.times[0] + 1.0), 1.0)
    change = np.abs(np.diff(held(drive.command_times, drive.commands[:, axis], drive.times), prepend=0.0))
    sums = [change[(drive.times >= start) & (drive.times < start + ZOOM)].sum() for start in grid]
    return float(grid[int(np.argmax(sums))])


def _parts(drive: Drive) -> list[slice]:
    """Returns the pieces between gaps."""
    edges = [*np.flatnonzero(drive.starts).tolist(), len(drive.times)]
    return [slice(*each) for each in itertools.pairwise(edges)]


def _png(figure: Any) -> bytes:
    with io.BytesIO() as stream:
        figure.savefig(stream, format="png", dpi=110)
        return stream.getvalue()


_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:1000px;margin:2rem auto;padding:0 1rem;color:#222}
table{border-collapse:collapse;margin:.5rem 0}td,th{padding:.15rem .8rem .15rem 0;text-align:left;
border-bottom:1px solid #ddd;vertical-align:top}img{max-width:100%}.bound{color:#a33}code{background:#f3f3f3}"""


def _page(findings: Findings, plots: dict[str, bytes]) -> str:
    """Returns the page."""
    e = html.escape
    fit = findings.fit
    parts = [
        "<!DOCTYPE html><html lang='en'><head><meta charset='utf-8'>"
        f"<title>Identified: {e(findings.log.name)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{e(findings.log.name)}</h1><p>{fit.drive.times[-1] - fit.drive.times[0]:.0f} s of a drive; the sheet "
        f"of {e(findings.base)} fills what the log does not say. Times are {_STAMPS[findings.log.stamps]}. "
        f"Saturation: {SATURATION[SATURATIONS[fit.saturation]]}.</p>",
    ]
    if findings.warnings:
        parts.append("<p><b>Warnings.</b> " + " ".join(f"{e(each)}." for each in findings.warnings) + "</p>")
    rows = [
        (each.name, f"<span class='bound'>{e(str(each))}</span>" if each.missing else str(each))
        for each in fit.estimates
    ]
    parts.append("<h2>Parameters</h2>" + _table(("parameter", "value (95 % interval), or a bound"), rows))
    parts.append("<p>Delay and lag trade against each other; their sum is known better.</p>")
    parts.append(_image(plots["response"], "Commanded, measured and fitted speeds"))
    parts.append("<h2>How well it predicts</h2>" + _prediction(findings))
    parts.append(_image(plots["residuals"], "Residuals over time, their histogram and correlation"))
    if findings.next_drives:
        parts.append(
            "<h2>What to drive next</h2><ul>"
            + "".join(f"<li>{e(each)}</li>" for each in findings.next_drives)
            + "</ul>"
        )
    if findings.unbounded:
        lines = "".join(f"<li>{e(each)}</li>" for each in findings.unbounded)
        parts.append(f"<h2>What the log does not bound</h2><ul>{lines}</ul>")
    parts.append("<h2>Odometry against ground truth</h2>" + _table(
        ("error", "value (95 % interval)"), [(each.name, e(str(each))) for each in findings.odometry]))  # fmt: skip
    parts.append("<h2>Noise and rates</h2>" + _noises(findings.noise) + _table(
        ("topic", "messages", "rate, Hz", "jitter, ms", "longest gap, s"),
        [(each.what, str(each.count), f"{each.hertz:.3g}", f"{1e3 * each.jitter:.1f}", f"{each.longest:.3g}")
         for each in findings.rates]))  # fmt: skip
    parts.append(
        f"<p><code>{e(findings.command)}</code><br>SHA-256 of the log: <code>{findings.log.digest}</code></p>"
        "</body></html>"
    )
    return "\n".join(parts)


_STAMPS = {
    "header": "of the messages' headers",
    "arrival": "of the messages' arrival at the recorder, whose own delay is in them",
    "table": "those of the table",
}


def _prediction(findings: Findings) -> str:
    """Returns tables of held-out errors."""
    text = ""
    if findings.tested is not None:
        rows = [(html.escape(what), f"{v:.3g} m/s", f"{w:.3g} rad/s")
                for what, (v, w) in findings.tested.rows(findings.base).items()]  # fmt: skip
        text = (
            f"<p>RMS on the last {100 - 100 * findings.split:.0f} % of each {BLOCK:g} s. Held out: of a sheet "
            "fitted to the rest.</p>" + _table(("", *(name for _, name, _ in AXES_NAMES)), rows)
        )
    errors = findings.fit.losses
    compared = [(SATURATION[name], f"{math.sqrt(error):.3f}") for name, error in zip(SATURATIONS, errors, strict=True)]
    return (
        text
        + "<p>Each saturation, fitted to the whole drive:</p>"
        + _table(("saturation", "RMS, in deviations of the noise of the first"), compared)
    )


def _noises(noise: Noise) -> str:
    def text(value: float, unit: str) -> str:
        return f"{value:.3g} {unit}" if math.isfinite(value) else "not known"

    rows = [
        (f"odometry, {name}", text(noise.resting[k], unit), text(noise.moving[k], unit), f"{noise.correlation[k]:.2f}")
        for k, (_, name, unit) in enumerate(AXES_NAMES)
    ]
    rows.append(("a beam of the scan", text(noise.scan, "m"), f"{100 * noise.dropouts:.1f} % without a return"
                 if math.isfinite(noise.dropouts) else "no scans", ""))  # fmt: skip
    return _table(("", "at rest", "moving", "correlation"), rows)


def _table(header: tuple[str, ...], rows: list[Any]) -> str:
    head = "".join(f"<th>{each}</th>" for each in header)
    body = "".join("<tr>" + "".join(f"<td>{each}</td>" for each in row) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def _image(content: bytes, about: str) -> str:
    return f"<img alt='{about}' src='data:image/png;base64,{base64.b64encode(content).decode()}'>"
