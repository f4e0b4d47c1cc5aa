"""The contests: what they write, that they pair, repeat and go on after an interruption, and how they refuse."""

import csv
import dataclasses
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
from hypothesis import given
from hypothesis import strategies as st

from wayfield import benchmarks, policies
from wayfield.benchmarks import parts, suite, tune
from wayfield.benchmarks.contest_options import ContestOptions, seed_of
from wayfield.benchmarks.contests import (
    CONTESTS,
    OVERVIEW,
    PAPER,
    Course,
    Entrants,
    Score,
    goal_obstacles,
    path_following,
)
from wayfield.benchmarks.contests import contest as contest_module
from wayfield.benchmarks.entries import seeds_told
from wayfield.benchmarks.evaluate import main
from wayfield.benchmarks.matrix import Runs, how_often_better
from wayfield.benchmarks.metrics import measure
from wayfield.benchmarks.results import number, read_rows, read_trajectories
from wayfield.benchmarks.shortest import shortest_way
from wayfield.benchmarks.suite import Setting, episodes, heads_first
from wayfield.envs.disturbances import LEVELS
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS, GoalScenario, circle, obstacle_field, path_scenarios, splits, wall
from wayfield.policies import tuned
from wayfield.policies.tuned import TunedSet, condition, read_gains, tuned_set

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
    assert "Clopper" in text
    with open(out / f"{stem}.csv", newline="") as file:
        lines = list(csv.reader(file))
    assert {line[0] for line in lines[1:]} == {"lookahead_retuned", "pure_pursuit"}
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


def test_the_overview_has_those_who_matter_and_agents_where_they_ship() -> None:
    for contest in CONTESTS.values():
        assert set(contest.overview) < set(contest.policies)
        assert ("ppo" in contest.overview) == ("ppo" in contest.policies)
        assert len(contest.overview) >= 5


def test_the_overview_has_the_first_seeds_of_each_agent_and_says_so() -> None:
    names, robot = tuple(CONTESTS), ROBOTS["p3dx"]
    options = ContestOptions(OVERVIEW, names, None, ("kinematic",), "lagged", robot, ("best",), None, None, 0)
    met = {(each.case.document, each.case.policy, each.case.gains["seed"]) for each in options.settings()
           if each.case.policy == "ppo"}  # fmt: skip
    assert met == {(name, "ppo", seed) for name in names for seed in range(3)}
    row = {"gains_name": "trained", "robot": "p3dx"}
    few, all_seeds = ([row | {"agent_seed": str(k)} for k in range(count)] for count in (3, 10))
    assert seeds_told(few, CONTESTS["goal-obstacles"]) == "seeds 0 to 2 alone"
    assert seeds_told(all_seeds, CONTESTS["goal-obstacles"]) == "every seed"


def test_what_compiles_is_begun_first_and_no_setting_is_lost() -> None:
    names, robot = tuple(CONTESTS), ROBOTS["p3dx"]
    settings = ContestOptions(
        OVERVIEW, names, None, ("kinematic",), "lagged", robot, ("best",), None, None, 0
    ).settings()
    order = heads_first(settings)
    assert sorted(order) == list(range(len(settings)))
    assert [settings[i].case.document for i in order[:2]] == ["goal-obstacles", "path-following"]
    drivers = {(each.case.document, each.case.policy) for each in settings}
    heads = order[: len(drivers)]  # each of them once before any twice
    assert {(settings[i].case.document, settings[i].case.policy) for i in heads} == drivers


def test_no_two_scenes_share_their_noise() -> None:
    drawn: dict[int, tuple[str, str, int]] = {}
    for contest in CONTESTS.values():
        for split in ("validation", "test", "claims"):
            for family in contest.spec.families:
                for k in range(splits.SPLITS[split]):
                    seed = seed_of(0, split, family) + k
                    assert drawn.setdefault(seed, (split, family, k)) == (split, family, k)
    assert seed_of(0, "test", "circles") != seed_of(1, "test", "circles")
    assert 0 <= min(drawn) <= max(drawn) < 2**31


def test_the_seeds_of_a_run_are_those_of_its_scenes(paths: tuple[Path, Result]) -> None:
    rows = [row for row in read_rows(paths[0]) if row["split"] == "test" and row["policy"] == "pure_pursuit"]
    assert len({row["seed"] for row in rows}) == len(rows) == 4
    for row in rows:
        assert int(row["seed"]) == seed_of(0, "test", row["family"]) + int(row["episode"])


def test_the_worst_episodes_keep_their_trajectories(paths: tuple[Path, Result]) -> None:
    rows = [row for row in read_rows(paths[0]) if row["split"] == "test" and row["policy"] == "pure_pursuit"]
    kept = [row for row in rows if row["trajectory"]]
    assert len(kept) == suite.WORST
    best_kept = min(number(row, "cross_track_rms") for row in kept)
    assert all(number(row, "cross_track_rms") <= best_kept for row in rows if not row["trajectory"])
    trajectories = read_trajectories(paths[0])
    for row in kept:
        assert len(trajectories[row["trajectory"]].poses) > 100


@pytest.mark.usefixtures("undrawn")
def test_claims_are_other_scenarios_and_ranked_as_those_of_the_test_split(tmp_path: Path) -> None:
    words = ["--suite", "path-following", "--families", "circles", "--policies", "pure_pursuit", "--gains", "default"]
    ran = evaluate(*words, "--episodes", "2", "--split", "claims", "--out", tmp_path / "claims")
    assert ran.exit_code == 0, ran.output
    rows = [row for row in read_rows(tmp_path / "claims") if row["split"] == "claims"]
    frozen = splits.split("path_following", "circles", "claims")
    assert [row["quantity"] for row in rows] == [repr(each.quantity) for each in frozen[:2]]
    assert "pure_pursuit" in (tmp_path / "claims" / "path_following_p3dx.csv").read_text()
    refused = evaluate("--suite", "documents", "--split", "claims", "--out", tmp_path / "documents")
    assert refused.exit_code == 2
    assert "--split belongs to the contests" in refused.stderr


@pytest.mark.usefixtures("undrawn")
def test_all_trajectories_are_kept_whole_on_request(tmp_path: Path) -> None:
    words = ["--suite", "path-following", "--families", "circles", "--policies", "pure_pursuit", "--gains", "default"]
    words += ["--episodes", "5", "--workers", "1", "--keep-trajectories", "all", "--out", str(tmp_path / "all")]
    ran = CliRunner().invoke(main, words)
    assert ran.exit_code == 0, ran.output
    rows, trajectories = benchmarks.read_rows(tmp_path / "all"), benchmarks.read_trajectories(tmp_path / "all")
    assert len([row for row in rows if row["split"] == "test"]) == 5
    assert all(row["trajectory"] in trajectories for row in rows)
    for row in rows:
        driven = trajectories[row["trajectory"]]
        assert driven.twists.shape == driven.poses.shape
        assert driven.times[-1] == pytest.approx(number(row, "time"))
        # what the row says can be worked out from the file alone
        assert measure(driven, None)["cross_track_rms"] == pytest.approx(number(row, "cross_track_rms"), rel=1e-9)


def test_trajectories_of_the_documents_are_all_kept() -> None:
    refused = CliRunner().invoke(main, ["--suite", "documents", "--keep-trajectories", "all"])
    assert "--keep-trajectories belongs to the contests" in refused.stderr


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
            error, shown = (float(part.split("[")[0].rstrip("‡")) for part in cell.split("|"))
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


@pytest.mark.slow
def test_a_paper_s_law_is_held_by_a_trap_that_our_additions_leave() -> None:
    contest = CONTESTS["goal-obstacles"]
    for name in PAPER:
        left = {}
        course, entrants = Course("u_traps_30", "validation"), Entrants((name,), ("default", "paper"))
        for case in contest.cases("p3dx", course, entrants):
            setting = Setting("a test", case, "kinematic", "lagged", 0, 10)
            left[case.gains_name] = sum(number(row, "success") for row, _ in episodes(setting))
        assert left["paper"] < left["default"]


@pytest.mark.usefixtures("undrawn")
def test_a_second_run_gives_the_same_rows(paths: tuple[Path, Result], tmp_path: Path) -> None:
    assert evaluate(*SMALL, "--out", tmp_path / "again").exit_code == 0
    assert (tmp_path / "again" / "episodes.csv").read_bytes() == (paths[0] / "episodes.csv").read_bytes()


@pytest.mark.usefixtures("undrawn")
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
    played: list[Setting] = []
    play = parts.play
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "play", lambda setting: (played.append(setting), play(setting))[1])
        result = evaluate(*SMALL, "--out", out)
    assert result.exit_code == 0, result.output
    assert len(played) == 28 - len(before)
    assert not (out / "unfinished").exists()
    assert (out / "episodes.csv").read_bytes() == (paths[0] / "episodes.csv").read_bytes()


def test_the_ladder_runs_every_level_of_every_task(tmp_path: Path) -> None:
    arguments = ("--suite", "disturbances", "--policies", "pure_pursuit,apf_corrected", "--gains", "default")
    families = ",".join(next(iter(spec.families)) for spec in TASKS.values())
    result = evaluate(*arguments, "--families", families, "--episodes", 1, "--out", tmp_path)
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
        (("--suite", "goal-obstacles", "--policies", "dwa,mppi", "--gains", "paper"), "'mppi' has no case"),
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
    runs = Runs.of(rows, contest)
    assert how_often_better(runs, runs).value == 0.0
    with pytest.raises(ValueError, match="have not met the same scenarios"):
        how_often_better(runs, Runs.of(rows[:-1], contest))


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
    arguments = ["pure_pursuit", "--suite", "path-following", "--trials", "4", "--scenarios", "1", "--workers", "1"]
    result = CliRunner().invoke(tune.main, [*arguments, "--speed", "0.45", "--out", str(out)])
    assert result.exit_code == 0, result.output
    content = json.loads(out.read_text())
    assert (content["robot"], content["speed"], content["level"]) == ("p3dx", 0.45, "none")
    found, default = content["validation"]["chosen"], content["validation"]["default"]
    order = ("failures", "off_pace", "quality")
    assert [found[each] for each in order] <= [default[each] for each in order]
    assert abs(found["mean_speed"] - 0.45) <= 0.03 * 0.45 or found["off_pace"]
    # at least the default gains once on either split; a path of some 10 m at 0.45 m/s takes 400 frames
    assert content["frames"] > 2 * 13 * 200
    assert content["searched_on"]["split"] == "train"
    assert content["searched_on"]["sha256"] != content["searched_on"]["validation_sha256"]
    policies.make("pure_pursuit", **content["gains"])


def test_a_search_ends_with_its_frames(tmp_path: Path) -> None:
    frames = []
    for budget in ("1", "10000"):
        out = tmp_path / f"{budget}.json"
        arguments = ["pure_pursuit", "--suite", "path-following", "--scenarios", "1", "--workers", "1"]
        assert CliRunner().invoke(tune.main, [*arguments, "--frames", budget, "--out", str(out)]).exit_code == 0
        frames.append(json.loads(out.read_text())["frames"])
    assert frames[0] < frames[1]


def test_tuning_replaces_nothing_unasked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tune.Search, "drive", lambda *_: tune.Drive(Score(0, 0, 1.0, 0.6, 10, 1000)))
    shipped = tmp_path / "shipped"
    monkeypatch.setattr(tune, "folder_of", lambda suite: shipped / suite)
    (shipped / "path-following").mkdir(parents=True)
    published = shipped / "path-following" / "lqr_p3dx_0.6_none.json"
    published.write_text("published")

    def tuned(*words: str) -> Result:
        basic = ["lqr", "--suite", "path-following", "--trials", "1", "--scenarios", "1", "--workers", "1"]
        return CliRunner().invoke(tune.main, [*basic, *words])

    assert tuned("--robot", "omni3").exit_code == 0
    written = [path.name for path in (tmp_path / "results/gains/path-following").iterdir()]
    assert written == ["lqr_omni3_0.6_none.json"]
    for words in (["--robot", "omni3"], ["--ship"], ["--out", str(published)]):
        refused = tuned(*words)
        assert refused.exit_code == 2
        assert "--force" in refused.stderr
    assert published.read_text() == "published"
    assert tuned("--ship", "--force").exit_code == 0
    content = json.loads(published.read_text())
    assert content["robot"] == "p3dx"
    assert content["chosen"] == "default"  # nothing was better
    searched: list[Any] = []
    monkeypatch.setattr(tune.Search, "drive", lambda *words: searched.append(words))
    for out in (tmp_path, published / "below", ""):
        refused = tuned("--out", str(out), "--force")
        assert refused.exit_code in (1, 2)
        assert len(refused.stderr.splitlines()) == 1
        assert "--out" in refused.stderr
    assert not searched


def test_a_score_puts_success_first_then_the_speed() -> None:
    def row(**cells: float) -> dict[str, str]:
        return {name: str(value) for name, value in cells.items()}

    def goals(*rows: dict[str, str]) -> Score:
        return goal_obstacles.score(rows, [], 0.6, 0.0)

    won = row(success=1, sct=0.1, time=20, mean_speed=0.5)
    lost, quick = row(success=0, sct=0.0, time=1, mean_speed=0.5), row(success=1, sct=0.9, time=9, mean_speed=0.6)
    assert goals(quick, won) < goals(won, won) < goals(quick, lost) < goals(won, lost)
    (path,) = path_scenarios("straight")
    time = path.path.length / 0.6

    def paths(rms: float, pace: float, *, success: int = 1) -> Score:
        each = row(success=success, cross_track_rms=rms, time=time / pace, mean_speed=0.6 * pace)
        return path_following.score([each], [path], 0.6, 0.3)

    exact, rough, slow = paths(0.01, 0.98), paths(0.02, 1.0), paths(0.001, 0.9)
    # no error makes up for the asked speed, nor any of both for a failure
    assert exact < rough < slow < paths(0.001, 0.4) < paths(0.001, 1.0, success=0)
    assert not rough.off_pace
    assert slow.off_pace
    # of two that do not hold it, half the error is worth twice the time
    assert paths(0.01, 0.9).quality == pytest.approx(paths(0.006, 0.54).quality)
    assert exact.frames == round(time / 0.98 / 0.05)


@given(
    st.lists(
        st.tuples(st.integers(0, 300), st.integers(0, 2), st.floats(0.0, 1e3)), min_size=2, max_size=6, unique=True
    )
)
def test_the_value_of_a_score_never_turns_its_order_round(drawn: list[tuple[int, int, float]]) -> None:
    scores = sorted(Score(*each) for each in drawn)
    values = [each.value for each in scores]
    assert values == sorted(values)
    assert all(each.failures <= each.value < each.failures + 1 for each in scores)


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
    for contest in CONTESTS.values():
        for name in set(contest.policies).intersection(tune.SEARCHED):
            policy: Any = policies.make(name)
            for gain, each in tune.searched(name, contest.name).items():
                assert each.low <= getattr(policy, gain) <= each.high, f"{name}.{gain}"


def test_shipped_gains_are_no_worse_than_the_default_ones_and_say_what_they_cost() -> None:
    for name, each in CONTESTS.items():
        digests: dict[tuple[str, int], set[str]] = {}
        for file in sorted(tune.folder_of(name).glob("*.json")):
            content = json.loads(file.read_text())
            where = content["robot"], content["speed"], content["level"]
            assert file.stem == f"{content['policy']}_{condition(*where)}"
            assert content["policy"] in each.policies
            found, default = content["validation"]["chosen"], content["validation"]["default"]
            order = ("failures", "off_pace", "quality")
            better = [found[each] for each in order] < [default[each] for each in order]
            assert better == (content["chosen"] == "search")
            assert better or found == default
            assert content["frames"] > 10_000
            there = content["searched_on"]
            digests.setdefault((there["split"], there["scenarios"]), set()).add(there["sha256"])
            gains = policies.tuned_gains(content["policy"], name, *where)
            policies.make(content["policy"], **gains)
            if each.speeds and not found["off_pace"]:
                assert abs(found["mean_speed"] - content["speed"]) <= 0.03 * content["speed"] + 1e-4
        assert all(len(same) == 1 for same in digests.values())


def test_gains_are_handed_out_for_their_condition_alone() -> None:
    for name in CONTESTS:
        files = sorted(tune.folder_of(name).glob("*.json"))
        assert files
        with pytest.raises(policies.NotTuned, match="there are: none"):
            policies.tuned_gains("zero", name)
        for file in files[:3]:
            content = json.loads(file.read_text())
            policy, where = content["policy"], (content["robot"], content["speed"], content["level"])
            assert tuned_set(policy, name, *where) is not None
            for other in (("omni9", *where[1:]), (where[0], 0.123, where[2]), (*where[:2], "severe")):
                assert tuned_set(policy, name, *other) is None
                with pytest.raises(policies.NotTuned, match=re.escape(condition(*where))):
                    policies.tuned_gains(policy, name, *other)


def test_where_nothing_was_tuned_the_row_is_called_default(monkeypatch: pytest.MonkeyPatch) -> None:
    contest = CONTESTS["path-following"]
    for asked in (("tuned",), ("best",), ("default", "tuned", "paper")):
        assert list(contest.gain_sets("pure_pursuit", "omni4", asked, 0.123)) == [("default", {})]
    case = next(contest.cases("omni4", Course("circles", "test"), Entrants(("lqr",), ("tuned",)), speed=0.123))
    assert (case.gains_name, case.gains) == ("default", {"speed": 0.123})
    assert parts.described(contest, case)["learned_from"] == "0 frames"
    kept = TunedSet({"speed": 0.7, "q_e": 50.0}, "p3dx", 0.6, "none", "search", 2_340_000)
    monkeypatch.setattr(contest_module, "tuned_set", lambda *_: kept)
    monkeypatch.setattr(parts, "tuned_set", lambda *_: kept)
    # a set that was tuned for a speed is driven as it was found: nothing of it is written over
    case = next(contest.cases("p3dx", Course("circles", "test"), Entrants(("lqr",), ("tuned",)), speed=0.6))
    assert (case.gains_name, case.gains) == ("tuned", dict(kept.gains))
    assert parts.described(contest, case)["learned_from"] == "2.3 M frames"
    assert parts.described(contest, dataclasses.replace(case, gains_name="default"))["learned_from"] == "0 frames"
    chosen_there = dataclasses.replace(kept, split="validation")
    monkeypatch.setattr(parts, "tuned_set", lambda *_: chosen_there)
    assert parts.described(contest, case)["learned_from"] == "2.3 M frames, on validation"
    lost = dataclasses.replace(kept, chosen="default")
    monkeypatch.setattr(contest_module, "tuned_set", lambda *_: lost)
    assert list(contest.gain_sets("lqr", "p3dx", ("default", "tuned"))) == [("default", {})]
    monkeypatch.setattr(parts, "tuned_set", lambda *_: lost)
    (case,) = contest.cases("p3dx", Course("circles", "test"), Entrants(("lqr",)))
    assert parts.described(contest, case)["learned_from"] == "2.3 M frames, best of them"


def test_every_row_has_its_budget_in_frames() -> None:
    for contest in CONTESTS.values():
        for robot in ROBOTS:
            for case in contest.cases(robot, Course("all", "test"), Entrants(contest.policies)):
                told = parts.described(contest, case)["learned_from"]
                assert re.match(r"(0|[\d.]+ M) frames(, |$)", told), (case.policy, case.gains_name, told)


def test_a_gain_that_is_given_is_not_written_over_by_a_speed() -> None:
    assert policies.cruising("lookahead_retuned", {"k_ang": 5.0, "lookahead_distance": 0.3}, 0.6) == {"k_lin": 2.0}
    assert policies.cruising("lookahead_retuned", {}, 0.3) == pytest.approx({"k_lin": 0.6, "k_ang": 1.2})


def test_gains_that_were_handed_out_are_the_asker_s() -> None:
    first = policies.tuned_gains("lqr", "path-following")
    kept = dict(first)
    first.clear()
    assert kept
    assert policies.tuned_gains("lqr", "path-following") == kept


def test_gains_are_those_of_their_file_s_name_and_no_other_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = Path(tuned.__file__).parent / "gains" / "path-following" / "lqr_p3dx_0.6_none.json"
    names = (
        "lqr_p3dx_0.6_none.json",
        "lqr_omni3_0.6_none.json",
        "lqr_p3dx_0.9_light.json.bak",
        "my_lqr_p3dx_1_none.json",
    )
    for name in names:
        (tmp_path / name).write_bytes(shipped.read_bytes())
    monkeypatch.setattr(tuned, "_folder", lambda suite: tmp_path)
    assert tuned.tuned_conditions("lqr", "path-following") == ["omni3_0.6_none", "p3dx_0.6_none"]
    assert tuned_set("lqr", "path-following") is not None
    assert tuned_set("lqr", "path-following", speed=0.9) is None
    with pytest.raises(ValueError, match=r"holds gains for p3dx_0\.6_none, not for omni3_0\.6_none"):
        tuned_set("lqr", "path-following", "omni3")


def test_a_damaged_gains_file_is_refused() -> None:
    good = {"policy": "stanley", "robot": "p3dx", "speed": 0.6, "level": "none", "chosen": "search", "frames": 1}
    assert read_gains(json.dumps({**good, "gains": {"k": 1.0}}), "gains.json", "stanley")["frames"] == 1
    for text, message in (
        ("{", "is no JSON"),
        ('{"policy": "lqr", "gains": {}}', "does not hold gains of policy 'stanley'"),
        ('{"policy": "stanley", "gains": {"k": [1]}}', "must map names to plain values"),
        *(
            (json.dumps({**good, "gains": {}, name: value}), f"{name} must be")
            for name, value in (
                *(
                    ("robot", 3),
                    ("level", None),
                    ("speed", -1.0),
                    ("speed", 0),
                    ("speed", True),
                    ("chosen", "luck"),
                    ("frames", 0.5),
                ),
                *(("searched_on", value) for value in ("train", None, {"split": 3})),
            )
        ),
    ):
        with pytest.raises(ValueError, match=message):
            read_gains(text, "gains.json", "stanley")
    with pytest.raises(ValueError, match="plain names"):
        policies.tuned_gains("../x", "path-following")
    with pytest.raises(policies.NotTuned):
        policies.tuned_gains("lqr", "path-following", "../p3dx")
