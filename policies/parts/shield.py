"""The shield behind a policy: takes away the motion that a robot, by its data sheet, could not stop from in time."""

import dataclasses
import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots import sensing
from wayfield.envs.robots.kinematics import saturated
from wayfield.envs.robots.records import aligned
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.params import params
from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.stopping import (
    RECALL_RANGE,
    RECALLED,
    SECTORS,
    Scan,
    Seen,
    beam_directions,
    enter_hits,
    keep_near,
    recalled_near,
    sees_all_round,
    set_command,
    step_and_stop,
)
from wayfield.system.compiled import allocating, any_layout, inlined
from wayfield.system.elementary import sin_cos

STATE = aligned([("command", np.float64, (3,)), RECALLED])  # m/s and rad/s, the last as the plant takes it
SHARES = 4  # of a velocity that are tried
LEAST_VIEW = math.pi  # rad, of a scan that a robot can be kept from harm by
BLIND_STEP = 0.1  # rad, between directions that stand for where no beam looks
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
    What was near stays known for `recall` after it was last seen. With `beside` it lets a robot through a door that it
    fills, where hits that are grown would hold it, and forgotten ones would let it drive into a post: it knows all that
    was seen within 1.2 m, and what is nearer than `beside` for as long as the robot stands, but grows only what is seen
    now. Where no beam looks, something is taken to stand
    beside the hull: what has a scan of less than a full circle does not back into the rest. Moving things are taken for
    standing still.

    It holds without noise, by a sheet that is true, and where what stands is wide enough to be hit: a wall without
    thickness, seen end-on, is not. It does not hold for what comes from behind a corner faster than it is seen.
    """

    margin: float = gain(0.02, "m", "kept from hits besides the hull", least=0.0)
    spread: float = gain(1.0, "1", "of the angle between beams that hits are grown by", least=0.0)
    recall: float = gain(10.0, "s", "for which what is near stays known out of sight", least=0.0)
    beside: float = gain(0.0, "1", "hull radii, within which that does not end while it stands; 0: it does", least=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what is remembered of each robot, (b,) STATE.

        Raises:
            ValueError: if the scan looks at less than half a turn.
        """
        check_view(self, briefing)
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
        beside = self.beside * briefing.robot.hull_radius
        p = params(self, briefing, spacing=self.spread * float(spacing), beside=beside)
        filter_twists(p, scan, Seen.of(observation, briefing), blind_directions(briefing), memory, driven)
        return driven[:, briefing.robot.twist_axes]


def check_view(filter_: Gains, briefing: Briefing) -> None:
    """Raises ValueError, naming the filter, unless the scan looks at half a turn or more."""
    angles = briefing.beam_angles
    if len(angles) < 2 or angles[-1] - angles[0] + angles[1] - angles[0] < LEAST_VIEW:
        view = f"num_beams is {len(angles)}" if len(angles) < 2 else f"it spans {angles[-1] - angles[0]:.3g} rad"
        raise ValueError(f"{type(filter_).__name__} needs a scan of at least half a turn; {view}")


def blind_directions(briefing: Briefing) -> NDArray[np.float64]:
    """Returns unit vectors (n, 2), body frame, a few degrees apart, to where no beam looks; none of a full circle."""
    angles = briefing.beam_angles
    if sees_all_round(briefing):
        return np.empty((0, 2))
    first, last = float(angles[-1]), float(angles[0]) + 2.0 * math.pi
    inside = np.linspace(first, last, 2 + math.ceil((last - first) / BLIND_STEP))[1:-1]
    return sensing.beam_directions(inside)


@any_layout
@allocating
def filter_twists(params, scan, seen, blind, memory, twists):
    """Filters the twists (b, 3) of `Shield.passed` in place.

    params: `spacing` is the angle (rad) between two beams, `beside` is in m. blind (n, 2): see `blind_directions`.
    """
    p = params[0]
    plant = p.plant
    points = np.empty((scan.ranges.shape[1] + SECTORS + blind.shape[0], 3))
    radius = plant.hull_radius + p.margin
    for i in range(twists.shape[0]):
        m = memory[i]
        vx, vy, w = saturated(plant, twists[i, 0], twists[i, 1], twists[i, 2])
        wheels = seen.twists[i]  # which may be faster than the command, by the lag
        fastest = max(vx * vx + vy * vy, m.command[0] ** 2 + m.command[1] ** 2, wheels[0] ** 2 + wheels[1] ** 2)
        fastest = math.sqrt(fastest)
        way = fastest * (plant.lag + 2.0 * plant.dt) + 0.5 * fastest * fastest / plant.acceleration
        farthest = (radius + way) / max(1.0 - p.spacing, 0.1)
        if p.beside > 0.0:
            farthest = max(farthest, RECALL_RANGE)
        near = recalled_near(p, seen, m, i, p.beside)
        met = enter_hits(p, scan, i, farthest, radius, near, points)
        count = keep_near(p, seen, m, i, near, radius, points, met)
        hits = points[:count]
        for j in range(met if p.beside > 0.0 else count):
            distance = math.sqrt(hits[j, 0] * hits[j, 0] + hits[j, 1] * hits[j, 1])
            hits[j, 2] = min(radius + p.spacing * distance, (1.0 - 1e-6) * distance)
        for j in range(blind.shape[0]):
            points[count + j, 0] = radius * blind[j, 0]
            points[count + j, 1] = radius * blind[j, 1]
            points[count + j, 2] = (1.0 - 1e-6) * radius
        hits = points[: count + blind.shape[0]]
        vx, vy, w = first_that_stops(plant, hits, m.command, wheels, vx, vy, w)
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


class Filter(Protocol):
    """What stands behind a policy: a `Shield`, or another with its two methods and the last `command` in its memory."""

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns what is remembered of each robot: see `Shield.reset`."""

    def passed(
        self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any], twists: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists that are driven: see `Shield.passed`."""


@dataclasses.dataclass(frozen=True)
class Shielded:
    """Any policy for goals with a `Shield`, or another filter, behind it."""

    policy: Policy
    shield: Filter = Shield()

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
            ValueError: if the scan looks at less than half a turn, or by the policy.
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
        passed = self.shield.passed(observation, briefing, memory["shield"], twists)
        if hasattr(self.policy, "driven"):  # one that predicts from its last command
            self.policy.driven(memory["policy"], memory["shield"]["command"])
        return passed
