"""Hulls from 0.3 to 0.7 m: who arrives in the scenes of its class, and what scenes there are.

    python benchmarks/studies/hulls.py

A cell that is in docs/results/hulls.csv.xz is not driven again; the page is made from that file, hulls.json and
hulls_gains.json, which holds what `wayfield tune` found for the bases that do not ship.
"""

import dataclasses
import functools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from part_rows import drive_missing, table

from wayfield.benchmarks.contests import CONTESTS, Contest, Entrants
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.crossed import share_interval
from wayfield.benchmarks.statistics.paired import SIGNIFICANT, difference, holm
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.scenarios import TASKS
from wayfield.envs.scenarios.splits import digest, split
from wayfield.policies.parts.tuned import tuned_set
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

RESULTS = Path("docs/results")
ROWS, SCENES, PAGE = RESULTS / "hulls.csv.xz", RESULTS / "hulls.json", RESULTS / "hulls.md"
FOUND = RESULTS / "hulls_gains.json"  # base -> policy -> the record of its search
FIELDS = ("robot", "kind", "family", "scene", "policy", "success", "collision", "time")
COUNT = 100  # scenes a cell, at least
HULLS = (0.3, 0.35, 0.45, 0.55, 0.7)  # m
CLASSES = (0.35, 0.5, 0.7)  # m, of which all test scenes are proven
BASE = ROBOTS["mir100"]
SEEKERS = ("vfh_plus", "dwa", "scan_planner", "any_robot")
AGENT = "any_robot"
TUNED = " (tuned)"
FIRST = ("vfh_plus", "scan_planner", "reeds_shepp_scan", "any_robot", "dwa")  # quick ones, where time is short


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of scenes, and who drives there."""

    title: str
    contest: Contest
    moving: bool | None  # of the families that are meant; None: all
    policies: tuple[str, ...]
    only: tuple[str, ...] = ()  # of the families; none: all that are meant

    @property
    def families(self) -> tuple[str, ...]:
        """Returns the families."""
        known = self.contest.spec.families
        meant = (each for each in self.contest.families("kinematic") if self.moving in (None, known[each].moving))
        return self.only or tuple(meant)


KINDS = {
    "still": Kind("Goals among static obstacles", CONTESTS["goal-obstacles"], False, SEEKERS),
    "moving": Kind("Goals among moving obstacles", CONTESTS["goal-obstacles"], True, SEEKERS),
    "doors": Kind(
        "The narrowest doors", CONTESTS["goal-obstacles"], False, ("scan_planner", "any_robot"), ("doors_narrow",)
    ),
    "docks": Kind("Docks", CONTESTS["docking"], None, ("reeds_shepp_scan",)),
}


def disc(hull: float) -> Robot:
    """Returns a base with the drive of the MiR100 and a disc as its hull (m)."""
    name, inertia = f"disc_{100.0 * hull:.0f}", 0.5 * BASE.mass * hull**2
    return dataclasses.replace(BASE, name=name, hull_box=None, hull_x=0.0, hull_radius=hull, inertia=inertia)


BASES = {robot.name: robot for robot in (*map(disc, HULLS), BASE, ROBOTS["husky"])}


def scenes(hull: float) -> dict[str, dict[str, Any]]:
    """Returns of the test scenes of a hull class (m) how many have a proven way, and which they are, by task."""
    scenes_of = {}
    for task in ("goal_reaching", "docking"):
        spec = TASKS[task]
        there, frozen = (split(task, "all", name) for name in (f"test@{hull:.2f}", "test"))
        moved = tuple(each.of_class(hull) for each in frozen)
        scenes_of[task] = {
            "scenes": len(there),
            "as_frozen": sum(a.name == b.name for a, b in zip(there, frozen, strict=True)),
            "proven": sum(spec.feasible(each, hull) for each in there),
            "digest": digest(there)[:16],
            "moved": digest(moved)[:16],  # before docks without a way were replaced
        }
    return scenes_of


def searched() -> dict[str, dict[str, dict[str, Any]]]:
    """Returns the records of the searches for the bases that do not ship, by base and policy."""
    return json.loads(FOUND.read_text(encoding="utf-8")) if FOUND.exists() else {}


def entries(robot: str, kind: str) -> list[str]:
    """Returns who drives in a kind of scenes: each policy, and once more with gains that were searched for the base."""
    there = []
    for policy in KINDS[kind].policies:
        chosen = searched().get(robot, {}).get(policy, {}).get("chosen")  # "default" where no set was better
        found = chosen == "search" or tuned_set(policy, KINDS[kind].contest.name, robot) is not None
        there += [policy, policy + TUNED] if found else [policy]
    return there


def drive(robot: Robot, kind: str, entry: str) -> list[tuple[str, ...]]:
    """Returns the rows of a cell, a scene each: lagged actuators, the first of the claims split."""
    contest, families, rows = KINDS[kind].contest, KINDS[kind].families, []
    count = -(-COUNT // len(families))
    policy = entry.removesuffix(TUNED)
    found = searched().get(robot.name, {}).get(policy) if entry != policy else None
    gains_name = "tuned" if entry != policy and not found else "default"
    for family in families:
        course = dataclasses.replace(contest.course(family, "claims", robot), members=tuple(range(count)))
        case = next(contest.cases(robot, course, Entrants((policy,), (gains_name,))))
        if found:
            case = dataclasses.replace(case, gains={**case.gains, **found["gains"]})
        driven = episodes(Setting("hulls", case, "kinematic", "lagged", 0, count, members=course.members))
        for k, (row, _) in enumerate(driven):
            rows.append((family, str(k), *(f"{row[name]:.4g}" for name in FIELDS[5:])))
    return rows


def shown(rows: Sequence[dict[str, str]], field: str) -> str:
    """Returns a share in per cent with its interval."""
    values = np.array([float(row[field]) for row in rows])
    ends = share_interval(values, [row["family"] for row in rows])
    interval = f" [{100.0 * ends[0]:.1f}, {100.0 * ends[1]:.1f}]" if ends else ""
    return f"{100.0 * values.mean():.1f}{interval}"


def results(rows: Sequence[dict[str, str]], kind: str) -> str:
    """Returns the table of a kind of scenes: success and collisions of each law by hull."""
    lines = []
    for name, robot in BASES.items():
        contest = KINDS[kind].contest
        hull = contest.spec.repertoire.hull_class(robot.hull_radius) or 0.3
        for policy in entries(name, kind):
            mine = [row for row in rows if (row["robot"], row["kind"], row["policy"]) == (name, kind, policy)]
            if mine:
                cells = (shown(mine, "success"), shown(mine, "collision"))
                won = [float(row["time"]) for row in mine if row["success"] == "1"]
                time = f"{np.mean(won):.1f}" if won else ""
                lines.append((f"{hull:.2f}", f"`{name}`", marked(policy), len(mine), *cells, time))
    header = ("class (m)", "base", "policy", "scenes", "success (%)", "collisions (%)", "time (s)")
    return table(lines, header)


def best_rival(rows: Sequence[dict[str, str]], base: str, kind: str) -> str:
    """Returns the controller with most successes, with default or searched gains; of equal ones the faster."""
    scores = {}
    for each in [each for each in entries(base, kind) if each != AGENT]:
        mine = [row for row in rows if (row["robot"], row["kind"], row["policy"]) == (base, kind, each)]
        won = [float(row["time"]) for row in mine if row["success"] == "1"]
        scores[each] = (len(won), -sum(won))
    return max(scores, key=lambda each: scores[each])


def compared(rows: Sequence[dict[str, str]]) -> str:
    """Returns the table of the agent beside the best controller of each kind of scenes, paired by scene."""
    cells = {(row["robot"], row["kind"], row["policy"], row["family"], row["scene"]): row["success"] for row in rows}
    places = {(row["kind"], row["family"], row["scene"]): None for row in rows}
    lines: list[list[str]] = []
    differences = []
    for kind in ("still", "moving"):
        scenes = [place for place in places if place[0] == kind]
        families = [family for _, family, _ in scenes]
        pairs = {}
        for name in BASES:
            rival = best_rival(rows, name, kind)
            agent, law = pairs[name] = tuple(
                np.array([[float(cells[name, kind, policy, *scene[1:]])] for scene in scenes])
                for policy in (AGENT, rival)
            )
            differences.append(difference(agent, law, families, "share"))
            lines.append([KINDS[kind].title, f"`{name}`", marked(rival)])
        # a scene is the same in all classes but for its size: its mean is one
        agent, law = (np.mean([pairs[name][side] for name in large_discs()], axis=0) for side in (0, 1))
        differences.append(difference(agent, law, families, "mean"))
        lines.append([KINDS[kind].title, "discs above 0.3 m", "of each disc"])
    for line, each, p in zip(lines, differences, holm([each.p for each in differences]), strict=True):
        interval = f"{100.0 * each.value:+.1f} [{100.0 * each.low:+.1f}, {100.0 * each.high:+.1f}]"
        line += [
            interval,
            ("more" if each.value > 0.0 else "fewer") if p < SIGNIFICANT else "no significant difference",
        ]
    return table(lines, ("scenes", "base", "controller", "`any_robot` less the controller (points)", "successes"))


def marked(entry: str) -> str:
    """Returns an entry as a page writes it: `vfh_plus` (tuned)."""
    policy = entry.removesuffix(TUNED)
    return f"`{policy}`{entry[len(policy) :]}"


def feasibility(scenes_by_hull: dict[str, Any]) -> str:
    """Returns the table of the scenes of each class."""
    lines = [
        (hull, task.replace("_", " "), counts["scenes"], counts["proven"], counts["as_frozen"], f"`{counts['digest']}`")
        for hull, tasks in scenes_by_hull.items()
        for task, counts in tasks.items()
    ]
    header = ("class (m)", "task", "test scenes", "with a proven path", "scenes of the 0.3 m split", "SHA-256 begins")
    return table(lines, header)


PROSE = """# Hulls of 0.3 to 0.7 m

Made by `python benchmarks/studies/hulls.py` from every episode, `hulls.csv.xz`. What a hull class is:
[scenarios](../scenarios.md#hull-classes).

`disc_35` is a base with the drive of the MiR100 (1 m/s, 2 m/s², 0.1 s lag) and a disc of 0.35 m as its hull; `mir100`
and `husky` have their own rectangles. Rows marked (tuned) have gains that `wayfield tune` found for the base on the
training scenes of its class, with 1 M steps: those of discs are in `hulls_gains.json`, with the searches that found
nothing better; the others ship. The other rows have default gains, which were chosen with hulls of 0.3 m. `any_robot`
is its seed 0, trained with hulls of 0.1 to 0.58 m. Every base drives the first scenes of the claims split of its class,
as many of each family, with the scan and the clock of the class, and lagged actuators. Brackets are 95 % intervals.
Bases of one class meet the same scenes; classes are not compared with each other. The MiR100 has [a page of its
own](goal-obstacles-mir100-claims.md) with 2,000 scenes. Simulation only.

[All results](../results.md)
"""
DOORS = """All 100 claims scenes of `doors_narrow`, one of the 16 families of static obstacles. A disc of its class has
8 % of its radius to spare on each side, about what lies between two beams there; a rectangle has more. Nearly all
collisions with static obstacles happen here. Collisions in 16 % of these doors are 1 % of all static scenes."""


def large_discs() -> list[str]:
    """Returns the names of the discs above 0.3 m."""
    return [robot.name for robot in map(disc, HULLS) if robot.hull_radius > HULLS[0]]


def together(rows: Sequence[dict[str, str]]) -> str:
    """Returns a sentence on the narrowest doors of all discs above 0.3 m, by each policy with default gains."""
    discs = large_discs()
    parts = []
    for policy in KINDS["doors"].policies:
        mine = [row for row in rows if (row["kind"], row["policy"]) == ("doors", policy) and row["robot"] in discs]
        values, share = np.array([float(row["collision"]) for row in mine]), 100.0 / len(KINDS["still"].families)
        low, high = share_interval(values, [row["robot"] for row in mine]) or (np.nan, np.nan)
        ends = f"{share * values.mean():.2f} [{share * low:.2f}, {share * high:.2f}] %"
        parts.append(f"`{policy}` in {values.sum():.0f} of {len(values)}, which are {ends} of all static scenes")
    return f"Collisions in these doors of the discs above 0.3 m, with default gains: {'; '.join(parts)}."


def unsearched() -> str:
    """Returns a sentence on the controllers without a search for a base."""
    lacking: dict[str, list[str]] = {}
    for base in BASES:
        there = set(entries(base, "still"))
        for policy in SEEKERS:
            if policy not in (AGENT, *searched().get(base, {})) and policy + TUNED not in there:
                lacking.setdefault(policy, []).append(f"`{base}`")
    parts = [f"`{policy}` for {', '.join(bases)}" for policy, bases in lacking.items()]
    return f"Without a search: {'; '.join(parts)}." if parts else ""


def page(rows: Sequence[dict[str, str]], scenes_by_hull: dict[str, Any]) -> str:
    """Returns the page."""
    done = {(row["kind"], row["robot"], row["policy"]) for row in rows}
    parts = [PROSE.strip()]
    for name, kind in KINDS.items():
        parts += [f"## {kind.title}", results(rows, name)]
        there = [(base, law) for base in BASES for law in entries(base, name)]
        parts += [DOORS, together(rows)] if name == "doors" else []
        missing = [f"`{base}` {law}" for base, law in there if (name, base, law) not in done]
        parts += [f"Not driven: {', '.join(missing)}."] if missing else []
    if not any("Not driven" in part for part in parts):
        parts += ["## The agent beside the best controller", compared(rows), AFTER, unsearched()]
    note = "A proven path was found by search for a disc of the class. Docks without one are replaced by other seeds'."
    parts += ["## Scenes of each class", feasibility(scenes_by_hull), note]
    return "\n\n".join(parts) + "\n"


AFTER = (
    "Paired by scene, with Holm's correction for all lines. The controller is the one with most successes in these "
    "scenes, with default or searched gains. The agent was trained with hulls of up to 0.579 m; the "
    "Husky and the disc of 0.7 m are beyond that."
)


@click.command("hulls", cls=OneLineErrors)
def main() -> None:
    """Drives what is missing, and writes the page."""
    scenes_by_hull = json.loads(SCENES.read_text(encoding="utf-8")) if SCENES.exists() else {}
    cells = [(name, kind, policy) for kind in KINDS for name in BASES for policy in entries(name, kind)]
    cells.sort(key=lambda cell: FIRST.index(cell[2].removesuffix(TUNED)))  # stable: quick ones first
    parts = [
        ({"robot": name, "kind": kind, "policy": policy}, functools.partial(drive, BASES[name], kind, policy))
        for name, kind, policy in cells
    ]
    rows = drive_missing(ROWS, FIELDS, parts)
    for hull in [each for each in CLASSES if f"{each:.2f}" not in scenes_by_hull]:
        scenes_by_hull[f"{hull:.2f}"] = scenes(hull)
        write_whole(SCENES, (json.dumps(scenes_by_hull, indent=1) + "\n").encode())
    write_whole(PAGE, page(rows, scenes_by_hull).encode())


if __name__ == "__main__":
    main()
