"""The contests: what they write, that they pair, repeat and go on after an interruption, and how they refuse."""

import csv
import json
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from wayfield import policies
from wayfield.benchmarks import parts, tune
from wayfield.benchmarks.contests import CONTESTS, PAPER, Course, Entrants, goal_obstacles, path_following
from wayfield.benchmarks.evaluate import main
from wayfield.benchmarks.results import number, read_rows, read_trajectories
from wayfield.benchmarks.shortest import shortest_way
from wayfield.benchmarks.standings import how_often_better
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.scenarios import GoalScenario, circle, obstacle_field, path_scenarios, splits, wall

PATHS = ("--suite", "path-following", "--policies", "pure_pursuit,lookahead_retuned", "--gains", "default")
SMALL = (*PATHS, "--families", "circles,polylines_90", "--episodes", "2")


def evaluate(*arguments: object) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(main, ["--workers", "1", *map(str, arguments)])


@pytest.fixture(scope="module")
def paths(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    out = tmp_path_factory.mktemp("contest") / "paths"
    return out, evaluate(*SMALL, "--out", out)


def test_it_writes_tables_in_three_formats_figures_and_rows(paths: tuple[Path, Result]) -> None:
    out, result = paths
    assert result.exit_code == 0, result.output
    names = {file.name for file in out.iterdir()}
    stem = "path_following_p3dx"
    tables = {f"{stem}{end}" for end in ("", "_families", "_tiers", "_better")}
    assert {f"{table}.{kind}" for table in tables for kind in ("csv", "tex")} <= names
    assert {f"{stem}_{figure}.{kind}" for figure in ("families", "worst", "front") for kind in ("svg", "png")} <= names
    assert {"episodes.csv", "trajectories.npz", "decisions.csv", "table.md"} <= names
    assert "unfinished" not in names
    text = (out / "table.md").read_text()
    assert "--families circles,polylines_90 --episodes 2" in text
    assert "Wilson" in text
    with open(out / f"{stem}.csv", newline="") as file:
        lines = list(csv.reader(file))
    assert [line[0] for line in lines[1:]] == ["lookahead_retuned", "pure_pursuit"]
    assert re.search(r"\\begin{tabular}.*\\bottomrule", (out / f"{stem}.tex").read_text(), re.DOTALL)


def test_policies_meet_the_same_scenarios(paths: tuple[Path, Result]) -> None:
    rows = [row for row in read_rows(paths[0]) if row["split"] == "test"]
    met = {
        policy: [(row["scenario"], row["episode"], row["seed"]) for row in rows if row["policy"] == policy]
        for policy in ("pure_pursuit", "lookahead_retuned")
    }
    assert met["pure_pursuit"] == met["lookahead_retuned"]
    assert len(met["pure_pursuit"]) == 4
    frozen = splits.split("path_following", "circles", "test")
    for row in rows:
        if row["family"] == "circles":
            assert row["tier"] == frozen[int(row["episode"])].tier


def test_the_worst_episodes_keep_their_trajectories(paths: tuple[Path, Result]) -> None:
    rows = [row for row in read_rows(paths[0]) if row["split"] == "test" and row["policy"] == "pure_pursuit"]
    kept = [row for row in rows if row["trajectory"]]
    assert len(kept) == parts.WORST
    best_kept = min(number(row, "cross_track_rms") for row in kept)
    assert all(number(row, "cross_track_rms") <= best_kept for row in rows if not row["trajectory"])
    trajectories = read_trajectories(paths[0])
    for row in kept:
        assert len(trajectories[row["trajectory"]].poses) > 100


def test_the_front_sweeps_the_speed(paths: tuple[Path, Result]) -> None:
    swept = [row for row in read_rows(paths[0]) if row["split"] == "front"]
    rows = [row for row in swept if row["family"] == "circles"]
    for policy in ("pure_pursuit", "lookahead_retuned"):
        pace = {float(row["speed"]): number(row, "mean_speed") for row in rows if row["policy"] == policy}
        assert len(pace) == 6
        with open(paths[0] / "path_following_p3dx_front.csv", newline="") as file:
            cells = {row["policy"]: row for row in csv.DictReader(file)}
        for asked, cell in list(cells[policy].items())[1:]:
            of_speed = [row for row in swept if row["policy"] == policy and row["speed"] == asked]
            error, shown = (float(part.split("[")[0]) for part in cell.split("|"))
            paces = [number(row, "mean_speed") for row in of_speed]
            # a run that left the corridor counts as 1 m
            errors = [number(row, "cross_track_rms") if number(row, "success") else 1.0 for row in of_speed]
            assert min(paces) - 0.005 <= shown <= max(paces) + 0.005
            assert min(errors) - 0.00005 <= error <= max(errors) + 0.00005
        # the documented law settles a little under k_lin L in bends
        assert all(0.75 * speed < found < 1.05 * speed for speed, found in pace.items())


def test_every_policy_can_be_told_its_speed() -> None:
    for each in CONTESTS.values():
        if each.speeds:
            for name in each.policies:
                policies.make(name, **policies.cruising(name, {}, 0.45))


def test_a_paper_s_law_is_held_by_a_trap_that_our_additions_leave() -> None:
    contest = CONTESTS["goal-obstacles"]
    for name in PAPER:
        left = {}
        course, entrants = Course("u_traps_30", "validation"), Entrants((name,), ("default", "paper"))
        for case in contest.cases("p3dx", course, entrants):
            setting = Setting("a test", case, "kinematic", "lagged", 0, 10)
            left[case.gains_name] = sum(number(row, "success") for row, _ in episodes(setting))
        assert left["paper"] < left["default"]


def test_a_second_run_gives_the_same_rows(paths: tuple[Path, Result], tmp_path: Path) -> None:
    assert evaluate(*SMALL, "--out", tmp_path / "again").exit_code == 0
    assert (tmp_path / "again" / "episodes.csv").read_bytes() == (paths[0] / "episodes.csv").read_bytes()


def test_an_interrupted_run_keeps_what_is_done_and_goes_on(paths: tuple[Path, Result], tmp_path: Path) -> None:
    out = tmp_path / "out"
    script = Path(__file__).parents[1] / "evaluate.py"
    command = [sys.executable, str(script), *SMALL, "--workers", "1", "--out", str(out)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    while len(list((out / "unfinished").glob("[!.]*"))) < 2 and process.poll() is None:
        time.sleep(0.02)
    process.terminate()
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    (kept,) = re.findall(r"interrupted; (\d+) of 28 parts are kept", errors)
    assert int(kept) >= 2
    assert {file.name for file in out.iterdir()} == {"unfinished", ".lock"}
    before = list((out / "unfinished").glob("[!.]*"))
    played: list[parts.Part] = []
    play = parts.play
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "play", lambda part: (played.append(part), play(part)))
        result = evaluate(*SMALL, "--out", out)
    assert result.exit_code == 0, result.output
    assert len(played) == 28 - len(before)
    assert not (out / "unfinished").exists()
    assert (out / "episodes.csv").read_bytes() == (paths[0] / "episodes.csv").read_bytes()


def test_the_ladder_runs_every_level_of_every_task(tmp_path: Path) -> None:
    arguments = ("--suite", "disturbances", "--policies", "pure_pursuit,apf_corrected", "--gains", "default")
    result = evaluate(*arguments, "--families", "circles,open_fields,open", "--episodes", 1, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    rows = read_rows(tmp_path)
    assert {(row["contest"], row["disturbance"]) for row in rows} == {
        (name, level) for name in CONTESTS for level in LEVELS
    }
    for name in ("path_following", "goal_obstacles"):
        assert (tmp_path / f"{name}_p3dx_ladder.png").stat().st_size > 0
        with open(tmp_path / f"{name}_p3dx_ladder.csv", newline="") as file:
            assert next(csv.reader(file))[1:] == list(LEVELS)
    errors = {row["disturbance"]: number(row, "cross_track_rms") for row in rows if row["policy"] == "pure_pursuit"}
    assert errors["severe"] > errors["none"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--suite", "path-folowing"), "Did you mean 'path-following'?"),
        (("--suite", "path-following", "--policies", "dwa"), "'dwa' takes no part in suite 'path-following'"),
        (("--suite", "goal-obstacles", "--families", "circles"), "'circles' has no scenarios for suite"),
        (("--suite", "goal-obstacles", "--families", "rooms,push_boxes"), "use --dynamics pymunk"),
        (("--suite", "goal-obstacles", "--policies", "dwa,orca", "--gains", "paper"), "'orca' has no case"),
        (("--suite", "path-following", "--seed", "99999999999"), "99999999999"),
        (("--suite", "goal-obstacles", "--families", "cluter_10"), "Did you mean 'clutter_10'?"),
        (("--suite", "path-following", "--video"), "--video belongs to --suite documents"),
        (("--robot", "p3dx"), "--robot belongs to the contests"),
        (("--gains", "tuned"), "--gains belongs to the contests"),
        (("--suite", "path-following", "--robot", "p3d"), "Did you mean 'p3dx'?"),
        (("--suite", "path-following", "--episodes", "0"), "episodes"),
    ],
)
def test_wrong_options_are_refused_in_one_line(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    result = evaluate(*arguments, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_comparisons_that_are_not_paired_are_refused(paths: tuple[Path, Result]) -> None:
    rows = [row for row in read_rows(paths[0]) if row["split"] == "test" and row["policy"] == "pure_pursuit"]
    contest = CONTESTS["path-following"]
    often, low, high = how_often_better(rows, rows, contest)
    assert (often, low, high) == (0.5, 0.5, 0.5)
    with pytest.raises(ValueError, match="have not met the same scenarios"):
        how_often_better(rows, rows[:-1], contest)


# The shortest way.


def test_the_shortest_way_is_straight_in_the_open_and_goes_round_what_stands() -> None:
    open_field = GoalScenario("open", goal=(4.0, 3.0, 0.0), position_tolerance=0.2)
    assert shortest_way(open_field, 0.25) == pytest.approx(5.0 - 0.2, rel=0.01)
    # around a disc of 1 m halfway: two tangents and an arc at the hull's distance
    disc = GoalScenario("disc", goal=(4.0, 0.0, 0.0), obstacles=obstacle_field(circle(2.0, 0.0, 0.75)))
    tangent = np.sqrt(3.0)
    arc = np.pi - 2.0 * np.arccos(1.0 / 2.0)
    assert shortest_way(disc, 0.25) == pytest.approx(2.0 * tangent + arc - 0.1, rel=0.02)


def test_a_goal_behind_walls_has_no_way() -> None:
    ends = [(3.0, -1.0), (5.0, -1.0), (5.0, 1.0), (3.0, 1.0)]
    box_of_walls = [wall(*a, *b) for a, b in zip(ends, [*ends[1:], ends[0]], strict=True)]
    shut = GoalScenario("shut", goal=(4.0, 0.0, 0.0), obstacles=obstacle_field(*box_of_walls))
    with pytest.raises(ValueError, match=r"'shut' has no way for a hull of 0\.25 m"):
        shortest_way(shut, 0.25)


# Tuning.


def test_tuning_writes_gains_that_are_no_worse_and_can_be_used(tmp_path: Path) -> None:
    out = tmp_path / "gains.json"
    arguments = ["pure_pursuit", "--suite", "path-following", "--trials", "3", "--scenarios", "1", "--workers", "1"]
    result = CliRunner().invoke(tune.main, [*arguments, "--out", str(out)])
    assert result.exit_code == 0, result.output
    content = json.loads(out.read_text())
    assert content["score"] <= content["score_of_defaults"]
    assert content["split"] == "validation"
    assert content["trials"] == 3
    policies.make("pure_pursuit", **content["gains"])


def test_tuning_replaces_nothing_unasked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tune, "score", lambda *_: 0.0)
    shipped = tmp_path / "shipped"
    monkeypatch.setattr(tune, "folder_of", lambda suite: shipped / suite)
    (shipped / "path-following").mkdir(parents=True)
    published = shipped / "path-following" / "lqr.json"
    published.write_text("published")

    def tuned(*words: str) -> Result:
        basic = ["lqr", "--suite", "path-following", "--trials", "1", "--scenarios", "1", "--workers", "1"]
        return CliRunner().invoke(tune.main, [*basic, *words])

    assert tuned("--robot", "omni3").exit_code == 0
    assert [path.name for path in (tmp_path / "results/gains/path-following").iterdir()] == ["lqr_omni3.json"]
    for words in (["--robot", "omni3"], ["--ship"], ["--out", str(published)]):
        refused = tuned(*words)
        assert refused.exit_code == 2
        assert "--force" in refused.stderr
    assert published.read_text() == "published"
    assert tuned("--ship", "--force").exit_code == 0
    assert json.loads(published.read_text())["robot"] == "p3dx"
    monkeypatch.setattr(tune, "score", lambda *_: pytest.fail("it searched"))
    for out in (tmp_path, published / "below", ""):
        assert tuned("--out", str(out), "--force").exit_code in (1, 2)


def test_the_score_puts_success_first() -> None:
    def row(**cells: float) -> dict[str, str]:
        return {name: str(value) for name, value in cells.items()}

    won, lost = row(success=1, sct=0.1), row(success=0, sct=0.0)
    quick = row(success=1, sct=0.9)
    assert goal_obstacles.score([won, won], [0, 0]) < goal_obstacles.score([quick, lost], [0, 0])
    assert goal_obstacles.score([quick, lost], [0, 0]) < goal_obstacles.score([won, lost], [0, 0])
    exact, rough = row(success=1, cross_track_rms=0.01, time=20), row(success=1, cross_track_rms=0.02, time=20)
    slow = row(success=1, cross_track_rms=0.01, time=40)
    failed = row(success=0, cross_track_rms=0.001, time=1)
    (path,) = path_scenarios("straight")
    score = [path_following.score([each], [path]) for each in (exact, rough, slow, failed)]
    assert score[0] < score[1] == pytest.approx(score[2])
    assert score[3] > max(score[:3])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pure_pursit", "--suite", "path-following"], "Did you mean 'pure_pursuit'?"),
        (["dwa", "--suite", "path-following"], "'dwa' takes no part"),
        (["dwa", "--suite", "goal-obstacles", "--trials", "0"], "trials"),
        (["dwa"], "--suite"),
    ],
)
def test_tuning_refuses_what_it_cannot_do(arguments: list[str], message: str) -> None:
    result = CliRunner().invoke(tune.main, arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_every_searched_gain_is_one_and_its_default_lies_in_the_range() -> None:
    for name, ranges in tune.SEARCHED.items():
        policy: Any = policies.make(name)
        for gain, each in ranges.items():
            assert each.low <= getattr(policy, gain) <= each.high, f"{name}.{gain}"


def test_shipped_gains_are_accepted_and_say_what_they_cost() -> None:
    for name, each in CONTESTS.items():
        for file in sorted(tune.folder_of(name).glob("*.json")):
            content = json.loads(file.read_text())
            assert content["policy"] == file.stem
            assert file.stem in each.policies
            assert content["score"] <= content["score_of_defaults"]
            assert content["split"] == "validation"
            assert content["trials"] >= 10
            policies.make(file.stem, **policies.tuned_gains(file.stem, name))


def test_a_damaged_gains_file_is_refused() -> None:
    from wayfield.policies.tuned import read_gains

    for text, message in (
        ("{", "is no JSON"),
        ('{"policy": "lqr", "gains": {}}', "does not hold gains of policy 'stanley'"),
        ('{"policy": "stanley", "gains": {"k": [1]}}', "must map names to plain values"),
    ):
        with pytest.raises(ValueError, match=message):
            read_gains(text, "gains.json", "stanley")
    with pytest.raises(ValueError, match="plain names"):
        policies.tuned_gains("../x", "path-following")
