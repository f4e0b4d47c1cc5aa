"""Rows that a study keeps as CSV: what a file of them lacks is driven, and written part by part.

A run may be stopped at any time; rows of what has changed since are to be taken away before the next one.
"""

import csv
import io
import lzma
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from tabulate import tabulate

from wayfield.system.checks import MOST_BYTES
from wayfield.system.storage import write_whole
from wayfield.system.unpacking import xz_rows

Row = Mapping[str, str]
# of some rows the fields by which they are known, and what returns the others, row by row
Part = tuple[Row, Callable[[], Iterable[Sequence[Any]]]]


def read(file: Path) -> list[dict[str, str]]:
    """Returns the rows of a file, packed where it ends in .xz; none where it is not there."""
    if not file.exists():
        return []
    if file.suffix == ".xz":
        names, *lines = xz_rows(file.read_bytes(), MOST_BYTES, MOST_BYTES)
        return [dict(zip(names, line, strict=True)) for line in lines]
    return list(csv.DictReader(io.StringIO(file.read_text("utf-8"))))


def write(file: Path, fields: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Writes the rows of a file whole, packed where it ends in .xz."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fields, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    content = text.getvalue().encode()
    write_whole(file, lzma.compress(content) if file.suffix == ".xz" else content)


def drive_missing(file: Path, fields: Sequence[str], parts: Iterable[Part]) -> list[dict[str, str]]:
    """Drives the parts that a file lacks, writes it after each, and returns its rows.

    Args:
        fields: of the file; "world" is the number of a row in its part.
    """
    rows = read(file)
    lacking = [part for part in parts if not any(part[0].items() <= row.items() for row in rows)]
    for known, drives in lacking:
        for world, cells in enumerate(drives()):
            given = iter(map(str, cells))
            rows.append({name: known.get(name) or (str(world) if name == "world" else next(given)) for name in fields})
        write(file, fields, rows)
        click.echo(", ".join(known.values()), err=True)
    return rows


def table(lines: Iterable[Sequence[Any]], header: Sequence[str]) -> str:
    """Returns a table of text."""
    return str(tabulate(list(lines), list(header), tablefmt="github", disable_numparse=True))
