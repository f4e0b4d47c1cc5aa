"""Audits published tables, or those of a run: python benchmarks/studies/audit.py [RUN]

Every number of the standings, of the pairs and of the claims is made a second time from the rows, with formulas of its
own (`audit_formulas`). Then the coverage of the intervals is measured in resamples of the rows, conditions that are not
the same for all are looked for, and what a sceptic would ask is printed. Sets of gains that are named after a search
are compared with its record (`audit_searches`). Status 1 where a cell disagrees.
"""

import csv
import itertools
import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import audit_formulas as formulas
import click
import numpy as np
from audit_searches import holds, misnamed_rows, missing_records, shipped_gains
from interval_coverage import HOLDS
from kept_rows import SUFFIX, read_packed
from results_page import CHOOSING, Kept, disagreements
from sections import SECTIONS

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.records.results import EPISODES, read_run, read_table
from wayfield.benchmarks.statistics.aggregates import counted_interval
from wayfield.system.command_line import OneLineErrors

Row = Mapping[str, str]  # the audit reads files as text

KEPT = Path("docs/results")
LEAST = 5  # scenarios of a family, under which nothing may stand in brackets
APART = 0.03  # relative, of mean speeds
MARK = "‡"
RESAMPLES = 200  # of the rows, in which coverage is measured
COMPARED = ("test", "claims", "own", "public")
LEARNED = ("ppo", "hybrid")  # whose differences from the others are claimed
_SEARCHED = ("tuned", "robust")  # sets of gains
_FLOOR = ("zero", "random")
_MOVED = frozenset(("speed", "max_speed", "k_lin", "k_ang"))  # gains that a cruising speed sets
# what successes are compared by, as tables call it: the metric
_METRICS = {"tracking error": "tracking_rms", "RMS error": "cross_track_rms", "time": "time"}
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")


def texts(names: Sequence[str], lines: Iterable[Sequence[str]]) -> list[Row]:
    """Returns the lines of a table as rows of text."""
    return [dict(zip(names, line, strict=True)) for line in lines]


class Audit:
    """What was found: cells that disagree, and questions."""

    def __init__(self) -> None:
        self.wrong: list[str] = []
        self.questions: list[str] = []
        self.cells = 0

    def check(self, what: str, shown: str, wanted: float, tolerance: float | None = None) -> None:
        """Compares a shown number with what it should be, to the last digit that is shown."""
        found = _NUMBER.search(shown)
        self.cells += 1
        if found is None or math.isnan(wanted):
            if bool(found) != (not math.isnan(wanted)):
                self.wrong.append(f"{what}: shows {shown or 'nothing'}, the rows give {wanted:.6g}")
            return
        digits = len(found[0].partition(".")[2])
        # a number halfway between two may be rounded either way, and the rows are kept with six digits
        allowed = 0.5001 * 10.0**-digits + 2e-6 * abs(wanted) if tolerance is None else tolerance
        if abs(float(found[0]) - wanted) > allowed:
            self.wrong.append(f"{what}: shows {found[0]}, the rows give {wanted:.6g}")

    def note(self, what: str) -> None:
        """Keeps a disagreement that is no number."""
        self.wrong.append(what)

    def ask(self, question: str) -> None:
        """Keeps a question, once."""
        if question not in self.questions:
            self.questions.append(question)


def label(row: Row) -> str:
    """Returns how tables call the entry of a row."""
    return row["policy"] if row["gains_name"] == "default" else f"{row['policy']} ({row['gains_name']})"


def entries(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Returns the rows of each entry."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(label(row), []).append(row)
    return found


def strata(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Returns the scenarios of each family; the user's own, or public ones each alone in one, are one."""
    found: dict[str, set[str]] = {}
    families, scenarios = ({row[name] for row in rows} for name in ("family", "scenario"))
    alone = rows[0]["split"] == "public" and len(families) == len(scenarios)
    for row in rows:
        name = "own" if row["split"] == "own" or alone else row["family"]
        found.setdefault(name, set()).add(f"{row['scenario']} {row['episode']}")
    return {name: sorted(each) for name, each in found.items()}


def audit_standings(audit: Audit, rows: Sequence[Row], table: Sequence[Row], where: str) -> None:
    """Makes the standings a second time."""
    mine = entries([row for row in rows if row["split"] in COMPARED])
    known = {(row["policy"], row["gains"]): row for row in table}
    for name, group in mine.items():
        line = known.pop((group[0]["policy"], group[0]["gains_name"]), None)
        if line is None:
            audit.note(f"{where}: {name} has rows and no line")
            continue
        few = min(map(len, strata(group).values())) < LEAST
        for header, cell in line.items():
            if header not in formulas.MEANINGS:
                continue
            of, metric, reduce, factor = formulas.MEANINGS[header]
            numbers = of(group, metric)
            missing = not numbers or any(map(math.isnan, numbers))
            there = [number for number in numbers if not math.isnan(number)]
            audit.check(f"{where}, {name}, {header}", cell, factor * reduce(there) if there else math.nan)
            if "[" in cell and few:
                audit.note(f"{where}, {name}, {header}: brackets of fewer than {LEAST} scenarios a family")
            if "[" in cell and not missing:
                _check_ends(audit, f"{where}, {name}, {header}", cell, group, header)
        _check_pace(audit, where, name, group, line)
    for policy, gains in known:
        audit.note(f"{where}: {policy} ({gains}) has a line and no rows")


def _check_ends(audit: Audit, what: str, cell: str, rows: Sequence[Row], header: str) -> None:
    """Compares brackets with those of other formulas: exactly for shares, by their width for the rest."""
    of, metric, reduce, factor = formulas.MEANINGS[header]
    value, low, high = (float(each) for each in _NUMBER.findall(cell))
    if not low - 1e-9 <= value <= high + 1e-9 or low == high:
        audit.note(f"{what}: [{low:g}, {high:g}] is no interval of {value:g}")
    if len({row["agent_seed"] for row in rows}) > 1:
        return  # two samples at once: their coverage is measured instead
    if header == "success (%)":
        ends = formulas.binomial_ends(sum(map(formulas.won, rows)), len(rows))
        audit.check(f"{what}, low end", f"{low}", 100.0 * ends[0], 0.06)
        audit.check(f"{what}, high end", f"{high}", 100.0 * ends[1], 0.06)
        return
    families: dict[str, list[Row]] = {}
    for row in rows:
        families.setdefault(row["family"], []).append(row)
    if reduce is formulas.average:
        failure = formulas.average(formulas.every(rows, "failure_cost")) if of is formulas.counted else 0.0
        runs = [list(zip(of(each, metric), map(formulas.won, each), strict=True)) for each in families.values()]
        below, above = formulas.counted_ends(runs, failure)
    else:
        below, above = formulas.resampled([of(each, metric) for each in families.values()], reduce)
    width = factor * (above - below)
    digits = len(_NUMBER.findall(cell)[0].partition(".")[2])
    if not 0.7 * width - 10.0**-digits <= high - low <= 1.5 * width + 10.0**-digits:
        audit.note(f"{what}: is {high - low:.4g} wide, resampling gives {width:.4g}")


def _check_pace(audit: Audit, where: str, name: str, rows: Sequence[Row], line: Row) -> None:
    """Looks for an entry that drives at another speed than was asked for, and is not marked."""
    cell = line.get("mean speed (m/s)")
    asked = 0.6
    if cell is None or not any(map(formulas.won, rows)):
        return
    speed = formulas.average(formulas.of_successes(rows, "mean_speed"))
    off = abs(speed - asked) > APART * asked
    if off != (MARK in cell):
        audit.note(
            f"{where}, {name}: drives {speed:.3f} m/s where {asked} were asked for, and is marked {MARK in cell}"
        )
    if off:
        audit.ask(f"{where}: {name} drives {speed:.2f} m/s, asked for {asked:g}: what is its error at that speed?")


def audit_shares(audit: Audit, rows: Sequence[Row], table: Sequence[Row], where: str) -> None:
    """Makes the matrix of shares a second time."""
    mine = entries([row for row in rows if row["split"] in COMPARED])
    metric = _compared_by([row for group in mine.values() for row in group])
    for line in table:
        for other, cell in line.items():
            if other == "policy" or not cell or line["policy"] not in mine or other not in mine:
                continue
            shares = _wins(mine[line["policy"]], mine[other], metric)
            whole = [share for of_family in shares.values() for share in of_family]
            audit.check(f"{where}, {line['policy']} / {other}", cell, formulas.average(whole))


def _wins(ours: Sequence[Row], theirs: Sequence[Row], metric: str) -> dict[str, list[float]]:
    """Returns, by family, for each scenario how often the first did better, over all agents of both."""
    by_scene: dict[tuple[str, str], list[Row]] = {}
    for row in theirs:
        by_scene.setdefault((row["scenario"], row["episode"]), []).append(row)
    scenes: dict[tuple[str, str, str], list[float]] = {}
    for row in ours:
        key = row["scenario"], row["episode"]
        scenes.setdefault((row["family"], *key), []).extend(_win(row, other, metric) for other in by_scene[key])
    found: dict[str, list[float]] = {}
    for (family, *_), wins in scenes.items():
        found.setdefault(family, []).append(formulas.average(wins))
    return found


def _win(a: Row, b: Row, metric: str) -> float:
    if formulas.won(a) != formulas.won(b):
        return 1.0 if formulas.won(a) else 0.0
    ours, theirs = formulas.value(a, metric), formulas.value(b, metric)
    if not formulas.won(a) or ours == theirs:
        return 0.5
    return 1.0 if ours < theirs else 0.0


def _compared_by(rows: Sequence[Row]) -> str:
    """Returns the metric that successes are compared by: along paths tracking, where each of them has that."""
    if not rows[0]["contest"].startswith("path"):
        return "time"
    tracked = all(row.get("tracking_rms") for row in rows if formulas.won(row))
    return "tracking_rms" if tracked else "cross_track_rms"


def audit_pairs(audit: Audit, rows: Sequence[Row], table: Sequence[Row], where: str) -> None:
    """Makes the differences of all pairs a second time; looks for comparisons of agents that are left out."""
    contest = CONTESTS[rows[0]["contest"]]
    groups: dict[tuple[str, str, str], list[Row]] = {}
    known = {family: scenes for scenes, families in contest.scenes.items() for family in families}
    told = [row for row in rows if row["split"] in (*COMPARED, "front")]
    apart = {row["family"] for row in told} <= set(known)
    for row in told:
        scenes = known[row["family"]] if apart else ""
        groups.setdefault((row["speed"], row["disturbance"], scenes), []).append(row)
    there = {
        (*_condition(line["condition"]), line["scenes"], frozenset((line["policy"], line["beside"]))) for line in table
    }
    for key, group in groups.items():
        mine = entries(group)
        for agent, other in itertools.permutations(mine, 2):
            if mine[agent][0]["policy"] in LEARNED and (*key, frozenset((agent, other))) not in there:
                audit.note(f"{where}: {agent} is not compared with {other} where {' '.join(filter(None, key))}")
    for line in table:
        mine = entries(groups.get((*_condition(line["condition"]), line["scenes"]), []))
        ours, theirs = mine.get(line["policy"]), mine.get(line["beside"])
        if ours is None or theirs is None:
            audit.note(f"{where}: {line['condition']}, {line['beside']} has a line and no rows")
            continue
        shares = [100.0 * formulas.average(formulas.every(each, "success")) for each in (ours, theirs)]
        what = f"{where}, {line['condition']}, {line['scenes']}, {line['policy']} / {line['beside']}"
        audit.check(f"{what}, success", line["success (points)"], shares[0] - shares[1])
        audit.check(
            f"{what}, cost", line["cost where both succeed"], _cost_of_both(ours, theirs, _METRICS[line["compared by"]])
        )
        audit.cells += 1
        if _METRICS[line["compared by"]] != (wanted := _compared_by([row for each in mine.values() for row in each])):
            audit.note(f"{what}: is compared by {line['compared by']}, the rows have {wanted}")


def _condition(words: str) -> tuple[str, str]:
    """Returns the asked speed and the level of disturbance that a condition names."""
    speed = re.search(r"asked for ([\d.]+) m/s", words)
    level = re.search(r"(\w+) disturbance", words)
    return speed[1] if speed else "", level[1] if level else "none"


def _cost_of_both(ours: Sequence[Row], theirs: Sequence[Row], metric: str) -> float:
    """Returns the middle half of differences of errors, mm, or the mean of those of times, s, where both succeed."""
    by_scene: dict[tuple[str, str], list[float]] = {}
    for row in theirs:
        if formulas.won(row):
            by_scene.setdefault((row["scenario"], row["episode"]), []).append(formulas.value(row, metric))
    seeds = len({row["agent_seed"] for row in ours}) * len({row["agent_seed"] for row in theirs})
    scenes: dict[tuple[str, str, str], list[float]] = {}
    for row in ours:
        for other in by_scene.get((row["scenario"], row["episode"]), []) if formulas.won(row) else ():
            key = row["family"], row["scenario"], row["episode"]
            scenes.setdefault(key, []).append(formulas.value(row, metric) - other)
    count: dict[str, int] = {}
    for family, *_ in scenes:
        count[family] = count.get(family, 0) + 1
    found = [
        number
        for (family, *_), there in scenes.items()
        if count[family] >= LEAST
        for number in (*there, *[formulas.average(there)] * (seeds - len(there)))
    ]
    if not found:
        return math.nan
    return formulas.average(found) * (1.0 if metric == "time" else 1e3)


def audit_verdicts(audit: Audit, folder: Path) -> None:
    """Looks for a pair with two verdicts, judged anew from its p, and for advice that the rows speak against."""
    store = Kept(folder.parents[1])
    for section, _ in store.sections():
        page = store.text(f"{folder.as_posix()}/{section.name}.md") if folder == KEPT else ""
        places = [section.place(name) for name in section.tables if name.endswith("_pairs.csv")]
        stems = [each.removeprefix(f"{KEPT.as_posix()}/").removesuffix(".csv") for each in places if each in store]
        table = [line for stem in stems for line in store.rows(stem)]
        ps = formulas.stepped_down([float(line[each] or "nan") for line in table for each in _PS])
        for line, p, q in zip(table, ps[::2], ps[1::2], strict=True):
            words = formulas.verdict(line, p, q)
            audit.cells += 1
            if page and _shown_verdict(page, line) not in (words, _in_columns(words)):
                audit.note(
                    f"{section.name}, {line['condition']}, {line['scenes']}: {line['policy']} beside "
                    f"{line['beside']} is {words!r}, not so on its page"
                )
    if folder == KEPT:
        for each in disagreements(store, store.text(CHOOSING)):
            audit.note(f"{CHOOSING}: {each}")


_PS = ("p of success", "p of cost")


def _in_columns(words: str) -> str:
    """Returns how a table with a column a condition shows a verdict."""
    told = words.rpartition("; ")[2].replace(" successes", "").replace("not significant", "n. s.")
    return "-" if " or " in words else told


def _shown_verdict(page: str, line: Row) -> str:
    """Returns the verdict on a page: in the table of its condition, or in the column of that in one of several."""
    for heading, table in re.findall(r"^### (.+)\n\n((?:\|.*\n)+)", page, re.MULTILINE):
        where, _, policy = heading.rpartition(": ")
        header, _, *rows = ([cell.strip() for cell in row.strip("|").split("|")] for row in table.splitlines())
        where = where.removesuffix(f", {line['scenes']}") if line["scenes"] else where
        rest = line["condition"].removeprefix(where).lstrip(", ")
        column = rest.partition(",")[0].replace(" disturbance", "") or "is"
        if policy == line["policy"] and line["condition"].startswith(where) and column in header:
            for row in rows:
                if row[0] == line["beside"]:
                    return str(row[header.index(column)])
    return ""


def audit_pairing(audit: Audit, rows: Sequence[Row], where: str) -> None:
    """Looks for entries that met other scenarios or seeds, and for noise that is the same in several scenes."""
    kinds: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        if row["split"] in (*COMPARED, "front"):
            kinds.setdefault((row["split"], row["speed"], row["disturbance"]), []).append(row)
    for kind, group in kinds.items():
        met = {
            name: {(row["scenario"], row["episode"], row["seed"]) for row in each}
            for name, each in entries(group).items()
        }
        first = next(iter(met))
        for name, each in met.items():
            if each != met[first]:
                audit.note(f"{where}, {' '.join(kind)}: {name} met other scenarios or seeds than {first}")
        scenes = met[first]
        if len({seed for *_, seed in scenes}) < len(scenes):
            audit.ask(
                f"{where}, {' '.join(kind)}: the same seeds drive several scenes: is their noise one sample or many?"
            )
        if (few := min(map(len, strata(group).values()))) < LEAST:
            audit.ask(f"{where}, {' '.join(kind)}: {few} scenarios in a family: why not {LEAST}, for an interval?")


def audit_conditions(audit: Audit, rows: Sequence[Row], where: str) -> None:
    """Asks about gains that were tuned elsewhere, budgets that differ, and what entries are told."""
    tested = [row for row in rows if row["split"] in (*COMPARED, "front")]
    found = entries(tested)
    for name, group in found.items():
        if group[0]["gains_name"] not in _SEARCHED:
            continue
        elsewhere = [each for row in {row["gains"]: row for row in group}.values() for each in _tuned_elsewhere(row)]
        if elsewhere:
            audit.ask(
                f"{where}: {name} was tuned for another condition than {', '.join(elsewhere)}: at its best there?"
            )
        if any(each["searched_on"]["split"] == "validation" for row in group[:1] for each in _files(row)):
            audit.ask(f"{where}: {name} was searched for on the split that it was chosen by: what would another give?")
        if (
            len({row["disturbance"] for row in group} - {"none"})
            and group[0]["gains_name"] == "tuned"
            and not any("--also" in each["command"] for each in _files(group[0]))
        ):
            audit.ask(f"{where}: {name} was tuned without disturbances: where are gains that were tuned under them?")
        if len({row["speed"] for row in group if row["speed"]}) > 1 and len(_other_gains(group)) == 1:
            audit.ask(f"{where}: {name} has one set of gains at every asked speed: which is it at its best?")
    sets = {(group[0]["policy"], group[0]["gains_name"]) for group in found.values()}
    budgets = {
        name: group[0]["learned_from"]
        for name, group in found.items()
        # beside a set that was searched for, the law's own is not its best
        if group[0]["gains_name"] not in ("paper", "own")
        and not (group[0]["gains_name"] == "default" and {(group[0]["policy"], each) for each in _SEARCHED} & sets)
    }
    frames = {
        name: float(match[1]) for name, text in budgets.items() if (match := re.match(r"([\d.]+)(?: M)? frames", text))
    }
    if untold := [name for name in budgets if name not in frames]:
        audit.note(f"{where}: the budget of {', '.join(untold)} is not in frames")
    if none := [name for name, count in frames.items() if count == 0.0 and name not in _FLOOR]:
        audit.ask(f"{where}: nothing was searched for {', '.join(none)}: what would a search find?")
    if (some := {name: count for name, count in frames.items() if count > 0.0}) and max(some.values()) > 1.5 * min(
        some.values()
    ):
        least, most = min(some, key=some.__getitem__), max(some, key=some.__getitem__)
        told = f"{most} learned from {some[most]:g} M frames, {least} from {some[least]:g} M"
        audit.ask(f"{where}: {told}: what if it had as many?")
    known = {group[0]["knows"] for group in found.values()}
    if len(known) > 1:
        audit.ask(f"{where}: entries are told {', '.join(sorted(known))}: which of them may be compared?")


def _files(row: Row) -> list[dict[str, Any]]:
    """Returns the files of gains that a row was driven with."""
    return [
        each for _, each in shipped_gains() if each["policy"] == row["policy"] and holds(each, row["gains"], _MOVED)
    ]


def _tuned_elsewhere(row: Row) -> list[str]:
    """Returns the robot and the asked speed of a row, if the gains that it was driven with were tuned for others."""
    files = _files(row)
    found = []
    for key, shown, unsaid in (("robot", row["robot"], "p3dx"), ("speed", row["speed"] or "0.6", 0.6)):
        if files and shown not in {f"{each.get(key, unsaid)}" for each in files}:
            found.append(shown if key == "robot" else f"{shown} m/s")
    return found


def _other_gains(rows: Sequence[Row]) -> set[str]:
    """Returns the sets of gains of the rows of the front, cruising speed left out."""
    without = r"\b(?:speed|max_speed|k_lin|k_ang)=\S+ ?"
    return {re.sub(without, "", row["gains"]).strip() for row in rows if row["speed"]}


def measured_coverage(audit: Audit, rows: Sequence[Row], where: str) -> None:
    """Measures how often an interval of a resample of the rows holds what all the rows have, for three entries."""
    mine = entries([row for row in rows if row["split"] in COMPARED])
    for name in list(mine)[:: max(len(mine) // 3, 1)][:3]:
        group = sorted(mine[name], key=lambda row: (row["scenario"], row["episode"], row["agent_seed"]))
        agents = len({row["agent_seed"] for row in group})
        cost = _compared_by(group)
        numbers = np.array(formulas.counted(group, cost)).reshape(-1, agents)
        succeeded = np.array([float(formulas.won(row)) for row in group]).reshape(-1, agents)
        failure = formulas.average(formulas.every(group, "failure_cost"))
        names = [row["family"] for row in group[::agents]]
        if min(map(len, strata(group).values())) < LEAST or np.isnan(numbers).any():
            continue
        true = formulas.average(numbers.ravel().tolist())
        families = np.array(names)
        members = [np.flatnonzero(families == each) for each in dict.fromkeys(names)]
        rng = np.random.default_rng(1)
        inside = 0
        for k in range(RESAMPLES):
            lines = np.concatenate([rng.choice(each, len(each)) for each in members])
            columns = rng.integers(agents, size=agents)
            sample, met = numbers[lines][:, columns], families[lines].tolist()
            ends = counted_interval(sample, succeeded[lines][:, columns], failure, met, k, 400)
            inside += ends is not None and ends[0] <= true <= ends[1]
        share = inside / RESAMPLES
        print(f"  coverage of the interval of {name}: {100.0 * share:.1f} % of {RESAMPLES} resamples")
        if share < HOLDS - 2.5 * math.sqrt(HOLDS * (1.0 - HOLDS) / RESAMPLES):
            audit.note(f"{where}, {name}: 95 % intervals hold in {100.0 * share:.1f} % of resamples")


def found_runs(folder: Path) -> Iterator[tuple[str, Sequence[Row], Path]]:
    """Yields name, rows, and the folder of the tables of each run: one run, or those that a repository keeps.

    Raises:
        ValueError: if the folder holds neither; the message names it.
        OSError: if a file cannot be opened.
    """
    if (folder / EPISODES).is_file():
        yield folder.name, read_run(folder, texts), folder
        return
    kept = sorted((folder / "rows").glob(f"*{SUFFIX}"))
    if not kept:
        raise ValueError(f"{folder} holds neither {EPISODES} of a run nor rows/*{SUFFIX} of published ones")
    within = {section.name: section.within for section in SECTIONS}
    for file in kept:
        name = file.name.removesuffix(SUFFIX)
        yield name, read_packed(file), folder / within.get(name, "")


def audit_run(audit: Audit, name: str, rows: Sequence[Row], folder: Path) -> None:
    """Audits the tables of a run that its rows can tell about."""
    contests = dict.fromkeys((row["contest"], row["robot"]) for row in rows if row.get("contest"))
    for contest, robot in contests:
        mine = [row for row in rows if (row["contest"], row["robot"]) == (contest, robot)]
        mine = [{"speed": "", **row} for row in mine]
        stem = f"{contest.replace('-', '_')}_{robot}"
        ladder = len({row["disturbance"] for row in mine}) > 1
        ends = (
            {"_ladder_pairs": audit_pairs}
            if ladder
            else {"": audit_standings, "_better": audit_shares, "_pairs": audit_pairs}
        )
        print(f"{name}, {stem}: {len(mine)} rows")
        for end, function in ends.items():
            file = folder / f"{stem}{end}.csv"
            if file.is_file():
                function(audit, mine, read_table(file, texts), file.stem)
        audit_pairing(audit, mine, f"{name}, {robot}")
        audit_conditions(audit, mine, f"{name}, {robot}")
        if not ladder:
            measured_coverage(audit, mine, f"{name}, {robot}")


@click.command("audit", cls=OneLineErrors)
@click.argument("run", required=False, type=click.Path(path_type=Path, exists=True, file_okay=False))
def main(run: Path | None) -> None:
    """Audits RUN, the folder of a run; without it the tables that the repository publishes, in docs/results.

    Ends with status 1 where a cell disagrees with the rows.
    """
    csv.field_size_limit(2**31 - 1)
    audit = Audit()
    try:
        sets = dict(shipped_gains())
        for name, rows, folder in found_runs(run or KEPT):
            audit_run(audit, name, rows, folder)
            for each in (
                misnamed_rows([{"speed": "", **row} for row in rows if row.get("contest")], sets, name)
                if run is None
                else ()
            ):
                audit.note(each)
        if run is None:
            audit_verdicts(audit, KEPT)
            for each in missing_records(sets):
                audit.note(each)
    except (OSError, ValueError) as error:
        raise click.ClickException(str(error)) from None
    print(f"\n{audit.cells:,} numbers made a second time; {len(audit.wrong)} findings")
    for each in audit.wrong:
        print(f"  disagrees: {each}")
    print(f"\nWhat a sceptic would ask ({len(audit.questions)}):")
    for k, each in zip(itertools.count(1), audit.questions, strict=False):
        print(f"  {k}. {each}")
    if audit.wrong:
        sys.exit(1)


if __name__ == "__main__":
    main()
