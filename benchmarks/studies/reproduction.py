"""Drives a sample of the published episodes again: python benchmarks/studies/reproduction.py

A published section is stale if the code of today drives its episodes otherwise. Of each entry of a section, a policy
with a set of gains, one case is drawn. Its first `EPISODES` episodes are driven and compared with the rows that the
repository keeps, cell by cell, as text: six digits in contests, every digit elsewhere. `--write` stamps the sections
with what comes out and makes the page of results anew.

| section | sample |
|---|---|
| contests, ladder, documents | a case of each entry |
| barn | none: its worlds do not ship |
| transfer, learners | none: their scripts are those of the commits that made them |
| coverage | every `STRIDE`-th line of the table |
"""

import csv
import dataclasses
import datetime
import functools
import io
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import click
import interval_coverage
import numpy as np
from interval_coverage import COVERAGE
from packed_rows import SUFFIX, thinned, unpacked
from results_page import Made, Store, pages
from sections import RESULTS, ROWS, SECTIONS, Section

from wayfield.benchmarks.contests import CONTESTS, GAINS, Course, Entrants
from wayfield.benchmarks.entrants.documents import TITLES, documents
from wayfield.benchmarks.leaderboards.entries import grouped
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.progress import tracked
from wayfield.benchmarks.runs.shards import played
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.crossed import exact_interval
from wayfield.system.command_line import Names, OneLineErrors
from wayfield.system.storage import write_whole

EPISODES = 2  # of a case
STRIDE = 10  # lines of the table of coverage

# columns that describe an entry in words, or number the files of a run: no behaviour
_WORDS = ("trajectory", "knows", "parameters", "learned_from")
_OF_A_CASE = (
    *("suite", "contest", "family", "scenario", "robot", "disturbance", "policy", "gains_name", "gains"),
    *("dynamics", "actuators", "split", "speed"),
)

Sample = tuple[Callable[[], Sequence[Row]], Sequence[Row]]  # what drives episodes again, and the rows that were kept


@dataclasses.dataclass(frozen=True)
class Reproduced:
    """How much of a sample came out the same."""

    sampled: int  # episodes, or lines of a table
    same: int
    other: tuple[str, ...]  # a line for each case that did not

    @property
    def shown(self) -> bool:
        """Returns whether there was a sample and all of it came out the same."""
        return self.sampled == self.same > 0

    @property
    def words(self) -> str:
        """Returns what was found, in words."""
        sentence = f"{self.same} of {self.sampled} samples reproduce"
        return f"{sentence} ({self.other[0]})" if self.other else sentence


def check(section: Section, store: Store, most: int | None = None) -> Reproduced:
    """Returns how a sample of a section comes out with the code of today.

    Args:
        most: cases, of which it takes no more; None: the whole sample.

    Raises:
        ValueError: if the rows that are kept are damaged.
        OSError: if they are missing.
    """
    chosen = list(samples(section, store))[:most]
    sampled = same = 0
    other = []
    for again, rows in tracked(chosen, len(chosen), section.name):
        try:
            differing = [_difference(now, row) for now, row in zip(again(), rows, strict=True)]
        except (LookupError, ValueError) as gone:  # a case that there is none of today
            differing = [f"there is none today: {gone}"]
        sampled += len(rows)
        same += sum(not each for each in differing)
        if first := next(filter(None, differing), ""):
            other.append(f"{_name(rows[0])}: {first}")
    return Reproduced(sampled, same, tuple(other))


def stamped(made: Made, sample: Reproduced) -> Made:
    """Returns what made a section with what came out of its sample today."""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return dataclasses.replace(made, sampled=sample.sampled, same=sample.same, checked=today)


def samples(section: Section, store: Store) -> Iterator[Sample]:
    """Yields the sample of a section, the same in each call."""
    rng = np.random.default_rng(zlib.crc32(section.name.encode()))
    if section.name == interval_coverage.SUITE:
        yield from _of_coverage(store.text(f"{RESULTS}/{COVERAGE}"))
        return
    if not section.from_rows or section.needs:
        return
    name = f"{ROWS}/{section.name}{SUFFIX}"
    rows = unpacked(store.content(name), section.name)
    for of_entry in _grouped(rows, ("contest", "policy", "gains_name", "dynamics")):
        cases = _grouped(of_entry, _OF_A_CASE)
        first = cases[rng.integers(len(cases))][:EPISODES]
        yield functools.partial(_driven, first), first


def _grouped(rows: Iterable[Row], names: Sequence[str]) -> list[list[Row]]:
    """Returns the rows that have the same cells in some columns, in the order in which these come up."""
    return list(grouped([{**row, "": "\t".join(row.get(name, "") for name in names)} for row in rows], "").values())


def _driven(rows: Sequence[Row]) -> Sequence[Row]:
    """Returns the rows of the first episodes of a case of a contest or a document, driven today."""
    row = rows[0]
    setting = Setting(row["suite"], _case(row), row["dynamics"], row["actuators"], int(row["seed"]), len(rows))
    if row["contest"] in TITLES:
        return _texts([today for today, _ in episodes(setting)])
    return _lines(thinned([today for today, _ in played(setting)]))


def _texts(rows: Sequence[Row]) -> list[Row]:
    """Returns rows as they stand in files."""
    episodes = Episodes(rows)
    return _lines({name: episodes.texts(name) for name in episodes.names})


def _lines(columns: Mapping[str, Sequence[str]]) -> list[Row]:
    return [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]


def _case(row: Row) -> Case:
    """Returns the case that a row is about; LookupError if there is none today."""
    if row["contest"] not in TITLES:
        contest = CONTESTS[row["contest"]]
        family, split = row["scenario"].split("/")
        entrants = Entrants((row["policy"],), (*GAINS["all"], "robust"))
        speed = float(row["speed"]) if row["speed"] else None
        cases = list(contest.cases(row["robot"], Course(family, split), entrants, row["disturbance"], speed))
    else:
        keys = row["contest"], row["family"], row["policy"]
        cases = [case for case in documents() if case.key[:3] == keys]
    for case in cases:
        if (case.gains_name, case.gains_text) == (row["gains_name"], row["gains"]):
            return case
    raise LookupError(f"no entry has the gains {row['gains']!r}")


def _of_coverage(table: str) -> Iterator[Sample]:
    """Yields lines of the table of coverage."""
    lines: list[Row] = list(csv.DictReader(io.StringIO(table, newline=""), strict=True))
    column = "covers (%)"

    def again(index: int) -> Sequence[Row]:
        share = interval_coverage.covered((index, interval_coverage.SIMULATIONS, 0)) / interval_coverage.SIMULATIONS
        low, high = exact_interval(share, interval_coverage.SIMULATIONS)
        return [{column: f"{100.0 * share:.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"}]

    for k in range(STRIDE // 2, len(lines), STRIDE):
        yield functools.partial(again, k), [{column: lines[k][column]}]


def _difference(today: Row, published: Row) -> str:
    """Returns the first cell of a row that is not as it was; "" where all are."""
    for name, cell in published.items():
        if name and name not in _WORDS and today.get(name, "") != cell:
            return f"{name} is {today.get(name, '')!r}, was {cell!r}"
    return ""


def _name(row: Row) -> str:
    """Returns what tells a case of the sample from the others, in words."""
    names = ("robot", "scenario", "place", "family", "disturbance", "policy", "gains_name", "gains")
    return " ".join(row[name] for name in names if row.get(name)) or "a line"


@click.command("reproduction", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--only", type=Names("--only", [each.name for each in SECTIONS]), help="Only these.  [default: all]")
@click.option("--write", is_flag=True, help="Stamp the sections with what comes out, and make the page anew.")
@click.option("--root", default=".", show_default=True, metavar="DIR", help="The repository, with README.md and docs.")
def main(only: tuple[str, ...] | None, write: bool, root: str) -> None:
    """Drives a sample of the published episodes again and says of each section how many come out the same.

    Status 1 where a section is not stamped with that.
    """
    wrong = []
    try:
        store = Store(Path(root))
        for section, made in store.sections():
            if only is not None and section.name not in only:
                continue
            sample = check(section, store)
            click.echo(f"{section.name}: {sample.same} of {sample.sampled}")
            for line in sample.other:
                click.echo(f"  {line}")
            if (sample.sampled, sample.same) != (made.sampled, made.same):
                wrong.append(section.name)
            store.changed[f"{RESULTS}/{section.name}.json"] = stamped(made, sample).content()
        if write:
            for name, content in (store.changed | pages(store)).items():
                write_whole(store.home / name, content)
    except (OSError, ValueError) as error:
        raise click.ClickException(str(error)) from None
    if wrong and not write:
        raise click.ClickException(f"{', '.join(wrong)}: the page says otherwise; give --write")


if __name__ == "__main__":
    main()
