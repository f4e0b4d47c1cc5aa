"""The central planner: its plans keep apart, and robots that follow them arrive, where laws that see less are stuck."""

import itertools
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield import policies
from wayfield.envs.scenarios.obstacles import obstacle_field, wall
from wayfield.envs.scenarios.team_families import TEAM_FAMILIES
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.policies import Pilot
from wayfield.policies.teams.central import KNOTS


@pytest.mark.parametrize(
    ("env_id", "family"),
    [
        ("wayfield/OmniTeam-v0", "doorway_4"),
        pytest.param("wayfield/OmniTeam-v0", "rooms_4", marks=pytest.mark.slow),
        ("wayfield/OmniTeam-v0", "bottleneck_8"),
        pytest.param("wayfield/DiffDriveTeam-v0", "doorway_2", marks=pytest.mark.slow),
        ("wayfield/DiffDriveTeam-v0", "circle_exact_8"),
        ("wayfield/DiffDriveTeam-v0", "corridor_8"),
    ],
)
def test_all_robots_of_a_team_arrive_by_one_plan(env_id: str, family: str) -> None:
    worlds = tuple(TEAM_FAMILIES[family].make(7_000_000 + k) for k in range(2))
    n = worlds[0].team
    env: Any = gymnasium.make_vec(
        env_id, num_envs=2 * n, scenario=worlds, sees="bodies", actuators="lagged", max_episode_steps=1600
    )
    pilot = Pilot(policies.make("central"), env)
    seen, _ = env.reset(seed=0, options={"scenario": np.repeat(np.arange(2), n)})
    pilot.reset()
    arrived = np.zeros(2 * n, np.bool_)
    plans = np.zeros(0)
    for step in range(1600):
        seen, _, terminated, _, info = env.step(pilot.act(seen))
        if step == 0:
            plans = pilot.memory.copy()
        assert not info["collision"][~arrived].any()
        arrived |= terminated & info["success"]
        if arrived.all():
            break
    assert arrived.all()
    # as planned, discs of the hull keep apart until one has arrived, and from what stands
    radius = env.unwrapped.task.robot.hull_radius
    for w in range(2):
        for a, b in itertools.combinations(plans[w * n : (w + 1) * n], 2):
            times = np.arange(0.0, min(ends(a), ends(b)), 0.02)
            apart = place(a, times) - place(b, times)
            assert np.sqrt((apart**2).sum(axis=1)).min() >= 2.0 * radius - 1e-6
    for m in plans:
        times = np.arange(0.0, ends(m), 0.02)
        speeds = np.sqrt((np.diff(place(m, times), axis=0) ** 2).sum(axis=1)) / 0.02
        assert speeds.max() <= 0.6 + 1e-9


def ends(m: Any) -> float:
    """Returns when (s) a plan ends."""
    assert 0 < m["knots"] <= KNOTS
    return float(m["at"][m["knots"] - 1])


def place(m: Any, times: Any) -> Any:
    """Returns where (k, 2), m, a plan is at times (k,), s."""
    k = m["knots"]
    return np.column_stack([np.interp(times, m["at"][:k], m[axis][:k]) for axis in ("x", "y")])


def test_a_robot_without_a_way_stands_and_the_others_are_not_harmed() -> None:
    cell = obstacle_field(wall(-1, -1, 1, -1), wall(1, -1, 1, 1), wall(1, 1, -1, 1), wall(-1, 1, -1, -1))
    world = TeamScenario.made("shut", [(0, 0, 0), (3, 0, 0)], [(6, 3, 0), (3, 4, 0)], cell)
    env: Any = gymnasium.make("wayfield/OmniTeam-v0", scenario=world, sees="bodies")
    pilot = Pilot(policies.make("central"), env)
    seen, _ = env.reset(seed=0)
    pilot.reset()
    for _ in range(60):
        seen, *_, info = env.step(pilot.act(seen))
    states = env.unwrapped.batch.states
    assert (states["x"][0], states["y"][0]) == (0.0, 0.0)
    assert not info["collision"].any()


def test_worlds_stay_whole_where_threads_share_them_out() -> None:
    worlds = tuple(TEAM_FAMILIES["open_8"].make(7_000_100 + k) for k in range(12))
    actions = []
    for threads in (1, 3):
        env: Any = gymnasium.make_vec("wayfield/OmniTeam-v0", num_envs=96, scenario=worlds, sees="bodies")
        pilot = Pilot(policies.make("central"), env, num_threads=threads)
        seen, _ = env.reset(seed=0, options={"scenario": np.repeat(np.arange(12), 8)})
        pilot.reset()
        for _ in range(3):
            seen, *_ = env.step(pilot.act(seen))
        actions.append(pilot.act(seen).tobytes())
    assert actions[0] == actions[1]
