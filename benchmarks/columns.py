"""Rows of text held by columns: a text that comes again is held once, a number takes eight bytes.

So the rows of ten million episodes fit in memory (docs/scale.md); as dicts they take 4,200 bytes each.
What is read of a row is what was written, to the letter.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

_AT_ONCE = 4096  # rows that are taken in as dicts or lists before they go into the columns
_MOST_TEXTS = 2**16  # different ones of a column, over which it is held as numbers where it is one of numbers


def text(value: float) -> str:
    """Returns a number so that reading it gives the same number; NaN is the empty cell, whole numbers have no point."""
    if math.isnan(value):
        return ""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _plain(value: float) -> str:
    """Returns a number as `repr` has it; NaN is the empty cell."""
    return "" if math.isnan(value) else repr(value)


class Rows(Sequence[Mapping[str, str]]):
    """Rows, each of which is a mapping from the names of all columns to its cells; what a row lacks is "".

    Args:
        rows: taken one after the other and not kept.
    """

    def __init__(self, rows: Iterable[Mapping[str, str]] = ()) -> None:
        self._columns: dict[str, _Column] = {}
        self._count = 0
        given = iter(rows)
        while taken := list(itertools.islice(given, _AT_ONCE)):
            names = dict.fromkeys(name for row in taken for name in row)
            self._take({name: [row.get(name, "") for row in taken] for name in names}, len(taken))

    @classmethod
    def of_lines(cls, names: Sequence[str], lines: Iterable[Sequence[str]]) -> "Rows":
        """Returns the rows of a table, whose lines have as many cells as there are names."""
        found = cls()
        given = iter(lines)
        while taken := list(itertools.islice(given, _AT_ONCE)):
            found._take(dict(zip(names, zip(*taken, strict=True), strict=True)), len(taken))
        return found

    @property
    def names(self) -> list[str]:
        """Returns the names of the columns, in the order in which they came up."""
        return list(self._columns)

    def replace(self, name: str, cells: Mapping[int, str]) -> None:
        """Puts a column in place of the one of that name, or behind all: some cells by their rows, the others ""."""
        column = self._columns[name] = _Column()
        for first in range(0, self._count, _AT_ONCE):
            column.take([cells.get(k, "") for k in range(first, min(first + _AT_ONCE, self._count))])

    def _take(self, columns: Mapping[str, Sequence[str]], count: int) -> None:
        for name in [name for name in columns if name not in self._columns]:  # in their order, which a set has not
            self._columns[name] = _Column()
            self._columns[name].take([""] * self._count)
        for name, cells in columns.items():
            self._columns[name].take(cells)
        for name in self._columns.keys() - columns.keys():
            self._columns[name].take([""] * count)
        self._count += count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, k: int) -> Mapping[str, str]: ...
    @overload
    def __getitem__(self, k: slice) -> Sequence[Mapping[str, str]]: ...
    def __getitem__(self, k: int | slice) -> Mapping[str, str] | Sequence[Mapping[str, str]]:
        if isinstance(k, slice):
            return [HeldRow(self._columns, i) for i in range(*k.indices(self._count))]
        return HeldRow(self._columns, range(self._count)[k])

    def __iter__(self) -> Iterator[Mapping[str, str]]:
        return (HeldRow(self._columns, k) for k in range(self._count))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or isinstance(other, str):
            return NotImplemented
        return len(self) == len(other) and all(map(dict.__eq__, map(dict, self), map(dict, other)))

    __hash__ = None  # type: ignore[assignment]


class HeldRow(Mapping[str, str]):
    """A row of `Rows`, which is no more than where it stands."""

    __slots__ = ("_columns", "_k")

    def __init__(self, columns: "dict[str, _Column]", k: int) -> None:
        self._columns, self._k = columns, k

    def __getitem__(self, name: str) -> str:
        return self._columns[name][self._k]

    def number(self, name: str) -> float:
        """Returns the number in a cell; NaN when it is empty or missing. ValueError if it is none."""
        return self._columns[name].number(self._k) if name in self._columns else math.nan

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __or__(self, more: Mapping[str, str]) -> dict[str, str]:
        return {**self, **more}

    def __repr__(self) -> str:
        return repr(dict(self))


class _Column:
    """The cells of a column: a number for each of its texts, or the numbers that they are."""

    def __init__(self) -> None:
        self._codes: dict[str, int] = {}  # of the texts
        self._texts: list[str] = []
        self._parts: list[NDArray[Any]] = []
        self._written: Callable[[float], str] | None = None  # how its numbers are, where it holds those
        self._of_texts = False  # whether it is known to be no column of numbers

    def take(self, cells: Sequence[str]) -> None:
        """Takes in further cells."""
        if self._written is not None:
            numbers = _numbers(cells, self._written)
            if numbers is not None:
                self._parts.append(numbers)
                return
            self._become_texts()
        codes = self._codes
        taken = np.array([codes.setdefault(cell, len(codes)) for cell in cells], np.uint32)
        self._parts.append(taken.astype(np.min_scalar_type(max(len(codes) - 1, 0))))
        if len(codes) > _MOST_TEXTS and not self._of_texts:
            self._become_numbers()

    def _become_numbers(self) -> None:
        """Holds the numbers that the texts are, where all are written in one way."""
        for written in (text, _plain):
            table = _numbers(list(self._codes), written)
            if table is not None:
                self._parts = [table[part] for part in self._parts]
                self._codes, self._texts, self._written = {}, [], written
                return
        self._of_texts = True

    def _become_texts(self) -> None:
        """Holds texts again: a cell has come that is no number, or is written otherwise."""
        written, parts = self._written, self._parts
        assert written is not None
        self._parts, self._written, self._of_texts = [], None, True
        for part in parts:
            self.take([written(number) for number in part.tolist()])

    def __getitem__(self, k: int) -> str:
        value = self._held(k)
        return self._texts[value] if self._written is None else self._written(float(value))

    def number(self, k: int) -> float:
        """Returns the number in a cell; NaN when it is empty. ValueError if it is none."""
        value = self._held(k)
        return float(self._texts[value] or math.nan) if self._written is None else float(value)

    def _held(self, k: int) -> Any:
        """Returns the code of a cell, or its number."""
        if len(self._parts) > 1:
            self._parts = [np.concatenate(self._parts)]
        if len(self._texts) < len(self._codes):
            self._texts = list(self._codes)
        return self._parts[0][k]


def _numbers(cells: Sequence[str], written: Callable[[float], str]) -> NDArray[np.float64] | None:
    """Returns the numbers that cells are; None where one is none, or is not as it would be written."""
    try:
        numbers = [float(cell or math.nan) for cell in cells]
        exact = all(map(str.__eq__, map(written, numbers), cells))
    except (OverflowError, ValueError):
        return None
    return np.array(numbers) if exact else None
