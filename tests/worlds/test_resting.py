"""Robots whose episode has ended rest, and those that go on move as among all."""

from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.policies import Pilot, make
from wayfield.policies.pilot import Drive

PATH, GOAL = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveGoalObstacles-v0"
CASES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "path": (PATH, "lqr", {"disturbance": "moderate"}),
    "forces": (PATH, "regulated_pure_pursuit", {"dynamics": "pymunk"}),
    "late": (PATH, "pure_pursuit", {"robot": "p3dx", "actuators": "slow"}),
    "network": (PATH, "ppo", {"actuators": "lagged"}),
    "scan": (GOAL, "scan_planner", {"scenario": "moving_crowd/test", "num_beams": 72, "disturbance": "moderate"}),
    "random": (GOAL, "random", {"scenario": "discs"}),
    "dock": ("wayfield/DiffDriveDocking-v0", "reeds_shepp_scan", {}),
    "team": ("wayfield/OmniTeam-v0", "orca_team", {"sees": "bodies"}),
    "people": ("wayfield/OmniPeople-v0", "orca_team", {"sees": "bodies"}),
}


@pytest.mark.parametrize("case", CASES)
def test_those_that_go_on_move_as_among_all(case: str) -> None:
    env_id, policy, kwargs = CASES[case]
    drives, envs = [], []
    for _ in range(2):
        env: Any = gymnasium.make_vec(env_id, 24, vectorization_mode="vector_entry_point", **kwargs)
        observations, _ = env.reset(seed=3)
        drives.append(Drive(env, [pilot := Pilot(make(policy), env)], observations))
        pilot.reset()
        envs.append(env)
    draws = np.random.default_rng(0)
    for _ in range(30):
        (rewards, _, _), (whole, _, _) = (each.step() for each in drives)
        on = drives[0].alive & drives[1].alive
        stopped = draws.random(len(on)) < 0.1
        for each in drives:
            each.alive[stopped] = False
        drives[0].rest()
        assert rewards[on].tobytes() == whole[on].tobytes()
        assert envs[0].batch.states[on].tobytes() == envs[1].batch.states[on].tobytes()
    assert len(drives[0].rows) < 12
