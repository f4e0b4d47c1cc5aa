"""Writes the report of a finished run anew: python -m wayfield.benchmarks.report FOLDER"""

from pathlib import Path

import click

from wayfield.benchmarks.contests import ALL_CONTESTS, DISTURBANCES, OF_KIND, OVERVIEW
from wayfield.benchmarks.entrants.documents import TITLES, documents
from wayfield.benchmarks.leaderboards.document_tables import document_tables, ranked, reproduced
from wayfield.benchmarks.leaderboards.leaderboard import contest_tables
from wayfield.benchmarks.records.results import EPISODES, read_rows
from wayfield.benchmarks.records.run_folder import REPORT, read_manifest
from wayfield.benchmarks.report.page import Section, write_page
from wayfield.benchmarks.runs.decisions import DECISIONS, read_decisions
from wayfield.system.checks import unread
from wayfield.system.command_line import OneLineErrors


def section_of(folder: Path, command: str) -> Section:
    """Returns what a report shows of a folder of episodes.

    Raises:
        ValueError: if its episodes are damaged or of a suite without a report.
        OSError: if a file cannot be opened.
    """
    rows = read_rows(folder)
    if not rows:
        raise ValueError(f"{folder / EPISODES} holds no episodes")
    if rows[0].get("contest") in ALL_CONTESTS:
        ladder = rows[0]["suite"] == DISTURBANCES
        decisions = read_decisions(folder) if (folder / DECISIONS).is_file() else []
        return Section(folder, list(contest_tables(rows, decisions, command, ladder).values()))
    if rows[0].get("contest") not in (*TITLES, *OF_KIND):
        raise ValueError(
            f"{folder / EPISODES} is of suite {rows[0].get('suite')!r}, whose report is written by its run"
        )
    cases = documents()
    small = reproduced(rows, cases) if rows[0]["contest"] in TITLES else ranked(rows)
    return Section(folder, document_tables(rows, cases), small)


@click.command("report", cls=OneLineErrors)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="The file.  [default: report.html in the folder]")
def main(folder: Path, out: Path | None) -> None:
    """Writes the report of the run in FOLDER anew, from its files alone."""
    parts = [each for each in (folder, folder / "contests", folder / "documents") if (each / EPISODES).is_file()]
    if not parts:
        raise click.UsageError(f"FOLDER {str(folder)!r} holds no run: there is no {EPISODES}")
    try:
        command = read_manifest(parts[0])["command"]
    except (OSError, ValueError, LookupError):
        command = "not known"
    target = out or folder / REPORT
    try:
        sections = [section_of(each, str(command)) for each in parts]
        suite = OVERVIEW if parts[0] != folder else folder.resolve().name
        write_page(target, f"wayfield: {suite}", sections, str(command))
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:
        raise click.UsageError(unread(error.filename, error) if error.filename else str(error)) from None
    print(f"Report: {target}")


if __name__ == "__main__":
    main()
