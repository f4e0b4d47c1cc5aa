"""`wayfield identify`: from a log of a robot to its data sheet."""

import json
import math
import re
import sys
from pathlib import Path

import click
import numpy as np

from wayfield.benchmarks.identify.checks import Checked, check
from wayfield.benchmarks.identify.estimate import Fit, fit, intervals
from wayfield.benchmarks.identify.noise import measure, rates
from wayfield.benchmarks.identify.odometry import odometry_errors
from wayfield.benchmarks.identify.recording import STAMPS, Log, Topics, read_log
from wayfield.benchmarks.identify.response import SATURATIONS, Drive, Floats, held, pair_response
from wayfield.benchmarks.identify.sheet import identified
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.robots.robot_option import RobotChoice
from wayfield.system.checks import unread
from wayfield.system.command_line import Choice, Finite, OneLineErrors, command_given, say
from wayfield.system.storage import write_whole

LEAST_TEST = 10.0  # s, of each part of a split drive


@click.command("identify", cls=OneLineErrors)
@click.argument("log", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--robot", type=RobotChoice("--robot"), default="p3dx", show_default=True,
              help="The base whose sheet holds what no log says, and what this one does not.")  # fmt: skip
@click.option("--cmd", default="/cmd_vel", show_default=True, help="Topic of the commands.")
@click.option("--odom", default="/odom", show_default=True, help="Topic of the odometry.")
@click.option("--truth", help="Topic of a true pose: Odometry or PoseStamped.")
@click.option("--scan", default="/scan", show_default=True, help="Topic of scans, where there is one.")
@click.option("--stamps", type=Choice("--stamps", STAMPS), default="auto", show_default=True,
              help="Times: of headers, of arrival, or of headers where commands have them.")  # fmt: skip
@click.option("--cut", is_flag=True, help="Fit a log with long gaps by its pieces.")
@click.option("--split", type=Finite(0.2, 0.9), default=0.6, show_default=True,
              help="Share of the drive that a second fit sees; it is tested on the rest.")  # fmt: skip
@click.option("--bootstrap", type=click.IntRange(0, 1000), default=0, show_default=True,
              help="Fits to resampled blocks of 1 s, beside the intervals.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="The data sheet, .json.")
@click.option("--report", type=click.Path(path_type=Path), help="A page with plots, .html.")
def main(
    log: tuple[Path, ...],
    robot: Robot,
    cmd: str,
    odom: str,
    truth: str | None,
    scan: str,
    stamps: str,
    cut: bool,
    split: float,
    bootstrap: int,
    out: Path | None,
    report: Path | None,
) -> None:
    """Finds delay, gain, lag, accelerations, limits and noise of a base from a LOG of its commands and odometry.

    LOG is a bag of ROS 1 (.bag) or ROS 2 (a folder, .mcap or .db3), or one or two tables (.csv) with the columns
    t, v_cmd, w_cmd and t, v, w in SI units.
    """
    for option, file, ending in (("--out", out, ".json"), ("--report", report, ".html")):
        if file is not None and file.suffix != ending:
            raise click.UsageError(f"{option} {str(file)!r} must end in {ending}")
        if file is not None and not file.parent.is_dir():
            raise click.UsageError(f"{option} {str(file)!r}: there is no folder {str(file.parent)!r}")
    try:
        recorded = read_log(log, Topics(cmd, odom, truth, scan), stamps)
    except ModuleNotFoundError as error:
        raise click.UsageError(str(error)) from None
    except (ValueError, OSError) as error:
        message = unread(error.filename, error) if isinstance(error, OSError) and error.filename else str(error)
        raise click.UsageError(message) from None
    try:
        checked = check(recorded, cut)
        for each in checked.warnings:
            click.echo(f"identify: {each}", err=True)
        half_track = robot.wheels[-1].y if not robot.holonomic else 0.2
        found = intervals(checked.drive, fit(checked.drive, half_track))
        source = f"{recorded.name}, SHA-256 {recorded.digest}; {command_given('identify')}"
        sheet, kept = identified(robot, found, _name(out, robot), source)
        content = (json.dumps(sheet.sheet, indent=2) + "\n").encode()
    except ValueError as error:
        raise click.UsageError(f"{recorded.name}: {error}") from None
    tested = held_out(checked.drive, split, half_track)
    truthful = odometry_errors(recorded, half_track)
    say(summary(recorded, checked, found, tested, split))
    say("\n".join(f"  {each.name:<15} {each}" for each in truthful))
    for line in kept:
        say(f"not seen  {line}")
    if bootstrap:
        for name, deviation in resampled(checked.drive, found, bootstrap).items():
            say(f"bootstrap {name:<15} sd {deviation:.3g}")
    if report is not None:
        from wayfield.benchmarks.identify.report import Findings, write_report

        noise = measure(recorded, checked.drive, found)
        findings = Findings(
            recorded, checked.drive, found, truthful, noise, rates(recorded), checked.warnings, kept, tested, split,
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


def held_out(drive: Drive, share: float, half_track: float) -> tuple[Floats, Floats] | None:
    """Returns the RMS (2,) of a fit to the first part of a drive on the rest of it, and that of an ideal base.

    None where a part is too short, or the first holds no commands.
    """
    first, last = drive.times[0], drive.times[-1]
    border = first + share * (last - first)
    early, late = drive.only(drive.times < border), drive.only(drive.times >= border)
    rate = 1.0 / float(np.median(np.diff(drive.times)))
    if min(early.counted.sum(), late.counted.sum()) < LEAST_TEST * rate:
        return None
    before = drive.command_times < border
    # the fit's starts and bounds may not know the rest of the drive
    seen = Drive(
        drive.command_times[before], drive.commands[before], early.times, early.speeds, early.starts, early.counted
    )
    if not np.abs(seen.commands).max(initial=0.0) > 0.0:
        return None
    found = fit(seen, half_track)
    errors = (drive.speeds.T - pair_response(drive, found.saturation, found.numbers)[0])[:, late.counted]
    asked = np.stack([held(drive.command_times, drive.commands[:, axis], drive.times) for axis in range(2)])
    ideal = (drive.speeds.T - asked)[:, late.counted]
    return np.sqrt((errors**2).mean(axis=1)), np.sqrt((ideal**2).mean(axis=1))


def resampled(drive: Drive, found: Fit, count: int, seed: int = 0) -> dict[str, float]:
    """Returns the standard deviation of each parameter over fits to resampled residuals, in blocks of 1 s."""
    from wayfield.benchmarks.identify.estimate import refitted

    rng = np.random.default_rng(seed)
    length = max(round(1.0 / float(np.median(np.diff(drive.times)))), 1)
    residuals = drive.speeds.T - found.response
    n = residuals.shape[1]
    values = []
    for _ in range(count):
        starts = rng.integers(0, max(n - length, 1), -(-n // length))
        chosen = (starts[:, None] + np.arange(length)).ravel()[:n] % n
        values.append(refitted(drive, found, (found.response + residuals[:, chosen]).T))
    return {name: float(np.std([each[name] for each in values])) for name in values[0]}


def summary(log: Log, checked: Checked, found: Fit, tested: tuple[Floats, Floats] | None, split: float) -> str:
    """Returns what was found, a line for each parameter."""
    saturation = SATURATIONS[found.saturation]
    lines = [f"{log.name}: {checked.moving:.0f} s of motion, times of {log.stamps}, saturation {saturation}"]
    lines += [f"  {each.name:<15} {each}" for each in found.estimates]
    lines += [f"      drive next for {each.name}: {each.missing}" for each in found.estimates if each.missing]
    lines.append(f"  residuals       {found.noise[0]:.3g} m/s and {found.noise[1]:.3g} rad/s")
    if tested is not None and all(map(math.isfinite, (*tested[0], *tested[1]))):
        (v, w), (ideal_v, ideal_w) = tested
        lines.append(
            f"  held out        {v:.3g} m/s and {w:.3g} rad/s on the last {100 - 100 * split:.0f} %; "
            f"an ideal base {ideal_v:.3g} and {ideal_w:.3g}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main(prog_name="identify", args=sys.argv[1:])
