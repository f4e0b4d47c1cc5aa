"""From a robot without an agent to a report of one that was trained: one command after another, as a user runs them."""

import csv
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

pytest.importorskip("stable_baselines3", reason='needs pip install "wayfield[train]"')

import interval_coverage
import throughput
from PIL import Image

from wayfield.benchmarks.commands import evaluate
from wayfield.benchmarks.figures import video
from wayfield.benchmarks.recordings import record
from wayfield.benchmarks.records.results import read_rows
from wayfield.benchmarks.report import __main__ as report
from wayfield.benchmarks.runs import decisions
from wayfield.policies.learned.agent import load_agent
from wayfield.policies.training import command as train
from wayfield.policies.training import offline

PATH = "wayfield/DiffDrivePathFollowing-v0"
TINY = ["num_envs=64", "horizon=8", "batch_size=64", "epochs=1", "hidden=8", "validations=1"]
SMALL = ["--families", "circles", "--episodes", "2", "--policies", "pure_pursuit", "--gains", "default"]


def run(command: Any, *words: object) -> str:
    """Returns what a command says that ends well."""
    done = CliRunner().invoke(command, [str(each) for each in words])
    assert done.exit_code == 0, done.output
    return done.output


def driven(agents: Path, out: Path) -> list[Any]:
    """Returns the rows of a contest in the test split, in which agents of one's own take part."""
    words = ["--suite", "path-following", *SMALL, "--agents", agents, "--workers", "1", "--out", out]
    said = run(evaluate.main, *words)
    assert said.splitlines()[-1] == f"Report: {out / 'report.html'}"
    return [row for row in read_rows(out) if row["split"] == "test"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_an_agent_is_trained_driven_reported_and_filmed(tmp_path: Path) -> None:
    agents, out = tmp_path / "mine", tmp_path / "out"
    words = [PATH, "--preset", "path_following_plain", *(each for k in TINY for each in ("--set", k)), "--out", agents]
    run(train.main, *words, "--steps", "1024")
    card = load_agent(agents / "seed_0" / "best").card
    assert card["training"]["steps"] == 1024
    refused = CliRunner().invoke(train.main, [str(each) for each in (*words, "--steps", "1024")])
    assert (refused.exit_code, refused.output.count("\n")) == (2, 1)
    run(train.main, *words, "--steps", "1024", "--resume")  # which is done
    assert load_agent(agents / "seed_0" / "best").card["sha256"] == card["sha256"]
    rows = driven(agents, out)
    assert {(row["policy"], row["gains_name"]) for row in rows} == {("pure_pursuit", "default"), ("ppo", "mine")}
    assert all(row["time"] > 0.0 for row in rows)
    with open(out / "path_following_p3dx.csv", newline="") as file:
        assert {line["policy"] for line in csv.DictReader(file)} == {"pure_pursuit", "ppo"}
    page = (out / "report.html").read_bytes()
    (out / "report.html").unlink()
    run(report.main, out)
    assert len((out / "report.html").read_bytes()) == pytest.approx(len(page), rel=0.05)
    film = tmp_path / "way.png"
    run(video.main, PATH, "--policy", f"ppo home={agents}", "--seconds", "2", "--size", "300", "--out", film)
    assert max(Image.open(film).size) == 300


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_what_a_controller_drove_is_recorded_learned_from_and_driven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    course = ["--suite", "path-following", "--family", "circles", "--episodes", "3", "--dataset", "laps-v0"]
    run(record.main, "pure_pursuit", *course)
    agents = tmp_path / "copied"
    run(offline.main, "bc", tmp_path / "sets" / "laps-v0", "--gradient-steps", "100", "--out", agents)
    rows = driven(agents, tmp_path / "out")
    assert {row["policy"] for row in rows} == {"pure_pursuit", "ppo"}


def test_decisions_are_timed_alone_and_side_by_side() -> None:
    said = run(decisions.main, "--policies", "stanley", "--rounds", "1")
    lines = [line.replace("│", " ").split() for line in said.splitlines() if "stanley" in line]
    assert [line[1] for line in lines] == ["1", "256"]
    alone, beside = (float(line[2].replace(",", "")) for line in lines)
    assert beside > alone > 0.0


@pytest.mark.slow
def test_steps_are_counted_beside_cartpole_s() -> None:
    said = run(throughput.main, "--rounds", "1", "--seconds", "0.02")
    lines = [[cell.strip() for cell in line.split("│")[1:-1]] for line in said.splitlines() if line.startswith("│")]
    rates = {(name, robots): float(rate.replace(",", "")) for name, robots, rate, _ in lines if robots.isdigit()}
    assert all(rate > 0.0 for rate in rates.values())
    of_cartpole = rates["CartPole-v1", "64"]
    for _, robots, rate, share in lines:
        if robots == "64":
            assert float(share) == pytest.approx(float(rate.replace(",", "")) / of_cartpole, abs=0.006)


@pytest.mark.slow
def test_intervals_are_counted_that_hold_what_they_should(tmp_path: Path) -> None:
    run(interval_coverage.main, "--simulations", "10", "--workers", "1", "--out", tmp_path)
    (file,) = tmp_path.glob("*.csv")
    with open(file, newline="") as stream:
        _, *lines = csv.reader(stream)
    assert len(lines) > 20
    shares = [float(cell.split()[0]) for line in lines for cell in line if "[" in cell]
    assert len(shares) == len(lines)
    assert all(share in range(0, 101, 10) for share in shares)
    assert sum(shares) / len(shares) > 90.0
