"""The rollout loop: drives a case's environment with its policy and records every episode."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import wayfield.envs  # noqa: F401  registers the ids
from wayfield import policies
from wayfield.benchmarks.episodes.shortest import shortest_way
from wayfield.benchmarks.records.cases import Case, Rules
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.robots import robot_of
from wayfield.envs.scenarios import scenarios_of, spec_of
from wayfield.envs.tasks.briefing import Briefing, Course
from wayfield.envs.vector import NativeVectorEnv
from wayfield.policies.parts.policy import Policy
from wayfield.policies.paths.lookahead import Lookahead
from wayfield.policies.pilot import Drive, Pilot

# What policies count in their memory under these names: a QP that was not solved, a planner that found no way.
FAULTS = ("qp_failures", "no_path")


def make_policy(case: Case, seed: int) -> Policy:
    """Returns the case's policy; one that draws at random draws from the seed.

    Raises:
        ValueError: if there is no such policy, or one of the user's own cannot be made.
    """
    if case.entrant is not None:
        return case.entrant.make(case.gains)
    gains = dict(case.gains)
    if case.policy == "random":
        gains["seed"] = seed
    return policies.make(case.policy, **gains)


def make_vector(case: Case, dynamics: str, actuators: str, num_envs: int, scenario: Any = None) -> NativeVectorEnv:
    """Returns the case's environment, with a robot for each episode.

    Args:
        scenario: in place of the case's.
    """
    env = gymnasium.make_vec(
        case.env_id,
        num_envs,
        vectorization_mode="vector_entry_point",
        scenario=case.scenario if scenario is None else scenario,
        actuators=actuators,
        max_episode_steps=case.max_episode_steps,
        dynamics=dynamics,
        **case.env_kwargs,
    )
    assert isinstance(env, NativeVectorEnv)
    return env


def roll_out(
    case: Case,
    *,
    dynamics: str = "kinematic",
    actuators: str = "ideal",
    seed: int = 0,
    episodes: int = 1,
    members: Sequence[int] = (),
    numbers: Sequence[int] = (),
) -> list[Trajectory]:
    """Returns one trajectory for each of the seeds `seed`, `seed + 1`, ...

    A case of every scenario has one episode for each of the first `episodes` scenarios of its bank, round and round, or
    for each of the `members` of the bank.

    Args:
        numbers: of those episodes that are driven, in place of the first ones.

    Raises:
        TypeError: if the policy cannot read the environment's observations.
        ValueError: if the environment does not know an option.
    """
    numbers = numbers or range(episodes)
    env = make_vector(case, dynamics, actuators, len(numbers))
    there = len(env.task.scenarios)
    chosen = (list(members) or [k % there for k in numbers]) if case.every_scenario else None
    return _driven(env, [case] * len(numbers), [seed + k for k in numbers], chosen, seed)


def roll_out_together(
    cases: Sequence[Case], dynamics: str, actuators: str, seeds: Sequence[int], episodes: int
) -> list[list[Trajectory]]:
    """Returns what `roll_out` does of each of some cases and its seed, which differ in their scenarios alone.

    Each is of every scenario of its bank, or the bank has one.

    All of them are driven at once: a control period of one robot takes as long as that of some ten.
    """
    first = cases[0]
    banks = [bank_of(case) for case in cases]
    bank = [each[k % len(each)] for each in banks for k in range(episodes)]
    env = make_vector(first, dynamics, actuators, len(bank), bank)
    whose = [case for case in cases for _ in range(episodes)]
    driven = _driven(env, whose, [seed + k for seed in seeds for k in range(episodes)], list(range(len(bank))))
    return [driven[k : k + episodes] for k in range(0, len(driven), episodes)]


def bank_of(case: Case) -> tuple[Any, ...]:
    """Returns the scenarios of a case."""
    robot = robot_of(case.env_kwargs.get("robot", "p3dx"))  # paths, where none is named, are those of every hull
    return scenarios_of(spec_of(case.env_id), case.scenario, robot.hull_radius)


def _driven(
    env: NativeVectorEnv, cases: Sequence[Case], seeds: list[int], scenarios: list[int] | None, of_policy: int = 0
) -> list[Trajectory]:
    """Returns the trajectory of each robot, of the case and with the seed of its place, on the chosen scenarios."""
    case, episodes = cases[0], len(cases)
    pilot = Pilot(make_policy(case, of_policy), env)
    chosen = {"scenario": scenarios} if scenarios is not None else None
    observations, _ = env.reset(seed=seeds, options=chosen)
    pilot.reset()
    briefing = env.briefing("map")
    # np.empty takes no memory until it is written to, so that a long clock costs nothing by itself
    history = np.empty((case.max_episode_steps + 1, episodes), env.batch.states.dtype)
    history[0] = env.batch.states
    lengths = np.zeros(episodes, np.int64)
    flags: list[dict[str, bool]] = [{} for _ in range(episodes)]
    faults = np.zeros(episodes, np.int64)
    step = 0
    drive = Drive(env, [pilot], observations)
    while drive.alive.any():
        _, ended, info = drive.step()
        step += 1
        history[step] = env.batch.states
        if not ended.any():
            continue
        for i in np.flatnonzero(ended).tolist():
            flags[i] = {name: bool(info[name][i]) for name in env.task.flag_names}
            lengths[i] = step + 1
            faults[i] = faults_of(drive.memory_of(i), 0)
        if case.entrant is None:  # one's own may remember robots by their place
            drive.rest()
    env.close()
    driven = [
        _trajectory(env, briefing, pilot.policy, i, history[: lengths[i], i].copy(), flags[i], cases[i])
        for i in range(episodes)
    ]
    return [dataclasses.replace(each, faults=int(count)) for each, count in zip(driven, faults, strict=True)]


def faults_of(memory: NDArray[Any], i: int) -> int:
    """Returns how often robot i's policy had to fall back on something else, which it counts in its memory."""
    for part in ("base", "state"):  # of the controller that an agent adds to; of a law that keeps its scans beside it
        if part in (memory.dtype.names or ()):
            memory = memory[part]
    return sum(int(memory[name][i]) for name in FAULTS if name in (memory.dtype.names or ()))


def _trajectory(
    env: NativeVectorEnv,
    briefing: Briefing,
    policy: Policy,
    i: int,
    states: NDArray[Any],
    flags: dict[str, bool],
    case: Case,
) -> Trajectory:
    """Returns the trajectory of robot i from its states (n + 1,) and the flags of its last step."""

    def columns(*names: str) -> NDArray[np.float64]:
        return np.column_stack([states[name] for name in names])

    wheel_twists = columns("wheel_vx", "wheel_vy", "wheel_yaw_rate")
    assert briefing.map is not None
    driven = Trajectory(
        times=states["steps"] * briefing.dt,
        poses=columns("x", "y", "heading"),
        twists=columns("vx", "vy", "yaw_rate"),
        wheel_speeds=wheel_twists @ briefing.robot.wheel_matrix.T,
        saturated=states["saturated"].astype(np.float64),
        success=flags["success"],
        collision=flags["collision"],
    )
    if briefing.path is not None:
        return _along(driven, env.task, briefing, briefing.path, policy, states, flags)
    assert briefing.goal is not None
    scenario = env.task.scenarios[int(states["scenario"][0])]
    driven = dataclasses.replace(
        driven,
        max_speed=min(case.target_speed, float(briefing.robot.max_twist[0])),
        acceleration=briefing.actuators.acceleration,
        clearances=states["clearance"].copy(),
        goals=briefing.goal.goals[i, : briefing.goal.num_goals[i]],
        obstacles=briefing.map.obstacles[i, : briefing.map.counts[i]],
        walls=np.empty(0) if scenario.grid is None else scenario.grid.outline(),
    )
    if case.rules is not None:
        driven = _under(case.rules, driven, scenario)
    if case.every_scenario and math.isnan(driven.shortest):
        driven = dataclasses.replace(driven, shortest=shortest_way(scenario, briefing.robot.hull_radius))
    return driven


def _limited(states: NDArray[Any], params: NDArray[np.void], briefing: Briefing) -> NDArray[np.float64]:
    """Returns (n + 1,) 1 where the wheels saturated, or the command changed by all that the accelerations allow.

    NaN of a base whose sheet has a response: its command moves within a control period.
    """
    if params["responds"]:
        return np.full(len(states), np.nan)
    vx, vy, w = (np.diff(states[f"command_{axis}"], prepend=np.nan) for axis in ("vx", "vy", "yaw_rate"))
    most = (1.0 - 1e-9) * briefing.dt
    reached: NDArray[np.bool_] = np.hypot(vx, vy) >= most * briefing.actuators.acceleration
    reached |= np.abs(w) >= most * briefing.actuators.yaw_acceleration
    reached |= states["saturated"] != 0
    return reached.astype(np.float64)


def _under(rules: Rules, driven: Trajectory, scenario: Any) -> Trajectory:
    """Returns a trajectory that is measured by the rules of a public benchmark."""
    return dataclasses.replace(
        driven,
        shortest=scenario.published_length if rules.published_way else math.nan,
        optimal_time=scenario.published_length / rules.optimal_speed,
        clock_from=rules.clock_from,
        limit=rules.limit,
    )


def _along(
    driven: Trajectory,
    task: Any,
    briefing: Briefing,
    path: Course,
    policy: Policy,
    states: NDArray[Any],
    flags: dict[str, bool],
) -> Trajectory:
    """Returns the trajectory with what belongs to its path."""
    scenario = int(states["scenario"][0])
    run = task.pool.runs[scenario]
    vertices = task.pool.vertices[run["first"] : run["first"] + run["segments"] + 1]
    last = vertices[-1]
    end_pose = (last["x"], last["y"], math.atan2(last["uy"], last["ux"]))
    lookahead = policy if isinstance(policy, Lookahead) else Lookahead()
    along = dataclasses.replace(briefing, path=path._replace(path_index=np.full(len(states), scenario)))
    laps = task.scenarios[scenario].laps
    completion = float(states["arc_length"].max() / (run["length"] * max(laps, 1)))
    timed: dict[str, Any] = {}
    if briefing.reference is not None:
        names = ("error_x", "error_y", "heading_error", "command_yaw_rate")
        tracked = np.column_stack([*(states[name] for name in names), _limited(states, task.params, briefing)])
        timed = {"tracked": tracked, "floor": float(task.floors[scenario])}
    # on laps without end the environment knows no success: a lap kept inside the corridor is one
    success = flags["success"] if laps else completion >= 0.98 and not flags["left_corridor"]
    return dataclasses.replace(
        driven,
        success=success,
        left_corridor=flags["left_corridor"],
        completion=completion,
        arc_lengths=states["arc_length"].copy(),
        cross_track_errors=states["cross_track_error"].copy(),
        heading_errors=states["heading_error"].copy(),
        references=lookahead.errors(driven.poses, states["arc_length"], along),
        path=np.column_stack([vertices["x"], vertices["y"]]),
        lap_length=float(run["length"]) if run["closed"] else 0.0,
        goals=np.array([end_pose]) if laps else np.empty((0, 3)),
        **timed,
    )
