"""Finds gains for a condition: python -m wayfield.benchmarks.tune POLICY --suite S --robot R --speed V --level L

The search drives training scenarios; its best sets and the policy's own gains then drive the validation split, and the
best there is written. So a set that ships is never worse than the default gains on scenarios that the search has not
seen, and where nothing found was better the default gains are written, and called so.

Best is what the contest says (`Score` of `contests`): the fewest failures; of those, for a path follower, a mean speed
within 3 % of the asked one, or where none has that no lower one than with the default gains; of those the least error
(times the time, where the speed is not held), or the highest SCT. The cruising speed is searched along with the
other gains, since a law that slows down in bends holds the asked mean only by driving faster elsewhere. The budget is
counted in frames, the control periods of robots, as that of training is.
"""

import dataclasses
import errno
import json
import os
import shlex
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

import wayfield.policies
from wayfield.benchmarks.contests import CONTESTS, TRANSFER_SPLIT, Contest, Course, Entrants, Score
from wayfield.benchmarks.parcels import in_order
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.envs.command_line import SEED, Choice, Finite, OneLineErrors, RobotChoice, on_cluster, shared_out
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.engines import Engine, cores
from wayfield.envs.identity import source_digest
from wayfield.envs.robots import Robot, shipped_name
from wayfield.envs.scenarios import splits
from wayfield.envs.storage import write_whole
from wayfield.policies.tuned import PACE, condition

SEARCH_SPLIT = "train"
FINALISTS = 2  # sets of a search that drive the validation split, beside the default gains
MOST_AT_ONCE = 64  # robots in a batch
PACE_FACTORS = (0.97, 1.35)  # of the asked speed, between which a path follower's cruising speed is searched


@dataclasses.dataclass(frozen=True)
class Range:
    """Where a gain is searched. A policy may say so itself, in `searched`: the low and the high end by gain."""

    low: float
    high: float
    log: bool = True  # whether evenly in its logarithm


# Beside the cruising speed, which all path followers have.
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
        "patience": Range(2.0, 30.0),
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
    "orca": {
        "horizon": Range(0.5, 4.0),
        "wall_horizon": Range(0.1, 2.0),
        "margin": Range(0.01, 0.1),
        "tracking_error": Range(0.01, 0.1),
    },
    "scan_planner": {
        "margin": Range(0.005, 0.06),
        "wanted_clearance": Range(0.05, 0.4),
        "weight": Range(0.5, 10.0),
        "foresight": Range(0.5, 3.0),
    },
    "astar_tracker": {"margin": Range(0.03, 0.2), "wanted_clearance": Range(0.05, 0.5)},
    "smooth_pose_backward": {
        "k1": Range(0.3, 3.0),
        "k2": Range(1.0, 10.0),
        "beta": Range(0.01, 1.0),
        "speed": Range(0.2, 0.6),
        "deceleration": Range(0.2, 0.8),
        "arrival_radius": Range(0.01, 0.05),
    },
    **{
        name: {gain: Range(low, high, log=low > 0.0) for gain, (low, high) in policy.searched.items()}
        for name, policy in wayfield.policies.POLICIES.items()
        if hasattr(policy, "searched")
    },
}


def searched(policy: str, suite: str) -> Mapping[str, Range]:
    """Returns the gains of a policy that are searched for the contest of a suite, and where."""
    return SEARCHED[CONTESTS[suite].searched_as.get(policy, policy)]


@dataclasses.dataclass(frozen=True)
class Search:
    """What gains are searched for, and how long."""

    policy: str
    contest: Contest
    robot: Robot
    speed: float  # m/s, asked for
    level: str  # of disturbance
    actuators: str
    frames: int  # after which no further set is tried
    trials: int  # sets, at most
    scenarios: int  # of each family
    seed: int
    started_from: tuple[Mapping[str, float], ...] = ()  # sets that are tried first, after the default gains
    study: str = ""  # where others search along: a journal file, or the URL of a database; "": this process alone

    @property
    def paced(self) -> bool:
        """Returns whether the mean speed is to be held, and so the cruising speed is searched."""
        return bool(self.contest.speeds)

    @property
    def ranges(self) -> Mapping[str, Range]:
        """Returns the gains that are searched, and where."""
        return searched(self.policy, self.contest.name)

    def gains_at(self, gains: Mapping[str, float], factor: float = 1.0) -> dict[str, Any]:
        """Returns gains, those of a path follower with the cruising speed that is `factor` times the asked one."""
        if not self.paced:
            return dict(gains)
        speed = rounded(factor * self.speed)
        return {**gains, **{k: rounded(v) for k, v in wayfield.policies.cruising(self.policy, gains, speed).items()}}

    def run(self, engine: Engine) -> dict[str, Any]:
        """Returns the content of a gains file."""
        found, frames = self._searched(engine)
        default = self.gains_at({})
        best, best_score, validated = default, self.score(default, TRANSFER_SPLIT, engine), []
        default_score = best_score
        for gains in found:
            score = self.score(gains, TRANSFER_SPLIT, engine, default_score.mean_speed)
            validated.append(score)
            if score < best_score:
                best, best_score = gains, score
        frames += default_score.frames + sum(score.frames for score in validated)
        shipped = self.robot.name if isinstance(shipped_name(self.robot), str) else f"{self.robot.name}.json"
        return {
            "policy": self.policy,
            "suite": self.contest.name,
            "robot": self.robot.name,
            "sheet": self.robot.digest,
            "speed": self.speed,
            "level": self.level,
            "actuators": self.actuators,
            "chosen": "default" if best is default else "search",
            "gains": best,
            "frames": frames,
            "validation": {"chosen": _shown(best_score), "default": _shown(default_score)},
            "started_from": [dict(each) for each in self.started_from],
            "searched_on": {
                "split": SEARCH_SPLIT,
                "scenarios": self.scenarios,
                "sha256": self._digest(SEARCH_SPLIT),
                "validation_sha256": self._digest(TRANSFER_SPLIT),
            },
            "seed": self.seed,
            "command": f"python -m wayfield.benchmarks.tune {self.policy} --suite {self.contest.name} --robot "
            f"{shipped} --speed {self.speed:g} --level {self.level} --actuators {self.actuators} --frames "
            f"{self.frames} --trials {self.trials} --scenarios {self.scenarios} --seed {self.seed}"
            + "".join(f" --from '{json.dumps(dict(each))}'" for each in self.started_from)
            + (f" --study {shlex.quote(self.study)}" if self.study else ""),
        }

    def _searched(self, engine: Engine) -> tuple[list[dict[str, Any]], int]:
        """Returns the best sets of the search, and the frames that were driven for it."""
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        defaults: Any = wayfield.policies.make(self.policy)
        ranges = self.ranges
        fastest = max(min(PACE_FACTORS[1], float(self.robot.max_twist[0]) / self.speed), 1.0)
        start = {name: float(getattr(defaults, name)) for name in ranges}
        starts = [start | ({"pace": 1.0} if self.paced else {})]
        starts += [start | known for known in self._known(ranges, fastest)]
        if self.study:
            return self._searched_together(engine, starts, fastest)
        study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=self.seed))
        for known in starts:
            study.enqueue_trial(known)
        scored: list[tuple[Score, dict[str, Any]]] = []
        frames = 0
        begun = 0  # those that wait, as starts do, are among the study's trials already
        while frames < self.frames and begun < self.trials:
            trial = study.ask()
            begun += 1
            gains = self._drawn(trial, fastest)
            if gains is None:
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
                continue
            # the first are the default gains: no set shall be slower that cannot hold the asked speed either
            least = scored[0][0].mean_speed if scored else 0.0
            score = self.score(gains, SEARCH_SPLIT, engine, least)
            frames += score.frames
            scored.append((score, gains))
            study.tell(trial, score.value)
        scored.sort(key=lambda each: each[0])
        return [gains for _, gains in scored[:FINALISTS]], frames

    def _searched_together(
        self, engine: Engine, starts: Sequence[Mapping[str, float]], fastest: float
    ) -> tuple[list[dict[str, Any]], int]:
        """Returns what `_searched` does, of a study that others search along; the budget is that of all.

        Raises:
            NoStudy: if it cannot be opened.
            StillSearched: if others are driving sets of it.
        """
        import optuna

        from wayfield.benchmarks.shared_study import SharedStudy

        shared = SharedStudy(self.study, self._study_name, starts)
        failed = optuna.trial.TrialState.FAIL
        least: float | None = None
        while shared.frames < self.frames and shared.begun < self.trials:
            trial = shared.study.ask()
            gains = self._drawn(trial, fastest) if trial.number < self.trials else None
            if gains is None:
                shared.study.tell(trial, state=failed)
                continue
            if least is None:  # as with one process, but that the default gains may be under way elsewhere
                default = self.gains_at({name: starts[0][name] for name in self.ranges}, 1.0)
                least = 0.0 if trial.number == 0 else self.score(default, SEARCH_SPLIT, engine).mean_speed
            score = self.score(gains, SEARCH_SPLIT, engine, 0.0 if trial.number == 0 else least)
            least = score.mean_speed if trial.number == 0 else least
            shared.tell(trial, score, gains)
        if count := shared.others():
            raise StillSearched(
                f"the budget is used up, and other processes are driving {count} more: the one that ends last writes "
                "the gains, and so does this command again"
            )
        scored = sorted(shared.scored(), key=lambda each: each[0])
        return [gains for _, gains in scored[:FINALISTS]], shared.frames

    @property
    def _study_name(self) -> str:
        """Returns what tells the search from others in the same place: all but its budget and its seed."""
        what = (self.policy, self.contest.name, self.robot.digest, f"{self.speed:g}", self.level, self.actuators)
        return " ".join((*what, str(self.scenarios), self._digest(SEARCH_SPLIT)[:12], source_digest()[:12]))

    def _drawn(self, trial: Any, fastest: float) -> dict[str, Any] | None:
        """Returns the gains of a trial; None where two of them do not go together."""
        factor = trial.suggest_float("pace", PACE_FACTORS[0], fastest) if self.paced else 1.0
        ranges = self.ranges
        drawn = {k: rounded(trial.suggest_float(k, each.low, each.high, log=each.log)) for k, each in ranges.items()}
        try:
            gains = self.gains_at(drawn, factor)
            wayfield.policies.make(self.policy, **gains)
        except ValueError:
            return None
        return gains

    def _known(self, ranges: Mapping[str, Range], fastest: float) -> list[dict[str, float]]:
        """Returns what the search starts from within its ranges: gains, and their pace."""
        found = []
        for gains in self.started_from:
            known = {k: min(max(float(gains[k]), each.low), each.high) for k, each in ranges.items() if k in gains}
            if self.paced:
                known["pace"] = min(max(float(gains.get("pace", 1.0)), PACE_FACTORS[0]), fastest)
            found.append(known)
        return found

    def score(self, gains: Mapping[str, Any], split: str, engine: Engine, least: float = 0.0) -> Score:
        """Returns the contest's score of the policy with these gains on a split; slower than `least` is too slow."""
        rows = [row for part in in_order(engine, _rows, self.settings(gains, split)) for row in part]
        scenarios = [each for family in self.families for each in self._scenarios(family, split)]
        return self.contest.score(rows, scenarios, self.speed, least)

    @property
    def families(self) -> tuple[str, ...]:
        """Returns the families that are driven."""
        return self.contest.families("kinematic")

    def settings(self, gains: Mapping[str, Any], split: str) -> list[Setting]:
        """Returns the parts that drive the first scenarios of every family of a split, many families in a batch."""
        entrants = Entrants((self.policy,), ("default",))
        (case,) = self.contest.cases(self.robot, Course("all", split), entrants, self.level)
        case = dataclasses.replace(case, gains=dict(gains))
        size, count = splits.SPLITS[split], min(self.scenarios, splits.SPLITS[split])
        members = [k * size + n for k in range(len(self.families)) for n in range(count)]
        parts = [tuple(members[first : first + MOST_AT_ONCE]) for first in range(0, len(members), MOST_AT_ONCE)]
        return [
            Setting("tune", case, "kinematic", self.actuators, first[0], len(first), members=first) for first in parts
        ]

    def _scenarios(self, family: str, split: str) -> tuple[Any, ...]:
        return splits.split(self.contest.spec.name, family, split)[: self.scenarios]

    def _digest(self, split: str) -> str:
        """Returns the SHA-256 of the scenarios that are driven of a split."""
        return splits.digest(scenario for family in self.families for scenario in self._scenarios(family, split))


class StillSearched(RuntimeError):
    """Other processes are driving sets of the same study."""


def _shown(score: Score) -> dict[str, Any]:
    return {
        "failures": score.failures,
        "episodes": score.episodes,
        "off_pace": score.off_pace,
        "mean_speed": round(score.mean_speed, 4) if score.mean_speed == score.mean_speed else None,
        "quality": round(score.quality, 6),
    }


def _rows(setting: Setting) -> list[dict[str, str]]:
    return [row for row, _ in episodes(setting)]


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
@click.option("--robot", type=RobotChoice("--robot"), default="p3dx", show_default=True, help="Or a data sheet.")
@click.option("--speed", type=Finite(0.05, 3.0), default=PACE, show_default=True, help="Asked for, m/s.")
@click.option("--level", type=Choice("--level", LEVELS), default="none", show_default=True, help="Of disturbance.")
@click.option("--actuators", type=Choice("--actuators", ("ideal", "lagged", "slow")), default="lagged")
@click.option("--frames", type=click.IntRange(min=1), default=2_000_000, show_default=True, help="Of the search.")
@click.option("--trials", type=click.IntRange(min=1), default=400, show_default=True, help="Sets to try, at most.")
@click.option("--scenarios", type=click.IntRange(min=1), default=10, show_default=True, help="Of each family.")
@click.option("--seed", type=SEED, default=0, show_default=True, help="Of the search.")
@click.option("--from", "started_from", metavar="SET", multiple=True, help="A set to begin with: JSON.")
@click.option(
    "--study",
    metavar="FILE",
    help="Search together with other processes: a journal file, or a database's URL, for all of them the same; goes on "
    "with what is there.",
)
@click.option("--out", metavar="FILE", help="The gains file.  [default: results/gains/SUITE/POLICY_CONDITION.json]")
@click.option("--ship", is_flag=True, help="Write them where the package keeps its gains.")
@click.option("--force", is_flag=True, help="Replace the file if there is one.")
@click.option("--workers", "count", type=click.IntRange(min=1), help="Processes.  [default: a core each, at most 4]")
@on_cluster
def main(
    policy: str,
    suite: str,
    robot: Robot,
    speed: float,
    level: str,
    actuators: str,
    frames: int,
    trials: int,
    scenarios: int,
    seed: int,
    started_from: tuple[str, ...],
    study: str | None,
    out: str | None,
    ship: bool,
    force: bool,
    count: int | None,
) -> None:
    """Searches the gains of POLICY for a robot, an asked speed and a level of disturbance, and writes them.

    It searches on the training split of a suite and chooses on the validation split; test scenarios are never touched.
    """
    try:
        import optuna  # noqa: F401
    except ImportError:
        raise click.ClickException('optuna is missing: pip install "wayfield[tune]"') from None
    from wayfield.benchmarks.shared_study import NoStudy

    contest = CONTESTS[suite]
    if policy not in contest.policies:
        raise click.UsageError(f"POLICY {policy!r} takes no part in suite {suite!r}")
    if out is not None and (ship or not out.strip()):
        raise click.UsageError("--out is empty; it must name a file" if not ship else "--ship takes the place of --out")
    name = f"{policy}_{condition(robot.name, speed, level)}.json"
    file = folder_of(suite) / name if ship else Path(out or f"results/gains/{suite}/{name}")
    _check_file(file, force)
    starts = tuple(_start(text) for text in started_from)
    search = Search(policy, contest, robot, speed, level, actuators, frames, trials, scenarios, seed, starts)
    search = dataclasses.replace(search, study=study or "")
    if study is not None and not study.strip():
        raise click.UsageError("--study is empty; it must name a file, or a database by its URL")
    with shared_out(count or cores()) as engine:
        try:
            content = search.run(engine)
        except StillSearched as others:
            print(f"{policy}: {others}")
            return
        except NoStudy as error:
            raise click.ClickException(str(error)) from None
    # before they are written: a disk that is full then takes nothing away
    found = content["validation"]
    print(f"{policy}: {found['default']} by default, {found['chosen']} with {content['gains']}", flush=True)
    _check_file(file, force)
    write_gains(file, content)
    print(f"Written to {file}")


def _start(text: str) -> dict[str, float]:
    """Returns a set that was given as a JSON object of numbers; click.UsageError if it is none."""
    try:
        return {str(name): float(value) for name, value in dict(json.loads(text)).items()}
    except (ValueError, TypeError):
        raise click.UsageError(f"--from must be a JSON object of numbers, got {text!r}") from None


def start_of(policy: str, suite: str, known: str) -> dict[str, float]:
    """Returns the set that shipped for a condition, with its pace, as a search may start from."""
    robot, speed, level = known.split("_")
    gains = wayfield.policies.tuned_gains(policy, suite, robot, float(speed), level)
    start = {name: float(gains[name]) for name in searched(policy, suite) if name in gains}
    if not CONTESTS[suite].speeds:
        return start
    asked = wayfield.policies.cruising(policy, gains, float(speed))
    return start | {"pace": rounded(max(float(gains[name]) / value for name, value in asked.items()))}


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
