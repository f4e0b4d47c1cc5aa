"""Our laws against numbers that others' programs gave, kept in tests/fixtures with their sources."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles import model_predictive

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.crowds.half_planes import best_velocity, disc_half_plane, nearest_velocity
from wayfield.policies.paths.lqr import gain_table

FIXTURES = Path(__file__).parents[1] / "fixtures"
HORIZON, LIMIT = 2.0, 1.0  # of the sets that RVO2 was given


def anchor(name: str) -> Any:
    return json.loads((FIXTURES / name).read_text(encoding="utf-8"))


def test_velocities_are_those_of_rvo2() -> None:
    """In a thousand sets of neighbours, some of which leave no velocity at all; RVO2 computes in single precision.

    RVO2's agents take half of the change each, ours all of it: half of the way to our half-plane is RVO2's.
    """
    with np.load(FIXTURES / "rvo2_velocities.npz", allow_pickle=False) as archive:
        neighbours, own, chosen = (archive[name].astype(np.float64) for name in ("neighbours", "own", "chosen"))
    assert len(chosen) == 1_000
    lines, scratch = np.empty((8, 3)), np.empty((8, 3))
    off, impossible = [], 0
    for others, (vx, vy, wanted_x, wanted_y, radius), velocity in zip(neighbours, own, chosen, strict=True):
        mine = others[~np.isnan(others[:, 0])]
        for j, (x, y, size, o_vx, o_vy) in enumerate(mine):
            nx, ny, b = disc_half_plane(x, y, radius + size, vx - o_vx, vy - o_vy, HORIZON, 0.5)
            lacking = b - nx * (vx - o_vx) - ny * (vy - o_vy)
            lines[j] = nx, ny, nx * vx + ny * vy + 0.5 * lacking
        found = best_velocity(lines, len(mine), 0, LIMIT, wanted_x, wanted_y, scratch)
        off.append(math.dist(found, velocity))
        impossible += nearest_velocity(lines, len(mine), LIMIT, wanted_x, wanted_y)[2] < len(mine)
    assert np.median(off) < 1e-7
    assert max(off) < 5e-5  # where two lines meet at a flat angle, single precision is no more exact
    assert impossible > 20


def test_gains_are_those_of_the_matrix_exponential() -> None:
    """Without lag to the last digits; with lag the mean yaw rate of a period differs a little."""
    for case in anchor("lqr_gains.json")["cases"]:
        speeds, gains = gain_table(case["speed"], case["dt"], case["lag"], case["q_e"], case["q_th"])
        found = [np.interp(case["speed"], speeds, column) for column in gains.T]
        exact = {0.0: 2e-3}.get(case["lag"], 2e-2)  # between the rows of the table it is linear
        np.testing.assert_allclose(found, case["gains"], rtol=exact, atol=1e-9)


@pytest.mark.parametrize(
    "case", anchor("ipopt_plans.json")["cases"], ids=lambda case: f"{case['scenario']}-{case['steps']}"
)
def test_plans_are_those_of_ipopt(case: dict[str, Any]) -> None:
    problem, _, memory, _ = model_predictive.planned(case["scenario"], case["steps"])
    model_predictive.same_plan(problem, memory, np.array(case["plan"]), case["total"])
