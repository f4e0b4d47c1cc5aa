"""Lists are as wide as COLUMNS says, and fit 80 characters where nothing does."""

import os
import subprocess
import sys

import pytest


@pytest.mark.parametrize("words", [("policies",), ("scenarios",), ("robots",), ("train", "--settings")])
@pytest.mark.parametrize("columns", [None, "60", "100"])
def test_a_list_that_is_piped_honours_columns_and_else_fits_80(words: tuple[str, ...], columns: str | None) -> None:
    env = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    env |= {"PYTHONIOENCODING": "utf-8"} | ({"COLUMNS": columns} if columns else {})
    code = "import sys; from wayfield.command import main; sys.argv[0] = 'wayfield'; main()"
    told = subprocess.run(
        [sys.executable, "-c", code, *words], env=env, capture_output=True, encoding="utf-8", check=True
    )
    widest = max(map(len, told.stdout.splitlines()))
    assert widest <= int(columns or 80)
    assert columns is None or widest > int(columns) - 20  # the room is used
