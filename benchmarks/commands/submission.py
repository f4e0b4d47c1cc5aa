"""A submission: one entry of a contest in a folder that anyone can drive again, and what driving it again shows.

A drive gives the same bits on every machine, so an entry needs no trust. Its folder holds `card.json` (the entry,
versions, and digests of code, policy, scenarios and each episode) and `rows.csv.xz` (its episodes as the run wrote
them). Nothing in it is run: a policy from outside of the package is what the user names.
"""

import csv
import dataclasses
import hashlib
import io
import json
import lzma
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from wayfield.benchmarks.commands.contest_options import seed_of
from wayfield.benchmarks.contests import (
    ALL_CONTESTS,
    CROWD_SUITES,
    GAINS_NAMES,
    OWN_SPLIT,
    PUBLIC_SPLIT,
    Course,
    Entrants,
)
from wayfield.benchmarks.entrants.own_policies import OWN
from wayfield.benchmarks.leaderboards.entries import COMPARED
from wayfield.benchmarks.records.cases import Case, Entrant
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.results import EPISODES, read_table
from wayfield.benchmarks.runs.shards import played
from wayfield.benchmarks.runs.suite import Setting
from wayfield.envs.scenarios import splits
from wayfield.policies.learned.reading import parsed_object
from wayfield.system.checks import MOST_BYTES
from wayfield.system.identity import differences, identity, source_digest
from wayfield.system.readers import of_folder, reader

CARD, ROWS = "card.json", "rows.csv.xz"
_ENTRY = ("contest", "robot", "policy", "gains_name", "split")
_OF_A_CASE = ("scenario", "gains", "agent_seed", "dynamics", "actuators", "disturbance", "suite")
_CONDITIONS = ("dynamics", "actuators", "disturbance")
_NEEDED = (*_ENTRY, *_OF_A_CASE[:1], *_CONDITIONS, "suite", "family", "episode", "seed", "success")
_WORDS = ("trajectory", "learned_from", "parameters")  # which describe an entry, and are no behaviour
FIRST = 2  # episodes of a case of the sample

Row = Mapping[str, str]


class Refused(ValueError):
    """A submission does not hold what it says; the message is one line."""


@dataclasses.dataclass(frozen=True)
class Submission:
    """An entry of a contest: its card, and its episodes as text."""

    card: Mapping[str, Any]
    rows: Sequence[Row]


def made(run: Path, entry: str, entrant: Entrant | None) -> Submission:
    """Returns the submission of an entry of a finished run, named as "policy" or "policy (gains)".

    Args:
        entrant: what the user named as a policy of their own, where the entry is one.

    Raises:
        Refused: if the run has no such entry, or its scenarios are no frozen ones.
        OSError: if a file cannot be read.
    """
    every = read_table(run / EPISODES, lambda names, lines: [dict(zip(names, line, strict=True)) for line in lines])
    mine = [row for row in every if row.get("split") in COMPARED and entry in (row["policy"], _name(row))]
    mine = [row for row in mine if _name(row) == entry] or mine
    if not mine:
        there = ", ".join(dict.fromkeys(_name(row) for row in every if row.get("split") in COMPARED))
        raise Refused(f"{run} has no entry {entry!r}; it has {there or 'none of a contest'}")
    if len({tuple(row[name] for name in (*_ENTRY, *_CONDITIONS)) for row in mine}) > 1:
        raise Refused(f"{run}: {entry!r} drove in several contests, robots, splits or conditions; give a run of one")
    if mine[0]["split"] in (OWN_SPLIT, PUBLIC_SPLIT):
        raise Refused(f"{run}: a submission is of frozen scenarios, not of split {mine[0]['split']!r}")
    if (entrant is not None) != _is_own(mine[0]):
        raise Refused(f"{entry!r} is {'no ' if entrant else 'a '}policy of your own: give --policy for those alone")
    if entrant is None and mine[0]["gains_name"] not in GAINS_NAMES:
        raise Refused(f"{entry!r} are agents of a folder: enter them by --policy, a function that makes the policy ppo")
    _check_suite(mine)
    _check_seeds(mine)
    kept = [name for name in mine[0] if name != "trajectory" and any(row[name] for row in mine)]
    rows = [{name: row[name] for name in kept} for row in mine]
    card = {
        "entry": {name: rows[0].get(name, "") for name in _ENTRY},
        "code": source_digest(),
        "policy": getattr(entrant, "digest", ""),
        "scenarios": {case: _geometry(case, rows[0]) for case in dict.fromkeys(row["scenario"] for row in rows)},
        "versions": identity(),
        "episodes": [signed(row) for row in rows],
    }
    return Submission(card, rows)


def content(submission: Submission) -> dict[str, bytes]:
    """Returns the files of a submission by name."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(list(submission.rows[0]))
    writer.writerows(row.values() for row in submission.rows)
    packed = lzma.compress(text.getvalue().encode(), preset=9 | lzma.PRESET_EXTREME)
    return {CARD: (json.dumps(submission.card, indent=1) + "\n").encode(), ROWS: packed}


_SAMPLE_ROWS = [
    {"contest": "path-following", "robot": "p3dx", "policy": "lqr", "gains_name": "default", "split": "test"}
]


def _write_sample(folder: Path) -> None:
    rows = [row | dict.fromkeys(_NEEDED[len(_ENTRY) :], "0") for row in _SAMPLE_ROWS]
    card = {"entry": _SAMPLE_ROWS[0], "code": "", "policy": "", "scenarios": {}, "versions": {}}
    sample = Submission(card | {"episodes": [signed(row) for row in rows]}, rows)
    for name, data in content(sample).items():
        (folder / name).write_bytes(data)


@reader("card of a submission", CARD, _write_sample, of_folder)
@reader("episodes of a submission", ROWS, _write_sample, of_folder)
def read_submission(folder: Path) -> Submission:
    """Returns what a folder holds.

    Raises:
        Refused: if it is damaged; the message names the file, or the first episode that is not as its card has it.
        OSError: if a file cannot be opened.
    """
    if gone := next((name for name in (CARD, ROWS) if not (folder / name).is_file()), ""):
        raise Refused(f"{folder / gone} is missing: a submission is {CARD} and {ROWS}, as `wayfield submit` wrote them")
    try:
        card = parsed_object((folder / CARD).read_bytes(), str(folder / CARD))
    except ValueError as error:
        raise Refused(str(error)) from None
    kinds = {"entry": dict, "code": str, "policy": str, "scenarios": dict, "versions": dict, "episodes": list}
    for name, kind in kinds.items():
        if not isinstance(card.get(name), kind):
            raise Refused(f"{folder / CARD}: {name} is missing, or no {kind.__name__}")
    rows = _unpacked((folder / ROWS).read_bytes(), folder / ROWS)
    missing = [name for name in _NEEDED if name not in rows[0]]
    if missing:
        raise Refused(f"{folder / ROWS} has no column {', '.join(missing)}")
    if len(rows) != len(card["episodes"]):
        raise Refused(f"{folder / ROWS} has {len(rows)} episodes, its card {len(card['episodes'])}")
    for row, digest in zip(rows, card["episodes"], strict=True):
        if signed(row) != digest:
            raise Refused(f"{folder / ROWS}: {place(row)} is not as the card has it")
        if {name: row[name] for name in _ENTRY} != card["entry"]:
            raise Refused(f"{folder / ROWS}: {place(row)} is of another entry than the card's")
        if not re.fullmatch(r"0|[1-9]\d{0,8}", row["episode"], re.ASCII):
            raise Refused(f"{folder / ROWS}: {row['episode']!r} is no number of an episode")
        if other := next((name for name in _CONDITIONS if row[name] != rows[0][name]), None):
            raise Refused(f"{folder / ROWS}: {place(row)} has other {other} than the first")
    return Submission(card, rows)


def _unpacked(data: bytes, file: Path) -> list[Row]:
    """Returns the rows of packed CSV; Refused, naming the file, if it is none, or more than any of ours."""
    try:
        unpacker = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=2**28)
        text = unpacker.decompress(data, MOST_BYTES).decode()
        if not unpacker.eof:
            raise ValueError("it is cut off, or too large")
        names, *lines = list(csv.reader(io.StringIO(text), strict=True))
        rows: list[Row] = [dict(zip(names, line, strict=True)) for line in lines]
    except (lzma.LZMAError, EOFError, UnicodeDecodeError, csv.Error, ValueError) as error:
        raise Refused(f"{file} holds no packed rows: {error}") from None
    if not rows or len(set(names)) < len(names):
        raise Refused(f"{file} holds no rows, or a column twice")
    return rows


def place(row: Row) -> str:
    """Returns which episode a row is, in words."""
    seed = f", agent {row['agent_seed']}" if row.get("agent_seed") else ""
    return f"episode {row['episode']} of {row['scenario']}{seed}"


def check(submission: Submission, entrant: Entrant | None) -> str:
    """Returns what is to be said of a submission: what it leaves out, and how code and policy here differ; "" of none.

    Args:
        entrant: what the user named as the policy, for an entry from outside of the package.

    Raises:
        Refused: if its scenarios or seeds are others than those here, or its policy was not named.
    """
    card, rows = submission.card, submission.rows
    if card["entry"]["contest"] not in ALL_CONTESTS:
        raise Refused(f"there is no contest {card['entry']['contest']!r}")
    for scenario in dict.fromkeys(row["scenario"] for row in rows):
        if not (here := _geometry(scenario, rows[0])) or card["scenarios"].get(scenario) != here:
            first = next(row for row in rows if row["scenario"] == scenario)
            raise Refused(f"its scenarios {scenario!r} are not those of this version, from {place(first)} on")
    _check_suite(rows)
    _check_seeds(rows)
    if _is_own(card["entry"]) != (entrant is not None):
        needs = "a policy of somebody's own: name it with --policy to run it"
        raise Refused(f"{card['entry']['policy']!r} is {needs if entrant is None else 'no policy of your own'}")
    found = [each] if (each := left_out(submission)) else []
    if card["code"] != source_digest():
        found.append(f"it was driven by other code ({differences(dict(card['versions']), identity())})")
    if entrant is not None and getattr(entrant, "digest", "") != card["policy"]:
        found.append("the policy is another file than the one that drove")
    return "; ".join(found)


def left_out(submission: Submission) -> str:
    """Returns what an entry of its contest has to drive and this one has not, in words; "" of a whole one.

    A whole one has as many scenarios of every family of the contest, and of agents that ship every one.
    """
    rows = submission.rows
    contest = ALL_CONTESTS[rows[0]["contest"]]
    counts: dict[tuple[str, str], int] = {}
    for row in rows:
        key = row["family"], row.get("agent_seed", "")
        counts[key] = counts.get(key, 0) + 1
    ships = rows[0]["gains_name"] == "trained"
    seeds = [f"{seed}" for seed in contest.agents_of(rows[0]["policy"], rows[0]["robot"])] if ships else [""]
    wanted = [(family, seed) for family in contest.families(rows[0]["dynamics"]) for seed in seeds]
    if gone := next((each for each in wanted if each not in counts), None):
        return f"it leaves out {gone[0]}{f', agent {gone[1]}' if gone[1] else ''}"
    return "it has more scenarios of one family than of another" if len({*counts.values()}) > 1 else ""


def _check_suite(rows: Sequence[Row]) -> None:
    """Raises Refused if an episode is labelled as of a suite that is not its contest's own."""
    contest = rows[0]["contest"]
    own = next((suite for suite, held in CROWD_SUITES.items() if contest in held), contest)
    if wrong := next((row for row in rows if row["suite"] != own), None):
        raise Refused(f"{place(wrong)}: its suite is {wrong['suite']!r}, that of the contest {own!r}: drive that suite")


def _check_seeds(rows: Sequence[Row]) -> None:
    """Raises Refused if an episode's seed is not the one that everybody else drives with."""
    for row in rows:
        family, _, split = row["scenario"].partition("/")
        if row["seed"] != (wanted := f"{seed_of(0, split, family) + int(row['episode'])}"):
            raise Refused(f"{place(row)}: its seed is {row['seed']}, that of the contest {wanted}: drive with --seed 0")


def _is_own(row: Row) -> bool:
    return row["gains_name"].partition(" ")[0] == OWN


def differing(submission: Submission, entrant: Entrant | None, most: int | None) -> tuple[int, str]:
    """Returns how many episodes were driven again, and the first that came out otherwise, in words; "" where none did.

    Args:
        most: cases that are driven, the first `FIRST` episodes of each, spread over the submission; None: everything.

    Raises:
        Refused: if no entry of this version has such gains.
    """
    cases = list(_cases(submission.rows))
    if most is not None:
        cases = [rows[:FIRST] for rows in cases[:: max(len(cases) // most, 1)][:most]]
    driven = 0
    for rows in cases:
        setting = _setting(rows, entrant)
        today = _texts(setting)
        driven += len(rows)
        for now, row in zip(today, rows, strict=True):
            wrong = _first_difference(now, row)
            if wrong:
                again = _texts(setting)
                if again != today:
                    return driven, f"{place(row)}: the policy is not deterministic, two drives of it differ"
                if wrong not in now:
                    return driven, f"{place(row)}: {wrong} is no column of this version"
                return driven, f"{place(row)}: {wrong} is {now[wrong]}, submitted as {row[wrong]:.40}"
    return driven, ""


def _first_difference(now: Row, row: Row) -> str:
    return next((name for name, cell in row.items() if name not in _WORDS and now.get(name, "") != cell), "")


def _cases(rows: Sequence[Row]) -> Iterator[list[Row]]:
    """Yields the rows of each case, whose episodes are the first ones of its scenarios."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row.get(name, "") for name in _OF_A_CASE), []).append(row)
    for case in found.values():
        yield sorted(case, key=lambda row: int(row["episode"]) if row["episode"].isdigit() else 0)


def _setting(rows: Sequence[Row], entrant: Entrant | None) -> Setting:
    row = rows[0]
    if [each["episode"] for each in rows] != [f"{k}" for k in range(len(rows))]:
        raise Refused(f"{place(row)}: the episodes of a case must be the first ones, each once")
    return Setting(row["suite"], _case(row, entrant), row["dynamics"], row["actuators"], int(row["seed"]), len(rows))


def _case(row: Row, entrant: Entrant | None) -> Case:
    contest = ALL_CONTESTS[row["contest"]]
    family, _, split = row["scenario"].partition("/")
    entrants = (
        Entrants((row["policy"],), ("default", "tuned", "robust", "paper"))
        if entrant is None
        else Entrants((), own=(entrant,))
    )
    for case in contest.cases(row["robot"], Course(family, split), entrants, row["disturbance"]):
        if (case.gains_name, case.gains_text) == (row["gains_name"], row.get("gains", "")):
            return case
    whose = "no entry of this version has" if entrant is None else "the policy that was named has not"
    raise Refused(f"{place(row)}: {whose} the gains {row.get('gains', '')!r}")


def _texts(setting: Setting) -> list[Row]:
    found = Episodes([row for row, _ in played(setting)])
    columns = {name: found.texts(name) for name in found.names}
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


def _geometry(scenario: str, row: Row) -> str:
    """Returns the digest of the frozen scenarios of a name; "" where there are none."""
    family, _, split = scenario.partition("/")
    try:
        return splits.digest(splits.split(ALL_CONTESTS[row["contest"]].spec.name, family, split))
    except (KeyError, ValueError):
        return ""


def signed(row: Row) -> str:
    """Returns the digest of an episode, as a card has it."""
    text = json.dumps(sorted((name, cell) for name, cell in row.items() if cell), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _name(row: Row) -> str:
    return row["policy"] if row["gains_name"] == "default" else f"{row['policy']} ({row['gains_name']})"
