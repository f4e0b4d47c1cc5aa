"""A gain of a policy, declared once: its default, unit, meaning and range, and where a search looks for a better one.

A policy is a frozen dataclass; its gains are fields that `gain` makes, and `Gains` checks them as one is made:

    @dataclasses.dataclass(frozen=True)
    class Law(Gains):
        max_speed: float = gain(0.6, "m/s", "at most", above=0.0, search=(0.3, 2.0))

`gains_of` returns the declarations.
"""

import dataclasses
import functools
import math
import operator
import typing
import warnings
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Self

import numpy as np

from wayfield.system.checks import (
    MOST_GAIN,
    MOST_WHOLE,
    WHOLE_TURN,
    choose,
    real,
    refuse,
    shown,
    suggestion,
    truth,
    whole,
)
from wayfield.system.objects import FileNote

_USUAL = {"m": 100.0, "s": 300.0, "rad": WHOLE_TURN, "m/s": 10.0, "rad/s": 40.0, "m/s^2": 60.0, "rad/s^2": 120.0}
_SIGNS = (
    *(("above", ">", operator.gt), ("least", ">=", operator.ge)),
    *(("below", "<", operator.lt), ("most", "<=", operator.le)),
)


class Range(NamedTuple):
    """Where a gain is searched."""

    low: float
    high: float
    log: bool = True  # whether evenly in its logarithm


class Gain(NamedTuple):
    """The declaration of a gain. A bound may be the name of another gain, for the value of that."""

    default: Any
    unit: str  # "1" of a pure number or a count, "" of what is no number
    meaning: str = ""
    above: float | str = -math.inf
    least: float | str = -math.inf
    below: float = math.inf
    most: float = math.inf  # whole numbers have MOST_WHOLE, where nothing is said
    finite: bool = True  # whether infinity is out of the range
    search: Range | None = None
    words: str = ""  # the range of what is no number
    kind: Any = float  # of its values: float, int, bool, a Literal, or another, whose range its owner checks

    @property
    def range(self) -> str:
        """Returns the range in words."""
        if self.kind is bool:
            return "true, false"
        if typing.get_origin(self.kind) is typing.Literal:
            return ", ".join(typing.get_args(self.kind))
        if self.kind is int:
            least, most = self._whole_ends()
            return f"{least} to {most if most < 10**9 else f'{most:.0e}'.replace('+', '')}"
        if self.kind in (float, float | None):
            return " and ".join(words for words, _, _ in self._ends({})) or "any number"
        return self.words

    def fits(self, value: float) -> bool:
        """Returns whether a number is in the range, as far as that does not depend on other gains."""
        return all(holds(value, end) for _, holds, end in self._ends({}) if end is not None)

    def check(self, owner: object, name: str) -> None:
        """Raises ValueError, naming the gain, its value and its range, unless the owner's value is in the range."""
        field, value = f"{type(owner).__name__}: {name}", getattr(owner, name)
        if self.kind is bool:
            truth(field, value)
        elif self.kind is int:
            whole(field, value, *self._whole_ends())
        elif typing.get_origin(self.kind) is typing.Literal:
            choose(field, value, typing.get_args(self.kind))
        elif self.kind is float or (self.kind == float | None and value is not None):
            self._check_number(field, value, vars(owner))

    def _check_number(self, field: str, value: Any, values: Mapping[str, Any]) -> None:
        result = real(value)
        if math.isinf(result) and not isinstance(value, float | np.floating):
            result = math.nan  # a whole number too large for a float is not infinity
        ends = self._ends(values)
        fits = math.isfinite(result) or (result > 0.0 and not self.finite)
        if not fits or not all(holds(result, end) for _, holds, end in ends):
            range_ = " and ".join(words for words, _, _ in ends)
            refuse(field, value, f"a {'finite ' if self.finite else ''}number {range_}".strip())
        if math.isfinite(result) and abs(result) > MOST_GAIN:
            refuse(field, value, f"at most {MOST_GAIN:g} in size")
        most = max(_USUAL.get(self.unit, math.inf), self.search.high if self.search else 0.0)
        if most < abs(result) < math.inf:
            warnings.warn(f"{field} is {result:g} {self.unit}, usual is at most {most:g}", FileNote, stacklevel=5)

    def _ends(self, values: Mapping[str, Any]) -> list[tuple[str, Callable[[float, Any], bool], Any]]:
        """Returns the ends of the range that there are: in words, what must hold, and the end.

        Args:
            values: of the policy's gains, by name, for ends that are one; {} where they are not known.
        """
        result: list[tuple[str, Callable[[float, Any], bool], Any]] = []
        for name, sign, holds in _SIGNS:
            end = getattr(self, name)
            if isinstance(end, str):
                value = values.get(end)
                result.append((f"{sign} {end}" + (f" = {value:g}" if end in values else ""), holds, value))
            elif math.isfinite(end):
                result.append((f"{sign} {end:g}", holds, end))
        return result

    def _whole_ends(self) -> tuple[int, int]:
        least = self.least if isinstance(self.least, int) else 0
        return least, int(self.most) if self.most < math.inf else MOST_WHOLE


def gain(
    default: Any,
    unit: str,
    meaning: str = "",
    *,
    search: tuple[float, float] | None = None,
    linear: bool = False,
    **bounds: Any,
) -> Any:
    """Returns a field of a dataclass that is a gain.

    Args:
        default: its value.
        unit: of SI, "1" of a pure number or a count, "" of what is no number.
        meaning: in some words; none where the law's equation says it.
        search: low and high end of where a search looks for it; evenly in its logarithm if both are above 0.
        linear: whether evenly in itself even so.
        bounds: above, least, below, most, finite and words, see `Gain`.
    """
    where = None if search is None else Range(*search, log=search[0] > 0.0 and not linear)
    return dataclasses.field(default=default, metadata={"gain": Gain(default, unit, meaning, search=where, **bounds)})


@functools.cache
def _declared(kind: Any) -> Mapping[str, Gain]:
    fields = [each for each in dataclasses.fields(kind) if "gain" in each.metadata]
    return {each.name: each.metadata["gain"]._replace(kind=each.type) for each in fields}


def gains_of(policy: Any) -> dict[str, Gain]:
    """Returns the declared gains of a policy, with its own values as the defaults, or of a policy's class."""
    if not dataclasses.is_dataclass(policy):
        raise TypeError(f"gains_of takes a policy or its class, such as make('pure_pursuit'), not {shown(policy)}")
    if isinstance(policy, type):
        return dict(_declared(policy))
    return {name: each._replace(default=getattr(policy, name)) for name, each in _declared(type(policy)).items()}


class Gains:
    """A dataclass whose gains are checked as it is made; ValueError names the gain, its value and its range."""

    def __new__(cls, *values: Any, **named: Any) -> Self:
        """Returns one to be filled; TypeError names the gain that is nearest to one that there is not."""
        known = [each.name for each in dataclasses.fields(cls)]  # type: ignore[arg-type]
        for name in named:
            if name not in known:
                there = f"Choose from {', '.join(known)}." if known else "It has none."
                raise TypeError(f"{cls.__name__} has no gain {name!r}.{suggestion(name, known)} {there}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for name, each in _declared(type(self)).items():  # type: ignore[arg-type]
            each.check(self, name)
