"""Worlds of several bodies: rolls out whole teams, among people, and measures each world as one episode."""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield import policies
from wayfield.benchmarks.episodes.metrics import duration, measure
from wayfield.benchmarks.episodes.rollout import FAULTS, make_policy, make_vector
from wayfield.benchmarks.episodes.shortest import CELL, shortest_way
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.crowds.people import stroll
from wayfield.envs.robots import robot_of
from wayfield.envs.scenarios import scenarios_of, spec_of
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.tasks.specs import CROWDS
from wayfield.policies.pilot import Drive, Pilot

Array = NDArray[np.float64]

AT_ONCE = 512  # robots
MOVED, LATELY = 0.1, 10.0  # m, s: a robot that has moved less in that time is stuck
INTIMATE, PERSONAL = 0.45, 1.2  # m, Hall 1966
CLOSE = 0.5  # m: Francis et al. 2023
DANGER = 0.2  # m, between hulls: CrowdNav's
AHEAD = 1.25  # s, of AttnGraph's intrusion
WALL, ROBOT, PERSON = 1, 2, 3  # what `touched` says
_FIELDS = (
    *("steps", "x", "y", "heading", "vx", "vy", "yaw_rate", "saturated", "clearance", "gap"),
    *("wheel_vx", "wheel_vy", "wheel_yaw_rate"),
)


@dataclasses.dataclass(frozen=True)
class World:
    """What happened in one world of n robots and q people until its last robot had ended."""

    robots: tuple[Trajectory, ...]  # each until its own end
    touched: NDArray[np.int64]  # (n,) what ended each: 0 nothing, WALL, ROBOT, PERSON
    caused: NDArray[np.bool_]  # (n,)
    straight: Array  # (n,) m, from start to goal
    gaps: tuple[Array, ...]  # m, of each robot in each of its steps, to the nearest body; inf where none is near
    people: Array  # (steps + 1, q, 5): x, y (m), vx, vy (m/s), 1 where one is there
    alone: Array  # the same of the same people without robots
    radii: Array  # (q,) m
    hull_radius: float  # m
    parks: bool = False  # whether robots stay where they arrive
    width: float = math.nan  # m, of the gap that all must pass
    mine: NDArray[np.bool_] | None = None  # (n,) robots that the entry drives; None: all
    people_goals: Array | None = None  # (q, 2) m, where the people go first; None: it is not known

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """Returns which robots have arrived, untouched."""
        return np.array([each.success and not each.collision for each in self.robots])

    @property
    def dt(self) -> float:
        """Returns the control period."""
        return self.robots[0].dt

    def shown(self) -> Trajectory:
        """Returns the first robot's trajectory over all of the world's time, with the other bodies beside it."""
        last = max(len(each.times) for each in self.robots)
        bodies = [_over(each, last, self.parks or each.collision) for each in self.robots[1:]]
        people = np.where(self.people[:last, :, 4:] > 0.0, self.people[:last, :, :2], np.nan)
        first = self.robots[0]
        held = np.minimum(np.arange(last), len(first.times) - 1)
        along = {
            name: getattr(first, name)[held]
            for name in ("poses", "twists", "wheel_speeds", "saturated", "clearances")
            if len(getattr(first, name))
        }
        return dataclasses.replace(
            first,
            times=self.dt * np.arange(last, dtype=np.float64),
            **along,
            success=bool(self.arrived.all()),
            collision=bool(self.touched.any()),
            others=np.concatenate([np.stack(bodies, axis=1) if bodies else np.empty((last, 0, 2)), people], axis=1),
            other_radii=np.concatenate([np.full(len(bodies), self.hull_radius), self.radii]),
            other_people=np.repeat((0.0, 1.0), (len(bodies), len(self.radii))),
        )


def _over(robot: Trajectory, count: int, stays: bool) -> Array:
    """Returns where a robot is in `count` moments, (count, 2): NaN once it has left."""
    places = np.full((count, 2), np.nan)
    places[: len(robot.poses)] = robot.poses[:, :2]
    if stays:
        places[len(robot.poses) :] = robot.poses[-1, :2]
    return places


# ---- the drive


def roll_out_worlds(
    case: Case,
    *,
    dynamics: str,
    actuators: str,
    seed: int,
    episodes: int,
    members: Sequence[int] = (),
    numbers: Sequence[int] = (),
) -> list[World]:
    """Returns one world for each of the seeds `seed`, `seed + 1`, ...; see `rollout.roll_out`.

    With `case.beside` every other robot, from the second on, is driven by that policy.

    Raises:
        TypeError, ValueError: as `rollout.roll_out`.
    """
    robot = robot_of(case.env_kwargs["robot"])
    bank = scenarios_of(spec_of(case.env_id), case.scenario, robot.hull_radius)
    team = int(case.env_kwargs.get("team") or bank[0].team)
    numbers = numbers or range(episodes)
    chosen = list(members) or [k % len(bank) for k in numbers]
    at_once = max(1, AT_ONCE // team)
    worlds: list[World] = []
    for first in range(0, len(numbers), at_once):
        some = chosen[first : first + at_once]
        env = make_vector(case, dynamics, actuators, len(some) * team)
        worlds += _driven(env, case, [seed + k for k in numbers[first : first + at_once]], some, seed)
        env.close()
    return worlds


def _driven(env: Any, case: Case, seeds: Sequence[int], chosen: Sequence[int], policy_seed: int) -> Iterator[World]:
    """Yields the worlds of an environment that has one for each seed."""
    task, batch, n = env.task, env.batch, env.task.team
    rows = len(seeds) * n
    pilots = [Pilot(make_policy(case, policy_seed), env)]
    mine = np.ones(n, np.bool_)
    if case.beside:
        pilots.append(Pilot(policies.make(case.beside), env))
        mine = np.arange(n) % 2 == 0
    theirs = np.tile(~mine, len(seeds))
    observations, _ = env.reset(
        seed=[each for each in seeds for _ in range(n)],
        options={"scenario": [each for each in chosen for _ in range(n)]},
    )
    for pilot in pilots:
        pilot.reset()
    briefing = env.briefing("map")
    dtype = np.dtype([(name, np.float64) for name in _FIELDS])
    history = np.empty((case.max_episode_steps + 1, rows), dtype)
    people = np.empty((case.max_episode_steps + 1, len(seeds), task.most_people, 5))
    lengths = np.zeros(rows, np.int64)
    flags: list[dict[str, bool]] = [{} for _ in range(rows)]
    touched = np.zeros(rows, np.int64)
    faults = np.zeros(rows, np.int64)

    def note(step: int) -> None:
        for name in _FIELDS:
            history[name][step] = batch.states[name]
        if task.most_people:
            people[step] = task.walking(batch.own)

    note(0)
    of_world = batch.states["scenario"][::n] // n
    step = 0
    drive = Drive(env, pilots, observations, theirs)
    while drive.alive.any():
        _, ended, info = drive.step()
        step += 1
        note(step)
        for i in np.flatnonzero(ended).tolist():
            flags[i] = {name: bool(info[name][i]) for name in task.flag_names}
            touched[i] = int(info["touched"][i])
            lengths[i] = step + 1
            faults[i] = _faults(drive.memory_of(i), 0)
        if case.entrant is None:  # one's own may remember robots by their place
            drive.rest()
    for w, k in enumerate(of_world.tolist()):
        scenario, family = task.scenarios[k], task.scenarios[k].family
        driven = []
        for r in range(n):
            i = w * n + r
            states = history[: lengths[i], i]
            one = _robot(task, briefing, i, states, flags[i], case)
            driven.append(dataclasses.replace(one, faults=int(faults[i]), shortest=_shortest(task, k, r)))
        last = lengths[w * n : (w + 1) * n].max()
        q = len(scenario.walks)
        yield World(
            tuple(driven),
            touched[w * n : (w + 1) * n],
            np.array([flags[w * n + r]["caused"] for r in range(n)]),
            scenario.straight,
            tuple(history["gap"][1 : lengths[w * n + r], w * n + r].copy() for r in range(n)),
            people[:last, w, :q].copy(),
            _without_robots(scenario, case.max_episode_steps, task.options.dt)[:last],
            scenario.walks["radius"].astype(np.float64),
            task.robot.hull_radius,
            task.parks,
            next((each.families[family].gap for each in CROWDS.values() if family in each.families), math.nan),
            mine if case.beside else None,
            np.column_stack([scenario.walks["goal_x"], scenario.walks["goal_y"]]),
        )


def _faults(memory: NDArray[Any], i: int) -> int:
    return sum(int(memory[name][i]) for name in FAULTS if name in (memory.dtype.names or ()))


def _robot(
    task: Any, briefing: Any, i: int, states: NDArray[np.void], flags: dict[str, bool], case: Case
) -> Trajectory:
    """Returns the trajectory of robot i."""

    def columns(*names: str) -> Array:
        return np.column_stack([states[name] for name in names])

    twists = columns("wheel_vx", "wheel_vy", "wheel_yaw_rate")
    return Trajectory(
        times=states["steps"] * briefing.dt,
        poses=columns("x", "y", "heading"),
        twists=columns("vx", "vy", "yaw_rate"),
        wheel_speeds=twists @ briefing.robot.wheel_matrix.T,
        saturated=states["saturated"].copy(),
        clearances=states["clearance"].copy(),
        goals=briefing.goal.goals[i, : briefing.goal.num_goals[i]],
        obstacles=briefing.map.obstacles[i, : briefing.map.counts[i]],
        success=flags["success"],
        collision=flags["collision"],
        max_speed=min(case.target_speed, float(task.robot.max_twist[0])),
        acceleration=briefing.actuators.acceleration,
    )


def _shortest(task: Any, scenario: int, robot: int) -> float:
    """Returns the length (m) of a robot's shortest way without others."""
    goal_scenario = task.scenarios[scenario].robots[robot]
    if not len(goal_scenario.obstacles):
        away = math.dist(goal_scenario.start[:2], goal_scenario.goal[:2])
        return max(away - float(goal_scenario.position_tolerance), CELL)
    return float(shortest_way(goal_scenario, task.robot.hull_radius))


_ALONE: dict[tuple[str, bytes, int], Array] = {}  # the people of what was driven lately, without robots
_MOST_ALONE = 32


def _without_robots(scenario: TeamScenario, steps: int, dt: float) -> Array:
    """Returns how the people of a scenario walk where there is no robot, (steps + 1, q, 5)."""
    key = scenario.name, scenario.walks["law"].tobytes(), steps
    if key not in _ALONE:
        if len(_ALONE) >= _MOST_ALONE:
            _ALONE.pop(next(iter(_ALONE)))
        standing, tracks = scenario.robots[0].obstacles, scenario.tracks
        _ALONE[key] = stroll(scenario.walks, steps, dt, standing, tracks, scenario.reach)
    return _ALONE[key]


# ---- the metrics


def measured(world: World) -> dict[str, float]:
    """Returns every metric of a world by name: SI, flags and shares from 0 to 1, NaN where one does not apply.

    What `metrics.measure` says of a robot is the mean over the robots, but for the flags, of which success is that of
    all and collision that of any, the time, which is that of the last to end, and the least clearance.
    """
    each = [measure(robot) for robot in world.robots]
    means = {name: _mean([one[name] for one in each]) for name in each[0]}
    arrived, collided = world.arrived, world.touched > 0
    success = bool(arrived.all())
    return (
        means
        | {
            "success": float(success),
            "collision": float(collided.any()),
            "timeout": float(not success and not collided.any()),
            "time": max(duration(robot) for robot in world.robots),
            "min_clearance": float(np.fmin.reduce([one["min_clearance"] for one in each])),
            "faults": float(sum(robot.faults for robot in world.robots)),
        }
        | shares(world)
        | delays(world)
        | near_people(world)
    )


def shares(world: World) -> dict[str, float]:
    """Returns how many arrived, and how the others ended."""
    arrived, mine = world.arrived, world.mine
    halted = [_stuck(robot, world.dt) for robot in world.robots]
    out = [not done and not hit for done, hit in zip(arrived, world.touched, strict=True)]
    stuck = [late and still for late, still in zip(out, halted, strict=True)]
    return {
        "arrived": float(arrived.mean() if mine is None else arrived[mine].mean()),
        "arrived_beside": math.nan if mine is None or mine.all() else float(arrived[~mine].mean()),
        "touched_wall": float((world.touched == WALL).mean()),
        "touched_robot": float((world.touched == ROBOT).mean()),
        "touched_person": float((world.touched == PERSON).mean()),
        "caused": float(world.caused.mean()),
        "stuck": float(np.mean(stuck)),
        "deadlock": float(any(out) and stuck == out),
        "least_gap": min((float(gaps.min()) for gaps in world.gaps if len(gaps)), default=math.nan),
    }


def _stuck(robot: Trajectory, dt: float) -> bool:
    lately = robot.poses[-round(LATELY / dt) - 1 :, :2]
    return len(lately) > round(LATELY / dt) and bool(np.hypot(*(lately - lately[-1]).T).max() < MOVED)


def delays(world: World) -> dict[str, float]:
    """Returns the cost of company: times beside those of the straight ways at the requested speed."""
    speed = world.robots[0].max_speed
    times = np.array([duration(robot) for robot in world.robots])
    best = world.straight / speed
    arrived = world.arrived
    extra = (times - best)[arrived]
    last = times.max() if arrived.all() else math.nan
    x = np.where(arrived, best / times, 0.0)
    return {
        "extra_time": float(extra.mean()) if len(extra) else math.nan,
        "extra_time_p75": float(np.percentile(extra, 75.0)) if len(extra) else math.nan,
        "extra_time_p90": float(np.percentile(extra, 90.0)) if len(extra) else math.nan,
        "makespan_ratio": float(last / best.max()),
        "flow_rate": float(len(times) / (world.width * last)),
        "fairness": float(x.sum() ** 2 / (len(x) * (x**2).sum())) if x.any() else math.nan,
    }


def near_people(world: World) -> dict[str, float]:
    """Returns how near the robots came to people, and what they cost them; gaps are between hulls."""
    shares = ("intimate_share", "close_share", "personal_share", "danger_share", "intrusion")
    names = ("least_gap_people", *shares, "intrusion_gap", "people_slowed", "people_extra_time")
    if not len(world.radii):
        return dict.fromkeys(names, math.nan)
    there = world.people[:, :, 4] > 0.0
    ahead = round(AHEAD / world.dt)
    gaps, intruded = [], []
    for robot in world.robots:
        count = len(robot.poses)
        apart = np.hypot(*(world.people[:count, :, :2] - robot.poses[:, None, :2]).transpose(2, 0, 1))
        gaps.append(np.where(there[:count], apart - world.radii - world.hull_radius, np.inf).min(axis=1))
        inside = np.zeros(count, np.bool_)
        for k in range(1, ahead + 1):
            later = world.people[k : count + k, :, :2]
            some = len(later[:count])
            away = np.hypot(*(later - robot.poses[:some, None, :2]).transpose(2, 0, 1)) - world.radii
            inside[:some] |= ((away < world.hull_radius) & there[k : count + k]).any(axis=1)
        intruded.append(inside)
    gap, inside = np.concatenate(gaps), np.concatenate(intruded)
    both = there & (world.alone[:, :, 4] > 0.0)
    lost = np.hypot(*world.alone[:, :, 2:4].transpose(2, 0, 1)) - np.hypot(*world.people[:, :, 2:4].transpose(2, 0, 1))
    return {
        "least_gap_people": float(gap.min()),
        "intimate_share": float((gap < INTIMATE).mean()),
        "close_share": float((gap < CLOSE).mean()),
        "personal_share": float((gap < PERSONAL).mean()),
        "danger_share": float((gap < DANGER).mean()),
        "intrusion": float(inside.mean()),
        "intrusion_gap": float(gap[inside].mean()) if inside.any() else math.nan,
        "people_slowed": float(lost[both].mean()) if both.any() else math.nan,
        "people_extra_time": _later(world),
    }


def _later(world: World) -> float:
    """Returns how much later (s) people come to their goals than without robots, in the mean over those who do in both.

    NaN where nobody does before the last robot has ended.
    """
    if world.people_goals is None:
        return math.nan
    at = []
    for walked in (world.people, world.alone):
        apart = np.hypot(*(walked[:, :, :2] - world.people_goals).transpose(2, 0, 1))
        come = (apart <= world.radii) & (walked[:, :, 4] > 0.0)
        # who leaves at the goal is gone in the step of the arrival
        gone = np.zeros_like(come)
        gone[1:] = (walked[:-1, :, 4] > 0.0) & (walked[1:, :, 4] == 0.0)
        come |= gone
        at.append(np.where(come.any(axis=0), come.argmax(axis=0), np.nan))
    later = world.dt * (at[0] - at[1])
    return float(np.nanmean(later)) if not np.isnan(later).all() else math.nan


def _mean(values: Sequence[float]) -> float:
    numbers = np.array(values, np.float64)
    return float(np.nanmean(numbers)) if not np.isnan(numbers).all() else math.nan
