"""What a compiled law reads, as one record: the gains of its policy and the data sheet of its robot.

One record, because a compiled call pays for each argument, and because names cannot be mixed up as positions can.
"""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.robots.records import MAX_WHEELS, lag_factors, record
from wayfield.envs.tasks.briefing import Briefing

# What the plant is predicted with, all of it nominal.
PLANT = np.dtype(
    [
        ("dt", np.float64),  # control period, s
        ("holonomic", np.int64),
        ("hull_radius", np.float64),  # m
        ("num_wheels", np.int64),
        ("wheel_matrix", np.float64, (MAX_WHEELS, 3)),  # twist to wheel speeds, rad/s
        ("wheel_speed_limit", np.float64),  # rad/s
        ("turn_speed", np.float64),  # rad/s, the driver's limit of the yaw rate
        ("turning_radius", np.float64),  # m, the least; 0: it turns on the spot
        ("acceleration", np.float64),  # m/s^2
        ("yaw_acceleration", np.float64),  # rad/s^2
        ("lag", np.float64),  # s, with the delay: `Actuators.reaction`
        ("lag_decay", np.float64),  # share of a deviation that the lag leaves after a control period
        ("lag_mean", np.float64),  # its mean share over the period
    ],
    align=True,
)


def params(policy: Any, briefing: Briefing, **more: float) -> NDArray[np.void]:
    """Returns what the law of a policy, a frozen dataclass, reads: an array of one record, not to be written to.

    Its fields are the gains that are numbers, with their names and types (whole numbers and switches as int64), the
    names of `more`, which may also take the place of gains, and `plant`, a PLANT record.
    """
    return params_of(policy, briefing.robot, briefing.actuators, briefing.dt, **more)


# By the identities of what a record is made of, which all is frozen and is kept with it: to hash it took microseconds.
_made: dict[tuple[Any, ...], tuple[NDArray[np.void], Any, Any]] = {}
_MOST_MADE = 256


def params_of(policy: Any, robot: Robot, actuators: Actuators, dt: float, /, **more: float) -> NDArray[np.void]:
    """Returns what `params` does, for actuators that need not be those of the briefing."""
    key = (id(policy), id(robot), actuators, dt, *more.values(), *more)
    result = _made.get(key)
    if result is None:
        if len(_made) >= _MOST_MADE:
            _made.clear()
        result = _made[key] = _record(policy, robot, actuators, dt, more), policy, robot
    made: NDArray[np.void] = result[0]
    return made


def _record(policy: Any, robot: Robot, actuators: Actuators, dt: float, more: dict[str, float]) -> NDArray[np.void]:
    whole = {field.name: field.type in (int, bool) for field in dataclasses.fields(policy) if _is_number(field)}
    values: dict[str, Any] = {name: getattr(policy, name) for name in whole} | more
    whole |= {name: isinstance(value, int | np.integer) for name, value in more.items() if name not in whole}
    kinds = [(name, np.int64 if whole[name] else np.float64) for name in values]
    made = record([*kinds, ("plant", PLANT)], {**values, "plant": plant(robot, actuators, dt)[0]})
    made.setflags(write=False)
    return made


def _is_number(field: dataclasses.Field[Any]) -> bool:
    return field.type in (int, bool, float)


def plant(robot: Robot, actuators: Actuators, dt: float) -> NDArray[np.void]:
    """Returns the data sheet, an array of one PLANT record."""
    decay, mean = lag_factors(actuators.reaction, dt)
    made = np.zeros(1, PLANT)
    made["dt"] = dt
    made["holonomic"] = robot.holonomic
    made["hull_radius"] = robot.hull_radius
    made["num_wheels"] = len(robot.wheel_matrix)
    made["wheel_matrix"][0, : len(robot.wheel_matrix)] = robot.wheel_matrix
    made["wheel_speed_limit"] = robot.rated_wheel_speed if actuators.at_rated_speed else robot.peak_wheel_speed
    made["turn_speed"] = robot.turn_speed
    made["turning_radius"] = robot.turning_radius
    made["acceleration"], made["yaw_acceleration"] = actuators.surely
    made["lag"] = actuators.reaction
    made["lag_decay"] = decay
    made["lag_mean"] = mean
    return made
