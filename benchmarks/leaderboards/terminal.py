"""What a run prints: the result and one small table of each task, no wider than the terminal."""

import shutil
import textwrap
from collections.abc import Iterable, Sequence

from tabulate import tabulate

from wayfield.benchmarks.leaderboards.entries import OFF_PACE
from wayfield.benchmarks.records.table import Table
from wayfield.system.command_line import say

WIDTH = 100  # characters, where the terminal has them
MOST_LINES = 6  # of a small table
_NAME_WIDTH = 30  # of the first column in a narrow terminal, in characters
_SHORT = {"speed (m/s)": "m/s", "tracking error (mm)": "error (mm)"}


def print_short(
    findings: Iterable[tuple[str, Table | None]], most: int = WIDTH, lines: int | None = MOST_LINES
) -> None:
    """Prints for each task its result, a sentence and a small table if it has one, at most `most` characters wide.

    Args:
        lines: of a table, at most; None: all.
    """
    width = min(most, shutil.get_terminal_size((most, 24)).columns)
    for sentence, table in findings:
        say(textwrap.fill(sentence, width, break_long_words=False, break_on_hyphens=False))
        if table is not None:
            rows = table.rows[:lines]
            say(_small(table.header, rows, width))
            if any(OFF_PACE in cell for row in rows for cell in row):
                print(f"{OFF_PACE}: mean speed more than 3 % off the target")
            if len(rows) < len(table.rows):
                print(f"{len(table.rows) - len(rows)} more in table.md")
        print()


def _small(names: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> str:
    """Returns lines of a table; where they are too wide, intervals, units, names go on in a second line."""
    header = [_SHORT.get(name, name) for name in names]
    text = tabulate(rows, header, tablefmt="plain", disable_numparse=True)
    if max(map(len, text.splitlines())) > width:
        rows = [[cell.replace(" [", "\n[") for cell in row] for row in rows]
        rows = [["\n".join(textwrap.wrap(name, _NAME_WIDTH)), *cells] for name, *cells in rows]
        header = [name.replace(" (", "\n(") for name in header]
        text = tabulate(rows, header, tablefmt="simple", disable_numparse=True)
    return "\n".join(line[:width].rstrip() for line in text.splitlines())
