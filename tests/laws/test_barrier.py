"""The barrier: its program beside OSQP, its bound of gamma beside a simulation, and what it refuses.

What it keeps from harm is tested with the shield.
"""

import dataclasses
from typing import Any

import gymnasium
import numpy as np
import osqp
import pytest
from scipy import sparse

from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.records import lag_factors
from wayfield.policies import Barrier, cbf, make
from wayfield.policies.parts.barrier import most_gamma, nearest_allowed


def test_the_closed_form_is_osqp() -> None:
    rng = np.random.default_rng(0)
    solved = held = 0
    for _ in range(1500):
        n, weight = int(rng.integers(1, 17)), float(rng.choice([0.02, 0.3, 1.0]))
        rows = np.column_stack([rng.normal(size=(n, 2)), rng.uniform(-1.5, 0.4, n)])
        x, y = rng.uniform(-2.0, 2.0, 2)
        found = nearest_allowed(rows, x, y, weight)
        solver = osqp.OSQP()
        p, q = 2.0 * np.diag([1.0, weight]), -2.0 * np.array([x, weight * y])
        options: dict[str, Any] = {"eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 50_000, "polishing": True}
        sides = rows[:, 2], np.full(n, np.inf)
        solver.setup(sparse.csc_matrix(p), q, sparse.csc_matrix(rows[:, :2]), *sides, verbose=False, **options)
        told = solver.solve(raise_error=False)
        if told.info.status_val != osqp.SolverStatus.OSQP_SOLVED:
            assert not found[2] or told.info.status_val != osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE
            continue
        assert found[2]
        np.testing.assert_allclose(found[:2], told.x, atol=1e-6)
        solved += 1
        held += abs(found[0] - x) + abs(found[1] - y) > 1e-6
    assert solved > 800
    assert held > 400


@pytest.mark.parametrize("tier", ACTUATORS)
def test_below_its_bound_gamma_overshoots_nothing_along_a_line(tier: str) -> None:
    actuators, dt = ROBOTS["p3dx"].actuators(tier), 0.05
    decay, mean = lag_factors(actuators.lag, dt)

    def deepest(gamma: float) -> float:
        gap, speed = 3.0, 0.0
        least = gap
        for _ in range(4000):
            asked = gamma * gap
            gap -= dt * (asked + mean * (speed - asked))
            speed = asked + decay * (speed - asked)
            least = min(least, gap)
        return least

    bound = most_gamma(actuators, dt)
    assert bound == pytest.approx({"ideal": 10.0, "lagged": 2.0, "slow": 0.909}[tier], abs=1e-3)
    assert deepest(bound) > -1e-12
    assert deepest(2.5 * bound) < -1e-3


def test_what_it_is_not_for_is_refused_in_a_line() -> None:
    env: Any = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", actuators="lagged", num_beams=72)
    env.reset(seed=0)
    briefing = env.unwrapped.briefing("sensors")
    Barrier(gamma=2.0).reset(briefing)
    with pytest.raises(ValueError, match=r"^Barrier: gamma is 10; it must be at most 2 1/s = 1/\(4 \(lag \+ dt/2\)\)"):
        Barrier(gamma=10.0).reset(briefing)
    with pytest.raises(ValueError, match="gamma"):
        cbf(make("vfh_plus"), gamma=-1.0)
    car = dataclasses.replace(briefing, robot=dataclasses.replace(ROBOTS["p3dx"], name="car", turning_radius=0.5))
    with pytest.raises(ValueError, match="Barrier needs a robot that turns on the spot"):
        Barrier().reset(car)
    with pytest.raises(ValueError, match="Barrier needs a scan of at least half a turn; num_beams is 0"):
        Barrier().reset(dataclasses.replace(briefing, beam_angles=np.empty(0)))
