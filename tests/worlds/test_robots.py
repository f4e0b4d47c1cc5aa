"""Robots and their data sheets: what a sheet says is what drives, and a wrong one is refused in one line."""

import copy
import dataclasses
import json
import math
import pickle
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import robot_page
from click.testing import CliRunner
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray
from results_page import between

import wayfield.envs.robots
from wayfield.benchmarks import compare
from wayfield.benchmarks.commands import evaluate
from wayfield.envs.robots import ROBOTS, Robot, Wheel, read_robot, robot_of
from wayfield.envs.robots.intervals import Interval, drawn
from wayfield.envs.scenarios import TASKS, TaskSpec
from wayfield.envs.vector import NativeVectorEnv
from wayfield.policies.learned.agent import drives, load_agent
from wayfield.policies.trained.ppo import shipped
from wayfield.policies.training.presets import overridden, preset_for
from wayfield.system.objects import FileNote

NEW = ("turtlebot3", "kobuki", "jackal", "mecanum4", "mir100", "husky")
FOLDER = Path(wayfield.envs.robots.__file__).parent / "data_sheets"
PATH_ID, GOAL_ID = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveGoalObstacles-v0"
OMNI_IDS = ("wayfield/OmniPathFollowing-v0", "wayfield/OmniGoalObstacles-v0")


def sheet(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return found


def written(folder: Path, content: Any, name: str = "mine.json") -> str:
    file = folder / name
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return str(file)


def single(env_id: str, **options: Any) -> Any:
    return gymnasium.make(env_id, **options).unwrapped


def vector(env_id: str, num_envs: int, **options: Any) -> NativeVectorEnv:
    env = gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point", **options)
    assert isinstance(env, NativeVectorEnv)
    return env


def fitting(spec: TaskSpec, name: str) -> dict[str, str]:
    """Returns options under which a robot fits: docking's default of its hull class, a car's wide reference."""
    if spec.observes == "reference" and ROBOTS[name].turning_radius > 0.0:
        return {"scenario": "round_1m"}
    classed = spec.repertoire.split_for("all/train", ROBOTS[name].hull_radius)
    return {"scenario": classed} if "@" in classed and spec.name == "docking" else {}


def driven(env: Any, steps: int = 60) -> bytes:
    """Returns all that an environment answers to the same random actions, as bytes."""
    rng = np.random.default_rng(7)
    seen, _ = env.reset(seed=3)
    answers = [seen]
    for _ in range(steps):
        answers += env.step(rng.uniform(-1.2, 1.2, env.action_space.shape) * env.action_space.high)[:4]
    return b"".join(np.asarray(each).tobytes() for each in answers)


# The kinematics.


def test_each_wheel_of_mecanum4_for_unit_twists_by_hand() -> None:
    """Lynch and Park, Modern Robotics (2017), eq. 13.10: u = H V with l + w = 0.15 + 0.15 m and r = 0.05 m."""
    robot = ROBOTS["mecanum4"]
    ahead, left, turn = (robot.wheel_speeds_from_twist(twist) for twist in np.eye(3))
    assert ahead == pytest.approx([20.0, 20.0, 20.0, 20.0], abs=1e-12)
    assert left == pytest.approx([-20.0, 20.0, -20.0, 20.0], abs=1e-12)
    assert turn == pytest.approx([-6.0, 6.0, 6.0, -6.0], abs=1e-12)


@pytest.mark.parametrize("action_mode", ["twist", "wheel_speeds"])
@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_a_square_driven_by_the_environment_closes(tmp_path: Path, dynamics: str, action_mode: str) -> None:
    free = written(tmp_path, {"goal": [50, 50, 0]}, "free.json")
    options = {"robot": "mecanum4", "dynamics": dynamics, "action_mode": action_mode, "end_on_contact": True}
    env = single(OMNI_IDS[1], scenario=free, **options)
    env.reset(seed=0)
    state = env.batch.states[0]
    start = [float(state[name]) for name in ("x", "y", "heading")]
    for twist in ((0.4, 0.0, 0.0), (0.0, 0.4, 0.0), (-0.4, 0.0, 0.0), (0.0, -0.4, 0.0)):
        for action in [np.array(twist)] * 30 + [np.zeros(3)] * 10:  # stands still at the corners
            env.step(action if action_mode == "twist" else ROBOTS["mecanum4"].wheel_speeds_from_twist(action))
    places = [float(state[name]) for name in ("x", "y", "heading")]
    # where wheels slip, they do so alike on opposite sides
    assert places == pytest.approx(start, abs=1e-9)


def test_mecanum_wheels_pull_along_their_rollers_alone(tmp_path: Path) -> None:
    """Wheels that spin pull along their rollers' axes with the friction of their load: cos(45 deg) of it ahead."""
    free = written(tmp_path, {"goal": [50, 50, 0]}, "free.json")
    content = sheet("mecanum4") | {"name": "spinning", "peak_wheel_speed": 400.0, "friction": 0.1}
    robot = written(tmp_path, content)
    for twist, axis in (((20.0, 0.0, 0.0), "x"), ((0.0, 20.0, 0.0), "y")):
        env = single(OMNI_IDS[1], scenario=free, robot=robot, dynamics="pymunk")
        env.reset(seed=0)
        state = env.batch.states[0]
        state["heading"] = 0.0
        before = float(state[axis])
        for _ in range(10):
            env.step(np.array(twist))
        wanted = 0.5 * (math.cos(math.pi / 4) * 0.1 * 9.81) * 0.5**2
        assert abs(float(state[axis]) - before) == pytest.approx(wanted, rel=1e-6)


# Robots that ship.


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
@pytest.mark.parametrize("name", NEW)
def test_new_robots_pass_gymnasiums_checks(name: str, dynamics: str) -> None:
    for spec in TASKS.values():
        env = single(spec.env_id(ROBOTS[name]), robot=name, dynamics=dynamics, **fitting(spec, name))
        check_env(env, skip_render_check=True)


@pytest.mark.parametrize(("dynamics", "mode"), [("kinematic", "SameStep"), ("pymunk", "NextStep")])
@pytest.mark.parametrize("name", NEW)
def test_a_row_of_new_robots_equals_a_lone_one(name: str, dynamics: str, mode: str) -> None:
    for spec in TASKS.values():
        options: dict[str, Any] = {"robot": name, "dynamics": dynamics, "actuators": "lagged", "noise": 0.5}
        options |= fitting(spec, name)
        env_id = spec.env_id(ROBOTS[name])
        many = vector(env_id, 3, max_episode_steps=25, autoreset_mode=mode, **options)
        alone = [gymnasium.make(env_id, max_episode_steps=25, **options) for _ in range(3)]
        rng = np.random.default_rng(1)
        seen, _ = many.reset(seed=5)
        lone = [env.reset(seed=5 + i)[0] for i, env in enumerate(alone)]
        ended = [False] * 3
        np.testing.assert_array_equal(seen, np.stack(lone))
        for _ in range(60):
            actions = rng.uniform(-1, 1, many.action_space.shape) * many.action_space.high
            seen, rewards, terminated, truncated, _ = many.step(actions)
            for i, env in enumerate(alone):
                if ended[i]:  # NextStep: the step that resets
                    ended[i] = False
                    np.testing.assert_array_equal(seen[i], env.reset()[0])
                    continue
                answer, reward, over, cut, _ = env.step(actions[i])
                assert (rewards[i], terminated[i], truncated[i]) == (reward, over, cut)
                if over or cut:
                    if mode == "SameStep":
                        answer = env.reset()[0]
                    else:
                        ended[i] = True
                np.testing.assert_array_equal(seen[i], answer)


# Data sheets of one's own.


@pytest.mark.parametrize(
    ("name", "dynamics", "actuators"),
    [("p3dx", "kinematic", "lagged"), ("omni3", "pymunk", "slow"), ("omni4", "kinematic", "ideal")],
)
def test_a_sheet_equal_to_a_shipped_one_gives_its_bits(
    tmp_path: Path, name: str, dynamics: str, actuators: str
) -> None:
    mine = written(tmp_path, sheet(name) | {"name": "mine"})
    for spec in TASKS.values():
        options: dict[str, Any] = {"dynamics": dynamics, "actuators": actuators, "noise": 1.0}
        env_id = spec.env_id(ROBOTS[name])
        answers = {driven(single(env_id, robot=robot, **options)) for robot in (name, mine, Path(mine), robot_of(mine))}
        assert len(answers) == 1


def test_a_sheet_travels(tmp_path: Path) -> None:
    """A robot of one's own is copied and pickled with its environment, mid-episode, without its file."""
    file = written(tmp_path, sheet("mecanum4") | {"name": "mine", "mass": 7})
    env = single(OMNI_IDS[0], robot=file, noise=1.0)
    env.reset(seed=1)
    Path(file).unlink()
    env.step(env.action_space.high)
    twins = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]
    wanted = env.step(env.action_space.high)[0]
    for twin in twins:
        assert twin.task.robot == env.task.robot
        np.testing.assert_array_equal(twin.step(env.action_space.high)[0], wanted)


def ring(count: int, **more: float) -> list[dict[str, float]]:
    angles = 2.0 * math.pi * np.arange(count) / count
    places: NDArray[np.float64] = np.column_stack([0.2 * np.cos(angles), 0.2 * np.sin(angles), angles + 0.5 * math.pi])
    return [
        {"x": x, "y": y, "direction": math.remainder(a, 2 * math.pi), "radius": 0.05} | more
        for x, y, a in places.tolist()
    ]


@pytest.mark.parametrize("count", [3, 5, 8])
def test_omni_bases_of_any_number_of_wheels_drive(tmp_path: Path, count: int) -> None:
    """Of more than four wheels odometry reads the first four."""
    content = sheet("omni4") | {"name": "round", "wheels": ring(count), "hull": {"radius": 0.25}, "mass": 9}
    file = written(tmp_path, content)
    options: dict[str, Any] = {"robot": file, "noise": 1.0, "pose_source": "odometry", "disturbance": "dropout"}
    many = vector(OMNI_IDS[1], 2, **options)
    alone = gymnasium.make(OMNI_IDS[1], **options)
    seen, _ = many.reset(seed=2)
    np.testing.assert_array_equal(seen[0], alone.reset(seed=2)[0])
    for _ in range(70):
        seen, *_ = many.step(np.full((2, 3), 0.1))
        np.testing.assert_array_equal(seen[0], alone.step(np.full(3, 0.1))[0])
    clean = single(OMNI_IDS[1], robot=file, pose_source="odometry")
    clean.reset(seed=2)
    for _ in range(40):
        clean.step(np.array([0.1, 0.05, 0.2]))
    state = clean.batch.states[0]
    for axis in ("x", "y", "heading"):
        assert state[f"odometry_{axis}"] == pytest.approx(state[axis], abs=1e-9)


WHEELS = {"radius": 0.05, "track": 0.3}
GOOD: dict[str, Any] = {
    "drive": "differential",
    "wheels": WHEELS,
    "hull": {"radius": 0.25},
    "mass": 9.0,
    "inertia": 0.3,
    "friction": 0.8,
    "rated_wheel_speed": 12.0,
}
OMNI: dict[str, Any] = GOOD | {"drive": "omni", "wheels": ring(3)}
MECANUM: dict[str, Any] = GOOD | {"drive": "mecanum", "wheels": sheet("mecanum4")["wheels"]}
# changes of a good sheet, or a whole text; what the message names: field and value, range, unit
IDENTIFIED = {"value": [0.1, 0.2], "low": [0.05, None], "high": [0.2, 0.3], "method": "by hand"}
LOW = {"kind": "box", "length": 0.19, "width": 0.3}
WRONG: list[tuple[Any, tuple[str, ...]]] = [
    (GOOD | {"delay": 0.1}, ("delay is 0.1;", "2 numbers (v_x, yaw rate)")),
    (GOOD | {"gain": [1.0, 0.0]}, ("gain[1] is 0.0;", "0.1 to 10")),
    (
        GOOD | {"wheels": WHEELS | {"wheelbase": 0.2}, "inertia": 0.1, "hull": LOW},
        ("hull.length is 0.19;", "0.2 m, for wheels[0]"),
    ),
    (GOOD | {"sources": {"delay": IDENTIFIED}}, ("sources.delay.value is (0.1, 0.2);", "the field's, ()")),
    (GOOD | {"sources": {"mass": 5}}, ("sources is {'mass': 5};",)),
    (GOOD | {"hull": 0.25}, ("hull is 0.25;", "an object with radius")),
    (GOOD | {"hull": LOW | {"x": "a"}}, ("hull.x is 'a';", "from -0.095 to 0.095 m", "pose lies within")),
    (GOOD | {"hull": LOW | {"x": -0.1}}, ("hull.x is -0.1;", "from -0.095 to 0.095 m", "pose lies within")),
    (GOOD | {"hull": {"radius": 0.25, "x": 0.1}}, ("'hull.x' is not known",)),
    (GOOD | {"saturation": "wheel"}, ("saturation='wheel'", "Did you mean 'wheels'?")),
    (GOOD | {"sources": {"mass": IDENTIFIED}}, ("sources.mass is an interval;", "delay, gain, lag")),
    (
        GOOD | {"delay": [0.1, 0.2], "sources": {"delay": IDENTIFIED | {"low": [0.11, 0.1]}}},
        ("sources.delay.low is 0.11;", "at most the value, 0.1"),
    ),
    ("", ("mine.json:1:",)),
    ('{"drive": "omni", "drive": "omni"}', ("'drive' is given twice",)),
    ('{"mass": NaN}', ("NaN is not a number of JSON",)),
    (GOOD | {"drive": "diferential"}, ("drive='diferential'", "Did you mean 'differential'?")),
    (GOOD | {"mas": 3.0}, ("'mas' is not known", "Did you mean 'mass'?")),
    ({key: GOOD[key] for key in GOOD if key != "mass"}, ("'mass' is missing",)),
    ({key: GOOD[key] for key in GOOD if key != "drive"}, ("'drive' is missing", "'differential', 'omni', 'mecanum'")),
    (GOOD | {"name": "p3dx"}, ("name is 'p3dx', which ships", "another name")),
    (GOOD | {"title": 5}, ("title is 5;", "a text")),
    (GOOD | {"sources": "its maker"}, ("sources is 'its maker';", "fields to texts or intervals")),
    *(
        (GOOD | {"delay": [0.1, 0.2], "sources": {"delay": IDENTIFIED | changes}}, told)
        for changes, told in (
            ({"low": [0.05]}, ("sources.delay has value, low and high of different lengths;", "one length")),
            ({"value": ["a", 0.2]}, ("sources.delay.value is ('a', 0.2);", "numbers")),
            ({"method": 3}, ("sources.delay.method is 3;", "a text")),
        )
    ),
    (GOOD | {"inertia": 2.0}, ("inertia is 2;", "at most mass hull.radius^2 = 0.562 kg m^2")),
    (GOOD | {"driven_load": 1.5}, ("driven_load is 1.5;", "share of the weight")),
    (GOOD | {"peak_wheel_speed": 6.0}, ("peak_wheel_speed is 6;", "at least rated_wheel_speed, 12 rad/s")),
    (GOOD | {"peak_wheel_speed": 9000.0}, ("peak_wheel_speed is 9000;", "at most 500 rad/s", "hull.radius")),
    (GOOD | {"name": "a/b"}, ("name is 'a/b';", "letters")),
    (GOOD | {"hull": {"radius": 0.1}, "inertia": 0.01}, ("hull.radius is 0.1;", "0.15 m, where wheels[0] stands")),
    (GOOD | {"wheels": WHEELS | {"track": -0.3}}, ("wheels.track is -0.3;", "0.002 to 20 m")),
    (GOOD | {"sensors": {"beams": 20_000}}, ("sensors.beams must be a whole number from 0 to 10000", "20000")),
    (OMNI | {"wheels": ring(2)}, ("wheels has 2 entries", "3 to 8 wheels")),
    (OMNI | {"wheels": WHEELS}, ("wheels is {", "a list of objects with x, y, direction, radius")),
    (OMNI | {"wheels": ring(3, roller_angle=0.7)}, ("'wheels[0].roller_angle' is not known",)),
    (OMNI | {"wheels": ring(4, direction=0.0)}, ("wheels cannot span the twists", "rank 2", "(0, 1, 0)")),
    (OMNI | {"encoders": ring(3)}, ("encoders has 3 entries", "2")),
    (MECANUM | {"wheels": ring(4)}, ("'wheels[0].roller_angle' is missing",)),
    (
        MECANUM | {"wheels": [each | {"roller_angle": 0.785} for each in MECANUM["wheels"]]},
        ("wheels cannot span the twists", "rank 2", "none of them turns"),
    ),
]


def test_the_sheets_that_are_changed_are_good(tmp_path: Path) -> None:
    for content in (GOOD, OMNI, MECANUM):
        assert isinstance(read_robot(written(tmp_path, content)), Robot)


@pytest.mark.parametrize(("content", "told"), WRONG)
def test_a_wrong_sheet_is_one_line(tmp_path: Path, content: Any, told: tuple[str, ...]) -> None:
    file = written(tmp_path, content)
    env_id = OMNI_IDS[0] if "omni" in str(content) or "mecanum" in str(content) else PATH_ID
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared below
        gymnasium.make(env_id, robot=file)
    message = str(caught.value)
    assert message.startswith(f"{file}:")
    assert "\n" not in message
    assert len(message) < 500 + len(file)
    for part in told:
        assert part in message


LENGTHS = ("radius", "track", "effective_track", "length", "width", "range", "acceleration", "turning_radius")
ANGLES = ("turn_speed", "yaw_acceleration", "rated_wheel_speed", "angle", "direction")


def scaled(content: Any, fields: tuple[str, ...], factor: float) -> Any:
    """Yields a sheet's content with each of some fields, one at a time, times a factor."""
    for key in content if isinstance(content, dict) else range(len(content)):
        value = content[key]
        if key in fields and isinstance(value, int | float) and value:
            yield f"{key}", {**content, key: factor * value}
        elif key not in ("sources", "title") and isinstance(value, dict | list):
            for name, other in scaled(value, fields, factor):
                changed = copy.copy(content)
                changed[key] = other
                yield name, changed


def doubted(file: Path, content: Any) -> bool:
    """Returns whether a sheet is refused, or a line says what is unusual; each in one line."""
    file.write_text(json.dumps(content))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        try:
            read_robot(str(file))
            lines = [str(each.message) for each in found]
        except ValueError as error:
            lines = [str(error)]
    assert [len(each.splitlines()) for each in lines] in ([], [1])
    assert all(each.startswith(f"{file}: ") for each in lines)
    return bool(lines)


def test_a_number_that_was_measured_is_not_doubted(tmp_path: Path) -> None:
    content = ROBOTS["p3dx"].sheet | {"name": "mine", "acceleration": 60.0, "sources": {}}
    assert doubted(tmp_path / "mine.json", content)
    measured = {"value": 60.0, "low": 30.0, "high": None, "method": "profile likelihood, 95 %"}
    assert not doubted(tmp_path / "mine.json", content | {"sources": {"acceleration": measured}})


@pytest.mark.parametrize("name", ROBOTS)
def test_a_sheet_in_other_units_is_refused_or_doubted_in_a_line(tmp_path: Path, name: str) -> None:
    content = ROBOTS[name].sheet | {"name": "mine"}
    file = tmp_path / "mine.json"
    assert not doubted(file, content)
    for fields, factor in (
        (LENGTHS, 1000.0),
        (ANGLES, 180.0 / math.pi),
        (("mass", "inertia"), 1000.0),
        (("mass", "inertia"), 0.001),
        (("friction", "driven_load"), 100.0),
        (("lag", "delay"), 1000.0),
    ):
        for field, changed in scaled(content, fields, factor):
            assert doubted(file, changed), (field, factor)


@pytest.mark.parametrize("changes", [{}, {"mass": 9000.0}, {"lag": 3.0}, {"rated_wheel_speed": 117.0}])
def test_a_robot_made_in_python_is_doubted_once_where_it_is_first_driven(changes: dict[str, float]) -> None:
    robot = dataclasses.replace(ROBOTS["p3dx"], name="mine", **changes, peak_wheel_speed=200.0)
    said = []
    for made, count in ((gymnasium.make, ()), (gymnasium.make_vec, (2,)), (gymnasium.make, ())):
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            made(
                "wayfield/DiffDrivePathFollowing-v0", *count, robot=pickle.loads(pickle.dumps(robot)) if said else robot
            )
        said.append([str(each.message) for each in found if each.category is FileNote])
        robot = pickle.loads(pickle.dumps(robot))  # as for a worker
    assert said[1:] == [[], []]
    assert [line.startswith("robot 'mine': ") for line in said[0]] == [True] * bool(changes)
    assert all(name in said[0][0] for name in changes)


def test_a_sheet_is_written_as_it_was_read(tmp_path: Path) -> None:
    more = {"lag": [0.1, 0.2], "delay": [0.1, 0.2], "gain": [1, 0.8], "decelerations": [2, 4], "saturation": "wheels"}
    more |= {"response": "continuous", "sources": {"delay": IDENTIFIED, "mass": "a scale"}}
    robots = [*ROBOTS.values(), read_robot(written(tmp_path, GOOD | more))]
    for robot in robots:
        again = read_robot(written(tmp_path, robot.sheet | {"name": robot.name}))
        assert (again, again.digest, again.sources, again.title) == (robot, robot.digest, robot.sources, robot.title)


def test_robots_drawn_from_their_intervals_stay_in_them() -> None:
    """Each number by itself, with its value for a median; a missing end holds it at the value."""
    intervals = {
        "delay": Interval("", (0.1, 0.2), (0.05, None), (0.2, 0.3), ""),
        "acceleration": Interval("", 2.0, 1.0, 2.5, ""),
        "wheels.effective_track": Interval("", 0.4, 0.38, 0.5, ""),
    }
    robot = dataclasses.replace(ROBOTS["p3dx"], delay=(0.1, 0.2), acceleration=2.0, sources=intervals)
    rng = np.random.default_rng(0)
    many = [drawn(robot, rng) for _ in range(2000)]
    found = np.array([[*each.delay, each.acceleration, 2.0 * each.wheels[1].y] for each in many])
    assert np.all(found >= (0.05, 0.2, 1.0, 0.38))
    assert np.all(found <= (0.2, 0.3, 2.5, 0.5))
    np.testing.assert_allclose(np.median(found, axis=0), (0.1, 0.2, 2.0, 0.4), atol=0.03)
    assert abs(np.corrcoef(found.T)[0, 1]) < 0.1
    assert drawn(ROBOTS["kobuki"], rng) is ROBOTS["kobuki"]


def test_a_robot_made_in_python_is_checked_too() -> None:
    with pytest.raises(ValueError, match=r"mass is nan; it must be a number from 0\.001 to 1e\+06 kg"):
        dataclasses.replace(ROBOTS["p3dx"], mass=math.nan)
    with pytest.raises(ValueError, match="wheels must be two"):
        dataclasses.replace(ROBOTS["p3dx"], wheels=ROBOTS["omni4"].wheels)
    with pytest.raises(ValueError, match=r"wheels\[0\]\.roller_angle is 0\.1; it belongs to the drive mecanum"):
        dataclasses.replace(ROBOTS["p3dx"], wheels=(Wheel(0.0, -0.19, 0.1, roller_angle=0.1), Wheel(0.0, 0.19, 0.1)))
    with pytest.raises(ValueError, match="sensors is 5"):
        dataclasses.replace(ROBOTS["p3dx"], sensors=5)  # type: ignore[arg-type]


def test_a_robot_for_another_environment_or_none_is_named(tmp_path: Path) -> None:
    file = written(tmp_path, OMNI)
    with pytest.raises(ValueError, match="robot 'mine' has the drive omni; this environment needs differential"):
        gymnasium.make(PATH_ID, robot=file)
    with pytest.raises(ValueError, match=r"robot='turtlebot' is unknown\. Did you mean 'turtlebot3'\?.*\.json file"):
        gymnasium.make(PATH_ID, robot="turtlebot")
    with pytest.raises(FileNotFoundError, match=r"nowhere\.json"):
        gymnasium.make(PATH_ID, robot="nowhere.json")
    with pytest.raises(ValueError, match=r"pose_source='odometry_plain_sum' .* robot 'mecanum4' has no such map"):
        gymnasium.make(OMNI_IDS[0], robot="mecanum4", pose_source="odometry_plain_sum")


# Contests and agents.


def test_the_page_of_the_robots_is_that_of_their_sheets() -> None:
    for name, lines in robot_page.generated().items():
        page = (Path(__file__).resolve().parents[2] / "docs" / name).read_text(encoding="utf-8")
        assert between(page, robot_page.BEGIN, robot_page.END, lines) == page


def test_an_agent_knows_its_robot_by_name_and_sheet(tmp_path: Path) -> None:
    (folder, *_) = shipped("path_following", "p3dx").values()
    agent = load_agent(folder)
    heavy = dataclasses.replace(ROBOTS["p3dx"], mass=20.0)
    assert drives(agent.card, ROBOTS["p3dx"])
    assert not drives(agent.card, ROBOTS["kobuki"])
    assert not drives(agent.card, heavy)
    assert drives({**agent.card, "sheets": {"p3dx": heavy.digest}}, heavy)
    assert not drives({**agent.card, "sheets": {"p3dx": heavy.digest}}, ROBOTS["p3dx"])
    env = vector(PATH_ID, 2, robot=heavy)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="another p3dx: its data sheet has other numbers"):
        agent.reset(env.briefing("sensors"))


def test_a_contest_takes_a_sheet_and_says_whose_gains_it_drove(tmp_path: Path) -> None:
    file = written(tmp_path, sheet("kobuki") | {"name": "mine", "mass": 4.0})
    with pytest.raises(ValueError, match="no agent ships for path_following with mine"):
        compare(["ppo"], "path-following", ["splines"], 1, robot=file)
    found = compare(["pure_pursuit"], "path-following", ["splines"], 1, robot=file)
    rows = {row["policy"]: row for row in found.rows}
    assert rows["pure_pursuit"]["robot"] == "mine"
    # nothing was tuned with a robot of one's own: the policy's own gains are driven, and the row says so
    assert rows["pure_pursuit"]["gains_name"] == "default"
    assert rows["pure_pursuit"]["learned_from"] == "0 frames"


def test_a_training_takes_a_sheet(tmp_path: Path) -> None:
    file = written(tmp_path, sheet("kobuki") | {"name": "mine", "mass": 4.0})
    preset = overridden(preset_for(GOAL_ID, None), (f"robot={file}",))
    assert preset.features.hull_radius == 0.176  # type: ignore[union-attr]
    assert preset.worlds.sheet == {"sheet": read_robot(file).digest}
    assert preset_for(GOAL_ID, None).worlds.sheet == {}
    with pytest.raises(ValueError, match=r"robot 'nowhere\.json' cannot be read: there is no file"):
        overridden(preset, ("robot=nowhere.json",))
    with pytest.raises(ValueError, match=r"robot='kobuky' is unknown\. Did you mean 'kobuki'"):
        overridden(preset, ("robot=kobuky",))


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("p3d", "Did you mean 'p3dx'?"),
        ("nowhere.json", "--robot 'nowhere.json' cannot be read: there is no file"),
        ("bad.json", "--robot bad.json: field 'mas' is not known"),
    ],
)
def test_the_command_line_refuses_a_wrong_robot_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: str, told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, GOOD | {"mas": 1}, "bad.json")
    result = CliRunner().invoke(evaluate.main, ["--suite", "path-following", "--robot", value])
    assert result.exit_code == 2
    assert told in result.output
    assert result.output.count("\n") == 1
    assert not (tmp_path / "results").exists()
