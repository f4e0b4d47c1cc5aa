"""Published claims, run again: the table of all, from kept rows.

    nice -n 19 python benchmarks/studies/papers.py --drive NAME

Our own claims are read from the rows of the pages that they stand on, CrowdNav's from those of flocks; the others from
docs/results/papers.csv, to which --drive adds.
"""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import click
import flocks
import part_rows
import sections
from packed_rows import SUFFIX, read_packed

from wayfield.benchmarks.contests import ALL_CONTESTS
from wayfield.benchmarks.papers import CLAIMS
from wayfield.benchmarks.papers.claim import (
    AGENT,
    DOES_NOT_HOLD,
    HOLDS,
    LABELS,
    MARGINS,
    NO_VERDICT,
    ONLY_UNTUNED,
    OPEN,
    Claim,
    Driven,
    Finding,
    drive,
    gate_words,
    gathered,
    judge,
    measured_words,
    shown,
    written,
)
from wayfield.benchmarks.statistics.paired import holm
from wayfield.envs.scenarios.team_families import TEAM_FAMILIES
from wayfield.system.storage import write_whole

RESULTS = Path(sections.RESULTS)
TABLE, PAGE = RESULTS / "papers.csv", RESULTS / "papers.md"
PACKED = {"own_paths": "path-following-claims", "own_goals": "goal-obstacles-claims"}  # rows of pages
TUNED = " tuned"
# s of a core: of claims as they are frozen, and of trainings that were run through to their end or have no card
FROZEN: Mapping[str, float] = {
    "own_paths": 44.0,
    "own_goals": 163.0,
    "crowdnav": 18.0,
    "crowdnav_sarl": 56.0,
    "ros_jackal": 14.0,
    "dwa_switch": 57.0,
    "lookahead_ppo": 9.0,
    "training_worlds": 43.0,
    "applr": 246.0,
}
TRAINED: Mapping[str, float] = {"lookahead_ppo": 66.0, "training_worlds": 61.0}
OWN = "wayfield,"  # what the sources of our own claims begin with

AFTER = (
    "## A look-ahead by a rule, not shipped",
    "",
    "(b) of `lookahead_ppo` is a rule of speed, error and heading error. It was to become a controller of the package "
    "if it beat tuned regulated pure pursuit on the test split. It did not. On smooth paths its error is 1.82 mm, and "
    "that of regulated pure pursuit 1.96 mm (7.1 [0.8, 13.4] % less, p = 0.03 before correction, n = 100), at 0.59 m/s "
    "against 0.64 m/s. On paths with corners (n = 30) it fails in a third. With numbers that were searched on all "
    "paths "
    "it fails in none, but its error is 204 mm, and that of regulated pure pursuit 7.3 mm.",
    "",
    "## Left out",
    "",
    "- A residual on pure pursuit cuts lap times (Trumpp et al. 2023). This needs a car with tyres, which the package "
    "does not have.",
    "- Learned speed lowers the error of poor steering (Chemin et al. 2024). Here driving slower lowers no error: "
    "that of "
    "pure pursuit is 10.6 mm at 0.6 m/s, 12.0 mm at 0.45 m/s, and 13.6 mm where it slows down in bends. A network "
    "trained to choose the speed (0.5 M steps) drove as fast as it could. The claim needs a base that slips or steers "
    "late.",
)

Row = Mapping[str, str]


def of_page(claim: Claim, rows: Iterable[Row]) -> Iterator[dict[str, str]]:
    """Yields the rows of a claim from those of a published contest."""
    metric = ALL_CONTESTS[claim.contest].cost.metric if claim.measure == "error" else "time"
    wanted = {(side.policy, side.gains): name for name, side in claim.sides.items()}
    for row in rows:
        name = wanted.get((row["policy"], row["gains_name"]))
        here = row["split"] == claim.split and row["family"] in claim.families and not row["speed"]
        if name and here and row["disturbance"] == "none":
            scene = {"claim": claim.name, "side": name, "seed": row["agent_seed"], "family": row["family"]}
            yield {**scene, "scene": row["episode"], "success": row["success"], "cost": row[metric]}


def of_flocks(claim: Claim, rows: Iterable[Row], success: str, cost: str) -> Iterator[dict[str, str]]:
    """Yields the rows of a claim from those of the study of teams and people."""
    wanted = {side.policy + (TUNED if side.gains == "tuned" else ""): name for name, side in claim.sides.items()}
    for row in rows:
        policy, _, seed = row["policy"].partition(" seed ")
        if policy in wanted:
            scene = {"claim": claim.name, "side": wanted[policy], "seed": seed, "family": row["family"]}
            yield {**scene, "scene": row["world"], "success": row[success], "cost": row[cost]}


def rows_of(claim: Claim, root: Path) -> list[dict[str, str]]:
    """Returns the kept rows of a claim."""
    if claim.name in PACKED:
        return list(of_page(claim, read_packed(root / sections.ROWS / f"{PACKED[claim.name]}{SUFFIX}")))
    if claim.contest == "teams":
        rows = []
        for row in flocks.independent(part_rows.read(root / RESULTS / flocks.FILES["teams"])):
            family = row["family"]
            if flocks.is_of("open", family) and TEAM_FAMILIES[family].team <= flocks.TESTED:
                turned = family.startswith(flocks.TURNED)  # one stratum, a size a scene
                rows.append({**row, "family": flocks.TURNED, "world": family} if turned else row)
        return list(of_flocks(claim, rows, "solved", "extra_time"))
    if claim.name == "crowdnav":
        people = part_rows.read(root / RESULTS / flocks.FILES["people"])
        return list(of_flocks(claim, [row for row in people if row["contest"] == "crowdnav"], "success", "time"))
    return [row for row in read(root) if row["claim"] == claim.name]


def read(root: Path = Path()) -> list[dict[str, str]]:
    """Returns the rows that were driven for this page alone."""
    file = root / TABLE
    return list(csv.DictReader(io.StringIO(file.read_text("utf-8")))) if file.exists() else []


Judged = tuple[
    Claim, Finding, dict[str, Driven], int, str
]  # with the number of scenes, and the verdict if it stood alone


def judged(root: Path = Path()) -> list[Judged]:
    """Returns the claims with their verdicts, corrected for all comparisons that the page shows."""
    claims = [(claim, *gathered(rows_of(claim, root))) for claim in CLAIMS.values()]
    first = [judge(*each) for each in claims]
    names = [(k, name) for k, each in enumerate(first) if each.verdict != NO_VERDICT for name in each.gains]
    corrected = dict(zip(names, holm([first[k].gains[name].p for k, name in names]), strict=True))
    return [
        (
            claim,
            judge(claim, sides, strata, {name: corrected.get((k, name), 1.0) for name in sides if name != AGENT}),
            sides,
            len(strata),
            first[k].verdict,
        )
        for k, (claim, sides, strata) in enumerate(claims)
    ]


def counted(claims: Sequence[Judged]) -> str:
    """Returns how many claims hold, of papers and of our own, in two sentences."""
    kinds = (HOLDS, ONLY_UNTUNED, DOES_NOT_HOLD, OPEN, NO_VERDICT)
    counts_of = []
    for words, own in (("claims of papers", False), ("claims of our own front page", True)):
        mine = [each.verdict for claim, each, *_ in claims if claim.source.startswith(OWN) == own]
        counts = ", ".join(f"{mine.count(kind)} {kind}" for kind in kinds[1:] if kind in mine)
        counts_of.append(f"{mine.count(HOLDS)} of {len(mine)} {words} hold{f' ({counts})' if counts else ''}")
    return f"{'; '.join(counts_of)}."


def gain_words(claim: Claim, finding: Finding, name: str) -> str:
    """Returns how the claimed policy does against a side; nothing where the rival is not the source's."""
    there = name in finding.gains and finding.verdict != NO_VERDICT
    return shown(finding.gains[name], claim.measure) if there else ""


def trained_seconds(claim: Claim, root: Path) -> float:
    """Returns what the training of a claim's agents took, s of a core by their cards; 0 where none is trained."""
    if claim.training is None or claim.training.function:
        return TRAINED.get(claim.name, 0.0)
    files = [
        root / "policies/agents" / claim.training.ships / f"seed_{seed}/card.json"
        for seed in range(claim.training.seeds)
    ]
    cards = [json.loads(file.read_text("utf-8"))["training"] for file in files]
    return float(sum(card.get("run_cpu_seconds", card["run_seconds"]) for card in cards))


def times(root: Path) -> Iterator[str]:
    """Yields the lines on what a re-run takes."""
    trained = {name: trained_seconds(claim, root) for name, claim in CLAIMS.items()}
    words = "To drive the claims as they are frozen", "To train all agents anew, three of a preset"
    for what, each in zip(words, (FROZEN, trained), strict=True):
        parts = ", ".join(f"`{name}` {seconds:.0f}" for name, seconds in each.items() if seconds)
        total = sum(each.values())
        yield f"- {what}: {total:.0f} s of a core, {total / 7200.0:.2f} hours on two: {parts}."
    yield ""
    yield (
        "Measured with two workers on an otherwise idle machine, `crowdnav_sarl` on a busy one; `own_teams` is not "
        "among them. The rows of `ros_jackal`, `dwa_switch`, `lookahead_ppo`, `training_worlds` and `applr` came out "
        "as published. `--train` was run through to its end for three claims, the drive included: `lookahead_ppo` "
        "(75 s) and `training_worlds` (104 s) gave the published rows again, and `own_paths` (251 s, 327 s of a core) "
        "the same verdict; PPO has 3.24 mm with its three new seeds. The others are the sums of the agents' cards."
    )


def page(root: Path = Path()) -> str:
    """Returns the page."""
    claims = judged(root)
    margins = ", ".join(
        f"{100.0 * margin:g} {'points of success' if name == 'success' else f'% of {name}'}"
        for name, margin in MARGINS.items()
    )
    rules = {
        HOLDS: "it is better than (b), and than (c) where there is one",
        ONLY_UNTUNED: "it is better than (a), and against (b) at best better by less than the margin",
        DOES_NOT_HOLD: "it is not better than (a), and against (b) at best better by less than the margin",
        OPEN: "no (b) was searched; or the interval against (b) reaches beyond the margin; or it is better than (b) "
        "and not "
        "than (c); or it is not better than (b) and was trained for less than the source's",
        NO_VERDICT: "(a) misses the printed number by more than the margin. Then nothing is compared",
    }
    lines = [
        "# Published claims, run again", "",
        "Made by `python benchmarks/studies/papers.py` from kept rows. [All results](../results.md). "
        "[How to add a claim, and how authors answer](../claims.md).", "",
        f"**{counted(claims)}** Each verdict is about a setting of ours, which differs from the paper's. Read that "
        "first.", "",
        "A claim says that one policy does better than a rival. (a) is the rival as the source has it. (b) is the "
        "rival with gains that were searched on training scenes. (c) is a part of the claimed policy, driven alone. No "
        "verdict looks at a policy that is called `beside`.", "",
        "All policies drive the same scenes. Better means: the 95 % interval of the paired difference lies above 0, "
        "and p is below 0.05 after Holm's correction for all comparisons of this page. "
        f"The margins are {margins}. A time is the mean of all scenes, where a failure counts as the time limit. An "
        "error is compared in the scenes that both finish.", "",
        "| verdict on the claimed policy | when |",
        "|---|---|",
        *(f"| {verdict} | {when} |" for verdict, when in rules.items()), "",
        "The claims, each with successes, and the mean time or error of the successes (where times are compared, of "
        "all "
        "scenes):", "",
        "| claim | what differs most | setting | claimed | (a) | (b) | against (a) | against (b) | n | verdict |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for claim, each, sides, scenes, alone in claims:
        driven = [measured_words(claim, sides[name]) if name in sides else "" for name in (AGENT, "a", "b")]
        gains = [gain_words(claim, each, name) for name in ("a", "b")]
        cells = [claim.sentence, claim.differs[0], claim.setting, *driven, *gains, str(scenes)]
        cells.append(each.verdict if alone == each.verdict else f"{each.verdict} (alone: {alone})")
        lines.append(f"| {' | '.join(cells)} |")
    for claim, each, sides, scenes, alone in claims:
        lines += ["", f"## {claim.name}", "", f"{claim.sentence} {claim.source}.", ""]
        lines += ["What differs from the source:", "", *(f"- {line}" for line in claim.differs), ""]
        lines += ["| printed | number | where |", "|---|---|---|"]
        lines += [f"| {row.words} | {row.number} | {row.place} |" for row in claim.printed]
        lines += [
            "",
            "| side | policy | budget | success; time or error | seeds | claimed against it | p, corrected |",
            "|---|---|---|---|---|---|---|",
        ]
        for name, side in claim.sides.items():
            cells = [LABELS[name], side.words, side.budget, measured_words(claim, sides[name])]
            against = gain_words(claim, each, name)
            cells += [str(sides[name].success.shape[1]), against, f"{each.ps[name]:.2g}" if against else ""]
            lines.append(f"| {' | '.join(cells)} |")
        command = claim.published or f"wayfield evaluate --suite papers --claim {claim.name}"
        command += " --data FOLDER" if claim.data else ""
        lines += [
            "",
            f"n = {scenes} scenes. Gate: {gate_words(claim, each.measured)}. Verdict: **{each.verdict}**"
            + (
                f"; alone, without the correction for this page, it would be: {alone}."
                if alone != each.verdict
                else "."
            ),
            "",
        ]
        lines += [f"What would change it: {claim.would_change}", "", f"Again: `{command}`."]
        lines[-1] += f" The folder must have {claim.data}." if claim.data else ""
        lines += ["", f"The authors answer: {claim.answer}"] if claim.answer else []
    return "\n".join([*lines, "", "## What a re-run takes", "", *times(root), "", *AFTER, ""])


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--drive", "names", multiple=True, type=click.Choice(list(CLAIMS)), help="A claim to drive anew.")
@click.option("--data", type=click.Path(exists=True, path_type=Path), help="The folder that a claim needs.")
def main(names: tuple[str, ...], data: Path | None) -> None:
    """Drives claims, and makes the page."""
    for name in names:
        rows = [row for row in read() if row["claim"] != name] + list(drive(CLAIMS[name], home=data))
        write_whole(TABLE, written(rows))
    write_whole(PAGE, page().encode())


if __name__ == "__main__":
    main()
