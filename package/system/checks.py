"""Checks of single values as they come in, from arguments and from files: one vocabulary, every number with bounds.

What passes here cannot make a compiled loop run without end, an index leave its array, or an array take more memory
than the machine has. A refused value is one line that names the field, the value and what would be right.
"""

import difflib
import math
import numbers
import os
import re
from collections.abc import Hashable, Iterable, Iterator
from typing import Any, NoReturn

import numpy as np

from wayfield.system.elementary import wrap_angle

FARTHEST = 1e6  # m, of any position from the origin, and of any length
FINEST = 1e-9  # m, the least size of what has one
THINNEST = 5e-3  # m, of what can be pushed
SHORTEST = 1e-3  # m and s: the least path, range and time between two turns of a patrol
FARTHEST_SHOVE = 100.0  # m; a sweep goes in strides of 0.2 mm where it runs along a wall
LONGEST = 1e6  # s, of any time
FASTEST = 1e3  # m/s, of a patrol
WHOLE_TURN = 2.0 * math.pi  # rad
MOST_TURN = 1e6  # rad, of an angle that is still one: the rounding of the number itself is then 1e-10 rad
HEAVIEST = 1e6  # kg
LIGHTEST = 1e-3  # kg, of what can be pushed
MOST_NOISE = 1e3  # times the nominal sensors'
MOST_GAIN = 1e9  # of a controller
MOST_WHOLE = 10_000  # of a whole number that sizes memory or loops, unless it is stated
MOST_LAPS = 1_000_000
MOST_POINTS = 1_000_000  # of a path
MOST_OBSTACLES = 100_000
MOST_STEPS = 10**9  # of an episode
MOST_ENVS = 1_000_000
MOST_THREADS = 1024
MOST_BYTES = 2**28  # of a file
LAST_SEED = 2**63 - 1  # of a policy or a scenario
_PRINTED = 100  # characters of a value that are written out, of which 60 are shown
LAST_OF_EPISODES = 2**128 - 1  # as many as NumPy draws where a reset is given none; wrappers draw 64 bits


def number(
    field: str, value: Any, *, least: float = -math.inf, above: float = -math.inf, most: float = FARTHEST
) -> float:
    """Returns the value as a float.

    Args:
        field: what the message calls the value.
        value: the candidate; a bool or a numeral in a string is refused.
        least: smallest allowed value; -math.inf for -most.
        above: the value must be larger than this.
        most: largest allowed value.

    Raises:
        ValueError: if the value is no finite number or breaks a bound.
    """
    numeral = real(value)
    low = -most if least == above == -math.inf else least
    if not (math.isfinite(numeral) and low <= numeral <= most and numeral > above):
        wanted = "a finite number"
        if least > -math.inf:
            wanted += f" of at least {least:g}"
        if above > -math.inf:
            wanted += f" above {above:g}"
        if abs(numeral) > most:
            wanted += f"{', ' if wanted[-1].isdigit() else ' of '}at most {most:g} in size"
        raise ValueError(f"{field} is {shown(value)}; it must be {wanted}")
    return numeral


def numbers_of(field: str, values: Any, count: int, meaning: str, most: float = FARTHEST) -> tuple[float, ...]:
    """Returns `count` finite numbers, at most `most` in size, as a tuple of floats.

    Args:
        field: what the message calls the values.
        values: the candidates, any sequence that is no string.
        count: how many there must be.
        meaning: what they are, for the message, such as "x, y, heading".

    Raises:
        ValueError: if there are more or fewer, or one is no such number.
    """
    listed = isinstance(values, Iterable) and hasattr(values, "__len__") and not isinstance(values, str | bytes | dict)
    if not listed or len(values) != count:
        raise ValueError(f"{field} is {shown(values)}; it must be {count} numbers ({meaning})")
    return tuple(number(f"{field}[{i}]", item, most=most) for i, item in enumerate(values))


def pose(field: str, values: Any) -> tuple[float, float, float]:
    """Returns (x, y, heading), m and rad; ValueError as `numbers_of` and `heading`."""
    x, y, angle = numbers_of(field, values, 3, "x, y, heading")
    return x, y, heading(f"{field}[2]", angle)


def heading(field: str, value: Any) -> float:
    """Returns an angle (rad) within a turn that points the same way; ValueError beyond MOST_TURN, where none does.

    One within a turn stays as it is given: the frozen splits are known by the very numbers of their starts.
    """
    angle = number(field, value, most=MOST_TURN)
    return angle if abs(angle) <= WHOLE_TURN else float(wrap_angle(angle))


def positive(field: str, value: Any, most: float = FARTHEST, least: float = 0.0) -> None:
    """Raises ValueError, naming the field, unless the value is a finite number above 0, in [least, most]."""
    numeral = real(value)
    if not 0.0 < numeral < math.inf:
        refuse(field, value, "a finite number > 0")
    if not least <= numeral <= most:
        refuse(field, value, f"a number from {least:g} to {most:g}")


def whole(field: str, value: Any, least: int, most: int = MOST_WHOLE) -> None:
    """Raises ValueError, naming the field, unless the value is a whole number from `least` to `most`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        refuse(field, value, f"a whole number >= {least}")
    if value > most:
        refuse(field, value, f"a whole number from {least} to {most}")


def truth(field: str, value: Any) -> None:
    """Raises ValueError, naming the field, unless the value is True or False."""
    if not isinstance(value, bool | np.bool_):
        refuse(field, value, "True or False")


def choose(field: str, value: Any, choices: Iterable[str]) -> None:
    """Raises ValueError, naming the field and the nearest choice, unless the value is one of the choices."""
    choices = tuple(choices)
    if isinstance(value, str) and value in choices:
        return
    raise ValueError(
        f"{field}={shown(value)} is unknown.{suggestion(value, choices)} Choose from {', '.join(map(repr, choices))}."
    )


def seed(field: str, value: Any) -> None:
    """Raises TypeError unless a seed is a whole number or None, ValueError unless it is in [0, LAST_OF_EPISODES]."""
    if value is None:
        return
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{field} must be a whole number or None, got {shown(value)}")
    if not 0 <= int(value) <= LAST_OF_EPISODES:
        refuse(field, value, "a whole number from 0 to 2^128 - 1")


def memory(what: str, size: int) -> None:
    """Raises ValueError, naming the request, if that many bytes are more than this machine has."""
    if size > (most := machine_memory()):
        raise ValueError(f"{what} would take {size / 2**30:.3g} GiB of memory; this machine has {most / 2**30:.3g} GiB")


def machine_memory() -> int:
    """Returns the bytes of memory of this machine; 64 GiB where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return 2**36


def real(value: Any) -> float:
    """Returns a real number as a float, NaN for anything else: bools, strings, arrays."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # an integer of more than 308 digits
        return math.inf if value > 0 else -math.inf  # type: ignore[operator]


def refuse(field: str, value: Any, wanted: str) -> NoReturn:
    """Raises the ValueError of a value that is not what is wanted."""
    raise ValueError(f"{field} must be {wanted}, got {shown(value)}")


def suggestion(value: Any, known: Iterable[str]) -> str:
    """Returns " Did you mean 'x'?" for the known word nearest to the value, or nothing when none is near.

    Near is what is spelt alike, has the value's words among its own, begins with it, or is abbreviated by it:
    learning_rate by lr.
    """
    word = str(value)[:100].lower() if value is None or isinstance(value, str) else ""
    names = [each for each in known if word and isinstance(each, str) and each]
    alike = {name.lower(): name for name in reversed(names)}  # the first of those that differ in case
    parts = set(re.findall(r"[^\W_]+", word))
    near = [alike[each] for each in difflib.get_close_matches(word, alike, n=1)]
    near += [name for name in names if parts and parts <= set(re.findall(r"[^\W_]+", name.lower()))]
    near += [name for name in names if len(word) > 2 and name.lower().startswith(word)]
    near += [name for name in names if len(word) > 1 and word == "".join(re.findall(r"(?:\b|_)([^\W_])", name.lower()))]
    return f" Did you mean {near[0]!r}?" if near else ""


def printable(text: str) -> str:
    """Returns a line of text with what does not print escaped: a terminal obeys control characters of a name."""
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


def shown(value: Any) -> str:
    """Returns the value as one line of at most 60 characters; of a large one no more than that is written out."""
    if isinstance(value, str):
        text = repr(value[:_PRINTED])
    else:
        text = ""
        for piece in _printed(value):
            text += piece
            if len(text) > _PRINTED:  # spaces that follow each other become one
                break
        text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def _printed(value: Any) -> Iterator[str]:
    """Yields the repr of a value in pieces; those of lists, tuples and objects one element after the other."""
    kinds: dict[type, str] = {list: "[]", tuple: "()", dict: "{}"}
    if (brackets := kinds.get(type(value))) is None:
        try:
            yield repr(value[:_PRINTED] if isinstance(value, str | bytes) else value)
        except (ValueError, RecursionError):  # an integer too long to be written out
            yield f"a {type(value).__name__} too long to print"
        return
    yield brackets[0]
    for k, each in enumerate(value):
        yield ", " if k else ""
        yield from _printed(each)
        if type(value) is dict:
            yield ": "
            yield from _printed(value[each])
    yield f",{brackets[1]}" if type(value) is tuple and len(value) == 1 else brackets[1]


def unread(file: str | os.PathLike[str], error: OSError) -> str:
    """Returns why a file could not be read, with its whole path."""
    path = os.path.abspath(file)
    return f"there is no file {path}" if isinstance(error, FileNotFoundError) else f"{error.strerror or error} ({path})"


def repeated(names: Iterable[Hashable]) -> Any:
    """Returns the first name that occurs a second time; None where each occurs once."""
    seen = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None
