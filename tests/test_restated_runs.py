"""What a run notes of every episode, of its world and of its worth in a search, stated once more."""

import dataclasses
import hashlib
import itertools
import json
import math
import statistics
import types
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks import contest_report, decisions, own_policies, parts, suite, transfer
from wayfield.benchmarks.ahead import Ahead
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.columns import text
from wayfield.benchmarks.comparison import compare
from wayfield.benchmarks.contests import CONTESTS, Score
from wayfield.benchmarks.contests.docking import direction_changes
from wayfield.benchmarks.metrics import measure, smoothness
from wayfield.benchmarks.own_scenario import POLICIES, own_cases, own_scenario, without_way
from wayfield.benchmarks.parcels import sent
from wayfield.benchmarks.parts import badness, slim
from wayfield.benchmarks.recorder import Episode, Start, record, robots_for
from wayfield.benchmarks.report import worlds as report_worlds
from wayfield.benchmarks.report.drives import write_drives
from wayfield.benchmarks.report.worlds import keys_of, plain, read_worlds, worlds_of, write_worlds
from wayfield.benchmarks.rollout import roll_out
from wayfield.benchmarks.run_folder import default_folder
from wayfield.benchmarks.shortest import shortest_way
from wayfield.benchmarks.suite import Setting, heads_first
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.grids import OccupancyGrid
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import box, circle, obstacle_field, splits, wall
from wayfield.policies import make
from wayfield.policies.learned.ppo import trained
from wayfield.policies.training.shaping import Shaped

PATH, GOAL, DOCK = (f"wayfield/DiffDrive{name}-v0" for name in ("PathFollowing", "GoalObstacles", "Docking"))
NAN = math.nan


def setting_of(case: Case, **more: Any) -> Setting:
    told: dict[str, Any] = {"dynamics": "kinematic", "actuators": "lagged", "seed": 11, "episodes": 3}
    return Setting("my suite", case, **{**told, **more})


def driven(n: int = 30) -> Trajectory:
    rng = np.random.default_rng(n)
    return Trajectory(
        times=0.05 * np.arange(n),
        poses=np.cumsum(rng.normal(0.02, 0.02, (n, 3)), axis=0),
        twists=np.column_stack([rng.normal(0.0, 0.05, n), np.zeros(n), np.zeros(n)]),
        wheel_speeds=rng.normal(size=(n, 2)),
        saturated=np.zeros(n),
        clearances=np.ones(n),
        goals=np.ones((2, 3)),
        obstacles=obstacle_field(circle(3.0, 3.0, 0.2)),
        success=True,
        shortest=1.0,
        max_speed=0.6,
    )


def test_a_row_says_under_what_conditions_was_driven_and_what_was_measured() -> None:
    trajectory = driven()
    case = Case("docking", "open", DOCK, "open/test", "polar", {"k_rho": 2.0, "home": "x"}, {"robot": "p3dx"},
                gains_name="tuned", split="test", arrival_radius=0.25)  # fmt: skip
    row = suite._row(setting_of(case), 2, trajectory)
    numbers = measure(trajectory, 0.25)
    signs = [math.copysign(1.0, v) for v in trajectory.twists[:, 0] if abs(v) >= 0.02]
    changes = sum(a != b for a, b in itertools.pairwise(signs))
    assert direction_changes(trajectory) == changes > 2
    assert row == {
        "suite": "my suite", "contest": "docking", "family": "open", "scenario": "open/test", "robot": "p3dx",
        "disturbance": "none", "policy": "polar", "gains_name": "tuned", "gains": "k_rho=2 home=x",
        "dynamics": "kinematic", "actuators": "lagged", "seed": "13", "episode": "2", "arrival_radius": "0.25",
        **{name: text(value) for name, value in numbers.items()}, "direction_changes": str(changes),
    }  # fmt: skip
    bare = Case("A", "course", PATH, "a\udcff", "lqr", env_kwargs={"disturbance": "light"})
    given = dataclasses.replace(bare, scenario="/as/given.json")
    row = suite._row(setting_of(bare, given=given), 0, trajectory)
    told = [row[name] for name in ("document", "experiment", "scenario", "robot", "disturbance", "arrival_radius")]
    assert told == ["A", "course", "/as/given.json", "", "light", ""]
    assert suite._row(setting_of(bare), 0, trajectory)["scenario"] == r"a\xff"
    assert "direction_changes" not in row


def test_episodes_are_noted_in_the_order_of_their_settings() -> None:
    cases = [Case("d", "e", env_id, "x", policy) for env_id, policy in ((PATH, "a"), (GOAL, "b"), (PATH, "c"))]
    settings = [setting_of(case) for case in cases]
    asked: list[str] = []

    def engine(function: Any, items: Any) -> Any:
        for setting in items:
            asked.append(setting.case.policy)
            yield [({"policy": setting.case.policy, "k": str(k)}, driven(k + 2)) for k in range(2)]

    rows, trajectories = suite.run(settings, engine)
    assert asked == ["b", "a", "c"]
    assert [(row["trajectory"], row["policy"], row["k"]) for row in rows] == [
        (f"{k:05d}", "abc"[k // 2], str(k % 2)) for k in range(6)
    ]
    assert [len(trajectories[row["trajectory"]].times) for row in rows] == [2, 3, 2, 3, 2, 3]


def test_three_states_have_no_smoothness() -> None:
    assert smoothness(driven(3)) == {}
    assert set(smoothness(driven(4))) == {"velocity_smoothness", "ldlj", "squared_jerk"}
    still = dataclasses.replace(driven(9), twists=np.zeros((9, 3)))
    assert smoothness(still) == {"squared_jerk": 0.0, "velocity_smoothness": 0.0}


def test_what_compiles_comes_first() -> None:
    """First the first scene, then the first path, further drivers of paths and of scenes, and what is left."""
    told = [(PATH, "a"), (PATH, "a"), (PATH, "b"), (GOAL, "c"), (GOAL, "d"), (GOAL, "c"), (PATH, "c")]
    settings = [setting_of(Case(env_id[18:22], "e", env_id, "x", policy)) for env_id, policy in told]
    assert heads_first(settings) == [3, 0, 2, 6, 4, 1, 5]
    other = [dataclasses.replace(each, dynamics="pymunk") for each in settings[3:5]]
    assert heads_first([*settings, *other]) == [3, 7, 0, 2, 6, 4, 8, 1, 5]


def test_the_worst_are_failures_then_the_dearest() -> None:
    rows = [{"success": s, "time": t} for s, t in (("1", "3"), ("0", "9"), ("1", "8"), ("0", ""), ("0", "12"))]
    assert [rows.index(row) for row in sorted(rows, key=lambda row: badness(row, "time"))] == [4, 1, 3, 2, 0]
    whole = dataclasses.replace(driven(), references=np.ones((30, 5)))
    thin = slim(whole)
    for field in dataclasses.fields(Trajectory):
        kept, had = (np.asarray(getattr(each, field.name)) for each in (thin, whole))
        if field.name in ("twists", "wheel_speeds", "saturated", "references"):
            assert kept.size == 0 < had.size
        else:
            assert kept.tobytes() == had.tobytes()


def test_a_world_is_its_scenario_and_the_numbers_that_its_reset_draws(tmp_path: Path) -> None:
    def case(env_id: str, scenario: str, **more: Any) -> Case:
        return Case("d", "e", env_id, scenario, "p", max_episode_steps=77, **more)

    bank = splits.split("goal_reaching", "rooms", "test")
    every = setting_of(case(GOAL, "rooms/test", every_scenario=True), episodes=12)
    some = setting_of(case(GOAL, "rooms/test", every_scenario=True), members=(4, 2), episodes=2)
    drawn = setting_of(case(GOAL, "rooms/test"), episodes=2)
    scaled = setting_of(case(PATH, "circuits/test", every_scenario=True, env_kwargs={"scale": 2.5}), episodes=1)
    assert keys_of(every) == [f"rooms/test#{k % len(bank)}#1" for k in range(12)]
    assert keys_of(some) == ["rooms/test#4#1", "rooms/test#2#1"]
    assert keys_of(drawn) == ["", ""]
    assert keys_of(scaled) == ["circuits/test#0#2.5"]
    found = worlds_of([some, drawn, scaled, every])
    assert list(found)[:3] == ["rooms/test#4#1", "rooms/test#2#1", "circuits/test#0#2.5"]
    assert len(found) == 3 + 8
    for k, member in enumerate((4, 2)):
        generator = gymnasium.utils.seeding.np_random(11 + k)[0]
        world = found[f"rooms/test#{member}#1"]
        assert world["draws"] == generator.random(6).tolist()
        assert {name: each for name, each in world.items() if name != "draws"} == plain(bank[member], 77)
    scenario = bank[4]
    told = plain(scenario, 77)
    assert (told["kind"], told["name"], told["family"], told["tier"]) == ("goal", scenario.name, "rooms", scenario.tier)
    assert (told["steps"], told["start"], told["goal"]) == (77, list(scenario.start), list(scenario.goal))
    assert told["waypoints"] == [list(each) for each in scenario.waypoints]
    assert [tuple(each) for each in told["obstacles"]] == scenario.obstacles.tolist()
    assert told["patrols"] == []
    moving = splits.split("goal_reaching", "moving_crowd", "test")[0]
    assert [tuple(each) for each in plain(moving, 1)["patrols"]] == moving.patrols.tolist()
    for name in (
        "position_tolerance",
        "heading_tolerance",
        "waypoint_radius",
        "quantity",
        "start_offset",
        "start_turn",
    ):
        assert told[name] == getattr(scenario, name)
    assert plain(dataclasses.replace(scenario, quantity=math.inf), 1)["quantity"] is None
    path = splits.split("path_following", "circuits", "test")[0]
    told = plain(path, 9)
    assert (told["kind"], told["path"], told["closed"]) == ("path", path.path.points.tolist(), path.path.closed)
    assert (told["laps"], told["corridor"], told["start"]) == (
        path.laps,
        path.corridor,
        path.start and list(path.start),
    )
    jackal = setting_of(case(GOAL, "discs", env_kwargs={"robot": "jackal"}), episodes=2)
    write_worlds(tmp_path, [some, drawn, jackal])
    worlds, rows, hulls = read_worlds(tmp_path)
    assert rows == ["rooms/test#4#1", "rooms/test#2#1", "", "", *keys_of(jackal)]
    box_of = ROBOTS["jackal"].hull_box
    assert box_of is not None
    assert hulls == [ROBOTS["p3dx"].hull_radius] * 4 + [list(box_of)] * 2
    assert set(worlds) == set(rows) - {""}


def test_a_map_is_told_by_its_outline_and_unless_it_is_large_by_its_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    occupied = np.zeros((4, 6), bool)
    occupied[1, 2] = True
    grid = OccupancyGrid(occupied, 0.5, (1.0, 2.0, 0.0), "free")
    for most, told in ((grid.cells.nbytes, True), (grid.cells.nbytes - 1, False)):
        monkeypatch.setattr(report_worlds, "MOST_CELLS", most)
        world = report_worlds._map(types.SimpleNamespace(grid=grid))
        # four sides of the one cell, half a metre each, around its middle
        places = np.array([each[:2] for each in world["walls"]])
        assert sorted(np.round(places - [2.25, 2.75], 9).tolist()) == [[-0.25, 0], [0, -0.25], [0, 0.25], [0.25, 0]]
        assert ("grid" in world) is told
    assert report_worlds._map(types.SimpleNamespace(grid=None)) == {}


def scored(name: str, seed: int) -> tuple[list[dict[str, str]], list[Any]]:
    rng = np.random.default_rng(seed)
    rows, scenarios = [], []
    bank = splits.split("path_following", "circuits", "test")
    for k in range(6):
        won = rng.random() < 0.7
        numbers = {"success": float(won), "time": rng.uniform(10.0, 40.0), "mean_speed": rng.uniform(0.55, 0.62),
                   "cross_track_rms": float(rng.choice([0.0004, 0.02, 0.3])), "sct": rng.random()}  # fmt: skip
        rows.append({key: repr(float(each)) for key, each in numbers.items()})
        scenarios.append(dataclasses.replace(bank[k], laps=k % 4))  # 0: without end, of which one counts
    return rows, scenarios


@pytest.mark.parametrize("seed", range(12))
def test_how_a_search_scores_a_set_of_gains(seed: int) -> None:
    rows, scenarios = scored("x", seed)
    speed, least = 0.59, (0.5, 0.61)[seed % 2]
    won = [row for row in rows if row["success"] == "1.0"]
    frames = sum(round(float(row["time"]) / 0.05) for row in rows)
    mean = statistics.fmean(float(row["mean_speed"]) for row in won) if won else NAN
    off = [float(row["cross_track_rms"]) if row in won else 1.0 for row in rows]
    errors = [math.log(max(each, 1e-3) / 1e-3) for each in off]
    late = [
        math.log(float(row["time"]) * speed / (max(each.laps, 1) * each.path.length)) if row in won else 0.0
        for row, each in zip(rows, scenarios, strict=True)
    ]
    is_held = abs(mean - speed) <= 0.03 * speed
    away = 0 if is_held else 2 if mean < least else 1
    quality = max(statistics.fmean(errors) + (0.0 if is_held else statistics.fmean(late)), 0.0)
    lost = len(rows) - len(won)
    sct = 1.0 - statistics.fmean(float(row["sct"]) for row in rows)
    times = statistics.fmean(float(row["time"]) / 60.0 for row in won) if won else 1.0
    for name, wanted in (
        ("path-following", Score(lost, away, quality, mean, 6, frames)),
        ("goal-obstacles", Score(lost, 0, sct, mean, 6, frames)),
        ("docking", Score(lost, 0, times, mean, 6, frames)),
    ):
        found = CONTESTS[name].score(rows, scenarios, speed, least)
        assert dataclasses.astuple(found) == pytest.approx(dataclasses.astuple(wanted), nan_ok=True)
        share = (wanted.off_pace + wanted.quality / (1.0 + wanted.quality)) / 3.0
        assert found.value == pytest.approx(lost + share)


def test_the_bar_of_a_preset() -> None:
    path, goal, dock = (CONTESTS[name].bar for name in ("path-following", "goal-obstacles", "docking"))
    assert path is not None
    assert goal is not None
    assert dock is not None

    def rows(won: int, hit: int, family: str = "clutter_10", error: float = 0.01) -> list[dict[str, str]]:
        return [
            {"family": family, "success": str(int(k < won)), "collision": str(int(k >= 100 - hit)),
             "cross_track_rms": repr(error), "failure_cost": "1.0"}
            for k in range(100)
        ]  # fmt: skip

    tried = (100, 0.0147), (100, 0.0149), (76, 0.014), (60, 0.014)
    assert [path.reached(rows(won, 0, error=error)) for won, error in tried] == [True, False, True, False]
    assert [goal.reached(rows(*each)) for each in ((90, 3), (89, 3), (90, 4))] == [True, False, False]
    assert goal.reached(rows(100, 0, "rooms")) is None
    assert [dock.reached(rows(won, 0)) for won in (80, 79)] == [True, False]
    assert dock.reached([]) is None


def test_a_timing_as_a_row() -> None:
    case = Case("d", "e", PATH, "x", "lqr", env_kwargs={"robot": "p3dx"}, gains_name="tuned")
    timing = decisions.Timing(case, 256, 2.0, 3.14159)
    assert timing.per_second == pytest.approx(128_000.0)
    assert timing.row == {
        "policy": "lqr", "gains_name": "tuned", "robot": "p3dx", "batch": "256", "median_ms": "2.0000",
        "p99_ms": "3.1416", "per_second": "128000",
    }  # fmt: skip


def test_a_table_of_gains_elsewhere() -> None:
    rows = [
        {"robot": "p3dx", "policy": policy, "gains_name": "tuned", "learned_from": "1 M frames", "place": place,
         "scenario": f"{place} {k // 2}", "success": str(int(k < won))}
        for policy, place, won in (
            ("dwa", "rooms", 3), ("dwa", "test", 0), ("orca", "test", 8), ("dwa", "rooms, jackal", 4)
        )
        for k in range(8)
    ]  # fmt: skip
    table = transfer.transfer_table(rows, "made so")
    assert table.header == ["robot", "policy", "gains", "learned from", "test", "rooms", "rooms, jackal"]
    assert [line[:4] for line in table.rows] == [["p3dx", name, "tuned", "1 M frames"] for name in ("dwa", "orca")]
    assert [line[4].split()[0] for line in table.rows] == ["0.0", "100.0"]
    assert table.rows[0][4] == f"0.0 [0.0, {100.0 * (1.0 - 0.025 ** (1 / 8)):.1f}]"
    assert (table.rows[0][5].split()[0], table.rows[1][5]) == ("37.5", "")
    assert table.rows[0][6].split()[0] == "50.0"
    assert "Rooms: 4 of 8 to 20 m" in table.note  # with another hull they are the same
    assert "Made by `made so`." in table.note


def test_the_shortest_way_round_a_box_and_through_waypoints() -> None:
    base = splits.split("goal_reaching", "clutter_5", "test")[0]
    empty = obstacle_field()
    told = dataclasses.replace(
        base, obstacles=empty, patrols=base.patrols[:0], start=(0.0, 0.0, 0.0), goal=(6.0, 0.0, 0.0), waypoints=(),
        position_tolerance=0.1, grid=None,
    )  # fmt: skip
    assert shortest_way(told, 0.2) == pytest.approx(5.9, abs=0.01)
    through = dataclasses.replace(told, waypoints=((3.0, 4.0),))
    assert shortest_way(through, 0.2) == pytest.approx(9.9, abs=0.02)
    patrols = np.zeros(1, base.patrols.dtype)
    stands = dataclasses.replace(told, obstacles=obstacle_field(box(3.0, 0.0, 0.4, 4.0)), patrols=patrols)
    # a tangent to a disc of the hull's radius about each corner, an arc of it, and along the side
    reach, turn = math.hypot(2.8, 2.0), math.atan2(2.0, 2.8)
    tangent, more = math.sqrt(reach**2 - 0.2**2), math.asin(0.2 / reach)
    assert shortest_way(stands, 0.2) == pytest.approx(2.0 * (tangent + 0.2 * (turn + more)) + 0.4 - 0.1, abs=0.04)
    round_ = dataclasses.replace(stands, obstacles=obstacle_field(circle(3.0, 0.0, 1.0)))
    reach = math.sqrt(3.0**2 - 1.2**2)
    arc = 1.2 * (math.pi - 2.0 * math.acos(1.2 / 3.0))
    assert shortest_way(round_, 0.2) == pytest.approx(2.0 * reach + arc - 0.1, abs=0.04)
    patrols = patrols.copy()
    patrols["leg_time"], patrols["x"] = 2.0, 3.0  # it leaves
    assert shortest_way(dataclasses.replace(round_, patrols=patrols), 0.2) == pytest.approx(5.9, abs=0.01)
    near = dataclasses.replace(told, goal=(0.05, 0.0, 0.0))
    assert shortest_way(near, 0.2) == pytest.approx(0.04)
    # round the nearer end of a wall, whichever way that points: beyond it there is room as well
    reach = math.hypot(3.0, 2.0)
    round_end = math.sqrt(reach**2 - 0.2**2) + 0.2 * (math.atan2(2.0, 3.0) + math.asin(0.2 / reach))
    for turned in (1, 1j, -1, -1j):
        goal, far, end = (turned * each for each in (6 + 0j, 3 - 7j, 3 + 2j))
        barred = obstacle_field(wall(far.real, far.imag, end.real, end.imag))
        walled = dataclasses.replace(stands, goal=(goal.real, goal.imag, 0.0), obstacles=barred)
        assert shortest_way(walled, 0.2) == pytest.approx(2.0 * round_end - 0.1, abs=0.06)


def test_a_recording_is_each_robot_s_own_episode() -> None:
    """Beside what single environments tell, step by step, and with the noise of its own seed."""
    env = gymnasium.make_vec(PATH, 2, vectorization_mode="vector_entry_point", scenario="circuits/test",
                             max_episode_steps=40)  # fmt: skip
    law = make("pure_pursuit")
    starts = [Start(5, 1), Start(6, 0), Start(9, 2)]
    found = dict(record(env, law, starts, 0.05))  # type: ignore[arg-type]
    assert sorted(found) == [0, 1, 2]
    most = env.single_action_space.high
    for k, episode in found.items():
        start = starts[k]
        assert episode.start == start
        single = gymnasium.make(PATH, scenario="circuits/test", max_episode_steps=40)
        seen, told = single.reset(seed=start.seed, options={"scenario": start.scenario})
        noise = 0.05 * np.random.default_rng([start.seed, 1]).standard_normal((40, 2))
        digest = hashlib.sha256(f"{start.seed} {start.scenario}".encode())
        for step, action in enumerate(episode.actions):
            np.testing.assert_array_equal(seen, episode.observations[step])
            assert all(episode.infos[name][step] == told[name] for name in episode.infos)
            seen, reward, terminated, truncated, told = single.step(action)
            last = (reward, terminated, truncated)
            assert last == (episode.rewards[step], episode.terminations[step], episode.truncations[step])
        assert last[1] or last[2]
        assert not (episode.terminations | episode.truncations)[:-1].any()
        np.testing.assert_array_equal(seen, episode.observations[-1])
        assert (np.abs(episode.actions) <= most).all()
        alone = gymnasium.make_vec(PATH, 1, vectorization_mode="vector_entry_point", scenario="circuits/test",
                                   max_episode_steps=40)  # fmt: skip
        plain_actions = dict(record(alone, law, [start]))[0].actions  # type: ignore[arg-type]
        # the law has the same to say in the first step; what it asks for there has noise on it
        wanted = np.clip(plain_actions[0] + noise[0] * most, -most, most)
        np.testing.assert_allclose(episode.actions[0], wanted, rtol=1e-6)
        for name in ("observations", "actions", "rewards", "terminations", "truncations"):
            digest.update(getattr(episode, name).tobytes())
        for name, values in episode.infos.items():
            digest.update(name.encode() + values.tobytes())
        assert episode.digest() == digest.digest()
    numbers = 4 * env.task.layout.size + 4 * 2 + 9 * (2 + len(env.task.info_names))  # type: ignore[attr-defined]
    assert robots_for(env, 3) == 3  # type: ignore[arg-type]
    assert robots_for(env, 10**6) == min(512, 256 * 2**20 // (numbers * 41))  # type: ignore[arg-type]
    assert isinstance(found[0], Episode)


def test_a_folder_is_called_by_what_is_not_as_by_default() -> None:
    told = {"policies": ("lqr", "mpc"), "robot": None, "seed": 3, "episodes": 0, "plant": "pymunk", "who": "a b/c"}
    assert default_folder("overview", told) == Path("results/overview-lqr+mpc-seed_3-pymunk-a_b_c")
    assert default_folder("overview", {"scale": 2.5}) == Path("results/overview-scale_2.5")
    long = str(default_folder("x", {"who": "y" * 300}).name)
    whole = "x-" + "y" * 300
    assert long == f"{whole[:120]}-{hashlib.sha256(whole.encode()).hexdigest()[:8]}"
    assert default_folder("x", {"who": "y" * 118}).name == "x-" + "y" * 118


def test_a_table_of_timings_has_a_line_a_policy_and_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[str, str]] = []

    def measured(cases: Any, rounds: int) -> list[Any]:
        seen.extend((case.document, case.policy) for case in cases)
        assert rounds == 2
        return [decisions.Timing(case, batch, 0.5, 1.25) for case in cases for batch in (1, 256)]

    monkeypatch.setattr(decisions, "measured", measured)
    done = CliRunner().invoke(decisions.main, ["--policies", "stanley,ppo", "--rounds", "2"])
    assert done.exit_code == 0, done.output
    assert seen == [("path-following", "stanley"), *((name, "ppo") for name in CONTESTS)]
    plain_lines = ("".join(" " if each in "│┃" else each for each in line) for line in done.output.splitlines())
    words = [line.split() for line in plain_lines if line.strip()]
    assert words[0] == ["Decisions,", "p3dx,", "median", "of", "2", "rounds"]
    heads = " ".join(each for line in words[1:5] for each in line)
    assert all(name in heads for name in ("policy", "robots", "decisions/s", "median", "(ms)", "p99"))
    lines = [line for line in words if "1.250" in line]
    assert [line[-4:] for line in lines[:2]] == [["1", "2,000", "0.500", "1.250"], ["256", "512,000", "0.500", "1.250"]]
    assert len(lines) == 8


@pytest.mark.parametrize("most", [2, 5, 7, 12, 40])
def test_of_very_many_drives_some_of_each_part_are_kept(
    most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts, "MOST_DRIVES", most)
    counts, found, first = [3, 2, 4, 1, 5], [], 0
    wanted = {}
    for k, count in enumerate(counts):
        folder = tmp_path / str(k)
        folder.mkdir()
        write_drives(folder, {i: np.full((2, 3), 10 * k + i, np.int32) for i in range(count)})
        found.append(parts.Part(setting_of(Case("d", "e", PATH, "x", "lqr"), episodes=count), folder))
        for i in range(count):
            is_few = most >= sum(counts)
            if is_few or (i < max(1, most // 5) and k % math.ceil(5 / most) == 0):
                wanted[first + i] = 10 * k + i
        first += count
    assert {row: int(drive[0, 0]) for row, drive in parts.drives_of(found).items()} == wanted


def test_the_clock_of_a_scenario_of_ones_own(tmp_path: Path) -> None:
    """A quarter of a metre a second and twenty seconds more, of thrice the straight way, or of the laps of a path."""
    goal, loop, line = tmp_path / "goal.json", tmp_path / "loop.json", tmp_path / "line.csv"
    told = {"start": [0, 0, 0], "goal": [3, 4, 0.5], "waypoints": [[3, 0]], "obstacles": []}
    goal.write_text(json.dumps(told))
    loop.write_text(json.dumps({"path": [[0, 0], [2, 0], [2, 2], [0, 2]], "closed": True, "laps": 3}))
    line.write_text("0,0\n2,0\n2,1\n")
    found = {file.name: own_scenario(str(file)) for file in (goal, loop, line)}
    lengths = {"goal.json": 3.0 * 7.0, "loop.json": 3.0 * 8.0, "line.csv": 3.0}
    for name, own in found.items():
        assert own.steps == math.ceil(round((lengths[name] / 0.25 + 20.0) / 0.05, 6))
        assert own.file == str(tmp_path / name)
        quantity = own.contest.spec.quantity(own.scenario)
        assert (own.tiered.quantity, own.tiered.tier) == (quantity, own.contest.spec.tier(quantity))
    assert own_scenario(str(line), 2.0).steps == math.ceil(round((6.0 / 0.25 + 20.0) / 0.05, 6))
    assert (own_scenario(str(line), 2.0).env_kwargs, found["goal.json"].env_kwargs) == ({"scale": 2.0}, {})
    with pytest.raises(ValueError, match=r"is 30,000 m long.* at most 10,000 m with --scale, 3\.3e\+03 for example"):
        own_scenario(str(line), 10_000.0)
    with pytest.raises(ValueError, match="--scale belongs to paths"):
        own_scenario(str(goal), 2.0)
    cases = own_cases(str(goal), None, ("polar" if "polar" in POLICIES["goal"] else "dwa", "zero"), "turtlebot3")
    assert [case.policy for case in cases][1] == "zero"
    for case in cases:
        assert (case.document, case.scenario, case.max_episode_steps) == ("goal", str(goal), found["goal.json"].steps)
        assert case.env_kwargs == {**CONTESTS["goal-obstacles"].env_kwargs, "robot": "turtlebot3"}
        assert case.env_id == GOAL
    every = {case.policy: case.filmed for case in own_cases(str(goal))}
    assert {"zero", "random", "ppo", "hybrid"} <= set(every)
    assert [name for name, is_filmed in every.items() if is_filmed] == ["scan_planner"]
    strange = [case.policy for case in own_cases(str(goal), None, None, "turtlebot3")]  # no agents ship for it
    assert not {"ppo", "hybrid"} & set(strange)
    blocked = tmp_path / "blocked.json"
    walls = [{"kind": "box", "x": 3, "y": 4 + side, "length": 3.0, "width": 0.2} for side in (-1.4, 1.4)]
    walls += [{"kind": "box", "x": 3 + side, "y": 4, "length": 0.2, "width": 3.0} for side in (-1.4, 1.4)]
    blocked.write_text(json.dumps({**told, "obstacles": walls}))
    assert without_way(str(goal)) == ""
    assert without_way(str(line)) == ""
    assert "whoever drives there, nobody arrives" in without_way(str(blocked))


def test_the_clock_in_a_maze_is_that_of_its_way_and_of_endless_laps_that_of_one(tmp_path: Path) -> None:
    free = np.full((60, 100), 254, np.uint8)  # cells of 0.1 m; row 0 is the highest
    free[12:, 50] = 0  # a wall from the bottom, that leaves a gap above
    header = f"P5 {free.shape[1]} {free.shape[0]} 255\n".encode()
    (tmp_path / "maze.pgm").write_bytes(header + free.tobytes())
    told = "image: maze.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
    (tmp_path / "maze.yaml").write_text(told + "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"start": [4, 1, 0], "goal": [6, 1, 0], "map": "maze.yaml"}))
    own = own_scenario(str(scene))
    way = shortest_way(own.scenario, 0.1)
    assert way > 7.0 > 2.0  # over the wall's end, not through it
    assert own.steps == math.ceil((3.0 * way / 0.25 + 20.0) / 0.05)
    # a map that was edited since is read anew: neither its picture nor what stands beside it is remembered
    straight = math.ceil((3.0 * 2.0 / 0.25 + 20.0) / 0.05)
    for file, content in (
        ("maze.yaml", (tmp_path / "maze.yaml").read_bytes().replace(b"0.1\n", b"0.2\n")),  # the wall is 10 m away
        ("maze.pgm", header + np.full_like(free, 254).tobytes()),
    ):
        before = (tmp_path / file).read_bytes()
        (tmp_path / file).write_bytes(content)
        assert own_scenario(str(scene)).steps == straight < own.steps, file
        (tmp_path / file).write_bytes(before)
        assert own_scenario(str(scene)).steps == own.steps
    (tmp_path / "endless.json").write_text(json.dumps({"path": [[0, 0], [2, 0], [2, 2]], "closed": True, "laps": 0}))
    endless = own_scenario(str(tmp_path / "endless.json"))
    assert endless.scenario.laps == 0
    assert endless.steps == math.ceil(((4.0 + math.sqrt(8.0)) / 0.25 + 20.0) / 0.05)


def test_a_setting_travels_with_the_files_that_it_names(tmp_path: Path) -> None:
    engine: Any = type("Far", (), {"remote": True})()
    near: Any = type("Near", (), {"remote": False})()
    file = tmp_path / "a" / "b" / "c" / "d" / "bend.json"
    file.parent.mkdir(parents=True)
    file.write_text('{"path": [[0, 0], [2, 0]]}')
    own = setting_of(Case("path", "own", PATH, str(file), "lqr", split="own"))
    home = tmp_path / "runs"
    for seed in (0, 4):
        best = home / f"seed_{seed}" / "best"
        best.mkdir(parents=True)
        (best / "card.json").write_text(f"card {seed}")
        (best / "weights.safetensors").write_bytes(bytes([seed]))
        (best / "folder").mkdir()
    agent = setting_of(Case("d", "e", PATH, "circuits/test", "ppo", {"seed": 4, "home": str(home)}))
    bank = setting_of(Case("d", "e", PATH, "circuits/test", "lqr"))

    def look(setting: Setting) -> tuple[Any, ...]:
        case = setting.case
        scenario = Path(case.scenario).read_text() if Path(case.scenario).is_absolute() else ""
        there = trained(case.gains["home"]) if "home" in case.gains else {}
        told = {seed: sorted(each.read_bytes() for each in folder.iterdir()) for seed, folder in there.items()}
        return case, setting.given, scenario, told

    assert sent(near, look, [own]) == (look, [own])
    function, items = sent(engine, look, [own, agent, bank])
    packed = list(items)
    assert [set(each.files) for each in packed] == [
        {str(file)}, {str(home / "seed_4" / "best" / name) for name in ("card.json", "weights.safetensors")}, set()
    ]  # fmt: skip
    assert str(packed[0]) == str(own)
    (case, given, scenario, _), of_agent, of_bank = map(function, packed)
    assert (scenario, given) == (file.read_text(), own.case)
    assert case.scenario != str(file)
    assert Path(case.scenario).parts[-4:] == file.parts[-4:]
    assert dataclasses.replace(case, scenario=str(file)) == own.case
    assert of_agent[1] == agent.case
    assert of_agent[3] == {4: sorted([b"card 4", bytes([4])])}
    assert of_agent[0].gains["home"] != str(home)
    assert of_bank[:2] == (bank.case, None)


def test_a_timing_is_the_median_and_the_ninety_ninth_of_a_hundred(monkeypatch: pytest.MonkeyPatch) -> None:
    class Driver:
        def __init__(self, case: Case, batch: int) -> None:
            self.case, self.batch = case, batch
            self.times: list[float] = []

        def drive(self, steps: int) -> None:
            assert steps == {1: 200, 256: 20, 3: 50}[self.batch]
            self.times += [1e-3 * self.batch * (len(self.times) + k) for k in range(steps)]

    monkeypatch.setattr(decisions, "_Driver", Driver)
    cases = [Case("d", "e", PATH, "x", policy) for policy in ("a", "b")]
    found = decisions.measured(cases, (1, 3, 256), 3)
    assert [(each.case.policy, each.batch) for each in found] == [(p, b) for p in "ab" for b in (1, 3, 256)]
    for each in found:
        count = 3 * {1: 200, 256: 20, 3: 50}[each.batch]
        assert each.median_ms == pytest.approx(each.batch * (count - 1) / 2.0)
        assert each.p99_ms == pytest.approx(each.batch * 0.99 * (count - 1))


@pytest.mark.parametrize("ladder", [False, True])
def test_decisions_are_timed_after_all_else_alone_on_the_machine(
    ladder: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[Any] = []

    class Busy(Ahead):
        """Processes that have other work left."""

        def __init__(self) -> None:
            pass

        def settle(self) -> None:
            done.append("settled")

    def noted(name: str, returned: Any = None) -> None:
        monkeypatch.setattr(contest_report, name, lambda *given, **more: done.append((name, *given, more)) or returned)

    for name, returned in (("run_contest", ("rows", "trajectories")), ("parts_of", "parts"), ("drives_of", "drives")):
        noted(name, returned)
    for name in ("write_rows", "write_trajectories", "write_drives", "write_worlds", "write_decisions"):
        noted(name)
    noted("measured", "timings")
    asked: Any = types.SimpleNamespace(ladder=ladder, timed=lambda: "cases")
    engine, stage = Busy(), tmp_path / "stage"
    contest_report._play(asked, [], tmp_path, stage, engine)
    assert done[:3] == [
        ("run_contest", [], tmp_path, engine, {}),
        ("write_rows", stage, "rows", {}),
        ("write_trajectories", stage, "trajectories", {}),
    ]
    assert ("write_drives", stage, "drives", {}) in done
    last = [("measured", "cases", {"batches": (1,), "rounds": 2}), ("write_decisions", stage, "timings", {})]
    assert done[-3:] == ["settled", *last] or ladder
    assert ("settled" in done) is not ladder


def test_decisions_alone_are_timed_once_all_is_compiled_and_ended_robots_begin_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = types.SimpleNamespace(now=0.0)
    told: list[Any] = []

    class Env:
        """Its second robot ends with every fourth step that is asked for; a step takes a long time."""

        steps = 0

        def reset(self, seed: int) -> Any:
            told.append(("env", seed))
            return 0, {}

        def step(self, actions: Any) -> Any:
            self.steps += 1
            clock.now += 1000.0
            ends = np.array([False, self.steps % 4 == 0])
            return self.steps, None, ends, np.zeros(2, bool), {}

    class Pilot:
        def __init__(self, policy: Any, env: Any) -> None:
            self.asked = 0

        def reset(self, rows: Any = None) -> None:
            told.append(None if rows is None else list(rows))

        def command(self, seen: int) -> None:
            self.asked += 1
            clock.now += 500.0 if self.asked == 1 else 2.0 + self.asked  # the first compiles
            told.append(seen)

    monkeypatch.setattr(decisions, "make_vector", lambda *_: Env())
    monkeypatch.setattr(decisions, "make_policy", lambda *_: "policy")
    monkeypatch.setattr(decisions, "Pilot", Pilot)
    monkeypatch.setattr(decisions, "time", types.SimpleNamespace(perf_counter=lambda: clock.now))
    driver = decisions._Driver(Case("d", "e", PATH, "x", "a"), 2)
    assert driver.times == []
    driver.drive(4)
    # the fourth step, the first of these, ended a robot: its reset took the fifth; so did the eighth
    assert driver.times == [6.0, 7.0, 8.0, 9.0]
    assert told == [("env", 0), None, 0, 1, 2, 3, [1], 5, 6, 7, [1]]


@pytest.mark.parametrize(("scenario", "closed"), [("circuits/test", True), ("splines/test", False)])
def test_a_driven_path_is_told_with_what_belongs_to_it(scenario: str, closed: bool) -> None:
    case = Case(
        "path-following", "x", PATH, scenario, "pure_pursuit", max_episode_steps=30, every_scenario=True, split="t"
    )
    first, second = roll_out(case, actuators="lagged", seed=3, episodes=2)
    bank = splits.split("path_following", *scenario.split("/"))
    for trajectory, told in zip((first, second), bank, strict=False):
        path = told.path
        assert path.closed == closed
        assert trajectory.lap_length == pytest.approx(path.length if closed else 0.0)
        laps = max(told.laps, 1)
        assert trajectory.completion == pytest.approx(trajectory.arc_lengths.max() / (path.length * laps))
        points = np.vstack([path.points, path.points[:1]]) if closed else path.points
        np.testing.assert_allclose(trajectory.path, points, atol=1e-9)
        assert len(trajectory.times) == len(trajectory.poses) == 31
        assert trajectory.times.tolist() == pytest.approx([0.05 * k for k in range(31)])
        assert not trajectory.success
        if told.laps:
            assert trajectory.goals[0, :2] == pytest.approx(points[-1])
            way = points[-1] - points[-2]
            assert trajectory.goals[0, 2] == pytest.approx(math.atan2(way[1], way[0]), abs=1e-6)


@pytest.mark.parametrize(
    ("options", "said"),
    [({"seed": -1}, "seed"), ({"seed": 2**31}, "seed"), ({"workers": 0}, "workers"), ({"gains": "bst"}, "best"),
     ({"actuators": "lagy"}, "actuators"), ({"dynamics": "coppelia"}, "dynamics"),
     # the largest are taken, and what is wrong behind them is told
     ({"seed": 2**31 - 1, "workers": 64, "episodes": 10_000, "families": ["nowhere"]}, "nowhere"),
     ({"episodes": 0}, "episodes"), ({"episodes": 10_001}, "episodes")],
)  # fmt: skip
def test_compare_refuses_what_it_cannot_do(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        compare(["pure_pursuit"], **{"contest": "path-following", **options})


def test_what_a_policy_of_ones_own_is_called_and_has(tmp_path: Path) -> None:
    @dataclasses.dataclass
    class Mine:
        k: float = 1.0
        name: str = "x"
        whole: int = 3
        more: tuple[int, ...] = ()

    assert own_policies.OwnObject(Mine(k=2.0, more=(1,)), 1).gains == {"k": 2.0}
    assert own_policies.OwnObject(Mine(name="y", whole=4), 2).gains == {"name": "y", "whole": 4}
    assert own_policies.OwnObject(object(), 1).gains == {}
    model = tmp_path / "my model.zip"
    assert own_policies.source_and_gains(f'"{model}" k=2')[0] == str(model)
    with pytest.raises(ValueError, match="model"):
        own_policies.source_and_gains(str(model))  # two words, where there is no such file
    model.write_bytes(b"")
    for named in (str(model), f"PPO:{model}"):
        assert own_policies.source_and_gains(named) == (named, {})
    folder = tmp_path / "an agent"  # of what is no model, words are words, whatever there is
    folder.write_bytes(b"")
    assert own_policies.source_and_gains(f'"{folder}"')[0] == str(folder)
    with pytest.raises(ValueError, match="agent"):
        own_policies.source_and_gains(str(folder))
    assert own_policies.source_and_gains("m:C k=2 b=true name=x y=2.5") == (
        "m:C", {"k": 2, "b": True, "name": "x", "y": 2.5},
    )  # fmt: skip


def test_spaces_are_alike_to_a_rounding() -> None:
    box_of = gymnasium.spaces.Box
    space = box_of(-np.float32([1.0, 2.0]), np.float32([1.0, 2.0]))
    for low, high, alike in (
        (-1.0, 1.0, True), (-1.000005, 1.0, True), (-1.0, 1.000005, True), (-1.0001, 1.0, False), (-1.0, 1.0001, False),
    ):  # fmt: skip
        other = box_of(np.float32([low, -2.0]), np.float32([high, 2.0]))
        assert own_policies._alike(other, space) == alike
    assert not own_policies._alike(box_of(-1.0, 1.0, (2, 1)), space)
    assert not own_policies._alike(gymnasium.spaces.Discrete(2), space)


def test_whose_episode_has_ended_begins_anew() -> None:
    told: list[tuple[str, list[int]]] = []

    class Asked:
        def __init__(self, name: str) -> None:
            self.name = name

        def reset(self, rows: Any) -> None:
            told.append((self.name, rows.tolist()))

    worlds: Any = type("Worlds", (), {"worlds": type("Parts", (), {"rows": [slice(0, 3), slice(3, 5), slice(5, 9)]})})
    ended = np.array([False, True, True, False, False, True, False, False, True])
    Shaped.tell(worlds, [Asked("a"), Asked("b"), Asked("c")], ended)  # type: ignore[list-item]
    assert told == [("a", [1, 2]), ("c", [0, 3])]


def test_parts_of_a_run_that_is_done_are_deleted_and_others_stay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for others in (False, True):
        home = tmp_path / str(others) / "unfinished"
        mine = [parts.Part(setting=None, folder=home / name) for name in ("a", "b")]  # type: ignore[arg-type]
        for folder in (home, *(part.folder for part in mine), *([home / "theirs"] if others else [])):
            folder.mkdir(parents=True)
            (folder / "rows.json").touch() if folder != home else (folder / parts._MARK).touch()
        parts.clear_parts(mine)
        told = capsys.readouterr().err
        assert home.exists() is others
        assert told == (f"{home} holds parts of other runs; they stay there\n" if others else "")
        if others:
            assert sorted(each.name for each in home.iterdir()) == sorted((parts._MARK, "theirs"))


def test_a_space_in_short_is_its_shape_and_its_first_bounds() -> None:
    box_of = gymnasium.spaces.Box
    few = box_of(np.float32([-1.0, -2.5]), np.float32([1.0, 0.5]))
    assert own_policies._space(few) == "Box(2,) of -1..1 -2.5..0.5"
    many = box_of(-np.ones(4, np.float32), np.float32([1.0, 2.0, 3.0, 4.0]))
    assert own_policies._space(many) == "Box(4,) of -1..1 -1..2 -1..3 ..."
    assert own_policies._space(box_of(-1.0, 1.0, (3,))) == "Box(3,) of -1..1 -1..1 -1..1"
    assert own_policies._space(gymnasium.spaces.Discrete(2)) == "Discrete(2)"
