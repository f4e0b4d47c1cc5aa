"""Paths as planners, recorders and designers write them: every law gets to the end, or the path is warned of."""

import dataclasses
import itertools
import math
import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from wayfield import policies
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import PATH_SCENARIOS, PathScenario, path_scenarios
from wayfield.envs.scenarios.path_families import PATH_FAMILIES
from wayfield.envs.tasks.briefing import Course
from wayfield.envs.world.paths import Path, PathPool, doubt
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.policy import check_robot
from wayfield.policies.parts.rehearsal import PathLost
from wayfield.policies.parts.steering import Motion
from wayfield.policies.pilot import Pilot
from wayfield.policies.registry import PATHS, entering
from wayfield.policies.trained.ppo import shipped
from wayfield.system.objects import FileNote

Array = NDArray[np.float64]
LAWS = entering(PATHS)


def driven(policy: str, paths: list[Path], robot: str = "p3dx", **gains: Any) -> tuple[Array, Array]:
    """Returns the times (b,) to the end, NaN without, and the RMS cross-track errors (b,)."""
    kind = "DiffDrive" if robot == "p3dx" else "Omni"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileNote)
        env: Any = gymnasium.make_vec(
            f"wayfield/{kind}PathFollowing-v0",
            len(paths),
            vectorization_mode="vector_entry_point",
            scenario=[PathScenario(f"path_{i}", path) for i, path in enumerate(paths)],
            robot=robot,
            actuators="lagged",
            max_episode_steps=round(20.0 * (10.0 + 5.0 * max(path.length for path in paths))),
        )
    seen, _ = env.reset(seed=0, options={"scenario": np.arange(len(paths))})
    pilot = Pilot(policies.make(policy, **gains), env)
    pilot.reset()
    times, squares, steps = np.full(len(paths), np.nan), np.zeros(len(paths)), np.zeros(len(paths))
    going = np.ones(len(paths), bool)
    while going.any():
        seen, _, terminated, truncated, info = env.step(pilot.command(seen))
        steps += going
        squares += going * info["cross_track_error"] ** 2
        times[going & info["success"]] = 0.05 * steps[going & info["success"]]
        going &= ~(terminated | truncated)
    return times, np.sqrt(squares / steps)


def turned(points: Any, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points, float) @ np.array([[c, s], [-s, c]])


def stairs(length: float, slope: float, cell: float, neighbours: int) -> Array:
    """Returns the way (n, 2) along a line over the cells of a grid; the slope in rad, up to 45 degrees."""
    columns = max(round(length * math.cos(slope) / cell), 1)
    rows = round(length * math.sin(slope) / cell)
    at = [(k, round(k * rows / columns)) for k in range(columns + 1)]
    if neighbours == 4:
        at = [at[0], *(p for a, b in itertools.pairwise(at) for p in ((b[0], a[1]), b) if p != a)]
    return cell * np.array([p for p, q in zip(at, [None, *at], strict=False) if p != q], float)


@st.composite
def of_planners(draw: Any) -> Path:
    """Draws the way over a grid with one bend, its exact goal appended or not."""
    cell = draw(st.sampled_from([0.025, 0.05, 0.075, 0.1]))
    first, second = (
        stairs(draw(st.floats(1.0, 4.0)), draw(st.floats(0.0, math.pi / 4)), cell, draw(st.sampled_from([4, 8])))
        for _ in range(2)
    )
    way = np.vstack([first, first[-1] + turned(second, draw(st.sampled_from([0.0, 0.5, -0.5])) * math.pi)[1:]])
    if draw(st.booleans()):
        offset = 0.5 * cell * np.array([draw(st.floats(-1.0, 1.0)), draw(st.floats(-1.0, 1.0))])
        way = np.vstack([way, way[-1] + offset]) if np.abs(offset).max() > 1e-9 else way
    return Path(turned(way, draw(st.floats(-3.0, 3.0))))


@st.composite
def of_recorders(draw: Any) -> Path:
    """Draws a track of uneven spacing with noise, on which the robot stood for a while."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    t = np.cumsum(rng.uniform(0.2, 1.8, 200)) * draw(st.sampled_from([0.005, 0.02, 0.05]))
    t = np.concatenate([t[:100], np.full(draw(st.sampled_from([0, 30])), t[99]), t[100:]])
    noise = draw(st.sampled_from([1e-6, 1e-4, 1e-3, 5e-3, 0.01, 0.03]))
    return Path(np.column_stack([t, 0.4 * np.sin(t)]) + rng.normal(0.0, noise, (len(t), 2)))


@st.composite
def of_designers(draw: Any) -> Path:
    """Draws a polyline of wide legs, on which points may nearly coincide, a spline or a circuit."""
    kind = draw(st.sampled_from(["legs", "sine", "circle", "circuit", "lawn", "zigzag"]))
    angles = np.linspace(0.0, 2.0 * math.pi, draw(st.sampled_from([24, 200])), endpoint=kind == "circle")
    if kind in ("circle", "circuit"):
        radius = draw(st.floats(0.6, 1.5))
        return Path(radius * np.column_stack([np.cos(angles), np.sin(angles)])[: -1 or None], kind == "circuit")
    if kind == "sine":
        t = np.linspace(0.0, 6.0, draw(st.sampled_from([40, 300, 3000])))
        return Path(np.column_stack([t, 0.4 * np.sin(2.0 * t)]))
    if kind in ("lawn", "zigzag"):
        turn, rows = (0.5 * math.pi, draw(st.floats(0.2, 1.2))) if kind == "lawn" else (draw(st.floats(0.4, 2.6)), 0.0)
        turns = np.cumsum([0.0, *([turn, turn, -turn, -turn] if rows else [turn, -turn]) * 2])
        legs = np.where(np.arange(len(turns)) % 2 * rows > 0.0, rows, draw(st.floats(0.8, 4.0)))
        return Path(np.cumsum(legs[:, None] * np.column_stack([np.cos(turns), np.sin(turns)]), axis=0))
    points, heading = [np.zeros(2)], draw(st.floats(-3.0, 3.0))
    for _ in range(draw(st.integers(1, 3))):
        ahead = np.array([math.cos(heading), math.sin(heading)])
        points.append(points[-1] + draw(st.floats(0.8, 2.0)) * ahead)
        step = draw(st.sampled_from([0.0, 1e-9, 1e-6, 1e-3, 0.01, 0.02]))
        aside = heading + draw(st.sampled_from([0.5, 1.0])) * math.pi
        if step > 0.0:
            points.append(points[-1] + step * np.array([math.cos(aside), math.sin(aside)]))
        heading += draw(st.floats(-1.6, 1.6))
    return Path(points)


written = of_planners() | of_recorders() | of_designers()


def each_ends_or_is_warned_of(paths: list[Path], laws: list[str], robot: str) -> None:
    paths = [path for path in paths if not doubt(path)]
    for law in laws if paths else []:
        times, _ = driven(law, paths, robot)
        for path in itertools.compress(paths, ~(times > 0.0)):
            with pytest.warns(PathLost, match="is likely not to get to the end of the path"):
                driven(law, [Path(path.points, path.closed)], robot)


@settings(max_examples=3)
@given(st.lists(written, min_size=4, max_size=4))
def test_every_law_gets_to_the_end_or_the_path_is_warned_of(paths: list[Path]) -> None:
    each_ends_or_is_warned_of(paths, LAWS, "p3dx")


@pytest.mark.slow
@settings(max_examples=8)
@given(st.lists(written, min_size=20, max_size=20), st.sampled_from(["p3dx", "omni3", "mecanum4"]))
def test_every_law_on_every_base_gets_to_the_end_or_the_path_is_warned_of(paths: list[Path], robot: str) -> None:
    each_ends_or_is_warned_of(paths, [law for law in LAWS if law != "ppo" or shipped("path_following", robot)], robot)


@pytest.mark.parametrize("seed", [0, 1, 4])
def test_agents_do_not_stand_for_ever_before_corners_that_follow_each_other_closely(seed: int) -> None:
    quarters = 0.5 * math.pi * np.arange(8)
    squares = [side * np.column_stack([np.cos(quarters), np.sin(quarters)]).cumsum(axis=0) for side in (0.3, 0.4, 0.5)]
    lawns = [
        np.array([(length * (k % 4 in (1, 2)), rows * (k // 2)) for k in range(8)])
        for length, rows in itertools.product((1.5, 2.0, 2.5, 3.0), (0.2, 0.3, 0.5))
    ]
    times, _ = driven("ppo", [Path(points) for points in (*squares, *lawns)], seed=seed)
    assert (times > 0.0).all(), times


@pytest.mark.parametrize("cell", [0.025, 0.05, 0.1])
@pytest.mark.parametrize("law", ["ilqr", "mpc"])
def test_stairs_take_a_law_that_plans_no_longer_than_lqr_nor_farther_off(law: str, cell: float) -> None:
    paths = [
        Path(turned(stairs(4.0, math.radians(slope), cell, neighbours), 0.37))
        for slope in (5.0, 11.0, 22.5, 30.0, 40.0, 45.0)
        for neighbours in (4, 8)
    ]
    for cells, step in itertools.product((1, 2), ((0, 1), (1, 1))):  # short ways, with a corner close to an end
        way = [(k, 0) for k in range(round(1.0 / cell))]
        way += [(way[-1][0] + k * step[0], k * step[1]) for k in range(1, cells + 1)]
        paths += [Path(cell * np.array(way)), Path(cell * np.array(way[::-1]))]
    (times, errors), (of_lqr, off) = driven(law, paths), driven("lqr", paths)
    assert (times <= 1.2 * of_lqr).all(), times / of_lqr
    assert errors.mean() <= off.mean()


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_corners_that_follow_each_other_closely_take_ilqr_no_longer_than_lqr_nor_farther_off(robot: str) -> None:
    paths = []
    for leg, angle, turns in itertools.product((0.6, 1.0), (0.5, 0.8, 1.2, 1.57, 2.0), ("+-", "++--", "+")):
        headings = np.cumsum([0.3, *(angle if sign == "+" else -angle for sign in (turns * 6)[:6])])
        legs = leg * np.column_stack([np.cos(headings), np.sin(headings)])
        paths.append(Path(np.cumsum(legs, axis=0)))
    paths = [path for path in paths if not doubt(path)]
    (times, errors), (of_lqr, off) = driven("ilqr", paths, robot), driven("lqr", paths, robot)
    assert (times <= 1.2 * of_lqr).all(), times / of_lqr
    assert errors.mean() <= off.mean()


@pytest.mark.parametrize("law", ["ilqr", "mpc"])
def test_a_hairpin_is_driven_round_by_a_law_that_plans(law: str) -> None:
    ways = [
        (1.0 + leg * math.cos(a), leg * math.sin(a)) for leg in (0.4, 2.0) for a in np.radians((155, 167, 175, 178))
    ]
    times, errors = driven(law, [Path([(-1.0, 0.0), (1.0, 0.0), way]) for way in ways])
    assert (times > 0.0).all(), times
    assert (errors < 0.01).all()


@pytest.mark.parametrize("law", ["ilqr", "mpc", "stanley"])
def test_a_point_that_nearly_coincides_with_another_changes_nothing(law: str) -> None:
    for bend in (0.0, 0.35, 1.57):
        leg = 2.0 * np.array([math.cos(bend), math.sin(bend)])
        paths = [Path([(0.0, 0.0), (2.0, 0.0), (2.0 + leg[0], leg[1])])]
        for step in (1e-9, 1e-4, 1e-3, 0.02):
            for aside in (90.0, 135.0, 180.0):
                x, y = 2.0 + step * math.cos(math.radians(aside)), step * math.sin(math.radians(aside))
                paths.append(Path([(0.0, 0.0), (2.0, 0.0), (x, y), (x + leg[0], y + leg[1])]))
        times, errors = driven(law, paths)
        assert times == pytest.approx(times[0], abs=0.5)
        assert errors == pytest.approx(errors[0], abs=0.01)


@pytest.mark.parametrize("law", LAWS)
def test_a_step_back_at_either_end_ends_the_path_or_is_warned_of(law: str) -> None:
    curve = np.column_stack([np.sin(np.linspace(0, 2, 100)), 1 - np.cos(np.linspace(0, 2, 100))])
    paths = []
    for way in (np.array([[0.0, 0.0], [4.0, 0.0]]), stairs(2.0, 0.5, 0.05, 8), curve):
        heading = math.atan2(*(way[-1] - way[-2])[::-1])
        for step in (1e-9, 0.01, 0.049):
            for aside in (0.5, 0.75, 1.0):
                at = heading + aside * math.pi
                stepped = np.vstack([way, way[-1] + step * np.array([math.cos(at), math.sin(at)])])
                paths += [Path(stepped), Path(stepped[::-1])]
    assert not any(map(doubt, paths[::2]))
    times, _ = driven(law, [path for path in paths if not doubt(path)])
    assert (times > 0.0).all(), times


def test_curves_and_corners_are_left_as_they_are_and_not_warned_of() -> None:
    for name in [*PATH_SCENARIOS, *(f"{family}/test" for family in PATH_FAMILIES)]:
        paths = [scenario.path for scenario in path_scenarios(name)]
        pool = PathPool.of(paths)
        motion = Motion(np.zeros((1, 3)), np.zeros((1, 2)), np.array([0.1]))
        course = Course.of(pool, np.zeros(1, np.int64))
        driven_course, driven_motion = smoothed(course, motion)
        assert driven_course is course
        assert driven_motion is motion
        assert not any(map(doubt, paths))


def test_a_track_that_trembles_is_warned_of(tmp_path: Any) -> None:
    t = np.arange(0.0, 4.0, 0.02)
    track = np.column_stack([t, 0.0 * t]) + np.random.default_rng(0).normal(0.0, 0.03, (len(t), 2))
    np.savetxt(tmp_path / "track.csv", track, "%.6f", ",")
    with pytest.warns(UserWarning, match=r"track: the path goes back and forth over \d\d% of its length"):
        gymnasium.make("wayfield/DiffDrivePathFollowing-v0", scenario=str(tmp_path / "track.csv"))
    with pytest.warns(UserWarning, match="mine: the path turns back 0.08 m before its end"):
        gymnasium.make(
            "wayfield/DiffDrivePathFollowing-v0",
            scenario=PathScenario("mine", Path([(0.0, 0.0), (3.0, 0.0), (2.92, 0.0)])),
        )


def test_a_path_that_leads_straight_back_is_warned_of_and_a_wiggle_is_not() -> None:
    for way in (
        [(0.0, 0.0), (3.0, 0.0), (0.0, 0.0)],
        [(0.0, 0.0), (3.0, 0.0), (0.0, 0.3)],
        [(0.0, 0.0), (3.0, 0.0), (3.0, 0.05), (0.0, 0.05)],
        [(0.0, 0.0), (-0.02, 0.0), (3.0, 0.0)],
    ):
        assert "turns straight back" in doubt(Path(way))
    assert not doubt(Path([(0.0, 0.0), (2.0, 0.0), (1.98, 0.0), (5.0, 0.0)]))


def test_a_hole_in_a_recording_is_warned_of_and_a_line_between_curves_is_not() -> None:
    t = np.arange(0.0, 12.0, 0.05)
    track = np.column_stack([t, np.sin(t)])
    assert doubt(Path(np.delete(track, np.s_[60:120], axis=0))).startswith("has a hole of 3")
    turn = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 30)
    end = np.column_stack([8.0 + np.cos(turn), 1.0 + np.sin(turn)])
    assert not doubt(Path(np.vstack([end, [0.0, 2.0] - (end - [8.0, 0.0])]), closed=True))
    lanes = [(x, 0.3 * k) for k in range(12) for x in ((0.0, 9.0) if k % 2 == 0 else (9.0, 0.0))]
    assert "hole" not in doubt(Path(lanes))


def test_a_car_is_told_of_laws_that_drive_one() -> None:
    """Where a path is lost; the others turn on the spot, and refuse it."""
    for radius, instead in ((0.0, "lqr, stanley or regulated_pure_pursuit"), (3.0, "lqr")):
        robot = dataclasses.replace(ROBOTS["p3dx"], name="car", turning_radius=radius)
        env: Any = gymnasium.make(
            "wayfield/DiffDrivePathFollowing-v0", scenario="polylines_150/test", robot=robot, actuators="slow"
        )
        env.reset(seed=0)
        law = policies.make("pure_pursuit", lookahead_distance=0.01, speed=1.2)
        with pytest.warns(PathLost, match=f"; choose {instead}$"):
            Pilot(law, env).reset()
        for name in instead.replace(",", "").replace(" or", "").split():
            check_robot(policies.make(name), robot)
