"""Learners beside each other that differ in one thing each: python benchmarks/studies/learners.py

PPO that begins with nothing, PPO that begins as a copy of a controller, PPO that adds to that controller, and SAC of
stable-baselines3 that begins with nothing: the same worlds, inputs, actions, reward, network and frames, of PPO the
same numbers too. Seeds that a folder of training runs lacks are trained first. Validation chooses a run's checkpoint;
what stands in the table was driven on the test split, beside the controller itself.
"""

import contextlib
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
import rich.console
from kept_rows import DIGITS

from wayfield.benchmarks.contests import CONTESTS, COST, Column, Course, Entrants
from wayfield.benchmarks.leaderboards.entries import OFF_PACE, by_scenario, cell, costs, off_pace, success_cell
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.progress import tracked
from wayfield.benchmarks.records.results import TABLE, write_rows
from wayfield.benchmarks.records.run_folder import Run, held, staging
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.runs.shards import described, in_frames
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.paired import difference
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import SPLITS
from wayfield.policies.learned.agent import CARD, read_card
from wayfield.policies.trained.ppo import trained
from wayfield.system.command_line import OneLineErrors
from wayfield.system.executors import cores, workers
from wayfield.system.extras import installs

SUITE = "learners"
LEARNERS = "learners.csv"
CONTEST = CONTESTS["path-following"]
ROBOT = ROBOTS["p3dx"]
# presets, in the order of the table
PRESETS = ("path_following_plain", "path_following", "path_following_residual", "path_following_sac")
CONTROLLER = "regulated_pure_pursuit"  # that two of them begin with
SEEDS = 3
CHOOSES, REPORTS = "validation", "test"  # splits
_IN_FILES = ("is told", "frames", "CPU (s)", "wall (s)")  # alone
_METRICS = ("success", "mean_speed", "cross_track_rms")
_COLUMNS = (
    Column("RMS error (m)", COST, 4, reduction="mean", with_interval=True),
    Column("typical (m)", COST, 4, with_interval=True),
    Column("mean speed (m/s)", "mean_speed", 3, successes_only=True, reduction="mean"),
    Column("yaw change (rad/s)", "yaw_change", 3, reduction="mean"),
)


def yaw_change(trajectory: Trajectory) -> float:
    """Returns the mean |w' - w| of the base's yaw rate from one control period to the next, rad/s."""
    return float(np.abs(np.diff(trajectory.twists[:, 2])).mean())


@dataclasses.dataclass(frozen=True)
class Learned:
    """A training run that has ended, or the controller: what the table tells of it besides its drives."""

    learner: str
    begins: str  # with what
    seed: str  # "" of the controller
    frames: str  # control periods of the run
    seconds: str  # of the run
    cpu_seconds: str
    home: str = ""  # folder of its preset's runs


def learned(home: Path, seed: int) -> Learned:
    """Returns what the card of a seed's best agent tells of the run that it comes from.

    Raises:
        ValueError: if there is none, or its card is damaged; the message names the folder or the file.
    """
    folders = trained(str(home))
    if seed not in folders:
        raise ValueError(f"{home} holds no agent of seed {seed}")
    card = read_card(folders[seed] / CARD)
    training = card["training"]
    base, taught_by = card.get("base"), training.get("taught_by")
    begins = f"adds to {base['controller']}" if base else f"a copy of {taught_by}" if taught_by else "nothing"
    begins = training.get("began_as", begins)
    frames, seconds, cpu = (str(training.get(name, "")) for name in ("run_frames", "run_seconds", "run_cpu_seconds"))
    algorithm = str(training.get("algorithm", "ppo")).upper()
    return Learned(algorithm, begins, str(seed), frames, seconds, cpu, str(home))


def driven(asked: tuple[Learned, str, str]) -> list[Row]:
    """Returns a row for each scenario of a family of a split, driven by a learner's agent or the controller."""
    who, family, split = asked
    members = tuple(range(SPLITS[split]))
    course = Course(family, split, members=members)
    entrants = Entrants((), homes=(who.home,)) if who.home else Entrants((CONTROLLER,), ("tuned",))
    cases = CONTEST.cases(ROBOT, course, entrants)
    case = next(each for each in cases if not who.home or each.gains["seed"] == int(who.seed))
    setting = Setting(SUITE, case, "kinematic", "lagged", 0, len(members), members=members)
    told = described(CONTEST, case)
    whose = {
        "learner": who.learner if who.home else CONTROLLER,
        "begins": who.begins,
        "agent_seed": who.seed,
        "learned_from": in_frames(int(who.frames)) if who.home else told["learned_from"],
        "knows": told["knows"],
        **{name: getattr(who, name) for name in ("frames", "seconds", "cpu_seconds")},
    }
    rows: list[Row] = []
    for row, trajectory in episodes(setting):
        kept = {
            name: row[name] for name in ("scenario", "episode", "policy", "success", "mean_speed", "cross_track_rms")
        }
        limits = {"failure_cost": str(CONTEST.failure_cost(case.max_episode_steps)), "split": split, "family": family}
        rows.append({**whose, **limits, **kept, "yaw_change": f"{yaw_change(trajectory):.{DIGITS}g}"})
    return rows


def learners_table(rows: Sequence[Row], command: str) -> Table:
    """Returns the learners beside each other, from the rows of all."""
    sets = Episodes.of(rows).groups("learner", "begins")
    tested = {name: mine.where(split=REPORTS) for name, mine in sets.items()}
    ruler = next((mine for mine in tested.values() if not mine[0]["agent_seed"]), None)
    header = ["learner", "begins with", "is told", "seeds", "frames", "reach the bar", "success (%)"]
    header += [column.header for column in _COLUMNS] + ["above the law's (m)", "CPU (s)", "wall (s)"]
    lines = []
    for name, mine in tested.items():
        first, seeds = mine[0], sets[name].groups("agent_seed")
        cells = {column.header: cell(column, mine, CONTEST) for column in _COLUMNS}
        if off_pace(mine, CONTEST.pace):
            cells["mean speed (m/s)"] += f" {OFF_PACE}"
        is_law = not first["agent_seed"]
        reached = sum(_reached(of_seed) for of_seed in seeds.values())
        lines.append(
            [
                *(first["learner"], first["begins"].replace(CONTROLLER, "the law")),
                *(first["knows"], "" if is_law else str(len(seeds))),
                *(first["learned_from"], "" if is_law else f"{reached} of {len(seeds)}", success_cell(mine)),
                *cells.values(),
                "" if is_law or ruler is None else _less(mine, ruler),
                *(_spread(list(seeds.values()), each) for each in ("cpu_seconds", "seconds")),
            ]
        )
    bar = CONTEST.bar
    assert bar is not None
    note = (
        f"P3DX, actuators 'lagged', asked for {CONTEST.pace:g} m/s, all families of the {REPORTS} split, every seed in "
        "every scenario; a failure counts as an RMS error of 1 m. The law is the controller of the first line. All "
        "four learners have the same worlds, inputs, actions, reward, network and frames, and those of PPO the same "
        "step sizes and noise too; SAC has the numbers of stable-baselines3 but for those that its preset names. They "
        f"differ in where they begin and in the algorithm. The {CHOOSES} split chose each checkpoint. The bar is "
        f"{bar.words}. Brackets are 95 % intervals; 'typical' is the interquartile mean, 'above the law's' that of the "
        f"paired differences of RMS errors; 'yaw change' is the mean step of the base's yaw rate. {OFF_PACE}: not at "
        "the speed that was asked for. CPU and wall time are a seed's, the mean and in brackets the least and the "
        "greatest, validations included; of wall time much is the machine's other work. The law's frames are those of "
        f"the search for its gains. Made by `{command}`."
    )
    return Table("Learners beside each other", header, lines, note)


def _reached(rows: Episodes) -> bool:
    """Returns whether a seed reaches the contest's bar on the split that chooses."""
    assert CONTEST.bar is not None
    chosen = rows.where(split=CHOOSES)
    return bool(chosen and CONTEST.bar.reached(chosen))


def _less(mine: Episodes, ruler: Episodes) -> str:
    """Returns by how much less a learner errs than the controller, negative where it does, with its interval."""
    a, strata = by_scenario(mine, costs(mine, CONTEST))
    b, _ = by_scenario(ruler, costs(ruler, CONTEST))
    found = difference(a, b, strata, "iqm")
    ends = "" if math.isnan(found.low) else f" [{found.low:+.4f}, {found.high:+.4f}]"
    return f"{found.value:+.4f}{ends}"


def _spread(seeds: Sequence[Episodes], name: str) -> str:
    """Returns the mean of a number that each seed has, and the least and the greatest; "" where none has it."""
    numbers = [float(rows.numbers(name)[0]) for rows in seeds]
    if any(map(math.isnan, numbers)):
        return ""
    return f"{sum(numbers) / len(numbers):.0f} [{min(numbers):.0f} to {max(numbers):.0f}]"


def train_missing(home: Path, seeds: Sequence[int], steps: int | None, at_once: int) -> None:
    """Trains what a folder of training runs lacks; runs that were begun go on, those that have ended stay.

    Raises:
        ValueError: if a folder holds another run; the message names it.
        RuntimeError: if a run failed, or was stopped.
    """
    # only who trains needs what training needs
    from wayfield.policies.training.presets import PRESETS as KNOWN
    from wayfield.policies.training.presets import overridden
    from wayfield.policies.training.run import Job, Report, check_folder
    from wayfield.policies.training.seeds import train_all

    settings = () if steps is None else (f"steps={steps}",)
    jobs = []
    for seed in seeds:
        for name in PRESETS:
            preset = overridden(KNOWN[name], settings)
            folder, env_id = home / name / f"seed_{seed}", preset.env_ids[0]
            command = " ".join(["python train.py", env_id, "--preset", name, "--seed", str(seed)])
            job = Job(env_id, preset, settings, seed, folder, command=command)
            begun = (folder / "run.json").exists()
            job = dataclasses.replace(job, resume=begun)
            check_folder(job)
            if not begun or _frames(home / name, seed) < preset.steps:
                jobs.append(job)

    def show(report: Report) -> None:
        if report.row is not None:
            click.echo(f"seed {report.seed}: {report.frames:,} of {report.of:,} frames", err=True)

    for job, last in zip(jobs, train_all(jobs, at_once, show) if jobs else [], strict=True):
        if not last.done:
            raise RuntimeError(f"{job.folder}: {last.error or 'stopped; given again, the command goes on'}")


def _frames(home: Path, seed: int) -> int:
    """Returns how many frames the run of a seed had when its agent was last written; 0 where there is none."""
    folders = trained(str(home))
    return int(read_card(folders[seed] / CARD)["training"].get("run_frames", 0)) if seed in folders else 0


@click.command("learners", cls=OneLineErrors)
@click.option("--seeds", type=click.IntRange(2, 100), default=SEEDS, show_default=True, help="Of each learner.")
@click.option("--steps", type=click.IntRange(min=1), help="Frames of a run, in place of the presets'.")
@click.option(
    "--agents",
    "home",
    type=click.Path(path_type=Path, file_okay=False),
    default="results/training",
    show_default=True,
    help="The folder of training runs, as train.py's; what it lacks is trained.",
)
@click.option("--out", metavar="DIR", help="Also write the table there, and the episodes.")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
def main(seeds: int, steps: int | None, home: Path, out: str | None, count: int | None) -> None:
    """Trains PPO that begins with nothing, with a copy of a controller and on top of it, and SAC; compares them."""
    count = count or cores()
    words = ["--seeds", str(seeds)] * (seeds != SEEDS) + ([] if steps is None else ["--steps", str(steps)])
    command = " ".join(["python benchmarks/studies/learners.py", *words])
    run = Run(SUITE, command, (LEARNERS,))
    with contextlib.ExitStack() as held_open:
        try:
            if out is not None:
                held_open.enter_context(held(Path(out), run))
            train_missing(home, range(seeds), steps, count)
            entrants = [Learned("", "", "", "", "", "")]
            entrants += [learned(home / name, seed) for name in PRESETS for seed in range(seeds)]
            in_parallel = held_open.enter_context(workers(count))
            families = CONTEST.families("kinematic")
            wanted = [(who, each, split) for who in entrants for split in (CHOOSES, REPORTS) for each in families]
            rows = [row for part in tracked(in_parallel(driven, wanted), len(wanted), "parts") for row in part]
            table = learners_table(rows, command)
            if out is not None:
                with staging(Path(out), run) as stage:
                    write_rows(stage, rows)
                    (stage / LEARNERS).write_text(table.csv(), encoding="utf-8")
                    (stage / TABLE).write_text(table.markdown(), encoding="utf-8")
        except ModuleNotFoundError as error:
            raise click.ClickException(f"{error.name} is missing; {installs('train')}") from None
        except (OSError, RuntimeError, ValueError, FloatingPointError) as error:
            raise click.ClickException(str(error)) from None
    # what a terminal has no room for stands in the files
    shown = [k for k, name in enumerate(table.header) if name not in _IN_FILES]
    lines = [[line[k] for k in shown] for line in table.rows]
    narrow = dataclasses.replace(table, header=[table.header[k] for k in shown], rows=lines)
    rich.console.Console(width=100).print(narrow.terminal(stacked=True, cell_width=18))
    print(table.note)


if __name__ == "__main__":
    main()
