"""The page of results and the README's part of it, from the files that the repository keeps and from nothing else."""

import csv
import dataclasses
import functools
import io
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from interval_coverage import SUITE
from packed_rows import SUFFIX
from sections import RESULTS, ROWS, SECTIONS, Section
from tabulate import tabulate

from wayfield.benchmarks.commands.submission import Submission, check_whole, read_submission
from wayfield.benchmarks.contests import ANY, CONTESTS, PACE_TOLERANCE, TRAINED
from wayfield.benchmarks.leaderboards.disclosure import inputs
from wayfield.benchmarks.leaderboards.entries import (
    OFF_PACE,
    grouped,
    label,
    scenarios,
    solved_mean,
    solved_mean_cell,
    success_cell,
)
from wayfield.benchmarks.leaderboards.verdicts import (
    BETTER,
    COST,
    EQUIVALENT,
    MARGINS,
    OPEN,
    UNSURE,
    Verdict,
    judged,
    shown,
)
from wayfield.benchmarks.records.episode import Episodes
from wayfield.envs.robots import ROBOTS
from wayfield.policies.learned.agent import CARD, read_card
from wayfield.policies.trained.ppo import shipped

PAGE = "docs/results.md"
CARDS = f"{RESULTS}/cards.md"
README = "README.md"
STUDIES = {
    "everywhere": "A driver for every robot, away from home",
    "learning": "Learning curves: PPO, SAC and TD3",
    "physics": "Does it hold in another physics?",
    "filters": "Safety filters behind policies",
    "papers": "Published claims, run again",
    "hulls": "Hulls of 0.3 to 0.7 m",
    "flocks": "Teams and crowds: trained agents vs. controllers",
}  # pages of their own
BEGIN, END = "<!-- results: made by python benchmarks/studies/publish.py -->", "<!-- end of results -->"

CHOOSING = "docs/choosing.md"
LEADERBOARD = "docs/leaderboard"  # a folder each accepted submission
MOST = 6  # rows a task
LIDAR, ONLY_MAP = "lidar", "map"
LEARNED = (*TRAINED, ANY)  # with a network, alone or beside a planner: no controllers

Row = Mapping[str, str]

# What README, the index and the advice are about: the heading, the section, the table, and the kinds of scenes.
Task = tuple[str, str, str, tuple[str, ...]]
TASKS: tuple[Task, ...] = (
    (
        *("Follow a path", "path-following-claims", "claims/path_following_p3dx"),
        ("smooth paths", "paths with corners"),
    ),
    (
        *("Track a timed trajectory", "trajectory-tracking", "trajectory_tracking_p3dx"),
        ("references that a base can follow",),
    ),
    (
        "Reach a goal among static obstacles",
        "goal-obstacles-claims",
        "claims/goal_obstacles_p3dx",
        ("static obstacles",),
    ),
    (
        "Reach a goal among moving obstacles",
        "goal-obstacles-claims",
        "claims/goal_obstacles_p3dx",
        ("moving obstacles",),
    ),
    (
        *("Dock at a pose", "docking-claims", "claims/docking_p3dx"),
        ("free space", "wall or parking bay", "moving obstacles"),
    ),
)


@dataclasses.dataclass(frozen=True)
class Made:
    """What made a section's tables."""

    command: str
    version: str
    commit: str  # as git describes it; "" where it is not known
    date: str
    scenarios: int
    sampled: int = 0  # episodes, or lines, that were driven again since
    same: int = 0  # of those
    checked: str = ""  # date of that

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, field.type):  # type: ignore[arg-type]
                raise ValueError(f"{field.name!r} must be of type {field.type.__name__}, got {value!r}")  # type: ignore[union-attr]

    def content(self) -> bytes:
        """Returns the file that it is kept in."""
        return (json.dumps(dataclasses.asdict(self), indent=1) + "\n").encode()

    @property
    def stale(self) -> bool:
        """Returns whether the code has come to drive episodes of the sample otherwise."""
        return self.same < self.sampled

    def sentence(self) -> str:
        """Returns what made the tables, and how a sample of them came out since."""
        where = f", commit {self.commit}" if self.commit else ""
        text = f"Made by `{self.command}`, wayfield {self.version}{where}, {self.date}; {self.scenarios} scenarios."
        if not self.sampled:
            return f"{text} No sample of it was driven again."
        if self.stale:
            other = self.sampled - self.same
            return f"**Stale: on {self.checked}, {other} of {self.sampled} samples came out otherwise.** {text}"
        return f"{text} On {self.checked}, {self.same} of {self.sampled} samples reproduced."


class Store:
    """The repository's files as they will be: those that change, else those that are there."""

    def __init__(self, home: Path, changed: Mapping[str, bytes] | None = None) -> None:
        self.home = home
        self.changed = dict(changed or {})

    def __contains__(self, name: str) -> bool:
        return name in self.changed or (self.home / name).is_file()

    def content(self, name: str) -> bytes:
        """Returns a file's bytes; OSError if there is none."""
        return self.changed[name] if name in self.changed else (self.home / name).read_bytes()

    def text(self, name: str) -> str:
        """Returns a file's text; OSError if there is none."""
        return str(self.content(name), "utf-8")

    def rows(self, stem: str) -> list[Mapping[str, str]]:
        """Returns the rows of a kept table, none where there is no such table; ValueError if it is damaged."""
        name = f"{RESULTS}/{stem}.csv"
        if name not in self:
            return []
        rows: list[Mapping[str, str]] = list(csv.DictReader(io.StringIO(self.text(name), newline=""), strict=True))
        if not rows or any(None in row or None in row.values() for row in rows):
            raise ValueError(f"{self.home / name} is empty, or has rows that are longer or shorter than its header")
        return rows

    def sections(self) -> list[tuple[Section, Made]]:
        """Returns the sections that there are tables of, in the order of the page.

        Raises:
            ValueError: if a file is damaged; the message names it.
        """
        sections_made = []
        for section in SECTIONS:
            name = f"{RESULTS}/{section.name}.json"
            if name in self:
                try:
                    sections_made.append((section, Made(**json.loads(self.text(name)))))
                except (TypeError, ValueError) as error:
                    raise ValueError(f"{self.home / name}: {error}") from None
        return sections_made


def pages(store: Store) -> dict[str, bytes]:
    """Returns the index of results, a page each, and the part of choosing.md, as kept tables make them.

    Raises:
        ValueError: if a table is damaged, or choosing.md has lost its markers.
        OSError: if a file cannot be read.
    """
    sections = store.sections()
    files = {f"{RESULTS}/{section.name}.md": _page(store, section, made).encode() for section, made in sections}
    if cards := _cards():
        files[CARDS] = _cards_page(cards).encode()
    files[PAGE] = _index(store).encode()
    if entries := submitted(store.home / LEADERBOARD):
        files[f"{LEADERBOARD}/README.md"] = _leaderboard(entries).encode()
    if CHOOSING in store:
        files[CHOOSING] = marked(store, CHOOSING, _advice(store)).encode()
    return files


def marked(store: Store, name: str, lines: Sequence[str]) -> str:
    """Returns a page with what stands between its markers made anew."""
    try:
        return between(store.text(name), BEGIN, END, lines)
    except ValueError as error:
        raise ValueError(f"{store.home / name} {error}") from None


def between(text: str, begin: str, end: str, lines: Sequence[str]) -> str:
    """Returns a text with other lines between two markers; ValueError if one of these is missing."""
    first, last = text.find(begin), text.find(end)
    if first < 0 or last < first:
        raise ValueError(f"needs a line {begin!r} and after it a line {end!r}")
    return text[:first] + "\n".join([begin, *lines, end]) + text[last + len(end) :]


def submitted(home: Path) -> dict[str, Submission]:
    """Returns the accepted submissions by the name of their folder; ValueError if one is damaged."""
    return {file.parent.name: read_submission(file.parent) for file in sorted(home.glob("*/card.json"))}


def _leaderboard(entries: Mapping[str, Submission]) -> str:
    """Returns the page of accepted submissions, ranked by success and then by cost within a contest and split."""
    blocks = [
        "# Leaderboard",
        "Entries that anyone can drive again: `wayfield verify docs/leaderboard/NAME` drives a random sample, or "
        "`--all`, and compares every bit. `wayfield submit RUN ENTRY --out FOLDER` makes such a folder from a contest "
        "run of your own policy, agent or model; open a pull request with it here. Nothing in a folder is run: an "
        "entry of a policy that does not ship is verified with `--policy`. Made by "
        "`python benchmarks/studies/publish.py --pages`.",
    ]
    kinds: dict[tuple[str, ...], list[tuple[str, Submission, Episodes]]] = {}
    for name, each in entries.items():
        try:
            check_whole(each)
        except ValueError as error:
            raise ValueError(f"{LEADERBOARD}/{name}: {error}") from None
        rows = Episodes.of([{"agent_seed": "", **row} for row in each.rows])
        first = each.first
        names = ("contest", "robot", "split", "actuators", "dynamics", "disturbance")
        key = (*(first[name] for name in names), f"{scenarios(rows) // len(rows.unique('family'))}")
        kinds.setdefault(key, []).append((name, each, rows))
    for (contest_name, robot, split, actuators, dynamics, disturbance, count), boards in kinds.items():
        contest = CONTESTS[contest_name]
        for _, _, rows in boards:
            contest = contest.of_rows(rows)
        cost = contest.cost
        lines = []
        boards.sort(key=lambda each: (-each[2]["success"].mean(), solved_mean(each[2], cost.metric)))
        for name, each, rows in boards:
            entry = each.card["entry"]
            cells = [
                success_cell(rows),
                solved_mean_cell(rows, cost.metric, contest),
                inputs(each.first["knows"], contest.spec.observes),
            ]
            lines.append([f"{_named((entry['policy'], entry['gains_name']))}: [{name}]({name}/card.json)", *cells])
        unit = "mm" if cost.unit == "m" else cost.unit
        header = ["entry", "success (%)", f"{cost.name} ({unit})", "inputs"]
        disturbed = "" if disturbance == "none" else f", {disturbance} disturbance"
        where = f"{count} scenarios of each family, {actuators} actuators, {dynamics} plant{disturbed}."
        blocks += [f"## {contest.spec.title}, {robot}, split {split}", where, _table(header, lines)]
    return "\n\n".join(blocks) + "\n"


def _index(store: Store) -> str:
    """Returns the page that leads to all others, with a leaderboard a task."""
    there = {section.name for section, _ in store.sections()}
    blocks = [
        "# Results",
        "`python benchmarks/studies/publish.py` writes this page from the episodes in [results/](results/). Do "
        "not edit it.",
        "\n".join(_front(store, "results/")),
        "## Every page",
        "Each has its leaderboard, the verdicts on trained agents, and its full tables as files. "
        "[The leaderboard](leaderboard/README.md) takes entries of others."
        if submitted(store.home / LEADERBOARD)
        else "Each has its leaderboard, the verdicts on trained agents, and its full tables as files.",
        "\n".join(f"- [{each.title}](results/{each.name}.md)" for each in SECTIONS if each.name in there)
        + "".join(
            f"\n- [{title}](results/{name}.md)" for name, title in STUDIES.items() if f"{RESULTS}/{name}.md" in store
        )
        + ("\n- [What the agents' cards say](results/cards.md)" if _cards() else ""),
        "## How to read it",
        "Every policy meets the same scenarios, starts and disturbances. `default` are the gains of the policy's file, "
        "`tuned` those found by search for the condition that they are shown in, `robust` those found under "
        "disturbances, `hand-tuned` those chosen by comparison, without a record of a search, `paper` those of the "
        "publication, `trained` all seeds of the agents that ship. Brackets are 95 % intervals. The columns are "
        "explained in [columns.md](columns.md).",
        f"{READING} {_covered(store, 'results/')}".strip(),
    ]
    missing = [section for section in SECTIONS if section.name not in there]
    if missing:
        rest = "\n".join(f"- {section.title}: `{section.command}`" for section in missing)
        blocks += ["## Not run on this version", rest]
    return "\n\n".join(blocks) + "\n"


READING = (
    "Success is ranked first, then the mean time or error of the solved scenarios, each entry at its own speed. If "
    "only some seeds of an agent solve a scenario, the other seeds count there with the mean of these. A verdict is on "
    "success, as a paired difference; if that is equivalent or a tie, it is on the time or the error in the scenarios "
    "that both solve. Better and worse are significant after Holm's correction for all comparisons of the page. "
    f"Equivalent is a 95 % interval within {MARGINS}; for success, the exact limit of rare failures lies within too. "
    "`(not significant)`: the interval excludes 0, but the corrected p is above 0.05. All else is a tie. A lower error "
    f"at a speed that is lower by over {100.0 * PACE_TOLERANCE:.0f} % is no win."
)


def _covered(store: Store, folder: str, driven: Sequence[Mapping[str, str]] = ()) -> str:
    """Returns what the intervals of agents cover, and how often they were measured to hold; "" where they were not.

    Args:
        driven: lines of tables of pairs, of whose sets of agents it is told; none: of all that ship.
    """
    rows = [row for row in store.rows(SUITE) if row["of"].endswith("agents") and "IQM" not in row["interval"]]
    held = [float(row["covers (%)"].partition(" ")[0]) for row in rows]
    if not held:
        return ""
    titles = {line["condition"] for line in driven} or {line[0] for line in _cards()}
    sets = {line[1] for line in _cards() if any(f"{title},".startswith(f"{line[0]},") for title in titles)}
    other = sorted(sets - {rows[0]["of"].partition(" ")[0]}, key=int)
    others = f" For sets of {' or '.join(other)} agents it was not measured." if other else ""
    return (
        "Intervals of trained agents cover training seeds and scenes, but no other families of scenes. In "
        f"simulated populations, those of {rows[0]['of']} contained the true value in {min(held):.1f} to "
        f"{max(held):.1f} % of the cases ([measured]({folder}{SUITE}.md)).{others}"
    )


def _page(store: Store, section: Section, made: Made) -> str:
    """Returns the page of a section: its leaderboard, its verdicts, and where its full tables are."""
    blocks = [
        f"# {section.title}",
        made.sentence(),
        f"What it does not show: {section.not_shown}",
        "[All results](../results.md)",
    ]
    for name, alt in section.pictures.items():
        if f"docs/{name}" in store:
            blocks.append(f"![{alt}](../{name})")
    there = {name: section.place(name) for name in section.tables if section.place(name) in store}
    stems = {name: place.removeprefix(f"{RESULTS}/").removesuffix(".csv") for name, place in there.items()}
    paired = {name: store.rows(stem) for name, stem in stems.items() if name.endswith("_pairs.csv")}
    every = [row for rows in paired.values() for row in rows]
    verdicts = iter(judged(every))  # corrected for all that the page shows
    reading = [f"{READING} {_covered(store, '', every)}".strip(), f"{2 * len(every)} tests, one correction."]
    files = []
    for name, place in there.items():
        heading = section.tables[name]
        if name.endswith("_board.csv"):
            blocks += [f"## {heading}", *_boards(store.rows(stems[name]))]
        elif name.endswith("_pairs.csv"):
            rows = paired[name]
            blocks += [f"## {heading}", *reading, *_verdicts(rows, list(itertools.islice(verdicts, len(rows))))]
            reading = []
        elif name.endswith(".csv") and len(there) > 1 and not section.columns:
            files.append(f"- [{heading}]({place.removeprefix(f'{RESULTS}/')})")
            continue
        else:
            blocks += [f"## {heading}", *_shown(store, place, section.columns)]
            if not place.endswith(".csv"):
                continue
        files.append(f"- [{heading}, as a file]({place.removeprefix(f'{RESULTS}/')})")
    if f"{ROWS}/{section.name}{SUFFIX}" in store:
        files.append(f"- [Every episode](rows/{section.name}{SUFFIX}), packed")
    if files:
        blocks += ["## Full tables", "\n".join(files)]
    return "\n\n".join(blocks) + "\n"


def entry_of(row: Mapping[str, str]) -> tuple[str, str]:
    return row["policy"], row["gains"]


def _named(entry: tuple[str, str]) -> str:
    """Returns how a sentence or a table calls an entry."""
    policy, gains = entry
    return f"`{policy}`" if gains in ("default", "trained") else f"`{policy}` ({gains})"


def _boards(rows: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Yields the leaderboard of each kind of scenes."""
    for scenes, mine in grouped(rows, "scenes").items():
        if scenes:
            yield f"### {scenes[0].upper()}{scenes[1:]}"
        lines: list[dict[str, str]] = []
        teachers: dict[str, str] = {}
        for row in mine:
            line = {"policy": _named(entry_of(row)), **_narrow(row, list(row)[3:])}
            if _TIME in row:  # the widest of them: who taught an agent stands below
                learned, _, teacher = line.pop("training steps").partition(", taught by ")
                line["training steps"] = learned
                teachers |= {line["policy"]: f"{line['policy']} by `{teacher}`"} if teacher else {}
            lines.append(line)
        yield _table(list(lines[0]), [list(line.values()) for line in lines])
        if teachers:
            yield f"Training steps: of the training, or of the search. Taught: {', '.join(teachers.values())}."


def _verdicts(rows: Sequence[Mapping[str, str]], verdicts: Sequence[Verdict]) -> Iterator[str]:
    """Yields every comparison of a page, a table a condition and policy; of several conditions the verdicts alone."""
    by_pair: dict[tuple[str, str, str], list[tuple[Mapping[str, str], Verdict]]] = {}
    for row, verdict in zip(rows, verdicts, strict=True):
        by_pair.setdefault((row["condition"], row["scenes"], row["policy"]), []).append((row, verdict))
    conditions = list(dict.fromkeys(condition for condition, *_ in by_pair))
    main = next((each for each in conditions if all(other.startswith(each) for other in conditions)), "")
    several = [each for each in conditions if each != main] if len(conditions) > 2 else []
    if len(several) < len(conditions):
        yield "Differences are those of the policy in the heading less the other's, with the corrected p."
    for (condition, scenes, policy), pair in by_pair.items():
        if condition in several:
            continue
        by, unit = pair[0][0]["compared by"], pair[0][0]["unit"]
        lines = []
        for row, verdict in pair:
            words, success, p_success, cost, p_cost, _ = shown(row, verdict)
            cost = cost.removesuffix(f" {unit}")
            lines.append(
                [row["beside"], row["inputs of the other"], words, _with_p(success, p_success), _with_p(cost, p_cost)]
            )
        yield f"### {_place(condition, scenes)}: {policy}"
        yield _table(["beside", "inputs", "is", "success (points)", f"{by} where both succeed ({unit})"], lines)
    yield from _side_by_side({key: each for key, each in by_pair.items() if key[0] in several}, several)


_SHORT = ((" successes", ""), ("(not significant)", "(n. s.)"))  # in a column a condition


def _side_by_side(
    verdicts: Mapping[tuple[str, str, str], Sequence[tuple[Mapping[str, str], Verdict]]], conditions: Sequence[str]
) -> Iterator[str]:
    """Yields the verdicts of several conditions, a column each, in a table a kind of scenes and policy."""
    if not verdicts:
        return
    common = ", ".join(
        words
        for words, *others in zip(*(each.split(", ") for each in conditions), strict=False)
        if {*others} == {words}
    )
    by = " and ".join(dict.fromkeys(row["compared by"] for lines_of in verdicts.values() for row, _ in lines_of))
    yield (
        f"In each condition, by success and {by}; more and fewer are of successes, n. s. is not significant, an "
        "empty cell a set of gains that did not drive there. Every difference, with its "
        "interval and p, is in the file of them below."
    )
    for scenes, policy in dict.fromkeys(key[1:] for key in verdicts):
        names: dict[str, dict[str, str]] = {}
        for condition in conditions:
            for row, verdict in verdicts.get((condition, scenes, policy), ()):
                words = functools.reduce(lambda text, pair: text.replace(*pair), _SHORT, _short(verdict))
                names.setdefault(row["beside"], {})[condition] = words
        heads = [each.removeprefix(f"{common}, ").partition(",")[0].removesuffix(" disturbance") for each in conditions]
        lines = [[name, *(words.get(each, "") for each in conditions)] for name, words in names.items()]
        yield f"### {_place(common, scenes)}: {policy}"
        yield _table(["beside", *heads], lines)


def _place(condition: str, scenes: str) -> str:
    return f"{condition}, {scenes}" if scenes else condition


def _short(verdict: Verdict) -> str:
    """Returns the words that decide a verdict: without the success where time or error do; "tie" where none does."""
    words = verdict.words.rpartition("; ")[2]
    return OPEN if verdict.outcome == OPEN and not words.endswith(UNSURE) else words


def _with_p(cell: str, p: str) -> str:
    return f"{cell}, p {p}" if p else cell


def _front(store: Store, folder: str) -> list[str]:
    """Returns who wins at what, in two sentences and a table a task."""
    tasks = [(each, store.rows(f"{each[2]}_board"), store.rows(f"{each[2]}_pairs")) for each in TASKS]
    tasks = [((*task[:3], _there(board, task[3])), board, lines) for task, board, lines in tasks if board]
    if not tasks:
        return ["No run of this version is published."]
    made = {section.name: each for section, each in store.sections()}
    blocks = [_sentences(tasks)]
    for (heading, section, _, kinds), board, lines in tasks:
        page = f"[{heading}]({folder}{section}.md)"
        stale = f" {made[section].sentence()}" if made[section].stale else ""
        blocks += [f"**{page}.**{stale}", _front_table(board, lines, kinds)]
    return ["\n\n".join(blocks)]


def _there(board: Sequence[Mapping[str, str]], kinds: Sequence[str]) -> tuple[str, ...]:
    """Returns the kinds of scenes that a leaderboard has rows of, or "" where it tells none apart."""
    sizes = {row["scenes"] for row in board}
    return tuple(kind for kind in kinds if kind in sizes) or ("",)


_TIME, _AREA, _BOTH = "acquisition (s)", "area (mm s)", "settling (s, mm s)"  # in one column


def _narrow(row: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """Returns cells of a leaderboard by their header, those of acquisition in one and without intervals."""
    cells = {name: row[name] for name in names if name not in (_TIME, _AREA)}
    if _TIME not in names:
        return cells
    both = ", ".join(row[name].partition(" ")[0] for name in (_TIME, _AREA))
    before = names[: names.index(_TIME)]
    return {name: cells[name] for name in before} | {_BOTH: both} | cells


# what a leaderboard has on its page alone
_ON_ITS_PAGE = ("timeout (%)", "least clearance (m)", "LDLJ", "ms a decision", "training steps")


def _front_table(board: Sequence[Mapping[str, str]], lines: Sequence[Mapping[str, str]], kinds: Sequence[str]) -> str:
    """Returns the first rows of a leaderboard, the best set of each policy, with the verdict beside the first agent."""
    agents = {row["policy"]: entry_of(row) for row in _trained(board)}
    agent = next((agents[policy] for policy in TRAINED if policy in agents), None)
    several = len(kinds) > 1
    rows = []
    for kind in kinds:
        mine = best_sets([row for row in board if row["scenes"] == kind], at_pace(board, lines))
        without = [row for row in mine if not _has_map(row)]
        must = [*without[:1], *[row for row in mine if _has_map(row)][:1], *_trained(mine)]
        rest = [row for row in mine if row not in must][: MOST - len(must)]
        rows += [row for row in mine if row in must or row in rest]
    columns = [name for name in list(board[0])[3:] if name not in _ON_ITS_PAGE]
    lines_shown = []
    for row in rows:
        line = {"scenes": row["scenes"]} if several else {}
        line |= {"policy": _named(entry_of(row)), **_narrow(row, columns)}
        if agent:
            line[f"vs. `{agent[0]}`"] = _beside(lines, row, agent)
        lines_shown.append(line)
    return _table(list(lines_shown[0]), [list(line.values()) for line in lines_shown])


def best_sets(rows: Sequence[Row], held: set[tuple[str, str]]) -> list[Row]:
    """Returns the row of each policy that stands first, in their order; those that hold the target speed before others.

    Args:
        held: the entries that hold it, as `at_pace` returns them.
    """
    of_each = grouped(rows, "policy").values()
    bests = [next((row for row in mine if entry_of(row) in held), mine[0]) for mine in of_each]
    return sorted(bests, key=lambda row: entry_of(row) not in held)


def at_pace(board: Sequence[Row], lines: Sequence[Row]) -> set[tuple[str, str]]:
    """Returns the entries that hold the requested speed in the mean over all scenes; all where none is requested."""
    requested = float(lines[0]["asked (m/s)"] or "nan") if lines else math.nan
    counts = {line["scenes"]: float(line["scenarios"]) for line in lines}
    entries = set()
    for entry in {entry_of(row) for row in board}:
        mine = [
            (float(row["speed (m/s)"].strip("-") or "nan"), counts.get(row["scenes"], 0.0))
            for row in board
            if entry_of(row) == entry
        ]
        speed = sum(speed * count for speed, count in mine) / max(sum(count for _, count in mine), 1.0)
        if not abs(speed - requested) > PACE_TOLERANCE * requested:
            entries.add(entry)
    return entries


def _trained(rows: Sequence[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Returns the rows of trained agents."""
    return [row for row in rows if row["gains"] == "trained"]


def verdict_of(
    lines: Sequence[Mapping[str, str]], scenes: str, one: tuple[str, str], other: tuple[str, str]
) -> tuple[Verdict, Mapping[str, str], bool] | None:
    """Returns the verdict on an entry beside another on a leaderboard, its line, and whether it is turned round."""
    main = lines[0]["condition"]
    for line, verdict in zip(lines, judged(lines), strict=True):
        if line["scenes"] == scenes and line["condition"] == main:
            if (line["policy"], line["beside"]) == (label(one), label(other)):
                return verdict, line, False
            if (line["policy"], line["beside"]) == (label(other), label(one)):
                return verdict.turned, line, True
    return None


def _beside(lines: Sequence[Mapping[str, str]], row: Mapping[str, str], agent: tuple[str, str]) -> str:
    verdict = verdict_of(lines, row["scenes"], entry_of(row), agent)
    return "" if verdict is None else _short(verdict[0])


Contested = tuple[Task, Sequence[Mapping[str, str]], Sequence[Mapping[str, str]]]


def _sentences(tasks: Sequence[Contested]) -> str:
    """Returns which policy without a map comes first at each task, and who is equivalent, ties or is behind."""
    text = ["The best policies without a map:\n"]
    for (heading, _, _, kinds), board, lines in tasks:
        for kind in kinds:
            here = [row for row in board if row["scenes"] == kind and not _has_map(row)]
            first, *others = best_sets(here, at_pace(board, lines))
            verdicts = [(row, verdict_of(lines, kind, entry_of(first), entry_of(row))) for row in others]
            outcomes = [(f"`{row['policy']}`", _nearness(each[0])) for row, each in verdicts if each]
            parts = [f"`{first['policy']}` is first"]
            for nearness, words in _NEAR.items():
                if names := [name for name, each in outcomes if each == nearness]:
                    parts.append(f"{' and '.join(names)} {words[len(names) > 1]}")
            text.append(f"- **{_SCENES.get(f'{heading}, {kind}', heading)}**: {'; '.join(parts)}.")
    text.append("- **Teams and crowds** have [a page of their own](results/flocks.md).")
    return "\n".join(
        [
            *text,
            f"\nEquivalent: the 95 % interval of the difference lies within {MARGINS}. Tie: it does not, but contains "
            "0. Not significantly: it does not contain 0, but the corrected p is above 0.05. An agent may be first by "
            "a difference that is not significant; [choosing](choosing.md) then names the controller.",
        ]
    )


_BEHIND = "behind, not significantly"
_AHEAD = "ahead in time or error, not significantly"
_NEAR = {
    EQUIVALENT: ("is equivalent", "are equivalent"),
    OPEN: ("ties with it", "tie with it"),
    _AHEAD: ("is ahead in time or error, but not significantly", "are ahead in time or error, but not significantly"),
    _BEHIND: ("is behind, but not significantly", "are behind, but not significantly"),
}


def _nearness(verdict: Verdict) -> str:
    """Returns the outcome of a first entry beside another; who is behind by the interval alone is no tie."""
    words = verdict.words.rpartition("; ")[2]
    if verdict.outcome != OPEN or not words.endswith(UNSURE):
        return verdict.outcome
    return _BEHIND if words.startswith(("more successes", "faster", "lower error")) else _AHEAD


def _has_map(row: Mapping[str, str]) -> bool:
    return row["inputs"] == ONLY_MAP


def controller_first(sets: Sequence[Row], lines: Sequence[Row]) -> Sequence[Row]:
    """Returns rows of policies, the best first: before an agent its best controller, where the agent is not ahead.

    As `taken` of flocks has it: what is not significant is no reason to take a network.
    """
    law = next((row for row in sets if row["policy"] not in LEARNED), None)
    if law is None or sets[0] is law:
        return sets
    verdict = verdict_of(lines, law["scenes"], entry_of(sets[0]), entry_of(law))
    return sets if verdict is None or verdict[0].outcome == BETTER else [law, *(row for row in sets if row is not law)]


def advised(store: Store) -> list[tuple[str, str, str, Mapping[str, str], str]]:
    """Returns what to take: the task, the kind of scenes, the access, the row that is best there, and its lead."""
    advice: list[tuple[str, str, str, Row, str]] = []
    for task, _, stem, kinds in TASKS:
        board, lines = store.rows(f"{stem}_board"), store.rows(f"{stem}_pairs")
        for kind in kinds if board else ():
            mine = [row for row in board if row["scenes"] == kind]
            accesses = {row["inputs"] for row in mine}
            groups = (LIDAR, ONLY_MAP) if ONLY_MAP in accesses else tuple(sorted(accesses, reverse=True))
            for access in groups:
                # who has the map, or the whole path, may also drive by less
                able = [
                    row
                    for row in mine
                    if access in (row["inputs"], ONLY_MAP)
                    or access.startswith("whole")
                    or (access == LIDAR and row["inputs"] != ONLY_MAP)
                ]
                sets = controller_first(best_sets(able, at_pace(board, lines)), lines)
                if advice and advice[-1][:2] == (task, kind) and advice[-1][3] is sets[0]:
                    continue  # the map brings nothing
                alone = len(sets) < 2
                others = [row for row in mine if row["policy"] != sets[0]["policy"]] if alone else sets[1:]
                other = best_sets(others, at_pace(board, lines))[0]  # who may have other inputs
                verdict = verdict_of(lines, kind, entry_of(sets[0]), entry_of(other))
                lead = _lead(verdict, _named(entry_of(other))) if verdict else ""
                if not lead and not alone:
                    lead = f"{_named(entry_of(other))}: {_result(other)}; difference not tested"
                advice.append(
                    (
                        task,
                        kind,
                        access,
                        sets[0],
                        "; ".join(["no other has these inputs"] * alone + [lead] * bool(lead)),
                    )
                )
    return advice


# What the prose of the advice says of a policy, and the kind of scenes in which that must hold.
SAID = {
    "the error counts": "smooth paths",
    "corners": "paths with corners",
    "obstacles are static": "static obstacles",
    "obstacles move": "moving obstacles",
    "there are no obstacles": "free space",
    "at a wall": "wall or parking bay",
}


def disagreements(store: Store, advice: str) -> list[str]:
    """Returns where the prose of the advice sends to a policy that is behind, or to an agent that is not ahead.

    It is compared with the first entry of the same access in those scenes; who was not measured there is left out.
    """
    lines_apart = []
    for policy, advised_for in re.findall(r"^\| `(\w+)` \| (.+?) \|$", advice, re.MULTILINE):
        for said, kind in SAID.items():
            for task, _, stem, kinds in TASKS if said in advised_for else ():
                board, lines = store.rows(f"{stem}_board"), store.rows(f"{stem}_pairs")
                if kind not in kinds or (kind == "moving obstacles" and len(kinds) > 1):
                    continue  # who moves past a dock is not what stands around a goal
                mine = [row for row in board if row["scenes"] == kind]
                own = next((row for row in best_sets(mine, at_pace(board, lines)) if row["policy"] == policy), None)
                if own is None:
                    continue
                alike = [row for row in mine if _has_map(row) == _has_map(own)]
                sets = best_sets(alike, at_pace(board, lines))
                behind = ("slower", "higher error", "higher error at a higher speed")  # the prose names no speed
                for first in (controller_first(sets, lines)[0], sets[0]):
                    verdict = None if own == first else verdict_of(lines, kind, entry_of(own), entry_of(first))
                    words = verdict[0].words if verdict else ""
                    learned = policy in LEARNED and first["policy"] not in LEARNED  # and the table names the controller
                    if words and (learned or words.startswith("fewer successes") or words.endswith(behind)):
                        beside = _named(entry_of(first))
                        lines_apart.append(f"{policy} where {said!r} ({task}): beside {beside} it has {words}")
                        break
    return lines_apart


def versus(words: str, name: str) -> str:
    """Returns a verdict's words as a phrase that names the other entry."""
    first, *rest = words.split("; ")
    outcome = next((each for each in _VERSUS if first.startswith(each)), first)
    phrase = f"{outcome} {_VERSUS.get(outcome, 'than')}".rstrip()
    return "; ".join([f"{phrase} {name}{first.removeprefix(outcome)}", *rest])


_VERSUS = {"equivalent": "to", "tie": "with", "ahead": "of", "behind": ""} | dict.fromkeys(
    ("more successes", "fewer successes", "faster", "slower", "lower error", "higher error", "better", "worse"), "than"
)


def _lead(standing: tuple[Verdict, Mapping[str, str], bool], name: str) -> str:
    """Returns what an entry is beside another, in words and numbers."""
    verdict, line, turned = standing
    on_success = ";" not in verdict.words
    value, low, high = (
        line[name] for name in (("success (points)", "from", "to") if on_success else (COST, "cost from", "cost to"))
    )
    words = versus(verdict.words, name)
    if not value or not low:
        return words
    numbers = [-float(each) if turned else float(each) for each in (value, low, high)]
    ends = sorted(numbers[1:])
    unit = "points" if on_success else line["unit"]
    digits = 1 if ends[1] - ends[0] > 0.1 and unit != "mm" else 2
    return f"{words}: {numbers[0]:+.{digits}f} [{ends[0]:+.{digits}f}, {ends[1]:+.{digits}f}] {unit}"


def _advice(store: Store) -> list[str]:
    """Returns the table of what to take where, from the leaderboards of the splits that tell most."""
    lines = []
    advice = advised(store)
    for task, kind, access, row, lead in advice:
        where = _SCENES.get(f"{task}, {kind}", task), access
        lines.append([*where, _named(entry_of(row)), _result(row), lead])
    if not lines:
        return []
    return [_table(["task", "inputs", "choose", "its result", "compared with the next best"], lines), *_off_speed()]


def _result(row: Row) -> str:
    """Returns success, and time or error, of a row of a leaderboard."""
    cost = next(name for name in row if name.endswith(("(s)", "(mm)")) and name != _TIME)
    unit = cost.partition("(")[2].rstrip(")")
    return f"{row['success (%)'].partition(' ')[0]} %, {row[cost].partition(' ')[0]} {unit}"


_SCENES = {
    "Follow a path, smooth paths": "Follow a smooth path",
    "Follow a path, paths with corners": "Follow a path with corners",
    "Dock at a pose, free space": "Dock in free space",
    "Dock at a pose, wall or parking bay": "Dock at a wall or in a bay",
    "Dock at a pose, moving obstacles": "Dock among moving obstacles",
}


def _off_speed() -> Iterator[str]:
    """Yields what the cards of goal seekers say of a speed that they were not trained at."""
    title = CONTESTS["goal-obstacles"].spec.title
    lines_at = {speed: [line for line in _cards() if line[0].startswith(title) and line[2] == _CARD_AT.format(speed)]
             for speed in ("0.6", "0.3")}  # fmt: skip
    if not all(lines_at.values()):
        return
    parts = [
        f"{slow[3].partition(' ')[0]} % instead of {fast[3].partition(' ')[0]} % ({slow[0].rpartition(' ')[2]})"
        for fast, slow in zip(lines_at["0.6"], lines_at["0.3"], strict=True)
    ]
    yield (
        "\nThe `ppo` agents for goal reaching were trained at 0.6 m/s. At a target speed of 0.3 m/s they reach fewer "
        f"goals in validation scenarios: {', '.join(parts)}. [This study](results/everywhere.md) compares them with "
        "controllers at that speed. [Their cards](results/cards.md) have results at other speeds, scans and actuators."
    )


_CARD_AT = "all/validation, lagged, 72 beams, asked for {} m/s"
_CARD_HEADER = ["agents", "seeds", "driven", "success (%)", "collision (%)", "mm or s", "mean speed (m/s)"]


def _cards_page(lines: list[list[str]]) -> str:
    """Returns the page of what the agents' cards say."""
    sentences = (
        "Measured on the validation split, by which an agent is chosen among those of its training, or on default "
        "scenarios, when it was trained: no result of a contest. Means of the seeds, in brackets the least and the "
        "greatest; of paths the error is the mean RMS cross-track error in mm, else it is the time in s, both of the "
        "successes. Every card is in the package."
    )
    return "\n\n".join(("# What the agents' cards say", sentences, _table(_CARD_HEADER, lines))) + "\n"


@functools.cache
def _cards() -> list[list[str]]:
    """Returns what the cards of the agents that ship hold of their validation and of what else was measured."""
    lines = []
    for contest in CONTESTS.values():
        for robot in ROBOTS:
            cards = [read_card(folder / CARD) for folder in shipped(contest.spec.name, robot).values()]
            factor = 1e3 if contest.spec.cost.unit == "m" else 1.0  # to mm; s
            conditions: dict[str, list[Mapping[str, Any]]] = {}
            for card in cards:
                own = {"env_kwargs": card["env_kwargs"], "asked_speed": card["speed"], **card["validation"]}
                for each in (own, *card["measured"]):
                    conditions.setdefault(_driven(each, contest.spec.observes != "reference"), []).append(each)
            for driven, agents in conditions.items():
                cells = [
                    _spread([scale * each[name] for each in agents], decimals)
                    for name, scale, decimals in (
                        *(("success", 100.0, 1), ("collision", 100.0, 1)),
                        *(("error", factor, 1), ("speed", 1.0, 2)),
                    )
                ]
                lines.append([f"{contest.spec.title}, {robot}", str(len(agents)), driven, *cells])
    return lines


def _driven(measured: Mapping[str, Any], paced: bool) -> str:
    """Returns where and how an agent was measured, in words."""
    how = measured["env_kwargs"]
    beams = f", {how['num_beams']} beams" if "num_beams" in how else ""
    disturbed = f", {how['disturbance']} disturbance" if "disturbance" in how else ""
    requested = f", asked for {measured['asked_speed']:g} m/s" if paced else ""  # a reference sets the speed itself
    return f"{how['scenario']}, {how['actuators']}{beams}{disturbed}{requested}"


def _spread(numbers: Sequence[float], decimals: int) -> str:
    mean = f"{sum(numbers) / len(numbers):.{decimals}f}"
    ends = f"{min(numbers):.{decimals}f}", f"{max(numbers):.{decimals}f}"
    return mean if ends[0] == ends[1] else f"{mean} [{ends[0]} to {ends[1]}]"


def _shown(store: Store, place: str, columns: Sequence[str]) -> Iterator[str]:
    """Yields a kept table as Markdown, of some of its columns or of all; that of several robots a robot."""
    if place.endswith(".md"):  # of several tables the last, which says what the others come to
        whole = place.removeprefix(f"{RESULTS}/")
        yield f"### {store.text(place).strip().rpartition('## ')[2]}\n\n[What the tables of every run show]({whole})."
        return
    rows = store.rows(place.removeprefix(f"{RESULTS}/").removesuffix(".csv"))
    names = [name for name in columns if name in rows[0]] or list(rows[0])  # no BARN where its worlds were not there
    for robot, mine in grouped(rows, "robot").items() if "robot" in rows[0] else (("", rows),):
        if robot:
            yield f"### {robot}"
        filled = [name for name in names if any(row[name] for row in mine)]
        yield _table(filled, [[row[name] for name in filled] for row in mine])
        if any(OFF_PACE in row[name] for row in mine for name in filled):
            yield f"{OFF_PACE}: mean speed off the target speed."


def _table(header: list[str], lines: list[list[str]]) -> str:
    """Returns a table as Markdown; the bars in a cell do not end it."""
    cells = [[cell.replace("|", "\\|") for cell in line] for line in lines]
    return str(tabulate(cells, header, tablefmt="github", disable_numparse=True))
