"""Checks of single values, with messages that name the field, the value and what would be right."""

import difflib
import math
import numbers
from collections.abc import Iterable
from typing import Any

FARTHEST = 1e9  # m; beyond it arc lengths in float64 lose the micrometre, and squares may overflow


def checked_number(field: str, value: Any, *, least: float = -math.inf, above: float = -math.inf) -> float:
    """Returns the value as a float.

    Args:
        field: what the message calls the value.
        value: the candidate; a bool or a numeral in a string is refused.
        least: smallest allowed value.
        above: the value must be larger than this.

    Raises:
        ValueError: if the value is no finite number or breaks a bound.
    """
    wanted = "a finite number"
    if least > -math.inf:
        wanted += f" of at least {least:g}"
    if above > -math.inf:
        wanted += f" above {above:g}"
    number = math.nan
    if not isinstance(value, bool) and isinstance(value, numbers.Real):
        try:
            number = float(value)
        except OverflowError:  # an integer of more than 308 digits
            number = math.inf
    if not (math.isfinite(number) and number >= least and number > above):
        raise ValueError(f"{field} is {shown(value)}; it must be {wanted}")
    return number


def checked_numbers(field: str, values: Any, count: int, meaning: str) -> tuple[float, ...]:
    """Returns `count` finite numbers as a tuple of floats.

    Args:
        field: what the message calls the values.
        values: the candidates, any sequence that is no string.
        count: how many there must be.
        meaning: what they are, for the message, such as "x, y, heading".

    Raises:
        ValueError: if there are more or fewer, or one is no finite number.
    """
    items = list(values) if isinstance(values, Iterable) and not isinstance(values, str | bytes | dict) else []
    if len(items) != count:
        raise ValueError(f"{field} is {shown(values)}; it must be {count} numbers ({meaning})")
    return tuple(checked_number(f"{field}[{i}]", item) for i, item in enumerate(items))


def suggestion(value: str, known: Iterable[str]) -> str:
    """Returns " Did you mean 'x'?" for the known word nearest to the value, or nothing when none is near."""
    near = difflib.get_close_matches(value.lower(), list(known), n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


def shown(value: Any) -> str:
    """Returns the value as one line of at most 60 characters."""
    try:
        text = repr(value)
    except ValueError:  # an integer too long to be written out
        text = f"a {type(value).__name__} too long to print"
    return text if len(text) <= 60 else text[:57] + "..."
