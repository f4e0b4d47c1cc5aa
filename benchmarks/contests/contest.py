"""A contest: a task, its entrants, the metrics and how they are shown, and the cases that follow from these.

Every policy meets the same scenarios, starts and disturbances. Gains called "default" are those of the policy's file,
"tuned" those that were found by search (see `tune`) for the robot and the asked speed that they are shown with,
"robust" those that were found under the disturbances ROBUST_LEVEL, and "paper" those that leave a controller what its
paper gives it: its objective alone, no memory of what is out of sight, no way around traps, nothing foreseen. Sets that
have no record of a search stand in the place of tuned and robust ones under the names of HAND_TUNED. Where no set was
found for a robot and a speed, or the default gains came out best, the default gains are shown, and called so.
"""

import dataclasses
import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wayfield import policies
from wayfield.benchmarks.records import episode
from wayfield.benchmarks.records.cases import Case, Entrant, Rules
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs.robots import ROBOTS, AnyRobot, Robot, robot_of, shipped_name
from wayfield.envs.scenarios import TaskSpec
from wayfield.envs.scenarios.splits import members
from wayfield.envs.tasks.specs import Cost
from wayfield.envs.tasks.task import CONTROL_PERIOD, LARGEST_TEAMS
from wayfield.policies.learned.agent import CARD, drives, read_card
from wayfield.policies.parts.policy import NEEDS, lacks
from wayfield.policies.parts.tuned import PACE, tuned_set
from wayfield.policies.trained.ppo import shipped, trained

TRAINED = ("ppo", "hybrid", "team_guided", "team_scan", "people_free")  # with a set for each seed
DEGREES = 180.0 / math.pi
FAULTS_NOTE = "Clearance is that of the hull; faults are moments in which a policy had to fall back on something else."
HAND_TUNED: Mapping[str, str] = {"tuned": "hand-tuned", "robust": "hand-tuned, disturbed"}  # what such a set is called
COMPLETE = (*HAND_TUNED, *HAND_TUNED.values())  # sets that are complete, with the speed that was asked for
GAINS_NAMES = ("default", "tuned", "robust", "paper", "best", "trained", "own", *HAND_TUNED.values())
_REACTIVE = {
    "patience": math.inf,
    "recall": 0.0,
    "foresight": 0.0,
}  # no way around traps, nothing remembered or foreseen
PAPER: Mapping[str, Mapping[str, Any]] = {
    "vfh_plus": {**_REACTIVE, "magnitudes": "sum"},
    "dwa": {**_REACTIVE, "progress": 0.0, "room": 0.0},  # Fox's three terms alone
    "orca": {"roadmap": False},  # straight at the goal
    "orca_team": {"turn": 0.0, "stuck_turn": 0.0, "back_off": 0.0},  # nothing against deadlocks
    "orca_team_map": {"turn": 0.0, "stuck_turn": 0.0, "back_off": 0.0},
}
ROBUST_LEVEL = "moderate"  # of disturbance, under which robust gains are tuned
TRANSFER_SPLIT = "validation"  # by which gains are chosen: the generalisation gap is the score here minus that on test
OWN_SPLIT = "own"  # of scenarios from the user's files
PUBLIC_SPLIT = "public"  # of those of a public benchmark
COST = "cost"  # a column's metric: the task's cost, where a run that fails counts as the task says


@dataclasses.dataclass(frozen=True)
class Column:
    """One column of the leaderboard: a metric, how it is reduced, and how it is shown."""

    header: str
    metric: str
    decimals: int = 3
    factor: float = 1.0
    with_interval: bool = False
    successes_only: bool = False
    reduction: str = "mean"  # or "iqm", the interquartile mean, "cvar", that of the larger half, "max", "min"
    imputed: bool = False  # whether a failure counts as the task says, as it does in COST


@dataclasses.dataclass(frozen=True)
class Film:
    """The drive that stands for an environment in the documentation."""

    policy: str
    scenario: str
    index: int
    robot: str
    seconds: float = 30.0  # at most


@dataclasses.dataclass(frozen=True)
class Heat:
    """What the figure of the families shows in colour, and what it writes into the cells."""

    metric: str  # COST, of the successes and on a logarithmic scale, or "success"
    title: str
    factor: float  # to the unit of the title
    decimals: int
    map_name: str  # of matplotlib's colours
    ends: tuple[float, float]  # of the scale, in the unit of the metric


@dataclasses.dataclass(frozen=True)
class Bar:
    """What a training seed must reach on the validation split, or has failed: that of the presets that ship."""

    words: str
    reached: Callable[[Episodes], bool | None]  # of its rows there; None: they do not tell


@dataclasses.dataclass(frozen=True)
class Course:
    """A family of scenarios: one of a frozen split, a file of the user's own, or some of a public benchmark."""

    family: str
    split: str
    file: str = ""  # absolute, a folder of some public benchmarks; "" for frozen scenarios
    steps: int = 0  # control periods, the clock; 0: the task's
    env_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    members: tuple[int, ...] = ()  # of the file's bank, an episode each; none: its one scenario, as often as asked for

    @property
    def scenario(self) -> str:
        """Returns the name under which the environment knows the scenarios."""
        return self.file or f"{self.family}/{self.split}"


@dataclasses.dataclass(frozen=True)
class Entrants:
    """The entrants: policies of the package, with which gains, agents of one's own, and policies from elsewhere."""

    policies: tuple[str, ...]
    gains_names: tuple[str, ...] = ("default", "tuned", "paper")
    homes: tuple[str, ...] = ()  # folders of training runs; those for task and robot take part, a set of gains each
    own: tuple[Entrant, ...] = ()


@dataclasses.dataclass(frozen=True, order=True)
class Score:
    """How well a set of gains did in a search; the lower is the better one, compared field by field in this order."""

    failures: int
    off_pace: int  # 0: the successes' mean speed is the asked one within PACE_TOLERANCE; 1: it is not; 2: and too slow
    quality: float  # at least 0: of the successes, what the contest compares them by
    mean_speed: float = dataclasses.field(compare=False, default=math.nan)  # m/s, of the successes
    episodes: int = dataclasses.field(compare=False, default=0)
    frames: int = dataclasses.field(compare=False, default=0)  # control periods driven

    @property
    def value(self) -> float:
        """Returns a number that orders scores as they are ordered: whole failures, and a share of one for the rest."""
        return self.failures + (self.off_pace + self.quality / (1.0 + self.quality)) / 3.0


@dataclasses.dataclass(frozen=True)
class Published:
    """What others have published for a public benchmark."""

    year: str
    entry: str
    score: str  # with its rules, where editions differ
    source: str


# relative: entries farther off the requested mean speed are ranked behind those that hold it
PACE_TOLERANCE = 0.03


def driven(rows: Episodes) -> tuple[int, int]:
    """Returns the number of episodes and of their frames."""
    return len(rows), int(np.round(rows["time"] / CONTROL_PERIOD).sum())


@dataclasses.dataclass(frozen=True)
class Contest:
    """A task's contest: entrants, scenarios, and what is shown of it. What is the task's is in its `spec`."""

    spec: TaskSpec
    policies: tuple[str, ...]  # in the order of the tables; agents are compared with the first
    overview: tuple[str, ...]  # those of them that matter, for the run that is made first and awaited
    env_kwargs: Mapping[str, Any]
    columns: tuple[Column, ...]
    # what is compared between the splits: positive where the entry does better on TRANSFER_SPLIT; None: nothing is
    gap: Column | None
    bar: Bar | None  # None: no agents are trained for it
    heat: Heat
    counted: str  # what a failure counts as, in the words of the note
    notes: str  # what a reader of the main table must know
    timed_on: str  # the family on which decisions are timed
    score: Callable[[Episodes, Sequence[Any], float, float], Score]  # of rows, scenarios, asked and least speed, m/s
    own_columns: tuple[Column, ...]  # of the table of one scenario of the user's own
    own_note: str  # what a reader of that table must know
    films: Mapping[bool, Film]  # of the environment for robots that are holonomic, and that are not
    log_cost: bool = False  # whether figures show the cost on a logarithmic scale
    speeds: tuple[float, ...] = ()  # m/s, of the speed-accuracy front; none: there is no front
    pace: float | None = None  # m/s, the mean speed that is asked for beside the front; None: none is
    # metrics that sort the leaderboard, each with the sign that puts less first
    ranked: tuple[tuple[str, float], ...] = (("success", -1.0), (COST, 1.0))
    # what only this task's drives are measured by, besides `wayfield.benchmarks.episodes.metrics`
    metrics: Mapping[episode.Column, Callable[[Trajectory], float]] = dataclasses.field(default_factory=dict)
    # policies whose gains are searched here as those of another, since elsewhere they do something else
    searched_as: Mapping[str, str] = dataclasses.field(default_factory=dict)
    in_rooms: bool = False  # whether gains are searched and chosen in drawn rooms, too
    claims: tuple[str, ...] = ()  # of the policies, those whose differences are published on the split of that name
    # kinds of scenes that verdicts are given for apart, each with its families; none: all together
    scenes: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    compared_by: Cost | None = None  # what verdicts and leaderboards compare successes by; None: the task's cost
    # of a public benchmark
    label: str = ""  # the name of the suite; "": the task's
    heading: str = ""  # of its tables; "": the task's
    rules: Rules | None = None
    on_request: tuple[str, ...] = ()  # of the policies, those that drive only where they are named
    published: tuple[Published, ...] = ()
    tuned_in: str = ""  # the suite whose tuned gains are driven; "": the task's
    tuned_on: tuple[str, ...] = ()  # families that gains are searched and chosen in; none: all
    cross: bool = False  # whether every entry shares its teams, half and half, with every other policy

    @property
    def name(self) -> str:
        """Returns the name of the suite."""
        return self.label or self.spec.suite

    @property
    def gains_suite(self) -> str:
        """Returns the name of the suite whose tuned gains are driven."""
        return self.tuned_in or self.spec.suite

    @property
    def title(self) -> str:
        """Returns what tables and figures call the contest."""
        return self.heading or self.spec.title

    @property
    def stem(self) -> str:
        """Returns what the names of the contest's files begin with."""
        return self.name.replace("-", "_")

    @property
    def cost(self) -> Cost:
        """Returns what verdicts and leaderboards compare successes by."""
        return self.compared_by or self.spec.cost

    def of_rows(self, rows: Episodes) -> "Contest":
        """Returns the contest as it compares some rows: by the task's cost, where a success among them lacks the own.

        Rows of earlier versions do.
        """
        by = self.compared_by
        if by is None or (by.metric in rows.names and not np.isnan(rows.where(success=1.0).numbers(by.metric)).any()):
            return self
        return dataclasses.replace(self, compared_by=None)

    @property
    def cost_header(self) -> str:
        """Returns the header of the column that shows the cost of all runs."""
        return next(column.header for column in self.columns if column.metric == COST)

    def env_id(self, robot: AnyRobot) -> str:
        """Returns the registered id of the environment for a robot."""
        return self.spec.env_id(robot_of(robot))

    def failure_cost(self, steps: int) -> float:
        """Returns what a failed run counts as under a clock of that many control periods.

        A cost in seconds is the whole clock, any other the task's.
        """
        limit = self.rules.limit if self.rules else math.inf
        return min(steps * CONTROL_PERIOD, limit) if self.spec.cost.unit == "s" else self.spec.cost.failure

    def families(self, dynamics: str, wanted: Collection[str] | None = None) -> tuple[str, ...]:
        """Returns those of the wanted families that a plant can show, by default of the newest version of "all"."""
        every = members(self.spec.name) if wanted is None else (each for each in self.spec.families if each in wanted)
        known, most = self.spec.families, LARGEST_TEAMS.get(dynamics, 1)
        return tuple(
            each
            for each in every
            if (dynamics != "kinematic" or not known[each].needs_forces) and known[each].team <= most
        )

    def course(self, family: str, split: str, robot: AnyRobot) -> Course:
        """Returns a family of a frozen split for a robot: of its hull class, where its hull asks for one."""
        return Course(family, self.spec.repertoire.split_for(split, robot_of(robot).hull_radius))

    def seen(self, size: float) -> dict[str, Any]:
        """Returns the range of the scan in scenes that are so many times as large, so that they look alike."""
        return {"max_range": size * self.env_kwargs["max_range"]} if size != 1.0 else {}

    def cases(
        self, robot: AnyRobot, course: Course, entrants: Entrants, disturbance: str = "none", speed: float | None = None
    ) -> Iterator[Case]:
        """Yields a case for each entrant and each set of its gains, on all scenarios of a course.

        Trained agents have one set, "trained", whatever is asked for, and a case for each seed.

        Args:
            robot: one that ships, a data sheet, or a `Robot`.
            disturbance: a level of the ladder.
            speed: m/s, a cruising speed in place of the policy's own; policies without one are left out.
        """
        robot = robot_of(robot)
        disturbed = {} if disturbance == "none" else {"disturbance": disturbance}
        conditions = {"robot": shipped_name(robot), **disturbed}
        size = 1.0 if course.file else self.spec.repertoire.size_of(course.split)
        conditions |= self.seen(size)
        requested = self.rules.speed if speed is None and self.rules else speed
        for name, gains_name, gains, entrant, beside in self._crossed(robot, entrants, requested):
            if requested is not None and gains_name not in COMPLETE:
                at_speed = _cruising(name, gains, entrant, requested)
                if at_speed is None and speed is not None:
                    continue
                gains = gains | (at_speed or {})
            yield Case(
                self.name,
                course.family,
                self.env_id(robot),
                course.scenario,
                name,
                gains,
                {**self.env_kwargs, **course.env_kwargs, **conditions},
                course.steps or round(size * self.spec.clock),
                gains_name=gains_name,
                speed=speed,
                every_scenario=True,
                split=course.split,
                entrant=entrant,
                rules=self.rules,
                beside=beside,
            )

    def _crossed(
        self, robot: Robot, entrants: Entrants, speed: float | None
    ) -> Iterator[tuple[str, str, dict[str, Any], Entrant | None, str]]:
        """Yields what `_sets` does, and the policy of the team's other half; in a cross-play every pair, once each way.

        In a cross-play a policy has one set of gains, the first.
        """
        sets = list(self._sets(robot, entrants, speed))
        if not self.cross:
            yield from ((*each, "") for each in sets)
            return
        firsts = {each[0]: each for each in reversed(sets)}
        for name in dict.fromkeys(each[0] for each in sets):
            _, _, gains, entrant = firsts[name]
            for beside in entrants.policies:
                if beside != name and beside in firsts:
                    yield name, f"beside {beside}", gains, entrant, beside

    def _sets(
        self, robot: Robot, entrants: Entrants, speed: float | None
    ) -> Iterator[tuple[str, str, dict[str, Any], Entrant | None]]:
        """Yields each entrant with each set of its gains: name, name of the set, gains, and a user's own entrant."""
        pace = PACE if speed is None else speed
        able = (name for name in entrants.policies if not lacks(policies.make(name), robot))
        sets = {name: list(self.gain_sets(name, robot, entrants.gains_names, pace)) for name in able}
        for home in entrants.homes:
            for gains_name, gains in self.own_sets(home, robot):
                driver = self._driver(read_card(trained(home)[gains["seed"]] / CARD))
                sets.setdefault(driver, []).append((gains_name, gains))
        for name, of_policy in sets.items():
            for gains_name, gains in of_policy:
                yield name, gains_name, gains, None
        for own in entrants.own:
            yield own.name, own.gains_name, dict(own.gains), own

    def gain_sets(
        self, name: str, robot: AnyRobot, gains_names: Sequence[str], pace: float = PACE
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yields the sets of a policy's gains for a robot and an asked speed (m/s), each with its name.

        Sets that were found are complete; others still lack the requested speed. The default gains stand in
        for a set that was not tuned for robot and speed, and for one in whose search they came out best. A robust set
        that is the tuned one is yielded once. Nothing was trained or tuned for a robot that does not ship.
        """
        robot = robot_of(robot)
        ships = ROBOTS.get(robot.name) == robot
        if name in TRAINED:
            for seed in self.agents_of(name, robot.name) if ships else ():
                yield "trained", {"seed": seed}
            return
        sets = {}
        for gains_name, level in (("tuned", "none"), ("robust", ROBUST_LEVEL)):
            if gains_name in gains_names or (gains_name == "tuned" and "best" in gains_names):
                sets[gains_name] = tuned_set(name, self.gains_suite, robot.name, pace, level) if ships else None
        better = {gains_name: each for gains_name, each in sets.items() if each and each.chosen != "default"}
        if "default" in gains_names or ("tuned" in sets and "tuned" not in better):
            yield "default", {}
        given: list[Mapping[str, Any]] = []
        for gains_name, each in better.items():
            if each.gains not in given:
                yield gains_name if each.chosen == "search" else HAND_TUNED[gains_name], dict(each.gains)
            given.append(each.gains)
        if name in PAPER and "paper" in gains_names:
            yield "paper", dict(PAPER[name])

    def agents_of(self, name: str, robot: str) -> dict[int, Path]:
        """Returns the folders of the agents that ship for the task and a robot, and that a policy drives with."""
        named = getattr(policies.POLICIES[name], "agents_of", lambda task: task)
        return shipped(named(self.spec.name), robot)

    def _driver(self, card: Mapping[str, Any]) -> str:
        """Returns the policy that drives with an agent of one's own, by its card."""
        among = "bodies" in card["features"]
        return next(name for name in TRAINED if name in self.policies) if among else "ppo"

    def without_agents(self, names: Iterable[str], robot: AnyRobot) -> dict[str, str]:
        """Returns the trained policies among names of which no agent ships for the robot, each with a line about it."""
        robot = robot_of(robot)
        given = robot.name if isinstance(shipped_name(robot), str) else f"{robot.name}.json"
        if robot.hull_radius > (most := self.spec.repertoire.most):
            remedy = f"none can be trained for a hull of {robot.hull_radius:.3g} m, beyond {most:g} m"
        else:
            remedy = f"wayfield train {self.env_id(robot)} --robot {given} trains one"
        lacking = [name for name in names if name in TRAINED and not any(self.gain_sets(name, robot, ()))]
        there = {name: ", ".join(each for each in ROBOTS if self.agents_of(name, each)) for name in lacking}
        return {
            name: f"policies {name!r}: no agent ships for {self.spec.name} with {robot}, but with "
            f"{there[name] or 'no robot'}; {remedy}"
            for name in lacking
        }

    def own_sets(self, home: str, robot: AnyRobot) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yields the agents in a folder of training runs, if they are for the task and the robot.

        Raises:
            ValueError: if there are none at all, or a card is damaged.
        """
        runs, robot = trained(home), robot_of(robot)
        if not runs:
            raise ValueError(f"{home!r} holds no trained agents: no seed_N{os.sep}best in {os.path.abspath(home)}")
        for seed, folder in runs.items():
            card = read_card(folder / CARD)
            if card["task"] == self.spec.name and drives(card, robot):
                yield Path(home).resolve().name, {"seed": seed, "home": home}


def with_agents(
    contests: Iterable[Contest], names: tuple[str, ...], robot: AnyRobot, others: bool = False
) -> tuple[tuple[str, ...], list[str]]:
    """Returns the policies of which agents are there, and a line about each trained one that is left out.

    Args:
        others: whether other entrants take part; without any entrant all names are returned, and the error names them.
    """
    lines = [each.without_agents(names, robot) for each in contests]
    untrained = {name: line for name, line in lines[0].items() if all(name in each for each in lines)}
    entrants = tuple(name for name in names if name not in untrained)
    return (entrants, [f"{line}; it is left out" for line in untrained.values()]) if entrants or others else (names, [])


def left_out(contests: Sequence[Contest], robot: Robot) -> list[str]:
    """Returns which entrants of contests a robot leaves out: a line for each thing that they need, one for agents."""
    names = dict.fromkeys(name for each in contests for name in each.policies if name not in each.on_request)
    lacking = {name: lacks(policies.make(name), robot) for name in names}
    reasons = {
        f"since they need a robot that {words}": [name for name in names if need in lacking[name]]
        for need, words in NEEDS.items()
    }
    agents = [name for name in names if name in TRAINED and not lacking[name]]
    reasons["of which no agent ships"] = [
        name for name in agents if not any(any(each.gain_sets(name, robot, ())) for each in contests)
    ]
    return [f"left out with {robot.name!r}, {why}: {', '.join(those)}" for why, those in reasons.items() if those]


def _cruising(name: str, gains: Mapping[str, Any], entrant: Entrant | None, speed: float) -> dict[str, Any] | None:
    """Returns the gains that make an entrant cruise at a speed (m/s); None where it has no cruising speed."""
    if entrant is not None:
        return entrant.cruising(speed)
    try:
        return policies.cruising(name, gains, speed)
    except policies.NoCruisingSpeed:
        return None
