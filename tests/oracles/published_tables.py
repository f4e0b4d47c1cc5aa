"""Published tables made a second time: every number of standings, shares, pairs and verdicts, from the rows."""

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from oracles import table_formulas as formulas
from results_page import CHOOSING, PAGE, TASKS, Store, Task, disagreements

from wayfield.benchmarks.contests import CONTESTS, TRAINED

Row = Mapping[str, str]  # files are read as text

RESULTS = Path("docs/results")
LEAST = 5  # scenarios of a family, under which nothing may stand in brackets
COMPARED = ("test", "claims", "own", "public")
LEARNED = ("ppo", "hybrid")  # whose differences from the others are claimed
# what successes are compared by, as tables call it: the metric
_METRICS = {"tracking error": "tracking_rms", "RMS error": "cross_track_rms", "time": "time"}
_NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")


def texts(names: Sequence[str], lines: Iterable[Sequence[str]]) -> list[Row]:
    """Returns the lines of a table as rows of text."""
    return [dict(zip(names, line, strict=True)) for line in lines]


class Cells:
    """What was found: how many cells were compared, and which disagree."""

    def __init__(self) -> None:
        self.wrong: list[str] = []
        self.count = 0

    def check(self, what: str, shown: str, wanted: float, tolerance: float | None = None) -> None:
        """Compares a shown number with what it should be, to the last digit that is shown."""
        found = _NUMBER.search(shown)
        self.count += 1
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


def check_standings(cells: Cells, rows: Sequence[Row], table: Sequence[Row], where: str) -> None:
    """Makes the standings a second time."""
    mine = entries([row for row in rows if row["split"] in COMPARED])
    known = {(row["policy"], row["gains"]): row for row in table}
    for name, group in mine.items():
        line = known.pop((group[0]["policy"], group[0]["gains_name"]), None)
        if line is None:
            cells.note(f"{where}: {name} has rows and no line")
            continue
        few = min(map(len, strata(group).values())) < LEAST
        for header, cell in line.items():
            if header not in formulas.MEANINGS:
                continue
            of, metric, reduce, factor = formulas.MEANINGS[header]
            numbers = of(group, metric)
            missing = not numbers or any(map(math.isnan, numbers))
            there = [number for number in numbers if not math.isnan(number)]
            cells.check(f"{where}, {name}, {header}", cell, factor * reduce(there) if there else math.nan)
            if "[" in cell and few:
                cells.note(f"{where}, {name}, {header}: brackets of fewer than {LEAST} scenarios a family")
            if "[" in cell and not missing:
                _check_ends(cells, f"{where}, {name}, {header}", cell, group, header)
    for policy, gains in known:
        cells.note(f"{where}: {policy} ({gains}) has a line and no rows")


def _check_ends(cells: Cells, what: str, cell: str, rows: Sequence[Row], header: str) -> None:
    """Compares brackets with those of other formulas: exactly for shares, by their width for the rest."""
    of, metric, reduce, factor = formulas.MEANINGS[header]
    value, low, high = (float(each) for each in _NUMBER.findall(cell))
    if not low - 1e-9 <= value <= high + 1e-9 or low == high:
        cells.note(f"{what}: [{low:g}, {high:g}] is no interval of {value:g}")
    if len({row["agent_seed"] for row in rows}) > 1:
        return  # two samples at once: their coverage is measured instead
    if header == "success (%)":
        ends = formulas.binomial_ends(sum(map(formulas.won, rows)), len(rows))
        cells.check(f"{what}, low end", f"{low}", 100.0 * ends[0], 0.06)
        cells.check(f"{what}, high end", f"{high}", 100.0 * ends[1], 0.06)
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
        cells.note(f"{what}: is {high - low:.4g} wide, resampling gives {width:.4g}")


def check_shares(cells: Cells, rows: Sequence[Row], table: Sequence[Row], where: str) -> None:
    """Makes the matrix of shares a second time."""
    mine = entries([row for row in rows if row["split"] in COMPARED])
    metric = _compared_by([row for group in mine.values() for row in group])
    for line in table:
        for other, cell in line.items():
            if other == "policy" or not cell or line["policy"] not in mine or other not in mine:
                continue
            shares = _wins(mine[line["policy"]], mine[other], metric)
            whole = [share for of_family in shares.values() for share in of_family]
            cells.check(f"{where}, {line['policy']} / {other}", cell, formulas.average(whole))


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


def check_pairs(cells: Cells, rows: Sequence[Row], table: Sequence[Row], where: str) -> None:
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
                cells.note(f"{where}: {agent} is not compared with {other} where {' '.join(filter(None, key))}")
    for line in table:
        mine = entries(groups.get((*_condition(line["condition"]), line["scenes"]), []))
        ours, theirs = mine.get(line["policy"]), mine.get(line["beside"])
        if ours is None or theirs is None:
            cells.note(f"{where}: {line['condition']}, {line['beside']} has a line and no rows")
            continue
        shares = [100.0 * formulas.average(formulas.every(each, "success")) for each in (ours, theirs)]
        what = f"{where}, {line['condition']}, {line['scenes']}, {line['policy']} / {line['beside']}"
        cells.check(f"{what}, success", line["success (points)"], shares[0] - shares[1])
        cells.check(
            f"{what}, cost", line["cost where both succeed"], _cost_of_both(ours, theirs, _METRICS[line["compared by"]])
        )
        cells.count += 1
        if _METRICS[line["compared by"]] != (wanted := _compared_by([row for each in mine.values() for row in each])):
            cells.note(f"{what}: is compared by {line['compared by']}, the rows have {wanted}")


def _condition(words: str) -> tuple[str, str]:
    """Returns the asked speed and the level of disturbance that a condition names."""
    speed = re.search(r"asked for ([\d.]+) m/s", words)
    level = re.search(r"(\w+) disturbance", words)
    return speed[1] if speed else "", level[1] if level else "none"


def _cost_of_both(ours: Sequence[Row], theirs: Sequence[Row], metric: str) -> float:
    """Returns the mean difference of errors, mm, or of times, s, where both succeed."""
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


def check_verdicts(cells: Cells, folder: Path) -> None:
    """Looks for a pair with two verdicts, judged anew from its p, and for advice that the rows speak against."""
    store = Store(folder.parents[1])
    for section, _ in store.sections():
        page = store.text(f"{folder.as_posix()}/{section.name}.md") if folder == RESULTS else ""
        places = [section.place(name) for name in section.tables if name.endswith("_pairs.csv")]
        stems = [each.removeprefix(f"{RESULTS.as_posix()}/").removesuffix(".csv") for each in places if each in store]
        table = [line for stem in stems for line in store.rows(stem)]
        ps = formulas.stepped_down([float(line[each] or "nan") for line in table for each in _PS])
        said: dict[tuple[str, str, str], str] = {}
        for line, p, q in zip(table, ps[::2], ps[1::2], strict=True):
            words = formulas.verdict(line, p, q)
            if line["condition"] == table[0]["condition"]:
                said[line["scenes"], line["policy"], line["beside"]] = words
                said[line["scenes"], line["beside"], line["policy"]] = _other_way(words)
            cells.count += 1
            if page and _shown_verdict(page, line) not in (words, _in_columns(words)):
                cells.note(
                    f"{section.name}, {line['condition']}, {line['scenes']}: {line['policy']} beside "
                    f"{line['beside']} is {words!r}, not so on its page"
                )
        for task in TASKS if folder == RESULTS else ():
            if task[1] == section.name:
                _check_fronts(cells, store, task, said)
    if folder == RESULTS:
        for each in disagreements(store, store.text(CHOOSING)):
            cells.note(f"{CHOOSING}: {each}")


_PS = ("p of success", "p of cost")
_WAYS = (
    ("more successes", "fewer successes"),
    ("faster", "slower"),
    ("lower error", "higher error"),
    ("at a lower", "at a higher"),
)


def _other_way(words: str) -> str:
    """Returns what is said of the other one of a pair."""
    for one, other in _WAYS:
        mark = "\0"
        words = words.replace(one, mark).replace(other, one).replace(mark, other)
    return words


def _check_fronts(cells: Cells, store: Store, task: Task, said: Mapping[tuple[str, str, str], str]) -> None:
    """Looks for a pair of which a front page, or the advice, says something else than the page of its rows."""
    heading, _, _, kinds = task
    table = re.search(rf"\[{heading}\]\([^)]*\)\.\*\*.*\n\n((?:\|.*\n)+)", store.text(PAGE))
    assert table is not None
    header, _, *rows = ([cell.strip() for cell in row.strip("|").split("|")] for row in table[1].splitlines())
    agent = f"{header[-1].partition('`')[2].rstrip('`')} (trained)"
    for row in rows:
        line = dict(zip(header, row, strict=True))
        words = said.get((line.get("scenes", kinds[0]), _label(line["policy"]), agent))
        cells.count += 1
        if row[-1] != _short(words or ""):
            cells.note(f"{PAGE}, {heading}: {line['policy']} beside {agent} is {words!r}, there {row[-1]!r}")
    for kind, where in _PLACES[heading.partition(" ")[0]].items():
        if kind not in kinds:
            continue
        for row in re.findall(rf"^\| {where} +\|.*\|$", store.text(CHOOSING), re.MULTILINE):
            _, _, best, _, lead = (cell.strip() for cell in row.strip("|").split("|"))
            cells.count += 1
            told = re.fullmatch(rf"{_ALONE}(.*?) (?:than|to|with) (`\w+`(?: \((?:{_GAINS})\))?)(.*): .*", lead)
            words = said.get((kind, _label(best), _label(told[2]))) if told else None
            if told and words != told[1] + told[3]:
                cells.note(f"{CHOOSING}, {where}: {best} beside {told[2]} is {words!r}, there {lead!r}")


_GAINS, _ALONE = "tuned|hand-tuned|paper", "(?:no other has these inputs; )?"
# Where the advice sends: by the first word of a task, and the kind of scenes.
_PLACES: Mapping[str, Mapping[str, str]] = {
    "Follow": {"smooth paths": "Follow a smooth path", "paths with corners": "Follow a path with corners"},
    "Track": {"references that a base can follow": "Track a timed trajectory"},
    "Reach": {kind: f"Reach a goal among {kind}" for kind in ("static obstacles", "moving obstacles")},
    "Dock": {
        "free space": "Dock in free space",
        "wall or parking bay": "Dock at a wall or in a bay",
        "moving obstacles": "Dock among moving obstacles",
    },
}


def _label(name: str) -> str:
    """Returns how tables of pairs call what pages call "`policy` (gains)"."""
    policy, _, gains = name.replace("`", "").rstrip(")").partition(" (")
    gains = gains or ("trained" if policy in TRAINED else "")
    return f"{policy} ({gains})" if gains else policy


def _in_columns(words: str) -> str:
    """Returns how a table with a column a condition shows a verdict."""
    return _short(words).replace(" successes", "").replace("not significant", "n. s.")


def _short(words: str) -> str:
    """Returns what decides a verdict; "tie" where success or cost is equivalent and the other one a tie."""
    told = words.rpartition("; ")[2]
    return "tie" if told.startswith(("tie ", "equivalent ")) else told


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
