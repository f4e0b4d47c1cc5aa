"""What a run prints: who wins and one small table a task, no wider than a terminal."""

import textwrap
from collections.abc import Iterable

from tabulate import tabulate

from wayfield.benchmarks.table import Table

WIDTH = 100  # characters
MOST_LINES = 6  # of a small table


def print_short(told: Iterable[tuple[str, Table]]) -> None:
    """Prints for each task the sentence that says who wins, and a small table."""
    for sentence, table in told:
        print(textwrap.fill(sentence, WIDTH, break_long_words=False, break_on_hyphens=False))
        lines = table.rows[:MOST_LINES]
        header = [name.replace("speed (m/s)", "m/s") for name in table.header]
        for line in tabulate(lines, header, tablefmt="simple", disable_numparse=True).splitlines():
            print(line[:WIDTH].rstrip())
        if len(table.rows) > MOST_LINES:
            print(f"{len(table.rows) - MOST_LINES} more in table.md")
        print()
