"""What a function of `sim` takes: its arguments are checked before it runs, so that no input can make it fail.

A function is offered with the kinds of its arguments; what comes over the wire is looked up by name in `FUNCTIONS` and
nowhere else.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from wayfield.envs.coppelia.codec import one_line
from wayfield.envs.coppelia.constants import (
    HANDLE_APP,
    HANDLE_MASK,
    HANDLE_PARENT,
    HANDLE_SCENE,
    HANDLE_WORLD,
    JOINT,
    JOINT_BASE_FLAG,
    MAX_HANDLE,
    PROXIMITY_SENSOR,
    SHAPE,
    WXYZ_FLAG,
)

if TYPE_CHECKING:
    from wayfield.envs.coppelia.scene import Object
    from wayfield.envs.coppelia.server import Caller

FARTHEST = 1e6  # m, of a coordinate
NO_OBJECT = "object does not exist."
WRONG_TYPE = "one of the function's argument type is not correct."
MORE_ARGUMENTS = "the function requires more arguments."
TABLE_SIZE = "incorrect table size."
NIL = "_*NIL*_"


class CallError(Exception):
    """A call that is refused: a sentence of CoppeliaSim's, and in brackets what would be right."""

    def __init__(self, sentence: str, hint: str = "") -> None:
        super().__init__(f"{sentence} ({one_line(hint)})" if hint else sentence)


class Wrong(ValueError):
    """A value that is not of the kind that it should be."""


class Null:
    """What a function returns that has a result, and it is null."""


NULL = Null()

Kind = Callable[["Caller", Any], Any]


@dataclasses.dataclass(eq=False)
class Wait:
    """What a function returns whose results come later: when `done` returns them."""

    done: Callable[[], list[Any] | None]
    steps: bool = False  # whether it wants passes until then
    until: float = math.inf  # s, on the monotonic clock, when `done` is to be asked again


@dataclasses.dataclass(eq=False)
class Callback:
    """What a function returns whose result is that of a function of the client's."""

    function: str
    args: list[Any]


class Optional(NamedTuple):
    """An argument that may be left out or null, and then is `default`."""

    kind: Kind
    default: Any = None


class Function(NamedTuple):
    """An offered function: what runs, and the kinds of its arguments."""

    run: Callable[..., Any]
    kinds: tuple[Kind | Optional, ...]

    def __call__(self, caller: "Caller", values: list[Any]) -> Any:
        """Returns what the function returns.

        Raises:
            CallError: if an argument is missing or wrong. Surplus ones are ignored, as in CoppeliaSim.
        """
        arguments = []
        for i, kind in enumerate(self.kinds):
            value = values[i] if i < len(values) else None
            if type(value) is str and value == NIL:
                value = None
            if isinstance(kind, Optional):
                arguments.append(kind.default if value is None else self._checked(kind.kind, caller, value, i))
            elif i >= len(values):
                raise CallError(MORE_ARGUMENTS, f"argument {i + 1}, {described(kind)}, is missing")
            else:
                arguments.append(self._checked(kind, caller, value, i))
        try:
            return self.run(caller, *arguments)
        except Wrong as error:  # in a value that is looked into later
            raise CallError(WRONG_TYPE, str(error)) from None

    @staticmethod
    def _checked(kind: Kind, caller: "Caller", value: Any, i: int) -> Any:
        try:
            return kind(caller, value)
        except Wrong as error:
            raise CallError(WRONG_TYPE, f"argument {i + 1} must be {described(kind)}; {error}") from None


FUNCTIONS: dict[str, Function] = {}
NOT_OFFERED: dict[str, str] = {}  # name and reason


def offered(*kinds: Kind | Optional, name: str = "") -> Callable[[Any], Any]:
    """Offers a function to clients: by its name in camel case, or by another name.

    What it returns: None is no result, a tuple several, NULL one that is null, all else one.
    """

    def register(run: Any) -> Any:
        first, *rest = run.__name__.split("_")
        FUNCTIONS[f"sim.{name or first + ''.join(map(str.capitalize, rest))}"] = Function(run, kinds)
        return run

    return register


def described(kind: Kind) -> str:
    """Returns what a kind of argument is, in words."""
    return (kind.__doc__ or "").split(".")[0].removeprefix("Returns ")


def shown(value: Any) -> str:
    """Returns a value in a few words, for messages."""
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, list | dict):
        return f"an array of {len(value)}" if isinstance(value, list) else f"a map of {len(value)}"
    return repr(value)[:60]


def anything(caller: "Caller", value: Any) -> Any:
    """Returns any value."""
    return value


def number(caller: "Caller", value: Any) -> float:
    """Returns a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Wrong(f"got {shown(value)}")
    if not -1e300 < value < 1e300:
        raise Wrong("it is too large")
    return float(value)


def integer(caller: "Caller", value: Any) -> int:
    """Returns a whole number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or value != math.floor(value):
        raise Wrong(f"got {shown(value)}")
    if not -(2**63) <= value < 2**63:
        raise Wrong("it is too large")
    return int(value)


def truth(caller: "Caller", value: Any) -> bool:
    """Returns true or false."""
    # older scripts pass 0 and 1
    if isinstance(value, bool) or (isinstance(value, int | float) and value in (0, 1)):
        return bool(value)
    raise Wrong(f"got {shown(value)}")


def text(caller: "Caller", value: Any) -> str:
    """Returns a text."""
    if isinstance(value, bytes):
        try:
            return value.decode("utf-8")
        except UnicodeDecodeError:
            raise Wrong("its bytes are no UTF-8") from None
    if not isinstance(value, str):
        raise Wrong(f"got {shown(value)}")
    return value


def name(caller: "Caller", value: Any) -> str:
    """Returns a name of 1 to 256 characters."""
    value = text(caller, value)
    if not 0 < len(value) <= 256:
        raise Wrong(f"it has {len(value)} characters")
    return str(value)


def blob(caller: "Caller", value: Any) -> bytes:
    """Returns bytes or a text."""
    if isinstance(value, str):
        return value.encode("utf-8")
    if not isinstance(value, bytes):
        raise Wrong(f"got {shown(value)}")
    return value


def options(caller: "Caller", value: Any) -> dict[str, Any]:
    """Returns a map of options."""
    if isinstance(value, list) and not value:  # an empty table is either
        return {}
    if not isinstance(value, dict):
        raise Wrong(f"got {shown(value)}")
    return value


def array(caller: "Caller", value: Any) -> list[Any]:
    """Returns an array."""
    if not isinstance(value, list):
        raise Wrong(f"got {shown(value)}")
    return value


def numbers(caller: "Caller", value: Any) -> list[float]:
    """Returns an array of numbers."""
    return [number(caller, each) for each in array(caller, value)]


def exactly(count: int, most: float = 1e300) -> Kind:
    """Returns the kind of arrays of `count` numbers, none beyond `most`."""

    def kind(caller: "Caller", value: Any) -> list[float]:
        values = numbers(caller, value)
        if len(values) < count:
            raise CallError(TABLE_SIZE, f"{count} numbers are needed, got {len(values)}")
        for each in values[:count]:
            if abs(each) > most:
                raise Wrong(f"{each:g} is beyond {most:g}")
        return values[:count]

    kind.__doc__ = f"Returns an array of {count} numbers."
    return kind


position = exactly(3, FARTHEST)
angles = exactly(3, 1e9)
quaternion = exactly(4, 1e9)
pose = exactly(7, FARTHEST)
matrix = exactly(12, FARTHEST)


def _node(caller: "Caller", value: Any) -> "Object":
    handle = integer(caller, value)
    found = caller.world.scene.objects.get(handle & HANDLE_MASK) if 0 <= handle < MAX_HANDLE else None
    if found is None:
        raise CallError(NO_OBJECT, f"no object has the handle {handle}")
    return found


def node(caller: "Caller", value: Any) -> "Object":
    """Returns the handle of an object."""
    return _node(caller, value)


def flagged(caller: "Caller", value: Any) -> "tuple[Object, bool]":
    """Returns the handle of an object, with or without the flag for quaternions with w first."""
    return _node(caller, value), bool(integer(caller, value) & WXYZ_FLAG)


def joint(caller: "Caller", value: Any) -> "Object":
    """Returns the handle of a joint."""
    found = _node(caller, value)
    if found.kind != JOINT:
        raise CallError("object is not a joint.", f"{found.alias} has the handle {found.handle}")
    return found


def wheel(caller: "Caller", value: Any) -> "Object":
    """Returns the handle of a wheel's joint."""
    found = joint(caller, value)
    if found.wheel < 0:
        raise CallError("joint is not driven.", f"{found.alias} turns freely; the wheels' joints are driven")
    return found


def sensor(caller: "Caller", value: Any) -> "Object":
    """Returns the handle of a proximity sensor."""
    found = _node(caller, value)
    if found.kind != PROXIMITY_SENSOR:
        raise CallError("object is not a proximity sensor.", f"{found.alias} has the handle {found.handle}")
    return found


def shape(caller: "Caller", value: Any) -> "Object":
    """Returns the handle of a shape."""
    found = _node(caller, value)
    if found.kind != SHAPE:
        raise CallError("object is not a shape.", f"{found.alias} has the handle {found.handle}")
    return found


WORLD = ("world", None, False)


def relative(caller: "Caller", value: Any) -> "tuple[str, Object | None, bool]":
    """Returns the handle of an object, sim.handle_world or sim.handle_parent."""
    handle = integer(caller, value)
    if handle == HANDLE_WORLD:
        return WORLD
    if handle == HANDLE_PARENT:
        return "parent", None, False
    return "object", _node(caller, value), bool(handle & JOINT_BASE_FLAG)


def parent(caller: "Caller", value: Any) -> "Object | None":
    """Returns the handle of an object, or -1 for none."""
    return None if integer(caller, value) == HANDLE_WORLD else _node(caller, value)


def target(caller: "Caller", value: Any) -> "Object | int":
    """Returns the handle of an object, sim.handle_scene or sim.handle_app."""
    handle = integer(caller, value)
    if handle in (HANDLE_SCENE, HANDLE_APP):
        return handle
    found = caller.world.scene.objects.get(handle & HANDLE_MASK) if 0 <= handle < MAX_HANDLE else None
    if found is None:
        raise CallError("target does not exist.", f"no object has the handle {handle}")
    return found
