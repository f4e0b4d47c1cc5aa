"""Runs the suites and makes the page of results: python benchmarks/studies/publish.py

One call does it all, and goes on where an earlier one was interrupted: suites that the installed code has finished are
not run again. Of a run the repository keeps the episodes, packed, in docs/results/rows, the tables that are made from
them in docs/results, and what made them (.json). From those files alone come docs/results.md and, between markers, the
tables of README.md, so that a test can make them again.
"""

import csv
import datetime
import functools
import io
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import click
import front_page
from packed_rows import SUFFIX, packed, thinned, unpacked
from reproduction import check, stamped
from results_page import LEADERBOARD, PAGE, README, Made, Store, pages, submitted
from sections import DOCUMENTS, RESULTS, ROWS, SECTIONS, Section

from wayfield.benchmarks.commands.submission import content as entry_files
from wayfield.benchmarks.commands.submission import driven_today
from wayfield.benchmarks.contests import CONTESTS, PUBLIC_SPLIT
from wayfield.benchmarks.entrants.documents import documents
from wayfield.benchmarks.figures.contest_figures import front
from wayfield.benchmarks.figures.drawing import saved
from wayfield.benchmarks.leaderboards.document_tables import document_tables
from wayfield.benchmarks.leaderboards.leaderboard import contest_tables
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.results import EPISODES, SWEEP, TABLE, read_rows
from wayfield.benchmarks.records.run_folder import MANIFEST, file_digest, read_manifest
from wayfield.benchmarks.report.page import commit
from wayfield.benchmarks.runs.decisions import DECISIONS
from wayfield.system.command_line import Names, OneLineErrors
from wayfield.system.identity import source_digest
from wayfield.system.storage import write_whole


@click.command("publish", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--run/--no-run", "first", default=True, help="Run the suites that are not done first.  [default: run]")
@click.option("--only", type=Names("--only", [each.name for each in SECTIONS]), help="Only these.  [default: all]")
@click.option("--stale", is_flag=True, help="Take results that come out otherwise today; the page says so.")
@click.option("--film", is_flag=True, help=f"Also make {front_page.FILM}, README's moving picture.")
@click.option("--pages", "again", is_flag=True, help="Only make tables and pages anew from the rows that are kept.")
@click.option("--entries", is_flag=True, help="Only drive the entries of the leaderboard again, in place.")
@click.option("--results", default="results", show_default=True, metavar="DIR", help="Where the runs' folders are.")
@click.option("--root", default=".", show_default=True, metavar="DIR", help="The repository, with README.md and docs.")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
def main(
    first: bool,
    only: tuple[str, ...] | None,
    stale: bool,
    film: bool,
    again: bool,
    entries: bool,
    results: str,
    root: str,
    count: int | None,
) -> None:
    """Runs the suites and makes docs/results.md and the README's tables.

    A section without a folder keeps the tables that it had. A folder that other code made is run again, or with
    --no-run taken if a sample of its episodes comes out the same today, and refused otherwise.
    """
    above, home = Path(results), Path(root)
    wanted = [each for each in SECTIONS if only is None or each.name in only]
    try:
        if entries:
            for name, entry in submitted(home / LEADERBOARD).items():
                write(home / LEADERBOARD / name, entry_files(driven_today(entry, entry.card["entry"]["split"])))
            return
        if again:
            write(home, made_again(home))
            picture(home)
            return
        left = [each for each in wanted if first and not stale and not done(above / each.name)]
        for section in left:
            if section.needs:
                print(f"{section.name}: not run, it needs {section.needs}: `{section.command}`", file=sys.stderr)
            else:
                run(section, above, home, count)
        files: dict[str, bytes] = {}
        for section in wanted:
            if section.needs and section in left and only is None:
                continue
            if (above / section.name / MANIFEST).is_file():
                files |= gathered(section, above / section.name)
            elif only is not None:
                raise ValueError(f"--only {section.name}: {above / section.name} holds no finished run")
        store = Store(home, files)
        for section, made in store.sections():
            if section not in wanted:
                continue
            sample = check(section, store)
            if f"{RESULTS}/{section.name}.json" in files and not (stale or sample.shown or done(above / section.name)):
                raise ValueError(
                    f"{above / section.name} was made by other code, and {sample.words}: leave --no-run away to make "
                    "it anew, or give --stale to publish it as that"
                )
            store.changed[f"{RESULTS}/{section.name}.json"] = stamped(made, sample).content()
        write(home, store.changed | pages(store) | front_page.readme(store))
    except (OSError, ValueError) as error:
        raise click.ClickException(str(error)) from None
    picture(home)
    if film:
        write_whole(home / front_page.FILM, front_page.film(Store(home)))
    print(f"{home / PAGE} and {home / README} are made from {len(list((home / RESULTS).glob('*.json')))} runs")


def made_again(home: Path) -> dict[str, bytes]:
    """Returns the tables and the pages that the kept rows make, by their place; ValueError if rows are damaged."""
    store = Store(home)
    for section, made in store.sections():
        if (name := f"{ROWS}/{section.name}{SUFFIX}") in store:
            times = store.content(decisions_of(section)) if decisions_of(section) in store else b""
            store.changed |= tables(section, unpacked(store.content(name), section.name), made.command, times)
    return store.changed | pages(store) | front_page.readme(store)


def picture(home: Path) -> None:
    """Draws README's figure from the kept tables, where those of every task are there, and fronts from kept rows."""
    panels = list(front_page.panels(Store(home)))
    if len(panels) == front_page.TASKS:
        write_whole(home / front_page.FIGURE, front_page.figure(panels))
    for contest in CONTESTS.values():
        kept = home / ROWS / f"{contest.name}{SUFFIX}"
        if contest.speeds and kept.is_file():
            rows = Episodes.of(unpacked(kept.read_bytes(), contest.name))
            with tempfile.TemporaryDirectory() as folder:
                stem = Path(folder) / f"{contest.stem}_p3dx_front"
                saved(functools.partial(front, contest, rows, home), stem)
                write_whole(home / "docs" / f"{stem.name}.png", stem.with_suffix(".png").read_bytes())


def write(home: Path, files: Mapping[str, bytes]) -> None:
    """Writes files into the repository."""
    for name, content in files.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(home / name, content)


def done(folder: Path) -> bool:
    """Returns whether a folder holds a finished run of the installed code; OSError or ValueError if it is damaged."""
    return (folder / MANIFEST).is_file() and read_manifest(folder).get("code") == source_digest()


def run(section: Section, above: Path, home: Path, count: int | None = None) -> None:
    """Runs a section's command in the repository; what an earlier run left unfinished goes on."""
    out = ["--out", str((above / section.name).resolve()), *([] if count is None else ["--workers", str(count)])]
    start = time.monotonic()
    status = subprocess.run([sys.executable, *section.command.split()[1:], *out], cwd=home, check=False).returncode
    if status:
        raise click.ClickException(f"`{section.command}` ended with status {status}; nothing was published")
    print(f"{section.name}: {time.monotonic() - start:.0f} s", file=sys.stderr)


def gathered(section: Section, folder: Path) -> dict[str, bytes]:
    """Returns the files that the repository keeps of a finished run, by their place.

    Raises:
        ValueError: if one was changed or is missing.
        OSError: if one cannot be read.
    """
    manifest = read_manifest(folder)
    listed, code, command = (manifest.get(name) for name in ("files", "code", "command"))
    if not isinstance(listed, dict) or not isinstance(code, str) or not isinstance(command, str):
        raise ValueError(f"{folder / MANIFEST} must tell command, code and files of a run")
    files: dict[str, bytes] = {}
    for name in (*section.tables, *section.pictures, EPISODES, SWEEP, DECISIONS):
        file = folder / name
        if name not in listed:
            continue  # a run of some policies alone has no table of them all
        if not file.is_file() or file_digest(file) != listed[name]:
            raise ValueError(f"{file} is not as the run wrote it: run `{section.command}` again")
        if name == DECISIONS:
            files[decisions_of(section)] = file.read_bytes()
        elif name not in (EPISODES, SWEEP) and not (section.from_rows and name in section.tables):
            files[section.place(name)] = file.read_bytes()
    rows = read_rows(folder) if EPISODES in listed else Episodes()
    if rows:
        columns = thinned(rows) if section.of_contest else {name: rows.texts(name) for name in rows.names}
        files[f"{ROWS}/{section.name}{SUFFIX}"] = content = packed(columns)
        files |= tables(section, unpacked(content, section.name), command, files.get(decisions_of(section), b""))
    if not any(section.place(name) in files for name in section.tables):
        raise ValueError(f"{folder} has none of the tables {', '.join(section.tables)}")
    date = datetime.datetime.fromtimestamp((folder / MANIFEST).stat().st_mtime, datetime.UTC).date().isoformat()
    command = re.sub(r" --(?:out|workers) \S+", "", command)  # where and how fast is not what
    made = Made(command, version("wayfield"), commit() if code == source_digest() else "", date, scenarios(rows))
    files[f"{RESULTS}/{section.name}.json"] = made.content()
    return files


def decisions_of(section: Section) -> str:
    """Returns where the repository keeps how long the decisions of a section's policies took."""
    return f"{RESULTS}/{section.name}_{DECISIONS}"


def tables(section: Section, rows: Sequence[Row], command: str, decisions: bytes = b"") -> dict[str, bytes]:
    """Returns the tables of contests and documents, made from the rows that are kept, by their place.

    Args:
        decisions: the content of the run's file of decision times; nothing where it has none.
    """
    if section.name == DOCUMENTS:
        *whole, compared = document_tables(Episodes.of(rows), documents())
        files = [name for name in section.tables if name != TABLE]
        blocks = [f"## {each.title}\n\n{len(each.rows)} lines, [as a file]({file}). {each.note}\n"
                for file, each in zip(files, whole, strict=True)]  # fmt: skip
        page = "\n".join((*blocks, compared.markdown()))
        cells = {section.place(file): each.csv().encode() for file, each in zip(files, whole, strict=True)}
        return {section.place(TABLE): page.encode(), **cells}
    if not section.of_contest:
        return {}
    times = list(csv.DictReader(io.StringIO(decisions.decode())))
    made = contest_tables(rows, times, command, section.ladder)
    there = {name: made[name.removesuffix(".csv")] for name in section.tables if name.removesuffix(".csv") in made}
    return {section.place(name): table.csv().encode() for name, table in there.items()}


def scenarios(rows: Episodes) -> int:
    """Returns how many different scenarios the rows of the standings are about."""
    # contests have rows of the validation split and of the front too
    tested = rows
    if "split" in rows.names:
        shown = ("test", "claims", PUBLIC_SPLIT, "")  # of whatever hull class
        tested = rows.where(split=tuple(each for each in rows.unique("split") if each.partition("@")[0] in shown))
    names = [name for name in ("document", "contest", "scenario", "episode") if name in tested.names]
    return int(tested.numbered(*names).max()) + 1 if tested else 0


if __name__ == "__main__":
    main()
