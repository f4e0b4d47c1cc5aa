"""A published claim as data, what it takes to run it again, and the verdict.

A claim says that one policy does better than a rival. The rival is driven as the source has it (a), and with gains that
were searched (b). All meet the same scenes, and the verdict follows from paired differences by one rule for all claims.
"""

import contextlib
import csv
import dataclasses
import importlib
import io
import math
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.contests import ALL_CONTESTS, Course, Entrants
from wayfield.benchmarks.contests.contest import HAND_TUNED, Contest
from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.benchmarks.records.episode import Row
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.paired import SIGNIFICANT, Difference, difference
from wayfield.envs.scenarios.barn import barn_scenarios
from wayfield.policies.trained.ppo import in_place_of
from wayfield.system.executors import Map

Array = NDArray[np.float64]
Measure = Literal["success", "time", "error"]

# Fixed beforehand, for all claims: what a difference has to exceed to matter. Points of success are shares here.
MARGINS: Mapping[Measure, float] = {"success": 0.02, "time": 0.02, "error": 0.10}
HOLDS = "holds"
ONLY_UNTUNED = "holds only against the untuned rival"
DOES_NOT_HOLD = "does not hold"
OPEN = "open"
NO_VERDICT = "no verdict: rival not reproduced"
AGENT, UNTUNED, TUNED, ALSO, BESIDE = "agent", "a", "b", "c", "beside"  # sides, as rows call them
DATA = "{data}"  # in a policy: the folder of the user's own; as the file of a course: its worlds, by their numbers
COLUMNS = ("claim", "side", "seed", "family", "scene", "success", "cost")


@dataclasses.dataclass(frozen=True)
class Printed:
    """A number of the source, and where it stands."""

    words: str
    number: str  # as printed
    place: str


@dataclasses.dataclass(frozen=True)
class Side:
    """Who drives: a policy of the package with a set of gains, or a class of a module."""

    words: str  # for the page
    policy: str  # a name, or "module:Class gain=value", as `--policy` takes it
    gains: str = "default"  # the set; of classes none
    budget: str = "none"  # of search or training, in words
    seeds: tuple[int, ...] = ()  # of a class that takes one


@dataclasses.dataclass(frozen=True)
class Training:
    """What trains the agents of a claim anew: a preset of `wayfield train`, or a function of the claim's own.

    The function takes a folder, the training seeds, and the steps of each or None; what it writes there is read by the
    class that drives, which takes it as its gain `folder`.
    """

    preset: str = ""
    env_id: str = ""
    ships: str = ""  # the folder of the agents that ship by it
    function: str = ""  # "module:function"
    seeds: int = 3


@dataclasses.dataclass(frozen=True)
class Gate:
    """The printed number that the untuned rival has to come within the margin of before anything is judged."""

    number: float  # a share of successes, s or m
    words: str
    calibrated: float | None = None  # what the rival came to in the source's own rules; None: what it does here


@dataclasses.dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim. A paper's file has one, as `CLAIM`."""

    name: str
    sentence: str
    source: str  # authors, title, where, year, address
    printed: tuple[Printed, ...]
    setting: str  # ours, in a sentence
    differs: tuple[str, ...]  # from the source's setting, a line each
    would_change: str  # what would change the verdict
    contest: str  # the suite that it is driven in
    families: tuple[str, ...]
    robot: str
    measure: Measure
    agent: Side  # that is claimed to be better
    untuned: Side | None  # (a); None: the source names no gains
    tuned: Side | None  # (b); None: no search was made yet
    also: Side | None = None  # (c), a part of the agent that it has to beat too
    beside: Side | None = None  # driven for comparison: no verdict looks at it
    training: Training | None = None  # None: nothing in it was trained
    as_long: bool = True  # whether it was trained as long as the source's; if not, no verdict goes against the source
    gate: Gate | None = None  # None: the source prints nothing that it could be compared with
    split: str = "claims"
    scenes: int = 25  # of each family
    course: Course | None = None  # in place of families
    answer: str = ""  # of the authors: where it stands
    data: str = ""  # what a folder of the user's own has to hold; "": it needs none
    published: str = ""  # the study that keeps its rows, where `evaluate` does not make them

    @property
    def sides(self) -> dict[str, Side]:
        """Returns those that there are."""
        sides = {AGENT: self.agent, UNTUNED: self.untuned, TUNED: self.tuned, ALSO: self.also, BESIDE: self.beside}
        return {name: side for name, side in sides.items() if side is not None}


@dataclasses.dataclass(frozen=True)
class Driven:
    """What a side did: a line a scene, a column a trained agent."""

    success: Array  # (s, r)
    cost: Array  # (s, r) s or m

    @property
    def share(self) -> float:
        """Returns the mean success."""
        return float(self.success.mean())

    @property
    def mean_cost(self) -> float:
        """Returns the mean cost of the successes; NaN without one."""
        won = self.success > 0.0
        return float(self.cost[won].mean()) if won.any() else math.nan


def train(claim: Claim, home: Path, steps: int | None = None) -> None:
    """Trains the agents of a claim anew, into a folder; runs that were interrupted there go on.

    Args:
        steps: of each seed, in place of those that the training says.

    Raises:
        ValueError: if nothing in the claim was trained.
        subprocess.CalledProcessError: if a training fails, which has said why.
    """
    training = claim.training
    if training is None:
        raise ValueError(f"claim {claim.name!r} has no agent that was trained")
    if training.function:
        module, _, function = training.function.partition(":")
        getattr(importlib.import_module(module), function)(home, range(training.seeds), steps)
        return
    given = ["--preset", training.preset, "--seeds", str(training.seeds), "--out", str(home)]
    given += ["--steps", str(steps)] if steps else []
    given += ["--resume"] if home.is_dir() and any(home.iterdir()) else []
    subprocess.run([sys.executable, "-m", "wayfield.command", "train", training.env_id, *given], check=True)


def settings(claim: Claim, side: Side, scenes: int, home: Path | None = None) -> Iterator[tuple[str, Setting]]:
    """Yields the training seed ("" of controllers) and the setting of each part of a side; `home` as `drive` has it.

    Raises:
        ValueError: if a policy has no such set of gains.
    """
    contest: Contest = ALL_CONTESTS[claim.contest]
    if claim.course is not None:
        file, members = claim.course.file, claim.course.members[:scenes]
        if file == DATA:
            file, members = str(home), numbered(str(home), members)
        courses = [dataclasses.replace(claim.course, file=file, members=members)]
        scenes = len(members)
    else:
        forced = {name for name, family in contest.spec.families.items() if family.needs_forces}
        families = [name for name in claim.families if name not in forced]  # which the kinematic plant cannot show
        courses = [contest.course(name, claim.split, claim.robot) for name in families]
    own = ":" in side.policy
    if own:
        anew = home is not None and claim.training is not None and claim.training.function
        beside = f" folder={shlex.quote(str(home))}" if anew else ""
        texts = [f"{side.policy} seed={seed}{beside}" for seed in side.seeds] or [side.policy]
        texts = [text.replace(DATA, shlex.quote(str(home))) for text in texts]
        entrants = Entrants((), own=tuple(map(own_policy, texts)))
    else:
        entrants = Entrants((side.policy,), ("tuned" if side.gains == HAND_TUNED["tuned"] else side.gains,))
    for course in courses:
        cases = [each for each in contest.cases(claim.robot, course, entrants) if own or each.gains_name == side.gains]
        if not cases:
            every = contest.cases(claim.robot, course, dataclasses.replace(entrants, gains_names=("default", "tuned")))
            there = ", ".join(dict.fromkeys(each.gains_name for each in every))
            raise ValueError(f"{side.policy} has no gains {side.gains!r} for {claim.robot} here; choose from {there}")
        for case in cases:
            seed = str(case.gains.get("seed", ""))
            yield seed, Setting(contest.name, case, "kinematic", "lagged", 0, scenes, members=course.members)


def numbered(folder: str, worlds: Iterable[int]) -> tuple[int, ...]:
    """Returns where worlds of the BARN challenge stand among those of a folder, by their numbers.

    Raises:
        ValueError: if one is missing, or a file is faulty.
    """
    there = {each.name: k for k, each in enumerate(barn_scenarios(folder))}
    missing = [f"world_{world}" for world in worlds if f"world_{world}" not in there]
    if missing:
        raise ValueError(f"{folder} has no {missing[0]}.world")
    return tuple(there[f"world_{world}"] for world in worlds)


def driven(setting: Setting) -> list[Row]:
    """Returns the episodes of a setting."""
    return [row for row, _ in episodes(setting)]


def drive(claim: Claim, scenes: int = 0, home: Path | None = None, spread: Map = map) -> Iterator[dict[str, str]]:
    """Yields a row of COLUMNS for each episode; where times are compared, a failure takes the whole clock.

    Args:
        scenes: of each family; 0: as the claim says.
        home: a folder of agents that `train` has trained, which drive in place of those that ship: in this process.
            Of a claim with `data`, the folder that holds them.
        spread: an executor, which shares out the work.
    """
    contest: Contest = ALL_CONTESTS[claim.contest]
    metric = contest.cost.metric if claim.measure == "error" else "time"
    with contextlib.ExitStack() as stack:
        if home is not None and claim.training is not None and claim.training.ships:
            stack.enter_context(in_place_of(claim.training.ships, home))
        parts = [
            (name, seed, setting)
            for name, side in claim.sides.items()
            for seed, setting in settings(claim, side, scenes or claim.scenes, home)
        ]
        for (name, seed, setting), rows in zip(parts, spread(driven, [part[2] for part in parts]), strict=True):
            clock = contest.failure_cost(setting.case.max_episode_steps)
            for i, row in enumerate(rows):
                cost = row[metric] if row["success"] or claim.measure != "time" else clock
                cells = (claim.name, name, seed, row["family"], str(i), f"{int(row['success'])}", f"{cost:.6g}")
                yield dict(zip(COLUMNS, cells, strict=True))


def gathered(rows: Iterable[Mapping[str, str]]) -> tuple[dict[str, Driven], list[str]]:
    """Returns what each side did in the scenes that all met, in one order, and the family of each scene.

    Raises:
        ValueError: if a side lacks rows.
    """
    worlds: dict[str, dict[tuple[str, str], dict[str, tuple[float, float]]]] = {}
    for row in rows:
        scene = worlds.setdefault(row["side"], {}).setdefault((row["family"], row["scene"]), {})
        scene[row["seed"]] = float(row["success"]), float(row["cost"] or "nan")
    scenes = sorted(set.intersection(*(set(each) for each in worlds.values()))) if worlds else []
    if not scenes:
        raise ValueError("no scene was met by all sides")
    sides = {}
    for name, by_scene in worlds.items():
        seeds = sorted({seed for each in by_scene.values() for seed in each})
        table = np.array([[by_scene[scene][seed] for seed in seeds] for scene in scenes])
        sides[name] = Driven(table[:, :, 0], table[:, :, 1])
    return sides, [family for family, _ in scenes]


def gain(agent: Driven, rival: Driven, strata: Sequence[str], measure: Measure) -> Difference:
    """Returns by how much the agent does better: a share of successes, or of the rival's mean time or error.

    Errors are compared in the scenes that every seed of both solves, times in all.
    """
    if measure == "success":
        return difference(agent.success, rival.success, strata, "share")
    both = np.asarray((agent.success > 0.0).all(axis=1) & (rival.success > 0.0).all(axis=1)) | (measure == "time")
    if not both.any():
        return Difference(math.nan, math.nan, math.nan, math.nan)
    scale = float(rival.cost[both].mean())
    strata_of_both = [stratum for stratum, there in zip(strata, both, strict=True) if there]
    return difference(-agent.cost[both] / scale, -rival.cost[both] / scale, strata_of_both)


@dataclasses.dataclass(frozen=True)
class Finding:
    """The verdict, and what it comes from."""

    verdict: str
    gains: Mapping[str, Difference]  # of the agent against each side that there is
    ps: Mapping[str, float]  # of them, as they were judged
    measured: float  # what the gate looked at; NaN without one


def judge(
    claim: Claim, sides: Mapping[str, Driven], strata: Sequence[str], corrected: Mapping[str, float] | None = None
) -> Finding:
    """Returns the verdict.

    Better is a difference whose 95 % interval lies above 0 and whose p is below 0.05. The verdict is

    - none, where the rival as the source has it misses the printed number by more than the margin;
    - HOLDS, where the agent is better than the tuned rival, and than (c) where there is one;
    - OPEN, where it is better than the tuned rival and not than (c), no rival was tuned, the interval against the
      tuned one reaches beyond the margin, or the agent was trained for less than the source's;
    - ONLY_UNTUNED, where it is better than the untuned rival alone;
    - DOES_NOT_HOLD otherwise.

    Args:
        corrected: p against each side, corrected for all comparisons of a page; None: the claim stands alone.
    """
    margin = MARGINS[claim.measure]
    gains = {name: gain(sides[AGENT], each, strata, claim.measure) for name, each in sides.items() if name != AGENT}
    ps = {name: each.p for name, each in gains.items()} if corrected is None else corrected
    measured = math.nan
    if claim.gate is not None and UNTUNED in sides:
        here = sides[UNTUNED].share if claim.measure == "success" else sides[UNTUNED].mean_cost
        measured = here if claim.gate.calibrated is None else claim.gate.calibrated
        if not abs(measured - claim.gate.number) <= (1.0 if claim.measure == "success" else claim.gate.number) * margin:
            return Finding(NO_VERDICT, gains, ps, measured)

    def better(name: str) -> bool:
        return name in gains and gains[name].low > 0.0 and ps[name] < SIGNIFICANT

    tuned = gains.get(TUNED)
    if better(TUNED):
        verdict = HOLDS if ALSO not in gains or better(ALSO) else OPEN
    elif tuned is None or not tuned.high <= margin or not claim.as_long:
        verdict = OPEN
    else:
        verdict = ONLY_UNTUNED if better(UNTUNED) else DOES_NOT_HOLD
    return Finding(verdict, gains, ps, measured)


LABELS = {AGENT: "claimed", UNTUNED: "(a)", TUNED: "(b)", ALSO: "(c)", BESIDE: "beside"}


def measured_words(claim: Claim, side: Driven) -> str:
    """Returns success and cost of a side: the error or time of its successes; where times are compared, of all."""
    if claim.measure == "error":
        cost = f"{1000.0 * side.mean_cost:.2f} mm"
    elif claim.measure == "time":
        cost = f"{side.cost.mean():.2f} s"
    else:
        cost = f"{side.mean_cost:.1f} s"
    return f"{100.0 * side.share:.1f} %, {cost}"


def gate_words(claim: Claim, measured: float) -> str:
    """Returns what the gate came to; "" without one."""
    if claim.gate is None:
        return "the source prints no number of (a) to compare with"
    unit, factor = ("%", 100.0) if claim.measure == "success" else ("s", 1.0)
    here = "(a)" if claim.gate.calibrated is None else "here"
    printed = f"printed {factor * claim.gate.number:.1f} {unit}"
    return f"{here} {factor * measured:.1f} {unit}, {printed} ({claim.gate.words})"


def lines_of(claim: Claim, finding: Finding, sides: Mapping[str, Driven], scenes: int) -> Iterator[str]:
    """Yields the lines of a claim: what was driven, what it comes to, and what differs."""
    yield claim.sentence
    yield f"  {claim.source}"
    for line in claim.differs:
        yield f"  differs: {line}"
    for name, side in claim.sides.items():
        seeds = f", {sides[name].success.shape[1]} seeds" if sides[name].success.shape[1] > 1 else ""
        yield f"  {LABELS[name]:8} {side.words}: success {measured_words(claim, sides[name])} (n = {scenes}{seeds})"
    for name, each in finding.gains.items() if finding.verdict != NO_VERDICT else ():
        yield f"  against {LABELS[name]}: {shown(each, claim.measure)}"
    yield f"  gate: {gate_words(claim, finding.measured)}"
    yield f"  verdict: {finding.verdict} (of this claim alone; docs/results/papers.md corrects for all claims)"


def shown(difference: Difference, measure: Measure) -> str:
    """Returns a difference with its interval, in points of success, or per cent less or more."""
    value, ends = 100.0 * difference.value, (100.0 * difference.low, 100.0 * difference.high)
    if math.isnan(value):
        return "not known"
    sign, unit = "+", "points"
    if measure != "success":
        sign, unit = "", f"% {'less' if value >= 0.0 else 'more'} {measure}"
        value, ends = abs(value), ends if value >= 0.0 else (-ends[1], -ends[0])
    interval = "" if math.isnan(ends[0]) else f" [{ends[0]:{sign}.1f}, {ends[1]:{sign}.1f}]"
    return f"{value:{sign}.1f}{interval} {unit}"


def of_rows(claim: Claim, rows: Iterable[Mapping[str, Any]]) -> tuple[Finding, dict[str, Driven], list[str]]:
    """Returns the verdict of rows of a claim, what each side did, and the family of each scene."""
    sides, strata = gathered(rows)
    return judge(claim, sides, strata), sides, strata


def written(rows: Iterable[Mapping[str, str]]) -> bytes:
    """Returns rows as the content of a CSV file."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()
