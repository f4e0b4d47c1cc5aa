"""The made-up populations by which intervals are judged, drawn once more in plain loops; and the table of it."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks import coverage
from wayfield.benchmarks.aggregates import counted_interval, interval, iqm
from wayfield.benchmarks.coverage import Design
from wayfield.benchmarks.crossed import exact_interval, share_interval
from wayfield.benchmarks.paired import difference

Draw = Callable[[np.random.Generator, int, int, int], Any]
SIZES = [(5, 7, 1), (5, 7, 4), (2, 3, 2)]


def share(k: int, families: int) -> float:
    return k / (families - 1)


def looped(families: int, scenarios: int, agents: int, one: Callable[[int, int, int], float]) -> Any:
    return [[[one(f, s, a) for a in range(agents)] for s in range(scenarios)] for f in range(families)]


def errors(rng: np.random.Generator, size: tuple[int, int, int], lost: float) -> Any:
    families, scenarios, agents = size
    hard = rng.normal(size=(families, scenarios, 1))
    agent = 0.15 * rng.normal(size=agents) if agents > 1 else [0.0]
    both = 0.3 * rng.normal(size=size) if agents > 1 else np.zeros(size)
    gone = rng.random(size) < lost

    def one(f: int, s: int, a: int) -> float:
        level, spread = -1.0 + 2.0 * share(f, families), 0.2 + 0.6 * share(f, families)
        return 1.0 if gone[f, s, a] else 0.01 * float(np.exp(level + spread * hard[f, s, 0] + agent[a] + both[f, s, a]))

    return looped(*size, one)


def successes(rng: np.random.Generator, size: tuple[int, int, int], failing: float) -> Any:
    families, scenarios, agents = size
    hard = rng.gamma(1.0, size=(families, scenarios, 1)) if agents > 1 else np.ones((families, scenarios, 1))
    agent = rng.gamma(10.0, 0.1, size=agents) if agents > 1 else [1.0]
    luck = rng.random(size)
    return looped(*size, lambda f, s, a: float(
        luck[f, s, a] >= min(1.0, 2.0 * failing * share(f, families) * hard[f, s, 0] * agent[a])))  # fmt: skip


def scores(rng: np.random.Generator, size: tuple[int, int, int]) -> Any:
    won, noise = successes(rng, size, 0.1), rng.normal(size=size)
    return looped(*size, lambda f, s, a: won[f][s][a] * min(1.0, max(
        0.0, 0.3 + 0.6 * share(f, size[0]) + 0.1 * noise[f, s, a])))  # fmt: skip


def times(rng: np.random.Generator, size: tuple[int, int, int], failing: float) -> Any:
    won, hard = successes(rng, size, failing), rng.normal(size=(*size[:2], 1))
    agent = rng.normal(size=size[2]) if size[2] > 1 else [0.0]
    both = rng.normal(size=size) if size[2] > 1 else np.zeros(size)

    def one(f: int, s: int, a: int) -> float:
        taken = np.exp(1.6 + share(f, size[0]) + 0.3 * hard[f, s, 0] + 0.05 * agent[a] + 0.1 * both[f, s, a])
        return min(float(taken), 54.0) if won[f][s][a] else 60.0

    return looped(*size, one)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_a_population_is_its_docstring(size: tuple[int, int, int]) -> None:
    alone = (*size[:2], 1)
    cases: list[tuple[Draw, Callable[[np.random.Generator], Any]]] = []
    for rate in (0.0, 0.2, 0.9):
        cases += [
            (coverage.errors(rate), lambda rng, rate=rate: errors(rng, size, rate)),
            (coverage.successes(rate), lambda rng, rate=rate: successes(rng, size, rate)),
            (coverage.times(rate), lambda rng, rate=rate: times(rng, size, rate)),
            (
                coverage.pairs_of_successes(rate),
                lambda rng, rate=rate: np.subtract(successes(rng, size, rate), successes(rng, alone, rate)),
            ),
            (
                coverage.pairs_of_times(rate, 0.4),
                lambda rng, rate=rate: np.subtract(times(rng, size, rate), times(rng, alone, 0.4)),
            ),
        ]
    cases += [
        (coverage.scores, lambda rng: scores(rng, size)),
        (
            coverage.pairs_of_errors,
            lambda rng: np.subtract(errors(rng, size, 0.0), 1.1 * np.array(errors(rng, alone, 0.0))),
        ),
    ]
    for draw, restated in cases:
        found = draw(np.random.default_rng(3), *size)
        assert found.shape == size
        assert found == pytest.approx(np.array(restated(np.random.default_rng(3))), rel=1e-12)


def test_levels_are_cut_where_scores_and_times_end(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = coverage.scores(np.random.default_rng(0), 3, 4000, 1)
    assert drawn.min() == 0.0
    assert drawn.max() == 1.0
    monkeypatch.setattr(coverage, "_CLOCK", 20.0)
    drawn = coverage.times(0.1)(np.random.default_rng(0), 3, 1000, 5)
    assert sorted(set(drawn.ravel()))[-2:] == [18.0, 20.0]  # a success ends short of the clock


def test_intervals_are_those_of_the_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coverage, "RESAMPLES", 30)
    rng = np.random.default_rng(1)
    strata = [name for name in "abc" for _ in range(6)]
    values = np.where(rng.random((18, 2)) < 0.2, 60.0, rng.uniform(5.0, 20.0, (18, 2)))
    assert coverage.bootstrap(iqm)(values, strata, 4) == interval(values, strata, iqm, 4, 30)
    won = (values < 60.0).astype(float)
    assert coverage.of_counted(60.0)(values, strata, 4) == counted_interval(values, won, 60.0, strata, 4, 30)
    assert coverage.of_shares(won, strata, 4) == share_interval(won, strata)
    for reduction, dearer in (("mean", 51.0), ("iqm", 0.0), ("share", 0.0)):
        wanted = difference(values, np.zeros((18, 1)), strata, reduction, dearer)  # type: ignore[arg-type]
        assert coverage.of_pairs(reduction, dearer)(values, strata, 4) == (wanted.low, wanted.high)  # type: ignore[arg-type]


def test_every_interval_that_tables_show_has_its_design() -> None:
    found = coverage.designs()
    told = [(each.what, each.where, each.families, each.scenarios, each.agents) for each in found]
    assert len(set(told)) == len(told)
    sizes = {
        "in the standings, path following": (13, 10), "in the standings, goal reaching": (20, 10),
        "on the front": (13, 5), "in the standings, docking": (5, 10), "on the ladder, path following": (13, 5),
        "on the ladder, goal reaching": (20, 5),
    }  # fmt: skip
    assert all(sizes[where] == (families, count) for _, where, families, count, _ in told)
    assert {(what, where) for what, where, *_, agents in told if agents == 1} == {
        (what, where) for what, where, *_, agents in told if agents == 10
    }
    kinds = {what: {where for other, where, *_ in told if other == what} for what, *_ in told}
    paths, goals, front, docking, ladder, goal_ladder = sizes
    assert kinds == {
        **{what: {paths, front} for what in ("error, IQM", "error, IQM, 7 % lost", "paired difference of errors")},
        "score, mean": {goals},
        **{f"time, {share} % reached": {goals, docking} for share in (100, 98, 85)},
        "paired difference of times, 99.6 and 98 %": {goals, docking},
        **{f"success, {share} %": {paths, goals, ladder, goal_ladder} for share in (99, 85)},
        **{f"paired difference of success, {share} %": {paths, goals, ladder, goal_ladder} for share in (99, 85)},
    }
    many = {each.what: each.draw(np.random.default_rng(0), each.families, 3000, 1) for each in found}
    for share in (100, 98, 85):
        assert 100.0 * (many[f"time, {share} % reached"] < 60.0).mean() == pytest.approx(share, abs=0.7)
    for share in (99, 85):
        assert 100.0 * many[f"success, {share} %"].mean() == pytest.approx(share, abs=0.7)
        assert set(np.unique(many[f"paired difference of success, {share} %"])) == {-1.0, 0.0, 1.0}
    assert (many["error, IQM"] == 1.0).mean() < 0.01
    assert (many["error, IQM, 7 % lost"] == 1.0).mean() == pytest.approx(0.07, abs=0.01)
    for each in found:
        strata = [f"{k}" for k in range(each.families) for _ in range(each.scenarios)]
        sample = each.draw(np.random.default_rng(5), each.families, each.scenarios, each.agents)
        middle = "IQM" in each.what or "errors" in each.what
        assert float(each.reduce(sample.ravel())) == pytest.approx(iqm(sample.ravel()) if middle else sample.mean())
        ends = each.ends(sample.reshape(len(strata), -1), strata, 0)
        assert ends is not None
        assert ends[0] < float(each.reduce(sample.ravel())) < ends[1]


def test_an_interval_is_judged_by_the_whole_population(monkeypatch: pytest.MonkeyPatch) -> None:
    for agents in (1, 3):
        asked: list[tuple[int, int, int]] = []
        seen: list[Any] = []

        def draw(rng: Any, families: int, scenarios: int, count: int, asked: Any = asked) -> Any:
            asked.append((families, scenarios, count))
            return np.full((families, scenarios, count), float(len(asked)))

        def ends(values: Any, strata: list[str], seed: int, seen: Any = seen) -> tuple[float, float]:
            seen.append((values.shape, strata, seed))
            # the whole population's mean is 1: held by the first two, at their very ends, and by no other
            return ((1.0, 9.0), (-9.0, 1.0), (1.1, 9.0), (-9.0, 0.9))[seed]

        mine = Design("x", "y", 2, 3, agents, draw, lambda values: values.mean(), ends)
        monkeypatch.setattr(coverage, "designs", lambda mine=mine: [None, mine])
        drawn: list[int] = []

        def noting(rng: Any, *size: int, draw: Any = draw, drawn: Any = drawn) -> Any:
            drawn.append(int(rng.integers(2**62)))
            return draw(rng, *size)

        own = dataclasses.replace(mine, draw=noting)
        monkeypatch.setattr(coverage, "designs", lambda own=own: [None, own, own])
        for which, seed in ((1, 0), (1, 0), (1, 5), (2, 0)):
            coverage.covered((which, 1, seed))
        assert drawn[:2] == drawn[2:4]
        # another seed, or another design, draws other numbers; no two samples are drawn with the same
        assert len(set(drawn)) == 6
        asked.clear()
        seen.clear()
        monkeypatch.setattr(coverage, "designs", lambda mine=mine: [None, mine])
        assert coverage.covered((1, 4, 0)) == 2
        whole = (2, 2000, 100) if agents > 1 else (2, 40_000, 1)
        assert asked == [whole] + [(2, 3, agents)] * 4
        assert seen == [((6, agents), ["0", "0", "0", "1", "1", "1"], k) for k in range(4)]


def test_the_table_of_coverage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = [Design(f"kind {k}", f"place {k}", 2 + k, 5, k, len, len, len) for k in (1, 10)]  # type: ignore[arg-type]
    asked: list[Any] = []

    class Workers:
        def __init__(self, count: int) -> None:
            asked.append(count)

        def __enter__(self) -> Any:
            return lambda function, wanted: asked.append((function, list(wanted))) or [37, 40]

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(coverage, "workers", Workers)
    monkeypatch.setattr(coverage, "designs", lambda: chosen)
    table = coverage.coverage_table(3, 40, 9, "it")
    assert asked == [3, (coverage.covered, [(0, 40, 9), (1, 40, 9)])]

    def cell(count: int) -> str:
        low, high = exact_interval(count / 40, 40)
        return f"{100.0 * count / 40:.1f} [{100.0 * low:.1f}, {100.0 * high:.1f}]"

    assert table.rows == [
        ["kind 1", "place 1", "3 x 5", "a policy", cell(37)], ["kind 10", "place 10", "12 x 5", "10 agents", cell(40)],
    ]  # fmt: skip
    assert table.header == ["interval", "where", "scenarios", "of", "covers (%)"]
    assert "In 40 samples" in table.note
    assert "less than 93 % where a family has 5 scenarios" in table.note
    assert "Made by `it`" in table.note
    monkeypatch.setattr(coverage, "cores", lambda: 7)
    for words, made, count in (
        ([], "", 7), (["--simulations", "40", "--workers", "2"], " --simulations 40", 2),
        (["--simulations", "1000"], "", 7),
    ):  # fmt: skip
        asked.clear()
        done = CliRunner().invoke(coverage.main, [*words, "--seed", "5", "--out", str(tmp_path)])
        assert done.exit_code == 0, done.output
        made += " --seed 5"
        assert asked[0] == count
        assert asked[1][1] == [(k, 40 if "40" in made else 1000, 5) for k in range(2)]
        assert f"`python -m wayfield.benchmarks.coverage{made}`" in " ".join(done.output.split())
        assert "kind 10" in done.output
        text = (tmp_path / "coverage.csv").read_text(encoding="utf-8")
        assert re.search(r"kind 10,place 10,12 x 5,10 agents,", text)
        assert "kind 1" in (tmp_path / "table.md").read_text(encoding="utf-8")
    blocked = tmp_path / "file"
    blocked.touch()
    done = CliRunner().invoke(coverage.main, ["--out", str(blocked / "in")])
    assert done.exit_code == 1
    assert "cannot be written" in done.output
