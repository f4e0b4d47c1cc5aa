"""What a run says of itself while nobody's terminal shows a bar: now and then, and how long the rest takes."""

import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from wayfield.benchmarks import progress


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Returns a clock of which the last number is the time, s."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[-1])
    return now


def said(seconds: float, total: int, clock: list[float], capsys: pytest.CaptureFixture[str], **how: Any) -> list[str]:
    """Returns the lines of a run whose items take so many seconds each."""

    def items() -> Iterator[int]:
        for k in range(total):
            clock.append(clock[-1] + seconds)
            yield k

    assert list(progress.tracked(items(), total, "parts", **how)) == list(range(total))
    told = capsys.readouterr()
    assert told.out == ""
    return told.err.splitlines()


def test_a_line_comes_every_five_seconds_and_at_the_end(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    # nothing is foretold before a tenth is done
    assert said(2.5, 4, clock, capsys) == ["2 of 4 parts, 5 s, about 5 s left", "4 of 4 parts, 10 s"]
    assert said(2.0, 4, clock, capsys) == ["3 of 4 parts, 6 s, about 2 s left", "4 of 4 parts, 8 s"]
    assert said(0.1, 4, clock, capsys) == ["4 of 4 parts, 0 s"]
    assert said(6.0, 21, clock, capsys)[:4] == [
        "1 of 21 parts, 6 s", "2 of 21 parts, 12 s", "3 of 21 parts, 18 s, about 108 s left",
        "4 of 21 parts, 24 s, about 102 s left",
    ]  # fmt: skip
    assert said(6.0, 20, clock, capsys)[1] == "2 of 20 parts, 12 s, about 108 s left"
    assert said(6.0, 2, clock, capsys, foretold=False) == ["1 of 2 parts, 6 s", "2 of 2 parts, 12 s"]
    assert said(6.0, 0, clock, capsys) == []


def test_a_first_run_says_that_it_compiles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    step = types.SimpleNamespace(__name__="step")
    kernel = types.SimpleNamespace(py_func=step, _cache=types.SimpleNamespace(cache_path=str(tmp_path)))
    line = "first run: the kernels are compiled, which takes about a minute and is kept\n"
    for file, first in (("other.step-12.nbi", False), ("other.steps-12.nbi", True), ("other.step-12.nbc", True)):
        (tmp_path / file).touch()
        assert progress.tell_of_compiling(kernel) is first
        assert capsys.readouterr().err == (line if first else "")
        (tmp_path / file).unlink()
    kernel._cache.cache_path = None  # where nothing is kept
    assert progress.tell_of_compiling(kernel)
