"""The synthetic populations by which intervals are judged, drawn in plain loops."""

from collections.abc import Callable
from typing import Any

import interval_coverage
import numpy as np
import pytest

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
            (interval_coverage.errors(rate), lambda rng, rate=rate: errors(rng, size, rate)),
            (interval_coverage.successes(rate), lambda rng, rate=rate: successes(rng, size, rate)),
            (interval_coverage.times(rate), lambda rng, rate=rate: times(rng, size, rate)),
            (
                interval_coverage.pairs_of_successes(rate),
                lambda rng, rate=rate: np.subtract(successes(rng, size, rate), successes(rng, alone, rate)),
            ),
            (
                interval_coverage.pairs_of_times(rate, 0.4),
                lambda rng, rate=rate: np.subtract(times(rng, size, rate), times(rng, alone, 0.4)),
            ),
        ]
    cases += [
        (interval_coverage.scores, lambda rng: scores(rng, size)),
        (
            interval_coverage.pairs_of_errors,
            lambda rng: np.subtract(errors(rng, size, 0.0), 1.1 * np.array(errors(rng, alone, 0.0))),
        ),
    ]
    for draw, restated in cases:
        found = draw(np.random.default_rng(3), *size)
        assert found.shape == size
        assert found == pytest.approx(np.array(restated(np.random.default_rng(3))), rel=1e-12)
