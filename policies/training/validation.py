"""How good an agent is on validation scenarios: every scenario once, robot by robot."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.envs.vector import NativeVectorEnv
from wayfield.policies.policy import Pilot, Policy

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Score:
    """What a validation found. `score` ranks: higher is better."""

    score: float
    success: float  # share of the robots
    collision: float  # share; of path followers, those that left the corridor
    error: float  # IQM over robots: cross-track RMS (m), or for goals the time to a success (s)
    median: float
    p95: float
    speed: float  # m/s, mean over robots
    reward: float  # mean return of the environment's own reward


def validate(policy: Policy, env_id: str, kwargs: Mapping[str, Any], clock: int, seed: int = 1) -> Score:
    """Returns the score of a policy that drives every scenario of a bank once.

    A robot's cost is its cross-track RMS, weighted by arc length, and 1 m where it failed; or the share of the clock
    that it took to the goal, 1 where it came too late, and 2 where it collided. Paths are scored by minus the IQM minus
    a quarter of the 95th percentile of the costs, goals by minus their mean.
    """
    probe: Any = gymnasium.make_vec(env_id, 1, vectorization_mode="vector_entry_point", **kwargs).unwrapped
    count = len(probe.task.scenarios)
    probe.close()
    env = gymnasium.make_vec(
        env_id, count, vectorization_mode="vector_entry_point", max_episode_steps=clock, **kwargs
    ).unwrapped
    assert isinstance(env, NativeVectorEnv)
    pilot = Pilot(policy, env)
    observations, _ = env.reset(seed=seed, options={"scenario": list(range(count))})
    pilot.reset()
    on_path = "arc_length" in env.task.info_names
    alive = np.ones(count, np.bool_)
    success, failure = np.zeros(count), np.zeros(count)
    steps, returns, driven = np.zeros(count), np.zeros(count), np.zeros(count)
    squares, along = np.zeros(count), np.zeros(count)
    before = env.batch.states.copy()
    while alive.any():
        observations, rewards, terminated, truncated, info = env.step(pilot.act(observations))  # type: ignore[arg-type]
        now = env.batch.states
        steps += alive
        returns += np.where(alive, rewards, 0.0)
        driven += np.where(alive, np.hypot(now["x"] - before["x"], now["y"] - before["y"]), 0.0)
        if on_path:
            ds = now["arc_length"] - before["arc_length"]
            mean = 0.5 * (now["cross_track_error"] ** 2 + before["cross_track_error"] ** 2)
            squares += np.where(alive, ds * mean, 0.0)
            along += np.where(alive, ds, 0.0)
        before = now.copy()
        ended = alive & (terminated | truncated)
        success[ended] = info["success"][ended]
        failure[ended] = info["left_corridor" if on_path else "collision"][ended]
        alive &= ~ended
    env.close()
    times = steps * env.task.options.dt
    if on_path:
        rms = np.sqrt(squares / np.maximum(along, 1e-9))
        costs = np.where(success > 0.0, rms, 1.0)
        error = float(trim_mean(costs, 0.25))
        p95 = float(np.percentile(costs, 95))
        score = -(error + 0.25 * p95)
    else:
        costs = np.where(success > 0.0, steps / clock, 1.0 + failure)
        error = float(trim_mean(times[success > 0.0], 0.25)) if success.any() else math.nan
        p95 = float(np.percentile(np.where(success > 0.0, times, clock * env.task.options.dt), 95))
        score = -float(costs.mean())
    shown = costs if on_path else np.where(success > 0.0, times, clock * env.task.options.dt)
    return Score(
        score=score,
        success=float(success.mean()),
        collision=float(failure.mean()),
        error=error,
        median=float(np.median(shown)),
        p95=p95,
        speed=float((driven / times).mean()),
        reward=float(returns.mean()),
    )
