"""Environment steps per second, beside Gymnasium's CartPole in the same run: python benchmarks/studies/throughput.py

One thread; with `--threads` one and several of wayfield side by side. The contenders take turns, round after round,
so that a machine that slows down slows all of them; the median of the rounds counts. Actions are drawn beforehand,
uniformly; resets are part of the work.
"""

import dataclasses
import importlib.util
import itertools
import json
import math
import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

# before NumPy is loaded, which reads it once
os.environ.setdefault("OMP_NUM_THREADS", "1")

import click
import gymnasium
import numba
import numpy as np
import rich.console
import rich.table
from numpy.typing import NDArray

import wayfield.envs  # noqa: F401  registers the ids
from wayfield.benchmarks.contests import ALL_CONTESTS
from wayfield.benchmarks.records.cases import GOAL_REACHING, PATH_FOLLOWING
from wayfield.benchmarks.records.progress import tracked
from wayfield.benchmarks.tuning.tune import SEARCH_SPLIT, Search
from wayfield.envs.crowds.people import ORCA, TURNS_BACK, WALK, stroll
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.policies.parts.tuned import PACE
from wayfield.system.checks import MOST_THREADS
from wayfield.system.command_line import OneLineErrors
from wayfield.system.executors import HERE

CARTPOLE = "CartPole-v1"
NUM_ENVS = 1024
NUM_THREADED = 4096  # where threads are compared
NUM_DECIDING = 512
NUM_SCANNING = 256  # 72 rays each, among discs and on maps
NUM_PYMUNK = 64  # its physics engine is called once a robot
BLOCK = 16  # actions drawn beforehand, for each robot

Steps = Callable[[], int]  # takes some steps and returns how many


@dataclasses.dataclass(frozen=True)
class Contender:
    """What is timed: a name, how many robots step at once, and the steps; against CartPole with as many."""

    name: str
    robots: int
    steps: Steps
    cartpole: bool = False


def vector_steps(env_id: str, num_envs: int, **kwargs: Any) -> Steps:
    """Returns a function that steps a native vector environment BLOCK times; ended episodes reset themselves."""
    envs = gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point", **kwargs)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(BLOCK)]
    envs.reset(seed=0)

    def steps() -> int:
        for action in actions:
            envs.step(action)
        return BLOCK * num_envs

    return steps


def single_steps(env_id: str, **kwargs: Any) -> Steps:
    """Returns a function that steps a single environment many times, without wrappers; resets it where one ends."""
    env = gymnasium.make(env_id, **kwargs).unwrapped
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(BLOCK * BLOCK)]
    env.reset(seed=0)

    def steps() -> int:
        for action in actions:
            if env.step(action)[2]:
                env.reset()
        return len(actions)

    return steps


def discs(count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Returns the file of a field of discs as dense whatever their number, none near the start and the goal."""
    side = 2.5 * math.sqrt(count)
    places = rng.uniform(-0.5 * side, 0.5 * side, (4 * count, 2))
    far = np.minimum(np.hypot(*places.T), np.hypot(*(places - (3.0, 0.0)).T)) > 1.0
    obstacles = [{"kind": "circle", "x": x, "y": y, "radius": 0.2} for x, y in places[far][:count].tolist()]
    return {"start": [0, 0, 0], "goal": [3, 0, 0], "obstacles": obstacles}


def boxes(count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Returns the file of `discs` with a box of that size in place of each, turned at random."""
    scenario = discs(count, rng)
    scenario["obstacles"] = [
        {"kind": "box", "x": each["x"], "y": each["y"], "length": 0.4, "width": 0.3, "heading": heading}
        for each, heading in zip(scenario["obstacles"], rng.uniform(-3.0, 3.0, count).tolist(), strict=True)
    ]
    return scenario


def blocks(share: float, rng: np.random.Generator, side: int = 4) -> NDArray[np.bool_]:
    """Returns a map of 2,000 x 2,000 cells, that share of them in blocks `side` wide; free around start and goal."""
    count = 2000 // side
    return _cleared(np.kron(rng.random((count, count)) < share, np.ones((side, side), np.bool_)).astype(np.bool_))


def building(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Returns a map of 2,000 x 2,000 cells: rooms 4 to 9 m wide with doors of 1.2 m and furniture, cells of 0.1 m."""
    occupied = np.zeros((2000, 2000), np.bool_)
    walls = np.cumsum(rng.integers(40, 90, 60))
    walls = walls[walls < 1990]
    for a in walls:
        occupied[a : a + 2] = occupied[:, a : a + 2] = True
    for first, last in itertools.pairwise(walls.tolist()):
        for a in walls:
            door, other = rng.integers(first + 4, last - 14, 2)
            occupied[a : a + 2, door : door + 12] = occupied[other : other + 12, a : a + 2] = False
    for row, column, length, width in rng.integers((0, 0, 2, 2), (1994, 1994, 7, 7), (1600, 4)):
        occupied[row : row + width, column : column + length] = True
    return _cleared(occupied)


def _cleared(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    occupied[980:1020, 980:1050] = False
    return occupied


def scanning() -> list[Contender]:
    """Returns the contenders that scan with 72 rays: among discs, and on large maps of cells of 0.1 m."""
    rng = np.random.default_rng(0)
    contenders: list[Contender] = []
    with tempfile.TemporaryDirectory() as folder:

        def contender(name: str, scenario: dict[str, Any]) -> None:
            file = Path(folder) / f"{len(contenders)}.json"
            file.write_text(json.dumps(scenario), encoding="utf-8")
            steps = vector_steps(GOAL_REACHING, NUM_SCANNING, scenario=str(file), num_beams=72, max_range=5.0)
            contenders.append(Contender(name, NUM_SCANNING, steps))

        for count in (16, 64, 1024):
            contender(f"goal reaching, 72 rays, {count:,} discs", discs(count, rng))
        for count in (64, 1024):
            contender(f"goal reaching, 72 rays, {count:,} boxes", boxes(count, rng))
        maps = {f"{share:.1%} in blocks": blocks(share, rng) for share in (0.001, 0.1, 0.3)}
        # beams take most leaps where single cells are some 6 % of all
        maps |= {f"{share:.1%} in single cells": blocks(share, rng, side=1) for share in (0.06, 0.1)}
        maps["a building"] = building(rng)
        for name, occupied in maps.items():
            np.save(Path(folder) / "map.npy", occupied)
            map_file = {"file": "map.npy", "resolution": 0.1, "origin": [-100, -100, 0]}
            scenario = {"start": [0, 0, 0], "goal": [3, 0, 0], "map": map_file}
            contender(f"goal reaching, 72 rays, 2,000 x 2,000 cells, {name}", scenario)
    cartpole = vector_steps(CARTPOLE, NUM_SCANNING)
    return [*contenders, Contender(CARTPOLE, NUM_SCANNING, cartpole, cartpole=True)]


def by_mujoco() -> list[Contender]:
    """Returns the MuJoCo plant beside MuJoCo's own loop over the same model, where it is installed.

    The loop does the physics of a control period and nothing else; the rest of a step is ours.
    """
    if not importlib.util.find_spec("mujoco"):
        return []
    import mujoco

    from wayfield.envs.robots import ROBOTS
    from wayfield.envs.robots.mjcf import TIMESTEP, mjcf

    chosen = []
    for name, env_id in (("p3dx", PATH_FOLLOWING), ("omni3", TASKS["path_following"].ids[True])):
        model = mujoco.MjModel.from_xml_string(mjcf(ROBOTS[name]))
        data = mujoco.MjData(model)
        speeds = np.random.default_rng(0).uniform(-8.0, 8.0, (BLOCK * BLOCK, model.nu))

        def loop(model: Any = model, data: Any = data, speeds: Any = speeds) -> int:
            mujoco.mj_resetData(model, data)
            for each in speeds:
                data.ctrl[:] = each
                mujoco.mj_step(model, data, round(CONTROL_PERIOD / TIMESTEP))
            return len(speeds)

        chosen += [
            Contender(f"path following, {name}, mujoco", 1, single_steps(env_id, robot=name, dynamics="mujoco")),
            Contender(f"{name}, MuJoCo's own loop", 1, loop),
        ]
    return chosen


def contenders() -> list[Contender]:
    """Returns all that are timed; each has taken its first, slow steps."""
    goal: dict[str, Any] = {"scenario": "discs", "num_beams": 32}
    finer = [
        Contender(
            f"goal reaching, {n} rays", NUM_ENVS, vector_steps(GOAL_REACHING, NUM_ENVS, **goal | {"num_beams": n})
        )
        for n in (72, 720)
    ]
    pymunk: dict[str, Any] = {"dynamics": "pymunk"}
    docking = TASKS["docking"].ids[True]
    chosen = [
        Contender("path following", NUM_ENVS, vector_steps(PATH_FOLLOWING, NUM_ENVS)),
        Contender("goal reaching, 32 rays", NUM_ENVS, vector_steps(GOAL_REACHING, NUM_ENVS, **goal)),
        *finer,
        # with as many obstacles, namely none
        Contender("goal reaching in the open", NUM_ENVS, vector_steps(GOAL_REACHING, NUM_ENVS, scenario="open_field")),
        Contender("docking in the open", NUM_ENVS, vector_steps(docking, NUM_ENVS, scenario="open")),
        Contender(CARTPOLE, NUM_ENVS, vector_steps(CARTPOLE, NUM_ENVS), cartpole=True),
        *scanning(),
        Contender("path following", 1, single_steps(PATH_FOLLOWING)),
        Contender("goal reaching, 32 rays", 1, single_steps(GOAL_REACHING, **goal)),
        Contender(CARTPOLE, 1, single_steps(CARTPOLE), cartpole=True),
        Contender("path following, pymunk", NUM_PYMUNK, vector_steps(PATH_FOLLOWING, NUM_PYMUNK, **pymunk)),
        Contender(
            "goal reaching, 32 rays, pymunk", NUM_PYMUNK, vector_steps(GOAL_REACHING, NUM_PYMUNK, **goal, **pymunk)
        ),
        Contender(CARTPOLE, NUM_PYMUNK, vector_steps(CARTPOLE, NUM_PYMUNK), cartpole=True),
        *by_mujoco(),
    ]
    for contender in chosen:
        contender.steps()
    return chosen


def crowds() -> list[Contender]:
    """Returns what is timed of worlds of several bodies: environments, and ORCA beside that of others.

    Where they are installed: RVO2 (pyrvo), navground and VMAS, each with worlds of its own of as many agents.
    """
    team, people = "wayfield/DiffDriveTeam-v0", "wayfield/OmniPeople-v0"
    chosen = [
        Contender("teams of 8, 32 rays", 1024, vector_steps(team, 1024, scenario="circle_8", num_beams=32)),
        Contender("teams of 100, 72 rays", 1000, vector_steps(team, 1000, scenario="open_100", num_beams=72)),
        Contender("one among 24 people, 32 rays", 100, vector_steps(people, 100, scenario="lanes_24", num_beams=32)),
        *(
            Contender(
                f"teams of {n:,} at density 0.3, 32 rays",
                1000,
                vector_steps(team, 1000, scenario=spread(n), num_beams=32),
            )
            for n in (100, 1000)
        ),
    ]
    if importlib.util.find_spec("vmas"):
        chosen.append(Contender("teams of 8, 12 rays: VMAS, navigation", 1024, _by_vmas(8, 128)))
    for n in (10, 100, 1000):
        rng = np.random.default_rng(n)
        side = math.sqrt(n / 0.3)
        starts, goals = rng.uniform(0.0, side, (n, 2)), rng.uniform(0.0, side, (n, 2))
        chosen.append(Contender("ORCA, density 0.3: people alone", n, _strolled(starts, goals)))
        if importlib.util.find_spec("pyrvo"):
            chosen.append(Contender("ORCA, density 0.3: RVO2", n, _by_rvo2(starts, goals)))
        if importlib.util.find_spec("navground"):
            chosen.append(Contender("ORCA, density 0.3: navground", n, _by_navground(starts, goals)))
    return chosen


def spread(n: int, density: float = 0.3) -> TeamScenario:
    """Returns a team in the open, each robot to the start of another one; so dense (1/m^2) whatever their number."""
    side = math.ceil(math.sqrt(n))
    places = (np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)[:n]) / math.sqrt(density)
    starts = np.column_stack([places, np.zeros(n)])
    goals = starts[np.random.default_rng(0).permutation(n)]
    return TeamScenario.made(f"spread_{n}", starts.tolist(), goals.tolist())


def _strolled(starts: NDArray[np.float64], goals: NDArray[np.float64]) -> Steps:
    walk = np.zeros(len(starts), WALK)
    (walk["x"], walk["y"]), (walk["goal_x"], walk["goal_y"]) = starts.T, goals.T
    walk["law"], walk["speed"], walk["radius"], walk["then"] = ORCA, 1.0, 0.2, TURNS_BACK
    walk["horizon"], walk["wall_horizon"], walk["share"] = 3.0, 0.5, 0.5
    stroll(walk, 1, 0.1, reach=5.0)  # compiles

    def steps() -> int:
        stroll(walk, 40, 0.1, reach=5.0)
        return 40 * len(starts)

    return steps


def _by_rvo2(starts: NDArray[np.float64], goals: NDArray[np.float64]) -> Steps:
    import pyrvo

    simulator = pyrvo.RVOSimulator(0.1, 5.0, 10, 3.0, 0.5, 0.2, 1.0)
    for start, goal in zip(starts, goals, strict=True):
        k = simulator.add_agent(tuple(start.tolist()))
        way = goal - start
        simulator.set_agent_pref_velocity(k, tuple((way / max(1.0, np.hypot(*way))).tolist()))

    at = [tuple(start.tolist()) for start in starts]

    def steps() -> int:
        for k, start in enumerate(at):  # as `stroll` does, lest they disperse
            simulator.set_agent_position(k, start)
            simulator.set_agent_velocity(k, (0.0, 0.0))
        for _ in range(40):
            simulator.do_step()
        return 40 * len(starts)

    return steps


def _by_navground(starts: NDArray[np.float64], goals: NDArray[np.float64]) -> Steps:
    from navground import core, sim

    def world() -> Any:
        place = sim.World()
        for start, goal in zip(starts, goals, strict=True):
            kinematics = core.Kinematics.make_type("Omni")
            kinematics.max_speed = kinematics.max_angular_speed = 1.0
            behavior = core.Behavior.make_type("ORCA")
            behavior.horizon, behavior.optimal_speed, behavior.safety_margin = 3.0, 1.0, 0.0
            agent = sim.Agent(radius=0.2, behavior=behavior, kinematics=kinematics, control_period=0.1)
            agent.state_estimation = sim.StateEstimation.make_type("Bounded")
            agent.state_estimation.range = 5.0
            agent.task = sim.Task.make_type("Waypoints")
            agent.task.waypoints = [tuple(goal.tolist())]
            agent.position = start
            place.add_agent(agent)
        return place

    def steps() -> int:
        world().run(40, 0.1)  # anew, lest they disperse: to make one takes some per cent of it
        return 40 * len(starts)

    return steps


def _by_vmas(team: int, worlds: int) -> Steps:
    import torch
    import vmas

    torch.set_num_threads(1)
    env = vmas.make_env("navigation", num_envs=worlds, device="cpu", continuous_actions=True, n_agents=team, seed=0)
    env.reset()
    actions = [2.0 * torch.rand(worlds, 2) - 1.0 for _ in range(team)]

    def steps() -> int:
        for _ in range(BLOCK):
            env.step(actions)
        return BLOCK * team * worlds

    return steps


def threaded(num_threads: int) -> list[Contender]:
    """Returns what is timed with one thread and with several, the environment and a law on it; all have begun."""
    goal: dict[str, Any] = {"scenario": "discs"}
    few = [
        ("path following", PATH_FOLLOWING, {}),
        *((f"goal reaching, {n} rays", GOAL_REACHING, {**goal, "num_beams": n}) for n in (32, 72, 720)),
    ]
    chosen = []
    for name, env_id, kwargs in few:
        for n in (1, num_threads):
            steps = vector_steps(env_id, NUM_THREADED, **kwargs, num_threads=n)
            chosen.append(Contender(f"{name}, {n} thread{'s'[: n > 1]}", NUM_THREADED, steps))
    for n in (1, num_threads):
        steps = deciding_steps("dwa", NUM_DECIDING, n)
        chosen.append(Contender(f"dwa deciding, {n} thread{'s'[: n > 1]}", NUM_DECIDING, steps))
    for contender in chosen:
        contender.steps()
    return chosen


def deciding() -> list[Contender]:
    """Returns planners that decide for one robot, beside public ones of as many samples or steps where there are."""
    on_path: dict[str, Any] = {"env_id": PATH_FOLLOWING, "scenario": "circle"}
    chosen = [Contender("mppi, 256 samples of 30 steps", 1, deciding_steps("mppi", 1, 1))]
    if importlib.util.find_spec("pytorch_mppi"):
        chosen.append(Contender("pytorch_mppi, 256 samples of 30 steps", 1, _by_pytorch_mppi()))
    chosen.append(Contender("mpc, 20 steps", 1, deciding_steps("mpc", 1, 1, **on_path)))
    if importlib.util.find_spec("do_mpc"):
        chosen.append(Contender("do-mpc, 20 steps", 1, _by_do_mpc()))
    chosen += [Contender(name, 1, deciding_steps(name, 1, 1)) for name in ("dwa", "vfh_plus", "scan_planner")]
    for contender in chosen:
        contender.steps()
    return chosen


TUNED = {
    "path-following": ("pure_pursuit", "stanley", "lqr", "mpc"),
    "trajectory-tracking": ("kanayama", "tv_lqr"),
    "docking": ("smooth_pose", "mpc_pose", "reeds_shepp"),
    "goal-obstacles": ("vfh_plus", "dwa", "scan_planner", "mppi", "nav2_mppi"),
}  # some of those that `wayfield tune` searches gains of, by contest
SLOW = ("mpc", "mppi", "nav2_mppi")  # for which it does not matter how many robots decide at once
FEW = 1  # scenarios of each family, for those


def _print_tuning(rounds: int) -> None:
    """Prints how many steps of robots a search drives in a second of processor time, with its default gains."""
    searches = []
    for suite, names in TUNED.items():
        contest = ALL_CONTESTS[suite]
        speed = contest.rules.speed if contest.rules and contest.rules.speed else PACE
        for name in names:
            count = FEW if name in SLOW else 10  # scenarios of each family, as the search has them
            searches.append(Search(name, contest, ROBOTS["p3dx"], speed, "none", "lagged", 0, 1, count, 0))
    rates: dict[str, list[float]] = {search.policy: [] for search in searches}
    for n in range(rounds + 1):
        for search in tracked(searches, len(searches), f"searches, turn {n}"):
            start = time.process_time()
            frames = search.drive(search.gains_at({}), SEARCH_SPLIT, HERE).score.frames
            if n:  # in the first one it is compiled
                rates[search.policy].append(frames / (time.process_time() - start))
    for name, values in rates.items():
        print(f"{name}: {statistics.median(values):,.0f} steps a second")


def _by_pytorch_mppi() -> Steps:
    """Returns decisions of a unicycle among ten discs: its costs are distances, as few operations as there can be."""
    import torch
    from pytorch_mppi import MPPI

    torch.set_num_threads(1)
    discs = 8.0 * torch.rand(10, 2)

    def dynamics(state: Any, action: Any) -> Any:
        way, heading = 0.1 * action[:, 0], state[:, 2]
        return state + torch.stack((way * torch.cos(heading), way * torch.sin(heading), 0.1 * action[:, 1]), 1)

    def cost(state: Any, action: Any) -> Any:
        del action
        return torch.norm(state[:, :2] - 8.0, dim=1) + 100.0 * (torch.cdist(state[:, :2], discs) < 0.5).any(dim=1)

    most = torch.tensor([0.6, 1.5])
    planner = MPPI(
        dynamics, cost, 3, torch.diag(most**2), num_samples=256, horizon=30, u_min=-most, u_max=most, u_init=0.0 * most
    )

    def steps() -> int:
        for _ in range(2):
            planner.command(torch.zeros(3))
        return 2

    return steps


def _by_do_mpc() -> Steps:
    """Returns decisions of a unicycle with bounds on speed and yaw rate, which moves to a place by IPOPT."""
    import casadi
    import do_mpc

    model = do_mpc.model.Model("continuous")
    x, y, heading = (model.set_variable("_x", name) for name in ("x", "y", "heading"))
    v, w = (model.set_variable("_u", name) for name in ("v", "w"))
    for name, rate_of in (("x", v * casadi.cos(heading)), ("y", v * casadi.sin(heading)), ("heading", w)):
        model.set_rhs(name, rate_of)
    model.setup()
    planner = do_mpc.controller.MPC(model)
    planner.settings.n_horizon, planner.settings.t_step, planner.settings.store_full_solution = 20, 0.1, False
    planner.settings.supress_ipopt_output()
    cost = (x - 2.0) ** 2 + (y - 1.0) ** 2
    planner.set_objective(lterm=cost, mterm=cost)
    planner.set_rterm(v=0.1, w=0.1)
    for name, most in (("v", 0.6), ("w", 1.5)):
        planner.bounds["lower", "_u", name], planner.bounds["upper", "_u", name] = -most, most
    planner.setup()
    start = np.zeros((3, 1))
    planner.x0 = start
    planner.set_initial_guess()

    def steps() -> int:
        planner.make_step(start)
        return 1

    return steps


def deciding_steps(
    policy: str, num_envs: int, num_threads: int, env_id: str = GOAL_REACHING, scenario: str = "clutter_10/test"
) -> Steps:
    """Returns a function that lets a policy decide a few times on the same observations of a task."""
    from wayfield.policies import Pilot, make

    beams: dict[str, Any] = {"num_beams": 72} if env_id == GOAL_REACHING else {}
    envs = gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point", scenario=scenario, **beams)
    pilot = Pilot(make(policy), envs, num_threads)
    observations, _ = envs.reset(seed=0)
    pilot.reset()

    def steps() -> int:
        for _ in range(2):
            pilot.command(observations)
        return 2 * num_envs

    return steps


def resident_with(env_id: str, count: int) -> int:
    """Returns the memory (bytes) that this process, a fresh one, has resident with so many robots that step.

    The observations and infos of a step are among it, and the generator of each robot.
    """
    envs = gymnasium.make_vec(env_id, count, vectorization_mode="vector_entry_point")
    envs.reset(seed=0)
    action = np.zeros(envs.action_space.shape or (), np.float32)
    step = [envs.step(action) for _ in range(3)][-1]
    resident = _resident()
    del step
    return resident


def _resident() -> int:
    """Returns the memory (bytes) that this process has resident."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _print_memory() -> None:
    """Prints the bytes a robot of every id."""
    table = rich.table.Table(title="Memory, by default arguments", title_justify="left")
    for header in ("id", "bytes a robot", "a million robots (GB)"):
        table.add_column(header, justify="left" if header == "id" else "right")
    ids = sorted(each for spec in TASKS.values() for each in spec.ids.values())
    spawned = multiprocessing.get_context("spawn")
    for env_id in ids:
        sizes = []
        for count in (1, 1_000, 51_000):  # the first compiles: a compiler leaves memory that robots would move into
            with ProcessPoolExecutor(1, spawned) as pool:
                sizes.append(pool.submit(resident_with, env_id, count).result())
        value = (sizes[2] - sizes[1]) / 50_000
        table.add_row(env_id, f"{value:,.0f}", f"{value / 1e3:.2f}")
    rich.console.Console(width=100).print(table)


def rate(steps: Steps, seconds: float) -> float:
    """Returns the steps per second over at least that time."""
    count = 0
    start = time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds or not count:
        count += steps()
    return count / elapsed


def measured(chosen: list[Contender], rounds: int, seconds: float) -> list[tuple[Contender, float]]:
    """Returns each contender with the median of its rates."""
    turns = [(i, contender) for _ in range(rounds) for i, contender in enumerate(chosen)]
    rates: list[list[float]] = [[] for _ in chosen]
    for i, contender in tracked(turns, len(turns), "turns"):
        rates[i].append(rate(contender.steps, seconds))
    return [(contender, statistics.median(each)) for contender, each in zip(chosen, rates, strict=True)]


@click.command("throughput", cls=OneLineErrors)
@click.option("--rounds", type=click.IntRange(min=1), default=5, show_default=True, help="Turns of each contender.")
@click.option(
    "--seconds",
    type=float,
    default=0.5,
    show_default=True,
    help="Of a turn.",
)
@click.option(
    "--threads",
    type=click.IntRange(2, MOST_THREADS),
    help="Instead: with one and with so many threads, at 4,096 robots, beside each other.",
)
@click.option(
    "--crowds",
    "crowded",
    is_flag=True,
    help="Instead: worlds of several bodies, beside RVO2 (pyrvo), navground and VMAS where there are.",
)
@click.option(
    "--decisions", is_flag=True, help="Instead: planners of one robot, beside pytorch_mppi and do-mpc where there are."
)
@click.option("--tuning", is_flag=True, help="Instead: what a search of gains drives a second of processor time.")
@click.option("--memory", is_flag=True, help="Instead: the bytes a robot of every id (Linux).")
def main(
    rounds: int, seconds: float, threads: int | None, crowded: bool, decisions: bool, tuning: bool, memory: bool
) -> None:
    """Prints the environments' steps per second, beside those of CartPole."""
    if not 0.0 < seconds <= 60.0:  # NaN is neither
        raise click.UsageError(f"--seconds {seconds} must be above 0 and at most 60")
    if memory:
        if not os.path.exists("/proc/self/statm"):
            raise click.UsageError("--memory reads /proc, which this system does not have")
        _print_memory()
        return
    numba.set_num_threads(1)
    if tuning:
        _print_tuning(rounds)
        return
    if crowded or decisions:
        for contender, value in measured(crowds() if crowded else deciding(), rounds, seconds):
            print(f"{contender.name}, {contender.robots:,} at once: {value:,.0f} a second")
        return
    if threads is not None:
        _print_threaded(measured(threaded(threads), rounds, seconds), rounds)
        return
    results = measured(contenders(), rounds, seconds)
    cartpole = {contender.robots: value for contender, value in results if contender.cartpole}
    table = rich.table.Table(
        title=f"Environment steps per second, one thread, median of {rounds} rounds", title_justify="left"
    )
    for header in ("environment", "robots", "steps/s", "times CartPole"):
        table.add_column(header, justify="left" if header == "environment" else "right")
    for contender, value in results:
        ratio = value / cartpole[contender.robots]
        table.add_row(
            contender.name, f"{contender.robots:,}", f"{value:,.0f}", f"{ratio:.2f}", end_section=contender.cartpole
        )
    rich.console.Console(width=100).print(table)
    print(f"NumPy {np.__version__}, Numba {numba.__version__}, Gymnasium {gymnasium.__version__}")


def _print_threaded(results: list[tuple[Contender, float]], rounds: int) -> None:
    """Prints what several threads make of the work of one."""
    title = f"Steps or decisions per second, one thread and several, median of {rounds} rounds"
    table = rich.table.Table(title=title, title_justify="left")
    for header in ("what", "robots", "a second", "times one thread"):
        table.add_column(header, justify="left" if header == "what" else "right")
    for (one, alone), (several, value) in zip(results[::2], results[1::2], strict=True):
        table.add_row(one.name, f"{one.robots:,}", f"{alone:,.0f}", "")
        table.add_row(several.name, f"{one.robots:,}", f"{value:,.0f}", f"{value / alone:.2f}", end_section=True)
    rich.console.Console(width=100).print(table)


if __name__ == "__main__":
    main()
