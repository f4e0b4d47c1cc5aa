"""The data sheet of an identified base: the fit, each field with its interval; and what a sheet says of a drive."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wayfield.bridges.identify.estimate import Fit, commanded, refitted
from wayfield.bridges.identify.response import AXES, SATURATIONS, TWIST, WHEELS, Drive, Floats, pair_response
from wayfield.envs.robots import Robot
from wayfield.envs.robots.intervals import Interval

METHOD = "profile likelihood, 95 %"
FROM_BOUND = {"acceleration": 2.0, "deceleration": 2.0}  # times the bound; at 2 what is left of the misfit is a quarter
USUAL = {"gain": 2.0, "track": 2.0, "top speed": 3.0}  # times 1, or the base's own, up to which nothing is doubted
USUAL_DELAY = 0.4  # s
RARE = 0.02  # share of the commands that may contradict a sheet whose axes saturate by themselves


def numbers_of(robot: Robot, saturation: int) -> Floats:
    """Returns what a sheet says as PAIR names it, its limits as those of a saturation."""
    lags = robot.lag if isinstance(robot.lag, tuple) else (robot.lag, robot.lag)
    rises = robot.acceleration, robot.yaw_acceleration
    each = zip(
        robot.delay or (0.0, 0.0), robot.gain or (1.0, 1.0), rises, robot.decelerations or rises, lags, strict=True
    )
    wheel, half = robot.wheels[1].radius * robot.rated_wheel_speed, robot.wheels[1].y
    limits = (wheel, min(robot.turn_speed, wheel / half)) if saturation == AXES else (wheel, half)
    numbers = np.array([*(number for axis in each for number in axis), *limits])
    numbers[[4, 9]] = np.maximum(numbers[[4, 9]], 1e-4)  # the response divides by it
    return numbers


def predicted(robot: Robot, drive: Drive) -> Floats:
    """Returns the speeds (2, n) that a robot has by its sheet in a drive."""
    saturation = (TWIST, WHEELS)[robot.saturation == "wheels"]
    numbers = numbers_of(robot, saturation)
    commands = drive.commands.copy()
    if math.isfinite(robot.turn_speed):  # the driver's limit comes first
        turns = np.abs(numbers[6] * commands[:, 1])
        share = np.minimum(robot.turn_speed / np.maximum(turns, 1e-9), 1.0)
        commands *= share[:, None] if saturation == TWIST else np.stack([np.ones_like(share), share], axis=1)
    return pair_response(dataclasses.replace(drive, commands=commands), saturation, numbers)[0]


def settled(base: Robot, fit: Fit) -> tuple[dict[int, float], list[str]]:
    """Returns values of what the log does not bound on both sides, by their place in PAIR, and a line for each.

    The base's own value is one where the interval holds it. Where not, an acceleration is twice its bound, or less if
    the fit is, and a limit is the bound, which has been driven.
    """
    own, values, lines = numbers_of(base, fit.saturation), {}, []
    estimates = [each for each in fit.estimates if "+" not in each.name]
    for place, each in enumerate(estimates):
        if each.bounded:
            continue
        unit = f" {each.unit}" if each.unit else ""
        factor = 2.0 if each.name == "track" else 1.0
        value = factor * own[place]
        if each.low <= value <= each.high:
            lines.append(f"{each.name}: {each}; {value:.4g}{unit} of {base.name} is kept")
        else:
            fitted, times = factor * fit.numbers[place], FROM_BOUND.get(each.name.partition("_")[0], 1.0)
            value = min(fitted, times * each.low) if math.isfinite(each.low) else fitted
            lines.append(
                f"{each.name}: {each}; {base.name} has {factor * own[place]:.4g}, so {value:.4g}{unit} is taken"
            )
        values[place] = float(value / factor)
    return values, lines


def identified(base: Robot, fitted: Fit, name: str, source: str) -> tuple[Robot, Fit, list[str]]:
    """Returns a base as it was identified, the fit that it holds, and what of it the log did not say.

    Args:
        base: the robot whose sheet holds what no log can say, and what this one does not.
        found: the fit, with its estimates.
        name: of the new robot.
        source: the log, its digest and the command, for the sheet's `sources`.

    Raises:
        ValueError: if it is no robot that can be, or the base is holonomic.
    """
    if base.holonomic:
        raise ValueError(f"robot {base.name!r} has the drive {base.drive}; identification is for differential drives")
    values, lines = settled(base, fitted)
    written = dataclasses.replace(fitted, numbers=refitted(fitted, fitted.drive, values)) if values else fitted
    robot = sheet_of(base, fitted, written.numbers)
    sources: dict[str, Any] = {field: each for field, each in base.sources.items() if not isinstance(each, Interval)}
    radius = robot.wheels[1].radius
    for field, names, scale in (
        *((field, (f"{field}_v", f"{field}_w"), 1.0) for field in ("delay", "gain", "lag")),
        ("acceleration", ("acceleration_v",), 1.0),
        ("yaw_acceleration", ("acceleration_w",), 1.0),
        ("decelerations", ("deceleration_v", "deceleration_w"), 1.0),
        *(
            (("rated_wheel_speed", ("speed_v",), radius), ("turn_speed", ("speed_w",), 1.0))
            if fitted.saturation == AXES
            else (("rated_wheel_speed", ("wheel_speed",), radius), ("wheels.effective_track", ("track",), 1.0))
        ),
    ):
        estimates = [fitted[each] for each in names]
        if all(math.isnan(each.value) for each in estimates):
            continue
        own = 2.0 * robot.wheels[1].y if field == "wheels.effective_track" else getattr(robot, field)
        ends = [_ends(each, value, scale) for each, value in zip(estimates, np.atleast_1d(own).tolist(), strict=True)]
        low, high = zip(*ends, strict=True)
        alone = not isinstance(own, tuple)
        sources[field] = Interval(
            f"sources.{field}", own, low[0] if alone else low, high[0] if alone else high, METHOD, source
        )
    return dataclasses.replace(robot, name=name, title=_title(base), sources=sources), written, lines


def doubts(base: Robot, robot: Robot) -> list[str]:
    """Returns a line for each number of an identified robot that no such base is likely to have."""
    lines = [
        f"gain_{axis} is {gain:.3g}: are commands and odometry in m/s and rad/s?"
        for axis, gain in zip("vw", robot.gain or (1.0, 1.0), strict=True)
        if not 1.0 / USUAL["gain"] <= gain <= USUAL["gain"]
    ]
    lines += [
        f"delay_{axis} is {delay:.3g} s: are the stamps of commands and odometry of one clock?"
        for axis, delay in zip("vw", robot.delay or (0.0, 0.0), strict=True)
        if delay > USUAL_DELAY
    ]
    for what, unit, value, own in (
        ("track", "m", 2.0 * robot.wheels[1].y, 2.0 * base.wheels[1].y),
        ("top speed", "m/s", float(robot.max_twist[0]), float(base.max_twist[0])),
    ):
        if not 1.0 / USUAL[what] <= value / own <= USUAL[what]:
            lines.append(
                f"{what} is {value:.3g} {unit}, of {base.name} {own:.3g} {unit}: is the log in other units, are its "
                "axes swapped, or is --robot not a similar base?"
            )
    return lines


def _ends(each: Any, value: float, scale: float) -> tuple[float | None, float | None]:
    """Returns the ends of an estimate, in the unit of the sheet, which enclose the value; None where there is none."""
    low = min(each.low / scale, value) if math.isfinite(each.low) else None
    return low, max(each.high / scale, value) if math.isfinite(each.high) else None


def sheet_of(base: Robot, fitted: Fit, numbers: Floats) -> Robot:
    """Returns a base with the response that numbers of PAIR say; an axis without commands stays as it is."""
    own = numbers_of(base, fitted.saturation)
    for axis in commanded(fitted.drive):
        own[5 * axis : 5 * axis + 5] = numbers[5 * axis : 5 * axis + 5]
        if fitted.saturation == AXES:
            own[10 + axis] = numbers[10 + axis]
    changes: dict[str, Any] = {"response": "continuous", "acceleration": own[2], "yaw_acceleration": own[7]}
    for field, place in (("delay", 0), ("gain", 1), ("decelerations", 3), ("lag", 4)):
        changes[field] = float(own[place]), float(own[place + 5])
    half = base.wheels[1].y
    if fitted.saturation == AXES:
        least = _apart(fitted.drive, own)
        if least < half:  # its wheels would not do what the log shows where the sheet has them
            half, changes["saturation"] = max(least, 1e-3), "twist"
        changes["turn_speed"] = float(own[11])
    else:
        own[10:] = numbers[10:]
        half = float(own[11])
        changes |= {"saturation": SATURATIONS[fitted.saturation], "turn_speed": math.inf}
    rated = float(own[10]) / base.wheels[1].radius
    changes |= {"rated_wheel_speed": rated, "peak_wheel_speed": max(base.peak_wheel_speed, rated)}
    if half != base.wheels[1].y:
        changes |= _wide(base, half)
    return dataclasses.replace(base, **changes)


def _apart(drive: Drive, numbers: Floats) -> float:
    """Returns half of the widest track of wheels that can do all which a drive commands within the limits of axes."""
    v, w = (
        np.minimum(numbers[5 * axis + 1] * np.abs(drive.commands[:, axis]), numbers[10 + axis]) for axis in range(2)
    )
    turning = w > 0.05 * numbers[11]
    return float(np.quantile((numbers[10] - v[turning]) / w[turning], RARE)) if turning.any() else math.inf


def _wide(base: Robot, half: float) -> Mapping[str, Any]:
    """Returns the wheels of a base whose motion is that of another track; it stays as it is built."""
    right, left = base.wheels
    wheels = dataclasses.replace(right, y=-half), dataclasses.replace(left, y=half)
    return {"wheels": wheels, "track": left.y - right.y if base.track is None else base.track}


def _title(base: Robot) -> str:
    title = base.title or base.name
    return title if title.endswith(", identified") else f"{title}, identified"
