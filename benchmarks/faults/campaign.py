"""Runs the groups for their share of the time, counts, and keeps what is wrong so that it can be repeated."""

import collections
import dataclasses
import hashlib
import json
import random
import re
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from wayfield.benchmarks.faults import commands, disk, files, foreign, kills, steps, together
from wayfield.benchmarks.faults.place import Place
from wayfield.benchmarks.faults.server import Server
from wayfield.envs.storage import write_whole

FINDINGS, TOTALS = "findings", "totals.json"
_ALIKE = 3  # findings of one kind that are kept and told; all are counted


@dataclasses.dataclass(frozen=True)
class Group:
    """A kind of trial, and its share of the time."""

    share: float
    trials: Callable[[random.Random], Iterator[dict[str, Any]]]
    attempt: Callable[[dict[str, Any], Any, Any], str | None]


GROUPS = {
    module.__name__.rpartition(".")[2]: Group(share, module.trials, module.attempt)
    for module, share in (
        (steps, 0.28),
        (files, 0.22),
        (commands, 0.14),
        (kills, 0.12),
        (together, 0.10),
        (foreign, 0.08),
        (disk, 0.06),
    )
}


@dataclasses.dataclass
class Count:
    """What a group has done."""

    tried: int = 0
    failed: int = 0
    steps: int = 0
    seconds: float = 0.0


def run(place: Place, names: Sequence[str], minutes: float, seed: int, told: Callable[[str], None]) -> dict[str, Count]:
    """Returns what each group did in its share of the time; every group does one trial at least.

    Args:
        told: receives a line for each finding, as it is found.
    """
    counts: dict[str, Count] = {}
    whole = sum(GROUPS[name].share for name in names)
    left = 60.0 * minutes
    for name in names:
        share = GROUPS[name].share
        began = time.monotonic()
        counts[name] = Count()
        try:
            _group(place, name, seed, began + left * share / whole, told, counts[name])
        finally:  # what a campaign that is stopped has done counts too
            counts[name].seconds = round(time.monotonic() - began, 1)
            _add(place.out / TOTALS, {name: counts[name]})
        whole -= share
        left = max(0.0, left - counts[name].seconds)
    return counts


def _group(place: Place, name: str, seed: int, until: float, told: Callable[[str], None], count: Count) -> None:
    """Tries until the time is over, and counts; one that may take longer than what is left is left out."""
    alike: collections.Counter[tuple[str, str]] = collections.Counter()
    server = Server(place, **steps.BOUNDS)
    # not the seed alone: groups would draw the same numbers
    source = random.Random(int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:8], "little"))
    try:
        for spec in GROUPS[name].trials(source):
            if count.tried and spec.get("limit", 0.0) > until - time.monotonic():
                continue
            problem = _attempt(name, spec, place, server)
            count.tried += 1
            if problem:
                count.failed += 1
                alike[_kind(spec, problem)] += 1
                if alike[_kind(spec, problem)] <= _ALIKE:
                    told(f"{name}: {problem}\n    {kept(place.out, name, spec, problem)}: {_brief(spec)}")
            if time.monotonic() > until:
                break
    finally:
        count.steps = server.steps
        server.close()


def _attempt(name: str, spec: dict[str, Any], place: Place, server: Server) -> str | None:
    """Does a trial here or, where its commands are to be forks, in the worker that they are forked from."""
    if spec.get("forked"):
        return server.ask("forks", {"group": name, "trial": spec})
    return GROUPS[name].attempt(spec, place, server)


def repeated(place: Place, file: Path) -> str | None:
    """Returns what is wrong with a trial that was kept, done again.

    Raises:
        ValueError: if the file keeps no trial.
    """
    try:
        kept_before = json.loads(file.read_text(encoding="utf-8"))
        name, spec = str(kept_before["group"]), dict(kept_before["trial"])
        GROUPS[name]
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise ValueError(f"{file} keeps no trial of a fault campaign: {error}") from None
    server = Server(place, **steps.BOUNDS)
    try:
        return _attempt(name, spec, place, server)
    finally:
        server.close()


def kept(out: Path, group: str, spec: dict[str, Any], problem: str) -> Path:
    """Writes a trial with what was wrong with it; returns the file."""
    content = {"group": group, "problem": problem, "trial": spec}
    name = hashlib.sha256(json.dumps(spec, sort_keys=True).encode()).hexdigest()[:12]
    (out / FINDINGS).mkdir(exist_ok=True)
    file = out / FINDINGS / f"{group}_{name}.json"
    write_whole(file, (json.dumps(content, indent=2) + "\n").encode())
    return file


def _add(file: Path, counts: dict[str, Count]) -> None:
    """Adds to the totals of all campaigns in this folder."""
    totals = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for name, count in counts.items():
        before = totals.get(name, {})
        totals[name] = {key: round(before.get(key, 0) + value, 1) for key, value in dataclasses.asdict(count).items()}
    write_whole(file, (json.dumps(totals, indent=2) + "\n").encode())


def totals_of(out: Path) -> dict[str, dict[str, float]]:
    """Returns the sums over all campaigns in a folder."""
    totals: dict[str, dict[str, float]] = json.loads((out / TOTALS).read_text(encoding="utf-8"))
    return totals


def _kind(spec: dict[str, Any], problem: str) -> tuple[str, str]:
    """Returns what findings of one cause have in common: where, and the problem without its numbers and names."""
    where = str(spec.get("reader") or spec.get("mutated") or spec.get("command") or spec.get("run") or "")
    return where, re.sub(r"[0-9]+|'[^']*'|\"[^\"]*\"|/\S+", "", problem)[:80]


def _brief(spec: dict[str, Any]) -> str:
    text = json.dumps({key: value for key, value in spec.items() if key != "content"})
    return text if len(text) < 300 else f"{text[:300]}..."
