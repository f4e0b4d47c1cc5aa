"""Polar coordinates: to a pose by feedback of distance and two bearings, forward or backward."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.arriving import gentle, is_there, stay_radius, turn_rate
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.polar_coordinates import polar_twist
from wayfield.policies.parts.steering import unicycle_twists
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import bearing

MEMORY = np.dtype(
    [
        ("arrived", np.float64),  # 1: there
        ("way", np.float64),  # 1 forward, -1 backward, 0: not chosen
        ("stay", np.float64),  # m, of `stay_radius`
    ]
)

_TURN_BACK = 0.75 * math.pi  # rad, of alpha, beyond which the way is chosen anew: pushed past its pose


@dataclasses.dataclass(frozen=True)
class Polar(GoalLaw):
    """Lets distance and bearings decay together. In polar coordinates about the pose the law is smooth and static.

    With rho the distance to the pose, alpha its bearing from the robot and beta the turn from the line of sight to the
    pose's heading:

        v = k_rho rho,   w = k_alpha alpha + k_beta beta

    Near the pose's axis rho' = -k_rho rho, and (alpha, beta) fall by the matrix [[k_rho - k_alpha, -k_beta],
    [-k_rho, 0]]: exponentially for k_rho > 0, k_beta < 0, k_alpha > k_rho. With k_alpha + 5/3 k_beta > 2/pi k_rho too,
    a robot that starts within 90 degrees of facing the pose keeps it there and never changes its direction. One that
    starts with its back to the pose drives backward by the same law, in a frame turned by half a turn.

    All speeds are scaled by one factor, which leaves the curve as it is: so that |v| <= max_speed, |w| <=
    max_yaw_rate, and |v| <= sqrt(2 deceleration rho). The law is singular at rho = 0: within `arrival_radius` (twice
    that, once there or with the pose no longer ahead) the robot stops and turns on the spot by what is left, |w| =
    min(turn_gain e, sqrt(2 yaw_acceleration e), max_yaw_rate). What stands around is not seen. A waypoint has no
    heading: beta is 0 there. Drives any robot as a unicycle.

    Sources: Aicardi, Casalino, Bicchi and Balestrino, Closed Loop Steering of Unicycle-Like Vehicles via Lyapunov
    Techniques, IEEE Robotics and Automation Magazine 2(1), 1995 (the coordinates); Astolfi, Exponential Stabilization
    of a Wheeled Mobile Robot via Discontinuous Control, J. Dyn. Sys. Meas. Control 121(1), 1999 (law and gains). The
    one factor, the braking and the turn at the end are ours.
    """

    k_rho: float = gain(3.0, "1/s", "speed per metre from the goal", above=0.0, search=(1.0, 5.0))
    k_alpha: float = gain(8.0, "1/s", "yaw rate per radian from the goal", above="k_rho", search=(5.5, 20.0))
    k_beta: float = gain(-1.5, "1/s", "yaw rate per radian from the goal heading", below=0.0, search=(-4.0, -0.5))
    max_speed: float = gain(0.6, "m/s", "at most", above=0.0, search=(0.2, 0.6))
    deceleration: float = gain(0.4, "m/s^2", "no more than half of what the base can", above=0.0, search=(0.2, 0.8))
    arrival_radius: float = gain(
        0.02, "m", "within which it turns to the heading, or less if the goal asks for it", above=0.0
    )
    turn_gain: float = gain(2.0, "1/s", "of the turn at the goal", above=0.0)
    yaw_acceleration: float = gain(1.0, "rad/s^2", "of the turn at the goal; no more than the base can", above=0.0)
    max_yaw_rate: float = gain(1.5, "rad/s", "at most", above=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns whether each robot is there and which way it drives, MEMORY records (b,)."""
        memory = np.zeros(briefing.num_envs, MEMORY)
        memory["stay"] = stay_radius(self.arrival_radius, briefing)
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        p = params(self, briefing, **gentle(self, briefing))
        twists = np.empty((len(observation.pose), 2))
        approach(p, observation.goal, observation.goal_heading_error, observation.waypoints_left, memory, twists)
        return unicycle_twists(briefing.robot, twists[:, 0], twists[:, 1])


@any_layout
@compiled
def approach(params, goals, turns, waypoints_left, memory, twists):
    """Fills the (b, 2) speeds and yaw rates of `Polar.act` and keeps the memory up to date."""
    p = params[0]
    for i in range(goals.shape[0]):
        m = memory[i]
        px = goals[i, 0]
        py = goals[i, 1]
        last = waypoints_left[i] == 0.0
        if m.way == 0.0 or abs(bearing(m.way * py, m.way * px)) > _TURN_BACK:
            m.way = 1.0 if px >= 0.0 else -1.0
        there = is_there(m.arrived == 1.0, m.way * px, m.way * py, p.arrival_radius, m.stay)
        m.arrived = 1.0 if last and there else 0.0
        if m.arrived == 1.0:
            twists[i, 0] = 0.0
            twists[i, 1] = turn_rate(p, turns[i])
            m.way = 0.0
        else:
            px *= m.way
            py *= m.way
            v, w = polar_twist(p, px, py, turns[i] if last else bearing(py, px))
            twists[i, 0] = m.way * v
            twists[i, 1] = w
