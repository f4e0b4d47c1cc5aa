"""Robots: what one is made of, the data sheets that describe them, those that ship, and the named actuator tiers."""

import dataclasses
import functools
import hashlib
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import kinematics
from wayfield.envs.robots.doubts import tell
from wayfield.envs.robots.intervals import IDENTIFIED, Interval
from wayfield.system.checks import HEAVIEST, LIGHTEST, choose, printable, real, shown, whole
from wayfield.system.linear import pseudo_inverse
from wayfield.system.objects import check_keys, fault, json_object
from wayfield.system.readers import reader

DRIVES = ("differential", "omni", "mecanum")
MOST_WHEELS = 8
MOST_ENCODERS = 4  # of driven wheels; of more wheels, odometry reads the first
CASTER_LOAD = 0.2  # share of the weight that rests on the casters of a differential drive, unless its sheet says so
FULL_TURN = 2.0 * math.pi  # rad
SPANNED = 1e-3  # of the wheel matrix without units: a smaller singular value, beside the largest, counts as zero
SUBSTEP = 0.01  # s, of the pymunk plant: in it no robot goes further than its hull's radius, or it passes walls

# The range of each number of a data sheet, and its unit.
_RANGES: Mapping[str, tuple[float, float, str]] = {
    "radius": (1e-3, 10.0, "m"),
    "x": (-10.0, 10.0, "m"),
    "y": (-10.0, 10.0, "m"),
    "direction": (-FULL_TURN, FULL_TURN, "rad"),
    "roller_angle": (-1.4, 1.4, "rad"),
    "track": (2e-3, 20.0, "m"),
    "effective_track": (2e-3, 60.0, "m"),
    "wheelbase": (0.0, 20.0, "m"),
    "hull.radius": (1e-3, 10.0, "m"),
    "hull.length": (2e-3, 10.0, "m"),
    "hull.width": (2e-3, 10.0, "m"),
    "mass": (LIGHTEST, HEAVIEST, "kg"),
    "inertia": (1e-9, 1e8, "kg m^2"),
    "friction": (1e-3, 10.0, "(no unit)"),
    "driven_load": (1e-3, 1.0, "(a share of the weight)"),
    "rated_wheel_speed": (1e-3, 1e4, "rad/s"),
    "peak_wheel_speed": (1e-3, 1e4, "rad/s"),
    "acceleration": (1e-3, 1e4, "m/s^2"),
    "yaw_acceleration": (1e-3, 1e5, "rad/s^2"),
    "turn_speed": (1e-3, 1e4, "rad/s"),
    "turning_radius": (0.0, 100.0, "m"),
    "lag": (0.0, 10.0, "s"),
    "delay": (0.0, 1.0, "s"),
    "gain": (0.1, 10.0, "(no unit)"),
    "deceleration": (1e-3, 1e4, "m/s^2"),
    "yaw_deceleration": (1e-3, 1e5, "rad/s^2"),
    "range": (1e-3, 1e4, "m"),
    "angle": (1e-3, FULL_TURN, "rad"),
}
MOST_BEAMS = 10_000
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,39}")


def _number(field: str, value: Any, kind: str = "") -> float:
    """Returns a number of a data sheet as a float; ValueError with its range and unit if it is none of that kind."""
    least, most, unit = _RANGES[kind or field]
    number = real(value)
    if not least <= number <= most:
        raise ValueError(f"{field} is {shown(value)}; it must be a number from {least:g} to {most:g} {unit}")
    return number


SATURATIONS = ("twist", "wheels")
RESPONSES = ("stepped", "continuous")


@dataclasses.dataclass(frozen=True)
class Response:
    """What a base does besides what the other fields of `Actuators` say; the axes are v_x, v_y and the yaw rate."""

    continuous: bool  # within the control period too, else in steps at its beginning
    wheel_saturation: bool  # each wheel is clipped, else the twist is scaled as a whole
    delays: tuple[float, float, float]  # s, from the command to its first effect
    gains: tuple[float, float, float]  # of the twist that the base sets for the commanded one
    lags: tuple[float, float, float]  # s
    deceleration: float  # m/s^2, while the commanded velocity falls
    yaw_deceleration: float  # rad/s^2


@dataclasses.dataclass(frozen=True)
class Actuators:
    """How a commanded wheel speed becomes a wheel speed."""

    at_rated_speed: bool  # wheels saturate at the rated speed, else at the peak speed
    acceleration: float  # m/s^2, of the commanded velocity
    yaw_acceleration: float  # rad/s^2, of the commanded yaw rate
    lag: float  # s, time constant of the first-order response; the longest where axes differ
    response: Response | None = None  # None: of a base whose sheet says nothing of it

    @property
    def reaction(self) -> float:
        """Returns the mean time (s) by which the base is late: the lag, and the longest delay.

        Policies predict with it as with a lag: of what a first-order response does, delay and lag are told apart by its
        beginning alone.
        """
        return self.lag + max(self.response.delays) if self.response else self.lag

    @property
    def surely(self) -> tuple[float, float]:
        """Returns the accelerations (m/s^2, rad/s^2) that the base has both ways: what a policy may count on."""
        if self.response is None:
            return self.acceleration, self.yaw_acceleration
        braking = self.response.deceleration, self.response.yaw_deceleration
        return min(self.acceleration, braking[0]), min(self.yaw_acceleration, braking[1])


# The tiers as robots have them whose data sheets say nothing of accelerations and lag: see `Robot.actuators`.
ACTUATORS = {
    "ideal": Actuators(at_rated_speed=False, acceleration=math.inf, yaw_acceleration=math.inf, lag=0.0),
    "lagged": Actuators(at_rated_speed=True, acceleration=1.0, yaw_acceleration=3.0, lag=0.1),
    "slow": Actuators(at_rated_speed=True, acceleration=0.5, yaw_acceleration=1.5, lag=0.25),
}
_NOMINAL = ACTUATORS["lagged"]


@dataclasses.dataclass(frozen=True)
class Wheel:
    """A wheel, in the body frame: x forward, y left, angles counter-clockwise."""

    x: float  # m, contact point
    y: float  # m
    radius: float  # m
    direction: float = 0.0  # rad, in which it drives
    # rad, from the drive direction to the axis of the roller on the floor, the only direction in which the wheel pulls;
    # 0 for omni wheels, +-pi/4 for most mecanum wheels (Lynch and Park's gamma)
    roller_angle: float = 0.0


@dataclasses.dataclass(frozen=True)
class Sensors:
    """The range scan of an environment by default."""

    beams: int = 32
    range: float = 5.0  # m
    angle: float = FULL_TURN  # rad, field of view


@dataclasses.dataclass(frozen=True)
class Robot:
    """What a robot is made of. Angles in the body frame: x forward, y left, counter-clockwise.

    Raises:
        ValueError: in one line, naming field, value, range and unit, if it is no robot that can be: a number out of
            range, a wheel outside of the hull, wheels that cannot make every twist.
    """

    name: str
    drive: str  # "differential", "omni" or "mecanum"
    wheels: tuple[Wheel, ...]  # of a differential drive right, left
    # m, the disc that must not touch anything, or the one around `hull_box`, about the pose; 0, of a point, for studies
    # in Python alone
    hull_radius: float
    mass: float  # kg
    inertia: float  # kg m^2, about the vertical axis
    friction: float  # of a wheel on the floor, along its traction
    rated_wheel_speed: float  # rad/s, what the motors hold in every tier but "ideal"
    peak_wheel_speed: float  # rad/s, in the tier "ideal"
    # rad/s, at which the robot's driver stops turns, in every tier; inf: only the wheels do
    turn_speed: float = math.inf
    turning_radius: float = 0.0  # m, the least, of a base that is steered; 0: it turns on the spot
    # in the tier "lagged"; "slow" has half the accelerations and 2.5 times the lag
    acceleration: float = _NOMINAL.acceleration  # m/s^2
    yaw_acceleration: float = _NOMINAL.yaw_acceleration  # rad/s^2
    lag: float | tuple[float, ...] = _NOMINAL.lag  # s, of all axes or of each one that the robot can command
    delay: tuple[float, ...] = ()  # s, of each such axis; none: 0
    gain: tuple[float, ...] = ()  # of each such axis; none: 1
    decelerations: tuple[float, ...] = ()  # m/s^2 and rad/s^2, while speeds fall; none: the accelerations
    saturation: str = "twist"  # one of SATURATIONS
    response: str = "stepped"  # one of RESPONSES
    driven_load: float = 1.0  # share of the weight on the driven wheels; casters bear the rest
    # two encoder wheels that are not driven, for odometry with an IMU; none when drive wheels serve
    encoders: tuple[Wheel, ...] = ()
    sensors: Sensors = Sensors()
    # as a differential drive is built, where its wheels skid in a turn as if they stood elsewhere: see `built`
    track: float | None = None  # m; None: as `wheels` say
    wheelbase: float = 0.0  # m, between the axles of a skid steer
    hull_box: tuple[float, float] | None = None  # m, length and width of a rectangle; None: the hull is a disc
    hull_x: float = 0.0  # m, how far its middle lies ahead of the pose, which is the axle's middle
    title: str = dataclasses.field(default="", compare=False, repr=False)
    # by field: a text, or an `Interval` of what was identified
    sources: Mapping[str, str | Interval] = dataclasses.field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise ValueError(f"name is {shown(self.name)}; it must be letters, digits, _, - and dots, at most 40")
        choose("drive", self.drive, DRIVES)
        for name in ("mass", "inertia", "friction", "driven_load", "rated_wheel_speed", "peak_wheel_speed"):
            object.__setattr__(self, name, _number(name, getattr(self, name)))
        for name in ("acceleration", "yaw_acceleration", "wheelbase", "turning_radius"):
            object.__setattr__(self, name, _number(name, getattr(self, name)))
        self._check_response()
        if real(self.turn_speed) != math.inf:
            object.__setattr__(self, "turn_speed", _number("turn_speed", self.turn_speed))
        if self.hull_box is not None:
            object.__setattr__(self, "hull_box", _box(self.hull_box))
            length, width = self.hull_box
            object.__setattr__(self, "hull_radius", 0.5 * math.hypot(length + 2.0 * abs(real(self.hull_x)), width))
        most = 0.5 * self.hull_box[0] if self.hull_box else 0.0
        if not abs(real(self.hull_x)) <= most:
            within = f"a number from {-most:g} to {most:g} m: the pose lies within the hull" if most else "0 for a disc"
            raise ValueError(f"hull.x is {shown(self.hull_x)}; it must be {within}")
        object.__setattr__(self, "hull_x", real(self.hull_x))
        if real(self.hull_radius) != 0.0:
            object.__setattr__(self, "hull_radius", _number("hull.radius", self.hull_radius))
        if self.track is not None:
            object.__setattr__(self, "track", _number("track", self.track))
        least = 2 if self.drive == "differential" else 3
        object.__setattr__(self, "wheels", _wheels("wheels", self.wheels, least))
        object.__setattr__(self, "encoders", _wheels("encoders", self.encoders, 0))
        scan = self.sensors
        if not isinstance(scan, Sensors):
            raise ValueError(f"sensors is {shown(scan)}; it must be Sensors")
        whole("sensors.beams", scan.beams, 0, MOST_BEAMS)
        distance, angle = _number("sensors.range", scan.range, "range"), _number("sensors.angle", scan.angle, "angle")
        object.__setattr__(self, "sensors", Sensors(int(scan.beams), distance, angle))
        if self.drive == "differential":
            self._check_pair()
        elif self.track is not None or self.wheelbase or self.turning_radius:
            raise ValueError(
                f"track, wheelbase and turning_radius belong to the drive differential, not to {self.drive}"
            )
        self._check_body()
        self._check_wheels()

    def _check_response(self) -> None:
        """Raises ValueError unless what the axes do is a number for each of them; whole numbers become floats."""
        axes = ("v_x", "v_y", "yaw rate") if self.holonomic else ("v_x", "yaw rate")
        for name in ("delay", "gain"):
            object.__setattr__(self, name, _each(name, getattr(self, name), (name,) * len(axes), axes))
        lag: Any = self.lag  # of a sheet a list
        if isinstance(lag, list | tuple):
            lag = _each("lag", lag, ("lag",) * len(axes), axes) or math.nan
        object.__setattr__(self, "lag", lag if isinstance(lag, tuple) else _number("lag", lag))
        kinds = ("deceleration", "yaw_deceleration")
        meanings = ("of the velocity", "of the yaw rate")
        object.__setattr__(self, "decelerations", _each("decelerations", self.decelerations, kinds, meanings))
        choose("saturation", self.saturation, SATURATIONS)
        choose("response", self.response, RESPONSES)

    def _check_pair(self) -> None:
        """Raises ValueError unless the wheels are those of a differential drive."""
        right, left = self.wheels[0], self.wheels[-1]
        if len(self.wheels) > 2 or right.x or left.x or right.direction or left.direction or not right.y < 0.0 < left.y:
            raise ValueError(
                "wheels must be two for the drive differential, right and left of the centre, both driving ahead"
            )

    def _check_body(self) -> None:
        """Raises ValueError where two numbers do not go together."""
        if self.peak_wheel_speed < self.rated_wheel_speed:
            raise ValueError(
                f"peak_wheel_speed is {self.peak_wheel_speed:g}; it must be at least rated_wheel_speed, "
                f"{self.rated_wheel_speed:g} rad/s"
            )
        reach = self.hull_radius
        if 0.0 < self.mass * reach**2 < self.inertia:
            raise ValueError(
                f"inertia is {self.inertia:g}; it must be at most mass hull.radius^2 = {self.mass * reach**2:.3g} "
                "kg m^2, for all of the mass is within the hull"
            )
        for i, wheel in enumerate(self.built):
            distance = math.hypot(wheel.x, wheel.y)
            if self.hull_box:
                places = wheel.x - self.hull_x, wheel.y
                for name, at, size in zip(("length", "width"), places, self.hull_box, strict=True):
                    if abs(at) > 0.5 * size * (1.0 + 1e-9):
                        raise ValueError(
                            f"hull.{name} is {size:g}; it must be at least {2.0 * abs(at):.3g} m, for wheels[{i}]"
                        )
            if reach > 0.0 and distance > reach * (1.0 + 1e-9):
                raise ValueError(
                    f"hull.radius is {reach:g}; it must be at least {distance:.3g} m, where wheels[{i}] stands"
                )

    def _check_wheels(self) -> None:
        """Raises ValueError unless the wheels make every twist, and none of them faster than the plants can follow."""
        for i, wheel in enumerate(self.wheels):
            if self.drive != "mecanum" and wheel.roller_angle:
                raise ValueError(f"wheels[{i}].roller_angle is {wheel.roller_angle:g}; it belongs to the drive mecanum")
        self._check_span("wheels", self.wheel_matrix, self.twist_axes)
        if len(self.wheels) > MOST_ENCODERS:
            self._check_span("wheels[0] to wheels[3], which odometry reads,", self.wheel_matrix[:4], self.twist_axes)
        if self.encoders:
            if len(self.encoders) != 2:
                raise ValueError(f"encoders has {len(self.encoders)} entries; it must have 2, beside an IMU, or none")
            rows = np.vstack([wheel_matrix(self.encoders), [0.0, 0.0, 1.0]])
            self._check_span("encoders", rows, (0, 1, 2))
        most = self.least_half / SUBSTEP
        fastest = self._fastest
        if 0.0 < most < fastest:
            raise ValueError(
                f"peak_wheel_speed is {self.peak_wheel_speed:g}; it must be at most "
                f"{self.peak_wheel_speed * most / fastest:.3g} rad/s: at {fastest:.3g} m/s the robot would go further "
                f"than {'half of its hull.width' if self.hull_box else 'its hull.radius'} in 0.01 s"
            )

    @property
    def sheet(self) -> dict[str, Any]:
        """Returns the content of a data sheet of the robot, from which `read_robot` makes it again.

        Raises:
            ValueError: if no sheet can say it: wheels of a differential drive that are no pair.
        """
        content: dict[str, Any] = {"name": self.name, "title": self.title, "drive": self.drive}
        if self.holonomic:
            names = (*_OMNI, "roller_angle") if self.drive == "mecanum" else _OMNI
            content["wheels"] = [{name: getattr(wheel, name) for name in names} for wheel in self.wheels]
        else:
            right, left = self.wheels
            if right.y != -left.y or right.radius != left.radius:
                raise ValueError(
                    "wheels have different radii or distances from the middle; a data sheet has one of each"
                )
            content["wheels"] = {"radius": left.radius, "track": 2.0 * left.y}
            if self.track is not None:
                content["wheels"] |= {"track": self.track, "effective_track": 2.0 * left.y}
            if self.wheelbase:
                content["wheels"]["wheelbase"] = self.wheelbase
        if self.hull_box:
            content["hull"] = {"kind": "box", "length": self.hull_box[0], "width": self.hull_box[1]}
            if self.hull_x:
                content["hull"]["x"] = self.hull_x
        else:
            content["hull"] = {"radius": self.hull_radius}
        for name in ("mass", "inertia", "friction", "driven_load", "rated_wheel_speed", "peak_wheel_speed"):
            content[name] = getattr(self, name)
        for name in ("turn_speed", "acceleration", "yaw_acceleration", "lag", *_ABSENT):
            value = getattr(self, name)
            if name not in _ABSENT or value != _ABSENT[name]:
                content[name] = list(value) if isinstance(value, tuple) else value
        if self.encoders:
            content["encoders"] = [{name: getattr(wheel, name) for name in _OMNI} for wheel in self.encoders]
        content["sensors"] = dataclasses.asdict(self.sensors)
        content["sources"] = {
            name: source.content if isinstance(source, Interval) else source for name, source in self.sources.items()
        }
        return content

    def _check_span(self, field: str, matrix: NDArray[np.float64], axes: tuple[int, ...]) -> None:
        """Raises ValueError unless some wheel turns in every twist: the rank of the wheel matrix."""
        lengths = np.array([1.0, 1.0, 1.0 / (self.hull_radius or 1.0)])
        scaled = matrix[:, axes] * lengths[list(axes)]
        scaled = scaled / np.abs(scaled).max(axis=1, keepdims=True)
        _, sizes, twists = np.linalg.svd(scaled)
        rank = int((sizes > SPANNED * sizes[0]).sum())
        if rank < len(axes):
            twist = np.zeros(3)
            twist[list(axes)] = twists[-1] * lengths[list(axes)]
            twist /= np.abs(twist).max() * math.copysign(1.0, twist[np.abs(twist).argmax()])
            shown_twist = ", ".join(f"{round(each, 3) + 0.0:g}" for each in twist.tolist())
            raise ValueError(
                f"{field} cannot span the twists: their wheel matrix has rank {rank}, it must have {len(axes)}; none "
                f"of them turns when the base moves with (v_x m/s, v_y m/s, yaw rate rad/s) = ({shown_twist})"
            )

    @property
    def _fastest(self) -> float:
        """Returns the speed (m/s) that no straight motion exceeds at peak wheel speed, to within 0.1 %."""
        angles = np.linspace(0.0, math.pi, 360, endpoint=False) if self.holonomic else np.zeros(1)
        rates = self.wheel_matrix[:, :2] @ np.array([np.cos(angles), np.sin(angles)])
        return float(self.peak_wheel_speed / np.abs(rates).max(axis=0).min())

    @property
    def least_half(self) -> float:
        """Returns the radius (m) of the largest disc that the hull holds."""
        return 0.5 * min(self.hull_box) if self.hull_box else self.hull_radius

    @property
    def holonomic(self) -> bool:
        """Returns whether it can go sideways: its wheels have rollers."""
        return self.drive != "differential"

    @property
    def turns_on_the_spot(self) -> bool:
        """Returns whether it turns without going anywhere: it is not steered."""
        return self.turning_radius == 0.0

    @property
    def twist_axes(self) -> tuple[int, ...]:
        """Returns which components of (v_x, v_y, yaw_rate) the robot can command."""
        return (0, 1, 2) if self.holonomic else (0, 2)

    @property
    def wheel_radii(self) -> NDArray[np.float64]:
        """Returns the radii (n,) of the wheels, m."""
        return np.array([wheel.radius for wheel in self.wheels])

    @property
    def wheel_positions(self) -> tuple[tuple[float, float], ...]:
        """Returns the contact points of the wheels, m, where they act: those of a skid steer stand apart."""
        return tuple((wheel.x, wheel.y) for wheel in self.wheels)

    @property
    def wheel_directions(self) -> tuple[float, ...]:
        """Returns the drive directions of the wheels, rad."""
        return tuple(wheel.direction for wheel in self.wheels)

    @property
    def built(self) -> tuple[Wheel, ...]:
        """Returns the wheels where they stand as the robot is built: four of them under a skid steer."""
        if self.track is None and not self.wheelbase:
            return self.wheels
        half = 0.5 * (self.wheels[1].y - self.wheels[0].y) if self.track is None else 0.5 * self.track
        axles = (0.5 * self.wheelbase, -0.5 * self.wheelbase) if self.wheelbase else (0.0,)
        sides = zip(self.wheels, (-half, half), strict=True)
        return tuple(dataclasses.replace(wheel, x=x, y=y) for wheel, y in sides for x in axles)

    @functools.cached_property
    def wheel_matrix(self) -> NDArray[np.float64]:
        """Returns the (n, 3) map from twist to wheel speeds, rad/s."""
        return wheel_matrix(self.wheels)

    @functools.cached_property
    def forward_matrix(self) -> NDArray[np.float64]:
        """Returns the (3, n) map from wheel speeds (rad/s) to twist: the pseudo-inverse of `wheel_matrix`."""
        return pseudo_inverse(self.wheel_matrix)

    def wheel_speeds_from_twist(self, twist: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns wheel speeds (..., n) in rad/s from commandable twists (..., len(twist_axes))."""
        # not the matrix product, whose sums depend on how many rows there are: a robot in a batch equals a lone one
        speeds: NDArray[np.float64] = (twist[..., None, :] * self.wheel_matrix[:, self.twist_axes]).sum(axis=-1)
        return speeds

    @functools.cached_property
    def max_twist(self) -> NDArray[np.float64]:
        """Returns the largest value of each commandable twist component alone, m/s and rad/s.

        At rated wheel speed, and no faster than the driver turns; a steered base turns on its smallest radius.
        """
        columns = self.wheel_matrix[:, self.twist_axes]
        columns[:, -1] += self.turning_radius * columns[:, 0]  # it drives while it turns
        speeds = np.asarray(self.rated_wheel_speed / np.abs(columns).max(axis=0))
        speeds[-1] = min(speeds[-1], self.turn_speed)
        return speeds

    def actuators(self, tier: str) -> Actuators:
        """Returns the robot's actuators in a named tier: what `ACTUATORS` says, scaled by what the data sheet does.

        Delay, gain, decelerations, saturation and response of the sheet belong to every tier but "ideal".
        """
        return self._actuators[tier]

    @functools.cached_property
    def _actuators(self) -> Mapping[str, Actuators]:
        return {tier: self._of_tier(tier) for tier in ACTUATORS}

    def _of_tier(self, tier: str) -> Actuators:
        named = ACTUATORS[tier]
        lags = [named.lag * (lag / _NOMINAL.lag) for lag in self._of_axes(self.lag, 0.0)]
        acceleration = named.acceleration * (self.acceleration / _NOMINAL.acceleration)
        yaw_acceleration = named.yaw_acceleration * (self.yaw_acceleration / _NOMINAL.yaw_acceleration)
        response = None
        if self.responds and named.at_rated_speed:
            braking, yaw_braking = self.decelerations or (self.acceleration, self.yaw_acceleration)
            response = Response(
                self.response == "continuous",
                self.saturation == "wheels",
                self._of_axes(self.delay or 0.0, 0.0),
                self._of_axes(self.gain or 1.0, 1.0),
                (lags[0], lags[1], lags[2]),
                acceleration * (braking / self.acceleration),
                yaw_acceleration * (yaw_braking / self.yaw_acceleration),
            )
        return Actuators(named.at_rated_speed, acceleration, yaw_acceleration, max(lags), response)

    @property
    def responds(self) -> bool:
        """Returns whether the sheet says more of how the base answers than accelerations and one lag."""
        content = (self.delay, self.gain, self.decelerations, self.saturation, self.response)
        return content != ((), (), (), "twist", "stepped") or isinstance(self.lag, tuple)

    def _of_axes(self, values: float | tuple[float, ...], missing: float) -> tuple[float, float, float]:
        """Returns a number for v_x, v_y and the yaw rate; `missing` of an axis that the robot cannot command."""
        if not isinstance(values, tuple):
            return values, values, values
        return (values[0], values[1], values[2]) if self.holonomic else (values[0], missing, values[1])

    @functools.cached_property
    def digest(self) -> str:
        """Returns the SHA-256 of all that the robot is, but for its name, its title and the sources of its numbers."""
        content = dataclasses.asdict(self)
        for name in ("name", "title", "sources"):
            del content[name]
        # sheets without a field are what they were before there was one
        for name, absent in {**_ABSENT, "hull_x": 0.0}.items():
            if content[name] == absent:
                del content[name]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def __str__(self) -> str:
        """Returns the name: what tables and files call the robot."""
        return self.name


# What later fields of the digest are where a sheet lacks them.
_ABSENT: Mapping[str, Any] = {
    "turn_speed": math.inf,
    "turning_radius": 0.0,
    **{"delay": (), "gain": (), "decelerations": (), "saturation": "twist", "response": "stepped"},
}


def _each(field: str, values: Any, kinds: tuple[str, ...], meanings: tuple[str, ...]) -> tuple[float, ...]:
    """Returns a number of each kind, or none of any."""
    listed = isinstance(values, Sequence) and not isinstance(values, str)
    if not listed or len(values) not in (0, len(kinds)):
        raise ValueError(f"{field} is {shown(values)}; it must be {len(kinds)} numbers ({', '.join(meanings)})")
    return tuple(_number(f"{field}[{i}]", value, kinds[i]) for i, value in enumerate(values))


def _wheels(field: str, wheels: Any, least: int) -> tuple[Wheel, ...]:
    """Returns wheels with their numbers checked."""
    if not isinstance(wheels, Sequence) or not all(isinstance(wheel, Wheel) for wheel in wheels):
        raise ValueError(f"{field} is {shown(wheels)}; it must be a list of wheels")
    if not least <= len(wheels) <= MOST_WHEELS:
        raise ValueError(f"{field} has {len(wheels)} entries; there must be {least} to {MOST_WHEELS} wheels")
    names = [each.name for each in dataclasses.fields(Wheel)]
    return tuple(
        Wheel(**{name: _number(f"{field}[{i}].{name}", getattr(wheel, name), name) for name in names})
        for i, wheel in enumerate(wheels)
    )


def wheel_matrix(wheels: Sequence[Wheel]) -> NDArray[np.float64]:
    """Returns the (n, 3) map from twist to the speeds of wheels, rad/s."""
    return kinematics.wheel_matrix(
        [(wheel.x, wheel.y) for wheel in wheels],
        [wheel.direction for wheel in wheels],
        np.array([wheel.radius for wheel in wheels]),
        [wheel.roller_angle for wheel in wheels],
    )


_SHEET = (
    *("name", "title", "drive", "wheels", "hull", "mass", "inertia", "friction", "driven_load"),
    *("rated_wheel_speed", "peak_wheel_speed", "turn_speed", "turning_radius", "acceleration", "yaw_acceleration"),
    *("lag", "delay", "gain", "decelerations", "saturation", "response"),
    *("encoders", "sensors", "sources"),
)
_REQUIRED = ("drive", "wheels", "hull", "mass", "inertia", "friction", "rated_wheel_speed")
_INTERVAL = ("value", "low", "high", "method", "from")
_PAIR = ("radius", "track", "effective_track", "wheelbase")
_OMNI = ("x", "y", "direction", "radius")

# Good files, which tests damage.
_SAMPLE = """{"name": "mine", "title": "My robot", "drive": "differential", "wheels": {"radius": 0.05, "track": 0.3,
"effective_track": 0.4, "wheelbase": 0.2}, "hull": {"radius": 0.22}, "mass": 6, "inertia": 0.1, "friction": 0.7,
"driven_load": 0.9, "rated_wheel_speed": 15, "peak_wheel_speed": 20, "turn_speed": 6, "turning_radius": 0.2,
"acceleration": 1.5, "yaw_acceleration": 4, "lag": [0.05, 0.1], "delay": [0.12, 0.16], "gain": [1, 0.8],
"decelerations": [2, 5], "saturation": "wheels", "response": "continuous", "sensors": {"beams": 36, "range": 4,
"angle": 4.71}, "sources":
{"wheels": "measured", "delay": {"value": [0.12, 0.16], "low": [0.11, 0.15], "high": [0.13, 0.17],
"method": "profile likelihood, 95 %", "from": "a log"}}}"""
_BOX = '{"kind": "box", "length": 0.5, "width": 0.4, "x": 0.03}'
_OMNI_SAMPLE = """{"drive": "omni", "wheels": [{"x": 0.2, "y": 0, "direction": 1.57, "radius": 0.04}, {"x": -0.1,
"y": 0.17, "direction": 3.67, "radius": 0.04}, {"x": -0.1, "y": -0.17, "direction": 5.76, "radius": 0.05}], "encoders":
[{"x": 0, "y": 0.1, "direction": 0, "radius": 0.02}, {"x": -0.1, "y": 0, "direction": 1.57, "radius": 0.02}], "hull":
{"radius": 0.25}, "mass": 5, "inertia": 0.1, "friction": 0.6, "rated_wheel_speed": 20}"""


@reader("data sheet of a robot", "mine.json", {"mine.json": _SAMPLE})
@reader("data sheet of a robot with a box", "box.json", {"box.json": _SAMPLE.replace('{"radius": 0.22}', _BOX)})
@reader("data sheet of an omni base", "omni.json", {"omni.json": _OMNI_SAMPLE})
def read_robot(file: str) -> Robot:
    """Returns the robot of a data sheet, a .json file with one object; `docs/data_sheet.md` says what each field means.

    Raises:
        ValueError: if the file is no data sheet; one line that starts with the file and names field, value, range and
            unit, or if it bears the name of a robot that ships and is another.
        OSError: if it cannot be opened, FileNotFoundError if there is none.
    """
    robot = _robot_of(file)
    tell(robot, file)
    shipped = ROBOTS.get(robot.name)
    if shipped is None:
        return robot
    if robot != shipped:
        raise fault(file, f"name is {robot.name!r}, which ships and has other numbers; give this robot another name")
    return shipped


def _robot_of(file: str) -> Robot:
    """Returns the robot of a data sheet, whatever it is called."""
    fields = json_object(file)
    if "drive" not in fields:
        raise fault(file, f"field 'drive' is missing; choose from {', '.join(map(repr, DRIVES))}")
    check_keys(file, "", fields, _SHEET, _REQUIRED)
    try:
        choose("drive", fields["drive"], DRIVES)
        differential = fields["drive"] == "differential"
        given: dict[str, Any] = {
            "name": os.path.splitext(os.path.basename(file))[0],
            "peak_wheel_speed": fields["rated_wheel_speed"],
            "driven_load": 1.0 - CASTER_LOAD if differential else 1.0,
            **fields,
        }
        if differential:
            given |= _pair(file, given["wheels"])
        else:
            more = ("roller_angle",) if fields["drive"] == "mecanum" else ()
            given["wheels"] = _listed(file, "wheels", given["wheels"], (*_OMNI, *more))
        given["encoders"] = _listed(file, "encoders", given.get("encoders", []), _OMNI)
        given |= _hull(file, given.pop("hull"))
        given["sensors"] = Sensors(**_object(file, "sensors", given.get("sensors", {}), ("beams", "range", "angle")))
        given["sources"] = _sources(file, given.get("sources", {}))
        if not isinstance(given.get("title", ""), str):
            raise fault(file, f"title is {shown(given['title'])}; it must be a text")
        robot = Robot(**given)
        _check_intervals(robot)
        return robot
    except ValueError as error:
        raise fault(file, error) from None


def _sources(file: str, value: Any) -> dict[str, str | Interval]:
    """Returns where fields come from: texts, and intervals of what was identified."""
    if not isinstance(value, dict):
        raise fault(file, f"sources is {shown(value)}; it must map fields to texts or intervals")
    sources: dict[str, str | Interval] = {}
    for name, source in value.items():
        if isinstance(source, dict):
            place = f"sources.{printable(name)}"
            if name not in IDENTIFIED:
                raise fault(file, f"{place} is an interval; fields that have one are {', '.join(IDENTIFIED)}")
            _object(file, place, source, _INTERVAL, _INTERVAL[:4])
            sources[name] = Interval(place, *(source.get(key, "") for key in _INTERVAL))
        elif isinstance(source, str):
            sources[name] = source
        else:
            raise fault(file, f"sources is {shown(value)}; it must map fields to texts or intervals")
    return sources


def _check_intervals(robot: Robot) -> None:
    """Raises ValueError unless the intervals of a sheet are about its own numbers."""
    for name, source in robot.sources.items():
        if not isinstance(source, Interval):
            continue
        if name != "wheels.effective_track":
            own = getattr(robot, name)
        else:
            own = None if robot.holonomic else robot.wheels[1].y - robot.wheels[0].y
        if source.value != own:
            raise ValueError(f"{source.place}.value is {shown(source.value)}; it must be the field's, {shown(own)}")
        kinds = ("deceleration", "yaw_deceleration") if name == "decelerations" else (name.removeprefix("wheels."),) * 3
        for (_, low, high), kind in zip(source.components, kinds, strict=False):
            for end in (low, high):
                if end is not None:
                    _number(source.place, end, kind)


def _object(file: str, place: str, value: Any, known: tuple[str, ...], required: tuple[str, ...] = ()) -> Any:
    """Returns a part of a data sheet that is an object."""
    if not isinstance(value, dict):
        raise fault(file, f"{place} is {shown(value)}; it must be an object with {', '.join(known)}")
    check_keys(file, f"{place}.", value, known, required)
    return value


def _hull(file: str, value: Any) -> dict[str, Any]:
    """Returns the hull, a disc or a box."""
    kinds = {"disc": ("radius",), "box": ("length", "width")}
    kind = value.get("kind", "disc") if isinstance(value, dict) else "disc"
    choose("hull.kind", kind, kinds)
    named = ("kind",) if isinstance(value, dict) and "kind" in value else ()
    more = ("x",) if kind == "box" else ()
    hull = _object(file, "hull", value, (*kinds[kind], *more, *named), kinds[kind])
    if kind == "disc":
        return {"hull_radius": _number("hull.radius", hull["radius"])}
    return {"hull_radius": 0.0, "hull_box": (hull["length"], hull["width"]), "hull_x": hull.get("x", 0.0)}


def _box(value: Any) -> tuple[float, float]:
    """Returns length and width of a hull."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise ValueError(f"hull_box is {shown(value)}; it must be length and width, m")
    return _number("hull.length", value[0]), _number("hull.width", value[1])


def _pair(file: str, value: Any) -> dict[str, Any]:
    """Returns wheels, track and wheelbase of a differential drive. Its motion is that of the effective track."""
    pair = _object(file, "wheels", value, _PAIR, ("radius", "track"))
    numbers = {name: _number(f"wheels.{name}", pair[name], name) for name in _PAIR if name in pair}
    half = 0.5 * numbers.get("effective_track", numbers["track"])
    apart = numbers.keys() & {"effective_track", "wheelbase"}
    return {
        "wheels": tuple(Wheel(0.0, y, numbers["radius"]) for y in (-half, half)),
        "track": numbers["track"] if apart else None,
        "wheelbase": numbers.get("wheelbase", 0.0),
    }


def _listed(file: str, place: str, value: Any, known: tuple[str, ...]) -> tuple[Wheel, ...]:
    """Returns the wheels of a list of objects."""
    if not isinstance(value, list):
        raise fault(file, f"{place} is {shown(value)}; it must be a list of objects with {', '.join(known)}")
    return tuple(Wheel(**_object(file, f"{place}[{i}]", each, known, known)) for i, each in enumerate(value))


# What the documents describe comes first, and is an environment's default.
_FIRST = ("p3dx", "omni3", "omni4")


def _shipped() -> dict[str, Robot]:
    """Returns the robots of the data sheets that ship, by name."""
    folder = Path(str(resources.files("wayfield.envs.robots"))) / "data_sheets"
    robots = {robot.name: robot for robot in (_robot_of(str(file)) for file in sorted(folder.glob("*.json")))}
    return {name: robots[name] for name in dict.fromkeys((*_FIRST, *robots))}


ROBOTS: dict[str, Robot] = _shipped()

AnyRobot = Robot | str | os.PathLike[str]  # one that ships, by its name; a data sheet, by its file; or a Robot


def robot_of(robot: AnyRobot, field: str = "robot") -> Robot:
    """Returns a robot by what names it: the name of one that ships, the .json file of a data sheet, or a `Robot`.

    Raises:
        ValueError: if there is none of that name, naming the field and the nearest, or the sheet is wrong.
        OSError: if the data sheet cannot be opened.
    """
    return _chosen(robot, field, tuple(ROBOTS))


def shipped_name(robot: Robot) -> str | Robot:
    """Returns the name of a robot that ships, and any other robot itself."""
    return robot.name if ROBOTS.get(robot.name) == robot else robot


def robots_with(holonomic: bool) -> tuple[str, ...]:
    """Returns the names of the robots that ship and go sideways, or of those that do not; the documents' first."""
    return tuple(name for name, robot in ROBOTS.items() if robot.holonomic == holonomic)


def offered(robot: AnyRobot | None, names: tuple[str, ...]) -> Robot:
    """Returns the robot of an environment.

    Args:
        robot: as for `robot_of`; None for the first of the names.
        names: of the robots that ship and that the environment is for.

    Raises:
        ValueError, OSError: as `robot_of`, or if the robot has another kind of drive than the environment's.
    """
    choice = _chosen(names[0] if robot is None else robot, "robot", names)
    holonomic = ROBOTS[names[0]].holonomic
    if choice.holonomic != holonomic:
        wanted = "omni or mecanum" if holonomic else "differential"
        raise ValueError(
            f"robot {choice.name!r} has the drive {choice.drive}; this environment needs {wanted}, such as "
            f"{', '.join(map(repr, names))}"
        )
    return choice


def _chosen(robot: AnyRobot, field: str, names: tuple[str, ...]) -> Robot:
    if isinstance(robot, Robot):
        return robot
    if isinstance(robot, os.PathLike) or (isinstance(robot, str) and robot.lower().endswith(".json")):
        return read_robot(os.fspath(robot))
    if not isinstance(robot, str) or robot not in ROBOTS:
        try:
            choose(field, robot, names)
        except ValueError as error:
            raise ValueError(f"{error} A robot of your own is a data sheet, a .json file.") from None
    return ROBOTS[robot]
