"""Finds gains on validation scenarios: python -m wayfield.benchmarks.tune POLICY --suite S --trials N

The score puts success first. Path following: the mean over the scenarios of ln(RMS error / 1 mm) + ln(time / time at
the cruising speed), where a run that fails counts as 1 m and four times the time; lower is better, and a policy that
halves its error by taking twice the time gains nothing. Goal reaching: the share of successes, and among equals the
mean SCT. The first trial is the default gains, so that tuned gains are never worse than those on the scenarios of the
search.
"""

import dataclasses
import json
import math
import os
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

import wayfield.policies
from wayfield.benchmarks.command_line import Choice, OneLineErrors
from wayfield.benchmarks.contests import CONTESTS, TRANSFER_SPLIT, Contest, families
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.results import number
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.benchmarks.workers import Map, workers
from wayfield.envs.scenarios import splits
from wayfield.policies.agent import write_whole


@dataclasses.dataclass(frozen=True)
class Range:
    """Where a gain is searched."""

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
}

FAILED_RMS = 1.0  # m
FAILED_TIME = 4.0  # times the time at the cruising speed
CRUISE = 0.6  # m/s


def path_score(rows: Sequence[Mapping[str, str]], lengths: Sequence[float]) -> float:
    """Returns the score of path following, lower is better; lengths (m) are those of the paths."""
    terms = []
    for row, length in zip(rows, lengths, strict=True):
        won = number(dict(row), "success") == 1.0
        rms = max(number(dict(row), "cross_track_rms"), 1e-3) if won else FAILED_RMS
        slowness = number(dict(row), "time") * CRUISE / length if won else FAILED_TIME
        terms.append(math.log(rms / 1e-3) + math.log(max(slowness, 1e-3)))
    return statistics.fmean(terms)


def goal_score(rows: Sequence[Mapping[str, str]]) -> float:
    """Returns the score of goal reaching, lower is better: minus successes, and minus a mean SCT that is below one."""
    successes = sum(number(dict(row), "success") for row in rows)
    return -(successes + statistics.fmean(number(dict(row), "sct") for row in rows)) / len(rows)


def score(contest: Contest, settings: Sequence[Setting], share: Map) -> float:
    """Returns the score of the policy that the settings hold."""
    played = list(share(_rows, settings))
    rows = [row for part in played for row in part]
    if contest.cost == "time":
        return goal_score(rows)
    lengths = [length for setting in settings for length in _lengths(setting)]
    return path_score(rows, lengths)


def _rows(setting: Setting) -> list[dict[str, str]]:
    return [row for row, _ in episodes(setting)]


def _lengths(setting: Setting) -> list[float]:
    """Returns the lengths (m) that the setting's scenarios ask to drive."""
    scenarios = splits.split("path_following", *setting.case.scenario.split("/"))[: setting.episodes]
    return [max(each.laps, 1) * each.path.length for each in scenarios]


def settings_of(
    contest: Contest, robot: str, actuators: str, policy: str, gains: Mapping[str, Any], most: int
) -> list[Setting]:
    """Returns a setting for each family of the validation split."""
    found = []
    for family in families(contest, "kinematic"):
        (case,) = contest.cases(robot, family, TRANSFER_SPLIT, (policy,), ("default",))
        count = min(most, len(splits.split(contest.task, family, TRANSFER_SPLIT)))
        found.append(Setting("tune", dataclasses.replace(case, gains=dict(gains)), "kinematic", actuators, 0, count))
    return found


def folder_of(suite: str) -> Path:
    """Returns where the gains of a suite ship."""
    return Path(wayfield.policies.__path__[0]) / "gains" / suite


def write_gains(file: Path, content: Mapping[str, Any]) -> None:
    """Writes a gains file, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, (json.dumps(content, indent=2) + "\n").encode())


@click.command("tune", cls=OneLineErrors)
@click.argument("policy", type=Choice("POLICY", SEARCHED))
@click.option("--suite", type=Choice("--suite", CONTESTS), required=True, help="The contest to tune for.")
@click.option("--trials", type=click.IntRange(min=1), default=40, show_default=True, help="Sets of gains to try.")
@click.option("--scenarios", type=click.IntRange(min=1), default=10, show_default=True, help="Of each family.")
@click.option("--robot", type=click.Choice(["p3dx", "omni3", "omni4"]), default="p3dx", show_default=True)
@click.option("--actuators", type=Choice("--actuators", ("ideal", "lagged", "slow")), default="lagged")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the search.")
@click.option("--out", type=click.Path(path_type=Path), help="The gains file.  [default: where they ship]")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
def main(
    policy: str,
    suite: str,
    trials: int,
    scenarios: int,
    robot: str,
    actuators: str,
    seed: int,
    out: Path | None,
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
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    defaults: Any = wayfield.policies.make(policy)
    ranges = SEARCHED[policy]
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    study.enqueue_trial({name: float(getattr(defaults, name)) for name in ranges})
    with workers(count or min(os.cpu_count() or 1, 4)) as share:
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
            study.tell(trial, score(contest, parts, share))
    best = {name: rounded(value) for name, value in study.best_params.items()}
    content = {
        "policy": policy,
        "suite": suite,
        "gains": best,
        "score": round(study.best_value, 6),
        "score_of_defaults": round(float(study.trials[0].value or 0.0), 6),
        "split": TRANSFER_SPLIT,
        "trials": trials,
        "scenarios": scenarios * len(families(contest, "kinematic")),
        "robot": robot,
        "actuators": actuators,
        "seed": seed,
        "command": f"python -m wayfield.benchmarks.tune {policy} --suite {suite} --trials {trials} "
        f"--scenarios {scenarios} --robot {robot} --actuators {actuators} --seed {seed}",
    }
    file = out or folder_of(suite) / f"{policy}.json"
    try:
        write_gains(file, content)
    except OSError as error:
        raise click.ClickException(f"--out {str(file)!r} cannot be written: {error}") from None
    click.echo(f"{policy}: {content['score_of_defaults']:.4f} by default, {content['score']:.4f} with {best}")
    click.echo(f"Written to {file}")


def rounded(value: float) -> float:
    """Returns the value with three digits: more would claim a precision that the search does not have."""
    return float(f"{value:.3g}")


if __name__ == "__main__":
    main()
