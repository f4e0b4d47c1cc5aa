"""The contests: what they write, that they pair, repeat and go on after an interruption, and how they refuse."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from wayfield import benchmarks, policies
from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.contests import (
    CONTESTS,
    PAPER,
    Course,
    Entrants,
    Score,
    goal_obstacles,
    path_following,
)
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.leaderboards.matrix import Runs, how_often_better
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.results import read_rows
from wayfield.benchmarks.runs import shards
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.benchmarks.tuning import tune
from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.scenarios import TASKS, path_scenarios, splits
from wayfield.policies.parts.tuned import condition, read_gains, tuned_set

PATHS = ("--suite", "path-following", "--policies", "pure_pursuit,lookahead_retuned", "--gains", "default")
SMALL = (*PATHS, "--families", "circles,polylines_90", "--episodes", "2", "--keep-trajectories", "all")


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
    assert {"episodes.csv", "speed_sweep.csv", "trajectories.npz", "decisions.csv", "table.md"} <= names
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
            assert row["tier"] == frozen[row["episode"]].tier


def test_all_trajectories_are_kept_whole_on_request(paths: tuple[Path, Result]) -> None:
    rows, trajectories = benchmarks.read_rows(paths[0]), benchmarks.read_trajectories(paths[0])
    assert len([row for row in rows if row["split"] == "test"]) == 8
    assert all(row["trajectory"] in trajectories for row in rows)
    for row in rows:
        driven = trajectories[row["trajectory"]]
        assert driven.twists.shape == driven.poses.shape
        assert driven.times[-1] == pytest.approx(row["time"])
        # what the row says can be worked out from the file alone
        assert measure(driven, None)["cross_track_rms"] == pytest.approx(row["cross_track_rms"], rel=1e-9)


@pytest.mark.slow
def test_all_policies_are_those_on_request_too(tmp_path: Path) -> None:
    words = ("--policies", "all", "--families", "rounds", "--episodes", "1", "--gains", "default")
    done = evaluate("--suite", "trajectory-tracking", *words, "--out", tmp_path / "run")
    assert done.exit_code == 0, done.stderr
    assert set(CONTESTS["trajectory-tracking"].on_request) <= {row["policy"] for row in read_rows(tmp_path / "run")}


def test_every_policy_can_be_told_its_speed() -> None:
    for each in CONTESTS.values():
        if each.speeds:
            for name in each.policies:
                policies.make(name, **policies.cruising(name, {}, 0.45))


@pytest.mark.slow
def test_a_paper_s_law_is_held_by_a_trap_that_our_additions_leave() -> None:
    contest = CONTESTS["goal-obstacles"]
    for name in set(PAPER).intersection(contest.policies):
        left = {}
        course, entrants = Course("u_traps_30", "validation"), Entrants((name,), ("default", "paper"))
        for case in contest.cases("p3dx", course, entrants):
            setting = Setting("a test", case, "kinematic", "lagged", 0, 10)
            left[case.gains_name] = sum(row["success"] for row, _ in episodes(setting))
        assert left["paper"] < left["default"]


# evaluate, which is terminated once it has kept two parts
INTERRUPTED = """
import os, signal
from wayfield.benchmarks.commands.evaluate import main
rename, kept = os.replace, []
def counted(source, target, **more):
    rename(source, target, **more)
    kept.extend([target] if os.path.basename(os.path.dirname(target)) == "unfinished" else [])
    if len(kept) == 2:
        os.kill(os.getpid(), signal.SIGTERM)
os.replace = counted
main()
"""


@pytest.mark.usefixtures("undrawn")
def test_an_interrupted_run_keeps_what_is_done_and_goes_on(paths: tuple[Path, Result], tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-c", INTERRUPTED, *SMALL, "--workers", "1", "--out", str(out)]
    process = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300, check=False)
    errors = process.stderr
    assert process.returncode == 130, errors
    (kept,) = re.findall(r"interrupted; (\d+) of 28 parts are kept", errors)
    assert int(kept) >= 2
    assert {file.name for file in out.iterdir()} == {"unfinished", ".lock"}
    before = list((out / "unfinished").glob("[!.]*"))
    assert len(before) == int(kept)
    result = evaluate(*SMALL, "--out", out)
    assert result.exit_code == 0, result.output
    assert not (out / "unfinished").exists()
    assert (out / "episodes.csv").read_bytes() == (paths[0] / "episodes.csv").read_bytes()


def test_the_ladder_runs_every_level_of_every_task(tmp_path: Path) -> None:
    policies = "pure_pursuit,stanley,apf_corrected,samson"
    arguments = ("--suite", "disturbances", "--policies", policies, "--gains", "default")
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
    errors = {row["disturbance"]: row["cross_track_rms"] for row in rows if row["policy"] == "pure_pursuit"}
    assert errors["severe"] > errors["none"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("--suite", "goal-obstacles", "--families", "circles"),
            "suite 'goal-obstacles'; choose from open_fields, ",
        ),
        (("--suite", "goal-obstacles", "--families", "rooms,push_boxes"), "use --dynamics pymunk"),
        (("--suite", "goal-obstacles", "--policies", "dwa,mppi", "--gains", "paper"), "'mppi' has no case"),
        (
            ("--suite", "docking", "--robot", "p3dx", "--policies", "waypoint"),
            "Waypoint needs a robot that goes sideways",
        ),
        (("--suite", "goal-obstacles", "--families", "cluter_10"), "Did you mean 'clutter_10'?"),
        (("--robot", "p3dx"), "--robot belongs to the contests"),
        (("--suite", "path-following", "--episodes", "0"), "episodes"),
        (
            ("--suite", "docking", "--policies", "polar", "--policies", "mpc_pose"),
            "--policies is given more than once; several values are one word: a,b",
        ),
        (("lqr", "mpc"), "(lqr mpc); each value stands behind its option, several are sep"),
        (
            ("--policies", "lqr,", "mpc"),
            "(mpc); each value stands behind its option, several are separated by commas alone: --policies lqr,mpc",
        ),
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
    runs = Runs.of(Episodes(rows), contest)
    assert how_often_better(runs, runs).value == 0.0
    with pytest.raises(ValueError, match="have not met the same scenarios"):
        how_often_better(runs, Runs.of(Episodes(rows[:-1]), contest))


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


def test_a_score_puts_success_first_then_the_speed() -> None:
    def row(**cells: float) -> dict[str, str]:
        return {name: str(value) for name, value in cells.items()}

    def goals(*rows: dict[str, str]) -> Score:
        return goal_obstacles.score(Episodes(rows), [], 0.6, 0.0)

    won = row(success=1, sct=0.1, time=20, mean_speed=0.5)
    lost, quick = row(success=0, sct=0.0, time=1, mean_speed=0.5), row(success=1, sct=0.9, time=9, mean_speed=0.6)
    assert goals(quick, won) < goals(won, won) < goals(quick, lost) < goals(won, lost)
    (path,) = path_scenarios("straight")
    time = path.path.length / 0.6

    def paths(rms: float, pace: float, *, success: int = 1) -> Score:
        each = row(success=success, time=time / pace, mean_speed=0.6 * pace, tracking_rms=rms) | {"family": "straight"}
        return path_following.score(Episodes([each]), [path], 0.6, 0.3)

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
        (["dwa", "--suite", "goal-obstacles", "--trials", "0"], "trials"),
        (["lqr", "--suite", "path-following", "--from", '{"roundin": 0.1}'], "Lqr has no gain 'roundin'"),
        (["lqr", "--suite", "path-following", "--from", '{"rounding": -1.0}'], "Lqr: rounding must be"),
    ],
)
def test_tuning_refuses_what_it_cannot_do(arguments: list[str], message: str) -> None:
    result = CliRunner().invoke(tune.main, arguments)
    assert result.exit_code == 2
    assert message in result.stderr


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
            assert better == (content["chosen"] != "default")
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


def test_every_row_has_its_budget_in_frames() -> None:
    for contest in CONTESTS.values():
        for robot in ROBOTS:
            for case in contest.cases(robot, Course("all", "test"), Entrants(contest.policies)):
                told = shards.described(contest, case)["learned_from"]
                assert re.match(r"(0|[\d.]+ M) frames(, |$)", told), (case.policy, case.gains_name, told)


def test_a_gain_that_is_given_is_not_written_over_by_a_speed() -> None:
    assert policies.cruising("lookahead_retuned", {"k_ang": 5.0, "lookahead_distance": 0.3}, 0.6) == {"k_lin": 2.0}
    assert policies.cruising("lookahead_retuned", {}, 0.3) == pytest.approx({"k_lin": 0.6, "k_ang": 1.2})


def test_a_damaged_gains_file_is_refused() -> None:
    good = {"policy": "stanley", "robot": "p3dx", "speed": 0.6, "level": "none", "chosen": "search", "frames": 1}
    assert read_gains(json.dumps({**good, "gains": {"k": 1.0}}), "gains.json", "stanley")["frames"] == 1
    for text, message in (
        ("{", "is no JSON"),
        ('{"policy": "lqr", "gains": {}}', "does not hold gains of policy 'stanley'"),
        ('{"policy": "stanley", "gains": {"k": [1]}}', "must map names to plain values"),
        *(
            (json.dumps({**good, "gains": {}, name: value}), f"{name} must be")
            for name, value in (("robot", 3), ("speed", -1.0), ("chosen", "luck"), ("searched_on", {"split": 3}))
        ),
    ):
        with pytest.raises(ValueError, match=message):
            read_gains(text, "gains.json", "stanley")
    with pytest.raises(ValueError, match="plain names"):
        policies.tuned_gains("../x", "path-following")
    with pytest.raises(policies.NotTuned):
        policies.tuned_gains("lqr", "path-following", "../p3dx")
