"""Finds gains for a condition: python -m wayfield.benchmarks.tune POLICY --suite S --robot R --speed V --level L

The search drives training scenarios; its best sets, the policy's own gains and the set that ships, if one does, then
drive the whole validation split, and the best there is written. So a set that ships is never worse than the default
gains on scenarios that the search has not seen, and where nothing found was better the file says so: "default".

Goal seekers drive drawn rooms as well, some in the search and others in the choice: sizes and densities that the splits
do not have, and for gains of the P3DX other hulls (`rooms`). A set that does worse than the default gains in one of
these places, by the test of differences on the same scenarios, is not chosen, however well it does in the others.

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
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

import wayfield.policies
from wayfield.benchmarks.contests import CONTESTS, TRANSFER_SPLIT, Contest, Course, Score
from wayfield.benchmarks.paired import difference
from wayfield.benchmarks.parcels import in_order
from wayfield.benchmarks.rooms import PAIRS, SEEDS, WIDEST, Place, digest, in_rooms, searched_rooms
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.envs.command_line import SEED, Choice, Finite, OneLineErrors, RobotChoice, on_cluster, shared_out
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.engines import Engine, cores
from wayfield.envs.identity import source_digest
from wayfield.envs.robots import ROBOTS, Robot, shipped_name
from wayfield.envs.scenarios import scenarios_of, splits
from wayfield.envs.storage import write_whole
from wayfield.policies.tuned import PACE, TunedSet, condition, tuned_set

SEARCH_SPLIT = "train"
FINALISTS = 3  # sets of a search that drive the whole validation split, beside the default gains and what ships
VALIDATION_ROOMS = 12
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
        # who drives past a goal beside an obstacle goes on a detour, and may never come as near to it again
        "stop_radius": Range(0.05, 0.18),
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
class Drive:
    """What became of a set of gains: its score of all scenarios, and by place its score and its successes."""

    score: Score
    places: Mapping[str, Score] = dataclasses.field(default_factory=dict)
    won: Mapping[str, tuple[Sequence[str], Sequence[bool]]] = dataclasses.field(default_factory=dict)  # with families

    def losses(self, other: "Drive") -> list[str]:
        """Returns the places in which the other set is told apart as the better one, on the same scenarios."""
        found = []
        for name, (families, won) in self.won.items():
            ours, theirs = (np.array(each, np.float64)[:, np.newaxis] for each in (won, other.won[name][1]))
            if difference(ours, theirs, families, "share").high < 0.0:
                found.append(name)
        return found


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
    rooms: Mapping[str, Sequence[Course]] = dataclasses.field(default_factory=dict)  # by split, drawn when it is run

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
        with tempfile.TemporaryDirectory() as folder:
            return dataclasses.replace(self, rooms=self._drawn_rooms(Path(folder)))._run(engine)

    def _drawn_rooms(self, folder: Path) -> dict[str, Sequence[Course]]:
        """Returns the rooms of search and choice, written below a folder; none where they are no place to drive."""
        if not self.contest.in_rooms or self.robot.hull_radius > WIDEST:
            return {}
        counts = {SEARCH_SPLIT: self.scenarios, TRANSFER_SPLIT: VALIDATION_ROOMS}
        return {split: searched_rooms(folder, split, count) for split, count in counts.items()}

    def _run(self, engine: Engine) -> dict[str, Any]:
        found, frames = self._searched(engine)
        default = self.gains_at({})
        drives = {"default": self.drive(default, TRANSFER_SPLIT, engine)}
        slowest = drives["default"].score.mean_speed
        sets: dict[str, dict[str, Any]] = {"default": default}
        if (ships := self._ships) is not None:
            sets["shipped"] = dict(ships.gains)
        finalists = self._others(found, sets.values())[:FINALISTS]
        sets |= {f"found {k + 1}": gains for k, gains in enumerate(finalists)}
        for name, gains in sets.items():
            if name not in drives:
                drives[name] = self.drive(gains, TRANSFER_SPLIT, engine, slowest)
        losses = {name: each.losses(drives["default"]) for name, each in drives.items()}
        best = min((name for name in sets if not losses[name]), key=lambda name: drives[name].score)
        frames += sum(each.score.frames for each in drives.values())
        if best == "shipped" and ships is not None:
            frames += ships.frames
        robot = self.robot.name if isinstance(shipped_name(self.robot), str) else f"{self.robot.name}.json"
        return {
            "policy": self.policy,
            "suite": self.contest.name,
            "robot": self.robot.name,
            "sheet": self.robot.digest,
            "speed": self.speed,
            "level": self.level,
            "actuators": self.actuators,
            "chosen": "default" if best == "default" else "search",
            "gains": sets[best],
            "frames": frames,
            "validation": {
                "winner": best,
                "chosen": _shown(drives[best].score),
                "default": _shown(drives["default"].score),
                "finalists": {
                    name: {
                        "gains": gains,
                        "loses_to_default_in": losses[name],
                        **{place: _shown(score) for place, score in drives[name].places.items()},
                    }
                    for name, gains in sets.items()
                },
            },
            "started_from": [dict(each) for each in self.started_from],
            "searched_on": self._searched_on(ships.split if best == "shipped" and ships is not None else SEARCH_SPLIT),
            "seed": self.seed,
            "command": f"python -m wayfield.benchmarks.tune {self.policy} --suite {self.contest.name} --robot "
            f"{robot} --speed {self.speed:g} --level {self.level} --actuators {self.actuators} --frames "
            f"{self.frames} --trials {self.trials} --scenarios {self.scenarios} --seed {self.seed}"
            + "".join(f" --from '{json.dumps(dict(each))}'" for each in self.started_from)
            + (f" --study {shlex.quote(self.study)}" if self.study else ""),
        }

    @property
    def _ships(self) -> TunedSet | None:
        """Returns the set that ships for the condition, where one does that is not the default gains."""
        if ROBOTS.get(self.robot.name) != self.robot:
            return None
        found = tuned_set(self.policy, self.contest.name, self.robot.name, self.speed, self.level)
        return found if found is not None and found.chosen == "search" else None

    def _others(self, found: Sequence[dict[str, Any]], known: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Returns the sets that were found, each once, without those that are known."""
        seen = [wayfield.policies.make(self.policy, **gains) for gains in known]
        others = []
        for gains in found:
            made = wayfield.policies.make(self.policy, **gains)
            if made not in seen:
                seen.append(made)
                others.append(gains)
        return others

    def _searched_on(self, split: str) -> dict[str, Any]:
        """Returns the scenarios of search and choice, as a gains file tells of them."""
        told: dict[str, Any] = {
            "split": split or SEARCH_SPLIT,
            "scenarios": self.scenarios,
            "sha256": self._digest(SEARCH_SPLIT),
            "validation_sha256": self._digest(TRANSFER_SPLIT),
        }
        if self.rooms:
            robots = [place.robot.name for place in in_rooms(self.contest, self.robot, ())]
            told["rooms"] = {"robots": robots} | {
                name: {"seed": SEEDS[name], "rooms": len(rooms), "ways": PAIRS, "sha256": digest(rooms)}
                for name, rooms in self.rooms.items()
            }
        return told

    def _searched(self, engine: Engine) -> tuple[list[dict[str, Any]], int]:
        """Returns the sets of the search, the best first, and the frames that were driven for it."""
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
            score = self.drive(gains, SEARCH_SPLIT, engine, least).score
            frames += score.frames
            scored.append((score, gains))
            study.tell(trial, score.value)
        scored.sort(key=lambda each: each[0])
        return [gains for _, gains in scored], frames

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
                least = 0.0 if trial.number == 0 else self.drive(default, SEARCH_SPLIT, engine).score.mean_speed
            score = self.drive(gains, SEARCH_SPLIT, engine, 0.0 if trial.number == 0 else least).score
            least = score.mean_speed if trial.number == 0 else least
            shared.tell(trial, score, gains)
        if count := shared.others():
            raise StillSearched(
                f"the budget is used up, and other processes are driving {count} more: the one that ends last writes "
                "the gains, and so does this command again"
            )
        scored = sorted(shared.scored(), key=lambda each: each[0])
        return [gains for _, gains in scored], shared.frames

    @property
    def _study_name(self) -> str:
        """Returns what tells the search from others in the same place: all but its budget and its seed."""
        what = (self.policy, self.contest.name, self.robot.digest, f"{self.speed:g}", self.level, self.actuators)
        rooms = [digest(self.rooms[SEARCH_SPLIT])[:12]] if self.rooms else []
        return " ".join((*what, str(self.scenarios), self._digest(SEARCH_SPLIT)[:12], *rooms, source_digest()[:12]))

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

    def drive(self, gains: Mapping[str, Any], split: str, engine: Engine, least: float = 0.0) -> Drive:
        """Returns what becomes of a set in the places of a split; slower than `least` (m/s) is too slow."""
        driven = in_order(engine, _rows, [each for place in self.places(split) for each in self.settings(place, gains)])
        rows, scenarios, places, won = [], [], {}, {}
        for place in self.places(split):
            here = [row for _ in self.settings(place, gains) for row in next(driven)]
            there = self._scenarios(place)
            rows += here
            scenarios += there
            places[place.name] = self.contest.score(here, there, self.speed, least)
            families = [each.family or row["family"] for each, row in zip(there, here, strict=True)]
            won[place.name] = families, [row["success"] == "1" for row in here]
        return Drive(self.contest.score(rows, scenarios, self.speed, least), places, won)

    def places(self, split: str) -> list[Place]:
        """Returns where a set is driven: some scenarios of every family, all where it is chosen, and rooms."""
        size = splits.SPLITS[split]
        count = size if split == TRANSFER_SPLIT else min(self.scenarios, size)
        members = tuple(k * size + n for k in range(len(self.contest.families("kinematic"))) for n in range(count))
        found = [Place(split, self.contest, self.robot, [Course("all", split, members=members)])]
        return found + list(in_rooms(self.contest, self.robot, self.rooms[split]) if self.rooms else ())

    def settings(self, place: Place, gains: Mapping[str, Any]) -> list[Setting]:
        """Returns the parts that drive a set in a place, many scenarios in a batch."""
        found = []
        for course in place.courses:
            case = place.case(course, self.policy, gains, self.level)
            for first in range(0, len(course.members), MOST_AT_ONCE):
                part = course.members[first : first + MOST_AT_ONCE]
                found.append(Setting("tune", case, "kinematic", self.actuators, part[0], len(part), members=part))
        return found

    def _scenarios(self, place: Place) -> list[Any]:
        """Returns the scenarios of a place in the order in which they are driven."""
        spec, radius = self.contest.spec, place.robot.hull_radius
        banks = [(scenarios_of(spec, course.scenario, radius), course.members) for course in place.courses]
        return [bank[k] for bank, members in banks for k in members]

    def _digest(self, split: str) -> str:
        """Returns the SHA-256 of the scenarios that are driven of a split."""
        return splits.digest(self._scenarios(self.places(split)[0]))


class StillSearched(RuntimeError):
    """Other processes are driving sets of the same study."""


def told(content: Mapping[str, Any]) -> str:
    """Returns in one line what a search came to."""
    found = content["validation"]
    if content["chosen"] == "default":
        return f"{content['policy']}: {found['default']} by default, and no set did better"
    whose = "the set that ships, " if found["winner"] == "shipped" else ""
    return f"{content['policy']}: {found['default']} by default, {found['chosen']} with {whose}{content['gains']}"


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

    It searches on the training split of a suite and chooses on the whole validation split, goal seekers in drawn rooms
    too; test scenarios are never touched.
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
    print(told(content), flush=True)
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
