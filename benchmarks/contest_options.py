"""What is asked of a contest, and the settings that follow from it."""

import dataclasses
import functools
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from wayfield.benchmarks.cases import Case, Entrant
from wayfield.benchmarks.contests import (
    ALL_CONTESTS,
    DISTURBANCES,
    FRONT_SCENARIOS,
    GAINS_NAMES,
    LADDER_SCENARIOS,
    LADDER_SETS,
    OVERVIEW,
    OVERVIEW_SCENARIOS,
    OVERVIEW_SEEDS,
    TRAINED,
    TRANSFER_SCENARIOS,
    TRANSFER_SPLIT,
    Contest,
    Course,
    Entrants,
)
from wayfield.benchmarks.decisions import DECISIONS
from wayfield.benchmarks.own_policies import Mismatch
from wayfield.benchmarks.rollout import make_policy, make_vector
from wayfield.benchmarks.run_folder import Run
from wayfield.benchmarks.suite import WORST, Setting
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.robots import Robot
from wayfield.envs.scenarios import splits
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.policies.pilot import Pilot


class WrongOption(ValueError):
    """What was asked for does not go together; the message begins with the name of the option."""


@dataclasses.dataclass(frozen=True)
class ContestOptions:
    """What the command line, or `compare`, asks of a contest."""

    suite: str
    contests: tuple[str, ...]
    policies: tuple[str, ...] | None  # None: all of the contest but those on request
    dynamics: tuple[str, ...]
    actuators: str
    robot: Robot
    gains_names: tuple[str, ...]
    families: tuple[str, ...] | None  # None: all
    episodes: int | None  # the first scenarios of each family, or of each file; None: all, or one
    seed: int
    homes: tuple[str, ...] = ()  # folders of training runs that take part
    own: tuple[Entrant, ...] = ()  # policies from outside of the package
    courses: tuple[Course, ...] = ()  # the user's own scenarios, in place of the test split
    command: str = ""  # that makes the same again
    keep: int | None = WORST  # of each entry, the trajectories of its worst episodes; None: all
    split: str = "test"  # or "claims", of the frozen scenarios

    @property
    def ladder(self) -> bool:
        """Returns whether the run goes over the levels of disturbance."""
        return self.suite == DISTURBANCES

    @property
    def run(self) -> Run:
        """Returns the run, with the names of the files that it may write."""
        stems = [f"{ALL_CONTESTS[name].stem}_{self.robot}" for name in self.contests]
        kinds = ("csv", "tex", "svg", "png")
        names = [f"{stem}{rest}.{kind}" for stem in stems for rest in ("", "_*") for kind in kinds]
        return Run(self.suite, self.command, (DECISIONS, *names))

    def entrants(self, contest: Contest, gains_names: tuple[str, ...] | None = None) -> Entrants:
        """Returns who takes part in a contest, with the gains asked for or others.

        Raises:
            WrongOption: if a policy of the user's own can take part in none of the contests.
        """
        asked = set(contest.policies).difference(contest.on_request) if self.policies is None else self.policies
        names = tuple(name for name in contest.policies if name in asked)
        own = tuple(each for each, where in zip(self.own, self._places, strict=True) if contest.name in where)
        return Entrants(names, gains_names or self.gains_names, self.homes, own)

    @functools.cached_property
    def _places(self) -> list[list[str]]:
        return [self._where(each) for each in self.own]

    def timed(self) -> list[Case]:
        """Returns the cases in which policies are timed; of trained agents one."""
        found: dict[tuple[str, str, str], Case] = {}
        for contest in (ALL_CONTESTS[name] for name in self.contests):
            course = self.courses[0] if self.courses else Course(contest.timed_on, self.split)
            for case in contest.cases(self.robot, course, self.entrants(contest)):
                found[contest.name, case.policy, case.gains_name] = case
        return list(found.values())

    def settings(self) -> list[Setting]:
        """Returns every part of the run, in the order of the tables.

        Raises:
            WrongOption: if options do not go together, or a policy takes part in none of the contests.
            ValueError: if an agent, a split or a policy of the user's own is damaged.
        """
        contests = [ALL_CONTESTS[name] for name in self.contests]
        self._check_names(contests)
        self._check_homes(contests)
        self._check_families(contests)
        self._check_hull(contests)
        found = []
        for contest in contests:
            for plant in self.dynamics:
                for course in self.courses or self._frozen(contest, plant):
                    found += list(self._on(contest, plant, course))
        if not found:
            raise WrongOption(
                f"suite {self.suite}: nothing is left to run with these policies, gains, plants, families"
            )
        for name in self.policies or ():
            if all(setting.case.policy != name for setting in found):
                raise WrongOption(f"policies {name!r} has no case with these gains and {self.robot}")
        return found

    def _check_names(self, contests: list[Contest]) -> None:
        for name in self.policies or ():
            if all(name not in contest.policies for contest in contests):
                raise WrongOption(f"policies {name!r} takes no part in suite {self.suite!r}")
        met: dict[tuple[str, str], Entrant] = {}
        for own in self.own:
            if met.setdefault((own.name, own.gains_name), own) is not own:
                raise WrongOption(f"policy {own.name!r} is given twice with the same gains; names must differ")

    def _check_homes(self, contests: list[Contest]) -> None:
        for home in self.homes:
            if not home.strip() or Path(home).resolve().name in GAINS_NAMES:
                raise WrongOption(
                    f"agents {home!r} needs a name of its own; {', '.join(GAINS_NAMES)} mean something else"
                )
            if not any(list(contest.own_sets(home, self.robot)) for contest in contests):
                raise WrongOption(f"agents {home!r} holds no agents for suite {self.suite!r} and {self.robot}")
        if len({Path(home).resolve().name for home in self.homes}) < len(self.homes):
            raise WrongOption(f"agents must differ in their last names, got {', '.join(self.homes)}")

    def _check_families(self, contests: list[Contest]) -> None:
        for family in self.families or ():
            where = [contest for contest in contests if family in contest.spec.families]
            if not where:
                raise WrongOption(f"families {family!r} has no scenarios for suite {self.suite!r}")
            if not any(family in contest.families(plant) for contest in where for plant in self.dynamics):
                raise WrongOption(f"families {family!r} has obstacles that are pushed: use --dynamics pymunk")

    def _check_hull(self, contests: list[Contest]) -> None:
        """Refuses a robot for which the frozen scenarios of a contest were never searched for a way."""
        if self.courses or self.robot.hull_radius <= LARGEST_HULL:
            return
        for contest in contests:
            family = next(iter(contest.families("kinematic")))
            (case,) = contest.cases(self.robot, Course(family, "test"), Entrants(("zero",), ("default",)))
            try:
                make_vector(case, "kinematic", self.actuators, 1).close()
            except ValueError:
                raise WrongOption(
                    f"robot {self.robot.name!r} has a hull of {self.robot.hull_radius:.3g} m; the frozen scenarios of "
                    f"{contest.name} were searched for ways of at most {LARGEST_HULL:g} m: use --scenarios FOLDER"
                ) from None

    def _frozen(self, contest: Contest, plant: str) -> list[Course]:
        """Returns the split that is asked for of every family that was."""
        families = [each for each in contest.families(plant) if self.families is None or each in self.families]
        return [Course(family, self.split) for family in families]

    def _where(self, own: Entrant) -> list[str]:
        """Returns the contests that a policy of the user's own can take part in.

        Raises:
            WrongOption: if there are none; the message says why.
        """
        found, reasons = [], []
        for contest in (ALL_CONTESTS[name] for name in self.contests):
            try:
                try_out(contest, self.robot, own, self.courses[0] if self.courses else None)
                found.append(contest.name)
            except Mismatch as mismatch:
                reasons.append(str(mismatch))
        if not found:
            raise WrongOption(f"policy {reasons[0]}")
        return found

    def _on(self, contest: Contest, plant: str, course: Course) -> Iterator[Setting]:
        """Yields the parts of one family of scenarios."""
        # the front has one row a policy, the ladder one for each set that was tuned without disturbances and under them
        best = self.entrants(contest, ("best",) if len(self.gains_names) > 1 else self.gains_names)
        if self.ladder:
            sets = self.entrants(contest, LADDER_SETS if len(self.gains_names) > 1 else self.gains_names)
            for level in LEVELS:
                cases = contest.cases(self.robot, course, sets, level)
                yield from self._settings(contest, plant, course, cases, LADDER_SCENARIOS)
            return
        cases = contest.cases(self.robot, course, self.entrants(contest))
        if self.suite == OVERVIEW:
            few = (case for case in cases if case.policy not in TRAINED or case.gains["seed"] < OVERVIEW_SEEDS)
            yield from self._settings(contest, plant, course, few, OVERVIEW_SCENARIOS)
            return
        yield from self._settings(contest, plant, course, cases)
        if "tuned" in self.gains_names and not course.file:
            there = dataclasses.replace(course, split=TRANSFER_SPLIT)
            tuned = dataclasses.replace(best, gains_names=("tuned",))
            for case in contest.cases(self.robot, there, tuned):
                # the bar of a training seed is about the whole split; of the others only a gap is shown
                most = None if case.policy in TRAINED else TRANSFER_SCENARIOS
                yield from self._settings(contest, plant, there, (case,), most)
        for speed in contest.speeds:
            cases = contest.cases(self.robot, course, best, speed=speed)
            yield from self._settings(contest, plant, course, cases, FRONT_SCENARIOS)

    def _settings(
        self, contest: Contest, plant: str, course: Course, cases: Iterable[Case], most: int | None = None
    ) -> Iterator[Setting]:
        """Yields a part for each case, on the first scenarios of its family: all, `most`, or as many as asked for.

        The scenario of a file is driven once, or as often as asked for; of a bank all are, or the first.
        """
        there = len(splits.split(contest.spec.name, course.family, course.split)) if not course.file else None
        members = course.members[: self.episodes]
        limits = [limit for limit in (there, most, self.episodes) if limit is not None]
        count = len(members) or ((self.episodes or 1) if there is None else min(limits))
        for case in cases:
            first = seed_of(self.seed, case.split, case.experiment)
            yield Setting(self.suite, case, plant, self.actuators, first, count, self.keep, members)


def seed_of(seed: int, split: str, family: str) -> int:
    """Returns the first seed of a family's scenarios: other starts, noise and shoves in each family and split.

    It does not depend on who drives, so that comparisons stay paired.
    """
    words = (seed, *(zlib.crc32(name.encode()) for name in (split, family)))
    return int(np.random.SeedSequence(words).generate_state(1)[0] >> 1)


def try_out(contest: Contest, robot: Robot, own: Entrant, course: Course | None = None) -> None:
    """Lets a policy of the user's own decide once, before anything is written.

    Raises:
        Mismatch: if it cannot read what the contest gives, or drive the robot.
        ValueError: if it fails.
    """
    course = course or Course(contest.timed_on, "test")
    (case,) = contest.cases(robot, course, Entrants((), own=(own,)))
    policy = make_policy(case, 0)
    env = make_vector(case, "kinematic", "lagged", 2)
    kind = env.task.layout.kind
    if kind not in policy.observes:
        reads = " or ".join(f"{each.__module__}.{each.__name__}" for each in policy.observes)
        raise Mismatch(f"{own.name!r} reads {reads}, but {contest.name} gives {kind.__module__}.{kind.__name__}")
    pilot = Pilot(policy, env)
    seen, _ = env.reset(seed=0)
    pilot.reset()
    pilot.act(seen)
    env.close()
