"""Does it hold in another physics? README's verdicts of one robot on three plants: python benchmarks/studies/physics.py

Scenes, starts, gains and agents are those of the published contests; none was tuned on pymunk or MuJoCo. Of each family
the first scenes of the split that README quotes are driven, of the agent the first seeds. Rows are kept as physics.csv,
and the page is made of them; parts that are there are not driven again, so that a run may be stopped at any time:

    python benchmarks/studies/physics.py --drive --blocks 3
    python benchmarks/studies/physics.py
"""

import functools
import itertools
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import click
import flocks
import numpy as np
from flocks import leaning
from part_rows import Part, Row, drive_missing, read, table

from wayfield.benchmarks.contests import ALL_CONTESTS, Course, Entrants
from wayfield.benchmarks.entrants.documents import documents
from wayfield.benchmarks.leaderboards.verdicts import BETTER, COST_MARGIN, FEW, MARGIN, WORSE, outcome
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.statistics.paired import Difference, difference, holm
from wayfield.envs.scenarios.splits import SPLITS
from wayfield.envs.scenarios.team_families import TEAM_FAMILIES
from wayfield.envs.tasks.task import IN_PROCESS, LARGEST_TEAMS
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

RESULTS = Path("docs/results")
TABLE, PAPERS, PAGE = RESULTS / "physics.csv", RESULTS / "physics_papers.csv", RESULTS / "physics.md"
# measured once, by sim_to_sim.py and domain.py of commit 430ee4b9
CHAIN, DOMAIN = RESULTS / "physics_chain.csv", RESULTS / "physics_domain.csv"
NUMBERS = ("metres", "apart", "turned_apart", "speed_error", "yaw_rate_error")
# in MuJoCo; on the kinematic plant they are those of flocks.FILES
OTHERS = {"teams": RESULTS / "physics_teams.csv", "people": RESULTS / "physics_people.csv.xz"}
TEAM_LAW, CROWD_LAW = f"vfh_plus{flocks.TUNED}", f"orca_team{flocks.TUNED}"
SEEDS = 3  # of the agent
WORLDS = 10  # of each family of teams
ROBOT, AGENT = "p3dx", "ppo"
FIELDS = ("plant", "verdict", "family", "block", "policy", "scene", "success", "collision", "cost", "speed")
PAPER_FIELDS = ("plant", "document", "experiment", "policy", "outcome", "figures")
WORDS = {BETTER: "controller ahead", WORSE: "agent ahead"}


class Verdict(NamedTuple):
    """A verdict of README: a controller with its gains beside the agent, in some families of a split."""

    where: str
    contest: str
    kind: str
    split: str
    controller: str
    gains: str
    scenes: int  # of a family that are driven at once
    decides: str = "success"  # or the "error" of tracking, or the "time", where success is a tie

    @property
    def families(self) -> tuple[str, ...]:
        """Returns the families of its scenes."""
        known = ALL_CONTESTS[self.contest].spec.families
        return tuple(each for each in ALL_CONTESTS[self.contest].scenes[self.kind] if not known[each].needs_forces)


VERDICTS = (
    Verdict("smooth paths", "path-following", "smooth paths", "test", "ilqr", "tuned", 2, "error"),
    Verdict("paths with corners", "path-following", "paths with corners", "test", "ilqr", "tuned", 5, "error"),
    Verdict(
        "timed trajectories",
        "trajectory-tracking",
        "references that a base can follow",
        "test",
        "timed_mpc",
        "tuned",
        10,
        "error",
    ),
    Verdict("goals among static obstacles", "goal-obstacles", "static obstacles", "claims", "scan_planner", "tuned", 1),
    Verdict("goals among moving obstacles", "goal-obstacles", "moving obstacles", "claims", "vfh_plus", "tuned", 5),
    Verdict("docks in free space", "docking", "free space", "claims", "polar", "default", 10, "time"),
    Verdict(
        "docks at a wall or in a bay", "docking", "wall or parking bay", "claims", "reeds_shepp_scan", "default", 10
    ),
    Verdict("docks among moving obstacles", "docking", "moving obstacles", "claims", "reeds_shepp_scan", "default", 20),
)


def cases(verdict: Verdict, family: str) -> Iterator[tuple[str, Case]]:
    """Yields the entries of a verdict in a family: the controller, and the agent a seed."""
    contest, course = ALL_CONTESTS[verdict.contest], Course(family, verdict.split)
    for case in contest.cases(ROBOT, course, Entrants((verdict.controller, AGENT), (verdict.gains,))):
        if case.policy != AGENT:
            yield case.policy, case
        elif case.gains["seed"] < SEEDS:
            yield f"{AGENT} seed {case.gains['seed']}", case


def drive(verdict: Verdict, case: Case, plant: str, block: int) -> list[tuple[Any, ...]]:
    """Returns the rows of an entry in a block of scenes: number, success, collision, error (m) or time (s), speed."""
    numbers = tuple(range(block * verdict.scenes, (block + 1) * verdict.scenes))
    setting = Setting(verdict.contest, case, plant, "lagged", 0, len(numbers), numbers=numbers)
    cost = ALL_CONTESTS[verdict.contest].cost.metric
    return [
        (number, int(row["success"]), int(row["collision"]), f"{row[cost]:.6g}", f"{row['mean_speed']:.4f}")
        for number, (row, _) in zip(numbers, episodes(setting), strict=True)
    ]


def parts(plants: Sequence[str], blocks: int) -> Iterator[Part]:
    """Yields the parts so that plants and verdicts grow together: first families first, then the next block."""
    most = max(len(verdict.families) for verdict in VERDICTS)
    for block, k, verdict in itertools.product(range(blocks), range(most), VERDICTS):
        if (block + 1) * verdict.scenes > SPLITS[verdict.split] or k >= len(verdict.families):
            continue
        family = verdict.families[k]
        for entry, case in cases(verdict, family):
            for plant in plants:
                known = {"plant": plant, "verdict": verdict.where, "family": family, "block": str(block)}
                yield known | {"policy": entry}, functools.partial(drive, verdict, case, plant, block)


def paper_parts(plants: Sequence[str]) -> Iterator[Part]:
    """Yields the reference papers' controllers: outcome, and the figures that their equations or tables give."""
    for case in documents():
        theirs = case.reference
        if case.policy in ("zero", "random") or not theirs:
            continue

        for plant in plants:

            def drives(case: Case = case, plant: str = plant, theirs: Any = theirs) -> list[Sequence[Any]]:
                row, _ = episodes(Setting("documents", case, plant, "ideal", 0, 1))[0]
                figures = ";".join(f"{name}={row.get(name, float('nan')):.5g}" for name in theirs)
                return [(_ended(row), figures)]

            name = f"{case.policy} {case.gains_text}".strip()
            yield {"plant": plant, "document": case.contest, "experiment": case.family, "policy": name}, drives


def _ended(row: Row) -> str:
    return next((name for name in ("success", "collision", "timeout") if row.get(name)), "left corridor")


# ---- the page


def matched(rows: Sequence[Row], verdict: Verdict, plant: str, metric: str) -> tuple[Any, Any, list[str]]:
    """Returns a number (s, 1) of the controller and (s, seeds) of the agent in the scenes that all plants have, and
    their families."""
    agents = [f"{AGENT} seed {seed}" for seed in range(SEEDS)]
    mine = [row for row in rows if row["verdict"] == verdict.where and row["policy"] in (verdict.controller, *agents)]
    wanted = len(IN_PROCESS) * (1 + SEEDS)
    count: dict[tuple[str, str], int] = {}
    for row in mine:
        key = row["family"], row["scene"]
        count[key] = count.get(key, 0) + 1
    keys = [key for key, there in count.items() if there == wanted]
    of_plant = {
        (row["policy"], row["family"], row["scene"]): float(row[metric]) for row in mine if row["plant"] == plant
    }
    first = np.array([[of_plant[verdict.controller, *key]] for key in keys])
    other = np.array([[of_plant[agent, *key] for agent in agents] for key in keys])
    return first, other, [family for family, _ in keys]


def team_families(walled: bool) -> tuple[str, ...]:
    """Returns the families of teams, with or without walls, that MuJoCo drives."""
    most = LARGEST_TEAMS["mujoco"]
    turned = [name for name in TEAM_FAMILIES if name.startswith(flocks.TURNED)]
    return tuple(
        k for k, each in TEAM_FAMILIES.items() if each.walled is walled and each.team <= most and k not in turned
    )


class Among(NamedTuple):
    """A verdict on robots among others; in crowds README's."""

    where: str
    controller: str
    agent: str
    rows: str  # a key of OTHERS
    of: tuple[str, ...]  # families of teams, or contests of people
    decides: str = "success"


AMONG = (
    Among("teams in the open", TEAM_LAW, "team_scan", "teams", team_families(walled=False)),
    Among("teams at doors and in rooms", TEAM_LAW, AGENT, "teams", team_families(walled=True)),
    Among("CrowdNav's five pedestrians", CROWD_LAW, "people_free", "people", ("crowdnav",)),
    Among("AttnGraph's crowd of 20", CROWD_LAW, "people_free", "people", ("attngraph",)),
)


class Line(NamedTuple):
    """A verdict on a plant."""

    verdict: Verdict | Among
    plant: str
    scenes: int
    controller: float  # %, mm or s
    agent: float
    gain: Difference  # of the controller less the agent, in the same unit; better is more success, less of the others

    def said(self, corrected: float) -> str:
        """Returns the outcome in words."""
        if not np.isfinite(self.gain.low):
            return FEW
        if self.verdict.decides != "success":
            margin = COST_MARGIN * min(self.controller, self.agent)
            return leaning(
                outcome(-self.gain.high, -self.gain.low, corrected, margin, trifles=True),
                -self.gain.high,
                -self.gain.low,
            )
        low, high = self.gain.low / 100.0, self.gain.high / 100.0
        return leaning(outcome(low, high, corrected, MARGIN, self.gain.limit), low, high)


def line(rows: Sequence[Row], verdict: Verdict, plant: str) -> Line | None:
    """Returns what a verdict comes to on a plant; None where nothing was driven."""
    success = matched(rows, verdict, plant, "success")
    if not len(success[0]):
        return None
    if verdict.decides == "success":
        change = difference(success[0], success[1], success[2], "share")
        scaled = Difference(100.0 * change.value, 100.0 * change.low, 100.0 * change.high, change.p, change.limit)
        shares = [100.0 * float(each.mean()) for each in success[:2]]
        return Line(verdict, plant, len(success[0]), shares[0], shares[1], scaled)
    solved = (success[0].min(axis=1) == 1.0) & (success[1].min(axis=1) == 1.0)
    first, other, families = matched(rows, verdict, plant, "cost")
    factor = 1000.0 if verdict.decides == "error" else 1.0
    first, other = factor * first[solved], factor * other[solved]
    strata = [family for family, good in zip(families, solved, strict=True) if good]
    change = difference(first, other, strata, "mean")
    return Line(verdict, plant, len(first), float(first.mean()), float(other.mean()), change)


def among_lines(among: Among) -> Iterator[Line]:
    """Yields what a verdict on robots among others comes to on both plants, in the worlds that MuJoCo drove."""
    of_plant = {"kinematic": RESULTS / flocks.FILES[among.rows], "mujoco": OTHERS[among.rows]}
    drove = {row["policy"] for row in read(of_plant["mujoco"])}  # not all seeds of an agent
    entries = (among.controller, *(each for each in flocks.entries(among.agent) if each in drove))
    solved = {
        name: {
            (row["policy"], row["family"], row["world"]): float(row.get("solved") or row["success"])
            for row in read(file)
            if row.get("contest", row["family"]) in among.of and row["policy"] in entries
        }
        for name, file in of_plant.items()
    }
    driven = Counter((family, world) for _, family, world in solved["mujoco"])
    worlds = [world for world, count in driven.items() if count == len(entries)]
    for plant, mine in solved.items():
        values = 100.0 * np.array([[mine[entry, *world] for entry in entries] for world in worlds])
        gain = difference(values[:, :1] / 100.0, values[:, 1:] / 100.0, [family for family, _ in worlds], "share")
        scaled = Difference(100.0 * gain.value, 100.0 * gain.low, 100.0 * gain.high, gain.p, gain.limit)
        yield Line(among, plant, len(worlds), float(values[:, 0].mean()), float(values[:, 1:].mean()), scaled)


def _among_section(lines: Sequence[Line], said: dict[tuple[str, str], str]) -> list[str]:
    """Returns the section of teams and crowds."""
    text = [
        "",
        "## Teams and crowds",
        "",
        "Success rates of teams of 2, 4 and 8 omni robots and of an omni robot in crowds, the same scenes on both "
        "plants; pymunk drives neither. In MuJoCo the robots of a scene share a model, and push each other in a "
        "collision. In teams the pairs are not README's: `scan_planner`, `any_robot` and `hybrid` were not driven "
        "there.",
    ]
    for among in AMONG:
        shown = [_shown(each, said[among.where, each.plant]) for each in lines if each.verdict is among]
        title = f"{among.where[0].upper()}{among.where[1:]}, `{among.controller}` vs. agent `{among.agent}`:"
        text += ["", title, "", table(shown, ("plant", "value", "difference", "scenes", "outcome"))]
    return text


def _shown(each: Line, said: str) -> list[str]:
    unit, digits = {"success": ("%", 1), "error": ("mm", 2), "time": ("s", 2)}[each.verdict.decides]
    ends = f" [{each.gain.low:+.{digits}f}, {each.gain.high:+.{digits}f}]" if np.isfinite(each.gain.low) else ""
    return [
        each.plant,
        f"{each.controller:.{digits}f} vs. {each.agent:.{digits}f} {unit}",
        f"{each.gain.value:+.{digits}f}{ends}",
        f"{each.scenes}",
        WORDS.get(said, said.replace("ahead", "controller ahead").replace("behind", "agent ahead")),
    ]


def page(rows: Sequence[Row], papers: Sequence[Row], chain: Sequence[Row], trained: Sequence[Row]) -> str:
    """Returns the page."""
    lines = [made for verdict in VERDICTS for plant in IN_PROCESS if (made := line(rows, verdict, plant))]
    others = [each for among in AMONG for each in among_lines(among)]
    lines += others
    corrected = holm([each.gain.p for each in lines])
    said = {(each.verdict.where, each.plant): each.said(p) for each, p in zip(lines, corrected, strict=True)}
    text = [
        "# Does it hold in another physics?",
        "",
        "`kinematic` and `pymunk` are plants of this project; [MuJoCo](../environments.md#mujoco) is not. Here the "
        "README's verdicts of one robot are driven on all three, teams and crowds on two: tier `lagged`, the same "
        "scenes, starts, gains and agents. Nothing was tuned on pymunk or MuJoCo.",
        "",
        _summary(said),
        "",
        "A difference is the controller's value minus the agent's in the same scenes, with its 95 % interval, over "
        f"scenes and training seeds of PPO ({SEEDS}). The scenes are the first of each family of the split that README "
        "quotes: fewer than there, so that intervals are wider. Outcomes are corrected for all comparisons of this "
        "page (Holm). An error is the RMS cross-track error on the paths that all complete, on timed trajectories the "
        "RMS position error after 10 s; a time is that of the docks that all reach.",
    ]
    for verdict in VERDICTS:
        mine = [each for each in lines if each.verdict is verdict]
        if not mine:
            continue
        text += ["", f"## {verdict.where[0].upper()}{verdict.where[1:]}", "", f"`{verdict.controller}` vs. PPO.", ""]
        shown = [_shown(each, said[verdict.where, each.plant]) for each in mine]
        text += [table(shown, ("plant", "value", "difference", "scenes", "outcome"))]
        text += ["", _moved(rows, verdict)]
    text += _among_section(others, said)
    return "\n".join([*text, *_paper_lines(papers), *_chain_lines(chain), *_domain_lines(trained), ""])


def _summary(said: dict[tuple[str, str], str]) -> str:
    """Returns which verdicts are the same on all plants, and which are not."""
    there = [v.where for v in VERDICTS if said.get((v.where, IN_PROCESS[0]), FEW) != FEW]
    same = [where for where in there if len({said[where, plant] for plant in IN_PROCESS}) == 1]
    turned = [where for where in there if {BETTER, WORSE} <= {said[where, plant] for plant in IN_PROCESS}]
    text = ""
    if there:
        text = f"**{len(same)} of {len(there)} verdicts have the same outcome on all three plants."
        text += f" {len(turned) or 'None'} {'turns' if len(turned) < 2 else 'turn'} round.**"
    others = {among.where: {said[among.where, plant] for plant in ("kinematic", "mujoco")} for among in AMONG}
    alike = [where for where, outcomes in others.items() if len(outcomes) == 1]
    text += f" Of {len(others)} verdicts of teams and crowds, {len(alike)} have the same outcome on both plants."
    differ = [where for where in (*there, *others) if where not in (*same, *alike)]
    if lacking := [verdict.where for verdict in VERDICTS if verdict.where not in there]:
        text += f" No verdict yet, for too few scenes have been driven, or none: {', '.join(lacking)}."
    return text.strip() + (f" The outcome differs in: {', '.join(differ)}." if differ else "")


def _moved(rows: Sequence[Row], verdict: Verdict) -> str:
    """Returns how success, collisions and speed of both change between the plants."""
    parts = []
    for name, column in ((f"`{verdict.controller}`", 0), ("PPO", 1)):
        cells = []
        for plant in IN_PROCESS:
            success, collision, speed = (
                np.mean(matched(rows, verdict, plant, each)[:2][column]) for each in ("success", "collision", "speed")
            )
            cells.append(f"{plant} {100 * success:.1f} %, {100 * collision:.1f} %, {speed:.3f} m/s")
        parts.append(f"{name}: {'; '.join(cells)}")
    return f"Success, collisions and mean speed. {'. '.join(parts)}."


def _paper_lines(papers: Sequence[Row]) -> list[str]:
    """Returns the section of the reference papers: their figures beside ours on each plant."""
    if not papers:
        return []
    lines = []
    for case in documents():
        theirs = case.reference
        name = f"{case.policy} {case.gains_text}".strip()
        for metric, figure in theirs.items():
            mine = {
                row["plant"]: dict(cell.split("=") for cell in row["figures"].split(";")).get(metric, "nan")
                for row in papers
                if (row["document"], row["experiment"], row["policy"]) == (case.contest, case.family, name)
            }
            if not mine:
                continue
            low = statistics.fmean(figure) if isinstance(figure, tuple) else figure
            ours = [f"{float(mine[plant]):.4g}" if plant in mine else "" for plant in IN_PROCESS]
            lines.append([case.contest, case.family, name, metric.replace("_", " "), f"{low:.4g}", *ours])
    header = ("paper", "experiment", "controller", "figure (SI)", "equations", *IN_PROCESS)
    return [
        "",
        "## The three reference papers",
        "",
        "Their controllers as printed, tier `ideal`, beside the solutions of their equations. The papers' own runs "
        "were in CoppeliaSim (A) and on real wheels (B, C). A prints no figure of its orbit, 0.10 to 0.15 m outside "
        "the circle by its equations: its run in CoppeliaSim is a picture. nan: the run did not get that far. Where "
        "traction does not reach for what B and C ask for, pymunk and MuJoCo depart from the equations together: our "
        "tyre model is that of an engine that we did not write.",
        "",
        table(lines, header),
    ]


def _chain_lines(chain: Sequence[Row]) -> list[str]:
    """Returns the section of identification: how far a sheet drives from the base in MuJoCo, before and after."""
    if not chain:
        return []
    lines = []
    for name in dict.fromkeys(row["robot"] for row in chain):
        for sheet in ("own", "identified"):
            mine = [row for row in chain if (row["robot"], row["sheet"]) == (name, sheet)]
            of = {each: [float(row[each]) for row in mine] for each in NUMBERS}
            apart = " ".join(f"{each:.2f}" for each in of["apart"])
            turned = " ".join(f"{np.degrees(each):.0f}" for each in of["turned_apart"])
            speed, yaw_rate = (statistics.fmean(of[each]) for each in NUMBERS[3:])
            cells = [f"{statistics.fmean(of['metres']):.0f}", apart, turned, f"{1000 * speed:.1f}", f"{yaw_rate:.3f}"]
            lines.append([name, sheet, *cells])
    header = ("robot", "sheet", "way (m)", "apart (m)", "apart (deg)", "speed error (mm/s)", "yaw rate error (rad/s)")
    return [
        "",
        "## Identify the base in MuJoCo",
        "",
        "A base in MuJoCo drives the commands of `wayfield ros excite`, `wayfield identify` makes a data sheet of the "
        "log, and the sheet drives the kinematic plant. Own: the sheet that the model in MuJoCo was made of. Both "
        f"plants then get the same random commands for 60 s, open loop, {len(mine)} drives: how far they end apart, "
        "and the RMS error of speeds.",
        "",
        table(lines, header),
        "",
        "Identification takes the scrub of two wheels into the gain of the yaw rate, and sheet and base come closer. "
        "It makes a skid steer worse. The Jackal's wheels slide, and friction that holds it in a fast bend no longer "
        "resists the turn: it turns 5 % slower than commanded in slow bends, but 27 % faster at 1 m/s and 1.6 rad/s, "
        "and drifts outwards at 0.26 m/s. A balance of Coulomb friction at the wheels' edges predicts this (8 %, "
        "0.03 m/s); no number of a data sheet does. `identify` takes it for wheels that saturate (effective track "
        "1.28 m), but reports that the base's own sheet is better on held-out data (0.145 vs. 0.162 rad/s).",
    ]


def _domain_lines(trained: Sequence[Row]) -> list[str]:
    """Returns the section of agents that were trained with and without the imperfections of the base in MuJoCo."""
    if not trained:
        return []
    lines, means = [], []
    for name, plant in itertools.product(dict.fromkeys(row["training"] for row in trained), ("kinematic", "mujoco")):
        mine = [row for row in trained if (row["training"], row["plant"]) == (name, plant)]
        shares, errors, speeds = ([float(row[each]) for row in mine] for each in ("success", "error", "speed"))
        cells = [
            " ".join(f"{100.0 * each:.1f}" for each in shares),
            " ".join(f"{1000.0 * each:.1f}" for each in errors),
        ]
        lines.append([name, plant, *cells, f"{statistics.fmean(speeds):.2f}"])
        if plant == "mujoco":
            means.append(
                f"{1000.0 * statistics.fmean(errors):.1f} mm and {100.0 * statistics.fmean(shares):.1f} % ({name})"
            )
    header = ("trained on", "test paths on", "success (%), each seed", "IQM of errors (mm), each seed", "speed (m/s)")
    return [
        "",
        "## Does training with the imperfections help there?",
        "",
        "The preset `path_following_plain` was trained on the kinematic plant in three ways: on the data sheet; on the "
        "sheet that was identified of the base in MuJoCo (above); on the data sheet, half of the robots with slip, "
        "wheel errors or a delay of 0.05 or 0.1 s. It then drives all test paths. An error is the RMS cross-track "
        "error; a path that is not completed counts as 1 m.",
        "",
        table(lines, header),
        "",
        f"Means of the seeds in MuJoCo: {'; '.join(means)}.",
    ]


@click.command(cls=OneLineErrors)
@click.option("--drive", "drives", is_flag=True, help="Drive what is not in the rows.")
@click.option("--blocks", type=click.IntRange(1), default=1, show_default=True, help="Of scenes of each family.")
@click.option("--plants", default=",".join(IN_PROCESS), show_default=True)
def main(drives: bool, blocks: int, plants: str) -> None:
    """Makes the page of verdicts on three plants from its rows."""
    if drives:
        drive_missing(PAPERS, PAPER_FIELDS, paper_parts(plants.split(",")))
        drive_missing(TABLE, FIELDS, parts(plants.split(","), blocks))
        for among in AMONG:
            names = among.controller, among.agent
            if among.rows == "teams":
                entered = flocks.team_parts(names, among.of, WORLDS, WORLDS, "mujoco")
                drive_missing(OTHERS["teams"], flocks.TEAM_FIELDS, entered)
            else:
                entered = (each for each in flocks.people_parts(names, 1, "mujoco") if each[0]["contest"] in among.of)
                drive_missing(OTHERS["people"], flocks.PEOPLE_FIELDS, entered)
    write_whole(PAGE, page(read(TABLE), read(PAPERS), read(CHAIN), read(DOMAIN)).encode())


if __name__ == "__main__":
    main()
