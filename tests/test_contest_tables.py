"""The tables of a contest from rows made by hand, whose aggregates are known; and episodes rolled out one by one."""

import dataclasses
import math
import re
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
import rich.console

from wayfield import policies
from wayfield.benchmarks.aggregates import counted_interval, interval, iqm
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.contests.path_following import BAR
from wayfield.benchmarks.crossed import exact_interval
from wayfield.benchmarks.disclosure import disclosed
from wayfield.benchmarks.evaluate import _print as print_all
from wayfield.benchmarks.metrics import measure
from wayfield.benchmarks.parts import in_frames
from wayfield.benchmarks.report.findings import found
from wayfield.benchmarks.results import Row
from wayfield.benchmarks.rollout import make_policy, roll_out
from wayfield.benchmarks.standings import contest_tables, front_points
from wayfield.benchmarks.table import Table
from wayfield.benchmarks.terminal import print_short
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.briefing import KNOWS
from wayfield.policies.pilot import Pilot

PATHS, GOALS = "path-following", "goal-obstacles"
PATH_ID, GOAL_ID = "wayfield/DiffDrivePathFollowing-v0", "wayfield/OmniGoalObstacles-v0"
COUNT = 8  # scenarios of each of two families


def made(contest: str, policy: str, cells: dict[str, Any], split: str = "test", **more: str) -> list[Row]:
    """Returns a row for each of 2 x COUNT scenarios; cells: numbers by metric, one a scenario or one for all."""
    found = []
    for k in range(2 * COUNT):
        family = ("wide", "narrow")[k // COUNT]
        row = {
            "suite": "x", "contest": contest, "family": family, "scenario": f"{family}/{split}", "robot": "p3dx",
            "disturbance": "none", "policy": policy, "gains_name": "default", "gains": "", "dynamics": "kinematic",
            "actuators": "lagged", "seed": str(k), "episode": str(k % COUNT), "split": split,
            "tier": ("easy", "medium", "hard")[k % 3], "speed": "", "agent_seed": "",
            "knows": "sensors", "parameters": "", "learned_from": "",
            "failure_cost": "1.0" if contest == PATHS else "60.0",
        }  # fmt: skip
        values = {name: np.broadcast_to(np.asarray(each, float), 2 * COUNT)[k] for name, each in cells.items()}
        found.append(row | {name: repr(float(each)) for name, each in values.items()} | more)
    return found


def column(table: Table, name: str) -> dict[str, str]:
    """Returns the cells of a column by policy."""
    at = table.header.index(name)
    return {line[0]: line[at] for line in table.rows}


def numbers(cell: str) -> list[float]:
    return [
        float(part) for part in cell.replace("[", " ").replace("]", " ").replace(",", " ").replace("|", " ").split()
    ]


WON = np.array([1, 1, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 1, 1.0])
ERRORS = np.array([3, 1, 4, 0.5, 5, 9, 2, 6, 5, 3, 5, 8, 9, 140, 9, 3]) / 100.0
TIMES = np.array([30, 11, 42, 6, 55, 9, 21, 16, 15, 33, 25, 18, 49, 5, 29, 31.0])
STRATA = ["wide"] * COUNT + ["narrow"] * COUNT


def ends(values: Any, statistic: Any) -> tuple[float, float]:
    found = interval(values, STRATA, statistic)
    assert found is not None
    return found


def counted(values: Any) -> tuple[float, float]:
    found = counted_interval(values, WON, 60.0, STRATA)
    assert found is not None
    return found


def test_a_failed_run_counts_as_the_corridor_or_the_whole_clock_and_means_are_interquartile() -> None:
    cells = {"success": WON, "cross_track_rms": ERRORS, "time": TIMES, "mean_speed": TIMES / 60, "faults": TIMES}
    rows = made(PATHS, "pure_pursuit", cells | {"saturated_share": TIMES / 100})
    table = contest_tables(rows, [], "x", False)["path_following_p3dx"]
    costs = np.where(WON == 1.0, ERRORS, 1.0)
    assert numbers(column(table, "RMS error (m)")["pure_pursuit"]) == pytest.approx([costs.mean()], abs=6e-5)
    low, high = ends(costs, iqm)
    shown = numbers(column(table, "typical (m)")["pure_pursuit"])
    assert shown == pytest.approx([float(iqm(costs)), low, high], abs=6e-5)
    # of the successes alone
    assert numbers(column(table, "time (s)")["pure_pursuit"]) == pytest.approx(
        [float(iqm(TIMES[WON == 1.0]))], abs=0.06
    )
    # plain means of counts and shares
    assert numbers(column(table, "faults")["pure_pursuit"]) == pytest.approx([TIMES.mean()], abs=6e-3)
    assert numbers(column(table, "saturated (%)")["pure_pursuit"]) == pytest.approx([TIMES.mean()], abs=0.06)
    low, high = exact_interval(14 / 16, 16)
    assert numbers(column(table, "success (%)")["pure_pursuit"]) == pytest.approx(
        [87.5, 100 * low, 100 * high], abs=0.06
    )

    rows = made(GOALS, "dwa", {"success": WON, "collision": 1.0 - WON, "time": TIMES, "spl": WON * TIMES / 60})
    table = contest_tables(rows, [], "x", False)["goal_obstacles_p3dx"]
    imputed = np.where(WON == 1.0, TIMES, 60.0)
    low, high = counted(imputed)
    shown = numbers(column(table, "imputed (s)")["dwa"])
    assert shown == pytest.approx([imputed.mean(), low, high], abs=0.06)
    assert numbers(column(table, "collision (%)")["dwa"]) == pytest.approx([12.5])
    low, high = counted(np.where(WON == 1.0, TIMES / 60, 0.0))
    assert numbers(column(table, "SPL")["dwa"]) == pytest.approx([(WON * TIMES / 60).mean(), low, high], abs=6e-4)


def test_the_gap_is_what_is_better_where_gains_were_tuned() -> None:
    rows = made(PATHS, "stanley", {"success": 1.0, "cross_track_rms": 0.03})
    rows += made(PATHS, "stanley", {"success": 1.0, "cross_track_rms": 0.02}, split="validation")
    table = contest_tables(rows, [], "x", False)["path_following_p3dx"]
    assert column(table, "gap (RMS, m)")["stanley"] == "+0.0100"
    rows = made(GOALS, "dwa", {"success": WON, "time": TIMES})
    rows += made(GOALS, "dwa", {"success": 1.0, "time": TIMES}, split="validation")
    table = contest_tables(rows, [], "x", False)["goal_obstacles_p3dx"]
    assert column(table, "gap (success, %)")["dwa"] == "+12.5"


def test_families_and_tiers_hold_their_own_successes_and_the_mean_of_their_cost() -> None:
    rows = made(PATHS, "lqr", {"success": WON, "cross_track_rms": ERRORS})
    tables = contest_tables(rows, [], "x", False)
    groups = {
        "path_following_p3dx_families": {"wide": np.arange(16) < COUNT, "narrow": np.arange(16) >= COUNT},
        "path_following_p3dx_tiers": {
            name: np.arange(16) % 3 == k for k, name in enumerate(("easy", "medium", "hard"))
        },
    }
    for stem, members in groups.items():
        for name, mine in members.items():
            won, error = numbers(column(tables[stem], name)["lqr"])
            assert won == round(100.0 * WON[mine].mean())
            assert error == pytest.approx(np.where(WON == 1.0, ERRORS, 1.0)[mine].mean(), abs=6e-5)


def test_the_matrix_counts_draws_half_and_stars_what_is_decided_either_way() -> None:
    rows = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": 0.01})
    rows += made(PATHS, "stanley", {"success": 1.0, "cross_track_rms": 0.02})
    rows += made(PATHS, "pure_pursuit", {"success": 1.0, "cross_track_rms": np.where(np.arange(16) % 2, 0.01, 0.02)})
    table = contest_tables(rows, [], "x", False)["path_following_p3dx_better"]
    assert column(table, "stanley")["lqr"] == "1.00*"
    assert column(table, "lqr")["stanley"] == "0.00*"
    # ahead in half of them, level in the others; and level with itself in no cell
    assert column(table, "pure_pursuit")["lqr"] == "0.75*"
    assert column(table, "lqr")["pure_pursuit"] == "0.25*"
    assert column(table, "lqr")["lqr"] == ""
    rows = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": 0.01 + 0.001 * (np.arange(16) % 2)})
    rows += made(PATHS, "stanley", {"success": 1.0, "cross_track_rms": 0.01 + 0.001 * (np.arange(1, 17) % 2)})
    assert column(contest_tables(rows, [], "x", False)["path_following_p3dx_better"], "stanley")["lqr"] == "0.50"


def test_a_seed_that_is_under_the_documented_controller_has_failed() -> None:
    rows = made(PATHS, "lookahead_documented", {"success": 1.0, "cross_track_rms": 0.05})
    for seed, (success, error) in enumerate(((1.0, 0.02), (1.0, 0.06), (WON, 0.001), (1.0, 0.05))):
        cells = {"success": success, "cross_track_rms": error}
        rows += made(PATHS, "ppo", cells, agent_seed=f"{seed}", gains_name="trained")
    table = contest_tables(rows, [], "x", False)["path_following_p3dx_seeds"]
    assert [line[2] for line in table.rows] == ["0", "1", "2", "3"]
    assert [line[3] for line in table.rows] == ["100.0", "100.0", "87.5", "100.0"]
    # who does as well as the documented controller is not over it
    assert [line[-1] for line in table.rows] == ["yes", "no", "no", "no"]
    # a failure counts as the corridor
    assert [line[4] for line in table.rows] == ["0.0200", "0.0600", f"{(14 * 0.001 + 2.0) / 16:.4f}", "0.0500"]


def test_each_seed_is_held_against_the_bar_by_its_own_validation() -> None:
    rows = made(PATHS, "lookahead_documented", {"success": 1.0, "cross_track_rms": 0.05})
    for seed, error in (("0", 0.9 * BAR), ("1", 1.1 * BAR), ("2", 0.5 * BAR)):
        for split, shown in (("test", 0.02), ("validation", error)):
            cells = {"success": 1.0, "cross_track_rms": shown}
            rows += made(PATHS, "ppo", cells, split=split, agent_seed=seed, gains_name="trained")
    table = contest_tables(rows, [], "x", False)["path_following_p3dx_seeds"]
    assert [line[5] for line in table.rows] == ["yes", "no", "yes"]


def test_success_of_several_seeds_is_not_that_of_as_many_scenarios() -> None:
    rows = []
    for seed in range(4):
        cells = {"success": WON, "cross_track_rms": 0.01}
        rows += made(PATHS, "ppo", cells, agent_seed=f"{seed}", gains_name="trained")
    table = contest_tables(rows, [], "x", False)["path_following_p3dx"]
    share, low, high = numbers(column(table, "success (%)")["ppo"])
    # four agents that do alike tell of as many scenarios as one
    expected = exact_interval(14 / 16, 16)
    assert share == 87.5
    assert high - low >= 100.0 * (expected[1] - expected[0])
    assert high < 100.0


def test_the_front_shows_pace_and_error_at_each_speed_by_itself() -> None:
    rows = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": ERRORS, "mean_speed": TIMES / 60})
    for speed, factor in (("0.3", 1.0), ("0.6", 2.0)):
        cells = {"success": WON, "cross_track_rms": factor * ERRORS, "mean_speed": factor * TIMES / 60}
        rows += made(PATHS, "lqr", cells, split="front", speed=speed)
    table = contest_tables(rows, [], "x", False)["path_following_p3dx_front"]
    for speed, factor in (("0.3", 1.0), ("0.6", 2.0)):
        costs = np.where(WON == 1.0, factor * ERRORS, 1.0)
        shown = numbers(column(table, speed)["lqr"].rstrip("‡"))
        wanted = [float(iqm(costs)), *ends(costs, iqm), float((factor * TIMES / 60)[WON == 1.0].mean())]
        assert shown == pytest.approx(wanted, abs=6e-3)
        assert shown[0] == pytest.approx(wanted[0], abs=6e-5)


def test_who_drives_alone_has_not_won() -> None:
    rows = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": 0.01, "mean_speed": 0.6})
    alone = found(CONTESTS[PATHS], "p3dx", rows).sentence
    assert (
        "1 policy on the same 16 scenarios of 2 families. lqr has no rival: RMS error 0.0100 [0.0100, 0." in alone
    )  # one may fail
    rows += made(PATHS, "stanley", {"success": 1.0, "cross_track_rms": 0.02, "mean_speed": 0.6})
    assert "2 policies" in (two := found(CONTESTS[PATHS], "p3dx", rows).sentence)
    assert "lqr wins" in two


def test_brackets_and_stars_need_five_scenarios_a_family() -> None:
    def without_last(rows: list[Row], kept: int) -> list[Row]:
        return [row for row in rows if int(row["episode"]) < kept]

    for kept, shown in ((5, True), (4, False)):
        rows = without_last(made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": 0.01}), kept)
        rows += without_last(made(PATHS, "stanley", {"success": 1.0, "cross_track_rms": 0.02}), kept)
        rows += without_last(made(PATHS, "ppo", {"success": 1.0, "cross_track_rms": 0.03}, gains_name="trained"), kept)
        tables = contest_tables(rows, [], "x", False)
        for table in tables.values():
            text = " ".join(cell for line in table.rows for cell in line)
            assert shown or ("[" not in text and "*" not in text), table.title
        assert ("[" in column(tables["path_following_p3dx"], "success (%)")["lqr"]) == shown
        assert column(tables["path_following_p3dx_better"], "stanley")["lqr"] == "1.00" + "*" * shown


def test_who_drives_at_another_speed_is_marked_and_stands_below() -> None:
    cells = {"success": 1.0, "cross_track_rms": 0.001, "mean_speed": 0.4}
    rows = made(PATHS, "stanley", cells)
    rows += made(PATHS, "lqr", cells | {"cross_track_rms": 0.03, "mean_speed": 0.585})
    rows += made(PATHS, "mpc", cells | {"cross_track_rms": 0.02, "mean_speed": 0.61})
    rows += made(PATHS, "pure_pursuit", cells | {"cross_track_rms": 0.002, "mean_speed": 0.62})  # too fast is off too
    table = contest_tables(rows, [], "x", False)["path_following_p3dx"]
    assert [line[0] for line in table.rows] == ["mpc", "lqr", "pure_pursuit", "stanley"]
    speeds = {"mpc": "0.610", "lqr": "0.585", "pure_pursuit": "0.620‡", "stanley": "0.400‡"}
    assert column(table, "mean speed (m/s)") == speeds


def test_of_those_off_the_speed_the_nearest_to_it_is_first_however_it_errs() -> None:
    cells = {"success": 1.0, "cross_track_rms": 0.001, "mean_speed": 0.4}
    rows = made(PATHS, "stanley", cells)
    rows += made(PATHS, "lqr", cells | {"cross_track_rms": 0.03, "mean_speed": 0.65})
    rows += made(PATHS, "mpc", cells | {"cross_track_rms": 0.02, "mean_speed": 0.52})
    rows += made(PATHS, "smooth_pose", cells | {"cross_track_rms": 0.9, "mean_speed": 0.6})
    table = contest_tables(rows, [], "x", False)["path_following_p3dx"]
    assert [line[0] for line in table.rows] == ["smooth_pose", "lqr", "mpc", "stanley"]
    # where nobody holds it, nobody is set back
    table = contest_tables(rows[: 3 * 2 * COUNT], [], "x", False)["path_following_p3dx"]
    assert [line[0] for line in table.rows] == ["stanley", "mpc", "lqr"]


def test_no_star_is_won_by_driving_slower() -> None:
    rows = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": 0.01, "mean_speed": 0.5})
    rows += made(PATHS, "stanley", {"success": 1.0, "cross_track_rms": 0.02, "mean_speed": 0.6})
    rows += made(PATHS, "mpc", {"success": 1.0, "cross_track_rms": 0.005, "mean_speed": 0.6})
    table = contest_tables(rows, [], "x", False)["path_following_p3dx_better"]
    assert column(table, "stanley")["lqr"] == "1.00‡"
    assert column(table, "lqr")["stanley"] == "0.00‡"
    assert column(table, "lqr")["mpc"] == "1.00*"  # quicker, and it errs less
    assert column(table, "stanley")["mpc"] == "1.00*"
    duels = next(each for each in found(CONTESTS[PATHS], "p3dx", rows).charts if each["kind"] == "duels")
    assert duels["cells"][0][1] == [1.0, 0.0]
    assert duels["cells"][2][0] == [1.0, 1.0]
    # goals are asked for no mean speed: who takes its time pays in seconds
    rows = made(GOALS, "dwa", {"success": 1.0, "time": 10.0, "mean_speed": 0.3})
    rows += made(GOALS, "orca", {"success": 1.0, "time": 20.0, "mean_speed": 0.6})
    assert column(contest_tables(rows, [], "x", False)["goal_obstacles_p3dx_better"], "orca")["dwa"] == "1.00*"


def test_a_failure_makes_no_mean_better() -> None:
    easy = np.where(WON == 1.0, 0.01, 0.5)
    whole = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": easy, "settled_rms": easy, "cross_track_max": easy})
    failing = made(
        PATHS, "mpc", {"success": WON, "cross_track_rms": easy, "settled_rms": easy, "cross_track_max": easy}
    )
    table = contest_tables(whole + failing, [], "x", False)["path_following_p3dx"]
    for header in ("RMS error (m)", "typical (m)", "after 1 m (m)", "worst (m)"):
        shown = {name: numbers(cell)[0] for name, cell in column(table, header).items()}
        assert shown["mpc"] >= shown["lqr"], header


def test_the_start_beside_the_path_is_left_out_after_a_metre() -> None:
    along = np.linspace(0.0, 4.0, 401)
    errors = np.where(along < 0.995, 0.2, 0.01)
    run = Trajectory(
        times=along, poses=np.zeros((401, 3)), arc_lengths=along, cross_track_errors=errors, heading_errors=errors,
        references=np.zeros((401, 5)),
    )  # fmt: skip
    found = measure(run)
    assert found["settled_rms"] == pytest.approx(0.01)
    assert found["cross_track_rms"] == pytest.approx(0.1, abs=0.001)


def test_where_a_run_has_no_number_the_mean_of_the_others_has_no_interval() -> None:
    settled = np.where(np.arange(2 * COUNT) == 3, np.nan, 0.02)
    rows = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": ERRORS, "settled_rms": settled})
    rows = [row | {"settled_rms": row["settled_rms"].replace("nan", "")} for row in rows]
    table = contest_tables(rows, [], "x", False)["path_following_p3dx"]
    assert column(table, "after 1 m (m)") == {"lqr": "0.0200"}


def test_a_point_of_the_front_is_marked_where_a_single_run_is_lost() -> None:
    points = []
    for speed, success in (("0.3", 1.0), ("0.6", WON), ("0.9", 0.0)):
        cells = {"success": success, "cross_track_rms": ERRORS, "mean_speed": 0.3}
        points += made(PATHS, "lqr", cells, split="front", speed=speed)
    found = front_points(CONTESTS[PATHS], points)
    assert [(each.asked, each.lost) for each in found] == [("0.3", False), ("0.6", True), ("0.9", True)]


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


def test_a_contest_compares_with_the_speed_that_it_asks_for() -> None:
    case = Case("goal-obstacles", "clutter_5", GOAL_ID, "clutter_5/validation", "waypoint", {}, {"num_beams": 0}, 300)
    for asked, more in ((0.6, {}), (0.9, {"speed": 0.9}), (1.7320508, {"speed": 9.0})):
        there = dataclasses.replace(case, split="validation", every_scenario=True, **more)
        (run,) = roll_out(there, actuators="lagged", seed=0, episodes=1)
        assert run.max_speed == pytest.approx(asked, abs=1e-6)


def test_small_budgets_are_told_from_none() -> None:
    assert [in_frames(count) for count in (8_000_000, 123_456, 32_644, 900)] == [
        *("8.0 M frames", "0.1 M frames", "0.033 M frames", "0.0009 M frames")
    ]


def test_faults_are_counted_robot_by_robot() -> None:
    case = Case(
        "", "", PATH_ID, "circuits/validation", "mpc", {"solver_iterations": 100}, max_episode_steps=60,
        every_scenario=True,
    )  # fmt: skip
    faults = [each.faults for each in roll_out(case, actuators="lagged", seed=0, episodes=4)]
    assert len(set(faults)) > 1
    for k, each in enumerate(faults):
        env: Any = gymnasium.make(PATH_ID, scenario=case.scenario, actuators="lagged", max_episode_steps=60)
        seen, _ = env.reset(seed=k, options={"scenario": k})
        pilot = Pilot(policies.make("mpc", solver_iterations=100), env)
        pilot.reset()
        ended = False
        while not ended:
            seen, _, terminated, truncated, _ = env.step(pilot.command(seen))
            ended = terminated or truncated
        assert each == pilot.memory["qp_failures"][0]


def test_laps_are_completed_one_after_the_other(tmp_path: Any) -> None:
    file = tmp_path / "square.json"
    file.write_text('{"path": [[0, 0], [2, 0], [2, 2], [0, 2]], "closed": true, "laps": 3}')
    case = Case("", "", PATH_ID, str(file), "pure_pursuit", max_episode_steps=300)
    (run,) = roll_out(case, actuators="lagged")
    found = measure(run)
    # 15 s at 0.6 m/s of three laps of 8 m
    assert found["completion"] == pytest.approx(found["path_length"] / 24.0, rel=0.1)
    assert 0.3 < found["completion"] < 0.45


def test_episodes_of_an_earlier_version_are_refused_by_their_columns() -> None:
    rows = made(PATHS, "lqr", {"success": 1.0, "cross_track_rms": 0.01})
    old = [{"document" if name == "contest" else name: cell for name, cell in row.items()} for row in rows]
    with pytest.raises(ValueError, match="no column contest: they are of an earlier version"):
        contest_tables(old, [], "x", False)


def test_what_a_new_contest_shows_is_all_in_its_own_file() -> None:
    for contest in CONTESTS.values():
        assert contest.spec.suite == contest.name
        assert contest.cost_header in [each.header for each in contest.columns]
        assert contest.timed_on in contest.families("kinematic")
        assert set(contest.policies) <= set(policies.POLICIES)
        assert contest.failure_cost(contest.spec.clock) == pytest.approx(contest.spec.cost.failure)


def test_a_narrow_terminal_stacks_intervals_before_it_leaves_columns_out() -> None:
    header = ["policy", "success (%)", "SPL", "SCT", "learned from"]
    row = ["vfh_plus", "96.0 [92.3, 98.0]", "0.825 [0.799, 0.851]", "0.412 [0.399, 0.425]", "1,800 runs"]
    table = Table("Standings", header, [row], "")
    paper = rich.console.Console(width=1000)
    wide, narrow = (paper.measure(table.terminal(stacked=stacked)).maximum for stacked in (False, True))
    assert narrow < 80 < wide
    with paper.capture() as capture:
        paper.print(table.terminal(stacked=True))
    shown = capture.get()
    assert all(number in shown for cell in row for number in cell.split(" [")[0].split())
    assert shown.index("96.0") < shown.index("[92.3, 98.0]")


def test_a_terminal_of_80_columns_shows_what_a_dock_is_judged_by(capsys: pytest.CaptureFixture[str]) -> None:
    columns = CONTESTS["docking"].columns
    cells = ["100.0 [96.4, 100.0]", *("123.4 [101.2, 145.6]" if each.with_interval else "12.3" for each in columns)]
    header = ["policy", "gains", "success (%)", *(column.header for column in columns), "learned from"]
    rows = [["smooth_pose_backward", gains, *cells, "not tuned"] for gains in ("default", "tuned")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.stdout, "isatty", lambda: True)
        patch.setenv("COLUMNS", "80")
        print_all([Table("Docking", header, rows, "Note.")])
    shown, _, _ = re.sub("\x1b\\[[0-9;]*m", "", capsys.readouterr().out).partition("Note.")
    assert max(map(len, shown.splitlines())) <= 80
    for word in ("success", "collision", "position error", "heading error", "default", "tuned"):
        assert word in shown


def test_published_figures_stand_below_ours_and_texts_are_as_narrow_as_asked_for() -> None:
    table = Table("C", ["policy", "time (s)", "is told"], [["apf", "12.30 / 12.00", "the goal and all obstacles"]], "")
    console = rich.console.Console(width=1000)
    with console.capture() as capture:
        console.print(table.terminal(stacked=True, cell_width=12))
    assert [" ".join(line.split()) for line in capture.get().splitlines()[-4:-1]] == [
        "apf 12.30 / the goal and",
        "12.00 all",
        "obstacles",
    ]


@pytest.mark.parametrize("name", CONTESTS)
def test_only_who_has_a_path_is_told_one(name: str) -> None:
    told = {knows: disclosed("mine", "default", knows, CONTESTS[name]).told for knows in KNOWS}
    assert ("path" in told["path"]) == (CONTESTS[name].spec.kind == "path")
    assert "goal" in told["goal"]
    assert told["sensors"] == "nothing"


def test_a_bar_in_a_cell_is_no_border() -> None:
    text = Table("Costs", ["policy", "a|b"], [["mine:P", "|v|"]], "note").markdown()
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert {len(re.split(r"(?<!\\)\|", line)) for line in lines} == {4}
    assert r"\|v\|" in text


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
