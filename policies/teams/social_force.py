"""The social force of Moussaïd and others as a robot's law, among tracked bodies and what the scan meets."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import team_worlds
from wayfield.envs.crowds.people import pushed_2009
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import CrowdLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.policy import check_scan
from wayfield.policies.parts.steering import driven_by_point, point_ahead
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import exponential, sin_cos

_ON_A_BODY = 0.1  # m, about a body's hull, within which a beam ends at it

MEMORY = np.dtype([("vx", np.float64), ("vy", np.float64)], align=True)  # m/s, world frame: the wanted velocity


@dataclasses.dataclass(frozen=True)
class SocialForce(CrowdLaw):
    """Lets a velocity be pushed: to the wanted one, away from tracked bodies and from the nearest thing a beam meets.

        dv/dt = (u - v) / tau + sum f(bodies) + wall exp(-d / wall_range) n,   u = max_speed or k |e| towards the goal

    f is the interaction of Moussaïd et al., fitted to how people evade each other: it slows along the direction of the
    interaction and evades across it. d is from the hull to the nearest end of a beam that is on no tracked body. v is
    held to 1.3 max_speed. A differential drive is driven by a point `ahead` of the axle, as in `OrcaTeam`.

    Nothing is promised: forces add up, and may push into what stands on the other side. It has access to bodies, not to
    a map.

    Source: Moussaïd, Helbing, Garnier, Johansson, Combe and Theraulaz, Proc. R. Soc. B 276, 2009.
    """

    tau: float = gain(0.54, "s", "in which the wanted velocity is taken up", above=0.0, search=(0.1, 1.5))
    wall: float = gain(3.0, "m/s^2", "away from what stands, at the hull", least=0.0, search=(0.5, 12.0))
    wall_range: float = gain(0.1, "m", "in which that falls to 1/e", above=0.0, search=(0.03, 0.4))
    max_speed: float = gain(0.6, "m/s", "wanted", above=0.0)
    k: float = gain(1.0, "1/s", "speed per metre from the goal", above=0.0, search=(0.5, 4.0))
    ahead: float = gain(0.15, "m", "of the axle, of the point that a differential drive is driven by", above=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns MEMORY records (b,)."""
        return np.zeros(briefing.num_envs, MEMORY)

    def act(
        self, observation: team_worlds.Observation, briefing: Briefing, memory: NDArray[Any]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t): m/s and rad/s."""
        if len(briefing.beam_angles):
            check_scan(self, observation.ranges, briefing)
        robot = briefing.robot
        p = params(self, briefing, **point_ahead(self, briefing))
        beams = np.column_stack([np.cos(briefing.beam_angles), np.sin(briefing.beam_angles)])
        out = np.zeros((len(memory), len(robot.twist_axes)))
        arrays = (observation.pose, observation.goal, observation.bodies, observation.ranges, beams)
        push(p, *map(np.ascontiguousarray, arrays), memory, out)
        return out


@any_layout
@compiled
def push(params, poses, goals, bodies, ranges, beams, memory, out):
    """Fills the (b, t) twists of `SocialForce`."""
    p = params[0]
    ahead = p.ahead
    for i in range(poses.shape[0]):
        m = memory[i]
        sine, cosine = sin_cos(poses[i, 2])
        vx = cosine * m.vx + sine * m.vy
        vy = cosine * m.vy - sine * m.vx
        distance = max(math.sqrt(goals[i, 0] * goals[i, 0] + goals[i, 1] * goals[i, 1]), 1e-12)
        speed = min(p.k * distance, p.max_speed) / distance
        ax = (speed * goals[i, 0] - vx) / p.tau
        ay = (speed * goals[i, 1] - vy) / p.tau
        for j in range(bodies.shape[1]):
            if bodies[i, j, 6] < 0.5:
                continue
            fx, fy = pushed_2009(bodies[i, j, 0] - ahead, bodies[i, j, 1], vx - bodies[i, j, 2], vy - bodies[i, j, 3])
            ax += fx
            ay += fy
        nearest = np.inf
        nx = 0.0
        ny = 0.0
        for k in range(ranges.shape[1]):
            if ranges[i, k] >= min(p.max_range, nearest):
                continue
            x = ranges[i, k] * beams[k, 0]
            y = ranges[i, k] * beams[k, 1]
            tracked = False
            for j in range(bodies.shape[1]):
                if bodies[i, j, 6] > 0.5:
                    dx = x - bodies[i, j, 0]
                    dy = y - bodies[i, j, 1]
                    reach = bodies[i, j, 4] + _ON_A_BODY
                    tracked = tracked or dx * dx + dy * dy < reach * reach
            if not tracked:
                nearest = ranges[i, k]
                nx = -beams[k, 0]
                ny = -beams[k, 1]
        if nearest < np.inf:
            size = p.wall * exponential(-max(nearest - p.plant.hull_radius, 0.0) / p.wall_range)
            ax += size * nx
            ay += size * ny
        vx += p.plant.dt * ax
        vy += p.plant.dt * ay
        most = 1.3 * p.max_speed
        factor = min(1.0, most / max(math.sqrt(vx * vx + vy * vy), 1e-12))
        vx *= factor
        vy *= factor
        m.vx = cosine * vx - sine * vy
        m.vy = sine * vx + cosine * vy
        out[i, 0], out[i, 1] = driven_by_point(p, vx, vy)
