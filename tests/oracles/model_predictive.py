"""The model predictive follower's problem, written a second time, and its solution by ipopt."""

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.policies import Pilot
from wayfield.policies.parts import pose_path
from wayfield.policies.parts.policy import Policy
from wayfield.policies.paths import mpc
from wayfield.policies.paths.mpc import Mpc

DT = 0.05
PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
Array = NDArray[np.float64]


class Drive:
    """An episode of one robot, its states and the twists asked of it."""

    def __init__(self, scenario: str, policy: Policy | None = None, env_id: str = PATH_ID, **kwargs: Any) -> None:
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
        memory = self.pilot.memory
        return int(memory["qp_failures"][0]) if "qp_failures" in memory.dtype.names else 0

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
        self.model = policy.model(briefing.robot, briefing.actuators, briefing.dt)
        self.path = np.empty((200, 3))
        self.start = np.empty(5)
        assert briefing.path is not None
        pose_path.locate(
            *briefing.path,
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
        dt = float(m["plant"]["dt"])
        h = float(m["substeps"]) * dt
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
        return pose_path.on_path(self.path, sigma)[:3]  # type: ignore[no-any-return]

    def plan(self, memory: NDArray[Any]) -> Array:
        """Returns the plan of a memory as unknowns."""
        places = self.start[3] + np.cumsum(memory["progress"][0])
        return np.concatenate([*memory["commands"][0], places])


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
    points = problem.path[: int((problem.start[3] + policy.speed * n * h) / pose_path.SPACING) + 5]
    factors = 0.5 * np.diff(points, 3, axis=0, prepend=np.zeros((3, 3)))
    sigma, z = casadi.SX.sym("sigma"), casadi.SX.sym("z", 3 * n)
    powers = casadi.fmax(sigma / pose_path.SPACING + 2.5 - np.arange(len(points)), 0) ** 2
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
