"""The record that every robot of a batch is kept in, and the record of constants that its step reads.

One NumPy record a robot rather than many arrays: a compiled call pays for each argument, and a robot's numbers lie side
by side in memory. Tasks add their own fields behind these.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import MOST_ENCODERS, MOST_WHEELS, Actuators, Response, Robot, kinematics, wheel_matrix
from wayfield.envs.robots.disturbances import SHOVE_FROM, SHOVE_UNTIL
from wayfield.system.compiled import compiled, inlined
from wayfield.system.linear import pseudo_inverse, solve

Records = NDArray[np.void]
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MAX_WHEELS = MOST_WHEELS

ROBOT_STATE = [
    ("x", np.float64),  # true pose, m
    ("y", np.float64),
    ("heading", np.float64),  # rad, (-pi, pi]
    ("vx", np.float64),  # true body twist at the end of the step, m/s
    ("vy", np.float64),
    ("yaw_rate", np.float64),  # rad/s
    ("command_vx", np.float64),  # twist commanded to the wheels, after saturation and acceleration limits
    ("command_vy", np.float64),
    ("command_yaw_rate", np.float64),
    ("wheel_vx", np.float64),  # twist that the wheels turn for, after the lag; the body's own unless they slip
    ("wheel_vy", np.float64),
    ("wheel_yaw_rate", np.float64),
    ("odometry_x", np.float64),  # pose integrated from encoders since the start of the episode
    ("odometry_y", np.float64),
    ("odometry_heading", np.float64),
    ("measured_x", np.float64),  # pose and twist that the robot believes
    ("measured_y", np.float64),
    ("measured_heading", np.float64),
    ("measured_vx", np.float64),
    ("measured_vy", np.float64),
    ("measured_yaw_rate", np.float64),
    ("num_obstacles", np.int64),  # around it
    ("field", np.int64),  # the row that they stand in
    ("num_blocks", np.int64),  # that those of the row are put into, behind which blocks.in_blocks has discs around them
    ("clearance", np.float64),  # m, from the hull to the nearest obstacle; inf without obstacles
    ("contact", np.int64),  # 1 when the hull touched something in this step
    ("saturated", np.int64),  # 1 when the wheels could not turn as fast as the action commands
    ("steps", np.int64),  # since the reset
    ("scenario", np.int64),  # index in the bank of scenarios
    ("noise_row", np.int64),  # next unused row of the robot's block of noise
    ("shove_step", np.int64),  # step of the drawn shove; -1: never
    ("shove_direction", np.float64),  # rad, world frame
]

ROBOT_PARAMS = [
    ("dt", np.float64),  # control period, s
    ("num_wheels", np.int64),
    ("twist_action", np.int64),  # 1: actions are twists; 0: wheel speeds
    ("holonomic", np.int64),
    ("wheel_matrix", np.float64, (MAX_WHEELS, 3)),  # twist to wheel speeds, rad/s
    ("forward_matrix", np.float64, (3, MAX_WHEELS)),  # wheel speeds to twist
    ("wheel_speed_limit", np.float64),  # rad/s
    ("turn_speed", np.float64),  # rad/s, the driver's limit of the yaw rate; inf: it has none
    ("turning_radius", np.float64),  # m, the least; 0: it turns on the spot
    ("acceleration", np.float64),  # m/s^2
    ("yaw_acceleration", np.float64),  # rad/s^2
    ("lag_decay", np.float64),  # share of a deviation left after dt
    ("lag_mean", np.float64),  # mean share of a deviation over dt
    ("responds", np.int64),  # 1: as `response` says, with the fields behind; 0: at once
    ("continuous", np.int64),  # 1: within the control period too
    ("wheel_saturation", np.int64),  # 1: each wheel is clipped; 0: the twist is scaled as a whole
    ("requests", np.int64),  # column of the actions from which on the requested twists lie, the newest first
    ("delay_periods", np.int64, (3,)),  # of v_x, v_y, yaw rate: whole control periods
    ("delay_rest", np.float64, (3,)),  # s, and the rest
    ("gains", np.float64, (3,)),
    ("lags", np.float64, (3,)),  # s
    ("deceleration", np.float64),  # m/s^2
    ("yaw_deceleration", np.float64),  # rad/s^2
    ("hull_radius", np.float64),  # m; of a rectangle, the disc around it about the pose
    ("hull_length", np.float64),  # m, of a rectangle; 0: the hull is a disc
    ("hull_width", np.float64),  # m
    ("hull_x", np.float64),  # m, of its middle, ahead of the pose
    ("perfect_pose", np.int64),  # 1: the measured pose and twist are the true ones
    ("pose_from_odometry", np.int64),
    ("passive_encoders", np.int64),  # 1: encoders follow the body, 0: the drive wheels
    ("num_encoders", np.int64),
    ("encoder_matrix", np.float64, (MAX_WHEELS, 3)),  # twist to encoder rates, rad/s
    ("odometry_matrix", np.float64, (3, MAX_WHEELS)),  # encoder rates to twist
    ("position_noise", np.float64),  # standard deviation, m
    ("heading_noise", np.float64),  # rad
    ("encoder_noise", np.float64),  # relative
    ("range_noise", np.float64),  # m
    ("max_range", np.float64),  # m
    ("moving", np.int64),  # 1: some obstacle of the bank moves by a script
    ("dropout_below", np.float64),  # standard normal number below which a beam reads max_range; -inf: none
    ("distorted", np.int64),  # 1: the body moves otherwise than the wheels turn for
    ("distortion", np.float64, (3, 3)),  # from the wheels' twist to the body's
    ("side_slip", np.float64),  # s
    ("drawn_shove", np.float64),  # m, displacement from a drawn time on in a drawn direction; 0: none
    ("shove_periods", np.int64),  # for which it comes again
    ("shove_swing", np.float64),  # rad, of a sine that it is multiplied by, a period; 0: by none
    ("shove_step", np.int64),  # step in which the pose is displaced; -1: never
    ("shove_x", np.float64),  # m, world frame
    ("shove_y", np.float64),
    ("shove_heading", np.float64),  # rad
]


def lag_factors(lag: float, dt: float) -> tuple[float, float]:
    """Returns (share of a deviation left after dt, mean share over dt) of a first-order lag, exactly."""
    if lag == 0.0:
        return 0.0, 0.0
    decay = math.exp(-dt / lag)
    return decay, (1.0 - decay) * lag / dt


def delay_periods(response: Response | None, dt: float) -> list[tuple[int, float]]:
    """Returns the delay of each axis in whole control periods and the rest, s; in steps, to the nearest period."""
    periods_and_rests = []
    for delay in response.delays if response else (0.0, 0.0, 0.0):
        nearest = round(delay / dt)
        stepped = response is None or not response.continuous
        if stepped or abs(delay - nearest * dt) < 1e-9:
            periods_and_rests.append((nearest, 0.0))
        else:
            periods = math.floor(delay / dt)
            periods_and_rests.append((periods, delay - periods * dt))
    return periods_and_rests


def num_requests(response: Response | None, dt: float) -> int:
    """Returns how many numbers of requested twists a response reads: three a period, up to the longest delay."""
    if response is None:
        return 0
    return 3 * max(periods + (2 if rest else 1) for periods, rest in delay_periods(response, dt))


def motor_numbers(robot: Robot, actuators: Actuators, dt: float) -> dict[str, Any]:
    """Returns the values of the fields that `kinematic_plant` and `response` read of wheels and motors, but `requests`.

    dt: s, the control period.
    """
    response = actuators.response
    delays = delay_periods(response, dt)
    return {
        "dt": dt,
        "num_wheels": len(robot.wheel_matrix),
        "wheel_matrix": padded(robot.wheel_matrix, (MAX_WHEELS, 3)),
        "forward_matrix": padded(robot.forward_matrix, (3, MAX_WHEELS)),
        "wheel_speed_limit": robot.rated_wheel_speed if actuators.at_rated_speed else robot.peak_wheel_speed,
        "turn_speed": robot.turn_speed,
        "turning_radius": robot.turning_radius,
        "acceleration": actuators.acceleration,
        "yaw_acceleration": actuators.yaw_acceleration,
        "responds": response is not None,
        "continuous": response is not None and response.continuous,
        "wheel_saturation": response is not None and response.wheel_saturation,
        "delay_periods": [periods for periods, _ in delays],
        "delay_rest": [rest for _, rest in delays],
        "gains": response.gains if response else (1.0, 1.0, 1.0),
        "lags": response.lags if response else (actuators.lag,) * 3,
        "deceleration": response.deceleration if response else actuators.acceleration,
        "yaw_deceleration": response.yaw_deceleration if response else actuators.yaw_acceleration,
    }


def padded(matrix: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Returns a matrix with zeros behind its rows and columns."""
    whole = np.zeros(shape)
    whole[: matrix.shape[0], : matrix.shape[1]] = matrix
    return whole


def odometry_matrices(robot: Robot, source: str) -> tuple[NDArray[np.float64], NDArray[np.float64], bool]:
    """Returns (twist to encoder rates, encoder rates to twist, whether the encoders sit on passive wheels).

    Args:
        source: "odometry" for the right maps; "odometry_uncorrected" for document B's two passive encoders without the
            rotation term l th'; "odometry_plain_sum" for the forward map that documents B and C print, of omni wheels.

    Raises:
        ValueError: if the robot has no such odometry.
    """
    if source == "odometry_plain_sum":
        # a wheel that drives through the centre has no arm to divide by
        many = len(robot.wheels) > MOST_ENCODERS
        if robot.drive != "omni" or many or not robot.wheel_matrix[:, 2].all():
            raise ValueError(
                f"pose_source={source!r} belongs to documents B and C; robot {robot.name!r} has no such map"
            )
        return robot.wheel_matrix, kinematics.plain_sum_matrix(robot.wheel_matrix, robot.wheel_radii), False
    if not robot.encoders:
        if source == "odometry_uncorrected":
            raise ValueError(f"pose_source={source!r} needs passive encoder wheels; robot {robot.name!r} has none")
        if len(robot.wheels) > MOST_ENCODERS:
            read = robot.wheel_matrix[:MOST_ENCODERS]
            return read, pseudo_inverse(read), False
        return robot.wheel_matrix, robot.forward_matrix, False
    # two wheels and the IMU's yaw rate as the third reading
    readings = np.vstack([wheel_matrix(robot.encoders), [0.0, 0.0, 1.0]])
    believed = readings.copy()
    if source == "odometry_uncorrected":
        believed[:2, 2] = 0.0
    return readings, solve(believed, np.eye(3)), True


POSE_SOURCES = ("ground_truth", "odometry", "odometry_uncorrected", "odometry_plain_sum")

# Standard deviations at noise = 1: a good indoor localiser, quadrature encoders with tyre wear, a cheap lidar.
POSITION_NOISE = 0.01  # m
HEADING_NOISE = 0.01  # rad
ENCODER_NOISE = 0.02  # relative
RANGE_NOISE = 0.01  # m


_aligned: dict[np.dtype[Any], np.dtype[Any]] = {}


def aligned(fields: Any) -> np.dtype[Any]:
    """Returns the aligned dtype of some fields, for the same fields the same object.

    A compiled call knows the records that it has met by the identity of their dtype; one of another object it compares
    field by field, which takes longer than most laws.
    """
    dtype = np.dtype(fields, align=True)
    return _aligned.setdefault(dtype, dtype)


def record(fields: Any, values: Mapping[str, Any]) -> NDArray[np.void]:
    """Returns an array of one record with the given dtype fields; missing and surplus values are errors."""
    dtype = aligned(fields)
    if set(dtype.names or ()) != set(values):
        raise TypeError(f"record fields and values differ: {set(dtype.names or ()) ^ set(values)}")
    array = np.zeros(1, dtype)
    for name, value in values.items():
        array[name] = value
    return array


def part_of(records: NDArray[np.void], fields: Any) -> NDArray[np.void]:
    """Returns some fields of records, in the same place in memory, as records of those alone.

    What reads no others so is compiled once for the records of all tasks.

    Raises:
        TypeError: if the fields do not lie there, side by side as they would by themselves.
    """
    kind = aligned(fields)
    there: Mapping[str, Any] = records.dtype.fields or {}
    places = {name: (dtype, offset) for name, (dtype, offset, *_) in (kind.fields or {}).items()}
    first = there[fields[0][0]][1] if fields[0][0] in there else 0
    for name, (dtype, offset) in places.items():
        if name not in there or there[name][:2] != (dtype, first + offset):
            raise TypeError(f"records have no {name} where it belongs: {records.dtype}")
    # Numba takes records for the bases of those that begin with their fields, and warns of it: these have one more
    names, more = ["_part", *places], [(np.dtype(np.uint8), 0), *places.values()]
    formats, offsets = zip(*more, strict=True)
    part = aligned({"names": names, "formats": formats, "offsets": offsets, "itemsize": kind.itemsize})
    return np.ndarray(records.shape, part, records, first, records.strides)


@inlined
def stop(s):
    """Puts a robot at rest; what its wheels were told stays."""
    s.vx = 0.0
    s.vy = 0.0
    s.yaw_rate = 0.0


@compiled
def halt(s):
    """Puts a robot at rest at its pose, with its clocks at zero and its odometry right."""
    stop(s)
    s.command_vx = 0.0
    s.command_vy = 0.0
    s.command_yaw_rate = 0.0
    s.wheel_vx = 0.0
    s.wheel_vy = 0.0
    s.wheel_yaw_rate = 0.0
    s.odometry_x = s.x
    s.odometry_y = s.y
    s.odometry_heading = s.heading
    s.contact = 0
    s.saturated = 0
    s.steps = 0


@inlined
def draw_shove(p, s, draws, j):
    """Sets the shove of an episode: its time and its direction from the last two uniform numbers of row j."""
    s.shove_step = -1
    if p.drawn_shove > 0.0:
        last = draws.shape[1] - 1
        s.shove_step = int((SHOVE_FROM + (SHOVE_UNTIL - SHOVE_FROM) * draws[j, last - 1]) / p.dt)
        s.shove_direction = 2.0 * math.pi * draws[j, last]
