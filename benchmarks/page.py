"""The page of results and the README's part of it, from the files that the repository keeps and from nothing else."""

import csv
import dataclasses
import io
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tabulate import tabulate

from wayfield.benchmarks.claims import SUMMARY_HEADER, summary
from wayfield.benchmarks.contests import CONTESTS, PACE_TOLERANCE
from wayfield.benchmarks.entries import OFF_PACE
from wayfield.benchmarks.results import Row
from wayfield.benchmarks.sections import KEPT, SECTIONS, Section
from wayfield.envs.identity import source_digest
from wayfield.envs.readers import of_path, reader
from wayfield.envs.robots import ROBOTS
from wayfield.policies.learned.agent import CARD, read_card
from wayfield.policies.learned.ppo import shipped

PAGE = "docs/results.md"
README = "README.md"
BEGIN, END = "<!-- results: made by python -m wayfield.benchmarks.publish -->", "<!-- end of results -->"

# The README's six rows: the tuned followers that a reader would choose from, and the trained agents.
CONTENDERS = (
    *(("pure_pursuit", "tuned"), ("regulated_pure_pursuit", "tuned"), ("stanley", "tuned"), ("lqr", "tuned")),
    *(("mpc", "tuned"), ("ppo", "trained")),
)
# Whose claims the README sums up, of each the first condition.
SUMMED_UP = ("path_following_p3dx", "goal_obstacles_p3dx", "goal_obstacles_omni3", "goal_obstacles_omni4")


@dataclasses.dataclass(frozen=True)
class Made:
    """What made a section's tables."""

    command: str
    version: str
    commit: str  # as git describes it; "" where it is not known
    code: str  # digest of the source; "" where it was not kept
    date: str
    scenarios: int
    stale: bool  # whether another code than that of today made them

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, field.type):  # type: ignore[arg-type]
                raise ValueError(f"{field.name!r} must be of type {field.type.__name__}, got {value!r}")  # type: ignore[union-attr]

    def content(self) -> bytes:
        """Returns the file that it is kept in."""
        return (json.dumps(dataclasses.asdict(self), indent=1) + "\n").encode()

    def sentence(self) -> str:
        """Returns what made the tables, and whether that is the code of today."""
        where = f", commit {self.commit}" if self.commit else ""
        code = f", code `{self.code[:12]}`" if self.code else ""
        told = (
            f"Made by `{self.command}`, wayfield {self.version}{where}{code}, {self.date}; {self.scenarios} scenarios."
        )
        if not self.stale:
            return told
        return f"**Made with the version before{where}: the code has changed since.** {told}"


@reader("origin of published tables", "made.json", {"made.json": '{"command": "python evaluate.py"}\n'}, of_path)
def read_object(file: Path) -> dict[str, Any]:
    """Returns what a JSON file tells of a run.

    Raises:
        ValueError: if it is no JSON object; the message names the file.
        OSError: if it cannot be opened.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{file} is no JSON: {error}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{file} must hold a JSON object")
    return content


class Kept:
    """The repository's files as they will be: those that change, else those that are there."""

    def __init__(self, home: Path, changed: Mapping[str, bytes] | None = None) -> None:
        self.home = home
        self.changed = dict(changed or {})

    def __contains__(self, name: str) -> bool:
        return name in self.changed or (self.home / name).is_file()

    def text(self, name: str) -> str:
        """Returns a file's text; OSError if there is none."""
        content = self.changed[name] if name in self.changed else (self.home / name).read_bytes()
        return str(content, "utf-8")

    def rows(self, stem: str) -> list[Row]:
        """Returns the rows of a kept table, none where there is no such table; ValueError if it is damaged."""
        name = f"{KEPT}/{stem}.csv"
        if name not in self:
            return []
        rows: list[Row] = list(csv.DictReader(io.StringIO(self.text(name), newline=""), strict=True))
        if not rows or any(None in row or None in row.values() for row in rows):
            raise ValueError(f"{self.home / name} is empty, or has rows that are longer or shorter than its header")
        return rows

    def sections(self) -> list[tuple[Section, Made]]:
        """Returns the sections that there are tables of, in the order of the page.

        Raises:
            ValueError: if a file is damaged; the message names it.
        """
        found = []
        for section in SECTIONS:
            name = f"{KEPT}/{section.name}.json"
            if name in self:
                try:
                    found.append((section, Made(**json.loads(self.text(name)))))
                except (TypeError, ValueError) as error:
                    raise ValueError(f"{self.home / name}: {error}") from None
        return found

    def mark_stale(self) -> None:
        """Marks the sections that the installed code did not make."""
        for section, made in self.sections():
            if made.code != source_digest() and not made.stale:
                self.changed[f"{KEPT}/{section.name}.json"] = dataclasses.replace(made, stale=True).content()


def pages(kept: Kept) -> dict[str, bytes]:
    """Returns docs/results.md and README.md as the kept tables make them.

    Raises:
        ValueError: if a table is damaged, or README.md has lost its markers.
        OSError: if a file cannot be read.
    """
    readme = kept.text(README)
    start, end = readme.find(BEGIN), readme.find(END)
    if start < 0 or end < start:
        raise ValueError(f"{kept.home / README} needs a line {BEGIN!r} and after it a line {END!r}")
    shown = "\n".join([BEGIN, *_contenders(kept), "", *_summed_up(kept), END])
    return {PAGE: _page(kept).encode(), README: (readme[:start] + shown + readme[end + len(END) :]).encode()}


def _page(kept: Kept) -> str:
    """Returns the page of results."""
    sections = kept.sections()
    blocks = [
        "# Results",
        "Made by `python -m wayfield.benchmarks.publish` from the episodes in [results/](results/), which come from "
        "the folders of finished runs; edited by hand, it fails a test. `python -m wayfield.benchmarks.audit` makes "
        "the tables a second time with other formulas, and asks what a sceptic would.",
        "Every policy meets the same scenarios, starts and disturbances. `default` are the gains of the policy's file, "
        "`tuned` those found by search for the condition that they are shown in, `paper` a law as published, `trained` "
        "all seeds of the agents that ship. Brackets are 95 % intervals. What the columns mean is in "
        "[evaluate.md](evaluate.md).",
    ]
    found = [line for stem in _claimed(kept) for line in summary(kept.rows(stem))]
    if found:
        blocks += [
            "## What trained agents win, and what they do not",
            "Success decides; where it does not, the error or the time does. Every comparison with its difference, "
            f"interval and corrected p stands in its section. {SUMMARY_HEADER[-1].capitalize()}: who errs less drives "
            f"slower, by over {100.0 * PACE_TOLERANCE:.0f} %.",
            _table(SUMMARY_HEADER, found),
        ]
    for section, made in sections:
        blocks += [f"## {section.title}", made.sentence(), f"What it does not show: {section.not_shown}"]
        for name, alt in section.pictures.items():
            if f"docs/{name}" in kept:
                blocks.append(f"![{alt}]({name})")
        for name, heading in section.tables.items():
            place = section.place(name)
            if place in kept:
                blocks += [f"### {heading}", _shown(kept, place)]
    if cards := _cards():
        blocks += [
            "## What the agents' cards say",
            "Measured on the validation split, by which an agent is chosen among those of its training, or on default "
            "scenarios, when it was trained: no result of a contest. Means of the seeds, in brackets the least and the "
            "greatest; of paths the error is the mean RMS cross-track error in mm, else it is the time in s, both of "
            "the successes. Every card is in the package.",
            _table(_CARD_HEADER, cards),
        ]
    missing = [section for section in SECTIONS if section.name not in {each.name for each, _ in sections}]
    if missing:
        rest = "\n".join(f"- {section.title}: `{section.command}`" for section in missing)
        blocks += ["## Not run on this version", rest]
    return "\n\n".join(blocks) + "\n"


_CARD_HEADER = ["agents", "seeds", "driven", "success (%)", "collision (%)", "mm or s", "mean speed (m/s)"]


def _cards() -> list[list[str]]:
    """Returns what the cards of the agents that ship hold of their validation and of what else was measured."""
    lines = []
    for contest in CONTESTS.values():
        for robot in ROBOTS:
            cards = [read_card(folder / CARD) for folder in shipped(contest.spec.name, robot).values()]
            factor = 1e3 if contest.spec.on_path else 1.0  # to mm; s
            conditions: dict[str, list[Mapping[str, Any]]] = {}
            for card in cards:
                own = {"env_kwargs": card["env_kwargs"], "asked_speed": card["speed"], **card["validation"]}
                for each in (own, *card["measured"]):
                    conditions.setdefault(_driven(each), []).append(each)
            for driven, found in conditions.items():
                cells = [
                    _spread([scale * each[name] for each in found], decimals)
                    for name, scale, decimals in (
                        *(("success", 100.0, 1), ("collision", 100.0, 1)),
                        *(("error", factor, 1), ("speed", 1.0, 2)),
                    )
                ]
                lines.append([f"{contest.spec.title}, {robot}", str(len(found)), driven, *cells])
    return lines


def _driven(measured: Mapping[str, Any]) -> str:
    """Returns where and how an agent was measured, in words."""
    how = measured["env_kwargs"]
    beams = f", {how['num_beams']} beams" if "num_beams" in how else ""
    return f"{how['scenario']}, {how['actuators']}{beams}, asked for {measured['asked_speed']:g} m/s"


def _spread(numbers: Sequence[float], decimals: int) -> str:
    mean = f"{sum(numbers) / len(numbers):.{decimals}f}"
    ends = f"{min(numbers):.{decimals}f}", f"{max(numbers):.{decimals}f}"
    return mean if ends[0] == ends[1] else f"{mean} [{ends[0]} to {ends[1]}]"


def _claimed(kept: Kept) -> list[str]:
    """Returns the stems of the tables of claims that there are, in the order of the page."""
    each = [
        (section, name) for section, _ in kept.sections() for name in section.tables if name.endswith("_claims.csv")
    ]
    places = [section.place(name) for section, name in each]
    return [place.removeprefix(f"{KEPT}/").removesuffix(".csv") for place in places if place in kept]


def _shown(kept: Kept, place: str) -> str:
    """Returns a kept table as Markdown."""
    if place.endswith(".md"):
        return re.sub(r"^## ", "#### ", kept.text(place).strip(), flags=re.MULTILINE)
    rows = kept.rows(place.removeprefix(f"{KEPT}/").removesuffix(".csv"))
    return _table(list(rows[0]), [list(row.values()) for row in rows])


def _table(header: list[str], lines: list[list[str]]) -> str:
    """Returns a table as Markdown; the bars in a cell do not end it."""
    cells = [[cell.replace("|", "\\|") for cell in line] for line in lines]
    return str(tabulate(cells, header, tablefmt="github", disable_numparse=True))


def _cell(row: Row, header: str) -> str:
    """Returns a cell by what its column's header begins with."""
    for name, text in row.items():
        if name.startswith(header):
            return text
    raise ValueError(f"the standings have no column {header!r}: {', '.join(row)}")


def _contenders(kept: Kept) -> list[str]:
    """Returns the README's table, and the line that says what made it."""
    made = {section.name: each for section, each in kept.sections()}.get("path-following")
    rows = {(row["policy"], row["gains"]): row for row in kept.rows("path_following_p3dx")}
    if made is None or not rows:
        return ["No run of this version is published."]
    header = ["policy", "gains", "learned from", "is told"]
    header += ["success (%)", "RMS error (m)", "typical (m)", "mean speed (m/s)"]
    columns = ("policy", "gains", "learned from", "knows", "success", "RMS error", "typical", "mean speed")
    lines = [[_cell(rows[entry], each) for each in columns] for entry in CONTENDERS if entry in rows]
    for line in lines:
        line[0] = f"`{line[0]}`"
    off = f" {OFF_PACE}: not at the speed that was asked for." if any(OFF_PACE in line[-1] for line in lines) else ""
    return [tabulate(lines, header, tablefmt="github", disable_numparse=True), "", made.sentence() + off]


def _summed_up(kept: Kept) -> list[str]:
    """Returns the README's table of what the agents win, and what they do not."""
    found = [summary(kept.rows(f"{stem}_claims")) for stem in SUMMED_UP if f"{KEPT}/{stem}_claims.csv" in kept]
    lines = [line for each in found for line in each if line[0] == each[0][0]]
    return [_table(SUMMARY_HEADER, lines), ""] if lines else []
