"""Wrong command lines, made from each command's own table of options: one line on stderr, nothing written."""

import contextlib
import math
import os
import random
import signal
import time
import traceback
from collections.abc import Iterator
from typing import Any

import click
from click.testing import CliRunner
from place import Ended, changed, contents, entries, entry

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
_ENV = "wayfield/DiffDrivePathFollowing-v0"
_PATH = "path-following"
_CONTEST = (
    *("--suite", _PATH, "--gains", "default", "--policies", "pure_pursuit", "--families", "splines"),
    *("--episodes", "1", "--workers", "1"),
)
# what once went wrong: command, arguments, exit statuses allowed, and the environment of a process of its own
_LISTED: tuple[tuple[str, tuple[str, ...], tuple[int, ...], dict[str, Any]], ...] = (
    ("evaluate", ("--path", ""), (1, 2), {}),
    ("evaluate", ("--path", "nowhere.csv"), (1, 2), {}),
    ("evaluate", ("--suite", "path-following", "--path", "FILE"), (1, 2), {}),
    ("evaluate", ("--suite", "documents", "--path", "FILE"), (1, 2), {}),
    ("evaluate", ("--suite", "path-following", "--families", "clutter_10"), (1, 2), {}),
    ("evaluate", ("--suite", "path-following", "--out", "/proc/nowhere/out"), (1, 2), {}),
    ("evaluate", (*_CONTEST, "--seed", "99999999999"), (0, 1, 2), {"own": True, "limit": 90.0, "writes": True}),
    ("evaluate", ("--path", "\udcff.csv"), (1, 2), {"own": True, "environment": {"LC_ALL": "C"}}),
    ("evaluate", ("--suite", "\N{GREEK SMALL LETTER ALPHA}"), (1, 2), {"own": True, "environment": {"LC_ALL": "C"}}),
    ("evaluate", ("-h",), (0,), {"own": True, "environment": {"LC_ALL": "C"}}),
    ("evaluate", _CONTEST, (0, 1), {"own": True, "environment": {"LC_ALL": "C"}, "writes": True}),
    ("evaluate", ("-h",), (0, 1), {"own": True, "output": "closed"}),
    ("evaluate", _CONTEST, (0, 1), {"own": True, "output": "closed", "writes": True}),
    *((command, ("--help",), (0, 141), {"own": True, "output": "pipe"}) for command in ("evaluate", "tune", "train")),
    ("evaluate", _CONTEST, (0, 141), {"own": True, "output": "pipe", "writes": True}),
    *((command, line, (0, 130), {"own": True, "interrupt": seconds, "writes": seconds > 1.0})
      for seconds in (0.15, 0.6, 2.0) for command, line in (
          ("evaluate", _CONTEST), ("evaluate.py", _CONTEST), ("train", (_ENV,)), ("tune", ("lqr", "--suite", _PATH)),
          ("decisions", ()),
      )),
    ("evaluate", ("--suite", "barn", "--data", "nowhere"), (1, 2, 130), {"own": True, "interrupt": 0.15}),
    ("evaluate", ("--suite", "barn"), (1, 2), {}),
    ("evaluate", ("--suite", "racetracks", "--data", "FILE"), (1, 2), {}),
    ("freeze", ("nothing",), (1, 2, 130), {"own": True, "interrupt": 0.15}),
    ("onnx", ("nowhere", "x.onnx"), (1, 2, 130), {"own": True, "interrupt": 0.15}),
    ("train", (_ENV, "--seed", "99999999999"), (1, 2), {}),
    ("decisions", ("--policies", "nobody"), (1, 2), {}),
    ("tune", ("lqr", "--suite", "path-following", "--trials", "1", "--scenarios", "1", "--out", "/proc/nowhere/a.json"),
     (1, 2), {"own": True, "limit": 90.0}),
    ("tune", ("scan_planner", "--suite", "goal-obstacles", "--trials", "1", "--scenarios", "1", "--robot", "omni3"),
     (0, 1, 2), {"own": True, "limit": 300.0, "writes": True}),
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
    """Yields what once went wrong, lines out of the tables of options between what takes long, then these alone."""
    for command, arguments, allowed, how in sorted(_LISTED, key=_cost):
        yield {"command": command, "arguments": list(arguments), "allowed": list(allowed), **how}
        yield from _drawn(rng, 10 if "own" in how else 0)
    for command in entries():
        for word in ("-h", "--help"):
            yield {"command": command, "arguments": [word], "allowed": [0]}
    while True:
        yield from _drawn(rng, 1)


def _drawn(rng: random.Random, count: int) -> Iterator[dict[str, Any]]:
    for _ in range(count):
        with contextlib.suppress(ModuleNotFoundError):  # its extra is not installed
            yield _wrong(rng.choice(tuple(entries())), rng)


def _cost(listed: tuple[str, tuple[str, ...], tuple[int, ...], dict[str, Any]]) -> tuple[float, bool]:
    """Returns a key that sorts what is done at once before what takes long."""
    return listed[3].get("limit", 0.0), "own" in listed[3]


def _wrong(command: str, rng: random.Random) -> dict[str, Any]:
    """Returns a line with one thing wrong."""
    right = list(_RIGHT.get(command, ()))
    # of `compile`, which needs no extra and so no click, what is wrong are words that it does not know
    params = getattr(entry(command), "params", [])
    options = [each for each in params if isinstance(each, click.Option) and each.name != "help"]
    line = [*right, *rng.choice((["--nothing"], ["-z"], ["--" + "x" * 2000], ["one", "too", "many"]))]
    if options:
        option = rng.choice(options)
        flag = rng.choice(option.opts)
        kind = rng.randrange(6)
        wrong = [] if option.is_flag else [text for text in _TYPED if _is_wrong(option, text)]
        if kind == 0:
            line = [*right, rng.choice((flag + "x", "-", flag[:-1] + "~"))]
        elif kind == 1:
            line = [*right, f"{flag}=1"] if option.is_flag else [*right, flag]  # its value is missing
        elif kind == 2 and right:
            line = rng.choice(([], ["", *right[1:]], ["\udcff", *right[1:]], ["x" * 5000, *right[1:]]))
        elif kind > 2 and wrong:
            line = [*right, flag, rng.choice(wrong)]
    return {"command": command, "arguments": line, "allowed": [1, 2]}


def _is_wrong(option: click.Option, text: str) -> bool:
    """Returns whether a text is none of the option's type, or a number that no option of ours takes."""
    try:
        value = option.type.convert(text, option, None)
    except click.ClickException:
        return True
    return isinstance(value, float) and not math.isfinite(value)


def attempt(spec: dict[str, Any], place: Any) -> str | None:
    """Returns what is wrong with how a command line ended."""
    shipped = {name: contents(place.code / "wayfield" / name) for name in ("policies/gains", "envs/scenarios/splits")}
    with place.folder() as folder:
        there = {  # good files, so that what is refused is what the trial is about
            "AGENT": place.code / "wayfield/policies/agents/goal_reaching_p3dx/seed_0",
            "FILE": place.home / "way.csv",
        }
        there["FILE"].write_text("x,y\n0,0\n1,0\n2,0.5\n", encoding="utf-8")
        arguments = [str(there.get(each, each)) for each in spec["arguments"]]
        if spec.get("own") or spec["command"] == "compile":  # which is no command of click's
            problem = _own(spec, arguments, place, folder)
        else:
            problem = place.inside.ask("commands", spec | {"arguments": arguments, "folder": str(folder)})
        left = [] if spec.get("writes") else list(contents(folder))
        for name, before in shipped.items():
            touched = changed(before, contents(place.code / "wayfield" / name))
            if touched:
                place.restore()
                return f"rewrites what ships: {name}/{touched[0]}"
        return problem or (f"wrote {', '.join(left[:5])}" if left else None)


def _own(spec: dict[str, Any], arguments: list[str], place: Any, folder: Any) -> str | None:
    """Runs the line in a process of its own, under another locale, without an output, or interrupted."""
    running = place.start(
        spec["command"], arguments, folder, output=spec.get("output", ""), environment=spec.get("environment")
    )
    if "interrupt" in spec:
        running.computes(spec["interrupt"])
        running.process.send_signal(signal.SIGINT)
    ended = running.wait(spec.get("limit", 40.0 if "interrupt" in spec else 120.0))
    if ended.status is None and "interrupt" in spec:
        return "Ctrl-C does not end it"
    if ended.status == 130 and len(ended.said) != 1:
        return f"{len(ended.said)} lines about an interruption"
    return ended.fault(spec["allowed"])


def inside(spec: dict[str, Any]) -> dict[str, Any]:
    """Returns what was wrong with how a command line ended, in a process that has its modules loaded."""
    began = time.monotonic()
    os.chdir(spec["folder"])
    try:
        found = CliRunner().invoke(entry(spec["command"]), spec["arguments"])
    finally:
        os.chdir("..")
    unexpected = found.exception is not None and not isinstance(found.exception, SystemExit)
    error = "".join(traceback.format_exception(found.exception)) if unexpected else ""
    problem = Ended(found.exit_code, found.stdout, found.stderr + error).fault(spec["allowed"])
    took = time.monotonic() - began
    if problem is None and took > 15.0 and 0 not in spec["allowed"]:
        problem = f"refused only after {took:.0f} s of work"
    return {} if problem is None else {"problem": problem}
