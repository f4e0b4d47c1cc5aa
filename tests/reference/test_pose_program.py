"""Predictive control to a pose in plain Python: its sum, first plans, program, and twist."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.poses.mpc_pose import MpcPose

DT = 0.05
ROBOT = ROBOTS["p3dx"]


def wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


class Motion:
    """The base, behind a lag, on exact arcs."""

    def __init__(self, pose: Any, twist: Any, lag: float) -> None:
        self.place, self.heading = complex(pose[0], pose[1]), pose[2]
        self.twist, self.lag = np.array(twist, float), lag

    def drive(self, command: Any) -> None:
        decay = math.exp(-DT / self.lag) if self.lag else 0.0
        off = self.twist - command
        v, w = command + off * self.lag / DT * (1.0 - decay)
        turn = w * DT
        chord = v * DT if abs(turn) < 1e-12 else v * (np.exp(1j * turn) - 1.0) / (1j * w)
        self.place += chord * np.exp(1j * self.heading)
        self.heading += turn
        self.twist = command + off * decay


def states(p: MpcPose, start: Any, last: Any, plan: Any, lag: float) -> Any:
    """Returns x, y and heading (n, 3) at the end of each step."""
    moving, found, before = Motion(*start, lag), [], np.array(last)
    substeps = max(round(p.step / DT), 1)
    for after in plan.T:
        for j in range(substeps):
            moving.drive(before + (j + 1) / substeps * (after - before))
        before = after
        found.append([moving.place.real, moving.place.imag, moving.heading])
    return np.array(found)


def residuals(p: MpcPose, start: Any, last: Any, plan: Any, lag: float) -> Any:
    """Returns what the sum is of the squares of."""
    x, y, th = states(p, start, last, plan, lag).T
    v, w = plan
    return np.sqrt(p.step) * np.concatenate(
        [
            math.sqrt(p.along) * x**2,
            math.sqrt(p.across) * y,
            math.sqrt(p.heading) * th**2,
            math.sqrt(p.effort) * v**2,
            math.sqrt(p.effort) / 4.0 * w**2,
        ]
    )


def polar(p: MpcPose, start: Any, last: Any, way: float, n: int, base: Any) -> Any:
    """Returns what the polar law, k = (3, 8, -1.5), drives."""
    moving, (v, w), found = Motion(*start, base.lag), last, []
    for _ in range(n):
        for _ in range(max(round(p.step / DT), 1)):
            goal = -way * moving.place * np.exp(-1j * moving.heading)
            rho, alpha = abs(goal), math.atan2(goal.imag, goal.real)
            turn = wrap(-moving.heading)
            if rho > p.arrival_radius:
                to = np.array([3.0 * rho, 8.0 * alpha - 1.5 * wrap(turn - alpha)])
                slow = math.sqrt(2.0 * 0.4 * min(base.acceleration, 1.0) * rho)
                to *= min(1.0, p.speed / to[0], slow / to[0], p.max_yaw_rate / max(abs(to[1]), 1e-12))
                to[0] *= way
            else:
                alpha_most = min(p.yaw_acceleration, base.yaw_acceleration)
                e = abs(moving.heading)
                rate = min(p.turn_gain * e, math.sqrt(2.0 * alpha_most * e), p.max_yaw_rate)
                to = np.array([0.0, math.copysign(rate, -moving.heading)])
            v += clip(to[0] - v, -base.acceleration * DT, base.acceleration * DT)
            w += clip(to[1] - w, -base.yaw_acceleration * DT, base.yaw_acceleration * DT)
            moving.drive(np.array([v, w]))
        found.append([v, w])
    return np.array(found).T


def loop(p: MpcPose, y: float, way: float, n: int) -> Any:
    """Returns the loop, v = a sin and w = 2 a cos, that takes y off, each within its bound."""
    a = min(math.sqrt(4.0 * math.pi * abs(y) / (n * p.step) ** 2 / 2.0), p.speed)
    s = 2.0 * math.pi * np.arange(1, n + 1) / n
    return np.array([way * a * np.sin(s), -way * math.copysign(min(2.0 * a, p.max_yaw_rate), y) * np.cos(s)])


def slopes(function: Any, at: Any) -> Any:
    """Returns the derivatives of a function by central differences."""
    h, columns = 1e-5, []
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = h
        above, below = (function((at.ravel() + sign * step).reshape(at.shape)) for sign in (1.0, -1.0))
        columns.append((above - below) / (2.0 * h))
    return np.array(columns).T


def least(hessian: Any, gradient: Any, rows: Any, lower: Any, upper: Any) -> Any:
    """Returns the x of least x H x / 2 + g x with rows x within bounds."""
    there = np.isfinite(upper)
    found = minimize(
        lambda x: 0.5 * x @ hessian @ x + gradient @ x, np.zeros(len(gradient)), jac=lambda x: hessian @ x + gradient,
        method="SLSQP", constraints=[
            {"type": "ineq", "fun": lambda x: upper[there] - rows[there] @ x, "jac": lambda _: -rows[there]},
            {"type": "ineq", "fun": lambda x: rows[there] @ x - lower[there], "jac": lambda _: rows[there]},
        ], options={"ftol": 1e-12, "maxiter": 500},
    )  # fmt: skip
    assert found.success, found.message
    return found.x


FAR = 5e-3  # how near programs are solved, whose residuals are 1e-4
PREDICTED = [
    MpcPose(),
    MpcPose(
        speed=0.5, along=2.0, across=3.0, heading=0.4, effort=0.3, horizon=12, step=0.12, arrival_radius=0.05,
        turn_gain=1.3, yaw_acceleration=0.6, max_yaw_rate=1.1,
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("actuators", "policy"),
    [("ideal", PREDICTED[0]), ("slow", PREDICTED[0]), ("ideal", PREDICTED[1]), ("lagged", PREDICTED[1])],
    ids=["ideal-default", "slow-default", "ideal-other", "lagged-other"],
)
def test_predictive_control_to_a_pose_is_its_docstring(actuators: str, policy: MpcPose) -> None:
    b, n, rng, base = 12, policy.horizon, np.random.default_rng(13), ACTUATORS[actuators]
    briefing = Briefing(b, ROBOT, base, DT, "twist", Observation.layout(2, 0, 5.0), np.empty(0), 5.0)
    memory = policy.reset(briefing)
    memory["command"] = rng.uniform(-0.3, 0.3, (b, 2))
    memory["commands"] = memory["command"][:, :, None] + np.cumsum(
        rng.normal(0.0, 0.01, memory["commands"].shape), axis=2
    )
    before = {name: memory[name].copy() for name in ("command", "commands")}
    goals, turns = rng.uniform(-1.2, 1.2, (b, 2)), rng.uniform(-2.5, 2.5, b)
    left, twists = (rng.random(b) < 0.2).astype(float), memory["command"] + rng.normal(0.0, 0.03, (b, 2))
    got = policy.act(Observation(np.zeros((b, 3)), twists, goals, turns, left, np.zeros((b, 0))), briefing, memory)
    solved = 0
    for i in range(b):
        last, old = before["command"][i], before["commands"][i]
        turn = turns[i] if left[i] == 0.0 else math.atan2(goals[i, 1], goals[i, 0])
        place = -complex(*goals[i]) * np.exp(-1j * turn)
        start = (place.real, place.imag, -turn), twists[i]

        def parts(plan: Any, start: Any = start, last: Any = last) -> Any:
            return residuals(policy, start, last, plan, base.lag)

        def cost(plan: Any, parts: Any = parts) -> float:
            return float((parts(plan) ** 2).sum())

        # the last plan, moved on by a control period, the polar law and the loop, forward and backward
        substeps = max(round(policy.step / DT), 1)
        moved = old.copy()
        moved[:, :-1] += (old[:, 1:] - old[:, :-1]) / substeps
        new = [each for way in (1.0, -1.0)
               for each in (polar(policy, start, last, way, n, base), loop(policy, place.imag, way, n))]  # fmt: skip
        plan = min(moved, *new, key=cost)
        # the program: the sum's gradient, Gauss and Newton's Hessian, a fiftieth of its largest entry to all
        jacobian = slopes(parts, plan)
        hessian, gradient = 2.0 * jacobian.T @ jacobian, 2.0 * jacobian.T @ parts(plan)
        hessian[np.diag_indices(2 * n)] += 0.02 * np.diag(hessian).max()
        # its bounds: what the plan leaves of speeds, accelerations and wheels; a plan beyond one need not come back
        held = substeps * DT  # of a step, in whole control periods
        wheels = ROBOT.wheel_matrix
        limit = ROBOT.rated_wheel_speed if base.at_rated_speed else ROBOT.peak_wheel_speed
        speeds, steps = np.eye(n), np.eye(n) - np.eye(n, k=-1)
        rows = [np.kron(np.eye(2), speeds), np.kron(np.eye(2), steps)]
        rows += [np.kron(row[[0, 2]], speeds) for row in wheels]
        most = [policy.speed, policy.max_yaw_rate, held * base.acceleration, held * base.yaw_acceleration]
        bounds = np.repeat([*most, *[limit] * len(wheels)], n)
        first = np.zeros(4 * n)
        first[[2 * n, 3 * n]] = last
        values = np.vstack(rows) @ plan.ravel() - np.append(first, np.zeros(len(wheels) * n))
        lower, upper = np.minimum(-bounds - values, 0.0), np.maximum(bounds - values, 0.0)
        taken = (memory["commands"][i] - plan).ravel()
        if memory["qp_failures"][i]:
            assert abs(taken).max() < 1e-9
        else:
            solved += 1
            rows = np.vstack(rows)
            best = least(hessian, gradient, rows, lower, upper)
            worth = 0.5 * best @ hessian @ best + gradient @ best

            def solves(change: Any, rows: Any = rows, within: Any = (lower, upper), worth: float = worth,
                       of: Any = (hessian, gradient)) -> bool:  # fmt: skip
                off = max((rows @ change - within[1]).max(), (within[0] - rows @ change).max())
                return off < FAR and 0.5 * change @ of[0] @ change + of[1] @ change < worth + FAR * abs(worth)

            shares = [share for share in (1.0, 0.5, 0.25) if solves(taken / share)]
            # the largest share of the change that is cheaper, or none of it
            assert shares or cost(plan + 0.25 * best.reshape(2, n)) >= cost(plan) * (1.0 - FAR)
            assert not shares or cost(plan + taken.reshape(2, n)) < cost(plan)
            assert all(cost(plan + more * best.reshape(2, n)) >= cost(plan) * (1.0 - FAR)
                       for more in (1.0, 0.5) if shares and more > shares[0])  # fmt: skip
        # the plan's start within reach
        new = memory["commands"][i]
        asked = last + (new[:, 0] - last) / substeps
        rim = np.abs(wheels @ [asked[0], 0.0, asked[1]]).max()
        asked = asked * min(1.0, limit / rim, ROBOT.turn_speed / max(abs(asked[1]), 1e-12))
        reach = np.array([base.acceleration, base.yaw_acceleration]) * DT
        twist = last + np.clip(asked - last, -reach, reach)
        np.testing.assert_allclose(got[i], twist, atol=1e-9)
        np.testing.assert_allclose(memory["command"][i], twist, atol=1e-9)
    assert solved


@pytest.mark.parametrize("speed", [0.1, 0.0, -0.1])
def test_a_pose_is_reached_near_enough_or_once_it_no_longer_lies_where_the_robot_drives(speed: float) -> None:
    """Within a radius, or within two where it was reached before or lies behind; a waypoint is never rested at."""
    policy = MpcPose(arrival_radius=0.05, turn_gain=3.0, yaw_acceleration=2.2, max_yaw_rate=2.0)
    base = ACTUATORS["slow"]  # at most 1.5 rad/s^2
    goals = np.array([[share * 0.05, 0.01] for share in (-2.2, -1.5, -0.5, 0.5, 1.5, 2.2)] * 4)
    b = len(goals)
    was, left = np.repeat([0.0, 1.0], b // 2), np.tile(np.repeat([0.0, 1.0], b // 4), 2)
    turns = np.linspace(-2.0, 2.0, b)
    briefing = Briefing(b, ROBOT, base, DT, "twist", Observation.layout(2, 0, 5.0), np.empty(0), 5.0)
    memory = policy.reset(briefing)
    memory["command"][:, 0], memory["arrived"], memory["commands"] = speed, was, 0.1
    seen = Observation(np.zeros((b, 3)), np.zeros((b, 2)), goals, turns, left, np.zeros((b, 0)))
    twists = policy.act(seen, briefing, memory)
    for k in range(b):
        r, behind = math.hypot(*goals[k]), goals[k, 0] * math.copysign(1.0, speed) <= 0.0
        there = left[k] == 0.0 and (r <= 0.05 or (r <= 0.1 and (was[k] == 1.0 or behind)))
        assert memory["arrived"][k] == there
        if there:
            e = abs(turns[k])
            rate = min(3.0 * e, math.sqrt(3.0 * e), 2.0)
            assert twists[k] == pytest.approx((0.0, math.copysign(rate, turns[k])))
            assert memory["command"][k] == pytest.approx(twists[k])
            assert not memory["commands"][k].any()
    assert 0 < memory["arrived"].sum() < b
