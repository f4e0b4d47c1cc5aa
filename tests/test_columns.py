"""Rows held by columns are what was put in, to the letter, whatever a column turns out to hold."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wayfield.benchmarks import columns
from wayfield.benchmarks.columns import Rows, text
from wayfield.benchmarks.parts import drives_of
from wayfield.benchmarks.results import number, read_rows, write_rows

NUMBERS = st.floats(allow_nan=True, allow_infinity=False)
CELLS = st.one_of(
    NUMBERS.map(text), NUMBERS.map(repr), st.sampled_from(["", "0", "1", "lqr", "-0.0", "1_0", "inf", "7.50"])
)
ROWS = st.lists(st.dictionaries(st.sampled_from("abcd"), CELLS, min_size=1), max_size=40)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes columns change from texts to numbers and back within a few rows."""
    monkeypatch.setattr(columns, "_AT_ONCE", 3)
    monkeypatch.setattr(columns, "_MOST_TEXTS", 4)


def test_a_number_takes_eight_bytes_and_a_column_of_texts_is_known_as_such(
    small: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many rows come, it is found out once what a column holds."""
    tried: list[int] = []
    whole = columns._numbers

    def counted(cells: Any, written: Any) -> Any:
        tried.append(len(cells))
        return whole(cells, written)

    monkeypatch.setattr(columns, "_numbers", counted)
    for cell, of_numbers in ((lambda k: text(0.1 * k), True), (lambda k: f"scenario {k}", False)):
        tried.clear()
        rows = Rows({"a": cell(k)} for k in range(90))
        assert rows == [{"a": cell(k)} for k in range(90)]
        held = rows._columns["a"]
        if of_numbers:
            assert (sum(part.nbytes for part in held._parts), held._codes, held._texts) == (8 * 90, {}, [])
        else:
            assert len(tried) == 2  # in the two ways in which numbers are written
            assert len(held._codes) == 90


def test_every_cell_is_asked_for_once() -> None:
    asked: list[str] = []

    class Row(dict[str, str]):
        def get(self, name: str, default: str = "") -> str:  # type: ignore[override]
            asked.append(name)
            return super().get(name, default)

    rows = Rows(Row(a=str(k), b="x") for k in range(50))
    assert len(asked) == 2 * len(rows)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(given_rows=ROWS)
def test_rows_come_back_to_the_letter(small: None, given_rows: list[dict[str, str]]) -> None:
    names = list(dict.fromkeys(name for row in given_rows for name in row))
    rows = Rows(given_rows)
    assert rows.names == names
    assert rows == [{name: row.get(name, "") for name in names} for row in given_rows]
    for row, had in zip(rows, given_rows, strict=True):
        for name in (*names, "none of these"):
            try:
                expected = float(had.get(name) or math.nan)
            except ValueError:
                with pytest.raises(ValueError, match=f"column {name!r} holds"):
                    number(row, name)
                continue
            assert number(row, name) == expected or (math.isnan(expected) and math.isnan(number(row, name)))


@given(values=st.lists(NUMBERS, min_size=1, max_size=40))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_of_numbers_is_read_to_the_last_bit(
    small: None, tmp_path_factory: pytest.TempPathFactory, values: list[float]
) -> None:
    folder = tmp_path_factory.mktemp("run")
    write_rows(folder, [{"time": text(value), "policy": "lqr"} for value in values])
    rows = read_rows(folder)
    np.testing.assert_array_equal([number(row, "time") for row in rows], values)
    before = (folder / "episodes.csv").read_bytes()
    write_rows(folder, rows)
    assert (folder / "episodes.csv").read_bytes() == before


def test_a_column_is_put_in_place_of_another_or_behind_all() -> None:
    rows = Rows({"policy": "lqr", "trajectory": "9"} for _ in range(5000))
    rows.replace("trajectory", {4999: "00000"})
    rows.replace("more", {1: "x"})
    assert rows.names == ["policy", "trajectory", "more"]
    assert {k: row["trajectory"] for k, row in enumerate(rows) if row["trajectory"]} == {4999: "00000"}
    assert rows[1]["more"] == "x"
    assert rows[-1] == {"policy": "lqr", "trajectory": "00000", "more": ""}


def test_of_a_large_run_some_drives_of_every_part_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    class Piece:
        def __init__(self, k: int) -> None:
            self.folder, self.setting = Path(str(k)), type("Setting", (), {"episodes": 10})

    made: Any = [Piece(k) for k in range(6)]
    monkeypatch.setattr(
        "wayfield.benchmarks.parts.read_drives", lambda folder: dict.fromkeys(range(10), int(folder.name))
    )
    for most, wanted in (
        (60, set(range(60))),
        (59, {10 * part + k for part in range(6) for k in range(9)}),
        (7, {0, 10, 20, 30, 40, 50}),
        (3, {0, 20, 40}),
    ):
        monkeypatch.setattr("wayfield.benchmarks.parts.MOST_DRIVES", most)
        found = drives_of(made)
        assert set(found) == wanted
        assert all(part == row // 10 for row, part in found.items())


@pytest.mark.parametrize("lines", [[["1"]], [["1", "2", "3"]], [["1", "2"], ["3"]], [["1", "2"], ["3", "4", "5"]]])
def test_a_line_has_as_many_cells_as_there_are_names(lines: list[list[str]]) -> None:
    with pytest.raises(ValueError, match="zip"):
        Rows.of_lines(["a", "b"], lines)
