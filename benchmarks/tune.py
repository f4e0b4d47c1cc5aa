"""Finds gains on validation scenarios: python -m wayfield.benchmarks.tune POLICY --suite S --trials N

The score is the contest's (see `contests`), and puts success first: of path following the logarithm of the error plus
that of the time, of goal reaching the successes and then the mean SCT. The first trial is the default gains, so that
tuned gains are never worse than those on the scenarios of the search.
"""

import dataclasses
import errno
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

import wayfield.policies
from wayfield.benchmarks.contests import CONTESTS, TRANSFER_SPLIT, Contest, Course, Entrants
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.benchmarks.workers import Map, workers
from wayfield.envs.command_line import SEED, Choice, OneLineErrors
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import splits
from wayfield.envs.storage import write_whole


@dataclasses.dataclass(frozen=True)
class Range:
    """Where a gain is searched. A policy may say so itself, in `searched`: the low and the high end by gain."""

    low: float
    high: float
    log: bool = True  # whether evenly in its logarithm


# The cruising speed is no gain to search: the comparison is made at matched speed.
SEARCHED: Mapping[str, Mapping[str, Range]] = {
    "lookahead_retuned": {"lookahead_distance": Range(0.15, 0.8), "k_ang": Range(1.0, 12.0)},
    "pure_pursuit": {"lookahead_distance": Range(0.15, 1.0)},
    "regulated_pure_pursuit": {
        "min_lookahead": Range(0.15, 0.5),
        "max_lookahead": Range(0.25, 0.8),
        "min_radius": Range(0.1, 1.0),
        "deceleration": Range(0.3, 1.0),
    },
    "smooth_pose": {
        "k1": Range(0.3, 3.0),
        "k2": Range(1.0, 10.0),
        "beta": Range(0.01, 1.0),
        "lookahead_distance": Range(0.25, 1.0),
    },
    "stanley": {"k": Range(0.5, 5.0), "axle_distance": Range(0.05, 0.4), "share": Range(0.2, 1.0)},
    "lqr": {
        "q_e": Range(5.0, 400.0),
        "q_th": Range(0.5, 40.0),
        "rounding": Range(0.03, 0.3),
        "lateral_acceleration": Range(0.3, 2.0),
        "share": Range(0.4, 1.0, log=False),
    },
    "mpc": {"position": Range(100.0, 10_000.0), "heading": Range(0.2, 20.0), "turn_radius": Range(0.05, 0.5)},
    "apf_corrected": {
        "k": Range(0.3, 2.0),
        "eta": Range(0.003, 0.1),
        "rho_0": Range(0.2, 1.0),
        "max_speed": Range(0.3, 0.6),
    },
    "vfh_plus": {
        "safety": Range(0.01, 0.15),
        "low": Range(0.1, 0.6),
        "slowing": Range(0.1, 1.0),
        "mu_previous": Range(0.5, 5.0),
    },
    "dwa": {
        "heading": Range(0.1, 2.0),
        "clearance": Range(0.05, 1.0),
        "velocity": Range(0.05, 1.0),
        "progress": Range(0.2, 4.0),
        "room": Range(0.3, 3.0),
    },
    "mppi": {
        "temperature": Range(0.01, 0.3),
        "yaw_noise": Range(0.3, 1.5),
        "influence": Range(0.1, 0.6),
        "obstacle_weight": Range(0.2, 5.0),
    },
    "orca": {"horizon": Range(0.5, 4.0), "wall_horizon": Range(0.1, 2.0), "margin": Range(0.01, 0.1)},
    "scan_planner": {
        "margin": Range(0.005, 0.06),
        "wanted_clearance": Range(0.05, 0.4),
        "weight": Range(0.5, 10.0),
        "foresight": Range(0.5, 3.0),
    },
    "astar_tracker": {"margin": Range(0.03, 0.2), "wanted_clearance": Range(0.05, 0.5)},
    "smooth_pose_backward": {"k1": Range(0.3, 3.0), "k2": Range(1.0, 10.0), "beta": Range(0.01, 1.0)},
    **{
        name: {gain: Range(*ends) for gain, ends in policy.searched.items()}
        for name, policy in wayfield.policies.POLICIES.items()
        if hasattr(policy, "searched")
    },
}


def score(contest: Contest, settings: Sequence[Setting], in_parallel: Map) -> float:
    """Returns the contest's score of the policy that the settings hold, lower is better."""
    rows = [row for part in in_parallel(_rows, settings) for row in part]
    scenarios = [
        scenario
        for setting in settings
        for scenario in splits.split(contest.spec.name, setting.case.experiment, setting.case.split)[: setting.episodes]
    ]
    return contest.score(rows, scenarios)


def _rows(setting: Setting) -> list[dict[str, str]]:
    return [row for row, _ in episodes(setting)]


def settings_of(
    contest: Contest, robot: str, actuators: str, policy: str, gains: Mapping[str, Any], most: int
) -> list[Setting]:
    """Returns a setting for each family of the validation split."""
    found = []
    for family in contest.families("kinematic"):
        course, entrants = Course(family, TRANSFER_SPLIT), Entrants((policy,), ("default",))
        (case,) = contest.cases(robot, course, entrants)
        count = min(most, len(splits.split(contest.spec.name, family, TRANSFER_SPLIT)))
        found.append(Setting("tune", dataclasses.replace(case, gains=dict(gains)), "kinematic", actuators, 0, count))
    return found


def folder_of(suite: str) -> Path:
    """Returns where the gains of a suite ship."""
    return Path(wayfield.policies.__file__).resolve().parent / "gains" / suite  # where links of an install lead


def write_gains(file: Path, content: Mapping[str, Any]) -> None:
    """Writes a gains file, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, (json.dumps(content, indent=2) + "\n").encode())


@click.command("tune", cls=OneLineErrors)
@click.argument("policy", type=Choice("POLICY", SEARCHED))
@click.option("--suite", type=Choice("--suite", CONTESTS), required=True, help="The contest to tune for.")
@click.option("--trials", type=click.IntRange(min=1), default=40, show_default=True, help="Sets of gains to try.")
@click.option("--scenarios", type=click.IntRange(min=1), default=10, show_default=True, help="Of each family.")
@click.option("--robot", type=Choice("--robot", ROBOTS), default="p3dx", show_default=True)
@click.option("--actuators", type=Choice("--actuators", ("ideal", "lagged", "slow")), default="lagged")
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of the search.")
@click.option("--out", metavar="FILE", help="The gains file.  [default: results/gains/SUITE/POLICY_ROBOT.json]")
@click.option("--ship", is_flag=True, help="Write them where the package keeps its gains.")
@click.option("--force", is_flag=True, help="Replace the file if there is one.")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
def main(
    policy: str,
    suite: str,
    trials: int,
    scenarios: int,
    robot: str,
    actuators: str,
    seed: int,
    out: str | None,
    ship: bool,
    force: bool,
    count: int | None,
) -> None:
    """Searches the gains of POLICY on the validation split of a suite and writes them with their budget.

    Training and test scenarios are never touched.
    """
    try:
        import optuna
    except ImportError:
        raise click.ClickException('optuna is missing: pip install "wayfield[tune]"') from None
    contest = CONTESTS[suite]
    if policy not in contest.policies:
        raise click.UsageError(f"POLICY {policy!r} takes no part in suite {suite!r}")
    if out is not None and (ship or not out.strip()):
        raise click.UsageError("--out is empty; it must name a file" if not ship else "--ship takes the place of --out")
    shipped = folder_of(suite) / f"{policy}.json"
    file = shipped if ship else Path(out or f"results/gains/{suite}/{policy}_{robot}.json")
    _check_file(file, force)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    defaults: Any = wayfield.policies.make(policy)
    ranges = SEARCHED[policy]
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    study.enqueue_trial({name: float(getattr(defaults, name)) for name in ranges})
    with workers(count or min(os.cpu_count() or 1, 4)) as in_parallel:
        for _ in tracked(range(trials), trials, "trials"):
            trial = study.ask()
            gains = {
                name: rounded(trial.suggest_float(name, each.low, each.high, log=each.log))
                for name, each in ranges.items()
            }
            try:
                wayfield.policies.make(policy, **gains)
            except ValueError:  # two gains that do not go together
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
                continue
            parts = settings_of(contest, robot, actuators, policy, gains, scenarios)
            study.tell(trial, score(contest, parts, in_parallel))
    best = {name: rounded(value) for name, value in study.best_params.items()}
    content = {
        "policy": policy,
        "suite": suite,
        "gains": best,
        "score": round(study.best_value, 6),
        "score_of_defaults": round(float(study.trials[0].value or 0.0), 6),
        "split": TRANSFER_SPLIT,
        "trials": trials,
        "scenarios": scenarios * len(contest.families("kinematic")),
        "robot": robot,
        "actuators": actuators,
        "seed": seed,
        "command": f"python -m wayfield.benchmarks.tune {policy} --suite {suite} --trials {trials} "
        f"--scenarios {scenarios} --robot {robot} --actuators {actuators} --seed {seed}",
    }
    # before they are written: a disk that is full then takes nothing away
    print(f"{policy}: {content['score_of_defaults']:.4f} by default, {content['score']:.4f} with {best}", flush=True)
    _check_file(file, force)
    write_gains(file, content)
    print(f"Written to {file}")


def _check_file(file: Path, force: bool) -> None:
    """Refuses a file that is there, unless it may be replaced, or that cannot be written."""
    if os.path.lexists(file) and not force:
        raise click.UsageError(f"{file} is there already; --force replaces it, --out writes elsewhere")
    above = next(folder for folder in file.absolute().parents if folder.exists())
    try:
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        with tempfile.TemporaryFile(dir=above):  # the rights alone do not tell: root has all of them, in /proc too
            pass
    except OSError as error:
        raise click.ClickException(f"--out {str(file)!r} cannot be written: {error.strerror}") from None


def rounded(value: float) -> float:
    """Returns the value with three digits: more would claim a precision that the search does not have."""
    return float(f"{value:.3g}")


if __name__ == "__main__":
    main()
