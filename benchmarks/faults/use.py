"""Uses what was read from a file, as its owner would."""

import dataclasses
import functools
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import wayfield.policies
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.paths import Path as DrivenPath
from wayfield.envs.scenarios import GoalScenario, PathScenario
from wayfield.policies.learned.agent import Agent
from wayfield.policies.pilot import Pilot

_STEPS = 25


@functools.singledispatch
def used(found: Any, file: Path) -> None:
    """Uses a value of a kind that needs no care: nothing."""
    del found, file


@used.register
def _(found: GoalScenario, file: Path) -> None:
    del found
    for env_id in ("wayfield/DiffDriveGoalObstacles-v0", "wayfield/OmniGoalObstacles-v0"):
        _driven(env_id, scenario=str(file))


@used.register(PathScenario)
@used.register(DrivenPath)
def _(found: Any, file: Path) -> None:
    del found
    _driven("wayfield/DiffDrivePathFollowing-v0", scenario=str(file))


@used.register
def _(found: Agent, file: Path) -> None:
    """Drives a few steps; an agent may be for a robot or scan that its card does not go with, and says so."""
    kwargs = {name: value for name, value in found.card["env_kwargs"].items() if name != "max_episode_steps"}
    try:
        envs: Any = gymnasium.make_vec(found.card["env_id"], 2, vectorization_mode="vector_entry_point", **kwargs)
        observation, _ = envs.reset(seed=0)
        pilot = Pilot(found, envs)
        pilot.reset()
    except (TypeError, ValueError) as error:
        raise ValueError(f"{file.name}: {error}") from None
    for _ in range(3):
        action = pilot.act(observation)
        if not np.isfinite(action).all():
            raise AssertionError("an agent that was read asks for what is not finite")
        observation, *_ = envs.step(action)


@used.register
def _(found: tuple, file: Path) -> None:  # type: ignore[type-arg]
    """Goes on from the state of a training run: restores it, and makes one update."""
    if not (len(found) == 2 and isinstance(found[0], dict)):
        return
    from wayfield.policies.training import run
    from wayfield.policies.training.checkpoints import sample_job
    from wayfield.policies.training.learner import PpoLearner

    job = dataclasses.replace(sample_job(file.parent), resume=True)
    going_on = run._Run(job, PpoLearner(job.preset, job.env_id, job.seed))
    try:
        going_on.learner.update()
        if not all(np.isfinite(part).all() for layer in going_on.learner.layers() for part in layer):
            raise AssertionError("a training that was restored makes weights that are not finite")
    finally:
        going_on.writer.close()
        going_on.learner.env.close()


@used.register
def _(found: dict, file: Path) -> None:  # type: ignore[type-arg]
    """Gains make their policy; trajectories are of numbers that have a length."""
    if isinstance(found.get("gains"), dict) and isinstance(found.get("policy"), str):
        try:
            wayfield.policies.make(found["policy"], **found["gains"])
        except (TypeError, ValueError) as error:
            raise ValueError(f"{file.name}: {error}") from None
    for each in found.values():
        if isinstance(each, Trajectory) and not np.isfinite(np.asarray(each.poses, float)).all():
            raise AssertionError("a trajectory that was read is not finite")


def _driven(env_id: str, **kwargs: Any) -> None:
    """Takes some steps, with what moves and senses checked to be numbers."""
    env: Any = gymnasium.make(env_id, disable_env_checker=True, **kwargs).unwrapped
    rng = np.random.default_rng(0)
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(_STEPS):
            observation, reward, terminated, *_ = env.step(rng.uniform(env.action_space.low, env.action_space.high))
            if not (env.observation_space.contains(observation) and np.isfinite(reward)):
                raise AssertionError(f"{env_id} yields reward {reward} and an observation out of its space")
            if terminated:
                break
