"""A table as text, and how it is written: Markdown, LaTeX, CSV, or for a terminal."""

import csv
import dataclasses
import html
import io
import re
import textwrap
from collections.abc import Mapping
from typing import Any

import rich.box
import rich.table
from rich.markup import escape
from tabulate import tabulate

from wayfield.system.checks import printable

_TAG = re.compile(r"<(?=[A-Za-z/!?])|&(?=#?\w+;)")  # what begins a tag or an entity
_CELL_WIDTH = 26  # of a terminal's cells, in characters
_WHOLE_WORDS: Mapping[str, Any] = {"subsequent_indent": "  ", "break_long_words": False, "break_on_hyphens": False}


@dataclasses.dataclass(frozen=True)
class Table:
    """A table as text cells."""

    title: str
    header: list[str]
    rows: list[list[str]]
    note: str

    def __post_init__(self) -> None:
        """Escapes what does not print in texts, which may be names of the user's."""
        for name in ("title", "note"):
            object.__setattr__(self, name, printable(getattr(self, name)))
        object.__setattr__(self, "header", list(map(printable, self.header)))
        object.__setattr__(self, "rows", [list(map(printable, row)) for row in self.rows])

    def markdown(self) -> str:
        """Returns the table as a Markdown section."""
        header, *rows = (list(map(_plain, row)) for row in (self.header, *self.rows))
        cells = tabulate(rows, header, tablefmt="github", disable_numparse=True)
        return f"## {_plain(self.title)}\n\n{cells}\n\n{self.note}\n"

    def latex(self) -> str:
        """Returns the table as a LaTeX tabular for the package booktabs, with title and note as comments."""
        cells = tabulate(self.rows, self.header, tablefmt="latex_booktabs", disable_numparse=True)
        return "\n".join([f"% {self.title}", cells, *(f"% {line}" for line in textwrap.wrap(self.note, 110))]) + "\n"

    def csv(self) -> str:
        """Returns the table's cells as CSV."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(self.rows)
        return text.getvalue()

    def terminal(
        self, columns: int | None = None, stacked: bool = False, cell_width: int = _CELL_WIDTH
    ) -> rich.table.Table:
        """Returns the table, or its first columns, for a rich console; a rule stands between experiments.

        Args:
            stacked: whether intervals, published figures and gains stand below what they belong to, which takes less
                room.
            cell_width: characters after which the text of a cell goes on in another line.
        """
        table = rich.table.Table(
            title=escape(self.title),
            title_justify="left",
            box=rich.box.SIMPLE_HEAD,
            pad_edge=False,
            padding=(0, 1, 0, 0) if stacked else (0, 1),
        )
        header, rows = self.header[:columns], [row[:columns] for row in self.rows]
        if stacked:
            header, *rows = (_stacked(self.header, row) for row in (header, *rows))
        for name in header:
            table.add_column(escape(name).replace(" (", "\n("), overflow="fold")
        first = [row[0] for row in self.rows]
        for row, name, following in zip(rows, first, (*first[1:], None), strict=False):
            lines = [cell.replace(" [", "\n[").replace(" / ", " /\n") if stacked else cell for cell in row]
            cells = [
                "\n".join("\n".join(textwrap.wrap(line, cell_width, **_WHOLE_WORDS)) for line in cell.split("\n"))
                for cell in lines
            ]
            table.add_row(*map(escape, cells), end_section=following is not None and following != name)
        return table


def _plain(text: str) -> str:
    """Returns a text that Markdown shows as it is: a bar is no border, a name no tag or entity."""
    return _TAG.sub(lambda match: html.escape(match[0]), text.replace("|", "\\|"))


def code_span(text: str) -> str:
    """Returns a text as Markdown's code, between more backticks than it has in a run."""
    ticks = "`" * (1 + max(map(len, re.findall("`+", text)), default=0))
    return f"{ticks}{text}{ticks}" if len(ticks) == 1 else f"{ticks} {text} {ticks}"


def _stacked(header: list[str], row: list[str]) -> list[str]:
    """Returns a row, or the header itself, with the gains below the policy that they are of."""
    if header[:2] != ["policy", "gains"]:
        return row
    return [f"{row[0]}\n  {row[1]}", *row[2:]]
