"""Several runs at once, or one after another, in one folder: results are right, nobody's parts are lost."""

import random
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wayfield.benchmarks.faults.runs import FORKED, LIMIT, OUT, RUNS, differs, parts_of, reference

_LISTED = (
    ("contest", "contest", 0.0),
    ("contest", "another contest", 0.0),
    ("tuning", "tuning", 0.0),
    ("one training", "one training", 0.0),
)


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields pairs that start together, a resumed pair, a run over another's parts; then random pairs, without end."""
    for first, second, delay in _LISTED:
        yield {"first": first, "second": second, "delay": delay}
    yield {"first": "one training", "second": "one training", "delay": 0.0, "cut": 0.7}
    yield {"first": "contest", "second": "another contest", "parts": True}
    while True:
        first, second = (FORKED[name] for name in rng.choice(_LISTED)[:2])
        spec = {"first": first, "second": second, "forked": True}
        # an equal run goes on with the parts that it finds, and deletes them when it is done
        if "contest" in first and first != second and rng.random() < 0.2:
            yield spec | {"parts": True}
        else:
            yield spec | {"delay": round(rng.uniform(0.0, 1.0), 3)}


def attempt(spec: dict[str, Any], place: Any, server: Any) -> str | None:
    """Returns what is wrong with the ends of two runs or with what they leave."""
    del server
    known = {}
    for name in {spec["first"], spec["second"]}:
        found = reference(name, place)
        if isinstance(found, str):
            return found
        known[name] = found
    with place.folder() as folder:
        (folder / OUT).mkdir()
        if spec.get("parts"):
            return _over_parts(spec, place, folder)
        more: list[str] = []
        seconds = known[spec["first"]][1]
        if "cut" in spec:
            run = RUNS[spec["first"]]
            place.start(run.command, run.line, folder).wait(spec["cut"] * seconds)
            more = ["--resume"] if any((folder / OUT).glob("seed_*/run.json")) else []
        both = []
        for name in (spec["first"], spec["second"]):
            both.append(place.start(RUNS[name].command, [*RUNS[name].line, *more], folder))
            time.sleep(spec["delay"] * seconds if len(both) == 1 else 0.0)
        ends = [running.wait(LIMIT) for running in both]
        for ended in ends:
            fault: str | None = ended.fault((0, 1, 2))
            if fault:
                return fault
        done = [name for name, ended in zip((spec["first"], spec["second"]), ends, strict=True) if ended.status == 0]
        if not done:
            return f"neither ends well: {ends[0].err.strip()} / {ends[1].err.strip()}"
        if len(set(done)) == 2:
            return "two different runs end well in one folder: one's results are lost"
        return differs(done[0], folder / OUT, known[done[0]][0])


def _over_parts(spec: dict[str, Any], place: Any, folder: Path) -> str | None:
    """Runs the second over what the first has left unfinished; the first's parts must still be there."""
    run, other = RUNS[spec["first"]], RUNS[spec["second"]]
    running = place.start(run.command, run.line, folder)
    until = time.monotonic() + LIMIT
    while not (parts := parts_of(folder)) and time.monotonic() < until:
        if running.ended():
            return None
        time.sleep(0.01)
    running.wait(0.0)
    parts = parts_of(folder)
    ended = place.run(other.command, other.line, folder, LIMIT)
    fault: str | None = ended.fault((0, 1, 2))
    lost = [each for each in parts if not each.exists()]
    return fault or (f"{len(lost)} parts of the other run are lost" if lost else None)
