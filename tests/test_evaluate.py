"""The evaluate command: what it writes, that it repeats, and how it refuses."""

import csv
import math
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.contests import CONTESTS, OF_KIND
from wayfield.benchmarks.entrants.documents import documents
from wayfield.benchmarks.entrants.own_scenario import POLICIES
from wayfield.benchmarks.episodes.metrics import METRICS, measure
from wayfield.benchmarks.episodes.rollout import roll_out
from wayfield.benchmarks.leaderboards.document_tables import ranked
from wayfield.benchmarks.records.results import read_rows, read_trajectories
from wayfield.benchmarks.report.page import BUDGET

OF_EVERY_RUN = ("run.json", ".lock", "report.html", "drives.npz", "worlds.json")
CIRCUITS = Path(__file__).parents[2] / "shared" / "data" / "tum_racetracks"


def evaluate(*arguments: object) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(main, ["--workers", "1", "--full", *map(str, arguments)])


@pytest.fixture(scope="module")
def lookahead(tmp_path_factory):
    """The suite's cases of three policies, on the kinematic plant: (folder, result)."""
    out = tmp_path_factory.mktemp("run") / "deep" / "results"
    arguments = ("--policies", "lookahead_documented,waypoint,apf_corrected", "--dynamics", "kinematic")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wayfield.benchmarks.figures.document_figures.draw", len)  # as long as all the rest
        return out, evaluate(*arguments, "--out", out)


def test_it_writes_every_file_and_says_where(lookahead):
    out, result = lookahead
    assert result.exit_code == 0, result.output
    names = {file.name for file in out.iterdir()}
    assert names == {"episodes.csv", "table.md", "trajectories.npz", *OF_EVERY_RUN}
    assert str(out) in result.stdout.splitlines()[-1]
    assert all((out / name).stat().st_size > 0 for name in names - {".lock"})
    assert [file.name for file in out.parent.iterdir()] == ["results"]  # no staging folder is left


@pytest.mark.usefixtures("undrawn")
def test_by_default_it_prints_little_and_names_the_report_last(tmp_path):
    words = ["--workers", "1", "--policies", "zero", "--dynamics", "kinematic", "--out", str(tmp_path)]
    run = CliRunner().invoke(main, [*words, "--episodes", "2", "--seed", "7"])
    assert run.exit_code == 0, run.output
    lines = run.stdout.splitlines()
    assert len(lines) <= 40
    # several episodes have a spread and an interval
    assert "0/2 [0.00, 0.84]" in (tmp_path / "table.md").read_text()
    assert {row["seed"] for row in read_rows(tmp_path)} == {7, 8}
    assert all(len(line) <= 100 or str(tmp_path) in line for line in lines)
    assert lines[-1] == f"Report: {tmp_path / 'report.html'}"
    assert (tmp_path / "report.html").stat().st_size < BUDGET


@pytest.mark.slow
def test_the_overview_is_told_in_thirty_lines_of_a_terminal(tmp_path):
    run = CliRunner(env={"COLUMNS": "80"}).invoke(main, ["--workers", "2", "--out", str(tmp_path)])
    assert run.exit_code == 0, run.output
    lines = run.stdout.splitlines()
    assert len(lines) <= 30, run.stdout
    assert all(len(line) <= 80 or str(tmp_path) in line for line in lines)
    for contest in CONTESTS.values():
        assert any(line.startswith(contest.spec.title) for line in lines)
    assert str(tmp_path) in lines[-1]
    assert (tmp_path / "report.html").stat().st_size <= BUDGET


def test_it_prints_a_table_for_each_document(lookahead):
    out, result = lookahead
    for title in ("Document A", "Document B", "Document C"):
        assert title in result.stdout
        assert title in (out / "table.md").read_text()
    assert "0.145 / 0.144" in result.stdout
    assert "2.95 / 2.95" in result.stdout
    assert "Traceback" not in result.output


def test_rows_are_complete_and_agree_with_the_trajectories(lookahead):
    out, _ = lookahead
    rows = read_rows(out)
    trajectories = read_trajectories(out)
    wanted = [case for case in documents() if case.policy in ("lookahead_documented", "waypoint", "apf_corrected")]
    assert len(rows) == len(trajectories) == len(wanted)
    for row in rows:
        assert {column.name for column in METRICS} <= set(row)
        assert sum(row[name] for name in ("success", "collision", "left_corridor", "timeout")) == 1
        radius = row["arrival_radius"]
        again = measure(trajectories[row["trajectory"]], None if math.isnan(radius) else radius)
        for name, value in again.items():
            assert row[name] == pytest.approx(value, nan_ok=True), name
        assert math.isnan(row["cross_track_rms"]) == (row["contest"] != "A")


def test_a_second_run_gives_the_same_rows_and_figures_of_them(lookahead, tmp_path):
    out, _ = lookahead
    assert evaluate("--policies", "waypoint", "--dynamics", "kinematic", "--out", tmp_path).exit_code == 0
    figures = [tmp_path / f"document_b_waypoints.{suffix}" for suffix in ("svg", "png")]
    assert all(file.stat().st_size > 0 for file in figures)
    assert {file.name for file in tmp_path.iterdir()} == {
        *(file.name for file in out.iterdir()),
        *(file.name for file in figures),
    }
    first, second = read_rows(out).where(policy="waypoint"), read_rows(tmp_path)
    assert {*first.names} >= {*second.names}
    for name in {*second.names} - {"trajectory"}:
        np.testing.assert_array_equal(first[name], second[name])


@pytest.mark.parametrize(
    ("experiment", "policy", "tolerance"),
    [
        ("circle, R 0.5 m", "lookahead_documented", 0.01),
        ("circle, R 1 m", "lookahead_documented", 0.01),
        ("S-curve, 3 m", "lookahead_documented", 0.01),
        ("figure of eight", "lookahead_documented", 0.01),
        ("1: to a pose", "waypoint", 0.001),
        ("2: waypoints", "waypoint", 0.02),
    ],
)
def test_reference_solutions_are_met(lookahead, experiment, policy, tolerance):
    rows = read_rows(lookahead[0])
    cases = [case for case in documents() if (case.family, case.policy) == (experiment, policy)]
    assert cases
    for case in cases:
        (row,) = [row for row in rows if (row["family"], row["gains"]) == (experiment, case.gains_text)]
        for name, figure in case.reference.items():
            assert row[name] == pytest.approx(figure, rel=tolerance), name


def test_episodes_are_paired_by_seed():
    (case,) = [case for case in documents() if case.scenario == "apf_1" and "stop_radius" in case.gains]
    together = roll_out(case, seed=3, episodes=2)
    assert not np.array_equal(together[0].poses, together[1].poses)
    (alone,) = roll_out(case, seed=4)
    np.testing.assert_array_equal(together[1].poses, alone.poses)


def written(file, text):
    file.write_text(text)
    return file


@pytest.fixture
def bend(tmp_path):
    """A path file with one bend."""
    return written(tmp_path / "bend.csv", "x,y\n0,0\n2,0\n3,1\n")


def test_a_path_of_ones_own(bend, tmp_path):
    out = tmp_path / "out"
    result = evaluate("--path", bend, "--out", out)
    assert result.exit_code == 0, result.output
    assert {file.name for file in out.iterdir()} == {
        *("episodes.csv", "table.md", "trajectories.npz", "path_trajectories.svg", "path_trajectories.png"),
        *("path_errors.svg", "path_errors.png", *OF_EVERY_RUN),
    }
    by_policy = {(row["policy"], row["dynamics"]): row for row in read_rows(out)}
    assert len(by_policy) == len(POLICIES["path"])
    assert {row["actuators"] for row in by_policy.values()} == {"lagged"}  # as in contests
    assert by_policy["lookahead_retuned", "kinematic"]["success"] == 1.0
    assert by_policy["zero", "kinematic"]["timeout"] == 1.0


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("option", ["--path", "--scenarios"])
def test_a_short_table_shows_all_policies_that_are_named(option, bend, tmp_path):
    names = ("pure_pursuit", "regulated_pure_pursuit", "stanley", "lqr", "mpc", "lookahead_retuned", "polar")
    names = tuple(name for name in names if name in POLICIES["path"] and name in OF_KIND["path"].policies)
    words = [option, bend if option == "--path" else bend.parent, "--policies", ",".join(names), "--workers", 1]
    result = CliRunner().invoke(main, [*map(str, words), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    printed = " ".join(line.partition("  ")[0] for line in result.output.splitlines())
    assert all(name in printed for name in names)
    if option == "--path":
        assert "one scenario, lagged actuators" in " ".join(result.output.split())
        assert "kinematic" in result.output


@pytest.fixture
def goal(tmp_path):
    """A goal scenario with a post on the way."""
    post = '{"kind": "circle", "x": 1, "y": 0.1, "radius": 0.1}'
    return written(tmp_path / "gööl.json", f'{{"goal": [2, 0, 0], "obstacles": [{post}]}}')


def test_a_goal_scenario_of_ones_own(goal, tmp_path):
    out = tmp_path / "out"
    result = evaluate(
        "--path", goal, "--policies", "scan_planner,zero", "--dynamics", "kinematic", "--episodes", 2, "--out", out
    )
    assert result.exit_code == 0, result.output
    figures = {"goal_trajectories.svg", "goal_trajectories.png"}
    assert {file.name for file in out.iterdir()} == {"episodes.csv", "table.md", "trajectories.npz", *figures} | {
        *OF_EVERY_RUN
    }
    rows = read_rows(out)
    assert [(row["policy"], row["success"]) for row in rows] == [
        *[("scan_planner", 1.0)] * 2,
        *[("zero", 0.0)] * 2,
    ]
    assert {row["family"] for row in rows} == {"gööl"}
    assert "Goal: gööl" in result.stdout
    # twice the distance in a straight line is long enough a clock for who drives, and ends who does not
    assert rows[2]["time"] >= 2.0 / 0.25


def test_a_dock_of_ones_own(tmp_path):
    file, out = tmp_path / "my dock.json", tmp_path / "out"
    post = '{"kind": "circle", "x": 3, "y": 2, "radius": 0.1}'
    file.write_text(f'{{"dock": [1.2, 0.4, 0.3], "obstacles": [{post}]}}')
    result = evaluate("--path", file, "--policies", "polar,zero", "--dynamics", "kinematic", "--out", out)
    assert result.exit_code == 0, result.output
    figures = {"dock_trajectories.svg", "dock_trajectories.png"}
    assert {each.name for each in out.iterdir()} == {"episodes.csv", "table.md", "trajectories.npz", *figures} | {
        *OF_EVERY_RUN
    }
    docked = read_rows(out)[0]
    assert (docked["policy"], docked["success"]) == ("polar", 1.0)
    assert max(docked["final_position_error"], docked["final_heading_error"]) <= 0.05
    shown = (out / "table.md").read_text()
    assert "Dock: my dock" in shown
    for column in ("final error (m)", "time (s)", "driven (m)", "changes of direction", "least clearance (m)"):
        assert column in shown


def test_a_reference_of_ones_own(tmp_path):
    file, out = tmp_path / "mine.json", tmp_path / "out"
    file.write_text('{"reference": [[0, 0], [1, 0.3], [2, 0]], "times": [0, 5, 10], "start": [0.1, 0.1, 0]}')
    result = evaluate("--path", file, "--policies", "samson,tv_lqr", "--out", out)
    assert result.exit_code == 0, result.output
    assert all((out / f"reference_{name}.svg").is_file() for name in ("trajectories", "errors"))
    assert "Reference: mine" in (out / "table.md").read_text()
    assert "does best: RMS error after 10 s 0.000" in ranked(read_rows(out))[0]


@pytest.mark.usefixtures("undrawn")
def test_several_runs_of_a_path_of_ones_own_are_told_as_runs_and_not_as_policies(tmp_path):
    (tmp_path / "mine.json").write_text('{"path": [[0, 0], [3, 0]], "start_offset": 0.1}')
    words = ["--path", tmp_path / "mine.json", "--policies", "lqr,zero", "--dynamics", "both"]
    result = evaluate(*words, "--episodes", 3, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    sentence, table = ranked(read_rows(tmp_path / "out"))
    assert sentence.startswith("mine: 2 policies, one scenario, ")
    assert sentence.endswith(" 3 runs each, the best run counts.")
    named = sorted(line[0] for line in table.rows)
    assert named == sorted(f"{policy}, seed {k}" for policy in ("lqr", "zero") for k in range(3) for _ in range(2))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.skipif(os.name != "posix", reason="names are no bytes there")
def test_a_name_that_is_no_text_is_shown_as_it_can(goal, tmp_path):
    odd = tmp_path / os.fsdecode(b"g\xf6l.json")
    odd.write_bytes(goal.read_bytes())
    result = evaluate("--path", odd, "--policies", "scan_planner", "--dynamics", "kinematic", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert {row["family"] for row in read_rows(tmp_path / "out")} == {r"g\xf6l"}


@pytest.mark.usefixtures("undrawn")
def test_scale_takes_numbers_and_ratios(bend, tmp_path):
    lengths = []
    for scale in ("0.5", "1:2"):
        out = tmp_path / scale.replace(":", "-")
        arguments = ("--policies", "lookahead_retuned", "--dynamics", "kinematic", "--scale", scale)
        assert evaluate("--path", bend, *arguments, "--out", out).exit_code == 0
        (row,) = read_rows(out)
        lengths.append(row["path_length"])
    assert lengths[0] == lengths[1] == pytest.approx(0.5 * (2.0 + math.sqrt(2.0)), rel=0.1)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.skipif(not CIRCUITS.exists(), reason=f"{CIRCUITS} is absent")
def test_a_real_circuit(tmp_path):
    file = CIRCUITS / "BrandsHatch.csv"
    arguments = ("--policies", "lookahead_retuned", "--dynamics", "kinematic")
    result = evaluate("--path", file, "--scale", "1:50", *arguments, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    (row,) = read_rows(tmp_path)
    assert row["success"] == 1.0
    assert row["cross_track_rms"] < 0.05


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--policies", "lookahead_documentd"), "Did you mean 'lookahead_documented'?"),
        (("--policies", "lqr,mine.zip"), "your own is --policy mine.zip"),
        (("--path", ""), "--path is empty"),
        (("--path", "BEND", "--suite", "documents"), "--path takes the place of --suite"),
        (("--path", "GOAL", "--scale", "2"), "--scale belongs to paths"),
        (("--path", "SHUT"), "shut.json"),
        (("--path", "BEND", "--scale", "0"), "--scale"),
        (("--path", "BEND", "--policies", "waypoint"), "'waypoint' does not follow a path"),
        (("--path", "BROKEN"), "broken.csv:3"),
    ],
)
def test_wrong_input_is_answered_in_one_line(arguments, expected, bend, goal, tmp_path):
    broken = tmp_path / "broken.csv"
    broken.write_text("x,y\n0,0\n1,north\n")
    out = tmp_path / "out"
    out.mkdir()
    (out / "episodes.csv").write_text("precious")
    shut = tmp_path / "shut.json"
    shut.write_text('{"goal": [1, 0, 0], "obstacles": [{"kind": "circle", "x": 1, "y": 0, "radius": 0.5}]}')
    files = {"BEND": bend, "BROKEN": broken, "GOAL": goal, "SHUT": shut}
    result = evaluate("--out", out, *(files.get(each, each) for each in arguments))
    assert result.exit_code == 2
    assert len(result.stderr.splitlines()) == 1
    assert expected in result.stderr
    assert result.stdout == ""
    assert [(file.name, file.read_text()) for file in out.iterdir()] == [("episodes.csv", "precious")]


def test_an_impossible_folder_is_refused_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.setattr("wayfield.benchmarks.commands.evaluate.run", lambda *_: pytest.fail("it ran"))
    file = tmp_path / "file"
    file.write_text("precious")
    taken = tmp_path / "taken"
    (taken / "episodes.csv").mkdir(parents=True)
    for out in (file, file / "below", taken, "/proc/wayfield"):
        result = evaluate("--suite", "documents", "--out", out)
        assert result.exit_code == 1, out
        assert len(result.stderr.splitlines()) == 1
        assert "--out" in result.stderr
    assert file.read_text() == "precious"


def test_rows_are_plain_csv(lookahead):
    with open(lookahead[0] / "episodes.csv", newline="") as file:
        lines = list(csv.reader(file))
    assert len({len(line) for line in lines}) == 1
    assert "nan" not in {cell for line in lines for cell in line}
