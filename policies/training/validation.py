"""How good an agent is on validation scenarios: every scenario once, robot by robot."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.envs.scenarios import TaskSpec
from wayfield.envs.trajectory_tracking import SETTLED
from wayfield.envs.vector import NativeVectorEnv
from wayfield.policies.parts.policy import Policy
from wayfield.policies.pilot import Drive, Pilot

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


def finite(numbers: Mapping[str, float]) -> dict[str, float | None]:
    """Returns the numbers of a score, those that are none as None, which JSON has."""
    return {name: None if math.isnan(value) else value for name, value in numbers.items()}


def validated(score: Score) -> dict[str, float | None]:
    """Returns what a card says of a validation."""
    result = {name: value for name, value in dataclasses.asdict(score).items() if name != "reward"}
    return finite(result | {"return": score.reward})


def _middle(numbers: Array) -> float:
    """Returns the mean of the middle half of numbers: the interquartile mean."""
    few = int(0.25 * len(numbers))
    return float(np.mean(np.partition(numbers, (few, len(numbers) - few - 1))[few : len(numbers) - few]))


class Followed:
    """What the cost of a path follower is: its cross-track RMS, weighted by arc length, and 1 m where it failed."""

    def __init__(self, count: int, clock: int, dt: float) -> None:
        self.squares, self.along = np.zeros(count), np.zeros(count)

    def step(self, before: NDArray[np.void], now: NDArray[np.void], alive: NDArray[np.bool_]) -> None:
        """Adds a step of the robots that are `alive`, from their states before and after it."""
        ds = now["arc_length"] - before["arc_length"]
        mean = 0.5 * (now["cross_track_error"] ** 2 + before["cross_track_error"] ** 2)
        self.squares += np.where(alive, ds * mean, 0.0)
        self.along += np.where(alive, ds, 0.0)

    def judged(self, success: Array, failure: Array, steps: Array) -> tuple[float, float, Array]:
        """Returns the score, minus the IQM minus a quarter of the 95th percentile; the IQM; and the costs (b,), m."""
        rms = np.sqrt(self.squares / np.maximum(self.along, 1e-9))
        costs = np.where(success > 0.0, rms, 1.0)
        error = _middle(costs)
        return -(error + 0.25 * float(np.percentile(costs, 95))), error, costs


class Tracked(Followed):
    """What the cost of a robot that follows in time is: the RMS distance from its reference after SETTLED s."""

    def __init__(self, count: int, clock: int, dt: float) -> None:
        super().__init__(count, clock, dt)
        self.settled = round(SETTLED / dt)

    def step(self, before: NDArray[np.void], now: NDArray[np.void], alive: NDArray[np.bool_]) -> None:
        """Adds a step of the robots that are `alive`, from their states before and after it."""
        late = alive & (now["steps"] > self.settled)
        self.squares += np.where(late, now["error_x"] ** 2 + now["error_y"] ** 2, 0.0)
        self.along += late


class Reached:
    """What the cost of a goal seeker is: the share of the clock that it took, 1 if it came too late, 2 if it hit."""

    def __init__(self, count: int, clock: int, dt: float) -> None:
        self.clock, self.dt = clock, dt

    def step(self, before: NDArray[np.void], now: NDArray[np.void], alive: NDArray[np.bool_]) -> None:
        """Adds nothing: only the end counts."""

    def judged(self, success: Array, failure: Array, steps: Array) -> tuple[float, float, Array]:
        """Returns the score, minus the mean cost; the IQM of the times of successes; and the times (b,), s."""
        times = steps * self.dt
        costs = np.where(success > 0.0, steps / self.clock, 1.0 + failure)
        error = _middle(times[success > 0.0]) if success.any() else math.nan
        return -float(costs.mean()), error, np.where(success > 0.0, times, self.clock * self.dt)


_MEASURES: Mapping[str, type[Followed | Reached]] = {"path": Followed, "reference": Tracked, "goal": Reached}


def measure_of(spec: TaskSpec) -> type[Followed | Reached]:
    """Returns what the runs of a task cost."""
    return _MEASURES[spec.observes]


def validate(
    policy: Policy, env_id: str, kwargs: Mapping[str, Any], clock: int, seed: int = 1, every: int = 1
) -> Score:
    """Returns the score of a policy that drives every scenario of a bank once, or every second, third, ... of them.

    What a run costs, and what the score makes of the costs, is the task's own: see `measure_of`.
    """
    probe: Any = gymnasium.make(env_id, **kwargs).unwrapped
    team = getattr(probe.task, "team", 1)  # rows of a world
    scenarios = [k for k in range(0, len(probe.task.scenarios), every) for _ in range(team)]
    count = len(scenarios)
    probe.close()
    env = gymnasium.make_vec(
        env_id, count, vectorization_mode="vector_entry_point", max_episode_steps=clock, **kwargs
    ).unwrapped
    assert isinstance(env, NativeVectorEnv)
    pilot = Pilot(policy, env)
    observations, _ = env.reset(seed=seed, options={"scenario": scenarios})
    pilot.reset()
    task = env.task.spec
    measure = measure_of(task)(count, clock, env.task.options.dt)
    drive = Drive(env, [pilot], observations)
    success, failure = np.zeros(count), np.zeros(count)
    steps, returns, driven = np.zeros(count), np.zeros(count), np.zeros(count)
    before = env.batch.states.copy()
    while drive.alive.any():
        alive = drive.alive.copy()
        rewards, ended, info = drive.step()
        now = env.batch.states
        steps += alive
        returns += np.where(alive, rewards, 0.0)
        driven += np.where(alive, np.hypot(now["x"] - before["x"], now["y"] - before["y"]), 0.0)
        measure.step(before, now, alive)
        before = now.copy()
        success[ended] = info["success"][ended]
        failure[ended] = info[task.failure][ended]
        drive.rest()
    env.close()
    times = steps * env.task.options.dt
    score, error, shown = measure.judged(success, failure, steps)
    return Score(
        score=score,
        success=float(success.mean()),
        collision=float(failure.mean()),
        error=error,
        median=float(np.median(shown)),
        p95=float(np.percentile(shown, 95)),
        speed=float((driven / times).mean()),
        reward=float(returns.mean()),
    )
