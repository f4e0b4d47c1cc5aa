"""`wayfield identify`: from a log of a robot to its data sheet."""

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np

from wayfield.bridges.identify.checks import NAMES, UNITS, Checked, check
from wayfield.bridges.identify.estimate import Fit, fit, intervals
from wayfield.bridges.identify.noise import measure, rates
from wayfield.bridges.identify.odometry import odometry_errors
from wayfield.bridges.identify.prediction import BLOCK, Prediction, predict
from wayfield.bridges.identify.recording import STAMPS, Log, Topics, read_log
from wayfield.bridges.identify.response import SATURATIONS, Drive
from wayfield.bridges.identify.sheet import doubts, identified, settled
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.robots.robot_option import robot_option
from wayfield.system.checks import unread
from wayfield.system.command_line import Choice, Finite, OneLineErrors, command_given, say
from wayfield.system.storage import write_whole

THROTTLED = (
    "the log lacks commands: half of each change of the command is placed half an interval earlier; "
    "record all commands for narrower intervals"
)


@click.command("identify", cls=OneLineErrors)
@click.argument("log", nargs=-1, required=True, type=click.Path(path_type=Path))
@robot_option(
    "A similar robot, or its data sheet: it provides what the log does not show.", default="p3dx", show_default=True
)
@click.option("--cmd", default="/cmd_vel", show_default=True, help="Topic of the commands.")
@click.option("--odom", default="/odom", show_default=True, help="Topic of the odometry.")
@click.option("--truth", help="Topic of a true pose: Odometry or PoseStamped.")
@click.option("--scan", default="/scan", show_default=True, help="Topic of the scan, if the log has one.")
@click.option("--stamps", type=Choice("--stamps", STAMPS), default="auto", show_default=True,
              help="Source of times: headers, arrival, or headers if commands have them.")  # fmt: skip
@click.option("--cut", is_flag=True, help="Fit the pieces between long gaps of the log.")
@click.option("--split", type=Finite(0.2, 0.9), default=0.6, show_default=True,
              help="Share of each 10 s of the drive for a second fit, which is tested on the rest.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Data sheet to write (.json).")
@click.option("--report", type=click.Path(path_type=Path), help="Report with plots to write (.html).")
def main(
    log: tuple[Path, ...],
    robot: Robot,
    stamps: str,
    cut: bool,
    split: float,
    out: Path | None,
    report: Path | None,
    **topics: Any,
) -> None:
    """Finds delay, gain, lag, accelerations, limits and noise of a base from a LOG of its commands and odometry.

    LOG is a bag of ROS 1 (.bag) or ROS 2 (a folder, .mcap or .db3), or one or two tables (.csv) with the columns
    t, v_cmd, w_cmd and t, v, w in SI units, or with the unit in the name: time_ms, "v (km/h)", w_cmd_deg_s. Other names
    that are read: time, stamp; vx, vel_x; omega, yaw_rate; cmd_vel.linear.x, odom.twist.twist.angular.z.
    """
    for option, file, ending in (("--out", out, ".json"), ("--report", report, ".html")):
        if file is not None and file.suffix != ending:
            raise click.UsageError(f"{option} {str(file)!r} must end in {ending}")
        if file is not None and not file.parent.is_dir():
            raise click.UsageError(f"{option} {str(file)!r}: there is no folder {str(file.parent)!r}")
    try:
        recorded = read_log(log, Topics(**topics), stamps)
    except ModuleNotFoundError as error:
        raise click.UsageError(str(error)) from None
    except (ValueError, OSError) as error:
        message = unread(error.filename, error) if isinstance(error, OSError) and error.filename else str(error)
        raise click.UsageError(message) from None
    try:
        checked = check(recorded, cut)
        half_track = robot.wheels[-1].y if not robot.holonomic else 0.2
        fitted = intervals(fit(checked.drive, half_track))
        warnings = (*checked.warnings, *([THROTTLED] if fitted.throttled else []), *clipped(fitted.drive))
        for each in warnings:
            click.echo(f"identify: {each}", err=True)
        source = f"{recorded.name}, SHA-256 {recorded.digest}; {command_given('identify')}"
        sheet, written, missing = identified(robot, fitted, _name(out, robot), source)
        content = (json.dumps(sheet.sheet, indent=2) + "\n").encode()
        tested = predict(sheet, robot, written, settled(robot, fitted)[0], split)
        if tested is not None:
            tested.check(checked.drive)
    except ValueError as error:
        raise click.UsageError(f"{recorded.name}: {error}") from None
    truthful = odometry_errors(recorded, half_track)
    say(summary(recorded, checked, fitted, tested, split, robot.name))
    for slip in truthful if topics["truth"] is not None else ():
        say(f"  {slip.name:<17} {slip}")
    for line in missing:
        say(f"unbounded {line}")
    doubtful = [*doubts(robot, sheet), *(tested.doubts(robot.name, checked.drive) if tested is not None else [])]
    for line in doubtful:
        say(f"doubtful: {line}")
    if report is not None:
        from wayfield.bridges.identify.report import Findings, write_report

        noise = measure(recorded, fitted)
        findings = Findings(
            recorded, fitted, truthful, noise, rates(recorded), (*warnings, *doubtful), missing, tested, split,
            robot.name, command_given("identify"),
        )  # fmt: skip
        for file in write_report(report, findings):
            say(f"Report: {file}")
    if out is not None:
        write_whole(out, content)
        say(f"Sheet: {out}")


def _name(out: Path | None, base: Robot) -> str:
    """Returns what the identified robot is called: as its file, where that is a name that no other has."""
    stem = out.stem if out is not None else ""
    good = re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,39}", stem) and stem not in ROBOTS
    return stem if good else f"{base.name[:29]}_identified"


def clipped(drive: Drive) -> list[str]:
    """Returns a line for each axis whose odometry is clipped."""
    lines = []
    for axis, (low, high) in enumerate(drive.reported.T):
        if math.isfinite(low) or math.isfinite(high):
            ends = " and ".join(f"{each:.4g}" for each in (low, high) if math.isfinite(each))
            count, most = np.isin(drive.speeds[:, axis], (low, high)).sum(), np.abs(drive.commands[:, axis]).max()
            lines.append(
                f"{count} messages of odometry have the {NAMES[axis]} {ends} {UNITS[axis]}, none beyond, while up to "
                f"{most:.4g} is commanded: clipped by its driver? They count as that speed or more"
            )
    return lines


def summary(log: Log, checked: Checked, fitted: Fit, tested: Prediction | None, split: float, base: str) -> str:
    """Returns what was found, a line for each parameter."""
    saturation = SATURATIONS[fitted.saturation]
    lines = [f"{log.name}: {checked.moving:.0f} s of motion, times of {log.stamps}, saturation {saturation}"]
    lines += [f"  {each.name:<17} {each}" for each in fitted.estimates]
    lines.append(f"  residuals         {fitted.noise[0]:.3g} m/s and {fitted.noise[1]:.3g} rad/s")
    wrong = fitted.drive.times[fitted.wrong]
    if len(wrong):
        lines.append(
            f"  wrong messages    {len(wrong)} of {len(fitted.wrong)} of odometry, the first at {wrong[0]:.2f} s"
        )
    if tested is not None:
        last, rest = BLOCK * (1.0 - split), BLOCK * split
        lines.append(
            f"errors in the last {last:.2g} of every {BLOCK:g} s (held out: sheet fitted to the other {rest:.2g} s)"
        )
        lines += [f"  {what:<17} {v:.3g} m/s and {w:.3g} rad/s" for what, (v, w) in tested.rows(base).items()]
    lines += [f"drive next for {each.name}: {each.missing}" for each in fitted.estimates if each.missing]
    return "\n".join(lines)


if __name__ == "__main__":
    main(prog_name="identify", args=sys.argv[1:])
