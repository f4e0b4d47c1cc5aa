"""Wrong command lines, made from each command's own table of options: one line on stderr, nothing written."""

import math
import os
import random
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from wayfield.benchmarks.faults.forks import Fork
from wayfield.benchmarks.faults.place import ENTRIES, changed, contents, found

# arguments that are right, beside which one is wrong, of commands that need some or would work without
_RIGHT: dict[str, tuple[str, ...]] = {
    "tune": ("lqr", "--suite", "path-following"),
    "train": ("wayfield/DiffDrivePathFollowing-v0",),
    "fingerprints": ("--out", "prints.json"),
    "render": ("--out", "film.png"),
    "record": ("lqr", "--episodes", "1"),
    "onnx": ("AGENT", "x.onnx"),
    "freeze": ("nothing",),
    "report": ("nowhere",),
}
COMMANDS = {command: _RIGHT.get(command, ()) for command in ENTRIES}
_ENV = "wayfield/DiffDrivePathFollowing-v0"
_PATH = "path-following"
_CONTEST = (
    "--suite",
    _PATH,
    "--gains",
    "default",
    "--policies",
    "pure_pursuit",
    "--families",
    "splines",
    "--episodes",
    "1",
)
# what once went wrong: command, arguments, exit statuses allowed, and the environment of a process of its own
_LISTED: tuple[tuple[str, tuple[str, ...], tuple[int, ...], dict[str, Any]], ...] = (
    ("evaluate", ("--path", ""), (1, 2), {}),
    ("evaluate", ("--path", "nowhere.csv"), (1, 2), {}),
    ("evaluate", ("--suite", "path-following", "--path", "FILE"), (1, 2), {}),
    ("evaluate", ("--suite", "documents", "--path", "FILE"), (1, 2), {}),
    ("evaluate", ("--suite", "path-following", "--families", "clutter_10"), (1, 2), {}),
    ("evaluate", ("--suite", "path-following", "--out", "/proc/nowhere/out"), (1, 2), {}),
    ("evaluate", (*_CONTEST, "--workers", "1", "--seed", "99999999999"), (0, 1, 2), {"limit": 90.0, "writes": True}),
    ("evaluate", ("--path", "\udcff.csv"), (1, 2), {"own": True, "environment": {"LC_ALL": "C"}}),
    ("evaluate", ("--suite", "\N{GREEK SMALL LETTER ALPHA}"), (1, 2), {"own": True, "environment": {"LC_ALL": "C"}}),
    ("evaluate", ("-h",), (0,), {"own": True, "environment": {"LC_ALL": "C"}}),
    ("evaluate", (*_CONTEST, "--workers", "1"), (0, 1), {"own": True, "environment": {"LC_ALL": "C"}, "writes": True}),
    ("evaluate", ("-h",), (0, 1), {"own": True, "output": "closed"}),
    ("evaluate", (*_CONTEST, "--workers", "1"), (0, 1), {"own": True, "output": "closed", "writes": True}),
    *((command, ("--help",), (0, 141), {"own": True, "output": "pipe"}) for command in ("evaluate", "tune", "train")),
    ("evaluate", (*_CONTEST, "--workers", "1"), (0, 141), {"own": True, "output": "pipe", "writes": True}),
    *((command, line, (0, 130), {"own": True, "interrupt": seconds, "writes": seconds > 1.0})
      for seconds in (0.15, 0.6, 2.0) for command, line in (
          ("evaluate", _CONTEST), ("evaluate.py", _CONTEST), ("train", (_ENV,)), ("tune", ("lqr", "--suite", _PATH)),
          ("decisions", ()), ("throughput", ()), ("fingerprints", ("--out", "prints.json")),
      )),
    ("evaluate", ("--suite", "barn", "--data", "nowhere"), (1, 2, 130), {"own": True, "interrupt": 0.15}),
    ("evaluate", ("--suite", "barn"), (1, 2), {}),
    ("evaluate", ("--suite", "racetracks", "--data", "FILE"), (1, 2), {}),
    ("freeze", ("nothing",), (1, 2, 130), {"own": True, "interrupt": 0.15}),
    ("onnx", ("nowhere", "x.onnx"), (1, 2, 130), {"own": True, "interrupt": 0.15}),
    ("train", (_ENV, "--seed", "99999999999"), (1, 2), {}),
    ("decisions", ("--policies", "nobody"), (1, 2), {}),
    ("throughput", ("--seconds", "nan"), (1, 2), {}),
    ("tune", ("lqr", "--suite", "path-following", "--trials", "1", "--scenarios", "1", "--out", "/proc/nowhere/a.json"),
     (1, 2), {"limit": 90.0, "quick": 8.0}),
    ("tune", ("scan_planner", "--suite", "goal-obstacles", "--trials", "1", "--scenarios", "1", "--robot", "omni3"),
     (0, 1, 2), {"limit": 300.0, "writes": True}),
    ("freeze", (), (1, 2), {"own": True, "limit": 25.0, "refused": True}),
    ("freeze", ("nothing",), (1, 2), {"own": True, "limit": 25.0}),
    ("freeze", ("-h",), (0,), {"own": True}),
    ("onnx", ("--help",), (0,), {"own": True}),
    ("onnx", ("-h",), (0,), {"own": True}),
    ("onnx", ("AGENT", "-h"), (0, 1, 2), {"own": True}),
    ("onnx", ("AGENT", ""), (1, 2), {"own": True}),
    ("onnx", (), (1, 2), {"own": True}),
    ("onnx", ("nowhere", "x.onnx"), (1, 2), {"own": True}),
)  # fmt: skip
_TYPED = (
    "x", "", " ", "nan", "inf", "-inf", "-1", "0", "1e3", "1.5", "1" * 400, "\udcff", "\N{ARABIC-INDIC DIGIT THREE}",
    "--", "a,b", ",", "=",
)  # fmt: skip


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields what once went wrong, then lines out of the tables of options, without end."""
    for command, arguments, allowed, how in sorted(_LISTED, key=_cost):
        yield {"command": command, "arguments": list(arguments), "allowed": list(allowed), **how}
    for command in COMMANDS:
        for word in ("-h", "--help"):
            if word == "--help" or "-h" in found(command).context_settings.get("help_option_names", ()):
                yield {"command": command, "arguments": [word], "allowed": [0]}
    while True:
        yield _wrong(rng.choice(tuple(COMMANDS)), rng)


def _cost(listed: tuple[str, tuple[str, ...], tuple[int, ...], dict[str, Any]]) -> tuple[float, bool]:
    """Returns a key that sorts what is done at once before what takes long."""
    return listed[3].get("limit", 0.0), "own" in listed[3]


def _wrong(command: str, rng: random.Random) -> dict[str, Any]:
    """Returns a line with one thing wrong."""
    table, right = found(command), list(COMMANDS[command])
    options = [each for each in table.params if isinstance(each, click.Option) and each.name != "help"]
    kind = rng.randrange(6)
    if not options:
        words = rng.choice((["--nothing"], ["-z"], ["--" + "x" * 2000], ["one", "too", "many"]))
        return {"command": command, "arguments": [*right, *words], "allowed": [1, 2]}
    option = rng.choice(options)
    flag = rng.choice(option.opts)
    if kind == 0:
        line = [*right, rng.choice(("--nothing", "-z", flag + "x", "-", "--" + "x" * 2000, flag[:-1] + "~"))]
    elif kind == 1 and not option.is_flag:
        line = [*right, flag]  # its value is missing
    elif kind == 2:
        line = [*right, "one", "too", "many"]
    elif kind == 3 and right:
        line = rng.choice(([], ["", *right[1:]], ["\udcff", *right[1:]], ["x" * 5000, *right[1:]]))
    elif option.is_flag:
        line = [*right, f"{flag}=1"]
    else:
        wrong = [text for text in _TYPED if _is_wrong(option, text)]
        if not wrong:
            line = [*right, "--nothing"]
        else:
            line = [*right, flag, rng.choice(wrong)]
    return {"command": command, "arguments": line, "allowed": [1, 2]}


def _is_wrong(option: click.Option, text: str) -> bool:
    """Returns whether the option's own type surely refuses a text."""
    kind = option.type
    if isinstance(kind, click.IntRange | click.FloatRange):
        cast = int if isinstance(kind, click.IntRange) else float
        try:
            value = cast(text)
        except (ValueError, OverflowError):
            return True
        return bool(
            value in (math.inf, -math.inf)
            or value != value
            or (kind.min is not None and (value < kind.min or (kind.min_open and value == kind.min)))
            or (kind.max is not None and value > kind.max)
        )
    if isinstance(kind, click.types.IntParamType):
        return not text.lstrip("-").isdecimal()
    if isinstance(kind, click.Choice):
        return text not in kind.choices
    if hasattr(kind, "choices"):  # names of this package
        return any(name.strip() not in kind.choices for name in text.split(","))
    return kind.name == "number or ratio" and text in ("x", "", " ", "nan", "-1", "0")


def attempt(spec: dict[str, Any], place: Any, server: Any) -> str | None:
    """Returns what is wrong with how a command line ended."""
    shipped = {name: contents(place.code / "wayfield" / name) for name in ("policies/gains", "envs/scenarios/splits")}
    with place.folder() as folder:
        there = {  # good files, so that what is refused is what the trial is about
            "AGENT": place.code / "wayfield/policies/agents/goal_reaching_p3dx/seed_0",
            "FILE": place.out / "work" / "way.csv",
        }
        there["FILE"].write_text("x,y\n0,0\n1,0\n2,0.5\n", encoding="utf-8")
        arguments = [str(there.get(each, each)) for each in spec["arguments"]]
        if spec.get("own"):
            problem = _own(spec, arguments, place, folder)
        else:
            problem = server.ask("commands", spec | {"arguments": arguments, "folder": str(folder)})
        left = [] if spec.get("writes") else list(contents(folder))
        for name, before in shipped.items():
            touched = changed(before, contents(place.code / "wayfield" / name))
            if touched:
                place.restore()
                return f"rewrites what ships: {name}/{touched[0]}"
        return problem or (f"wrote {', '.join(left[:5])}" if left else None)


def _own(spec: dict[str, Any], arguments: list[str], place: Any, folder: Path) -> str | None:
    """Runs the line in a process of its own, under another locale, without an output, or interrupted."""
    running = place.start(
        spec["command"], [os.fsencode(each) if each.isprintable() is False else each for each in arguments], folder,
        output=spec.get("output", ""), environment=spec.get("environment"),
    )  # fmt: skip
    if "interrupt" in spec:
        running.computed(spec["interrupt"])
        running.send(signal.SIGINT)
    ended = running.wait(spec.get("limit", 40.0 if "interrupt" in spec else 120.0))
    found: str | None = ended.fault(spec["allowed"])
    if ended.status is None and "interrupt" in spec:
        return "Ctrl-C does not end it"
    if found is None and "interrupt" in spec and ended.status == 130 and len(ended.said) != 1:
        return f"{len(ended.said)} lines about an interruption"
    return found


def inside(spec: dict[str, Any]) -> dict[str, Any]:
    """Returns what was wrong with how a command line ended, in a fork of a worker that has its modules loaded."""
    began = time.monotonic()
    ended = Fork(spec["command"], spec["arguments"], Path(spec["folder"])).wait(spec.get("limit", 15.0))
    took = time.monotonic() - began
    problem = ended.fault(spec["allowed"])
    if problem is None and took > spec.get("quick", 15.0) and 0 not in spec["allowed"]:
        problem = f"refused only after {took:.0f} s of work"
    return {} if problem is None else {"problem": problem}
