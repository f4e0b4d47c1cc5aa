"""What comes in has bounds: a wrong value is one clear line; none corrupts memory, hangs or raises something else."""

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path as FilePath
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import sensing
from wayfield.envs.scenarios import GoalScenario, PathScenario, goal_scenarios, path_scenarios
from wayfield.envs.scenarios.curves import circle_path
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.envs.world.paths import Path, PathPool, nearest_ahead, walk_to
from wayfield.system import checks

PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
GOAL_ID = "wayfield/OmniGoalObstacles-v0"
RING = Path([(0.0, 0.0), (1.0, 0.0), (0.5, 1.0)], closed=True)
WILD = [math.nan, math.inf, -math.inf, 1e20, -1e20, 1e300, 1e160, 0.0, 1.0]


def finished(code: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Returns how a fresh interpreter ran the code: what may end in a signal or never cannot be run in this one."""
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True, text=True, timeout=300, env=os.environ | environment, check=False,
    )  # fmt: skip


# ---- numbers that enter


@pytest.mark.parametrize(
    ("env_id", "field", "value"),
    [
        (PATH_ID, "noise", 1e300),
        (PATH_ID, "scale", 1e-320),
        (PATH_ID, "num_preview", 10**9),
        (PATH_ID, "robot", ["p3dx"]),
        (PATH_ID, "shove", (0.0, 0.0, 0.0, 1e20)),
        (PATH_ID, "shove", ("1", "2", "3", "4")),
        (GOAL_ID, "num_beams", 10**9),
        (GOAL_ID, "field_of_view", 1e-300),
    ],
)
def test_an_argument_out_of_bounds_is_one_line_that_names_it(env_id: str, field: str, value: Any) -> None:
    with pytest.raises((TypeError, ValueError)) as caught:
        gymnasium.make(env_id, **{field: value})
    assert field in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(("num_envs", "clock"), [(10**9, 100), (10**400, 100), (2, 10**400), (2, 0), (2, 1.5)])
def test_sizes_of_a_vector_are_bounded(num_envs: int, clock: Any) -> None:
    with pytest.raises(ValueError, match="num_envs" if num_envs > 2 else "max_episode_steps"):
        gymnasium.make_vec(PATH_ID, num_envs, vectorization_mode="vector_entry_point", max_episode_steps=clock)


@given(st.floats(-checks.MOST_TURN, checks.MOST_TURN))
def test_a_heading_is_wrapped_within_a_turn_to_the_same_direction(angle: float) -> None:
    wrapped = checks.heading("heading", angle)
    assert abs(wrapped) <= 2.0 * math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)
    if abs(angle) <= 2.0 * math.pi:
        assert wrapped == angle


@pytest.mark.parametrize("value", [1e20, 1e300, math.inf, math.nan, 10**400, -1.1e6])
def test_what_is_no_angle_any_more_is_refused(value: float) -> None:
    for make_one in (
        lambda: GoalScenario("far", (1.0, 0.0, value)),
        lambda: GoalScenario("far", (1.0, 0.0, 0.0), start=(0.0, 0.0, value)),
        lambda: PathScenario("far", RING, start=(0.0, 0.0, value)),
    ):
        with pytest.raises(ValueError, match=r"(goal|start)\[2\] is"):
            make_one()
    if value > 0.0 or math.isnan(value):
        for make_one in (
            lambda: GoalScenario("far", (1.0, 0.0, 0.0), start_turn=value),
            lambda: PathScenario("far", RING, start_turn=value),
        ):
            with pytest.raises(ValueError, match="start_turn is"):
                make_one()


def test_a_point_that_is_no_float_is_a_short_line() -> None:
    deep: list[Any] = []
    deep.append(deep)
    for points in ([(0, 0), (10**400, 0)], deep, [(0, "x" * 100_000)]):
        with pytest.raises(ValueError, match="path") as refused:
            Path(points)
        assert len(str(refused.value)) < 300


# ---- files


def written(folder: FilePath, name: str, content: Any) -> str:
    """Returns the name of a file with the content: bytes, or an object as JSON."""
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    return str(file)


def test_files_and_lists_that_are_too_large_are_not_read(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "huge.csv"
    with file.open("wb") as stream:
        stream.truncate(checks.MOST_BYTES + 1)  # takes no room on the disk
    with pytest.raises(ValueError, match=r"huge\.csv:1: holds more than"):
        path_scenarios(str(file))
    monkeypatch.setattr("wayfield.envs.scenarios.tables.MOST_POINTS", 10)
    long = written(tmp_path, "long.csv", b"".join(b"%d,0\n" % i for i in range(12)))
    with pytest.raises(ValueError, match=r"long\.csv:11: the table has 12 points"):
        path_scenarios(long)


@pytest.mark.parametrize("name", ["a\0b.json", "\udcff.csv", "x" * 5000 + ".json"])
def test_what_is_no_file_name_is_said(name: str) -> None:
    for scenarios in (path_scenarios, lambda each: goal_scenarios(each, 0.3)):
        with pytest.raises((ValueError, OSError)):
            scenarios(name)


# ---- compiled code, whatever it is given


@settings(max_examples=200)
@given(
    st.lists(st.sampled_from(WILD), min_size=8, max_size=8), st.sampled_from([(8, 2.0 * math.pi), (7, 3.0), (1, 1.0)])
)
def test_a_scan_writes_its_own_beams_only(values: list[float], scan: tuple[int, float]) -> None:
    count, view = scan
    angles = sensing.beam_angles(count, view)
    step = angles[1] - angles[0] if count > 1 else 2.0 * math.pi
    obstacles = np.zeros((1, 2), OBSTACLE)
    obstacles[0, 0] = (values[0], values[1], 1.0, 0.0, 0.0, 0.0, values[2], 0.0, (0.0,) * 6)
    obstacles[0, 1] = (values[3], values[4], 0.6, 0.8, values[2], abs(values[1]), 0.0, 0.0, (0.0,) * 6)
    ranges = np.full((1, 3 * count + 8), -7.0)
    beams = np.ascontiguousarray(sensing.beam_directions(angles).T)
    room = np.empty(sensing.ROOM), np.empty(0, np.float32), np.empty(0, np.uint64)
    lidar = sensing.Lidar(beams, float(angles[0]), float(step), 5.0, *room)
    sensing.scan_ranges(lidar, obstacles, 0, 2, 0, (values[5], values[6], values[7]), ranges, 0, count + 4)
    own = slice(count + 4, 2 * count + 4)
    assert (np.delete(ranges, np.r_[own]) == -7.0).all()
    assert not (ranges[0, own] > 5.0).any()


@pytest.mark.parametrize("path", [RING, Path([(0.0, 0.0), (2.0, 0.0)]), circle_path(1.0)])
@pytest.mark.parametrize("s", [*WILD, -3.0, 1e6, 7.7])
def test_the_path_search_ends_on_the_path(path: Path, s: float) -> None:
    pool = PathPool.of([path])
    run = pool.runs[0]
    *_, segment = walk_to(pool.vertices, run, s, 0)
    assert 0 <= segment < run["segments"]
    for x in WILD:
        for window in (1.0, math.inf, math.nan):
            _, segment = nearest_ahead(pool.vertices, run, x, 0.5, s, 0, window)
            assert 0 <= segment < run["segments"]


def test_a_corrupt_state_ends_neither_the_process_nor_never() -> None:
    """The readers refuse what would get here; the kernels must stand it all the same."""
    code = f"""
import gymnasium, numpy as np, wayfield
for value in {[each for each in WILD if not math.isnan(each)]!r}[:7]:
    for env_id in ({PATH_ID!r}, {GOAL_ID!r}):
        env = gymnasium.make(env_id).unwrapped
        env.task.world.courses["start"][:, 2] = value
        env.reset(seed=0)
        env.step(env.action_space.high)
        for name in ("shove_x", "shove_heading"):
            env = gymnasium.make(env_id, shove=(0.0, 0.0, 0.0, 0.0)).unwrapped
            env.task.params[name] = value
            env.reset(seed=0)
            env.step(env.action_space.high)
            env.step(env.action_space.high)
print("ended")
"""
    done = finished(code.replace("inf", "float('inf')"))
    assert (done.returncode, done.stdout) == (0, "ended\n"), done.stderr


# ---- seeds and options of a reset


@pytest.mark.parametrize("seed", [-1, -(10**400), 2**128, 10**400])
def test_seeds_out_of_range_are_refused(seed: int) -> None:
    single = gymnasium.make(PATH_ID).unwrapped
    vector: Any = gymnasium.make_vec(PATH_ID, 2, vectorization_mode="vector_entry_point")
    for reset in (single.reset, vector.reset, lambda seed: vector.reset(seed=[0, seed])):
        with pytest.raises(ValueError, match="seed"):
            reset(seed=seed)
    with pytest.raises(ValueError, match="seed"):
        vector.reset(seed=2**128 - 1)  # the second robot's would be 2**128


@pytest.mark.parametrize("seed", ["1", 1.5, True, [1], {}])
def test_seeds_of_another_type_are_refused(seed: Any) -> None:
    single = gymnasium.make(PATH_ID).unwrapped
    vector: Any = gymnasium.make_vec(PATH_ID, 2, vectorization_mode="vector_entry_point")
    with pytest.raises(TypeError, match="seed must be a whole number"):
        single.reset(seed=seed)
    with pytest.raises((TypeError, ValueError), match="seed"):
        vector.reset(seed=seed)
    with pytest.raises(TypeError, match=r"seed\[1\] must be a whole number"):
        vector.reset(seed=[0, seed])


def test_large_seeds_are_seeds() -> None:
    for seed in (99_999_999_999, np.int64(5), np.uint64(2**64 - 1), 2**128 - 1):
        env = gymnasium.make(PATH_ID).unwrapped
        assert (env.reset(seed=seed)[0] == gymnasium.make(PATH_ID).unwrapped.reset(seed=int(seed))[0]).all()


def test_an_episode_is_made_again_from_the_seed_that_was_drawn_for_it() -> None:
    env = gymnasium.make(GOAL_ID).unwrapped
    first, _ = env.reset()
    drawn = env.np_random_seed
    assert drawn >= 2**64  # NumPy's, with all but one chance in 2^64
    again, _ = gymnasium.make(GOAL_ID).unwrapped.reset(seed=drawn)
    np.testing.assert_array_equal(again, first)
    np.testing.assert_array_equal(env.reset(seed=drawn)[0], first)
    many: Any = gymnasium.make_vec(GOAL_ID, 2, vectorization_mode="vector_entry_point")
    rows, _ = many.reset()
    np.testing.assert_array_equal(many.reset(seed=list(many.np_random_seed))[0], rows)


@pytest.mark.parametrize("options", ["scenario", 1, [("scenario", 1)], 0, ""])
def test_options_of_another_type_are_refused(options: Any) -> None:
    for env in (
        gymnasium.make(PATH_ID).unwrapped,
        gymnasium.make_vec(PATH_ID, 2, vectorization_mode="vector_entry_point"),
    ):
        with pytest.raises(TypeError, match="options must be a dict or None"):
            env.reset(options=options)  # type: ignore[attr-defined]


# ---- the end of the lap


@pytest.mark.parametrize("spacing", [0.3, 2.5, 7.0, 100.0])
def test_a_preview_longer_than_the_lap_goes_round_again(tmp_path: FilePath, spacing: float) -> None:
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    file = written(tmp_path, "square.json", {"path": corners, "closed": True, "laps": 0})
    env: Any = gymnasium.make(PATH_ID, scenario=file, preview_spacing=spacing, num_preview=9).unwrapped
    preview = env.task.layout.unpack(env.reset(seed=0)[0][None]).preview[0]
    for k, (x, y) in enumerate(preview.tolist()):
        s = (k + 1) * spacing % 4.0
        side, along = int(s) % 4, s % 1.0
        a, b = np.array(corners[side]), np.array(corners[(side + 1) % 4])
        np.testing.assert_allclose((x, y), a + along * (b - a), atol=1e-5)


def test_arc_length_never_falls() -> None:
    env: Any = gymnasium.make_vec(PATH_ID, 64, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(150):
        *_, info = env.step(rng.uniform(-1.0, 0.3, (64, 2)) * env.single_action_space.high)
        assert (info["progress"] >= 0.0).all()


@pytest.mark.parametrize(
    ("typed", "known", "meant"),
    [
        ("lr", ["clip", "learning_rate"], "learning_rate"),
        ("lookahead", ["speed", "lookahead_distance"], "lookahead_distance"),
        ("Pure-Pursuit", ["mpc", "pure_pursuit"], "pure_pursuit"),
        ("DiffDrivePathFollowing-v0", ["wayfield/OmniTeam-v0", "wayfield/DiffDrivePathFollowing-v0"], None),
        ("max_steps", ["scenario", "max_episode_steps"], "max_episode_steps"),
        ("circle", ["P3DX", "circles"], "circles"),
        ("p3dx", ["omni3", "P3DX"], "P3DX"),
        ("diff", ["omni", "differential"], "differential"),
    ],
)
def test_the_nearest_name_is_the_one_that_was_meant(typed: str, known: list[str], meant: str | None) -> None:
    assert checks.suggestion(typed, known) == f" Did you mean {meant or known[-1]!r}?"
    with pytest.raises(ValueError, match=re.escape(repr(meant or known[-1]))):
        checks.choose("name", typed, known)


@pytest.mark.parametrize("word", ["", "x", "zzzzzz", None, 5, "\0", "__", "-"])
def test_what_is_near_nothing_has_no_suggestion(word: object) -> None:
    assert checks.suggestion(word, ["learning_rate", "pure_pursuit", ""]) == ""
