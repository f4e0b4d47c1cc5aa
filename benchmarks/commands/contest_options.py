"""The options of a run, which kind of run each belongs to, and the settings of a contest that follow from them."""

import dataclasses
import functools
import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wayfield.benchmarks.contests import (
    ALL_CONTESTS,
    CONTESTS,
    CROWD_SUITES,
    DISTURBANCES,
    FRONT_SCENARIOS,
    GAINS,
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
from wayfield.benchmarks.entrants.own_policies import Mismatch
from wayfield.benchmarks.entrants.public_suites import PUBLIC
from wayfield.benchmarks.episodes.rollout import make_policy, make_vector
from wayfield.benchmarks.records.cases import Case, Entrant
from wayfield.benchmarks.records.results import readable
from wayfield.benchmarks.records.run_folder import Run, default_folder
from wayfield.benchmarks.runs.decisions import DECISIONS
from wayfield.benchmarks.runs.suite import WORST, Setting
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.scenarios import splits
from wayfield.envs.tasks.task import IN_PROCESS, LARGEST_TEAMS, PLANTS, plant_class
from wayfield.policies.parts.policy import check_robot
from wayfield.policies.pilot import Pilot
from wayfield.policies.registry import POLICIES, RENAMED
from wayfield.system.executors import cores

DOCUMENTS = "documents"
PAPERS = "papers"
DYNAMICS = {**{each: (each,) for each in IN_PROCESS}, "both": ("kinematic", "pymunk")}
STORED = {"worst": WORST, "all": None}
QUICK = "quick"
QUICK_POLICIES = (
    *("pure_pursuit", "regulated_pure_pursuit"),
    *("vfh_plus", "scan_planner"),
    *("polar", "mpc_pose"),
    "ppo",
)
QUICK_FAMILIES = ("circles", "splines", "clutter_10", "doors_wide", "open", "berth")
QUICK_SCENARIOS = 2  # of each family
QUICK_SEEDS = 1  # of each agent's training runs, the first


class WrongOption(ValueError):
    """Options that contradict each other; the message begins with the name of the option."""


# Which kinds of run an option belongs to, and where that is said to be; all take --policies, --dynamics, --actuators,
# --episodes, but the overview and a first look, which take none of these.
_CONTESTS = ("contest", "scenarios", *PUBLIC)
_OF_CONTESTS = f"the contests: --suite {', '.join((*CONTESTS, DISTURBANCES, *CROWD_SUITES))}"
_CROWDED = f"--suite {', '.join(CROWD_SUITES)}"
_OF_FROZEN = f"the frozen scenarios of {_OF_CONTESTS}"
_OF_PUBLIC = f"public benchmarks: --suite {', '.join(PUBLIC)}"
BELONGS: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "data": ("--data", (*PUBLIC, PAPERS), f"{_OF_PUBLIC}, {PAPERS}"),
    "mode": ("--mode", tuple(PUBLIC), _OF_PUBLIC),
    "scale": ("--scale", ("path", "scenarios", "racetracks"), "--path FILE, --scenarios FOLDER or --suite racetracks"),
    "robot": ("--robot", ("path", *_CONTESTS), _OF_CONTESTS),
    "gains": ("--gains", _CONTESTS, _OF_CONTESTS),
    "homes": ("--agents", _CONTESTS, _OF_CONTESTS),
    "own": ("--policy", _CONTESTS, _OF_CONTESTS),
    "keep": ("--keep-trajectories", _CONTESTS, _OF_CONTESTS),
    "families": ("--families", ("contest",), _OF_FROZEN),
    "split": ("--split", ("contest",), _OF_FROZEN),
    "video": ("--video", ("path", DOCUMENTS), f"--suite {DOCUMENTS}"),
    "cross": ("--cross", ("contest",), "--suite teams"),
    "people": ("--people", ("contest",), "--suite people"),
    "claim": ("--claim", (PAPERS,), f"--suite {PAPERS}"),
    "train": ("--train", (PAPERS,), f"--suite {PAPERS}"),
    "steps": ("--steps", (PAPERS,), f"--suite {PAPERS} with --train"),
}
# What does not make an overview the run of a suite: options that all take, and what follows from others.
_ALWAYS = (
    *("suite", "policies", "seed", "out", "quick", "full", "count"),
    *("contests", "on_request", "entering", "courses", "command"),
)


@dataclasses.dataclass(frozen=True)
class Options:
    """The options of a run, as the command line or `compare` gives them; None, False and () where nothing is given."""

    suite: str | None = None
    policies: tuple[str, ...] | None = None  # None: all of the contest but those on request; "all": these too
    dynamics: str | None = None  # of DYNAMICS
    actuators: str | None = None
    robot: Robot | None = None
    gains: str | None = None  # of GAINS
    homes: tuple[str, ...] = ()  # folders of training runs that take part
    own: tuple[str, ...] = ()  # sources of policies from outside of the package
    families: tuple[str, ...] | None = None  # None: all
    split: str | None = None  # "test" or "claims", of the frozen scenarios
    path: str | None = None
    scenarios: str | None = None
    scale: float | None = None
    data: str | None = None
    mode: str | None = None
    episodes: int | None = None  # the first scenarios of each family, or of each file; None: all, or one
    seed: int = 0
    out: str | None = None
    quick: bool = False
    full: bool = False
    video: bool = False
    keep: str | None = None  # of KEPT
    cross: bool = False  # also teams of two policies each, half and half
    claim: str | None = None  # of a paper
    train: bool = False  # its agents anew
    steps: int | None = None  # of that training, a seed; None: as it is done
    people: tuple[str, ...] | None = None  # laws of pedestrians; None: those of the scenario
    count: int | None = None  # processes
    # what follows from them, where a contest is run
    contests: tuple[str, ...] = ()
    on_request: bool = False  # whether policies that drive on request alone were asked for: "all"
    entering: tuple[Entrant, ...] = ()  # the policies from outside of the package
    courses: tuple[Course, ...] = ()  # the user's own scenarios, in place of the test split
    command: str = ""  # that makes the same again

    @property
    def names(self) -> tuple[str, ...] | None:
        """Returns the policies that are named; None for all."""
        if self.policies is None or "all" in self.policies:
            return None
        return tuple(dict.fromkeys(RENAMED.get(name, name) for name in self.policies))

    @property
    def narrowed(self) -> bool:
        """Returns whether there are other options than those that every run takes."""
        return bool(self.names) or any(value for name, value in vars(self).items() if name not in _ALWAYS)

    @property
    def wanted(self) -> str:
        """Returns the suite that is given, or follows."""
        return self.suite or (DOCUMENTS if self.narrowed else OVERVIEW)

    @property
    def kind(self) -> str:
        """Returns the kind of run: quick, path, scenarios, contest, or the name of another suite."""
        for name in (QUICK, "path", "scenarios"):
            if getattr(self, name) not in (None, False):
                return name
        return "contest" if self.wanted in (*CONTESTS, DISTURBANCES, *CROWD_SUITES) else self.wanted

    @property
    def processes(self) -> int:
        """Returns how many processes share the work."""
        return self.count or cores()

    @property
    def plants(self) -> tuple[str, ...]:
        """Returns the plants of a contest."""
        return DYNAMICS[self.dynamics or "kinematic"]

    @property
    def tier(self) -> str:
        """Returns the actuators of a contest."""
        return self.actuators or "lagged"

    @property
    def chosen_robot(self) -> Robot:
        """Returns the robot of a contest."""
        return self.robot or ROBOTS["p3dx"]

    @property
    def gains_names(self) -> tuple[str, ...]:
        """Returns the sets of gains."""
        return GAINS[self.gains or "all"]

    def differing(self, plant: str, tier: str) -> dict[str, Any]:
        """Returns what is not as by default, by its name, for the name of the folder; None and nothing else is."""
        return {
            "robot": str(self.robot) if self.robot not in (None, ROBOTS["p3dx"]) else None,
            "agents": tuple(Path(home).resolve().name for home in self.homes),
            "own": tuple(readable(text) for text in self.own),
            **{"policies": self.names or self.policies, "families": self.families, "split": self.split},
            **{"scale": self.scale, "episodes": self.episodes, "seed": self.seed},
            "cross": "cross" if self.cross else None,
            "people": self.people,
            "trajectories": "all_trajectories" if self.keep == "all" else None,
            "plant": self.dynamics if self.dynamics != plant else None,
            "tier": self.actuators if self.actuators != tier else None,
        }

    def folder(self, name: str, differing: Mapping[str, Any]) -> Path:
        """Returns the folder of the results."""
        return Path(self.out) if self.out is not None else default_folder(name, differing)

    def check(self) -> None:
        """Raises WrongOption where an option is empty, lacks another, or belongs to another kind of run."""
        for name, what in (("out", "folder"), ("path", "file"), ("scenarios", "folder"), ("data", "folder")):
            if (value := getattr(self, name)) is not None and not value.strip():
                raise WrongOption(f"{name} is empty; it must name a {what}")
        instead = [name for name in ("suite", "path", "scenarios") if getattr(self, name) is not None]
        if len(instead) > 1:
            raise WrongOption(f"{instead[1]} takes the place of --{instead[0]}: give one of them")
        if self.quick and (self.suite is not None or self.narrowed or self.full):
            raise WrongOption("quick takes no options but --out, --seed, --workers, --cluster")
        for name, (option, kinds, where) in BELONGS.items():
            if getattr(self, name) not in (None, (), False) and self.kind not in kinds and self.wanted != OVERVIEW:
                raise WrongOption(f"{option[2:]} belongs to {where}")
        if self.wanted == OVERVIEW and self.narrowed and self.kind == OVERVIEW:
            raise WrongOption(f"suite {OVERVIEW} takes no options but --out, --seed, --workers, --cluster")
        if self.dynamics == "both" and self.kind in _CONTESTS:
            raise WrongOption("dynamics both belongs to the documents; a contest is run on one plant")
        if self.dynamics is not None and self.dynamics in PLANTS:
            try:
                plant_class(self.dynamics)
            except ImportError as error:
                raise WrongOption(str(error)) from None
        if self.kind in PUBLIC:
            self._check_public()
        if self.kind == PAPERS:
            for name in ("policies", "dynamics", "actuators", "full"):
                if getattr(self, name):
                    raise WrongOption(
                        f"{name} is said by the claim itself; --suite papers takes --episodes, --train, --steps, "
                        "--data and --out"
                    )
            if self.steps and not self.train:
                raise WrongOption("steps is of a training: add --train")
        for name, suite in (("cross", "teams"), ("people", "people")):
            if getattr(self, name) and self.wanted != suite:
                raise WrongOption(f"{name} belongs to --suite {suite}")
        if self.wanted in CROWD_SUITES and self.dynamics not in (None, *LARGEST_TEAMS):
            raise WrongOption(f"dynamics {self.dynamics} is for one robot; {_CROWDED} take {', '.join(LARGEST_TEAMS)}")
        if self.wanted == "crowdnav" and (self.families or self.split):
            raise WrongOption(f"{'families' if self.families else 'split'} belongs to suites of frozen scenarios")

    def _check_public(self) -> None:
        suite = PUBLIC[self.wanted]
        if self.data is None:
            raise WrongOption(f"suite {self.wanted} needs --data FOLDER, the folder of its official files")
        if self.mode is not None and self.mode not in suite.modes:
            raise WrongOption(f"mode {self.mode!r} is none of suite {self.wanted!r}")
        mode = suite.modes[self.mode or next(iter(suite.modes))]
        if mode.fixed and self.robot not in (None, ROBOTS[mode.robot]):
            raise WrongOption(f"robot of this mode of {self.wanted} is {mode.robot}: see --mode")

    @property
    def ladder(self) -> bool:
        """Returns whether the run goes over the levels of disturbance."""
        return self.suite == DISTURBANCES

    @property
    def run(self) -> Run:
        """Returns the run, with the names of the files that it may write."""
        stems = [f"{ALL_CONTESTS[name].stem}_{self.chosen_robot}" for name in self.contests]
        kinds = ("csv", "tex", "svg", "png")
        names = [f"{stem}{rest}.{kind}" for stem in stems for rest in ("", "_*") for kind in kinds]
        return Run(self.wanted, self.command, (DECISIONS, *names))

    def entrants(self, contest: Contest, gains_names: tuple[str, ...] | None = None) -> Entrants:
        """Returns the entrants of a contest, with the gains of the options or others.

        Raises:
            WrongOption: if a policy of the user's own can take part in none of the contests.
        """
        usual = set(contest.policies).difference(() if self.on_request else contest.on_request)
        entering = usual if self.policies is None else self.policies
        names = tuple(name for name in contest.policies if name in entering)
        own = tuple(each for each, where in zip(self.entering, self._places, strict=True) if contest.name in where)
        return Entrants(names, gains_names or self.gains_names, self.homes, own)

    @functools.cached_property
    def _places(self) -> list[list[str]]:
        return [self._where(each) for each in self.entering]

    def timed(self) -> list[Case]:
        """Returns the cases in which policies are timed; of trained agents one."""
        cases: dict[tuple[str, str, str], Case] = {}
        for contest in (ALL_CONTESTS[name] for name in self.contests):
            course = self.courses[0] if self.courses else self._course(contest, contest.timed_on)
            for case in contest.cases(self.chosen_robot, course, self.entrants(contest)):
                cases[contest.name, case.policy, case.gains_name] = case
        return list(cases.values())

    def settings(self) -> list[Setting]:
        """Returns every part of the run, in the order of the tables, those of speed sweeps last.

        Raises:
            WrongOption: if options do not go together, or a policy takes part in none of the contests.
            ValueError: if an agent, a split or a policy of the user's own is damaged.
        """
        contests = [ALL_CONTESTS[name] for name in self.contests]
        self._check_names(contests)
        self._check_homes(contests)
        self._check_families(contests)
        self._check_hull(contests)
        settings = []
        for contest in contests:
            for plant in self.plants:
                for course in self.courses or self._frozen(contest, plant):
                    settings += list(self._on(contest, plant, course))
        unused = [name for name in self.policies or () if all(setting.case.policy != name for setting in settings)]
        for name in unused:
            if name in POLICIES:
                try:
                    check_robot(POLICIES[name](), self.chosen_robot)
                except ValueError as error:
                    raise WrongOption(f"policies {name!r}: {error}") from None
        if not settings:
            for contest in contests:
                for line in contest.without_agents(self.policies or (), self.chosen_robot).values():
                    raise WrongOption(line)
            raise WrongOption(
                f"suite {self.suite}: nothing is left to run with these policies, gains, plants, families"
            )
        for name in unused:
            raise WrongOption(f"policies {name!r} has no case with these gains and {self.chosen_robot}")
        return sorted(settings, key=lambda setting: setting.case.speed is not None)

    def _check_names(self, contests: list[Contest]) -> None:
        for name in self.policies or ():
            if all(name not in contest.policies for contest in contests):
                fit = ", ".join(dict.fromkeys(each for contest in contests for each in contest.policies))
                raise WrongOption(f"policies {name!r} takes no part in suite {self.suite!r}; choose from {fit}")
        met: dict[tuple[str, str], Entrant] = {}
        for own in self.entering:
            if met.setdefault((own.name, own.gains_name), own) is not own:
                raise WrongOption(f"policy {own.name!r} is given twice with the same gains; names must differ")

    def _check_homes(self, contests: list[Contest]) -> None:
        for home in self.homes:
            if not home.strip() or Path(home).resolve().name in GAINS_NAMES:
                raise WrongOption(
                    f"agents {home!r} needs a name of its own; {', '.join(GAINS_NAMES)} mean something else"
                )
            if not any(list(contest.own_sets(home, self.chosen_robot)) for contest in contests):
                raise WrongOption(f"agents {home!r} holds no agents for suite {self.suite!r} and {self.chosen_robot}")
        if len({Path(home).resolve().name for home in self.homes}) < len(self.homes):
            raise WrongOption(f"agents must differ in their last names, got {', '.join(self.homes)}")

    def _check_families(self, contests: list[Contest]) -> None:
        for family in self.families or ():
            where = [contest for contest in contests if family in contest.spec.families]
            if not where:
                there = ", ".join(dict.fromkeys(each for contest in contests for each in contest.spec.families))
                raise WrongOption(f"families {family!r} has no scenarios for suite {self.suite!r}; choose from {there}")
            if not any(family in contest.families(plant, (family,)) for contest in where for plant in self.plants):
                team, most = where[0].spec.families[family].team, LARGEST_TEAMS.get(self.plants[0], 1)
                if team > most:
                    raise WrongOption(f"families {family!r} has {team} robots; {self.plants[0]} drives at most {most}")
                raise WrongOption(f"families {family!r} has obstacles that are pushed: use --dynamics pymunk or mujoco")

    def _check_hull(self, contests: list[Contest]) -> None:
        """Refuses a robot for which the frozen scenarios of a contest were never searched for a way."""
        robot = self.chosen_robot
        crowds = self.suite in CROWD_SUITES and self.scenarios is None  # the tests of others too
        for contest in contests if crowds or not self.courses else ():
            most = contest.spec.repertoire.most
            if robot.hull_radius > most:
                raise WrongOption(
                    f"robot {robot.name!r} has a hull of {robot.hull_radius:.3g} m; the frozen scenarios of "
                    f"{contest.name} are for hulls of at most {most:g} m: use --scenarios FOLDER"
                )

    def _frozen(self, contest: Contest, plant: str) -> list[Course]:
        """Returns the chosen split of every chosen family."""
        return [self._course(contest, family) for family in contest.families(plant, self.families)]

    def _course(self, contest: Contest, family: str) -> Course:
        return contest.course(family, self.split or "test", self.chosen_robot)

    def _where(self, own: Entrant) -> list[str]:
        """Returns the contests that a policy of the user's own can take part in.

        Raises:
            WrongOption: if there are none; the message says why.
        """
        contests, reasons = [], []
        for contest in (ALL_CONTESTS[name] for name in self.contests):
            try:
                try_out(contest, self.chosen_robot, own, self.courses[0] if self.courses else None)
                contests.append(contest.name)
            except Mismatch as mismatch:
                reasons.append(str(mismatch))
        if not contests:
            raise WrongOption(f"policy {reasons[0]}")
        return contests

    def _on(self, contest: Contest, plant: str, course: Course) -> Iterator[Setting]:
        """Yields the parts of one family of scenarios."""
        # the front has one row a policy, the ladder one for each set that was tuned without disturbances and under them
        best = self.entrants(contest, ("best",) if len(self.gains_names) > 1 else self.gains_names)
        if self.ladder:
            sets = self.entrants(contest, LADDER_SETS if len(self.gains_names) > 1 else self.gains_names)
            for level in LEVELS:
                cases = contest.cases(self.chosen_robot, course, sets, level)
                yield from self._settings(contest, plant, course, cases, LADDER_SCENARIOS)
            return
        cases = contest.cases(self.chosen_robot, course, self.entrants(contest))
        if self.suite in (OVERVIEW, QUICK):
            sizes = {OVERVIEW: (OVERVIEW_SEEDS, OVERVIEW_SCENARIOS), QUICK: (QUICK_SEEDS, QUICK_SCENARIOS)}
            seeds, scenarios = sizes[self.suite]
            few = (case for case in cases if case.policy not in TRAINED or case.gains["seed"] < seeds)
            yield from self._settings(contest, plant, course, few, scenarios)
            return
        yield from self._settings(contest, plant, course, cases)
        if "tuned" in self.gains_names and contest.gap is not None and not course.file:
            there = contest.course(course.family, TRANSFER_SPLIT, self.chosen_robot)
            tuned = dataclasses.replace(best, gains_names=("tuned",))
            for case in contest.cases(self.chosen_robot, there, tuned):
                # the bar of a training seed is about the whole split; of the others only a gap is shown
                most = None if case.policy in TRAINED else TRANSFER_SCENARIOS
                yield from self._settings(contest, plant, there, (case,), most)
        for speed in contest.speeds:
            cases = contest.cases(self.chosen_robot, course, best, speed=speed)
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
            first = seed_of(self.seed, case.split, case.family)
            yield Setting(self.wanted, case, plant, self.tier, first, count, STORED[self.keep or "worst"], members)


def seed_of(seed: int, split: str, family: str) -> int:
    """Returns the first seed of a family's scenarios: other starts, noise and shoves in each family and split.

    It does not depend on the policy, so that comparisons stay paired.
    """
    words = (seed, *(zlib.crc32(name.encode()) for name in (split, family)))
    return int(np.random.SeedSequence(words).generate_state(1)[0] >> 1)


def try_out(contest: Contest, robot: Robot, own: Entrant, course: Course | None = None) -> None:
    """Lets a policy of the user's own decide once, before anything is written.

    Raises:
        Mismatch: if it cannot read what the contest gives, or drive the robot.
        ValueError: if it fails.
    """
    course = course or contest.course(contest.timed_on, "test", robot)
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
