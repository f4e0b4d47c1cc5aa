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
import random
import re
import subprocess
import time
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
from wayfield.benchmarks.leaderboards.entries import COMPARED, ENDINGS
from wayfield.benchmarks.records.cases import Case, Entrant
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.results import EPISODES, read_table
from wayfield.benchmarks.report.page import commit
from wayfield.benchmarks.runs.shards import declared, played
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
TRAJECTORY = "trajectory"  # the column that names a file of the run
_SETS = ("default", "tuned", "robust", "paper")  # of gains
_BY_PLACE = "random"  # the policy whose draws depend on the place in a batch
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
    digest: str = ""  # of its files

    @property
    def first(self) -> Row:
        """Returns the first row."""
        return next(iter(self.rows))


def made(run: Path, entry: str, entrant: Entrant | None) -> Submission:
    """Returns the submission of an entry of a finished run, named as "policy" or "policy (gains)".

    Args:
        entrant: what the user named as a policy of their own, where the entry is one.

    Raises:
        Refused: if the run has no such entry, or it is none that `check` lets pass.
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
    columns = [name for name in mine[0] if name != TRAJECTORY and any(row[name] for row in mine)]
    rows = [{name: row[name] for name in columns} for row in mine]
    return _of_rows(rows, entrant)


def _of_rows(rows: Sequence[Row], entrant: Entrant | None) -> Submission:
    """Returns the submission of rows; Refused where `check` refuses it."""
    card = {
        "entry": {name: rows[0].get(name, "") for name in _ENTRY},
        "code": source_digest(),
        "policy": getattr(entrant, "digest", ""),
        "scenarios": {
            case: splits.digest(_scenarios(case, rows[0])) for case in dict.fromkeys(row["scenario"] for row in rows)
        },
        "versions": identity() | {"commit": commit()},
        "episodes": [signed(row) for row in rows],
    }
    submission = Submission(card, rows)
    check(submission, entrant)
    return submission


def driven_today(submission: Submission, split: str) -> Submission:
    """Returns an entry of the package on a split, as its policy drives there today; Refused if it has no such gains."""
    first = submission.first
    contest, robot, level = ALL_CONTESTS[first["contest"]], first["robot"], first["disturbance"]
    rows: list[Row] = []
    for family in contest.families(first["dynamics"]):
        first_seed, count = seed_of(0, split, family), splits.SPLITS[split]
        for case in contest.cases(robot, Course(family, split), Entrants((first["policy"],), _SETS), level):
            if case.gains_name == first["gains_name"]:
                conditions = first["dynamics"], first["actuators"], first_seed, count
                rows += _texts([row for row, _ in played(Setting(first["suite"], case, *conditions))])
    if not rows:
        raise Refused(f"{_name(first)!r} is no entry of this version: its gains are others")
    columns = [name for name in rows[0] if any(row[name] for row in rows)]
    return _of_rows([{name: row[name] for name in columns} for row in rows], None)


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
    code = "0" * 64
    versions = {"code and agents": code[:12]}
    card = {"entry": _SAMPLE_ROWS[0], "code": code, "policy": "", "scenarios": {}, "versions": versions}
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
    digest = hashlib.sha256("".join(digests).encode() + content).hexdigest()
    return Submission(card, rows, digest)


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
    if more := [name for name in card if name not in kinds]:
        raise Refused(f"{file}: {shown(more[0])} is no field of a card: {', '.join(kinds)}")
    if not re.fullmatch(r"[0-9a-f]{64}", card["code"], re.ASCII):
        raise Refused(f"{file}: code is {card['code']:.80}; it must be a digest of 64 digits, 0 to 9 and a to f")
    if (there := card["versions"].get("code and agents", "none")) != card["code"][:12]:
        raise Refused(f"{file}: code is {card['code'][:12]}, but versions has {there:.40}")
    for name, version in card["versions"].items():
        if not re.fullmatch(r"[\w .+-]{1,100}=[\w.+-]{0,100}", f"{name}={version}", re.ASCII):
            raise Refused(f"{file}: versions has {shown(name)}: {shown(version)}, which is no version")
    if card["policy"] and not _is_own(card["entry"]):
        raise Refused(f"{file}: policy is {card['policy']:.40}, but the entry is none of a policy of somebody's own")
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


def check(submission: Submission, entrant: Entrant | None) -> None:
    """Compares all of a submission that needs no driving: scenes, seeds, suite, and what it declares of its policy.

    Args:
        entrant: what the user named as the policy, for an entry from outside of the package.

    Raises:
        Refused: if anything is not as it is here, a frozen scene of the split is missing or comes twice, or the policy
            was not named; the message names the first episode.
    """
    card, rows = submission.card, submission.rows
    _check_names(submission.first, entrant)
    if _is_own(card["entry"]) != (entrant is not None):
        needs = "a policy of somebody's own: name it with --policy to run it"
        raise Refused(f"{shown(card['entry']['policy'])} is {needs if entrant is None else 'no policy of your own'}")
    known: dict[str, int] = {}
    for row in rows:
        if (scenario := row["scenario"]) not in known:
            here = _scenarios(scenario, row)
            if not here or card["scenarios"].get(scenario) != splits.digest(here):
                raise Refused(f"its scenarios {shown(scenario)} are not those of this version, from {place(row)} on")
            known[scenario] = len(here)
        if scenario != f"{row['family']}/{row['split']}":
            raise Refused(f"{place(row)}: its family is {row['family']:.60}, its split {row['split']:.60}")
        if int(row["episode"]) >= known[scenario]:
            raise Refused(f"{place(row)}: there are {known[scenario]} scenarios")
    if more := next((name for name in card["scenarios"] if name not in known), ""):
        raise Refused(f"its card has scenarios {shown(more)}, of which it has no episode")
    _check_suite(rows)
    _check_seeds(rows)
    _check_outcomes(rows)
    check_whole(submission)
    _check_declared(rows, entrant)


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


def check_whole(submission: Submission) -> None:
    """Raises Refused unless an entry has every frozen scene of its split once, and of agents that ship every agent."""
    first = submission.first
    contest, split = ALL_CONTESTS[first["contest"]], first["split"]
    seeds = [""]
    if first["gains_name"] == "trained":
        seeds = [f"{seed}" for seed in contest.agents_of(first["policy"], first["robot"])]
    frozen = {family: len(_scenarios(f"{family}/{split}", first)) for family in contest.families(first["dynamics"])}
    left = {(family, seed): set(range(count)) for family, count in frozen.items() for seed in seeds}
    for row in submission.rows:
        if (key := (row["family"], row.get("agent_seed", ""))) not in left:
            raise Refused(f"{place(row)} is none of its contest")
        if int(row["episode"]) not in left[key]:
            raise Refused(f"{place(row)} comes twice")
        left[key].remove(int(row["episode"]))
    if missing := [(family, seed, len(numbers)) for (family, seed), numbers in left.items() if numbers]:
        family, seed, count = missing[0]
        of = f"{family}/{split}{f', agent {seed}' if seed else ''}"
        every = sum(map(len, left.values()))
        raise Refused(
            f"{count} of the {frozen[family]} frozen scenarios of {of} are missing, {every} of all: an entry drives "
            f"the whole split: evaluate --suite {first['suite']} with neither --families nor --episodes"
        )


def _check_declared(rows: Collection[Row], entrant: Entrant | None) -> None:
    """Raises Refused if a row has other words of its scenario or its policy than scenario, law and agent's card here.

    They are access, parameters and training of the policy, and tier and quantity of the scenario.
    """
    here: dict[bytes, list[Row]] = {}
    for row in rows:
        if (key := _case_of(row)) not in here:
            setting = _setting(row, entrant, range(len(_scenarios(row["scenario"], row))))
            here[key] = _texts(declared(setting))
        now = here[key][int(row["episode"])]
        if wrong := next((name for name, cell in now.items() if cell != row.get(name, "")), ""):
            here_is = f"{now[wrong]} by the agent's card" if row["gains_name"] == "trained" else now[wrong]
            raise Refused(f"{place(row)}: {wrong} is {here_is}, submitted as {row.get(wrong, '') or 'none':.80}")


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


def _check_outcomes(rows: Collection[Row]) -> None:
    """Raises Refused unless outcomes are 0 or 1 and success excludes the others, and time and cost are no negative.

    A draw may miss the one episode whose number, which no drive can have, moves the mean of all.
    """
    for row in rows:
        outcome = {name: row.get(name, "") for name in ("success", *ENDINGS)}
        if wrong := next((name for name, cell in outcome.items() if cell not in ("", "0", "1")), ""):
            raise Refused(f"{place(row)}: {wrong} is {shown(outcome[wrong])}; it must be 0 or 1")
        ended = outcome.pop("success") == "1"
        if ended and (other := next((name for name, cell in outcome.items() if cell == "1"), "")):
            raise Refused(f"{place(row)}: success and {other} are both 1; an episode ends in one of them")
        for name in ("time", ALL_CONTESTS[row["contest"]].cost.metric):
            cell = row.get(name, "")
            sign = "-?" if name == "extra_time" else ""  # who is near the goal is there before the straight line's end
            if cell and not re.fullmatch(rf"{sign}\d+\.?\d*(e[+-]?\d+)?", cell, re.ASCII):
                raise Refused(
                    f"{place(row)}: {name} is {shown(cell)}; it must be a number{'' if sign else ' from 0 on'}"
                )


def _is_own(row: Row) -> bool:
    return row["gains_name"].partition(" ")[0] == OWN


def other_code(submission: Submission, entrant: Entrant | None) -> str:
    """Returns how code and policy here differ from those that drove, and since when results moved; "" of the same."""
    card = submission.card
    reasons = []
    theirs = {name: version for name, version in card["versions"].items() if name != "commit"}
    ours = identity()
    # of the same code too: whoever wrote the card may have had, or claim, other packages
    other = differences(theirs, dict.fromkeys(theirs, "none") | ours)
    if card["code"] != source_digest():
        there, here = card["versions"].get("commit") or "unknown", commit() or "unknown"
        moved = _moved(there, card["entry"]["contest"]) if here != "unknown" else ""
        since = f"; published results of the contest moved from commit {moved} on" if moved else ""
        reasons.append(f"it was driven by other code ({other}; commit {there:.40} there, {here} here{since})")
    elif other:
        reasons.append(f"its card names other versions ({other})")
    if entrant is not None and getattr(entrant, "digest", "") != card["policy"]:
        reasons.append("the policy is another file than the one that drove")
    return "; ".join(reasons)


def _moved(there: str, contest: str) -> str:
    """Returns the first commit after another that changed a contest's published rows; "" where none is known."""
    if contest not in ALL_CONTESTS or not re.fullmatch(r"\w[\w.-]{0,99}", there, re.ASCII):
        return ""
    after = f"{there.removesuffix('-dirty')}..HEAD"
    command = ["git", "log", "--reverse", "--format=%h", after, "--", f"docs/results/rows/{contest}*"]
    home = Path(__file__).resolve().parents[2]
    return subprocess.run(command, cwd=home, capture_output=True, text=True, check=False).stdout.partition("\n")[0]


def draw_seed(submission: Submission) -> int:
    """Returns a seed that nobody can foresee: of the submission's digest and the clock."""
    text = f"{submission.digest} {time.time_ns()}".encode()
    return int.from_bytes(hashlib.sha256(text).digest()[:4])


def drawn(count: int, most: int | None, seed: int) -> list[int]:
    """Returns which of so many episodes are driven again, at most so many, in the order that a seed draws."""
    return random.Random(seed).sample(range(count), count if most is None else min(most, count))


def least_seen(count: int, driven: int) -> int:
    """Returns the least number of forged episodes among `count` of which `driven` drawn ones meet one in 19 of 20."""
    missed, forged = 1.0, 0
    while missed > 0.05:
        missed *= max(count - driven - forged, 0) / (count - forged)
        forged += 1
    return forged


def differing(submission: Submission, entrant: Entrant | None, numbers: Sequence[int]) -> str:
    """Returns the first of some episodes that comes out otherwise when it is driven again, in words; "" if none does.

    Those of a case are driven together, in the order of `numbers`, so that the place in a batch tells a policy nothing.

    Args:
        numbers: of the rows.

    Raises:
        Refused: if no entry of this version has such gains.
    """
    wanted = {number: k for k, number in enumerate(numbers)}
    chosen = sorted((wanted[k], row) for k, row in enumerate(submission.rows) if k in wanted)
    cases: dict[bytes, list[Row]] = {}
    for _, row in chosen:
        cases.setdefault(_case_of(row), []).append(row)
    for rows in cases.values():
        episodes = [int(row["episode"]) for row in rows]
        setting = _setting(rows[0], entrant, range(max(episodes) + 1) if rows[0]["policy"] == _BY_PLACE else episodes)
        today = _driven(setting)
        for row in rows:
            now = today[row["episode"]]
            if not (wrong := _first_difference(now, row)):
                continue
            if _driven(setting) != today:
                return f"{place(row)}: the policy is not deterministic, two drives of it differ"
            if wrong not in row:
                return f"{place(row)}: column {wrong} is left out; it is {now[wrong]}"
            if wrong not in now:
                return f"{place(row)}: {wrong} is no column of this version"
            return f"{place(row)}: {wrong} is {now[wrong]}, submitted as {row[wrong]:.40}"
    return ""


def _first_difference(now: Row, row: Row) -> str:
    names = dict.fromkeys((*row, *now))
    return next((name for name in names if now.get(name, "") != row.get(name, "")), "")


def _case_of(row: Row) -> bytes:
    """Returns a digest of what the episodes of a case have in common."""
    return hashlib.sha256(repr([row.get(name, "") for name in _OF_A_CASE]).encode()).digest()


def _setting(row: Row, entrant: Entrant | None, numbers: Sequence[int]) -> Setting:
    """Returns the setting of some episodes of a row's case."""
    first = int(row["seed"]) - int(row["episode"])
    case = _case(row, entrant)
    return Setting(row["suite"], case, row["dynamics"], row["actuators"], first, len(numbers), numbers=tuple(numbers))


def _case(row: Row, entrant: Entrant | None) -> Case:
    contest = ALL_CONTESTS[row["contest"]]
    family, _, split = row["scenario"].partition("/")
    entrants = Entrants((row["policy"],), _SETS) if entrant is None else Entrants((), own=(entrant,))
    for case in contest.cases(row["robot"], Course(family, split), entrants, row["disturbance"]):
        if (case.gains_name, case.gains_text) == (row["gains_name"], row.get("gains", "")):
            return case
    whose = "no entry of this version has" if entrant is None else "the policy that was named has not"
    raise Refused(f"{place(row)}: {whose} the gains {shown(row.get('gains', ''))}")


def _driven(setting: Setting) -> dict[str, Row]:
    """Returns the rows of a setting that is driven, by their episode."""
    return {row["episode"]: row for row in _texts([row for row, _ in played(setting)])}


def _texts(rows: Sequence[Mapping[str, Any]]) -> list[Row]:
    episodes = Episodes(rows)
    columns = {name: episodes.texts(name) for name in episodes.names}
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
