"""Functions of `sim` about time: starting, stopping, stepping, waiting, and the numbers of the program."""

import time
from typing import TYPE_CHECKING, Any

from wayfield.envs.coppelia.constants import PROGRAM_REVISION, PROGRAM_VERSION
from wayfield.envs.coppelia.signatures import (
    WRONG_TYPE,
    Callback,
    CallError,
    Optional,
    Wait,
    anything,
    integer,
    name,
    number,
    offered,
    text,
    truth,
)

if TYPE_CHECKING:
    from wayfield.envs.coppelia.server import Caller

MAX_LEVEL = 1_000_000  # of stepping and of locks
_STOP_PASSES = 20  # that a stop may take at most
_LONGEST_WAIT = 1e6  # s
_STEP_RANGE = (1e-3, 1.0)  # s
_LINES_A_SECOND = 100  # of a client's log

VERSION, REVISION, IDLE_FPS, REAL_TIME, TIME_STEP = 1, 30, 26, 25, 1


@offered()
def start_simulation(caller: "Caller") -> None:
    """Starts the simulation, or goes on after a pause."""
    world = caller.world
    if not world.running:
        caller.server.log("started", f"by {caller.client.name}", 10)
        world.start()
        caller.server.schedule(time.monotonic())


@offered(Optional(truth, False))
def stop_simulation(caller: "Caller", wait: bool) -> Wait | None:
    """Stops the simulation, which takes three passes; ends all stepping."""
    world, server = caller.world, caller.server
    world.stop()
    server.end_stepping()
    last = world.passes + _STOP_PASSES
    if not wait:
        return None
    return Wait(lambda: [] if world.state == 0 or world.passes >= last or server.world is not world else None)


@offered()
def pause_simulation(caller: "Caller") -> None:
    """Pauses the simulation, which takes two passes."""
    caller.world.pause()


@offered()
def get_simulation_state(caller: "Caller") -> int:
    """Returns the state of the simulation."""
    return caller.world.state


@offered()
def get_simulation_time(caller: "Caller") -> float:
    """Returns the time of the simulation, s."""
    return caller.world.time


@offered()
def get_simulation_time_step(caller: "Caller") -> float:
    """Returns the time step, s."""
    return caller.world.dt


@offered()
def get_simulation_stopping(caller: "Caller") -> bool:
    """Returns whether the simulation is stopped or about to be."""
    return caller.world.stopping


@offered()
def get_system_time(caller: "Caller") -> float:
    """Returns the seconds since the server started."""
    return time.monotonic() - caller.server.started


@offered()
def get_real_time_simulation(caller: "Caller") -> bool:
    """Returns whether time goes by the wall clock."""
    return caller.server.paced


@offered(Optional(truth, True))
def set_stepping(caller: "Caller", enable: bool) -> int:
    """Counts a client's wish to step up or down; returns the count before."""
    client = caller.client
    before = client.level
    if enable and before >= MAX_LEVEL:
        raise CallError(f"stepping is enabled {MAX_LEVEL:,} times.")
    client.level = before + 1 if enable else max(before - 1, 0)
    client.wish = False
    if bool(before) != bool(client.level):
        caller.server.log("stepping", f"{'on' if client.level else 'off'} by {client.name}", 10)
        caller.server.schedule(time.monotonic())
    return before


def _step(caller: "Caller", wait: bool) -> Wait | None:
    """Asks for a pass, and waits until it has been made."""
    world, server = caller.world, caller.server
    if not world.running:
        return None
    caller.client.wish = True
    if not wait:
        return None
    before = world.passes
    return Wait(lambda: [] if world.passes > before or not world.running or server.world is not world else None)


for _name in ("step", "switchThread", "yield"):
    offered(Optional(truth, True), name=_name)(_step)


@offered(number, Optional(truth, True))
def wait(caller: "Caller", seconds: float, simulated: bool) -> Wait | float:
    """Waits for a time of the simulation, making the passes that it takes, or of the clock; returns what is left."""
    world, server = caller.world, caller.server
    seconds = min(max(seconds, 0.0), _LONGEST_WAIT)
    if not simulated:
        end = time.monotonic() + seconds
        return Wait(lambda: [end - time.monotonic()] if time.monotonic() >= end else None, until=end)
    if not world.running:
        return 0.0
    until = world.time + seconds

    def done() -> list[Any] | None:
        over = world.time >= until or not world.running or server.world is not world
        return [until - world.time] if over else None

    return Wait(done, steps=True)


@offered()
def acquire_lock(caller: "Caller") -> None:
    """Holds back passes until it is released as often."""
    if caller.client.locks >= MAX_LEVEL:
        raise CallError(f"the lock is held {MAX_LEVEL:,} times.")
    caller.client.locks += 1


@offered()
def release_lock(caller: "Caller") -> None:
    """Lets passes go on."""
    caller.client.locks = max(caller.client.locks - 1, 0)
    if not caller.client.locks:
        caller.server.schedule(time.monotonic())


@offered(Optional(anything), name="setThreadAutomaticSwitch")
def set_thread_automatic_switch(caller: "Caller", value: Any) -> bool:
    """Does nothing: there are no threads in the server."""
    return True


@offered(Optional(anything), name="setThreadSwitchTiming")
def set_thread_switch_timing(caller: "Caller", value: Any) -> None:
    """Does nothing: there are no threads in the server."""


@offered(integer, Optional(anything))
def add_log(caller: "Caller", level: int, words: Any) -> None:
    """Writes a line to the server's log."""
    caller.server.log("log", str(words if isinstance(words, str | int | float) else ""), _LINES_A_SECOND)


@offered(Optional(anything))
def add_statusbar_message(caller: "Caller", words: Any) -> int:
    """Writes a line to the server's log."""
    add_log(caller, 0, words)
    return 1


# The program's numbers.


@offered(integer)
def get_int32_param(caller: "Caller", which: int) -> int:
    """Returns a number of the program."""
    fixed = {VERSION: PROGRAM_VERSION, REVISION: PROGRAM_REVISION}
    if which in fixed:
        return fixed[which]
    if which == IDLE_FPS:
        return caller.server.idle_fps
    raise CallError(WRONG_TYPE, f"parameter {which} is not known here")


@offered(integer, integer)
def set_int32_param(caller: "Caller", which: int, value: int) -> None:
    """Sets how often an idle window is drawn, which has no effect."""
    if which != IDLE_FPS:
        raise CallError(WRONG_TYPE, f"parameter {which} cannot be set here")
    caller.server.idle_fps = value


@offered(integer)
def get_bool_param(caller: "Caller", which: int) -> bool:
    """Returns whether time goes by the wall clock."""
    if which != REAL_TIME:
        raise CallError(WRONG_TYPE, f"parameter {which} is not known here")
    return caller.server.paced


@offered(integer, truth)
def set_bool_param(caller: "Caller", which: int, value: bool) -> None:
    """Sets whether time goes by the wall clock."""
    if which != REAL_TIME:
        raise CallError(WRONG_TYPE, f"parameter {which} cannot be set here")
    caller.server.paced = value
    caller.server.schedule(time.monotonic())


@offered(integer)
def get_float_param(caller: "Caller", which: int) -> float:
    """Returns the time step, s."""
    if which != TIME_STEP:
        raise CallError(WRONG_TYPE, f"parameter {which} is not known here")
    return caller.world.dt


@offered(integer, number)
def set_float_param(caller: "Caller", which: int, value: float) -> None:
    """Sets the time step of a stopped simulation, s."""
    if which != TIME_STEP:
        raise CallError(WRONG_TYPE, f"parameter {which} cannot be set here")
    if caller.world.state != 0:
        raise CallError("simulation is not stopped.")
    low, high = _STEP_RANGE
    if not low <= value <= high:
        raise CallError(WRONG_TYPE, f"the time step is {value:g} s; it must be {low:g} to {high:g}")
    caller.world.set_dt(value)


@offered(integer)
def get_string_param(caller: "Caller", which: int) -> str:
    """Returns the name of the scene, whatever is asked for."""
    return caller.world.scene.name


# Scenes.


@offered(name)
def load_scene(caller: "Caller", scene: str) -> int:
    """Puts one of the server's own scenes in place of the one that it serves."""
    if caller.world.state != 0:
        raise CallError("simulation is not stopped.")
    if caller.server.load is None:
        raise CallError("scene could not be loaded.", "this server serves one scene")
    try:
        world = caller.server.load(scene)
    except ValueError as error:
        raise CallError("scene could not be loaded.", str(error)) from None
    caller.server.replace(world)
    return 1


@offered()
def close_scene(caller: "Caller") -> int:
    """Puts an empty scene in place of the one that is served."""
    return load_scene(caller, "empty")  # type: ignore[no-any-return]


@offered(anything, text, anything, name="testCB")
def test_callback(caller: "Caller", a: Any, callback: str, b: Any) -> Callback:
    """Returns what a function of the client's returns for two values."""
    function, marked, _ = callback.partition("@func")
    if not marked or not function:
        raise CallError(WRONG_TYPE, "argument 2 must be a function")
    return Callback(function, [a, b])
