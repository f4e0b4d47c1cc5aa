"""Policies in a running CoppeliaSim: python -m wayfield.bridges.coppelia.evaluate --scenario circle

The scenario is ours and so are the policies, what they observe, and what is measured; the robot is the simulator's, or
that of `python -m wayfield.bridges.coppelia`. Obstacles of a goal scenario stand in the simulator only if its scene has
them: our server's does, by the same name.
"""

import dataclasses
import os
from collections.abc import Iterable
from pathlib import Path

import click

from wayfield.benchmarks.commands.contest_report import drawing, holding
from wayfield.benchmarks.commands.evaluate import _print, write_case_tables
from wayfield.benchmarks.contests import OF_KIND
from wayfield.benchmarks.entrants.own_scenario import POLICIES, SUFFIXES, own_cases
from wayfield.benchmarks.figures.document_figures import draw, stem_of, wanted_figures
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Row
from wayfield.benchmarks.records.results import read_rows, readable, write_rows, write_trajectories
from wayfield.benchmarks.records.run_folder import Run, default_folder, staging
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.envs.robots import ACTUATORS
from wayfield.envs.scenarios import GOAL_SCENARIOS, PATH_SCENARIOS
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.system.checks import suggestion
from wayfield.system.command_line import SEED, Choice, Names, OneLineErrors, words_given
from wayfield.system.executors import HERE

COPPELIA = "coppelia"
_EVERY_POLICY = dict.fromkeys(name for names in POLICIES.values() for name in names)


def cases_of(scenario: str, names: tuple[str, ...] | None, address: str | None, steps: int | None) -> tuple[Case, ...]:
    """Returns a case for each policy; by default all that can do the scenario's task.

    Args:
        scenario: a path or goal scenario, a family, or a file.
        steps: of the clock; None: 1200, or as many as the way of a file is long.

    Raises:
        ValueError: if there is no such scenario, or a policy is of another task.
        OSError: if the scenario's file cannot be read.
    """
    family = scenario.partition("/")[0]
    for kind, presets in (("path", PATH_SCENARIOS), ("goal", GOAL_SCENARIOS)):
        contest = OF_KIND[kind]
        if scenario not in presets and family not in contest.spec.families:
            continue
        for name in names or ():
            if name not in POLICIES[kind]:
                raise ValueError(f"policy {name!r} cannot do it; choose from {', '.join(POLICIES[kind])}")
        kwargs = {**contest.env_kwargs, "address": address}
        return tuple(
            Case(
                kind, scenario, contest.env_id("p3dx"), scenario, name, env_kwargs=kwargs,
                max_episode_steps=steps or 1200,
            )
            for name in names or contest.policies
        )  # fmt: skip
    if scenario.lower().endswith(SUFFIXES):
        return tuple(
            dataclasses.replace(
                case,
                env_kwargs={**case.env_kwargs, "address": address},
                max_episode_steps=steps or case.max_episode_steps,
            )
            for case in own_cases(scenario, names=names)
        )
    known = (*PATH_SCENARIOS, *GOAL_SCENARIOS)
    raise ValueError(f"{scenario!r} is unknown.{suggestion(scenario, known)} The scenarios are {', '.join(known)}")


def driven(cases: Iterable[Case], actuators: str, seed: int, count: int) -> tuple[list[Row], dict[str, Trajectory]]:
    """Returns a row for each episode of each case, and the trajectories by the rows' column `trajectory`.

    One after the other: there is one robot.
    """
    rows: list[Row] = []
    trajectories: dict[str, Trajectory] = {}
    for case in cases:
        for k in range(count):
            ((row, trajectory),) = episodes(Setting(COPPELIA, case, COPPELIA, actuators, seed + k, 1))
            key = f"{len(rows):05d}"
            rows.append({"trajectory": key} | row | {"episode": k})
            trajectories[key] = trajectory
            click.echo(
                f"{case.policy}, seed {seed + k}: {(len(trajectory.times) - 1) * CONTROL_PERIOD:.2f} s", err=True
            )
    return rows, trajectories


@click.command("coppelia", cls=OneLineErrors)
@click.option("--scenario", default="figure_eight_lap", show_default=True, help="A path or goal scenario, or a file.")
@click.option("--policies", type=Names("--policies", _EVERY_POLICY), help="Only these.  [default: the task's contest]")
@click.option("--address", metavar="HOST:PORT", help="The simulator.  [default: $WAYFIELD_COPPELIA, localhost:23000]")
@click.option(
    "--actuators", type=Choice("--actuators", ACTUATORS), default="ideal", show_default=True, help="The actuator tier."
)
@click.option(
    "--steps", type=click.IntRange(1, 10**6), help="The clock, 0.05 s each.  [default: 1200, or as a file needs]"
)
@click.option("--episodes", "count", type=click.IntRange(min=1), default=1, show_default=True, help="Of each policy.")
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of the first episode.")
@click.option("--out", metavar="DIR", help="Folder of the results.  [default: results/coppelia-...]")
def main(
    scenario: str,
    policies: tuple[str, ...] | None,
    address: str | None,
    actuators: str,
    steps: int | None,
    count: int,
    seed: int,
    out: str | None,
) -> None:
    """Runs policies over a scenario in a running CoppeliaSim, prints the table and writes tables and figures."""
    try:
        cases = cases_of(scenario, policies, address, steps)
    except (ValueError, OSError) as error:
        raise click.UsageError(f"--scenario: {error}") from None
    differing = {"scenario": scenario, "policies": policies, "episodes": count if count > 1 else None, "seed": seed}
    folder = default_folder(COPPELIA, differing) if out is None else Path(out)
    stem = stem_of(cases[0].contest)
    command = readable(f"python -m wayfield.bridges.coppelia.evaluate {words_given()}")
    this = Run(COPPELIA, command, tuple(f"{stem}_*.{suffix}" for suffix in ("svg", "png")))
    with holding(folder, this), staging(folder, this) as stage:
        try:
            rows, trajectories = driven(cases, actuators, seed, count)
        except (ValueError, RuntimeError, ModuleNotFoundError) as error:
            raise click.ClickException(str(error)) from None
        write_rows(stage, rows)
        write_trajectories(stage, trajectories)
        written = read_rows(stage)
        shown = write_case_tables(stage, written, cases)
        with drawing(HERE, draw, wanted_figures(stage, written)):
            pass
    _print(shown)
    click.echo(f"Results are in {folder}{os.sep}")


if __name__ == "__main__":
    main()
