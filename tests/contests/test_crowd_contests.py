"""The contests of several bodies: their metrics on worlds made by hand, and whole commands."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.episodes.crowds import PERSON, ROBOT, World, measured
from wayfield.benchmarks.records.trajectory import Trajectory

DT = 0.1


def straight(seconds: float, speed: float, y: float = 0.0, success: bool = True, shortest: float = 4.0) -> Trajectory:
    """Returns a robot that drives along x, asked for 1 m/s."""
    times = DT * np.arange(round(seconds / DT) + 1)
    poses = np.column_stack([speed * times, np.full(len(times), y), np.zeros(len(times))])
    twists = np.tile((speed, 0.0, 0.0), (len(times), 1))
    return Trajectory(
        times,
        poses,
        twists,
        np.zeros((len(times), 2)),
        np.zeros(len(times)),
        success=success,
        collision=False,
        max_speed=1.0,
        shortest=shortest,
    )


def world(robots: list[Trajectory], **fields: Any) -> World:
    n, steps = len(robots), max(len(each.times) for each in robots)
    usual: dict[str, Any] = {
        "touched": np.zeros(n, np.int64),
        "caused": np.zeros(n, np.bool_),
        "straight": np.full(n, 4.0),
        "gaps": tuple(np.full(len(each.times) - 1, 1.0) for each in robots),
        "people": np.empty((steps, 0, 5)),
        "alone": np.empty((steps, 0, 5)),
        "radii": np.empty(0),
        "hull_radius": 0.2,
    }
    return World(tuple(robots), **(usual | fields))


def test_a_team_that_arrives_is_measured_as_by_hand() -> None:
    found = measured(world([straight(4.0, 1.0), straight(8.0, 0.5)], width=0.5))
    assert found["success"] == found["arrived"] == 1.0
    assert found["time"] == pytest.approx(8.0)  # the last
    assert found["extra_time"] == pytest.approx(0.5 * (0.0 + 4.0))
    assert found["extra_time_p75"] == pytest.approx(3.0)
    assert found["extra_time_p90"] == pytest.approx(3.6)
    assert found["makespan_ratio"] == pytest.approx(2.0)
    assert found["flow_rate"] == pytest.approx(2.0 / (0.5 * 8.0))
    assert found["fairness"] == pytest.approx(1.5**2 / (2.0 * 1.25))  # Jain, of 1 and 1/2
    assert found["spl"] == 1.0
    assert found["mean_speed"] == pytest.approx(0.75)


def test_who_touches_or_stands_fails_the_world_and_alone_is_counted() -> None:
    robots = [straight(4.0, 1.0), straight(20.0, 0.0, success=False), straight(2.0, 1.0, success=False)]
    hit = {"touched": np.array([0, 0, ROBOT]), "caused": np.array([False, False, True])}
    found = measured(world(robots, **hit))
    assert (found["success"], found["collision"], found["timeout"]) == (0.0, 1.0, 0.0)
    shares = {name: found[name] for name in ("arrived", "touched_robot", "caused", "stuck")}
    assert shares == dict.fromkeys(shares, pytest.approx(1.0 / 3.0))
    assert found["deadlock"] == 1.0  # the only one that the clock ended
    assert found["fairness"] == pytest.approx(1.0 / 3.0)
    assert math.isnan(found["makespan_ratio"])
    # one that crawls is late, not stuck
    assert measured(world([straight(20.0, 0.02, success=False)]))["stuck"] == 0.0
    halves = measured(world(robots, mine=np.array([True, False, False]), **hit))
    assert (halves["arrived"], halves["arrived_beside"]) == (1.0, 0.0)


def test_how_near_people_are_come_to_and_what_it_costs_them() -> None:
    robot = straight(4.0, 1.0)
    count = len(robot.times)
    # one stands 0.5 m beside the way at x = 2, another walks ahead of the robot at its speed, 1 m before it
    people = np.zeros((count, 2, 5))
    people[:, 0] = (2.0, 0.5, 0.0, 0.0, 1.0)
    people[:, 1] = (0.0, 0.0, 1.0, 0.0, 1.0)
    people[:, 1, 0] = robot.poses[:, 0] + 1.0
    alone = people.copy()
    alone[:, 1, 2] = 1.2
    found = measured(world([robot], people=people, alone=alone, radii=np.array([0.2, 0.2])))
    assert found["least_gap_people"] == pytest.approx(0.1)
    away = np.minimum(np.hypot(robot.poses[:, 0] - 2.0, 0.5), 1.0) - 0.4
    assert found["intimate_share"] == pytest.approx((away < 0.45).mean())
    assert found["close_share"] == pytest.approx((away < 0.5).mean())
    assert found["personal_share"] == 1.0
    assert found["danger_share"] == pytest.approx((away < 0.2).mean())
    assert found["people_slowed"] == pytest.approx(0.1)
    assert found["intrusion"] == 0.0  # the one ahead goes on, the other stands aside
    coming = people.copy()
    coming[:, 1, 0] = 4.0 - robot.times  # they meet at x = 2 after 2 s: places within 0.4 m of each other
    inside = measured(world([robot], people=coming, alone=alone, radii=np.array([0.2, 0.2])))["intrusion"]
    # from 1.25 s before the person is within 0.4 m of where the robot is, until it has left
    meets = [abs(4.0 - (t + k * DT) - t) < 0.4 for t in robot.times for k in range(1, 13)]
    expected = np.array(meets).reshape(count, 12)
    late = robot.times[:, None] + DT * np.arange(1, 13) > robot.times[-1] + 1e-9
    assert inside == pytest.approx((expected & ~late).any(axis=1).mean(), abs=1.5 / count)
    assert measured(world([robot], touched=np.array([PERSON])))["touched_person"] == 1.0
    # a person on the robot's line, 0.9 m before it all the time: between hulls 0.5 m
    ahead = np.zeros((count, 1, 5))
    ahead[:, 0] = (0.0, 0.0, -1.0, 0.0, 1.0)
    ahead[:, 0, 0] = robot.poses[:, 0] + 0.9
    found = measured(world([robot], people=ahead, alone=ahead, radii=np.array([0.2])))
    assert found["intrusion"] == 0.0
    assert math.isnan(found["intrusion_gap"])
    ahead[:, 0, 0] = 2.03  # it stands in the way: the robot is in its place where it is within 0.4 m of it
    found = measured(world([robot], people=ahead, alone=ahead, radii=np.array([0.2])))
    near = np.abs(robot.poses[:-1, 0] - 2.03)
    assert found["intrusion_gap"] == pytest.approx((near[near < 0.4] - 0.4).mean())


def test_how_much_later_people_come_is_counted_to_their_goals() -> None:
    robot = straight(4.0, 1.0)
    count = len(robot.times)
    people = np.zeros((count, 3, 5))
    people[:, :, 4] = 1.0
    people[:, :, 1] = (5.0, 6.0, 7.0)
    alone = people.copy()
    for k, (slower, speed) in enumerate(((0.8, 1.0), (0.5, 1.0), (0.1, 1.0))):
        people[:, k, 0], alone[:, k, 0] = slower * robot.times, speed * robot.times
    # goals 1.7 m on are reached within 0.2 m, after 1.5 m: 1.875 and 3 s beside 1.5 s; the third is not there in 4 s
    goals = np.array([(1.7, 5.0), (1.7, 6.0), (1.7, 7.0)])
    given = {"people": people, "alone": alone, "radii": np.full(3, 0.2 + 1e-9)}
    found = measured(world([robot], people_goals=goals, **given))["people_extra_time"]
    assert found == pytest.approx(0.5 * (0.4 + 1.5))  # in whole steps of 0.1 s
    assert math.isnan(measured(world([robot], **given))["people_extra_time"])
    # who leaves at the goal is there no more
    people[16:, 0, 4] = 0.0
    found = measured(world([robot], people_goals=goals, **given))["people_extra_time"]
    assert found == pytest.approx(0.5 * (0.1 + 1.5))


def evaluate(*options: object) -> Any:
    return CliRunner().invoke(main, list(map(str, options)))


def rows_of(folder: Path) -> list[dict[str, str]]:
    with open(folder / "episodes.csv", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_contest_of_teams_says_who_suffers_from_whom(tmp_path: Path) -> None:
    small = ("--families", "crossing_2", "--policies", "polar,orca_team", "--gains", "default", "--episodes", 3)
    done = evaluate("--suite", "teams", "--cross", *small, "--workers", 1, "--out", tmp_path / "a", "--full")
    assert done.exit_code == 0, done.output
    assert "who suffers from whom" in done.output
    rows = rows_of(tmp_path / "a")
    assert len(rows) == 3 * 4  # each alone, and each beside the other
    for row in rows:
        assert (float(row["success"]) == 1.0) == (float(row["arrived"]) == 1.0 and row["arrived_beside"] in ("", "1"))
    crossed = {row["gains_name"]: float(row["arrived"]) for row in rows if row["contest"] == "teams-cross"}
    assert set(crossed) == {"beside polar", "beside orca_team"}
    matrix = (tmp_path / "a" / "teams_p3dx_matrix.csv").read_text(encoding="utf-8")
    assert "beside polar" in matrix
    assert (tmp_path / "a" / "report.html").is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_contest_among_people_meets_them_with_eyes_and_without(tmp_path: Path) -> None:
    small = ("--policies", "polar,orca_team", "--gains", "default", "--episodes", 3, "--workers", 1, "--full")
    done = evaluate("--suite", "people", "--families", "head_on", *small, "--out", tmp_path / "a")
    assert done.exit_code == 0, done.output
    rows = rows_of(tmp_path / "a")
    assert {row["contest"] for row in rows} == {"people-unseen", "people-seen"}
    unseen = [row for row in rows if row["contest"] == "people-unseen"]
    assert all(abs(float(row["people_slowed"])) < 1e-12 for row in unseen)  # who does not see it walks as without it
    assert any(abs(float(row["people_slowed"])) > 1e-6 for row in rows if row["contest"] == "people-seen")
    assert (tmp_path / "a" / "people_p3dx_matrix.csv").is_file()
    done = evaluate("--suite", "crowdnav", "--robot", "omni3", *small, "--out", tmp_path / "b")
    assert done.exit_code == 0, done.output
    assert {row["contest"] for row in rows_of(tmp_path / "b")} == {"crowdnav", "crowdnav-seen"}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--suite", "docking", "--cross"), "--cross belongs to --suite teams"),
        (("--suite", "teams", "--people", "orca"), "--people belongs to --suite people"),
        (("--suite", "crowdnav", "--families", "lanes_12"), "--families belongs to suites of frozen scenarios"),
        (("--suite", "people", "--policies", "lqr"), "--policies 'lqr' takes no part in suite 'people'"),
    ],
)
def test_what_does_not_go_together_is_refused_in_a_line(options: tuple[str, ...], said: str, tmp_path: Path) -> None:
    done = evaluate(*options, "--out", tmp_path / "a")
    assert done.exit_code == 2
    assert said in done.stderr
    assert not (tmp_path / "a").exists()
