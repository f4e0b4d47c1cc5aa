"""The model predictive path follower: its programs against finite differences and ipopt, its bounds, its failures."""

import copy
import math
import types
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import osqp
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.paths import Path, PathPool
from wayfield.policies import Pilot, mpc
from wayfield.policies.mpc import Mpc, QuadraticProgram
from wayfield.policies.mpc_pose import PoseProgram

DT = 0.05
PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
OMNI_ID = "wayfield/OmniPathFollowing-v0"
Array = NDArray[np.float64]


class Drive:
    """An episode of one robot, its states and the twists asked of it."""

    def __init__(self, scenario: str, policy: Mpc | None = None, env_id: str = PATH_ID, **kwargs: Any) -> None:
        self.env: Any = gymnasium.make(env_id, scenario=scenario, **{"actuators": "lagged", **kwargs})
        self.observation, _ = self.env.reset(seed=0)
        self.pilot = Pilot(policy or Mpc(), self.env)
        self.pilot.reset()
        self.states = [self.env.unwrapped.batch.states[0].copy()]
        self.actions: list[Array] = []
        self.info: dict[str, Any] = {}

    def go(self, steps: int = 1200) -> "Drive":
        for _ in range(steps):
            self.actions.append(self.pilot.command(self.observation))
            self.observation, _, terminated, truncated, self.info = self.env.step(self.actions[-1])
            self.states.append(self.env.unwrapped.batch.states[0].copy())
            if terminated or truncated:
                break
        return self

    def __getitem__(self, name: str) -> NDArray[Any]:
        return np.array([state[name] for state in self.states])

    @property
    def failures(self) -> int:
        return int(self.pilot.memory["qp_failures"][0])

    @property
    def mean_speed(self) -> float:
        return float(np.hypot(np.diff(self["x"]), np.diff(self["y"])).sum() / (DT * (len(self.states) - 1)))

    def seen(self) -> Any:
        return self.pilot.briefing.layout.unpack(self.observation[None].astype(np.float64))


class Problem:
    """The non-linear program that a robot faces, written a second time, for numbers and for symbols."""

    def __init__(self, drive: Drive, policy: Mpc) -> None:
        self.policy, self.drive = policy, drive
        briefing, seen = drive.pilot.briefing, drive.seen()
        self.model = policy.model(briefing)
        self.path = np.empty((200, 3))
        self.start = np.empty(5)
        assert briefing.paths is not None
        mpc.locate(
            briefing.paths.vertices,
            briefing.paths.runs,
            briefing.path_index,
            self.model,
            seen.pose,
            seen.arc_length,
            0,
            self.path,
            self.start,
        )
        self.twist = seen.twist
        self.last = drive.pilot.memory["command"].copy()
        self.n = policy.horizon

    def residuals(self, z: Any, pose_at: Callable[[Any], Any], sin: Any = math.sin, cos: Any = math.cos) -> list[Any]:
        """Returns the terms that the sum squares; z: v, w, sigma of each step."""
        p, m, n = self.policy, self.model[0], self.n
        h = float(m["substeps"] * m["dt"])
        dt = float(m["dt"])
        lag = self.drive.pilot.briefing.actuators.lag
        x, y, th = self.start[:3].tolist()
        v, w = self.twist[0, 0], self.twist[0, -1]
        last_v, last_w = self.last[0]
        terms = []
        for k in range(n):
            for j in range(m["substeps"]):
                share = (j + 1) / m["substeps"]
                to_v, to_w = last_v + share * (z[k] - last_v), last_w + share * (z[n + k] - last_w)
                left = math.exp(-dt / lag) if lag else 0.0
                mean = (1.0 - left) * lag / dt
                mean_v, mean_w = to_v + mean * (v - to_v), to_w + mean * (w - to_w)
                v, w = to_v + left * (v - to_v), to_w + left * (w - to_w)
                half = 0.5 * mean_w * dt
                # sin(half) / half, for halves of no more than a third
                chord = mean_v * dt * (1 - half**2 / 6 + half**4 / 120 - half**6 / 5040)
                x, y, th = x + chord * cos(th + half), y + chord * sin(th + half), th + 2.0 * half
            px, py, pth = pose_at(z[2 * n + k])
            terms += [math.sqrt(h * p.position) * (x - px), math.sqrt(h * p.position) * (y - py)]
            terms += [math.sqrt(h * p.heading) * (th - pth)]
            terms += [math.sqrt(p.acceleration / h) * (z[k] - last_v)]
            terms += [math.sqrt(p.yaw_acceleration / h) * (z[n + k] - last_w)]
            last_v, last_w = z[k], z[n + k]
        return terms

    def pay(self) -> Array:
        """Returns what each unknown is paid with."""
        e = self.policy.eagerness
        pay = np.zeros(3 * self.n)
        pay[2 * self.n :] = 2.0 * e / (self.n + 1)
        pay[-1] += 1.0 - e
        return pay

    def total(self, z: Array) -> float:
        return float(np.square(self.residuals(z, self.pose_at)).sum() - self.pay() @ z)

    def pose_at(self, sigma: float) -> tuple[float, float, float]:
        return mpc.on_path(self.path, sigma)[:3]  # type: ignore[no-any-return]

    def plan(self, memory: NDArray[Any]) -> Array:
        """Returns the plan of a memory as unknowns."""
        places = self.start[3] + np.cumsum(memory["progress"][0])
        return np.concatenate([*memory["commands"][0], places])


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


# scenario, periods driven until the problem, whether ipopt starts from the plan found and its multipliers
IPOPT_CASES = (("s_curve", 80, False), ("right_angle", 90, True), ("right_angle", 115, True))


def planned(scenario: str, steps: int) -> tuple[Problem, Mpc, NDArray[Any], Array]:
    """Returns a problem, the policy that has solved it to the end, its memory, and the plan that it began with."""
    drive = Drive(scenario).go(steps)
    policy = Mpc(iterations=15, tolerance=0.0, solver_iterations=20000)
    problem = Problem(drive, policy)
    old = problem.plan(drive.pilot.memory)
    memory = drive.pilot.memory.copy()
    policy.act(drive.seen(), drive.pilot.briefing, memory)
    assert memory["qp_failures"][0] == 0
    return problem, policy, memory, old


def by_ipopt(problem: Problem, policy: Mpc, memory: NDArray[Any], old: Array, warm: bool) -> Array:
    """Returns the optimal plan of an interior-point method with exact derivatives, and its sum at the end."""
    import casadi

    drive = problem.drive
    n, h = problem.n, policy.step
    # the quadratic B-spline as a sum of truncated powers, whose factors are the third differences of its points
    points = problem.path[: int((problem.start[3] + policy.speed * n * h) / mpc.SPACING) + 5]
    factors = 0.5 * np.diff(points, 3, axis=0, prepend=np.zeros((3, 3)))
    sigma, z = casadi.SX.sym("sigma"), casadi.SX.sym("z", 3 * n)
    powers = casadi.fmax(sigma / mpc.SPACING + 2.5 - np.arange(len(points)), 0) ** 2
    pose_at = casadi.Function("pose_at", [sigma], [casadi.dot(powers, factors[:, axis]) for axis in range(3)])
    terms = casadi.vertcat(*problem.residuals(z, pose_at, casadi.sin, casadi.cos))
    total = casadi.sumsqr(terms) - casadi.dot(problem.pay(), z)

    robot, actuators = drive.pilot.briefing.robot, drive.pilot.briefing.actuators
    v, w, places = z[:n], z[n : 2 * n], z[2 * n :]
    change_v, change_w, gain = (
        each - casadi.vertcat(before, each[:-1])
        for each, before in ((v, problem.last[0, 0]), (w, problem.last[0, 1]), (places, problem.start[3]))
    )
    most, limit = h * actuators.acceleration, robot.rated_wheel_speed
    rows = [
        (v, 0.0, policy.speed),
        (change_v, -most, most),
        (change_w, -h * actuators.yaw_acceleration, h * actuators.yaw_acceleration),
        (gain, 0.0, h * policy.speed),
        *((wheel[0] * v + wheel[2] * w, -limit, limit) for wheel in robot.wheel_matrix),
        (places[-1], -np.inf, problem.start[4]),
    ]
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
    if warm:
        options |= {"ipopt.mu_init": 1e-6, "ipopt.warm_start_init_point": "yes"}
        options |= {
            f"ipopt.warm_start_{push}": 1e-9 for push in ("slack_bound_push", "slack_bound_frac", "mult_bound_push")
        }
    bounded = casadi.vertcat(*(row[0] for row in rows))
    exact = casadi.nlpsol("exact", "ipopt", {"x": z, "f": total, "g": bounded}, options)
    wheels = tuple(map(tuple, robot.wheel_matrix[:, [0, 2]].tolist()))
    program = mpc.quadratic_program(n, wheels, policy.units(problem.model[0]), policy.solver_iterations)
    solution = exact(
        x0=problem.plan(memory) if warm else old,
        lam_g0=memory["multipliers"][0] * program.scale if warm else 0.0,
        lbg=np.concatenate([np.full(row[0].numel(), row[1]) for row in rows]),
        ubg=np.concatenate([np.full(row[0].numel(), row[2]) for row in rows]),
    )
    assert exact.stats()["success"]
    best = np.asarray(solution["x"]).ravel()
    assert problem.total(best) == pytest.approx(float(solution["f"]), abs=1e-6)
    return np.append(best, float(solution["f"]))


def same_plan(problem: Problem, memory: NDArray[Any], best: Array, total: float) -> None:
    """Asserts that a plan is as good as the optimum, and begins alike."""
    found, n = problem.plan(memory), problem.n
    assert problem.total(found) == pytest.approx(total, rel=1e-3)
    assert found[[0, n]] == pytest.approx(best[[0, n]], abs=5e-3)


@pytest.mark.parametrize(("scenario", "steps", "warm"), IPOPT_CASES)
def test_its_plan_is_the_one_that_ipopt_finds(scenario: str, steps: int, warm: bool) -> None:
    """The same non-linear program solved by an interior-point method with exact derivatives.

    Around a corner there are several local optima, and ipopt ends in another, worse one when it starts from the plan of
    the period before: there it starts from the plan and its multipliers, and has to stay.
    """
    pytest.importorskip("casadi")
    problem, policy, memory, old = planned(scenario, steps)
    *best, total = by_ipopt(problem, policy, memory, old, warm)
    same_plan(problem, memory, np.array(best), total)


# The path as a curve of poses.


def ahead(points: Any, start: float, *, closed: bool = False, turn_radius: float = 0.2) -> tuple[Array, float, float]:
    pool = PathPool.of([Path(points, closed)])
    path = np.empty((150, 3))
    seen, end = mpc.poses_ahead(pool.vertices, pool.runs[0], start, start + 0.1, turn_radius, path)
    return path, seen, end


def test_a_corner_is_a_turn_on_the_spot_with_a_length_of_its_own() -> None:
    path, seen, end = ahead([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], 0.5)
    turn = 0.2 * math.pi / 2.0
    assert seen == pytest.approx(0.1)
    # the blend's own length is part of the turn
    assert end == pytest.approx(1.5 + turn - 2.0 * mpc.BLEND)
    assert path[1] == pytest.approx([0.5, 0.0, 0.0])
    sigma = np.arange(-1, len(path) - 1) * mpc.SPACING
    assert path[sigma > end, 2] == pytest.approx(math.pi / 2.0)
    spot = (sigma > 0.5) & (sigma < 0.5 + turn - 2.0 * mpc.BLEND)
    assert np.abs(path[spot, :2] - [1.0, 0.0]).max() <= mpc.BLEND
    # nowhere faster than one or the other allows
    steps = np.diff(path, axis=0)
    assert (np.hypot(steps[:, 0], steps[:, 1]) <= mpc.SPACING + 1e-12).all()
    assert (np.abs(0.2 * steps[:, 2]) <= mpc.SPACING + 1e-12).all()


def test_headings_do_not_jump_over_laps_and_places_lie_on_the_circle() -> None:
    angles = np.linspace(0.0, 2.0 * math.pi, 300, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    length = PathPool.of([Path(circle, True)]).runs["length"][0]
    path, seen, end = ahead(circle, 2.0 * length - 1.0, closed=True)
    assert seen == pytest.approx(0.1)
    assert end == math.inf
    sigma = np.arange(1, 130) * mpc.SPACING
    poses = np.array([mpc.on_path(path, s) for s in sigma])
    assert np.hypot(poses[:, 0], poses[:, 1]) == pytest.approx(1.0, abs=2e-4)
    assert np.diff(poses[:, 2]) == pytest.approx(mpc.SPACING, rel=0.02)
    # slopes are those of the curve
    beyond = np.array([mpc.on_path(path, s + 1e-6) for s in sigma])
    assert (beyond[:, :3] - poses[:, :3]) / 1e-6 == pytest.approx(poses[:, 3:], abs=1e-3)


@pytest.mark.parametrize("steps", [0, 60])
def test_the_path_ahead_begins_behind_what_was_seen_and_the_robot_is_on_it(steps: int) -> None:
    drive = Drive("straight").go(steps)
    seen = drive.seen()
    problem = Problem(drive, Mpc())
    briefing = drive.pilot.briefing
    assert briefing.paths is not None
    run = briefing.paths.runs[briefing.path_index[0]]
    vertex = briefing.paths.vertices[run["first"]]
    first, along = np.array([vertex["x"], vertex["y"]]), np.array([vertex["ux"], vertex["uy"]])
    begin = max(float(seen.arc_length[0]) - 0.1, 0.0)
    for sigma in (0.0, 0.31, 1.2):
        x, y, heading, dx, dy, turn = mpc.on_path(problem.path, sigma)
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
    paths, m = drive.pilot.briefing.paths, problem.model[0]
    assert paths is not None
    run = paths.runs[drive.pilot.briefing.path_index[0]]
    legs = paths.vertices[run["first"] : run["first"] + run["segments"]]
    corner = 1 + int(np.argmax(np.abs(np.diff(legs["heading"])) > 1.0))
    before, after = (float(legs["heading"][k]) for k in (corner - 1, corner))
    x, y = float(legs["x"][corner]), float(legs["y"][corner])
    poses = np.array([[x + 0.01, y - 0.02, before + turned * math.remainder(after - before, math.tau)]])
    arc = np.array([float(legs["s"][corner]) - 0.01])
    which = drive.pilot.briefing.path_index
    mpc.locate(paths.vertices, paths.runs, which, problem.model, poses, arc, 0, problem.path, problem.start)

    def off(sigma: float) -> float:
        px, py, heading = problem.pose_at(sigma)
        turn = math.remainder(poses[0, 2] - heading, math.tau)
        return float(m["position"] * ((x + 0.01 - px) ** 2 + (y - 0.02 - py) ** 2) + m["heading"] * turn**2)

    # three steps of Newton's method leave a hundredth
    assert off(problem.start[3]) <= 1.02 * min(map(off, np.linspace(0.0, 1.2, 1201).tolist())) + 1e-6


# At the wheel.


@pytest.mark.parametrize("scenario", ["straight", "circle"])
def test_on_a_line_and_on_a_circle_it_stays_on_at_full_speed(scenario: str) -> None:
    drive = Drive(scenario).go(300)
    assert np.abs(drive["cross_track_error"]).max() < 1e-3
    assert drive["vx"][40:] == pytest.approx(0.6, abs=5e-3)
    assert drive.failures == 0


def test_right_angles_are_driven_to_three_centimetres_at_a_third_of_a_metre_per_second() -> None:
    drive = Drive("right_angle").go()
    errors, along = drive["cross_track_error"], drive["arc_length"]
    middle = 0.5 * (errors[1:] ** 2 + errors[:-1] ** 2)
    assert drive.info["success"]
    assert math.sqrt((np.diff(along) * middle).sum() / (along[-1] - along[0])) < 0.03
    assert math.sqrt((errors**2).mean()) < 0.03
    assert drive.mean_speed > 0.35
    assert drive.failures == 0


@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
@pytest.mark.parametrize(("env_id", "robot"), [(PATH_ID, "p3dx"), (OMNI_ID, "omni3"), (OMNI_ID, "omni4")])
def test_its_commands_are_within_reach(env_id: str, robot: str, actuators: str) -> None:
    """The base has nothing to cut: no wheel is asked to turn too fast, no acceleration is beyond the nominal."""
    drive = Drive("s_curve_tight", Mpc(speed=1.1), env_id, robot=robot, actuators=actuators).go(120)
    asked = np.array(drive.actions)
    commands = np.column_stack([drive["command_vx"], drive["command_yaw_rate"]])[1:]
    assert asked[:, [0, -1]] == pytest.approx(commands, abs=1e-9)
    base = drive.pilot.briefing.robot
    limit = base.peak_wheel_speed if actuators == "ideal" else base.rated_wheel_speed
    assert np.abs(base.wheel_speeds_from_twist(asked)).max() <= limit * (1.0 + 1e-12)
    assert (asked[:, 0] >= 0.0).all()
    assert (asked[:, 0] <= 1.1).all()
    assert np.abs(drive["cross_track_error"]).max() < 0.1


def test_it_turns_round_when_it_is_turned_away() -> None:
    drive = Drive("straight", shove=(2.0, 0.0, 0.1, 3.0)).go()
    assert drive.info["success"]
    assert np.abs(drive["cross_track_error"]).max() < 0.3
    assert np.abs(drive["cross_track_error"][-100:]).max() < 1e-3


def test_it_stops_at_the_end_of_the_path() -> None:
    drive = Drive("straight", Mpc(speed=0.6))
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


def test_without_a_solution_from_the_start_it_stands_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(QuadraticProgram, "solve", lambda *_: False)
    drive = Drive("s_curve").go(20)
    assert drive.failures == 20
    assert not np.array(drive.actions).any()


@pytest.mark.parametrize(
    ("status", "solved"),
    [("OSQP_SOLVED", True), ("OSQP_SOLVED_INACCURATE", True), ("OSQP_MAX_ITER_REACHED", False),
     ("OSQP_PRIMAL_INFEASIBLE", False), ("OSQP_NON_CVX", False)],
)  # fmt: skip
def test_a_program_is_solved_to_the_tolerance_or_ten_times_that(status: str, solved: bool) -> None:
    wheels = ((10.0, 2.0), (10.0, -2.0))
    for program, size in ((QuadraticProgram(2, wheels, (1.0,) * 6, 10), 6), (PoseProgram(2, wheels, 0.6, 10), 4)):
        for x in (np.full(size, 0.3), np.full(size, math.nan)):
            info = types.SimpleNamespace(status_val=getattr(osqp.SolverStatus, status))
            found = types.SimpleNamespace(info=info, x=x, y=np.zeros(len(program.arrays.lower)))
            program._solver = types.SimpleNamespace(  # type: ignore[assignment]
                update=lambda **_: None, warm_start=lambda *_: None, solve=lambda found=found, **_: found
            )
            start = [np.zeros_like(found.y)] if size == 6 else []
            change = program.solve(1.0, *start)
            assert (change is not False and change is not None) == (solved and not np.isnan(x).any())


def test_iterations_that_do_not_suffice_are_a_failure() -> None:
    assert Drive("s_curve", Mpc(solver_iterations=1)).go(20).failures > 0


def test_without_a_solution_it_drives_its_plan_on_then_brakes(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = Drive("straight").go(80)
    monkeypatch.setattr(QuadraticProgram, "solve", lambda *_: False)
    before = drive.actions[-1][0]
    speeds = np.array(drive.go(30).actions)[-30:, 0]
    assert drive.failures == 30
    # half a second of the plan, which was to drive on, then 1 m/s^2
    assert speeds[:10] == pytest.approx(before, abs=1e-3)
    assert speeds[10:] == pytest.approx(np.maximum(before - 1.0 * DT * np.arange(1, 21), 0.0), abs=1e-3)
    # and it starts again as soon as programs are solved
    monkeypatch.undo()
    drive.go(40)
    assert drive.failures == 30
    assert drive["vx"][-1] > 0.4


@pytest.mark.parametrize(("step", "held"), [(0.05, 0.05), (0.12, 0.1), (0.13, 0.15)])
def test_a_plan_that_is_moved_on_is_the_same_function_of_time(
    monkeypatch: pytest.MonkeyPatch, step: float, held: float
) -> None:
    """Commands and progress at the ends of the steps, linear between them; the last step stays as it is.

    A step lasts as many control periods as come nearest to what was asked.
    """
    monkeypatch.setattr(QuadraticProgram, "solve", lambda *_: False)
    drive = Drive("straight", Mpc(step=step))
    memory, n = drive.pilot.memory, drive.pilot.policy.horizon
    rng = np.random.default_rng(0)
    for name in ("commands", "progress", "multipliers"):
        memory[name] = rng.uniform(0.0, 0.5, memory[name].shape)
    before = memory.copy()
    drive.go(1)
    times = held * np.arange(1, n + 1)

    def later(values: Array) -> Array:
        moved: Array = np.interp(times + DT, times, values)
        return moved

    for j in range(2):
        np.testing.assert_allclose(memory["commands"][0, j], later(before["commands"][0, j]))
    np.testing.assert_allclose(memory["progress"][0], later(before["progress"][0]))
    # those of each kind of bound by themselves; that of the end of the path has no time
    for row in range(0, memory["multipliers"].shape[1] - 1, n):
        kind = slice(row, row + n)
        np.testing.assert_allclose(memory["multipliers"][0, kind], later(before["multipliers"][0, kind]))
    assert memory["multipliers"][0, -1] == before["multipliers"][0, -1]


def test_a_pose_that_is_no_number_counts_as_a_failure() -> None:
    drive = Drive("straight").go(10)
    drive.observation = np.full_like(drive.observation, np.nan)
    assert np.isfinite(drive.pilot.act(drive.observation)).all()
    assert drive.failures == 1


# Nothing is remembered outside the memory.


def test_a_robot_in_a_batch_acts_as_alone_whoever_else_was_solved_for() -> None:
    many: Any = gymnasium.make_vec(PATH_ID, 3, actuators="lagged")
    seen, _ = many.reset(seed=5)
    policy = Mpc()
    pilot = Pilot(policy, many)
    pilot.reset()
    alone: Any = gymnasium.make(PATH_ID, actuators="lagged")
    own, _ = alone.reset(seed=6)
    own_pilot = Pilot(Mpc(), alone)
    own_pilot.reset()
    for _ in range(40):
        actions, action = pilot.act(seen), own_pilot.act(own)
        assert action.tobytes() == actions[1].tobytes()
        seen, *_ = many.step(actions)
        own, *_ = alone.step(action)


def test_the_same_memory_and_observation_give_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = Drive("right_angle").go(90)
    first, second = copy.deepcopy(drive.pilot.memory), copy.deepcopy(drive.pilot.memory)
    policy, briefing, seen = Mpc(), drive.pilot.briefing, drive.seen()
    once = policy.act(seen, briefing, first)
    Drive("circle_r0.5").go(5)
    monkeypatch.setattr(mpc, "quadratic_program", mpc.one_a_thread(mpc.QuadraticProgram))
    again = policy.act(seen, briefing, second)
    assert once.tobytes() == again.tobytes()
    assert first.tobytes() == second.tobytes()


# Gains.


@pytest.mark.parametrize(
    "gain", ["speed", "position", "heading", "acceleration", "yaw_acceleration", "turn_radius", "step"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, "a", True])
def test_gains_out_of_range_are_refused(gain: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"Mpc: {gain} must be a finite number > 0"):
        Mpc(**{gain: value})


@pytest.mark.parametrize(
    ("gain", "value"),
    [
        ("horizon", 0),
        ("horizon", 2.5),
        ("iterations", 0),
        ("solver_iterations", 1.5),
        ("eagerness", 1.1),
        ("patience", -1.0),
    ],
)
def test_other_bad_gains_are_refused(gain: str, value: Any) -> None:
    with pytest.raises(ValueError, match=gain):
        Mpc(**{gain: value})
