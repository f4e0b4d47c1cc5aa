"""The CasADi model beside the plant that it is of, and the constraints beside what environments say of themselves."""

import dataclasses
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield
from wayfield.envs.robots import ACTUATORS, ROBOTS, Robot
from wayfield.envs.vector import NativeVectorEnv

casadi: Any = pytest.importorskip("casadi", reason='needs pip install "wayfield[exact]"')

DRAWN = 1500


def vector(robot: Any, holonomic: bool, count: int = DRAWN, **kwargs: Any) -> NativeVectorEnv:
    kind = "Omni" if holonomic else "DiffDrive"
    env = gymnasium.make_vec(
        f"wayfield/{kind}PathFollowing-v0", count, vectorization_mode="vector_entry_point", robot=robot, **kwargs
    )
    assert isinstance(env, NativeVectorEnv)
    return env


def farthest(env: NativeVectorEnv, model: Any, robot: Robot) -> float:
    """Returns how far model and plant are apart after a period, from random states under random actions."""
    rng = np.random.default_rng(0)
    top = np.zeros(3)
    top[list(robot.twist_axes)] = robot.max_twist
    x = rng.uniform(-1.0, 1.0, (DRAWN, 9)) * np.concatenate([[20.0, 20.0, np.pi], top, top])
    x[:99, 3:] = 0.0
    # beyond every limit, and near the last command, where none acts
    u = rng.uniform(-2.0, 2.0, (DRAWN, len(env.single_action_space.high))) * env.single_action_space.high
    near = x[::2, 6:][:, robot.twist_axes]
    u[::2] = near if len(model.names["u"]) == near.shape[1] else 0.0
    u[:33] = 0.0
    env.reset(seed=0)
    states = env.batch.states
    for name, values in zip(model.names["x"], x.T, strict=True):
        states[name] = values
    told = model.step.map(DRAWN)(x.T, u.T).full()
    env.step(u)
    apart = told - np.stack([states[name] for name in model.names["x"]])
    apart[2] = (apart[2] + np.pi) % (2.0 * np.pi) - np.pi
    return float(np.abs(apart).max())


@pytest.mark.parametrize("tier", ACTUATORS)
@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_the_model_is_the_plant(robot: Robot, tier: str) -> None:
    for mode in ("twist", "wheel_speeds"):
        env = vector(robot.name, robot.holonomic, actuators=tier, action_mode=mode)
        assert farthest(env, wayfield.symbolic.of(env), robot) < 1e-12
        if mode == "twist":
            assert farthest(env, wayfield.symbolic(robot.name, tier), robot) < 1e-12


def test_a_car_and_a_disturbed_base_are_their_own_models() -> None:
    car = dataclasses.replace(ROBOTS["p3dx"], name="car", turning_radius=0.7, turn_speed=1.1)
    env = vector(car, False, actuators="lagged")
    assert farthest(env, wayfield.symbolic.of(env), car) < 1e-12
    for cause in ("slip", "wheel_error"):
        for robot in (ROBOTS["p3dx"], ROBOTS["omni3"]):
            env = vector(robot, robot.holonomic, actuators="slow", disturbance=cause)
            assert farthest(env, wayfield.symbolic.of(env, true=True), robot) < 1e-12
            assert farthest(env, wayfield.symbolic.of(env), robot) > 1e-3


@pytest.mark.parametrize("name", ["p3dx", "omni3"])
def test_derivatives_are_those_of_differences_and_finite_at_rest(name: str) -> None:
    model = wayfield.symbolic(name, "lagged")
    u = np.full(len(model.names["u"]), 0.21)
    axes = list(ROBOTS[name].twist_axes)
    x = np.array([1.0, 2.0, -0.5, *np.zeros(6)])
    x[[3 + axis for axis in axes]] = x[[6 + axis for axis in axes]] = 0.2
    both = np.concatenate([x, u])
    steps = 1e-6 * np.eye(len(both))
    sides = [model.step.map(len(both))(*np.split(both[:, None] + side * steps, [9])).full() for side in (1.0, -1.0)]
    found = np.hstack([each.full() for each in model.linear(x, u)])
    np.testing.assert_allclose(found, (sides[0] - sides[1]) / 2e-6, atol=1e-8)
    assert all(np.isfinite(each.full()).all() for each in model.linear(np.zeros(9), np.zeros(len(u))))
    np.testing.assert_allclose(model.smooth(x, u).full(), model.step(x, u).full(), atol=1e-12)


def test_what_has_no_such_model_is_refused_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    p3dx = ROBOTS["p3dx"]
    responds = {"delay": (0.1, 0.1), "lag": (0.1, 0.2), "decelerations": (2.0, 5.0), "saturation": "wheels"}
    for field, value in (responds | {"gain": (0.9, 1.0), "response": "continuous"}).items():
        other = dataclasses.replace(p3dx, name="other", **{field: value})
        with pytest.raises(ValueError, match=rf"^robot 'other' has {field} in its data sheet.*$"):
            wayfield.symbolic(other, "lagged")
        wayfield.symbolic(other, "ideal")
    cases = [
        (ValueError, "actuators='fast' is unknown", lambda: wayfield.symbolic("p3dx", "fast")),
        (ValueError, "dt is 0", lambda: wayfield.symbolic("p3dx", dt=0)),
        (ValueError, "p4dx", lambda: wayfield.symbolic("p4dx")),
        (TypeError, "env must be an environment of wayfield, got str", lambda: wayfield.symbolic.of("p3dx")),
        (ValueError, 'dynamics="pymunk"', lambda: wayfield.symbolic.of(vector("p3dx", False, 1, dynamics="pymunk"))),
        (
            ValueError,
            "delays actions by 2",
            lambda: wayfield.symbolic.of(vector("p3dx", False, 1, disturbance="delay_2"), true=True),
        ),
    ]
    for kind, words, call in cases:
        with pytest.raises(kind, match=words) as told:
            call()
        assert "\n" not in str(told.value)
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(
        gymnasium.error.DependencyNotInstalled, match=r"^wayfield\.symbolic needs casadi: pip install .*exact"
    ):
        wayfield.symbolic("p3dx")


# Constraints.


@pytest.mark.parametrize(
    ("env_id", "state", "flag", "kwargs"),
    [
        ("DiffDrivePathFollowing", "tube", "left_corridor", {"actuators": "lagged"}),
        ("OmniPathFollowing", "tube", "left_corridor", {"action_mode": "wheel_speeds", "actuators": "slow"}),
        ("DiffDriveGoalObstacles", "clearance", "collision", {"scenario": "clutter_10/train"}),
        ("OmniGoalObstacles", "clearance", "collision", {"scenario": "moving_crowd/train", "disturbance": "delay_1"}),
    ],
)
def test_values_of_constraints(env_id: str, state: str, flag: str, kwargs: dict[str, Any]) -> None:
    plain, told = (gymnasium.make(f"wayfield/{env_id}-v0", **kwargs, **more) for more in ({}, {"constraints": True}))
    base: Any = told.unwrapped
    names = [each.name for each in base.constraints]
    plain.reset(seed=3)
    told.reset(seed=3)
    rng, high, model = np.random.default_rng(3), base.action_space.high, wayfield.symbolic.of(told)
    robot = base.task.robot
    drive = 0.4 * robot.max_twist * np.linspace(1.0, 0.1, len(robot.max_twist))
    if "action_mode" in kwargs:
        drive = robot.wheel_speeds_from_twist(drive)
    ended = 0
    for k in range(900):
        action = 1.2 * high * rng.uniform(-1.0, 1.0, len(high)) if k % 50 == 49 else drive
        before = np.array([base.batch.states[0][name] for name in model.names["x"]])
        (seen, *numbers, info), (same, *others, fewer) = told.step(action), plain.step(action)
        value = dict(zip(names, info.pop("constraint_values").tolist(), strict=True))
        violated = info.pop("constraint_violation")
        assert numbers == others, "nothing else is another"
        assert seen.tobytes() == same.tobytes()
        assert info == fewer
        # the state's: at most zero while the episode goes on, above with the flag that ends it
        assert (value[state] > 0.0) == info[flag]
        assert (max(value.values()) > 1e-3) <= violated <= (max(value.values()) > 0.0)
        # the request's: where all are kept the plant does what is requested
        if not any(each > 0.0 for name, each in value.items() if name != state):
            np.testing.assert_allclose(model.step(before, action), model.smooth(before, action), atol=1e-9)
        if any(numbers[1:3]):
            ended += 1
            plain.reset()
            told.reset()
    assert ended


def test_rows_of_constraints_are_those_of_one_robot_and_of_symbols() -> None:
    kwargs: dict[str, Any] = {"actuators": "lagged", "constraints": True, "max_episode_steps": 40}
    many = gymnasium.make_vec("wayfield/OmniGoalObstacles-v0", 3, vectorization_mode="vector_entry_point", **kwargs)
    alone = [gymnasium.make("wayfield/OmniGoalObstacles-v0", **kwargs) for _ in range(3)]
    many.reset(seed=5)
    for k, each in enumerate(alone):
        each.reset(seed=5 + k)
    rng = np.random.default_rng(5)
    ended = np.zeros(3, bool)
    for _ in range(60):
        actions = rng.uniform(-2.0, 2.0, (3, 3))
        _, _, terminated, truncated, info = many.step(actions)
        for k, each in enumerate(alone):
            found = each.reset()[1] if ended[k] else each.step(actions[k])[4]
            assert found["constraint_values"].tobytes() == info["constraint_values"][k].tobytes()
            assert found["constraint_violation"] == info["constraint_violation"][k]
        ended = terminated | truncated
    u, command = casadi.SX.sym("u", 3), casadi.SX.sym("command", 3)
    for each in many.unwrapped.constraints:
        if each.kind != "state":
            rows = each.function(*({"u": u, "command": command}[name] for name in each.variables))
            found = casadi.Function("g", [u, command], [casadi.vertcat(*rows)])(actions[0], [0.1, 0.2, 0.3])
            own = each.function(*({"u": actions[0], "command": [0.1, 0.2, 0.3]}[name] for name in each.variables))
            np.testing.assert_allclose(found.full()[:, 0], own, atol=1e-12)
