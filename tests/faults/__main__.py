"""Looks for faults: python tests/faults --minutes 10

Random settings and actions under bounds checking, damaged files, kills, crowded and foreign folders, full disks and
wrong command lines, until the time is over. Every group has `trials`, an endless or finite stream of JSON objects drawn
from a random generator with what once went wrong first, and `attempt`, which does one of them and says what is wrong
with the outcome. Everything runs on a copy of the package, in processes that end with this one.
"""

import collections
import dataclasses
import hashlib
import json
import random
import re
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import commands
import files
import runs
import steps
from place import NotTried, Place

from wayfield.system.command_line import Finite, Names, OneLineErrors
from wayfield.system.storage import locked, write_whole

FINDINGS = "findings"
_ALIKE = 3  # findings of one kind that are kept and told; all are counted
GROUPS: dict[str, tuple[Any, float]] = {  # each with its share of the time
    "steps": (steps, 0.28), "files": (files, 0.22), "commands": (commands, 0.14), "kills": (runs.Kills, 0.12),
    "together": (runs.Together, 0.10), "foreign": (runs.Foreign, 0.08), "disk": (runs.Disk, 0.06),
}  # fmt: skip


@dataclasses.dataclass
class Count:
    """What a group has done."""

    tried: int = 0
    failed: int = 0
    steps: int = 0
    seconds: float = 0.0
    left: dict[str, int] = dataclasses.field(default_factory=dict)  # trials that cannot be done here, by the reason

    def __str__(self) -> str:
        moved = f", {self.steps:,} steps" if self.steps else ""
        left = "".join(f"; {count} not tried: {why}" for why, count in self.left.items())
        return f"{self.tried:,} tried, {self.failed:,} failed, {self.seconds:.1f} s{moved}{left}"


class Interrupted(click.ClickException):
    """The campaign was stopped; the message says what it has done."""

    exit_code = 130


def run(place: Place, names: Sequence[str], minutes: float, seed: int, out: Path, counts: dict[str, Count]) -> None:
    """Does what each group can in its share of the time, one trial at least, and counts."""
    whole = sum(GROUPS[name][1] for name in names)
    left = 60.0 * minutes
    for name in names:
        began = time.monotonic()
        counts[name] = Count()
        try:
            _group(place, name, seed, began + left * GROUPS[name][1] / whole, out, counts[name])
        finally:  # what a campaign that is stopped has done counts too
            counts[name].seconds = round(time.monotonic() - began, 1)
        whole -= GROUPS[name][1]
        left = max(0.0, left - counts[name].seconds)


def _group(place: Place, name: str, seed: int, until: float, out: Path, count: Count) -> None:
    """Tries until the time is over, and counts; one that may take longer than what is left is left out."""
    alike: collections.Counter[tuple[str, str]] = collections.Counter()
    # not the seed alone: groups would draw the same numbers
    source = random.Random(int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:8], "little"))
    before = place.inside.steps
    for spec in GROUPS[name][0].trials(source):
        if not count.tried or spec.get("limit", 0.0) <= until - time.monotonic():
            try:
                problem = GROUPS[name][0].attempt(spec, place)
                count.tried += 1
            except NotTried as reason:
                problem = None
                count.left[str(reason)] = count.left.get(str(reason), 0) + 1
            count.steps = place.inside.steps - before
            if problem:
                count.failed += 1
                alike[_kind(spec, problem)] += 1
                if alike[_kind(spec, problem)] <= _ALIKE:
                    click.echo(f"{name}: {problem}\n    {kept(out, name, spec, problem)}: {_brief(spec)}")
        if time.monotonic() > until:
            return


def repeated(place: Place, file: Path) -> str | None:
    """Returns what is wrong with a trial that was kept, done again; ValueError if the file keeps no trial."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        group, spec = GROUPS[content["group"]][0], dict(content["trial"])
    except (OSError, ValueError, TypeError, LookupError, RecursionError) as error:
        raise ValueError(f"{file} keeps no trial of a fault campaign: {error}") from None
    try:
        return group.attempt(spec, place)
    except NotTried as reason:
        raise click.ClickException(f"not tried: {reason}") from None


def kept(out: Path, group: str, spec: dict[str, Any], problem: str) -> Path:
    """Writes a trial with what was wrong with it; returns the file."""
    content = {"group": group, "problem": problem, "trial": spec}
    name = hashlib.sha256(json.dumps(spec, sort_keys=True).encode()).hexdigest()[:12]
    (out / FINDINGS).mkdir(exist_ok=True)
    file = out / FINDINGS / f"{group}_{name}.json"
    write_whole(file, (json.dumps(content, indent=2) + "\n").encode())
    return file


def _kind(spec: dict[str, Any], problem: str) -> tuple[str, str]:
    """Returns what findings of one cause have in common: where, and the problem without its numbers and names."""
    where = str(spec.get("reader") or spec.get("mutated") or spec.get("command") or spec.get("run") or "")
    return where, re.sub(r"[0-9]+|'[^']*'|\"[^\"]*\"|/\S+", "", problem)[:80]


def _brief(spec: dict[str, Any]) -> str:
    text = json.dumps({key: value for key, value in spec.items() if key != "content"})
    return text if len(text) < 300 else f"{text[:300]}..."


def _stop(*_: object) -> None:
    raise KeyboardInterrupt


@click.command("faults", cls=OneLineErrors)
@click.option("--minutes", type=Finite(0.0, 10_000.0, min_open=True), default=10.0, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help="Of all that is drawn.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("results/faults"),
              show_default=True, help="Folder of the findings and of the copy that is worked on.")  # fmt: skip
@click.option("--only", type=Names("--only", GROUPS), help=f"Only these groups of {', '.join(GROUPS)}.")
@click.option("--repeat", type=click.Path(path_type=Path, dir_okay=False), help="Does one finding's trial again.")
def main(minutes: float, seed: int, out: Path, only: tuple[str, ...] | None, repeat: Path | None) -> None:
    """Looks for faults: damaged files, random settings, kills, crowded folders, full disks, wrong command lines.

    Prints how many trials each group did and how many went wrong; ends with status 1 if any did. Every finding is kept
    in OUT/findings, for --repeat. Works on a copy of the package.
    """
    if not out.name:
        raise click.UsageError("--out is empty; it must name a folder")
    out.mkdir(parents=True, exist_ok=True)
    for number in (signal.SIGTERM, signal.SIGINT):  # jobs in the background ignore the second
        signal.signal(number, _stop)
    counts: dict[str, Count] = {}
    with locked(out / ".lock", f"another campaign works in {out}"):
        place = Place(out)
        try:
            if repeat is not None:
                problem = repeated(place, repeat)
                click.echo(problem or "nothing is wrong any more")
                sys.exit(1 if problem else 0)
            run(place, only or tuple(GROUPS), minutes, seed, out, counts)
        except ValueError as error:
            raise click.UsageError(str(error)) from None
        except KeyboardInterrupt:
            told = "; ".join(f"{name}: {count}" for name, count in counts.items())
            raise Interrupted(f"interrupted; {told or 'nothing was tried'}") from None
        finally:
            place.close()
    for name, count in counts.items():
        click.echo(f"{name:10} {count}")
    sys.exit(1 if any(count.failed for count in counts.values()) else 0)


if __name__ == "__main__":
    main()
