"""Every policy behind the one door: what it is told, what it remembers, alone and in a batch."""

import dataclasses
import itertools
import json
import math
import re
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield import policies
from wayfield.envs import goal_reaching, path_following, team_worlds, trajectory_tracking
from wayfield.envs.robots import ROBOTS
from wayfield.envs.tasks.briefing import KNOWS, Briefing
from wayfield.envs.tasks.specs import TASKS
from wayfield.policies import POLICIES, Pilot
from wayfield.policies.parts.gain import Gains, gain, gains_of
from wayfield.policies.trained.ppo import shipped
from wayfield.system.objects import FileNote

PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
GOAL_ID = "wayfield/OmniGoalObstacles-v0"
OMNI_PATH_ID = "wayfield/OmniPathFollowing-v0"
DIFF_GOAL_ID = "wayfield/DiffDriveGoalObstacles-v0"
IDS = [name for spec in TASKS.values() for name in spec.ids.values()]  # of one robot; teams have tests of their own
IDS_OF = {path_following.Observation: (PATH_ID, OMNI_PATH_ID), goal_reaching.Observation: (GOAL_ID, DIFF_GOAL_ID)}
TIMED_IDS = ("wayfield/DiffDriveTrajectoryTracking-v0", "wayfield/OmniTrajectoryTracking-v0")
IDS_OF[trajectory_tracking.Observation] = TIMED_IDS
IDS_OF[team_worlds.Observation] = ()  # tests/laws/test_crowds.py drives them
# The law of document B is that of one kind of robot, and agents ship for the robots that they were trained on.
OTHER_ROBOT = {("waypoint", DIFF_GOAL_ID), ("pid_omni", TIMED_IDS[0])} | {
    (name, env_id)
    for name in ("ppo", "hybrid")
    for task, env_id in (
        ("path_following", OMNI_PATH_ID),
        ("trajectory_tracking", TIMED_IDS[1]),
        ("goal_reaching", GOAL_ID),
    )
    if not shipped(task, "omni3")
}
EVERY_PAIR = [
    (name, env_id)
    for name in POLICIES
    for kind in policies.make(name).observes
    for env_id in IDS_OF[kind]
    if (name, env_id) not in OTHER_ROBOT
]
ROBOTS_OF = {PATH_ID: ("p3dx",), OMNI_PATH_ID: ("omni3", "omni4"), GOAL_ID: ("omni3", "omni4"), DIFF_GOAL_ID: ("p3dx",)}
ROBOTS_OF |= {TIMED_IDS[0]: ("p3dx",), TIMED_IDS[1]: ("omni3", "omni4")}
every_policy = pytest.mark.parametrize("name", POLICIES)
every_pair = pytest.mark.parametrize(("name", "env_id"), EVERY_PAIR, ids=[f"{a}-{b[9:-3]}" for a, b in EVERY_PAIR])


def senses(name: str, env_id: str) -> dict[str, Any]:
    """Returns what an environment needs for a policy to see: agents look with the scan that they were trained with."""
    return {"num_beams": 72} if name in ("ppo", "hybrid") and env_id in IDS_OF[goal_reaching.Observation] else {}


# By name.


@every_policy
def test_gains_go_in_by_name_and_others_are_refused(name: str) -> None:
    with pytest.raises(TypeError, match="no_such_gain"):
        policies.make(name, no_such_gain=1.0)


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ValueError, match=r"'apf_escpae' is unknown\. Did you mean 'apf_escape'\?"):
        policies.make("apf_escpae")
    with pytest.raises(ValueError, match=f"Choose from '{next(iter(policies.POLICIES))}'"):
        policies.make("")


@every_policy
def test_no_gain_takes_what_is_no_value_of_it(name: str) -> None:
    for field in dataclasses.fields(policies.make(name)):  # type: ignore[arg-type]
        for value in (math.nan, "no such thing", [1.0], 10**400):
            with pytest.raises(ValueError, match=field.name):
                policies.make(name, **{field.name: value})


# At the wheel.


# each pair in one of them, and so most policies in two; the plants and all pairs of them are slow
MODES = [("twist", "kinematic"), ("wheel_speeds", "kinematic"), ("wheel_speeds", "pymunk")]
IN_A_MODE = [
    pytest.param(*pair, *mode, id="-".join([pair[0], pair[1][9:-3], *mode]), marks=() if quick else pytest.mark.slow)
    for k, pair in enumerate(EVERY_PAIR)
    for mode in MODES
    for quick in [mode == MODES[k % 2]]
]


@pytest.mark.parametrize(("name", "env_id", "action_mode", "dynamics"), IN_A_MODE)
def test_a_pilot_drives_one_and_many_alike_and_by_a_briefing_in_place_of_the_environment(
    name: str, env_id: str, action_mode: str, dynamics: str
) -> None:
    options: dict[str, Any] = {"action_mode": action_mode, "dynamics": dynamics, "actuators": "lagged"}
    options |= senses(name, env_id)
    many: Any = gymnasium.make_vec(env_id, 2, **options)
    singles = [gymnasium.make(env_id, **options) for _ in range(2)]
    seen, _ = many.reset(seed=8)
    each = [env.reset(seed=8 + i)[0] for i, env in enumerate(singles)]
    policy = policies.make(name)
    pilot, briefed = Pilot(policy, many), Pilot(policy, many.briefing("path" if policy.knows == "path" else "map"))
    pilot.reset()
    briefed.reset()
    # robot i of a batch draws its own random numbers
    pilots = [Pilot(policies.make(name, **({"seed": 0} if name == "random" else {})), env) for env in singles]
    for each_pilot in pilots:
        each_pilot.reset()
    # what a law remembers and plans anew shows in the first, what the other changes in every step
    for k in range(25 if dynamics == "kinematic" else 8):
        actions = pilot.act(seen)
        assert actions.shape == many.action_space.shape
        assert np.isfinite(actions).all()
        assert actions.dtype == np.float32
        if k < 3 and name != "random":
            assert briefed.act(seen).tobytes() == actions.tobytes()
        for i, env in enumerate(singles):
            if name == "random" and i > 0:
                continue
            action = pilots[i].act(each[i])
            assert action.shape == env.action_space.shape
            assert action.tobytes() == actions[i].tobytes()
            each[i], _, terminated, _, _ = env.step(action)
            assert not terminated
        seen, _, terminated, _, _ = many.step(actions)
    assert not terminated[0]


def test_a_briefing_that_lacks_what_a_policy_needs_is_refused() -> None:
    env: Any = gymnasium.make("wayfield/OmniGoalObstacles-v0")
    env.reset(seed=0)
    pilot = Pilot(policies.make("orca"), env.unwrapped.briefing("goal"))
    with pytest.raises(TypeError, match="briefing has map None; one who has access to the map needs it"):
        pilot.reset()
    with pytest.raises(TypeError, match="briefing is given, but the environment makes its own"):
        Pilot(policies.make("orca"), env).reset(briefing=env.unwrapped.briefing("map"))


def _vector(env_id: str, num_envs: int = 4, **options: Any) -> Any:
    return gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point", **options)


def _started(name: str, env: Any, seed: int = 0) -> tuple[Pilot, Any]:
    pilot = Pilot(policies.make(name), env)
    seen, _ = env.reset(seed=seed)
    pilot.reset()
    return pilot, seen


@every_pair
@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["one drive", "every drive"])
def test_an_action_is_a_member_of_the_space(name: str, env_id: str, whole: bool) -> None:
    # agents ship for omni3 alone
    robots = ROBOTS_OF[env_id][: 1 if (name, env_id) == ("ppo", TIMED_IDS[1]) else None]
    drives = list(itertools.product(robots, ("twist", "wheel_speeds"), ("ideal", "slow")))
    for robot, mode, actuators in drives if whole else [drives[EVERY_PAIR.index((name, env_id)) % len(drives)]]:
        # what a law asks for is largest at the start, far from goals and beside paths
        env = _vector(env_id, robot=robot, action_mode=mode, actuators=actuators, **senses(name, env_id))
        pilot, seen = _started(name, env)
        for _ in range(4):
            action = pilot.act(seen)
            assert action.dtype == env.action_space.dtype
            assert env.action_space.contains(action)
            seen, *_ = env.step(action)


@settings(max_examples=settings().max_examples // 4)
@given(
    asked=arrays(np.float64, 3, elements=st.floats(-40.0, 40.0)),
    drive=st.sampled_from([("p3dx", "twist"), ("p3dx", "wheel_speeds"), ("omni4", "twist"), ("omni3", "wheel_speeds")]),
)
def test_both_doors_drive_the_same_motion(asked: NDArray[np.float64], drive: tuple[str, str]) -> None:
    """Whatever is asked for: where the wheels saturate, scaling it before keeps what they make of it."""
    robot, mode = drive
    moved = _moved(robot, mode, asked[: 3 if robot != "p3dx" else 2])
    assert np.abs(moved["act"] - moved["command"]).max() < 1e-6


def _moved(robot: str, mode: str, asked: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Returns where both doors lead in two seconds of the same twist."""
    env_id = OMNI_PATH_ID if robot != "p3dx" else PATH_ID
    poses = {}
    for door in ("act", "command"):
        env: Any = gymnasium.make(env_id, scenario="s_curve", robot=robot, action_mode=mode, actuators="lagged")
        seen, _ = env.reset(seed=0)
        pilot = Pilot(Steady(tuple(asked.tolist())), env)
        pilot.reset()
        for _ in range(40):
            seen, *_ = env.step(getattr(pilot, door)(seen))
        state = env.unwrapped.batch.states[0]
        poses[door] = np.array([state["x"], state["y"], state["heading"]])
    return poses


@dataclasses.dataclass(frozen=True)
class Steady:
    """Asks for the same twist at all times."""

    twist: tuple[float, ...]
    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (path_following.Observation,)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        return np.zeros((briefing.num_envs, 0))

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        return np.tile(self.twist, (briefing.num_envs, 1))


def test_what_is_not_finite_is_left_for_the_environment_to_refuse() -> None:
    env: Any = gymnasium.make(OMNI_PATH_ID)
    for twist in ((math.nan, 9.0, 0.0), (math.inf, 0.0, 0.0)):
        seen, _ = env.reset(seed=0)
        pilot = Pilot(Steady(twist), env)
        pilot.reset()
        with pytest.raises(ValueError, match="is not finite"):
            env.step(pilot.act(seen))


@pytest.mark.parametrize("name", dict.fromkeys(name for name, _ in EVERY_PAIR))
def test_rows_are_reset_one_by_one(name: str) -> None:
    env_id = next(env_id for policy, env_id in EVERY_PAIR if policy == name)
    env: Any = gymnasium.make_vec(env_id, 3, **senses(name, env_id))
    seen, _ = env.reset(seed=0)
    pilot = Pilot(policies.make(name), env)
    pilot.reset()
    first = pilot.act(seen)
    for _ in range(10):
        seen, *_ = env.step(pilot.act(seen))
    used = pilot.memory.copy()
    pilot.reset(np.array([True, False, True]))
    assert str(pilot.memory[1]) == str(used[1])
    if name == "random":
        # rows that are reset draw their first action again, the other goes on
        again = (pilot.act(seen) == first).all(axis=1)
        assert again.tolist() == [True, False, True]
    else:
        fresh = pilot.policy.reset(pilot.briefing)
        assert pilot.memory[[0, 2]].tobytes() == fresh[[0, 2]].tobytes()


@pytest.mark.parametrize(
    ("wrap", "changes"),
    [
        (lambda env: wrappers.RescaleAction(env, -1.0, 1.0), "action_space"),
        (wrappers.NormalizeObservation, "observation_space"),
        (lambda env: wrappers.FrameStackObservation(env, 3), "observation_space"),
        (wrappers.TimeAwareObservation, "observation_space"),
        (wrappers.ClipAction, ""),
        (wrappers.FlattenObservation, ""),
        (wrappers.RecordEpisodeStatistics, ""),
    ],
)
def test_a_wrapper_that_changes_what_is_seen_or_commanded_is_refused_and_others_are_not(
    wrap: Any, changes: str
) -> None:
    env = wrap(gymnasium.make(PATH_ID))
    with pytest.raises(ValueError, match=f"a wrapper changes the {changes}") if changes else nullcontext():
        Pilot(policies.make("lqr"), env)


FOR_ANOTHER_TASK = [("lookahead_documented", GOAL_ID), ("waypoint", PATH_ID), ("apf_corrected", PATH_ID)]


@pytest.mark.parametrize(("name", "env_id"), FOR_ANOTHER_TASK)
def test_a_policy_for_another_task_is_refused(name: str, env_id: str) -> None:
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(TypeError, match=f"{type(policies.make(name)).__name__} reads .*Observation.* gives"):
            Pilot(policies.make(name), make(env_id))


def test_a_policy_is_refused_by_a_robot_that_cannot_do_what_it_needs() -> None:
    able = "omni3, omni4, mecanum4"
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(ValueError, match=rf"Waypoint needs a robot that goes sideways \({able}\); 'p3dx' does not"):
            Pilot(policies.make("waypoint"), make(DIFF_GOAL_ID))
        Pilot(policies.make("waypoint"), make(GOAL_ID))
    car = dataclasses.replace(ROBOTS["p3dx"], name="car", turning_radius=0.5)
    env = gymnasium.make(DIFF_GOAL_ID, robot=car)
    with pytest.raises(ValueError, match=r"Polar needs a robot that turns on the spot, .*; 'car' does"):
        Pilot(policies.make("polar"), env)


# What they are told.


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_policy_is_told_what_it_declares_and_no_more(env_id: str, make: Any) -> None:
    env = make(env_id).unwrapped
    env.reset(seed=0)
    along = env_id in (*IDS_OF[path_following.Observation], *TIMED_IDS)
    for knows in KNOWS:
        told = env.briefing(knows)
        own, other = (told.path, told.goal) if along else (told.goal, told.path)
        assert other is None
        assert (own is None) == (knows in ("sensors", "bodies"))
        assert (told.map is None) == (knows not in ("map", "team_map"))
        assert told.map is None or told.map.counts.shape == told.map.obstacles.shape[:1]
    with pytest.raises(ValueError, match="knows='everything' is unknown"):
        env.briefing("everything")


def test_each_row_is_told_of_its_own_path() -> None:
    env: Any = gymnasium.make_vec(PATH_ID, 6)
    seen, _ = env.reset(seed=0)
    told = env.briefing("path").path
    assert len(set(told.path_index.tolist())) > 1
    for i, k in enumerate(told.path_index):
        first = told.vertices[told.runs["first"][k]]
        # starts are scattered by 0.1 m
        assert math.hypot(seen[i, 0] - first["x"], seen[i, 1] - first["y"]) <= 0.11


def test_a_gain_is_a_number_of_its_range_and_of_a_size_to_reckon_with() -> None:
    values = [-(10**400), -1e300, -1.1e9, -1e9, -6.0, -5, -1e-300, -0.0, 0, 1e-300, np.float32(0.5), 5, 5.1, 1e9, 1.1e9,
              10**400, math.inf, math.nan, True, "1", None]  # fmt: skip
    seen = set()
    for bounds in ({}, {"above": 0.0}, {"least": 0.0}, {"least": -5.0, "most": 5.0}, {"above": 0.0, "finite": False}):
        above, least = bounds.get("above", -math.inf), bounds.get("least", -math.inf)
        law = dataclasses.make_dataclass("Law", [("k", float, gain(5.0, "1", **bounds))], bases=(Gains,), frozen=True)
        for value in values:
            number = isinstance(value, int | float | np.floating) and not isinstance(value, bool)
            inside = number and value > above and value >= least  # type: ignore[operator]
            sized = number and abs(value) <= bounds.get("most", 1e9)  # type: ignore[arg-type]
            fine = inside and (sized or (value == math.inf and not bounds.get("finite", True)))
            seen.add((fine, inside))
            with nullcontext() if fine else pytest.raises(ValueError, match=r"^Law: k must be "):
                law(value)
    assert len(seen) == 3


@pytest.mark.parametrize("name", policies.POLICIES)
def test_every_gain_declares_its_unit_meaning_and_range(name: str) -> None:
    policy = policies.make(name)
    declared = gains_of(policy)
    assert list(declared) == [field.name for field in dataclasses.fields(policy)]  # type: ignore[arg-type]
    for gain_name, each in declared.items():
        assert (each.meaning and each.range) or gain_name == "home", gain_name
        assert each.unit or each.kind not in (int, float), gain_name
        if each.search is not None:
            assert each.search.low < each.search.high, gain_name
            for end in each.search[:2]:
                # beside gains that go with it
                below = {other: 0.5 * end for other in (each.above, each.least) if isinstance(other, str)}
                beyond = {other: 1.1 * end for other, its in declared.items() if gain_name in (its.above, its.least)}
                policies.make(name, **{**below, **beyond, gain_name: end})


ODD = {"m/s": 36.0, "rad": 90.0, "rad/s": 90.0, "m": 500.0, "s": 2000.0, "m/s^2": 1000.0, "rad/s^2": 180.0}


@pytest.mark.parametrize("name", policies.POLICIES)
def test_a_gain_in_other_units_is_refused_or_doubted_in_a_line(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", FileNote)
        declared = gains_of(policies.make(name))
    for gain_name, each in declared.items():
        if each.kind is not float or each.unit not in ODD:
            continue
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always", FileNote)
            try:
                policies.make(name, **{gain_name: ODD[each.unit]})
                lines = [str(note.message) for note in found]
            except ValueError as error:
                lines = [str(error)]
        assert len(lines) == 1, gain_name
        assert gain_name in lines[0]


def test_agent_is_another_name_of_a_trained_policy() -> None:
    assert policies.make("agent", seed=1) == policies.make("ppo", seed=1)


# What they do.


@pytest.mark.parametrize("env_id", IDS)
def test_zero_stands_still_and_random_uses_all_that_the_robot_can(env_id: str) -> None:
    env: Any = gymnasium.make_vec(env_id, 50)
    seen, _ = env.reset(seed=0)
    still, lively = Pilot(policies.make("zero"), env), Pilot(policies.make("random"), env)
    still.reset()
    lively.reset()
    assert not still.act(seen).any()
    drawn = np.array([lively.act(seen) for _ in range(40)])
    most = env.single_action_space.high
    assert (np.abs(drawn) <= most * (1.0 + 1e-6)).all()
    np.testing.assert_allclose(drawn.std(axis=(0, 1)), most / math.sqrt(3.0), rtol=0.05)
    assert abs(np.corrcoef(drawn[:, 0, 0], drawn[:, 1, 0])[0, 1]) < 0.7
    # no robot of another seed does what one of this does, in whichever rows they are
    firsts = [drawn[0]]
    for seed in (1, 2):
        other = Pilot(policies.make("random", seed=seed), env)
        other.reset()
        firsts.append(other.act(seen))
    assert len(np.unique(np.concatenate(firsts), axis=0)) == 150


@pytest.mark.parametrize("name", ["lookahead_documented", "lookahead_retuned"])
def test_path_followers_finish_random_paths(name: str) -> None:
    env: Any = gymnasium.make_vec(PATH_ID, 32)
    assert finished(env, name) == 32


@pytest.mark.parametrize("robot", ["omni3", "omni4"])
@pytest.mark.parametrize("name", ["waypoint", "apf_documented", "apf_escape", "apf_corrected"])
def test_goal_seekers_reach_goals_in_the_open(name: str, robot: str) -> None:
    env: Any = gymnasium.make_vec(GOAL_ID, 32, scenario="open_field", robot=robot, num_beams=0)
    assert finished(env, name) == 32


# of the printed field no heading is known for a base that it does not have
ARRIVING = {name for name in POLICIES if goal_reaching.Observation in policies.make(name).observes}
ARRIVING -= {"zero", "random", "waypoint", "apf_documented", "apf_escape"}


@pytest.mark.parametrize("name", sorted(ARRIVING))
def test_a_differential_drive_comes_to_a_pose_that_a_file_asks_for(name: str, tmp_path: Path) -> None:
    file = tmp_path / "pose.json"
    file.write_text(json.dumps({"goal": [1.3, 0.4, -0.9]}))  # with the tolerances of a file that names none
    env: Any = gymnasium.make_vec(
        "wayfield/DiffDriveGoalObstacles-v0", 1, scenario=str(file), actuators="lagged", num_beams=72
    )
    assert finished(env, name) == 1


def finished(env: Any, name: str) -> int:
    """Returns how many robots of a vector end their first episode in success."""
    seen, _ = env.reset(seed=0)
    pilot = Pilot(policies.make(name), env)
    pilot.reset()
    ended = np.zeros(env.num_envs, bool)
    succeeded = 0
    for _ in range(1200):
        seen, _, terminated, truncated, info = env.step(pilot.act(seen))
        succeeded += int((info["success"] & ~ended).sum())
        ended |= terminated | truncated
        if ended.all():
            break
    return succeeded


def test_what_newcomers_write_is_answered_by_what_to_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path, goal = "wayfield/DiffDrivePathFollowing-v0", "wayfield/DiffDriveGoalObstacles-v0"
    env = gymnasium.make(path)
    pilot = Pilot(policies.make("pure_pursuit"), env)
    begun = env.reset(seed=0)
    pilot.reset()
    said: list[tuple[Callable[[], Any], str]] = [
        (lambda: policies.make("pure_pursuit", lookahead=0.4), "Did you mean 'lookahead_distance'"),
        (lambda: dataclasses.replace(policies.make("mpc"), top_speed=1.0), "Mpc has no gain 'top_speed'. .*speed"),
        (lambda: policies.make("zero", speed=1.0), "It has none"),
        (lambda: gains_of("pure_pursuit"), r"make\('pure_pursuit'\)"),
        (lambda: Pilot(policies.make("dwa"), env), "policies that fit: .*pure_pursuit, .*mpc"),
        (lambda: pilot.act(begun), r"observation, info = env\.reset\(\)"),
        (lambda: pilot.act(begun[0][:-1]), r"has the shape \(1, 27\); that of 1 robot\(s\) is \(1, 28\)"),
        (lambda: Pilot("pure_pursuit", env), "policy is 'pure_pursuit'; .*make"),  # type: ignore[arg-type]
        (lambda: Pilot(env, policies.make("lqr")), r"not Lqr: Pilot\(policy, env\)"),  # type: ignore[arg-type]
        (lambda: Pilot(policies.make("lqr"), path), r"not str: Pilot\(policy, env\)"),
        (lambda: gymnasium.make(path, scenario="doors_wide/test"), f"belongs to {goal}, "),
        (lambda: gymnasium.make(goal, scenario="circles"), f"belongs to {path}, "),
        (lambda: gymnasium.make(path, scenario="no.csv"), f"there is no file {re.escape(str(tmp_path / 'no.csv'))}$"),
        (lambda: gymnasium.make(path, robot="no.json"), f"there is no file {re.escape(str(tmp_path / 'no.json'))}$"),
        (lambda: policies.load_agent("no"), re.escape(str(tmp_path / "no"))),
    ]
    for call, line in said:
        with pytest.raises((TypeError, ValueError, OSError), match=line) as caught:
            call()
        assert "\n" not in str(caught.value)
