"""Threads that share out rows: the same bits for every number of them, and errors before anything has moved."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from oracles.bits import differences

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.policies import Pilot, make
from wayfield.system.threads import ThreadPool, thread_pool

ROWS = 150  # four blocks at most, and not alike
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "path": ("wayfield/DiffDrivePathFollowing-v0", {"scenario": "random_splines"}),
    "goal": ("wayfield/OmniGoalObstacles-v0", {"scenario": "discs", "num_beams": 32, "disturbance": "moderate"}),
    "patrols": ("wayfield/DiffDriveGoalObstacles-v0", {"scenario": "moving_crowd/test", "num_beams": 24}),
    "dock": ("wayfield/DiffDriveDocking-v0", {}),
    "pymunk": ("wayfield/DiffDrivePathFollowing-v0", {"dynamics": "pymunk"}),
}


def vector(case: str, num_threads: int, **kwargs: Any) -> Any:
    """Returns a native vector environment."""
    env_id, options = CASES[case]
    asked = {"max_episode_steps": 23} | options | kwargs
    return gymnasium.make_vec(
        env_id, ROWS, vectorization_mode="vector_entry_point", num_threads=num_threads, **asked
    )  # fmt: skip


def driven(envs: Any, steps: int = 60) -> list[Any]:
    """Returns all that an environment gives in some steps, ends and resets among them."""
    envs.action_space.seed(3)
    found = [*envs.reset(seed=5)]
    for _ in range(steps):
        found += envs.step(envs.action_space.sample())
    return found


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("case", CASES)
def test_every_number_of_threads_gives_the_same_bits(case: str, mode: str) -> None:
    if case == "pymunk" and mode == "SameStep":
        pytest.skip("its resets are tested with the other mode")
    one, *others = (vector(case, n, autoreset_mode=mode) for n in (1, 2, 3))
    expected = driven(one)
    assert any(array.any() for array in expected[5::5])  # there were ends by the clock, and so resets
    for envs in others:
        assert not differences(expected, driven(envs))
        assert envs.batch.states.tobytes() == one.batch.states.tobytes()


@pytest.mark.parametrize("row", [0, 70, ROWS - 1])
def test_an_action_that_is_not_finite_is_refused_before_any_block_has_moved(row: int) -> None:
    envs = vector("path", 2)
    driven(envs, 5)
    before = envs.batch.states.copy()
    actions = np.zeros(envs.action_space.shape, np.float32)
    actions[row, 1] = np.nan
    with pytest.raises(ValueError, match=rf"of robot {row} is not finite"):
        envs.step(actions)
    assert envs.batch.states.tobytes() == before.tobytes()


@pytest.mark.parametrize("value", [0, -1, 1.5, "two", 100_000])
def test_a_number_of_threads_that_is_none_is_refused_by_name(value: Any) -> None:
    with pytest.raises((ValueError, TypeError), match="num_threads"):
        vector("path", value)
    with pytest.raises((ValueError, TypeError), match="num_threads"):
        Pilot(make("pure_pursuit"), vector("path", 1), value)


@pytest.mark.parametrize(
    ("case", "policy"),
    [("path", "regulated_pure_pursuit"), ("path", "lqr"), ("path", "ilqr"), ("path", "mpc"), ("goal", "dwa"),
     ("goal", "vfh_plus"), ("goal", "orca"), ("goal", "scan_planner"), ("goal", "random"), ("dock", "polar")],
)  # fmt: skip
def test_policies_decide_alike_with_every_number_of_threads(case: str, policy: str) -> None:
    drivers = []
    for n in (1, 3):
        envs = vector(case, n, max_episode_steps=4)
        observations, _ = envs.reset(seed=1)
        pilot = Pilot(make(policy), envs, n)
        pilot.reset()
        drivers.append((envs, pilot, observations))
    for _ in range(3 if policy in ("mpc", "scan_planner") else 7):
        found = []
        for k, (envs, pilot, observations) in enumerate(drivers):
            actions = pilot.command(observations)
            observations, _, terminated, truncated, _ = envs.step(actions)
            drivers[k] = envs, pilot, observations
            found.append((actions, observations))
            if (ended := terminated | truncated).any():
                drivers[k] = envs, pilot, envs.step(actions)[0]
                pilot.reset(np.flatnonzero(ended))
        assert not differences(*found)


# The pool.


def test_every_block_is_done_once_whoever_is_late() -> None:
    seen: list[int] = []
    threads = ThreadPool(3)
    for count in (1, 2, 7, 100):
        seen.clear()
        threads.run(seen.append, count)
        assert sorted(seen) == list(range(count))


def test_what_a_block_raises_is_raised_once_all_have_ended() -> None:
    seen: list[int] = []

    def work(k: int) -> None:
        seen.append(k)
        if k == 1:
            raise ArithmeticError("one")

    with pytest.raises(ArithmeticError, match="one"):
        thread_pool(2).run(work, 5)
    assert sorted(seen) == [0, 1, 2, 3, 4]
    thread_pool(2).run(work, 1)
