"""Whether sets of gains that are named after a search have the record of one, and rows the budget that was spent."""

import itertools
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from typing import Any

from wayfield.benchmarks.contests import ALL_CONTESTS, BY_HAND, ROBUST_LEVEL
from wayfield.benchmarks.runs.shards import in_frames
from wayfield.benchmarks.tuning.tune import searched_families
from wayfield.envs.scenarios import splits
from wayfield.policies.parts.tuned import PACE, condition
from wayfield.system.readers import of_path, reader

Row = Mapping[str, str]

LEVELS = {"tuned": "none", "robust": ROBUST_LEVEL}  # of disturbance, by the name of a set
SPENT = 0.5  # of the frames that a search asks for: one that ends far before has compared a few sets


@reader("gains for the audit", "lqr.json", {"lqr.json": '{"policy": "lqr", "gains": {"q_e": 40.0}}'}, of_path)
def read_gains_file(file: Any) -> dict[str, Any] | None:
    """Returns the content of a gains file, None where it is none."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return None
    whole = isinstance(content, dict) and isinstance(content.get("gains"), dict) and "policy" in content
    return content if whole else None


def shipped_gains() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields the sets of gains that ship, each with the name of its file."""
    for folder in (resources.files("wayfield.policies") / "gains").iterdir():
        for file in folder.iterdir() if folder.is_dir() else ():
            if file.name.endswith(".json") and (content := read_gains_file(file)) is not None:
                yield f"{folder.name}/{file.name}", content


def missing_records(sets: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yields what a set that says it was searched for lacks of the record of its search, a line each."""
    for name, content in sets.items():
        if content.get("chosen") != "search":
            continue
        for fault in _faults(content):
            yield f"{name} is called {_called(content)!r}: {fault}"


def _called(content: Mapping[str, Any]) -> str:
    return next((name for name, level in LEVELS.items() if level == content.get("level")), "searched")


def _faults(content: Mapping[str, Any]) -> Iterator[str]:
    words = shlex.split(str(content.get("command", "")))
    given: dict[str, list[str]] = {}
    for option, value in itertools.pairwise(words):
        if option.startswith("--"):
            given.setdefault(option, []).append(value)
    for option in ("--suite", "--robot", "--speed"):
        wanted = content.get(option[2:])
        if given.get(option) != [f"{wanted:g}" if isinstance(wanted, int | float) else f"{wanted}"]:
            yield f"its command is not for {option[2:]} {wanted}"
    levels = given.get("--level", []) + given.get("--also", [])
    if content.get("policy") not in words or content.get("level") not in levels:
        yield f"its command is not for {content.get('policy')} under the disturbance {content.get('level')}"
    asked, spent = given.get("--frames", ["0"])[0], content.get("frames", 0)
    if not asked.isdigit() or int(asked) < 1:
        yield "no budget is printed"
    elif spent < SPENT * int(asked):
        yield f"of {asked} frames that were asked for {spent} were driven"
    searched_on, validation = content.get("searched_on", {}), content.get("validation", {})
    if searched_on.get("split") != "train":
        yield f"it was searched for on the split {searched_on.get('split')!r}"
    contest = ALL_CONTESTS[content["suite"]]
    whole = len(searched_families(contest)) * splits.SPLITS["validation"] * max(len(levels), 1)
    there = validation.get("chosen", {}).get("episodes", 0)
    if there < whole:
        yield f"its finalists drove {there} of {whole} episodes of the validation split"
    finalists = validation.get("finalists", {})
    winner = finalists.get(validation.get("winner"), {}).get("gains")
    if finalists and winner != content["gains"]:
        yield "it is not the set that won among its finalists"


def misnamed_rows(rows: Sequence[Row], sets: Mapping[str, Mapping[str, Any]], where: str) -> Iterator[str]:
    """Yields the sets of gains of rows that are called otherwise than what ships, or print another budget, a line each.

    Sets of conditions that nothing ships for any more are among them.
    """
    names = {name: ("search", level) for name, level in LEVELS.items()}
    names |= {by_hand: ("hand", LEVELS[name]) for name, by_hand in BY_HAND.items()}
    seen = {
        (row["contest"], row["policy"], row["robot"], row["speed"] or pace_of(row["contest"]), row["gains_name"],
         row["gains"]): row["learned_from"]
        for row in rows
        if row["gains_name"] in names
    }  # fmt: skip
    for (suite, policy, robot, speed, called, gains), told in seen.items():
        chosen, level = names[called]
        file = f"{ALL_CONTESTS[suite].gains_suite}/{policy}_{condition(robot, float(speed), level)}.json"
        content = sets.get(file)
        what = f"{where}: {policy} ({called}) at {speed} m/s"
        if content is None or content.get("chosen") != chosen:
            yield f"{what}: {file} is {'missing' if content is None else content.get('chosen')}"
        elif not holds(content, gains):
            yield f"{what} was driven with other gains than those of {file}"
        elif told.partition(",")[0] != in_frames(content["frames"]):
            yield f"{what} prints {told}, {file} has {in_frames(content['frames'])}"


def pace_of(contest: str) -> str:
    """Returns the speed (m/s) that a contest asks for where a row says none."""
    rules = ALL_CONTESTS[contest].rules
    return f"{rules.speed if rules else PACE:g}"


def holds(content: Mapping[str, Any], gains: str, apart: frozenset[str] = frozenset()) -> bool:
    """Returns whether a set of gains is what stands in a row, but for the gains of the names that are set apart."""
    words = dict(word.split("=", 1) for word in gains.split() if "=" in word)
    wanted = {name: f"{each:g}" if isinstance(each, float) else f"{each}" for name, each in content["gains"].items()}
    return all(words.get(name) == each for name, each in wanted.items() if name not in apart)
