"""The notebooks run, cell after cell, and print as many lines as are kept in them."""

import contextlib
import io
import json
from pathlib import Path

import pytest

BOOKS = sorted((Path(__file__).parents[2] / "docs/notebooks").glob("*.ipynb"))


@pytest.mark.slow
@pytest.mark.parametrize("book", BOOKS, ids=lambda book: book.stem)
def test_a_notebook_runs(book: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "stable_baselines3" in book.read_text(encoding="utf-8"):
        pytest.importorskip("stable_baselines3", reason='needs pip install "wayfield[train]"')
    monkeypatch.chdir(tmp_path)
    scope = {"__name__": "__main__"}
    for cell in json.loads(book.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            said = io.StringIO()
            with contextlib.redirect_stdout(said):
                exec(compile("".join(cell["source"]), book.stem, "exec"), scope)
            kept = "".join(line for output in cell["outputs"] for line in output["text"])
            assert said.getvalue().count("\n") == kept.count("\n")


def test_what_a_notebook_keeps_is_small() -> None:
    assert len(BOOKS) >= 3
    assert all(book.stat().st_size < 20_000 for book in BOOKS)
