"""How a robot differs from its data sheet: named, ordered levels, and each cause alone.

Policies have no access to it: the briefing describes the nominal robot.
"""

import dataclasses
import math
import statistics

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Robot, kinematics
from wayfield.system.linear import product, pseudo_inverse

SHOVE_FROM = 2.0  # s, a shove or a drift comes at a time drawn between these two
SHOVE_UNTIL = 6.0  # s


@dataclasses.dataclass(frozen=True)
class Disturbance:
    """What is wrong with the robot; all zeros is nothing.

    Wheels: wheel k of 0, 1, ... has the radius r (1 + (-1)^k wheel_radius_error) and stands 1 + track_error times as
    far out as the data sheet says: the two systematic errors of odometry (unequal diameters, uncertain wheelbase) that
    Borenstein and Feng's UMBmark test measures (1996). Where the wheels of an omni base then fight each other, it moves
    by the pseudo-inverse.

    Slip: of every motion of the wheels, in translation and rotation, the body makes the share 1 - slip. In a bend it
    also drifts outwards, at `side_slip` times the centripetal acceleration w x v: a viscous contact, which leaves the
    body side_slip * w (rad) off the direction that the wheels ask for.

    Encoders on drive wheels read the wheels, passive encoder wheels the floor. As soon as anything here is wrong with
    wheels, grip, pose or encoders, the measured twist comes from the encoders and errs with them.

    The pymunk plant takes the same wheels and the same slip for what its floor pulls the body to; wheels that spin or
    skid because the traction does not reach do so on top.
    """

    wheel_radius_error: float = 0.0  # relative
    track_error: float = 0.0  # relative
    slip: float = 0.0  # share of the wheels' motion that is lost
    side_slip: float = 0.0  # s
    pose_noise: float = 0.0  # these three are added to `noise` for the one reading, in its units
    encoder_noise: float = 0.0
    range_noise: float = 0.0
    range_dropout: float = 0.0  # probability that a beam comes back empty and reads max_range
    action_delay: int = 0  # whole control periods between asking and doing
    shove: float = 0.0  # m, by which the pose is displaced once an episode, at a drawn time in a drawn direction
    drift: float = 0.0  # m/s, at which it is displaced from that time on, in that direction
    drift_lasts: float = math.inf  # s
    drift_period: float = 0.0  # s, of a sine that drives it to and fro; 0: steadily

    def distortion(self, robot: Robot) -> NDArray[np.float64]:
        """Returns the (3, 3) map from the twist that the wheels turn for to the body's, but for the side slip."""
        if not (self.wheel_radius_error or self.track_error):
            return (1.0 - self.slip) * np.eye(3)
        positions = (1.0 + self.track_error) * np.array(robot.wheel_positions)
        rollers = [wheel.roller_angle for wheel in robot.wheels]
        true = kinematics.wheel_matrix(positions, robot.wheel_directions, robot.wheel_radii, rollers)
        signs = np.where(np.arange(len(positions)) % 2, -1.0, 1.0)
        true /= (1.0 + signs * self.wheel_radius_error)[:, None]
        return (1.0 - self.slip) * product(pseudo_inverse(true), robot.wheel_matrix)

    @property
    def distorts(self) -> bool:
        """Returns whether the body moves otherwise than its wheels turn for."""
        return bool(self.wheel_radius_error or self.track_error or self.slip or self.side_slip)

    @property
    def displaces(self) -> bool:
        """Returns whether the pose is displaced without the wheels."""
        return bool(self.shove or self.drift)

    def displacement(self, dt: float) -> dict[str, float]:
        """Returns the values of `records.ROBOT_PARAMS` about what is drawn to displace the pose."""
        lasts = min(self.drift_lasts / dt, 1e9) if self.drift else 1.0
        swing = 2.0 * math.pi * dt / self.drift_period if self.drift_period else 0.0
        return {"drawn_shove": self.shove + dt * self.drift, "shove_periods": round(lasts), "shove_swing": swing}

    @property
    def dropout_below(self) -> float:
        """Returns the standard normal number below which a beam drops out; -inf for none."""
        return statistics.NormalDist().inv_cdf(self.range_dropout) if self.range_dropout else -math.inf


# Everything grows with every level. The numbers are chosen, not measured: light is a robot that was calibrated last
# week, severe one that belongs in the workshop. Radii differ by the spread of good tyres up to worn ones; slip is that
# of rubber on a dry hall floor up to omni rollers on dust; noise is in units of the nominal sensors; beams drop out on
# black and slanting surfaces; a loop over a network costs one control period, a camera in it three.
_LEVELS = {
    "none": Disturbance(),
    # radius, track, slip, side slip, noise of pose, encoders and ranges, dropout, delay, shove
    "light": Disturbance(0.005, 0.01, 0.02, 0.01, 0.5, 0.5, 0.5, 0.01, 0, 0.05),
    "moderate": Disturbance(0.01, 0.02, 0.05, 0.02, 1.0, 1.0, 1.0, 0.02, 1, 0.1),
    "strong": Disturbance(0.02, 0.03, 0.10, 0.04, 2.0, 2.0, 2.0, 0.05, 2, 0.2),
    "severe": Disturbance(0.03, 0.05, 0.15, 0.06, 3.0, 3.0, 3.0, 0.10, 3, 0.3),
}
LEVELS = tuple(_LEVELS)


def _alone(*fields: str) -> Disturbance:
    """Returns the named fields of the level "strong", and nothing else."""
    return Disturbance(**{field: getattr(_LEVELS["strong"], field) for field in fields})


DISTURBANCES = _LEVELS | {
    "wheel_error": _alone("wheel_radius_error", "track_error"),
    "slip": _alone("slip", "side_slip"),
    "noise": _alone("pose_noise", "encoder_noise", "range_noise"),
    "dropout": _alone("range_dropout"),
    "delay_1": Disturbance(action_delay=1),
    "delay_2": Disturbance(action_delay=2),
    "delay_3": Disturbance(action_delay=3),
    "shove": _alone("shove"),
    "gust": Disturbance(drift=0.05, drift_lasts=2.0),
    "periodic": Disturbance(drift=0.05, drift_period=4.0),
}
