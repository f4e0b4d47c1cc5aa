"""What a seed decides, to the same bits on every machine.

Only `random()` of Python's generator is promised to stay as it is, so every draw is made of it. Lengths and angles are
rounded to a millionth: a path or a field is then equal wherever it is made, and its hash with it.
"""

import math
import random
from collections.abc import Callable
from typing import TypeVar

from wayfield.system.elementary import sin_cos

_Drawn = TypeVar("_Drawn")


def rounded(value: float) -> float:
    """Returns the nearest whole number of millionths."""
    return round(value * 1e6) / 1e6


class Draw:
    """The random numbers of one scenario, in the order of the calls."""

    def __init__(self, family: str, seed: int) -> None:
        self._random = random.Random(f"{family} {seed}").random

    def number(self, low: float, high: float) -> float:
        """Returns a number between two bounds, rounded."""
        return rounded(low + (high - low) * self._random())

    def whole(self, low: int, high: int) -> int:
        """Returns a whole number from `low` to `high`, both included."""
        return low + int((high - low + 1) * self._random())

    def chances(self, share: float, count: int) -> list[bool]:
        """Returns of each of some draws whether it falls into a share (0 to 1) of all."""
        return [self._random() < share for _ in range(count)]

    def sign(self) -> float:
        """Returns 1 or -1."""
        return 1.0 if self._random() < 0.5 else -1.0

    def heading(self) -> float:
        """Returns an angle (rad) anywhere on the circle."""
        return self.number(-math.pi, math.pi)

    def until_one(self, make: Callable[[], _Drawn | None]) -> _Drawn:
        """Returns the first thing made that is not None: one drawn in vain."""
        while True:
            made = make()
            if made is not None:
                return made


class Frame:
    """A frame in the plane: where its origin lies, how it is turned, and whether left is right."""

    def __init__(self, x: float = 0.0, y: float = 0.0, heading: float = 0.0, mirrored: bool = False) -> None:
        self.x, self.y, self.heading = x, y, heading
        self.side = -1.0 if mirrored else 1.0
        self.sine, self.cosine = sin_cos.py_func(float(heading))  # for one at import nothing need be loaded

    def point(self, along: float, across: float) -> tuple[float, float]:
        """Returns the world's x, y (m), rounded, of a point of the frame."""
        across *= self.side
        return (
            rounded(self.x + self.cosine * along - self.sine * across),
            rounded(self.y + self.sine * along + self.cosine * across),
        )

    def turned(self, angle: float) -> float:
        """Returns the world's heading (rad), rounded, of a heading of the frame."""
        return rounded(self.heading + self.side * angle)
