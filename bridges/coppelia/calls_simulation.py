"""Functions of `sim` about time: starting, stopping, stepping, waiting, parameters of the program, scenes."""

import time
from typing import TYPE_CHECKING, Any

from wayfield.bridges.coppelia.constants import PROGRAM_REVISION, PROGRAM_VERSION
from wayfield.bridges.coppelia.signatures import WRONG_TYPE, Callback, CallError, Name, Wait, offered

if TYPE_CHECKING:
    from wayfield.bridges.coppelia.server import Caller

MAX_LEVEL = 1_000_000  # of stepping and of locks
_STOP_PASSES = 20  # that a stop may take at most
_LONGEST_WAIT = 1e6  # s
_LINES_A_SECOND = 100  # of a client's log

_VERSION, _REVISION, _IDLE_FPS, _REAL_TIME = 1, 30, 26, 25


@offered()
def start_simulation(caller: "Caller") -> None:
    """Starts the simulation, or resumes it after a pause."""
    world = caller.world
    if not world.running:
        caller.server.log("started", f"by {caller.client.name}", 10)
        world.start()
        caller.server.schedule(time.monotonic())


@offered()
def stop_simulation(caller: "Caller", wait: bool = False) -> Wait | None:
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
    """Returns whether the simulation is stopped or stopping."""
    return caller.world.stopping


@offered()
def get_system_time(caller: "Caller") -> float:
    """Returns the seconds since the start of the server."""
    return time.monotonic() - caller.server.started


@offered()
def set_stepping(caller: "Caller", enable: bool = True) -> int:
    """Changes the stepping level of the client by 1, not below 0; returns the level before."""
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


@offered("step", "switchThread", "yield")
def step(caller: "Caller", wait: bool = True) -> Wait | None:
    """Requests a pass, and waits until it has been made."""
    world, server = caller.world, caller.server
    if not world.running:
        return None
    caller.client.wish = True
    if not wait:
        return None
    before = world.passes
    return Wait(lambda: [] if world.passes > before or not world.running or server.world is not world else None)


@offered()
def wait(caller: "Caller", seconds: float, simulated: bool = True) -> Wait | float:
    """Waits for simulation time, requesting the passes, or for wall-clock time; returns the rest, s."""
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
    """Holds back passes until as many calls of `releaseLock`."""
    if caller.client.locks >= MAX_LEVEL:
        raise CallError(f"the lock is held {MAX_LEVEL:,} times.")
    caller.client.locks += 1


@offered()
def release_lock(caller: "Caller") -> None:
    """Releases a lock."""
    caller.client.locks = max(caller.client.locks - 1, 0)
    if not caller.client.locks:
        caller.server.schedule(time.monotonic())


@offered(
    *("setObjectColor", "setShapeColor", "setObjectInt32Param", "setObjectFloatParam", "setModelProperty"),
    *("setJointTargetForce", "setJointForce", "setJointMaxForce", "setThreadAutomaticSwitch", "setThreadSwitchTiming"),
)
def accept(caller: "Caller", a: Any = None, b: Any = None, c: Any = None, d: Any = None) -> int:
    """Has no effect: looks, forces and threads do not act here, and scripts set them in passing."""
    return 1


@offered()
def add_log(caller: "Caller", level: int, words: Any = None) -> None:
    """Writes a line to the log of the server."""
    caller.server.log("log", str(words if isinstance(words, str | int | float) else ""), _LINES_A_SECOND)


@offered()
def add_statusbar_message(caller: "Caller", words: Any = None) -> int:
    """Writes a line to the log of the server."""
    add_log(caller, 0, words)
    return 1


# Parameters of the program.


def _checked(which: int, *known: int) -> None:
    if which not in known:
        raise CallError(WRONG_TYPE, f"parameter {which} is unknown; offered are {', '.join(map(str, known))}")


@offered()
def get_int32_param(caller: "Caller", which: int) -> int:
    """Returns the version, the revision or the frame rate of the idle window."""
    _checked(which, _VERSION, _REVISION, _IDLE_FPS)
    return {_VERSION: PROGRAM_VERSION, _REVISION: PROGRAM_REVISION, _IDLE_FPS: caller.server.idle_fps}[which]


@offered()
def set_int32_param(caller: "Caller", which: int, value: int) -> None:
    """Sets the frame rate of the idle window, which has no effect."""
    _checked(which, _IDLE_FPS)
    caller.server.idle_fps = value


@offered()
def get_bool_param(caller: "Caller", which: int) -> bool:
    """Returns whether passes follow the wall clock."""
    _checked(which, _REAL_TIME)
    return caller.server.paced


@offered()
def set_bool_param(caller: "Caller", which: int, value: bool) -> None:
    """Sets whether passes follow the wall clock."""
    _checked(which, _REAL_TIME)
    caller.server.paced = value
    caller.server.schedule(time.monotonic())


# Scenes and callbacks.


@offered(scene=Name)
def load_scene(caller: "Caller", scene: str) -> int:
    """Replaces the scene by another of the server's own, by name."""
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


@offered("testCB")
def test_callback(caller: "Caller", a: Any, callback: str, b: Any) -> Callback:
    """Returns the result of a function of the client for two values."""
    function, marked, _ = callback.partition("@func")
    if not marked or not function:
        raise CallError(WRONG_TYPE, "argument 2 must be a function")
    return Callback(function, [a, b])
