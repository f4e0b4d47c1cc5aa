"""All functions that are offered, and what a client is told about them when it asks for `sim`."""

from typing import TYPE_CHECKING, Any

from wayfield.envs.coppelia import calls_data, calls_math, calls_objects, calls_refused, calls_simulation  # noqa: F401
from wayfield.envs.coppelia.constants import CONSTANTS
from wayfield.envs.coppelia.signatures import FUNCTIONS, NOT_OFFERED, CallError, Function, name

if TYPE_CHECKING:
    from wayfield.envs.coppelia.server import Caller

_MODULES = ("sim", "zmqRemoteApi")


def require(caller: "Caller", module: str) -> None:
    """Knows `sim`, and says of any other module that there is none."""
    if module not in _MODULES:
        reason = NOT_OFFERED.get(f"sim.{module}")
        raise CallError(f"module '{module}' not found", reason or "wayfield's server has sim")


def info(caller: "Caller", module: str) -> dict[str, Any]:
    """Returns every function and constant of a module, flat."""
    require(caller, module)
    listed: dict[str, Any] = {}
    for each in (*FUNCTIONS, *NOT_OFFERED):
        where, _, function = each.partition(".")
        if where == module:
            listed[function] = {"func": {}}
    if module == "sim":
        listed |= {constant: {"const": value} for constant, value in CONSTANTS.items()}
    return listed


FUNCTIONS["zmqRemoteApi.require"] = Function(require, (name,))
FUNCTIONS["zmqRemoteApi.info"] = Function(info, (name,))
