"""README and docs: their code runs, their links lead somewhere, their numbers come from the kept tables."""

import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from wayfield.benchmarks import publish
from wayfield.benchmarks.run_folder import file_digest, source_digest
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies import POLICIES

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
NOT_RUN = "<!-- not run: "  # above a block, with the reason

FENCED = re.compile(r"(^<!--[^\n]*-->\n)?^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")


def prose(page: Path) -> str:
    """Returns a page without its fenced blocks."""
    return FENCED.sub("", page.read_text(encoding="utf-8"))


def python_blocks() -> list[tuple[str, str]]:
    """Returns name and text of every Python block that shall run by itself."""
    found = []
    for page in PAGES:
        for k, match in enumerate(FENCED.finditer(page.read_text(encoding="utf-8"))):
            above, language, text = match.groups()
            if language == "python" and not (above or "").startswith(NOT_RUN):
                found.append((f"{page.name}-{k}", text))
    return found


def anchors(page: Path) -> set[str]:
    """Returns what a link may name behind the hash: the headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def test_there_are_blocks_to_run() -> None:
    names = {name.split("-")[0] for name, _ in python_blocks()}
    assert {"README.md", "environments.md", "policies.md"} <= names


@pytest.mark.parametrize(("name", "text"), python_blocks(), ids=[name for name, _ in python_blocks()])
def test_a_block_runs(name: str, text: str, tmp_path: Path) -> None:
    # in a process and a folder of its own, as a reader would paste it
    done = subprocess.run([sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


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
    *("wayfield.envs.robots.ROBOTS", "wayfield.envs.scenarios.TASKS", "wayfield.policies.POLICIES"),
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
    for page in ("README.md", "docs/environments.md"):
        told = (ROOT / page).read_text(encoding="utf-8")
        assert [each for each in ids if f"| `{each}`" not in told] == [], page
        assert [name for name in ROBOTS if f"`{name}`" not in told] == [], page
    families = {family for spec in TASKS.values() for family in spec.families}
    told = (ROOT / "docs/scenarios.md").read_text(encoding="utf-8")
    assert [family for family in families if family not in told] == []


def test_every_page_is_linked_from_the_readme() -> None:
    linked = {(ROOT / link.partition("#")[0]).resolve() for link in LINK.findall(prose(ROOT / "README.md"))}
    assert set((ROOT / "docs").glob("*.md")) <= linked


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


def test_every_number_of_the_readme_stands_in_the_results() -> None:
    text = prose(ROOT / "README.md").partition("## Install")
    rest = text[2].partition("\n## ")[2]  # what an install asks for is no result
    told = re.sub(r"`[^`]*`|\]\([^)]*\)|<!--.*?-->", "", text[0] + rest)
    page = set(NUMBER.findall(prose(ROOT / publish.PAGE)))
    # names of methods and "95 %" are in the page's own words
    assert set(NUMBER.findall(re.sub(r"\bP3DX\b", "", told))) <= page


def test_page_and_readme_are_what_the_kept_tables_make() -> None:
    for name, content in publish.pages(publish.Kept(ROOT)).items():
        assert (ROOT / name).read_text(encoding="utf-8") == content.decode(), f"{name}: run {publish.__name__}"


def test_every_kept_file_belongs_to_a_section() -> None:
    known = {f"{section.name}.json" for section in publish.SECTIONS}
    for section in publish.SECTIONS:
        known |= {Path(publish._place(section, name)).name for name in section.tables}
    assert {file.name for file in (ROOT / publish.KEPT).iterdir()} <= known


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Returns a repository with a README and one finished run of path following."""
    home = tmp_path / "repository"
    (home / "docs").mkdir(parents=True)
    (home / "README.md").write_text(f"before\n{publish.BEGIN}\nas it was\n{publish.END}\nafter\n", encoding="utf-8")
    folder = home / "results/path-following"
    folder.mkdir(parents=True)
    header = "policy,gains,knows,success,RMS error (m),mean speed (m/s)\n"
    (folder / "path_following_p3dx.csv").write_text(f'{header}mpc,tuned,path,"100.0 [97.1, 100.0]",0.0123,0.55\n')
    (folder / "episodes.csv").write_text(
        "document,scenario,episode,split,policy\n"
        "path-following,a/test,0,test,mpc\npath-following,a/test,0,test,lqr\npath-following,a/test,1,test,mpc\n"
        "path-following,a/validation,7,validation,mpc\n"
    )
    manifest = {
        "command": "python evaluate.py --suite path-following",
        "code": source_digest(),
        "files": {file.name: file_digest(file) for file in folder.iterdir()},
    }
    (folder / "run.json").write_text(json.dumps(manifest))
    return home


def whole(home: Path) -> dict[str, bytes]:
    """Returns every file of a repository."""
    return {str(file.relative_to(home)): file.read_bytes() for file in home.rglob("*") if file.is_file()}


def run_publish(home: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Runs the command in a process of its own, on a repository."""
    command = [
        sys.executable,
        "-m",
        "wayfield.benchmarks.publish",
        "--root",
        str(home),
        "--results",
        str(home / "results"),
    ]
    return subprocess.run([*command, *words], capture_output=True, text=True, check=False)


def test_a_finished_run_becomes_page_and_readme(repository: Path) -> None:
    done = run_publish(repository)
    assert done.returncode == 0, done.stderr
    readme = (repository / "README.md").read_text(encoding="utf-8")
    assert readme.startswith("before\n")
    assert readme.endswith("after\n")
    assert "0.0123" in readme
    assert "as it was" not in readme
    page = (repository / publish.PAGE).read_text(encoding="utf-8")
    assert "2 scenarios" in page
    assert source_digest()[:12] in page
    # what was kept is enough to make them again, without the run's folder
    shutil.rmtree(repository / "results")
    before = whole(repository)
    assert run_publish(repository).returncode == 0
    assert whole(repository) == before


def test_what_is_run_is_published_and_what_is_done_is_not_run_again(repository: Path) -> None:
    shutil.move(repository / "results", repository / "finished")
    # a stand-in for a suite: it notes that it ran, and leaves a finished run where it is told to
    (repository / "evaluate.py").write_text(
        "import shutil, sys\n"
        "out = sys.argv[sys.argv.index('--out') + 1]\n"
        "assert sys.argv[1:3] == ['--suite', 'path-following']\n"
        "shutil.copytree('finished/path-following', out)\n"
        "print('ran', file=open('log', 'a'))\n"
    )
    for _ in range(2):
        ran = run_publish(repository, "--run", "--only", "path-following")
        assert ran.returncode == 0, ran.stderr
        assert (repository / "log").read_text() == "ran\n"
    assert "0.0123" in (repository / "README.md").read_text(encoding="utf-8")


def test_a_suite_that_fails_publishes_nothing(repository: Path) -> None:
    shutil.rmtree(repository / "results")
    (repository / "evaluate.py").write_text("raise SystemExit(3)\n")
    before = whole(repository)
    ran = run_publish(repository, "--run")
    assert ran.returncode == 1
    assert "status 3" in ran.stderr
    assert whole(repository) == before


def test_results_of_other_code_are_refused_or_marked(repository: Path) -> None:
    file = repository / "results/path-following/run.json"
    file.write_text(file.read_text().replace(source_digest(), "0" * 64))
    before = whole(repository)
    refused = run_publish(repository)
    assert refused.returncode == 1
    assert len(refused.stderr.splitlines()) == 1
    assert "--stale" in refused.stderr
    assert whole(repository) == before
    assert run_publish(repository, "--stale").returncode == 0
    assert "the code has changed since" in (repository / publish.PAGE).read_text(encoding="utf-8")
    assert "the code has changed since" in (repository / "README.md").read_text(encoding="utf-8")


def test_a_table_that_was_edited_is_refused(repository: Path) -> None:
    file = repository / "results/path-following/path_following_p3dx.csv"
    file.write_text(file.read_text().replace("0.0123", "0.0001"))
    before = whole(repository)
    refused = run_publish(repository)
    assert refused.returncode == 1
    assert "path_following_p3dx.csv" in refused.stderr
    assert whole(repository) == before


def test_a_readme_without_its_markers_is_told_before_anything_is_written(repository: Path) -> None:
    (repository / "README.md").write_text("nothing\n")
    before = whole(repository)
    refused = run_publish(repository)
    assert refused.returncode == 1
    assert "README.md" in refused.stderr
    assert whole(repository) == before


def test_findings_turn_with_the_rows(repository: Path) -> None:
    assert run_publish(repository).returncode == 0
    table = repository / publish.KEPT / "path_following_p3dx_better.csv"
    table.write_text("policy,mpc (tuned),lqr (tuned),ppo (trained)\nppo (trained),0.20*,0.55,\n")
    _, said = publish.findings(publish.Kept(repository))
    assert "worse than `mpc (tuned)`; undecided against `lqr (tuned)`" in said
    assert "better than" not in said
    table.write_text("policy,mpc (tuned),lqr (tuned),ppo (trained)\nppo (trained),0.80*,0.45*,\n")
    _, said = publish.findings(publish.Kept(repository))
    assert "better than `mpc (tuned)`; worse than `lqr (tuned)`" in said


def test_the_losing_agents_are_told(repository: Path) -> None:
    assert run_publish(repository).returncode == 0
    table = repository / publish.KEPT / "path_following_p3dx.csv"
    header = "policy,gains,knows,success,RMS error (m),mean speed (m/s)\n"
    rows = {"stanley,tuned": "0.02", "ppo,trained": "0.03 [0.02, 0.04]", "lqr,default": "0.01 [0.01, 0.02]"}
    table.write_text(header + "".join(f'{entry},path,100,"{error}",0.5\n' for entry, error in rows.items()))
    (said,) = publish.findings(publish.Kept(repository))
    assert "`lqr` (0.01 m), `stanley (tuned)` (0.02 m); the trained agents, 0.03 m, are in place 3 of 3" in said


def test_who_slows_down_is_not_the_most_accurate_at_speed(repository: Path) -> None:
    assert run_publish(repository).returncode == 0
    kept = repository / publish.KEPT
    rows = {
        "stanley": "0.001 [0.000, 0.002] | 0.50",
        "ppo": "0.03 [0.02, 0.04] | 0.9",
        "mpc": "0.02 [0.01, 0.04] | 0.8",
    }
    (kept / "path_following_p3dx_front.csv").write_text(
        "policy,0.6,1\n" + "".join(f'{name},,"{cell}"\n' for name, cell in rows.items())
    )
    _, said = publish.findings(publish.Kept(repository))
    assert "`mpc` (0.02 m at 0.8 m/s), `ppo` (0.03 m at 0.9 m/s)" in said
    assert "stanley" not in said
    # the bars in a cell do not end it
    shown = publish.pages(publish.Kept(repository))[publish.PAGE].decode()
    lines = [re.split(r"(?<!\\)\|", line) for line in shown.splitlines() if line.startswith("| ") and "m/s" not in line]
    assert {len(line) for line in lines if line[1].strip() in rows} == {5, 8}  # of the front, and of the standings
