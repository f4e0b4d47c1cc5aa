"""Every environment id: Gymnasium's contract, the documented equations, bad input, and any scenario whatever."""

import itertools
import json
import math
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from hypothesis import event, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.bits import differences
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.disturbances import DISTURBANCES
from wayfield.envs.scenarios import TASKS
from wayfield.envs.tasks.specs import spec_of

DT = 0.05
PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
GOAL_ID = "wayfield/OmniGoalObstacles-v0"
OMNI_PATH_ID = "wayfield/OmniPathFollowing-v0"
DIFF_GOAL_ID = "wayfield/DiffDriveGoalObstacles-v0"
OMNI_DOCK_ID, DIFF_DOCK_ID = "wayfield/OmniDocking-v0", "wayfield/DiffDriveDocking-v0"
PATH_IDS = (PATH_ID, OMNI_PATH_ID)
ROBOTS_OF = {
    env_id: ["omni3", "omni4"] if holonomic else ["p3dx"]
    for spec in TASKS.values()
    for holonomic, env_id in spec.ids.items()
}
IDS = [name for spec in TASKS.values() for name in spec.ids.values()]  # of one robot; teams have tests of their own
EVERY_ROBOT = [(env_id, robot) for env_id in IDS for robot in ROBOTS_OF[env_id]]
EVERY_KIND = [
    (env_id, {"robot": robot, "dynamics": dynamics, "action_mode": action_mode})
    for env_id in IDS
    for robot in ROBOTS_OF[env_id]
    for dynamics in ("kinematic", "pymunk")
    for action_mode in ("twist", "wheel_speeds")
]
# each robot on both plants, in both action modes
SOME_KINDS = [kind for k, kind in enumerate(EVERY_KIND) if k % 4 in (0, 3)]
some_kinds = pytest.mark.parametrize(("env_id", "options"), SOME_KINDS)
every_kind = pytest.mark.parametrize(
    ("env_id", "options"),
    EVERY_KIND,
    ids=["-".join([env_id.split("/")[1], *options.values()]) for env_id, options in EVERY_KIND],
)
every_id = pytest.mark.parametrize("env_id", IDS)


def plain(env_id: str, path: str, goal: str) -> str:
    """Returns the name of a scenario of the task that starts at the origin."""
    named = dict.fromkeys(PATH_IDS, path) | dict.fromkeys((GOAL_ID, DIFF_GOAL_ID), goal)
    return named.get(env_id) or next(iter(spec_of(env_id).presets))


def written(folder: Path, name: str = "scenario.json", **fields: Any) -> str:
    file = folder / name
    file.write_text(json.dumps(fields))
    return str(file)


def base(env_id: str, **kwargs: Any) -> Any:
    """Returns a freshly reset environment without wrappers."""
    env = gymnasium.make(env_id, **kwargs).unwrapped
    env.reset(seed=0)
    return env


def actions_of(env: Any, count: int, seed: int = 0, scale: float = 1.0) -> NDArray[np.float32]:
    most = env.action_space.high
    draws = np.random.default_rng(seed).uniform(-scale, scale, (count, *most.shape))
    return (draws * most).astype(np.float32)


def rollout(env: Any, actions: NDArray[Any], seed: int = 3) -> list[Any]:
    """Returns all that an environment says to a row of actions, starting anew where an episode ends."""
    said = [env.reset(seed=seed)]
    for action in actions:
        result = env.step(action)
        said.append(result)
        if result[2] or result[3]:
            said.append(env.reset())
    return said


def run_alone(code: str, folder: Path) -> str:
    """Returns what a fresh interpreter prints, started in another folder."""
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


# The contract.


@every_kind
def test_checkers_of_gymnasium_and_stable_baselines_are_content(env_id: str, options: dict[str, str]) -> None:
    with warnings.catch_warnings():
        # both advise to normalise: actions are metres and radians here
        warnings.simplefilter("ignore", UserWarning)
        check_env(gymnasium.make(env_id, **options).unwrapped, skip_render_check=True)
        check_env_of_sb3(gymnasium.make(env_id, **options))


@some_kinds
def test_a_spec_survives_being_written_to_json(env_id: str, options: dict[str, str]) -> None:
    env = gymnasium.make(env_id, **options, noise=1.0, shove=(0.5, 0.2, -0.1, 0.3), actuators="lagged")
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    actions = actions_of(env, 80)
    assert not differences(rollout(env, actions), rollout(again, actions))


def test_make_imports_the_package_by_itself(tmp_path: Path) -> None:
    # two ids, each in a child of one process, which has gymnasium alone
    ids = [IDS[0], IDS[-1]]
    code = (
        "import gymnasium, os, sys\n"
        f"for env_id in {ids!r}:\n"
        "    if os.fork() == 0:\n"
        "        print(gymnasium.make('wayfield:' + env_id).reset(seed=5)[0].tolist(), flush=True)\n"
        "        os._exit(0)\n"
        "    assert os.wait()[1] == 0, env_id\n"
        "assert 'wayfield' not in sys.modules\n"
    )
    said = [json.loads(line) for line in run_alone(code, tmp_path).splitlines()]
    assert said == [gymnasium.make(env_id).reset(seed=5)[0].tolist() for env_id in ids]


def test_making_an_environment_does_not_import_drawing_or_learning(tmp_path: Path) -> None:
    """Nor does what commands import call compiled code, for which Numba would make ready: a third of their start."""
    code = "import gc, sys, gymnasium, wayfield, wayfield.benchmarks.runs.suite\n"
    code += "from numba.core.dispatcher import Dispatcher\n"
    code += "print([each for each in gc.get_objects() if isinstance(each, Dispatcher) and each.overloads])\n"
    code += f"for env_id in {list(IDS)!r}:\n    gymnasium.make(env_id).reset()\n"
    code += "    print(env_id, sorted({'torch', 'matplotlib', 'pygame', 'pymunk'} & set(sys.modules)))"
    assert run_alone(code, tmp_path).splitlines() == ["[]", *(f"{env_id} []" for env_id in IDS)]


@every_id
def test_calls_out_of_order_are_refused(env_id: str) -> None:
    env = gymnasium.make(env_id).unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(env.action_space.high)
    with pytest.raises(ValueError, match="options"):
        env.reset(options={"start": 1})


@every_id
def test_an_option_of_reset_chooses_the_scenario(env_id: str) -> None:
    env = base(env_id, noise=1.0)
    drawn, _ = env.reset(seed=6)
    scenario = int(env.batch.states["scenario"][0])
    actions = actions_of(env, 70)
    run = [env.step(action)[0] for action in actions]
    following, _ = env.reset()
    # the choice of what would have been drawn changes nothing, now or later
    assert env.reset(seed=6, options={"scenario": scenario})[0].tobytes() == drawn.tobytes()
    assert [env.step(action)[0].tobytes() for action in actions] == [each.tobytes() for each in run]
    assert env.reset(options={})[0].tobytes() == following.tobytes()
    # another choice changes the scenario alone
    env.reset(seed=6)
    env.reset()
    state = env.batch.states[0].copy()
    env.reset(seed=6, options={"scenario": np.int64(0)})
    env.reset(options=None)
    assert env.batch.states[0].tobytes() == state.tobytes()
    for k in range(len(env.task.scenarios)):
        env.reset(options={"scenario": k})
        assert env.batch.states["scenario"][0] == k


@pytest.mark.parametrize("env_id", [PATH_ID, GOAL_ID])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scenarios": 1}, "options key='scenarios' is unknown. Did you mean 'scenario'?"),
        ({"scenario": 320}, "options['scenario'] must be an int from 0 to {last}, got 320"),
        ({"scenario": [1, 2]}, "options['scenario'] must be an int from 0 to {last}, got [1, 2]"),
    ],
)
def test_bad_options_of_reset_are_named(env_id: str, options: dict[str, Any], message: str) -> None:
    env = base(env_id)
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared in full
        env.reset(seed=2, options=options)
    assert message.replace("{last}", str(len(env.task.scenarios) - 1)) in str(caught.value)
    # the refused reset drew nothing
    env.reset(seed=1)
    following, _ = env.reset()
    env.reset(seed=1)
    for seed in (None, 5):
        with pytest.raises(ValueError, match="options"):
            env.reset(seed=seed, options=options)
    assert env.np_random_seed == 1
    assert env.reset()[0].tobytes() == following.tobytes()


@some_kinds
def test_results_are_not_overwritten_by_later_steps(env_id: str, options: dict[str, str]) -> None:
    env = base(env_id, **options)
    first, _ = env.reset(seed=0)
    results = [first, *(env.step(action)[0] for action in actions_of(env, 5))]
    copies = [result.copy() for result in results]
    env.reset(seed=9)
    assert all(map(np.array_equal, results, copies))


# Observations.


@some_kinds
def test_fields_are_the_flat_observation_in_order(env_id: str, options: dict[str, str]) -> None:
    env = base(env_id, **options)
    layout = env.task.layout
    observations = np.stack([env.step(action)[0] for action in actions_of(env, 6)])
    for shape in ((6,), (2, 3), (1, 6, 1)):
        shaped = observations.reshape(*shape, -1)
        fields = layout.unpack(shaped)
        assert all(value.shape == (*shape, *field.shape) for value, field in zip(fields, layout.fields, strict=True))
        packed = np.concatenate([value.reshape(*shape, -1) for value in fields], axis=-1)
        assert packed.tobytes() == observations.tobytes()
    assert type(fields) is layout.kind
    assert tuple(field.name for field in layout.fields) == layout.kind._fields
    with pytest.raises(ValueError, match=str(layout.size)):
        layout.unpack(observations[:, :-1])
    single = layout.unpack(observations[0])
    assert np.concatenate([np.ravel(value) for value in single]).tobytes() == observations[0].tobytes()


def fields_of(env: Any, observation: NDArray[np.float32]) -> Any:
    """Returns the named fields of one observation."""
    layout = env.unwrapped.task.layout
    return layout.kind(*(value[0] for value in layout.unpack(observation[None])))


# Rewards and ends.


@pytest.mark.parametrize("corridor", [0.3, 0.8])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_leaving_the_corridor_fails(tmp_path: Path, corridor: float, side: float) -> None:
    heading = side * math.pi / 2.0
    line = written(tmp_path, path=[[-1, 0], [9, 0]], corridor=corridor, start=[0, 0, heading])
    env = base(PATH_ID, scenario=line)
    for _ in range(100):
        _, reward, terminated, _, info = env.step(np.array([1.0, 0.0], np.float32))
        if terminated:
            break
    assert info["left_corridor"]
    assert not info["success"]
    assert reward == pytest.approx(-10.0)
    assert corridor < side * info["cross_track_error"] <= corridor + 0.05


@pytest.mark.parametrize("laps", [1, 2, 3])
def test_laps_are_counted(tmp_path: Path, laps: int) -> None:
    square = [[0, 0], [2, 0], [2, 2], [0, 2]]
    env = base(PATH_ID, scenario=written(tmp_path, path=square, closed=True, laps=laps))
    state = env.batch.states[0]
    at, corners = np.arange(5) * 2.0, np.array([*square, square[0]], float)
    ended = None
    for s in np.arange(0.0, 8.0 * laps + 0.2, 0.1):
        x, y = (np.interp(s % 8.0, at, corners[:, k]) for k in range(2))
        state["x"], state["y"] = x, y
        _, _, terminated, _, info = env.step(np.zeros(2, np.float32))
        assert info["arc_length"] == pytest.approx(s, abs=1e-9)
        assert info["completion"] == pytest.approx(s / (8.0 * laps))
        if terminated:
            ended = s
            break
    assert ended == pytest.approx(8.0 * laps, abs=0.051)
    assert info["success"]


def test_a_self_crossing_does_not_mislead_the_projection() -> None:
    env = base(PATH_ID, scenario="figure_eight")
    state, vertices = env.batch.states[0], env.task.pool.vertices
    lap = vertices["s"][-1]
    for s in np.arange(0.0, 2.5 * lap, 0.11):
        x, y = (np.interp(s % lap, vertices["s"], vertices[name]) for name in ("x", "y"))
        k = np.searchsorted(vertices["s"], s % lap, side="right") - 1
        state["x"], state["y"] = x, y
        state["heading"] = math.atan2(vertices["uy"][k], vertices["ux"][k])
        _, _, terminated, _, info = env.step(np.zeros(2, np.float32))
        assert not terminated
        assert info["arc_length"] == pytest.approx(s, abs=1e-6)
        assert abs(info["cross_track_error"]) < 1e-9
        assert abs(info["heading_error"]) < 1e-6


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
@pytest.mark.parametrize(("robot", "speed"), [("omni3", 1.0), ("omni4", 0.4), ("omni3", 14.0)])
def test_driving_into_a_wall_is_a_collision(tmp_path: Path, dynamics: str, robot: str, speed: float) -> None:
    ahead = {"kind": "wall", "x1": 2.0, "y1": -9.0, "x2": 2.0, "y2": 9.0}
    env = base(GOAL_ID, scenario=written(tmp_path, goal=[5, 0, 0], obstacles=[ahead]), robot=robot, dynamics=dynamics)
    for _ in range(200):
        _, reward, terminated, _, info = env.step(np.array([speed, 0.0, 0.0]))
        assert info["clearance"] > -1e-4
        if terminated:
            break
    assert info["collision"]
    assert not info["success"]
    assert reward < -4.0
    assert info["clearance"] == pytest.approx(0.0, abs=1e-4)
    if speed <= 1.0 and dynamics == "kinematic":
        assert info["time"] == pytest.approx((2.0 - ROBOTS[robot].hull_radius) / speed, abs=DT)
        assert info["clearance"] >= 0.0


@some_kinds
def test_the_clock_truncates(env_id: str, options: dict[str, str]) -> None:
    scenario = plain(env_id, "circle", "apf_1")
    assert gymnasium.spec(env_id).max_episode_steps == 1200
    env = gymnasium.make(env_id, scenario=scenario, **options, max_episode_steps=7)
    env.reset(seed=0)
    for k in range(7):
        _, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, np.float32))
        assert not terminated
        assert truncated == (k == 6)
        assert info["time"] == pytest.approx((k + 1) * DT)


def test_waypoints_are_passed_in_their_order(tmp_path: Path) -> None:
    places = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    scenario = written(tmp_path, goal=[0, 1, 0], waypoints=[[1, 0], [1, 1]], waypoint_radius=0.2, heading_tolerance=3.2)
    for order, passed, success in (
        ((0, 3), 0, False),
        ((0, 2, 3), 0, False),
        ((0, 1, 3), 1, False),
        ((0, 1, 2, 3), 2, True),
    ):
        env = base(GOAL_ID, scenario=scenario)
        state = env.batch.states[0]
        for k in order:
            state["x"], state["y"] = places[k]
            _, _, terminated, _, info = env.step(np.zeros(3, np.float32))
        assert info["waypoint"] == passed
        assert (info["success"], terminated) == (success, success)
    # all that are near enough at once, at the start and on the way
    close = [[0.1, 0.0], [0.0, 0.1], [2.0, 0.0], [2.1, 0.0], [2.0, 0.1], [0.1, 0.1]]
    env = base(GOAL_ID, scenario=written(tmp_path, goal=[5, 0, 0], waypoints=close, waypoint_radius=0.2))
    observation, info = env.reset()
    assert (info["waypoint"], fields_of(env, observation).waypoints_left) == (2, 4)
    env.batch.states["x"] = 2.0
    observation, *_, info = env.step(np.zeros(3, np.float32))
    assert (info["waypoint"], fields_of(env, observation).waypoints_left) == (5, 1)


# Motion.


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
@pytest.mark.parametrize(("env_id", "robot"), EVERY_ROBOT)
def test_both_action_modes_mean_the_same_motion(env_id: str, robot: str, dynamics: str) -> None:
    scenario = plain(env_id, "straight", "open_field")
    options: dict[str, Any] = {"robot": robot, "dynamics": dynamics, "scenario": scenario, "actuators": "lagged"}
    twist, wheels = (base(env_id, **options, action_mode=mode) for mode in ("twist", "wheel_speeds"))
    for action in actions_of(twist, 60).astype(np.float64):
        twist.step(action)
        wheels.step(ROBOTS[robot].wheel_speeds_from_twist(action))
    for name in ("x", "y", "heading", "vx", "vy", "yaw_rate"):
        assert twist.batch.states[name] == pytest.approx(wheels.batch.states[name], abs=1e-9)


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
@pytest.mark.parametrize("pose_source", ["ground_truth", "odometry"])
@every_id
def test_a_shove_displaces_the_pose_once(env_id: str, dynamics: str, pose_source: str) -> None:
    scenario = plain(env_id, "straight", "omni3_goal")
    options: dict[str, Any] = {"scenario": scenario, "dynamics": dynamics, "pose_source": pose_source}
    env = base(env_id, **options, shove=(0.2, 0.3, -0.4, 0.5))
    state = env.batch.states[0]
    for k in range(9):
        env.step(np.zeros(env.action_space.shape, np.float32))
        wanted = (0.3, -0.4, 0.5) if k >= 4 else (0.0, 0.0, 0.0)
        assert (state["x"], state["y"], state["heading"]) == pytest.approx(wanted, abs=1e-9)
        assert (state["vx"], state["vy"], state["yaw_rate"]) == (0.0, 0.0, 0.0)
        # encoders do not see it, but for passive wheels on the floor of the physics engine
        passive = bool(env.task.robot.encoders)
        if pose_source == "odometry" and not (passive and dynamics == "pymunk"):
            assert (state["measured_x"], state["measured_y"], state["measured_heading"]) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("way", [3.0, 0.3])
def test_a_shove_ends_at_an_obstacle_and_so_does_the_drive(tmp_path: Path, way: float) -> None:
    ahead = {"kind": "wall", "x1": 1.0, "y1": -9.0, "x2": 1.0, "y2": 9.0}
    scenario = written(tmp_path, goal=[-5, 0, 0], obstacles=[ahead])
    env = base(GOAL_ID, scenario=scenario, shove=(0.1, way, 0.0, 0.0))
    twist = np.array([0.2, 0.3, 0.4], np.float32)
    for k in range(3):
        observation, _, terminated, _, info = env.step(twist)
        met = k == 2 and way > 1.0
        assert terminated == info["collision"] == met
        # a shove that meets nothing is no motion of the wheels
        np.testing.assert_allclose(env.task.layout.unpack(observation).twist, 0.0 * twist if met else twist, rtol=1e-6)
    assert (0.0 <= info["clearance"] < 1e-6) == met


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_a_kinematic_hull_gets_into_nothing(robot: str, scale: float) -> None:
    env_id = TASKS["goal_reaching"].env_id(ROBOTS[robot])
    env: Any = gymnasium.make_vec(env_id, 64, scenario="mixed", robot=robot, num_beams=1)
    env.reset(seed=0)
    hull = ROBOTS[robot].hull_radius
    collisions = 0
    for k in range(200):
        if k % 20 == 0:
            actions = scale * actions_of(env, 1, seed=k)[0]
        _, _, _, _, info = env.step(actions)
        collisions += info["collision"].sum()
        states = env.batch.states
        o = env.batch.obstacles[states["field"]]
        assert (info["clearance"] >= 0.0).all()
        # not the formula under test: the nearest point of each turned rectangle
        dx, dy = states["x"][:, None] - o["x"], states["y"][:, None] - o["y"]
        along, across = o["cos"] * dx + o["sin"] * dy, o["cos"] * dy - o["sin"] * dx
        out = [v - np.clip(v, -h, h) for v, h in ((along, o["half_length"]), (across, o["half_width"]))]
        gap = (np.hypot(*out) - o["radius"]).min(axis=1)
        # of a rectangle, the discs in it and around it
        assert (states["clearance"] >= gap - hull - 1e-12).all()
        assert (states["clearance"] <= gap - ROBOTS[robot].least_half + 1e-12).all()
        # not through the thin walls of the square either, at 15 m/s
        assert (np.maximum(abs(states["x"]), abs(states["y"])) <= 5.0 - ROBOTS[robot].least_half).all()
    assert collisions > (50 if ROBOTS[robot].max_twist[0] > 1.0 else 5)  # slow robots meet less


def test_starts_are_scattered_but_never_over_an_obstacle(tmp_path: Path) -> None:
    ahead = {"kind": "box", "x": 0.0, "y": 0.9, "length": 3.0, "width": 1.0}
    scenario = written(tmp_path, goal=[5, -5, 0], obstacles=[ahead], start_offset=0.4, start_turn=0.5)
    env: Any = gymnasium.make_vec(GOAL_ID, 200, scenario=scenario)
    _, info = env.reset(seed=0)
    states = env.batch.states
    assert (info["clearance"] > 0.0).all()
    for name, most in (("x", 0.4), ("y", 0.4), ("heading", 0.5)):
        assert np.abs(states[name]).max() <= most
        assert states[name].min() < -0.3 * most
    assert states["heading"].max() > 0.3 * 0.5


# Bad input.

BAD_ACTIONS = [
    (math.nan, ValueError),
    (math.inf, ValueError),
    ("short", ValueError),
    ("deep", ValueError),
    ("ragged", (ValueError, TypeError)),
    (None, TypeError),
    ("forward", TypeError),
    (True, TypeError),
    (1j, TypeError),
]


def spoiled(kind: Any, like: NDArray[np.float32]) -> Any:
    """Returns an action that is no action, of the size of a good one where it can be."""
    match kind:
        case None | "forward":
            return kind
        case "short":
            return like[..., :-1]
        case "deep":
            return like[None]
        case "ragged":
            return [[0.0, 1.0], [0.0]]
        case bool():
            return np.ones(like.shape, bool)
    bad = like.astype(complex if isinstance(kind, complex) else np.float64)
    bad.flat[-1] = kind
    return bad


@pytest.mark.parametrize(
    ("env_id", "options", "kind", "error"),
    [(*SOME_KINDS[k % len(SOME_KINDS)], *bad) for k, bad in enumerate([*BAD_ACTIONS, *BAD_ACTIONS[::-1]])],
)
def test_a_bad_action_is_refused_and_changes_nothing(
    env_id: str, options: dict[str, str], kind: Any, error: Any
) -> None:
    # 63 steps: the next one draws new noise
    disturbed, calm = (base(env_id, **options, noise=1.0, shove=(3.2, 0.1, 0.0, 0.0)) for _ in range(2))
    actions = 0.2 * actions_of(calm, 66)
    for action in actions[:63]:
        disturbed.step(action)
        calm.step(action)
    # all but which of its random numbers comes next: new ones may have been drawn
    fields = [name for name in disturbed.batch.states.dtype.names if name != "noise_row"]
    before = disturbed.batch.states.copy()
    with pytest.raises(error):
        disturbed.step(spoiled(kind, actions[0]))
    assert disturbed.batch.states[fields].tolist() == before[fields].tolist()
    for action in actions[63:]:
        assert not differences(disturbed.step(action), calm.step(action))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dynamics": "pymnk"}, "dynamics='pymnk' is unknown. Did you mean 'pymunk'?"),
        ({"robot": "omni5"}, "robot='omni5' is unknown."),
        ({"noise": -0.1}, "noise must be a finite number >= 0 (0 is none, 1 nominal), got -0.1"),
        ({"disturbance": "sever"}, "disturbance='sever' is unknown. Did you mean 'severe'?"),
        ({"shove": (1.0, 2.0)}, "shove must be (time >= 0, dx, dy, turn), four finite numbers, got (1.0, 2.0)"),
    ],
)
@pytest.mark.parametrize("env_id", [PATH_ID, GOAL_ID])
def test_bad_options_are_named(env_id: str, options: dict[str, Any], message: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # Gymnasium warns of the render mode, then asks us
        with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared in full
            gymnasium.make(env_id, **options)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("env_id", "options", "message"),
    [
        (PATH_ID, {"scenario": "figure_ate"}, "'figure_ate'. Did you mean 'figure_eight'?"),
        (PATH_ID, {"scale": 0.0}, "scale is 0.0; it must be a finite number above 0"),
        (PATH_ID, {"robot": "omni3"}, "robot 'omni3' has the drive omni; this environment needs differential"),
        (PATH_ID, {"pose_source": "odometry_uncorrected"}, "pose_source='odometry_uncorrected' needs passive"),
        (PATH_ID, {"pose_source": "odometry_plain_sum"}, "pose_source='odometry_plain_sum' belongs to"),
        (GOAL_ID, {"robot": "p3dx"}, "robot 'p3dx' has the drive differential; this environment needs omni or mecanum"),
        (GOAL_ID, {"end_on_contact": False}, 'end_on_contact=False needs dynamics="pymunk" or "mujoco"'),
        (GOAL_ID, {"field_of_view": 7.0}, "field_of_view must be above 0 and at most 2 pi rad, got 7.0"),
    ],
)
def test_options_that_do_not_fit_are_named(env_id: str, options: dict[str, Any], message: str) -> None:
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared in full
            make(env_id, **options)
        assert message in str(caught.value)


# Any scenario whatever.

PLACES = st.floats(-3.0, 3.0).map(lambda value: round(value, 4))
ANGLES = st.floats(-7.0, 7.0)
SIZES = st.floats(0.01, 1.5)
OBSTACLES = st.one_of(
    st.fixed_dictionaries(
        {"kind": st.just("circle"), "x": PLACES, "y": PLACES, "radius": SIZES}, optional={"mass": st.floats(0.1, 30.0)}
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("circle"),
            "x": PLACES,
            "y": PLACES,
            "radius": SIZES,
            "patrol": st.fixed_dictionaries(
                {"vx": PLACES, "vy": PLACES, "leg_time": st.floats(0.01, 9.0)}, optional={"phase": st.floats(0.0, 20.0)}
            ),
        }
    ),
    st.fixed_dictionaries(
        {"kind": st.just("box"), "x": PLACES, "y": PLACES, "length": SIZES, "width": SIZES},
        optional={"heading": ANGLES, "mass": st.floats(0.1, 30.0)},
    ),
    st.fixed_dictionaries(
        {"kind": st.just("wall"), "x1": PLACES, "y1": PLACES, "x2": st.floats(3.5, 5.0), "y2": PLACES}
    ),
)
GOAL_SCENARIOS = st.fixed_dictionaries(
    # goal and start mostly outside of where obstacles stand
    {
        "goal": st.tuples(PLACES, st.floats(-5.0, -3.0), ANGLES),
        "start": st.tuples(st.floats(-6.0, -3.0), PLACES, ANGLES),
    },
    optional={
        "obstacles": st.lists(OBSTACLES, min_size=1, max_size=6),
        "waypoints": st.lists(st.tuples(PLACES, PLACES), max_size=3),
        "start_offset": st.floats(0.0, 1.0),
        "start_turn": st.floats(0.0, 7.0),
        "waypoint_radius": st.floats(0.01, 2.0),
        "position_tolerance": st.floats(0.01, 1.0),
        "heading_tolerance": st.floats(0.01, 4.0),
    },
)
PATH_SCENARIOS = st.fixed_dictionaries(
    {"path": st.lists(st.tuples(PLACES, PLACES), min_size=3, max_size=20, unique=True)},
    optional={
        "closed": st.booleans(),
        "start_offset": st.floats(0.0, 1.0),
        "start_turn": st.floats(0.0, 7.0),
        "corridor": st.floats(1.0, 5.0),
    },
)
OPTIONS = st.fixed_dictionaries(
    {
        "dynamics": st.sampled_from(["kinematic", "pymunk"]),
        "actuators": st.sampled_from(sorted(ACTUATORS)),
        "action_mode": st.sampled_from(["twist", "wheel_speeds"]),
        "noise": st.sampled_from([0.0, 1.0, 10.0]),
        "pose_source": st.sampled_from(["ground_truth", "odometry"]),
        "shove": st.one_of(st.none(), st.tuples(st.floats(0.0, 1.0), PLACES, PLACES, ANGLES)),
        "disturbance": st.sampled_from(["none", "none", *DISTURBANCES]),
    }
)
# within what the wheels can do, far beyond it, and standing still
SCALES = st.lists(st.sampled_from([0.0, 0.3, 1.0, 5.0, 1e6, 1e38]), min_size=3, max_size=6)


def survives(env: Any, scales: list[float], seed: int) -> bool:
    """Drives each way for a while, on after the end of an episode too; returns whether anything was touched."""
    observation, info = env.reset(seed=seed)
    assert env.observation_space.contains(observation)
    touched = False
    for scale, action in zip(scales, actions_of(env, len(scales), seed), strict=True):
        for _ in range(8):
            observation, reward, _, _, info = env.step(np.float32(min(scale, 1e37)) * action)
            assert env.observation_space.contains(observation), observation
            assert np.isfinite(observation).all()
            assert math.isfinite(reward)
            assert not any(math.isnan(value) for value in info.values())
            # what moves by itself may run into the hull
            if "clearance" in info and env.task.options.dynamics == "kinematic" and not env.task.params["moving"][0]:
                assert info["clearance"] >= 0.0
            touched = touched or info["collision"]
    return touched


@given(st.data(), GOAL_SCENARIOS, OPTIONS, SCALES, st.integers(0, 9))
def test_any_goal_scenario_is_refused_or_survived(
    tmp_path_factory: pytest.TempPathFactory,
    data: st.DataObject,
    scenario: dict[str, Any],
    options: dict[str, Any],
    scales: list[float],
    seed: int,
) -> None:
    options = options | {
        "robot": data.draw(st.sampled_from(sorted(ROBOTS))),
        "num_beams": data.draw(st.sampled_from([0, 1, 7, 32])),
        "max_range": data.draw(st.floats(0.1, 20.0)),
        "end_on_contact": options["dynamics"] == "kinematic",
    }
    file = written(tmp_path_factory.getbasetemp(), "any_goal.json", **scenario)
    try:
        env_id = TASKS["goal_reaching"].env_id(ROBOTS[options["robot"]])
        env = gymnasium.make(env_id, scenario=file, **options)
    except ValueError as error:
        if "is over the" not in str(error):
            raise
        event("refused")
        return
    event("touched something" if survives(env.unwrapped, scales, seed) else "touched nothing")


@given(st.sampled_from(PATH_IDS), PATH_SCENARIOS, OPTIONS, SCALES, st.integers(0, 9), st.floats(0.1, 4.0))
def test_any_path_scenario_is_survived(
    tmp_path_factory: pytest.TempPathFactory,
    env_id: str,
    scenario: dict[str, Any],
    options: dict[str, Any],
    scales: list[float],
    seed: int,
    scale: float,
) -> None:
    file = written(tmp_path_factory.getbasetemp(), "any_path.json", **scenario)
    survives(gymnasium.make(env_id, scenario=file, scale=scale, **options).unwrapped, scales, seed)


def test_no_element_of_an_observation_is_constant() -> None:
    for env_id, kwargs in itertools.product(IDS, ({}, {"noise": 1.0})):
        env = gymnasium.make(env_id, **kwargs)
        seen = []
        for seed in range(30):
            seen.append(env.reset(seed=seed)[0])
            seen += [env.step(action)[0] for action in actions_of(env, 5, seed)]
        constant = np.ptp(np.array(seen), axis=0) == 0.0
        names = [field.name for field in env.unwrapped.task.layout.fields for _ in range(field.size)]
        # the default scenarios have no waypoints, and references that go round
        assert {names[k] for k in np.flatnonzero(constant)} <= {"waypoints_left", "time_left"}


@every_id
@pytest.mark.parametrize(
    ("scenario", "how"),
    [
        (None, "$"),
        (3, "reset.options={'scenario': 3}"),
        (["s_curve"], "names of families"),
        ({"goal": [1, 0, 0]}, "json.dumps"),
        ([(0.0, 0.0), (1.0, 0.0)], "numpy.savetxt"),
        (np.zeros((3, 2)), "numpy.savetxt"),
    ],
)
def test_a_scenario_of_another_type_is_refused_with_what_to_type(env_id: str, scenario: object, how: str) -> None:
    with pytest.raises(ValueError, match=f"scenario must be a name or a file, got .*{how}"):
        gymnasium.make(env_id, scenario=scenario)


def test_a_robot_in_touch_with_a_wall_can_drive_away_and_along_it(tmp_path: Path) -> None:
    below = {"kind": "wall", "x1": -9.0, "y1": -0.5, "x2": 9.0, "y2": -0.5}
    scenario = written(tmp_path, start=[0, -0.2, 0], goal=[5, 3, 0], obstacles=[below])
    for action, free in (([0.0, 0.5, 0.0], True), ([0.0, 0.0, 1.0], True), ([0.3, -0.5, 0.0], False)):
        env = base(GOAL_ID, scenario=scenario, robot="omni3")
        *_, info = env.step(np.array(action))
        assert info["collision"] is not free
        assert info["clearance"] >= 0.0


def test_a_finite_action_beyond_all_bounds_saturates() -> None:
    env = base(GOAL_ID, scenario="open_field", robot="omni3", actuators="lagged")
    env.step(np.array([1e308, 0.0, 0.0]))
    # what the acceleration limit lets through in one step, whatever was asked
    assert env.batch.states["command_vx"][0] == pytest.approx(1.0 * 0.05)
