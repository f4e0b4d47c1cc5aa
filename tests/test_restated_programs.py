"""The steps of predictive control to a pose, stated once more: its sum, first plans, program, and twist."""

import math
from typing import Any

import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.briefing import Briefing
from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.policies import mpc_pose
from wayfield.policies.mpc_pose import MpcPose

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


def slopes(function: Any, at: Any) -> Any:
    """Returns the derivatives of a function by central differences."""
    h, columns = 1e-5, []
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = h
        above, below = (function((at.ravel() + sign * step).reshape(at.shape)) for sign in (1.0, -1.0))
        columns.append((above - below) / (2.0 * h))
    return np.array(columns).T


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
def test_predictive_control_to_a_pose_is_its_docstring(
    actuators: str, policy: MpcPose, monkeypatch: pytest.MonkeyPatch
) -> None:
    b, n, rng, base = 12, policy.horizon, np.random.default_rng(13), ACTUATORS[actuators]
    briefing = Briefing(b, ROBOT, base, DT, "twist", Observation.layout(2, 0, 5.0), np.empty(0), 5.0)
    seen: list[dict[str, Any]] = [{} for _ in range(b)]
    steps = {name: getattr(mpc_pose, name) for name in ("choose", "linearise", "improve")}

    def choose(p: Any, told: Any, command: Any, commands: Any, i: int) -> float:
        seen[i]["last"], seen[i]["old"] = command[i].copy(), commands[i].copy()
        seen[i]["cost"] = steps["choose"](p, told, command, commands, i)
        seen[i]["plan"] = commands[i].copy()
        return float(seen[i]["cost"])

    def linearise(p: Any, told: Any, command: Any, commands: Any, i: int, program: Any) -> float:
        slope = steps["linearise"](p, told, command, commands, i, program)
        seen[i]["program"] = [each.copy() for each in program]
        seen[i]["slope"] = slope
        return float(slope)

    def improve(p: Any, told: Any, command: Any, commands: Any, i: int, cost: float, change: Any) -> None:
        steps["improve"](p, told, command, commands, i, cost, change)
        seen[i]["change"] = change.copy()

    for step in (choose, linearise, improve):
        monkeypatch.setattr(mpc_pose, step.__name__, step)
    memory = policy.reset(briefing)
    memory["command"] = rng.uniform(-0.3, 0.3, (b, 2))
    memory["commands"] = memory["command"][:, :, None] + np.cumsum(
        rng.normal(0.0, 0.01, memory["commands"].shape), axis=2
    )
    goals, turns = rng.uniform(-1.2, 1.2, (b, 2)), rng.uniform(-2.5, 2.5, b)
    left, twists = (rng.random(b) < 0.2).astype(float), memory["command"] + rng.normal(0.0, 0.03, (b, 2))
    got = policy.act(Observation(np.zeros((b, 3)), twists, goals, turns, left, np.zeros((b, 0))), briefing, memory)
    for i, s in enumerate(seen):
        turn = turns[i] if left[i] == 0.0 else math.atan2(goals[i, 1], goals[i, 0])
        place = -complex(*goals[i]) * np.exp(-1j * turn)
        start = (place.real, place.imag, -turn), twists[i]

        def cost(plan: Any, start: Any = start, s: Any = s) -> float:
            return float((residuals(policy, start, s["last"], plan, base.lag) ** 2).sum())

        # the last plan, moved on by a control period, and the polar law forward and backward
        substeps = max(round(policy.step / DT), 1)
        moved = s["old"].copy()
        moved[:, :-1] += (s["old"][:, 1:] - s["old"][:, :-1]) / substeps
        plans = [moved, *(polar(policy, start, s["last"], way, n, base) for way in (1.0, -1.0))]
        costs = [cost(plan) for plan in plans]
        assert s["cost"] == pytest.approx(min(costs), rel=1e-9)
        np.testing.assert_allclose(s["plan"], plans[int(np.argmin(costs))], atol=1e-9)
        # the program: the sum's gradient, Gauss and Newton's Hessian, a fiftieth of its largest entry to all
        hessian, gradient, lower, upper = s["program"]
        jacobian = slopes(lambda plan, start=start, s=s: residuals(policy, start, s["last"], plan, base.lag), s["plan"])
        wanted = 2.0 * jacobian.T @ jacobian
        scale = np.abs(wanted).max()
        of_sum = 2.0 * jacobian.T @ residuals(policy, start, s["last"], s["plan"], base.lag)
        np.testing.assert_allclose(gradient, of_sum, atol=1e-6 * np.abs(of_sum).max())
        assert s["slope"] == pytest.approx(np.abs(of_sum).max(), rel=1e-5)
        wanted[np.diag_indices(2 * n)] += 0.02 * np.diag(wanted).max()
        np.testing.assert_allclose(np.triu(hessian), np.triu(wanted), atol=1e-6 * scale)
        # its bounds: what the plan leaves of speeds, accelerations and wheels; a plan beyond one need not come back
        v, w = s["plan"]
        held = substeps * DT  # of a step, in whole control periods
        change = [np.diff(np.append(s["last"][j], s["plan"][j])) for j in range(2)]
        rows = [(v, policy.speed), (w, policy.max_yaw_rate)]
        rows += [(change[0], held * base.acceleration), (change[1], held * base.yaw_acceleration)]
        wheels = ROBOT.wheel_matrix
        limit = ROBOT.rated_wheel_speed if base.at_rated_speed else ROBOT.peak_wheel_speed
        unit = np.abs(wheels[:, 0]).max()
        rows += [((row[0] * v + row[2] * w) / unit, limit / unit) for row in wheels]
        for k, (value, most) in enumerate(rows):
            there = slice(k * n, (k + 1) * n)
            np.testing.assert_allclose(lower[there], np.minimum(-most - value, 0.0), atol=1e-9)
            np.testing.assert_allclose(upper[there], np.maximum(most - value, 0.0), atol=1e-9)
        # the largest share of the change that is cheaper, and the plan's start within reach
        new = s["plan"]
        assert memory["qp_failures"][i] == ("change" not in s)
        for share in (1.0, 0.5, 0.25) if "change" in s else ():
            tried = s["plan"] + share * s["change"].reshape(2, n)
            if cost(tried) < s["cost"]:
                new = tried
                break
        np.testing.assert_allclose(memory["commands"][i], new, atol=1e-9)
        asked = s["last"] + (new[:, 0] - s["last"]) / substeps
        rim = np.abs(wheels @ [asked[0], 0.0, asked[1]]).max()
        asked = asked * min(1.0, limit / rim, ROBOT.turn_speed / max(abs(asked[1]), 1e-12))
        most = np.array([base.acceleration, base.yaw_acceleration]) * DT
        twist = s["last"] + np.clip(asked - s["last"], -most, most)
        np.testing.assert_allclose(got[i], twist, atol=1e-9)
        np.testing.assert_allclose(memory["command"][i], twist, atol=1e-9)
    assert memory["qp_failures"].sum() < b  # most programs are solved in time


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
