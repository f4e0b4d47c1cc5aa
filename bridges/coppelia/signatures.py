"""Offered functions of `sim`: their arguments are checked by their type hints before they run.

Names from the network are looked up in `FUNCTIONS` and nowhere else. No argument can make a function fail with anything
but a `CallError`.
"""

import dataclasses
import inspect
import math
import typing
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar

from wayfield.bridges.coppelia.codec import one_line
from wayfield.bridges.coppelia.constants import (
    HANDLE_APP,
    HANDLE_MASK,
    HANDLE_SCENE,
    JOINT,
    MAX_HANDLE,
    PROXIMITY_SENSOR,
    SHAPE,
    WXYZ_FLAG,
)
from wayfield.bridges.coppelia.scene import KINDS, Object

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Caller

FARTHEST = 1e6  # m, of a coordinate
WRONG_TYPE = "one of the function's argument type is not correct."
TABLE_SIZE = "incorrect table size."
_NIL = "_*NIL*_"  # null, in the words of the protocol


class CallError(Exception):
    """A refused call: a sentence of CoppeliaSim, and in brackets the right input."""

    def __init__(self, sentence: str, hint: str = "") -> None:
        super().__init__(f"{sentence} ({one_line(hint)})" if hint else sentence)


class Wrong(ValueError):
    """A value of the wrong kind."""


class Null:
    """The type of `NULL`, a result that is null; None is no result."""


NULL = Null()
NO_OPTIONS: Mapping[str, Any] = MappingProxyType({})


@dataclasses.dataclass(eq=False)
class Wait:
    """A deferred result: `done` returns None until the results are there."""

    done: Callable[[], list[Any] | None]
    steps: bool = False  # whether it requests passes until then
    until: float = math.inf  # s, on the monotonic clock, of the next call of `done`


@dataclasses.dataclass(eq=False)
class Callback:
    """A result that a function of the client computes."""

    function: str
    args: list[Any]


# Kinds of arguments: each returns the checked value, or raises Wrong or CallError. Docstrings complete "must be ...".

Kind = Callable[["Caller", Any], Any]


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


def options(caller: "Caller", value: Any) -> Mapping[str, Any]:
    """Returns a map of options."""
    if isinstance(value, list) and not value:  # an empty table of Lua is either
        return NO_OPTIONS
    if not isinstance(value, dict):
        raise Wrong(f"got {shown(value)}")
    return value


def array(caller: "Caller", value: Any) -> list[Any]:
    """Returns an array."""
    if not isinstance(value, list):
        raise Wrong(f"got {shown(value)}")
    return value


def table(caller: "Caller", value: Any) -> Any:
    """Returns an array or a map."""
    if not isinstance(value, list | dict):
        raise Wrong(f"got {shown(value)}")
    return value


def numbers(caller: "Caller", value: Any) -> list[float]:
    """Returns an array of numbers."""
    return [number(caller, each) for each in array(caller, value)]


def exactly(count: int) -> Kind:
    """Returns the kind of arrays of `count` numbers within `FARTHEST`; surplus numbers are ignored."""

    def kind(caller: "Caller", value: Any) -> list[float]:
        values = numbers(caller, value)[:count]
        if len(values) < count:
            raise CallError(TABLE_SIZE, f"{count} numbers are needed, got {len(values)}")
        for each in values:
            if abs(each) > FARTHEST:
                raise Wrong(f"{each:g} is beyond {FARTHEST:g}")
        return values

    kind.__doc__ = f"Returns an array of {count} numbers."
    return kind


def node(caller: "Caller", value: Any, sentence: str = "object does not exist.") -> Object:
    """Returns the handle of an object."""
    handle = integer(caller, value)
    obj = caller.world.scene.objects.get(handle & HANDLE_MASK) if 0 <= handle < MAX_HANDLE else None
    if obj is None:
        raise CallError(sentence, f"no object has the handle {handle}")
    return obj


def flagged(caller: "Caller", value: Any) -> tuple[Object, bool]:
    """Returns the handle of an object, with or without the flag for quaternions with w first."""
    return node(caller, value), bool(integer(caller, value) & WXYZ_FLAG)


def _node_of(kind: int) -> Kind:
    """Returns the kind of handles of joints, proximity sensors or shapes."""

    def checked(caller: "Caller", value: Any) -> Object:
        obj = node(caller, value)
        if obj.kind != kind:
            raise CallError(f"object is not a {KINDS[kind]}.", f"{obj.alias} has the handle {obj.handle}")
        return obj

    checked.__doc__ = f"Returns the handle of a {KINDS[kind]}."
    return checked


joint, sensor, shape = _node_of(JOINT), _node_of(PROXIMITY_SENSOR), _node_of(SHAPE)


def wheel(caller: "Caller", value: Any) -> Object:
    """Returns the handle of a wheel's joint."""
    obj: Object = joint(caller, value)
    if obj.wheel < 0:
        raise CallError("joint is not driven.", f"{obj.alias} turns freely; the wheels' joints are driven")
    return obj


def target(caller: "Caller", value: Any) -> Object | int:
    """Returns the handle of an object, sim.handle_scene or sim.handle_app."""
    handle = integer(caller, value)
    return handle if handle in (HANDLE_SCENE, HANDLE_APP) else node(caller, value, "target does not exist.")


Name = Annotated[str, name]
Options = Annotated[Mapping[str, Any], options]
Flagged = Annotated[tuple[Object, bool], flagged]
Joint = Annotated[Object, joint]
Wheel = Annotated[Object, wheel]
Sensor = Annotated[Object, sensor]
Shape = Annotated[Object, shape]
Target = Annotated[Object | int, target]
Vector = Annotated[list[float], exactly(3)]
Matrix = Annotated[list[float], exactly(12)]
Table = Annotated[Any, table]

_KIND_OF_HINT: dict[Any, Kind] = {
    Any: anything,
    float: number,
    int: integer,
    bool: truth,
    str: text,
    bytes: blob,
    list[Any]: array,
    list[float]: numbers,
    Object: node,
}


def _kind_of(hint: Any) -> Kind:
    if type(None) in typing.get_args(hint):  # X | None
        (hint,) = (each for each in typing.get_args(hint) if each is not type(None))
    return hint.__metadata__[0] if typing.get_origin(hint) is Annotated else _KIND_OF_HINT[hint]


class Argument(NamedTuple):
    """An argument of an offered function."""

    kind: Kind
    default: Any  # of one that is left out or null; inspect.Parameter.empty: it is required

    def checked(self, caller: "Caller", values: list[Any], i: int) -> Any:
        """Returns the value of the argument, the i-th of `values`."""
        value = values[i] if i < len(values) else None
        if type(value) is str and value == _NIL:
            value = None
        words = (self.kind.__doc__ or "").split(".")[0].removeprefix("Returns ")
        if self.default is not inspect.Parameter.empty:
            if value is None:
                return self.default
        elif i >= len(values):
            raise CallError("the function requires more arguments.", f"argument {i + 1}, {words}, is missing")
        try:
            return self.kind(caller, value)
        except Wrong as error:
            raise CallError(WRONG_TYPE, f"argument {i + 1} must be {words}; {error}") from None


class Function(NamedTuple):
    """An offered function and its arguments."""

    run: Callable[..., Any]
    arguments: tuple[Argument, ...]

    def __call__(self, caller: "Caller", values: list[Any]) -> Any:
        """Returns the result of the function. Surplus arguments are ignored, as in CoppeliaSim.

        Raises:
            CallError: if an argument is missing or wrong.
        """
        arguments = [argument.checked(caller, values, i) for i, argument in enumerate(self.arguments)]
        try:
            return self.run(caller, *arguments)
        except Wrong as error:  # in a value that is checked later
            raise CallError(WRONG_TYPE, str(error)) from None


FUNCTIONS: dict[str, Function] = {}
F = TypeVar("F", bound=Callable[..., Any])


def offered(*names: str, **hints: Any) -> Callable[[F], F]:
    """Offers a function under its name in camel case, or under other names; `hints` replace type hints.

    The result None is no result, a tuple several, `NULL` a null, all else one.
    """

    def register(run: F) -> F:
        first, *rest = run.__name__.split("_")
        _, *parameters = inspect.signature(run).parameters.values()
        arguments = (Argument(_kind_of(hints.get(each.name, each.annotation)), each.default) for each in parameters)
        function = Function(run, tuple(arguments))
        for each in names or (first + "".join(map(str.capitalize, rest)),):
            FUNCTIONS[f"sim.{each}"] = function
        return run

    return register


def shown(value: Any) -> str:
    """Returns a value in a few words, for messages."""
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, list | dict):
        return f"an array of {len(value)}" if isinstance(value, list) else f"a map of {len(value)}"
    return repr(value)[:60]
