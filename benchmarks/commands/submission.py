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
from collections.abc import Collection, Iterator, Mapping, Sequence
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
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.scenarios import splits
from wayfield.system.checks import choose, shown
from wayfield.system.identity import differences, identity, source_digest
from wayfield.system.readers import of_folder, reader
from wayfield.system.reading import parsed_object, read_bytes
from wayfield.system.unpacking import xz_rows

CARD, ROWS = "card.json", "rows.csv.xz"
_ENTRY = ("contest", "robot", "policy", "gains_name", "split")
_OF_A_CASE = ("scenario", "gains", "agent_seed", "dynamics", "actuators", "disturbance", "suite")
_CONDITIONS = ("dynamics", "actuators", "disturbance")
NEEDED = (*_ENTRY, *_OF_A_CASE[:1], *_CONDITIONS, "suite", "family", "episode", "seed", "success")
_WORDS = ("trajectory", "learned_from", "parameters")  # which describe an entry, and are no behaviour
FIRST = 2  # episodes of a case of the sample
_MOST_CARD = 2**22  # bytes; the largest entry of a contest has 20,000 episodes, of some 500 bytes each
_MOST_ROWS = 2**24  # bytes, packed
_MOST_TEXT = 2**26  # bytes of all rows
_LONGEST = 2**13  # bytes of one

Row = Mapping[str, str]


class PackedRows(Collection[Row]):
    """Rows that stay packed, and are unpacked one by one each time that they are gone through.

    Args:
        content: of the file of rows.
        count: how many there are.
    """

    def __init__(self, content: bytes, count: int) -> None:
        self._content, self._count = content, count

    def __len__(self) -> int:
        return self._count

    def __contains__(self, row: object) -> bool:
        return any(row == each for each in self)

    def __iter__(self) -> Iterator[Row]:
        """Yields the rows; csv.Error, ValueError, EOFError or lzma.LZMAError where the content is damaged."""
        lines = xz_rows(self._content, _LONGEST, _MOST_TEXT)
        names = next(lines, [])
        if len(set(names)) < len(names):
            raise ValueError("it holds a column twice")
        for k, line in enumerate(lines):
            if len(line) != len(names):
                raise ValueError(f"row {k} has {len(line)} cells, its header {len(names)}")
            yield dict(zip(names, line, strict=True))


class Refused(ValueError):
    """A submission does not hold what it says; the message is one line."""


@dataclasses.dataclass(frozen=True)
class Submission:
    """An entry of a contest: its card, and its episodes as text."""

    card: Mapping[str, Any]
    rows: Collection[Row]

    @property
    def first(self) -> Row:
        """Returns the first row."""
        return next(iter(self.rows))


def made(run: Path, entry: str, entrant: Entrant | None) -> Submission:
    """Returns the submission of an entry of a finished run, named as "policy" or "policy (gains)".

    Args:
        entrant: what the user named as a policy of their own, where the entry is one.

    Raises:
        Refused: if the run has no such entry, or its scenarios are no frozen ones.
        OSError: if a file cannot be read.
    """
    if not (run / EPISODES).is_file():
        raise Refused(f"{run.absolute()} is no finished run: {EPISODES} is missing, which `wayfield evaluate` writes")
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
        "scenarios": {
            case: splits.digest(_scenarios(case, rows[0])) for case in dict.fromkeys(row["scenario"] for row in rows)
        },
        "versions": identity(),
        "episodes": [signed(row) for row in rows],
    }
    return Submission(card, rows)


def content(submission: Submission) -> dict[str, bytes]:
    """Returns the files of a submission by name."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(list(submission.first))
    writer.writerows(row.values() for row in submission.rows)
    packed = lzma.compress(text.getvalue().encode(), preset=9 | lzma.PRESET_EXTREME)
    return {CARD: (json.dumps(submission.card, indent=1) + "\n").encode(), ROWS: packed}


_SAMPLE_ROWS = [
    {"contest": "path-following", "robot": "p3dx", "policy": "lqr", "gains_name": "default", "split": "test"}
]


def _write_sample(folder: Path) -> None:
    rows = [row | dict.fromkeys(NEEDED[len(_ENTRY) :], "0") for row in _SAMPLE_ROWS]
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
        missing = (folder / gone).absolute()
        raise Refused(f"{missing} is missing: a submission is {CARD} and {ROWS}, as `wayfield submit` wrote them")
    try:
        card = _checked(parsed_object(read_bytes(folder / CARD, _MOST_CARD), str(folder / CARD)), folder / CARD)
        content = read_bytes(folder / ROWS, _MOST_ROWS)
    except ValueError as error:
        raise Refused(str(error)) from None
    digests = card.pop("episodes")
    rows = PackedRows(content, len(digests))
    try:
        _check_rows(rows, card["entry"], digests)
    except Refused as error:
        raise Refused(f"{folder / ROWS}{error}") from None
    except (lzma.LZMAError, EOFError, csv.Error, ValueError) as error:
        raise Refused(f"{folder / ROWS} holds no packed rows: {error}") from None
    return Submission(card, rows)


def _checked(card: Mapping[str, Any], file: Path) -> dict[str, Any]:
    """Returns what a card must hold, and nothing else; Refused, naming file and field, if it does not."""
    kinds = {"entry": dict, "code": str, "policy": str, "scenarios": dict, "versions": dict, "episodes": list}
    for name, kind in kinds.items():
        if not isinstance(card.get(name), kind):
            raise Refused(f"{file}: {name} is missing, or no {kind.__name__}")
        texts = [card[name]] if kind is str else card[name].values() if kind is dict else card[name]
        if wrong := [each for each in texts if not isinstance(each, str) or len(each) > _LONGEST]:
            raise Refused(f"{file}: {name} holds {shown(wrong[0])}, which is no short text")
    if sorted(card["entry"]) != sorted(_ENTRY):
        raise Refused(f"{file}: entry holds {shown(list(card['entry']))}; it must be {', '.join(_ENTRY)}")
    if not card["episodes"]:
        raise Refused(f"{file}: episodes is empty")
    return {name: card[name] for name in kinds}


def _check_rows(rows: PackedRows, entry: Mapping[str, str], digests: Sequence[str]) -> None:
    """Raises Refused, naming the first row, unless the rows are as a card has them; the message lacks the file."""
    first: Row = {}
    k = -1
    for k, row in enumerate(rows):
        first = first or row
        if missing := [name for name in NEEDED if name not in row]:
            raise Refused(f" has no column {', '.join(missing)}")
        if k >= len(digests):
            raise Refused(f" has more episodes than the {len(digests)} of its card")
        if signed(row) != digests[k]:
            raise Refused(f": {place(row)} is not as the card has it")
        if {name: row[name] for name in _ENTRY} != entry:
            raise Refused(f": {place(row)} is of another entry than the card's")
        if not re.fullmatch(r"0|[1-9]\d{0,8}", row["episode"], re.ASCII):
            raise Refused(f": {shown(row['episode'])} is no number of an episode")
        if other := next((name for name in _CONDITIONS if row[name] != first[name]), None):
            raise Refused(f": {place(row)} has other {other} than the first")
    if k + 1 < len(digests):
        raise Refused(f" has {k + 1} episodes, its card {len(digests)}")


def place(row: Row) -> str:
    """Returns which episode a row is, in words."""
    seed = f", agent {row['agent_seed']:.20}" if row.get("agent_seed") else ""
    return f"episode {row['episode']:.20} of {row['scenario']:.60}{seed}"


def check(submission: Submission, entrant: Entrant | None) -> str:
    """Returns what is to be said of a submission: what it leaves out, and how code and policy here differ; "" of none.

    Args:
        entrant: what the user named as the policy, for an entry from outside of the package.

    Raises:
        Refused: if its scenarios or seeds are others than those here, or its policy was not named.
    """
    card, rows = submission.card, submission.rows
    _check_names(submission.first, entrant)
    known: dict[str, int] = {}
    for row in rows:
        if (scenario := row["scenario"]) not in known:
            here = _scenarios(scenario, row)
            if not here or card["scenarios"].get(scenario) != splits.digest(here):
                raise Refused(f"its scenarios {shown(scenario)} are not those of this version, from {place(row)} on")
            known[scenario] = len(here)
        if int(row["episode"]) >= known[scenario]:
            raise Refused(f"{place(row)}: there are {known[scenario]} scenarios")
    _check_suite(rows)
    _check_seeds(rows)
    if _is_own(card["entry"]) != (entrant is not None):
        needs = "a policy of somebody's own: name it with --policy to run it"
        raise Refused(f"{shown(card['entry']['policy'])} is {needs if entrant is None else 'no policy of your own'}")
    found = [each] if (each := left_out(submission)) else []
    if card["code"] != source_digest():
        found.append(f"it was driven by other code ({differences(dict(card['versions']), identity())})")
    if entrant is not None and getattr(entrant, "digest", "") != card["policy"]:
        found.append("the policy is another file than the one that drove")
    return "; ".join(found)


def _check_names(row: Row, entrant: Entrant | None) -> None:
    """Raises Refused, naming the nearest of what there is, if an entry is named after anything else."""
    try:
        choose("contest", row["contest"], ALL_CONTESTS)
        choose("robot", row["robot"], ROBOTS)
        choose("dynamics", row["dynamics"], ("kinematic", "pymunk"))
        choose("actuators", row["actuators"], ACTUATORS)
        choose("disturbance", row["disturbance"], LEVELS)
        if entrant is None and not _is_own(row):
            choose(f"policy of {row['contest']}", row["policy"], ALL_CONTESTS[row["contest"]].policies)
    except ValueError as error:
        raise Refused(str(error)) from None


def left_out(submission: Submission) -> str:
    """Returns what an entry of its contest has to drive and this one has not, in words; "" of a whole one.

    A whole one has as many scenarios of every family of the contest, and of agents that ship every one.
    """
    first = submission.first
    contest = ALL_CONTESTS[first["contest"]]
    seeds = [""]
    if first["gains_name"] == "trained":
        seeds = [f"{seed}" for seed in contest.agents_of(first["policy"], first["robot"])]
    counts = {(family, seed): 0 for family in contest.families(first["dynamics"]) for seed in seeds}
    for row in submission.rows:
        if (key := (row["family"], row.get("agent_seed", ""))) not in counts:
            return f"{place(row)} is none of a whole entry"
        counts[key] += 1
    if gone := next((each for each, count in counts.items() if not count), None):
        return f"it leaves out {gone[0]}{f', agent {gone[1]}' if gone[1] else ''}"
    return "it has more scenarios of one family than of another" if len({*counts.values()}) > 1 else ""


def _check_suite(rows: Collection[Row]) -> None:
    """Raises Refused if an episode is labelled as of a suite that is not its contest's own."""
    for row in rows:
        own = next((suite for suite, held in CROWD_SUITES.items() if row["contest"] in held), row["contest"])
        if row["suite"] != own:
            there = shown(row["suite"])
            raise Refused(f"{place(row)}: its suite is {there}, that of the contest {own!r}: drive that suite")


def _check_seeds(rows: Collection[Row]) -> None:
    """Raises Refused if an episode's seed is not the one that everybody else drives with."""
    for row in rows:
        family, _, split = row["scenario"].partition("/")
        if row["seed"] != (wanted := f"{seed_of(0, split, family) + int(row['episode'])}"):
            raise Refused(
                f"{place(row)}: its seed is {row['seed']:.40}, that of the contest {wanted}: drive with --seed 0"
            )


def _is_own(row: Row) -> bool:
    return row["gains_name"].partition(" ")[0] == OWN


def differing(submission: Submission, entrant: Entrant | None, most: int | None) -> tuple[int, str]:
    """Returns how many episodes were driven again, and the first that came out otherwise, in words; "" where none did.

    Args:
        most: cases that are driven, the first `FIRST` episodes of each, spread over the submission; None: everything.

    Raises:
        Refused: if no entry of this version has such gains.
    """
    keys = list(dict.fromkeys(_case_of(row) for row in submission.rows))
    if most is not None:
        keys = keys[:: max(len(keys) // most, 1)][:most]
    driven = 0
    for key in keys:
        found: dict[int, Row] = {}
        for row in submission.rows:
            if _case_of(row) == key and found.setdefault(int(row["episode"]), row) is not row:
                raise Refused(f"{place(row)} comes twice")
        rows = [found[episode] for episode in sorted(found)][: None if most is None else FIRST]
        setting = _setting(rows, entrant)
        today = _texts(setting)
        driven += len(rows)
        for now, row in zip(today, rows, strict=True):
            wrong = _first_difference(now, row)
            if wrong:
                again = _texts(setting)
                if again != today:
                    return driven, f"{place(row)}: the policy is not deterministic, two drives of it differ"
                if wrong not in row:
                    return driven, f"{place(row)}: column {wrong} is left out; it is {now[wrong]}"
                if wrong not in now:
                    return driven, f"{place(row)}: {wrong} is no column of this version"
                return driven, f"{place(row)}: {wrong} is {now[wrong]}, submitted as {row[wrong]:.40}"
    return driven, ""


def _first_difference(now: Row, row: Row) -> str:
    return next((name for name in (*row, *now) if name not in _WORDS and now.get(name, "") != row.get(name, "")), "")


def _case_of(row: Row) -> bytes:
    """Returns a digest of what the episodes of a case have in common."""
    return hashlib.sha256(repr([row.get(name, "") for name in _OF_A_CASE]).encode()).digest()


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
    raise Refused(f"{place(row)}: {whose} the gains {shown(row.get('gains', ''))}")


def _texts(setting: Setting) -> list[Row]:
    found = Episodes([row for row, _ in played(setting)])
    columns = {name: found.texts(name) for name in found.names}
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


def _scenarios(scenario: str, row: Row) -> tuple[Any, ...]:
    """Returns the frozen scenarios of a name; none where there are none."""
    family, _, split = scenario.partition("/")
    try:
        return splits.split(ALL_CONTESTS[row["contest"]].spec.name, family, split)
    except (KeyError, ValueError):
        return ()


def signed(row: Row) -> str:
    """Returns the digest of an episode, as a card has it."""
    text = json.dumps(sorted((name, cell) for name, cell in row.items() if cell), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _name(row: Row) -> str:
    return row["policy"] if row["gains_name"] == "default" else f"{row['policy']} ({row['gains_name']})"
