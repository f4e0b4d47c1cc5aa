"""A driver for every robot away from home, beside laws that serve all: python benchmarks/studies/everywhere.py

Scenes are drawn from seeds that no split has, and proven as those of the splits are. In each condition all drive the
same scenes from the same starts with the same scan; scenes of a hull beyond 0.3 m are scaled for it. Rows are kept as
`everywhere.csv.xz`, and the page is made of them; cells that are there already are not driven again.
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np
from flocks import AHEAD, BEHIND, first_episodes, leaning
from part_rows import Part, drive_missing
from part_rows import table as text_of

from wayfield import policies
from wayfield.benchmarks.leaderboards.verdicts import BETTER, MARGIN, WORSE, outcome
from wayfield.benchmarks.statistics.paired import Difference, difference, holm
from wayfield.envs.robots import FULL_TURN, ROBOTS, Robot, Sensors
from wayfield.envs.scenarios import TASKS, GoalScenario
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.policies.parts.shield import Shielded
from wayfield.policies.pilot import Pilot
from wayfield.policies.trained.any_robot import agents_of
from wayfield.policies.trained.ppo import shipped
from wayfield.policies.training.drawn import robot_like
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

FIRST_SEED = 4_000_000  # no split goes so far
STILL = (
    *("clutter_5", "clutter_10", "clutter_15", "doors_narrow", "doors_medium", "u_traps_15", "u_traps_30"),
    *("corridors", "rooms", "near_goal"),
)
MOVING = ("moving_crossing", "moving_crowd", "moving_head_on", "moving_overtaking")
MORE = 2  # times as many scenes of a family that moves
LAWS = ("vfh_plus", "vfh_plus shielded", "scan_planner")
AGENT = "any_robot"
OWN, HOME, HALF = "ppo", "P3DX, home", "P3DX, 0.3 m/s"  # the agents of the P3DX alone, and where they drive too
FIELDS = ("condition", "family", "scene", "policy", "success", "collision", "seconds")
SCAN: dict[str, Any] = {"actuators": "lagged", "num_beams": 72, "max_range": 5.0}


@dataclasses.dataclass(frozen=True)
class Condition:
    """A robot, the speed (m/s) that it is asked for, and what its environment is made with."""

    name: str
    robot: Robot
    speed: float
    kwargs: dict[str, Any]


def _p3dx(name: str, speed: float = 0.6, **kwargs: Any) -> Condition:
    return Condition(name, ROBOTS["p3dx"], speed, SCAN | kwargs)


def _sheet(number: int, holonomic: bool, hull: float, speed: float, brakes: float, lag: float, scan: Any) -> Condition:
    """Returns a robot that is in no training, written down and not drawn, as a user would."""
    robot = robot_like(f"sheet_{number}", holonomic, hull, speed / 0.9, 2.2, brakes, 3.0 * brakes, lag, Sensors(*scan))
    title = f"sheet {number}: hull {hull:g} m, {speed:g} m/s, stops in {speed * lag + 0.5 * speed**2 / brakes:.2f} m"
    return Condition(title, robot, speed, {"actuators": "lagged"})


CONDITIONS = (
    _p3dx(HOME),
    _p3dx(HALF, 0.3),
    _p3dx("P3DX, 1.0 m/s", 1.0),
    _p3dx("P3DX, slow", actuators="slow"),
    _p3dx("P3DX, slow, 1.0 m/s", 1.0, actuators="slow"),
    _p3dx("P3DX, 32 beams", num_beams=32),
    _p3dx("P3DX, 180 beams", num_beams=180),
    _p3dx("P3DX, moderate", disturbance="moderate"),
    Condition("TurtleBot3", ROBOTS["turtlebot3"], 0.2, {"actuators": "lagged"}),
    Condition("Kobuki", ROBOTS["kobuki"], 0.6, {"actuators": "lagged"}),
    Condition(
        "Jackal, 270 degrees", ROBOTS["jackal"], 1.0,
        {"actuators": "lagged", "num_beams": 720, "field_of_view": 0.75 * FULL_TURN, "max_range": 30.0},
    ),
    _sheet(1, False, 0.15, 0.4, 1.5, 0.05, (48, 4.0, FULL_TURN)),
    _sheet(2, False, 0.22, 1.0, 0.8, 0.15, (120, 8.0, FULL_TURN)),
    _sheet(3, False, 0.45, 0.8, 0.6, 0.2, (180, 10.0, 0.75 * FULL_TURN)),
    _sheet(4, False, 0.12, 0.25, 0.4, 0.3, (32, 3.0, FULL_TURN)),
    Condition("mecanum4", ROBOTS["mecanum4"], 0.55, {"actuators": "lagged"}),
    _sheet(5, True, 0.2, 0.7, 1.0, 0.1, (90, 6.0, FULL_TURN)),
)  # fmt: skip


@functools.cache
def scenes(count: int) -> tuple[GoalScenario, ...]:
    """Returns so many scenes of each family that stands still, and twice as many of those that move."""
    spec = TASKS["goal_reaching"]
    scenarios: list[GoalScenario] = []
    for family in (*STILL, *MOVING):
        seed, wanted = FIRST_SEED, len(scenarios) + count * (MORE if family in MOVING else 1)
        while len(scenarios) < wanted:
            scenario = spec.families[family].make(seed)
            seed += 1
            if spec.feasible(scenario):
                scenarios.append(scenario)
    return tuple(scenarios)


def fitted(scenario: GoalScenario, hull: float) -> GoalScenario:
    """Returns a scene for a hull (m): fitted as the splits are to a small one, scaled to a large one."""
    if hull < LARGEST_HULL:
        return scenario.fitted(LARGEST_HULL - hull)
    return scenario.scaled(1.02 * hull / LARGEST_HULL, speeds=True)


def entries(condition: Condition) -> list[str]:
    """Returns who drives in a condition: nobody where no agent of the kinematic class ships."""
    if not (seeds := agents_of(condition.robot)):
        return []
    own = shipped("goal_reaching", "p3dx") if condition.name in (HOME, HALF) else ()
    return [*LAWS, *(f"{AGENT} seed {seed}" for seed in seeds), *(f"{OWN} seed {seed}" for seed in own)]


def policy_of(name: str, speed: float) -> Any:
    """Returns an entry at a speed (m/s)."""
    law, *rest = name.split()
    if "seed" in rest:
        return policies.make(law, seed=int(rest[1]), speed=speed)
    policy = policies.make(law, **policies.cruising(law, {}, speed))
    return Shielded(policy) if "shielded" in rest else policy


def drive(name: str, condition: Condition, bank: Sequence[GoalScenario]) -> list[tuple[bool, bool, float]]:
    """Returns of each scene whether an entry arrives, whether it collides, and the time (s)."""
    robot, speed = condition.robot, condition.speed
    env: Any = gymnasium.make_vec(
        TASKS["goal_reaching"].env_id(robot),
        len(bank),
        scenario=tuple(fitted(each, robot.hull_radius) for each in bank),
        robot=robot,
        max_episode_steps=round(TASKS["goal_reaching"].clock * 0.6 / min(speed, 0.6)),
        **condition.kwargs,
    ).unwrapped
    pilot = Pilot(policy_of(name, speed), env)
    steps, arrived, touched = first_episodes(env, pilot, np.arange(len(bank)))
    times = steps * env.task.options.dt
    env.close()
    return list(zip(arrived.tolist(), touched.tolist(), times.tolist(), strict=True))


def parts(count: int, only: Sequence[str]) -> Iterator[Part]:
    """Yields the parts: an entry in a condition."""
    for condition in (each for each in CONDITIONS if not only or each.name in only):
        for name in entries(condition):

            def drives(name: str = name, condition: Condition = condition) -> Iterator[Sequence[Any]]:
                # family by family, since all of a bank are driven until the last has ended
                for _, family in itertools.groupby(scenes(count), lambda scene: scene.family):
                    bank = list(family)
                    for scene, (success, collision, seconds) in zip(bank, drive(name, condition, bank), strict=True):
                        yield scene.family, scene.name, int(success), int(collision), f"{seconds:.2f}"

            yield {"condition": condition.name, "policy": name}, drives


class Results:
    """The rows, by condition, policy and scene."""

    def __init__(self, rows: Sequence[dict[str, str]]) -> None:
        self.rows = {(row["condition"], row["policy"], row["scene"]): row for row in rows}
        everybody = list(dict.fromkeys(row["policy"] for row in rows))
        self.own = [each for each in everybody if each.startswith(OWN)]
        self.names = [each for each in everybody if each not in self.own]
        self.seeds = [each for each in self.names if each.startswith(AGENT)]
        driven = {(row["condition"], row["policy"]) for row in rows}
        conditions = dict.fromkeys(condition for condition, _ in driven)
        self.conditions = [each.name for each in CONDITIONS if each.name in conditions
                           and all((each.name, name) in driven for name in self.names)]  # fmt: skip

    def of(self, name: str, field: str, moving: bool, conditions: Sequence[str]) -> dict[str, float]:
        """Returns the mean of a field over some conditions that a policy drove, by scene: all drive the same scenes."""
        values_by_scene: dict[str, list[float]] = {}
        for (condition, policy, scene), row in self.rows.items():
            if policy == name and condition in conditions and (row["family"] in MOVING) == moving:
                values_by_scene.setdefault(scene, []).append(float(row[field]))
        return {scene: float(np.mean(values)) for scene, values in values_by_scene.items()}

    def share(self, names: Sequence[str], field: str, moving: bool, condition: str) -> float:
        """Returns the mean of a field (%) over all that some policies drove in a condition."""
        return 100.0 * float(np.mean([list(self.of(name, field, moving, [condition]).values()) for name in names]))

    def less(
        self, law: str, field: str, moving: bool, conditions: Sequence[str], agents: Sequence[str] = ()
    ) -> Difference:
        """Returns the agent's share of successes or collisions less a law's; the families are strata."""
        columns = [self.of(name, field, moving, conditions) for name in (*(agents or self.seeds), law)]
        scenes = list(columns[-1])
        families = [self.rows[conditions[0], law, scene]["family"] for scene in scenes]
        *agent, other = ([each[scene] for scene in scenes] for each in columns)
        return difference(np.array(agent).T, np.array([other]).T, families, "share")

    @property
    def half(self) -> list[str]:
        """Returns the conditions in which the agents of the P3DX alone were driven; none without their half speed."""
        there = [
            name
            for name in (HOME, HALF)
            if name in self.conditions and all(self.of(each, "success", False, [name]) for each in self.own)
        ]
        return there if self.own and HALF in there else []

    @functools.cached_property
    def compared(self) -> dict[tuple[str, bool, str, bool], Difference]:
        """Every difference of successes on the page, each p corrected by Holm's method for all of them.

        By the law, whether scenes move, the condition ("" for all) and whether it is of the P3DX's own agents.
        """
        gains = {}
        for law, moving in itertools.product(LAWS, (False, True)):
            for name in ("", *self.conditions):
                gains[law, moving, name, False] = self.less(law, "success", moving, [name] if name else self.conditions)
            for name in self.half:
                gains[law, moving, name, True] = self.less(law, "success", moving, [name], self.own)
        corrected = holm([each.p for each in gains.values()])
        return {key: dataclasses.replace(each, p=p) for (key, each), p in zip(gains.items(), corrected, strict=True)}


def _points(change: Difference) -> str:
    return f"{100.0 * change.value:+.1f} [{100.0 * change.low:+.1f}, {100.0 * change.high:+.1f}]"


def _side(change: Difference) -> str:
    """Returns what a difference of successes with a corrected p says."""
    return leaning(outcome(change.low, change.high, change.p, MARGIN, change.limit), change.low, change.high)


def table(results: Results, moving: bool) -> str:
    """Returns success / collisions (%) of all in each condition, and below the agent's success less the laws'."""
    shares, differences = [], []
    for condition in results.conditions:
        cells = [
            f"{results.share([name], 'success', moving, condition):.0f} / "
            f"{results.share([name], 'collision', moving, condition):.0f}"
            for name in results.names
        ]
        shares.append([condition, *cells])
        differences.append([condition, *(_points(results.compared[law, moving, condition, False]) for law in LAWS)])
    shown = [name.removeprefix(f"{AGENT} ") if name in results.seeds else f"`{name}`" for name in results.names]
    headers = ["condition", *shown], [f"`{AGENT}` less", *(f"`{law}`" for law in LAWS)]
    return "\n\n".join(map(text_of, (shares, differences), headers))


def sentences(results: Results, moving: bool) -> str:
    """Returns who wins, losses first."""
    lines = []
    for law in LAWS:
        each = {name: results.compared[law, moving, name, False] for name in results.conditions}
        sides = {name: _side(one) for name, one in each.items()}
        lost, behind, ahead, won = (
            "; ".join(f"{name} ({_points(each[name])})" for name, side in sides.items() if side.startswith(verdict))
            or "none"
            for verdict in (WORSE, BEHIND, AHEAD, BETTER)
        )
        whole = results.compared[law, moving, "", False]
        lines.append(
            f"Over all conditions `{AGENT}` is beside `{law}` {_side(whole)}: {_points(whole)} points of success. "
            f"It is worse in {lost}. It is better in {won}. Before correction for the number of comparisons, it is "
            f"behind in {behind} and ahead in {ahead}."
        )
    touched = {name: results.share(results.seeds, "collision", moving, name) for name in results.conditions}
    over = [f"{name} ({share:.1f} %)" for name, share in touched.items() if share > 1.0]
    lines.append(f"More than 1 % of its scenes end in a collision in {'; '.join(over) or 'none'}.")
    return "\n".join(f"* {each}" for each in lines)


def half_speed(results: Results) -> str:
    """Returns what the agents of the P3DX alone come to at the speed of their training and at half of it; "" if none.

    A sentence a condition and a table: success / collisions (%), and their success less the laws'.
    """
    if not results.half:
        return ""
    lines, sentences = [], []
    for condition in results.half:
        for what, moving in (("still", False), ("moving", True)):
            by_law = {law: results.compared[law, moving, condition, True] for law in LAWS}
            shares = [f"{results.share(names, 'success', moving, condition):.1f} / "
                      f"{results.share(names, 'collision', moving, condition):.1f}"
                      for names in (results.own, *([law] for law in LAWS))]  # fmt: skip
            lines.append([condition, what, *shares])
            sides = [f"beside `{law}` {_side(each)} ({_points(each)})" for law, each in by_law.items()]
            sentences.append(f"* {condition}, {what}: `{OWN}` is {', '.join(sides)}.")
    header = ["condition", "scenes", f"`{OWN}`, {len(results.own)} seeds", *(f"`{law}`" for law in LAWS)]
    shown = text_of(lines, header)
    words = f"The P3DX's own agents were trained at 0.6 m/s. `{AGENT}` at 0.3 m/s stands in the tables above."
    return "\n\n".join(("## The P3DX's agents at half their speed", words, "\n".join(sentences), shown))


def page(rows: Sequence[dict[str, str]]) -> str:
    """Returns the page of the rows."""
    results = Results(rows)
    one = "One seed was trained, and is driven: how much seeds differ is not known."
    seeds = one if len(results.seeds) == 1 else f"{len(results.seeds)} seeds were trained, and are driven."
    missing = [each for each in CONDITIONS if each.name not in results.conditions]
    agentless, left = ([each.name for each in missing if bool(agents_of(each.robot)) == able] for able in (False, True))
    words = f" Not driven: {'; '.join(left)}." if left else ""
    words += f" No agent ships for the class of {'; '.join(agentless)}." if agentless else ""
    parts = [PROSE.strip().format(seeds=seeds, left=words, comparisons=len(results.compared))]
    for title, moving in (("Static obstacles", False), ("Moving obstacles", True)):
        name = results.conditions[0]
        number = len(results.of(LAWS[0], "success", moving, [name]))
        families = ", ".join(f"`{each}`" for each in (MOVING if moving else STILL))
        parts.append(f"## {title}\n\n{number} scenes a condition: {families}.\n\n{sentences(results, moving)}")
        parts.append(table(results, moving))
    return "\n\n".join(filter(None, (*parts, half_speed(results)))) + "\n"


PROSE = f"""# A driver for every robot, away from home

Made by `python benchmarks/studies/everywhere.py`; tables and sentences are made of the rows beside it. `{AGENT}` is
one network for all differential drives, with the data sheet as an input, below the planner of `scan_planner`, which
drives by itself where the network makes no way; none of the robots below was in its training. {{seeds}} A shield
stands behind it, always.
`vfh_plus` and `scan_planner` have their default gains. All see the same scan and have the same target speed. Cells
are success / collisions in per cent. The differences are paired by scene, in points of success, with 95 % intervals.
Better and worse are corrected by Holm's method for the {{comparisons}} comparisons of this page, ahead and behind are
not; equivalent is within {100.0 * MARGIN:g} point, all else is a tie. Scenes are drawn from seeds of their own, and
proven; those of a hull beyond 0.3 m are scaled for it.

What it does not show: noise above "moderate", delays, other families, gains that were tuned for a condition.{{left}}

[All results](../results.md)
"""


@click.command("everywhere", cls=OneLineErrors)
@click.option("--scenes", "count", default=6, show_default=True, type=click.IntRange(2, 100), help="Of a family.")
@click.option("--only", multiple=True, help="A condition by its name; may be repeated. Default: all.")
@click.option("--out", default="docs/results", show_default=True, type=click.Path(path_type=Path, file_okay=False))
def main(count: int, only: tuple[str, ...], out: Path) -> None:
    """Drives what is missing, and writes everywhere.csv.xz and everywhere.md."""
    names = [each.name for each in CONDITIONS]
    unknown = [each for each in only if each not in names]
    if unknown:
        raise click.UsageError(f"--only has {unknown[0]!r}; choose from {'; '.join(names)}")
    rows = drive_missing(out / "everywhere.csv.xz", FIELDS, parts(count, only))
    write_whole(out / "everywhere.md", page(rows).encode())


if __name__ == "__main__":
    main()
