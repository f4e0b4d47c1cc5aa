"""README and docs: their code runs, their links lead somewhere, their numbers come from the kept tables."""

import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner, Result
from test_contest_tables import made

from wayfield.benchmarks import coverage, learners, page, publish, sections, transfer
from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.kept_rows import SUFFIX, read_packed
from wayfield.benchmarks.results import write_rows
from wayfield.benchmarks.run_folder import file_digest
from wayfield.envs.identity import source_digest
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies import POLICIES, make
from wayfield.policies.parts.costmap import INSCRIBED
from wayfield.policies.parts.scan_map import SUB

ROOT = Path(__file__).parents[1]
TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")), *TUTORIALS]
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
    for file in PAGES:
        for k, match in enumerate(FENCED.finditer(file.read_text(encoding="utf-8"))):
            above, language, text = match.groups()
            if language == "python" and not (above or "").startswith(NOT_RUN):
                found.append((f"{file.name}-{k}", text))
    return found


def anchors(page: Path) -> set[str]:
    """Returns what a link may name behind the hash: the headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def test_there_are_blocks_to_run() -> None:
    names = {name.split("-")[0] for name, _ in python_blocks()}
    assert {"README.md", "environments.md", "policies.md", *(file.name for file in TUTORIALS)} <= names


# What the pages import is loaded once; then each is read by a process of its own, that the others do not touch.
PLAYER = """
import json, os, sys, traceback
import matplotlib.pyplot, torch, wayfield.benchmarks.evaluate, wayfield.policies.training.run
failed = []
for page, blocks in json.load(sys.stdin).items():
    reader = os.fork()
    if reader == 0:
        try:
            for name, text in blocks:
                os.mkdir(name)
                os.chdir(name)
                exec(compile(text, name, "exec"), {"__name__": "__main__"})
                os.chdir("..")
            sys.stdout.flush()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if os.waitpid(reader, 0)[1] != 0:
        failed.append(page)
sys.exit(f"failed: {failed}" if failed else 0)
"""


TRAINED = "train.md"  # whose block trains with another library, as an example does that every run tries


@pytest.mark.parametrize("trained", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_blocks_of_every_page_run(trained: bool, tmp_path: Path) -> None:
    # each as a reader would paste it: with names and a folder of its own. The process is the page's, so that the ids
    # may be known from the block above: a block that uses one imports the package itself.
    pages: dict[str, list[tuple[str, str]]] = {}
    for name, text in python_blocks():
        assert "wayfield/" not in text or re.search(r"^(import|from) wayfield", text, re.MULTILINE), name
        page = name.rpartition("-")[0]
        if (page == TRAINED) == trained:
            pages.setdefault(page, []).append((name, text))
    assert pages
    command, given = [sys.executable, "-c", PLAYER], json.dumps(pages)
    done = subprocess.run(command, input=given, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]


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
    *("wayfield.envs.robots.ROBOTS", "wayfield.envs.specs.TASKS", "wayfield.policies.POLICIES"),
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
    for file in ("README.md", "docs/environments.md"):
        told = (ROOT / file).read_text(encoding="utf-8")
        assert [each for each in ids if f"| `{each}`" not in told] == [], file
        assert [name for name in ROBOTS if f"`{name}`" not in told] == [], file
    families = {family for spec in TASKS.values() for family in spec.families}
    told = (ROOT / "docs/scenarios.md").read_text(encoding="utf-8")
    assert [family for family in families if family not in told] == []


def test_the_gains_that_the_page_of_policies_prints_are_those_that_the_policies_have() -> None:
    """Of those laws whose defaults it prints: Nav2's, as Nav2 ships them, and where ours differ."""
    told = " ".join(prose(ROOT / "docs/policies.md").split())
    has = {name: SimpleNamespace(**vars(make(name))) for name in POLICIES}
    m, d, pose = has["nav2_mppi"], has["nav2_dwb"], has["mpc_pose"]
    assert [
        said
        for said in (
            f"{m.samples:,} of {m.steps} steps of {m.step_time:g} s, noise {m.speed_noise:g} m/s and {m.yaw_noise:g} "
            f"rad/s drawn once, temperature {m.temperature:g}, gamma {m.gamma:g} |",
            f"{d.speeds} forward speeds by {d.turns} yaw rates (by {d.sideways} to the side), {d.horizon:g} s |",
            f"Constraint {m.constraint:g}, Cost {m.cost:g}, Goal {m.goal:g}, GoalAngle {m.goal_angle:g}, PathAlign "
            f"{m.path_align:g}, PathFollow {m.path_follow:g}, PathAngle {m.path_angle:g}, PreferForward "
            f"{m.prefer_forward:g} |",
            f"BaseObstacle {d.obstacle:g}, PathDist {d.path_distance:g}, GoalDist {d.goal_distance:g}, PathAlign "
            f"{d.path_align:g}, GoalAlign {d.goal_align:g}, RotateToGoal {d.rotate_to_goal:g}, Oscillation |",
            f"| {m.max_reverse:g} m/s backward, {m.max_yaw_rate:g} rad/s, {m.acceleration:g} m/s², "
            f"{m.yaw_acceleration:g} rad/s² |",
            f"| forward, {d.max_yaw_rate:g} rad/s, {d.acceleration:g} m/s², {d.yaw_acceleration:g} rad/s² |",
            f"inflation {m.inflation_radius:g} m, scaling {m.cost_scaling:g} /m, inscribed {INSCRIBED:g} |",
            f"the same, {d.window:g} m by {d.window:g} m around the robot |",
            f"hits nothing that it sees within {m.time_before_collision:g} s",
            f"in cells of {100 * d.cell:g} cm with hits to {100 * d.cell / SUB:g} cm",
            f"knows it for {d.recall:g} s, as `dwa` does",
            f"DWB's goal tolerance is {d.tolerance:g} m",
            f"min sum of x^4 + {pose.across:g} y^2 + {pose.heading:g} th^4 + {pose.effort:g} (v^4 + w^4 / 16) over "
            f"{pose.horizon * pose.step:g} s",
            f"drives to the point {has['hybrid'].ahead:g} m ahead",
            f"whole-path search, k_ang = {has['lookahead_documented'].k_ang:g} |",
            f"the same with k_ang = {has['lookahead_retuned'].k_ang:g} and a search window",
        )
        if said not in told
    ] == []
    assert (m.replan, d.replan, has["dwa"].recall, pose.along) == (1.0, 1.0, d.recall, 1.0)  # said in words
    assert (has["lookahead_documented"].search, has["lookahead_retuned"].search) == ("whole", "window")


def test_every_page_is_linked_from_the_readme() -> None:
    linked = {(ROOT / link.partition("#")[0]).resolve() for link in LINK.findall(prose(ROOT / "README.md"))}
    assert set((ROOT / "docs").glob("*.md")) <= linked


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


def test_every_number_of_the_readme_stands_in_the_results() -> None:
    text = prose(ROOT / "README.md").partition("## Install")
    rest = text[2].partition("\n## ")[2]  # what an install asks for is no result
    told = re.sub(r"`[^`]*`|\]\([^)]*\)|<!--.*?-->", "", text[0] + rest)
    known = set(NUMBER.findall(prose(ROOT / page.PAGE)))
    for name in ("path-following", "goal-obstacles"):
        contest = CONTESTS[name]
        known |= set(NUMBER.findall(f"{contest.notes} {contest.counted} {contest.pace}"))
    # names of methods and "95 %" are in the page's own words
    assert set(NUMBER.findall(re.sub(r"\bP3DX\b", "", told))) <= known


# a share, an error or a difference; lengths in m are settings, and so are the whole per cents of rules
RESULT = re.compile(r"(\d+\.\d+)(?: \[[^\]]*\])?(?: (?:to|and|or) \d+(?:\.\d+)?)? (?:%|mm\b|points)")
WHOLE = re.compile(r"(?<![\d.])(\d+) (?:% of the (?:validation|test)|% success|% collisions|points)")
OF_RESULTS = (
    "choosing.md",
    "policies.md",
    "train.md",
    "evaluate.md",
)  # beside results.md, where policies are spoken of


def claimed(text: str) -> set[str]:
    """Returns the numbers of a page that tell how well something does."""
    plain = re.sub(r"`[^`]*`", "", text)
    return {*RESULT.findall(plain), *WHOLE.findall(plain)}


@pytest.mark.parametrize("name", OF_RESULTS)
def test_results_stand_where_they_are_generated_and_nowhere_else(name: str) -> None:
    """A number beside them is by hand, and old as soon as anything is driven again."""
    assert claimed(prose(ROOT / "docs" / name)) == set()


def test_a_result_that_is_told_by_hand_is_seen() -> None:
    told = "99.7 % of paths at 7.5 mm, 95.7 and 96.9 % there, 58 % of the validation docks, beyond 3 % and 0.6 m/s"
    assert claimed(told) == {"99.7", "7.5", "95.7", "58"}


def test_page_and_readme_are_what_the_kept_tables_make() -> None:
    for name, content in page.pages(page.Kept(ROOT)).items():
        assert (ROOT / name).read_text(encoding="utf-8") == content.decode(), f"{name}: run {publish.__name__}"


def kept_sections() -> list[sections.Section]:
    there = {section.name for section, _ in page.Kept(ROOT).sections()}
    return [section for section in sections.SECTIONS if section.of_contest and section.name in there]


# Tables of a hundred scenarios a family, and those of other robots, take as long as all others and are made in the same
# way.
KEPT = [
    pytest.param(each, id=each.name, marks=pytest.mark.slow if each.within == "claims/" or "omni" in each.name else ())
    for each in kept_sections()
]


@pytest.mark.parametrize("section", KEPT)
def test_kept_tables_are_what_the_kept_rows_make(section: sections.Section) -> None:
    rows = read_packed(ROOT / sections.ROWS / f"{section.name}{SUFFIX}")
    made = {kept.name: made for kept, made in page.Kept(ROOT).sections()}[section.name]
    for name, content in publish.tables(section, rows, made.command).items():
        assert (ROOT / name).read_bytes() == content, f"{name}: run {publish.__name__}"


def test_the_table_of_gains_elsewhere_is_what_its_kept_rows_make() -> None:
    rows = read_packed(ROOT / sections.ROWS / f"{transfer.SUITE}{SUFFIX}")
    made = {kept.name: made for kept, made in page.Kept(ROOT).sections()}[transfer.SUITE]
    kept = (ROOT / sections.KEPT / transfer.TRANSFER).read_text(encoding="utf-8")
    assert transfer.transfer_table(rows, made.command).csv() == kept


def test_the_table_of_learners_is_what_its_kept_rows_make() -> None:
    rows = read_packed(ROOT / sections.ROWS / f"{learners.SUITE}{SUFFIX}")
    made = {kept.name: made for kept, made in page.Kept(ROOT).sections()}[learners.SUITE]
    kept = (ROOT / sections.KEPT / learners.LEARNERS).read_text(encoding="utf-8")
    assert learners.learners_table(rows, made.command).csv() == kept


def test_every_published_table_has_its_rows_and_they_are_small() -> None:
    files = list((ROOT / sections.ROWS).glob(f"*{SUFFIX}"))
    assert sum(file.stat().st_size for file in files) < 3_000_000
    made_up = {coverage.SUITE}  # a measurement of its own
    there = {section.name for section, _ in page.Kept(ROOT).sections()} - made_up
    assert {file.name.removesuffix(SUFFIX) for file in files} >= there


def test_every_kept_file_belongs_to_a_section() -> None:
    known = {f"{sections.KEPT}/{name}" for name in ("README.md", *(f"{each.name}.json" for each in sections.SECTIONS))}
    for section in sections.SECTIONS:
        places = {section.place(name) for name in section.tables}
        assert not places & known, "two sections would write one file"
        known |= places | {f"{sections.ROWS}/{section.name}{SUFFIX}"}
    there = {file.relative_to(ROOT).as_posix() for file in (ROOT / sections.KEPT).rglob("*") if file.is_file()}
    assert there <= known


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Returns a repository with a README and one finished run of path following."""
    home = tmp_path / "repository"
    (home / "docs").mkdir(parents=True)
    (home / "README.md").write_text(f"before\n{page.BEGIN}\nas it was\n{page.END}\nafter\n", encoding="utf-8")
    folder = home / "results/path-following"
    folder.mkdir(parents=True)
    cells = {"success": 1.0, "mean_speed": 0.6, "cross_track_rms": 0.0123 + 1e-4 * (np.arange(16) - 7.5)}
    rows = made("path-following", "mpc", cells, gains_name="tuned", learned_from="0.8 M frames")
    agents = cells | {"cross_track_rms": 0.0234 + 0.001 * np.arange(16)}
    for seed in ("0", "1"):
        rows += made(
            "path-following", "ppo", agents, gains_name="trained", agent_seed=seed, learned_from="1.0 M frames"
        )
    write_rows(folder, rows)
    manifest = {
        "command": "python evaluate.py --workers 3 --suite path-following --out somewhere",
        "code": source_digest(),
        "files": {file.name: file_digest(file) for file in folder.iterdir()},
    }
    (folder / "run.json").write_text(json.dumps(manifest))
    return home


def whole(home: Path) -> dict[str, bytes]:
    """Returns every file of a repository."""
    return {str(file.relative_to(home)): file.read_bytes() for file in home.rglob("*") if file.is_file()}


def run_publish(home: Path, *words: str) -> Result:
    """Runs the command in this process, on a repository."""
    return CliRunner().invoke(publish.main, ["--root", str(home), "--results", str(home / "results"), *words])


def test_the_film_is_made_if_it_is_asked_for(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publish, "moving_picture", lambda: b"GIF")
    done = run_publish(repository, "--no-run", "--film")
    assert done.exit_code == 0, done.stderr
    assert (repository / "docs/drive.gif").read_bytes() == b"GIF"


def test_a_finished_run_becomes_page_and_readme(repository: Path) -> None:
    done = run_publish(repository, "--no-run")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.endswith("are made from 1 runs\n")
    assert not (repository / "docs/drive.gif").exists()
    readme = (repository / "README.md").read_text(encoding="utf-8")
    assert readme.startswith("before\n")
    assert readme.endswith("after\n")
    assert "0.0123" in readme
    assert "as it was" not in readme
    shown = (repository / page.PAGE).read_text(encoding="utf-8")
    assert "16 scenarios" in shown
    assert source_digest()[:12] in shown
    # where it was run and how fast is not what was run
    assert "Made by `python evaluate.py --suite path-following`, wayfield" in shown
    assert "somewhere" not in shown
    assert "--workers" not in shown
    # what was kept is enough to make them again, without the run's folder
    shutil.rmtree(repository / "results")
    before = whole(repository)
    command = [sys.executable, "-m", "wayfield.benchmarks.publish", "--root", str(repository), "--no-run"]
    assert subprocess.run(command, cwd=repository, capture_output=True, check=False).returncode == 0
    assert whole(repository) == before


def test_what_is_run_is_published_and_what_is_done_is_not_run_again(repository: Path) -> None:
    shutil.move(repository / "results", repository / "finished")
    # a stand-in for a suite: it notes that it ran, and leaves a finished run where it is told to
    (repository / "evaluate.py").write_text(
        "import shutil, sys\n"
        "out = sys.argv[sys.argv.index('--out') + 1]\n"
        "assert sys.argv[1:3] == ['--suite', 'path-following']\n"
        "assert sys.argv[-2:] == ['--workers', '3']\n"
        "shutil.copytree('finished/path-following', out)\n"
        "print('ran', file=open('log', 'a'))\n"
    )
    for _ in range(2):
        ran = run_publish(repository, "--only", "path-following", "--workers", "3")
        assert ran.exit_code == 0, ran.stderr
        assert (repository / "log").read_text() == "ran\n"
    assert "0.0123" in (repository / "README.md").read_text(encoding="utf-8")


def test_a_section_that_needs_files_of_others_is_not_run_and_keeps_what_it_had(repository: Path) -> None:
    folder = repository / "results/transfer"
    folder.mkdir()
    kept = "robot,policy,gains,validation\np3dx,dwa,tuned,91.5\n"
    (folder / "transfer.csv").write_text(kept)
    manifest = {"command": "python -m wayfield.benchmarks.transfer", "code": source_digest()}
    digests = {"transfer.csv": file_digest(folder / "transfer.csv")}
    (folder / "run.json").write_text(json.dumps(manifest | {"files": digests}))
    assert run_publish(repository, "--no-run").exit_code == 0
    assert "| 91.5" in (repository / page.PAGE).read_text(encoding="utf-8")
    (folder / "run.json").write_text(json.dumps(manifest | {"files": digests, "code": "0" * 64}))
    refused = run_publish(repository, "--only", "transfer")
    assert refused.exit_code == 1
    assert "it needs the official worlds of BARN" in refused.stderr
    (repository / "evaluate.py").write_text("raise SystemExit(3)\n")  # the first of the others that is run
    assert "status 3" in run_publish(repository).stderr
    assert (repository / "docs/results/transfer.csv").read_text() == kept


def test_a_suite_that_fails_publishes_nothing(repository: Path) -> None:
    shutil.rmtree(repository / "results")
    (repository / "evaluate.py").write_text("raise SystemExit(3)\n")
    before = whole(repository)
    ran = run_publish(repository)
    assert ran.exit_code == 1
    assert "status 3" in ran.stderr
    assert whole(repository) == before


def test_results_of_other_code_are_refused_or_marked(repository: Path) -> None:
    file = repository / "results/path-following/run.json"
    file.write_text(file.read_text().replace(source_digest(), "0" * 64))
    before = whole(repository)
    refused = run_publish(repository, "--no-run")
    assert refused.exit_code == 1
    assert len(refused.stderr.splitlines()) == 1
    assert "--stale" in refused.stderr
    assert whole(repository) == before
    assert run_publish(repository, "--stale").exit_code == 0
    assert "the code has changed since" in (repository / page.PAGE).read_text(encoding="utf-8")
    assert "the code has changed since" in (repository / "README.md").read_text(encoding="utf-8")


def test_the_commit_of_today_is_named_beside_results_of_the_code_of_today_alone(
    repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publish, "described", lambda home: "v7-3-g1a2b3c4")
    file = repository / "results/path-following/run.json"
    mine = file.read_text()
    (section,) = [each for each in sections.SECTIONS if each.name == "path-following"]
    for code, named in ((mine, "v7-3-g1a2b3c4"), (mine.replace(source_digest(), "0" * 64), "")):
        file.write_text(code)
        kept = publish.gathered(section, file.parent, repository, stale=True)
        assert json.loads(kept["docs/results/path-following.json"])["commit"] == named


def test_what_an_earlier_code_published_is_marked_and_what_this_one_did_is_not(repository: Path) -> None:
    kept = repository / "docs/results/path-following.json"
    assert run_publish(repository, "--no-run").exit_code == 0
    shutil.rmtree(repository / "results")
    mine = json.loads(kept.read_text(encoding="utf-8"))
    assert (mine["code"], mine["stale"]) == (source_digest(), False)
    for code, stale in ((mine["code"], False), ("0" * 64, True)):
        kept.write_text(json.dumps(mine | {"code": code}), encoding="utf-8")
        assert run_publish(repository, "--no-run").exit_code == 0
        assert json.loads(kept.read_text(encoding="utf-8"))["stale"] is stale
        for name in (page.PAGE, "README.md"):
            assert ("the code has changed since" in (repository / name).read_text(encoding="utf-8")) is stale


def test_rows_that_were_edited_are_refused(repository: Path) -> None:
    file = repository / "results/path-following/episodes.csv"
    file.write_text(file.read_text().replace("0.0123", "0.0001"))
    before = whole(repository)
    refused = run_publish(repository, "--no-run")
    assert refused.exit_code == 1
    assert "episodes.csv" in refused.stderr
    assert whole(repository) == before


def test_a_readme_without_its_markers_is_told_before_anything_is_written(repository: Path) -> None:
    (repository / "README.md").write_text("nothing\n")
    before = whole(repository)
    refused = run_publish(repository, "--no-run")
    assert refused.exit_code == 1
    assert "README.md" in refused.stderr
    assert whole(repository) == before


def test_the_losing_agents_are_told(repository: Path) -> None:
    assert run_publish(repository, "--no-run").exit_code == 0
    readme = (repository / "README.md").read_text(encoding="utf-8")
    (line,) = [each for each in readme.splitlines() if each.startswith("| Path following, p3dx")]
    agents, wins, loses, alike, slower = (cell.strip() for cell in line.strip("| ").split("|")[1:])
    assert (agents, wins, loses, alike, slower) == ("`ppo`", "-", "`mpc (tuned)`", "-", "-")
    claims = (repository / sections.KEPT / "path_following_p3dx_claims.csv").read_text(encoding="utf-8")
    assert "loses" in claims
    assert "wins" not in claims


@pytest.mark.slow
def test_the_audit_agrees_with_what_was_published_and_sees_a_changed_cell(repository: Path) -> None:
    assert run_publish(repository, "--no-run").exit_code == 0
    command = [sys.executable, "-m", "wayfield.benchmarks.audit", str(repository / sections.KEPT)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 findings" in done.stdout
    table = repository / sections.KEPT / "path_following_p3dx.csv"
    for right, wrong in (("0.0123", "0.0124"), ("79.4", "81.4"), ("0.600", "0.600‡")):
        text = table.read_text(encoding="utf-8")
        assert right in text
        table.write_text(text.replace(right, wrong, 1), encoding="utf-8")
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert "mpc" in done.stdout.partition("disagrees:")[2].splitlines()[0]
        table.write_text(text, encoding="utf-8")
