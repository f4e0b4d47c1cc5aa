"""How well the numbers of an identified robot are known, and robots drawn from that."""

import dataclasses
import math
import statistics
from typing import TYPE_CHECKING, Any

import numpy as np

from wayfield.system.checks import real, shown

if TYPE_CHECKING:
    from wayfield.envs.robots.robot import Robot

# Fields of a data sheet that an identification finds, with the range of each number; the order in which they are drawn.
IDENTIFIED = (
    *("delay", "gain", "lag", "acceleration", "yaw_acceleration", "decelerations"),
    *("rated_wheel_speed", "turn_speed", "wheels.effective_track"),
)
_SHARE = 0.95  # of what the ends of an interval enclose

Ends = float | None | tuple[float | None, ...]


@dataclasses.dataclass(frozen=True)
class Interval:
    """The 95 % interval of an identified field: numbers, or lists with one for each axis as the field has them.

    Raises:
        ValueError: in one line, naming the place, if the ends do not enclose the value.
    """

    place: str  # what messages call it, such as sources.delay
    value: Any
    low: Any  # None: no end was found
    high: Any
    method: str  # how it was found, such as "profile likelihood, 95 %"
    source: str = ""  # what it was found from

    def __post_init__(self) -> None:
        for name in ("value", "low", "high"):
            given = getattr(self, name)
            object.__setattr__(self, name, tuple(given) if isinstance(given, list | tuple) else given)
        sizes = {len(each) if isinstance(each, tuple) else 0 for each in (self.value, self.low, self.high)}
        if len(sizes) > 1:
            raise ValueError(f"{self.place} has value, low and high of different lengths; they must have one length")
        for value, low, high in self.components:
            if not math.isfinite(real(value)):
                raise ValueError(f"{self.place}.value is {shown(self.value)}; it must be numbers")
            for name, end, right in (("low", low, real(low) <= value), ("high", high, value <= real(high))):
                if end is not None and not right:
                    side = "most" if name == "low" else "least"
                    raise ValueError(f"{self.place}.{name} is {shown(end)}; it must be at {side} the value, {value:g}")
        for name in ("method", "source"):
            if not isinstance(getattr(self, name), str):
                raise ValueError(f"{self.place}.{name} is {shown(getattr(self, name))}; it must be a text")

    @property
    def components(self) -> tuple[tuple[float, float | None, float | None], ...]:
        """Returns value, low and high of each number of the field."""
        if not isinstance(self.value, tuple):
            return ((self.value, self.low, self.high),)
        return tuple(zip(self.value, self.low, self.high, strict=True))

    @property
    def content(self) -> dict[str, Any]:
        """Returns the object of a data sheet's `sources`."""
        listed = {name: list(each) if isinstance(each := getattr(self, name), tuple) else each for name in _NUMBERS}
        return listed | {"method": self.method} | ({"from": self.source} if self.source else {})

    def __str__(self) -> str:
        """Returns the interval in words, for tables and pages."""
        ends = (f"{_worded(low)} to {_worded(high)}" for _, low, high in self.components)
        return f"{', '.join(ends)} ({self.method})" + (f": {self.source}" if self.source else "")


_NUMBERS = ("value", "low", "high")


def _worded(end: float | None) -> str:
    return "?" if end is None else f"{end:.4g}"


def drawn(robot: "Robot", generator: np.random.Generator) -> "Robot":
    """Returns a robot as it may be by the intervals of its sheet; one without any comes back as it is.

    Each number is drawn by itself, from a normal distribution on either side of the value of which the interval holds
    95 %, cut where it ends; where an end is missing it stays at the value on that side. Numbers found together
    mostly err against each other (delay and lag), so that their sums are spread wider here than they are known.
    """
    normal = statistics.NormalDist()
    quantile = (1.0 + _SHARE) / 2.0
    widest = normal.inv_cdf(quantile)
    changes: dict[str, Any] = {}
    for name in IDENTIFIED:
        interval = robot.sources.get(name)
        if not isinstance(interval, Interval):
            continue
        numbers = []
        for value, low, high in interval.components:
            z = normal.inv_cdf(1.0 - quantile + _SHARE * generator.random()) / widest
            end = high if z > 0.0 else low
            numbers.append(value if end is None else value + abs(z) * (end - value))
        changes[name] = tuple(numbers) if isinstance(interval.value, tuple) else numbers[0]
    track = changes.pop("wheels.effective_track", None)
    if track is not None:
        right, left = robot.wheels
        changes["wheels"] = (
            dataclasses.replace(right, y=-0.5 * track),
            dataclasses.replace(left, y=0.5 * track),
        )
        changes["track"] = left.y - right.y if robot.track is None else robot.track
    if "rated_wheel_speed" in changes:
        changes["peak_wheel_speed"] = max(robot.peak_wheel_speed, changes["rated_wheel_speed"])
    rest = {name: source for name, source in robot.sources.items() if not isinstance(source, Interval)}
    return dataclasses.replace(robot, **changes, sources=rest) if changes else robot
