"""The agents of teams, and among people, beside the laws that they are to beat: python benchmarks/studies/flocks.py

All drive the same worlds, from the same starts, with the same scan and actuators. A world is the unit: solved if every
robot arrives and nobody touches anything. Differences are paired by world, and the mean over the seeds of training; the
interval, of 95 %, is over worlds, stratified by family, and over seeds. Extra time is compared in worlds that both
solve. An outcome is better or worse, corrected for all comparisons of the page; equivalent, where the interval lies
within MARGIN; ahead or behind, not significantly, where the interval alone says so; or a tie. What to take is
decided by `taken` alone, on the page and in docs/choosing.md. Rows are kept as CSV, and the page is made of them; what
is there already is not driven again, so that the parts may be driven one by one. Rows of agents or laws that have
changed since are to be taken away first:

    python benchmarks/studies/flocks.py --drive teams --policies orca_team,team_guided
    python benchmarks/studies/flocks.py --drive people
    python benchmarks/studies/flocks.py --drive cross
    python benchmarks/studies/flocks.py --curves results/team_scan --curves results/people
    python benchmarks/studies/flocks.py --film docs/doorway.gif
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import gymnasium
import numpy as np
from numpy.typing import NDArray
from part_rows import Part, Row, drive_missing, read, table, write
from results_page import between, versus

from wayfield import policies
from wayfield.benchmarks.contests import ALL_CONTESTS, CROSS, PUBLIC_SPLIT, Contest, Course, Entrants
from wayfield.benchmarks.contests.crowds import CLOCK as CROWDNAV_CLOCK
from wayfield.benchmarks.leaderboards.verdicts import BETTER, EQUIVALENT, MARGIN, OPEN, WORSE, outcome
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.aggregates import interval, mean
from wayfield.benchmarks.statistics.crossed import enough
from wayfield.benchmarks.statistics.paired import difference as paired
from wayfield.benchmarks.statistics.paired import holm
from wayfield.envs.scenarios.people_families import PEOPLE_FAMILIES
from wayfield.envs.scenarios.team_families import TEAM_FAMILIES
from wayfield.policies.learned.agent import CARD, read_card
from wayfield.policies.parts.tuned import tuned_set
from wayfield.policies.pilot import Pilot
from wayfield.policies.trained.ppo import shipped, shipped_agent, trained
from wayfield.policies.training.checkpoints import IN_FIELD
from wayfield.policies.training.curves import read_curve
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

Array = NDArray[np.float64]

ENV_ID, ROBOT, SPEED, CLOCK = "wayfield/OmniTeam-v0", "omni3", 0.6, 2400
SEEN: dict[str, Any] = {"actuators": "lagged", "num_beams": 72, "max_range": 5.0, "sees": "bodies"}
LARGE = 16  # robots, over which fewer worlds are driven
TESTED = 32  # robots, up to which teams are meant to be driven by what learned in teams of 8
UP_TO = f"up to {TESTED} robots"
AHEAD, BEHIND = "ahead", "behind"  # outcomes by the interval alone
LEAST_SEEDS = 3  # of training, under which nothing is claimed

TUNED = " tuned"  # behind the name of a law, of the gains that `tune` found for teams
_ORCAS = ("orca_team", f"orca_team{TUNED}")
_FORCES = ("social_force", f"social_force{TUNED}")
_DEAR = ("mppi", "nav2_dwb")  # a millisecond a decision: they drive teams of up to 4 alone
# among people, the first three with both gains
_SCANNING = (*(f"{a}{b}" for a in ("vfh_plus", "dwa", "scan_planner") for b in ("", TUNED)), "any_robot", *_DEAR)
_BY_SCAN = ("vfh_plus", f"vfh_plus{TUNED}", "dwa", "scan_planner", "any_robot", *_DEAR)
# so that a table is no wider than a page
SHORT = {_ORCAS[1]: "tuned", "team_guided": "guided", "team_scan": "scan"} | dict(
    zip(_FORCES, ("force", f"force{TUNED}"), strict=True)
)
# each agent, with whom it is compared; those that see the scan alone also with laws that see more
RIVALS = {
    "team_scan": (*_ORCAS, "ppo", *_BY_SCAN),
    "team_guided": (*_ORCAS, *_FORCES, "ppo"),
    "ppo": (*_ORCAS, *_BY_SCAN),
    "hybrid": ("ppo", f"vfh_plus{TUNED}", "scan_planner"),
}
AMONG_PEOPLE = {
    "people_free": (*_ORCAS, *_FORCES, "ppo", *_SCANNING),
    "ppo": _SCANNING,
    "hybrid": ("ppo", "scan_planner", f"scan_planner{TUNED}"),
}
AGENTS = {
    "team_guided": "teams_guided",
    "team_scan": "teams_scan",
    "people_free": "people_free",
    "ppo": "goal_reaching",
    "hybrid": "goal_reaching",
}
SEEKERS = ("ppo", "hybrid")  # agents of one robot among obstacles, which see others in their scan
ABBREVIATED = (
    f"`tuned` is `{_ORCAS[1]}`; `guided`, `scan` and `force` are `team_guided`, `team_scan` and `social_force`."
)
# those of one kind of field together, in the order of the page
KINDS = {"open": False, "walls": True}  # whether families are walled
TURNED = "circle_exact"  # a size is one circle, turned: one world; the sizes are one stratum
CROSSED = ("orca_team", "social_force", "vfh_plus", "team_guided", "team_scan")
CROSS_FAMILIES = ("circle_8", "open_8", "doorway_4", "corridor_8", "intersection_8")
# at 1 m/s CrowdNav's 500 tests and, for as long as AttnGraph gives its robot, its crowd; then our families
PEOPLE_CONTESTS: Mapping[str, Contest] = {
    name: ALL_CONTESTS[name] for name in ("crowdnav", "crowdnav-seen", "attngraph", "people-unseen", "people-seen")
}
CASES, CROWDS = 500, 100  # of CrowdNav, of AttnGraph
DISCOMFORT = 0.2  # m between hulls, of CrowdNav

TEAM_FIELDS = ("family", "world", "policy", "solved", "arrived", "touched", "extra_time")
_MEASURED = (
    "success", "collision", "touched_person", "caused", "extra_time", "time", "least_gap_people", "intimate_share",
    "personal_share", "people_slowed",
)  # fmt: skip
_ASIDE = ("extra_time", "intimate_share", "personal_share")  # compared where both succeed
PEOPLE_FIELDS = ("contest", "family", "world", "policy", *_MEASURED)
CROSS_FIELDS = ("family", "world", "policy", "beside", "success", "arrived", "arrived_beside")
CURVE_FIELDS = ("preset", "seed", "frames", "field", "success")


# ---- the drives


def drive(policy: Any, family: str, worlds: int, dynamics: str = "kinematic") -> list[tuple[bool, float, float, float]]:
    """Returns of each world whether it was solved, the shares that arrived and touched, and the extra time (s)."""
    robots = TEAM_FAMILIES[family].team
    options: dict[str, Any] = {"scenario": f"{family}/claims", "max_episode_steps": CLOCK, "dynamics": dynamics, **SEEN}
    env: Any = gymnasium.make_vec(ENV_ID, worlds * robots, **options).unwrapped
    pilot = Pilot(policy, env)
    steps, arrived, touched = first_episodes(env, pilot, np.repeat(np.arange(worlds), robots))
    straight = np.concatenate([each.straight for each in env.task.scenarios[:worlds]])
    extra = (steps * env.task.options.dt - straight / SPEED).reshape(worlds, robots)
    came = arrived.reshape(worlds, robots)
    shares = touched.reshape(worlds, robots).mean(axis=1)
    return [
        (bool(came[w].all()), float(came[w].mean()), float(shares[w]), float(extra[w].mean())) for w in range(worlds)
    ]


def first_episodes(env: Any, pilot: Pilot, indices: NDArray[Any]) -> tuple[Array, NDArray[Any], NDArray[Any]]:
    """Returns of each row's first episode its steps, whether it arrived, and whether it touched anything.

    Args:
        indices: of the scenario of each row (b,).
    """
    seen, _ = env.reset(seed=0, options={"scenario": indices})
    pilot.reset()
    alive = np.ones(len(indices), np.bool_)
    steps, arrived, touched = np.zeros(len(alive)), np.zeros(len(alive), np.bool_), np.zeros(len(alive), np.bool_)
    while alive.any():
        seen, _, terminated, truncated, info = env.step(pilot.command(seen))
        steps += alive
        ended = alive & (terminated | truncated)
        arrived[ended], touched[ended] = info["success"][ended], info["collision"][ended]
        alive &= ~ended
    return steps, arrived, touched


def entries(name: str) -> list[str]:
    """Returns a law's name, or of a trained policy a name a seed."""
    if name not in AGENTS:
        return [name]
    return [f"{name} seed {seed}" for seed in (few(name) if name == "hybrid" else shipped(AGENTS[name], ROBOT))]


def few(name: str) -> list[int]:
    """Returns the first seeds of an agent, as many as a claim needs: those that drive where all would take hours."""
    return list(shipped(AGENTS[name], ROBOT))[:LEAST_SEEDS]


def seeker(name: str, seed: int, speed: float = SPEED) -> Any:
    """Returns an agent of SEEKERS."""
    if name == "hybrid":
        return policies.make(name, seed=seed, speed=speed)
    return shipped_agent(AGENTS[name], ROBOT, seed, speed)


@dataclasses.dataclass(frozen=True)
class Seeker:
    """An agent of one robot among obstacles as an entrant in contests that no agent of its name was trained for."""

    name: str
    gains: Mapping[str, Any]
    gains_name: str = "trained"

    def make(self, gains: Mapping[str, Any]) -> Any:
        """Returns the agent of a seed, at a speed (m/s) or the asked one."""
        return seeker(self.name, **gains)

    def cruising(self, speed: float) -> dict[str, Any]:
        """Returns the gains that make it cruise at a speed (m/s)."""
        return {"speed": speed}

    def described(self) -> tuple[str, str]:
        """Returns nothing: its card says it."""
        return "", ""


def policy_of(entry: str) -> Any:
    """Returns the policy of an entry of a team, at the asked speed."""
    name, _, seed = entry.partition(" seed ")
    if name in SEEKERS:
        return seeker(name, int(seed))
    if name.endswith(TUNED):
        law = name.removesuffix(TUNED)
        return policies.make(law, **{**policies.tuned_gains(law, "teams", ROBOT, SPEED), "max_speed": SPEED})
    return policies.make(name, **({"seed": int(seed)} if seed else policies.cruising(name, {}, SPEED)))


def team_parts(
    names: Sequence[str], families: Sequence[str], worlds: int, large: int, dynamics: str = "kinematic"
) -> Iterator[Part]:
    """Yields the parts of the teams: an entry in a family."""
    for family in families:
        count = large if TEAM_FAMILIES[family].team > LARGE else worlds
        for entry in (each for name in names for each in entries(name)):

            def drives(entry: str = entry, family: str = family, count: int = count) -> list[Sequence[Any]]:
                decisions = drive(policy_of(entry), family, count, dynamics)
                return [(int(a), f"{b:.4f}", f"{c:.4f}", f"{d:.2f}") for a, b, c, d in decisions]

            yield {"family": family, "policy": entry}, drives


def is_of(kind: str, family: str) -> bool:
    """Returns whether a family of teams is of a kind of KINDS."""
    return TEAM_FAMILIES[family].walled == KINDS[kind]


def _rows_of(setting: Setting) -> list[Mapping[str, Any]]:
    return [row for row, _ in episodes(setting)]


def cases(
    contest: Contest, course: Course, names: Sequence[str], count: int, dynamics: str = "kinematic"
) -> Iterator[tuple[str, str, Callable[[], list[Mapping[str, Any]]]]]:
    """Yields of each case of a contest the entry, who drives beside it, and what returns its rows.

    A law for which no search found better gains has no entry of tuned ones.
    """
    for gains_name, of_law in (("default", ""), ("tuned", TUNED)):
        laws = [name.removesuffix(TUNED) for name in names if name.endswith(TUNED) == bool(of_law)]
        seekers = [name for name in laws if name in SEEKERS]
        own = [Seeker(name, {"seed": seed}) for name in seekers for seed in few(name)]
        entrants = Entrants(tuple(name for name in laws if name not in seekers), (gains_name,), own=tuple(own))
        for case in contest.cases(ROBOT, course, entrants):
            if of_law and case.gains_name != gains_name:
                continue
            seed = f" seed {case.gains['seed']}" if "seed" in case.gains else ""
            setting = Setting(contest.name, case, dynamics, "lagged", 0, count, members=course.members[:count])
            yield f"{case.policy}{of_law}{seed}", case.beside, functools.partial(_rows_of, setting)


def people_parts(names: Sequence[str], worlds: int, dynamics: str = "kinematic") -> Iterator[Part]:
    """Yields the parts among people: an entry in a family of a contest."""
    for label, contest in PEOPLE_CONTESTS.items():
        courses, count = [Course(each, "claims") for each in PEOPLE_FAMILIES], worlds
        if label.startswith("crowdnav"):
            count = CASES
            courses = [Course("crowdnav", PUBLIC_SPLIT, "crowdnav", CROWDNAV_CLOCK, members=tuple(range(count)))]
        elif label == "attngraph":
            count = CROWDS
            courses = [Course("attngraph_20", "claims", steps=2 * CROWDNAV_CLOCK)]
        for course in courses:
            for entry, _, rows in cases(contest, course, names, count, dynamics):

                def drives(rows: Any = rows) -> list[Sequence[Any]]:
                    return [[_text(row[name]) for name in _MEASURED] for row in rows()]

                yield {"contest": label, "family": course.family, "policy": entry}, drives


def cross_parts(names: Sequence[str], worlds: int) -> Iterator[Part]:
    """Yields the parts of the cross-play: an entry beside another in a family; and each alone."""
    for family in CROSS_FAMILIES:
        course = Course(family, "claims")
        for label in ("teams", CROSS.name):
            for entry, beside, rows in cases(ALL_CONTESTS[label], course, names, worlds):
                if entry.partition(" seed ")[2] not in ("", "0"):
                    continue

                def drives(rows: Any = rows) -> list[Sequence[Any]]:
                    return [[_text(row[name]) for name in CROSS_FIELDS[4:]] for row in rows()]

                yield {"family": family, "policy": entry, "beside": beside or entry}, drives


def _text(value: Any) -> str:
    return "" if isinstance(value, float) and math.isnan(value) else f"{float(value):.4g}"


def curve_rows(folders: Sequence[Path]) -> Iterator[Row]:
    """Yields the successes of runs at each validation, by field."""
    for folder in folders:
        for seed in trained(str(folder)):
            curve = read_curve(folder / f"seed_{seed}")
            fields = [name for name in curve if name.startswith(IN_FIELD)]
            for k, frames in enumerate(curve["frames"]):
                for name in fields or ["success"]:
                    place = name.removeprefix(IN_FIELD)
                    cells = (folder.name, seed, int(frames), place, f"{curve[name][k]:.3f}")
                    yield dict(zip(CURVE_FIELDS, map(str, cells), strict=True))


# ---- the film

FILMED, FILM_PX, FILM_SKIP, FILM_FRAMES, FILM_PACE = "bottleneck_32/claims", 300, 12, 104, 8.0


def film(rows: Sequence[Row]) -> bytes:
    """Returns a GIF of 32 robots that leave a room by one door: an agent's, and ORCA's from the same starts.

    The agent's seed is the median one, by the robots that arrive in rows of the filmed family.
    """
    from PIL import Image, ImageDraw

    from wayfield.benchmarks.figures.video import gif

    arrived = dict.fromkeys(entries("team_guided"), 0.0)  # of each seed
    for row in rows:
        if row["family"] == FILMED.partition("/")[0] and row["policy"] in arrived:
            arrived[row["policy"]] += float(row["arrived"])
    seeds = sorted(arrived, key=arrived.__getitem__)
    reels = []
    for entry in (seeds[len(seeds) // 2], "orca_team"):
        env: Any = gymnasium.make(ENV_ID, scenario=FILMED, render_mode="rgb_array", **SEEN)
        pilot = Pilot(policy_of(entry), env)
        seen, _ = env.reset(seed=0, options={"scenario": 0})
        pilot.reset()
        frames = []
        for step in range(FILM_FRAMES * FILM_SKIP):
            if step % FILM_SKIP == 0:
                image = Image.fromarray(env.render())
                image = image.resize((FILM_PX, FILM_PX * image.height // image.width), Image.Resampling.LANCZOS)
                pen = ImageDraw.Draw(image)
                pen.rectangle((0, 0, FILM_PX, 16), fill=(255, 255, 255))  # over the renderer's own line, too small here
                pen.text((8, 3), entry.partition(" ")[0], fill=(0, 0, 0))
                frames.append(image)
            seen, _, terminated, truncated, _ = env.step(pilot.act(seen))
            if terminated or truncated:
                break
        env.close()
        reels.append(frames)
    sheets = []
    for k in range(max(map(len, reels))):
        both = [each[min(k, len(each) - 1)] for each in reels]
        sheet = Image.new("RGB", (2 * FILM_PX, both[0].height))
        for place, image in enumerate(both):
            sheet.paste(image, (place * FILM_PX, 0))
        sheets.append(sheet)
    return b"".join(gif(map(np.asarray, sheets), 0.05 * FILM_SKIP / FILM_PACE))


# ---- the tables


def by_world(rows: Iterable[Row], name: str, metric: str) -> dict[tuple[str, ...], list[float]]:
    """Returns a number of a policy in each world, by contest, family and world: a value a seed, NaN where none."""
    values: dict[tuple[str, ...], list[float]] = {}
    for row in rows:
        if row["policy"].partition(" seed ")[0] == name:
            values.setdefault(_world(row), []).append(float(row[metric] or "nan"))
    return values


class Less(NamedTuple):
    """A number of one policy less that of another, over the worlds of both; NaN where nothing is said of more."""

    value: float
    low: float  # of the 95 % interval
    high: float
    p: float  # of no difference, before any correction
    worlds: int
    share: bool  # whether it is of a share
    limit: float = 0.0  # of `Difference`
    alike: float = math.nan  # the mean over families of their means

    @property
    def shown(self) -> str:
        """Returns it with its interval; points of a share."""
        if not self.worlds:
            return ""
        scale, digits = (100.0, 1) if self.share else (1.0, 2)
        ends = "" if math.isnan(self.low) else f" [{scale * self.low:+.{digits}f}, {scale * self.high:+.{digits}f}]"
        return f"{scale * self.value:+.{digits}f}{ends}"

    def outcome(self, page: Sequence[float]) -> str:
        """Returns what it says of successes, corrected by Holm's method for a page's comparisons, given by their p.

        Who fails more often by the interval alone is no tie, as `leaning` has it.
        """
        words = outcome(self.low, self.high, holm([*page, self.p])[-1], MARGIN, self.limit)
        return leaning(words, self.low, self.high)

    def pace(self, page: Sequence[float]) -> str:
        """Returns what it says of a time, likewise corrected: "faster", "slower", or "" where neither is shown."""
        words = outcome(-self.high, -self.low, holm([*page, self.p])[-1], 0.0)
        return {BETTER: "faster", WORSE: "slower"}.get(words, "")


def leaning(words: str, low: float, high: float) -> str:
    """Returns an outcome; of a tie that the interval alone decides, "ahead" or "behind, not significantly"."""
    if words == OPEN and (low > 0.0 or high < 0.0):
        return f"{AHEAD if low > 0.0 else BEHIND}, not significantly"
    return words


def less(rows: Sequence[Row], agent: str, law: str, metric: str, solved: str = "") -> Less:
    """Returns what an agent has more of than a law.

    Args:
        solved: the metric of a success, where only worlds count that the law and all seeds of the agent solve.
    """
    mine, theirs = by_world(rows, agent, metric), by_world(rows, law, metric)
    keys = [key for key in mine if key in theirs]
    if solved:
        ok = [by_world(rows, name, solved) for name in (agent, law)]
        keys = [key for key in keys if all(min(each[key]) == 1.0 for each in ok)]
    keys = [key for key in keys if np.isfinite(mine[key]).all() and np.isfinite(theirs[key]).all()]
    if not keys:
        return Less(math.nan, math.nan, math.nan, math.nan, 0, metric in _SHARES)
    a, b = (np.array([each[key] for key in keys]) for each in (mine, theirs))
    strata = ["/".join(key[:2]) for key in keys]
    if solved and not enough(strata):  # few are left of some families: all together
        strata = ["" for _ in keys]
    pair = paired(a, b, strata, "share" if metric in ("solved", "success") else "mean")
    gaps = a.mean(axis=1) - b.mean(axis=1)
    families = np.unique(strata, return_inverse=True)[1]
    alike = float((np.bincount(families, gaps) / np.bincount(families)).mean())
    return Less(pair.value, pair.low, pair.high, pair.p, len(keys), metric in _SHARES, pair.limit, alike)


_SHARES = ("solved", "arrived", "touched", "success", "collision", "touched_person", "intimate_share", "personal_share")


def share(rows: Sequence[Row], name: str, metric: str, digits: int = 1, factor: float = 100.0) -> str:
    """Returns the mean of a number over worlds, of several seeds with the least and the greatest."""
    of_seeds: dict[str, list[float]] = {}
    for row in rows:
        if row["policy"].partition(" seed ")[0] == name and row[metric]:
            of_seeds.setdefault(row["policy"], []).append(factor * float(row[metric]))
    if not of_seeds:
        return ""
    seeds = np.array([np.mean(each) for each in of_seeds.values()])
    shown = f"{seeds.mean():.{digits}f}"
    least, most = (f"{end:.{digits}f}" for end in (seeds.min(), seeds.max()))
    return shown if least == most else f"{shown} ({least} to {most})"


def collisions(rows: Iterable[Row], name: str) -> str:
    """Returns in how many worlds somebody touched something, in per cent, as `share`."""
    struck = [{**row, "collision": str(int(float(row.get("collision") or row["touched"]) > 0.0))} for row in rows]
    return share(struck, name, "collision")


def complete(rows: Sequence[Row], names: Sequence[str]) -> list[Row]:
    """Returns the rows of the worlds in which all of some policies, with all of their seeds, have driven."""
    mine = [row for row in rows if row["policy"].partition(" seed ")[0] in names]
    driven_in: dict[tuple[str, ...], set[str]] = {}
    for row in mine:
        driven_in.setdefault(_world(row), set()).add(row["policy"])
    everybody = {row["policy"] for row in mine}
    return [row for row in mine if driven_in[_world(row)] == everybody]


def independent(rows: Iterable[Row]) -> list[Row]:
    """Returns the rows of one world of each family whose worlds are one scene turned, and those of all others."""
    return [row for row in rows if not row["family"].startswith(TURNED) or row["world"] == "0"]


def _world(row: Row) -> tuple[str, ...]:
    """Returns the contest, the stratum and the world in it."""
    if row["family"].startswith(TURNED):
        return row.get("contest", ""), TURNED, f"{row['family']} {row['world']}"
    return row.get("contest", ""), row["family"], row["world"]


def seeds_of(rows: Iterable[Row], agent: str) -> int:
    """Returns how many seeds of an agent have rows."""
    return len({row["policy"] for row in rows if row["policy"].startswith(f"{agent} seed")})


def taken(first: str, other: str, change: Less, page: Sequence[float], seeds: int, seeing: bool = False) -> str:
    """Returns which of two to take, by what the first solves more than the other.

    Where that is not significant, or an agent has too few seeds for a claim, a controller goes before an agent, of two
    of a kind the one that is ahead, else the one that sees less, unless bodies are seen anyway (`seeing`), else the one
    that solved more.
    """
    verdict = change.outcome(page).partition(", ")[0]
    alike = (first in AGENTS) == (other in AGENTS)
    if seeds >= LEAST_SEEDS and (verdict in (BETTER, WORSE) or (alike and verdict in (AHEAD, BEHIND))):
        return first if verdict in (BETTER, AHEAD) else other

    def cost(name: str) -> tuple[bool, bool]:
        return name in AGENTS, name not in LEAST_ACCESS and not seeing

    if cost(first) != cost(other):
        return min(first, other, key=cost)
    return other if change.value < 0.0 else first


class Compared(NamedTuple):
    """A comparison of successes that a page says in a sentence."""

    agent: str
    law: str
    what: str
    difference: Less
    later: Less  # in extra time (s), in worlds that both solve
    seeds: int
    where: str  # families of one kind, or a contest
    cells: tuple[str, ...]  # of its line in a table, behind the rival and before the outcome

    def line(self, page: Sequence[float]) -> list[str]:
        """Returns its line in a table, corrected as `Less.outcome`."""
        said = self.difference.outcome(page) if self.seeds >= LEAST_SEEDS else "too few seeds"
        return [self.law, *self.cells, said.replace("not significantly", "n. s.")]

    def sentence(self, page: Sequence[float]) -> str:
        """Returns what it says, corrected as `Less.outcome`."""
        agent, law, shown = self.agent, self.law, f"{self.what}: {self.difference.shown} points"
        take = taken(agent, law, self.difference, page, self.seeds)
        if self.seeds < LEAST_SEEDS:
            seeds = f"{self.seeds} of the {LEAST_SEEDS} seeds that a claim needs"
            return f"{agent} vs. {law}, {shown}, with {seeds}: take {take}."
        verdict, _, how = self.difference.outcome(page).partition(", ")
        words = {
            BETTER: f"{agent} solves more than {law}",
            WORSE: f"{agent} solves less than {law}",
            EQUIVALENT: f"{agent} and {law} are equivalent within {100.0 * MARGIN:g} point",
            AHEAD: f"{agent} is ahead of {law}, {how}",
            BEHIND: f"{agent} is behind {law}, {how}",
        }.get(verdict, f"{agent} and {law} tie")
        pace = self.later.pace(page) if verdict in (OPEN, EQUIVALENT) else ""
        timed = f"; {agent} is {pace}: {self.later.shown} s" if pace else ""
        return f"{words}, {shown}{timed}: take {take}."


Tables = tuple[list[Compared], Callable[[Sequence[float]], str]]  # and what shows them, given the page's p


def hardest(comparisons: Iterable[Compared]) -> list[Compared]:
    """Returns of each agent and place the comparison with the best of the agents, and of the laws of each access."""
    best: dict[tuple[str, str, bool, bool], Compared] = {}
    for each in comparisons:
        key = each.agent, each.where, each.law in AGENTS, each.law in LEAST_ACCESS
        if key not in best or each.difference.value < best[key].difference.value:
            best[key] = each
    return list(best.values())


def team_tables(rows: Sequence[Row]) -> Tables:
    """Returns what agents of teams are shown to do beside their rivals, in comparisons and in tables."""
    rows = independent(rows)
    comparisons: list[Compared] = []
    for agent, rivals in RIVALS.items():
        seeds = seeds_of(rows, agent)
        for law in rivals if seeds else ():
            both = complete(rows, (agent, law))
            families = list(dict.fromkeys(row["family"] for row in both))
            if law not in {row["policy"].partition(" seed ")[0] for row in both}:
                continue
            small = [each for each in families if TEAM_FAMILIES[each].team <= TESTED]
            kinds = {"all": families} | ({} if small == families else {UP_TO: small})
            kinds |= {kind: [each for each in families if is_of(kind, each)] for kind in KINDS}
            for kind, members in kinds.items():
                here = [row for row in both if row["family"] in members]
                change = less(here, agent, law, "solved")
                count = len({row["family"] for row in here})
                if not change.worlds:
                    continue
                solved = [share(here, name, "solved") for name in (law, agent)]
                later = less(here, agent, law, "extra_time", "solved")
                more = f"{100.0 * change.alike:+.1f}", less(here, agent, law, "touched").shown, later.shown
                cells = (f"{kind}, {count}", str(change.worlds), *solved, change.shown, *more)
                what = f"in {len(families)} of {len(TEAM_FAMILIES)} families" if kind == "all" else f"{kind} alone"
                if kind == UP_TO:
                    what = f"in the {count} of them with {kind}"
                where = UP_TO if members == small else kind
                comparisons.append(Compared(agent, law, what, change, later, seeds, where, cells))
    return comparisons, functools.partial(_shown_teams, rows, comparisons)


def _shown_teams(rows: Sequence[Row], comparisons: Sequence[Compared], page: Sequence[float]) -> str:
    blocks = ["## Scenes solved"]
    header = [
        "rival", "families", "scenes", "solved: rival (%)", "agent (%)", "difference (points)", "mean of families",
        "collided (points)", "extra time (s)", "outcome",
    ]  # fmt: skip
    for agent in dict.fromkeys(each.agent for each in comparisons):
        lines = [each.line(page) for each in comparisons if each.agent == agent]
        blocks.append(f"### {agent}\n\n{table(lines, header)}")
    driven = dict.fromkeys(row["policy"].partition(" seed ")[0] for row in rows)
    families = [family for family in TEAM_FAMILIES if any(row["family"] == family for row in rows)]
    of = {family: [row for row in rows if row["family"] == family] for family in families}
    blocks.append(f"## Family by family\n\n{ABBREVIATED}")
    for metric, title in (("solved", "Worlds solved (%)"), ("arrived", "Robots that arrive (%)")):
        for bodies, seen in ((True, "that see bodies"), (False, "with a lidar only")):
            names = [name for name in driven if (name not in LEAST_ACCESS) == bodies]
            lines = [
                [family, *(share(here, name, metric, 0).replace(" to ", "-") for name in names)]
                for family, here in of.items()
            ]
            shown = table(lines, ["family", *(SHORT.get(name, name) for name in names)])
            blocks.append(f"{title}, policies {seen}.\n\n{shown}")
    return "\n\n".join(blocks)


def people_tables(rows: Sequence[Row]) -> Tables:
    """Returns what agents among people are shown to do beside laws, in comparisons and in tables."""
    comparisons: list[Compared] = []
    for label in PEOPLE_CONTESTS:
        here, names = _of_all(rows, label)
        for agent, laws in AMONG_PEOPLE.items():
            seeds = seeds_of(here, agent)
            for law in (each for each in laws if each in names and seeds):
                change = less(here, agent, law, "success")
                later, *aside = (less(here, agent, law, name, "success") for name in _ASIDE)
                cells = (str(change.worlds), *(each.shown for each in (change, later, *aside)))
                comparisons.append(Compared(agent, law, f"in {label}", change, later, seeds, label, cells))
    return comparisons, functools.partial(_shown_people, rows, comparisons)


def _of_all(rows: Sequence[Row], contest: str) -> tuple[list[Row], list[str]]:
    """Returns the rows of a contest in the scenes that all of its entries drove, and their names."""
    here = of_contest(rows, contest)
    ours = dict.fromkeys(each for agent, laws in AMONG_PEOPLE.items() for each in (*laws, agent))
    names = [name for name in ours if by_world(here, name, "success")]
    return complete(here, names), names


def _shown_people(rows: Sequence[Row], comparisons: Sequence[Compared], page: Sequence[float]) -> str:
    blocks = []
    for label in PEOPLE_CONTESTS:
        here, names = _of_all(rows, label)
        if not names:
            continue
        lines = [
            [
                name, share(here, name, "success"), share(here, name, "collision"), share(here, name, "caused"),
                share(here, name, "extra_time", 2, 1.0), share(here, name, "intimate_share"),
                share(here, name, "personal_share"), share(here, name, "people_slowed", 3, 1.0),
            ]
            for name in names
        ]  # fmt: skip
        header = [
            "policy", "success (%)", "collision (%)", "it moved towards (%)", "extra time (s)", "within 0.45 m (%)",
            "within 1.2 m (%)", "people slowed (m/s)",
        ]  # fmt: skip
        blocks.append(f"## {label}: {PEOPLE_CONTESTS[label].title}\n\n" + table(lines, header))
        if label == "crowdnav":
            blocks.append(CROWDNAV.format(printed=printed(here, names)))
        if label == "attngraph":
            blocks.append(ATTNGRAPH)
        for agent in AMONG_PEOPLE:
            lines = [each.line(page) for each in comparisons if (each.agent, each.where) == (agent, label)]
            header = [
                f"{agent} less", "scenes", "success (points)", "extra time (s)", "within 0.45 m (points)",
                "within 1.2 m (points)", "outcome",
            ]  # fmt: skip
            if lines:
                blocks.append(table(lines, header))
    return "\n\n".join(blocks)


# ---- the advice

CHOOSING = "choosing.md"  # beside the folder of results
BEGIN, END = "<!-- flocks: made by python benchmarks/studies/flocks.py -->", "<!-- end of flocks -->"
LEAST_ACCESS = ("team_scan", *SEEKERS, *_BY_SCAN, *_SCANNING)  # who see by beams alone; all others see bodies
PLACES: Mapping[str, tuple[str, Callable[[Row], bool]]] = {
    "Drive in a team, open field": ("solved", lambda row: is_of("open", row["family"])),
    "Drive in a team of up to 8, doors and rooms": (
        "solved",
        lambda row: is_of("walls", row["family"]) and not large(row),
    ),
    "Drive in a larger team, doors and rooms": ("solved", lambda row: is_of("walls", row["family"]) and large(row)),
    "Drive among people who avoid the robot": ("success", lambda row: row.get("contest") == "people-seen"),
    "Drive among people who ignore the robot": ("success", lambda row: row.get("contest") == "people-unseen"),
}


def large(row: Row) -> bool:
    """Returns whether a row is of more robots than an agent of teams was trained among."""
    return TEAM_FAMILIES[row["family"]].team > 8


def standing(rows: Sequence[Row], metric: str, name: str) -> tuple[float, float]:
    """Returns what sorts policies: how much they solve, the most first, and their extra time, s."""
    won, later = (np.concatenate([*by_world(rows, name, each).values()]) for each in (metric, "extra_time"))
    return -float(won.mean()), float(later[won == 1.0].mean()) if won.any() else math.inf


def _code(name: str) -> str:
    """Returns an entry as the page has it."""
    law = name.removesuffix(TUNED)
    return f"`{law}`" if law == name else f"`{law}` (tuned)"


def advice(teams: Sequence[Row], people: Sequence[Row]) -> str:
    """Returns what to take where, by access, as a table: who is `taken` beside each other, in the worlds of both."""
    lines: list[list[str]] = []
    page_ps, teams = of_page(teams, people), independent(teams)
    for place, (metric, there) in PLACES.items():
        rows = [row for row in (teams if metric == "solved" else people) if there(row)]
        names = list(dict.fromkeys(row["policy"].partition(" seed ")[0] for row in rows))
        names = [name for name in names if metric == "success" or name not in _DEAR]
        names.sort(key=functools.partial(standing, complete(rows, names), metric))

        def beats(first: str, other: str, seeing: bool, rows: list[Row] = rows, metric: str = metric) -> bool:
            both = complete(rows, (first, other))
            seeds = min((seeds_of(both, each) for each in (first, other) if each in AGENTS), default=LEAST_SEEDS)
            return taken(first, other, less(both, first, other, metric), page_ps, seeds, seeing) == first

        for access, able in (("lidar", [name for name in names if name in LEAST_ACCESS]), ("bodies", names)):
            if len(able) < 2:
                continue
            seeing = access == "bodies"
            best = next((a for a in able if all(beats(a, b, seeing) for b in able if b != a)), able[0])
            others = [name for name in able if name != best]
            # who takes a lidar where bodies are known is to be told what those bring
            following = ([name for name in others if seeing and name not in LEAST_ACCESS] or others)[0]
            both = complete(rows, (best, following))
            change, (won, later) = less(both, best, following, metric), standing(both, metric, best)
            lead = f"{versus(change.outcome(page_ps), _code(following))}: {change.shown} points"
            if pace := (times := less(both, best, following, "extra_time", metric)).pace(page_ps):
                lead += f"; {pace}: {times.shown} s"
            reached = f"{-100.0 * won:.1f} %, {later:.1f} s"
            lines.append([place, access, _code(best), reached, collisions(both, best), str(change.worlds), lead])
    header = ["task", "inputs", "choose", "solved, extra time", "with a collision (%)", "scenes"]
    header.append("compared with the next best")
    return table(lines, header)


def of_page(teams: Sequence[Row], people: Sequence[Row]) -> list[float]:
    """Returns the p of all comparisons of successes and of times that the page makes, before any correction."""
    return _ps([*team_tables(teams)[0], *people_tables(people)[0]])


def _ps(comparisons: Iterable[Compared]) -> list[float]:
    return [less.p for each in comparisons for less in (each.difference, each.later)]


def rival(rows: Sequence[Row], agents: Sequence[str], laws: Sequence[str], metric: str) -> tuple[str, str, list[Row]]:
    """Returns the agent and the law that solve most, of equals the quickest, and the rows of the worlds of both.

    Each is the best of its camp in the worlds of all of the camp: who drove few takes none from the other camp.
    """
    there = {row["policy"].partition(" seed ")[0] for row in rows}
    agent, law = (
        min((name for name in names if name in there), key=functools.partial(standing, complete(rows, names), metric))
        for names in (agents, laws)
    )
    return agent, law, complete(rows, (agent, law))


FrontPart = tuple[str, Sequence[str], Sequence[str], str, Sequence[Row]]  # where, agents, laws, metric, rows


def front_parts(teams: Sequence[Row], people: Sequence[Row]) -> Iterator[FrontPart]:
    """Yields what the page compares first: the best of some agents beside the best of some laws."""
    small = [row for row in independent(teams) if TEAM_FAMILIES[row["family"]].team <= TESTED]
    agents = tuple(agent for agent in RIVALS if agent in LEAST_ACCESS)
    laws = [law for law in RIVALS["team_scan"] if law not in AGENTS and law not in _DEAR]
    for where, kind in (("in the open", "open"), ("at doors and in rooms", "walls")):
        for what, bodies in (("lidar only", False), ("vs. controllers that see bodies", True)):
            those = tuple(law for law in laws if (law not in LEAST_ACCESS) == bodies)
            yield f"{where}, {what}", agents, those, "solved", of_kind(small, kind)
    for where, contest in (
        ("on CrowdNav's test cases", "crowdnav"),
        ("in AttnGraph's crowd", "attngraph"),
        ("among people who ignore the robot", "people-unseen"),
        ("among people who avoid the robot", "people-seen"),
    ):
        laws = [law for law in AMONG_PEOPLE["people_free"] if law not in AGENTS]
        yield where, (*AMONG_PEOPLE,), laws, "success", of_contest(people, contest)


def front(teams: Sequence[Row], people: Sequence[Row], page_ps: Sequence[float]) -> str:
    """Returns the page's first table, losses included, and a film with what it shows; page_ps: those of `of_page`."""
    lines = []
    for where, agents, laws, metric, rows in front_parts(teams, people):
        name, law, here = rival(rows, agents, laws, metric)
        change = less(here, name, law, metric)
        mine, theirs = ([f"`{each}`", share(here, each, metric), collisions(here, each)] for each in (name, law))
        later = less(here, name, law, "extra_time", metric)
        verdict = ", ".join(filter(None, (change.outcome(page_ps), later.pace(page_ps))))
        lines.append([where, *mine, *theirs, str(change.worlds), change.shown, verdict, later.shown])
    of_each = ["solved (%)", "collided (%)"]
    header = [
        "where", "best agent", *of_each, "best controller", *of_each, "scenes", "difference (points)",
        "outcome of the agent", "extra time (s)",
    ]  # fmt: skip
    filmed = [row for row in teams if row["family"] == FILMED.partition("/")[0]]
    out = {name: share(filmed, name, "arrived", 0) for name in ("team_guided", "orca_team", "vfh_plus")}
    return f"""The controller and the agent that solve most scenes, in teams of up to {TESTED}; in teams the agent has
a lidar only. Outcomes are corrected for the {len(page_ps)} comparisons of the tables below, of successes and of times.
`people_free` and `team_guided` drive on top of `orca_team`, `hybrid` along the way of `scan_planner`; `team_scan` and
`ppo` drive by themselves.

{table(lines, header)}

![32 robots leave a room by one door: team_guided (its median seed), and orca_team from the same starts](../doorway.gif)

Of {TESTED} robots at one door, `team_guided` brings {out["team_guided"]} % out and `orca_team` {out["orca_team"]} %;
`vfh_plus`, not in the film, {out["vfh_plus"]} % with a lidar only."""


def of_kind(rows: Iterable[Row], kind: str) -> list[Row]:
    """Returns the rows of one kind of field."""
    return [row for row in rows if is_of(kind, row["family"])]


def of_contest(rows: Iterable[Row], contest: str) -> list[Row]:
    """Returns the rows of one contest among people."""
    return [row for row in rows if row["contest"] == contest]


def pages(docs: Path, teams: Sequence[Row], people: Sequence[Row]) -> dict[Path, str]:
    """Returns what pages beside those of results say of them."""
    return {docs / CHOOSING: advice(teams, people)}


def advised(file: Path, advice: str) -> None:
    """Writes what is told between the markers of a page, if that is there."""
    if file.is_file():
        try:
            text = between(file.read_text(encoding="utf-8"), BEGIN, END, [advice])
        except ValueError as error:
            raise click.ClickException(f"{file.name} {error}") from None
        write_whole(file, text.encode())


def cross_table(rows: Sequence[Row]) -> str:
    """Returns who suffers from whom: of the line's robots how many arrive beside the column's."""
    names = list(dict.fromkeys(row["policy"] for row in rows))
    lines = []
    for name in names:
        cells = []
        for beside in names:
            others = (beside, beside.partition(" seed ")[0])
            mine = [row for row in rows if row["policy"] == name and row["beside"] in others]
            shares = np.array([float(row["arrived"]) for row in mine])
            ends = interval(shares, [row["family"] for row in mine], mean) if len(shares) else None
            shown = f"{100.0 * shares.mean():.1f}" if len(shares) else ""
            cells.append(shown if ends is None else f"{shown} [{100.0 * ends[0]:.1f}, {100.0 * ends[1]:.1f}]")
        lines.append([name, *cells])
    return table(lines, ["arrived (%)", *(f"beside {name}" for name in names)])


def curve_table(rows: Sequence[Row]) -> str:
    """Returns the successes at each validation, in the mean over seeds."""
    lines = []
    for preset in dict.fromkeys(row["preset"] for row in rows):
        mine = [row for row in rows if row["preset"] == preset]
        frames = sorted({int(row["frames"]) for row in mine})
        for field in dict.fromkeys(row["field"] for row in mine):
            shares = {
                at: [float(row["success"]) for row in mine if row["field"] == field and int(row["frames"]) == at]
                for at in frames
            }
            cells = [f"{at / 1e6:.1f}: {100.0 * np.mean(each):.0f}" for at, each in shares.items() if each]
            seeds = len({row["seed"] for row in mine})
            lines.append([preset, str(seeds), field, ", ".join(cells)])
    return table(lines, ["preset", "seeds", "field", "million frames: success (%)"])


# ---- the page


PROSE = """# Teams and crowds: trained agents vs. controllers

Made by `python benchmarks/studies/flocks.py`. How the policies were run:

- **Robots** are omni3 with `lagged` actuators and a lidar of 72 beams. The target speed is 0.6 m/s, in CrowdNav's cases
  and AttnGraph's crowd 1 m/s. A robot that arrives is taken out of the scene.
- **Scenes** are the first of each family in the split `claims`: {counts}. All scenes of a `circle_exact_*` are one
  circle, turned: they count as one scene, and these families as one family.
- **Controllers** have their default gains, unless called `tuned`. With the default gains `orca_team` does not give way
  at doors. {tuning} In teams no gains of `scan_planner`, `any_robot`, `mppi` and `nav2_dwb` were searched; among
  people those of controllers with a lidar in our own families only. `any_robot` has no network for omni3: it is
  `scan_planner` behind a shield that brakes.
- **Agents** were trained in other scenes of the same families; `people_free` drove more than half of its training on
  CrowdNav's circle. `team_guided` and `people_free` add to the command of `orca_team` with default gains; the collision
  avoidance of `orca_team` is applied to what `team_guided` adds. `ppo` was trained alone among obstacles: other robots
  are a part of its scan. `team_scan` is `ppo`, trained further in teams. `hybrid` is `ppo` on the way that
  `scan_planner` plans, with the planner's gains for goals: the first three seeds, as of `ppo` among people. At 1 m/s
  `ppo` drives faster than it was trained to.

How to read the numbers:

- A scene is **solved** if every robot arrives and none collides. Shares and differences are means over scenes. In
  `mean of families` every family counts the same, however many of its scenes were run.
- **Differences** are paired by scene. Brackets are 95 % intervals over scenes and training seeds. In parentheses are
  the lowest and the highest training seed.
- **Better** and **worse** are corrected for all comparisons of this page. **Ahead** and **behind, not significantly**
  are not: only the uncorrected interval excludes 0. **Equivalent** is an interval within one point, a **tie** all
  else.
- **Take** names the better one. Without a significant difference it names a controller before an agent; of two
  controllers or two agents, the one that is ahead, else the one with fewer inputs, else the one that solved more.
- **Extra time**, and the effects on people, are compared in scenes that both solve.
- **The list** below has of each agent and place the best rivals: an agent, a controller with a lidar only, one that
  sees bodies. The tables have all.

Not shown: other robots and noise; `polar`, which does not see others;
`orca_team_map` and `central`, which have the whole map or all goals. A decision of `scan_planner` takes 0.1 ms of a
core, of `mppi` 1.1, of `nav2_dwb` 1.8, of `nav2_mppi` 2.9. So `mppi` and `nav2_dwb` drove teams of up to 4 robots only,
in five scenes of a family, and are left out of the first table and of the advice for teams. `nav2_mppi` was not driven,
nor `team_scan` among people. An empty cell was not run.

[All results](../results.md)
"""


CROWDNAV = """Beside these, the cases by CrowdNav's own rules: a disc that takes up any velocity up to 1 m/s every
0.25 s. Here the robot, its period and its actuators are others, so none of the following is a rival. Time is of
successes, from start to goal; nearer than 0.2 m, between hulls, is CrowdNav's discomfort.

{printed}

*: Chen, Liu, Kreiss and Alahi, ICRA 2019, arXiv 1809.08835, Table I, invisible robot, read in others' notes: the paper
itself was not at hand, the notes differ on SARL by one point, and none has the discomfort. Log: the last two lines of
`crowd_nav/data/output-torch-1.7.0-converted/output.log` in CrowdNav's repository, which divides the steps in danger by
a sixteenth of all steps: its 0.34 are 2.1 % of the steps. RVO2's ORCA was driven here, by their rules."""
PRINTED = (
    ("ORCA*", "43", "57", "10.86", "", ""),
    ("ORCA of RVO2, driven here", "42.6", "", "10.86", "", ""),
    ("CADRL*", "78", "22", "10.80", "", ""),
    ("LSTM-RL*", "95", "3", "11.82", "", ""),
    ("SARL*", "99 or 100", "1 or 0", "10.55", "", ""),
    ("SARL, log", "100", "0", "10.58", "", "2.1"),
)


def printed(rows: Sequence[Row], names: Sequence[str]) -> str:
    """Returns CrowdNav's cases as others print them, below the policies of this page."""
    cases = [{**row, "near": str(int(float(row["least_gap_people"]) < DISCOMFORT))} for row in rows]
    reached = [row for row in cases if row["success"] == "1"]
    lines = [
        (
            f"`{name}`, as above", share(cases, name, "success"), share(cases, name, "collision"),
            share(reached, name, "time", 2, 1.0), share(cases, name, "near"), "",
        )
        for name in names
    ]  # fmt: skip
    header = [
        "whose", "success (%)", "collision (%)", "time (s)", "cases nearer than 0.2 m (%)", "steps nearer (%)",
    ]  # fmt: skip
    return table([*lines, *PRINTED], header)


ATTNGRAPH = """The logs in AttnGraph's repository have, for 500 crowds of its own: ORCA 69 % in 14.8 s, social force
34 %, its agent 92 % in 15.4 s. There a disc takes up any velocity up to 1 m/s at once, who has arrived is replaced by
somebody else, and the agent foresees ways. Here the robot, its period and its actuators are others: no rivals.

The gains of `orca_team tuned` and `social_force tuned` were searched in training scenes of this very crowd;
`people_free` had a tenth of its training there, most of it on CrowdNav's circle."""


def counts(rows: Mapping[str, Sequence[Row]]) -> str:
    """Returns how many worlds of a family each policy of each part drove and is counted in, in words."""
    sentences = []
    for part in ("teams", "people", "cross"):
        driven_by: dict[str, dict[str, set[str]]] = {}
        for row in independent(rows[part]):
            if row.get("contest", "people").startswith("people"):  # the others have all of their cases
                name = row["policy"].partition(" seed ")[0]
                driven_by.setdefault(name, {}).setdefault(row["family"], set()).add(row["world"])
        sizes = {name: sorted({*map(len, each.values())}) for name, each in driven_by.items()}
        words = [f"{name} {' or '.join(map(str, each))}" for name, each in sizes.items()]
        if words:
            sentences.append(f"{part}: {', '.join(words)}")
    return "; ".join(sentences)


def tuning() -> str:
    """Returns in sentences what searches of gains found, and what they and the training of agents were given."""
    rivals = itertools.chain(*RIVALS.values(), *AMONG_PEOPLE.values())
    suites: dict[str, list[str]] = {}
    for law in dict.fromkeys(each.removesuffix(TUNED) for each in rivals):
        for suite in ("teams", *PEOPLE_CONTESTS):
            rules = ALL_CONTESTS[suite].rules
            best = tuned_set(law, suite, ROBOT, rules.speed if rules else SPEED)
            if best is not None:
                none = "" if best.chosen != "default" else ", none better"
                suites.setdefault(law, []).append(f"{suite} {best.frames / 1e6:.1f}{none}")
    searched = "; ".join(f"`{law}`: {', '.join(each)}" for law, each in suites.items())
    agents = []
    for name in (each for each in AGENTS if each != "hybrid"):  # which is `ppo` behind a planner
        card = read_card(next(iter(shipped(AGENTS[name], ROBOT).values())) / CARD)
        agents.append(f"`{name}` {card['training']['run_frames'] / 1e6:.1f}")
    return (
        "Their gains were searched by `wayfield tune` in training scenarios of the suite, in million environment steps "
        f"(of teams, those of worlds): {searched}. Agents were trained in, a seed: {', '.join(agents)}."
    )


def page(teams: Sequence[Row], people: Sequence[Row], crossed: Sequence[Row], curves: Sequence[Row], prose: str) -> str:
    """Returns the page of the rows."""
    parts = [team_tables(teams)] if teams else []
    if people:
        parts.append(people_tables(people))
    comparisons = [each for compared, _ in parts for each in compared]
    ps = _ps(comparisons)
    blocks = [shown(ps) for _, shown in parts]
    if crossed:
        told = (
            "## Who suffers from whom\n\nEvery other robot, from the second on, is driven by the column's policy; on "
            f"the diagonal all are. Families {', '.join(CROSS_FAMILIES)}; agents of seed 0.\n\n{cross_table(crossed)}"
        )
        blocks.insert(len(blocks) - bool(people), told)
    if curves:
        told = "## Learning curves\n\nOn validation scenarios, of which ten of a family.\n\n" + curve_table(curves)
        blocks.append(told)
    first = [front(teams, people, ps)] if teams and people else []
    listed = "\n".join(f"* {each.sentence(ps)}" for each in hardest(comparisons))
    return "\n\n".join([prose.strip(), *first, listed, *blocks]) + "\n"


def page_of(folder: Path) -> tuple[dict[str, list[dict[str, str]]], str]:
    """Returns the kept rows of a folder by their part, and the page that they make."""
    rows = {name: read(folder / file) for name, file in FILES.items()}
    prose = PROSE.format(counts=counts(rows), tuning=tuning())
    return rows, page(rows["teams"], rows["people"], rows["cross"], rows["curves"], prose)


FILES = {
    "teams": "flocks.csv",
    "people": "flocks_people.csv.xz",
    "cross": "flocks_cross.csv",
    "curves": "flocks_curves.csv",
}


@click.command("flocks", cls=OneLineErrors)
@click.option(
    "--drive", "part", type=click.Choice(("teams", "people", "cross")), help="What is driven; default: nothing."
)
@click.option("--policies", "names", help="Comma-separated; default: all of the part.")
@click.option("--families", help="Of teams, comma-separated; default: all.")
@click.option("--worlds", default=20, show_default=True, type=click.IntRange(5, 100), help="Of a family.")
@click.option("--large", default=5, show_default=True, type=click.IntRange(5, 100), help="Where teams have over 16.")
@click.option("--curves", multiple=True, type=click.Path(exists=True, file_okay=False, path_type=Path), help="Runs.")
@click.option("--film", "reel", type=click.Path(path_type=Path, dir_okay=False), help="A GIF, of 32 robots at a door.")
@click.option("--out", default="docs/results", show_default=True, type=click.Path(path_type=Path, file_okay=False))
def main(
    part: str | None,
    names: str | None,
    families: str | None,
    worlds: int,
    large: int,
    curves: tuple[Path, ...],
    reel: Path | None,
    out: Path,
) -> None:
    """Drives what is missing of a part, and writes its rows and flocks.md."""
    out.mkdir(parents=True, exist_ok=True)
    chosen = list(TEAM_FAMILIES) if families is None else families.split(",")
    unknown = [each for each in chosen if each not in TEAM_FAMILIES]
    if unknown:
        raise click.UsageError(f"--families has {unknown[0]!r}; choose from {', '.join(TEAM_FAMILIES)}")
    of_part = {
        "teams": tuple(dict.fromkeys(each for agent, laws in RIVALS.items() for each in (*laws, agent))),
        "people": tuple(dict.fromkeys(each for agent, laws in AMONG_PEOPLE.items() for each in (*laws, agent))),
        "cross": CROSSED,
    }
    if part is not None:
        entrants = of_part[part] if names is None else tuple(names.split(","))
        unknown = [each for each in entrants if each not in of_part[part]]
        if unknown:
            raise click.UsageError(f"--policies has {unknown[0]!r}; choose from {', '.join(of_part[part])}")
        if part == "teams":
            drive_missing(out / FILES[part], TEAM_FIELDS, team_parts(entrants, chosen, worlds, large))
        elif part == "people":
            drive_missing(out / FILES[part], PEOPLE_FIELDS, people_parts(entrants, worlds))
        else:
            drive_missing(out / FILES[part], CROSS_FIELDS, cross_parts(entrants, worlds))
    if curves:
        write(out / FILES["curves"], CURVE_FIELDS, curve_rows(curves))
    if reel is not None:
        write_whole(reel, film(read(out / FILES["teams"])))
    rows, text_of_page = page_of(out)
    if rows["teams"] and rows["people"]:
        for file, advice in pages(out.parent, rows["teams"], rows["people"]).items():
            advised(file, advice)
    write_whole(out / "flocks.md", text_of_page.encode())


if __name__ == "__main__":
    main()
