"""From cases to rows: rolls out every case of a suite and measures its episodes."""

import contextlib
import dataclasses
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from wayfield.benchmarks.contests import OF_KIND
from wayfield.benchmarks.episodes import crowds
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.episodes.rollout import bank_of, roll_out, roll_out_together
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.progress import tell_of_compiling, tracked
from wayfield.benchmarks.records.results import readable
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs import goal_reaching
from wayfield.envs.scenarios import spec_of
from wayfield.envs.tasks.specs import CROWDS
from wayfield.policies.parts.rehearsal import unrehearsed

Episode = tuple[dict[str, Any], Trajectory]
FEW = 4  # episodes of a setting, up to which several are driven at once
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
    numbers: tuple[int, ...] = ()  # of the episodes, in place of the first ones
    given: Case | None = None  # the original case, where another machine keeps its files elsewhere

    def __str__(self) -> str:
        return f"{self.case.policy} on {self.case.scenario}"


Group = tuple[Setting, ...]  # that is driven at once
AsDone = Callable[[list[Group]], Iterator[tuple[int, list[list[Episode]]]]]  # their numbers, and each setting's rows


def run(
    settings: Sequence[Setting], groups: Sequence[Sequence[int]], as_done: AsDone, done: dict[int, list[Episode]]
) -> None:
    """Drives all settings.

    Args:
        groups: their numbers, of those that are driven at once in a list.
        done: receives the episodes of each setting, by its number, as soon as they are there.
    """
    order = heads_first([settings[group[0]] for group in groups])
    work = [tuple(settings[k] for k in groups[g]) for g in order]
    compiles = tell_of_compiling(goal_reaching.step_rows)
    for n, driven in tracked(as_done(work), len(work), "runs", compiles):
        done.update(zip(groups[order[n]], driven, strict=True))


def gathered(done: Mapping[int, list[Episode]]) -> tuple[Episodes, dict[str, Trajectory]]:
    """Returns the episodes of settings, and the trajectories by the key in the rows' column `trajectory`."""
    rows: list[Row] = []
    trajectories: dict[str, Trajectory] = {}
    for i in sorted(done):
        for row, trajectory in done[i]:
            key = f"{len(rows):05d}"
            trajectories[key] = trajectory
            rows.append({"trajectory": key} | row)
    return Episodes(rows), trajectories


def episodes(setting: Setting) -> list[Episode]:
    """Returns the episodes of a setting, each as its row and its trajectory.

    Of a file of the user's own it is said before the start where a law will lose a path.
    """
    with contextlib.nullcontext() if os.path.isabs(setting.case.scenario) else unrehearsed():
        return _driven(setting)


def together(settings: Sequence[Setting]) -> list[list[int]]:
    """Returns the numbers of settings, of those that are driven at once in a list: of few episodes, on other scenarios.

    What of the package drives in its scenarios drives the same alone and beside others, bit for bit.
    """
    groups: dict[str, list[int]] = {}
    for k, setting in enumerate(settings):
        case = setting.case
        frozen = case.scenario.partition("@")[0] == f"{case.family}/{case.split}" and case.every_scenario
        many = setting.members or setting.numbers or setting.episodes > FEW
        alone = bool(many) or case.entrant is not None or case.policy == "random" or setting.dynamics != "kinematic"
        if alone or not (frozen or _is_one(case)) or spec_of(case.env_id) in CROWDS.values():
            groups[str(k)] = [k]
        else:
            one = dataclasses.replace(case, family="", scenario="", published={}, source="", reference={}, filmed=False)
            alike = dataclasses.replace(setting, case=one, seed=0)
            groups.setdefault(repr(alike), []).append(k)
    return list(groups.values())


def _is_one(case: Case) -> bool:
    """Returns whether a case is about one scenario of the package."""
    return not case.every_scenario and not os.path.isabs(case.scenario) and len(bank_of(case)) == 1


def episodes_together(settings: Sequence[Setting]) -> list[list[Episode]]:
    """Returns the episodes of each of some settings of a list of `together`."""
    first = settings[0]
    if len(settings) == 1:
        return [episodes(first)]
    cases, seeds = [setting.case for setting in settings], [setting.seed for setting in settings]
    with unrehearsed():
        driven = roll_out_together(cases, first.dynamics, first.actuators, seeds, first.episodes)
    return [
        [_measured(setting, i, trajectory) for i, trajectory in enumerate(trajectories)]
        for setting, trajectories in zip(settings, driven, strict=True)
    ]


def _driven(setting: Setting) -> list[Episode]:
    case, numbers = setting.case, setting.numbers or range(setting.episodes)
    how: dict[str, Any] = {
        "dynamics": setting.dynamics,
        "actuators": setting.actuators,
        "seed": setting.seed,
        "episodes": setting.episodes,
        "members": setting.members,
        "numbers": setting.numbers,
    }
    if spec_of(case.env_id) in CROWDS.values():
        worlds = crowds.roll_out_worlds(case, **how)
        return [
            (_row(setting, i, crowds.measured(each)), each.shown()) for i, each in zip(numbers, worlds, strict=True)
        ]
    return [_measured(setting, i, each) for i, each in zip(numbers, roll_out(case, **how), strict=True)]


def _measured(setting: Setting, episode: int, trajectory: Trajectory) -> Episode:
    case = setting.case
    metrics = OF_KIND[spec_of(case.env_id).kind].metrics
    of_contest = {column.name: metric(trajectory) for column, metric in metrics.items()}
    return _row(setting, episode, measure(trajectory, case.arrival_radius) | of_contest), trajectory


def _row(setting: Setting, episode: int, measured: Mapping[str, float]) -> dict[str, Any]:
    case = setting.given or setting.case
    conditions = {
        "suite": setting.suite,
        "contest": case.contest,
        "family": case.family,
        "scenario": case.scenario,
        "robot": str(case.env_kwargs.get("robot", "")),
        "disturbance": case.env_kwargs.get("disturbance", "none"),
        "policy": case.policy,
        "gains_name": case.gains_name,
        "gains": case.gains_text,
        "dynamics": setting.dynamics,
        "actuators": setting.actuators,
    }
    numbers = {
        "seed": setting.seed + episode,
        "episode": episode,
        "arrival_radius": math.nan if case.arrival_radius is None else case.arrival_radius,
        **measured,
    }
    return {name: readable(value) for name, value in conditions.items()} | numbers


def heads_first(settings: Sequence[Setting]) -> list[int]:
    """Returns the order in which workers shall take the settings: those that compile on a first run before the rest.

    The kernels of scenes take longest, so that the first worker compiles them. Meanwhile others drive on paths, with
    all that drive there, and only then in scenes: no worker waits for what another one compiles. What is left is short.
    """
    plants: set[tuple[str, str]] = set()
    drivers: set[tuple[str, str, str]] = set()
    ranked = []
    for i, setting in enumerate(settings):
        case = setting.case
        observed = spec_of(case.env_id).observes
        plant, driver = (observed, setting.dynamics), (case.contest, case.policy, setting.dynamics)
        if plant not in plants:
            rank = 1 if observed == "path" else 0
        elif driver not in drivers:
            rank = 2 if observed == "path" else 3
        else:
            rank = 4
        plants.add(plant)
        drivers.add(driver)
        ranked.append((rank, i))
    return [i for _, i in sorted(ranked)]
