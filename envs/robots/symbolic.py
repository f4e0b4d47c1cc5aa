"""A robot's control period as CasADi functions: the kinematic plant itself, for those who write controllers with it."""

import math
from collections.abc import Mapping
from typing import Any

from gymnasium.error import DependencyNotInstalled

from wayfield.envs.robots import ACTUATORS, Actuators, AnyRobot, Robot, robot_of
from wayfield.envs.robots.records import lag_factors, motor_numbers
from wayfield.system.checks import choose, number
from wayfield.system.extras import installs

STATE = {
    **{"x": "m", "y": "m", "heading": "rad"},
    **{"wheel_vx": "m/s", "wheel_vy": "m/s", "wheel_yaw_rate": "rad/s"},
    **{"command_vx": "m/s", "command_vy": "m/s", "command_yaw_rate": "rad/s"},
}
TWIST = {"vx": "m/s", "vy": "m/s", "yaw_rate": "rad/s"}


class Symbolic:
    """One control period of a robot, x' = step(x, u), equal to the kinematic plant where nothing is touched.

    The state x (9,) holds what the environments' records do under the same names: the pose, the twist that the wheels
    turn for and the last command. The input u is an action: the twist components that the robot commands, or the
    speeds of its wheels, of any size below 1e9. The heading is not wrapped. Wheels saturate by one factor,
    accelerations and the least turning radius limit the command, the wheels follow it with a first-order lag, and the
    pose moves along an exact arc: `kinematics.limits`, `kinematic_plant.drive`.

    Args:
        robot: the name of one that ships, a data sheet (.json), or a `Robot`.
        actuators: the tier, "ideal", "lagged" or "slow", or what a briefing has of it.
        dt: control period, s.

    Attributes:
        step: casadi.Function, (x, u) to x'.
        linear: casadi.Function, (x, u) to A (9, 9) and B (9, t), the derivatives of `step`; where a limit is just
            reached, on one of its sides.
        smooth: `step` without any limit, which has all derivatives: for solvers that are handed the limits as
            constraints.
        names: of the components of "x" and of "u".
        units: likewise.

    Raises:
        DependencyNotInstalled: without CasADi.
        ValueError: naming the field, if an argument is wrong, or the sheet has a response beyond accelerations and lag.
    """

    def __init__(self, robot: AnyRobot, actuators: str | Actuators = "ideal", dt: float = 0.05) -> None:
        sheet = robot_of(robot)
        number("dt", dt, above=0.0)
        if not isinstance(actuators, Actuators):
            choose("actuators", actuators, ACTUATORS)
            actuators = sheet.actuators(actuators)
        decay, mean = lag_factors(actuators.lag, dt)
        constants = {"twist_action": True, "distorted": False, "lag_decay": decay, "lag_mean": mean}
        self._lay_out(sheet, motor_numbers(sheet, actuators, dt) | constants)

    @classmethod
    def of(cls, env: Any, *, true: bool = False) -> "Symbolic":
        """Returns the model of an environment's robot, from the record that its plant reads.

        Args:
            env: a single or a vector environment, wrapped or not.
            true: whether the wheels and the slip of a disturbed base are in it, which no policy has access to.

        Raises:
            DependencyNotInstalled: without CasADi.
            TypeError: if it is no environment of this package.
            ValueError: naming the argument, if no such function is its plant.
        """
        task = getattr(getattr(env, "unwrapped", env), "task", None)
        options = getattr(task, "options", None)
        if task is None or options is None:
            raise TypeError(f"env must be an environment of wayfield, got {type(env).__name__}")
        if options.dynamics != "kinematic":
            raise ValueError(
                f'dynamics="{options.dynamics}" is no function of one period; the nearest is wayfield.symbolic(robot, '
                "actuators), the kinematic plant"
            )
        if true and options.disturbance.action_delay:
            raise ValueError(
                f"true=True is no function of one period here: the disturbance delays actions by "
                f"{options.disturbance.action_delay} of them"
            )
        if true and options.disturbance.drift:
            raise ValueError("true=True is no function of one period here: the disturbance drifts by the clock")
        p = {name: task.params[name][0] for name in task.params.dtype.names}
        model = cls.__new__(cls)
        model._lay_out(task.robot, p | {"distorted": bool(true and p["distorted"])})
        return model

    def _lay_out(self, robot: Robot, p: Mapping[str, Any]) -> None:
        """Makes the functions from the values of `records.ROBOT_PARAMS`."""
        if p["responds"]:
            unmodelled = {"saturation": robot.saturation != "twist", "response": robot.response != "stepped"}
            unmodelled |= {"lag": isinstance(robot.lag, tuple)}
            unmodelled |= {name: bool(getattr(robot, name)) for name in ("delay", "gain", "decelerations")}
            fields = ", ".join(sorted(name for name, there in unmodelled.items() if there))
            raise ValueError(
                f"robot {robot.name!r} has {fields} in its data sheet, which no symbolic model has yet; "
                'actuators="ideal" is without'
            )
        try:
            import casadi
        except ImportError:
            raise DependencyNotInstalled(f"wayfield.symbolic needs casadi: {installs('exact')}") from None
        twist = [list(TWIST)[axis] for axis in robot.twist_axes]
        wheels = [f"wheel_{k}" for k in range(p["num_wheels"])]
        inputs = {name: TWIST[name] for name in twist} if p["twist_action"] else dict.fromkeys(wheels, "rad/s")
        self.names = {"x": tuple(STATE), "u": tuple(inputs)}
        self.units = {"x": tuple(STATE.values()), "u": tuple(inputs.values())}
        x, u = casadi.SX.sym("x", len(STATE)), casadi.SX.sym("u", len(inputs))
        if p["twist_action"]:
            request = casadi.SX(3, 1)
            for k, axis in enumerate(robot.twist_axes):
                request[axis] = u[k]
        else:
            request = casadi.DM(p["forward_matrix"][:, : len(wheels)]) @ u
        after = _moved(casadi, p, x, _limited(casadi, p, request, x[6:9]))
        self.step = casadi.Function("step", [x, u], [after], ["x", "u"], ["x_next"])
        derivatives = [casadi.jacobian(after, x), casadi.jacobian(after, u)]
        self.linear = casadi.Function("linear", [x, u], derivatives, ["x", "u"], ["A", "B"])
        self.smooth = casadi.Function("smooth", [x, u], [_moved(casadi, p, x, request)], ["x", "u"], ["x_next"])


def _limited(casadi: Any, p: Mapping[str, Any], twist: Any, last: Any) -> Any:
    """Returns what `kinematics.limits` makes of a requested twist (3,) after the last command (3,)."""
    # roots and quotients stay away from zero in the branch that is not taken, or derivatives would be NaN there
    rates = casadi.DM(p["wheel_matrix"][: p["num_wheels"]]) @ twist
    factor = p["wheel_speed_limit"] / casadi.fmax(casadi.mmax(casadi.fabs(rates)), p["wheel_speed_limit"])
    if math.isfinite(p["turn_speed"]):
        factor = casadi.fmin(factor, p["turn_speed"] / casadi.fmax(casadi.fabs(twist[2]), p["turn_speed"]))
    change = factor * twist - last
    if math.isfinite(p["acceleration"]):
        most = p["acceleration"] * p["dt"]
        change[:2] *= most / casadi.sqrt(casadi.fmax(casadi.sumsqr(change[:2]), most * most))
    if math.isfinite(p["yaw_acceleration"]):
        most = p["yaw_acceleration"] * p["dt"]
        change[2] = casadi.fmin(casadi.fmax(change[2], -most), most)
    command = last + change
    if p["turning_radius"] > 0.0:
        most = casadi.fabs(command[0]) / p["turning_radius"]
        command[2] = casadi.fmin(casadi.fmax(command[2], -most), most)
    return command


def _moved(casadi: Any, p: Mapping[str, Any], x: Any, command: Any) -> Any:
    """Returns the state (9,) after a period under a command (3,): `kinematic_plant.drive`."""
    wheels = command + p["lag_decay"] * (x[3:6] - command)
    body = command + p["lag_mean"] * (x[3:6] - command)
    if p["distorted"]:
        body = casadi.DM(p["distortion"]) @ body
        drift = p["side_slip"] * body[2]
        body = casadi.vertcat(body[0] + drift * body[1], body[1] - drift * body[0], body[2])
    half_turn = 0.5 * p["dt"] * body[2]
    sine, cosine = casadi.sin(x[2] + half_turn), casadi.cos(x[2] + half_turn)
    chord = p["dt"] * _sinc(casadi, half_turn)
    pose = casadi.vertcat(
        x[0] + chord * (cosine * body[0] - sine * body[1]),
        x[1] + chord * (sine * body[0] + cosine * body[1]),
        x[2] + 2.0 * half_turn,
    )
    return casadi.vertcat(pose, wheels, command)


def _sinc(casadi: Any, angle: Any) -> Any:
    """Returns sin(angle) / angle, near zero by the series of `kinematics.sinc`."""
    z = angle * angle
    series = 1.0
    for k in range(6, -1, -1):
        series = 1.0 - series * z / ((2 * k + 2) * (2 * k + 3))
    near = z < 0.25
    return casadi.if_else(near, series, casadi.sin(angle) / casadi.if_else(near, 1.0, angle))
