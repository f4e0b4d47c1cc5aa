"""Runs that are killed at any moment, or find their parts damaged, and are run again until they are done."""

import itertools
import random
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wayfield.benchmarks.faults.runs import FORKED, LIMIT, OUT, RUNS, differs, finished, parts_of, reference

_SIGNALS = ("SIGKILL", "SIGKILL", "SIGTERM", "SIGINT")
_PATIENCE = 30.0  # s, in which a signal must end a run: a training finishes its update


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields a kill in the middle of each run, damages of parts, then kills at random, without end."""
    for run, share in (("contest", 0.6), ("one training", 0.7), ("tuning", 0.6)):
        yield {"run": FORKED[run], "forked": True, "signal": "SIGKILL", "at": [share]}
    for damage in ("number", "truncate", "flip", "delete"):
        yield {"run": FORKED["contest"], "forked": True, "damage": damage}
    for k in itertools.count():
        forked = k % 20 < 19  # processes that start from nothing, and others below them, take many times as long
        run = rng.choice(tuple(FORKED.values()) if forked else ("contest", "training", "tuning"))
        moments = [round(rng.uniform(0.02, 1.05), 3) for _ in range(rng.choice((1, 1, 2)))]
        yield {"run": run, "forked": forked, "signal": rng.choice(_SIGNALS), "at": moments}


def attempt(spec: dict[str, Any], place: Any, server: Any) -> str | None:
    """Returns what is wrong with the run's end, what it leaves running, or with its results in the end."""
    del server
    found = reference(spec["run"], place)
    if isinstance(found, str):
        return found
    wanted, seconds = found
    run = RUNS[spec["run"]]
    with place.folder() as folder:
        (folder / OUT).mkdir()
        if "damage" in spec:
            return _damaged(spec, place, folder, wanted)
        for share in spec["at"]:
            running = place.start(run.command, [*run.line, *_going_on(spec["run"], folder)], folder)
            running.ends_within(share * seconds)
            running.send(getattr(signal, spec["signal"]))
            if not running.ends_within(_PATIENCE):
                running.wait(0.0)
                return f"{spec['signal']} does not end it within {_PATIENCE:g} s"
            orphans = running.left()
            ended = running.wait(0.0 if orphans else LIMIT)
            if orphans:
                return f"{spec['signal']} leaves {len(orphans)} processes running: {orphans[0][:120]}"
            if "Traceback" in ended.err:
                return f"traceback after {spec['signal']}: {ended.err.strip().splitlines()[-1][:200]}"
            if run.out != OUT and (folder / run.out).exists():  # done before it was killed; it refuses to do it again
                return differs(spec["run"], folder / OUT, wanted)
        return finished(spec["run"], place, folder, wanted, _going_on(spec["run"], folder))


def _going_on(run: str, folder: Path) -> list[str]:
    return ["--resume"] if RUNS[run].command == "train" and any((folder / OUT).glob("seed_*")) else []


def _damaged(spec: dict[str, Any], place: Any, folder: Path, wanted: dict[str, str]) -> str | None:
    """Damages a part of a contest that was killed; it must be driven again, or refused in one line."""
    run = RUNS[spec["run"]]
    running = place.start(run.command, run.line, folder)
    until = time.monotonic() + LIMIT
    while not (parts := parts_of(folder)) and time.monotonic() < until:
        if running.ended():
            return None  # done before a part was seen: nothing to damage
        time.sleep(0.01)
    running.wait(0.0)
    if not parts:
        return f"no part was done within {LIMIT:g} s"
    rows, drawn = parts[0], parts[0].with_name("trajectories.npz")
    if spec["damage"] == "number":
        text = rows.read_text(encoding="utf-8")
        place_of = text.index('"success": "') + len('"success": "')
        rows.write_text(text[:place_of] + "0.25" + text[text.index('"', place_of) :], encoding="utf-8")
    elif spec["damage"] == "truncate":
        drawn.write_bytes(drawn.read_bytes()[:100])
    elif spec["damage"] == "flip":
        content = bytearray(rows.read_bytes())
        content[len(content) // 2] ^= 0x80
        rows.write_bytes(bytes(content))
    else:
        drawn.unlink()
    ended = place.run(run.command, run.line, folder, LIMIT)
    fault: str | None = ended.fault((0, 1))
    if fault or ended.status != 0:
        return fault
    return differs(spec["run"], folder / OUT, wanted)
