"""The tables of a contest from rows made by hand, whose aggregates are known; and episodes rolled out one by one."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from oracles.contest_rows import PATHS, made

from wayfield import policies
from wayfield.benchmarks.commands.contest_report import short_findings
from wayfield.benchmarks.episodes.metrics import measure
from wayfield.benchmarks.episodes.rollout import make_policy, roll_out
from wayfield.benchmarks.leaderboards.terminal import print_short
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.policies.pilot import Pilot

PATH_ID, GOAL_ID = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"


def column(table: Table, name: str) -> dict[str, str]:
    """Returns the cells of a column by policy."""
    at = table.header.index(name)
    return {line[0]: line[at] for line in table.rows}


def run_along(along: Any, errors: Any) -> dict[str, float]:
    """Returns the metrics of a run with these arc lengths and errors, a control period of 0.01 s apart."""
    count = len(along)
    return measure(
        Trajectory(
            times=0.01 * np.arange(count), poses=np.zeros((count, 3)), arc_lengths=along, cross_track_errors=errors,
            heading_errors=errors, references=np.zeros((count, 5)),
        )
    )  # fmt: skip


def test_turning_on_the_spot_is_paid_for() -> None:
    """By the arc length a robot that turns beside the path before it sets off has the error of one that does not."""
    along = np.linspace(0.0, 4.0, 401)
    errors = np.where(np.arange(401) < 100, 0.2, 0.01)
    turn = 300
    waiting = np.concatenate([np.zeros(turn), along]), np.concatenate([np.full(turn, 0.2), errors])
    quick, slow = run_along(along, errors), run_along(*waiting)
    assert slow["cross_track_rms"] == pytest.approx(quick["cross_track_rms"])
    assert slow["acquisition_time"] == pytest.approx(quick["acquisition_time"] + 3.0)
    assert slow["acquisition_area"] == pytest.approx(quick["acquisition_area"] + 0.6)
    # nor has a robot that stands on the path begun to follow it
    standing = run_along(np.concatenate([np.zeros(turn), along]), np.full(turn + 401, 0.01))
    assert standing["acquisition_time"] > 2.0


def test_a_run_says_how_many_of_its_entries_it_shows_and_the_user_s_own_are_among_them() -> None:
    cells = {"success": 1.0, "mean_speed": 0.6, "tracking_rms": 0.001}
    laws = [made(PATHS, f"law_{k}", cells, knows="path") for k in range(5)]
    own = made(PATHS, "mine:Law", cells | {"tracking_rms": 0.05}, gains_name="own gain=2")
    ((sentence, table),) = short_findings(Episodes.of([row for rows in (*laws, own) for row in rows]))
    assert "6 entries (4 shown) on the same" in sentence
    assert [line[0] for line in table.rows] == ["law_0", "law_1", "law_2", "mine:Law (own gain=2)"]


# Episodes one by one.


def alone(case: Case, k: int, seed: int) -> tuple[list[Any], dict[str, Any]]:
    """Returns the states of an episode of one robot, and the info of its last step."""
    env: Any = gymnasium.make(
        case.env_id, scenario=case.scenario, actuators="lagged", max_episode_steps=case.max_episode_steps,
        **case.env_kwargs,
    )  # fmt: skip
    seen, info = env.reset(seed=seed, options={"scenario": k} if case.every_scenario else None)
    pilot = Pilot(policies.make(case.policy, **case.gains), env)
    pilot.reset()
    states = [env.unwrapped.batch.states[0].copy()]
    while True:
        seen, _, terminated, truncated, info = env.step(pilot.command(seen))
        states.append(env.unwrapped.batch.states[0].copy())
        if terminated or truncated:
            return states, info


def wheels_of(env_id: str, vx: float, vy: float, yaw_rate: float) -> list[float]:
    """Returns the speeds (rad/s) of the wheels of the default robot for a twist, by the documents' kinematics."""
    if env_id == PATH_ID:  # document A: r 0.0975 m, half the track 0.1905 m
        return [(vx + side * 0.1905 * yaw_rate) / 0.0975 for side in (1.0, -1.0)]
    found = []
    for place in map(math.radians, (-60.0, 60.0, 180.0)):  # document B: r 0.075 m, 0.3 m out, each drives round
        x, y = 0.3 * math.cos(place), 0.3 * math.sin(place)
        found.append(((vy + yaw_rate * x) * math.cos(place) - (vx - yaw_rate * y) * math.sin(place)) / 0.075)
    return found


@pytest.mark.parametrize(
    ("env_id", "scenario", "policy", "every", "clock"),
    [
        (PATH_ID, "circuits/validation", "pure_pursuit", True, 500),
        (PATH_ID, "random_splines", "pure_pursuit", False, 900),
        (PATH_ID, "circle", "pure_pursuit", False, 150),
        (GOAL_ID, "clutter_5/validation", "waypoint", True, 1200),
    ],
)
def test_every_slot_gives_its_first_episode_and_no_other(
    env_id: str, scenario: str, policy: str, every: bool, clock: int
) -> None:
    """Whenever the others end, and with the seeds one after the other."""
    kwargs = {} if env_id == PATH_ID else {"num_beams": 0}
    case = Case("", "", env_id, scenario, policy, {}, kwargs, clock, every_scenario=every)
    found = roll_out(case, actuators="lagged", seed=7, episodes=4)
    lengths = set()
    for k, each in enumerate(found):
        states, info = alone(case, k, 7 + k)
        lengths.add(len(states))
        np.testing.assert_array_equal(each.poses, [[s["x"], s["y"], s["heading"]] for s in states])
        np.testing.assert_allclose(each.times, 0.05 * np.arange(len(states)), atol=1e-12)
        np.testing.assert_array_equal(each.twists, [[s["vx"], s["vy"], s["yaw_rate"]] for s in states])
        np.testing.assert_array_equal(each.saturated, [float(s["saturated"]) for s in states])
        turned = [wheels_of(env_id, s["wheel_vx"], s["wheel_vy"], s["wheel_yaw_rate"]) for s in states]
        np.testing.assert_allclose(each.wheel_speeds, turned, atol=1e-9)
        assert np.abs(turned).max() > 1.0
        assert each.collision == info["collision"]
        if env_id == PATH_ID:
            assert each.max_speed != each.max_speed  # there is nothing to compare with
            assert each.completion == pytest.approx(info["completion"])
            assert each.success == (info["success"] if scenario != "circle" else info["completion"] >= 0.98)
            assert each.left_corridor == info["left_corridor"]
            for name, column in (
                ("arc_length", each.arc_lengths),
                ("cross_track_error", each.cross_track_errors),
                ("heading_error", each.heading_errors),
            ):
                np.testing.assert_array_equal(column, [s[name] for s in states])
                assert column[-1] == info[name]
        else:
            assert each.success == info["success"]
            assert each.max_speed == pytest.approx(1.7320508, abs=1e-6)  # of omni3's data sheet, along x
            assert each.acceleration == 1.0
            np.testing.assert_array_equal(each.clearances, [s["clearance"] for s in states])
            assert each.clearances[-1] == info["clearance"]
            assert 0.0 < each.shortest < math.dist(each.poses[0, :2], each.goals[-1, :2]) * 2.0
    assert len(lengths) > 1 or scenario == "circle"


def test_laps_without_end_are_a_success_from_98_percent_of_one_on() -> None:
    for clock, success in ((212, False), (213, True)):
        (run,) = roll_out(Case("", "", PATH_ID, "circle", "pure_pursuit", {}, {}, clock), actuators="lagged", seed=7)
        assert run.completion == pytest.approx(0.98, abs=0.004)
        assert run.success == (run.completion >= 0.98) == success


def test_who_acts_at_random_draws_from_the_seed_of_the_run() -> None:
    drawn = [make_policy(Case("", "", PATH_ID, "circle", "random"), seed) for seed in (0, 1, 5)]
    assert [vars(each)["seed"] for each in drawn] == [0, 1, 5]
    first = [roll_out(Case("", "", PATH_ID, "circle", "random", {}, {}, 3), seed=seed)[0].twists for seed in (1, 1, 5)]
    assert (first[0] == first[1]).all()
    assert (first[0] != first[2]).any()


def test_laps_are_completed_one_after_the_other(tmp_path: Any) -> None:
    file = tmp_path / "square.json"
    file.write_text('{"path": [[0, 0], [2, 0], [2, 2], [0, 2]], "closed": true, "laps": 3}')
    case = Case("", "", PATH_ID, str(file), "pure_pursuit", max_episode_steps=300)
    (run,) = roll_out(case, actuators="lagged")
    found = measure(run)
    # 15 s at 0.6 m/s of three laps of 8 m
    assert found["completion"] == pytest.approx(found["path_length"] / 24.0, rel=0.1)
    assert 0.3 < found["completion"] < 0.45


@pytest.mark.parametrize("width", [60, 80, 100, 200])
def test_the_short_report_keeps_every_cell_within_the_terminal(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    cells = ["regulated_pure_pursuit (tuned)", "100.0 [98.1, 100.0]", "0.0112 [0.0101, 0.0123]", "0.62", "first"]
    header = ["policy", "success (%)", "RMS error (m)", "speed (m/s)", "verdict"]
    print_short([("Nobody knows who wins. " * 9, Table("", header, [cells], ""))])
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= min(width, 100)
    assert printed.count("Nobody") == 9
    if width >= 80:
        assert set(" ".join(cells).split()) <= set(printed.split())
    assert ("0.0112 [0.0101, 0.0123]" in printed) == (width >= 100)
