"""README and docs: their links lead somewhere, their numbers come from the kept tables."""

import importlib
import math
import re
from pathlib import Path

import everywhere
import flocks
import front_page
import interval_coverage
import part_rows
import publish
import pytest
import results_page
import sections
from oracles import published_tables
from oracles.published_tables import Cells
from packed_rows import SUFFIX, read_packed

from wayfield.benchmarks.entrants.documents import documents
from wayfield.benchmarks.records.results import read_table
from wayfield.benchmarks.statistics.paired import Difference
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies import POLICIES

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
RESULTS = sorted((ROOT / "docs/results").glob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")), *TUTORIALS, *RESULTS]

FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def prose(page: Path) -> str:
    """Returns a page without its fenced blocks."""
    return FENCED.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """Returns what a link may name behind the hash: the headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for link in LINK.findall(prose(page)):
        if link.startswith("http"):
            continue
        file, _, heading = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), f"{page.name}: {link}"
        assert not heading or heading in anchors(target), f"{page.name}: {link}"


REGISTRIES = {
    *("wayfield.envs.robots.ROBOTS", "wayfield.envs.tasks.specs.TASKS", "wayfield.policies.POLICIES"),
    *("wayfield.benchmarks.contests.CONTESTS", "wayfield.policies.training.presets.PRESETS"),
    "wayfield.envs.scenarios.path_families.PATH_FAMILIES",
    "wayfield.envs.scenarios.goal_families.GOAL_FAMILIES",
}


def test_contributing_names_files_that_are_there() -> None:
    named = re.findall(r"`([\w.]+(?:/[\w.]*)+|[\w]+\.(?:toml|md|txt))`", prose(ROOT / "CONTRIBUTING.md"))
    assert len(set(named)) > 20
    # those in angle brackets are new, build/ comes with an installation
    missing = [name for name in named if not (ROOT / name).exists() and not name.startswith("build/")]
    assert not missing


def test_contributing_names_every_registry_by_its_right_name() -> None:
    named = set(re.findall(r"`(wayfield(?:\.\w+)+\.[A-Z_]+)`", prose(ROOT / "CONTRIBUTING.md")))
    assert named == REGISTRIES
    for name in named:
        module, _, registry = name.rpartition(".")
        assert len(getattr(importlib.import_module(module), registry)) > 0


def test_every_task_and_policy_is_in_the_pages() -> None:
    listed = (ROOT / "docs/policies.md").read_text(encoding="utf-8")
    assert [name for name in POLICIES if f"| `{name}`" not in listed and f", `{name}`" not in listed] == []
    ids = {each for spec in TASKS.values() for each in spec.ids.values()}
    told = (ROOT / "docs/environments.md").read_text(encoding="utf-8")
    assert [each for each in ids if f"`{each}`" not in told] == []
    assert [name for name in ROBOTS if f"`{name}`" not in told] == []
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [each for each in ids if f"`{each}`" not in readme] == []
    families = {family for spec in TASKS.values() for family in spec.families}
    told = (ROOT / "docs/scenarios.md").read_text(encoding="utf-8")
    assert [family for family in families if family not in told] == []


def test_every_page_is_linked_from_the_readme_or_the_start_page() -> None:
    starts = (ROOT / "README.md", ROOT / "docs/index.md")
    linked = {(file.parent / link.partition("#")[0]).resolve() for file in starts for link in LINK.findall(prose(file))}
    assert set((ROOT / "docs").glob("*.md")) <= linked | set(starts)


def test_page_and_readme_are_what_the_kept_tables_make() -> None:
    kept = results_page.Store(ROOT)
    for name, content in (results_page.pages(kept) | front_page.readme(kept)).items():
        assert (ROOT / name).read_text(encoding="utf-8") == content.decode(), f"{name}: run {publish.__name__}"


def test_the_page_of_the_driver_for_every_robot_is_what_its_rows_make() -> None:
    rows = part_rows.read(ROOT / sections.RESULTS / "everywhere.csv.xz")
    assert (ROOT / sections.RESULTS / "everywhere.md").read_text(encoding="utf-8") == everywhere.page(rows)
    kept = everywhere.Results(rows)

    def success(law: str, conditions: list[str], *, moving: bool) -> Difference:
        return kept.less(law, "success", moving, conditions)

    # as docs/choosing.md and docs/agents.md say it
    assert (
        success("scan_planner", kept.conditions, moving=True).low
        > 0.0
        >= success("scan_planner", kept.conditions, moving=False).low
    )
    assert all(success("scan_planner", [name], moving=False).high >= 0.0 for name in kept.conditions)
    slow = [each.name for each in everywhere.CONDITIONS if each.name in kept.conditions and each.speed <= 0.3]
    assert len(slow) > 1
    assert all(success(law, [name], moving=True).low <= 0.0 for law in ("vfh_plus", "scan_planner") for name in slow)


def test_page_and_advice_for_teams_and_people_are_what_the_kept_rows_make() -> None:
    rows, page = flocks.page_of(ROOT / sections.RESULTS)
    assert (ROOT / sections.RESULTS / "flocks.md").read_text(encoding="utf-8") == page
    for file, told in flocks.pages(ROOT / "docs", rows["teams"], rows["people"]).items():
        assert f"{flocks.BEGIN}\n{told}\n{flocks.END}" in file.read_text(encoding="utf-8")


def kept_sections() -> list[sections.Section]:
    there = {section.name for section, _ in results_page.Store(ROOT).sections()}
    return [section for section in sections.SECTIONS if section.from_rows and section.name in there]


def test_the_advice_sends_to_nobody_who_is_behind() -> None:
    kept = results_page.Store(ROOT)
    text = kept.text(results_page.CHOOSING)
    assert results_page.disagreements(kept, text) == []
    # as it once was
    once = ("ppo", "the error counts"), ("scan_planner", "obstacles move"), ("mpc_pose", "at a wall")
    for policy, words in (*once, ("ppo", "obstacles move"), ("any_robot", "obstacles are static")):
        (wrong,) = results_page.disagreements(kept, f"| `{policy}` | {words} |")
        assert wrong.startswith(f"{policy} where")


def test_every_page_says_the_verdicts_of_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """As formulas of their own judge them."""
    monkeypatch.chdir(ROOT)
    found = Cells()
    published_tables.check_verdicts(found, published_tables.RESULTS)
    assert found.count > 1000
    assert found.wrong == []


@pytest.mark.parametrize(
    ("section", "ends"),
    [("path-following", ("", "_better", "_pairs")), ("docking", ("", "_pairs")), ("disturbances", ("_ladder_pairs",))],
)
def test_kept_tables_are_what_formulas_of_their_own_make_of_the_rows(section: str, ends: tuple[str, ...]) -> None:
    rows = [{"speed": "", **row} for row in read_packed(ROOT / sections.ROWS / f"{section}{SUFFIX}")]
    contest, robot = rows[0]["contest"], rows[0]["robot"]
    mine = [row for row in rows if (row["contest"], row["robot"]) == (contest, robot)]
    found, tables = Cells(), published_tables
    for end in ends:
        stem = f"{contest.replace('-', '_')}_{robot}{end}"
        check = {"": tables.check_standings, "_better": tables.check_shares}.get(end, tables.check_pairs)
        lines = read_table(ROOT / sections.RESULTS / f"{stem}.csv", tables.texts)
        check(found, mine, lines, stem)
        assert found.wrong == []
        # and a changed cell is seen
        name = "success (%)" if end == "" else "cost where both succeed" if "pairs" in end else str(lines[0]["policy"])
        line = next(each for each in lines if each.get(name))
        name = name if end != "_better" else next(each for each in line if each != "policy" and line[each])
        check(other := Cells(), mine, [{**line, name: "123456.7"}], stem)
        assert any("shows 123456.7" in each for each in other.wrong)
    assert found.count > 200


def test_the_page_of_the_documents_says_what_their_rows_say() -> None:
    text = (ROOT / "docs/documents.md").read_text(encoding="utf-8")
    printed = [(case.contest, metric) for case in documents() for metric in case.published]
    assert [document for document, _ in printed] == ["C"] * 6
    rows = read_packed(ROOT / sections.ROWS / f"documents{SUFFIX}")
    ends = {(row["family"], row["policy"], row["gains"], row["dynamics"]): row for row in rows}
    exact = {key: row for key, row in ends.items() if key[1] == "apf_documented" and key[2].startswith("tau")}
    exact = {key: row for key, row in exact.items() if "stop_radius" not in key[2]}
    arrived = [key for key, row in exact.items() if row["success"] == "1"]
    assert arrived == [("scenario 1", "apf_documented", "tau=0.5", "pymunk")]
    told = next(each.not_shown for each in sections.SECTIONS if each.name == sections.DOCUMENTS)
    assert "arrives nowhere but on pymunk, in one scenario" in told
    two = [exact["scenario 1", "apf_documented", "tau=1.2", plant] for plant in ("kinematic", "pymunk")]
    apart = math.hypot(*(float(two[0][axis]) - float(two[1][axis]) for axis in ("final_x", "final_y")))
    assert f"the two end {apart:.1f} m apart" in " ".join(text.split())
    times = [ends[f"scenario {k}", "apf_corrected", "", "kinematic"]["time"] for k in (1, 2, 0)]
    assert "({}, {} and {} s against".format(*(f"{float(each):g}" for each in times)) in text
    arrivals = [ends["1: to a pose", "waypoint", "lam=1", plant]["arrival_time_1"] for plant in ("pymunk", "kinematic")]
    assert "{:.2f} s instead of {:.2f} s".format(*map(float, arrivals)) in text


# Tables of many rows, and those of other robots, take as long as all others and are made in the same way.
LONG = {"disturbances", "goal-obstacles"}
WITH_TABLES = [
    pytest.param(each, id=each.name, marks=pytest.mark.slow if is_long else ())
    for each in kept_sections()
    for is_long in [each.within == "claims/" or "omni" in each.name or each.name in LONG]
]


@pytest.mark.parametrize("section", WITH_TABLES)
def test_kept_tables_are_what_the_kept_rows_make(section: sections.Section) -> None:
    rows = read_packed(ROOT / sections.ROWS / f"{section.name}{SUFFIX}")
    made = {kept.name: made for kept, made in results_page.Store(ROOT).sections()}[section.name]
    times = ROOT / publish.decisions_of(section)
    decisions = times.read_bytes() if times.is_file() else b""
    for name, content in publish.tables(section, rows, made.command, decisions).items():
        assert (ROOT / name).read_bytes() == content, f"{name}: run {publish.__name__}"


def test_every_published_table_has_its_rows_and_they_are_small() -> None:
    files = list((ROOT / sections.ROWS).glob(f"*{SUFFIX}"))
    assert sum(file.stat().st_size for file in files) < 6_000_000  # in git: a new table has to be worth its size
    made_up = {interval_coverage.SUITE}  # a measurement of its own
    there = {section.name for section, _ in results_page.Store(ROOT).sections()} - made_up
    assert {file.name.removesuffix(SUFFIX) for file in files} >= there


def test_every_kept_file_belongs_to_a_section() -> None:
    known = {f"{sections.RESULTS}/README.md", results_page.CARDS}
    known |= {f"{sections.RESULTS}/{name}" for name in (*flocks.FILES.values(), "flocks.md")}  # by a study of its own
    known |= {f"{sections.RESULTS}/everywhere.{kind}" for kind in ("csv.xz", "md")}
    known |= {f"{sections.RESULTS}/hulls{end}" for end in (".csv.xz", ".json", ".md", "_gains.json")}
    known |= {f"{sections.RESULTS}/learning.{kind}" for kind in ("csv", "md", "png")}
    known |= {
        f"{sections.RESULTS}/{name}.{kind}" for name in ("filters", "papers", "physics") for kind in ("csv", "md")
    }
    known |= {f"{sections.RESULTS}/physics_{name}" for name in ("chain.csv", "domain.csv", "papers.csv", "teams.csv")}
    known.add(f"{sections.RESULTS}/physics_people.csv.xz")
    known |= {f"{sections.RESULTS}/{each.name}.{kind}" for each in sections.SECTIONS for kind in ("json", "md")}
    for section in sections.SECTIONS:
        places = {section.place(name) for name in section.tables}
        assert not places & known, "two sections would write one file"
        known |= places | {publish.decisions_of(section), f"{sections.ROWS}/{section.name}{SUFFIX}"}
    there = {file.relative_to(ROOT).as_posix() for file in (ROOT / sections.RESULTS).rglob("*") if file.is_file()}
    assert there <= known
