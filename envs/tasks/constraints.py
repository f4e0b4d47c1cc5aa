"""What a base and a task allow, as data: inequalities for who writes controllers, and their values in an episode."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

NAMES = ("constraint_values", "constraint_violation")  # in the info of environments with constraints=True
TOUCH = 1e-5  # m, below which a hull counts as touching: the plant stops a hull within a nanometre of what it meets
# Of a bound, by which a value has to be above zero to count as a violation: actions of single precision round to this.
ROUNDING = 1e-6


class Constraint(NamedTuple):
    """An inequality that is kept where every row of its function is at most zero.

    Constraints of the request are kept by the plant whatever is requested: it saturates. To request more is no failure,
    but what is driven then is not what was requested.
    """

    name: str
    kind: str  # "linear" or "quadratic" in the request and the last command, or "state"
    variables: tuple[str, ...]  # what the function takes: "u", "command", or fields of the task's states
    unit: str
    bound: float | NDArray[np.float64]  # of its rows the largest; an array: one a scenario
    # rows, each <= 0: sums and products of components alone, so that NumPy's arrays and CasADi's symbols will both do
    function: Callable[..., list[Any]]


def of_request(p: NDArray[np.void], most: NDArray[np.float64], axes: tuple[int, ...]) -> tuple[Constraint, ...]:
    """Returns the constraints of what is requested of a base.

    u is an action; command (3,) is the last one (v_x, v_y, yaw rate) that the plant set.

    Args:
        p: the plant's record, of `records.ROBOT_PARAMS`.
        most: the largest twist, a component of those that the robot commands.
        axes: which of (v_x, v_y, yaw_rate) these are.
    """
    count = int(p["num_wheels"])
    wheels = p["wheel_matrix"][:count]
    # from an action to (v_x, v_y, yaw rate)
    twist = np.eye(3)[:, axes] if p["twist_action"] else p["forward_matrix"][:, :count]

    def linear(name: str, unit: str, rows: NDArray[np.float64], bounds: Sequence[float]) -> Constraint:
        """Returns rows u within their bounds, either way; exact sums, whatever stands beside them."""

        def function(u: Any) -> list[Any]:
            sums = [_sum(row, u) for row in rows.tolist()]
            return [side for each, bound in zip(sums, bounds, strict=True) for side in (each - bound, -each - bound)]

        return Constraint(name, "linear", ("u",), unit, float(max(bounds)), function)

    speeds, limit = [axis for axis in axes if axis < 2], float(p["wheel_speed_limit"])
    constraints = [
        linear("speed", "m/s", twist[speeds], most[:-1].tolist()),
        linear("turn_speed", "rad/s", twist[2:], [float(most[-1])]),
        linear("wheel_speed", "rad/s", wheels @ twist, [limit] * count),
    ]
    if not p["responds"]:
        constraints += _of_change(p, twist, speeds)
    return tuple(constraints)


def _of_change(p: NDArray[np.void], twist: NDArray[np.float64], speeds: list[int]) -> list[Constraint]:
    """Returns the constraints of a request beside the last command, of a base whose accelerations have bounds."""
    dt, most, turn = (float(p[name]) for name in ("dt", "acceleration", "yaw_acceleration"))
    rows = twist.tolist()

    def acceleration(u: Any, command: Any) -> list[Any]:
        changes = [(_sum(rows[axis], u) - command[axis]) / dt for axis in speeds]
        if len(changes) == 1:
            return [changes[0] - most, -changes[0] - most]
        return [sum(each * each for each in changes) - most * most]

    def yaw_acceleration(u: Any, command: Any) -> list[Any]:
        change = (_sum(rows[2], u) - command[2]) / dt
        return [change - turn, -change - turn]

    constraints, both = [], ("u", "command")
    if math.isfinite(most):
        straight = len(speeds) == 1
        kind, unit, bound = ("linear", "m/s^2", most) if straight else ("quadratic", "m^2/s^4", most * most)
        constraints.append(Constraint("acceleration", kind, both, unit, bound, acceleration))
    if math.isfinite(turn):
        constraints.append(Constraint("yaw_acceleration", "linear", both, "rad/s^2", turn, yaw_acceleration))
    return constraints


def at_least(name: str, field: str) -> Constraint:
    """Returns the constraint that a distance (m) of the states stays above TOUCH."""
    return Constraint(name, "state", (field,), "m", TOUCH, lambda distance: [TOUCH - distance])


def _sum(factors: Sequence[float], values: Any) -> Any:
    """Returns the sum of products, in this order: of a batch and of a robot alone the same bits."""
    return sum(factor * values[k] for k, factor in enumerate(factors))


def evaluate(
    constraints: Sequence[Constraint], requests: NDArray[np.float64], command: NDArray[np.float64], states: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Returns the value (b, k) of each constraint, the largest of its rows, and whether any is violated (b,).

    A value is at most 0 where the constraint is kept, and above 0 where it is not.

    Args:
        requests: (b, a) the requests of a period.
        command: (b, 3) the commands before it.
        states: (b,) after it.
    """
    values = np.empty((len(states), len(constraints)))
    bounds = np.ones(values.shape)
    for k, each in enumerate(constraints):
        own = {"u": requests.T, "command": command.T}
        rows = each.function(*(own[name] if name in own else states[name] for name in each.variables))
        values[:, k] = np.max(np.broadcast_arrays(*rows), axis=0)
        bounds[:, k] = each.bound if np.ndim(each.bound) == 0 else np.asarray(each.bound)[states["scenario"]]
    return values, np.asarray((values > ROUNDING * np.maximum(bounds, TOUCH)).any(axis=1))
