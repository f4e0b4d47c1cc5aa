"""The same bits whatever the processor: libraries that choose their code by it have no say in what is computed.

OpenBLAS and NumPy read variables that make them choose as on another processor. What this machine cannot run is left
out; on a machine without any choice nothing is compared.
"""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from wayfield.envs.robots import ROBOTS
from wayfield.policies.paths.lqr import model
from wayfield.system.linear import product, pseudo_inverse, riccati, solve

DIGESTS = """
import hashlib, gymnasium, numpy as np
import wayfield
from wayfield.policies import Pilot, make
GOAL, PATH = "wayfield/OmniGoalObstacles-v0", "wayfield/OmniPathFollowing-v0"
CASES = [
    (PATH, None, {"disturbance": "severe"}),
    (PATH, None, {"disturbance": "severe", "dynamics": "pymunk", "scenario": "figure_eight"}),
    (PATH, None, {"pose_source": "odometry", "action_mode": "wheel_speeds", "robot": "omni4", "noise": 1.0}),
    (GOAL, None, {"scenario": "mixed", "disturbance": "wheel_error", "pose_source": "odometry_uncorrected"}),
    (PATH, "lqr", {"scenario": "s_curve"}),
    (PATH, "stanley", {}),
    (GOAL, "waypoint", {"scenario": "omni3_waypoints"}),
    (GOAL, "apf_escape", {"scenario": "apf_2", "robot": "omni4"}),
    (GOAL, "apf_corrected", {"scenario": "discs"}),
    (GOAL, "dwa", {"scenario": "discs"}),
    (GOAL, "vfh_plus", {"scenario": "discs"}),
]
for env_id, policy, options in CASES:
    env = gymnasium.make_vec(env_id, 3, vectorization_mode="vector_entry_point", **options)
    seen, _ = env.reset(seed=0)
    sha = hashlib.sha256(seen.tobytes())
    rng = np.random.default_rng(0)
    pilot = Pilot(make(policy), env) if policy else None
    if pilot:
        pilot.reset()
    for _ in range(60):
        action = pilot.act(seen) if pilot else rng.uniform(-1.0, 1.0, env.action_space.shape) * env.action_space.high
        seen, reward, *_ = env.step(action)
        sha.update(np.asarray(action, np.float64).tobytes() + seen.tobytes() + reward.tobytes())
        sha.update(env.unwrapped.batch.states["x"].tobytes() + env.unwrapped.batch.states["heading"].tobytes())
    print(policy, options, sha.hexdigest())
"""


def digests(**environment: str) -> list[str]:
    """Returns a line a case, as a fresh interpreter with these variables prints them."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", DIGESTS],
        capture_output=True, text=True, timeout=600, env=os.environ | environment, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def switched_off() -> str:
    """Returns the features of this processor that NumPy has code for beyond its baseline."""
    known: Any = np.show_config(mode="dicts")
    return " ".join(known["SIMD Extensions"]["found"])


@pytest.mark.slow
def test_the_same_bits_on_every_processor() -> None:
    here = digests()
    assert len(here) == 11
    assert digests(OPENBLAS_CORETYPE="Nehalem", NPY_DISABLE_CPU_FEATURES=switched_off()) == here


# The algebra behind it, against NumPy's and SciPy's.


@pytest.mark.parametrize("name", ROBOTS)
def test_the_forward_map_is_the_pseudo_inverse(name: str) -> None:
    matrix = ROBOTS[name].wheel_matrix
    np.testing.assert_allclose(ROBOTS[name].forward_matrix, np.linalg.pinv(matrix), atol=1e-15)
    np.testing.assert_allclose(product(product(matrix, pseudo_inverse(matrix)), matrix), matrix, rtol=1e-13, atol=1e-14)


def test_linear_systems_are_solved() -> None:
    rng = np.random.default_rng(0)
    for n in (1, 3, 12):
        matrix, right = rng.normal(size=(n, n)), rng.normal(size=(n, 2))
        np.testing.assert_allclose(solve(matrix, right), np.linalg.solve(matrix, right), rtol=1e-9)
        np.testing.assert_allclose(product(matrix, right), matrix @ right, rtol=1e-12)
    with pytest.raises(ValueError, match="singular"):
        solve([[1.0, 2.0], [2.0, 4.0]], [[1.0], [1.0]])


@pytest.mark.parametrize("lag", [0.0, 0.05, 0.1, 0.25, 1.0])
@pytest.mark.parametrize("weights", [(40.0, 4.0), (1e-3, 1e-3), (1e4, 1e3)])
def test_doubling_solves_the_riccati_equation_as_scipy_does(lag: float, weights: tuple[float, float]) -> None:
    for speed in (0.01, 0.05, 0.3, 0.6, 3.0):
        a, b = model(speed, 0.05, lag)
        q = np.diag([*weights, 0.0])
        ours = riccati(a, b, q, 1.0)
        theirs = solve_discrete_are(a, b, q, np.eye(1))
        np.testing.assert_allclose(ours, theirs, atol=1e-10 * np.abs(theirs).max())
        gain = b.T @ ours @ a / (1.0 + b.T @ ours @ b)
        assert (np.abs(np.linalg.eigvals(a - b @ gain)) < 1.0).all()


def test_a_robot_that_cannot_be_steered_is_said() -> None:
    with pytest.raises(ValueError, match="no stabilising solution"):
        riccati([[2.0]], [[0.0]], [[1.0]], 1.0)
