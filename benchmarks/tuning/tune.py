"""Finds gains for a condition: python -m wayfield.benchmarks.tuning.tune POLICY --suite S --robot R --speed V --level L

The search drives training scenarios; its best sets, the policy's own gains and the set that ships, if one does, then
drive the whole validation split, and the best there is written. So a set that ships is never worse than the default
gains on scenarios that the search has not seen, and where nothing found was better the file says so: "default".

Goal seekers drive drawn rooms as well, some in the search and others in the choice: sizes and densities that the splits
do not have, and for gains of the P3DX other hulls (`rooms`). Levels of disturbance that `--also` names are driven too,
and count alike; the asked speed is to be held at each. A set that does worse than the default gains in one of these
places, by the test of differences on the same scenarios, is not chosen, however well it does in the others.

Of a robot whose sheet holds the intervals of an identification, sets are chosen on the validation split as driven by
the robot of the sheet and by robots drawn from the intervals (`intervals.drawn`), each of which is such a place. What
the chosen gains gain is then said of both, paired by scenario.

Best is what the contest says (`Score` of `contests`): the fewest failures; of those, for a path follower, a mean speed
within 3 % of the asked one, or where none has that no lower one than with the default gains; of those the least
tracking error, in the mean over families (times the time, where the speed is not held), or the highest SCT. The
cruising speed is searched along with the other gains, since a law that slows down in bends holds the asked mean only by
driving faster elsewhere. The budget is counted in frames, the control periods of robots, as that of training is; of
teams, which have at most 16 robots here, those of worlds.
"""

import dataclasses
import errno
import functools
import json
import math
import os
import shlex
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

import wayfield.policies
from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, TRANSFER_SPLIT, TUNED_CROWDS, Contest, Course, Score
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.runs.payloads import in_order
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.paired import difference
from wayfield.benchmarks.tuning.random_scenes import PAIRS, SEEDS, Place, digest, in_rooms, searched_rooms
from wayfield.envs.robots import ROBOTS, Robot, shipped_name
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.robots.intervals import Interval, drawn
from wayfield.envs.robots.robot_option import robot_option
from wayfield.envs.scenarios import scenarios_of, splits
from wayfield.envs.tasks.specs import CROWDS
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.policies.parts.gain import Range, gains_of
from wayfield.policies.parts.laws import ReferenceLaw
from wayfield.policies.parts.policy import check_robot
from wayfield.policies.parts.tuned import PACE, TunedSet, condition, tuned_set
from wayfield.system.checks import choose
from wayfield.system.command_line import SEED, Choice, Finite, OneLineErrors, on_cluster, say, shared_out
from wayfield.system.executors import Executor, cores
from wayfield.system.extras import installs
from wayfield.system.identity import source_digest
from wayfield.system.storage import write_whole

TUNED_FOR = (*CONTESTS, *(contest.name for contest in TUNED_CROWDS))
SEARCH_SPLIT = "train"
FINALISTS = 3  # sets of a search that drive the whole validation split, beside the default gains and what ships
VALIDATION_ROOMS = 12
DRAWN = 4  # robots, of one that was identified
DRAWN_SEED = 6000  # of them
AT_END = 0.05  # of a range, within which a value lies at its end
MOST_AT_ONCE = 64  # robots in a batch; of teams, worlds
LARGEST_TEAM = 16  # that gains are searched and chosen with
PACE_FACTORS = (0.97, 1.6)  # of the requested speed, between which a path follower's cruising speed is searched


# The gains of each policy that are searched, beside the cruising speed, which all path followers have.
SEARCHED: Mapping[str, Mapping[str, Range]] = {
    name: ranges for name in wayfield.policies.POLICIES if (ranges := wayfield.policies.searched_gains(name))
}


def search_space(policy: str, suite: str) -> Mapping[str, Range]:
    """Returns the gains of a policy that are searched for the contest of a suite, and where."""
    return SEARCHED[ALL_CONTESTS[suite].searched_as.get(policy, policy)]


def searched_families(contest: Contest) -> tuple[str, ...]:
    """Returns the families that gains are searched and chosen in: of teams, those that are not too large."""
    families = contest.tuned_on or contest.families("kinematic")
    if contest.spec.name not in CROWDS:
        return families
    return tuple(family for family in families if contest.spec.families[family].team <= LARGEST_TEAM)


@dataclasses.dataclass(frozen=True)
class Drive:
    """What became of a set of gains: its score of all scenarios, and by place its score and its successes."""

    score: Score
    places: Mapping[str, Score] = dataclasses.field(default_factory=dict)
    won: Mapping[str, tuple[Sequence[str], Sequence[bool]]] = dataclasses.field(default_factory=dict)  # with families
    costs: Mapping[str, Sequence[float]] = dataclasses.field(default_factory=dict)  # as the task has them
    speeds: Mapping[str, float] = dataclasses.field(default_factory=dict)  # by level of disturbance: the mean, m/s

    def losses(self, other: "Drive") -> list[str]:
        """Returns the places in which the other set is significantly better, on the same scenarios."""
        names = []
        for name, (families, won) in self.won.items():
            ours, theirs = (np.array(each, np.float64)[:, np.newaxis] for each in (won, other.won[name][1]))
            if difference(ours, theirs, families, "share").high < 0.0:
                names.append(name)
        return names


def compared(chosen: Drive, default: Drive, nominal: str) -> list[dict[str, Any]]:
    """Returns what the chosen gains gain over the default ones: on the robot of the sheet, and on those drawn.

    Differences are paired: the same scenario, driven by the same robot, of several in the mean. Intervals are of 95 %,
    over scenarios.
    """
    names = [[nominal], [name for name in default.won if name.startswith(f"{nominal}, drawn")]]
    lines = []
    for places, whose in zip(names, ("as identified", "drawn from its intervals"), strict=True):
        if not places:
            continue
        families = default.won[nominal][0]
        sides = []
        for drive in (chosen, default):
            won = np.array([drive.won[name][1] for name in places], np.float64).mean(axis=0)
            sides.append(
                (won[:, np.newaxis], np.array([drive.costs[name] for name in places]).mean(axis=0)[:, np.newaxis])
            )
        (won, cost), (won_before, cost_before) = sides
        success = difference(won, won_before, families, "share")
        error = difference(cost, cost_before, families)
        lines.append(
            {
                "robots": len(places),
                "whose": whose,
                "episodes": len(won) * len(places),
                **{"success": [round(float(each.mean()), 4) for each in (won_before, won)]},
                "success_difference": [_finite(each) for each in (success.value, success.low, success.high)],
                **{"cost": [round(float(each.mean()), 6) for each in (cost_before, cost)]},
                "cost_difference": [_finite(each) for each in (error.value, error.low, error.high)],
            }
        )
    return lines


def _finite(value: float) -> float | None:
    return round(float(value), 6) if np.isfinite(value) else None


@dataclasses.dataclass(frozen=True)
class Search:
    """What gains are searched for, and how long."""

    policy: str
    contest: Contest
    robot: Robot
    speed: float  # m/s, requested
    level: str  # of disturbance
    actuators: str
    frames: int  # after which no further set is tried
    trials: int  # sets, at most
    scenarios: int  # of each family
    seed: int
    started_from: tuple[Mapping[str, float], ...] = ()  # sets that are tried first, after the default gains
    study: str = ""  # where others search along: a journal file, or the URL of a database; "": this process alone
    rooms: Mapping[str, Sequence[Course]] = dataclasses.field(default_factory=dict)  # by split, drawn when it is run
    also: tuple[str, ...] = ()  # levels of disturbance that every set is driven under as well, and that count alike
    given: Mapping[str, Range] = dataclasses.field(default_factory=dict)  # in place of the declared ranges

    @property
    def paced(self) -> bool:
        """Returns whether the mean speed is to be held, and so the cruising speed is searched."""
        return bool(self.contest.speeds)

    @property
    def ranges(self) -> Mapping[str, Range]:
        """Returns the gains that are searched, and where: not those that hold the asked speed."""
        space = {**search_space(self.policy, self.contest.name), **self.given}
        return {name: each for name, each in space.items() if name not in self.pace_gains}

    @property
    def pace_gains(self) -> dict[str, float]:
        """Returns the gains by which a policy holds the asked speed in a crowd, where its mean is not searched."""
        crowd = self.contest.spec.name in CROWDS
        return (
            {k: rounded(v) for k, v in wayfield.policies.cruising(self.policy, {}, self.speed).items()} if crowd else {}
        )

    def gains_at(self, gains: Mapping[str, float], factor: float = 1.0) -> dict[str, Any]:
        """Returns gains, those of a path follower with the cruising speed that is `factor` times the requested one."""
        if not self.paced:
            return {**gains, **self.pace_gains}
        speed = rounded(factor * self.speed)
        return {**gains, **{k: rounded(v) for k, v in wayfield.policies.cruising(self.policy, gains, speed).items()}}

    def run(self, executor: Executor) -> dict[str, Any]:
        """Returns the content of a gains file."""
        with tempfile.TemporaryDirectory() as folder:
            return dataclasses.replace(self, rooms=self._drawn_rooms(Path(folder)))._run(executor)

    def _drawn_rooms(self, folder: Path) -> dict[str, Sequence[Course]]:
        """Returns the rooms of search and choice, written below a folder; none for contests that are not held there."""
        if not self.contest.in_rooms:
            return {}
        counts, size = {SEARCH_SPLIT: self.scenarios, TRANSFER_SPLIT: VALIDATION_ROOMS}, self._size
        return {
            split: searched_rooms(folder, split, count, size, self.contest.seen(size))
            for split, count in counts.items()
        }

    @property
    def _size(self) -> float:
        """Returns how many times as large as the frozen scenes those of the robot's hull class are."""
        return self.contest.spec.repertoire.size_for(self.robot.hull_radius)

    def _run(self, executor: Executor) -> dict[str, Any]:
        tried, frames = self._searched(executor)
        default = self.gains_at({})
        drives = {"default": self.drive(default, TRANSFER_SPLIT, executor)}
        slowest = drives["default"].speeds
        sets: dict[str, dict[str, Any]] = {"default": default}
        if (ships := self._ships) is not None:
            sets["shipped"] = dict(ships.gains)
        finalists = self._others(tried, sets.values())[:FINALISTS]
        sets |= {f"found {k + 1}": gains for k, gains in enumerate(finalists)}
        for name, gains in sets.items():
            if name not in drives:
                drives[name] = self.drive(gains, TRANSFER_SPLIT, executor, slowest)
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
            "at_ends": at_ends(self.policy, self.ranges, sets[best]) if best != "default" else {},
            "validation": {
                "winner": best,
                "chosen": _shown(drives[best].score),
                "default": _shown(drives["default"].score),
                **self._compared(drives[best], drives["default"]),
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
            "command": f"python -m wayfield.benchmarks.tuning.tune {self.policy} --suite {self.contest.name} --robot "
            f"{robot} --speed {self.speed:g} --level {self.level}"
            + "".join(f" --also {level}" for level in self.also)
            + f" --actuators {self.actuators} --frames "
            f"{self.frames} --trials {self.trials} --scenarios {self.scenarios} --seed {self.seed}"
            + "".join(f" --range {_range_text(name, each)}" for name, each in self.given.items())
            + "".join(f" --from '{json.dumps(dict(each))}'" for each in self.started_from)
            + (f" --study {shlex.quote(self.study)}" if self.study else ""),
        }

    def _compared(self, chosen: Drive, default: Drive) -> dict[str, Any]:
        """Returns what `compared` does, of a robot that was identified."""
        return {"compared": compared(chosen, default, TRANSFER_SPLIT)} if self._uncertain else {}

    @property
    def _uncertain(self) -> list[Robot]:
        """Returns robots as this one may be, by the intervals of its sheet; none if it has none."""
        if not any(isinstance(source, Interval) for source in self.robot.sources.values()):
            return []
        generator = np.random.default_rng(DRAWN_SEED)
        return [drawn(self.robot, generator) for _ in range(DRAWN)]

    @property
    def _ships(self) -> TunedSet | None:
        """Returns the set that ships for the condition, where one does that is not the default gains."""
        if ROBOTS.get(self.robot.name) != self.robot:
            return None
        best = tuned_set(self.policy, self.contest.name, self.robot.name, self.speed, self.level)
        return best if best is not None and best.chosen != "default" else None

    def _others(self, tried: Sequence[dict[str, Any]], known: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Returns the sets that were found, each once, without those that are known."""
        seen = [wayfield.policies.make(self.policy, **gains) for gains in known]
        others = []
        for gains in tried:
            made = wayfield.policies.make(self.policy, **gains)
            if made not in seen:
                seen.append(made)
                others.append(gains)
        return others

    def _searched_on(self, split: str) -> dict[str, Any]:
        """Returns the scenarios of search and choice, as a gains file describes them."""
        content: dict[str, Any] = {
            "split": split or SEARCH_SPLIT,
            "scenarios": self.scenarios,
            **({"levels": [self.level, *self.also]} if self.also else {}),
            "sha256": self._digest(SEARCH_SPLIT),
            "validation_sha256": self._digest(TRANSFER_SPLIT),
        }
        if self.rooms:
            robots = [place.robot.name for place in in_rooms(self.contest, self.robot, ())]
            content["rooms"] = {"robots": robots} | {
                name: {"seed": SEEDS[name], "rooms": len(rooms), "ways": PAIRS, "sha256": digest(rooms)}
                for name, rooms in self.rooms.items()
            }
        return content

    def _searched(self, executor: Executor) -> tuple[list[dict[str, Any]], int]:
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
            return self._searched_together(executor, starts, fastest)
        study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=self.seed))
        for known in starts:
            study.enqueue_trial(known)
        scored: list[tuple[Score, dict[str, Any]]] = []
        least: Mapping[str, float] = {}
        frames = 0
        begun = 0  # those that wait, as starts do, are among the study's trials already
        while frames < self.frames and begun < self.trials:
            trial = study.ask()
            begun += 1
            gains = self._drawn(trial, fastest)
            if gains is None:
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
                continue
            # the first are the default gains: no set shall be slower that cannot hold the requested speed either
            drive = self.drive(gains, SEARCH_SPLIT, executor, least)
            least = least if scored else drive.speeds
            frames += drive.score.frames
            scored.append((drive.score, gains))
            study.tell(trial, drive.score.value)
        scored.sort(key=lambda each: each[0])
        return [gains for _, gains in scored], frames

    def _searched_together(
        self, executor: Executor, starts: Sequence[Mapping[str, float]], fastest: float
    ) -> tuple[list[dict[str, Any]], int]:
        """Returns what `_searched` does, of a study that others search along; the budget is that of all.

        Raises:
            NoStudy: if it cannot be opened.
            StillSearched: if others are driving sets of it.
        """
        import optuna

        from wayfield.benchmarks.tuning.shared_study import SharedStudy

        shared = SharedStudy(self.study, self._study_name, starts)
        failed = optuna.trial.TrialState.FAIL
        least: Mapping[str, float] | None = None
        while shared.frames < self.frames and shared.begun < self.trials:
            trial = shared.study.ask()
            gains = self._drawn(trial, fastest) if trial.number < self.trials else None
            if gains is None:
                shared.study.tell(trial, state=failed)
                continue
            if least is None:  # as with one process, but that the default gains may be under way elsewhere
                default = self.gains_at({name: starts[0][name] for name in self.ranges}, 1.0)
                least = {} if trial.number == 0 else self.drive(default, SEARCH_SPLIT, executor).speeds
            drive = self.drive(gains, SEARCH_SPLIT, executor, least)
            least = least or drive.speeds
            shared.tell(trial, drive.score, gains)
        if count := shared.others():
            raise StillSearched(
                f"the budget is used up, and other processes are driving {count} more: the one that ends last writes "
                "the gains, and so does this command again"
            )
        scored = sorted(shared.scored(), key=lambda each: each[0])
        return [gains for _, gains in scored], shared.frames

    @property
    def _study_name(self) -> str:
        """Returns the key of the search: all of its settings but budget and seed."""
        levels = "+".join((self.level, *self.also))
        what = (self.policy, self.contest.name, self.robot.digest, f"{self.speed:g}", levels, self.actuators)
        rooms = [digest(self.rooms[SEARCH_SPLIT])[:12]] if self.rooms else []
        rooms += [_range_text(name, each) for name, each in self.given.items()]
        return " ".join((*what, str(self.scenarios), self._digest(SEARCH_SPLIT)[:12], *rooms, source_digest()[:12]))

    def _drawn(self, trial: Any, fastest: float) -> dict[str, Any] | None:
        """Returns the gains of a trial; None where two of them do not go together, or swing about any reference."""
        factor = trial.suggest_float("pace", PACE_FACTORS[0], fastest) if self.paced else 1.0
        ranges = self.ranges
        drawn = {k: rounded(trial.suggest_float(k, each.low, each.high, log=each.log)) for k, each in ranges.items()}
        try:
            gains = self.gains_at(drawn, factor)
            law = wayfield.policies.make(self.policy, **gains)
            if isinstance(law, ReferenceLaw):
                law.check(self.robot, self.robot.actuators(self.actuators), CONTROL_PERIOD)
        except ValueError:
            return None
        return gains

    def _known(self, ranges: Mapping[str, Range], fastest: float) -> list[dict[str, float]]:
        """Returns what the search starts from within its ranges: gains, and their pace."""
        sets = []
        for gains in self.started_from:
            known = {k: min(max(float(gains[k]), each.low), each.high) for k, each in ranges.items() if k in gains}
            if self.paced:
                known["pace"] = min(max(float(gains.get("pace", 1.0)), PACE_FACTORS[0]), fastest)
            sets.append(known)
        return sets

    def drive(
        self, gains: Mapping[str, Any], split: str, executor: Executor, least: Mapping[str, float] | None = None
    ) -> Drive:
        """Returns what becomes of a set in the places of a split; at a level slower than `least` (m/s) is too slow."""
        driven = in_order(
            executor, _rows, [each for place in self.places(split) for each in self.settings(place, gains)]
        )
        places, won, costs = {}, {}, {}
        levels: dict[str, tuple[list[Row], list[Any]]] = {}
        cost, slowest = self.contest.cost, least or {}
        lost = self._size * cost.failure  # larger scenes take longer
        for place in self.places(split):
            here = [row for _ in self.settings(place, gains) for row in next(driven)]
            there = self._scenarios(place)
            rows, scenarios = levels.setdefault(place.level, ([], []))
            rows += here
            scenarios += there
            places[place.name] = self.contest.score(Episodes(here), there, self.speed, slowest.get(place.level, 0.0))
            families = [each.family or row["family"] for each, row in zip(there, here, strict=True)]
            won[place.name] = families, [row["success"] == 1.0 for row in here]
            costs[place.name] = [row[cost.metric] if row["success"] == 1.0 else lost for row in here]
        scores = {
            level: self.contest.score(Episodes(rows), scenarios, self.speed, slowest.get(level, 0.0))
            for level, (rows, scenarios) in levels.items()
        }
        speeds = {level: score.mean_speed for level, score in scores.items()}
        return Drive(together(list(scores.values())), places, won, costs, speeds)

    def places(self, split: str) -> list[Place]:
        """Returns where a set is driven: some scenarios of every family, all where it is chosen, and rooms."""
        size = splits.SPLITS[split]
        count = size if split == TRANSFER_SPLIT else min(self.scenarios, size)
        families = searched_families(self.contest)
        members = tuple(k * size + n for k in range(len(families)) for n in range(count))
        named = self.contest.course("all", split, self.robot).split
        courses = [Course("all", named, members=members)]
        if self.contest.spec.name in CROWDS:  # in a batch all teams are as large
            courses = [Course(family, split, members=tuple(range(count))) for family in families]
        places = [Place(split, self.contest, self.robot, courses, self.level)]
        places += [Place(f"{split}, {level}", self.contest, self.robot, courses, level) for level in self.also]
        if split == TRANSFER_SPLIT:
            places += [
                Place(f"{split}, drawn {k + 1}", self.contest, robot, courses, self.level)
                for k, robot in enumerate(self._uncertain)
            ]
        return places + list(in_rooms(self.contest, self.robot, self.rooms[split], self.level) if self.rooms else ())

    def settings(self, place: Place, gains: Mapping[str, Any]) -> list[Setting]:
        """Returns the parts that drive a set in a place, many scenarios in a batch."""
        settings = []
        for course in place.courses:
            case = place.case(course, self.policy, gains)
            for first in range(0, len(course.members), MOST_AT_ONCE):
                part = course.members[first : first + MOST_AT_ONCE]
                settings.append(Setting("tune", case, "kinematic", self.actuators, part[0], len(part), members=part))
        return settings

    def _scenarios(self, place: Place) -> list[Any]:
        """Returns the scenarios of a place in the order in which they are driven."""
        spec, radius = self.contest.spec, place.robot.hull_radius
        banks = [(scenarios_of(spec, course.scenario, radius), course.members) for course in place.courses]
        return [bank[k] for bank, members in banks for k in members]

    def _digest(self, split: str) -> str:
        """Returns the SHA-256 of the scenarios that are driven of a split."""
        return splits.digest(self._scenarios(self.places(split)[0]))


def together(scores: Sequence[Score]) -> Score:
    """Returns the score of several levels of disturbance: the speed is held where it is at every one of them.

    Else a set that is too quick undisturbed and too slow disturbed would pass for one that is as quick as was asked.
    """
    if len(scores) == 1:
        return scores[0]
    episodes = sum(each.episodes for each in scores)
    reached = [each.episodes - each.failures for each in scores]
    speeds = [count * each.mean_speed for count, each in zip(reached, scores, strict=True) if count]
    return Score(
        sum(each.failures for each in scores),
        max(each.off_pace for each in scores),
        sum(each.episodes * each.quality for each in scores) / episodes,
        sum(speeds) / sum(reached) if speeds else math.nan,
        episodes,
        sum(each.frames for each in scores),
    )


class StillSearched(RuntimeError):
    """Other processes are driving sets of the same study."""


def summary(content: Mapping[str, Any]) -> str:
    """Returns in one line what a search came to."""
    validation = content["validation"]
    default, chosen = (_score_text(validation[name]) for name in ("default", "chosen"))
    if content["chosen"] == "default":
        return f"{content['policy']}: {default} with the default gains, and no set is better"
    whose = "the set that ships" if validation["winner"] == "shipped" else "the set that was found"
    return f"{content['policy']}: {default} with the default gains; {chosen} with {whose}"


def comparison_table(content: Mapping[str, Any]) -> str:
    """Returns what the chosen gains gain over the default ones on a robot that was identified, as lines of text."""
    cost = ALL_CONTESTS[content["suite"]].cost
    rows = [
        ("robots", "episodes", "success: default, tuned", "difference", f"{cost.metric}: default, tuned", "difference")
    ]
    for each in content["validation"].get("compared", ()):
        before, after = (f"{100.0 * value:.1f} %" for value in each["success"])
        rows.append(
            (
                f"{each['robots']} {each['whose']}",
                str(each["episodes"]),
                f"{before}, {after}",
                _difference_text(each["success_difference"], 100.0, 1),
                ", ".join(f"{value:.4g}" for value in each["cost"]),
                _difference_text(each["cost_difference"], 1.0, 4),
            )
        )
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        "  " + "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)) for row in rows
    )


def _difference_text(difference: Sequence[float | None], scale: float, digits: int) -> str:
    """Returns a difference and its 95 % interval."""
    value, low, high = ("?" if each is None else f"{scale * each:+.{digits}f}" for each in difference)
    return f"{value} ({low} to {high})"


def budget(content: Mapping[str, Any]) -> str:
    """Returns in one line what a search drove."""
    of_teams = ", of worlds" if content["suite"] == "teams" else ""
    return f"{content['frames']:,} environment steps{of_teams}: search and choice"


def at_ends(policy: str, ranges: Mapping[str, Range], gains: Mapping[str, Any]) -> dict[str, str]:
    """Returns the gains that lie at an end of where they were searched, each with a wider range that it may have."""
    declared = gains_of(wayfield.policies.make(policy))
    ends_by_gain = {}
    for name, each in ranges.items():
        place, back = (math.log, math.exp) if each.log else (float, float)
        low, high, at = map(place, (each.low, each.high, gains.get(name, declared[name].default)))
        ends = [each.low, each.high]
        for k, (near, far) in enumerate(((low, high), (high, low))):
            if abs(at - near) <= AT_END * (high - low):
                beyond = (rounded(back(near + (near - far) / 2**n)) for n in range(1, 9))
                ends[k] = next(filter(declared[name].fits, beyond), ends[k])
        if ends != [each.low, each.high]:
            ends_by_gain[name] = _range_text(name, Range(ends[0], ends[1]))
    return ends_by_gain


def _range_text(name: str, each: Range) -> str:
    return f"{name}={each.low:g}:{each.high:g}"


def gains_table(content: Mapping[str, Any]) -> str:
    """Returns the gains before and after a search as lines of text, and the line of Python that makes the policy."""
    policy, gains = content["policy"], content["gains"]
    defaults = wayfield.policies.make(policy, **content["validation"]["finalists"]["default"]["gains"])
    rows = [("gain", "default", "chosen")]
    for name in dict.fromkeys((*search_space(policy, content["suite"]), *gains)):
        default = getattr(defaults, name)
        rows.append((name, _number_text(default), _number_text(gains.get(name, default))))
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = [f"  {name:<{widths[0]}}  {old:>{widths[1]}}  {new:>{widths[2]}}" for name, old, new in rows]
    made = ", ".join((repr(policy), *(f"{name}={value!r}" for name, value in gains.items())))
    return "\n".join([*lines, f"Use them: wayfield.policies.make({made})"])


def _number_text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _score_text(score: Mapping[str, Any]) -> str:
    """Returns a score of a gains file in words."""
    failed = f"{score['failures']} of {score['episodes']} fail"
    speed = f", {score['mean_speed']:.3f} m/s" if score["mean_speed"] is not None else ""
    pace = ("", " (off the asked speed)", " (too slow)")[score["off_pace"]]
    return f"{failed}{speed}{pace}, cost {score['quality']:.4g}"


def _shown(score: Score) -> dict[str, Any]:
    return {
        "failures": score.failures,
        "episodes": score.episodes,
        "off_pace": score.off_pace,
        "mean_speed": round(score.mean_speed, 4) if score.mean_speed == score.mean_speed else None,
        "quality": round(score.quality, 6),
    }


def _rows(setting: Setting) -> list[Row]:
    return [row for row, _ in episodes(setting)]


def folder_of(suite: str) -> Path:
    """Returns where the gains of a suite ship."""
    return Path(wayfield.policies.__file__).resolve().parent / "gains" / suite  # where links of an install lead


def write_gains(file: Path, content: Mapping[str, Any]) -> None:
    """Writes a gains file, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, (json.dumps(content, indent=2) + "\n").encode())


def budgeted(frames: int) -> Callable[[Any], Any]:
    """Returns what gives a command the options of how much is searched, with a budget in environment steps."""
    at_least_one = click.IntRange(min=1)
    options = (
        click.option("--frames", type=at_least_one, default=frames, show_default=True, help="Environment steps."),
        click.option("--trials", type=at_least_one, default=400, show_default=True, help="Sets of gains, at most."),
        click.option("--scenarios", type=at_least_one, default=10, show_default=True, help="Scenarios of each family."),
        click.option("--seed", type=SEED, default=0, show_default=True, help="Seed of the search."),
    )
    return lambda command: functools.reduce(lambda made, option: option(made), reversed(options), command)


@click.command("tune", cls=OneLineErrors)
@click.argument("policy", metavar="POLICY", type=Choice("POLICY", SEARCHED))
@click.option("--suite", type=Choice("--suite", TUNED_FOR), required=True, help="Contest whose scenarios are used.")
@robot_option(default="p3dx", show_default=True)
@click.option("--speed", type=Finite(0.05, 3.0), help=f"Target speed, m/s.  [default: that of the suite, or {PACE:g}]")
@click.option(
    "--level", type=Choice("--level", LEVELS), default="none", show_default=True, help="Level of disturbance."
)
@click.option(
    "--also",
    type=Choice("--also", LEVELS),
    multiple=True,
    help="A second level under which every set of gains is run; --ship writes the set for it too.",
)
@click.option("--actuators", type=Choice("--actuators", ("ideal", "lagged", "slow")), default="lagged")
@budgeted(2_000_000)
@click.option(
    "--range",
    "wider",
    metavar="GAIN=LOW:HIGH",
    multiple=True,
    help="Range in which a gain is searched; may be repeated.",
)
@click.option(
    "--from",
    "started_from",
    metavar="SET",
    multiple=True,
    help="A set of gains to begin with, as JSON; may be repeated.",
)
@click.option(
    "--study",
    metavar="FILE",
    help="Share the search with other processes, or continue it: a journal file, or the URL of a database.",
)
@click.option("--out", metavar="FILE", help="File to write.  [default: results/gains/SUITE/POLICY_CONDITION.json]")
@click.option("--ship", is_flag=True, help="Write the gains into the package.")
@click.option("--force", is_flag=True, help="Replace an existing file.")
@click.option(
    "--workers", "count", type=click.IntRange(min=1), help="Number of processes.  [default: number of cores, at most 4]"
)
@on_cluster
def main(
    policy: str,
    suite: str,
    robot: Robot,
    speed: float | None,
    level: str,
    wider: tuple[str, ...],
    out: str | None,
    ship: bool,
    force: bool,
    count: int | None,
    **options: Any,
) -> None:
    """Searches the gains of POLICY for a robot, a target speed and a level of disturbance, and writes them to a file.

    The search runs on the training scenarios of a suite. The best sets are compared on all its validation scenarios,
    those of goal seekers in random rooms too. Test scenarios are never used.
    """
    try:
        import optuna  # noqa: F401
    except ImportError:
        raise click.ClickException(f"optuna is missing: {installs('tune')}") from None
    from wayfield.benchmarks.tuning.shared_study import NoStudy

    contest = ALL_CONTESTS[suite]
    if policy not in contest.policies:
        suites = ", ".join(name for name in TUNED_FOR if policy in ALL_CONTESTS[name].policies)
        raise click.UsageError(f"POLICY {policy!r} takes no part in suite {suite!r}; it is tuned with --suite {suites}")
    _check_robot(policy, contest, robot)
    own = contest.rules.speed if contest.rules else None
    if None not in (speed, own) and speed != own:
        raise click.UsageError(f"--speed {speed:g} is not what suite {suite} asks for; it asks for {own:g}")
    speed = speed or own or PACE
    if out is not None and (ship or not out.strip()):
        raise click.UsageError("--out is empty; it must name a file" if not ship else "--ship takes the place of --out")
    name = f"{policy}_{condition(robot.name, speed, level)}.json"
    file = folder_of(suite) / name if ship else Path(out or f"results/gains/{suite}/{name}")
    _check_file(file, force)
    also, study = options["also"], options["study"]
    options |= {"started_from": tuple(map(_start, options["started_from"])), "study": study or ""}
    search = Search(policy, contest, robot, speed, level, **options)
    _check_starts(search)
    if level in also or len(set(also)) < len(also):
        raise click.UsageError(f"--also {also[-1]} names a level twice; {level} is driven in any case")
    search = dataclasses.replace(search, given=given_ranges(search, wider))
    if study is not None and not study.strip():
        raise click.UsageError("--study is empty; it must name a file, or a database by its URL")
    with shared_out(count or cores()) as executor:
        try:
            content = search.run(executor)
        except StillSearched as others:
            say(f"{policy}: {others}")
            return
        except NoStudy as error:
            raise click.ClickException(str(error)) from None
    # before they are written: a disk that is full then takes nothing away
    say(summary(content))
    say(budget(content))
    say(gains_table(content))
    for gain, text in content["at_ends"].items():
        say(f"{gain} lies at the end of where it was searched; wider: --range {text}")
    if content["validation"].get("compared") and content["chosen"] != "default":
        say(comparison_table(content))
    for each in (level, *also) if ship else (level,):
        place = file.with_name(file.name.replace(f"_{level}.json", f"_{each}.json")) if each != level else file
        _check_file(place, force)
        write_gains(place, {**content, "level": each})
        say(f"Written to {place}")


def _check_robot(policy: str, contest: Contest, robot: Robot) -> None:
    """Refuses a robot that the policy cannot drive, or for which no scenario of the search was searched for a way."""
    try:
        check_robot(wayfield.policies.make(policy), robot)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    if robot.hull_radius > (most := contest.spec.repertoire.most):
        raise click.UsageError(
            f"--robot {robot.name!r} has a hull of {robot.hull_radius:.3g} m; the scenarios of {contest.name}, on "
            f"which gains are searched, have ways for at most {most:g} m"
        )


def _start(text: str) -> dict[str, float]:
    """Returns a set that was given as a JSON object of numbers; click.UsageError if it is none."""
    try:
        return {str(name): float(value) for name, value in dict(json.loads(text)).items()}
    except (ValueError, TypeError):
        raise click.UsageError(f"--from must be a JSON object of numbers, got {text!r}") from None


def _check_starts(search: Search) -> None:
    """Refuses a set to begin with that names what is no gain of the policy, or is no value of it."""
    for gains in search.started_from:
        try:
            own = {name: value for name, value in gains.items() if name != "pace" or not search.paced}
            wayfield.policies.make(search.policy, **own)
        except (ValueError, TypeError) as error:
            raise click.UsageError(f"--from {json.dumps(dict(gains))!r}: {error}") from None


def given_ranges(search: Search, texts: Sequence[str]) -> dict[str, Range]:
    """Returns the ranges that were given as GAIN=LOW:HIGH; click.UsageError names one that cannot be searched."""
    declared = gains_of(wayfield.policies.make(search.policy))
    ranges = {}
    for text in texts:
        name, _, ends = text.partition("=")
        try:
            choose("GAIN", name, declared)
            default = float(declared[name].default)
            low, high = map(float, ends.split(":"))
        except (ValueError, TypeError) as error:
            raise click.UsageError(f"--range {text!r} must be GAIN=LOW:HIGH of {search.policy}: {error}") from None
        for end in (low, high):
            if not declared[name].fits(end):
                raise click.UsageError(f"--range {text!r}: {name} must be {declared[name].range}")
        if not low < high or not low <= default <= high:
            raise click.UsageError(f"--range {text!r} must go from low to high about the default, {default:g}")
        paced = wayfield.policies.cruising(search.policy, {name: default}, search.speed) if search.paced else {}
        if name in {*paced, *search.pace_gains}:
            raise click.UsageError(f"--range {text!r}: {name} holds the asked speed, {search.speed:g} m/s")
        known = search.ranges.get(name)
        ranges[name] = Range(low, high, low > 0.0 and (known is None or known.log or known.low == 0.0))
    return ranges


def starting_gains(policy: str, suite: str, known: str) -> dict[str, float]:
    """Returns the set that shipped for a condition, with its pace, as a search may start from."""
    robot, speed, level = known.split("_")
    gains = wayfield.policies.tuned_gains(policy, suite, robot, float(speed), level)
    start = {name: float(gains[name]) for name in search_space(policy, suite) if name in gains}
    if not ALL_CONTESTS[suite].speeds:
        return start
    cruise = wayfield.policies.cruising(policy, gains, float(speed))
    return start | {"pace": rounded(max(float(gains[name]) / value for name, value in cruise.items()))}


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
