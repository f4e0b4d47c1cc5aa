"""From cases to rows: rolls out every case of a suite and measures its episodes."""

import dataclasses
from collections.abc import Sequence

from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.columns import text
from wayfield.benchmarks.contests import OF_KIND
from wayfield.benchmarks.metrics import measure
from wayfield.benchmarks.progress import tell_of_compiling, tracked
from wayfield.benchmarks.results import Row, readable
from wayfield.benchmarks.rollout import roll_out
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs import goal_reaching
from wayfield.envs.engines import Map
from wayfield.envs.scenarios import spec_of

Episode = tuple[dict[str, str], Trajectory]
WORST = 3  # episodes of each entry of a contest that are shown


@dataclasses.dataclass(frozen=True)
class Setting:
    """A case under the conditions of a run."""

    suite: str
    case: Case
    dynamics: str
    actuators: str
    seed: int
    episodes: int
    keep: int | None = WORST  # of the worst episodes of an entry of a contest, their trajectories; None: all, whole
    members: tuple[int, ...] = ()  # of the bank, an episode each, in place of the first ones
    given: Case | None = None  # the case as it was asked for, where another machine keeps its files elsewhere

    def __str__(self) -> str:
        return f"{self.case.policy} on {self.case.scenario}"


def run(settings: Sequence[Setting], in_parallel: Map) -> tuple[list[Row], dict[str, Trajectory]]:
    """Returns one row for each episode, and the trajectories by the key in the rows' column `trajectory`."""
    order = heads_first(settings)
    first = tell_of_compiling(goal_reaching.step_rows)
    done = tracked(in_parallel(episodes, [settings[i] for i in order]), len(settings), "cases", not first)
    of_setting = dict(zip(order, done, strict=True))
    rows: list[Row] = []
    trajectories: dict[str, Trajectory] = {}
    for i in range(len(settings)):
        for row, trajectory in of_setting[i]:
            key = f"{len(rows):05d}"
            trajectories[key] = trajectory
            rows.append({"trajectory": key} | row)
    return rows, trajectories


def episodes(setting: Setting) -> list[Episode]:
    """Returns the episodes of a setting, each as its row and its trajectory."""
    case = setting.case
    trajectories = roll_out(
        case,
        dynamics=setting.dynamics,
        actuators=setting.actuators,
        seed=setting.seed,
        episodes=setting.episodes,
        members=setting.members,
    )
    return [(_row(setting, i, trajectory), trajectory) for i, trajectory in enumerate(trajectories)]


def _row(setting: Setting, episode: int, trajectory: Trajectory) -> dict[str, str]:
    case = setting.given or setting.case
    conditions = {
        "suite": setting.suite,
        **case.place,
        "scenario": case.scenario,
        "robot": str(case.env_kwargs.get("robot", "")),
        "disturbance": case.env_kwargs.get("disturbance", "none"),
        "policy": case.policy,
        "gains_name": case.gains_name,
        "gains": case.gains_text,
        "dynamics": setting.dynamics,
        "actuators": setting.actuators,
        "seed": str(setting.seed + episode),
        "episode": str(episode),
        "arrival_radius": "" if case.arrival_radius is None else text(case.arrival_radius),
    }
    conditions = {name: readable(value) for name, value in conditions.items()}
    found = measure(trajectory, case.arrival_radius)
    of_task = OF_KIND[spec_of(case.env_id).kind].metrics
    found |= {name: metric(trajectory) for name, metric in of_task.items()}
    return conditions | {name: text(value) for name, value in found.items()}


def heads_first(settings: Sequence[Setting]) -> list[int]:
    """Returns the order in which workers shall take the settings: those that compile on a first run before the rest.

    The kernels of scenes take longest, so that whoever comes first compiles them. Meanwhile the others meet paths, with
    all that drive there, and only then scenes: nobody waits for what another one compiles. What is left is short.
    """
    plants: set[tuple[str, str]] = set()
    drivers: set[tuple[str, str, str]] = set()
    ranked = []
    for i, setting in enumerate(settings):
        case = setting.case
        on_path = spec_of(case.env_id).on_path
        plant, driver = (str(on_path), setting.dynamics), (case.document, case.policy, setting.dynamics)
        if plant not in plants:
            rank = 1 if on_path else 0
        elif driver not in drivers:
            rank = 2 if on_path else 3
        else:
            rank = 4
        plants.add(plant)
        drivers.add(driver)
        ranked.append((rank, i))
    return [i for _, i in sorted(ranked)]
