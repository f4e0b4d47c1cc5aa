"""Timed references: what they say is one motion, what a base can follow is proven, the environment keeps to both."""

import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.kinematics import integrate_arc
from wayfield.envs.robots.references import RAMP, SAMPLE, base_of, fill, lay_out
from wayfield.envs.scenarios import TASKS, path_scenarios, split
from wayfield.envs.scenarios.reference_families import REFERENCE_FAMILIES, REFERENCE_SCENARIOS
from wayfield.envs.scenarios.reference_proofs import FLOOR, PROVERS, proof
from wayfield.system.objects import FileNote

IDS = TASKS["trajectory_tracking"].ids
DT = 0.05


def laid(scenario: Any, robot: str, tier: str = "lagged", ramp: float = RAMP) -> Any:
    base = base_of(ROBOTS[robot], ROBOTS[robot].actuators(tier), DT)
    holonomic = ROBOTS[robot].holonomic
    closed = scenario.path.closed
    return lay_out(scenario.knots_of(holonomic), closed, scenario.share, ramp if closed else 0.0, base, holonomic), base


@pytest.mark.parametrize("family", REFERENCE_FAMILIES)
def test_columns_are_derivatives_and_twists_lead_along_the_poses(family: str) -> None:
    for holonomic in (False, True):
        scenario = split("trajectory_tracking", family, "test")[0]
        knots = scenario.knots_of(holonomic)
        clock, n = 30.0, 60_000
        h = clock * float(knots[-1, 0]) / n
        s = np.zeros(n + 1, SAMPLE)
        fill(knots, clock, 0.0, h, False, s)
        heading = np.unwrap(s["heading"])
        for name, rate in (("vx", "vx_rate"), ("vy", "vy_rate"), ("yaw_rate", "yaw_acceleration")):
            # where pieces of a curve meet, an acceleration may jump
            off = np.abs(np.gradient(s[name], h) - s[rate])[2:-2]
            assert np.quantile(off, 0.995) < 1e-3
        assert np.abs(np.gradient(heading, h) - s["yaw_rate"])[2:-2].max() < 1e-3
        if not holonomic:
            assert np.abs(s["vy"]).max() < 1e-5  # no base without such wheels is asked to go sideways
        x, y, turn = (float(s[name][0]) for name in ("x", "y", "heading"))
        windows = (np.lib.stride_tricks.sliding_window_view(s[name], 11)[::10] for name in ("vx", "vy", "yaw_rate"))
        for mean in zip(*(each.mean(axis=1).tolist() for each in windows), strict=True):
            x, y, turn = integrate_arc(x, y, turn, *mean, 10 * h)  # by exact arcs of the mean twist
        assert math.hypot(x - s["x"][-1], y - s["y"][-1]) < 1e-3


@pytest.mark.parametrize(("name", "clocks"), [("eight_2m", {"p3dx": 21.0, "kobuki": 35.9, "jackal": 12.7})])
def test_the_clock_is_scaled_until_the_share_is_taken(name: str, clocks: dict[str, float]) -> None:
    (scenario,) = REFERENCE_SCENARIOS[name]()
    for robot, clock in clocks.items():
        found, _ = laid(scenario, robot, ramp=0.0)
        assert found.clock == pytest.approx(clock, abs=0.051)
        assert found.worst[:4].max() == pytest.approx(scenario.share, rel=5e-3)


@pytest.mark.parametrize("family", REFERENCE_FAMILIES)
def test_what_is_frozen_can_be_followed_and_what_is_too_fast_cannot(family: str) -> None:
    for scenario in split("trajectory_tracking", family, "test")[:2]:
        for robot in PROVERS:
            found, base = laid(scenario, robot)
            limited, floor = proof(found, base, ROBOTS[robot].holonomic)
            assert (limited == 0 and floor < FLOOR) == (scenario.share <= 1.0), (scenario.name, robot)


def test_a_lap_comes_again_and_an_end_is_held() -> None:
    env: Any = gymnasium.make(IDS[False], scenario="eight_2m", actuators="lagged", begins="rolling").unwrapped
    task, state = env.task, env.batch.states[0]
    lap = int(task.world.times["lap"][0])
    env.reset(seed=0)
    for k in (0, 7, lap - 1):
        state["steps"] = k
        first = task.reference_at(state).copy()
        state["steps"] = k + 3 * lap
        assert task.reference_at(state) == first
    held: Any = gymnasium.make(IDS[False], scenario="min_jerk/test", actuators="lagged").unwrapped
    held.reset(seed=0)
    state = held.batch.states[0]
    state["steps"] = 100_000
    assert held.task.reference_at(state)["vx"] == 0.0


def test_rewards_are_those_of_the_sheet_and_the_cost_is_told_whatever_they_are() -> None:
    told = {}
    for reward in ("bounded", "quadratic", "exp"):
        env = gymnasium.make(IDS[False], scenario="eight_2m", actuators="lagged", reward=reward)
        env.reset(seed=3)
        before = env.unwrapped.batch.states[0]["command_yaw_rate"].item()  # type: ignore[attr-defined]
        _, told[reward], _, _, info = env.step(np.array([0.3, 0.5]))
        state = env.unwrapped.batch.states[0]  # type: ignore[attr-defined]
        turned = abs(state["command_yaw_rate"] - before) / (3.0 * DT)
    assert told["bounded"] == pytest.approx(1.0 / (1.0 + (info["position_error"] / 0.05) ** 2) - 0.02 * turned)
    assert told["quadratic"] == pytest.approx(-info["cost"])
    assert told["exp"] == pytest.approx(math.exp(-info["cost"]), rel=1e-12)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"times": [0, 3, 3, 10]}, r"times\[2\] is 3 after 3; times must increase"),
        ({"times": [0, 3, 6]}, "times is 3 numbers; the path has 4 points"),
        ({}, "times are missing"),
        ({"times": [0, 1, 2, 3]}, r"takes [\d.]+ times this base's acceleration at [\d.]+ s; give it more time there;"),
        ({"times": [0, 9, 18, 27], "headings": [0, 0, 1.5, 1.5]}, r"moves sideways at [\d.]+ m/s at [\d.]+ s"),
        ({"times": [0, 9, 18, 27], "headings": [0, 90, 90, 180]}, r"headings\[1\] is 90; headings are in rad"),
        ({"times": [0, 9, 18, 27], "start": [2, 0, 0]}, "up to 2 m from where the reference begins"),
        ({"times": [0, 9, 18, 1e6]}, r"times go on for 1e\+06 s; a reference lasts at most 100000 s"),
        (
            {"reference": [[0, 0], [2, 0], [0, 0]], "times": [0, 9, 18]},
            "turn it along the path",
        ),
        (
            {"reference": [[0.05 * k, 0.01 * (k % 2)] for k in range(40)], "times": [0.1 * k for k in range(40)]},
            "give it more time there, or keep fewer points if they tremble",
        ),
    ],
)
def test_what_cannot_be_followed_is_refused_in_a_line(tmp_path: Path, more: dict[str, Any], told: str) -> None:
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"reference": [[0, 0], [1, 0.3], [2, 0], [3, 0.5]], **more}))
    with pytest.raises(ValueError, match=told) as found:
        gymnasium.make(IDS[False], scenario=str(file), actuators="lagged")
    assert len(str(found.value).splitlines()) == 1


@pytest.mark.parametrize(
    "header", ["t,x,y", "time_ms,x,y", "time[us],x,y", "%time,field.position.x,field.position.y", ""]
)
@pytest.mark.parametrize("first", [0.0, 1.7e9])
def test_a_table_with_times_is_the_reference_of_the_lists(tmp_path: Path, header: str, first: float) -> None:
    points, times = [[0, 0], [1, 0.3], [2, 0], [0, 0]], [0.0, 4.0, 8.0, 16.0]
    tick = {"time_ms,x,y": 1e3, "time[us],x,y": 1e6}.get(header, 1e9 if "field" in header and first else 1.0)
    tail = "" if header else " 0 0 0 0 1"
    rows = [f"{(first + t) * tick:.0f} {x} {y}{tail}" for t, (x, y) in zip(times, points, strict=True)]
    (tmp_path / "mine.csv").write_text("\n".join([header, *rows]).replace(" ", ",") if header else "\n".join(rows))
    (tmp_path / "named.json").write_text('{"reference": "mine.csv"}')
    (tmp_path / "lists.json").write_text(json.dumps({"reference": points, "times": [first + t for t in times]}))
    found = [path_scenarios(str(tmp_path / each), 1.0, TASKS["trajectory_tracking"])[0].knots
             for each in ("mine.csv", "named.json", "lists.json")]  # fmt: skip
    np.testing.assert_allclose(found[0], found[2], atol=1e-5)
    np.testing.assert_array_equal(found[0], found[1])


def test_times_in_milliseconds_are_noticed(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"reference": [[0, 0], [1, 0.3], [2, 0]], "times": [0, 4000, 9000]}))
    with pytest.warns(FileNote, match=r"the path is driven at 0\.\d+ mm/s, in 9000 s; times are in seconds"):
        gymnasium.make(IDS[False], scenario=str(file), actuators="lagged")


@pytest.mark.parametrize(
    ("points", "times", "headings"),
    [
        ([[0, 0], [1, 0.3], [2, 0], [2, 1.2], [0, 0]], [0.0, 4.0, 8.0, 13.0, 20.0], [0, 1, 2, 1, 0]),
        ([[0, 0], [3, 0.5]], [0.0, 10.0], [0, 0.5]),
    ],
)
def test_points_of_a_file_are_passed_at_their_times_from_the_first_on(
    tmp_path: Path, points: list[list[float]], times: list[float], headings: list[float]
) -> None:
    file = tmp_path / "mine.json"
    stamps = [100.0 + each for each in times]
    file.write_text(json.dumps({"reference": points, "times": stamps, "headings": headings}))
    env: Any = gymnasium.make(IDS[True], scenario=str(file), actuators="lagged").unwrapped
    env.reset(seed=0)
    state = env.batch.states[0]
    for point, time, heading in zip(points, times, headings, strict=True):
        state["steps"] = round(time / DT)
        here = env.task.reference_at(state)
        assert (here["x"], here["y"], here["heading"]) == pytest.approx((*point, heading), abs=1e-9)
