"""The shield behind a policy: takes away the motion that a robot, by its data sheet, could not stop from in time."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots.kinematics import saturation_factor
from wayfield.envs.robots.records import aligned
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.gain import Gains, gain
from wayfield.policies.parts.params import params
from wayfield.policies.parts.stopping import (
    RECALLED,
    SECTORS,
    Scan,
    Seen,
    beam_directions,
    find_hits,
    sees_all_round,
    set_command,
    step_and_stop,
)
from wayfield.policies.policy import Policy
from wayfield.system.compiled import allocating, any_layout, inlined
from wayfield.system.elementary import sin_cos

STATE = aligned([("command", np.float64, (3,)), RECALLED])  # m/s and rad/s, the last as the plant takes it
SHARES = 4  # of a velocity that are tried
TURNED = (0.35, -0.35, 0.7, -0.7, 1.05, -1.05)  # rad, by which an omni base's velocity is turned to slide along


@dataclasses.dataclass(frozen=True)
class Shield(Gains):
    """Passes a twist on if the robot, after one period of it, can brake to rest before all that its scan hits.

    A safety filter with the brakes as its backup (model predictive shielding: Bastani, "Safe reinforcement learning
    with nonlinear dynamics via model predictive shielding", ACC 2021): the prediction is the plant's own, with the
    data sheet's accelerations and lag, so that one rule fits every robot, speed and tier. Where a twist does not pass,
    the first of these that does is driven: an omni base's velocity turned to either side and shortened by the cosine;
    three quarters, half, a quarter of the velocity at the same yaw rate; the yaw rate alone; the brakes, which passed a
    period ago.

    A hit at the distance d is grown by d times the angle between two beams: so wide is what may stand unseen beside it.
    What was near stays known for `recall` after it was last seen. Moving things are taken for standing still.

    It holds without noise, where the scan surrounds the robot and what stands is wide enough to be hit: a wall without
    thickness, seen end-on, is not.
    """

    margin: float = gain(0.02, "m", "kept from hits besides the hull", least=0.0)
    spread: float = gain(1.0, "1", "of the angle between beams that hits are grown by", least=0.0)
    recall: float = gain(10.0, "s", "for which what is near stays known out of sight", least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what is remembered of each robot, (b,) STATE.

        Raises:
            ValueError: if the scan does not surround the robot.
        """
        if not sees_all_round(briefing):
            raise ValueError(f"Shield needs a scan all around; num_beams is {len(briefing.beam_angles)}")
        return np.zeros(briefing.num_envs, STATE)

    def passed(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any], twists: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s, with what could not stop in time replaced.

        Args:
            memory: (b,) of `reset`; call this once a period.
            twists: (b, t) m/s and rad/s.
        """
        spacing = briefing.beam_angles[1] - briefing.beam_angles[0]
        nothing = np.empty((0, 0, 2))
        ranges = np.ascontiguousarray(observation.ranges)
        scan = Scan(ranges, beam_directions(briefing), briefing.max_range, nothing, nothing)
        driven = np.zeros((len(memory), 3))
        driven[:, briefing.robot.twist_axes] = twists
        p = params(self, briefing, spacing=self.spread * float(spacing))
        filter_twists(p, scan, Seen.of(observation, briefing), memory, driven)
        return driven[:, briefing.robot.twist_axes]


@any_layout
@allocating
def filter_twists(params, scan, seen, memory, twists):
    """Filters the twists (b, 3) of `Shield.passed` in place; `spacing`: rad, between two beams."""
    p = params[0]
    plant = p.plant
    points = np.empty((scan.ranges.shape[1] + SECTORS, 3))
    radius = plant.hull_radius + p.margin
    for i in range(twists.shape[0]):
        m = memory[i]
        vx, vy, w = twists[i, 0], twists[i, 1], twists[i, 2]
        factor = saturation_factor(
            plant.wheel_matrix, plant.num_wheels, plant.wheel_speed_limit, plant.turn_speed, vx, vy, w
        )
        vx, vy, w = factor * vx, factor * vy, factor * w
        fastest = max(math.sqrt(vx * vx + vy * vy), math.sqrt(m.command[0] ** 2 + m.command[1] ** 2))
        way = fastest * (plant.lag + 2.0 * plant.dt) + 0.5 * fastest * fastest / plant.acceleration
        farthest = (radius + way) / max(1.0 - p.spacing, 0.1)
        count = find_hits(p, scan, seen, m, i, farthest, radius, points)
        hits = points[:count]
        for j in range(count):
            distance = math.sqrt(hits[j, 0] * hits[j, 0] + hits[j, 1] * hits[j, 1])
            hits[j, 2] = min(radius + p.spacing * distance, (1.0 - 1e-6) * distance)
        vx, vy, w = first_that_stops(plant, hits, m.command, seen.twists[i], vx, vy, w)
        twists[i, 0], twists[i, 1], twists[i, 2] = vx, vy, w
        set_command(plant, m.command, vx, vy, w)


@inlined
def first_that_stops(plant, hits, command, wheels, vx, vy, w):
    """Returns the first twist of `Shield` that can be stopped before all hits; zero where none can."""
    if step_and_stop(plant, hits, command, wheels, vx, vy, w):
        return vx, vy, w
    if plant.holonomic:
        for turned in TURNED:
            sine, cosine = sin_cos(turned)
            x = cosine * (cosine * vx - sine * vy)
            y = cosine * (sine * vx + cosine * vy)
            if step_and_stop(plant, hits, command, wheels, x, y, w):
                return x, y, w
    for k in range(1, SHARES + 1):
        share = 1.0 - k / SHARES
        if step_and_stop(plant, hits, command, wheels, share * vx, share * vy, w):
            return share * vx, share * vy, w
    return 0.0, 0.0, 0.0


@dataclasses.dataclass(frozen=True)
class Shielded:
    """Any policy for goals with a `Shield` behind it."""

    policy: Policy
    shield: Shield = Shield()

    @property
    def knows(self) -> str:
        """Returns what the policy knows."""
        return self.policy.knows

    @property
    def observes(self) -> tuple[type, ...]:
        """Returns what the policy observes, of goals."""
        return tuple(each for each in self.policy.observes if each is goal_reaching.Observation)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the memory of policy and shield, (b,).

        Raises:
            ValueError: if the scan does not surround the robot, or by the policy.
        """
        parts = {"policy": self.policy.reset(briefing), "shield": self.shield.reset(briefing)}
        memory = np.empty(briefing.num_envs, [(name, each.dtype, each.shape[1:]) for name, each in parts.items()])
        for name, each in parts.items():
            memory[name] = each
        return memory

    def act(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the policy's twists (b, t), m/s and rad/s, or others that can stop in time."""
        twists = self.policy.act(observation, briefing, memory["policy"])
        return self.shield.passed(observation, briefing, memory["shield"], twists)
