"""The data sheet of an identified base: what was seen, with its interval and where it is from; the rest as it was."""

import dataclasses
import math
from typing import Any

from wayfield.benchmarks.identify.estimate import Estimate, Fit
from wayfield.benchmarks.identify.response import AXES, SATURATIONS
from wayfield.envs.robots import Robot
from wayfield.envs.robots.intervals import Interval

METHOD = "profile likelihood, 95 %"
UNITY = 1e-3  # a gain within this of 1, or whose interval holds 1, is 1


def identified(base: Robot, found: Fit, name: str, source: str) -> tuple[Robot, list[str]]:
    """Returns a base as it was identified, and what of it the log did not say.

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
    kept: list[str] = []
    sources: dict[str, Any] = {field: each for field, each in base.sources.items() if not isinstance(each, Interval)}
    changes: dict[str, Any] = {"response": "continuous"}

    def seen(field: str, value: Any, low: Any, high: Any) -> None:
        if field != "wheels.effective_track":  # which is where the wheels stand
            changes[field] = value
        sources[field] = Interval(f"sources.{field}", value, low, high, METHOD, source)

    lags = base.lag if isinstance(base.lag, tuple) else (base.lag, base.lag)
    for field, kept_values in (("delay", base.delay or (0.0, 0.0)), ("gain", base.gain or (1.0, 1.0)), ("lag", lags)):
        pair = [
            _kept(found[f"{field}_{axis}"], each, field, kept) for axis, each in zip("vw", kept_values, strict=True)
        ]
        if any(low is not None for _, low, _ in pair):
            seen(field, *(tuple(each) for each in zip(*pair, strict=True)))
    slews = []
    for field, axis in (("acceleration", "v"), ("yaw_acceleration", "w")):
        each = found[f"acceleration_{axis}"]
        slews.append(each.value if each.seen else getattr(base, field))
        if each.seen:
            seen(field, each.value, each.low, each.high)
        else:
            kept.append(f"{field}: {each}; {getattr(base, field):g} of {base.name} is kept")
    if any(found.decelerating):
        ends = [
            found[f"deceleration_{axis}"] if found.decelerating[k] else found[f"acceleration_{axis}"]
            for k, axis in enumerate("vw")
        ]
        pair = [_kept(each, own, "decelerations", kept) for each, own in zip(ends, slews, strict=True)]
        seen("decelerations", *(tuple(each) for each in zip(*pair, strict=True)))
    elif base.decelerations:
        changes["decelerations"] = ()
    changes |= _limits(base, found, seen, kept)
    changes["peak_wheel_speed"] = max(base.peak_wheel_speed, changes.get("rated_wheel_speed", base.rated_wheel_speed))
    robot = dataclasses.replace(base, name=name, title=_title(base), sources=sources, **changes)
    return robot, kept


def _title(base: Robot) -> str:
    title = base.title or base.name
    return title if title.endswith(", identified") else f"{title}, identified"


def _kept(each: Estimate, own: float, field: str, kept: list[str]) -> tuple[float, float | None, float | None]:
    """Returns value and ends of one axis; the base's own value, without ends, where it was not seen."""
    if each.seen and field == "gain" and each.low - UNITY <= 1.0 <= each.high + UNITY:
        return 1.0, None, None
    if each.seen:
        return each.value, each.low, each.high
    kept.append(f"{each.name}: {each}; {own:g} {each.unit} is kept".replace("  ", " "))
    return own, None, None


def _limits(base: Robot, found: Fit, seen: Any, kept: list[str]) -> dict[str, Any]:
    """Returns the changes of a sheet that limits make, those with intervals by `seen`."""
    radius = base.wheels[0].radius
    half = base.wheels[1].y
    if found.saturation != AXES:
        wheel, track = found["wheel_speed"], found["track"]
        if wheel.seen:
            seen("rated_wheel_speed", *(each / radius for each in (wheel.value, wheel.low, wheel.high)))
        if not track.seen:
            kept.append(f"track: {track}; {2.0 * half:g} m is kept")
            if base.saturation != SATURATIONS[found.saturation]:  # which only turns at a limit tell apart
                kept.append(f"saturation: not observable; {base.saturation!r} of {base.name} is kept")
            return {"turn_speed": math.inf}
        changes = _wide(base, track.value)
        seen("wheels.effective_track", 2.0 * changes["wheels"][1].y, track.low, track.high)
        return {**changes, "saturation": SATURATIONS[found.saturation], "turn_speed": math.inf}
    changes = {}
    speed, turn = found["speed_v"], found["speed_w"]
    rated = base.rated_wheel_speed
    if speed.seen:
        rated = speed.value / radius
        seen("rated_wheel_speed", rated, speed.low / radius, speed.high / radius)
    elif speed.low > radius * rated:  # it has driven faster than its sheet says
        rated = changes["rated_wheel_speed"] = speed.low / radius
        kept.append(f"speed_v: {speed}, which is more than the {radius * base.rated_wheel_speed:g} m/s of {base.name}")
    else:
        kept.append(f"speed_v: {speed}; {radius * rated:g} m/s of {base.name} is kept")
    least = turn.value if turn.seen else max(turn.low, 0.0)
    if least > radius * rated / half:  # its wheels would not do that where the sheet has them
        half = radius * rated / (1.001 * least)
        changes |= _wide(base, 2.0 * half)
    if turn.seen:
        seen("turn_speed", turn.value, turn.low, turn.high)
    elif least > base.turn_speed:
        changes["turn_speed"] = math.inf
        kept.append(f"speed_w: {turn}, which is more than the {base.turn_speed:g} rad/s of {base.name}")
    else:
        kept.append(f"speed_w: {turn}; {min(base.turn_speed, radius * rated / half):.3g} rad/s is kept")
    return changes


def _wide(base: Robot, track: float) -> dict[str, Any]:
    """Returns the wheels of a base whose motion is that of another track; it stays as it is built."""
    right, left = base.wheels
    wheels = dataclasses.replace(right, y=-0.5 * track), dataclasses.replace(left, y=0.5 * track)
    return {"wheels": wheels, "track": left.y - right.y if base.track is None else base.track}
