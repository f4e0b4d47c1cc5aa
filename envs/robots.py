"""The robots of the three source documents, and the named actuator tiers."""

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import kinematics
from wayfield.envs.geometry import sin_cos
from wayfield.envs.linear import pseudo_inverse


@dataclasses.dataclass(frozen=True)
class Robot:
    """What a robot is made of. Angles in the body frame: x forward, y left, counter-clockwise."""

    name: str
    wheel_radius: float  # m
    wheel_positions: tuple[tuple[float, float], ...]  # contact points, m
    wheel_directions: tuple[float, ...]  # drive directions, rad
    holonomic: bool  # omni wheels, whose rollers turn freely across the drive direction
    hull_radius: float  # m, the disc that must not touch anything
    mass: float  # kg
    inertia: float  # kg m^2, about the vertical axis
    rated_wheel_speed: float  # rad/s, what the motors hold in every tier but "ideal"
    peak_wheel_speed: float  # rad/s, in the tier "ideal"
    friction: float  # of a wheel on the floor, along its traction
    # encoder wheels that are not driven, for odometry: position and rolling direction; empty when drive wheels serve
    passive_wheel_radius: float = 0.0  # m
    passive_wheel_positions: tuple[tuple[float, float], ...] = ()
    passive_wheel_directions: tuple[float, ...] = ()

    @property
    def twist_axes(self) -> tuple[int, ...]:
        """Returns which components of (v_x, v_y, yaw_rate) the robot can command."""
        return (0, 1, 2) if self.holonomic else (0, 2)

    @functools.cached_property
    def wheel_matrix(self) -> NDArray[np.float64]:
        """Returns the (n, 3) map from twist to wheel speeds, rad/s."""
        return kinematics.wheel_matrix(self.wheel_positions, self.wheel_directions, self.wheel_radius)

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
        """Returns the largest value of each commandable twist component alone at rated wheel speed, m/s and rad/s."""
        return np.asarray(self.rated_wheel_speed / np.abs(self.wheel_matrix[:, self.twist_axes]).max(axis=0))


def _ring(radius: float, degrees: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    """Returns points on a circle around the base's centre."""
    directions = [sin_cos(math.radians(a)) for a in degrees]
    return tuple((radius * cosine, radius * sine) for sine, cosine in directions)


def _radians(degrees: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(math.radians(a) for a in degrees)


ROBOTS = {
    # Document A. Wheels in the order right, left. The rim speed is capped at 1.2 m/s.
    "p3dx": Robot(
        name="p3dx",
        wheel_radius=0.195 / 2,
        wheel_positions=((0.0, -0.381 / 2), (0.0, 0.381 / 2)),
        wheel_directions=(0.0, 0.0),
        holonomic=False,
        hull_radius=0.25,
        mass=9.0,
        inertia=0.30,
        rated_wheel_speed=1.2 / 0.0975,
        peak_wheel_speed=1.2 / 0.0975,
        friction=0.8,
    ),
    # Document B. A wheel that drives along a sits at a - 90 degrees, so that all three turn the base the same way.
    # The document's unsaturated runs ask 64 rad/s: the peak leaves room for three times its lambda.
    "omni3": Robot(
        name="omni3",
        wheel_radius=0.075,
        wheel_positions=_ring(0.3, (-60.0, 60.0, 180.0)),
        wheel_directions=_radians((30.0, 150.0, -90.0)),
        holonomic=True,
        hull_radius=0.3,
        mass=12.0,
        inertia=0.6,
        rated_wheel_speed=20.0,
        peak_wheel_speed=200.0,
        friction=0.6,
        passive_wheel_radius=0.05,
        passive_wheel_positions=_ring(0.1, (-135.0, 135.0)),
        passive_wheel_directions=_radians((-45.0, -135.0)),
    ),
    # Document C. The 0.25 x 0.25 m base fits the disc around its corners.
    "omni4": Robot(
        name="omni4",
        wheel_radius=0.03,
        wheel_positions=_ring(0.13, (-45.0, 45.0, -135.0, 135.0)),
        wheel_directions=_radians((45.0, 135.0, -45.0, -135.0)),
        holonomic=True,
        hull_radius=0.125 * math.sqrt(2.0),
        mass=3.0,
        inertia=0.03,
        rated_wheel_speed=30.0,
        peak_wheel_speed=200.0,
        friction=0.6,
    ),
}


@dataclasses.dataclass(frozen=True)
class Actuators:
    """How a commanded wheel speed becomes a wheel speed."""

    at_rated_speed: bool  # wheels saturate at the rated speed, else at the peak speed
    acceleration: float  # m/s^2, of the commanded velocity
    yaw_acceleration: float  # rad/s^2, of the commanded yaw rate
    lag: float  # s, time constant of the first-order response


ACTUATORS = {
    "ideal": Actuators(at_rated_speed=False, acceleration=math.inf, yaw_acceleration=math.inf, lag=0.0),
    "lagged": Actuators(at_rated_speed=True, acceleration=1.0, yaw_acceleration=3.0, lag=0.1),
    "slow": Actuators(at_rated_speed=True, acceleration=0.5, yaw_acceleration=1.5, lag=0.25),
}
