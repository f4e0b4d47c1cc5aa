"""Ctrl-C or SIGTERM while a command of ours is still being imported: one line, as at any later time.

The package imports this module before all others. It looks at how the process was started, and does nothing in any
other program that imports the package.
"""

import os
import pathlib
import signal
import sys
import threading

_SOON = 0.02  # s
_RAISED = {KeyboardInterrupt: signal.SIGINT, SystemExit: signal.SIGTERM}  # what handlers of signals raise


def _command() -> str:
    """Returns which of our commands this process is: a module of ours after `-m`, or a script of ours; "" for another.

    A script in a clone says its name as WAYFIELD_COMMAND.
    """
    words = sys.orig_argv
    if "--multiprocessing-fork" in words:  # a process that a command started, which speaks for it
        return ""
    if isinstance(name := getattr(sys.modules.get("__main__"), "WAYFIELD_COMMAND", None), str):
        return name
    if sys.argv[:1] == ["-m"] and "-m" in words[:-1]:  # so it is while the packages above the module are imported
        module = words[words.index("-m") + 1]
        return module.rpartition(".")[2] if module.startswith("wayfield.") else ""
    return "wayfield" if sys.argv and pathlib.Path(sys.argv[0]).stem == "wayfield" else ""


class Terminated(SystemExit):
    """SIGTERM, as an exception: what is half written is deleted on the way out, as at Ctrl-C."""


def _interrupted(number: int, _: object) -> None:
    os.write(2, f"{_NAME}: interrupted; nothing was written\n".encode())
    os._exit(128 + number)  # half-imported modules may turn an exception into anything


def _terminated(number: int, _: object) -> None:
    raise Terminated(128 + number)


def started() -> None:
    """Makes exceptions of Ctrl-C and SIGTERM; the command itself says what was interrupted."""
    if threading.current_thread() is threading.main_thread():  # which alone has signals
        if signal.getsignal(signal.SIGINT) is _interrupted:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        if signal.getsignal(signal.SIGTERM) in (_interrupted, signal.SIG_DFL):
            signal.signal(signal.SIGTERM, _terminated)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = again


def again(lost: "sys.UnraisableHookArgs") -> None:
    """Sends Ctrl-C or SIGTERM again where what it raised fell into a destructor or a callback, which the interpreter
    would drop with a traceback; other exceptions there are printed as usual.
    """
    number = next((_RAISED[kind] for kind in _RAISED if issubclass(lost.exc_type, kind)), None)
    if number is None:
        sys.__unraisablehook__(lost)
    else:
        threading.Timer(_SOON, os.kill, (os.getpid(), number)).start()


_NAME = _command()
if _NAME:
    for _number, _usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL)):
        if signal.getsignal(_number) is _usual:  # a shell's `trap ""` stays
            signal.signal(_number, _interrupted)
