"""The predictive path followers: their programs against finite differences and each other, bounds, failures."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from oracles.model_predictive import DT, PATH_ID, Array, Drive, Problem, planned

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.world.paths import Path, PathPool
from wayfield.policies import Pilot, tuned_gains
from wayfield.policies.parts import pose_path
from wayfield.policies.paths import mpc
from wayfield.policies.paths.ilqr import Ilqr
from wayfield.policies.paths.mpc import Mpc

OMNI_ID = "wayfield/OmniPathFollowing-v0"
both = pytest.mark.parametrize("law", [Mpc, Ilqr], ids=["mpc", "ilqr"])


# The program.


@pytest.mark.parametrize("scenario", ["s_curve_tight", "right_angle"])
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
def test_the_program_is_the_sum_to_first_order(scenario: str, actuators: str) -> None:
    """Gradient and Gauss-Newton Hessian against central differences of the residuals, off the optimum."""
    drive = Drive(scenario, actuators=actuators).go(90)
    problem = Problem(drive, Mpc())
    n = problem.n
    memory = drive.pilot.memory.copy()
    rng = np.random.default_rng(0)
    memory["commands"] += rng.uniform(-0.2, 0.2, memory["commands"].shape)
    bounds = np.empty((2, memory["multipliers"].shape[1]))
    program = mpc.Program(np.empty((3 * n, 3 * n)), np.empty(3 * n), np.empty(3 * n), *bounds)
    slope = mpc.linearise(
        problem.model,
        problem.path,
        problem.start,
        problem.twist,
        problem.last,
        memory["commands"],
        memory["progress"],
        0,
        program,
    )
    hessian, gradient, z = program.hessian, program.gradient, program.plan
    np.testing.assert_allclose(z, problem.plan(memory))
    nudge = 1e-5 * np.eye(3 * n)
    jacobian = np.array(
        [
            np.subtract(
                problem.residuals(z + each, problem.pose_at),
                problem.residuals(z - each, problem.pose_at),
            )
            / 2e-5
            for each in nudge
        ]
    )
    expected = 2.0 * jacobian @ jacobian.T
    np.testing.assert_allclose(np.triu(hessian), np.triu(expected), rtol=1e-5, atol=2e-5)
    expected_slope = 2.0 * jacobian @ problem.residuals(z, problem.pose_at) - problem.pay()
    whole = np.triu(hessian) + np.triu(hessian, 1).T
    np.testing.assert_allclose(gradient + whole @ z, expected_slope, rtol=1e-5, atol=2e-5)
    assert slope == pytest.approx(np.abs(expected_slope).max(), rel=1e-5)
    # the bounds: speed, its change, the yaw rate's, the progress, each wheel, the last place
    robot, base, p = drive.pilot.briefing.robot, drive.pilot.briefing.actuators, Mpc()
    v, w = problem.last[0]
    first = np.eye(n)[0]
    speeds = [(0.0 * first, p.speed + 0.0 * first)]
    speeds += [
        (-0.1 * a + now * first, 0.1 * a + now * first)
        for a, now in ((base.acceleration, v), (base.yaw_acceleration, w))
    ]
    speeds += [(problem.start[3] * first, 0.1 * p.speed + problem.start[3] * first)]
    most = robot.rated_wheel_speed if base.at_rated_speed else robot.peak_wheel_speed
    speeds += [(np.full(n, -most), np.full(n, most))] * len(robot.wheel_matrix)
    np.testing.assert_allclose(program.lower, [*np.concatenate([low for low, _ in speeds]), -math.inf])
    np.testing.assert_allclose(program.upper, [*np.concatenate([high for _, high in speeds]), problem.start[4]])


@pytest.mark.parametrize(
    ("scenario", "steps", "within"),
    # before a corner its sweeps creep along a valley of plans that are nearly as good
    [("s_curve", 80, 1e-3), ("right_angle", 90, 0.03), ("right_angle", 115, 0.03)],
)
def test_iterative_lqr_finds_the_plan_of_the_quadratic_programs(scenario: str, steps: int, within: float) -> None:
    """Of the same problem: steps of one length, and squares of the distance."""
    problem, theirs, memory, _ = planned(scenario, steps)
    names = ("speed", "position", "heading", "acceleration", "yaw_acceleration", "eagerness", "turn_radius")
    law = Ilqr(
        **{name: getattr(theirs, name) for name in names},
        softness=1e4, horizon=theirs.horizon * theirs.step, steps=theirs.horizon, sweeps=300, tolerance=0.0,
    )  # fmt: skip
    mine = law.reset(problem.drive.pilot.briefing)
    mine["command"] = problem.last
    law.act(problem.drive.seen(), problem.drive.pilot.briefing, mine)
    speeds, yaw_rates, progress = mine["plan"][0]
    found = np.concatenate([speeds, yaw_rates, problem.start[3] + np.cumsum(progress)])
    assert problem.total(found) == pytest.approx(problem.total(problem.plan(memory)), abs=within)


# The path as a curve of poses.


def ahead(points: Any, start: float, *, closed: bool = False, turn_radius: float = 0.2) -> tuple[Array, float, float]:
    pool = PathPool.of([Path(points, closed)])
    path = np.empty((150, 3))
    seen, end = pose_path.poses_ahead(pool.vertices, pool.runs[0], start, start + 0.1, turn_radius, path)
    return path, seen, end


def test_a_corner_is_a_turn_on_the_spot_with_a_length_of_its_own() -> None:
    path, seen, end = ahead([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], 0.5)
    turn = 0.2 * math.pi / 2.0
    assert seen == pytest.approx(0.1)
    # the blend's own length is part of the turn
    assert end == pytest.approx(1.5 + turn - 2.0 * pose_path.BLEND)
    assert path[1] == pytest.approx([0.5, 0.0, 0.0])
    sigma = np.arange(-1, len(path) - 1) * pose_path.SPACING
    assert path[sigma > end, 2] == pytest.approx(math.pi / 2.0)
    spot = (sigma > 0.5) & (sigma < 0.5 + turn - 2.0 * pose_path.BLEND)
    assert np.abs(path[spot, :2] - [1.0, 0.0]).max() <= pose_path.BLEND
    # nowhere faster than one or the other allows
    steps = np.diff(path, axis=0)
    assert (np.hypot(steps[:, 0], steps[:, 1]) <= pose_path.SPACING + 1e-12).all()
    assert (np.abs(0.2 * steps[:, 2]) <= pose_path.SPACING + 1e-12).all()


def test_headings_do_not_jump_over_laps_and_places_lie_on_the_circle() -> None:
    angles = np.linspace(0.0, 2.0 * math.pi, 300, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    length = PathPool.of([Path(circle, True)]).runs["length"][0]
    path, seen, end = ahead(circle, 2.0 * length - 1.0, closed=True)
    assert seen == pytest.approx(0.1)
    assert end == math.inf
    sigma = np.arange(1, 130) * pose_path.SPACING
    poses = np.array([pose_path.on_path(path, s) for s in sigma])
    assert np.hypot(poses[:, 0], poses[:, 1]) == pytest.approx(1.0, abs=2e-4)
    assert np.diff(poses[:, 2]) == pytest.approx(pose_path.SPACING, rel=0.02)
    # slopes are those of the curve
    beyond = np.array([pose_path.on_path(path, s + 1e-6) for s in sigma])
    assert (beyond[:, :3] - poses[:, :3]) / 1e-6 == pytest.approx(poses[:, 3:], abs=1e-3)


@pytest.mark.parametrize("steps", [0, 60])
def test_the_path_ahead_begins_behind_what_was_seen_and_the_robot_is_on_it(steps: int) -> None:
    drive = Drive("straight").go(steps)
    seen = drive.seen()
    problem = Problem(drive, Mpc())
    course = drive.pilot.briefing.path
    assert course is not None
    run = course.runs[course.path_index[0]]
    vertex = course.vertices[run["first"]]
    first, along = np.array([vertex["x"], vertex["y"]]), np.array([vertex["ux"], vertex["uy"]])
    begin = max(float(seen.arc_length[0]) - 0.1, 0.0)
    for sigma in (0.0, 0.31, 1.2):
        x, y, heading, dx, dy, turn = pose_path.on_path(problem.path, sigma)
        assert (x, y) == pytest.approx(tuple(first + (begin + sigma) * along), abs=1e-9)
        assert (dx, dy, heading, turn) == pytest.approx((*along, math.atan2(along[1], along[0]), 0.0), abs=1e-9)
    at = float((seen.pose[0, :2] - first) @ along) - begin
    assert problem.start[3] == pytest.approx(max(at, 0.0), abs=1e-6)
    assert problem.start[:3] == pytest.approx(seen.pose[0], abs=1e-12)


@pytest.mark.parametrize("turned", [0.0, 0.3, 0.6, 0.95])
def test_a_robot_is_where_pose_and_heading_are_nearest_also_in_a_corner_that_it_turns_on(turned: float) -> None:
    """Its projection knows no turn: all of that lies ahead of it."""
    drive = Drive("right_angle")
    problem = Problem(drive, Mpc())
    course, m = drive.pilot.briefing.path, problem.model[0]
    assert course is not None
    run = course.runs[course.path_index[0]]
    legs = course.vertices[run["first"] : run["first"] + run["segments"]]
    corner = 1 + int(np.argmax(np.abs(np.diff(legs["heading"])) > 1.0))
    before, after = (float(legs["heading"][k]) for k in (corner - 1, corner))
    x, y = float(legs["x"][corner]), float(legs["y"][corner])
    poses = np.array([[x + 0.01, y - 0.02, before + turned * math.remainder(after - before, math.tau)]])
    arc = np.array([float(legs["s"][corner]) - 0.01])
    pose_path.locate(*course, problem.model, poses, arc, 0, problem.path, problem.start)

    def off(sigma: float) -> float:
        px, py, heading = problem.pose_at(sigma)
        turn = math.remainder(poses[0, 2] - heading, math.tau)
        return float(m["position"] * ((x + 0.01 - px) ** 2 + (y - 0.02 - py) ** 2) + m["heading"] * turn**2)

    # three steps of Newton's method leave a hundredth
    assert off(problem.start[3]) <= 1.02 * min(map(off, np.linspace(0.0, 1.2, 1201).tolist())) + 1e-6


# At the wheel.


@pytest.mark.parametrize(("law", "most"), [(Mpc, 1e-3), (Ilqr, 2e-3)], ids=["mpc", "ilqr"])
@pytest.mark.parametrize("scenario", ["straight", "circle"])
def test_on_a_line_and_on_a_circle_it_stays_on_at_full_speed(scenario: str, law: Any, most: float) -> None:
    drive = Drive(scenario, law()).go(300)
    assert np.abs(drive["cross_track_error"]).max() < most
    assert drive["vx"][40:] == pytest.approx(0.6, abs=5e-3)
    assert drive.failures == 0


@both
def test_right_angles_are_driven_to_three_centimetres_at_a_third_of_a_metre_per_second(law: Any) -> None:
    drive = Drive("right_angle", law()).go()
    errors, along = drive["cross_track_error"], drive["arc_length"]
    middle = 0.5 * (errors[1:] ** 2 + errors[:-1] ** 2)
    assert drive.info["success"]
    assert math.sqrt((np.diff(along) * middle).sum() / (along[-1] - along[0])) < 0.03
    assert math.sqrt((errors**2).mean()) < 0.03
    assert drive.mean_speed > 0.35
    assert drive.failures == 0


@both
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
@pytest.mark.parametrize(("env_id", "robot"), [(PATH_ID, "p3dx"), (OMNI_ID, "omni3"), (OMNI_ID, "omni4")])
def test_its_commands_are_within_reach(env_id: str, robot: str, actuators: str, law: Any) -> None:
    """The base has nothing to cut: no wheel is asked to turn too fast, no acceleration is beyond the nominal."""
    drive = Drive("s_curve_tight", law(speed=1.1), env_id, robot=robot, actuators=actuators).go(120)
    asked = np.array(drive.actions)
    commands = np.column_stack([drive["command_vx"], drive["command_yaw_rate"]])[1:]
    assert asked[:, [0, -1]] == pytest.approx(commands, abs=1e-9)
    base = drive.pilot.briefing.robot
    limit = base.peak_wheel_speed if actuators == "ideal" else base.rated_wheel_speed
    assert np.abs(base.wheel_speeds_from_twist(asked)).max() <= limit * (1.0 + 1e-12)
    assert (asked[:, 0] >= 0.0).all()
    assert (asked[:, 0] <= 1.1).all()
    assert np.abs(drive["cross_track_error"]).max() < 0.1


@both
def test_it_turns_round_when_it_is_turned_away(law: Any) -> None:
    drive = Drive("straight", law(), shove=(2.0, 0.0, 0.1, 3.0)).go()
    assert drive.info["success"]
    assert np.abs(drive["cross_track_error"]).max() < 0.3
    assert np.abs(drive["cross_track_error"][-100:]).max() < 1e-3


@both
def test_it_stops_at_the_end_of_the_path(law: Any) -> None:
    drive = Drive("straight", law())
    drive.pilot.memory["command"] = 0.6, 0.0
    briefing = drive.pilot.briefing
    x, v = 11.0, 0.6
    for _ in range(100):
        seen = drive.seen()._replace(
            pose=np.array([[x, 0.0, 0.0]]), twist=np.array([[v, 0.0]]), arc_length=np.array([x])
        )
        command = drive.pilot.policy.act(seen, briefing, drive.pilot.memory)[0, 0]
        left = math.exp(-DT / 0.1)
        x += DT * command + 0.1 * (1.0 - left) * (v - command)
        v = command + left * (v - command)
    assert x == pytest.approx(12.0, abs=0.01)
    assert v == pytest.approx(0.0, abs=0.01)


# When a program is not solved.


def test_iterations_that_do_not_suffice_are_a_failure() -> None:
    assert Drive("s_curve", Mpc(solver_iterations=1)).go(20).failures > 0


@both
def test_a_pose_that_is_no_number_is_driven_by_the_plan(law: Any) -> None:
    drive = Drive("straight", law()).go(10)
    drive.observation = np.full_like(drive.observation, np.nan)
    assert np.isfinite(drive.pilot.act(drive.observation)).all()
    assert drive.failures == (law is Mpc)


@pytest.mark.parametrize(
    ("scenario", "index", "seed"),
    [
        ("circles/claims", 21, 1935915429),
        ("figure_eights_gerono/claims", 17, 2081140492),
        ("circuits/claims", 9, 524733596),
    ],
)
def test_a_plan_to_stand_is_left(scenario: str, index: int, seed: int) -> None:
    """Starts from which the searched gains stood for ever: beside the path, where to drive first costs more."""
    env = gymnasium.make(PATH_ID, scenario=scenario, actuators="lagged")
    observation, info = env.reset(seed=seed, options={"scenario": index})
    pilot = Pilot(Mpc(**tuned_gains("mpc", "path-following")), env)
    pilot.reset()
    for _ in range(100):
        observation, _, _, _, info = env.step(pilot.act(observation))
    assert info["arc_length"] > 1.0
    assert abs(info["cross_track_error"]) < 0.02
