"""The laws of Stanley and of the linear-quadratic regulator, and the speed profile, against what is known of them."""

import json
import math
from pathlib import Path as File
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.path_following import Observation
from wayfield.envs.robots.records import record
from wayfield.envs.scenarios.curves import circle_path
from wayfield.envs.world.paths import Path, PathPool
from wayfield.policies import Pilot
from wayfield.policies.parts.speed_profile import SPACING, curvature_at, heading_at, reference_at, speed_at
from wayfield.policies.paths.lqr import Lqr, gain_table, model
from wayfield.policies.paths.stanley import Stanley

DIFF_ID = "wayfield/DiffDrivePathFollowing-v0"
OMNI_ID = "wayfield/OmniPathFollowing-v0"
both = pytest.mark.parametrize("policy", [Stanley(), Lqr()], ids=["stanley", "lqr"])


def drive(policy: Any, num_envs: int = 1, env_id: str = DIFF_ID, steps: int = 1200, **options: Any) -> dict[str, Any]:
    """Returns the states (n + 1, b), the actions (n, b, t) and who succeeded, until all robots' first episodes end."""
    env: Any = gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point", **options)
    seen, _ = env.reset(seed=0)
    pilot = Pilot(policy, env)
    pilot.reset()
    states, actions = [env.unwrapped.batch.states.copy()], []
    ended, succeeded = np.zeros(num_envs, bool), np.zeros(num_envs, bool)
    for _ in range(steps):
        actions.append(pilot.command(seen))
        seen, _, terminated, truncated, info = env.step(actions[-1])
        states.append(env.unwrapped.batch.states.copy())
        succeeded |= info["success"] & ~ended
        ended |= terminated | truncated
        if ended.all():
            break
    return {"states": np.array(states), "actions": np.array(actions), "success": succeeded}


# The regulator's gains.


@pytest.mark.parametrize(("actuators", "lag"), [("ideal", 0.0), ("lagged", 0.1), ("slow", 0.25)])
def test_the_regulator_on_a_straight_line_is_its_linear_closed_loop(actuators: str, lag: float) -> None:
    policy = Lqr()
    shoved = 80
    run = drive(policy, scenario="straight", actuators=actuators, shove=(0.05 * shoved, 0.0, 0.002, 0.0), steps=180)
    states = run["states"][shoved + 1 :, 0]
    speeds, gains = gain_table(policy.speed, 0.05, lag, policy.q_e, policy.q_th)
    k = np.array([[np.interp(0.6, speeds, column) for column in gains.T]])
    a, b = model(0.6, 0.05, lag)
    errors = np.column_stack([states["cross_track_error"], states["heading_error"], states["wheel_yaw_rate"]])
    linear = errors[0]
    for measured in errors:
        np.testing.assert_allclose(measured, linear, atol=2e-6)
        linear = (a - b @ k) @ linear
    assert abs(errors[0, 0]) > 1e-3
    assert np.abs(errors[-1]).max() < 1e-5


@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
def test_feed_forward_leaves_no_offset_on_a_circle(actuators: str) -> None:
    run = drive(Lqr(), scenario="circle", actuators=actuators, steps=600)
    # the polyline itself lies up to 5e-5 m inside the circle
    assert np.abs(run["states"]["cross_track_error"][300:]).max() < 2e-4


@pytest.mark.parametrize("e", [0.05, 0.2, 0.3])
def test_feed_forward_beside_a_circle_is_that_of_the_concentric_circle(e: float) -> None:
    """w = v k / (1 - k e): the feedback of +e and -e cancels where the yaw rates are already right."""
    v, radius = 0.4, 1.0
    env: Any = gymnasium.make(DIFF_ID, scenario="circle", actuators="lagged")
    seen, _ = env.reset(seed=0)
    pilot = Pilot(Lqr(speed=v), env)
    pilot.reset()
    fields = pilot.briefing.layout.unpack(seen[None].astype(np.float64))
    asked = []
    for offset in (e, -e):
        angle = 2.0
        observation = fields._replace(
            pose=np.array(
                [[(radius - offset) * math.cos(angle), (radius - offset) * math.sin(angle), angle + math.pi / 2]]
            ),
            twist=np.array([[v, v / (radius - offset)]]),
            arc_length=np.array([radius * angle]),
        )
        twists = pilot.policy.act(observation, pilot.briefing, np.full((1, 1), v))
        assert twists[0, 0] == pytest.approx(v, abs=1e-6)
        asked.append(twists[0, 1])
    assert sum(asked) == pytest.approx(v / (radius - e) + v / (radius + e), rel=3e-3)
    # a robot on the left, inside, is led to the right
    assert asked[0] < v / (radius - e)
    # and nearly without feedback each has its own
    free = Lqr(speed=v, q_e=1e-9, q_th=1e-9)
    for offset in (e, -e):
        place = [(radius - offset) * math.cos(2.0), (radius - offset) * math.sin(2.0), 2.0 + math.pi / 2]
        observation = fields._replace(
            pose=np.array([place]), twist=np.array([[v, v / (radius - offset)]]), arc_length=np.array([2.0 * radius])
        )
        twists = free.act(observation, pilot.briefing, np.full((1, 1), v))
        assert twists[0, 1] == pytest.approx(v / (radius - offset), rel=3e-3)


def test_the_regulator_stops_at_an_open_end() -> None:
    pool = PathPool.of([Path([(0.0, 0.0), (3.0, 0.0)])])
    run = pool.runs[0]
    assert speed_at(pool.vertices, run, 3.0, 0.1, READ) == 0.0
    assert speed_at(pool.vertices, run, 3.5, 0.1, READ) == 0.0
    assert speed_at(pool.vertices, run, 2.9, 0.1, READ) == pytest.approx(math.sqrt(2.0 * 0.8 * 0.1))
    assert speed_at(pool.vertices, run, 1.0, 0.1, READ) == pytest.approx(0.6)


# The speed profile.


class Limits(NamedTuple):
    """What `speed_at` reads of a law's record."""

    speed: float = 0.6
    acceleration: float = 0.8
    lateral_acceleration: float = 1.0
    yaw_acceleration: float = 2.4
    max_speed: float = 1.0
    max_yaw_rate: float = 5.0


LIMITS = Limits()
# a record, whose type every process can read back: a class of this file would spoil the laws' compiled code for others
READ = record([(name, np.float64) for name in Limits._fields], LIMITS._asdict())[0]
coordinates = st.integers(-8, 8).map(lambda k: 0.25 * k)
polylines = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=8).filter(
    lambda points: all(a != b for a, b in zip(points, points[1:] + points[:1], strict=True))
)


@settings(max_examples=3 * settings().max_examples // 5)
@given(polylines, st.booleans(), st.sampled_from([0.05, 0.1, 0.2]))
# it turns back on itself, and rounding decides to which side
@example([(1.25, -0.75), (0.0, 0.5), (0.0, 0.0), (1.0, -0.5)], True, 0.1)
def test_the_profile_keeps_every_limit(points: list[tuple[float, float]], closed: bool, rounding: float) -> None:
    pool = PathPool.of([Path(points, closed)])
    run = pool.runs[0]
    step = SPACING * rounding
    s = np.arange(0.5 * step, run["length"], step)
    v = np.array([speed_at(pool.vertices, run, each, rounding, READ) for each in s])
    kappa = np.array([curvature_at(pool.vertices, run, each, rounding) for each in s])
    assert (v >= 0.0).all()
    assert (v <= LIMITS.speed).all()
    assert (v**2 * np.abs(kappa) <= LIMITS.lateral_acceleration + 1e-9).all()
    after, before = (
        [curvature_at(pool.vertices, run, each + h, rounding) for each in s] for h in (rounding, -rounding)
    )
    rate = np.subtract(after, before) / (2.0 * rounding)
    assert (v**2 * np.abs(rate) <= LIMITS.yaw_acceleration + 1e-9).all()
    assert (v / LIMITS.max_speed + v * np.abs(kappa) / LIMITS.max_yaw_rate <= 1.0 + 1e-9).all()
    assert (np.abs(np.diff(v**2)) <= 2.0 * LIMITS.acceleration * step + 1e-7).all()
    if not closed:
        # and it is as fast as they allow: each bound, and what lets it slow down to and speed up from all others
        with np.errstate(divide="ignore"):
            bends = np.minimum(LIMITS.lateral_acceleration / np.abs(kappa), LIMITS.yaw_acceleration / np.abs(rate))
        wheels = 1.0 / (1.0 / LIMITS.max_speed + np.abs(kappa) / LIMITS.max_yaw_rate)
        cap = np.minimum(np.minimum(bends, wheels**2), LIMITS.speed**2)
        fastest = (cap + 2.0 * LIMITS.acceleration * np.abs(s[:, None] - s)).min(axis=1)
        fastest = np.minimum(fastest, 2.0 * LIMITS.acceleration * (run["length"] - s))
        assert v**2 == pytest.approx(fastest, abs=1e-6)


@given(st.floats(0.05, 2.5), st.sampled_from([0.05, 0.1, 0.2]))
def test_a_corner_turns_by_its_angle(angle: float, rounding: float) -> None:
    pool = PathPool.of([Path([(-2.0, 0.0), (0.0, 0.0), (2.0 * math.cos(angle), 2.0 * math.sin(angle))])])
    run = pool.runs[0]
    s = np.linspace(2.0 - 2.5 * rounding, 2.0 + 2.5 * rounding, 2001)
    kappa = np.array([curvature_at(pool.vertices, run, each, rounding) for each in s])
    assert np.abs(kappa[[0, -1]]).max() < 1e-9
    assert kappa.max() == pytest.approx(angle / (2.0 * rounding))
    assert kappa.mean() * (s[-1] - s[0]) == pytest.approx(angle, rel=1e-2)


@given(st.floats(0.5, 5.0), st.floats(0.0, 6.0))
def test_rounding_leaves_a_circle_where_it_is(radius: float, s: float) -> None:
    pool = PathPool.of([circle_path(radius)])
    run = pool.runs[0]
    x, y = reference_at(pool.vertices, run, s, 0.1)
    centre = pool.vertices["x"][:-1].mean(), pool.vertices["y"][:-1].mean()
    # h^4 / R^3 and the sagitta of the polyline
    assert math.hypot(x - centre[0], y - centre[1]) == pytest.approx(radius, abs=1e-4 / radius**3 + 1e-4 / radius)
    assert curvature_at(pool.vertices, run, s, 0.1) == pytest.approx(1.0 / radius, rel=1e-2)


def test_a_straight_path_goes_on_beyond_its_ends() -> None:
    pool = PathPool.of([Path([(0.0, 0.0), (1.0, 1.0)])])
    for s in (-1.0, 0.0, 0.7, math.sqrt(2.0), 3.0):
        assert reference_at(pool.vertices, pool.runs[0], s, 0.1) == pytest.approx((s * math.sqrt(0.5),) * 2)
        assert heading_at(pool.vertices, pool.runs[0], s, 0.1) == pytest.approx(0.25 * math.pi)


# Stanley.


def test_the_axle_comes_to_the_path_at_the_rate_of_the_law() -> None:
    policy = Stanley()
    shoved = 60
    run = drive(policy, scenario="straight", shove=(0.05 * shoved, 0.0, 0.01, 0.0), steps=110)
    states = run["states"][shoved + 1 :, 0]
    e = states["y"] + policy.axle_distance * np.sin(states["heading"])
    rate = policy.k * policy.speed / (policy.k_s + policy.speed)
    # a control period at a time
    np.testing.assert_allclose(e[2:40] / e[1:39], 1.0 - rate * 0.05, rtol=5e-3)


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0])
def test_the_axle_and_not_the_centre_runs_on_a_circle(radius: float) -> None:
    names = {0.5: "circle_r0.5", 1.0: "circle", 2.0: "circle_r2"}
    # at 0.6 m/s, three segments in two periods, the robot would see every segment at the same two places
    policy = Stanley(speed=0.57)
    run = drive(policy, scenario=names[radius], steps=800)
    inside = radius - math.sqrt(radius**2 - policy.axle_distance**2)
    # counter-clockwise: inside is left, where errors are positive
    assert run["states"]["cross_track_error"][400:].mean() == pytest.approx(inside, abs=1e-4)


@pytest.mark.parametrize("e", [-0.3, -1e-3, -1e-6, 0.0, 1e-6, 1e-3, 0.3])
def test_a_robot_at_rest_does_not_flip_over(e: float) -> None:
    policy = Stanley(max_steering_rate=1000.0)
    env: Any = gymnasium.make(DIFF_ID, scenario="straight")
    env.reset(seed=0)
    briefing = env.unwrapped.briefing("path")
    seen = Observation(
        pose=np.array([[1.0, e, 0.0]]),
        twist=np.zeros((1, 2)),
        cross_track_error=np.array([e]),
        heading_error=np.zeros(1),
        arc_length=np.ones(1),
        preview=np.zeros((1, 0, 2)),
    )
    v, w = policy.act(seen, briefing, policy.reset(briefing))[0]
    assert v > 0.0
    assert w == 0.0 if e == 0.0 else w * e < 0.0
    assert abs(w) <= policy.speed / policy.axle_distance


# Both.


@both
@pytest.mark.parametrize("actuators", ["ideal", "slow"])
@pytest.mark.parametrize("scenario", ["right_angle", "zigzag", "s_curve_tight"])
def test_corners_and_tight_curves_are_driven_to_the_end(policy: Any, actuators: str, scenario: str) -> None:
    assert drive(policy, scenario=scenario, actuators=actuators)["success"].all()


@both
def test_a_path_that_turns_back_on_itself_is_driven_to_the_end(policy: Any, tmp_path: File) -> None:
    file = tmp_path / "there_and_back.json"
    file.write_text(json.dumps({"path": [[0, 0], [2, 0], [0, 0]], "closed": False}))
    assert drive(policy, scenario=str(file), actuators="lagged")["success"].all()


@both
@pytest.mark.parametrize("robot", ["omni3", "omni4"])
def test_an_omni_base_is_driven_as_a_unicycle(policy: Any, robot: str) -> None:
    run = drive(policy, 4, OMNI_ID, robot=robot, actuators="lagged")
    assert not run["actions"][:, :, 1].any()
    assert run["success"].all()


def test_a_wheel_steered_past_a_right_angle_is_refused() -> None:
    with pytest.raises(ValueError, match="max_steering"):
        Stanley(max_steering=1.6)
