"""The `wayfield` command: says what there is to do, and hands the words over to the one that does it.

Each command is loaded on use, so that the rest needs neither its extra nor its time.
"""

import importlib
import os
import sys
from typing import NamedTuple

from gymnasium.error import DependencyNotInstalled

from wayfield import __version__
from wayfield.starting import started
from wayfield.system.extras import installs


class _Command(NamedTuple):
    module: str
    extra: str  # of the install, that holds what the module imports
    does: str
    function: str = "main"


COMMANDS = {
    "evaluate": _Command(
        "wayfield.benchmarks.commands.evaluate", "evaluate", "compare policies: tables, figures, report"
    ),
    "train": _Command("wayfield.policies.training.command", "train", "train an agent"),
    "tune": _Command("wayfield.benchmarks.tuning.tune", "tune", "tune a controller on training scenarios"),
    "record": _Command(
        "wayfield.benchmarks.recordings.record", "record", "record episodes as a Minari or MCAP data set"
    ),
    "identify": _Command("wayfield.bridges.identify.command", "evaluate", "make a data sheet from a log of a robot"),
    "nav2": _Command("wayfield.bridges.identify.nav2", "evaluate", "write gains and a data sheet as Nav2 parameters"),
    "submit": _Command(
        "wayfield.benchmarks.commands.submit", "evaluate", "write a contest entry that others can verify", "submit"
    ),
    "verify": _Command("wayfield.benchmarks.commands.submit", "evaluate", "re-run a submission and compare", "verify"),
    "play": _Command("wayfield.benchmarks.commands.play", "render", "drive by keyboard, against policies"),
    "demo": _Command("wayfield.benchmarks.commands.demo", "evaluate", "open the simulator in the browser"),
    "render": _Command("wayfield.benchmarks.figures.video", "render", "film a policy: .mp4, .gif or .png"),
    "policies": _Command(
        "wayfield.benchmarks.commands.lists", "evaluate", "list policies and their inputs", "policies"
    ),
    "scenarios": _Command(
        "wayfield.benchmarks.commands.lists", "evaluate", "list scenario families, tiers, splits", "scenarios"
    ),
    "ros": _Command("wayfield.bridges.ros.command", "ros", "run a simulated robot and a driver as ROS 2 nodes"),
    "compile": _Command(
        "wayfield.benchmarks.commands.compile",
        "",
        "compile all kernels now, for an image or a class",
        "compile",
    ),
    "robot": _Command("wayfield.benchmarks.commands.robot", "evaluate", "write a robot as MuJoCo's model", "robot"),
    "robots": _Command("wayfield.benchmarks.commands.lists", "evaluate", "list robots and their limits", "robots"),
}

_HELPS, _VERSIONS = ("-h", "--help"), ("-V", "--version")
_HELP = "\n".join(
    [
        "Usage: wayfield COMMAND [OPTIONS]",
        "",
        *(f"  {name:<10} {command.does}" for name, command in COMMANDS.items()),
        "",
        "  wayfield COMMAND --help   its options",
        "  wayfield --version",
    ]
)


def main() -> None:
    """Runs the command that the words of the process name, and exits."""
    try:
        try:
            _run(sys.argv[1:])
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # who reads has left, as in `wayfield --help | head -3`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def _run(words: list[str]) -> None:
    if not words or words[0] in (*_HELPS, "help"):
        started()
        print(_HELP)
        sys.exit(0)
    name, *rest = words
    if name in _VERSIONS:
        started()
        print(f"wayfield {__version__}")
        sys.exit(0)
    if name not in COMMANDS:
        started()
        sys.exit(_refused(name))
    if name == "train":
        # threads that wait must not spin: beside other work a spinning thread makes an update twenty times slower
        os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    command = COMMANDS[name]
    try:
        run = getattr(importlib.import_module(command.module), command.function)
        run(args=rest, prog_name=f"wayfield {name}")  # some import what they need when they need it
    except Exception as error:
        missing = _missing(error)
        if missing is None:
            raise
        print(f"wayfield {name}: {missing} is missing: {installs(command.extra)}", file=sys.stderr)
        sys.exit(1)


def _missing(error: BaseException | None) -> str | None:
    """Returns the package that an import of ours did not find; None of other errors, and where a module is broken."""
    if isinstance(error, ModuleNotFoundError) and error.name is not None:
        package = error.name.partition(".")[0]
        return None if package == "wayfield" else package
    # not the cause of any error: a policy of the user's own may lack a package that is in no extra
    return _missing(error.__cause__) if isinstance(error, ImportError | DependencyNotInstalled) else None


def _refused(name: str) -> int:
    import difflib

    option = name.startswith("-")
    known = {each.lower(): each for each in (*_HELPS, *_VERSIONS, *(() if option else COMMANDS))}
    near = difflib.get_close_matches(name.lower(), known, 1)
    hint = f" Did you mean {known[near[0]]!r}?" if near else ""
    if option and not near:
        hint = f" An option comes behind its command: wayfield evaluate {name}"
    print(f"wayfield: {name!r} is no command.{hint} Choose from {', '.join(COMMANDS)}.", file=sys.stderr)
    return 2


if __name__ == "__main__":
    main()
