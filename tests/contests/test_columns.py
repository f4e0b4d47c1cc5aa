"""A table of episodes holds what was put in, by columns of one type each, and text is at the edge alone."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.records.episode import ARRIVALS, COLUMNS, Episodes
from wayfield.benchmarks.records.results import read_rows, write_rows

NUMBERS = st.floats(allow_infinity=False)
VALUES = {float: NUMBERS, int: st.integers(0, 2**40), str: st.text("ab ,\"'é", max_size=3)}
SOME = ("success", "time", "seed", "policy", "family", "failure_cost", "quantity")
ROW = st.fixed_dictionaries({}, optional={name: VALUES[COLUMNS[name].dtype] for name in SOME})
ROWS = st.lists(ROW.filter(bool), max_size=30)
MISSING: dict[type, Any] = {float: math.nan, int: -1, str: ""}


def same(a: Any, b: Any) -> bool:
    return bool(a == b or (a != a and b != b))


def whole(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns the rows with every column that any has."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [{name: row.get(name, MISSING[COLUMNS[name].dtype]) for name in names} for row in rows]


@given(rows=ROWS)
def test_a_table_holds_what_was_put_in(rows: list[dict[str, Any]]) -> None:
    episodes, wanted = Episodes(rows), whole(rows)
    assert len(episodes) == len(wanted)
    for k, row in enumerate(wanted):
        assert [*episodes[k]] == [*row] == episodes.names
        assert all(same(episodes[k][name], value) and same(episodes[name][k], value) for name, value in row.items())
    for name in episodes.names:
        assert episodes[name].dtype == {float: np.float64, int: np.int64, str: np.object_}[COLUMNS[name].dtype]


@given(rows=ROWS.filter(bool), picked=st.lists(st.integers(0, 29), max_size=9), name=st.sampled_from(SOME))
def test_parts_of_a_table_are_those_of_a_list(rows: list[dict[str, Any]], picked: list[int], name: str) -> None:
    rows = [row | {name: row.get(name, MISSING[COLUMNS[name].dtype])} for row in rows]
    at = [k for k in picked if k < len(rows)]
    episodes, listed = Episodes(rows)[np.array(at, np.int64)], [rows[k][name] for k in at]
    assert all(map(same, episodes[name], listed))
    different = [value for k, value in enumerate(listed) if not any(same(value, other) for other in listed[:k])]
    assert len(episodes.unique(name)) == len(different)
    assert all(map(same, episodes.unique(name), different))
    groups = episodes.groups(name)
    assert all(map(same, groups, different))
    for value, group in zip(different, groups.values(), strict=True):
        assert len(group) == sum(same(value, each) for each in listed)
        assert all(same(value, each) for each in group[name])
    for value in different:
        if value == value:
            assert len(episodes.where(**{name: value})) == len(groups[value])
    assert len(episodes.where(**{name: [value for value in different if value == value]})) == sum(
        value == value for value in listed
    )


@given(rows=ROWS.filter(bool))
def test_a_file_is_read_to_the_last_bit(tmp_path_factory: pytest.TempPathFactory, rows: list[dict[str, Any]]) -> None:
    folder = tmp_path_factory.mktemp("run")
    rows = [{"suite": "x"} | row for row in rows]  # a line of empty cells alone would be an empty one
    write_rows(folder, rows)
    before = (folder / "episodes.csv").read_bytes()
    assert read_rows(folder) == Episodes(rows)
    write_rows(folder, read_rows(folder))
    assert (folder / "episodes.csv").read_bytes() == before


def test_a_column_of_no_list_holds_numbers_where_all_of_it_are() -> None:
    episodes = Episodes([{"a": "1", "b": "x", "c": ""}, {"a": 2.5, "b": "7"}, {"b": ""}])
    np.testing.assert_array_equal(episodes["a"], [1.0, 2.5, math.nan])
    assert episodes["b"].tolist() == ["x", "7", ""]
    assert episodes.texts("a") == ["1", "2.5", ""]


def test_the_documents_name_every_column() -> None:
    table = (Path(__file__).parents[2] / "docs" / "columns.md").read_text(encoding="utf-8")
    own = [column for contest in CONTESTS.values() for column in contest.metrics]
    for column in (*COLUMNS.values(), ARRIVALS, *own):
        assert f"| {column.name} | {column.unit} | {column.meaning} |\n" in table
