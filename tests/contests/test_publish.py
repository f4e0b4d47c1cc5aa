"""Publishing: finished runs become the page of results and README's tables, or nothing is written."""

import csv
import dataclasses
import io
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import front_page
import numpy as np
import publish
import pytest
import results_page
import sections
from click.testing import CliRunner, Result
from oracles.contest_rows import made

from wayfield.benchmarks.records.results import write_rows
from wayfield.benchmarks.records.run_folder import file_digest
from wayfield.envs.robots import ROBOTS
from wayfield.policies import make
from wayfield.policies.parts.policy import lacks
from wayfield.system.identity import source_digest

STUDIES = Path(__file__).parents[2] / "benchmarks" / "studies"


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Returns a repository with a README and one finished run of path following."""
    home = tmp_path / "repository"
    (home / "docs").mkdir(parents=True)
    (home / "README.md").write_text(
        f"before\n{results_page.BEGIN}\nas it was\n{results_page.END}\nafter\n", encoding="utf-8"
    )
    folder = home / "results/path-following-claims"
    folder.mkdir(parents=True)
    errors = 0.0123 + 1e-4 * (np.arange(16) - 7.5)
    cells = {"success": 1.0, "mean_speed": 0.6, "cross_track_rms": errors, "tracking_rms": errors}
    cells |= {"acquisition_time": 1.25, "acquisition_area": 0.042}
    rows = made("path-following", "mpc", cells, gains_name="tuned", learned_from="0.8 M frames")
    agents = cells | dict.fromkeys(("cross_track_rms", "tracking_rms"), 0.0234 + 0.001 * np.arange(16))
    for seed in ("0", "1"):
        rows += made(
            "path-following", "ppo", agents, gains_name="trained", agent_seed=seed, learned_from="1.0 M frames"
        )
    real = {"wide": "splines", "narrow": "polylines_90"}  # a smooth one and one with corners, as pages tell them apart
    write_rows(folder, [row | {"family": real[row["family"]]} for row in rows])
    manifest = {
        "command": "python evaluate.py --workers 3 --suite path-following --split claims --out somewhere",
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


def test_a_finished_run_becomes_page_and_readme(repository: Path) -> None:
    done = run_publish(repository, "--no-run")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.endswith("are made from 1 runs\n")
    assert not (repository / front_page.FILM).exists()
    readme = (repository / "README.md").read_text(encoding="utf-8")
    assert readme.startswith("before\n")
    assert readme.endswith("after\n")
    assert "vs." in readme
    assert "as it was" not in readme
    shown = (repository / sections.RESULTS / "path-following-claims.md").read_text(encoding="utf-8")
    assert "16 scenarios" in shown
    # where it was run and how fast is not what was run
    assert "Made by `python evaluate.py --suite path-following --split claims`, wayfield" in shown
    assert "somewhere" not in shown
    assert "--workers" not in shown
    # what was kept is enough to make them again, without the run's folder
    shutil.rmtree(repository / "results")
    before = whole(repository)
    command = [sys.executable, str(STUDIES / "publish.py"), "--root", str(repository), "--no-run"]
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
        "shutil.copytree('finished/path-following-claims', out)\n"
        "print('ran', file=open('log', 'a'))\n"
    )
    for _ in range(2):
        ran = run_publish(repository, "--only", "path-following-claims", "--workers", "3")
        assert ran.exit_code == 0, ran.stderr
        assert (repository / "log").read_text() == "ran\n"
    assert "vs." in (repository / "README.md").read_text(encoding="utf-8")


def test_a_section_that_needs_files_of_others_is_not_run_and_keeps_what_it_had(repository: Path) -> None:
    folder = repository / "results/transfer"
    folder.mkdir()
    kept = "robot,policy,gains,validation\np3dx,dwa,tuned,91.5\n"
    (folder / "transfer.csv").write_text(kept)
    manifest = {"command": "python benchmarks/studies/transfer.py", "code": source_digest()}
    digests = {"transfer.csv": file_digest(folder / "transfer.csv")}
    (folder / "run.json").write_text(json.dumps(manifest | {"files": digests}))
    assert run_publish(repository, "--no-run").exit_code == 0
    assert "| 91.5" in (repository / sections.RESULTS / "transfer.md").read_text(encoding="utf-8")
    (folder / "run.json").write_text(json.dumps(manifest | {"files": digests, "code": "0" * 64}))
    refused = run_publish(repository, "--only", "transfer")
    assert refused.exit_code == 1
    assert "it needs its script, which is that commit's" in refused.stderr
    (repository / "evaluate.py").write_text("raise SystemExit(3)\n")  # the first of the others that is run
    assert "status 3" in run_publish(repository).stderr
    assert (repository / "docs/results/transfer.csv").read_text() == kept


def test_every_section_names_policies_that_can_drive_its_robot() -> None:
    for section in sections.SECTIONS:
        words = dict(re.findall(r"--(policies|robot) (\S+)", section.command))
        robot = ROBOTS[words.get("robot", "p3dx")]
        named = words["policies"].split(",") if "policies" in words and section.of_contest else []
        assert [name for name in named if name != "all" and lacks(make(name), robot)] == [], section.name


def test_a_suite_that_fails_publishes_nothing(repository: Path) -> None:
    shutil.rmtree(repository / "results")
    (repository / "evaluate.py").write_text("raise SystemExit(3)\n")
    before = whole(repository)
    ran = run_publish(repository)
    assert ran.exit_code == 1
    assert "status 3" in ran.stderr
    assert whole(repository) == before


def test_results_of_other_code_that_come_out_otherwise_are_refused_or_marked(repository: Path) -> None:
    file = repository / "results/path-following-claims/run.json"
    file.write_text(file.read_text().replace(source_digest(), "0" * 64))
    before = whole(repository)
    refused = run_publish(repository, "--no-run")
    assert refused.exit_code == 1
    assert "--stale" in refused.stderr.splitlines()[-1]
    assert "Traceback" not in refused.stderr
    assert whole(repository) == before
    assert run_publish(repository, "--stale").exit_code == 0
    for name in (f"{sections.RESULTS}/path-following-claims.md", "README.md"):
        assert "**Stale: on 20" in (repository / name).read_text(encoding="utf-8")


def test_rows_that_were_edited_are_refused(repository: Path) -> None:
    file = repository / "results/path-following-claims/episodes.csv"
    file.write_text(file.read_text().replace("0.0123", "0.0001"))
    before = whole(repository)
    refused = run_publish(repository, "--no-run")
    assert refused.exit_code == 1
    assert "episodes.csv" in refused.stderr
    assert whole(repository) == before


def test_the_losing_agents_are_told(repository: Path) -> None:
    assert run_publish(repository, "--no-run").exit_code == 0
    readme = (repository / "README.md").read_text(encoding="utf-8")
    # the losing agent stands beside the winner, with both numbers; the other kinds of scenes are in the figure
    assert (
        "`mpc` (tuned) tracks smooth paths more closely than agent `ppo` (RMS 11.90 vs. 26.90 mm, 8 paths)." in readme
    )
    page = (repository / sections.RESULTS / "path-following-claims.md").read_text(encoding="utf-8")
    lines = [
        each for each in page.splitlines() if (each.startswith("| mpc (tuned)") and "p 0" in each) or "p <" in each
    ]
    assert len(lines) == 2
    assert all(" in success; higher error" in line for line in lines)


STEMS = {"among moving obstacles": "claims/docking_p3dx", "on smooth paths": "claims/path_following_p3dx"}
WORDS = {"more": "succeeds more often than", "ahead": "is ahead of", "same": "are equivalent in success rate"}
WORDS["error"] = "tracks smooth paths more closely than"


@pytest.mark.parametrize(
    ("where", "points", "p", "wins", "told"),
    [  # points of success of PPO less its rival
        *((where, points, 1e-12, wins, "more") for where in STEMS for points, wins in ((-9, 0), (9, 1))),
        *((where, 9, 0.04, 1, "ahead") for where in STEMS),  # significant before correction
        ("among moving obstacles", -9, 0.04, 0, "ahead"),
        ("on smooth paths", -9, 0.04, 0, "error"),  # errors say the same, and are significant
        ("among moving obstacles", 0, 1.0, 0, "same"),
        ("among moving obstacles", -5, 1.0, 0, "open"),
        ("among moving obstacles", -5, 1.0, 0, "faster"),  # no time makes up for successes that may differ
    ],
)
def test_readme_says_of_a_pair_what_success_says_of_it_before_and_after_correction(
    where: str, points: int, p: float, wins: bool, told: str, tmp_path: Path
) -> None:
    published = results_page.Store(STUDIES.parents[1])
    name, board = f"{STEMS[where]}_pairs", f"{sections.RESULTS}/{STEMS[where]}_board.csv"
    kept = results_page.Store(tmp_path, {board: published.content(board)})  # of one task: others take long to read
    lines = [dict(row) for row in published.rows(name)]
    rival = "ilqr (hand-tuned)" if "paths" in where else "reeds_shepp_scan"
    reach = {"same": 0.5, "open": 9.0, "faster": 9.0}.get(told, 5.0)
    for line in lines:
        if (line["policy"], line["beside"]) == ("ppo (trained)", rival) and line["scenes"] in where:
            ends = points - reach, points, points + reach
            names = ("from", "success (points)", "to")
            line |= {each: f"{end}" for each, end in zip(names, ends, strict=True)}
            line |= {"p of success": f"{p}", "exact limit (points)": f"{abs(points) + 0.9}"}
            line |= {"p of cost": "1e-12"} if told == "faster" else {}
    text = io.StringIO()
    writer = csv.DictWriter(text, list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    kept.changed[f"{sections.RESULTS}/{name}.csv"] = text.getvalue().encode()
    named = "`ilqr` (hand-tuned)" if "paths" in where else "`reeds_shepp_scan`"
    names = [named, "agent `ppo`"][:: -1 if wins else 1]
    wanted = {
        "same": f"{' and '.join(names)} {WORDS['same']}",
        **dict.fromkeys(("open", "faster"), f"neither {' nor '.join(names)} is significantly better"),
    }.get(told, f" {WORDS.get(told)} ".join(names))
    panel = next(front_page.panels(kept))
    match = next(each for each in panel.matches if each.where in where)
    assert wanted in front_page.sentences([dataclasses.replace(panel, matches=(match,))])[0]
    assert match.sooner == ("agent" if told == "faster" else "")
